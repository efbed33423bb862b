//! Omits time samples that interpolation between their neighbours restores within a tolerance.
//!
//! OpenUSD interpolates arrays element by element: positions linearly, quaternions along great circles. The reduction is greedy:
//! frames wait as long as interpolation between the last written sample and the newest frame restores all of them; when it no
//! longer does, the frame before the newest is written.
//!
//! A sample can be omitted if all elements are restored within a strict tolerance, or if nearly all of them are restored
//! so well that the difference is not visible in the picture of the camera ([`SampleTolerance`]).

use glam::{Quat, Vec3};

/// Most frames that wait between two written samples. It bounds the memory of an instancer (8 frames of transforms) and the work
/// per frame; a larger value saves samples only of objects that hardly move.
pub(super) const MAX_GAP: usize = 8;

/// Share of the elements that must be restored within [`SampleTolerance::seen`]. Own: a few leaves that flap wildly would keep
/// the samples of all others.
const SEEN_SHARE: f64 = 0.99;
/// Largest error of the remaining elements, as a multiple of [`SampleTolerance::seen`]. Own.
const SEEN_MOST: f32 = 4.0;

/// Error up to which samples are omitted.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct SampleTolerance {
    /// Limit for all elements, in their unit: m or rad. 0 keeps every sample, whatever `seen` is.
    pub(super) strict: f32,
    /// Longest invisible distance, m, for 99 of 100 elements; the others may be off by four times as
    /// much. 0: every distance is visible.
    pub(super) seen: f32,
    /// For each element the lever by which an error of one unit becomes a distance, m per unit; empty: 1 for all.
    pub(super) levers: Vec<f32>,
}

/// Array elements that readers interpolate.
pub(super) trait Interpolated: Copy {
    /// Square of the difference between `self` and the interpolation from `a` to `b` at the parameter `t`, 0 to 1.
    fn squared_error(&self, a: &Self, b: &Self, t: f32) -> f32;
}

/// Positions, m: linear interpolation; the tolerance is a distance.
impl Interpolated for Vec3 {
    fn squared_error(&self, a: &Self, b: &Self, t: f32) -> f32 {
        (a.lerp(*b, t) - *self).length_squared()
    }
}

/// A rotation; its error is an angle, rad.
impl Interpolated for Quat {
    fn squared_error(&self, a: &Self, b: &Self, t: f32) -> f32 {
        // Readers interpolate along the arc (slerp); the normalised chord leaves it by less than a thousandth of the angle.
        let between = (*a * (1.0 - t) + *b * t).normalize();
        // The dot product of unit quaternions is cos(angle / 2), and 1 - cos(angle / 2) is angle^2 / 8 for small angles.
        (1.0 - between.dot(*self).abs()) * 8.0
    }
}

/// Values of an array attribute at a time code, one for each element.
#[derive(Debug, Clone)]
pub(super) struct TimeSample<T> {
    pub(super) time: f64,
    pub(super) values: Vec<T>,
    /// Whether each element is hidden at this time, so that its value does not matter; empty: all are visible.
    pub(super) unseen: Vec<bool>,
}

/// Takes the frames of one array attribute one by one, and returns those that must be written as time samples.
#[derive(Debug)]
pub(super) struct SampleReducer<T> {
    tolerance: SampleTolerance,
    /// The sample that was written last, from which interpolation starts.
    last: Option<TimeSample<T>>,
    /// Frames after `last` that are not written yet, in order.
    waiting: Vec<TimeSample<T>>,
}

impl<T: Interpolated + PartialEq> SampleReducer<T> {
    pub(super) fn new(tolerance: SampleTolerance) -> Self {
        Self { tolerance, last: None, waiting: Vec::new() }
    }

