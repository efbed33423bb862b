//! The wind of a clip, frame by frame.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::Vec3;

use super::collide::{self, FASTEST};
use super::domain::{Cells, Face};
use super::flow::Flow;
use super::grid::{Grid, Parity};
use super::inlet::{Blowing, InletWind, Mouth, ramp};
use super::memory_estimate::LatticeMemory;
use super::outlet_targets::{Doors, mouth, uneven};
use super::setup::{LatticeOptions, Plan, faces, most_open};
use super::snapshot::{DENSITY, Field, Pages, Reading, WindSnapshot};
use super::stepper::{Asked, Viscosity};
use super::voxelize::{judge, mark, middle};
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::par;
use osier_base::progress::{Cancel, Progress};
use osier_base::{Error, Result};
use osier_scene::solid::Solid;

/// Steps between two looks at every cell.
const LOOK: u64 = 64;
/// Snapshots whose memory is waited for: the two between which others are, and the next.
const PAST: usize = 3;
/// Share of cells that may be clamped in a step.
const CLAMPED: f64 = 0.01;
/// Bytes of a checkpoint before its numbers.
const HEAD: usize = 24;
/// Checkered density, beyond which the two sublattices have come apart.
const CHECKERED: f64 = 1e-3;

/// Something that is not wrong but should be known; `code` is one of the table of codes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LatticeWarning {
    /// Stable code.
    pub code: &'static str,
    /// Subject, fact, next step.
    pub text: String,
}

/// How a lattice wind did, for reports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatticeStats {
    /// Steps done.
    pub steps: u64,
    /// Fluid cells that were clamped, over all steps.
    pub clamped_cells: u64,
    /// Strongest checkered density seen.
    pub peak_checkerboard: f64,
    /// Checkered density at the last look.
    pub checkerboard: f64,
    /// Mean of the density less 1, in the last snapshot.
    pub density_error: f64,
}

/// Wind on a lattice: air flows through the box, round what stands there, and gives a snapshot for every frame.
///
/// The run-up before the first frame begins from rest; it happens in the first call of [`LatticeSolver::advance`].
#[derive(Debug)]
pub struct LatticeSolver {
    pub(super) plan: Plan,
    pub(super) flow: Flow,
    inlet: Arc<InletWind>,
    mouth: Mouth,
    pub(super) field: Arc<Field>,
    /// What comes in in the next step, and in the one after.
    wind: [[Vec<f32>; 3]; 2],
    doors: Doors,
    /// What faces follow from, if they change.
    turning: Option<LatticeOptions>,
    pub(super) warnings: Vec<LatticeWarning>,
    /// By height: what the profile has more than its mean, cells a step, and how it leans, both along the wind.
    uneven: Vec<[f64; 2]>,
    fluid: usize,
    pub(super) stats: LatticeStats,
    frames: u64,
    /// The last snapshots, whose memory is taken again.
    past: VecDeque<Arc<WindSnapshot>>,
}

impl LatticeSolver {
    /// What [`LatticeSolver::new`] says of options, without the cells.
    /// # Errors
    /// As [`LatticeSolver::new`].
    pub fn check_options(options: &LatticeOptions, limits: &Limits) -> Result<Vec<LatticeWarning>> {
        let (plan, notes) = Plan::of(options)?;
        limits.check("cells", plan.cells(), "the cells of the wind's lattice")?;
        LatticeMemory::estimate(options).check(options, limits)?;
        Ok(notes)
    }

