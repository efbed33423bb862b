//! A folder for what is kept from one run to the next, named when it is known.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::Folder;

/// Where things are kept: nowhere, until a folder is given. Clones share it.
#[derive(Debug, Clone, Default)]
pub struct Shelf(Arc<Inside>);

#[derive(Debug, Default)]
struct Inside {
    folder: OnceLock<Folder>,
    said: Mutex<Vec<String>>,
}

impl Shelf {
    /// Names the folder; the first one stays.
    pub fn set(&self, folder: Folder) {
        let _ = self.0.folder.set(folder);
    }

    /// The folder, if it is known.
    pub fn folder(&self) -> Option<&Folder> {
        self.0.folder.get()
    }

    /// Remembers what is to be said of what was found there.
    pub fn say(&self, text: String) {
        self.0.said.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }

    /// What there was to say, once.
    pub fn said(&self) -> Vec<String> {
        std::mem::take(&mut *self.0.said.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
