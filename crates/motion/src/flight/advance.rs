//! Catkins carried by the air: \[catkin\] eq. 10 with a lag.

use glam::{DVec3, Vec3};

use super::clusters::Cluster;
use super::deposit::{Landing, Path};
use super::particles::{Catkin, Lag, State};
use super::present_states::About;
use super::release::Leaving;
use super::{CHUNK, Flights, Wait};
use osier_wind::Wind;

/// Most members of a cluster that the wind is asked at.
const ASKED: usize = 64;

/// Clusters a task takes at once.
const CLUSTERS: usize = 64;

/// Most that a cluster turns, rad/s, and how long it takes to take up a turn, s.
const FASTEST_TURN: f32 = 6.0;
const TURN_TIME: f32 = 0.3;

/// What the air does at a point for one that falls through it.
fn carried(air: Vec3, tuft: Vec3, fall: f64, glide: f64, lift: f64) -> DVec3 {
    let level = Vec3::new(tuft.x, 0.0, tuft.z).as_dvec3();
    air.as_dvec3() + DVec3::Y * (lift - fall) + level * (glide * fall)
}

/// Half a step and a whole one for one body.
#[derive(Debug, Clone, Copy)]
struct Midpoint {
    lag: Lag,
    tau: f64,
    dt: f64,
}

impl Midpoint {
    fn half(self, x: DVec3, v: DVec3, u: DVec3) -> DVec3 {
        x + u * (self.dt / 2.0) + (v - u) * (self.tau * (1.0 - self.lag.half))
    }

    /// Way and new velocity.
    fn whole(self, v: DVec3, u: DVec3) -> (DVec3, DVec3) {
        (u * self.dt + (v - u) * (self.tau * (1.0 - self.lag.whole)), u + (v - u) * self.lag.whole)
    }
}

/// Members of a cluster that the wind is asked at; one after another, so that room for them is made but once.
#[derive(Debug, Default)]
struct Asked {
    /// Their places among the members.
    which: Vec<usize>,
    places: Vec<Vec3>,
    air: Vec<Vec3>,
}

impl Asked {
    /// Asks the wind around `middle`.
    fn ask(&mut self, cluster: &Cluster, middle: DVec3, (wind, t): (&dyn Wind, f64)) {
        self.places.clear();
        self.places.extend(self.which.iter().map(|i| (middle + cluster.offsets[*i]).as_vec3()));
        self.air.resize(self.places.len(), Vec3::ZERO);
        wind.sample(&self.places, t, &mut self.air);
    }
}

impl Flights {
    /// Lets go of those whose time has come.
    pub(super) fn release(&mut self, wind: &dyn Wind, t: f64) {
        if !self.about.pending {
            return;
        }
        let leaving = Leaving { rate: self.options.release_rate, speed: self.options.release_speed };
        let dt = self.options.step();
        let mut pending: Vec<&mut Catkin> = self.catkins.iter_mut().filter(|c| c.state == State::Pending).collect();
        let places: Vec<Vec3> = pending.iter().map(|c| c.x.as_vec3()).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        if pending.iter().any(|c| matches!(c.wait, Wait::Wind(_))) {
            wind.sample(&places, t, &mut air);
        }
        for (c, air) in pending.iter_mut().zip(air) {
            if leaving.goes(&mut c.wait, air, (t, dt)) {
                c.state = State::Airborne;
                c.since = t;
            }
        }
    }

    /// Singles in the air.
    pub(super) fn fly(&mut self, wind: &dyn Wind, t: f64) {
        let (options, solids) = (&self.options, &*self.solids);
        let dt = options.step();
        let mut chunks: Vec<&mut [Catkin]> = self.catkins.chunks_mut(CHUNK).collect();
        let landed = osier_base::par::par_map_mut(&mut chunks, |chunk| {
            let flying = |c: &Catkin| c.state == State::Airborne && !c.clustered;
            let mut those: Vec<&mut Catkin> = chunk.iter_mut().filter(|c| flying(c)).collect();
            let mut places: Vec<Vec3> = those.iter().map(|c| c.x.as_vec3()).collect();
            let mut air = vec![Vec3::ZERO; places.len()];
            let step = |c: &Catkin| Midpoint { lag: c.lag, tau: options.tau(c.fall), dt };
            let pull = |c: &Catkin, air: Vec3, t: f64| carried(air, c.tuft(), c.fall, options.glide, c.lift_at(t));
            wind.sample(&places, t, &mut air);
            for ((c, place), air) in those.iter().zip(&mut places).zip(&air) {
                *place = step(c).half(c.x, c.v, pull(c, *air, t)).as_vec3();
            }
            wind.sample(&places, t + dt / 2.0, &mut air);
            let (mut landed, mut strays) = (0_u64, Vec::new());
            for (c, air) in those.iter_mut().zip(&air) {
                let (way, v) = step(c).whole(c.v, pull(c, *air, t + dt / 2.0));
                let path = Path { from: c.x, way, radius: c.radius };
                c.flow = *air - v.as_vec3();
                let landing = path.follow(solids);
                c.travel += landing.at - c.x;
                (c.x, c.v) = (landing.at, v);
                landed += u64::from(c.land(&landing));
                if options.is_outside(c.x) {
                    strays.push(c.id);
                }
            }
            (landed, About::of(chunk), strays)
        });
        self.events.deposits += landed.iter().map(|l| l.0).sum::<u64>();
        self.about = landed.iter().fold(About::default(), |about, l| about.and(l.1));
        self.strays = landed.into_iter().flat_map(|l| l.2).collect();
    }

