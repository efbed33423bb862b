use super::super::cap::Wetting;
use super::super::sheet::tests::flat;
use super::*;
use crate::rng::Rng;

fn sheet() -> Sheet {
    Sheet::new(&flat(0.08, 0.04, 8)).expect("a blade")
}

fn blob(uv: DVec2, volume: f64, (q, skew): (f64, f64)) -> Blob {
    let manner = Manner::default();
    Blob { uv, cap: manner.wetting.cap(volume, 1.0), print: Print { q, skew }, axis: DVec3::Y }
}

#[test]
fn maps_hold_the_volume_of_a_drop() {
    let sheet = sheet();
    let manner = Manner::default();
    let chart = Arc::new(Chart::new(&sheet, 512));
    let volume = 4.2e-8;
    for theta in [30.0_f64, 45.0, 60.0, 75.0, 90.0] {
        for (q, skew, omega) in [(1.0, 0.0, None), (1.4, 0.26, None), (1.2, 0.1, Some(0.7))] {
            let wetting = Wetting { theta: theta.to_radians(), omega, ..manner.wetting };
            let blob = Blob { cap: wetting.cap(volume, 1.0), ..blob(DVec2::splat(0.5), volume, (q, skew)) };
            let mut wet = Wetness::new(Arc::clone(&chart), 1.0);
            wet.advance(&sheet, (&[blob], &[]), 0.0, &manner);
            let texel = 0.0032 / (512.0 * 512.0);
            let sum: f64 = wet.maps().water().iter().map(|h| f64::from(*h) * texel).sum();
            assert!((sum / volume - 1.0).abs() < 0.01, "{theta} {q}: {sum}");
        }
    }
}

#[test]
fn normals_are_those_of_the_cap() {
    let sheet = sheet();
    let manner = Manner::default();
    let mut wet = Wetness::new(Arc::new(Chart::new(&sheet, 1024)), 1.0);
    let b = blob(DVec2::splat(0.5), 20e-9, (1.0, 0.0));
    wet.advance(&sheet, (&[b], &[]), 0.0, &manner);
    for k in 1..16 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a column of the map")]
        let column = |rho: f64| 512 + (b.cap.a * rho / 0.04 * 1024.0).round() as usize;
        let rho = 0.9 * f64::from(k) / 16.0;
        let x = column(rho);
        let r1 = (x as f64 + 0.5 - 512.0) / 1024.0 * 0.04;
        let slope = b.cap.omega * r1 / math::sqrt(b.cap.r * b.cap.r - r1 * r1);
        let [nx, ny, nz] = wet.maps().normal[511 * 1024 + x].map(f64::from);
        let off = math::atan2(nx, nz) - math::atan(slope);
        assert!(off.abs().to_degrees() < 2.0, "{rho}: {off}");
        assert!(ny.abs() < 0.02);
    }
}

#[test]
fn changed_tiles_give_the_same_bits_as_all_of_them() {
    let sheet = sheet();
    let manner = Manner { half_life: 0.8, ..Manner::default() };
    let chart = Arc::new(Chart::new(&sheet, 64));
    let (mut few, mut all) = (Wetness::new(Arc::clone(&chart), 1.3), Wetness::new(chart, 1.3));
    let mut draw = Rng::at(7, &["blobs".into()]);
    let mut any = |a: f64, b: f64| draw.range(a, b);
    let mut blobs: Vec<Blob> =
        (0..200).map(|_| blob(DVec2::new(any(0.0, 1.0), any(0.0, 1.0)), any(1e-10, 8e-9), (1.0, 0.0))).collect();
    for frame in 0..300 {
        let t = f64::from(frame) / 24.0;
        let mut soaks = Vec::new();
        for (i, b) in blobs.iter_mut().enumerate() {
            // Some run, some stretch, some lie.
            if i % 7 == 0 {
                b.uv.y -= 0.004;
                if b.uv.y < 0.0 {
                    b.uv.y = 0.98;
                }
                b.print = Print { q: 1.0 + any(0.0, 0.5), skew: any(0.0, 0.26) };
                soaks.push(Soak { uv: b.uv, a: b.cap.a, t });
            }
        }
        few.advance(&sheet, (&blobs, &soaks), t, &manner);
        all.all_over(&sheet, (&blobs, &soaks), t, &manner);
        let bits = |m: &[f32]| m.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert!(bits(&few.maps().height) == bits(&all.maps().height), "heights of frame {frame}");
        assert!(bits(&few.maps().wetness) == bits(&all.maps().wetness), "wetness of frame {frame}");
        assert!(few.maps().normal == all.maps().normal, "normals of frame {frame}");
    }
    assert!(few.touched().poured < all.touched().poured);
}

