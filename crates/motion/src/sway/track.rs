//! Recorded sway: bends of all elements at every frame of a clip.

use super::elements::{BeamElement, BeamElements};
use super::simulation::{SwayParams, SwaySimulation};
use super::zhao_zhang::{PaperSimulation, STEPS_PER_SECOND};
use crate::sway::tuning::{
    LOOP_TOLERANCE, MAX_BEND, MAX_SPIN_UP_CLIPS, MEAN_INTERVAL, MIN_ONSET_DAMPING, SPIN_UP_SECONDS,
};
use osier_base::limits::Limits;
use osier_base::math;
use osier_base::progress::Cancel;
use osier_base::{Error, Result};
use osier_wind::Wind;

/// Time range of a recording, and scaling of its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipOptions {
    /// Number of frames of the clip. One more is simulated, with which a loop is closed.
    pub frames: usize,
    /// Whether the clip loops: the frame after the last is the first; the wind must have the same period.
    pub repeats: bool,
    /// Whether the clip starts from rest, without spin-up.
    pub from_rest: bool,
    /// Factor on the static bend in the mean wind, 0..5; 1 is as simulated.
    pub lean: f64,
    /// Factor on the oscillation about the static bend, 0..20; 1 is as simulated.
    pub gain: f64,
}

/// Both bending angles of each element, rad.
type ElementBends = Vec<[f64; 2]>;

/// Sum of the bends at some frames.
#[derive(Debug, Clone, Default)]
struct BendSum {
    bends: ElementBends,
    frames: u32,
}

impl BendSum {
    fn add(&mut self, bends: &[[f64; 2]]) {
        self.bends.resize(bends.len(), [0.0; 2]);
        for (sum, bend) in self.bends.iter_mut().zip(bends) {
            *sum = [sum[0] + bend[0], sum[1] + bend[1]];
        }
        self.frames += 1;
    }
}

/// The part of the recorded bends that is the mean deflection; the rest is oscillation.
#[derive(Debug, Clone)]
struct MeanBends {
    /// Static bends in the mean wind, rad, at equidistant times from frame 0 on; a single entry holds for all frames.
    keys: Vec<ElementBends>,
    /// Number of frames from one key to the next.
    interval: usize,
    /// Rate, 1/frame, at which the mean bend of each element sets in, in a clip that starts from rest; empty for other clips.
    onset: Vec<f64>,
    /// For each element, the mean bend that gusts add to its static bend, divided by the static bend, as a complex number (a
    /// factor and a rotation); 0 for none. Empty if mean and oscillation have the same factor, and in clips that start from rest.
    gusts: Vec<[f64; 2]>,
}

impl MeanBends {
    fn constant(bends: ElementBends) -> Self {
        Self { keys: vec![bends], interval: 1, onset: Vec::new(), gusts: Vec::new() }
    }

    /// The means of a clip in `wind`. `first`: static bends at time 0, rad.
    fn new(
        first: ElementBends,
        elements: &BeamElements,
        wind: &dyn Wind,
        params: SwayParams,
        clip: ClipOptions,
    ) -> Self {
        // If mean and oscillation have the same factor, they need not be separated.
        let alike = (clip.lean - clip.gain).abs() <= 0.0;
        let mut mean = match (clip.from_rest, alike) {
            (true, true) => return Self::constant(vec![[0.0; 2]; first.len()]),
            _ => Self::constant(first),
        };
        if wind.has_varying_mean() && !alike {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few frames")]
            let interval = (MEAN_INTERVAL * params.fps).ceil().max(1.0) as usize;
            let mut statics = SwaySimulation::new(elements, wind, params);
            let key = |k: usize| {
                statics.relax_to_mean_wind_at((k * interval) as f64 / params.fps);
                statics.bends()
            };
            (mean.keys, mean.interval) = ((0..=clip.frames.div_ceil(interval)).map(key).collect(), interval);
        }
        // From rest, elements approach the mean as their oscillation about it decays.
        if clip.from_rest {
            let rate = |e: &BeamElement| e.damping_ratio.max(MIN_ONSET_DAMPING) * e.w[0] / params.fps;
            mean.onset = elements.list.iter().map(rate).collect();
        }
        mean
    }

