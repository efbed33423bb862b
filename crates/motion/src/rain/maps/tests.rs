use glam::Vec3;

use super::*;
use crate::rain::drops::spherical_cap::{UndeformedPoint, WettingParams};
use crate::rain::leaf::relief::tests::waves;
use crate::rain::leaf::surface::tests::flat;
use crate::rain::simulation::{LeafOnPlant, RainConfig, RainSimulation};
use crate::rain::target::StillRainPlant;
use crate::rain::tuning::MAP_BLEED;
use crate::rain::{LeafCollider, RainFrame, RainLeaf, RainSolids};
use osier_base::rng::Rng;

fn blade() -> LeafSurface {
    LeafSurface::new(&flat(0.08, 0.04, 8)).expect("a blade")
}

/// A blade of 80 by 40 mm without the corners of its texture.
fn rounded_blade() -> LeafSurface {
    let mut mesh = flat(0.08, 0.04, 32);
    let uvs = mesh.uvs.clone();
    mesh.triangles.retain(|t| t.iter().all(|i| uvs[*i as usize].distance(glam::Vec2::splat(0.5)) < 0.48));
    LeafSurface::new(&mesh).expect("a blade")
}

/// A spot of a drop that has not moved.
fn spot(uv: DVec2, a: f64, t: f64) -> WetSpot {
    WetSpot { uv, from: uv, a, t }
}

fn cap_at(uv: DVec2, volume: f64, stretch: f64, skew: f64) -> CapOnLeaf {
    let params = DropParams::default();
    CapOnLeaf { uv, cap: params.wetting.cap(volume), deformation: CapDeformation { stretch, skew }, axis: DVec3::Y }
}

#[test]
fn maps_hold_the_volume_of_a_drop() {
    let blade = blade();
    let params = DropParams::default();
    let raster = Arc::new(UvRaster::new(&blade, 512, None));
    let volume = 4.2e-8;
    for theta in [30.0_f64, 45.0, 60.0, 75.0, 90.0] {
        for (q, skew, omega) in [(1.0, 0.0, None), (1.4, 0.26, None), (1.2, 0.1, Some(0.7))] {
            let wetting = WettingParams { contact_angle: theta.to_radians(), height_factor: omega, ..params.wetting };
            let cap = CapOnLeaf { cap: wetting.cap(volume), ..cap_at(DVec2::splat(0.5), volume, q, skew) };
            let mut wet = LeafWaterMaps::new(Arc::clone(&raster), 1.0);
            wet.advance(&blade, &[cap], &[], 0.0, &params);
            let texel = 0.0032 / (512.0 * 512.0);
            let sum: f64 = wet.maps().height.iter().map(|h| f64::from(*h) * texel).sum();
            assert!((sum / volume - 1.0).abs() < 0.01, "{theta} {q}: {sum}");
        }
    }
}

/// Expected normal by the formula of a cap, at distances from its center along the leaf's x and y, m.
fn meant(b: &CapOnLeaf, x: f64, y: f64) -> DVec3 {
    let height = |x: f64, y: f64| {
        let (along, across) = (x * b.axis.x + y * b.axis.y, x * b.axis.y - y * b.axis.x);
        let UndeformedPoint { rho, height_factor } = b.deformation.to_undeformed(b.cap.a, along, across);
        b.cap.height(rho) * height_factor
    };
    let d = 1e-8;
    let slope = DVec2::new(height(x + d, y) - height(x - d, y), height(x, y + d) - height(x, y - d)) / (2.0 * d);
    DVec3::new(-slope.x, -slope.y, 1.0).normalize()
}

