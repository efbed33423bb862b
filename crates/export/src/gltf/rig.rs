//! The joints of a skin: which are written if there are too many, and the vertices' influences remapped to them.

use glam::{Mat4, Quat};

use super::super::Warning;
use super::super::skin_remap::{merge_influences, remap_influences};
use osier_scene::{Asset, Skeleton, SkinWeights, Trs};

/// Most joints in a skin; viewers hold the matrices of a skin in a uniform buffer or a texture of limited size.
pub(super) const MAX_JOINTS: usize = 300;

/// The joints of a skeleton that are written, and by which of them the others are replaced.
#[derive(Debug)]
pub(super) struct JointSelection {
    /// Indices into the skeleton, increasing, so that parents come first.
    pub kept: Vec<usize>,
    /// For each joint of the skeleton the written joint (an index into `kept`) that moves its vertices: itself or an ancestor.
    pub carrier: Vec<u16>,
    /// Transform of each joint of the skeleton to the asset's space at rest.
    pub bind: Vec<Trs>,
    /// X002, if joints were left out.
    pub warning: Option<Warning>,
}

impl JointSelection {
    /// Selects at most `limit` joints of an asset's skeleton; `poses` are those of the clip. `None` without joints.
    ///
    /// Joints are ranked by their largest rotation in the clip (rad) times the length of their subtree (m), ties by
    /// index; the first are kept while they and their ancestors fit. The others follow their nearest kept ancestor.
    /// Own: the ranking keeps the joints whose motion is most visible.
    pub(super) fn new(asset: &Asset, poses: &[Vec<Trs>], limit: usize) -> Option<Self> {
        let skeleton = asset.skeleton.as_ref().filter(|s| !s.joints.is_empty())?;
        let n = skeleton.joints.len();
        let bind = skeleton.bind();
        if n <= limit {
            // Every joint is written, so the vertices keep their joints: the identity map.
            let carrier = (0..n).filter_map(|i| u16::try_from(i).ok()).collect();
            return Some(Self { kept: (0..n).collect(), carrier, bind, warning: None });
        }
        let keep = rank_and_keep(skeleton, poses, limit);
        let kept: Vec<usize> = (0..n).filter(|&i| keep[i]).collect();
        // Parents come before their children, so that a joint that is not kept inherits the carrier of its parent.
        let mut carrier: Vec<u16> = Vec::with_capacity(n);
        for i in 0..n {
            // `kept` increases, so its index is found by bisection.
            let own = kept.binary_search(&i).ok().and_then(|k| u16::try_from(k).ok());
            let parent = skeleton.joints[i].parent.and_then(|p| carrier.get(p as usize)).copied();
            carrier.push(own.or(parent).unwrap_or(0));
        }
        let message =
            format!("asset {}: {n} joints, {} written; the others ride on the nearest of them", asset.id, kept.len());
        Some(Self { kept, carrier, bind, warning: Some(Warning { code: "X002", message }) })
    }

    /// Index in `kept` of the parent of the written joint `k`.
    pub(super) fn parent_of(&self, skeleton: &Skeleton, k: usize) -> Option<usize> {
        skeleton.joints[self.kept[k]].parent.map(|p| usize::from(self.carrier[p as usize]))
    }

    /// Inverse bind matrices of the written joints, column-major: from the asset's space to the joint's, at rest.
    pub(super) fn inverse_bind_matrices(&self) -> Vec<[f32; 16]> {
        let inverse = |i: &usize| {
            let b = &self.bind[*i];
            // The inverse of x -> R x + t is x -> R^-1 x - R^-1 t.
            let r = b.r.normalize().conjugate();
            Mat4::from_rotation_translation(r, r * -b.t).to_cols_array()
        };
        self.kept.iter().map(inverse).collect()
    }

    /// Influences over the written joints: largest first, no joint twice, unused slots joint 0 with weight 0, sum 1.
    pub(super) fn remap_weights(&self, skin: &SkinWeights) -> (Vec<[u16; 4]>, Vec<[f32; 4]>) {
        let SkinWeights { joints, weights } = remap_influences(skin, &self.carrier);
        (joints, weights)
    }

    /// Influences of one vertex over the written joints, in the form of [`Self::remap_weights`].
    pub(super) fn merge_influences(&self, joints: [u16; 4], weights: [f32; 4]) -> ([u16; 4], [f32; 4]) {
        merge_influences(&self.carrier, joints, weights)
    }
}

