//! The wind of a recipe, and how its plants take it.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::wind::lattice::{LatticeRequest, analytic_inlet, lattice_options, run_lattice};
use crate::recipe::Recipe;
use crate::recipe::scene::{
    BendProfile, PaperFix, SwayKeys, SwayModel, SwayStart, WindKeys, WindModel, WindSolver, WoodKeys,
};
use osier_base::math::{cos, narrow, sin};
use osier_base::rng;
use osier_base::{Result, diagnostic::Report};
use osier_motion::sway::{ClipOptions, PaperCorrections, PaperParams, SwayParams, WoodParams};
use osier_scene::Trs;
use osier_wind::{
    CALM_SPEED, GustWind, GustWindOptions, ScaledWind, SineWind, SineWindOptions, UniformWind, Wind, WindSum,
};

/// Wind as it meets the plants.
#[derive(Debug, Clone)]
pub struct PlantWind {
    /// The wind.
    pub wind: Arc<dyn Wind>,
    /// What is kept of the motion.
    pub take: ClipOptions,
    flicker: f64,
    whip: f64,
    fps: f64,
    phases: u32,
    /// Bends follow the measured taper; branches have second modes; gravity presses on what leans.
    measured: bool,
    overtones: bool,
    gravity: bool,
    /// The paper's equations, if they are asked for.
    pub paper: Option<PaperParams>,
    /// Of the motion only its size is asked for.
    pub draft: bool,
}

/// Those of a scene's winds that are known at any time without being stepped; none in a calm.
pub fn analytic_winds(recipe: &Recipe) -> Option<Arc<dyn Wind>> {
    let all = (0..).zip([&recipe.wind].into_iter().chain(&recipe.added)).filter(|(_, keys)| keys.blows());
    let mut winds: Vec<Arc<dyn Wind>> = Vec::new();
    for (i, keys) in all {
        if keys.model != WindModel::Lattice {
            winds.push(scaled_wind(keys, None, recipe.general.seed, i));
        } else if recipe.lattice.solver == WindSolver::Analytic {
            let wind = Arc::new(analytic_inlet(&lattice_options(recipe)));
            winds.push(Arc::new(ScaledWind { wind, factor: narrow(keys.scale) }));
        }
    }
    if winds.len() > 1 { Some(Arc::new(WindSum(winds))) } else { winds.pop() }
}

impl PlantWind {
    /// None in a still scene and in calm air. `wanted`: what a lattice wind is kept for and what stands in it.
    /// # Errors
    /// Those of [`run_lattice`], for a lattice wind.
    pub fn of(
        recipe: &Recipe,
        wanted: &LatticeRequest<'_>,
        context: &BakeContext<'_>,
        report: &mut Report,
    ) -> Result<Option<Self>> {
        let sway = &recipe.sway;
        if recipe.clip.len() < 2 || !recipe.blows() {
            return Ok(None);
        }
        let round = sway.loop_frames(&recipe.clip);
        let (frames, repeats) = (round.unwrap_or(recipe.clip.len()), round.is_some());
        let take = ClipOptions {
            frames,
            repeats,
            from_rest: !repeats && sway.start == SwayStart::Rest,
            lean: sway.lean,
            gain: sway.exaggerate,
        };
        let period = round.map(|n| n as f64 / recipe.clip.fps());
        let winds: Vec<(u64, &WindKeys)> = (0..).zip([&recipe.wind].into_iter().chain(&recipe.added)).collect();
        let winds: Vec<(u64, &WindKeys)> = winds.into_iter().filter(|(_, keys)| keys.blows()).collect();
        let flickers = winds.iter().filter(|(_, keys)| keys.model != WindModel::Uniform);
        let flicker = flickers.map(|(_, keys)| keys.flicker).fold(0.0, f64::max);
        let lattice = (recipe.wind.model == WindModel::Lattice).then(|| {
            let wind = run_lattice(
                recipe,
                &LatticeRequest { repeats: repeats.then_some(frames), ..*wanted },
                context,
                report,
            )?;
            Ok::<Arc<dyn Wind>, osier_base::Error>(Arc::new(ScaledWind { wind, factor: narrow(recipe.wind.scale) }))
        });
        let others = winds.iter().filter(|(_, keys)| keys.model != WindModel::Lattice);
        let others = others.map(|(i, keys)| scaled_wind(keys, period, recipe.general.seed, *i));
        let mut winds: Vec<Arc<dyn Wind>> = lattice.transpose()?.into_iter().chain(others).collect();
        let wind = if winds.len() == 1 { winds.remove(0) } else { Arc::new(WindSum(winds)) };
        Ok(Some(Self {
            wind,
            take,
            flicker,
            whip: sway.whip,
            fps: recipe.clip.fps(),
            // A loop of its own does not come round with the clip, whose frames copies would have to borrow.
            phases: if frames == recipe.clip.len() { sway.phases } else { 1 },
            measured: sway.profile == BendProfile::Measured,
            overtones: sway.modes > 1,
            gravity: sway.gravity,
            paper: paper(sway),
            draft: false,
        }))
    }

