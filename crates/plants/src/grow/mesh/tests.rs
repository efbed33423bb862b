//! Skeletons of shapes whose axes are known.
#![allow(clippy::cast_possible_truncation, reason = "small shapes")]

use std::collections::BTreeMap;

use super::*;
use osier_base::math::{cos_f32, sin_f32};
use osier_scene::Material;

/// The surface where `f` is 0, over a box of cubes, cut into tetrahedra.
fn surface(f: impl Fn(Vec3) -> f32, [low, high]: [Vec3; 2], step: f32) -> Mesh {
    let n = ((high - low) / step).ceil().to_array().map(|v| v as usize + 1);
    let index = |x: usize, y: usize, z: usize| (z * n[1] + y) * n[0] + x;
    let at = |i: usize| low + Vec3::new((i % n[0]) as f32, (i / n[0] % n[1]) as f32, (i / n[0] / n[1]) as f32) * step;
    let values: Vec<f32> = (0..n[0] * n[1] * n[2]).map(|i| f(at(i))).collect();
    let mut mesh = Mesh::default();
    let mut places: BTreeMap<[usize; 2], u32> = BTreeMap::new();
    let mut point = |a: usize, b: usize, mesh: &mut Mesh| {
        *places.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            let t = (values[a] / (values[a] - values[b])).clamp(0.02, 0.98);
            mesh.points.push(at(a).lerp(at(b), t));
            mesh.points.len() as u32 - 1
        })
    };
    for z in 0..n[2] - 1 {
        for y in 0..n[1] - 1 {
            for x in 0..n[0] - 1 {
                let corner = |k: usize| index(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2));
                for [a, b] in [[1, 3], [3, 2], [2, 6], [6, 4], [4, 5], [5, 1]] {
                    let tet = [0, a, b, 7].map(corner);
                    let (inside, outside): (Vec<usize>, Vec<usize>) = tet.iter().partition(|i| values[**i] < 0.0);
                    let mut polygon: Vec<u32> = match (inside.as_slice(), outside.as_slice()) {
                        ([i], out) => out.iter().map(|o| point(*i, *o, &mut mesh)).collect(),
                        (inn, [o]) => inn.iter().map(|i| point(*i, *o, &mut mesh)).collect(),
                        ([i, j], [o, p]) => {
                            [(i, o), (i, p), (j, p), (j, o)].map(|(i, o)| point(*i, *o, &mut mesh)).to_vec()
                        }
                        _ => continue,
                    };
                    if polygon.len() < 3 {
                        continue;
                    }
                    let [p, q, r] = [0, 1, 2].map(|k| mesh.points[polygon[k] as usize]);
                    let out = outside.iter().fold(Vec3::ZERO, |s, i| s + at(*i)) / outside.len() as f32
                        - inside.iter().fold(Vec3::ZERO, |s, i| s + at(*i)) / inside.len() as f32;
                    if (q - p).cross(r - p).dot(out) < 0.0 {
                        polygon.reverse();
                    }
                    mesh.triangles.extend((2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]]));
                }
            }
        }
    }
    mesh.normals = vec![Vec3::Y; mesh.points.len()];
    mesh.with_material(0)
}

/// Distance to a segment.
fn capsule(p: Vec3, a: Vec3, b: Vec3) -> f32 {
    let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    p.distance(a.lerp(b, t))
}

fn material(name: &str) -> Material {
    Material {
        name: name.into(),
        class: osier_scene::MaterialClass::Bark,
        base_color: [0.5; 3],
        roughness: 0.8,
        ior: 1.5,
        translucency: 0.0,
        double_sided: false,
        alpha_cutoff: None,
        height_range: 0.0,
        tile: 1.0,
        maps: osier_scene::Maps::default(),
        coat: None,
    }
}

fn imported(mesh: Mesh) -> Imported {
    Imported {
        mesh,
        parts: Vec::new(),
        materials: vec![material("wood"), material("Leaf green")],
        images: Vec::new(),
        files: Vec::new(),
        warnings: Report::default(),
    }
}

