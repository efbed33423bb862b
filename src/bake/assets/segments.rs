//! Plants displayed by their segments: one instance of a prism, or of an organ, between each two nodes, in place of a lofted
//! skin.
//! Source: [hoetzlein] Figure 6a; organs in place of prisms are its future work.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use crate::bake::assets::material_set::PlantMaterials;
use crate::bake::assets::skin_options::{BARK, SHOOT, SHOOT_RADIUS};
use osier_base::Result;
use osier_base::convert::index;
use osier_base::rng::{mix64, word};
use osier_motion::sway::JointRig;
use osier_plants::grow::turtle::OrganSpec;
use osier_scene::plant::{Axis, Plant};
use osier_scene::{InstanceState, Instancer, InstancerMotion, Mesh, Prototype, Subset};

const NAME: &str = "segments";

/// Shape of the instance between two nodes.
enum SegmentForm<'a> {
    /// A unit cube for bark, and one for shoots.
    Prism,
    /// An organ scaled uniformly to the length of the segment.
    Organ(&'a OrganSpec),
}

/// One instance per segment, in the order of axes and nodes. `organ`: replaces the prisms; `rig`: gives each segment the joint
/// at its middle.
/// # Errors
/// `TooMany` beyond 2^32 variants of the organ.
pub(crate) fn segment_instancer(
    plant: &Plant,
    materials: &PlantMaterials,
    organ: Option<&OrganSpec>,
    rig: Option<&JointRig>,
) -> Result<Instancer> {
    let form = organ.filter(|o| !o.meshes.is_empty()).map_or(SegmentForm::Prism, SegmentForm::Organ);
    let mut out = Instancer {
        name: NAME.into(),
        prototypes: prototypes(&form, materials.first_material),
        ids: Vec::new(),
        protos: Vec::new(),
        scales: Vec::new(),
        rest: InstanceState::default(),
        motion: InstancerMotion::Still,
        tracked: false,
    };
    let mut joints = Vec::new();
    for (i, axis) in plant.axes.iter().enumerate() {
        for (k, segment) in (0_u64..).zip(plant.nodes_of(axis).skip(1)) {
            push_segment(&mut out, plant, axis, segment, &form)?;
            out.ids.push(mix64(&[axis.id, word("segment"), k]));
            let middle = 0.5 * (plant.nodes.s[segment - 1] + plant.nodes.s[segment]);
            joints.extend(rig.map(|r| r.joint_at(i, middle)));
        }
    }
    if rig.is_some() {
        out.motion = InstancerMotion::Joints(joints);
    }
    Ok(out)
}

/// Appends the instance that ends at node `end`. [hoetzlein] Table 2: scale (2r, segment length, 2r), at the middle of the
/// segment.
fn push_segment(out: &mut Instancer, plant: &Plant, axis: &Axis, end: usize, form: &SegmentForm<'_>) -> Result<()> {
    let nodes = &plant.nodes;
    let (from, to) = (nodes.p[end - 1], nodes.p[end]);
    let length = from.distance(to);
    // The frame of the end node, rotated so that its +Y is along the segment.
    let q = nodes.q[end];
    let along = osier_base::math::normalize_or(to - from, q * Vec3::Y);
    out.rest.orientations.push((osier_base::math::rotation_between(q * Vec3::Y, along) * q).normalize());
    match form {
        SegmentForm::Prism => {
            let width = nodes.r[end - 1] + nodes.r[end];
            out.rest.positions.push(0.5 * (from + to));
            out.scales.push(Vec3::new(width, length, width));
            let thin = nodes.r[axis.first as usize] < SHOOT_RADIUS;
            out.protos.push(u32::from(thin));
        }
        SegmentForm::Organ(organ) => {
            // Variants take turns by node, so that neighbours differ.
            let variant = end % organ.meshes.len();
            // Organs point along +Y from their pivot: scaled so that the mesh ends at the next node.
            let own = organ.meshes[variant].bounds().max.y.max(1e-6);
            out.rest.positions.push(from);
            out.scales.push(Vec3::splat(length / own));
            out.protos.push(index(variant, "variants of an organ")?);
        }
    }
    Ok(())
}

fn prototypes(form: &SegmentForm<'_>, first_material: u32) -> Vec<Prototype> {
    match form {
        SegmentForm::Prism => vec![
            Prototype::new("prism_bark", unit_cube(first_material + u32::from(BARK))),
            Prototype::new("prism_shoot", unit_cube(first_material + u32::from(SHOOT))),
        ],
        SegmentForm::Organ(organ) => {
            let prototype = |(i, mesh): (usize, &Arc<Mesh>)| {
                let mut mesh = (**mesh).clone();
                mesh.subsets.iter_mut().for_each(|s| s.material += first_material);
                Prototype::new(format!("segment_{i}"), mesh)
            };
            organ.meshes.iter().enumerate().map(prototype).collect()
        }
    }
}

/// A cube of edge 1 around the origin with flat faces; u runs round it, v up.
fn unit_cube(material: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let faces = [
        (Vec3::X, Vec3::Y),
        (Vec3::NEG_X, Vec3::Y),
        (Vec3::Z, Vec3::Y),
        (Vec3::NEG_Z, Vec3::Y),
        (Vec3::Y, Vec3::NEG_Z),
        (Vec3::NEG_Y, Vec3::Z),
    ];
    for (first, (normal, up)) in (0_u32..).step_by(4).zip(faces) {
        // right, up and normal are right-handed, so that the corners run counter-clockwise seen from outside.
        let right = up.cross(normal);
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            mesh.points.push(0.5 * normal + (u - 0.5) * right + (v - 0.5) * up);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(u, v));
        }
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    mesh.subsets.push(Subset { material, first: 0, count: 12 });
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_is_closed_and_faces_outwards() {
        let cube = unit_cube(3);
        let volume: f32 = cube
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| cube.points[i as usize]);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        assert!((volume - 1.0).abs() < 1e-6 && cube.points.len() == 24, "{volume}");
    }
}
