//! The wind close to surfaces, where no wind field resolves it.
//!
//! Air does not flow through a surface, and friction slows it along the surface. A wind field shows neither below the
//! height to which it is resolved: an analytic wind has vertical gusts at the ground, a lattice the velocity of its
//! lowest cell. Without this layer the wind would press catkins into the ground and hold them there.

use glam::Vec3;

use super::FlightParams;
use osier_base::math::{ln_f32, narrow};
use osier_scene::solid::{Near, Solids};
use osier_wind::Wind;

/// A wind field, corrected close to surfaces: a logarithmic profile along them, blocked across them.
#[derive(Debug, Clone, Copy)]
pub(super) struct NearSurfaceWind<'a> {
    field: &'a dyn Wind,
    solids: &'a Solids,
    /// Height at which the wind field is resolved, m.
    known: f32,
    /// Height up to which the surface blocks the wind across it, m.
    blocked: f32,
    /// Roughness length, m.
    roughness: f32,
    /// ln((known + roughness) / roughness).
    log_known: f32,
}

impl<'a> NearSurfaceWind<'a> {
    pub fn new(field: &'a dyn Wind, solids: &'a Solids, options: &FlightParams) -> Self {
        let (known, roughness) = (narrow(options.min_resolved_height), narrow(options.roughness));
        let log_known = ln_f32((known + roughness) / roughness);
        Self { field, solids, known, blocked: narrow(options.blocking_height), roughness, log_known }
    }

    /// Wind speed along a surface at a distance from it, m, divided by the speed at the height at which the field is resolved.
    fn share_along(&self, distance: f32) -> f32 {
        if distance >= self.known {
            return 1.0;
        }
        ln_f32((distance.max(0.0) + self.roughness) / self.roughness) / self.log_known
    }

    /// Position at which the wind field is sampled for a place near the surfaces `near`: moved along their normals out of the
    /// layers that the field does not resolve.
    fn resolved_place(&self, place: Vec3, near: &[Near]) -> Vec3 {
        near.iter().map(|n| n.nearest).fold(place, |at, n| at + n.normal * (self.known - n.distance).max(0.0))
    }

    /// Wind near the surfaces `near`, m/s, computed from `air`, the wind at the resolved place.
    fn slowed(&self, air: Vec3, near: &[Near]) -> Vec3 {
        // The velocity normal to the surface decreases linearly to 0, as in a stagnation flow; that along the surface follows the
        // logarithmic law.
        near.iter().map(|n| n.nearest).fold(air, |air, n| {
            let across = n.normal * air.dot(n.normal);
            let share_across = (n.distance / self.blocked).clamp(0.0, 1.0);
            across * share_across + (air - across) * self.share_along(n.distance)
        })
    }
}

impl Wind for NearSurfaceWind<'_> {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        let reach = self.known.max(self.blocked);
        // Most places are far from all surfaces: list the others, and sample all at once.
        let low: Vec<(usize, Vec<Near>)> = (0..)
            .zip(places)
            .filter(|(_, place)| self.solids.near(**place, reach).is_some())
            .map(|(i, place)| (i, self.solids.all_near(*place, reach)))
            .collect();
        if low.is_empty() {
            self.field.sample(places, t, out);
            return;
        }
        let mut resolved = places.to_vec();
        low.iter().for_each(|(i, near)| resolved[*i] = self.resolved_place(places[*i], near));
        self.field.sample(&resolved, t, out);
        low.iter().for_each(|(i, near)| out[*i] = self.slowed(out[*i], near));
    }

    fn mean(&self) -> Vec3 {
        self.field.mean()
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.field.mean_at(position)
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        self.field.mean_at_time(position, t)
    }

    fn has_varying_mean(&self) -> bool {
        self.field.has_varying_mean()
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.field.prescribed_mean_at_time(t)
    }

    fn period(&self) -> Option<f64> {
        self.field.period()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::solid::{Form, Prism, Solid};
    use osier_wind::UniformWind;

    /// Over level ground the wind along it follows the logarithmic law, that across it falls linearly to 0, and both
    /// are unchanged above the layer; in a corner it is calm.
    #[test]
    fn wind_vanishes_at_surfaces() {
        let options = FlightParams { min_resolved_height: 0.5, blocking_height: 1.0, ..FlightParams::default() };
        let prism = Prism::block(Vec3::new(9.0, 0.0, 0.0), Vec3::new(1.0, 4.0, 9.0), 0.0);
        let solids = Solids::new(vec![Solid { name: "wall".into(), form: Form::Prism(prism), humidity: 0.5 }], true);
        let places = [2.0, 0.75, 0.1, 0.0].map(|y| Vec3::new(0.0, y, 0.0));
        let mut air = [Vec3::ZERO; 4];
        let wind = UniformWind(Vec3::new(3.0, -1.0, 0.5));
        NearSurfaceWind::new(&wind, &solids, &options).sample(&places, 0.0, &mut air);
        assert_eq!(air[0], wind.0);
        assert!(air[1].distance(Vec3::new(3.0, -0.75, 0.5)) < 1e-6, "{}", air[1]);
        let slow = ln_f32(0.15 / 0.05) / ln_f32(0.55 / 0.05);
        assert!(air[2].distance(Vec3::new(3.0 * slow, -0.1, 0.5 * slow)) < 1e-6, "{}", air[2]);
        assert_eq!(air[3], Vec3::ZERO);
        let mut corner = [Vec3::ZERO];
        let place = [Vec3::new(8.48, 0.02, 0.0)];
        NearSurfaceWind::new(&wind, &solids, &options).sample(&place, 0.0, &mut corner);
        assert!(corner[0].length() < 0.05, "{}", corner[0]);
    }
}
