//! Drawings held to pictures that were looked at.
//!
//! Each scene of `tests/golden/pictures` has a picture beside it; no channel of a pixel may differ by more than 1 of 255. A
//! difference leaves `expected | difference | actual` in `target/golden-diff`. `OSIER_BLESS=1 cargo test --test it golden`
//! renews the pictures and still fails, so that blessing is never silent.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test may fail and reads what it likes")]

use crate::common::synthetic;
use std::path::{Path, PathBuf};

use osier::bake::{BakeContext, motion, scene};
use osier::limits::Limits;
use osier::preview::{
    Backdrop, CameraView, ContactSheetCell, Light, Picture, PreviewMaterials, Quality, RenderRequest, RenderScene,
    Subject, contact_sheet, render,
};
use osier::progress::{Cancel, Silent};
use osier::recipe::{Library, Request, resolve};
use osier::scene::{Frame, InstancerFrame, MeshFrame, Scene};

/// Most that a channel may differ, of 255.
const TOLERANCE: u8 = 1;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/pictures")
}

fn draw(scene: &Scene, frame: Option<&Frame>, own_camera: bool, size: [u32; 2]) -> Picture {
    let materials = PreviewMaterials::new(scene, Quality::Normal);
    let world = RenderScene::new(scene, frame, &materials);
    let subject = Subject::of(scene, frame);
    #[allow(clippy::cast_precision_loss, reason = "small pictures")]
    let aspect = size[0] as f32 / size[1] as f32;
    let shot = RenderRequest {
        camera: if own_camera { scene.camera } else { subject.camera(CameraView::Portrait, aspect, scene.camera.vfov) },
        size,
        light: Light::new(&scene.sun, &scene.sky),
        backdrop: if own_camera { Backdrop::Sky } else { Backdrop::Studio { floor: Some(subject.bounds.min.y) } },
        seed: 0,
    };
    render(&world, &shot, &Cancel::default(), &Silent).expect("picture")
}

fn built(name: &str) -> scene::AssembledScene {
    let path = folder().join(name);
    let request = Request {
        name: name.trim_end_matches(".toml").into(),
        shown: name.into(),
        text: std::fs::read_to_string(&path).expect("scene"),
        library: Library::new(&path, &[]).expect("library"),
        ..Request::default()
    };
    let recipe = resolve(&request).unwrap_or_else(|e| panic!("{name}: {e}")).0;
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    scene::assemble_scene(&recipe, scene::SceneOptions::default(), &work).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// All numbers of some frames as one, and the counts of every twelfth.
fn measured(scene: &Scene, frames: &[Frame]) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut put = |values: &[f32]| values.iter().for_each(|v| _ = hasher.update(&v.to_le_bytes()));
    for frame in frames {
        for state in frame.assets.iter().flat_map(|a| &a.instancers) {
            let InstancerFrame::State(s) = state else { continue };
            s.positions.iter().for_each(|p| put(&p.to_array()));
            s.orientations.iter().for_each(|q| put(&q.to_array()));
            s.velocities.iter().for_each(|v| put(&v.to_array()));
            #[allow(clippy::cast_precision_loss, reason = "small numbers")]
            s.attributes.iter().filter_map(|a| a.data.integers()).flatten().for_each(|m| put(&[*m as f32]));
        }
        for mesh in frame.assets.iter().flat_map(|a| &a.meshes) {
            let points = match mesh {
                MeshFrame::Whole { mesh, .. } => &mesh.points,
                MeshFrame::Points { points, .. } => points,
                MeshFrame::Same => continue,
            };
            points.iter().for_each(|p| put(&p.to_array()));
        }
        frame.assets.iter().flat_map(|a| &a.pose).for_each(|joint| {
            put(&joint.t.to_array());
            put(&joint.r.to_array());
        });
        frame.fields.iter().for_each(|f| put(f));
        #[allow(clippy::cast_possible_truncation, reason = "both halves are taken")]
        frame.rows.iter().flatten().for_each(|v| put(&[*v as f32, (*v - f64::from(*v as f32)) as f32]));
    }
    let counted = frames.iter().filter(|f| f.number % 12 == 0 && !scene.tables.is_empty());
    let told = counted.map(|f| {
        let whole = |v: &f64| v.fract().abs() < f64::EPSILON;
        let counts = scene.tables[0].columns.iter().zip(&f.rows[0]).filter(|(c, v)| c.1.is_empty() && whole(v));
        let counts: Vec<String> = counts.map(|(c, v)| format!("{} {v}", c.0)).collect();
        format!("frame {}: {}\n", f.number, counts.join(", "))
    });
    format!("{}tracks, maps and tables: {}\n", told.collect::<String>(), hasher.finalize().to_hex())
}

