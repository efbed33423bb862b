//! Plants on rods: bark and petioles skinned to the rods' sections, leaves at the ends of their petiole rods.

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DQuat, DVec3, Quat, Vec2, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::material_set::PlantMaterials;
use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::assets::plant_materials::petiole_radius;
use crate::bake::assets::plant_mesh::{bark_mesh, group_organs, instancer_name, leaf_instancer, organ_of_prototype};
use crate::bake::motion::sway::MAX_GAME_JOINTS;
use crate::bake::motion::{AssetMotion, CarriedPoints, FrameTime, PointOnAxis};
use crate::bake::scene::plant_layout::Individual;
use crate::bake::wind::plant_wind::{PlantWind, wood_params};
use crate::recipe::scene::BarkMotion;
use crate::recipe::scene::RodPlantKeys;
use crate::recipe::{KeyTable as _, PlantRecipe};
use osier_base::convert::{self, to_usize};
use osier_base::diagnostic::Diagnostic;
use osier_base::math::{narrow, smoothstep};
use osier_base::{Result, math};
use osier_motion::rain::RainPlant;
use osier_motion::rods::{PLANT_SPIN_UP_SECONDS, RodPlant, RodPlantParams, RodSystem, SectionFrame};
use osier_plants::surface::rod_tube::{TubeResolution, TubeSection, tube};
use osier_scene::plant::{Organ, Plant};
use osier_scene::{
    Asset, AssetFrame, AssetKind, InstanceState, InstancerFrame, InstancerMotion, Joint, Mesh, MeshFrame, MeshMotion,
    MeshObject, Skeleton, SkinWeights, Trs,
};

/// Radius of petioles whose organ has no such parameter, m. Own: that of a petiole of birch or poplar.
const DEFAULT_PETIOLE_RADIUS: f64 = 8e-4;
const PETIOLE_TUBE: TubeResolution = TubeResolution { sides: 6, rings: 2 };

/// The asset of a plant on rods, with the rods and their binding to it.
pub struct RodPlantAsset {
    /// Meshes, leaf instancers and skeleton, at rest.
    pub asset: Asset,
    /// The plant's rods at rest, in world space.
    pub rods: RodPlant,
    /// Binding of the asset's meshes and leaves to `rods`.
    pub binding: RodBinding,
    /// Warnings S042 of a rest shape that was not found, and S043 of stems and leaves without rods.
    pub diagnostics: Vec<Diagnostic>,
}

impl RodPlantAsset {
    /// The asset without skeleton and motion; the petiole meshes made from the rods remain.
    pub fn into_still_asset(self) -> Asset {
        let mut asset = self.asset;
        asset.skeleton = None;
        for object in &mut asset.meshes {
            (object.motion, object.skin) = (MeshMotion::Still, None);
        }
        asset.instancers.iter_mut().for_each(|i| i.motion = InstancerMotion::Still);
        asset
    }
}

/// A vertex bound to two sections by linear blend skinning. A section `None` is the fixed root; `share`: weight of the second
/// section, 0..1.
#[derive(Debug, Clone, Copy)]
struct VertexBinding {
    sections: [Option<usize>; 2],
    share: f32,
}

/// Binding of a plant's meshes and leaves to the sections of its rods.
#[derive(Debug, Clone)]
pub struct RodBinding {
    /// World from asset space, of the plant's first copy.
    transform: Trs,
    /// Sections with a joint. Joint 0 is the fixed root; section `jointed[i]` has joint i + 1.
    jointed: Vec<usize>,
    /// The joint that each section follows: its own joint, or, for a section without a joint, that of a section nearer to the
    /// trunk.
    joints: Vec<u16>,
    /// Position, m, and rotation of each section at rest, in asset space.
    rest: Vec<(Vec3, Quat)>,
    /// Bindings of each mesh's vertices; empty for a mesh that is skinned to joints.
    bound: Vec<Vec<VertexBinding>>,
    /// Leaves of each instancer as indices into the plant's organs, in the order of instances.
    groups: Vec<Vec<usize>>,
}

