//! From a grown plant to an asset of the scene: bark, leaves, joints.

use std::collections::BTreeMap;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::assets::skin_options::skin_options;
use crate::bake::motion::sway::{FlutterGroup, SwayMotion, SwaySurface};
use crate::bake::scene::plant_layout::{Individual, PlantLayout};
use crate::bake::wind::plant_wind::PlantWind;
use crate::recipe::scene::BarkMotion;
use crate::recipe::{PlantRecipe, Recipe};
use osier_base::Result;
use osier_motion::sway::{JointRig, WindWeights};
use osier_plants::surface::skin;
use osier_scene::plant::{Organ, Plant};
use osier_scene::{
    Asset, AssetKind, InstanceState, Instancer, InstancerMotion, Mesh, MeshMotion, MeshObject, Prototype, SkinWeights,
    Trs,
};

/// What all individuals of one plant share.
#[derive(Debug, Clone, Default)]
pub struct PlantMaterials {
    /// Index of the plant's first material in the scene; its own indices are added.
    pub first_material: u32,
    /// Size of one repeat of the bark, m.
    pub tile: f32,
    /// Names of the organs, parallel to the recipe's; prototypes are called `NAME` or `NAME_0`, `NAME_1`, ...
    pub organ_names: Vec<String>,
    /// Its bark carries the attributes by which shaders sway it, for copies that a format shows without a skeleton.
    pub shader_wind: bool,
}

/// Marks the plants of which glTF may show copies without a skeleton, as all of them would need more skins than it is given.
pub fn mark_shader_wind(recipe: &Recipe, layout: &PlantLayout, kinds: &mut [PlantMaterials]) {
    let written = recipe.output.writes(&osier_export::gltf::FORMAT);
    let beyond = layout.standings.len() > usize::try_from(recipe.output.gltf.skins).unwrap_or(usize::MAX);
    let mut standing = vec![0_usize; kinds.len()];
    for plant in layout.standings.iter().filter_map(|s| layout.individuals.get(s.individual)).map(|i| i.plant) {
        standing.get_mut(plant).into_iter().for_each(|n| *n += 1);
    }
    for (kind, n) in kinds.iter_mut().zip(standing) {
        kind.shader_wind = written && beyond && recipe.moves && n > 1;
    }
}

/// Makes the asset of a grown plant. `moving`: the wind, and where the plant's first copy stands.
/// # Errors
/// What the skin and the simulation refuse.
pub fn build_plant_asset(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    kind: &PlantMaterials,
    individual: &Individual,
    moving: Option<(&PlantWind, Trs)>,
    context: &BakeContext<'_>,
) -> Result<(Asset, Option<SwayMotion>)> {
    context.cancel.check()?;
    let plant = &grown.plant;
    let (mut mesh, bindings) = bark(grown, recipe, kind, context)?;
    let groups = group_organs(plant, kind);
    let shaded = matches!(recipe.keys.motion, BarkMotion::Game | BarkMotion::Static);
    let moving = moving.filter(|_| !matches!(recipe.keys.motion, BarkMotion::Still | BarkMotion::Static));
    let mover = match moving {
        Some((air, stand)) => {
            let manner = air.manner(&recipe.wood, stand);
            let separate = groups.iter().filter(|_| !shaded);
            let leaves: Vec<FlutterGroup> = separate.map(|(o, organs)| FlutterGroup::of(recipe, *o, organs)).collect();
            let shown = SwaySurface { points: &mesh.points, bindings: &bindings, leaves: &leaves };
            Some(SwayMotion::new(plant, &recipe.keys, air, manner, &shown, context)?)
        }
        None => None,
    };
    let rig = mover.as_ref().map(|m| &m.rig);
    let motion = match (rig, recipe.keys.motion) {
        (None, _) | (_, BarkMotion::Still | BarkMotion::Static) => MeshMotion::Still,
        (Some(_), BarkMotion::Skin | BarkMotion::Game) => MeshMotion::Skinned,
        (Some(_), BarkMotion::Cache) => MeshMotion::Deforming,
    };
    let weights = rig.map(|r| r.skin(plant, bindings.iter().copied()));
    let separate = groups.iter().filter(|_| !shaded);
    let instancers = separate.map(|(o, organs)| instancer(plant, kind, *o, organs, joint_motion(organs, rig)));
    let mut merged = Vec::new();
    if shaded || kind.shader_wind {
        mesh.attributes = WindWeights::new(plant).bark(&bindings);
    }
    if shaded {
        let attributes = WindWeights::new(plant);
        merged = groups.iter().map(|(o, organs)| merged_leaves(&attributes, kind, *o, organs, rig, motion)).collect();
    }
    let bark = MeshObject { name: "bark".into(), mesh, motion, skin: weights };
    let asset = Asset {
        id: individual.asset.clone(),
        kind: AssetKind::Plant,
        group: String::new(),
        skeleton: rig.map(|r| r.skeleton.clone()),
        instancers: instancers.collect(),
        meshes: [bark].into_iter().chain(merged).collect(),
        points: Vec::new(),
        curves: Vec::new(),
    };
    Ok((asset, mover))
}

