//! Plants that sway in the wind while it rains: drops strike, load and wet them in the same bake.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "tests run the program, read its files and print what they measure"
)]

use crate::common::program;
use std::fs;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use crate::common::program::{arg, ends};
use crate::common::track_records::{records, word_number};

/// A sapling: a stem with six twigs of eight leaves each.
const SAPLING: &str = "Lsystem: sapling\nDerivation length: 0\nAxiom: !(0.03) F(0.8) \
    BOUGHS !(0.02) F(0.5)\nendlsystem\n";
/// Frames of the clip, and of those at its end over which means are taken.
const FRAMES: u64 = 48;
const LAST: u64 = 24;

/// Rain and its steps in one bake of the sapling.
#[derive(Clone, Copy)]
struct Storm {
    /// Whether drops fall.
    rains: bool,
    substeps: u32,
    seed: u32,
    /// More tables of the scene.
    more: &'static str,
}

impl Storm {
    /// Writes scene and grammar.
    fn write(self, dir: &Path) -> PathBuf {
        let leaves: String =
            (0..8).map(|k| format!("F(0.06) [/({}) &(55) ~l(1)]", 97 * k)).collect::<Vec<_>>().join(" ");
        let boughs: String = (0..6)
            .map(|k| format!("!(0.02) F(0.06) [/({}) &(70) !(0.006) F(0.1) !(0.004) {leaves}]", 137 * k))
            .collect::<Vec<_>>()
            .join(" ");
        fs::write(dir.join("sapling.l"), SAPLING.replace("BOUGHS", &boughs)).expect("grammar");
        let Self { rains, substeps, seed, more } = self;
        let text = format!(
            "seed = {seed}\n[frames]\nend = {FRAMES}\n[plants.p]\ngrammar = \"sapling.l\"\n[plants.p.leaf]\n\
             blade = \"elliptic\"\nsize = 0.1\n[[place]]\nplant = \"p\"\n[wind]\nmodel = \"gust\"\nspeed = 6\n\
             [maps]\nmax_mapped_leaves = 0\n[rain]\nfalls = {rains}\nrate_mm_per_h = 60\nsize_distribution = \"fixed\"\n\
             size_mm = 2\nspin_up_s = 1\nsubsteps = {substeps}\n{more}"
        );
        let file = dir.join("storm.toml");
        fs::write(&file, text).expect("scene");
        file
    }

    /// Bakes it as tracks and reads what its leaves did.
    fn bake(self, name: &str) -> Crown {
        let dir = tempfile::tempdir().expect("dir");
        let (file, out) = (self.write(dir.path()), dir.path().join(name));
        ends(0, &["-q", "bake", arg(&file), "-o", arg(&out), "--formats", "tracks"]);
        let fields = ["leaf", "volume", "wetness", "x", "y", "z", "qx", "qy", "qz", "qw"];
        let leaves = records(&out, "leaves.bin", &fields)
            .into_iter()
            .map(|(frame, f)| LeafAt {
                frame,
                leaf: f[0],
                volume: f[1],
                wetness: f[2],
                pivot: DVec3::new(f[3], f[4], f[5]),
                turn: DQuat::from_xyzw(f[6], f[7], f[8], f[9]).normalize(),
            })
            .collect();
        let struck = word_number(&out, "events", "struck");
        let hits = records(&out, "events.bin", &["what", "leaf"])
            .into_iter()
            .filter(|(_, e)| (e[0] - struck).abs() < 0.5)
            .map(|(frame, e)| (frame, e[1]))
            .collect();
        Crown { leaves, hits }
    }
}

/// A leaf at a frame.
struct LeafAt {
    frame: u64,
    leaf: f64,
    /// Water on it, m^3.
    volume: f64,
    wetness: f64,
    pivot: DVec3,
    turn: DQuat,
}

/// All leaves of a bake in the order of frames, and the frames and leaves of the impacts.
struct Crown {
    leaves: Vec<LeafAt>,
    hits: Vec<(u64, f64)>,
}

