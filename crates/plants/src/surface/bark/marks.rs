//! Marks on a bark: cross cracks, dashes, scars, diamonds, pores (lenticels). Their sizes are in cells of a cellular noise,
//! and the cell's hash decides which cells bear a mark.

use crate::surface::periodic_noise::{CellularNoise, FractalNoise, NearestFeature};
use osier_base::math::smoothstep;

/// Kind of the marks that are drawn over the plates of a bark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BarkMarks {
    /// Plain bark: only plates, fibres and noise.
    None,
    /// Fine cracks across the ridges.
    Cracks,
    /// Dark dashes round the girth and a few black scars of branches.
    Dashes,
    /// Fine lenticels round the girth and many black scars: diamonds, drawn out into fissures, and chevrons.
    Scars,
    /// Dark diamonds, large and small.
    Diamonds,
    /// Small pale dots (lenticels).
    Pores,
}

/// A mark at a point: share of the mark's colour, 0..1, and change of the bark's height, negative where it is lowered.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Mark {
    pub color: f32,
    pub height: f32,
}

/// Tabulated noises from which the marks of a bark are computed.
pub(super) struct MarkPattern {
    kind: BarkMarks,
    small: CellularNoise,
    large: CellularNoise,
    rough: FractalNoise,
}

impl MarkPattern {
    pub fn new(kind: BarkMarks, seed: u64) -> Self {
        let (small, large) = match kind {
            BarkMarks::Cracks => ([16, 34], [4, 4]),
            BarkMarks::Dashes => ([7, 44], [2, 3]),
            BarkMarks::Scars => ([7, 64], [4, 5]),
            BarkMarks::Diamonds => ([16, 14], [4, 3]),
            BarkMarks::Pores | BarkMarks::None => ([10, 8], [4, 4]),
        };
        Self {
            kind,
            small: CellularNoise::new(seed ^ 0xA1, small, 0.85),
            large: CellularNoise::new(seed ^ 0xA2, large, 0.7),
            rough: FractalNoise::new(seed ^ 0xA3, [24, 24], 3),
        }
    }

    /// The marks at some places (x, y) of the unit square, y up; they repeat beyond it.
    pub fn at_places(&self, places: &[[f32; 2]]) -> Vec<Mark> {
        let moved = |wobble: &[f32], by: [f32; 2]| -> Vec<[f32; 2]> {
            places.iter().zip(wobble).map(|([x, y], w)| [x + by[0] * w, y + by[1] * w]).collect()
        };
        match self.kind {
            BarkMarks::None => vec![Mark::default(); places.len()],
            BarkMarks::Cracks => {
                // The noise bends the borders of the cells, along which cracks lie: a different part of it in each direction.
                let wobble = self.rough.at_places(places);
                let swapped: Vec<[f32; 2]> = places.iter().map(|[x, y]| [*y, *x]).collect();
                let across = self.rough.at_places(&swapped);
                let bent: Vec<[f32; 2]> = places
                    .iter()
                    .zip(wobble.iter().zip(&across))
                    .map(|([x, y], (w, a))| [x + 0.012 * w, y + 0.02 * a])
                    .collect();
                let small = self.small.at_places(&bent);
                small.iter().zip(&wobble).map(|(nearest, wobble)| crack(nearest, *wobble)).collect()
            }
            BarkMarks::Dashes => {
                let wobble = self.rough.at_places(places);
                let small = self.small.at_places(&moved(&wobble, [0.0, 0.0025]));
                let large = self.large.at_places(places);
                let near = small.iter().zip(&large);
                near.zip(&wobble).map(|((small, large), wobble)| dash_or_scar(small, large, *wobble)).collect()
            }
            BarkMarks::Scars => {
                let (wobble, small) = (self.rough.at_places(places), self.small.at_places(places));
                // The same noise with half the wavelength.
                let doubled: Vec<[f32; 2]> = places.iter().map(|place| place.map(|v| 2.0 * v)).collect();
                let (fine, large) = (self.rough.at_places(&doubled), self.large.at_places(places));
                let rough = wobble.iter().zip(&fine);
                let near = small.iter().zip(&large);
                near.zip(rough)
                    .map(|((small, large), (wobble, fine))| birch_scar(small, large, [*wobble, *fine]))
                    .collect()
            }
            BarkMarks::Diamonds => {
                let (wobble, small) = (self.rough.at_places(places), self.small.at_places(places));
                let large = self.large.at_places(places);
                let near = small.iter().zip(&large);
                near.zip(&wobble).map(|((small, large), wobble)| diamond_or_scar(small, large, *wobble)).collect()
            }
            BarkMarks::Pores => self.small.at_places(places).iter().map(pore).collect(),
        }
    }
}

/// A crack on the borders of cells (f2 = f1), which fades out where the noise `wobble` is low.
fn crack(nearest: &NearestFeature, wobble: f32) -> Mark {
    let line = (1.0 - smoothstep(0.0, 0.16, nearest.f2 - nearest.f1)) * smoothstep(-0.25, 0.35, wobble);
    Mark { color: 0.30 * line, height: -0.35 * line }
}

/// A small pale dot in each cell.
fn pore(nearest: &NearestFeature) -> Mark {
    let size = 0.05 + 0.05 * unit_hash(nearest.id, 8);
    let dot = 1.0 - smoothstep(size * 0.5, size, length(nearest.from, [1.0, 0.5]));
    Mark { color: 0.8 * dot, height: 0.5 * dot }
}

