//! Ray tracing of pictures with adaptive anti-aliasing: tiles are rendered in parallel, and pixels whose even and odd
//! samples disagree take more.

use glam::Vec3;

use super::draft;
use super::light_transport::{SampleContext, ScatteredLight};
use super::perspective::{PerspectiveCamera, PrimaryRay};
use super::picture::Picture;
use super::pixel::{ForegroundPixel, TILE, composite};
use super::quality::{Quality, SampleRange};
use super::render_scene::{RenderScene, ray};
use super::request::RenderRequest;
use super::sampler::Sampler;
use super::tone::tone_map;
use osier_base::par::par_map;
use osier_base::progress::{Cancel, Progress};
use osier_base::{Error, Result, math};

/// Pictures with at most this many samples per pixel count as dense foliage, whose pixels share their ambient light:
/// with more samples the noise is low enough without.
const DENSE_FOLIAGE_SAMPLES: u32 = 8;
/// Ambient samples of a pixel in dense foliage: its 24 neighbours contribute theirs.
const DENSE_FOLIAGE_AMBIENT_SAMPLES: f32 = 3.0;
/// Assumed brightness of the backdrop when the noise of edges and shadows is judged.
const FLOOR_BRIGHTNESS: f32 = 0.6;

/// Instance index of a pixel whose samples all hit nothing.
const NO_INSTANCE: u32 = u32::MAX;
/// Instance index of a pixel whose samples hit different instances.
const MIXED_INSTANCES: u32 = u32::MAX - 1;

/// Samples of one pixel so far.
#[derive(Debug, Clone, Copy, Default)]
struct PixelSamples {
    /// Sums over the even and over the odd samples: their difference estimates the noise.
    halves: [SampleSums; 2],
    samples: u32,
    /// Instance that all samples hit, [`NO_INSTANCE`] or [`MIXED_INSTANCES`].
    instance: u32,
}

/// Sums over the even or over the odd samples of a pixel.
#[derive(Debug, Clone, Copy, Default)]
struct SampleSums {
    /// Sum of the radiances of the objects that were hit.
    radiance: Vec3,
    /// The part of `radiance` that is not ambient light.
    direct: Vec3,
    /// Fractions of ambient light that were scattered towards the viewer.
    diffuse: Vec3,
    /// Sum of the radiances of the ambient samples.
    ambient: Vec3,
    /// Number of samples with a ray for ambient light.
    ambient_samples: f32,
    /// Number of samples that hit an object.
    hits: f32,
    /// Light on the floor relative to a floor without shadow, summed over the samples without an object.
    floor_light: f32,
}

/// Ambient light summed over some pixels.
#[derive(Debug, Clone, Copy, Default)]
struct AmbientSum {
    radiance: Vec3,
    samples: f32,
}

impl AmbientSum {
    fn plus(self, other: Self) -> Self {
        Self { radiance: self.radiance + other.radiance, samples: self.samples + other.samples }
    }
}

impl SampleSums {
    fn of(light: &ScatteredLight) -> Self {
        let ScatteredLight { direct, diffuse, ambient, ambient_samples, .. } = *light;
        Self { radiance: light.radiance(), direct, diffuse, ambient, ambient_samples, hits: 1.0, floor_light: 0.0 }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            radiance: self.radiance + other.radiance,
            direct: self.direct + other.direct,
            diffuse: self.diffuse + other.diffuse,
            ambient: self.ambient + other.ambient,
            ambient_samples: self.ambient_samples + other.ambient_samples,
            hits: self.hits + other.hits,
            floor_light: self.floor_light + other.floor_light,
        }
    }

    /// The mean of `n` samples. `ambient`: mean ambient radiance, if it is shared with other pixels.
    fn resolve(&self, n: f32, ambient: Option<Vec3>) -> ForegroundPixel {
        let radiance =
            ambient.map_or(self.radiance, |ambient| self.direct + self.diffuse * ambient) / self.hits.max(1.0);
        // Colours are means over the samples that hit an object; the others show the background and
        // its floor.
        let misses = n - self.hits;
        ForegroundPixel {
            color: tone_map(radiance),
            coverage: (self.hits / n.max(1.0)).min(1.0),
            floor_light: if misses > 0.0 { self.floor_light / misses } else { 1.0 },
        }
    }
}

