//! Maps of wet leaves: cost of a frame by resolution and number of drops, against doing every texel again.
//!
//! Five leaves of 80 x 40 mm; each drop a head of 1 to 2.5 mm and a tail of six that slide at 50 mm/s; height, normals and
//! wetness; one thread. `cargo bench --bench rain`

#![allow(clippy::print_stdout, clippy::expect_used, clippy::disallowed_methods, reason = "a bench measures and prints")]

use std::sync::Arc;
use std::time::Instant;

use glam::{DVec2, DVec3, Vec2, Vec3};
use osier::motion::rain::{Blob, Chart, Manner, Print, Sheet, Soak, Wetness};
use osier::rng::Rng;
use osier::scene::Mesh;

const LEAVES: usize = 5;
const FRAMES: u32 = 100;
const TAIL: u32 = 6;

fn flat() -> Mesh {
    let n = 8_u16;
    let mut mesh = Mesh::default();
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (f32::from(x) / f32::from(n), f32::from(y) / f32::from(n));
            mesh.points.push(Vec3::new((u - 0.5) * 0.04, v * 0.08, 0.0));
            mesh.normals.push(Vec3::Z);
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    let n = u32::from(n);
    for y in 0..n {
        for x in 0..n {
            let (a, b) = (y * (n + 1) + x, (y + 1) * (n + 1) + x);
            mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    mesh
}

struct Slider {
    uv: DVec2,
    volume: f64,
}

fn sliders(count: usize, leaf: usize, manner: &Manner) -> Vec<Slider> {
    let mut draw = Rng::at(11, &["bench".into(), leaf.into()]);
    let slider = |_| Slider {
        uv: DVec2::new(draw.range(0.05, 0.95), draw.range(0.0, 1.0)),
        volume: manner.wetting.volume_of_base(draw.range(1e-3, 2.5e-3)),
    };
    (0..count).map(slider).collect()
}

/// A frame's caps, and where they were since the last frame.
fn frame(drops: &[Slider], k: u32, manner: &Manner) -> (Vec<Blob>, Vec<Soak>) {
    let t = f64::from(k) / 24.0;
    let (mut blobs, mut soaks) = (Vec::new(), Vec::new());
    for d in drops {
        let y = (d.uv.y - 0.05 * t / 0.08).rem_euclid(1.0);
        let (mut volume, mut back) = (d.volume, 0.0);
        for i in 0..=TAIL {
            let cap = manner.wetting.cap(volume, 1.0);
            let uv = DVec2::new(d.uv.x, (y + back / 0.08).rem_euclid(1.0));
            let print = Print { q: if i == 0 { 1.17 } else { 1.0 }, skew: 0.0 };
            blobs.push(Blob { uv, cap, print, axis: DVec3::NEG_Y });
            soaks.push(Soak { uv, a: cap.a, t });
            volume *= 0.8_f64 * 0.8 * 0.8;
            back += 0.9 * manner.wetting.cap(volume, 1.0).a;
        }
    }
    (blobs, soaks)
}

fn main() {
    let manner = Manner::default();
    let sheet = Sheet::new(&flat()).expect("a blade");
    println!("| texels | drops | ms a frame | ns a texel done | all texels, ms | ratio |");
    println!("|---|---|---|---|---|---|");
    for side in [128, 256, 512] {
        let chart = Arc::new(Chart::new(&sheet, side));
        for count in [20, 200] {
            let drops: Vec<Vec<Slider>> = (0..LEAVES).map(|i| sliders(count / LEAVES, i, &manner)).collect();
            let fresh = || (0..LEAVES).map(|_| Wetness::new(Arc::clone(&chart), 1.0)).collect::<Vec<_>>();
            let run = |wet: &mut [Wetness], frames: std::ops::Range<u32>, all: bool| {
                let work: Vec<_> =
                    frames.map(|k| drops.iter().map(|d| frame(d, k, &manner)).collect::<Vec<_>>()).collect();
                let start = Instant::now();
                for (k, leaves) in (0_u32..).zip(&work) {
                    for (wet, (blobs, soaks)) in wet.iter_mut().zip(leaves) {
                        let t = f64::from(k) / 24.0;
                        if all {
                            wet.all_over(&sheet, (blobs, soaks), t, &manner);
                        } else {
                            wet.advance(&sheet, (blobs, soaks), t, &manner);
                        }
                    }
                }
                start.elapsed().as_secs_f64() * 1e3 / work.len() as f64
            };
            let some = 3;
            let (mut slow, mut same) = (fresh(), fresh());
            let baseline = run(&mut slow, 0..some, true);
            run(&mut same, 0..some, false);
            assert!(slow.iter().zip(&same).all(|(a, b)| a.maps() == b.maps()), "not the same maps");
            let mut wet = fresh();
            let quick = run(&mut wet, 0..FRAMES, false);
            let touched: u64 = wet.iter().map(|w| w.touched().iter().sum::<u64>()).sum();
            let ns = quick * 1e6 * f64::from(FRAMES) / touched as f64;
            println!("| {side} | {count} | {quick:.3} | {ns:.1} | {baseline:.1} | {:.0} |", baseline / quick);
        }
    }
}
