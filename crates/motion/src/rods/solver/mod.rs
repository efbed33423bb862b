//! Time integration and statics of a tree of rods.

pub(crate) mod assemble;
pub(crate) mod block;
mod explicit;
mod implicit;
mod statics;

pub use explicit::MAX_GAUSS_SEIDEL_STIFFNESS;
pub use implicit::StepFailure;
