//! Maps of wet leaves: cost of a frame by resolution and number of drops, against doing every texel again.
//!
//! Five leaves of 80 x 40 mm; each drop a head of 1 to 2.5 mm and a tail of six that slide at 50 mm/s; height, normals and
//! wetness; one thread. `cargo bench --bench rain`, with `-- PLOT.svg` for a plot of cost against texels touched.

#![allow(clippy::print_stdout, clippy::expect_used, clippy::disallowed_methods, reason = "a bench measures and prints")]

use std::sync::Arc;
use std::time::Instant;

use glam::{DQuat, DVec2, DVec3, Vec2, Vec3};
use osier::bake::BakeContext;
use osier::bake::motion::evaluate_frame;
use osier::bake::scene::{self, AssembledScene};
use osier::geometry::Bounds;
use osier::limits::Limits;
use osier::motion::rain::{
    CapDeformation, CapOnLeaf, DropParams, DropSizes, IntensityEnvelope, LeafCollider, LeafOnPlant, LeafSurface,
    LeafWaterMaps, RainConfig, RainEmitter, RainFrame, RainLeaf, RainSimulation, RainSolids, RainfallParams,
    StillRainPlant, UvRaster, WetSpot,
};
use osier::progress::{Cancel, Silent};
use osier::recipe::{Request, resolve};
use osier::rng::Rng;
use osier::scene::Mesh;

const LEAVES: usize = 5;
const FRAMES: u32 = 100;
const TAIL: u32 = 6;
/// First frames, whose maps are compared, and then every how many frames all texels are done again.
const SAME: u32 = 3;
const WHOLE: u32 = 12;

