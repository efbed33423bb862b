//! A step of a plant in the wind: from the ground up for places, over all stations for the air, from the tips down for
//! forces. All that does not lead from one element to the next goes through lanes.

use pulp::{Simd, WithSimd};

use super::constants::{Fixed, Overtones};
use crate::lanes::{Arrow, Columns, Lane, Turned};
use crate::sway::beam::{share_of_slope, turn_lanes};
use crate::sway::wood::FOLD;

/// Strongest inertia, m/s^2.
const JERK: f64 = 50.0;
/// Air across a branch of less than this sheds no eddies, m/s: it divides.
const STILL: f64 = 1e-30;
/// Part of the changing load that makes second modes swing.
const RINGING: f64 = 0.15;

/// What changes from step to step, in rows of [`Fixed`].
#[derive(Debug)]
pub(crate) struct Moving {
    /// Place and rate of both ways, rad and rad/s.
    pub(crate) swung: Columns<4>,
    /// The same of second modes, and where the mean wind holds the first.
    pub(crate) rung: Columns<4>,
    pub(crate) mean: Columns<2>,
    /// The bend as a turn about an axis of the plant's space, and the second mode's.
    bend: Columns<3>,
    ring: Columns<3>,
    /// Per station, in the frame of its element's base: turn, where its stretch begins, place.
    turns: Columns<4>,
    from: Columns<3>,
    own: Columns<3>,
    /// Bend at the place on the carrier, where the stretch begins and its turn; then turn and place of the base in its frame.
    carrier: Columns<10>,
    hung: Columns<7>,
    /// Turn from rest and place of each element's base, in the plant's space; once more row by row.
    carried: Columns<7>,
    bases: Vec<[f64; 7]>,
    /// Per station: place, place a step ago, places if carried rigidly one and two steps ago.
    pub(crate) places: Columns<3>,
    before: Columns<3>,
    rigid: Columns<6>,
    /// Force of a subtree on its carrier, N, and its sum with levers; load of the own stations in the element's frame.
    forces: Columns<6>,
    loads: Columns<3>,
    /// Air when it was last looked up and when it will be next, per station in the plant's space, m/s.
    pub(crate) air: [Columns<3>; 2],
    /// Push of shed eddies at both times, over the drag, per element.
    pub(crate) shed: [Columns<1>; 2],
}

impl Moving {
    pub(crate) fn new(fixed: &Fixed) -> Self {
        let (n, m) = (fixed.slots.first().map_or(0, |s| s.1), fixed.slots.iter().map(|s| s.1).sum());
        let unturned = |rows: usize| {
            let mut carrier = Columns::<10>::new(rows);
            (0..rows).for_each(|i| carrier.set(i, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]));
            carrier
        };
        Self {
            swung: Columns::new(n),
            rung: Columns::new(n),
            mean: Columns::new(n),
            bend: Columns::new(n),
            ring: Columns::new(n),
            turns: Columns::new(m),
            from: Columns::new(m),
            own: Columns::new(m),
            carrier: unturned(n),
            hung: Columns::new(n),
            carried: Columns::new(n),
            bases: vec![[0.0; 7]; n],
            places: Columns::new(m),
            before: Columns::new(m),
            rigid: Columns::new(m),
            forces: Columns::new(n),
            loads: Columns::new(n),
            air: [Columns::new(m), Columns::new(m)],
            shed: [Columns::new(n), Columns::new(n)],
        }
    }
}

/// Number of groups of elements as wide as the lanes.
#[inline(always)]
fn groups<S: Simd>(fixed: &Fixed) -> usize {
    fixed.slots.first().map_or(0, |s| s.1) / S::F64_LANES
}

/// Stations of each element of a group.
#[inline(always)]
fn count<S: Simd>(fixed: &Fixed, group: usize) -> usize {
    let mut count = 0;
    while count < fixed.slots.len() && group * S::F64_LANES < fixed.slots[count].1 {
        count += 1;
    }
    count
}

/// Group of the `k`-th stations of a group of elements.
#[inline(always)]
fn station<S: Simd>(fixed: &Fixed, k: usize, group: usize) -> usize {
    fixed.slots[k].0 / S::F64_LANES + group
}

#[inline(always)]
fn both<S: Simd>([a, b, c, d, e, f]: [Lane<S>; 6]) -> [Arrow<S>; 2] {
    [Arrow([a, b, c]), Arrow([d, e, f])]
}

