//! glTF 2.0: one binary file per asset and one for the whole scene, in three profiles.
//!
//! `web` writes instances by extension and omits keys that interpolation restores; `blender` merges instances into meshes and
//! keeps every key; `engine` requires no extension and has plants in levels of detail, with a file per plant. A file has one
//! animation: viewers and Blender's importer play the first one.
//!
//! ```
//! use osier_base::files::Folder;
//! use osier_export::gltf::{GltfOptions, GltfTarget, Profile};
//!
//! // The whole scene in one file for viewers, without animation at frame 12.
//! let target = GltfTarget::Glb("oak.glb".into());
//! let options = GltfOptions { profile: Profile::Web, target, frame: Some(12), ..GltfOptions::default() };
//! assert_eq!(options.profile.word(), "web");
//! ```

mod assemble;
mod asset_nodes;
mod blades;
mod buffer;
mod container;
mod copies;
mod document;
mod engine;
mod hidden_parts;
mod instances;
mod json;
mod keys;
mod leaf_shapes;
mod light_leaves;
mod materials;
mod meshes;
mod meshopt;
mod morph_shape;
pub(crate) mod options;
mod quantize;
mod rig;
mod simplify;
mod stream;
pub(super) mod submeshes;
mod tangents;
mod text;
mod tracks;
mod wind_channels;

pub use options::{GltfOptions, GltfTarget, Profile, SKINS};
pub use wind_channels::{WindChannel, WindChannels, WindNumber};

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;

use self::assemble::GltfContents;
use self::document::{GltfDocument, GltfInput};
use self::light_leaves::LightLeaves;
use self::tracks::ClipTracks;
use super::estimate::{AssetSize, EstimateInput};
use super::file_target::file_stem;
use super::format::{ExportJob, FormatInfo, TextureUse};
use super::textures::Textures;
use super::{Exporter, Summary, Warning};
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{Asset, Frame, Scene, check_frame, check_scene, freeze};

/// Registry entry of glTF: one exporter for each profile.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "glb",
    about: "glTF: the whole scene in one file per profile, optionally one per asset; animated",
    folder: "gltf",
    names_assets: true,
    notes_missing_files: false,
    endings: &[("glb", "glTF in one file, pictures inside"), ("gltf", "glTF as JSON, data and pictures beside it")],
    pictures_beside: false,
    textures: TextureUse::Written,
    memory_percent: 112,
    estimate,
    open,
};

/// Opens an exporter for each profile. The ending of a single file decides between binary and text.
fn open(job: &ExportJob) -> Vec<Box<dyn Exporter>> {
    let bake = &job.options.gltf;
    let open = |profile: &Profile| -> Box<dyn Exporter> {
        let profile = *profile;
        let options = match job.file {
            None => GltfOptions { profile, target: GltfTarget::Bake, ..bake.clone() },
            Some(name) => {
                let name = name.to_owned();
                let is_text = name.to_ascii_lowercase().ends_with(".gltf");
                let target = if is_text { GltfTarget::Gltf(name) } else { GltfTarget::Glb(name) };
                GltfOptions { profile, target, assets: true, frame: None, ..bake.clone() }
            }
        };
        Box::new(GltfExporter::new(job.folder.clone(), Arc::clone(&job.textures), options))
    };
    job.options.gltf_profiles.iter().map(open).collect()
}

/// Ratio of the bytes of all PNG images of a scene, height maps included, to those of the JPEG images in its glTF file,
/// which has no height maps. Own: measured on presets as 4.9 to 5.7, more where a plant uses little of its pictures;
/// for estimates only.
const JPEG_RATIO: u64 = 5;

/// Size of floating-point vertices and triangles divided by their compressed size, percent. Own: measured on leaves and bark.
const MESHOPT_RATIO_PERCENT: u64 = 350;
/// Bytes of a compressed instance, which has 32 without compression. Own: measured on leaves of birches and oaks.
const MESHOPT_INSTANCE_BYTES: u64 = 18;

/// Bytes per vertex of the attributes by which shaders sway copies that are written at rest. Own: measured.
const WIND_BYTES: u64 = 32;
/// As [`WIND_BYTES`], after compression.
const MESHOPT_WIND_BYTES: u64 = 3;

