//! The values of a habit in one year of a tree, blended from young to old, in radians.

use super::habit::{Habit, ORDERS, PerOrder};
use osier_base::math;

/// Acceleration of gravity, m/s2, along -Y.
pub(super) const GRAVITY: f32 = 9.81;
/// Greenhill's constant: a column of diameter d buckles under its own weight at the length c (E / (rho g))^(1/3) d^(2/3).
/// Source: [mcmahon], after Greenhill 1881.
const GREENHILL: f32 = 0.788;

/// Values of a habit in one year of a tree's life, blended from young to old.
#[derive(Debug, Clone)]
pub(super) struct Season {
    /// Year of the tree's life that grows, from 1.
    pub year: u32,
    /// For each order, weight of an axis's continuation relative to its side branches and buds, 0..1.
    pub apical_control: PerOrder,
    /// For each order, angle at which a shoot leaves its parent, rad.
    pub angle: PerOrder,
    /// Standard deviation of `angle`, rad, for all orders.
    pub angle_var: f32,
    /// Sine and cosine of the elevation towards which axes turn.
    pub elevation: [[f32; 2]; ORDERS],
    /// Factor on the growth of the leader: 1 in a young tree, `leader_old` in an old one.
    pub leader: f32,
    /// Factor on all growth, 0..1: below 1 in a seedling.
    pub juvenile: f32,
    /// Height below which branches are removed, m; 0: none are.
    pub clear_stem: f32,
    /// Critical length of a column of 1 m diameter, m^(1/3).
    pub critical_length: f32,
}

impl Season {
    pub fn new(habit: &Habit, year: u32) -> Self {
        let at = year as f32;
        // 0 in a young tree to 1 in an old one; all "old" values are blended by it.
        let maturity = math::smoothstep(habit.maturity[0], habit.maturity[1], at);
        let blend = |young: &PerOrder, old: &PerOrder| {
            let mut out = *young;
            out.iter_mut().zip(old).for_each(|(v, old)| *v += (old - *v) * maturity);
            out
        };
        let juvenile = if habit.juvenile > 0.0 {
            // The tree counts as 0.35 `juvenile` years older than it is, so that a seedling grows in its first year.
            math::smoothstep(0.0, 1.0, (at + 0.35 * habit.juvenile) / habit.juvenile)
        } else {
            1.0
        };
        // E / (rho g) in m: the argument of the cube root in Greenhill's formula.
        let stiffness = habit.elasticity_gpa * 1e9 / (habit.density * GRAVITY);
        Self {
            year,
            apical_control: blend(&habit.apical_control, &habit.apical_control_old),
            angle: blend(&habit.angle, &habit.angle_old).map(f32::to_radians),
            angle_var: habit.angle_var.to_radians(),
            elevation: habit.elevation.map(|e| {
                let e = e.to_radians();
                [math::sin_f32(e), math::cos_f32(e)]
            }),
            leader: 1.0 + (habit.leader_old - 1.0) * maturity,
            juvenile,
            clear_stem: if habit.clears_stem() { habit.clear_stem.min(habit.clear_rate * at) } else { 0.0 },
            critical_length: GREENHILL * math::cbrt_f32(stiffness),
        }
    }
}
