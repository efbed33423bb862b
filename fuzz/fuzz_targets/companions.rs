//! Companion files of grammars: any bytes are answered.
#![no_main]

use libfuzzer_sys::fuzz_target;
use osier::diagnostic::Sources;
use osier::grammar::companion::{ColorTable, read_contours, read_functions, read_ray, read_surface, read_view};

fuzz_target!(|bytes: &[u8]| {
    let mut sources = Sources::default();
    let _ = (ColorTable::from_map(bytes), ColorTable::from_mat(bytes));
    let _ = read_view("a.v", bytes, &mut sources, &mut |_: &str| Err("nothing is included".into()));
    let text = String::from_utf8_lossy(bytes);
    let source = sources.add("a", text.as_ref());
    let (_, _) = (read_contours(&text, source), read_functions(&text, source));
    let (_, _) = (read_surface(&text, source), read_ray(&text, source));
});