#[test]
fn normals_are_those_of_the_cap() {
    const N: u32 = 1024;
    let (blade, params) = (blade(), DropParams::default());
    let raster = Arc::new(UvRaster::new(&blade, N as usize, None));
    let place = |k: u32, size: f64| (f64::from(k) + 0.5 - 0.5 * f64::from(N)) / f64::from(N) * size;
    for (theta, q, skew, omega) in
        [(60.0, 1.0, 0.0, None), (60.0, 1.4, 0.26, None), (30.0, 1.2, 0.2, None), (90.0, 1.1, 0.1, Some(0.7))]
    {
        for turn in [0.0_f64, 30.0, 45.0, 90.0, 135.0] {
            let (sin, cos) = (math::sin(turn.to_radians()), math::cos(turn.to_radians()));
            let wetting =
                WettingParams { contact_angle: f64::to_radians(theta), height_factor: omega, ..params.wetting };
            let cap = wetting.cap(20e-9);
            let b = CapOnLeaf { cap, axis: DVec3::new(cos, sin, 0.0), ..cap_at(DVec2::splat(0.5), 20e-9, q, skew) };
            let mut wet = LeafWaterMaps::new(Arc::clone(&raster), 1.0);
            wet.advance(&blade, &[b], &[], 0.0, &params);
            let (mut seen, mut worst) = (0, 0.0_f64);
            for (row, column) in (400..624).flat_map(|row| (400..624).map(move |column| (row, column))) {
                let (x, y) = (place(column, 0.04), -place(row, 0.08));
                let at = b.deformation.to_undeformed(cap.a, x * cos + y * sin, x * sin - y * cos);
                if at.rho < 0.9 {
                    let made = DVec3::from_array(wet.maps().normal[(row * N + column) as usize].map(f64::from));
                    worst = worst.max(math::acos(made.dot(meant(&b, x, y)).min(1.0)).to_degrees());
                    seen += 1;
                }
            }
            assert!(seen > 2000 && worst < 2.0, "{theta} {q} {skew} {omega:?} at {turn}: {worst} of {seen}");
        }
    }
}

#[test]
fn changed_tiles_give_the_same_bits_as_all_of_them() {
    let params = DropParams { decay_time: 0.8, ..DropParams::default() };
    for (blade, relief) in [(blade(), None), (rounded_blade(), Some(waves(5.0, 3e-4)))] {
        let raster = Arc::new(UvRaster::new(&blade, 64, relief.as_ref()));
        let (mut few, mut all) = (LeafWaterMaps::new(Arc::clone(&raster), 1.3), LeafWaterMaps::new(raster, 1.3));
        let mut draw = Rng::at(7, &["blobs".into()]);
        let mut any = |a: f64, b: f64| draw.range(a, b);
        let mut caps: Vec<CapOnLeaf> =
            (0..200).map(|_| cap_at(DVec2::new(any(0.0, 1.0), any(0.0, 1.0)), any(1e-10, 8e-9), 1.0, 0.0)).collect();
        for frame in 0..300 {
            let t = f64::from(frame) / 24.0;
            let mut wet_spots = Vec::new();
            for (i, b) in caps.iter_mut().enumerate() {
                // Some drops run obliquely by several radii, some stretch, others rest.
                if i % 7 == 0 {
                    let from = b.uv;
                    b.uv += DVec2::new(any(-0.02, 0.02), any(-0.06, 0.0));
                    let wraps = b.uv.y < 0.0 || !(0.0..=1.0).contains(&b.uv.x);
                    b.uv = if wraps { DVec2::new(any(0.0, 1.0), 0.98) } else { b.uv };
                    b.deformation = CapDeformation { stretch: 1.0 + any(0.0, 0.5), skew: any(0.0, 0.26) };
                    wet_spots.push(WetSpot { uv: b.uv, from: if wraps { b.uv } else { from }, a: b.cap.a, t });
                }
            }
            few.advance(&blade, &caps, &wet_spots, t, &params);
            all.advance_full(&blade, &caps, &wet_spots, t, &params);
            let bits = |m: &[f32]| m.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert!(bits(&few.maps().height) == bits(&all.maps().height), "heights of frame {frame}");
            assert!(bits(&few.maps().water) == bits(&all.maps().water), "water of frame {frame}");
            assert!(bits(&few.maps().wetness) == bits(&all.maps().wetness), "wetness of frame {frame}");
            assert!(few.maps().normal == all.maps().normal, "normals of frame {frame}");
        }
        assert!(few.texel_counters().heights < all.texel_counters().heights);
    }
}

