//! Complete state of a solver as bytes: the flow, and the statistics and warnings of the steps so far.

use super::report::{LatticeStats, LatticeWarning};
use super::solver::{LatticeSolver, checkpoint_mismatch_error};
use osier_base::Result;
use osier_base::diagnostic::codes;

/// Bytes of [`LatticeStats`]: five numbers.
const STATS_BYTES: usize = 40;
/// Codes of warnings about steps: clamped speeds and checkerboards. All other warnings are about options and solids.
const CODES_OF_STEPS: [&str; 2] = ["S022", "S023"];

impl LatticeSolver {
    /// Hash of options, seed, solid cells and cut links; states are exchanged only between solvers of the same fingerprint.
    pub fn fingerprint(&self) -> u64 {
        self.setup.fingerprint()
    }

    /// State to continue from with [`LatticeSolver::restore_state`]: statistics, warnings, and [`LatticeSolver::checkpoint`]. Numbers
    /// are little-endian.
    pub fn save_state(&self) -> Vec<u8> {
        let LatticeStats { steps, clamped_cells, peak_checkerboard, checkerboard, density_error } = self.stats;
        let mut bytes: Vec<u8> = [steps, clamped_cells].iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes.extend([peak_checkerboard, checkerboard, density_error].iter().flat_map(|v| v.to_le_bytes()));
        // One line per warning, code and text separated by a tab, preceded by the length in bytes of all lines.
        let warnings: String = self.warnings.iter().map(|w| format!("{}\t{}\n", w.code, w.text)).collect();
        bytes.extend((warnings.len() as u64).to_le_bytes());
        bytes.extend(warnings.into_bytes());
        bytes.extend(self.checkpoint());
        bytes
    }

    /// Continues from the state of a solver with the same options, seed and solids; all later results have the bytes of an
    /// uninterrupted run.
    /// # Errors
    /// `Input` if the state is of another lattice wind or damaged.
    pub fn restore_state(&mut self, bytes: &[u8]) -> Result<()> {
        let Some((stats, warnings, flow)) = parse_state(bytes) else { return Err(checkpoint_mismatch_error()) };
        self.resume(flow)?;
        self.stats = stats;
        // Keep only warnings about the steps: the solids of the checkpoint may have had other names, which do not change the flow.
        let is_of_steps = |warning: &LatticeWarning| CODES_OF_STEPS.contains(&warning.code);
        self.warnings.retain(|warning| !is_of_steps(warning));
        self.warnings.extend(warnings.into_iter().filter(is_of_steps));
        Ok(())
    }
}

/// Statistics, warnings and the bytes of the flow from [`LatticeSolver::save_state`]; `None` if they are damaged.
fn parse_state(bytes: &[u8]) -> Option<(LatticeStats, Vec<LatticeWarning>, &[u8])> {
    // The inverse of `save_state`, field by field; a missing byte gives `None`.
    let (head, rest) = bytes.split_at_checked(STATS_BYTES)?;
    let words: Vec<[u8; 8]> = head.as_chunks::<8>().0.to_vec();
    let [steps, clamped_cells, peak_checkerboard, checkerboard, density_error] = words[..] else { return None };
    let [peak_checkerboard, checkerboard, density_error] =
        [peak_checkerboard, checkerboard, density_error].map(f64::from_le_bytes);
    let [steps, clamped_cells] = [steps, clamped_cells].map(u64::from_le_bytes);
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (lines, flow) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let warning = |line: &str| {
        let (code, text) = line.split_once('\t')?;
        Some(LatticeWarning { code: codes::find(code)?.code, text: text.to_owned() })
    };
    let warnings = std::str::from_utf8(lines).ok()?.lines().map(warning).collect::<Option<Vec<_>>>()?;
    Some((LatticeStats { steps, clamped_cells, peak_checkerboard, checkerboard, density_error }, warnings, flow))
}
