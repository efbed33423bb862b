//! Pieces of one material put together into a [`Mesh`].

use glam::{Vec2, Vec3};

use super::{Job, Outcome, TriangleGroup, Up};
use osier_base::math;
use osier_base::par::LookupMap;
use osier_scene::{Mesh, Subset};

/// Triangles of one material as a file gives them, in the file's axes and units. `normals`, `uvs` and `colors` hold one
/// value per point or none.
#[derive(Debug, Clone, Default)]
pub(super) struct MeshPart {
    /// Name of the place in the file, for complaints.
    pub(super) place: String,
    /// What the file calls its object.
    pub(super) name: String,
    pub(super) material: u32,
    pub(super) points: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) uvs: Vec<Vec2>,
    pub(super) colors: Vec<[f32; 4]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// Joins pieces: one subset per material in index order, +Y up, metres, unit normals. Triangles without area are
/// dropped with a warning.
/// # Errors
/// X001 for a value that is not finite, X010 for an index beyond the points or no triangle at all.
pub(super) fn join(job: &mut Job<'_>, mut pieces: Vec<MeshPart>) -> Outcome<Mesh> {
    pieces.retain(|p| !p.triangles.is_empty());
    pieces.sort_by_key(|p| p.material);
    let with_uvs = pieces.iter().any(|p| !p.uvs.is_empty());
    let with_colors = pieces.iter().any(|p| !p.colors.is_empty());
    let mut mesh = Mesh::default();
    let mut dropped = 0;
    for mut piece in pieces {
        check(job, &piece)?;
        let before = piece.triangles.len();
        let points = &piece.points;
        piece.triangles.retain(|t| double_area(points, *t).length() > 0.0);
        dropped += before - piece.triangles.len();
        orient(job, &mut piece)?;
        fill_normals(&mut piece);
        if with_uvs {
            piece.uvs.resize(piece.points.len(), Vec2::ZERO);
        }
        if with_colors {
            piece.colors.resize(piece.points.len(), [1.0; 4]);
        }
        let count = u32::try_from(piece.triangles.len()).unwrap_or(u32::MAX);
        let subsets = vec![Subset { material: piece.material, first: 0, count }];
        let start = mesh.triangles.len();
        job.parts.push(TriangleGroup { name: piece.name, triangles: start..start + piece.triangles.len() });
        let MeshPart { points, normals, uvs, colors, triangles, .. } = piece;
        mesh.append(&Mesh { points, normals, uvs, colors, triangles, subsets, ..Mesh::default() });
    }
    if dropped > 0 {
        job.warn("X016", format_args!("holds {dropped} triangles without area; they are left out"));
    }
    if mesh.triangles.is_empty() {
        return Err(job.fault("X010", "holds no triangle with an area"));
    }
    Ok(mesh)
}

fn check(job: &Job<'_>, piece: &MeshPart) -> Outcome<()> {
    let bad = |what: &str, i: usize| job.inside("X001", format_args!("{}: {what} {i} is not finite", piece.place));
    if let Some(i) = piece.points.iter().position(|p| !p.is_finite()) {
        return Err(bad("vertex", i));
    }
    if let Some(i) = piece.normals.iter().position(|n| !n.is_finite()) {
        return Err(bad("normal", i));
    }
    if let Some(i) = piece.uvs.iter().position(|uv| !uv.is_finite()) {
        return Err(bad("texture coordinate", i));
    }
    if let Some(i) = piece.colors.iter().position(|c| !c.iter().all(|v| v.is_finite())) {
        return Err(bad("colour", i));
    }
    let n = piece.points.len();
    match piece.triangles.iter().position(|t| t.iter().any(|i| *i as usize >= n)) {
        Some(i) => {
            let place = &piece.place;
            Err(job.inside("X010", format_args!("{place}: triangle {i} names a vertex beyond the last of {n}")))
        }
        None => Ok(()),
    }
}

/// Turns a piece into osier's axes and metres.
fn orient(job: &Job<'_>, piece: &mut MeshPart) -> Outcome<()> {
    let (up, scale) = (job.options.up, job.options.scale);
    let turn = |v: Vec3| if up == Up::Z { Vec3::new(v.x, v.z, -v.y) } else { v };
    piece.points.iter_mut().for_each(|p| *p = turn(*p) * scale);
    piece.normals.iter_mut().for_each(|n| *n = turn(*n));
    if piece.points.iter().all(|p| p.is_finite()) {
        Ok(())
    } else {
        Err(job.inside("X001", format_args!("{}: a vertex is not finite after scaling by {scale}", piece.place)))
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
fn fill_normals(piece: &mut MeshPart) {
    let given = piece.normals.len() == piece.points.len();
    let is_unit = |n: &Vec3| n.length_squared() > 1e-12;
    if given && piece.normals.iter().all(is_unit) {
        piece.normals.iter_mut().for_each(|n| *n = n.normalize());
        return;
    }
    let mut places: LookupMap<[u32; 3], usize> = LookupMap::default();
    let mut place_of = Vec::with_capacity(piece.points.len());
    for p in &piece.points {
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
    for t in &piece.triangles {
        let area = double_area(&piece.points, *t);
        for i in t {
            if let Some(sum) = place_of.get(*i as usize).and_then(|p| sums.get_mut(*p)) {
                *sum += area;
            }
        }
    }
    let computed = place_of.iter().map(|p| sums.get(*p).copied().unwrap_or_default());
    let pick = |(i, sum): (usize, Vec3)| {
        let own = piece.normals.get(i).filter(|n| given && is_unit(n)).copied().unwrap_or(sum);
        // Areas of small leaves are far below the length that counts as none.
        let largest = own.abs().max_element();
        math::normalize_or(if largest > 0.0 { own / largest } else { own }, Vec3::Y)
    };
    piece.normals = computed.enumerate().map(pick).collect();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_smooth_across_doubled_points() {
        let corner = Vec3::new(0.0, 0.0, 1e-3);
        let mut piece = MeshPart {
            points: vec![Vec3::ZERO, Vec3::X * 1e-3, corner, Vec3::ZERO, corner, Vec3::Y * 1e-3],
            triangles: vec![[0, 2, 1], [3, 5, 4]],
            ..MeshPart::default()
        };
        fill_normals(&mut piece);
        let ridge = Vec3::new(1.0, 1.0, 0.0).normalize();
        assert!((piece.normals[0] - ridge).length() < 1e-6 && (piece.normals[3] - ridge).length() < 1e-6);
        assert!((piece.normals[1] - Vec3::Y).length() < 1e-6 && (piece.normals[5] - Vec3::X).length() < 1e-6);
    }
}
