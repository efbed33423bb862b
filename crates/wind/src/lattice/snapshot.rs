//! The wind of one moment, and what lies between two of them.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use pulp::{Simd, WithSimd};

use super::super::Wind;
use super::collide::moments;
use super::domain::{Cells, Face};
use super::flow::Flow;
use super::grid::{BLOCK, Parity};
use super::inlet::InletWind;
use super::stencil::Q;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::par;
use osier_base::simd::F32Lanes;

/// Cells over which the wind outside the box turns into what comes in.
const BLEND: f32 = 4.0;

/// Where the cells of snapshots lie, and which are solid. Shared by all of them.
#[derive(Debug)]
pub(super) struct Field {
    /// Cells, the layer around them not counted.
    pub n: [usize; 3],
    /// Lowest corner, m.
    pub origin: DVec3,
    /// Spacing, m.
    pub spacing: f64,
    pub periodic: [bool; 3],
    /// Of every cell, the layer around them included: solid or below the ground.
    pub solid: Vec<bool>,
    /// Of every cell from which eight corners begin: whether any of them is solid.
    pub beside: Vec<bool>,
    pub inlet: Arc<InletWind>,
    /// Below it is ground.
    pub ground: bool,
}

impl Field {
    pub(super) fn new(cells: &Cells, (origin, spacing): (DVec3, f64), inlet: Arc<InletWind>) -> Self {
        let n = cells.grid.n;
        let periodic = [0, 2, 4].map(|f| cells.faces[f] == Face::Periodic);
        let mut field =
            Self { n, origin, spacing, periodic, solid: Vec::new(), beside: Vec::new(), inlet, ground: false };
        let ground = matches!(cells.faces[2], Face::Wall(_) | Face::Rough);
        field.ground = ground;
        let count = field.count();
        field.solid = (0..count)
            .map(|k| {
                let at = field.place(k);
                ground && at[1] == 0 || cells.is_solid(field.inside(at))
            })
            .collect();
        field.look_beside();
        field
    }

    fn look_beside(&mut self) {
        let step = self.steps();
        let any = |k: usize| (0..8).any(|c| self.solid.get(k + corner(c, step)).copied().unwrap_or(false));
        self.beside = (0..self.count()).map(any).collect();
    }

