//! One drop on a leaf: its position and motion, and the tail that it draws behind itself.

use glam::{DVec2, DVec3};

use crate::rain::drops::spherical_cap::{CapDeformation, CapLaw, SphericalCap};
use crate::rain::leaf::surface::{MarginPoint, SurfacePoint};
use crate::rain::params::DropParams;
use crate::rain::tuning::{
    FULL_TAIL_SPEED, MERGE_STRETCH, MERGE_STRETCH_TIME, MIN_CAP_RADIUS, MIN_TAIL_SHARE, PATH_SPACING, SPEED_STRETCH,
    TAIL_SPACING, TAIL_TIME, TRACK_DISTANCE,
};
use osier_base::math;

/// Where and since when a pendant drop is attached to the margin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendantAnchor {
    /// Point of the margin that it hangs from, in leaf space.
    pub margin: MarginPoint,
    /// Radius of the circle along which it is attached, m.
    pub radius: f64,
    /// Unit tangent of the blade across the margin, outwards.
    pub outward: DVec3,
    /// Time since its volume exceeded the maximum, s; `None` while it does not.
    pub necking: Option<f64>,
    /// Maximum volume at the end of the last step, m^3; 0 before the first.
    pub max_volume: f64,
}

/// A point of the path that a drop has run along, from which its tail is placed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TailPathPoint {
    /// Texture coordinates of the drop's center when it was here.
    pub uv: DVec2,
    /// Length of the path from here to the next point (for the newest: to the drop), m.
    pub length: f64,
}

/// The cap of a drop's head, with the quantities that it was computed from, so that it can be reused.
#[derive(Debug, Clone, Copy, PartialEq)]
struct HeadCap {
    volume: f64,
    tail_count: f64,
    tail_ratio: f64,
    law: CapLaw,
    cap: SphericalCap,
}

/// The surface under a drop, with the texture coordinates at which it was located.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LocatedSurface {
    uv: DVec2,
    surface: SurfacePoint,
}

/// A drop on a leaf; positions and vectors are in leaf space.
#[derive(Debug, Clone)]
pub struct LeafDrop {
    /// Identifier, stable over frames, threads and time steps: a count, or for beads a random number. One of its bits is set for
    /// emitted drops, another for splash droplets, a third for beads.
    pub id: u64,
    /// Side of the leaf: 1 on the upper, -1 on the lower.
    pub side: f64,
    /// Texture coordinates of its center.
    pub uv: DVec2,
    /// Tangential velocity relative to the leaf, m/s.
    pub v: DVec3,
    /// Volume with the tail, m^3.
    pub volume: f64,
    /// Attachment while the drop hangs at the margin; `None` for a sessile drop.
    pub pendant: Option<PendantAnchor>,
    /// Unit tangent along which its footprint is stretched and sheared; for a pendant drop, the direction in which it hangs.
    pub axis: DVec3,
    /// Skew as a fraction of the largest, 0 to 1: the load on the contact line relative to its retention.
    pub lean: f64,
    /// Time since it last merged, s; infinite if it never has.
    pub since_merge: f64,
    /// The path that it has run along, the newest point last; as long as the tail needs.
    pub path: Vec<TailPathPoint>,
    /// Length of the path since it last chose a heading, m.
    pub since_steer: f64,
    /// Number of its caps, the head included; the fraction is the share of the last cap that has grown.
    pub tail_count: f64,
    /// Number of its random draws for beads so far, by which the next one is addressed.
    pub bead_draws: u64,
    /// Whether it has been tested against the other drops of its leaf since it last moved.
    pub merge_tested: bool,
    /// Whether it is at the margin; the event `edge` is recorded when it gets there.
    pub at_margin: bool,
    /// Texture coordinates at which it last wetted the leaf.
    pub last_wet_uv: Option<DVec2>,
    /// The point of the blade there, in leaf space, m; `None` beyond the blade, or if it has not wetted the leaf.
    pub last_wet_p: Option<DVec3>,
    /// The cap of its head when it was last computed.
    head: Option<HeadCap>,
    /// The surface under it, with the place at which it was located in the present step of the leaf.
    located: Option<LocatedSurface>,
}

/// One of the caps that a drop with its tail consists of, in the chart of the leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DropCap {
    /// Texture coordinates of its center.
    pub uv: DVec2,
    /// Shape without stretch and skew.
    pub cap: SphericalCap,
    /// Volume of this cap, m^3.
    pub volume: f64,
}

