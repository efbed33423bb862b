//! The box around many placed boxes.

use glam::Vec3;
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use super::axis::{UpAxis, extent};
use crate::geometry::Bounds;
use crate::scene::Instancer;

/// Instances worked on side by side.
const LANES: usize = 8;

/// One number of several instances.
type Lane = [f32; LANES];

/// What each instance shows: scale, middle and half sides of its prototype's box, stage space.
pub(super) struct Shapes {
    /// `None` for instances of an empty prototype.
    each: Vec<Option<[Vec3; 3]>>,
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
            boxes.get(*proto as usize).copied().flatten().map(|[center, half]| [up.scale(*s), center, half])
        };
        Self { each: instancer.scales.iter().zip(&instancer.protos).map(shape).collect() }
    }

    /// Box of the live instances with their rotations as written. `positions`: stage space; `alive`: empty if all are.
    pub(super) fn extent(&self, turns: &[[f16; 4]], positions: &[Vec3], alive: &[bool]) -> [[f32; 3]; 2] {
        let mut rounded = vec![0.0; turns.len() * 4];
        turns.as_flattened().convert_to_f32_slice(&mut rounded);
        let turns: &[[f32; 4]] = bytemuck::cast_slice(&rounded);
        let placed = self.each.iter().zip(positions.iter().zip(turns)).enumerate();
        let mut live = placed.filter_map(|(i, (shape, (t, q)))| match alive.get(i) {
            Some(false) => None,
            _ => shape.map(|[s, center, half]| Placed { q: *q, columns: [s, *t, center, half] }),
        });
        let mut reach = Reach { low: [[f32::INFINITY; LANES]; 3], high: [[f32::NEG_INFINITY; LANES]; 3] };
        while let Some(first) = live.next() {
            // What is left over at the end is filled up with what is there already.
            let mut block = [first; LANES];
            for (slot, next) in block[1..].iter_mut().zip(&mut live) {
                *slot = next;
            }
            reach.add(&block);
        }
        reach.extent()
    }
}

/// An instance: rotation (x, y, z, w), and scale, position, middle and half sides of the box.
#[derive(Clone, Copy)]
struct Placed {
    q: [f32; 4],
    columns: [Vec3; 4],
}

/// Smallest and largest coordinates, lane by lane.
struct Reach {
    low: [Lane; 3],
    high: [Lane; 3],
}

impl Reach {
    /// Grows by the boxes of some instances.
    /// As readers do it: the matrix of the rounded quaternion, which is not quite a rotation. A box turns into the box
    /// around its turned centre with the matrix's absolute values applied to its half sides.
    fn add(&mut self, block: &[Placed; LANES]) {
        let [x, y, z, w]: [Lane; 4] = std::array::from_fn(|k| std::array::from_fn(|l| block[l].q[k]));
        let [s, t, center, half]: [[Lane; 3]; 4] = std::array::from_fn(|c| {
            std::array::from_fn(|k| std::array::from_fn(|l| block[l].columns[c].to_array()[k]))
        });
        for l in 0..LANES {
            let (x2, y2, z2) = (x[l] + x[l], y[l] + y[l], z[l] + z[l]);
            let (xx, xy, xz) = (x[l] * x2, x[l] * y2, x[l] * z2);
            let (yy, yz, zz) = (y[l] * y2, y[l] * z2, z[l] * z2);
            let (wx, wy, wz) = (w[l] * x2, w[l] * y2, w[l] * z2);
            let rows = [
                [1.0 - (yy + zz), xy - wz, xz + wy],
                [xy + wz, 1.0 - (xx + zz), yz - wx],
                [xz - wy, yz + wx, 1.0 - (xx + yy)],
            ];
            for (k, row) in rows.into_iter().enumerate() {
                let m = [row[0] * s[0][l], row[1] * s[1][l], row[2] * s[2][l]];
                let middle = t[k][l] + (m[0] * center[0][l] + m[1] * center[1][l] + m[2] * center[2][l]);
                let side = m[0].abs() * half[0][l] + m[1].abs() * half[1][l] + m[2].abs() * half[2][l];
                let (low, high) = (middle - side, middle + side);
                self.low[k][l] = if low < self.low[k][l] { low } else { self.low[k][l] };
                self.high[k][l] = if high > self.high[k][l] { high } else { self.high[k][l] };
            }
        }
    }

    fn extent(&self) -> [[f32; 3]; 2] {
        let corner = |l: usize| [&self.low, &self.high].map(|side| Vec3::new(side[0][l], side[1][l], side[2][l]));
        let lanes = (0..LANES).map(corner).map(|[min, max]| Bounds { min, max });
        extent(&lanes.fold(Bounds::default(), Bounds::union))
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

    /// The same box, one instance after the other, by matrices.
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
    fn side_by_side_gives_the_box_of_one_after_the_other_to_the_bit() {
        let mut draw = Rng::at(5, &["boxes".into()]);
        for n in [0, 1, 2, 7, 8, 9, 100] {
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
