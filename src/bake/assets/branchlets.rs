//! Meshes of the branchlets of IFS trees, wood and leaves together, which instances copy.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::skin_options::{BarkTiles, skin_options};
use crate::recipe::PlantRecipe;
use osier_base::Result;
use osier_base::par::par_map;
use osier_plants::grow::ifs::branchlets::Branchlet;
use osier_plants::surface::{SkinOptions, skin};
use osier_scene::plant::Plant;
use osier_scene::{Mesh, Trs};

/// Builds the meshes of a tree's branchlet prototypes. `tiles`: of the tree's bark.
/// # Errors
/// `Limit` for the vertices of one branchlet or of all together, `Cancelled`.
pub fn skin_branchlets(
    tree: &mut Plant,
    twigs: &[Branchlet],
    recipe: &PlantRecipe,
    tiles: BarkTiles,
    context: &BakeContext<'_>,
) -> Result<()> {
    let options = branch_skin_options(recipe, tiles, context);
    let meshes = par_map(twigs, |twig| {
        context.cancel.check()?;
        oriented_branchlet_mesh(twig, &options)
    });
    let first = tree.protos.len() - twigs.len().min(tree.protos.len());
    for (proto, mesh) in tree.protos.iter_mut().skip(first).zip(meshes) {
        proto.mesh = Arc::new(mesh?);
    }
    let points = tree.protos.iter().map(|p| p.mesh.points.len() as u64).sum();
    context.limits.check("vertices", points, "the number of vertices of the twigs of a tree")
}

/// Skin options of a plant without root flare and buried foot, for meshes of single branches.
pub(crate) fn branch_skin_options(recipe: &PlantRecipe, tiles: BarkTiles, context: &BakeContext<'_>) -> SkinOptions {
    SkinOptions { flare: 0.0, bury: 0.0, ..skin_options(&recipe.skin, tiles, context) }
}

/// The mesh of a branchlet; a mirrored one is reflected in z, and the winding of its triangles is reversed.
fn oriented_branchlet_mesh(twig: &Branchlet, options: &SkinOptions) -> Result<Mesh> {
    let mut all = branchlet_mesh(&twig.plant, options)?;
    if twig.mirrored {
        all.points.iter_mut().chain(&mut all.normals).for_each(|p| p.z = -p.z);
        all.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(all)
}

/// Merges wood and leaves into one mesh, the leaves sorted by prototype, so that each material covers one range of triangles.
pub(crate) fn branchlet_mesh(plant: &Plant, options: &SkinOptions) -> Result<Mesh> {
    let mut all = skin(plant, options)?.mesh;
    for (k, proto) in plant.protos.iter().enumerate() {
        for organ in plant.organs.iter().filter(|o| usize::from(o.proto) == k) {
            let (t, r) = plant.organ_site(organ);
            let transform = Trs { t, r, s: Vec3::splat(organ.scale) };
            let mut leaf = (*proto.mesh).clone();
            leaf.points.iter_mut().for_each(|p| *p = transform.apply(*p));
            leaf.normals.iter_mut().for_each(|n| *n = r * *n);
            append_mesh(&mut all, leaf);
        }
    }
    Ok(all)
}

/// Appends a mesh. If only one of the two has texture coordinates or vertex colours, the other gets zeros or white.
fn append_mesh(all: &mut Mesh, mut other: Mesh) {
    let has_uvs = !(all.uvs.is_empty() && other.uvs.is_empty());
    let has_colors = !(all.colors.is_empty() && other.colors.is_empty());
    for mesh in [&mut *all, &mut other] {
        let n = mesh.points.len();
        if has_uvs {
            mesh.uvs.resize(n, glam::Vec2::ZERO);
        }
        if has_colors {
            mesh.colors.resize(n, [1.0; 4]);
        }
    }
    all.append(&other);
}
