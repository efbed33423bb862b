//! Surfaces and the pictures on them.

/// Index into [`crate::Scene::materials`].
pub type MaterialId = u32;

/// What a material stands for; exporters choose their shader by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaterialClass {
    /// Opaque, rough, with relief.
    Bark,
    /// Thin, lit through from behind.
    Leaf,
    /// Like leaf, fleshier.
    Catkin,
    /// A transparent, refracting volume.
    Water,
    /// Soil: opaque and matt, repeated over the ground.
    Ground,
}

impl MaterialClass {
    /// The word used in the manifest.
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

/// A thin clear film over a surface, such as water on a leaf, shown where a map sequence gives it weight. OpenPBR: coat.
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
    /// What it stands for.
    pub class: MaterialClass,
    /// Linear colour; multiplied with nothing: a colour map replaces it.
    pub base_color: [f32; 3],
    /// 0 mirror .. 1 matt; a roughness map replaces it.
    pub roughness: f32,
    /// Index of refraction (water 1.333, leaves and bark 1.5).
    pub ior: f32,
    /// Share of light let through to the other side, 0..1 (leaves about 0.3).
    pub translucency: f32,
    /// Shown from both sides.
    pub double_sided: bool,
    /// Cut out where the colour map's alpha is below this.
    pub alpha_cutoff: Option<f32>,
    /// Height difference between map values 0 and 1, m.
    pub height_range: f32,
    /// Size of one repeat of the maps on the surface, m; relief is scaled with it.
    pub tile: f32,
    /// Textures that replace the uniform values above.
    pub maps: Maps,
    /// A film over it whose weight frames change.
    pub coat: Option<Coat>,
}

impl Coat {
    /// Albedo of a wet leaf as a share of that of a dry one: light is caught in the film of water. Own: chosen by eye against
    /// photographs of wet leaves, 0.4..0.8; a smaller value darkens wet leaves in previews and POV-Ray.
    pub const WET_ALBEDO: f32 = 0.55;
    /// Roughness of a closed film, 0 to 1: smooth, with the ripple that the surface below leaves in it. A surface that is smoother
    /// keeps its own roughness.
    pub const WET_ROUGHNESS: f32 = 0.08;
}

impl Material {
    /// Something opaque without pictures, seen from its front. `base_color`: linear; `roughness`: 0..1.
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

/// How a picture's numbers are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageKind {
    /// sRGB colour (8 bit).
    Color,
    /// Numbers that are no colours, stored linearly: heights, normals, roughness.
    Data,
}

/// Samples, rows from the top, channels interleaved.
#[derive(Debug, Clone)]
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
    /// How its numbers are meant.
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

/// Number of the pixel at texture coordinates, which repeat beyond 0 to 1, in a picture of at least one pixel; rows from the top.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the picture")]
#[inline]
pub fn pixel_at(uv: glam::Vec2, [width, height]: [u32; 2]) -> usize {
    let inside = |v: f32, n: u32| (((v - v.floor()) * n as f32) as usize).min(n as usize - 1);
    inside(1.0 - uv.y, height) * width as usize + inside(uv.x, width)
}
