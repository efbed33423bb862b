//! Rods of a recipe: laid out, moved, and shown as tubes with joints.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DMat3, DVec3, Quat, Vec3};

use crate::bake::BakeContext;
use crate::bake::motion::{AssetMotion, FrameTime};
use crate::bake::wind::plant_wind::analytic_winds;
use crate::recipe::scene::{RodGravity, RodHold, RodIntegrator, RodKeys, RodLoadKeys, RodLoadKind};
use crate::recipe::{Recipe, RodRecipe};
use osier_base::Result;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::keyframes::Keyframes;
use osier_base::math;
use osier_motion::rods::{
    Actuation, AttachedBody, ClampKind, Integrator, MAX_GAUSS_SEIDEL_STIFFNESS, RecordingParams, RodDescription,
    RodMaterial, RodPose, RodSystem,
};
use osier_plants::surface::rod_tube::{CLOSE_UP, TubeSection, ball, tube};
use osier_scene::{
    Asset, AssetFrame, AssetKind, Joint, Material, MaterialClass, Mesh, MeshMotion, MeshObject, Skeleton, SkinWeights,
    Trs,
};
use osier_wind::Wind;

/// Density of the balls that weights are shown as, kg/m^3.
const WATER: f64 = osier_base::physics::WATER_DENSITY;

/// Rods that hang together, ready for the scene.
pub struct RodAsset {
    /// The asset.
    pub asset: Asset,
    /// Its materials; the asset names them from the number that was given.
    pub materials: Vec<Material>,
    /// What moves it; none in a still scene.
    pub motion: Option<RodMotion>,
}

/// Rods in every frame.
#[derive(Debug, Clone)]
pub struct RodMotion(Arc<Vec<RodPose>>);

impl RodMotion {
    /// The pose of frame `k` from the first.
    pub fn pose_at(&self, k: u64) -> AssetFrame {
        let k = usize::try_from(k).unwrap_or(usize::MAX).min(self.0.len().saturating_sub(1));
        AssetFrame { pose: self.0.get(k).map(pose).unwrap_or_default(), ..AssetFrame::default() }
    }
}

impl AssetMotion for RodMotion {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.pose_at(time.index()))
    }
}

/// Joint 0 stands still; then come sections, then weights.
fn pose(still: &RodPose) -> Vec<Trs> {
    let sections = still.sections.iter().map(|(t, r)| Trs { t: *t, r: *r, s: Vec3::ONE });
    [Trs::IDENTITY].into_iter().chain(sections).chain(still.bodies.iter().map(|p| Trs::translation(*p))).collect()
}

/// The ball that a weight is shown as.
struct WeightBall {
    shown: bool,
    radius: f64,
    color: [f32; 3],
}

/// Rods that hang together.
struct RodAssembly<'a> {
    members: Vec<&'a RodRecipe>,
    lines: Vec<RodDescription>,
    rods: RodSystem,
    acts: Vec<Actuation>,
    weights: Vec<WeightBall>,
}

