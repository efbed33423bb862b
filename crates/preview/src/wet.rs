//! Coats, such as films of water: where a map sequence gives one weight, a surface is darker, smoother, and has the film's shape.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::looks::ShadingParams;
use osier_base::math::{lerp, normalize_or};
use osier_scene::{Frame, MapEncoding, Material, Scene};

/// Roughness of a closed film.
const SMOOTH: f32 = 0.08;

/// The coat of a material at a frame.
#[derive(Debug)]
pub(super) struct CoatMap {
    /// Weight of the film, 0 to 1.
    weight: Arc<Vec<f32>>,
    /// Normals in tangent space of surface and film.
    normal: Arc<Vec<[f32; 3]>>,
    /// Texels of a side.
    side: usize,
    /// Albedo under a closed film as a share of that of the bare surface.
    darkening: f32,
}

impl CoatMap {
    /// The coat of each material; none where its maps are missing.
    pub(super) fn of_materials(scene: &Scene, frame: Option<&Frame>) -> Vec<Option<Self>> {
        let now = scene.maps_at(frame);
        let coat = |material: &Material| {
            let coat = material.coat?;
            let i = coat.sequence as usize;
            let (maps, sequence) = (now.get(i)?.as_ref()?, scene.map_sequences.get(i)?);
            let weight = Arc::clone(maps.scalars(sequence.layer(coat.weight)?)?);
            let normal = Arc::clone(maps.vectors(sequence.layer_encoded(MapEncoding::Normal)?)?);
            let whole = weight.len() == sequence.texels() && normal.len() == sequence.texels();
            let (side, darkening) = (sequence.side, coat.darkening);
            (side > 0 && whole).then_some(Self { weight, normal, side, darkening })
        };
        scene.materials.iter().map(coat).collect()
    }

    /// Lays the film over a surface, with its weight at a place. `footprint`: width of the sample in texture coordinates.
    pub(super) fn apply(&self, finish: &mut ShadingParams, uv: Vec2, footprint: f32) {
        let w = self.mean(uv, footprint, |i| Vec3::splat(self.weight[i])).x.clamp(0.0, 1.0);
        finish.albedo *= lerp(1.0, self.darkening, w);
        finish.roughness = lerp(finish.roughness, finish.roughness.min(SMOOTH), w);
    }

    /// The normal in tangent space, of relief and film.
    pub(super) fn relief(&self, uv: Vec2, footprint: f32) -> Vec3 {
        normalize_or(self.mean(uv, footprint, |i| Vec3::from_array(self.normal[i])), Vec3::Z)
    }

    /// The mean of a map over a sample: between texels at one place where it is finer than they are, at four across it else.
    fn mean(&self, uv: Vec2, footprint: f32, map: impl Fn(usize) -> Vec3) -> Vec3 {
        #[allow(clippy::cast_precision_loss, reason = "maps are at most 8192 texels wide")]
        if footprint * (self.side as f32) < 1.0 {
            return self.between(uv, &map);
        }
        let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
        let each = corners.map(|(x, y)| self.between(uv + Vec2::new(x, y) * (footprint * 0.25), &map));
        each.iter().sum::<Vec3>() * 0.25
    }

    /// Between the middles of four texels; row 0 is the top, and beyond its edge the map goes on as at it.
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "texels of a map"
    )]
    fn between(&self, uv: Vec2, map: &impl Fn(usize) -> Vec3) -> Vec3 {
        let most = (self.side - 1) as f32;
        let at = (Vec2::new(uv.x, 1.0 - uv.y) * self.side as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(most));
        let (x, y) = (at.x as usize, at.y as usize);
        let share = at - Vec2::new(x as f32, y as f32);
        let texel = |dx: usize, dy: usize| map((y + dy).min(self.side - 1) * self.side + (x + dx).min(self.side - 1));
        let row = |dy: usize| texel(0, dy).lerp(texel(1, dy), share.x);
        row(0).lerp(row(1), share.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet() -> CoatMap {
        let normal = vec![[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
        let weight = vec![0.0, 1.0, 0.5, 0.0];
        CoatMap { weight: Arc::new(weight), normal: Arc::new(normal), side: 2, darkening: 0.55 }
    }

    #[test]
    fn the_upper_right_texel_is_where_v_is_large() {
        let sheet = sheet();
        let at = |u: f32, v: f32| sheet.mean(Vec2::new(u, v), 0.0, |i| Vec3::splat(sheet.weight[i])).x;
        let found = [at(0.75, 0.75), at(1.0, 1.0), at(0.25, 0.25), at(0.25, 0.75)];
        assert!(found.iter().zip([1.0, 1.0, 0.5, 0.0]).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        assert!((at(0.5, 0.5) - 0.375).abs() < 1e-6);
        assert!((sheet.relief(Vec2::new(0.75, 0.75), 0.0) - Vec3::new(0.6, 0.0, 0.8)).length() < 1e-6);
    }

    #[test]
    fn what_is_wet_is_darker_and_smoother() {
        let dry = ShadingParams { albedo: Vec3::splat(0.5), roughness: 0.6, f0: 0.04, translucency: 0.3, water: false };
        let mut wet = dry;
        sheet().apply(&mut wet, Vec2::new(0.75, 0.75), 0.0);
        assert!((wet.albedo.x - 0.5 * 0.55).abs() < 1e-6 && (wet.roughness - 0.08).abs() < 1e-6);
        let mut still = dry;
        sheet().apply(&mut still, Vec2::new(0.25, 0.75), 0.0);
        assert!((still.albedo.x - 0.5).abs() < 1e-6 && (still.roughness - 0.6).abs() < 1e-6);
    }
}