#[test]
fn heights_are_those_of_relief_and_water_and_normals_have_both() {
    const N: usize = 256;
    let (blade, params) = (blade(), DropParams::default());
    let (count, amplitude) = (4.0, 2e-4_f32);
    let dry = LeafWaterMaps::new(Arc::new(UvRaster::new(&blade, N, Some(&waves(count, amplitude)))), 1.0);
    let smooth = || LeafWaterMaps::new(Arc::new(UvRaster::new(&blade, N, None)), 1.0);
    let (mut both, mut water) = (dry.clone(), smooth());
    let cap = cap_at(DVec2::splat(0.5), 2e-8, 1.0, 0.0);
    both.advance(&blade, &[cap], &[], 0.0, &params);
    water.advance(&blade, &[cap], &[], 0.0, &params);
    assert!(both.maps().water == water.maps().water && water.maps().height == water.maps().water);
    assert!(dry.maps().water.iter().all(|h| *h == 0.0));
    let mut wet = 0;
    for y in 1..N - 1 {
        for x in 1..N - 1 {
            let k = y * N + x;
            let [h, of_water, of_relief] = [&both, &water, &dry].map(|m| m.maps().height[k]);
            assert!((h - of_water - of_relief).abs() < 1e-9, "{x} {y}");
            // Slopes, which are ratios of the components of normals, add up.
            let slope = |m: &LeafWaterMaps| Vec3::from_array(m.maps().normal[k]) / m.maps().normal[k][2];
            let sum = slope(&water) + slope(&dry);
            assert!((slope(&both) - sum).truncate().length() < 1e-4 * sum.truncate().length().max(1.0), "{x} {y}");
            // The slope of the waves along u, over the width of 40 mm.
            let phase = std::f64::consts::TAU * count * (x as f64 + 0.5) / N as f64;
            let meant = -f64::from(amplitude) * std::f64::consts::TAU * count / 0.04 * math::cos(phase);
            assert!((f64::from(slope(&dry).x) - meant).abs() < 0.01 * 0.13, "{x}: {} {meant}", slope(&dry).x);
            wet += usize::from(of_water > 0.0);
        }
    }
    assert!(wet > 400, "{wet}");
}

#[test]
fn maps_continue_beyond_the_margin() {
    const N: usize = 128;
    let (blade, params) = (rounded_blade(), DropParams { decay_length: 1.0, ..DropParams::default() });
    let raster = Arc::new(UvRaster::new(&blade, N, Some(&waves(3.0, 2e-4))));
    let mut wet = LeafWaterMaps::new(raster, 1.0);
    // A wet spot and a drop at the margin, in the middle of one side.
    let uv = DVec2::new(0.95, 0.5);
    wet.advance(&blade, &[cap_at(uv, 6e-8, 1.0, 0.0)], &[spot(uv, 6e-3, 0.0)], 0.0, &params);
    let is_blade = |x: usize, y: usize| {
        blade.point_at(DVec2::new((x as f64 + 0.5) / N as f64, 1.0 - (y as f64 + 0.5) / N as f64), 1.0).is_some()
    };
    let mut seen = 0;
    for y in 61..67 {
        let Some(last) = (64..N).take_while(|x| is_blade(*x, y)).last() else { continue };
        for x in last + 1..=last + MAP_BLEED {
            let (inside, outside) = (y * N + last, y * N + x);
            let maps = wet.maps();
            assert!(maps.wetness[inside] > 0.5 && maps.wetness[outside] > 0.8 * maps.wetness[inside], "{x} {y}");
            assert!(maps.water[inside] > 1e-4 && maps.water[outside] > 0.5 * maps.water[inside], "{x} {y}");
            assert!(maps.height[outside] > maps.water[outside], "{x} {y}");
            // Normals continue beyond the margin as well, except at the outermost texel.
            let [a, b] = [inside, outside].map(|k| Vec3::from_array(maps.normal[k]));
            assert!(x == last + MAP_BLEED || a.dot(b) > 0.95, "{x} {y}: {a} {b}");
            seen += 1;
        }
    }
    assert!(seen >= 6 * MAP_BLEED, "{seen}");
}

/// Wetness map of a steep leaf down which a drop has run for one second, at 24 frames per second with `substeps`.
fn trail(substeps: u32) -> Vec<f32> {
    const N: usize = 256;
    let params = DropParams {
        retention_variation: 0.0,
        decay_time: 1e4,
        decay_length: 1e3,
        bead_probability: 0.0,
        ..DropParams::default()
    };
    let blade = Arc::new(blade());
    let collider = Arc::new(LeafCollider::new(&blade));
    let turn = glam::DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2 - 1.0);
    let leaf = (RainLeaf::new(Arc::clone(&blade), 1.0, 0), LeafOnPlant { plant: 0, leaf: 0, collider });
    let mut simulation = RainSimulation::new(RainConfig {
        params: params.clone(),
        emitter: None,
        plants: vec![Box::new(StillRainPlant::new(&[(DVec3::Y, turn)], Vec::new()))],
        leaves: vec![leaf],
        wind: None,
        ground: Arc::new(0.0),
        solids: RainSolids::default(),
    });
    simulation.deposit_drop(0, DVec2::new(0.5, 0.15), DVec3::ZERO, 40e-9);
    let mut wet = LeafWaterMaps::new(Arc::new(UvRaster::new(&blade, N, None)), 1.0);
    for _ in 0..48 {
        (0..substeps).for_each(|_| simulation.step(1.0 / (24.0 * f64::from(substeps))).expect("stiff"));
        let frame = RainFrame::capture(&mut simulation);
        let water = frame.leaf_map_input(0);
        wet.advance(&blade, &water.caps, &water.wet_spots, frame.t, &params);
    }
    // The drop has run over more than half of the leaf.
    let rows = wet.maps().wetness.chunks(N).filter(|row| row.iter().any(|w| *w > 0.5)).count();
    assert!(rows > N / 2, "{substeps}: {rows}");
    wet.maps().wetness.to_vec()
}

