//! Adaptive sampling: tiles in parallel, more samples for pixels whose half sums still disagree.

use glam::Vec3;

use super::backdrop::Backdrop;
use super::draft;
use super::lens::Lens;
use super::light::{Light, SampleContext, Scattered};
use super::picture::Picture;
use super::quality::Quality;
use super::sampler::Sampler;
use super::tone::{encode, film};
use super::world::{World, ray};
use osier_base::par::par_map;
use osier_base::progress::{Cancel, Progress};
use osier_base::{Error, Result, math};
use osier_scene::Camera;

/// Pixels along the side of a tile.
pub(super) const TILE: u32 = 16;

/// Pictures with at most this many samples per pixel are treated as dense foliage, whose pixels share their ambient light.
const DENSE_FOLIAGE_SAMPLES: u32 = 8;

/// What to render: camera, resolution, light, backdrop and seed of one picture.
#[derive(Debug, Clone, Copy)]
pub struct RenderRequest {
    /// Position and direction of view, vertical field of view in radians.
    pub camera: Camera,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Sun and sky of the scene.
    pub light: Light,
    /// What lies behind and below.
    pub backdrop: Backdrop,
    /// Seed of the sample pattern.
    pub seed: u32,
}

/// Sums of one pixel's samples.
#[derive(Debug, Clone, Copy, Default)]
struct PixelSamples {
    /// Of even and of odd samples.
    halves: [SampleSums; 2],
    samples: u32,
    /// What all samples saw, or [`MIXED`].
    thing: u32,
}

/// Numbers that no showing has.
const NOTHING: u32 = u32::MAX;
const MIXED: u32 = u32::MAX - 1;

/// Sums of half of a pixel's samples.
#[derive(Debug, Clone, Copy, Default)]
struct SampleSums {
    /// Radiance of what was met.
    whole: Vec3,
    /// The same in parts, for a pixel that shares what it sees around: what is no light from around, and the share that is
    /// sent on of that.
    direct: Vec3,
    matt: Vec3,
    around: Vec3,
    /// Looks at what is around.
    looks: f32,
    /// Samples that met something.
    met: f32,
    /// Light on the floor over the light on an open floor.
    floor: f32,
}

impl SampleSums {
    fn of(sent: &Scattered) -> Self {
        let Scattered { direct, matt, around, looks, .. } = *sent;
        Self { whole: sent.whole(), direct, matt, around, looks, met: 1.0, floor: 0.0 }
    }

    fn and(self, other: Self) -> Self {
        Self {
            whole: self.whole + other.whole,
            direct: self.direct + other.direct,
            matt: self.matt + other.matt,
            around: self.around + other.around,
            looks: self.looks + other.looks,
            met: self.met + other.met,
            floor: self.floor + other.floor,
        }
    }

    /// The pixel that `n` samples saw. `around`: ambient light, if it is shared with other pixels.
    fn seen(&self, n: f32, around: Option<Vec3>) -> ForegroundPixel {
        let light = around.map_or(self.whole, |around| self.direct + self.matt * around) / self.met.max(1.0);
        let open = n - self.met;
        ForegroundPixel {
            color: film(light),
            coverage: (self.met / n.max(1.0)).min(1.0),
            floor_light: if open > 0.0 { self.floor / open } else { 1.0 },
        }
    }
}

impl PixelSamples {
    fn take(&mut self, seen: SampleHit) {
        let thing = if let SampleHit::Thing(sent) = &seen { sent.showing } else { NOTHING };
        self.thing = if self.samples == 0 || self.thing == thing { thing } else { MIXED };
        let half = &mut self.halves[usize::from(self.samples % 2 == 1)];
        match seen {
            SampleHit::Thing(sent) => *half = half.and(SampleSums::of(&sent)),
            SampleHit::Floor(share) => half.floor += share,
            SampleHit::Nothing => half.floor += 1.0,
        }
        self.samples += 1;
    }

