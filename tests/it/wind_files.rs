//! Files of the wind itself: what planes and boxes hold, read by a reader of their own.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::float_cmp,
    reason = "tests run the program and read its files, whose numbers are small and known"
)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A wall across the wind, so thin a scene that a second is baked at once.
const LATTICE: &str = "seed = 3\n[frames]\nend = 5\n[ground]\nshow = false\n\
    [wind]\nmodel = \"lattice\"\nspeed = 2\n[wind.lattice]\ncells = [24, 12, 16]\ndx = 0.5\nspin_up_s = 2\nat = [1, 0, 0]\n\
    [[solid]]\nat = [0.25, 0, 0]\nsize = [0.5, 2, 3]\n[output]\nformats = [\"obj\"]\n\
    [output.wind]\nvti_every = 4\n[[output.wind.slice]]\nat = 1.25\nevery = 2\n\
    [[output.wind.slice]]\nacross = \"z\"\nat = 0.25\n[[output.wind.slice]]\nacross = \"x\"\nat = -0.75\nevery = 9\n";

fn run(folder: &Path, name: &str, text: &str, more: &[&str]) -> (PathBuf, Output) {
    let (scene, out) = (folder.join("scene.toml"), folder.join(name));
    std::fs::write(&scene, text).expect("scene");
    let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
    let run = command.args(["-q", "bake"]).arg(&scene).arg("-o").arg(&out).args(more).output().expect("osier runs");
    (out, run)
}

fn baked(folder: &Path, name: &str, text: &str, more: &[&str]) -> PathBuf {
    let (out, run) = run(folder, name, text, more);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    out
}

fn files(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let list = osier::files::list_files(out).expect("files");
    list.into_iter().map(|f| (f.clone(), std::fs::read(out.join(f)).expect("bytes"))).collect()
}

/// Cells, lowest corner, side, time and velocities of a VTI, by the rules of the format alone.
pub(crate) struct Vti {
    pub(crate) cells: [usize; 3],
    pub(crate) corner: Vec<f64>,
    pub(crate) side: Vec<f64>,
    pub(crate) time: f64,
    pub(crate) values: Vec<[f32; 3]>,
}

pub(crate) fn vti(path: &Path) -> Vti {
    let bytes = std::fs::read(path).expect("vti");
    let start = bytes.windows(2).position(|w| w == b"\n_").expect("appended data") + 2;
    let head = std::str::from_utf8(&bytes[..start]).expect("XML before the data");
    let attribute = |name: &str| {
        let rest = &head[head.find(&format!(" {name}=\"")).expect("attribute") + name.len() + 3..];
        rest[..rest.find('"').expect("quote")].to_owned()
    };
    let numbers = |name: &str| attribute(name).split(' ').map(|v| v.parse().expect("number")).collect::<Vec<f64>>();
    assert_eq!((attribute("byte_order"), attribute("header_type")), ("LittleEndian".into(), "UInt64".into()));
    let length = u64::from_le_bytes(bytes[start..start + 8].try_into().expect("length")) as usize;
    let data = &bytes[start + 8..start + 8 + length];
    assert_eq!(&bytes[start + 8 + length..], b"\n</AppendedData>\n</VTKFile>\n");
    let floats: Vec<f32> = data.chunks(4).map(|b| f32::from_le_bytes(b.try_into().expect("float"))).collect();
    let extent = numbers("WholeExtent");
    let time = head.split("format=\"ascii\">").nth(1).and_then(|t| t.split('<').next()).expect("time");
    Vti {
        cells: [1, 3, 5].map(|k| extent[k] as usize),
        corner: numbers("Origin"),
        side: numbers("Spacing"),
        time: time.parse().expect("seconds"),
        values: floats.chunks(3).map(|v| [v[0], v[1], v[2]]).collect(),
    }
}

/// Width, height and texels of an EXR.
fn exr(path: &Path) -> (usize, usize, Vec<[f32; 3]>) {
    use exr::prelude::*;
    let read = read_first_rgba_layer_from_file(
        path,
        |size, _| (size, vec![[0.0_f32; 3]; size.area()]),
        |(size, texels), at, (r, g, b, _): (f32, f32, f32, f32)| texels[at.y() * size.width() + at.x()] = [r, g, b],
    );
    let (size, texels) = read.expect("EXR").layer_data.channel_data.pixels;
    (size.width(), size.height(), texels)
}

