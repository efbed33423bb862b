//! Branches swinging in the wind, step by step.
//!
//! Each element is an oscillator about the bend that the wind of the moment would hold it at. A step goes through the
//! plant three times: from the ground up for places and speeds, over all stations for the air, from the tips down for
//! forces.

use glam::{DQuat, DVec3, Vec3};

use super::bend::{Swing, large, profile, turn};
use super::element::{Element, Elements, Station};
use super::wood::{AIR, FOLD, Wood};
use crate::plant::NONE;
use crate::rng;
use crate::scene::Trs;
use crate::wind::{TimeNoise, Wind};

/// Steps a second, at least.
const RATE: f64 = 120.0;
/// Looks at the wind a second, at least.
const LOOKS: f64 = 24.0;
/// Strongest inertia, m/s^2.
const JERK: f64 = 50.0;
/// Push across the wind by eddies that a branch sheds, over its drag and its flicker.
const SHED: f64 = 2.0;
/// Fastest flicker of the wind at one branch, Hz.
const FLICKER: f64 = 3.0;

/// How a plant takes the wind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Manner {
    /// What it is made of.
    pub wood: Wood,
    /// Strength of each branch's own flicker over the wind, 0..1; eddies that it sheds go with it.
    pub flicker: f64,
    /// Factor on how twigs lag behind the branch that throws them, 0..3.
    pub whip: f64,
    /// Where the plant stands: from its own space to the world.
    pub stand: Trs,
    /// Frames a second.
    pub fps: f64,
}

/// Where an element is.
#[derive(Debug, Clone, Copy, Default)]
struct Carried {
    base: DVec3,
    /// From rest.
    turn: DQuat,
}

/// A plant in motion.
pub struct Simulation<'a> {
    elements: &'a Elements,
    wind: &'a dyn Wind,
    manner: Manner,
    /// Length of a step, s.
    step: f64,
    swings: Vec<[Swing; 2]>,
    /// Flicker and shed eddies of each element.
    own: Vec<[TimeNoise; 2]>,
    /// Bend and rate of both ways, per element.
    state: Vec<[[f64; 2]; 2]>,
    carried: Vec<Carried>,
    /// Per station: turn from rest, place, place a step ago, places if carried rigidly one and two steps ago.
    turns: Vec<DQuat>,
    places: Vec<DVec3>,
    before: Vec<DVec3>,
    rigid: Vec<[DVec3; 2]>,
    /// Steps since the places were last unknown.
    known: u32,
    air: Vec<Vec3>,
    world: Vec<Vec3>,
    /// Air when it was last looked up and when it will be next, and the flicker and shed eddies of each element.
    looked: [Vec<Vec3>; 2],
    restless: [Vec<[f32; 2]>; 2],
    /// Steps since.
    since: u32,
    /// Force of a subtree on its carrier, N, and load of each element.
    forces: Vec<DVec3>,
    loads: Vec<DVec3>,
}

/// Drag of wood and leaves in relative wind, N: wood takes the part across it, leaves fold away as it grows.
pub fn drag(wood: &Wood, station: &Station, along: DVec3, wind: DVec3) -> DVec3 {
    let across = wind - along * wind.dot(along);
    let speed = wind.length();
    let sum = across * (wood.drag * station.load.wood * across.length())
        + wind * (wood.leaf_drag * station.load.leaf * speed / (1.0 + speed / FOLD));
    sum * (0.5 * AIR)
}

impl<'a> Simulation<'a> {
    /// At rest.
    pub fn new(elements: &'a Elements, wind: &'a dyn Wind, manner: Manner) -> Self {
        let per_frame = (RATE / manner.fps).ceil().max(1.0);
        let step = (manner.fps * per_frame).recip();
        let swing = |e: &Element| {
            e.w.map(|w| {
                let fast = w > std::f64::consts::PI * manner.fps;
                if fast { Swing::follow(w, step) } else { Swing::new(w, e.zeta, step) }
            })
        };
        let (n, m) = (elements.list.len(), elements.stations.len());
        Self {
            swings: elements.list.iter().map(swing).collect(),
            own: elements.list.iter().map(|e| own(e, wind.period())).collect(),
            state: vec![[[0.0; 2]; 2]; n],
            carried: vec![Carried::default(); n],
            turns: vec![DQuat::IDENTITY; m],
            places: vec![DVec3::ZERO; m],
            before: vec![DVec3::ZERO; m],
            rigid: vec![[DVec3::ZERO; 2]; m],
            known: 0,
            air: vec![Vec3::ZERO; m],
            world: vec![Vec3::ZERO; m],
            looked: [vec![Vec3::ZERO; m], vec![Vec3::ZERO; m]],
            restless: [vec![[0.0; 2]; n], vec![[0.0; 2]; n]],
            since: 0,
            forces: vec![DVec3::ZERO; n],
            loads: vec![DVec3::ZERO; n],
            elements,
            wind,
            manner,
            step,
        }
    }

