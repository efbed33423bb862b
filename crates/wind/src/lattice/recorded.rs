//! The simulated wind of a whole clip, which can be sampled at any time and position.

use std::cell::LazyCell;
use std::sync::Arc;

use glam::Vec3;

use super::super::Wind;
use super::super::tuning::LOOP_FADE;
use super::inlet::InletWind;
use super::report::LatticeStats;
use super::setup::{LatticeOptions, periodic_axes};
use super::snapshot::WindSnapshot;
use super::snapshot_layout::{CellRange, SnapshotLayout};
use super::solver::LatticeSolver;
use super::tuning::MIN_MEAN_SPEED;
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::progress::{Cancel, Progress};

/// Bytes of a recorded velocity: three f32, as in a snapshot.
const BYTES_PER_VELOCITY: u64 = 12;

/// Region and time span of a recording.
#[derive(Debug, Clone, Copy)]
pub struct RecordingOptions {
    /// Region in which the wind will be sampled, m; the whole box if it is empty.
    pub bounds: Bounds,
    /// Frames that are kept before time 0; at most [`LatticeOptions::lead_frames`].
    pub lead: u32,
    /// Number of frames from time 0 on.
    pub frames: usize,
    /// Frame rate of the clip, frames per second.
    pub fps: f64,
    /// Whether the clip loops: the frame after the last is the first.
    pub repeats: bool,
}

impl RecordingOptions {
    /// Number of frames to record before the first frame of a loop of `frames` frames; the loop's end cross-fades into
    /// them.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the frames of two seconds")]
    pub fn loop_lead(frames: usize, fps: f64) -> u32 {
        let fade = (LOOP_FADE * fps).ceil() as u32;
        u32::try_from(frames).map_or(fade, |frames| fade.min(frames))
    }

    /// Number of recorded frames. One more than the clip and its lead, because the last interval needs an end.
    fn frame_count(&self) -> u64 {
        u64::from(self.lead) + self.frames as u64 + 1
    }

    /// Bytes that the recording of a lattice with these options takes.
    pub fn predicted_bytes(&self, lattice: &LatticeOptions) -> u64 {
        let n = lattice.cells.map(|n| n as usize);
        let whole = CellRange::covering(n, lattice.origin(), lattice.spacing, periodic_axes(lattice), self.bounds);
        let values = whole.n.iter().fold(1_u64, |count, n| count.saturating_mul(*n as u64 + 2));
        self.bytes_of(values)
    }

    /// Bytes of the recorded frames and of their mean. `values`: number of velocities per frame.
    fn bytes_of(&self, values: u64) -> u64 {
        (self.frame_count() + 1).saturating_mul(values).saturating_mul(BYTES_PER_VELOCITY)
    }
}

/// A recorded wind: the velocities of the snapshots in every cell of a region, for every frame of a clip and of the time before
/// it.
#[derive(Debug)]
pub struct RecordedWind {
    grid: SnapshotLayout,
    frames: Vec<Vec<[f32; 3]>>,
    /// Mean of the frames from time 0, at the largest speed of the speed curve; empty if the wind turns, so that its wakes move,
    /// or if the mean of the speed curve is near 0.
    mean: Vec<[f32; 3]>,
    /// Statistics of the solver at each frame.
    stats: Vec<LatticeStats>,
    fps: f64,
    /// Number of frames recorded before time 0; a loop's end cross-fades into them.
    lead: usize,
    period: Option<f64>,
    inlet: Arc<InletWind>,
}

