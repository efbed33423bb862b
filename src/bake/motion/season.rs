//! Leaves of a plant that unfold, turn and fall over the clip.

use crate::bake::assets::material_set::PlantMaterials;
use crate::bake::assets::seasons::SeasonClip;
use crate::bake::motion::growth::organs_by_instancer;
use crate::bake::motion::{AssetMotion, FrameTime};
use osier_base::Result;
use osier_scene::plant::{Organ, Plant};
use osier_scene::{
    Asset, AssetFrame, Attribute, AttributeData, InstanceState, InstancerFrame, InstancerMotion, LEAF_COLOR, MeshFrame,
};

/// Motion of a plant's leaves through the seasons of a clip. A leaf has one instance for each of its appearances, of which one
/// is visible.
#[derive(Debug)]
pub struct SeasonMotion {
    plant: Plant,
    season: SeasonClip,
    /// Indices into the plant's organs for each of the asset's instancers, in the order of instances.
    organs: Vec<Vec<usize>>,
    /// Length of the clip, s.
    seconds: f64,
}

impl SeasonMotion {
    /// The motion of a plant that `season` has given its leaves of all appearances. `seconds`: length of the clip.
    pub fn new(plant: &Plant, materials: &PlantMaterials, season: &SeasonClip, seconds: f64) -> Self {
        let organs = organs_by_instancer(plant, materials);
        Self { plant: plant.clone(), season: season.clone(), organs, seconds }
    }

    /// Marks the instancers of an asset as free, so that instances can appear and vanish, and gives them the state of the first
    /// frame.
    pub fn prepare(&self, asset: &mut Asset) {
        for (instancer, organs) in asset.instancers.iter_mut().zip(&self.organs) {
            instancer.motion = InstancerMotion::Free;
            let kept = std::mem::take(&mut instancer.rest.attributes);
            instancer.rest = self.instancer_state(organs, 0.0);
            instancer.rest.attributes.extend(kept.into_iter().filter(|a| a.name != LEAF_COLOR));
        }
    }

    /// State of an instancer at a share of the clip, 0..1: transforms, visibility, sizes and leaf colours.
    fn instancer_state(&self, organs: &[usize], share: f64) -> InstanceState {
        let season = self.season.season_at_share(share);
        let (mut state, mut colors) = (InstanceState::default(), Vec::with_capacity(organs.len()));
        for number in organs {
            let organ = &self.plant.organs[*number];
            let now = self.season.slots.at(organ, *number, season);
            let (position, orientation) = self.plant.organ_site(&Organ { q: now.q, ..organ.clone() });
            state.positions.push(position);
            state.orientations.push(orientation);
            state.alive.push(now.size > 0.0);
            state.sizes.push(now.size);
            colors.push(now.color);
        }
        state.attributes = vec![Attribute::instance(LEAF_COLOR, AttributeData::Unit4(colors))];
        state
    }
}

impl AssetMotion for SeasonMotion {
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        let share = if self.seconds > 0.0 { (time.seconds / self.seconds).clamp(0.0, 1.0) } else { 0.0 };
        let state = |i: usize| match self.organs.get(i) {
            Some(organs) => InstancerFrame::State(self.instancer_state(organs, share)),
            None => InstancerFrame::Same,
        };
        Ok(AssetFrame {
            meshes: asset.meshes.iter().map(|_| MeshFrame::Same).collect(),
            instancers: (0..asset.instancers.len()).map(state).collect(),
            ..AssetFrame::default()
        })
    }
}
