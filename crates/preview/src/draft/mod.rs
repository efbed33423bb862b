//! Drafts: the scene is rasterised for the camera and then for the light. No ray is cast and no BVH built.
//!
//! One sample per pixel: a [`VisibilityBuffer`] finds the visible surface, [`shadow_cells`] whether the sun reaches it, a
//! [`SkyVisibility`] grid the share of the sky that does; shading and tone mapping are those of ray tracing.

mod draw_list;
mod projection;
mod shadow_cells;
mod sky_visibility;
mod visibility_buffer;

use glam::Vec3;

use self::draw_list::DrawList;
use self::sky_visibility::SkyVisibility;
use self::visibility_buffer::{RowBand, VisibilityBuffer};
use super::light_transport::{PrecomputedLight, SampleContext};
use super::perspective::{PerspectiveCamera, PrimaryRay};
use super::picture::Picture;
use super::pixel::{ForegroundPixel, TILE, composite, tile_count};
use super::quality::LightDepth;
use super::render_scene::{RenderScene, SceneHit};
use super::request::RenderRequest;
use super::sampler::Sampler;
use super::tone::tone_map;
use osier_base::Result;
use osier_base::par::{join, par_map};
use osier_base::progress::{Cancel, Progress};

/// Pixels that are rasterised at a time; bounds the memory of large pictures to about 200 MB.
const BAND_PIXELS: u32 = 1 << 22;