/// What is wrong with a text, if anything.
fn judge_text(name: &str, actual: &str) -> Option<String> {
    let path = folder().join(name);
    if std::env::var("OSIER_BLESS").is_ok_and(|v| v == "1") {
        std::fs::write(&path, actual).expect("write");
        return Some(format!("{name}: blessed; look at {}", path.display()));
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    (kept != actual).then(|| format!("{name}: expected\n{kept}and got\n{actual}"))
}

/// The picture on disk, or a reason why there is none.
fn kept(path: &Path) -> Result<Picture, String> {
    let image = image::open(path).map_err(|e| format!("{}: {e}", path.display()))?.to_rgba8();
    let pixels = image.pixels().map(|p| p.0).collect();
    Ok(Picture { width: image.width(), height: image.height(), pixels })
}

/// Where two pictures differ, brightened so that the eye finds it.
fn difference(a: &Picture, b: &Picture) -> Picture {
    let apart = |x: [u8; 4], y: [u8; 4]| {
        let d = [0, 1, 2, 3].map(|i| x[i].abs_diff(y[i]));
        [d[0].max(d[3]).saturating_mul(16), d[1].saturating_mul(16), d[2].saturating_mul(16), 255]
    };
    Picture { pixels: a.pixels.iter().zip(&b.pixels).map(|(x, y)| apart(*x, *y)).collect(), ..a.clone() }
}

/// What is wrong with a drawing, if anything.
fn judge(name: &str, actual: &Picture) -> Option<String> {
    let path = folder().join(format!("{name}.png"));
    if std::env::var("OSIER_BLESS").is_ok_and(|v| v == "1") {
        std::fs::write(&path, actual.png(&[], false).expect("png")).expect("write");
        return Some(format!("{name}: blessed; look at {}", path.display()));
    }
    let expected = match kept(&path) {
        Ok(picture) => picture,
        Err(why) => return Some(format!("{why}; OSIER_BLESS=1 makes it")),
    };
    if [expected.width, expected.height] != [actual.width, actual.height] {
        return Some(format!("{name}: another size"));
    }
    let channels = |p: &Picture| p.pixels.concat();
    let worst = channels(&expected).iter().zip(channels(actual)).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0);
    if worst <= TOLERANCE {
        return None;
    }
    let cell = |picture: Picture, caption: &str| ContactSheetCell { picture, caption: caption.into() };
    let middle = difference(&expected, actual);
    let cells = [cell(expected, "expected"), cell(middle, "difference x 16"), cell(actual.clone(), "actual")];
    let strip = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/golden-diff");
    std::fs::create_dir_all(&strip).expect("folder");
    let strip = strip.join(format!("{name}.png"));
    std::fs::write(&strip, contact_sheet(name, "", &cells, 3).expect("a sheet").png(&[], false).expect("png"))
        .expect("write");
    Some(format!("{name}: a channel differs by {worst}; see {}", strip.display()))
}

