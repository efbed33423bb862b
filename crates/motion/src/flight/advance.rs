//! Integration of catkins in the air: \[catkin\] eq. 10 with inertia.

use glam::{DVec3, Vec3};

use super::clusters::CatkinCluster;
use super::collision::{SweepResult, SweptBall};
use super::particles::{Catkin, CatkinState, VelocityDecay};
use super::present_states::PresentStates;
use super::release::WindRelease;
use super::{CATKINS_PER_TASK, FlightSimulation, ReleaseCondition};
use crate::flight::tuning::{CLUSTER_SPIN_TIME, CLUSTERS_PER_TASK, MAX_CLUSTER_SPIN, MAX_WIND_SAMPLES};
use osier_base::math::narrow;
use osier_wind::Wind;

/// Velocity, m/s, towards which a body at a point relaxes: wind plus updraft, minus settling speed, plus glide along the
/// horizontal part of the tuft's axis.
fn carrying_velocity(air: Vec3, tuft: Vec3, fall: f64, glide: f64, lift: f64) -> DVec3 {
    // Only the horizontal part of the tuft's axis makes it glide.
    let level = Vec3::new(tuft.x, 0.0, tuft.z).as_dvec3();
    air.as_dvec3() + DVec3::Y * (lift - fall) + level * (glide * fall)
}

/// Steady velocity, m/s, of the air relative to a body that does not glide, in a wind of constant `acceleration`, m/s^2: the body
/// lags behind the air by its time constant `tau`, s.
fn lasting_flow(acceleration: Vec3, tau: f64, fall: f64, lift: f64) -> Vec3 {
    (acceleration.as_dvec3() * tau + DVec3::Y * (fall - lift)).as_vec3()
}

/// Exact relaxation of one body towards a carrying velocity over half a step and over a whole one. `tau`: time constant, s.
#[derive(Debug, Clone, Copy)]
struct MidpointStep {
    lag: VelocityDecay,
    tau: f64,
    dt: f64,
}

impl MidpointStep {
    fn half_step(self, x: DVec3, v: DVec3, u: DVec3) -> DVec3 {
        // Integral of u + (v - u) exp(-t/tau) over half a step.
        x + u * (self.dt / 2.0) + (v - u) * (self.tau * (1.0 - self.lag.half))
    }

    /// Displacement, m, and new velocity, m/s.
    fn full_step(self, v: DVec3, u: DVec3) -> (DVec3, DVec3) {
        // Integral of u + (v - u) exp(-t/tau) over the step, and its value at the end.
        (u * self.dt + (v - u) * (self.tau * (1.0 - self.lag.whole)), u + (v - u) * self.lag.whole)
    }
}

/// Buffers for sampling the wind at members of a cluster, reused by all clusters of a task.
#[derive(Debug, Default)]
struct WindProbe {
    /// Indices into the cluster's members.
    which: Vec<usize>,
    places: Vec<Vec3>,
    air: Vec<Vec3>,
}

impl WindProbe {
    /// Samples the wind at time `t`, s, at the chosen members of a cluster whose centre is at `middle`, m.
    fn sample(&mut self, cluster: &CatkinCluster, middle: DVec3, wind: &dyn Wind, t: f64) {
        self.places.clear();
        self.places.extend(self.which.iter().map(|i| (middle + cluster.offsets[*i]).as_vec3()));
        self.air.resize(self.places.len(), Vec3::ZERO);
        wind.sample(&self.places, t, &mut self.air);
    }
}

