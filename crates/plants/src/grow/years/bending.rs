//! Bending under the weight that a year adds, and righting by reaction wood.

use std::ops::Range;

use glam::{Quat, Vec3};
use pulp::{Arch, Simd, WithSimd};

use super::habit::Habit;
use super::season::GRAVITY;
use super::shoots::{LEVEL_EPSILON, raised};
use super::tree::{NONE, Nodes, Tree, flag, index_of, y_axis};
use osier_base::math;
use osier_base::simd::{F32Lanes, Lane as _};

/// Density of dead wood divided by that of living wood.
const DEAD_DENSITY: f32 = 0.6;
/// A bend that would move the end of the axis by less than this, m, is postponed until the accumulated gain of moment is large
/// enough: most twigs need no bend in most years.
const LEAST_SHIFT: f32 = 1e-4;
/// Largest bend of an internode in a year, rad.
const BEND_MAX: f32 = 0.5;
/// Share that a bend may use of the angle between the internode and the direction straight down.
const BEND_SHARE: f32 = 0.6;
/// Reaction wood: radius, m, at which it turns an internode at its full rate; least radius used in this ratio, m; largest factor.
const RIGHTING: [f32; 3] = [0.01, 0.003, 1.5];
/// Largest turn by reaction wood in a year, rad.
const RIGHTING_MAX: f32 = 0.2;
/// Deviations with a smaller sine are not righted.
const LEAST_SINE: f32 = 1e-4;
/// Least height of bent side branches above the tree's base, m.
const LOWEST: f32 = 0.1;

impl Tree {
    /// Bends the wood under the weight added this year, and moves all wood that the bent wood carries.
    /// Source: [jirasek]: wood laid down on a bent branch keeps the branch bent, so that only the growth of the moment bends it.
    pub fn bend(&mut self) {
        self.sum_weights();
        self.turn_wood();
    }

    /// First moments along x and z of the mass beyond the base of each internode, about that base, kg m.
    fn sum_weights(&mut self) {
        let mut weights = std::mem::take(&mut self.scratch.weight);
        weights.clear();
        weights.resize(self.nodes.len(), Vec3::ZERO);
        let density = self.habit.density * std::f32::consts::PI;
        for i in (0..self.nodes.len()).rev() {
            let nodes = &self.nodes;
            if nodes.flags[i] & flag::FALLEN != 0 {
                continue;
            }
            let r = nodes.r[i];
            let wood = density * r * r * nodes.length[i];
            let mass =
                if nodes.lives(i) { wood + self.habit.leaf_mass * self.leaf_area(i) } else { DEAD_DENSITY * wood };
            let base = nodes.base(i);
            let middle = 0.5 * (base + nodes.p[i]);
            // Moments about the origin can be summed over subtrees; they are taken about the base of each internode afterwards.
            let weight = weights[i] + Vec3::new(middle.x * mass, mass, middle.z * mass);
            if nodes.parent[i] != NONE {
                weights[nodes.parent[i] as usize] += weight;
            }
            // All children have been added: replace the moments about the origin by those about the base of the internode.
            weights[i] = Vec3::new(weight.x - weight.y * base.x, 0.0, weight.z - weight.y * base.z);
        }
        self.scratch.weight = weights;
    }

    /// Turns each internode about its base by bending and righting; children inherit the rotation.
    fn turn_wood(&mut self) {
        let mut wood = self.turning();
        let count = wood.nodes.len();
        let mut window = Window::default();
        let mut group = TurningGroup::default();
        for first in (0..count).step_by(WINDOW) {
            window.begin(first, count.min(first + WINDOW), &mut wood);
            // Internodes of one round do not depend on each other. Internodes of living branches are computed in SIMD
            // lanes, the others one by one.
            for round in window.rounds() {
                for &k in round {
                    let k = usize::from(k);
                    if !window.rights[k] {
                        wood.turn(first + k, &window.loads[k]);
                    } else if group.push(first + k, &window.loads[k]) {
                        wood.turn_group(&mut group);
                    }
                }
                wood.turn_group(&mut group);
            }
        }
    }