    /// Takes a frame; returns the sample that must be written now, if any.
    pub(super) fn push(&mut self, sample: TimeSample<T>) -> Option<TimeSample<T>> {
        if self.last.is_none() || self.tolerance.strict <= 0.0 {
            self.last = Some(sample.clone());
            return Some(sample);
        }
        // While nothing moves, only the newest frame waits: a pause of any length has a sample at both ends.
        let rests = |s: &TimeSample<T>| self.last.as_ref().is_some_and(|last| s.values == last.values);
        if rests(&sample) && self.waiting.iter().all(rests) {
            self.waiting = vec![sample];
            return None;
        }
        // The newest of the waiting frames is written once the gap is full or interpolation over all of them fails.
        let due = if self.waiting.len() >= MAX_GAP || !self.restores_waiting_frames(&sample) {
            self.waiting.pop()
        } else {
            None
        };
        if let Some(due) = &due {
            self.waiting.clear();
            self.last = Some(due.clone());
        }
        self.waiting.push(sample);
        due
    }

    /// The last frame, if it has not been written; call it once, after all frames.
    pub(super) fn finish(&mut self) -> Option<TimeSample<T>> {
        let last = self.waiting.pop();
        self.waiting.clear();
        last
    }

    /// Whether interpolation from the last written sample to `next` restores all waiting frames.
    fn restores_waiting_frames(&self, next: &TimeSample<T>) -> bool {
        let Some(last) = &self.last else { return false };
        self.waiting.iter().all(|w| {
            // The parameter of the waiting frame between the two samples, 0 to 1, computed in f64 from the times.
            let t = osier_base::math::narrow((w.time - last.time) / (next.time - last.time));
            self.restores(&last.values, &next.values, t, w)
        })
    }

