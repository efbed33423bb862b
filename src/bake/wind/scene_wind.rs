//! The wind of a scene: trees, leaves, rods, catkins, rain and files all read the same field.
//!
//! Time 0 is the clip's first frame; simulations that spin up before it read negative times. A looping wind repeats there. A
//! wind without a loop is defined at all times if it is analytic, and from the earliest spin-up on if it is a lattice.

use std::fmt::Debug;
use std::sync::{Arc, Mutex, PoisonError};

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::cache::wind_spin_up;
use crate::bake::wind::analytic::formula_wind;
use crate::bake::wind::lattice::{
    LatticeConfig, LatticePlan, SteppedLattice, analytic_inlet, report_land_below_lattice, report_warnings,
};
use crate::bake::wind::needs::WindNeeds;
use crate::recipe::Recipe;
use crate::recipe::scene::{WindKeys, WindModel, WindSolver};
use osier_base::Result;
use osier_base::diagnostic::Report;
use osier_base::math::narrow;
use osier_scene::solid::{LandForm, Solid};
use osier_wind::{LatticeStats, LoopedWind, RecordedWind, ScaledWind, UniformWind, Wind, WindSum};

/// Least height above a surface at which an analytic wind is sampled, m; below it a flight scales the wind down towards the
/// surface. Own: the width of a cell of the default lattice.
/// Own: the width of a cell of the default lattice.
const ANALYTIC_KNOWN_HEIGHT: f64 = 0.5;

/// A part of a scene that reads its wind, as observers distinguish them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum WindUser {
    /// Branches of the sway model, and their leaves.
    Sway,
    /// Plants on rods, whose axes and blades sample the wind in every step.
    RodPlants,
    /// Rods of `[[rod]]`.
    Rods,
    /// Rain, and the plants that it moves.
    Rain,
    /// Catkins of `[flight]`.
    Flight,
    /// Grids of `[[output.wind]]`, written frame by frame.
    Output,
}

/// Receives every velocity that a part of the scene samples, from several threads.
pub trait WindObserver: Debug + Send + Sync {
    /// Called after `user` has sampled `velocities`, m/s, at world `positions`, m, and time `t`, s.
    fn sampled(&self, user: WindUser, positions: &[Vec3], t: f64, velocities: &[Vec3]);
}

/// Solids and land that the wind flows around and over.
pub struct WindSurroundings<'a> {
    /// Obstacles and land of a lattice.
    pub solids: &'a [Solid],
    /// The land above which heights of the wind are measured; `None` for the plane y = 0.
    pub land: Option<Arc<LandForm>>,
}

/// All winds of a scene: those known for the whole clip, and a lattice that is stepped frame by frame.
#[derive(Debug)]
pub struct SceneWind {
    /// The wind that is read ahead of the frames, at all times and positions; `None` in calm air, and if the lattice is only
    /// stepped.
    field: Option<Arc<dyn Wind>>,
    /// A lattice that is stepped along with the frames, and the winds added to it.
    stepped: Option<SteppedWind>,
    /// Recorded snapshots of a lattice for the whole clip.
    recorded: Option<Arc<RecordedWind>>,
    /// Width of the cells of a lattice, m.
    cell_size: Option<f64>,
    recorded_bytes: u64,
    observer: Option<Arc<dyn WindObserver>>,
}

#[derive(Debug)]
struct SteppedWind {
    lattice: Mutex<SteppedLattice>,
    scale: f32,
    /// The scene's other winds, whose velocities are added.
    others: Vec<Arc<dyn Wind>>,
}

