//! Tubes around rods and balls for weights, with their joints.

use std::f32::consts::{PI, TAU};

use glam::{Quat, Vec2, Vec3};

use osier_base::math;
use osier_scene::{Mesh, SkinWeights};

/// How finely a tube is cut.
#[derive(Debug, Clone, Copy)]
pub struct TubeResolution {
    /// Sides.
    pub sides: u32,
    /// Rings between two sections.
    pub rings: u32,
}

/// That of rods seen close.
pub const CLOSE_UP: TubeResolution = TubeResolution { sides: 16, rings: 4 };
/// Rings and sides of a ball.
const BALL: [u32; 2] = [12, 24];

/// A section of a rod: its joint, and how it was drawn.
pub struct TubeSection {
    /// Joint.
    pub joint: u16,
    /// Place, m.
    pub p: Vec3,
    /// Turn: +Y along the rod.
    pub q: Quat,
    /// Radius, m.
    pub r: f32,
}

/// A ring's place, turn, radius, and joints with the second one's share.
struct TubeRing {
    p: Vec3,
    q: Quat,
    r: f32,
    joints: [u16; 2],
    share: f32,
}

/// A closed tube. Between two sections the joints' shares pass over smoothly, so that bent tubes have no kinks: where a
/// share does not change, the tube runs along its section.
pub fn tube(stations: &[TubeSection], fine: TubeResolution) -> (Mesh, SkinWeights) {
    let mut made = SkinnedMeshBuilder::default();
    let sides = fine.sides;
    let rings = rings(stations, fine.rings);
    let (Some(first), Some(last)) = (rings.first(), rings.last()) else { return made.finish() };
    let mut along = 0.0;
    for (k, ring) in rings.iter().enumerate() {
        along += if k > 0 { (ring.p - rings[k - 1].p).length() } else { 0.0 };
        for i in 0..=sides {
            let turn = TAU * i as f32 / sides as f32;
            let out = ring.q * Vec3::new(math::cos_f32(turn), 0.0, -math::sin_f32(turn));
            made.point(ring.p + out * ring.r, (out, Vec2::new(i as f32 / sides as f32, along)), ring);
        }
    }
    let n = sides + 1;
    for k in 1..u32::try_from(rings.len()).unwrap_or(1) {
        for i in 0..sides {
            let (a, b) = ((k - 1) * n + i, k * n + i);
            made.mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    made.cap(first, (sides, false));
    made.cap(last, (sides, true));
    made.finish()
}

fn rings(stations: &[TubeSection], count: u32) -> Vec<TubeRing> {
    let mut out = Vec::new();
    for pair in stations.windows(2) {
        let (a, b) = (&pair[0], &pair[1]);
        let d = (b.p - a.p).length();
        let from = u32::from(!out.is_empty());
        for i in from..=count {
            let t = i as f32 / count as f32;
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

/// A ball that follows one joint.
pub fn ball(p: Vec3, r: f32, joint: u16) -> (Mesh, SkinWeights) {
    let mut made = SkinnedMeshBuilder::default();
    let ring = TubeRing { p, q: Quat::IDENTITY, r, joints: [joint; 2], share: 0.0 };
    let [rows, sides] = BALL;
    for k in 0..=rows {
        let polar = PI * k as f32 / rows as f32;
        let (s, c) = (math::sin_f32(polar), math::cos_f32(polar));
        for i in 0..=sides {
            let turn = TAU * i as f32 / sides as f32;
            let out = Vec3::new(s * math::cos_f32(turn), -c, -s * math::sin_f32(turn));
            made.point(p + out * r, (out, Vec2::new(i as f32 / sides as f32, k as f32 / rows as f32)), &ring);
        }
    }
    let n = sides + 1;
    for k in 1..=rows {
        for i in 0..sides {
            let (a, b) = ((k - 1) * n + i, k * n + i);
            if k > 1 {
                made.mesh.triangles.push([a, a + 1, b + 1]);
            }
            if k < rows {
                made.mesh.triangles.push([a, b + 1, b]);
            }
        }
    }
    made.finish()
}

#[derive(Default)]
struct SkinnedMeshBuilder {
    mesh: Mesh,
    skin: SkinWeights,
}

impl SkinnedMeshBuilder {
    fn point(&mut self, p: Vec3, (normal, uv): (Vec3, Vec2), ring: &TubeRing) {
        self.mesh.points.push(p);
        self.mesh.normals.push(normal);
        self.mesh.uvs.push(uv);
        let [a, b] = ring.joints;
        let (one, two) = if ring.share > 0.5 {
            ((b, ring.share), (a, 1.0 - ring.share))
        } else {
            ((a, 1.0 - ring.share), (b, ring.share))
        };
        let second = if two.1 > 0.0 && a != b { two.0 } else { 0 };
        self.skin.joints.push([one.0, second, 0, 0]);
        self.skin.weights.push([one.1, two.1, 0.0, 0.0]);
    }

    /// A disc at an end.
    fn cap(&mut self, ring: &TubeRing, (sides, outwards): (u32, bool)) {
        let base = u32::try_from(self.mesh.points.len()).unwrap_or(u32::MAX);
        let normal = ring.q * if outwards { Vec3::Y } else { -Vec3::Y };
        self.point(ring.p, (normal, Vec2::splat(0.5)), ring);
        for i in 0..sides {
            let turn = TAU * i as f32 / sides as f32;
            let (s, c) = (math::sin_f32(turn), math::cos_f32(turn));
            let out = ring.q * Vec3::new(c, 0.0, -s);
            self.point(ring.p + out * ring.r, (normal, Vec2::new(0.5 + 0.5 * c, 0.5 + 0.5 * s)), ring);
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
