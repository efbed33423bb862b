use super::{Terrain, TerrainParams};
use osier_base::math::{ln, pow};

fn raised(relief: &TerrainParams) -> Terrain {
    Terrain::generate(relief).expect("land")
}

#[test]
fn a_larger_land_keeps_the_heights_of_a_smaller_one() {
    for tileable in [false, true] {
        let of = |n| raised(&TerrainParams { n, tileable, seed: 5, ..TerrainParams::default() });
        let (small, large) = (of(8), of(9));
        for j in 0..small.counts[0] {
            for i in 0..small.counts[0] {
                assert_eq!(small.height(i, j).to_bits(), large.height(2 * i, 2 * j).to_bits(), "{i} {j}");
            }
        }
    }
}

#[test]
fn heights_stay_within_their_bound() {
    for (exponent, paper) in [(0.0, false), (0.5, false), (0.8, true), (1.0, false)] {
        let half = if paper { 1.0 } else { pow(2.0, -exponent * 0.5) };
        let bound = (0..7).fold(10.0, |sum, l| sum + 10.0 * pow(2.0, -exponent * f64::from(l)) * (1.0 + half));
        let most = (0..20).fold(0.0_f32, |most, seed| {
            let [lo, hi] =
                raised(&TerrainParams { n: 7, amplitude: 10.0, exponent, paper, seed, ..TerrainParams::default() })
                    .range();
            most.max(hi).max(-lo)
        });
        assert!(f64::from(most) <= bound && f64::from(most) > 0.15 * bound, "H {exponent}: {most} of {bound}");
    }
}

/// Half the slope of log mean (h(x + d) - h(x))^2 over log d, lags 1 to 32.
fn roughness(exponent: f64) -> f64 {
    let lags = [1_usize, 2, 4, 8, 16, 32];
    let mut sums = [0.0; 6];
    for seed in 0..8 {
        let land = raised(&TerrainParams { exponent, seed, ..TerrainParams::default() });
        for (sum, lag) in sums.iter_mut().zip(lags) {
            let n = land.counts[0] - lag;
            let pairs = (0..land.counts[0]).flat_map(|j| (0..n).map(move |i| (i, j)));
            let square = |a: f32, b: f32| (f64::from(a) - f64::from(b)) * (f64::from(a) - f64::from(b));
            let all = pairs.fold(0.0, |s, (i, j)| {
                let along = square(land.height(i + lag, j), land.height(i, j));
                s + along + square(land.height(j, i + lag), land.height(j, i))
            });
            *sum += all / (n * land.counts[0]) as f64;
        }
    }
    let points: Vec<(f64, f64)> = lags.iter().zip(sums).map(|(l, s)| (ln(*l as f64), ln(s))).collect();
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().fold(0.0, |s, p| s + f(p)) / 6.0;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let (over, under) =
        points.iter().fold((0.0, 0.0), |(o, u), (x, y)| (o + (x - mx) * (y - my), u + (x - mx) * (x - mx)));
    over / under / 2.0
}

#[test]
fn roughness_follows_the_exponent() {
    for (exponent, wanted) in [(0.5, 0.45), (0.8, 0.70), (1.0, 0.85)] {
        let found = roughness(exponent);
        assert!((found - wanted).abs() <= 0.05, "H {exponent}: {found}, not {wanted}");
    }
}

#[test]
fn tiles_meet_exactly_and_cover_the_land() {
    for stride in [1, 2] {
        let land = raised(&TerrainParams { n: 9, stride, ..TerrainParams::default() });
        let tiles = land.tiles();
        assert_eq!(tiles.len(), if stride == 1 { 9 } else { 4 });
        assert!(tiles.iter().all(|(_, m)| m.points.len() <= 65_536));
        let cells = 512 / stride as usize;
        assert_eq!(tiles.iter().map(|(_, m)| m.triangles.len()).sum::<usize>(), 2 * cells * cells);
        let edge = |name: &str, axis: usize, most: bool| {
            let mesh = &tiles.iter().find(|(n, _)| n == name).expect("tile").1;
            let far = mesh.points.iter().fold(if most { f32::MIN } else { f32::MAX }, |m, p| {
                if most { m.max(p[axis]) } else { m.min(p[axis]) }
            });
            let on = mesh.points.iter().zip(&mesh.normals).filter(|(p, _)| p[axis].to_bits() == far.to_bits());
            on.map(|(p, n)| (p.to_array().map(f32::to_bits), n.to_array().map(f32::to_bits))).collect::<Vec<_>>()
        };
        assert!(!edge("tile_0_0", 0, true).is_empty());
        assert_eq!(edge("tile_0_0", 0, true), edge("tile_0_1", 0, false));
        assert_eq!(edge("tile_0_1", 2, true), edge("tile_1_1", 2, false));
        for (_, m) in &tiles {
            for t in &m.triangles {
                let [a, b, c] = t.map(|i| m.points[i as usize]);
                assert!((b - a).cross(c - a).y > 0.0, "faces up");
            }
        }
    }
}

