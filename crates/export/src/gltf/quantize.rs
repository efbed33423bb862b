//! Quantized vertices: positions as 16-bit integers in a cube, and the transform from it to metres.
//!
//! The transform is not stored with the mesh: nodes, instances and inverse bind matrices apply it before their other
//! transforms (KHR_mesh_quantization).

use glam::{Mat4, Quat, Vec3};

use osier_scene::Trs;

/// The cube that holds the positions of a mesh: p = low + extent q with q from 0 to 1 on each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct QuantizedCube {
    /// Corner with the smallest coordinates, m.
    low: Vec3,
    /// Length of an edge, m, above 0: equal for all axes, so that normals keep their directions.
    extent: f32,
}

impl QuantizedCube {
    /// The smallest cube that contains the positions; it begins at their least corner. A single position gets a cube of
    /// 1 m.
    pub(super) fn around(points: impl Iterator<Item = Vec3>) -> Self {
        let (low, high) = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        // Positions that are not finite are reported by the buffer; any cube serves until then.
        let extent = (high - low).max_element();
        let known = extent.is_finite() && extent > 0.0;
        Self { low: if low.is_finite() { low } else { Vec3::ZERO }, extent: if known { extent } else { 1.0 } }
    }

    /// A position, m, as shares of the cube, 0 to 1.
    pub(super) fn shares(&self, p: Vec3) -> Vec3 {
        (p - self.low) / self.extent
    }

    /// A position, m, rounded to 16-bit integers, as shares of the cube.
    pub(super) fn stored(&self, p: Vec3) -> Vec3 {
        (self.shares(p).clamp(Vec3::ZERO, Vec3::ONE) * 65_535.0).round() / 65_535.0
    }

    /// A difference of two positions in the cube, m, as shares of its edge, -1 to 1.
    pub(super) fn difference(&self, d: Vec3) -> Vec3 {
        d / self.extent
    }

    /// The transform from shares of the cube to metres.
    pub(super) fn to_metres(self) -> Trs {
        Trs { t: self.low, r: Quat::IDENTITY, s: Vec3::splat(self.extent) }
    }

    /// An inverse bind matrix, column-major, that takes shares of the cube instead of metres.
    pub(super) fn inverse_bind(&self, matrix: &[f32; 16]) -> [f32; 16] {
        let to_metres = Mat4::from_translation(self.low) * Mat4::from_scale(Vec3::splat(self.extent));
        (Mat4::from_cols_array(matrix) * to_metres).to_cols_array()
    }
}

/// A transform that takes stored positions: `place` after the dequantization of the mesh, if it has one.
pub(super) fn place_stored(place: &Trs, cube: Option<QuantizedCube>) -> Trs {
    // Without a cube the transform keeps its bits.
    cube.map_or(*place, |c| place.then_inner(&c.to_metres()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_comes_back_within_half_a_step() {
        let points = [Vec3::new(-2.0, 1.0, 0.25), Vec3::new(1.0, 1.5, 3.0), Vec3::new(0.1, 1.2, 0.3)];
        let cube = QuantizedCube::around(points.into_iter());
        assert!((cube.extent - 3.0).abs() < 1e-6);
        for p in points {
            let stored = (cube.shares(p) * 65_535.0).round() / 65_535.0;
            let place = Trs { t: Vec3::Y, r: Quat::from_rotation_z(0.7), s: Vec3::splat(2.0) };
            let error = (place_stored(&place, Some(cube)).apply(stored) - place.apply(p)).abs().max_element();
            assert!(error <= 2.0 * 3.0 / 131_070.0 * 1.5, "{error}");
        }
    }
}
