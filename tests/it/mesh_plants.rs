//! Artists' meshes that sway: the skeleton against the plant that the mesh was grown from, the mesh at rest and in the
//! wind, and what a file or a scene may do wrong.
#![allow(clippy::print_stdout, reason = "figures that documents quote")]
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    reason = "a test fails by panicking"
)]

use crate::common::grown;
use std::fmt::Write as _;
use std::path::Path;

use glam::Vec3;
use osier::bake::motion::evaluate_frame;
use osier::bake::scene::{AssembledScene, SceneOptions};
use osier::plant::Plant;
use osier::recipe::{Library, Recipe, Request, resolve};
use osier::scene::{Mesh, mesh_points};

const STILL: SceneOptions = SceneOptions::WITHOUT_GROUND;

fn scene(folder: &Path, text: &str) -> osier::Result<(Recipe, osier::diagnostic::Report)> {
    let library = Library::new(&folder.join("scene.toml"), &[]).expect("folder");
    resolve(&Request {
        name: "scene".into(),
        shown: "scene.toml".into(),
        text: text.into(),
        library,
        ..Request::default()
    })
}

fn built(folder: &Path, text: &str) -> AssembledScene {
    grown::stage(&scene(folder, text).expect("scene").0, STILL)
}

/// As the shortest numbers that read back as the same bits.
fn obj(mesh: &Mesh, name: &str) -> String {
    let mut text = format!("o {name}\n");
    mesh.points.iter().for_each(|p| writeln!(text, "v {} {} {}", p.x, p.y, p.z).expect("text"));
    for [a, b, c] in &mesh.triangles {
        writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).expect("text");
    }
    text
}

/// A tree of a table, its bark as a file, and the plant found in that.
fn there_and_back() -> (tempfile::TempDir, Plant, Plant) {
    let folder = tempfile::tempdir().expect("folder");
    let source = "[plants.tree]\nifs = \"sympodial.ifs.toml\"\n[plants.tree.tree]\nheight = 5\neps = 0.24\nleaf_density = 0\n[plants.tree.skin]\nflare = 0\n";
    let recipe = {
        let mut recipe = scene(folder.path(), source).expect("scene").0;
        grown::small(&mut recipe);
        recipe
    };
    let tree = grown::individuals(&recipe).remove(0);
    std::fs::write(folder.path().join("tree.obj"), obj(&tree.skin.mesh, "wood")).expect("file");
    let found = scene(folder.path(), "[plants.tree]\nmesh = \"tree.obj\"\n").expect("scene").0;
    let found = grown::individuals(&found).remove(0);
    (folder, tree.plant, found.plant)
}

fn length(plant: &Plant) -> f32 {
    // Within its parent's wood a branch is not seen.
    plant.axes.iter().map(|a| a.length - a.s_exposed).sum()
}

#[test]
fn a_grown_tree_read_back_has_its_skeleton() {
    let (_folder, own, found) = there_and_back();
    let (a, b) = (length(&own), length(&found));
    assert!((b / a - 1.0).abs() < 0.05, "length {b} for {a}");
    let main = |p: &Plant| p.axes.iter().filter(|x| x.order <= 1).count();
    assert_eq!(main(&found), main(&own), "axes of order 0 and 1");
    assert_eq!(found.axes.len(), own.axes.len());
    let trunk = |p: &Plant, y: f32| p.frame(&p.axes[0], y).r;
    for y in [0.2, 0.5] {
        let (a, b) = (trunk(&own, y), trunk(&found, y));
        assert!((b / a - 1.0).abs() < 0.1, "trunk {b} for {a} at {y}");
    }
}

/// Largest share by which an edge of the wood differs from its length at rest.
fn strain(rest: &Mesh, moved: &[Vec3]) -> f32 {
    let edges = rest.triangles.iter().flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]);
    let change = |[a, b]: [&u32; 2]| {
        let (a, b) = (*a as usize, *b as usize);
        // Shorter ones than a quarter of a millimetre are rounding.
        (moved[a].distance(moved[b]) - rest.points[a].distance(rest.points[b])).abs()
            / rest.points[a].distance(rest.points[b]).max(2.5e-4)
    };
    edges.map(change).fold(0.0, f32::max)
}

