//! Meshes of other programs: any bytes are answered. The first byte chooses the form.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use osier::files::SearchPaths;
use osier::import::{ImportOptions, UpAxis, read};
use osier::limits::Limits;
use osier::scene::MaterialClass;

fuzz_target!(|bytes: &[u8]| {
    let Some((form, text)) = bytes.split_first() else { return };
    let name = ["a.obj", "a.gltf", "a.glb"][usize::from(*form) % 3];
    let (roots, limits) = (SearchPaths::none(), Limits::default());
    let options = ImportOptions { roots: &roots, limits: &limits, up: UpAxis::Y, scale: 1.0, class: MaterialClass::Leaf };
    let _ = read(Path::new(name), text, &options);
});
