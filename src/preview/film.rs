//! From rays to pixels: tiles in parallel, more samples where they still disagree.

use glam::Vec3;

use super::backdrop::Backdrop;
use super::light::{Care, Draw, Light};
use super::picture::Picture;
use super::sampler::Sampler;
use super::tone::{encode, film};
use super::world::World;
use crate::par::par_map;
use crate::progress::{Cancel, Progress};
use crate::scene::Camera;
use crate::{Error, Result, math};

/// Pixels along the side of a tile.
const TILE: u32 = 16;

/// How much work goes into a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// One look: to see the shape.
    Draft,
    /// For contact sheets and everyday use.
    Normal,
    /// For keeping.
    Fine,
}

impl Quality {
    /// Samples for every pixel of a crowded picture on average: what covers little may have more.
    fn budget(self) -> f32 {
        match self {
            Self::Draft => 1.0,
            Self::Normal => 3.0,
            Self::Fine => f32::INFINITY,
        }
    }

    /// Fewest and most samples a pixel, and the disagreement of shown values that asks for more.
    fn samples(self) -> (u32, u32, f32) {
        match self {
            Self::Draft => (1, 1, 1.0),
            Self::Normal => (3, 24, 0.05),
            Self::Fine => (32, 192, 0.008),
        }
    }

    fn care(self) -> Care {
        match self {
            Self::Draft => Care::Sun,
            Self::Normal => Care::Sky,
            Self::Fine => Care::Around,
        }
    }

    /// Widest picture on a surface that is read in full, pixels.
    pub fn texture_side(self) -> u32 {
        match self {
            Self::Draft => 256,
            Self::Normal => 512,
            Self::Fine => 4096,
        }
    }
}

/// One picture to take.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// Where from.
    pub camera: Camera,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// How well.
    pub quality: Quality,
    /// Light.
    pub light: Light,
    /// What lies behind and below.
    pub backdrop: Backdrop,
    /// Seed of the sample pattern.
    pub seed: u32,
}

/// Sums of one pixel's samples.
#[derive(Debug, Clone, Copy, Default)]
struct Pixel {
    /// Light of what was met, of even and of odd samples.
    halves: [Vec3; 2],
    met: [f32; 2],
    /// Light on the floor over the light on an open floor.
    floor: [f32; 2],
    samples: u32,
}

impl Pixel {
    fn take(&mut self, seen: Seen) {
        let half = usize::from(self.samples % 2 == 1);
        match seen {
            Seen::Thing(light) => {
                self.halves[half] += light;
                self.met[half] += 1.0;
            }
            Seen::Floor(share) => self.floor[half] += share,
            Seen::Nothing => self.floor[half] += 1.0,
        }
        self.samples += 1;
    }

    /// Shown colour of what was met and how much of the pixel it covers; brightness of the floor where nothing was met.
    fn develop(&self, halves: std::ops::Range<usize>) -> (Vec3, f32, f32) {
        let sum = |f: fn(&Self, usize) -> f32| halves.clone().fold(0.0, |s, i| s + f(self, i));
        let met = sum(|p, i| p.met[i]);
        let light = halves.clone().fold(Vec3::ZERO, |s, i| s + self.halves[i]);
        #[allow(clippy::cast_precision_loss, reason = "hundreds of samples")]
        let n = self.samples as f32 * if halves.len() == 2 { 1.0 } else { 0.5 };
        let color = if met > 0.0 { film(light / met) } else { Vec3::ZERO };
        let open = n - met;
        (color, (met / n.max(1.0)).min(1.0), if open > 0.0 { sum(|p, i| p.floor[i]) / open } else { 1.0 })
    }

    /// How far even and odd samples disagree in shown brightness.
    fn doubt(&self) -> f32 {
        let shown = |i: usize| {
            let (color, share, floor) = self.develop(i..i + 1);
            let c = color * share + Vec3::splat(0.6 * (1.0 - share) * floor);
            math::sqrt_f32(c.dot(Vec3::new(0.3, 0.5, 0.2)).max(0.0))
        };
        (shown(0) - shown(1)).abs()
    }
}

enum Seen {
    Thing(Vec3),
    Floor(f32),
    Nothing,
}