/// Bakes the tree of a mesh in the wind, checks that its foot stays and that no edge tears; returns how far its top moves, m, and
/// the number of its instances.
fn swayed(folder: &Path, mesh: &str, motion: &str) -> (f32, usize) {
    let text = format!(
        "[frames]\nend = 24\n[plants.tree]\nmesh = \"{mesh}\"\nmotion = \"{motion}\"\n[plants.tree.wood]\nstiffness = 0.3\n[wind]\nspeed = 9\n"
    );
    let stage = built(folder, &text).animated;
    let asset = &stage.scene.assets[0];
    let rest = &asset.meshes[0].mesh;
    let (low, high) = (rest.bounds().min.y, rest.bounds().max.y);
    let (mut tips, mut most) = (0.0_f32, 0.0_f32);
    for number in [1, 9, 17, 24] {
        let now = evaluate_frame(&stage.scene, &stage.motions, number, false).expect("a frame");
        let moved = mesh_points(asset, &asset.meshes[0], 0, &now.assets[0]).into_owned();
        most = most.max(strain(rest, &moved));
        for (p, q) in rest.points.iter().zip(&moved) {
            let way = p.distance(*q);
            assert!(p.y > low + 0.05 || way < 2e-3, "{mesh}, {motion}: the foot moves by {way} m at {p}");
            tips = if p.y > high - 0.1 { tips.max(way) } else { tips };
        }
    }
    assert!(most < 0.08, "{mesh}, {motion}: an edge changes by {:.1} %", most * 100.0);
    (tips, asset.instancers.iter().map(osier::scene::Instancer::len).sum())
}

#[test]
fn in_the_wind_the_foot_stays_the_tips_move_and_nothing_tears() {
    let folder = tempfile::tempdir().expect("folder");
    for motion in ["cache", "skin"] {
        let (tips, _) = swayed(folder.path(), "young-tree.obj", motion);
        assert!(tips > 0.02, "{motion}: the top moves by {tips} m alone");
    }
}

/// A tree of a .glb, here one that osier has written, with leaves as instances: it sways as the same tree of an OBJ.
#[test]
fn a_tree_of_a_glb_sways() {
    let folder = tempfile::tempdir().expect("folder");
    let source = folder.path().join("source.toml");
    let still = "[plants.tree]\nmesh = \"young-tree.obj\"\nmotion = \"still\"\n[[place]]\nplant = \"tree\"\n[ground]\nshow = false\n";
    std::fs::write(&source, still).expect("scene");
    let mut osier = assert_cmd::Command::cargo_bin("osier").expect("osier");
    let bake = ["-q", "bake", "source.toml", "-o", "out", "--formats", "glb"];
    osier.current_dir(folder.path()).args(bake).assert().success();
    std::fs::copy(folder.path().join("out/gltf/source.web.glb"), folder.path().join("tree.glb")).expect("a copy");
    let [(of_obj, leaves), (of_glb, same)] =
        ["young-tree.obj", "tree.glb"].map(|mesh| swayed(folder.path(), mesh, "cache"));
    println!("the top moves by {of_obj:.3} m from OBJ, by {of_glb:.3} m from glb; {leaves} and {same} leaves");
    assert_eq!(leaves, same);
    assert!(of_glb > 0.02 && (of_glb / of_obj - 1.0).abs() < 0.1, "{of_obj} {of_glb}");
}

#[test]
fn at_rest_the_wood_is_the_files_own_and_the_leaves_lie_where_they_lay() {
    let folder = tempfile::tempdir().expect("folder");
    let recipe = scene(folder.path(), "[plants.tree]\nmesh = \"young-tree.obj\"\n").expect("scene").0;
    let osier::recipe::Growth::Mesh(file, _) = &recipe.plants[0].growth else { panic!("a mesh") };
    let stage = grown::stage(&recipe, STILL).animated;
    let asset = &stage.scene.assets[0];
    let bits = |p: &Vec3| p.to_array().map(f32::to_bits);
    let all: std::collections::BTreeSet<[u32; 3]> = file.mesh.points.iter().map(bits).collect();
    assert!(asset.meshes[0].mesh.points.iter().all(|p| all.contains(&bits(p))));
    let leaves = &asset.instancers[0];
    assert!(leaves.ids.len() > 50 && leaves.prototypes.len() < leaves.ids.len(), "{}", leaves.prototypes.len());
    let mut count = asset.meshes[0].mesh.triangles.len();
    for (k, proto) in leaves.protos.iter().enumerate() {
        let mesh = &leaves.prototypes[*proto as usize].mesh;
        count += mesh.triangles.len();
        for v in mesh.points.iter().step_by(7) {
            let p = leaves.rest.positions[k] + leaves.rest.orientations[k] * (*v * leaves.scales[k]);
            let off = file.mesh.points.iter().map(|q| q.distance(p)).fold(f32::MAX, f32::min);
            assert!(off < 3e-4, "leaf {k}: {off} m off");
        }
    }
    assert_eq!(count, file.mesh.triangles.len(), "no triangle is lost");
}

