//! From where a scene is seen, and in what light.

use glam::Vec3;

use crate::recipe::Recipe;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::par::par_map;
use osier_scene::{Asset, AssetFrame, AssetKind, Camera, Fog, Placement, Sky, Sun, asset_bounds};

/// The camera as the scene has it, or fitted to the plants.
pub fn camera(recipe: &Recipe, assets: &[Asset], placements: &[Placement]) -> Camera {
    let rest = AssetFrame::default();
    let reach = |a: &Asset| a.points.iter().fold(Bounds::default(), |b, c| b.union(c.reach));
    // The wind brings rain from far away; only its fall on the plants is looked at.
    let falls = |a: &Asset| a.kind == AssetKind::Tracks && a.instancers.is_empty() && !reach(a).is_empty();
    let boxed = |a: &Asset| if falls(a) { reach(a) } else { asset_bounds(a, &rest).union(reach(a)) };
    let boxes: Vec<Bounds> = par_map(assets, boxed);
    let corners = placements.iter().flat_map(|s| {
        let b = boxes.get(s.asset).copied().unwrap_or_default();
        let corners = if b.is_empty() { Vec::new() } else { b.corners().to_vec() };
        corners.into_iter().map(|c| s.transform.apply(c))
    });
    let keys = &recipe.camera;
    let [width, height] = recipe.output.pov.size;
    let mut camera = Camera::framing(Bounds::of(corners), narrow(width / height), narrow(keys.vfov));
    let point = |p: [f64; 3]| Vec3::from_array(p.map(narrow));
    if let Some(target) = keys.target {
        camera.eye += point(target) - camera.target;
        camera.target = point(target);
    }
    camera.eye = keys.eye.map_or(camera.target + (camera.eye - camera.target) * narrow(keys.distance), point);
    camera.roll = narrow(keys.roll);
    camera
}

/// The sun as the scene has it.
pub fn sun(recipe: &Recipe) -> Sun {
    let keys = &recipe.sun;
    Sun {
        elevation: narrow(keys.elevation),
        azimuth: narrow(keys.azimuth),
        color: keys.color,
        strength: narrow(keys.strength),
        angle: narrow(keys.angle),
    }
}

/// The sky as the scene has it, with its haze.
pub fn sky(recipe: &Recipe) -> Sky {
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
