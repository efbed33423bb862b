//! The light field: optical depth of leaves and solids along directions of the sky, computed by one sweep over layers of cells
//! for each direction.

use glam::{DVec3, Vec3};
use pulp::{Arch, Simd, WithSimd};

use super::site::Site;
use osier_base::geometry::Bounds;
use osier_base::math::{self, GOLDEN_ANGLE, narrow};
use osier_base::par::par_map;
use osier_base::simd::F32Lanes;

/// Side of a cell, m; larger if more than [`MAX_CELLS`] cells would cover the plants. Crowns have the same size with cells as
/// small as a third of this.
const CELL: f32 = 0.3;
/// Largest number of cells of a field: 128 along each side of a cube. A long row of trees has more of them along the row.
const MAX_CELLS: f32 = 2_097_152.0;
/// Steps of the bisection for the side of a cell where [`MAX_CELLS`] limits it.
const CELL_BISECTIONS: usize = 24;
/// Margin of the grid around living wood, neighbours and solids, m.
const MARGIN: f32 = 0.4;
/// Number of directions with which the diffuse sky is sampled.
const SKY_DIRECTIONS: u16 = 14;
/// Sines of the elevations of the lowest and the highest direction. Light from below 25 degrees is ignored, because it would have
/// to pass through neighbouring trees.
const SKY_SINES: [f64; 2] = [0.42, 0.98];
/// Sine of the elevation below which the sun gives no direct light.
const LOWEST_SUN: f64 = 0.3;
/// Declinations of the sun, degrees: equinox, a month later, solstice.
const DECLINATIONS: [f64; 3] = [0.0, 15.0, 23.4];
/// Hour angle of the sun in the morning and, negated, in the afternoon, degrees: two and a half hours before and after noon.
const HOUR_ANGLE: f64 = 37.5;
/// Empty cells around a layer, so that sheared reads need no bounds test: the cotangent of the lowest direction, 3.2 cells, and
/// one cell for interpolation.
const PAD: usize = 5;
/// Deposits are multiples of 2^-30 m2, so that sums do not depend on their order.
const AREA_UNITS: f64 = 1_073_741_824.0;
/// Optical depth of a cell inside a solid: no light passes.
const OPAQUE: f32 = 30.0;
/// Index of cells whose light is not computed.
const NO_SAMPLE: u32 = u32::MAX;

/// A direction from which light of the sky comes.
#[derive(Debug, Clone, Copy)]
pub(super) struct SkyDirection {
    /// Unit vector towards the origin of the light.
    pub d: Vec3,
    /// Its share of the light of the open sky.
    pub weight: f32,
}

/// The directions of a place's sky; their weights sum to 1.
/// Source: weights (1 + 2 sin e) / 3, the overcast sky of the CIE.
/// Own: without the cosine of a receiver, since a shoot receives light from all sides; brighter towards `side` by the factor
/// max(1 + side . d, 0); the share `direct` comes from the sun at six hours of the growing season.
pub(super) fn sky(site: &Site) -> Vec<SkyDirection> {
    let mut directions = Vec::with_capacity(20);
    let mut diffuse = Vec::new();
    for i in 0..SKY_DIRECTIONS {
        let part = f64::from(i) / f64::from(SKY_DIRECTIONS - 1);
        // Equal steps of the sine are equal solid angles; with golden-angle azimuths the directions cover the band evenly.
        let sine = SKY_SINES[0] + (SKY_SINES[1] - SKY_SINES[0]) * part;
        let azimuth = f64::from(i) * GOLDEN_ANGLE;
        let level = math::sqrt(1.0 - sine * sine);
        let d = DVec3::new(level * math::cos(azimuth), sine, level * math::sin(azimuth));
        let side = (1.0 + site.side.as_dvec3().dot(d)).max(0.0);
        diffuse.push((d, (1.0 + 2.0 * sine) / 3.0 * side));
    }
    let suns = if site.direct > 0.0 { sun_directions(site.latitude) } else { Vec::new() };
    // Without a sun above the horizon all light is diffuse.
    let direct = if suns.is_empty() { 0.0 } else { site.direct };
    let total: f64 = diffuse.iter().fold(0.0, |t, (_, w)| t + w);
    for (d, w) in diffuse {
        let weight = narrow((1.0 - direct) * w / total.max(1e-12));
        directions.push(SkyDirection { d: d.as_vec3(), weight });
    }
    for d in &suns {
        directions.push(SkyDirection { d: d.as_vec3(), weight: narrow(direct / suns.len() as f64) });
    }
    directions
}

