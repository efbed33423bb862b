//! The wind for plants: the fields that they sample and the parameters of their sway.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::wind::analytic::blowing_direction;
use crate::bake::wind::scene_wind::{SceneWind, WindUser};
use crate::recipe::Recipe;
use crate::recipe::scene::{BendProfile, PaperFix, SwayKeys, SwayModel, SwayStart, WindKeys, WindModel, WoodKeys};
use osier_base::math::narrow;
use osier_motion::sway::{ClipOptions, PaperCorrections, PaperParams, SwayParams, WoodParams};
use osier_scene::Trs;
use osier_wind::{CALM_SPEED, UniformWind, Wind};

/// The wind fields of a scene's plants, with the settings of `[sway]`.
#[derive(Debug, Clone)]
pub struct PlantWind {
    /// The scene's wind, reported to observers as that of branches of the sway model and their leaves.
    pub wind: Arc<dyn Wind>,
    /// The scene's wind, reported to observers as that of plants on rods.
    pub rod_wind: Arc<dyn Wind>,
    /// Frames to record, and whether they loop or start from rest.
    pub clip: ClipOptions,
    /// Whether plants on rods start at rest, which never loop.
    pub rods_from_rest: bool,
    /// Velocity at which gusts travel, m/s.
    gust_travel_velocity: Vec3,
    flicker: f64,
    whip: f64,
    fps: f64,
    phases: u32,
    /// Whether the bending profile follows the branches' measured taper.
    measured: bool,
    /// Whether branches have a second bending mode.
    second_modes: bool,
    /// Gravitational acceleration, m/s^2, that bends deflected branches further; `None` without `gravity_change`.
    gravity: Option<f64>,
    /// Parameters of the paper's sway model; `None` for the beam model.
    pub paper: Option<PaperParams>,
    /// Whether motions are only counted, in an estimate, instead of simulated.
    pub estimate_only: bool,
}

impl PlantWind {
    /// The wind of a scene with the settings of its plants' sway; `None` in a still scene, and in calm air unless it rains,
    /// because drops move plants without wind.
    pub fn new(recipe: &Recipe, scene: &SceneWind) -> Option<Self> {
        let sway = &recipe.sway;
        if recipe.clip.len() < 2 || !(recipe.blows() || recipe.rain.is_some()) {
            return None;
        }
        let calm = || -> Arc<dyn Wind> { Arc::new(UniformWind(Vec3::ZERO)) };
        let wind = scene.wind_at_all_times(WindUser::Sway).unwrap_or_else(calm);
        let rod_wind = scene.wind_at_all_times(WindUser::RodPlants).unwrap_or_else(calm);
        // The length of a loop in frames need not be that of the clip; the scene's wind repeats with the loop.
        let loop_frames = sway.loop_frames(&recipe.clip);
        let (frames, repeats) = (loop_frames.unwrap_or(recipe.clip.len()), loop_frames.is_some());
        let clip = ClipOptions {
            frames,
            repeats,
            from_rest: !repeats && sway.start == SwayStart::Rest,
            lean: sway.lean,
            gain: sway.exaggerate,
        };
        let winds = [&recipe.wind].into_iter().chain(&recipe.added);
        let flickers = winds.filter(|keys| keys.blows() && keys.model != WindModel::Uniform);
        let flicker = flickers.map(|keys| keys.flicker).fold(0.0, f64::max);
        Some(Self {
            rods_from_rest: sway.start == SwayStart::Rest,
            gust_travel_velocity: gust_travel_velocity(recipe, &*wind),
            wind,
            rod_wind,
            clip,
            flicker,
            whip: sway.whip,
            fps: recipe.clip.fps(),
            // Phases are frames of the clip, so that a loop of another length allows none.
            phases: if frames == recipe.clip.len() { sway.phases } else { 1 },
            measured: sway.profile == BendProfile::Measured,
            second_modes: sway.modes > 1,
            gravity: sway.gravity.then(|| recipe.gravity()),
            paper: paper_params(sway),
            estimate_only: false,
        })
    }

    /// The same wind marked for an estimate.
    pub fn for_estimate(self) -> Self {
        Self { estimate_only: true, ..self }
    }

    /// Number of frames by which a copy at `copy` leads the copy at `first`, whose motion it shows: gusts reach a copy downwind
    /// later by d.u / |u|^2. Quantised to `sway.phases` values per loop, so that copies share states. Positions in m.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below the number of frames")]
    pub fn phase_offset(&self, first: Vec3, copy: Vec3) -> u32 {
        let frames = self.clip.frames as f64;
        let count = f64::from(self.phases).min(frames);
        if !self.clip.repeats || count < 2.0 {
            return 0;
        }
        let travel = self.gust_travel_velocity.as_dvec3();
        if travel.length() < CALM_SPEED {
            return 0;
        }
        // Delay as a share of the loop; negative, since a later gust corresponds to an earlier state.
        let delay = (copy - first).as_dvec3().dot(travel) / travel.length_squared();
        let share = (-delay * self.fps / frames).rem_euclid(1.0);
        // The share is rounded to one of `count` phases, and the phase to a whole frame.
        ((share * count).round() % count / count * frames).round() as u32 % self.clip.frames.max(1) as u32
    }

    /// Parameters of the sway of a plant. `stand`: world transform of its first copy.
    pub fn sway_params(&self, keys: &WoodKeys, stand: Trs) -> SwayParams {
        let wood = WoodParams { measured: self.measured, second_modes: self.second_modes, ..wood_params(keys) };
        // Of two similar trees, the one of twice the size sways at half the frequency; its static bends are the same. A trunk
        // frequency given in the scene is not scaled.
        let scale = f64::from(stand.s.x);
        let trunk_hertz = wood.trunk_hertz.map(|hertz| hertz * scale);
        let wood = WoodParams { hertz: wood.hertz / scale, trunk_hertz, ..wood };
        SwayParams { wood, flicker: self.flicker, whip: self.whip, stand, gravity: self.gravity, fps: self.fps }
    }
}

/// Velocity, m/s, at which the gusts of a scene's `wind` travel: that of the strongest of its winds that vary. `scale` multiplies
/// velocities of the air, but not this velocity; a steady wind that is added to the gusts does not carry them either.
fn gust_travel_velocity(recipe: &Recipe, wind: &dyn Wind) -> Vec3 {
    let winds: Vec<&WindKeys> = [&recipe.wind].into_iter().chain(&recipe.added).filter(|keys| keys.blows()).collect();
    let varying = winds.iter().filter(|keys| keys.model != WindModel::Uniform);
    let strongest = varying.reduce(|a, b| if b.speed * b.scale > a.speed * a.scale { b } else { a });
    match strongest {
        Some(keys) if keys.model != WindModel::Lattice => blowing_direction(keys) * narrow(keys.speed),
        // The mean of a lattice is that of its profile at 10 m.
        Some(keys) if winds.len() == 1 => wind.mean() / narrow(keys.scale),
        _ => wind.mean(),
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

/// Mechanical parameters of a plant's wood and leaves, from its keys; the elasticity may come from the key `timber`.
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