/// How a wet crown differs from a dry one in the same wind, over the last frames.
#[derive(Debug, Clone, Copy)]
struct Difference {
    /// Mean height that pivots have sunk, m.
    sag: f64,
    /// Root mean square of the angle between a leaf and the same leaf of the dry crown, radians.
    nod: f64,
    /// Mean water on a leaf, m^3.
    water: f64,
}

impl Crown {
    fn last_frames(&self) -> impl Iterator<Item = &LeafAt> {
        self.leaves.iter().filter(|leaf| leaf.frame > FRAMES - LAST)
    }

    fn difference(&self, dry: &Self) -> Difference {
        let mut sums = [0.0; 4];
        for (wet, dry) in self.last_frames().zip(dry.last_frames()) {
            assert!(wet.frame == dry.frame && (wet.leaf - dry.leaf).abs() < 0.5, "leaves in one order");
            let angle = wet.turn.angle_between(dry.turn);
            let add = [dry.pivot.y - wet.pivot.y, angle * angle, wet.volume, 1.0];
            sums.iter_mut().zip(add).for_each(|(sum, a)| *sum += a);
        }
        let [sag, square, water, count] = sums;
        Difference { sag: sag / count, nod: (square / count).sqrt(), water: water / count }
    }
}

const RAIN: Storm = Storm { rains: true, substeps: 8, seed: 3, more: "" };

/// Leaves without mass sway with their twigs; in rain and on rods they would have any speed.
#[test]
fn leaves_without_mass_are_rained_on() {
    let dir = tempfile::tempdir().expect("dir");
    let grammar =
        "Lsystem: leaf\nDerivation length: 0\nAxiom: !(0.01) F(0.4) [&(60) !(0.006) F(0.2) ~l(1)]\nendlsystem\n";
    fs::write(dir.path().join("leaf.l"), grammar).expect("grammar");
    for (name, rods) in [("sway", ""), ("rods", "[plants.p.rods]\n")] {
        let text = format!(
            "[frames]\nend = 6\n[plants.p]\ngrammar = \"leaf.l\"\n[plants.p.leaf]\nblade = \"elliptic\"\nsize = 0.1\n\
             [plants.p.wood]\nleaf_mass = 0\n{rods}[[place]]\nplant = \"p\"\n[maps]\nmax_mapped_leaves = 0\n[wind]\n\
             speed = 6\n[rain]\nrate_mm_per_h = 60\n[[rain.lying]]\nleaf = 0\n"
        );
        let (file, out) = (dir.path().join(format!("{name}.toml")), dir.path().join(name));
        fs::write(&file, text).expect("scene");
        ends(0, &["-q", "bake", arg(&file), "-o", arg(&out), "--formats", "csv"]);
    }
}

/// The wind moves the crown; where drops strike, leaves nod; water lies on them and weighs down their twigs.
#[test]
fn drops_shake_load_and_wet_a_plant_that_sways() {
    let dry = Storm { rains: false, ..RAIN }.bake("dry");
    let wet = RAIN.bake("wet");
    assert!(dry.hits.is_empty(), "{:?}", dry.hits);
    assert!(wet.hits.len() > 100, "{} impacts", wet.hits.len());
    let of_leaf = |crown: &Crown, k: usize| -> Vec<DVec3> {
        crown.leaves.iter().filter(|leaf| (leaf.leaf - k as f64).abs() < 0.5).map(|leaf| leaf.pivot).collect()
    };
    // The wind alone carries the leaves of the twigs' ends to and fro.
    let swings = (0..48).map(|k| {
        let path = of_leaf(&dry, k);
        path.iter().map(|p| p.distance(path[0])).fold(0.0, f64::max)
    });
    let widest = swings.fold(0.0, f64::max);
    assert!(widest > 0.01, "the crown moves by {widest} m");
    // A leaf that is struck turns further in that frame and the next than leaves that nothing has struck in the last half second.
    let turns = |pick: &dyn Fn(u64, f64) -> bool| {
        let angles: Vec<f64> = wet
            .leaves
            .iter()
            .zip(&dry.leaves)
            .filter(|(leaf, _)| leaf.frame > 1 && pick(leaf.frame, leaf.leaf))
            .map(|(wet, dry)| wet.turn.angle_between(dry.turn))
            .collect();
        angles.iter().sum::<f64>() / angles.len() as f64
    };
    let hit_within = |frames: u64, frame: u64, leaf: f64| {
        wet.hits.iter().any(|h| (h.1 - leaf).abs() < 0.5 && h.0 <= frame && h.0 + frames > frame)
    };
    let struck = turns(&|frame, leaf| hit_within(1, frame, leaf));
    let spared = turns(&|frame, leaf| frame > 12 && !hit_within(12, frame, leaf));
    println!("widest swing {widest:.3} m; turned by {struck:.4} struck, {spared:.4} spared");
    assert!(struck > 0.01 && struck > 3.0 * spared, "{struck} and {spared} radians");
    let difference = wet.difference(&dry);
    println!("{difference:?}");
    assert!(difference.water > 1e-9 && difference.sag > 1e-4, "{difference:?}");
    let wetness = wet.last_frames().map(|leaf| leaf.wetness).fold(0.0, f64::max);
    assert!(wetness > 0.05, "the wettest leaf: {wetness}");
}

