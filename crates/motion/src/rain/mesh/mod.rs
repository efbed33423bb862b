//! Drops as closed meshes that fit the leaf under them.

mod tail_body;

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3, Vec3};

use crate::rain::drops::pendant_profile::{PendantFamily, profile_while_necking};
use crate::rain::drops::rain_leaf::RainLeaf;
use crate::rain::drops::spherical_cap::SphericalCap;
use crate::rain::frame::{PendantDrop, SessileDrop};
use crate::rain::leaf::surface::SurfacePoint;
use crate::rain::mesh::tail_body::TailedDropShape;
use crate::rain::target::LeafPose;
use crate::rain::tuning::{
    DISTANT_DROP_ANGLE, DISTANT_DROP_GRID, FAR_DROP_ANGLE, FAR_DROP_GRID, LARGE_DROP_GRID, LARGE_DROP_RADIUS,
    PENDANT_SIDES, PROFILE_POINTS, RIM_DENSITY, SEAT_HEIGHT, SEAT_RINGS, SMALL_DROP_GRID, TAIL_COLUMNS,
    UNDERSIDE_DEPTH,
};
use osier_base::math;
use osier_scene::Mesh;

/// How finely a drop is meshed, by its size in the picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum DropDetail {
    /// For pictures in which the drop is more than a few pixels large.
    #[default]
    Near,
    /// For a drop of a few pixels.
    Far,
    /// For a drop of a pixel or two.
    Distant,
}

/// Size of the mesh of a drop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DropMeshSize {
    /// Mean number of vertices.
    pub vertices: f64,
    /// Mean number of triangles.
    pub triangles: f64,
}

impl DropDetail {
    /// The detail of a drop of a radius, m, at a distance from the camera, m.
    pub fn at_distance(radius: f64, distance: f64) -> Self {
        match radius / distance.max(1e-9) {
            angle if angle >= FAR_DROP_ANGLE => Self::Near,
            angle if angle >= DISTANT_DROP_ANGLE => Self::Far,
            _ => Self::Distant,
        }
    }

    /// Mean size of the meshes of sessile and pendant drops with their tails, for estimates of file sizes. `radius`: radius of a
    /// typical drop, m.
    ///
    /// Drops of more than about 2 mm run, with long tails, whose rows outnumber the rings of a cap. Measured on a twig in rain of
    /// drops of 1 to 3 mm and of natural sizes, and on an oak in a storm of drops of 4 mm: 17 to 42 vertices of distant drops of
    /// 0.7 to 1 mm in radius, 86 to 121 of those of 2 to 2.5 mm; of far ones 120 to 205 and 300.
    pub fn typical_size(self, radius: f64) -> DropMeshSize {
        let square_mm = radius * radius * 1e6;
        match self {
            // Measured: 910 to 1130 vertices, since a third of the drops are small. Cap and seat have the grid each; tails and
            // apexes add a third of it.
            Self::Near => {
                let vertices = |[rings, sides]: [u32; 2]| f64::from(rings * sides * 5 / 2 + 10);
                let mean = (vertices(SMALL_DROP_GRID) + 2.0 * vertices(LARGE_DROP_GRID)) / 3.0;
                DropMeshSize { vertices: mean, triangles: 1.9 * mean }
            }
            Self::Far => {
                let vertices = 95.0 + 55.0 * square_mm;
                DropMeshSize { vertices, triangles: 1.8 * vertices }
            }
            // In the coarsest meshes a larger part of the vertices lies on the contact line, which cap and underside do not share.
            Self::Distant => {
                let vertices = 18.0 + 14.0 * square_mm;
                DropMeshSize { vertices, triangles: 1.8 * vertices - 10.0 }
            }
        }
    }

    /// Index into the tables of numbers of rows, sides and rings.
    fn table_index(self) -> usize {
        match self {
            Self::Near => 0,
            Self::Far => 1,
            Self::Distant => 2,
        }
    }