/// Directions to the sun at six hours; +X is east, -Z north.
fn sun_directions(latitude_deg: f64) -> Vec<DVec3> {
    let latitude = latitude_deg.to_radians();
    let (sin_lat, cos_lat) = (math::sin(latitude), math::cos(latitude));
    let mut out = Vec::new();
    for declination in DECLINATIONS {
        // In the southern hemisphere the growing season has the opposite declinations.
        let delta = declination.to_radians() * if latitude_deg < 0.0 { -1.0 } else { 1.0 };
        let (sin_dec, cos_dec) = (math::sin(delta), math::cos(delta));
        for hour in [-HOUR_ANGLE, HOUR_ANGLE] {
            let h = hour.to_radians();
            // Convert declination, latitude and hour angle to the horizontal coordinates of the sun; `up` is the sine of its
            // elevation.
            let up = sin_lat * sin_dec + cos_lat * cos_dec * math::cos(h);
            let east = -cos_dec * math::sin(h);
            let north = cos_lat * sin_dec - sin_lat * cos_dec * math::cos(h);
            if up > LOWEST_SUN {
                out.push(DVec3::new(east, up, -north).normalize());
            }
        }
    }
    out
}

/// Grid of cubic cells over a box of the stand, relative to the origin of the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    /// Corner with the smallest coordinates, m.
    pub origin: Vec3,
    /// Side of a cell, m; at least [`CELL`].
    pub cell: f32,
    /// Reciprocal of `cell`, 1/m, as positions are divided often.
    pub per_cell: f32,
    /// Numbers of cells along x, y (layers) and z.
    pub size: [usize; 3],
}

/// Cells around a point, and their weights for interpolation.
struct Corners {
    /// Indices of the cells; some are equal at the edge of the grid.
    cells: [usize; 8],
    /// Trilinear weights, of sum 1.
    weights: [f32; 8],
}

impl Grid {
    /// Cells over a box with a margin. Their corners are multiples of the cell side from the origin, so that the cells of a
    /// growing tree stay the same from year to year.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most MAX_CELLS")]
    pub fn over(bounds: Bounds) -> Self {
        let cell = cell_side(bounds.size());
        let around = bounds.expanded(MARGIN.max(cell));
        let low = (around.min / cell).floor();
        let high = (around.max / cell).ceil();
        let count = |v: f32| (v as usize).max(1);
        let size = high - low;
        Self { origin: low * cell, cell, per_cell: 1.0 / cell, size: [count(size.x), count(size.y), count(size.z)] }
    }

    pub fn len(&self) -> usize {
        self.size.iter().product()
    }

    /// Index of the cell that contains a point; points outside belong to the nearest cell.
    #[inline]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    pub fn cell_of(&self, p: Vec3) -> u32 {
        let at = (p - self.origin) * self.per_cell;
        let clamp = |v: f32, n: usize| (v.max(0.0) as usize).min(n - 1);
        let [nx, ny, nz] = self.size;
        ((clamp(at.y, ny) * nz + clamp(at.z, nz)) * nx + clamp(at.x, nx)) as u32
    }

    /// Middle of a cell, relative to the origin of the field, m.
    pub fn center(&self, x: usize, y: usize, z: usize) -> Vec3 {
        self.origin + (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * self.cell
    }

    /// Share of a deposit at `p` that the cell of `p` itself receives.
    #[inline]
    pub fn own_share(&self, p: Vec3) -> f32 {
        let at = (p - self.origin) * self.per_cell;
        // The trilinear weight of the nearest center: 1 at the center of the cell, 1/8 at its corners.
        let off = (at - at.map(floor) - 0.5).abs();
        (1.0 - off.x) * (1.0 - off.y) * (1.0 - off.z)
    }

    /// The cells around a point, with the weights of trilinear interpolation between their centers.
    #[inline]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    fn corners(&self, p: Vec3) -> Corners {
        let [nx, ny, nz] = self.size;
        let at = (p - self.origin) * self.per_cell - 0.5;
        let low = at.map(floor);
        let t = at - low;
        let pair = |v: f32, n: usize| {
            let low = v.max(0.0) as usize;
            // Before the first center both indices are 0: a deposit at the edge goes entirely into the outermost cells.
            [low.min(n - 1), (low + usize::from(v >= 0.0)).min(n - 1)]
        };
        let (xs, ys, zs) = (pair(low.x, nx), pair(low.y, ny), pair(low.z, nz));
        let (u, v, w) = ([1.0 - t.x, t.x], [1.0 - t.y, t.y], [1.0 - t.z, t.z]);
        let mut corners = Corners { cells: [0; 8], weights: [0.0; 8] };
        for i in 0..8 {
            let (x, y, z) = (i & 1, i >> 2, (i >> 1) & 1);
            corners.cells[i] = (ys[y] * nz + zs[z]) * nx + xs[x];
            corners.weights[i] = u[x] * v[y] * w[z];
        }
        corners
    }
}