    /// Whether interpolation from `from` to `to` at the parameter `t` restores the visible elements of a frame.
    fn restores(&self, from: &[T], to: &[T], t: f32, frame: &TimeSample<T>) -> bool {
        let TimeSample { values, unseen, .. } = frame;
        let SampleTolerance { strict, seen, levers } = &self.tolerance;
        let (strict, seen) = (strict * strict, seen * seen);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a count")]
        let most_apart = ((values.len() - unseen.iter().filter(|u| **u).count()) as f64 * (1.0 - SEEN_SHARE)) as usize;
        let (mut all, mut apart) = (true, 0);
        let ends = from.iter().zip(to);
        for (i, (v, (a, b))) in values.iter().zip(ends).enumerate() {
            let error = v.squared_error(a, b, t);
            if error <= strict || unseen.get(i) == Some(&true) {
                continue;
            }
            all = false;
            let lever = levers.get(i).copied().unwrap_or(1.0);
            let moved = error * lever * lever;
            apart += usize::from(moved > seen);
            if apart > most_apart || moved > seen * SEEN_MOST * SEEN_MOST {
                return false;
            }
        }
        all || seen > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reduced(tolerance: f32, frames: &[Vec<Vec3>]) -> Vec<TimeSample<Vec3>> {
        let mut t = SampleReducer::new(SampleTolerance { strict: tolerance, ..SampleTolerance::default() });
        let mut out: Vec<_> = frames.iter().zip(0..).filter_map(|(f, i)| t.push(seen(i, f.clone()))).collect();
        out.extend(t.finish());
        out
    }

    /// A frame of which all is seen.
    fn seen(frame: u32, values: Vec<Vec3>) -> TimeSample<Vec3> {
        TimeSample { time: f64::from(frame), values, unseen: Vec::new() }
    }

    #[test]
    fn what_is_not_seen_may_be_anywhere() {
        let frames: [(f32, bool); 4] = [(0.0, false), (7.0, true), (-3.0, true), (3.0, false)];
        let kept = |hides: bool| {
            let mut t = SampleReducer::new(SampleTolerance { strict: 0.001, ..SampleTolerance::default() });
            let frame = |(i, (x, unseen)): (u32, (f32, bool))| TimeSample {
                unseen: vec![hides && unseen],
                ..seen(i, vec![Vec3::X * x])
            };
            let mut out: Vec<_> = (0..).zip(frames).filter_map(|f| t.push(frame(f))).collect();
            out.extend(t.finish());
            out.len()
        };
        assert_eq!((kept(true), kept(false)), (2, 4));
    }

    #[test]
    fn what_is_left_restores_every_frame_within_the_tolerance() {
        let wave = |i: u16| Vec3::new(osier_base::math::sin_f32(f32::from(i) * 0.05), f32::from(i) * 0.01, 0.0);
        let frames: Vec<Vec<Vec3>> = (0..100_u16).map(|i| vec![wave(i), wave(i + 7)]).collect();
        let kept = reduced(0.004, &frames);
        assert!(kept.len() < 60, "{}", kept.len());
        assert!((kept[0].time, kept[kept.len() - 1].time) == (0.0, 99.0), "both ends stay");
        for (i, frame) in frames.iter().enumerate() {
            let b = kept.iter().position(|k| k.time >= i as f64).expect("inside").max(1);
            let (a, b) = (&kept[b - 1], &kept[b]);
            let at = osier_base::math::narrow((i as f64 - a.time) / (b.time - a.time));
            for (k, v) in frame.iter().enumerate() {
                assert!((a.values[k].lerp(b.values[k], at) - *v).length() <= 0.004 + 1e-6);
            }
        }
        assert_eq!(reduced(0.0, &frames).len(), 100, "a tolerance of 0 keeps all");
    }

    #[test]
    fn a_pause_of_any_length_has_two_samples() {
        let frames: Vec<Vec<Vec3>> = (0..100_u16).map(|i| vec![Vec3::X * f32::from(i.saturating_sub(90))]).collect();
        let times: Vec<f64> = reduced(0.001, &frames).iter().map(|s| s.time).collect();
        assert_eq!(times[..2], [0.0, 90.0], "{times:?}");
    }

    #[test]
    fn turns_are_compared_by_their_angle() {
        let turn = |a: f32| Quat::from_rotation_y(a);
        let error = |a: f32| turn(a).squared_error(&turn(0.0), &turn(0.1), 0.5).max(0.0).sqrt();
        assert!(error(0.05) < 1e-3 && (error(0.056) - 6e-3).abs() < 1e-3, "{} {}", error(0.05), error(0.056));
    }

    #[test]
    fn what_is_not_seen_goes_unless_many_are_off_or_one_is_far_off() {
        // Three frames, the middle one off the line between the others by `errors`.
        let kept = |errors: &[f32], levers: &[f32]| {
            let tolerance = SampleTolerance { strict: 0.001, seen: 0.01, levers: levers.to_vec() };
            let mut t = SampleReducer::new(tolerance);
            let still: Vec<Vec3> = errors.iter().map(|_| Vec3::ZERO).collect();
            let off: Vec<Vec3> = errors.iter().map(|e| Vec3::X * *e).collect();
            let written = [still.clone(), off, still].into_iter().zip(0..);
            let mut out: Vec<_> = written.filter_map(|(f, i)| t.push(seen(i, f))).collect();
            out.extend(t.finish());
            out.len()
        };
        let mut errors = vec![0.009; 200];
        assert_eq!(kept(&errors, &[]), 2, "all below what is seen");
        errors[..2].fill(0.03);
        assert_eq!(kept(&errors, &[]), 2, "one in a hundred may be off by up to four times as much");
        errors[0] = 0.05;
        assert_eq!(kept(&errors, &[]), 3, "one is far off");
        errors[..5].fill(0.03);
        assert_eq!(kept(&errors, &[]), 3, "more than one in a hundred is off");
        assert_eq!(kept(&errors, &[0.2; 200]), 2, "what they carry is short");
        assert_eq!(kept(&[0.0009; 200], &[100.0; 200]), 2, "the strict tolerance holds for any lever");
    }
}