    fn turning(&mut self) -> Turning<'_> {
        let scratch = &mut self.scratch;
        // Every rotation is set before a child reads it.
        scratch.turn.resize(self.nodes.len(), Quat::IDENTITY);
        Turning {
            habit: &self.habit,
            elevations: &self.axis_elevations,
            nodes: &mut self.nodes,
            turns: &mut scratch.turn,
            weights: &scratch.weight,
            beyond: &scratch.beyond,
        }
    }

    /// Scalar variant of [`Self::bend`].
    #[cfg(test)]
    pub fn bend_one_by_one(&mut self) {
        self.sum_weights();
        let mut wood = self.turning();
        for i in 0..wood.nodes.len() {
            wood.turns[i] = Quat::IDENTITY;
            if wood.nodes.flags[i] & flag::FALLEN == 0 {
                let load = wood.load(i);
                wood.turn(i, &load);
            }
        }
    }
}

/// Number of internodes that are processed together: enough to compute many at once, few enough to stay in the
/// first-level cache.
const WINDOW: usize = 256;

/// The internodes of a window, sorted by rounds: an internode turns in the round after its parent.
struct Window {
    /// Round of each internode, its weight, and whether reaction wood turns it.
    round: [u16; WINDOW],
    loads: [Load; WINDOW],
    rights: [bool; WINDOW],
    /// Numbers of the internodes by round, and where each round ends.
    sorted: [u16; WINDOW],
    ends: [u16; WINDOW],
    /// Number of rounds.
    count: usize,
}

impl Default for Window {
    fn default() -> Self {
        Self {
            round: [0; WINDOW],
            loads: [Load::default(); WINDOW],
            rights: [false; WINDOW],
            sorted: [0; WINDOW],
            ends: [0; WINDOW],
            count: 0,
        }
    }
}

impl Window {
    /// Sets up the window for the internodes from `first` up to `last`.
    fn begin(&mut self, first: usize, last: usize, wood: &mut Turning<'_>) {
        self.ends.fill(0);
        self.count = 0;
        let fallen = |wood: &Turning<'_>, i: usize| wood.nodes.flags[i] & flag::FALLEN != 0;
        for i in first..last {
            let k = i - first;
            if fallen(wood, i) {
                wood.turns[i] = Quat::IDENTITY;
                self.round[k] = 0;
                continue;
            }
            // A parent before the window has already been turned.
            let parent = wood.nodes.parent[i];
            let above = (parent as usize).checked_sub(first).and_then(|p| self.round[..k].get(p));
            self.round[k] = above.map_or(0, |round| round + 1);
            self.loads[k] = wood.load(i);
            self.rights[k] = wood.rights(i);
            self.ends[usize::from(self.round[k])] += 1;
            self.count = self.count.max(usize::from(self.round[k]) + 1);
        }
        // Counting sort: `ends` first contains the beginning of each round, and finally its end.
        let mut sum = 0;
        for end in &mut self.ends[..self.count] {
            sum += std::mem::replace(end, sum);
        }
        for (k, number) in (0..last - first).zip(0_u16..) {
            if !fallen(wood, first + k) {
                let slot = &mut self.ends[usize::from(self.round[k])];
                self.sorted[usize::from(*slot)] = number;
                *slot += 1;
            }
        }
    }

    /// Numbers of the internodes in the window, round by round.
    fn rounds(&self) -> impl Iterator<Item = &[u16]> {
        let mut first = 0;
        self.ends[..self.count].iter().map(move |end| {
            let round = &self.sorted[first..usize::from(*end)];
            first = usize::from(*end);
            round
        })
    }
}

/// Weight on an internode in a year.
#[derive(Debug, Clone, Copy, Default)]
struct Load {
    /// Torque about its base, and its magnitude, N m.
    torque: Vec3,
    moment: f32,
    /// Angle by which the moment gained so far bends the internode, rad, and whether it is bent in this year.
    angle: f32,
    bends: bool,
}

/// The internodes of a tree while they turn, and the data on which their turns depend.
struct Turning<'a> {
    habit: &'a Habit,
    /// Sine and cosine of the elevation that each axis turns to.
    elevations: &'a [[f32; 2]],
    nodes: &'a mut Nodes,
    turns: &'a mut [Quat],
    weights: &'a [Vec3],
    beyond: &'a [f32],
}

