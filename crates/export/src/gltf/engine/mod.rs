//! Profile `engine`: plain glTF for game engines. A plant is one mesh per level of detail, all with one skin; placements are a
//! table beside the files.

mod levels;

use serde::Serialize;

use self::levels::{PlantLevel, PlantSource, is_merged, to_float};
use super::Profile;
use super::asset_nodes::{AssetNodes, NodeParent, NodeTemplate};
use super::document::{GeometryKind, GltfDocument, GltfInput};
use super::json::{LevelExtras, MeshExtras};
use super::meshes::MeshSource;
use super::rig::JointSelection;
use super::text::to_json;
use super::wind_channels::{SECOND_UV, VertexWind, WindChannels};
use crate::GENERATOR;
use osier_base::Result;
use osier_scene::{Asset, AssetKind, Attribute, AttributeData, InstancerMotion, MeshObject, Placement, Trs};

/// Triangles of a level as a share of those of level 0. Own: each is drawn from about half the distance of the next.
const LEVEL_SHARES: [f64; 4] = [1.0, 1.0 / 4.0, 1.0 / 12.0, 1.0 / 60.0];
/// A level with more than this share of the triangles of the one before it is left out.
const WORTHWHILE: f64 = 0.8;

impl GltfDocument<'_> {
    /// Whether an asset is written as levels of detail: plants of profile `engine` with meshes or
    /// instances that the levels can hold.
    pub(super) fn has_levels(&self, asset: &Asset) -> bool {
        self.input.options.profile == Profile::Engine
            && asset.kind == AssetKind::Plant
            && (asset.meshes.iter().any(is_merged)
                || asset.instancers.iter().any(|i| i.motion != InstancerMotion::Free))
    }

    /// Whether a mesh is part of the levels of its asset, and thus not written separately.
    pub(super) fn is_in_levels(&self, asset: &Asset, object: &MeshObject) -> bool {
        self.has_levels(asset) && is_merged(object)
    }

    /// Adds the levels of a plant: a mesh and a node `<plant>_LOD<n>` for each, with one skin for all.
    pub(super) fn add_levels(
        &mut self,
        nodes: &mut AssetNodes,
        asset: &Asset,
        selection: Option<&JointSelection>,
    ) -> Result<()> {
        let label = format!("asset {}, level of detail", asset.id);
        let source = PlantSource::new(asset, selection, &label);
        let mut levels: Vec<PlantLevel> = Vec::new();
        let finest = source.triangles().min(self.input.options.level_triangles);
        // A level that saves little over the one before is left out.
        for share in LEVEL_SHARES {
            let level = source.level(share_of(finest, share))?;
            let last = levels.last().map_or(usize::MAX, |l| l.mesh.triangles.len());
            if level.mesh.triangles.is_empty() {
                break;
            }
            if level.mesh.triangles.len() < share_of(last, WORTHWHILE) {
                levels.push(level);
            }
        }
        let counts: Vec<usize> = levels.iter().map(|l| l.mesh.triangles.len()).collect();
        // All levels share their materials; whether the leaves of the finest level are thinned decides which materials.
        let is_thinned = levels.first().is_some_and(|l| l.leaf_size > 1.0);
        let geometry = if is_thinned { GeometryKind::ThinnedPlant } else { GeometryKind::Mesh };
        // The finest level first, each as a mesh with what a program needs to choose among them.
        for (lod, level) in levels.into_iter().enumerate() {
            let name = format!("{}_LOD{lod}", asset.id);
            let skin = selection.and_then(|s| level.influences(s.kept.len()));
            let parent = if skin.is_some() { NodeParent::Skin } else { NodeParent::Placement };
            let extras = LevelExtras {
                lod,
                triangles: counts[lod],
                plant_triangles: source.triangles(),
                leaf_size: (level.leaf_size > 0.0).then_some(level.leaf_size),
                screen: screen_share(&counts, lod),
                channels: self.input.options.channels.map(|c| c.words()).unwrap_or_default(),
            };
            let mesh = with_wind(level, self.input.options.channels.as_ref());
            let mesh_source = MeshSource { geometry, skin: skin.as_ref(), ..MeshSource::of(&name, &label, &mesh) };
            if let Some(mesh) = self.add_mesh(mesh_source)? {
                if let Some(json) = self.root.meshes.get_mut(mesh.index as usize) {
                    json.extras = Some(MeshExtras { target_names: Vec::new(), osier: Some(extras) });
                }
                nodes.templates.push(NodeTemplate::new(&name, "mesh", mesh, parent));
            }
        }
        Ok(())
    }
}

