//! Rods of a recipe (`[[rod]]`): laid out, simulated through the clip, and displayed as tubes skinned to one joint per section.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DMat3, DVec3, Quat, Vec3};

use crate::bake::BakeContext;
use crate::bake::motion::{AssetMotion, FrameTime};
use crate::bake::scene::builder::SceneBuilder;
use crate::recipe::scene::{RodGravity, RodHold, RodIntegrator, RodKeys, RodLoadKeys, RodLoadKind};
use crate::recipe::{Recipe, RodRecipe};
use osier_base::Result;
use osier_base::convert::{index, narrow, to_usize};
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::keyframes::Keyframes;
use osier_base::math;
use osier_motion::rain::GroundHeight;
use osier_motion::rods::{
    Actuation, AttachedBody, Integrator, MAX_GAUSS_SEIDEL_STIFFNESS, RecordingParams, RodDescription, RodMaterial,
    RodSystem, RodSystemPose, SupportKind,
};
use osier_plants::surface::rod_tube::{CLOSE_UP, TubeSection, ball, tube};
use osier_scene::{
    Asset, AssetFrame, AssetKind, Joint, Material, MaterialClass, Mesh, MeshMotion, MeshObject, Skeleton, SkinWeights,
    Trs,
};
use osier_wind::{UniformWind, Wind};

/// Density of the ball that displays an attached weight, from which its radius is computed, kg/m^3.
const WEIGHT_DENSITY: f64 = osier_base::physics::WATER_DENSITY;

/// Connected rods as an asset, before it is added to the scene.
struct RodAsset {
    asset: Asset,
    /// One material per rod and per visible weight. The asset's meshes index them as if appended to the scene's materials so far.
    materials: Vec<Material>,
    /// The recorded motion; `None` in a still scene.
    motion: Option<RodMotion>,
}

/// Recorded poses of connected rods, one per frame.
#[derive(Debug, Clone)]
pub struct RodMotion(Arc<Vec<RodSystemPose>>);

impl RodMotion {
    /// Joint transforms at the `frame`-th frame of the clip; those of the last frame after it.
    pub fn pose_at(&self, frame: u64) -> AssetFrame {
        let pose = usize::try_from(frame).ok().and_then(|k| self.0.get(k)).or(self.0.last());
        AssetFrame { pose: pose.map(world_joint_transforms).unwrap_or_default(), ..AssetFrame::default() }
    }
}

impl AssetMotion for RodMotion {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.pose_at(time.index()))
    }
}

/// Transforms of the joints in world space: the fixed root, then one per section, then one per weight.
fn world_joint_transforms(pose: &RodSystemPose) -> Vec<Trs> {
    let sections = pose.sections.iter().map(|(t, r)| Trs { t: *t, r: *r, s: Vec3::ONE });
    [Trs::IDENTITY].into_iter().chain(sections).chain(pose.bodies.iter().map(|p| Trs::translation(*p))).collect()
}

/// The ball that displays an attached weight. Radius in metres, colour linear.
struct WeightBall {
    visible: bool,
    radius: f64,
    color: [f32; 3],
}

/// A rod that is clamped in the world and all rods that are attached to it, which are solved as one system.
struct ConnectedRods<'a> {
    /// The rod clamped in the world first; each other rod after the one to which it is attached.
    members: Vec<&'a RodRecipe>,
    /// The solver's descriptions of the rods, parallel to `members`.
    descriptions: Vec<RodDescription>,
    rods: RodSystem,
    actuations: Vec<Actuation>,
    weights: Vec<WeightBall>,
}

