//! Drops as closed meshes that fit the leaf under them.

mod tail_body;

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3, Vec3};

use crate::rain::drops::pendant::{PendantShapes, necked_profile};
use crate::rain::drops::rain_leaf::RainLeaf;
use crate::rain::drops::shape::SphericalCap;
use crate::rain::frame::{PendantDrop, SessileDrop};
use crate::rain::leaf::surface::SurfacePoint;
use crate::rain::mesh::tail_body::TailBody;
use crate::rain::target::LeafPose;
use osier_base::math;
use osier_scene::Mesh;

/// Rings and sides of a small drop, of a larger one, and the base radius from which it is large, m.
const SMALL_DROP_GRID: [u32; 2] = [6, 24];
const LARGE_DROP_GRID: [u32; 2] = [12, 48];
const LARGE_DROP_RADIUS: f64 = 1e-3;
/// Columns of a drop with a tail.
const TAIL_COLUMNS: u32 = 14;
/// How far water reaches under the leaf's surface, so that no air is left between, m.
const UNDERSIDE_DEPTH: f64 = 1e-4;
/// Sides of a drop that hangs, and the height of its upper end over the circle it hangs from, in radii.
const PENDANT_SIDES: u32 = 32;
const SEAT_HEIGHT: f64 = 0.35;
/// Points along a hanging drop.
const PROFILE_POINTS: usize = 40;

/// Water of a frame: one mesh, with the velocity of each point, m/s.
#[derive(Debug, Default)]
pub struct DropMesh {
    /// It; the world's metres.
    pub mesh: Mesh,
    /// One per point.
    pub velocities: Vec<Vec3>,
}

/// Where points of a drop are put.
pub(super) struct DropPlacement<'a> {
    pub(super) leaf: &'a RainLeaf,
    blade: &'a LeafPose,
    uv: DVec2,
    pub(super) spot: SurfacePoint,
    side: f64,
    v: DVec3,
}

impl<'a> DropPlacement<'a> {
    fn new(leaf: &'a RainLeaf, blade: &'a LeafPose, uv: DVec2, side: f64, v: DVec3) -> Option<Self> {
        Some(Self { leaf, blade, uv, spot: leaf.at(uv)?, side, v })
    }

    /// A way along the leaf from the middle, and a height over it, m: in the world.
    pub(super) fn point(&self, way: DVec3, height: f64) -> DVec3 {
        let there = self.uv + self.spot.uv(way);
        let s = self.leaf.sheet.extrapolate(there, &self.spot, self.uv, self.leaf.scale);
        self.blade.position + self.blade.orientation * (s.p + s.n * (self.side * height))
    }
}

impl DropMesh {
    fn add_point(&mut self, p: DVec3, carrier: (&LeafPose, DVec3)) -> u32 {
        let (blade, v) = carrier;
        let index = u32::try_from(self.mesh.points.len()).unwrap_or(u32::MAX);
        self.mesh.points.push(p.as_vec3());
        self.velocities.push((blade.velocity_at(p) + blade.orientation * v).as_vec3());
        index
    }

    fn triangle(&mut self, t: [u32; 3], flip: bool) {
        self.mesh.triangles.push(if flip { [t[0], t[2], t[1]] } else { t });
    }

    /// Normals of everything from a triangle on; points that only those share.
    fn compute_normals(&mut self, first_point: usize, first: usize) {
        let Mesh { points, normals, triangles, .. } = &mut self.mesh;
        normals.resize(points.len(), Vec3::ZERO);
        for t in &triangles[first..] {
            let [a, b, c] = t.map(|i| points[i as usize].as_dvec3());
            let n = (b - a).cross(c - a).as_vec3() * 1e6;
            t.iter().for_each(|i| normals[*i as usize] += n);
        }
        for n in &mut normals[first_point..] {
            *n = math::normalize_or(*n, Vec3::Y);
        }
    }

    /// Adds a drop that lies on a leaf.
    pub fn add_sessile(&mut self, leaf: &RainLeaf, pose: &LeafPose, drop: &SessileDrop) {
        let Some(head) = drop.beads.first() else { return };
        let Some(base) = DropPlacement::new(leaf, pose, head.uv, drop.side, drop.v) else { return };
        if drop.beads.len() > 1 {
            self.add_tail_body(&base, drop);
        } else {
            self.add_cap(&base, &head.cap, drop);
        }
    }