/// Water, sag and nods are the same with twice and four times as many steps a frame within 10 %, as means of four seeds.
#[test]
#[ignore = "a minute; tests/full.sh runs it"]
fn a_storm_does_not_depend_on_its_steps() {
    let mean = |substeps: u32| {
        let mut sum = Difference { sag: 0.0, nod: 0.0, water: 0.0 };
        for seed in 1..=4 {
            let dry = Storm { rains: false, substeps, seed, ..RAIN }.bake("dry");
            let wet = Storm { substeps, seed, ..RAIN }.bake("wet").difference(&dry);
            sum = Difference { sag: sum.sag + wet.sag, nod: sum.nod + wet.nod, water: sum.water + wet.water };
        }
        sum
    };
    let coarse = mean(8);
    for substeps in [16, 32] {
        let fine = mean(substeps);
        let ratios = [fine.sag / coarse.sag, fine.nod / coarse.nod, fine.water / coarse.water];
        println!("{substeps} steps: sag, nod, water {ratios:.3?} of those of 8");
        assert!(ratios.iter().all(|r| (r - 1.0).abs() < 0.1), "{substeps}: {ratios:?}");
    }
}

/// Below a roof no drop strikes a plant that sways, and no leaf gets wet, at any frame rate; beside it they do.
#[test]
fn a_roof_shelters_a_swaying_plant_at_any_frame_rate() {
    let dir = tempfile::tempdir().expect("dir");
    for fps in ["12", "48"] {
        for (x, sheltered) in [("0", true), ("12", false)] {
            let file = RAIN.write(dir.path());
            let text = fs::read_to_string(&file).expect("scene");
            // The roof is wide enough for rain that slants in gusts of twice the mean.
            let roof = format!("[[solid]]\nname = \"roof\"\nat = [{x}, 2.2, 0]\nsize = [10, 0.1, 10]\n");
            fs::write(&file, format!("{text}\n{roof}")).expect("scene");
            let out = dir.path().join(format!("{fps}_{x}"));
            let fps = format!("frames.fps={fps}");
            ends(0, &["-q", "bake", arg(&file), "-o", arg(&out), "--formats", "tracks", "--set", &fps]);
            let [struck, wood] = ["struck", "wood"].map(|word| word_number(&out, "events", word));
            let events = records(&out, "events.bin", &["what"]);
            let hits = events.iter().filter(|(_, e)| [struck, wood].iter().any(|w| (e[0] - w).abs() < 0.5)).count();
            let water: f64 = records(&out, "leaves.bin", &["volume"]).iter().map(|(_, leaf)| leaf[0]).sum();
            assert_eq!((hits == 0, water <= 0.0), (sheltered, sheltered), "{fps}, roof at {x}: {hits} hits, {water}");
        }
    }
}

