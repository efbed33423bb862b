//! Thin axes as cones of three sides, for meshes of which every frame of a clip holds all points. Own.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::by_material::{AxisSurface, append_by_material};
use super::{AxisBinding, PlantSkin, SkinOptions, UvMode};
use osier_base::convert::index;
use osier_base::{Result, math};
use osier_scene::plant::{Axis, AxisKind, Plant};

/// Sides of a cone.
const SIDES: u32 = 3;
/// Cosine and sine of the directions of its edges.
const CORNERS: [[f32; 2]; SIDES as usize] = [[1.0, 0.0], [-0.5, 0.866_025_4], [-0.5, -0.866_025_4]];
/// Largest distance of a left-out node from the cone's centreline, in radii at the base of the axis, and the distance
/// in m that is always allowed.
/// Own: the branches that it bears then miss the cone by less than its thickness, its leaves by a stalk.
const MAX_DRIFT: f32 = 2.0;
const LEAST_DRIFT: f32 = 0.012;

/// Whether an axis becomes a cone.
pub(super) fn is_thin(plant: &Plant, options: &SkinOptions, axis: &Axis) -> bool {
    axis.kind != AxisKind::Blade && plant.nodes.r[axis.first as usize] < options.thin
}

/// Appends the thin axes of a plant to its skin, as subsets by material.
/// # Errors
/// `Limit` for more points than the options allow, `TooMany` beyond 2^32 points.
pub(super) fn append_thin_axes(plant: &Plant, options: &SkinOptions, skin: &mut PlantSkin) -> Result<()> {
    let cones = AxisSurface { is_of: is_thin, append: append_cone, remedy: "a smaller plant" };
    append_by_material(plant, options, &cones, skin)
}

/// Nodes of an axis at which its cone has corners: both ends, and those between that its centreline would miss.
fn corner_nodes(plant: &Plant, axis: &Axis) -> Vec<usize> {
    let nodes = plant.nodes_of(axis);
    let (first, last) = (nodes.start, nodes.end - 1);
    let drift = (MAX_DRIFT * plant.nodes.r[first]).max(LEAST_DRIFT);
    let p = &plant.nodes.p;
    let mut corners = vec![first];
    let mut from = first;
    for to in first + 1..last {
        // The chord to the next node leaves out all nodes between, if none of them is too far from it.
        let chord = math::normalize_or(p[to + 1] - p[from], Vec3::Y);
        let misses = |i: usize| (p[i] - p[from]).reject_from_normalized(chord).length_squared() > drift * drift;
        if (from + 1..=to).any(misses) {
            corners.push(to);
            from = to;
        }
    }
    corners.push(last);
    corners
}

/// v at the corner nodes of a cone, as on a tube with one repeat around: length divided by the girth of the wood, which
/// counts as at least a quarter of that of the base, or the length alone.
fn v_coordinates(plant: &Plant, options: &SkinOptions, corners: &[usize]) -> Vec<f32> {
    let (s, r) = (&plant.nodes.s, &plant.nodes.r);
    let base = corners.first().map_or(0.0, |k| r[*k]);
    let tile = options.tile_of(base);
    let wide = |k: usize| r[k].max(0.25 * base);
    let step = |w: &[usize]| match options.uv {
        UvMode::Conformal => (s[w[1]] - s[w[0]]) * tile[0] / (tile[1] * PI * (wide(w[0]) + wide(w[1]))),
        UvMode::Metric => (s[w[1]] - s[w[0]]) / tile[1],
    };
    let steps = corners.windows(2).map(step);
    let sum = |v: &mut f32, step: f32| {
        *v += step;
        Some(*v)
    };
    [0.0].into_iter().chain(steps.scan(0.0, sum)).collect()
}

