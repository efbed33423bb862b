//! How far the engine's wind bends each group of joints: the numbers of the attributes and of the JSON file.

use serde::Serialize;

use super::joints::WindJoints;
use osier_base::math;

/// Percentile of the compliances of all tips that gets an influence of 1; the most compliant tips of a plant are outliers.
const FULL_INFLUENCE: f64 = 0.95;
/// Percentile of the compliances of the first joints of a group's chains, which gives the group's least influence.
const LEAST: f64 = 0.10;
/// Percentile of the compliances of the last joints of a group's chains, which gives the group's largest influence.
const MOST: f64 = 0.90;
/// Range of the influences of all groups except the trunk. Own: with less, branches look frozen beside others.
const INFLUENCE_RANGE: [f64; 2] = [0.02, 1.0];
/// Height, m, below which a plant counts as ground cover.
const GROUND_COVER: f32 = 0.5;

/// Parameters of the engine's wind for one plant, under the names of the JSON file.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Wind {
    /// Group of each joint, in the order of the skeleton.
    #[serde(rename = "Joints")]
    pub(super) joints: Vec<WindJoint>,
    /// Groups in the order of their numbers, from the trunk to the twigs.
    #[serde(rename = "SimulationGroups")]
    pub(super) groups: Vec<WindGroup>,
    #[serde(rename = "bIsGroundCover")]
    pub(super) is_ground_cover: bool,
    #[serde(rename = "GustAttenuation")]
    pub(super) gust_attenuation: f32,
}

/// Simulation group of a joint, which the engine finds by its unique name.
#[derive(Debug, Clone, Serialize)]
pub(super) struct WindJoint {
    #[serde(rename = "JointName")]
    pub(super) name: String,
    #[serde(rename = "SimulationGroupIndex")]
    pub(super) group: usize,
}

/// A group of joints: the trunk has one influence, every other group one for the beginnings of its chains and one for their ends.
/// Influences are 0 to 1; those that are not used are 0.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct WindGroup {
    #[serde(rename = "bUseDualInfluence")]
    pub(super) dual: bool,
    #[serde(rename = "Influence")]
    pub(super) influence: f32,
    #[serde(rename = "MinInfluence")]
    pub(super) least: f32,
    #[serde(rename = "MaxInfluence")]
    pub(super) most: f32,
    #[serde(rename = "ShiftTop")]
    pub(super) shift_top: f32,
    #[serde(rename = "bIsTrunkGroup")]
    pub(super) is_trunk: bool,
}

impl Wind {
    /// Computes the influences from the compliances of the written joints. `height`: of the plant at rest, m.
    pub(super) fn new(joints: &WindJoints, height: f32) -> Self {
        let named =
            |(joint, group): (&osier_scene::Joint, &usize)| WindJoint { name: joint.name.clone(), group: *group };
        Self {
            joints: joints.skeleton.joints.iter().zip(&joints.groups).map(named).collect(),
            groups: influences(joints),
            is_ground_cover: height < GROUND_COVER,
            gust_attenuation: 0.0,
        }
    }
}

/// Influences of the groups: compliances of their joints divided by the compliance of typical tips.
fn influences(joints: &WindJoints) -> Vec<WindGroup> {
    let parent = |i: usize| joints.skeleton.joints[i].parent.map(|p| p as usize);
    let is_first = |i: usize| parent(i).is_none_or(|p| joints.groups[p] != joints.groups[i]);
    let of = |wanted: &dyn Fn(usize) -> bool| -> Vec<f64> {
        (0..joints.groups.len()).filter(|i| wanted(*i)).map(|i| joints.compliances[i]).collect()
    };
    // If no joint of a plant bends, there is no typical tip and all influences are minimal.
    let full = percentile(of(&|i| !joints.continues[i]), FULL_INFLUENCE);
    let share = |compliance: f64| if full > 0.0 { compliance / full } else { 0.0 };
    let count = joints.groups.iter().max().map_or(0, |last| last + 1);
    let group = |n: usize| {
        let last = of(&|i| joints.groups[i] == n && !joints.continues[i]);
        if n == 0 {
            let influence = math::narrow(share(percentile(last, 1.0)).min(1.0));
            return WindGroup { dual: false, influence, least: 0.0, most: 0.0, shift_top: 0.0, is_trunk: true };
        }
        let first = of(&|i| joints.groups[i] == n && is_first(i));
        let [low, high] = INFLUENCE_RANGE;
        let least = share(percentile(first, LEAST)).clamp(low, high);
        let most = share(percentile(last, MOST)).clamp(low, high).max(least);
        WindGroup {
            dual: true,
            influence: 0.0,
            least: math::narrow(least),
            most: math::narrow(most),
            shift_top: 0.0,
            is_trunk: false,
        }
    };
    (0..count).map(group).collect()
}

