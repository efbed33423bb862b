//! A tree as a plain system: its trunk as a map that squashes the whole.

use glam::{DMat3, DVec3};

use super::TableItem;
use crate::Map;
use crate::affine::Affine;
use crate::stems::TreeSystem;
use crate::words::tree_extent;
use osier_base::math;

/// Share of the trunk's diameter that the squashed crown takes, so that outliers of the crown stay within the trunk.
const DENSE: f64 = 0.8;
/// Least weight of a map before normalization: thin maps must get enough points to show.
const LEAST: f64 = 0.02;

/// The tree as a system of a map that squashes the whole into the trunk and of the branching maps. Systems that already
/// hold such a map stay as they are. Weights are max(|det|^(2/3), 0.02) divided by their sum.
/// Own: the width of the trunk is 0.8 of its diameter over the crown's width at eps 0.03.
pub fn squashed(stems: &TreeSystem) -> TableItem {
    let mut system = stems.system.clone();
    if system.maps.iter().all(|m| !m.stem) {
        let squash = Map { stem: true, ..Map::new(squash(stems), None, system.span) };
        system.maps.insert(0, squash);
    }
    let weight = |m: &Map| math::pow(m.affine.det(3).abs(), 2.0 / 3.0).max(LEAST);
    let weights: Vec<f64> = system.maps.iter().map(weight).collect();
    let sum = weights.iter().fold(0.0, |s, w| s + w).max(1e-9);
    TableItem { system, weights: weights.iter().map(|w| w / sum).collect(), view: None }
}

fn squash(stems: &TreeSystem) -> Affine {
    let (foot, tip) = stems.trunk;
    let extent = tree_extent(&stems.system, &stems.letters, stems.trunk);
    let (high, wide) = (extent.height, extent.half_width.max(1e-9));
    let along = tip - foot;
    // The squash map takes the crown's height to the trunk's length, and its half width to DENSE times the trunk's radius.
    let thin = DENSE * stems.radius / wide;
    let up = along.try_normalize().unwrap_or(DVec3::Y);
    let side = (DVec3::X - up * up.x).try_normalize().unwrap_or(DVec3::Z);
    let a = DMat3::from_cols(side * thin, along / high, side.cross(up) * thin);
    Affine { a, b: foot - a * foot }
}