    /// Computes by which multiple of the static bends in the mean wind the recorded bends exceed them in the mean: drag grows
    /// with the square of the wind speed, so that gusts add to the mean bend. `before`: bends of the spin-up, which count too.
    fn add_gusts(&mut self, frames: &[ElementBends], before: &BendSum) {
        /// Largest mean bend by gusts, as a multiple of the static bend. Own: that by gusts as strong as the mean wind.
        const MOST: f64 = 1.0;
        let part = |i: usize| {
            // Complex regression of the difference d on the static bend m: sum of d conj(m), divided by that of |m|^2.
            let (mut product, mut square) = ([0.0; 2], 0.0);
            let mut add = |sum: [f64; 2], count: f64, m: [f64; 2]| {
                let d = [sum[0] - count * m[0], sum[1] - count * m[1]];
                product[0] += d[0] * m[0] + d[1] * m[1];
                product[1] += d[1] * m[0] - d[0] * m[1];
                square += count * (m[0] * m[0] + m[1] * m[1]);
            };
            for (frame, bends) in frames.iter().enumerate() {
                add(bends.get(i).copied().unwrap_or_default(), 1.0, self.at(i, frame));
            }
            // If the mean wind varies, it is not known during the spin-up, which then does not count.
            if self.keys.len() == 1 {
                add(before.bends.get(i).copied().unwrap_or_default(), f64::from(before.frames), self.at(i, 0));
            }
            let size = math::sqrt(product[0] * product[0] + product[1] * product[1]);
            // If the mean wind hardly bends an element, as in the lee of a wall, its mean bend is no multiple of the static bend.
            if size <= 0.0 || size > MOST * square { [0.0; 2] } else { product.map(|v| v / square) }
        };
        let gusts = (0..frames.first().map_or(0, Vec::len)).map(part).collect();
        self.gusts = gusts;
    }

    /// Mean bend of the element or second mode `i` at a frame, rad.
    fn at(&self, i: usize, frame: usize) -> [f64; 2] {
        let key = |k: usize| self.keys.get(k).or(self.keys.last()).and_then(|bends| bends.get(i));
        let [a, b] = [0, 1].map(|next| key(frame / self.interval + next).copied().unwrap_or_default());
        let way = (frame % self.interval) as f64 / self.interval as f64;
        // The response of a critically damped oscillator to a load that sets in: 1 - (1 + x) e^-x.
        let share = self.onset.get(i).map_or(1.0, |rate| {
            let x = rate * frame as f64;
            1.0 - (1.0 + x) * math::exp(-x)
        });
        let bend = [0, 1].map(|k| (a[k] * (1.0 - way) + b[k] * way) * share);
        match self.gusts.get(i) {
            Some([re, im]) => [bend[0] + re * bend[0] - im * bend[1], bend[1] + im * bend[0] + re * bend[1]],
            None => bend,
        }
    }
}

/// Bends of all elements, second modes included, at every frame: scaled for output, and closed for a loop.
#[derive(Debug, Clone, Default)]
pub struct BendTrack {
    /// Per frame and element: both bending angles, rad.
    frames: Vec<Vec<[f32; 2]>>,
    repeats: bool,
    /// Number of angles in the paper's equations that were clamped.
    clamped: u64,
    /// Largest difference between the bends after a looping clip and at its start, rad, which was distributed over the clip.
    closed_gap: f64,
}

impl BendTrack {
    /// Simulates a clip, with spin-up, and records it.
    /// # Errors
    /// `Limit` for too many elements times frames, `Cancelled`.
    pub fn record(
        elements: &BeamElements,
        wind: &dyn Wind,
        params: SwayParams,
        clip: ClipOptions,
        limits: &Limits,
        cancel: &Cancel,
    ) -> Result<Self> {
        check_key_limit(elements, clip, limits)?;
        let (frames, mean, before) = Self::simulate(elements, wind, params, clip, cancel)?;
        Self::from_frames(frames, mean, &before, clip)
    }

