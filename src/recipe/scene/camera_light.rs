//! `[camera]`, `[sun]`, `[sky]` and `[fog]`.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{ColorType, OptionalKey, degrees, number, point};

keys! {
    /// The view; fitted to the plants unless `eye` is given.
    CameraKeys at "camera" {
        /// Where it stands.
        eye: Option<[f64; 3]> = "eye" OptionalKey(point([0.0; 3]), "fitted");
        /// What it looks at.
        target: Option<[f64; 3]> = "target" OptionalKey(point([0.0; 3]), "middle of the plants");
        /// Vertical field of view.
        vfov: f64 = "vfov_deg" degrees(35.0, 1.0, 170.0);
        /// Lean to its right.
        roll: f64 = "roll_deg" degrees(0.0, -360.0, 360.0);
        /// Factor on the fitted distance.
        distance: f64 = "distance" number(1.0, 0.01, 100.0, "");
    }
    /// Sunlight.
    SunKeys at "sun" {
        /// Height over the horizon.
        elevation: f64 = "elevation_deg" degrees(40.0, -90.0, 90.0);
        /// Turn from +Z towards +X.
        azimuth: f64 = "azimuth_deg" degrees(75.0, -360.0, 360.0);
        /// Colour.
        color: [f32; 3] = "color" ColorType("#fff9ee");
        /// Brightness.
        strength: f64 = "strength" number(3.0, 0.0, 1000.0, "W/m^2");
        /// Angular diameter; softens shadows.
        angle: f64 = "angle_deg" degrees(0.53, 0.0, 90.0);
    }
    /// Light from the sky.
    SkyKeys at "sky" {
        /// At the horizon.
        horizon: [f32; 3] = "horizon" ColorType("#edf3f9");
        /// Overhead.
        zenith: [f32; 3] = "zenith" ColorType("#89b3e6");
        /// What stands below the horizon, dark as far trees; drops show it upside down. POV-Ray and previews.
        below: Option<[f32; 3]> = "below" OptionalKey(ColorType("#1a2417"), "the sky goes on");
        /// How uneven it is all around: masses of shade and gaps of light, as of leaves far out of focus. POV-Ray.
        dapple: f64 = "dapple" number(0.0, 0.0, 1.0, "");
        /// Brightness of the air around the sun, over that of its colour. POV-Ray and previews.
        glow: f64 = "glow" number(0.0, 0.0, 100.0, "");
        /// Factor on both.
        strength: f64 = "strength" number(1.0, 0.0, 1000.0, "");
    }
    /// Haze between the eye and far things. Previews and POV-Ray show it; USD and glTF carry its numbers.
    FogKeys at "fog" {
        /// Distance at which 2 % of a contrast is left; without it there is no haze.
        visibility: Option<f64> = "visibility" OptionalKey(number(400.0, 0.1, 1e7, "m"), "none");
        /// Colour.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#edf3f9"), "the sky's at the horizon");
        /// Height at which a quarter of it is left; 0: it is the same at all heights.
        height: f64 = "height" number(0.0, 0.0, 1e5, "m");
    }
}