fn options() -> SkeletonOptions {
    SkeletonOptions { name: "x.obj".into(), leaf_words: vec!["leaf".into()], seed: 3, ..SkeletonOptions::default() }
}

fn found(mesh: Mesh) -> MeshPlant {
    extract_skeleton(&imported(mesh), &options(), &Cancel::default()).expect("a skeleton")
}

/// A tube of rings with flat ends through points, `sides` around.
fn tube(points: &[(Vec3, f32)], sides: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let n = points.len();
    for (i, (p, r)) in points.iter().enumerate() {
        let t = (points[(i + 1).min(n - 1)].0 - points[i.saturating_sub(1)].0).normalize();
        let (x, y) = (osier_base::math::perpendicular(t), osier_base::math::perpendicular(t).cross(t));
        for k in 0..sides {
            let a = k as f32 / sides as f32 * std::f32::consts::TAU;
            mesh.points.push(*p + (x * cos_f32(a) - y * sin_f32(a)) * *r);
        }
    }
    for i in 0..n as u32 - 1 {
        for k in 0..sides {
            let (a, b) = (i * sides + k, i * sides + (k + 1) % sides);
            mesh.triangles.extend([[a, b, a + sides], [b, b + sides, a + sides]]);
        }
    }
    for (first, p, down) in [(0, points[0].0, true), ((n as u32 - 1) * sides, points[n - 1].0, false)] {
        let middle = mesh.points.len() as u32;
        mesh.points.push(p);
        for k in 0..sides {
            let (a, b) = (first + k, first + (k + 1) % sides);
            mesh.triangles.push(if down { [b, a, middle] } else { [a, b, middle] });
        }
    }
    mesh.normals = vec![Vec3::Y; mesh.points.len()];
    mesh.with_material(0)
}

fn straight(from: Vec3, to: Vec3, r: f32, rings: usize) -> Mesh {
    let points: Vec<(Vec3, f32)> = (0..=rings).map(|k| (from.lerp(to, k as f32 / rings as f32), r)).collect();
    tube(&points, 12)
}

fn axis_nodes(tree: &MeshPlant, i: usize) -> Vec<(Vec3, f32)> {
    let axis = &tree.plant.axes[i];
    tree.plant.nodes_of(axis).map(|k| (tree.plant.nodes.p[k], tree.plant.nodes.r[k])).collect()
}

#[test]
fn a_tube_gives_its_axis_and_its_radius() {
    // Fine, coarse, and of two rings alone.
    for rings in [100, 10, 1] {
        let tree = found(straight(Vec3::ZERO, Vec3::Y, 0.01, rings));
        assert_eq!(tree.plant.axes.len(), 1, "{rings} rings");
        let axis = &tree.plant.axes[0];
        assert!((axis.length - 1.0).abs() < 0.01, "{rings} rings: length {}", axis.length);
        // Twelve sides lie within the circle: their mean distance is 0.977 of it.
        for (p, r) in axis_nodes(&tree, 0) {
            let off = Vec3::new(p.x, 0.0, p.z).length();
            assert!(off < 0.1 * 0.01, "{rings} rings: {off} at {}", p.y);
            assert!((r / 0.00977 - 1.0).abs() < 0.05, "{rings} rings: radius {r} at {}", p.y);
        }
        let first = axis_nodes(&tree, 0)[0].0;
        assert!(first.y < 0.005, "the root is the lowest end: {first}");
    }
}

#[test]
fn a_bent_tube_is_followed_round_its_corner() {
    let (a, b, c) = (Vec3::ZERO, Vec3::Y * 0.5, Vec3::new(0.4, 0.5, 0.0));
    let f = |p: Vec3| capsule(p, a, b).min(capsule(p, b, c)) - 0.02;
    let tree = found(surface(f, [Vec3::splat(-0.03), Vec3::new(0.43, 0.53, 0.03)], 0.005));
    assert_eq!(tree.plant.axes.len(), 1);
    let nodes = axis_nodes(&tree, 0);
    for (p, r) in &nodes {
        let [below, beyond] = [a - Vec3::Y * 0.03, c + Vec3::X * 0.03];
        let off = capsule(*p, below, b).min(capsule(*p, b, beyond));
        // It cuts the corner by less than half its radius.
        let near_corner = p.distance(b) < 0.06;
        assert!(off < if near_corner { 0.012 } else { 0.002 }, "{off} at {p}");
        assert!(
            (r / 0.02 - 1.0).abs() < 0.1 || near_corner || p.distance(a) < 0.03 || p.distance(c) < 0.03,
            "{r} at {p}"
        );
    }
    assert!(nodes[0].0.y < 0.0 && nodes[nodes.len() - 1].0.x > 0.4, "root lowest, tip at the far end");
}

