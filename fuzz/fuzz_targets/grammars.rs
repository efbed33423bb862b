//! Grammar files: any bytes are answered.
#![no_main]

use std::collections::BTreeMap;

use libfuzzer_sys::fuzz_target;
use osier::diagnostic::Sources;
use osier::grammar::{ConvertTo, GrammarSource, Notation, ReadAs, convert, detect, entries, parse_as};
use osier::limits::Limits;

fuzz_target!(|bytes: &[u8]| {
    let mut includes = |r: &str, _: &str| Err(osier::Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let defines = BTreeMap::new();
    let _ = (detect("a.l", bytes), entries("a.l", bytes));
    let notations = [None, Some(Notation::Fractint), Some(Notation::LParser), Some(Notation::LPy)];
    for notation in notations {
        let source = GrammarSource { name: "a.l", bytes, includes: &mut |a, b| includes(a, b), defines: &defines, functions: Default::default() };
        let read_as = ReadAs { notation, entry: None };
        if let Ok((grammar, _)) = parse_as(&mut Sources::default(), source, read_as, &Limits::default()) {
            let _ = convert(&grammar, ConvertTo::Cpfg);
        }
    }
});
