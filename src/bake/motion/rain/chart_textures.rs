//! Resamples the textures of leaves whose water maps need a separate chart to that chart, so that the files of a wet leaf have
//! one set of texture coordinates for both its textures and its water maps.

use std::collections::VecDeque;

use glam::{DVec2, DVec3};

use osier_base::Result;
use osier_base::convert::index;
use osier_base::par::par_map;
use osier_motion::rain::LeafSurface;
use osier_scene::{Image, Maps, Material, Pixels};

/// Largest side of a redrawn texture, in pixels.
const MAX_SIDE: u32 = 4096;
/// Range of the ratio of the sides of a redrawn texture and its source.
const SCALE_RANGE: [f64; 2] = [0.5, 2.0];

/// Resamples the textures of a material to the chart of a blade; returns the material's maps. `suffix` makes the names of the
/// new images unique; these are appended to `new`, and their indices continue those of `images`.
/// # Errors
/// `TooMany` beyond 2^32 images.
pub(super) fn resample_to_charts(
    surface: &LeafSurface,
    material: &Material,
    images: &[Image],
    suffix: &str,
    new: &mut Vec<Image>,
) -> Result<Maps> {
    let mut redrawn = |slot: Option<u32>, is_normal: bool| -> Result<Option<u32>> {
        // A slot without an image stays empty: its uniform value needs no coordinates.
        let Some(source) = slot.and_then(|i| images.get(i as usize)) else { return Ok(None) };
        let id = index(images.len() + new.len(), "images of a scene")?;
        new.push(resample_image(surface, source, is_normal, suffix));
        Ok(Some(id))
    };
    Ok(Maps {
        color: redrawn(material.maps.color, false)?,
        normal: redrawn(material.maps.normal, true)?,
        roughness: redrawn(material.maps.roughness, false)?,
        height: redrawn(material.maps.height, false)?,
    })
}

/// An image over the chart with about as many texels per metre of blade as its source.
fn resample_image(surface: &LeafSurface, source: &Image, is_normal: bool, suffix: &str) -> Image {
    let scale = surface.chart_to_texture_side_ratio().clamp(SCALE_RANGE[0], SCALE_RANGE[1]);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most twice a picture's side")]
    let [width, height] = [source.width, source.height].map(|n| ((f64::from(n) * scale) as u32).clamp(1, MAX_SIDE));
    let sampler = TextureSampler::new(source);
    let rows: Vec<u32> = (0..height).collect();
    let texel = |x: u32, y: u32| -> Option<[f64; 4]> {
        // Rows of a picture run downwards, v upwards.
        let uv = DVec2::new((f64::from(x) + 0.5) / f64::from(width), 1.0 - (f64::from(y) + 0.5) / f64::from(height));
        let mut value = sampler.bilinear(surface.texture_uv(uv)?);
        if is_normal && let Some([texture, chart]) = surface.texture_and_chart_partials(uv) {
            value = rotate_normal(value, sampler.most, texture, chart);
        }
        Some(value)
    };
    let row = |y: &u32| (0..width).map(|x| texel(x, *y)).collect::<Vec<_>>();
    let mut texels: Vec<Option<[f64; 4]>> = par_map(&rows, row).into_iter().flatten().collect();
    fill_beyond_blade(&mut texels, width as usize);
    let channels = usize::from(source.channels);
    let values = texels.iter().flat_map(|t| t.unwrap_or_default().into_iter().take(channels));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounded, within the range of the type")]
    let pixels = match &source.pixels {
        Pixels::U8(_) => Pixels::U8(values.map(|v| (v + 0.5) as u8).collect()),
        Pixels::U16(_) => Pixels::U16(values.map(|v| (v + 0.5) as u16).collect()),
    };
    Image { name: format!("{}{suffix}", source.name), width, height, pixels, ..*source }
}

/// Interpolating look-up of an image's channels, as numbers from 0 to `most`.
struct TextureSampler<'a> {
    image: &'a Image,
    most: f64,
}

impl<'a> TextureSampler<'a> {
    fn new(image: &'a Image) -> Self {
        let most = match image.pixels {
            Pixels::U8(_) => 255.0,
            Pixels::U16(_) => 65535.0,
        };
        Self { image, most }
    }

    /// Values at texture coordinates, which repeat beyond 0 to 1, bilinear between pixels.
    fn bilinear(&self, uv: DVec2) -> [f64; 4] {
        let inside = |x: f64| if (0.0..=1.0).contains(&x) { x } else { x - x.floor() };
        // Centers of pixels lie at half-integer coordinates; beyond those of the outer pixels the edge is repeated.
        let cell = |x: f64, n: u32| {
            let x = (x * f64::from(n) - 0.5).clamp(0.0, f64::from(n.saturating_sub(1)));
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the picture")]
            let low = x as usize;
            (low, (low + 1).min(n as usize - 1), x - low as f64)
        };
        let ((x0, x1, s), (y0, y1, t)) =
            (cell(inside(uv.x), self.image.width), cell(1.0 - inside(uv.y), self.image.height));
        std::array::from_fn(|c| {
            let row = |y: usize| self.texel_channel(x0, y, c) * (1.0 - s) + self.texel_channel(x1, y, c) * s;
            row(y0) * (1.0 - t) + row(y1) * t
        })
    }

    fn texel_channel(&self, x: usize, y: usize, channel: usize) -> f64 {
        let channels = usize::from(self.image.channels);
        if channel >= channels {
            return 0.0;
        }
        let k = (y * self.image.width as usize + x) * channels + channel;
        match &self.image.pixels {
            Pixels::U8(bytes) => bytes.get(k).copied().map_or(0.0, f64::from),
            Pixels::U16(words) => words.get(k).copied().map_or(0.0, f64::from),
        }
    }
}

/// Transforms a normal from the tangent space of the texture to that of the chart. The arrays hold dp/du and dp/dv.
fn rotate_normal(value: [f64; 4], most: f64, texture: [DVec3; 2], chart: [DVec3; 2]) -> [f64; 4] {
    let axes = |[du, dv]: [DVec3; 2]| {
        let tangent = du.normalize_or(DVec3::X);
        [tangent, (dv - tangent * tangent.dot(dv)).normalize_or(DVec3::Y)]
    };
    let ([t, b], [u, v]) = (axes(texture), axes(chart));
    // Normal maps store components -1..1 as 0..most.
    let decode = |c: f64| 2.0 * c / most - 1.0;
    let encode = |c: f64| ((0.5 * c + 0.5) * most).clamp(0.0, most);
    let slope = t * decode(value[0]) + b * decode(value[1]);
    // The component along the normal is the same in both tangent spaces, since both lie in the blade.
    [encode(slope.dot(u)), encode(slope.dot(v)), value[2], value[3]]
}

/// Copies the values of the nearest texels on the blade to the texels beyond it, so that filters find no edge at the margin.
fn fill_beyond_blade(texels: &mut [Option<[f64; 4]>], width: usize) {
    let mut open: VecDeque<usize> = (0..texels.len()).filter(|k| texels[*k].is_some()).collect();
    // A breadth-first search from all texels on the blade at once reaches each empty texel from the nearest one.
    while let Some(k) = open.pop_front() {
        let x = k % width;
        let near = [
            (x > 0).then(|| k - 1),
            (x + 1 < width).then_some(k + 1),
            k.checked_sub(width),
            (k + width < texels.len()).then_some(k + width),
        ];
        for n in near.into_iter().flatten() {
            if texels[n].is_none() {
                texels[n] = texels[k];
                open.push_back(n);
            }
        }
    }
}
