//! OpenVDB files: what another reader finds in them, what Blender samples, and the prims of USD that show them.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]
#![allow(clippy::cast_possible_truncation, reason = "small whole numbers")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use vdb_rs::VdbReader;

use crate::common::clients;
use crate::common::program::{arg, assert_same, ends, run, said, tree};
use crate::wind_files::vti;

/// Catkins in gusts.
const FLIGHT: &str = "seed = 6\n[frames]\nend = 6\n[ground]\nshow = false\n[wind]\nspeed = 3\n[catkin]\nlod = 3\nhairs = 12\n\
    [flight]\ncount = 300\nspin_up_s = 5\nsize = [8, 3, 8]\n";
/// A wall across the wind of a lattice, which `[output.wind]` samples at the same cells.
const LATTICE: &str = "seed = 3\n[frames]\nend = 3\n[ground]\nshow = false\n\
    [wind]\nmodel = \"lattice\"\nspeed = 2\n[wind.lattice]\ncells = [24, 12, 16]\ndx = 0.5\nspin_up_s = 2\nat = [1, 0, 0]\n\
    [[solid]]\nat = [0.25, 0, 0]\nsize = [0.5, 2, 3]\n[output.wind]\nvti_every = 1\n";

fn bake(folder: &Path, scene: &str, formats: &str, more: &[&str]) -> PathBuf {
    let (file, out) = (folder.join("air.toml"), folder.join("out"));
    fs::write(&file, scene).expect("scene");
    ends(0, &[&["-q", "bake", arg(&file), "-o", arg(&out), "--formats", formats], more].concat());
    out
}

/// Number and sum of the voxels of a grid of numbers, as another library reads them.
fn voxels(file: &Path, grid: &str) -> (usize, f64) {
    let mut reader = VdbReader::new(std::io::Cursor::new(fs::read(file).expect("a file"))).expect("OpenVDB");
    let grid = reader.read_grid::<f32>(grid).expect("the grid");
    let values: Vec<f64> = grid.iter().map(|(_, value, _)| f64::from(value)).collect();
    (values.len(), values.iter().sum())
}

/// Rows of the statistics of a flight.
fn flight_rows(out: &Path) -> Vec<BTreeMap<String, f64>> {
    let text = fs::read_to_string(out.join("stats/flight.csv")).expect("table");
    let names: Vec<&str> =
        text.lines().next().expect("names").split(',').map(|n| n.split(' ').next().expect("a name")).collect();
    let row = |line: &str| -> BTreeMap<String, f64> {
        names.iter().map(ToString::to_string).zip(line.split(',').map(|v| v.parse().expect("a number"))).collect()
    };
    text.lines().skip(1).map(row).collect()
}

#[test]
fn densities_add_up_to_the_catkins_that_the_table_counts() {
    let settings: [&[&str]; 4] = [
        &[],
        &["--set", "output.vdb.half=false"],
        &["--set", "output.vdb.zip=false"],
        &["--set", "output.vdb.half=false", "--set", "output.vdb.zip=false", "--set", "output.vdb.cell=0.25"],
    ];
    for (more, cell) in settings.into_iter().zip([0.5, 0.5, 0.5, 0.25_f64]) {
        let dir = tempfile::tempdir().expect("dir");
        let out = bake(dir.path(), FLIGHT, "csv,vdb", more);
        for (frame, row) in (1..).zip(flight_rows(&out)) {
            let file = out.join(format!("vdb/flock_{frame:04}.vdb"));
            let ((flying, density), (resting, deposition)) = (voxels(&file, "density"), voxels(&file, "deposition"));
            let wanted = [row["airborne"], row["grounded"] + row["on_wall"] + row["corner"]];
            assert!(flying > 10 && flying as f64 <= wanted[0] && resting as f64 <= wanted[1], "{flying} {resting}");
            for (found, wanted) in [density * cell.powi(3), deposition * cell.powi(2)].into_iter().zip(wanted) {
                assert!((found - wanted).abs() <= 1e-3 * wanted, "{more:?}, frame {frame}: {found} {wanted}");
            }
        }
        assert_eq!(fs::read_dir(out.join("vdb")).expect("folder").count(), 12);
    }
}

#[test]
fn keys_choose_grids_and_frames_and_threads_change_nothing() {
    let dir = tempfile::tempdir().expect("dir");
    let more = ["--set", "output.vdb.grids=[\"deposition\"]", "--set", "output.vdb.every=2", "--frames", "2-6"];
    let out = bake(dir.path(), FLIGHT, "vdb", &more);
    assert_eq!(tree(&out.join("vdb")).keys().collect::<Vec<_>>(), ["flock_0003.vdb", "flock_0005.vdb"]);
    let of_threads = |threads: &str| {
        let dir = tempfile::tempdir().expect("dir");
        tree(&bake(dir.path(), FLIGHT, "vdb", &["-j", threads]).join("vdb"))
    };
    let one = of_threads("1");
    assert_eq!(one.len(), 12);
    for threads in ["2", "5"] {
        assert_same(&of_threads(threads), &one, threads);
    }
}