    /// Records a clip by the equations of [zhao-zhang] as they are printed.
    /// # Errors
    /// As [`BendTrack::record`].
    pub fn record_as_printed(
        mut simulation: PaperSimulation<'_>,
        clip: ClipOptions,
        limits: &Limits,
        cancel: &Cancel,
    ) -> Result<Self> {
        let (elements, fps) = (simulation.elements(), simulation.fps());
        check_key_limit(elements, clip, limits)?;
        let rest = vec![[0.0; 2]; elements.list.len()];
        // Spin-up of one second, 60 steps: the effect of the first force has vanished after it, since only a share k of a force
        // remains from step to step.
        let lead = if clip.from_rest { 0 } else { 60_i64 };
        // Bends after the last two steps. Frames are interpolated between them, since most frame rates do not divide the rate of the steps.
        let mut steps = [rest.clone(), rest.clone()];
        let mut frames = Vec::with_capacity(clip.frames + 1);
        let mut number = -lead;
        #[allow(clippy::cast_precision_loss, reason = "a few thousand frames")]
        for frame in 0..=clip.frames {
            cancel.check()?;
            let t = frame as f64 / fps * STEPS_PER_SECOND;
            // The last step that was made has the number `number` - 1.
            while ((number - 1) as f64) < t {
                let next = simulation.advance(number as f64 / STEPS_PER_SECOND);
                steps = [std::mem::take(&mut steps[1]), next];
                number += 1;
            }
            let still = clip.from_rest && frame == 0;
            frames.push(if still { rest.clone() } else { between(&steps, t - (number - 2) as f64) });
        }
        let clamped = simulation.clamped;
        Ok(Self { clamped, ..Self::from_frames(frames, MeanBends::constant(rest), &BendSum::default(), clip)? })
    }

    /// Number of angles in the paper's equations that were clamped, over all internodes and frames.
    pub fn clamped(&self) -> u64 {
        self.clamped
    }

    /// The bends at every frame and at the one after the last, their mean, and the sum of the bends of the spin-up.
    fn simulate(
        elements: &BeamElements,
        wind: &dyn Wind,
        params: SwayParams,
        clip: ClipOptions,
        cancel: &Cancel,
    ) -> Result<(Vec<ElementBends>, MeanBends, BendSum)> {
        // Spin-up: start in the static equilibrium of the mean wind, then simulate until the start has no effect.
        let mut run = SwaySimulation::new(elements, wind, params);
        run.relax_to_mean_wind();
        let mean = MeanBends::new(run.bends(), elements, wind, params, clip);
        let mut before = BendSum::default();
        if clip.from_rest {
            run.reset_to_rest();
        } else {
            before = Self::spin_up(&mut run, params.fps, clip, cancel)?;
        }
        let mut frames: Vec<ElementBends> = Vec::with_capacity(clip.frames + 1);
        // Also record the frame after the clip, by which a loop is closed.
        for frame in 0..=clip.frames {
            cancel.check()?;
            frames.push(run.bends());
            advance_frame(&mut run, frame as f64, params.fps);
        }
        Ok((frames, mean, before))
    }

    /// Simulates the time before frame 0: for a loop, whole clips until two of them end with equal bends; otherwise a few
    /// seconds. Returns the sum of the bends of those seconds, which is empty for a loop.
    fn spin_up(run: &mut SwaySimulation<'_>, fps: f64, clip: ClipOptions, cancel: &Cancel) -> Result<BendSum> {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds")]
        let (frames, most) = match clip.repeats {
            true => (clip.frames, MAX_SPIN_UP_CLIPS),
            false => ((SPIN_UP_SECONDS * fps).round() as usize, 1),
        };
        let mut before = run.bends();
        let mut sum = BendSum::default();
        for _ in 0..most {
            for left in (1..=frames).rev() {
                cancel.check()?;
                // The mean of a looping clip is computed from the clip alone.
                if !clip.repeats {
                    sum.add(&run.bends());
                }
                advance_frame(run, -(left as f64), fps);
            }
            let after = run.bends();
            let gap = largest_difference(&before, &after);
            if gap <= LOOP_TOLERANCE {
                break;
            }
            before = after;
        }
        Ok(sum)
    }

    /// Closes the loop and scales bends for output. The last of `frames` is the one after the clip.
    fn from_frames(
        mut frames: Vec<ElementBends>,
        mut mean: MeanBends,
        before: &BendSum,
        clip: ClipOptions,
    ) -> Result<Self> {
        let after = frames.pop();
        let mut closed_gap = 0.0;
        if let Some((after, first)) = after.filter(|_| clip.repeats).zip(frames.first()) {
            closed_gap = largest_difference(first, &after);
            close_loop(&mut frames, &after);
        }
        // Scaling acts on the deviation from the mean deflection, gusts included, so that exaggeration does not change the lean. Clips
        // that start from rest approach the static bend in the mean wind, from which they deviate.
        if !clip.from_rest && (clip.lean - clip.gain).abs() > 0.0 {
            mean.add_gusts(&frames, before);
        }
        let scaled = |(frame, b): (usize, &ElementBends)| -> Vec<[f32; 2]> {
            b.iter().enumerate().map(|(i, b)| scaled_bend(*b, mean.at(i, frame), &clip)).collect()
        };
        let frames: Vec<Vec<[f32; 2]>> = frames.iter().enumerate().map(scaled).collect();
        if frames.iter().flatten().flatten().all(|v| v.is_finite()) {
            return Ok(Self { frames, repeats: clip.repeats, clamped: 0, closed_gap });
        }
        Err(Error::export("X001", "the simulated sway of a branch diverged"))
    }

