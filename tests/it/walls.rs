//! Walls in a lattice wind, through scene files and whole bakes: what is closed lets no wind through, however it stands.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::print_stdout,
    reason = "tests run the program and read its files, whose numbers are small and known"
)]

use std::path::Path;
use std::process::{Command, Output};

/// Side of the texels at which wind is read, m.
const TEXEL: f64 = 0.1;
/// Length and height of the wall, m.
const WALL: [f64; 2] = [10.0, 3.0];
/// Heights at which wind is read, m.
const HEIGHTS: [&str; 5] = ["0.5", "1", "1.5", "2", "2.5"];

fn bake(folder: &Path, name: &str, text: &str) -> Output {
    let scene = folder.join(format!("{name}.toml"));
    std::fs::write(&scene, text).expect("scene");
    let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
    command.args(["bake"]).arg(&scene).arg("-o").arg(folder.join(name)).output().expect("osier runs")
}

/// Red, green and blue of an EXR, row by row.
fn exr(path: &Path) -> (usize, Vec<[f32; 3]>) {
    use exr::prelude::*;
    let read = read_first_rgba_layer_from_file(
        path,
        |size, _| (size, vec![[0.0_f32; 3]; size.area()]),
        |(size, texels), at, (r, g, b, _): (f32, f32, f32, f32)| texels[at.y() * size.width() + at.x()] = [r, g, b],
    );
    let (size, texels) = read.expect("EXR").layer_data.channel_data.pixels;
    (size.width(), texels)
}

/// A mesh of the wall about the origin: a closed box, or its middle plane alone.
fn wall_obj(closed: bool) -> String {
    let (half, [length, height]) = (0.05, WALL);
    let z = length / 2.0;
    let quad = |x: f64| format!("v {x} 0 {z}\nv {x} 0 -{z}\nv {x} {height} -{z}\nv {x} {height} {z}\n");
    if closed {
        // +x outwards: 1 2 3 4; -x: 5 6 7 8.
        let faces = ["1 2 3 4", "8 7 6 5", "2 6 7 3", "5 1 4 8", "4 3 7 8", "5 6 2 1"];
        quad(half) + &quad(-half) + &faces.map(|f| format!("f {f}\n")).concat()
    } else {
        quad(0.0) + "f 1 2 3 4\n"
    }
}

/// Five seconds of wind of 3 m/s behind a wall, after spin-up.
fn scene(solid: &str, degrees: f64) -> String {
    let slices = HEIGHTS.map(|y| format!("[[output.wind.slice]]\nat = {y}\nevery = 12\n"));
    format!(
        "seed = 2\n[frames]\nend = 121\n[ground]\nshow = false\n[wind]\nmodel = \"lattice\"\nspeed = 3\n[wind.lattice]\n\
         cells = [44, 16, 40]\ndx = 0.5\n[[solid]]\nturn_deg = {degrees}\n{solid}\n[output]\nformats = [\"obj\"]\n\
         [output.wind]\ntexel = {TEXEL}\n{}",
        slices.concat()
    )
}

/// Mean velocity along the wall's normal, m/s, 0.2 to 0.5 m behind it, over its length, the heights and the frames read.
fn normal_velocity_behind(out: &Path, degrees: f64) -> f64 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let (mut sum, mut count) = (0.0, 0.0);
    for y in HEIGHTS {
        for frame in (1..=121).step_by(12) {
            let name = format!("y{}.{frame:04}.exr", y.replace('.', "_"));
            let (width, texels) = exr(&out.join("wind").join(name));
            for (k, u) in texels.iter().enumerate() {
                // Row 0 at -z.
                let x = ((k % width) as f64 + 0.5) * TEXEL - 11.0;
                let z = ((k / width) as f64 + 0.5) * TEXEL - 10.0;
                let (across, along) = (x * cos - z * sin, x * sin + z * cos);
                if (0.2..0.5).contains(&across) && along.abs() < WALL[0] / 2.0 {
                    sum += f64::from(u[0]) * cos - f64::from(u[2]) * sin;
                    count += 1.0;
                }
            }
        }
    }
    assert!(count > 1000.0, "{count} texels read");
    sum / count
}

