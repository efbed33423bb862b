//! What a lens sees first: the nearest primitive of every pixel.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Vec2, Vec3};

use super::super::lens::Lens;
use super::super::solid::Kind;
use super::super::world::{Hit, World, ray};
use super::corners;
use super::project::{Seen, Sight, Vertices, View, float, span};
use super::tasks::{Share, Tasks};
use crate::par::par_map;

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
pub(super) struct Eye {
    /// Bits of the depth above the primitive's number: the least is the nearest, and ties go to the lower number.
    nearest: Vec<AtomicU64>,
    band: Band,
}

/// Nothing there.
const FAR: u64 = u64::MAX;

impl Eye {
    /// Looks at everything, once. Numbers of primitives must fit 32 bits.
    pub(super) fn new(world: &World<'_>, lens: &Lens, band: Band, tasks: &Tasks) -> Self {
        let eye = Self { nearest: std::iter::repeat_with(|| AtomicU64::new(FAR)).take(band.pixels()).collect(), band };
        let view = View::of_lens(lens, band.top);
        par_map(&tasks.lots, |lot| {
            let mut vertices = Vertices::default();
            lot.iter().for_each(|share| eye.draw(world, (lens, &view), share, &mut vertices));
        });
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

    fn draw(&self, world: &World<'_>, (lens, view): (&Lens, &View), share: &Share, vertices: &mut Vertices) {
        let Some((showing, solid)) = world.of(share.showing) else { return };
        let sight = view.onto(showing);
        if solid.bounds().and_then(|b| self.pixels(&sight, &corners(b).map(|p| sight.see(p)))).is_none() {
            return;
        }
        let primitives = share.first..share.end;
        match &solid.kind {
            Kind::Faces { faces, mesh } => {
                let faces = &faces[primitives];
                vertices.see(&sight, faces, mesh);
                for (number, face) in (share.number..).zip(faces) {
                    let there = |at| !solid.cut || world.looks.is_kept(face.material, || mesh.uv(face, at));
                    self.draw_face(&sight, &vertices.corners(mesh.corners(face)), number, there);
                }
            }
            Kind::Cones { cones, .. } => {
                for ((i, number), cone) in primitives.clone().zip(share.number..).zip(&cones[primitives]) {
                    let Some([columns, rows]) = self.pixels(&sight, &corners(cone.bounds()).map(|p| sight.see(p)))
                    else {
                        continue;
                    };
                    for [x, y] in rows.flat_map(|y| columns.clone().map(move |x| [x, y])) {
                        let look = ray(lens.eye, lens.span([x, y + self.band.top]), [0.0, f32::INFINITY]);
                        if let Some(spot) = solid.meet(&showing.local(&look), i, world.looks) {
                            self.keep([x, y], spot.t, number, || true);
                        }
                    }
                }
            }
        }
    }

    /// `there`: false where a triangle is cut out, by the weights of its corners.
    #[inline]
    fn draw_face(&self, sight: &Sight, corners: &[Seen; 3], number: u64, there: impl Fn(Vec2) -> bool) {
        let Some([columns, rows]) = self.pixels(sight, corners) else { return };
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

    /// Pixels whose middles lie in the box around places.
    #[inline]
    fn pixels<const N: usize>(&self, sight: &Sight, places: &[Seen; N]) -> Option<[Range<u32>; 2]> {
        let [lo, hi] = sight.frame(places)?;
        let columns = span(lo.x, hi.x, self.band.size[0]);
        if columns.is_empty() {
            return None;
        }
        let rows = span(lo.y, hi.y, self.band.size[1]);
        (!rows.is_empty()).then_some([columns, rows])
    }

    /// What pixel `i` of the band shows, with the direction of its look.
    pub(super) fn hit(&self, world: &World<'_>, i: usize, (o, d): (Vec3, Vec3), starts: &[u64]) -> Option<Hit> {
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
