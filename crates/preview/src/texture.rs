//! Textures with mipmaps and alpha coverage that does not shrink with distance.

use glam::{Vec2, Vec4};

use osier_base::math;
use osier_base::units::{byte, linear_from_srgb, srgb_byte};
use osier_scene::{Image, ImageKind, Pixels};

/// One level of a mipmap, RGBA bytes, row 0 at the top.
#[derive(Debug)]
struct MipLevel {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
}

/// A texture with its mipmap levels, the largest first.
#[derive(Debug)]
pub(super) struct Texture {
    levels: Vec<MipLevel>,
    color: bool,
    /// Mean over the texture: linear colour and alpha.
    pub(super) mean: Vec4,
}

/// Table from sRGB bytes to linear values.
#[derive(Debug)]
pub(super) struct Decoder([f32; 256]);

impl Default for Decoder {
    fn default() -> Self {
        let mut table = [0.0; 256];
        for (i, entry) in (0_u8..=255).zip(&mut table) {
            *entry = linear_from_srgb(f32::from(i) / 255.0);
        }
        Self(table)
    }
}

impl Decoder {
    #[inline]
    fn texel(&self, t: [u8; 4], color: bool) -> Vec4 {
        let raw = |b: u8| f32::from(b) * (1.0 / 255.0);
        let value = |b: u8| if color { self.0[usize::from(b)] } else { raw(b) };
        Vec4::new(value(t[0]), value(t[1]), value(t[2]), raw(t[3]))
    }
}

impl Texture {
    /// Builds the levels, without those larger than `side`. `cutoff`: alpha from which a texel is opaque, for
    /// textures with a cut-out.
    pub(super) fn new(image: &Image, side: u32, cutoff: Option<f32>, decoder: &Decoder) -> Self {
        let color = image.kind == ImageKind::Color;
        // A damaged image with too few samples is padded with black.
        let mut level = MipLevel { width: image.width.max(1), height: image.height.max(1), texels: bytes(image) };
        let wanted = level.width as usize * level.height as usize;
        level.texels.resize(wanted, [0, 0, 0, 255]);
        let mut levels = Vec::new();
        let coverage = cutoff.map(|cutoff| AlphaCoverage { cutoff, fraction: level.opaque_fraction(cutoff, 1.0) });
        let mut is_finest = true;
        while level.width > 1 || level.height > 1 {
            let next = halved(&level, color, decoder);
            if level.width.max(level.height) <= side {
                levels.push(if is_finest { level } else { level.with_coverage(coverage) });
            }
            (level, is_finest) = (next, false);
        }
        // The last level is a single texel: the mean of the texture.
        let mean = level.texels.first().map_or(Vec4::ONE, |t| decoder.texel(*t, color));
        levels.push(level);
        Self { levels, color, mean }
    }

    /// Linear colour and alpha at texture coordinates, v up, repeated beyond 0 to 1. `footprint`: width of the sample
    /// in texture coordinates.
    pub(super) fn at(&self, uv: Vec2, footprint: f32, decoder: &Decoder) -> Vec4 {
        self.level(footprint).map_or(self.mean, |level| level.bilinear(uv, self.color, decoder))
    }

    /// The level whose texels are about as wide as a sample.
    fn level(&self, footprint: f32) -> Option<&MipLevel> {
        let finest = self.levels.first()?;
        #[allow(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
        let mut texels = footprint * finest.width.max(finest.height) as f32;
        let mut i = 0;
        // A pixel averages several samples, so a level a little finer than one texel per sample is
        // free of aliasing.
        while texels > 1.5 && i + 1 < self.levels.len() {
            texels *= 0.5;
            i += 1;
        }
        self.levels.get(i)
    }
}

/// Alpha cutoff of a texture, and the part that it leaves opaque.
#[derive(Debug, Clone, Copy)]
struct AlphaCoverage {
    /// Alpha from which a texel is opaque.
    cutoff: f32,
    /// Fraction of opaque texels.
    fraction: f32,
}

impl MipLevel {
    /// Fraction of the texels whose alpha, multiplied by `scale`, reaches `cutoff`.
    fn opaque_fraction(&self, cutoff: f32, scale: f32) -> f32 {
        let opaque = self.texels.iter().filter(|t| f32::from(t[3]) * (1.0 / 255.0) * scale >= cutoff).count();
        #[allow(clippy::cast_precision_loss, reason = "a fraction")]
        let fraction = opaque as f32 / self.texels.len().max(1) as f32;
        fraction
    }

