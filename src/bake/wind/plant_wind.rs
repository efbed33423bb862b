//! The wind in which plants sway, and the parameters of their sway.

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

/// The wind at the plants of a scene, with the settings of their sway.
#[derive(Debug, Clone)]
pub struct PlantWind {
    /// Sum of the scene's winds, each with its scale.
    pub wind: Arc<dyn Wind>,
    /// Frames to record, and whether they loop or start from rest.
    pub clip: ClipOptions,
    flicker: f64,
    whip: f64,
    fps: f64,
    phases: u32,
    /// Whether bending follows the branches' measured taper.
    measured: bool,
    /// Whether branches have a second bending mode.
    second_modes: bool,
    /// Whether gravity bends what leans.
    gravity: bool,
    /// Parameters of the paper's sway model; `None` for the beam model.
    pub paper: Option<PaperParams>,
    /// Whether motions are counted for an estimate and not simulated.
    pub estimate_only: bool,
}

/// Sum of a scene's winds that can be sampled at any time without a simulation; `None` in calm air.
pub fn analytic_winds(recipe: &Recipe) -> Option<Arc<dyn Wind>> {
    let all = (0..).zip([&recipe.wind].into_iter().chain(&recipe.added)).filter(|(_, keys)| keys.blows());
    let mut winds: Vec<Arc<dyn Wind>> = Vec::new();
    for (i, keys) in all {
        if keys.model != WindModel::Lattice {
            winds.push(build_wind(keys, None, recipe.general.seed, i));
        } else if recipe.lattice.solver == WindSolver::Analytic {
            let wind = Arc::new(analytic_inlet(&lattice_options(recipe)));
            winds.push(Arc::new(ScaledWind { wind, factor: narrow(keys.scale) }));
        }
    }
    if winds.len() > 1 { Some(Arc::new(WindSum(winds))) } else { winds.pop() }
}

impl PlantWind {
    /// Builds the winds of a recipe, and runs and records a lattice wind as `request` asks. `None` in a still scene and in calm air.
    /// # Errors
    /// Those of [`run_lattice`], for a lattice wind.
    pub fn from_recipe(
        recipe: &Recipe,
        request: &LatticeRequest<'_>,
        context: &BakeContext<'_>,
        report: &mut Report,
    ) -> Result<Option<Self>> {
        let sway = &recipe.sway;
        if recipe.clip.len() < 2 || !recipe.blows() {
            return Ok(None);
        }
        // A loop has a period of its own, in frames; all winds below repeat with it.
        let loop_frames = sway.loop_frames(&recipe.clip);
        let (frames, repeats) = (loop_frames.unwrap_or(recipe.clip.len()), loop_frames.is_some());
        let clip = ClipOptions {
            frames,
            repeats,
            from_rest: !repeats && sway.start == SwayStart::Rest,
            lean: sway.lean,
            gain: sway.exaggerate,
        };
        let period = loop_frames.map(|n| n as f64 / recipe.clip.fps());
        let winds: Vec<(u64, &WindKeys)> = (0..).zip([&recipe.wind].into_iter().chain(&recipe.added)).collect();
        let winds: Vec<(u64, &WindKeys)> = winds.into_iter().filter(|(_, keys)| keys.blows()).collect();
        let flickers = winds.iter().filter(|(_, keys)| keys.model != WindModel::Uniform);
        let flicker = flickers.map(|(_, keys)| keys.flicker).fold(0.0, f64::max);
        let lattice = (recipe.wind.model == WindModel::Lattice).then(|| {
            let wind = run_lattice(recipe, &LatticeRequest { loop_frames, ..*request }, context, report)?;
            Ok::<Arc<dyn Wind>, osier_base::Error>(Arc::new(ScaledWind { wind, factor: narrow(recipe.wind.scale) }))
        });
        let others = winds.iter().filter(|(_, keys)| keys.model != WindModel::Lattice);
        let others = others.map(|(i, keys)| build_wind(keys, period, recipe.general.seed, *i));
        let mut winds: Vec<Arc<dyn Wind>> = lattice.transpose()?.into_iter().chain(others).collect();
        let wind = if winds.len() == 1 { winds.remove(0) } else { Arc::new(WindSum(winds)) };
        Ok(Some(Self {
            wind,
            clip,
            flicker,
            whip: sway.whip,
            fps: recipe.clip.fps(),
            // A copy's phase is a frame of the clip, so that a loop of another length than the clip's allows none.
            phases: if frames == recipe.clip.len() { sway.phases } else { 1 },
            measured: sway.profile == BendProfile::Measured,
            second_modes: sway.modes > 1,
            gravity: sway.gravity,
            paper: paper_params(sway),
            estimate_only: false,
        }))
    }

    /// The same wind for an estimate, which counts motions without simulating them.
    pub fn for_estimate(self) -> Self {
        Self { estimate_only: true, ..self }
    }

    /// Frames by which a copy at `copy` is ahead of the copy at `first`, whose motion it shows: gusts reach a copy downwind later by
    /// d.u / |u|^2. Quantised to `sway.phases` values per loop, so that copies share states. Positions in m.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below the number of frames")]
    pub fn phase_offset(&self, first: Vec3, copy: Vec3) -> u32 {
        let frames = self.clip.frames as f64;
        let count = f64::from(self.phases).min(frames);
        if !self.clip.repeats || count < 2.0 {
            return 0;
        }
        let mean = self.wind.mean().as_dvec3();
        if mean.length() < CALM_SPEED {
            return 0;
        }
        // Delay as a share of the loop, negative as a later gust shows an earlier state.
        let delay = (copy - first).as_dvec3().dot(mean) / mean.length_squared();
        let share = (-delay * self.fps / frames).rem_euclid(1.0);
        ((share * count).round() % count / count * frames).round() as u32 % self.clip.frames.max(1) as u32
    }

    /// Parameters of the sway of a plant whose first copy has this transform.
    pub fn sway_params(&self, keys: &WoodKeys, stand: Trs) -> SwayParams {
        let wood = WoodParams { measured: self.measured, second_modes: self.second_modes, ..wood_params(keys) };
        SwayParams { wood, flicker: self.flicker, whip: self.whip, stand, gravity: self.gravity, fps: self.fps }
    }
}

fn paper_params(sway: &SwayKeys) -> Option<PaperParams> {
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

/// One of a scene's winds, scaled. `number`: counted from 0, from which each wind's noise gets a seed of its own.
fn build_wind(keys: &WindKeys, period: Option<f64>, seed: u64, number: u64) -> Arc<dyn Wind> {
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

/// Material of a plant's wood and leaves, from its keys or its timber.
pub fn wood_params(keys: &WoodKeys) -> WoodParams {
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