/// Drag of wood and leaves in relative wind, N, and the wind's speed across the wood: wood takes the part across it,
/// leaves fold away as it grows. `wood`, `leaf`: half of density, coefficient and area.
#[inline(always)]
pub(crate) fn drag<S: Simd>([wood, leaf]: [Lane<S>; 2], along: Arrow<S>, wind: Arrow<S>) -> (Arrow<S>, Lane<S>) {
    let across = wind - along * wind.dot(along);
    let (slow, speed) = (across.length(), wind.length());
    let one = Lane::all(speed.simd(), 1.0);
    (across * (wood * slow) + wind * (leaf * speed).over(one + speed * (1.0 / FOLD)), slow)
}

/// Finds where everything is. `fresh`: nothing is known of the step before.
pub(crate) struct Place<'a> {
    pub(crate) fixed: &'a Fixed,
    pub(crate) now: &'a mut Moving,
    pub(crate) fresh: bool,
}

impl WithSimd for Place<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { fixed, now, fresh } = self;
        shapes(fixed, now, simd);
        hang(fixed, now, simd);
        carry(fixed, now);
        stand(fixed, now, fresh, simd);
    }
}

/// Each element in the frame of its own base.
#[inline(always)]
fn shapes<S: Simd>(fixed: &Fixed, now: &mut Moving, simd: S) {
    let zero = Lane::all(simd, 0.0);
    for g in 0..groups::<S>(fixed) {
        let count = count::<S>(fixed, g);
        let [x, z] = both(fixed.ways.get(simd, g));
        let [a, _, b, _] = now.swung.get(simd, g);
        let bend = x * a + z * b;
        now.bend.put(g, bend.0);
        let over = fixed.overtones.as_ref().filter(|o| g * S::F64_LANES < o.count());
        let mut ring = Arrow([zero; 3]);
        if over.is_some() {
            let [a, _, b, _] = now.rung.get(simd, g);
            ring = x * a + z * b;
            now.ring.put(g, ring.0);
        }
        let mut from = Arrow([zero; 3]);
        for k in 0..count {
            let s = station::<S>(fixed, k, g);
            let [ax, ay, az, cx, cy, cz, share] = fixed.shape.get(simd, s);
            let mut here = bend * share;
            if let Some(over) = over {
                let [share] = over.shape.get(simd, s);
                here = here + ring * share;
            }
            let q = turn_lanes(here);
            let turned = Turned::of(q);
            now.turns.put(s, q);
            now.from.put(s, from.0);
            now.own.put(s, (from + turned.apply(Arrow([ax, ay, az]))).0);
            if k + 1 < count {
                from = from + turned.apply(Arrow([cx, cy, cz]));
            }
        }
    }
}

/// Each element's base in the frame of its carrier's.
#[inline(always)]
fn hang<S: Simd>(fixed: &Fixed, now: &mut Moving, simd: S) {
    for hung in &fixed.order {
        let Some(carrier) = hung.carrier else { continue };
        let [first, second] = hung.shares;
        let ([a, b, c], [u, v, w]) = (now.bend.row(carrier), now.ring.row(carrier));
        let [a, b, c] = [a * first + u * second, b * first + v * second, c * first + w * second];
        let [d, e, f] = now.from.row(hung.stand);
        let [x, y, z, w] = now.turns.row(hung.stand);
        now.carrier.set(hung.row, [a, b, c, d, e, f, x, y, z, w]);
    }
    for g in 0..groups::<S>(fixed) {
        let [a, b, c, d, e, f, x, y, z, w] = now.carrier.get(simd, g);
        let place = Arrow([d, e, f]) + Turned::of([x, y, z, w]).apply(Arrow(fixed.hold.get(simd, g)));
        let [x, y, z, w] = turn_lanes(Arrow([a, b, c]));
        now.hung.put(g, [x, y, z, w, place.0[0], place.0[1], place.0[2]]);
    }
}

/// From the ground up: each base in the plant's space.
#[inline(always)]
fn carry(fixed: &Fixed, now: &mut Moving) {
    for hung in &fixed.order {
        let [x, y, z, w, px, py, pz] = now.hung.row(hung.row);
        let base = match hung.carrier {
            None => [x, y, z, w, px, py, pz],
            Some(carrier) => {
                let [a, b, c, d, ox, oy, oz] = now.bases[carrier];
                // The vector turned by a quaternion: v + 2 w (u x v) + 2 u x (u x v).
                let (tx, ty, tz) = (2.0 * (b * pz - c * py), 2.0 * (c * px - a * pz), 2.0 * (a * py - b * px));
                [
                    d * x + a * w + b * z - c * y,
                    d * y - a * z + b * w + c * x,
                    d * z + a * y - b * x + c * w,
                    d * w - a * x - b * y - c * z,
                    ox + px + d * tx + (b * tz - c * ty),
                    oy + py + d * ty + (c * tx - a * tz),
                    oz + pz + d * tz + (a * ty - b * tx),
                ]
            }
        };
        now.bases[hung.row] = base;
        now.carried.set(hung.row, base);
    }
}

