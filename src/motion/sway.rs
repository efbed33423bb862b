//! Swaying by a formula: sums of sines that repeat with the clip, so that it loops.
//!
//! Thin wood bends farther and faster than thick wood; a gust travels through the plant along the wind; leaves flutter
//! about their stalks, each in its own time.

use glam::{Quat, Vec3};

use super::rig::Rig;
use crate::math;
use crate::plant::{NONE, Organ};
use crate::rng::Rng;
use crate::scene::{InstanceState, Trs};

/// Wind and clip, in the plant's own space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SwayOptions {
    /// Unit vector the wind blows towards.
    pub direction: Vec3,
    /// Wind speed, m/s, 0..40.
    pub speed: f32,
    /// Length of the clip, s, > 0; the motion repeats after it.
    pub period: f32,
    /// Where the plant stands, m: gusts reach it later the farther downwind.
    pub at: Vec3,
    /// Factor on the bends of the wood; 1 as the formula has them.
    pub strength: f32,
    /// Flutter of the leaves: 1 is a leaf with a round stalk, 2 to 3 the flat stalks of poplars, 0 none.
    pub flutter: f32,
}

impl Default for SwayOptions {
    fn default() -> Self {
        Self { direction: Vec3::X, speed: 3.0, period: 3.0, at: Vec3::ZERO, strength: 1.0, flutter: 1.0 }
    }
}

/// One sine of a joint's motion.
#[derive(Debug, Clone, Copy)]
struct Wave {
    /// Whole cycles in the clip.
    cycles: f32,
    /// Phase, rad.
    phase: f32,
}

impl Wave {
    fn at(&self, turn: f32) -> f32 {
        math::sin_f32(std::f32::consts::TAU * self.cycles * turn + self.phase)
    }
}

/// How one joint moves.
#[derive(Debug, Clone, Copy)]
struct JointSway {
    /// Largest angle, rad.
    amplitude: f32,
    gust: Wave,
    along: Wave,
    across: Wave,
}

/// How one leaf moves.
#[derive(Debug, Clone, Copy)]
struct LeafSway {
    twist: Wave,
    nod: Wave,
    amplitude: f32,
}

/// Poses of one plant over time.
#[derive(Debug, Clone)]
pub struct Sway {
    options: SwayOptions,
    joints: Vec<JointSway>,
    leaves: Vec<LeafSway>,
}

impl Sway {
    /// Prepares the motion of a rig and of the plant's organs. Phases come from ids, so that no two neighbours move in
    /// unison and none depends on the order of anything.
    pub fn new(rig: &Rig, organs: &[Organ], seed: u64, options: SwayOptions) -> Self {
        let bind = rig.skeleton.bind();
        let joint = |(i, t): (usize, &Trs)| joint_sway(rig, i, t.t, seed, &options);
        let leaf = |o: &Organ| leaf_sway(o.id, seed, &options);
        Self {
            options,
            joints: bind.iter().enumerate().map(joint).collect(),
            leaves: organs.iter().map(leaf).collect(),
        }
    }

    /// Parent-from-joint transforms at a time, s.
    /// Own: angle = amplitude (0.55 gust + 0.45 along) about the axis that tips the joint downwind, 0.4 amplitude across.
    pub fn pose(&self, rig: &Rig, seconds: f32) -> Vec<Trs> {
        let turn = seconds / self.options.period;
        let tip = math::normalize_or(Vec3::Y.cross(self.options.direction), Vec3::Z);
        let one = |(joint, sway): (&crate::scene::Joint, &JointSway)| {
            let lean = sway.amplitude * (0.55 * (1.0 + sway.gust.at(turn)) + 0.45 * sway.along.at(turn));
            let cross = sway.amplitude * 0.4 * sway.across.at(turn);
            let angles = tip * lean + self.options.direction * cross;
            let angle = angles.length();
            let r = if angle > 1e-9 { axis_angle(angles / angle, angle) } else { Quat::IDENTITY };
            Trs { r: r * joint.rest.r, ..joint.rest }
        };
        rig.skeleton.joints.iter().zip(&self.joints).map(one).collect()
    }

    /// Adds flutter to leaves carried by their joints. `state`: one instance per organ given to [`Sway::new`], in order.
    /// Own: a twist about the midrib and a nod about the blade's width, two sines of 0.6 to 2.8 Hz at 3 m/s.
    pub fn flutter(&self, state: &mut InstanceState, seconds: f32) {
        let turn = seconds / self.options.period;
        for (q, leaf) in state.orientations.iter_mut().zip(&self.leaves) {
            let twist = axis_angle(Vec3::Y, leaf.amplitude * leaf.twist.at(turn));
            let nod = axis_angle(Vec3::X, 0.5 * leaf.amplitude * leaf.nod.at(turn));
            *q = (*q * twist * nod).normalize();
        }
    }
}

fn axis_angle(axis: Vec3, angle: f32) -> Quat {
    let v = axis * math::sin_f32(angle * 0.5);
    Quat::from_xyzw(v.x, v.y, v.z, math::cos_f32(angle * 0.5))
}