    /// Scales alpha until the opaque fraction is that of the finest level; mere averaging would thin out leaves with distance.
    /// Source: I. Castano, "Computing alpha mipmaps", 2010.
    fn with_coverage(mut self, coverage: Option<AlphaCoverage>) -> Self {
        /// Bisection steps: the scale is found to 4 / 2^16, finer than a byte of alpha.
        const STEPS: u32 = 16;
        let Some(AlphaCoverage { cutoff, fraction: wanted }) = coverage else { return self };
        // Bisection: the fraction grows with the scale.
        let [mut low, mut high] = [0.25_f32, 4.0];
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            *(if self.opaque_fraction(cutoff, middle) < wanted { &mut low } else { &mut high }) = middle;
        }
        // The fraction is a step function: the better of the two ends is taken.
        let miss = |scale: f32| (self.opaque_fraction(cutoff, scale) - wanted).abs();
        let scale = if miss(low) < miss(high) { low } else { high };
        self.texels.iter_mut().for_each(|t| t[3] = byte(f32::from(t[3]) * (1.0 / 255.0) * scale));
        self
    }

    /// Bilinear interpolation between the middles of four texels, repeated beyond 0 to 1.
    fn bilinear(&self, uv: Vec2, color: bool, decoder: &Decoder) -> Vec4 {
        #[allow(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
        let size = Vec2::new(self.width as f32, self.height as f32);
        // Wrapped to 0 to 1, v turned down, in texels from the centre of the first.
        let p = Vec2::new(uv.x - floor(uv.x), 1.0 - (uv.y - floor(uv.y))) * size - 0.5;
        let cell = Vec2::new(floor(p.x), floor(p.y));
        let f = p - cell;
        // The texel left of the first is the last of the repeated texture.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most a picture's width")]
        let wrap = |v: f32, n: u32| if v < 0.0 { n as usize - 1 } else { v as usize };
        let next = |i: usize, n: u32| if i + 1 < n as usize { i + 1 } else { 0 };
        let (x0, y0) = (wrap(cell.x, self.width), wrap(cell.y, self.height));
        let (x1, y1) = (next(x0, self.width), next(y0, self.height));
        let texel = |x: usize, y: usize| {
            let t = self.texels.get(y * self.width as usize + x).copied().unwrap_or_default();
            decoder.texel(t, color)
        };
        let upper = texel(x0, y0).lerp(texel(x1, y0), f.x);
        upper.lerp(texel(x0, y1).lerp(texel(x1, y1), f.x), f.y)
    }
}

/// Largest integer not above x, for |x| far below 2^31. A conversion to i32 and back is several times as fast as
/// libm's floor, and this is called for every texture look-up.
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "meant")]
fn floor(x: f32) -> f32 {
    let whole = x as i32 as f32;
    if whole > x { whole - 1.0 } else { whole }
}

/// The samples of an image as RGBA bytes: grey is spread to three channels, missing alpha is opaque.
fn bytes(image: &Image) -> Vec<[u8; 4]> {
    fn spread<T: Copy>(samples: &[T], channels: u8, byte: impl Fn(T) -> u8) -> Vec<[u8; 4]> {
        let n = usize::from(channels.max(1));
        let texel = |c: &[T]| match *c {
            [g] => [byte(g), byte(g), byte(g), 255],
            [g, a] => [byte(g), byte(g), byte(g), byte(a)],
            [r, g, b] => [byte(r), byte(g), byte(b), 255],
            [r, g, b, a, ..] => [byte(r), byte(g), byte(b), byte(a)],
            [] => [0, 0, 0, 255],
        };
        samples.chunks_exact(n).map(texel).collect()
    }
    match &image.pixels {
        Pixels::U8(p) => spread(p, image.channels, |b| b),
        Pixels::U16(p) => spread(p, image.channels, |w| byte(f32::from(w) / 65_535.0)),
    }
}