    /// Plans everything and makes the cells; nothing flows yet. `solids`: what stands in the wind.
    /// # Errors
    /// `Range` for options that do not go together; `Limit` for too many cells; `Io` if the system has no memory.
    pub fn new(options: &LatticeOptions, solids: &[Solid], limits: &Limits) -> Result<Self> {
        let (mut plan, mut notes) = Plan::of(options)?;
        limits.check("cells", plan.cells(), "the cells of the wind's lattice")?;
        LatticeMemory::estimate(options).check(options, limits)?;
        let n = plan.n;
        if Grid::bytes(n) / 60 > u64::from(u32::MAX) {
            let (wanted, limit) = ("more than 4,294,967,295 places".into(), "that".into());
            let flag = "a larger dx".into();
            return Err(Error::Limit { name: "an array of the wind's lattice".into(), wanted, limit, flag });
        }
        let grid = Grid::new(n);
        let space = (plan.origin, options.spacing);
        let roles = faces(options, 0.0);
        let mut cells = Cells { grid, faces: most_open(options), solid: mark(&grid, space, solids) };
        let found = judge(&mut cells, solids, space, plan.along);
        cells.faces = roles;
        notes.extend(found.notes());
        plan.tell_apart(&cells.solid);
        let fluid = grid.cells() - found.solid;
        if fluid == 0 {
            return Err(still_box());
        }
        let tau = narrow(plan.tau);
        let (sponge, surface) = (plan.sponge(roles), plan.surface.clone());
        let viscosity = Viscosity {
            tau,
            eddies: narrow(collide::eddies(options.smagorinsky)),
            sponge,
            ground: surface,
            force: [0.0; 3],
        };
        let periodic = [0, 2, 4].map(|f| roles[f] == Face::Periodic);
        let inlet = InletWind::new(options.inlet.clone(), plan.origin, options.spacing, options.cells, periodic);
        let inlet = Arc::new(inlet);
        let field = Arc::new(Field::new(&cells, space, Arc::clone(&inlet)));
        let flow = Flow::new(cells, viscosity, options.outlet_nonequilibrium)?;
        let (mouth, doors) = (mouth(&flow, &inlet, &plan), Doors::of(&flow, &inlet, &plan));
        let uneven = uneven(&inlet, &plan);
        let stats =
            LatticeStats { steps: 0, clamped_cells: 0, peak_checkerboard: 0.0, checkerboard: 0.0, density_error: 0.0 };
        Ok(Self {
            plan,
            flow,
            inlet,
            mouth,
            field,
            wind: [const { [const { Vec::new() }; 3] }; 2],
            doors,
            turning: (!options.inlet.direction_curve.is_empty()).then(|| options.clone()),
            warnings: notes,
            uneven,
            fluid,
            stats,
            frames: 0,
            past: VecDeque::new(),
        })
    }

    /// The wind that comes in.
    pub fn inlet(&self) -> &Arc<InletWind> {
        &self.inlet
    }

    pub(super) fn field(&self) -> &Field {
        &self.field
    }

    /// What should be known so far.
    pub fn warnings(&self) -> &[LatticeWarning] {
        &self.warnings
    }

    /// How it did so far.
    pub fn stats(&self) -> LatticeStats {
        self.stats
    }

    /// Steps before the first frame.
    pub fn spin_up_steps(&self) -> u64 {
        self.plan.run_up
    }

    /// Steps a frame.
    pub fn steps_per_frame(&self) -> u32 {
        self.plan.steps
    }

    /// Kinematic viscosity the air has in effect, m^2/s.
    pub fn effective_viscosity(&self) -> f64 {
        self.plan.viscosity()
    }

    /// Runs up until just before the first frame, whose last steps write it down; nothing to do if it is there already.
    /// # Errors
    /// As [`LatticeSolver::advance`].
    pub fn spin_up(&mut self, progress: &dyn Progress, cancel: &Cancel) -> Result<()> {
        let until = self.plan.run_up.saturating_sub(1) & !1;
        if self.flow.step < until {
            progress.stage("wind", self.plan.run_up);
        }
        par::among(|| {
            while self.flow.step < until {
                cancel.check()?;
                let steps = self.step(until - self.flow.step, None)?;
                progress.advance(steps);
            }
            Ok(())
        })
    }

    /// The next frame's wind. The first call runs up first, telling `progress`; times are counted from the first frame.
    /// # Errors
    /// `Simulation` when the flow leaves its bounds, `Cancelled` when asked to stop.
    pub fn advance(&mut self, progress: &dyn Progress, cancel: &Cancel) -> Result<Arc<WindSnapshot>> {
        let mut values = self.room();
        // Among the threads all the time: else every step would call them anew.
        par::among(|| self.run(&mut values, progress, cancel))?;
        let time = self.frames as f64 / self.plan.fps;
        self.frames += 1;
        let snapshot = Arc::new(WindSnapshot { field: Arc::clone(&self.field), values, time });
        self.past.push_back(Arc::clone(&snapshot));
        Ok(snapshot)
    }

    /// Memory for a snapshot: that of one before which nobody has any more, for fresh memory takes as long as a step.
    fn room(&mut self) -> Vec<[f32; 4]> {
        let free = self.past.iter().position(|old| Arc::strong_count(old) == 1);
        if let Some(old) = free.and_then(|k| self.past.remove(k)).and_then(|old| Arc::try_unwrap(old).ok()) {
            return old.values;
        }
        // Who holds more than that keeps them.
        while self.past.len() >= PAST {
            self.past.pop_front();
        }
        vec![[0.0; 4]; self.field.count()]
    }

