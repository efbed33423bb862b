//! Contact search: \[catkin\] 4.2.1, with swept spheres in place of positions, so that fast catkins cannot tunnel.

use glam::{DVec3, IVec3, Vec3};

use super::particles::{Catkin, CatkinState};
use super::{FlightParams, FlightSimulation, SideBoundary};
use crate::flight::tuning::{ENCOUNTER_TIME, MAX_CELLS_PER_AXIS, PLANES_PER_TASK, REST_CELL, ROUNDING_MARGIN};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::neighbours::NeighbourGrid;
use osier_base::par::par_map;
use osier_base::rng::Rng;

/// A catkin that was airborne at the beginning of the step, with its path over the step.
#[derive(Debug, Clone, Copy)]
struct SweptCatkin {
    id: u32,
    root: u32,
    /// Displacement in the step, m.
    way: Vec3,
    reach: f32,
}

impl SweptCatkin {
    /// Whether two catkins came within reach. `between`: from the midpoint of this one's path to that of the other's.
    fn comes_within_reach(&self, other: &Self, between: Vec3) -> bool {
        // Swept spheres: the closest approach of two linear motions over the step, in relative coordinates.
        let way = other.way - self.way;
        let start = between - way * 0.5;
        let square = way.length_squared();
        let s = if square > 0.0 { (-start.dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
        let reach = self.reach + other.reach;
        (start + way * s).length_squared() <= reach * reach
    }
}

/// Bounding sphere of a swept catkin: midpoint of its path, and its reach plus half of its path relative to the mean
/// drift. Compact in memory, since this sphere rejects most pairs.
#[derive(Debug, Clone, Copy, Default)]
struct BoundingSphere {
    middle: Vec3,
    radius: f32,
}

/// Offsets in x and y of the neighbouring rows that a cell is tested against. Together with the next cell of its own row they
/// hold half of its 26 neighbours, so that every pair of cells is visited once.
const FORWARD_ROWS: [(i32, i32); 4] = [(0, 1), (1, -1), (1, 0), (1, 1)];

/// Airborne catkins sorted into the cells of a uniform grid; cells along z are contiguous in memory.
#[derive(Debug, Clone, Default)]
pub(super) struct ContactGrid {
    /// Airborne catkins in the order of the list of catkins, and their bounding spheres in the same order.
    flyers: Vec<SweptCatkin>,
    loose: Vec<BoundingSphere>,
    /// The spheres in the order of cells, and the flyer of each.
    balls: Vec<BoundingSphere>,
    whose: Vec<u32>,
    /// Index of the first sphere of each cell, and the total.
    begins: Vec<u32>,
    count: IVec3,
    /// Whether x and z are periodic.
    round: [bool; 2],
    low: Vec3,
    size: Vec3,
}

impl ContactGrid {
    /// Collects catkins that were airborne when the step began. With `begin`, also resets the paths of all catkins for the
    /// next step.
    fn collect_flyers(&mut self, options: &FlightParams, catkins: &mut [Catkin], begin: bool) {
        self.flyers.clear();
        self.loose.clear();
        self.round = options.edges.map(|e| e == SideBoundary::Periodic);
        (self.low, self.size) = (options.inside.min, options.inside.size());
        // A catkin that landed in this step is included: its path ends at the surface.
        let stick = narrow(options.stick_radius);
        for c in catkins {
            if c.free && c.state.is_seen() {
                let way = c.travel.as_vec3();
                let middle = self.wrap((c.x - c.travel * 0.5).as_vec3());
                self.flyers.push(SweptCatkin { id: c.id, root: c.root, way, reach: c.radius.max(stick) });
                self.loose.push(BoundingSphere { middle, radius: 0.0 });
            }
            if begin {
                c.begin_contact_interval();
            }
        }
    }

    /// Counting sort of the spheres by cell.
    fn sort_into_cells(&mut self) {
        // Subtract the mean drift from all displacements: bounding spheres and cells can then be small.
        let ways = Bounds::of(self.flyers.iter().map(|f| f.way));
        let (drift, stray) = (ways.center(), 0.5 * ways.size().length());
        let mut reach = 0.0_f32;
        for (f, ball) in self.flyers.iter().zip(&mut self.loose) {
            ball.radius = (f.reach + 0.5 * (f.way - drift).length()) * ROUNDING_MARGIN;
            reach = reach.max(f.reach);
        }
        // Cells are about as wide as the mean spacing, but never narrower than the reach of two spheres, so that contacts occur
        // in neighbouring cells only.
        let n = self.flyers.len().max(1) as f32;
        let volume = (self.size.x * self.size.y * self.size.z).max(f32::MIN_POSITIVE);
        let side = (2.0 * reach + stray).max(osier_base::math::pow_f32(volume / n, 1.0 / 3.0)).max(1e-3);
        self.count = (self.size / side).floor().clamp(Vec3::ONE, Vec3::splat(MAX_CELLS_PER_AXIS)).as_ivec3();
        // Counting sort: histogram, prefix sum, scatter.
        let cubes: Vec<u32> = self.loose.iter().map(|b| self.cell_index(self.cell_of(b.middle))).collect();
        let cells = (self.count.x * self.count.y * self.count.z).unsigned_abs() as usize;
        // Counts are stored two cells ahead, so that during the scatter entry c + 1 is the running end of cell c and
        // finally the begin of the next.
        let mut begins = std::mem::take(&mut self.begins);
        begins.clear();
        begins.resize(cells + 2, 0);
        cubes.iter().for_each(|c| begins[*c as usize + 2] += 1);
        (2..cells + 2).for_each(|i| begins[i] += begins[i - 1]);
        self.balls.resize(self.flyers.len(), BoundingSphere::default());
        self.whose.resize(self.flyers.len(), 0);
        for ((i, c), ball) in (0..).zip(cubes).zip(&self.loose) {
            let place = &mut begins[c as usize + 1];
            (self.balls[*place as usize], self.whose[*place as usize]) = (*ball, i);
            *place += 1;
        }
        self.begins = begins;
    }

    /// Position wrapped into the box along periodic axes.
    fn wrap(&self, p: Vec3) -> Vec3 {
        // Most positions are inside: test before dividing.
        let far = p - self.low;
        if far.cmpge(Vec3::ZERO).all() && far.cmplt(self.size).all() {
            return p;
        }
        let turns = (far / self.size).floor() * self.size;
        Vec3::new(if self.round[0] { p.x - turns.x } else { p.x }, p.y, if self.round[1] { p.z - turns.z } else { p.z })
    }

    fn cell_of(&self, p: Vec3) -> IVec3 {
        // Positions outside go to the nearest cell.
        ((p - self.low) / self.size * self.count.as_vec3()).as_ivec3().clamp(IVec3::ZERO, self.count - IVec3::ONE)
    }

    fn cell_index(&self, c: IVec3) -> u32 {
        ((c.x * self.count.y + c.y) * self.count.z + c.z).unsigned_abs()
    }

    /// Range in `balls` and `whose` of the spheres in consecutive cells.
    fn flyers_in_cells(&self, cubes: std::ops::Range<usize>) -> std::ops::Range<usize> {
        self.begins[cubes.start] as usize..self.begins[cubes.end] as usize
    }

    /// Pairs of catkin indices, the smaller first, that came within reach; sorted and unique.
    fn contact_pairs(&self) -> Vec<(u32, u32)> {
        // Each task takes some planes of cells; sorting makes the list independent of the tasks.
        let starts: Vec<i32> = (0..self.count.x).step_by(PLANES_PER_TASK.unsigned_abs() as usize).collect();
        let found = par_map(&starts, |x0| {
            let mut pairs = Vec::new();
            for x in *x0..(*x0 + PLANES_PER_TASK).min(self.count.x) {
                (0..self.count.y).for_each(|y| self.pairs_along_row(x, y, &mut pairs));
            }
            pairs
        });
        let mut pairs: Vec<(u32, u32)> = found.into_iter().flatten().collect();
        pairs.sort_unstable();
        // With one or two cells along a periodic axis, cells are visited more than once.
        pairs.dedup();
        pairs
    }

    /// Rows of cells after the one at (x, y): first cell of each, and its periodic offset.
    fn neighbour_rows(&self, x: i32, y: i32) -> impl Iterator<Item = (usize, Vec3)> {
        FORWARD_ROWS.into_iter().filter_map(move |(dx, dy)| {
            let (mut x, y) = (x + dx, y + dy);
            if y < 0 || y >= self.count.y || (x == self.count.x && !self.round[0]) {
                return None;
            }
            // Beyond the last plane of a periodic axis comes the first, one box size further.
            let mut by = Vec3::ZERO;
            if x == self.count.x {
                (x, by.x) = (0, self.size.x);
            }
            Some((self.cell_index(IVec3::new(x, y, 0)) as usize, by))
        })
    }

    /// Tests a row of cells along z against itself and the rows after it, also across periodic sides.
    fn pairs_along_row(&self, x: i32, y: i32, pairs: &mut Vec<(u32, u32)>) {
        let own = self.cell_index(IVec3::new(x, y, 0)) as usize;
        let rows: Vec<(usize, Vec3)> = self.neighbour_rows(x, y).collect();
        let (n, round) = (self.count.z.unsigned_abs() as usize, Vec3::Z * self.size.z);
        for z in 0..n {
            let here = self.flyers_in_cells(own + z..own + z + 1);
            if here.is_empty() {
                continue;
            }
            // Cells z - 1 to z + 1 of a neighbouring row are contiguous.
            let (before, after) = (z.saturating_sub(1), (z + 2).min(n));
            // Test pairs within the cell, and with the next cell along z, which is contiguous with it.
            let next = self.begins[own + after] as usize;
            here.clone().for_each(|i| self.test_pairs(i, i + 1..next, Vec3::ZERO, pairs));
            let mut meet = |cubes: std::ops::Range<usize>, by: Vec3| {
                let there = self.flyers_in_cells(cubes);
                if !there.is_empty() {
                    here.clone().for_each(|i| self.test_pairs(i, there.clone(), by, pairs));
                }
            };
            rows.iter().for_each(|(row, by)| meet(row + before..row + after, *by));
            // Across the periodic seam in z, in both directions.
            if self.round[1] && z + 1 == n {
                meet(own..own + 1, round);
                rows.iter().for_each(|(row, by)| meet(*row..row + 1, *by + round));
            }
            if self.round[1] && z == 0 {
                rows.iter().for_each(|(row, by)| meet(row + n - 1..row + n, *by - round));
            }
        }
    }

    /// Tests one sphere against others, which are shifted by the periodic offset `by`, m; pairs in one cluster are excluded.
    fn test_pairs(&self, i: usize, others: std::ops::Range<usize>, by: Vec3, pairs: &mut Vec<(u32, u32)>) {
        // Bounding spheres reject most pairs; the exact swept test decides the rest.
        let a = self.balls[i];
        for (b, k) in self.balls[others.clone()].iter().zip(others) {
            // This order of operations gives the same bits with the opposite sign if a and b are swapped.
            let between = (b.middle - a.middle) + by;
            let reach = a.radius + b.radius;
            if between.length_squared() <= reach * reach {
                let [a, b] = [i, k].map(|at| &self.flyers[self.whose[at] as usize]);
                if a.root != b.root && a.comes_within_reach(b, between) {
                    pairs.push((a.id.min(b.id), a.id.max(b.id)));
                }
            }
        }
    }
}

/// Deposited catkins for lookup by location.
struct RestingCatkins<'a> {
    grid: &'a NeighbourGrid,
    /// Largest radius of any deposited catkin, m.
    widest: f32,
    /// Bounds of all deposited catkins with their radii, m.
    bounds: Bounds,
}

impl Catkin {
    /// Ends the path of the past step and begins that of the next one.
    fn begin_contact_interval(&mut self) {
        self.travel = DVec3::ZERO;
        self.free = self.state == CatkinState::Airborne;
        self.moved_since_check = false;
    }
}

impl FlightSimulation {
    /// Finds the contacts of this step and joins them: airborne pairs with probability `stick_probability`, others always.
    pub(super) fn join_contacts(&mut self, t: f64) {
        // One draw per pair and encounter, not per step, addressed by both indices and the time.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "seconds of a clip")]
        let encounter = (t / ENCOUNTER_TIME) as u64;
        let pairs = self.airborne_contacts();
        let chance = self.options.stick_probability;
        for (i, j) in pairs {
            let holds = chance >= 1.0 || {
                let address = ["stick".into(), i.into(), j.into(), encounter.into()];
                Rng::at(self.options.seed, &address).chance(chance)
            };
            if holds {
                self.join_catkins(i, j, t);
            }
        }
        for (i, j) in self.resting_contacts() {
            self.join_catkins(i, j, t);
        }
        if self.present.deposited {
            self.catkins.iter_mut().for_each(Catkin::begin_contact_interval);
        }
    }

