//! Which joints of a rig are written, their names, and the chains of them that the engine bends together.

use std::collections::BTreeMap;

use osier_base::Result;
use osier_base::convert::narrow;
use osier_scene::{Joint, JointBranch, RiggedPlant, Skeleton};

/// Highest simulation group; the trunk has group 0. Own: branches of the eighth order are twigs of twigs, and every group is one
/// more setting of the engine's wind.
const MAX_GROUP: usize = 7;

/// Distance, m, up to which two pivots are the same.
const SAME_PIVOT: f32 = 1e-4;

/// The joints of a rig that are written.
///
/// The engine bends each run of joints of one simulation group as one chain. Therefore each joint has at most one child of its
/// group: the next joint of the same axis continues the chain, and where an axis ends in a fork, the thicker half continues it;
/// every other axis begins a chain of the next group.
#[derive(Debug)]
pub(super) struct WindJoints {
    /// Joints that are written, parents first, with the names that the file has.
    pub(super) skeleton: Skeleton,
    /// Simulation group of each written joint.
    pub(super) groups: Vec<usize>,
    /// For each written joint whether another joint of its group follows.
    pub(super) continues: Vec<bool>,
    /// Angle by which each written joint turns under a dynamic pressure of 1 Pa, rad/Pa; 0 for a joint without a branch,
    /// such as a root with several stems.
    pub(super) compliances: Vec<f64>,
    /// For each joint of the rig the written joint that moves its geometry: itself or the nearest written ancestor.
    pub(super) carrier: Vec<u16>,
}

impl WindJoints {
    /// Selects, groups and names the joints of a rig.
    /// # Errors
    /// `TooMany` beyond 65,535 joints.
    pub(super) fn new(rig: &RiggedPlant) -> Result<Self> {
        let branch = |i: usize| rig.branches.get(i).copied().flatten();
        let followers = followers(rig);
        let mut written = Self {
            skeleton: Skeleton::default(),
            groups: Vec::new(),
            continues: Vec::new(),
            compliances: Vec::new(),
            carrier: Vec::with_capacity(rig.skeleton.joints.len()),
        };
        let mut on_axis: BTreeMap<u32, usize> = BTreeMap::new();
        let mut on_trunk = 0;
        let mut is_written: Vec<bool> = Vec::with_capacity(rig.skeleton.joints.len());
        let only_stem = only_stem(rig);
        for (i, joint) in rig.skeleton.joints.iter().enumerate() {
            let parent = joint.parent.map(|p| p as usize);
            let carrier = parent.and_then(|p| written.carrier.get(p)).copied();
            // A joint without length between root and trunk would be a degenerate bone: the first joint of the only stem is the
            // root.
            if only_stem == Some(i) {
                if let Some(root) = written.compliances.first_mut() {
                    *root = branch(i).map_or(0.0, |b| b.compliance);
                }
                written.carrier.push(0);
                is_written.push(true);
                continue;
            }
            // A joint is written if its parent is written and its group exists; else the carrier of
            // its parent moves its geometry.
            let group = match (parent, carrier) {
                // The joint that continues its parent's chain keeps the parent's group; any other child begins a chain in the next group.
                (Some(p), Some(c)) if followers.get(p).copied().flatten() == Some(i) => written.groups[usize::from(c)],
                (Some(_), Some(c)) => written.groups[usize::from(c)] + 1,
                _ => 0,
            };
            if group > MAX_GROUP || parent.is_some_and(|p| !is_written[p]) {
                written.carrier.push(carrier.unwrap_or(0));
                is_written.push(false);
                continue;
            }
            let own: u16 = narrow(written.groups.len(), "joints of a plant")?;
            let name = match branch(i) {
                Some(JointBranch { axis, .. }) if group > 0 => {
                    let count = on_axis.entry(axis).or_insert(0);
                    let name = format!("{}_{axis}_{count}", if group == 1 { "limb" } else { "twig" });
                    *count += 1;
                    name
                }
                _ => {
                    on_trunk += 1;
                    format!("trunk_{}", on_trunk - 1)
                }
            };
            if let Some(slot) = carrier.filter(|c| written.groups[usize::from(*c)] == group) {
                written.continues[usize::from(slot)] = true;
            }
            written.groups.push(group);
            written.continues.push(false);
            written.compliances.push(branch(i).map_or(0.0, |b| b.compliance));
            written.skeleton.joints.push(Joint { name, parent: carrier.map(u32::from), ..joint.clone() });
            written.carrier.push(own);
            is_written.push(true);
        }
        Ok(written)
    }
}

/// The first joint of the only stem of a rig, if it pivots where the root does.
fn only_stem(rig: &RiggedPlant) -> Option<usize> {
    let mut stems = rig.skeleton.joints.iter().enumerate().filter(|(_, j)| j.parent == Some(0));
    let (first, joint) = stems.next()?;
    (stems.next().is_none() && joint.rest.t.length() < SAME_PIVOT).then_some(first)
}