    /// Steps in a frame.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    pub fn steps(&self) -> u32 {
        (1.0 / (self.step * self.manner.fps)).round() as u32
    }

    /// Bend of an element, as a turn about an axis of the plant's space, rad.
    fn bend(&self, e: usize) -> DVec3 {
        let [a, b] = self.state[e];
        self.elements.list[e].ways[0] * a[0] + self.elements.list[e].ways[1] * b[0]
    }

    /// Bends of both ways, rad, per element.
    pub fn bends(&self) -> Vec<[f64; 2]> {
        self.state.iter().map(|[a, b]| [a[0], b[0]]).collect()
    }

    /// Puts every element where a steady wind of the mean would hold it, at rest.
    pub fn settle(&mut self) {
        for _ in 0..24 {
            self.place();
            let stand = self.manner.stand;
            for (i, s) in self.elements.stations.iter().enumerate() {
                let height = stand.apply(self.places[i].as_vec3()).y;
                self.air[i] = stand.r.conjugate() * self.wind.mean_at(height) * s.open;
            }
            self.known = 0;
            self.press(false);
            for e in 0..self.state.len() {
                let goal = self.goal(e);
                for (k, g) in goal.into_iter().enumerate() {
                    self.state[e][k] = [self.state[e][k][0] + 0.6 * (g - self.state[e][k][0]), 0.0];
                }
            }
        }
        self.known = 0;
    }

    /// Goes on by a step from time `t`, s.
    pub fn advance(&mut self, t: f64) {
        self.place();
        self.blow(t);
        self.press(true);
        for e in 0..self.state.len() {
            let goal = self.goal(e);
            for (k, g) in goal.into_iter().enumerate() {
                self.state[e][k] = self.swings[e][k].step(self.state[e][k], g);
            }
        }
    }

    /// Where the load of the moment would hold an element.
    fn goal(&self, e: usize) -> [f64; 2] {
        let bend = large(self.loads[e]);
        self.elements.list[e].ways.map(|way| way.dot(bend))
    }

    /// From the ground up: where everything is.
    fn place(&mut self) {
        for e in 0..self.elements.list.len() {
            let element = &self.elements.list[e];
            let carried = self.base(element);
            self.carried[e] = carried;
            let bend = self.bend(e);
            let mut from = carried.base;
            for i in element.stations.clone() {
                let s = &self.elements.stations[i];
                let turned = carried.turn * turn(bend * profile(s.middle));
                let place = from + turned * (s.p - s.from);
                from += turned * s.chord;
                let rigid = carried.base + carried.turn * (s.p - element.base);
                if self.known == 0 {
                    (self.places[i], self.rigid[i]) = (place, [rigid; 2]);
                }
                self.turns[i] = turned;
                self.before[i] = self.places[i];
                self.places[i] = place;
            }
        }
    }

    /// Base of an element on its carrier.
    fn base(&self, element: &Element) -> Carried {
        let Some(parent) = self.elements.list.get(element.parent as usize) else {
            return Carried { base: element.base, turn: DQuat::IDENTITY };
        };
        let carrier = self.carried[element.parent as usize];
        let bend = self.bend(element.parent as usize);
        // The stretch that it stands on.
        let n = parent.stations.len();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 3")]
        let k = ((element.at * n as f64) as usize).min(n - 1);
        let mut from = carrier.base;
        for i in parent.stations.start..parent.stations.start + k {
            from += self.turns[i] * self.elements.stations[i].chord;
        }
        let i = parent.stations.start + k;
        let base = from + self.turns[i] * (element.base - self.elements.stations[i].from);
        Carried { base, turn: carrier.turn * turn(bend * profile(element.at)) }
    }

    /// Air at all stations, in the plant's space: looked up `LOOKS` times a second, linear between.
    fn blow(&mut self, t: f64) {
        let every = per_look(self.step);
        if self.known == 0 {
            self.look(t);
            self.looked.swap(0, 1);
            self.restless.swap(0, 1);
            self.look(t + self.step * f64::from(every));
            self.since = 0;
        } else if self.since == every {
            self.looked.swap(0, 1);
            self.restless.swap(0, 1);
            self.look(t + self.step * f64::from(every));
            self.since = 0;
        }
        let share = self.since as f32 / every as f32;
        let [last, next] = &self.looked;
        for (air, (a, b)) in self.air.iter_mut().zip(last.iter().zip(next)) {
            *air = *a + (*b - *a) * share;
        }
        self.since += 1;
    }

    /// Looks up the air of a moment.
    fn look(&mut self, t: f64) {
        let stand = self.manner.stand;
        let back = stand.r.conjugate();
        for (w, p) in self.world.iter_mut().zip(&self.places) {
            *w = stand.apply(p.as_vec3());
        }
        let (air, restless) = (&mut self.looked[1], &mut self.restless[1]);
        self.wind.sample(&self.world, t, air);
        for ((e, own), r) in self.elements.list.iter().zip(&self.own).zip(restless) {
            *r = own.map(|noise| noise.at(t));
            let factor = 1.0 + crate::math::narrow(self.manner.flicker) * r[0];
            for i in e.stations.clone() {
                air[i] = back * air[i] * (self.elements.stations[i].open * factor);
            }
        }
    }

    /// Push across the wind of an element's shed eddies, over its drag.
    fn shed(&self, e: usize) -> f64 {
        let share = self.since as f32 / per_look(self.step) as f32;
        let [last, next] = [0, 1].map(|k: usize| self.restless[k][e][1]);
        SHED * self.manner.flicker * f64::from(last + (next - last) * share)
    }

    /// From the tips down: what presses on each element.
    fn press(&mut self, alive: bool) {
        self.forces.fill(DVec3::ZERO);
        self.loads.fill(DVec3::ZERO);
        for e in (0..self.elements.list.len()).rev() {
            let element = &self.elements.list[e];
            let back = self.carried[e].turn.conjugate();
            let (mut total, mut load) = (self.forces[e], self.loads[e]);
            let shed = if alive { self.shed(e) } else { 0.0 };
            for i in element.stations.clone() {
                let s = &self.elements.stations[i];
                let along = self.turns[i] * s.along;
                let relative = self.air[i].as_dvec3() - self.speed(i, s);
                let mut force = drag(&self.manner.wood, s, along, relative);
                let across = relative.cross(along).normalize_or_zero();
                force += across * (shed * force.length());
                total += force;
                load += element.up.cross(back * force) * s.levers[0];
                if alive && self.known > 1 {
                    let rigid = self.carried[e].base + self.carried[e].turn * (s.p - element.base);
                    let [one, two] = self.rigid[i];
                    let thrown = ((rigid - one * 2.0 + two) / (self.step * self.step)).clamp_length_max(JERK);
                    let inertia = thrown * (-self.manner.whip * s.load.mass);
                    load += element.up.cross(back * inertia) * s.levers[1];
                }
            }
            self.loads[e] = load;
            self.forces[e] = total;
            if element.parent != NONE {
                let p = element.parent as usize;
                self.forces[p] += total;
                let carrier = &self.elements.list[p];
                self.loads[p] += carrier.up.cross(self.carried[p].turn.conjugate() * total) * element.lever;
            }
        }
        if alive {
            self.remember();
        }
    }

    fn remember(&mut self) {
        for (e, element) in self.elements.list.iter().enumerate() {
            for i in element.stations.clone() {
                let rigid = self.carried[e].base + self.carried[e].turn * (self.elements.stations[i].p - element.base);
                self.rigid[i] = [rigid, self.rigid[i][0]];
            }
        }
        self.known = self.known.saturating_add(1);
    }

    /// Speed of a station as drag feels it, m/s: less where the air would stop it within a step.
    fn speed(&self, i: usize, s: &Station) -> DVec3 {
        if self.known == 0 {
            return DVec3::ZERO;
        }
        let v = (self.places[i] - self.before[i]) / self.step;
        let wood = &self.manner.wood;
        let area = wood.drag * s.load.wood + wood.leaf_drag * s.load.leaf;
        let rate = AIR * area * f64::from(self.air[i].length()) / s.load.mass.max(1e-12);
        v * (0.5 / (rate * self.step).max(0.5))
    }
}

/// Steps between two looks at the wind.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
fn per_look(step: f64) -> u32 {
    (1.0 / (step * LOOKS)).round().max(1.0) as u32
}

/// Noises of an element that repeat with the wind.
fn own(e: &Element, period: Option<f64>) -> [TimeNoise; 2] {
    let mut draw = rng::Rng::from_key(rng::child(e.id, rng::word("flicker")));
    let hertz = e.w[0] / std::f64::consts::TAU;
    let wanted = [(hertz * draw.range(0.7, 1.3)).min(FLICKER), hertz.min(2.0 * FLICKER)];
    #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash")]
    wanted.map(|hertz| TimeNoise::new((draw.next_u64() >> 32) as u32, hertz, period))
}
