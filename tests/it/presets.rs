//! Every preset at many seeds: clean meshes, nothing detached, on the ground, and the same bytes at any thread count.
//!
//! `OSIER_SEEDS` sets how many seeds, one for species and two for others by default; `tests/full.sh` asks for 64. `OSIER_PRESETS`
//! names the presets to judge, with commas; all by default.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "tests say what they measured"
)]

use crate::common::grown;
use std::collections::BTreeMap;

use crate::common::grown::Grown;
use glam::{DVec3, Vec3};
use osier::bake::scene::SceneOptions;
use osier::par::par_map;
use osier::plant::{Axis, Plant};
use osier::presets::{PRESETS, Preset};
use osier::scene::{Asset, Mesh, check_scene};

/// Triangles smaller than this count as empty, m^2.
const EMPTY: f64 = 1e-12;
/// Most of the triangles that may be empty or face against their normals; blades of grass that fall on the ground turn sharply, and
/// may have three times as many.
const BAD: f64 = 1e-3;
/// How far the nearest point of a part's first ring may stand out of its parent, as a share of the parent's radius there.
/// It is measured from the skeleton, and where the skeleton has a tight corner the tube leads an arc of 1.1 radii through it,
/// on whose inner side the tube's surface lies up to 0.45 radii (at a right angle) beyond the skeleton's.
const OUTSIDE: f32 = 0.2;
/// As [`OUTSIDE`] for plants of tens of thousands of branches that leave bent parents at small angles: the junction of a parent is a
/// straight line beside its bent skeleton, and a few of all of these branches begin there, near the foot of their parent.
const OUTSIDE_WHERE_PARENTS_BEND: f32 = 0.75;
/// How far an organ's pivot may be from the bark, m.
const LOOSE: f32 = 1e-3;
/// How far an organ's mesh may begin from its pivot, m, or as a share of its size: stalks are tubes around it.
const STALK: f32 = 3e-3;
const STALK_SHARE: f32 = 0.015;
/// How far a twig may reach below the ground, as a share of the height.
const DIPS: f32 = 0.05;

fn seeds() -> Option<u64> {
    std::env::var("OSIER_SEEDS").ok().map(|v| v.parse().expect("OSIER_SEEDS is a number"))
}

fn is_scene(preset: &Preset) -> bool {
    preset.name.ends_with(".toml") && !preset.name.ends_with(".ifs.toml")
}

/// Whether a scene has random draws: curves and tilings have none.
fn draws(scene: &Preset) -> bool {
    let named = |p: &&Preset| p.name.ends_with(".l") && scene.text.contains(p.name);
    let random = |p: &Preset| ["ran(", "choose(", "Seed:"].iter().any(|word| p.text.contains(word));
    let mut grammars = PRESETS.iter().filter(named).peekable();
    grammars.peek().is_none() || grammars.any(random)
}

/// Presets that grow plants: all but the tables and scenes of points, the pictures of layers, and landscapes and crowds,
/// whose plants are other presets' and take minutes once more.
fn growing() -> impl Iterator<Item = &'static Preset> {
    let points =
        |p: &Preset| p.text.contains("[clouds.") || p.name.ends_with(".ifs.toml") && !p.text.contains("branch");
    let crowd = |p: &Preset| p.text.contains("[sway]") && p.text.contains("individuals");
    let other =
        move |p: &Preset| points(p) || crowd(p) || p.text.contains("[[layer]]") || p.text.contains("[[scatter]]");
    // A vine grows round solids, as particle_shapes.rs judges. What an artist modelled is judged in mesh_plants.rs, catkins in catkin_model.rs, rods in the rooms of theirs.
    let modelled = |p: &Preset| {
        let others = ["\nmesh = ", "\n[catkin]", "\n[[rod]]", "\n[rain]", "\n[[solid]]"];
        p.name.ends_with(".obj") || others.iter().any(|t| p.text.contains(t))
    };
    // Habits are parameters of species, which scenes grow.
    let table = |p: &Preset| p.name.ends_with(".ifs") || p.name.ends_with(".species");
    let wanted = std::env::var("OSIER_PRESETS").ok();
    let named = move |p: &Preset| wanted.as_ref().is_none_or(|w| w.split(',').any(|name| name == p.name));
    PRESETS.iter().filter(move |p| !table(p) && !other(p) && !modelled(p) && named(p))
}