/// For each joint of a rig the child that continues its chain, if there is one.
fn followers(rig: &RiggedPlant) -> Vec<Option<usize>> {
    let joints = &rig.skeleton.joints;
    let branch = |i: usize| rig.branches.get(i).copied().flatten();
    let axis = |i: usize| branch(i).map(|b| b.axis);
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); joints.len()];
    for (i, joint) in joints.iter().enumerate() {
        if let Some(list) = joint.parent.and_then(|p| children.get_mut(p as usize)) {
            list.push(i);
        }
    }
    let follower = |(p, list): (usize, &Vec<usize>)| {
        let is_root = branch(p).is_none();
        // The next joint of the same axis comes first. After the last one, the thicker half of a fork continues the
        // axis.
        if let Some(next) = list.iter().find(|c| !is_root && axis(**c) == axis(p)) {
            return Some(*next);
        }
        let order = branch(p).map_or(0, |b| b.order);
        let halves: Vec<usize> =
            list.iter().copied().filter(|c| branch(*c).is_some_and(|b| b.order == order)).collect();
        // If several stems begin at the root, none of them is the trunk.
        if is_root && halves.len() > 1 {
            return None;
        }
        halves.into_iter().max_by(|a, b| joints[*a].radius.total_cmp(&joints[*b].radius).then(b.cmp(a)))
    };
    children.iter().enumerate().map(follower).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use osier_scene::Trs;

    /// Joints from their parents and the axis, order and radius of their branches.
    fn rig(joints: &[(Option<u32>, u32, u8, f32)]) -> RiggedPlant {
        let joint = |(i, (parent, _, _, radius)): (usize, &(Option<u32>, u32, u8, f32))| Joint {
            name: format!("j{i}"),
            parent: *parent,
            rest: Trs::translation(Vec3::Y * if i == 0 { 0.0 } else { 0.5 }),
            radius: *radius,
        };
        let branch = |(parent, axis, order, _): &(Option<u32>, u32, u8, f32)| {
            parent.map(|_| JointBranch { axis: *axis, order: *order, compliance: 1.0 })
        };
        RiggedPlant {
            skeleton: Skeleton { joints: joints.iter().enumerate().map(joint).collect() },
            branches: joints.iter().map(branch).collect(),
            ..RiggedPlant::default()
        }
    }

    fn names(written: &WindJoints) -> Vec<&str> {
        written.skeleton.joints.iter().map(|j| j.name.as_str()).collect()
    }

    #[test]
    fn a_fork_continues_the_trunk_in_its_thicker_half_and_limbs_begin_groups() {
        let all = [
            (None, 0, 0, 0.0),
            (Some(0), 0, 0, 0.3),
            (Some(1), 5, 1, 0.4),
            (Some(2), 5, 1, 0.1),
            (Some(1), 0, 0, 0.2),
            (Some(4), 1, 0, 0.1),
            (Some(4), 2, 0, 0.15),
            (Some(6), 7, 1, 0.01),
        ];
        let written = WindJoints::new(&rig(&all)).expect("few");
        assert_eq!(written.groups, [0, 0, 1, 1, 0, 1, 0, 1]);
        assert_eq!(
            names(&written),
            ["trunk_0", "trunk_1", "limb_5_0", "limb_5_1", "trunk_2", "limb_1_0", "trunk_3", "limb_7_0"]
        );
        assert_eq!(written.continues, [true, true, true, false, true, false, false, false]);
    }

    #[test]
    fn the_only_stem_begins_with_the_root_if_it_stands_on_it() {
        let all = [(None, 0, 0, 0.0), (Some(0), 0, 0, 0.3), (Some(1), 0, 0, 0.2), (Some(1), 1, 1, 0.1)];
        let mut rig = rig(&all);
        rig.skeleton.joints[1].rest = Trs::IDENTITY;
        let written = WindJoints::new(&rig).expect("few");
        assert_eq!(names(&written), ["trunk_0", "trunk_1", "limb_1_0"]);
        assert_eq!((written.groups, written.carrier), (vec![0, 0, 1], vec![0, 0, 1, 2]));
        assert_eq!(written.skeleton.joints.iter().map(|j| j.parent).collect::<Vec<_>>(), [None, Some(0), Some(0)]);
        assert!((written.compliances[0] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn none_of_several_stems_of_a_root_is_the_trunk() {
        let all = [(None, 0, 0, 0.0), (Some(0), 0, 0, 0.3), (Some(0), 1, 0, 0.2), (Some(2), 1, 0, 0.1)];
        let written = WindJoints::new(&rig(&all)).expect("few");
        assert_eq!(written.groups, [0, 1, 1, 1]);
        assert_eq!(names(&written), ["trunk_0", "limb_0_0", "limb_1_0", "limb_1_1"]);
    }

    #[test]
    fn what_springs_from_the_last_group_follows_it_rigidly() {
        // Every joint is the first one of an axis that springs from the one before.
        let deep: Vec<_> =
            (0..12_u8).map(|i| (i.checked_sub(1).map(u32::from), u32::from(i), i.saturating_sub(1), 0.1)).collect();
        let written = WindJoints::new(&rig(&deep)).expect("few");
        assert_eq!(written.groups, [0, 0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(written.carrier, [0, 1, 2, 3, 4, 5, 6, 7, 8, 8, 8, 8]);
    }
}