/// Estimate from bytes per vertex, triangle, instance and key in binary files, summed over the profiles.
fn estimate(input: &EstimateInput) -> u64 {
    let options = &input.options.gltf;
    // An asset is in the file of the scene, and in a separate file if those are written. Images are embedded in both.
    let own_files = |profile: &Profile| u64::from(options.assets && !input.single && *profile != Profile::Engine);
    let most_nodes = if options.frame.is_some() { 0 } else { options.nodes as u64 };
    let standing = standing_copies(input);
    let profile_bytes = |profile: &Profile| {
        let pictures = if *profile != Profile::Blender { input.pictures / JPEG_RATIO } else { input.pictures };
        let files = 1 + own_files(profile);
        let of_asset = |(a, standing): (&AssetSize, &u64)| {
            // A point's position is 12 bytes, its colour 16.
            let points = (a.points - a.moving_points) * 28;
            // A growing plant has bark with morph targets; if it has more leaves than nodes are allowed, its leaves are
            // one mesh that morphs.
            let morphs = most_nodes > 0 && a.joints == 0 && a.deforming_vertices > 0;
            let grows = morphs && a.free_instances > most_nodes;
            let (instances, instance_vertices, instance_triangles) =
                if grows { (0, 0, 0) } else { (a.instances, a.instance_vertices, a.instance_triangles) };
            let of_profile = GltfOptions { profile: *profile, ..options.clone() };
            let triangles = a.triangles + instance_triangles;
            // A growing plant has no levels of detail.
            let is_plant = !grows && (a.joints > 0 || a.instance_triangles > 0);
            // Placements at rest share a separate mesh, with attributes for shaders.
            let meshes: u64 = if (1..a.placements).contains(standing) { 2 } else { 1 };
            let shaded = if *standing > 0 { a.vertices } else { 0 };
            let still = match profile {
                // All levels together have a third more triangles than the finest; a triangle takes 80 bytes with its
                // vertices, measured.
                Profile::Engine if is_plant => triangles.min(options.level_triangles as u64) * 4 / 3 * 80,
                Profile::Blender | Profile::Engine => {
                    // Points, normals, coordinates, tangents; bark has joints and weights as well.
                    let skinned = if a.joints > 0 { a.vertices * 24 } else { 0 };
                    let leaves = light_leaves::estimate(instance_vertices, instance_triangles, instances, &of_profile);
                    let plant = a.vertices * 48 + a.triangles * 12 + leaves;
                    plant * meshes + skinned + shaded * WIND_BYTES
                }
                // A triangle is three u32.
                Profile::Web if options.meshopt => {
                    let floats = (a.vertices * 48 + a.triangles * 12) * meshes + a.prototype_vertices * 28;
                    let transforms = instances * (a.still_copies + standing) * MESHOPT_INSTANCE_BYTES;
                    floats * 100 / MESHOPT_RATIO_PERCENT + shaded * MESHOPT_WIND_BYTES + transforms
                }
                Profile::Web => {
                    // An instance is 32 bytes: 12 of position, 8 of the quantized rotation, 12 of scale. A vertex has a
                    // position of 8 bytes if quantized, else 12, normal and tangent of 4 each, coordinates of 8. Bark
                    // with joints adds joint indices and weights, 8 bytes, and some of it 16 of wind for shaders.
                    // Triangles are three u32 in large meshes, else three u16. The totals are measured on the presets.
                    let vertex = if options.quantize { 24 } else { 28 };
                    let skinned = if a.joints > 0 { a.vertices * 12 } else { 0 };
                    let vertices =
                        (a.vertices * meshes + a.prototype_vertices) * vertex + skinned + shaded * WIND_BYTES;
                    let triangles = (a.triangles * meshes + a.prototype_triangles) * 10;
                    vertices + triangles + instances * (a.still_copies + standing) * 32
                }
            };
            // The file of the scene has one set of tracks for each phase that has a skin; the file of an asset has one
            // set.
            let nodes = if grows { 0 } else { a.free_instances.min(most_nodes) };
            let bark = if morphs {
                tracks::estimate(a.deforming_vertices, a.deforming_meshes, input.frames, &of_profile)
            } else {
                0
            };
            let leaves = if grows { leaf_shapes::estimate(a.free_instances, input.frames, &of_profile) } else { 0 };
            // Own: compression halves morph targets.
            let shapes = (bark + leaves) / if of_profile.compresses() { 2 } else { 1 };
            // A joint's key is a quaternion, 16 bytes; a free instance's has time, position, rotation and scale, 44 bytes.
            let joints = if *profile == Profile::Engine { a.joints.min(options.joints as u64) } else { a.joints };
            let tracks = a.posed_frames(input.frames) * joints * 16 + nodes * input.frames * 44;
            // Each file of profile engine has one skin; a file of the other profiles has one for each phase.
            let skins = if *profile == Profile::Engine { 1 } else { a.phases.min(options.skins as u64) };
            a.weight * (files * (still + points + shapes) + (skins + files - 1) * tracks)
        };
        let assets: u64 = input.assets.iter().zip(&standing).map(of_asset).sum();
        files * pictures + assets
    };
    input.options.gltf_profiles.iter().map(profile_bytes).sum()
}