impl PixelSamples {
    fn add(&mut self, hit: SampleHit) {
        let instance = if let SampleHit::Object(light) = &hit { light.instance } else { NO_INSTANCE };
        self.instance = if self.samples == 0 || self.instance == instance { instance } else { MIXED_INSTANCES };
        // Even and odd indices of a Sobol sequence are both well distributed, so either half
        // estimates the pixel.
        let half = &mut self.halves[usize::from(self.samples % 2 == 1)];
        match hit {
            SampleHit::Object(light) => *half = half.plus(SampleSums::of(&light)),
            SampleHit::Floor { light } => half.floor_light += light,
            SampleHit::Background => half.floor_light += 1.0,
        }
        self.samples += 1;
    }

    fn total(&self) -> SampleSums {
        self.halves[0].plus(self.halves[1])
    }

    /// The mean of all samples. `ambient`: mean ambient radiance, if it is shared with other pixels.
    #[allow(clippy::cast_precision_loss, reason = "hundreds of samples")]
    fn resolve(&self, ambient: Option<Vec3>) -> ForegroundPixel {
        self.total().resolve(self.samples as f32, ambient)
    }

    /// Difference in displayed brightness (gamma 2) between even and odd samples. `ambient`: mean ambient radiance, if
    /// it is shared with other pixels.
    #[allow(clippy::cast_precision_loss, reason = "hundreds of samples")]
    fn disagreement(&self, ambient: Option<Vec3>) -> f32 {
        let brightness = |i: usize| {
            let ForegroundPixel { color, coverage, floor_light } =
                self.halves[i].resolve(self.samples as f32 * 0.5, ambient);
            // A mid-grey replaces the backdrop: edges and shadows count as noise as far as they are visible against it.
            let c = color * coverage + Vec3::splat(FLOOR_BRIGHTNESS * (1.0 - coverage) * floor_light);
            math::sqrt_f32(c.dot(Vec3::new(0.3, 0.5, 0.2)).max(0.0))
        };
        (brightness(0) - brightness(1)).abs()
    }
}

/// Surface that one sample of a pixel hits, with its light.
enum SampleHit {
    Object(ScatteredLight),
    /// The floor, with its light relative to a floor without shadow.
    Floor {
        light: f32,
    },
    Background,
}