impl FlightSimulation {
    /// Releases pending catkins by time or by the wind at them (see [`WindRelease::releases`]); `t`: beginning of the step, s.
    pub(super) fn release_pending(&mut self, wind: &dyn Wind, t: f64) {
        if !self.present.pending {
            return;
        }
        let leaving = WindRelease { rate: self.options.release_rate, speed: self.options.release_speed };
        let dt = self.time_step();
        // The wind is sampled only at ripe catkins that wait for it; releases by time need none.
        let due = |c: &Catkin| match c.wait {
            ReleaseCondition::Until(when) => t >= when,
            ReleaseCondition::Wind { ripe, .. } => t + dt > ripe,
        };
        let mut pending: Vec<&mut Catkin> =
            self.catkins.iter_mut().filter(|c| c.state == CatkinState::Pending && due(c)).collect();
        let places: Vec<Vec3> = pending.iter().map(|c| c.x.as_vec3()).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        if pending.iter().any(|c| matches!(c.wait, ReleaseCondition::Wind { .. })) {
            wind.sample(&places, t, &mut air);
        }
        for (c, air) in pending.iter_mut().zip(air) {
            if leaving.releases(&mut c.wait, air, t, dt) {
                (c.state, c.free) = (CatkinState::Airborne, true);
                c.since = t;
            }
        }
    }

    /// Advances airborne singles and deposits those that touch a surface.
    pub(super) fn advance_singles(&mut self, wind: &dyn Wind, t: f64) {
        let dt = self.time_step();
        let (options, solids) = (&self.options, &*self.solids);
        let mut chunks: Vec<&mut [Catkin]> = self.catkins.chunks_mut(CATKINS_PER_TASK).collect();
        let landed = osier_base::par::par_map_mut(&mut chunks, |chunk| {
            // Members of clusters move with their cluster, in `advance_clusters`.
            let flying = |c: &Catkin| c.state == CatkinState::Airborne && !c.clustered;
            let mut those: Vec<&mut Catkin> = chunk.iter_mut().filter(|c| flying(c)).collect();
            let mut places: Vec<Vec3> = those.iter().map(|c| c.x.as_vec3()).collect();
            let mut air = vec![Vec3::ZERO; places.len()];
            let step = |c: &Catkin| MidpointStep { lag: c.lag, tau: options.relaxation_time(c.fall), dt };
            let pull =
                |c: &Catkin, air: Vec3, t: f64| carrying_velocity(air, c.tuft(), c.fall, options.glide, c.lift_at(t));
            // Midpoint rule with exact relaxation: half a step with the wind here, then a whole step with the wind there.
            // The difference v - u to the carrying velocity u decays as exp(-dt / tau), tau = settling speed / g.
            wind.sample(&places, t, &mut air);
            let mut middle_air = vec![Vec3::ZERO; air.len()];
            for ((c, place), air) in those.iter().zip(&mut places).zip(&air) {
                *place = step(c).half_step(c.x, c.v, pull(c, *air, t)).as_vec3();
            }
            wind.sample(&places, t + dt / 2.0, &mut middle_air);
            let (mut landed, mut escaped) = (Vec::new(), Vec::new());
            for (c, (before, air)) in those.iter_mut().zip(air.iter().zip(&middle_air)) {
                let (way, v) = step(c).full_step(c.v, pull(c, *air, t + dt / 2.0));
                // Sweep the ball along its displacement: the first contact ends the flight.
                let path = SweptBall { from: c.x, way, radius: c.radius };
                // At the start of a flight the relative wind is that at the catkin's position, not the value left by an earlier flight.
                if std::mem::take(&mut c.begins_flight) {
                    c.flow = *before - c.v.as_vec3();
                }
                // Acceleration of the wind along the path, for tumbling: the wind is assumed to change linearly over the step.
                let acceleration = (*air - *before) * (2.0 / narrow(dt));
                c.lasting_flow =
                    lasting_flow(acceleration, options.relaxation_time(c.fall), c.fall, c.lift_at(t + dt / 2.0));
                let landing = path.sweep(solids);
                c.travel += landing.at - c.x;
                (c.x, c.v) = (landing.at, v);
                // A catkin whose path ends on a surface beyond an open side has left the box before it lands.
                if !options.is_past_an_open_side(c.x) && c.land_on(&landing) {
                    landed.extend(c.resting_place());
                }
                if options.is_outside(c.x) {
                    escaped.push(c.id);
                }
            }
            (landed, PresentStates::of_catkins(chunk), escaped)
        });
        // Join the results of all tasks in the order of tasks, not of threads.
        self.present = landed.iter().fold(PresentStates::default(), |present, l| present.union(l.1));
        self.escaped = landed.iter().flat_map(|l| l.2.iter().copied()).collect();
        self.record_landings(landed.into_iter().flat_map(|l| l.0));
    }

