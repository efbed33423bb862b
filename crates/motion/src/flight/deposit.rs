//! Deposition: what happens to catkins and clusters at ground and walls (\[catkin\] 4.2.2).

use glam::{DVec3, Vec3};

use super::clusters::CatkinCluster;
use super::collision::{
    SurfaceContact, SweepResult, SweptBall, combined_contact, deepest_penetration, follow_surface, push_out_of_solids,
    surface_contact,
};
use super::particles::{Catkin, CatkinState};
use super::tuning::{GROUND_NORMAL_Y, MAX_PUSH_OUT_PASSES, OVERHANG_NORMAL_Y, PENETRATION_TOLERANCE};
use super::{FlightSimulation, ReleaseCondition};
use osier_scene::solid::{Form, Solid};
use osier_wind::Wind;

impl Catkin {
    /// Deposits the catkin if its sweep touched a surface, and returns whether it did.
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
        self.moved_since_check = true;
    }
}

impl FlightSimulation {
    /// Sweeps all members of a cluster along `way`, m: the member with the smallest free share limits the motion of the cluster.
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

    /// Pushes a cluster out of solids in at most [`MAX_PUSH_OUT_PASSES`] passes, and returns its centre and combined contact.
    pub(super) fn resolve_penetration(&self, cluster: &CatkinCluster, mut at: DVec3) -> SweepResult {
        for _ in 0..MAX_PUSH_OUT_PASSES {
            // Push the cluster out by its worst penetration, ground before walls, and repeat.
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
        // The contacts of all members together say whether the cluster lies on ground, at a wall or in a corner.
        let holds: Vec<SurfaceContact> = cluster
            .members
            .iter()
            .zip(&cluster.offsets)
            .filter_map(|(id, offset)| surface_contact(&self.solids, at + *offset, self.catkin(*id).radius))
            .collect();
        SweepResult { at, contact: combined_contact(&holds) }
    }

    /// Slides deposits on walls down, the slower the wetter the wall, or up in an updraft, and evaluates their contacts again.
    /// Deposits on the underside of an overhang detach.
    pub(super) fn slide_down_walls(&mut self, wind: &dyn Wind, t: f64) {
        // Leaders only: members follow their cluster.
        let sliding =
            if self.present.on_wall { self.leader_ids(|c| c.state == CatkinState::OnWall) } else { Vec::new() };
        if sliding.is_empty() {
            return;
        }
        let places: Vec<Vec3> = sliding.iter().map(|id| self.catkin(*id).x.as_vec3()).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        wind.sample(&places, t, &mut air);
        let dt = self.time_step();
        for (id, air) in sliding.into_iter().zip(air) {
            let c = self.catkin(id);
            let fall = self.clusters.get(&id).map_or(c.fall, |k| k.fall);
            // Slide with the net vertical velocity (updraft minus settling speed), reduced by the humidity, along the steepest
            // direction of the wall; off an overhang straight down.
            let speed = (1.0 - self.face_humidity(c)) * (f64::from(air.y) - fall);
            let steepest = (Vec3::Y - c.normal * c.normal.y).normalize_or(Vec3::Y);
            let along = if c.normal.y < OVERHANG_NORMAL_Y { DVec3::Y } else { steepest.as_dvec3() };
            self.slide_deposit(id, along * (speed * dt));
        }
    }

    /// Humidity, 0 to 1, of the face that supports a catkin: that of the solid, or for a height field of any slope that of the ground.
    pub(super) fn face_humidity(&self, c: &Catkin) -> f64 {
        match c.face.and_then(|i| self.solids.list().get(i as usize)) {
            Some(Solid { form: Form::Prism(_) | Form::Shell(_), humidity, .. }) => *humidity,
            _ => self.options.humidity.at(c.x.as_vec3(), self.options.inside),
        }
    }

    /// Moves a deposited single or cluster by `way`, m, along its surface; one that loses contact becomes airborne.
    pub(super) fn slide_deposit(&mut self, root: u32, way: DVec3) {
        if way.length_squared() < 1e-18 {
            return;
        }
        let dt = self.time_step();
        // A cluster slides as a body; without contact it falls off.
        if let Some(cluster) = self.clusters.get(&root) {
            let moved = self.sweep_cluster(cluster, way);
            let landing = self.resolve_penetration(cluster, moved.at);
            let mut cluster = cluster.clone();
            cluster.v = (landing.at - cluster.x) / dt;
            cluster.x = landing.at;
            if landing.contact.is_none() {
                self.counters.falls += cluster.members.len() as u64;
                cluster.state = CatkinState::Airborne;
                // The flight time of the members continues until the next deposition.
                cluster.members.iter().for_each(|id| self.catkin_mut(*id).rested = -1.0);
            }
            self.clusters.insert(root, cluster);
            self.move_cluster_members(root, &landing);
            return;
        }
        let solids = std::sync::Arc::clone(&self.solids);
        let c = self.catkin_mut(root);
        let (gone, _) = SweptBall { from: c.x, way, radius: c.radius }.trace_free_share(&solids);
        let at = push_out_of_solids(&solids, c.x + way * gone, c.radius);
        // A catkin that detaches from an overhang is not moved back to the surface above it.
        let detaches = c.normal.y < OVERHANG_NORMAL_Y;
        let at = if detaches { at } else { follow_surface(&solids, at, c.radius, way) };
        c.v = (at - c.x) / dt;
        c.travel += at - c.x;
        c.x = at;
        match surface_contact(&solids, at, c.radius) {
            Some(hold) => c.rest_on(hold),
            None => {
                (c.state, c.rested) = (CatkinState::Airborne, -1.0);
                self.counters.falls += 1;
            }
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
