//! Builds the asset of a grown plant: bark mesh, leaf instancers, joints, and its sway in the wind.

use std::collections::BTreeMap;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::material_set::PlantMaterials;
use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::assets::segments::segment_instancer;
use crate::bake::assets::skin_options::{GROWTH_CONES, skin_options};
use crate::bake::assets::turtle_colors::paint_axes;
use crate::bake::motion::sway::{FlutterGroup, SwayMotion, SwaySurface};
use crate::bake::scene::plant_layout::{Individual, PlantLayout};
use crate::bake::wind::plant_wind::PlantWind;
use crate::recipe::scene::{BarkMotion, SkinForm};
use crate::recipe::{Growth, PlantRecipe, Recipe};
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_motion::sway::{JointRig, WindWeights};
use osier_plants::surface::skin;
use osier_scene::plant::{Organ, Plant};
use osier_scene::{
    Asset, AssetKind, InstanceState, Instancer, InstancerMotion, Mesh, MeshMotion, MeshObject, Prototype, SkinWeights,
    Trs,
};

/// Marks the plants whose copies glTF may show without a skeleton: those with more than one copy, where all copies together
/// need more skins than `output.gltf.skins` allows; and all plants if `output.gltf.channels` asks for vertex colours. Their bark
/// gets the attributes by which a shader sways it.
pub(crate) fn choose_shader_wind(recipe: &Recipe, layout: &PlantLayout, materials: &mut [PlantMaterials]) {
    let written = recipe.output.writes(&osier_export::gltf::FORMAT);
    let beyond_skins = layout.instances.len() > to_usize(recipe.output.gltf.skins);
    let mut copies = vec![0_usize; materials.len()];
    for plant in layout.instances.iter().filter_map(|s| layout.individuals.get(s.individual)).map(|i| i.plant) {
        copies.get_mut(plant).into_iter().for_each(|n| *n += 1);
    }
    // Vertex colours for the shaders of engines are made from the same attributes.
    let colored = written && !recipe.output.gltf.channels.is_empty();
    for (materials, n) in materials.iter_mut().zip(copies) {
        materials.shader_wind = colored || (written && beyond_skins && recipe.moves && n > 1);
    }
}

/// Builds the asset of a grown plant and, with a wind, its sway. `wind`: the wind and the world transform of the plant's first
/// copy.
/// # Errors
/// `Limit` for the skin's vertices or the motion's keys, `Simulation`, `Cancelled`.
pub fn build_plant_asset(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    materials: &PlantMaterials,
    individual: &Individual,
    wind: Option<(&PlantWind, Trs)>,
    context: &BakeContext<'_>,
) -> Result<(Asset, Option<SwayMotion>)> {
    let built = build_bound_plant(grown, recipe, materials, individual, wind, context)?;
    Ok((built.asset, built.sway))
}

/// The asset of a plant, its sway, and the binding of its bark to the axes.
pub(crate) struct BoundPlant {
    pub(crate) asset: Asset,
    pub(crate) sway: Option<SwayMotion>,
    /// Axis and arc length, m, of each point of the bark.
    pub(crate) bindings: Vec<(u32, f32)>,
}