/// Frame rate of a clip and number of its first frame, with which the rods report the frame of an error.
#[derive(Debug, Clone, Copy)]
pub struct FrameClock {
    /// Frame rate of the clip, 1/s.
    pub fps: f64,
    /// Number of the clip's first frame.
    pub first: u32,
}

/// Lays out the rods of a plant and builds its asset at rest. `transform`: world transform of its first copy; `gravity`: m/s^2.
/// # Errors
/// `Limit` for the skin's vertices, `TooMany`, `Cancelled`.
pub fn build_rod_plant_at_rest(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    materials: &PlantMaterials,
    individual: &Individual,
    transform: Trs,
    clock: FrameClock,
    gravity: f64,
    context: &BakeContext<'_>,
) -> Result<RodPlantAsset> {
    context.cancel.check()?;
    let defaults = RodPlantKeys::defaults();
    let keys = recipe.rods.as_ref().unwrap_or(&defaults);
    let plant = &grown.plant;
    // Make the rods: one for each stem, beginning where it is thin enough to bend, and one for each petiole, as many as the
    // limits allow.
    let params = rod_plant_params(plant, recipe, materials, keys, gravity);
    let rods =
        RodPlant::new(plant, &transform, &params, &individual.asset).with_frame_numbering(clock.fps, clock.first);
    let (mesh, bindings) = bark_mesh(grown, recipe, materials, context)?;
    let max_joints = if recipe.keys.motion == BarkMotion::Game {
        recipe.keys.max_joints.min(MAX_GAME_JOINTS)
    } else {
        recipe.keys.max_joints
    };
    // The binding stores the leaves of each instancer as indices into the plant's organs.
    let groups = group_organs(plant, materials);
    // Groups contain references to organs, not indices: the ids give the indices in the plant's list, which the rods use.
    let organ_indices: std::collections::BTreeMap<u64, usize> =
        plant.organs.iter().enumerate().map(|(i, o)| (o.id, i)).collect();
    let organ_index = |o: &&Organ| organ_indices.get(&o.id).copied().unwrap_or(0);
    let mut binding = RodBinding::new(&rods, transform, to_usize(max_joints))?;
    binding.groups = groups.values().map(|organs| organs.iter().map(organ_index).collect()).collect();
    // With a joint for every section skinning shows the rods exactly; with fewer, frames carry vertex positions.
    let skinned = binding.jointed.len() == rods.rods().len() && recipe.keys.motion != BarkMotion::Cache;
    let bind_vertex = |(axis, s): &(u32, f32)| {
        let nearest = rods.section_blend_at(*axis, f64::from(*s));
        // Smoothstep has zero slope at both sections, where the blended bark is then tangent to them: no kinks.
        VertexBinding { sections: nearest.sections, share: smoothstep(0.0, 1.0, narrow(nearest.share)) }
    };
    // The bark, then a mesh of petioles for each instancer of leaves.
    let mut parts = vec![("bark".to_owned(), mesh, bindings.iter().map(bind_vertex).collect::<Vec<_>>())];
    for (organ, leaves) in groups.keys().zip(&binding.groups) {
        let (mesh, bound) = petiole_mesh(plant, &rods, &binding, leaves, materials.first_material)?;
        if !mesh.points.is_empty() {
            parts.push((format!("{}_stalks", instancer_name(materials, *organ)), mesh, bound));
        }
    }
    let motion = if skinned { MeshMotion::Skinned } else { MeshMotion::Deforming };
    let mut meshes = Vec::new();
    for (name, mesh, bound) in parts {
        let skin = Some(binding.skin_weights(&bound));
        meshes.push(MeshObject { name, mesh, motion, skin });
        binding.bound.push(if skinned { Vec::new() } else { bound });
    }
    // A leaf follows the joint of the last section of its petiole.
    let leaf_motion =
        |leaves: &Vec<usize>| InstancerMotion::Joints(leaves.iter().map(|i| binding.leaf_joint(&rods, *i)).collect());
    let instancers = groups
        .iter()
        .zip(&binding.groups)
        .map(|((o, organs), leaves)| leaf_instancer(plant, materials, *o, organs, leaf_motion(leaves)))
        .collect::<Result<Vec<_>>>()?;
    let asset = Asset {
        id: individual.asset.clone(),
        kind: AssetKind::Plant,
        group: String::new(),
        skeleton: Some(binding.skeleton(&rods)),
        instancers,
        meshes,
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    };
    let diagnostics = rod_plant_diagnostics(&rods, &individual.asset, keys);
    Ok(RodPlantAsset { asset, rods, binding, diagnostics })
}

