//! Artists' meshes: what is read, and what hostile or broken files get for an answer.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests set up the disk themselves")]
#![allow(clippy::float_cmp, clippy::cast_possible_truncation, reason = "exact values, small numbers")]

use crate::common::synthetic;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use glam::{Quat, Vec2, Vec3};
use osier::Error;
use osier::export::{Exporter as _, gltf, textures::Textures};
use osier::files::{Folder, SearchPaths};
use osier::import::{ImportOptions, Imported, UpAxis, read};
use osier::limits::Limits;
use osier::scene::{MaterialClass, Mesh, check_scene};

struct Shop {
    dir: tempfile::TempDir,
    limits: Limits,
    up: UpAxis,
    scale: f32,
}

impl Shop {
    fn new() -> Self {
        let dir = tempfile::tempdir().expect("dir");
        Self { dir, limits: Limits::default(), up: UpAxis::Y, scale: 1.0 }
    }

    fn put(&self, name: &str, bytes: impl AsRef<[u8]>) -> &Self {
        fs::write(self.dir.path().join(name), bytes).expect("write");
        self
    }

    fn read(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<Imported, Error> {
        let path = self.dir.path().join(name);
        let roots = SearchPaths::new(&path, &[]).expect("roots");
        let (up, scale) = (self.up, self.scale);
        let options = ImportOptions { roots: &roots, limits: &self.limits, up, scale, class: MaterialClass::Leaf };
        read(&path, bytes.as_ref(), &options)
    }

    /// The complaint, without the folder's own name.
    fn complaint(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        let text = match self.read(name, bytes) {
            Ok(imported) => imported.warnings.to_string(),
            Err(Error::Input(report)) => report.to_string(),
            Err(e) => e.to_string(),
        };
        text.replace(&format!("{}/", self.dir.path().display()), "")
    }
}

fn png(width: u32, height: u32, color: png::ColorType, samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.write_header().expect("header").write_image_data(samples).expect("data");
    bytes
}

const LEAF: &str = "mtllib leaf.mtl\no Leaf\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                    usemtl Green Leaf\nf 1/1 2/2 3/3 4/4\n";

fn area(mesh: &Mesh) -> Vec3 {
    mesh.triangles.iter().fold(Vec3::ZERO, |s, t| {
        let [a, b, c] = t.map(|i| mesh.points[i as usize]);
        s + (b - a).cross(c - a) / 2.0
    })
}

#[test]
fn an_obj_leaf_with_its_material_and_picture() {
    let shop = Shop::new();
    shop.put("leaf.mtl", "newmtl Green Leaf\nKd 0.1 0.5 0.2\nNs 30\nmap_Kd -clamp on leaf.png\nmap_d mask.png\n");
    shop.put("leaf.png", png(2, 1, png::ColorType::Rgb, &[10, 20, 30, 40, 50, 60]));
    shop.put("mask.png", png(2, 1, png::ColorType::Grayscale, &[0, 255]));
    let leaf = shop.read("leaf.obj", LEAF).expect("leaf");
    assert!(leaf.warnings.diagnostics.is_empty(), "{}", leaf.warnings);
    assert_eq!((leaf.mesh.points.len(), leaf.mesh.triangles.len(), leaf.mesh.subsets.len()), (4, 2, 1));
    assert_eq!(area(&leaf.mesh), Vec3::Z);
    assert!(leaf.mesh.normals.iter().all(|n| (*n - Vec3::Z).length() < 1e-6));
    let corner = leaf.mesh.points.iter().position(|p| *p == Vec3::Y).expect("corner");
    assert_eq!(leaf.mesh.uvs[corner], Vec2::Y);
    let material = &leaf.materials[0];
    assert_eq!((material.name.as_str(), material.base_color), ("green_leaf", [1.0; 3]), "the picture has the colour");
    assert_eq!((material.alpha_cutoff, material.maps.color), (Some(0.5), Some(0)));
    let osier::scene::Pixels::U8(pixels) = &leaf.images[0].pixels else { panic!("8 bit") };
    assert_eq!(pixels, &[10, 20, 30, 0, 40, 50, 60, 255]);
    let names: Vec<_> = leaf.files.iter().map(|f| f.path.file_name().expect("name").to_owned()).collect();
    assert_eq!(names, ["leaf.obj", "leaf.mtl", "leaf.png", "mask.png"]);
}

/// Faces with and without texture coordinates in one object, a line of four vertices and an indented `usemtl`: every vertex keeps its
/// own coordinate, and the line makes no face.
#[test]
fn texture_coordinates_on_some_faces_and_a_line_between() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nvt 0.25 0.5\nvt 1 0\nvt 1 1\nvt 0 1\n\
                \tusemtl Green\nf 2 5 6 3\nl 1 2 5 6\nf 1/1 2/2 3/3 4/4\n";
    let leaf = Shop::new().read("leaf.obj", text).expect("leaf");
    let names: Vec<&str> = leaf.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!((names, leaf.mesh.triangles.len(), leaf.mesh.points.len()), (vec!["green"], 4, 8));
    let uv_at = |place: Vec3| {
        let i = leaf.mesh.points.iter().position(|p| *p == place).expect("vertex");
        leaf.mesh.uvs[i]
    };
    assert_eq!((uv_at(Vec3::ZERO), uv_at(Vec3::Y)), (Vec2::new(0.25, 0.5), Vec2::Y));
    assert_eq!((uv_at(Vec3::X * 2.0), uv_at(Vec3::new(2.0, 1.0, 0.0))), (Vec2::ZERO, Vec2::ZERO));
    assert_eq!(leaf.warnings.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["X016"], "{}", leaf.warnings);
    let mixed = Shop::new().complaint("leaf.obj", text.replace("2/2 3/3", "2 3/3"));
    assert!(mixed.contains("X010") && mixed.contains("leaf.obj:14:7"), "{mixed}");
}

