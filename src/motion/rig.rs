//! Joints for a plant within a budget, and what hangs on them.
//!
//! Thick axes get joints of their own (four on the trunk, two on main branches, one on the rest); axes that do not fit
//! the budget ride rigidly on the nearest joint of the axis that carries them.

use crate::plant::{Axis, NONE, Organ, Plant};
use crate::scene::{Joint, Skeleton, SkinWeights, Trs};

/// Joints that an ordinary skinned export may have; engines and Blender slow down beyond 300.
pub const DEFAULT_JOINTS: usize = 256;

/// Rings within this many radii of the place where an axis leaves its parent follow the parent.
const COLLAR: f32 = 1.5;

/// One joint's place in the plant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bone {
    /// Axis it bends, or [`NONE`] for the root joint.
    pub axis: u32,
    /// Arc length of its pivot on the axis, m.
    pub s: f32,
    /// Radius of the axis at its pivot, m.
    pub r: f32,
    /// Stable id: its axis' id mixed with its ordinal on the axis.
    pub id: u64,
}

/// A skeleton with the plant it belongs to. All rest rotations are the identity, so a joint's rotation is a turn about
/// axes of the plant's own space.
#[derive(Debug, Clone)]
pub struct Rig {
    /// Joints; joint 0 stands still at the origin.
    pub skeleton: Skeleton,
    /// Parallel to the joints.
    pub bones: Vec<Bone>,
    /// Per axis its joints from base to tip; empty for an axis that rides on another.
    chains: Vec<Vec<u16>>,
    /// Per axis the joint that its base rides on.
    carriers: Vec<u16>,
}

impl Rig {
    /// Chooses joints. `budget`: most joints, at least 1 and at most 65,535.
    /// Own: joints per axis 4, 2, 1 by order 0, 1, 2 and more; axes enter by (order, falling length of their subtree, id)
    /// while they and their carriers fit.
    pub fn build(plant: &Plant, budget: usize) -> Self {
        let budget = budget.clamp(1, 65_535);
        let counts = joints_per_axis(plant, budget);
        let mut rig = Self {
            skeleton: Skeleton { joints: vec![Joint { name: "root".into(), parent: None, rest: Trs::IDENTITY }] },
            bones: vec![Bone { axis: NONE, s: 0.0, r: f32::MAX, id: 0 }],
            chains: vec![Vec::new(); plant.axes.len()],
            carriers: vec![0; plant.axes.len()],
        };
        rig.add_in_depth_first_order(plant, &counts);
        rig.find_carriers(plant);
        rig
    }

    /// Walks joints depth first, as skeleton files want them: the children carried by a joint come before the joint that
    /// continues its axis.
    fn add_in_depth_first_order(&mut self, plant: &Plant, counts: &[u8]) {
        let children = boned_children(plant, counts);
        // A task is one joint: axis, ordinal on it, parent joint.
        let mut tasks: Vec<(u32, u8, u16)> = children.roots.iter().rev().map(|&a| (a, 0, 0)).collect();
        while let Some((a, k, parent)) = tasks.pop() {
            let axis = &plant.axes[a as usize];
            let n = counts[a as usize];
            let joint = self.push(plant, a, (k, n), parent);
            if k + 1 < n {
                tasks.push((a, k + 1, joint));
            }
            let (low, high) = (span_start(axis, k, n), span_start(axis, k + 1, n));
            let last = k + 1 == n;
            let carried = |s: f32| (k == 0 || s >= low) && (last || s < high);
            let list = &children.of[a as usize];
            tasks.extend(list.iter().rev().filter(|(_, s)| carried(*s)).map(|&(c, _)| (c, 0, joint)));
        }
    }

