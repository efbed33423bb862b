//! The extent of an instancer: the box around the transformed boxes of its prototypes, four instances at a time.

use glam::{Mat4, Vec3, Vec4};
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use crate::up_axis::{UpAxis, extent_corners};
use osier_base::geometry::Bounds;
use osier_scene::{InstanceState, Instancer, Prototype};

/// Instances in a block, one in each lane of a vector.
const LANES: usize = 4;

/// x, y and z of four instances.
type Lanes3 = [Vec4; 3];

/// The prototype boxes of four instances, in the axes of the stage.
struct InstanceBoxLanes {
    scale: Lanes3,
    /// Centre and half sides of the prototype's box.
    center: Lanes3,
    half: Lanes3,
    /// Upper bound of the distance from the instance's position to any point of its box, for any rotation.
    reach: Vec4,
    /// Lanes with an instance that has geometry.
    any: [bool; LANES],
}

/// The prototype boxes of all instances of an instancer.
pub(crate) struct InstancerBounds {
    blocks: Vec<InstanceBoxLanes>,
}

impl InstancerBounds {
    /// Measures the boxes of the prototypes and arranges the instances in blocks of [`LANES`].
    pub(crate) fn of(instancer: &Instancer, up: UpAxis) -> Self {
        let boxed = |p: &Prototype| {
            let points = Bounds::of(p.mesh.points.iter().map(|p| up.stage_vec(*p)));
            // Fine geometry (hairs) may reach beyond the mesh: its box is converted by its corners and added.
            let fine = p.fine.as_ref().map(|_| p.bounds()).filter(|b| !b.is_empty());
            let b = fine.map_or(points, |b| points.union(Bounds::of([up.stage_vec(b.min), up.stage_vec(b.max)])));
            (!b.is_empty()).then(|| [b.center(), b.size() * 0.5])
        };
        let boxes: Vec<Option<[Vec3; 2]>> = instancer.prototypes.iter().map(boxed).collect();
        let shape = |(s, proto): (&Vec3, &u32)| {
            let [center, half] = boxes.get(*proto as usize).copied().flatten()?;
            Some([up.stage_scale(*s), center, half])
        };
        let each: Vec<Option<[Vec3; 3]>> = instancer.scales.iter().zip(&instancer.protos).map(shape).collect();
        Self { blocks: each.chunks(LANES).map(InstanceBoxLanes::of).collect() }
    }

    /// The extent of the live instances. `turns`: orientations as they are written, x, y, z, w; `positions`: in the axes of the
    /// stage; `state`: which are alive, and their sizes.
    pub(crate) fn extent(&self, turns: &[[f16; 4]], positions: &[Vec3], state: &InstanceState) -> [[f32; 3]; 2] {
        let alive = &state.alive;
        // Back from half to single precision: the extent must hold for the orientations as they are stored.
        let mut rounded = vec![0.0; turns.len() * 4];
        turns.as_flattened().convert_to_f32_slice(&mut rounded);
        let turns: &[[f32; 4]] = bytemuck::cast_slice(&rounded);
        // An empty box: any point lowers the infinite minimum and raises the maximum.
        let mut span = ExtentLanes { low: [Vec4::INFINITY; 3], high: [Vec4::NEG_INFINITY; 3] };
        let placed = positions.chunks(LANES).zip(turns.chunks(LANES));
        for (block, (shown, (t, q))) in self.blocks.iter().zip(placed).enumerate() {
            let resized = (!state.sizes.is_empty()).then(|| shown.with_size_factors(|l| state.size(block * LANES + l)));
            let shown = resized.as_ref().unwrap_or(shown);
            // The last block has 1 to 4 instances; its empty lanes count as not alive.
            let n = t.len().min(q.len());
            let lives = |l: usize| shown.any[l] && l < n && alive.get(block * LANES + l) != Some(&false);
            let live: [bool; LANES] = std::array::from_fn(lives);
            match (t.try_into(), q.try_into()) {
                (Ok(t), Ok(q)) if live == [true; LANES] => span.add(shown, t, q),
                _ => {
                    // Lanes without a live instance repeat one that is alive, which does not change the box.
                    let Some(first) = live.iter().position(|l| *l) else { continue };
                    let lanes: [usize; LANES] = std::array::from_fn(|l| if live[l] { l } else { first });
                    span.add(&shown.permute(lanes), &lanes.map(|l| t[l]), &lanes.map(|l| q[l]));
                }
            }
        }
        let min = Vec3::from_array(span.low.map(Vec4::min_element));
        let max = Vec3::from_array(span.high.map(Vec4::max_element));
        extent_corners(&Bounds { min, max })
    }
}