impl SceneWind {
    /// Builds the winds of a recipe; simulates a lattice through the clip if it is read ahead of the frames, otherwise through
    /// its spin-up. `full`: in an estimate, the complete recipe, of which `recipe` is a reduction; its lattice is planned but not
    /// run.
    /// # Errors
    /// Errors of [`LatticePlan::new`] and of the lattice's run.
    pub fn new(
        recipe: &Recipe,
        full: Option<&Recipe>,
        needs: &WindNeeds,
        surroundings: &WindSurroundings<'_>,
        observer: Option<Arc<dyn WindObserver>>,
        context: &BakeContext<'_>,
        report: &mut Report,
    ) -> Result<Self> {
        let plan = LatticePlan::new(full.unwrap_or(recipe), needs, context.limits)?;
        let mut wind = Self {
            field: None,
            stepped: None,
            recorded: None,
            cell_size: plan.as_ref().map(|plan| plan.options.spacing),
            recorded_bytes: plan.as_ref().map_or(0, LatticePlan::recorded_bytes),
            observer,
        };
        let uses_lattice = full.unwrap_or(recipe).has_lattice_wind() && recipe.wind.blows();
        if let Some(land) = surroundings.land.as_ref().filter(|_| uses_lattice && !needs.is_empty()) {
            report_land_below_lattice(full.unwrap_or(recipe), land, report);
        }
        let scale = narrow(recipe.wind.scale);
        let mut winds = analytic_winds(recipe, surroundings.land.as_ref());
        let Some(plan) = plan.filter(|_| full.is_none()) else {
            wind.field = sum_winds(winds);
            return Ok(wind);
        };

        // A lattice comes first in the sum. The same options, solids and first snapshot give the same velocities, bit by bit, in a
        // recording and step by step.
        if plan.stepped {
            let config = LatticeConfig::new(plan.options.clone(), surroundings.solids, context);
            let lattice = SteppedLattice::start(config, context.progress)?;
            // If there is also a recording, its solver reports the same warnings.
            if plan.recorded.is_none() {
                report_warnings(lattice.solver(), report);
            }
            wind.stepped = Some(SteppedWind { lattice: Mutex::new(lattice), scale, others: winds.clone() });
        }
        if let Some(recording) = plan.recorded {
            let mut solver = wind_spin_up::load_or_spin_up(&plan.options, surroundings.solids, context)?;
            let recorded =
                RecordedWind::record(&mut solver, recording, context.limits, context.progress, context.cancel)?;
            report_warnings(&solver, report);
            let recorded = Arc::new(recorded);
            winds.insert(0, scaled_wind(Arc::clone(&recorded) as Arc<dyn Wind>, scale));
            wind.field = sum_winds(winds);
            wind.recorded = Some(recorded);
        }
        Ok(wind)
    }

    /// The wind at all times, for simulations that run ahead of the frames; `None` in calm air. `user`: the part that reads the
    /// wind, for observers.
    pub fn wind_at_all_times(&self, user: WindUser) -> Option<Arc<dyn Wind>> {
        self.field.as_ref().map(|wind| self.observed(user, Arc::clone(wind)))
    }

    /// The wind of the whole box between frame `frame`, counted from the clip's first, and the next. If a lattice is stepped, an
    /// earlier frame than before restarts it.
    /// # Errors
    /// Errors of a lattice.
    pub fn wind_until_next_frame(&self, user: WindUser, frame: i64) -> Result<Arc<dyn Wind>> {
        let wind = match (&self.stepped, &self.field) {
            (Some(stepped), _) => {
                let wind =
                    stepped.lattice.lock().unwrap_or_else(PoisonError::into_inner).wind_until_next_frame(frame)?;
                let all =
                    [scaled_wind(wind, stepped.scale)].into_iter().chain(stepped.others.iter().cloned()).collect();
                sum_winds(all)
            }
            (None, field) => field.clone(),
        };
        Ok(self.observed(user, wind.unwrap_or_else(|| Arc::new(UniformWind(Vec3::ZERO)))))
    }

