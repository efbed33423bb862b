//! Who touches whom: \[catkin\] 4.2.1, with a test of the ways instead of the places, so that nobody passes through.

use glam::{DVec3, IVec3, Vec3};

use super::grid::Grid;
use super::record::State;
use super::{Edge, Flights};
use crate::math::narrow;
use crate::par::par_map;
use crate::rng::Rng;

/// Most cubes along an axis.
const MOST: f32 = 256.0;

/// Side of the cubes that resting ones are sorted into, m.
const REST_CUBE: f32 = 0.25;

/// Planes of cubes a task takes at once.
const PLANES: i32 = 4;

/// One in the air over the time since the last check.
#[derive(Debug, Clone, Copy)]
struct Flyer {
    id: u32,
    root: u32,
    /// Half way, m.
    middle: Vec3,
    /// Way, m.
    way: Vec3,
    reach: f32,
}

impl Flyer {
    /// Whether the two came within reach of each other. `between`: from this one's middle to the other's.
    fn meets(&self, other: &Self, between: Vec3) -> bool {
        let way = other.way - self.way;
        let start = between - way * 0.5;
        let square = way.length_squared();
        let s = if square > 0.0 { (-start.dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
        let reach = self.reach + other.reach;
        (start + way * s).length_squared() <= reach * reach
    }

    /// The ball that holds all that it reaches on its way.
    fn ball(&self) -> Ball {
        Ball { middle: self.middle, radius: (self.reach + 0.5 * self.way.length()) * ROUNDED }
    }
}

/// Keeps a ball's radius from being rounded below what it must hold.
const ROUNDED: f32 = 1.0 + 1e-5;

/// What the search looks at first: 16 bytes each, side by side.
#[derive(Debug, Clone, Copy)]
struct Ball {
    middle: Vec3,
    radius: f32,
}

/// Rows of cubes after a cube's own, in x and y; with its own and the next cube in z these hold half of its neighbours,
/// so that every two cubes are met once.
const ROWS: [(i32, i32); 4] = [(0, 1), (1, -1), (1, 0), (1, 1)];

/// Flyers by cubes of the box, side by side in memory; cubes that follow each other in z lie side by side too.
struct Crowd {
    flyers: Vec<Flyer>,
    balls: Vec<Ball>,
    /// Where each cube's flyers begin; one more at the end.
    begins: Vec<u32>,
    count: IVec3,
    /// Which axes go round.
    round: [bool; 2],
    low: Vec3,
    size: Vec3,
}

impl Crowd {
    fn new(flyers: &mut [Flyer], flights: &Flights) -> Self {
        let inside = flights.options.inside;
        let size = inside.size();
        let n = flyers.len().max(1) as f32;
        let mean = flyers.iter().map(|f| f.way).sum::<Vec3>() / n;
        let stray = flyers.iter().map(|f| (f.way - mean).length()).fold(0.0, f32::max);
        let reach = flyers.iter().map(|f| f.reach).fold(0.0, f32::max);
        let volume = (size.x * size.y * size.z).max(f32::MIN_POSITIVE);
        let side = (2.0 * reach + stray).max(crate::math::pow_f32(volume / n, 1.0 / 3.0)).max(1e-3);
        let count = (size / side).floor().clamp(Vec3::ONE, Vec3::splat(MOST)).as_ivec3();
        let round = flights.options.edges.map(|e| e == Edge::Periodic);
        let (begins, balls) = (Vec::new(), Vec::new());
        let mut crowd = Self { flyers: Vec::new(), balls, begins, count, round, low: inside.min, size };
        flyers.iter_mut().for_each(|f| f.middle = crowd.wrapped(f.middle));
        crowd.sort(flyers);
        crowd
    }

    /// Brings those of one cube together.
    fn sort(&mut self, flyers: &[Flyer]) {
        let cubes: Vec<u32> = flyers.iter().map(|f| self.index(self.cube(f.middle))).collect();
        let cells = (self.count.x * self.count.y * self.count.z).unsigned_abs() as usize;
        let mut begins = vec![0_u32; cells + 1];
        cubes.iter().for_each(|c| begins[*c as usize + 1] += 1);
        (0..cells).for_each(|i| begins[i + 1] += begins[i]);
        let mut next = begins.clone();
        let mut from = vec![0_u32; flyers.len()];
        for (i, c) in (0..).zip(cubes) {
            let place = &mut next[c as usize];
            from[*place as usize] = i;
            *place += 1;
        }
        self.flyers = from.iter().map(|i| flyers[*i as usize]).collect();
        self.balls = self.flyers.iter().map(Flyer::ball).collect();
        self.begins = begins;
    }

    /// A place in the box along axes that go round.
    fn wrapped(&self, p: Vec3) -> Vec3 {
        let turns = ((p - self.low) / self.size).floor() * self.size;
        Vec3::new(if self.round[0] { p.x - turns.x } else { p.x }, p.y, if self.round[1] { p.z - turns.z } else { p.z })
    }

    fn cube(&self, p: Vec3) -> IVec3 {
        let c = ((p - self.low) / self.size * self.count.as_vec3()).floor();
        c.as_ivec3().clamp(IVec3::ZERO, self.count - IVec3::ONE)
    }

    fn index(&self, c: IVec3) -> u32 {
        ((c.x * self.count.y + c.y) * self.count.z + c.z).unsigned_abs()
    }

    /// Places of the flyers of cubes `z` of a row.
    fn row(&self, x: i32, y: i32, z: std::ops::RangeInclusive<i32>) -> std::ops::Range<usize> {
        let at = |z: i32| self.index(IVec3::new(x, y, z)) as usize;
        self.begins[at(*z.start())] as usize..self.begins[at(*z.end()) + 1] as usize
    }

    /// Pairs of numbers, the smaller first, that met; sorted, each once.
    fn pairs(&self) -> Vec<(u32, u32)> {
        let starts: Vec<i32> = (0..self.count.x).step_by(PLANES.unsigned_abs() as usize).collect();
        let found = par_map(&starts, |x0| {
            let mut pairs = Vec::new();
            for x in *x0..(*x0 + PLANES).min(self.count.x) {
                for y in 0..self.count.y {
                    for z in 0..self.count.z {
                        self.meet_in(IVec3::new(x, y, z), &mut pairs);
                    }
                }
            }
            pairs
        });
        let mut pairs: Vec<(u32, u32)> = found.into_iter().flatten().collect();
        pairs.sort_unstable();
        // Where an axis has but one or two cubes and goes round, cubes meet more than once.
        pairs.dedup();
        pairs
    }

    /// Pairs of a cube's flyers with each other and with those of the cubes after it.
    fn meet_in(&self, c: IVec3, pairs: &mut Vec<(u32, u32)>) {
        let here = self.row(c.x, c.y, c.z..=c.z);
        if here.is_empty() {
            return;
        }
        let last = self.count.z - 1;
        let own = self.row(c.x, c.y, c.z..=(c.z + 1).min(last));
        for i in here.clone() {
            self.meet(i, i + 1..own.end, Vec3::ZERO, pairs);
        }
        if c.z == last && self.round[1] {
            self.meet_all(&here, self.row(c.x, c.y, 0..=0), Vec3::Z * self.size.z, pairs);
        }
        for (dx, dy) in ROWS {
            let (mut x, y) = (c.x + dx, c.y + dy);
            if y < 0 || y >= self.count.y || (x == self.count.x && !self.round[0]) {
                continue;
            }
            let mut by = Vec3::ZERO;
            if x == self.count.x {
                (x, by.x) = (0, self.size.x);
            }
            self.meet_all(&here, self.row(x, y, (c.z - 1).max(0)..=(c.z + 1).min(last)), by, pairs);
            if self.round[1] && c.z == 0 {
                self.meet_all(&here, self.row(x, y, last..=last), by - Vec3::Z * self.size.z, pairs);
            }
            if self.round[1] && c.z == last {
                self.meet_all(&here, self.row(x, y, 0..=0), by + Vec3::Z * self.size.z, pairs);
            }
        }
    }

    fn meet_all(
        &self,
        here: &std::ops::Range<usize>,
        there: std::ops::Range<usize>,
        by: Vec3,
        pairs: &mut Vec<(u32, u32)>,
    ) {
        if !there.is_empty() {
            here.clone().for_each(|i| self.meet(i, there.clone(), by, pairs));
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
                let (a, b) = (&self.flyers[i], &self.flyers[k]);
                if a.root != b.root && a.meets(b, between) {
                    pairs.push((a.id.min(b.id), a.id.max(b.id)));
                }
            }
        }
    }
}

impl Flights {
    /// Looks for contacts since the last look and joins what touched.
    pub(super) fn meet(&mut self, t: f64) {
        let check = self.step / u64::from(self.options.check_every.max(1));
        let pairs = self.met_in_the_air();
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
        for (i, j) in self.met_at_rest() {
            self.join(i, j, t);
        }
        for c in &mut self.catkins {
            c.travel = DVec3::ZERO;
            c.free = c.state == State::Airborne;
            c.stirred = false;
        }
    }

