//! Simpler leaves: a blade of a few triangles in place of a leaf, for levels of detail and for plants with many leaves.

use glam::Vec3;

use super::simplify::{BLADE_DEVIATION, area, compact, vertices_of, with_fewer_triangles};
use osier_base::Result;
use osier_base::math::{narrow, sqrt};
use osier_scene::Mesh;

/// Least area of a simplified blade as a share of the leaf's seen area; with less, the simplified blade does not
/// represent the leaf. Edge collapse often leaves single needles of a twig of needles, or a sliver of a blade with a
/// stalk.
const LEAST_AREA: f64 = 0.5;
/// Number of triangles for which the area is not tested: blades that have fewer, such as billboards, and blades that
/// may keep as many.
const ENOUGH: usize = 16;

/// Visible area of a leaf from above, m^2: the area of its triangles, but at most the rectangle around it, for leaves
/// whose parts overlap, such as needles.
pub(super) fn seen_area(mesh: &Mesh) -> f64 {
    let size = mesh.bounds().size();
    area(mesh).min(f64::from(size.x * size.y))
}

/// A leaf of at most about `most` triangles: simplified by edge collapse, or a rhombus where that leaves too little of
/// its area. `label`: names the mesh in errors.
pub(super) fn simpler_blade(mesh: &Mesh, most: usize, label: &str) -> Result<Mesh> {
    let simple = compact(&with_fewer_triangles(mesh, most, BLADE_DEVIATION, label)?);
    let is_free = mesh.triangles.len() < ENOUGH || most >= ENOUGH;
    if is_free || area(&simple) >= LEAST_AREA * seen_area(mesh) {
        return Ok(simple);
    }
    Ok(rhombus(mesh).unwrap_or(simple))
}

/// [`simpler_blade`], enlarged about its pivot to the visible area of the leaf, by at most the factor `most_growth`.
pub(super) fn enlarged_blade(mesh: &Mesh, most: usize, most_growth: f32, label: &str) -> Result<Mesh> {
    let mut simple = simpler_blade(mesh, most, label)?;
    let factor = narrow(sqrt(seen_area(mesh) / seen_area(&simple).max(1e-12))).clamp(1.0, most_growth);
    simple.points.iter_mut().for_each(|p| *p *= factor);
    Ok(simple)
}

/// Two triangles between the base, the tip and the sides of a leaf, which lies along +Y with its upper side towards +Z.
/// Their area is at most that of the leaf. `None` for a leaf without extent. The material is the one of most of its
/// triangles.
fn rhombus(mesh: &Mesh) -> Option<Mesh> {
    let subset = mesh.subsets.iter().max_by_key(|s| s.count)?;
    let extreme = |along: Vec3| {
        let places = (0_u32..).zip(&mesh.points).map(|(i, p)| (p.dot(along), i));
        places.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, i)| i)
    };
    // Needles share few points and stand all round their twig: a rhombus that leans by 45 degrees is visible from above
    // and from the side.
    let is_round = mesh.points.len() > mesh.triangles.len() && faces_all_round(mesh);
    let across = if is_round { Vec3::new(1.0, 0.0, 1.0).normalize() } else { Vec3::X };
    // Base, right side, tip, left side: counter-clockwise seen from above.
    let corners = [extreme(Vec3::NEG_Y)?, extreme(across)?, extreme(Vec3::Y)?, extreme(-across)?];
    let mut blade = vertices_of(mesh, &corners);
    // Move base and tip to the midrib, since the last needle of a twig points aside.
    for (p, side) in blade.points.iter_mut().zip([0.0, 1.0, 0.0, 1.0]) {
        *p = if is_round { Vec3::Y * p.y + across * (side * p.dot(across)) } else { Vec3::new(side * p.x, p.y, p.z) };
    }
    blade.append_subset(subset.material, vec![[0, 1, 2], [0, 2, 3]]);
    // Move the sides towards the midrib until the area equals that of the leaf.
    let (own, whole) = (area(&blade), area(mesh));
    let inwards = narrow((whole / own.max(1e-12)).min(1.0));
    let [base, right, tip, left] = blade.points[..] else { return None };
    let along = (tip - base).normalize_or(Vec3::Y);
    for (i, side) in [(1, right), (3, left)] {
        let on_midrib = base + along * (side - base).dot(along);
        blade.points[i] = on_midrib + (side - on_midrib) * inwards;
    }
    let normal = (right - left).cross(tip - base).normalize_or(Vec3::Z);
    blade.normals = vec![normal; corners.len()];
    (own > 1e-12).then_some(blade)
}