fn flat(n: u16) -> Mesh {
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

fn sliders(count: usize, leaf: usize, manner: &DropParams) -> Vec<Slider> {
    let mut draw = Rng::at(11, &["bench".into(), leaf.into()]);
    let slider = |_| Slider {
        uv: DVec2::new(draw.range(0.05, 0.95), draw.range(0.0, 1.0)),
        volume: manner.wetting.volume_of_base(draw.range(1e-3, 2.5e-3)),
    };
    (0..count).map(slider).collect()
}

/// A frame's caps, and where they were since the last frame.
fn slid(drops: &[Slider], k: u32, manner: &DropParams) -> (Vec<CapOnLeaf>, Vec<WetSpot>) {
    let t = f64::from(k) / 24.0;
    let (mut blobs, mut soaks) = (Vec::new(), Vec::new());
    for d in drops {
        let y = (d.uv.y - 0.05 * t / 0.08).rem_euclid(1.0);
        let (mut volume, mut back) = (d.volume, 0.0);
        for i in 0..=TAIL {
            let cap = manner.wetting.cap(volume);
            let uv = DVec2::new(d.uv.x, (y + back / 0.08).rem_euclid(1.0));
            let footprint = CapDeformation { stretch: if i == 0 { 1.17 } else { 1.0 }, skew: 0.0 };
            blobs.push(CapOnLeaf { uv, cap, deformation: footprint, axis: DVec3::NEG_Y });
            soaks.push(WetSpot { uv, from: uv, a: cap.a, t });
            volume *= 0.8_f64 * 0.8 * 0.8;
            back += 0.9 * manner.wetting.cap(volume).a;
        }
    }
    (blobs, soaks)
}

/// What one cell of the table costs.
struct Cell {
    side: usize,
    count: usize,
    /// Of a frame, ms, with changed tiles and with all texels.
    quick: f64,
    whole: f64,
    /// Texels worked on in a frame, each as often as it was.
    touched: f64,
}

/// Time of a frame, ms.
fn timed(
    wet: &mut [LeafWaterMaps],
    (sheet, manner): (&LeafSurface, &DropParams),
    drops: &[Vec<Slider>],
    (k, all): (u32, bool),
) -> f64 {
    let work: Vec<_> = drops.iter().map(|d| slid(d, k, manner)).collect();
    let t = f64::from(k) / 24.0;
    let start = Instant::now();
    for (wet, (blobs, soaks)) in wet.iter_mut().zip(&work) {
        if all {
            wet.advance_full(sheet, blobs, soaks, t, manner);
        } else {
            wet.advance(sheet, blobs, soaks, t, manner);
        }
    }
    start.elapsed().as_secs_f64() * 1e3
}

/// The middle one: other programs of the machine hardly count.
fn middle(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Both ways in turn, so that both meet the same machine.
fn cell(side: usize, count: usize, with: (&LeafSurface, &DropParams)) -> Cell {
    let chart = Arc::new(UvRaster::new(with.0, side, None));
    let drops: Vec<Vec<Slider>> = (0..LEAVES).map(|i| sliders(count / LEAVES, i, with.1)).collect();
    let fresh = || (0..LEAVES).map(|_| LeafWaterMaps::new(Arc::clone(&chart), 1.0)).collect::<Vec<_>>();
    let (mut slow, mut wet) = (fresh(), fresh());
    let (mut whole, mut quick) = (Vec::new(), Vec::new());
    for k in 0..FRAMES {
        quick.push(timed(&mut wet, with, &drops, (k, false)));
        if k < SAME || k % WHOLE == 0 {
            whole.push(timed(&mut slow, with, &drops, (k, true)));
        }
        let same = k >= SAME || slow.iter().zip(&wet).all(|(a, b)| a.maps() == b.maps());
        assert!(same, "not the same maps");
    }
    let touched = wet.iter().map(|w| w.texel_counters().total_updates()).sum::<u64>() as f64 / f64::from(FRAMES);
    Cell { side, count, quick: middle(&mut quick), whole: middle(&mut whole), touched }
}

fn main() {
    let manner = DropParams::default();
    let sheet = LeafSurface::new(&flat(8)).expect("a blade");
    println!("| texels | drops | ms a frame | for the drops alone | ns a texel touched | all texels, ms | ratio |");
    println!("|---|---|---|---|---|---|---|");
    let (mut cells, mut ns) = (Vec::new(), Vec::new());
    for count in [20, 200] {
        // Maps of next to no texels cost what drops cost by themselves.
        let alone = cell(8, count, (&sheet, &manner)).quick;
        for side in [128, 256, 512] {
            let c = cell(side, count, (&sheet, &manner));
            let each = (c.quick - alone) * 1e6 / c.touched;
            let Cell { quick, whole, .. } = c;
            println!("| {side} | {count} | {quick:.2} | {alone:.2} | {each:.1} | {whole:.0} | {:.0} |", whole / quick);
            ns.push(each);
            cells.push(c);
        }
    }
    let mean = ns.iter().sum::<f64>() / ns.len() as f64;
    let off = ns.iter().fold(0.0_f64, |m, x| m.max((x / mean - 1.0).abs()));
    println!("\n{mean:.1} ns a texel touched, within {:.0} %", off * 100.0);
    whole_frames(&manner);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    one.install(table_one);
    let path = std::env::args().skip(1).find(|a| std::path::Path::new(a).extension().is_some_and(|e| e == "svg"));
    if let Some(path) = path {
        std::fs::write(&path, plot(&cells)).expect("a plot");
    }
}

/// A preset scene with other keys, and the seconds that it takes to build: to grow it and to let it rain through its clip.
fn staged(name: &str, set: &[String]) -> (AssembledScene, f64) {
    let text = osier::presets::find(name).expect("a preset").text.to_owned();
    let request = Request { name: "rain".into(), text, set: set.to_vec(), ..Request::default() };
    let (recipe, _) = resolve(&request).expect("a recipe");
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    let start = Instant::now();
    let built = scene::assemble_scene(&recipe, scene::SceneOptions::default(), &work).expect("a scene");
    (built, start.elapsed().as_secs_f64())
}

/// Scenes of as many leaves and triangles as those of table 1 of the paper by Yang and Wu, with rods that move: steps of rain
/// and rods, and what a frame shows (maps, meshes of drops, plants), on one thread.
fn table_one() {
    const CLIP: u32 = 120;
    println!(
        "\n| scene | mm/h | drops in the air | on leaves | texels | steps, ms | maps and meshes, ms | frames a second |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (scene, rate) in [(1, 10), (1, 100), (2, 10), (2, 100), (3, 10), (3, 100)] {
        let name = format!("rain-table-{scene}.toml");
        let keys = |end: u32, side: u32| {
            let fixed = ["frames.fps=24", "rain.size_distribution=\"natural\""].map(String::from);
            let more = [("frames.end", end), ("maps.resolution", side), ("rain.rate_mm_per_h", rate)];
            fixed.into_iter().chain(more.map(|(key, value)| format!("{key}={value}"))).collect::<Vec<_>>()
        };
        let steps = (staged(&name, &keys(1 + CLIP, 128)).1 - staged(&name, &keys(2, 128)).1) / f64::from(CLIP - 1);
        for side in [128, 256, 512] {
            let (built, _) = staged(&name, &keys(CLIP, side));
            let (mut times, mut drops) = (Vec::new(), [0.0; 2]);
            for number in 1..=CLIP {
                let start = Instant::now();
                let frame =
                    evaluate_frame(&built.animated.scene, &built.animated.motions, number, false).expect("a frame");
                times.push(start.elapsed().as_secs_f64());
                let row = &frame.rows[0];
                drops = [drops[0] + row[0], drops[1] + row[1] + row[2] + row[3]];
            }
            times.sort_by(f64::total_cmp);
            let shown = times[times.len() / 2];
            let [air, leaves] = drops.map(|n| n / f64::from(CLIP));
            println!(
                "| {scene} | {rate} | {air:.0} | {leaves:.0} | {side} | {:.1} | {:.1} | {:.0} |",
                steps * 1e3,
                shown * 1e3,
                1.0 / (steps + shown)
            );
        }
    }
}

/// The whole of it: five leaves of 900 triangles, 200 drops on them that lie, run, merge and hang, rain, maps of 512 x 512.
fn whole_frames(manner: &DropParams) {
    let sheet = Arc::new(LeafSurface::new(&flat(21)).expect("a blade"));
    let chart = Arc::new(UvRaster::new(&sheet, 512, None));
    let target = Arc::new(LeafCollider::new(&sheet));
    let mut draw = Rng::at(5, &["frames".into()]);
    let poses: Vec<(DVec3, DQuat)> = (0..LEAVES)
        .map(|i| {
            (
                DVec3::new(0.06 * i as f64, 1.0, 0.0),
                DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2 - draw.range(0.3, 1.0)),
            )
        })
        .collect();
    let leaves = (0..LEAVES as u64).map(|i| {
        let hung = LeafOnPlant { plant: 0, leaf: usize::try_from(i).unwrap_or(0), collider: Arc::clone(&target) };
        (RainLeaf::new(Arc::clone(&sheet), 1.0, i), hung)
    });
    let rain = RainfallParams {
        seed: 5,
        intensity: 40.0 / 3.6e6,
        size: DropSizes::MarshallPalmer,
        total: None,
        envelope: IntensityEnvelope::Constant,
        jitter: 0.2,
        duration: 10.0,
        spin_up: 0.0,
        g: 9.81,
    };
    let over = Bounds { min: Vec3::new(-0.05, 0.9, -0.1), max: Vec3::new(0.35, 1.1, 0.1) };
    let parts = RainConfig {
        params: manner.clone(),
        emitter: Some(RainEmitter::new(rain, over, None)),
        plants: vec![Box::new(StillRainPlant::new(&poses, Vec::new()))],
        leaves: leaves.collect(),
        wind: None,
        ground: Arc::new(0.8),
        solids: RainSolids::default(),
    };
    let mut storm = RainSimulation::new(parts);
    let mut wet: Vec<LeafWaterMaps> = (0..LEAVES).map(|_| LeafWaterMaps::new(Arc::clone(&chart), 1.0)).collect();
    let (mut steps, mut maps, mut drops) = (Vec::new(), Vec::new(), 0);
    for _ in 0..FRAMES {
        // What has run off comes again.
        let lying = storm.leaves().iter().map(|l| l.drops.len()).sum::<usize>();
        for k in lying..200 {
            let volume = manner.wetting.volume_of_base(draw.range(7e-4, 2e-3));
            storm.deposit_drop(
                k % LEAVES,
                DVec2::new(draw.range(0.05, 0.95), draw.range(0.05, 0.95)),
                DVec3::ZERO,
                volume,
            );
        }
        let start = Instant::now();
        (0..8).for_each(|_| storm.step(1.0 / (24.0 * 8.0)).expect("a step"));
        let moment = RainFrame::capture(&mut storm);
        steps.push(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        for (i, wet) in wet.iter_mut().enumerate() {
            let water = moment.leaf_map_input(i);
            wet.advance(&sheet, &water.caps, &water.wet_spots, moment.t, manner);
        }
        maps.push(start.elapsed().as_secs_f64() * 1e3);
        drops += storm.leaves().iter().map(|l| l.drops.len()).sum::<usize>();
    }
    let middle = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    println!(
        "\nwhole frames: {} drops, {:.1} ms of steps, {:.1} ms of maps",
        drops / FRAMES as usize,
        middle(&mut steps),
        middle(&mut maps)
    );
}

/// Cost of a frame against texels touched, both in powers of ten.
fn plot(cells: &[Cell]) -> String {
    use std::fmt::Write as _;
    let x = |texels: f64| 70.0 + (texels.log10() - 4.0) * 170.0;
    let y = |ms: f64| 280.0 - (ms.log10() + 1.0) * 57.0;
    let mut out = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 640 330\" font-family=\"sans-serif\" font-size=\"12\" fill=\"#222\">\n<rect width=\"640\" height=\"330\" fill=\"white\"/>\n",
    );
    for k in 4..=7 {
        let x = x(10.0_f64.powi(k));
        let _ = writeln!(
            out,
            "<path d=\"M{x:.0} 10V290\" stroke=\"#ddd\"/><text x=\"{x:.0}\" y=\"306\" text-anchor=\"middle\">10^{k}</text>"
        );
    }
    for k in -1..=3 {
        let ms = 10.0_f64.powi(k);
        let y = y(ms);
        let _ = writeln!(
            out,
            "<path d=\"M70 {y:.0}H580\" stroke=\"#ddd\"/><text x=\"62\" y=\"{:.0}\" text-anchor=\"end\">{ms}</text>",
            y + 4.0
        );
    }
    out.push_str("<text x=\"325\" y=\"324\" text-anchor=\"middle\">texels touched in a frame</text><text x=\"76\" y=\"20\">ms a frame: blue what changed, red all texels</text>\n");
    for c in cells {
        for (ms, color) in [(c.quick, "#1f6fb4"), (c.whole, "#c0392b")] {
            let (x, y) = (x(c.touched), y(ms));
            let _ = writeln!(
                out,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\"/><text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\">{} / {}</text>",
                x + 6.0,
                y + 10.0,
                c.side,
                c.count
            );
        }
    }
    out.push_str("</svg>\n");
    out
}
