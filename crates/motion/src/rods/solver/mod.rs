//! Integrators and static solver of a [`crate::rods::RodSystem`].

pub(crate) mod assemble;
pub(crate) mod block;
mod explicit;
mod implicit;
mod statics;

pub use explicit::MAX_GAUSS_SEIDEL_STIFFNESS;
pub use implicit::StepFailed;