/// Renders a picture; drafts are rasterised, all others ray traced.
/// # Errors
/// `Range` for a size of zero; P002 for a camera that is not finite; `Cancelled`.
pub fn render(
    world: &RenderScene<'_>,
    request: &RenderRequest,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Picture> {
    let [width, height] = request.size;
    if width == 0 || height == 0 {
        return Err(Error::Range {
            name: "size of a picture".into(),
            value: 0.0,
            min: 1.0,
            max: 65_535.0,
            unit: "pixels",
        });
    }
    let camera = PerspectiveCamera::new(&request.camera, request.size);
    if !camera.is_finite() {
        return Err(Error::input("P002", "the position or the direction of the camera is not finite"));
    }
    if !world.has_bvh {
        return draft::render(world, request, &camera, cancel, progress);
    }
    // Upper left pixels of the tiles, row by row; tiles at the right and lower edges may be smaller.
    let mut corners = Vec::new();
    for y in (0..height).step_by(TILE as usize) {
        corners.extend((0..width).step_by(TILE as usize).map(|x| [x, y]));
    }
    // Noise depends on how much of the picture objects cover and how large they are: the budget is
    // fixed per picture.
    let floor = request.backdrop.floor(&world.bounds);
    let max_samples = sample_budget(world, request, &camera);
    let dense_foliage = world.materials.quality.shares_ambient_light() && max_samples <= DENSE_FOLIAGE_SAMPLES;
    let render_tile = |corner: &[u32; 2]| {
        cancel.check()?;
        let [w, h] = [0, 1].map(|k| TILE.min(request.size[k] - corner[k]) as usize);
        let size = TileSize { w, h };
        let tile = Tile { world, request, camera: &camera, floor, dense_foliage, corner: *corner, size };
        let pixels = tile.render(max_samples);
        progress.advance(1);
        Ok(pixels)
    };
    // Tiles neither overlap nor look at each other, so the picture does not depend on the number of
    // threads.
    let tiles: Vec<Result<Vec<[u8; 4]>>> = par_map(&corners, render_tile);
    let mut picture = Picture::new(width, height);
    for (corner, pixels) in corners.iter().zip(tiles) {
        picture.put_block(*corner, TILE.min(width - corner[0]), &pixels?);
    }
    Ok(picture)
}

/// Most samples per pixel. The budget of the quality is spread over the part of the picture that objects cover, and
/// raised where the objects are large: noise is hidden among the leaves of a distant crown, but visible on a leaf
/// that fills the picture.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two small numbers")]
fn sample_budget(world: &RenderScene<'_>, request: &RenderRequest, camera: &PerspectiveCamera) -> u32 {
    /// Pixels between two probing rays.
    const PROBE_STEP: u32 = 12;
    /// Pixels from a probing ray to its partner, which tests whether the same instance continues there.
    const PARTNER_DISTANCE: u32 = 8;
    /// Factor on the budget if all objects are large.
    const LARGE_OBJECT_FACTOR: f32 = 9.0;
    let SampleRange { min, max, .. } = world.materials.quality.sample_range();
    // Drafts have one sample whatever they show.
    if min == max {
        return max;
    }
    let probe = |x: u32, y: u32| {
        let direction = camera.direction([x, y], [0.5, 0.5]);
        world.closest_hit(ray(camera.eye, direction, [0.0, f32::INFINITY])).map(|hit| hit.instance)
    };
    let (mut probes, mut hits, mut same) = (0.0_f32, 0.0_f32, 0.0_f32);
    for y in (0..request.size[1]).step_by(PROBE_STEP as usize) {
        for x in (0..request.size[0]).step_by(PROBE_STEP as usize) {
            probes += 1.0;
            if let Some(instance) = probe(x, y) {
                hits += 1.0;
                same += f32::from(u8::from(probe(x + PARTNER_DISTANCE, y) == Some(instance)));
            }
        }
    }
    // In dense foliage too, up to half of the pairs may hit the same branch or the ground: only
    // what exceeds half counts.
    let large = (2.0 * same / hits.max(1.0) - 1.0).max(0.0);
    let budget = world.materials.quality.mean_samples() * math::lerp(1.0, LARGE_OBJECT_FACTOR, large * large);
    (budget * probes / hits.max(1.0)).clamp(min as f32, max as f32) as u32
}

/// A block of pixels that is rendered by one thread.
#[derive(Clone, Copy)]
struct Tile<'t, 'w> {
    world: &'t RenderScene<'w>,
    request: &'t RenderRequest,
    camera: &'t PerspectiveCamera,
    /// Height of the floor, m.
    floor: Option<f32>,
    /// Samples are few and objects small: pixels share their ambient light.
    dense_foliage: bool,
    /// Upper left pixel of the tile in the picture.
    corner: [u32; 2],
    size: TileSize,
}

impl Tile<'_, '_> {
    /// Position in the picture of pixel `i` of the tile.
    #[allow(clippy::cast_possible_truncation, reason = "a tile's pixels")]
    fn pixel_position(&self, i: usize) -> [u32; 2] {
        [self.corner[0] + (i % self.size.w) as u32, self.corner[1] + (i / self.size.w) as u32]
    }

    /// Adds samples to pixel `i` of the tile until it has `goal`.
    fn sample_pixel(&self, pixel: &mut PixelSamples, i: usize, goal: u32) {
        let position = self.pixel_position(i);
        let number = position[1].wrapping_mul(self.request.size[0]).wrapping_add(position[0]);
        // The pattern depends on the pixel, not on tile or thread.
        let sampler = Sampler::new(number, self.request.seed);
        while pixel.samples < goal {
            let samples_ambient = !self.dense_foliage || pixel.total().ambient_samples < DENSE_FOLIAGE_AMBIENT_SAMPLES;
            pixel.add(self.sample(&sampler, position, pixel.samples, samples_ambient));
        }
    }

    /// Traces sample `index` of a pixel. `samples_ambient`: whether a ray samples ambient light.
    fn sample(&self, sampler: &Sampler, position: [u32; 2], index: u32, samples_ambient: bool) -> SampleHit {
        let (world, light, camera) = (self.world, &self.request.light, self.camera);
        // Anti-aliasing: the samples of a pixel are spread over its square. A draft has a single
        // one, in the middle.
        let inside = if world.materials.quality == Quality::Draft { [0.5, 0.5] } else { sampler.point(index, 0) };
        let PrimaryRay { direction, floor_distance } = camera.primary_ray(self.floor, position, inside);
        let sample = SampleContext {
            sampler,
            index,
            spread: camera.spread,
            light_depth: world.materials.quality.light_depth(),
            samples_ambient,
            precomputed: None,
        };
        // The floor is opaque: objects below it are hidden.
        let far = floor_distance.unwrap_or(f32::INFINITY);
        if let Some(scattered) = world.radiance(light, camera.eye, direction, far, &sample) {
            return SampleHit::Object(scattered);
        }
        match floor_distance {
            Some(t) => {
                let above = camera.eye + direction * t + Vec3::Y * world.gap;
                SampleHit::Floor { light: world.floor_light(light, above, &sample) }
            }
            None => SampleHit::Background,
        }
    }

    /// Doubles the samples of noisy pixels until none is left, or `max_samples` are reached.
    fn sample_pixels(&self, max_samples: u32) -> Vec<PixelSamples> {
        let mut pixels = vec![PixelSamples::default(); self.size.len()];
        let SampleRange { min, tolerance, .. } = self.world.materials.quality.sample_range();
        let mut is_noisy = vec![true; pixels.len()];
        let mut goal = min;
        loop {
            for (i, pixel) in pixels.iter_mut().enumerate().filter(|(i, _)| is_noisy[*i]) {
                self.sample_pixel(pixel, i, goal);
            }
            if goal >= max_samples {
                return pixels;
            }
            // Doubling keeps whole prefixes of the Sobol sequence, which are evenly distributed.
            goal = (goal * 2).min(max_samples);
            is_noisy = noisy_pixels(&pixels, &self.shared_ambient(&pixels), self.size, tolerance);
        }
    }

    /// Mean ambient radiance around each pixel in dense foliage, `None` elsewhere. A few rays to the sky are noise,
    /// but what a leaf among leaves sees of the sky varies little from pixel to pixel, so a pixel takes the mean of
    /// the 5 x 5 pixels around it. Where one instance fills the 5 x 5 pixels, only 3 x 3 are averaged: widely
    /// filtered noise would show as blotches there.
    fn shared_ambient(&self, pixels: &[PixelSamples]) -> Vec<Option<Vec3>> {
        if !self.dense_foliage {
            return vec![None; pixels.len()];
        }
        let size = self.size;
        let total = |p: &PixelSamples| {
            let sums = p.total();
            AmbientSum { radiance: sums.ambient, samples: sums.ambient_samples }
        };
        let own: Vec<AmbientSum> = pixels.iter().map(total).collect();
        // A box filter of 3 x 3 pixels; applied twice it has 5 x 5 with more weight in the middle.
        let box_filter = |from: &[AmbientSum]| -> Vec<AmbientSum> {
            let sum = |i| size.neighbourhood(i).fold(AmbientSum::default(), |sum, k| sum.plus(from[k]));
            (0..from.len()).map(sum).collect()
        };
        let near = box_filter(&own);
        let far = box_filter(&near);
        let is_uniform = |i: usize| {
            let instance = pixels[i].instance;
            instance != MIXED_INSTANCES && size.neighbourhood(i).all(|k| pixels[k].instance == instance)
        };
        let is_uniform: Vec<bool> = (0..pixels.len()).map(is_uniform).collect();
        // Ratio of sums, not mean of ratios: pixels without an ambient sample carry no weight.
        let mean = |i: usize| {
            let sum = if size.neighbourhood(i).all(|k| is_uniform[k]) { near[i] } else { far[i] };
            (sum.samples > 0.0).then(|| sum.radiance / sum.samples)
        };
        (0..pixels.len()).map(mean).collect()
    }

    /// Samples and filters the pixels of the tile and composites them over the background; returns them row by row.
    fn render(&self, max_samples: u32) -> Vec<[u8; 4]> {
        let pixels = self.sample_pixels(max_samples);
        let ambient = self.shared_ambient(&pixels);
        // Averages first, then outliers among them, then the background behind them.
        let mut resolved: Vec<_> = pixels.iter().zip(ambient).map(|(p, a)| p.resolve(a)).collect();
        despeckle(&mut resolved, self.size);
        let finished = |(i, p)| composite(self.request, self.camera, self.pixel_position(i), p);
        resolved.into_iter().enumerate().map(finished).collect()
    }
}

/// Width and height of a tile, pixels; those at the right and lower edge of the picture may be smaller.
#[derive(Debug, Clone, Copy)]
struct TileSize {
    w: usize,
    h: usize,
}

impl TileSize {
    fn len(self) -> usize {
        self.w * self.h
    }

    /// A pixel and those of its eight neighbours that lie in the tile.
    fn neighbourhood(self, i: usize) -> impl Iterator<Item = usize> {
        let (x, y) = (i % self.w, i / self.w);
        let columns = x.saturating_sub(1)..=(x + 1).min(self.w - 1);
        let rows = y.saturating_sub(1)..=(y + 1).min(self.h - 1);
        rows.flat_map(move |v| columns.clone().map(move |u| v * self.w + u))
    }
}

/// Despeckling: if a pixel and all its neighbours are entirely covered or entirely uncovered, its colour and floor light are
/// clamped to the range of the neighbours, which distinguish small shadows from noise better than a few samples can.
fn despeckle(pixels: &mut [ForegroundPixel], size: TileSize) {
    let before = pixels.to_vec();
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let own = pixel.coverage;
        let is_alike = |k: usize| before[k].coverage >= 1.0 && own >= 1.0 || before[k].coverage <= 0.0 && own <= 0.0;
        let mut range: Option<[(Vec3, f32); 2]> = None;
        let mut all_alike = true;
        for k in size.neighbourhood(i).filter(|k| *k != i) {
            all_alike &= is_alike(k);
            let (c, o) = (before[k].color, before[k].floor_light);
            let [lo, hi] = range.unwrap_or([(c, o); 2]);
            range = Some([(lo.0.min(c), lo.1.min(o)), (hi.0.max(c), hi.1.max(o))]);
        }
        // Edges of objects keep their anti-aliasing: there coverage differs.
        if let Some([lo, hi]) = range.filter(|_| all_alike) {
            pixel.color = pixel.color.clamp(lo.0, hi.0);
            pixel.floor_light = pixel.floor_light.clamp(lo.1, hi.1);
        }
    }
}