    fn whole(&self) -> SampleSums {
        self.halves[0].and(self.halves[1])
    }

    /// The pixel in front of its background.
    #[allow(clippy::cast_precision_loss, reason = "hundreds of samples")]
    fn develop(&self, around: Option<Vec3>) -> ForegroundPixel {
        self.whole().seen(self.samples as f32, around)
    }

    /// How far even and odd samples disagree in shown brightness. `around`: light around both, if it is known.
    #[allow(clippy::cast_precision_loss, reason = "hundreds of samples")]
    fn doubt(&self, around: Option<Vec3>) -> f32 {
        let shown = |i: usize| {
            let ForegroundPixel { color, coverage: share, floor_light: floor } =
                self.halves[i].seen(self.samples as f32 * 0.5, around);
            let c = color * share + Vec3::splat(0.6 * (1.0 - share) * floor);
            math::sqrt_f32(c.dot(Vec3::new(0.3, 0.5, 0.2)).max(0.0))
        };
        (shown(0) - shown(1)).abs()
    }
}

/// A pixel before it is composited over its background.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ForegroundPixel {
    /// Tone-mapped colour of the objects in it.
    pub color: Vec3,
    /// Fraction of the pixel that objects cover, 0 to 1.
    pub coverage: f32,
    /// Light on the visible part of the floor relative to a floor without shadow, 0 to 1.
    pub floor_light: f32,
}

enum SampleHit {
    Thing(Scattered),
    Floor(f32),
    Nothing,
}

/// Renders a picture.
/// # Errors
/// `Cancelled`; `Range` for a size of zero; P002 for a camera that is not finite.
pub fn render(world: &World<'_>, request: &RenderRequest, cancel: &Cancel, progress: &dyn Progress) -> Result<Picture> {
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
    let lens = Lens::new(&request.camera, request.size);
    if !lens.is_finite() {
        return Err(Error::export("P002", "the camera has no finite place or direction"));
    }
    if !world.boxed {
        return draft::render(world, request, &lens, cancel, progress);
    }
    let mut tiles = Vec::new();
    for y in (0..height).step_by(TILE as usize) {
        tiles.extend((0..width).step_by(TILE as usize).map(|x| [x, y]));
    }
    let floor = request.backdrop.floor(world);
    let most = most_samples(world, request, &lens);
    let dense_foliage = world.looks.quality.smooths() && most <= DENSE_FOLIAGE_SAMPLES;
    let develop = |corner: &[u32; 2]| {
        cancel.check()?;
        let [w, h] = [0, 1].map(|k| TILE.min(request.size[k] - corner[k]) as usize);
        let tile = Tile { world, request, lens: &lens, floor, dense_foliage, corner: *corner, grid: TileGrid { w, h } };
        let pixels = tile.developed(most);
        progress.advance(1);
        Ok(pixels)
    };
    let done: Vec<Result<Vec<[u8; 4]>>> = par_map(&tiles, develop);
    let mut picture = Picture::new(width, height);
    for (corner, pixels) in tiles.iter().zip(done) {
        picture.put_block(*corner, TILE.min(width - corner[0]), &pixels?);
    }
    Ok(picture)
}

/// Number of tiles of a picture, for progress.
pub fn tiles([width, height]: [u32; 2]) -> u64 {
    u64::from(width.div_ceil(TILE)) * u64::from(height.div_ceil(TILE))
}