/// Floor of a number, without a function call if the number fits an integer; a zero may lose its sign.
#[inline]
#[allow(clippy::cast_possible_truncation, reason = "used within the range of integers")]
fn floor(v: f32) -> f32 {
    const WHOLE: f32 = 8_388_608.0;
    if v.abs() < WHOLE {
        let towards_zero = v as i32 as f32;
        if towards_zero > v { towards_zero - 1.0 } else { towards_zero }
    } else {
        // From 2^23 on all numbers are whole.
        v.floor()
    }
}

/// Smallest side of a cell, m, at least [`CELL`], with which at most [`MAX_CELLS`] cells cover a box and its margin.
/// `size`: size of the box, m.
fn cell_side(size: Vec3) -> f32 {
    let most = |cell: f32| {
        // Aligning the grid to multiples of the cell side may add a cell at either end.
        let n = (size + 2.0 * MARGIN.max(cell)) / cell + 2.0;
        n.x * n.y * n.z
    };
    if most(CELL) <= MAX_CELLS {
        return CELL;
    }
    // If the side of a cell equals the longest side of the box, the number of cells is below the limit.
    let (mut low, mut high) = (CELL, size.max_element());
    for _ in 0..CELL_BISECTIONS {
        let middle = 0.5 * (low + high);
        if most(middle) > MAX_CELLS { low = middle } else { high = middle }
    }
    high
}

/// Leaf areas by cell, times the extinction of their species, in units of 2^-30 m2.
#[derive(Debug)]
pub(super) struct LeafAreas {
    pub grid: Grid,
    areas: Vec<i64>,
}

impl LeafAreas {
    pub fn new(grid: Grid) -> Self {
        Self { grid, areas: vec![0; grid.len()] }
    }

    /// Adds a leaf area, m2 times extinction, at a point.
    #[inline]
    #[allow(clippy::cast_possible_truncation, reason = "areas of cells are far below 2^33 m2")]
    pub fn deposit(&mut self, p: Vec3, area: f32) {
        let corners = self.grid.corners(p);
        for (cell, weight) in corners.cells.into_iter().zip(corners.weights) {
            // Integer sums are associative, so that trees may deposit in any order with the same result.
            self.areas[cell] += (f64::from(weight * area) * AREA_UNITS) as i64;
        }
    }

    /// Adds a leaf area, m2 times extinction, to a single cell.
    #[allow(clippy::cast_possible_truncation, reason = "areas of cells are far below 2^33 m2")]
    pub fn add_to_cell(&mut self, cell: usize, area: f32) {
        self.areas[cell] += (f64::from(area) * AREA_UNITS) as i64;
    }

    /// Sum over all cells, m2 times extinction.
    #[cfg(test)]
    pub fn total(&self) -> f64 {
        self.areas.iter().sum::<i64>() as f64 / AREA_UNITS
    }
}

/// Amount and mean direction of the light at the middle of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Light {
    /// Share of the light of the open sky.
    pub q: f32,
    /// Unit vector towards the mean origin of the light, which phototropism follows.
    pub from: Vec3,
}

/// Light in the cells that hold tips or buds.
#[derive(Debug)]
pub(super) struct LightField {
    /// Grid of the leaf areas from which the field was computed.
    pub grid: Grid,
    /// Index of the sample of each cell, or [`NO_SAMPLE`].
    samples: Vec<u32>,
    light: Vec<Light>,
}

