//! Skeleton of a plant within a joint budget, with skin weights.
//!
//! Elements get joints: four on a trunk, two on main branches, one on others. A joint has the rotation at the middle
//! of its stretch; what is beyond the budget rides rigidly on the nearest joint of its carrier.

use glam::Quat;

use super::elements::{BeamElements, ElementLocation};
use super::pose::own_share;
use super::segments::joints_per_order;
use osier_scene::plant::{NONE, Organ, Plant};
use osier_scene::{Joint, Skeleton, SkinWeights, Trs};

/// Location of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RigJoint {
    /// Index of its axis, or [`NONE`] for the root joint.
    axis: u32,
    /// Location whose rotation it has.
    spot: ElementLocation,
    /// Arc length of the middle of its stretch, m.
    middle: f32,
    /// Arc length of its pivot, m.
    pivot: f32,
}

/// Skeleton whose joints follow bending elements. All rest rotations are the identity, so that a joint's rotation is
/// about axes of the plant's space.
#[derive(Debug, Clone)]
pub struct JointRig {
    /// Joints, parents first; joint 0 is fixed at the origin.
    pub skeleton: Skeleton,
    /// Location of each joint.
    bones: Vec<RigJoint>,
    /// Per axis: its joints from base to tip; empty for a rigid axis.
    chains: Vec<Vec<u16>>,
    /// Per axis: the joint that its base follows.
    carriers: Vec<u16>,
}

/// Pending joint of the depth-first traversal.
struct JointTask {
    element: u32,
    /// Index among the element's joints, from its base.
    ordinal: usize,
    /// Index of its parent joint.
    parent: u16,
}

impl JointRig {
    /// Builds the skeleton. `budget`: number of joints, at least 1 and at most 65,535.
    pub fn build(plant: &Plant, elements: &BeamElements, budget: usize) -> Self {
        let counts = joints_per_element(elements, budget.clamp(1, 65_535));
        let still = ElementLocation { element: NONE, at: 0.0 };
        let mut rig = Self {
            skeleton: Skeleton { joints: vec![Joint { name: "root".into(), parent: None, rest: Trs::IDENTITY }] },
            bones: vec![RigJoint { axis: NONE, spot: still, middle: 0.0, pivot: 0.0 }],
            chains: vec![Vec::new(); plant.axes.len()],
            carriers: vec![0; plant.axes.len()],
        };
        rig.add_in_depth_first_order(plant, elements, &counts);
        rig.find_carriers(plant);
        rig
    }

