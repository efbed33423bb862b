//! Arrays of the scene as arrays of USD's element types, and extents of points.

use glam::Vec3;

use crate::up_axis::extent_corners;
use osier_base::Result;
use osier_base::convert::narrow;
use osier_base::geometry::Bounds;

/// Reinterprets vectors as `float3` elements in the same memory.
pub(crate) fn as_float3(v: &[Vec3]) -> &[[f32; 3]] {
    bytemuck::cast_slice(v)
}

/// Reinterprets numbers as `int` elements in the same memory. `what`: what the values number, in the plural, for
/// errors.
/// # Errors
/// `TooMany` if a value exceeds `i32::MAX`.
pub(crate) fn as_ints<'a>(values: &'a [u32], what: &'static str) -> Result<&'a [i32]> {
    // Below 2^31 a number has the same bits as u32 and as i32: the memory is reinterpreted, not copied.
    narrow::<i32, u32>(values.iter().copied().max().unwrap_or(0), what)?;
    Ok(bytemuck::cast_slice(values))
}

/// The ids 0 to n - 1.
pub(crate) fn sequential_ids(n: usize) -> Vec<i64> {
    (0_i64..).take(n).collect()
}

/// Extent of points with widths: the box of spheres of those diameters.
pub(crate) fn points_extent(points: &[Vec3], widths: &[f32]) -> [[f32; 3]; 2] {
    let spheres = points.iter().zip(widths).map(|(p, w)| Bounds::of([*p]).expanded(w * 0.5));
    extent_corners(&spheres.fold(Bounds::default(), Bounds::union))
}
