//! POV-Ray's own evaluation of the scene: rays shot by its scene language hit what we say is there, within 1e-4 m.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test fails by panicking and looks at files")]
#![allow(clippy::cast_possible_truncation, reason = "frames per second are small numbers")]
#![allow(clippy::print_stdout, reason = "figures of the comparison")]

use crate::common::clients;
use crate::common::expect;
use crate::common::picture;
use crate::common::synthetic;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::common::pov::{bake, render};
use glam::{Quat, Vec3};
use osier::export::pov::PovOptions;
use osier::scene::*;

/// POV-Ray units per metre.
const S: f32 = 100.0;
/// How far in front of a surface a ray starts, m.
const BACK: f32 = 3e-4;
/// What may be between osier's and POV-Ray's surface, m.
const TOLERANCE: f32 = 1e-4;

/// A ray that must hit a surface at `at` when coming along `-from`, or must not.
struct Probe {
    what: String,
    at: Vec3,
    from: Vec3,
    hits: bool,
}

/// Three probes per triangle, a tenth of a millimetre inside its corners: a surface shifted further than that is missed
/// at its rim.
fn triangles(out: &mut Vec<Probe>, what: &str, (points, list): (&[Vec3], &[[u32; 3]]), hits: bool) {
    for (t, corners) in list.iter().enumerate() {
        let [a, b, c] = corners.map(|i| points[i as usize]);
        let normal = (b - a).cross(c - a);
        if normal.length() < 1e-9 {
            continue;
        }
        for (corner, p, q) in [(a, b, c), (b, c, a), (c, a, b)] {
            let middle = (p + q) * 0.5;
            let at = corner + (middle - corner).normalize() * TOLERANCE;
            out.push(Probe { what: format!("{what} triangle {t}"), at, from: normal.normalize(), hits });
        }
    }
}

fn probes(scene: &Scene, frame: &Frame) -> Vec<Probe> {
    let mut out = Vec::new();
    for placement in &scene.placements {
        let asset = &scene.assets[placement.asset];
        let Some(state) = frame.shown(placement) else { continue };
        let world = |p: Vec3| placement.transform.apply(p);
        for (i, object) in asset.meshes.iter().enumerate() {
            let what = format!("{}/{}", placement.name, object.name);
            let points: Vec<Vec3> = mesh_points(asset, object, i, state).iter().map(|p| world(*p)).collect();
            let list = match state.mesh(i) {
                MeshFrame::Whole { mesh, .. } => &mesh.triangles,
                _ => &object.mesh.triangles,
            };
            triangles(&mut out, &what, (&points, list), true);
        }
        for (i, instancer) in asset.instancers.iter().enumerate() {
            let states = instance_states(asset, instancer, i, state);
            for k in 0..instancer.len() {
                let mesh = &instancer.prototypes[instancer.protos[k] as usize].mesh;
                let trs = instancer.transform(&states, k);
                let points: Vec<Vec3> = mesh.points.iter().map(|p| world(trs.apply(*p))).collect();
                let what = format!("{}/{} {k}", placement.name, instancer.name);
                triangles(&mut out, &what, (&points, &mesh.triangles), states.is_alive(k));
            }
        }
        for (i, cloud) in asset.points.iter().enumerate() {
            let PointsFrame::State { positions, widths, velocities, .. } = state.points(i) else { continue };
            let water = scene.materials[cloud.material as usize].class == MaterialClass::Water;
            for (k, (p, w)) in positions.iter().zip(widths).enumerate() {
                let axis = velocities[k].normalize();
                let side = axis.cross(Vec3::Z).normalize();
                // A streak of half a frame is as wide as the drop at the drop's own place and tapers to both ends: a quarter of
                // the way to its front end three quarters of that are left. Water that falls less far than three times its
                // width is a ball, as all else is.
                let half = velocities[k] * (0.25 / scene.clip.fps() as f32);
                let streak = water && half.length() > 3.0 * (w * 0.5);
                let (on, left) = if streak { (half * 0.25, 0.75) } else { (Vec3::ZERO, 1.0) };
                let sides = if streak { vec![side, -side] } else { vec![side, axis, -axis, Vec3::Z] };
                let radius = if w > &0.0 { w * 0.5 } else { 0.01 } * left;
                for from in sides {
                    let what = format!("{}/{} {k}", placement.name, cloud.name);
                    out.push(Probe { what, at: world(*p + on) + from * radius, from, hits: *w > 0.0 });
                }
            }
        }
        for (i, curves) in asset.curves.iter().enumerate() {
            let CurvesFrame::Points(points) = state.curves(i) else { continue };
            let mut first = 0;
            for count in &curves.counts {
                for k in first..first + *count as usize {
                    // Across both neighbouring pieces, where the curve is as thick as its width.
                    let before = points[k] - points[k.saturating_sub(1).max(first)];
                    let after = points[(k + 1).min(first + *count as usize - 1)] - points[k];
                    let across = before.cross(after);
                    let plain = (before + after).cross(Vec3::X);
                    let from = if across.length() > 1e-6 { across.normalize() } else { plain.normalize() };
                    let what = format!("{}/{} {k}", placement.name, curves.name);
                    out.push(Probe { what, at: world(points[k]) + from * curves.widths[k] * 0.5, from, hits: true });
                }
                first += *count as usize;
            }
        }
    }
    out
}