    /// Number of rings and sides of the mesh of a cap; near the camera it depends on the size of the cap.
    fn cap_rings_and_sides(self, cap: &SphericalCap) -> [u32; 2] {
        match self {
            Self::Near if cap.widest_radius() < LARGE_DROP_RADIUS => SMALL_DROP_GRID,
            Self::Near => LARGE_DROP_GRID,
            Self::Far => FAR_DROP_GRID,
            Self::Distant => DISTANT_DROP_GRID,
        }
    }
}

/// The drops on leaves and at margins at a frame as one mesh.
#[derive(Debug, Default)]
pub struct DropMesh {
    /// Closed surfaces in the world, m.
    pub mesh: Mesh,
    /// Velocity of each point in the world, m/s.
    pub velocities: Vec<Vec3>,
    /// How finely the drops that are added next are meshed.
    pub detail: DropDetail,
}

/// Maps points around a sessile drop, given along the leaf and above it, to the world.
pub(super) struct DropPlacement<'a> {
    pub(super) leaf: &'a RainLeaf,
    pose: &'a LeafPose,
    uv: DVec2,
    /// The surface under the drop's center, in leaf space.
    pub(super) base: SurfacePoint,
    /// Side of the leaf: 1 on the upper, -1 on the lower.
    side: f64,
    /// Velocity relative to the leaf, in leaf space, m/s.
    v: DVec3,
}

impl<'a> DropPlacement<'a> {
    /// The placement of a drop at texture coordinates; `None` beyond the blade.
    fn new(leaf: &'a RainLeaf, pose: &'a LeafPose, uv: DVec2, side: f64, v: DVec3) -> Option<Self> {
        Some(Self { leaf, pose, uv, base: leaf.point_at(uv)?, side, v })
    }

    /// World position of the point at a tangential `offset` from the center, m, and at `height` above the leaf there, m. Beyond the
    /// margin the leaf continues as its tangent plane.
    pub(super) fn world_point(&self, offset: DVec3, height: f64) -> DVec3 {
        let uv = self.uv + self.base.uv_offset(offset);
        let s = self.leaf.blade.extrapolate(uv, &self.base, self.uv, self.leaf.scale);
        self.pose.position + self.pose.orientation * (s.p + s.n * (self.side * height))
    }

    fn point_motion(&self) -> DropMotion<'a> {
        DropMotion { pose: self.pose, v: self.v }
    }

    /// Whether the triangles have to be reversed, because they are wound for the upper side.
    fn flip(&self) -> bool {
        self.side < 0.0
    }
}

/// The motion of a drop's points: that of the leaf as a rigid body, plus that of the drop along the leaf.
#[derive(Clone, Copy)]
struct DropMotion<'a> {
    pose: &'a LeafPose,
    /// Velocity relative to the leaf, in leaf space, m/s.
    v: DVec3,
}

/// Indices of the first point and the first triangle of a part of the mesh.
#[derive(Clone, Copy)]
struct MeshPartStart {
    point: usize,
    triangle: usize,
}

impl DropMesh {
    fn part_start(&self) -> MeshPartStart {
        MeshPartStart { point: self.mesh.points.len(), triangle: self.mesh.triangles.len() }
    }

