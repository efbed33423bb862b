//! From rays to pixels: tiles in parallel, more samples where they still disagree.

use glam::Vec3;

use super::backdrop::Backdrop;
use super::draft;
use super::lens::Lens;
use super::light::{Draw, Light};
use super::picture::Picture;
use super::quality::Quality;
use super::sampler::Sampler;
use super::tone::{encode, film};
use super::world::{World, ray};
use crate::par::par_map;
use crate::progress::{Cancel, Progress};
use crate::scene::Camera;
use crate::{Error, Result, math};

/// Pixels along the side of a tile.
pub(super) const TILE: u32 = 16;

/// One picture to take.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// Where from.
    pub camera: Camera,
    /// Width and height, pixels.
    pub size: [u32; 2],
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
/// `Cancelled`; `Range` for a size of zero; P002 for a camera that is not finite.
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
    if !world.boxed {
        return draft::expose(world, shot, &lens, cancel, progress);
    }
    let mut tiles = Vec::new();
    for y in (0..height).step_by(TILE as usize) {
        tiles.extend((0..width).step_by(TILE as usize).map(|x| [x, y]));
    }
    let floor = shot.backdrop.floor(world);
    let most = most_samples(world, shot, &lens);
    let develop = |corner: &[u32; 2]| {
        cancel.check()?;
        let [w, h] = [0, 1].map(|k| TILE.min(shot.size[k] - corner[k]) as usize);
        let tile = Tile { world, shot, lens: &lens, floor, corner: *corner, grid: Grid { w, h } };
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
fn most_samples(world: &World<'_>, shot: &Shot, lens: &Lens) -> u32 {
    const STEP: u32 = 12;
    /// Pixels between two looks that may meet the same thing.
    const APART: u32 = 8;
    /// Times the budget where all that is seen is large.
    const SMOOTH: f32 = 6.0;
    let (fewest, most, _) = world.looks.quality.samples();
    if fewest == most {
        return most;
    }
    let met = |x: u32, y: u32| {
        let look = ray(lens.eye, lens.direction([x, y], [0.5, 0.5]), [0.0, f32::INFINITY]);
        world.nearest(look).map(|hit| hit.showing)
    };
    let (mut looks, mut things, mut same) = (0.0_f32, 0.0_f32, 0.0_f32);
    for y in (0..shot.size[1]).step_by(STEP as usize) {
        for x in (0..shot.size[0]).step_by(STEP as usize) {
            looks += 1.0;
            if let Some(thing) = met(x, y) {
                things += 1.0;
                same += f32::from(u8::from(met(x + APART, y) == Some(thing)));
            }
        }
    }
    // Half of a crowd's looks may fall on its boughs and on the ground.
    let large = (2.0 * same / things.max(1.0) - 1.0).max(0.0);
    let budget = world.looks.quality.budget() * math::lerp(1.0, SMOOTH, large * large);
    (budget * looks / things.max(1.0)).clamp(fewest as f32, most as f32) as u32
}

/// A block of pixels at work.
struct Tile<'t, 'w> {
    world: &'t World<'w>,
    shot: &'t Shot,
    lens: &'t Lens,
    /// Height of the floor.
    floor: Option<f32>,
    /// Upper left pixel.
    corner: [u32; 2],
    grid: Grid,
}

impl Tile<'_, '_> {
    /// Place in the picture of a pixel.
    #[allow(clippy::cast_possible_truncation, reason = "a tile's pixels")]
    fn place(&self, i: usize) -> [u32; 2] {
        [self.corner[0] + (i % self.grid.w) as u32, self.corner[1] + (i / self.grid.w) as u32]
    }

    /// Adds looks through a pixel until it has `goal`.
    fn expose(&self, pixel: &mut Pixel, i: usize, goal: u32) {
        let place = self.place(i);
        let number = place[1].wrapping_mul(self.shot.size[0]).wrapping_add(place[0]);
        let sampler = Sampler::new(number, self.shot.seed);
        while pixel.samples < goal {
            let seen = look(self.world, self.shot, (self.lens, self.floor), (&sampler, place, pixel.samples));
            pixel.take(seen);
        }
    }

    /// Looks until no pixel is in doubt, at most `most` times through each.
    fn looked(&self, most: u32) -> Vec<Pixel> {
        let mut pixels = vec![Pixel::default(); self.grid.len()];
        let (fewest, _, limit) = self.world.looks.quality.samples();
        let mut wanted = vec![true; pixels.len()];
        let mut goal = fewest;
        loop {
            for (i, pixel) in pixels.iter_mut().enumerate().filter(|(i, _)| wanted[*i]) {
                self.expose(pixel, i, goal);
            }
            if goal >= most {
                return pixels;
            }
            goal = (goal * 2).min(most);
            wanted = doubtful(&pixels, self.grid, limit);
        }
    }

    /// The finished pixels.
    fn developed(&self, most: u32) -> Vec<[u8; 4]> {
        let mut developed: Vec<(Vec3, f32, f32)> = self.looked(most).iter().map(|p| p.develop(0..2)).collect();
        calm(&mut developed, self.grid);
        developed.into_iter().enumerate().map(|(i, d)| finish(self.shot, self.lens, self.place(i), d)).collect()
    }
}

/// A pixel before its background. `color`: as it is shown; `share`: of the pixel that it covers; `open`: light on what is
/// seen of the floor, 1 for all.
pub(super) fn finish(shot: &Shot, lens: &Lens, place: [u32; 2], (color, share, open): (Vec3, f32, f32)) -> [u8; 4] {
    let hidden = 1.0 - share;
    if hidden <= 0.0 {
        return encode(color, 1.0);
    }
    let direction = lens.direction(place, [0.5, 0.5]);
    let (behind, covered) = shot.backdrop.behind(direction, lens.place(place), &shot.light);
    if covered {
        return encode(color * share + behind * open.min(1.0) * hidden, 1.0);
    }
    let shade = (1.0 - open).clamp(0.0, 1.0) * hidden;
    let alpha = share + shade;
    encode(if alpha > 0.0 { color * (share / alpha) } else { Vec3::ZERO }, alpha)
}

/// Width and height of a tile, pixels.
#[derive(Debug, Clone, Copy)]
struct Grid {
    w: usize,
    h: usize,
}

impl Grid {
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
fn calm(pixels: &mut [(Vec3, f32, f32)], grid: Grid) {
    let before = pixels.to_vec();
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let own = pixel.1;
        let whole = |k: usize| before[k].1 >= 1.0 && own >= 1.0 || before[k].1 <= 0.0 && own <= 0.0;
        let mut range: Option<[(Vec3, f32); 2]> = None;
        let mut alike = true;
        for k in grid.around(i).filter(|k| *k != i) {
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
fn doubtful(pixels: &[Pixel], grid: Grid, limit: f32) -> Vec<bool> {
    let doubts: Vec<f32> = pixels.iter().map(Pixel::doubt).collect();
    let mean = |i: usize| {
        let (sum, n) = grid.around(i).fold((0.0, 0.0), |(sum, n), k| (sum + doubts[k], n + 1.0));
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
    let inside = if world.looks.quality == Quality::Draft { [0.5, 0.5] } else { sampler.point(index, 0) };
    let (direction, sheet) = lens.aim(floor, place, inside);
    let draw = Draw { sampler, index, spread: lens.spread, care: world.looks.quality.care(), known: None };
    // What goes on below the paper is hidden by it.
    if let Some(light) = world.radiance(&shot.light, (lens.eye, direction), sheet.unwrap_or(f32::INFINITY), &draw) {
        return Seen::Thing(light);
    }
    match sheet {
        Some(t) => Seen::Floor(world.floor_light(&shot.light, lens.eye + direction * t + Vec3::Y * world.gap, &draw)),
        None => Seen::Nothing,
    }
}
