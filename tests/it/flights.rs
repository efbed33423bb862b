//! Catkins in flight, through the program: what is refused, what is counted, what clients see, and that walls and wet
//! ground do what they are for.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "tests run the program, read its files and print what they measure"
)]

use crate::common::clients;
use crate::common::program::tree;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

fn osier(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_osier")).args(arguments).output().expect("osier runs")
}

const SCENE: &str = "seed = 5\n[frames]\nend = 48\n[ground]\nrelief = 0\n[catkin]\nhairs = 20\nlod = 2\n\
    [flight]\ncount = 200\nsize = [12, 6, 8]\nband = [0.02, 0.7]\nhumidity = 0.7\nstick_radius = 0.2\n\
    [[solid]]\nname = \"wall\"\nat = [1.5, 0, 0]\nsize = [0.3, 2, 6]\n\
    [[solid]]\nname = \"shed\"\nshape = \"house\"\nat = [-3, 0, 1]\nsize = [2, 1.5, 1.6]\nroof = 0.8\nturn_deg = 20\n\
    [wind]\nspeed = 2\n";

fn scene(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(format!("{name}.toml"));
    std::fs::write(&path, text).expect("scene");
    path
}

fn baked(folder: &Path, name: &str, scene: &Path, more: &[&str]) -> PathBuf {
    let out = folder.join(name);
    let fixed = ["-q", "bake", scene.to_str().expect("path"), "-o", out.to_str().expect("path")];
    let run = osier(&[&fixed, more].concat());
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    out
}

/// Columns of a bake's table by name.
fn table(out: &Path) -> BTreeMap<String, Vec<f64>> {
    let text = std::fs::read_to_string(out.join("stats/flight.csv")).expect("table");
    let mut lines = text.lines();
    let name = |head: &str| head.split(' ').next().expect("name").to_owned();
    let names: Vec<String> = lines.next().expect("heads").split(',').map(name).collect();
    let mut columns: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        for (name, value) in names.iter().zip(line.split(',')) {
            columns.entry(name.clone()).or_default().push(if value.is_empty() {
                f64::NAN
            } else {
                value.parse().expect("a number")
            });
        }
    }
    columns
}

fn last(columns: &BTreeMap<String, Vec<f64>>, name: &str) -> f64 {
    *columns[name].last().expect("a frame")
}

#[test]
fn each_fault_names_its_place_and_the_mend() {
    let dir = tempfile::tempdir().expect("dir");
    let cases = [
        ("points", "[flight]\nrelease = \"points\"\n", "S006", "points = \"FILE.csv\""),
        ("canopy", "[flight]\nrelease = \"canopy\"\n", "S006", "no plant in this scene"),
        ("band", "[flight]\nband = [0.9, 0.1]\n", "S004", "write [0.1, 0.9]"),
        ("form", "[flight]\nforms = { v7 = 1 }\n", "S005", "v0, v1, v2, v3, v4"),
        ("weight", "[flight]\nforms = { v1 = -1 }\n", "S004", "0 to 1e9"),
        ("key", "[flight]\nhumiditi = 1\n", "S002", "did you mean \"humidity\"?"),
        ("wet", "[flight]\nhumidity = 2\n", "S004", "0 to 1"),
        ("list", "[solid]\nname = \"wall\"\n", "S003", "[[solid]]"),
        ("mesh", "[[solid]]\nshape = \"mesh\"\n", "S006", "mesh = \"FILE.obj\""),
        ("shape", "[[solid]]\nshape = \"hose\"\n", "S003", "did you mean \"house\"?"),
        ("file", "[flight]\nrelease = \"points\"\npoints = \"bad.csv\"\n", "S003", "bad.csv:3"),
        ("head", "[flight]\nrelease = \"points\"\npoints = \"head.csv\"\n", "S003", "\"head.csv\" holds no position"),
    ];
    std::fs::write(dir.path().join("bad.csv"), "x,y,z\n1,2,3\n1,two,3\n").expect("points");
    std::fs::write(dir.path().join("head.csv"), "x,y,z\n").expect("points");
    for (name, text, code, words) in cases {
        let path = scene(dir.path(), name, text);
        let run = osier(&["check", path.to_str().expect("path")]);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(1), "{name}: {said}");
        assert!(said.contains(code) && said.contains(words), "{name}: {said}");
    }
}

/// A zone or a solid at the wrong place, as with the other sign of z, is told instead of counting nothing.
#[test]
fn places_beside_the_flight_are_told() {
    let dir = tempfile::tempdir().expect("dir");
    let zones = |far: &str| format!("[[flight.zone]]\nname = \"yard\"\nx = [2, 5]\nz = {far}\n");
    let wall = |x: f64| format!("[[solid]]\nname = \"fence\"\nat = [{x}, 0, 0]\nsize = [0.2, 1, 2]\n");
    let told = |name: &str, more: &str| {
        let path = scene(dir.path(), name, &format!("{SCENE}{more}"));
        String::from_utf8_lossy(&osier(&["check", path.to_str().expect("path")]).stderr).into_owned()
    };
    // The domain is 12 x 8 m, around the origin.
    let near = told("near", &format!("{}{}", zones("[3, 9]"), wall(6.05)));
    assert!(!near.contains("S007"), "{near}");
    let zone =
        "S007]: flight.zone \"yard\" covers no ground of the domain of the flight (x -6.0 to 6.0 m, z -4.0 to 4.0 m)";
    for (name, z) in [("far", "[4, 9]"), ("narrow", "[1, 1]")] {
        let far = told(name, &zones(z));
        assert!(far.contains(zone), "{far}");
    }
    let far = told("fence", &wall(6.2));
    assert!(far.contains("S007]: solid \"fence\" is outside of the domain of the flight"), "{far}");
    let sunk = told("sunk", &wall(2.0).replace("0, 0]\nsize", "-1.2, 0]\nsize"));
    assert!(sunk.contains("S007]: solid \"fence\" is below the domain of the flight (y from 0.0 m)"), "{sunk}");
    // With a lattice the domain is its box.
    let lattice = "model = \"lattice\"\n[wind.lattice]\ncells = [16, 12, 16]\ndx = 0.5\n";
    let far = told("box", &format!("{lattice}{}", wall(5.0)));
    assert!(far.contains("x -4.0 to 4.0 m, z -4.0 to 4.0 m") && far.contains("\"fence\" is outside"), "{far}");
}

