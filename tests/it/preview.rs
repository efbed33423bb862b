//! `osier preview` as a person runs it.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test may fail and reads what it likes")]

use std::path::Path;

use crate::common::program::{arg, ends};

const SPRIG: &str = "tests/scenes/sprig.toml";

fn picture(path: &Path) -> image::RgbaImage {
    image::open(path).expect("picture").to_rgba8()
}

/// How much two pictures differ on average, in 1/255.
fn difference(a: &image::RgbaImage, b: &image::RgbaImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let sum: u64 = a.iter().zip(b.iter()).map(|(x, y)| u64::from(x.abs_diff(*y))).sum();
    sum as f64 / a.len() as f64
}

#[test]
fn bytes_do_not_depend_on_threads_and_seeds_do_make_others() {
    let dir = tempfile::tempdir().expect("dir");
    for quality in ["draft", "normal"] {
        let bytes = |jobs: &str| {
            let out = dir.path().join(format!("{quality}{jobs}.png"));
            let flags = ["preview", SPRIG, "--size", "96x80", "--quality", quality, "-j", jobs, "-o", arg(&out)];
            ends(0, &flags);
            std::fs::read(out).expect("file")
        };
        let one = bytes("1");
        assert!(one == bytes("2") && one == bytes("8"), "{quality}");
    }
    let (a, b) = (dir.path().join("a.png"), dir.path().join("b.png"));
    ends(0, &["preview", "birch", "--quality", "draft", "--size", "64", "--background", "none", "-o", arg(&a)]);
    ends(
        0,
        &[
            "preview",
            "birch",
            "--quality",
            "draft",
            "--size",
            "64",
            "--background",
            "none",
            "--seed",
            "9",
            "-o",
            arg(&b),
        ],
    );
    assert!(difference(&picture(&a), &picture(&b)) > 1.0);
}

