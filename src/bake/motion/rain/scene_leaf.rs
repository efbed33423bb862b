//! The leaf blades of a scene on which rain falls.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::plant_in_rain::PlantInRain;
use crate::bake::scene::camera_light::ScreenScale;
use crate::recipe::Recipe;
use osier_base::convert::to_usize;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::math::narrow;
use osier_motion::rain::{AlphaMask, LeafCollider, LeafSurface, VeinMap};
use osier_scene::{Asset, AssetFrame, Image, InstancerFrame, InstancerMotion, Material, Trs};

/// Name of the attribute of leaves and drops that holds the share of the surface that is wet, 0 to 1.
pub(super) const WETNESS: &str = "wetness";

/// Indices of one instance of a plant's leaf instancer within the assets of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct LeafInstanceIndex {
    pub(crate) asset: usize,
    pub(crate) instancer: usize,
    pub(crate) instance: usize,
}

/// A leaf blade of the scene at rest, with the surface on which drops lie.
pub(crate) struct SceneLeaf {
    pub(crate) instance: LeafInstanceIndex,
    /// The blade in leaf space; instances of one prototype share it.
    pub(crate) surface: Arc<LeafSurface>,
    pub(super) collider: Arc<LeafCollider>,
    /// Number of the leaf on its plant: the index of its organ on a plant on rods, otherwise counted in order.
    pub(super) number: usize,
    /// The joint that the leaf follows; `None` for a leaf of a still plant.
    pub(crate) joint: Option<u16>,
    /// Whether the leaf moves relative to its joint, so that frames carry its position and orientation.
    pub(crate) moves_off_joint: bool,
    /// Pivot in the world, m.
    pub(super) position: DVec3,
    /// World from leaf space.
    pub(super) rotation: DQuat,
    pub(super) scale: f64,
}

