//! Plants for the tests of sway.
#![allow(clippy::cast_possible_truncation, reason = "small plants")]

use std::sync::Arc;

use glam::{Quat, Vec2, Vec3};

use osier_scene::Mesh;
use osier_scene::plant::{Axis, AxisEnd, AxisKind, NONE, Organ, Plant, Proto};

/// An upright rod of `length` from radius `r0` to `r1`, m.
pub(crate) fn rod(length: f32, r0: f32, r1: f32) -> Plant {
    let mut plant = Plant::default();
    axis(&mut plant, (NONE, 0.0), (Vec3::ZERO, Vec3::Y * length), (r0, r1));
    plant
}

/// A trunk of 4 m with `n` side branches of 1 m, each with one twig.
pub(crate) fn tree(n: u16) -> Plant {
    let mut plant = rod(4.0, 0.1, 0.04);
    for i in 0..n {
        let s = 1.0 + 2.8 * f32::from(i) / f32::from(n);
        let turn = f32::from(i) * 2.4;
        let out = Vec3::new(osier_base::math::cos_f32(turn), 0.4, osier_base::math::sin_f32(turn)).normalize();
        axis(&mut plant, (0, s), (Vec3::Y * s, out), (0.02, 0.008));
        let branch = u32::try_from(plant.axes.len() - 1).expect("small");
        axis(&mut plant, (branch, 0.5), (Vec3::Y * s + out * 0.5, Vec3::Y * 0.3), (0.004, 0.002));
    }
    plant
}

/// The same with ten leaves of 1 dm^2 on every branch and twig.
pub(crate) fn leafy(n: u16) -> Plant {
    let mut plant = tree(n);
    let mesh = Mesh {
        points: vec![Vec3::ZERO, Vec3::new(0.1, 0.0, 0.0), Vec3::new(0.1, 0.1, 0.0), Vec3::new(0.0, 0.1, 0.0)],
        normals: vec![Vec3::Z; 4],
        uvs: vec![Vec2::ZERO; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    plant.protos.push(Proto { name: "leaf".into(), mesh: Arc::new(mesh.with_material(0)) });
    for a in 1..plant.axes.len() {
        for k in 0..10_u8 {
            let length = plant.axes[a].length;
            plant.organs.push(Organ {
                id: a as u64 * 100 + u64::from(k),
                axis: a as u32,
                s: length * (0.1 + 0.09 * f32::from(k)),
                offset: Vec3::ZERO,
                q: Quat::from_rotation_x(1.0),
                scale: 1.0,
                proto: 0,
                petiole: 0.0,
                tint: 0.0,
                birth: 0.0,
            });
        }
    }
    plant
}

/// Adds an axis from a place along a vector.
pub(crate) fn axis(
    plant: &mut Plant,
    (parent, parent_s): (u32, f32),
    (from, along): (Vec3, Vec3),
    (r0, r1): (f32, f32),
) {
    const NODES: u8 = 17;
    let order = if parent == NONE { 0 } else { plant.axes[parent as usize].order + 1 };
    let first = u32::try_from(plant.nodes.len()).expect("small");
    let q = osier_base::math::rotation_between(Vec3::Y, along.normalize());
    for k in 0..NODES {
        let t = f32::from(k) / f32::from(NODES - 1);
        plant.nodes.p.push(from + along * t);
        plant.nodes.q.push(q);
        plant.nodes.r.push(r0 + (r1 - r0) * t);
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
        count: u32::from(NODES),
        length: along.length(),
        s_exposed: if parent == NONE { 0.0 } else { 0.02 },
        material: 0,
        fork: NONE,
        end: AxisEnd::Tip,
        birth: 0.0,
    });
}
