//! What a plant looks like: tubes around its axes, leaf blades, bark, and the ground it stands on.

pub mod loft;

pub use loft::{Binding, Skin, SkinOptions, UvMode, skin};
