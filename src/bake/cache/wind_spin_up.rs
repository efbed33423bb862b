//! The lattice wind after its spin-up, stored so that a stopped bake, or the next one with the same wind, need not spin up again.
//!
//! `wind/air_KEY.state` holds a line with version and description, the hash of the rest, and the state of the lattice; KEY
//! hashes the options, seed and solid cells. A file that differs in any byte is not used: the bake spins up again and prints a
//! note.

use crate::bake::BakeContext;
use osier_base::Result;
use osier_base::files::{Folder, read_below};
use osier_base::limits::Limits;
use osier_export::GENERATOR;
use osier_scene::solid::Solid;
use osier_wind::{LatticeOptions, LatticeSolver};

/// Without a cache, a lattice before its spin-up; with one, the lattice after it, loaded from the cache or simulated and stored there.
/// # Errors
/// Those of [`LatticeSolver::new`] and [`LatticeSolver::spin_up`]; what cannot be written.
pub fn load_or_spin_up(options: &LatticeOptions, solids: &[Solid], context: &BakeContext<'_>) -> Result<LatticeSolver> {
    let mut lattice = LatticeSolver::new(options, solids, context.limits)?;
    let Some(cache) = context.cache else { return Ok(lattice) };
    let folder = cache.folder();
    let path = format!("wind/air_{:016x}.state", lattice.fingerprint());
    match load(&mut lattice, folder, &path, context.limits) {
        Ok(true) => {}
        Ok(false) => lattice.spin_up(context.progress, context.cancel)?,
        Err(why) => {
            cache.add_message(format!("\"{path}\" {why}: the wind spins up again"));
            lattice.spin_up(context.progress, context.cancel)?;
        }
    }
    folder.write(&path, "state.wind", &file_bytes(&lattice.save_state()))?;
    Ok(lattice)
}

/// Restores the state in a file; `Ok(false)` without such a file, and the reason if it cannot be used.
fn load(
    lattice: &mut LatticeSolver,
    folder: &Folder,
    path: &str,
    limits: &Limits,
) -> std::result::Result<bool, &'static str> {
    // The file holds the state and two short lines.
    let most = lattice.memory_bytes().saturating_add(limits.get("text-bytes"));
    let Some(bytes) = read_below(folder.root(), path, most, "").map_err(|_| "cannot be read")? else {
        return Ok(false);
    };
    let state = checked_state(&bytes).ok_or("is damaged, or of another version")?;
    lattice.restore_state(state).map_err(|_| "is of another lattice wind")?;
    Ok(true)
}

fn header() -> String {
    format!("{GENERATOR}: air of a lattice wind after its run-up; a file that was changed is not used\n")
}

fn file_bytes(state: &[u8]) -> Vec<u8> {
    let mut file_bytes = header().into_bytes();
    file_bytes.reserve(state.len() + 65);
    file_bytes.extend(blake3::hash(state).to_hex().as_bytes());
    file_bytes.push(b'\n');
    file_bytes.extend(state);
    file_bytes
}

/// The state in the bytes of a file; `None` if another version wrote it or its hash differs.
fn checked_state(bytes: &[u8]) -> Option<&[u8]> {
    let rest = bytes.strip_prefix(header().as_bytes())?;
    let (hash, rest) = rest.split_first_chunk::<64>()?;
    let state = rest.strip_prefix(b"\n")?;
    (blake3::hash(state).to_hex().as_bytes() == hash).then_some(state)
}
