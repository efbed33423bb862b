//! Scattering of plants over a terrain: dart throwing in rounds; every candidate has a separate random stream.

use glam::Vec3;

use super::Terrain;
use osier_base::Result;
use osier_base::convert::narrow;
use osier_base::limits::Limits;
use osier_base::math::{self, smoothstep};
use osier_base::neighbours::NeighbourGrid;
use osier_base::noise;
use osier_base::rng::{Key, Rng, child};

/// Candidates of a cell, one per round. Further rounds fill gaps that the first ones leave; each costs at most as much
/// as the first round.
const CANDIDATES_PER_CELL: u32 = 4;
/// Entry of a cell without an accepted point.
const EMPTY: u32 = u32::MAX;

/// A disc or ring in which points are scattered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScatterDisc {
    /// Centre in the world, x and z, m.
    pub at: [f32; 2],
    /// Outer radius, m, > 0.
    pub radius: f32,
    /// Inner radius, m; points keep out of it. 0: a disc.
    pub inner: f32,
    /// Width of the rim, as a share of the radius, 0..1, over which the density of points falls to 0.
    pub fade: f32,
}

/// Grey picture over the whole terrain, row 0 at -z, whose values multiply the density: 0 is black, where no point lies.
#[derive(Debug, Clone, PartialEq)]
pub struct DensityMask {
    /// Pixels along x, which span the terrain from -x to +x.
    pub width: usize,
    /// Pixels along z, which span the terrain from -z to +z.
    pub height: usize,
    /// `width * height` factors of the density, 0..1, in each row from -x.
    pub values: Vec<f32>,
}

impl DensityMask {
    /// The pixel at shares of the way from -x to +x and from -z to +z, clamped to 0..1.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the picture")]
    fn at(&self, x: f32, y: f32) -> f32 {
        let pick = |v: f32, n: usize| ((v.clamp(0.0, 1.0) * n as f32) as usize).min(n.saturating_sub(1));
        self.values.get(pick(y, self.height) * self.width + pick(x, self.width)).copied().unwrap_or(0.0)
    }
}

/// Spacing, density and region of a scatter.
#[derive(Debug, Clone, PartialEq)]
pub struct ScatterParams {
    /// Least horizontal distance between two points, m, > 0.
    pub spacing: f32,
    /// Least distance to points of earlier scatters, m; `None`: the mean of both spacings.
    pub clear: Option<f32>,
    /// Steepest slope on which points are accepted, rad from the horizontal.
    pub slope_max: f32,
    /// Lowest and highest altitude of points, m.
    pub altitude: [f32; 2],
    /// Share of the positions that get a point, 0..1; the others stay empty.
    pub density: f32,
    /// Factor of that share by position; `None`: 1 everywhere.
    pub mask: Option<DensityMask>,
    /// Wavelength of the noise that gathers points into patches, m; 0: evenly distributed.
    pub clump: f32,
    /// Key of that noise, from [`clump_key`]; scatters of one key and wavelength have their patches in the same places.
    pub clump_key: u64,
    /// Region; `None`: the whole land.
    pub disc: Option<ScatterDisc>,
    /// Number of points at which the scatter ends; which points are accepted is then random.
    pub max_count: usize,
}

impl Default for ScatterParams {
    /// At least a metre apart over the whole terrain, up to a slope of 0.6 rad.
    fn default() -> Self {
        Self {
            spacing: 1.0,
            clear: None,
            slope_max: 0.6,
            altitude: [f32::MIN, f32::MAX],
            density: 1.0,
            mask: None,
            clump: 0.0,
            clump_key: clump_key(0),
            disc: None,
            max_count: usize::MAX,
        }
    }
}

/// A point of an earlier scatter, from which later ones keep their distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScatterObstacle {
    /// Position, x and z, m.
    pub at: [f32; 2],
    /// Spacing of the scatter that placed it, m.
    pub spacing: f32,
}

/// An accepted point of a scatter, at which a plant is placed.
#[derive(Debug, Clone)]
pub struct ScatterPoint {
    /// Position, x and z, m.
    pub at: [f32; 2],
    /// Stream for the further draws of this point: which plant, rotation, size.
    pub rng: Rng,
}

/// Cells of edge spacing / sqrt 2 over the terrain: the diagonal is one spacing, so that none holds two points.
struct ScatterGrid {
    edge: f32,
    /// First and last cell along x and along z in which candidates are drawn.
    x: [usize; 2],
    z: [usize; 2],
}