impl Turning<'_> {
    /// Computes the load on an internode and stores its moment.
    fn load(&mut self, i: usize) -> Load {
        let (habit, nodes) = (self.habit, &mut *self.nodes);
        let sag = habit.sag[usize::from(nodes.order[i])];
        let length = nodes.length[i];
        let modulus = habit.elasticity_gpa * 1e9 * std::f32::consts::FRAC_PI_4;
        // Torque of the weight about the base, lever x (0, -g, 0), from the positions before any turn.
        let lever = self.weights[i];
        let torque = Vec3::new(lever.z, 0.0, -lever.x) * GRAVITY;
        let moment = torque.length();
        let gain = moment - nodes.moment[i];
        let r = nodes.r[i];
        let square = r * r;
        // theta = M l / (E I) with I = pi r^4 / 4; `modulus` is E pi / 4.
        let angle = sag * gain * length / (modulus * square * square);
        let bends = angle * (length + self.beyond[i]) > LEAST_SHIFT;
        // The moment is stored if it bends the wood, if it has decreased, or if this order does not sag; otherwise the
        // gain accumulates until a bend is large enough.
        if bends || gain < 0.0 || sag <= 0.0 {
            nodes.moment[i] = moment;
        }
        Load { torque, moment, angle, bends }
    }

    /// Rate at which reaction wood turns an internode; 0 for dead wood.
    fn rate(&self, i: usize) -> f32 {
        let nodes = &self.nodes;
        if nodes.flags[i] & flag::DEAD == 0 { self.habit.upright[usize::from(nodes.order[i])] } else { 0.0 }
    }

    /// Whether an internode belongs to a branch that reaction wood turns.
    fn rights(&self, i: usize) -> bool {
        self.nodes.order[i] > 0 && self.nodes.parent[i] != NONE && self.rate(i) > 0.0
    }

    /// Turns an internode whose parent has been turned.
    fn turn(&mut self, i: usize, load: &Load) {
        let rate = self.rate(i);
        let nodes = &mut *self.nodes;
        let parent = nodes.parent[i];
        let order = usize::from(nodes.order[i]);
        let length = nodes.length[i];
        let (new_base, carried) = match nodes.p.get(parent as usize) {
            Some(p) => (*p, self.turns[parent as usize]),
            None => (nodes.base(i), Quat::IDENTITY),
        };
        // Orientation of the internode after the rotation of its parent, so that it does not repeat the righting of the parent.
        let mut q = carried * nodes.q[i];
        // `own` is the rotation that children inherit: all turns from the root to here.
        let mut own = carried;
        if load.bends || rate > 0.0 {
            let d = y_axis(q);
            let mut turn = Vec3::ZERO;
            if load.bends {
                // Remove the torsion, which is the component of the torque along the internode.
                turn = (load.torque - d * d.dot(load.torque)) * (limited_bend(load.angle, d) / load.moment);
            }
            if rate > 0.0 {
                let elevation = (order > 0).then(|| self.elevations[nodes.axis[i] as usize]);
                turn += righting(d, elevation, rate * length, nodes.r[i]);
            }
            let turn = small_rotation(turn);
            own = turn * own;
            q = turn * q;
        }
        let mut q = renormalized(q);
        let mut d = y_axis(q);
        // Keep side branches above the ground; wood that starts below it, on slopes, stays as it is.
        if order > 0 && new_base.y >= LOWEST && new_base.y + d.y * length < LOWEST {
            let up = math::rotation_between(d, lowest_direction(d, new_base.y, length));
            own = up * own;
            q = (up * q).normalize();
            d = y_axis(q);
        }
        self.turns[i] = own;
        nodes.q[i] = q;
        nodes.p[i] = new_base + d * length;
    }

    /// Turns the internodes of a group, which do not depend on each other, and empties it.
    fn turn_group(&mut self, group: &mut TurningGroup) {
        let count = std::mem::take(&mut group.count);
        if count == 0 {
            return;
        }
        for (k, i) in group.index[..count].iter().map(|i| *i as usize).enumerate() {
            let nodes = &self.nodes;
            let parent = nodes.parent[i] as usize;
            let order = usize::from(nodes.order[i]);
            let length = nodes.length[i];
            let load = &group.loads[k];
            group.rotation.set(k, self.turns[parent]);
            group.orientation.set(k, nodes.q[i]);
            group.base.set(k, nodes.p[parent]);
            group.length[k] = length;
            group.radius[k] = nodes.r[i];
            group.rate[k] = self.habit.upright[order] * length;
            [group.sin_elevation[k], group.cos_elevation[k]] = self.elevations[nodes.axis[i] as usize];
            (group.torque_x[k], group.torque_z[k]) = (load.torque.x, load.torque.z);
            group.is_bent[k] = if load.bends { 1.0 } else { 0.0 };
        }
        let arch = Arch::new();
        arch.dispatch(BendKernel(&mut *group));
        // Bends are limited one by one, since large ones need an exponential.
        for (k, load) in group.loads[..count].iter().enumerate() {
            group.bends[k] = if load.bends { limited(load.angle, group.most[k]) / load.moment } else { 0.0 };
        }
        arch.dispatch(RightingKernel(&mut *group));
        for (k, i) in group.index[..count].iter().map(|i| *i as usize).enumerate() {
            let end = group.end.get(k);
            // Axes that need another formula are turned one by one.
            let is_usual = group.level[k] > LEVEL_EPSILON && group.sine[k] >= LEAST_SINE && group.cosine[k] >= 0.0;
            let sinks = group.base.y[k] >= LOWEST && end.y < LOWEST;
            if is_usual && !sinks {
                self.turns[i] = group.rotation.get(k);
                self.nodes.q[i] = group.orientation.get(k);
                self.nodes.p[i] = end;
            } else {
                self.turn(i, &group.loads[k]);
            }
        }
    }
}

