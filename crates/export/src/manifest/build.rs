//! Building the manifest from a scene and the list of finished files.

use std::collections::BTreeMap;

use super::leaves::leaves_entry;
use super::places::places_entry;
use super::view::view_entry;
use super::{
    AssetEntry, FileEntry, ItemEntry, Manifest, MaterialEntry, ParamsEntry, SceneEntry, Settings, TimeEntry,
    UnitsEntry, WarningEntry, bake_hash,
};
use crate::exr;
use crate::pc2::cache_path;
use crate::registry::FORMATS;
use crate::usd::{ASSET_STAGE, HAIRS};
use crate::{VERSION, Warning};
use osier_base::files::{FileRecord, MANIFEST};
use osier_scene::{
    Asset, AssetFrame, Clip, Coat, Material, MaterialClass, MaterialId, MeshMotion, Scene, asset_bounds,
};

impl Default for UnitsEntry {
    fn default() -> Self {
        Self {
            height_range_m: HEIGHT_RANGE,
            wetness: "0..1".into(),
            pov_units_per_m: 100.0,
            wet_albedo: Coat::WET_ALBEDO,
            wet_roughness: Coat::WET_ROUGHNESS,
        }
    }
}

/// Height for the value 1 of leaf maps in a scene without such maps, m.
const HEIGHT_RANGE: f32 = 0.004;

/// Builds the manifest. `files`: the folder's finished files; `warnings`: of the scene and of all exporters, in asset order.
pub fn build(scene: &Scene, files: &[FileRecord], warnings: &[Warning], settings: &Settings) -> Manifest {
    let files = grouped(files, scene.clip);
    let paths: Vec<&str> = files.iter().map(path).collect();
    let maps = material_map_paths(&files);
    let is_leaf = |m: &&Material| m.class == MaterialClass::Leaf && m.maps.height.is_some();
    // Without map sequences the range is that of the height maps of the leaf materials.
    let dry = || scene.materials.iter().find(is_leaf).map(|m| m.height_range);
    let height = scene.map_sequences.first().map(|s| s.height_range).or_else(dry).unwrap_or(HEIGHT_RANGE);
    let mut manifest = Manifest {
        schema: 1,
        generator: "osier".into(),
        version: VERSION.into(),
        scene: SceneEntry {
            name: scene.name.clone(),
            hash: settings.hash.clone().unwrap_or_else(|| scene.hash.clone()),
        },
        seed: scene.seed.to_string(),
        up_axis: settings.up_axis.clone(),
        meters_per_unit: 1.0,
        time: TimeEntry {
            fps: [scene.clip.fps.0, scene.clip.fps.1],
            start: scene.clip.start,
            end: scene.clip.end,
            written: Some(settings.written.unwrap_or([scene.clip.start, scene.clip.end])),
            loop_frames: settings.loop_frames,
            step: settings.step,
            substeps: settings.substeps,
            digits: scene.clip.digits(),
        },
        units: UnitsEntry {
            height_range_m: height,
            pov_units_per_m: settings.pov_units_per_m,
            ..UnitsEntry::default()
        },
        stage: paths.contains(&ASSET_STAGE).then(|| ASSET_STAGE.to_owned()),
        view: Some(view_entry(scene, &paths, settings)),
        assets: scene.assets.iter().map(|a| asset_entry(scene, a, &paths)).collect(),
        places: places_entry(scene, &paths),
        materials: material_entries(scene, [&paths, &maps]),
        files: Vec::new(),
        bake_hash: String::new(),
        warnings: warnings.iter().map(|w| WarningEntry { code: w.code.into(), message: w.message.clone() }).collect(),
    };
    manifest.files = files;
    manifest.bake_hash = bake_hash(&manifest.expanded());
    manifest
}

fn path(file: &FileEntry) -> &str {
    match file {
        FileEntry::Single { path, .. } | FileEntry::Sequence { path, .. } => path,
    }
}

/// Paths of the files that can be maps of a material. Heights of the terrain and fields of frames are excluded,
/// although their folder may have the name of a material.
fn material_map_paths(files: &[FileEntry]) -> Vec<&str> {
    let is_map = |file: &&FileEntry| match file {
        FileEntry::Single { kind, .. } | FileEntry::Sequence { kind, .. } => {
            ![exr::TERRAIN_KIND, exr::FIELD_KIND].contains(&kind.as_str())
        }
    };
    files.iter().filter(is_map).map(path).collect()
}