/// All stations in the plant's space.
#[inline(always)]
fn stand<S: Simd>(fixed: &Fixed, now: &mut Moving, fresh: bool, simd: S) {
    for g in 0..groups::<S>(fixed) {
        let count = count::<S>(fixed, g);
        let [x, y, z, w, px, py, pz] = now.carried.get(simd, g);
        let (turned, base) = (Turned::of([x, y, z, w]), Arrow([px, py, pz]));
        for k in 0..count {
            let s = station::<S>(fixed, k, g);
            let place = base + turned.apply(Arrow(now.own.get(simd, s)));
            let before = if fresh { place } else { Arrow(now.places.get(simd, s)) };
            now.before.put(s, before.0);
            now.places.put(s, place.0);
        }
    }
}

/// Presses on everything and goes on by a step.
pub(crate) struct Press<'a> {
    pub(crate) fixed: &'a Fixed,
    pub(crate) now: &'a mut Moving,
    /// Length of a step, s.
    pub(crate) step: f64,
    /// Nothing is known of the step before.
    pub(crate) fresh: bool,
    /// Where between the two looks at the air, 0 to 1.
    pub(crate) between: f64,
    /// Factor on inertia; 0 while too little is known of the steps before.
    pub(crate) whip: f64,
    /// Goes most of the way to the balance, without swinging.
    pub(crate) settle: bool,
}

impl WithSimd for Press<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.blow(simd);
        self.sum();
        self.swing(simd);
    }
}

impl Press<'_> {
    /// Air and inertia at every station.
    #[inline(always)]
    fn blow<S: Simd>(&mut self, simd: S) {
        let (fixed, now) = (self.fixed, &mut *self.now);
        let zero = Arrow([Lane::all(simd, 0.0); 3]);
        let between = Lane::all(simd, self.between);
        let (rate, square, whip) = (1.0 / self.step, 1.0 / (self.step * self.step), -self.whip);
        for g in 0..groups::<S>(fixed) {
            let count = count::<S>(fixed, g);
            let [x, y, z, w, px, py, pz] = now.carried.get(simd, g);
            let (turned, base) = (Turned::of([x, y, z, w]), Arrow([px, py, pz]));
            let ([last], [next]) = (now.shed[0].get(simd, g), now.shed[1].get(simd, g));
            let shed = last + (next - last) * between;
            let (mut total, mut load, mut thrown) = (zero, zero, zero);
            for k in 0..count {
                let s = station::<S>(fixed, k, g);
                let [wood, leaf, lever, inertia, stops] = fixed.press.get(simd, s);
                let [rest, along] = both(fixed.rest.get(simd, s));
                let (last, next) = (Arrow(now.air[0].get(simd, s)), Arrow(now.air[1].get(simd, s)));
                let air = last + (next - last) * between;
                // Drag feels less of a speed that the air would stop within a step.
                let slowed = Lane::all(simd, 0.5).over((stops * air.length() * self.step).at_least(0.5));
                let speed = (Arrow(now.places.get(simd, s)) - Arrow(now.before.get(simd, s))) * (slowed * rate);
                let relative = turned.back(air - speed);
                let along = Turned::of(now.turns.get(simd, s)).apply(along);
                let (drag, slow) = drag([wood, leaf], along, relative);
                let sideways = (shed * drag.length()).over(slow.at_least(STILL));
                let force = drag + relative.cross(along) * sideways;
                total = total + force;
                load = load + force * lever;
                let rigid = base + turned.apply(rest);
                let [one, two] = if self.fresh { [rigid; 2] } else { both(now.rigid.get(simd, s)) };
                let thrust = (rigid - one - (one - two)) * Lane::all(simd, square);
                let most = Lane::all(simd, JERK).over(thrust.length().at_least(JERK));
                thrown = thrown + thrust * (most * inertia * whip);
                let ([a, b, c], [d, e, f]) = (rigid.0, one.0);
                now.rigid.put(s, [a, b, c, d, e, f]);
            }
            let [a, b, c] = turned.apply(total).0;
            let [d, e, f] = thrown.0;
            now.forces.put(g, [a, b, c, d, e, f]);
            now.loads.put(g, load.0);
        }
    }

    /// From the tips down: what is carried pulls on what carries it.
    #[inline(always)]
    fn sum(&mut self) {
        for hung in self.fixed.order.iter().rev() {
            let Some(carrier) = hung.carrier else { continue };
            let [x, y, z, ..] = self.now.forces.row(hung.row);
            self.now.forces.add(carrier, [x, y, z, x * hung.lever, y * hung.lever, z * hung.lever]);
        }
    }

    /// Every element towards where the load of the moment would hold it.
    #[inline(always)]
    fn swing<S: Simd>(&mut self, simd: S) {
        let (fixed, now) = (self.fixed, &mut *self.now);
        let (none, left) = (Lane::all(simd, 0.0), Lane::all(simd, 0.4));
        for g in 0..groups::<S>(fixed) {
            let [x, y, z, w, ..] = now.carried.get(simd, g);
            let [_, pulled] = both(now.forces.get(simd, g));
            let turned = Turned::of([x, y, z, w]);
            let mut load = Arrow(now.loads.get(simd, g)) + turned.back(pulled);
            if let Some([gx, gy, gz]) = fixed.gravity {
                let down = Arrow([Lane::all(simd, gx), Lane::all(simd, gy), Lane::all(simd, gz)]);
                let [weight] = fixed.weight.get(simd, g);
                load = load + (turned.back(down) - down) * weight;
            }
            let ways = both(fixed.ways.get(simd, g));
            // The turn that a force makes, growth x force, seen along both ways across the growth.
            let (a, b) = (ways[1].dot(load), -ways[0].dot(load));
            let share = share_of_slope(a * a + b * b);
            let [c0, c1, c2, c3, d0, d1, d2, d3] =
                if self.settle { [left, none, none, none, left, none, none, none] } else { fixed.swing.get(simd, g) };
            let [p, v, q, u] = now.swung.get(simd, g);
            let (a, b) = (a * share, b * share);
            if let Some(over) = fixed.overtones.as_ref().filter(|o| !self.settle && g * S::F64_LANES < o.count()) {
                ring(over, now, g, [a, b]);
            }
            let (y, z) = (p - a, q - b);
            now.swung.put(g, [a + c0 * y + c1 * v, c2 * y + c3 * v, b + d0 * z + d1 * u, d2 * z + d3 * u]);
        }
    }
}