impl LeafDrop {
    /// A sessile drop without tail, with tangential velocity `v`, m/s, and `volume`, m^3.
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
            since_steer: 0.0,
            tail_count: 1.0,
            bead_draws: 0,
            merge_tested: false,
            at_margin: false,
            last_wet_uv: None,
            last_wet_p: None,
            head: None,
            located: None,
        }
    }

    /// Stretch of its footprint by speed and by a recent merger. Source: own, after photographs.
    pub fn stretch(&self) -> f64 {
        let moving = SPEED_STRETCH * (self.v.length() / FULL_TAIL_SPEED).min(1.0);
        // Two drops that merge form an elongated one; under surface tension its stretch decays exponentially.
        1.0 + moving + MERGE_STRETCH * math::exp(-self.since_merge / MERGE_STRETCH_TIME)
    }

    /// Deformation of the cap of the head: stretched by speed, skewed by the load on the contact line.
    pub fn cap_deformation(&self, params: &DropParams) -> CapDeformation {
        CapDeformation { stretch: self.stretch(), skew: self.lean * params.wetting.max_skew() }
    }

    /// Fractions of the volume that its caps hold, the head first; their sum is 1.
    /// Source: [yang-wu] eq. 9, radii as a geometric series.
    pub fn cap_shares(&self, params: &DropParams) -> Vec<f64> {
        // Radii fall by the ratio beta from cap to cap, volumes by beta^3.
        let cube = params.tail_ratio * params.tail_ratio * params.tail_ratio;
        let full_caps = self.tail_count.floor().max(1.0);
        let mut shares = Vec::new();
        let mut share = 1.0;
        let mut left = full_caps;
        while left >= 1.0 {
            shares.push(share);
            share *= cube;
            left -= 1.0;
        }
        // The last cap grows and shrinks continuously with the fraction of the count.
        let rest = self.tail_count - full_caps;
        if rest > MIN_TAIL_SHARE {
            shares.push(share * rest);
        }
        let sum: f64 = shares.iter().sum();
        shares.iter().map(|s| s / sum).collect()
    }

    /// The cap of the head without the tail, before it is stretched and sheared.
    pub fn head_cap(&self, params: &DropParams) -> SphericalCap {
        self.head_cap_by_law(&params.wetting.cap_law(), params)
    }

    /// As [`LeafDrop::head_cap`], by the law of `params`, which the caller has computed once for many drops.
    pub(super) fn head_cap_by_law(&self, law: &CapLaw, params: &DropParams) -> SphericalCap {
        self.head_by_law(law, params).cap
    }

    /// As [`LeafDrop::head_cap_by_law`], and keeps the cap for as long as volume, tail and law stay the same.
    pub(super) fn update_head_cap(&mut self, law: &CapLaw, params: &DropParams) -> SphericalCap {
        let head = self.head_by_law(law, params);
        self.head = Some(head);
        head.cap
    }

    fn head_by_law(&self, law: &CapLaw, params: &DropParams) -> HeadCap {
        let (volume, tail_count, tail_ratio) = (self.volume, self.tail_count, params.tail_ratio);
        if let Some(head) =
            self.head.filter(|head| HeadCap { volume, tail_count, tail_ratio, law: *law, ..*head } == *head)
        {
            return head;
        }
        let share = self.cap_shares(params).first().copied().unwrap_or(1.0);
        HeadCap { volume, tail_count, tail_ratio, law: *law, cap: law.cap(volume * share) }
    }

    /// The surface under it, if it has been located since the drop last moved.
    pub(super) fn located_surface(&self) -> Option<SurfacePoint> {
        self.located.filter(|located| located.uv == self.uv).map(|located| located.surface)
    }

    /// Stores the surface under the drop at its present place; `None` removes it.
    pub(super) fn set_located_surface(&mut self, surface: Option<SurfacePoint>) {
        self.located = surface.map(|surface| LocatedSurface { uv: self.uv, surface });
    }

    /// The caps of the head and of the tail, the head first, back along the path.
    pub fn caps(&self, params: &DropParams) -> Vec<DropCap> {
        let shares = self.cap_shares(params);
        let law = params.wetting.cap_law();
        let mut caps: Vec<DropCap> = Vec::with_capacity(shares.len());
        // Walk back from the center of the head, one spacing for each cap.
        let mut walker = PathWalker { path: &self.path, uv: self.uv, left: self.path.len(), walked: 0.0 };
        for share in shares {
            let volume = self.volume * share;
            let cap = law.cap(volume);
            if caps.last().is_some() {
                // Spacing by the smaller of two neighbours: a last cap that is half grown is close to the cap before it.
                walker.walk_back(TAIL_SPACING * cap.a.max(MIN_CAP_RADIUS));
            }
            caps.push(DropCap { uv: walker.uv, cap, volume });
        }
        caps
    }

    /// Appends a displacement of `length`, m, that began at `from` to the path, and removes points too far back for the tail.
    /// `a`: base radius of the head, m.
    pub fn record_path(&mut self, from: DVec2, length: f64, a: f64, params: &DropParams) {
        match self.path.last_mut() {
            Some(last) if last.length + length < PATH_SPACING * a => last.length += length,
            _ => self.path.push(TailPathPoint { uv: from, length }),
        }
        self.since_steer += length;
        // Twice the length of the longest tail, as the head may grow by merging, and of the distance of wet tracks.
        let needed = (TAIL_SPACING * f64::from(params.tail_drops)).max(TRACK_DISTANCE) * a * 2.0;
        let mut sum = 0.0;
        let keep = self.path.iter().rev().take_while(|point| {
            sum += point.length;
            sum - point.length <= needed
        });
        let first = self.path.len() - keep.count();
        self.path.drain(..first);
    }

    /// Texture coordinates of the place on the path that is `distance`, m, behind; `None` if the path is shorter.
    pub fn place_behind(&self, distance: f64) -> Option<DVec2> {
        let mut walker = PathWalker { path: &self.path, uv: self.uv, left: self.path.len(), walked: 0.0 };
        walker.walk_back(distance);
        (walker.left > 0).then_some(walker.uv)
    }

    /// Number of caps, the head included, that the drop has `h` seconds later; it approaches a number proportional to the speed.
    /// `a`: base radius of the head, m.
    pub fn tail_count_after(&self, h: f64, a: f64, params: &DropParams) -> f64 {
        // A tail is no longer than the path that the drop has run.
        let length: f64 = self.path.iter().map(|point| point.length).sum();
        let most = 1.0 + length / (TAIL_SPACING * a.max(MIN_CAP_RADIUS));
        let speed = (self.v.length() / FULL_TAIL_SPEED).min(1.0);
        let target = (1.0 + f64::from(params.tail_drops.saturating_sub(1)) * params.tail_amount * speed).min(most);
        // Exponential approach, exact for any step: dn/dt = (target - n) / tau.
        let count = target + (self.tail_count - target) * math::exp(-h / TAIL_TIME);
        let count = count.min(most).max(1.0);
        if target <= 1.0 && count < 1.01 { 1.0 } else { count }
    }

    /// Removes attachment, path and tail from a drop that leaves its place, such as one that becomes pendant.
    pub fn clear_history(&mut self) {
        self.pendant = None;
        self.path.clear();
        self.tail_count = 1.0;
    }
}

