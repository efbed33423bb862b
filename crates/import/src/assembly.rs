//! Joins parts of one material each to a [`Mesh`].

use glam::{Vec2, Vec3};

use super::{ImportContext, ImportResult, TriangleGroup, UpAxis, table_index};
use osier_base::geometry::Bounds;
use osier_base::math;
use osier_base::par::LookupMap;
use osier_scene::{Mesh, Subset};

/// Triangles of one material as a file gives them, in the file's axes and units. `normals`, `uvs` and `colors` hold one
/// value per point or none.
#[derive(Debug, Clone, Default)]
pub(super) struct MeshPart {
    /// Place in the file, for messages: `meshes[0].primitives[1]`.
    pub(super) place: String,
    /// Name of its object in the file; empty if it has none.
    pub(super) name: String,
    pub(super) material: u32,
    pub(super) points: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) uvs: Vec<Vec2>,
    pub(super) colors: Vec<[f32; 4]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// Joins parts: one subset per material in index order, +Y up, metres, unit normals. Triangles without area are
/// dropped with a warning.
/// # Errors
/// X001 for a value that is not finite, X010 for an index beyond the points or no triangle at all.
pub(super) fn join(context: &mut ImportContext<'_>, mut parts: Vec<MeshPart>) -> ImportResult<Mesh> {
    parts.retain(|p| !p.triangles.is_empty());
    warn_of_rounding(context, &parts);
    // A stable sort: parts of one material keep the order of the file and become one subset.
    parts.sort_by_key(|p| p.material);
    // A mesh has an attribute for all of its points or for none: if one part has it, the others are filled with
    // defaults.
    let with_uvs = parts.iter().any(|p| !p.uvs.is_empty());
    let with_colors = parts.iter().any(|p| !p.colors.is_empty());
    let mut mesh = Mesh::default();
    let mut dropped = 0;
    for mut part in parts {
        check_part(context, &part)?;
        let before = part.triangles.len();
        let points = &part.points;
        part.triangles.retain(|t| double_area(points, *t).length() > 0.0);
        dropped += before - part.triangles.len();
        to_world_axes(context, &mut part)?;
        fill_normals(&mut part);
        if with_uvs {
            part.uvs.resize(part.points.len(), Vec2::ZERO);
        }
        if with_colors {
            part.colors.resize(part.points.len(), [1.0; 4]);
        }
        let count = table_index(part.triangles.len());
        let subsets = vec![Subset { material: part.material, first: 0, count }];
        let start = mesh.triangles.len();
        context.parts.push(TriangleGroup { name: part.name, triangles: start..start + part.triangles.len() });
        let MeshPart { points, normals, uvs, colors, triangles, .. } = part;
        mesh.append(&Mesh { points, normals, uvs, colors, triangles, subsets, ..Mesh::default() });
    }
    if dropped > 0 {
        context.warn("X016", format_args!("holds {dropped} triangles without area; they are left out"));
    }
    if mesh.triangles.is_empty() {
        let error = context.error_about_file("X010", "holds no triangle with an area");
        return Err(Box::new(error.help("export a mesh with faces; points, lines and curves are not read")));
    }
    Ok(mesh)
}

/// Warns (X016) of a mesh so far from the origin of its file that 32-bit coordinates change its shape, for example
/// terrain in the coordinates of a national grid.
fn warn_of_rounding(context: &mut ImportContext<'_>, parts: &[MeshPart]) {
    /// Spacing of neighbouring f32 coordinates, as a share of the size of the mesh, above which its shape visibly suffers. Own: a
    /// mesh of 1 km then has steps of 10 cm; meshes near their origin are a thousand times finer.
    const COARSE: f32 = 1e-4;
    let bounds = Bounds::of(parts.iter().flat_map(|p| p.points.iter().copied()));
    let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
    let size = (bounds.max - bounds.min).max_element();
    // f32 has a significand of 24 bits: coordinates near `farthest` are this far apart, or half as far.
    let step = farthest * f32::EPSILON;
    if size > 0.0 && size.is_finite() && step > COARSE * size {
        let message = format_args!(
            "is {size:.3} units large and {farthest:.0} units away from the origin of its file, where coordinates of 32 bits \
             are rounded to {step:.5}"
        );
        let warning = context.error_about_file("X016", message).help("move the mesh to the origin and export it again");
        context.report.push(warning);
    }
}