/// What was found in some meshes.
#[derive(Debug, Default, Clone, Copy)]
struct Triangles {
    all: u64,
    empty: u64,
    turned: u64,
}

impl Triangles {
    fn add(&mut self, mesh: &Mesh) {
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize].as_dvec3());
            let normal: DVec3 = t.iter().map(|i| mesh.normals[*i as usize].as_dvec3()).sum();
            let area = (b - a).cross(c - a) * 0.5;
            self.all += 1;
            self.empty += u64::from(area.length() < EMPTY);
            self.turned += u64::from(area.length() >= EMPTY && area.dot(normal) < 0.0);
        }
    }

    fn merge(&mut self, other: Self) {
        self.all += other.all;
        self.empty += other.empty;
        self.turned += other.turned;
    }

    fn share(&self) -> f64 {
        (self.empty + self.turned) as f64 / self.all.max(1) as f64
    }
}

/// What was found in one individual.
#[derive(Debug, Default, Clone, Copy)]
struct Figures {
    bark: Triangles,
    organs: Triangles,
    /// Farthest that a first ring stands out of its parent, as a share of the parent's radius.
    ring: f32,
    /// Farthest that an organ's pivot is from its axis' bark, m.
    pivot: f32,
    /// Farthest that an organ's mesh begins from its pivot, m.
    stalk: f32,
    /// Lowest pivot, m.
    low: f32,
}

impl Figures {
    fn merge(&mut self, other: Self) {
        self.bark.merge(other.bark);
        self.organs.merge(other.organs);
        self.ring = self.ring.max(other.ring);
        self.pivot = self.pivot.max(other.pivot);
        self.stalk = self.stalk.max(other.stalk);
        self.low = self.low.min(other.low);
    }
}

fn finite(what: &str, list: &[Vec3]) {
    assert!(list.iter().all(|v| v.is_finite()), "{what} are not finite");
}

fn all_finite(what: &str, asset: &Asset) {
    let prototypes = asset.instancers.iter().flat_map(|i| &i.prototypes).map(|p| &p.mesh);
    for mesh in asset.meshes.iter().map(|m| &m.mesh).chain(prototypes) {
        finite(&format!("{what}: points"), &mesh.points);
        finite(&format!("{what}: normals"), &mesh.normals);
        assert!(mesh.uvs.iter().all(|v| v.is_finite()), "{what}: texture coordinates are not finite");
        assert!(mesh.colors.iter().flatten().all(|v| v.is_finite()), "{what}: colours are not finite");
        let unit = |n: &Vec3| (n.length() - 1.0).abs() < 1e-3;
        assert!(mesh.normals.iter().all(unit), "{what}: normals of unit length");
    }
    for i in &asset.instancers {
        finite(&format!("{what}: pivots"), &i.rest.positions);
        finite(&format!("{what}: sizes"), &i.scales);
        assert!(i.rest.orientations.iter().all(|q| q.is_finite()), "{what}: turns of {} are not finite", i.name);
    }
}

/// Distance from the centreline of an axis and the radius there.
fn from_centreline(plant: &Plant, axis: &Axis, p: Vec3) -> (f32, f32) {
    let nodes = plant.nodes_of(axis);
    let segment = |i: usize| {
        let (a, b) = (plant.nodes.p[i], plant.nodes.p[i + 1]);
        let along = b - a;
        let t = ((p - a).dot(along) / along.length_squared().max(1e-20)).clamp(0.0, 1.0);
        (p.distance(a + along * t), plant.nodes.r[i] + t * (plant.nodes.r[i + 1] - plant.nodes.r[i]))
    };
    let all = (nodes.start..nodes.end - 1).map(segment);
    // Of a thick and a thin segment the one counts that the point is deepest in.
    all.min_by(|x, y| (x.0 - x.1).total_cmp(&(y.0 - y.1))).expect("an axis has segments")
}