#[test]
fn golden_pictures_are_what_they_were() {
    let mut wrong = Vec::new();
    for (name, own_camera) in [("snowflake", false), ("seedling", false), ("meadow", true)] {
        let built = built(&format!("{name}.toml"));
        wrong.extend(judge(name, &draw(&built.animated.scene, None, own_camera, [160, 160])));
    }
    let (scene, frames) = synthetic::scene();
    for number in [1, 6] {
        let frame = frames.iter().find(|f| f.number == number);
        wrong.extend(judge(&format!("synthetic_{number}"), &draw(&scene, frame, true, [192, 128])));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// [catkin] in small: wind on a lattice, a wall, flight, sticking, deposits, to the last bit.
#[test]
fn the_golden_flight_is_what_it_was() {
    let stage = built("flight.toml").animated;
    let frames: Vec<Frame> =
        (1..=48).map(|n| motion::evaluate_frame(&stage.scene, &stage.motions, n, false).expect("a frame")).collect();
    let mut wrong = Vec::from_iter(judge_text("flight.txt", &measured(&stage.scene, &frames)));
    wrong.extend(judge("flight", &draw(&stage.scene, frames.last(), true, [192, 144])));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// [yang-wu] as it is printed: impacts, friction, merging, leaves on rods, to the last bit.
#[test]
fn the_golden_rain_of_the_paper_is_what_it_was() {
    let stage = built("paper_rain.toml").animated;
    let frames: Vec<Frame> =
        (1..=48).map(|n| motion::evaluate_frame(&stage.scene, &stage.motions, n, false).expect("a frame")).collect();
    let mut wrong = Vec::from_iter(judge_text("paper_rain.txt", &measured(&stage.scene, &frames)));
    wrong.extend(judge("paper_rain", &draw(&stage.scene, frames.last(), true, [192, 144])));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// [zhao-zhang] as it is printed but for the corrections that are on by default, in its own noise, to the last bit.
#[test]
fn the_golden_sway_of_the_paper_is_what_it_was() {
    let stage = built("paper_sway.toml").animated;
    let frames: Vec<Frame> =
        (1..=48).map(|n| motion::evaluate_frame(&stage.scene, &stage.motions, n, false).expect("a frame")).collect();
    let mut wrong = Vec::from_iter(judge_text("paper_sway.txt", &measured(&stage.scene, &frames)));
    wrong.extend(judge("paper_sway", &draw(&stage.scene, frames.last(), true, [144, 144])));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Velocities of the air on a grid of a metre, at every twelfth frame: their mean, their root mean square, and all of them as one.
fn measured_air(built: &scene::AssembledScene) -> String {
    use osier::bake::wind::scene_wind::WindUser;
    let mut places = Vec::new();
    for y in 0..8 {
        places.extend((-8..8).flat_map(|x| (-6..6).map(move |z| [x, z])).map(|[x, z]| {
            #[allow(clippy::cast_precision_loss, reason = "small whole numbers")]
            glam::Vec3::new(x as f32 + 0.5, y as f32 + 0.5, z as f32 + 0.5)
        }));
    }
    let (mut told, mut hasher) = (String::new(), blake3::Hasher::new());
    for number in [12_u32, 24, 36, 48] {
        let wind = built.wind.wind_until_next_frame(WindUser::Output, i64::from(number) - 1).expect("air");
        let mut air = vec![glam::Vec3::ZERO; places.len()];
        wind.sample(&places, f64::from(number - 1) / 24.0, &mut air);
        air.iter().flat_map(|u| u.to_array()).for_each(|u| _ = hasher.update(&u.to_le_bytes()));
        #[allow(clippy::cast_precision_loss, reason = "a small count")]
        let count = air.len() as f32;
        let mean = air.iter().sum::<glam::Vec3>() / count;
        let rms = (air.iter().map(|u| (*u - mean).length_squared()).sum::<f32>() / count).sqrt();
        told += &format!("frame {number}: mean {:.4} {:.4} {:.4}, rms {rms:.4} m/s\n", mean.x, mean.y, mean.z);
    }
    format!("{told}velocities: {}\n", hasher.finalize().to_hex())
}

/// [catkin] as it is printed: the lattice of Table 2, the flight without inertia, sticking and humidity, to the last bit.
#[test]
fn the_golden_flight_and_lattice_of_the_paper_are_what_they_were() {
    let built = built("paper_flight.toml");
    let stage = &built.animated;
    let frames: Vec<Frame> =
        (1..=48).map(|n| motion::evaluate_frame(&stage.scene, &stage.motions, n, false).expect("a frame")).collect();
    let mut wrong = Vec::from_iter(judge_text("paper_flight.txt", &measured(&stage.scene, &frames)));
    wrong.extend(judge("paper_flight", &draw(&stage.scene, frames.last(), true, [192, 144])));
    wrong.extend(judge_text("paper_lattice.txt", &measured_air(&built)));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_moved_leaf_does_not_pass() {
    let (scene, frames) = synthetic::scene();
    let a = draw(&scene, frames.first(), true, [96, 64]);
    let b = draw(&scene, frames.get(5), true, [96, 64]);
    assert!(a.pixels.iter().zip(&b.pixels).any(|(x, y)| x.iter().zip(y).any(|(p, q)| p.abs_diff(*q) > TOLERANCE)));
}
