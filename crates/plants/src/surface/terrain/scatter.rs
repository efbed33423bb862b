//! Plants strewn over land: dart throwing in rounds, every candidate drawn at an address of its own.

use super::Land;
use osier_base::Result;
use osier_base::limits::Limits;
use osier_base::math::{self, smoothstep};
use osier_base::noise;
use osier_base::rng::{Key, Rng, child, mix64};

/// Candidates of a cell.
const ROUNDS: u32 = 4;
/// Marks a cell without a plant.
const EMPTY: u32 = u32::MAX;

/// A disc in which an entry is strewn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Middle, x and z, m.
    pub at: [f32; 2],
    /// Nothing stands farther away, m, or nearer.
    pub radius: f32,
    /// Nothing stands nearer, m.
    pub inner: f32,
    /// Share of the radius over which it thins out towards the rim, 0..1.
    pub fade: f32,
}

/// Grey picture over the whole land, row 0 at -z: black bears nothing, white everything.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 0..1.
    pub values: Vec<f32>,
}

impl Mask {
    /// The pixel at shares of the way from -x and -z.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the picture")]
    fn at(&self, x: f32, y: f32) -> f32 {
        let pick = |v: f32, n: usize| ((v.clamp(0.0, 1.0) * n as f32) as usize).min(n.saturating_sub(1));
        self.values.get(pick(y, self.height) * self.width + pick(x, self.width)).copied().unwrap_or(0.0)
    }
}

/// What is strewn, and where it may stand.
#[derive(Debug, Clone, PartialEq)]
pub struct Sowing {
    /// Least distance between two, m, > 0.
    pub spacing: f32,
    /// Least distance to what earlier sowings put up; half of both spacings without.
    pub clear: Option<f32>,
    /// Steepest slope, rad.
    pub slope_max: f32,
    /// Lowest and highest place, m.
    pub altitude: [f32; 2],
    /// Chance of a place, 0..1.
    pub density: f32,
    /// Chances over the land.
    pub mask: Option<Mask>,
    /// Length of the patches in which they gather, m; 0 is evenly.
    pub clump: f32,
    /// Where.
    pub disc: Option<Disc>,
    /// Most of them.
    pub max_count: usize,
}

impl Default for Sowing {
    /// Evenly, a metre apart, wherever it is not too steep.
    fn default() -> Self {
        Self {
            spacing: 1.0,
            clear: None,
            slope_max: 0.6,
            altitude: [f32::MIN, f32::MAX],
            density: 1.0,
            mask: None,
            clump: 0.0,
            disc: None,
            max_count: usize::MAX,
        }
    }
}

/// What stands already.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Taken {
    /// x and z, m.
    pub at: [f32; 2],
    /// Spacing of its sowing, m.
    pub spacing: f32,
}

/// A place that was found.
#[derive(Debug, Clone)]
pub struct Spot {
    /// x and z, m.
    pub at: [f32; 2],
    /// Its own draws: which plant, turn, size.
    pub rng: Rng,
}

/// Cells of edge spacing / sqrt 2 over the land: none holds two plants.
struct Cells {
    edge: f32,
    /// First and last cell along x and along z that is looked at.
    x: [usize; 2],
    z: [usize; 2],
}