#[test]
fn wetness_halves_and_keeps_the_larger() {
    let sheet = sheet();
    let manner = Manner::default();
    let mut wet = Wetness::new(Arc::new(Chart::new(&sheet, 128)), 1.0);
    let middle = 64 * 128 + 64;
    let soak = |a: f64, t: f64| Soak { uv: DVec2::new(0.5 + 0.5 / 128.0, 0.5 - 0.5 / 128.0), a, t };
    wet.advance(&sheet, (&[], &[soak(2e-3, 0.0)]), 0.0, &manner);
    let first = wet.maps().wetness[middle];
    assert!((first - 1.0).abs() < 1e-4);
    wet.advance(&sheet, (&[], &[]), 20.0, &manner);
    assert!((wet.maps().wetness[middle] - 0.5).abs() < 1e-4);
    // Wetted again from beside: where that would be less, the old one stays.
    let beside = Soak { uv: DVec2::new(0.57, 0.5), a: 3e-3, t: 20.0 };
    wet.advance(&sheet, (&[], &[beside]), 20.0, &manner);
    assert!((wet.maps().wetness[middle] - 0.5).abs() < 0.02);
    wet.advance(&sheet, (&[], &[]), 400.0, &manner);
    assert!(wet.maps().wetness.iter().all(|w| *w == 0.0));
}

#[test]
fn the_wet_area_does_not_hang_on_the_resolution() {
    let sheet = sheet();
    let manner = Manner::default();
    let area = |n: usize| {
        let mut wet = Wetness::new(Arc::new(Chart::new(&sheet, n)), 1.0);
        wet.advance(&sheet, (&[], &[Soak { uv: DVec2::new(0.5, 0.5), a: 4e-3, t: 0.0 }]), 0.0, &manner);
        wet.maps().wetness.iter().filter(|w| **w > 0.05).count() as f64 / (n * n) as f64
    };
    let (coarse, fine) = (area(128), area(512));
    assert!((coarse / fine - 1.0).abs() < 0.03, "{coarse} {fine}");
}

#[test]
fn vectors_of_any_width_give_the_same_bits() {
    use pulp::Arch;
    // The second half of the blade is folded over the first.
    let mut folded = flat(0.08, 0.04, 8);
    for (p, n) in folded.points.iter_mut().zip(&mut folded.normals).filter(|(p, _)| p.y > 0.04) {
        (p.y, p.z) = (0.08 - p.y, 0.001);
        *n = -*n;
    }
    for (sheet, meant) in [(sheet(), false), (Sheet::new(&folded).expect("a blade"), true)] {
        let chart = Chart::new(&sheet, 61);
        assert_eq!(chart.is_folded(), meant);
        let wet = Wetness::new(Arc::new(chart), 1.0);
        let stamps = wet.stamps(&sheet, &[blob(DVec2::new(0.5, 0.4), 3e-8, (1.2, 0.2))]);
        let press = |arch: Arch| {
            let mut made = vec![0.0; 61 * 61];
            let (chart, whole) = (&*wet.chart, Window::whole(61));
            let (rows, runs) = (0..61, Runs::all(61));
            let stamp = &stamps[0].dome;
            arch.dispatch(Pressed { stamp, window: &whole, chart, rows: &rows, runs: &runs, made: &mut made });
            made
        };
        let made = press(rows::arch());
        assert_eq!(made, press(Arch::Scalar));
        assert_eq!(made, press(Arch::new()));
        // Rows of v = 0.4 and 0.6, which lie upon each other where the blade is folded.
        let wet_at = |y: usize| made[y * 61..(y + 1) * 61].iter().any(|h| *h > 0.0);
        assert!(wet_at(36) && !wet_at(24), "not through the fold");
    }
}