    /// Advances airborne clusters by one step, each as one rigid body, and deposits those that touch a surface.
    pub(super) fn advance_clusters(&mut self, wind: &dyn Wind, t: f64) {
        // Clusters are taken out while tasks read the catkins, then put back.
        let mut clusters = std::mem::take(&mut self.clusters);
        let mut flying: Vec<&mut CatkinCluster> =
            clusters.values_mut().filter(|c| c.state == CatkinState::Airborne).collect();
        let mut chunks: Vec<&mut [&mut CatkinCluster]> = flying.chunks_mut(CLUSTERS_PER_TASK).collect();
        let landings = osier_base::par::par_map_mut(&mut chunks, |chunk| {
            let mut probe = WindProbe::default();
            chunk.iter_mut().map(|cluster| self.advance_cluster(cluster, &mut probe, wind, t)).collect::<Vec<_>>()
        });
        for (cluster, swept) in flying.into_iter().zip(landings.into_iter().flatten()) {
            let contact = swept.contact.filter(|_| !self.options.is_past_an_open_side(swept.at));
            let landing = SweepResult { contact, ..swept };
            self.follow_cluster(cluster, &landing);
            if landing.touches() {
                let places =
                    cluster.members.iter().filter_map(|id| self.catkin(*id).resting_place()).collect::<Vec<_>>();
                self.record_landings(places);
            }
        }
        self.present = clusters.values().fold(self.present, |present, c| present.with_state(c.state));
        self.clusters = clusters;
    }

    /// Advances a cluster's centre and velocity, but not its members, and returns the first contact of its sweep.
    fn advance_cluster(
        &self,
        cluster: &mut CatkinCluster,
        probe: &mut WindProbe,
        wind: &dyn Wind,
        t: f64,
    ) -> SweepResult {
        let dt = self.time_step();
        // Contract first: offsets must be final before the wind is sampled at the members.
        cluster.contract_in_flight(dt, |id| self.catkin(id).mass);
        probe.which.clear();
        probe.which.extend(cluster.evenly_spaced_members(MAX_WIND_SAMPLES));
        // The same midpoint rule as for singles, with the mean carrying velocity over the sampled members.
        let step = MidpointStep { lag: cluster.lag, tau: self.options.relaxation_time(cluster.fall), dt };
        probe.sample(cluster, cluster.x, wind, t);
        let middle = step.half_step(cluster.x, cluster.v, self.mean_carrying_velocity(cluster, probe, t));
        probe.sample(cluster, middle, wind, t + dt / 2.0);
        let (way, v) = step.full_step(cluster.v, self.mean_carrying_velocity(cluster, probe, t + dt / 2.0));
        if self.options.cluster_rotation {
            let spun = self.angular_velocity_from_wind(cluster, &probe.which, &probe.air);
            cluster.rotate_by_step(spun, dt);
        }
        // Sweep all members along the common displacement; the first contact stops the cluster.
        let landing = self.sweep_cluster(cluster, way);
        cluster.x = landing.at;
        cluster.v = v;
        landing
    }

    /// Mass-weighted mean of the carrying velocity at the sampled members.
    fn mean_carrying_velocity(&self, cluster: &CatkinCluster, probe: &WindProbe, t: f64) -> DVec3 {
        let lift = cluster.lift_at(t);
        let (mut sum, mut mass) = (DVec3::ZERO, 0.0);
        for (i, air) in probe.which.iter().zip(&probe.air) {
            let c = self.catkin(cluster.members[*i]);
            // The settling speed is that of the cluster; the glide depends on the orientation of each member.
            sum += carrying_velocity(*air, c.tuft(), cluster.fall, self.options.glide, lift) * c.mass;
            mass += c.mass;
        }
        sum / mass
    }