/// Takes a picture.
/// # Errors
/// `Cancelled`; `Range` for a size of zero or a camera that is not finite.
pub fn expose(world: &World<'_>, shot: &Shot, cancel: &Cancel, progress: &dyn Progress) -> Result<Picture> {
    let [width, height] = shot.size;
    if width == 0 || height == 0 {
        return Err(Error::Range {
            name: "size of a picture".into(),
            value: 0.0,
            min: 1.0,
            max: 65_535.0,
            unit: "pixels",
        });
    }
    let lens = Lens::new(&shot.camera, shot.size);
    if !lens.is_finite() {
        return Err(Error::export("P002", "the camera has no finite place or direction"));
    }
    let mut tiles = Vec::new();
    for y in (0..height).step_by(TILE as usize) {
        tiles.extend((0..width).step_by(TILE as usize).map(|x| [x, y]));
    }
    let floor = shot.backdrop.floor(world, &shot.light);
    let most = most_samples(world, shot, &lens);
    let develop = |corner: &[u32; 2]| {
        cancel.check()?;
        let pixels = tile(world, shot, (&lens, floor, most), *corner);
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

/// Samples that a pixel in doubt may have: the fewer things are in the picture, the more.
fn most_samples(world: &World<'_>, shot: &Shot, lens: &Lens) -> u32 {
    const STEP: u32 = 12;
    let (fewest, most, _) = shot.quality.samples();
    let (mut looks, mut met) = (0.0_f32, 0.0_f32);
    for y in (0..shot.size[1]).step_by(STEP as usize) {
        for x in (0..shot.size[0]).step_by(STEP as usize) {
            let look = super::world::ray(lens.eye, lens.direction([x, y], [0.5, 0.5]), [0.0, f32::INFINITY]);
            looks += 1.0;
            met += f32::from(u8::from(!world.lets_by(look)));
        }
    }
    let each = shot.quality.budget() * looks / met.max(1.0);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two small numbers")]
    let each = each.clamp(fewest as f32, most as f32) as u32;
    each
}

fn tile(
    world: &World<'_>,
    shot: &Shot,
    (lens, floor, most): (&Lens, Option<f32>, u32),
    corner: [u32; 2],
) -> Vec<[u8; 4]> {
    let [width, height] = shot.size;
    let (w, h) = (TILE.min(width - corner[0]), TILE.min(height - corner[1]));
    let mut pixels = vec![Pixel::default(); (w * h) as usize];
    let (fewest, _, limit) = shot.quality.samples();
    let mut wanted = vec![true; pixels.len()];
    let mut goal = fewest;
    loop {
        for (i, pixel) in (0_u32..).zip(&mut pixels).filter(|(i, _)| wanted[*i as usize]) {
            let place = [corner[0] + i % w, corner[1] + i / w];
            let sampler = Sampler::new(place[1].wrapping_mul(width).wrapping_add(place[0]), shot.seed);
            while pixel.samples < goal {
                let seen = look(world, shot, (lens, floor), (&sampler, place, pixel.samples));
                pixel.take(seen);
            }
        }
        if goal >= most {
            break;
        }
        goal = (goal * 2).min(most);
        wanted = doubtful(&pixels, w, limit);
    }
    let mut developed: Vec<(Vec3, f32, f32)> = pixels.iter().map(|p| p.develop(0..2)).collect();
    calm(&mut developed, w as usize);
    let shown = |(i, (color, share, open)): (u32, (Vec3, f32, f32))| {
        let place = [corner[0] + i % w, corner[1] + i / w];
        let (behind, covered) = shot.backdrop.behind(lens.direction(place, [0.5, 0.5]), lens.place(place), &shot.light);
        let hidden = 1.0 - share;
        match covered {
            true => encode(color * share + behind * open.min(1.0) * hidden, 1.0),
            false => {
                let shade = (1.0 - open).clamp(0.0, 1.0) * hidden;
                let alpha = share + shade;
                encode(if alpha > 0.0 { color * (share / alpha) } else { Vec3::ZERO }, alpha)
            }
        }
    };
    (0_u32..).zip(developed).map(shown).collect()
}

/// Takes back single specks: where a pixel and all its neighbours are wholly covered or wholly open, it stays within their
/// range. Few samples cannot tell a rare shadow from noise, the neighbours can.
fn calm(pixels: &mut [(Vec3, f32, f32)], w: usize) {
    let before = pixels.to_vec();
    let h = before.len() / w.max(1);
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let (x, y) = (i % w, i / w);
        let around = (y.saturating_sub(1)..=(y + 1).min(h - 1))
            .flat_map(|v| (x.saturating_sub(1)..=(x + 1).min(w - 1)).map(move |u| v * w + u))
            .filter(|k| *k != i);
        let own = pixel.1;
        let whole = |k: usize| before[k].1 >= 1.0 && own >= 1.0 || before[k].1 <= 0.0 && own <= 0.0;
        let mut range: Option<[(Vec3, f32); 2]> = None;
        let mut alike = true;
        for k in around {
            alike &= whole(k);
            let (c, o) = (before[k].0, before[k].2);
            let [lo, hi] = range.unwrap_or([(c, o); 2]);
            range = Some([(lo.0.min(c), lo.1.min(o)), (hi.0.max(c), hi.1.max(o))]);
        }
        if let Some([lo, hi]) = range.filter(|_| alike) {
            pixel.0 = pixel.0.clamp(lo.0, hi.0);
            pixel.2 = pixel.2.clamp(lo.1, hi.1);
        }
    }
}

/// Which pixels want more samples: those that are in doubt, or whose neighbours are.
fn doubtful(pixels: &[Pixel], w: u32, limit: f32) -> Vec<bool> {
    let doubts: Vec<f32> = pixels.iter().map(Pixel::doubt).collect();
    let w = w as usize;
    let h = pixels.len() / w.max(1);
    let mean = |i: usize| {
        let (x, y) = (i % w, i / w);
        let (mut sum, mut n) = (0.0, 0.0);
        for v in y.saturating_sub(1)..=(y + 1).min(h - 1) {
            for u in x.saturating_sub(1)..=(x + 1).min(w - 1) {
                sum += doubts[v * w + u];
                n += 1.0;
            }
        }
        sum / n
    };
    (0..pixels.len()).map(|i| mean(i) > limit).collect()
}

fn look(
    world: &World<'_>,
    shot: &Shot,
    (lens, floor): (&Lens, Option<f32>),
    (sampler, place, index): (&Sampler, [u32; 2], u32),
) -> Seen {
    let inside = if shot.quality == Quality::Draft { [0.5, 0.5] } else { sampler.point(index, 0) };
    let direction = lens.direction(place, inside);
    let draw = Draw { sampler, index, spread: lens.spread, care: shot.quality.care() };
    let sheet = floor.map(|y| (y - lens.eye.y) / direction.y).filter(|t| *t > 0.0 && t.is_finite());
    // What goes on below the paper is hidden by it.
    if let Some(light) = world.radiance(&shot.light, (lens.eye, direction), sheet.unwrap_or(f32::INFINITY), &draw) {
        return Seen::Thing(light);
    }
    match sheet {
        Some(t) => Seen::Floor(world.floor_light(&shot.light, lens.eye + direction * t, &draw)),
        None => Seen::Nothing,
    }
}

/// A camera with a picture's shape.
#[derive(Debug, Clone, Copy)]
struct Lens {
    eye: Vec3,
    /// Picture plane at unit distance: its upper left corner, and steps of a pixel to the right and down.
    corner: Vec3,
    right: Vec3,
    down: Vec3,
    /// Width of a pixel at unit distance.
    spread: f32,
    size: [f32; 2],
}

impl Lens {
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    fn new(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let [right, up, back] = camera.axes();
        let (w, h) = (width as f32, height as f32);
        let half = math::tan_f32(camera.vfov * 0.5);
        let pixel = 2.0 * half / h;
        let corner = up * half - right * (half * w / h) - back;
        Self { eye: camera.eye, corner, right: right * pixel, down: -up * pixel, spread: pixel, size: [w, h] }
    }

    fn is_finite(&self) -> bool {
        [self.eye, self.corner, self.right, self.down].iter().all(|v| v.is_finite())
    }

    /// Unit direction through a pixel. `inside`: place in the pixel, 0..1 from its upper left corner.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    fn direction(&self, [x, y]: [u32; 2], inside: [f32; 2]) -> Vec3 {
        let d = self.corner + self.right * (x as f32 + inside[0]) + self.down * (y as f32 + inside[1]);
        math::normalize_or(d, -Vec3::Z)
    }

    /// Place in the picture, 0..1 from its upper left corner.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    fn place(&self, [x, y]: [u32; 2]) -> [f32; 2] {
        [(x as f32 + 0.5) / self.size[0], (y as f32 + 0.5) / self.size[1]]
    }
}
