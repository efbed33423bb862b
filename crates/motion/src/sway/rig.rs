//! Skeleton of a plant within a joint budget, with skin weights.
//!
//! Elements get joints: four on a trunk, two on main branches, one on others. A joint has the rotation at the middle
//! of its stretch; branches beyond the budget move rigidly with the nearest joint of their carrier. Branches get joints by
//! size: either all branches of one order and class of length, or none. If the lengths form no classes, the bend fades out
//! towards the length below which branches have no joints, so that branches of one size move alike. Where few branches are much
//! longer than the others of their order, what they leave of the budget goes to the branches on them.

use glam::Quat;

use super::elements::{BeamElements, BoundLocation, ElementLocation};
use super::pose::own_share;
use crate::sway::tuning::{CLASS_GAP, JOINT_FADE};
use osier_base::math;
use osier_scene::plant::{NONE, Organ, Plant};
use osier_scene::{Joint, JointBranch, Skeleton, SkinWeights, Trs};

#[derive(Debug, Clone, Copy, PartialEq)]
struct RigJoint {
    /// Index of its axis, or [`NONE`] for the root joint.
    axis: u32,
    /// Location on the elements whose rotation the joint has.
    spot: ElementLocation,
    /// `spot` with the slopes there.
    bound: BoundLocation,
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
    /// Axis, location and pivot of each joint, parallel to the joints of the skeleton.
    bones: Vec<RigJoint>,
    /// Per axis: its joints from base to tip; empty for a rigid axis.
    chains: Vec<Vec<u16>>,
    /// Per axis: the joint that its base follows.
    carriers: Vec<u16>,
    /// Per bend of the elements: fraction of it, 0 to 1, by which the joints rotate.
    shares: Vec<f32>,
    /// Elements with joints and the elements that carry them, in rising order: the only ones that a pose evaluates.
    posed: Vec<u32>,
}

/// How many joints a skeleton may have, and how many an element gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JointBudget {
    /// Number of joints, root included, at least 1 and at most 65,535.
    pub joints: usize,
    /// Whether a trunk gets two joints and any other element one, in place of four, two and one.
    pub coarse: bool,
}

/// A joint that the depth-first traversal has still to add.
struct JointTask {
    element: u32,
    /// Index among the joints of the element, counted from its base.
    ordinal: usize,
    parent: u16,
}

