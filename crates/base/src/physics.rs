//! Physical constants, each once.
//!
//! # Examples
//! ```
//! use osier_base::physics::{GRAVITY, WATER_DENSITY};
//!
//! // Weight of a drop of 30 mm^3, N.
//! let weight = 30e-9 * WATER_DENSITY * GRAVITY;
//! assert!((weight - 2.94e-4).abs() < 1e-6);
//! ```

/// Acceleration of free fall near sea level at middle latitudes, m/s^2 (standard gravity is 9.80665).
pub const GRAVITY: f64 = 9.81;

/// Density of air, kg/m^3. Source: International Standard Atmosphere, sea level, 15 C.
pub const AIR_DENSITY: f64 = 1.225;

/// Kinematic viscosity of air, m^2/s. Source: International Standard Atmosphere at 20 C, rounded.
pub const AIR_VISCOSITY: f64 = 1.5e-5;

/// Density of water, kg/m^3. Source: CRC Handbook of Chemistry and Physics, 20 C, rounded.
pub const WATER_DENSITY: f64 = 998.0;

/// Surface tension of water against air, N/m. Source: CRC Handbook of Chemistry and Physics, 20 C.
pub const WATER_SURFACE_TENSION: f64 = 0.0728;

/// Index of refraction of water for yellow light. Source: CRC Handbook of Chemistry and Physics, 589 nm, 20 C.
pub const WATER_IOR: f32 = 1.333;
