//! Numbers of tufts that no source gives, chosen by eye.

/// Greatest tilt of a hair and greatest turn of its outer sections, degrees, of the five variants: sleek, sleek and bent,
/// medium, fluffy, fluffy and bent. They stand for \[catkin\] fig. 10c, which prints no angles. With smaller turns (4, 5) hairs are
/// wires.
pub const VARIANTS: [(f64, f64); 5] = [(25.0, 10.0), (25.0, 35.0), (60.0, 24.0), (105.0, 14.0), (105.0, 45.0)];
/// Colour of hairs, linear: cellulose with a breath of silk. 0.5..1.
pub const HAIR: [f32; 3] = [0.90, 0.89, 0.86];
/// Share of light that hairs let through: they shine against the sun. 0..1.
pub const HAIR_LIGHT: f32 = 0.45;
/// Colour of the stalk, linear.
pub const STALK: [f32; 3] = [0.13, 0.075, 0.033];
