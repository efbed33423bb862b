//! Hits and colours per pixel. All sums are of whole numbers, so their order does not matter.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::cloud::DrawRequest;
//! use osier_ifs::game::{InstructionSet, extent};
//! use osier_ifs::histogram::{PictureWindow, histogram};
//! use osier_ifs::{dynamics::study, read::read, weights::WeightRule};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! let system = &systems[0];
//! let study = study(system, WeightRule::File);
//! let (low, high) = extent(system, &study).expect("an attractor").bounds;
//! let window = PictureWindow::fitted(low, high, 64, 64);
//! let request = DrawRequest { system, study: &study, seed: 1, points: 100_000, tier: InstructionSet::Best };
//! let counts = histogram(&request, None, &window);
//! assert_eq!(counts.hits.iter().sum::<u64>() + counts.outside, counts.points * counts.unit);
//! # Ok::<(), osier_base::Error>(())
//! ```

use std::collections::BTreeMap;

use super::cloud::DrawRequest;
use super::color::{ColorLabels, palette_step};
use super::cylinders::Cylinder;
use super::game::Escapes;
use super::splat::{CellCounter, CountingPlan, SLICE};
pub use super::window::PictureWindow;

/// A cell is emptied before its colour sums could overflow: 2^20 hits of 12 bits.
const SPILL_LIMIT: u32 = (1 << 20) - 1024;
/// Largest linear colour component, 12 bits.
const COLOR: f32 = 4095.0;
/// Value of one hit where maps have an opacity below 1.
const SHARES: f64 = 256.0;

/// Points counted by pixel, with the sums of their colours where they are coloured.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    /// Pixels per row of `hits` and `sums`.
    pub width: usize,
    /// Number of rows of `hits` and `sums`.
    pub height: usize,
    /// Hits times `unit`, rows from the top.
    pub hits: Vec<u64>,
    /// Sums of 12-bit linear colours times hits, or empty.
    pub sums: Vec<[u64; 3]>,
    /// Value of one point in `hits`.
    pub unit: u64,
    /// Number of points drawn, including those outside the picture.
    pub points: u64,
    /// Hits outside the window, times `unit`.
    pub outside: u64,
    /// Tests for escaped lanes and how many had escaped.
    pub escapes: Escapes,
}

/// Counts hits by cell, for pictures whose points have one colour.
struct HitCounter(Vec<u32>);

impl CellCounter for HitCounter {
    fn labels(&self) -> Option<&ColorLabels> {
        None
    }

    fn add_each(&mut self, cells: &[u32], _maps: &[u32], _labels: &[u32]) {
        let counts = self.0.as_mut_slice();
        for i in cells {
            counts[*i as usize] += 1;
        }
    }

    fn add(&mut self, cells: &[u32], _cylinder: &Cylinder, _coord: &[f32]) {
        self.add_each(cells, &[], &[]);
    }
}

/// Hits and colour sums of a pixel; one cache line holds four.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(16))]
struct ColorCell([u32; 4]);

/// Sums hits and colours by cell; cells near overflow are emptied into 64-bit sums.
struct ColorCounter<'a> {
    cells: Vec<ColorCell>,
    spilled: BTreeMap<u32, [u64; 4]>,
    labels: &'a ColorLabels,
    /// For each label, what a point adds to its pixel; for each map, the share of its points that is drawn (empty: all
    /// of them).
    adds: &'a [[u32; 4]],
    shares: &'a [u32],
}

impl ColorCounter<'_> {
    #[inline(always)]
    fn one(&mut self, index: u32, add: [u32; 4]) {
        let cell = &mut self.cells[index as usize].0;
        // Four 32-bit lanes in one aligned add: hits and three colours.
        *cell = std::array::from_fn(|i| cell[i] + add[i]);
        if cell[0] >= SPILL_LIMIT {
            spill(&mut self.spilled, index, cell);
        }
    }

    /// Hits (0) or a colour's sum (1 to 3) of a cell, including what was spilled from it.
    fn sum(&self, i: usize, k: usize) -> u64 {
        let kept = u64::from(self.cells[i].0[k]);
        if self.spilled.is_empty() {
            return kept;
        }
        kept + u32::try_from(i).ok().and_then(|i| self.spilled.get(&i)).map_or(0, |s| s[k])
    }

    fn share(&self, map: usize) -> u32 {
        if self.shares.is_empty() { 1 } else { self.shares.get(map).copied().unwrap_or(256) }
    }
}

