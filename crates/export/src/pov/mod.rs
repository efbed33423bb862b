//! POV-Ray 3.7: a scene with include files, one of them for each frame. `cd pov && povray render.ini` renders the clip.
//!
//! A bake has `pov/main.pov common.inc prototypes.inc static.inc render.ini frames/frame.####.inc`, textures in `textures/`,
//! those of map sequences in `maps/`. A single file is `<stem>.pov` with everything else in `<stem>_files/`.
//!
//! ```
//! use osier_export::pov::PovOptions;
//!
//! // Every second frame, with photons through drops of half a millimetre and more.
//! let options = PovOptions { step: 2, photons: Some(0.0005), ..PovOptions::default() };
//! assert_eq!(options.size, (800, 600));
//! ```

mod assets;
mod camera_light;
mod coat;
mod main_file;
mod material;
mod mesh;
mod objects;
pub(crate) mod options;
mod photons;
mod space;

pub use options::PovOptions;

use std::sync::Arc;

use self::assets::PovAsset;
use self::objects::StreakView;
use self::space::PovSpace;
use super::estimate::{AssetSize, EstimateInput};
use super::file_target::{FileTarget, file_stem};
use super::format::{FormatInfo, TextureUse};
use super::text::TextBuffer;
use super::textures::Textures;
use super::{Exporter, Summary, Warning};
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{Asset, AssetFrame, Frame, Instancer, Scene, check_frame, check_scene};

/// Instances of a frame beyond which POV-Ray's parsing is slow enough for a warning (X013).
const SLOW_FRAME_INSTANCES: usize = 500_000;

/// Distance below which streaks of rain are left out, as a share of the distance from camera to target: depth of field would blur
/// them away, POV-Ray would draw them sharply across the image.
const STREAK_NEAR_SHARE: f32 = 0.9;

/// Registry entry of POV-Ray: one scene with an include file for each written frame.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "pov",
    about: "a POV-Ray scene with an include file per frame; `povray render.ini` renders it",
    folder: "pov",
    names_assets: false,
    notes_missing_files: false,
    endings: &[("pov", "POV-Ray scene")],
    pictures_beside: true,
    textures: TextureUse::Written,
    memory_percent: 20,
    estimate,
    open: |job| {
        let options = PovOptions { target: job.target(), ..job.options.pov.clone() };
        vec![Box::new(PovExporter::new(job.folder.clone(), Arc::clone(&job.textures), options))]
    },
};

/// Estimate from bytes per line of the include files, and bytes per texel of maps as measured on leaves in rain.
fn estimate(input: &EstimateInput) -> u64 {
    let step = u64::from(input.options.pov.step.max(1));
    // The first frame and every `step`-th one after it.
    let written = |frames: u64| frames.div_ceil(step);
    // A sphere with position, radius and colour takes 110 bytes; clouds are thinned to MAX_SPHERES.
    let spheres = |n: u64| n.min(100_000) * 110;
    let water = assets::has_water(&input.scene.materials);
    let of_asset = |(a, shown): (&AssetSize, Option<u64>)| {
        // The triangles of a growing plant are written once; its points and its freely moving instances are in the
        // frames.
        let still = match shown {
            Some(_) => {
                a.triangles * 33 + a.prototype_triangles * 100 + a.instances.saturating_sub(a.free_instances) * 170
            }
            None => (a.triangles + a.prototype_triangles) * 100 + a.instances * 170,
        };
        let points = spheres(a.points - a.moving_points) + written(input.frames) * spheres(a.moving_points);
        // A frame has points and normals of moving meshes, and one line for the leaves of each joint.
        // The instances of a growing plant have few digits, and many of its points coincide: measured.
        let free = shown.map_or(a.free_instances * 170, |shown| shown * 157);
        // Instances on joints have a line each if frames contain their own states.
        let stated = a.joints > 0 && (a.deforming_vertices > 0 || water);
        let instances = free + if stated { a.instances.saturating_sub(a.free_instances) * 170 } else { 0 };
        let bark = if a.deforms() { a.deforming_vertices * 58 } else { 0 };
        let moving = written(input.frames) * (instances + bark + a.moving_curve_points * 120);
        let posed = written(a.posed_frames(input.frames)) * (a.moving_vertices * 70 + a.joints * 170);
        // A vertex of a mesh that frames contain completely, with its share of two triangles: measured on drops.
        let varying = written(input.frames) * a.varying_vertices * 110;
        a.weight * (still + points + moving + posed + varying)
    };
    let assets: u64 = input.assets.iter().zip(input.instances_of_growth()).map(of_asset).sum();
    // Height and weight of each map sequence take a tenth of a byte per texel each; the height of a relief takes 1.5
    // bytes per texel.
    let maps = (input.map_texels() * 2 + input.relief_texels() * 15) / 10;
    assets + maps * written(input.frames.max(1)).max(1)
}

