//! Points of skin per second: 10,000 axes of 16 rings and 8 sides, each side branch with its foot; positions, normals,
//! texture coordinates, triangles and bindings to the skeleton.
#![allow(missing_docs, reason = "criterion's macros write undocumented functions")]
#![allow(clippy::cast_possible_truncation, reason = "small numbers")]

use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{Quat, Vec3};
use osier::math;
use osier::plant::{Axis, AxisEnd, AxisKind, NONE, Plant};
use osier::surface::{PlantSkin, SkinOptions, skin, skin_into};

const NODES: u32 = 16;

/// 100 trunks with 99 branches each, all winding enough to keep every ring.
fn forest() -> Plant {
    let mut plant = Plant { seed: 1, ..Plant::default() };
    for i in 0..10_000_u32 {
        let trunk = i % 100 == 0;
        let parent = if trunk { NONE } else { i - i % 100 };
        let (k, scale) = (i % 100, if trunk { 1.0 } else { 0.3 });
        let parent_s = if trunk { 0.0 } else { k as f32 * 0.08 };
        let site = plant.axes.get(parent as usize).map(|a| plant.frame(a, parent_s));
        let start = site.map_or(Vec3::new((i / 100) as f32 * 9.0, 0.0, 0.0), |s| s.p);
        let turn = Quat::from_rotation_y(k as f32 * 2.4) * Quat::from_rotation_z(if trunk { 0.0 } else { 1.0 });
        push(&mut plant, (parent, parent_s), (start, turn), scale);
    }
    plant
}

fn push(plant: &mut Plant, (parent, parent_s): (u32, f32), (start, turn): (Vec3, Quat), scale: f32) {
    let first = plant.nodes.p.len() as u32;
    let mut s = 0.0;
    for j in 0..NODES {
        let a = j as f32 * 0.45;
        let wind = Vec3::new(0.35 * (1.0 - math::cos_f32(a)), j as f32 * 0.55, 0.35 * math::sin_f32(a)) * scale;
        let p = start + turn * wind;
        s += if j > 0 { p.distance(plant.nodes.p[plant.nodes.p.len() - 1]) } else { 0.0 };
        plant.nodes.p.push(p);
        plant.nodes.q.push(turn);
        plant.nodes.r.push(0.15 * scale * (1.0 - 0.05 * j as f32));
        plant.nodes.s.push(s);
        plant.nodes.birth.push(0.0);
        plant.nodes.color.push(0);
    }
    plant.axes.push(Axis {
        id: u64::from(first),
        parent,
        parent_s,
        order: u8::from(parent != NONE),
        kind: AxisKind::Stem,
        first,
        count: NODES,
        length: s,
        s_exposed: 0.0,
        material: 0,
        fork: NONE,
        end: AxisEnd::Tip,
        birth: 0.0,
    });
}

/// Time that `n` calls of `f` kept this thread on a processor, so that others on the machine do not count; where the
/// system does not say, time on the clock.
#[allow(clippy::disallowed_methods, reason = "a bench reads the clock, and the system tells processor time in a file")]
fn on_processor(n: u64, mut f: impl FnMut() -> bool) -> Duration {
    let spent = || {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        text.split(' ').next()?.parse().ok().map(Duration::from_nanos)
    };
    let clock = Instant::now();
    let before = spent();
    for _ in 0..n {
        std::hint::black_box(f());
    }
    before.and_then(|b| spent()?.checked_sub(b)).unwrap_or_else(|| clock.elapsed())
}

fn loft(c: &mut Criterion) {
    let plant = forest();
    let options = SkinOptions { sides: (8, 8), turn: 0.1, ..SkinOptions::default() };
    let points = skin(&plant, &options).map_or(0, |s| s.mesh.points.len() as u64);
    let mut group = c.benchmark_group("surface");
    group.throughput(Throughput::Elements(points)).sample_size(20);
    for threads in [1, 2] {
        let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else { continue };
        let mut kept = PlantSkin::default();
        group.bench_function(format!("loft, points into used memory, threads: {threads}"), |b| {
            b.iter(|| pool.install(|| skin_into(&plant, &options, &mut kept)));
        });
        if threads == 1 {
            group.bench_function("loft, points into used memory, processor time of one thread", |b| {
                b.iter_custom(|n| pool.install(|| on_processor(n, || skin_into(&plant, &options, &mut kept).is_ok())));
            });
        }
        group.bench_function(format!("loft, points into fresh memory, threads: {threads}"), |b| {
            b.iter(|| pool.install(|| skin(&plant, &options)));
        });
    }
    group.finish();
}

criterion_group!(benches, loft);
criterion_main!(benches);