/// On high and on low terrain the box stands on the ground: as many catkins land as at y = 0.
#[test]
fn the_box_of_a_flight_stands_on_terrain() {
    let dir = tempfile::tempdir().expect("dir");
    let landed = |y: i32| {
        let text = format!(
            "[frames]\nend = 48\n[catkin]\nhairs = 20\nlod = 2\n[wind]\nmodel = \"uniform\"\nspeed = 1\n\
             [terrain]\nsubdivisions = 3\nsize = 60\namplitude = 0\ncorners = [{y}, {y}, {y}, {y}]\nside = 64\n\
             [flight]\ncount = 200\nsize = [12, 6, 8]\nband = [0.02, 0.15]\nhumidity = 1\n"
        );
        let path = scene(dir.path(), &format!("land{y}"), &text);
        last(&table(&baked(dir.path(), &format!("out{y}"), &path, &["--formats", "csv"])), "deposits")
    };
    let [level, high, low] = [0, 60, -40].map(landed);
    assert!(level > 20.0 && (high - level).abs() < 3.0 && (low - level).abs() < 3.0, "{level} {high} {low}");
}

/// Catkins land on a wavy ground wherever the box of a lattice stands.
#[test]
fn the_ground_is_under_a_box_away_from_the_origin() {
    let dir = tempfile::tempdir().expect("dir");
    let landed = |x: u32| {
        let text = format!(
            "[frames]\nend = 48\n[ground]\nsize = 200\n[catkin]\nhairs = 20\nlod = 2\n[wind]\nmodel = \"lattice\"\nspeed = 1\n\
             [wind.lattice]\ncells = [16, 12, 16]\nat = [{x}, 0, 0]\n[flight]\ncount = 200\nband = [0.02, 0.15]\nhumidity = 1\n"
        );
        let path = scene(dir.path(), &format!("box{x}"), &text);
        last(&table(&baked(dir.path(), &format!("out{x}"), &path, &["--formats", "csv"])), "deposits")
    };
    let [here, there] = [0, 60].map(landed);
    assert!(here > 20.0 && (there / here - 1.0).abs() < 0.5, "{here} {there}");
}

/// Positions in a solid, in a wavy ground and outside of the domain are no starts, and the help names the key to change.
#[test]
fn catkins_without_a_start_are_counted_with_the_mend() {
    let dir = tempfile::tempdir().expect("dir");
    // The mark of the encoding, as spreadsheets write it, is no part of the first number.
    std::fs::write(dir.path().join("starts.csv"), "\u{feff}0,1,0\n5,-3,0\n5,9,0\n40,5,0\n").expect("points");
    let text = "[frames]\nend = 2\n[catkin]\nhairs = 20\nlod = 2\n[[solid]]\nsize = [4, 4, 4]\n\
        [flight]\nrelease = \"points\"\npoints = \"starts.csv\"\n";
    let path = scene(dir.path(), "starts", text);
    let out = dir.path().join("out");
    let run = osier(&["bake", path.to_str().expect("path"), "-o", out.to_str().expect("path"), "--formats", "csv"]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success() && said.contains("S026") && said.contains("2 catkins"), "{said}");
    assert!(said.contains("flight.points") && !said.contains("flight.band"), "{said}");
    assert!(said.contains("1 catkins start outside") && said.contains("flight.size"), "{said}");
    let columns = table(&out);
    assert!((last(&columns, "airborne") - 1.0).abs() < 0.5 && (last(&columns, "exited") - 3.0).abs() < 0.5);
}

/// Points of a PLY file, as other programs and osier itself write them, are starts as those of a text file are.
#[test]
fn catkins_start_at_the_points_of_a_ply_file() {
    let dir = tempfile::tempdir().expect("dir");
    std::fs::write(dir.path().join("starts.csv"), "0,5,0\n-3,4.5,1\n2,6,-2\n").expect("points");
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nend_header\n";
    let values = [0.0_f32, 5.0, 0.0, -3.0, 4.5, 1.0, 2.0, 6.0, -2.0];
    let bytes: Vec<u8> = header.bytes().chain(values.iter().flat_map(|v| v.to_le_bytes())).collect();
    std::fs::write(dir.path().join("starts.ply"), bytes).expect("points");
    std::fs::write(dir.path().join("broken.ply"), header).expect("points");
    let text = |file: &str| {
        format!(
            "[frames]\nend = 4\n[catkin]\nhairs = 20\nlod = 2\n[wind]\nspeed = 2\n[flight]\nrelease = \"points\"\n\
             points = \"{file}\"\n"
        )
    };
    let rows = |name: &str, file: &str| {
        let out = baked(dir.path(), name, &scene(dir.path(), name, &text(file)), &["--formats", "points"]);
        std::fs::read_to_string(out.join("points/catkins_0004.csv")).expect("table")
    };
    let of_text = rows("out_csv", "starts.csv");
    assert!(of_text.lines().count() == 4 && of_text == rows("out_ply", "starts.ply"), "{of_text}");
    let run = osier(&["check", scene(dir.path(), "broken", &text("broken.ply")).to_str().expect("path")]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(!run.status.success() && said.contains("S003") && said.contains("does not hold the 3 vertices"), "{said}");
}

/// A plant without branches has no twig that releases catkins, which is told.
#[test]
fn plants_without_twigs_release_nothing_with_a_warning() {
    let dir = tempfile::tempdir().expect("dir");
    for (name, branch, warns) in [("pole", "", true), ("tree", "[&(50) !(0.01) F(0.4)]", false)] {
        let grammar =
            format!("Lsystem: plant\nDerivation length: 0\nAxiom: !(0.03) F(0.8) {branch} F(0.3)\nendlsystem\n");
        std::fs::write(dir.path().join(format!("{name}.l")), grammar).expect("grammar");
        let text = format!(
            "[frames]\nend = 2\n[plants.p]\ngrammar = \"{name}.l\"\n[[place]]\nplant = \"p\"\n[catkin]\nhairs = 20\n\
             lod = 2\n[flight]\ncount = 9\nrelease = \"canopy\"\n"
        );
        let path = scene(dir.path(), name, &text);
        let run = osier(&["check", path.to_str().expect("path")]);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.success(), "{said}");
        assert_eq!(said.contains("S026") && said.contains("has a twig"), warns, "{name}: {said}");
    }
}

