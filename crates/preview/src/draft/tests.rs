//! Drafts against rays through the same scene.

use glam::Quat;

use super::*;
use crate::render_scene::ray;
use crate::testing::{balls, material, object, scene_of};
use crate::{Backdrop, Light, PreviewMaterials, Quality};
use osier_scene::{Camera, InstanceState, Instancer, InstancerMotion, Mesh, Prototype, Scene};

/// A fan of `n` triangles around the origin.
fn fan(n: u16, radius: f32) -> Mesh {
    let rim = |i: u16| Quat::from_rotation_z(f32::from(i) / f32::from(n) * std::f32::consts::TAU) * Vec3::X * radius;
    let mut mesh = Mesh { points: vec![Vec3::Z * 0.2 * radius], ..Mesh::default() };
    mesh.points.extend((0..n).map(rim));
    mesh.triangles = (0..u32::from(n)).map(|i| [0, 1 + i, 1 + (i + 1) % u32::from(n)]).collect();
    mesh.normals = vec![Vec3::Z; mesh.points.len()];
    mesh.with_material(0)
}

/// A ground that reaches behind the eye, a crown of leaves over it, and a few balls.
fn scene() -> Scene {
    let mut state = InstanceState::default();
    for k in 0..800_u16 {
        let k = f32::from(k);
        state.orientations.push(Quat::from_rotation_y(k * 2.4) * Quat::from_rotation_z(k * 1.7));
        state.positions.push(
            Quat::from_rotation_y(k * 2.4) * Quat::from_rotation_x(k * 0.7) * Vec3::X * (k / 800.0).cbrt()
                + Vec3::Y * 2.0,
        );
    }
    let leaves = Instancer {
        name: "leaves".into(),
        prototypes: vec![Prototype::new("leaf", fan(24, 1.0))],
        ids: (0..800).collect(),
        protos: vec![0; 800],
        scales: vec![Vec3::new(0.1, 0.06, 0.1); 800],
        rest: state,
        motion: InstancerMotion::Still,
        tracked: false,
    };
    let corners = [[-10.0, 10.0], [10.0, 10.0], [10.0, -10.0], [-10.0, -10.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    let ground = Mesh {
        points: corners.to_vec(),
        normals: vec![Vec3::Y; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let positions = (0..20_u16).map(|i| Vec3::new(f32::from(i) * 0.2 - 2.0, 0.3, 1.2)).collect();
    let mut scene = scene_of(vec![material(0.3, 0.0, 1.5)]);
    scene.camera = Camera { eye: Vec3::new(1.0, 1.5, 7.0), target: Vec3::Y * 1.5, vfov: 0.7, roll: 0.1 };
    let asset = &mut scene.assets[0];
    asset.meshes.push(object("ground", ground.with_material(0)));
    asset.instancers.push(leaves);
    asset.points.push(balls(positions, 0.15));
    scene
}

fn request(scene: &Scene, size: [u32; 2]) -> RenderRequest {
    RenderRequest {
        camera: scene.camera,
        size,
        light: Light::new(&scene.sun, &scene.sky),
        backdrop: Backdrop::Sky,
        seed: 0,
    }
}

/// Calls a test with a draft and with the same scene for ray tracing.
fn both(test: impl Fn(&DraftRenderer<'_, '_>, &RenderScene<'_>)) {
    let scene = scene();
    let request = request(&scene, SIZE);
    let camera = PerspectiveCamera::new(&request.camera, request.size);
    let [plain, fine] = [Quality::Draft, Quality::Fine].map(|quality| PreviewMaterials::new(&scene, quality));
    let (world, traced) = (RenderScene::new(&scene, None, &plain), RenderScene::new(&scene, None, &fine));
    assert!(!world.has_bvh && traced.has_bvh);
    test(&DraftRenderer::new(&world, &request, &camera), &traced);
}

const SIZE: [u32; 2] = [600, 480];
const BAND: RowBand = RowBand { top: 0, size: SIZE };

#[test]
fn pixels_show_what_rays_meet() {
    both(|draft, traced| {
        let buffer = VisibilityBuffer::new(draft.world, draft.camera, BAND, &draft.draw_list);
        let (mut met, mut wrong) = (0, 0);
        for i in 0..BAND.pixels() {
            let d = draft.camera.direction(BAND.pixel_position(i), [0.5, 0.5]);
            let theirs = traced.closest_hit(ray(draft.camera.eye, d, [0.0, f32::INFINITY])).map(|h| h.primitive.t);
            let ours =
                buffer.hit(draft.world, i, draft.camera.eye, d, &draft.draw_list.first_numbers).map(|h| h.primitive.t);
            met += usize::from(theirs.is_some());
            wrong += usize::from(match (ours, theirs) {
                (Some(a), Some(b)) => (a - b).abs() > 1e-3 * b,
                (None, None) => false,
                _ => true,
            });
        }
        assert!(met > BAND.pixels() / 3 && wrong * 1000 < met, "{wrong} of {met}");
    });
}

#[test]
fn shadows_lie_where_rays_find_them() {
    both(|draft, traced| {
        let buffer = VisibilityBuffer::new(draft.world, draft.camera, BAND, &draft.draw_list);
        let points: Vec<Vec3> = (0..BAND.pixels()).map(|i| draft.visible_point(&buffer, BAND, i).1).collect();
        let toward = draft.request.light.sun_direction();
        let lit = shadow_cells::sunlit_points(draft.world, toward, std::slice::from_ref(&points), &draft.draw_list);
        let (mut asked, mut shaded, mut wrong) = (0, 0, 0);
        for (p, lit) in points.iter().zip(lit).filter(|(p, _)| p.is_finite()) {
            let open = traced.is_unoccluded(ray(*p, toward, [0.0, f32::INFINITY]));
            asked += 1;
            shaded += usize::from(!open);
            wrong += usize::from(open != lit);
        }
        assert!(shaded > 500 && wrong * 500 < asked, "{wrong} of {asked}, {shaded} shaded");
    });
}

#[test]
fn bands_join_without_a_seam() {
    both(|draft, _| {
        let sky_visibility = SkyVisibility::new(draft.world);
        let of = |band| {
            draft.shade(band, &draft.visible_points(band, &Cancel::default()).expect("a picture"), &sky_visibility)
        };
        let whole = of(BAND);
        let parts = [0, 96].map(|top| RowBand { top, size: [SIZE[0], if top == 0 { 96 } else { SIZE[1] - 96 }] });
        let joined = parts.map(of).concat();
        let differing = whole.iter().zip(&joined).filter(|(a, b)| a != b).count();
        // The cells of shadow queries differ between bands, so points on the very edge of a shadow
        // may differ.
        assert!(differing * 1000 < whole.len(), "{differing}");
    });
}

#[test]
fn the_sky_is_open_above_and_beside_a_crown_and_hidden_below() {
    both(|draft, _| {
        let sky_visibility = SkyVisibility::new(draft.world);
        let at = |x: f32, y: f32| sky_visibility.at(Vec3::new(x, y, 0.0));
        assert!(at(0.0, 4.0) > 0.95 && at(9.0, 0.0) > 0.95, "{} {}", at(0.0, 4.0), at(9.0, 0.0));
        assert!(at(0.0, 0.1) < 0.9 && at(0.0, 0.1) < at(4.0, 0.1), "{} {}", at(0.0, 0.1), at(4.0, 0.1));
    });
}