impl LightField {
    /// Computes the light in the cells marked in `wanted`. `opaque`: cells inside solids.
    pub fn compute(areas: &LeafAreas, sky: &[SkyDirection], opaque: &[u32], wanted: &CellMarks) -> Self {
        let grid = areas.grid;
        // Optical depth of a cell for vertical light = extinction x leaf area / ground area of the cell. List the marked cells in
        // the order of the sweep.
        let to_depth = 1.0 / (AREA_UNITS * f64::from(grid.cell) * f64::from(grid.cell));
        let mut depth: Vec<f32> = areas.areas.iter().map(|a| narrow(*a as f64 * to_depth)).collect();
        for cell in opaque {
            depth[*cell as usize] += OPAQUE;
        }
        let mut samples = vec![NO_SAMPLE; grid.len()];
        let mut cells = Vec::new();
        for (cell, _) in wanted.0.iter().enumerate().filter(|(_, wanted)| **wanted) {
            samples[cell] = to_u32(cells.len());
            cells.push(to_u32(cell));
        }
        // Compute one sweep for each direction, in parallel; add their light in the order of directions.
        let passed = par_map(sky, |direction| transmittance(&grid, &depth, *direction, &cells));
        let mut light: Vec<Light> = vec![Light { q: 0.0, from: Vec3::ZERO }; cells.len()];
        for (direction, passed) in sky.iter().zip(&passed) {
            for (sample, t) in light.iter_mut().zip(passed) {
                let w = direction.weight * t;
                sample.q += w;
                // The weighted mean of directions, which phototropism follows.
                sample.from += direction.d * w;
            }
        }
        for sample in &mut light {
            sample.from = math::normalize_or(sample.from, Vec3::Y);
        }
        Self { grid, samples, light }
    }

    /// Light in a cell that was marked; in any other cell zero light, with the direction up.
    #[inline]
    pub fn in_cell(&self, cell: u32) -> Light {
        let sample = self.samples.get(cell as usize).copied().unwrap_or(NO_SAMPLE);
        self.light.get(sample as usize).copied().unwrap_or(Light { q: 0.0, from: Vec3::Y })
    }
}

/// For each cell, whether light is computed in it.
#[derive(Debug)]
pub(super) struct CellMarks(Vec<bool>);

impl CellMarks {
    pub fn new(grid: &Grid) -> Self {
        Self(vec![false; grid.len()])
    }

    #[inline]
    pub fn mark(&mut self, cell: u32) {
        if let Some(wanted) = self.0.get_mut(cell as usize) {
            *wanted = true;
        }
    }
}

/// An index of a cell or a sample; a grid has at most 2^21 cells.
#[allow(clippy::cast_possible_truncation, reason = "at most 128^3")]
fn to_u32(i: usize) -> u32 {
    i as u32
}

/// The transmittance from a direction of the sky to the middle of each of `cells`, which are in ascending order.
/// Source: tau(x) = bilinear read of the layer above at the sheared position + the cell's own depth over the sine of the
/// elevation; exp(-(tau above + half of the own depth)), the law of Beer and Lambert.
fn transmittance(grid: &Grid, depth: &[f32], direction: SkyDirection, cells: &[u32]) -> Vec<f32> {
    let mut out = negative_depths(grid, depth, direction, cells);
    Arch::new().dispatch(Exponentials(&mut out));
    out
}

/// The logarithm of [`transmittance`]: the optical depth towards a direction of the sky, negative.
fn negative_depths(grid: &Grid, depth: &[f32], direction: SkyDirection, cells: &[u32]) -> Vec<f32> {
    let [nx, ny, nz] = grid.size;
    let per_sine = 1.0 / direction.d.y;
    let shear = Shear::new(direction);
    let width = nx + 2 * PAD;
    // Depths of the layer above and of this one, each padded with empty cells.
    let mut above = vec![0.0_f32; width * (nz + 2 * PAD)];
    let mut here = above.clone();
    let mut out = vec![0.0_f32; cells.len()];
    let mut end = cells.len();
    let mut clear = true;
    let arch = Arch::new();
    for y in (0..ny).rev() {
        let layer = &depth[y * nz * nx..(y + 1) * nz * nx];
        let first = cells[..end].partition_point(|c| (*c as usize) < y * nz * nx);
        // Above the highest leaf all depths are 0: skip these layers.
        clear = clear && layer.iter().all(|d| *d <= 0.0);
        if !clear {
            arch.dispatch(AddLayer { shear: &shear, above: &above, own: layer, row: nx, per_sine, to: &mut here });
        }
        for (sample, cell) in out[first..end].iter_mut().zip(&cells[first..end]) {
            let within = *cell as usize - y * nz * nx;
            let own = layer[within] * per_sine;
            *sample = 0.5 * own - here[(within / nx + PAD) * width + PAD + within % nx];
        }
        end = first;
        std::mem::swap(&mut above, &mut here);
    }
    out
}