/// Catkins alone are a scene. A solid and a zone may have the names of columns that the table has without them.
#[test]
fn each_column_of_the_table_has_a_name_of_its_own() {
    let dir = tempfile::tempdir().expect("dir");
    let text = "[frames]\nend = 2\n[flight]\ncount = 5\n[[flight.zone]]\nname = \"wind\"\n\
        [[solid]]\nname = \"land\"\n";
    let path = scene(dir.path(), "names", text);
    let out = baked(dir.path(), "out", &path, &["--formats", "csv"]);
    let heads = std::fs::read_to_string(out.join("stats/flight.csv")).expect("table");
    let mut names: Vec<&str> = heads.lines().next().expect("heads").split(',').collect();
    assert!(names.contains(&"at_land") && names.contains(&"ground_wind_2"), "{names:?}");
    let count = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), count, "{names:?}");
}

/// Textures are drawn for the formats that have them, and change nothing else.
#[test]
fn bakes_of_numbers_alone_have_no_textures() {
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "numbers", SCENE);
    let short = ["--set", "frames.end=6", "--formats"];
    let bake = |formats: &str| tree(&baked(dir.path(), formats, &path, &[&short[..], &[formats]].concat()));
    let with = bake("usd,csv,exr,vdb");
    let textures =
        |files: &BTreeMap<String, Vec<u8>>| files.keys().filter(|path| path.starts_with("textures/")).count();
    assert!(textures(&with) >= 4 && with.contains_key("maps/ground/height.exr"));
    // Relief of the ground is a map of its own format, which refers to no texture.
    for (formats, kept) in [("csv", "stats/flight.csv"), ("vdb", "vdb/"), ("exr", "maps/ground/height.exr")] {
        let alone = bake(formats);
        assert_eq!(textures(&alone), 0, "{formats}");
        let mut same = with.iter().filter(|(path, _)| path.starts_with(kept)).peekable();
        assert!(same.peek().is_some(), "{formats}");
        // Tables have the same numbers; headers of other files hold the hash of the scene, which counts its formats.
        assert!(same.all(|(path, bytes)| alone.get(path).is_some_and(|own| own == bytes || !path.ends_with(".csv"))));
    }
    let plan = osier(&["-n", "--json", "bake", path.to_str().expect("path"), "--formats", "csv,points"]);
    let plan: serde_json::Value = serde_json::from_slice(&plan.stdout).expect("an estimate");
    let sizes = &plan["would_make"]["sizes"];
    assert!(sizes["points"].is_u64() && sizes["pictures"].is_null(), "{sizes}");
}

/// Nobody is lost, nobody is in anything, and the maps hold just those that lie.
#[test]
fn tables_and_maps_count_everybody() {
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "two", SCENE);
    let out = baked(dir.path(), "out", &path, &["--formats", "csv,exr", "--set", "flight.map_every=24"]);
    let columns = table(&out);
    let states = ["pending", "airborne", "grounded", "on_wall", "corner", "exited"];
    for (frame, deep) in columns["penetrations"].iter().enumerate() {
        let sum: f64 = states.iter().map(|s| columns[*s][frame]).sum();
        assert!((sum - 200.0).abs() < 0.5 && *deep < 0.5, "frame {frame}: {sum}");
    }
    // Means are of those that lie or fly; where none does, nothing is written.
    for frame in 0..columns["grounded"].len() {
        let lie = ["grounded", "on_wall", "corner"].iter().any(|s| columns[*s][frame] > 0.5);
        let is_there = |name: &str| !columns[name][frame].is_nan();
        assert!(["flight_time", "flight_distance", "flight_distance_50"].iter().all(|name| is_there(name) == lie));
        assert_eq!(is_there("mean_speed"), columns["airborne"][frame] > 0.5, "frame {frame}");
    }
    let lying = last(&columns, "grounded") + last(&columns, "on_wall") + last(&columns, "corner");
    assert!(lying > 10.0 && last(&columns, "merges") > 3.0, "{columns:?}");
    let maps: Vec<PathBuf> =
        std::fs::read_dir(out.join("maps/deposition")).expect("maps").map(|e| e.expect("entry").path()).collect();
    // The ground, roof and four sides of two solids; each at frames 1 and 25 and once more for the last.
    assert_eq!(maps.len(), 3 * 11, "{maps:?}");
    let mut sum = 0.0;
    for map in maps.iter().filter(|m| {
        m.to_string_lossy().matches('.').count() == m.parent().expect("dir").to_string_lossy().matches('.').count() + 1
    }) {
        let picture = exr::prelude::read_first_flat_layer_from_file(map).expect("our maps open");
        let layer = &picture.layer_data;
        let comment = layer.attributes.comments.as_ref().expect("a comment").to_string();
        let about: serde_json::Value = serde_json::from_str(&comment).expect("json");
        let area = about["texel_area_m2"].as_f64().expect("area");
        for value in layer.channel_data.list[0].sample_data.values_as_f32() {
            // A whole number but for the last bits of a quotient.
            let count = f64::from(value) * area;
            assert!((count - count.round()).abs() <= 1e-6 * count, "{count} in a texel of {}", map.display());
            sum += count.round();
        }
    }
    assert!((sum - lying).abs() < 0.5, "{sum} on maps, {lying} in the table");
    let plot = std::fs::read_to_string(out.join("stats/flight.svg")).expect("plot");
    assert!(plot.starts_with("<svg") && plot.matches("<polyline").count() == 14, "{plot}");
    let about: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("stats/flight.json")).expect("json")).expect("json");
    assert_eq!(about["parameters"]["count"], 200);
    // What is said once is what the rows say.
    assert!((about["last"]["grounded"].as_f64().expect("number") - last(&columns, "grounded")).abs() < 1e-9);
    assert!((about["totals"]["merges"].as_f64().expect("number") - last(&columns, "merges")).abs() < 1e-9);
    let mean = columns["airborne"].iter().sum::<f64>() / columns["airborne"].len() as f64;
    assert!((about["mean"]["airborne"].as_f64().expect("number") - mean).abs() < 1e-9);
    assert!(about["warnings"].as_array().expect("list").is_empty(), "{about}");
}

