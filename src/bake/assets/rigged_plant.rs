//! Plants at rest with joints on their branches, for formats whose readers simulate the wind.

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::material_set::PlantMaterials;
use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::assets::plant_mesh::{bark_mesh, group_organs, leaf_instancer, organ_instancer_motion};
use crate::bake::wind::plant_wind::wood_params;
use crate::recipe::PlantRecipe;
use osier_base::Result;
use osier_base::convert::to_usize;
use osier_base::neighbours::NeighbourGrid;
use osier_motion::sway::{BeamElements, JointBudget, JointRig, WoodParams};
use osier_scene::plant::Plant;
use osier_scene::{Asset, ClipChange, MeshMotion, MeshObject, RiggedPlant, SkinWeights};

/// Edge of the cells in which leaves are searched, m: about the length of a stalk.
const STALK_LENGTH: f32 = 0.05;
/// Distance from a point of a stalk at which the search for its leaf ends, m.
const STALK_REACH: f32 = 3.0;

/// Builds the rig of a grown plant: at most `joints` joints, placed and measured as those of the sway model, even where another
/// model moves the plant in this scene. `asset`: the plant as the scene shows it, from which a plant on rods takes the meshes
/// of its stalks.
/// # Errors
/// `Limit` for the skin's vertices, `TooMany`.
pub(crate) fn build_rigged_plant(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    materials: &PlantMaterials,
    asset: &Asset,
    joints: u32,
    context: &BakeContext<'_>,
) -> Result<RiggedPlant> {
    context.cancel.check()?;
    let plant = &grown.plant;
    let joints = to_usize(joints);
    // Each element needs a joint, so that the number of elements is limited to that of joints. Branches without an element
    // still add to the load.
    let wood = WoodParams { measured: true, ..wood_params(&recipe.wood) };
    let elements = BeamElements::build(plant, &wood, joints);
    let rig = JointRig::build(plant, &elements, JointBudget { joints, coarse: false });
    let (mesh, bindings) = bark_mesh(grown, recipe, materials, context)?;
    let skin = Some(rig.skin(plant, bindings.iter().copied()));
    let mut meshes = vec![MeshObject { name: "bark".into(), mesh, motion: MeshMotion::Skinned, skin }];
    // A plant on rods has the meshes of its stalks after the bark; other plants have stalks in the prototypes of their leaves.
    if recipe.rods.is_some() {
        let bound = |stalks: &MeshObject| MeshObject {
            skin: Some(skin_of_nearest_leaves(plant, &rig, &stalks.mesh.points)),
            motion: MeshMotion::Skinned,
            ..stalks.clone()
        };
        meshes.extend(asset.meshes.iter().skip(1).map(bound));
    }
    let instancers = group_organs(plant, materials)
        .iter()
        .map(|(o, organs)| leaf_instancer(plant, materials, *o, organs, organ_instancer_motion(organs, Some(&rig))))
        .collect::<Result<_>>()?;
    let branches = rig.branches(plant, &elements);
    Ok(RiggedPlant { branches, skeleton: rig.skeleton, meshes, instancers, change: ClipChange::None })
}

/// Binds each point with weight 1 to the joint of the leaf whose pivot is nearest. `points`: points of stalks, plant space, m.
fn skin_of_nearest_leaves(plant: &Plant, rig: &JointRig, points: &[Vec3]) -> SkinWeights {
    let leaves: Vec<(Vec3, u16)> = plant.organs.iter().map(|o| (plant.organ_site(o).0, rig.organ_joint(o))).collect();
    let grid = NeighbourGrid::new(STALK_LENGTH, (0..).zip(leaves.iter().map(|l| l.0)));
    let nearest =
        |p: &Vec3| grid.nearest(*p, STALK_REACH, |i| leaves[i as usize].0).map_or(0, |i| leaves[i as usize].1);
    SkinWeights {
        joints: points.iter().map(|p| [nearest(p), 0, 0, 0]).collect(),
        weights: vec![[1.0, 0.0, 0.0, 0.0]; points.len()],
    }
}
