use super::*;
use crate::tests::system;

fn small() -> LeafSpec {
    LeafSpec { side: 256, ..LeafSpec::default() }
}

#[test]
fn leaves_have_their_anchor_and_tip() {
    for (name, anchor, tip) in [("bamboo_leaf", [0.50, 0.327], [0.50, 0.97]), ("fern_leaf", [0.0, 0.0], [2.66, 9.96])] {
        let spec = LeafSpec { anchor: (name == "bamboo_leaf").then_some(anchor), ..small() };
        let made = leaf(&system(name), &spec).expect("a leaf");
        let size = DVec2::from_array(tip).distance(DVec2::from_array(anchor));
        assert!(made.ends[0].distance(DVec2::from_array(anchor)) < 0.01 * size, "{name}: {:?}", made.ends);
        assert!(made.ends[1].distance(DVec2::from_array(tip)) < 0.03 * size, "{name}: {:?}", made.ends);
        assert!(made.warnings.is_empty(), "{:?}", made.warnings);
        assert!(made.cleaned.largest > 0.98, "{:?}", made.cleaned);
    }
}

#[test]
fn the_bamboo_leaf_covers_what_is_known() {
    let made =
        leaf(&system("bamboo_leaf"), &LeafSpec { side: 512, close: 0.0, ..LeafSpec::default() }).expect("a leaf");
    let cover = made.raster.mask.cover();
    assert!((cover - 0.1745).abs() < 0.03, "{cover}");
}

#[test]
fn blades_are_sound() {
    for name in ["bamboo_leaf", "fern_leaf"] {
        for (detail, most) in [(8.0, 1000), (2.0, 4000)] {
            let made = leaf(&system(name), &LeafSpec { detail, side: 512, ..LeafSpec::default() }).expect("a leaf");
            let FlatBlade { points, triangles } = &made.flat;
            assert!(triangles.len() < most, "{name} at {detail}: {} triangles", triangles.len());
            let mut edges: std::collections::BTreeMap<(u32, u32), u32> = std::collections::BTreeMap::new();
            let mut area = 0.0;
            for t in triangles {
                let [a, b, c] = t.map(|i| points[i as usize]);
                let twice = (b - a).perp_dot(c - a);
                assert!(twice > 0.0, "{name}: counter-clockwise");
                area += twice;
                for (u, v) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                    *edges.entry((u.min(v), u.max(v))).or_default() += 1;
                }
            }
            let outline = outline::area2(&made.rings[0]);
            assert!((area / outline - 1.0).abs() < 1e-6, "{name} at {detail}: {area} of {outline}");
            let euler = points.len() as i64 - edges.len() as i64 + triangles.len() as i64;
            assert_eq!(euler, 1, "{name} at {detail}: one piece without holes");
            let border = edges.values().filter(|n| **n == 1).count();
            assert_eq!(border, made.rings[0].len(), "{name}: the border is the outline");
            assert!(edges.values().all(|n| *n <= 2));
        }
    }
}

#[test]
fn a_bent_blade_keeps_its_length_and_stands_on_its_stalk() {
    let made = leaf(&system("bamboo_leaf"), &small()).expect("a leaf");
    let pose = BladePose { size: 0.08, width: None, curl: 0.0, fold: 0.0, twist: 0.0, petiole: (0.02, 0.0005) };
    let flat = bent(&made.flat, &made.place, &pose);
    let b = flat.bounds();
    assert!((b.max.y - 0.1).abs() < 0.004, "{b:?}");
    assert!(b.max.z < 0.001 && flat.normals.iter().filter(|n| n.z > 0.99).count() >= made.flat.points.len());
    let curled = bent(&made.flat, &made.place, &BladePose { curl: 1.0, fold: 0.3, ..pose });
    assert!(curled.bounds().max.y < b.max.y && curled.bounds().min.z < -0.01);
    let narrow = bent(&made.flat, &made.place, &BladePose { width: Some(0.25), ..pose }).bounds();
    assert!((narrow.size().x - 0.02).abs() < 1e-4 && (narrow.size().y - b.size().y).abs() < 1e-6, "{narrow:?}");
    assert!(curled.uvs.iter().all(|t| (0.0..=1.0).contains(&t.x) && (0.0..=1.0).contains(&t.y)));
}

#[test]
fn fields_are_in_range_and_the_same_at_any_thread_count() {
    let of = || {
        let made = leaf(&system("fern_leaf"), &small()).expect("a leaf");
        let f = fields(&made.raster, &LeafColors::default(), 1.0);
        let n = normals(&f.height, &made.raster.mask.set, 256);
        (made.raster.hits.clone(), f, n)
    };
    let one = of();
    assert!(one.1.height.iter().all(|h| (0.0..=1.0).contains(h)));
    assert!(one.1.color.iter().flatten().all(|c| (0.0..=1.1).contains(c)));
    for threads in [1, 3] {
        assert!(osier_base::par::on_threads(threads, of) == one, "{threads} threads");
    }
}
