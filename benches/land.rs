//! Land: raising 2049^2 heights.
//!
//! `cargo bench --bench land`
#![allow(missing_docs, clippy::expect_used, reason = "a bench is no library")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use osier::limits::Limits;
use osier::surface::terrain::scatter::{Sowing, address, scatter};
use osier::surface::terrain::{Land, Relief};

fn land(c: &mut Criterion) {
    let mut group = c.benchmark_group("land");
    group.sample_size(10);
    let relief = Relief { n: 11, ..Relief::default() };
    group.bench_function("raise 2049^2", |b| b.iter(|| black_box(Land::raise(&relief).expect("land").heights.len())));
    let land = Land::raise(&Relief { n: 9, size: 500.0, ..Relief::default() }).expect("land");
    let sowing = Sowing::default();
    // Cells of edge 0.707 m, each with a candidate in every round it is free in: at most 2 M.
    group.bench_function("scatter 500 m by 1 m", |b| {
        b.iter(|| black_box(scatter(&land, &sowing, &[], address(1, 0), &Limits::default()).expect("spots").len()));
    });
    group.finish();
}

criterion_group!(benches, land);
criterion_main!(benches);