/// A valley below the base of the lattice has no wind: a bake says so, with the base that has, and is silent once that is set.
#[test]
fn a_valley_below_a_lattice_is_told() {
    let folder = tempfile::tempdir().expect("folder");
    let valley = "[terrain]\nsize = 40\namplitude = 0\ncorners = [-6, 0, -6, 0]\n";
    let text =
        LATTICE.replace("[wind]\n", &format!("{valley}[wind]\n")).replace("at = [0.25, 0, 0]", "at = [0.25, -3, 0]");
    let told = |name: &str, text: &str| {
        let scene = folder.path().join(format!("{name}.toml"));
        std::fs::write(&scene, text).expect("scene");
        let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
        let out = folder.path().join(name);
        let run = command.arg("bake").arg(&scene).arg("-o").arg(&out).args(["--formats", "csv"]).output();
        let run = run.expect("osier runs");
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        String::from_utf8_lossy(&run.stderr).into_owned() + &String::from_utf8_lossy(&run.stdout)
    };
    let said = told("deep", &text);
    assert!(said.contains("S034") && said.contains("there is no wind below"), "{said}");
    let base = said.split("wind.lattice.at to ").nth(1).and_then(|rest| rest.split(',').next()).expect("a base");
    assert!((-6.5..-2.0).contains(&base.parse::<f64>().expect("a number")), "{said}");
    let lowered =
        text.replace("at = [1, 0, 0]", &format!("at = [1, {base}, 0]")).replace("[24, 12, 16]", "[24, 24, 16]");
    let said = told("lowered", &lowered);
    assert!(!said.contains("S034"), "{said}");
}

/// On a plain 40 m below y = 0 the wind of 5 m/s at 10 m has the power law above the plain: at y = 0.5 it is 5 (40.5 / 10)^0.2.
#[test]
fn heights_of_the_wind_count_from_a_plain_at_any_height() {
    let dir = tempfile::tempdir().expect("dir");
    let text = "[frames]\nend = 2\n[terrain]\nsubdivisions = 3\nsize = 60\namplitude = 0\n\
        corners = [-40, -40, -40, -40]\nside = 64\n\
        [wind]\nspeed = 5\ngust = 0\nturbulence = 0\nwander_deg = 0\n[output]\nformats = [\"obj\"]\n\
        [output.wind]\nsize = [2, 2, 2]\ntexel = 1\nvti_every = 1\n";
    let cells = vti(&baked(dir.path(), "plain", text, &[]).join("wind/box.0001.vti")).values;
    assert!((cells[0][0] - 6.614).abs() < 0.01 && cells[0][1].abs() + cells[0][2].abs() < 1e-5, "{:?}", cells[0]);
}

/// The wind of a flight is written in the box of the flight, which stands on the land: on a plain at 20 m the lowest cells hold
/// the wind 0.5 m above it, 5 (0.5 / 10)^0.2 m/s. A plane across y is at its own height.
#[test]
fn files_of_the_wind_of_a_flight_stand_on_its_land() {
    let dir = tempfile::tempdir().expect("dir");
    let text = "[frames]\nend = 2\n[terrain]\nsubdivisions = 3\nsize = 60\namplitude = 0\n\
        corners = [20, 20, 20, 20]\nside = 64\n\
        [wind]\nspeed = 5\ngust = 0\nturbulence = 0\nwander_deg = 0\n\
        [flight]\ncount = 9\nsize = [8, 4, 8]\n[output]\nformats = [\"vdb\"]\n[output.vdb]\ncell = 1\nzip = false\n\
        [output.wind]\ntexel = 1\nvti_every = 1\n[[output.wind.slice]]\nacross = \"z\"\nat = 0.5\n\
        [[output.wind.slice]]\nat = 20.5\n";
    let out = baked(dir.path(), "high", text, &[]);
    let wind = vti(&out.join("wind/box.0001.vti"));
    assert_eq!((wind.cells, wind.corner), ([8, 4, 8], vec![-4.0, 20.0, -4.0]));
    assert!((wind.values[0][0] - 2.746).abs() < 0.01, "{:?}", wind.values[0]);
    // The lowest row of the plane across z is its last, and the plane across y lies in the middle of the lowest cells.
    let ((_, _, side), (_, _, plan)) = (exr(&out.join("wind/z0_5.0001.exr")), exr(&out.join("wind/y20_5.0001.exr")));
    for lowest in [side[8 * 3], plan[0]] {
        assert!((lowest[0] - wind.values[0][0]).abs() < 1e-4, "{lowest:?}");
    }
    // Every cell of the voxels lies above the ground, where none was before: 6 bytes each, and the tree.
    let bytes = std::fs::metadata(out.join("vdb/air_0001.vdb")).expect("a file").len();
    assert!(bytes > 6 * 8 * 4 * 8, "{bytes}");
}