/// How to read the layer above for a direction: shift in whole cells, and weights of the four cells around the shifted position.
struct Shear {
    x: isize,
    z: isize,
    weights: [f32; 4],
}

impl Shear {
    #[allow(clippy::cast_possible_truncation, reason = "at most PAD cells")]
    fn new(direction: SkyDirection) -> Self {
        let limit = PAD as f32 - 1.5;
        let (x, z) = (direction.d.x / direction.d.y, direction.d.z / direction.d.y);
        let (x, z) = (x.clamp(-limit, limit), z.clamp(-limit, limit));
        let (u, w) = (x - x.floor(), z - z.floor());
        let weights = [(1.0 - u) * (1.0 - w), u * (1.0 - w), (1.0 - u) * w, u * w];
        Self { x: x.floor() as isize, z: z.floor() as isize, weights }
    }
}

/// Computes the optical depths of a layer of cells from those of the layer above.
struct AddLayer<'a> {
    shear: &'a Shear,
    /// The layer above, with [`PAD`] empty cells on every side.
    above: &'a [f32],
    /// Depth of the layer's cells for vertical light.
    own: &'a [f32],
    /// Number of cells in a row along x.
    row: usize,
    /// 1 / sine of the elevation.
    per_sine: f32,
    /// Depths of this layer, padded like `above`.
    to: &'a mut [f32],
}

impl WithSimd for AddLayer<'_> {
    type Output = ();

    /// Plain loops, which the compiler vectorizes for the dispatched instruction set.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let [a, b, c, d] = self.shear.weights;
        let (n, width) = (self.row, self.row + 2 * PAD);
        for (z, own) in self.own.chunks_exact(n).enumerate() {
            let start = (z + PAD).wrapping_add_signed(self.shear.z) * width + PAD.wrapping_add_signed(self.shear.x);
            let (near, far) = (&self.above[start..=start + n], &self.above[start + width..=start + width + n]);
            let (near, near_next, far, far_next) = (&near[..n], &near[1..], &far[..n], &far[1..]);
            let to = &mut self.to[(z + PAD) * width + PAD..][..n];
            for x in 0..n {
                to[x] = a * near[x] + b * near_next[x] + c * far[x] + d * far_next[x] + own[x] * self.per_sine;
            }
        }
    }
}

/// Replaces numbers by their exponentials, in place.
struct Exponentials<'a>(&'a mut [f32]);

