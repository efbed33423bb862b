//! Lines whose widths are pixels: the size of a pixel follows from the extent of the drawing.

use glam::Vec3;

use osier_base::diagnostic::{Diagnostic, Span};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_scene::plant::Plant;

/// Thinnest and thickest pixel, as shares of the largest extent of the drawing. Own: a curve fills a picture of some 1000 pixels;
/// a line of three of them can be seen in a picture of half that size.
const PIXEL: [f64; 2] = [1.0 / 1000.0, 1.0 / 300.0];
/// Largest thickness of a line as a share of the mean length of a segment, so that the corners of a fine curve stay
/// apart.
const SHARE_OF_SEGMENT: f64 = 0.25;

/// Size of a pixel in this plant, m; 0 for a plant without extent.
pub(super) fn pixel_size(plant: &Plant) -> f64 {
    let extent = extent(plant);
    if !extent.is_finite() || extent <= 0.0 {
        return 0.0;
    }
    let segments: usize = plant.axes.iter().map(|a| a.count.saturating_sub(1) as usize).sum();
    let length: f64 = plant.axes.iter().map(|a| f64::from(a.length)).sum();
    let mean = length / segments.max(1) as f64;
    (mean * SHARE_OF_SEGMENT).clamp(extent * PIXEL[0], extent * PIXEL[1])
}

/// Extent, m, up to which the units of a plant count as metres, so that its twigs keep their radius.
const REAL_EXTENT: f64 = 20.0;
/// Radius of a twig as a share of the extent beyond [`REAL_EXTENT`], so that a twig is about a pixel wide in a picture of 800.
const TWIG: f64 = 1.0 / 1600.0;

/// Radius of the tips of a plant without widths, m: `own`, or more for plants so large that their units cannot be
/// metres and twigs of this radius would be invisible.
pub(super) fn visible_tip(plant: &Plant, own: f64) -> f64 {
    let beyond = extent(plant) - REAL_EXTENT;
    if beyond.is_finite() { own.max(beyond * TWIG) } else { own }
}

/// Largest side of the box around all nodes, m.
fn extent(plant: &Plant) -> f64 {
    let bounds = Bounds::of(plant.nodes.p.iter().copied());
    f64::from((bounds.max - bounds.min).max(Vec3::ZERO).max_element())
}

/// Gives all nodes of the plant one width, m, and marks its axes as lines of a drawing.
pub(super) fn set_width(plant: &mut Plant, width: f64) {
    plant.nodes.r.fill(radius(0.5 * width));
    plant.lines = true;
}

/// Multiplies all radii, and marks the axes as lines of a drawing.
pub(super) fn scale_widths(plant: &mut Plant, factor: f64) {
    plant.nodes.r.iter_mut().for_each(|r| *r = radius(f64::from(*r) * factor));
    plant.lines = true;
}

/// A radius in single precision, at least 1e-6 m, because widths may count down to 0.
fn radius(r: f64) -> f32 {
    narrow(r).max(1e-6)
}

/// Warning L046, which states how wide a pixel is drawn.
pub(super) fn warning(pixel: f64, place: Span) -> Diagnostic {
    let message = format!("line widths are pixels; one pixel is drawn {:.3} mm wide", pixel * 1e3);
    let help = "a pixel is a share of the drawing's size; for other widths set line = \"cylinder\" and width";
    Diagnostic::warning("L046", message, place, "lines").help(help)
}