    /// The part of it around some place, `margin` cells wider, and its first cell.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    pub(super) fn cut(&self, bounds: Bounds, margin: f32) -> (Self, [usize; 3]) {
        let (mut low, mut n) = ([0; 3], self.n);
        for a in 0..3 {
            let place = |v: f32| narrow((f64::from(v) - self.origin[a]) / self.spacing);
            let (from, to) = (place(bounds.min[a]) - margin, place(bounds.max[a]) + margin);
            let size = self.n[a] as f32;
            // A joined axis is kept whole if any of it lies outside.
            if self.periodic[a] && (from < 0.0 || to > size) || from > to {
                continue;
            }
            low[a] = (from.clamp(0.0, size - 1.0) as usize).min(self.n[a] - 1);
            n[a] = (to.clamp(1.0, size).ceil() as usize).max(low[a] + 1) - low[a];
        }
        let periodic = std::array::from_fn(|a| self.periodic[a] && n[a] == self.n[a]);
        let origin = self.origin + DVec3::new(low[0] as f64, low[1] as f64, low[2] as f64) * self.spacing;
        let (spacing, inlet) = (self.spacing, Arc::clone(&self.inlet));
        let ground = self.ground && low[1] == 0;
        let mut part = Self { n, origin, spacing, periodic, solid: Vec::new(), beside: Vec::new(), inlet, ground };
        part.solid = (0..part.count()).map(|k| self.solid[self.in_whole(&part, low, k)]).collect();
        part.look_beside();
        (part, low)
    }

    /// Number of a cell of a part of it that begins at `low`.
    pub(super) fn in_whole(&self, part: &Self, low: [usize; 3], k: usize) -> usize {
        let (at, step) = (part.place(k), self.steps());
        (0..3).map(|a| (at[a] + low[a]) * step[a]).sum()
    }

    /// Cells with the layer around them.
    pub(super) fn count(&self) -> usize {
        self.n.iter().map(|n| n + 2).product()
    }

    /// Elements from a cell to its next along each axis.
    fn steps(&self) -> [usize; 3] {
        [1, self.n[0] + 2, (self.n[0] + 2) * (self.n[1] + 2)]
    }

    fn place(&self, k: usize) -> [usize; 3] {
        let [_, row, plane] = self.steps();
        [k % row, k / row % (self.n[1] + 2), k / plane]
    }

    /// The cell inside that a cell of the layer around repeats; places count from the layer.
    fn inside(&self, at: [usize; 3]) -> [usize; 3] {
        std::array::from_fn(|a| match at[a] {
            0 if self.periodic[a] => self.n[a] - 1,
            p if p == self.n[a] + 1 && self.periodic[a] => 0,
            p => p.clamp(1, self.n[a]) - 1,
        })
    }

    /// Velocity at a place, m: the mean of what `values` says of the eight cells around, by their number.
    /// In the layer of half a cell around solids it falls to 0 in a straight line. Outside, `outside` blends in.
    /// Source: \[catkin\] eq. 11.
    /// Differs: eq. 11 begins at the closest node, which makes negative weights; this begins at the one below.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    pub(super) fn sample(&self, at: Vec3, values: impl Fn(usize) -> Vec3, outside: impl Fn() -> Vec3) -> Vec3 {
        // In 64 bits down to the cell: 32 would lose a hundred thousandth of one a hundred cells from the corner.
        let s = (at.as_dvec3() - self.origin) / self.spacing;
        if s.y <= 0.0 && self.ground {
            return Vec3::ZERO;
        }
        let (mut base, mut part, mut far) = ([0; 3], [0.0; 3], 0.0_f64);
        for a in 0..3 {
            let n = self.n[a] as f64;
            let place = if self.periodic[a] { s[a] - (s[a] / n).floor() * n } else { s[a].clamp(0.0, n) };
            far = far.max((s[a] - place).abs() * f64::from(u8::from(!self.periodic[a])));
            // Half a cell to its middle, one for the layer around.
            let from = place + 0.5;
            base[a] = (from as usize).min(self.n[a]);
            part[a] = narrow(from - base[a] as f64);
        }
        let step = self.steps();
        let first = base[0] + base[1] * step[1] + base[2] * step[2];
        let inner = self.mean(first, part, values);
        if far > 0.0 {
            let share = narrow(far.min(1e3)).min(BLEND) / BLEND;
            return inner + (outside() - inner) * share;
        }
        inner
    }

    fn mean(&self, first: usize, part: [f32; 3], values: impl Fn(usize) -> Vec3) -> Vec3 {
        let step = self.steps();
        let weight = |c: usize| {
            let along = |a: usize| if c >> a & 1 == 1 { part[a] } else { 1.0 - part[a] };
            along(0) * along(1) * along(2)
        };
        if !self.beside[first] {
            return (0..8).fold(Vec3::ZERO, |sum, c| sum + values(first + corner(c, step)) * weight(c));
        }
        let (mut sum, mut all, mut near) = (Vec3::ZERO, 0.0, f32::INFINITY);
        for c in 0..8 {
            if self.solid[first + corner(c, step)] {
                // From the place to the cell, in cells.
                let away =
                    Vec3::from_array(std::array::from_fn(|a| ((part[a] - (c >> a & 1) as f32).abs() - 0.5).max(0.0)));
                near = near.min(away.length());
            } else {
                sum += values(first + corner(c, step)) * weight(c);
                all += weight(c);
            }
        }
        if all > 0.0 { sum / all * (near * 2.0).min(1.0) } else { Vec3::ZERO }
    }
}

/// Elements to one of eight corners.
fn corner(c: usize, step: [usize; 3]) -> usize {
    (c & 1) * step[0] + (c >> 1 & 1) * step[1] + (c >> 2) * step[2]
}

/// The wind of one moment: velocity, m/s, and density less 1 of every cell.
#[derive(Debug)]
pub struct WindSnapshot {
    pub(super) field: Arc<Field>,
    /// With the layer around the cells.
    pub(super) values: Vec<[f32; 4]>,
    /// When, s.
    pub(super) time: f64,
}

impl WindSnapshot {
    /// When it is, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Cells along x, y and z.
    pub fn cells(&self) -> [usize; 3] {
        self.field.n
    }

    /// Lowest corner and spacing of the cells, m.
    pub fn place(&self) -> (DVec3, f64) {
        (self.field.origin, self.field.spacing)
    }

    /// Velocity, m/s, and density less 1 of a cell; none if it is solid or not in the box.
    pub fn cell(&self, at: [usize; 3]) -> Option<(Vec3, f32)> {
        let [nx, ny, nz] = self.field.n;
        if at[0] >= nx || at[1] >= ny || at[2] >= nz {
            return None;
        }
        let step = self.field.steps();
        let k = at[0] + 1 + (at[1] + 1) * step[1] + (at[2] + 1) * step[2];
        let [x, y, z, rho] = self.values[k];
        (!self.field.solid[k]).then_some((Vec3::new(x, y, z), rho))
    }
}

