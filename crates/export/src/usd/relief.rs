//! Heights of the relief by which materials displace their surface.
//!
//! The maps of bark repeat a whole number of times around a branch. On wood thinner than a repeat the maps are
//! therefore smaller than on the trunk, and so is the relief that fits them. A material of USD has a single height for
//! all of its surface, so bark gets the height that fits its thin wood; the full height would make twigs several times
//! as thick.

use osier_scene::{Material, MaterialClass, Mesh, Scene};

/// Share of the area of a bark that may be thinner than the wood for which the height of its relief is right. Own:
/// ignores the thinnest tips, which are a small part of the surface.
const THINNER_SHARE: f64 = 0.1;
/// Number of classes into which the sizes of repeats are sorted. Own: down to a hundredth of the nominal size.
const CLASSES: usize = 96;
/// Ratio of the sizes of neighbouring classes.
const CLASS_RATIO: f32 = 0.95;

/// For each material of a scene the height, m, between the values 0 and 1 of its height map on its surface.
pub(crate) fn relief_heights(scene: &Scene) -> Vec<f32> {
    heights_on(&scene.materials, scene.assets.iter().flat_map(|a| &a.meshes).map(|o| &o.mesh))
}

/// The heights of materials on these meshes.
fn heights_on<'a>(materials: &[Material], meshes: impl Iterator<Item = &'a Mesh>) -> Vec<f32> {
    let sizes: Vec<f32> =
        (0..CLASSES).scan(1.0, |size, _| Some(std::mem::replace(size, *size * CLASS_RATIO))).collect();
    // Area, m^2, of each material by the size of a repeat, as a share of its nominal size; class k has shares up to
    // `sizes[k]`.
    let mut areas = vec![[0.0_f64; CLASSES]; materials.len()];
    let is_relief = |m: &Material| m.class == MaterialClass::Bark && m.maps.height.is_some() && m.tile > 0.0;
    for mesh in meshes.filter(|mesh| !mesh.uvs.is_empty()) {
        for subset in &mesh.subsets {
            let Some(material) = materials.get(subset.material as usize).filter(|m| is_relief(m)) else { continue };
            let faces = mesh.triangles.iter().skip(subset.first as usize).take(subset.count as usize);
            for (area, repeat) in faces.filter_map(|t| area_and_repeat(mesh, *t)) {
                let share = repeat / material.tile;
                let class = sizes.partition_point(|size| *size >= share).saturating_sub(1);
                areas[subset.material as usize][class] += f64::from(area);
            }
        }
    }
    let height = |(material, areas): (&Material, &[f64; CLASSES])| {
        let (all, mut thinner) = (areas.iter().sum::<f64>(), 0.0);
        // Add up classes from the smallest repeats on, until they reach their share of the area.
        let class = (0..CLASSES).rev().find(|k| {
            thinner += areas[*k];
            all > 0.0 && thinner >= THINNER_SHARE * all
        });
        material.height_range * class.map_or(1.0, |k| sizes[k])
    };
    materials.iter().zip(&areas).map(height).collect()
}

/// Area of a triangle, m^2, and length of a repeat of its maps, m; `None` without an area on the surface or in the maps.
fn area_and_repeat(mesh: &Mesh, corners: [u32; 3]) -> Option<(f32, f32)> {
    let [a, b, c] = corners.map(|i| i as usize);
    let area = 0.5 * (mesh.points[b] - mesh.points[a]).cross(mesh.points[c] - mesh.points[a]).length();
    let in_maps = 0.5 * (mesh.uvs[b] - mesh.uvs[a]).perp_dot(mesh.uvs[c] - mesh.uvs[a]).abs();
    (area > 0.0 && in_maps > 0.0).then(|| (area, (area / in_maps).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec2, Vec3};

    /// A square of `side` metres that shows one repeat of a material.
    fn square(side: f32, material: u32) -> Mesh {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Vec2::from_array);
        Mesh {
            points: corners.map(|c| Vec3::new(c.x, c.y, 0.0) * side).to_vec(),
            normals: vec![Vec3::Z; 4],
            uvs: corners.to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
        .with_material(material)
    }

    #[test]
    fn thin_wood_has_lower_relief() {
        let height = |sides: &[f32], class: MaterialClass| {
            let mut material = Material::plain("a_bark".into(), class, [0.5; 3], 0.5);
            (material.height_range, material.tile, material.maps.height) = (0.012, 0.4, Some(0));
            let mut mesh = Mesh::default();
            sides.iter().for_each(|side| mesh.append(&square(*side, 0)));
            heights_on(&[material], std::iter::once(&mesh))[0]
        };
        // The whole height where a repeat has its nominal size or more, less in proportion where it is smaller.
        assert!((height(&[0.4, 0.5], MaterialClass::Bark) - 0.012).abs() < 1e-6);
        let thin = height(&[0.1], MaterialClass::Bark);
        assert!((0.95..=1.06).contains(&(thin / 0.003)), "{thin}");
        // A hundredth of the area does not decide, half of it does.
        assert!((height(&[0.4, 0.04], MaterialClass::Bark) - 0.012).abs() < 1e-6);
        let mixed = height(&[0.4, 0.2, 0.2, 0.2, 0.2], MaterialClass::Bark);
        assert!((0.95..=1.06).contains(&(mixed / 0.006)), "{mixed}");
        // Other surfaces show maps of one size.
        assert!((height(&[0.1], MaterialClass::Ground) - 0.012).abs() < 1e-6);
    }
}