/// Sums of density times texel area over the maps of a folder, at the last frame, by the names of the maps.
fn map_sums(folder: &Path) -> BTreeMap<String, f64> {
    let mut sums = BTreeMap::new();
    for entry in std::fs::read_dir(folder).expect("maps") {
        let path = entry.expect("entry").path();
        let name = path.file_stem().expect("name").to_string_lossy().into_owned();
        let picture = exr::prelude::read_first_flat_layer_from_file(&path).expect("our maps open");
        let comment = picture.layer_data.attributes.comments.as_ref().expect("a comment").to_string();
        let about: serde_json::Value = serde_json::from_str(&comment).expect("json");
        let values = picture.layer_data.channel_data.list[0].sample_data.values_as_f32().map(f64::from);
        sums.insert(name, values.sum::<f64>() * about["texel_area_m2"].as_f64().expect("area"));
    }
    sums
}

/// Maps of landings hold every deposition, also of catkins that were lifted off again; columns count them by solid and by zone.
#[test]
fn landings_are_counted_once_each() {
    let dir = tempfile::tempdir().expect("dir");
    let zone = |name: &str, x: [f64; 2]| format!("[[flight.zone]]\nname = \"{name}\"\nx = {x:?}\nz = [-9, 9]\n");
    let zones = [zone("all", [-9.0, 9.0]), zone("left", [-9.0, -1.0]), zone("right", [-1.0, 9.0])].concat();
    let text = SCENE
        .replace("humidity = 0.7", "humidity = 0.05")
        .replace("end = 48", "end = 144")
        .replace("count = 200", "count = 600");
    let text = text.replacen("[[solid]]", &format!("{zones}[[solid]]"), 1);
    let path = scene(dir.path(), "landings", &text);
    let out = baked(dir.path(), "out", &path, &["--formats", "csv,exr", "--set", "flight.map_counts=landings"]);
    let columns = table(&out);
    let of = |name: &str| last(&columns, name);
    let lying = of("grounded") + of("on_wall") + of("corner");
    assert!(of("lift_offs") > 20.0 && of("deposits") > lying + 20.0, "{} deposits, {lying} at rest", of("deposits"));
    let sums = map_sums(&out.join("maps/landings"));
    let total: f64 = sums.values().sum();
    assert!((total - of("deposits")).abs() < 1e-3 * total, "{total} on maps, {} deposits", of("deposits"));
    // Both halves of the ground, which the ground's map shows as well.
    assert!(of("ground_left") > 5.0 && of("ground_right") > 5.0, "{columns:?}");
    assert!((of("ground_left") + of("ground_right") - of("ground_all")).abs() < 0.5);
    assert!((sums["ground"] - of("ground_all")).abs() < 1e-3 * total, "{} in {sums:?}", of("ground_all"));
    // What landed at a solid is on its maps, or in the corner between it and the ground.
    let is_of =
        |name: &str, solid: &str| name == format!("roof_{solid}") || name.starts_with(&format!("wall_{solid}_"));
    for solid in ["wall", "shed"] {
        let own: f64 = sums.iter().filter(|(name, _)| is_of(name, solid)).map(|(_, sum)| sum).sum();
        let landed = of(&format!("landed_{solid}"));
        assert!(own > 0.5 && own < landed + 0.5, "{solid}: {landed}, {sums:?}");
    }
    // Events add up; quantiles of the distance are in order about the mean.
    for name in ["landed_wall", "ground_all", "deposits"] {
        assert!(columns[name].windows(2).all(|w| w[0] <= w[1]), "{name}");
    }
    let [low, middle, high] = ["10", "50", "90"].map(|q| of(&format!("flight_distance_{q}")));
    assert!(0.0 < low && low < middle && middle < high && (low..high).contains(&of("flight_distance")), "{columns:?}");
    // The same scene maps those at rest by default.
    let rest = baked(dir.path(), "rest", &path, &["--formats", "csv,exr"]);
    let total: f64 = map_sums(&rest.join("maps/deposition")).values().sum();
    assert!((total - lying).abs() < 1e-3 * lying, "{total} on maps, {lying} at rest");
    // In milligrams, a catkin of scale 2 has four times the mass of one of scale 1.
    let mass = ["--set", "flight.map_of=mass", "--set", "flight.mass_mg=0.5", "--set", "flight.scale=[2,2]"];
    let heavy = baked(dir.path(), "heavy", &path, &[&["--formats", "csv,exr"][..], &mass].concat());
    let columns = table(&heavy);
    let lying: f64 = ["grounded", "on_wall", "corner"].iter().map(|name| last(&columns, name)).sum();
    let total: f64 = map_sums(&heavy.join("maps/deposition")).values().sum();
    assert!(lying > 5.0 && (total - 2.0 * lying).abs() < 1e-3 * total, "{total} mg on maps, {lying} at rest");
}

