//! Relief of a leaf's surface: the height map of its material.

use glam::DVec2;

use osier_base::math::narrow;
use osier_scene::{Image, Material, Mesh, Pixels};

/// Heights of a leaf's relief over the texture coordinates of its material.
#[derive(Debug, Clone)]
pub struct MaterialHeightMap {
    size: [usize; 2],
    /// Heights over the mesh at scale 1, m, row by row from the top.
    heights: Vec<f32>,
}

impl MaterialHeightMap {
    /// The relief of the first material of a mesh that has a height map; `None` if no material has one.
    pub fn of_first_mapped_material(mesh: &Mesh, materials: &[Material], images: &[Image]) -> Option<Self> {
        mesh.subsets.iter().find_map(|s| {
            let material = materials.get(s.material as usize)?;
            Self::from_image(images.get(material.maps.height? as usize)?, material.height_range)
        })
    }

    /// `range`: height that the largest value of the image represents, m.
    fn from_image(image: &Image, range: f32) -> Option<Self> {
        let heights: Vec<f32> = match &image.pixels {
            Pixels::U16(words) => words.iter().map(|v| f32::from(*v) * (range / 65535.0)).collect(),
            Pixels::U8(bytes) => bytes.iter().map(|v| f32::from(*v) * (range / 255.0)).collect(),
        };
        let size = [image.width as usize, image.height as usize];
        (image.channels == 1 && !heights.is_empty() && heights.len() == size[0] * size[1])
            .then_some(Self { size, heights })
    }

    /// Larger of the map's width and height, in pixels.
    pub fn longer_side(&self) -> usize {
        self.size[0].max(self.size[1])
    }

    /// Height at texture coordinates, which repeat beyond 0 to 1, m: bilinear between pixels.
    pub fn height(&self, uv: DVec2) -> f32 {
        let inside = |x: f64| if (0.0..=1.0).contains(&x) { x } else { x - x.floor() };
        let [width, height] = self.size;
        // Centers of pixels lie at half-integer coordinates; beyond the centers of the outer pixels the edge is repeated.
        let cell = |x: f64, n: usize| {
            let x = (x * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the picture")]
            let low = x as usize;
            (low, (low + 1).min(n - 1), narrow(x - low as f64))
        };
        let ((x0, x1, s), (y0, y1, t)) = (cell(inside(uv.x), width), cell(1.0 - inside(uv.y), height));
        let row = |y: usize| {
            let [a, b] = [x0, x1].map(|x| self.heights[y * width + x]);
            a + (b - a) * s
        };
        let (a, b) = (row(y0), row(y1));
        a + (b - a) * t
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Waves across a leaf: sine of `count` periods over u, of an amplitude, m.
    pub fn waves(count: f64, amplitude: f32) -> MaterialHeightMap {
        let n = 256;
        let height = |k: usize| {
            let x = ((k % n) as f64 + 0.5) / n as f64;
            amplitude * narrow(1.0 + osier_base::math::sin(std::f64::consts::TAU * count * x))
        };
        MaterialHeightMap { size: [n, n], heights: (0..n * n).map(height).collect() }
    }

    #[test]
    fn heights_are_those_of_the_picture_and_linear_between_pixels() {
        let pixels = Pixels::U16(vec![0, 65535, 0, 0]);
        let kind = osier_scene::ImageKind::Data;
        let image = Image { name: "a".into(), kind, width: 2, height: 2, channels: 1, pixels };
        let relief = MaterialHeightMap::from_image(&image, 2e-3).expect("heights");
        let at = |u: f64, v: f64| relief.height(DVec2::new(u, v));
        assert!((at(0.75, 0.75) - 2e-3).abs() < 1e-9 && at(0.25, 0.25).abs() < 1e-9);
        assert!((at(0.5, 0.75) - 1e-3).abs() < 1e-9 && (at(0.75, 0.5) - 1e-3).abs() < 1e-9);
        // Beyond the outer pixels the edge is repeated, beyond 0 to 1 the picture.
        assert!((at(1.0, 1.0) - 2e-3).abs() < 1e-9 && (at(1.75, -0.25) - 2e-3).abs() < 1e-9);
    }
}