impl InstanceBoxLanes {
    /// Transposes at most [`LANES`] instances: scale, centre and half sides of each; `None` for an instance without geometry.
    fn of(each: &[Option<[Vec3; 3]>]) -> Self {
        let lane = |l: usize| each.get(l).copied().flatten();
        let of =
            |what: usize| transpose_lanes(&std::array::from_fn(|l| lane(l).map_or(Vec3::ZERO, |shape| shape[what])));
        // Use the triangle inequality; quaternions rounded to half precision give matrices that stretch by less than a
        // hundredth.
        let reach = |[scale, center, half]: [Vec3; 3]| 1.01 * ((scale * center).length() + (scale * half).length());
        Self {
            scale: of(0),
            center: of(1),
            half: of(2),
            reach: Vec4::from_array(std::array::from_fn(|l| lane(l).map_or(0.0, reach))),
            any: std::array::from_fn(|l| lane(l).is_some()),
        }
    }

    /// The same block with the scales multiplied by factors. `size`: factor of each lane.
    fn with_size_factors(&self, size: impl Fn(usize) -> f32) -> Self {
        let size = Vec4::from_array(std::array::from_fn(size));
        Self { scale: self.scale.map(|v| v * size), reach: self.reach * size, ..*self }
    }

    /// The same block with the lanes in another order.
    fn permute(&self, lanes: [usize; LANES]) -> Self {
        let pick = |v: Vec4| {
            let v = v.to_array();
            Vec4::from_array(lanes.map(|l| v[l]))
        };
        Self {
            scale: self.scale.map(pick),
            center: self.center.map(pick),
            half: self.half.map(pick),
            reach: pick(self.reach),
            any: lanes.map(|l| self.any[l]),
        }
    }
}

fn transpose_lanes([a, b, c, d]: &[Vec3; LANES]) -> Lanes3 {
    [Vec4::new(a.x, b.x, c.x, d.x), Vec4::new(a.y, b.y, c.y, d.y), Vec4::new(a.z, b.z, c.z, d.z)]
}

/// Smallest and largest coordinates so far, in each lane.
struct ExtentLanes {
    low: Lanes3,
    high: Lanes3,
}

impl ExtentLanes {
    /// Adds the boxes of four instances at positions `t` with orientations `q` (x, y, z, w).
    fn add(&mut self, shown: &InstanceBoxLanes, t: &[Vec3; LANES], q: &[[f32; 4]; LANES]) {
        let t = transpose_lanes(t);
        // Skip blocks that cannot extend the box: t +- reach lies within it. The term 1e-6 |t| covers the rounding of all sums,
        // so the result has the same bits as without this test.
        let within = |k: usize| {
            let reach = shown.reach + t[k].abs() * 1e-6;
            (t[k] - reach).cmpge(self.low[k]) & (t[k] + reach).cmple(self.high[k])
        };
        if (within(0) & within(1) & within(2)).all() {
            return;
        }
        // The box around a transformed box (Arvo 1990): centre t + R S c, half sides |R S| h, row by row.
        for (k, row) in rotation_rows(q).into_iter().enumerate() {
            let [x, y, z]: Lanes3 = std::array::from_fn(|i| row[i] * shown.scale[i]);
            let middle = t[k] + (x * shown.center[0] + y * shown.center[1] + z * shown.center[2]);
            let side = x.abs() * shown.half[0] + y.abs() * shown.half[1] + z.abs() * shown.half[2];
            self.low[k] = (middle - side).min(self.low[k]);
            self.high[k] = (middle + side).max(self.high[k]);
        }
    }
}

