//! What a lattice wind is at some step, with what it has to say of the steps before, as bytes.

use super::run::{Health, Lattice, Note};
use osier_base::Result;
use osier_base::diagnostic::codes;

/// Bytes of how it did.
const HEALTH: usize = 40;

impl Lattice {
    /// What tells this lattice from others: options, seed and solid cells.
    pub fn key(&self) -> u64 {
        self.plan.key()
    }

    /// All that it is, to go on from by [`Lattice::take_up`]: how it did, what it has to say, and [`Lattice::checkpoint`].
    pub fn state(&self) -> Vec<u8> {
        let Health { steps, clamped, checkered, checkered_now, density } = self.health;
        let mut bytes: Vec<u8> = [steps, clamped].iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes.extend([checkered, checkered_now, density].iter().flat_map(|v| v.to_le_bytes()));
        let notes: String = self.notes.iter().map(|n| format!("{}\t{}\n", n.code, n.text)).collect();
        bytes.extend((notes.len() as u64).to_le_bytes());
        bytes.extend(notes.into_bytes());
        bytes.extend(self.checkpoint());
        bytes
    }

    /// Goes on from a state of a lattice with the same options, seed and solids, as one that never stopped.
    /// # Errors
    /// `Simulation` if the bytes are of another lattice, which leaves this one as it is.
    pub fn take_up(&mut self, bytes: &[u8]) -> Result<()> {
        let Some((health, notes, rest)) = parts(bytes) else { return self.resume(&[]) };
        self.resume(rest)?;
        (self.health, self.notes) = (health, notes);
        Ok(())
    }
}

fn parts(bytes: &[u8]) -> Option<(Health, Vec<Note>, &[u8])> {
    let (head, rest) = bytes.split_at_checked(HEALTH)?;
    let words: Vec<[u8; 8]> = head.as_chunks::<8>().0.to_vec();
    let [steps, clamped, checkered, checkered_now, density] = words[..] else { return None };
    let [checkered, checkered_now, density] = [checkered, checkered_now, density].map(f64::from_le_bytes);
    let [steps, clamped] = [steps, clamped].map(u64::from_le_bytes);
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (notes, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let note = |line: &str| {
        let (code, text) = line.split_once('\t')?;
        Some(Note { code: codes::find(code)?.code, text: text.to_owned() })
    };
    let notes = std::str::from_utf8(notes).ok()?.lines().map(note).collect::<Option<Vec<_>>>()?;
    Some((Health { steps, clamped, checkered, checkered_now, density }, notes, rest))
}