/// The files in the order of paths, numbered ones grouped into sequences.
fn grouped(files: &[FileRecord], clip: Clip) -> Vec<FileEntry> {
    let mut entries: BTreeMap<String, FileEntry> = BTreeMap::new();
    let mut sorted: Vec<&FileRecord> = files.iter().filter(|f| f.path != MANIFEST).collect();
    // Sorted by frame, so that the items of a sequence arrive in order and its last frame is the latest one seen.
    sorted.sort_by(|a, b| (a.frame, &a.path).cmp(&(b.frame, &b.path)));
    for file in sorted {
        let pattern = file.frame.and_then(|f| numbered(&file.path, &clip.tag(f)));
        let (Some(pattern), Some(frame)) = (pattern, file.frame) else {
            let (path, kind) = (file.path.clone(), file.kind.to_owned());
            let single = FileEntry::Single { path, kind, bytes: file.bytes, blake3: file.blake3.clone() };
            entries.insert(file.path.clone(), single);
            continue;
        };
        let item = ItemEntry { frame, bytes: file.bytes, blake3: file.blake3.clone() };
        match entries.get_mut(&pattern) {
            Some(FileEntry::Sequence { frames, bytes, items, .. }) => {
                frames[1] = frame;
                *bytes += item.bytes;
                items.push(item);
            }
            _ => {
                let (path, kind, bytes) = (pattern.clone(), file.kind.to_owned(), item.bytes);
                let entry = FileEntry::Sequence { path, kind, frames: [frame, frame], bytes, items: vec![item] };
                entries.insert(pattern, entry);
            }
        }
    }
    entries.into_values().collect()
}

/// `a/frame.0001.inc` with the tag `0001` as `a/frame.####.inc`, `a/drops_0001.csv` as `a/drops_####.csv`: the last tag between
/// dots is replaced, or else the last one between an underscore and a dot.
fn numbered(path: &str, tag: &str) -> Option<String> {
    let replaced = |before: char| {
        let wanted = format!("{before}{tag}.");
        // Replace the last match: a folder or an asset may have the same digits in its name.
        let at = path.rfind(&wanted)?;
        Some(format!("{}{before}####.{}", &path[..at], &path[at + wanted.len()..]))
    };
    replaced('.').or_else(|| replaced('_'))
}

fn asset_entry(scene: &Scene, asset: &Asset, paths: &[&str]) -> AssetEntry {
    // Point caches of an asset with several deforming meshes have the names of these as well.
    let deforming = asset.meshes.iter().filter(|m| m.motion == MeshMotion::Deforming);
    let caches: Vec<String> = deforming.map(|m| cache_path(asset, m)).collect();
    let mine = |path: &str| {
        let named = path.split_once('/').is_some_and(|(folder, name)| {
            FORMATS.iter().any(|f| f.names_assets && f.folder == folder)
                && name.split('.').next() == Some(asset.id.as_str())
        });
        named || caches.iter().any(|cache| cache == path)
    };
    let bounds = asset_bounds(asset, &AssetFrame::default());
    // An empty box has infinite corners, which JSON cannot hold: zeros are written.
    let corners = if bounds.is_empty() { [[0.0; 3]; 2] } else { [bounds.min, bounds.max].map(|v| v.to_array()) };
    let material = |id: u32| scene.materials.get(id as usize).map(|m| m.name.clone());
    let prototypes = asset.instancers.iter().flat_map(|i| &i.prototypes);
    let hairs = prototypes.filter_map(|p| p.fine.as_ref()).map(|fine| (HAIRS, fine.curves.material));
    let curves = hairs.chain(asset.curves.iter().map(|c| (c.name.as_str(), c.material)));
    AssetEntry {
        id: asset.id.clone(),
        kind: asset.kind.word().into(),
        plant: (!asset.group.is_empty()).then(|| asset.group.clone()),
        points_material: asset.points.first().and_then(|points| material(points.material)),
        curve_materials: curves.filter_map(|(name, id)| Some((name.to_owned(), material(id)?))).collect(),
        prim: format!("/{}", asset.id),
        files: paths.iter().filter(|p| **p != ASSET_STAGE && mine(p)).map(|p| (*p).to_owned()).collect(),
        vertices: asset.meshes.iter().map(|m| m.mesh.points.len()).sum(),
        triangles: asset.meshes.iter().map(|m| m.mesh.triangles.len()).sum(),
        instances: asset.instancers.iter().map(osier_scene::Instancer::len).sum(),
        joints: asset.skeleton.as_ref().map_or(0, |s| s.joints.len()),
        // Adding 0 turns -0 into 0: equal values have equal text.
        bounds: corners.map(|c| c.map(|v| v + 0.0)),
        leaves: leaves_entry(asset, paths),
    }
}

/// EXR files in any of the `folders` of `maps/` by their names up to the first dot.
fn map_paths(folders: &[&str], paths: &[&str]) -> BTreeMap<String, String> {
    let map = |path: &&str| {
        let (folder, name) = path.strip_prefix("maps/")?.split_once('/')?;
        let mine = folders.contains(&folder) && name.ends_with(".exr");
        mine.then(|| (name.split('.').next().unwrap_or(name).to_owned(), (*path).to_owned()))
    };
    // Sequences come last: the relief with its water replaces the dry relief, which has the same name.
    let (numbered, constant): (Vec<&str>, Vec<&str>) = paths.iter().copied().partition(|path| path.contains("####"));
    constant.iter().chain(&numbered).filter_map(map).collect()
}