    /// Angular velocity of a cluster after this step, rad/s, which relaxes towards the wind's rotation around it:
    /// omega = I^-1 sum m r x (u - mean u). A pair has no inertia about its connecting line and does not rotate about it.
    fn angular_velocity_from_wind(&self, cluster: &CatkinCluster, probe: &[usize], air: &[Vec3]) -> Vec3 {
        // Subtract the mean wind: the remainder rotates or strains the cluster.
        let mean = air.iter().copied().sum::<Vec3>() / air.len().max(1) as f32;
        let (mut momentum, mut inertia) = (Vec3::ZERO, glam::Mat3::ZERO);
        for (i, u) in probe.iter().zip(air) {
            let m = narrow(self.catkin(cluster.members[*i]).mass / cluster.mass);
            let r = cluster.offsets[*i].as_vec3();
            momentum += r.cross(*u - mean) * m;
            let outer = glam::Mat3::from_cols(r * r.x, r * r.y, r * r.z);
            inertia += (glam::Mat3::IDENTITY * r.length_squared() - outer) * m;
        }
        // omega = I^-1 L of masses at the sampled members; a small share of the trace on the diagonal makes the singular
        // inertia of a pair invertible.
        let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
        if trace < 1e-12 {
            return cluster.omega;
        }
        let whole = inertia + glam::Mat3::IDENTITY * (trace * 1e-3);
        let wanted = (whole.inverse() * momentum).clamp_length_max(MAX_CLUSTER_SPIN);
        // Relax towards the target rate exactly, for any step.
        let share = 1.0 - osier_base::math::exp_f32(-narrow(self.time_step()) / CLUSTER_SPIN_TIME);
        cluster.omega + (wanted - cluster.omega) * share
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{CatkinStart, FlightParams};
    use super::*;
    use osier_base::math::{exp, sqrt};
    use osier_scene::solid::Solids;

    /// A wind given by a function of position and time.
    struct Field<F>(F);

    impl<F> std::fmt::Debug for Field<F> {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str("Field")
        }
    }

