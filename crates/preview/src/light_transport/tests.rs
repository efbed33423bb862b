//! Light transport against closed forms.

use glam::{Quat, Vec3};

use super::*;
use crate::PreviewMaterials;
use crate::Quality;
use crate::testing::{balls, material, object, scene_of};
use osier_scene::{Material, MaterialClass, Mesh, Scene, Sky, Sun};

fn quad(center: Vec3, u: Vec3, v: Vec3) -> Mesh {
    let points = vec![center - u - v, center + u - v, center + u + v, center - u + v];
    let normals = vec![u.cross(v).normalize(); 4];
    Mesh { points, normals, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
}

fn scene(meshes: Vec<Mesh>, materials: Vec<Material>, sun: f32, sky: f32) -> Scene {
    let mut scene = scene_of(materials);
    let objects = meshes.into_iter().enumerate().map(|(i, mesh)| object(&format!("m{i}"), mesh));
    scene.assets[0].meshes = objects.collect();
    scene.sun = Sun { strength: sun, color: [1.0; 3], elevation: 1.2, azimuth: 0.4, angle: 0.02 };
    scene.sky = Sky { horizon: [sky; 3], zenith: [sky; 3], ..Sky::default() };
    scene
}

/// Mean radiance along one ray, grey.
fn mean(scene: &Scene, origin: Vec3, direction: Vec3, samples: u32) -> Option<f32> {
    [LightDepth::Sky, LightDepth::Surroundings]
        .map(|light_depth| mean_at_depth(scene, origin, direction, samples, light_depth))
        .into_iter()
        .reduce(|a, b| {
            let (a, b) = (a?, b?);
            assert!((a - b).abs() < 1e-3 * b.max(0.1), "{a} and {b}: less depth, the same light");
            Some(b)
        })?
}

fn mean_at_depth(scene: &Scene, origin: Vec3, direction: Vec3, samples: u32, light_depth: LightDepth) -> Option<f32> {
    let materials = PreviewMaterials::new(scene, Quality::Normal);
    let world = RenderScene::new(scene, None, &materials);
    let light = Light::new(&scene.sun, &scene.sky);
    let sampler = Sampler::new(7, 0);
    let one = |index| {
        let sample = SampleContext {
            sampler: &sampler,
            index,
            spread: 1e-3,
            light_depth,
            samples_ambient: true,
            precomputed: None,
        };
        world.radiance(&light, origin, direction, f32::INFINITY, &sample).map(|c| c.radiance().y)
    };
    let sum = (0..samples).map(one).try_fold(0.0_f32, |s, v| v.map(|v| s + v));
    #[allow(clippy::cast_precision_loss, reason = "few samples")]
    sum.map(|s| s / samples as f32)
}

/// A crumpled strip with nooks.
fn crumpled() -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..12 {
        let turn = Quat::from_rotation_z(i as f32 * 0.9) * Quat::from_rotation_x(i as f32 * 0.5);
        let c = Vec3::new((i % 4) as f32 * 0.4 - 0.6, (i / 4) as f32 * 0.4 - 0.4, 0.0);
        mesh.append(&quad(c, turn * Vec3::X * 0.35, turn * Vec3::Y * 0.35));
    }
    mesh.with_material(0)
}

#[test]
fn white_things_vanish_in_a_white_room() {
    for (translucency, ior) in [(0.0, 1.0), (0.0, 1.5), (0.4, 1.5), (1.0, 1.33)] {
        let s = scene(vec![crumpled()], vec![material(1.0, translucency, ior)], 0.0, 1.0);
        let mut met = 0;
        for i in 0..40 {
            let x = (i % 8) as f32 * 0.18 - 0.6;
            let y = (i / 8) as f32 * 0.2 - 0.4;
            if let Some(seen) = mean(&s, Vec3::new(x, y, 4.0), Vec3::NEG_Z, 8) {
                met += 1;
                assert!((seen - 1.0).abs() < 1e-4, "at {x} {y}, translucency {translucency}: {seen}");
            }
        }
        assert!(met > 20);
    }
}

#[test]
fn an_infinite_wall_hides_half_the_sky() {
    let floor = quad(Vec3::ZERO, Vec3::Z * 1e4, Vec3::X * 1e4).with_material(0);
    let wall = quad(Vec3::X * -0.5, Vec3::Y * 1e4, Vec3::Z * 1e4).with_material(1);
    let s = scene(vec![floor, wall], vec![material(0.5, 0.0, 1.0), material(0.0, 0.0, 1.0)], 0.0, 1.0);
    // At a foot's breadth from the wall, so that its own height covers half the sky to a
    // ten-thousandth.
    let seen = mean(&s, Vec3::new(0.0, 2.0, 0.0), Vec3::NEG_Y, 4096).expect("floor");
    assert!((seen - 0.25).abs() < 2e-3, "{seen}: half the sky on a floor that sends back half");
    let open = mean(&s, Vec3::new(9e3, 2.0, 0.0), Vec3::NEG_Y, 4096).expect("floor");
    assert!(open > 0.25 && open < 0.5 + 1e-3);
}