/// Rows of the matrices of four quaternions, by the formula that readers use. The quaternions are rounded and not of unit length,
/// so the matrices are not exactly rotations.
fn rotation_rows(q: &[[f32; 4]; LANES]) -> [Lanes3; 3] {
    let Mat4 { x_axis: x, y_axis: y, z_axis: z, w_axis: w } = Mat4::from_cols_array_2d(q).transpose();
    let (x2, y2, z2) = (x + x, y + y, z + z);
    let (xx, xy, xz) = (x * x2, x * y2, x * z2);
    let (yy, yz, zz) = (y * y2, y * z2, z * z2);
    let (wx, wy, wz) = (w * x2, w * y2, w * z2);
    [[1.0 - (yy + zz), xy - wz, xz + wy], [xy + wz, 1.0 - (xx + zz), yz - wx], [xz - wy, yz + wx, 1.0 - (xx + yy)]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, Quat};
    use osier_base::rng::Rng;
    use osier_scene::{InstanceState, InstancerMotion, Mesh};

    fn instancer(n: usize, draw: &mut Rng) -> Instancer {
        let mut point = |r: f64| Vec3::from_array([0; 3].map(|_| osier_base::math::narrow(draw.range(-r, r))));
        let solid = |points: Vec<Vec3>| Prototype::new("", Mesh { points, ..Mesh::default() });
        let prototypes = vec![
            solid((0..5).map(|_| point(1.0)).collect()),
            solid(vec![]),
            solid((0..3).map(|_| point(3.0)).collect()),
        ];
        Instancer {
            name: String::new(),
            prototypes,
            ids: Vec::new(),
            protos: (0..n).map(|i| [0, 1, 2, 2, 0, 0, 2, 2, 2, 0, 2][i % 11]).collect(),
            scales: (0..n).map(|_| point(2.0)).collect(),
            rest: InstanceState {
                positions: (0..n).map(|_| point(20.0)).collect(),
                orientations: (0..n).map(|_| Quat::from_axis_angle(point(1.0).normalize(), 2.0)).collect(),
                alive: (0..n).map(|i| i % 13 != 3).collect(),
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
            let shape = Bounds::of(it.prototypes[it.protos[i] as usize].mesh.points.iter().map(|p| up.stage_vec(*p)));
            if !shape.is_empty() {
                let m = Mat3::from_quat(Quat::from_array(q.map(f16::to_f32)))
                    * Mat3::from_diagonal(up.stage_scale(it.scales[i]));
                let (center, half) =
                    (up.stage_vec(it.rest.positions[i]) + m * shape.center(), m.abs() * (shape.size() * 0.5));
                b = b.with(center - half).with(center + half);
            }
        }
        extent_corners(&b)
    }

    #[test]
    fn leaving_out_what_lies_within_changes_no_bit() {
        let mut draw = Rng::at(5, &["boxes".into()]);
        for n in [0, 1, 2, 9, 100, 1000] {
            let it = instancer(n, &mut draw);
            for up in [UpAxis::Y, UpAxis::Z] {
                let turns: Vec<[f16; 4]> =
                    it.rest.orientations.iter().map(|q| up.stage_quat(*q).to_array().map(f16::from_f32)).collect();
                let got = InstancerBounds::of(&it, up).extent(&turns, &up.stage_vecs(&it.rest.positions), &it.rest);
                let bits = |e: [[f32; 3]; 2]| e.map(|v| v.map(f32::to_bits));
                assert_eq!(bits(got), bits(plainly(&it, &turns, up)), "{n} instances");
            }
        }
    }
}