/// For each joint whether it is kept: the root always, with it at most `limit`.
fn rank_and_keep(skeleton: &Skeleton, poses: &[Vec<Trs>], limit: usize) -> Vec<bool> {
    let n = skeleton.joints.len();
    // Length of each subtree: children come after their parents, so one pass from the end adds them up.
    let mut length = vec![0.0_f32; n];
    for i in (0..n).rev() {
        if let Some(p) = skeleton.joints[i].parent {
            length[p as usize] += length[i] + skeleton.joints[i].rest.t.length();
        }
    }
    // Largest rotation from the rest pose over the clip, rad; times the length of the subtree, it is about the distance
    // that its tips travel, m.
    let turn =
        |i: usize| poses.iter().fold(0.0_f32, |m, pose| m.max(rotation_angle(skeleton.joints[i].rest.r, pose[i].r)));
    let rank: Vec<f32> = (0..n).map(|i| turn(i) * length[i]).collect();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| rank[b].total_cmp(&rank[a]).then(a.cmp(&b)));

    let mut keep = vec![false; n];
    // The root is always kept: it carries every joint that has no other kept ancestor.
    keep[0] = true;
    // A joint is kept only together with all its ancestors that are not kept yet.
    let mut room = limit.saturating_sub(1);
    for i in order {
        // A joint whose chain does not fit is passed over; later ones of a lower rank may have shorter chains that do.
        let chain: Vec<usize> = std::iter::successors(Some(i), |&j| skeleton.joints[j].parent.map(|p| p as usize))
            .take_while(|&j| !keep[j])
            .collect();
        if chain.len() <= room {
            room -= chain.len();
            chain.iter().for_each(|&j| keep[j] = true);
        }
    }
    keep
}

/// Angle between two rotations, rad in [0, pi]: twice the arc tangent of sine and cosine of the half angle, which is exact for
/// small angles, where an arc cosine is not.
pub(super) fn rotation_angle(a: Quat, b: Quat) -> f32 {
    // d = (v sin(h), cos(h)) with h half the angle. The absolute value of cos(h) selects the rotation by at most 180 degrees, as
    // d and -d are the same rotation.
    let d = a.conjugate() * b;
    // The root and the arc tangent are taken in f64, so that small angles keep the digits of the f32 sum.
    let sine = f64::from(d.x * d.x + d.y * d.y + d.z * d.z).max(0.0);
    osier_base::math::narrow(2.0 * osier_base::math::atan2(osier_base::math::sqrt(sine), f64::from(d.w.abs())))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use osier_scene::{AssetKind, Joint};

    /// A trunk of 3 joints; joint 1 carries a chain of `n` twigs.
    fn asset(n: u32) -> Asset {
        let rest = Trs::translation(Vec3::new(0.0, 1.0, 0.0));
        let joint = |name: &str, parent| Joint { name: name.into(), parent, rest, radius: 0.1 };
        let mut joints = vec![joint("a", None), joint("b", Some(0)), joint("c", Some(1))];
        joints.extend((0..n).map(|i| joint(&format!("t{i}"), Some(i + 2))));
        Asset {
            id: "tree".into(),
            kind: AssetKind::Plant,
            group: String::new(),
            skeleton: Some(Skeleton { joints }),
            meshes: Vec::new(),
            instancers: Vec::new(),
            points: Vec::new(),
            curves: Vec::new(),
            rigged: None,
        }
    }

    #[test]
    fn too_many_joints_ride_on_the_nearest_kept_ancestor() {
        let asset = asset(5);
        let mut pose = asset.skeleton.as_ref().expect("skeleton").rest_pose();
        pose.iter_mut().for_each(|j| j.r = Quat::from_rotation_x(0.2));
        let rig = JointSelection::new(&asset, &[pose], 4).expect("rig");
        assert_eq!(rig.kept, [0, 1, 2, 3]);
        assert_eq!(rig.carrier, [0, 1, 2, 3, 3, 3, 3, 3]);
        assert_eq!(rig.warning.expect("warned").code, "X002");
    }

    #[test]
    fn merged_weights_name_no_joint_twice_and_sum_to_one() {
        let asset = asset(5);
        let rig = JointSelection::new(&asset, &[], 4).expect("rig");
        let skin = SkinWeights { joints: vec![[6, 7, 1, 0]], weights: vec![[0.4, 0.25, 0.35, 0.0]] };
        let (joints, weights) = rig.remap_weights(&skin);
        assert_eq!(joints, [[3, 1, 0, 0]]);
        assert!((weights[0][0] - 0.65).abs() < 1e-6 && (weights[0][1] - 0.35).abs() < 1e-6 && weights[0][2] == 0.0);
    }

    #[test]
    fn angles_near_zero_keep_their_size() {
        for a in [0.0, 1e-5, 0.3, 3.0] {
            assert!((rotation_angle(Quat::IDENTITY, Quat::from_rotation_z(a)) - a).abs() < 1e-6 * a.max(0.1));
        }
    }
}
