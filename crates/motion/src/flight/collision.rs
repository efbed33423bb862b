//! Collision of spheres with ground and solids: sweeps, push-out and contact surfaces.

use glam::{DVec3, Vec3};

use super::particles::CatkinState;
use super::tuning::{
    CONTACT_FACTOR, GROUND_NORMAL_Y, MAX_PUSH_OUT_PASSES, MAX_TRACE_STEPS, MIN_TRACE_STEP, PENETRATION_TOLERANCE,
};
use osier_base::math::narrow;
use osier_scene::solid::{Near, Solids};

/// A sphere of `radius`, m, that moves from `from` by `way`, m, in one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct SweptBall {
    pub from: DVec3,
    pub way: DVec3,
    pub radius: f32,
}

/// Surface that supports a sphere. `face`: index of the solid, `None` for the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfaceContact {
    pub state: CatkinState,
    /// Surface normal, world space; in a corner that of the wall.
    pub normal: Vec3,
    pub face: Option<u32>,
}

/// End of a sweep: position, m, and the surface touched, if any.
#[derive(Debug, Clone, Copy)]
pub(super) struct SweepResult {
    pub at: DVec3,
    pub contact: Option<SurfaceContact>,
}

impl SweepResult {
    pub fn touches(&self) -> bool {
        self.contact.is_some()
    }
}

impl SweptBall {
    /// Moves the sphere up to the first contact, and returns the end of its path and the surface that stopped it.
    pub fn sweep(&self, solids: &Solids) -> SweepResult {
        // Without contact the whole displacement is free; otherwise push the sphere out of the solids at the contact and classify
        // the surface there.
        let (gone, met) = self.trace_free_share(solids);
        if met.is_none() {
            return SweepResult { at: self.from + self.way, contact: None };
        }
        let at = push_out_of_solids(solids, self.from + self.way * gone, self.radius);
        SweepResult { at, contact: surface_contact(solids, at, self.radius) }
    }

    /// Share of the displacement, 0 to 1, up to the first contact, and the surface there, by sphere tracing.
    pub fn trace_free_share(&self, solids: &Solids) -> (f64, Option<Near>) {
        let length = self.way.length();
        // One query over the whole path first: most paths meet nothing.
        let reach = self.radius + narrow(length) + MIN_TRACE_STEP;
        let Some(first) = solids.near(self.from.as_vec3(), reach) else { return (1.0, None) };
        if first.nearest.distance < self.radius - 1e-4 {
            return (0.0, Some(first));
        }
        let direction = (self.way / length.max(1e-12)).as_vec3();
        // Sphere tracing: the gap to the nearest surface is a safe step.
        let mut gone = 0.0_f64;
        for _ in 0..MAX_TRACE_STEPS {
            let left = narrow(length - gone);
            if left <= 0.0 {
                break;
            }
            let place = self.from + self.way * (gone / length);
            let Some(near) = solids.near(place.as_vec3(), self.radius + left + MIN_TRACE_STEP) else {
                return (1.0, None);
            };
            let gap = near.nearest.distance - self.radius;
            let closing = direction.dot(near.nearest.normal) < -1e-4;
            if gap <= MIN_TRACE_STEP && closing {
                return (gone / length, Some(near));
            }
            // Tangential or receding motion may continue; contacts on the way are found at the next position.
            let step = if closing { gap } else { gap.max(0.25 * self.radius) };
            gone += f64::from(step.max(MIN_TRACE_STEP).min(left));
        }
        if gone >= length {
            return (1.0, None);
        }
        // If the limit of steps is reached, the path ends at the present position, in contact with the nearest surface.
        let reached = self.from + self.way * (gone / length);
        (gone / length, solids.near(reached.as_vec3(), reach))
    }
}

/// Moves a sphere out of all solids along their normals.
pub(super) fn push_out_of_solids(solids: &Solids, mut at: DVec3, radius: f32) -> DVec3 {
    // Push out of the deepest penetration, ground before walls; each pass may cause another penetration.
    for _ in 0..MAX_PUSH_OUT_PASSES {
        let Some(near) = deepest_penetration(solids.all_near(at.as_vec3(), radius - PENETRATION_TOLERANCE)) else {
            break;
        };
        at += near.nearest.normal.as_dvec3() * f64::from(radius - near.nearest.distance);
    }
    at
}

/// Brings a sphere that slid by `way`, m, back to a surface that curved away below it by no more than it slid.
pub(super) fn follow_surface(solids: &Solids, at: DVec3, radius: f32, way: DVec3) -> DVec3 {
    // Without this, a catkin that slides over an edge would take off and land in every step.
    let near = solids.near(at.as_vec3(), radius + narrow(way.length()));
    let gap = near.map_or(0.0, |n| n.nearest.distance - radius);
    near.map_or(at, |n| at - n.nearest.normal.as_dvec3() * f64::from(gap.max(0.0)))
}

/// Whether ground or a top face supports a sphere.
pub(super) fn is_supported(solids: &Solids, at: DVec3, radius: f32) -> bool {
    solids.all_near(at.as_vec3(), radius * CONTACT_FACTOR).iter().any(|n| n.nearest.normal.y > GROUND_NORMAL_Y)
}

/// The ground if the sphere penetrates it, else the surface with the deepest penetration; `None` for an empty list.
pub(super) fn deepest_penetration(near: Vec<Near>) -> Option<Near> {
    // Ground before walls, then the smallest signed distance.
    let rank = |n: &Near| (n.nearest.normal.y <= GROUND_NORMAL_Y, n.nearest.distance);
    near.into_iter().min_by(|a, b| {
        let ((a_wall, a_far), (b_wall, b_far)) = (rank(a), rank(b));
        a_wall.cmp(&b_wall).then(a_far.total_cmp(&b_far))
    })
}

/// Ground, wall or corner within [`CONTACT_FACTOR`] radii of a sphere's centre; `None` if there is no surface.
pub(super) fn surface_contact(solids: &Solids, at: DVec3, radius: f32) -> Option<SurfaceContact> {
    // Classify all surfaces in contact: ground, wall, or both.
    let near = solids.all_near(at.as_vec3(), radius * CONTACT_FACTOR);
    let ground = near.iter().find(|n| n.nearest.normal.y > GROUND_NORMAL_Y);
    let wall = near.iter().find(|n| n.nearest.normal.y <= GROUND_NORMAL_Y);
    match (ground, wall) {
        (None, None) => None,
        (Some(g), None) => {
            Some(SurfaceContact { state: CatkinState::Grounded, normal: g.nearest.normal, face: g.which })
        }
        (None, Some(w)) => Some(SurfaceContact { state: CatkinState::OnWall, normal: w.nearest.normal, face: w.which }),
        (Some(_), Some(w)) => {
            Some(SurfaceContact { state: CatkinState::Corner, normal: w.nearest.normal, face: w.which })
        }
    }
}

/// Contact of a cluster: a corner if members touch both ground and wall.
pub(super) fn combined_contact(holds: &[SurfaceContact]) -> Option<SurfaceContact> {
    let first = |state: CatkinState| holds.iter().find(|h| h.state == state);
    if let Some(corner) = first(CatkinState::Corner) {
        return Some(*corner);
    }
    match (first(CatkinState::Grounded), first(CatkinState::OnWall)) {
        (Some(_), Some(wall)) => Some(SurfaceContact { state: CatkinState::Corner, ..*wall }),
        (ground, wall) => ground.or(wall).copied(),
    }
}