/// Blender writes the linear colours 0.5, 0.25, 0.1 of a vertex as these sRGB ones; glTF holds linear ones.
#[test]
fn colors_at_vertices_of_an_obj_are_srgb() {
    let text = "v 0 0 0 0.7353 0.5371 0.3492\nv 1 0 0 0 0 0\nv 0 1 0 1 1 1\nf 1 2 3\n";
    let colors = Shop::new().read("leaf.obj", text).expect("leaf").mesh.colors;
    let near = |found: [f32; 4], wanted: [f32; 4]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 2e-4);
    assert!(near(colors[0], [0.5, 0.25, 0.1, 1.0]), "{colors:?}");
    assert!(near(colors[1], [0.0, 0.0, 0.0, 1.0]) && near(colors[2], [1.0; 4]), "{colors:?}");
}

/// Blender writes colours for the vertices of objects that have them alone; the other objects of the file are white.
#[test]
fn objects_without_colors_are_white_beside_coloured_ones() {
    let text = "o A\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no B\nv 0 0 1 1 0 0\nv 1 0 1 1 0 0\nv 0 1 1 1 0 0\nf 4 5 6\n";
    let mesh = Shop::new().read("two.obj", text).expect("two objects").mesh;
    assert_eq!((mesh.points.len(), mesh.colors.len()), (6, 6));
    for (point, color) in mesh.points.iter().zip(&mesh.colors) {
        let wanted = if point.z > 0.5 { [1.0, 0.0, 0.0, 1.0] } else { [1.0; 4] };
        assert!(color.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5), "{point} {color:?}");
    }
}

/// A missing library, none at all, and one without the second material: every material has its name and its triangle.
#[test]
fn materials_without_a_library_keep_their_names() {
    let shop = Shop::new();
    shop.put("bark.mtl", "newmtl Bark\nKd 0.25 0.5 0.75\n");
    let faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl Bark\nf 1 2 3\nusemtl Green Leaf\nf 1 2 4\n";
    for (library, code, color) in [("", "", 0.5), ("mtllib gone.mtl\n", "X014", 0.5), ("mtllib bark.mtl\n", "", 0.25)] {
        let tree = shop.read("tree.obj", format!("{library}{faces}")).expect("tree");
        let names: Vec<&str> = tree.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!((names, tree.materials[0].base_color[0]), (vec!["bark", "green_leaf"], color), "{library}");
        let runs: Vec<(u32, u32)> = tree.mesh.subsets.iter().map(|s| (s.material, s.count)).collect();
        assert_eq!(runs, [(0, 1), (1, 1)], "{library}");
        assert!(tree.warnings.diagnostics.iter().all(|d| d.code == code), "{}", tree.warnings);
    }
}

#[test]
fn axes_scale_and_text_forms() {
    let mut shop = Shop::new();
    shop.put("leaf.mtl", "newmtl Green Leaf\n");
    let plain = shop.read("leaf.obj", LEAF).expect("plain").mesh;
    for form in
        [format!("\u{feff}{LEAF}"), LEAF.replace('\n', "\r\n"), LEAF.replace('\n', "\r"), LEAF.trim_end().into()]
    {
        let mesh = shop.read("leaf.obj", &form).expect("form").mesh;
        assert_eq!((&mesh.points, &mesh.triangles), (&plain.points, &plain.triangles), "{form:?}");
    }
    let latin: Vec<u8> = LEAF.replace("o Leaf", "o Bl\u{e4}tt").chars().map(|c| c as u8).collect();
    insta::assert_snapshot!("X015", shop.complaint("leaf.obj", latin));
    (shop.up, shop.scale) = (UpAxis::Z, 0.01);
    let turned = shop.read("leaf.obj", LEAF).expect("turned").mesh;
    assert!((area(&turned) - Vec3::Y * 1e-4).length() < 1e-9);
    shop.scale = f32::NAN;
    assert!(matches!(shop.read("leaf.obj", LEAF), Err(Error::Range { .. })));
}

/// Land in the coordinates of a national grid: a kilometre at 5400 km from the origin, where 32-bit numbers have steps of half a metre.
#[test]
fn meshes_far_from_their_origin_are_told() {
    let land = |east: f64, north: f64| {
        let corners =
            [(0.0, 0.0), (1000.0, 0.0), (0.0, 1000.0)].map(|(x, z)| format!("v {} 0 {}\n", east + x, north - z));
        Shop::new().complaint("land.obj", format!("{}f 1 2 3\n", corners.concat()))
    };
    let told = land(450_000.25, 5_400_000.25);
    assert!(told.contains("warning[X016]") && told.contains("5400000 units away"), "{told}");
    for near in [land(0.0, 0.0), land(50_000.0, 20_000.0)] {
        assert!(!near.contains("X016"), "{near}");
    }
}