    /// Index of the point that is added next.
    fn next_index(&self) -> u32 {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "2^32 points with normals and velocities need more than 100 GiB"
        )]
        let index = self.mesh.points.len() as u32;
        index
    }

    fn add_vertex(&mut self, p: DVec3, motion: DropMotion<'_>) -> u32 {
        let index = self.next_index();
        self.mesh.points.push(p.as_vec3());
        self.velocities.push((motion.pose.velocity_at(p) + motion.pose.orientation * motion.v).as_vec3());
        index
    }

    /// Appends a copy of a point, which gets a separate normal, for creases.
    fn duplicate_vertex(&mut self, i: u32) -> u32 {
        let index = self.next_index();
        self.mesh.points.push(self.mesh.points[i as usize]);
        self.velocities.push(self.velocities[i as usize]);
        index
    }

    fn add_triangle(&mut self, t: [u32; 3], flip: bool) {
        self.mesh.triangles.push(if flip { [t[0], t[2], t[1]] } else { t });
    }

    /// Joins two closed rings of equally many points by a strip of triangles; `flip` reverses their winding.
    fn add_ring_strip(&mut self, before: &[u32], ring: &[u32], flip: bool) {
        for i in 0..ring.len() {
            let j = (i + 1) % ring.len();
            self.add_triangle([before[i], ring[i], ring[j]], flip);
            self.add_triangle([before[i], ring[j], before[j]], flip);
        }
    }

    /// Joins a pole and a closed ring around it by a fan of triangles.
    fn add_fan(&mut self, pole: u32, ring: &[u32], flip: bool) {
        for i in 0..ring.len() {
            self.add_triangle([pole, ring[i], ring[(i + 1) % ring.len()]], flip);
        }
    }

    /// Computes smooth normals of the part of the mesh from `start` on, weighted by the areas of triangles. Its points must not belong
    /// to triangles before it.
    fn compute_normals(&mut self, start: MeshPartStart) {
        let Mesh { points, normals, triangles, .. } = &mut self.mesh;
        normals.resize(points.len(), Vec3::ZERO);
        for t in &triangles[start.triangle..] {
            let [a, b, c] = t.map(|i| points[i as usize].as_dvec3());
            // In square millimetres: in square metres the sums of tiny areas would be close to the smallest
            // single-precision numbers.
            let n = (b - a).cross(c - a).as_vec3() * 1e6;
            t.iter().for_each(|i| normals[*i as usize] += n);
        }
        for n in &mut normals[start.point..] {
            *n = math::normalize_or(*n, Vec3::Y);
        }
    }

    /// Adds a sessile drop with its tail as a closed surface; adds nothing if its center lies beyond the blade.
    pub fn add_sessile(&mut self, leaf: &RainLeaf, pose: &LeafPose, drop: &SessileDrop) {
        let Some(head) = drop.caps.first() else { return };
        let Some(placement) = DropPlacement::new(leaf, pose, head.uv, drop.side, drop.v) else { return };
        if drop.caps.len() > 1 {
            self.add_tail_body(&placement, drop);
        } else {
            self.add_cap(&placement, &head.cap, drop);
        }
    }

    /// Adds a cap as rings around its axis, denser towards the contact line. Source: own.
    fn add_cap(&mut self, placement: &DropPlacement<'_>, cap: &SphericalCap, drop: &SessileDrop) {
        // Polar angles run from 0 at the pole to the contact angle at the contact line.
        let theta = math::acos(cap.cos_angle.clamp(-1.0, 1.0));
        let [rings, sides] = self.detail.cap_rings_and_sides(cap);
        // A cap that overhangs its base spans more than a quarter turn.
        let rings = if theta > FRAC_PI_2 { rings * 2 } else { rings };
        let n = placement.base.n;
        let along = (drop.axis - n * drop.axis.dot(n)).normalize_or(n.any_orthonormal_vector());
        let across = n.cross(along);
        let ring_angle = |k: u32| theta * (1.0 - math::pow(1.0 - f64::from(k) / f64::from(rings), RIM_DENSITY));
        // Flat facets cut into the sphere: raise them so that the mesh has the drop's volume.
        let raise = facet_volume_factor(&(0..=rings).map(ring_angle).collect::<Vec<_>>(), sides);
        // Points by distance from the axis, azimuth and height; the footprint stretches them to an ellipse.
        let at = |r1: f64, phi: f64, h: f64| {
            let (x, y) =
                (r1 * math::cos(phi) * drop.deformation.stretch, r1 * math::sin(phi) / drop.deformation.stretch);
            placement.world_point(along * x + across * y, h)
        };
        // The sphere by polar angle q and azimuth phi, scaled in height and sheared.
        let sphere_point = |q: f64, phi: f64| {
            let r1 = cap.r * math::sin(q);
            let shear = 1.0 + drop.deformation.skew * (r1 / cap.a * math::cos(phi)).clamp(-1.0, 1.0);
            let h = raise * cap.height_factor_at(math::cos(q)) * cap.r * (math::cos(q) - cap.cos_angle) * shear;
            at(r1, phi, h.max(0.0))
        };
        let start = self.part_start();
        let (motion, flip) = (placement.point_motion(), placement.flip());
        let pole = self.add_vertex(sphere_point(0.0, 0.0), motion);
        let mut rim = Vec::new();
        for k in 1..=rings {
            let q = ring_angle(k);
            let azimuths = (0..sides).map(|i| TAU * f64::from(i) / f64::from(sides));
            let ring: Vec<u32> = azimuths.map(|phi| self.add_vertex(sphere_point(q, phi), motion)).collect();
            // The first ring surrounds the pole, each other one the ring before it.
            if k == 1 {
                self.add_fan(pole, &ring, flip);
            } else {
                self.add_ring_strip(&rim, &ring, flip);
            }
            rim = ring;
        }
        self.compute_normals(start);
        let base_radius = cap.r * math::sin(theta);
        self.close_cap_underside(placement, &rim, sides, rings / 2, |fraction, phi| {
            at(base_radius * fraction, phi, -UNDERSIDE_DEPTH)
        });
    }

    /// Closes a cap below the leaf's surface by a skirt and rings that follow the leaf: a flat bottom would enclose air over a
    /// fold, which refracts light. `rim`: the contact line of `sides` points, counter-clockwise seen from above; `point`:
    /// position by fraction of the base radius and by azimuth.
    fn close_cap_underside(
        &mut self,
        placement: &DropPlacement<'_>,
        rim: &[u32],
        sides: u32,
        rings: u32,
        point: impl Fn(f64, f64) -> DVec3,
    ) {
        let start = self.part_start();
        let (motion, flip) = (placement.point_motion(), placement.flip());
        // The contact line is a crease: copies of its points have the normals of the skirt.
        let mut before: Vec<u32> = rim.iter().map(|i| self.duplicate_vertex(*i)).collect();
        // Rings from the contact line inwards, at a constant depth below the leaf.
        for k in (1..=rings).rev() {
            let fraction = f64::from(k) / f64::from(rings);
            let azimuths = (0..sides).map(|i| TAU * f64::from(i) / f64::from(sides));
            let ring: Vec<u32> = azimuths.map(|phi| self.add_vertex(point(fraction, phi), motion)).collect();
            self.add_ring_strip(&before, &ring, flip);
            before = ring;
        }
        // The last fan faces downwards, hence the opposite winding.
        let center = self.add_vertex(point(0.0, 0.0), motion);
        for i in 0..before.len() {
            self.add_triangle([center, before[(i + 1) % before.len()], before[i]], flip);
        }
        self.compute_normals(start);
    }

    /// Adds a drop with its tail as one body: rows across its path, narrowing from the head to the end of the tail. Source: own.
    fn add_tail_body(&mut self, placement: &DropPlacement<'_>, drop: &SessileDrop) {
        let Some(body) = TailedDropShape::new(placement, drop) else { return };
        let start = self.part_start();
        let motion = placement.point_motion();
        let (rows, columns) = (body.row_count(self.detail.table_index()), TAIL_COLUMNS[self.detail.table_index()]);
        // The first and the last row shrink to a point.
        let ends = [0, rows].map(|k| {
            let p = body.world_point(placement, body.row_position(k, rows), 0.0, 0.0);
            self.add_vertex(p, motion)
        });
        let mut grid: Vec<Vec<u32>> = Vec::new();
        for k in 1..rows {
            let s = body.row_position(k, rows);
            let half_width = body.half_width(s);
            // The outer columns lie on the contact line.
            let row = (0..=columns)
                .map(|i| {
                    let x = half_width * across_position(i, columns);
                    let on_rim = i == 0 || i == columns;
                    let h = if on_rim { 0.0 } else { body.height(s, x) };
                    let p = body.world_point(placement, s, x, h);
                    self.add_vertex(p, motion)
                })
                .collect();
            grid.push(row);
        }
        self.triangulate_rows(&grid, ends, placement.flip());
        self.compute_normals(start);
        self.close_tail_underside(placement, &body, &grid, ends);
    }

    /// Closes a tail body below the leaf's surface by a skirt and a lower side that follows the folds of the leaf.
    fn close_tail_underside(
        &mut self,
        placement: &DropPlacement<'_>,
        body: &TailedDropShape,
        grid: &[Vec<u32>],
        ends: [u32; 2],
    ) {
        let start = self.part_start();
        let (motion, flip) = (placement.point_motion(), placement.flip());
        let (rows, columns) = (body.row_count(self.detail.table_index()), TAIL_COLUMNS[self.detail.table_index()]);
        let n = columns as usize;
        // The lower side has the same rows and columns.
        let mut lower_point = |k: u32, x: f64| {
            let p = body.world_point(placement, body.row_position(k, rows), x, -UNDERSIDE_DEPTH);
            self.add_vertex(p, motion)
        };
        let lower_ends = [0, rows].map(|k| lower_point(k, 0.0));
        let x_of = |k: u32, i: u32| body.half_width(body.row_position(k, rows)) * across_position(i, columns);
        let lower: Vec<Vec<u32>> =
            (1..rows).map(|k| (0..=columns).map(|i| lower_point(k, x_of(k, i))).collect()).collect();
        // A skirt joins the outlines of both sides: the front end, the left side back, the rear end, the right side forth.
        let outline = |rows: &[Vec<u32>], ends: [u32; 2]| -> Vec<u32> {
            let (left, right) = (rows.iter().map(|r| r[0]), rows.iter().rev().map(|r| r[n]));
            [ends[0]].into_iter().chain(left).chain([ends[1]]).chain(right).collect()
        };
        let upper: Vec<u32> = outline(grid, ends).iter().map(|i| self.duplicate_vertex(*i)).collect();
        let rim = outline(&lower, lower_ends);
        self.add_ring_strip(&upper, &rim, flip);
        self.triangulate_rows(&lower, lower_ends, !flip);
        self.compute_normals(start);
    }

    /// Triangulates a grid of rows with a point at both ends, from `ends[0]` to `ends[1]`.
    fn triangulate_rows(&mut self, grid: &[Vec<u32>], ends: [u32; 2], flip: bool) {
        // Fans at both ends, two triangles for each cell between.
        let last = grid.len() - 1;
        for i in 0..grid[0].len() - 1 {
            self.add_triangle([ends[0], grid[0][i], grid[0][i + 1]], flip);
            self.add_triangle([ends[1], grid[last][i + 1], grid[last][i]], flip);
            for k in 1..=last {
                let (a, b, c, d) = (grid[k - 1][i], grid[k - 1][i + 1], grid[k][i + 1], grid[k][i]);
                self.add_triangle([a, c, b], flip);
                self.add_triangle([a, d, c], flip);
            }
        }
    }

    /// Adds a pendant drop as a closed surface of revolution. `shapes`: profiles of its radius of attachment.
    pub fn add_pendant(&mut self, pose: &LeafPose, drop: &PendantDrop, shapes: &PendantFamily) {
        // The profile by volume, thinned if the drop is about to detach.
        let profile = profile_while_necking(&shapes.profile(drop.volume), drop.necking);
        let Some([_, length]) = profile.last().copied() else { return };
        let down = (pose.orientation * drop.axis).normalize_or(DVec3::NEG_Y);
        let (x, y) = down.any_orthonormal_pair();
        let attachment = pose.position + pose.orientation * drop.p;
        let start = self.part_start();
        let motion = DropMotion { pose, v: DVec3::ZERO };
        let level = self.detail.table_index();
        let (sides, seat_rings) = (PENDANT_SIDES[level], SEAT_RINGS[level]);
        let mut outline: Vec<[f64; 2]> = resample_profile(&profile, PROFILE_POINTS[level]);
        // A quarter of an ellipse continues the outline over the leaf's edge, so that the drop encloses it.
        let rim = outline.last().map_or(drop.radius, |p| p[0]);
        outline.extend((1..seat_rings).map(|k| {
            let turn = FRAC_PI_2 * f64::from(k) / f64::from(seat_rings);
            [rim * math::cos(turn), length + SEAT_HEIGHT * rim * math::sin(turn)]
        }));
        let apex = self.add_vertex(attachment + down * length, motion);
        // One ring per point of the outline, from the apex up; heights count from the apex against `down`.
        let mut before: Vec<u32> = Vec::new();
        for [r, z] in outline.iter().skip(1) {
            let center = attachment + down * (length - z);
            let ring: Vec<u32> = (0..sides)
                .map(|i| {
                    let turn = TAU * f64::from(i) / f64::from(sides);
                    self.add_vertex(center + (x * math::cos(turn) + y * math::sin(turn)) * *r, motion)
                })
                .collect();
            if before.is_empty() {
                self.add_fan(apex, &ring, false);
            } else {
                self.add_ring_strip(&before, &ring, false);
            }
            before = ring;
        }
        // Close the part over the leaf's edge.
        let top = self.add_vertex(attachment - down * (SEAT_HEIGHT * rim), motion);
        for i in 0..before.len() {
            self.add_triangle([top, before[(i + 1) % before.len()], before[i]], false);
        }
        self.compute_normals(start);
    }
}