/// Renders a draft. The scene has no more primitives than 32 bits count.
/// # Errors
/// `Cancelled`.
pub(super) fn render(
    world: &RenderScene<'_>,
    request: &RenderRequest,
    camera: &PerspectiveCamera,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Picture> {
    let [width, height] = request.size;
    let draft = DraftRenderer::new(world, request, camera);
    // Bands are whole rows of tiles, so that progress counts the same steps as in ray tracing.
    let rows = (BAND_PIXELS / width.max(1) / TILE).max(1) * TILE;
    let bands: Vec<RowBand> =
        (0..height).step_by(rows as usize).map(|top| RowBand { top, size: [width, rows.min(height - top)] }).collect();
    let mut picture = Picture::new(width, height);
    let mut sky_visibility = None;
    for band in bands {
        // The grid of sky visibility does not depend on the camera: it is computed beside the first
        // band and used by all.
        let visible = match sky_visibility {
            Some(_) => draft.visible_points(band, cancel)?,
            None => {
                let (visible, grid) = join(|| draft.visible_points(band, cancel), || SkyVisibility::new(world));
                sky_visibility = Some(grid);
                visible?
            }
        };
        let Some(sky_visibility) = &sky_visibility else { continue };
        picture.put_block([0, band.top], width, &draft.shade(band, &visible, sky_visibility));
        progress.advance(tile_count(band.size));
    }
    Ok(picture)
}

struct DraftRenderer<'d, 'w> {
    world: &'d RenderScene<'w>,
    request: &'d RenderRequest,
    camera: &'d PerspectiveCamera,
    /// Height of the floor, m.
    floor: Option<f32>,
    draw_list: DrawList,
}

/// The visible point of each pixel of a band, as input of shading.
struct VisiblePoints {
    hits: Vec<Vec<PixelHit>>,
    /// Positions just off the surface, m, indexed by row and column; NaN where nothing is hit.
    positions: Vec<Vec<Vec3>>,
    /// Whether the sun is visible, row after row.
    is_sunlit: Vec<bool>,
}

#[derive(Clone, Copy)]
enum PixelHit {
    Object(SceneHit),
    Floor,
    Background,
}

impl<'d, 'w> DraftRenderer<'d, 'w> {
    fn new(world: &'d RenderScene<'w>, request: &'d RenderRequest, camera: &'d PerspectiveCamera) -> Self {
        let floor = request.backdrop.floor(&world.bounds);
        Self { world, request, camera, floor, draw_list: DrawList::new(world) }
    }

    /// Rasterises a band for the camera, then its visible points for the sun.
    fn visible_points(&self, band: RowBand, cancel: &Cancel) -> Result<VisiblePoints> {
        cancel.check()?;
        let buffer = VisibilityBuffer::new(self.world, self.camera, band, &self.draw_list);
        cancel.check()?;
        let width = band.size[0] as usize;
        let rows: Vec<usize> = (0..band.size[1] as usize).collect();
        // From the number of the visible primitive to a point on it, in parallel by rows.
        let row = |y: &usize| (y * width..(y + 1) * width).map(|i| self.visible_point(&buffer, band, i)).unzip();
        let (hits, positions): (Vec<Vec<PixelHit>>, Vec<Vec<Vec3>>) = par_map(&rows, row).into_iter().unzip();
        let is_sunlit =
            shadow_cells::sunlit_points(self.world, self.request.light.sun_direction(), &positions, &self.draw_list);
        cancel.check()?;
        Ok(VisiblePoints { hits, positions, is_sunlit })
    }

    /// Shades the pixels of a band, in parallel by rows.
    fn shade(&self, band: RowBand, visible: &VisiblePoints, sky_visibility: &SkyVisibility) -> Vec<[u8; 4]> {
        let width = band.size[0] as usize;
        let row = |y: &usize| -> Vec<[u8; 4]> {
            let points = visible.hits[*y].iter().zip(&visible.positions[*y]).zip(y * width..);
            let pixel = |((hit, p), i): ((&PixelHit, &Vec3), usize)| {
                let light = PrecomputedLight { sun: visible.is_sunlit[i], sky: sky_visibility.at(*p) };
                self.shade_pixel(band.pixel_position(i), hit, *p, light)
            };
            points.map(pixel).collect()
        };
        let rows: Vec<usize> = (0..band.size[1] as usize).collect();
        par_map(&rows, row).concat()
    }

    /// The surface that pixel `i` of a band shows, and the point from which the visibility of sun and sky is tested.
    fn visible_point(&self, buffer: &VisibilityBuffer<'_>, band: RowBand, i: usize) -> (PixelHit, Vec3) {
        let PrimaryRay { direction: d, floor_distance } =
            self.camera.primary_ray(self.floor, band.pixel_position(i), [0.5, 0.5]);
        let o = self.camera.eye;
        let far = floor_distance.unwrap_or(f32::INFINITY);
        // The floor is opaque: objects below it are hidden.
        match (buffer.hit(self.world, i, o, d, &self.draw_list.first_numbers), floor_distance) {
            (Some(hit), _) if hit.primitive.t <= far => {
                let n = self.world.outer_normal(&hit, o + d * hit.primitive.t);
                // Towards the side of the sun, so that a thin leaf is tested on the side that it
                // lights.
                let offset =
                    if n.dot(self.request.light.sun_direction()) > 0.0 { self.world.gap } else { -self.world.gap };
                (PixelHit::Object(hit), o + d * hit.primitive.t + n * offset)
            }
            (_, Some(t)) => (PixelHit::Floor, o + d * t + Vec3::Y * self.world.gap),
            _ => (PixelHit::Background, Vec3::NAN),
        }
    }

    fn shade_pixel(&self, position: [u32; 2], hit: &PixelHit, p: Vec3, light: PrecomputedLight) -> [u8; 4] {
        let sampler = Sampler::new(0, self.request.seed);
        let sample = SampleContext {
            sampler: &sampler,
            index: 0,
            spread: self.camera.spread,
            light_depth: LightDepth::Sun,
            samples_ambient: true,
            precomputed: Some(light),
        };
        let d = self.camera.direction(position, [0.5, 0.5]);
        let light = &self.request.light;
        let empty = ForegroundPixel { color: Vec3::ZERO, coverage: 0.0, floor_light: 1.0 };
        let foreground = match hit {
            PixelHit::Object(hit) => match self.world.shade(light, self.camera.eye, d, hit, &sample) {
                Some(scattered) => {
                    ForegroundPixel { color: tone_map(scattered.radiance()), coverage: 1.0, floor_light: 1.0 }
                }
                None => empty,
            },
            PixelHit::Floor => ForegroundPixel { floor_light: self.world.floor_light(light, p, &sample), ..empty },
            PixelHit::Background => empty,
        };
        composite(self.request, self.camera, position, foreground)
    }
}

#[cfg(test)]
mod tests;
