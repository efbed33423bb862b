//! The wind of a whole clip, for what asks at any time and place.

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

/// What to record.
#[derive(Debug, Clone, Copy)]
pub struct RecordingOptions {
    /// Where it is asked for, m.
    pub bounds: Bounds,
    /// Frames.
    pub frames: usize,
    /// Frames a second.
    pub fps: f64,
    /// The frame after the last is the first.
    pub repeats: bool,
}

/// A recorded wind: velocities in half precision at every cell near some place, for every frame of a clip.
#[derive(Debug)]
pub struct RecordedWind {
    grid: SnapshotGrid,
    frames: Vec<Vec<[f16; 3]>>,
    fps: f64,
    /// Frames recorded before the first.
    lead: usize,
    period: Option<f64>,
    inlet: Arc<InletWind>,
}

impl RecordedWind {
    /// Runs a fresh lattice through a clip and keeps what was asked for.
    /// # Errors
    /// `Limit` if it would keep too much; those of [`LatticeSolver::advance`].
    pub fn record(
        lattice: &mut LatticeSolver,
        options: RecordingOptions,
        limits: &Limits,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Self> {
        let (grid, low) = lattice.snapshot_grid().crop(options.bounds, RECORDING_MARGIN);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "two seconds of frames")]
        let lead = if options.repeats { ((LOOP_FADE * options.fps).ceil() as usize).min(options.frames) } else { 0 };
        let count = lead + options.frames + 1;
        limits.check("wind-bytes", (count * grid.count() * 6) as u64, "the bytes of the recorded wind")?;
        let mut frames = Vec::with_capacity(count);
        for frame in 0..count {
            let snapshot = lattice.advance(progress, cancel)?;
            if frame == 0 {
                progress.stage("recording the wind", count as u64);
            }
            progress.advance(1);
            frames.push(cropped_values(&snapshot, &grid, low));
        }
        let period = options.repeats.then_some(options.frames as f64 / options.fps);
        let inlet = Arc::clone(lattice.inlet());
        Ok(Self { grid, frames, fps: options.fps, lead, period, inlet })
    }

    /// Bytes that it keeps.
    pub fn bytes(&self) -> u64 {
        (self.frames.len() * self.grid.count() * 6) as u64
    }

    /// Adds a share of the wind `late` frames after the first that was recorded.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the frames")]
    fn add(&self, places: &[Vec3], late: f64, share: f32, out: &mut [Vec3]) {
        let last = self.frames.len() - 1;
        let late = late.clamp(0.0, last as f64);
        let frame = (late as usize).min(last.saturating_sub(1));
        let part = narrow(late - frame as f64);
        let (a, b) = (&self.frames[frame], &self.frames[(frame + 1).min(last)]);
        let t = late / self.fps;
        let now = self.inlet.state_at(t, self.inlet.gust(t));
        let value = |k: usize| {
            let (a, b) = (vector(a[k]), vector(b[k]));
            a + (b - a) * part
        };
        for (place, u) in places.iter().zip(out) {
            let outside = || self.inlet.velocity_in(place.as_dvec3(), &now).as_vec3();
            *u += self.grid.sample(*place, value, outside) * share;
        }
    }
}

fn vector(v: [f16; 3]) -> Vec3 {
    Vec3::new(v[0].to_f32(), v[1].to_f32(), v[2].to_f32())
}

/// A snapshot's values within a part of its grid.
fn cropped_values(snapshot: &WindSnapshot, part: &SnapshotGrid, low: [usize; 3]) -> Vec<[f16; 3]> {
    let all = (0..part.count()).map(|k| snapshot.values[snapshot.grid.index_in_whole(part, low, k)]);
    all.map(|[x, y, z, _]| [x, y, z].map(f16::from_f32)).collect()
}

impl Wind for RecordedWind {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        out.fill(Vec3::ZERO);
        let lead = self.lead as f64;
        let Some(period) = self.period else {
            self.add(places, t * self.fps, 1.0, out);
            return;
        };
        let late = t.rem_euclid(period) * self.fps;
        let frames = period * self.fps;
        // Towards the end what follows gives way to what came before the beginning.
        let share = narrow(((late - (frames - lead)) / lead.max(1.0)).clamp(0.0, 1.0));
        self.add(places, late + lead, 1.0 - share, out);
        if share > 0.0 {
            self.add(places, late + lead - frames, share, out);
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
