//! Height maps: any bytes are answered. The first byte chooses the ending.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use osier::files::SearchPaths;
use osier::import::{ImportOptions, UpAxis, read_heights};
use osier::limits::Limits;
use osier::scene::MaterialClass;

fuzz_target!(|bytes: &[u8]| {
    let Some((form, map)) = bytes.split_first() else { return };
    let name = ["a.png", "a.exr"][usize::from(*form) % 2];
    let (roots, mut limits) = (SearchPaths::none(), Limits::default());
    limits.set("image-bytes", "16M").expect("a limit");
    let options = ImportOptions { roots: &roots, limits: &limits, up: UpAxis::Y, scale: 1.0, class: MaterialClass::Ground };
    if let Ok(map) = read_heights(Path::new(name), map, &options) {
        assert!(map.values.len() == map.width * map.height && map.values.iter().all(|v| v.is_finite()));
    }
});