/// Waves of a ground that reach no centre of a cell leave the wind as level ground has it; those of a metre are hills.
#[test]
fn low_waves_of_the_ground_do_not_slow_a_lattice() {
    let dir = tempfile::tempdir().expect("dir");
    let air = |ground: &str| {
        let out = baked(dir.path(), "waves", &LATTICE.replace("show = false", ground), &["--force"]);
        vti(&out.join("wind/box.0005.vti")).values
    };
    let level = air("relief = 0");
    assert!(air("relief = 0.1") == level && air("show = false") == level);
    assert!(air("relief = 1") != level);
}

/// A hill beyond the box of a lattice changes nothing in it. The plain below rises by 12 cm at most within the box, less than to the
/// first centre of a cell, and by 8 m half a kilometre away.
#[test]
fn hills_beyond_the_box_leave_a_lattice_alone() {
    let dir = tempfile::tempdir().expect("dir");
    let land = |corners: &str| {
        let land = format!("[terrain]\nsize = 1000\nsubdivisions = 3\namplitude = 0\nside = 64\ncorners = {corners}\n");
        let out = baked(dir.path(), "hill", &LATTICE.replace("[wind]\n", &format!("{land}[wind]\n")), &["--force"]);
        vti(&out.join("wind/box.0005.vti")).values
    };
    let level = land("[0, 0, 0, 0]");
    assert!(land("[-8, 8, -8, 8]") == level);
    assert!(land("[0, 2, 0, 2]") != level);
}

#[test]
fn planes_and_boxes_show_the_same_air() {
    let dir = tempfile::tempdir().expect("dir");
    let out = baked(dir.path(), "one", LATTICE, &["-j", "1"]);
    let whole = files(&out);
    let wind: Vec<&str> = whole.keys().filter_map(|f| f.strip_prefix("wind/")).collect();
    let z = (1..=5).map(|n| format!("z0.25.000{n}.exr").replace("0.25.", "0_25."));
    let rest =
        ["box.0001.vti", "box.0005.vti", "xm0_75.0001.exr", "y1_25.0001.exr", "y1_25.0003.exr", "y1_25.0005.exr"];
    let mut wanted: Vec<String> = z.chain(rest.map(String::from)).collect();
    wanted.sort();
    assert_eq!(wind, wanted);
    let cells = vti(&out.join("wind/box.0005.vti"));
    assert_eq!((cells.cells, &*cells.corner, &*cells.side), ([24, 12, 16], &[-5.0, 0.0, -4.0][..], &[0.5; 3][..]));
    assert!((cells.time - 4.0 / 24.0).abs() < 1e-12);
    let at = |x: usize, y: usize, z: usize| cells.values[(z * 12 + y) * 24 + x];
    // Planes through middles of cells show those cells: from above, row 0 at -z; from the side, row 0 at the top.
    let same = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
    let (w, h, y) = exr(&out.join("wind/y1_25.0005.exr"));
    assert_eq!((w, h), (24, 16));
    assert!((0..24 * 16).all(|k| same(y[k], at(k % 24, 2, k / 24))));
    let (w, h, z) = exr(&out.join("wind/z0_25.0005.exr"));
    assert_eq!((w, h), (24, 12));
    assert!((0..24 * 12).all(|k| same(z[k], at(k % 24, 11 - k / 24, 8))));
    let cells = vti(&out.join("wind/box.0001.vti"));
    let at = |x: usize, y: usize, z: usize| cells.values[(z * 12 + y) * 24 + x];
    let (w, h, x) = exr(&out.join("wind/xm0_75.0001.exr"));
    assert_eq!((w, h), (16, 12));
    assert!((0..16 * 12).all(|k| same(x[k], at(8, 11 - k / 16, k % 16))));
    // The wall is still, the air before it is not, and above it blows towards +x.
    assert_eq!(at(10, 1, 8), [0.0; 3]);
    assert!(at(2, 9, 8)[0] > 1.0 && at(10, 1, 1)[0].abs() > 0.2, "{:?} {:?}", at(2, 9, 8), at(10, 1, 1));
    // Any number of threads; and no frame is needed for another's bytes.
    assert_eq!(whole, files(&baked(dir.path(), "two", LATTICE, &["-j", "2"])));
    let part = files(&baked(dir.path(), "part", LATTICE, &["--frames", "5"]));
    assert!(part.contains_key("wind/box.0005.vti") && !part.contains_key("wind/box.0001.vti"));
    assert!(part["wind/box.0005.vti"] == whole["wind/box.0005.vti"], "frame 5 depends on others");
}

