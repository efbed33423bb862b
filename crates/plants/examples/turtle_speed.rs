//! Times the turtle on one thread: `cargo run --release -p osier-plants --example turtle_speed`.
//! With files of grammars: `cargo run ... turtle_speed -- FILE...` prints a checksum of what each of them draws under several
//! options, to compare before and after a change that must not alter plants.
#![allow(
    clippy::expect_used,
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "an example that measures time"
)]

mod common;

use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use common::{Checksum, on_processor};
use glam::{DVec3, Vec3};
use osier_base::{Error, Result, diagnostic::Sources, limits::Limits};
use osier_grammar::{DeriveOptions, Grammar, GrammarSource, derive_deferred, parse};
use osier_plants::grow::radii::{Pipe, Taper};
use osier_plants::grow::turtle::{OrganSpec, RadiusModel, Tropism, TurtleOptions, derive, draw, grow};
use osier_scene::Mesh;

fn read(name: &str, bytes: &[u8], limits: &Limits) -> Result<Grammar> {
    let defines = BTreeMap::new();
    let mut none = |r: &str, _: &str| Err(Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let source = GrammarSource { name, bytes, includes: &mut none, defines: &defines, functions: Arc::default() };
    Ok(parse(&mut Sources::default(), source, limits)?.0)
}

/// Options that lead through different parts of the turtle.
fn variants() -> Vec<TurtleOptions> {
    let points = vec![Vec3::ZERO, Vec3::new(0.2, 0.5, 0.0), Vec3::new(-0.2, 0.5, 0.0)];
    let mesh = Mesh { points, normals: vec![Vec3::Z; 3], triangles: vec![[0, 1, 2]], ..Default::default() };
    let mesh = Arc::new(mesh.with_material(0));
    let meshes = vec![Arc::clone(&mesh), mesh];
    let organ = |c: char| (c, OrganSpec { name: format!("o{c}"), meshes: meshes.clone(), size: 0.1, petiole: 0.02 });
    let plain = TurtleOptions { organs: ('a'..='z').map(organ).collect(), ..TurtleOptions::default() };
    let with = |radii| TurtleOptions { radii, ..plain.clone() };
    let tropism = Tropism { dir: DVec3::NEG_Y, elasticity: 0.1, ..Tropism::default() };
    let torque = Tropism { dir: DVec3::X, elasticity: 0.05, torque: true, ..Tropism::default() };
    vec![
        plain.clone(),
        with(RadiusModel::Pixels),
        with(RadiusModel::Widths),
        with(RadiusModel::Pipe(Pipe { base: Some(0.3), ..Pipe::default() })),
        with(RadiusModel::Taper(Taper::default())),
        TurtleOptions { tropisms: vec![tropism, torque], unit_m: 0.01, ..plain.clone() },
        TurtleOptions { tapered: false, past_cut: false, painted: true, radii: RadiusModel::Widths, ..plain },
    ]
}

fn checksum(path: &str, limits: &Limits) -> u64 {
    let mut sum = Checksum::new();
    match read(path, &std::fs::read(path).expect("a file"), limits) {
        Err(e) => sum.add(&e.to_string()),
        Ok(grammar) => {
            for options in variants() {
                let seed = DeriveOptions { seed: 5, plant_id: 2, ..DeriveOptions::default() };
                let derived = derive(&grammar, &seed, &options, limits);
                sum.add(&derived.and_then(|derived| draw(&grammar, &derived, &options, limits)));
            }
        }
    }
    sum.0
}

fn main() {
    let text = "Lsystem: 1\nderivation length: 8\nAxiom: F(1)\n\
        F(x) --> F(x/3)[+(30)F(x/3)]F(x/3)[-(30)F(x/3)]F(x/3)\nendlsystem\n";
    let limits = Limits::default();
    let files: Vec<String> = std::env::args().skip(1).collect();
    for path in &files {
        println!("{:016x} {path}", checksum(path, &limits));
    }
    if !files.is_empty() {
        return;
    }
    let grammar = read("speed.l", text.as_bytes(), &limits).expect("reads");
    osier_base::par::on_threads(1, || {
        let derived = derive_deferred(&grammar, &DeriveOptions::default(), &limits).expect("derives");
        let mut best = Duration::MAX;
        for _ in 0..9 {
            best = best.min(on_processor(|| {
                black_box(grow(&grammar, &derived, &TurtleOptions::default(), &limits).expect("draws"));
            }));
        }
        let (n, best) = (derived.module_count(), best.as_secs_f64());
        println!("{:.1} M modules/s  ({n} modules, {:.1} ms)", n as f64 / best / 1e6, best * 1e3);
    });
}