/// A vector of ours as POV-Ray's, written out here independently of the exporter.
fn vector(v: Vec3, scale: f32) -> String {
    format!("<{},{},{}>", v.x * scale, v.y * scale, -v.z * scale)
}

/// Shoots the probes in POV-Ray and returns where each ray hit, m, our space.
fn shoot(povray: &Path, dir: &Path, frame: u32, probes: &[Probe]) -> Vec<Option<Vec3>> {
    let mut text = String::from("#include \"main.pov\"\n#declare World = OsWorld()\n#fopen Out \"hits.txt\" write\n");
    text.push_str("#macro Shoot(P, D)\n  #local N = <0,0,0>;\n  #local H = trace(World, P, D, N);\n");
    text.push_str("  #if (vlength(N) = 0) #write (Out, \"-\\n\") #else #write (Out, vstr(3, H, \" \", 0, 9), \"\\n\") #end\n#end\n");
    for p in probes {
        writeln!(text, "Shoot({}, {})", vector(p.at + p.from * BACK, S), vector(-p.from, 1.0)).expect("text");
    }
    text.push_str("#fclose Out\n");
    fs::write(dir.join("probe.pov"), text).expect("probe");
    let (from, to) = (format!("+SF{frame}"), format!("+EF{frame}"));
    render(povray, dir, &["render.ini", "+Iprobe.pov", &from, &to, "+Oprobe.png", "+W8", "+H6", "-A"]);
    let hits = fs::read_to_string(dir.join("hits.txt")).expect("hits");
    let parse = |line: &str| {
        let v: Vec<f32> = line.split(' ').filter_map(|n| n.parse().ok()).collect();
        (v.len() == 3).then(|| Vec3::new(v[0], v[1], -v[2]) / S)
    };
    hits.lines().map(parse).collect()
}

fn compare(scene: &Scene, frames: &[Frame]) {
    let dir = tempfile::tempdir().expect("dir");
    bake(dir.path(), scene, frames, PovOptions::default());
    let Some(povray) = clients::povray() else { return };
    for number in expect::three(scene) {
        let frame = frames.iter().find(|f| f.number == number).expect("frame");
        let probes = probes(scene, frame);
        assert!(probes.len() > 500, "{} probes", probes.len());
        let hits = shoot(&povray, &dir.path().join("pov"), number, &probes);
        assert_eq!(hits.len(), probes.len());
        let mut worst = 0.0_f32;
        for (p, hit) in probes.iter().zip(&hits) {
            let off = hit.map_or(f32::INFINITY, |h| (h - p.at).length());
            if p.hits {
                assert!(off < TOLERANCE, "frame {number}, {}: wanted {}, POV-Ray has {hit:?}", p.what, p.at);
                worst = worst.max(off);
            } else {
                assert!(off > 2.0 * BACK, "frame {number}, {}: still there at {hit:?}", p.what);
            }
        }
        println!("frame {number}: {} probes, worst {worst:e} m", probes.len());
    }
}

#[test]
fn what_pov_ray_evaluates_is_where_osier_says() {
    let (mut scene, frames) = synthetic::scene();
    // What it looks at is close to the eye, so that no streak counts as falling just before the lens and is left out.
    scene.camera.target = scene.camera.eye.lerp(scene.camera.target, 0.01);
    compare(&scene, &frames);
}

/// Turns the leaves of the rig off their joints, as flutter and drops do.
fn nod(rig: &Asset, frame: &mut AssetFrame) {
    let mut state = instance_states(rig, &rig.instancers[0], 0, frame).into_owned();
    state.orientations.iter_mut().for_each(|q| *q *= Quat::from_rotation_x(0.4));
    frame.instancers = vec![InstancerFrame::State(state)];
}

