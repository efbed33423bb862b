//! Parallel loops whose results do not depend on the number of threads: fixed chunks, results in order.

use std::collections::hash_map::RandomState;

/// Usual length of the chunks of [`par_chunks`], items; float sums depend on it, so that it must not change.
pub const CHUNK: usize = 4096;

/// Maps chunks of `items` in parallel and returns the results in order. `f` gets the index of the chunk's first item and the
/// chunk; all chunks but the last hold `chunk` items.
/// Float sums stay equal at any thread count when each chunk sums serially and the caller folds the results in order.
pub fn par_chunks<T: Sync, R: Send>(items: &[T], chunk: usize, f: impl Fn(usize, &[T]) -> R + Sync + Send) -> Vec<R> {
    let chunk = chunk.max(1);
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::{IndexedParallelIterator as _, ParallelIterator as _, ParallelSlice as _};
        items.par_chunks(chunk).enumerate().map(|(i, c)| f(i * chunk, c)).collect()
    }
    #[cfg(not(feature = "parallel"))]
    {
        items.chunks(chunk).enumerate().map(|(i, c)| f(i * chunk, c)).collect()
    }
}

/// Maps every item in parallel (one task each) and returns the results in order: for few, heavy items.
pub fn par_map<T: Sync, R: Send>(items: &[T], f: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::{IntoParallelRefIterator as _, ParallelIterator as _};
        items.par_iter().map(f).collect()
    }
    #[cfg(not(feature = "parallel"))]
    {
        items.iter().map(f).collect()
    }
}

/// Runs `f` on every item in parallel, in no fixed order.
pub fn par_each<T: Send>(items: &mut [T], f: impl Fn(&mut T) + Sync + Send) {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::{IntoParallelRefMutIterator as _, ParallelIterator as _};
        items.par_iter_mut().for_each(f);
    }
    #[cfg(not(feature = "parallel"))]
    items.iter_mut().for_each(f);
}

/// Changes and maps every item in parallel, in no fixed order, and returns the results in the order of the items.
pub fn par_map_mut<T: Send, R: Send>(items: &mut [T], f: impl Fn(&mut T) -> R + Sync + Send) -> Vec<R> {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::{IntoParallelRefMutIterator as _, ParallelIterator as _};
        items.par_iter_mut().map(f).collect()
    }
    #[cfg(not(feature = "parallel"))]
    {
        items.iter_mut().map(f).collect()
    }
}

/// Runs `f` on a thread of the pool, so that parallel loops in it start without a switch from the caller's thread each time.
pub fn among<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    join(f, || ()).0
}

/// Runs both, in parallel where there are threads, and returns both results.
pub fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    #[cfg(feature = "parallel")]
    {
        rayon::join(a, b)
    }
    #[cfg(not(feature = "parallel"))]
    {
        (a(), b())
    }
}

/// Runs `f` in a new pool of `threads` threads. Without feature `parallel`, or if no pool can be made, it runs on the caller's thread.
pub fn on_threads<R: Send>(threads: usize, f: impl FnOnce() -> R + Send) -> R {
    #[cfg(feature = "parallel")]
    {
        // A pool that cannot be built costs speed only, since no result depends on the number of threads.
        match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(pool) => pool.install(f),
            Err(_) => f(),
        }
    }
    #[cfg(not(feature = "parallel"))]
    {
        let _ = threads;
        f()
    }
}

/// Number of threads of the current pool, 1 without feature `parallel`; results must not depend on it.
pub fn threads() -> usize {
    #[cfg(feature = "parallel")]
    {
        rayon::current_num_threads().max(1)
    }
    #[cfg(not(feature = "parallel"))]
    {
        1
    }
}

/// A hash map that cannot be iterated, so that hash order never reaches an output.
#[derive(Debug)]
#[allow(clippy::disallowed_types, reason = "this wrapper is what hides the iteration order")]
pub struct LookupMap<K, V>(std::collections::HashMap<K, V, RandomState>);

#[allow(clippy::disallowed_types, reason = "this wrapper is what hides the iteration order")]
impl<K, V> Default for LookupMap<K, V> {
    fn default() -> Self {
        Self(std::collections::HashMap::default())
    }
}

impl<K: std::hash::Hash + Eq, V> LookupMap<K, V> {
    /// The value of a key; `None` for a key that was never set.
    pub fn get<Q: std::hash::Hash + Eq + ?Sized>(&self, key: &Q) -> Option<&V>
    where
        K: std::borrow::Borrow<Q>,
    {
        self.0.get(key)
    }

    /// Sets the value of a key and returns the one it had.
    pub fn insert(&mut self, key: K, value: V) -> Option<V> {
        self.0.insert(key, value)
    }

    /// Number of distinct keys inserted so far; keys are never removed.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// True before the first [`LookupMap::insert`].
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(all(test, feature = "parallel"))]
mod tests {
    use super::*;

    #[test]
    fn chunked_sums_do_not_depend_on_threads() {
        let items: Vec<f32> = (0..50_000).map(|i| 1.0 / (i as f32 + 1.0)).collect();
        let sum = |threads: usize| {
            let parts = on_threads(threads, || par_chunks(&items, CHUNK, |_, c| c.iter().fold(0.0_f32, |s, x| s + x)));
            parts.iter().fold(0.0_f32, |s, x| s + x).to_bits()
        };
        let one = sum(1);
        assert!((2..=8).all(|n| sum(n) == one));
    }
}