/// For each asset, the number of placements that would sway but are written at rest, because the budget of skins is
/// used up: plants with few placements get skins first. The placements at rest share one mesh, separate from that of
/// the swaying ones.
fn standing_copies(input: &EstimateInput) -> Vec<u64> {
    let options = &input.options.gltf;
    let moves = input.frames > 0 && options.frame.is_none();
    let sways =
        |a: &AssetSize| moves && a.joints > 0 && a.free_instances == 0 && a.points == 0 && a.moving_curve_points == 0;
    let assets = || input.assets.iter().zip(&input.scene.assets);
    let mut groups: BTreeMap<&str, u64> = BTreeMap::new();
    for (a, asset) in assets().filter(|(a, asset)| sways(a) && !asset.group.is_empty()) {
        *groups.entry(asset.group.as_str()).or_default() += a.weight * a.placements;
    }
    // Give skins to the smallest groups first; placements without a skin are written at rest.
    let mut by_count: Vec<(u64, &str)> = groups.iter().map(|(group, count)| (*count, *group)).collect();
    by_count.sort_unstable();
    let mut skins = options.skins as u64;
    let mut without: BTreeMap<&str, u64> = BTreeMap::new();
    for (count, group) in by_count {
        let dealt = count.min(skins);
        skins -= dealt;
        without.insert(group, count - dealt);
    }
    let of_asset = |(a, asset): (&AssetSize, &Asset)| {
        let group = asset.group.as_str();
        let (Some(all), Some(standing)) = (groups.get(group), without.get(group)) else { return 0 };
        // The individuals of a group take equal shares, rounded to whole copies.
        if sways(a) { (2 * a.placements * standing + all) / (2 * all).max(1) } else { 0 }
    };
    assets().map(of_asset).collect()
}

/// Name of the file of a whole scene in a bake, without profile and ending. `assets`: ids of all its assets. A scene named like one
/// of them gets a number, as other colliding names do.
pub(super) fn scene_stem<'a>(scene: &str, assets: impl Iterator<Item = &'a str> + Clone) -> String {
    let mut stem = scene.to_owned();
    let mut n = 1_u32;
    while assets.clone().any(|id| id == stem) {
        n += 1;
        stem = format!("{scene}_{n}");
    }
    stem
}

/// Storage of the images of a document: binary files embed them, text files refer to them.
#[derive(Debug)]
enum ImageStorage {
    /// In the binary buffer, each with a separate buffer view.
    Embedded,
    /// In files of a folder relative to the document; `written` lists names and indices of the images.
    Files { folder: String, written: Vec<(String, u32)> },
}

/// Writes glTF: animation is recorded at each frame, files are written by `finish`.
#[derive(Debug)]
pub struct GltfExporter {
    folder: Folder,
    textures: Arc<Textures>,
    options: GltfOptions,
    scene: Option<Arc<Scene>>,
    tracks: ClipTracks,
}

impl GltfExporter {
    /// An exporter into `folder`. `textures`: the encoded images of the scene that `begin` will get.
    pub fn new(folder: Folder, textures: Arc<Textures>, options: GltfOptions) -> Self {
        Self { folder, textures, options, scene: None, tracks: ClipTracks::default() }
    }