    impl<F: Fn(Vec3, f64) -> Vec3 + Send + Sync> Wind for Field<F> {
        fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
            places.iter().zip(out).for_each(|(p, o)| *o = (self.0)(*p, t));
        }
        fn mean(&self) -> Vec3 {
            Vec3::ZERO
        }
        fn mean_at(&self, _: Vec3) -> Vec3 {
            Vec3::ZERO
        }
        fn period(&self) -> Option<f64> {
            None
        }
    }

    fn one(options: FlightParams, at: DVec3) -> FlightSimulation {
        let start = CatkinStart { at, wait: ReleaseCondition::Until(0.0) };
        FlightSimulation::new(options, Arc::new(Solids::default()), &[start])
    }

    fn plain() -> FlightParams {
        FlightParams { glide: 0.0, fall_spread: 0.0, stick_probability: 0.0, ..FlightParams::default() }
    }

    /// Falling from rest in still air: v = -u_g (1 - e^(-t/tau)), y = -u_g (t - tau (1 - e^(-t/tau))).
    #[test]
    fn settling_matches_the_closed_form() {
        let still = Field(|_, _| Vec3::ZERO);
        // The last flight begins with two steps of 5 ms, which are shorter than all others.
        for (gravity, first_interval, substeps) in [(9.81, 0.0, 1), (1.62, 0.0, 1), (9.81, 0.01, 2)] {
            let options = FlightParams { gravity, first_interval, substeps, ..plain() };
            let mut flight = one(options, DVec3::new(0.0, 20.0, 0.0));
            let (fall, tau) = (0.24, 0.24 / gravity);
            for _ in 0..48 {
                flight.advance(&still);
                let t = flight.seconds();
                let c = &flight.catkins[0];
                let left = exp(-t / tau);
                assert!((c.v.y + fall * (1.0 - left)).abs() < 1e-5 * fall);
                assert!((c.x.y - 20.0 + fall * (t - tau * (1.0 - left))).abs() < 1e-5, "{}", c.x.y);
            }
            let seconds = if first_interval > 0.0 { first_interval + 46.0 / 48.0 } else { 2.0 };
            assert!((flight.seconds() - seconds).abs() < 1e-12, "{} s", flight.seconds());
            let left = exp(-seconds / tau);
            assert!((flight.catkins[0].v.y + fall * (1.0 - left)).abs() < 1e-7, "{gravity}");
        }
    }

    /// Without inertia the velocity is that of eq. 10: wind minus settling speed.
    #[test]
    fn without_inertia_the_step_is_equation_10() {
        let breeze = Field(|_, _| Vec3::new(1.5, 0.1, -0.4));
        let mut flight = one(FlightParams { inertia: false, ..plain() }, DVec3::new(0.0, 20.0, 0.0));
        (0..24).for_each(|_| flight.advance(&breeze));
        let wanted = DVec3::new(1.5, 20.0 + f64::from(0.1_f32) - 0.24, -f64::from(0.4_f32));
        assert!(flight.catkins[0].x.distance(wanted) < 1e-9, "{}", flight.catkins[0].x);
        let mut quick = one(FlightParams { fall: 1e-9, ..plain() }, DVec3::new(0.0, 20.0, 0.0));
        (0..24).for_each(|_| quick.advance(&breeze));
        assert!(quick.catkins[0].x.distance(wanted + DVec3::Y * 0.24) < 1e-5);
    }

    /// Error of the radius after one revolution in air that rotates as a rigid body.
    fn drift(steps: u32, turns: u32) -> f64 {
        let omega = std::f64::consts::TAU;
        #[allow(clippy::cast_possible_truncation)]
        let turning = Field(move |p: Vec3, _| Vec3::new(-p.z, 0.0, p.x) * omega as f32);
        let options = FlightParams {
            inertia: false,
            fall: 0.0,
            fps: f64::from(steps),
            inside: FlightParams::default().inside,
            ..plain()
        };
        let mut flight = one(options, DVec3::new(5.0, 10.0, 0.0));
        (0..steps * turns).for_each(|_| flight.advance(&turning));
        let x = flight.catkins[0].x;
        sqrt(x.x * x.x + x.z * x.z) - 5.0
    }

    #[test]
    fn midpoint_rule_keeps_a_catkin_in_an_eddy() {
        let ten = drift(200, 10);
        assert!(ten.abs() / 5.0 / 10.0 < 1e-4, "{ten}");
        // Of second order in place: the phase error falls with the square of the step.
        let phase = |steps: u32| {
            let options = FlightParams { inertia: false, fall: 0.0, fps: f64::from(steps), ..plain() };
            #[allow(clippy::cast_possible_truncation)]
            let turning = Field(|p: Vec3, _| Vec3::new(-p.z, 0.0, p.x) * std::f64::consts::TAU as f32);
            let mut flight = one(options, DVec3::new(5.0, 10.0, 0.0));
            (0..steps).for_each(|_| flight.advance(&turning));
            flight.catkins[0].x.distance(DVec3::new(5.0, 10.0, 0.0))
        };
        let order = osier_base::math::ln(phase(25) / phase(50)) / osier_base::math::ln(2.0);
        assert!(order >= 1.9, "{order}");
    }

    #[test]
    fn tilted_tufts_glide() {
        let level = carrying_velocity(Vec3::ZERO, Vec3::X, 0.24, 0.5, 0.0);
        assert!(level.distance(DVec3::new(0.12, -0.24, 0.0)) < 1e-12);
        assert!(carrying_velocity(Vec3::ZERO, Vec3::Y, 0.24, 0.5, 0.1).distance(DVec3::new(0.0, -0.14, 0.0)) < 1e-12);
    }
}
