//! Reports of a lattice wind: warnings and statistics.

/// A finding that the user should know, but that does not stop the run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LatticeWarning {
    /// Diagnostic code, such as `S022`.
    pub code: &'static str,
    /// The finding, and a remedy.
    pub text: String,
}

/// Statistics of all steps since rest, and of the last check of the density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatticeStats {
    /// Number of time steps since rest, including the spin-up.
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
