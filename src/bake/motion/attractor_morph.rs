//! Morphs of attractors: points drawn from coefficients that change with time.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::bake::assets::attractor_color::color_mode;
use crate::bake::motion::{AssetMotion, FrameTime};
use crate::recipe::AttractorRecipe;
use crate::recipe::scene::MorphRecipe;
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_base::math::{lerp, narrow};
use osier_ifs::cloud::{AttractorPoints, DrawRequest, cloud};
use osier_ifs::color::{ColorLabels, ColorMode};
use osier_ifs::game::{Extent, InstructionSet};
use osier_ifs::morph::Morph;
use osier_scene::{Asset, AssetFrame, PointsFrame};

/// Number of points, and of time steps of the morph, with which the region that the points sweep is estimated. Own: more of
/// either gives a tighter bound and takes longer; the bound is used only for cameras and extents.
const BOUND_POINTS: u64 = 4096;
const BOUND_STEPS: u32 = 32;

/// The motion of an attractor's points through its morph: at every time all points are drawn anew with the same random numbers.
#[derive(Debug, Clone)]
pub struct AttractorMorph {
    morph: Arc<Morph>,
    mode: ColorMode,
    /// Colours by label at every key.
    colors: Arc<Vec<Vec<[f32; 3]>>>,
    seed: u64,
    points: u64,
    extent: Extent,
    /// Table point that lies at the origin of the asset.
    origin: DVec3,
    /// Metres per table unit.
    scale: f64,
}

impl AttractorMorph {
    /// The morph of a recipe's attractor. `origin`: point, in table units, that becomes the asset's origin; `scale`: metres per
    /// table unit.
    pub fn new(recipe: &AttractorRecipe, morph: &MorphRecipe, seed: u64, origin: DVec3, scale: f64) -> Self {
        let keys = &recipe.keys;
        let mode = color_mode(keys.color_by, keys.prefix);
        let rows = morph.rows.iter().zip(morph.morph.keys());
        let colors = rows.map(|(row, key)| {
            let own = if row.colors.is_empty() { &keys.colors } else { &row.colors };
            ColorLabels::new(&key.system, mode, own).colors
        });
        Self {
            mode,
            colors: Arc::new(colors.collect()),
            morph: Arc::clone(&morph.morph),
            seed,
            points: u64::from(keys.points),
            extent: recipe.extent,
            origin,
            scale,
        }
    }

    /// Points, labels and colours at `seconds` after the first frame, in the asset's space.
    pub fn points_at(&self, seconds: f64) -> AttractorPoints {
        let system = self.morph.system(seconds);
        let mut labels = ColorLabels::new(&system, self.mode, &[]);
        // The labels are those of the interpolated system, the colours are interpolated between keys.
        labels.colors = self.colors_at(seconds);
        let study = self.morph.study(seconds);
        let request = DrawRequest {
            system: &system,
            study: &study,
            seed: self.seed,
            points: self.points,
            tier: InstructionSet::Best,
        };
        cloud(&request, &labels, &self.extent, self.origin, self.scale)
    }

    /// Colours by label, interpolated linearly between keys.
    fn colors_at(&self, seconds: f64) -> Vec<[f32; 3]> {
        let (k, t) = self.morph.place(seconds);
        let t = narrow(t);
        let (Some(a), b) = (self.colors.get(k), self.colors.get(k + 1)) else { return Vec::new() };
        let mixed = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|i| lerp(a[i], b[i], t));
        b.map_or_else(|| a.clone(), |b| a.iter().zip(b).map(mixed).collect())
    }

    /// Positions at `seconds` of the points whose addresses were drawn with the probabilities of time `words`.
    fn positions_of_words(&self, seconds: f64, words: f64) -> Vec<Vec3> {
        let system = self.morph.system(seconds);
        let study = self.morph.study(words);
        let labels = ColorLabels::new(&system, ColorMode::Map, &[]);
        let request = DrawRequest {
            system: &system,
            study: &study,
            seed: self.seed,
            points: self.points,
            tier: InstructionSet::Best,
        };
        cloud(&request, &labels, &self.extent, self.origin, self.scale).positions
    }

    /// Box around a sample of the points at times from the first key to the last, m.
    pub fn swept_bounds(&self) -> Bounds {
        let (first, last) = (self.morph.keys().first(), self.morph.keys().last());
        let (Some(a), Some(b)) = (first.map(|k| k.at), last.map(|k| k.at)) else { return Bounds::default() };
        let sample = Self { points: self.points.min(BOUND_POINTS), ..self.clone() };
        let time = |i: u32| a + (b - a) * f64::from(i) / f64::from(BOUND_STEPS);
        (0..=BOUND_STEPS)
            .fold(Bounds::default(), |reach, i| reach.union(Bounds::of(sample.positions_of_words(time(i), time(i)))))
    }

    /// Own: the velocity of a point is that of the image of its word, as the mean over the frame around it.
    fn evaluate(&self, asset: &Asset, seconds: f64, step: f64) -> AssetFrame {
        let Some(rest) = asset.points.first() else { return AssetFrame::default() };
        // Central difference over one frame, of points that keep their addresses.
        let now = self.points_at(seconds);
        let half = 0.5 * step;
        let (before, after) =
            (self.positions_of_words(seconds - half, seconds), self.positions_of_words(seconds + half, seconds));
        let rate = narrow(step.recip());
        let velocities = after.iter().zip(&before).map(|(a, b)| (*a - *b) * rate).collect();
        // Colours are written only if they can change from frame to frame.
        let recolored = self.colors.windows(2).any(|w| w[0] != w[1]) || self.mode == ColorMode::Coord;
        let colors = if recolored { now.colors } else { Vec::new() };
        let state = PointsFrame::State { positions: now.positions, widths: rest.widths.clone(), velocities, colors };
        AssetFrame { points: vec![state], ..AssetFrame::default() }
    }
}

impl AssetMotion for AttractorMorph {
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.evaluate(asset, time.seconds, time.step))
    }
}