    /// Clusters in the air, each as one body.
    pub(super) fn fly_clusters(&mut self, wind: &dyn Wind, t: f64) {
        let mut clusters = std::mem::take(&mut self.clusters);
        let mut flying: Vec<&mut Cluster> = clusters.values_mut().filter(|c| c.state == State::Airborne).collect();
        let mut chunks: Vec<&mut [&mut Cluster]> = flying.chunks_mut(CLUSTERS).collect();
        let landings = osier_base::par::par_map_mut(&mut chunks, |chunk| {
            let mut asked = Asked::default();
            chunk.iter_mut().map(|cluster| self.moved(cluster, &mut asked, (wind, t))).collect::<Vec<_>>()
        });
        for (cluster, landing) in flying.into_iter().zip(landings.into_iter().flatten()) {
            if landing.touches() {
                self.events.deposits += cluster.members.len() as u64;
            }
            self.follow_on(cluster, &landing);
        }
        self.about = clusters.values().fold(self.about, |about, c| about.with(c.state));
        self.clusters = clusters;
    }

    /// Moves a cluster by a step, its members not yet, and tells what it came upon.
    fn moved(&self, cluster: &mut Cluster, asked: &mut Asked, (wind, t): (&dyn Wind, f64)) -> Landing {
        let dt = self.options.step();
        cluster.draw_in(dt, |id| self.at(id).mass);
        asked.which.clear();
        asked.which.extend(cluster.evenly(ASKED));
        let step = Midpoint { lag: cluster.lag, tau: self.options.tau(cluster.fall), dt };
        asked.ask(cluster, cluster.x, (wind, t));
        let middle = step.half(cluster.x, cluster.v, self.borne_by(cluster, asked, t));
        asked.ask(cluster, middle, (wind, t + dt / 2.0));
        let (way, v) = step.whole(cluster.v, self.borne_by(cluster, asked, t + dt / 2.0));
        if self.options.cluster_rotation {
            let spun = self.spun(cluster, &asked.which, &asked.air);
            cluster.turn_by(spun, dt);
        }
        let landing = self.follow(cluster, way);
        cluster.x = landing.at;
        cluster.v = v;
        landing
    }

    /// What the air at its members does to a cluster, by their masses.
    fn borne_by(&self, cluster: &Cluster, asked: &Asked, t: f64) -> DVec3 {
        let lift = cluster.lift_at(t);
        let (mut sum, mut mass) = (DVec3::ZERO, 0.0);
        for (i, air) in asked.which.iter().zip(&asked.air) {
            let c = self.at(cluster.members[*i]);
            sum += carried(*air, c.tuft(), cluster.fall, self.options.glide, lift) * c.mass;
            mass += c.mass;
        }
        sum / mass
    }

    /// How fast a cluster turns after this step: towards how the air around it turns.
    /// omega = I^-1 sum m r x (u - mean u); a line of two has no inertia about itself and is not turned about it.
    fn spun(&self, cluster: &Cluster, asked: &[usize], air: &[Vec3]) -> Vec3 {
        let mean = air.iter().copied().sum::<Vec3>() / air.len().max(1) as f32;
        let (mut momentum, mut inertia) = (Vec3::ZERO, glam::Mat3::ZERO);
        for (i, u) in asked.iter().zip(air) {
            let m = osier_base::math::narrow(self.at(cluster.members[*i]).mass / cluster.mass);
            let r = cluster.offsets[*i].as_vec3();
            momentum += r.cross(*u - mean) * m;
            let outer = glam::Mat3::from_cols(r * r.x, r * r.y, r * r.z);
            inertia += (glam::Mat3::IDENTITY * r.length_squared() - outer) * m;
        }
        let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
        if trace < 1e-12 {
            return cluster.omega;
        }
        let whole = inertia + glam::Mat3::IDENTITY * (trace * 1e-3);
        let wanted = (whole.inverse() * momentum).clamp_length_max(FASTEST_TURN);
        let share = 1.0 - osier_base::math::exp_f32(-osier_base::math::narrow(self.options.step()) / TURN_TIME);
        cluster.omega + (wanted - cluster.omega) * share
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{Options, Start};
    use super::*;
    use osier_base::math::{exp, sqrt};
    use osier_scene::solid::Solids;

    /// Any field of velocities.
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
        fn mean_at(&self, _: f32) -> Vec3 {
            Vec3::ZERO
        }
        fn period(&self) -> Option<f64> {
            None
        }
    }