/// A lattice says how it did, and catkins that leap over its cells are told of: in the files, and by the program's end.
#[test]
fn a_lattice_says_how_it_did() {
    let dir = tempfile::tempdir().expect("dir");
    let text = "seed = 5\n[frames]\nend = 24\n[ground]\nrelief = 0\n[catkin]\nhairs = 2\n[flight]\ncount = 100\n\
        [[solid]]\nsize = [0.3, 1.6, 2]\n[wind]\nmodel = \"lattice\"\nspeed = 6\n[wind.lattice]\ncells = [32, 24, 24]\ndx = 0.2\n";
    let path = scene(dir.path(), "leaps", text);
    let out = dir.path().join("out");
    let (path, to) = (path.to_str().expect("path"), out.to_str().expect("path"));
    let run = osier(&["bake", path, "-o", to, "--formats", "csv", "--strict", "--json"]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.code() == Some(3) && said.contains("S027") && said.contains("flight.substeps"), "{said}");
    let summary: serde_json::Value = serde_json::from_slice(&run.stdout).expect("json");
    assert!(summary["seconds"]["writing frames"].as_f64().expect("a time") > 0.0, "{summary}");
    // The summary, here of a folder that is up to date, tells where the statistics are.
    let again = osier(&["bake", path, "-o", to, "--formats", "csv"]);
    let told = String::from_utf8_lossy(&again.stdout).into_owned();
    assert!(told.contains("tables       statistics (.csv, .json) and plots (.svg): "), "{told}");
    let columns = table(&out);
    assert!(last(&columns, "long_steps") > 10.0, "{columns:?}");
    assert!(columns["wind_mass_error"].iter().all(|e| e.abs() < 0.05 && *e != 0.0), "{columns:?}");
    assert!(columns["wind_checkered"].iter().any(|q| *q > 0.0) && columns["wind_clamps"].iter().all(|n| *n < 0.5));
    let told: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("stats/flight.json")).expect("json")).expect("json");
    assert!(told["warnings"].as_array().expect("list").iter().any(|w| w["code"] == "S027"), "{told}");
    // A sweep tells of it, too.
    let swept = dir.path().join("swept");
    let run = osier(&["bake", path, "-o", swept.to_str().expect("path"), "--seeds", "5", "--strict"]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.code() == Some(3) && said.contains("S027"), "{said}");
    assert!(said.contains("(first in the run with seed 5; sweep.csv has the numbers of all runs)"), "{said}");
    // Without a key there is no plot, and none is listed.
    let listed = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(listed.contains("sweep.json, maps/\n") && !swept.join("sweep.svg").exists(), "{listed}");
    let info = osier(&["info", swept.to_str().expect("path")]);
    let said = String::from_utf8_lossy(&info.stderr).into_owned();
    assert!(info.status.code() == Some(1) && said.contains("is a sweep"), "{said}");
    // Four steps a frame are short enough.
    let calm = ["--formats", "csv", "--strict", "--set", "flight.substeps=4"];
    let columns = table(&baked(dir.path(), "calm", Path::new(path), &calm));
    assert!(last(&columns, "long_steps") < 0.5, "{columns:?}");
}

#[test]
fn files_are_the_same_at_any_number_of_threads() {
    let dir = tempfile::tempdir().expect("dir");
    let text = SCENE.replace(
        "speed = 2",
        "speed = 2\nmodel = \"lattice\"\n[wind.lattice]\ncells = [48, 24, 32]\ndx = 0.25\nspin_up_s = 2",
    );
    let path = scene(dir.path(), "threads", &text);
    let all = ["-j1", "-j2", "-j8"].map(|jobs| {
        let out = baked(dir.path(), jobs, &path, &["--formats", "usd,csv,exr,pov", "--frames", "1-48:47", jobs]);
        let manifest = std::fs::read_to_string(out.join("manifest.json")).expect("manifest");
        let manifest: serde_json::Value = serde_json::from_str(&manifest).expect("json");
        manifest["bake_hash"].as_str().expect("hash").to_owned()
    });
    assert!(all[0] == all[1] && all[0] == all[2], "bytes depend on the number of threads");
}

/// Frames baked by themselves, as by a machine of a farm, have the bytes of those of the whole clip in every format with a file per frame.
#[test]
fn late_frames_alone_are_the_same() {
    let dir = tempfile::tempdir().expect("dir");
    let more = "map_every = 1\n[output.wind]\ntexel = 1\nvti_every = 1\n[[output.wind.slice]]\nacross = \"y\"\nat = 2\n[[solid]]";
    let path = scene(dir.path(), "late", &SCENE.replacen("[[solid]]", more, 1));
    let formats = ["--formats", "pov,exr,vdb,points"];
    let whole = tree(&baked(dir.path(), "whole", &path, &formats));
    let part = tree(&baked(dir.path(), "part", &path, &[&formats[..], &["--frames", "47-48"]].concat()));
    let late: Vec<&String> = part.keys().filter(|name| name.contains("0047.") || name.contains("0048.")).collect();
    for kind in
        ["pov/frames/", "maps/deposition/ground", "vdb/air", "vdb/flock", "points/catkins", "wind/box", "wind/y2"]
    {
        assert_eq!(late.iter().filter(|name| name.starts_with(kind)).count(), 2, "{kind} {late:?}");
    }
    late.iter().for_each(|name| assert!(whole.get(*name) == part.get(*name), "{name}"));
    // The manifests differ: each is that of its own frames. A list of all frames is the whole clip.
    let hash = |files: &BTreeMap<String, Vec<u8>>| -> serde_json::Value {
        let manifest: serde_json::Value = serde_json::from_slice(&files["manifest.json"]).expect("json");
        manifest["scene"]["hash"].clone()
    };
    assert_ne!(hash(&whole), hash(&part));
    let (scene, out) = (path.to_str().expect("path"), dir.path().join("whole"));
    let all = ["bake", scene, "-o", out.to_str().expect("path"), "--frames", "1-48"];
    let run = osier(&[&all[..], &formats].concat());
    assert!(String::from_utf8_lossy(&run.stderr).contains("is up to date"), "{run:?}");
}

/// Seeds that walls and wet ground are tried at: one, or as many as `OSIER_SEEDS` says, at most eight.
fn seeds() -> u64 {
    std::env::var("OSIER_SEEDS").map_or(1, |v| v.parse::<u64>().expect("OSIER_SEEDS is a number").min(8))
}

