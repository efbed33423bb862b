//! Skinned meshes of rods: tubes around their sections, and balls for weights.
//!
//! ```
//! use glam::{Quat, Vec3};
//! use osier_plants::surface::rod_tube::{CLOSE_UP, TubeSection, tube};
//!
//! let section = |joint: u16, y: f32| TubeSection { joint, p: Vec3::Y * y, q: Quat::IDENTITY, r: 0.01 };
//! let (mesh, weights) = tube(&[section(0, 0.0), section(1, 0.5)], CLOSE_UP);
//! assert_eq!(mesh.points.len(), weights.joints.len());
//! ```

use std::f32::consts::{PI, TAU};

use glam::{Quat, Vec2, Vec3};

use super::pixels::next_index;
use osier_base::math;
use osier_scene::{Mesh, SkinWeights};

/// Tessellation of a rod's [`tube`]: points around and along it.
#[derive(Debug, Clone, Copy)]
pub struct TubeResolution {
    /// Sides of the polygon of each ring, at least 3.
    pub sides: u32,
    /// Pieces of the tube from one section to the next, each between two rings; at least 1.
    pub rings: u32,
}

/// Tessellation for rods in the foreground, whose silhouette shows no corners.
pub const CLOSE_UP: TubeResolution = TubeResolution { sides: 16, rings: 4 };
/// Rings from pole to pole, and sides, of a ball.
const BALL: [u32; 2] = [12, 24];

/// Cross-section of a rod in the rest pose, through which its tube passes.
pub struct TubeSection {
    /// The joint that the section follows.
    pub joint: u16,
    /// Position of the centreline in the rest pose, m.
    pub p: Vec3,
    /// Orientation in the rest pose: +Y along the rod, which is the tangent of the tube here.
    pub q: Quat,
    /// Radius of the rod here, m, > 0.
    pub r: f32,
}

/// A ring of the tube, on a section or between two.
struct TubeRing {
    p: Vec3,
    q: Quat,
    r: f32,
    /// The joints of both sections.
    joints: [u16; 2],
    /// Weight of the second joint, 0..1.
    share: f32,
}

