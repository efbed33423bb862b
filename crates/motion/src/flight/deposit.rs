//! Ground and walls: nobody passes them, whoever meets them stays (\[catkin\] 4.2.2).

use glam::{DVec3, Vec3};

use super::clusters::CatkinCluster;
use super::particles::{Catkin, CatkinState};
use super::{FlightSimulation, ReleaseCondition};
use osier_base::math::narrow;
use osier_scene::solid::{Near, Solids};
use osier_wind::Wind;

/// Steps of a search along a way, and the least of them, m.
const MAX_TRACE_STEPS: u32 = 32;
const MIN_TRACE_STEP: f32 = 1e-5;

/// Rounds in which what is too deep is lifted out.
const MAX_PUSH_OUT_PASSES: u32 = 4;

/// What counts as touching, as a factor on the radius.
const CONTACT_FACTOR: f32 = 1.05;

/// Slopes gentler than this hold what falls on them: height of the normal.
const GROUND_NORMAL_Y: f32 = 0.5;

/// What is deeper in something than this is lifted out, m.
const PENETRATION_TOLERANCE: f32 = 1e-6;

/// A ball's way in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct SweptBall {
    pub from: DVec3,
    pub way: DVec3,
    pub radius: f32,
}

/// What a ball lies on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfaceContact {
    pub state: CatkinState,
    /// Of the wall in a corner.
    pub normal: Vec3,
    pub face: Option<u32>,
}

/// Where a way ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct SweepResult {
    pub at: DVec3,
    pub hold: Option<SurfaceContact>,
}

impl SweepResult {
    pub fn touches(&self) -> bool {
        self.hold.is_some()
    }
}

impl SweptBall {
    /// As far as it comes: all the way, or to where it touches something.
    pub fn sweep_cluster(&self, solids: &Solids) -> SweepResult {
        let (gone, met) = self.trace(solids);
        if met.is_none() {
            return SweepResult { at: self.from + self.way, hold: None };
        }
        let at = out_of(solids, self.from + self.way * gone, self.radius);
        SweepResult { at, hold: hold(solids, at, self.radius) }
    }

    /// Share of the way that is free, and what ends it.
    pub fn trace(&self, solids: &Solids) -> (f64, Option<Near>) {
        let length = self.way.length();
        let reach = self.radius + narrow(length) + MIN_TRACE_STEP;
        let Some(first) = solids.near(self.from.as_vec3(), reach) else { return (1.0, None) };
        if first.nearest.distance < self.radius - 1e-4 {
            return (0.0, Some(first));
        }
        let direction = (self.way / length.max(1e-12)).as_vec3();
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
            // Along a face or away from it the ball may go on; what it then meets is found at the next place.
            let step = if closing { gap } else { gap.max(0.25 * self.radius) };
            gone += f64::from(step.max(MIN_TRACE_STEP).min(left));
        }
        if gone >= length { (1.0, None) } else { (gone / length, solids.near(self.from.as_vec3(), reach)) }
    }
}

/// A ball lifted out of all that it is in.
pub(super) fn out_of(solids: &Solids, mut at: DVec3, radius: f32) -> DVec3 {
    for _ in 0..MAX_PUSH_OUT_PASSES {
        let Some(near) = deepest(solids.all_near(at.as_vec3(), radius - PENETRATION_TOLERANCE)) else { break };
        at += near.nearest.normal.as_dvec3() * f64::from(radius - near.nearest.distance);
    }
    at
}

/// Whether ground, or the top of something, bears a ball.
pub(super) fn borne(solids: &Solids, at: DVec3, radius: f32) -> bool {
    solids.all_near(at.as_vec3(), radius * CONTACT_FACTOR).iter().any(|n| n.nearest.normal.y > GROUND_NORMAL_Y)
}

/// The ground first, then whatever is deepest.
fn deepest(near: Vec<Near>) -> Option<Near> {
    let rank = |n: &Near| (n.nearest.normal.y <= GROUND_NORMAL_Y, n.nearest.distance);
    near.into_iter().min_by(|a, b| {
        let ((a_wall, a_far), (b_wall, b_far)) = (rank(a), rank(b));
        a_wall.cmp(&b_wall).then(a_far.total_cmp(&b_far))
    })
}