/// Angles at which a wall stands, degrees.
const ANGLES: [f64; 5] = [0.0, 15.0, 30.0, 45.0, 60.0];
/// Largest mean velocity along a wall's normal behind it, m/s: 1 % of the wind.
const LEAK: f64 = 0.03;

/// Fails if the wind blows through a wall of this kind, at any of the angles.
fn is_closed(kind: &str, angles: &[f64]) {
    let dir = tempfile::tempdir().expect("dir");
    for (name, closed) in [("closed.obj", true), ("open.obj", false)] {
        std::fs::write(dir.path().join(name), wall_obj(closed)).expect("mesh");
    }
    let [length, height] = WALL;
    let solid = match kind {
        "block" => format!("size = [0.1, {height}, {length}]"),
        mesh => format!("shape = \"mesh\"\nmesh = \"{mesh}.obj\""),
    };
    for degrees in angles {
        let name = format!("{kind}{degrees}");
        let run = bake(dir.path(), &name, &scene(&solid, *degrees));
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.success(), "{said}");
        let mean = normal_velocity_behind(&dir.path().join(&name), *degrees);
        println!("{kind}, {degrees} degrees: {mean:.4} m/s");
        assert!(mean.abs() < LEAK, "{kind}, {degrees} degrees: {mean} m/s");
    }
}

/// Every kind, every angle once.
#[test]
fn no_wind_blows_through_a_thin_wall() {
    is_closed("block", &[0.0, 45.0]);
    is_closed("closed", &[30.0]);
    is_closed("open", &[15.0, 60.0]);
}

#[test]
#[ignore = "takes minutes; tests/full.sh runs it"]
fn no_wind_blows_through_a_thin_wall_of_any_kind_at_any_angle() {
    ["block", "closed", "open"].iter().for_each(|kind| is_closed(kind, &ANGLES));
}

/// Radius of a curved wall, m.
const RADIUS: f64 = 5.0;

/// A sheet that stands along a circle about the origin, from +z over -x by so many degrees.
fn curved_obj(degrees: f64) -> String {
    const SIDES: u32 = 24;
    let (mut points, mut faces) = (String::new(), String::new());
    for k in 0..=SIDES {
        let angle = std::f64::consts::FRAC_PI_2 + degrees.to_radians() * f64::from(k) / f64::from(SIDES);
        let (sin, cos) = angle.sin_cos();
        let (x, z) = (RADIUS * cos, RADIUS * sin);
        points += &format!("v {x} 0 {z}\nv {x} {} {z}\n", WALL[1]);
        let a = 2 * k + 1;
        if k < SIDES {
            faces += &format!("f {a} {} {} {}\n", a + 2, a + 3, a + 1);
        }
    }
    points + &faces
}

/// Curved walls stand at all angles to the cells at once: half a cylinder, open to the lee, and a whole one. Air that passed through
/// would have an outward or inward velocity just within.
#[test]
fn no_wind_blows_through_a_curved_wall() {
    let dir = tempfile::tempdir().expect("dir");
    for (name, degrees) in [("half", 180.0), ("whole", 360.0)] {
        std::fs::write(dir.path().join(format!("{name}.obj")), curved_obj(degrees)).expect("mesh");
        let run = bake(dir.path(), name, &scene(&format!("shape = \"mesh\"\nmesh = \"{name}.obj\""), 0.0));
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.success() && said.contains("S032"), "{said}");
        // Mean velocity away from the axis: windward, 0.2 to 0.5 m within the wall and as far before it.
        let (mut within, mut before) = ([0.0, 0.0], [0.0, 0.0]);
        for y in HEIGHTS {
            for frame in (1..=121).step_by(12) {
                let file = format!("y{}.{frame:04}.exr", y.replace('.', "_"));
                let (width, texels) = exr(&dir.path().join(name).join("wind").join(file));
                for (k, u) in texels.iter().enumerate() {
                    let x = ((k % width) as f64 + 0.5) * TEXEL - 11.0;
                    let z = ((k / width) as f64 + 0.5) * TEXEL - 10.0;
                    let r = (x * x + z * z).sqrt();
                    if x > -1.0 {
                        continue;
                    }
                    let outward = (f64::from(u[0]) * x + f64::from(u[2]) * z) / r;
                    if (0.2..0.5).contains(&(RADIUS - r)) {
                        within = [within[0] + outward, within[1] + 1.0];
                    } else if (3.0..5.0).contains(&(r - RADIUS)) {
                        before = [before[0] + outward, before[1] + 1.0];
                    }
                }
            }
        }
        let [within, before] = [within, before].map(|[sum, count]| sum / count);
        println!("{name} cylinder: {within:.4} m/s within, {before:.4} m/s before it");
        assert!(within.abs() < LEAK && before < -0.3, "{name}: {within} {before} m/s");
    }
}

