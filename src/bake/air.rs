//! The wind of a recipe, and how its plants take it.

use std::sync::Arc;

use glam::Vec3;

use crate::math::{cos, narrow, sin};
use crate::motion::{Fixes, Manner, PaperManner, Take, Wood};
use crate::recipe::Recipe;
use crate::recipe::air::{SHORTEST_LOOP, seconds};
use crate::recipe::wind_keys::{PaperFix, Start, SwayKeys, SwayModel, WindKeys, WindModel, WoodKeys};
use crate::scene::Trs;
use crate::wind::{Formula, FormulaOptions, Gust, GustOptions, Uniform, Wind};

/// Wind as it meets the plants.
#[derive(Debug, Clone)]
pub struct Air {
    /// The wind.
    pub wind: Arc<dyn Wind>,
    /// What is kept of the motion.
    pub take: Take,
    flicker: f64,
    whip: f64,
    fps: f64,
    phases: u32,
    /// The paper's equations, if they are asked for.
    pub paper: Option<PaperManner>,
}

impl Air {
    /// None in a still scene and in calm air.
    pub fn of(recipe: &Recipe) -> Option<Self> {
        let (keys, sway) = (&recipe.wind, &recipe.sway);
        if recipe.clip.len() < 2 || !keys.blows() {
            return None;
        }
        let length = seconds(&recipe.clip);
        let repeats = sway.repeat.unwrap_or(length >= SHORTEST_LOOP);
        let take = Take {
            frames: recipe.clip.len(),
            repeats,
            from_rest: !repeats && sway.start == Start::Rest,
            lean: sway.lean,
            gain: sway.exaggerate,
        };
        let wind = wind(keys, repeats.then_some(length), recipe.seed);
        let flicker = if keys.model == WindModel::Uniform { 0.0 } else { keys.flicker };
        Some(Self {
            wind,
            take,
            flicker,
            whip: sway.whip,
            fps: recipe.clip.fps(),
            phases: sway.phases,
            paper: paper(sway),
        })
    }

    /// Frames by which a copy at `at` is ahead of the one at `first`, m, whose motion it shows: gusts reach what stands
    /// downwind later. One of a few, so that copies share states.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below the number of frames")]
    pub fn phase(&self, first: Vec3, at: Vec3) -> u32 {
        let frames = self.take.frames as f64;
        let count = f64::from(self.phases).min(frames);
        if !self.take.repeats || count < 2.0 {
            return 0;
        }
        let mean = self.wind.mean().as_dvec3();
        let late = (at - first).as_dvec3().dot(mean) / mean.length_squared();
        let share = (-late * self.fps / frames).rem_euclid(1.0);
        ((share * count).round() % count / count * frames).round() as u32 % self.take.frames.max(1) as u32
    }

    /// How a plant that stands at `stand` takes it.
    pub fn manner(&self, keys: &WoodKeys, stand: Trs) -> Manner {
        Manner { wood: wood(keys), flicker: self.flicker, whip: self.whip, stand, fps: self.fps }
    }
}

fn paper(sway: &SwayKeys) -> Option<PaperManner> {
    let has = |fix: PaperFix| sway.fixes.contains(&fix);
    (sway.model == SwayModel::Paper).then(|| PaperManner {
        fixes: Fixes { radius: has(PaperFix::Radius), air: has(PaperFix::Air), damping: has(PaperFix::Damping) },
        recoil: sway.recoil,
        damping: sway.paper_damping,
    })
}

fn wind(keys: &WindKeys, period: Option<f64>, seed: u64) -> Arc<dyn Wind> {
    let direction = Vec3::new(narrow(cos(keys.direction)), 0.0, narrow(-sin(keys.direction)));
    match keys.model {
        WindModel::Calm | WindModel::Uniform => Arc::new(Uniform(direction * narrow(keys.speed))),
        WindModel::Gust => Arc::new(Gust::new(GustOptions {
            direction,
            speed: keys.speed,
            gust: narrow(keys.gust),
            turbulence: narrow(keys.turbulence),
            gust_length: keys.gust_length,
            eddy_size: keys.eddy_size,
            wander: narrow(keys.wander),
            power: narrow(keys.power),
            period,
            seed,
        })),
        WindModel::Perlin => Arc::new(Formula::new(FormulaOptions {
            direction,
            speed: keys.speed,
            gust: narrow(keys.gust),
            power: narrow(keys.power),
            literal: keys.literal,
            period,
            seed,
        })),
    }
}

/// What a plant is made of.
pub fn wood(keys: &WoodKeys) -> Wood {
    Wood {
        elasticity: keys.elasticity.map(|e| e * 1e9).or(keys.timber.map(|t| t.elasticity())),
        density: keys.density,
        leaf_mass: keys.leaf_mass,
        drag: keys.drag,
        leaf_drag: keys.leaf_drag,
        stiffness: keys.stiffness,
        trunk_hertz: keys.trunk,
        hertz: keys.hertz,
        damping: keys.damping,
    }
}
