//! Attraction of singles to deposited clusters (\[catkin\] 4.3, eq. 14).
//!
//! The paper moves a single by its distance d times F = e^(-gamma d^2) every 0.3 s. Here F is fixed at such ticks, and
//! the motion between them is uniform in the logarithm: x += (1 - (1 - F)^(dt / T)) (target - x). At the ticks the positions
//! agree with the paper's for any time step; if F were evaluated in every step, the result would depend on the step.

use glam::{DVec3, Vec3};

use super::collision::{SweptBall, follow_surface, push_out_of_solids, surface_contact};
use super::particles::{Catkin, CatkinState, NO_TARGET};
use super::{CATKINS_PER_TASK, FlightSimulation};
use crate::flight::tuning::{ATTRACTION_TICK, MAX_JOIN_PUSH_OUT_ROUNDS, SAME_TIME};
use osier_base::math::{exp, ln, narrow};
use osier_base::neighbours::NeighbourGrid;
use osier_base::par::par_map;

/// Whether a member of a cluster attracts a single: if both are on the ground or at the same wall, or if the single is in the air
/// and the member in a corner.
fn attracts(single: &Catkin, member: &Catkin) -> bool {
    use CatkinState::{Airborne, Corner, Grounded, OnWall};
    match (single.state, member.state) {
        (Grounded | Corner, Grounded | Corner) | (Airborne, Corner) => true,
        (OnWall | Corner, OnWall | Corner) => single.face == member.face && single.normal.dot(member.normal) > 0.99,
        _ => false,
    }
}

/// Displacement projected onto the surface that the single rests on; unchanged in the air.
fn project_onto_surface(single: &Catkin, way: DVec3) -> DVec3 {
    let normal = match single.state {
        CatkinState::Grounded | CatkinState::OnWall => single.normal,
        // In a corner `normal` is that of the wall.
        CatkinState::Corner => Vec3::Y,
        _ => return way,
    }
    .as_dvec3();
    way - normal * way.dot(normal)
}

impl FlightSimulation {
    /// Moves attracted singles over this step, subdivided at the ticks in it.
    pub(super) fn attract_singles(&mut self, t: f64) {
        // Split the step at ticks: targets are constant in between.
        let (tick, end) = (ATTRACTION_TICK, t + self.time_step());
        let mut now = t;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ticks of a clip")]
        let mut next = ((t - SAME_TIME) / tick).ceil().max(0.0) as u64;
        while next as f64 * tick < end - SAME_TIME {
            let at = next as f64 * tick;
            if at > now + SAME_TIME {
                self.move_attracted(at - now, at);
                now = at;
            }
            self.choose_targets();
            next += 1;
        }
        self.move_attracted(end - now, end);
    }

    /// Chooses for every single the nearest attracting member, and the strength ln(1 - F) of the attraction, for one tick.
    fn choose_targets(&mut self) {
        // Candidates are the members of deposited clusters; without any, and without targets to clear, nothing
        // changes.
        let reach = self.options.attraction_radius();
        let members = self.clusters.values().filter(|c| c.state.is_deposited()).flat_map(|c| &c.members);
        let grid = NeighbourGrid::new(narrow(reach), members.map(|id| (*id, self.catkin(*id).x.as_vec3())));
        // Airborne singles are attracted to corners only; without a corner they need no search.
        let corners = self.clusters.values().any(|c| c.state == CatkinState::Corner);
        let gamma = self.options.gamma;
        if grid.is_empty() && !self.any_attracted {
            return;
        }
        let chunks: Vec<&[Catkin]> = self.catkins.chunks(CATKINS_PER_TASK).collect();
        let chosen: Vec<Vec<(u32, f64)>> = par_map(&chunks, |chunk| {
            let one = |c: &Catkin| {
                let may = c.state.is_deposited() || (corners && c.state == CatkinState::Airborne);
                if grid.is_empty() || !may || c.clustered {
                    return (NO_TARGET, 0.0);
                }
                self.nearest_attractor(c, &grid, reach).map_or((NO_TARGET, 0.0), |(square, id)| {
                    // ln(1 - F)
                    (id, ln(-osier_base::math::exp_m1(-gamma * square)))
                })
            };
            chunk.iter().map(one).collect()
        });
        self.any_attracted = false;
        for (c, (target, pull)) in self.catkins.iter_mut().zip(chosen.into_iter().flatten()) {
            (c.target, c.pull) = (target, pull);
            self.any_attracted |= target != NO_TARGET;
        }
    }