impl Cells {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "places on the land, counted from its edge"
    )]
    fn new(land: &Land, sowing: &Sowing) -> Self {
        let edge = sowing.spacing * std::f32::consts::FRAC_1_SQRT_2;
        let half = land.size * 0.5;
        let last = ((land.size / edge).ceil() as usize).max(1) - 1;
        let span = |axis: usize| match sowing.disc {
            None => [0, last],
            Some(d) => {
                let cell = |v: f32| (((v + half) / edge).max(0.0) as usize).min(last);
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

/// Candidate: its priority and its cell among those looked at.
type Candidate = (u64, u32);

/// Places for one sowing. Four rounds over the cells; each draws a candidate per cell, and in the order of (round,
/// priority, cell) it is taken if it lies within the limits, its chance is met, and none of the same sowing is nearer
/// than its spacing and none of `taken` nearer than allowed. Distances are level. `key`: the address of the sowing;
/// what is strewn later moves nothing.
/// # Errors
/// `Limit` beyond the candidates allowed.
/// Own: dart throwing with a grid; a cell that holds a plant is drawn no more, as no other fits in.
pub fn scatter(land: &Land, sowing: &Sowing, taken: &[Taken], key: u64, limits: &Limits) -> Result<Vec<Spot>> {
    let cells = Cells::new(land, sowing);
    limits.check("candidates", cells.len().saturating_mul(ROUNDS.into()), "the number of candidates of a scatter")?;
    let near = Near::new(taken, sowing, land.size);
    let mut grid = vec![EMPTY; usize::try_from(cells.len()).unwrap_or(usize::MAX)];
    let mut spots: Vec<Spot> = Vec::new();
    let mut candidates: Vec<Candidate> = Vec::new();
    for round in 0..ROUNDS {
        let key = child(key, u64::from(round));
        candidates.clear();
        let free = grid.iter().enumerate().filter(|(_, g)| **g == EMPTY);
        candidates.extend(free.map(|(c, _)| (draw(&cells, key, c).next_u64(), u32::try_from(c).unwrap_or(EMPTY))));
        candidates.sort_unstable();
        for (_, cell) in &candidates {
            if spots.len() >= sowing.max_count {
                return Ok(spots);
            }
            let cell = *cell as usize;
            let mut rng = draw(&cells, key, cell);
            rng.next_u64();
            let at = place(&cells, land, cell, &mut rng);
            let chance = chance(land, sowing, at);
            if rng.unit_f32() < chance && near.is_clear(at) && fits((&cells, &grid, &spots), cell, at, sowing.spacing) {
                grid[cell] = u32::try_from(spots.len()).unwrap_or(EMPTY);
                spots.push(Spot { at, rng });
            }
        }
    }
    Ok(spots)
}

/// The draws of a cell's candidate, at (row, column) of the whole land's cells.
fn draw(cells: &Cells, key: u64, cell: usize) -> Rng {
    let (row, column) = (cells.z[0] + cell / cells.width(), cells.x[0] + cell % cells.width());
    Rng::from_key(child(child(key, row as u64), column as u64))
}

fn place(cells: &Cells, land: &Land, cell: usize, rng: &mut Rng) -> [f32; 2] {
    let (row, column) = (cells.z[0] + cell / cells.width(), cells.x[0] + cell % cells.width());
    let at = |i: usize, u: f32| (i as f32 + u) * cells.edge - 0.5 * land.size;
    let (u, v) = (rng.unit_f32(), rng.unit_f32());
    [at(column, u), at(row, v)]
}

/// Chance that a place bears a plant; 0 outside of the limits.
fn chance(land: &Land, sowing: &Sowing, at: [f32; 2]) -> f32 {
    let half = land.size * 0.5;
    if at.iter().any(|v| v.abs() > half) {
        return 0.0;
    }
    let mut chance = sowing.density;
    if let Some(d) = sowing.disc {
        let away = math::sqrt_f32((at[0] - d.at[0]) * (at[0] - d.at[0]) + (at[1] - d.at[1]) * (at[1] - d.at[1]));
        if away > d.radius || away < d.inner {
            return 0.0;
        }
        chance *= 1.0 - smoothstep(1.0 - d.fade, 1.0 + 1e-6, away / d.radius.max(1e-6));
    }
    let h = land.height_at(at[0], at[1]);
    if h < sowing.altitude[0] || h > sowing.altitude[1] {
        return 0.0;
    }
    if land.normal_at(at[0], at[1]).y < math::cos_f32(sowing.slope_max) {
        return 0.0;
    }
    if sowing.clump > 0.0 {
        let p = at.map(|v| v / sowing.clump);
        chance *= smoothstep(-0.12, 0.16, noise::fractal2(mix64(&[0xC1_0D]), p, [1 << 20, 1 << 20], 3));
    }
    if let Some(mask) = &sowing.mask {
        chance *= mask.at(at[0] / land.size + 0.5, at[1] / land.size + 0.5);
    }
    chance
}

/// True if none of the same sowing is nearer than `spacing`.
fn fits((cells, grid, spots): (&Cells, &[u32], &[Spot]), cell: usize, at: [f32; 2], spacing: f32) -> bool {
    let width = cells.width();
    let (row, column) = (cell / width, cell % width);
    let rows = grid.len() / width;
    for r in row.saturating_sub(2)..=(row + 2).min(rows - 1) {
        for c in column.saturating_sub(2)..=(column + 2).min(width - 1) {
            if let Some(other) = grid.get(r * width + c).and_then(|g| spots.get(*g as usize))
                && apart(other.at, at) < spacing * spacing
            {
                return false;
            }
        }
    }
    true
}

fn apart(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

/// What stands already, sorted into square cells as large as the largest distance to keep.
struct Near {
    edge: f32,
    half: f32,
    side: usize,
    /// Where each cell's points begin in `points`.
    starts: Vec<usize>,
    /// Place and square of the distance to keep.
    points: Vec<([f32; 2], f32)>,
}

impl Near {
    fn new(taken: &[Taken], sowing: &Sowing, size: f32) -> Self {
        let keep = |t: &Taken| sowing.clear.unwrap_or(0.5 * (t.spacing + sowing.spacing));
        let most = taken.iter().map(keep).fold(0.0, f32::max);
        // No more cells than are worth their memory.
        let edge = most.max(size / 2048.0).max(1e-3);
        let mut near = Self { edge, half: size * 0.5, side: 0, starts: Vec::new(), points: Vec::new() };
        near.side = near.cell(near.half) + 1;
        let index = |t: &Taken| near.cell(t.at[1]) * near.side + near.cell(t.at[0]);
        let mut sorted: Vec<(usize, usize)> = taken.iter().enumerate().map(|(i, t)| (index(t), i)).collect();
        sorted.sort_unstable();
        let mut starts = vec![0; near.side * near.side + 1];
        for (cell, _) in &sorted {
            starts[cell + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        near.points = sorted.iter().filter_map(|(_, i)| taken.get(*i)).map(|t| (t.at, keep(t) * keep(t))).collect();
        near.starts = starts;
        near
    }

    /// Places beyond the land count to its border.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the land")]
    fn cell(&self, v: f32) -> usize {
        let cell = ((v.clamp(-self.half, self.half) + self.half) / self.edge) as usize;
        if self.side > 0 { cell.min(self.side - 1) } else { cell }
    }

    fn is_clear(&self, at: [f32; 2]) -> bool {
        if self.points.is_empty() {
            return true;
        }
        let (x, z) = (self.cell(at[0]), self.cell(at[1]));
        let last = self.side - 1;
        (z.saturating_sub(1)..=(z + 1).min(last)).all(|r| {
            let (first, end) = (r * self.side + x.saturating_sub(1), r * self.side + (x + 1).min(last) + 1);
            let row = self.starts.get(first).zip(self.starts.get(end)).and_then(|(a, b)| self.points.get(*a..*b));
            row.unwrap_or_default().iter().all(|(p, keep)| apart(*p, at) >= *keep)
        })
    }
}

/// The address of a scene's sowing number `entry`.
pub fn address(seed: u64, entry: usize) -> u64 {
    Rng::key(seed, &[Key::from("scatter"), entry.into()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::terrain::Relief;

    fn land() -> Land {
        Land::raise(&Relief { n: 7, size: 120.0, amplitude: 14.0, ..Relief::default() }).expect("land")
    }

    fn sowing(spacing: f32) -> Sowing {
        Sowing { spacing, ..Sowing::default() }
    }

    fn sown(land: &Land, sowing: &Sowing, taken: &[Taken], entry: usize) -> Vec<[f32; 2]> {
        let spots = scatter(land, sowing, taken, address(3, entry), &Limits::default()).expect("spots");
        spots.into_iter().map(|s| s.at).collect()
    }

    fn nearest(a: &[[f32; 2]], b: &[[f32; 2]]) -> f32 {
        let all = a.iter().flat_map(|p| b.iter().map(move |q| apart(*p, *q)).filter(|d| *d > 0.0));
        math::sqrt_f32(all.fold(f32::MAX, f32::min))
    }

    #[test]
    fn limits_are_exact() {
        let land = land();
        let all = sown(&land, &sowing(3.0), &[], 0);
        let nearby = nearest(&all, &all);
        assert!((3.0..3.1).contains(&nearby) && all.len() > 600, "{nearby} m, {} plants", all.len());
        let disc = Disc { at: [10.0, -20.0], radius: 30.0, inner: 8.0, fade: 0.0 };
        let narrow = Sowing { slope_max: 0.3, altitude: [-3.0, 6.0], disc: Some(disc), ..sowing(1.5) };
        let some = sown(&land, &narrow, &[], 0);
        assert!(some.len() > 50);
        for p in &some {
            let h = land.height_at(p[0], p[1]);
            let slope = math::acos_f32(land.normal_at(p[0], p[1]).y);
            let away = math::sqrt_f32(apart(*p, disc.at));
            assert!((-3.0..=6.0).contains(&h) && slope <= 0.3001 && (8.0..=30.0).contains(&away), "{p:?}");
        }
        assert!(all.iter().any(|p| land.height_at(p[0], p[1]) > 6.0), "there is land beyond the limit");
        assert_eq!(sown(&land, &Sowing { max_count: 17, ..sowing(3.0) }, &[], 0)[..], all[..17]);
        let mut tight = Limits::default();
        tight.set("candidates", "100").expect("limit");
        assert!(scatter(&land, &sowing(3.0), &[], 1, &tight).is_err());
    }

    #[test]
    fn masks_and_density_thin_out() {
        let land = land();
        let left = Mask { width: 2, height: 1, values: vec![1.0, 0.0] };
        let half = sown(&land, &Sowing { mask: Some(left), ..sowing(2.0) }, &[], 0);
        assert!(half.len() > 300 && half.iter().all(|p| p[0] <= 0.0));
        let all = sown(&land, &sowing(2.0), &[], 0).len();
        let thin = sown(&land, &Sowing { density: 0.03, ..sowing(2.0) }, &[], 0).len();
        assert!(thin * 2 < all && thin * 10 > all, "{thin} of {all}");
        assert!(sown(&land, &Sowing { density: 0.0, ..sowing(2.0) }, &[], 0).is_empty());
        let clumps = sown(&land, &Sowing { clump: 25.0, ..sowing(2.0) }, &[], 0).len();
        assert!(clumps < all * 8 / 10 && clumps > all / 10, "{clumps} of {all}");
    }

    #[test]
    fn new_entries_move_none() {
        let land = land();
        let trees = sown(&land, &sowing(6.0), &[], 0);
        let taken: Vec<Taken> = trees.iter().map(|at| Taken { at: *at, spacing: 6.0 }).collect();
        let shrubs = sown(&land, &sowing(2.0), &taken, 1);
        assert_eq!(trees, sown(&land, &sowing(6.0), &[], 0));
        assert!(!shrubs.is_empty() && nearest(&shrubs, &trees) >= 4.0);
        let close = sown(&land, &Sowing { clear: Some(0.5), ..sowing(2.0) }, &taken, 1);
        let gap = nearest(&close, &trees);
        assert!((0.5..1.0).contains(&gap), "{gap}");
    }

    #[test]
    fn a_disc_takes_nothing_from_its_surroundings() {
        // What stands inside does not depend on how far the disc reaches, away from its rim.
        let land = land();
        let of = |radius| {
            let disc = Disc { at: [0.0; 2], radius, inner: 0.0, fade: 0.0 };
            let mut all = sown(&land, &Sowing { disc: Some(disc), ..sowing(3.0) }, &[], 0);
            all.retain(|p| apart(*p, [0.0; 2]) < 100.0);
            all.len()
        };
        assert!(of(25.0).abs_diff(of(40.0)) <= 3);
    }
}
