//! Drafts: everything is projected onto the pixels, then onto the light; no ray is cast and nothing sorted into boxes.
//!
//! One look a pixel: [`eye`] finds what it shows, [`sunlit`] whether the sun reaches it, [`openness`] how much of the sky
//! does; colours and tones are made as for rays.

mod eye;
mod openness;
mod project;
mod sunlit;
mod tasks;

use glam::Vec3;

use self::eye::{Band, Eye};
use self::openness::Openness;
use self::tasks::Tasks;
use super::film::{ForegroundPixel, RenderRequest, TILE, finish};
use super::lens::Lens;
use super::light::{LightDepth, PrecomputedLight, SampleContext};
use super::picture::Picture;
use super::sampler::Sampler;
use super::tone::film;
use super::world::{Hit, World};
use osier_base::Result;
use osier_base::par::{join, par_map};
use osier_base::progress::{Cancel, Progress};

/// Pixels that are held at a time.
const HELD: u32 = 1 << 22;

/// Takes a draft. The world has no more primitives than 32 bits count.
/// # Errors
/// `Cancelled`.
pub(super) fn render(
    world: &World<'_>,
    request: &RenderRequest,
    lens: &Lens,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Picture> {
    let [width, height] = request.size;
    let draft = Draft::new(world, request, lens);
    let rows = (HELD / width.max(1) / TILE).max(1) * TILE;
    let bands: Vec<Band> =
        (0..height).step_by(rows as usize).map(|top| Band { top, size: [width, rows.min(height - top)] }).collect();
    let mut picture = Picture::new(width, height);
    let mut openness = None;
    for band in bands {
        let seen = match openness {
            Some(_) => draft.seen_in(band, cancel)?,
            None => {
                let (seen, open) = join(|| draft.seen_in(band, cancel), || Openness::new(world));
                openness = Some(open);
                seen?
            }
        };
        let Some(openness) = &openness else { continue };
        picture.put_block([0, band.top], width, &draft.developed(band, &seen, openness));
        progress.advance(super::film::tiles(band.size));
    }
    Ok(picture)
}

/// A draft at work.
struct Draft<'d, 'w> {
    world: &'d World<'w>,
    request: &'d RenderRequest,
    lens: &'d Lens,
    /// Height of the floor.
    floor: Option<f32>,
    tasks: Tasks,
}

/// What some rows show.
struct Rows {
    seen: Vec<Vec<PixelHit>>,
    places: Vec<Vec<Vec3>>,
    /// True where the sun is seen.
    lit: Vec<bool>,
}

/// What a pixel shows.
#[derive(Clone, Copy)]
enum PixelHit {
    Thing(Hit),
    Floor,
    Nothing,
}

impl<'d, 'w> Draft<'d, 'w> {
    fn new(world: &'d World<'w>, request: &'d RenderRequest, lens: &'d Lens) -> Self {
        Self { world, request, lens, floor: request.backdrop.floor(world), tasks: Tasks::new(world) }
    }

    /// What some rows show, and whether the sun reaches it.
    fn seen_in(&self, band: Band, cancel: &Cancel) -> Result<Rows> {
        cancel.check()?;
        let eye = Eye::new(self.world, self.lens, band, &self.tasks);
        cancel.check()?;
        let width = band.size[0] as usize;
        let rows: Vec<usize> = (0..band.size[1] as usize).collect();
        let row = |y: &usize| (y * width..(y + 1) * width).map(|i| self.seen(&eye, band, i)).unzip();
        let (seen, places): (Vec<Vec<PixelHit>>, Vec<Vec<Vec3>>) = par_map(&rows, row).into_iter().unzip();
        let lit = sunlit::sunlit(self.world, self.request.light.direction(), &places, &self.tasks);
        cancel.check()?;
        Ok(Rows { seen, places, lit })
    }

    /// Finished pixels of some rows.
    fn developed(&self, band: Band, rows: &Rows, openness: &Openness) -> Vec<[u8; 4]> {
        let width = band.size[0] as usize;
        let shaded = |y: &usize| -> Vec<[u8; 4]> {
            let things = rows.seen[*y].iter().zip(&rows.places[*y]).zip(y * width..);
            let one = |((seen, p), i): ((&PixelHit, &Vec3), usize)| {
                self.shaded(band.place(i), seen, *p, PrecomputedLight { sun: rows.lit[i], sky: openness.at(*p) })
            };
            things.map(one).collect()
        };
        let numbers: Vec<usize> = (0..band.size[1] as usize).collect();
        par_map(&numbers, shaded).concat()
    }

    /// What pixel `i` of a band shows, and from where it looks for light.
    fn seen(&self, eye: &Eye<'_>, band: Band, i: usize) -> (PixelHit, Vec3) {
        let (d, sheet) = self.lens.aim(self.floor, band.place(i), [0.5, 0.5]);
        let o = self.lens.eye;
        let far = sheet.unwrap_or(f32::INFINITY);
        // What goes on below the paper is hidden by it.
        match (eye.hit(self.world, i, o, d, &self.tasks.starts), sheet) {
            (Some(hit), _) if hit.spot.t <= far => {
                let n = self.world.facing(&hit, o + d * hit.spot.t);
                let side = if n.dot(self.request.light.direction()) > 0.0 { self.world.gap } else { -self.world.gap };
                (PixelHit::Thing(hit), o + d * hit.spot.t + n * side)
            }
            (_, Some(t)) => (PixelHit::Floor, o + d * t + Vec3::Y * self.world.gap),
            _ => (PixelHit::Nothing, Vec3::NAN),
        }
    }

    fn shaded(&self, place: [u32; 2], seen: &PixelHit, p: Vec3, known: PrecomputedLight) -> [u8; 4] {
        let sampler = Sampler::new(0, self.request.seed);
        let draw = SampleContext {
            sampler: &sampler,
            index: 0,
            spread: self.lens.spread,
            light_depth: LightDepth::Sun,
            around: true,
            known: Some(known),
        };
        let (d, _) = self.lens.aim(None, place, [0.5, 0.5]);
        let light = &self.request.light;
        let empty = ForegroundPixel { color: Vec3::ZERO, coverage: 0.0, floor_light: 1.0 };
        let developed = match seen {
            PixelHit::Thing(hit) => match self.world.sent(light, self.lens.eye, d, hit, &draw) {
                Some(sent) => ForegroundPixel { color: film(sent.whole()), coverage: 1.0, floor_light: 1.0 },
                None => empty,
            },
            PixelHit::Floor => ForegroundPixel { floor_light: self.world.floor_light(light, p, &draw), ..empty },
            PixelHit::Nothing => empty,
        };
        finish(self.request, self.lens, place, developed)
    }
}

#[cfg(test)]
mod tests;
