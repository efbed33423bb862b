//! What is to be drawn, dealt out in even lots, and the way through it.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::super::solid::{Primitives, Solid};
use super::super::world::{SolidInstance, World, ray};
use super::project::{InstanceProjection, Projected, Projection, Vertices};
use osier_base::geometry::Bounds;
use osier_base::par::par_map;

/// Primitives of a lot.
const LOT: usize = 1 << 14;

/// Some primitives of one showing.
#[derive(Debug, Clone, Copy)]
pub(super) struct PrimitiveRange {
    pub(super) showing: usize,
    pub(super) first: usize,
    pub(super) end: usize,
    /// Number of the first among all primitives of all showings.
    pub(super) number: u64,
}

/// Everything to be drawn.
#[derive(Debug)]
pub(super) struct Tasks {
    pub(super) lots: Vec<Vec<PrimitiveRange>>,
    /// Number of the first primitive of each showing among all primitives of all showings.
    pub(super) starts: Vec<u64>,
}

impl Tasks {
    pub(super) fn new(world: &World<'_>) -> Self {
        let mut own = Self { lots: Vec::new(), starts: Vec::new() };
        let (mut lot, mut held, mut number) = (Vec::new(), 0, 0);
        for (showing, len) in world.lengths().enumerate() {
            own.starts.push(number);
            let mut first = 0;
            while first < len {
                let end = len.min(first + LOT - held);
                lot.push(PrimitiveRange { showing, first, end, number });
                number += (end - first) as u64;
                (held, first) = (held + end - first, end);
                if held >= LOT {
                    own.lots.push(std::mem::take(&mut lot));
                    held = 0;
                }
            }
        }
        own.lots.push(lot);
        own
    }

    /// Draws everything, in any order.
    pub(super) fn draw(&self, world: &World<'_>, view: &Projection, screen: &(impl RasterTarget + Sync)) {
        par_map(&self.lots, |lot| {
            let mut vertices = Vertices::default();
            lot.iter().for_each(|share| share.draw(world, view, screen, &mut vertices));
        });
    }
}

/// Columns and rows.
pub(super) type ScreenRect = [Range<u32>; 2];

/// Where primitives are drawn.
pub(super) trait RasterTarget {
    /// What of the screen the box around places touches.
    fn window<const N: usize>(&self, sight: &InstanceProjection, places: &[Projected; N]) -> Option<ScreenRect>;

    /// `there`: false where the triangle is cut out, by the weights of its corners.
    fn face(&self, sight: &InstanceProjection, corners: &[Projected; 3], number: u64, there: impl Fn(Vec2) -> bool);

    /// `meets`: where a ray of the world meets the cone, in lengths of its direction.
    fn cone(&self, window: ScreenRect, number: u64, meets: impl Fn(Vec3, Vec3) -> Option<f32>);
}

impl PrimitiveRange {
    fn draw(&self, world: &World<'_>, view: &Projection, screen: &impl RasterTarget, vertices: &mut Vertices) {
        let Some((showing, solid)) = world.of(self.showing) else { return };
        let sight = view.onto(showing);
        if solid.bounds().and_then(|b| screen.window(&sight, &around(&sight, b))).is_none() {
            return;
        }
        let primitives = self.first..self.end;
        match &solid.kind {
            Primitives::Faces { faces, mesh } => {
                let faces = &faces[primitives];
                vertices.see(&sight, faces, mesh);
                for (number, face) in (self.number..).zip(faces) {
                    let kept = |width, at| world.looks.is_kept(face.material, width, || mesh.uv(face, at));
                    let there = |at| solid.cut.is_none_or(|width| kept(width, at));
                    screen.face(&sight, &vertices.corners(mesh.corners(face)), number, there);
                }
            }
            Primitives::Cones { cones, .. } => {
                for ((i, number), cone) in primitives.clone().zip(self.number..).zip(&cones[primitives]) {
                    let Some(window) = screen.window(&sight, &around(&sight, cone.bounds())) else { continue };
                    screen.cone(window, number, |from, along| meets(world, showing, solid, i, [from, along]));
                }
            }
        }
    }
}

fn around(sight: &InstanceProjection, [min, max]: [Vec3; 2]) -> [Projected; 8] {
    Bounds { min, max }.corners().map(|p| sight.see(p))
}

/// Distance along a ray at which it meets primitive `i` of a solid instance.
fn meets(
    world: &World<'_>,
    showing: &SolidInstance,
    solid: &Solid<'_>,
    i: usize,
    [from, along]: [Vec3; 2],
) -> Option<f32> {
    let look = showing.local(&ray(from, along, [0.0, f32::INFINITY]));
    solid.meet(&look, i, world.looks).map(|spot| spot.t)
}