    /// The nearest cluster member that attracts the catkin `c`, with the square of its distance, m^2; of equally near ones the
    /// one of the lowest index.
    fn nearest_attractor(&self, c: &Catkin, grid: &NeighbourGrid, reach: f64) -> Option<(f64, u32)> {
        // Search the cells within reach, across periodic sides too; ties in distance go to the lower index, so that the result is
        // unique. Members of a cluster may lie a little beyond a side.
        let (at, arm) = (c.x.as_vec3(), narrow(reach));
        let mut best: Option<(f64, u32)> = None;
        for at in self.image_shifts(at, 2.0 * arm).map(|shift| at + shift) {
            grid.for_each_in_box(at - Vec3::splat(arm), at + Vec3::splat(arm), |id| {
                let member = self.catkin(id);
                let square = self.nearest_image(member.x - c.x).length_squared();
                let nearer = best.is_none_or(|(d, i)| (square, id) < (d, i));
                if square <= reach * reach && nearer && attracts(c, member) {
                    best = Some((square, id));
                }
            });
        }
        best
    }

    /// Moves attracted singles for `dt` seconds up to time `t`, s, and joins those that come close enough to their target.
    fn move_attracted(&mut self, dt: f64, t: f64) {
        let drawn = if self.any_attracted { self.leader_ids(|c| c.target != NO_TARGET) } else { Vec::new() };
        if dt <= SAME_TIME || drawn.is_empty() {
            return;
        }
        let moved: Vec<Option<DVec3>> = par_map(&drawn, |id| {
            let c = self.catkin(*id);
            let target = self.catkin(c.target);
            if !attracts(c, target) {
                return None;
            }
            // 1 - (1 - F)^(dt/T), with pull = ln(1 - F).
            let share = 1.0 - exp(c.pull * dt / ATTRACTION_TICK);
            let way = project_onto_surface(c, self.nearest_image(target.x - c.x) * share);
            // Solids stop the motion; a single that still overlaps one is pushed out.
            let (gone, _) = SweptBall { from: c.x, way, radius: c.radius }.trace_free_share(&self.solids);
            let at = push_out_of_solids(&self.solids, c.x + way * gone, c.radius);
            // A deposit follows a surface that curves away below it.
            let loses_contact = c.state.is_deposited() && surface_contact(&self.solids, at, c.radius).is_none();
            Some(if loses_contact { follow_surface(&self.solids, at, c.radius, way) } else { at })
        });
        for (id, at) in drawn.into_iter().zip(moved) {
            let step = self.time_step();
            let solids = std::sync::Arc::clone(&self.solids);
            let c = self.catkin_mut(id);
            // The target moved or changed its state: choose another at the next tick.
            let Some(at) = at else {
                c.target = NO_TARGET;
                continue;
            };
            c.travel += at - c.x;
            if c.state.is_deposited() {
                c.v = (at - c.x) / step;
                if let Some(hold) = surface_contact(&solids, at, c.radius) {
                    c.rest_on(hold);
                }
            }
            c.x = at;
            let (target, radius) = (c.target, f64::from(c.radius));
            let other = self.catkin(target);
            // Close enough to touch: the single becomes a member.
            let apart = self.nearest_image(other.x - at).length();
            if apart <= self.options.stick_close * (radius + f64::from(other.radius)) {
                self.join_heap(id, target, t);
            }
        }
    }

