//! Pictures composited from layers: attractors and gradients.

use glam::DVec3;

use crate::bake::BakeContext;
use crate::bake::assets::attractor::{
    DEFAULT_POINTS_PER_PIXEL, check_escapes, check_picture_memory, picture_density, picture_labels, trimmed_bounds,
};
use crate::recipe::{AttractorRecipe, LayerRecipe, Recipe};
use osier_base::Result;
use osier_base::convert::limit;
use osier_base::math::{lerp, narrow};
use osier_base::rng::{mix64, word};
use osier_base::units::srgb_from_linear;
use osier_ifs::affine::Affine;
use osier_ifs::cloud::DrawRequest;
use osier_ifs::game::InstructionSet;
use osier_ifs::histogram::{PictureWindow, histogram};
use osier_ifs::picture::{ToneMapping, opacity};

/// Bytes for each pixel of the canvas: its own, a rectangle on it, and the samples of the file.
const CANVAS_BYTES_PER_PIXEL: u64 = 32;

/// A picture in sRGB with straight alpha, 0..1.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerCanvas {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows; `pixels` has `width * height` elements.
    pub height: usize,
    /// Row by row from the top.
    pub pixels: Vec<[f32; 4]>,
}

/// A rectangle in pixels from the canvas's upper left corner; it may extend beyond the canvas.
#[derive(Debug, Clone, Copy)]
struct PixelRect {
    left: i64,
    top: i64,
    width: usize,
    height: usize,
}

impl PixelRect {
    /// The part of it that lies on a canvas; without pixels if none does.
    fn on_canvas(self, canvas: &LayerCanvas) -> Self {
        let part = |start: i64, length: usize, end: usize| {
            let first = start.max(0);
            let last = (start + length as i64).min(end as i64);
            (first, limit((last - first).max(0).unsigned_abs()))
        };
        let ((left, width), (top, height)) =
            (part(self.left, self.width, canvas.width), part(self.top, self.height, canvas.height));
        Self { left, top, width, height }
    }
}

/// Colour, sRGB, and opacity of each pixel of a layer's rectangle.
struct LayerBitmap {
    rect: PixelRect,
    color: Vec<[f32; 3]>,
    alpha: Vec<f32>,
}

/// Composites a recipe's layers, the first at the bottom.
/// # Errors
/// I050 beyond the memory allowed, I023 if points escape, `Limit`, `Cancelled`.
/// Source: [wang-hao] Fig. 9, a scene of the paper's tables; the order and places are the recipe's.
pub fn compose(scene: &Recipe, context: &BakeContext<'_>) -> Result<LayerCanvas> {
    let keys = &scene.picture;
    let side = u64::from(keys.width.max(keys.height));
    context.limits.check("image-side", side, "a side of the picture in pixels")?;
    let (width, height) = (keys.width as usize, keys.height as usize);
    let bytes = u64::from(keys.width) * u64::from(keys.height) * CANVAS_BYTES_PER_PIXEL;
    context.limits.check("memory", bytes, "the memory of the picture, in bytes,")?;
    let ground = keys.background.map_or([0.0; 4], |c| {
        let [r, g, b] = c.map(srgb_from_linear);
        [r, g, b, 1.0]
    });
    let mut canvas = LayerCanvas { width, height, pixels: vec![ground; width * height] };
    context.progress.stage("drawing layers", scene.layers.len() as u64);
    for (i, layer) in scene.layers.iter().enumerate() {
        context.cancel.check()?;
        let bitmap = match &layer.cloud {
            Some(cloud) => attractor_layer(layer, cloud, scene, i, context)?,
            None => gradient_layer(layer, &canvas),
        };
        canvas.composite_layer(&bitmap, narrow(layer.keys.opacity));
        context.progress.advance(1);
    }
    Ok(canvas)
}

impl LayerCanvas {
    /// Whether every pixel has full alpha, so that the picture can be written without an alpha channel.
    pub fn is_opaque(&self) -> bool {
        self.pixels.iter().all(|p| p[3] >= 1.0)
    }

    /// Blends a layer over the canvas; its pixels beyond the canvas are skipped.
    fn composite_layer(&mut self, bitmap: &LayerBitmap, opacity: f32) {
        let p = bitmap.rect;
        for v in 0..p.height {
            for u in 0..p.width {
                let (Ok(x), Ok(y)) = (usize::try_from(p.left + u as i64), usize::try_from(p.top + v as i64)) else {
                    continue;
                };
                let i = v * p.width + u;
                let (Some(color), Some(alpha)) = (bitmap.color.get(i), bitmap.alpha.get(i)) else { continue };
                if x < self.width
                    && let Some(under) = self.pixels.get_mut(y * self.width + x)
                {
                    *under = blend_over(*under, *color, alpha * opacity);
                }
            }
        }
    }
}

/// The Porter-Duff operator "over" with straight alpha, on sRGB values as image editors blend them.
fn blend_over(under: [f32; 4], color: [f32; 3], alpha: f32) -> [f32; 4] {
    let total = alpha + under[3] * (1.0 - alpha);
    if total <= 0.0 {
        return [0.0; 4];
    }
    // With straight alpha, colours mix by the upper layer's share of the resulting alpha.
    let t = alpha / total;
    let mix = |k: usize| lerp(under[k], color[k], t);
    [mix(0), mix(1), mix(2), total]
}

