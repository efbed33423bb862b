//! Plants on rods: their bark and stalks bound to sections, their leaves where the rods have them, frame by frame.

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DQuat, DVec3, Quat, Vec2, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::assets::plant_materials::stalk_radius;
use crate::bake::assets::plant_mesh::{PlantMaterials, bark, group_organs, instancer, instancer_name};
use crate::bake::motion::{AssetMotion, FrameTime};
use crate::bake::scene::plant_layout::Individual;
use crate::bake::wind::plant_wind::{PlantWind, wood};
use crate::recipe::scene::BarkMotion;
use crate::recipe::scene::RodPlantKeys;
use crate::recipe::{KeyTable as _, PlantRecipe};
use osier_base::diagnostic::Diagnostic;
use osier_base::math::{narrow, smoothstep};
use osier_base::{Result, math};
use osier_motion::rain::RainTarget;
use osier_motion::rods::{RodPlant, RodPlantParams, RodSystem, SectionFrame};
use osier_plants::surface::rod_tube::{TubeResolution, TubeSection, tube};
use osier_scene::plant::{Organ, Plant};
use osier_scene::{
    Asset, AssetFrame, AssetKind, InstanceState, InstancerFrame, InstancerMotion, Joint, Mesh, MeshFrame, MeshMotion,
    MeshObject, Skeleton, SkinWeights, Trs,
};
use osier_wind::Wind;

/// Wind that has blown before the first frame of a clip that does not begin at rest, s.
const PRE_ROLL: f64 = 2.0;
/// Most joints for engines.
const MAX_GAME_JOINTS: u32 = 64;
/// Radius of stalks of which nothing is known, m.
const DEFAULT_STALK_RADIUS: f64 = 8e-4;
/// Sides and rings of a stalk.
const STALK_TUBE: TubeResolution = TubeResolution { sides: 6, rings: 2 };

/// A plant on rods.
pub struct RodPlantAsset {
    /// What is seen of it.
    pub asset: Asset,
    /// Its rods, at rest.
    pub boughs: RodPlant,
    /// From rods to frames.
    pub dressing: SkinBinding,
    /// What was left out.
    pub told: Vec<Diagnostic>,
}

impl RodPlantAsset {
    /// What is seen of it where nothing moves: with its stalks.
    pub fn stilled(self) -> Asset {
        let mut asset = self.asset;
        asset.skeleton = None;
        for object in &mut asset.meshes {
            (object.motion, object.skin) = (MeshMotion::Still, None);
        }
        asset.instancers.iter_mut().for_each(|i| i.motion = InstancerMotion::Still);
        asset
    }
}

/// A point of a mesh between two sections.
#[derive(Debug, Clone, Copy)]
struct VertexBinding {
    sections: [Option<usize>; 2],
    share: f32,
}

/// How a plant on rods is shown.
#[derive(Debug, Clone)]
pub struct SkinBinding {
    stand: Trs,
    /// Sections that have joints, after joint 0, and the joint that each section follows.
    jointed: Vec<usize>,
    joints: Vec<u16>,
    /// Sections at rest, in the asset's space.
    rest: Vec<(Vec3, Quat)>,
    /// Of each mesh: what its points follow, where frames carry points.
    bound: Vec<Vec<VertexBinding>>,
    /// Leaves of each instancer: indices into the plant's organs.
    groups: Vec<Vec<usize>>,
}