#[test]
fn blender_samples_the_velocities_of_the_wind() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let out = bake(dir.path(), LATTICE, "vdb", &["--set", "output.vdb.half=false"]);
    let file = out.join("vdb/air_0003.vdb");
    let wind = vti(&out.join("wind/box.0003.vti"));
    let at = |[x, y, z]: [usize; 3]| wind.values[(z * 12 + y) * 24 + x];
    // Corners of the box, borders of leaves, before, above, beside and behind the wall; one inside of it.
    let cells = [
        [0, 0, 0],
        [23, 11, 15],
        [7, 7, 7],
        [8, 8, 8],
        [8, 1, 7],
        [10, 5, 8],
        [10, 1, 1],
        [12, 1, 8],
        [15, 0, 8],
        [16, 3, 9],
        [10, 1, 8],
    ];
    let places: Vec<[f64; 3]> =
        cells.iter().map(|c| std::array::from_fn(|k| wind.corner[k] + (c[k] as f64 + 0.6) * wind.side[k])).collect();
    let (by_cell, by_place) = (json!(cells).to_string(), json!(places).to_string());
    let arguments = [arg(&file), "vel", "VECTOR", &by_cell, &by_place];
    let answer = clients::python_script(&python, "vdb_blender.py", &arguments);
    let found: Value =
        serde_json::from_slice(answer.stdout.split(|b| *b == b'\n').rfind(|l| !l.is_empty()).expect("a line"))
            .expect("json");
    for way in ["cells", "places"] {
        for (k, cell) in cells.iter().enumerate() {
            let wanted = if k == 10 { [0.0; 3] } else { at(*cell) };
            let value = &found[way][k];
            let near = (0..3).all(|a| (value[a].as_f64().expect("a number") - f64::from(wanted[a])).abs() < 1e-3);
            assert!(near, "{way}, {cell:?}: {value} {wanted:?}");
        }
    }
}

#[test]
fn blender_samples_the_density_of_catkins_in_half_precision() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let out = bake(dir.path(), FLIGHT, "vdb", &[]);
    let file = out.join("vdb/flock_0004.vdb");
    let mut reader = VdbReader::new(std::io::Cursor::new(fs::read(&file).expect("a file"))).expect("OpenVDB");
    let grid = reader.read_grid::<f32>("density").expect("the grid");
    let voxels: Vec<([i32; 3], f32)> =
        grid.iter().map(|(cell, value, _)| (cell.to_array().map(|v| v as i32), value)).take(10).collect();
    let cells: Vec<[i32; 3]> = voxels.iter().map(|v| v.0).collect();
    // Middles of the cells: the box of the flight begins at (-4, 0, -4).
    let place = |c: &[i32; 3]| [0, 1, 2].map(|k| f64::from(c[k]) * 0.5 + 0.25 - if k == 1 { 0.0 } else { 4.0 });
    let places: Vec<[f64; 3]> = cells.iter().map(place).collect();
    let (by_cell, by_place) = (json!(cells).to_string(), json!(places).to_string());
    let answer =
        clients::python_script(&python, "vdb_blender.py", &[arg(&file), "density", "FLOAT", &by_cell, &by_place]);
    let found: Value =
        serde_json::from_slice(answer.stdout.split(|b| *b == b'\n').rfind(|l| !l.is_empty()).expect("a line"))
            .expect("json");
    for way in ["cells", "places"] {
        for (k, (cell, value)) in voxels.iter().enumerate() {
            let sampled = found[way][k][0].as_f64().expect("a number");
            assert!((sampled / f64::from(*value) - 1.0).abs() < 1e-3, "{way}, {cell:?}: {sampled} {value}");
        }
    }
}