    /// Statistics of a lattice at the frame that was read last, or at the one after it; `None` for analytic winds.
    pub fn lattice_stats(&self, frame: i64) -> Option<LatticeStats> {
        match (&self.stepped, &self.recorded) {
            (Some(stepped), _) => Some(stepped.lattice.lock().unwrap_or_else(PoisonError::into_inner).stats(frame)),
            (None, recorded) => recorded.as_ref().and_then(|recorded| recorded.stats(frame)),
        }
    }

    /// Least height above a surface at which the wind is known, m: half a lattice cell, or `ANALYTIC_KNOWN_HEIGHT`.
    pub fn min_resolved_height(&self) -> f64 {
        self.cell_size.map_or(ANALYTIC_KNOWN_HEIGHT, |width| width / 2.0)
    }

    /// Width of the cells of a lattice wind, m; `None` for analytic winds.
    pub fn cell_size(&self) -> Option<f64> {
        self.cell_size
    }

    /// Predicted bytes of the snapshots recorded for the whole clip; 0 if none are recorded.
    pub fn recorded_bytes(&self) -> u64 {
        self.recorded_bytes
    }

    fn observed(&self, user: WindUser, wind: Arc<dyn Wind>) -> Arc<dyn Wind> {
        match &self.observer {
            Some(observer) => Arc::new(ObservedWind { wind, user, observer: Arc::clone(observer) }),
            None => wind,
        }
    }
}

/// The winds of a recipe that can be sampled at any time without a simulation, each scaled, in the recipe's order.
fn analytic_winds(recipe: &Recipe, land: Option<&Arc<LandForm>>) -> Vec<Arc<dyn Wind>> {
    let all = (0..).zip([&recipe.wind].into_iter().chain(&recipe.added)).filter(|(_, keys)| keys.blows());
    // Duration of the loop, s; analytic winds are made periodic with it.
    let period = recipe.sway.loop_frames(&recipe.clip).map(|n| n as f64 / recipe.clip.fps());
    let wind = |(number, keys): (u64, &WindKeys)| -> Option<Arc<dyn Wind>> {
        let wind: Arc<dyn Wind> = match (keys.model, recipe.lattice.solver) {
            (WindModel::Lattice, WindSolver::Lbm) => return None,
            (WindModel::Lattice, WindSolver::Still) => Arc::new(UniformWind(Vec3::ZERO)),
            (WindModel::Lattice, WindSolver::Analytic) => {
                let inlet: Arc<dyn Wind> = Arc::new(analytic_inlet(recipe, land.cloned()));
                match period {
                    Some(period) => Arc::new(LoopedWind { wind: inlet, period }),
                    None => inlet,
                }
            }
            _ => formula_wind(keys, period, recipe.general.seed, number, land),
        };
        Some(scaled_wind(wind, narrow(keys.scale)))
    };
    all.filter_map(wind).collect()
}

fn scaled_wind(wind: Arc<dyn Wind>, factor: f32) -> Arc<dyn Wind> {
    if (factor - 1.0).abs() > 0.0 { Arc::new(ScaledWind { wind, factor }) } else { wind }
}

/// The sum of the winds; `None` for an empty list.
fn sum_winds(mut winds: Vec<Arc<dyn Wind>>) -> Option<Arc<dyn Wind>> {
    if winds.len() > 1 { Some(Arc::new(WindSum(winds))) } else { winds.pop() }
}

/// A wind that reports all samples to an observer.
#[derive(Debug)]
struct ObservedWind {
    wind: Arc<dyn Wind>,
    user: WindUser,
    observer: Arc<dyn WindObserver>,
}

impl Wind for ObservedWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        self.wind.sample(positions, t, out);
        self.observer.sampled(self.user, positions, t, out);
    }

    fn mean(&self) -> Vec3 {
        self.wind.mean()
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.wind.mean_at(position)
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        self.wind.mean_at_time(position, t)
    }

    fn has_varying_mean(&self) -> bool {
        self.wind.has_varying_mean()
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.wind.prescribed_mean_at_time(t)
    }

    fn period(&self) -> Option<f64> {
        self.wind.period()
    }
}
