//! OBJ and PLY: byte for byte, and read again by other readers.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test fails by panicking and looks at files")]
#![allow(clippy::float_cmp, reason = "what is read again is equal to the bit")]

use crate::common::synthetic;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use glam::{Quat, Vec2, Vec3};
use osier::export::Exporter;
use osier::export::file_target::FileTarget;
use osier::export::obj::ObjExporter;
use osier::export::ply::PlyExporter;
use osier::export::textures::Textures;
use osier::files::{Folder, WriteOptions};
use osier::scene::*;

/// A lone triangle with a picture, turned a quarter about Y by its placement.
fn triangle() -> Scene {
    let (mut scene, _) = synthetic::scene();
    let mesh = Mesh {
        points: vec![Vec3::ZERO, Vec3::new(0.5, -0.0, 0.25), Vec3::new(0.0, 1.0, 1e-7)],
        normals: vec![Vec3::Z; 3],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::new(0.5, 1.0)],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let object =
        MeshObject { name: "blade".into(), mesh: mesh.with_material(1), motion: MeshMotion::Still, skin: None };
    scene.assets = vec![Asset {
        id: "tri".into(),
        kind: AssetKind::Import,
        group: String::new(),
        skeleton: None,
        meshes: vec![object],
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    }];
    let s = std::f32::consts::FRAC_1_SQRT_2;
    let transform = Trs { t: Vec3::new(0.0, 0.0, 2.0), r: Quat::from_xyzw(0.0, s, 0.0, s), s: Vec3::splat(2.0) };
    scene.placements = vec![Placement { name: "one".into(), asset: 0, transform, phase: 0 }];
    scene
}

fn write(dir: &Path, scene: &Scene, frames: &[Frame], single: bool) {
    let folder = Folder::open(dir).expect("folder");
    let textures = Arc::new(Textures::encode(scene).expect("textures"));
    let (obj_layout, ply_layout) = if single {
        (FileTarget::Single("tri.obj".into()), FileTarget::Single("tri.ply".into()))
    } else {
        (FileTarget::Bake, FileTarget::Bake)
    };
    let scene = Arc::new(scene.clone());
    let mut exporters: [Box<dyn Exporter>; 2] = [
        Box::new(ObjExporter::new(folder.clone(), textures, obj_layout)),
        Box::new(PlyExporter::new(folder, ply_layout)),
    ];
    for exporter in &mut exporters {
        exporter.begin(&scene).expect("begin");
        frames.iter().for_each(|f| exporter.frame(f).expect("frame"));
        exporter.finish().expect("finish");
    }
}

#[test]
fn obj_of_three_vertices_byte_for_byte() {
    let dir = tempfile::tempdir().expect("dir");
    write(dir.path(), &triangle(), &[], false);
    let text = fs::read_to_string(dir.path().join("obj/tri.obj")).expect("obj");
    let wanted = "# osier 0.1.0\n# seed 18446744073709551557\nmtllib tri.mtl\no tri\n\
                  v 0 0 0\nv 0.5 0 0.25\nv 0 1 0.0000001\nvt 0 0\nvt 1 0\nvt 0.5 1\n\
                  vn 0 0 1\nvn 0 0 1\nvn 0 0 1\nusemtl leaf\nf 1/1/1 2/2/2 3/3/3\n";
    assert_eq!(text, wanted);
    let library = fs::read_to_string(dir.path().join("obj/tri.mtl")).expect("mtl");
    let wanted = "# osier 0.1.0\n\nnewmtl leaf\nKd 1 1 1\nNs 160\nd 1\nmap_Kd ../textures/leaf_color.png\n\
                  map_d ../textures/leaf_color.png\n";
    assert_eq!(library, wanted);
    assert!(dir.path().join("textures/leaf_color.png").is_file());
}

