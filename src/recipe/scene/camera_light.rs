//! `[camera]`, `[sun]`, `[sky]` and `[fog]`.

use crate::recipe::resolve::Resolver;
use crate::recipe::syntax::keys;
use crate::recipe::syntax::{ColorType, OptionalKey, SunDirection, TomlTable, degrees, number, point};
use osier_base::diagnostic::Diagnostic;

keys! {
    /// Camera; fitted to the plants unless `eye` is set.
    CameraKeys at "camera" {
        /// Position of the camera.
        eye: Option<[f64; 3]> = "eye" OptionalKey(point([0.0; 3]), "fitted"), basic;
        /// Point at which the camera looks.
        target: Option<[f64; 3]> = "target" OptionalKey(point([0.0; 3]), "centre of the plants"), basic;
        /// Vertical field of view.
        vfov: f64 = "vfov_deg" degrees(35.0, 1.0, 170.0), basic;
        /// Roll about the viewing direction, to the right.
        roll: f64 = "roll_deg" degrees(0.0, -360.0, 360.0);
        /// Factor on the distance of a fitted camera.
        distance: f64 = "distance" number(1.0, 0.01, 100.0, ""), basic;
    }
    /// Direction and strength of sunlight.
    SunKeys at "sun" {
        /// Elevation above the horizon.
        elevation: f64 = "elevation_deg" degrees(40.0, -90.0, 90.0), basic;
        /// Direction from which the sun shines: 0 is +X, 90 is -Z.
        azimuth: f64 = "direction_deg" SunDirection(-15.0), basic;
        /// Colour of the light.
        color: [f32; 3] = "color" ColorType("#fff9ee"), basic;
        /// Irradiance on a surface that faces the sun.
        strength: f64 = "strength" number(3.0, 0.0, 1000.0, "W/m^2"), basic;
        /// Angular diameter, which softens shadows.
        angle: f64 = "angle_deg" degrees(0.53, 0.0, 90.0);
    }
    /// Colours and brightness of the sky.
    SkyKeys at "sky" {
        /// Colour at the horizon.
        horizon: [f32; 3] = "horizon" ColorType("#edf3f9"), basic;
        /// Colour at the zenith.
        zenith: [f32; 3] = "zenith" ColorType("#89b3e6"), basic;
        /// Colour below the horizon, such as distant trees, which drops refract. POV-Ray, previews and USD (`maps/sky.exr`).
        below: Option<[f32; 3]> = "below" OptionalKey(ColorType("#1a2417"), "the sky goes on");
        /// Strength of blurred shade and gaps of light around the scene, as of leaves out of focus. POV-Ray and USD.
        dapple: f64 = "dapple" number(0.0, 0.0, 1.0, "");
        /// Radiance of the sky around the sun, as a factor on the sun's colour. POV-Ray, previews and USD.
        glow: f64 = "glow" number(0.0, 0.0, 100.0, ""), basic;
        /// Factor on both colours.
        strength: f64 = "strength" number(1.0, 0.0, 1000.0, ""), basic;
    }
    /// Haze. Previews and POV-Ray render it; USD and glTF store its parameters.
    FogKeys at "fog" {
        /// Distance at which 2 % of the contrast remains; without it there is no haze.
        visibility: Option<f64> = "visibility" OptionalKey(number(400.0, 0.1, 1e7, "m"), "none"), basic;
        /// Colour of the haze.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#edf3f9"), "the sky's at the horizon");
        /// Height at which a quarter of the density remains; 0 for a constant density.
        height: f64 = "height" number(0.0, 0.0, 1e5, "m");
    }
}

impl Resolver<'_> {
    /// Reads `[camera]`; S004 for a camera that looks at its own position.
    pub(in crate::recipe) fn camera(&mut self, root: &TomlTable) -> CameraKeys {
        let keys: CameraKeys = self.section(root, "camera");
        let is_same = |(eye, target): ([f64; 3], [f64; 3])| eye.iter().zip(target).all(|(a, b)| (a - b).abs() <= 0.0);
        if keys.eye.zip(keys.target).is_some_and(is_same) {
            let span = self.place_of(root, &["camera", "target"]);
            let d = Diagnostic::error("S004", "camera.target is the position of the camera", span, "no direction");
            self.report.push(d.help("name another point, or leave `target` out to look at the plants"));
        }
        keys
    }
}