/// The rectangle of a layer of `size` (width, height in pixels). The key `at` places the centre of its lower edge, in shares of
/// the canvas.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "shares of a picture, at most ten times it")]
fn rect_on_canvas(layer: &LayerRecipe, canvas: (usize, usize), [wide, high]: [f64; 2]) -> PixelRect {
    let (w, h) = (canvas.0 as f64, canvas.1 as f64);
    let left = (layer.keys.at[0] * w - 0.5 * wide).round();
    let bottom = (h - layer.keys.at[1] * h).round();
    let (width, height) = (wide.round().max(1.0), high.round().max(1.0));
    PixelRect { left: left as i64, top: (bottom - height) as i64, width: width as usize, height: height as usize }
}

fn gradient_layer(layer: &LayerRecipe, canvas: &LayerCanvas) -> LayerBitmap {
    let keys = &layer.keys;
    let size = [keys.width.unwrap_or(1.0) * canvas.width as f64, keys.height.unwrap_or(1.0) * canvas.height as f64];
    let whole = rect_on_canvas(layer, (canvas.width, canvas.height), size);
    // A rectangle may be ten times as wide and high as the canvas: only what lies on it is made.
    let rect = whole.on_canvas(canvas);
    let above = limit((rect.top - whole.top).max(0).unsigned_abs());
    let foot = keys.color.unwrap_or_default().map(srgb_from_linear);
    let top = keys.color2.map_or(foot, |c| c.map(srgb_from_linear));
    let row = |v: usize| {
        let t = ((above + v) as f32 + 0.5) / whole.height as f32;
        [0, 1, 2].map(|k| lerp(top[k], foot[k], t))
    };
    let color = (0..rect.height).flat_map(|v| std::iter::repeat_n(row(v), rect.width)).collect();
    LayerBitmap { rect, color, alpha: vec![1.0; rect.width * rect.height] }
}

fn attractor_layer(
    layer: &LayerRecipe,
    cloud: &AttractorRecipe,
    scene: &Recipe,
    index: usize,
    context: &BakeContext<'_>,
) -> Result<LayerBitmap> {
    let keys = &layer.keys;
    let canvas = (scene.picture.width as usize, scene.picture.height as usize);
    let (low, high) = trimmed_bounds(cloud);
    let natural = (high - low).max(DVec3::splat(1e-12));
    let (w, h) = (canvas.0 as f64, canvas.1 as f64);
    let size = match (keys.width, keys.height) {
        (Some(x), Some(y)) => [x * w, y * h],
        // If one side is given, the other follows from the proportions of the attractor.
        (Some(x), None) => [x * w, x * w * natural.y / natural.x],
        (None, y) => [y.unwrap_or(1.0) * h * natural.x / natural.y, y.unwrap_or(1.0) * h],
    };
    let max_side = 10.0 * w.max(h);
    // Larger layers would add nothing to the canvas but would need memory for all their pixels.
    let rect = rect_on_canvas(layer, canvas, size.map(|v| v.min(max_side)));
    let pixels = rect.width as u64 * rect.height as u64;
    check_picture_memory(&format!("layer {index}"), pixels, context)?;
    let count = keys.points.map_or(DEFAULT_POINTS_PER_PIXEL * pixels, u64::from);
    context.limits.check("points", count, "the number of points of a layer")?;
    // Scale the system along x until a table unit is as many pixels wide as high, so that one pixel size serves both axes.
    // Table units per pixel along y.
    let pixel = natural.y / rect.height as f64;
    let stretch = DVec3::new(pixel * rect.width as f64 / natural.x, 1.0, 1.0);
    let mut system = cloud.system.clone();
    if system.condensation.is_empty() {
        for map in &mut system.maps {
            map.affine = map.affine.conjugated(stretch, DVec3::ZERO);
        }
        system.last = system.last.map(|a| a.conjugated(stretch, DVec3::ZERO));
    } else {
        // Discs and segments cannot be stretched themselves: the points are, after all maps.
        system.last = Some(Affine::scaling(stretch, DVec3::ZERO).after(&system.last.unwrap_or(Affine::IDENTITY)));
    }
    let middle = (low + high) * 0.5 * stretch;
    let window = PictureWindow { width: rect.width, height: rect.height, center: [middle.x, middle.y], pixel };
    let seed = mix64(&[scene.general.seed, word("layer"), index as u64]);
    let request = DrawRequest { system: &system, study: &cloud.study, seed, points: count, tier: InstructionSet::Best };
    let counts = histogram(&request, picture_labels(cloud).as_ref(), &window);
    check_escapes(cloud, counts.escapes)?;
    let drawn = picture_density(cloud, &counts, 1, None, context)?;
    let tone = ToneMapping {
        exposure: keys.exposure.unwrap_or(scene.picture.exposure),
        gamma: keys.gamma.unwrap_or(scene.picture.gamma),
        background: None,
    };
    let flat = keys.color.unwrap_or([0.05, 0.15, 0.03]);
    let color = |i: usize| drawn.color.get(i).copied().unwrap_or(flat).map(srgb_from_linear);
    Ok(LayerBitmap { rect, color: (0..drawn.value.len()).map(color).collect(), alpha: opacity(&drawn, &tone) })
}