/// As [`build_plant_asset`], and returns the bindings of the bark, by which motions of growth find its points.
/// # Errors
/// As [`build_plant_asset`].
pub(crate) fn build_bound_plant(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    materials: &PlantMaterials,
    individual: &Individual,
    wind: Option<(&PlantWind, Trs)>,
    context: &BakeContext<'_>,
) -> Result<BoundPlant> {
    context.cancel.check()?;
    let plant = &grown.plant;
    // The bark's points are bound to axes and arc lengths, by which the sway model finds their elements.
    let by_segments = is_shown_by_segments(grown, recipe);
    let (mut mesh, bindings) =
        if by_segments { Default::default() } else { bark_mesh(grown, recipe, materials, context)? };
    let groups = group_organs(plant, materials);
    // For engines, leaves are merged into one mesh per organ with attributes for a wind shader; else each is an instance.
    let shaded = matches!(recipe.keys.motion, BarkMotion::Game | BarkMotion::Static);
    let wind = wind.filter(|_| !matches!(recipe.keys.motion, BarkMotion::Still | BarkMotion::Static));
    let sway = match wind {
        Some((wind, transform)) => {
            let params = wind.sway_params(&recipe.wood, transform);
            let instanced = groups.iter().filter(|_| !shaded);
            let leaves: Vec<FlutterGroup> =
                instanced.map(|(o, organs)| FlutterGroup::from_recipe(recipe, *o, organs)).collect();
            let surface = SwaySurface { points: &mesh.points, bindings: &bindings, leaves: &leaves };
            Some(SwayMotion::new(plant, &recipe.keys, wind, params, &surface, context)?)
        }
        None => None,
    };
    let rig = sway.as_ref().map(|m| &m.rig);
    // The bark follows joints by skinning, or its points are written frame by frame (`motion = "cache"`).
    let motion = match (rig, recipe.keys.motion) {
        (None, _) | (_, BarkMotion::Still | BarkMotion::Static) => MeshMotion::Still,
        (Some(_), BarkMotion::Skin | BarkMotion::Game) => MeshMotion::Skinned,
        (Some(_), BarkMotion::Cache) => MeshMotion::Deforming,
    };
    let weights = rig.map(|r| r.skin(plant, bindings.iter().copied()));
    let instanced = groups.iter().filter(|_| !shaded);
    let mut instancers: Vec<Instancer> = instanced
        .map(|(o, organs)| leaf_instancer(plant, materials, *o, organs, organ_instancer_motion(organs, rig)))
        .collect::<Result<_>>()?;
    if by_segments {
        instancers.push(segment_instancer(plant, materials, grown.segment.as_ref(), rig)?);
    }
    let mut merged = Vec::new();
    if shaded || materials.shader_wind {
        // Vertex attributes by which a shader sways the bark without joints.
        mesh.attributes = WindWeights::new(plant).bark(&bindings);
    }
    if shaded {
        let attributes = WindWeights::new(plant);
        merged =
            groups.iter().map(|(o, organs)| merged_leaves(&attributes, materials, *o, organs, rig, motion)).collect();
    }
    let bark = (!by_segments).then(|| MeshObject { name: "bark".into(), mesh, motion, skin: weights });
    let asset = Asset {
        id: individual.asset.clone(),
        kind: AssetKind::Plant,
        group: String::new(),
        skeleton: rig.map(|r| r.skeleton.clone()),
        instancers,
        meshes: bark.into_iter().chain(merged).collect(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    };
    Ok(BoundPlant { asset, sway, bindings })
}

/// Whether a plant is shown by its segments in place of a lofted skin.
pub(crate) fn is_shown_by_segments(grown: &GrownPlant, recipe: &PlantRecipe) -> bool {
    recipe.skin.form == SkinForm::Segments && grown.imported.is_none()
}

/// The bark of a plant with the scene's material indices, and for each of its points the axis and the arc length on it, m.
/// # Errors
/// `Limit` for the skin's vertices.
pub(crate) fn bark_mesh(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    materials: &PlantMaterials,
    context: &BakeContext<'_>,
) -> Result<(Mesh, Vec<(u32, f32)>)> {
    let (mut mesh, bindings) = match &grown.imported {
        Some(tree) => ((*tree.wood).clone(), tree.bindings.clone()),
        None => {
            let mut options = skin_options(&recipe.skin, materials.tiles, context);
            // A species has thousands of twigs, which are seen from afar.
            let is_tree = grown.clip.is_some() && matches!(recipe.growth, Growth::Species(_));
            if is_tree && recipe.skin.cones.is_none() {
                options.thin = GROWTH_CONES;
            }
            let bark = skin(&grown.plant, &options)?;
            let (mut mesh, bindings) = (bark.mesh, bark.bindings.iter().map(|b| (b.axis, b.s)).collect::<Vec<_>>());
            paint_axes(&mut mesh, &bindings, &grown.plant, &materials.paints);
            (mesh, bindings)
        }
    };
    offset_materials(&mut mesh, materials.first_material);
    Ok((mesh, bindings))
}

/// Adds `first` to all material indices, which turns indices of the plant into indices of the scene.
fn offset_materials(mesh: &mut Mesh, first: u32) {
    for s in &mut mesh.subsets {
        s.material += first;
    }
}

/// Index into the recipe's organs of the organ that a prototype belongs to, by its name; `None` without such a prototype.
pub(crate) fn organ_of_prototype(plant: &Plant, materials: &PlantMaterials, proto: usize) -> Option<usize> {
    let name = plant.protos.get(proto)?.name.as_str();
    // Variants of an organ's mesh are named after it: NAME, or NAME_ and digits.
    let is_variant_of = |organ: &String| {
        let rest = name.strip_prefix(organ.as_str());
        rest.is_some_and(|r| r.is_empty() || r.strip_prefix('_').is_some_and(|n| n.parse::<u32>().is_ok()))
    };
    // An organ that the scene does not describe joins the group of the first organ.
    Some(materials.organ_names.iter().position(is_variant_of).unwrap_or(0))
}

/// A plant's organs grouped by index of the recipe's organ, in the plant's order within each group.
pub(crate) fn group_organs<'a>(plant: &'a Plant, materials: &PlantMaterials) -> BTreeMap<usize, Vec<&'a Organ>> {
    let mut groups: BTreeMap<usize, Vec<&Organ>> = BTreeMap::new();
    for o in &plant.organs {
        if let Some(organ) = organ_of_prototype(plant, materials, usize::from(o.proto)) {
            groups.entry(organ).or_default().push(o);
        }
    }
    groups
}