/// A closed cone: a triangle inside the parent, one at each corner, and a point at the tip.
fn append_cone(
    plant: &Plant,
    options: &SkinOptions,
    axis: u32,
    skin: &mut PlantSkin,
    triangles: &mut Vec<[u32; 3]>,
) -> Result<()> {
    let shape = &plant.axes[axis as usize];
    let corners = corner_nodes(plant, shape);
    let nodes = &plant.nodes;
    let mesh = &mut skin.mesh;
    let first = index(mesh.points.len(), "points of a skin")?;
    let vs = v_coordinates(plant, options, &corners);
    let Some((&tip, rings)) = corners.split_last() else { return Ok(()) };
    for (&k, &v) in rings.iter().zip(&vs) {
        // Counter-clockwise, seen from the tip: x, then -z.
        let (x, z) = (nodes.q[k] * Vec3::X, nodes.q[k] * Vec3::Z);
        for (j, [cos, sin]) in CORNERS.into_iter().enumerate() {
            let out = x * cos - z * sin;
            mesh.points.push(nodes.p[k] + out * nodes.r[k]);
            mesh.normals.push(out);
            mesh.uvs.push(Vec2::new(j as f32 / SIDES as f32, v));
            skin.bindings.push(AxisBinding { axis, s: nodes.s[k] });
        }
    }
    mesh.points.push(nodes.p[tip]);
    mesh.normals.push(nodes.q[tip] * Vec3::Y);
    mesh.uvs.push(Vec2::new(0.5, vs[rings.len()]));
    skin.bindings.push(AxisBinding { axis, s: nodes.s[tip] });

    // The base, strips of quads between the rings, the sides of the tip.
    let count = index(rings.len(), "corners of an axis")?;
    triangles.push([first, first + 2, first + 1]);
    for r in 1..count {
        let (a, b) = (first + (r - 1) * SIDES, first + r * SIDES);
        for j in 0..SIDES {
            let next = (j + 1) % SIDES;
            triangles.push([a + j, a + next, b + next]);
            triangles.push([a + j, b + next, b + j]);
        }
    }
    let (a, apex) = (first + (count - 1) * SIDES, first + count * SIDES);
    triangles.extend((0..SIDES).map(|j| [a + j, a + (j + 1) % SIDES, apex]));
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::skin;
    use super::*;
    use glam::Quat;
    use osier_scene::plant::{AxisEnd, NONE, Nodes};

    /// A straight trunk of 2 m and a twig with a bend, 3 mm thick.
    fn plant() -> Plant {
        let axis = |id: u64, parent: u32, first: u32, count: u32, length: f32| Axis {
            id,
            parent,
            parent_s: 1.0,
            order: u8::from(parent != NONE),
            kind: osier_scene::plant::AxisKind::Stem,
            first,
            count,
            length,
            s_exposed: 0.0,
            material: 0,
            fork: NONE,
            end: AxisEnd::Tip,
            birth: 0.0,
        };
        let twig = [Vec3::Y, Vec3::new(0.1, 1.0, 0.0), Vec3::new(0.2, 1.0005, 0.0), Vec3::new(0.3, 1.1, 0.0)];
        let nodes = Nodes {
            p: [Vec3::ZERO, Vec3::Y * 2.0].into_iter().chain(twig).collect(),
            q: vec![Quat::IDENTITY; 2].into_iter().chain([Quat::from_rotation_z(-1.5); 4]).collect(),
            r: vec![0.05, 0.04, 0.0015, 0.0015, 0.001, 0.001],
            s: vec![0.0, 2.0, 0.0, 0.1, 0.2, 0.341],
            birth: vec![0.0; 6],
            color: vec![0; 6],
        };
        Plant {
            axes: vec![axis(1, NONE, 0, 2, 2.0), axis(2, 0, 2, 4, 0.341)],
            nodes,
            materials: vec!["bark".into()],
            ..Plant::default()
        }
    }

    #[test]
    fn a_thin_axis_is_a_closed_cone_with_a_corner_at_its_bend() {
        let plant = plant();
        let tubes = skin(&plant, &SkinOptions::default()).expect("a skin");
        let cones = skin(&plant, &SkinOptions { thin: 0.004, ..SkinOptions::default() }).expect("a skin");
        assert_eq!((tubes.tubes.len(), cones.tubes.len()), (2, 1));
        let trunk = cones.tubes[0].points.1 as usize;
        // Rings at the base and at the bend, and the tip; the node between lies within half a millimetre of the chord.
        assert_eq!(cones.mesh.points.len() - trunk, 7);
        assert!(cones.mesh.points.len() < tubes.mesh.points.len());
        assert_eq!(cones.bindings.len(), cones.mesh.points.len());
        let twig = &cones.mesh.triangles[cones.tubes[0].triangles.1 as usize..];
        let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
        let mut volume = 0.0;
        for t in twig {
            for k in 0..3 {
                *edges.entry([t[k], t[(k + 1) % 3]]).or_default() += 1;
            }
            let [a, b, c] = t.map(|i| cones.mesh.points[i as usize] - Vec3::Y);
            volume += a.dot(b.cross(c)) / 6.0;
        }
        // Every edge is used once in each direction, and the faces look outwards.
        assert!(edges.iter().all(|([a, b], n)| *n == 1 && edges.get(&[*b, *a]) == Some(&1)));
        assert!(volume > 0.0, "{volume}");
    }

    #[test]
    fn bark_of_a_cone_has_the_size_of_that_of_a_tube() {
        let plant = plant();
        let v_of = |uv: UvMode| {
            let options = SkinOptions { thin: 0.004, uv, ..SkinOptions::default() };
            let cones = skin(&plant, &options).expect("a skin");
            let twig = &cones.mesh.uvs[cones.tubes[0].points.1 as usize..];
            [twig[0].y, twig[3].y, twig[6].y]
        };
        // Corners at 0, 0.2 m and 0.341 m, with radii of 1.5, 1 and 1 mm: the girths between them are pi times the sum of both radii.
        let wanted = [0.0, 0.2 / (PI * 0.0025), 0.2 / (PI * 0.0025) + 0.141 / (PI * 0.002)];
        for (v, wanted) in v_of(UvMode::Conformal).into_iter().zip(wanted) {
            assert!((v - wanted).abs() < 1e-3, "{v} instead of {wanted}");
        }
        for (v, s) in v_of(UvMode::Metric).into_iter().zip([0.0, 0.2, 0.341]) {
            assert!((v - s / 0.5).abs() < 1e-5, "{v} at {s}");
        }
    }
}