/// Largest number of internodes that one instruction processes.
const MOST_LANES: usize = 16;

/// One number for each internode of a group.
type LaneRow = [f32; MOST_LANES];

/// One vector for each internode of a group.
#[derive(Default)]
struct VecRows {
    x: LaneRow,
    y: LaneRow,
    z: LaneRow,
}

impl VecRows {
    fn set(&mut self, k: usize, v: Vec3) {
        (self.x[k], self.y[k], self.z[k]) = (v.x, v.y, v.z);
    }

    fn get(&self, k: usize) -> Vec3 {
        Vec3::new(self.x[k], self.y[k], self.z[k])
    }

    #[inline(always)]
    fn load<S: Simd>(&self, simd: S, part: &Range<usize>) -> LaneVec<S> {
        LaneVec { x: load(simd, &self.x, part), y: load(simd, &self.y, part), z: load(simd, &self.z, part) }
    }

    #[inline(always)]
    fn store<S: Simd>(&mut self, v: LaneVec<S>, part: &Range<usize>) {
        store(v.x, &mut self.x, part);
        store(v.y, &mut self.y, part);
        store(v.z, &mut self.z, part);
    }
}

/// One quaternion for each internode of a group.
#[derive(Default)]
struct QuatRows {
    x: LaneRow,
    y: LaneRow,
    z: LaneRow,
    w: LaneRow,
}

impl QuatRows {
    fn set(&mut self, k: usize, q: Quat) {
        (self.x[k], self.y[k], self.z[k], self.w[k]) = (q.x, q.y, q.z, q.w);
    }

    fn get(&self, k: usize) -> Quat {
        Quat::from_xyzw(self.x[k], self.y[k], self.z[k], self.w[k])
    }

    #[inline(always)]
    fn load<S: Simd>(&self, simd: S, part: &Range<usize>) -> LaneQuat<S> {
        let load = |row| load(simd, row, part);
        LaneQuat { x: load(&self.x), y: load(&self.y), z: load(&self.z), w: load(&self.w) }
    }

    #[inline(always)]
    fn store<S: Simd>(&mut self, q: LaneQuat<S>, part: &Range<usize>) {
        store(q.x, &mut self.x, part);
        store(q.y, &mut self.y, part);
        store(q.z, &mut self.z, part);
        store(q.w, &mut self.w, part);
    }
}

