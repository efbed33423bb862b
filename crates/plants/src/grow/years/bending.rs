//! Bending under the weight that a year adds, and righting by reaction wood.

use glam::{Quat, Vec3};

use super::season::{GRAVITY, Season};
use super::shoots::raised;
use super::tree::{NONE, Tree, flag, y_axis};
use osier_base::math;

/// Mass of dead wood over that of living wood.
const DEAD_DENSITY: f32 = 0.6;
/// Bends that would move the end of the axis by less than this, m, are postponed until the gains of moment add up to it: most
/// twigs need no bend in most years.
const LEAST_SHIFT: f32 = 1e-4;
/// Largest bend of an internode in a year, rad.
const BEND_MAX: f32 = 0.5;
/// Share of the angle to hanging that a bend may use.
const BEND_SHARE: f32 = 0.6;
/// Reaction wood: radius at which it turns at its full rate, m; least radius that is used, m; largest factor.
const RIGHTING: [f32; 3] = [0.01, 0.003, 1.5];
/// Largest turn by reaction wood in a year, rad.
const RIGHTING_MAX: f32 = 0.2;
/// Deviations with a smaller sine are not righted.
const LEAST_SINE: f32 = 1e-4;
/// Least height of bent side branches above the tree's base, m.
const LOWEST: f32 = 0.1;

impl Tree {
    /// Bends the wood under the weight added this year and moves all that it bears.
    /// Source: [jirasek] for wood laid on a bent branch, which keeps it bent: only the growth of the moment bends.
    pub fn bend(&mut self, season: &Season) {
        self.sum_weights();
        self.turn_wood(season);
    }

    /// First moments along x and z of the mass from each internode on, about its base, kg m.
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
    fn turn_wood(&mut self, season: &Season) {
        let habit = &self.habit;
        let nodes = &mut self.nodes;
        let turns = &mut self.scratch.turn;
        turns.clear();
        turns.resize(nodes.len(), Quat::IDENTITY);
        let modulus = habit.elasticity_gpa * 1e9 * std::f32::consts::FRAC_PI_4;
        for i in 0..nodes.len() {
            if nodes.flags[i] & flag::FALLEN != 0 {
                continue;
            }
            let parent = nodes.parent[i];
            let order = usize::from(nodes.order[i]);
            let length = nodes.length[i];
            let (new_base, carried) = match nodes.p.get(parent as usize) {
                Some(p) => (*p, turns[parent as usize]),
                None => (nodes.base(i), Quat::IDENTITY),
            };
            // Torque of the weight about the base, lever x (0, -g, 0), from the positions before any turn.
            let lever = self.scratch.weight[i];
            let torque = Vec3::new(lever.z, 0.0, -lever.x) * GRAVITY;
            let moment = torque.length();
            let gain = moment - nodes.moment[i];
            let r = nodes.r[i];
            let square = r * r;
            // theta = M l / (E I) with I = pi r^4 / 4; `modulus` is E pi / 4.
            let angle = habit.sag[order] * gain * length / (modulus * square * square);
            let bends = angle * (length + self.scratch.beyond[i]) > LEAST_SHIFT;
            // The moment is stored if it bends the wood, if it has decreased, or if this order does not sag; otherwise the
            // gain accumulates until a bend is large enough.
            if bends || gain < 0.0 || habit.sag[order] <= 0.0 {
                nodes.moment[i] = moment;
            }
            // Orientation of the internode after the rotation of its parent, so that what the parent has righted is not
            // righted again.
            let mut q = carried * nodes.q[i];
            // `own` is the rotation that children inherit: all turns from the root to here.
            let mut own = carried;
            let rate = if nodes.flags[i] & flag::DEAD == 0 { habit.upright[order] } else { 0.0 };
            if bends || rate > 0.0 {
                let d = y_axis(q);
                let mut turn = Vec3::ZERO;
                if bends {
                    // Torsion is left out: the part of the torque along the internode.
                    turn = (torque - d * d.dot(torque)) * (limited_bend(angle, d) / moment);
                }
                if rate > 0.0 {
                    turn += righting(d, season, order, rate * length, r);
                }
                let turn = small_rotation(turn);
                own = turn * own;
                q = turn * q;
            }
            let mut q = renormalized(q);
            let mut d = y_axis(q);
            // Side branches are kept above the ground; wood that starts below it, on slopes, stays as it is.
            if order > 0 && new_base.y >= LOWEST && new_base.y + d.y * length < LOWEST {
                let up = math::rotation_between(d, lowest_direction(d, new_base.y, length));
                own = up * own;
                q = (up * q).normalize();
                d = y_axis(q);
            }
            turns[i] = own;
            nodes.q[i] = q;
            nodes.p[i] = new_base + d * length;
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

/// The bend of an internode, limited by how far it can hang.
/// Source: theta = min(0.5, 0.6 h (1 - exp(-theta / (0.6 h)))), h = angle to hanging.
#[inline]
fn limited_bend(angle: f32, d: Vec3) -> f32 {
    let most = BEND_SHARE * angle_of_cosine(-d.y);
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
fn righting(d: Vec3, season: &Season, order: usize, rate: f32, r: f32) -> Vec3 {
    let wanted = if order == 0 { Vec3::Y } else { raised(d, season.elevation[order]) };
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

/// A quaternion that is nearly of unit length, by one step of Newton's iteration for its length.
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