/// Collects every leaf blade of the scene, plant by plant. `transforms`: transform of each plant's first copy, parallel to
/// `assets`. Prototypes whose triangles have no area carry no drops.
pub(super) fn scene_leaves(
    assets: &[Asset],
    materials: &[Material],
    images: &[Image],
    transforms: &[Trs],
    plant_motions: &[PlantInRain],
    report: &mut Report,
) -> Vec<SceneLeaf> {
    let mut leaves = Vec::new();
    for (a, (asset, transform)) in assets.iter().zip(transforms).enumerate() {
        let motion = plant_motions.get(a);
        let rods = motion.and_then(PlantInRain::rods);
        let moves_off_joint = motion.is_some_and(PlantInRain::moves_by_sway_model);
        let mut count = 0;
        for (i, instancer) in asset.instancers.iter().enumerate() {
            // Surface and collider of each prototype: alpha maps give the outline of the blade, height maps its veins.
            let prototypes: Vec<Option<(Arc<LeafSurface>, Arc<LeafCollider>)>> = instancer
                .prototypes
                .iter()
                .map(|p| {
                    let alpha = AlphaMask::of_first_mapped_material(&p.mesh, materials, images);
                    let veins = VeinMap::of_first_mapped_material(&p.mesh, materials, images);
                    let surface = LeafSurface::new(&p.mesh);
                    chart_diagnostic(&asset.id, &p.name, surface.as_ref()).into_iter().for_each(|d| report.push(d));
                    let surface = Arc::new(surface?.with_maps(alpha, veins));
                    let collider = Arc::new(LeafCollider::new(&surface));
                    Some((surface, collider))
                })
                .collect();
            for k in 0..instancer.len() {
                let Some(Some((surface, collider))) = prototypes.get(to_usize(instancer.protos[k])) else { continue };
                // World from leaf: the plant's placement applied after the leaf's transform on the plant.
                let trs = transform.then_inner(&instancer.transform(&instancer.rest, k));
                let organ = rods.and_then(|(_, binding)| binding.leaf_groups().get(i)?.get(k).copied());
                let joint = match (&instancer.motion, rods.zip(organ)) {
                    (_, Some(((rods, binding), organ))) => Some(binding.leaf_joint(rods, organ)),
                    (InstancerMotion::Joints(joints), None) if moves_off_joint => joints.get(k).copied(),
                    _ => None,
                };
                let number = organ.unwrap_or(count);
                count += 1;
                leaves.push(SceneLeaf {
                    number,
                    joint,
                    moves_off_joint,
                    instance: LeafInstanceIndex { asset: a, instancer: i, instance: k },
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

/// Diagnostic for a blade whose texture coordinates cannot serve as the chart of its water (X022), or that has no area (X023).
fn chart_diagnostic(plant: &str, leaf: &str, surface: Option<&LeafSurface>) -> Option<Diagnostic> {
    let mend = "give the leaf texture coordinates from 0 to 1 in which no two of its parts overlap and none is cut";
    let Some(surface) = surface else {
        let text = format!("plant {plant}: rain falls through leaf {leaf}, whose mesh has no triangle with an area");
        return Some(Diagnostic::about("X023", text).help("take a mesh whose triangles are a blade"));
    };
    let chart = surface.chart()?;
    let mut text = format!(
        "plant {plant}: texture coordinates of leaf {leaf} {}; its water has a chart of its own, over which the textures \
         of leaves with maps are drawn anew",
        chart.fault.words()
    );
    if chart.cuts > 0 {
        text = format!("{text}, in pieces: {} cuts act on drops like margins", chart.cuts);
    }
    Some(Diagnostic::about("X022", text).help(mend))
}

/// A leaf selected for water maps, with their resolution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SelectedLeaf {
    /// Index into the scene's list of [`SceneLeaf`].
    pub(crate) leaf: usize,
    /// Texels along a side of its maps.
    pub(crate) side: usize,
}

/// Smallest side of a map, texels. Own: the smallest value of the key; smaller files would contain little more than their header.
const MIN_MAP_SIDE: usize = 32;

/// The leaves nearest to the camera, at most `maps.max_mapped_leaves`, in the order of the scene.
pub(super) fn select_mapped_leaves(recipe: &Recipe, leaves: &[SceneLeaf], picture: &ScreenScale) -> Vec<SelectedLeaf> {
    let mut order: Vec<usize> = (0..leaves.len()).collect();
    let distance = |leaf: usize| picture.distance(leaves[leaf].position);
    order.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)).then(a.cmp(b)));
    // Restore the order of the scene, so that names do not depend on the camera.
    order.truncate(to_usize(recipe.maps.max_mapped_leaves));
    order.sort_unstable();
    order.into_iter().map(|leaf| SelectedLeaf { leaf, side: map_side(recipe, &leaves[leaf], picture) }).collect()
}

/// Side of a leaf's maps, texels: its size in the camera's picture times the key `texels_per_pixel`, rounded up to a power of
/// two, at most `maps.resolution`.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating, and clamped")]
fn map_side(recipe: &Recipe, leaf: &SceneLeaf, picture: &ScreenScale) -> usize {
    let pixels = leaf.surface.metres_per_chart_side() * leaf.scale * picture.pixels_per_metre(leaf.position);
    let wanted = (pixels * recipe.maps.texels_per_pixel).ceil() as usize;
    let largest = to_usize(recipe.maps.resolution);
    wanted.clamp(MIN_MAP_SIDE, largest).next_power_of_two().min(largest)
}

/// Writes the wetness of all leaves, 0..1, as instance attributes into the last frame of each plant.
pub(super) fn set_leaf_wetness(plants: &mut [Vec<AssetFrame>], leaves: &[SceneLeaf], wetness: &[f64]) {
    for (leaf, wetness) in leaves.iter().zip(wetness) {
        let LeafInstanceIndex { asset, instancer, instance } = leaf.instance;
        let frame = plants.get_mut(asset).and_then(|frames| frames.last_mut());
        if let Some(InstancerFrame::State(state)) = frame.and_then(|f| f.instancers.get_mut(instancer))
            && let Some(value) = state.unit_attribute_mut(WETNESS).get_mut(instance)
        {
            *value = narrow(*wetness);
        }
    }
}
