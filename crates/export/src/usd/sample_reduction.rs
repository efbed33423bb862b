//! Leaves out time samples that interpolation between their neighbours restores within a tolerance.
//!
//! OpenUSD interpolates arrays element by element: positions linearly, quaternions along great circles. The reduction is greedy:
//! frames wait as long as interpolation between the last written sample and the newest frame restores all of them; when it no
//! longer does, the frame before the newest is written.

use glam::{Quat, Vec3};

/// Most frames that wait between two written samples. It bounds the memory of an instancer (8 frames of transforms) and the
/// work per frame; a larger value saves samples only of what hardly moves.
const MAX_GAP: usize = 8;

/// Array elements that readers interpolate.
pub(super) trait Interpolated: Copy {
    /// Whether interpolation from `a` to `b` at the parameter `t`, 0 to 1, is within `tolerance` of `self`.
    fn is_between(&self, a: &Self, b: &Self, t: f32, tolerance: f32) -> bool;
}

/// Positions, m: linear interpolation; the tolerance is a distance.
impl Interpolated for Vec3 {
    fn is_between(&self, a: &Self, b: &Self, t: f32, tolerance: f32) -> bool {
        (a.lerp(*b, t) - *self).length_squared() <= tolerance * tolerance
    }
}

/// A rotation; the tolerance is an angle, rad.
impl Interpolated for Quat {
    fn is_between(&self, a: &Self, b: &Self, t: f32, tolerance: f32) -> bool {
        // Readers interpolate along the arc (slerp); the normalised chord leaves it by less than a thousandth of the angle.
        let between = (*a * (1.0 - t) + *b * t).normalize();
        // The dot product of unit quaternions is cos(angle / 2), and 1 - cos(angle / 2) is angle^2 / 8 for small angles.
        1.0 - between.dot(*self).abs() <= tolerance * tolerance / 8.0
    }
}

/// A time sample of an array attribute.
#[derive(Debug, Clone)]
pub(super) struct TimeSample<T> {
    pub(super) time: f64,
    pub(super) values: Vec<T>,
}

/// Takes the frames of one array attribute and returns those that must be written as time samples.
#[derive(Debug)]
pub(super) struct SampleReducer<T> {
    tolerance: f32,
    /// The sample that was written last.
    last: Option<TimeSample<T>>,
    /// Frames since then, in order.
    waiting: Vec<TimeSample<T>>,
}

impl<T: Interpolated> SampleReducer<T> {
    /// `tolerance`: in the element's unit; 0 keeps every frame.
    pub(super) fn new(tolerance: f32) -> Self {
        Self { tolerance, last: None, waiting: Vec::new() }
    }

    /// Takes a frame; returns the sample that must be written now, if any.
    pub(super) fn push(&mut self, time: f64, values: Vec<T>) -> Option<TimeSample<T>> {
        let sample = TimeSample { time, values };
        if self.last.is_none() || self.tolerance <= 0.0 {
            self.last = Some(sample.clone());
            return Some(sample);
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

    /// The last frame, if it has not been written.
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
            let ends = last.values.iter().zip(&next.values);
            w.values.iter().zip(ends).all(|(v, (a, b))| v.is_between(a, b, t, self.tolerance))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reduced(tolerance: f32, frames: &[Vec<Vec3>]) -> Vec<TimeSample<Vec3>> {
        let mut t = SampleReducer::new(tolerance);
        let mut out: Vec<_> = frames.iter().zip(0..).filter_map(|(f, i)| t.push(f64::from(i), f.clone())).collect();
        out.extend(t.finish());
        out
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
    fn turns_are_compared_by_their_angle() {
        let turn = |a: f32| Quat::from_rotation_y(a);
        assert!(turn(0.05).is_between(&turn(0.0), &turn(0.1), 0.5, 1e-3));
        assert!(!turn(0.056).is_between(&turn(0.0), &turn(0.1), 0.5, 5e-3));
    }
}