    /// Runs to the next frame and writes its snapshot.
    fn run(&mut self, values: &mut [[f32; 4]], progress: &dyn Progress, cancel: &Cancel) -> Result<()> {
        let until = self.plan.run_up + self.frames * u64::from(self.plan.steps);
        if self.frames == 0 && self.flow.step == 0 {
            progress.stage("wind", until);
        }
        self.turn(self.frames);
        let field = Arc::clone(&self.field);
        let speed = narrow(self.plan.speed());
        if self.flow.step == until {
            let reading = self.flow.write(Pages { field: &field, speed, values });
            self.judge(&reading)?;
        }
        while self.flow.step < until {
            cancel.check()?;
            let left = until - self.flow.step;
            let last = left == 1 || left == 2 && Parity::of(self.flow.step) == Parity::Even;
            let pages = last.then(|| Pages { field: &field, speed, values: &mut *values });
            let steps = self.step(left, pages)?;
            if self.frames == 0 {
                progress.advance(steps);
            }
        }
        field.surround(values);
        Ok(())
    }

    /// One step, or two at once if as many are left and the first is even. Returns how many.
    fn step(&mut self, left: u64, pages: Option<Pages<'_>>) -> Result<u64> {
        let two = left >= 2 && Parity::of(self.flow.step) == Parity::Even;
        let now = self.blow(0);
        let now = [now, if two { self.blow(1) } else { now }];
        let [first, second] = [0, 1].map(|k| Asked {
            wind: &self.wind[k],
            lean: self.mouth.lean(now[k]),
            wanted: self.doors.wanted(self.flow.cells.faces, now[k]),
        });
        let (before, written) = (self.flow.step, pages.is_some());
        let (clamped, reading) = self.flow.go((first, two.then_some(second)), pages);
        self.stats.steps = self.flow.step;
        self.raise(before);
        for (step, count) in (before + 1..).zip(clamped) {
            if count > 0 {
                self.clamped(step, count)?;
            }
        }
        if written {
            self.judge(&reading)?;
        } else if before / LOOK < self.flow.step / LOOK {
            let reading = self.flow.read();
            self.judge(&reading)?;
        }
        Ok(self.flow.step - before)
    }

    /// While the wind sets in, gives the air its profile. Pressure alone would make all heights equally fast, and the lowest
    /// air would take as long as it needs from end to end to be as slow as it should.
    fn raise(&mut self, before: u64) {
        let risen = ramp(self.flow.step) - ramp(before);
        if risen > 0.0 {
            let t = self.time_of(before);
            let (d, strength) = (self.inlet.direction(t), self.inlet.strength(t) * risen);
            let level = |u: f64| [d.x, d.z].map(|d| narrow(u * d * strength));
            let by: Vec<_> = self.uneven.iter().map(|by| by.map(level)).collect();
            self.flow.push(&by);
        }
    }

    /// Time of a step, s: steps are counted from rest, times from the first frame.
    fn time_of(&self, step: u64) -> f64 {
        (step as f64 - self.plan.run_up as f64) * self.plan.dt
    }

    /// Finds what comes in some steps from now.
    fn blow(&mut self, ahead: usize) -> Blowing {
        let step = self.flow.step + ahead as u64;
        let now = self.mouth.blowing(&self.inlet, self.time_of(step), ramp(step));
        self.mouth.blow(&self.inlet, now, self.flow.sweep.arch, &mut self.wind[ahead]);
        now
    }

    /// Gives the faces the roles they have on the way to a frame.
    fn turn(&mut self, frame: u64) {
        let Some(options) = &self.turning else { return };
        let roles = faces(options, ((frame as f64 - 0.5) / self.plan.fps).max(0.0));
        if roles != self.flow.cells.faces {
            self.flow.open(roles, self.plan.sponge(roles));
            self.mouth = mouth(&self.flow, &self.inlet, &self.plan);
            self.doors = Doors::of(&self.flow, &self.inlet, &self.plan);
        }
    }

    #[cold]
    fn clamped(&mut self, step: u64, count: u64) -> Result<()> {
        let speed = FASTEST * self.plan.speed();
        if self.stats.clamped_cells == 0 {
            let text = format!(
                "the lattice wind was faster than {speed:.1} m/s in {count} cells at step {step} and was held there; \
                 lower wind.speed, or set wind.lattice.steps to more than {}",
                self.plan.steps
            );
            self.warnings.push(LatticeWarning { code: "S022", text });
        }
        self.stats.clamped_cells += count;
        if count as f64 > CLAMPED * self.fluid as f64 {
            return Err(self.blown(format!("more than {speed:.1} m/s in {count} cells")));
        }
        Ok(())
    }