impl ScatterGrid {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "places on the land, counted from its edge"
    )]
    fn new(land: &Terrain, params: &ScatterParams) -> Self {
        let edge = params.spacing * std::f32::consts::FRAC_1_SQRT_2;
        let last = land.size.map(|length| ((length / edge).ceil() as usize).max(1) - 1);
        // Only cells that the disc touches are visited; they keep their numbers among the cells of the whole terrain,
        // so that their draws do not depend on the disc.
        let span = |axis: usize| match params.disc {
            None => [0, last[axis]],
            Some(d) => {
                let start = land.center[axis] - land.size[axis] * 0.5;
                let cell = |v: f32| (((v - start) / edge).max(0.0) as usize).min(last[axis]);
                [cell(d.at[axis] - d.radius), cell(d.at[axis] + d.radius)]
            }
        };
        Self { edge, x: span(0), z: span(1) }
    }

    fn width(&self) -> usize {
        self.x[1] - self.x[0] + 1
    }

    fn len(&self) -> u64 {
        self.width() as u64 * (self.z[1] - self.z[0] + 1) as u64
    }
}

/// A candidate by its random priority and its cell among those visited; sorted, the order of acceptance.
type Candidate = (u64, u32);

/// Points of one scatter. Each of four rounds draws a candidate in every cell without a position. In the order of (round,
/// priority, cell) a candidate becomes a position if it lies within the limits, and if no position of this scatter is nearer than the
/// spacing and none of `taken` nearer than allowed, horizontally. A share of the positions, the product of density,
/// mask, fading rim and patches, gets a point, so that a smaller share above 0 leaves out points and moves none. `key`:
/// from [`scatter_key`]; scatters made later do not change the result.
/// # Errors
/// `Limit` beyond the candidates allowed.
/// Own: dart throwing with a grid; a cell with a position gets no further candidates, since no second one fits in.
pub fn scatter(
    land: &Terrain,
    params: &ScatterParams,
    taken: &[ScatterObstacle],
    key: u64,
    limits: &Limits,
) -> Result<Vec<ScatterPoint>> {
    let cells = ScatterGrid::new(land, params);
    limits.check(
        "candidates",
        cells.len().saturating_mul(CANDIDATES_PER_CELL.into()),
        "the number of candidates of a scatter",
    )?;
    // `grid`: index of the position in each cell. A cell is spacing / sqrt 2 wide and holds at most one.
    let obstacles = ObstacleGrid::new(taken, params);
    let mut grid = vec![EMPTY; narrow::<u32, u64>(cells.len(), "cells of a scatter")? as usize];
    let mut positions: Vec<[f32; 2]> = Vec::new();
    let mut points: Vec<ScatterPoint> = Vec::new();
    let mut candidates: Vec<Candidate> = Vec::new();
    for round in 0..CANDIDATES_PER_CELL {
        let key = child(key, u64::from(round));
        candidates.clear();
        // Candidates of this round: one in every empty cell, ordered by a random priority.
        let free = (0_u32..).zip(&grid).filter(|(_, g)| **g == EMPTY);
        candidates.extend(free.map(|(c, _)| (candidate_rng(&cells, key, c as usize).next_u64(), c)));
        // The order of acceptance is random, but the same however the cells are visited.
        candidates.sort_unstable();
        for (_, cell) in &candidates {
            if points.len() >= params.max_count {
                return Ok(points);
            }
            let cell = *cell as usize;
            // One stream per candidate gives its position, its acceptance, and the later draws of the caller.
            let mut rng = candidate_rng(&cells, key, cell);
            rng.next_u64();
            let at = candidate_position(&cells, land, cell, &mut rng);
            let share = if is_allowed(land, params, at) { used_share(land, params, at) } else { 0.0 };
            let drawn = rng.unit_f32();
            if share > 0.0
                && obstacles.is_clear(at)
                && keeps_spacing(&cells, &grid, &positions, cell, at, params.spacing)
            {
                // A position that stays empty keeps its place: later rounds would fill it, and the share would tend to 1.
                grid[cell] = narrow(positions.len(), "positions of a scatter")?;
                positions.push(at);
                if drawn < share {
                    points.push(ScatterPoint { at, rng });
                }
            }
        }
    }
    Ok(points)
}