/// All formats, at one and two threads, with maps, mesh drops and a skin.
#[test]
fn a_storm_gives_the_same_bytes_at_any_number_of_threads() {
    let dir = tempfile::tempdir().expect("dir");
    let file = Storm { more: "max_drop_meshes = 40\n", ..RAIN }.write(dir.path());
    let text = fs::read_to_string(&file).expect("scene").replace("max_mapped_leaves = 0", "max_mapped_leaves = 4");
    fs::write(&file, text.replace(&format!("end = {FRAMES}"), "end = 6")).expect("scene");
    let trees = ["1", "2"].map(|threads| {
        let out = dir.path().join(threads);
        ends(0, &["-q", "bake", arg(&file), "-o", arg(&out), "-j", threads, "--formats", "usd,pov,tracks,csv"]);
        program::tree(&out)
    });
    program::assert_same(&trees[0], &trees[1], "threads");
}

/// Drops darken the bark that they strike in every format that shows leaves wet: a map for each frame, wetter from frame to frame.
#[test]
fn drops_wet_bark_over_the_clip() {
    let dir = tempfile::tempdir().expect("dir");
    let file = RAIN.write(dir.path());
    let out = dir.path().join("wet");
    let bake = ["-q", "bake", arg(&file), "-o", arg(&out), "--formats", "usd,exr,pov", "--set", "frames.end=24"];
    ends(0, &bake);
    let manifest = fs::read_to_string(out.join("manifest.json")).expect("manifest");
    let manifest: serde_json::Value = serde_json::from_str(&manifest).expect("json");
    let materials = manifest["materials"].as_array().expect("materials");
    let bark = materials.iter().find(|m| m["name"] == "p_bark_struck").expect("wetted bark");
    assert_eq!(bark["class"], "bark");
    assert!((bark["params"]["wet_albedo"].as_f64().expect("albedo") - 0.55).abs() < 1e-6, "{bark}");
    let map = bark["maps"]["wetness"].as_str().expect("a map of wetness");
    assert_eq!(map, "maps/p_bark_struck/wetness.####.exr");
    let wetness = [1, 12, 24].map(|frame: u32| {
        let path = out.join(map.replace("####", &format!("{frame:04}")));
        let picture = exr::prelude::read_first_flat_layer_from_file(&path).expect("our maps open");
        let texels: Vec<f32> = picture.layer_data.channel_data.list[0].sample_data.values_as_f32().collect();
        texels.iter().map(|w| f64::from(*w)).sum::<f64>() / texels.len() as f64
    });
    println!("mean wetness of struck bark at frames 1, 12 and 24: {wetness:.3?}");
    assert!(
        wetness[0] > 0.01 && wetness[0] < wetness[1] && wetness[1] < wetness[2] && wetness[2] <= 1.0,
        "{wetness:?}"
    );
    // POV-Ray mixes dry and wet bark by the same map.
    let frame = fs::read_to_string(out.join("pov/frames/frame.0024.inc")).expect("frame");
    let picture = frame.lines().find(|line| line.contains("p_bark_struck/wetness.0024.png")).expect("a texture");
    assert!(picture.contains("uv_mapping image_pattern") && picture.contains("texture_map"), "{picture}");
}

/// Catkins hang from twigs where these are at that moment, in the rain as without it. None leaves in a wind of 6 m/s.
#[test]
fn catkins_hang_from_moving_twigs_in_the_rain() {
    const FLIGHT: &str = "[catkin]\n[flight]\nrelease = \"canopy\"\nrelease_speed = 60\ncount = 12\n";
    const RODS: &str = "[catkin]\n[flight]\nrelease = \"canopy\"\nrelease_speed = 60\ncount = 12\n[plants.p.rods]\n";
    let dir = tempfile::tempdir().expect("dir");
    let catkins = |scene: &Path, name: &str| {
        let out = dir.path().join(name);
        ends(0, &["-q", "bake", arg(scene), "-o", arg(&out), "--formats", "points", "--set", "frames.end=12"]);
        [6, 12].map(|frame| fs::read_to_string(out.join(format!("points/catkins_{frame:04}.csv"))).expect("catkins"))
    };
    let storm = Storm { rains: true, substeps: 8, seed: 1, more: FLIGHT };
    let scene = storm.write(dir.path());
    let text = fs::read_to_string(&scene).expect("scene");
    let wet = catkins(&scene, "wet");
    let dry = dir.path().join("dry.toml");
    fs::write(&dry, format!("{}{FLIGHT}", text.split("[rain]").next().expect("text"))).expect("scene");
    // The sway in the wind does not depend on the rain.
    assert_eq!(wet, catkins(&dry, "dry"));
    assert_ne!(wet[0], wet[1], "the twigs move");
    let on_rods = catkins(&Storm { more: RODS, ..storm }.write(dir.path()), "rods");
    assert_ne!(on_rods[0], on_rods[1], "the twigs move");
}