#[test]
fn outputs_and_flags_that_would_mislead_are_refused() {
    let dir = tempfile::tempdir().expect("dir");
    let file = |name: &str| dir.path().join(name);
    // A PNG in a file of another name would puzzle the next program.
    for name in ["a.jpg", "a.gif", "a.exr"] {
        let (_, err) = ends(2, &["preview", SPRIG, "--size", "16", "-o", arg(&file(name))]);
        assert!(err.contains("written as .png") && !file(name).exists(), "{err}");
    }
    // A picture of layers has neither camera nor frames, nor a sheet of seeds.
    for flag in [
        ["--view", "top"],
        ["--background", "none"],
        ["--sun", "30,0"],
        ["--seeds", "0-3"],
        ["--columns", "2"],
        ["--compare", "oak"],
        ["--frame", "2"],
    ] {
        let (_, err) = ends(2, &["preview", "fig9", "--size", "32x18", flag[0], flag[1], "-o", arg(&file("b.png"))]);
        assert!(err.contains(flag[0]) && err.contains("layers") && !file("b.png").exists(), "{err}");
    }
    let (_, err) = ends(2, &["preview", "fig9", "--turntable", "4", "-o", arg(&file("b.gif"))]);
    assert!(err.contains("--turntable") && !file("b.gif").exists(), "{err}");
    ends(0, &["preview", "fig9", "--size", "32x18", "--seed", "3", "-o", arg(&file("b.png"))]);
    // Only a contact sheet has columns, and at least one.
    for (more, why) in [
        (&["--columns", "2"][..], "contact sheet"),
        (&["--columns", "2", "--turntable", "4"], "contact sheet"),
        (&["--columns", "0", "--seeds", "0-1"], "'--columns <N>'"),
        (&["--columns", "2", "--seeds", "0-1", "--sweep", "sky.glow=0,1,2"], "two axes"),
        (&["--columns", "2", "--sweep", "sun.strength=1,2", "--sweep", "sky.glow=0,1,2"], "two axes"),
    ] {
        let out = file("d.png");
        let flags = ["preview", SPRIG, "--size", "16", "--quality", "draft", "-o", arg(&out)];
        let (_, err) = ends(2, &[&flags[..], more].concat());
        assert!(err.contains("--columns") && err.contains(why) && !out.exists(), "{err}");
    }
    // Four equal pictures with the names of seeds would be no sheet of seeds.
    std::fs::write(file("t.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("file");
    let mesh = file("t.obj");
    for flag in [
        ["--seeds", "0-3"],
        ["--seed", "3"],
        ["--set", "sun.strength=0"],
        ["--sweep", "sky.glow=0,1"],
        ["--steps", "2"],
    ] {
        let (_, err) = ends(2, &["preview", arg(&mesh), "--size", "16", flag[0], flag[1], "-o", arg(&file("c.png"))]);
        assert!(err.contains(flag[0]) && !file("c.png").exists(), "{err}");
    }
    let beside = ["preview", arg(&mesh), "--compare", SPRIG, "--seed", "3", "--size", "16", "--quality", "draft"];
    ends(0, &[&beside[..], &["-o", arg(&file("c.png"))]].concat());
}

#[test]
fn a_folder_without_a_bake_hides_no_preset() {
    let dir = tempfile::tempdir().expect("dir");
    std::fs::create_dir(dir.path().join("grass")).expect("folder");
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_osier"))
        .args(["-q", "preview", "grass", "--size", "16", "--quality", "draft", "-o", "grass.png"])
        .current_dir(dir.path())
        .output()
        .expect("osier runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let (_, err) = ends(1, &["preview", arg(&dir.path().join("grass")), "-o", arg(&dir.path().join("g.png"))]);
    assert!(err.contains("is a folder"), "{err}");
}

#[test]
fn a_transparent_picture_shows_the_plant_its_shadow_and_nothing_else() {
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("twig.png");
    let flags = ["preview", "poplar-twig.l", "--size", "120x160", "--background", "none", "--quality", "draft"];
    ends(0, &[&flags[..], &["-o", arg(&out)]].concat());
    let p = picture(&out);
    let covered = p.pixels().filter(|c| c.0[3] > 200).count();
    let clear = p.pixels().filter(|c| c.0[3] == 0).count();
    assert!(covered > 300 && clear > 4000, "{covered} covered, {clear} clear");
    assert_eq!(p.get_pixel(0, 0).0[3], 0);
    let green = p.pixels().filter(|c| c.0[3] > 200 && c.0[1] > c.0[0] && c.0[1] > c.0[2]).count();
    assert!(green > covered / 3, "{green} of {covered} are green");
}

#[test]
fn a_camera_below_the_floor_sees_the_plant_on_it() {
    let dir = tempfile::tempdir().expect("dir");
    for quality in ["draft", "normal"] {
        let out = dir.path().join(format!("{quality}.png"));
        let flags = ["preview", "poplar-twig.l", "--size", "120x160", "--view", "30,-40", "--background", "none"];
        ends(0, &[&flags[..], &["--quality", quality, "-o", arg(&out)]].concat());
        let p = picture(&out);
        let green = p.pixels().filter(|c| c.0[3] > 200 && c.0[1] > c.0[0] && c.0[1] > c.0[2]).count();
        assert!(green > 80, "{quality}: {green} pixels of leaves");
    }
}

#[test]
fn sheets_have_a_cell_for_every_seed_and_value() {
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("sheet.png");
    let common = ["--size", "60x50", "--quality", "draft", "-o", arg(&out), "--force"];
    ends(0, &[&["preview", "birch.l", "--seeds", "0-3,7"][..], &common].concat());
    let seeds = picture(&out);
    // Three columns of 60 and two rows of 50 pixels, margins, captions and a title line.
    assert_eq!(seeds.dimensions(), (3 * 70 + 10, 2 * (50 + 36) + 10 + 34));
    let sweeps =
        ["preview", "koch", "--sweep", "plants.koch.turtle.width=0.01,0.02", "--sweep", "plants.koch.steps=1:3:3"];
    let (_, err) = ends(0, &[&sweeps[..], &common].concat());
    assert!(!err.contains("error"), "{err}");
    assert_eq!(picture(&out).dimensions(), (2 * 70 + 10, 3 * (50 + 36) + 10 + 34));
}

#[test]
fn moving_pictures_hold_the_frames_that_were_asked_for() {
    let dir = tempfile::tempdir().expect("dir");
    let gif = dir.path().join("sway.gif");
    let small = ["--size", "48x40", "--quality", "draft"];
    ends(0, &[&["preview", SPRIG, "--frames", "1-6:2", "-o", arg(&gif)][..], &small].concat());
    let mut decoder = gif::Decoder::new(std::fs::File::open(&gif).expect("file")).expect("gif");
    let mut frames: Vec<Vec<u8>> = Vec::new();
    while let Some(frame) = decoder.read_next_frame().expect("frame") {
        assert_eq!((frame.width, frame.height, frame.delay), (48, 40, 8));
        frames.push(frame.buffer.to_vec());
    }
    assert_eq!(frames.len(), 3);
    assert!(frames[0] != frames[1] && frames[1] != frames[2], "it moves");

    let apng = dir.path().join("turn.apng");
    let flags = ["preview", "poplar-twig.l", "--turntable", "5", "--background", "none", "-o", arg(&apng)];
    ends(0, &[&flags[..], &small].concat());
    let file = std::io::BufReader::new(std::fs::File::open(&apng).expect("file"));
    let mut reader = png::Decoder::new(file).read_info().expect("png");
    assert_eq!(reader.info().animation_control.expect("animated").num_frames, 5);
    let mut turns: Vec<Vec<u8>> = Vec::new();
    for _ in 0..5 {
        let mut buffer = vec![0; reader.output_buffer_size().expect("size")];
        reader.next_frame(&mut buffer).expect("frame");
        turns.push(buffer);
    }
    assert!(turns.windows(2).all(|w| w[0] != w[1]), "it turns");
}

#[test]
fn numbered_pictures_are_the_frames_of_the_clip() {
    let dir = tempfile::tempdir().expect("dir");
    let common = ["--frames", "1-6:2", "--size", "48x40", "--quality", "draft", "--background", "none"];
    let (apng, pattern) = (dir.path().join("sway.apng"), dir.path().join("sway_###.png"));
    ends(0, &[&["preview", SPRIG, "-o", arg(&apng)][..], &common].concat());
    let names: Vec<_> = [1, 3, 5].map(|n| dir.path().join(format!("sway_{n:03}.png"))).into();
    // A dry run names them without writing; the second run replaces pictures of the first.
    for more in [&["-n", "--json"][..], &["--json"], &["--json"]] {
        let (json, _) = ends(0, &[&["preview", SPRIG, "-o", arg(&pattern)][..], &common, more].concat());
        let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        let paths: Vec<&str> =
            json["files"].as_array().expect("files").iter().filter_map(|f| f["path"].as_str()).collect();
        assert!(paths == names.iter().map(|n| arg(n)).collect::<Vec<_>>() && json["frames"] == 3, "{json}");
        assert_eq!(names[0].exists(), more.len() == 1);
    }
    let file = std::io::BufReader::new(std::fs::File::open(&apng).expect("file"));
    let mut reader = png::Decoder::new(file).read_info().expect("png");
    for name in &names {
        let mut buffer = vec![0; reader.output_buffer_size().expect("size")];
        reader.next_frame(&mut buffer).expect("frame");
        assert!(picture(name).into_raw() == buffer, "{}", name.display());
    }
    assert!(!pattern.exists());
    let (_, err) = ends(2, &[&["preview", SPRIG, "-o", "x.mp4"][..], &common].concat());
    assert!(err.contains("NAME_####.png"), "{err}");
}

#[test]
fn what_was_baked_looks_like_what_was_grown() {
    let dir = tempfile::tempdir().expect("dir");
    let bake = dir.path().join("bake");
    ends(0, &["bake", SPRIG, "--formats", "glb", "--frames", "1", "-o", arg(&bake)]);
    let (a, b) = (dir.path().join("a.png"), dir.path().join("b.png"));
    let look = ["--size", "160x120", "--background", "#ffffff", "--view", "20,10", "--set", "ground.show=false"];
    ends(0, &[&["preview", SPRIG, "-o", arg(&a)][..], &look].concat());
    let glb = dir.path().join("sprig.glb");
    ends(0, &["grow", SPRIG, "-o", arg(&glb)]);
    ends(0, &[&["preview", arg(&glb), "-o", arg(&b)][..], &look[..6]].concat());
    let apart = difference(&picture(&a), &picture(&b));
    assert!(apart < 4.0, "they differ by {apart} on average");
    let whole = dir.path().join("c.png");
    ends(0, &["preview", arg(&bake), "--size", "80x60", "--quality", "draft", "-o", arg(&whole)]);
    assert!(picture(&whole).pixels().any(|p| p.0[1] > p.0[2]), "leaves are green");
    let side = dir.path().join("d.png");
    let flags = ["preview", "birch.l", "--compare", "oak.l", "--size", "80x60", "--quality", "draft", "-o", arg(&side)];
    ends(0, &flags);
    assert_eq!(picture(&side).width(), 2 * 90 + 10);
}

#[test]
fn a_bake_whose_scene_is_named_like_a_part_of_it_is_shown_whole() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("house.toml");
    let text = "[[solid]]\nshape = \"house\"\n[plants.a]\ngrammar = \"birch.l\"\nsteps = 4\n[[place]]\nplant = \"a\"\n\
                at = [9, 0, 0]\n[ground]\nside = 64\n";
    std::fs::write(&scene, text).expect("scene");
    let mut pictures = Vec::new();
    for assets in ["false", "true"] {
        let bake = dir.path().join(assets);
        let set = format!("output.gltf.assets={assets}");
        let (out, _) = ends(0, &["bake", arg(&scene), "--formats", "glb", "--set", &set, "-o", arg(&bake)]);
        // The name without a number belongs to the house alone.
        assert_eq!(bake.join("gltf/house.web.glb").exists(), assets == "true");
        let whole = bake.join("gltf/house_2.web.glb");
        assert!(out.contains(arg(&whole)), "{out}");
        let file = dir.path().join(format!("{assets}.png"));
        ends(0, &["preview", arg(&bake), "--size", "64x48", "--quality", "draft", "-o", arg(&file)]);
        pictures.push(picture(&file));
    }
    // Where each asset has a file of its own, that of the house shows no tree.
    assert!(pictures[0] == pictures[1], "the bake with a file of its house is shown as without");
}

/// The advice was to bake again with format glb, which this bake has.
#[test]
fn a_bake_for_engines_alone_names_the_profiles_that_are_shown() {
    let dir = tempfile::tempdir().expect("dir");
    let bake = dir.path().join("bake");
    let engine = "output.gltf.profiles=[\"engine\"]";
    ends(0, &["bake", "koch.l", "--formats", "glb", "--set", engine, "-q", "-o", arg(&bake)]);
    let (_, told) = ends(1, &["preview", arg(&bake), "-o", arg(&dir.path().join("x.png"))]);
    assert!(told.contains("S001") && told.contains("profile web or blender"), "{told}");
}

#[test]
fn a_bake_has_land_camera_sun_and_materials_of_its_scene() {
    let dir = tempfile::tempdir().expect("dir");
    let file = |name: &str| dir.path().join(name);
    let text = "[plants.grass]\ngrammar = \"grass.l\"\n[plants.grass.bark]\nside = 16\n[plants.grass.shoot]\nside = 16\n\
                [[place]]\nplant = \"grass\"\n[ground]\nside = 16\n[camera]\neye = [0.6, 0.4, 0.8]\ntarget = [0, 0.1, 0]\n\
                roll_deg = 5\n[sun]\nelevation_deg = 20\ndirection_deg = 10\n";
    std::fs::write(file("tuft.toml"), text).expect("file");
    ends(0, &["bake", arg(&file("tuft.toml")), "--formats", "glb", "-o", arg(&file("baked"))]);
    let limits = osier::limits::Limits::default();
    let baked = osier::scene_preview::PreviewScene::of_bake(&file("baked"), &[], &limits).expect("a bake");
    // The tuft is framed, and not the 160 m of ground around it.
    let subject = baked.subject(None).expect("a subject");
    assert!(subject.ground && subject.bounds.size().max_element() < 1.0, "{:?}", subject.bounds);
    let scene = baked.scene();
    assert!(scene.camera.eye.abs_diff_eq(glam::Vec3::new(0.6, 0.4, 0.8), 1e-5), "{:?}", scene.camera);
    assert!((scene.camera.roll - 5_f32.to_radians()).abs() < 1e-4, "{:?}", scene.camera);
    let toward = (glam::Vec3::new(0.0, 0.1, 0.0) - scene.camera.eye).normalize();
    assert!(scene.camera.axes()[2].abs_diff_eq(-toward, 1e-5), "{:?}", scene.camera);
    assert!((scene.sun.elevation - 20_f32.to_radians()).abs() < 1e-5, "{:?}", scene.sun);
    let [x, z] = [10_f32.to_radians().cos(), -10_f32.to_radians().sin()].map(|v| v * 20_f32.to_radians().cos());
    let sun = scene.sun.direction();
    assert!((sun.x - x).abs() < 1e-5 && (sun.z - z).abs() < 1e-5, "{sun:?}");
    let bark = scene.materials.iter().find(|m| m.name == "grass_shoot").expect("bark");
    assert!(bark.class.word() == "bark" && bark.translucency.abs() < 1e-9, "{bark:?}");
    // A mesh file has no camera: the scene's view of it is the fitted one, and not one from inside of it.
    let (glb, pictures) = (file("tuft.glb"), [file("fitted.png"), file("scene.png")]);
    ends(0, &["grow", arg(&file("tuft.toml")), "-o", arg(&glb)]);
    // Of a glTF file without a manifest only the materials transmit light that say so.
    let read = osier::scene_preview::PreviewScene::of_mesh_file(&glb, &[], &limits).expect("a mesh");
    let bark = read.scene().materials.iter().find(|m| m.name == "grass_shoot").expect("bark");
    assert!(bark.translucency.abs() < 1e-9, "{bark:?}");
    for (view, out) in ["portrait", "scene"].iter().zip(&pictures) {
        ends(0, &["preview", arg(&glb), "--view", view, "--size", "32", "--quality", "draft", "-o", arg(out)]);
    }
    assert_eq!(picture(&pictures[0]), picture(&pictures[1]));
}

/// The mesh of such a bake has nothing beside its land, which the camera then frames.
#[test]
fn a_bake_of_a_terrain_alone_is_shown() {
    let dir = tempfile::tempdir().expect("dir");
    let file = |name: &str| dir.path().join(name);
    std::fs::write(file("land.toml"), "[terrain]\nsize = 20\nsubdivisions = 3\nside = 16\n").expect("file");
    ends(0, &["bake", arg(&file("land.toml")), "--formats", "glb", "-q", "-o", arg(&file("baked"))]);
    ends(0, &["preview", arg(&file("baked")), "--size", "32", "--quality", "draft", "-o", arg(&file("land.png"))]);
}

#[test]
fn every_mistake_is_named() {
    let dir = tempfile::tempdir().expect("dir");
    let file = |name: &str, text: &[u8]| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).expect("file");
        path
    };
    let empty = file("empty.l", b"lsystem: 1\nderivation length: 1\naxiom: A\nA --> B\nendlsystem\n");
    let broken = file("broken.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff");
    let crate_file = file("tree.usdc", b"PXR-USDC");
    let out = dir.path().join("x.png");
    let cases: &[(i32, &[&str], &str)] = &[
        (1, &[arg(&empty)], "P001"),
        (1, &[arg(&broken)], "broken.glb"),
        (1, &[arg(&crate_file)], "--formats glb"),
        (1, &["no-such-thing"], "no such file or preset"),
        (2, &["oak", "--size", "200000"], "--max-image-side"),
        (2, &["oak", "--size", "16000x16000", "--max-image-side", "20k"], "--max-image-bytes"),
        (2, &["oak", "--size", "0x5"], "WIDTHxHEIGHT"),
        (2, &["oak", "--view", "upside"], "portrait"),
        (2, &["oak", "--background", "#12345"], "#f4f1ea"),
        (2, &["oak", "--sun", "40"], "ELEVATION,DIRECTION"),
        (2, &["oak", "--sweep", "x=1:2"], "FROM:TO:COUNT"),
        (2, &["oak", "--seeds", "0-3", "--turntable"], "exclude each other"),
        (2, &["oak", "--seeds", "0-5000"], "1024"),
        (2, &[SPRIG, "--frame", "99"], "outside the scene's 1 to 6"),
        (2, &[SPRIG, "--frames", "5-9"], "--frames: frame 7 is outside the scene's 1 to 6"),
        (2, &["koch", "--frame", "4"], "which has the one frame 1; --set frames.end=4"),
        (2, &["koch", "--frames", "1-4"], "--frames: frame 2 is outside the scene, which has the one frame 1; --set"),
        (2, &["koch", "--frames", "1"], "--turntable"),
        // Before the plant grows, which here would be refused.
        (2, &["koch", "--frames", "1-4", "--max-modules", "1"], "--frames: frame 2 is outside the scene"),
        (2, &["koch", "--frame", "4", "--max-modules", "1"], "--frame: frame 4 is outside the scene"),
        (2, &["oak", "--turntable", "-o", "x.mp4"], ".gif"),
    ];
    for (code, flags, told) in cases {
        let place: &[&str] = if flags.contains(&"-o") { &[] } else { &["-o", arg(&out)] };
        let flags = [&["preview"], *flags, place].concat();
        let (_, err) = ends(*code, &flags);
        assert!(err.contains(told), "{flags:?} should say {told}: {err}");
        assert!(!out.exists(), "{flags:?} leaves no file");
    }
    // Seeds have 64 bits, as everywhere else.
    let last = ["preview", "koch", "--seeds", "18446744073709551615", "--size", "16", "--quality", "draft"];
    ends(0, &[&last[..], &["-o", arg(&dir.path().join("last.png"))]].concat());
    let foreign = file("mine.png", b"my own picture");
    let flags = ["preview", "koch", "--size", "20", "--quality", "draft", "-o", arg(&foreign)];
    let (_, err) = ends(1, &flags);
    assert!(err.contains("--force"), "{err}");
    assert_eq!(std::fs::read(&foreign).expect("file"), b"my own picture");
    ends(0, &[&flags[..], &["--force"]].concat());
    ends(0, &flags);
}