#[test]
fn a_fork_has_three_chains_that_meet_where_they_meet() {
    let (a, b) = (Vec3::ZERO, Vec3::Y * 0.5);
    let (c, d) = (Vec3::new(0.3, 0.9, 0.0), Vec3::new(-0.25, 0.85, 0.0));
    let f = |p: Vec3| (capsule(p, a, b) - 0.03).min(capsule(p, b, c) - 0.022).min(capsule(p, b, d) - 0.018);
    let tree = found(surface(f, [Vec3::new(-0.28, -0.04, -0.04), Vec3::new(0.34, 0.94, 0.04)], 0.006));
    let plant = &tree.plant;
    assert_eq!(plant.axes.len(), 2, "trunk with its heir, and one child");
    assert_eq!(plant.axes[1].parent, 0);
    let at = plant.frame(&plant.axes[0], plant.axes[1].parent_s).p;
    assert!(at.distance(b) < 0.09, "the fork lies within one spacing: {at}");
    let ends = [0, 1].map(|i| axis_nodes(&tree, i).last().expect("nodes").0);
    assert!(ends[0].distance(c) < 0.04 && ends[1].distance(d) < 0.04, "the thicker goes on: {ends:?}");
    for (i, r) in [(0, 0.022), (1, 0.018)] {
        let nodes = axis_nodes(&tree, i);
        let (p, found) = nodes[nodes.len() - 6];
        let off = capsule(p, b, if i == 0 { c } else { d });
        assert!((found / r - 1.0_f32).abs() < 0.1 && off < 0.2 * r, "axis {i}: {found}, {off} beside");
    }
}

#[test]
fn twigs_that_nearly_touch_stay_apart() {
    // Two twigs of radius 10 mm, 5 mm between their barks, joined at the base.
    let r = 0.01;
    let (a, b) = (Vec3::new(-0.0125, 0.0, 0.0), Vec3::new(0.0125, 0.0, 0.0));
    let f = |p: Vec3| {
        let twigs = capsule(p, a, a + Vec3::Y * 0.4).min(capsule(p, b, b + Vec3::Y * 0.4)) - r;
        twigs.min(capsule(p, Vec3::Y * -0.05, Vec3::ZERO) - 0.02)
    };
    let tree = found(surface(f, [Vec3::new(-0.03, -0.08, -0.03), Vec3::new(0.03, 0.42, 0.03)], 0.0021));
    let plant = &tree.plant;
    assert_eq!(plant.axes.len(), 2);
    for axis in &plant.axes {
        for k in plant.nodes_of(axis).skip(1) {
            let (p, q) = (plant.nodes.p[k - 1], plant.nodes.p[k]);
            let across = p.x * q.x < 0.0 && p.y.min(q.y) > 0.03 && p.x.abs().min(q.x.abs()) > 0.004;
            assert!(!across, "a centreline crosses the gap from {p} to {q}");
        }
    }
    // And every point is bound to the twig that it is on.
    for (p, (axis, _)) in tree.wood.points.iter().zip(&tree.bindings).filter(|(p, _)| p.y > 0.06) {
        let tip = axis_nodes(&tree, *axis as usize).last().expect("nodes").0;
        assert!(p.x * tip.x > 0.0, "{p} is bound to the other twig");
    }
}

