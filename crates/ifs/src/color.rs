//! Colours of points: by the map that made them, by the last letters of their word, by palette, depth or density.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::color::{ColorLabels, ColorMode};
//! use osier_ifs::read::read;
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! // One colour per word of the last two of three maps.
//! let labels = ColorLabels::new(&systems[0], ColorMode::Prefix(2), &[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
//! assert_eq!((labels.letters(), labels.colors.len()), (2, 9));
//! # Ok::<(), osier_base::Error>(())
//! ```

use super::game::{CHUNK_STEPS, Chunk, LANES};
use super::{Ifs, Map};
use osier_base::convert::saturating_index;
use osier_base::math;

/// Property of a point that decides its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorMode {
    /// The map applied last.
    Map,
    /// The last 1 to 4 maps applied, newest first.
    Prefix(u32),
    /// The colour coordinate in the palette.
    Coord,
    /// Steps since the lane started or jumped into the condensation set.
    Depth,
    /// Branchings since the last stem: 0 on the trunk, 1 on its branches.
    Order,
    /// One colour; only the density of points shows.
    Density,
}

/// Largest number of words that each have a separate colour; longer words are coloured by their newest letters only.
const MAX_LABELS: usize = 4096;
/// Number of colours interpolated from a palette, for the modes that colour by a continuous value.
const PALETTE_STEPS: usize = 256;
/// Highest branching order with a separate colour; higher orders share it.
const MAX_ORDER: u32 = 5;
/// Default colour of maps that squash the whole into a stem: wood, linear RGB.
const DEFAULT_WOOD: [f32; 3] = [0.110, 0.062, 0.032];
/// Default colours of the other maps, taken in turn: greens and warm hues, linear RGB.
const DEFAULT_GREENS: [[f32; 3]; 6] = [
    [0.060, 0.195, 0.028],
    [0.210, 0.340, 0.055],
    [0.028, 0.125, 0.050],
    [0.380, 0.400, 0.070],
    [0.120, 0.270, 0.110],
    [0.480, 0.300, 0.060],
];

/// True for a map that squashes the whole into a line: second singular value below a quarter of the first.
pub fn is_squash(map: &Map) -> bool {
    let s = map.affine.singular_values();
    s[1] < 0.25 * s[0]
}

/// Linear colours by label, with the labels of a lane's points.
#[derive(Debug, Clone)]
pub struct ColorLabels {
    mode: ColorMode,
    /// Linear RGB by label.
    pub colors: Vec<[f32; 3]>,
    maps: u32,
    /// m^(k-1): place value of the newest of k letters of m maps.
    top: u32,
    /// For each map the factor on the colour coordinate and the value added to it; the last entry is for jumps.
    pull: Vec<(f32, f32)>,
    /// For each map, its effect on the branching order.
    orders: Vec<Branching>,
    lanes: LaneHistory,
}

/// Effect of a map on the branching order of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Branching {
    /// A stem: the point is on a trunk.
    Begins,
    /// The order stays: the map continues an axis.
    Keeps,
    /// The order rises by one: the map is a branch.
    Adds,
}

#[derive(Debug, Clone)]
struct LaneHistory {
    word: [u32; LANES],
    coord: [f32; LANES],
    depth: [u32; LANES],
}