    /// Rings around the middle, dense at the rim. Source: own.
    fn add_cap(&mut self, base: &DropPlacement<'_>, cap: &SphericalCap, drop: &SessileDrop) {
        let theta = math::acos(cap.c.clamp(-1.0, 1.0));
        let [rings, sides] = if cap.reach() < LARGE_DROP_RADIUS { SMALL_DROP_GRID } else { LARGE_DROP_GRID };
        // What overhangs has more to show.
        let rings = if theta > FRAC_PI_2 { rings * 2 } else { rings };
        let n = base.spot.n;
        let along = (drop.axis - n * drop.axis.dot(n)).normalize_or(n.any_orthonormal_vector());
        let across = n.cross(along);
        let ring = |k: u32| theta * (1.0 - math::pow(1.0 - f64::from(k) / f64::from(rings), 1.6));
        let fuller = facet_volume_factor(&(0..=rings).map(ring).collect::<Vec<_>>(), sides);
        let at = |r1: f64, phi: f64, h: f64| {
            let (x, y) = (r1 * math::cos(phi) * drop.print.q, r1 * math::sin(phi) / drop.print.q);
            base.point(along * x + across * y, h)
        };
        let place = |q: f64, phi: f64| {
            let r1 = cap.r * math::sin(q);
            let lean = 1.0 + drop.print.skew * (r1 / cap.a * math::cos(phi)).clamp(-1.0, 1.0);
            let h = fuller * cap.omega * cap.r * (math::cos(q) - cap.c) * lean;
            at(r1, phi, h.max(0.0))
        };
        let (start, first) = (self.mesh.points.len(), self.mesh.triangles.len());
        let carrier = (base.blade, base.v);
        let flip = base.side < 0.0;
        let top = self.add_point(place(0.0, 0.0), carrier);
        let mut rim = Vec::new();
        for k in 1..=rings {
            let q = ring(k);
            let ring: Vec<u32> =
                (0..sides).map(|i| self.add_point(place(q, TAU * f64::from(i) / f64::from(sides)), carrier)).collect();
            for i in 0..sides as usize {
                let j = (i + 1) % sides as usize;
                if k == 1 {
                    self.triangle([top, ring[i], ring[j]], flip);
                } else {
                    let before: &[u32] = &rim;
                    self.triangle([before[i], ring[i], ring[j]], flip);
                    self.triangle([before[i], ring[j], before[j]], flip);
                }
            }
            rim = ring;
        }
        self.compute_normals(start, first);
        let foot = cap.r * math::sin(theta);
        self.close_cap_underside(base, &rim, rings / 2, |share, phi| at(foot * share, phi, -UNDERSIDE_DEPTH));
    }

    /// Closes a drop under the leaf: a skirt, and rings that follow what is under it, as air that a flat bottom left in a fold
    /// would mirror. `rim`: counter-clockwise seen from above; `place`: by share of the way to it, and angle.
    fn close_cap_underside(
        &mut self,
        base: &DropPlacement<'_>,
        rim: &[u32],
        rings: u32,
        place: impl Fn(f64, f64) -> DVec3,
    ) {
        let (start, first) = (self.mesh.points.len(), self.mesh.triangles.len());
        let (carrier, flip) = ((base.blade, base.v), base.side < 0.0);
        let sides = rim.len();
        let count = u32::try_from(sides).unwrap_or(u32::MAX);
        let mut before: Vec<u32> = rim.iter().map(|i| self.duplicate_point(*i)).collect();
        for k in (1..=rings).rev() {
            let share = f64::from(k) / f64::from(rings);
            let angles = (0_u32..).map(|i| TAU * f64::from(i) / f64::from(count)).take(sides);
            let ring: Vec<u32> = angles.map(|phi| self.add_point(place(share, phi), carrier)).collect();
            for i in 0..sides {
                let j = (i + 1) % sides;
                self.triangle([before[i], ring[i], ring[j]], flip);
                self.triangle([before[i], ring[j], before[j]], flip);
            }
            before = ring;
        }
        let middle = self.add_point(place(0.0, 0.0), carrier);
        for i in 0..sides {
            self.triangle([middle, before[(i + 1) % sides], before[i]], flip);
        }
        self.compute_normals(start, first);
    }

