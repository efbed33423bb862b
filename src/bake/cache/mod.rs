//! Results that a bake stores in its folder, so that the next bake loads instead of computing them.

pub mod ifs_leaves;
pub(crate) mod wind_spin_up;
