//! Measures of a tree as in forestry: height, crown, diameter at breast height, leaf area.

use glam::Vec3;

use super::tree::{NONE, Tree, flag};

/// Length along a stem at which its diameter is measured, m.
const BREAST_HEIGHT: f32 = 1.3;

/// Size, crown, stem and leaf area of a tree at one age. Height and crown are 0 without living tips.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    /// Height of its highest open living tip above its base, m.
    pub height: f32,
    /// Mean of the extents of its living tips along x and z, m.
    pub crown_width: f32,
    /// Mean position of its living tips, relative to its base, m.
    pub crown_center: Vec3,
    /// Diameter of its thickest stem at 1.3 m of length, m; 0 for a smaller tree.
    pub dbh: f32,
    /// Number of standing internodes, including dead ones.
    pub nodes: usize,
    /// Number of living tips that are open: they bear leaves and may grow on.
    pub tips: usize,
    /// One-sided area of the leaves on living wood, m2.
    pub leaf_area: f32,
    /// Leaf area divided by the area of a disc of diameter `crown_width`; 0 for a crown without width.
    pub leaf_area_index: f32,
}

impl Tree {
    pub fn measures(&self) -> Measures {
        let nodes = &self.nodes;
        let (mut low, mut high, mut sum) = (Vec3::INFINITY, Vec3::NEG_INFINITY, glam::DVec3::ZERO);
        let (mut tips, mut leaf_area, mut dbh) = (0_usize, 0.0_f64, 0.0_f32);
        for i in 0..nodes.len() {
            if nodes.lives(i) {
                leaf_area += f64::from(self.leaf_area(i));
            }
            if nodes.grows(i) {
                low = low.min(nodes.p[i]);
                high = high.max(nodes.p[i]);
                sum += nodes.p[i].as_dvec3();
                tips += 1;
            }
            let crosses = nodes.path[i] >= BREAST_HEIGHT && nodes.path[i] - nodes.length[i] < BREAST_HEIGHT;
            if crosses && nodes.order[i] == 0 && nodes.flags[i] & flag::FALLEN == 0 {
                dbh = dbh.max(2.0 * nodes.r[i]);
            }
        }
        let size = if tips > 0 { high - low } else { Vec3::ZERO };
        let crown_width = 0.5 * (size.x + size.z);
        let area = std::f32::consts::FRAC_PI_4 * crown_width * crown_width;
        let leaf_area = osier_base::math::narrow(leaf_area);
        Measures {
            height: if tips > 0 { high.y } else { 0.0 },
            crown_width,
            crown_center: if tips > 0 { (sum / tips as f64).as_vec3() } else { Vec3::ZERO },
            dbh,
            nodes: nodes.len() - self.fallen,
            tips,
            leaf_area,
            leaf_area_index: if area > 0.0 { leaf_area / area } else { 0.0 },
        }
    }

    /// Strahler orders of the living wood: the number of branches of each order, from 1.
    /// Source: Strahler 1957: a tip has order 1; where two branches of the same highest order meet, the order rises.
    pub fn strahler_counts(&self) -> Vec<usize> {
        let nodes = &self.nodes;
        let mut highest = vec![(0_u8, 0_u8); nodes.len()];
        let mut counts = vec![0_usize; 32];
        for i in (0..nodes.len()).rev().filter(|i| nodes.lives(*i)) {
            // A node without living children is a tip; if two children share the highest order, the order rises.
            let (top, times) = highest[i];
            let order = if top == 0 {
                1
            } else if times > 1 {
                top + 1
            } else {
                top
            };
            if top == 0 || times > 1 {
                counts[usize::from(order).min(31)] += 1;
            }
            if nodes.parent[i] != NONE {
                let at = &mut highest[nodes.parent[i] as usize];
                if order > at.0 {
                    *at = (order, 1);
                } else if order == at.0 {
                    at.1 = at.1.saturating_add(1);
                }
            }
        }
        let last = counts.iter().rposition(|c| *c > 0).unwrap_or(0);
        counts[1.min(last)..=last].to_vec()
    }
}