#[test]
fn any_wind_is_told() {
    let dir = tempfile::tempdir().expect("dir");
    let told = "[ground]\nshow = false\n[output]\nformats = [\"obj\"]\n[output.wind]\ntexel = 1\nsize = [4, 3, 5]\nvti_every = 2\n";
    let even = format!("[frames]\nend = 3\n[wind]\nmodel = \"uniform\"\nspeed = 3\ndirection_deg = 90\n{told}");
    let out = baked(dir.path(), "even", &even, &[]);
    let read = vti(&out.join("wind/box.0003.vti"));
    assert_eq!(read.cells, [4, 3, 5]);
    assert!(read.values.iter().all(|u| u[0].abs() < 1e-6 && u[1] == 0.0 && (u[2] + 3.0).abs() < 1e-6));
    // What catkins fly in: their box, and gusts that differ from place to place and from frame to frame.
    let flown = format!("[frames]\nend = 9\n[wind]\nspeed = 4\n[flight]\ncount = 5\nsize = [6, 6, 6]\nspin_up_s = 1\n[catkin]\nhairs = 4\nlod = 3\n{told}")
        .replace("size = [4, 3, 5]\n", "");
    let out = baked(dir.path(), "flown", &flown, &[]);
    let [a, b] = ["0001", "0009"].map(|n| vti(&out.join(format!("wind/box.{n}.vti"))));
    assert_eq!(a.cells, [6, 6, 6]);
    assert!(a.values[0] != a.values[5] && a.values != b.values);
    let mean = a.values.iter().map(|u| u[0]).sum::<f32>() / 216.0;
    assert!((0.5..6.0).contains(&mean), "{mean}");
}

#[test]
fn a_curve_of_speeds_lets_a_storm_come_up() {
    let dir = tempfile::tempdir().expect("dir");
    let rising = LATTICE
        .replace("end = 5", "end = 49")
        .replace("speed = 2", "direction_deg = 180")
        .replace("spin_up_s = 2", "spin_up_s = 2\ngust = 0\nturbulence = 0\nspeed_curve = [[0.5, 1], [1.5, 3]]")
        .replace("vti_every = 4", "vti_every = 12");
    let out = baked(dir.path(), "storm", &rising, &[]);
    // Where it comes in, at 4.25 m: the log profile's share of 1, 1, 2 and 3 m/s.
    let share = (4.25_f64 / 0.05 + 1.0).ln() / (6.0_f64 / 0.05 + 1.0).ln();
    for (frame, speed) in [("0001", 1.0), ("0013", 1.0), ("0025", 2.0), ("0037", 3.0), ("0049", 3.0)] {
        let u = vti(&out.join(format!("wind/box.{frame}.vti"))).values[(2 * 12 + 8) * 24 + 23][0];
        assert!((f64::from(u) / (-speed * share) - 1.0).abs() < 0.06, "{frame}: {u} for {}", -speed * share);
    }
    let loops = format!("{rising}[sway]\nloop = 2\n");
    let (_, run) = run(dir.path(), "loop", &loops, &[]);
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(!run.status.success() && said.contains("speed_curve does not repeat"), "{said}");
}