/// The wind between two moments: in a straight line from one to the other.
#[derive(Debug, Clone)]
pub struct InterpolatedWind {
    /// The earlier one.
    pub before: Arc<WindSnapshot>,
    /// The later one.
    pub after: Arc<WindSnapshot>,
    /// When the earlier one is, s.
    pub t0: f64,
    /// When the later one is, s.
    pub t1: f64,
}

impl Wind for InterpolatedWind {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        let part = if self.t1 > self.t0 { ((t - self.t0) / (self.t1 - self.t0)).clamp(0.0, 1.0) } else { 0.0 };
        let part = osier_base::math::narrow(part);
        let (field, inlet) = (&self.before.field, &self.before.field.inlet);
        let now = inlet.now(t, inlet.gust(t));
        for (place, u) in places.iter().zip(out) {
            let value = |k: usize| {
                let (a, b) = (self.before.values[k], self.after.values[k]);
                let a = Vec3::new(a[0], a[1], a[2]);
                a + (Vec3::new(b[0], b[1], b[2]) - a) * part
            };
            *u = field.sample(*place, value, || inlet.at(place.as_dvec3(), &now).as_vec3());
        }
    }

    fn mean(&self) -> Vec3 {
        self.mean_at(10.0)
    }

    fn mean_at(&self, height: f32) -> Vec3 {
        self.before.field.inlet.mean_then(height, self.t0)
    }

    fn period(&self) -> Option<f64> {
        None
    }
}

/// What is wrong with the cells.
#[derive(Debug, Default)]
pub(super) struct Reading {
    pub planes: Vec<Plane>,
}

/// One plane of cells.
#[derive(Debug, Default)]
pub(super) struct Plane {
    /// First cell, by x and y, whose density is no number or outside its bounds.
    pub wild: Option<[usize; 2]>,
    /// Sum of the density less 1, and with the sign of the parity of x + y + z.
    pub mass: f64,
    pub checkered: f64,
}

/// Bounds of the density.
pub(super) const DENSITY: [f32; 2] = [0.5, 1.5];
/// Sums that are made side by side.
const SUMS: usize = 8;

impl Flow {
    /// Looks at every cell.
    pub(super) fn read(&self) -> Reading {
        let mut planes: Vec<_> = (0..self.cells.grid.n[2]).map(|z| (z, None)).collect();
        self.read_planes(&mut planes, 1.0)
    }

    /// The same, and writes them down.
    pub(super) fn write(&self, pages: Pages<'_>) -> Reading {
        let (field, speed) = (pages.field, pages.speed);
        let mut planes: Vec<_> =
            pages.planes().into_iter().enumerate().map(|(z, page)| (z, Some((field, page)))).collect();
        self.read_planes(&mut planes, speed)
    }

    fn read_planes(&self, planes: &mut [(usize, Page<'_>)], speed: f32) -> Reading {
        let read = |(z, page): &mut (usize, Page<'_>)| {
            let page = page.as_mut().map(|(field, plane)| (*field, &mut **plane));
            self.sweep.arch.dispatch(ReadPlane { flow: self, z: *z, speed, page })
        };
        Reading { planes: par::par_map_mut(planes, read) }
    }
}

/// Where a snapshot is written.
#[derive(Debug)]
pub(super) struct Pages<'a> {
    pub field: &'a Field,
    /// m/s of one cell a step.
    pub speed: f32,
    /// What a snapshot of the field holds.
    pub values: &'a mut [[f32; 4]],
}

impl<'a> Pages<'a> {
    /// The planes of cells.
    pub(super) fn planes(self) -> Vec<&'a mut [[f32; 4]]> {
        let size = self.field.steps()[2];
        self.values.chunks_mut(size).skip(1).take(self.field.n[2]).collect()
    }
}

impl Field {
    /// Fills the planes around, when all others are written.
    pub(super) fn surround(&self, values: &mut [[f32; 4]]) {
        let size = self.steps()[2];
        for z in [0, self.n[2] + 1] {
            let from = self.inside([1, 1, z])[2] + 1;
            values.copy_within(from * size..(from + 1) * size, z * size);
        }
    }
}

/// A plane of a snapshot, if one is made.
type Page<'a> = Option<(&'a Field, &'a mut [[f32; 4]])>;

struct ReadPlane<'a> {
    flow: &'a Flow,
    z: usize,
    speed: f32,
    page: Page<'a>,
}