/// A file with Z up stands as the same wall with Y up, by `mesh_up`, and lies on its side without; a block has no mesh to turn.
#[test]
fn meshes_of_solids_with_z_up_stand() {
    let dir = tempfile::tempdir().expect("dir");
    let upright = wall_obj(true);
    // Y up (x, y, z) is Z up (x, -z, y).
    let turned = upright.lines().map(|line| match line.split(' ').collect::<Vec<_>>()[..] {
        ["v", x, y, z] => format!("v {x} {} {y}\n", -z.parse::<f64>().expect("a number")),
        _ => format!("{line}\n"),
    });
    std::fs::write(dir.path().join("z.obj"), turned.collect::<String>()).expect("mesh");
    std::fs::write(dir.path().join("y.obj"), upright).expect("mesh");
    let baked = |name: &str, solid: &str| {
        let text = format!(
            "[frames]\nend = 2\n[ground]\nshow = false\n[output]\nformats = [\"obj\"]\n[output.wind]\nsize = [2, 2, 2]\n\
             vti_every = 9\n[[solid]]\nname = \"w\"\n{solid}\n"
        );
        let run = bake(dir.path(), name, &text);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.success(), "{said}");
        let obj = std::fs::read_to_string(dir.path().join(name).join("obj/w.obj")).expect("obj");
        // Adding 0 turns -0 into 0.
        let numbers = |line: &str| -> Vec<f64> {
            line.split(' ').skip(1).map(|v| v.parse::<f64>().expect("a number") + 0.0).collect()
        };
        (obj.lines().filter(|line| line.starts_with("v ")).map(numbers).collect::<Vec<_>>(), said)
    };
    let (wanted, _) = baked("upright", "shape = \"mesh\"\nmesh = \"y.obj\"");
    assert_eq!(baked("up", "shape = \"mesh\"\nmesh = \"z.obj\"\nmesh_up = \"z\"").0, wanted);
    assert_ne!(baked("lying", "shape = \"mesh\"\nmesh = \"z.obj\"").0, wanted);
    assert!(baked("block", "mesh_up = \"z\"").1.contains("S007"));
}