/// Whether the triangles of a mesh face all directions: their mean normal, weighted by area, is shorter than half a
/// unit. The mean normal of a blade is longer, even if its triangles share no points, unless it is rolled up.
fn faces_all_round(mesh: &Mesh) -> bool {
    let point = |i: u32| mesh.points.get(i as usize).copied().unwrap_or_default();
    let normals = mesh.triangles.iter().map(|[a, b, c]| (point(*b) - point(*a)).cross(point(*c) - point(*a)));
    let (sum, whole) = normals.fold((Vec3::ZERO, 0.0_f32), |(sum, whole), n| (sum + n, whole + n.length()));
    sum.length() < 0.5 * whole
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A twig of 0.1 m with a hundred needles of 3.75 mm^2 to its right and left, in the plane of x and y.
    fn brush() -> Mesh {
        let mut brush = Mesh::default();
        let mut triangles = Vec::new();
        for (i, first) in (0_u8..100).zip((0_u32..).step_by(3)) {
            let (y, x) = (f32::from(i) * 0.001, if i % 2 == 0 { 0.015 } else { -0.015 });
            let foot = [Vec3::new(0.0, y, 0.0), Vec3::new(0.0, y + 0.0005, 0.0)];
            brush.points.extend([foot[0], foot[1], Vec3::new(x, y + 0.01, 0.0)]);
            triangles.push([first, first + 1, first + 2]);
        }
        brush.normals = vec![Vec3::Z; brush.points.len()];
        brush.append_subset(7, triangles);
        brush
    }

    #[test]
    fn two_triangles_stand_for_a_twig_of_needles() {
        let brush = brush();
        let whole = area(&brush);
        assert!((whole - 100.0 * 3.75e-6).abs() < 1e-8, "{whole}");
        let blade = rhombus(&brush).expect("it has an extent");
        assert_eq!((blade.triangles.len(), blade.points.len(), blade.subsets[0].material), (2, 4, 7));
        // From the foot of the first needle, at 0, to the end of the last, at 0.109; a rhombus 0.03 m wide would be larger than the needles.
        let size = blade.bounds().size();
        assert!((size.y - 0.109).abs() < 1e-6 && size.x < 0.015, "{size}");
        assert!((area(&blade) - whole).abs() < 0.02 * whole, "{}", area(&blade));
        // It leans, as needles stand all round their twig.
        assert!(blade.normals.iter().all(|n| n.x < -0.7 && n.z > 0.7), "{:?}", blade.normals);
        // Needles beside each other are seen in full, many layers of them as the rectangle around them.
        assert!((seen_area(&brush) - whole).abs() < 1e-8);
        let mut dense = Mesh::default();
        (0..20).for_each(|_| dense.append(&brush));
        assert!((seen_area(&dense) - 0.03 * 0.109).abs() < 1e-6, "{}", seen_area(&dense));
    }

    /// Twenty triangles without common points, as of a file with a normal for each face: a flat blade of 0.1 m x 0.02 m.
    #[test]
    fn a_blade_of_single_faces_stays_in_its_plane() {
        let mut blade = Mesh::default();
        let mut triangles = Vec::new();
        for (row, first) in (0_u8..10).zip((0_u32..).step_by(6)) {
            let (low, high) = (f32::from(row) * 0.01, f32::from(row) * 0.01 + 0.01);
            let [a, b, c, d] =
                [(-0.01, low), (0.01, low), (0.01, high), (-0.01, high)].map(|(x, y)| Vec3::new(x, y, 0.0));
            blade.points.extend([a, b, c, a, c, d]);
            triangles.extend([[first, first + 1, first + 2], [first + 3, first + 4, first + 5]]);
        }
        blade.append_subset(0, triangles);
        let simple = rhombus(&blade).expect("it has an extent");
        assert!(simple.normals.iter().all(|n| n.z > 0.99), "{:?}", simple.normals);
        assert!((simple.bounds().size().x - 0.02).abs() < 1e-6, "{}", simple.bounds().size());
    }

    #[test]
    fn a_leaf_keeps_half_of_its_area_however_few_triangles_it_gets() {
        let blade = simpler_blade(&brush(), 2, "a twig").expect("simplified");
        assert!(area(&blade) >= 0.45 * area(&brush()), "{}", area(&blade));
    }
}