/// Internodes of living branches that are turned together, as rows of SIMD lanes.
#[derive(Default)]
struct TurningGroup {
    index: [u32; MOST_LANES],
    loads: [Load; MOST_LANES],
    count: usize,
    /// Rotation of the parent; finally the rotation that children inherit.
    rotation: QuatRows,
    /// Orientation: first before any turn, then with the rotation of the parent, finally with all turns.
    orientation: QuatRows,
    base: VecRows,
    end: VecRows,
    length: LaneRow,
    radius: LaneRow,
    /// Rate of righting times length.
    rate: LaneRow,
    /// Sine and cosine of the target elevation.
    sin_elevation: LaneRow,
    cos_elevation: LaneRow,
    /// Torque of the weight, N m; its component along y is 0.
    torque_x: LaneRow,
    torque_z: LaneRow,
    /// 1 if the internode bends, otherwise 0.
    is_bent: LaneRow,
    /// Largest bend, rad.
    most: LaneRow,
    /// Bend divided by the moment, rad / (N m).
    bends: LaneRow,
    /// Squared length of the horizontal part of the direction.
    level: LaneRow,
    /// Sine and cosine of the deviation from the target direction.
    sine: LaneRow,
    cosine: LaneRow,
}

impl TurningGroup {
    /// Adds an internode; returns whether the group is full.
    fn push(&mut self, i: usize, load: &Load) -> bool {
        (self.index[self.count], self.loads[self.count]) = (index_of(i), *load);
        self.count += 1;
        self.count == MOST_LANES
    }
}

/// The operations of [`Turning::turn`] up to the bend, in the same order, so that the results are equal bit for bit.
struct BendKernel<'a>(&'a mut TurningGroup);

impl WithSimd for BendKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let group = self.0;
        let lanes = S::F32_LANES.min(MOST_LANES);
        for first in (0..MOST_LANES).step_by(lanes) {
            let part = first..first + lanes;
            let q = group.rotation.load(simd, &part).times(group.orientation.load(simd, &part));
            // Angle between the internode and the direction straight down, times the share of it that a bend may use
            // (`limited_bend`).
            let down = -q.y_axis().y;
            let angle = angle_of_magnitude(down.max(-down));
            let angle = down.select_lt(0.0, F32Lanes::from_scalar(simd, std::f32::consts::PI) - angle, angle);
            group.orientation.store(q, &part);
            store(angle * BEND_SHARE, &mut group.most, &part);
        }
    }
}

/// The operations of [`Turning::turn`] that begin with the bend, in the same order.
struct RightingKernel<'a>(&'a mut TurningGroup);

