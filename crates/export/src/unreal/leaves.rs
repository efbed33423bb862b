//! Leaves as parts of an assembly: one part each, or several neighbours as one where there are too many.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Quat, Vec3};

use super::super::merge::transform_normal;
use osier_base::convert::index;
use osier_base::{Error, Result};
use osier_scene::{InstanceState, Instancer, InstancerMotion, Mesh, Prototype};

/// Most parts of an assembly; in a plant with more leaves, neighbouring leaves are merged.
pub(super) const MAX_PARTS: usize = 65_536;

/// The leaves of one instancer as parts of the assembly.
pub(super) struct LeafParts {
    /// Prototypes, and one instance for each part.
    pub(super) instancer: Instancer,
    /// The written joint that each part follows.
    pub(super) joints: Vec<u16>,
}

/// Leaves of a merged twig, unless more are needed. Own: each twig is a separate mesh, while single leaves share
/// theirs. The larger the twigs, the fewer leaves must be merged: to save one part, n / (n - 1) leaves in twigs of n
/// leaves.
pub(super) const TWIG: usize = 8;

/// Neighbouring leaves that may become one part.
struct Twig {
    /// Index in the list of the plant's instancers.
    instancer: usize,
    /// The written joint that all of them follow.
    joint: u16,
    /// Indices of the instances, at least two, in their order on the axis.
    members: Vec<usize>,
}

/// The leaves of a plant as parts: one each, or if these would be more than `most`, with as many twigs of neighbours on one joint
/// as needed. `carrier`: for each joint of the rig the written joint that moves its geometry.
/// # Errors
/// `TooMany` beyond 2^32 parts.
pub(super) fn leaf_parts(instancers: &[Instancer], carrier: &[u16], most: usize) -> Result<Vec<LeafParts>> {
    let single: Vec<LeafParts> = instancers.iter().map(|i| one_part_each(i, carrier)).collect();
    let leaves: usize = single.iter().map(|p| p.joints.len()).sum();
    let Some(excess) = leaves.checked_sub(most).filter(|n| *n > 0) else { return Ok(single) };
    let by_joint: Vec<BTreeMap<u16, Vec<usize>>> = single.iter().map(|p| by_joint(&p.joints)).collect();
    // The smallest size of twigs that removes the excess. Leaves of two joints are never merged, so larger
    // sizes stop helping at some point.
    let mut size = TWIG;
    let mut twigs = twigs_of_size(&by_joint, size);
    while twigs.iter().map(|t| t.members.len() - 1).sum::<usize>() < excess && size < leaves {
        size *= 2;
        twigs = twigs_of_size(&by_joint, size);
    }
    // The largest twigs first, in order, until the limit holds.
    twigs.sort_by_key(|t| std::cmp::Reverse(t.members.len()));
    let mut left = excess;
    let needed = twigs.iter().take_while(|t| {
        let is_needed = left > 0;
        left = left.saturating_sub(t.members.len() - 1);
        is_needed
    });
    let needed = needed.count();
    twigs.truncate(needed);
    if left > 0 {
        let message = format!(
            "a plant has {} parts of leaves for Unreal Engine where {most} are the most, as its leaves are on many joints; \
             lower output.unreal.joints",
            most + left
        );
        return Err(Error::export("X005", message));
    }
    let merge = |(n, parts): (usize, &LeafParts)| {
        let own: Vec<&Twig> = twigs.iter().filter(|t| t.instancer == n).collect();
        merge_twigs(parts, &own)
    };
    single.iter().enumerate().map(merge).collect()
}

/// Runs of 2 to `size` consecutive instances on one joint.
fn twigs_of_size(by_joint: &[BTreeMap<u16, Vec<usize>>], size: usize) -> Vec<Twig> {
    let of = |(instancer, joints): (usize, &BTreeMap<u16, Vec<usize>>)| -> Vec<Twig> {
        let twig = |(joint, members): (u16, &[usize])| Twig { instancer, joint, members: members.to_vec() };
        // Instances are listed along their axis, so that neighbours in the list are neighbours on the twig.
        let runs = joints.iter().flat_map(|(joint, list)| list.chunks(size.max(2)).map(|run| (*joint, run)));
        runs.filter(|(_, run)| run.len() > 1).map(twig).collect()
    };
    by_joint.iter().enumerate().flat_map(of).collect()
}

