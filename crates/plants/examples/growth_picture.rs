//! Draws the wood of species at several ages or seeds, one panel each, all at one scale, beside a person of 1.75 m:
//! `cargo run --release -p osier-plants --example growth_picture -- oak,beech out.png [--ages 5,10,20] [--seeds 1,2] [--tips]`
#![allow(clippy::expect_used, clippy::disallowed_methods, clippy::print_stdout, reason = "a tool for people")]

mod common;

use glam::{Vec2, Vec3};
use osier_base::limits::Limits;
use osier_plants::grow::years::{PlantOptions, Site, grow};
use osier_scene::plant::Plant;

/// Pixels along a side of a panel.
const SIDE: usize = 520;
const PERSON: f32 = 1.75;

struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl Picture {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels")]
    fn dot(&mut self, x: f32, y: f32, radius: f32, color: [f32; 3], opacity: f32) {
        let (low, high) = ((x - radius - 1.0).max(0.0) as usize, (x + radius + 1.0).max(0.0) as usize);
        let (top, bottom) = ((y - radius - 1.0).max(0.0) as usize, (y + radius + 1.0).max(0.0) as usize);
        for row in top..=bottom.min(self.height - 1) {
            for column in low..=high.min(self.width - 1) {
                let away = Vec2::new(column as f32 + 0.5 - x, row as f32 + 0.5 - y).length();
                let cover = (radius + 0.5 - away).clamp(0.0, 1.0) * opacity;
                let pixel = &mut self.pixels[row * self.width + column];
                for (p, c) in pixel.iter_mut().zip(color) {
                    *p += (c - *p) * cover;
                }
            }
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of dots")]
    fn line(&mut self, from: [f32; 2], to: [f32; 2], radius: f32) {
        let length = Vec2::from(from).distance(Vec2::from(to));
        let opacity = (radius / 0.5).clamp(0.12, 1.0);
        let radius = radius.max(0.5);
        let steps = (length / (0.7 * radius)).ceil().max(1.0) as usize;
        for k in 0..steps {
            let t = (k as f32 + 0.5) / steps as f32;
            let at = [from[0] + (to[0] - from[0]) * t, from[1] + (to[1] - from[1]) * t];
            self.dot(at[0], at[1], radius, [0.22, 0.18, 0.15], opacity);
        }
    }
}

fn draw(picture: &mut Picture, panel: usize, columns: usize, scale: f32, plant: &Plant, tips: bool) {
    let left = (panel % columns * SIDE) as f32 + SIDE as f32 / 2.0;
    let bottom = (panel / columns * SIDE + SIDE) as f32 - 20.0;
    let at = |p: Vec3| [left + p.x * scale, bottom - p.y * scale];
    for axis in &plant.axes {
        let range = plant.nodes_of(axis);
        for i in range.start + 1..range.end {
            let r = 0.5 * (plant.nodes.r[i] + plant.nodes.r[i - 1]);
            picture.line(at(plant.nodes.p[i - 1]), at(plant.nodes.p[i]), r * scale);
        }
    }
    if tips {
        for axis in &plant.axes {
            let p = at(plant.nodes.p[plant.nodes_of(axis).end - 1]);
            picture.dot(p[0], p[1], (0.11 * scale).max(1.0), [0.25, 0.5, 0.2], 0.5);
        }
    }
    for k in 0..100_u16 {
        let y = PERSON * (f32::from(k) + 0.5) / 100.0;
        let p = at(Vec3::new(-0.45 * SIDE as f32 / scale, y, 0.0));
        picture.dot(p[0], p[1], (0.15 * scale).max(1.0), [0.8, 0.1, 0.1], 1.0);
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bytes of colours")]
fn main() {
    let mut args = std::env::args().skip(1);
    let name = args.next().expect("a species");
    let path = args.next().expect("a file");
    let (mut ages, mut seeds, mut tips): (Vec<f64>, Vec<u64>, bool) = (Vec::new(), vec![1], false);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--ages" => ages = args.next().expect("ages").split(',').map(|v| v.parse().expect("an age")).collect(),
            "--seeds" => seeds = args.next().expect("seeds").split(',').map(|v| v.parse().expect("a seed")).collect(),
            _ => tips = true,
        }
    }
    let mut plants = Vec::new();
    for (name, seed) in name.split(',').flat_map(|name| seeds.iter().map(move |seed| (name, *seed))) {
        let spec = common::spec(name, seed);
        for age in if ages.is_empty() { vec![spec.age] } else { ages.clone() } {
            let spec = osier_plants::grow::years::TreeSpec { age, ..spec.clone() };
            let grown = grow(&[spec], &Site::default(), &Limits::default()).expect("grows");
            let options = PlantOptions { materials: vec!["bark".into()], ..PlantOptions::default() };
            plants.push(grown[0].plant(&options, &Limits::default()).expect("a plant"));
        }
    }
    let reach = |p: &Plant| p.nodes.p.iter().fold(0.0_f32, |m, p| m.max(p.y).max(2.0 * p.x.abs()).max(2.0 * p.z.abs()));
    let size = plants.iter().map(reach).fold(2.0, f32::max);
    let columns = plants.len().min(3);
    let rows = plants.len().div_ceil(columns);
    let (width, height) = (columns * SIDE, rows * SIDE);
    let mut picture = Picture { width, height, pixels: vec![[0.93, 0.94, 0.96]; width * height] };
    let scale = (SIDE as f32 - 40.0) / size;
    for (i, plant) in plants.iter().enumerate() {
        draw(&mut picture, i, columns, scale, plant, tips);
    }
    let bytes: Vec<u8> = picture.pixels.iter().flatten().map(|v| (v * 255.0) as u8).collect();
    let file = std::fs::File::create(&path).expect("creates the file");
    let mut encoder = png::Encoder::new(file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().expect("writes").write_image_data(&bytes).expect("writes");
    println!("{path}: {} plants, {size:.1} m", plants.len());
}