/// The random stream of a cell's candidate, by row and column among the cells of the whole terrain.
fn candidate_rng(cells: &ScatterGrid, key: u64, cell: usize) -> Rng {
    let (row, column) = (cells.z[0] + cell / cells.width(), cells.x[0] + cell % cells.width());
    Rng::from_key(child(child(key, row as u64), column as u64))
}

/// The candidate position of a cell: uniform within it.
fn candidate_position(cells: &ScatterGrid, land: &Terrain, cell: usize, rng: &mut Rng) -> [f32; 2] {
    let (row, column) = (cells.z[0] + cell / cells.width(), cells.x[0] + cell % cells.width());
    let at = |axis: usize, i: usize, u: f32| (i as f32 + u) * cells.edge - 0.5 * land.size[axis] + land.center[axis];
    let (u, v) = (rng.unit_f32(), rng.unit_f32());
    [at(0, column, u), at(1, row, v)]
}

/// Share, 0 to 1, of the positions at (x, z) that get a point: the product of density, mask, the fading rim of the disc and patches.
fn used_share(land: &Terrain, params: &ScatterParams, at: [f32; 2]) -> f32 {
    let [x, y] = land.relative_position(at);
    let mut share = params.density * params.mask.as_ref().map_or(1.0, |mask| mask.at(x, y));
    if let Some(d) = params.disc {
        let away = math::sqrt_f32(distance_squared(at, d.at));
        share *= 1.0 - smoothstep(1.0 - d.fade, 1.0 + 1e-6, away / d.radius.max(1e-6));
    }
    if params.clump > 0.0 {
        // Patches: the noise is thresholded softly, so that their borders thin out.
        let p = at.map(|v| v / params.clump);
        share *= smoothstep(-0.12, 0.16, noise::fractal2(params.clump_key, p, [1 << 20, 1 << 20], 3));
    }
    share
}

/// Whether (x, z) lies within disc, altitudes, slope and terrain.
fn is_allowed(land: &Terrain, params: &ScatterParams, at: [f32; 2]) -> bool {
    if !land.covers(at[0], at[1]) {
        return false;
    }
    if let Some(d) = params.disc {
        let away = math::sqrt_f32(distance_squared(at, d.at));
        if away > d.radius || away < d.inner {
            return false;
        }
    }
    let h = land.height_at(at[0], at[1]);
    let is_at_altitude = h >= params.altitude[0] && h <= params.altitude[1];
    is_at_altitude && land.normal_at(at[0], at[1]).y >= math::cos_f32(params.slope_max)
}

/// True if no position of the same scatter is nearer than `spacing` (m): cells are spacing / sqrt 2 wide, so two rings of
/// neighbours suffice.
fn keeps_spacing(
    cells: &ScatterGrid,
    grid: &[u32],
    positions: &[[f32; 2]],
    cell: usize,
    at: [f32; 2],
    spacing: f32,
) -> bool {
    // Five by five cells around the candidate; each holds one position at most.
    let width = cells.width();
    let (row, column) = (cell / width, cell % width);
    let rows = grid.len() / width;
    for r in row.saturating_sub(2)..=(row + 2).min(rows - 1) {
        for c in column.saturating_sub(2)..=(column + 2).min(width - 1) {
            if let Some(other) = grid.get(r * width + c).and_then(|g| positions.get(*g as usize))
                && distance_squared(*other, at) < spacing * spacing
            {
                return false;
            }
        }
    }
    true
}

