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
/// Radii of the smallest drop that a tail leaves behind, m.
pub const BEAD: f64 = 3e-4;

/// How a drop hangs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendantAnchor {
    /// Where on the margin.
    pub rim: MarginPoint,
    /// Radius of the circle that it hangs from, m.
    pub radius: f64,
    /// Over the margin, unit, along the blade.
    pub out: DVec3,
    /// Time for which it has been too heavy, s.
    pub thin: Option<f64>,
}

/// A drop on a leaf; places and directions in metres of leaf space.
#[derive(Debug, Clone)]
pub struct SurfaceDrop {
    /// By birth.
    pub id: u64,
    /// 1 on the upper side, -1 below.
    pub side: f64,
    /// Where.
    pub uv: DVec2,
    /// Along the blade, m/s.
    pub v: DVec3,
    /// m^3.
    pub volume: f64,
    /// Present while it hangs at the margin.
    pub hang: Option<PendantAnchor>,
    /// Direction of its footprint's long axis and of its lean, unit, along the blade.
    pub axis: DVec3,
    /// Share of the greatest lean.
    pub lean: f64,
    /// Since it merged, s, and along what.
    pub merged: f64,
    /// Places passed, the newest last, each with the way since the one before, m.
    pub path: Vec<(DVec2, f64)>,
    /// Way since it last chose where to go, m.
    pub straight: f64,
    /// Drops of its tail, itself among them.
    pub active: f64,
    /// Draws of its own so far.
    pub draws: u64,
    /// Nothing has happened since its leaf last compared it with the others.
    pub quiet: bool,
    /// It is at the margin, along which it goes.
    pub edge: bool,
    /// Where it last wetted the leaf.
    pub wetted: Option<DVec2>,
}