/// All rods of a recipe, those that stand on each other as one asset. `draft`: they are counted, not moved; `first`: number
/// of the first material.
/// # Errors
/// `Simulation` for rods that fly apart, `Limit`, `Cancelled`.
pub fn build_rod_assets(
    recipe: &Recipe,
    draft: bool,
    first: u32,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<Vec<RodAsset>> {
    let wind = analytic_winds(recipe).filter(|_| recipe.blows());
    let roots = (0..recipe.rods.len()).filter(|i| recipe.rods[*i].on.is_none());
    let mut all = Vec::new();
    let mut material = first;
    for root in roots {
        let mut group = RodAssembly::new(recipe, root);
        group.tell(recipe.clip.fps(), report);
        // What turns freely hangs nowhere: it is drawn as it is without weight.
        let posed = group.members[0].keys.gravity == RodGravity::Posed && group.rods.is_anchored(0);
        if posed && !group.rods.find_rest_shape_by_equilibrium() {
            let text = format!("no shape was found from which rod \"{}\" hangs as it is drawn", group.members[0].id);
            report.push(
                Diagnostic::about("S042", text).help("its own weight is left out; gravity = \"droop\" lets it hang"),
            );
            group.rods.weightless = true;
        }
        let motion = match recipe.clip.len() {
            0 | 1 => None,
            _ if draft => Some(RodMotion(Arc::default())),
            _ => Some(group.record(recipe, wind.as_deref(), context)?),
        };
        let new = group.show(material, motion.is_some());
        material += u32::try_from(new.0.len()).unwrap_or(0);
        all.push(RodAsset { asset: new.1, materials: new.0, motion });
    }
    Ok(all)
}

impl<'a> RodAssembly<'a> {
    /// The rods that stand on `root`, and on those.
    fn new(recipe: &'a Recipe, root: usize) -> Self {
        let mut place = vec![None; recipe.rods.len()];
        let (mut members, mut lines): (Vec<&RodRecipe>, Vec<RodDescription>) = (Vec::new(), Vec::new());
        for (i, rod) in recipe.rods.iter().enumerate().skip(root) {
            let on = rod.on.and_then(|on| place[on]);
            if i == root || on.is_some() {
                place[i] = Some(members.len());
                let parent = on.map(|on: usize| (on, rod.keys.on_at * lines[on].length()));
                lines.push(line(&rod.keys, parent));
                members.push(rod);
            }
        }
        let mut holds = Vec::new();
        let mut acts = Vec::new();
        for (k, rod) in members.iter().enumerate() {
            for clamp in &rod.clamps {
                let hold = match clamp.hold {
                    RodHold::Fixed => ClampKind::Fixed,
                    RodHold::Pinned => ClampKind::Pinned,
                    RodHold::Guided => ClampKind::Guided(DVec3::from_array(clamp.line)),
                };
                if !clamp.keyframes.is_empty() {
                    acts.push(Actuation::Shift(holds.len(), keys(&clamp.keyframes)));
                }
                if !clamp.turn_keyframes.is_empty() {
                    let axis = DVec3::from_array(clamp.axis).normalize_or(DVec3::Y);
                    let turns = clamp.turn_keyframes.iter().map(|k| (k[0], [k[1]])).collect();
                    acts.push(Actuation::Turn(holds.len(), axis, Keyframes(turns)));
                }
                holds.push((k, clamp.at * lines[k].length(), hold));
            }
            if rod.on.is_none() && rod.clamps.is_empty() {
                holds.push((k, 0.0, ClampKind::Fixed));
            }
        }
        let mut rods = RodSystem::new(&lines, &holds);
        rods.gravity = -DVec3::Y * recipe.gravity();
        let mut group = Self { members, lines, rods, acts, weights: Vec::new() };
        group.load();
        group
    }

    /// Loads, weights and speeds of the start.
    fn load(&mut self) {
        let mut bodies = Vec::new();
        for (k, rod) in self.members.iter().enumerate() {
            for load in &rod.loads {
                let section = self.rods.nearest_section(k, load.at * self.lines[k].length());
                match load.kind {
                    RodLoadKind::Force => {
                        let wide = load.keyframes.iter().map(|k| (k[0], [k[1], k[2], k[3], 0.0, 0.0, 0.0])).collect();
                        self.acts.push(Actuation::Wrench(section, Keyframes(wide)));
                    }
                    RodLoadKind::Wrench => self.acts.push(Actuation::Wrench(section, keys(&load.keyframes))),
                    RodLoadKind::Blow => self.acts.push(Actuation::Impulse(section, keys(&load.keyframes))),
                    RodLoadKind::Mass => {
                        let most = load.keyframes.iter().fold(0.0, |m: f64, k| m.max(k[1]));
                        let radius = math::cbrt(3.0 * most / (4.0 * PI * WATER)).max(1e-4);
                        self.acts.push(Actuation::Mass(bodies.len(), keys(&load.keyframes)));
                        let mass = load.keyframes.first().map_or(0.0, |k| k[1]);
                        let (at, inertia) = (DVec3::ZERO, DMat3::ZERO);
                        bodies.push(AttachedBody { section, at, mass, inertia, of_plant: false, reach: radius });
                        self.weights.push(WeightBall { shown: load.show, radius, color: load.color });
                    }
                }
            }
        }
        let rods = std::mem::replace(&mut self.rods, RodSystem::new(&[], &[]));
        self.rods = rods.with_bodies(bodies);
        self.rods.weightless = self.members[0].keys.gravity == RodGravity::Compensated;
        for (k, rod) in self.members.iter().enumerate() {
            let (tip, length) = (DVec3::from_array(rod.keys.launch), self.lines[k].length());
            if tip != DVec3::ZERO {
                for i in self.rods.sections(k) {
                    self.rods.set_linear_velocity(i, tip * (self.rods.arc_length(i) / length));
                }
            }
        }
    }

    /// What the numbers of a rod cannot hold.
    fn tell(&self, fps: f64, report: &mut Report) {
        if self.limp(fps) {
            let text = format!(
                "rod \"{}\" is too stiff for single passes over its springs: it hangs limp",
                self.members[0].id
            );
            report.push(Diagnostic::about("S041", text).help("take integrator = \"xpbd\", or raise substeps"));
        }
        for (k, rod) in self.members.iter().enumerate() {
            let lost = self.rods.torsion_softening(k);
            // Of interest only where somebody twists it.
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

    /// Lets the clip pass.
    fn record(&mut self, recipe: &Recipe, wind: Option<&dyn Wind>, context: &BakeContext<'_>) -> Result<RodMotion> {
        let keys = &self.members[0].keys;
        let integrator = match keys.integrator {
            RodIntegrator::Xpbd => Integrator::Xpbd,
            RodIntegrator::XpbdGs => Integrator::XpbdGs,
            RodIntegrator::EulerSymplectic => Integrator::Symplectic,
            RodIntegrator::EulerExplicit => Integrator::Explicit,
        };
        let frames = u32::try_from(recipe.clip.len()).unwrap_or(u32::MAX);
        let drags: Vec<f64> = self.members.iter().map(|r| r.keys.drag).collect();
        let clip = RecordingParams {
            frames,
            first: recipe.clip.start,
            fps: recipe.clip.fps(),
            steps: keys.substeps,
            integrator,
            acts: std::mem::take(&mut self.acts),
            wind: wind.map(|wind| (drags, wind)),
            name: self.members[0].id.clone(),
        };
        Ok(RodMotion(Arc::new(self.rods.record_clip(&clip, context.cancel)?)))
    }

    /// Whether single passes over the springs let it hang limp.
    fn limp(&self, fps: f64) -> bool {
        let keys = &self.members[0].keys;
        let steps = keys.substeps.unwrap_or_else(|| self.rods.steps_per_frame(fps));
        keys.integrator == RodIntegrator::XpbdGs
            && self.rods.max_step_stiffness(1.0 / (fps * f64::from(steps))) > MAX_GAUSS_SEIDEL_STIFFNESS
    }

    /// Materials, and the asset with tubes and balls.
    fn show(&self, first: u32, moves: bool) -> (Vec<Material>, Asset) {
        let rest = RodPose {
            sections: (0..self.rods.len()).map(|i| self.drawn(i)).collect(),
            bodies: self.rods.bodies().iter().map(|b| self.drawn(b.section).0).collect(),
        };
        let joints = pose(&rest);
        let (mut materials, mut meshes) = (Vec::new(), Vec::new());
        let mut add = |name: String, color: [f32; 3], (mesh, skin): (Mesh, SkinWeights)| {
            let material = first + u32::try_from(materials.len()).unwrap_or(0);
            materials.push(Material::plain(name.clone(), MaterialClass::Bark, color, 0.6));
            let motion = if moves { MeshMotion::Skinned } else { MeshMotion::Still };
            meshes.push(MeshObject { name, mesh: mesh.with_material(material), motion, skin: moves.then_some(skin) });
        };
        for (k, rod) in self.members.iter().enumerate() {
            add(rod.id.clone(), rod.keys.color, tube(&self.stations(k), CLOSE_UP));
        }
        for (k, weight) in self.weights.iter().enumerate().filter(|(_, w)| w.shown) {
            let joint = u16::try_from(1 + rest.sections.len() + k).unwrap_or(0);
            let name = format!("{}_weight_{}", self.members[0].id, k + 1);
            add(name, weight.color, ball(rest.bodies[k], math::narrow(weight.radius), joint));
        }
        let named = |(i, t): (usize, &Trs)| Joint {
            name: if i == 0 { "root".into() } else { format!("s{i}") },
            parent: (i > 0).then_some(0),
            rest: *t,
        };
        let skeleton = moves.then(|| Skeleton { joints: joints.iter().enumerate().map(named).collect() });
        let asset = Asset {
            id: self.members[0].id.clone(),
            kind: AssetKind::Plant,
            group: String::new(),
            skeleton,
            meshes,
            instancers: Vec::new(),
            points: Vec::new(),
            curves: Vec::new(),
        };
        (materials, asset)
    }

    fn drawn(&self, i: usize) -> (Vec3, Quat) {
        let f = self.rods.reference_frame(i);
        (f.p.as_vec3(), f.rotation().as_quat().normalize())
    }

    /// Sections of a rod as the tube sees them; the base of one that rides on another follows that one's section.
    fn stations(&self, k: usize) -> Vec<TubeSection> {
        let joint = |i: usize| u16::try_from(i + 1).unwrap_or(u16::MAX);
        let base = self.rods.base_attachment(k).map(|(on, f)| TubeSection {
            joint: joint(on),
            p: f.p.as_vec3(),
            q: f.rotation().as_quat().normalize(),
            r: math::narrow(self.members[k].keys.radius[0]),
        });
        let own = self.rods.sections(k).map(|i| {
            let (p, q) = self.drawn(i);
            TubeSection { joint: joint(i), p, q, r: math::narrow(self.rods.radius(i)) }
        });
        base.into_iter().chain(own).collect()
    }
}

fn keys<const N: usize>(rows: &[Vec<f64>]) -> Keyframes<N> {
    let value = |k: &Vec<f64>, i: usize| k.get(i + 1).copied().unwrap_or(0.0);
    Keyframes(rows.iter().map(|k| (k[0], std::array::from_fn(|i| value(k, i)))).collect())
}

/// A rod as the solver wants it.
fn line(keys: &RodKeys, parent: Option<(usize, f64)>) -> RodDescription {
    let [r, tip] = keys.radius;
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
    // The radius falls evenly along the points.
    let mut along = vec![0.0];
    for p in points.windows(2) {
        along.push(along[along.len() - 1] + (p[1] - p[0]).length());
    }
    let whole = along[along.len() - 1];
    let radii = along.iter().map(|s| r + (tip - r) * s / whole).collect();
    RodDescription { points, radii, material, sections: keys.sections.and_then(|n| usize::try_from(n).ok()), parent }
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
        let made = build_rod_assets(&recipe, false, 3, &context, &mut report).expect("moves");
        (made, report.diagnostics.iter().map(|d| d.code).collect())
    }

    fn preset(name: &str) -> &'static str {
        crate::presets::find(name).expect("preset").text
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
        // The weight rides on its end until it is let go, after 0.98 s, and then falls.
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