#[test]
fn trails_are_ribbons_whatever_the_step() {
    let trails = [4, 16, 64].map(trail);
    let area = |w: &[f32]| w.iter().filter(|w| **w > 0.5).count() as f64;
    let meant = area(&trails[2]);
    for trail in &trails {
        assert!((area(trail) / meant - 1.0).abs() < 0.02, "{} {meant}", area(trail));
        // No scallops: no row is narrower than rows on both sides of it.
        let widths: Vec<usize> = trail.chunks(256).map(|row| row.iter().filter(|w| **w > 0.5).count()).collect();
        for k in 60..200 {
            let widest = |rows: &[usize]| rows.iter().copied().max().unwrap_or(0);
            let around = widest(&widths[k - 12..k]).min(widest(&widths[k + 1..k + 13]));
            assert!(widths[k] > 20 && widths[k] + 3 >= around, "row {k}: {:?}", &widths[k - 12..k + 13]);
        }
    }
}

#[test]
fn wetness_halves_and_keeps_the_larger() {
    let blade = blade();
    let params = DropParams::default();
    let mut wet = LeafWaterMaps::new(Arc::new(UvRaster::new(&blade, 128, None)), 1.0);
    let middle = 64 * 128 + 64;
    let soak = |a: f64, t: f64| spot(DVec2::new(0.5 + 0.5 / 128.0, 0.5 - 0.5 / 128.0), a, t);
    wet.advance(&blade, &[], &[soak(2e-3, 0.0)], 0.0, &params);
    let first = wet.maps().wetness[middle];
    assert!((first - 1.0).abs() < 1e-4);
    wet.advance(&blade, &[], &[], 20.0, &params);
    assert!((wet.maps().wetness[middle] - 0.5).abs() < 1e-4);
    // A second spot beside it: where it would be less wet, the older wetness remains.
    let beside = spot(DVec2::new(0.57, 0.5), 3e-3, 20.0);
    wet.advance(&blade, &[], &[beside], 20.0, &params);
    assert!((wet.maps().wetness[middle] - 0.5).abs() < 0.02);
    wet.advance(&blade, &[], &[], 400.0, &params);
    assert!(wet.maps().wetness.iter().all(|w| *w == 0.0));
}

#[test]
fn the_wet_area_does_not_hang_on_the_resolution() {
    let blade = blade();
    let params = DropParams::default();
    let area = |n: usize| {
        let mut wet = LeafWaterMaps::new(Arc::new(UvRaster::new(&blade, n, None)), 1.0);
        wet.advance(&blade, &[], &[spot(DVec2::new(0.5, 0.5), 4e-3, 0.0)], 0.0, &params);
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
    for (blade, meant) in [(blade(), false), (LeafSurface::new(&folded).expect("a blade"), true)] {
        let raster = UvRaster::new(&blade, 61, None);
        assert_eq!(raster.blade_is_folded(), meant);
        let wet = LeafWaterMaps::new(Arc::new(raster), 1.0);
        let stamps = wet.cap_stamps(&blade, &[cap_at(DVec2::new(0.5, 0.4), 3e-8, 1.2, 0.2)]);
        let heights = |arch: Arch| {
            let mut made = vec![0.0; 61 * 61];
            let (raster, window) = (&*wet.raster, TexelWindow::full(61));
            let (rows, spans) = (0..61, RowSpans::full(61));
            let kernel = &stamps[0].kernel;
            arch.dispatch(MaxBlendPass {
                kernel,
                window: &window,
                raster,
                rows: &rows,
                spans: &spans,
                texels: &mut made,
            });
            made
        };
        let made = heights(kernels::arch());
        assert_eq!(made, heights(Arch::Scalar));
        assert_eq!(made, heights(Arch::new()));
        // Rows of v = 0.4 and 0.6, which coincide in space where the blade is folded.
        let wet_at = |y: usize| made[y * 61..(y + 1) * 61].iter().any(|h| *h > 0.0);
        assert!(wet_at(36) && !wet_at(24), "not through the fold");
    }
}
