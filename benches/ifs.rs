//! Drawing attractors: points per second of one thread, alone and into histograms.
//!
//! `cargo bench --bench ifs` measures us; `benches/peers/flames.sh` runs flam3 and us in turn on the same fern.
#![allow(missing_docs, clippy::expect_used, clippy::cast_precision_loss, reason = "a bench is no library")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use osier::ifs::affine::AxisScaling;
use osier::ifs::cloud::{DrawRequest, cloud};
use osier::ifs::color::{ColorLabels, ColorMode};
use osier::ifs::dynamics::study;
use osier::ifs::game::{ChaosGame, Chunk, InstructionSet, PointSink, extent};
use osier::ifs::histogram::{PictureWindow, histogram};
use osier::ifs::leaf::{LeafColors, LeafSpec, fields, leaf, normals};
use osier::ifs::weights::WeightRule;
use osier::ifs::{Ifs, read};
use osier::limits::Limits;

fn table(name: &str) -> Ifs {
    let preset = osier::presets::find(name).expect("shipped");
    read::read(name, preset.text.as_bytes(), &Limits::default()).expect("reads").0.remove(0)
}

/// Takes points and keeps nothing but their sum.
#[derive(Default)]
struct Blind(f32);

impl PointSink for Blind {
    fn take(&mut self, chunk: &Chunk) {
        self.0 += chunk.x[0][0];
    }
}

fn one_thread<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("pool").install(f)
}

fn drawing(c: &mut Criterion) {
    let fern = table("fern_leaf.ifs");
    let s = study(&fern, WeightRule::File);
    let mut group = c.benchmark_group("fern");
    group.sample_size(10);
    let points = 1 << 24;
    group.throughput(Throughput::Elements(points));
    for (name, tier) in [("generate", InstructionSet::Best), ("generate_plain", InstructionSet::Plain)] {
        let game = ChaosGame::new(&fern, &s, 1, AxisScaling::IDENTITY, 1e15).with_tier(tier);
        let (blocks, steps) = ChaosGame::plan(points);
        group.bench_function(name, |b| {
            b.iter(|| {
                let mut sink = Blind::default();
                let found: u64 = (0..blocks).map(|block| game.play(block, steps, &mut sink).found).sum();
                (sink.0, found)
            });
        });
    }
    let wide = extent(&fern, &s).expect("one").bounds;
    let window = PictureWindow::fitted(wide.0, wide.1, 2048, 2048);
    let request = DrawRequest { system: &fern, study: &s, seed: 1, points: 100_000_000, tier: InstructionSet::Best };
    group.throughput(Throughput::Elements(request.points));
    group.bench_function("hits_2048", |b| {
        b.iter(|| one_thread(|| histogram(&request, None, &window).points));
    });
    let labels = ColorLabels::new(&fern, ColorMode::Coord, &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    group.bench_function("colour_2048", |b| {
        b.iter(|| one_thread(|| histogram(&request, Some(&labels), &window).points));
    });
    group.finish();
}

fn clouds(c: &mut Criterion) {
    let fern = table("fern_leaf.ifs");
    let s = study(&fern, WeightRule::File);
    let e = extent(&fern, &s).expect("one");
    let labels = ColorLabels::new(&fern, ColorMode::Map, &[]);
    let request = DrawRequest { system: &fern, study: &s, seed: 1, points: 10_000_000, tier: InstructionSet::Best };
    let mut group = c.benchmark_group("cloud");
    group.sample_size(10);
    group.throughput(Throughput::Elements(request.points));
    group.bench_function("ten_million", |b| {
        b.iter(|| cloud(&request, &labels, &e, DVec3::ZERO, 1.0).positions.len());
    });
    group.finish();
}

fn leaves(c: &mut Criterion) {
    let table = table("bamboo_leaf.ifs");
    let mut group = c.benchmark_group("leaf");
    group.sample_size(10);
    group.bench_function("maps_1024", |b| {
        b.iter(|| {
            one_thread(|| {
                let made = leaf(&table, &LeafSpec::default()).expect("a leaf");
                let f = fields(&made.raster, &LeafColors::default(), 1.0);
                normals(&f.height, &made.raster.mask.set, 1024).len()
            })
        });
    });
    group.finish();
}

criterion_group!(benches, drawing, clouds, leaves);
criterion_main!(benches);