    /// Joins a single to a cluster, at a position where it overlaps no member.
    fn join_heap(&mut self, id: u32, target: u32, t: f64) {
        let root = self.catkin(target).root;
        let (mut at, radius) = (self.catkin(id).x, self.catkin(id).radius);
        // Only members within a few radii can overlap.
        let near = |m: &&u32| self.nearest_image(self.catkin(**m).x - at).length() < 8.0 * f64::from(radius);
        let members: Vec<u32> =
            self.clusters.get(&root).iter().flat_map(|c| &c.members).filter(near).copied().collect();
        for _ in 0..MAX_JOIN_PUSH_OUT_ROUNDS {
            for other in members.iter().map(|m| self.catkin(*m)) {
                let way = self.nearest_image(at - other.x);
                let least = self.options.stick_close * f64::from(radius + other.radius);
                let far = way.length();
                if far < least {
                    at += way.try_normalize().unwrap_or(DVec3::Y) * (least - far);
                }
            }
            at = push_out_of_solids(&self.solids, at, radius);
        }
        self.catkin_mut(id).x = at;
        self.join_catkins(id, target, t);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{CatkinStart, FlightParams, ReleaseCondition};
    use super::*;
    use osier_scene::solid::{Form, LandForm, Solid, Solids};
    use osier_wind::UniformWind;

    /// Deposits at these positions, of which the first two are a cluster and the others singles, on surfaces that are wet.
    fn deposited(solids: Solids, places: &[DVec3]) -> FlightSimulation {
        let options = FlightParams {
            humidity: super::super::GroundHumidity::Even(1.0),
            scales: [1.0, 1.0],
            fall_spread: 0.0,
            ..FlightParams::default()
        };
        let starts: Vec<CatkinStart> =
            places.iter().map(|at| CatkinStart { at: *at, wait: ReleaseCondition::Until(0.0) }).collect();
        let mut flights = FlightSimulation::new(options, Arc::new(solids), &starts);
        let solids = Arc::clone(&flights.solids);
        for c in &mut flights.catkins {
            c.rest_on(surface_contact(&solids, c.x, c.radius).expect("a surface"));
        }
        flights.join_catkins(0, 1, 0.0);
        flights
    }

    #[test]
    fn an_attracted_deposit_stays_on_a_slope() {
        // The ground falls by three in ten along +X; the single lies above the pair.
        let heights = (0..3).flat_map(|_| [1.2, 0.0, -1.2]).collect();
        let land = LandForm::new(3, 8.0, heights).expect("a land");
        let slope = Solid { name: "slope".into(), form: Form::Land(Arc::new(land)), humidity: 1.0 };
        let radius = f64::from(FlightParams::default().kinds[0].radius);
        let up = DVec3::new(0.3, 1.0, 0.0).normalize();
        let on_slope = |x: f64| DVec3::new(x, -0.3 * x, 0.0) + up * radius;
        let mut flights = deposited(Solids::new(vec![slope], false), &[1.0, 1.03, 0.4].map(on_slope));
        let apart = |flights: &FlightSimulation| flights.catkin(2).x.distance(flights.catkin(0).x);
        let before = apart(&flights);
        for _ in 0..24 {
            flights.advance(&UniformWind(Vec3::ZERO));
            let c = flights.catkin(2);
            let near = flights.solids.near(c.x.as_vec3(), 1.0).expect("the slope");
            assert!((near.nearest.distance - c.radius).abs() < 0.06 * c.radius, "{} at {}", near.nearest.distance, c.x);
        }
        assert!(apart(&flights) < 0.6 * before, "{} of {before}", apart(&flights));
    }

    /// A pair on the ground at `x` and a single 0.8 m away, across a periodic side if that lies between them; after five ticks it is where
    /// the paper's steps have it.
    fn after_five_ticks(fps: f64, x: f64) -> f64 {
        let options = FlightParams {
            fps,
            edges: [super::super::SideBoundary::Periodic; 2],
            humidity: super::super::GroundHumidity::Even(1.0),
            scales: [1.0, 1.0],
            fall_spread: 0.0,
            ..FlightParams::default()
        };
        let radius = options.kinds[0].radius;
        let wrapped = |x: f64| if x > 17.5 { x - 35.0 } else { x };
        let places = [x, x + 0.03, x + 0.83].map(|x| DVec3::new(wrapped(x), f64::from(radius), 0.0));
        let starts = places.map(|at| CatkinStart { at, wait: ReleaseCondition::Until(0.0) });
        let mut flights = FlightSimulation::new(options, Arc::new(Solids::new(Vec::new(), true)), &starts);
        for c in &mut flights.catkins {
            c.state = CatkinState::Grounded;
            c.moved_since_check = true;
        }
        flights.join_catkins(0, 1, 0.0);
        let still = UniformWind(Vec3::ZERO);
        while flights.seconds() < 1.5 - SAME_TIME {
            flights.advance(&still);
        }
        flights.nearest_image(flights.catkin(2).x - flights.catkin(1).x).x
    }

    #[test]
    fn attraction_is_independent_of_the_step() {
        // d <- d (1 - e^(-gamma d^2)), five times.
        let paper = (0..5).fold(0.8, |d: f64, _| d * (1.0 - exp(-4.605 * d * d)));
        assert!((paper - 0.3879).abs() < 1e-4, "{paper}");
        for fps in [1.0 / 0.3, 10.0, 24.0, 60.0] {
            for x in [0.0, 16.9] {
                let left = after_five_ticks(fps, x);
                assert!((left - paper).abs() < 1e-4, "{left} at {fps} frames a second from {x}");
            }
        }
    }

    /// A heap attracts a single across a periodic side; it stays, and the single joins it there, as far from its release as it moved.
    #[test]
    fn a_single_joins_a_heap_across_a_periodic_side() {
        let radius = f64::from(FlightParams::default().kinds[0].radius);
        let places = [17.45, 17.48, -17.4].map(|x| DVec3::new(x, radius, 0.0));
        let mut flights = deposited(Solids::new(Vec::new(), true), &places);
        flights.options.edges = [super::super::SideBoundary::Periodic; 2];
        (0..24).for_each(|_| flights.advance(&UniformWind(Vec3::ZERO)));
        let at = [0, 1, 2].map(|id| flights.catkin(id).x.x);
        assert_eq!(flights.catkin(2).root, 0, "{at:?}");
        assert!(at.iter().all(|x| (17.4..17.6).contains(x)), "{at:?}");
        assert!((0..3).all(|id| flights.catkin(id).flight_distance() < 0.15));
    }
}
