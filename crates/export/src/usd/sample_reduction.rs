//! Leaves out samples that interpolation between their neighbours restores within a tolerance.
//!
//! OpenUSD interpolates arrays element by element: places linearly, rotations along great circles. A sample is written when a
//! frame comes that some element could not be reached from the last written one without an error above the tolerance.

use glam::{Quat, Vec3};

/// Most frames between two written samples. It bounds the memory that waits, and the search.
const MAX_GAP: usize = 8;

/// What can be interpolated, and how far off the result may be.
pub(super) trait Interpolated: Copy {
    /// Whether `self`, a share `at` of the way from `a` to `b`, is within `tolerance` of what lies there.
    fn is_between(&self, a: &Self, b: &Self, at: f32, tolerance: f32) -> bool;
}

/// Tolerance: m.
impl Interpolated for Vec3 {
    fn is_between(&self, a: &Self, b: &Self, at: f32, tolerance: f32) -> bool {
        (a.lerp(*b, at) - *self).length_squared() <= tolerance * tolerance
    }
}

/// Tolerance: rad.
impl Interpolated for Quat {
    fn is_between(&self, a: &Self, b: &Self, at: f32, tolerance: f32) -> bool {
        // The straight chord, made a unit quaternion again, leaves the arc by less than a thousandth of the angle.
        let between = (*a * (1.0 - at) + *b * at).normalize();
        // 1 - cos(angle / 2) is angle^2 / 8 for small angles.
        1.0 - between.dot(*self).abs() <= tolerance * tolerance / 8.0
    }
}

/// A frame of an array.
#[derive(Debug, Clone)]
pub(super) struct TimeSample<T> {
    pub(super) time: f64,
    pub(super) values: Vec<T>,
}

/// The samples of one array that wait until it is known whether they are needed.
#[derive(Debug)]
pub(super) struct SampleReducer<T> {
    tolerance: f32,
    /// The last one that was written.
    last: Option<TimeSample<T>>,
    waiting: Vec<TimeSample<T>>,
}

impl<T: Interpolated> SampleReducer<T> {
    /// Nothing yet. `tolerance`: in the element's unit; 0 keeps every frame.
    pub(super) fn new(tolerance: f32) -> Self {
        Self { tolerance, last: None, waiting: Vec::new() }
    }

    /// Takes a frame; returns the samples that are to be written before more arrive, in order.
    pub(super) fn push(&mut self, time: f64, values: Vec<T>) -> Option<TimeSample<T>> {
        let sample = TimeSample { time, values };
        if self.last.is_none() || self.tolerance <= 0.0 {
            self.last = Some(sample.clone());
            return Some(sample);
        }
        let due = if self.waiting.len() >= MAX_GAP || !self.restores(&sample) { self.waiting.pop() } else { None };
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

    /// Whether all that wait lie between the last written sample and this one.
    fn restores(&self, next: &TimeSample<T>) -> bool {
        let Some(last) = &self.last else { return false };
        self.waiting.iter().all(|w| {
            let at = osier_base::math::narrow((w.time - last.time) / (next.time - last.time));
            let ends = last.values.iter().zip(&next.values);
            w.values.iter().zip(ends).all(|(v, (a, b))| v.is_between(a, b, at, self.tolerance))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn thinned(tolerance: f32, frames: &[Vec<Vec3>]) -> Vec<TimeSample<Vec3>> {
        let mut t = SampleReducer::new(tolerance);
        let mut out: Vec<_> = frames.iter().zip(0..).filter_map(|(f, i)| t.push(f64::from(i), f.clone())).collect();
        out.extend(t.finish());
        out
    }

    #[test]
    fn what_is_left_restores_every_frame_within_the_tolerance() {
        let wave = |i: u16| Vec3::new(osier_base::math::sin_f32(f32::from(i) * 0.05), f32::from(i) * 0.01, 0.0);
        let frames: Vec<Vec<Vec3>> = (0..100_u16).map(|i| vec![wave(i), wave(i + 7)]).collect();
        let kept = thinned(0.004, &frames);
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
        assert_eq!(thinned(0.0, &frames).len(), 100, "a tolerance of 0 keeps all");
    }

    #[test]
    fn turns_are_compared_by_their_angle() {
        let turn = |a: f32| Quat::from_rotation_y(a);
        assert!(turn(0.05).is_between(&turn(0.0), &turn(0.1), 0.5, 1e-3));
        assert!(!turn(0.056).is_between(&turn(0.0), &turn(0.1), 0.5, 5e-3));
    }
}