#[test]
fn no_obj_is_written_beside_a_foreign_library() {
    let dir = tempfile::tempdir().expect("dir");
    fs::write(dir.path().join("tri.mtl"), "newmtl mine\n").expect("library");
    let scene = triangle();
    let textures = Arc::new(Textures::encode(&scene).expect("textures"));
    let folder = Folder::plain(dir.path(), WriteOptions::default()).expect("folder");
    let mut exporter = ObjExporter::new(folder, textures, FileTarget::Single("tri.obj".into()));
    let end = exporter.begin(&Arc::new(scene)).expect_err("a foreign library");
    assert!(matches!(&end, osier::Error::Foreign { path } if path.ends_with("tri.mtl")), "{end}");
    // Neither the mesh nor the folder of its pictures.
    assert_eq!(fs::read_dir(dir.path()).expect("folder").count(), 1);
}

#[test]
fn objects_without_texture_coordinates_shift_those_of_the_next() {
    let mut scene = triangle();
    let mut bare = scene.assets[0].clone();
    bare.id = "bare".into();
    bare.meshes[0].mesh.uvs.clear();
    scene.assets.insert(0, bare);
    let second = Placement { name: "two".into(), asset: 1, ..scene.placements[0].clone() };
    scene.placements.push(second);
    let dir = tempfile::tempdir().expect("dir");
    write(dir.path(), &scene, &[], true);
    let text = fs::read_to_string(dir.path().join("tri.obj")).expect("obj");
    let faces: Vec<&str> = text.lines().filter(|l| l.starts_with("f ")).collect();
    assert_eq!(faces, ["f 1//1 2//2 3//3", "f 4/1/4 5/2/5 6/3/6"]);
    assert_eq!(text.lines().filter(|l| l.starts_with("vt ")).count(), 3);
}

#[test]
fn ply_of_three_vertices_byte_for_byte() {
    let dir = tempfile::tempdir().expect("dir");
    write(dir.path(), &triangle(), &[], true);
    let bytes = fs::read(dir.path().join("tri.ply")).expect("ply");
    let mut wanted = b"ply\nformat binary_little_endian 1.0\ncomment osier 0.1.0\n\
        comment seed 18446744073709551557\ncomment frame 1\ncomment up Y\ncomment unit m\nelement vertex 3\n\
        property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n\
        property float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        .to_vec();
    let scene = triangle();
    let trs = scene.placements[0].transform;
    for p in &scene.assets[0].meshes[0].mesh.points {
        let n = trs.r * Vec3::Z;
        for v in trs.apply(*p).to_array().into_iter().chain((n / n.length()).to_array()) {
            wanted.extend((v + 0.0).to_le_bytes());
        }
        // Linear 0.3, 0.25, 0.2 in sRGB.
        wanted.extend([149, 137, 124, 255]);
    }
    wanted.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    assert_eq!(bytes, wanted);
}

#[test]
fn ply_has_the_colors_of_vertices_times_those_of_materials() {
    let dir = tempfile::tempdir().expect("dir");
    let mut scene = triangle();
    scene.materials[1].base_color = [1.0, 0.5, 1.0];
    scene.assets[0].meshes[0].mesh.colors = vec![[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0], [0.5, 1.0, 1.0, 1.0]];
    write(dir.path(), &scene, &[], true);
    let (_, body) = parts(&dir.path().join("tri.ply"));
    // Six floats before the colour; linear 0.5 is 188 in sRGB.
    let colors: Vec<&[u8]> = body[..3 * 28].chunks(28).map(|row| &row[24..]).collect();
    assert_eq!(colors, [[255_u8, 0, 0, 255], [0, 188, 0, 255], [188, 188, 255, 255]]);
}