    /// Adds joint `k` of `n` of axis `a` and returns its index.
    fn push(&mut self, plant: &Plant, a: u32, (k, n): (u8, u8), parent: u16) -> u16 {
        let axis = &plant.axes[a as usize];
        let s = span_start(axis, k, n);
        let site = plant.frame(axis, s);
        let joint = u16::try_from(self.bones.len()).unwrap_or(u16::MAX);
        let origin = self.pivot(plant, parent);
        let name = format!("a{a}_{k}");
        self.skeleton.joints.push(Joint {
            name,
            parent: Some(u32::from(parent)),
            rest: Trs::translation(site.p - origin),
        });
        self.bones.push(Bone { axis: a, s, r: site.r, id: crate::rng::child(axis.id, u64::from(k)) });
        self.chains[a as usize].push(joint);
        joint
    }

    fn pivot(&self, plant: &Plant, joint: u16) -> glam::Vec3 {
        let bone = &self.bones[usize::from(joint)];
        if bone.axis == NONE { glam::Vec3::ZERO } else { plant.frame(&plant.axes[bone.axis as usize], bone.s).p }
    }

    /// Parents stand before their children, so one pass suffices.
    fn find_carriers(&mut self, plant: &Plant) {
        for (i, axis) in plant.axes.iter().enumerate() {
            self.carriers[i] = match plant.axes.get(axis.parent as usize) {
                Some(parent) => self.nearest(parent, axis.parent as usize, axis.parent_s),
                None => 0,
            };
        }
    }

    /// The joint that moves axis `a` at arc length `s` as a rigid body: the one whose span holds `s`.
    fn nearest(&self, axis: &Axis, a: usize, s: f32) -> u16 {
        let chain = &self.chains[a];
        let n = u8::try_from(chain.len()).unwrap_or(u8::MAX);
        let k = (0..n).rev().find(|&k| k == 0 || s >= span_start(axis, k, n)).unwrap_or(0);
        chain.get(usize::from(k)).copied().unwrap_or(self.carriers[a])
    }

    /// The joint that an organ rides on.
    pub fn organ_joint(&self, plant: &Plant, organ: &Organ) -> u16 {
        self.nearest(&plant.axes[organ.axis as usize], organ.axis as usize, organ.s)
    }

    /// Weights of bark vertices. `bindings`: axis and arc length (m) per vertex.
    pub fn skin(&self, plant: &Plant, bindings: impl IntoIterator<Item = (u32, f32)>) -> SkinWeights {
        let mut skin = SkinWeights::default();
        for (axis, s) in bindings {
            let (joints, weights) = self.weights(plant, axis as usize, s);
            skin.joints.push(joints);
            skin.weights.push(weights);
        }
        skin
    }

    /// Up to four joints of one point, heaviest first, sum 1.
    fn weights(&self, plant: &Plant, a: usize, s: f32) -> ([u16; 4], [f32; 4]) {
        let axis = &plant.axes[a];
        let mut mix = Mix::default();
        let collar = axis.s_exposed + COLLAR * plant.nodes.r[axis.first as usize];
        let own = if axis.parent == NONE { 1.0 } else { crate::math::smoothstep(axis.s_exposed * 0.5, collar, s) };
        if own > 0.0 {
            self.along(a, s / axis.length, own, &mut mix);
        }
        if own < 1.0 {
            let parent = axis.parent as usize;
            self.along(parent, axis.parent_s / plant.axes[parent].length, 1.0 - own, &mut mix);
        }
        mix.finish()
    }

    /// Weights along an axis: 1 at the middle of a joint's span, linear between the middles.
    /// `place`: share of the axis' length, 0 at its base.
    fn along(&self, a: usize, place: f32, share: f32, mix: &mut Mix) {
        let chain = &self.chains[a];
        if chain.is_empty() {
            mix.add(self.carriers[a], share);
            return;
        }
        let n = chain.len() as f32;
        let x = (place * n - 0.5).clamp(0.0, n - 1.0);
        // Hat functions around the middles: at most two of them are positive.
        for (k, joint) in chain.iter().enumerate() {
            let weight = 1.0 - (x - k as f32).abs();
            if weight > 0.0 {
                mix.add(*joint, share * weight);
            }
        }
    }
}