/// Rods and leaves of a plant that stands at `stand`, at rest. `clock`: frames per second, and the number of the first.
/// # Errors
/// What the skin refuses.
pub fn build_rod_plant(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    kind: &PlantMaterials,
    individual: &Individual,
    stand: Trs,
    clock: (f64, u32),
    g: f64,
    context: &BakeContext<'_>,
) -> Result<RodPlantAsset> {
    context.cancel.check()?;
    let own = RodPlantKeys::defaults();
    let keys = recipe.rods.as_ref().unwrap_or(&own);
    let plant = &grown.plant;
    let grain = discretisation(plant, recipe, kind, keys, g);
    let boughs = RodPlant::new(plant, &stand, &grain, &individual.asset).with_frame_clock(clock.0, clock.1);
    let (mesh, bindings) = bark(grown, recipe, kind, context)?;
    let most = if recipe.keys.motion == BarkMotion::Game {
        recipe.keys.max_joints.min(MAX_GAME_JOINTS)
    } else {
        recipe.keys.max_joints
    };
    let groups = group_organs(plant, kind);
    let places: std::collections::BTreeMap<u64, usize> =
        plant.organs.iter().enumerate().map(|(i, o)| (o.id, i)).collect();
    let place = |o: &&Organ| places.get(&o.id).copied().unwrap_or(0);
    let mut dressing = SkinBinding::new(&boughs, stand, most as usize);
    dressing.groups = groups.values().map(|organs| organs.iter().map(place).collect()).collect();
    let whole = dressing.jointed.len() == boughs.rods().len() && recipe.keys.motion != BarkMotion::Cache;
    let around = |(axis, s): &(u32, f32)| {
        let at = boughs.axis_sections(*axis, f64::from(*s));
        // Where a share does not change the bark runs along its section: no kinks.
        VertexBinding { sections: at.sections, share: smoothstep(0.0, 1.0, narrow(at.share)) }
    };
    let mut shown = vec![("bark".to_owned(), mesh, bindings.iter().map(around).collect::<Vec<_>>())];
    for (organ, leaves) in groups.keys().zip(&dressing.groups) {
        let (mesh, bound) = petiole_mesh(plant, &boughs, &dressing, leaves, kind.first_material);
        if !mesh.points.is_empty() {
            shown.push((format!("{}_stalks", instancer_name(kind, *organ)), mesh, bound));
        }
    }
    let motion = if whole { MeshMotion::Skinned } else { MeshMotion::Deforming };
    let mut meshes = Vec::new();
    for (name, mesh, bound) in shown {
        let skin = Some(dressing.skin(&bound));
        meshes.push(MeshObject { name, mesh, motion, skin });
        dressing.bound.push(if whole { Vec::new() } else { bound });
    }
    let riding =
        |leaves: &Vec<usize>| InstancerMotion::Joints(leaves.iter().map(|i| dressing.joint(&boughs, *i)).collect());
    let instancers = groups
        .iter()
        .zip(&dressing.groups)
        .map(|((o, organs), leaves)| instancer(plant, kind, *o, organs, riding(leaves)));
    let asset = Asset {
        id: individual.asset.clone(),
        kind: AssetKind::Plant,
        group: String::new(),
        skeleton: Some(dressing.skeleton()),
        instancers: instancers.collect(),
        meshes,
        points: Vec::new(),
        curves: Vec::new(),
    };
    let told = diagnostics(&boughs, &individual.asset, keys);
    Ok(RodPlantAsset { asset, boughs, dressing, told })
}

fn discretisation(
    plant: &Plant,
    recipe: &PlantRecipe,
    kind: &PlantMaterials,
    keys: &RodPlantKeys,
    g: f64,
) -> RodPlantParams {
    let radius = |proto: usize| {
        let organ =
            crate::bake::assets::plant_mesh::organ_of_prototype(plant, kind, proto).and_then(|o| recipe.organs.get(o));
        organ.and_then(stalk_radius).unwrap_or(DEFAULT_STALK_RADIUS)
    };
    let count = |n: u32| usize::try_from(n).unwrap_or(usize::MAX);
    RodPlantParams {
        wood: wood(&recipe.wood),
        gravity: g,
        shear: keys.shear_ratio,
        recovery: keys.recovery,
        flexibility: keys.compliance,
        stalk_young: keys.petiole_elasticity,
        stalk_radii: (0..plant.protos.len()).map(radius).collect(),
        stalk_radius: keys.petiole_radius,
        stalk_sections: count(keys.petiole_sections),
        sections: keys.sections.map(count),
        max_rod_radius: keys.thickest,
        max_sections: count(keys.max_sections),
        max_leaf_stalks: count(keys.max_leaves),
    }
}