#[test]
fn obj_read_again_is_equal() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, frames) = synthetic::scene();
    write(dir.path(), &scene, &frames, false);
    let bytes = fs::read(dir.path().join("obj/rig.obj")).expect("obj");
    let options = tobj::LoadOptions { single_index: true, ..tobj::LoadOptions::default() };
    let (models, _) = tobj::load_obj_buf(&mut bytes.as_slice(), &options, |p| {
        assert_eq!(p, Path::new("rig.mtl"));
        tobj::load_mtl_buf(&mut fs::read(dir.path().join("obj").join(p)).expect("mtl").as_slice())
    })
    .expect("readable");
    // One run per material: the stem, then all leaves.
    assert_eq!(models.len(), 2);
    let rig = &scene.assets[0];
    let stem = &rig.meshes[0].mesh;
    // The reader numbers vertices by first use, so corners are compared.
    let corners: Vec<Vec3> = stem.triangles.iter().flatten().map(|i| stem.points[*i as usize]).collect();
    assert_eq!(read_corners(&models[0].mesh), corners);
    let leaves = &rig.instancers[0];
    let corners = (0..leaves.len()).flat_map(|i| {
        let trs = leaves.transform(&leaves.rest, i);
        let mesh = &leaves.prototypes[leaves.protos[i] as usize].mesh;
        mesh.triangles.iter().flatten().map(move |v| trs.apply(mesh.points[*v as usize])).collect::<Vec<_>>()
    });
    let read = read_corners(&models[1].mesh);
    assert_eq!(read.len(), 4 * 6);
    assert!(corners.zip(&read).all(|(a, b)| (a - *b).length() < 1e-6));
}

fn read_corners(mesh: &tobj::Mesh) -> Vec<Vec3> {
    let point = |i: &u32| Vec3::from_slice(&mesh.positions[*i as usize * 3..]);
    mesh.indices.iter().map(point).collect()
}

/// Header lines and body of a PLY file.
fn parts(path: &Path) -> (Vec<String>, Vec<u8>) {
    let bytes = fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("header") + 11;
    (String::from_utf8_lossy(&bytes[..end]).lines().map(String::from).collect(), bytes[end..].to_vec())
}

fn float(body: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(body[at..at + 4].try_into().expect("four bytes"))
}

#[test]
fn clouds_and_instances_hold_what_is_alive_at_each_frame() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, frames) = synthetic::scene();
    write(dir.path(), &scene, &frames, false);
    for frame in &frames {
        let tag = scene.clip.tag(frame.number);
        let (header, body) = parts(&dir.path().join(format!("cloud/misc.{tag}.ply")));
        let PointsFrame::State { positions, widths, .. } = &frame.assets[3].points[0] else { panic!("a state") };
        let alive: Vec<usize> = (0..widths.len()).filter(|i| widths[*i] > 0.0).collect();
        assert!(header.contains(&format!("element vertex {}", alive.len())) && body.len() == alive.len() * 20);
        assert!(header.contains(&format!("comment frame {}", frame.number)));
        for (row, i) in alive.iter().enumerate() {
            let read = [0, 4, 8].map(|o| float(&body, row * 20 + o));
            assert_eq!(Vec3::from(read), positions[*i]);
            assert_eq!(float(&body, row * 20 + 12), widths[*i] * 0.5);
        }
        let (header, body) = parts(&dir.path().join(format!("cloud/tracks.flying.{tag}.ply")));
        let InstancerFrame::State(state) = &frame.assets[2].instancers[0] else { panic!("a state") };
        let alive: Vec<usize> = (0..5).filter(|i| state.is_alive(*i)).collect();
        assert!(header.contains(&format!("element vertex {}", alive.len())) && body.len() == alive.len() * 52);
        for (row, i) in alive.iter().enumerate() {
            let q = state.orientations[*i];
            let read = [12, 16, 20, 24].map(|o| float(&body, row * 52 + o));
            assert_eq!(read, [q.w, q.x, q.y, q.z]);
            assert_eq!(u32::from_le_bytes(body[row * 52 + 48..row * 52 + 52].try_into().expect("id")) as usize, *i);
        }
    }
    // Leaves that ride on joints stand still here, at rest.
    assert_eq!(parts(&dir.path().join("cloud/rig.leaves.ply")).1.len(), 4 * 52);
}

#[test]
fn without_frames_clouds_are_written_once() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, _) = synthetic::scene();
    write(dir.path(), &scene, &[], false);
    assert!(dir.path().join("cloud/misc.ply").is_file() && dir.path().join("cloud/tracks.flying.ply").is_file());
}