/// Arc length where joint `k` of `n` on an axis has its pivot.
fn span_start(axis: &Axis, k: u8, n: u8) -> f32 {
    axis.length * f32::from(k) / f32::from(n.max(1))
}

struct Children {
    roots: Vec<u32>,
    /// Per axis the axes with joints that it carries, with their place on it (through axes without joints).
    of: Vec<Vec<(u32, f32)>>,
}

fn boned_children(plant: &Plant, counts: &[u8]) -> Children {
    let mut children = Children { roots: Vec::new(), of: vec![Vec::new(); plant.axes.len()] };
    for (i, axis) in plant.axes.iter().enumerate().filter(|(i, _)| counts[*i] > 0) {
        let index = u32::try_from(i).unwrap_or(u32::MAX);
        match children.of.get_mut(axis.parent as usize) {
            Some(list) => list.push((index, axis.parent_s)),
            None => children.roots.push(index),
        }
    }
    children
}

/// Joints of each axis under the budget (joint 0 is the root's).
fn joints_per_axis(plant: &Plant, budget: usize) -> Vec<u8> {
    let mut reach: Vec<f32> = plant.axes.iter().map(|a| a.length).collect();
    for i in (0..plant.axes.len()).rev() {
        let axis = &plant.axes[i];
        if axis.parent != NONE {
            reach[axis.parent as usize] += reach[i];
        }
    }
    let mut ranked: Vec<usize> = (0..plant.axes.len()).collect();
    let key = |i: &usize| (plant.axes[*i].order, -reach[*i], plant.axes[*i].id);
    ranked.sort_by(|a, b| {
        let (x, y) = (key(a), key(b));
        x.0.cmp(&y.0).then(x.1.total_cmp(&y.1)).then(x.2.cmp(&y.2))
    });
    let mut counts = vec![0_u8; plant.axes.len()];
    let mut left = budget.saturating_sub(1);
    for i in ranked {
        let axis = &plant.axes[i];
        let wanted: u8 = match axis.order {
            0 => 4,
            1 => 2,
            _ => 1,
        };
        let carried = axis.parent == NONE || counts[axis.parent as usize] > 0;
        if carried && usize::from(wanted) <= left {
            counts[i] = wanted;
            left -= usize::from(wanted);
        }
    }
    counts
}

/// A few joints with weights, summed per joint.
#[derive(Default)]
struct Mix {
    items: [(u16, f32); 6],
    count: usize,
}

impl Mix {
    fn add(&mut self, joint: u16, weight: f32) {
        // A point follows at most two joints of its axis and two of the parent's, so six places suffice.
        if let Some((_, w)) = self.items[..self.count].iter_mut().find(|(j, _)| *j == joint) {
            *w += weight;
        } else if let Some(free) = self.items.get_mut(self.count) {
            *free = (joint, weight);
            self.count += 1;
        }
    }

