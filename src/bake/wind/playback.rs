//! The wind of a flight, one frame after another: a lattice goes on as the flight does, and only two of its snapshots are
//! kept; any other wind is asked at its own time.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::cache::wind_spin_up;
use crate::bake::wind::lattice::{lattice_options, report_notes};
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

/// Height above a surface at which a wind by formula is known, m.
const KNOWN_HEIGHT: f64 = 0.5;

/// Wind from a flight's first frame on.
#[derive(Debug)]
pub struct WindPlayback {
    /// Winds by formula.
    others: Option<Arc<dyn Wind>>,
    /// Time between the flight's start and the clip's, s: formulas count from the clip's.
    before: f64,
    source: Option<LatticeConfig>,
    flow: Option<LatticeState>,
}

/// What a lattice is made of, to begin again.
#[derive(Debug)]
struct LatticeConfig {
    options: LatticeOptions,
    solids: Vec<Solid>,
    limits: Limits,
    cancel: Cancel,
    cache: Option<BakeCache>,
    scale: f32,
}

/// A lattice that runs.
#[derive(Debug)]
struct LatticeState {
    lattice: LatticeSolver,
    before: Arc<WindSnapshot>,
    after: Arc<WindSnapshot>,
    frame: u64,
}

impl LatticeConfig {
    fn begin(&self, progress: &dyn Progress) -> Result<LatticeState> {
        let context = BakeContext { limits: &self.limits, cancel: &self.cancel, progress, cache: self.cache.as_ref() };
        let mut lattice = wind_spin_up::load_or_spin_up(&self.options, &self.solids, &context)?;
        let before = lattice.advance(progress, &self.cancel)?;
        let after = lattice.advance(progress, &self.cancel)?;
        Ok(LatticeState { lattice, before, after, frame: 0 })
    }

    /// The wind from a frame to the next.
    fn during(&self, flow: &mut LatticeState, frame: u64, fps: f64) -> Result<Arc<dyn Wind>> {
        if frame < flow.frame {
            *flow = self.begin(&Silent)?;
        }
        while flow.frame < frame {
            let next = flow.lattice.advance(&Silent, &self.cancel)?;
            flow.before = std::mem::replace(&mut flow.after, next);
            flow.frame += 1;
        }
        let wind = Arc::new(InterpolatedWind {
            before: Arc::clone(&flow.before),
            after: Arc::clone(&flow.after),
            t0: frame as f64 / fps,
            t1: (frame + 1) as f64 / fps,
        });
        Ok(Arc::new(ScaledWind { wind, factor: self.scale }))
    }
}

impl WindPlayback {
    /// The wind of a recipe's flight, which starts `before` s before the clip. `solids`: what a lattice flows around.
    pub fn new(recipe: &Recipe, solids: &[Solid], before: f64, context: &BakeContext<'_>) -> Self {
        let lattice = recipe.wind.model == WindModel::Lattice && recipe.lattice.solver == WindSolver::Lbm;
        let mut options = lattice_options(recipe);
        // Curves count from the clip's start, a lattice from its own.
        let inlet = &mut options.inlet;
        inlet.speed_curve.iter_mut().chain(&mut inlet.direction_curve).for_each(|row| row[0] += before);
        let source = (lattice && recipe.wind.blows()).then(|| LatticeConfig {
            options,
            solids: solids.to_vec(),
            limits: context.limits.clone(),
            cancel: context.cancel.clone(),
            cache: context.cache.cloned(),
            scale: narrow(recipe.wind.scale),
        });
        Self { others: plant_wind::analytic_winds(recipe), before, source, flow: None }
    }

    /// Lets a lattice run up; whatever it says of itself goes into `report`.
    /// # Errors
    /// Those of [`LatticeSolver::new`] and [`LatticeSolver::advance`].
    pub fn spin_up(&mut self, progress: &dyn Progress, report: &mut Report) -> Result<()> {
        if let Some(source) = &self.source {
            let flow = source.begin(progress)?;
            report_notes(&flow.lattice, report);
            self.flow = Some(flow);
        }
        Ok(())
    }

    /// Least height above a surface at which the wind is known, m.
    pub fn known_height(&self) -> f64 {
        self.source.as_ref().map_or(KNOWN_HEIGHT, |s| s.options.spacing / 2.0)
    }

    /// Width of the cells of a lattice wind, m.
    pub fn cell(&self) -> Option<f64> {
        self.source.as_ref().map(|s| s.options.spacing)
    }

    /// How a lattice wind did until now.
    pub fn health(&self) -> Option<LatticeStats> {
        self.flow.as_ref().map(|f| f.lattice.stats())
    }

    /// The wind between a frame of the flight and the next.
    /// # Errors
    /// Those of [`LatticeSolver::advance`].
    pub fn during(&mut self, frame: u64, fps: f64) -> Result<Arc<dyn Wind>> {
        let mut all: Vec<Arc<dyn Wind>> = Vec::new();
        if let Some(source) = &self.source {
            if self.flow.is_none() {
                self.flow = Some(source.begin(&Silent)?);
            }
            if let Some(flow) = &mut self.flow {
                all.push(source.during(flow, frame, fps)?);
            }
        }
        if let Some(wind) = &self.others {
            all.push(Arc::new(DelayedWind { wind: Arc::clone(wind), before: self.before }));
        }
        Ok(if all.len() == 1 { all.remove(0) } else { Arc::new(WindSum(all)) })
    }
}

/// A wind whose time starts later.
#[derive(Debug)]
struct DelayedWind {
    wind: Arc<dyn Wind>,
    before: f64,
}

impl Wind for DelayedWind {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        self.wind.sample(places, t - self.before, out);
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