impl WithSimd for ReadPlane<'_> {
    type Output = Plane;

    #[inline(always)]
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    fn with_simd<S: Simd>(self, simd: S) -> Plane {
        let Self { flow, z, speed, mut page } = self;
        let (grid, cells) = (&flow.cells.grid, &flow.cells);
        let arrays = flow.populations.arrays();
        let parity = Parity::of(flow.step);
        let [nx, ny, _] = grid.n;
        let length = nx.next_multiple_of(BLOCK);
        let mut plane = Plane::default();
        let mut row = [vec![0.0_f32; length], vec![0.0; length], vec![0.0; length], vec![0.0; length]];
        for y in 0..ny {
            let first = grid.element([0, y as isize, z as isize]);
            let mut from: [(usize, usize); Q] = [(0, 0); Q];
            for (i, from) in from.iter_mut().enumerate() {
                *from = grid.left(parity, i, first);
            }
            for block in 0..length / S::F32_LANES {
                let mut g = [F32Lanes::from_scalar(simd, 0.0); Q];
                for (g, (k, e)) in g.iter_mut().zip(from) {
                    *g = F32Lanes::new(
                        simd,
                        S::as_simd_f32s(&arrays[k][e + block * S::F32_LANES..][..S::F32_LANES]).0[0],
                    );
                }
                let (drho, u) = moments(&g);
                let all = [u[0], u[1], u[2], drho];
                for a in 0..4 {
                    S::as_mut_simd_f32s(&mut row[a]).0[block] = all[a].value;
                }
            }
            let row = row.each_mut().map(|part| &mut part[..nx]);
            plane.row(cells, (y, z), row, page.as_mut().map(|(field, page)| (*field, speed, &mut **page)));
        }
        if let Some((field, page)) = page {
            field.edge(page);
        }
        plane
    }
}

impl Plane {
    /// Looks at a row, velocity by component and density less 1, and writes it down, in m/s, if there is a page.
    #[inline(always)]
    pub(super) fn row(
        &mut self,
        cells: &Cells,
        (y, z): (usize, usize),
        row: [&mut [f32]; 4],
        page: Option<(&Field, f32, &mut [[f32; 4]])>,
    ) {
        let nx = cells.grid.n[0];
        let solid = &cells.solid[cells.grid.cell([0, y, z])..][..nx];
        let [ux, uy, uz, drho] = row;
        for (x, _) in solid.iter().enumerate().filter(|(_, solid)| **solid) {
            (ux[x], uy[x], uz[x], drho[x]) = (0.0, 0.0, 0.0, 0.0);
        }
        self.look(drho, (y, z));
        if let Some((field, speed, page)) = page {
            let to = &mut page[(y + 1) * (nx + 2)..][..nx + 2];
            let cells = &mut to[1..=nx];
            let (ux, uy, uz, drho) = (&ux[..nx], &uy[..nx], &uz[..nx], &drho[..nx]);
            for k in 0..nx {
                cells[k] = [ux[k] * speed, uy[k] * speed, uz[k] * speed, drho[k]];
            }
            (to[0], to[nx + 1]) = (to[field.inside([0, 1, 1])[0] + 1], to[field.inside([nx + 1, 1, 1])[0] + 1]);
        }
    }
}

impl Field {
    /// Fills the rows around a plane, when all others are written.
    pub(super) fn edge(&self, page: &mut [[f32; 4]]) {
        let row = self.n[0] + 2;
        for y in [0, self.n[1] + 1] {
            let from = (self.inside([1, y, 1])[1] + 1) * row;
            page.copy_within(from..from + row, y * row);
        }
    }
}

impl Plane {
    /// Looks at the densities of a row.
    #[inline(always)]
    fn look(&mut self, row: &[f32], (y, z): (usize, usize)) {
        let mut sums = [0.0_f64; SUMS];
        let mut good = true;
        for some in row.chunks(SUMS) {
            for (sum, drho) in sums.iter_mut().zip(some) {
                *sum += f64::from(*drho);
                good &= is_sound(*drho);
            }
        }
        if !good && self.wild.is_none() {
            self.wild = row.iter().position(|drho| !is_sound(*drho)).map(|x| [x, y]);
        }
        let of = |first: usize| sums.iter().skip(first).step_by(2).sum::<f64>();
        let (even, odd) = (of(0), of(1));
        self.mass += even + odd;
        self.checkered += if (y + z).is_multiple_of(2) { even - odd } else { odd - even };
    }
}

#[inline(always)]
fn is_sound(drho: f32) -> bool {
    (drho > DENSITY[0] - 1.0) & (drho < DENSITY[1] - 1.0)
}
