//! Coefficient tables of all forms: any bytes are answered, and what is read is drawn or refused.
#![no_main]

use libfuzzer_sys::fuzz_target;
use osier::ifs::dynamics::study;
use osier::ifs::read::read;
use osier::ifs::weights::WeightRule;
use osier::limits::Limits;

fuzz_target!(|bytes: &[u8]| {
    let Some((form, text)) = bytes.split_first() else { return };
    let name = ["a.ifs", "a.flame", "a.ifs.toml"][usize::from(*form) % 3];
    if let Ok((systems, _)) = read(name, text, &Limits::default()) {
        for system in systems.iter().take(4).filter(|s| s.maps.len() <= 64) {
            let _ = study(system, system.weights.unwrap_or(WeightRule::File));
        }
    }
});
