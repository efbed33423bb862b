//! The individuals of a scene, which are grown once each, and the instances that display them.

use glam::{Quat, Vec3};

use crate::recipe::Recipe;
use osier_base::math;
use osier_base::rng::{child, mix64, word};
use osier_scene::Trs;

/// One plant to grow: a member of its species with different random draws.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Individual {
    /// Index into the recipe's plants.
    pub plant: usize,
    /// Asset id, `[a-z0-9_]+`, unique in the scene; empty until assets are named.
    pub asset: String,
    /// Identifier from the plant's name and the individual's ordinal; no seed changes it.
    pub id: u32,
    /// Seed of all draws of its growth: the scene's, mixed with those of its plant and of its place where they are set.
    pub seed: u64,
    /// Whether it grows in one field of light with all other individuals that have this flag.
    pub together: bool,
}

/// A placement of an individual; several may display the same one.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantInstance {
    /// Index into [`PlantLayout::individuals`].
    pub individual: usize,
    /// World from plant space.
    pub transform: Trs,
    /// Whether its height is absolute, so that ground and terrain don't move it.
    pub absolute_height: bool,
    /// Tangent of the terrain's slope there, by which the foot is sunk; `None` without terrain and at absolute heights.
    pub slope: Option<f32>,
}

/// The individuals to grow and the placements of their copies.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlantLayout {
    /// Individuals of the places in the order of the scene, then those of the scatters.
    pub individuals: Vec<Individual>,
    /// Placements of the places in the order of the scene, then those of the scatters.
    pub instances: Vec<PlantInstance>,
}

impl PlantLayout {
    /// Transform of the first instance of each individual, whose place in the wind all of its instances share.
    pub fn first_transforms(&self) -> Vec<Trs> {
        let mut transforms = vec![None; self.individuals.len()];
        for s in &self.instances {
            if let Some(first) = transforms.get_mut(s.individual) {
                first.get_or_insert(s.transform);
            }
        }
        transforms.into_iter().map(|s| s.unwrap_or(Trs::IDENTITY)).collect()
    }
}

/// The next individual of plant `index`, without an asset id, and counts it in `ordinals`. `seed`: that of its `[[place]]`, 0
/// for none.
pub(crate) fn next_individual(recipe: &Recipe, index: usize, seed: u64, ordinals: &mut [u32]) -> Option<Individual> {
    let plant = recipe.plants.get(index)?;
    let ordinal = ordinals.get_mut(index)?;
    let id = child(word(&plant.name), u64::from(*ordinal));
    *ordinal += 1;
    let seed = match (plant.keys.seed, seed) {
        (0, 0) => recipe.general.seed,
        (a, b) => mix64(&[recipe.general.seed, a, b]),
    };
    #[allow(clippy::cast_possible_truncation, reason = "the low half of a hash")]
    Some(Individual { plant: index, asset: String::new(), id: id as u32, seed, together: false })
}

/// Tangent of the angle between a surface with this unit normal and the horizontal.
pub(crate) fn tan_of_slope(normal: Vec3) -> f32 {
    // tan = sin / cos with cos = n_y; the lower bound keeps vertical faces finite.
    math::sqrt_f32((1.0 - normal.y * normal.y).max(0.0)) / normal.y.max(1e-3)
}

/// Rotation by `angle`, radians, about a unit axis, by deterministic sine and cosine.
pub(crate) fn rotation_about_axis(axis: Vec3, angle: f64) -> Quat {
    // Quaternion of a rotation: (axis sin(angle / 2), cos(angle / 2)).
    let v = axis * math::narrow(math::sin(angle * 0.5));
    Quat::from_xyzw(v.x, v.y, v.z, math::narrow(math::cos(angle * 0.5)))
}
