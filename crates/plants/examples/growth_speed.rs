//! Time of a processor for growth per internode and year at several ages, and time of eight trees on all threads:
//! `cargo run --release -p osier-plants --example growth_speed [NAME]`. With `--sums` it prints a checksum of a tree of each
//! species instead, to compare before and after a change that must not alter trees.
#![allow(clippy::expect_used, clippy::disallowed_methods, clippy::print_stdout, reason = "a tool for people")]

mod common;

use std::time::Instant;

use common::{Checksum, on_processor};
use osier_base::limits::Limits;
use osier_base::par::{on_threads, par_map};
use osier_plants::grow::years::{Site, TreeSpec, grow, grow_through};

/// Runs of which the fastest counts: other programs only add time.
const RUNS: usize = 5;

/// Age of the trees whose checksums are printed, years.
const AGE_OF_SUMS: f64 = 30.0;

fn fastest(time: impl FnMut(usize) -> f64) -> f64 {
    (0..RUNS).map(time).fold(f64::INFINITY, f64::min)
}

fn main() {
    let name = std::env::args().nth(1).unwrap_or_else(|| "oak".into());
    let (site, limits) = (Site::default(), Limits::default());
    if name == "--sums" {
        for name in common::names() {
            let spec = TreeSpec { age: AGE_OF_SUMS, ..common::spec(&name, 2) };
            let mut sum = Checksum::new();
            sum.add(&grow(&[spec], &site, &limits).expect("grows"));
            println!("{:016x} {name}", sum.0);
        }
        return;
    }
    let spec = common::spec(&name, 1);
    let all: Vec<u32> = (1..=90).collect();
    let row = grow_through(&spec, &all, &site, &limits).expect("grows");
    let nodes: Vec<f64> = row.iter().map(|t| t.measures().nodes as f64).collect();
    drop(row);
    for age in [30_usize, 60, 90] {
        let spec = TreeSpec { age: age as f64, ..spec.clone() };
        let run = || drop(grow(std::slice::from_ref(&spec), &site, &limits).expect("grows"));
        let seconds = fastest(|_| on_threads(1, || on_processor(run)).as_secs_f64());
        let node_years: f64 = nodes[..age].iter().sum();
        println!("{name} {age}: {seconds:.3} s, {:.1} ns per internode and year", seconds * 1e9 / node_years);
    }
    let eight: Vec<TreeSpec> = (1..=8).map(|seed| common::spec(&name, seed)).collect();
    let seconds = fastest(|_| {
        let start = Instant::now();
        par_map(&eight, |spec| grow(std::slice::from_ref(spec), &site, &limits).expect("grows"));
        start.elapsed().as_secs_f64()
    });
    println!("eight individuals: {seconds:.2} s");
}
