//! The context that every part of a bake takes beside the recipe.

use osier_base::files::BakeCache;
use osier_base::limits::Limits;
use osier_base::progress::{Cancel, Progress, Silent};

/// Limits, cancellation, progress and cache of a bake, passed by reference through all of its steps.
#[derive(Clone, Copy)]
pub struct BakeContext<'a> {
    /// Limits in force; checked before memory is spent.
    pub limits: &'a Limits,
    /// Polled by every long loop, which then returns `Cancelled`.
    pub cancel: &'a Cancel,
    /// Receives the stages of the bake and how far each has come.
    pub progress: &'a dyn Progress,
    /// Folder that stores the lattice wind after its spin-up; `None`: each bake spins up again.
    pub cache: Option<&'a BakeCache>,
}

impl<'a> BakeContext<'a> {
    /// A context without progress reports and without a cache for the spun-up wind.
    pub fn quiet(limits: &'a Limits, cancel: &'a Cancel) -> Self {
        Self { limits, cancel, progress: &Silent, cache: None }
    }
}
