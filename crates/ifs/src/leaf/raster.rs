//! A leaf's attractor counted into pixels, by last map.

use super::mask::Mask;
use crate::cloud::DrawRequest;
use crate::color::ColorLabels;
use crate::cylinders::Cylinder;
use crate::splat::{CellCounter, CountingPlan};
use crate::window::PictureWindow;

/// Number of classes in which hits are counted: the class of a map is its index modulo this number.
pub(super) const MAP_CLASSES: usize = 4;

/// Hits by last map modulo [`MAP_CLASSES`]: by cell while they are counted, then by pixel, rows from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct MapHitCounts {
    cells: Vec<[u32; MAP_CLASSES]>,
}

impl CellCounter for MapHitCounts {
    fn labels(&self) -> Option<&ColorLabels> {
        None
    }

    fn add_each(&mut self, cells: &[u32], maps: &[u32], _labels: &[u32]) {
        for (i, map) in cells.iter().zip(maps) {
            self.cells[*i as usize][*map as usize % MAP_CLASSES] += 1;
        }
    }

    fn add(&mut self, cells: &[u32], cylinder: &Cylinder, _coord: &[f32]) {
        let kind = cylinder.newest % MAP_CLASSES;
        for i in cells {
            self.cells[*i as usize][kind] += 1;
        }
    }
}

/// Counts the points of a request; the same at any thread count.
pub(super) fn count(request: &DrawRequest<'_>, window: &PictureWindow) -> MapHitCounts {
    let plan = CountingPlan::new(request, None, window);
    let layout = plan.layout;
    let empty = || MapHitCounts { cells: vec![[0; MAP_CLASSES]; layout.cells()] };
    let (parts, _) = plan.count(size_of::<[u32; MAP_CLASSES]>(), empty);
    let sum = |i: usize| std::array::from_fn(|k| parts.iter().map(|p| p.cells[i][k]).sum());
    MapHitCounts { cells: layout.rows(sum) }
}

impl MapHitCounts {
    /// Number of points by pixel, rows from the top.
    pub fn hits(&self) -> Vec<u32> {
        self.cells.iter().map(|c| c.iter().sum()).collect()
    }

    /// The most frequent class of maps of each pixel; the first of several that are equal.
    pub fn letters(&self) -> Vec<u8> {
        let best = |c: &[u32; MAP_CLASSES]| (0_u8..).zip(c).max_by_key(|(i, n)| (**n, u8::MAX - i)).map_or(0, |b| b.0);
        self.cells.iter().map(best).collect()
    }

    /// Pixels with at least `min_hits` hits; 0 counts as 1.
    pub fn mask(&self, side: usize, min_hits: u32) -> Mask {
        Mask { side, set: self.cells.iter().map(|c| c.iter().sum::<u32>() >= min_hits.max(1)).collect() }
    }
}