fn one_part_each(instancer: &Instancer, carrier: &[u16]) -> LeafParts {
    let joint = |i: usize| match &instancer.motion {
        InstancerMotion::Joints(joints) => {
            joints.get(i).and_then(|j| carrier.get(usize::from(*j))).copied().unwrap_or(0)
        }
        InstancerMotion::Still | InstancerMotion::Free => 0,
    };
    LeafParts { joints: (0..instancer.len()).map(joint).collect(), instancer: instancer.clone() }
}

/// Indices of the instances of each joint, in order.
fn by_joint(joints: &[u16]) -> BTreeMap<u16, Vec<usize>> {
    let mut lists: BTreeMap<u16, Vec<usize>> = BTreeMap::new();
    for (i, joint) in joints.iter().enumerate() {
        lists.entry(*joint).or_default().push(i);
    }
    lists
}

/// The parts of one instancer after merging: single leaves in their order, then a part with a new prototype for each twig.
fn merge_twigs(leaves: &LeafParts, twigs: &[&Twig]) -> Result<LeafParts> {
    let from = &leaves.instancer;
    let merged: BTreeSet<usize> = twigs.iter().flat_map(|t| t.members.iter().copied()).collect();
    let kept: Vec<usize> = (0..from.len()).filter(|i| !merged.contains(i)).collect();
    let mut out = LeafParts {
        instancer: Instancer {
            ids: kept.iter().map(|i| from.ids[*i]).collect(),
            protos: kept.iter().map(|i| from.protos[*i]).collect(),
            scales: kept.iter().map(|i| from.scales[*i]).collect(),
            rest: InstanceState {
                positions: kept.iter().map(|i| from.rest.positions[*i]).collect(),
                orientations: kept.iter().map(|i| from.rest.orientations[*i]).collect(),
                ..InstanceState::default()
            },
            ..from.clone()
        },
        joints: kept.iter().map(|i| leaves.joints[*i]).collect(),
    };
    for Twig { joint, members, .. } in twigs {
        // The space of the part has the axes of the plant and its origin at the pivot of its first leaf.
        let Some(origin) = members.first().map(|i| from.rest.positions[*i]) else { continue };
        let number = index(out.instancer.prototypes.len(), "parts of a plant")?;
        out.instancer.prototypes.push(Prototype::new(format!("twig_{number}"), twig_mesh(from, members, origin)));
        out.instancer.ids.push(from.ids[members[0]]);
        out.instancer.protos.push(number);
        out.instancer.scales.push(Vec3::ONE);
        out.instancer.rest.positions.push(origin);
        out.instancer.rest.orientations.push(Quat::IDENTITY);
        out.joints.push(*joint);
    }
    Ok(out)
}

/// Joins the meshes of some instances, with positions relative to `origin`, m.
fn twig_mesh(from: &Instancer, members: &[usize], origin: Vec3) -> Mesh {
    let mut twig = Mesh::default();
    for i in members {
        let trs = from.transform(&from.rest, *i);
        let Some(leaf) = from.protos.get(*i).and_then(|p| from.prototypes.get(*p as usize)) else { continue };
        let mut mesh = leaf.mesh.clone();
        mesh.points.iter_mut().for_each(|p| *p = trs.apply(*p) - origin);
        mesh.normals.iter_mut().for_each(|n| *n = transform_normal(&trs, *n));
        // Vertex colours and attributes of only some prototypes would give lists of unequal length, so they are dropped.
        mesh.colors.clear();
        mesh.attributes.clear();
        pad_uvs(&mut twig, &mut mesh);
        twig.append(&mesh);
    }
    twig.join_subsets();
    twig
}

