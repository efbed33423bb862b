//! The wind of a flight, frame by frame: a lattice is stepped along with the flight, with two snapshots in memory; analytic winds
//! are sampled at the time of the clip.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::cache::wind_spin_up;
use crate::bake::wind::lattice::{lattice_options, report_warnings};
use crate::bake::wind::plant_wind;
use crate::recipe::Recipe;
use crate::recipe::scene::{WindModel, WindSolver};
use osier_base::Result;
use osier_base::diagnostic::Report;
use osier_base::files::BakeCache;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::progress::{Cancel, Progress, Silent};
use osier_scene::solid::Solid;
use osier_wind::{
    InterpolatedWind, LatticeOptions, LatticeSolver, LatticeStats, ScaledWind, Wind, WindSnapshot, WindSum,
};

/// Least height above a surface at which an analytic wind is sampled, m; below it a flight scales the wind down to the surface. Own:
/// a cell of the default lattice.
const ANALYTIC_KNOWN_HEIGHT: f64 = 0.5;

/// Wind from a flight's first frame on.
#[derive(Debug)]
pub struct WindPlayback {
    /// Sum of the analytic winds.
    analytic: Option<Arc<dyn Wind>>,
    /// Time from the flight's start to the clip's, s. Analytic winds count time from the clip's start.
    lead: f64,
    config: Option<LatticeConfig>,
    /// `None` until the spin-up.
    lattice: Option<LatticeState>,
}

/// Everything that a lattice is built from, so that it can be started again.
#[derive(Debug)]
struct LatticeConfig {
    options: LatticeOptions,
    solids: Vec<Solid>,
    limits: Limits,
    cancel: Cancel,
    cache: Option<BakeCache>,
    scale: f32,
}

/// A running lattice, between two frames.
#[derive(Debug)]
struct LatticeState {
    solver: LatticeSolver,
    before: Arc<WindSnapshot>,
    after: Arc<WindSnapshot>,
    /// Frame of `before`, counted from the flight's start.
    frame: u64,
}

impl LatticeConfig {
    /// Builds the lattice, spins it up and computes the snapshots of the first two frames.
    fn start(&self, progress: &dyn Progress) -> Result<LatticeState> {
        let context = BakeContext { limits: &self.limits, cancel: &self.cancel, progress, cache: self.cache.as_ref() };
        let mut solver = wind_spin_up::load_or_spin_up(&self.options, &self.solids, &context)?;
        let before = solver.advance(progress, &self.cancel)?;
        let after = solver.advance(progress, &self.cancel)?;
        Ok(LatticeState { solver, before, after, frame: 0 })
    }

    /// Steps to `frame` and interpolates between its snapshot and the next. An earlier frame starts the lattice again.
    fn wind_between(&self, state: &mut LatticeState, frame: u64, fps: f64) -> Result<Arc<dyn Wind>> {
        if frame < state.frame {
            *state = self.start(&Silent)?;
        }
        while state.frame < frame {
            let next = state.solver.advance(&Silent, &self.cancel)?;
            state.before = std::mem::replace(&mut state.after, next);
            state.frame += 1;
        }
        let wind = Arc::new(InterpolatedWind {
            before: Arc::clone(&state.before),
            after: Arc::clone(&state.after),
            t0: frame as f64 / fps,
            t1: (frame + 1) as f64 / fps,
        });
        Ok(Arc::new(ScaledWind { wind, factor: self.scale }))
    }
}

impl WindPlayback {
    /// The wind of a recipe's flight, which starts `lead` s before the clip. `solids`: obstacles of a lattice.
    pub fn new(recipe: &Recipe, solids: &[Solid], lead: f64, context: &BakeContext<'_>) -> Self {
        let lattice = recipe.wind.model == WindModel::Lattice && recipe.lattice.solver == WindSolver::Lbm;
        let mut options = lattice_options(recipe);
        // The keys' curves count time from the clip's start, the lattice from its own: shift the curves.
        let inlet = &mut options.inlet;
        inlet.speed_curve.iter_mut().chain(&mut inlet.direction_curve).for_each(|row| row[0] += lead);
        let config = (lattice && recipe.wind.blows()).then(|| LatticeConfig {
            options,
            solids: solids.to_vec(),
            limits: context.limits.clone(),
            cancel: context.cancel.clone(),
            cache: context.cache.cloned(),
            scale: narrow(recipe.wind.scale),
        });
        Self { analytic: plant_wind::analytic_winds(recipe), lead, config, lattice: None }
    }

    /// Spins up a lattice, loaded from the cache if there is one; adds its warnings to `report`.
    /// # Errors
    /// Those of [`LatticeSolver::new`] and [`LatticeSolver::advance`].
    pub fn spin_up(&mut self, progress: &dyn Progress, report: &mut Report) -> Result<()> {
        if let Some(config) = &self.config {
            let state = config.start(progress)?;
            report_warnings(&state.solver, report);
            self.lattice = Some(state);
        }
        Ok(())
    }

    /// Least height above a surface at which the wind is known, m: half a lattice cell, or `ANALYTIC_KNOWN_HEIGHT`.
    pub fn known_height(&self) -> f64 {
        self.config.as_ref().map_or(ANALYTIC_KNOWN_HEIGHT, |s| s.options.spacing / 2.0)
    }

    /// Width of the cells of a lattice wind, m; `None` for analytic winds.
    pub fn cell_size(&self) -> Option<f64> {
        self.config.as_ref().map(|s| s.options.spacing)
    }

    /// Statistics of a lattice wind so far; `None` for analytic winds.
    pub fn lattice_stats(&self) -> Option<LatticeStats> {
        self.lattice.as_ref().map(|l| l.solver.stats())
    }

    /// The wind between `frame` and the next, counted from the flight's start.
    /// # Errors
    /// Those of [`LatticeSolver::advance`].
    pub fn wind_between(&mut self, frame: u64, fps: f64) -> Result<Arc<dyn Wind>> {
        let mut winds: Vec<Arc<dyn Wind>> = Vec::new();
        if let Some(config) = &self.config {
            if self.lattice.is_none() {
                self.lattice = Some(config.start(&Silent)?);
            }
            if let Some(state) = &mut self.lattice {
                winds.push(config.wind_between(state, frame, fps)?);
            }
        }
        if let Some(wind) = &self.analytic {
            winds.push(Arc::new(DelayedWind { wind: Arc::clone(wind), delay: self.lead }));
        }
        Ok(if winds.len() == 1 { winds.remove(0) } else { Arc::new(WindSum(winds)) })
    }
}

/// A wind whose time 0 comes `delay` s later.
#[derive(Debug)]
struct DelayedWind {
    wind: Arc<dyn Wind>,
    delay: f64,
}

impl Wind for DelayedWind {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        self.wind.sample(places, t - self.delay, out);
    }

    fn mean(&self) -> Vec3 {
        self.wind.mean()
    }

    fn mean_at(&self, height: f32) -> Vec3 {
        self.wind.mean_at(height)
    }

    fn period(&self) -> Option<f64> {
        self.wind.period()
    }
}