    /// Adds joints depth first, as skeleton formats require: children carried by a joint precede the joint that
    /// continues its element.
    fn add_in_depth_first_order(&mut self, plant: &Plant, elements: &BeamElements, counts: &[usize]) {
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); elements.list.len()];
        let mut roots = Vec::new();
        for (index, (e, _)) in (0_u32..).zip(elements.list.iter().zip(counts)).filter(|(_, (_, count))| **count > 0) {
            match children.get_mut(e.parent as usize) {
                Some(list) => list.push(index),
                None => roots.push(index),
            }
        }
        let first = |element: u32, parent: u16| JointTask { element, ordinal: 0, parent };
        let mut tasks: Vec<JointTask> = roots.iter().rev().map(|e| first(*e, 0)).collect();
        // Joint 0 is the root; the budget keeps the number of joints within u16.
        let mut joint = 0_u16;
        while let Some(task) = tasks.pop() {
            joint += 1;
            let (e, k) = (task.element, task.ordinal);
            let n = counts[e as usize];
            self.add_joint(plant, elements, &task, n, joint);
            if k + 1 < n {
                tasks.push(JointTask { element: e, ordinal: k + 1, parent: joint });
            }
            // Children whose base lies within the stretch of this joint; the outermost joints also take what lies
            // beyond.
            let carried = |c: &&u32| {
                let place = elements.list[**c as usize].at * n as f64;
                (k == 0 || place >= k as f64) && (k + 1 == n || place < (k + 1) as f64)
            };
            tasks.extend(children[e as usize].iter().rev().filter(carried).map(|c| first(*c, joint)));
        }
    }

    /// Adds one of the `n` joints of an element, as joint `joint` of the skeleton.
    fn add_joint(&mut self, plant: &Plant, elements: &BeamElements, task: &JointTask, n: usize, joint: u16) {
        let JointTask { element: e, ordinal: k, parent } = *task;
        let element = &elements.list[e as usize];
        let axis = &plant.axes[element.axis as usize];
        // Joints divide the element's length evenly; each pivots at the start of its stretch.
        let place = |x: f32| element.span[0] + (element.span[1] - element.span[0]) * x / n as f32;
        let (pivot, middle) = (place(k as f32), place(k as f32 + 0.5));
        let chain = &mut self.chains[element.axis as usize];
        let name = format!("a{}_{}", element.axis, chain.len());
        chain.push(joint);
        let t = plant.frame(axis, pivot).p - self.joint_origin(plant, parent);
        self.skeleton.joints.push(Joint { name, parent: Some(u32::from(parent)), rest: Trs::translation(t) });
        let at = (k as f64 + 0.5) / n as f64;
        self.bones.push(RigJoint { axis: element.axis, spot: ElementLocation { element: e, at }, middle, pivot });
    }

    /// Pivot of a joint at rest, m.
    fn joint_origin(&self, plant: &Plant, joint: u16) -> glam::Vec3 {
        let bone = &self.bones[usize::from(joint)];
        plant.axes.get(bone.axis as usize).map_or(glam::Vec3::ZERO, |axis| plant.frame(axis, bone.pivot).p)
    }

    /// Finds the carrying joint of each axis; parents come first, so that one pass suffices.
    fn find_carriers(&mut self, plant: &Plant) {
        for (i, axis) in plant.axes.iter().enumerate() {
            self.carriers[i] = if axis.parent == NONE { 0 } else { self.joint_at(axis.parent as usize, axis.parent_s) };
        }
    }

    /// Joint whose stretch contains arc length `s`, m, of axis `a`; for a rigid axis, the joint that carries it.
    fn joint_at(&self, a: usize, s: f32) -> u16 {
        let chain = &self.chains[a];
        let before = chain.partition_point(|j| self.bones[usize::from(*j)].pivot <= s);
        chain.get(before.saturating_sub(1)).copied().unwrap_or(self.carriers[a])
    }

    /// Joint that an organ follows.
    pub fn organ_joint(&self, organ: &Organ) -> u16 {
        self.joint_at(organ.axis as usize, organ.s)
    }

    /// Skin weights of bark vertices. `bindings`: axis and arc length, m, of each vertex.
    pub fn skin(&self, plant: &Plant, bindings: impl IntoIterator<Item = (u32, f32)>) -> SkinWeights {
        let mut skin = SkinWeights::default();
        for (axis, s) in bindings {
            let (joints, weights) = self.weights(plant, axis, s);
            skin.joints.push(joints);
            skin.weights.push(weights);
        }
        skin
    }

    /// Up to four joints and weights of one vertex, heaviest first, with sum 1.
    fn weights(&self, plant: &Plant, a: u32, s: f32) -> ([u16; 4], [f32; 4]) {
        let mut mix = JointWeights::default();
        // Near a fork the weights of both axes blend, as the bark does.
        let own = own_share(plant, a, s);
        if own > 0.0 {
            self.add_axis_weights(a as usize, s, own, &mut mix);
        }
        if own < 1.0 {
            let axis = &plant.axes[a as usize];
            self.add_axis_weights(axis.parent as usize, axis.parent_s, 1.0 - own, &mut mix);
        }
        mix.normalize_heaviest()
    }

    /// Adds weights along an axis: 1 at the middle of a joint's stretch, linear between the middles.
    fn add_axis_weights(&self, a: usize, s: f32, share: f32, mix: &mut JointWeights) {
        let chain = &self.chains[a];
        let middle = |k: usize| self.bones[usize::from(chain[k])].middle;
        let after = chain.partition_point(|j| self.bones[usize::from(*j)].middle <= s);
        match (after.checked_sub(1), chain.get(after)) {
            (None, None) => mix.add(self.carriers[a], share),
            (None, Some(first)) => mix.add(*first, share),
            (Some(last), None) => mix.add(chain[last], share),
            (Some(k), Some(next)) => {
                let t = (s - middle(k)) / (middle(after) - middle(k)).max(1e-9);
                mix.add(chain[k], share * (1.0 - t));
                mix.add(*next, share * t);
            }
        }
    }

    /// Parent-from-joint transforms of all joints for bends of the elements, rad.
    pub fn pose(&self, elements: &BeamElements, bends: &[[f32; 2]]) -> Vec<Trs> {
        let bases = elements.base_rotations(bends);
        let turns: Vec<Quat> = self.bones.iter().map(|b| elements.rotation_at(&bases, bends, b.spot)).collect();
        // Rotations are absolute; a joint stores its rotation relative to the parent.
        let local = |(joint, q): (&Joint, &Quat)| {
            let parent = joint.parent.and_then(|p| turns.get(p as usize)).copied().unwrap_or(Quat::IDENTITY);
            Trs { r: (parent.conjugate() * *q).normalize(), ..joint.rest }
        };
        self.skeleton.joints.iter().zip(&turns).map(local).collect()
    }
}