/// Own: amplitude 0.9 deg sqrt(5 cm / r) at 3 m/s, within 0.15..4.5 deg, growing with the square of the wind up to a
/// limit; frequency 0.35 Hz (10 cm / r)^0.4, within 0.2..2 Hz, rounded to whole cycles of the clip.
fn joint_sway(rig: &Rig, i: usize, pivot: Vec3, seed: u64, options: &SwayOptions) -> JointSway {
    let bone = &rig.bones[i];
    let mut rng = Rng::at(seed, &["sway".into(), bone.id.into()]);
    let drag = (options.speed / 3.0) * (options.speed / 3.0);
    let force = drag / (0.6 + 0.4 * drag);
    let degrees = (0.9 * math::sqrt_f32(0.05 / bone.r)).clamp(0.15, 4.5);
    let amplitude = if bone.axis == NONE { 0.0 } else { crate::units::radians_f32(degrees) * force * options.strength };
    let hertz = (0.35 * math::pow_f32(0.1 / bone.r.min(1.0), 0.4)).clamp(0.2, 2.0);
    let downwind = (options.at + pivot).dot(options.direction);
    let travel = std::f32::consts::TAU * downwind / (options.speed.max(0.5) * options.period);
    let mut wave = |hertz: f32| Wave {
        cycles: (hertz * options.period).round().max(1.0),
        phase: rng.unit_f32() * std::f32::consts::TAU,
    };
    let (along, across) = (wave(hertz), wave(hertz * 0.8));
    JointSway { amplitude, gust: Wave { cycles: 1.0, phase: -travel }, along, across }
}

fn leaf_sway(id: u64, seed: u64, options: &SwayOptions) -> LeafSway {
    let mut rng = Rng::at(seed, &["flutter".into(), id.into()]);
    let pace = math::sqrt_f32(options.speed / 3.0).clamp(0.2, 2.0);
    let mut wave = |low: f64, high: f64| Wave {
        cycles: (math::narrow(rng.range(low, high)) * pace * options.period).round().max(1.0),
        phase: rng.unit_f32() * std::f32::consts::TAU,
    };
    let (twist, nod) = (wave(1.2, 2.8), wave(0.6, 1.6));
    let degrees = 5.0 * options.flutter * (options.speed / 3.0).clamp(0.0, 3.0);
    LeafSway { twist, nod, amplitude: crate::units::radians_f32(degrees.min(50.0)) * (0.6 + 0.8 * rng.unit_f32()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::Plant;

    fn sway(options: SwayOptions) -> (Rig, Sway, Vec<Organ>) {
        let plant = Plant::default();
        let mut rig = Rig::build(&plant, 8);
        for (i, r) in [0.2_f32, 0.02, 0.004].into_iter().enumerate() {
            let joint = crate::scene::Joint { name: format!("j{i}"), parent: Some(0), rest: Trs::translation(Vec3::Y) };
            rig.skeleton.joints.push(joint);
            rig.bones.push(super::super::rig::Bone { axis: 0, s: 0.0, r, id: i as u64 + 1 });
        }
        let organ = |id| Organ {
            id,
            axis: 0,
            s: 0.0,
            offset: Vec3::ZERO,
            q: Quat::IDENTITY,
            scale: 1.0,
            proto: 0,
            petiole: 0.0,
            tint: 0.0,
            birth: 0.0,
        };
        let organs: Vec<Organ> = (0..50).map(organ).collect();
        let sway = Sway::new(&rig, &organs, 7, options);
        (rig, sway, organs)
    }

    #[test]
    fn the_clip_loops_and_the_root_stands_still() {
        let (rig, sway, _) = sway(SwayOptions::default());
        let (a, b) = (sway.pose(&rig, 0.0), sway.pose(&rig, 3.0));
        assert_eq!(a[0], Trs::IDENTITY);
        assert!(a.iter().zip(&b).all(|(x, y)| x.r.dot(y.r).abs() > 1.0 - 1e-6));
        assert!(a[2].r.dot(sway.pose(&rig, 1.0)[2].r) < 1.0 - 1e-6, "it moves between");
    }

    #[test]
    fn thin_wood_moves_more_than_thick_and_calm_air_moves_nothing() {
        let (rig, windy, _) = sway(SwayOptions::default());
        let reach = |i: usize| (0..24_u8).map(|k| windy.pose(&rig, f32::from(k) / 8.0)[i].r.w).fold(1.0_f32, f32::min);
        assert!(reach(3) < reach(2) && reach(2) < reach(1));
        let (rig, calm, _) = sway(SwayOptions { speed: 0.0, ..SwayOptions::default() });
        assert!(calm.pose(&rig, 0.7).iter().all(|t| t.r == Quat::IDENTITY));
    }

    #[test]
    fn leaves_flutter_each_in_their_own_time() {
        let (_, sway, organs) = sway(SwayOptions::default());
        let at = |seconds| {
            let mut state = InstanceState {
                positions: vec![Vec3::ZERO; organs.len()],
                orientations: vec![Quat::IDENTITY; organs.len()],
                ..InstanceState::default()
            };
            sway.flutter(&mut state, seconds);
            state.orientations
        };
        let (a, b) = (at(0.0), at(3.0));
        assert!(a.iter().zip(&b).all(|(x, y)| x.dot(*y).abs() > 1.0 - 1e-5), "loops");
        let signs = a.iter().filter(|q| q.y > 0.0).count();
        assert!((10..40).contains(&signs), "{signs} of 50 turn the same way");
    }
}
