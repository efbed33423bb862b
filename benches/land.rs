//! Land: raising 2049^2 heights.
//!
//! `cargo bench --bench land`
#![allow(missing_docs, clippy::expect_used, reason = "a bench is no library")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use osier::limits::Limits;
use osier::surface::terrain::scatter::{ScatterParams, scatter, scatter_key};
use osier::surface::terrain::{Terrain, TerrainParams};

fn land(c: &mut Criterion) {
    let mut group = c.benchmark_group("land");
    group.sample_size(10);
    let relief = TerrainParams { n: 11, ..TerrainParams::default() };
    group.bench_function("raise 2049^2", |b| {
        b.iter(|| black_box(Terrain::generate(&relief).expect("land").heights.len()))
    });
    let land = Terrain::generate(&TerrainParams { n: 9, size: 500.0, ..TerrainParams::default() }).expect("land");
    let sowing = ScatterParams::default();
    // Cells of edge 0.707 m, each with a candidate in every round it is free in: at most 2 M.
    group.bench_function("scatter 500 m by 1 m", |b| {
        b.iter(|| black_box(scatter(&land, &sowing, &[], scatter_key(1, 0), &Limits::default()).expect("spots").len()));
    });
    group.finish();
}

criterion_group!(benches, land);
criterion_main!(benches);