    fn finish(mut self) -> ([u16; 4], [f32; 4]) {
        let used = &mut self.items[..self.count];
        used.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let kept = used.iter().take(4).filter(|(_, w)| *w > 1e-4);
        let total = kept.clone().fold(0.0, |t, (_, w)| t + w);
        let (mut joints, mut weights) = ([0; 4], [0.0; 4]);
        for (i, (j, w)) in kept.enumerate() {
            joints[i] = *j;
            weights[i] = w / total;
        }
        (joints, weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::{AxisEnd, AxisKind};
    use glam::{Quat, Vec3};

    /// A trunk of 4 m with `n` side branches of 1 m, each with one twig.
    fn plant(n: u16) -> Plant {
        let mut plant = Plant::default();
        axis(&mut plant, NONE, 0.0, Vec3::ZERO, Vec3::Y * 4.0);
        for i in 0..n {
            let s = 1.0 + 2.0 * f32::from(i) / f32::from(n);
            axis(&mut plant, 0, s, Vec3::Y * s, Vec3::X);
            let branch = u32::try_from(plant.axes.len() - 1).expect("small");
            axis(&mut plant, branch, 0.5, Vec3::Y * s + Vec3::X * 0.5, Vec3::Z * 0.3);
        }
        plant
    }

    fn axis(plant: &mut Plant, parent: u32, parent_s: f32, from: Vec3, along: Vec3) {
        let order = if parent == NONE { 0 } else { plant.axes[parent as usize].order + 1 };
        let first = u32::try_from(plant.nodes.len()).expect("small");
        let q = crate::math::rotation_between(Vec3::Y, along.normalize());
        for k in 0..5_u8 {
            let t = f32::from(k) / 4.0;
            plant.nodes.p.push(from + along * t);
            plant.nodes.q.push(q);
            plant.nodes.r.push(0.1 / f32::from(order + 1));
            plant.nodes.s.push(along.length() * t);
            plant.nodes.birth.push(0.0);
            plant.nodes.color.push(0);
        }
        plant.axes.push(Axis {
            id: 1000 + u64::from(first),
            parent,
            parent_s,
            order,
            kind: AxisKind::Stem,
            first,
            count: 5,
            length: along.length(),
            s_exposed: if parent == NONE { 0.0 } else { 0.1 },
            material: 0,
            fork: NONE,
            end: AxisEnd::Tip,
            birth: 0.0,
        });
    }

    #[test]
    fn joints_stand_parents_first_and_depth_first() {
        let plant = plant(5);
        let rig = Rig::build(&plant, 256);
        assert_eq!(rig.skeleton.joints.len(), 1 + 4 + 5 * 2 + 5);
        let mut open: Vec<u32> = vec![0];
        for (i, joint) in rig.skeleton.joints.iter().enumerate().skip(1) {
            let parent = joint.parent.expect("only joint 0 is a root");
            while open.last().is_some_and(|&o| o != parent) {
                open.pop();
            }
            assert!(!open.is_empty(), "joint {i} does not follow its parent's subtree");
            open.push(u32::try_from(i).expect("small"));
        }
        for (bone, bind) in rig.bones.iter().zip(rig.skeleton.bind()).skip(1) {
            let site = plant.frame(&plant.axes[bone.axis as usize], bone.s);
            assert!((bind.t - site.p).length() < 1e-5 && bind.r == Quat::IDENTITY);
        }
    }

    #[test]
    fn the_budget_is_kept_and_riders_follow_their_carrier() {
        let plant = plant(50);
        let rig = Rig::build(&plant, 64);
        assert!(rig.skeleton.joints.len() <= 64);
        let rider = (0..plant.axes.len()).find(|&a| rig.chains[a].is_empty()).expect("some do not fit");
        let (joints, weights) = rig.weights(&plant, rider, plant.axes[rider].length);
        assert_eq!((joints[0], weights[0]), (rig.carriers[rider], 1.0));
    }

    #[test]
    fn weights_sum_to_one_and_collars_follow_the_parent() {
        let plant = plant(5);
        let rig = Rig::build(&plant, 256);
        for a in 0..plant.axes.len() {
            for i in 0..=20_u8 {
                let s = plant.axes[a].length * f32::from(i) / 20.0;
                let (joints, weights) = rig.weights(&plant, a, s);
                let sum = weights.iter().fold(0.0, |t, w| t + w);
                assert!((sum - 1.0).abs() < 1e-6 && weights.windows(2).all(|w| w[0] >= w[1]), "{weights:?}");
                assert!(joints.iter().zip(weights).all(|(j, w)| w > 0.0 || *j == 0));
            }
        }
        assert_eq!(
            rig.weights(&plant, 1, 0.0),
            rig.weights(&plant, 0, plant.axes[1].parent_s),
            "the base follows the trunk"
        );
    }
}