/// Writes a scene for POV-Ray: a main file, include files (one for each written frame), textures and maps of coats.
#[derive(Debug)]
pub struct PovExporter {
    folder: Folder,
    textures: Arc<Textures>,
    options: PovOptions,
    scene: Option<Arc<Scene>>,
    written: Vec<u32>,
    /// Number of the first frame of the bake, from which `step` is counted.
    first: Option<u32>,
    instances: usize,
    coats: coat::CoatWriter,
    warnings: Vec<Warning>,
}

impl PovExporter {
    /// An exporter into `folder`. `textures`: the encoded images of the scene that `begin` will get.
    pub fn new(folder: Folder, textures: Arc<Textures>, options: PovOptions) -> Self {
        let (written, warnings, coats) = (Vec::new(), Vec::new(), coat::CoatWriter::new());
        Self { folder, textures, options, scene: None, written, first: None, instances: 0, coats, warnings }
    }

    /// Path of an include file in the output folder.
    fn file_path(&self, name: &str) -> String {
        match &self.options.target {
            FileTarget::Bake => format!("pov/{name}"),
            FileTarget::Single(file) => format!("{}_files/{name}", file_stem(file)),
        }
    }

    /// Folder of the include files relative to the main file.
    fn include_folder(&self) -> String {
        match &self.options.target {
            FileTarget::Bake => String::new(),
            FileTarget::Single(file) => format!("{}_files/", file_stem(file)),
        }
    }

    /// Folder of the textures in the output folder, which is POV-Ray's library path.
    fn texture_folder(&self) -> String {
        match &self.options.target {
            FileTarget::Bake => "textures/".into(),
            FileTarget::Single(file) => format!("{}_files/", file_stem(file)),
        }
    }

    /// Folder of the wet maps in the output folder.
    fn map_folder(&self) -> String {
        match &self.options.target {
            FileTarget::Bake => "maps/".into(),
            FileTarget::Single(file) => format!("{}_files/maps/", file_stem(file)),
        }
    }

    fn space(&self) -> PovSpace {
        PovSpace { scale: self.options.units_per_m }
    }

    fn assets<'a>(&self, scene: &'a Scene) -> Vec<PovAsset<'a>> {
        let asset = |(index, asset)| PovAsset {
            index,
            asset,
            space: self.space(),
            materials: &scene.materials,
            view: StreakView {
                // The shutter is a share of the frame: times 1 / fps it is the exposure, s.
                open: self.options.shutter / osier_base::math::narrow(scene.clip.fps()),
                eye: scene.camera.eye,
                near: scene.camera.eye.distance(scene.camera.target) * STREAK_NEAR_SHARE,
            },
            photons: self.options.photons,
        };
        scene.assets.iter().enumerate().map(asset).collect()
    }

    fn write_text(&self, path: &str, kind: &'static str, text: &TextBuffer) -> Result<()> {
        if !text.is_finite() {
            return Err(not_finite(path));
        }
        self.folder.write(path, kind, text.bytes())
    }

    fn write_frame(&mut self, scene: &Scene, number: u32, frame: Option<&Frame>) -> Result<()> {
        self.written.push(number);
        let path = self.file_path(&format!("frames/frame.{}.inc", scene.clip.tag(number)));
        let mut text = TextBuffer::default();
        text.put(&format!("// {}, frame {number}\n", super::GENERATOR));
        let maps = self.map_folder();
        // Maps are written even if an interrupted bake has left the file of the frame complete.
        self.coats.frame(&mut text, &self.folder, &maps, scene, number, frame)?;
        let file = self.folder.create(&path, "inc", Some(number))?;
        let rest = AssetFrame::default();
        let assets = self.assets(scene);
        let moving = assets.iter().filter(|p| p.asset.moves());
        let now = moving.map(|p| (p, frame.and_then(|f| f.assets.get(p.index)).unwrap_or(&rest)));
        // A file that is already complete needs no text, but frames that may cause warnings are formatted anyway.
        if file.is_none() && !is_heavy(now.clone()) {
            return Ok(());
        }
        let count = now.map(|(asset, state)| asset.write_frame(&mut text, state, &mut self.warnings)).sum();
        self.instances = self.instances.max(count);
        if !text.is_finite() {
            return Err(not_finite(&path));
        }
        let Some(mut out) = file else { return Ok(()) };
        out.put(text.bytes())?;
        out.commit()
    }
}

