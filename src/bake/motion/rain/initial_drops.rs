//! Initial drops of `[[rain.lying]]`: checked against the leaves, and deposited when the clip begins.

use glam::{DVec2, DVec3};

use crate::recipe::KeyPlaces;
use crate::recipe::scene::SessileDropKeys;
use osier_base::diagnostic::Diagnostic;
use osier_base::{Error, Result};
use osier_motion::rain::{RainLeaf, RainSimulation};

/// Checks that every initial drop lies on a leaf's blade.
/// # Errors
/// S004, with the key that is wrong and its place.
pub fn check_initial_drops(lying: &[SessileDropKeys], leaves: &[RainLeaf], places: &KeyPlaces) -> Result<()> {
    let refuse = |key: String, text: String, help: &str| {
        let d = Diagnostic::about("S004", text).help(help);
        Err(Error::Input(Box::new(places.report_at(&key, d, "this drop"))))
    };
    for (i, drop) in lying.iter().enumerate() {
        let Some(leaf) = leaves.get(drop.leaf as usize) else {
            let text = format!(
                "rain.lying.{i}.leaf is {}, but the scene has {} leaves, counted from 0, that can carry drops",
                drop.leaf,
                leaves.len()
            );
            return refuse(format!("rain.lying.{i}.leaf"), text, "name a leaf of a lower number");
        };
        let uv = DVec2::from_array(drop.at);
        if leaf.point_at(uv).is_none() || !leaf.blade.is_solid(uv) {
            let text =
                format!("rain.lying.{i}.at is [{}, {}], where leaf {} has no blade", drop.at[0], drop.at[1], drop.leaf);
            let help = "move the drop onto the blade: [0.5, 0.5] is the middle of its picture";
            return refuse(format!("rain.lying.{i}.at"), text, help);
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