/// A closed tube through sections, and the skin weights of its points. Between two sections the weights change by a smoothstep,
/// whose slope is 0 at both: the deformed tube is tangent to its sections and has no kinks.
pub fn tube(stations: &[TubeSection], fine: TubeResolution) -> (Mesh, SkinWeights) {
    let mut builder = SkinnedMeshBuilder::default();
    let sides = fine.sides;
    let rings = rings(stations, fine.rings);
    let (Some(first), Some(last)) = (rings.first(), rings.last()) else { return builder.finish() };
    // A ring of points per ring of the curve, the first repeated at the texture seam; v is the arc length in metres.
    let mut along = 0.0;
    for (k, ring) in rings.iter().enumerate() {
        along += if k > 0 { (ring.p - rings[k - 1].p).length() } else { 0.0 };
        for i in 0..=sides {
            let turn = TAU * i as f32 / sides as f32;
            let out = ring.q * Vec3::new(math::cos_f32(turn), 0.0, -math::sin_f32(turn));
            builder.point(ring.p + out * ring.r, out, Vec2::new(i as f32 / sides as f32, along), ring);
        }
    }
    // Two triangles per side between consecutive rings, then discs at both ends.
    // The seam has its points twice, for its two texture coordinates.
    let n = sides + 1;
    for (k, _) in (1..).zip(rings.iter().skip(1)) {
        for i in 0..sides {
            let (a, b) = ((k - 1) * n + i, k * n + i);
            builder.mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    builder.cap(first, sides, false);
    builder.cap(last, sides, true);
    builder.finish()
}

/// Rings on cubic Hermite curves between the sections, `count` to a segment.
fn rings(stations: &[TubeSection], count: u32) -> Vec<TubeRing> {
    let mut out = Vec::new();
    for pair in stations.windows(2) {
        let (a, b) = (&pair[0], &pair[1]);
        let d = (b.p - a.p).length();
        let from = u32::from(!out.is_empty());
        for i in from..=count {
            let t = i as f32 / count as f32;
            // Hermite basis: h01 = 3 t^2 - 2 t^3 blends the positions, h10 and h11 weight the tangents, which have
            // the length of the segment. The same h01 is the skin weight of the second joint.
            let (t2, t3) = (t * t, t * t * t);
            let share = 3.0 * t2 - 2.0 * t3;
            let p =
                a.p.lerp(b.p, share) + (a.q * Vec3::Y) * (d * (t3 - 2.0 * t2 + t)) + (b.q * Vec3::Y) * (d * (t3 - t2));
            let r = math::lerp(a.r, b.r, t);
            out.push(TubeRing { p, q: math::nlerp(a.q, b.q, t), r, joints: [a.joint, b.joint], share });
        }
    }
    out
}

/// A sphere around `p` of radius `r`, m, in the rest pose, whose points all follow one joint.
pub fn ball(p: Vec3, r: f32, joint: u16) -> (Mesh, SkinWeights) {
    let mut builder = SkinnedMeshBuilder::default();
    let ring = TubeRing { p, q: Quat::IDENTITY, r, joints: [joint; 2], share: 0.0 };
    let [rows, sides] = BALL;
    for k in 0..=rows {
        let polar = PI * k as f32 / rows as f32;
        let (s, c) = (math::sin_f32(polar), math::cos_f32(polar));
        for i in 0..=sides {
            let turn = TAU * i as f32 / sides as f32;
            let out = Vec3::new(s * math::cos_f32(turn), -c, -s * math::sin_f32(turn));
            builder.point(p + out * r, out, Vec2::new(i as f32 / sides as f32, k as f32 / rows as f32), &ring);
        }
    }
    let n = sides + 1;
    for k in 1..=rows {
        for i in 0..sides {
            let (a, b) = ((k - 1) * n + i, k * n + i);
            // At the poles one of the two triangles has no area and is left out.
            if k > 1 {
                builder.mesh.triangles.push([a, a + 1, b + 1]);
            }
            if k < rows {
                builder.mesh.triangles.push([a, b + 1, b]);
            }
        }
    }
    builder.finish()
}

/// A mesh and its skin weights, which are appended together.
#[derive(Default)]
struct SkinnedMeshBuilder {
    mesh: Mesh,
    skin: SkinWeights,
}

impl SkinnedMeshBuilder {
    /// Adds a point that follows a ring's joints, the one of larger weight first.
    fn point(&mut self, p: Vec3, normal: Vec3, uv: Vec2, ring: &TubeRing) {
        self.mesh.points.push(p);
        self.mesh.normals.push(normal);
        self.mesh.uvs.push(uv);
        let [a, b] = ring.joints;
        // Writers expect influences by falling weight; a second joint of weight 0 is stored as joint 0.
        let (one, two) = if ring.share > 0.5 {
            ((b, ring.share), (a, 1.0 - ring.share))
        } else {
            ((a, 1.0 - ring.share), (b, ring.share))
        };
        let second = if two.1 > 0.0 && a != b { two.0 } else { 0 };
        self.skin.joints.push([one.0, second, 0, 0]);
        self.skin.weights.push([one.1, two.1, 0.0, 0.0]);
    }

    /// Appends a disc at an end that faces along the rod if `outwards`, otherwise against it.
    fn cap(&mut self, ring: &TubeRing, sides: u32, outwards: bool) {
        let base = next_index(&self.mesh);
        let normal = ring.q * if outwards { Vec3::Y } else { -Vec3::Y };
        self.point(ring.p, normal, Vec2::splat(0.5), ring);
        for i in 0..sides {
            let turn = TAU * i as f32 / sides as f32;
            let (s, c) = (math::sin_f32(turn), math::cos_f32(turn));
            let out = ring.q * Vec3::new(c, 0.0, -s);
            self.point(ring.p + out * ring.r, normal, Vec2::new(0.5 + 0.5 * c, 0.5 + 0.5 * s), ring);
        }
        for i in 0..sides {
            let (a, b) = (base + 1 + i, base + 1 + (i + 1) % sides);
            self.mesh.triangles.push(if outwards { [base, a, b] } else { [base, b, a] });
        }
    }

    fn finish(self) -> (Mesh, SkinWeights) {
        (self.mesh, self.skin)
    }
}