#[test]
fn tubes_that_stick_in_each_other_become_one_tree() {
    let mut mesh = straight(Vec3::ZERO, Vec3::Y * 2.0, 0.1, 20);
    mesh.append(&straight(Vec3::Y * 1.2, Vec3::new(0.8, 1.6, 0.0), 0.03, 10));
    mesh.append(&straight(Vec3::new(0.4, 1.4, 0.0), Vec3::new(0.6, 1.4, 0.4), 0.01, 8));
    let tree = found(mesh);
    let plant = &tree.plant;
    assert_eq!(plant.axes.iter().map(|a| a.parent).collect::<Vec<_>>(), [NONE, 0, 1]);
    assert_eq!(plant.axes.iter().map(|a| a.order).collect::<Vec<_>>(), [0, 1, 2]);
    assert!((plant.axes[1].parent_s - 1.2).abs() < 0.05, "{}", plant.axes[1].parent_s);
    let base = plant.nodes.p[plant.axes[1].first as usize];
    let out = Vec3::new(base.x, 0.0, base.z).length();
    assert!((out - 0.1).abs() < 0.01, "the branch begins at the bark: {out}");
    assert!((plant.axes[1].length - 0.782).abs() < 0.03, "{}", plant.axes[1].length);
}

/// A quad as a leaf, `size` long, its stalk end at `p`.
fn leaf(p: Vec3, along: Vec3, side: Vec3, size: f32) -> Mesh {
    let (y, x) = (along.normalize() * size, side.normalize() * size * 0.3);
    let points = vec![p, p + y * 0.4 + x, p + y + x * 0.3, p + y * 0.5 - x];
    let normals = vec![x.cross(y).normalize(); 4];
    let mesh = Mesh { points, normals, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
    mesh.with_material(1)
}

fn leafy() -> Mesh {
    let mut mesh = straight(Vec3::ZERO, Vec3::Y * 2.0, 0.05, 20);
    let mut leaves = Mesh::default();
    for k in 0..30 {
        let a = k as f32 * 2.4;
        let out = Vec3::new(cos_f32(a), 0.3, sin_f32(a));
        let p = Vec3::new(cos_f32(a) * 0.05, 0.5 + 0.04 * k as f32, sin_f32(a) * 0.05);
        leaves.append(&leaf(p, out, Vec3::Y, 0.1 + 0.002 * k as f32));
    }
    mesh.append(&leaves);
    mesh
}

#[test]
fn blades_by_name_and_by_shape_become_organs_that_share_a_mesh() {
    for words in [vec!["leaf".to_owned()], vec!["no such word".to_owned()]] {
        let whole = imported(leafy());
        let tree = extract_skeleton(&whole, &SkeletonOptions { leaf_words: words, ..options() }, &Cancel::default())
            .expect("skeleton");
        let plant = &tree.plant;
        assert_eq!((plant.organs.len(), plant.protos.len()), (30, 1));
        assert_eq!(tree.wood.triangles.len() + 60, whole.mesh.triangles.len());
        // At rest every leaf is where the artist put it.
        let mut off = 0.0_f32;
        for organ in &plant.organs {
            let (p, q) = plant.organ_site(organ);
            let mesh = &plant.protos[usize::from(organ.proto)].mesh;
            for v in &mesh.points {
                let at = p + q * (*v * organ.scale);
                let nearest = whole.mesh.points.iter().fold(f32::MAX, |m, w| m.min(w.distance(at)));
                off = off.max(nearest);
            }
            assert!((plant.frame(&plant.axes[0], organ.s).p.y - p.y).abs() < 0.02);
        }
        assert!(off < 2e-5, "{off} m from the file's points");
        let ids: std::collections::BTreeSet<u64> = plant.organs.iter().map(|o| o.id).collect();
        assert_eq!(ids.len(), 30);
    }
}

#[test]
fn the_mesh_is_the_files_own() {
    let whole = imported(straight(Vec3::ZERO, Vec3::Y, 0.03, 20));
    let tree = extract_skeleton(&whole, &options(), &Cancel::default()).expect("skeleton");
    assert_eq!(tree.wood.points, whole.mesh.points);
    assert_eq!(tree.wood.triangles, whole.mesh.triangles);
    assert_eq!(tree.bindings.len(), whole.mesh.points.len());
    assert!(tree.bindings.iter().zip(&whole.mesh.points).all(|((_, s), p)| (s - p.y).abs() < 0.005));
}

/// A square trunk of ten points, as of a tree for games, stands alone; beside a finer one it follows that.
#[test]
fn a_coarse_trunk_has_an_axis() {
    let square = tube(&[(Vec3::ZERO, 0.05), (Vec3::Y, 0.05)], 4);
    let tree = found(square.clone());
    let nodes = axis_nodes(&tree, 0);
    let reach = |from: f32, node: &(Vec3, f32)| (node.0 - Vec3::Y * from).length();
    assert!(reach(0.0, &nodes[0]) < 0.1 && reach(1.0, &nodes[nodes.len() - 1]) < 0.1, "{nodes:?}");
    let mut both = square;
    both.points.iter_mut().for_each(|p| *p += Vec3::X);
    both.append(&straight(Vec3::ZERO, Vec3::Y, 0.01, 5));
    assert!(found(both).plant.nodes.p.iter().all(|p| p.x < 0.1));
}

#[test]
fn a_told_root_and_a_told_spacing_are_kept() {
    let whole = imported(straight(Vec3::ZERO, Vec3::Y, 0.01, 50));
    let options = SkeletonOptions { root: Some(Vec3::Y), spacing: Some(0.1), ..options() };
    let tree = extract_skeleton(&whole, &options, &Cancel::default()).expect("skeleton");
    let nodes = axis_nodes(&tree, 0);
    assert!(nodes[0].0.y > 0.99 && nodes[nodes.len() - 1].0.y < 0.01, "it stands on its head");
    assert!((9..=12).contains(&((nodes.len() - 1) / axes::NODES_PER_CLUSTER - 1)), "{} nodes", nodes.len());
}

#[test]
fn what_has_no_skeleton_is_refused_with_a_reason() {
    let refusal = |mesh: Mesh, words: &[&str]| {
        let words = words.iter().map(|w| (*w).to_owned()).collect();
        match extract_skeleton(&imported(mesh), &SkeletonOptions { leaf_words: words, ..options() }, &Cancel::default())
        {
            Err(Error::Input(report)) => report.diagnostics[0].clone(),
            other => panic!("{other:?}"),
        }
    };
    let card = refusal(leaf(Vec3::ZERO, Vec3::Y, Vec3::X, 1.0), &[]);
    assert_eq!(card.code, "X018");
    assert!(card.message.contains("no volume"), "{}", card.message);
    let all = refusal(straight(Vec3::ZERO, Vec3::Y, 0.01, 5), &["wood"]);
    assert!(all.code == "X018" && all.message.contains("leaves"), "{}", all.message);
    // The file may be a single leaf, which is no tree.
    for refused in [card, all] {
        assert!(refused.help.is_some_and(|help| help.contains("[plants.NAME.leaf]")));
    }
}

#[test]
fn pieces_in_the_air_are_told() {
    let mut mesh = straight(Vec3::ZERO, Vec3::Y * 2.0, 0.1, 20);
    mesh.append(&straight(Vec3::new(3.0, 1.5, 0.0), Vec3::new(4.0, 1.8, 0.0), 0.02, 10));
    let tree = found(mesh);
    let told: Vec<&str> = tree.report.diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(told, ["X019"]);
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let whole = imported(leafy());
    let made = |threads: usize| {
        let tree = osier_base::par::on_threads(threads, || extract_skeleton(&whole, &options(), &Cancel::default()))
            .expect("skeleton");
        let plant = tree.plant;
        let bits: Vec<u32> = plant.nodes.p.iter().flat_map(|p| p.to_array()).map(f32::to_bits).collect();
        let bound: Vec<(u32, u32)> = tree.bindings.iter().map(|(a, s)| (*a, s.to_bits())).collect();
        let organs: Vec<[u32; 4]> = plant.organs.iter().map(|o| o.q.to_array().map(f32::to_bits)).collect();
        (bits, bound, organs)
    };
    let one = made(1);
    assert!([2, 5].iter().all(|n| made(*n) == one));
}