impl RecordedWind {
    /// Runs a solver without delivered frames through a clip and stores the velocities of a region.
    /// # Errors
    /// `Limit` if the recording would take more than `wind-bytes`; the errors of [`LatticeSolver::advance`].
    pub fn record(
        lattice: &mut LatticeSolver,
        options: RecordingOptions,
        limits: &Limits,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Self> {
        let (grid, low) = lattice.snapshot_layout().crop(options.bounds);
        let (lead, count) = (options.lead.min(lattice.lead_frames()), options.frame_count());
        let skipped = u64::from(lattice.lead_frames() - lead);
        limits.check("wind-bytes", options.bytes_of(grid.value_count() as u64), "the bytes of the recorded wind")?;
        let (mut frames, mut stats) = (Vec::new(), Vec::new());
        for frame in 0..skipped + count {
            let snapshot = lattice.advance(progress, cancel)?;
            if frame == 0 {
                progress.stage("recording the wind", skipped + count);
            }
            progress.advance(1);
            if frame < skipped {
                continue;
            }
            frames.push(crop_velocities(&snapshot, &grid, low));
            stats.push(lattice.stats());
        }
        let period = options.repeats.then_some(options.frames as f64 / options.fps);
        let (inlet, lead) = (Arc::clone(lattice.inlet()), lead as usize);
        let mean = mean_velocities(frames.get(lead..).unwrap_or_default(), options.fps, &inlet);
        Ok(Self { grid, frames, mean, stats, fps: options.fps, lead, period, inlet })
    }

    /// Bytes of memory of the velocities of all recorded frames and their mean, including their halo.
    pub fn memory_bytes(&self) -> u64 {
        (self.frames.len() * self.grid.value_count() + self.mean.len()) as u64 * BYTES_PER_VELOCITY
    }

    /// Mean velocity of the clip at a position, m, at the largest speed of the speed curve, m/s; `None` if there is no mean.
    fn mean_of_clip(&self, position: Vec3) -> Option<Vec3> {
        let value = |k: usize| self.mean.get(k).copied().map_or(Vec3::ZERO, Vec3::from_array);
        (!self.mean.is_empty()).then(|| self.grid.sample(position, value, || self.inlet.mean_at(position)))
    }

    /// Statistics of the solver at a frame, counted from time 0; those of the first or last recorded frame outside the recording.
    pub fn stats(&self, frame: i64) -> Option<LatticeStats> {
        let index = frame.saturating_add(self.lead as i64).max(0);
        let recorded = usize::try_from(index).ok().and_then(|i| self.stats.get(i));
        recorded.or(self.stats.last()).copied()
    }

    /// Adds `weight` times the velocities at `frame`, a fractional index into the recorded frames: linear in time, trilinear in
    /// space.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the frames")]
    fn add_weighted_sample(&self, positions: &[Vec3], frame: f64, weight: f32, out: &mut [Vec3]) {
        // The recorded frames on either side of the fractional index.
        let last = self.frames.len() - 1;
        let frame = frame.clamp(0.0, last as f64);
        let before = (frame as usize).min(last.saturating_sub(1));
        let fraction = narrow(frame - before as f64);
        let (a, b) = (&self.frames[before], &self.frames[(before + 1).min(last)]);
        // Outside the box use the undisturbed inflow. Its state is computed only if a position needs it.
        let inlet_state = LazyCell::new(|| {
            let t = (frame - self.lead as f64) / self.fps;
            self.inlet.state_at(t, self.inlet.gust_factor(t))
        });
        let value = |k: usize| {
            let (a, b) = (Vec3::from_array(a[k]), Vec3::from_array(b[k]));
            a + (b - a) * fraction
        };
        for (position, u) in positions.iter().zip(out) {
            let outside = || self.inlet.velocity_with_state(position.as_dvec3(), &inlet_state).as_vec3();
            *u += self.grid.sample(*position, value, outside) * weight;
        }
    }
}

/// Mean velocity of each cell divided by the mean factor of the inflow's speed curve. `frames[0]` is at time 0; the cross-fade at
/// the end of a loop is not applied. Empty if the direction of the inflow varies or its mean factor is near 0.
fn mean_velocities(frames: &[Vec<[f32; 3]>], fps: f64, inlet: &InletWind) -> Vec<[f32; 3]> {
    let factors: f64 = (0..frames.len()).map(|k| inlet.speed_factor(k as f64 / fps)).sum();
    let has_mean = !inlet.direction_varies() && factors > MIN_MEAN_SPEED * frames.len() as f64;
    let Some(first) = frames.first().filter(|_| has_mean) else { return Vec::new() };
    let mut mean = vec![[0.0_f32; 3]; first.len()];
    for frame in frames {
        let terms = mean.as_flattened_mut().iter_mut().zip(frame.as_flattened());
        terms.for_each(|(sum, u)| *sum += *u);
    }
    let share = narrow(factors.recip());
    mean.as_flattened_mut().iter_mut().for_each(|sum| *sum *= share);
    mean
}

/// Velocities of a snapshot for a cropped grid that begins at the cell `low`.
fn crop_velocities(snapshot: &WindSnapshot, part: &SnapshotLayout, low: [usize; 3]) -> Vec<[f32; 3]> {
    let values = (0..part.value_count()).map(|k| snapshot.values[snapshot.grid.index_in_uncropped(part, low, k)]);
    values.map(|[x, y, z, _]| [x, y, z]).collect()
}

impl Wind for RecordedWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        out.fill(Vec3::ZERO);
        let lead = self.lead as f64;
        let Some(period) = self.period else {
            self.add_weighted_sample(positions, t * self.fps + lead, 1.0, out);
            return;
        };
        // Time within the loop, in frames after the first; the recording starts `lead` frames earlier.
        let frame = t.rem_euclid(period) * self.fps;
        let frames = period * self.fps;
        // Loop: in the last `lead` frames, cross-fade into the frames recorded before the first one.
        let fade = narrow(((frame - (frames - lead)) / lead.max(1.0)).clamp(0.0, 1.0));
        self.add_weighted_sample(positions, frame + lead, 1.0 - fade, out);
        if fade > 0.0 {
            self.add_weighted_sample(positions, frame + lead - frames, fade, out);
        }
    }

    fn mean(&self) -> Vec3 {
        self.inlet.mean()
    }

    /// Mean of the recorded clip: in the wake of a wall the air is slower than in the inflow, or flows backwards.
    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.mean_of_clip(position).unwrap_or_else(|| self.inlet.mean_at(position))
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        match self.mean_of_clip(position) {
            Some(mean) => mean * narrow(self.inlet.speed_factor(t)),
            None => self.inlet.mean_at_time(position, t),
        }
    }

    fn has_varying_mean(&self) -> bool {
        self.inlet.has_varying_mean()
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.inlet.prescribed_mean_at_time(t)
    }

    fn period(&self) -> Option<f64> {
        self.period
    }
}
