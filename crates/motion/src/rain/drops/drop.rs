//! One drop on a leaf: where it is, how it moves, and the tail that it draws behind itself.

use glam::{DVec2, DVec3};

use crate::rain::drops::shape::{Footprint, SphericalCap};
use crate::rain::leaf::surface::MarginPoint;
use crate::rain::params::DropParams;
use osier_base::math;

/// Speed at which a drop is stretched and its tail is as long as it gets, m/s.
const BRISK: f64 = 0.15;
/// Spacing of the drops of a tail, in smaller base radii.
const SPACING: f64 = 0.9;
/// Time in which a tail grows or draws in, s.
const TAIL_TIME: f64 = 0.08;
/// Time in which the stretch of a merged drop fades, s.
const ROUNDS: f64 = 0.05;
/// Sphere radius of the smallest cap that a tail leaves behind as a bead, m; smaller ones are drawn in.
pub const MIN_BEAD_RADIUS: f64 = 3e-4;

/// How a pendant drop is attached to the margin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendantAnchor {
    /// Point of the margin that it hangs from.
    pub margin: MarginPoint,
    /// Radius of the circle that it hangs from, m.
    pub radius: f64,
    /// Unit vector along the blade, out over the margin.
    pub outward: DVec3,
    /// Time since it became too heavy, s; none while it is not.
    pub necking: Option<f64>,
}

/// A drop on a leaf; places and directions in metres of leaf space.
#[derive(Debug, Clone)]
pub struct SurfaceDrop {
    /// Emission index; stable over frames, threads and time steps.
    pub id: u64,
    /// 1 on the upper side, -1 below.
    pub side: f64,
    /// Texture coordinates of its center.
    pub uv: DVec2,
    /// Velocity relative to the leaf, tangential, m/s.
    pub v: DVec3,
    /// Volume with its tail, m^3.
    pub volume: f64,
    /// Present while it hangs at the margin.
    pub pendant: Option<PendantAnchor>,
    /// Direction of its footprint's long axis and of its lean, unit, along the blade.
    pub axis: DVec3,
    /// Share of the greatest lean.
    pub lean: f64,
    /// Time since it last merged, s.
    pub since_merge: f64,
    /// Places passed, the newest last, each with the way since the one before, m.
    pub path: Vec<(DVec2, f64)>,
    /// Way since it last chose where to go, m.
    pub since_steer: f64,
    /// Drops of its tail, itself among them.
    pub tail_count: f64,
    /// Draws of its own so far.
    pub bead_draws: u64,
    /// Nothing has happened since its leaf last compared it with the others.
    pub merge_tested: bool,
    /// It is at the margin, along which it goes.
    pub at_margin: bool,
    /// Where it last wetted the leaf.
    pub last_wet_uv: Option<DVec2>,
}

/// One of the caps that a drop with its tail is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DropCap {
    /// Texture coordinates of its center.
    pub uv: DVec2,
    /// Shape of the cap.
    pub cap: SphericalCap,
    /// m^3.
    pub volume: f64,
}

impl SurfaceDrop {
    /// A drop that has just come to lie.
    pub fn new(id: u64, side: f64, uv: DVec2, v: DVec3, volume: f64) -> Self {
        Self {
            id,
            side,
            uv,
            v,
            volume,
            pendant: None,
            axis: v.normalize_or(DVec3::Y),
            lean: 0.0,
            since_merge: f64::INFINITY,
            path: Vec::new(),
            since_steer: f64::INFINITY,
            tail_count: 1.0,
            bead_draws: 0,
            merge_tested: false,
            at_margin: false,
            last_wet_uv: None,
        }
    }

    /// Stretch of its footprint. Source: own, after photographs.
    pub fn stretch(&self) -> f64 {
        let moving = 0.5 * (self.v.length() / BRISK).min(1.0);
        1.0 + moving + 0.6 * math::exp(-self.since_merge / ROUNDS)
    }

    /// Footprint on the leaf: stretched by speed, skewed by its lean.
    pub fn footprint(&self, params: &DropParams) -> Footprint {
        Footprint { q: self.stretch(), skew: self.lean * params.wetting.lean() }
    }

    /// Its volume as shares of the drops of its tail, the head first. Source: [yang-wu] eq. 9, radii as a geometric series.
    pub fn cap_shares(&self, params: &DropParams) -> Vec<f64> {
        let cube = params.tail_beta * params.tail_beta * params.tail_beta;
        let whole = self.tail_count.floor().max(1.0);
        let mut shares = Vec::new();
        let mut share = 1.0;
        let mut left = whole;
        while left >= 1.0 {
            shares.push(share);
            share *= cube;
            left -= 1.0;
        }
        let rest = self.tail_count - whole;
        if rest > 1e-3 {
            shares.push(share * rest);
        }
        let sum: f64 = shares.iter().sum();
        shares.iter().map(|s| s / sum).collect()
    }

    /// The cap of its head, without the tail.
    pub fn head_cap(&self, params: &DropParams, facing: f64) -> SphericalCap {
        let share = self.cap_shares(params).first().copied().unwrap_or(1.0);
        params.wetting.cap(self.volume * share, facing)
    }