/// Position of column `i` of `columns` of a tail body as a fraction of the half width, -1 to 1; columns are denser towards the
/// contact line.
fn across_position(i: u32, columns: u32) -> f64 {
    math::sin(FRAC_PI_2 * (2.0 * f64::from(i) / f64::from(columns) - 1.0))
}

/// Factor on the heights of a faceted cap by which it has the volume of the smooth cap. `ring_angles`: polar angles from the pole
/// to the contact line. Source: frusta of regular polygons of `sides`, against pi (2 - 3 c + c^3) / 3.
fn facet_volume_factor(ring_angles: &[f64], sides: u32) -> f64 {
    let turn = TAU / f64::from(sides);
    // Area of the polygon inscribed in the unit circle.
    let polygon = 0.5 * f64::from(sides) * math::sin(turn);
    let mut faceted = 0.0;
    for pair in ring_angles.windows(2) {
        let ([r, s], [y, z]) = ([math::sin(pair[0]), math::sin(pair[1])], [math::cos(pair[0]), math::cos(pair[1])]);
        // Frustum between polygons of radii r and s: (A_r + A_s + sqrt(A_r A_s)) height / 3.
        faceted += polygon * (r * r + s * s + r * s) * (y - z) / 3.0;
    }
    let c = ring_angles.last().map_or(1.0, |q| math::cos(*q));
    let smooth = PI * (2.0 - 3.0 * c + c * c * c) / 3.0;
    if faceted > 0.0 { smooth / faceted } else { 1.0 }
}