/// Catkins are deposited at a fence of a mesh as at a block of its size: means over four seeds differ by less than three standard errors.
#[test]
fn a_mesh_catches_what_a_block_catches() {
    let dir = tempfile::tempdir().expect("dir");
    std::fs::write(dir.path().join("closed.obj"), wall_obj(true)).expect("mesh");
    let [length, height] = WALL;
    let solids = [
        ("block", format!("size = [0.1, {height}, {length}]")),
        ("mesh", "shape = \"mesh\"\nmesh = \"closed.obj\"".to_owned()),
    ];
    let columns = ["deposits", "landed_fence", "ground_before", "ground_behind", "left"];
    let zone = |name: &str, x: [f64; 2]| format!("[[flight.zone]]\nname = \"{name}\"\nx = {x:?}\nz = [-10, 10]\n");
    let counts = solids.map(|(kind, solid)| {
        let text = format!(
            "[frames]\nend = 192\n[ground]\nshow = false\n[catkin]\nhairs = 2\n[flight]\ncount = 2000\nband = [0.05, 0.6]\n\
             sides = \"exit\"\nhumidity = 0.5\nstick_radius = 0\n{}{}[wind]\nmodel = \"lattice\"\nspeed = 3\n[wind.lattice]\n\
             cells = [44, 16, 40]\ndx = 0.5\n[[solid]]\nname = \"fence\"\nturn_deg = 15\n{solid}\n",
            zone("before", [-11.0, 0.0]),
            zone("behind", [0.0, 11.0])
        );
        let scene = dir.path().join(format!("{kind}.toml"));
        std::fs::write(&scene, text).expect("scene");
        let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
        let run = command.args(["bake"]).arg(&scene).args(["--seeds", "1-4", "-o"]).arg(dir.path().join(kind)).output();
        let run = run.expect("osier runs");
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let means = std::fs::read_to_string(dir.path().join(kind).join("means.csv")).expect("means");
        let lines: Vec<Vec<&str>> = means.lines().map(|line| line.split(',').collect()).collect();
        let of = |name: &str| {
            let at = lines[0].iter().position(|head| *head == name).expect("column");
            lines[1][at].parse::<f64>().expect("a number")
        };
        columns.map(|name| [of(name), of(&format!("{name}_deviation"))])
    });
    for (name, [block, mesh]) in columns.iter().zip(counts[0].iter().zip(counts[1]).map(|(b, m)| [*b, m])) {
        println!("{name}: block {:.1} +- {:.1}, mesh {:.1} +- {:.1}", block[0], block[1], mesh[0], mesh[1]);
        let error = ((block[1] * block[1] + mesh[1] * mesh[1]) / 4.0).sqrt();
        assert!((block[0] - mesh[0]).abs() <= 3.0 * error && block[0] > 5.0, "{name}: {block:.1?} {mesh:.1?}");
    }
}

/// A wall across the whole box is refused before any step, with advice that helps; one that leaves a gap is warned of.
#[test]
fn blocked_boxes_are_refused_beforehand() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = |width: f64| {
        format!(
            "[frames]\nend = 2\n[ground]\nshow = false\n[wind]\nmodel = \"lattice\"\nspeed = 3\n[wind.lattice]\n\
             cells = [32, 16, 40]\ndx = 0.5\nspin_up_s = 1\n[[solid]]\nname = \"wall\"\nsize = [0.2, 8, {width}]\n\
             [output]\nformats = [\"obj\"]\n[output.wind]\nvti_every = 2\n"
        )
    };
    for (width, share) in [(20.0, "100 %"), (19.0, "95 %")] {
        let run = bake(dir.path(), "blocked", &scene(width));
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(!run.status.success() && said.contains("S030") && said.contains(share), "{said}");
        assert!(said.contains("wind.lattice.cells") && said.contains("gap") && !said.contains("S024"), "{said}");
    }
    let run = bake(dir.path(), "narrow", &scene(12.0));
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success() && said.contains("S021") && said.contains("60 %"), "{said}");
}

