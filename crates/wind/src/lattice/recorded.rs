//! The simulated wind of a whole clip, which can be sampled at any time and position.

use std::sync::Arc;

use glam::Vec3;
use half::f16;

use super::super::Wind;
use super::inlet::InletWind;
use super::snapshot::WindSnapshot;
use super::snapshot_grid::SnapshotGrid;
use super::solver::LatticeSolver;
use super::tuning::{LOOP_FADE, RECORDING_MARGIN};
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::progress::{Cancel, Progress};

/// Region and time span of a recording.
#[derive(Debug, Clone, Copy)]
pub struct RecordingOptions {
    /// Region in which the wind will be sampled, m.
    pub bounds: Bounds,
    /// Number of frames in the clip.
    pub frames: usize,
    /// Frame rate of the clip, frames per second.
    pub fps: f64,
    /// Whether the clip loops: the frame after the last is the first.
    pub repeats: bool,
}

/// A recorded wind: velocities in half precision at every cell of a region, for every frame of a clip.
#[derive(Debug)]
pub struct RecordedWind {
    grid: SnapshotGrid,
    frames: Vec<Vec<[f16; 3]>>,
    fps: f64,
    /// Frames recorded before the first of a loop, for the cross-fade at its end.
    lead: usize,
    period: Option<f64>,
    inlet: Arc<InletWind>,
}

impl RecordedWind {
    /// Runs a solver that has done no step through a clip and keeps the velocities of a region.
    /// # Errors
    /// `Limit` if the recording would take more than `wind-bytes`; those of [`LatticeSolver::advance`].
    pub fn record(
        lattice: &mut LatticeSolver,
        options: RecordingOptions,
        limits: &Limits,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Self> {
        let (grid, low) = lattice.snapshot_grid().crop(options.bounds, RECORDING_MARGIN);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the frames of two seconds")]
        let lead = if options.repeats { ((LOOP_FADE * options.fps).ceil() as usize).min(options.frames) } else { 0 };
        // One frame more than the clip: the last one is the end of the last interval.
        let count = lead + options.frames + 1;
        limits.check("wind-bytes", (count * grid.value_count() * 6) as u64, "the bytes of the recorded wind")?;
        let mut frames = Vec::with_capacity(count);
        for frame in 0..count {
            let snapshot = lattice.advance(progress, cancel)?;
            if frame == 0 {
                progress.stage("recording the wind", count as u64);
            }
            progress.advance(1);
            frames.push(crop_to_half_precision(&snapshot, &grid, low));
        }
        let period = options.repeats.then_some(options.frames as f64 / options.fps);
        let inlet = Arc::clone(lattice.inlet());
        Ok(Self { grid, frames, fps: options.fps, lead, period, inlet })
    }

    /// Bytes of memory that the velocities take.
    pub fn bytes(&self) -> u64 {
        (self.frames.len() * self.grid.value_count() * 6) as u64
    }

    /// Adds `weight` times the velocities at `frame`, a fractional index into the recorded frames: linear in time, trilinear in
    /// space.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the frames")]
    fn add_weighted_frame(&self, positions: &[Vec3], frame: f64, weight: f32, out: &mut [Vec3]) {
        // The recorded frames on either side of the fractional index.
        let last = self.frames.len() - 1;
        let frame = frame.clamp(0.0, last as f64);
        let before = (frame as usize).min(last.saturating_sub(1));
        let fraction = narrow(frame - before as f64);
        let (a, b) = (&self.frames[before], &self.frames[(before + 1).min(last)]);
        // Outside the recorded region the undisturbed inflow blows.
        let t = frame / self.fps;
        let inlet_state = self.inlet.state_at(t, self.inlet.gust_factor(t));
        let value = |k: usize| {
            let (a, b) = (vec3_from_f16(a[k]), vec3_from_f16(b[k]));
            a + (b - a) * fraction
        };
        for (position, u) in positions.iter().zip(out) {
            let outside = || self.inlet.velocity_with_state(position.as_dvec3(), &inlet_state).as_vec3();
            *u += self.grid.sample(*position, value, outside) * weight;
        }
    }
}

/// From half to single precision.
fn vec3_from_f16(v: [f16; 3]) -> Vec3 {
    Vec3::new(v[0].to_f32(), v[1].to_f32(), v[2].to_f32())
}

/// Velocities of a snapshot at the values of a cropped grid that begins at the cell `low`.
fn crop_to_half_precision(snapshot: &WindSnapshot, part: &SnapshotGrid, low: [usize; 3]) -> Vec<[f16; 3]> {
    let values = (0..part.value_count()).map(|k| snapshot.values[snapshot.grid.index_in_uncropped(part, low, k)]);
    values.map(|[x, y, z, _]| [x, y, z].map(f16::from_f32)).collect()
}

impl Wind for RecordedWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        out.fill(Vec3::ZERO);
        let lead = self.lead as f64;
        let Some(period) = self.period else {
            self.add_weighted_frame(positions, t * self.fps, 1.0, out);
            return;
        };
        // Time within the loop, in frames after the first; the recording starts `lead` frames earlier.
        let frame = t.rem_euclid(period) * self.fps;
        let frames = period * self.fps;
        // Loop: in the last `lead` frames, cross-fade into the frames recorded before the first, which lead up to it.
        let fade = narrow(((frame - (frames - lead)) / lead.max(1.0)).clamp(0.0, 1.0));
        self.add_weighted_frame(positions, frame + lead, 1.0 - fade, out);
        if fade > 0.0 {
            self.add_weighted_frame(positions, frame + lead - frames, fade, out);
        }
    }

    fn mean(&self) -> Vec3 {
        self.inlet.mean()
    }

    fn mean_at(&self, height: f32) -> Vec3 {
        self.inlet.mean_at(height)
    }

    fn period(&self) -> Option<f64> {
        self.period
    }
}