    fn duplicate_point(&mut self, i: u32) -> u32 {
        let index = u32::try_from(self.mesh.points.len()).unwrap_or(u32::MAX);
        self.mesh.points.push(self.mesh.points[i as usize]);
        self.velocities.push(self.velocities[i as usize]);
        index
    }

    /// A drop with its tail as one body: rows across its way, that narrow from its head to its end. Source: own.
    fn add_tail_body(&mut self, base: &DropPlacement<'_>, drop: &SessileDrop) {
        let Some(line) = TailBody::new(base, drop) else { return };
        let (start, first) = (self.mesh.points.len(), self.mesh.triangles.len());
        let carrier = (base.blade, base.v);
        let rows = line.rows();
        let ends = [0, rows].map(|k| {
            let p = line.point(base, line.at(k, rows), 0.0, 0.0);
            self.add_point(p, carrier)
        });
        let mut grid: Vec<Vec<u32>> = Vec::new();
        for k in 1..rows {
            let s = line.at(k, rows);
            let wide = line.width(s);
            let row = (0..=TAIL_COLUMNS)
                .map(|i| {
                    let x = wide * column(i);
                    let rim = i == 0 || i == TAIL_COLUMNS;
                    let h = if rim { 0.0 } else { line.height(s, x) };
                    let p = line.point(base, s, x, h);
                    self.add_point(p, carrier)
                })
                .collect();
            grid.push(row);
        }
        self.triangulate_rows(&grid, ends, base.side < 0.0);
        self.compute_normals(start, first);
        self.close_tail_underside(base, &line, &grid, ends);
    }

    /// Closes a strip under the leaf, whose folds it follows.
    fn close_tail_underside(&mut self, base: &DropPlacement<'_>, line: &TailBody, grid: &[Vec<u32>], ends: [u32; 2]) {
        let (start, first) = (self.mesh.points.len(), self.mesh.triangles.len());
        let (carrier, flip) = ((base.blade, base.v), base.side < 0.0);
        let (n, rows) = (TAIL_COLUMNS as usize, line.rows());
        let mut under =
            |k: u32, x: f64| self.add_point(line.point(base, line.at(k, rows), x, -UNDERSIDE_DEPTH), carrier);
        let lower_ends = [0, rows].map(|k| under(k, 0.0));
        let across = |k: u32, i: u32| line.width(line.at(k, rows)) * column(i);
        let lower: Vec<Vec<u32>> =
            (1..rows).map(|k| (0..=TAIL_COLUMNS).map(|i| under(k, across(k, i))).collect()).collect();
        // Around: the front end, the left side back, the hind end, the right side forth.
        let around = |rows: &[Vec<u32>], ends: [u32; 2]| -> Vec<u32> {
            let (left, right) = (rows.iter().map(|r| r[0]), rows.iter().rev().map(|r| r[n]));
            [ends[0]].into_iter().chain(left).chain([ends[1]]).chain(right).collect()
        };
        let upper: Vec<u32> = around(grid, ends).iter().map(|i| self.duplicate_point(*i)).collect();
        let rim = around(&lower, lower_ends);
        for i in 0..rim.len() {
            let j = (i + 1) % rim.len();
            self.triangle([upper[i], rim[i], rim[j]], flip);
            self.triangle([upper[i], rim[j], upper[j]], flip);
        }
        self.triangulate_rows(&lower, lower_ends, !flip);
        self.compute_normals(start, first);
    }

    /// Rows of a strip, joined, with a point at both ends.
    fn triangulate_rows(&mut self, grid: &[Vec<u32>], ends: [u32; 2], flip: bool) {
        let last = grid.len() - 1;
        for i in 0..TAIL_COLUMNS as usize {
            self.triangle([ends[0], grid[0][i], grid[0][i + 1]], flip);
            self.triangle([ends[1], grid[last][i + 1], grid[last][i]], flip);
            for k in 1..=last {
                let (a, b, c, d) = (grid[k - 1][i], grid[k - 1][i + 1], grid[k][i + 1], grid[k][i]);
                self.triangle([a, c, b], flip);
                self.triangle([a, d, c], flip);
            }
        }
    }