#[test]
fn a_curve_of_directions_turns_the_wind() {
    let dir = tempfile::tempdir().expect("dir");
    let turning = LATTICE
        .replace("end = 5", "end = 193")
        .replace("spin_up_s = 2", "spin_up_s = 2\ngust = 0\nturbulence = 0\ndirection_curve = [[0.5, 0], [2, 90]]")
        .replace("vti_every = 4", "vti_every = 192");
    let out = baked(dir.path(), "turning", &turning, &[]);
    // Above the middle: towards +x, then towards -z.
    let [before, after] =
        ["0001", "0193"].map(|n| vti(&out.join(format!("wind/box.{n}.vti"))).values[(8 * 12 + 10) * 24 + 12]);
    assert!(before[0] > 1.2 && before[2].abs() < 0.1, "{before:?}");
    assert!(after[2] < -1.2 && after[0].abs() < 0.2, "{after:?}");
    for (wrong, said) in [
        ("direction_curve = [[-1, 0], [2, 90]]", "direction_curve begins at -1 s"),
        (
            "sides = \"slip\"\ndirection_curve = [[0.5, 0], [2, 90]]",
            "blocks the sides, but the wind turns through them",
        ),
    ] {
        let scene = turning.replace("direction_curve = [[0.5, 0], [2, 90]]", wrong);
        let (_, run) = run(dir.path(), "wrong", &scene, &[]);
        let told = String::from_utf8_lossy(&run.stderr);
        assert!(!run.status.success() && told.contains(said), "{told}");
    }
}

#[test]
fn memory_is_told_before_it_is_spent() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, out) = (dir.path().join("scene.toml"), dir.path().join("out"));
    std::fs::write(&scene, LATTICE).expect("scene");
    let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
    let run = command.arg("bake").arg(&scene).arg("-o").arg(&out).arg("--dry-run").output().expect("osier runs");
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(said.contains("memory of the lattice wind: ") && said.contains("snapshots 4"), "{said}");
    assert!(!out.exists());
}

#[test]
fn each_fault_names_its_place_and_the_mend() {
    let dir = tempfile::tempdir().expect("dir");
    let lattice = LATTICE.replace("at = 1.25", "at = 6.5");
    let cases = [
        (lattice.as_str(), &[][..], "output.wind.slice.0.at is 6.5 m", "must be 0 to 6"),
        ("[output.wind]\nslice = 3\n", &[], "S003", "[[output.wind.slice]]"),
        ("[output.wind]\nvti_every = 0\n", &[], "vti_every", "1 to"),
        (LATTICE, &["--max-wind-bytes", "100k"], "output.wind and output.vdb in two frames", "--max-wind-bytes"),
        (LATTICE, &["--max-memory", "100k"], "24 x 12 x 16 cells with dx = 0.5 m", "wind.lattice.dx"),
        (LATTICE, &["--max-image-side", "20"], "a side of a plane", "--max-image-side"),
    ];
    for (text, more, what, mend) in cases {
        let (_, run) = run(dir.path(), "bad", text, more);
        let said = String::from_utf8_lossy(&run.stderr);
        assert!(!run.status.success() && said.contains(what) && said.contains(mend), "{text}: {said}");
    }
    let still = LATTICE.replace("end = 5", "end = 1");
    // Warnings are kept back by -q, but counted.
    let (_, run) = run(dir.path(), "still", &still, &["--strict"]);
    assert_eq!(run.status.code(), Some(3), "{}", String::from_utf8_lossy(&run.stderr));
    let check = Command::new(env!("CARGO_BIN_EXE_osier")).arg("check").arg(dir.path().join("scene.toml")).output();
    let run = check.expect("osier runs");
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(
        run.status.success() && said.contains("S007") && said.contains("needs a clip, but the scene has one frame"),
        "{said}"
    );
}

/// The kept air of a folder.
fn kept(out: &Path) -> PathBuf {
    let all = files(out);
    let mut found = all.keys().filter(|f| f.ends_with(".state"));
    let path = found.next().expect("kept air");
    assert!(found.next().is_none() && path.starts_with("wind/air_"), "{path}");
    out.join(path)
}