#[test]
fn every_broken_line_of_an_obj_is_named() {
    let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let corners: String = (0..1_000_000).map(|i| format!(" {}", i % 3 + 1)).collect();
    let cases = [
        ("not a number", "v nan 0 0\n".to_owned()),
        ("infinite", "v 0 -inf 0\n".into()),
        ("beyond doubles", "v 0 0 1e999\n".into()),
        ("beyond floats", "v 0 0 1e39\n".into()),
        ("comma", "v 1,5 0 0\n".into()),
        ("too few", "v 1 2\n".into()),
        ("five numbers", "v 1 2 3 4 5\n".into()),
        ("divided by zero", "v 1 2 3 0\n".into()),
        ("zero index", "f 0 1 2\n".into()),
        ("backwards too far", "f -4 -1 -2\n".into()),
        ("huge index", "f 1 2 99999999999999999999\n".into()),
        ("no such uv", "f 1/1 2/2 3/3\n".into()),
        ("word for index", "f a b c\n".into()),
        ("four indices", "f 1/// 2 3\n".into()),
        ("million corners", format!("f{corners}\n")),
        ("no corners", "f\n".into()),
        ("library outside", "mtllib ../../x.mtl\nf 1 2 3\n".into()),
        ("absolute library", "mtllib /etc/passwd\nf 1 2 3\n".into()),
        ("no library", "mtllib absent.mtl\nf 1 2 3\n".into()),
        ("NUL", "v 0 0\0 0\n".into()),
        ("no faces", "v 1 1 1\n".into()),
        ("no area", "f 1 1 2\n".into()),
        ("colour beside a weight", "v 1 1 1 2\nv 1 1 1 1 0 0\nf 1 2 3\n".into()),
    ];
    let shop = Shop::new();
    let mut all = String::new();
    for (name, text) in cases {
        all.push_str(&format!("## {name}\n{}\n\n", shop.complaint("leaf.obj", format!("{head}{text}"))));
    }
    insta::assert_snapshot!(all);
}

#[test]
fn a_broken_library_is_named_too() {
    let shop = Shop::new();
    let mut all = String::new();
    for (name, text) in [
        ("comma", "newmtl Green Leaf\nKd 0,1 0,5 0,2\n"),
        ("nan", "newmtl Green Leaf\n\nNs nan\n"),
        ("short", "newmtl Green Leaf\nKd 0.1\n"),
        ("no name", "newmtl\n"),
        ("picture outside", "newmtl Green Leaf\nmap_Kd ../../leaf.png\n"),
        ("no picture", "newmtl Green Leaf\nmap_Kd absent.png\n"),
        ("no picture at all", "newmtl Green Leaf\nmap_Kd leaf.mtl\n"),
    ] {
        shop.put("leaf.mtl", text);
        all.push_str(&format!("## {name}\n{}\n\n", shop.complaint("leaf.obj", LEAF)));
    }
    insta::assert_snapshot!(all);
}

#[test]
fn forms_of_a_library_that_are_not_read_are_left_out_with_a_warning() {
    let shop = Shop::new();
    let lines = "Kd spectral leaf.rfl 0.9\nKs xyz 0.1 0.2 0.3\nd -halo 0.5\nNs 30\n";
    shop.put("leaf.mtl", format!("newmtl Green Leaf\n{lines}"));
    let leaf = shop.read("leaf.obj", LEAF).expect("leaf");
    let told: Vec<&str> = leaf.warnings.diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(told, ["X016"; 3], "{}", leaf.warnings);
    assert!(leaf.warnings.to_string().contains("leaf.mtl:2:1"), "{}", leaf.warnings);
    // The lines that are read count: roughness 1 - (30 / 1000)^(1/2).
    assert!((leaf.materials[0].roughness - 0.826_795).abs() < 1e-5);
}

#[test]
fn maps_of_a_library_that_are_not_read_are_told() {
    let shop = Shop::new();
    let lines = "map_Bump -bm 1.0 n.png\nNs 250\nPr 0.25\nmap_Pr r.png\nmap_Kd -s 4 4 1 leaf.png\nmap_d leaf.png\n";
    shop.put("leaf.mtl", format!("newmtl Green Leaf\n{lines}"));
    shop.put("leaf.png", png(1, 1, png::ColorType::Rgb, &[10, 20, 30]));
    let leaf = shop.read("leaf.obj", LEAF).expect("leaf");
    let told: Vec<&str> = leaf.warnings.diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(told, ["X016"; 3], "{}", leaf.warnings);
    // Two maps that are not read, and a mask without the scale of the first map.
    for place in ["leaf.mtl:2:1", "leaf.mtl:5:1", "leaf.mtl:7:1"] {
        assert!(leaf.warnings.to_string().contains(place), "{place}: {}", leaf.warnings);
    }
    // The roughness is that of Pr, not of Ns.
    assert_eq!(leaf.materials[0].roughness, 0.25);
}

/// Blender 5.0 writes the roughness 0.35 as Ns 422.499969, and the OBJ that osier writes of the roughness 0.6 has Ns 160.
#[test]
fn roughness_is_that_of_blender_and_of_our_own_files() {
    let shop = Shop::new();
    for (ns, roughness) in [("422.499969", 0.35), ("160", 0.6), ("0", 1.0), ("1000", 0.05), ("-1", 1.0), ("5000", 0.05)]
    {
        shop.put("leaf.mtl", format!("newmtl Green Leaf\nNs {ns}\n"));
        let leaf = shop.read("leaf.obj", LEAF).expect("leaf");
        assert!((leaf.materials[0].roughness - roughness).abs() < 1e-5, "{ns}: {}", leaf.materials[0].roughness);
    }
}

/// Blender writes absolute paths of pictures that lie elsewhere, which are refused: a picture of that name beside the library is read.
#[test]
fn pictures_of_absolute_paths_are_found_beside_the_library() {
    let shop = Shop::new();
    for path in ["/home/me/textures/my leaf.png", "C:\\art\\my leaf.png"] {
        shop.put("leaf.mtl", format!("newmtl Green Leaf\nmap_Kd {path}\n"));
        let refused = shop.complaint("leaf.obj", LEAF);
        assert!(refused.contains("error[X009]") && refused.contains("put the picture beside this file"), "{refused}");
        shop.put("my leaf.png", png(1, 1, png::ColorType::Rgb, &[10, 20, 30]));
        let leaf = shop.read("leaf.obj", LEAF).expect("leaf");
        assert_eq!((leaf.images.len(), leaf.materials[0].maps.color), (1, Some(0)));
        assert_eq!(leaf.warnings.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["X016"], "{}", leaf.warnings);
        fs::remove_file(shop.dir.path().join("my leaf.png")).expect("remove");
    }
}