/// What a ball lies on, if it touches anything.
pub(super) fn hold(solids: &Solids, at: DVec3, radius: f32) -> Option<SurfaceContact> {
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
    /// Takes up what it came upon; true if it came to rest by it.
    pub(super) fn land_on(&mut self, landing: &SweepResult) -> bool {
        let Some(hold) = landing.hold else { return false };
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
    /// A cluster's way: the member that comes least far decides for all.
    pub(super) fn sweep_cluster(&self, cluster: &CatkinCluster, way: DVec3) -> SweepResult {
        let mut least = 1.0_f64;
        let mut met = false;
        for (id, offset) in cluster.members.iter().zip(&cluster.offsets) {
            let path = SweptBall { from: cluster.x + *offset, way, radius: self.catkin(*id).radius };
            let (gone, near) = path.trace(&self.solids);
            met |= near.is_some();
            least = least.min(gone);
        }
        let at = cluster.x + way * least;
        if !met {
            return SweepResult { at, hold: None };
        }
        self.resolve_penetration(cluster, at)
    }

    /// A cluster that lies where none of its members is in anything, as far as can be.
    pub(super) fn resolve_penetration(&self, cluster: &CatkinCluster, mut at: DVec3) -> SweepResult {
        for _ in 0..MAX_PUSH_OUT_PASSES {
            let each = cluster.members.iter().zip(&cluster.offsets).filter_map(|(id, offset)| {
                let radius = self.catkin(*id).radius;
                let near = deepest(self.solids.all_near((at + *offset).as_vec3(), radius - PENETRATION_TOLERANCE))?;
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
            .filter_map(|(id, offset)| hold(&self.solids, at + *offset, self.catkin(*id).radius))
            .collect();
        SweepResult { at, hold: joint(&holds) }
    }

    /// What is at a wall slides down it, the slower the wetter the wall, and up if the air does; [`SurfaceContact`] is found anew.
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
            let speed = (1.0 - self.wall_humidity(c.face)) * (f64::from(air.y) - fall);
            let along = (Vec3::Y - c.normal * c.normal.y).normalize_or(Vec3::Y).as_dvec3();
            self.slide(id, along * (speed * dt));
        }
    }

    /// How wet a solid is; the ground's own counts for none.
    pub(super) fn wall_humidity(&self, face: Option<u32>) -> f64 {
        face.and_then(|i| self.solids.list().get(i as usize)).map_or(0.0, |s| s.humidity)
    }

    /// Moves a resting single or cluster along what it lies on; it may slide off and be in the air again.
    pub(super) fn slide(&mut self, root: u32, way: DVec3) {
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
            if landing.hold.is_none() {
                cluster.state = CatkinState::Airborne;
            }
            self.clusters.insert(root, cluster);
            self.place(root, &landing);
            return;
        }
        let solids = std::sync::Arc::clone(&self.solids);
        let c = self.catkin_mut(root);
        let (gone, _) = SweptBall { from: c.x, way, radius: c.radius }.trace(&solids);
        let at = out_of(&solids, c.x + way * gone, c.radius);
        c.v = (at - c.x) / dt;
        c.travel += at - c.x;
        c.x = at;
        match hold(&solids, at, c.radius) {
            Some(hold) => c.rest_on(hold),
            None => c.state = CatkinState::Airborne,
        }
    }

    /// Singles and clusters that are deeper in anything than 0.1 mm: of all that rests, how many.
    pub(super) fn count_penetrations(&self) -> u64 {
        let deep = |c: &Catkin| {
            let near = self.solids.near(c.x.as_vec3(), c.radius);
            c.state.is_deposited() && near.is_some_and(|n| n.nearest.distance < c.radius - 1e-4)
        };
        let never = |c: &Catkin| matches!(c.wait, ReleaseCondition::Until(t) if t.is_infinite());
        self.catkins.iter().filter(|c| deep(c) && !never(c)).count() as u64
    }
}

/// What many lie on together: a corner if some lie on the ground and some at a wall.
pub(super) fn joint(holds: &[SurfaceContact]) -> Option<SurfaceContact> {
    let first = |state: CatkinState| holds.iter().find(|h| h.state == state);
    if let Some(corner) = first(CatkinState::Corner) {
        return Some(*corner);
    }
    match (first(CatkinState::Grounded), first(CatkinState::OnWall)) {
        (Some(_), Some(wall)) => Some(SurfaceContact { state: CatkinState::Corner, ..*wall }),
        (ground, wall) => ground.or(wall).copied(),
    }
}
