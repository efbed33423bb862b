//! Seconds per tree to grow and write 1, 10, 100 and 1,000 trees of one species, as [wang-hao] Fig. 14 asks.
//!
//! The trees share up to 16 individuals, which are written once and placed; `cargo bench --bench forest -- own` lets every
//! tree grow its own (up to 100).
#![allow(clippy::print_stdout, clippy::disallowed_methods, clippy::expect_used, reason = "a bench tells times")]

use std::sync::Arc;
use std::time::Instant;

use osier::bake::BakeContext;
use osier::bake::output::{exporters, frame_loop};
use osier::bake::scene::{SceneOptions, assemble_scene};
use osier::export::textures::Textures;
use osier::files::Folder;
use osier::limits::Limits;
use osier::presets::find;
use osier::progress::{Cancel, Silent};
use osier::recipe::{Request, resolve};

/// Individuals that the trees of a forest share.
const SHARED: u32 = 16;

/// Grows and writes `count` trees; returns seconds and bytes.
fn forest(count: u32, individuals: u32) -> (f64, u64) {
    let text = find("silk-tree.toml").expect("preset").text;
    let set = [
        format!("place.0.count={count}"),
        format!("place.0.individuals={individuals}"),
        format!("place.0.radius={}", 6.0 * f64::from(count).sqrt()),
        "place.0.spacing=6".into(),
        "output.formats=[\"usd\"]".into(),
    ];
    let start = Instant::now();
    let request = Request { name: "forest".into(), text: text.into(), set: set.into(), ..Request::default() };
    let recipe = resolve(&request).expect("scene").0;
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    let built = assemble_scene(&recipe, SceneOptions::default(), &work).expect("stage");
    let dir = tempfile::tempdir().expect("dir");
    let folder = Folder::open(dir.path()).expect("folder");
    let textures = Arc::new(Textures::encode(&built.animated.scene).expect("pictures"));
    textures.write(&built.animated.scene, &folder, "textures/").expect("pictures");
    let mut writers = exporters::bake_exporters(&folder, &textures, &recipe, &[]);
    frame_loop::write_frames(&built.animated, &mut writers, &[], &work).expect("files");
    folder.finish().expect("files");
    (start.elapsed().as_secs_f64(), folder.files().iter().map(|f| f.bytes).sum())
}

fn main() {
    let own = std::env::args().any(|a| a == "own");
    println!("{:>6} {:>12} {:>10} {:>12} {:>10}", "trees", "individuals", "s", "s per tree", "MB");
    for count in [1_u32, 10, 100, 1000] {
        let individuals = if own { count } else { count.min(SHARED) };
        if individuals > 100 {
            continue;
        }
        let (seconds, bytes) = forest(count, individuals);
        let each = seconds / f64::from(count);
        println!("{count:>6} {individuals:>12} {seconds:>10.2} {each:>12.4} {:>10.1}", bytes as f64 / 1e6);
    }
}
