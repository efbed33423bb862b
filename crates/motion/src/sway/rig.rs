//! Joints for a plant within a budget, and what hangs on them.
//!
//! Elements that bend get joints: four on a trunk, two on main branches, one on the rest. A joint takes the turn of the
//! middle of its stretch; what does not fit the budget rides rigidly on the nearest joint of what carries it.

use glam::Quat;

use super::elements::{BeamElements, ElementLocation};
use super::pose::own_share;
use super::segments::joints_per_order;
use osier_scene::plant::{NONE, Organ, Plant};
use osier_scene::{Joint, Skeleton, SkinWeights, Trs};

/// One joint's place in the plant.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RigJoint {
    /// Axis that it is on, or [`NONE`] for the root joint.
    axis: u32,
    /// What turns it.
    spot: ElementLocation,
    /// Arc length on the axis of the middle of its stretch, m.
    middle: f32,
    /// The same of its pivot.
    pivot: f32,
}

/// A skeleton with the elements that turn it. All rest rotations are the identity, so a joint's rotation is a turn about
/// axes of the plant's own space.
#[derive(Debug, Clone)]
pub struct JointRig {
    /// Joints; joint 0 stands still at the origin.
    pub skeleton: Skeleton,
    /// Parallel to the joints.
    bones: Vec<RigJoint>,
    /// Per axis its joints from base to tip; empty for an axis that rides on another.
    chains: Vec<Vec<u16>>,
    /// Per axis the joint that its base rides on.
    carriers: Vec<u16>,
}

/// A joint that the depth-first walk has still to add.
struct JointTask {
    element: u32,
    /// Which of the element's joints, from its base.
    ordinal: usize,
    /// Joint that it is a child of.
    parent: u16,
}

impl JointRig {
    /// Gives joints to the elements that count most. `budget`: most joints, at least 1 and at most 65,535.
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