impl WithSimd for RightingKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let group = self.0;
        let lanes = S::F32_LANES.min(MOST_LANES);
        for first in (0..MOST_LANES).step_by(lanes) {
            let part = first..first + lanes;
            let own = group.rotation.load(simd, &part);
            let q = group.orientation.load(simd, &part);
            let base = group.base.load(simd, &part);
            let length = load(simd, &group.length, &part);
            let r = load(simd, &group.radius, &part);
            let rate = load(simd, &group.rate, &part);
            let (sin_e, cos_e) = (load(simd, &group.sin_elevation, &part), load(simd, &group.cos_elevation, &part));
            let (torque_x, torque_z) = (load(simd, &group.torque_x, &part), load(simd, &group.torque_z, &part));
            let (is_bent, bend) = (load(simd, &group.is_bent, &part), load(simd, &group.bends, &part));
            let d = q.y_axis();
            let zero = F32Lanes::from_scalar(simd, 0.0);
            // The bend, without its torsion.
            let along = d.x * torque_x + d.y * zero + d.z * torque_z;
            let bent_x = is_bent.select_gt(0.5, (torque_x - d.x * along) * bend, zero);
            let bent_y = is_bent.select_gt(0.5, (zero - d.y * along) * bend, zero);
            let bent_z = is_bent.select_gt(0.5, (torque_z - d.z * along) * bend, zero);
            // The target direction: the heading, raised to the target elevation (`raised`).
            let level = d.x * d.x + zero * zero + d.z * d.z;
            let per_level = F32Lanes::from_scalar(simd, 1.0).div(level.sqrt());
            let wanted = LaneVec {
                x: d.x * per_level * cos_e + zero * sin_e,
                y: zero * per_level * cos_e + sin_e,
                z: d.z * per_level * cos_e + zero * sin_e,
            };
            // The turn towards the target direction (`righting`).
            let about = LaneVec {
                x: d.y * wanted.z - wanted.y * d.z,
                y: d.z * wanted.x - wanted.z * d.x,
                z: d.x * wanted.y - wanted.x * d.y,
            };
            let sine = about.dot(about).sqrt();
            let cosine = d.dot(wanted);
            let deviation = angle_of_magnitude(cosine);
            let factor = F32Lanes::from_scalar(simd, RIGHTING[0])
                .div(r.max(F32Lanes::from_scalar(simd, RIGHTING[1])))
                .min(F32Lanes::from_scalar(simd, RIGHTING[2]));
            let scale = (deviation * rate * factor).min(F32Lanes::from_scalar(simd, RIGHTING_MAX)).div(sine);
            let v = LaneVec { x: bent_x + about.x * scale, y: bent_y + about.y * scale, z: bent_z + about.z * scale };
            // The quaternion of the turn (`small_rotation`).
            let t = v.dot(v);
            let half =
                F32Lanes::from_scalar(simd, 0.5) - t * (F32Lanes::from_scalar(simd, 1.0 / 48.0) - t * (1.0 / 3840.0));
            let eighth = F32Lanes::from_scalar(simd, 1.0 / 8.0)
                - t * (F32Lanes::from_scalar(simd, 1.0 / 384.0) - t.div(F32Lanes::from_scalar(simd, 46080.0)));
            let turn = LaneQuat {
                x: v.x * half,
                y: v.y * half,
                z: v.z * half,
                w: F32Lanes::from_scalar(simd, 1.0) - t * eighth,
            };
            let own = turn.times(own);
            let q = turn.times(q);
            // `renormalized`
            let norm = F32Lanes::from_scalar(simd, 1.5) - (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w) * 0.5;
            let q = LaneQuat { x: q.x * norm, y: q.y * norm, z: q.z * norm, w: q.w * norm };
            let d = q.y_axis();
            group.rotation.store(own, &part);
            group.orientation.store(q, &part);
            let end = LaneVec { x: base.x + d.x * length, y: base.y + d.y * length, z: base.z + d.z * length };
            group.end.store(end, &part);
            store(level, &mut group.level, &part);
            store(sine, &mut group.sine, &part);
            store(cosine, &mut group.cosine, &part);
        }
    }
}

/// [`angle_of_cosine`] in lanes, for cosines that are not negative.
#[inline(always)]
fn angle_of_magnitude<S: Simd>(cosine: F32Lanes<S>) -> F32Lanes<S> {
    let square = F32Lanes::from_scalar(cosine.simd, 2.0) - cosine * 2.0;
    let square = square.max(F32Lanes::from_scalar(cosine.simd, 0.0));
    square.sqrt() * (square * (square * (square * (5.0 / 7168.0) + 3.0 / 640.0) + 1.0 / 24.0) + 1.0)
}

/// Loads a part of a row into lanes.
#[inline(always)]
fn load<S: Simd>(simd: S, row: &LaneRow, part: &Range<usize>) -> F32Lanes<S> {
    F32Lanes::partial_load(simd, &row[part.clone()])
}

#[inline(always)]
fn store<S: Simd>(value: F32Lanes<S>, row: &mut LaneRow, part: &Range<usize>) {
    value.partial_store(&mut row[part.clone()]);
}

/// A vector in each lane.
#[derive(Clone, Copy)]
struct LaneVec<S: Simd> {
    x: F32Lanes<S>,
    y: F32Lanes<S>,
    z: F32Lanes<S>,
}

impl<S: Simd> LaneVec<S> {
    #[inline(always)]
    fn dot(self, other: Self) -> F32Lanes<S> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }
}

/// A quaternion in each lane.
#[derive(Clone, Copy)]
struct LaneQuat<S: Simd> {
    x: F32Lanes<S>,
    y: F32Lanes<S>,
    z: F32Lanes<S>,
    w: F32Lanes<S>,
}

