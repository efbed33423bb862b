//! Grammar files: any bytes are answered.
#![no_main]

use std::collections::BTreeMap;

use libfuzzer_sys::fuzz_target;
use osier::diagnostic::Sources;
use osier::grammar::{GrammarSource, parse};
use osier::limits::Limits;

fuzz_target!(|bytes: &[u8]| {
    let mut includes = |r: &str, _: &str| Err(osier::Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let defines = BTreeMap::new();
    let source = GrammarSource { name: "a.l", bytes, includes: &mut includes, defines: &defines, functions: Default::default() };
    let _ = parse(&mut Sources::default(), source, &Limits::default());
});
