//! Maps: a set of pictures of bark, leaf and ground, drawn and encoded, on one thread.
//!
//! `cargo bench --bench maps`
#![allow(missing_docs, clippy::expect_used, reason = "a bench is no library")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use osier::export::textures::Textures;
use osier::scene::Scene;
use osier::surface::SurfaceMaterial;
use osier::surface::bark::{BarkSpec, bark};
use osier::surface::ground::{GroundColors, ground_material};
use osier::surface::leaf::{BladeSpec, LeafColors, leaf_material};

#[path = "../tests/it/common/bare.rs"]
mod bare;

type Draw = Box<dyn Fn() -> SurfaceMaterial + Send + Sync>;

fn maps(c: &mut Criterion) {
    let barks = [
        ("furrowed", BarkSpec::furrowed()),
        ("birch", BarkSpec::birch()),
        ("poplar", BarkSpec::poplar()),
        ("shoot", BarkSpec::shoot()),
    ];
    let mut sets: Vec<(String, Draw)> = Vec::new();
    for (name, spec) in barks {
        sets.push((format!("bark {name} 1024"), Box::new(move || bark(&spec, None, "bark").expect("bark"))));
    }
    let leaf = || leaf_material(&BladeSpec::oak(), &LeafColors::OAK, "leaf", 512, false).expect("leaf");
    sets.push(("leaf 512".into(), Box::new(leaf)));
    let ground = || ground_material(&GroundColors::default(), "ground", 1024, 2.0, 1).expect("ground");
    sets.push(("ground 1024".into(), Box::new(ground)));
    let mut group = c.benchmark_group("maps");
    group.sample_size(10);
    for (name, draw) in &sets {
        group.bench_function(format!("{name} drawn"), |b| b.iter(|| alone(|| black_box(draw().images.len()))));
        let scene = Scene { images: draw().images, ..bare::scene(bare::asset(), 1) };
        let encode = || black_box(Textures::encode(&scene).expect("encodes").iter().count());
        group.bench_function(format!("{name} encoded"), |b| b.iter(|| alone(encode)));
    }
    group.finish();
}

/// Runs something on one thread.
#[cfg(feature = "parallel")]
fn alone<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("pool").install(f)
}

#[cfg(not(feature = "parallel"))]
fn alone<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    f()
}

criterion_group!(benches, maps);
criterion_main!(benches);