    /// Adds a drop that hangs at a margin. `shapes`: of its circle.
    pub fn add_pendant(&mut self, blade: &LeafPose, drop: &PendantDrop, shapes: &PendantShapes) {
        let profile = necked_profile(&shapes.profile(drop.volume), drop.thin);
        let Some([_, length]) = profile.last().copied() else { return };
        let down = (blade.orientation * drop.axis).normalize_or(DVec3::NEG_Y);
        let (x, y) = down.any_orthonormal_pair();
        let middle = blade.position + blade.orientation * drop.p;
        let (start, first) = (self.mesh.points.len(), self.mesh.triangles.len());
        let carrier = (blade, DVec3::ZERO);
        let mut outline: Vec<[f64; 2]> = resample_profile(&profile);
        // Its upper end closes over the leaf's edge.
        let rim = outline.last().map_or(drop.radius, |p| p[0]);
        outline.extend((1..8).map(|k| {
            let turn = FRAC_PI_2 * f64::from(k) / 8.0;
            [rim * math::cos(turn), length + SEAT_HEIGHT * rim * math::sin(turn)]
        }));
        let low = self.add_point(middle + down * length, carrier);
        let mut before: Vec<u32> = Vec::new();
        for [r, z] in outline.iter().skip(1) {
            let at = middle + down * (length - z);
            let ring: Vec<u32> = (0..PENDANT_SIDES)
                .map(|i| {
                    let turn = TAU * f64::from(i) / f64::from(PENDANT_SIDES);
                    self.add_point(at + (x * math::cos(turn) + y * math::sin(turn)) * *r, carrier)
                })
                .collect();
            self.add_ring(&before, &ring, low);
            before = ring;
        }
        let high = self.add_point(middle - down * (SEAT_HEIGHT * rim), carrier);
        for i in 0..PENDANT_SIDES as usize {
            let j = (i + 1) % PENDANT_SIDES as usize;
            self.triangle([high, before[j], before[i]], false);
        }
        self.compute_normals(start, first);
    }

    fn add_ring(&mut self, before: &[u32], ring: &[u32], low: u32) {
        for i in 0..ring.len() {
            let j = (i + 1) % ring.len();
            if before.is_empty() {
                self.triangle([low, ring[i], ring[j]], false);
            } else {
                self.triangle([before[i], ring[i], ring[j]], false);
                self.triangle([before[i], ring[j], before[j]], false);
            }
        }
    }
}

/// Place of a column of a strip, as a share of the way from its middle to its rim; they stand closer there.
fn column(i: u32) -> f64 {
    math::sin(FRAC_PI_2 * (2.0 * f64::from(i) / f64::from(TAIL_COLUMNS) - 1.0))
}

/// How much higher a cap of flat facets must be to hold as much as the round one. `rings`: angles from its top to its rim.
/// Source: frusta of polygons with `sides`, against pi (2 - 3 c + c^3) / 3.
fn facet_volume_factor(rings: &[f64], sides: u32) -> f64 {
    let turn = TAU / f64::from(sides);
    let polygon = 0.5 * f64::from(sides) * math::sin(turn);
    let mut facets = 0.0;
    for pair in rings.windows(2) {
        let ([r, s], [y, z]) = ([math::sin(pair[0]), math::sin(pair[1])], [math::cos(pair[0]), math::cos(pair[1])]);
        facets += polygon * (r * r + s * s + r * s) * (y - z) / 3.0;
    }
    let c = rings.last().map_or(1.0, |q| math::cos(*q));
    let round = PI * (2.0 - 3.0 * c + c * c * c) / 3.0;
    if facets > 0.0 { round / facets } else { 1.0 }
}

