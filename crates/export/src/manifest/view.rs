//! Camera, light and display of a scene, as the manifest holds them.

use super::{CameraEntry, CurveEntry, FogEntry, LookEntry, Settings, SkyEntry, SunEntry, ViewEntry};
use crate::exr::SKY_FILE;
use osier_base::math::narrow;
use osier_base::units;
use osier_scene::{Scene, Sky, ToneCurve};

/// Camera, light and display of a scene. `paths`: files of the bake.
pub(super) fn view_entry(scene: &Scene, paths: &[&str], settings: &Settings) -> ViewEntry {
    // Angles are in degrees and lengths in metres here, as panels of other programs show them.
    let degrees = |radians: f32| narrow(units::degrees(f64::from(radians)));
    let (camera, sun, sky) = (&scene.camera, &scene.sun, &scene.sky);
    ViewEntry {
        camera: CameraEntry {
            // Columns of the column-vector form, one after the other, are the rows of the row-vector form.
            matrix: camera.matrix().to_cols_array().map(positive_zero),
            vfov_deg: degrees(camera.vfov),
            clip: camera.clipping_range(),
            size: settings.size,
        },
        sun: SunEntry {
            toward: sun.direction().to_array().map(positive_zero),
            irradiance: sun.color.map(|c| c * sun.strength),
            angle_deg: degrees(sun.angle),
        },
        sky: SkyEntry {
            stops: sky.stops(),
            glow: (sky.glow > 0.0).then(|| sun.color.map(|c| c * sky.glow)),
            glow_stops: Sky::GLOW.to_vec(),
            fog: sky.fog.map(|f| FogEntry { color: f.color, visibility: f.visibility, height: f.height }),
            file: paths.contains(&SKY_FILE).then(|| SKY_FILE.to_owned()),
        },
        look: LookEntry {
            exposure: ToneCurve::EXPOSURE,
            curve: CurveEntry { numerator: ToneCurve::NUMERATOR, denominator: ToneCurve::DENOMINATOR },
            shutter: settings.shutter,
        },
    }
}

/// Turns -0 into 0, so that equal numbers have equal texts.
fn positive_zero(v: f32) -> f32 {
    v + 0.0
}

impl ViewEntry {
    /// Every number of the view, to check that all are finite.
    pub(super) fn numbers(&self) -> Vec<f32> {
        let Self { camera, sun, sky, look } = self;
        let stops = sky.stops.iter().flat_map(|(at, [r, g, b])| [*at, *r, *g, *b]);
        let fog = sky.fog.iter().flat_map(|f| f.color.into_iter().chain([f.visibility, f.height]));
        camera
            .matrix
            .into_iter()
            .chain([camera.vfov_deg, sun.angle_deg, look.exposure, look.shutter])
            .chain(camera.clip)
            .chain(sun.toward)
            .chain(sun.irradiance)
            .chain(sky.glow.into_iter().flatten())
            .chain(stops)
            .chain(fog)
            .collect()
    }
}
