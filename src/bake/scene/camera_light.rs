//! Camera, sun and sky of a scene.

use glam::{DVec3, Vec3};

use crate::recipe::Recipe;
use osier_base::geometry::Bounds;
use osier_base::math::{self, narrow};
use osier_base::par::par_map;
use osier_scene::{Asset, AssetFrame, AssetKind, Camera, Fog, Placement, Sky, Sun, asset_bounds};

/// The camera of the keys; without them it frames all placements at rest.
pub fn scene_camera(recipe: &Recipe, assets: &[Asset], placements: &[Placement]) -> Camera {
    let rest = AssetFrame::default();
    // An asset's bounds at rest, joined with those that its points reach over the clip.
    let reach = |a: &Asset| a.points.iter().fold(Bounds::default(), |b, c| b.union(c.reach));
    // Wind-driven rain starts far outside the plants: of rain only the reach around them is framed.
    let is_rain = |a: &Asset| a.kind == AssetKind::Tracks && a.instancers.is_empty() && !reach(a).is_empty();
    let boxed = |a: &Asset| if is_rain(a) { reach(a) } else { asset_bounds(a, &rest).union(reach(a)) };
    let boxes: Vec<Bounds> = par_map(assets, boxed);
    let corners = placements.iter().flat_map(|s| {
        let b = boxes.get(s.asset).copied().unwrap_or_default();
        let corners = if b.is_empty() { Vec::new() } else { b.corners().to_vec() };
        corners.into_iter().map(|c| s.transform.apply(c))
    });
    camera_framing(recipe, Bounds::of(corners))
}

/// The camera of the keys; without them it frames `bounds`, m.
fn camera_framing(recipe: &Recipe, bounds: Bounds) -> Camera {
    let keys = &recipe.camera;
    let [width, height] = recipe.output.pov.size;
    let mut camera = Camera::framing(bounds, narrow(width / height), narrow(keys.vfov), narrow(keys.roll));
    let point = |p: [f64; 3]| Vec3::from_array(p.map(narrow));
    if let Some(target) = keys.target {
        camera.eye += point(target) - camera.target;
        camera.target = point(target);
    }
    camera.eye = keys.eye.map_or(camera.target + (camera.eye - camera.target) * narrow(keys.distance), point);
    camera
}

/// Scale of the camera's picture, by which the sizes of maps and meshes are chosen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScreenScale {
    /// World position of the camera, m.
    eye: DVec3,
    /// Focal length, pixels.
    focal: f64,
}

impl ScreenScale {
    /// The scale in the picture of the keys' camera, which without `eye` frames `bounds`, m.
    pub(crate) fn new(recipe: &Recipe, bounds: Bounds) -> Self {
        let [_, height] = recipe.output.pov.size;
        let camera = camera_framing(recipe, bounds);
        // The picture's height spans the angle vfov: height / 2 = focal tan(vfov / 2).
        Self { eye: camera.eye.as_dvec3(), focal: 0.5 * height / math::tan(0.5 * recipe.camera.vfov) }
    }

    /// Distance of a world point from the camera, m.
    pub(crate) fn distance(&self, at: DVec3) -> f64 {
        self.eye.distance(at)
    }

    /// Pixels that a length of 1 m across the line of sight takes at a point.
    pub(crate) fn pixels_per_metre(&self, at: DVec3) -> f64 {
        self.focal / self.distance(at).max(1e-9)
    }
}

/// The sun of `[sun]`; angles in radians, colour linear.
pub fn scene_sun(recipe: &Recipe) -> Sun {
    let keys = &recipe.sun;
    Sun {
        elevation: narrow(keys.elevation),
        azimuth: narrow(keys.azimuth),
        color: keys.color,
        strength: narrow(keys.strength),
        angle: narrow(keys.angle),
    }
}

/// The sky of `[sky]`, with the fog of `[fog]` if that sets a visibility; linear colours.
pub fn scene_sky(recipe: &Recipe) -> Sky {
    let keys = &recipe.sky;
    let strength = narrow(keys.strength);
    let fog = recipe.fog.visibility.map(|visibility| Fog {
        visibility: narrow(visibility),
        color: recipe.fog.color.unwrap_or(keys.horizon).map(|c| c * strength),
        height: narrow(recipe.fog.height),
    });
    Sky {
        horizon: keys.horizon,
        zenith: keys.zenith,
        below: keys.below,
        dapple: narrow(keys.dapple),
        glow: narrow(keys.glow),
        strength,
        fog,
    }
}