#[test]
fn air_that_was_kept_gives_the_same_bytes() {
    let dir = tempfile::tempdir().expect("dir");
    let text = LATTICE.replace("spin_up_s = 2", "spin_up_s = 2\nkeep = true");
    let used = baked(dir.path(), "used", &text, &[]);
    let manifest = String::from_utf8(files(&used)["manifest.json"].clone()).expect("text");
    assert!(manifest.contains("\"state.wind\""));
    let state = std::fs::read(kept(&used)).expect("state");
    // Another scene with the same wind, as a second bake or one that was stopped: its files do not tell whether air was kept.
    let other = format!("title = \"other\"\n{}", text.replace("vti_every = 4", "vti_every = 1"));
    let fresh = files(&baked(dir.path(), "fresh", &other, &[]));
    baked(dir.path(), "used", &other, &[]);
    assert_eq!(files(&used), fresh);
    // It is read: what was changed and signed anew changes the wind.
    let head = state.iter().position(|b| *b == b'\n').expect("a line") + 1;
    let mut body = state[head + 65..].to_vec();
    // Whole numbers of four bytes from the end, where the populations are.
    let middle = body.len() - body.len() / 8 * 4;
    body[middle..middle + 64].chunks_mut(4).for_each(|g| g.copy_from_slice(&0.01_f32.to_le_bytes()));
    let signed = [&state[..head], blake3::hash(&body).to_hex().as_bytes(), b"\n", &body].concat();
    let path = kept(&used);
    let third = other.replace("other", "third");
    let wanted = files(&baked(dir.path(), "third", &third, &[]));
    let data = |f: &Vec<u8>| f[f.windows(2).position(|w| w == b"\n_").expect("data")..].to_vec();
    std::fs::write(&path, signed).expect("write");
    baked(dir.path(), "used", &third, &["--force"]);
    assert_ne!(data(&files(&used)["wind/box.0001.vti"]), data(&wanted["wind/box.0001.vti"]));
    // What is not whole, or of another wind, is said and made again.
    let cut = state[..state.len() - 1].to_vec();
    let turned = baked(dir.path(), "turned", &text.replace("speed = 2", "speed = 2.1"), &[]);
    let strange = std::fs::read(kept(&turned)).expect("state");
    for (bytes, why) in [(cut, "is damaged"), (strange, "is of another lattice wind")] {
        let fourth = other.replace("other", why);
        std::fs::write(&path, bytes).expect("write");
        let scene = dir.path().join("scene.toml");
        std::fs::write(&scene, &fourth).expect("scene");
        let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
        let run = command.arg("bake").arg(&scene).arg("-o").arg(&used).arg("--force").output().expect("osier runs");
        let said = String::from_utf8_lossy(&run.stderr);
        assert!(run.status.success() && said.contains(why), "{said}");
        assert_eq!(std::fs::read(&path).expect("state"), state);
        assert_eq!(files(&used), files(&baked(dir.path(), why, &fourth, &[])));
    }
}

#[test]
fn the_end_of_a_bake_names_the_folders_of_its_results() {
    let dir = tempfile::tempdir().expect("dir");
    let told = |text: &str| {
        let (scene, out) = (dir.path().join("told.toml"), dir.path().join("told"));
        std::fs::write(&scene, text).expect("scene");
        let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
        let run = command.arg("bake").arg(&scene).arg("-o").arg(&out).output().expect("osier runs");
        String::from_utf8_lossy(&run.stdout).into_owned()
    };
    let said = told(LATTICE);
    assert!(
        said.contains("velocities on planes (.exr) and in boxes (.vti): ") && said.contains("told/wind\n"),
        "{said}"
    );
    // A stored state is for the next bake alone.
    let planes = LATTICE.find("[output.wind]").expect("planes");
    let kept = LATTICE[..planes].replace("dx = 0.5\n", "dx = 0.5\nkeep = true\n");
    let said = told(&format!("{kept}[plants.a]\nspecies = \"birch\"\nage = 1\n"));
    assert!(said.contains("meshes at rest") && !said.contains("velocities"), "{said}");
    let said = told("[clouds.a]\nifs = \"fern_leaf.ifs\"\npoints = 2000\n[output]\nformats = [\"ply\"]\n");
    assert!(said.contains("(.ply): ") && said.contains("told/cloud\n"), "{said}");
}
