//! Regions of space as signed distances, negative inside: envelopes that growth is cut off at, obstacles that it slides along.

use glam::{DVec3, Vec3};

use osier_base::math::{narrow, sqrt};
use osier_scene::Trs;
use osier_scene::solid::Solid;

/// Decay length of the influence of obstacles that repel or attract particles, m.
const INFLUENCE: f64 = 0.5;
/// Half the distance of the differences that estimate a normal, m.
const NORMAL_STEP: f64 = 1e-4;

/// A region in plant space, m.
#[derive(Debug, Clone)]
pub enum Region {
    /// A ball: distances are exact everywhere.
    Sphere {
        /// Position of its middle in plant space, m.
        center: DVec3,
        /// Distance of its surface from the middle, m.
        radius: f64,
    },
    /// An ellipsoid whose axes are parallel to x, y and z.
    Ellipsoid {
        /// Position of its middle in plant space, m.
        center: DVec3,
        /// Semi-axes along x, y and z, m.
        radii: DVec3,
    },
    /// A box whose edges are parallel to x, y and z.
    Box {
        /// Position of its middle in plant space, m.
        center: DVec3,
        /// Half of its edges, m.
        half: DVec3,
    },
    /// All points within `radius` of a line segment.
    Capsule {
        /// One end of the segment, m.
        from: DVec3,
        /// Other end of the segment, m.
        to: DVec3,
        /// Distance of the surface from the segment, m.
        radius: f64,
    },
    /// An upright cone on a round base.
    Cone {
        /// Middle of its base, m.
        base: DVec3,
        /// Radius of its base, m.
        radius: f64,
        /// Height of its apex above the base, m.
        height: f64,
    },
    /// The half space behind a plane, on the side opposite to its normal.
    HalfSpace {
        /// A point of the plane, m.
        point: DVec3,
        /// Unit normal out of the region.
        normal: DVec3,
    },
    /// Union of several regions, at least one; its distance is the least of theirs.
    Union(Vec<Region>),
    /// A solid of the scene, at any place and scale relative to the plant.
    Solid {
        /// The solid, in world space.
        solid: Box<Solid>,
        /// Transform from plant space to world space, with uniform scale.
        world_from_plant: Trs,
    },
}

/// Distance of a point from the surface of a region, and the direction out of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// Signed distance to the surface, m; below 0 inside.
    pub distance: f64,
    /// Unit vector out of the region.
    pub normal: DVec3,
}