/// One of the caps that a drop with its tail is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DropCap {
    /// Where.
    pub uv: DVec2,
    /// Its shape.
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
            hang: None,
            axis: v.normalize_or(DVec3::Y),
            lean: 0.0,
            merged: f64::INFINITY,
            path: Vec::new(),
            straight: f64::INFINITY,
            active: 1.0,
            draws: 0,
            quiet: false,
            edge: false,
            wetted: None,
        }
    }

    /// Stretch of its footprint. Source: own, after photographs.
    pub fn stretch(&self) -> f64 {
        let moving = 0.5 * (self.v.length() / BRISK).min(1.0);
        1.0 + moving + 0.6 * math::exp(-self.merged / ROUNDS)
    }

    /// Its footprint.
    pub fn print(&self, manner: &DropParams) -> Footprint {
        Footprint { q: self.stretch(), skew: self.lean * manner.wetting.lean() }
    }

    /// Its volume as shares of the drops of its tail, the head first. Source: [yang-wu] eq. 9, radii as a geometric series.
    pub fn shares(&self, manner: &DropParams) -> Vec<f64> {
        let cube = manner.tail_beta * manner.tail_beta * manner.tail_beta;
        let whole = self.active.floor().max(1.0);
        let mut shares = Vec::new();
        let mut share = 1.0;
        let mut left = whole;
        while left >= 1.0 {
            shares.push(share);
            share *= cube;
            left -= 1.0;
        }
        let rest = self.active - whole;
        if rest > 1e-3 {
            shares.push(share * rest);
        }
        let sum: f64 = shares.iter().sum();
        shares.iter().map(|s| s / sum).collect()
    }

    /// The cap of its head.
    pub fn head(&self, manner: &DropParams, facing: f64) -> SphericalCap {
        let share = self.shares(manner).first().copied().unwrap_or(1.0);
        manner.wetting.cap(self.volume * share, facing)
    }

    /// Its head and the drops of its tail along the way that it came.
    pub fn beads(&self, manner: &DropParams, facing: f64) -> Vec<DropCap> {
        let shares = self.shares(manner);
        let mut out: Vec<DropCap> = Vec::with_capacity(shares.len());
        let mut walk = PathWalker { path: &self.path, at: self.uv, left: self.path.len(), used: 0.0 };
        for share in shares {
            let volume = self.volume * share;
            let cap = manner.wetting.cap(volume, facing);
            if out.last().is_some() {
                // The last of a tail may be small for being half gone, not for standing far back.
                walk.back(SPACING * cap.a.max(1e-5));
            }
            out.push(DropCap { uv: walk.at, cap, volume });
        }
        out
    }

    /// Goes on by a way: remembers it, and forgets what is too far back for the tail.
    pub fn pass(&mut self, from: DVec2, way: f64, a: f64, manner: &DropParams) {
        self.path.push((from, way));
        self.straight += way;
        let needed = SPACING * a * f64::from(manner.tail_n) * 2.0;
        let mut sum = 0.0;
        let keep = self.path.iter().rev().take_while(|(_, w)| {
            sum += w;
            sum - w <= needed
        });
        let first = self.path.len() - keep.count();
        self.path.drain(..first);
    }

    /// Lets its tail grow or draw in for `h` seconds, and returns the shares of what it leaves behind: number of the drop of
    /// the tail that lets go, if one does.
    pub fn tail(&mut self, a: f64, h: f64, manner: &DropParams) -> Option<usize> {
        let length: f64 = self.path.iter().map(|(_, w)| w).sum();
        let most = 1.0 + length / (SPACING * a.max(1e-5));
        let speed = (self.v.length() / BRISK).min(1.0);
        let wanted = (1.0 + f64::from(manner.tail_n.saturating_sub(1)) * manner.rough * speed).min(most);
        let before = self.active;
        self.active += (wanted - self.active) * (1.0 - math::exp(-h / TAIL_TIME));
        self.active = self.active.min(most).max(1.0);
        if wanted <= 1.0 && self.active < 1.01 {
            self.active = 1.0;
        }
        let lost = before.ceil() - 1.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small count")]
        (lost >= 1.0 && self.active <= lost && before > lost).then_some(lost as usize)
    }

    /// Places of the margin and of the blade do not matter any more.
    pub fn loosen(&mut self) {
        self.hang = None;
        self.path.clear();
        self.active = 1.0;
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
        let manner = DropParams::default();
        let mut drop = SurfaceDrop::new(0, 1.0, DVec2::splat(0.5), DVec3::Y, 1e-8);
        drop.active = 8.0;
        drop.path = (0..100).map(|k| (DVec2::new(0.5, 0.1 + 0.004 * f64::from(k)), 4e-4)).collect();
        let beads = drop.beads(&manner, 1.0);
        assert_eq!(beads.len(), 8);
        let sum: f64 = beads.iter().map(|b| b.volume).sum();
        assert!((sum / 1e-8 - 1.0).abs() < 1e-12);
        let whole = manner.wetting.cap(1e-8, 1.0);
        let ratio = math::cbrt(beads[0].volume / 1e-8);
        assert!((ratio - 0.789).abs() < 1e-3, "{ratio} of {}", whole.r);
        // Each is further back than the last, by nine tenths of its own base.
        for pair in beads.windows(2) {
            assert!(pair[1].uv.y < pair[0].uv.y);
        }
    }

    #[test]
    fn a_drop_that_stops_draws_its_tail_in_and_names_what_it_loses() {
        let manner = DropParams::default();
        let mut drop = SurfaceDrop::new(0, 1.0, DVec2::splat(0.5), DVec3::Y * 0.3, 1e-8);
        drop.path = (0..100).map(|k| (DVec2::new(0.5, 0.1 + 0.004 * f64::from(k)), 4e-4)).collect();
        (0..200).for_each(|_| assert_eq!(drop.tail(1e-3, 0.01, &manner), None));
        assert!(drop.active > 7.9, "{}", drop.active);
        drop.v = DVec3::ZERO;
        let lost: Vec<usize> = (0..200).filter_map(|_| drop.tail(1e-3, 0.005, &manner)).collect();
        assert_eq!(lost, [7, 6, 5, 4, 3, 2, 1]);
        assert!((drop.active - 1.0).abs() < 1e-12);
    }
}
