//! Reads a system as a tree: its trunk, its branching maps, and the map that continues the axis.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::read::read;
//! use osier_ifs::stems::{is_tree, stems};
//!
//! let table = r#"
//! [ifs]
//! name = "fork"
//! dim = 3
//! map = [
//!     { branch = { h = 1.0, pitch = 25, scale = 0.7 } },
//!     { branch = { h = 1.0, roll = 180, pitch = 25, scale = 0.7 } },
//! ]
//! "#;
//! let (systems, _) = read("fork.ifs.toml", table.as_bytes(), &Limits::default())?;
//! assert!(is_tree(&systems[0]));
//! let tree = stems(&systems[0]).expect("every branch shrinks");
//! assert!(tree.radius > 0.0);
//! # Ok::<(), osier_base::Error>(())
//! ```

use glam::DVec3;

use super::color::is_squash;
use super::game::extent;
use super::weights::{WeightRule, similarity_dimension};
use super::words::Letters;
use super::{CondensationShape, Ifs, dynamics};
use osier_base::diagnostic::Diagnostic;
use osier_base::math;

/// Smallest height on the parent of a branch that continues the axis, and its largest angle to the trunk.
const MIN_APEX_HEIGHT: f64 = 0.9;
const MAX_APEX_LEAN_DEG: f64 = 35.0;
/// A trunk counts as the unit segment if each end lies within this distance of the segment's end, table units.
const UNIT_TRUNK_TOLERANCE: f64 = 0.03;
/// Radius divided by length of a trunk that the table does not describe.
const DEFAULT_TRUNK_RADIUS: f64 = 0.08;

/// A system whose maps place branches on a trunk; [`stems`] makes it.
#[derive(Debug, Clone, PartialEq)]
pub struct TreeSystem {
    /// The system, its squash maps marked as stems, one of its branches marked as the axis.
    pub system: Ifs,
    /// Scale and radius factor of each map.
    pub letters: Letters,
    /// Foot and tip of the trunk, table units.
    pub trunk: (DVec3, DVec3),
    /// Radius at the foot of the trunk, table units.
    pub radius: f64,
}

/// True if a system of space has branching maps and a trunk for them.
pub fn is_tree(ifs: &Ifs) -> bool {
    let branches = ifs.maps.iter().any(|m| m.branch.is_some());
    let segment = ifs.condensation.iter().any(|c| matches!(c.shape, CondensationShape::Segment { .. }));
    ifs.dim == 3 && (branches || segment || ifs.maps.iter().any(is_squash))
}

/// Reads a system as a tree. Branches keep the scales that the table states. A plain matrix has its norm as scale s and
/// the radius factor s^(D/2) with sum s^D = 1, so that a fork keeps its cross-section.
/// Source: Leonardo's rule of branch areas; [zhao-zhang] 2.2.1 names the branching modes.
/// # Errors
/// I041 for a branch that does not shrink, I023 if the system has no attractor.
pub fn stems(ifs: &Ifs) -> Result<TreeSystem, Box<Diagnostic>> {
    let mut system = ifs.clone();
    // Maps given as matrices: those that flatten the whole to a line draw stems.
    for map in system.maps.iter_mut().filter(|m| m.branch.is_none()) {
        map.stem |= is_squash(map);
    }
    let (trunk, radius) = trunk(&system)?;
    if system.maps.iter().all(|m| m.branch.is_none()) {
        let norms: Vec<f64> = system.maps.iter().filter(|m| !m.stem).map(|m| m.affine.norm()).collect();
        // sum s^D = 1 makes the cross-sections r^2 = s^D of the branches sum to that of their parent.
        let half = 0.5 * similarity_dimension(&norms, 3.0);
        for map in system.maps.iter_mut().filter(|m| !m.stem && m.radius.is_none()) {
            map.radius = Some(math::pow(map.affine.norm(), half));
        }
        if system.maps.iter().all(|m| !m.axis)
            && let Some(apex) = apex(&system, trunk.0, trunk.1)
        {
            system.maps[apex].axis = true;
        }
    }
    let letters = Letters::new(&system)?;
    Ok(TreeSystem { system, letters, trunk, radius })
}