    /// Its head and the drops of its tail along the way that it came.
    pub fn caps(&self, params: &DropParams, facing: f64) -> Vec<DropCap> {
        let shares = self.cap_shares(params);
        let mut out: Vec<DropCap> = Vec::with_capacity(shares.len());
        let mut walk = PathWalker { path: &self.path, at: self.uv, left: self.path.len(), used: 0.0 };
        for share in shares {
            let volume = self.volume * share;
            let cap = params.wetting.cap(volume, facing);
            if out.last().is_some() {
                // The last of a tail may be small for being half gone, not for standing far back.
                walk.back(SPACING * cap.a.max(1e-5));
            }
            out.push(DropCap { uv: walk.at, cap, volume });
        }
        out
    }

    /// Appends a piece of `way` m that began at `from` to the path, and drops pieces too far back for the tail.
    pub fn record_path(&mut self, from: DVec2, way: f64, a: f64, params: &DropParams) {
        self.path.push((from, way));
        self.since_steer += way;
        let needed = SPACING * a * f64::from(params.tail_n) * 2.0;
        let mut sum = 0.0;
        let keep = self.path.iter().rev().take_while(|(_, w)| {
            sum += w;
            sum - w <= needed
        });
        let first = self.path.len() - keep.count();
        self.path.drain(..first);
    }

    /// Lets the tail grow or draw in for `h` s. Returns the index of the cap of the tail that is given up, if one is.
    pub fn step_tail(&mut self, a: f64, h: f64, params: &DropParams) -> Option<usize> {
        let length: f64 = self.path.iter().map(|(_, w)| w).sum();
        let most = 1.0 + length / (SPACING * a.max(1e-5));
        let speed = (self.v.length() / BRISK).min(1.0);
        let wanted = (1.0 + f64::from(params.tail_n.saturating_sub(1)) * params.rough * speed).min(most);
        let before = self.tail_count;
        self.tail_count += (wanted - self.tail_count) * (1.0 - math::exp(-h / TAIL_TIME));
        self.tail_count = self.tail_count.min(most).max(1.0);
        if wanted <= 1.0 && self.tail_count < 1.01 {
            self.tail_count = 1.0;
        }
        let lost = before.ceil() - 1.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small count")]
        (lost >= 1.0 && self.tail_count <= lost && before > lost).then_some(lost as usize)
    }

    /// Forgets its attachment and its path: it begins anew elsewhere.
    pub fn detach(&mut self) {
        self.pendant = None;
        self.path.clear();
        self.tail_count = 1.0;
    }
}

struct PathWalker<'a> {
    path: &'a [(DVec2, f64)],
    at: DVec2,
    left: usize,
    /// Share of the next piece that has been walked, m.
    used: f64,
}

impl PathWalker<'_> {
    /// Goes back along a path.
    fn back(&mut self, mut way: f64) {
        while let Some((from, length)) = self.left.checked_sub(1).and_then(|k| self.path.get(k)) {
            let rest = length - self.used;
            if way < rest {
                let share = if rest > 0.0 { way / rest } else { 0.0 };
                self.at += (*from - self.at) * share;
                self.used += way;
                return;
            }
            way -= rest;
            self.at = *from;
            self.left -= 1;
            self.used = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_tail_keeps_the_volume_and_the_papers_ratio() {
        let params = DropParams::default();
        let mut drop = SurfaceDrop::new(0, 1.0, DVec2::splat(0.5), DVec3::Y, 1e-8);
        drop.tail_count = 8.0;
        drop.path = (0..100).map(|k| (DVec2::new(0.5, 0.1 + 0.004 * f64::from(k)), 4e-4)).collect();
        let beads = drop.caps(&params, 1.0);
        assert_eq!(beads.len(), 8);
        let sum: f64 = beads.iter().map(|b| b.volume).sum();
        assert!((sum / 1e-8 - 1.0).abs() < 1e-12);
        let whole = params.wetting.cap(1e-8, 1.0);
        let ratio = math::cbrt(beads[0].volume / 1e-8);
        assert!((ratio - 0.789).abs() < 1e-3, "{ratio} of {}", whole.r);
        // Each is further back than the last, by nine tenths of its own base.
        for pair in beads.windows(2) {
            assert!(pair[1].uv.y < pair[0].uv.y);
        }
    }

    #[test]
    fn a_drop_that_stops_draws_its_tail_in_and_names_what_it_loses() {
        let params = DropParams::default();
        let mut drop = SurfaceDrop::new(0, 1.0, DVec2::splat(0.5), DVec3::Y * 0.3, 1e-8);
        drop.path = (0..100).map(|k| (DVec2::new(0.5, 0.1 + 0.004 * f64::from(k)), 4e-4)).collect();
        (0..200).for_each(|_| assert_eq!(drop.step_tail(1e-3, 0.01, &params), None));
        assert!(drop.tail_count > 7.9, "{}", drop.tail_count);
        drop.v = DVec3::ZERO;
        let lost: Vec<usize> = (0..200).filter_map(|_| drop.step_tail(1e-3, 0.005, &params)).collect();
        assert_eq!(lost, [7, 6, 5, 4, 3, 2, 1]);
        assert!((drop.tail_count - 1.0).abs() < 1e-12);
    }
}