    fn one(options: Options, at: DVec3) -> Flights {
        let start = Start { at, wait: Wait::Until(0.0) };
        Flights::new(options, Arc::new(Solids::default()), &[start])
    }

    fn plain() -> Options {
        Options { glide: 0.0, fall_spread: 0.0, check_every: 64, ..Options::default() }
    }

    /// Falling from rest in still air: v = -u_g (1 - e^(-t/tau)), y = -u_g (t - tau (1 - e^(-t/tau))).
    #[test]
    fn it_settles_as_the_closed_form_says() {
        let still = Field(|_, _| Vec3::ZERO);
        let mut flight = one(plain(), DVec3::new(0.0, 20.0, 0.0));
        let (fall, tau) = (0.24, 0.24 / 9.81);
        for _ in 0..48 {
            flight.advance(&still);
            let t = flight.seconds();
            let c = &flight.catkins[0];
            let left = exp(-t / tau);
            assert!((c.v.y + fall * (1.0 - left)).abs() < 1e-5 * fall);
            assert!((c.x.y - 20.0 + fall * (t - tau * (1.0 - left))).abs() < 1e-5, "{}", c.x.y);
        }
        assert!((flight.catkins[0].v.y + fall).abs() < 1e-12);
    }

    /// Without a lag it is eq. 10: what the air does, less the fall.
    #[test]
    fn without_a_lag_it_is_the_papers_equation() {
        let breeze = Field(|_, _| Vec3::new(1.5, 0.1, -0.4));
        let mut flight = one(Options { inertia: false, ..plain() }, DVec3::new(0.0, 20.0, 0.0));
        (0..24).for_each(|_| flight.advance(&breeze));
        let wanted = DVec3::new(1.5, 20.0 + f64::from(0.1_f32) - 0.24, -f64::from(0.4_f32));
        assert!(flight.catkins[0].x.distance(wanted) < 1e-9, "{}", flight.catkins[0].x);
        let mut quick = one(Options { fall: 1e-9, ..plain() }, DVec3::new(0.0, 20.0, 0.0));
        (0..24).for_each(|_| quick.advance(&breeze));
        assert!(quick.catkins[0].x.distance(wanted + DVec3::Y * 0.24) < 1e-5);
    }

    /// Error of the radius after one turn in air that turns as a body.
    fn drift(steps: u32, turns: u32) -> f64 {
        let omega = std::f64::consts::TAU;
        #[allow(clippy::cast_possible_truncation)]
        let turning = Field(move |p: Vec3, _| Vec3::new(-p.z, 0.0, p.x) * omega as f32);
        let options =
            Options { inertia: false, fall: 0.0, fps: f64::from(steps), inside: Options::default().inside, ..plain() };
        let mut flight = one(options, DVec3::new(5.0, 10.0, 0.0));
        (0..steps * turns).for_each(|_| flight.advance(&turning));
        let x = flight.catkins[0].x;
        sqrt(x.x * x.x + x.z * x.z) - 5.0
    }

    #[test]
    fn it_stays_in_an_eddy() {
        let ten = drift(200, 10);
        assert!(ten.abs() / 5.0 / 10.0 < 1e-4, "{ten}");
        // Of second order in place: the phase error falls with the square of the step.
        let phase = |steps: u32| {
            let options = Options { inertia: false, fall: 0.0, fps: f64::from(steps), ..plain() };
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
    fn the_tilt_of_the_tuft_makes_it_glide() {
        let level = carried(Vec3::ZERO, Vec3::X, 0.24, 0.5, 0.0);
        assert!(level.distance(DVec3::new(0.12, -0.24, 0.0)) < 1e-12);
        assert!(carried(Vec3::ZERO, Vec3::Y, 0.24, 0.5, 0.1).distance(DVec3::new(0.0, -0.14, 0.0)) < 1e-12);
    }
}
