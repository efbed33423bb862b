//! The folder in which results are kept from one bake to the next: grown IFS leaves, the spun-up wind.

use std::sync::{Arc, Mutex, PoisonError};

use super::Folder;

/// A cache folder with the messages about what was found in it. Clones share both.
#[derive(Debug, Clone)]
pub struct BakeCache(Arc<CacheState>);

#[derive(Debug)]
struct CacheState {
    folder: Folder,
    messages: Mutex<Vec<String>>,
}

impl BakeCache {
    /// A cache that keeps its files in `folder`, which its users read and write themselves.
    pub fn new(folder: Folder) -> Self {
        Self(Arc::new(CacheState { folder, messages: Mutex::default() }))
    }

    /// The folder of the cached files; callers choose the names in it and check what they read.
    pub fn folder(&self) -> &Folder {
        &self.0.folder
    }

    /// Queues a message for the user about a cached file: loaded, stale or damaged.
    pub fn add_message(&self, text: String) {
        self.0.messages.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }

    /// The queued messages; a second call returns none of them.
    pub fn take_messages(&self) -> Vec<String> {
        std::mem::take(&mut *self.0.messages.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
