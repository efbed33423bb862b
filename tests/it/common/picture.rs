//! What a rendered picture holds: tests ask it instead of looking at it.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small test numbers")]
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test fails by panicking and computes as it likes"
)]

use std::collections::BTreeSet;
use std::path::Path;

use glam::Vec3;
use osier::geometry::Bounds;
use osier::scene::Camera;

/// An 8-bit picture, values 0..1 as stored (sRGB), rows from the top.
pub struct Picture {
    pub width: usize,
    pub height: usize,
    pub rgb: Vec<[f32; 3]>,
}

/// Pixels `x0..x1`, `y0..y1`.
#[derive(Debug, Clone, Copy)]
pub struct Rect {
    pub x0: usize,
    pub y0: usize,
    pub x1: usize,
    pub y1: usize,
}

/// Brightness of a stored colour.
pub fn luma(c: [f32; 3]) -> f32 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

/// The colours of the vertices of a PLY, which come last in their rows: four bytes after numbers of four bytes each.
pub fn vertex_colors_of_ply(bytes: &[u8]) -> BTreeSet<[u8; 3]> {
    let end = b"end_header\n";
    let start = bytes.windows(end.len()).position(|w| w == end).expect("a header") + end.len();
    let header = String::from_utf8_lossy(&bytes[..start]).into_owned();
    let of_vertices = header.split("element face").next().expect("vertices");
    let count = of_vertices.lines().find_map(|l| l.strip_prefix("element vertex ")).expect("vertices");
    let count: usize = count.parse().expect("a number");
    let row = 4 * of_vertices.matches("property float").count() + 4;
    assert_eq!(of_vertices.matches("property uchar").count(), 4, "{header}");
    let rows = bytes[start..start + count * row].chunks(row);
    rows.map(|v| [v[row - 4], v[row - 3], v[row - 2]]).collect()
}

impl Picture {
    /// Reads a PNG.
    pub fn open(path: &Path) -> Self {
        let image = image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).to_rgb8();
        let rgb = image.pixels().map(|p| p.0.map(|v| f32::from(v) / 255.0)).collect();
        Self { width: image.width() as usize, height: image.height() as usize, rgb }
    }

    pub fn all(&self) -> Rect {
        Rect { x0: 0, y0: 0, x1: self.width, y1: self.height }
    }

    pub fn at(&self, x: usize, y: usize) -> [f32; 3] {
        self.rgb[y * self.width + x]
    }

    /// Share of the pixels in a rectangle for which `is` holds.
    pub fn share(&self, r: Rect, is: impl Fn([f32; 3]) -> bool) -> f32 {
        let pixels = (r.y0..r.y1.min(self.height)).flat_map(|y| (r.x0..r.x1.min(self.width)).map(move |x| (x, y)));
        let (mut yes, mut all) = (0.0, 0.0);
        for (x, y) in pixels {
            all += 1.0;
            yes += f32::from(u8::from(is(self.at(x, y))));
        }
        if all > 0.0 { yes / all } else { 0.0 }
    }

    /// Mean and standard deviation of the brightness.
    pub fn spread(&self) -> (f32, f32) {
        let n = self.rgb.len() as f32;
        let mean = self.rgb.iter().map(|c| luma(*c)).sum::<f32>() / n;
        let variance = self.rgb.iter().map(|c| (luma(*c) - mean) * (luma(*c) - mean)).sum::<f32>() / n;
        (mean, variance.sqrt())
    }

    /// Fails for a picture that is black, white, flat or clipped.
    pub fn assert_content(&self, what: &str) {
        let (mean, deviation) = self.spread();
        assert!((0.08..0.92).contains(&mean), "{what}: mean brightness {mean}");
        assert!(deviation > 0.03, "{what}: flat, deviation {deviation}");
        let black = self.share(self.all(), |c| c.iter().all(|v| *v < 2.0 / 255.0));
        let white = self.share(self.all(), |c| c.iter().all(|v| *v > 254.0 / 255.0));
        assert!(black < 0.05, "{what}: {black} of the pixels are black");
        assert!(white < 0.02, "{what}: {white} of the pixels are clipped");
    }

    /// Centre of the pixels for which `weight` is positive, in pixels, pixel middles at .5; `None` without any.
    pub fn centroid(&self, weight: impl Fn([f32; 3]) -> f32) -> Option<(f32, f32)> {
        let (mut sum, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0);
        for y in 0..self.height {
            for x in 0..self.width {
                let w = weight(self.at(x, y)).max(0.0);
                sum += w;
                x_sum += w * (x as f32 + 0.5);
                y_sum += w * (y as f32 + 0.5);
            }
        }
        (sum > 0.0).then(|| (x_sum / sum, y_sum / sum))
    }

    /// The rectangle that a box of the world covers, cut to the picture; `None` if it lies outside.
    pub fn rect_of(&self, camera: &Camera, bounds: Bounds) -> Option<Rect> {
        let (w, h) = (self.width as f32, self.height as f32);
        let corners: Vec<(f32, f32)> = bounds.corners().iter().filter_map(|c| project(camera, *c, (w, h))).collect();
        let fold =
            |f: fn(f32, f32) -> f32, v: &dyn Fn(&(f32, f32)) -> f32, start: f32| corners.iter().map(v).fold(start, f);
        let (x0, x1) = (fold(f32::min, &|c| c.0, f32::MAX).max(0.0), fold(f32::max, &|c| c.0, f32::MIN).min(w));
        let (y0, y1) = (fold(f32::min, &|c| c.1, f32::MAX).max(0.0), fold(f32::max, &|c| c.1, f32::MIN).min(h));
        let cut = Rect { x0: x0 as usize, y0: y0 as usize, x1: x1.max(0.0) as usize, y1: y1.max(0.0) as usize };
        (cut.x0 < cut.x1 && cut.y0 < cut.y1).then_some(cut)
    }
}

/// Where a point of the world appears, in pixels from the top left; `None` behind the camera.
/// Written out from the definition of the camera, not from the exporters' code.
pub fn project(camera: &Camera, p: Vec3, (w, h): (f32, f32)) -> Option<(f32, f32)> {
    let forward = (camera.target - camera.eye).normalize();
    let level = forward.cross(Vec3::Y).normalize();
    let upright = level.cross(forward);
    // Leaning to the right turns the camera's up vector towards its right.
    let right = level * camera.roll.cos() - upright * camera.roll.sin();
    let up = upright * camera.roll.cos() + level * camera.roll.sin();
    let d = p - camera.eye;
    let depth = d.dot(forward);
    if depth <= 1e-6 {
        return None;
    }
    let half = (camera.vfov * 0.5).tan();
    let (x, y) = (d.dot(right) / (depth * half * w / h), d.dot(up) / (depth * half));
    Some(((x + 1.0) * 0.5 * w, (1.0 - y) * 0.5 * h))
}