/// Horizontal lenticels of birch bark in the small cells, scars in the large ones.
fn dash_or_scar(small: &NearestFeature, large: &NearestFeature, wobble: f32) -> Mark {
    // Ellipses round the girth: width by the square of a hash, so that long dashes are rare; four of five cells
    // have one.
    let wide = 0.12 + 0.42 * unit_hash(small.id, 8) * unit_hash(small.id, 8);
    let thin = if small.id.is_multiple_of(3) { 0.08 } else { 0.15 };
    let dash = 1.0 - smoothstep(0.55, 1.0, length(small.from, [1.0 / wide, 1.0 / thin]));
    let visible = if small.id % 5 < 4 { dash } else { 0.0 };
    let scar = scar(large, wobble, [0.24, 0.17]);
    Mark { color: (0.92 * visible).max(scar.color), height: (-0.35 * visible).min(scar.height) }
}

/// Lenticels and black scars of the bark of silver birches. `rough`: a noise, and the same one with half the wavelength.
fn birch_scar(small: &NearestFeature, large: &NearestFeature, [wobble, fine]: [f32; 2]) -> Mark {
    // Lenticels: flat ellipses of different lengths in three of four cells.
    let wide = 0.06 + 0.34 * unit_hash(small.id, 8) * unit_hash(small.id, 24);
    let ellipse = 1.0 - smoothstep(0.5, 1.0, length(small.from, [1.0 / wide, 1.0 / 0.09]));
    let lenticel = if small.id.is_multiple_of(4) { 0.0 } else { ellipse };
    // Scars: a diamond that is drawn out up and down into a fissure or, in a third of the cells, an inverted V, which the bark
    // above a fallen branch shows. `inside`: 1 in the middle, 0 on the border.
    let grow = 0.5 + 0.9 * unit_hash(large.id, 8);
    // Borders are ragged at two scales, and fissures wind.
    let ragged = 0.5 * wobble + 0.5 * fine;
    let inside = if large.id.is_multiple_of(3) {
        let from = [large.from[0], large.from[1] + 0.6 * large.from[0].abs()];
        1.0 - diamond(&NearestFeature { from, ..*large }, [0.36 * grow, 0.09 * grow], 0.8 * ragged)
    } else {
        let from = [large.from[0] + 0.10 * ragged, large.from[1]];
        let winding = NearestFeature { from, ..*large };
        let body = diamond(&winding, [0.20 * grow, 0.24 * grow], 0.9 * ragged);
        let fissure = diamond(&winding, [0.05 * grow, 0.50 * grow], 1.2 * ragged);
        1.0 - body.min(fissure)
    };
    let bears = !large.id.is_multiple_of(5);
    let scar = if bears { smoothstep(0.0, 0.16, inside) } else { 0.0 };
    Mark {
        color: (0.7 * lenticel).max(scar * (0.93 + 0.3 * wobble).clamp(0.0, 1.0)),
        height: (-0.2 * lenticel).min(scar * (0.5 * wobble - 0.5)),
    }
}

/// Diamond-shaped lenticels of poplar bark in every third small cell, scars in the large cells.
fn diamond_or_scar(small: &NearestFeature, large: &NearestFeature, wobble: f32) -> Mark {
    // A raised rim (`body`) around a sunken middle (`heart`).
    let size = 0.16 + 0.26 * unit_hash(small.id, 8);
    let inside = 1.0 - diamond(small, [size * 1.1, size], 0.15 * wobble);
    let body = smoothstep(0.0, 0.35, inside);
    let heart = smoothstep(0.35, 0.8, inside);
    let visible = if small.id.is_multiple_of(3) { 1.0 } else { 0.0 };
    let scar = scar(large, wobble, [0.22, 0.13]);
    Mark { color: (visible * 0.8 * body).max(scar.color), height: visible * (0.25 * body - 0.55 * heart) + scar.height }
}

/// A rough black scar in every other cell.
fn scar(nearest: &NearestFeature, wobble: f32, size: [f32; 2]) -> Mark {
    if !nearest.id.is_multiple_of(2) {
        return Mark::default();
    }
    let grow = 0.6 + 0.7 * unit_hash(nearest.id, 8);
    let inside = 1.0 - diamond(nearest, [size[0] * grow, size[1] * grow], 0.55 * wobble);
    let body = smoothstep(0.0, 0.22, inside);
    Mark { color: body * (0.93 + 0.3 * wobble).clamp(0.0, 1.0), height: body * (0.25 * wobble - 0.15) }
}

/// L1 distance from the middle of a diamond in units of its half diagonals, with noise `rough` added: 0 in the middle,
/// 1 on its border.
fn diamond(nearest: &NearestFeature, size: [f32; 2], rough: f32) -> f32 {
    nearest.from[0].abs() / size[0] + nearest.from[1].abs() / size[1] + rough
}

/// Length of a vector whose components are scaled first.
fn length(v: [f32; 2], scale: [f32; 2]) -> f32 {
    let (x, y) = (v[0] * scale[0], v[1] * scale[1]);
    (x * x + y * y).sqrt()
}

/// A number in [0, 1) from some bits of a hash.
pub(super) fn unit_hash(id: u64, shift: u32) -> f32 {
    ((id >> shift) & 0xFFFF) as f32 / 65_536.0
}
