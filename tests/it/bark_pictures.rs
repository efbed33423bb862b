//! Bark of the user's own pictures: files, texture coordinates, messages and the picture that Blender shows.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test fails by panicking and looks at files")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::common::picture::vertex_colors_of_ply;
use crate::common::program::{arg, ends};

const POST: &str = "Lsystem: 1\nderivation length: 1\nAxiom: !(0.2)F(2)\nendlsystem\n";

/// A post whose bark has the keys `bark`, in a folder with the pictures `tall.png` (8 x 16), `square.png` (8 x 8), `normal.png` and
/// `grey.png`.
fn write_post(dir: &Path, bark: &str) {
    fs::write(dir.join("post.l"), POST).expect("grammar");
    let scene = format!(
        "[plants.post]\ngrammar = \"post.l\"\n[plants.post.skin]\nuv = \"metric\"\nflare = 0\n[plants.post.bark]\ntile = 0.4\n{bark}\n\
         [[place]]\nplant = \"post\"\n[ground]\nshow = false\n[output]\nformats = [\"obj\"]\n"
    );
    fs::write(dir.join("post.toml"), scene).expect("scene");
    for (name, height) in [("tall.png", 16), ("square.png", 8)] {
        image::RgbImage::from_fn(8, height, color_at).save(dir.join(name)).expect("picture");
    }
    image::RgbImage::from_pixel(8, 8, image::Rgb([128, 128, 255])).save(dir.join("normal.png")).expect("normals");
    image::GrayImage::from_pixel(8, 8, image::Luma([128])).save(dir.join("grey.png")).expect("heights");
}

/// Another colour in every pixel.
fn color_at(x: u32, y: u32) -> image::Rgb<u8> {
    image::Rgb([x * 30, y * 15, 60].map(|v| u8::try_from(v).expect("8 bits")))
}

/// Largest less smallest of each texture coordinate in an OBJ file.
fn ranges_of_coordinates(obj: &str) -> [f32; 2] {
    let rows = obj.lines().filter_map(|line| line.strip_prefix("vt "));
    let all: Vec<Vec<f32>> =
        rows.map(|row| row.split_whitespace().map(|v| v.parse().expect("a number")).collect()).collect();
    assert!(!all.is_empty(), "{obj}");
    [0, 1].map(|k| {
        let values = all.iter().map(|row| row[k]);
        let (low, high) = values.fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
        high - low
    })
}

#[test]
fn bark_is_covered_by_a_picture_in_its_proportions() {
    let dir = tempfile::tempdir().expect("dir");
    let baked = |texture: &str| {
        write_post(dir.path(), &format!("texture = \"{texture}\"\nnormal_texture = \"normal.png\""));
        let out = dir.path().join(texture.trim_end_matches(".png"));
        let (_, said) = ends(0, &["bake", arg(&dir.path().join("post.toml")), "-o", arg(&out)]);
        assert!(!said.contains("S007"), "{said}");
        out
    };
    let (tall, square) = (baked("tall.png"), baked("square.png"));
    // The picture is written as it is, and its normals beside it.
    let color = image::open(tall.join("textures/post_bark_color.png")).expect("a texture").to_rgb8();
    assert_eq!(color.dimensions(), (8, 16));
    assert!(color.enumerate_pixels().all(|(x, y, p)| *p == color_at(x, y)));
    let normal = image::open(tall.join("textures/post_bark_normal.png")).expect("normals").to_rgb8();
    assert!(normal.pixels().all(|p| p.0 == [128, 128, 255]));
    let obj = |out: &Path| fs::read_to_string(out.join("obj/post_1.obj")).expect("obj");
    let ([round, up], [round_square, up_square]) =
        (ranges_of_coordinates(&obj(&tall)), ranges_of_coordinates(&obj(&square)));
    // 0.4 m wide, a picture of 8 x 16 pixels is 0.8 m high: 2 m, and what is below the ground, take half as many repeats as of a
    // square one.
    assert!((up_square / up - 2.0).abs() < 1e-3, "{up_square} and {up}");
    assert!((2.0 / 0.4..2.4 / 0.4).contains(&up_square), "{up_square}");
    assert!((round - round_square).abs() < 1e-6, "{round} and {round_square}");
    let library = fs::read_to_string(tall.join("obj/post_1.mtl")).expect("materials");
    assert!(library.contains("post_bark_color.png"), "{library}");
}

/// PLY has no textures: its vertices have the colours of the picture.
#[test]
fn vertices_of_a_ply_have_the_colors_of_the_picture() {
    let dir = tempfile::tempdir().expect("dir");
    write_post(dir.path(), "texture = \"tall.png\"");
    let file = dir.path().join("post.ply");
    ends(0, &["grow", arg(&dir.path().join("post.toml")), "-o", arg(&file)]);
    let colors = vertex_colors_of_ply(&fs::read(&file).expect("ply"));
    let pictured: BTreeSet<[u8; 3]> = (0..8).flat_map(|x| (0..16).map(move |y| color_at(x, y).0)).collect();
    assert!(colors.len() > 4 && colors.is_subset(&pictured), "{colors:?}");
}

#[test]
fn faults_of_bark_pictures_are_reported_with_their_places() {
    let dir = tempfile::tempdir().expect("dir");
    for (bark, code, said) in [
        ("texture = \"none.png\"", 1, "S005"),
        ("texture = \"square.png\"\nnormal_texture = \"grey.png\"", 1, "a normal map has directions"),
        ("texture = \"post.l\"", 1, "post.l"),
        ("normal_texture = \"normal.png\"", 0, "name that too, with texture"),
        ("texture = \"square.png\"\nkind = \"smooth\"\nside = 64", 0, "kind, side of plants.post.bark have no effect"),
    ] {
        write_post(dir.path(), bark);
        let (out, err) = ends(code, &["check", arg(&dir.path().join("post.toml"))]);
        assert!(err.contains(said) || out.contains(said), "{bark}: {out}{err}");
        assert!(err.contains("post.toml") || out.contains("post.toml"), "{bark}: {out}{err}");
    }
}