impl Region {
    /// Signed distance to the surface, m. That of an ellipsoid is exact on its surface and of first order near it.
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Self::Sphere { center, radius } => p.distance(*center) - radius,
            Self::Ellipsoid { center, radii } => {
                let x = (p - center) / radii;
                // First-order distance f / |grad f| of f = |x / r| - 1, scaled so that it is exact on the surface.
                let (k0, k1) = (x.length(), (x / radii).length());
                if k1 < 1e-12 { -radii.min_element() } else { k0 * (k0 - 1.0) / k1 }
            }
            Self::Box { center, half } => {
                let q = (p - center).abs() - half;
                // Outside the distance to the nearest face, edge or corner; inside the negative distance to the nearest face.
                q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
            }
            Self::Capsule { from, to, radius } => {
                let along = *to - *from;
                // Share of the line at which it is nearest to the point.
                let t = ((p - from).dot(along) / along.length_squared().max(1e-300)).clamp(0.0, 1.0);
                p.distance(*from + along * t) - radius
            }
            Self::Cone { base, radius, height } => cone_distance(p - base, *radius, *height),
            Self::HalfSpace { point, normal } => (p - point).dot(*normal),
            Self::Union(parts) => parts.iter().map(|r| r.distance(p)).fold(f64::INFINITY, f64::min),
            Self::Solid { .. } => self.clearance(p).distance,
        }
    }

    /// Signed distance and outward normal; the normal is a central difference except for planes and solids.
    pub fn clearance(&self, p: DVec3) -> Clearance {
        match self {
            Self::HalfSpace { normal, .. } => Clearance { distance: self.distance(p), normal: *normal },
            Self::Solid { solid, world_from_plant: to_world } => {
                let at = to_world.t + to_world.r * (to_world.s * Vec3::from_array(p.to_array().map(narrow)));
                let near = solid.nearest(at);
                let normal = (to_world.r.inverse() * near.normal).as_dvec3().normalize_or_zero();
                Clearance { distance: f64::from(near.distance) / f64::from(to_world.s.x).max(1e-9), normal }
            }
            _ => {
                let h = NORMAL_STEP;
                let slope = |e: DVec3| self.distance(p + e * h) - self.distance(p - e * h);
                let gradient = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
                Clearance { distance: self.distance(p), normal: gradient.try_normalize().unwrap_or(DVec3::Y) }
            }
        }
    }

    /// Contribution of the region to the rate of change of a target direction, 1/t. A positive `rate` turns it away.
    #[inline]
    pub fn repulsion(&self, p: DVec3, rate: f64) -> DVec3 {
        let near = self.clearance(p);
        near.normal * (rate * osier_base::math::exp(-near.distance.max(0.0) / INFLUENCE))
    }

    /// Opposite corners of a box around the region, m; `None` for a half space and for unions that contain one.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let around = |center: &DVec3, half: DVec3| Some((*center - half, *center + half));
        match self {
            Self::Sphere { center, radius } => around(center, DVec3::splat(*radius)),
            Self::Ellipsoid { center, radii } => around(center, *radii),
            Self::Box { center, half } => around(center, *half),
            Self::Capsule { from, to, radius } => {
                let half = DVec3::splat(*radius);
                Some((from.min(*to) - half, from.max(*to) + half))
            }
            Self::Cone { base, radius, height } => {
                let half = DVec3::new(*radius, 0.0, *radius);
                Some((*base - half, *base + half + DVec3::Y * *height))
            }
            Self::HalfSpace { .. } => None,
            Self::Union(parts) => {
                let boxes: Option<Vec<_>> = parts.iter().map(Self::bounds).collect();
                boxes?.into_iter().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            }
            Self::Solid { solid, world_from_plant: to_world } => {
                let world = solid.bounds();
                let corner = |i: u8| {
                    let pick = |bit: u8, a: f32, b: f32| if i & bit == 0 { a } else { b };
                    let c = Vec3::new(
                        pick(1, world.min.x, world.max.x),
                        pick(2, world.min.y, world.max.y),
                        pick(4, world.min.z, world.max.z),
                    );
                    ((to_world.r.inverse() * (c - to_world.t)) / to_world.s).as_dvec3()
                };
                let start = (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY));
                Some((0..8).map(corner).fold(start, |(low, high), c| (low.min(c), high.max(c))))
            }
        }
    }
}

/// Signed distance to an upright cone with its base in the plane y = 0.
fn cone_distance(p: DVec3, radius: f64, height: f64) -> f64 {
    // In the half plane of distance from the axis and height: a triangle with the corners (0, 0), (radius, 0), (0, height).
    let (x, y) = (sqrt(p.x * p.x + p.z * p.z), p.y);
    let slant = sqrt(radius * radius + height * height);
    // Outward distance from the line of the slant, and place along it from the base, m.
    let side = ((x - radius) * height + y * radius) / slant;
    let along = ((radius - x) * radius + y * height) / slant;
    if y >= 0.0 && side <= 0.0 {
        return (-y).max(side);
    }
    let to_slant = {
        let t = along.clamp(0.0, slant) / slant;
        let (cx, cy) = (radius * (1.0 - t), height * t);
        sqrt((x - cx) * (x - cx) + (y - cy) * (y - cy))
    };
    let to_base = {
        let cx = x.min(radius);
        sqrt((x - cx) * (x - cx) + y * y)
    };
    to_slant.min(to_base)
}
