use super::*;

/// Hairs of three sections in many directions.
fn plant(n: usize) -> Plant {
    use osier_scene::plant::{Axis, AxisEnd, AxisKind, NONE};
    let mut plant = Plant { materials: vec!["hair".into()], ..Plant::default() };
    for i in 0..n {
        let mut rng = Rng::at(5, &["direction".into(), (i as u64).into()]);
        let first = u32::try_from(plant.nodes.len()).expect("small");
        let mut p = Vec3::ZERO;
        for k in 0..4 {
            plant.nodes.p.push(p);
            plant.nodes.q.push(glam::Quat::IDENTITY);
            plant.nodes.r.push(1e-5);
            plant.nodes.s.push(k as f32 * 0.005);
            plant.nodes.birth.push(0.0);
            plant.nodes.color.push(0);
            let d = Vec3::new(rng.unit_f32() - 0.5, rng.unit_f32(), rng.unit_f32() - 0.5);
            p += d.normalize() * 0.005;
        }
        plant.axes.push(Axis {
            id: i as u64,
            parent: NONE,
            parent_s: 0.0,
            order: 0,
            kind: AxisKind::Stem,
            first,
            count: 4,
            length: 0.015,
            s_exposed: 0.0,
            material: 0,
            fork: NONE,
            end: AxisEnd::Tip,
            birth: 0.0,
        });
    }
    plant
}

const SPEC: TuftSpec = TuftSpec { jitter: 0.15, radius: 30e-6, tip: 0.25, smooth: 0, stalk: 0.4e-3, materials: [0, 1] };

/// Area of the triangles of one material that a viewer along `d` sees, each counted.
fn seen(mesh: &Mesh, d: Vec3) -> f64 {
    let hairs = mesh.subsets.iter().filter(|s| s.material == 0).flat_map(|s| mesh.subset_triangles(s));
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.points[i as usize]);
        f64::from((b - a).cross(c - a).dot(d).abs()) * 0.5
    };
    hairs.map(area).sum()
}

#[test]
fn numbers_of_every_level() {
    let t = tuft(&plant(100), &SPEC, 7);
    assert_eq!((t.hairs.counts.len(), t.hairs.points.len(), t.hairs.widths.len()), (100, 400, 400));
    let curves_prototype = t.curves_prototype("p000").fine.expect("curves");
    assert_eq!(curves_prototype.mesh.triangles.len(), 168);
    for (detail, points, triangles) in [
        (TuftDetail::Tubes, 1200, 1800 + 168),
        (TuftDetail::Ribbons, 800, 600 + 48),
        (TuftDetail::Thinned, 240, 180 + 12),
    ] {
        let mesh = t.mesh(detail);
        let hair: usize = mesh.subsets.iter().filter(|s| s.material == 0).map(|s| s.count as usize).sum();
        let used: std::collections::BTreeSet<u32> = mesh.triangles[..hair].iter().flatten().copied().collect();
        assert_eq!((used.len(), mesh.triangles.len()), (points, triangles), "{detail:?}");
        assert_eq!(mesh.normals.len(), mesh.points.len());
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{detail:?}");
    }
}

#[test]
fn the_ball_holds_everything_and_touches_the_farthest_point() {
    for (jitter, stalk) in [(0.15, 0.4e-3), (0.9, 0.4e-3), (0.0, 0.02)] {
        let t = tuft(&plant(100), &TuftSpec { jitter, stalk, ..SPEC }, 3);
        let all = t.hairs.points.iter().copied().chain([Vec3::NEG_Y * 4.0 * narrow(stalk)]);
        let far = all.map(|p| p.length()).fold(0.0, f32::max);
        assert!((t.radius - far).abs() < 1e-9, "{} {far}", t.radius);
        let body = t.curves_prototype("p").fine.expect("curves").mesh;
        assert!(body.points.iter().all(|p| p.length() <= t.radius * 1.000_01 && p.y <= 1e-9));
        assert!((body.bounds().min.y + 4.0 * narrow(stalk)).abs() < 1e-6);
    }
}