    fn airborne_contacts(&mut self) -> Vec<(u32, u32)> {
        // Without deposits no other search needs the paths of this step, so that they are reset here.
        self.contact_grid.collect_flyers(&self.options, &mut self.catkins, !self.present.deposited);
        if self.contact_grid.flyers.len() < 2 {
            return Vec::new();
        }
        self.contact_grid.sort_into_cells();
        self.contact_grid.contact_pairs()
    }

    /// Pairs closer than the sum of their radii of which one is deposited: newly deposited, displaced and airborne catkins
    /// against all deposited ones.
    fn resting_contacts(&self) -> Vec<(u32, u32)> {
        if !self.present.deposited {
            return Vec::new();
        }
        // Deposits go into a sparse grid; their common bounds reject most airborne catkins.
        let rests = self.catkins.iter().filter(|c| c.state.is_deposited());
        let grid = NeighbourGrid::new(REST_CELL, rests.clone().map(|c| (c.id, c.x.as_vec3())));
        if grid.is_empty() {
            return Vec::new();
        }
        let widest = rests.map(|c| c.radius).fold(0.0, f32::max);
        let bounds =
            Bounds::of(self.catkins.iter().filter(|c| c.state.is_deposited()).map(|c| c.x.as_vec3())).expanded(widest);
        let chunks: Vec<&[Catkin]> = self.catkins.chunks(super::CATKINS_PER_TASK).collect();
        let found = par_map(&chunks, |chunk| {
            let mut pairs = Vec::new();
            let resting = RestingCatkins { grid: &grid, widest, bounds };
            for c in chunk
                .iter()
                .filter(|c| c.state == CatkinState::Airborne || (c.state.is_deposited() && c.moved_since_check))
            {
                self.pairs_with_resting(c, &resting, &mut pairs);
            }
            pairs
        });
        let mut pairs: Vec<(u32, u32)> = found.into_iter().flatten().collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// Adds the pairs of a catkin with the deposited ones that its path in this step touches, except in the same cluster.
    fn pairs_with_resting(&self, c: &Catkin, resting: &RestingCatkins<'_>, pairs: &mut Vec<(u32, u32)>) {
        let RestingCatkins { grid, widest, bounds } = *resting;
        let (end, reach) = (c.x.as_vec3(), c.radius + widest);
        let start = (c.x - c.travel).as_vec3();
        let way = end - start;
        // Near a periodic side, test the images of the path beyond the opposite side too; members of clusters may lie outside the box.
        for shift in self.image_shifts(end, 2.0 * reach + way.length()) {
            let (start, end) = (start + shift, end + shift);
            let (low, high) = (start.min(end) - Vec3::splat(reach), start.max(end) + Vec3::splat(reach));
            if high.cmplt(bounds.min).any() || low.cmpgt(bounds.max).any() {
                continue;
            }
            grid.for_each_in_box(low, high, |id| {
                let other = self.catkin(id);
                if other.root == c.root {
                    return;
                }
                let from = start - other.x.as_vec3();
                let (square, closing) = (way.length_squared(), -from.dot(way));
                // An airborne catkin joins a deposit that it approaches, not the heap that it was torn or lifted off.
                if c.state == CatkinState::Airborne && closing <= 0.0 {
                    return;
                }
                let s = if square > 0.0 { (closing / square).clamp(0.0, 1.0) } else { 0.0 };
                let touch = c.radius + other.radius;
                if (from + way * s).length_squared() <= touch * touch {
                    pairs.push((c.id.min(id), c.id.max(id)));
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{FlightParams, SkyRelease, sky_starts};
    use super::*;
    use osier_scene::solid::Solids;

    fn some(n: u32, options: FlightParams) -> FlightSimulation {
        let sky_box = SkyRelease { seed: 5, count: n, inside: options.inside, band: [0.3, 0.95], duration: 0.0 };
        let solids = Arc::new(Solids::new(Vec::new(), true));
        let starts = sky_starts(&sky_box, &solids);
        FlightSimulation::new(options, solids, &starts)
    }

    fn brute(flights: &FlightSimulation) -> Vec<(u32, u32)> {
        let all: Vec<&Catkin> = flights.by_id().collect();
        let mut pairs = Vec::new();
        for (i, a) in all.iter().enumerate() {
            for b in &all[i + 1..] {
                let flyer = |c: &Catkin| SweptCatkin { id: c.id, root: c.root, way: c.travel.as_vec3(), reach: 0.2 };
                let [from, to] = [a, b].map(|c| (c.x - c.travel * 0.5).as_vec3());
                let (a, b) = (flyer(a), flyer(b));
                let between = flights.nearest_image((to - from).as_dvec3()).as_vec3();
                if a.comes_within_reach(&b, between) {
                    pairs.push((a.id, b.id));
                }
            }
        }
        pairs
    }

    #[test]
    fn grid_contacts_equal_brute_force_contacts() {
        for edges in
            [[SideBoundary::Recycle; 2], [SideBoundary::Periodic; 2], [SideBoundary::Periodic, SideBoundary::Exit]]
        {
            let mut flights = some(2000, FlightParams { edges, stick_radius: 0.2, ..FlightParams::default() });
            for (i, c) in (0..).zip(&mut flights.catkins) {
                let f = f64::from(i);
                c.travel = DVec3::new((f * 0.37) % 1.0 - 0.5, (f * 0.71) % 1.0 - 0.5, (f * 0.13) % 2.0 - 1.0);
            }
            let found = flights.airborne_contacts();
            assert!(found.len() > 10);
            assert_eq!(found, brute(&flights), "{edges:?}");
        }
    }

    /// A thousand pairs that cross at ten radii per contact search: all contacts are found.
    #[test]
    fn fast_catkins_do_not_tunnel() {
        let mut flights = some(2000, FlightParams { stick_radius: 0.0, ..FlightParams::default() });
        let inside = flights.options.inside.min.as_dvec3();
        let mut draw = Rng::at(9, &["cross".into()]);
        for k in 0..1000_u32 {
            let f = f64::from(k);
            let place = inside
                + DVec3::new(
                    0.5 + (f % 10.0) * 3.4,
                    0.5 + (f / 10.0 % 10.0).floor() * 3.4,
                    0.5 + (f / 100.0).floor() * 3.4,
                );
            let any = |draw: &mut Rng| DVec3::new(draw.normal(), draw.normal(), draw.normal());
            let (way, aside) = (any(&mut draw).normalize() * 0.2, any(&mut draw));
            // They pass each other closer than both radii at some moment of the interval.
            let moment = draw.unit_f64();
            let miss = (aside - way * (aside.dot(way) / way.length_squared())).normalize_or_zero() * 0.015;
            let c = flights.catkin_mut(2 * k);
            (c.travel, c.x) = (way * 0.5, place + way * (0.5 - moment * 0.5));
            let c = flights.catkin_mut(2 * k + 1);
            (c.travel, c.x) = (way * -0.5, place - way * (0.5 - moment * 0.5) + miss);
        }
        let pairs = flights.airborne_contacts();
        let crossing = (0..1000).filter(|k| pairs.binary_search(&(2 * k, 2 * k + 1)).is_ok()).count();
        assert_eq!(crossing, 1000);
    }
}