/// Blender writes the scale and location of a node Mapping as the options -s and -o of a map; a texture that repeats four times was
/// stretched over the leaf.
#[test]
fn options_of_a_map_scale_and_move_it() {
    let shop = Shop::new();
    shop.put("leaf.mtl", "newmtl Green Leaf\nmap_Kd -s 4 2 1 -o 0.5 0.25 0 leaf.png\n");
    shop.put("leaf.png", png(1, 1, png::ColorType::Rgb, &[10, 20, 30]));
    let leaf = shop.read("leaf.obj", LEAF).expect("leaf");
    assert!(leaf.warnings.diagnostics.is_empty(), "{}", leaf.warnings);
    for (point, uv) in leaf.mesh.points.iter().zip(&leaf.mesh.uvs) {
        assert_eq!(*uv, Vec2::new(4.0 * point.x + 0.5, 2.0 * point.y + 0.25));
    }
}

#[test]
#[cfg(unix)]
fn pipes_devices_and_folders_never_block() {
    let shop = Shop::new();
    let path = shop.dir.path();
    rustix::fs::mkfifoat(rustix::fs::CWD, path.join("fifo"), rustix::fs::Mode::RWXU).expect("fifo");
    std::os::unix::fs::symlink("/dev/zero", path.join("zero")).expect("link");
    fs::create_dir(path.join("folder")).expect("folder");
    let start = std::time::Instant::now();
    for (name, code) in [("fifo", "X010"), ("zero", "X009"), ("folder", "X010")] {
        let text = shop.complaint("a.obj", format!("mtllib {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"));
        assert!(text.contains(code), "{text}");
        let text =
            shop.complaint("a.gltf", triangle().replace("data:", &format!("{name}?")).replace('?', "\",\"x\":\""));
        assert!(text.contains(code), "{text}");
    }
    assert!(start.elapsed().as_secs_f64() < 1.0);
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    bytes
        .chunks(3)
        .flat_map(|c| {
            let bits = c.iter().fold(0_u32, |v, b| (v << 8) | u32::from(*b)) << (8 * (3 - c.len()));
            (0..=c.len()).map(move |i| char::from(DIGITS[(bits >> (18 - 6 * i)) as usize & 63]))
        })
        .collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

const CORNERS: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// A document of one triangle; `node` and `extra` go into its node and its top level.
fn document(data: &[u8], node: &str, extra: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"scene":0,
"nodes":[{{"mesh":0{node}}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}}],
"bufferViews":[{{"buffer":0,"byteLength":{n}}}],
"buffers":[{{"byteLength":{n},"uri":"data:application/octet-stream;base64,{}"}}]{extra}}}"#,
        base64(data),
        n = data.len(),
    )
}

fn triangle() -> String {
    document(&floats(&CORNERS), "", "")
}

fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let pad = |mut v: Vec<u8>, with: u8| {
        v.resize(v.len().next_multiple_of(4), with);
        v
    };
    let (json, bin) = (pad(json.as_bytes().to_vec(), b' '), pad(bin.to_vec(), 0));
    let word = |n: usize| (n as u32).to_le_bytes();
    let total = 28 + json.len() + bin.len();
    let parts: [&[u8]; 8] =
        [b"glTF", &word(2), &word(total), &word(json.len()), b"JSON", &json, &word(bin.len()), b"BIN\0"];
    [parts.concat(), bin].concat()
}

#[test]
fn a_gltf_triangle_in_all_its_containers() {
    let shop = Shop::new();
    let plain = shop.read("a.gltf", triangle()).expect("data uri").mesh;
    assert_eq!(area(&plain), Vec3::Z / 2.0);
    let data = floats(&CORNERS);
    let start = triangle().find("\"data:").expect("uri");
    let json = triangle();
    let end = start + 1 + json[start + 1..].find('"').expect("end") + 1;
    shop.put("a mesh.bin", &data);
    let external = format!("{}\"a%20mesh.bin\"{}", &json[..start], &json[end..]);
    assert_eq!(shop.read("a.gltf", external).expect("file").mesh.points, plain.points);
    let chunk = format!("{}{}", json[..start].strip_suffix(",\"uri\":").expect("key"), &json[end..]);
    let imported = shop.read("a.glb", glb(&chunk, &data)).expect("glb");
    assert_eq!((imported.mesh.points, imported.materials[0].base_color), (plain.points, [1.0; 3]));
}