    /// The same for plants whose motion is counted and not shown.
    pub fn for_estimate(self) -> Self {
        Self { draft: true, ..self }
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
        if mean.length() < CALM_SPEED {
            return 0;
        }
        let late = (at - first).as_dvec3().dot(mean) / mean.length_squared();
        let share = (-late * self.fps / frames).rem_euclid(1.0);
        ((share * count).round() % count / count * frames).round() as u32 % self.take.frames.max(1) as u32
    }

    /// How a plant that stands at `stand` takes it.
    pub fn manner(&self, keys: &WoodKeys, stand: Trs) -> SwayParams {
        let wood = WoodParams { measured: self.measured, second_modes: self.overtones, ..wood(keys) };
        SwayParams { wood, flicker: self.flicker, whip: self.whip, stand, gravity: self.gravity, fps: self.fps }
    }
}

fn paper(sway: &SwayKeys) -> Option<PaperParams> {
    let has = |fix: PaperFix| sway.fixes.contains(&fix);
    (sway.model == SwayModel::Paper).then(|| PaperParams {
        fixes: PaperCorrections {
            radius: has(PaperFix::Radius),
            air: has(PaperFix::Air),
            damping: has(PaperFix::Damping),
        },
        recoil: sway.recoil,
        damping: sway.paper_damping,
    })
}

/// One of a scene's winds; `number`: which, as each has noise of its own.
fn scaled_wind(keys: &WindKeys, period: Option<f64>, seed: u64, number: u64) -> Arc<dyn Wind> {
    let seed = if number == 0 { seed } else { rng::child(seed, number) };
    let wind = analytic_wind(keys, period, seed);
    Arc::new(ScaledWind { wind, factor: narrow(keys.scale) })
}

fn analytic_wind(keys: &WindKeys, period: Option<f64>, seed: u64) -> Arc<dyn Wind> {
    let direction = Vec3::new(narrow(cos(keys.direction)), 0.0, narrow(-sin(keys.direction)));
    match keys.model {
        WindModel::Calm | WindModel::Uniform | WindModel::Lattice => {
            Arc::new(UniformWind(direction * narrow(keys.speed)))
        }
        WindModel::Gust => Arc::new(GustWind::new(GustWindOptions {
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
        WindModel::Perlin => Arc::new(SineWind::new(SineWindOptions {
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
pub fn wood(keys: &WoodKeys) -> WoodParams {
    WoodParams {
        elasticity: keys.elasticity.or(keys.timber.map(|t| t.elasticity())),
        density: keys.density,
        leaf_mass: keys.leaf_mass,
        drag: keys.drag,
        leaf_drag: keys.leaf_drag,
        stiffness: keys.stiffness,
        trunk_hertz: keys.trunk_frequency,
        hertz: keys.frequency_scale,
        damping: keys.damping,
        ..WoodParams::default()
    }
}