impl<S: Simd> LaneQuat<S> {
    /// The product, in the order of operations of `Quat`.
    #[inline(always)]
    fn times(self, b: Self) -> Self {
        let a = self;
        Self {
            x: a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            y: a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            z: a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
            w: a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        }
    }

    /// [`y_axis`] in lanes.
    #[inline(always)]
    fn y_axis(self) -> LaneVec<S> {
        let Self { x, y, z, w } = self;
        LaneVec {
            x: (x * y - w * z) * 2.0,
            y: F32Lanes::from_scalar(x.simd, 1.0) - (x * x + z * z) * 2.0,
            z: (y * z + w * x) * 2.0,
        }
    }
}

/// The angle of a cosine, rad, within 2e-3 of it.
/// Source: 2 asin(c / 2) in powers of the chord c = sqrt(2 - 2 cos), from the nearer of 0 and pi.
#[inline]
fn angle_of_cosine(cosine: f32) -> f32 {
    let square = (2.0 - 2.0 * cosine.abs()).max(0.0);
    let angle = square.sqrt() * (1.0 + square * (1.0 / 24.0 + square * (3.0 / 640.0 + square * (5.0 / 7168.0))));
    if cosine < 0.0 { std::f32::consts::PI - angle } else { angle }
}

/// The bend of an internode, limited by its angle to the direction straight down.
#[inline]
fn limited_bend(angle: f32, d: Vec3) -> f32 {
    limited(angle, BEND_SHARE * angle_of_cosine(-d.y))
}

/// A bend limited by `most`, rad.
/// Source: theta = min(0.5, 0.6 h (1 - exp(-theta / (0.6 h)))), h = angle to the direction straight down.
#[inline]
fn limited(angle: f32, most: f32) -> f32 {
    if most <= 0.0 {
        return 0.0;
    }
    let part = angle / most;
    // 1 - e^-x = x (1 - x / 2 + x^2 / 6) within 1e-7 for the usual, small bends.
    let limited =
        if part < 0.01 { angle * (1.0 - part * (0.5 - part / 6.0)) } else { most * (1.0 - math::exp_f32(-part)) };
    limited.min(BEND_MAX)
}

/// The turn by reaction wood towards the elevation of the axis, as a rotation vector; the trunk's is upright.
/// Own: deviation x upright x l x min(0.01 / max(r, 0.003), 1.5), at most 0.2 rad.
#[inline]
fn righting(d: Vec3, elevation: Option<[f32; 2]>, rate: f32, r: f32) -> Vec3 {
    let wanted = elevation.map_or(Vec3::Y, |elevation| raised(d, elevation));
    let about = d.cross(wanted);
    let sine = about.length();
    if sine < LEAST_SINE {
        return Vec3::ZERO;
    }
    let deviation = angle_of_cosine(d.dot(wanted));
    let factor = (RIGHTING[0] / r.max(RIGHTING[1])).min(RIGHTING[2]);
    about * ((deviation * rate * factor).min(RIGHTING_MAX) / sine)
}

/// A rotation by a vector of less than a radian.
/// Source: (v sin(t / 2) / t, cos(t / 2)) in powers of t, within 1e-6 at t = 1.
#[inline]
fn small_rotation(v: Vec3) -> Quat {
    let t = v.length_squared();
    let v = v * (0.5 - t * (1.0 / 48.0 - t * (1.0 / 3840.0)));
    Quat::from_xyzw(v.x, v.y, v.z, 1.0 - t * (1.0 / 8.0 - t * (1.0 / 384.0 - t / 46080.0)))
}

/// Normalises a quaternion of nearly unit length by one step of Newton's iteration.
#[inline]
fn renormalized(q: Quat) -> Quat {
    q * (1.5 - 0.5 * q.length_squared())
}

/// The direction with the heading of `d` in which an internode from the height `from` ends at [`LOWEST`].
#[cold]
fn lowest_direction(d: Vec3, from: f32, length: f32) -> Vec3 {
    let y = ((LOWEST - from) / length).clamp(-1.0, 1.0);
    let level = math::normalize_or(Vec3::new(d.x, 0.0, d.z), Vec3::X);
    level * (1.0 - y * y).max(0.0).sqrt() + Vec3::Y * y
}