impl WithSimd for Exponentials<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for part in self.0.chunks_mut(S::F32_LANES) {
            F32Lanes::partial_load(simd, part).exp().partial_store(part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slab(area: f32) -> LeafAreas {
        let bounds = Bounds { min: Vec3::ZERO, max: Vec3::new(9.0, 3.0, 9.0) };
        let mut areas = LeafAreas::new(Grid::over(bounds));
        let [nx, ny, nz] = areas.grid.size;
        for y in 0..ny {
            for cell in y * nz * nx..(y + 1) * nz * nx {
                // A layer of air at the top and at the bottom.
                if y > 0 && y + 1 < ny {
                    areas.add_to_cell(cell, area);
                }
            }
        }
        areas
    }

    fn all_cells(grid: &Grid) -> CellMarks {
        CellMarks(vec![true; grid.len()])
    }

    #[test]
    fn cells_are_as_small_as_their_number_allows() {
        let grid = |size: [f32; 3]| Grid::over(Bounds { min: Vec3::ZERO, max: Vec3::from_array(size) });
        // A tree, and rows of trees of 100 m and 500 m: only boxes with too many cells get larger cells.
        for size in [[12.0, 15.0, 12.0], [100.0, 12.0, 12.0], [8.0, 9.0, 500.0]] {
            assert!((grid(size).cell - CELL).abs() < 1e-6, "{size:?}");
        }
        for size in [[400.0, 20.0, 300.0], [60.0, 60.0, 60.0], [90_000.0, 25.0, 30.0]] {
            let grid = grid(size);
            let count = grid.len() as f32;
            assert!(grid.cell > CELL && (0.5 * MAX_CELLS..=MAX_CELLS).contains(&count), "{size:?} {count}");
        }
    }

    #[test]
    fn a_uniform_slab_has_its_closed_form() {
        let areas = slab(0.01);
        let grid = areas.grid;
        let sky = sky(&Site::default());
        assert!((sky.iter().map(|s| s.weight).sum::<f32>() - 1.0).abs() < 1e-6);
        let field = LightField::compute(&areas, &sky, &[], &all_cells(&grid));
        // In the middle, far from the sides: the depth is that of the layers above and half of the own layer.
        let [nx, ny, nz] = grid.size;
        for below in 0..3_u16 {
            let y = ny - 2 - usize::from(below);
            let cell = to_u32((y * nz + nz / 2) * nx + nx / 2);
            let straight = f64::from(below) + 0.5;
            let per_layer = 0.01 / (f64::from(grid.cell) * f64::from(grid.cell));
            let exact: f64 =
                sky.iter().map(|s| f64::from(s.weight) * math::exp(-straight * per_layer / f64::from(s.d.y))).sum();
            let q = f64::from(field.in_cell(cell).q);
            assert!((q - exact).abs() < 1e-5, "{q} {exact}");
        }
    }

    #[test]
    fn depths_add_and_deposits_keep_their_area() {
        // Two scatterings of leaves, and both together.
        let scattered = |turn: f32| {
            let mut areas = slab(0.0);
            for i in 0..3000_u16 {
                let f = f32::from(i) + turn;
                areas.deposit(Vec3::new((f * 0.371) % 9.0, (f * 0.533) % 3.0, (f * 0.717) % 9.0), 0.01 + 0.02 * turn);
            }
            areas
        };
        let (one, two) = (scattered(0.0), scattered(0.37));
        let sum = LeafAreas { areas: one.areas.iter().zip(&two.areas).map(|(a, b)| a + b).collect(), grid: one.grid };
        let cells: Vec<u32> = (0..to_u32(one.grid.len())).collect();
        let top = SkyDirection { d: Vec3::new(0.6, 0.8, 0.0), weight: 1.0 };
        let depths = |areas: &LeafAreas| {
            let own: Vec<f32> = areas.areas.iter().map(|a| narrow(*a as f64 / AREA_UNITS)).collect();
            negative_depths(&areas.grid, &own, top, &cells)
        };
        let (a, b, both) = (depths(&one), depths(&two), depths(&sum));
        assert!(both.iter().fold(0.0, |most: f32, d| most.max(-d)) > 0.1, "they shade");
        for (d, (a, b)) in both.iter().zip(a.iter().zip(&b)) {
            assert!((a + b - d).abs() < 2e-7, "{a} + {b} is not {d}");
        }
        let mut areas = LeafAreas::new(one.grid);
        for i in 0..1000_u16 {
            let f = f32::from(i);
            let p = Vec3::new((f * 0.371) % 9.0, (f * 0.533) % 3.0, (f * 0.717) % 9.0);
            areas.deposit(p, 0.02);
        }
        assert!((areas.total() - 20.0).abs() < 20.0 * 1e-6, "{}", areas.total());
    }

    #[test]
    fn light_from_a_side_and_the_sun_has_its_weights() {
        let site = Site { side: Vec3::new(0.6, 0.0, 0.0), latitude: 50.0, direct: 0.5, ..Site::default() };
        let sky = sky(&site);
        assert_eq!(sky.len(), 20);
        assert!((sky.iter().map(|s| s.weight).sum::<f32>() - 1.0).abs() < 1e-6);
        assert!(sky.iter().map(|s| s.weight * s.d.x).sum::<f32>() > 0.05);
        assert!(sky[14..].iter().all(|s| s.d.z > 0.0 && s.d.y > 0.3), "the sun stands in the south");
    }
}