#[cfg(feature = "parallel")]
#[test]
fn the_same_bits_at_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("folder");
    let text = "[frames]\nend = 8\n[plants.tree]\nmesh = \"young-tree.obj\"\nmotion = \"cache\"\n[wind]\nspeed = 9\n";
    let made = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| {
            let stage = built(folder.path(), text).animated;
            let now = evaluate_frame(&stage.scene, &stage.motions, 5, false).expect("a frame");
            let moved = mesh_points(&stage.scene.assets[0], &stage.scene.assets[0].meshes[0], 0, &now.assets[0]);
            moved.iter().flat_map(|p| p.to_array()).map(f32::to_bits).collect::<Vec<u32>>()
        })
    };
    let one = made(1);
    assert!([2, 5].iter().all(|n| made(*n) == one));
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    let folder = tempfile::tempdir().expect("folder");
    let card = "o card\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
    std::fs::write(folder.path().join("card.obj"), card).expect("file");
    let told = |text: &str| -> Vec<(String, String)> {
        let of = |report: osier::diagnostic::Report| {
            report.diagnostics.iter().map(|d| (d.code.to_owned(), d.message.clone())).collect()
        };
        match scene(folder.path(), text) {
            Ok((recipe, report)) if report.diagnostics.is_empty() => {
                let work = osier::bake::BakeContext {
                    limits: &osier::limits::Limits::default(),
                    cancel: &osier::progress::Cancel::default(),
                    progress: &osier::progress::Silent,
                    cache: None,
                };
                match osier::bake::scene::assemble_scene(&recipe, STILL, &work) {
                    Err(osier::Error::Input(report)) => of(*report),
                    Err(other) => panic!("{other}"),
                    Ok(built) => of(built.report),
                }
            }
            Ok((_, report)) => of(report),
            Err(osier::Error::Input(report)) => of(*report),
            Err(other) => panic!("{other}"),
        }
    };
    // A fault of the whole file has the place of the key that names it.
    std::fs::write(folder.path().join("empty.obj"), "v 0 0 0\n").expect("file");
    let Err(osier::Error::Input(report)) = scene(folder.path(), "[plants.t]\nmesh = \"empty.obj\"\n") else {
        panic!("an empty mesh is accepted")
    };
    let place = report.diagnostics[0].labels.first().map(|label| report.sources.position(label.0));
    assert!(report.to_string().contains("holds no triangle") && place.is_some_and(|p| p.line == 2), "{report}");
    let cases = [
        ("mesh = \"card.obj\"", "X018", "encloses no volume"),
        ("mesh = \"card.obj\"\n[plants.t.import]\nleaf_pattern = \"card\"", "X018", "has no wood"),
        ("mesh = \"cart.obj\"", "S005", "cart.obj"),
        ("mesh = \"card.stl\"", "S005", "another ending"),
        ("mesh = \"young-tree.obj\"\nsteps = 3", "S007", "steps has no effect on a mesh"),
        ("mesh = \"young-tree.obj\"\ngrammar = \"oak.l\"", "S007", "grammar has no effect"),
        ("mesh = \"young-tree.obj\"\n[plants.t.bark]\nkind = \"smooth\"", "S007", "bark has no effect"),
        ("mesh = \"young-tree.obj\"\n[plants.t.import]\nleaf_pattern = \" | \"", "S003", "names no word"),
        ("mesh = \"young-tree.obj\"\n[plants.t.import]\nspacing = 0", "S004", "spacing is 0"),
        ("mesh = \"young-tree.obj\"\n[plants.t.import]\nmesh_up = \"z\"", "S044", "m along -Z"),
        ("mesh = \"young-tree.obj\"\n[plants.t.import]\nmesh_scale = 100", "S045", "m large"),
        ("grammar = \"oak.l\"\n[plants.t.import]\nspacing = 1", "S007", "import has no effect"),
    ];
    for (text, code, part) in cases {
        let all = told(&format!("[plants.t]\n{text}\n"));
        assert!(all.iter().any(|(c, m)| c == code && m.contains(part)), "{text}: {all:?}");
    }
    assert!(
        told("[plants.t]\nmesh = \"young-tree.obj\"\n")
            .iter()
            .all(|(code, _)| !["S044", "S045"].contains(&code.as_str())),
        "it stands upright and is in metres"
    );
}

#[test]
fn colors_at_vertices_have_a_mean_where_they_are_not_shown() {
    let folder = tempfile::tempdir().expect("folder");
    let built = built(folder.path(), "[plants.tree]\nmesh = \"young-tree.obj\"\n[[place]]\nplant = \"tree\"\n");
    let scene = &built.animated.scene;
    let of = |leaf: bool| {
        let i = scene.materials.iter().position(|m| m.name.ends_with("_leaf") == leaf).expect("material");
        (scene.materials[i].base_color, scene.flat_color(u32::try_from(i).expect("few")))
    };
    let ((bark, brown), (leaf, green)) = (of(false), of(true));
    assert_eq!((bark, leaf), ([1.0; 3], [1.0; 3]), "colours at vertices are not darkened");
    assert!(brown[0] > brown[1] && brown[1] > brown[2] && brown[0] < 0.9, "{brown:?}");
    assert!(green[1] > green[0] && green[1] > green[2] && green[1] < 0.9, "{green:?}");
}