/// Number of joints of each element within the budget, most visible elements first; joint 0 is the root.
fn joints_per_element(elements: &BeamElements, budget: usize) -> Vec<usize> {
    let mut counts = vec![0; elements.list.len()];
    // Greedy in the order of visibility; an element needs a carrier with joints.
    let mut left = budget.saturating_sub(1);
    for &e in &elements.ranked {
        let element = &elements.list[e as usize];
        let wanted = joints_per_order(element.order, elements.coarse);
        let carried = element.parent == NONE || counts[element.parent as usize] > 0;
        if carried && wanted <= left {
            counts[e as usize] = wanted;
            left -= wanted;
        }
    }
    counts
}

/// Weights of a vertex, summed per joint.
#[derive(Default)]
struct JointWeights {
    items: [(u16, f32); 6],
    count: usize,
}

impl JointWeights {
    fn add(&mut self, joint: u16, weight: f32) {
        // A point follows at most two joints of its axis and two of the parent's, so six places suffice.
        if let Some((_, w)) = self.items[..self.count].iter_mut().find(|(j, _)| *j == joint) {
            *w += weight;
        } else if let Some(free) = self.items.get_mut(self.count) {
            *free = (joint, weight);
            self.count += 1;
        }
    }

    fn normalize_heaviest(mut self) -> ([u16; 4], [f32; 4]) {
        let used = &mut self.items[..self.count];
        used.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        // Four joints is what file formats hold; negligible weights only cost memory.
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
#[allow(clippy::cast_possible_truncation, reason = "small plants")]
mod tests {
    use super::*;
    use crate::sway::segments::ElementBudget;
    use crate::sway::testing::tree;
    use crate::sway::wood::WoodParams;

    fn rig(plant: &Plant, joints: usize) -> (BeamElements, JointRig) {
        let elements = BeamElements::build(plant, &WoodParams::default(), ElementBudget::Joints(joints));
        let rig = JointRig::build(plant, &elements, joints);
        (elements, rig)
    }

    #[test]
    fn joints_are_in_depth_first_order() {
        let plant = tree(5);
        let (elements, rig) = rig(&plant, 256);
        assert_eq!(rig.skeleton.joints.len(), 1 + 4 + 5 * 2 + 5);
        assert_eq!(elements.list.len(), 11);
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
            let site = plant.frame(&plant.axes[bone.axis as usize], bone.pivot);
            assert!((bind.t - site.p).length() < 1e-5 && bind.r == Quat::IDENTITY);
        }
    }

    #[test]
    fn joint_budget_is_kept_and_riders_follow_their_carrier() {
        let plant = tree(50);
        let (_, rig) = rig(&plant, 64);
        assert!(rig.skeleton.joints.len() <= 64);
        let rider = (0..plant.axes.len()).find(|&a| rig.chains[a].is_empty()).expect("some do not fit");
        let (joints, weights) = rig.weights(&plant, rider as u32, plant.axes[rider].length);
        assert_eq!((joints[0], weights[0]), (rig.carriers[rider], 1.0));
    }

    #[test]
    fn skin_weights_sum_to_one_and_collars_follow_the_parent() {
        let plant = tree(5);
        let (_, rig) = rig(&plant, 256);
        for a in 0..plant.axes.len() as u32 {
            for i in 0..=20_u8 {
                let s = plant.axes[a as usize].length * f32::from(i) / 20.0;
                let (joints, weights) = rig.weights(&plant, a, s);
                let sum = weights.iter().fold(0.0, |t, w| t + w);
                assert!((sum - 1.0).abs() < 1e-6 && weights.windows(2).all(|w| w[0] >= w[1]), "{weights:?}");
                assert!(joints.iter().zip(weights).all(|(j, w)| w > 0.0 || *j == 0));
            }
        }
        let fork = plant.axes[1].parent_s;
        assert_eq!(rig.weights(&plant, 1, 0.0), rig.weights(&plant, 0, fork), "the base follows the trunk");
    }

    #[test]
    fn bends_rotate_joints_about_their_own_axes_only() {
        let plant = tree(5);
        let (elements, rig) = rig(&plant, 256);
        let mut bends = vec![[0.0; 2]; elements.list.len()];
        assert!(rig.pose(&elements, &bends).iter().all(|t| t.r == Quat::IDENTITY));
        bends[0] = [0.3, 0.0];
        let pose = rig.skeleton.asset_from_joint(&rig.pose(&elements, &bends));
        // Everything turns with the trunk, the more the higher it stands, never by more than its tip.
        for (bone, p) in rig.bones.iter().zip(&pose).skip(1) {
            let turned = p.r.to_axis_angle().1;
            assert!(turned > 0.0 && turned <= 0.3 + 1e-5, "{bone:?} {turned}");
        }
        assert_eq!(pose[0], Trs::IDENTITY);
    }
}