/// A position on a drop's path that moves back from the drop.
struct PathWalker<'a> {
    path: &'a [TailPathPoint],
    /// Texture coordinates of the position.
    uv: DVec2,
    /// Number of path points that have not been passed.
    left: usize,
    /// Length already walked of the piece that the position is on, m.
    walked: f64,
}

impl PathWalker<'_> {
    /// Moves back by `distance`, m, at most to the beginning of the path.
    fn walk_back(&mut self, mut distance: f64) {
        while let Some(point) = self.left.checked_sub(1).and_then(|k| self.path.get(k)) {
            let rest = point.length - self.walked;
            if distance < rest {
                let fraction = if rest > 0.0 { distance / rest } else { 0.0 };
                self.uv += (point.uv - self.uv) * fraction;
                self.walked += distance;
                return;
            }
            // Past this point: continue on the piece before it.
            distance -= rest;
            self.uv = point.uv;
            self.left -= 1;
            self.walked = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path_point(k: u32) -> TailPathPoint {
        TailPathPoint { uv: DVec2::new(0.5, 0.1 + 0.004 * f64::from(k)), length: 4e-4 }
    }

    #[test]
    fn a_full_tail_keeps_the_volume_and_the_papers_ratio() {
        let params = DropParams::default();
        let mut drop = LeafDrop::new(0, 1.0, DVec2::splat(0.5), DVec3::Y, 1e-8);
        drop.tail_count = 8.0;
        drop.path = (0..100).map(path_point).collect();
        let beads = drop.caps(&params);
        assert_eq!(beads.len(), 8);
        let sum: f64 = beads.iter().map(|b| b.volume).sum();
        assert!((sum / 1e-8 - 1.0).abs() < 1e-12);
        let whole = params.wetting.cap(1e-8);
        let ratio = math::cbrt(beads[0].volume / 1e-8);
        assert!((ratio - 0.789).abs() < 1e-3, "{ratio} of {}", whole.r);
        // Each cap is further back than the one before it, by nine tenths of its base radius.
        for pair in beads.windows(2) {
            assert!(pair[1].uv.y < pair[0].uv.y);
        }
    }

    #[test]
    fn a_tail_grows_with_the_speed_and_is_drawn_in_alike_for_any_step() {
        let params = DropParams::default();
        let ends = [1, 8, 64].map(|steps: u32| {
            let mut drop = LeafDrop::new(0, 1.0, DVec2::splat(0.5), DVec3::Y * 0.3, 1e-8);
            drop.path = (0..100).map(path_point).collect();
            let run = |drop: &mut LeafDrop, seconds: f64| {
                let h = seconds / f64::from(steps);
                (0..steps).for_each(|_| drop.tail_count = drop.tail_count_after(h, 1e-3, &params));
                drop.tail_count
            };
            let grown = run(&mut drop, 0.5);
            drop.v = DVec3::ZERO;
            [grown, run(&mut drop, 0.1), run(&mut drop, 1.0)]
        });
        for [grown, shrinking, end] in ends {
            assert!(grown > 7.9 && (shrinking - ends[0][1]).abs() < 1e-9 && (end - 1.0).abs() < 1e-12, "{ends:?}");
        }
    }
}