    /// Bends at a fractional frame, linearly interpolated; times outside a clip that does not loop are clamped. Within
    /// a millionth of an integer the frame itself is returned.
    pub fn at(&self, frame: f64) -> Vec<[f32; 2]> {
        let n = self.frames.len();
        if n == 0 {
            return Vec::new();
        }
        // Times from frame rates such as 29.97 carry rounding errors: snap to whole frames.
        let near = frame.round();
        let frame = if (frame - near).abs() < 1e-6 { near } else { frame };
        let (floor, t) = (frame.floor(), math::narrow(frame - frame.floor()));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clips are short")]
        let index = |k: f64| match self.repeats {
            true => k.rem_euclid(n as f64) as usize % n,
            false => k.clamp(0.0, (n - 1) as f64) as usize,
        };
        let (a, b) = (&self.frames[index(floor)], &self.frames[index(floor + 1.0)]);
        if t == 0.0 {
            return a.clone();
        }
        a.iter().zip(b).map(|(a, b)| [0, 1].map(|k| math::lerp(a[k], b[k], t))).collect()
    }

    /// Largest difference between the bends after a looping clip and at its start, rad; 0 for a clip that does not loop.
    pub fn closed_gap(&self) -> f64 {
        self.closed_gap
    }

    /// Whether the frame after the last is the first.
    pub fn repeats(&self) -> bool {
        self.repeats
    }

    /// Number of recorded frames, without those of the spin-up.
    pub fn frame_count(&self) -> usize {
        self.frames.len()
    }
}

/// Checks the number of bends times frames against the limit of motion keys.
/// # Errors
/// `Limit`.
pub fn check_key_limit(elements: &BeamElements, clip: ClipOptions, limits: &Limits) -> Result<()> {
    let keys = (elements.bend_count() as u64).saturating_mul(clip.frames as u64);
    limits.check("motion-keys", keys, "the number of bending branches times the number of frames")
}

/// Advances a simulation by the steps of one frame, which begins at `frame` / `fps`, s.
fn advance_frame(run: &mut SwaySimulation<'_>, frame: f64, fps: f64) {
    let steps = run.steps();
    for k in 0..steps {
        run.advance((frame + f64::from(k) / f64::from(steps)) / fps);
    }
}

/// Largest difference between the angles of two lists of bends, rad.
fn largest_difference(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Bends between two steps, `share` of the way, 0 to 1, from the first to the second.
fn between([from, to]: &[ElementBends; 2], share: f64) -> ElementBends {
    let mix = |(a, b): (&[f64; 2], &[f64; 2])| [0, 1].map(|k| a[k] * (1.0 - share) + b[k] * share);
    from.iter().zip(to).map(mix).collect()
}

/// Closes a loop: distributes the difference between the frame after the clip and the first linearly over all frames.
fn close_loop(frames: &mut [ElementBends], after: &ElementBends) {
    let Some(first) = frames.first().cloned() else { return };
    let n = frames.len() as f64;
    for (k, frame) in frames.iter_mut().enumerate() {
        for (b, (from, to)) in frame.iter_mut().zip(first.iter().zip(after)) {
            for way in 0..2 {
                b[way] -= (to[way] - from[way]) * k as f64 / n;
            }
        }
    }
}

/// Scales static bend and oscillation of one bend by `lean` and `gain`, and limits the result to [`MAX_BEND`], rad.
fn scaled_bend(bend: [f64; 2], mean_bends: [f64; 2], clip: &ClipOptions) -> [f32; 2] {
    let [a, b] = [0, 1].map(|k| math::narrow(clip.lean * mean_bends[k] + clip.gain * (bend[k] - mean_bends[k])));
    // Saturate the magnitude, keep the direction.
    let size = math::sqrt_f32(a * a + b * b);
    if size < 1e-9 {
        return [a, b];
    }
    let scale = MAX_BEND * math::tanh_f32(size / MAX_BEND) / size;
    [a * scale, b * scale]
}