/// The mesh of a level with the attributes of its wind: vertex colours if channels were chosen, else `wind` and `wind2` where the
/// plant has them.
fn with_wind(level: PlantLevel, channels: Option<&WindChannels>) -> osier_scene::Mesh {
    let PlantLevel { mut mesh, wind, .. } = level;
    let sways = wind.iter().any(|w| *w != VertexWind { flutter: w.flutter, id: w.id, ..VertexWind::STILL });
    if let Some(channels) = channels {
        mesh.colors = wind.iter().map(|w| channels.color_of(w)).collect();
        if channels.second_uv.is_some() {
            let pairs = wind.iter().map(|w| channels.second_uv_of(w)).collect();
            mesh.attributes.push(Attribute::vertex(SECOND_UV, AttributeData::Unit2(pairs)));
        }
    } else if sways {
        let quads = wind.iter().map(|w| [w.sway, w.phase, w.flutter, w.light]).collect();
        let pairs = wind.iter().map(|w| [w.branch, w.id]).collect();
        mesh.attributes.push(Attribute::vertex("wind", AttributeData::Unit4(quads)));
        mesh.attributes.push(Attribute::vertex("wind2", AttributeData::Unit2(pairs)));
    }
    mesh
}

/// Smallest height of the plant on screen, as a share of the picture's height, for level `lod`; 0 for the coarsest. At this
/// height the next level has as many triangles per area as level 0 at full height: s^2 = n(lod + 1) / n(0).
fn screen_share(counts: &[usize], lod: usize) -> f32 {
    let (Some(first), Some(next)) = (counts.first(), counts.get(lod + 1)) else { return 0.0 };
    osier_base::math::narrow(osier_base::math::sqrt(to_float(*next) / to_float(*first).max(1.0)))
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a number of triangles")]
fn share_of(n: usize, share: f64) -> usize {
    (to_float(n) * share) as usize
}

/// The table of placements beside the files of profile `engine`.
#[derive(Debug, Serialize)]
struct PlacementTable<'a> {
    generator: &'a str,
    scene: &'a str,
    hash: &'a str,
    fps: [u32; 2],
    start: u32,
    end: u32,
    /// One for each asset with a file, in the order of the scene.
    files: Vec<PlacedFile>,
}

/// Placements of a file: position, m; rotation as x, y, z, w; scale as one or three numbers. `ahead`: frames by which the motion
/// of each is ahead, empty if all are 0.
#[derive(Debug, Serialize)]
struct PlacedFile {
    file: String,
    copies: Vec<Vec<f32>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ahead: Vec<u32>,
}

/// The table of placements of a scene as JSON; `written`: whether the asset of an index has a file, whose name is that of the
/// asset.
pub(super) fn placement_table(input: GltfInput<'_>, written: &[bool]) -> Result<Vec<u8>> {
    let scene = input.scene;
    let place = |p: &Placement| -> Vec<f32> {
        let Trs { t, r, s } = p.transform;
        // q and -q are one rotation; w >= 0 makes the table unique.
        let r = if r.w < 0.0 { -r } else { r };
        let scale = if s.x.to_bits() == s.y.to_bits() && s.x.to_bits() == s.z.to_bits() {
            vec![s.x]
        } else {
            s.to_array().to_vec()
        };
        [t.to_array().as_slice(), r.to_array().as_slice(), scale.as_slice()].concat()
    };
    let of = |(index, asset): (usize, &Asset)| {
        let list: Vec<&Placement> = scene.placements.iter().filter(|p| p.asset == index).collect();
        let moves = list.iter().any(|p| p.phase > 0);
        PlacedFile {
            file: format!("{}.{}.glb", asset.id, input.options.profile.word()),
            copies: list.iter().map(|p| place(p)).collect(),
            ahead: if moves { list.iter().map(|p| p.phase).collect() } else { Vec::new() },
        }
    };
    let files = scene.assets.iter().enumerate().filter(|(i, _)| written.get(*i) == Some(&true));
    let table = PlacementTable {
        generator: GENERATOR,
        scene: &scene.name,
        hash: &scene.hash,
        fps: scene.clip.fps.into(),
        start: scene.clip.start,
        end: scene.clip.end,
        files: files.map(of).collect(),
    };
    to_json(&table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_used_down_to_the_size_at_which_the_next_is_as_dense() {
        let counts = [60_000, 15_000, 5_000, 1_000];
        let shares: Vec<f32> = (0..4).map(|l| screen_share(&counts, l)).collect();
        assert!((shares[0] - 0.5).abs() < 1e-6 && (shares[1] - 0.288_675).abs() < 1e-5 && shares[3].to_bits() == 0);
        assert!(shares.windows(2).all(|w| w[1] < w[0]));
    }
}
