//! Radii by the pipe model, including the pipes of dead wood and a least radius against buckling.

use super::season::Season;
use super::tree::{NONE, Tree, flag};
use osier_base::math;

/// Margin larger than the relative error of a power in single precision and of the inverse power.
const POWER_ERROR: f32 = 1e-4;

impl Tree {
    /// Thickens wood from the tips to the base.
    /// Source: [shinozaki], [eloy]: r^n = sum of r^n of living children + tip_radius^n of an open tip + pipes of dead children
    /// that are kept. [mcmahon]: no axis is thinner than a column that would carry `buckling_safety` times its length,
    /// r >= 0.5 (safety b / (c (E / (rho g))^(1/3)))^1.5. Radii never shrink.
    pub fn thicken(&mut self, season: &Season) {
        let habit = &self.habit;
        let nodes = &mut self.nodes;
        let scratch = &mut self.scratch;
        for values in [&mut scratch.area, &mut scratch.beyond] {
            values.clear();
            values.resize(nodes.len(), 0.0);
        }
        let exponent = habit.pipe_exponent;
        let root = 1.0 / exponent;
        let tip = math::pow_f32(habit.tip_radius, exponent);
        // Children come after their parents: from the end, the areas of all children are summed before their parent is reached.
        for i in (0..nodes.len()).rev() {
            if !nodes.lives(i) {
                continue;
            }
            let open = if nodes.flags[i] & flag::OPEN != 0 { tip } else { 0.0 };
            let mut area = scratch.area[i] + nodes.lost[i] + open;
            // Length of the column from the base of the internode to the end of the axis.
            let beyond = scratch.beyond[i] + nodes.length[i];
            let part = habit.buckling_safety[usize::from(nodes.order[i])] * beyond / season.critical_length;
            // Greenhill: a column buckles under its own weight at the length l = c d^(2/3); solved for r = d / 2 this is 0.5 (l /
            // c)^1.5, with part = l / c.
            let least = 0.5 * part * part.sqrt();
            // Powers are computed only where the wood has grown.
            let grew = area > nodes.area[i];
            let mut r = if grew { math::pow_f32(area, root) } else { nodes.r[i] };
            // The pipe model mostly requires thicker wood than that; the margin covers the rounding errors of both powers.
            if least > nodes.r[i] && least * (1.0 + POWER_ERROR) > r {
                let needed = math::pow_f32(least, exponent);
                if needed > area {
                    area = needed;
                    r = math::pow_f32(area, root);
                }
            }
            if area > nodes.area[i] {
                nodes.area[i] = area;
                nodes.r[i] = r;
            }
            let parent = nodes.parent[i];
            if parent != NONE {
                scratch.area[parent as usize] += nodes.area[i];
                // Only the continuation of the axis lengthens the column; side branches are separate columns.
                if nodes.flags[i] & flag::MAIN != 0 {
                    scratch.beyond[parent as usize] = beyond;
                }
            }
        }
    }
}