/// Which pixels need more samples: those whose halves disagree on average over their neighbourhood. A single pixel of
/// few samples may agree by chance. `ambient`: shared ambient light of each pixel.
fn noisy_pixels(pixels: &[PixelSamples], ambient: &[Option<Vec3>], size: TileSize, tolerance: f32) -> Vec<bool> {
    let disagreements: Vec<f32> = pixels.iter().zip(ambient).map(|(p, a)| p.disagreement(*a)).collect();
    let mean = |i: usize| {
        let (sum, n) = size.neighbourhood(i).fold((0.0, 0.0), |(sum, n), k| (sum + disagreements[k], n + 1.0));
        sum / n
    };
    (0..pixels.len()).map(|i| mean(i) > tolerance).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::PreviewMaterials;
    use crate::testing::{material, object, scene_of};
    use crate::{Backdrop, Light};
    use osier_base::rng::Rng;
    use osier_scene::{Camera, Mesh, Scene};

    /// A thicket of tilted leaves.
    fn thicket() -> Scene {
        let mut rng = Rng::from_key(5);
        let mut mesh = Mesh::default();
        for _ in 0..6000 {
            let mut drawn = |r: f32| (rng.unit_f32() * 2.0 - 1.0) * r;
            let center = Vec3::new(drawn(1.0), drawn(1.0), drawn(1.0));
            let (u, v) = (Vec3::new(drawn(0.06), drawn(0.06), drawn(0.06)), Vec3::new(drawn(0.06), drawn(0.06), 0.02));
            let first = u32::try_from(mesh.points.len()).expect("few");
            mesh.points.extend([center - u - v, center + u - v, center + u + v, center - u + v]);
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        mesh.normals = vec![Vec3::ZERO; mesh.points.len()];
        let mut scene = scene_of(vec![material(0.5, 0.3, 1.4)]);
        scene.assets[0].meshes = vec![object("leaves", mesh.with_material(0))];
        scene.camera = Camera { eye: Vec3::Z * 5.0, target: Vec3::ZERO, vfov: 0.4, roll: 0.0 };
        scene
    }

    #[test]
    fn shared_ambient_keeps_the_mean_and_reduces_noise() {
        let scene = thicket();
        let materials = PreviewMaterials::new(&scene, Quality::Normal);
        let world = RenderScene::new(&scene, None, &materials);
        let request = RenderRequest {
            camera: scene.camera,
            size: [64, 64],
            light: Light::new(&scene.sun, &scene.sky),
            backdrop: Backdrop::Sky,
            seed: 1,
        };
        let camera = PerspectiveCamera::new(&request.camera, request.size);
        let (mut sums, mut errors, mut sky) = ([Vec3::ZERO; 2], [0.0_f32; 2], Vec3::ZERO);
        for corner in [[16, 16], [32, 16], [16, 32], [32, 32]] {
            let size = TileSize { w: 16, h: 16 };
            let tile = Tile {
                world: &world,
                request: &request,
                camera: &camera,
                floor: None,
                dense_foliage: true,
                corner,
                size,
            };
            let pixels = tile.sample_pixels(3);
            for (i, (pixel, ambient)) in pixels.iter().zip(tile.shared_ambient(&pixels)).enumerate() {
                let Some(ambient) = ambient.filter(|_| pixel.total().hits > 0.0) else { continue };
                let own = pixel.total();
                let shared = own.direct + own.diffuse * ambient;
                // Many ambient samples of the pixel itself, with the same light of the sun.
                let mut fine = PixelSamples::default();
                Tile { dense_foliage: false, ..tile }.sample_pixel(&mut fine, i, 96);
                let fine = fine.total();
                let meant = own.direct + own.diffuse * (fine.ambient / fine.ambient_samples.max(1.0));
                for (k, light) in [own.radiance, shared].into_iter().enumerate() {
                    sums[k] += light;
                    errors[k] += (light - meant).length_squared();
                }
                sky += own.radiance - own.direct;
            }
        }
        let [own, shared] = sums;
        assert!(sky.length() > 0.3 * own.length(), "little light of the sky proves nothing");
        assert!((shared - own).abs().max_element() < 0.02 * own.max_element(), "{shared} of {own}");
        assert!(errors[1] < 0.5 * errors[0], "errors {errors:?}");
    }
}