/// The flight of a still scene flies round a wall in a lattice as that of a clip does before its first frame.
#[test]
fn a_still_flight_meets_the_air_behind_a_wall() {
    let dir = tempfile::tempdir().expect("dir");
    let lattice = "model = \"lattice\"\nspeed = 2\n[wind.lattice]\ncells = [24, 12, 16]\ndx = 0.5\nspin_up_s = 2\n";
    let text = SCENE.replace("count = 200", "count = 200\nspin_up_s = 2").replace("speed = 2\n", lattice);
    let cloud = |name: &str, end: &str, file: &str| {
        let path = scene(dir.path(), name, &text.replace("end = 48", end));
        let out = baked(dir.path(), &format!("out_{name}"), &path, &["--formats", "ply"]);
        std::fs::read(out.join("cloud").join(file)).expect("points")
    };
    let still = cloud("still", "end = 1", "catkins.catkins.ply");
    assert!(still.len() > 1000 && still == cloud("clip", "end = 2", "catkins.catkins.0001.ply"));
}

/// The scene in a lattice wind, for two frames.
fn in_lattice_wind() -> String {
    let lattice = "model = \"lattice\"\nspeed = 2\n[wind.lattice]\ncells = [24, 12, 16]\ndx = 0.5\nspin_up_s = 0.5\n";
    SCENE.replace("end = 48", "end = 2").replace("speed = 2\n", lattice)
}

/// A wavy ground is a solid with columns of its own; a wall of four cells is warned of once.
#[test]
fn runs_of_a_sweep_may_differ_in_columns() {
    let dir = tempfile::tempdir().expect("dir");
    let (path, out) = (scene(dir.path(), "waves", &in_lattice_wind()), dir.path().join("sweep"));
    let [path, folder] = [&path, &out].map(|p| p.to_str().expect("path"));
    let run = osier(&["bake", path, "-o", folder, "--sweep", "ground.relief=0,0.1"]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success() && said.matches("\"wall\" is only 4.0 cells high").count() == 1, "{said}");
    let text = std::fs::read_to_string(out.join("sweep.csv")).expect("table");
    let rows: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
    assert!(rows.len() == 3 && rows.iter().all(|row| row.len() == rows[0].len()), "{text}");
    let at = |name: &str| rows[0].iter().position(|n| *n == name).expect("column");
    // All 200 are in the air or somewhere at rest, whatever the columns.
    for row in &rows[1..] {
        let count = |name: &&str| row[at(name)].parse::<u32>().expect("a number");
        let all = ["pending", "airborne", "grounded", "on_wall", "corner", "exited"];
        assert_eq!(all.iter().map(count).sum::<u32>(), 200, "{text}");
    }
    assert_eq!((rows[1][at("at_land")], rows[2][at("at_land")].parse::<u32>().is_ok()), ("", true), "{text}");
}

/// At its second place the wall crosses one of two periodic sides: the error comes before the first run and names its run.
#[test]
fn a_fault_of_a_late_value_of_a_sweep_costs_no_run() {
    let dir = tempfile::tempdir().expect("dir");
    let (path, out) = (scene(dir.path(), "moved", &in_lattice_wind()), dir.path().join("sweep"));
    let [path, folder] = [&path, &out].map(|p| p.to_str().expect("path"));
    let run = osier(&["bake", path, "-o", folder, "--sweep", "solid.0.at.2=0,2"]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.code() == Some(1) && said.contains("S039") && !out.exists(), "{said}");
    assert!(said.contains("; in the run with solid.0.at.2=2") && !said.contains("running"), "{said}");
}

/// The runs that were finished before a signal are whole rows, equal to those of a sweep of them alone.
#[cfg(unix)]
#[test]
fn an_interrupted_sweep_keeps_its_finished_runs() {
    use rustix::process::{Pid, Signal, kill_process};
    use std::io::{BufRead as _, BufReader};
    let dir = tempfile::tempdir().expect("dir");
    // A run has 24 frames; none of so many is the last when the signal comes.
    let path = scene(dir.path(), "swept", &SCENE.replace("end = 48", "end = 24"));
    let (path, out) = (path.to_str().expect("path"), dir.path().join("sweep"));
    let bake = ["bake", path, "-o", out.to_str().expect("path"), "--progress", "json", "--seeds", "1-200"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
    let mut child = command.args(bake).stderr(std::process::Stdio::piped()).spawn().expect("osier runs");
    let mut lines = BufReader::new(child.stderr.take().expect("stderr")).lines().map(|line| line.expect("text"));
    // The third run has begun when 50 frames are done.
    let frames_done = |line: &str| {
        let event: serde_json::Value = serde_json::from_str(line).expect("json");
        if event["stage"] == "running" { event["done"].as_u64() } else { None }
    };
    let mut said: Vec<String> = Vec::new();
    while said.last().and_then(|line| frames_done(line)).is_none_or(|done| done < 50) {
        said.push(lines.next().expect("progress"));
    }
    kill_process(Pid::from_child(&child), Signal::INT).expect("signal");
    said.extend(lines);
    assert_eq!(child.wait().expect("ends").code(), Some(130), "{said:?}");
    let text = std::fs::read_to_string(out.join("sweep.csv")).expect("table");
    let done = text.lines().count() - 1;
    assert!((2..200).contains(&done), "{text}");
    let kept = format!("{done} of 200 runs, to the one with seed {done}; missing are those from seed {} on", done + 1);
    assert!(said.iter().any(|line| line.contains(&kept)), "{said:?}");
    let told: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("sweep.json")).expect("json")).expect("json");
    let lengths = ["runs", "missing"].map(|name| told[name].as_array().expect("a list").len());
    assert_eq!(lengths, [done, 200 - done]);
    let (alone, seeds) = (dir.path().join("alone"), format!("1-{done}"));
    let run = osier(&["bake", path, "-o", alone.to_str().expect("path"), "--seeds", &seeds]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    assert_eq!(text, std::fs::read_to_string(alone.join("sweep.csv")).expect("table"));
}