impl JointRig {
    /// Builds the skeleton: branches get joints by order and length until the budget is exhausted, those on branches without
    /// joints none.
    pub fn build(plant: &Plant, elements: &BeamElements, budget: JointBudget) -> Self {
        let JointShares { counts, shares } = JointShares::new(plant, elements, budget);
        let still = ElementLocation { element: NONE, at: 0.0 };
        let mut rig = Self {
            skeleton: Skeleton {
                joints: vec![Joint { name: "root".into(), parent: None, rest: Trs::IDENTITY, radius: 0.0 }],
            },
            bones: vec![RigJoint { axis: NONE, spot: still, bound: elements.bind(still), middle: 0.0, pivot: 0.0 }],
            chains: vec![Vec::new(); plant.axes.len()],
            carriers: vec![0; plant.axes.len()],
            shares,
            posed: with_carriers(elements, &counts),
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
            // Children whose base lies within the stretch of this joint; the first and the last joint of an element also take
            // children below and beyond the stretches.
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
        // Joints divide the length of the element evenly; each has its pivot at the start of its stretch.
        let place = |x: f32| element.span[0] + (element.span[1] - element.span[0]) * x / n as f32;
        let (pivot, middle) = (place(k as f32), place(k as f32 + 0.5));
        let chain = &mut self.chains[element.axis as usize];
        let name = format!("a{}_{}", element.axis, chain.len());
        chain.push(joint);
        let site = plant.frame(axis, pivot);
        let rest = Trs::translation(site.p - self.joint_origin(plant, parent));
        self.skeleton.joints.push(Joint { name, parent: Some(u32::from(parent)), rest, radius: site.r });
        let spot = ElementLocation { element: e, at: (k as f64 + 0.5) / n as f64 };
        self.bones.push(RigJoint { axis: element.axis, spot, bound: elements.bind(spot), middle, pivot });
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
    pub fn joint_at(&self, a: usize, s: f32) -> u16 {
        let chain = &self.chains[a];
        let before = chain.partition_point(|j| self.bones[usize::from(*j)].pivot <= s);
        chain.get(before.saturating_sub(1)).copied().unwrap_or(self.carriers[a])
    }

    /// Joint whose stretch an organ grows on; for a rigid axis, the joint that carries it.
    pub fn organ_joint(&self, organ: &Organ) -> u16 {
        self.joint_at(organ.axis as usize, organ.s)
    }

    /// The branch that each joint bends, parallel to the joints of the skeleton; `None` for the root. The compliance of a joint
    /// is that of the middle of its stretch, whose rotation it has.
    pub fn branches(&self, plant: &Plant, elements: &BeamElements) -> Vec<Option<JointBranch>> {
        let bases = elements.base_slopes();
        let branch = |bone: &RigJoint| {
            let axis = plant.axes.get(bone.axis as usize)?;
            Some(JointBranch { axis: bone.axis, order: axis.order, compliance: elements.slope_at(&bases, bone.spot) })
        };
        self.bones.iter().map(branch).collect()
    }

    /// Skin weights of bark vertices, in the order of `bindings`: axis and arc length, m, of each vertex.
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
        // Near a fork the weights of both axes blend in the same way as the bark.
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

    /// Parent-from-joint transforms of all joints. `bends`: both angles of each element, rad, then those of second modes.
    pub fn pose(&self, elements: &BeamElements, bends: &[[f32; 2]]) -> Vec<Trs> {
        let bends: Vec<[f32; 2]> = bends.iter().zip(&self.shares).map(|(b, share)| b.map(|b| b * share)).collect();
        let bases = elements.base_rotations_of(&bends, &self.posed);
        let turns: Vec<Quat> = self.bones.iter().map(|b| elements.rotation_at(&bases, &bends, b.bound)).collect();
        // Rotations are absolute; a joint stores its rotation relative to the parent.
        let local = |(joint, q): (&Joint, &Quat)| {
            let parent = joint.parent.and_then(|p| turns.get(p as usize)).copied().unwrap_or(Quat::IDENTITY);
            Trs { r: (parent.conjugate() * *q).normalize(), ..joint.rest }
        };
        self.skeleton.joints.iter().zip(&turns).map(local).collect()
    }
}

/// Elements that have joints, and all elements between them and the ground, in rising order.
fn with_carriers(elements: &BeamElements, counts: &[usize]) -> Vec<u32> {
    let mut wanted: Vec<bool> = counts.iter().map(|count| *count > 0).collect();
    // A carrier stands before what it carries: one pass from the end marks whole chains.
    for (k, element) in elements.list.iter().enumerate().rev() {
        if wanted[k] && element.parent != NONE {
            wanted[element.parent as usize] = true;
        }
    }
    (0..).zip(wanted).filter(|(_, wanted)| *wanted).map(|(k, _)| k).collect()
}

/// Distribution of a joint budget to the elements.
struct JointShares {
    /// Number of joints of each element.
    counts: Vec<usize>,
    /// Fraction of each bend by which the joints rotate: of first modes, then of second modes.
    shares: Vec<f32>,
}

/// A branch that may get joints: the elements of one axis.
struct Bough<'a> {
    elements: &'a [u32],
    order: u8,
    /// Length of its axis, m.
    length: f32,
}

impl JointShares {
    /// Distributes the joints of a budget by order and length; joint 0 is the root.
    fn new(plant: &Plant, elements: &BeamElements, budget: JointBudget) -> Self {
        let of_axis = |e: &u32| elements.list[*e as usize].axis;
        let bough = |list| {
            let first: &[u32] = list;
            let axis = &plant.axes[of_axis(&first[0]) as usize];
            Bough { elements: first, order: axis.order, length: axis.length }
        };
        // The elements of one axis follow each other in the ranking.
        let boughs: Vec<Bough<'_>> = elements.ranked.chunk_by(|a, b| of_axis(a) == of_axis(b)).map(bough).collect();
        let joints = |bough: &Bough<'_>, k: usize| joints_per_order(bough.order, budget.coarse || k > 0);
        let budgeted = budget.joints.clamp(1, 65_535) - 1;
        let mut left = budgeted;
        let mut all = Self { counts: vec![0; elements.list.len()], shares: vec![1.0; elements.bend_count()] };
        // Order by order, take as many boughs as the budget holds in the order of size. A bough on a carrier without joints is
        // rigid with it.
        for of_order in boughs.chunk_by(|a, b| a.order == b.order) {
            let has_carrier = |bough: &&Bough<'_>| {
                let parent = elements.list[bough.elements[0] as usize].parent;
                all.counts.get(parent as usize).is_none_or(|count| *count > 0)
            };
            let carried: Vec<&Bough<'_>> = of_order.iter().filter(has_carrier).collect();
            let wanted = |bough: &Bough<'_>| (0..bough.elements.len()).map(|k| joints(bough, k)).sum::<usize>();
            let mut rest = left;
            let fits = |bough: &&&Bough<'_>| match rest.checked_sub(wanted(bough)) {
                Some(less) => {
                    rest = less;
                    true
                }
                None => false,
            };
            let fitting = carried.iter().take_while(fits).count();
            let SizeCut { count, fade } = SizeCut::new(&carried, fitting);
            for bough in &carried[..count] {
                let share = fade.map_or(1.0, |[from, to]| math::smoothstep(from, to, bough.length));
                for (k, e) in bough.elements.iter().enumerate() {
                    let element = &elements.list[*e as usize];
                    all.counts[*e as usize] = joints(bough, k);
                    for bend in [Some(*e as usize), element.second_mode].into_iter().flatten() {
                        all.shares[bend] = share;
                    }
                }
                left -= wanted(bough);
            }
            // Where the boughs of an order are of two classes and the longer class is small, the next order uses what it leaves.
            let is_cut = count < carried.len();
            let leaves_most = fade.is_none() && count > 0 && left > budgeted / 2;
            if is_cut && !leaves_most {
                break;
            }
        }
        all
    }
}