/// Whether a frame may have more instances or points than POV-Ray handles well.
fn is_heavy<'p>(now: impl Iterator<Item = (&'p PovAsset<'p>, &'p AssetFrame)>) -> bool {
    let (mut instances, mut thinned) = (0, false);
    for (asset, state) in now {
        instances += asset.asset.instancers.iter().map(Instancer::len).sum::<usize>();
        let mut clouds = asset.asset.points.iter().enumerate();
        thinned |= clouds.any(|(i, p)| p.at(state.points(i)).positions.len() > objects::MAX_SPHERES);
    }
    thinned || instances > SLOW_FRAME_INSTANCES
}

/// Whether any frame can differ from the scene at rest.
fn is_animated(scene: &Scene) -> bool {
    !scene.map_sequences.is_empty() || scene.assets.iter().any(Asset::moves)
}

fn not_finite(path: &str) -> Error {
    Error::export("X001", format!("\"{path}\" would hold a number that is not finite"))
}

impl Exporter for PovExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        check_scene(scene)?;
        camera_light::check_finite(scene)?;
        if !(self.options.units_per_m.is_finite() && self.options.units_per_m > 0.0) {
            return Err(Error::Range {
                name: "pov.units_per_m".into(),
                value: f64::from(self.options.units_per_m),
                min: f64::from(f32::MIN_POSITIVE),
                max: f64::from(f32::MAX),
                unit: "",
            });
        }
        let assets = self.assets(scene);
        // Three files that every frame includes: settings and materials, prototypes, and what does not move.
        let mut common = TextBuffer::default();
        let target = assets.iter().any(PovAsset::has_photon_target);
        common.put(&format!("// {}: settings and surfaces\n", super::GENERATOR));
        camera_light::write_global_settings(
            &mut common,
            self.options.photons.filter(|_| target).map(|r| r * self.options.units_per_m),
        );
        let falls = |p: &osier_scene::Points| p.moving && objects::is_water(p, &scene.materials);
        if scene.assets.iter().any(|a| a.points.iter().any(falls)) {
            common.put(objects::STREAK_MACRO);
        }
        material::declare_materials(&mut common, scene, &self.texture_folder())?;
        self.textures.write(scene, &self.folder, &self.texture_folder())?;
        self.write_text(&self.file_path("common.inc"), "inc", &common)?;

        let mut prototypes = TextBuffer::default();
        prototypes.put(&format!("// {}: what instances show\n", super::GENERATOR));
        assets.iter().for_each(|p| p.write_prototypes(&mut prototypes));
        self.write_text(&self.file_path("prototypes.inc"), "inc", &prototypes)?;

        let mut still = TextBuffer::default();
        still.put(&format!("// {}: what never changes\n", super::GENERATOR));
        let mut warnings = Vec::new();
        // Static objects are written once; frames contain only the moving ones.
        let count: usize = assets.iter().map(|p| p.write_static(&mut still, &mut warnings)).sum();
        self.write_text(&self.file_path("static.inc"), "inc", &still)?;
        self.instances = count;
        self.warnings = warnings;
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        // Steps are counted from the first frame of the bake, so a single one is always written.
        let first = *self.first.get_or_insert(frame.number);
        let skipped = !frame.number.saturating_sub(first).is_multiple_of(self.options.step.max(1));
        if skipped || !is_animated(&scene) {
            return Ok(());
        }
        check_frame(&scene, frame)?;
        self.write_frame(&scene, frame.number, Some(frame))
    }

    fn finish(&mut self) -> Result<Summary> {
        let Some(scene) = self.scene.take() else { return Ok(Summary::default()) };
        if self.written.is_empty() && is_animated(&scene) {
            self.write_frame(&scene, scene.clip.start, None)?;
        }
        if self.instances > SLOW_FRAME_INSTANCES {
            let message = format!("POV-Ray reads {} instances again for every frame", self.instances);
            self.warnings.push(Warning { code: "X013", message });
        }
        self.warnings.extend(self.coats.warning(&scene));
        let main = main_file::main_file(&scene, self.space(), &self.include_folder(), &self.written);
        let (path, name) = match &self.options.target {
            FileTarget::Bake => ("pov/main.pov".to_owned(), "main.pov".to_owned()),
            FileTarget::Single(file) => (file.clone(), file.clone()),
        };
        self.write_text(&path, "pov", &main)?;
        let ini = main_file::render_ini(&scene, &self.options, &name, &self.written);
        self.write_text(&self.file_path("render.ini"), "ini", &ini)?;
        Ok(Summary { warnings: std::mem::take(&mut self.warnings) })
    }
}