/// Adds the rods of a recipe to the scene. `wind`: wind that moves them; `None`: air at rest, which resists them. `ground`:
/// ground on which released weights come to rest; `estimating`: their motion is not simulated.
/// # Errors
/// `Simulation` for rods that diverge, `Limit`, `Cancelled`.
pub(crate) fn add_rods(
    recipe: &Recipe,
    wind: Option<&dyn Wind>,
    ground: &dyn GroundHeight,
    estimating: bool,
    builder: &mut SceneBuilder,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<()> {
    let first = index(builder.materials.len(), "materials of a scene")?;
    for mut new in build_rod_assets(recipe, wind, ground, estimating, first, context, report)? {
        builder.make_id_unique(&mut new.asset.id, "_rod");
        builder.materials.extend(new.materials);
        let motion = new.motion.map(|motion| Arc::new(motion) as Arc<dyn AssetMotion>);
        builder.add_placed(new.asset, Trs::IDENTITY, motion);
    }
    Ok(())
}

/// One asset for each rod clamped in the world with all rods attached to it. `first_material`: number of materials in the scene
/// so far.
fn build_rod_assets(
    recipe: &Recipe,
    wind: Option<&dyn Wind>,
    ground: &dyn GroundHeight,
    estimating: bool,
    first_material: u32,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<Vec<RodAsset>> {
    let roots = (0..recipe.rods.len()).filter(|i| recipe.rods[*i].on.is_none());
    let mut assets = Vec::new();
    let mut material = first_material;
    for root in roots {
        let mut group = ConnectedRods::new(recipe, root)?;
        group.report_stability(recipe.clip.fps(), report);
        // `gravity = "posed"`: find a rest shape that gravity bends into the drawn shape of the rod. A rod that can turn freely
        // has no such equilibrium; a rod without a solution is simulated without weight.
        let posed = group.members[0].keys.gravity == RodGravity::Posed && group.rods.is_anchored(0);
        if posed && !group.rods.find_rest_shape_by_equilibrium() {
            let text = format!("no shape was found from which rod \"{}\" hangs as it is drawn", group.members[0].id);
            report.push(
                Diagnostic::about("S042", text).help("its own weight is left out; gravity = \"droop\" lets it hang"),
            );
            group.rods.weightless = true;
        }
        // The search for the rest shape ends with rods at rest.
        group.launch();
        let motion = match recipe.clip.len() {
            0 | 1 => None,
            _ if estimating => Some(RodMotion(Arc::default())),
            _ => Some(group.simulate_clip(recipe, wind, ground, context)?),
        };
        let (materials, asset) = group.build_asset(material, motion.is_some())?;
        material += index(materials.len(), "materials of rods")?;
        assets.push(RodAsset { asset, materials, motion });
    }
    Ok(assets)
}

impl<'a> ConnectedRods<'a> {
    /// The rod `root` of the recipe and all rods that are attached to it, directly or through others.
    fn new(recipe: &'a Recipe, root: usize) -> Result<Self> {
        // A rod's base can only name a rod before it, so one pass from `root` on finds all members in order.
        let mut member_of = vec![None; recipe.rods.len()];
        let (mut members, mut descriptions): (Vec<&RodRecipe>, Vec<RodDescription>) = (Vec::new(), Vec::new());
        for (i, rod) in recipe.rods.iter().enumerate().skip(root) {
            let on = rod.on.and_then(|on| member_of[on]);
            if i == root || on.is_some() {
                member_of[i] = Some(members.len());
                let parent = on.map(|on: usize| (on, rod.keys.on_at * descriptions[on].spline_length()));
                descriptions.push(rod_description(&rod.keys, parent));
                members.push(rod);
            }
        }
        // Find the clamps, with the curves that move them. A rod in the world without a clamp is fixed at its base.
        let mut clamps = Vec::new();
        let mut actuations = Vec::new();
        for (k, rod) in members.iter().enumerate() {
            for clamp in &rod.clamps {
                let kind = match clamp.hold {
                    RodHold::Fixed => SupportKind::Fixed,
                    RodHold::Pinned => SupportKind::Pinned,
                    RodHold::Guided => SupportKind::Guided(DVec3::from_array(clamp.line)),
                };
                if !clamp.keyframes.is_empty() {
                    actuations.push(Actuation::Shift(clamps.len(), keyframes(&clamp.keyframes)));
                }
                if !clamp.turn_keyframes.is_empty() {
                    let axis = DVec3::from_array(clamp.axis).normalize_or(DVec3::Y);
                    let turns = clamp.turn_keyframes.iter().map(|k| (k[0], [k[1]])).collect();
                    actuations.push(Actuation::Turn(clamps.len(), axis, Keyframes(turns)));
                }
                clamps.push((k, clamp.at * descriptions[k].spline_length(), kind));
            }
            if rod.on.is_none() && rod.clamps.is_empty() {
                clamps.push((k, 0.0, SupportKind::Fixed));
            }
        }
        let mut rods = RodSystem::new(&descriptions, &clamps);
        rods.gravity = -DVec3::Y * recipe.gravity();
        let mut group = Self { members, descriptions, rods, actuations, weights: Vec::new() };
        group.apply_loads();
        Ok(group)
    }

    /// Adds the forces, impulses and weights of the loads.
    fn apply_loads(&mut self) {
        let mut bodies = Vec::new();
        for (k, rod) in self.members.iter().enumerate() {
            for load in &rod.loads {
                let section = self.rods.section_at_arc_length(k, load.at * self.descriptions[k].spline_length());
                match load.kind {
                    RodLoadKind::Force => {
                        let wrench = load.keyframes.iter().map(|k| (k[0], [k[1], k[2], k[3], 0.0, 0.0, 0.0])).collect();
                        self.actuations.push(Actuation::Wrench(section, Keyframes(wrench)));
                    }
                    RodLoadKind::Wrench => self.actuations.push(Actuation::Wrench(section, keyframes(&load.keyframes))),
                    RodLoadKind::Blow => self.actuations.push(Actuation::Impulse(section, keyframes(&load.keyframes))),
                    RodLoadKind::Mass => {
                        // Radius of a ball of water with the weight's largest mass: r^3 = 3 m / (4 pi rho).
                        let max_mass = load.keyframes.iter().fold(0.0, |m: f64, k| m.max(k[1]));
                        let radius = math::cbrt(3.0 * max_mass / (4.0 * PI * WEIGHT_DENSITY)).max(1e-4);
                        self.actuations.push(Actuation::Mass(bodies.len(), keyframes(&load.keyframes)));
                        let mass = load.keyframes.first().map_or(0.0, |k| k[1]);
                        let (at, inertia) = (DVec3::ZERO, DMat3::ZERO);
                        bodies.push(AttachedBody { section, at, mass, inertia, of_plant: false, reach: radius });
                        self.weights.push(WeightBall { visible: load.show, radius, color: load.color });
                    }
                }
            }
        }
        // The system is rebuilt with its bodies: their mass enters the section matrices.
        let rods = std::mem::replace(&mut self.rods, RodSystem::new(&[], &[]));
        self.rods = rods.with_added_bodies(bodies);
        self.rods.weightless = self.members[0].keys.gravity == RodGravity::Compensated;
    }

    /// Sets the initial velocities of the rods; must follow the search for a rest shape, which leaves them at rest. A launch
    /// velocity is that of the tip; it decreases linearly to zero at the base, as for a rod that turns about its base.
    fn launch(&mut self) {
        for (k, rod) in self.members.iter().enumerate() {
            let (tip, length) = (DVec3::from_array(rod.keys.launch), self.descriptions[k].spline_length());
            if tip != DVec3::ZERO {
                for i in self.rods.sections_of_rod(k) {
                    self.rods.set_section_velocity(i, tip * (self.rods.arc_length(i) / length));
                }
            }
        }
    }

    /// Warns if the Gauss-Seidel solver cannot hold the rods' stiffness (S041), and if the number of sections makes twisted
    /// rods too soft against torsion (S040).
    fn report_stability(&self, fps: f64, report: &mut Report) {
        if self.too_stiff_for_gauss_seidel(fps) {
            let text = format!(
                "rod \"{}\" is too stiff for single passes over its springs: it hangs limp",
                self.members[0].id
            );
            report.push(Diagnostic::about("S041", text).help("take integrator = \"xpbd\", or raise substeps"));
        }
        for (k, rod) in self.members.iter().enumerate() {
            let lost = self.rods.torsional_softening_ratio(k);
            // A rod without torsion needs no warning.
            let turns =
                |l: &RodLoadKeys| l.kind == RodLoadKind::Wrench && l.keyframes.iter().any(|k| k[4..] != [0.0; 3]);
            let twisted = rod.keys.torsional_stiffness.is_some() || rod.loads.iter().any(turns);
            if twisted && lost > 1.05 {
                let text = format!("rod \"{}\" is {lost:.1} times softer against twisting than its material", rod.id);
                let radii = "sections stand more than 3.4 radii apart";
                report.push(Diagnostic::about("S040", text).help(format!("{radii}: raise sections (up to 64)")));
            }
        }
    }

    /// Simulates the clip from rest, or from the launch velocities, and records the pose of every frame.
    fn simulate_clip(
        &mut self,
        recipe: &Recipe,
        wind: Option<&dyn Wind>,
        ground: &dyn GroundHeight,
        context: &BakeContext<'_>,
    ) -> Result<RodMotion> {
        let keys = &self.members[0].keys;
        let integrator = match keys.integrator {
            RodIntegrator::Xpbd => Integrator::Xpbd,
            RodIntegrator::XpbdGs => Integrator::XpbdGs,
            RodIntegrator::EulerSymplectic => Integrator::Symplectic,
            RodIntegrator::EulerExplicit => Integrator::Explicit,
        };
        let frames = index(recipe.clip.len(), "frames of a clip")?;
        let drags: Vec<f64> = self.members.iter().map(|r| r.keys.drag).collect();
        let clip = RecordingParams {
            frames,
            first: recipe.clip.start,
            fps: recipe.clip.fps(),
            steps: keys.substeps,
            integrator,
            acts: std::mem::take(&mut self.actuations),
            wind: Some((drags, wind.unwrap_or(&UniformWind(Vec3::ZERO)))),
            ground,
            name: self.members[0].id.clone(),
        };
        Ok(RodMotion(Arc::new(self.rods.record_clip(&clip, context.cancel)?)))
    }

    /// Whether the springs are too stiff for one Gauss-Seidel pass per step: the rod would sag under its weight.
    fn too_stiff_for_gauss_seidel(&self, fps: f64) -> bool {
        let keys = &self.members[0].keys;
        let steps = keys.substeps.unwrap_or_else(|| self.rods.steps_per_frame(fps));
        keys.integrator == RodIntegrator::XpbdGs
            && self.rods.max_step_stiffness_ratio(1.0 / (fps * f64::from(steps))) > MAX_GAUSS_SEIDEL_STIFFNESS
    }

    /// Materials and asset: a tube per rod and a ball per visible weight. `moves`: with skeleton and skin weights.
    fn build_asset(&self, first_material: u32, moves: bool) -> Result<(Vec<Material>, Asset)> {
        let rest = RodSystemPose {
            sections: (0..self.rods.len()).map(|i| self.rest_transform(i)).collect(),
            bodies: self.rods.bodies().iter().map(|b| self.rest_transform(b.section).0).collect(),
        };
        // One material per mesh. Skins address joints: the root, then the sections of all rods, then the weights.
        let joints = world_joint_transforms(&rest);
        let (mut materials, mut meshes) = (Vec::new(), Vec::new());
        let mut add = |name: String, color: [f32; 3], mesh: Mesh, skin: SkinWeights| -> Result<()> {
            let material = first_material + index(materials.len(), "materials of rods")?;
            materials.push(Material::plain(name.clone(), MaterialClass::Bark, color, 0.6));
            let motion = if moves { MeshMotion::Skinned } else { MeshMotion::Still };
            meshes.push(MeshObject { name, mesh: mesh.with_material(material), motion, skin: moves.then_some(skin) });
            Ok(())
        };
        for (k, rod) in self.members.iter().enumerate() {
            let (mesh, skin) = tube(&self.tube_sections(k)?, CLOSE_UP);
            add(rod.id.clone(), rod.keys.color, mesh, skin)?;
        }
        for (k, weight) in self.weights.iter().enumerate().filter(|(_, w)| w.visible) {
            // A ball follows the joint of its weight, after those of all sections.
            let joint = narrow(1 + rest.sections.len() + k, "joints of a rod")?;
            let name = format!("{}_weight_{}", self.members[0].id, k + 1);
            let (mesh, skin) = ball(rest.bodies[k], math::narrow(weight.radius), joint);
            add(name, weight.color, mesh, skin)?;
        }
        // Radii of the joints: 0 for the root, then those of sections and weights.
        let sections = (0..self.rods.len()).map(|i| math::narrow(self.rods.radius(i)));
        let radii = [0.0].into_iter().chain(sections).chain(self.weights.iter().map(|w| math::narrow(w.radius)));
        let named = |(i, (t, radius)): (usize, (&Trs, f32))| Joint {
            name: if i == 0 { "root".into() } else { format!("s{i}") },
            parent: (i > 0).then_some(0),
            rest: *t,
            radius,
        };
        let skeleton = moves.then(|| Skeleton { joints: joints.iter().zip(radii).enumerate().map(named).collect() });
        let asset = Asset {
            id: self.members[0].id.clone(),
            kind: AssetKind::Plant,
            group: String::new(),
            skeleton,
            meshes,
            instancers: Vec::new(),
            points: Vec::new(),
            curves: Vec::new(),
            rigged: None,
        };
        Ok((materials, asset))
    }

    /// World position, m, and rotation of section `i` at rest.
    fn rest_transform(&self, i: usize) -> (Vec3, Quat) {
        let f = self.rods.reference_frame(i);
        (f.p.as_vec3(), f.rotation().as_quat().normalize())
    }

    /// Cross sections of the tube of rod `k`. The first ring of an attached rod follows the joint of the section that it is
    /// attached to, so that no gap opens between the two.
    fn tube_sections(&self, k: usize) -> Result<Vec<TubeSection>> {
        let joint = |i: usize| narrow(i + 1, "joints of a rod");
        let base = self.rods.base_attachment(k).map(|(on, f)| {
            let (p, q) = (f.p.as_vec3(), f.rotation().as_quat().normalize());
            Ok(TubeSection { joint: joint(on)?, p, q, r: math::narrow(self.members[k].keys.radius[0]) })
        });
        let own = self.rods.sections_of_rod(k).map(|i| {
            let (p, q) = self.rest_transform(i);
            Ok(TubeSection { joint: joint(i)?, p, q, r: math::narrow(self.rods.radius(i)) })
        });
        base.into_iter().chain(own).collect()
    }
}

/// Converts rows of a time, s, and N values to keyframes; missing values are 0.
fn keyframes<const N: usize>(rows: &[Vec<f64>]) -> Keyframes<N> {
    let value = |k: &Vec<f64>, i: usize| k.get(i + 1).copied().unwrap_or(0.0);
    Keyframes(rows.iter().map(|k| (k[0], std::array::from_fn(|i| value(k, i)))).collect())
}

/// The solver's description of a rod. `parent`: index of the member to which it is attached, and the arc length there, m.
fn rod_description(keys: &RodKeys, parent: Option<(usize, f64)>) -> RodDescription {
    let [r, tip] = keys.radius;
    // Stiffnesses of a circular section: EI = E pi r^4 / 4 and GJ = G pi r^4 / 2, solved for the moduli of the material.
    let unit = PI * r * r * r * r;
    let young = keys.bending_stiffness.map_or(keys.elasticity, |ei| 4.0 * ei / unit);
    let shear = keys.torsional_stiffness.map_or(keys.shear_ratio, |gj| 2.0 * gj / unit / young);
    let material = RodMaterial {
        young: young / keys.compliance,
        shear,
        density: keys.density,
        damping_ratio: keys.damping_ratio,
        recovery: keys.recovery,
        spread_for_torsion: false,
    };
    let points: Vec<DVec3> = keys.points.iter().map(|p| DVec3::from_array(*p)).collect();
    // The radius tapers linearly in arc length.
    let mut along = vec![0.0];
    for p in points.windows(2) {
        along.push(along[along.len() - 1] + (p[1] - p[0]).length());
    }
    let whole = along[along.len() - 1];
    let radii = along.iter().map(|s| r + (tip - r) * s / whole).collect();
    RodDescription { points, radii, material, sections: keys.sections.map(to_usize), parent }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::{Request, resolve};
    use osier_base::limits::Limits;
    use osier_base::progress::{Cancel, Silent};

    fn built(text: &str, set: &[&str]) -> (Vec<RodAsset>, Vec<&'static str>) {
        let set = set.iter().map(|s| (*s).to_owned()).collect();
        let request = Request { name: "test".into(), text: text.into(), set, ..Request::default() };
        let (recipe, mut report) = resolve(&request).expect("a good scene");
        let (limits, cancel) = (Limits::default(), Cancel::default());
        let context = BakeContext { limits: &limits, cancel: &cancel, progress: &Silent, cache: None };
        let made = build_rod_assets(&recipe, None, &0.0, false, 3, &context, &mut report).expect("moves");
        (made, report.diagnostics.iter().map(|d| d.code).collect())
    }

    fn preset(name: &str) -> &'static str {
        crate::presets::find(name).expect("preset").text
    }

    #[test]
    fn a_launched_tip_starts_with_its_velocity_whatever_gravity_does() {
        let text = "[frames]\nend = 2\nfps = 1000\n[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\nlaunch = [2, 0, 0]\n";
        for gravity in ["posed", "droop", "compensated"] {
            let (made, _) = built(text, &[&format!("rod.0.gravity={gravity}")]);
            let pose = made[0].motion.as_ref().expect("a clip").pose_at(1).pose;
            let tip = pose.last().expect("joints").t;
            // 2 m/s for a thousandth of a second, and springs slow it down by less than a hundredth.
            assert!((0.00195..0.00201).contains(&tip.x), "{gravity}: {tip}");
        }
    }

    #[test]
    fn air_at_rest_slows_a_rod() {
        let text = "[frames]\nend = 72\n[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\nradius_mm = [2, 2]\n\
             damping_ratio = 0\ngravity = \"compensated\"\nlaunch = [3, 0, 0]\n";
        // Largest swing of the tip in the last second, without any wind in the scene.
        let swing = |drag: &str| {
            let (made, _) = built(text, &[drag]);
            let motion = made[0].motion.as_ref().expect("a clip");
            let tip = |k: u64| motion.pose_at(k).pose.last().expect("joints").t.x.abs();
            (48..72).map(tip).fold(0.0, f32::max)
        };
        let (free, slowed) = (swing("rod.0.drag=0"), swing("rod.0.drag=1.1"));
        assert!(free > 0.01 && slowed < 0.9 * free, "{slowed} of {free}");
    }

    #[test]
    fn a_pole_lifts_what_bends_it_and_lets_it_go() {
        let (made, told) = built(preset("pole.toml"), &[]);
        assert!(made.len() == 1 && told.is_empty(), "{told:?}");
        let new = &made[0];
        let joints = &new.asset.skeleton.as_ref().expect("moves").joints;
        assert_eq!((joints.len(), new.asset.meshes.len(), new.materials.len()), (1 + 17 + 1, 2, 2));
        let motion = new.motion.as_ref().expect("a clip");
        let poses: Vec<Vec<Trs>> = (0..72).map(|k| motion.pose_at(k).pose).collect();
        let chord = |p: &[Trs]| (p[17].t - p[1].t).length();
        let (drawn, least) = (chord(&poses[0]), poses.iter().map(|p| chord(p)).fold(f32::MAX, f32::min));
        assert!(least < 0.95 * drawn, "it bends: {least} of {drawn}");
        assert!(poses.iter().all(|p| (p[1].t - poses[0][1].t).length() < 1e-3), "its foot stays");
        // The weight follows the end of its rod until its release after 0.98 s, and then falls.
        let apart = |p: &[Trs]| (p[18].t - p[17].t).length();
        assert!(poses[..47].iter().all(|p| apart(p) < 1e-3) && apart(&poses[60]) > 0.2);
        let top = poses.iter().map(|p| p[18].t.y).fold(0.0, f32::max);
        assert!(top > 4.2 && poses[71][18].t.y < top - 0.5, "{top}");
    }

    #[test]
    fn a_struck_twig_hangs_as_drawn_swings_and_comes_back() {
        let (made, told) = built(preset("struck-twig.toml"), &["rod.0.load.0.keyframes=[[0.2,0,-0.022,0.012]]"]);
        assert!(made.len() == 1 && told.is_empty(), "side twigs are part of it: {told:?}");
        let motion = made[0].motion.as_ref().expect("a clip");
        let away = |k: u64| {
            let (now, drawn) = (motion.pose_at(k).pose, motion.pose_at(0).pose);
            now.iter().zip(&drawn).fold(0.0, |m: f32, (a, b)| m.max((a.t - b.t).length()))
        };
        assert!(away(4) < 5e-4, "it hangs: {}", away(4));
        let most = (5..20).map(away).fold(0.0, f32::max);
        assert!(most > 0.03 && away(71) < 0.2 * most, "{most} {}", away(71));
        for object in &made[0].asset.meshes {
            let skin = object.skin.as_ref().expect("moves");
            assert_eq!(skin.joints.len(), object.mesh.points.len());
            assert!(skin.weights.iter().all(|w| (w.iter().sum::<f32>() - 1.0).abs() < 1e-6 && w[0] >= w[1]));
        }
    }

    #[test]
    fn what_numbers_cannot_hold_is_told() {
        let rod = "[frames]\nend = 3\n[[rod]]\npoints = [[0, 1, 0], [0.4, 1, 0]]\ndamping_ratio = 0.1\n";
        assert_eq!(built(rod, &["rod.0.integrator=xpbd_gs"]).1, ["S041"]);
        let wrench = "[[rod.load]]\nkind = \"wrench\"\nkeyframes = [[0, 0, 0, 0, 0.01, 0, 0]]\n";
        assert_eq!(built(&format!("{rod}{wrench}"), &[]).1, ["S040"]);
        let heavy = "[[rod.load]]\nkind = \"mass\"\nkeyframes = [[0, 500]]\n";
        assert_eq!(built(&format!("{rod}{heavy}"), &[]).1, ["S042"]);
        assert!(built(rod, &["frames.end=1"]).0[0].asset.skeleton.is_none(), "a still scene has no joints");
    }
}