#[test]
fn the_sun_lights_by_the_cosine_and_shadows_lie_where_they_must() {
    let floor = quad(Vec3::ZERO, Vec3::Z * 50.0, Vec3::X * 50.0).with_material(0);
    let shade = quad(Vec3::Y * 4.0, Vec3::Z, Vec3::X).with_material(0);
    let s = scene(vec![floor, shade], vec![material(0.6, 0.0, 1.0)], 2.0, 0.0);
    let sun = s.sun.direction();
    let open = mean(&s, Vec3::new(20.0, 1.0, 0.0), Vec3::NEG_Y, 64).expect("floor");
    let full = 0.6 * 2.0 * sun.y / std::f32::consts::PI;
    assert!((open - full).abs() < 0.01 * full, "{open} for {full}");
    // The shade's middle falls where the sun's ray through it meets the floor.
    let foot = Vec3::Y * 4.0 - sun * (4.0 / sun.y);
    let below = |dx: f32, dz: f32| mean(&s, foot + Vec3::new(dx, 1.0, dz), Vec3::NEG_Y, 256).expect("floor");
    assert!(below(0.0, 0.0) < 0.01 * full);
    for (dx, dz) in [(0.9, 0.0), (-0.9, 0.0), (0.0, 0.9), (0.0, -0.9)] {
        assert!(below(dx, dz) < 0.02 * full, "inside at {dx} {dz}");
        let (ox, oz) = (dx / 0.9 * 1.1, dz / 0.9 * 1.1);
        assert!(below(ox, oz) > 0.98 * full, "outside at {ox} {oz}");
    }
    // Half of the sun stands over the edge.
    let edge = below(1.0, 0.0) / full;
    assert!((edge - 0.5).abs() < 0.06, "{edge}");
}

#[test]
fn colors_of_vertices_multiply_the_material_and_those_of_points_replace_it() {
    let mut floor = quad(Vec3::ZERO, Vec3::Z * 1e4, Vec3::X * 1e4).with_material(0);
    floor.colors = vec![[0.4, 0.4, 0.4, 1.0]; 4];
    // White vertices leave a black wall black: it hides half of the sky and reflects nothing.
    let mut wall = quad(Vec3::X * -0.5, Vec3::Y * 1e4, Vec3::Z * 1e4).with_material(1);
    wall.colors = vec![[1.0; 4]; 4];
    let s = scene(vec![floor, wall], vec![material(0.5, 0.0, 1.0), material(0.0, 0.0, 1.0)], 0.0, 1.0);
    let seen = mean(&s, Vec3::new(0.0, 2.0, 0.0), Vec3::NEG_Y, 4096).expect("floor");
    assert!((seen - 0.5 * 0.4 * 0.5).abs() < 1e-3, "{seen}");
    let mut ball = balls(vec![Vec3::ZERO], 1.0);
    ball.colors = vec![[0.4; 3]];
    let mut s = scene(Vec::new(), vec![material(0.5, 0.0, 1.0)], 0.0, 1.0);
    s.assets[0].points.push(ball);
    let seen = mean(&s, Vec3::Z * 3.0, Vec3::NEG_Z, 64).expect("ball");
    assert!((seen - 0.4).abs() < 1e-3, "{seen}");
}

#[test]
fn a_leaf_glows_on_the_side_away_from_the_sun() {
    let leaf = quad(Vec3::ZERO, Vec3::Z, Vec3::X).with_material(0);
    let s = scene(vec![leaf], vec![material(0.5, 0.3, 1.0)], 2.0, 0.0);
    let cos = s.sun.direction().y;
    let seen = mean(&s, Vec3::new(0.1, -2.0, 0.2), Vec3::Y, 64).expect("leaf");
    let meant = 0.5 * 0.3 * 2.0 * cos / std::f32::consts::PI;
    assert!((seen - meant).abs() < 0.02 * meant, "{seen} for {meant}");
}

#[test]
fn looking_straight_through_a_drop_shows_the_sky_behind_it_dimmed_by_fresnel() {
    let mut s =
        scene(Vec::new(), vec![Material { class: MaterialClass::Water, ..material(1.0, 0.0, 1.333) }], 0.0, 1.0);
    s.assets[0].points.push(balls(vec![Vec3::ZERO], 0.01));
    let seen = mean(&s, Vec3::Z, Vec3::NEG_Z, 4).expect("drop");
    // Everything around is equally bright, so nothing is lost or won whatever way light takes.
    assert!((seen - 1.0).abs() < 0.01, "{seen}");
}

#[test]
fn trees_stand_below_the_horizon_and_the_air_glows_around_the_sun() {
    let sun = Sun { elevation: 0.3, azimuth: 0.4, color: [1.0, 0.5, 0.25], ..Sun::default() };
    let sky =
        Sky { below: Some([0.1; 3]), glow: 2.0, horizon: [0.8; 3], zenith: [0.6; 3], strength: 0.5, ..Sky::default() };
    let light = Light::new(&sun, &sky);
    let away = Vec3::new(-sun.direction().x, 0.0, -sun.direction().z).normalize();
    // Each stop of the sky's picture, where the sun does not glow.
    for (at, color) in sky.stops() {
        let y = 2.0 * at - 1.0;
        let seen = light.sky(away * math::sqrt_f32(1.0 - y * y) + Vec3::Y * y);
        assert!((seen - Vec3::from_array(color)).length() < 1e-5, "{at}: {seen}");
    }
    assert!((light.sky(sun.direction()) - Vec3::new(2.0, 1.0, 0.5)).length() < 1e-3);
    let plain = Light::new(&sun, &Sky { below: None, glow: 0.0, ..sky });
    assert!((plain.sky(Vec3::NEG_Y) - Vec3::splat(0.4)).length() < 1e-6);
}