    /// Walks joints depth first, as skeleton files want them: the children carried by a joint come before the joint that
    /// continues its element.
    fn add_in_depth_first_order(&mut self, plant: &Plant, elements: &BeamElements, counts: &[usize]) {
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); elements.list.len()];
        let mut roots = Vec::new();
        for (i, e) in elements.list.iter().enumerate().filter(|(i, _)| counts[*i] > 0) {
            let index = u32::try_from(i).unwrap_or(NONE);
            match children.get_mut(e.parent as usize) {
                Some(list) => list.push(index),
                None => roots.push(index),
            }
        }
        let first = |element: u32, parent: u16| JointTask { element, ordinal: 0, parent };
        let mut tasks: Vec<JointTask> = roots.iter().rev().map(|e| first(*e, 0)).collect();
        while let Some(task) = tasks.pop() {
            let (e, k) = (task.element, task.ordinal);
            let n = counts[e as usize];
            let joint = self.add_joint(plant, elements, &task, n);
            if k + 1 < n {
                tasks.push(JointTask { element: e, ordinal: k + 1, parent: joint });
            }
            let carried = |c: &&u32| {
                let place = elements.list[**c as usize].at * n as f64;
                (k == 0 || place >= k as f64) && (k + 1 == n || place < (k + 1) as f64)
            };
            tasks.extend(children[e as usize].iter().rev().filter(carried).map(|c| first(*c, joint)));
        }
    }

    /// Adds one of the `n` joints of an element and returns its index.
    fn add_joint(&mut self, plant: &Plant, elements: &BeamElements, task: &JointTask, n: usize) -> u16 {
        let JointTask { element: e, ordinal: k, parent } = *task;
        let element = &elements.list[e as usize];
        let axis = &plant.axes[element.axis as usize];
        let place = |x: f32| element.span[0] + (element.span[1] - element.span[0]) * x / n as f32;
        let (pivot, middle) = (place(k as f32), place(k as f32 + 0.5));
        let joint = u16::try_from(self.bones.len()).unwrap_or(u16::MAX);
        let chain = &mut self.chains[element.axis as usize];
        let name = format!("a{}_{}", element.axis, chain.len());
        chain.push(joint);
        let t = plant.frame(axis, pivot).p - self.origin(plant, parent);
        self.skeleton.joints.push(Joint { name, parent: Some(u32::from(parent)), rest: Trs::translation(t) });
        let at = (k as f64 + 0.5) / n as f64;
        self.bones.push(RigJoint { axis: element.axis, spot: ElementLocation { element: e, at }, middle, pivot });
        joint
    }

    /// Pivot of a joint at rest.
    fn origin(&self, plant: &Plant, joint: u16) -> glam::Vec3 {
        let bone = &self.bones[usize::from(joint)];
        plant.axes.get(bone.axis as usize).map_or(glam::Vec3::ZERO, |axis| plant.frame(axis, bone.pivot).p)
    }

    /// Parents stand before their children, so one pass suffices.
    fn find_carriers(&mut self, plant: &Plant) {
        for (i, axis) in plant.axes.iter().enumerate() {
            self.carriers[i] = if axis.parent == NONE { 0 } else { self.nearest(axis.parent as usize, axis.parent_s) };
        }
    }

    /// The joint that moves axis `a` at arc length `s` as a rigid body: the one whose stretch holds `s`.
    fn nearest(&self, a: usize, s: f32) -> u16 {
        let chain = &self.chains[a];
        let before = chain.partition_point(|j| self.bones[usize::from(*j)].pivot <= s);
        chain.get(before.saturating_sub(1)).copied().unwrap_or(self.carriers[a])
    }

    /// The joint that an organ rides on.
    pub fn organ_joint(&self, organ: &Organ) -> u16 {
        self.nearest(organ.axis as usize, organ.s)
    }

    /// Weights of bark vertices. `bindings`: axis and arc length (m) per vertex.
    pub fn skin(&self, plant: &Plant, bindings: impl IntoIterator<Item = (u32, f32)>) -> SkinWeights {
        let mut skin = SkinWeights::default();
        for (axis, s) in bindings {
            let (joints, weights) = self.weights(plant, axis, s);
            skin.joints.push(joints);
            skin.weights.push(weights);
        }
        skin
    }

    /// Up to four joints of one point, heaviest first, sum 1.
    fn weights(&self, plant: &Plant, a: u32, s: f32) -> ([u16; 4], [f32; 4]) {
        let mut mix = JointWeights::default();
        let own = own_share(plant, a, s);
        if own > 0.0 {
            self.along(a as usize, s, own, &mut mix);
        }
        if own < 1.0 {
            let axis = &plant.axes[a as usize];
            self.along(axis.parent as usize, axis.parent_s, 1.0 - own, &mut mix);
        }
        mix.finish()
    }

    /// Weights along an axis: 1 at the middle of a joint's stretch, linear between the middles.
    fn along(&self, a: usize, s: f32, share: f32, mix: &mut JointWeights) {
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

    /// Parent-from-joint transforms for bends of the elements, one per joint.
    pub fn pose(&self, elements: &BeamElements, bends: &[[f32; 2]]) -> Vec<Trs> {
        let bases = elements.base_rotations(bends);
        let turns: Vec<Quat> = self.bones.iter().map(|b| elements.rotation_at(&bases, bends, b.spot)).collect();
        let local = |(joint, q): (&Joint, &Quat)| {
            let parent = joint.parent.and_then(|p| turns.get(p as usize)).copied().unwrap_or(Quat::IDENTITY);
            Trs { r: (parent.conjugate() * *q).normalize(), ..joint.rest }
        };
        self.skeleton.joints.iter().zip(&turns).map(local).collect()
    }
}

/// Joints of each element under the budget (joint 0 is the root's).
fn joints_per_element(elements: &BeamElements, budget: usize) -> Vec<usize> {
    let mut counts = vec![0; elements.list.len()];
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

/// A few joints with weights, summed per joint.
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
    fn joints_stand_parents_first_and_depth_first() {
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
    fn the_budget_is_kept_and_riders_follow_their_carrier() {
        let plant = tree(50);
        let (_, rig) = rig(&plant, 64);
        assert!(rig.skeleton.joints.len() <= 64);
        let rider = (0..plant.axes.len()).find(|&a| rig.chains[a].is_empty()).expect("some do not fit");
        let (joints, weights) = rig.weights(&plant, rider as u32, plant.axes[rider].length);
        assert_eq!((joints[0], weights[0]), (rig.carriers[rider], 1.0));
    }

    #[test]
    fn weights_sum_to_one_and_collars_follow_the_parent() {
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
        let stem = plant.axes[1].parent_s;
        assert_eq!(rig.weights(&plant, 1, 0.0), rig.weights(&plant, 0, stem), "the base follows the trunk");
    }

    #[test]
    fn bends_turn_joints_about_their_own_axes_and_nothing_else() {
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