/// Extends the texture coordinates of both meshes by zeros to one per point if either has some, so that the meshes can be joined.
fn pad_uvs(a: &mut Mesh, b: &mut Mesh) {
    if !a.uvs.is_empty() || !b.uvs.is_empty() {
        for mesh in [a, b] {
            mesh.uvs.resize(mesh.points.len(), glam::Vec2::ZERO);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Leaves of one triangle along X at 1 m from each other, on the given joints.
    fn leaves(joints: &[u16]) -> Instancer {
        let mesh = Mesh {
            points: vec![Vec3::ZERO, Vec3::Y, Vec3::Z],
            normals: vec![Vec3::X; 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let n = u8::try_from(joints.len()).expect("few");
        Instancer {
            name: "leaves".into(),
            prototypes: vec![Prototype::new("leaf", mesh.with_material(3))],
            ids: (0..u64::from(n)).collect(),
            protos: vec![0; joints.len()],
            scales: vec![Vec3::splat(2.0); joints.len()],
            rest: InstanceState {
                positions: (0..n).map(|i| Vec3::X * f32::from(i)).collect(),
                orientations: vec![Quat::IDENTITY; joints.len()],
                ..InstanceState::default()
            },
            motion: InstancerMotion::Joints(joints.to_vec()),
            tracked: false,
        }
    }

    #[test]
    fn leaves_stay_single_up_to_the_limit_and_follow_written_joints() {
        let parts = leaf_parts(&[leaves(&[0, 1, 2])], &[0, 1, 1], 3).expect("few");
        assert_eq!((parts[0].instancer.prototypes.len(), parts[0].joints.as_slice()), (1, &[0, 1, 1][..]));
    }

    #[test]
    fn as_few_leaves_as_it_takes_become_twigs_of_one_joint_each_where_they_were() {
        // Ten leaves on joint 0, with two of joint 1 between them, and one on joint 2.
        let joints = [0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 2];
        let whole = leaves(&joints);
        let parts = leaf_parts(std::slice::from_ref(&whole), &[0, 1, 2], 6).expect("few");
        let LeafParts { instancer, joints } = &parts[0];
        // A twig of eight leaves takes up the excess of seven; the others stay instances of the first prototype.
        assert_eq!(joints, &[1, 1, 0, 0, 2, 0]);
        assert_eq!(instancer.protos, [0, 0, 0, 0, 0, 1]);
        assert_eq!(instancer.prototypes.iter().map(|p| p.mesh.triangles.len()).collect::<Vec<_>>(), [1, 8]);
        assert!(instancer.prototypes.iter().all(|p| p.mesh.subsets.len() == 1 && p.mesh.subsets[0].material == 3));
        assert_eq!(placed(instancer), placed(&whole));
    }

    #[test]
    fn twigs_grow_until_the_limit_holds_and_never_join_two_joints() {
        let whole = leaves(&[[0_u16; 20], [1; 20]].concat());
        let parts = leaf_parts(std::slice::from_ref(&whole), &[0, 1], 2).expect("few");
        assert_eq!(parts[0].joints, [0, 1]);
        assert_eq!(placed(&parts[0].instancer), placed(&whole));
        let e = leaf_parts(std::slice::from_ref(&whole), &[0, 1], 1).err().expect("each joint needs a part");
        assert!(e.to_string().contains("output.unreal.joints"), "{e}");
    }

    /// Corners of all triangles where the instances show them, sorted, in thousandths of a metre.
    fn placed(instancer: &Instancer) -> Vec<[i32; 3]> {
        #[allow(clippy::cast_possible_truncation, reason = "a few metres")]
        let rounded = |p: Vec3| p.to_array().map(|x| (x * 1000.0).round() as i32);
        let mut all: Vec<[i32; 3]> = (0..instancer.len())
            .flat_map(|i| {
                let trs = instancer.transform(&instancer.rest, i);
                let mesh = &instancer.prototypes[instancer.protos[i] as usize].mesh;
                mesh.triangles
                    .iter()
                    .flatten()
                    .map(move |c| rounded(trs.apply(mesh.points[*c as usize])))
                    .collect::<Vec<_>>()
            })
            .collect();
        all.sort_unstable();
        all
    }
}
