//! Billboards for the small branches of IFS trees seen from afar.

use std::sync::Arc;

use crate::bake::BakeContext;
use crate::bake::assets::branchlets::{branch_skin_options, branchlet_mesh};
use crate::bake::assets::ifs_tree::ifs_tree_options;
use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::skin_options::BarkTiles;
use crate::recipe::PlantRecipe;
use crate::recipe::scene::IfsTreeKeys;
use osier_base::Result;
use osier_base::par::par_map;
use osier_base::rng::{mix64, word};
use osier_ifs::stems::TreeSystem;
use osier_ifs::words;
use osier_plants::grow::ifs::{self, SubtreeBillboards, SubtreeClass, TreeOptions};
use osier_plants::grow::turtle::OrganSpec;
use osier_plants::surface::crossed_billboards::{SourceMaterials, crossed_billboards};
use osier_scene::Mesh;

/// Billboards per size of subtree where individuals vary. Own: with one, repetition shows; each costs a picture.
const VARIANTS: u32 = 3;
/// Pixels along a side of the atlas that all billboards of a plant share.
const ATLAS_SIDE: u32 = 1024;

/// Grows the subtrees that replace a tree's small branches, renders them to crossed billboards, and adds the material of these
/// to `set`, which holds the plant's other materials already. `name`: name of the organ that the billboards form.
/// # Errors
/// `Input` for a table without attractor, `Limit`, `Cancelled`.
pub fn build_billboards(
    set: &mut MaterialSet,
    plant: &PlantRecipe,
    name: &str,
    stems: &TreeSystem,
    keys: &IfsTreeKeys,
    seed: u64,
    context: &BakeContext<'_>,
) -> Result<SubtreeBillboards> {
    let base = ifs_tree_options(plant, stems, keys, set);
    let eps = (keys.eps * f64::from(1_u32 << keys.lod.min(16))).min(1.0);
    let limits = ifs::word_limits(&base, context.limits);
    // Classes of subtrees below the size at which the tree ends, each with variants; eps, the smallest stem over the tree's height, is
    // doubled with every level of detail.
    let classes = ifs::subtree_classes(stems, &limits, eps, keys.lod + 1).map_err(|d| ifs::expansion_error(*d))?;
    let variants = if keys.variation > 0.0 { VARIANTS } else { 1 };
    let scale = keys.height / words::height(&stems.system, &stems.letters, stems.trunk);
    let radius = keys.radius.unwrap_or(stems.radius * scale);
    let jobs: Vec<(SubtreeClass, u32)> = classes.iter().flat_map(|c| (0..variants).map(|v| (*c, v))).collect();
    let tiles = set.bark_tiles();
    let meshes: Vec<Mesh> = par_map(&jobs, |(class, variant)| {
        context.cancel.check()?;
        let options = TreeOptions {
            height: keys.height * class.size,
            eps: keys.eps / class.size,
            radius: Some(radius * class.radius),
            max_order: base.max_order.saturating_sub(class.order),
            ..base.clone()
        };
        // A subtree of relative size s is a tree of height s with the relative precision eps / s.
        let key = mix64(&[seed, word(&plant.name), word("card"), u64::from(*variant)]);
        subtree_mesh(stems, plant, &options, (*variant, key), tiles, context)
    })
    .into_iter()
    .collect::<Result<_>>()?;
    let material = format!("{}_{name}", plant.id);
    let (quads, surface) = crossed_billboards(
        &meshes,
        SourceMaterials { materials: &set.materials, images: &set.images },
        &material,
        ATLAS_SIDE,
    );
    let id = set.add(surface.material, surface.images)?;
    let meshes = quads.into_iter().map(|q| Arc::new(q.with_material(id))).collect();
    Ok(SubtreeBillboards {
        spec: OrganSpec { name: name.to_owned(), meshes, size: 1.0, petiole: 0.0 },
        sizes: classes.iter().map(|c| c.size).collect(),
        variants: variants as usize,
        eps,
    })
}

/// Mesh of bark and leaves of one subtree, m, with the plant's material indices. `individual`: identity and seed of the
/// variant.
fn subtree_mesh(
    stems: &TreeSystem,
    plant: &PlantRecipe,
    options: &TreeOptions,
    individual: (u32, u64),
    tiles: BarkTiles,
    context: &BakeContext<'_>,
) -> Result<Mesh> {
    let grown = ifs::grow(stems, individual, options, context.limits)?;
    branchlet_mesh(&grown, &branch_skin_options(plant, tiles, context))
}