/// Merges the leaves of one organ into one mesh, in which each leaf is bound to one joint with weight 1.
fn merged_leaves(
    attributes: &WindWeights<'_>,
    materials: &PlantMaterials,
    organ: usize,
    organs: &[&Organ],
    rig: Option<&JointRig>,
    motion: MeshMotion,
) -> MeshObject {
    let (mut mesh, sizes) = attributes.leaves(organs, materials.first_material);
    mesh.attributes.extend(attributes.leaf_colors(organs, &sizes));
    let skin = rig.map(|rig| {
        let joints =
            organs.iter().zip(&sizes).flat_map(|(o, n)| std::iter::repeat_n([rig.organ_joint(o), 0, 0, 0], *n));
        let joints: Vec<[u16; 4]> = joints.collect();
        SkinWeights { weights: vec![[1.0, 0.0, 0.0, 0.0]; joints.len()], joints }
    });
    MeshObject { name: instancer_name(materials, organ), mesh, motion, skin }
}

/// Name of an organ's instancer or merged mesh: `leaves`, or the organ's name with an `s`.
pub(crate) fn instancer_name(materials: &PlantMaterials, organ: usize) -> String {
    materials.organ_names.get(organ).filter(|n| *n != "leaf").map_or_else(|| "leaves".into(), |n| format!("{n}s"))
}

/// Motion of an instancer: the joint to which each organ is fixed, or [`InstancerMotion::Still`] without a rig.
pub(crate) fn organ_instancer_motion(organs: &[&Organ], rig: Option<&JointRig>) -> InstancerMotion {
    rig.map_or(InstancerMotion::Still, |rig| {
        InstancerMotion::Joints(organs.iter().map(|o| rig.organ_joint(o)).collect())
    })
}

/// Instancer of one organ's leaves, in the order of `organs`, in plant space, with the variants of the organ as prototypes.
/// # Errors
/// `TooMany` beyond 2^32 prototypes.
pub(crate) fn leaf_instancer(
    plant: &Plant,
    materials: &PlantMaterials,
    organ: usize,
    organs: &[&Organ],
    motion: InstancerMotion,
) -> Result<Instancer> {
    let variants: Vec<usize> =
        (0..plant.protos.len()).filter(|p| organ_of_prototype(plant, materials, *p) == Some(organ)).collect();
    let prototypes = variants.iter().map(|p| leaf_prototype(plant, *p, materials.first_material)).collect();
    // From prototypes of the plant to those of this instancer.
    let local_index = |o: &&Organ| {
        index(variants.iter().position(|p| *p == usize::from(o.proto)).unwrap_or(0), "prototypes of an instancer")
    };
    let sites: Vec<_> = organs.iter().map(|o| plant.organ_site(o)).collect();
    let rest = InstanceState {
        positions: sites.iter().map(|s| s.0).collect(),
        orientations: sites.iter().map(|s| s.1).collect(),
        attributes: plant.organ_values(organs),
        ..InstanceState::default()
    };
    Ok(Instancer {
        name: instancer_name(materials, organ),
        prototypes,
        ids: organs.iter().map(|o| o.id).collect(),
        protos: organs.iter().map(local_index).collect::<Result<_>>()?,
        scales: organs.iter().map(|o| Vec3::splat(o.scale)).collect(),
        rest,
        motion,
        tracked: false,
    })
}

fn leaf_prototype(plant: &Plant, proto: usize, first: u32) -> Prototype {
    let (name, mut mesh) = plant.protos.get(proto).map(|p| (p.name.clone(), (*p.mesh).clone())).unwrap_or_default();
    offset_materials(&mut mesh, first);
    Prototype::new(name, mesh)
}