/// Samples that a pixel in doubt may have: the more, the fewer things are in the picture and the larger they are in it.
/// What is seen from afar hides its grain among its leaves; a leaf that fills the picture shows it.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two small numbers")]
fn most_samples(world: &World<'_>, request: &RenderRequest, lens: &Lens) -> u32 {
    const STEP: u32 = 12;
    /// Pixels between two looks that may meet the same thing.
    const APART: u32 = 8;
    /// Times the budget where all that is seen is large.
    const SMOOTH: f32 = 9.0;
    let (fewest, most, _) = world.looks.quality.samples();
    if fewest == most {
        return most;
    }
    let met = |x: u32, y: u32| {
        let look = ray(lens.eye, lens.direction([x, y], [0.5, 0.5]), [0.0, f32::INFINITY]);
        world.nearest(look).map(|hit| hit.showing)
    };
    let (mut looks, mut things, mut same) = (0.0_f32, 0.0_f32, 0.0_f32);
    for y in (0..request.size[1]).step_by(STEP as usize) {
        for x in (0..request.size[0]).step_by(STEP as usize) {
            looks += 1.0;
            if let Some(thing) = met(x, y) {
                things += 1.0;
                same += f32::from(u8::from(met(x + APART, y) == Some(thing)));
            }
        }
    }
    // SampleSums of a crowd's looks may fall on its boughs and on the ground.
    let large = (2.0 * same / things.max(1.0) - 1.0).max(0.0);
    let budget = world.looks.quality.budget() * math::lerp(1.0, SMOOTH, large * large);
    (budget * looks / things.max(1.0)).clamp(fewest as f32, most as f32) as u32
}

/// A block of pixels at work.
#[derive(Clone, Copy)]
struct Tile<'t, 'w> {
    world: &'t World<'w>,
    request: &'t RenderRequest,
    lens: &'t Lens,
    /// Height of the floor.
    floor: Option<f32>,
    /// Looks are few and what is seen is small.
    dense_foliage: bool,
    /// Upper left pixel.
    corner: [u32; 2],
    grid: TileGrid,
}

impl Tile<'_, '_> {
    /// Place in the picture of a pixel.
    #[allow(clippy::cast_possible_truncation, reason = "a tile's pixels")]
    fn place(&self, i: usize) -> [u32; 2] {
        [self.corner[0] + (i % self.grid.w) as u32, self.corner[1] + (i / self.grid.w) as u32]
    }

    /// Adds looks through a pixel until it has `goal`.
    fn render(&self, pixel: &mut PixelSamples, i: usize, goal: u32) {
        let place = self.place(i);
        let number = place[1].wrapping_mul(self.request.size[0]).wrapping_add(place[0]);
        let sampler = Sampler::new(number, self.request.seed);
        while pixel.samples < goal {
            // Three looks will do in a crowd, as its pixels share them.
            let around = !self.dense_foliage || pixel.whole().looks < 3.0;
            pixel.take(self.look(&sampler, place, pixel.samples, around));
        }
    }

    /// What one sample sees. `around`: looks for the light around it, too.
    fn look(&self, sampler: &Sampler, place: [u32; 2], index: u32, around: bool) -> SampleHit {
        let (world, light, lens) = (self.world, &self.request.light, self.lens);
        let inside = if world.looks.quality == Quality::Draft { [0.5, 0.5] } else { sampler.point(index, 0) };
        let (direction, sheet) = lens.aim(self.floor, place, inside);
        let draw = SampleContext {
            sampler,
            index,
            spread: lens.spread,
            light_depth: world.looks.quality.light_depth(),
            around,
            known: None,
        };
        // What goes on below the paper is hidden by it.
        if let Some(sent) = world.radiance(light, lens.eye, direction, sheet.unwrap_or(f32::INFINITY), &draw) {
            return SampleHit::Thing(sent);
        }
        match sheet {
            Some(t) => {
                SampleHit::Floor(world.floor_light(light, lens.eye + direction * t + Vec3::Y * world.gap, &draw))
            }
            None => SampleHit::Nothing,
        }
    }

    /// Looks until no pixel is in doubt, at most `most` times through each.
    fn looked(&self, most: u32) -> Vec<PixelSamples> {
        let mut pixels = vec![PixelSamples::default(); self.grid.len()];
        let (fewest, _, limit) = self.world.looks.quality.samples();
        let mut wanted = vec![true; pixels.len()];
        let mut goal = fewest;
        loop {
            for (i, pixel) in pixels.iter_mut().enumerate().filter(|(i, _)| wanted[*i]) {
                self.render(pixel, i, goal);
            }
            if goal >= most {
                return pixels;
            }
            goal = (goal * 2).min(most);
            wanted = doubtful(&pixels, &self.around(&pixels), self.grid, limit);
        }
    }

