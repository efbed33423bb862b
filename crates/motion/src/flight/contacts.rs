//! Who touches whom: \[catkin\] 4.2.1, with a test of the ways instead of the places, so that nobody passes through.

use glam::{DVec3, IVec3, Vec3};

use super::grid::CellGrid;
use super::particles::{Catkin, CatkinState};
use super::{FlightParams, FlightSimulation, SideBoundary};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::par::par_map;
use osier_base::rng::Rng;

/// Most cubes along an axis.
const MAX_CELLS_PER_AXIS: f32 = 256.0;

/// Side of the cubes that resting ones are sorted into, m.
const REST_CELL: f32 = 0.25;

/// Planes of cubes a task takes at once.
const PLANES_PER_TASK: i32 = 4;

/// One in the air over the time since the last check.
#[derive(Debug, Clone, Copy)]
struct SweptCatkin {
    id: u32,
    root: u32,
    /// Way, m.
    way: Vec3,
    reach: f32,
}

impl SweptCatkin {
    /// Whether the two came within reach of each other. `between`: from half of this one's way to half of the other's.
    fn meets(&self, other: &Self, between: Vec3) -> bool {
        // Swept spheres: the closest approach of two linear motions over the interval, in relative coordinates.
        let way = other.way - self.way;
        let start = between - way * 0.5;
        let square = way.length_squared();
        let s = if square > 0.0 { (-start.dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
        let reach = self.reach + other.reach;
        (start + way * s).length_squared() <= reach * reach
    }
}

/// Keeps a ball's radius from being rounded below what it must hold.
const ROUNDING_MARGIN: f32 = 1.0 + 1e-5;

/// What the search looks at first, side by side: where one was half way, and how far it reached from there on its own way,
/// which is what is left of its way without that of all.
#[derive(Debug, Clone, Copy, Default)]
struct BoundingSphere {
    middle: Vec3,
    radius: f32,
}

/// Rows of cubes after a cube's own, in x and y; with its own and the next cube in z these hold half of its neighbours,
/// so that every two cubes are met once.
const FORWARD_ROWS: [(i32, i32); 4] = [(0, 1), (1, -1), (1, 0), (1, 1)];

/// Flyers by cubes of the box, side by side in memory; cubes that follow each other in z lie side by side too.
#[derive(Debug, Clone, Default)]
pub(super) struct ContactGrid {
    /// In no order.
    flyers: Vec<SweptCatkin>,
    loose: Vec<BoundingSphere>,
    /// The same by cubes, and whose they are.
    balls: Vec<BoundingSphere>,
    whose: Vec<u32>,
    /// Where each cube's flyers begin; one more at the end.
    begins: Vec<u32>,
    count: IVec3,
    /// Which axes go round.
    round: [bool; 2],
    low: Vec3,
    size: Vec3,
}

impl ContactGrid {
    /// All that flew since the last check. Keeps the room that it has. `begin`: the time to the next check begins for them.
    fn gather(&mut self, options: &FlightParams, catkins: &mut [Catkin], begin: bool) {
        self.flyers.clear();
        self.loose.clear();
        self.round = options.edges.map(|e| e == SideBoundary::Periodic);
        (self.low, self.size) = (options.inside.min, options.inside.size());
        let stick = narrow(options.stick_radius);
        for c in catkins {
            if c.free && c.state == CatkinState::Airborne {
                let way = c.travel.as_vec3();
                let middle = self.wrap((c.x - c.travel * 0.5).as_vec3());
                self.flyers.push(SweptCatkin { id: c.id, root: c.root, way, reach: c.radius.max(stick) });
                self.loose.push(BoundingSphere { middle, radius: 0.0 });
            }
            if begin {
                c.begin();
            }
        }
    }

    /// Brings those of one cube together.
    fn sort(&mut self) {
        // Remove the mean drift: what remains of the displacements is small, so bounding spheres and cells are too.
        let ways = Bounds::of(self.flyers.iter().map(|f| f.way));
        let (drift, stray) = (ways.center(), 0.5 * ways.size().length());
        let mut reach = 0.0_f32;
        for (f, ball) in self.flyers.iter().zip(&mut self.loose) {
            ball.radius = (f.reach + 0.5 * (f.way - drift).length()) * ROUNDING_MARGIN;
            reach = reach.max(f.reach);
        }
        // Cells about as wide as the mean spacing, but never narrower than two spheres reach: then only neighbouring
        // cells can hold contacts.
        let n = self.flyers.len().max(1) as f32;
        let volume = (self.size.x * self.size.y * self.size.z).max(f32::MIN_POSITIVE);
        let side = (2.0 * reach + stray).max(osier_base::math::pow_f32(volume / n, 1.0 / 3.0)).max(1e-3);
        self.count = (self.size / side).floor().clamp(Vec3::ONE, Vec3::splat(MAX_CELLS_PER_AXIS)).as_ivec3();
        let cubes: Vec<u32> = self.loose.iter().map(|b| self.index(self.cube(b.middle))).collect();
        let cells = (self.count.x * self.count.y * self.count.z).unsigned_abs() as usize;
        // Counted two places on, so that while they are sorted in, the place before the next cube's is where this one's end.
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

    /// A place in the box along axes that go round.
    fn wrap(&self, p: Vec3) -> Vec3 {
        let far = p - self.low;
        if far.cmpge(Vec3::ZERO).all() && far.cmplt(self.size).all() {
            return p;
        }
        let turns = (far / self.size).floor() * self.size;
        Vec3::new(if self.round[0] { p.x - turns.x } else { p.x }, p.y, if self.round[1] { p.z - turns.z } else { p.z })
    }

    fn cube(&self, p: Vec3) -> IVec3 {
        // What is below the box goes to its first cube, as does what rounding down towards nought brings there.
        ((p - self.low) / self.size * self.count.as_vec3()).as_ivec3().clamp(IVec3::ZERO, self.count - IVec3::ONE)
    }

    fn index(&self, c: IVec3) -> u32 {
        ((c.x * self.count.y + c.y) * self.count.z + c.z).unsigned_abs()
    }

    /// Places of the flyers of some cubes that follow each other.
    fn within(&self, cubes: std::ops::Range<usize>) -> std::ops::Range<usize> {
        self.begins[cubes.start] as usize..self.begins[cubes.end] as usize
    }

    /// Pairs of numbers, the smaller first, that met; sorted, each once.
    fn pairs(&self) -> Vec<(u32, u32)> {
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
        // Where an axis has but one or two cubes and goes round, cubes meet more than once.
        pairs.dedup();
        pairs
    }

    /// Rows of cubes after the one at (x, y): the first cube of each, and how far the row stands from where it is.
    fn neighbour_rows(&self, x: i32, y: i32) -> impl Iterator<Item = (usize, Vec3)> {
        FORWARD_ROWS.into_iter().filter_map(move |(dx, dy)| {
            let (mut x, y) = (x + dx, y + dy);
            if y < 0 || y >= self.count.y || (x == self.count.x && !self.round[0]) {
                return None;
            }
            let mut by = Vec3::ZERO;
            if x == self.count.x {
                (x, by.x) = (0, self.size.x);
            }
            Some((self.index(IVec3::new(x, y, 0)) as usize, by))
        })
    }

    /// Pairs of the flyers in a row of cubes along z with each other and with those of the rows after it.
    fn pairs_along_row(&self, x: i32, y: i32, pairs: &mut Vec<(u32, u32)>) {
        let own = self.index(IVec3::new(x, y, 0)) as usize;
        let rows: Vec<(usize, Vec3)> = self.neighbour_rows(x, y).collect();
        let (n, round) = (self.count.z.unsigned_abs() as usize, Vec3::Z * self.size.z);
        for z in 0..n {
            let here = self.within(own + z..own + z + 1);
            if here.is_empty() {
                continue;
            }
            let (before, after) = (z.saturating_sub(1), (z + 2).min(n));
            let next = self.begins[own + after] as usize;
            here.clone().for_each(|i| self.meet(i, i + 1..next, Vec3::ZERO, pairs));
            let mut meet = |cubes: std::ops::Range<usize>, by: Vec3| {
                let there = self.within(cubes);
                if !there.is_empty() {
                    here.clone().for_each(|i| self.meet(i, there.clone(), by, pairs));
                }
            };
            rows.iter().for_each(|(row, by)| meet(row + before..row + after, *by));
            if self.round[1] && z + 1 == n {
                meet(own..own + 1, round);
                rows.iter().for_each(|(row, by)| meet(*row..row + 1, *by + round));
            }
            if self.round[1] && z == 0 {
                rows.iter().for_each(|(row, by)| meet(row + n - 1..row + n, *by - round));
            }
        }
    }

    /// Pairs of one with others that stand `by` from where they are: the way round.
    fn meet(&self, i: usize, others: std::ops::Range<usize>, by: Vec3, pairs: &mut Vec<(u32, u32)>) {
        let a = self.balls[i];
        for (b, k) in self.balls[others.clone()].iter().zip(others) {
            // In this order, so that it is the same the other way about.
            let between = (b.middle - a.middle) + by;
            let reach = a.radius + b.radius;
            if between.length_squared() <= reach * reach {
                let [a, b] = [i, k].map(|at| &self.flyers[self.whose[at] as usize]);
                if a.root != b.root && a.meets(b, between) {
                    pairs.push((a.id.min(b.id), a.id.max(b.id)));
                }
            }
        }
    }
}

/// All catkins that rest, as the contact search looks them up.
struct RestingCatkins<'a> {
    grid: &'a CellGrid,
    /// Largest radius, m.
    widest: f32,
    /// Box around all of them with their radii, m.
    bounds: Bounds,
}

impl Catkin {
    /// The time to the next check begins.
    fn begin(&mut self) {
        self.travel = DVec3::ZERO;
        self.free = self.state == CatkinState::Airborne;
        self.moved_since_check = false;
    }
}

impl FlightSimulation {
    /// Looks for contacts since the last look and joins what touched.
    pub(super) fn join_contacts(&mut self, t: f64) {
        let check = self.step / u64::from(self.options.check_every.max(1));
        let pairs = self.airborne_contacts();
        let chance = self.options.stick_probability;
        for (i, j) in pairs {
            let holds = chance >= 1.0 || {
                let address = ["stick".into(), i.into(), j.into(), check.into()];
                Rng::at(self.options.seed, &address).chance(chance)
            };
            if holds {
                self.join(i, j, t);
            }
        }
        for (i, j) in self.resting_contacts() {
            self.join(i, j, t);
        }
        if self.present.deposited {
            self.catkins.iter_mut().for_each(Catkin::begin);
        }
    }

    fn airborne_contacts(&mut self) -> Vec<(u32, u32)> {
        // Where nobody rests nothing else asks where they came from.
        self.contact_grid.gather(&self.options, &mut self.catkins, !self.present.deposited);
        if self.contact_grid.flyers.len() < 2 {
            return Vec::new();
        }
        self.contact_grid.sort();
        self.contact_grid.pairs()
    }

    /// Pairs of which one or both rest, by their own radii: who came to rest or moved since the last look with all who
    /// rest, and who flies with all who rest.
    fn resting_contacts(&self) -> Vec<(u32, u32)> {
        if !self.present.deposited {
            return Vec::new();
        }
        let rests = self.catkins.iter().filter(|c| c.state.is_deposited());
        let grid = CellGrid::new(REST_CELL, rests.clone().map(|c| (c.id, c.x.as_vec3())));
        if grid.is_empty() {
            return Vec::new();
        }
        let widest = rests.map(|c| c.radius).fold(0.0, f32::max);
        let bounds =
            Bounds::of(self.catkins.iter().filter(|c| c.state.is_deposited()).map(|c| c.x.as_vec3())).grown(widest);
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

    /// Adds the pairs of a catkin with the resting ones that its path since the last check touches.
    fn pairs_with_resting(&self, c: &Catkin, resting: &RestingCatkins<'_>, pairs: &mut Vec<(u32, u32)>) {
        let RestingCatkins { grid, widest, bounds } = *resting;
        let (end, reach) = (c.x.as_vec3(), c.radius + widest);
        // What lies has no way to look back on: where it was before is not where it rests.
        let start = if c.state == CatkinState::Airborne { (c.x - c.travel).as_vec3() } else { end };
        let (low, high) = (start.min(end) - Vec3::splat(reach), start.max(end) + Vec3::splat(reach));
        if high.cmplt(bounds.min).any() || low.cmpgt(bounds.max).any() {
            return;
        }
        grid.each(low, high, |id| {
            let other = self.catkin(id);
            if other.root == c.root {
                return;
            }
            let way = end - start;
            let from = start - other.x.as_vec3();
            let square = way.length_squared();
            let s = if square > 0.0 { (-from.dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
            let touch = c.radius + other.radius;
            if (from + way * s).length_squared() <= touch * touch {
                pairs.push((c.id.min(id), c.id.max(id)));
            }
        });
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
                if a.meets(&b, between) {
                    pairs.push((a.id, b.id));
                }
            }
        }
        pairs
    }

    #[test]
    fn the_grid_finds_what_trying_all_finds() {
        for edges in
            [[SideBoundary::Recycle; 2], [SideBoundary::Periodic; 2], [SideBoundary::Periodic, SideBoundary::Exit]]
        {
            let mut flights = some(2000, FlightParams { edges, ..FlightParams::default() });
            for (i, c) in (0..).zip(&mut flights.catkins) {
                let f = f64::from(i);
                c.travel = DVec3::new((f * 0.37) % 1.0 - 0.5, (f * 0.71) % 1.0 - 0.5, (f * 0.13) % 2.0 - 1.0);
            }
            let found = flights.airborne_contacts();
            assert!(found.len() > 10);
            assert_eq!(found, brute(&flights), "{edges:?}");
        }
    }

    /// A thousand pairs that cross at ten radii a check: all are seen.
    #[test]
    fn nobody_tunnels() {
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