    fn write_bake(&self, input: GltfInput<'_>) -> Result<Vec<Warning>> {
        let scene = input.scene;
        let mut warnings = Vec::new();
        let is_engine = self.options.profile == Profile::Engine;
        let mut filled = vec![false; scene.assets.len()];
        for (i, asset) in scene.assets.iter().enumerate().filter(|_| self.options.assets || is_engine) {
            let own = self.write_bake_glb(input, &asset.id, GltfContents::Asset(i))?;
            filled[i] = own.is_some();
            warnings.extend(own.into_iter().flatten());
        }
        if is_engine {
            // An engine places the plants itself, from a table of their transforms.
            let path = format!("gltf/{}.engine.json", scene.name);
            self.folder.write(&path, "glb.engine.table", &engine::placement_table(input, &filled)?)?;
            return Ok(warnings);
        }
        let stem = scene_stem(&scene.name, scene.assets.iter().map(|a| a.id.as_str()));
        match self.write_bake_glb(input, &stem, GltfContents::Scene { camera: true }) {
            // The files of the assets have already reported their joints (X002).
            Ok(more) => {
                let mut more = more.unwrap_or_default();
                more.retain(|w| !self.options.assets || w.code != "X002");
                // They have also reported the leaves of growing plants (X003).
                more.retain(|w| warnings.iter().all(|known: &Warning| known.message != w.message));
                warnings.append(&mut more);
            }
            // The files of the assets are complete by now: a scene too large for one file costs only that file.
            Err(Error::Export { code: code @ "X005", reason }) => {
                let message = format!("the file of the whole scene is left out: {reason}");
                warnings.push(Warning { code, message });
            }
            Err(e) => return Err(e),
        }
        Ok(warnings)
    }

    /// Writes a file and returns its warnings; `None` if there was nothing to write.
    fn write_bake_glb(&self, input: GltfInput<'_>, stem: &str, contents: GltfContents) -> Result<Option<Vec<Warning>>> {
        let path = format!("gltf/{stem}.{}.glb", self.options.profile.word());
        let mut document = GltfDocument::new(input, ImageStorage::Embedded);
        if document.assemble(contents)? {
            let warnings = std::mem::take(&mut document.warnings);
            self.write_glb(document, &path)?;
            return Ok(Some(warnings));
        }
        Ok(None)
    }

    fn write_glb(&self, document: GltfDocument<'_>, path: &str) -> Result<()> {
        if let Some(mut out) = self.folder.create(path, self.options.profile.kind(), None)? {
            container::write_glb(document, |bytes| out.put(bytes))?;
            out.commit()?;
        }
        Ok(())
    }

    fn write_gltf(&self, input: GltfInput<'_>, path: &str) -> Result<Vec<Warning>> {
        let name = path.rsplit('/').next().unwrap_or(path);
        let stem = file_stem(name);
        let beside = |file: &str| match path.rsplit_once('/') {
            Some((parent, _)) => format!("{parent}/{file}"),
            None => file.to_owned(),
        };
        let folder = format!("{stem}_files");
        let mut document =
            GltfDocument::new(input, ImageStorage::Files { folder: folder.clone(), written: Vec::new() });
        document.assemble(GltfContents::Scene { camera: false })?;
        let warnings = std::mem::take(&mut document.warnings);
        if let ImageStorage::Files { written, .. } = &document.pictures {
            for (name, image) in written {
                self.folder.write(&beside(&format!("{folder}/{name}.png")), "png", input.textures.png(*image))?;
            }
        }
        let bin = format!("{stem}.bin");
        let (text, bytes) = container::encode_gltf(document, percent_encode(&bin))?;
        if !bytes.is_empty() {
            self.folder.write(&beside(&bin), "bin", &bytes)?;
        }
        self.folder.write(path, "gltf", &text)?;
        Ok(warnings)
    }
}