/// About `points` points of a profile, evenly along it, the last one included.
fn resample_profile(profile: &[[f64; 2]], points: usize) -> Vec<[f64; 2]> {
    let last = profile.len() - 1;
    let step = (last / points).max(1);
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
    use crate::rain::drops::spherical_cap::{CapDeformation, WettingParams};
    use crate::rain::drops::surface_drop::DropCap;
    use crate::rain::leaf::surface::{LeafSurface, tests::flat};
    use crate::rain::params::DropParams;

    fn leaf() -> RainLeaf {
        RainLeaf::new(Arc::new(LeafSurface::new(&flat(0.08, 0.04, 8)).expect("a blade")), 1.0, 0)
    }

    fn pose() -> LeafPose {
        LeafPose::at_rest(DVec3::new(1.0, 2.0, 3.0), DQuat::from_rotation_x(-1.0))
    }

    fn sessile(theta: f64, volumes: &[f64], deformation: CapDeformation) -> SessileDrop {
        let theta = theta.to_radians();
        let own = DropParams::default().wetting;
        let wetting = WettingParams { contact_angle: theta, receding: theta, advancing: theta, ..own };
        let cap = |(i, v): (usize, &f64)| {
            let uv = DVec2::new(0.5, 0.5 - 0.02 * i as f64);
            DropCap { uv, cap: wetting.cap(*v), volume: *v }
        };
        let caps = volumes.iter().enumerate().map(cap).collect();
        SessileDrop {
            id: 1,
            leaf: 0,
            side: 1.0,
            caps,
            deformation,
            axis: DVec3::Y,
            v: DVec3::ZERO,
            volume: volumes.iter().sum(),
        }
    }

    /// The enclosed volume, m^3; asserts that every edge has a triangle on either side.
    fn closed_volume(mesh: &Mesh) -> f64 {
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
        let (leaf, pose) = (leaf(), pose());
        let prints = [(1.0, 0.0, None), (1.4, 0.2, None), (1.2, 0.26, Some(0.7))];
        for theta in [30.0, 45.0, 60.0, 75.0, 90.0, 110.0, 130.0, 150.0] {
            for ((q, skew, omega), volume) in prints.into_iter().flat_map(|p| [(p, 2e-8), (p, 4e-10)]) {
                let mut drop = sessile(theta, &[volume], CapDeformation { stretch: q, skew });
                let own = DropParams::default().wetting;
                let cap = WettingParams { contact_angle: theta.to_radians(), height_factor: omega, ..own }.cap(volume);
                drop.caps[0].cap = cap;
                let mut water = DropMesh::default();
                water.add_sessile(&leaf, &pose, &drop);
                let sides = f64::from(
                    if cap.widest_radius() < LARGE_DROP_RADIUS { SMALL_DROP_GRID } else { LARGE_DROP_GRID }[1],
                );
                let under = 0.5 * sides * math::sin(TAU / sides) * cap.a * cap.a * UNDERSIDE_DEPTH;
                let found = closed_volume(&water.mesh) - under;
                assert!((found / volume - 1.0).abs() < 0.01, "{theta} {q} {omega:?}: {found} of {volume}");
                assert_eq!(water.velocities.len(), water.mesh.points.len());
                assert!(water.mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3));
            }
        }
    }

    #[test]
    fn a_drop_with_a_tail_is_one_closed_body() {
        let (leaf, pose) = (leaf(), pose());
        let drop = sessile(60.0, &[1e-8, 5e-9, 2.5e-9, 1.2e-9], CapDeformation { stretch: 1.3, skew: 0.2 });
        let mut water = DropMesh::default();
        water.add_sessile(&leaf, &pose, &drop);
        let placement = DropPlacement::new(&leaf, &pose, drop.caps[0].uv, 1.0, DVec3::ZERO).expect("on the leaf");
        let body = TailedDropShape::new(&placement, &drop).expect("a body");
        let rows = body.row_count(water.detail.table_index());
        let area: f64 = (0..rows)
            .map(|k| {
                let [a, b] = [k, k + 1].map(|k| body.row_position(k, rows));
                (b - a) * (body.half_width(a) + body.half_width(b))
            })
            .sum();
        let found = closed_volume(&water.mesh) - area * UNDERSIDE_DEPTH;
        assert!((found / drop.volume - 1.0).abs() < 0.03, "{found} of {}", drop.volume);
    }

    /// Small drops mostly rest without a tail, large ones run.
    #[test]
    fn the_size_of_a_mesh_is_predicted_from_the_radius_of_its_drop() {
        let (leaf, pose) = (leaf(), pose());
        for detail in [DropDetail::Far, DropDetail::Distant] {
            for volumes in [&[3e-10][..], &[1.2e-8, 6e-9, 3e-9, 1.5e-9]] {
                let drop = sessile(60.0, volumes, CapDeformation::ROUND);
                let mut water = DropMesh { detail, ..DropMesh::default() };
                water.add_sessile(&leaf, &pose, &drop);
                let predicted = detail.typical_size(drop.caps[0].cap.widest_radius());
                let vertices = predicted.vertices / water.mesh.points.len() as f64;
                let triangles = predicted.triangles / water.mesh.triangles.len() as f64;
                assert!((0.5..2.0).contains(&vertices), "{detail:?} {volumes:?}: {vertices}");
                assert!((0.5..3.0).contains(&triangles), "{detail:?} {volumes:?}: {triangles}");
            }
        }
    }

    #[test]
    fn no_air_is_left_between_a_drop_and_the_fold_it_lies_in() {
        let mut mesh = flat(0.08, 0.04, 32);
        mesh.points.iter_mut().for_each(|p| p.z += 0.6 * p.x.abs());
        let leaf = RainLeaf::new(Arc::new(LeafSurface::new(&mesh).expect("a blade")), 1.0, 0);
        let pose = LeafPose::at_rest(DVec3::ZERO, DQuat::IDENTITY);
        for volumes in [&[2e-8][..], &[1e-8, 5e-9, 2.5e-9]] {
            let mut water = DropMesh::default();
            water.add_sessile(&leaf, &pose, &sessile(60.0, volumes, CapDeformation::ROUND));
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
        let (leaf, pose) = (leaf(), pose());
        for theta in [40.0, 70.0, 110.0] {
            let drop = sessile(theta, &[1e-8, 5e-9, 2.5e-9, 1.2e-9, 6e-10], CapDeformation { stretch: 1.4, skew: 0.2 });
            let placement = DropPlacement::new(&leaf, &pose, drop.caps[0].uv, 1.0, DVec3::ZERO).expect("on the leaf");
            let body = TailedDropShape::new(&placement, &drop).expect("a body");
            let sizes: Vec<[f64; 2]> = (0..=400)
                .map(|k| body.row_position(k, 400))
                .map(|s| [body.half_width(s), body.height(s, 0.0)])
                .collect();
            for i in 0..2 {
                let most = sizes.iter().fold(0.0, |m: f64, s| m.max(s[i]));
                let top = sizes.iter().position(|s| s[i] >= most).expect("a top");
                // Sizes increase up to the head and decrease from there on: separate caps would have a minimum between any two.
                assert!(sizes[..=top].windows(2).all(|w| w[1][i] >= w[0][i] - 1e-9), "{theta} {i}");
                assert!(sizes[top..].windows(2).all(|w| w[1][i] <= w[0][i] + 1e-9), "{theta} {i}");
            }
        }
    }

    #[test]
    fn a_hanging_drop_is_closed_and_hangs_down() {
        let pose = LeafPose::at_rest(DVec3::new(0.2, 1.0, 0.3), DQuat::from_rotation_z(0.4));
        let axis = pose.orientation.inverse() * DVec3::NEG_Y;
        for volume in [2e-9, 15e-9, 33e-9] {
            let drop =
                PendantDrop { id: 1, leaf: 0, p: DVec3::new(0.0, 0.08, 0.0), radius: 1e-3, axis, volume, necking: 0.0 };
            let mut water = DropMesh::default();
            water.add_pendant(&pose, &drop, &PendantFamily::new(1e-3, 9.81));
            let found = closed_volume(&water.mesh);
            let seat = PI * 1e-9 * SEAT_HEIGHT * 2.0 / 3.0;
            assert!(((found - seat) / volume - 1.0).abs() < 0.03, "{volume} {found}");
            let top = pose.to_world(drop.p, 1.0).y;
            let lowest = water.mesh.points.iter().fold(f32::MAX, |m, p| m.min(p.y));
            assert!(f64::from(lowest) < top - 1e-4);
        }
    }
}