fn diagnostics(boughs: &RodPlant, name: &str, keys: &RodPlantKeys) -> Vec<Diagnostic> {
    let mut told = Vec::new();
    if !boughs.has_rest_shape() {
        let text = format!("no shape was found from which the twigs of \"{name}\" hang as they grew");
        told.push(Diagnostic::about("S042", text).help("their own weight is left out; stiffer wood holds it"));
    }
    let [stems, leaves] = boughs.omitted_stems_and_leaves();
    if stems + leaves > 0 {
        let text = format!("{stems} twigs and {leaves} leaves of \"{name}\" are rigid with what they stand on");
        let now = format!("now {} and {}", keys.max_leaves, keys.max_sections);
        told.push(Diagnostic::about("S043", text).help(format!("raise rods.max_leaves and rods.max_sections, {now}")));
    }
    told
}

/// Stalks of some leaves as one mesh. They wear what their blades do, at the place where these begin.
fn petiole_mesh(
    plant: &Plant,
    boughs: &RodPlant,
    dressing: &SkinBinding,
    leaves: &[usize],
    first_material: u32,
) -> (Mesh, Vec<VertexBinding>) {
    let (mut mesh, mut bound) = (Mesh::default(), Vec::new());
    let rods = boughs.rods();
    for leaf in leaves {
        let Some(rod) = boughs.leaf_stalk(*leaf) else { continue };
        let base = rods.base_attachment(rod).map(|(on, frame)| (on, dressing.local(&frame)));
        let own = rods.sections(rod).map(|i| (i, dressing.rest[i]));
        let all: Vec<(usize, (Vec3, Quat))> = base.into_iter().chain(own).collect();
        let radius = rods.sections(rod).next().map_or(0.0, |i| narrow(rods.radius(i)) / dressing.stand.s.x);
        let station = |(k, (_, (p, q))): (usize, &(usize, (Vec3, Quat)))| TubeSection {
            joint: u16::try_from(k).unwrap_or(u16::MAX),
            p: *p,
            q: *q,
            r: radius,
        };
        let stations: Vec<TubeSection> = all.iter().enumerate().map(station).collect();
        let (mut tube, skin) = tube(&stations, STALK_TUBE);
        let proto = &plant.protos[usize::from(plant.organs[*leaf].proto)].mesh;
        tube.uvs.fill(at_foot(proto));
        let material = proto.subsets.first().map_or(0, |s| s.material) + first_material;
        mesh.append(&tube.with_material(material));
        bound.extend(skin.joints.iter().zip(&skin.weights).map(|(j, w)| {
            let sections = [j[0], j[1]].map(|k| all.get(usize::from(k)).map(|s| s.0));
            VertexBinding { sections, share: w[1] }
        }));
    }
    (mesh, bound)
}

/// Where on its maps a blade begins.
fn at_foot(mesh: &Mesh) -> Vec2 {
    let near = |best: usize, i: usize| if mesh.points[i].length() < mesh.points[best].length() { i } else { best };
    mesh.uvs.get((0..mesh.points.len()).fold(0, near)).copied().unwrap_or_default()
}

impl SkinBinding {
    fn new(boughs: &RodPlant, stand: Trs, most: usize) -> Self {
        let rods = boughs.rods();
        let mut all = Self {
            stand,
            jointed: Vec::new(),
            joints: vec![0; rods.len()],
            rest: Vec::new(),
            bound: Vec::new(),
            groups: Vec::new(),
        };
        all.rest = (0..rods.len()).map(|i| all.local(&rods.reference_frame(i))).collect();
        // Rods come wood first, so that with few joints it is leaves that share them.
        let mut carried = 0;
        for i in 0..rods.len() {
            let rod = rods.rod_of_section(i);
            let joint = if i + 1 < most.max(1) {
                all.jointed.push(i);
                u16::try_from(i + 1).unwrap_or(u16::MAX)
            } else if i == rods.sections(rod).start {
                rods.base_attachment(rod).map_or(0, |(on, _)| all.joints[on])
            } else {
                carried
            };
            carried = joint;
            all.joints[i] = joint;
        }
        all
    }