/// Every choice of values with every seed is a row, that of a bake with the same; means go over the seeds.
#[test]
fn a_sweep_is_a_row_for_each_run() {
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "swept", &SCENE.replace("end = 48", "end = 24"));
    let (path, out) = (path.to_str().expect("path"), dir.path().join("sweep"));
    let choices = ["--sweep", "solid.0.size.1=0.5:2:2", "--sweep", "flight.humidity=0,1", "--seeds", "1-2"];
    let run = osier(&[&["bake", path, "-o", out.to_str().expect("path")][..], &choices].concat());
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let said = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(said.contains("8 runs") && said.lines().count() == 2 + 4, "{said}");
    let text = std::fs::read_to_string(out.join("sweep.csv")).expect("table");
    let rows: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
    assert!(rows.len() == 9 && rows[0][..3] == ["solid.0.size.1", "flight.humidity", "seed"], "{text}");
    assert_eq!(rows[8][..3], ["2.0", "1", "2"]);
    // A bake draws textures of full size, on which no number depends.
    let same = ["--formats", "csv", "--seed", "2", "--set", "solid.0.size.1=2.0", "--set", "flight.humidity=1"];
    let columns = table(&baked(dir.path(), "alone", Path::new(path), &same));
    for name in ["grounded", "exited", "merges", "deposits", "mean_speed"] {
        let at = rows[0].iter().position(|n| *n == name).expect("column");
        assert_eq!(rows[8][at].parse::<f64>().expect("number").to_bits(), last(&columns, name).to_bits(), "{name}");
    }
    let told: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("sweep.json")).expect("json")).expect("json");
    assert!(told["means"].as_array().expect("means").iter().all(|m| m["runs"] == 2), "{told}");
    let means = std::fs::read_to_string(out.join("means.csv")).expect("means");
    let means: Vec<Vec<&str>> = means.lines().map(|l| l.split(',').collect()).collect();
    assert!(means.len() == 5 && means[4][..3] == ["2.0", "1", "2"], "{means:?}");
    for name in ["deposits", "flight_distance_50", "landed_wall", "mean_grounded"] {
        let column = |head: &[&str], name: &str| head.iter().position(|n| *n == name).expect("column");
        let [a, b] = [7, 8].map(|i: usize| rows[i][column(&rows[0], name)].parse::<f64>().expect("number"));
        let of = |name: &str| means[4][column(&means[0], name)].parse::<f64>().expect("number");
        // Of two values: their mean, and their difference over the root of two.
        let close = |found: f64, wanted: f64| (found - wanted).abs() <= 1e-12 * wanted.abs();
        let deviation = of(&format!("{name}_deviation"));
        assert!(close(of(name), (a + b) / 2.0) && close(deviation, (a - b).abs() / 2.0_f64.sqrt()), "{name}: {a} {b}");
    }
    assert!(std::fs::read_to_string(out.join("sweep.svg")).expect("plot").matches("<polyline").count() == 12);
    // Maps over the seeds: the mean densities of all surfaces integrate to the mean number of catkins at rest.
    let choice = out.join("maps/03_2.0_1");
    let at_rest = |row: &[&str]| {
        let cell = |name| row[rows[0].iter().position(|n| *n == name).expect("column")].parse::<f64>().expect("number");
        cell("grounded") + cell("on_wall") + cell("corner")
    };
    let expected = (at_rest(&rows[7]) + at_rest(&rows[8])) / 2.0;
    let (mut sum, mut deviations) = (0.0, 0.0);
    for entry in std::fs::read_dir(&choice).expect("maps of a choice") {
        let path = entry.expect("entry").path();
        let name = path.file_name().expect("name").to_string_lossy().into_owned();
        if !name.ends_with(".exr") {
            assert!(name.ends_with("_mean.png"), "{name}");
            continue;
        }
        let picture = exr::prelude::read_first_flat_layer_from_file(&path).expect("our maps open");
        let comment = picture.layer_data.attributes.comments.as_ref().expect("a comment").to_string();
        let about: serde_json::Value = serde_json::from_str(&comment).expect("json");
        assert_eq!(about["runs"], 2);
        let values = picture.layer_data.channel_data.list[0].sample_data.values_as_f32().map(f64::from);
        let total = values.sum::<f64>() * about["texel_area_m2"].as_f64().expect("area");
        if name.ends_with("_mean.exr") { sum += total } else { deviations += total }
    }
    assert!(expected > 5.0 && (sum - expected).abs() < 1e-3 * expected, "{sum} against {expected}");
    // Catkins of two seeds rest in different texels.
    assert!(deviations > 0.5 * expected, "{deviations}");
    // Before anything is simulated, since the table is written after the last run.
    let (wall, taken) = (dir.path().join("wall"), dir.path().join("taken"));
    std::fs::write(&wall, "a file").expect("write");
    std::fs::create_dir(&taken).expect("folder");
    std::fs::write(taken.join("means.csv"), "mine").expect("write");
    let (below_wall, taken) = (wall.join("sweep"), taken.to_str().expect("path"));
    let below_wall = below_wall.to_str().expect("path");
    let refused: [(&[&str], i32, &str); 8] = [
        (&["bake", path, "--seeds", "1-2", "-o", below_wall], 74, "cannot create"),
        (&["bake", path, "--seeds", "1-2", "-o", taken], 1, "--force"),
        (&["bake", path, "--sweep", "flight.humidity=0,1,0"], 2, "has the value 0 twice"),
        (&["bake", path, "--sweep", "flight.humidity=0", "--sweep", "flight.humidity=1"], 2, "given twice"),
        (&["bake", path, "--sweep", "flight.humidity=0:1:3", "--formats", "usd"], 2, "leave out --formats"),
        (&["bake", path, "--sweep", "flight.humidity=0:1"], 2, "KEY=FROM:TO:COUNT"),
        (&["bake", path, "--sweep", "flight.humiditi=0,1"], 1, "did you mean \"humidity\"?"),
        (&["bake", "koch", "--seeds", "1-2"], 2, "[flight]"),
    ];
    for (arguments, code, words) in refused {
        let run = osier(arguments);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.code() == Some(code) && said.contains(words), "{arguments:?}: {said}");
        assert!(!said.contains("running"), "{arguments:?}: {said}");
    }
}

/// A wall of so many metres in a lattice wind, on ground so wet.
fn wall_scene(height: f64, humidity: f64) -> String {
    format!(
        "[frames]\nend = 192\n[ground]\nrelief = 0\n[catkin]\nhairs = 2\n[flight]\ncount = 600\nband = [0.02, 0.6]\n\
         sides = \"exit\"\nhumidity = {humidity}\nstick_radius = 0\n[[solid]]\nat = [0, 0, 0]\nsize = [0.5, {height}, 9]\n\
         [wind]\nmodel = \"lattice\"\nspeed = 2\n[wind.lattice]\ncells = [48, 28, 48]\ndx = 0.25\n"
    )
}

