//! Traversal of all primitives for rasterisation, in batches of equal size that threads share.

use glam::{Vec2, Vec3};

use super::super::render_scene::{RenderScene, SolidInstance, ray};
use super::super::solid::{Primitives, Solid};
use super::projection::{InstanceProjection, ProjectedPoint, ProjectedVertices, Projection, RasterRect};
use osier_base::geometry::Bounds;
use osier_base::par::par_map;

/// Primitives of a batch: enough to hide the cost of a task, few enough to balance the threads.
const BATCH_PRIMITIVES: usize = 1 << 14;

/// Consecutive primitives of one instance.
#[derive(Debug, Clone, Copy)]
pub(super) struct PrimitiveRange {
    instance: usize,
    first: usize,
    end: usize,
    /// Number of the first, counted over all instances.
    number: u64,
}

/// All primitives of a scene in batches of equal size, which threads draw in parallel.
#[derive(Debug)]
pub(super) struct DrawList {
    batches: Vec<Vec<PrimitiveRange>>,
    /// Number of the first primitive of each instance, counted over all instances.
    pub(super) first_numbers: Vec<u64>,
}

impl DrawList {
    pub(super) fn new(world: &RenderScene<'_>) -> Self {
        let mut list = Self { batches: Vec::new(), first_numbers: Vec::new() };
        let (mut batch, mut batch_len, mut number) = (Vec::new(), 0, 0);
        for (instance, len) in world.primitive_counts().enumerate() {
            list.first_numbers.push(number);
            // Large instances are split over batches, small ones share a batch.
            let mut first = 0;
            while first < len {
                let end = len.min(first + BATCH_PRIMITIVES - batch_len);
                batch.push(PrimitiveRange { instance, first, end, number });
                number += (end - first) as u64;
                (batch_len, first) = (batch_len + end - first, end);
                if batch_len >= BATCH_PRIMITIVES {
                    list.batches.push(std::mem::take(&mut batch));
                    batch_len = 0;
                }
            }
        }
        list.batches.push(batch);
        list
    }

    /// Draws all primitives. Targets must give the same result in any order.
    pub(super) fn draw(&self, world: &RenderScene<'_>, projection: &Projection, target: &(impl Raster + Sync)) {
        par_map(&self.batches, |batch| {
            let mut vertices = ProjectedVertices::default();
            batch.iter().for_each(|range| range.draw(world, projection, target, &mut vertices));
        });
    }
}

/// A raster that primitives are drawn into.
pub(super) trait Raster {
    /// Columns and rows of the raster within the bounding box of projected points; `None` if the box lies outside.
    fn covered_rect<const N: usize>(
        &self,
        projection: &InstanceProjection,
        points: &[ProjectedPoint; N],
    ) -> Option<RasterRect>;

    /// Draws the triangle with a number. `is_opaque`: whether the texture leaves a surface at barycentric coordinates.
    fn draw_triangle(
        &self,
        projection: &InstanceProjection,
        corners: &[ProjectedPoint; 3],
        number: u64,
        is_opaque: impl Fn(Vec2) -> bool,
    );

    /// Draws the round cone with a number. `intersect`: distance at which a ray of the world, given by origin and
    /// direction, hits it, in lengths of the direction.
    fn draw_cone(&self, rect: RasterRect, number: u64, intersect: impl Fn(Vec3, Vec3) -> Option<f32>);
}

impl PrimitiveRange {
    fn draw(
        &self,
        world: &RenderScene<'_>,
        projection: &Projection,
        target: &impl Raster,
        vertices: &mut ProjectedVertices,
    ) {
        let Some((instance, solid)) = world.instance(self.instance) else { return };
        // One matrix from the space of the solid to the raster: vertices are transformed once.
        let projection = projection.for_instance(instance);
        // Instances outside of the raster are culled by their box.
        if solid.bounds().and_then(|b| target.covered_rect(&projection, &project_box(&projection, b))).is_none() {
            return;
        }
        let range = self.first..self.end;
        match &solid.kind {
            Primitives::Triangles { triangles, vertices: attributes } => {
                // Vertices are shared by about six triangles; each is projected once per batch.
                let triangles = &triangles[range];
                vertices.project(&projection, triangles, attributes);
                for (number, triangle) in (self.number..).zip(triangles) {
                    let passes_alpha = |width, barycentric| {
                        let sample = || attributes.alpha_sample(triangle, barycentric, width);
                        world.materials.is_opaque_at(triangle.material, sample)
                    };
                    let is_opaque =
                        |barycentric| solid.cutout_footprint.is_none_or(|width| passes_alpha(width, barycentric));
                    let corners = vertices.corners(attributes.corners(triangle));
                    target.draw_triangle(&projection, &corners, number, is_opaque);
                }
            }
            // Round cones have no edge functions: each pixel of their box intersects a ray.
            Primitives::Cones { cones, .. } => {
                for ((i, number), cone) in range.clone().zip(self.number..).zip(&cones[range]) {
                    let corners = project_box(&projection, cone.bounds());
                    let Some(rect) = target.covered_rect(&projection, &corners) else { continue };
                    target.draw_cone(rect, number, |origin, direction| {
                        intersect_primitive(world, instance, solid, i, origin, direction)
                    });
                }
            }
        }
    }
}

fn project_box(projection: &InstanceProjection, [min, max]: [Vec3; 2]) -> [ProjectedPoint; 8] {
    Bounds { min, max }.corners().map(|p| projection.project(p))
}

/// Distance along a ray of the world at which it hits primitive `i` of an instance.
fn intersect_primitive(
    world: &RenderScene<'_>,
    instance: &SolidInstance,
    solid: &Solid<'_>,
    i: usize,
    origin: Vec3,
    direction: Vec3,
) -> Option<f32> {
    let local = instance.local_ray(&ray(origin, direction, [0.0, f32::INFINITY]));
    solid.intersect(&local, i, world.materials).map(|hit| hit.t)
}
