//! What a turtle does for each module of a string: its steps, the organs that it places, and where it stands afterwards. Own.

use glam::DVec3;

use super::builder::OrganSize;
use super::frame::{TurtleFrame, TurtlePose};
use osier_base::convert::saturating_index;

/// A step of the turtle, drawn or not.
#[derive(Debug, Clone, Copy)]
pub(super) struct TracedStep {
    /// Index in the string of the module that makes it.
    pub module: u32,
    /// Positions before and after it, plant space, m.
    pub from: DVec3,
    pub to: DVec3,
    /// Heading and left vector of the turtle.
    pub heading: DVec3,
    pub left: DVec3,
}

/// An organ that the turtle places.
#[derive(Debug, Clone, Copy)]
pub(super) struct TracedOrgan {
    /// Index in the string of the module that places it.
    pub module: u32,
    pub pose: TurtlePose,
    pub size: OrganSize,
}

/// All that a turtle does for a string, in the order of the string.
#[derive(Debug, Default)]
pub(super) struct DrawingTrace {
    pub steps: Vec<TracedStep>,
    pub organs: Vec<TracedOrgan>,
    /// Position after each module, plant space, m.
    after: Vec<DVec3>,
    /// The module that is drawn.
    module: usize,
}

impl DrawingTrace {
    /// Notes that the module `index` is drawn next, from the position `p`.
    pub fn begin_module(&mut self, index: usize, p: DVec3) {
        // One module may be drawn as several, by the homomorphism.
        if index > self.after.len() {
            self.after.resize(index, p);
        }
        self.module = index;
    }

    /// Completes the trace of a string of `modules` modules at the position `p`.
    pub fn end(&mut self, modules: usize, p: DVec3) {
        self.after.resize(modules, p);
    }

    /// Records a step.
    pub fn step(&mut self, from: DVec3, to: DVec3, frame: &TurtleFrame) {
        let module = saturating_index(self.module);
        self.steps.push(TracedStep { module, from, to, heading: frame.h, left: frame.l });
    }

    /// Number of the step that was recorded last.
    pub fn last_step(&self) -> u32 {
        saturating_index(self.steps.len().saturating_sub(1))
    }

    /// Records an organ.
    pub fn organ(&mut self, pose: TurtlePose, size: OrganSize) {
        self.organs.push(TracedOrgan { module: saturating_index(self.module), pose, size });
    }

    /// Position of the turtle before the module `index`, which may be the number of modules.
    pub fn position_before(&self, index: usize) -> DVec3 {
        index.checked_sub(1).and_then(|i| self.after.get(i)).copied().unwrap_or(DVec3::ZERO)
    }

    /// Position of the turtle after the module `index`.
    pub fn position_after(&self, index: usize) -> DVec3 {
        self.position_before(index + 1)
    }
}

/// For each of `modules` modules the index of its first item in a list sorted by module, and the length of the list at the end.
pub(super) fn first_of_module(items: impl Iterator<Item = u32>, modules: usize) -> Vec<u32> {
    let mut first = Vec::with_capacity(modules + 1);
    let mut count = 0;
    for module in items {
        while first.len() <= module as usize {
            first.push(count);
        }
        count += 1;
    }
    first.resize(modules + 1, count);
    first
}

#[cfg(test)]
mod tests {
    use super::first_of_module;

    #[test]
    fn items_are_found_by_their_module() {
        assert_eq!(first_of_module([1, 1, 3].into_iter(), 5), [0, 0, 2, 2, 3, 3]);
        assert_eq!(first_of_module([].into_iter(), 2), [0, 0, 0]);
    }
}