/// How far the nearest points of the first rings stand out of their parents, as a share of the parents' radii, and where that is worst.
fn rings(g: &Grown) -> (f32, String) {
    let mut worst = (f32::NEG_INFINITY, String::new());
    for tube in &g.skin.tubes {
        let axis = &g.plant.axes[tube.axis as usize];
        let Some(parent) = g.plant.axes.get(axis.parent as usize) else { continue };
        // A tube begins with a ring and the middle of the disc that closes it, which the first triangle names.
        let first = g.skin.mesh.triangles[tube.triangles.0 as usize];
        let middle = first.into_iter().max().expect("three corners");
        let mut nearest = f32::MAX;
        let mut at = String::new();
        for p in tube.points.0..=middle {
            let (distance, radius) = from_centreline(&g.plant, parent, g.skin.mesh.points[p as usize]);
            // Near the foot of its parent a branch may begin inside of what bears the parent.
            let bearer = g.plant.axes.get(parent.parent as usize);
            let hidden = bearer.map(|axis| from_centreline(&g.plant, axis, g.skin.mesh.points[p as usize]));
            let out = ((distance - radius) / radius).min(hidden.map_or(f32::MAX, |(d, r)| (d - r) / r));
            if out < nearest {
                nearest = out;
                at = format!("axis {}, {distance} m from the centreline, radius {radius} m", tube.axis);
            }
        }
        if nearest > worst.0 {
            worst = (nearest, at);
        }
    }
    worst
}

/// How far organs' pivots stand from the bark, and their meshes from the pivots; the lowest pivot.
fn organs(g: &Grown) -> (f32, f32, f32) {
    let by_id: BTreeMap<u64, usize> = g.plant.organs.iter().enumerate().map(|(i, o)| (o.id, i)).collect();
    assert_eq!(by_id.len(), g.plant.organs.len(), "ids are unique");
    let shown: usize = g.asset.instancers.iter().map(osier::scene::Instancer::len).sum();
    assert_eq!(shown, by_id.len(), "every organ is shown");
    let (mut pivot, mut stalk, mut low) = (0.0_f32, 0.0_f32, f32::MAX);
    for i in &g.asset.instancers {
        let nearest = |m: &Mesh| m.points.iter().map(|p| p.length()).fold(f32::MAX, f32::min);
        let size = |m: &Mesh| m.bounds().size().max_element();
        let gaps: Vec<(f32, f32)> = i.prototypes.iter().map(|p| (nearest(&p.mesh), size(&p.mesh))).collect();
        for (k, id) in i.ids.iter().enumerate() {
            let organ = &g.plant.organs[by_id[id]];
            let site = g.plant.frame(&g.plant.axes[organ.axis as usize], organ.s);
            let position = i.rest.positions[k];
            pivot = pivot.max(position.distance(site.p) - site.r - organ.petiole);
            let (gap, size) = gaps[i.protos[k] as usize];
            stalk = stalk.max((gap - STALK_SHARE * size).max(0.0) * i.scales[k].x);
            low = low.min(position.y);
        }
    }
    (pivot, stalk, low)
}

fn judge(what: &str, g: &Grown, faults: &mut Vec<String>) -> Figures {
    all_finite(what, &g.asset);
    let bark = &g.asset.meshes[0].mesh;
    assert_eq!(bark.points, g.skin.mesh.points, "{what}: the asset shows the skin that is judged");
    let mut f = Figures { low: f32::MAX, ..Figures::default() };
    f.bark.add(bark);
    g.asset.instancers.iter().flat_map(|i| &i.prototypes).for_each(|p| f.organs.add(&p.mesh));
    let (ring, at) = rings(g);
    f.ring = ring;
    // Every segment of the third structure of the textbook's plants bends, and bears branches.
    let bends = g.leans || what.starts_with("textbook-plants");
    if ring > if bends { OUTSIDE_WHERE_PARENTS_BEND } else { OUTSIDE } {
        faults.push(format!("{what}: a part begins {ring} of its parent's radius outside of it: {at}"));
    }
    (f.pivot, f.stalk, f.low) = organs(g);
    assert!(f.pivot <= LOOSE, "{what}: an organ's pivot is {} m from the bark", f.pivot);
    assert!(f.stalk <= STALK, "{what}: an organ's mesh begins {} m from its pivot", f.stalk);
    f
}

/// Hardly a triangle is empty or turned.
fn clean(what: &str, g: &Grown, faults: &mut Vec<String>) {
    let (mut bark, mut organs) = (Triangles::default(), Triangles::default());
    bark.add(&g.asset.meshes[0].mesh);
    g.asset.instancers.iter().flat_map(|i| &i.prototypes).for_each(|p| organs.add(&p.mesh));
    for (part, t) in [("bark", bark), ("organs", organs)] {
        if t.share() > if g.blades { 3.0 * BAD } else { BAD } {
            faults.push(format!("{what}, {part}: {t:?}"));
        }
    }
}

