//! Meshes and materials of buildings: walls, and houses with gable roof and windows. Dimensions are those of common
//! dwelling houses.
//!
//! ```
//! use glam::Vec3;
//! use osier_plants::surface::masonry::{MATERIAL_COUNT, masonry, materials};
//! use osier_scene::solid::Prism;
//!
//! let wall = Prism::block(Vec3::ZERO, Vec3::new(0.3, 2.0, 6.0), 0.0);
//! assert_eq!(masonry(&wall, 0).subsets.len(), 1);
//! assert_eq!(materials("shed", [0.5; 3], [0.3; 3]).len(), MATERIAL_COUNT as usize);
//! ```

use glam::{Vec2, Vec3};

use super::pixels::next_index;
use osier_scene::solid::{Form, Prism, Solid};
use osier_scene::{Material, MaterialClass, MaterialId, Mesh, Subset};

/// Overhang of a roof beyond its walls, and its thickness, m.
const EAVES: f32 = 0.35;
const ROOF_THICKNESS: f32 = 0.16;
/// Windows: width and height; distance of the centres of neighbours; height of a storey; height of a sill, m.
const WINDOW: Vec2 = Vec2::new(1.0, 1.35);
const WINDOW_SPACING: f32 = 2.4;
const STOREY_HEIGHT: f32 = 2.8;
const SILL_HEIGHT: f32 = 0.95;
/// Width of a frame; distances of frame and pane in front of the wall, which keep the faces from being coplanar, m.
const FRAME_WIDTH: f32 = 0.09;
const WINDOW_OFFSETS: [f32; 2] = [0.015, 0.02];

/// Number of materials of a building, in the order of [`materials`]; [`masonry`] takes the id of the first.
pub const MATERIAL_COUNT: u32 = 4;

/// Materials `<name>_wall`, `<name>_roof`, `<name>_trim` (window frames) and `<name>_pane`, without images. `wall`, `roof`:
/// linear colours.
pub fn materials(name: &str, wall: [f32; 3], roof: [f32; 3]) -> [Material; 4] {
    let plain = |what: &str, color, roughness| {
        Material::plain(format!("{name}_{what}"), MaterialClass::Ground, color, roughness)
    };
    // Trim is a lighter shade of the wall.
    let trim = wall.map(|c| (c * 1.25 + 0.15).min(0.85));
    [
        plain("wall", wall, 0.9),
        plain("roof", roof, 0.75),
        plain("trim", trim, 0.6),
        plain("pane", [0.03, 0.045, 0.06], 0.12),
    ]
}

/// Mesh of a solid in the world, m; one that stands at y = 0 or lower has no lower face. A prism with a gable gets an overhanging
/// roof and windows. `first`: the first of its four materials.
pub fn masonry(prism: &Prism, first: MaterialId) -> Mesh {
    let [near, far] = prism.ends();
    let mut mesh = Mesh::default();
    let n = near.len();
    let gable = n == 5;
    // The face on the ground is left out, and with a gable the two faces below the roof's slabs. A raised solid keeps
    // its lower face, which can be seen.
    let raised = near[0].y > 0.0;
    for i in 0..n {
        let k = (i + 1) % n;
        if (i == 0 && !raised) || (gable && (i == 2 || i == 3)) {
            continue;
        }
        push_quad(&mut mesh, [near[k], far[k], far[i], near[i]]);
    }
    for (end, flip) in [(&near, true), (&far, false)] {
        let mut outline = end.clone();
        if flip {
            outline.reverse();
        }
        push_polygon(&mut mesh, &outline);
    }
    // Roof, frames and panes are appended after the walls; each subset ends at the number of triangles so far.
    let walls = triangle_count(&mesh);
    let mut subsets = vec![(first, walls)];
    if gable {
        push_roof(&mut mesh, &near, &far);
        subsets.push((first + 1, triangle_count(&mesh)));
        for (slot, border, offset) in [(2, FRAME_WIDTH, WINDOW_OFFSETS[0]), (3, 0.0, WINDOW_OFFSETS[1])] {
            push_windows(&mut mesh, prism, border, offset);
            subsets.push((first + slot, triangle_count(&mesh)));
        }
    }
    // Subsets in order: walls, roof, frames, panes; empty ones are left out.
    let mut from = 0;
    for (material, end) in subsets {
        if end > from {
            mesh.subsets.push(Subset { material, first: from, count: end - from });
        }
        from = end;
    }
    mesh
}