/// The table of a bake of such a scene.
fn behind_a_wall(folder: &Path, (height, humidity): (f64, f64), seed: u64) -> BTreeMap<String, Vec<f64>> {
    let text = wall_scene(height, humidity);
    let name = format!("h{height}_w{humidity}_s{seed}");
    let path = scene(folder, &name, &text);
    table(&baked(folder, &format!("{name}_out"), &path, &["--formats", "csv", "--seed", &seed.to_string()]))
}

/// In the air of a lattice: the higher the wall, the fewer get past it and out of the box.
#[test]
fn higher_walls_stop_more() {
    let dir = tempfile::tempdir().expect("dir");
    for seed in 1..=seeds() {
        let passed = [0.05, 1.1, 1.6, 2.1, 2.6].map(|h| last(&behind_a_wall(dir.path(), (h, 0.8), seed), "exited"));
        assert!(passed.windows(2).all(|p| p[0] > p[1]), "seed {seed}: {passed:?}");
    }
}

/// The wetter the ground, the more it holds; quite wet ground lets nobody go.
#[test]
fn wetter_ground_holds_more() {
    let dir = tempfile::tempdir().expect("dir");
    for seed in 1..=seeds() {
        let runs = [0.0, 0.1, 0.2, 0.3, 1.0].map(|h| {
            let columns = behind_a_wall(dir.path(), (1.2, h), seed);
            let held = ["grounded", "on_wall", "corner"].iter().flat_map(|s| &columns[*s]).sum::<f64>();
            (held, last(&columns, "lift_offs"))
        });
        assert!(
            runs.windows(2).all(|p| p[0].0 <= p[1].0) && runs[0].0 < runs[3].0 && runs[4].1 < 0.5,
            "seed {seed}: {runs:?}"
        );
    }
}

/// Counts behind a wall do not depend on the time step of the flight, nor on that of the lattice, within the spread of the seeds.
#[test]
#[ignore = "minutes of simulation; tests/full.sh runs it"]
fn counts_do_not_depend_on_the_time_steps() {
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "steps", &wall_scene(1.6, 0.2));
    let counts = |name: &str, more: &[&str]| {
        let out = dir.path().join(name);
        let fixed = ["-q", "bake", path.to_str().expect("path"), "--seeds", "1-6", "-o", out.to_str().expect("path")];
        let run = osier(&[&fixed, more].concat());
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let text = std::fs::read_to_string(out.join("means.csv")).expect("means");
        let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let (heads, row) = (lines.next().expect("heads"), lines.next().expect("a row"));
        let of = |name: &str| {
            let at = heads.iter().position(|h| *h == name).expect("column");
            row[at].parse::<f64>().expect("a number")
        };
        ["exited", "lift_offs", "mean_grounded", "flight_distance_50"].map(|c| [of(c), of(&format!("{c}_deviation"))])
    };
    let usual = counts("usual", &[]);
    println!("usual: {usual:.1?}");
    let others = [
        ("flight2", ["--set", "flight.substeps=2"]),
        ("flight4", ["--set", "flight.substeps=4"]),
        ("lattice2", ["--set", "wind.lattice.steps=10"]),
        ("lattice4", ["--set", "wind.lattice.steps=20"]),
    ];
    for (name, more) in others {
        let found = counts(name, &more);
        println!("{name}: {found:.1?}");
        for (a, b) in usual.iter().zip(&found) {
            // Three standard errors of the difference of two means of six.
            let error = ((a[1] * a[1] + b[1] * b[1]) / 6.0).sqrt();
            assert!((a[0] - b[0]).abs() < 3.0 * error, "{name}: {usual:.1?} {found:.1?}");
        }
    }
}

/// Blender sees each catkin where usd-core does, and as many: two thousand as curves, two hundred as ribbons.
#[test]
fn blender_sees_who_flies() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "flying", SCENE);
    for lod in ["0", "2"] {
        let set = format!("catkin.lod={lod}");
        // Let go one after another: births as well.
        let rain = ["--set", "flight.release=rain", "--set", "flight.duration=2"];
        let mut fixed = vec!["--formats", "usd,csv", "--set", &set];
        let frames = if lod == "0" { [1, 120, 240] } else { [1, 24, 48] };
        if lod == "0" {
            fixed.extend(["--set", "flight.count=2000", "--set", "frames.end=240"]);
        } else {
            // Levels beside it and lines behind it change nothing of what Blender shows.
            fixed.extend(["--set", "catkin.lods=[0, 3, 4, 5]", "--set", "flight.trails=0.25"]);
        }
        let out = baked(dir.path(), &format!("out{lod}"), &path, &[&fixed[..], &rain].concat());
        let (stage, told) = (out.join("flying.usda"), out.join("told.json"));
        let (stage, told) = (stage.to_str().expect("path"), told.to_str().expect("path"));
        let run = |arguments: &[&str]| {
            let run = Command::new(&python).arg(clients::script("flight.py")).args(arguments).output().expect("python");
            let said = String::from_utf8_lossy(&run.stdout).into_owned();
            assert!(run.status.success(), "lod {lod}: {said}{}", String::from_utf8_lossy(&run.stderr));
            said
        };
        let numbers = frames.map(|f| f.to_string());
        let states = run(&["usd", stage, told, &numbers[0], &numbers[1], &numbers[2]]);
        assert!(lod != "2" || states.contains("levels ['lod0', 'lod2', 'lod3', 'lod4', 'lod5'] lines 1"), "{states}");
        let columns = table(&out);
        let pending = |frame: usize| format!("\"{frame}\": [{}, ", columns["pending"][frame - 1]);
        assert!(frames.iter().all(|f| states.contains(&pending(*f))) && columns["pending"][0] > 100.0, "{states}");
        assert!(run(&["bpy", stage, told]).contains("3 frames"));
    }
}
