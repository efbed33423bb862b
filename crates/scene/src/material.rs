//! Surfaces and the pictures on them.

use osier_base::units::{byte, linear_from_srgb, srgb_byte};

/// Index into [`crate::Scene::materials`].
pub type MaterialId = u32;

/// What a material stands for; exporters choose their shader by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaterialClass {
    /// Opaque, rough, with relief.
    Bark,
    /// Thin, lit through from behind.
    Leaf,
    /// White translucent hairs of seeds and catkins.
    Catkin,
    /// A transparent, refracting volume.
    Water,
    /// Soil: opaque and matt, repeated over the ground.
    Ground,
}

impl MaterialClass {
    /// Name of the class in the manifest, in lower case.
    #[inline]
    pub fn word(self) -> &'static str {
        match self {
            Self::Bark => "bark",
            Self::Leaf => "leaf",
            Self::Catkin => "catkin",
            Self::Water => "water",
            Self::Ground => "ground",
        }
    }
}

/// Indices into [`crate::Scene::images`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Maps {
    /// sRGB colour; the alpha channel cuts out when `alpha_cutoff` is set.
    pub color: Option<u32>,
    /// Tangent-space normals, (n + 1) / 2, +Y = +v.
    pub normal: Option<u32>,
    /// Roughness, grey, raw.
    pub roughness: Option<u32>,
    /// Height / `height_range`, grey, raw.
    pub height: Option<u32>,
}

impl Maps {
    /// The indices of all maps: colour, normal, roughness, height.
    pub fn all(&self) -> [Option<u32>; 4] {
        [self.color, self.normal, self.roughness, self.height]
    }
}

/// A thin clear film over a surface, such as water on a leaf, where a map sequence gives it weight. OpenPBR: coat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coat {
    /// Maps of the surface: index into [`crate::Scene::map_sequences`].
    pub sequence: u32,
    /// Layer of the sequence that holds the film's weight, from 0 for a bare surface to 1 for a closed film.
    pub weight: &'static str,
    /// Albedo under a closed film as a share of that of the bare surface, 0 to 1. Under the weight w the albedo is multiplied by
    /// 1 + w (darkening - 1). OpenPBR: coat darkening.
    pub darkening: f32,
}

/// A surface: how it scatters light, and its textures.
#[derive(Debug, Clone)]
pub struct Material {
    /// `[a-z0-9_]+`, unique in the scene.
    pub name: String,
    /// What it stands for, by which exporters choose their shader.
    pub class: MaterialClass,
    /// Linear colour. A colour map replaces it and is not multiplied with it.
    pub base_color: [f32; 3],
    /// 0 mirror .. 1 matt; a roughness map replaces it.
    pub roughness: f32,
    /// Index of refraction (water 1.333, leaves and bark 1.5).
    pub ior: f32,
    /// Share of light let through to the other side, 0..1 (leaves about 0.3).
    pub translucency: f32,
    /// Whether back faces are rendered; front faces are counter-clockwise.
    pub double_sided: bool,
    /// The surface is cut out where the alpha of the colour map is below this; `None`: nowhere.
    pub alpha_cutoff: Option<f32>,
    /// Height difference between map values 0 and 1, m.
    pub height_range: f32,
    /// Size of one repeat of the maps on the surface, m; relief is scaled with it.
    pub tile: f32,
    /// Textures that replace the uniform values above.
    pub maps: Maps,
    /// A thin film over it, such as water, whose weight changes from frame to frame; `None` for surfaces that stay dry.
    pub coat: Option<Coat>,
}

impl Coat {
    /// Albedo of a wet leaf as a share of that of a dry one: light is caught in the film of water. Own: chosen by eye against
    /// photographs of wet leaves, 0.4..0.8; a smaller value darkens wet leaves in previews and POV-Ray.
    pub const WET_ALBEDO: f32 = 0.55;
    /// Roughness of a closed film, 0 to 1: smooth, with the ripple that the surface below leaves in it. A surface that is
    /// smoother keeps its own roughness.
    pub const WET_ROUGHNESS: f32 = 0.08;
    /// Roughness of a closed film on what absorbs water, 0 to 1: bark, plaster, tiles, soil. Own: by eye; smaller values varnish them.
    pub const POROUS_WET_ROUGHNESS: f32 = 0.35;
}

impl Material {
    /// An opaque, one-sided material without textures, of an index of refraction of 1.5. `base_color`: linear; `roughness`: 0..1.
    pub fn plain(name: String, class: MaterialClass, base_color: [f32; 3], roughness: f32) -> Self {
        Self {
            name,
            class,
            base_color,
            roughness,
            ior: 1.5,
            translucency: 0.0,
            double_sided: false,
            alpha_cutoff: None,
            height_range: 0.0,
            tile: 1.0,
            maps: Maps::default(),
            coat: None,
        }
    }
}

/// Whether samples are colours or data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageKind {
    /// sRGB colour (8 bit).
    Color,
    /// Numbers that are no colours, stored linearly: heights, normals, roughness.
    Data,
}

/// Samples, rows from the top, channels interleaved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pixels {
    /// 8 bits a channel, 0 to 255.
    U8(Vec<u8>),
    /// 16 bits a channel, 0 to 65535.
    U16(Vec<u16>),
}

/// A picture in memory; exporters encode it as PNG.
#[derive(Debug, Clone)]
pub struct Image {
    /// File name without ending, `<material>_<color|normal|rough|height>`, unique in the scene.
    pub name: String,
    /// Colour or data: whether readers convert the samples from sRGB.
    pub kind: ImageKind,
    /// Width in pixels, at least 1.
    pub width: u32,
    /// Height in pixels, at least 1.
    pub height: u32,
    /// 1 grey, 3 RGB, 4 RGBA.
    pub channels: u8,
    /// `width * height * channels` samples.
    pub pixels: Pixels,
}

