//! A scene together with the motions of its assets.

use std::sync::Arc;

use crate::bake::motion::AssetMotion;
use crate::bake::wind::output::WindOutput;
use osier_scene::Scene;

/// A scene with what moves in it.
#[derive(Debug, Clone)]
pub struct AnimatedScene {
    /// The scene at rest.
    pub scene: Arc<Scene>,
    /// Motions, parallel to the assets; `None` for an asset that stands still.
    pub motions: Vec<Option<Arc<dyn AssetMotion>>>,
    /// Samples the wind for files of `[output.wind]`, if the recipe has any.
    pub wind: Option<Arc<WindOutput>>,
}