/// A wall across one of the two joined sides of a box is refused before any step, with advice that helps; at either side, by a
/// check as by a bake. One that crosses both is not, nor one that ends at the side.
#[test]
fn solids_across_one_joined_side_are_refused() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = |at: f64, width: f64, sides: &str| {
        format!(
            "[frames]\nend = 2\n[ground]\nshow = false\n[wind]\nmodel = \"lattice\"\nspeed = 3\n[wind.lattice]\n\
             cells = [32, 16, 40]\ndx = 0.5\nspin_up_s = 0.5\nsides = \"{sides}\"\n[[solid]]\nname = \"fence\"\n\
             at = [0, 0, {at}]\nsize = [0.5, 4, {width}]\n[output]\nformats = [\"obj\"]\n[output.wind]\nvti_every = 2\n"
        )
    };
    for (at, side) in [(8.0, "z = 10 m"), (-8.0, "z = -10 m")] {
        let run = bake(dir.path(), "crossing", &scene(at, 6.0, "auto"));
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(!run.status.success() && said.contains("S039") && said.contains("\"fence\""), "{said}");
        assert!(said.contains(side) && said.contains("wind.lattice.sides"), "{said}");
        let run = bake(dir.path(), "open", &scene(at, 6.0, "open"));
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    }
    for (at, width) in [(7.0, 6.0), (1.0, 30.0), (40.0, 6.0)] {
        let run = bake(dir.path(), "allowed", &scene(at, width, "auto"));
        assert!(run.status.success(), "{at} {width}: {}", String::from_utf8_lossy(&run.stderr));
    }
}

/// A flight in an analytic wind tells of open meshes as a lattice does, once each; a closed one is not named.
#[test]
fn flights_without_a_lattice_tell_of_open_meshes() {
    let dir = tempfile::tempdir().expect("dir");
    for (name, closed) in [("closed.obj", true), ("open.obj", false)] {
        std::fs::write(dir.path().join(name), wall_obj(closed)).expect("mesh");
    }
    let scene = |wind: &str| {
        format!(
            "[frames]\nend = 2\n[ground]\nshow = false\n[catkin]\nhairs = 2\n[flight]\ncount = 20\n[wind]\n{wind}\n\
             [[solid]]\nname = \"fence\"\nshape = \"mesh\"\nmesh = \"open.obj\"\nat = [3, 0, 0]\n\
             [[solid]]\nname = \"shut\"\nshape = \"mesh\"\nmesh = \"closed.obj\"\nat = [-3, 0, 0]\n\
             [output]\nformats = [\"csv\"]\n"
        )
    };
    let lattice = "model = \"lattice\"\n[wind.lattice]\ncells = [40, 24, 60]\ndx = 0.5\nspin_up_s = 0.5";
    for (name, wind) in [("gust", "model = \"gust\""), ("lattice", lattice)] {
        let run = bake(dir.path(), name, &scene(wind));
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.success(), "{name}: {said}");
        assert_eq!(said.matches("S032").count(), 1, "{name}: {said}");
        assert!(said.contains("\"fence\" has 4 open edges") && !said.contains("\"shut\" has"), "{name}: {said}");
    }
}

/// Solids of fewer than eight cells are warned of, and open meshes; their sizes in cells are told.
#[test]
fn coarse_and_open_solids_are_told() {
    let dir = tempfile::tempdir().expect("dir");
    std::fs::write(dir.path().join("open.obj"), wall_obj(false)).expect("mesh");
    let text = "[frames]\nend = 2\n[ground]\nshow = false\n[wind]\nmodel = \"lattice\"\nspeed = 3\n[wind.lattice]\n\
        cells = [40, 24, 60]\ndx = 0.5\nspin_up_s = 0.5\n[[solid]]\nname = \"low\"\nsize = [0.2, 2, 4]\n[[solid]]\n\
        name = \"high\"\nat = [2, 0, 0]\nsize = [1, 4, 4]\n[[solid]]\nname = \"fence\"\nshape = \"mesh\"\nmesh = \"open.obj\"\n\
        mesh_scale = 1.5\nat = [4, 0, 0]\n[output]\nformats = [\"obj\"]\n[output.wind]\nvti_every = 2\n";
    let run = bake(dir.path(), "told", text);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{said}");
    assert!(said.contains("S031") && said.contains("\"low\" is only 4.0 cells high"), "{said}");
    assert!(
        !said.contains("\"high\" is") && said.contains("S032") && said.contains("\"fence\" has 4 open edges"),
        "{said}"
    );
    assert!(said.contains("low 4.0 high, 0.4 thick") && said.contains("high 8.0 high, 2.0 thick"), "{said}");
    assert!(said.contains("fence 9.0 high"), "{said}");
}
