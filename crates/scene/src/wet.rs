//! Water on leaves as maps that change from frame to frame.

use std::sync::Arc;

use super::{Frame, Scene};

/// Colour of a wet leaf as a share of that of a dry one, under the same light: light is caught in the film of water. All that
/// darkens by wetness w multiplies by 1 + w (this - 1). Own: chosen by eye against photographs of wet leaves, 0.4..0.8.
pub const WET_ALBEDO: f32 = 0.55;

/// A sheet on which water lies: maps of its own over its texture coordinates.
#[derive(Debug, Clone)]
pub struct Wet {
    /// Folder in `maps/`, `[a-z0-9_]+`, unique in the scene: `twig_l0012`.
    pub name: String,
    /// Texels of a side.
    pub side: usize,
    /// Height that 1 in a height map stands for, m.
    pub height_range: f32,
    /// The maps where nothing moves; none before the first frame.
    pub rest: Option<Arc<WetMaps>>,
}

/// Maps of one sheet at one frame: `side * side` texels, row 0 at v = 1. Two frames that share one value are equal.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WetMaps {
    /// Relief of the sheet and water on it, m.
    pub height: Vec<f32>,
    /// Water alone, m; empty where the sheet has no relief, and its height is that of the water.
    pub water: Vec<f32>,
    /// How wet, 0 to 1.
    pub wetness: Vec<f32>,
    /// Unit normals in tangent space of relief and water: along u, along v, out.
    pub normal: Vec<[f32; 3]>,
}

impl WetMaps {
    /// Height of water alone, m, one per texel.
    pub fn water(&self) -> &[f32] {
        if self.water.is_empty() { &self.height } else { &self.water }
    }
}

impl Scene {
    /// The maps of each sheet at a frame: the frame's, or those at rest.
    pub fn wet_now(&self, frame: Option<&Frame>) -> Vec<Option<Arc<WetMaps>>> {
        let of = |(i, sheet): (usize, &Wet)| frame.and_then(|f| f.wet.get(i)).or(sheet.rest.as_ref()).cloned();
        self.wet.iter().enumerate().map(of).collect()
    }
}