#[test]
fn transforms_instances_and_mirrors() {
    let shop = Shop::new();
    let mesh = shop
        .read("a.gltf", document(&floats(&CORNERS), r#","translation":[1,2,3],"scale":[2,2,-2]"#, ""))
        .expect("mesh");
    assert_eq!(mesh.mesh.bounds().min, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!(area(&mesh.mesh), Vec3::Z * -2.0, "mirrored along z, the front faces away");
    assert!(mesh.mesh.normals.iter().all(|n| *n == -Vec3::Z));

    let mut data = floats(&CORNERS);
    data.extend(floats(&[5.0, 0.0, 0.0, 0.0, 7.0, 0.0]));
    let half = std::f32::consts::FRAC_1_SQRT_2;
    data.extend(
        [0_i16, 0, (half * 32767.0) as i16, (half * 32767.0) as i16, 0, 0, 0, 32767]
            .iter()
            .flat_map(|v| v.to_le_bytes()),
    );
    let instancing = r#","extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":1,"ROTATION":2}}}"#;
    let json = document(
        &data,
        instancing,
        r#","extensionsUsed":["EXT_mesh_gpu_instancing"],"extensionsRequired":["EXT_mesh_gpu_instancing"]"#,
    )
    .replace(
        "}],\n\"bufferViews\":[",
        r#"},{"bufferView":0,"byteOffset":36,"componentType":5126,"count":2,"type":"VEC3"},
{"bufferView":0,"byteOffset":60,"componentType":5122,"normalized":true,"count":2,"type":"VEC4"}],"bufferViews":["#,
    );
    let mesh = shop.read("a.gltf", json).expect("instances").mesh;
    assert_eq!(mesh.points.len(), 6);
    let turned = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2) * Vec3::X + Vec3::X * 5.0;
    assert!((mesh.points[1] - turned).length() < 1e-4, "{}", mesh.points[1]);
    assert_eq!(mesh.points[3], Vec3::Y * 7.0);
}

/// A skinned mesh stands where its joint and the inverse bind matrix put it, here 0.01 (300 p + (100, 0, 0)) + (0, 0, 5), and
/// not where its node is; the joint comes after it in the file.
#[test]
fn a_skinned_mesh_stands_as_bound() {
    let mut data = floats(&CORNERS);
    data.extend(floats(&[300.0, 0.0, 0.0, 0.0, 0.0, 300.0, 0.0, 0.0, 0.0, 0.0, 300.0, 0.0, 100.0, 0.0, 0.0, 1.0]));
    let node = r#","skin":0,"translation":[9,9,9]},{"translation":[0,0,5],"scale":[0.01,0.01,0.01]"#;
    let json = document(&data, node, r#","skins":[{"inverseBindMatrices":1,"joints":[1]}]"#)
        .replace(r#""scenes":[{"nodes":[0]}]"#, r#""scenes":[{"nodes":[0,1]}]"#)
        .replace(
            "}],\n\"bufferViews\":[",
            "},{\"bufferView\":0,\"byteOffset\":36,\"componentType\":5126,\"count\":1,\"type\":\"MAT4\"}],\"bufferViews\":[",
        );
    let tree = Shop::new().read("a.gltf", json).expect("mesh");
    for (found, wanted) in tree.mesh.points.iter().zip([[1.0, 0.0, 5.0], [4.0, 0.0, 5.0], [1.0, 3.0, 5.0]]) {
        assert!((*found - Vec3::from_array(wanted)).length() < 1e-4, "{found} {wanted:?}");
    }
    assert_eq!(tree.warnings.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["X016"]);
    assert!(tree.warnings.to_string().contains("holds a skinned mesh; it is read as bound"), "{}", tree.warnings);
}

/// A triangle with the material `material`, whose images are `color.png` (0) and `other.png` (1), with two sets of texture coordinates:
/// (0, 0), (1, 0), (0, 1) and the halves of these.
fn textured(material: &str) -> String {
    let mut data = floats(&CORNERS);
    data.extend(floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]));
    data.extend(floats(&[0.0, 0.0, 0.5, 0.0, 0.0, 0.5]));
    let pictures = r#""images":[{"uri":"color.png"},{"uri":"other.png"}],"textures":[{"source":0},{"source":1}]"#;
    document(&data, "", &format!(r#","materials":[{material}],{pictures}"#))
        .replace(r#"{"POSITION":0}"#, r#"{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_1":2},"material":0"#)
        .replace(
            "}],\n\"bufferViews\":[",
            r#"},{"bufferView":0,"byteOffset":36,"componentType":5126,"count":3,"type":"VEC2"},
{"bufferView":0,"byteOffset":60,"componentType":5126,"count":3,"type":"VEC2"}],"bufferViews":["#,
        )
}

fn picture_shop() -> Shop {
    let shop = Shop::new();
    shop.put("color.png", png(1, 1, png::ColorType::Rgb, &[10, 20, 30]));
    shop.put("other.png", png(1, 1, png::ColorType::Rgb, &[128, 128, 255]));
    shop
}

/// Materials of specular colour and glossiness, as Sketchfab wrote them, keep their picture, colour and roughness.
#[test]
fn specular_glossiness_is_read_as_colour_and_roughness() {
    let shop = picture_shop();
    let material = |more: &str| {
        textured(&format!(
            r#"{{"extensions":{{"KHR_materials_pbrSpecularGlossiness":{{"diffuseFactor":[0.5,0.25,1,1],"glossinessFactor":0.75{more}}}}}}}"#
        ))
    };
    let plain = shop.read("a.gltf", material("")).expect("plain");
    assert_eq!(plain.materials[0].base_color, [0.5, 0.25, 1.0]);
    assert!((plain.materials[0].roughness - 0.25).abs() < 1e-6 && plain.images.is_empty(), "{}", plain.warnings);
    let texture = r#","diffuseTexture":{"index":0},"specularGlossinessTexture":{"index":1}"#;
    let leaf = shop.read("a.gltf", material(texture)).expect("leaf");
    assert_eq!((leaf.materials[0].maps.color, leaf.images.len()), (Some(0), 1));
    assert_eq!(leaf.warnings.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["X016"], "{}", leaf.warnings);
}

/// The alpha of a picture counts where a material is cut out or blended, and is left out where it is opaque, as glTF has it.
#[test]
fn opaque_materials_have_pictures_without_alpha() {
    let shop = picture_shop();
    shop.put("color.png", png(2, 1, png::ColorType::Rgba, &[10, 20, 30, 0, 40, 50, 60, 255]));
    let opaque: &[u8] = &[10, 20, 30, 40, 50, 60];
    let cut: &[u8] = &[10, 20, 30, 0, 40, 50, 60, 255];
    for (mode, channels, wanted, cutoff) in [
        ("", 3, opaque, None),
        (r#","alphaMode":"OPAQUE""#, 3, opaque, None),
        (r#","alphaMode":"MASK","alphaCutoff":0.25"#, 4, cut, Some(0.25)),
        (r#","alphaMode":"BLEND""#, 4, cut, Some(0.5)),
    ] {
        let material = format!(r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}{mode}}}"#);
        let leaf = shop.read("a.gltf", textured(&material)).expect("leaf");
        let image = &leaf.images[0];
        let osier::scene::Pixels::U8(pixels) = &image.pixels else { panic!("8 bit") };
        assert_eq!((image.channels, &pixels[..], leaf.materials[0].alpha_cutoff), (channels, wanted, cutoff), "{mode}");
    }
}

/// A material with a normal map alone uses the set and the transform of that map; where two maps have different ones, those of the
/// colour count, with a warning.
#[test]
fn texture_coordinates_are_those_of_the_maps() {
    let shop = picture_shop();
    let transform = r#""extensions":{"KHR_texture_transform":{"scale":[4,4]}}"#;
    let color = r#""pbrMetallicRoughness":{"baseColorTexture":{"index":0}}"#;
    // The second corner, at (1, 0) of the first set and (0.5, 0) of the second: v is 1 there, since glTF counts it downwards.
    for (material, wanted, told) in [
        (r#"{"normalTexture":{"index":1,"texCoord":1}}"#.to_owned(), 0.5, 0),
        (format!(r#"{{"normalTexture":{{"index":1,{transform}}}}}"#), 4.0, 0),
        (format!(r#"{{{color},"normalTexture":{{"index":1,{transform}}}}}"#), 1.0, 1),
        (format!(r#"{{{color},"normalTexture":{{"index":1,"extensions":{{"KHR_texture_transform":{{}}}}}}}}"#), 1.0, 0),
    ] {
        let leaf = shop.read("a.gltf", textured(&material)).expect("leaf");
        assert_eq!(leaf.mesh.uvs[1], Vec2::new(wanted, 1.0), "{material}");
        let codes: Vec<&str> = leaf.warnings.diagnostics.iter().map(|d| d.code).collect();
        assert_eq!(codes, vec!["X016"; told], "{material}: {}", leaf.warnings);
    }
}

/// A texture that is mirrored or held beyond its edges, as its sampler says, is unfolded over the texture coordinates, since meshes of
/// scenes repeat theirs; it repeated.
#[test]
fn textures_are_mirrored_and_held_as_their_samplers_say() {
    let shop = picture_shop();
    shop.put("color.png", png(2, 1, png::ColorType::Rgb, &[10, 20, 30, 40, 50, 60]));
    let material = |scale: f32| {
        let transform = format!(r#""extensions":{{"KHR_texture_transform":{{"scale":[{scale},1]}}}}"#);
        textured(&format!(r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,{transform}}}}}}}"#))
    };
    let (dark, light) = ([10, 20, 30], [40, 50, 60]);
    for (wrap, scale, wanted, u) in [
        (10497, 2.0, vec![dark, light], 2.0),
        (33648, 2.0, vec![dark, light, light, dark], 1.0),
        // From 0 to 2 are four texels; there is one more on the left, and two on the right.
        (33071, 2.0, vec![dark, dark, light, light, light, light, light], 5.0 / 7.0),
        // Within its edges a texture stays as it is.
        (33071, 1.0, vec![dark, light], 1.0),
    ] {
        let samplers =
            format!(r#""textures":[{{"sampler":0,"source":0}},{{"source":1}}],"samplers":[{{"wrapS":{wrap}}}]"#);
        let file = material(scale).replace(r#""textures":[{"source":0},{"source":1}]"#, &samplers);
        let leaf = shop.read("a.gltf", file).expect("leaf");
        assert!(leaf.warnings.diagnostics.is_empty(), "{}", leaf.warnings);
        let [image] = &leaf.images[..] else { panic!("{wrap}: {} images", leaf.images.len()) };
        let osier::scene::Pixels::U8(pixels) = &image.pixels else { panic!("8 bit") };
        assert_eq!((pixels, image.width as usize, image.height), (&wanted.concat(), wanted.len(), 1), "{wrap}");
        assert_eq!(leaf.materials[0].maps.color, Some(0));
        assert!((leaf.mesh.uvs[1] - Vec2::new(u, 1.0)).length() < 1e-6, "{wrap}: {:?}", leaf.mesh.uvs);
    }
}

#[test]
fn quantized_and_sparse_positions() {
    let shop = Shop::new();
    let mut data: Vec<u8> =
        [0_i16, 0, 0, 0, 16384, 0, 0, 0, 0, 8192, 0, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    data.extend([2, 0, 0, 0]);
    data.extend([0_i16, 32767, 0].iter().flat_map(|v| v.to_le_bytes()));
    let json = document(&data, "", r#","extensionsUsed":["KHR_mesh_quantization"],"extensionsRequired":["KHR_mesh_quantization"]"#)
        .replace(r#""componentType":5126,"count":3"#, r#""componentType":5122,"normalized":true,"count":3,"sparse":{"count":1,"indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":2}}"#)
        .replace(r#""bufferViews":[{"buffer":0,"byteLength":34}]"#, r#""bufferViews":[{"buffer":0,"byteLength":24,"byteStride":8},{"buffer":0,"byteOffset":24,"byteLength":4},{"buffer":0,"byteOffset":28,"byteLength":6}]"#);
    let mesh = shop.read("a.gltf", json).expect("mesh").mesh;
    let x = 16384.0 / 32767.0;
    assert_eq!(mesh.points, [Vec3::ZERO, Vec3::X * x, Vec3::Y]);
}

/// Accessors without bytes are all zero, as those of a morph target in which nothing moves; osier's growth clips have such.
#[test]
fn accessors_without_bytes_are_zeros() {
    let shop = Shop::new();
    let zeros = r#"}],
"bufferViews"#;
    let json = triangle().replace(r#"{"POSITION":0}}]"#, r#"{"POSITION":0},"targets":[{"POSITION":1}]}]"#).replace(
        zeros,
        &format!(r#"}},{{"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[0,0,0]{zeros}"#),
    );
    let imported = shop.read("a.gltf", json).expect("mesh");
    assert_eq!(area(&imported.mesh), Vec3::Z / 2.0);
    assert!(imported.warnings.to_string().contains("morph targets; they are not read"), "{}", imported.warnings);
}

#[test]
fn every_broken_gltf_gets_an_answer() {
    let plain = triangle();
    let deep: String = (1..300).map(|i| format!(",{{\"children\":[{}]}}", i + 1)).collect();
    let nan = document(&floats(&[f32::NAN, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]), "", "");
    let picture = |uri: &str| {
        let extra = format!(
            r#","materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],"textures":[{{"source":0}}],"images":[{uri}]"#
        );
        document(&floats(&CORNERS), "", &extra).replace("\"POSITION\":0}", "\"POSITION\":0},\"material\":0")
    };
    let cases = [
        ("no JSON", "{\"asset\":\n{\"version\" \"2.0\"}}".to_owned()),
        ("not an object", "[1]".into()),
        ("not UTF-8", "{\"a\": \u{0}}".into()),
        ("cycle", plain.replace("{\"mesh\":0}", "{\"mesh\":0,\"children\":[1]},{\"children\":[0]}")),
        ("itself", plain.replace("{\"mesh\":0}", "{\"mesh\":0,\"children\":[0]}")),
        ("two parents", plain.replace("{\"mesh\":0}", "{\"children\":[1,1]},{\"mesh\":0}")),
        ("deep", plain.replace("{\"mesh\":0}", &format!("{{\"children\":[1]}}{deep},{{\"mesh\":0}}"))),
        ("outside", plain.replace("data:", "..%2f..%2fx\",\"x\":\"")),
        ("missing buffer", plain.replace("data:", "x.bin\",\"x\":\"")),
        ("short buffer", plain.replace("\"byteLength\":36", "\"byteLength\":48")),
        ("past its view", plain.replace("\"count\":3", "\"count\":4")),
        ("two billion", plain.replace("\"count\":3", "\"count\":2147483648")),
        (
            "two billion of nothing",
            plain.replace("\"bufferView\":0,", "").replace("\"count\":3", "\"count\":2147483648"),
        ),
        ("stride 0", plain.replace("\"byteLength\":36}]", "\"byteLength\":36,\"byteStride\":0}]")),
        ("stride too small", plain.replace("\"byteLength\":36}]", "\"byteLength\":36,\"byteStride\":4}]")),
        ("no such mesh", plain.replace("\"mesh\":0", "\"mesh\":7")),
        ("wrong type", plain.replace("VEC3", "VEC2")),
        ("not finite", nan),
        ("Draco", document(&floats(&CORNERS), "", r#","extensionsRequired":["KHR_draco_mesh_compression"]"#)),
        (
            "animation pointer",
            document(
                &floats(&CORNERS),
                "",
                r#","animations":[{"channels":[{"sampler":0,"target":{"path":"pointer","extensions":{"KHR_animation_pointer":{"pointer":"/nodes/0"}}}}],"samplers":[{"input":0,"output":0}]}]"#,
            ),
        ),
        ("no meshes", r#"{"asset":{"version":"2.0"}}"#.into()),
        ("picture missing", picture(r#"{"uri":"absent.png"}"#)),
        ("picture outside", picture(r#"{"uri":"../leaf.png"}"#)),
        ("picture without anything", picture("{}")),
        ("picture without a type", picture(r#"{"bufferView":0}"#)),
    ];
    let shop = Shop::new();
    let mut all = String::new();
    for (name, text) in cases {
        all.push_str(&format!("## {name}\n{}\n\n", shop.complaint("leaf.gltf", text)));
    }
    let mut version = glb(&plain, &[]);
    version[4] = 1;
    all.push_str(&format!("## version 1\n{}\n\n", shop.complaint("leaf.glb", version)));
    all.push_str(&format!(
        "## damaged from the first byte\n{}\n\n",
        shop.complaint("leaf.glb", b"\x00\xffTF\x02\0\0\0")
    ));
    all.push_str(&format!("## something else\n{}\n", shop.complaint("leaf.fbx", "Kaydara FBX")));
    insta::assert_snapshot!(all);
}

/// The header of a PNG of any size, with no pixels.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = png(1, 1, png::ColorType::Grayscale, &[0]);
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let mut crc = u32::MAX;
    for b in &bytes[12..29] {
        crc ^= u32::from(*b);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xEDB8_8320 } else { crc >> 1 };
        }
    }
    bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
    bytes
}

#[test]
fn pictures_are_held_against_the_limits_by_their_header() {
    let mut shop = Shop::new();
    shop.put("leaf.mtl", "newmtl Green Leaf\nmap_Kd leaf.png\n");
    let complaint = |shop: &Shop, picture: &[u8]| shop.put("leaf.png", picture).complaint("leaf.obj", LEAF);
    let all = [
        complaint(&shop, &png_header(60_000, 60_000)),
        complaint(&shop, &png_header(1 << 31, 1)),
        complaint(&shop, &png_header(16_000, 16_000)),
        complaint(&shop, b"GIF89a"),
        complaint(&shop, b""),
    ];
    insta::assert_snapshot!(all.join("\n\n"));
    shop.limits.set("image-bytes", "100").expect("limit");
    assert!(complaint(&shop, &png(8, 8, png::ColorType::Rgb, &[7; 192])).contains("--max-image-bytes"));
    shop.limits.set("vertices", "3").expect("limit");
    assert!(shop.complaint("leaf.obj", LEAF).contains("--max-vertices"));
    shop.limits.set("json-bytes", "100").expect("limit");
    assert!(shop.complaint("leaf.gltf", triangle()).contains("--max-json-bytes"));
}

fn jpeg(samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 90);
    encoder.encode(samples, 16, 16, image::ExtendedColorType::Rgb8).expect("encode");
    bytes
}

/// Files of every kind that is read, whole.
fn whole() -> Vec<(&'static str, Vec<u8>)> {
    let noise: Vec<u8> = (0..48 * 16_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let data = floats(&CORNERS);
    let json = triangle();
    let chunk = format!("{}]}}", &json[..json.find(",\"uri\"").expect("uri")].to_owned()).replace("36]", "36}]");
    vec![
        ("leaf.obj", LEAF.repeat(3).into_bytes()),
        ("leaf.gltf", json.into_bytes()),
        ("leaf.glb", glb(&chunk, &data)),
        ("leaf.png", png(16, 16, png::ColorType::Rgb, &noise)),
        ("leaf.png", jpeg(&noise)),
        ("leaf.mtl", b"newmtl Green Leaf\nKd 0.1 0.5 0.2\nNs 30\nd 1\nillum 2\nmap_Kd leaf.png\n".to_vec()),
    ]
}

#[test]
fn cut_and_flipped_files_never_panic_and_cut_ones_are_refused() {
    let shop = Shop::new();
    let all = whole();
    let answer = |name: &str, bytes: &[u8]| {
        if matches!(name, "leaf.png" | "leaf.mtl") {
            shop.put(name, bytes).read("leaf.obj", &all[0].1)
        } else {
            shop.read(name, bytes)
        }
    };
    for (name, bytes) in &all {
        shop.put("leaf.png", &all[3].1).put("leaf.mtl", &all[5].1);
        let good = answer(name, bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(good.warnings.diagnostics.is_empty(), "{name}: {}", good.warnings);
        for i in 0..64 {
            let cut = &bytes[..bytes.len() * i / 64];
            let result = answer(name, cut);
            let text = matches!(*name, "leaf.obj" | "leaf.mtl");
            assert!(text || result.is_err(), "{name} cut at {} is taken for whole", cut.len());
        }
        let mut state = 1_u64;
        for _ in 0..1000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let mut flipped = bytes.clone();
            let at = (state >> 33) as usize % flipped.len();
            flipped[at] ^= 1 << (state >> 30 & 7);
            if let Ok(read) = answer(name, &flipped) {
                assert!(read.mesh.points.iter().all(|p| p.is_finite()));
                assert!(read.mesh.triangles.iter().flatten().all(|i| (*i as usize) < read.mesh.points.len()));
            }
        }
    }
}

#[test]
fn our_own_glb_is_read_back() {
    let (mut scene, _) = synthetic::scene();
    // Leaves of a file that gives no translucency get another one.
    let leaf = scene.materials.iter_mut().find(|m| m.name == "leaf").expect("leaf");
    leaf.translucency = 0.45;
    check_scene(&scene).expect("scene");
    let textures = Arc::new(Textures::encode(&scene).expect("textures"));
    let web = gltf::Profile::Web;
    for (profile, meshopt) in [(web, false), (web, true), (gltf::Profile::Blender, false)] {
        let folder = Folder::memory();
        let options = gltf::GltfOptions {
            profile,
            meshopt,
            target: gltf::GltfTarget::Glb("x.glb".into()),
            ..gltf::GltfOptions::default()
        };
        let mut exporter = gltf::GltfExporter::new(folder.clone(), Arc::clone(&textures), options);
        exporter.begin(&Arc::new(scene.clone())).expect("begin");
        exporter.finish().expect("finish");
        let shop = Shop::new();
        let back = shop.read("x.glb", folder.take("x.glb").expect("file")).expect("read back");
        // Every point of the still ground, moved by its placement, is there.
        let (index, ground) = scene.assets.iter().enumerate().find(|(_, a)| a.id == "ground").expect("ground");
        let placement = scene.placements.iter().find(|p| p.asset == index).expect("placed");
        for p in &ground.meshes[0].mesh.points {
            let world = placement.transform.t + placement.transform.r * (*p * placement.transform.s);
            let near = back.mesh.points.iter().any(|q| (*q - world).length() < if meshopt { 2e-4 } else { 1e-5 });
            assert!(near, "{profile:?}: {world} is lost");
        }
        assert!(back.materials.iter().any(|m| m.maps.color.is_some()), "pictures come back");
        let leaf = back.materials.iter().find(|m| m.name == "leaf").expect("leaf");
        assert_eq!(leaf.translucency, 0.45, "{profile:?}");
    }
}

#[test]
fn fixtures_have_the_folder_to_themselves() {
    // The names above are relative to a fresh folder; a reference to a neighbour must not find one by chance.
    let shop = Shop::new();
    assert!(!Path::new("leaf.mtl").exists() && fs::read_dir(shop.dir.path()).expect("list").next().is_none());
}