    /// Light around what each pixel shows in a crowd, from what it and those about it saw: few looks into the sky are noise, and
    /// what a leaf among leaves sees of it changes little from one to the next. Where one thing fills the surroundings only the
    /// nearest are asked: there noise spread wide would show as stains.
    fn around(&self, pixels: &[PixelSamples]) -> Vec<Option<Vec3>> {
        if !self.dense_foliage {
            return vec![None; pixels.len()];
        }
        let grid = self.grid;
        let own: Vec<(Vec3, f32)> = pixels.iter().map(PixelSamples::whole).map(|p| (p.around, p.looks)).collect();
        let summed = |from: &[(Vec3, f32)]| -> Vec<(Vec3, f32)> {
            let sum = |i| grid.around(i).fold((Vec3::ZERO, 0.0), |(light, n), k| (light + from[k].0, n + from[k].1));
            (0..from.len()).map(sum).collect()
        };
        let near = summed(&own);
        let far = summed(&near);
        let whole = |i: usize| pixels[i].thing != MIXED && grid.around(i).all(|k| pixels[k].thing == pixels[i].thing);
        let whole: Vec<bool> = (0..pixels.len()).map(whole).collect();
        let mean = |i: usize| {
            let (light, looks) = if grid.around(i).all(|k| whole[k]) { near[i] } else { far[i] };
            (looks > 0.0).then(|| light / looks)
        };
        (0..pixels.len()).map(mean).collect()
    }

    /// The finished pixels.
    fn developed(&self, most: u32) -> Vec<[u8; 4]> {
        let pixels = self.looked(most);
        let around = self.around(&pixels);
        let mut developed: Vec<_> = pixels.iter().zip(around).map(|(p, a)| p.develop(a)).collect();
        despeckle(&mut developed, self.grid);
        developed.into_iter().enumerate().map(|(i, d)| finish(self.request, self.lens, self.place(i), d)).collect()
    }
}

/// Composites a pixel over its background and encodes it as sRGB and alpha.
pub(super) fn finish(request: &RenderRequest, lens: &Lens, place: [u32; 2], pixel: ForegroundPixel) -> [u8; 4] {
    let ForegroundPixel { color, coverage: share, floor_light: open } = pixel;
    let hidden = 1.0 - share;
    if hidden <= 0.0 {
        return encode(color, 1.0);
    }
    let direction = lens.direction(place, [0.5, 0.5]);
    let (behind, covered) = request.backdrop.behind(direction, lens.place(place), &request.light);
    if covered {
        return encode(color * share + behind * open.min(1.0) * hidden, 1.0);
    }
    let shade = (1.0 - open).clamp(0.0, 1.0) * hidden;
    let alpha = share + shade;
    encode(if alpha > 0.0 { color * (share / alpha) } else { Vec3::ZERO }, alpha)
}

/// Width and height of a tile, pixels.
#[derive(Debug, Clone, Copy)]
struct TileGrid {
    w: usize,
    h: usize,
}

impl TileGrid {
    fn len(self) -> usize {
        self.w * self.h
    }

    /// A pixel and all that touch it.
    fn around(self, i: usize) -> impl Iterator<Item = usize> {
        let (x, y) = (i % self.w, i / self.w);
        let columns = x.saturating_sub(1)..=(x + 1).min(self.w - 1);
        let rows = y.saturating_sub(1)..=(y + 1).min(self.h - 1);
        rows.flat_map(move |v| columns.clone().map(move |u| v * self.w + u))
    }
}