#[test]
fn thinned_hairs_cover_what_all_of_them_did() {
    for key in 0..20 {
        let t = tuft(&plant(100), &SPEC, key);
        let ratio = projected_area(&t.thinned()) / projected_area(&t.hairs);
        assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
        assert_eq!(t.thinned().counts.len(), 30);
    }
    // Ribbons turned every way show 2 / pi of themselves on the average, and the fewer, wider ones as much.
    let mean = |detail| {
        let all = (0..200_u64).map(|key| {
            let mesh = tuft(&plant(100), &SPEC, key).mesh(detail);
            seen(&mesh, Vec3::X) + seen(&mesh, Vec3::Y) + seen(&mesh, Vec3::Z)
        });
        all.sum::<f64>()
    };
    let ratio = mean(TuftDetail::Thinned) / mean(TuftDetail::Ribbons);
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}

#[test]
fn smoothed_hairs_pass_their_nodes() {
    let rough = tuft(&plant(10), &SPEC, 1);
    let fine = tuft(&plant(10), &TuftSpec { smooth: 16, ..SPEC }, 1);
    assert!(fine.hairs.counts.iter().all(|c| *c == 16));
    for (a, b) in rough.hairs.points.chunks(4).zip(fine.hairs.points.chunks(16)) {
        // Sixteen points on three sections: every fifth is a node.
        for k in 0..4 {
            assert!(a[k].distance(b[5 * k]) < 1e-7, "{} {}", a[k], b[5 * k]);
        }
        assert!(b.windows(2).all(|w| w[0].distance(w[1]) < 0.002));
    }
}

#[test]
fn cards_cover_what_the_hairs_do() {
    use osier_scene::Pixels;
    let t = tuft(&plant(100), &TuftSpec { stalk: 0.0, ..SPEC }, 2);
    for (crossed, quads) in [(false, 1.0), (true, 3.0)] {
        let (mesh, surface) = t.billboards("card", crossed);
        assert_eq!((mesh.triangles.len(), mesh.points.len()), if crossed { (6, 12) } else { (2, 4) });
        for tri in &mesh.triangles {
            let [a, b, c] = tri.map(|i| mesh.points[i as usize]);
            assert!((b - a).cross(c - a).dot(mesh.normals[tri[0] as usize]) > 0.0);
            // A pixel is as wide as it is high, and one tile shows the ball and nothing else.
            let [ua, ub, uc] = tri.map(|i| mesh.uvs[i as usize]);
            let share = f64::from((ub - ua).perp_dot(uc - ua)) * 0.5;
            assert!((share - if crossed { 0.125 } else { 0.5 }).abs() < 1e-6);
        }
        let Pixels::U8(color) = &surface.images[0].pixels else { panic!("bytes") };
        let Pixels::U8(normal) = &surface.images[1].pixels else { panic!("bytes") };
        assert_eq!((color.len(), normal.len()), (256 * 256 * 4, 256 * 256 * 3));
        let cut = f64::from(surface.material.alpha_cutoff.expect("cut")) * 255.0;
        let alphas = || color.chunks(4).map(|p| f64::from(p[3]));
        let projected_area = alphas().sum::<f64>() / 255.0;
        let kept = alphas().filter(|a| *a >= cut).count() as f64;
        assert!((kept / projected_area - 1.0).abs() < 0.12, "{kept} of {projected_area}");
        // Hairs seen from one side cover what their lengths across the view and their widths give, less what overlaps.
        let pixel = f64::from(2.0 * t.radius) / if crossed { 128.0 } else { 256.0 };
        let area = projected_area * pixel * pixel / quads;
        assert!((0.4..1.0).contains(&(area / covered_by(&t))), "{}", area / covered_by(&t));
        // Nothing is black, seen or not; normals lean every way, about the viewer's direction.
        assert!(color.chunks(4).all(|p| p[0] > 200) && normal.chunks(3).all(|n| n[2] >= 127));
        assert!(normal.chunks(3).any(|n| n[0] > 160) && normal.chunks(3).any(|n| n[0] < 96));
    }
}

fn covered_by(t: &Tuft) -> f64 {
    projected_area(&t.hairs)
}