    /// Judges what a look at every cell has found.
    fn judge(&mut self, reading: &Reading) -> Result<()> {
        let wild = reading.planes.iter().enumerate().find_map(|(z, p)| p.wild.map(|[x, y]| [x, y, z]));
        if let Some(cell) = wild {
            let (drho, u) = self.flow.at(cell);
            let at = middle(self.plan.origin, self.plan.spacing, cell);
            let u = Vec3::from_array(u) * narrow(self.plan.speed());
            return Err(self.blown(format!(
                "density {:.3} (allowed {} to {}) and velocity ({:.2}, {:.2}, {:.2}) m/s in cell ({}, {}, {}) at ({:.2}, \
                 {:.2}, {:.2}) m",
                1.0 + drho, DENSITY[0], DENSITY[1], u.x, u.y, u.z, cell[0], cell[1], cell[2], at.x, at.y, at.z
            )));
        }
        let sum = |f: &dyn Fn(&super::snapshot::Plane) -> f64| reading.planes.iter().map(f).sum::<f64>();
        self.stats.density_error = sum(&|p| p.mass) / self.fluid as f64;
        let checkered = (sum(&|p| p.checkered) / self.fluid as f64).abs();
        if checkered > CHECKERED && self.stats.peak_checkerboard <= CHECKERED {
            let text = format!(
                "the lattice wind has come apart into a checkerboard of density {checkered:.1e} at step {}; raise \
                 wind.lattice.tau_floor",
                self.flow.step
            );
            self.warnings.push(LatticeWarning { code: "S023", text });
        }
        self.stats.peak_checkerboard = self.stats.peak_checkerboard.max(checkered);
        self.stats.checkerboard = checkered;
        Ok(())
    }

    fn blown(&self, what: String) -> Error {
        let quantity = format!(
            "S024: the lattice wind at step {}, {what}; raise wind.lattice.tau_floor or wind.lattice.steps (now {}), or \
             lower wind.speed: it",
            self.flow.step, self.plan.steps
        );
        Error::Simulation { frame: u32::try_from(self.frames).unwrap_or(u32::MAX), quantity }
    }

    /// All that the flow is, to go on from later: steps, frames, the air before open faces, then every population.
    pub fn checkpoint(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        bytes.extend(self.plan.key().to_le_bytes());
        bytes.extend(self.flow.step.to_le_bytes());
        bytes.extend(self.frames.to_le_bytes());
        self.flow.links.kept().for_each(|value| bytes.extend(value.to_le_bytes()));
        for array in self.flow.populations.arrays() {
            array.iter().for_each(|g| bytes.extend(g.to_le_bytes()));
        }
        bytes
    }

    /// Goes on from a checkpoint of a lattice with the same options, seed and solids, with the bytes of one that never
    /// stopped.
    /// # Errors
    /// `Simulation` if the bytes are of another lattice.
    pub fn resume(&mut self, bytes: &[u8]) -> Result<()> {
        let other = || {
            let quantity = "S025: the checkpoint is of another lattice wind; run it from the start: it".into();
            Error::Simulation { frame: 0, quantity }
        };
        let (head, body) = bytes.split_at_checked(HEAD).ok_or_else(other)?;
        let word = |k: usize| head[8 * k..].first_chunk::<8>().map_or(0, |b| u64::from_le_bytes(*b));
        self.turn(word(2).saturating_sub(1));
        let elements: usize = self.flow.populations.arrays().iter().map(|a| a.len()).sum();
        let kept = self.flow.links.kept().count();
        if word(0) != self.plan.key() || body.len() != 4 * (elements + kept) {
            return Err(other());
        }
        (self.flow.step, self.frames) = (word(1), word(2));
        let (kept, numbers) = body.split_at(4 * kept);
        let mut numbers = numbers.as_chunks::<4>().0.iter();
        for array in self.flow.populations.arrays_mut() {
            array.iter_mut().zip(&mut numbers).for_each(|(g, b)| *g = f32::from_le_bytes(*b));
        }
        self.flow.links.renew(&self.flow.populations, Parity::of(self.flow.step));
        let kept = kept.as_chunks::<4>().0;
        self.flow.links.kept_mut().zip(kept).for_each(|(value, b)| *value = f32::from_le_bytes(*b));
        Ok(())
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> u64 {
        Grid::bytes(self.plan.n) + self.flow.links.bytes() as u64 + 3 * self.flow.cells.solid.len() as u64
    }
}

fn still_box() -> Error {
    Error::Simulation {
        frame: 0,
        quantity: "S024: the lattice wind, whose cells are all solid; move or widen it: it".into(),
    }
}