/// Takes back single specks: where a pixel and all its neighbours are wholly covered or wholly open, it stays within their
/// range. Few samples cannot tell a rare shadow from noise, the neighbours can.
fn despeckle(pixels: &mut [ForegroundPixel], grid: TileGrid) {
    let before = pixels.to_vec();
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let own = pixel.coverage;
        let whole = |k: usize| before[k].coverage >= 1.0 && own >= 1.0 || before[k].coverage <= 0.0 && own <= 0.0;
        let mut range: Option<[(Vec3, f32); 2]> = None;
        let mut alike = true;
        for k in grid.around(i).filter(|k| *k != i) {
            alike &= whole(k);
            let (c, o) = (before[k].color, before[k].floor_light);
            let [lo, hi] = range.unwrap_or([(c, o); 2]);
            range = Some([(lo.0.min(c), lo.1.min(o)), (hi.0.max(c), hi.1.max(o))]);
        }
        if let Some([lo, hi]) = range.filter(|_| alike) {
            pixel.color = pixel.color.clamp(lo.0, hi.0);
            pixel.floor_light = pixel.floor_light.clamp(lo.1, hi.1);
        }
    }
}

/// Which pixels want more samples: those that are in doubt, or whose neighbours are.
fn doubtful(pixels: &[PixelSamples], around: &[Option<Vec3>], grid: TileGrid, limit: f32) -> Vec<bool> {
    let doubts: Vec<f32> = pixels.iter().zip(around).map(|(p, a)| p.doubt(*a)).collect();
    let mean = |i: usize| {
        let (sum, n) = grid.around(i).fold((0.0, 0.0), |(sum, n), k| (sum + doubts[k], n + 1.0));
        sum / n
    };
    (0..pixels.len()).map(|i| mean(i) > limit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::looks::Looks;
    use crate::testing::{material, object, scene_of};
    use osier_base::rng::Rng;
    use osier_scene::{Mesh, Scene};

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
    fn pixels_that_share_the_sky_keep_its_mean_and_lose_its_noise() {
        let scene = thicket();
        let looks = Looks::new(&scene, Quality::Normal);
        let world = World::new(&scene, None, &looks);
        let request = RenderRequest {
            camera: scene.camera,
            size: [64, 64],
            light: Light::new(&scene.sun, &scene.sky),
            backdrop: Backdrop::Sky,
            seed: 1,
        };
        let lens = Lens::new(&request.camera, request.size);
        let (mut sums, mut errors, mut sky) = ([Vec3::ZERO; 2], [0.0_f32; 2], Vec3::ZERO);
        for corner in [[16, 16], [32, 16], [16, 32], [32, 32]] {
            let grid = TileGrid { w: 16, h: 16 };
            let tile =
                Tile { world: &world, request: &request, lens: &lens, floor: None, dense_foliage: true, corner, grid };
            let pixels = tile.looked(3);
            for (i, (pixel, around)) in pixels.iter().zip(tile.around(&pixels)).enumerate() {
                let Some(around) = around.filter(|_| pixel.whole().met > 0.0) else { continue };
                let own = pixel.whole();
                let shared = own.direct + own.matt * around;
                // What many looks of one's own would show, with the same light of the sun.
                let mut fine = PixelSamples::default();
                Tile { dense_foliage: false, ..tile }.render(&mut fine, i, 96);
                let fine = fine.whole();
                let meant = own.direct + own.matt * (fine.around / fine.looks.max(1.0));
                for (k, light) in [own.whole, shared].into_iter().enumerate() {
                    sums[k] += light;
                    errors[k] += (light - meant).length_squared();
                }
                sky += own.whole - own.direct;
            }
        }
        let [own, shared] = sums;
        assert!(sky.length() > 0.3 * own.length(), "little light of the sky proves nothing");
        assert!((shared - own).abs().max_element() < 0.02 * own.max_element(), "{shared} of {own}");
        assert!(errors[1] < 0.5 * errors[0], "errors {errors:?}");
    }
}