/// The bark of a plant, with axis and arc length, m, of each point.
/// # Errors
/// What the skin refuses.
pub fn bark(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    kind: &PlantMaterials,
    context: &BakeContext<'_>,
) -> Result<(Mesh, Vec<(u32, f32)>)> {
    let (mut mesh, bindings) = match &grown.own {
        Some(tree) => ((*tree.wood).clone(), tree.bindings.clone()),
        None => {
            let bark = skin(&grown.plant, &skin_options(&recipe.skin, kind.tile, context))?;
            (bark.mesh, bark.bindings.iter().map(|b| (b.axis, b.s)).collect())
        }
    };
    to_scene(&mut mesh, kind.first_material);
    Ok((mesh, bindings))
}

/// From the plant's own material indices to the scene's.
fn to_scene(mesh: &mut Mesh, first: u32) {
    for s in &mut mesh.subsets {
        s.material += first;
    }
}

/// Organ (index into the recipe's) that a prototype shows.
pub fn organ_of_prototype(plant: &Plant, kind: &PlantMaterials, proto: usize) -> Option<usize> {
    let name = plant.protos.get(proto)?.name.as_str();
    let is = |own: &String| {
        let rest = name.strip_prefix(own.as_str());
        rest.is_some_and(|r| r.is_empty() || r.strip_prefix('_').is_some_and(|n| n.parse::<u32>().is_ok()))
    };
    // An organ that the scene does not describe is shown with the first one's group.
    Some(kind.organ_names.iter().position(is).unwrap_or(0))
}

/// Organs by what they show, in the plant's order.
pub fn group_organs<'a>(plant: &'a Plant, kind: &PlantMaterials) -> BTreeMap<usize, Vec<&'a Organ>> {
    let mut groups: BTreeMap<usize, Vec<&Organ>> = BTreeMap::new();
    for o in &plant.organs {
        if let Some(organ) = organ_of_prototype(plant, kind, usize::from(o.proto)) {
            groups.entry(organ).or_default().push(o);
        }
    }
    groups
}

/// Leaves of one kind as one mesh that rides rigidly on the joints.
fn merged_leaves(
    attributes: &WindWeights<'_>,
    kind: &PlantMaterials,
    organ: usize,
    organs: &[&Organ],
    rig: Option<&JointRig>,
    motion: MeshMotion,
) -> MeshObject {
    let (mesh, sizes) = attributes.leaves(organs, kind.first_material);
    let skin = rig.map(|rig| {
        let joints =
            organs.iter().zip(&sizes).flat_map(|(o, n)| std::iter::repeat_n([rig.organ_joint(o), 0, 0, 0], *n));
        let joints: Vec<[u16; 4]> = joints.collect();
        SkinWeights { weights: vec![[1.0, 0.0, 0.0, 0.0]; joints.len()], joints }
    });
    MeshObject { name: instancer_name(kind, organ), mesh, motion, skin }
}

/// Name of the leaves of one kind.
pub fn instancer_name(kind: &PlantMaterials, organ: usize) -> String {
    kind.organ_names.get(organ).filter(|n| *n != "leaf").map_or_else(|| "leaves".into(), |n| format!("{n}s"))
}

/// How organs move with the joints.
fn joint_motion(organs: &[&Organ], rig: Option<&JointRig>) -> InstancerMotion {
    rig.map_or(InstancerMotion::Still, |rig| {
        InstancerMotion::Joints(organs.iter().map(|o| rig.organ_joint(o)).collect())
    })
}

/// Leaves of one kind.
pub fn instancer(
    plant: &Plant,
    kind: &PlantMaterials,
    organ: usize,
    organs: &[&Organ],
    motion: InstancerMotion,
) -> Instancer {
    let mine: Vec<usize> =
        (0..plant.protos.len()).filter(|p| organ_of_prototype(plant, kind, *p) == Some(organ)).collect();
    let prototypes = mine.iter().map(|p| prototype(plant, *p, kind.first_material)).collect();
    let local = |o: &Organ| mine.iter().position(|p| *p == usize::from(o.proto)).and_then(|p| u32::try_from(p).ok());
    let sites: Vec<_> = organs.iter().map(|o| plant.organ_site(o)).collect();
    let rest = InstanceState {
        positions: sites.iter().map(|s| s.0).collect(),
        orientations: sites.iter().map(|s| s.1).collect(),
        ..InstanceState::default()
    };
    Instancer {
        name: instancer_name(kind, organ),
        prototypes,
        ids: organs.iter().map(|o| o.id).collect(),
        protos: organs.iter().map(|o| local(o).unwrap_or(0)).collect(),
        scales: organs.iter().map(|o| Vec3::splat(o.scale)).collect(),
        rest,
        motion,
        tracked: false,
    }
}

fn prototype(plant: &Plant, proto: usize, first: u32) -> Prototype {
    let (name, mut mesh) = plant.protos.get(proto).map(|p| (p.name.clone(), (*p.mesh).clone())).unwrap_or_default();
    to_scene(&mut mesh, first);
    Prototype::new(name, mesh)
}
