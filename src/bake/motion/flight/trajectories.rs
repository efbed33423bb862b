//! Trajectories behind flying catkins: the last positions of each, newest last.

use glam::Vec3;

use osier_base::Result;
use osier_base::convert::index;
use osier_scene::{Curves, InstanceState};

/// Points of all trajectories. A trajectory restarts when its catkin was recycled or wrapped to the other side of the domain,
/// so that no line crosses the domain. A catkin that is not visible, or has not moved for the whole length, has a line of
/// length zero.
#[derive(Debug, Clone)]
pub struct Trajectories {
    /// Number of points of each line, at least 2.
    length: usize,
    /// Distance, m, above which the movement in one frame is a jump, not flight.
    max_step: f32,
    points: Vec<Vec3>,
    generations: Vec<i32>,
}

impl Trajectories {
    /// Trajectories of `length` points (at least two) without positions yet. `max_step`: longest flight in one frame, m.
    pub fn new(length: usize, max_step: f32) -> Self {
        Self { length: length.max(2), max_step, points: Vec::new(), generations: Vec::new() }
    }

    /// Removes all positions; the next ones restart every trajectory.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// Appends the current positions. `generations`: how often each catkin was recycled.
    pub fn push(&mut self, state: &InstanceState, generations: &[i32]) {
        let begun = !self.points.is_empty();
        if !begun {
            self.points = state.positions.iter().flat_map(|p| std::iter::repeat_n(*p, self.length)).collect();
            self.generations = generations.to_vec();
        }
        let lines = self.points.chunks_exact_mut(self.length).zip(&mut self.generations);
        for (i, ((line, generation), (p, now))) in lines.zip(state.positions.iter().zip(generations)).enumerate() {
            let last = line.last().copied().unwrap_or(*p);
            if *generation != *now || !state.is_alive(i) || last.distance(*p) > self.max_step {
                line.fill(*p);
                *generation = *now;
            } else {
                // The oldest point moves to the end, where the new one replaces it.
                line.rotate_left(1);
                line[self.length - 1] = *p;
            }
        }
    }

    /// All points, line by line, each line from its oldest point to its newest; empty before the first positions.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// The trajectories as curves of a material, `width` m thick at the catkin and tapering to zero. `moving`: whether frames
    /// change them.
    /// # Errors
    /// `TooMany` beyond 2^32 points of a curve.
    pub fn curves(&self, width: f32, material: u32, moving: bool) -> Result<Curves> {
        let count = self.points.len() / self.length;
        let share = |k: usize| width * k as f32 / (self.length - 1) as f32;
        let widths: Vec<f32> = (0..self.length).map(share).collect();
        Ok(Curves {
            name: "trails".into(),
            material,
            counts: vec![index(self.length, "points of a trajectory")?; count],
            points: self.points.clone(),
            widths: widths.repeat(count),
            moving,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f32, alive: bool) -> InstanceState {
        InstanceState { positions: vec![Vec3::X * x], alive: vec![alive], ..InstanceState::default() }
    }

    fn xs(t: &Trajectories) -> Vec<f32> {
        t.points().iter().map(|p| p.x).collect()
    }

    #[test]
    fn a_line_follows_and_is_cut_where_nobody_flew() {
        let mut t = Trajectories::new(3, 5.0);
        t.push(&at(0.0, true), &[0]);
        assert_eq!(xs(&t), [0.0, 0.0, 0.0]);
        t.push(&at(1.0, true), &[0]);
        t.push(&at(2.0, true), &[0]);
        assert_eq!(xs(&t), [0.0, 1.0, 2.0]);
        // The catkin returns near by, is wrapped to the other side, and is invisible: no line leads to these positions.
        t.push(&at(3.0, true), &[1]);
        assert_eq!(xs(&t), [3.0, 3.0, 3.0]);
        t.push(&at(4.0, true), &[1]);
        t.push(&at(-9.0, true), &[1]);
        assert_eq!(xs(&t), [-9.0, -9.0, -9.0]);
        t.push(&at(-8.0, false), &[1]);
        assert_eq!(xs(&t), [-8.0, -8.0, -8.0]);
    }

    #[test]
    fn lines_taper_to_nothing() {
        let mut t = Trajectories::new(3, 5.0);
        t.push(&InstanceState { positions: vec![Vec3::ZERO, Vec3::Y], ..InstanceState::default() }, &[0, 0]);
        let curves = t.curves(0.5, 7, true).expect("few points");
        assert_eq!((curves.counts, curves.material), (vec![3, 3], 7));
        assert_eq!(curves.widths, [0.0, 0.25, 0.5, 0.0, 0.25, 0.5]);
        t.clear();
        assert!(t.points().is_empty());
    }
}