/// The next smaller level: means of two by two texels in linear light, colours weighted by their alpha so that the
/// colour of transparent texels does not bleed into edges.
fn halved(level: &MipLevel, color: bool, decoder: &Decoder) -> MipLevel {
    let (width, height) = (level.width.div_ceil(2), level.height.div_ceil(2));
    let texel = |x: u32, y: u32| {
        let (x, y) = (x.min(level.width - 1) as usize, y.min(level.height - 1) as usize);
        let t = level.texels.get(y * level.width as usize + x).copied().unwrap_or_default();
        decoder.texel(t, color)
    };
    let mut texels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for x in 0..width {
            let four =
                [texel(2 * x, 2 * y), texel(2 * x + 1, 2 * y), texel(2 * x, 2 * y + 1), texel(2 * x + 1, 2 * y + 1)];
            // Weighted by alpha; of four transparent texels the plain mean is kept.
            let alpha = four.iter().fold(0.0, |s, t| s + t.w);
            let sum = four.iter().fold(Vec4::ZERO, |s, t| s + *t * if alpha > 0.0 { t.w / alpha } else { 0.25 });
            let encode = |c: f32| if color { srgb_byte(c) } else { byte(c) };
            texels.push([encode(sum.x), encode(sum.y), encode(sum.z), byte(alpha * 0.25)]);
        }
    }
    MipLevel { width, height, texels }
}

/// Width of a sample in texture coordinates. `spread`: width of the sample on the surface, m; `edges`: edges of the
/// triangle, m; `uv_edges`: the same in texture coordinates.
pub(super) fn footprint(spread: f32, edges: [glam::Vec3; 2], uv_edges: [Vec2; 2]) -> f32 {
    let area = edges[0].cross(edges[1]).length();
    let uv_area = uv_edges[0].perp_dot(uv_edges[1]).abs();
    if area > 0.0 { spread * math::sqrt_f32(uv_area / area) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checker() -> Image {
        let pixels = (0..16 * 16).flat_map(|i| if (i % 16 + i / 16) % 2 == 0 { [255; 3] } else { [0; 3] }).collect();
        let name = "checker".into();
        Image { name, kind: ImageKind::Color, width: 16, height: 16, channels: 3, pixels: Pixels::U8(pixels) }
    }

    #[test]
    fn far_samples_see_the_mean_light_not_the_mean_byte() {
        let decoder = Decoder::default();
        let texture = Texture::new(&checker(), 4096, None, &decoder);
        let far = texture.at(Vec2::new(0.3, 0.7), 1.0, &decoder);
        assert!((far.x - 0.5).abs() < 0.01, "{far}");
        assert!((texture.mean.x - 0.5).abs() < 0.01);
    }

    #[test]
    fn near_samples_see_the_texel_and_repeat() {
        let decoder = Decoder::default();
        let texture = Texture::new(&checker(), 4096, None, &decoder);
        // The upper left texel, v = 1 at the top, is white.
        for shift in [Vec2::ZERO, Vec2::new(3.0, -2.0)] {
            let near = texture.at(Vec2::new(0.5 / 16.0, 15.5 / 16.0) + shift, 0.0, &decoder);
            assert!((near.x - 1.0).abs() < 1e-3, "{near}");
        }
    }
    #[test]
    fn leaves_cover_as_much_from_afar() {
        // A ragged edge and holes a few texels wide, which plain means would close or thin out.
        let side = 512_u16;
        let alpha = |x: u16, y: u16| {
            let [u, v] = [x, y].map(f32::from);
            let wave = |f: f32| math::sin_f32(u * f) * math::cos_f32(v * f * 1.3);
            byte(0.35 + 0.5 * wave(0.9) + 0.3 * wave(0.23) + 0.2 * wave(0.017))
        };
        let pixels = (0..side).flat_map(|y| (0..side).flat_map(move |x| [90, 140, 60, alpha(x, y)])).collect();
        let (name, side) = ("leaf".into(), u32::from(side));
        let kind = ImageKind::Color;
        let image = Image { name, kind, width: side, height: side, channels: 4, pixels: Pixels::U8(pixels) };
        let decoder = Decoder::default();
        for cutoff in [0.5, 0.3] {
            let cut = Texture::new(&image, side, Some(cutoff), &decoder);
            let plain = Texture::new(&image, side, None, &decoder);
            let share = |t: &Texture, i: usize| t.levels[i].opaque_fraction(cutoff, 1.0);
            let wanted = share(&cut, 0);
            for i in 1..=4 {
                assert!((share(&cut, i) - wanted).abs() < 0.01, "size {i}: {} of {wanted}", share(&cut, i));
            }
            assert!((1..=4).any(|i| (share(&plain, i) - wanted).abs() > 0.05), "the picture is too tame");
        }
    }
}