/// Parameters of the rods from the keys of `[plants.NAME.rods]` and of the plant's wood and organs.
fn rod_plant_params(
    plant: &Plant,
    recipe: &PlantRecipe,
    materials: &PlantMaterials,
    keys: &RodPlantKeys,
    gravity: f64,
) -> RodPlantParams {
    let radius = |proto: usize| {
        let organ = organ_of_prototype(plant, materials, proto).and_then(|o| recipe.organs.get(o));
        organ.and_then(petiole_radius).unwrap_or(DEFAULT_PETIOLE_RADIUS)
    };
    RodPlantParams {
        wood: wood_params(&recipe.wood),
        gravity,
        shear: keys.shear_ratio,
        recovery: keys.recovery,
        flexibility: keys.compliance,
        stalk_young: keys.petiole_elasticity,
        stalk_radii: (0..plant.protos.len()).map(radius).collect(),
        stalk_radius: keys.petiole_radius,
        stalk_sections: to_usize(keys.petiole_sections),
        sections: keys.sections.map(to_usize),
        max_rod_radius: keys.thickest,
        max_sections: to_usize(keys.max_sections),
        max_leaf_stalks: to_usize(keys.max_leaves),
    }
}

/// Diagnostic S042 if no rest shape was found that gravity bends into the grown shape, S043 for stems and leaves beyond the
/// limits of sections.
fn rod_plant_diagnostics(rods: &RodPlant, name: &str, keys: &RodPlantKeys) -> Vec<Diagnostic> {
    let mut diagnostics = Vec::new();
    if !rods.has_rest_shape() {
        let text = format!("no shape was found from which the twigs of \"{name}\" hang as they grew");
        diagnostics.push(Diagnostic::about("S042", text).help("their own weight is left out; stiffer wood holds it"));
    }
    let [stems, leaves] = rods.omitted_stems_and_leaves();
    if stems + leaves > 0 {
        let text = format!("{stems} twigs and {leaves} leaves of \"{name}\" are rigid with what they stand on");
        let now = format!("now {} and {}", keys.max_leaves, keys.max_sections);
        diagnostics
            .push(Diagnostic::about("S043", text).help(format!("raise rods.max_leaves and rods.max_sections, {now}")));
    }
    diagnostics
}

/// Mesh of the petioles of some leaves as tubes in asset space. They have the material of their blades and the texture
/// coordinates of the blade's base.
/// # Errors
/// `TooMany` beyond 2^16 sections of a petiole.
fn petiole_mesh(
    plant: &Plant,
    plant_rods: &RodPlant,
    binding: &RodBinding,
    leaves: &[usize],
    first_material: u32,
) -> Result<(Mesh, Vec<VertexBinding>)> {
    let (mut mesh, mut bound) = (Mesh::default(), Vec::new());
    let rods = plant_rods.rods();
    for leaf in leaves {
        let Some(rod) = plant_rods.leaf_stalk(*leaf) else { continue };
        // The tube starts on the section of the stem that carries the petiole, and continues along the sections of the petiole.
        let base = rods.base_attachment(rod).map(|(on, frame)| (on, binding.to_asset_frame(&frame)));
        let own = rods.sections_of_rod(rod).map(|i| (i, binding.rest[i]));
        let sections: Vec<(usize, (Vec3, Quat))> = base.into_iter().chain(own).collect();
        let radius = rods.sections_of_rod(rod).next().map_or(0.0, |i| narrow(rods.radius(i)) / binding.transform.s.x);
        let tube_section = |(k, (_, (p, q))): (usize, &(usize, (Vec3, Quat)))| {
            Ok(TubeSection { joint: convert::narrow(k, "sections of a petiole")?, p: *p, q: *q, r: radius })
        };
        let tube_sections: Vec<TubeSection> = sections.iter().enumerate().map(tube_section).collect::<Result<_>>()?;
        let (mut tube, skin) = tube(&tube_sections, PETIOLE_TUBE);
        let proto = &plant.protos[usize::from(plant.organs[*leaf].proto)].mesh;
        // With one texture coordinate for all vertices, the petiole has the colour of the blade's base.
        tube.uvs.fill(uv_at_pivot(proto));
        let material = proto.subsets.first().map_or(0, |s| s.material) + first_material;
        mesh.append(&tube.with_material(material));
        bound.extend(skin.joints.iter().zip(&skin.weights).map(|(j, w)| {
            // Joints of the tube index its list of sections; the binding names sections of the whole plant.
            let ends = [j[0], j[1]].map(|k| sections.get(usize::from(k)).map(|s| s.0));
            VertexBinding { sections: ends, share: w[1] }
        }));
    }
    Ok((mesh, bound))
}