/// Squared distance in the ground plane, m^2.
fn distance_squared(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

/// Points of earlier scatters, each with the distance to keep from it.
struct ObstacleGrid {
    grid: NeighbourGrid,
    /// Position, x and z, and square of the distance to keep.
    obstacles: Vec<([f32; 2], f32)>,
    /// Half edge of the search box: the largest distance to keep, with a margin for rounding, m.
    reach: f32,
}

impl ObstacleGrid {
    fn new(taken: &[ScatterObstacle], params: &ScatterParams) -> Self {
        let min_distance = |t: &ScatterObstacle| params.clear.unwrap_or(0.5 * (t.spacing + params.spacing));
        let most = taken.iter().map(min_distance).fold(0.0, f32::max);
        let positions = taken.iter().map(|t| Vec3::new(t.at[0], 0.0, t.at[1]));
        Self {
            grid: NeighbourGrid::new(most.max(1e-3), (0..).zip(positions)),
            obstacles: taken.iter().map(|t| (t.at, min_distance(t) * min_distance(t))).collect(),
            reach: most * 1.001,
        }
    }

    /// True if no obstacle is nearer than the distance to keep from it.
    fn is_clear(&self, at: [f32; 2]) -> bool {
        let (p, arm) = (Vec3::new(at[0], 0.0, at[1]), Vec3::new(self.reach, 0.0, self.reach));
        let mut clear = true;
        self.grid.for_each_in_box(p - arm, p + arm, |i| {
            let (obstacle, least) = self.obstacles[i as usize];
            clear &= distance_squared(obstacle, at) >= least;
        });
        clear
    }
}

/// The key of scatter number `entry` of a scene of this seed, for [`scatter`].
pub fn scatter_key(seed: u64, entry: usize) -> u64 {
    Rng::key(seed, &[Key::from("scatter"), entry.into()])
}

/// The key of the patches in a scene of this seed, for [`ScatterParams::clump_key`].
pub fn clump_key(seed: u64) -> u64 {
    Rng::key(seed, &[Key::from("scatter"), Key::from("clump")])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::terrain::TerrainParams;

    fn land() -> Terrain {
        Terrain::generate(&TerrainParams { n: 7, size: 120.0, amplitude: 14.0, ..TerrainParams::default() })
            .expect("land")
    }

    fn params(spacing: f32) -> ScatterParams {
        ScatterParams { spacing, ..ScatterParams::default() }
    }

    fn scattered(land: &Terrain, params: &ScatterParams, taken: &[ScatterObstacle], entry: usize) -> Vec<[f32; 2]> {
        let points = scatter(land, params, taken, scatter_key(3, entry), &Limits::default()).expect("points");
        points.into_iter().map(|s| s.at).collect()
    }

    fn nearest(a: &[[f32; 2]], b: &[[f32; 2]]) -> f32 {
        let all = a.iter().flat_map(|p| b.iter().map(move |q| distance_squared(*p, *q)).filter(|d| *d > 0.0));
        math::sqrt_f32(all.fold(f32::MAX, f32::min))
    }

    #[test]
    fn limits_are_exact() {
        let land = land();
        let all = scattered(&land, &params(3.0), &[], 0);
        let nearby = nearest(&all, &all);
        assert!((3.0..3.1).contains(&nearby) && all.len() > 600, "{nearby} m, {} plants", all.len());
        let disc = ScatterDisc { at: [10.0, -20.0], radius: 30.0, inner: 8.0, fade: 0.0 };
        let narrow = ScatterParams { slope_max: 0.3, altitude: [-3.0, 6.0], disc: Some(disc), ..params(1.5) };
        let some = scattered(&land, &narrow, &[], 0);
        assert!(some.len() > 50);
        for p in &some {
            let h = land.height_at(p[0], p[1]);
            let slope = math::acos_f32(land.normal_at(p[0], p[1]).y);
            let away = math::sqrt_f32(distance_squared(*p, disc.at));
            assert!((-3.0..=6.0).contains(&h) && slope <= 0.3001 && (8.0..=30.0).contains(&away), "{p:?}");
        }
        assert!(all.iter().any(|p| land.height_at(p[0], p[1]) > 6.0), "there is land beyond the limit");
        assert_eq!(scattered(&land, &ScatterParams { max_count: 17, ..params(3.0) }, &[], 0)[..], all[..17]);
        let mut tight = Limits::default();
        tight.set("candidates", "100").expect("limit");
        assert!(scatter(&land, &params(3.0), &[], 1, &tight).is_err());
    }

    #[test]
    fn masks_and_density_thin_out() {
        let land = land();
        let left = DensityMask { width: 2, height: 1, values: vec![1.0, 0.0] };
        let half = scattered(&land, &ScatterParams { mask: Some(left), ..params(2.0) }, &[], 0);
        assert!(half.len() > 300 && half.iter().all(|p| p[0] <= 0.0));
        let positions = scattered(&land, &params(2.0), &[], 0);
        let all = positions.len();
        let grey = |values: Vec<f32>| Some(DensityMask { width: values.len(), height: 1, values });
        let thinned = [
            (0.6, ScatterParams { density: 0.6, ..params(2.0) }),
            (0.1, ScatterParams { density: 0.1, ..params(2.0) }),
            (0.5, ScatterParams { mask: grey(vec![0.5]), ..params(2.0) }),
            (0.25, ScatterParams { density: 0.5, mask: grey(vec![0.7, 0.3]), ..params(2.0) }),
        ];
        for (share, params) in thinned {
            let some = scattered(&land, &params, &[], 0);
            let is = some.len() as f32 / all as f32;
            assert!((is - share).abs() < 0.06, "{is} of the positions instead of {share}");
            assert!(some.iter().all(|at| positions.contains(at)), "a thinner scatter moves no plant");
        }
        assert!(scattered(&land, &ScatterParams { density: 0.0, ..params(2.0) }, &[], 0).is_empty());
        let clumps = scattered(&land, &ScatterParams { clump: 25.0, ..params(2.0) }, &[], 0).len();
        assert!(clumps < all * 8 / 10 && clumps > all / 10, "{clumps} of {all}");
    }

    /// A rim that fades leaves the share 1 - 3 r^2 + 2 r^3 of the positions at r radii from the centre: three tenths of a disc.
    #[test]
    fn a_rim_fades_evenly() {
        let land = Terrain::generate(&TerrainParams { n: 5, size: 120.0, amplitude: 0.0, ..TerrainParams::default() })
            .expect("land");
        let of = |fade| {
            let disc = ScatterDisc { at: [0.0; 2], radius: 50.0, inner: 0.0, fade };
            scattered(&land, &ScatterParams { disc: Some(disc), ..params(1.5) }, &[], 0)
        };
        let within = |all: &[[f32; 2]], radius: f32| {
            all.iter().filter(|at| distance_squared(**at, [0.0; 2]) < radius * radius).count() as f32
        };
        let (full, faded) = (of(0.0), of(1.0));
        // At the very rim, where no share is left, a position may be taken by another one.
        let moved = faded.iter().filter(|at| !full.contains(at)).count();
        assert!(moved * 50 < faded.len(), "a fading rim moves {moved} plants");
        // Of the whole disc, and of its inner half: 1 - 6 / 16 + 4 (1 / 5) / 8.
        for (radius, share) in [(50.0, 0.3), (25.0, 0.725)] {
            let is = within(&faded, radius) / within(&full, radius);
            assert!((is - share).abs() < 0.05, "{is} within {radius} m instead of {share}");
        }
    }

    #[test]
    fn patches_follow_the_seed() {
        let land = land();
        let densities = |seed| {
            let patchy =
                ScatterParams { clump: 25.0, clump_key: clump_key(seed), slope_max: 1.5, ..ScatterParams::default() };
            let places = (0..400_u16).map(|k| [f32::from(k % 20) * 5.0 - 50.0, f32::from(k / 20) * 5.0 - 50.0]);
            places.map(|at| used_share(&land, &patchy, at)).collect::<Vec<f32>>()
        };
        let (one, other) = (densities(1), densities(2));
        let apart = one.iter().zip(&other).filter(|(a, b)| (**a - **b).abs() > 0.5).count();
        assert!(apart > 30, "{apart} of 400 places are within a patch of one seed and outside those of the other");
    }

    #[test]
    fn new_entries_move_none() {
        let land = land();
        let trees = scattered(&land, &params(6.0), &[], 0);
        let taken: Vec<ScatterObstacle> = trees.iter().map(|at| ScatterObstacle { at: *at, spacing: 6.0 }).collect();
        let shrubs = scattered(&land, &params(2.0), &taken, 1);
        assert_eq!(trees, scattered(&land, &params(6.0), &[], 0));
        assert!(!shrubs.is_empty() && nearest(&shrubs, &trees) >= 4.0);
        let close = scattered(&land, &ScatterParams { clear: Some(0.5), ..params(2.0) }, &taken, 1);
        let gap = nearest(&close, &trees);
        assert!((0.5..1.0).contains(&gap), "{gap}");
    }

    #[test]
    fn a_disc_takes_nothing_from_its_surroundings() {
        // Positions away from the rim do not depend on the radius of the disc.
        let land = land();
        let of = |radius| {
            let disc = ScatterDisc { at: [0.0; 2], radius, inner: 0.0, fade: 0.0 };
            let mut all = scattered(&land, &ScatterParams { disc: Some(disc), ..params(3.0) }, &[], 0);
            all.retain(|p| distance_squared(*p, [0.0; 2]) < 100.0);
            all.len()
        };
        assert!(of(25.0).abs_diff(of(40.0)) <= 3);
    }
}