    /// A frame of the world in the asset's space.
    fn local(&self, f: &SectionFrame) -> (Vec3, Quat) {
        (self.place(f.p), self.turned(f.rotation()))
    }

    fn place(&self, p: DVec3) -> Vec3 {
        let back = self.stand.r.as_dquat().normalize().conjugate();
        (back * (p - self.stand.t.as_dvec3()) / f64::from(self.stand.s.x)).as_vec3()
    }

    fn turned(&self, q: DQuat) -> Quat {
        (self.stand.r.as_dquat().normalize().conjugate() * q).as_quat().normalize()
    }

    fn skeleton(&self) -> Skeleton {
        let root = Joint { name: "root".into(), parent: None, rest: Trs::IDENTITY };
        let section = |i: &usize| {
            let (t, r) = self.rest[*i];
            Joint { name: format!("s{i}"), parent: Some(0), rest: Trs { t, r, s: Vec3::ONE } }
        };
        Skeleton { joints: [root].into_iter().chain(self.jointed.iter().map(section)).collect() }
    }

    /// Joint that a leaf's blade follows.
    pub fn joint(&self, boughs: &RodPlant, leaf: usize) -> u16 {
        boughs.leaf_section(leaf).map_or(0, |section| self.joints[section])
    }

    /// Leaves of each instancer, as indices into the plant's organs.
    pub fn groups(&self) -> &[Vec<usize>] {
        &self.groups
    }

    fn skin(&self, bound: &[VertexBinding]) -> SkinWeights {
        let mut skin = SkinWeights::default();
        for b in bound {
            let [a, z] = b.sections.map(|s| s.map_or(0, |s| self.joints[s]));
            let (one, two) =
                if b.share > 0.5 { ((z, b.share), (a, 1.0 - b.share)) } else { ((a, 1.0 - b.share), (z, b.share)) };
            if a == z || two.1 <= 0.0 {
                skin.joints.push([one.0, 0, 0, 0]);
                skin.weights.push([1.0, 0.0, 0.0, 0.0]);
            } else {
                skin.joints.push([one.0, two.0, 0, 0]);
                skin.weights.push([one.1, two.1, 0.0, 0.0]);
            }
        }
        skin
    }

    /// The plant's mesh and leaves in the current pose of `rods`, which are those of `plant`.
    pub fn frame(&self, asset: &Asset, rods: &RodSystem, plant: &dyn RainTarget) -> AssetFrame {
        let now: Vec<(Vec3, Quat)> = (0..rods.len()).map(|i| self.local(&rods.section_frame(i))).collect();
        let joint = |i: &usize| Trs { t: now[*i].0, r: now[*i].1, s: Vec3::ONE };
        let meshes = asset.meshes.iter().zip(&self.bound);
        AssetFrame {
            pose: [Trs::IDENTITY].into_iter().chain(self.jointed.iter().map(joint)).collect(),
            meshes: meshes.map(|(m, bound)| self.posed_points(&m.mesh, bound, &now, rods)).collect(),
            instancers: self.groups.iter().map(|leaves| InstancerFrame::State(self.leaves(leaves, plant))).collect(),
            ..AssetFrame::default()
        }
    }

    fn leaves(&self, leaves: &[usize], plant: &dyn RainTarget) -> InstanceState {
        let blades: Vec<_> = leaves.iter().map(|i| plant.leaf_pose(*i)).collect();
        let back = self.stand.r.as_dquat().normalize().conjugate();
        let scale = f64::from(self.stand.s.x);
        InstanceState {
            positions: blades.iter().map(|b| self.place(b.position)).collect(),
            orientations: blades.iter().map(|b| self.turned(b.orientation)).collect(),
            velocities: blades.iter().map(|b| (back * b.velocity / scale).as_vec3()).collect(),
            angular_velocities: blades.iter().map(|b| (back * b.angular_velocity).as_vec3()).collect(),
            ..InstanceState::default()
        }
    }

