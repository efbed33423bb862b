//! Coats, such as films of water: where a map sequence gives them weight, a surface is darker and smoother. Its normals do not
//! change: drops on the surface are meshes.

use std::sync::Arc;

use glam::Vec2;

use super::materials::ShadingParams;
use osier_base::math::lerp;
use osier_scene::{Coat, Frame, Material, Scene};

/// The coat of a material at a frame: weights by texel, and the darkening under a closed film.
#[derive(Debug)]
pub(super) struct CoatMap {
    /// Weight of the film by texel, 0 to 1, rows from the top.
    weight: Arc<Vec<f32>>,
    /// Texels along a side of the square map.
    side: usize,
    /// Albedo under a closed film as a fraction of that of the bare surface.
    darkening: f32,
}

impl CoatMap {
    /// The coat of each material; `None` for those without, or whose maps are missing or of another size.
    pub(super) fn of_materials(scene: &Scene, frame: Option<&Frame>) -> Vec<Option<Self>> {
        let now = scene.maps_at(frame);
        let coat = |material: &Material| {
            let coat = material.coat?;
            let i = coat.sequence as usize;
            let (maps, sequence) = (now.get(i)?.as_ref()?, scene.map_sequences.get(i)?);
            let weight = Arc::clone(maps.scalars(sequence.layer(coat.weight)?)?);
            let (side, darkening) = (sequence.side, coat.darkening);
            (side > 0 && weight.len() == sequence.texels()).then_some(Self { weight, side, darkening })
        };
        scene.materials.iter().map(coat).collect()
    }

    /// Darkens and smooths a surface by the weight of the film. `footprint`: width of the sample in texture
    /// coordinates.
    pub(super) fn apply(&self, shading: &mut ShadingParams, uv: Vec2, footprint: f32) {
        // [yang-wu] eq. 10: linear between the reflectance of the bare and of the coated surface.
        let w = self.filtered(uv, footprint).clamp(0.0, 1.0);
        shading.albedo *= lerp(1.0, self.darkening, w);
        shading.roughness = lerp(shading.roughness, shading.roughness.min(Coat::WET_ROUGHNESS), w);
    }

    /// A map filtered over a sample: one bilinear look-up for a sample that is narrower than a texel, else the mean of
    /// four across it.
    fn filtered(&self, uv: Vec2, footprint: f32) -> f32 {
        #[allow(clippy::cast_precision_loss, reason = "maps are at most 8192 texels wide")]
        if footprint * (self.side as f32) < 1.0 {
            return self.bilinear(uv);
        }
        // Four look-ups at the middles of the quarters of the sample: a box filter of its width.
        let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
        let each = corners.map(|(x, y)| self.bilinear(uv + Vec2::new(x, y) * (footprint * 0.25)));
        each.iter().sum::<f32>() * 0.25
    }

    /// Bilinear interpolation between the middles of four texels; row 0 is the top, and the edge is repeated beyond it.
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "texels of a map"
    )]
    fn bilinear(&self, uv: Vec2) -> f32 {
        let most = (self.side - 1) as f32;
        // Texel centres lie at half-integer coordinates; v runs up, rows run down.
        let at = (Vec2::new(uv.x, 1.0 - uv.y) * self.side as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(most));
        let (x, y) = (at.x as usize, at.y as usize);
        let fraction = at - Vec2::new(x as f32, y as f32);
        let texel =
            |dx: usize, dy: usize| self.weight[(y + dy).min(self.side - 1) * self.side + (x + dx).min(self.side - 1)];
        let row = |dy: usize| lerp(texel(0, dy), texel(1, dy), fraction.x);
        lerp(row(0), row(1), fraction.y)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn coat() -> CoatMap {
        let weight = vec![0.0, 1.0, 0.5, 0.0];
        CoatMap { weight: Arc::new(weight), side: 2, darkening: 0.55 }
    }

    #[test]
    fn the_upper_right_texel_is_where_v_is_large() {
        let coat = coat();
        let at = |u: f32, v: f32| coat.filtered(Vec2::new(u, v), 0.0);
        let found = [at(0.75, 0.75), at(1.0, 1.0), at(0.25, 0.25), at(0.25, 0.75)];
        assert!(found.iter().zip([1.0, 1.0, 0.5, 0.0]).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        assert!((at(0.5, 0.5) - 0.375).abs() < 1e-6);
    }

    #[test]
    fn what_is_wet_is_darker_and_smoother() {
        let dry = ShadingParams { albedo: Vec3::splat(0.5), roughness: 0.6, f0: 0.04, translucency: 0.3, water: false };
        let mut wet = dry;
        coat().apply(&mut wet, Vec2::new(0.75, 0.75), 0.0);
        assert!((wet.albedo.x - 0.5 * 0.55).abs() < 1e-6 && (wet.roughness - 0.08).abs() < 1e-6);
        let mut still = dry;
        coat().apply(&mut still, Vec2::new(0.25, 0.75), 0.0);
        assert!((still.albedo.x - 0.5).abs() < 1e-6 && (still.roughness - 0.6).abs() < 1e-6);
    }
}