/// Checks that all numbers are finite and all indices name a vertex.
/// # Errors
/// X001, X010.
fn check_part(context: &ImportContext<'_>, part: &MeshPart) -> ImportResult<()> {
    let not_finite =
        |what: &str, i: usize| context.error_in_file("X001", format_args!("{}: {what} {i} is not finite", part.place));
    if let Some(i) = part.points.iter().position(|p| !p.is_finite()) {
        return Err(not_finite("vertex", i));
    }
    if let Some(i) = part.normals.iter().position(|n| !n.is_finite()) {
        return Err(not_finite("normal", i));
    }
    if let Some(i) = part.uvs.iter().position(|uv| !uv.is_finite()) {
        return Err(not_finite("texture coordinate", i));
    }
    if let Some(i) = part.colors.iter().position(|c| !c.iter().all(|v| v.is_finite())) {
        return Err(not_finite("colour", i));
    }
    let n = part.points.len();
    match part.triangles.iter().position(|t| t.iter().any(|i| *i as usize >= n)) {
        Some(i) => {
            let place = &part.place;
            Err(context
                .error_in_file("X010", format_args!("{place}: triangle {i} names a vertex beyond the last of {n}")))
        }
        None => Ok(()),
    }
}

/// Converts a part to +Y up and metres; X001 if a vertex is not finite afterwards.
fn to_world_axes(context: &ImportContext<'_>, part: &mut MeshPart) -> ImportResult<()> {
    let (up, scale) = (context.options.up, context.options.scale);
    // A quarter turn about x, which keeps the handedness and with it the winding of triangles.
    let turn = |v: Vec3| if up == UpAxis::Z { Vec3::new(v.x, v.z, -v.y) } else { v };
    part.points.iter_mut().for_each(|p| *p = turn(*p) * scale);
    part.normals.iter_mut().for_each(|n| *n = turn(*n));
    if part.points.iter().all(|p| p.is_finite()) {
        Ok(())
    } else {
        Err(context
            .error_in_file("X001", format_args!("{}: a vertex is not finite after scaling by {scale}", part.place)))
    }
}

/// Cross product of two edges: the normal times twice the area.
fn double_area(points: &[Vec3], t: [u32; 3]) -> Vec3 {
    let [a, b, c] = t.map(|i| points.get(i as usize).copied().unwrap_or_default());
    (b - a).cross(c - a)
}

/// Makes normals unit length, and computes those that are absent or zero from the faces around: the sum of face normals
/// times area over all points at the same place, so that texture seams do not show.
/// Differs: glTF asks for flat faces where normals are absent; leaves and petals are smooth.
fn fill_normals(part: &mut MeshPart) {
    let has_normals = part.normals.len() == part.points.len();
    let is_unit = |n: &Vec3| n.length_squared() > 1e-12;
    if has_normals && part.normals.iter().all(is_unit) {
        part.normals.iter_mut().for_each(|n| *n = n.normalize());
        return;
    }
    // Weld points by position, bit for bit; each weld sums the cross products of its faces, the area-weighted normal.
    let mut places: LookupMap<[u32; 3], usize> = LookupMap::default();
    let mut place_of = Vec::with_capacity(part.points.len());
    for p in &part.points {
        // Adding zero joins -0 with 0.
        let key = (*p + Vec3::ZERO).to_array().map(f32::to_bits);
        let next = places.len();
        let place = places.get(&key).copied().unwrap_or(next);
        if place == next {
            places.insert(key, next);
        }
        place_of.push(place);
    }
    let mut sums = vec![Vec3::ZERO; places.len()];
    for t in &part.triangles {
        // The cross product is already weighted by the area of the triangle.
        let area = double_area(&part.points, *t);
        for i in t {
            if let Some(sum) = place_of.get(*i as usize).and_then(|p| sums.get_mut(*p)) {
                *sum += area;
            }
        }
    }
    let computed = place_of.iter().map(|p| sums.get(*p).copied().unwrap_or_default());
    let pick = |(i, sum): (usize, Vec3)| {
        let own = part.normals.get(i).filter(|n| has_normals && is_unit(n)).copied().unwrap_or(sum);
        // Areas of small leaves are far below the length that counts as none.
        let largest = own.abs().max_element();
        math::normalize_or(if largest > 0.0 { own / largest } else { own }, Vec3::Y)
    };
    part.normals = computed.enumerate().map(pick).collect();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_smooth_across_doubled_points() {
        let corner = Vec3::new(0.0, 0.0, 1e-3);
        let mut part = MeshPart {
            points: vec![Vec3::ZERO, Vec3::X * 1e-3, corner, Vec3::ZERO, corner, Vec3::Y * 1e-3],
            triangles: vec![[0, 2, 1], [3, 5, 4]],
            ..MeshPart::default()
        };
        fill_normals(&mut part);
        let ridge = Vec3::new(1.0, 1.0, 0.0).normalize();
        assert!((part.normals[0] - ridge).length() < 1e-6 && (part.normals[3] - ridge).length() < 1e-6);
        assert!((part.normals[1] - Vec3::Y).length() < 1e-6 && (part.normals[5] - Vec3::X).length() < 1e-6);
    }
}