/// Boundary between branches with and without joints, among branches of one order, sorted by falling length.
struct SizeCut {
    /// Number of branches with joints.
    count: usize,
    /// Lengths, m, up to which the bends of branches are 0 and from which they are complete; `None`: all are complete.
    fade: Option<[f32; 2]>,
}

impl SizeCut {
    /// `fitting`: number of branches that the budget holds.
    fn new(boughs: &[&Bough<'_>], fitting: usize) -> Self {
        let clean = |count| Self { count, fade: None };
        let Some(next) = boughs.get(fitting).filter(|_| fitting > 0) else { return clean(fitting) };
        // A wide gap between two lengths divides the order into classes; the shorter class gets no joints.
        let gap = |k: usize| boughs[k - 1].length / boughs[k].length.max(1e-9);
        let widest = (1..=fitting).max_by(|a, b| gap(*a).total_cmp(&gap(*b)));
        if let Some(k) = widest.filter(|k| gap(*k) >= CLASS_GAP) {
            return clean(k);
        }
        // Without classes the bend grows from 0 at the length of the longest branch without joints.
        let (from, longest) = (next.length, boughs[0].length);
        let to = (from * JOINT_FADE).min(longest);
        if to <= from * 1.001 { clean(fitting) } else { Self { count: fitting, fade: Some([from, to]) } }
    }
}

/// Number of joints of an element by its branching order.
fn joints_per_order(order: u8, coarse: bool) -> usize {
    match order {
        0 if coarse => 2,
        0 => 4,
        1 if !coarse => 2,
        _ => 1,
    }
}

/// Weights of a vertex, summed per joint.
#[derive(Default)]
struct JointWeights {
    items: [(u16, f32); 6],
    count: usize,
}

impl JointWeights {
    fn add(&mut self, joint: u16, weight: f32) {
        // A point follows at most two joints of its axis and two of the parent axis, so that six entries suffice.
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
        // File formats hold four joints per vertex; negligible weights only cost memory.
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
    use crate::sway::testing::{axis, rod, tree};
    use crate::sway::wood::WoodParams;

    fn rig(plant: &Plant, joints: usize) -> (BeamElements, JointRig) {
        let elements = BeamElements::build(plant, &WoodParams::default(), 2000);
        let rig = JointRig::build(plant, &elements, JointBudget { joints, coarse: false });
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

    /// A trunk with upright branches of these lengths, m.
    fn comb(lengths: impl IntoIterator<Item = f32>) -> Plant {
        let mut plant = rod(4.0, 0.1, 0.04);
        for (i, length) in (0_u16..).zip(lengths) {
            let s = 0.5 + 0.03 * f32::from(i);
            axis(&mut plant, (0, s), (glam::Vec3::Y * s, glam::Vec3::X * length), (0.01, 0.008));
        }
        plant
    }

    #[test]
    fn branches_of_one_class_of_length_get_joints_or_none() {
        // 20 long and 80 short branches: the budget holds some of the short ones, too.
        let plant = comb((0..100_u8).map(|i| if i % 5 == 0 { 1.5 } else { 0.5 } + 0.001 * f32::from(i)));
        let (_, rig) = rig(&plant, 128);
        let with = |long: bool| {
            let boughs = (1..plant.axes.len()).filter(|a| (plant.axes[*a].length > 1.0) == long);
            boughs.filter(|a| !rig.chains[*a].is_empty()).count()
        };
        assert_eq!((with(true), with(false)), (20, 0));
        assert!(rig.shares.iter().all(|s| *s >= 1.0));
    }

    #[test]
    fn joints_that_a_small_class_of_branches_leaves_go_to_the_branches_on_them() {
        // Three limbs, 100 twigs on the trunk and 20 branches on each limb: the limbs need 10 joints of 127.
        let mut plant = comb((0..103_u8).map(|i| if i < 3 { 3.0 } else { 0.4 } - 0.001 * f32::from(i)));
        let bases: Vec<glam::Vec3> = (1..4).map(|a| plant.nodes.p[plant.nodes_of(&plant.axes[a]).start]).collect();
        for (limb, base) in bases.into_iter().enumerate() {
            for i in 0..20_u8 {
                let s = 0.5 + 0.1 * f32::from(i);
                let along = base + glam::Vec3::X * s;
                axis(&mut plant, (limb as u32 + 1, s), (along, along + glam::Vec3::Y * 0.8), (0.006, 0.004));
            }
        }
        let (_, rig) = rig(&plant, 128);
        let with = |axes: std::ops::Range<usize>| axes.filter(|a| !rig.chains[*a].is_empty()).count();
        assert_eq!([with(1..4), with(4..104), with(104..164)], [3, 0, 60]);
    }

    #[test]
    fn bends_fade_out_towards_the_length_without_joints() {
        let plant = comb((0..100_u8).map(|i| 0.5 + 0.015 * f32::from(i)));
        let (elements, rig) = rig(&plant, 128);
        let share = |a: usize| {
            if rig.chains[a].is_empty() { 0.0 } else { rig.shares[elements.locate(a as u32, 0.1).element as usize] }
        };
        let shares: Vec<f32> = (1..plant.axes.len()).map(share).collect();
        assert!(shares.windows(2).all(|w| w[0] <= w[1] && w[1] - w[0] < 0.1), "longer branches show more: {shares:?}");
        assert!(shares[0] <= 0.0 && shares[99] >= 1.0);
        // Twice the share of a bend is twice the rotation.
        let faded = (0..100).find(|k| (0.3..0.7).contains(&shares[*k])).expect("one between");
        let mut bends = vec![[0.0; 2]; elements.list.len()];
        let e = elements.locate(faded as u32 + 1, 0.1).element as usize;
        bends[e] = [0.2, 0.0];
        let turned = rig.pose(&elements, &bends)[usize::from(rig.chains[faded + 1][0])].r.to_axis_angle().1;
        let full = elements.rotation_at(
            &elements.base_rotations(&bends),
            &bends,
            rig.bones[usize::from(rig.chains[faded + 1][0])].bound,
        );
        assert!((turned / (full.to_axis_angle().1 * shares[faded]) - 1.0).abs() < 1e-3);
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
    fn joints_comply_more_along_a_branch_than_where_it_springs_from_and_less_in_stiffer_wood() {
        let plant = tree(5);
        let compliances = |stiffness| {
            let wood = WoodParams { stiffness, measured: true, ..WoodParams::default() };
            let elements = BeamElements::build(&plant, &wood, 2000);
            let rig = JointRig::build(&plant, &elements, JointBudget { joints: 256, coarse: false });
            let branches = rig.branches(&plant, &elements);
            assert!(branches[0].is_none() && branches[1..].iter().all(Option::is_some));
            for (joint, branch) in rig.skeleton.joints.iter().zip(&branches).skip(1) {
                let parent = joint.parent.and_then(|p| branches[p as usize]);
                let (own, carrier) = (branch.map_or(0.0, |b| b.compliance), parent.map_or(0.0, |b| b.compliance));
                // A limb springs from below the middle of its carrier's joint at worst by half of that joint's stretch.
                assert!(own > 0.0 && (own > carrier || parent.map(|p| p.axis) != branch.map(|b| b.axis)));
            }
            branches.into_iter().flatten().map(|b| b.compliance).collect::<Vec<f64>>()
        };
        let (soft, stiff) = (compliances(1.0), compliances(2.0));
        assert!(soft.iter().zip(&stiff).all(|(a, b)| (a / b - 2.0).abs() < 1e-9), "{soft:?} {stiff:?}");
        // The slope of a beam under a pressure is the sum of drag area times compliance over its stations.
        let elements = BeamElements::build(&plant, &WoodParams::default(), 1);
        let trunk = &elements.list[0];
        let stations = &elements.stations[trunk.stations.clone()];
        let drag = |load: &crate::sway::BranchLoad| 1.1 * load.wood + 0.4 * load.leaf;
        let wanted = stations.iter().map(|s| drag(&s.load) * s.tip_compliances[0]).sum::<f64>();
        assert!((trunk.pressure_slope / wanted - 1.0).abs() < 1e-6, "{} {wanted}", trunk.pressure_slope);
    }

    #[test]
    fn bends_rotate_joints_about_their_own_axes_only() {
        let plant = tree(5);
        let (elements, rig) = rig(&plant, 256);
        let mut bends = vec![[0.0; 2]; elements.list.len()];
        assert!(rig.pose(&elements, &bends).iter().all(|t| t.r == Quat::IDENTITY));
        bends[0] = [0.3, 0.0];
        let pose = rig.skeleton.asset_from_joint(&rig.pose(&elements, &bends));
        // All joints rotate with the trunk, more at greater heights, but never by more than its tip.
        for (bone, p) in rig.bones.iter().zip(&pose).skip(1) {
            let turned = p.r.to_axis_angle().1;
            assert!(turned > 0.0 && turned <= 0.3 + 1e-5, "{bone:?} {turned}");
        }
        assert_eq!(pose[0], Trs::IDENTITY);
    }
}