/// A plant of a scene begins at the ground, goes on a little below it, and rises.
fn stands(what: &str, g: &Grown, faults: &mut Vec<String>) {
    for axis in g.plant.axes.iter().filter(|a| a.parent == osier::plant::NONE) {
        let foot = g.plant.nodes.p[axis.first as usize];
        assert!(foot.y.abs() < 1e-3, "{what}: the foot is at {foot}");
    }
    let roots = g.plant.axes.iter().filter(|a| a.parent == osier::plant::NONE).count();
    let bounds = g.asset.meshes[0].mesh.bounds();
    let (low, high) = (bounds.min.y, bounds.max.y);
    // A twig may touch uneven ground, but no limb grows into it.
    if low > 0.0 || low < -g.bury - DIPS * high {
        faults.push(format!("{what}: lowest bark at {low} m, highest at {high} m"));
    }
    // A lawn is wider than high.
    if roots == 1 && high < 0.4 * bounds.size().max_element() {
        faults.push(format!("{what}: it lies: {bounds:?}"));
    }
}

/// The points of all bark of a scene as one hash.
fn hash(grown: &[Grown]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for p in grown.iter().flat_map(|g| &g.skin.mesh.points) {
        p.to_array().iter().for_each(|v| {
            hasher.update(&v.to_le_bytes());
        });
    }
    hasher.finalize()
}

#[test]
fn every_preset_is_sound_at_every_seed() {
    let mut faults = Vec::new();
    for preset in growing() {
        // Trees of full age take most of the time, and their species are judged at several seeds by the tests of growth.
        let fewest = if preset.text.contains("\nspecies = ") { 1 } else { 2 };
        let all: Vec<u64> = (0..seeds().unwrap_or(fewest)).collect();
        let results = par_map(&all, |seed| {
            let grown = grown::individuals(&grown::recipe(preset, Some(*seed), false));
            let mut sum = Figures { low: f32::MAX, ring: f32::NEG_INFINITY, ..Figures::default() };
            let mut faults = Vec::new();
            for g in &grown {
                let what = format!("{}, seed {seed}, {}", preset.name, g.asset.id);
                sum.merge(judge(&what, g, &mut faults));
                clean(&what, g, &mut faults);
                // Curves and tilings stand in the air.
                if is_scene(preset) && !preset.text.contains("show = false") {
                    stands(&what, g, &mut faults);
                }
            }
            (sum, hash(&grown), faults)
        });
        let mut sum = results[0].0;
        results[1..].iter().for_each(|r| sum.merge(r.0));
        faults.extend(results.iter().flat_map(|r| r.2.clone()));
        println!("{}, {} seeds: {sum:?}", preset.name, all.len());
        if is_scene(preset) && draws(preset) {
            let different: std::collections::BTreeSet<&[u8]> =
                results.iter().map(|r| r.1.as_bytes().as_slice()).collect();
            assert_eq!(different.len(), all.len(), "{}: each seed grows something else", preset.name);
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// What is judged above is what `osier grow` writes: every kind of plant, of the species one broadleaf and one conifer, as all of them
/// take the same way.
#[test]
fn individuals_are_those_of_the_stage() {
    let other_species = |p: &Preset| p.text.contains("\nspecies = ") && !["cherry.toml", "pine.toml"].contains(&p.name);
    for preset in growing().filter(|p| !other_species(p)) {
        let mut recipe = grown::recipe(preset, Some(3), false);
        recipe.clip.end = recipe.clip.start;
        let scene = grown::stage(&recipe, SceneOptions::WITHOUT_GROUND).animated.scene;
        check_scene(&scene).unwrap_or_else(|e| panic!("{}: {e}", preset.name));
        let grown = grown::individuals(&recipe);
        assert_eq!(scene.assets.len(), grown.len(), "{}", preset.name);
        for (a, g) in scene.assets.iter().zip(&grown) {
            let (ours, theirs) = (&g.asset.meshes[0].mesh, &a.meshes[0].mesh);
            assert_eq!((&ours.points, &ours.triangles), (&theirs.points, &theirs.triangles), "{}", preset.name);
            for (x, y) in g.asset.instancers.iter().zip(&a.instancers) {
                assert_eq!((&x.rest, &x.ids, &x.protos), (&y.rest, &y.ids, &y.protos), "{}", preset.name);
            }
        }
    }
}