/// Texture coordinates of the vertex nearest to the pivot, where the blade begins.
fn uv_at_pivot(mesh: &Mesh) -> Vec2 {
    let near = |best: usize, i: usize| if mesh.points[i].length() < mesh.points[best].length() { i } else { best };
    mesh.uvs.get((0..mesh.points.len()).fold(0, near)).copied().unwrap_or_default()
}

impl RodBinding {
    /// Assigns joints to the root and the first `max_joints` - 1 sections; every other section follows the joint of the section
    /// before it, or of the section that carries its rod.
    fn new(plant_rods: &RodPlant, transform: Trs, max_joints: usize) -> Result<Self> {
        let rods = plant_rods.rods();
        let mut binding = Self {
            transform,
            jointed: Vec::new(),
            joints: vec![0; rods.len()],
            rest: Vec::new(),
            bound: Vec::new(),
            groups: Vec::new(),
        };
        binding.rest = (0..rods.len()).map(|i| binding.to_asset_frame(&rods.reference_frame(i))).collect();
        // Rods are ordered from the trunk outwards: with few joints, petioles and twigs follow the joints of their carriers.
        let mut previous = 0;
        for i in 0..rods.len() {
            let rod = rods.rod_of_section(i);
            let joint = if i + 1 < max_joints.max(1) {
                binding.jointed.push(i);
                convert::narrow(i + 1, "joints of a plant")?
            } else if i == rods.sections_of_rod(rod).start {
                rods.base_attachment(rod).map_or(0, |(on, _)| binding.joints[on])
            } else {
                previous
            };
            previous = joint;
            binding.joints[i] = joint;
        }
        Ok(binding)
    }

    /// Position and rotation of a section in asset space, from its frame in the world.
    fn to_asset_frame(&self, f: &SectionFrame) -> (Vec3, Quat) {
        (self.world_to_asset(f.p), self.to_asset_rotation(f.rotation()))
    }

    fn world_to_asset(&self, p: DVec3) -> Vec3 {
        let back = self.transform.r.as_dquat().normalize().conjugate();
        // Inverse of the placement p = t + s R a, whose scale s is uniform.
        (back * (p - self.transform.t.as_dvec3()) / f64::from(self.transform.s.x)).as_vec3()
    }

    fn to_asset_rotation(&self, q: DQuat) -> Quat {
        (self.transform.r.as_dquat().normalize().conjugate() * q).as_quat().normalize()
    }

    fn skeleton(&self, rods: &RodPlant) -> Skeleton {
        let root = Joint { name: "root".into(), parent: None, rest: Trs::IDENTITY, radius: 0.0 };
        // All joints are children of the root: their poses are in asset space, whatever their rods are attached to.
        let section = |i: &usize| {
            let (t, r) = self.rest[*i];
            let radius = narrow(rods.rods().radius(*i)) / self.transform.s.x;
            Joint { name: format!("s{i}"), parent: Some(0), rest: Trs { t, r, s: Vec3::ONE }, radius }
        };
        Skeleton { joints: [root].into_iter().chain(self.jointed.iter().map(section)).collect() }
    }