impl ColorLabels {
    /// Labels of the points of a system. `own`: linear RGB that replaces the system's colours, by map or along the
    /// palette; empty: the system's colours stay.
    pub fn new(ifs: &Ifs, mode: ColorMode, own: &[[f32; 3]]) -> Self {
        let maps = ifs.maps.len();
        let mode = match mode {
            ColorMode::Prefix(k) => ColorMode::Prefix(max_word_length(maps, k.clamp(1, 4))),
            other => other,
        };
        let by_map = map_colors(ifs, own);
        let palette = if own.is_empty() { &ifs.palette } else { own };
        let colors = match mode {
            ColorMode::Map => by_map,
            ColorMode::Prefix(k) => word_colors(&by_map, maps, k),
            ColorMode::Coord | ColorMode::Depth | ColorMode::Order | ColorMode::Density => {
                (0..PALETTE_STEPS).map(|i| palette_color(palette, &by_map, i)).collect()
            }
        };
        // Words of k letters are numbers in base m with the newest letter as the highest digit.
        let base = ifs.maps.iter().fold(0_u32, |n, _| n + 1).max(1);
        let top = if let ColorMode::Prefix(k) = mode { base.saturating_pow(k - 1) } else { 1 };
        let pull = ifs.maps.iter().map(|m| (math::narrow(1.0 - m.speed), math::narrow(m.speed * m.coord)));
        // Jumps leave the coordinate unchanged.
        let pull = pull.chain([(1.0, 0.0)]).collect();
        let orders = ifs.maps.iter().map(|m| match () {
            () if m.stem || is_squash(m) => Branching::Begins,
            () if m.axis => Branching::Keeps,
            () => Branching::Adds,
        });
        let lanes = LaneHistory { word: [0; LANES], coord: [0.5; LANES], depth: [0; LANES] };
        Self { mode, colors, maps: base, top, pull, orders: orders.collect(), lanes }
    }

    /// True if a label is a step of the palette, found from the colour coordinate of the point.
    pub fn is_by_coord(&self) -> bool {
        self.mode == ColorMode::Coord
    }

    /// True for [`ColorMode::Order`]: labels count branchings, so that the map does not suffice to find them.
    pub fn is_by_order(&self) -> bool {
        self.mode == ColorMode::Order
    }

    /// How many of the last maps a label that is not [by coordinate](Self::is_by_coord) depends on, at least 1.
    pub fn letters(&self) -> usize {
        if let ColorMode::Prefix(k) = self.mode { k as usize } else { 1 }
    }

    /// Label of points whose last maps, newest first, are these [`Self::letters`].
    pub fn of_word(&self, letters: &[usize]) -> u32 {
        let word = letters.iter().fold(0, |word, i| word * self.maps as usize + i);
        match self.mode {
            // `max_word_length` keeps the number of words of k letters within MAX_LABELS.
            ColorMode::Map | ColorMode::Prefix(_) => saturating_index(word),
            // A word contains no jump, so its depth counts as unlimited. The labels of the other modes do not follow
            // from the word.
            ColorMode::Depth => 255,
            ColorMode::Coord | ColorMode::Order | ColorMode::Density => 0,
        }
    }

    /// Writes the labels of the valid steps of a chunk. Chunks of a block come in order: labels depend on the maps of the
    /// steps before.
    pub fn label(&mut self, chunk: &Chunk, out: &mut [[u32; LANES]; CHUNK_STEPS]) {
        if self.mode == ColorMode::Map {
            *out = chunk.map;
            return;
        }
        for step in 0..chunk.steps.min(CHUNK_STEPS) {
            if self.mode == ColorMode::Coord {
                out[step] = self.color_coords(&chunk.map[step]).map(palette_step);
                continue;
            }
            for lane in 0..LANES {
                out[step][lane] = self.point_label(lane, chunk.map[step][lane]);
            }
        }
    }

    /// Colour coordinates after one step of all lanes: each map moves the coordinate towards its `coord`; jumps leave it
    /// unchanged.
    pub fn color_coords(&mut self, maps: &[u32; LANES]) -> [f32; LANES] {
        let last = self.pull.len() - 1;
        for (coord, map) in self.lanes.coord.iter_mut().zip(maps) {
            let (keep, add) = self.pull[(*map as usize).min(last)];
            *coord = keep * *coord + add;
        }
        self.lanes.coord
    }

    fn point_label(&mut self, lane: usize, map: u32) -> u32 {
        let l = &mut self.lanes;
        let jumped = map >= self.maps;
        match self.mode {
            ColorMode::Map | ColorMode::Coord => map,
            ColorMode::Prefix(_) => {
                // Shift the word by one letter: the new map becomes the highest digit, the oldest one is dropped.
                l.word[lane] = map.min(self.maps - 1) * self.top + l.word[lane] / self.maps;
                l.word[lane]
            }
            ColorMode::Depth => {
                l.depth[lane] = if jumped { 0 } else { (l.depth[lane] + 1).min(255) };
                l.depth[lane]
            }
            ColorMode::Order => {
                let order = &mut l.depth[lane];
                *order = match self.orders.get(map as usize) {
                    // Jumps into the condensation set are stems as well.
                    None | Some(Branching::Begins) => 0,
                    Some(Branching::Keeps) => *order,
                    Some(Branching::Adds) => (*order + 1).min(MAX_ORDER),
                };
                *order * (255 / MAX_ORDER)
            }
            ColorMode::Density => 0,
        }
    }

