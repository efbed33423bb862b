//! Scene files: any text is answered. Overrides follow the text, one in each line after a NUL.
#![no_main]

use libfuzzer_sys::fuzz_target;
use osier::recipe::{Request, resolve};

fuzz_target!(|bytes: &[u8]| {
    let all = String::from_utf8_lossy(bytes);
    let (text, overrides) = all.split_once('\0').unwrap_or((&all, ""));
    let set = overrides.lines().map(str::to_owned).collect();
    let _ = resolve(&Request { name: "a".into(), shown: "a.toml".into(), text: text.into(), set, ..Request::default() });
});