#[test]
fn a_stage_shows_the_files_frame_by_frame() {
    let dir = tempfile::tempdir().expect("dir");
    for up in ["y", "z"] {
        let set = format!("output.usd.up=\"{up}\"");
        let out = bake(dir.path(), FLIGHT, "usd,vdb", &["--set", &set, "--frames", "1-4", "--force"]);
        let text = fs::read_to_string(out.join("air.usda")).expect("wrapper");
        for needle in
            ["def Volume \"flock\"", "def Volume \"air\"", "def OpenVDBAsset \"density\"", "def OpenVDBAsset \"vel\""]
        {
            assert!(text.contains(needle), "{needle}");
        }
        assert!(text.contains("@./vdb/flock_0001.vdb@") && text.contains("@./vdb/air_0004.vdb@"));
        assert!(text.contains("field:density = </air/flock/density>"), "{text}");
        let map: &[u8] = if up == "z" { b"AffineMap" } else { b"UniformScaleTranslateMap" };
        let bytes = fs::read(out.join("vdb/air_0001.vdb")).expect("a file");
        assert!(bytes.windows(map.len()).any(|w| w == map));
        let Some(python) = clients::python() else { return };
        clients::python_script(&python, "usd_validate.py", &[arg(&out.join("air.usda"))]);
    }
}

#[test]
fn plants_of_the_names_of_volumes_leave_these_to_them() {
    let dir = tempfile::tempdir().expect("dir");
    let plant = |name: &str| {
        format!("[plants.{name}]\ngrammar = \"grass.l\"\nmotion = \"still\"\n[[place]]\nplant = \"{name}\"\n")
    };
    let copies = format!("{}count = 4\nindividuals = 2\nradius = 2\n{}", plant("air"), plant("flock"));
    let out = bake(dir.path(), &format!("{FLIGHT}{copies}"), "usd,vdb", &["--frames", "1-2"]);
    let text = fs::read_to_string(out.join("air.usda")).expect("wrapper");
    for (kind, name) in [("Volume", "air"), ("PointInstancer", "air_2"), ("Volume", "flock"), ("Xform", "flock_2")] {
        assert!(text.contains(&format!("def {kind} \"{name}\"")), "{name}: {text}");
    }
    assert!(!text.contains("PointInstancer \"air\"") && !text.contains("Xform \"flock\""), "{text}");
}

#[test]
fn too_many_voxels_are_refused_and_still_scenes_are_told() {
    let dir = tempfile::tempdir().expect("dir");
    let (file, out) = (dir.path().join("air.toml"), dir.path().join("out"));
    fs::write(&file, FLIGHT).expect("scene");
    let bake = ["-q", "bake", arg(&file), "-o", arg(&out), "--formats", "vdb,points"];
    let (code, _, told) = said(&run(&[&bake[..], &["--set", "output.vdb.cell=0.01"]].concat()));
    assert!(code != 0 && told.contains("X010") && told.contains("192000000 active voxels"), "{code} {told}");
    fs::write(&file, FLIGHT.replace("end = 6", "end = 1")).expect("scene");
    let formats = "output.formats=[\"vdb\", \"points\", \"csv\"]";
    let (code, _, told) = said(&run(&["check", arg(&file), "--set", formats]));
    assert!(code == 0 && told.contains("S007") && told.contains("needs a clip for vdb, points, csv"), "{code} {told}");
}

#[test]
fn a_selection_without_the_frames_of_the_volumes_is_told() {
    let dir = tempfile::tempdir().expect("dir");
    let file = dir.path().join("air.toml");
    let scene = FLIGHT.to_owned() + "[output.wind]\nvti_every = 4\n";
    fs::write(&file, scene).expect("scene");
    let bake = |frames: &str| {
        let out = dir.path().join(frames.replace(':', "_"));
        let call = ["bake", arg(&file), "-o", arg(&out), "--formats", "vdb", "--set", "output.vdb.every=2", "--frames"];
        let (code, _, told) = said(&run(&[&call[..], &[frames]].concat()));
        assert_eq!(code, 0, "{told}");
        let written = tree(&out);
        (told, ["vdb/", "wind/"].map(|folder| written.keys().filter(|path| path.starts_with(folder)).count()))
    };
    let (told, [volumes, winds]) = bake("1-5:2");
    assert!(!told.contains("X028") && volumes > 0 && winds == 2, "{volumes} {winds} {told}");
    let (told, written) = bake("2-6:2");
    assert_eq!(written, [0, 0], "{told}");
    assert!(told.contains("X028") && told.contains("volume vel") && told.contains("wind box"), "{told}");
    assert_eq!(told.matches("X028").count(), 4, "three volumes and the box, each once: {told}");
    // The selection is known before the simulation: the warning precedes it, and a dry run has it.
    let at = |part: &str| told.find(part).unwrap_or_else(|| panic!("{part}: {told}"));
    assert!(at("X028") < at("growing"), "{told}");
    let mut dry = vec!["bake", arg(&file), "-n", "--formats", "vdb", "--set", "output.vdb.every=2"];
    dry.extend(["--frames", "2-6:2", "--strict"]);
    let (code, _, told) = said(&run(&dry));
    assert!(code == 3 && told.contains("X028"), "{code} {told}");
}
