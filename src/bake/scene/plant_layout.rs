//! The individuals of a scene and their instances.

use glam::{Quat, Vec3};

use crate::recipe::Recipe;
use osier_base::math;
use osier_base::rng::{child, mix64, word};
use osier_scene::Trs;

/// One plant to grow.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Individual {
    /// Index into the recipe's plants.
    pub plant: usize,
    /// Asset id, `[a-z0-9_]+`.
    pub asset: String,
    /// Names it in ids: of its plant's name and its ordinal, never of a seed.
    pub id: u32,
    /// Seed of its draws.
    pub seed: u64,
}

/// One showing of an individual.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantInstance {
    /// Index into [`PlantLayout::individuals`].
    pub individual: usize,
    /// World from plant space.
    pub transform: Trs,
    /// Tangent of the land's slope there, by which a thick foot is sunk; `None` where there is no land.
    pub slope: Option<f32>,
}

/// Individuals and their places.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlantLayout {
    /// In the order of the places.
    pub individuals: Vec<Individual>,
    /// In the order of the places.
    pub standings: Vec<PlantInstance>,
}

impl PlantLayout {
    /// Where the first copy of each individual stands.
    pub fn first_stands(&self) -> Vec<Trs> {
        let mut stands = vec![None; self.individuals.len()];
        for s in &self.standings {
            if let Some(stand) = stands.get_mut(s.individual) {
                stand.get_or_insert(s.transform);
            }
        }
        stands.into_iter().map(|s| s.unwrap_or(Trs::IDENTITY)).collect()
    }
}

/// The next individual of a plant. `seed`: of its place, 0 for none.
pub(crate) fn individual(recipe: &Recipe, index: usize, seed: u64, ordinals: &mut [u32]) -> Option<Individual> {
    let plant = recipe.plants.get(index)?;
    let ordinal = ordinals.get_mut(index)?;
    let id = child(word(&plant.name), u64::from(*ordinal));
    *ordinal += 1;
    let seed = match (plant.keys.seed, seed) {
        (0, 0) => recipe.general.seed,
        (a, b) => mix64(&[recipe.general.seed, a, b]),
    };
    #[allow(clippy::cast_possible_truncation, reason = "the low half of a hash")]
    Some(Individual { plant: index, asset: String::new(), id: id as u32, seed })
}

/// Tangent of the slope of a surface with this unit normal.
pub(crate) fn tangent(normal: Vec3) -> f32 {
    math::sqrt_f32((1.0 - normal.y * normal.y).max(0.0)) / normal.y.max(1e-3)
}

pub(crate) fn rotation(axis: Vec3, angle: f64) -> Quat {
    let v = axis * math::narrow(math::sin(angle * 0.5));
    Quat::from_xyzw(v.x, v.y, v.z, math::narrow(math::cos(angle * 0.5)))
}