impl Image {
    /// Whether both images are equal except for their names.
    pub fn has_same_pixels(&self, other: &Self) -> bool {
        let layout = |image: &Self| (image.kind, image.width, image.height, image.channels);
        layout(self) == layout(other) && self.pixels == other.pixels
    }

    /// The picture at half the width and height, odd sides rounded down: each pixel is the mean of four. Colours are averaged in
    /// linear light and by their alpha. `unit_vectors`: the channels are those of unit vectors, (n + 1) / 2.
    #[must_use]
    pub fn halved(&self, unit_vectors: bool) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let channels = usize::from(self.channels).max(1);
        // The colour of a byte in linear light; 256 values.
        let linear: Vec<f32> = (0..=255_u8).map(|b| linear_from_srgb(f32::from(b) / 255.0)).collect();
        let has_alpha = self.kind == ImageKind::Color && channels == 4;
        let decode = |texel: usize, c: usize| match &self.pixels {
            Pixels::U8(v) => {
                let b = v.get(texel * channels + c).copied().unwrap_or(0);
                let is_color = self.kind == ImageKind::Color && !(has_alpha && c == 3);
                if is_color { linear[usize::from(b)] } else { f32::from(b) / 255.0 }
            }
            Pixels::U16(v) => f32::from(v.get(texel * channels + c).copied().unwrap_or(0)) / 65_535.0,
        };
        let mut bytes = Vec::new();
        let mut words = Vec::new();
        for y in 0..height {
            for x in 0..width {
                // A side of one pixel is not halved: its only pixel counts twice.
                let column = |k: u32| (2 * x + k).min(self.width - 1);
                let row = |k: u32| (2 * y + k).min(self.height - 1);
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)]
                    .map(|(i, j)| (row(j) as usize) * self.width as usize + column(i) as usize);
                let mut mean = [0.0_f32; 4];
                // Colours are weighted by alpha, so that those of cut-out texels do not count, unless all four are cut out.
                let shares = if has_alpha { four.map(|t| decode(t, 3)) } else { [1.0; 4] };
                let total: f32 = shares.iter().sum();
                for (c, mean) in mean.iter_mut().enumerate().take(channels) {
                    let even = total <= 0.0 || (has_alpha && c == 3);
                    let sum: f32 =
                        four.iter().zip(shares).map(|(t, s)| decode(*t, c) * if even { 1.0 } else { s }).sum();
                    *mean = sum / if even { 4.0 } else { total };
                }
                if unit_vectors && channels == 3 {
                    let n = glam::Vec3::new(mean[0], mean[1], mean[2]) * 2.0 - 1.0;
                    let n = osier_base::math::normalize_or(n, glam::Vec3::Z) * 0.5 + 0.5;
                    mean[..3].copy_from_slice(&n.to_array());
                }
                for (c, m) in mean.iter().enumerate().take(channels) {
                    match &self.pixels {
                        Pixels::U8(_) if self.kind == ImageKind::Color && !(has_alpha && c == 3) => {
                            bytes.push(srgb_byte(*m))
                        }
                        Pixels::U8(_) => bytes.push(byte(*m)),
                        Pixels::U16(_) => words.push(word(*m)),
                    }
                }
            }
        }
        let pixels = if matches!(self.pixels, Pixels::U8(_)) { Pixels::U8(bytes) } else { Pixels::U16(words) };
        Self { name: self.name.clone(), kind: self.kind, width, height, channels: self.channels, pixels }
    }
}

/// A value in [0, 1] as 16 bits, rounded to nearest.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn word(c: f32) -> u16 {
    (c.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16
}

/// Number of the pixel at texture coordinates, which repeat beyond 0 to 1, in a picture of at least one pixel; rows from the top.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the picture")]
#[inline]
pub fn pixel_at(uv: glam::Vec2, [width, height]: [u32; 2]) -> usize {
    let inside = |v: f32, n: u32| (((v - v.floor()) * n as f32) as usize).min(n as usize - 1);
    inside(1.0 - uv.y, height) * width as usize + inside(uv.x, width)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_picture_averages_light_alpha_and_directions() {
        let image = |kind, channels, pixels| Image { name: "a".into(), kind, width: 2, height: 2, channels, pixels };
        // Black and white in equal parts: half of the light, not half of the code.
        let grey = image(ImageKind::Color, 3, Pixels::U8([[0; 3], [255; 3], [0; 3], [255; 3]].concat())).halved(false);
        assert!(matches!(&grey.pixels, Pixels::U8(v) if *v == [188, 188, 188]), "{grey:?}");
        // A texel that is cut out does not darken the edge.
        let cut = Pixels::U8([[200, 100, 50, 255], [0, 0, 0, 0], [200, 100, 50, 255], [0, 0, 0, 0]].concat());
        let edge = image(ImageKind::Color, 4, cut).halved(false);
        assert!(matches!(&edge.pixels, Pixels::U8(v) if *v == [200, 100, 50, 128]), "{edge:?}");
        // Heights keep their 16 bits.
        let heights = image(ImageKind::Data, 1, Pixels::U16(vec![0, 100, 200, 301])).halved(false);
        assert!(matches!(&heights.pixels, Pixels::U16(v) if *v == [150]), "{heights:?}");
        // The mean of two directions is a unit vector again.
        let lean = Pixels::U8([[255, 128, 128], [0, 128, 128], [128, 128, 255], [128, 128, 255]].concat());
        let up = image(ImageKind::Data, 3, lean).halved(true);
        assert!(matches!(&up.pixels, Pixels::U8(v) if v[2] >= 253), "{up:?}");
    }
}