    /// The joint that the blade of a leaf follows; 0 (the root) for a leaf without a rod. `leaf`: index into the plant's
    /// organs.
    pub fn leaf_joint(&self, rods: &RodPlant, leaf: usize) -> u16 {
        rods.leaf_section(leaf).map_or(0, |section| self.joints[section])
    }

    /// Leaves of each instancer as indices into the plant's organs, in the order of instances.
    pub fn leaf_groups(&self) -> &[Vec<usize>] {
        &self.groups
    }

    /// Binds points of the plant's axes, at rest, to the joints that carry them. `rods`: those of the plant.
    pub(crate) fn bind_points(&self, rods: &RodPlant, points: &[PointOnAxis]) -> BoundPoints {
        let carrier = |section: Option<usize>| {
            // Joint 0 is the fixed root; section `jointed[i]` has joint i + 1.
            let joint = usize::from(self.joints[section?]);
            let (p, q) = self.rest[*self.jointed.get(joint.checked_sub(1)?)?];
            Some((joint, Trs { t: p, r: q, s: Vec3::ONE }))
        };
        let bound = |point: &PointOnAxis| {
            let nearest = rods.section_blend_at(point.axis, f64::from(point.arc_length));
            BoundPoint { rest: point.position, carriers: nearest.sections.map(carrier), share: narrow(nearest.share) }
        };
        BoundPoints(points.iter().map(bound).collect())
    }

    /// Joint indices and weights of each vertex, the larger weight first; at most two joints per vertex.
    fn skin_weights(&self, bound: &[VertexBinding]) -> SkinWeights {
        let mut skin = SkinWeights::default();
        for b in bound {
            let [first, second] = b.sections.map(|s| s.map_or(0, |s| self.joints[s]));
            // Some readers use only the first influences.
            let (major, minor) = if b.share > 0.5 {
                ((second, b.share), (first, 1.0 - b.share))
            } else {
                ((first, 1.0 - b.share), (second, b.share))
            };
            // Two sections that share a joint are one influence.
            if first == second || minor.1 <= 0.0 {
                skin.joints.push([major.0, 0, 0, 0]);
                skin.weights.push([1.0, 0.0, 0.0, 0.0]);
            } else {
                skin.joints.push([major.0, minor.0, 0, 0]);
                skin.weights.push([major.1, minor.1, 0.0, 0.0]);
            }
        }
        skin
    }

    /// Frame of the asset in the current pose of `rods`, which are the rods of `plant`: joints, deformed vertices and leaves.
    pub fn pose_asset(&self, asset: &Asset, rods: &RodSystem, plant: &dyn RainPlant) -> AssetFrame {
        let pose: Vec<(Vec3, Quat)> = (0..rods.len()).map(|i| self.to_asset_frame(&rods.section_frame(i))).collect();
        let joint = |i: &usize| Trs { t: pose[*i].0, r: pose[*i].1, s: Vec3::ONE };
        let meshes = asset.meshes.iter().zip(&self.bound);
        AssetFrame {
            pose: [Trs::IDENTITY].into_iter().chain(self.jointed.iter().map(joint)).collect(),
            meshes: meshes.map(|(m, bound)| self.posed_points(&m.mesh, bound, &pose, rods)).collect(),
            instancers: self
                .groups
                .iter()
                .map(|leaves| InstancerFrame::State(self.leaf_states(leaves, plant)))
                .collect(),
            ..AssetFrame::default()
        }
    }

    /// Positions, rotations and velocities of the leaves of one instancer in asset space.
    fn leaf_states(&self, leaves: &[usize], plant: &dyn RainPlant) -> InstanceState {
        let blades: Vec<_> = leaves.iter().map(|i| plant.leaf_pose(*i)).collect();
        let back = self.transform.r.as_dquat().normalize().conjugate();
        let scale = f64::from(self.transform.s.x);
        InstanceState {
            positions: blades.iter().map(|b| self.world_to_asset(b.position)).collect(),
            orientations: blades.iter().map(|b| self.to_asset_rotation(b.orientation)).collect(),
            velocities: blades.iter().map(|b| (back * b.velocity / scale).as_vec3()).collect(),
            angular_velocities: blades.iter().map(|b| (back * b.angular_velocity).as_vec3()).collect(),
            ..InstanceState::default()
        }
    }