/// Whether the material is used, and all meshes and points that use it have vertex colours.
fn has_vertex_colors(scene: &Scene, id: MaterialId) -> bool {
    let prototypes = scene.assets.iter().flat_map(|a| &a.instancers).flat_map(|i| &i.prototypes).map(|p| &p.mesh);
    let meshes = scene.assets.iter().flat_map(|a| &a.meshes).map(|m| &m.mesh).chain(prototypes);
    let meshes = meshes.filter(|m| m.subsets.iter().any(|s| s.material == id)).map(|m| m.colors.is_empty());
    let clouds = scene.assets.iter().flat_map(|a| &a.points).filter(|p| p.material == id).map(|p| p.colors.is_empty());
    let mut plain = meshes.chain(clouds).peekable();
    plain.peek().is_some() && !plain.any(|is_plain| is_plain)
}

/// The materials that the scene uses; `files`: the two lists of [`material_entry`].
fn material_entries(scene: &Scene, files: [&[&str]; 2]) -> Vec<MaterialEntry> {
    let all = (0..).zip(&scene.materials).zip(scene.used_materials()).filter(|(_, is_used)| *is_used);
    all.map(|((id, material), _)| material_entry(scene, id, material, files)).collect()
}

/// `paths`: paths of all files, and of those that can be maps of a material.
fn material_entry(scene: &Scene, id: MaterialId, m: &Material, [paths, maps]: [&[&str]; 2]) -> MaterialEntry {
    let picture = |slot: &str, image: Option<u32>| {
        let name = &scene.images.get(image? as usize)?.name;
        let path = format!("textures/{name}.png");
        paths.contains(&path.as_str()).then(|| (slot.to_owned(), path))
    };
    let slots = [
        picture("color", m.maps.color),
        picture("height", m.maps.height),
        picture("normal", m.maps.normal),
        picture("rough", m.maps.roughness),
    ];
    // Maps that change with the frames are in folders named after the material or its map sequence.
    let sequence = m.coat.and_then(|c| scene.map_sequences.get(c.sequence as usize)).map(|s| s.name.clone());
    let porous_coat = m.coat.filter(|_| m.class == MaterialClass::Bark);
    let folders: Vec<&str> = std::iter::once(m.name.as_str()).chain(sequence.as_deref()).collect();
    MaterialEntry {
        name: m.name.clone(),
        class: m.class.word().into(),
        slots: slots.into_iter().flatten().collect(),
        maps: map_paths(&folders, maps),
        leaf_ids: sequence.into_iter().collect(),
        params: ParamsEntry {
            base_color: m.base_color,
            roughness: m.roughness,
            ior: m.ior,
            translucency: m.translucency,
            alpha_cutoff: m.alpha_cutoff,
            height_range_m: m.height_range,
            tile_m: m.tile,
            vertex_colors: has_vertex_colors(scene, id),
            wet_albedo: porous_coat.map(|c| c.darkening),
            wet_roughness: porous_coat.map(|_| Coat::POROUS_WET_ROUGHNESS),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_taken_where_it_stands_between_dots_or_after_an_underscore() {
        assert_eq!(numbered("pov/frames/frame.0007.inc", "0007").as_deref(), Some("pov/frames/frame.####.inc"));
        assert_eq!(numbered("cloud/a0007.0007.ply", "0007").as_deref(), Some("cloud/a0007.####.ply"));
        assert_eq!(numbered("points/drops_0007.csv", "0007").as_deref(), Some("points/drops_####.csv"));
        assert_eq!(numbered("cloud/a_0007.leaves.0007.ply", "0007").as_deref(), Some("cloud/a_0007.leaves.####.ply"));
        assert_eq!(numbered("cloud/a0007.ply", "0007"), None);
    }

    #[test]
    fn heights_of_the_terrain_and_fields_are_no_maps_of_a_material() {
        let file = |path: &str, kind: &str| FileEntry::Single {
            path: path.into(),
            kind: kind.into(),
            bytes: 1,
            blake3: String::new(),
        };
        let files = [
            file("maps/deposition/ground.exr", exr::FIELD_KIND),
            file("maps/leaf/height.exr", "exr.height"),
            file("maps/terrain/height.exr", exr::TERRAIN_KIND),
        ];
        assert_eq!(material_map_paths(&files), ["maps/leaf/height.exr"]);
    }

    #[test]
    fn maps_of_frames_stand_before_constant_ones_of_the_same_name() {
        let paths = [
            "maps/leaf_l0/height.####.exr",
            "maps/leaf_l0/height.####.png",
            "maps/leaf_l0/height.exr",
            "maps/leaf_l1/water.####.exr",
            "maps/sky.exr",
            "usd/leaf_l0.usdc",
        ];
        let of = |folders: &[&str]| map_paths(folders, &paths).into_iter().collect::<Vec<_>>();
        assert_eq!(of(&["leaf_l0"]), [("height".to_owned(), "maps/leaf_l0/height.####.exr".to_owned())]);
        assert_eq!(of(&["bark", "leaf_l1"]), [("water".to_owned(), "maps/leaf_l1/water.####.exr".to_owned())]);
    }
}
