//! The leaf blades of a scene, on which rain falls.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::bake::assets::plants::RainedRods;
use crate::recipe::Recipe;
use osier_base::convert::to_usize;
use osier_base::math::narrow;
use osier_motion::rain::{AlphaMask, LeafCollider, LeafSurface, VeinMap};
use osier_scene::{Asset, AssetFrame, Image, InstancerFrame, Material, Trs};

/// Attribute of leaves and drops: share of the surface that is wet, 0 to 1.
pub(super) const WETNESS: &str = "wetness";

/// An instance of a plant's leaf instancer, by its indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct LeafInstance {
    pub(crate) asset: usize,
    pub(crate) instancer: usize,
    pub(crate) instance: usize,
}

/// A leaf blade of the scene, at rest.
pub(crate) struct SceneLeaf {
    pub(crate) instance: LeafInstance,
    /// The blade in its own space; instances of one prototype share it.
    pub(crate) surface: Arc<LeafSurface>,
    pub(super) collider: Arc<LeafCollider>,
    /// Number of the leaf on its plant: the index of its organ on a plant on rods, else counted in order.
    pub(super) number: usize,
    /// The joint that the leaf rides on, for a plant on rods.
    pub(crate) joint: Option<u16>,
    /// Pivot in the world, m.
    pub(super) position: DVec3,
    /// World from leaf space.
    pub(super) rotation: DQuat,
    pub(super) scale: f64,
}

/// Collects every leaf blade of the scene, plant by plant. `transforms`: of each plant's first copy, parallel to `assets`.
/// Prototypes without texture coordinates carry no drops.
pub(super) fn scene_leaves(
    assets: &[Asset],
    materials: &[Material],
    images: &[Image],
    transforms: &[Trs],
    plant_rods: &[RainedRods],
) -> Vec<SceneLeaf> {
    let mut leaves = Vec::new();
    for (a, (asset, transform)) in assets.iter().zip(transforms).enumerate() {
        let rods = plant_rods.get(a).and_then(Option::as_ref);
        let mut count = 0;
        for (i, instancer) in asset.instancers.iter().enumerate() {
            // Surface and collider of each prototype: alpha and height maps tell where blade and veins are.
            let prototypes: Vec<Option<(Arc<LeafSurface>, Arc<LeafCollider>)>> = instancer
                .prototypes
                .iter()
                .map(|p| {
                    let alpha = AlphaMask::of_mesh_materials(&p.mesh, materials, images);
                    let veins = VeinMap::of_mesh_materials(&p.mesh, materials, images);
                    let surface = Arc::new(LeafSurface::new(&p.mesh)?.with_maps(alpha, veins));
                    let collider = Arc::new(LeafCollider::new(&surface));
                    Some((surface, collider))
                })
                .collect();
            for k in 0..instancer.len() {
                let Some(Some((surface, collider))) = prototypes.get(to_usize(instancer.protos[k])) else { continue };
                let trs = transform.then_inner(&instancer.transform(&instancer.rest, k));
                let organ = rods.and_then(|(_, binding)| binding.leaf_groups().get(i)?.get(k).copied());
                let joint = rods.zip(organ).map(|((rods, binding), organ)| binding.leaf_joint(rods, organ));
                let number = organ.unwrap_or(count);
                count += 1;
                leaves.push(SceneLeaf {
                    number,
                    joint,
                    instance: LeafInstance { asset: a, instancer: i, instance: k },
                    surface: Arc::clone(surface),
                    collider: Arc::clone(collider),
                    position: trs.t.as_dvec3(),
                    rotation: trs.r.as_dquat().normalize(),
                    scale: f64::from(trs.s.x),
                });
            }
        }
    }
    leaves
}

/// Leaves that get maps, in the order of the scene: the nearest to the scene's camera, or the first without its position.
pub(super) fn select_mapped_leaves(recipe: &Recipe, leaves: &[SceneLeaf]) -> Vec<usize> {
    let max_leaves = to_usize(recipe.maps.max_mapped_leaves);
    let mut order: Vec<usize> = (0..leaves.len()).collect();
    if let Some(eye) = recipe.camera.eye {
        let eye = DVec3::from_array(eye);
        order.sort_by(|a, b| {
            leaves[*a].position.distance(eye).total_cmp(&leaves[*b].position.distance(eye)).then(a.cmp(b))
        });
    }
    order.truncate(max_leaves);
    order.sort_unstable();
    order
}

/// Writes the wetness of all leaves into the last frame of each plant.
pub(super) fn set_leaf_wetness(plants: &mut [Vec<AssetFrame>], leaves: &[SceneLeaf], wetness: &[f64]) {
    for (leaf, wetness) in leaves.iter().zip(wetness) {
        let LeafInstance { asset, instancer, instance } = leaf.instance;
        let frame = plants.get_mut(asset).and_then(|frames| frames.last_mut());
        if let Some(InstancerFrame::State(state)) = frame.and_then(|f| f.instancers.get_mut(instancer))
            && let Some(value) = state.unit_attribute_mut(WETNESS).get_mut(instance)
        {
            *value = narrow(*wetness);
        }
    }
}
