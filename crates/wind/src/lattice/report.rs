//! What a lattice wind reports: warnings and statistics.

/// Something that should be known but does not stop the run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LatticeWarning {
    /// Diagnostic code, such as `S022`.
    pub code: &'static str,
    /// What was found, and what to change.
    pub text: String,
}

/// Statistics of all steps since rest, and of the last check of the density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatticeStats {
    /// Time steps since rest, the spin-up included.
    pub steps: u64,
    /// Fluid cells whose speed was clamped, summed over all steps.
    pub clamped_cells: u64,
    /// Largest magnitude of the checkerboard density in any check.
    pub peak_checkerboard: f64,
    /// Checkerboard density at the last check: the mean of the density less 1, with the sign of the parity of x + y + z.
    pub checkerboard: f64,
    /// Mean of the density less 1 in the last check.
    pub density_error: f64,
}