/// Second modes towards a share of what the wind adds to its mean. `goal`: of the first modes.
#[inline(always)]
fn ring<S: Simd>(over: &Overtones, now: &mut Moving, g: usize, goal: [Lane<S>; 2]) {
    let simd = goal[0].simd();
    let [c0, c1, c2, c3, d0, d1, d2, d3] = over.swing.get(simd, g);
    let ([still, level], [p, v, q, u]) = (now.mean.get(simd, g), now.rung.get(simd, g));
    let (a, b) = ((goal[0] - still) * RINGING, (goal[1] - level) * RINGING);
    let (y, z) = (p - a, q - b);
    now.rung.put(g, [a + c0 * y + c1 * v, c2 * y + c3 * v, b + d0 * z + d1 * u, d2 * z + d3 * u]);
}

#[cfg(test)]
mod tests {
    use pulp::Scalar;

    use super::*;
    use crate::sway::wood::AIR;

    /// Drag along the wind, N, of areas in m^2, in wind of `u` m/s that meets wood at a slant.
    fn along_wind([wood, leaf]: [f64; 2], growth: [f64; 3], u: f64) -> f64 {
        let lane = |v: f64| Lane::all(Scalar, v);
        let areas = [wood * 1.1, leaf * 0.4].map(|a| lane(0.5 * AIR * a));
        drag(areas, Arrow(growth.map(lane)), Arrow([u, 0.0, 0.0].map(lane))).0.0[0].value()
    }

    #[test]
    fn wood_feels_the_square_of_the_wind_and_leaves_fold_away() {
        const UP: [f64; 3] = [0.0, 1.0, 0.0];
        let (wood, leaf) = ([0.1, 0.0], [0.0, 1.0]);
        assert!((along_wind(wood, UP, 10.0) / along_wind(wood, UP, 5.0) - 4.0).abs() < 1e-9);
        assert!((along_wind(leaf, UP, 60.0) / along_wind(leaf, UP, 30.0) - 2.235).abs() < 1e-3);
        assert!((along_wind(wood, UP, 10.0) - 0.5 * 1.225 * 1.1 * 0.1 * 100.0).abs() < 1e-9);
        assert!(along_wind(wood, [1.0, 0.0, 0.0], 10.0).abs() < 1e-12, "wood along the wind catches none");
    }
}
