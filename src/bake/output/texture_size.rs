//! Reduces textures to the resolution at which the camera sees them.

use crate::bake::cache::ifs_leaves;
use crate::recipe::Recipe;
use osier_base::par::par_each;
use osier_scene::{Asset, Image, Material, Mesh, PixelFootprint, Scene};

/// Texels along a side that every texture keeps. Own: smaller ones save little.
const MIN_SIDE: u32 = 256;
/// Longest edge of a texel on a surface to which reduction may lead, m. Own: with it, bark keeps its pattern when the camera is
/// moved close to a plant.
const LARGEST_TEXEL: f32 = 0.002;

/// Halves the textures of a scene as often as they stay finer than the recipe's `texels_per_pixel` where the camera is nearest
/// to each surface.
pub fn limit_texture_sizes(recipe: &Recipe, scene: &mut Scene) {
    let halvings = texture_halvings(recipe, scene);
    let normals: Vec<u32> = scene.materials.iter().filter_map(|m| m.maps.normal).collect();
    let mut reduced: Vec<(u32, u32, &mut Image)> =
        (0_u32..).zip(halvings).zip(&mut scene.images).map(|((i, count), image)| (i, count, image)).collect();
    par_each(&mut reduced, |(i, count, image)| {
        for _ in 0..*count {
            **image = image.halved(normals.contains(i));
        }
    });
}

/// Number of halvings of each image of a scene; 0 for all if the key `texels_per_pixel` is 0.
pub fn texture_halvings(recipe: &Recipe, scene: &Scene) -> Vec<u32> {
    let density = osier_base::math::narrow(recipe.output.keys.texels_per_pixel);
    let mut needed = vec![0.0_f32; scene.images.len()];
    if density <= 0.0 {
        return vec![0; scene.images.len()];
    }
    let per_unit = texels_per_unit(scene, density);
    // Leaves of tables are stored at full size for the next bake; wet materials have maps of other sizes.
    let kept = ifs_leaves::material_names(recipe);
    for (material, texels) in scene.materials.iter().zip(per_unit) {
        let is_kept = material.coat.is_some() || kept.contains(&material.name);
        let texels = if is_kept { f32::INFINITY } else { texels.unwrap_or(f32::INFINITY) };
        for image in images_of(material) {
            if let Some(n) = needed.get_mut(image as usize) {
                *n = n.max(texels);
            }
        }
    }
    scene.images.iter().zip(needed).map(|(image, needed)| halvings_of(image, needed)).collect()
}

/// Number of halvings after which the longer side of an image still has `needed` texels and at least [`MIN_SIDE`].
fn halvings_of(image: &Image, needed: f32) -> u32 {
    let mut side = image.width.max(image.height);
    let mut count = 0;
    // An image that no visible surface uses has `needed` 0 and keeps its size, since its use is unknown.
    while needed > 0.0 && side / 2 >= MIN_SIDE && (side / 2) as f32 >= needed {
        side /= 2;
        count += 1;
    }
    count
}

fn images_of(material: &Material) -> impl Iterator<Item = u32> {
    let maps = material.maps;
    [maps.color, maps.normal, maps.roughness, maps.height].into_iter().flatten()
}

/// For each material the texels that its textures need along a unit of texture coordinates; `None` if no mesh with coordinates
/// has it. `density`: texels per pixel.
fn texels_per_unit(scene: &Scene, density: f32) -> Vec<Option<f32>> {
    let mut needed: Vec<Option<f32>> = vec![None; scene.materials.len()];
    for (asset, pixel) in scene.assets.iter().zip(PixelFootprint::of_assets(scene)) {
        let texel = (pixel / density).min(LARGEST_TEXEL);
        for (mesh, scale) in meshes_with_largest_scale(asset) {
            for (material, unit) in metres_per_unit(mesh) {
                if let Some(needed) = needed.get_mut(material as usize) {
                    // A pixel footprint of 0 means that the camera is at the surface: the resolution is then unlimited.
                    let texels = if texel > 0.0 { unit * scale / texel } else { f32::INFINITY };
                    *needed = Some(needed.map_or(texels, |n| n.max(texels)));
                }
            }
        }
    }
    needed
}

/// All meshes of an asset, levels of detail included, each with the largest scale at which instances show it.
fn meshes_with_largest_scale(asset: &Asset) -> Vec<(&Mesh, f32)> {
    let mut all: Vec<(&Mesh, f32)> = asset.meshes.iter().map(|m| (&m.mesh, 1.0)).collect();
    for instancer in &asset.instancers {
        let scale = instancer.scales.iter().fold(0.0_f32, |most, s| most.max(s.abs().max_element()));
        for prototype in &instancer.prototypes {
            let levels = std::iter::once(prototype).chain(&prototype.others);
            all.extend(
                levels.flat_map(|p| [Some(&p.mesh), p.fine.as_ref().map(|f| &f.mesh)]).flatten().map(|m| (m, scale)),
            );
        }
    }
    all
}

/// Length on the surface, m, of a unit of texture coordinates for each material of a mesh: the square root of the ratio of
/// areas.
fn metres_per_unit(mesh: &Mesh) -> Vec<(u32, f32)> {
    if mesh.uvs.len() != mesh.points.len() {
        return mesh.subsets.iter().map(|s| (s.material, f32::INFINITY)).collect();
    }
    let one = |subset: &osier_scene::Subset| {
        let (mut area, mut flat) = (0.0_f64, 0.0_f64);
        for t in mesh.subset_triangles(subset) {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            // Both sums are twice the areas of the triangles; the factor cancels in their ratio.
            area += f64::from((b - a).cross(c - a).length());
            let [a, b, c] = t.map(|i| mesh.uvs[i as usize]);
            flat += f64::from((b - a).perp_dot(c - a).abs());
        }
        // Faces without area in texture space would need unlimited resolution.
        let unit = if flat > 0.0 { osier_base::math::narrow((area / flat).sqrt()) } else { f32::INFINITY };
        (subset.material, unit)
    };
    mesh.subsets.iter().filter(|s| s.count > 0).map(one).collect()
}
