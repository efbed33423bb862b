//! A scene together with the motions of its assets.

use std::sync::Arc;

use crate::bake::motion::AssetMotion;
use crate::bake::wind::output::WindGridSampler;
use osier_scene::Scene;

/// A scene at rest, the motions of its assets, and its exported wind.
#[derive(Debug, Clone)]
pub struct AnimatedScene {
    /// The scene at rest, which does not change over the clip.
    pub scene: Arc<Scene>,
    /// Motions, parallel to the assets; `None` for an asset that stands still.
    pub motions: Vec<Option<Arc<dyn AssetMotion>>>,
    /// Samples the wind for `[output.wind]`; `None` if the recipe exports none.
    pub wind: Option<Arc<WindGridSampler>>,
}