/// A percentile of `values`, interpolated linearly between neighbours; 0 without values. `share`: 0 to 1.
fn percentile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let place = share.clamp(0.0, 1.0) * last as f64;
    // The largest index that is not above the position.
    let below = (0..last).take_while(|k| (k + 1) as f64 <= place).count();
    let above = (below + 1).min(last);
    values[below] + (values[above] - values[below]) * (place - below as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::{Joint, Skeleton, Trs};

    #[test]
    fn percentiles_lie_between_neighbours() {
        let values = vec![4.0, 1.0, 3.0, 2.0, 5.0];
        for (share, wanted) in [(0.0, 1.0), (0.1, 1.4), (0.5, 3.0), (0.95, 4.8), (1.0, 5.0)] {
            assert!((percentile(values.clone(), share) - wanted).abs() < 1e-12);
        }
        assert!(percentile(Vec::new(), 0.5).abs() < 1e-12 && (percentile(vec![7.0], 0.3) - 7.0).abs() < 1e-12);
    }

    /// A trunk of two joints and limbs of two joints each, with these compliances of root, trunk and limbs, rad/Pa.
    fn tree(trunk: [f64; 2], limbs: &[[f64; 2]]) -> WindJoints {
        let joint = |parent| Joint { name: String::new(), parent, rest: Trs::IDENTITY, radius: 0.1 };
        let mut all = WindJoints {
            skeleton: Skeleton { joints: vec![joint(None), joint(Some(0))] },
            groups: vec![0, 0],
            continues: vec![true, false],
            compliances: trunk.to_vec(),
            carrier: Vec::new(),
        };
        for limb in limbs {
            let first = u32::try_from(all.groups.len()).expect("few");
            all.skeleton.joints.extend([joint(Some(1)), joint(Some(first))]);
            all.groups.extend([1, 1]);
            all.continues.extend([true, false]);
            all.compliances.extend(limb);
        }
        all
    }

    #[test]
    fn influences_are_shares_of_a_typical_tip() {
        // All tips of the limbs have 0.1 rad/Pa, so that this is the 95th percentile of the eleven tips.
        let groups = Wind::new(&tree([0.0, 0.02], &[[0.04, 0.1]; 10]), 3.0).groups;
        assert!((groups[0].influence - 0.2).abs() < 1e-6 && groups[0].is_trunk && !groups[0].dual);
        assert!((groups[1].least - 0.4).abs() < 1e-6 && (groups[1].most - 1.0).abs() < 1e-6 && groups[1].dual);
    }

    #[test]
    fn stiff_limbs_keep_a_trace_of_motion_and_a_rigid_plant_has_none_in_its_trunk() {
        let mut limbs = vec![[1e-6, 1e-6]; 9];
        limbs.push([0.1, 0.1]);
        let groups = Wind::new(&tree([0.0, 1e-6], &limbs), 0.3).groups;
        assert!((groups[1].least - 0.02).abs() < 1e-6, "{groups:?}");
        let rigid = Wind::new(&tree([0.0, 0.0], &[]), 0.3);
        assert!(rigid.groups[0].influence.abs() < 1e-9 && rigid.is_ground_cover);
    }
}
