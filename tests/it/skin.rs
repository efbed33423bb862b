//! Plant to tubes: closed, exact where mathematics gives a value, without gaps at forks, finite whatever the plant.
#![allow(clippy::cast_possible_truncation, reason = "small test numbers")]

use std::collections::BTreeMap;

use glam::{Quat, Vec3};
use osier::math;
use osier::plant::{Axis, AxisEnd, AxisKind, NONE, Plant, validate};
use osier::rng::Rng;
use osier::surface::{PlantSkin, SkinOptions, UvMode, skin, skin_into};
use proptest::prelude::*;

/// Appends an axis through the given points.
fn push_axis(plant: &mut Plant, (parent, parent_s): (u32, f32), points: &[(Vec3, f32)], end: AxisEnd) -> u32 {
    let first = plant.nodes.len();
    let mut s = 0.0;
    for (i, &(p, r)) in points.iter().enumerate() {
        let t = if i > 0 { p - points[i - 1].0 } else { points[1].0 - p };
        s += if i > 0 { t.length() } else { 0.0 };
        let n = &mut plant.nodes;
        n.p.push(p);
        n.q.push(math::rotation_between(Vec3::Y, math::normalize_or(t, Vec3::Y)));
        n.r.push(r);
        n.s.push(s);
        n.birth.push(0.0);
        n.color.push(0);
    }
    let id = plant.axes.len() as u32;
    plant.axes.push(Axis {
        id: u64::from(id) + 100,
        parent,
        parent_s,
        order: u8::from(parent != NONE),
        kind: AxisKind::Stem,
        first: first as u32,
        count: points.len() as u32,
        length: s,
        s_exposed: 0.0,
        material: 0,
        fork: NONE,
        end,
        birth: 0.0,
    });
    id
}

fn trunk(points: &[(Vec3, f32)], end: AxisEnd) -> Plant {
    let mut plant = Plant { seed: 3, ..Plant::default() };
    push_axis(&mut plant, (NONE, 0.0), points, end);
    plant
}

fn y(v: f32) -> Vec3 {
    Vec3::Y * v
}

/// Triangles with points of equal place merged.
fn welded(skin: &PlantSkin, triangles: &[[u32; 3]]) -> (usize, Vec<[usize; 3]>) {
    let mut places = BTreeMap::new();
    let mut at = |i: u32| {
        let bits = skin.mesh.points[i as usize].to_array().map(|v| (v + 0.0).to_bits());
        let next = places.len();
        *places.entry(bits).or_insert(next)
    };
    let faces = triangles.iter().map(|t| t.map(&mut at)).collect();
    (places.len(), faces)
}

/// Checks that every tube is closed and consistently wound: each edge twice, in opposite directions, V - E + F = 2.
fn assert_closed(skin: &PlantSkin) {
    for tube in &skin.tubes {
        let (first, count) = (tube.triangles.0 as usize, tube.triangles.1 as usize);
        let (v, faces) = welded(skin, &skin.mesh.triangles[first..first + count]);
        let mut edges: BTreeMap<(usize, usize), i32> = BTreeMap::new();
        for f in &faces {
            for k in 0..3 {
                let (a, b) = (f[k], f[(k + 1) % 3]);
                assert_ne!(a, b, "axis {}: an edge of no length", tube.axis);
                *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
            }
        }
        assert!(edges.values().all(|n| *n == 0), "axis {}: an open edge", tube.axis);
        assert_eq!(v as i64 - edges.len() as i64 + faces.len() as i64, 2, "axis {}", tube.axis);
    }
}

fn volume(skin: &PlantSkin) -> f64 {
    let six = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| skin.mesh.points[i as usize].to_array().map(f64::from));
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    skin.mesh.triangles.iter().map(six).sum::<f64>() / 6.0
}

