//! A tree in the middle of a year.

use super::tree::{Tree, flag};
use osier_base::math;

impl Tree {
    /// Shows a part of the year that was computed last: later internodes are missing, the current one of a shoot is shortened,
    /// wood is thickened and bent in part. Over the year, leaves of new tips unfold, and leaves that are lost this year fall.
    /// `before`: the tree a year ago, whose nodes have the same indices.
    pub fn show_part_of_year(&mut self, before: &Self, part: f32) {
        let (exponent, tip) = (self.habit.pipe_exponent, self.habit.tip_radius);
        let root = 1.0 / exponent;
        let tip_area = math::pow_f32(tip, exponent);
        self.part = part;
        let first_new = before.nodes.len();
        let start_of_year = before.year as f32;
        for i in 0..self.nodes.len() {
            let base = match self.nodes.p.get(self.nodes.parent[i] as usize) {
                Some(p) => *p,
                // Roots stay where they are.
                None => self.nodes.base(i),
            };
            let parent = self.nodes.parent[i] as usize;
            let nodes = &mut self.nodes;
            if i < first_new {
                nodes.area[i] = math::lerp(before.nodes.area[i], nodes.area[i], part);
                nodes.q[i] = math::nlerp(before.nodes.q[i], nodes.q[i], part);
            } else {
                // An internode grows from the birth of the one before it, or from the start of the year, to its own birth.
                let start = if parent >= first_new { nodes.birth[parent] - start_of_year } else { 0.0 };
                let end = nodes.birth[i] - start_of_year;
                let shown = ((part - start) / (end - start).max(1e-6)).clamp(0.0, 1.0);
                let carrier_shown = nodes.flags.get(parent).is_none_or(|f| f & flag::FALLEN == 0);
                if shown <= 0.0 || !carrier_shown {
                    if nodes.flags[i] & flag::FALLEN == 0 {
                        nodes.flags[i] |= flag::FALLEN;
                        self.fallen += 1;
                    }
                    // The last visible internode bears the tip.
                    if carrier_shown && nodes.flags[i] & flag::MAIN != 0 {
                        nodes.flags[parent] |= flag::OPEN;
                    }
                    continue;
                }
                let hidden = nodes.length[i] * (1.0 - shown);
                nodes.length[i] -= hidden;
                nodes.s[i] -= hidden;
                nodes.path[i] -= hidden;
                nodes.area[i] = math::lerp(tip_area, nodes.area[i], part);
            }
            nodes.r[i] = math::pow_f32(nodes.area[i], root);
            nodes.p[i] = base + nodes.direction(i) * nodes.length[i];
        }
    }
}