/// The roof slabs of a house, which overhang its walls, as obstacles with the shape that [`masonry`] shows. Empty for
/// other solids.
pub fn roof_solids(solid: &Solid) -> Vec<Solid> {
    let Form::Prism(prism) = &solid.form else { return Vec::new() };
    let slab = |form: Prism| Solid { form: Form::Prism(form), ..solid.clone() };
    prism.roof_slabs(EAVES, ROOF_THICKNESS).into_iter().map(slab).collect()
}

/// Number of triangles so far, the end of a subset.
#[allow(clippy::cast_possible_truncation, reason = "a house has some thousand triangles")]
fn triangle_count(mesh: &Mesh) -> u32 {
    mesh.triangles.len() as u32
}

/// Appends a flat convex polygon, counter-clockwise from outside, with points that no other face shares.
fn push_polygon(mesh: &mut Mesh, outline: &[Vec3]) {
    let base = next_index(mesh);
    // Texture coordinates are metres along the horizontal and up the face, so that masonry maps keep their scale.
    let normal = osier_base::geometry::newell(outline).normalize_or(Vec3::Y);
    let along = Vec3::Y.cross(normal).normalize_or(Vec3::X);
    let up = normal.cross(along);
    for p in outline {
        mesh.points.push(*p);
        mesh.normals.push(normal);
        mesh.uvs.push(Vec2::new(p.dot(along), p.dot(up)));
    }
    for (i, _) in (2..).zip(outline.iter().skip(2)) {
        mesh.triangles.push([base, base + i - 1, base + i]);
    }
}

fn push_quad(mesh: &mut Mesh, corners: [Vec3; 4]) {
    push_polygon(mesh, &corners);
}

/// Appends two slabs that meet at the ridge. `near`, `far`: the outlines of both ends, from [`Prism::ends`].
fn push_roof(mesh: &mut Mesh, near: &[Vec3], far: &[Vec3]) {
    let width = (near[0] - far[0]).normalize_or(Vec3::X) * EAVES;
    for (eave, flip) in [(2, false), (4, true)] {
        let ridge = [near[3] + width, far[3] - width];
        // Each slab runs from the ridge past the eave, and past both gables, by the overhang.
        let down = (near[eave] - near[3]).normalize_or(Vec3::X);
        let out = |p: Vec3| p + down * EAVES;
        let low = [out(near[eave]) + width, out(far[eave]) - width];
        let normal = (ridge[1] - ridge[0]).cross(low[0] - ridge[0]).normalize_or(Vec3::Y);
        let thickness = normal * if normal.y < 0.0 { -ROOF_THICKNESS } else { ROOF_THICKNESS };
        // The tiles lie on the surface of the solid, on which vines grow and seeds lie, but a little above the edge of
        // the gable to avoid coplanar faces.
        let top = [ridge[0], ridge[1], low[1], low[0]].map(|p| p + thickness * 0.03);
        let bottom = top.map(|p| p - thickness);
        let sides = [[0, 1], [1, 2], [2, 3], [3, 0]].map(|[i, k]| [bottom[i], bottom[k], top[k], top[i]]);
        let under = [bottom[3], bottom[2], bottom[1], bottom[0]];
        for corners in [top, under].into_iter().chain(sides) {
            let mut c = corners;
            if flip {
                c.reverse();
            }
            push_quad(mesh, c);
        }
    }
}