/// About [`PROFILE_POINTS`] points of a profile, evenly along it.
fn resample_profile(profile: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let last = profile.len() - 1;
    let step = (last / PROFILE_POINTS).max(1);
    let mut out: Vec<[f64; 2]> = profile.iter().step_by(step).copied().collect();
    if !last.is_multiple_of(step) {
        out.push(profile[last]);
    }
    out
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use glam::DQuat;

    use super::*;
    use crate::rain::drops::drop::DropCap;
    use crate::rain::drops::shape::Footprint;
    use crate::rain::leaf::surface::{LeafSurface, tests::flat};
    use crate::rain::params::DropParams;

    fn leaf() -> RainLeaf {
        RainLeaf::new(Arc::new(LeafSurface::new(&flat(0.08, 0.04, 8)).expect("a blade")), 1.0, 0)
    }

    fn pose() -> LeafPose {
        LeafPose::at_rest(DVec3::new(1.0, 2.0, 3.0), DQuat::from_rotation_x(-1.0))
    }

    fn lying(theta: f64, volumes: &[f64], print: Footprint) -> SessileDrop {
        let theta = theta.to_radians();
        let own = DropParams::default().wetting;
        let wetting = crate::rain::drops::shape::WettingParams { theta, receding: theta, advancing: theta, ..own };
        let bead = |(i, v): (usize, &f64)| {
            let uv = DVec2::new(0.5, 0.5 - 0.02 * i as f64);
            DropCap { uv, cap: wetting.cap(*v, 1.0), volume: *v }
        };
        let beads = volumes.iter().enumerate().map(bead).collect();
        SessileDrop {
            id: 1,
            leaf: 0,
            side: 1.0,
            beads,
            print,
            axis: DVec3::Y,
            v: DVec3::ZERO,
            volume: volumes.iter().sum(),
        }
    }

    /// Volume inside, m^3, once every edge is known to have a triangle on either side.
    fn closed(mesh: &Mesh) -> f64 {
        let mut edges: BTreeMap<[[u32; 3]; 2], i32> = BTreeMap::new();
        let key = |i: u32| mesh.points[i as usize].to_array().map(f32::to_bits);
        let mut volume = 0.0;
        let o = mesh.points[0].as_dvec3();
        for t in &mesh.triangles {
            for k in 0..3 {
                let (a, b) = (key(t[k]), key(t[(k + 1) % 3]));
                *edges.entry([a.min(b), a.max(b)]).or_insert(0) += if a < b { 1 } else { -1 };
            }
            let [a, b, c] = t.map(|i| mesh.points[i as usize].as_dvec3() - o);
            volume += a.dot(b.cross(c)) / 6.0;
        }
        assert!(edges.values().all(|n| *n == 0), "open");
        volume
    }

    #[test]
    fn drops_are_closed_and_hold_their_volume() {
        let (leaf, blade) = (leaf(), pose());
        let prints = [(1.0, 0.0, None), (1.4, 0.2, None), (1.2, 0.26, Some(0.7))];
        for theta in [30.0, 45.0, 60.0, 75.0, 90.0, 110.0, 130.0, 150.0] {
            for ((q, skew, omega), volume) in prints.into_iter().flat_map(|p| [(p, 2e-8), (p, 4e-10)]) {
                let mut drop = lying(theta, &[volume], Footprint { q, skew });
                let own = DropParams::default().wetting;
                let cap = crate::rain::drops::shape::WettingParams { theta: theta.to_radians(), omega, ..own }
                    .cap(volume, 1.0);
                drop.beads[0].cap = cap;
                let mut water = DropMesh::default();
                water.add_sessile(&leaf, &blade, &drop);
                let sides =
                    f64::from(if cap.reach() < LARGE_DROP_RADIUS { SMALL_DROP_GRID } else { LARGE_DROP_GRID }[1]);
                let under = 0.5 * sides * math::sin(TAU / sides) * cap.a * cap.a * UNDERSIDE_DEPTH;
                let found = closed(&water.mesh) - under;
                assert!((found / volume - 1.0).abs() < 0.01, "{theta} {q} {omega:?}: {found} of {volume}");
                assert_eq!(water.velocities.len(), water.mesh.points.len());
                assert!(water.mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3));
            }
        }
    }

    #[test]
    fn a_drop_with_a_tail_is_one_closed_body() {
        let (leaf, blade) = (leaf(), pose());
        let drop = lying(60.0, &[1e-8, 5e-9, 2.5e-9, 1.2e-9], Footprint { q: 1.3, skew: 0.2 });
        let mut water = DropMesh::default();
        water.add_sessile(&leaf, &blade, &drop);
        let base = DropPlacement::new(&leaf, &blade, drop.beads[0].uv, 1.0, DVec3::ZERO).expect("on the leaf");
        let line = TailBody::new(&base, &drop).expect("a line");
        let area: f64 = (0..line.rows())
            .map(|k| {
                let [a, b] = [k, k + 1].map(|k| line.at(k, line.rows()));
                (b - a) * (line.width(a) + line.width(b))
            })
            .sum();
        let found = closed(&water.mesh) - area * UNDERSIDE_DEPTH;
        assert!((found / drop.volume - 1.0).abs() < 0.03, "{found} of {}", drop.volume);
    }

    #[test]
    fn no_air_is_left_between_a_drop_and_the_fold_it_lies_in() {
        let mut mesh = flat(0.08, 0.04, 32);
        mesh.points.iter_mut().for_each(|p| p.z += 0.6 * p.x.abs());
        let leaf = RainLeaf::new(Arc::new(LeafSurface::new(&mesh).expect("a blade")), 1.0, 0);
        let blade = LeafPose::at_rest(DVec3::ZERO, DQuat::IDENTITY);
        for volumes in [&[2e-8][..], &[1e-8, 5e-9, 2.5e-9]] {
            let mut water = DropMesh::default();
            water.add_sessile(&leaf, &blade, &lying(60.0, volumes, Footprint { q: 1.0, skew: 0.0 }));
            let Mesh { points, triangles, .. } = &water.mesh;
            let middles = triangles.iter().map(|t| t.map(|i| points[i as usize].as_dvec3())).filter_map(|[a, b, c]| {
                let (n, m) = ((b - a).cross(c - a).normalize_or_zero(), (a + b + c) / 3.0);
                (n.z < -0.5).then_some(m.z - 0.6 * m.x.abs())
            });
            let heights: Vec<f64> = middles.collect();
            let highest = heights.iter().copied().fold(f64::MIN, f64::max);
            assert!(
                heights.len() > 20 && highest < 0.3 * UNDERSIDE_DEPTH,
                "{highest} m over the leaf, of {}",
                heights.len()
            );
        }
    }

    #[test]
    fn a_tail_has_no_creases() {
        let (leaf, blade) = (leaf(), pose());
        for theta in [40.0, 70.0, 110.0] {
            let drop = lying(theta, &[1e-8, 5e-9, 2.5e-9, 1.2e-9, 6e-10], Footprint { q: 1.4, skew: 0.2 });
            let base = DropPlacement::new(&leaf, &blade, drop.beads[0].uv, 1.0, DVec3::ZERO).expect("on the leaf");
            let line = TailBody::new(&base, &drop).expect("a line");
            let sizes: Vec<[f64; 2]> =
                (0..=400).map(|k| line.at(k, 400)).map(|s| [line.width(s), line.height(s, 0.0)]).collect();
            for i in 0..2 {
                let most = sizes.iter().fold(0.0, |m: f64, s| m.max(s[i]));
                let top = sizes.iter().position(|s| s[i] >= most).expect("a top");
                // It rises to its head and falls from there on: caps side by side would have a hollow between any two.
                assert!(sizes[..=top].windows(2).all(|w| w[1][i] >= w[0][i] - 1e-9), "{theta} {i}");
                assert!(sizes[top..].windows(2).all(|w| w[1][i] <= w[0][i] + 1e-9), "{theta} {i}");
            }
        }
    }

    #[test]
    fn a_hanging_drop_is_closed_and_hangs_down() {
        let blade = LeafPose::at_rest(DVec3::new(0.2, 1.0, 0.3), DQuat::from_rotation_z(0.4));
        let axis = blade.orientation.inverse() * DVec3::NEG_Y;
        for volume in [2e-9, 15e-9, 33e-9] {
            let drop =
                PendantDrop { id: 1, leaf: 0, p: DVec3::new(0.0, 0.08, 0.0), radius: 1e-3, axis, volume, thin: 0.0 };
            let mut water = DropMesh::default();
            water.add_pendant(&blade, &drop, &PendantShapes::new(1e-3, 9.81));
            let found = closed(&water.mesh);
            let seat = PI * 1e-9 * SEAT_HEIGHT * 2.0 / 3.0;
            assert!(((found - seat) / volume - 1.0).abs() < 0.03, "{volume} {found}");
            let top = blade.to_world(drop.p, 1.0).y;
            let lowest = water.mesh.points.iter().fold(f32::MAX, |m, p| m.min(p.y));
            assert!(f64::from(lowest) < top - 1e-4);
        }
    }
}