#[test]
fn heights_are_those_of_the_triangles() {
    let land = raised(&TerrainParams {
        n: 6,
        size: 50.0,
        amplitude: 9.0,
        exponent: 0.6,
        stride: 2,
        ..TerrainParams::default()
    });
    let (mut worst, mut seen) = (0.0_f32, 0);
    for (_, m) in land.tiles() {
        for t in &m.triangles {
            let [a, b, c] = t.map(|i| m.points[i as usize]);
            for [u, v] in [[0.2, 0.3], [0.7, 0.1], [0.05, 0.9], [0.0, 0.0]] {
                let p = a + (b - a) * u + (c - a) * v;
                worst = worst.max((land.height_at(p.x, p.z) - p.y).abs());
                let n = (b - a).cross(c - a).normalize();
                assert!(u + v < 0.1 || land.normal_at(p.x, p.z).dot(n) > 0.9999);
                seen += 1;
            }
        }
    }
    assert!(worst < 1e-4 && seen == 32 * 32 * 2 * 4, "{worst}");
    assert!((land.height_at(1e6, -1e6) - land.height(64, 0)).abs() < 1e-6, "beyond: the border's");
}

#[test]
fn a_tileable_land_repeats() {
    let land = raised(&TerrainParams { n: 7, tileable: true, smooth: 2, ..TerrainParams::default() });
    for k in 0..land.counts[0] {
        assert_eq!(land.height(0, k).to_bits(), land.height(128, k).to_bits());
        assert_eq!(land.height(k, 0).to_bits(), land.height(k, 128).to_bits());
        assert!(land.normal(0, k, 1).distance(land.normal(128, k, 1)) < 1e-6);
    }
    let open = raised(&TerrainParams { n: 7, ..TerrainParams::default() });
    assert!((0..129).any(|k| (open.height(0, k) - open.height(128, k)).abs() > 1.0));
}

#[test]
fn corners_floor_and_smoothing_are_heeded() {
    let flat = TerrainParams { n: 6, amplitude: 0.0, corners: Some([1.0, 2.0, 3.0, 4.0]), ..TerrainParams::default() };
    let land = raised(&flat);
    let want = [land.height(0, 0), land.height(64, 0), land.height(0, 64), land.height(64, 64)];
    assert!(want.iter().zip([1.0, 2.0, 3.0, 4.0_f32]).all(|(h, c)| h.to_bits() == c.to_bits()), "{want:?}");
    assert!((land.height(32, 32) - 2.5).abs() < 1e-6);
    let rough = TerrainParams { n: 7, exponent: 0.3, ..TerrainParams::default() };
    let steep = |smooth| {
        let land = raised(&TerrainParams { smooth, ..rough.clone() });
        land.heights.windows(2).fold(0.0, |s, w| s + f64::from((w[0] - w[1]).abs()))
    };
    assert!(steep(4) < 0.6 * steep(0));
    let low = raised(&TerrainParams { floor: Some(-2.0), ..rough });
    let at_floor = low.heights.iter().filter(|h| h.to_bits() == (-2.0_f32).to_bits()).count();
    assert!(low.range()[0] >= -2.0 && at_floor > 100);
}

#[test]
fn values_outside_their_ranges_are_refused() {
    let own = TerrainParams::default;
    let wrong = [
        TerrainParams { n: 0, ..own() },
        TerrainParams { n: 14, ..own() },
        TerrainParams { exponent: 1.01, ..own() },
        TerrainParams { exponent: f64::NAN, ..own() },
        TerrainParams { size: 0.0, ..own() },
        TerrainParams { stride: 3, ..own() },
        TerrainParams { n: 2, stride: 8, ..own() },
        TerrainParams { smooth: 9, ..own() },
        TerrainParams { floor: Some(f64::INFINITY), ..own() },
    ];
    assert!(wrong.iter().all(|r| Terrain::generate(r).is_err()));
}

#[test]
fn heights_do_not_depend_on_threads() {
    let of = |threads: usize| {
        osier_base::par::on_threads(threads, || raised(&TerrainParams { smooth: 1, ..TerrainParams::default() }))
            .heights
    };
    let one = of(1);
    assert!([2, 8].into_iter().all(|n| of(n) == one));
}