/// Appends rectangles of windows enlarged by `border`, at a distance of `offset` in front of both walls below the eaves, m.
fn push_windows(mesh: &mut Mesh, prism: &Prism, border: f32, offset: f32) {
    for side in &prism.sides()[..2] {
        let (wide, high) = (side.along.length(), side.down.length());
        let (along, up) = (side.along / wide, -side.down / high);
        // As many columns and storeys as fit; columns are centred on the wall.
        let (columns, storeys) =
            (((wide - 0.6) / WINDOW_SPACING).floor(), ((high - SILL_HEIGHT - WINDOW.y) / STOREY_HEIGHT).floor() + 1.0);
        let mut storey = 0.0;
        while storey < storeys {
            let mut column = 0.0;
            while column < columns {
                let x = wide / 2.0 + (column - (columns - 1.0) / 2.0) * WINDOW_SPACING;
                let y = SILL_HEIGHT + storey * STOREY_HEIGHT + WINDOW.y / 2.0;
                let middle = side.corner + side.down + along * x + up * y + side.normal * offset;
                let (a, b) = (along * (WINDOW.x / 2.0 + border), up * (WINDOW.y / 2.0 + border));
                push_quad(mesh, [middle - a - b, middle + a - b, middle + a + b, middle - a + b]);
                column += 1.0;
            }
            storey += 1.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every face looks out: a step along its normal leads away from the solid.
    #[test]
    fn faces_look_outwards() {
        let foot = Vec3::new(2.0, 0.0, 1.0);
        for prism in [
            Prism::block(foot, Vec3::new(0.3, 3.0, 9.0), 0.6),
            Prism::house(foot, Vec3::new(9.0, 5.6, 7.0), 2.5, 0.6),
            Prism::block(foot + Vec3::Y * 3.0, Vec3::new(4.0, 0.3, 5.0), 0.6),
        ] {
            let mesh = masonry(&prism, 0);
            let ridge = prism.ends()[0][3];
            // Only the raised block has a face below.
            let lowest = mesh.normals.iter().fold(0.0_f32, |low, n| low.min(n.y));
            assert_eq!(lowest < -0.99, prism.ends()[0][0].y > 0.0, "{lowest}");
            let solid = osier_scene::solid::Solid {
                name: String::new(),
                form: osier_scene::solid::Form::Prism(prism),
                humidity: 0.0,
            };
            let counted: u32 = mesh.subsets.iter().map(|s| s.count).sum();
            assert_eq!(counted as usize, mesh.triangles.len());
            for t in mesh.subset_triangles(&mesh.subsets[0]) {
                let p = t.map(|i| mesh.points[i as usize]);
                let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize();
                assert!(normal.dot(mesh.normals[t[0] as usize]) > 0.99);
                let middle = (p[0] + p[1] + p[2]) / 3.0;
                assert!(solid.nearest(middle + normal * 0.05).distance > 0.02, "{middle} {normal}");
            }
            // Slabs of a roof are closed: their volume counts positive where all their faces look out.
            for roof in mesh.subsets.iter().filter(|s| s.material == 1) {
                let corner = |i: u32| mesh.points[i as usize] - foot;
                let volume = |t: &[u32; 3]| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0;
                let whole: f32 = mesh.subset_triangles(roof).iter().map(volume).sum();
                let slabs = 2.0 * (9.0 + 2.0 * EAVES) * (Vec2::new(3.5, 2.5).length() + EAVES) * ROOF_THICKNESS;
                assert!((whole - slabs).abs() < 1e-2 * slabs, "{whole} {slabs}");
                // Their upper faces, the only ones that look up by more than 45 degrees, lie half a centimetre above the solid.
                let upper =
                    mesh.subset_triangles(roof).iter().map(|t| t[0] as usize).filter(|i| mesh.normals[*i].y > 0.71);
                let above: Vec<f32> = upper.map(|i| (mesh.points[i] - ridge).dot(mesh.normals[i])).collect();
                assert!(
                    above.len() == 4 && above.iter().all(|d| (d - 0.03 * ROOF_THICKNESS).abs() < 1e-4),
                    "{above:?}"
                );
            }
        }
    }
}
