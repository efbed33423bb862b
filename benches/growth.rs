//! Trees that grow year by year: an oak of 60 years on one thread, and eight of them on all.
#![allow(missing_docs, clippy::expect_used, reason = "a bench is no library")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use osier::grow::years::{Site, TreeSpec, grow};
use osier::limits::Limits;
use osier::par::{on_threads, par_map};
use osier::recipe::{Growth, Request, resolve};

fn oak(seed: u64, age: f64) -> TreeSpec {
    let text = "[plants.oak]\nspecies = \"oak.species\"\n".to_owned();
    let (recipe, _) = resolve(&Request { text, ..Request::default() }).expect("scene");
    let Growth::Species(species) = &recipe.plants[0].growth else { unreachable!("a species") };
    TreeSpec {
        name: "oak".into(),
        habit: species.habit.habit.clone(),
        seed,
        id: 0,
        base: Vec3::ZERO,
        age,
        neighbours: None,
        prunes: Vec::new(),
    }
}

fn growth(c: &mut Criterion) {
    let (site, limits) = (Site::default(), Limits::default());
    let mut group = c.benchmark_group("growth");
    group.sample_size(10);
    // At most 1 s for an oak of 60 years.
    for age in [30.0, 60.0] {
        let spec = oak(1, age);
        let tree = grow(std::slice::from_ref(&spec), &site, &limits).expect("grows");
        group.throughput(Throughput::Elements(tree[0].measures().nodes as u64));
        group.bench_function(format!("oak-{age}-one-thread"), |b| {
            b.iter(|| on_threads(1, || grow(std::slice::from_ref(&spec), &site, &limits).expect("grows").len()));
        });
    }
    let eight: Vec<TreeSpec> = (1..=8).map(|seed| oak(seed, 60.0)).collect();
    group.throughput(Throughput::Elements(8));
    group.bench_function("eight-oaks", |b| {
        b.iter(|| par_map(&eight, |spec| grow(std::slice::from_ref(spec), &site, &limits).expect("grows").len()));
    });
    group.finish();
}

criterion_group!(benches, growth);
criterion_main!(benches);
