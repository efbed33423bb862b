//! Initial drops of `[[rain.lying]]`: checked against the leaves, and deposited when the clip begins.

use glam::{DVec2, DVec3};

use crate::recipe::scene::SessileDropKeys;
use osier_base::{Error, Result};
use osier_motion::rain::{RainLeaf, RainSimulation};

/// Checks that every initial drop lies on a leaf's blade.
/// # Errors
/// S004, with the key that is wrong.
pub fn check_initial_drops(lying: &[SessileDropKeys], leaves: &[RainLeaf]) -> Result<()> {
    for (i, drop) in lying.iter().enumerate() {
        let Some(leaf) = leaves.get(drop.leaf as usize) else {
            let text = format!(
                "rain.lying.{i}.leaf is {}, but the scene has {} leaves, counted from 0, that can carry drops",
                drop.leaf,
                leaves.len()
            );
            return Err(Error::input("S004", text));
        };
        let uv = DVec2::from_array(drop.at);
        if leaf.point_at(uv).is_none() || !leaf.blade.is_solid(uv) {
            let text = format!(
                "rain.lying.{i}.at is [{}, {}], where leaf {} has no blade; [0.5, 0.5] is the middle of its picture",
                drop.at[0], drop.at[1], drop.leaf
            );
            return Err(Error::input("S004", text));
        }
    }
    Ok(())
}

/// Deposits the initial drops with their velocities along and across the blade.
pub fn deposit_initial_drops(simulation: &mut RainSimulation, lying: &[SessileDropKeys]) {
    for drop in lying {
        let v = DVec3::new(drop.speed[1], drop.speed[0], 0.0);
        simulation.deposit_drop(drop.leaf as usize, DVec2::from_array(drop.at), v, drop.volume);
    }
}
