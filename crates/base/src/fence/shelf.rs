//! A folder for what is kept from one run to the next.

use std::sync::{Arc, Mutex, PoisonError};

use super::Folder;

/// Where things are kept, and what there is to say of them. Clones share it.
#[derive(Debug, Clone)]
pub struct Shelf(Arc<Inside>);

#[derive(Debug)]
struct Inside {
    folder: Folder,
    said: Mutex<Vec<String>>,
}

impl Shelf {
    /// One in a folder.
    pub fn new(folder: Folder) -> Self {
        Self(Arc::new(Inside { folder, said: Mutex::default() }))
    }

    /// The folder.
    pub fn folder(&self) -> &Folder {
        &self.0.folder
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
