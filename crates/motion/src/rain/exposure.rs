//! Exposure of surfaces to rain: how much of the open field's rainfall reaches a place of a wall, a roof, a trunk or the ground.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::rain::emitter::{RainfallParams, diameters_of_equal_probability};
use crate::rain::fall::{EmittedDrop, sample_wind, sphere_volume, terminal_speed};
use crate::rain::ground::GroundHeight;
use crate::rain::shelter::Shelter;
use crate::rain::solids::RainSolids;
use crate::rain::tuning::{EXPOSURE_OFFSET, EXPOSURE_SAMPLES};
use osier_wind::Wind;

/// A point of a surface at which the rain that it catches is computed.
#[derive(Debug, Clone, Copy)]
pub struct ExposedPoint {
    /// Position in the world, m.
    pub position: Vec3,
    /// Unit normal that points away from the body.
    pub normal: Vec3,
}

/// The rain of a clip on the surfaces of a scene: a mean over drop sizes and times.
#[derive(Debug)]
pub struct RainExposure {
    shelter: Shelter,
    wind: Option<Arc<dyn Wind>>,
    /// Drops of different sizes, each at a different time of the clip.
    samples: Vec<RainSample>,
    /// Gravity along -Y, m/s^2.
    g: f64,
}

/// Drops of one size at one time; all samples represent equal volumes of water.
#[derive(Debug, Clone, Copy)]
struct RainSample {
    /// Diameter of the drops, m.
    diameter: f64,
    /// Time at which they arrive, s.
    t: f64,
}

impl RainExposure {
    /// Exposure to the rainfall of `params`; solids and ground shelter surfaces behind them. `wind` is evaluated at times of the
    /// rainfall.
    pub fn new(
        params: &RainfallParams,
        wind: Option<Arc<dyn Wind>>,
        solids: RainSolids,
        ground: Arc<dyn GroundHeight>,
    ) -> Self {
        // Diameters at the middles of intervals that contribute equal volumes of water.
        let diameters = diameters_of_equal_probability(params);
        let total: f64 = diameters.iter().map(|d| sphere_volume(*d)).sum();
        let diameter_at = |fraction: f64| {
            let mut volume = 0.0;
            let found = diameters.iter().find(|d| {
                volume += sphere_volume(**d);
                volume >= fraction * total
            });
            found.or(diameters.last()).copied().unwrap_or(1e-3)
        };
        let samples = (0..EXPOSURE_SAMPLES).map(|k| {
            let middle = (f64::from(k) + 0.5) / f64::from(EXPOSURE_SAMPLES);
            // Sizes in the order of the times would correlate the two: from size to size the time advances by three eighths of the clip.
            let t = params.duration * (f64::from((3 * k) % EXPOSURE_SAMPLES) + 0.5) / f64::from(EXPOSURE_SAMPLES);
            RainSample { diameter: diameter_at(middle), t }
        });
        Self { shelter: Shelter::new(solids, ground, params.g), wind, samples: samples.collect(), g: params.g }
    }

    /// Water that each place catches per area and time, divided by the rainfall on level ground in the open: 1 on level ground, 0
    /// where no drop arrives, above 1 where wind drives rain against a wall.
    pub fn catch_ratios(&self, points: &[ExposedPoint]) -> Vec<f32> {
        let mut ratios = vec![0.0; points.len()];
        let wind = self.wind.as_deref();
        // Positions slightly outside of the surface, which would shelter itself otherwise.
        let positions: Vec<Vec3> = points.iter().map(|p| p.position + p.normal * EXPOSURE_OFFSET).collect();
        for sample in &self.samples {
            let air = sample_wind(wind, &positions, sample.t);
            // Velocity relative to the ground: terminal speed, carried by the wind.
            let speed = terminal_speed(sample.diameter, self.g);
            let velocities: Vec<DVec3> = air.iter().map(|air| air.as_dvec3() - DVec3::Y * speed).collect();
            let facing: Vec<usize> =
                (0..points.len()).filter(|i| velocities[*i].dot(points[*i].normal.as_dvec3()) < 0.0).collect();
            let volume = sphere_volume(sample.diameter);
            let drops: Vec<EmittedDrop> = facing
                .iter()
                .map(|i| EmittedDrop { t: sample.t, p: positions[*i].as_dvec3(), v: velocities[*i], volume })
                .collect();
            let sheltered = self.shelter.find_blocked_drops(&drops, wind, sample.t);
            for ((i, drop), _) in facing.into_iter().zip(drops).zip(sheltered).filter(|(_, sheltered)| !sheltered) {
                // Flux through the surface divided by the flux through level ground, -v.n / speed.
                let ratio = -drop.v.dot(points[i].normal.as_dvec3()) / speed;
                ratios[i] += osier_base::math::narrow(ratio / f64::from(EXPOSURE_SAMPLES));
            }
        }
        ratios
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rain::emitter::{DropSizes, IntensityEnvelope};
    use osier_scene::Mesh;
    use osier_wind::UniformWind;

    fn exposure(wind: Option<Arc<dyn Wind>>) -> RainExposure {
        // A roof of 4 x 4 m at a height of 3 m.
        let points = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]].map(|[x, z]| Vec3::new(x, 3.0, z)).to_vec();
        let roof = Mesh { points, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
        let params = RainfallParams {
            seed: 1,
            intensity: 5e-6,
            size: DropSizes::Fixed(2e-3),
            total: None,
            envelope: IntensityEnvelope::Constant,
            jitter: 0.0,
            duration: 2.0,
            spin_up: 0.0,
            g: 9.81,
        };
        RainExposure::new(&params, wind, RainSolids::new([&roof]).expect("a roof"), Arc::new(0.0))
    }

    #[test]
    fn walls_and_ground_catch_what_slanting_rain_brings() {
        let at = |x: f32, y: f32, normal| ExposedPoint { position: Vec3::new(x, y, 0.0), normal };
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3);
        // In calm air level faces in the open catch the rainfall, walls and places under the roof nothing, a slope its cosine.
        let slope = Vec3::new(0.6, 0.8, 0.0);
        let points = [at(9.0, 0.0, Vec3::Y), at(0.0, 0.0, Vec3::Y), at(0.0, 3.0, Vec3::Y), at(9.0, 1.0, Vec3::X)];
        let calm = exposure(None).catch_ratios(&[points.as_slice(), &[at(9.0, 1.0, slope)]].concat());
        assert!(near(&calm, &[1.0, 0.0, 1.0, 0.0, 0.8]), "{calm:?}");
        // Wind of 5 m/s carries drops of 2 mm sideways by 5 / 6.55 of their fall: on walls that face it, and 2.3 m under the roof.
        let slant = osier_base::math::narrow(5.0 / terminal_speed(2e-3, 9.81));
        let wind = exposure(Some(Arc::new(UniformWind(Vec3::X * 5.0))));
        let edge = -2.0 + 3.0 * slant;
        let points = [
            at(9.0, 1.0, -Vec3::X),
            at(9.0, 1.0, Vec3::X),
            at(edge - 0.05, 0.0, Vec3::Y),
            at(edge + 0.05, 0.0, Vec3::Y),
        ];
        let caught = wind.catch_ratios(&points);
        assert!(near(&caught, &[slant, 0.0, 1.0, 0.0]), "{caught:?} for {slant}");
    }
}