impl Exporter for GltfExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        check_scene(scene)?;
        self.tracks = ClipTracks::new(scene, &self.options);
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn wants_phases(&self, number: u32) -> bool {
        self.options.frame == Some(number)
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        if let Some(scene) = &self.scene {
            check_frame(scene, frame)?;
            match self.options.frame {
                None => self.tracks.push(scene, frame),
                Some(number) if number == frame.number => {
                    let still = freeze(scene, frame);
                    check_scene(&still)?;
                    self.tracks = ClipTracks::new(&still, &self.options);
                    self.scene = Some(Arc::new(still));
                }
                Some(_) => {}
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<Summary> {
        let Some(scene) = self.scene.take() else { return Ok(Summary::default()) };
        let mut tracks = std::mem::take(&mut self.tracks);
        tracks.close(scene.clip, &self.options);
        let LightLeaves { scene, warnings: mut all_warnings } = LightLeaves::of(&scene, &self.options)?;
        let input = GltfInput { scene: &scene, tracks: &tracks, textures: &self.textures, options: &self.options };
        let warnings = match &self.options.target {
            GltfTarget::Bake => self.write_bake(input)?,
            GltfTarget::Glb(path) => {
                let mut document = GltfDocument::new(input, ImageStorage::Embedded);
                document.assemble(GltfContents::Scene { camera: false })?;
                let warnings = std::mem::take(&mut document.warnings);
                self.write_glb(document, path)?;
                warnings
            }
            GltfTarget::Gltf(path) => self.write_gltf(input, path)?,
        };
        let still = warn_unanimated(&scene, &tracks).filter(|_| !tracks.is_still());
        all_warnings.extend(warnings.into_iter().chain(still));
        Ok(Summary { warnings: all_warnings })
    }
}

/// X017 for content that glTF cannot animate: moving point clouds, and curves and meshes with more shapes than morph
/// targets are possible. Such curves are omitted; such meshes move with coarse keys.
fn warn_unanimated<'a>(scene: &'a Scene, tracks: &'a ClipTracks) -> impl Iterator<Item = Warning> + 'a {
    let warning = |label: String, why: &str| Warning { code: "X017", message: format!("{label}: {why}") };
    scene.assets.iter().zip(&tracks.assets).flat_map(move |(asset, tracks)| {
        let clouds = asset.points.iter().filter(|c| c.moving).map(move |cloud| {
            let label = format!("asset {}, points {}", asset.id, cloud.name);
            warning(label, "left out, glTF cannot move points; USD, PLY and POV-Ray have them")
        });
        let many = asset.curves.iter().zip(&tracks.curves).filter(|(_, s)| matches!(s, tracks::MorphFrames::TooMany));
        let curves = many.map(move |(curves, _)| {
            let label = format!("asset {}, curves {}", asset.id, curves.name);
            warning(label, "left out, they move in more ways than the morph targets of a glTF file show; USD and POV-Ray have them")
        });
        let meshes = asset.meshes.iter().zip(&tracks.meshes).filter_map(move |(object, shapes)| match shapes {
            tracks::MorphFrames::Frames(keys) if keys.is_coarse() => {
                let why = format!(
                    "{} shapes for all frames, between which points lie up to {:.2} m off their places; a smaller mesh has more \
                     shapes (skin.sides = 3, fewer years), USD and POV-Ray have every frame",
                    keys.frames.len(),
                    keys.error
                );
                Some(warning(format!("asset {}, mesh {}", asset.id, object.name), &why))
            }
            _ => None,
        });
        clouds.chain(curves).chain(meshes)
    })
}

/// Writes all placements of a scene as one .glb into `out`, without animation, images embedded.
/// # Errors
/// X001, X005, X006; `Io` if `out` refuses.
pub fn write(scene: &Scene, textures: &Textures, profile: Profile, out: &mut impl Write) -> Result<Vec<Warning>> {
    check_scene(scene)?;
    let options = GltfOptions { profile, ..GltfOptions::default() };
    let tracks = ClipTracks::new(scene, &options);
    let LightLeaves { scene, mut warnings } = LightLeaves::of(scene, &options)?;
    let input = GltfInput { scene: &scene, tracks: &tracks, textures, options: &options };
    let mut document = GltfDocument::new(input, ImageStorage::Embedded);
    document.assemble(GltfContents::Scene { camera: false })?;
    warnings.append(&mut document.warnings);
    container::write_glb(document, |bytes| out.write_all(bytes).map_err(|e| Error::io("write", "-", e)))?;
    Ok(warnings)
}

/// A relative path as a URI (RFC 3986): letters, digits and `-._~/` stay, other bytes become `%XX`.
fn percent_encode(path: &str) -> String {
    let mut out = String::with_capacity(path.len());
    for b in path.bytes() {
        if b.is_ascii_alphanumeric() || b"-._~/".contains(&b) {
            out.push(char::from(b));
        } else {
            // Escape byte by byte: RFC 3986 requires an escape for each byte of a character's UTF-8 form.
            out.push_str(&format!("%{b:02X}"));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::percent_encode;

    #[test]
    fn uris_are_escaped() {
        assert_eq!(percent_encode("my tree_files/é.png"), "my%20tree_files/%C3%A9.png");
    }
}