/// What hangs from a twig is written where the twig is at that frame, with its velocity, whatever the time step of the flight.
#[test]
fn catkins_hang_where_their_twigs_are_at_any_time_step() {
    let dir = tempfile::tempdir().expect("dir");
    let storm = Storm { rains: false, substeps: 8, seed: 1, more: "" }.write(dir.path());
    let dry = fs::read_to_string(storm).expect("scene").split("[rain]").next().expect("text").to_owned();
    let places = |substeps: u32| {
        let scene = dir.path().join("dry.toml");
        let flight = "[catkin]\n[flight]\nrelease = \"canopy\"\nrelease_speed = 60\ncount = 12\nspin_up_s = 0\n";
        fs::write(&scene, format!("{dry}{flight}substeps = {substeps}\n")).expect("scene");
        let out = dir.path().join(format!("{substeps}"));
        ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", "points"]);
        [11, 12, 24].map(|frame| fs::read_to_string(out.join(format!("points/catkins_{frame:04}.csv"))).expect("table"))
    };
    let [before, now, later] = places(1);
    assert_eq!(places(8), [before.clone(), now.clone(), later]);
    // Columns x, y, z and vx, vy, vz follow id, state and proto.
    let rows = |table: &str| -> Vec<[DVec3; 2]> {
        let row = |line: &str| {
            let v: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
            [DVec3::new(v[3], v[4], v[5]), DVec3::new(v[6], v[7], v[8])]
        };
        table.lines().skip(1).map(row).collect()
    };
    let (before, now) = (rows(&before), rows(&now));
    assert!(before.len() == 12 && now.len() == 12);
    for ([x0, _], [x1, v]) in before.iter().zip(&now) {
        // Six digits of a metre, twenty-four times a second.
        assert!(((*x1 - *x0) * 24.0).distance(*v) < 1e-3, "{v} from {x0} to {x1}");
    }
    assert!(now.iter().any(|[_, v]| v.length() > 0.01), "the twigs move");
}

/// Plants on rods have spun up in the wind when it begins to rain, unless they start from rest.
#[test]
fn plants_on_rods_are_in_motion_when_the_rain_begins() {
    let dir = tempfile::tempdir().expect("dir");
    let joints = |name: &str, wind: &str| {
        let scene = dir.path().join(format!("{name}.toml"));
        let text = format!(
            "[frames]\nend = 2\n[plants.twig]\ngrammar = \"rain-twig.l\"\n[plants.twig.rods]\n[[place]]\nplant = \"twig\"\n\
             [maps]\nmax_mapped_leaves = 0\n[rain]\nrate_mm_per_h = 0.2\n[wind]\n{wind}"
        );
        fs::write(&scene, text).expect("scene");
        let out = dir.path().join(name);
        ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", "points"]);
        let table = fs::read_to_string(out.join("points/joints_0001.csv")).expect("joints");
        let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let heads = lines.next().expect("heads");
        let columns = ["x", "y", "z"].map(|name| heads.iter().position(|head| *head == name).expect("column"));
        let place = |line: Vec<&str>| DVec3::from_array(columns.map(|k| line[k].parse().expect("number")));
        lines.map(place).collect::<Vec<_>>()
    };
    let calm = joints("calm", "model = \"calm\"\n");
    let farthest = |name: &str, more: &str| {
        let blown = joints(name, &format!("model = \"uniform\"\nspeed = 6\n{more}"));
        calm.iter().zip(&blown).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
    };
    // Without rain the twig is bent by 3.9 mm.
    assert!(farthest("moving", "") > 2e-3);
    assert!(farthest("rest", "[sway]\nstart = \"rest\"\n") < 1e-6);
    // In a wind that repeats, too: rods do not.
    assert!(farthest("rest_in_a_loop", "[sway]\nstart = \"rest\"\nloop = 2\n") < 1e-6);
}

