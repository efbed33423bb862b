//! A leaf as a surface that drops touch: points by texture coordinates, its margin, holes, veins and wetness.

pub(crate) mod mask;
pub(crate) mod surface;
pub(crate) mod veins;
pub(crate) mod wetness;
