use super::*;

/// Hairs of three sections in many directions.
fn plant(n: usize) -> Plant {
    use crate::plant::{Axis, AxisEnd, AxisKind, NONE};
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
    let hero = t.hero("p000").fine.expect("curves");
    assert_eq!(hero.mesh.triangles.len(), 168);
    for (detail, points, triangles) in
        [(Detail::Tubes, 1200, 1800 + 168), (Detail::Ribbons, 800, 600 + 48), (Detail::Thinned, 240, 180 + 12)]
    {
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
        let body = t.hero("p").fine.expect("curves").mesh;
        assert!(body.points.iter().all(|p| p.length() <= t.radius * 1.000_01 && p.y <= 1e-9));
        assert!((body.bounds().min.y + 4.0 * narrow(stalk)).abs() < 1e-6);
    }
}

#[test]
fn thinned_hairs_cover_what_all_of_them_did() {
    for key in 0..20 {
        let t = tuft(&plant(100), &SPEC, key);
        let ratio = covered(&t.thinned()) / covered(&t.hairs);
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
    let ratio = mean(Detail::Thinned) / mean(Detail::Ribbons);
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
