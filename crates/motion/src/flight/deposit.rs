//! Deposition: swept collision with ground and solids, and what deposits do there (\[catkin\] 4.2.2).

use glam::{DVec3, Vec3};

use super::clusters::CatkinCluster;
use super::particles::{Catkin, CatkinState};
use super::{FlightSimulation, ReleaseCondition};
use osier_base::math::narrow;
use osier_scene::solid::{Near, Solids};
use osier_wind::Wind;

/// Sphere-tracing steps, at most, and the least of them, m.
const MAX_TRACE_STEPS: u32 = 32;
const MIN_TRACE_STEP: f32 = 1e-5;

/// Push-out passes for penetrating balls, at most.
const MAX_PUSH_OUT_PASSES: u32 = 4;

/// Distance that counts as contact, over the radius.
const CONTACT_FACTOR: f32 = 1.05;

/// Surfaces whose normal's y is above this (slopes below 60 degrees) count as ground, others as walls.
const GROUND_NORMAL_Y: f32 = 0.5;

/// Penetration below which nothing is pushed out, m.
const PENETRATION_TOLERANCE: f32 = 1e-6;

/// A sphere and its displacement in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct SweptBall {
    pub from: DVec3,
    pub way: DVec3,
    pub radius: f32,
}

/// Surface that supports a sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfaceContact {
    pub state: CatkinState,
    /// Surface normal; that of the wall in a corner.
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
    /// Moves as far as the sphere is free, and reports the surface that stopped it.
    pub fn sweep(&self, solids: &Solids) -> SweepResult {
        let (gone, met) = self.trace_free_share(solids);
        if met.is_none() {
            return SweepResult { at: self.from + self.way, contact: None };
        }
        let at = push_out_of_solids(solids, self.from + self.way * gone, self.radius);
        SweepResult { at, contact: surface_contact(solids, at, self.radius) }
    }

    /// Free share of the displacement, and the surface that ends it, by sphere tracing.
    pub fn trace_free_share(&self, solids: &Solids) -> (f64, Option<Near>) {
        let length = self.way.length();
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
        if gone >= length { (1.0, None) } else { (gone / length, solids.near(self.from.as_vec3(), reach)) }
    }
}

/// Moves a sphere out of all solids along their normals.
pub(super) fn push_out_of_solids(solids: &Solids, mut at: DVec3, radius: f32) -> DVec3 {
    for _ in 0..MAX_PUSH_OUT_PASSES {
        let Some(near) = deepest_penetration(solids.all_near(at.as_vec3(), radius - PENETRATION_TOLERANCE)) else {
            break;
        };
        at += near.nearest.normal.as_dvec3() * f64::from(radius - near.nearest.distance);
    }
    at
}

/// Whether ground or a top face supports a sphere.
pub(super) fn is_supported(solids: &Solids, at: DVec3, radius: f32) -> bool {
    solids.all_near(at.as_vec3(), radius * CONTACT_FACTOR).iter().any(|n| n.nearest.normal.y > GROUND_NORMAL_Y)
}

/// The ground if penetrated, else the deepest penetration.
fn deepest_penetration(near: Vec<Near>) -> Option<Near> {
    let rank = |n: &Near| (n.nearest.normal.y <= GROUND_NORMAL_Y, n.nearest.distance);
    near.into_iter().min_by(|a, b| {
        let ((a_wall, a_far), (b_wall, b_far)) = (rank(a), rank(b));
        a_wall.cmp(&b_wall).then(a_far.total_cmp(&b_far))
    })
}

