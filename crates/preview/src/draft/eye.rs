//! What a lens sees first: the nearest primitive of every pixel.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Vec2, Vec3};

use super::super::lens::Lens;
use super::super::world::{Hit, World, ray};
use super::project::{InstanceProjection, Projected, Projection, float, span};
use super::tasks::{RasterTarget, ScreenRect, Tasks};

/// Rows of a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Band {
    pub(super) top: u32,
    pub(super) size: [u32; 2],
}

impl Band {
    pub(super) fn pixels(self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Place in the picture of pixel `i` of the band.
    #[allow(clippy::cast_possible_truncation, reason = "a band's pixels fit")]
    pub(super) fn place(self, i: usize) -> [u32; 2] {
        [(i % self.size[0] as usize) as u32, self.top + (i / self.size[0] as usize) as u32]
    }
}

/// The nearest primitives of a band's pixels.
#[derive(Debug)]
pub(super) struct Eye<'l> {
    lens: &'l Lens,
    /// Bits of the depth above the primitive's number: the least is the nearest, and ties go to the lower number.
    nearest: Vec<AtomicU64>,
    band: Band,
}

/// Nothing there.
const FAR: u64 = u64::MAX;

impl<'l> Eye<'l> {
    /// Looks at everything, once. Numbers of primitives must fit 32 bits.
    pub(super) fn new(world: &World<'_>, lens: &'l Lens, band: Band, tasks: &Tasks) -> Self {
        let nearest = std::iter::repeat_with(|| AtomicU64::new(FAR)).take(band.pixels()).collect();
        let eye = Self { lens, nearest, band };
        tasks.draw(world, &Projection::of_lens(lens, band.top), &eye);
        eye
    }

    /// Keeps a primitive where it is nearer than what was there; `there` is asked only then.
    #[inline]
    fn keep(&self, [x, y]: [u32; 2], depth: f32, number: u64, there: impl Fn() -> bool) {
        let Some(cell) = self.nearest.get((y * self.band.size[0] + x) as usize) else { return };
        let key = u64::from(depth.to_bits()) << 32 | number;
        if depth > 0.0 && key < cell.load(Ordering::Relaxed) && there() {
            cell.fetch_min(key, Ordering::Relaxed);
        }
    }

    /// What pixel `i` of the band shows, with the direction of its look.
    pub(super) fn hit(&self, world: &World<'_>, i: usize, o: Vec3, d: Vec3, starts: &[u64]) -> Option<Hit> {
        let key = self.nearest.get(i)?.load(Ordering::Relaxed);
        if key == FAR {
            return None;
        }
        let number = key & u64::from(u32::MAX);
        let showing = starts.partition_point(|s| *s <= number).checked_sub(1)?;
        let primitive = usize::try_from(number - starts.get(showing)?).ok()?;
        let (shown, solid) = world.of(showing)?;
        let spot = solid.spot(&shown.local(&ray(o, d, [0.0, f32::INFINITY])), primitive)?;
        Some(Hit { showing: u32::try_from(showing).ok()?, spot })
    }
}

impl RasterTarget for Eye<'_> {
    #[inline]
    fn window<const N: usize>(&self, sight: &InstanceProjection, places: &[Projected; N]) -> Option<ScreenRect> {
        sight.window(places, self.band.size, span)
    }

    #[inline]
    fn face(&self, sight: &InstanceProjection, corners: &[Projected; 3], number: u64, there: impl Fn(Vec2) -> bool) {
        let Some([columns, rows]) = self.window(sight, corners) else { return };
        let zero = [columns.start, rows.start];
        let Some(patch) = sight.patch(corners, Vec2::new(float(zero[0]), float(zero[1]))) else { return };
        for y in rows {
            let dy = float(y - zero[1]);
            for x in patch.touched(&columns, [dy; 2], zero[0]) {
                let dx = float(x - zero[0]);
                if patch.inside(dx, dy) >= 0.0 {
                    self.keep([x, y], 1.0 / patch.depth(dx, dy), number, || there(patch.weights(dx, dy)));
                }
            }
        }
    }

    fn cone(&self, [columns, rows]: ScreenRect, number: u64, meets: impl Fn(Vec3, Vec3) -> Option<f32>) {
        for [x, y] in rows.flat_map(|y| columns.clone().map(move |x| [x, y])) {
            if let Some(depth) = meets(self.lens.eye, self.lens.span([x, y + self.band.top])) {
                self.keep([x, y], depth, number, || true);
            }
        }
    }
}