    /// Rotation of each section away from rest, in asset space.
    fn section_rotations(&self, pose: &[(Vec3, Quat)]) -> Vec<Quat> {
        pose.iter().zip(&self.rest).map(|(now, rest)| now.1 * rest.1.conjugate()).collect()
    }

    /// A point carried by two sections: the mean of both positions weighted by their shares, asset space, m.
    fn posed_point(&self, point: Vec3, bound: VertexBinding, pose: &[(Vec3, Quat)], turns: &[Quat]) -> Vec3 {
        let carried = |section: Option<usize>| match section {
            Some(s) => pose[s].0 + turns[s] * (point - self.rest[s].0),
            None => point,
        };
        carried(bound.sections[0]).lerp(carried(bound.sections[1]), bound.share)
    }

    /// Linear blend skinning of a mesh's points, normals and velocities: each is the mean of the values that its two sections
    /// give it, weighted by their shares. [`MeshFrame::Same`] for a mesh without bindings, which joints move.
    fn posed_points(&self, mesh: &Mesh, bound: &[VertexBinding], pose: &[(Vec3, Quat)], rods: &RodSystem) -> MeshFrame {
        if bound.is_empty() {
            return MeshFrame::Same;
        }
        // Velocity and angular velocity of each section, and its rotation away from rest, in asset space.
        let back = self.transform.r.conjugate();
        let motions: Vec<(Vec3, Vec3)> = (0..rods.len())
            .map(|i| {
                let (v, spin) = rods.section_rigid_velocity(i);
                (back * v.as_vec3() / self.transform.s.x, back * spin.as_vec3())
            })
            .collect();
        let turns = self.section_rotations(pose);
        let (mut points, mut normals, mut velocities) = (Vec::new(), Vec::new(), Vec::new());
        for ((b, p), n) in bound.iter().zip(&mesh.points).zip(&mesh.normals) {
            let (mut place, mut normal, mut velocity) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
            for (section, share) in b.sections.into_iter().zip([1.0 - b.share, b.share]) {
                let Some(s) = section else {
                    place += *p * share;
                    normal += *n * share;
                    continue;
                };
                // A rigid section moves the arm r from its centre by v + w x r.
                let arm = turns[s] * (*p - self.rest[s].0);
                place += (pose[s].0 + arm) * share;
                normal += (turns[s] * *n) * share;
                velocity += (motions[s].0 + motions[s].1.cross(arm)) * share;
            }
            points.push(place);
            normals.push(math::normalize_or(normal, *n));
            velocities.push(velocity);
        }
        MeshFrame::Points { points, normals, velocities }
    }
}

/// Points of a plant on rods that its joints carry.
#[derive(Debug)]
pub(crate) struct BoundPoints(Vec<BoundPoint>);

/// A point that two joints carry.
#[derive(Debug)]
struct BoundPoint {
    /// Its position at rest, asset space, m.
    rest: Vec3,
    /// Index and rest pose of both joints, asset space; `None` for the fixed root.
    carriers: [Option<(usize, Trs)>; 2],
    /// Weight of the second joint, 0..1.
    share: f32,
}

impl BoundPoints {
    /// Positions of the points, asset space, m, where the joints have these poses.
    pub(crate) fn carried_by_joints(&self, pose: &[Trs]) -> Vec<Vec3> {
        let position = |point: &BoundPoint| {
            let [a, b] = point.carriers.map(|carrier| {
                let posed = carrier.and_then(|(joint, rest)| Some((rest, pose.get(joint)?)));
                posed.map_or(point.rest, |(rest, now)| now.t + now.r * (rest.r.conjugate() * (point.rest - rest.t)))
            });
            a.lerp(b, point.share)
        };
        self.0.iter().map(position).collect()
    }
}