/// Surface that a sphere touches, if any.
pub(super) fn surface_contact(solids: &Solids, at: DVec3, radius: f32) -> Option<SurfaceContact> {
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

impl Catkin {
    /// Deposits the catkin if its sweep touched a surface; true if so.
    pub(super) fn land_on(&mut self, landing: &SweepResult) -> bool {
        let Some(hold) = landing.contact else { return false };
        self.rest_on(hold);
        self.v = DVec3::ZERO;
        self.lift = 0.0;
        true
    }

    pub(super) fn rest_on(&mut self, hold: SurfaceContact) {
        self.state = hold.state;
        self.normal = hold.normal;
        self.face = hold.face;
        self.free = false;
        self.moved_since_check = true;
    }
}

impl FlightSimulation {
    /// Sweep of a cluster: the member with the least free share limits all.
    pub(super) fn sweep_cluster(&self, cluster: &CatkinCluster, way: DVec3) -> SweepResult {
        let mut least = 1.0_f64;
        let mut met = false;
        for (id, offset) in cluster.members.iter().zip(&cluster.offsets) {
            let path = SweptBall { from: cluster.x + *offset, way, radius: self.catkin(*id).radius };
            let (gone, near) = path.trace_free_share(&self.solids);
            met |= near.is_some();
            least = least.min(gone);
        }
        let at = cluster.x + way * least;
        if !met {
            return SweepResult { at, contact: None };
        }
        self.resolve_penetration(cluster, at)
    }

    /// Pushes a cluster out of solids until no member penetrates, as far as possible.
    pub(super) fn resolve_penetration(&self, cluster: &CatkinCluster, mut at: DVec3) -> SweepResult {
        for _ in 0..MAX_PUSH_OUT_PASSES {
            let each = cluster.members.iter().zip(&cluster.offsets).filter_map(|(id, offset)| {
                let radius = self.catkin(*id).radius;
                let near = deepest_penetration(
                    self.solids.all_near((at + *offset).as_vec3(), radius - PENETRATION_TOLERANCE),
                )?;
                Some((near.nearest.normal, radius - near.nearest.distance))
            });
            let worst =
                each.max_by(|a, b| (a.0.y > GROUND_NORMAL_Y).cmp(&(b.0.y > GROUND_NORMAL_Y)).then(a.1.total_cmp(&b.1)));
            let Some((normal, deep)) = worst else { break };
            at += normal.as_dvec3() * f64::from(deep);
        }
        let holds: Vec<SurfaceContact> = cluster
            .members
            .iter()
            .zip(&cluster.offsets)
            .filter_map(|(id, offset)| surface_contact(&self.solids, at + *offset, self.catkin(*id).radius))
            .collect();
        SweepResult { at, contact: combined_contact(&holds) }
    }

    /// Slides wall deposits down, the slower the wetter the wall, or up in an updraft; contacts are evaluated anew.
    pub(super) fn slide_down_walls(&mut self, wind: &dyn Wind, t: f64) {
        let sliding =
            if self.present.on_wall { self.leader_ids(|c| c.state == CatkinState::OnWall) } else { Vec::new() };
        if sliding.is_empty() {
            return;
        }
        let places: Vec<Vec3> = sliding.iter().map(|id| self.catkin(*id).x.as_vec3()).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        wind.sample(&places, t, &mut air);
        let dt = self.options.time_step();
        for (id, air) in sliding.into_iter().zip(air) {
            let c = self.catkin(id);
            let fall = self.clusters.get(&id).map_or(c.fall, |k| k.fall);
            // Net vertical velocity, reduced by the humidity, along the wall's steepest direction.
            let speed = (1.0 - self.wall_humidity(c.face)) * (f64::from(air.y) - fall);
            let along = (Vec3::Y - c.normal * c.normal.y).normalize_or(Vec3::Y).as_dvec3();
            self.slide_deposit(id, along * (speed * dt));
        }
    }

    /// Humidity of a solid, 0 to 1; 0 for the ground, which has its own.
    pub(super) fn wall_humidity(&self, face: Option<u32>) -> f64 {
        face.and_then(|i| self.solids.list().get(i as usize)).map_or(0.0, |s| s.humidity)
    }

    /// Moves a deposited single or cluster along its surface; without contact it becomes airborne.
    pub(super) fn slide_deposit(&mut self, root: u32, way: DVec3) {
        if way.length_squared() < 1e-18 {
            return;
        }
        let dt = self.options.time_step();
        if let Some(cluster) = self.clusters.get(&root) {
            let moved = self.sweep_cluster(cluster, way);
            let landing = self.resolve_penetration(cluster, moved.at);
            let mut cluster = cluster.clone();
            cluster.v = (landing.at - cluster.x) / dt;
            cluster.x = landing.at;
            if landing.contact.is_none() {
                cluster.state = CatkinState::Airborne;
            }
            self.clusters.insert(root, cluster);
            self.move_cluster_members(root, &landing);
            return;
        }
        let solids = std::sync::Arc::clone(&self.solids);
        let c = self.catkin_mut(root);
        let (gone, _) = SweptBall { from: c.x, way, radius: c.radius }.trace_free_share(&solids);
        let at = push_out_of_solids(&solids, c.x + way * gone, c.radius);
        c.v = (at - c.x) / dt;
        c.travel += at - c.x;
        c.x = at;
        match surface_contact(&solids, at, c.radius) {
            Some(hold) => c.rest_on(hold),
            None => c.state = CatkinState::Airborne,
        }
    }

    /// Number of deposited catkins that penetrate a surface by more than 0.1 mm.
    pub(super) fn count_penetrations(&self) -> u64 {
        let deep = |c: &Catkin| {
            let near = self.solids.near(c.x.as_vec3(), c.radius);
            c.state.is_deposited() && near.is_some_and(|n| n.nearest.distance < c.radius - 1e-4)
        };
        let never = |c: &Catkin| matches!(c.wait, ReleaseCondition::Until(t) if t.is_infinite());
        self.catkins.iter().filter(|c| deep(c) && !never(c)).count() as u64
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
