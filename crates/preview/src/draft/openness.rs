//! How much of the sky a place sees, from how thickly things stand around: smooth, and the same from near and far.

use glam::Vec3;

use super::super::solid::Primitives;
use super::super::world::World;
use osier_base::math;
use osier_base::par::par_chunks;

/// ShadowCells along the longest side.
const CELLS: f32 = 40.0;
/// How far the cells reach beyond everything, in heights: as far as the lowest look down its shade.
const MARGIN: f32 = 0.8;
/// Solids of no more primitives than this stand in one cell.
const SMALL: usize = 500;
/// Looks around the one straight up, and their height and reach to the side.
const AROUND: u16 = 6;
const UP: f32 = 0.78;
const SIDE: f32 = 0.626;

/// Openness by cell.
#[derive(Debug)]
pub(super) struct Openness {
    low: Vec3,
    cell: f32,
    size: [usize; 3],
    /// Depth of a cell for light that crosses it: 1 lets by a share of 1/e.
    depth: Vec<f32>,
    /// PrimitiveRange of the sky that is seen from the middle of each cell.
    open: Vec<f32>,
}

impl Openness {
    pub(super) fn new(world: &World<'_>) -> Self {
        let extent = world.bounds.size();
        let reach = Vec3::new(extent.y, 0.0, extent.y) * MARGIN;
        let low = world.bounds.min - reach;
        let sides = extent + reach * 2.0;
        let cell = (sides.max_element() / CELLS).max(1e-6);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most CELLS")]
        let size = sides.to_array().map(|s| (s / cell).min(CELLS) as usize + 1);
        let mut own = Self { low, cell, size, depth: vec![0.0; size.iter().product()], open: Vec::new() };
        own.fill(world);
        let numbers: Vec<usize> = (0..own.depth.len()).collect();
        let open = par_chunks(&numbers, 1 << 10, |_, list| list.iter().map(|i| own.seen(*i)).collect::<Vec<_>>());
        own.open = open.concat();
        own
    }

    /// Adds everything: a surface of area a hides a / 2 from a look whose direction is not known.
    fn fill(&mut self, world: &World<'_>) {
        let share = 0.5 / (self.cell * self.cell);
        for i in 0..world.lengths().len() {
            let Some((showing, solid)) = world.of(i) else { continue };
            let (turn, shift) = showing.world();
            let scale = math::pow_f32(turn.determinant().abs(), 2.0 / 3.0);
            match (&solid.kind, solid.bounds()) {
                (Primitives::Faces { faces, .. }, _) if faces.len() > SMALL => {
                    for face in faces {
                        let [ab, ac] = face.edges();
                        let area = 0.5 * face.normal().length() * scale;
                        self.add(turn * (face.a + (ab + ac) * (1.0 / 3.0)) + shift, area * share);
                    }
                }
                (Primitives::Cones { cones, .. }, _) => {
                    for cone in cones {
                        let [min, max] = cone.bounds();
                        // Twice what is seen of it: balls and tubes have a far side.
                        self.add(turn * ((min + max) * 0.5) + shift, cone.shadow() * 2.0 * scale * share);
                    }
                }
                (_, Some([min, max])) => self.add(turn * ((min + max) * 0.5) + shift, solid.area * scale * share),
                _ => {}
            }
        }
    }

    fn add(&mut self, p: Vec3, depth: f32) {
        if let Some(cell) = self.number(p).and_then(|i| self.depth.get_mut(i)) {
            *cell += depth;
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not below zero, and compared")]
    fn number(&self, p: Vec3) -> Option<usize> {
        let q = (p - self.low) / self.cell;
        let [x, y, z] = self.size;
        let inside = q.min_element() >= 0.0 && q.is_finite();
        let [i, j, k] = q.to_array().map(|v| v as usize);
        (inside && i < x && j < y && k < z).then(|| (k * y + j) * x + i)
    }

    /// PrimitiveRange of the sky that is seen from the middle of cell `i`.
    #[allow(clippy::cast_precision_loss, reason = "at most CELLS")]
    fn seen(&self, i: usize) -> f32 {
        let [x, y, _] = self.size;
        let at = [i % x, i / x % y, i / x / y].map(|v| v as f32 + 0.5);
        let from = self.low + Vec3::from_array(at) * self.cell;
        let around = (0..AROUND).map(|k| {
            let turn = f32::from(k) / f32::from(AROUND) * std::f32::consts::TAU;
            self.clear(from, Vec3::new(math::cos_f32(turn) * SIDE, UP, math::sin_f32(turn) * SIDE))
        });
        (around.sum::<f32>() + self.clear(from, Vec3::Y)) / f32::from(AROUND + 1)
    }

    /// PrimitiveRange of light that comes to a place against a unit direction.
    fn clear(&self, from: Vec3, direction: Vec3) -> f32 {
        let (mut depth, mut p) = (0.0, from + direction * self.cell);
        while let Some(i) = self.number(p) {
            depth += self.depth[i];
            p += direction * self.cell;
        }
        math::exp_f32(-depth)
    }

    /// PrimitiveRange of the sky that a place sees, smooth between cells; beyond them as at their edge, which is all but open.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "held to the cells"
    )]
    pub(super) fn at(&self, p: Vec3) -> f32 {
        let q = (p - self.low) / self.cell - 0.5;
        if !q.is_finite() {
            return 1.0;
        }
        // Cell below and above along each axis, and how far between.
        let axis = |v: f32, n: usize| {
            let v = v.clamp(0.0, (n - 1) as f32);
            let i = v as usize;
            (i, (i + 1).min(n - 1), v - i as f32)
        };
        let ([x, y, _], [(i, i2, u), (j, j2, v), (k, k2, w)]) =
            (self.size, [axis(q.x, self.size[0]), axis(q.y, self.size[1]), axis(q.z, self.size[2])]);
        let row = |j, k| {
            let cell = |i| self.open.get((k * y + j) * x + i).copied().unwrap_or(1.0);
            math::lerp(cell(i), cell(i2), u)
        };
        math::lerp(math::lerp(row(j, k), row(j2, k), v), math::lerp(row(j, k2), row(j2, k2), v), w)
    }
}