    fn posed_points(&self, mesh: &Mesh, bound: &[VertexBinding], now: &[(Vec3, Quat)], rods: &RodSystem) -> MeshFrame {
        if bound.is_empty() {
            return MeshFrame::Same;
        }
        let back = self.stand.r.conjugate();
        let motions: Vec<(Vec3, Vec3)> = (0..rods.len())
            .map(|i| {
                let (v, spin) = rods.section_velocity(i);
                (back * v.as_vec3() / self.stand.s.x, back * spin.as_vec3())
            })
            .collect();
        let turns: Vec<Quat> = now.iter().zip(&self.rest).map(|(n, r)| n.1 * r.1.conjugate()).collect();
        let mut out = (Vec::new(), Vec::new(), Vec::new());
        for ((b, p), n) in bound.iter().zip(&mesh.points).zip(&mesh.normals) {
            let (mut place, mut normal, mut speed) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
            for (section, share) in b.sections.into_iter().zip([1.0 - b.share, b.share]) {
                let Some(s) = section else {
                    place += *p * share;
                    normal += *n * share;
                    continue;
                };
                let arm = turns[s] * (*p - self.rest[s].0);
                place += (now[s].0 + arm) * share;
                normal += (turns[s] * *n) * share;
                speed += (motions[s].0 + motions[s].1.cross(arm)) * share;
            }
            out.0.push(place);
            out.1.push(math::normalize_or(normal, *n));
            out.2.push(speed);
        }
        MeshFrame::Points { points: out.0, normals: out.1, velocities: out.2 }
    }
}

/// A plant on rods in a wind: asked for frames in order it goes on from the last.
#[derive(Debug)]
pub struct RodPlantMotion {
    start: RodPlant,
    dressing: SkinBinding,
    fps: f64,
    steps: u32,
    /// Steps before the first frame.
    before: u32,
    now: Mutex<Option<(RodPlant, u64)>>,
}

impl RodPlantMotion {
    /// In a wind that has blown for a while, unless the clip begins from rest.
    pub fn new(rod_plants: (RodPlant, SkinBinding), recipe: &PlantRecipe, air: &PlantWind, fps: f64) -> Self {
        let start = rod_plants.0.with_wind(Some(Arc::clone(&air.wind) as Arc<dyn Wind>));
        let steps = recipe.rods.as_ref().and_then(|k| k.substeps).unwrap_or_else(|| start.steps_per_frame(fps));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds of steps")]
        let before = if air.take.from_rest { 0 } else { (PRE_ROLL * fps).round() as u32 * steps };
        Self { start, dressing: rod_plants.1, fps, steps, before, now: Mutex::new(None) }
    }

    /// Frame `number` from the first.
    /// # Errors
    /// `Simulation` for rods that fly apart.
    fn evaluate(&self, asset: &Asset, number: u64) -> Result<AssetFrame> {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        let h = 1.0 / (self.fps * f64::from(self.steps));
        let (mut boughs, mut frames) = match now.take().filter(|n| n.1 <= number) {
            Some(state) => state,
            None => {
                let mut boughs = self.start.clone();
                for k in 0..self.before {
                    boughs.step((f64::from(k) - f64::from(self.before)) * h, h)?;
                }
                (boughs, 0)
            }
        };
        while frames < number {
            for k in 0..self.steps {
                boughs.step(frames as f64 / self.fps + f64::from(k) * h, h)?;
            }
            frames += 1;
        }
        let frame = self.dressing.frame(asset, boughs.rods(), &boughs);
        *now = Some((boughs, frames));
        Ok(frame)
    }
}

impl AssetMotion for RodPlantMotion {
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        self.evaluate(asset, time.index())
    }
}
