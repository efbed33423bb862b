//! BLAKE3 of a file whose header is patched last: headers that hold the length of what follows.

use blake3::hazmat::{ChainingValue, HasherExt as _, Mode, merge_subtrees_non_root, merge_subtrees_root};
use blake3::{CHUNK_LEN, Hasher};

use crate::convert;

/// A hash that holds back the first chunk, so that it may be rewritten until the end.
///
/// BLAKE3 is a binary tree over chunks of 1024 bytes whose left branches are full. Behind chunk 0 the right branches
/// along its left edge begin at chunks 1, 2, 4, 8, ... and are as long as what lies before them; each is hashed as its
/// bytes arrive, and chunk 0 joins them last.
/// Source: the BLAKE3 specification, section 2.1, tree structure.
#[derive(Debug)]
pub(super) struct PatchableHash {
    /// Bytes of chunk 0, which may still be overwritten.
    head: Vec<u8>,
    /// Finished right branches: of chunks 1, 2..4, 4..8, ...
    branches: Vec<ChainingValue>,
    /// The branch being filled; empty as long as all bytes are in the head.
    branch: Hasher,
    /// Offset of that branch and, equal to it, its length when full, bytes: 1024 times a power of two.
    span: u64,
}

fn branch_at(offset: u64) -> Hasher {
    let mut hasher = Hasher::new();
    hasher.set_input_offset(offset);
    hasher
}

impl PatchableHash {
    pub(super) fn new() -> Self {
        let span = CHUNK_LEN as u64;
        Self { head: Vec::new(), branches: Vec::new(), branch: branch_at(span), span }
    }

    /// Appends bytes: to chunk 0 first, then to the right branches.
    pub(super) fn update(&mut self, bytes: &[u8]) {
        let (head, mut rest) = bytes.split_at(bytes.len().min(CHUNK_LEN - self.head.len()));
        self.head.extend_from_slice(head);
        while !rest.is_empty() {
            // A full branch ends where its length equals its offset; the next begins at twice the offset.
            if self.branch.count() == self.span {
                self.branches.push(self.branch.finalize_non_root());
                self.span *= 2;
                self.branch = branch_at(self.span);
            }
            let room = convert::limit(self.span - self.branch.count());
            let (now, later) = rest.split_at(rest.len().min(room));
            self.branch.update(now);
            rest = later;
        }
    }

    /// Overwrites bytes of the first chunk. `false`, and nothing changed, if some lie elsewhere.
    pub(super) fn overwrite(&mut self, offset: u64, bytes: &[u8]) -> bool {
        let at = convert::limit(offset);
        let slot = at.checked_add(bytes.len()).and_then(|end| self.head.get_mut(at..end));
        slot.map(|slot| slot.copy_from_slice(bytes)).is_some()
    }

    /// BLAKE3 of all bytes so far, with chunk 0 as last overwritten.
    pub(super) fn finalize(&self) -> blake3::Hash {
        let mut left = Hasher::new();
        left.update(&self.head);
        if self.branch.count() == 0 {
            return left.finalize();
        }
        // Chunk 0 and the branches are joined from the left, each time two subtrees of equal size; only the last join is
        // the root.
        let join = |left, right: &ChainingValue| merge_subtrees_non_root(&left, right, Mode::Hash);
        let left = self.branches.iter().fold(left.finalize_non_root(), join);
        merge_subtrees_root(&left, &self.branch.finalize_non_root(), Mode::Hash)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(n: usize) -> Vec<u8> {
        (0..n).map(|i| u8::try_from(i * 7 % 251).expect("below 251")).collect()
    }

    #[test]
    fn equals_the_hash_of_the_whole_at_every_shape_of_the_tree() {
        let chunks = [0, 1, 2, 3, 4, 5, 7, 8, 9, 16, 31, 64, 65, 129];
        for n in chunks.iter().flat_map(|c| [c * CHUNK_LEN, c * CHUNK_LEN + 1, c * CHUNK_LEN + 1023]) {
            let whole = bytes(n);
            for step in [1, 24, 1000, 1024, 5000, 1 << 20] {
                if n / step > 20_000 {
                    continue;
                }
                let mut late = PatchableHash::new();
                whole.chunks(step).for_each(|part| late.update(part));
                assert_eq!(late.finalize(), blake3::hash(&whole), "{n} bytes, {step} at a time");
            }
        }
    }

    #[test]
    fn a_head_rewritten_last_counts_as_if_it_had_been_there() {
        for n in [100, 1024, 70_000] {
            let mut whole = bytes(n);
            let mut late = PatchableHash::new();
            late.update(&whole);
            assert!(late.overwrite(16, &[9; 80]));
            whole[16..96].fill(9);
            assert_eq!(late.finalize(), blake3::hash(&whole));
        }
    }

    #[test]
    fn bytes_beyond_the_head_are_not_rewritten() {
        let mut late = PatchableHash::new();
        late.update(&bytes(3000));
        for (offset, n) in [(1020, 5), (1024, 1), (2000, 1), (u64::MAX, 2)] {
            assert!(!late.overwrite(offset, &vec![9; n]));
        }
        assert_eq!(late.finalize(), blake3::hash(&bytes(3000)));
        let mut short = PatchableHash::new();
        short.update(&[1; 10]);
        assert!(!short.overwrite(8, &[2; 3]));
    }
}