impl CellCounter for ColorCounter<'_> {
    fn labels(&self) -> Option<&ColorLabels> {
        Some(self.labels)
    }

    fn add_each(&mut self, cells: &[u32], maps: &[u32], labels: &[u32]) {
        for ((index, map), label) in cells.iter().zip(maps).zip(labels) {
            let share = self.share(*map as usize);
            self.one(*index, self.adds[*label as usize].map(|v| v * share));
        }
    }

    fn add(&mut self, cells: &[u32], cylinder: &Cylinder, coord: &[f32]) {
        let share = self.share(cylinder.newest);
        if coord.is_empty() {
            let add = self.adds[cylinder.label as usize].map(|v| v * share);
            cells.iter().for_each(|i| self.one(*i, add));
            return;
        }
        // The word's last maps act on the colour coordinate as c' = keep c + pull, composed when the cylinder was cut.
        let (keep, pull) = cylinder.pull;
        let mut steps = [0; SLICE];
        steps.iter_mut().zip(coord).for_each(|(s, c)| *s = palette_step(keep * c + pull));
        // Without opacities no multiplication is needed.
        let adds = self.adds;
        if share == 1 {
            cells.iter().zip(&steps).for_each(|(i, s)| self.one(*i, adds[*s as usize]));
        } else {
            cells.iter().zip(&steps).for_each(|(i, s)| self.one(*i, adds[*s as usize].map(|v| v * share)));
        }
    }
}

/// Moves the sums of a cell to 64-bit overflow sums and clears it.
#[cold]
fn spill(spilled: &mut BTreeMap<u32, [u64; 4]>, index: u32, cell: &mut [u32; 4]) {
    let sums = spilled.entry(index).or_default();
    for (s, c) in sums.iter_mut().zip(cell.iter_mut()) {
        *s += u64::from(std::mem::take(c));
    }
}

/// Draws a system into pixels.
/// Returns the same counts at any thread count and with any instruction set.
pub fn histogram(request: &DrawRequest<'_>, labels: Option<&ColorLabels>, window: &PictureWindow) -> Histogram {
    let plan = CountingPlan::new(request, labels, window);
    let (width, height) = (window.width, window.height);
    let mut out = Histogram {
        width,
        height,
        hits: Vec::new(),
        sums: Vec::new(),
        unit: 1,
        points: plan.points,
        outside: 0,
        escapes: Escapes::default(),
    };
    match labels {
        None => out.hits(&plan),
        Some(labels) => out.colors(&plan, labels, request),
    }
    out
}

impl Histogram {
    fn hits(&mut self, plan: &CountingPlan) {
        let layout = plan.layout;
        let (parts, escapes) = plan.count(size_of::<u32>(), || HitCounter(vec![0; layout.cells()]));
        let sum = |i: usize| parts.iter().map(|p| u64::from(p.0[i])).sum::<u64>();
        (self.hits, self.outside, self.escapes) = (layout.rows(sum), sum(layout.outside()), escapes);
    }

    fn colors(&mut self, plan: &CountingPlan, labels: &ColorLabels, request: &DrawRequest<'_>) {
        let layout = plan.layout;
        let (adds, shares) = weights(labels, request);
        // Cells in tile order while counting; `rows` below brings them into picture order.
        let empty = || ColorCounter {
            cells: vec![ColorCell::default(); layout.cells()],
            spilled: BTreeMap::new(),
            labels,
            adds: &adds,
            shares: &shares,
        };
        let (parts, escapes) = plan.count(size_of::<ColorCell>(), empty);
        let sum = |i: usize, k: usize| parts.iter().map(|p| p.sum(i, k)).sum::<u64>();
        self.hits = layout.rows(|i| sum(i, 0));
        self.sums = layout.rows(|i| [sum(i, 1), sum(i, 2), sum(i, 3)]);
        self.unit = if shares.is_empty() { 1 } else { 256 };
        (self.outside, self.escapes) = (sum(layout.outside(), 0), escapes);
    }
}

/// For each label, what a point adds to its pixel; for each map, the share of its points that is drawn, or empty if all
/// maps draw all of their points.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn weights(labels: &ColorLabels, request: &DrawRequest<'_>) -> (Vec<[u32; 4]>, Vec<u32>) {
    // Linear colours in 12 bits: 2^20 hits of them fit into 32 bits, see SPILL_LIMIT.
    let twelve = |v: f32| (v.clamp(0.0, 1.0) * COLOR + 0.5) as u32;
    let adds = labels.colors.iter().map(|c| [1, twelve(c[0]), twelve(c[1]), twelve(c[2])]).collect();
    let share = |o: f64| (o.clamp(0.0, 1.0) * SHARES + 0.5) as u32;
    let maps = &request.system.maps;
    // Opacities become whole shares of 256, so that sums stay exact.
    let shown = maps.iter().any(|m| m.opacity < 1.0);
    (adds, if shown { maps.iter().map(|m| share(m.opacity)).collect() } else { Vec::new() })
}