/// Gives the frames of the synthetic scene's first asset, the rig, another state, also those of its copies at other times.
fn change_rig(frames: &mut [Frame], change: impl Fn(&mut AssetFrame)) {
    for frame in frames {
        change(&mut frame.assets[0]);
        frame.shifted.iter_mut().filter(|((asset, _), _)| *asset == 0).for_each(|(_, state)| change(state));
    }
}

#[test]
fn leaves_in_the_rain_are_where_osier_says() {
    let (mut scene, mut frames) = synthetic::scene();
    // As above, so that no streak is left out.
    scene.camera.target = scene.camera.eye.lerp(scene.camera.target, 0.01);
    assert!(scene.materials.iter().any(|m| m.class == MaterialClass::Water));
    change_rig(&mut frames, |state| nod(&scene.assets[0], state));
    compare(&scene, &frames);
}

#[test]
fn leaves_on_bark_of_given_points_are_where_osier_says() {
    let (mut scene, mut frames) = synthetic::scene();
    for material in scene.materials.iter_mut().filter(|m| m.class == MaterialClass::Water) {
        material.class = MaterialClass::Leaf;
    }
    let rig = scene.assets[0].clone();
    scene.assets[0].meshes[0].motion = MeshMotion::Deforming;
    change_rig(&mut frames, |state| {
        nod(&rig, state);
        let points = mesh_points(&rig, &rig.meshes[0], 0, state).into_owned();
        let normals = rig.meshes[0].mesh.normals.clone();
        state.meshes = vec![MeshFrame::Points { points, normals, velocities: Vec::new() }];
    });
    compare(&scene, &frames);
}

#[test]
fn spheres_are_where_osier_says() {
    let (mut scene, frames) = synthetic::scene();
    scene.assets[3].points[0].material = 1;
    compare(&scene, &frames);
}

#[test]
fn known_points_project_within_half_a_pixel() {
    let colors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let places = [Vec3::new(0.9, 0.3, 0.2), Vec3::new(-1.1, 1.4, -0.6), Vec3::new(0.2, 1.9, 1.1)];
    let (mut scene, _) = synthetic::scene();
    scene.camera = Camera { eye: Vec3::new(2.5, 1.7, 6.0), target: Vec3::new(0.1, 1.1, -0.3), vfov: 0.7, roll: 0.35 };
    scene.sun.strength = 0.0;
    scene.sky.strength = 0.0;
    let turn = Quat::from_rotation_y(0.7);
    scene.placements = vec![Placement {
        name: "dots".into(),
        asset: 3,
        transform: Trs { t: Vec3::new(0.2, -0.1, 0.3), r: turn, s: Vec3::ONE },
        phase: 0,
    }];
    let dots = &mut scene.assets[3];
    dots.meshes.clear();
    dots.curves.clear();
    dots.points[0] = Points {
        name: "dots".into(),
        material: 1,
        positions: places.to_vec(),
        widths: vec![0.08; 3],
        colors: colors.to_vec(),
        attributes: Vec::new(),
        moving: false,
        reach: osier::geometry::Bounds::default(),
    };
    let dir = tempfile::tempdir().expect("dir");
    bake(dir.path(), &scene, &[], PovOptions::default());
    let Some(povray) = clients::povray() else { return };
    let pov = dir.path().join("pov");
    fs::write(pov.join("glow.pov"), "#version 3.7;\n#default { finish { emission 1 } }\n#include \"main.pov\"\n")
        .expect("glow");
    for (w, h) in [(200_u16, 150_u16), (120, 180)] {
        let (width, height) = (format!("+W{w}"), format!("+H{h}"));
        render(&povray, &pov, &["glow.pov", "+L..", "+Oglow.png", "+A0.01", "+AM2", "+R3", &width, &height]);
        let picture = picture::Picture::open(&pov.join("glow.png"));
        for (i, place) in places.iter().enumerate() {
            let p = scene.placements[0].transform.apply(*place);
            let (x, y) = picture::project(&scene.camera, p, (f32::from(w), f32::from(h))).expect("in front");
            let weight = |c: [f32; 3]| c[i] - c[(i + 1) % 3] - c[(i + 2) % 3];
            let (gx, gy) = picture.centroid(weight).expect("a dot");
            assert!((gx - x).abs() < 0.5 && (gy - y).abs() < 0.5, "{w} x {h}, dot {i}: {gx} {gy} instead of {x} {y}");
        }
    }
}
