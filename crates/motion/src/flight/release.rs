//! Start positions and release of catkins.

use glam::{DVec3, Vec3};

use super::params::{CatkinStart, ReleaseCondition, SideBoundary};
use crate::flight::tuning::MAX_START_DRAWS;
use osier_base::geometry::Bounds;
use osier_base::rng::Rng;
use osier_scene::solid::Solids;

/// Parameters of starts that are spread over the sky.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyRelease {
    /// Seed of the start positions and times.
    pub seed: u64,
    /// Number of catkins, all of which are released within `duration`.
    pub count: u32,
    /// Box of the simulated air, m; starts are uniform over its x and z.
    pub inside: Bounds,
    /// Range of start heights, as fractions of the height of the box.
    pub band: [f64; 2],
    /// Duration over which starts are spread, s; 0 for all at once.
    pub duration: f64,
}

/// Random starts in the sky. If 64 draws find no position outside of solids, the catkin keeps the last, never flies,
/// and is counted as buried.
pub fn sky_starts(sky: &SkyRelease, solids: &Solids) -> Vec<CatkinStart> {
    let (low, size) = (sky.inside.min.as_dvec3(), sky.inside.size().as_dvec3());
    // Uniform in x and z, and in height within the band.
    let share = |draw: &mut Rng| {
        let [a, b] = sky.band;
        DVec3::new(draw.unit_f64(), a + (b - a) * draw.unit_f64(), draw.unit_f64())
    };
    (0..sky.count)
        .map(|id| {
            let mut draw = Rng::at(sky.seed, &["flight".into(), id.into(), 0_u64.into(), "start".into()]);
            let when = sky.duration * draw.unit_f64();
            let mut at = low + size * share(&mut draw);
            for _ in 1..MAX_START_DRAWS {
                if !solids.contains(at.as_vec3()) {
                    break;
                }
                at = low + size * share(&mut draw);
            }
            CatkinStart { at, wait: ReleaseCondition::Until(when) }
        })
        .collect()
}

/// Random point on an inflow side for a recycled catkin. `wind`: mean wind, m/s; `edges`: boundary conditions of the sides across
/// x and z, of which periodic ones have no inflow; `band`: range of heights as fractions of the height of the box.
pub(super) fn inflow_point(
    wind: Vec3,
    inside: Bounds,
    edges: [SideBoundary; 2],
    band: [f64; 2],
    draw: &mut Rng,
) -> DVec3 {
    let (low, size) = (inside.min.as_dvec3(), inside.size().as_dvec3());
    let [u, w] = [draw.unit_f64(), draw.unit_f64()];
    let y = low.y + size.y * (band[0] + (band[1] - band[0]) * draw.unit_f64());
    // Choose between the two inflow sides in proportion to the volume flux through each.
    let flux = |edge: SideBoundary, flux: f64| if edge == SideBoundary::Periodic { 0.0 } else { flux };
    let through = [flux(edges[0], f64::from(wind.x.abs()) * size.z), flux(edges[1], f64::from(wind.z.abs()) * size.x)];
    let across = |positive: bool, along: f64| if positive { 0.0 } else { along };
    let sum = through[0] + through[1];
    // If the mean wind blows through no open side, take a pair of sides that is not periodic.
    let across_z = if sum > 0.0 { u * sum >= through[0] } else { edges[0] == SideBoundary::Periodic };
    if across_z {
        DVec3::new(low.x + size.x * w, y, low.z + across(wind.z > 0.0, size.z))
    } else {
        DVec3::new(low.x + across(wind.x >= 0.0, size.x), y, low.z + size.z * w)
    }
}

/// Random release by wind: where the wind u exceeds `speed`, at the rate `rate` (u / speed - 1).
#[derive(Debug, Clone, Copy)]
pub(super) struct WindRelease {
    /// Release rate, 1/s, at a wind of twice `speed`.
    pub rate: f64,
    /// Threshold wind speed, m/s.
    pub speed: f64,
}

impl WindRelease {
    /// Whether a waiting catkin is released in the step of `dt` seconds at time `t`, s; `air`: wind at it, m/s.
    pub fn releases(self, wait: &mut ReleaseCondition, air: Vec3, t: f64, dt: f64) -> bool {
        match wait {
            ReleaseCondition::Until(when) => t >= *when,
            ReleaseCondition::Wind { exposure, ripe } => {
                // Cumulative hazard over the ripe part of the step: the release time does not depend on the step.
                let part = (t + dt - *ripe).clamp(0.0, dt);
                *exposure -= self.rate * (f64::from(air.length()) / self.speed - 1.0).max(0.0) * part;
                *exposure <= 0.0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The release time is independent of the step: a uniform wind of twice the threshold takes E / rate seconds.
    #[test]
    fn wind_release_is_independent_of_the_step() {
        for dt in [0.1, 0.01, 0.001] {
            let leaving = WindRelease { rate: 0.2, speed: 0.6 };
            for ripe in [0.0, 4.0] {
                let (mut wait, mut t) = (ReleaseCondition::Wind { exposure: 0.5, ripe }, 0.0);
                while !leaving.releases(&mut wait, Vec3::X * 1.2, t, dt) {
                    t += dt;
                }
                assert!((t - ripe - 2.5).abs() <= 2.0 * dt, "{t} at {dt}");
            }
        }
    }

    #[test]
    fn recycled_catkins_come_in_through_open_sides_only() {
        use SideBoundary::{Periodic, Recycle};
        let inside = Bounds { min: Vec3::new(-5.0, 0.0, -5.0), max: Vec3::new(5.0, 8.0, 5.0) };
        let wind = Vec3::new(2.0, 0.0, -2.0);
        let at_low_x_and_high_z = |edges: [SideBoundary; 2]| {
            let mut draw = Rng::at(2, &["entry".into()]);
            let all: Vec<DVec3> = (0..400).map(|_| inflow_point(wind, inside, edges, [0.2, 0.9], &mut draw)).collect();
            [all.iter().filter(|p| p.x <= -5.0).count(), all.iter().filter(|p| p.z >= 5.0).count()]
        };
        let [x, z] = at_low_x_and_high_z([Recycle; 2]);
        assert!((160..240).contains(&x) && x + z == 400, "{x} {z}");
        assert_eq!(at_low_x_and_high_z([Recycle, Periodic]), [400, 0]);
        assert_eq!(at_low_x_and_high_z([Periodic, Recycle]), [0, 400]);
    }

    #[test]
    fn starts_avoid_solids() {
        use osier_scene::solid::{Form, Prism, Solid};
        let prism = Prism::block(Vec3::ZERO, Vec3::new(20.0, 30.0, 30.0), 0.0);
        let solids = Solids::new(vec![Solid { name: "hall".into(), form: Form::Prism(prism), humidity: 0.5 }], true);
        let inside = Bounds { min: Vec3::new(-17.5, 0.0, -17.5), max: Vec3::new(17.5, 35.0, 17.5) };
        let all = sky_starts(&SkyRelease { seed: 3, count: 500, inside, band: [0.3, 0.95], duration: 0.0 }, &solids);
        assert!(all.iter().all(|s| !solids.contains(s.at.as_vec3())));
        assert!(all.iter().any(|s| s.at.y > 30.0) && all.iter().any(|s| s.at.y < 12.0));
    }
}
