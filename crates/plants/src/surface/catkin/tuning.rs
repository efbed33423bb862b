//! Numbers of tufts that no source gives, chosen by eye.

/// Greatest tilt of a hair and greatest turn of its outer sections, degrees, of the five variants: sleek, sleek and bent,
/// medium, fluffy, fluffy and bent. Chosen to resemble \[catkin\] fig. 10c, which prints no angles. With smaller turns (4, 5)
/// hairs look like wires.
pub const VARIANTS: [(f64, f64); 5] = [(25.0, 10.0), (25.0, 35.0), (60.0, 24.0), (105.0, 14.0), (105.0, 45.0)];
/// Colour of hairs, linear: the white of cellulose, slightly warm. 0.5..1.
pub const HAIR: [f32; 3] = [0.90, 0.89, 0.86];
/// Share of light that hairs let through, 0..1; a larger one makes them brighter against the sun.
pub const HAIR_LIGHT: f32 = 0.45;
/// Colour of the stalk, linear: a dark brown.
pub const STALK: [f32; 3] = [0.13, 0.075, 0.033];