/// Motion of a plant on rods in a wind. Frames in rising order cost one step each; an earlier frame starts again with the
/// spin-up.
#[derive(Debug)]
pub struct RodPlantMotion {
    start: RodPlant,
    binding: RodBinding,
    fps: f64,
    steps_per_frame: u32,
    /// Number of time steps of the spin-up, before the first frame.
    spin_up_steps: u32,
    /// The rods after the last evaluated frame, and its number; `None` before the first and after an error.
    state: Mutex<Option<(RodPlant, u64)>>,
}

impl RodPlantMotion {
    /// Places rods in a wind, in which they spin up before the clip unless they start from rest.
    pub fn new(rods: RodPlant, binding: RodBinding, recipe: &PlantRecipe, wind: &PlantWind, fps: f64) -> Self {
        let start = rods.with_wind(Some(Arc::clone(&wind.rod_wind)));
        let automatic = || start.steps_per_frame(fps, Some(&*wind.rod_wind));
        let steps_per_frame = recipe.rods.as_ref().and_then(|k| k.substeps).unwrap_or_else(automatic);
        // In steps, not in frames: frames may be longer than the spin-up.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds of steps")]
        let spin_up_steps = (PLANT_SPIN_UP_SECONDS * fps * f64::from(steps_per_frame)).round() as u32;
        let spin_up_steps = if wind.rods_from_rest { 0 } else { spin_up_steps };
        Self { start, binding, fps, steps_per_frame, spin_up_steps, state: Mutex::new(None) }
    }

    /// Steps the rods to the `number`-th frame of the clip, from the start if they have passed it, and passes them to `read`.
    /// # Errors
    /// `Simulation` for rods that diverge.
    fn evaluate<R>(&self, number: u64, read: impl FnOnce(&RodPlant) -> R) -> Result<R> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let h = 1.0 / (self.fps * f64::from(self.steps_per_frame));
        // The state is taken out while it is stepped: after an error the next call restarts instead of continuing from a
        // partial step.
        let (mut rods, mut frames) = match state.take().filter(|n| n.1 <= number) {
            Some(reached) => reached,
            None => {
                // The spin-up runs at negative times and ends at the clip's first frame.
                let mut rods = self.start.clone();
                for k in 0..self.spin_up_steps {
                    rods.step((f64::from(k) - f64::from(self.spin_up_steps)) * h, h)?;
                }
                (rods, 0)
            }
        };
        while frames < number {
            for k in 0..self.steps_per_frame {
                rods.step(frames as f64 / self.fps + f64::from(k) * h, h)?;
            }
            frames += 1;
        }
        let found = read(&rods);
        *state = Some((rods, frames));
        Ok(found)
    }
}

impl AssetMotion for RodPlantMotion {
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        self.evaluate(time.index(), |rods| self.binding.pose_asset(asset, rods.rods(), rods))
    }

    fn bind_points(self: Arc<Self>, _plant: &Plant, points: &[PointOnAxis]) -> Option<Arc<dyn CarriedPoints>> {
        let bind = |point: &PointOnAxis| {
            let nearest = self.start.section_blend_at(point.axis, f64::from(point.arc_length));
            (point.position, VertexBinding { sections: nearest.sections, share: narrow(nearest.share) })
        };
        let points = points.iter().map(bind).collect();
        Some(Arc::new(RodPoints { motion: self, points }))
    }
}

#[derive(Debug)]
struct RodPoints {
    motion: Arc<RodPlantMotion>,
    points: Vec<(Vec3, VertexBinding)>,
}

impl CarriedPoints for RodPoints {
    fn positions(&self, time: FrameTime) -> Result<Vec<Vec3>> {
        let binding = &self.motion.binding;
        self.motion.evaluate(time.index(), |plant| {
            let rods = plant.rods();
            let pose: Vec<(Vec3, Quat)> =
                (0..rods.len()).map(|i| binding.to_asset_frame(&rods.section_frame(i))).collect();
            let turns = binding.section_rotations(&pose);
            self.points.iter().map(|(point, bound)| binding.posed_point(*point, *bound, &pose, &turns)).collect()
        })
    }
}