/// Share of triangles of no area or facing against their vertex normals.
fn bad_triangles(skin: &PlantSkin) -> (usize, usize) {
    let m = &skin.mesh;
    let bad = |t: &&[u32; 3]| {
        let [a, b, c] = t.map(|i| m.points[i as usize]);
        let n = (b - a).cross(c - a);
        let mean = t.iter().fold(Vec3::ZERO, |s, i| s + m.normals[*i as usize]);
        n.length() < 1e-12 || n.dot(mean) <= 0.0
    };
    (m.triangles.iter().filter(bad).count(), m.triangles.len())
}

fn assert_sound(skin: &PlantSkin) {
    let m = &skin.mesh;
    assert_eq!((m.points.len(), m.points.len()), (m.normals.len(), skin.bindings.len()));
    assert!(m.points.iter().all(|p| p.is_finite()) && m.uvs.iter().all(|p| p.is_finite()));
    assert!(m.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
    assert!(skin.bindings.iter().all(|b| b.s.is_finite() && b.s >= 0.0));
    let covered: u32 = m.subsets.iter().map(|s| s.count).sum();
    assert_eq!(covered as usize, m.triangles.len());
}

#[test]
fn a_prism_is_closed_and_has_its_volume() {
    let plant = trunk(&[(y(0.0), 0.1), (y(1.0), 0.1), (y(2.0), 0.1)], AxisEnd::Cut);
    let options = SkinOptions { sides: (12, 12), ..SkinOptions::default() };
    let skin = skin(&plant, &options).expect("skin");
    assert_closed(&skin);
    assert_sound(&skin);
    assert_eq!(bad_triangles(&skin).0, 0);
    let expected = 6.0 * math::sin(std::f64::consts::TAU / 12.0) * 0.01 * 2.0;
    assert!((volume(&skin) - expected).abs() < 1e-5 * expected, "{} instead of {expected}", volume(&skin));
}

#[test]
fn normals_of_a_cone_are_exact_and_its_texture_is_not_stretched() {
    let points: Vec<_> = (0..=20).map(|i| (y(i as f32 * 0.1), 0.2 - 0.009 * i as f32)).collect();
    let plant = trunk(&points, AxisEnd::Cut);
    let skin = skin(&plant, &SkinOptions::default()).expect("skin");
    let m = &skin.mesh;
    let lean = 1.0 / (1.0_f32 + 0.09 * 0.09).sqrt();
    let mut sides = 0;
    for (p, n) in m.points.iter().zip(&m.normals).filter(|(p, n)| n.y.abs() < 0.9 && p.y < 2.1) {
        let radial = Vec3::new(p.x, 0.0, p.z).normalize();
        assert!((*n - (radial * lean + y(0.09 * lean))).length() < 1e-5, "{n} at {p}");
        sides += 1;
    }
    assert!(sides > 200);
    for t in &m.triangles {
        let [a, b, c] = t.map(|i| i as usize);
        // The thinnest quarter is mapped as if it were thicker.
        if m.points[c].y.max(m.points[b].y) > 1.6 {
            continue;
        }
        let up = m.points[c] - m.points[b];
        if m.normals[a].y.abs() > 0.9 || up.y.abs() < 0.01 || (m.uvs[b].x - m.uvs[c].x).abs() > 1e-5 {
            continue;
        }
        let radius = Vec3::new(m.points[b].x + m.points[c].x, 0.0, m.points[b].z + m.points[c].z).length() / 2.0;
        // Metres per unit of v against metres per unit of u; one turn is two repeats (0.2 m, tile 0.5 m).
        let along = up.length() / (m.uvs[c].y - m.uvs[b].y);
        let around = std::f32::consts::TAU * radius / 3.0;
        assert!((along / around - 1.0).abs() < 0.03, "{along} against {around} at radius {radius}");
    }
}

#[test]
fn the_seam_differs_by_whole_repeats() {
    let plant = trunk(&[(y(0.0), 0.2), (y(1.0), 0.18)], AxisEnd::Tip);
    for uv in [UvMode::Conformal, UvMode::Metric] {
        let skin = skin(&plant, &SkinOptions { uv, sides: (8, 8), ..SkinOptions::default() }).expect("skin");
        // The first nine points are the cap's ring, then its middle, then the first ring.
        let (a, b) = (skin.mesh.uvs[10], skin.mesh.uvs[18]);
        assert_eq!(skin.mesh.points[10], skin.mesh.points[18]);
        assert!((b.x - a.x - 3.0).abs() < 1e-6 && (b.y - a.y).abs() < 1e-6, "{a} {b}");
    }
}

#[test]
fn bark_of_a_fixed_size_keeps_it_on_the_end_of_an_axis() {
    let plant = trunk(&[(y(0.0), 0.2), (y(1.0), 0.18)], AxisEnd::Tip);
    let options = SkinOptions { uv: UvMode::Metric, sides: (8, 8), ..SkinOptions::default() };
    let skin = skin(&plant, &options).expect("skin");
    // The last points: the last ring of the wall, two rings of the dome, its apex, which lies a radius of 0.18 m beyond the wall.
    let v = |back: usize| skin.mesh.uvs[skin.mesh.uvs.len() - back].y;
    let (wall, first, apex) = (v(1 + 9 + 9 + 9), v(1 + 9 + 9), v(1));
    assert!((apex - wall - 0.18 / 0.5).abs() < 1e-5, "{wall} to {apex}");
    assert!((first - wall - 0.5 * 0.18 / 0.5).abs() < 1e-5, "{wall} to {first}");
}

#[test]
fn shoots_have_repeats_of_their_own_size() {
    let plant = trunk(&[(y(0.0), 0.05), (y(1.0), 0.05)], AxisEnd::Tip);
    let uvs = |uv: UvMode, thickest: f32| {
        let shoot = Some((thickest, 1));
        let options = SkinOptions { uv, sides: (8, 8), shoot, shoot_tile: [0.1; 2], ..SkinOptions::default() };
        skin(&plant, &options).expect("skin").mesh.uvs
    };
    // Points 10 to 18 are the first ring of the wall. A girth of 0.314 m holds three repeats of 0.1 m, one of 0.5 m.
    for (thickest, repeats) in [(0.06, 3.0), (0.04, 1.0)] {
        let around = uvs(UvMode::Conformal, thickest);
        assert!((around[18].x - around[10].x - repeats).abs() < 1e-6);
    }
    // Two rings of the dome and its apex follow the last ring of the wall, a metre above the first.
    for (thickest, repeats) in [(0.06, 10.0), (0.04, 2.0)] {
        let along = uvs(UvMode::Metric, thickest);
        assert!((along[along.len() - 1 - 3 * 9].y - along[10].y - repeats).abs() < 1e-4);
    }
}

#[test]
fn used_memory_does_not_show() {
    let options = SkinOptions::default();
    let (mut large, mut small) = (wandering(1, 60), wandering(2, 20));
    validate(&mut large).expect("sound");
    validate(&mut small).expect("sound");
    let mut again = skin(&large, &options).expect("skin");
    for plant in [&small, &large] {
        skin_into(plant, &options, &mut again).expect("skin");
        let fresh = skin(plant, &options).expect("skin");
        assert!(again.mesh.points == fresh.mesh.points && again.mesh.normals == fresh.mesh.normals);
        assert!(again.mesh.triangles == fresh.mesh.triangles && again.mesh.uvs == fresh.mesh.uvs);
        assert!(again.bindings == fresh.bindings && again.tubes == fresh.tubes);
    }
}

/// A trunk along +Y with one branch of the given angle and radius ratio.
fn fork(angle_deg: f32, ratio: f32, azimuth: f32) -> Plant {
    let r = 0.1;
    let points: Vec<_> = (0..=10).map(|i| (y(i as f32 * 0.2), r - 0.002 * i as f32)).collect();
    let mut plant = trunk(&points, AxisEnd::Tip);
    let site = plant.frame(&plant.axes[0], 1.0);
    let a = angle_deg.to_radians();
    let out = Vec3::new(math::cos_f32(azimuth), 0.0, math::sin_f32(azimuth));
    let dir = out * math::sin_f32(a) + y(math::cos_f32(a));
    let branch: Vec<_> =
        (0..=8).map(|i| (site.p + dir * (i as f32 * 0.15), site.r * ratio * (1.0 - 0.05 * i as f32))).collect();
    push_axis(&mut plant, (0, 1.0), &branch, AxisEnd::Tip);
    plant
}

/// Distance to the trunk's cone of [`fork`], negative inside.
fn outside_trunk(p: Vec3) -> f32 {
    Vec3::new(p.x, 0.0, p.z).length() - (0.1 - 0.01 * p.y)
}

#[test]
fn feet_of_branches_lie_on_their_parent() {
    let mut draw = Rng::at(11, &["forks".into()]);
    for _ in 0..200 {
        let (angle, ratio) = (draw.range(25.0, 150.0) as f32, draw.range(0.05, 1.0) as f32);
        let mut plant = fork(angle, ratio, draw.range(0.0, std::f64::consts::TAU) as f32);
        validate(&mut plant).expect("sound");
        let skin = skin(&plant, &SkinOptions { edge: 0.02, ..SkinOptions::default() }).expect("skin");
        assert_closed(&skin);
        assert_sound(&skin);
        let (bad, all) = bad_triangles(&skin);
        assert!(bad * 1000 <= all, "{bad} of {all} at {angle} deg, ratio {ratio}");
        let tube = skin.tubes.iter().find(|t| t.axis == 1).expect("branch");
        let (first, count) = (tube.points.0 as usize, tube.points.1 as usize);
        let r_c = plant.nodes.r[plant.axes[1].first as usize];
        // Points bound to the trunk are the hidden cap's corners, its middle, and the foot, which is written last.
        let glued: Vec<usize> = (first..first + count).filter(|&i| skin.bindings[i].axis == 0).collect();
        let per_row = (glued.len() - 1) / 2;
        for k in 0..per_row {
            assert_eq!(skin.mesh.points[glued[k]], skin.mesh.points[glued[per_row + 1 + k]], "the cap closes the foot");
        }
        assert!(outside_trunk(skin.mesh.points[glued[per_row]]) < 0.0, "the cap shows at {angle} deg, ratio {ratio}");
        for &i in &glued[glued.len() - per_row..] {
            let gap = outside_trunk(skin.mesh.points[i]);
            let chord = 0.1 * (1.0 - math::cos_f32(std::f32::consts::PI / 31.0)) + 1e-3;
            assert!(gap < 0.1 * r_c && gap > -chord - 0.1 * r_c, "gap {gap} at {angle} deg, ratio {ratio}");
        }
    }
}

#[test]
fn a_continuation_shares_its_parents_last_ring() {
    let mut plant = trunk(&[(y(0.0), 0.1), (y(0.5), 0.1), (y(1.0), 0.09)], AxisEnd::Tip);
    let bend = Vec3::new(0.5, 0.9, 0.1).normalize();
    let branch: Vec<_> = (0..=8).map(|i| (y(1.0) + bend * (i as f32 * 0.2), 0.07 - 0.006 * i as f32)).collect();
    push_axis(&mut plant, (0, 1.0), &branch, AxisEnd::Tip);
    let skin = skin(&plant, &SkinOptions::default()).expect("skin");
    assert_closed(&skin);
    let n = (skin.tubes[1].points.0..).take_while(|&i| skin.mesh.normals[i as usize].y < -0.9).count();
    let ring = skin.tubes[1].points.0 as usize + n;
    let m = &skin.mesh;
    let end = skin.tubes[0].points.1 as usize;
    for i in ring..ring + n - 1 {
        let twin = (0..end)
            .filter(|&k| m.normals[k].y.abs() < 0.5)
            .find(|&k| (m.points[k] - m.points[i]).length() < 1e-5 && (m.uvs[k].x - m.uvs[i].x).abs() < 1e-4)
            .expect("a corner of the parent's last ring");
        let dv = m.uvs[twin].y - m.uvs[i].y;
        assert!((dv - dv.round()).abs() < 1e-4, "v goes on, up to whole repeats: {dv}");
        assert!((m.normals[twin] - m.normals[i]).length() < 0.3);
    }
}

/// Least, mean and greatest distance of the points of a trunk along +Y from its axis, between two heights.
fn girth(skin: &PlantSkin, heights: [f32; 2]) -> [f32; 3] {
    // The middle of the cap on the axis is no part of the wall.
    let wall = skin.mesh.points.iter().filter(|p| (heights[0]..=heights[1]).contains(&p.y));
    let out: Vec<f32> = wall.map(|p| p.x.hypot(p.z)).filter(|r| *r > 1e-3).collect();
    let mean = out.iter().sum::<f32>() / out.len() as f32;
    [out.iter().copied().fold(f32::INFINITY, f32::min), mean, out.iter().copied().fold(0.0, f32::max)]
}

#[test]
fn a_trunk_widens_to_its_roots_and_stays_closed() {
    let points: Vec<(Vec3, f32)> = (0..=10_u8).map(|k| (y(f32::from(k) * 0.5), 0.3)).collect();
    let plant = trunk(&points, AxisEnd::Cut);
    let flared =
        |buttresses| SkinOptions { flare: 0.8, flare_height: 1.5, buttresses, bury: 0.2, ..SkinOptions::default() };
    let (round, ridged) = (skin(&plant, &flared(0)).expect("skin"), skin(&plant, &flared(5)).expect("skin"));
    for one in [&round, &ridged] {
        assert_closed(one);
        assert_sound(one);
        assert_eq!(bad_triangles(one).0, 0);
        // r (1 + 0.8) at the ground; at 1.2 m, which is 2.7 heights of the flare, 5.6 % more than r.
        let [_, mean, _] = girth(one, [-0.21, 0.01]);
        assert!((mean / 0.54 - 1.0).abs() < 0.03, "{mean}");
        let [_, mean, _] = girth(one, [1.2, 5.0]);
        assert!(mean < 0.3 * 1.06, "{mean}");
    }
    let [least, _, most] = girth(&round, [-0.2, 0.01]);
    assert!(most - least < 1e-4, "round: {least} {most}");
    let [least, _, most] = girth(&ridged, [-0.2, 0.01]);
    assert!(most > 1.2 * 0.54 && (0.3..0.49).contains(&least), "ridges: {least} {most}");
    // Another trunk has other roots.
    let mut other = plant.clone();
    other.axes[0].id = 7;
    assert!(skin(&other, &flared(5)).expect("skin").mesh.points != ridged.mesh.points);
    assert!(skin(&plant, &flared(5)).expect("skin").mesh.points == ridged.mesh.points);
    // A tube of 32 sides carries eight ridges, four sides each.
    let [eight, twelve] = [8, 12].map(|count| skin(&plant, &flared(count)).expect("skin").mesh.points);
    assert!(eight == twelve && twelve != round.mesh.points, "twelve ridges leave the trunk round");
}

#[test]
fn degenerate_plants_neither_panic_nor_give_nan() {
    let tiny = 1e-6;
    let cases: [&[(Vec3, f32)]; 5] = [
        &[(y(0.0), 0.1), (y(0.0), 0.1)],
        &[(y(0.0), 0.0015), (y(tiny), 0.0015)],
        &[(y(0.0), 0.1), (y(1.0), 0.1), (y(0.0), 0.1)],
        &[(y(0.0), 1e-9), (y(1.0), 1e-9)],
        &[(y(0.0), 50.0), (y(0.01), 50.0)],
    ];
    for (k, points) in cases.iter().enumerate() {
        let mut plant = trunk(points, AxisEnd::Tip);
        push_axis(&mut plant, (0, 0.0), points, AxisEnd::Tip);
        let length = plant.axes[0].length;
        push_axis(&mut plant, (0, length), points, AxisEnd::Cut);
        validate(&mut plant).unwrap_or_else(|e| panic!("case {k}: {e}"));
        let skin = skin(&plant, &SkinOptions { flare: 0.6, bury: 0.1, buttresses: 5, ..SkinOptions::default() })
            .expect("skin");
        assert_sound(&skin);
    }
    assert!(skin(&Plant::default(), &SkinOptions::default()).expect("nothing").mesh.points.is_empty());
}

/// A plant of wandering axes: up to `n` of them, each leaving an earlier one somewhere.
fn wandering(seed: u64, n: usize) -> Plant {
    let mut draw = Rng::at(seed, &["plant".into()]);
    let mut plant = Plant { seed, ..Plant::default() };
    for i in 0..n {
        let parent = if i == 0 { NONE } else { draw.below(i as u32) };
        let (start, r0, parent_s, dir) = match plant.axes.get(parent as usize) {
            None => (Vec3::ZERO, 0.1, 0.0, Vec3::Y),
            Some(axis) => {
                let share = if draw.chance(0.3) { 1.0 } else { draw.range(0.1, 0.95) as f32 };
                let site = plant.frame(axis, axis.length * share);
                let a = draw.range(0.3, 2.0) as f32;
                let turn =
                    Quat::from_rotation_y(draw.range(0.0, std::f64::consts::TAU) as f32) * Quat::from_rotation_z(a);
                (
                    site.p,
                    (site.r * draw.range(0.1, 0.95) as f32).max(5e-4),
                    axis.length * share,
                    site.q * turn * Vec3::Y,
                )
            }
        };
        let steps = 2 + draw.below(14);
        let mut points = vec![(start, r0)];
        let (mut p, mut d) = (start, dir);
        for k in 1..=steps {
            let step = r0 * draw.range(0.8, 8.0) as f32;
            let wander = Vec3::new(draw.normal() as f32, draw.normal() as f32, draw.normal() as f32) * 0.25;
            d = (d + wander).normalize();
            p += d * step;
            points.push((p, (r0 * (1.0 - 0.9 * k as f32 / steps as f32)).max(5e-4)));
        }
        push_axis(&mut plant, (parent, parent_s), &points, AxisEnd::Tip);
    }
    plant
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn random_plants_are_sound(seed in any::<u64>(), n in 20_usize..60, flare in 0.0_f32..1.5, height in 0.5_f32..4.0) {
        let mut plant = wandering(seed, n);
        validate(&mut plant).expect("sound");
        // Every second flare has ridges, as many as the height happens to say.
        let buttresses = (height * 10.0) as u32 % 2 * (height * 2.0) as u32;
        let options = SkinOptions { flare, flare_height: height, buttresses, edge: 0.02, ..SkinOptions::default() };
        let skin = skin(&plant, &options).expect("skin");
        assert_sound(&skin);
        assert_closed(&skin);
        let (bad, all) = bad_triangles(&skin);
        prop_assert!(bad * 1000 <= all, "{bad} of {all} triangles are bad");
    }
}

#[test]
#[cfg(feature = "parallel")]
fn threads_do_not_change_the_bytes() {
    let mut plant = wandering(5, 3000);
    validate(&mut plant).expect("sound");
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| skin(&plant, &SkinOptions::default()).expect("skin"))
    };
    let one = run(1);
    for n in [2, 5] {
        let other = run(n);
        assert!(one.mesh.points == other.mesh.points && one.mesh.normals == other.mesh.normals);
        assert!(one.mesh.triangles == other.mesh.triangles && one.mesh.uvs == other.mesh.uvs);
        assert!(one.bindings == other.bindings);
    }
}

/// The first two points of a branch's centreline are in one place: its first ring must still face along the branch.
#[test]
fn a_branch_whose_first_points_coincide_is_not_inside_out() {
    let mut plant = wandering(16458108182241259158, 20);
    validate(&mut plant).expect("sound");
    let skin = skin(&plant, &SkinOptions { flare: 0.0, ..SkinOptions::default() }).expect("skin");
    assert_eq!(bad_triangles(&skin).0, 0);
}