    fn met_in_the_air(&self) -> Vec<(u32, u32)> {
        let flyer = |c: &super::Catkin| Flyer {
            id: c.id,
            root: c.root,
            middle: (c.x - c.travel * 0.5).as_vec3(),
            way: c.travel.as_vec3(),
            reach: c.radius.max(narrow(self.options.stick_radius)),
        };
        let mut flyers: Vec<Flyer> =
            self.catkins.iter().filter(|c| c.free && c.state == State::Airborne).map(flyer).collect();
        if flyers.len() < 2 {
            return Vec::new();
        }
        Crowd::new(&mut flyers, self).pairs()
    }

    /// Pairs of which one or both rest, by their own radii: who came to rest or moved since the last look with all who
    /// rest, and who flies with all who rest.
    fn met_at_rest(&self) -> Vec<(u32, u32)> {
        if !self.about.deposited {
            return Vec::new();
        }
        let rests = self.catkins.iter().filter(|c| c.state.is_deposited());
        let grid = Grid::new(REST_CUBE, rests.clone().map(|c| (c.id, c.x.as_vec3())));
        if grid.is_empty() {
            return Vec::new();
        }
        let widest = rests.map(|c| c.radius).fold(0.0, f32::max);
        let bounds =
            crate::geometry::Bounds::of(self.catkins.iter().filter(|c| c.state.is_deposited()).map(|c| c.x.as_vec3()))
                .grown(widest);
        let chunks: Vec<&[super::Catkin]> = self.catkins.chunks(super::CHUNK).collect();
        let found = par_map(&chunks, |chunk| {
            let mut pairs = Vec::new();
            for c in chunk.iter().filter(|c| c.state == State::Airborne || (c.state.is_deposited() && c.stirred)) {
                self.meet_resting(c, (&grid, widest, bounds), &mut pairs);
            }
            pairs
        });
        let mut pairs: Vec<(u32, u32)> = found.into_iter().flatten().collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    fn meet_resting(
        &self,
        c: &super::Catkin,
        (grid, widest, bounds): (&Grid, f32, crate::geometry::Bounds),
        pairs: &mut Vec<(u32, u32)>,
    ) {
        let (end, reach) = (c.x.as_vec3(), c.radius + widest);
        // What lies has no way to look back on: where it was before is not where it rests.
        let start = if c.state == State::Airborne { (c.x - c.travel).as_vec3() } else { end };
        let (low, high) = (start.min(end) - Vec3::splat(reach), start.max(end) + Vec3::splat(reach));
        if high.cmplt(bounds.min).any() || low.cmpgt(bounds.max).any() {
            return;
        }
        grid.each(low, high, |id| {
            let other = self.at(id);
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

    use super::super::{Options, Sky, sky};
    use super::*;
    use crate::solid::Solids;

    fn some(n: u32, options: Options) -> Flights {
        let sky_box = Sky { seed: 5, count: n, inside: options.inside, band: [0.3, 0.95], duration: 0.0 };
        let solids = Arc::new(Solids::new(Vec::new(), true));
        let starts = sky(&sky_box, &solids);
        Flights::new(options, solids, &starts)
    }

    fn brute(flights: &Flights) -> Vec<(u32, u32)> {
        let all: Vec<&super::super::Catkin> = flights.by_number().collect();
        let mut pairs = Vec::new();
        for (i, a) in all.iter().enumerate() {
            for b in &all[i + 1..] {
                let flyer = |c: &super::super::Catkin| Flyer {
                    id: c.id,
                    root: c.root,
                    middle: (c.x - c.travel * 0.5).as_vec3(),
                    way: c.travel.as_vec3(),
                    reach: 0.2,
                };
                let (a, b) = (flyer(a), flyer(b));
                let between = flights.nearest_image((b.middle - a.middle).as_dvec3()).as_vec3();
                if a.meets(&b, between) {
                    pairs.push((a.id, b.id));
                }
            }
        }
        pairs
    }

    #[test]
    fn the_grid_finds_what_trying_all_finds() {
        for edges in [[Edge::Recycle; 2], [Edge::Periodic; 2], [Edge::Periodic, Edge::Exit]] {
            let mut flights = some(2000, Options { edges, ..Options::default() });
            for (i, c) in (0..).zip(&mut flights.catkins) {
                let f = f64::from(i);
                c.travel = DVec3::new((f * 0.37) % 1.0 - 0.5, (f * 0.71) % 1.0 - 0.5, (f * 0.13) % 2.0 - 1.0);
            }
            let found = flights.met_in_the_air();
            assert!(found.len() > 10);
            assert_eq!(found, brute(&flights), "{edges:?}");
        }
    }

    /// A thousand pairs that cross at ten radii a check: all are seen.
    #[test]
    fn nobody_tunnels() {
        let mut flights = some(2000, Options { stick_radius: 0.0, ..Options::default() });
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
            let c = flights.at_mut(2 * k);
            (c.travel, c.x) = (way * 0.5, place + way * (0.5 - moment * 0.5));
            let c = flights.at_mut(2 * k + 1);
            (c.travel, c.x) = (way * -0.5, place - way * (0.5 - moment * 0.5) + miss);
        }
        let pairs = flights.met_in_the_air();
        let crossing = (0..1000).filter(|k| pairs.binary_search(&(2 * k, 2 * k + 1)).is_ok()).count();
        assert_eq!(crossing, 1000);
    }
}
