//! What a lattice wind is at some step, with what it has to say of the steps before, as bytes.

use super::report::{LatticeStats, LatticeWarning};
use super::solver::{LatticeSolver, other_checkpoint};
use osier_base::Result;
use osier_base::diagnostic::codes;

/// Bytes of how it did.
const HEALTH: usize = 40;

impl LatticeSolver {
    /// What tells this lattice from others: options, seed and solid cells.
    pub fn fingerprint(&self) -> u64 {
        self.setup.fingerprint()
    }

    /// All that it is, to go on from by [`LatticeSolver::restore_state`]: how it did, what it has to say, and [`LatticeSolver::checkpoint`].
    pub fn save_state(&self) -> Vec<u8> {
        let LatticeStats { steps, clamped_cells, peak_checkerboard, checkerboard, density_error } = self.stats;
        let mut bytes: Vec<u8> = [steps, clamped_cells].iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes.extend([peak_checkerboard, checkerboard, density_error].iter().flat_map(|v| v.to_le_bytes()));
        let notes: String = self.warnings.iter().map(|n| format!("{}\t{}\n", n.code, n.text)).collect();
        bytes.extend((notes.len() as u64).to_le_bytes());
        bytes.extend(notes.into_bytes());
        bytes.extend(self.checkpoint());
        bytes
    }

    /// Goes on from a state of a lattice with the same options, seed and solids, as one that never stopped.
    /// # Errors
    /// `Simulation` if the bytes are of another lattice, which leaves this one as it is.
    pub fn restore_state(&mut self, bytes: &[u8]) -> Result<()> {
        let Some((health, notes, rest)) = parts(bytes) else { return Err(other_checkpoint()) };
        self.resume(rest)?;
        (self.stats, self.warnings) = (health, notes);
        Ok(())
    }
}

fn parts(bytes: &[u8]) -> Option<(LatticeStats, Vec<LatticeWarning>, &[u8])> {
    let (head, rest) = bytes.split_at_checked(HEALTH)?;
    let words: Vec<[u8; 8]> = head.as_chunks::<8>().0.to_vec();
    let [steps, clamped_cells, peak_checkerboard, checkerboard, density_error] = words[..] else { return None };
    let [peak_checkerboard, checkerboard, density_error] =
        [peak_checkerboard, checkerboard, density_error].map(f64::from_le_bytes);
    let [steps, clamped_cells] = [steps, clamped_cells].map(u64::from_le_bytes);
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (notes, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let note = |line: &str| {
        let (code, text) = line.split_once('\t')?;
        Some(LatticeWarning { code: codes::find(code)?.code, text: text.to_owned() })
    };
    let notes = std::str::from_utf8(notes).ok()?.lines().map(note).collect::<Option<Vec<_>>>()?;
    Some((LatticeStats { steps, clamped_cells, peak_checkerboard, checkerboard, density_error }, notes, rest))
}