/// Rain of the past wets a wall on the side that the wind comes from, a canopy on top, and the ground but for the places in their lee.
#[test]
fn earlier_rain_has_wetted_what_rain_reaches() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("yard.toml");
    let text = "[frames]\nend = 2\n[plants.p]\ngrammar = \"p.l\"\n[[place]]\nplant = \"p\"\nat = [-8, 0, 0]\n\
        [[solid]]\nname = \"wall\"\nsize = [0.4, 2, 6]\n[[solid]]\nname = \"canopy\"\nat = [8, 2, 0]\n\
        size = [4, 0.1, 4]\n[wind]\nmodel = \"uniform\"\nspeed = 5\n[rain]\nsize_distribution = \"fixed\"\nsize_mm = 2\n\
        [rain.wet]\nfilm = 1\n[ground]\nrelief = 0\n";
    fs::write(&scene, text).expect("scene");
    fs::write(dir.path().join("p.l"), "Lsystem: p\nDerivation length: 0\nAxiom: !(0.05) F(1)\nendlsystem\n")
        .expect("grammar");
    let out = dir.path().join("out");
    ends(0, &["bake", arg(&scene), "-o", arg(&out), "--formats", "obj"]);

    // The faces of an asset: centroid, area vector, whether the material is a wet one.
    let faces = |name: &str| {
        let text = fs::read_to_string(out.join(format!("obj/{name}.obj"))).expect("obj");
        let mut points: Vec<DVec3> = Vec::new();
        let (mut faces, mut wet) = (Vec::new(), false);
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.first().copied() {
                Some("v") => {
                    let number = |i: usize| words[i].parse::<f64>().expect("number");
                    points.push(DVec3::new(number(1), number(2), number(3)));
                }
                Some("usemtl") => wet = words[1].ends_with("_wet"),
                Some("f") => {
                    let corner =
                        |i: usize| points[words[i].split('/').next().expect("v").parse::<usize>().expect("v") - 1];
                    let [a, b, c] = [corner(1), corner(2), corner(3)];
                    faces.push(((a + b + c) / 3.0, (b - a).cross(c - a) / 2.0, wet));
                }
                _ => {}
            }
        }
        faces
    };
    // Wet share of the area of the faces that a condition chooses.
    let share = |name: &str, chosen: &dyn Fn(DVec3, DVec3) -> bool| {
        let faces = faces(name);
        let area = |wet_only: bool| -> f64 {
            let all = faces.iter().filter(|(p, a, wet)| chosen(*p, a.normalize()) && (*wet || !wet_only));
            all.map(|(_, a, _)| a.length()).sum()
        };
        area(true) / area(false)
    };
    // The wind blows along +X.
    assert!(share("wall", &|_, n| n.x < -0.9) > 0.999);
    assert!(share("wall", &|_, n| n.x > 0.9) < 1e-9);
    assert!(share("canopy", &|_, n| n.y > 0.9) > 0.999);
    // The ground's asset is centred under the plant at x = -8. The canopy's dry ground lies downwind of it by as much as drops drift in
    // 2 m of fall.
    let ground = |chosen: &dyn Fn(DVec3) -> bool| share("ground", &|p, _| chosen(p - DVec3::X * 8.0));
    assert!(ground(&|p| p.x > 7.8 && p.x < 11.2 && p.z.abs() < 1.8) < 0.01);
    // Drops of 2 mm fall at 6.5 m/s, so that the wall keeps 2 m x 5 / 6.5 = 1.53 m of the ground behind it dry.
    let wet = ground(&|p| p.x > 0.2 && p.x < 3.2 && p.z.abs() < 2.5);
    println!("wet share of the ground behind the wall: {wet:.3}");
    assert!((wet - (1.0 - 1.53 / 3.0)).abs() < 0.03, "{wet}");
    assert!(ground(&|p| p.x < -1.0 && p.x > -6.0) > 0.999);
}