/// Index of the first branching map that is no similarity (relative tolerance 1e-6): its subtrees are no copies of the whole.
pub fn sheared(stems: &TreeSystem) -> Option<usize> {
    let even = |a: &super::affine::Affine| {
        let columns = [a.a.x_axis, a.a.y_axis, a.a.z_axis];
        let size = math::sqrt(a.a.y_axis.dot(a.a.y_axis)).max(1e-300);
        let length = |v: DVec3| math::sqrt(v.dot(v));
        let long = columns.iter().all(|c| (length(*c) / size - 1.0).abs() < 1e-6);
        long && (0..3).all(|i| (columns[i].dot(columns[(i + 1) % 3]) / (size * size)).abs() < 1e-6)
    };
    stems.system.maps.iter().position(|m| !m.stem && !even(&m.affine))
}

/// The trunk's ends and radius: the condensation segment, or the first stem map's image of the whole.
fn trunk(ifs: &Ifs) -> Result<((DVec3, DVec3), f64), Box<Diagnostic>> {
    for c in &ifs.condensation {
        if let CondensationShape::Segment { from, to, radius } = &c.shape {
            return Ok(((DVec3::from_array(*from), DVec3::from_array(*to)), *radius));
        }
    }
    let unit = (DVec3::ZERO, DVec3::Y);
    let Some(stem) = ifs.maps.iter().find(|m| m.stem) else { return Ok((unit, DEFAULT_TRUNK_RADIUS)) };
    let study = dynamics::study(ifs, WeightRule::File);
    let (low, high) = extent(ifs, &study)?.bounds;
    let middle = (low + high) * 0.5;
    // The stem map takes the axis of the attractor's box to the trunk.
    let end = |y: f64| stem.affine.apply(DVec3::new(middle.x, y, middle.z));
    let (foot, tip) = (end(low.y), end(high.y));
    let half = 0.5 * (high.x - low.x).max(high.z - low.z);
    let widths = stem.affine.singular_values();
    // The image of the crown takes four fifths of the width of the trunk (`DENSE` in write/tree.rs), so divide by that to get the
    // radius of the trunk.
    let radius = (widths[1] * half / 0.8).max(1e-6);
    // A trunk that nearly equals the unit segment is set to it, so that coordinates of words stay round numbers.
    let near = |p: DVec3, q: DVec3| (p - q).length() < UNIT_TRUNK_TOLERANCE;
    if near(foot, unit.0) && near(tip, unit.1) { Ok((unit, radius)) } else { Ok(((foot, tip), radius)) }
}

/// The branch at the trunk's tip that leans least, if it leans less than 35 degrees.
fn apex(ifs: &Ifs, foot: DVec3, tip: DVec3) -> Option<usize> {
    let along = tip - foot;
    // Angle between a branch and the trunk.
    let lean = |i: &usize| {
        let map = &ifs.maps[*i].affine;
        let dir = (map.a * along).try_normalize().unwrap_or(DVec3::NEG_Y);
        math::acos(dir.dot(along.normalize_or_zero()).clamp(-1.0, 1.0))
    };
    let high = |i: &usize| {
        let map = &ifs.maps[*i];
        let h = (map.affine.apply(foot) - foot).dot(along) / along.length_squared().max(1e-30);
        !map.stem && h >= MIN_APEX_HEIGHT
    };
    let mut best: Option<(f64, usize)> = None;
    let mut ties = 0;
    for i in (0..ifs.maps.len()).filter(high) {
        let l = lean(&i);
        if best.is_some_and(|(b, _)| (l - b).abs() < 1e-3) {
            ties += 1;
        }
        if best.is_none_or(|(b, _)| l < b) {
            best = Some((l, i));
        }
    }
    // If several branches lean equally little, as in a symmetric fork, none of them continues the axis.
    best.filter(|(l, _)| *l < osier_base::units::radians(MAX_APEX_LEAN_DEG) && ties == 0).map(|b| b.1)
}
