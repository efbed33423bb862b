//! The box around many placed boxes.

use glam::Vec3;
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use super::axis::{UpAxis, extent};
use crate::geometry::Bounds;
use crate::scene::Instancer;

/// What an instance shows, in stage space.
struct Shape {
    scale: Vec3,
    /// Middle and half sides of the prototype's box.
    center: Vec3,
    half: Vec3,
    /// However it turns, its box ends no farther from its pivot, in any direction.
    reach: f32,
}

/// What each instance of an instancer shows.
pub(super) struct Shapes {
    /// `None` for instances of an empty prototype.
    each: Vec<Option<Shape>>,
}

impl Shapes {
    /// The shapes of an instancer.
    pub(super) fn of(instancer: &Instancer, up: UpAxis) -> Self {
        let boxed = |points: &[Vec3]| {
            let b = Bounds::of(points.iter().map(|v| up.vec(*v)));
            (!b.is_empty()).then(|| [b.center(), b.size() * 0.5])
        };
        let boxes: Vec<Option<[Vec3; 2]>> = instancer.prototypes.iter().map(|p| boxed(&p.mesh.points)).collect();
        let shape = |(s, proto): (&Vec3, &u32)| {
            let [center, half] = boxes.get(*proto as usize).copied().flatten()?;
            let scale = up.scale(*s);
            // Rounded quaternions make matrices that stretch by less than a hundredth.
            let reach = 1.01 * ((scale * center).length() + (scale * half).length());
            Some(Shape { scale, center, half, reach })
        };
        Self { each: instancer.scales.iter().zip(&instancer.protos).map(shape).collect() }
    }

    /// Box of the live instances with their rotations as written. `positions`: stage space; `alive`: empty if all are.
    pub(super) fn extent(&self, turns: &[[f16; 4]], positions: &[Vec3], alive: &[bool]) -> [[f32; 3]; 2] {
        let mut rounded = vec![0.0; turns.len() * 4];
        turns.as_flattened().convert_to_f32_slice(&mut rounded);
        let turns: &[[f32; 4]] = bytemuck::cast_slice(&rounded);
        let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for (i, (shape, (t, q))) in self.each.iter().zip(positions.iter().zip(turns)).enumerate() {
            let Some(shape) = shape.as_ref().filter(|_| alive.get(i) != Some(&false)) else { continue };
            for (k, t) in t.to_array().into_iter().enumerate() {
                // Most instances lie well within what the others span; the second term covers all rounding.
                let reach = shape.reach + t.abs() * 1e-6;
                if t - reach < min[k] || t + reach > max[k] {
                    let (low, high) = shape.span(t, row(q, k));
                    min[k] = min[k].min(low);
                    max[k] = max[k].max(high);
                }
            }
        }
        extent(&Bounds { min: min.into(), max: max.into() })
    }
}

/// Row `k` of a quaternion's matrix (x, y, z, w), as readers compute it: the quaternion was rounded, so this is not quite
/// a rotation.
fn row(&[x, y, z, w]: &[f32; 4], k: usize) -> [f32; 3] {
    let (x2, y2, z2) = (x + x, y + y, z + z);
    match k {
        0 => [1.0 - (y * y2 + z * z2), x * y2 - w * z2, x * z2 + w * y2],
        1 => [x * y2 + w * z2, 1.0 - (x * x2 + z * z2), y * z2 - w * x2],
        _ => [x * z2 - w * y2, y * z2 + w * x2, 1.0 - (x * x2 + y * y2)],
    }
}

impl Shape {
    /// From where to where the turned box reaches in one direction: around its turned middle with the absolute values
    /// of the matrix applied to its half sides.
    fn span(&self, t: f32, row: [f32; 3]) -> (f32, f32) {
        let m = Vec3::from_array(row) * self.scale;
        let middle = t + m.dot(self.center);
        let side = m.abs().dot(self.half);
        (middle - side, middle + side)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::scene::{InstanceState, InstancerMotion, Mesh, Prototype};
    use glam::{Mat3, Quat};

    fn instancer(n: usize, draw: &mut Rng) -> Instancer {
        let mut point = |r: f64| Vec3::from_array([0; 3].map(|_| crate::math::narrow(draw.range(-r, r))));
        let solid = |points: Vec<Vec3>| Prototype { name: String::new(), mesh: Mesh { points, ..Mesh::default() } };
        let prototypes = vec![
            solid((0..5).map(|_| point(1.0)).collect()),
            solid(vec![]),
            solid((0..3).map(|_| point(3.0)).collect()),
        ];
        Instancer {
            name: String::new(),
            prototypes,
            ids: Vec::new(),
            protos: (0..n).map(|i| [0, 1, 2, 2][i % 4]).collect(),
            scales: (0..n).map(|_| point(2.0)).collect(),
            rest: InstanceState {
                positions: (0..n).map(|_| point(20.0)).collect(),
                orientations: (0..n).map(|_| Quat::from_axis_angle(point(1.0).normalize(), 2.0)).collect(),
                alive: (0..n).map(|i| i % 5 != 3).collect(),
                ..InstanceState::default()
            },
            motion: InstancerMotion::Free,
            tracked: false,
        }
    }

    /// The same box, nothing left out.
    fn plainly(it: &Instancer, turns: &[[f16; 4]], up: UpAxis) -> [[f32; 3]; 2] {
        let mut b = Bounds::default();
        for (i, q) in turns.iter().enumerate().filter(|(i, _)| it.rest.alive[*i]) {
            let shape = Bounds::of(it.prototypes[it.protos[i] as usize].mesh.points.iter().map(|p| up.vec(*p)));
            if !shape.is_empty() {
                let m =
                    Mat3::from_quat(Quat::from_array(q.map(f16::to_f32))) * Mat3::from_diagonal(up.scale(it.scales[i]));
                let (center, half) =
                    (up.vec(it.rest.positions[i]) + m * shape.center(), m.abs() * (shape.size() * 0.5));
                b = b.with(center - half).with(center + half);
            }
        }
        extent(&b)
    }

    #[test]
    fn leaving_out_what_lies_within_changes_no_bit() {
        let mut draw = Rng::at(5, &["boxes".into()]);
        for n in [0, 1, 2, 9, 100, 1000] {
            let it = instancer(n, &mut draw);
            for up in [UpAxis::Y, UpAxis::Z] {
                let turns: Vec<[f16; 4]> =
                    it.rest.orientations.iter().map(|q| up.quat(*q).to_array().map(f16::from_f32)).collect();
                let got = Shapes::of(&it, up).extent(&turns, &up.vecs(&it.rest.positions), &it.rest.alive);
                let bits = |e: [[f32; 3]; 2]| e.map(|v| v.map(f32::to_bits));
                assert_eq!(bits(got), bits(plainly(&it, &turns, up)), "{n} instances");
            }
        }
    }
}