    /// Resets the history of a lane that restarts.
    pub fn restart(&mut self, lane: usize) {
        (self.lanes.word[lane], self.lanes.coord[lane], self.lanes.depth[lane]) = (0, 0.5, 0);
    }
}

/// Palette step of a colour coordinate: 255 c rounded to the nearest whole number.
#[inline(always)]
pub fn palette_step(c: f32) -> u32 {
    // From 2^23 on, floats have no fractional bits: the low bits of the sum are the rounded number. This avoids a
    // saturating cast.
    (c * 255.0 + 8_388_608.0).to_bits() & 255
}

/// Largest word length up to `k` with no more than [`MAX_LABELS`] words.
fn max_word_length(maps: usize, k: u32) -> u32 {
    (1..=k).rev().find(|k| maps.checked_pow(*k).is_some_and(|n| n <= MAX_LABELS)).unwrap_or(1)
}

/// Linear RGB of each map, then of the condensation sets. `own`: colours taken in turn; if empty, those of the file
/// or defaults.
pub fn map_colors(ifs: &Ifs, own: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut leaves = DEFAULT_GREENS.iter().cycle();
    let pick = |(i, map): (usize, &Map)| {
        if !own.is_empty() {
            return own[i % own.len()];
        }
        match map.color {
            Some(c) => c,
            None if is_squash(map) || map.stem => DEFAULT_WOOD,
            None => leaves.next().copied().unwrap_or(DEFAULT_WOOD),
        }
    };
    let mut colors: Vec<[f32; 3]> = ifs.maps.iter().enumerate().map(pick).collect();
    colors.push(if own.is_empty() { DEFAULT_WOOD } else { own[ifs.maps.len() % own.len()] });
    colors
}

/// The newest map's colour, shaded by the older ones.
fn word_colors(by_map: &[[f32; 3]], maps: usize, k: u32) -> Vec<[f32; 3]> {
    let maps = maps.max(1);
    let count = maps.pow(k);
    let color = |word: usize| {
        let mut rest = word;
        let mut letters = [0_usize; 4];
        for l in letters.iter_mut().take(k as usize).rev() {
            // The newest map is the highest digit.
            *l = rest % maps;
            rest /= maps;
        }
        let mut c = by_map.get(letters[0]).copied().unwrap_or(DEFAULT_WOOD);
        // Older maps shade the colour of the newest one, each half as strongly as the next newer one.
        let mut share = 0.45;
        for l in letters.iter().take(k as usize).skip(1) {
            let other = by_map.get(*l).copied().unwrap_or(DEFAULT_WOOD);
            for (x, y) in c.iter_mut().zip(other) {
                *x = math::lerp(*x, y, share);
            }
            share *= 0.5;
        }
        c
    };
    (0..count).map(color).collect()
}

/// Colour at step `i` of 256 of the palette; without a palette, between the first and the second leaf colour.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a place in a list"
)]
fn palette_color(palette: &[[f32; 3]], by_map: &[[f32; 3]], i: usize) -> [f32; 3] {
    let fallback = [DEFAULT_GREENS[0], DEFAULT_GREENS[1]];
    let list = match (palette, by_map) {
        ([], _) => &fallback[..],
        (p, _) => p,
    };
    // Palette steps are spread evenly over the list.
    let at = i as f32 / (PALETTE_STEPS - 1) as f32 * (list.len() - 1) as f32;
    let low = (at as usize).min(list.len() - 1);
    let high = (low + 1).min(list.len() - 1);
    std::array::from_fn(|c| math::lerp(list[low][c], list[high][c], at - low as f32))
}
