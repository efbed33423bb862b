//! POV-Ray 3.7: a scene with include files, one of them per frame. `cd pov && povray render.ini` renders the clip.
//!
//! Layout of a bake: `pov/main.pov common.inc prototypes.inc static.inc render.ini frames/frame.####.inc`, pictures in
//! `textures/`, those of map sequences in `maps/`. A single asset: `<stem>.pov` and everything else in `<stem>_files/`.

mod assets;
mod coat;
mod look;
mod main_file;
mod material;
mod mesh;
mod objects;
pub(crate) mod options;
mod photons;
mod space;

pub use options::PovOptions;

use std::sync::Arc;

use self::assets::Part;
use self::objects::View;
use self::space::Space;
use super::estimate::EstimateInput;
use super::file_target::FileTarget;
use super::format::FormatInfo;
use super::text::Text;
use super::textures::Textures;
use super::{Exporter, Summary, Warning};
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{Asset, AssetFrame, Frame, Instancer, Scene, check_frame, check_scene, scene_bounds};

/// Instances and triangles of one frame beyond which POV-Ray's parsing gets slow enough to say so.
const HEAVY: usize = 500_000;

/// Streaks of rain nearer to the eye than this are left out, as a share of the way to what it looks at: a lens would blur
/// them away, POV-Ray draws rods of glass across the picture.
const NEAR: f32 = 0.9;

/// POV-Ray in the registry.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "pov",
    about: "a POV-Ray scene with an include file per frame; `povray render.ini` renders it",
    asset_folder: None,
    endings: &[("pov", "POV-Ray scene")],
    pictures_beside: true,
    memory_percent: 20,
    estimate,
    open: |job| {
        let options = PovOptions { target: job.target(), ..job.options.pov.clone() };
        vec![Box::new(PovExporter::new(job.folder.clone(), Arc::clone(&job.textures), options))]
    },
};

/// Own: bytes as the include files have them; texels of maps as measured on leaves in rain.
fn estimate(input: &EstimateInput) -> u64 {
    let step = u64::from(input.options.pov.step.max(1));
    let written = |frames: u64| frames / step;
    let spheres = |n: u64| n.min(100_000) * 110;
    let assets = input.per_asset(|a| {
        let still = (a.triangles + a.prototype_triangles) * 100 + a.instances * 170;
        let points = spheres(a.points - a.moving_points) + written(input.frames) * spheres(a.moving_points);
        // A frame has points and normals of what moves, and one line for the leaves of each joint.
        let moving = written(input.frames) * (a.free_instances * 170 + a.moving_curve_points * 120);
        let posed = written(a.posed_frames(input.frames)) * (a.moving_vertices * 70 + a.joints * 170);
        still + points + moving + posed
    });
    // A height and a weight of each map sequence, a tenth of a byte a texel.
    assets + input.map_texels() * written(input.frames.max(1)).max(1) * 2 / 10
}

/// Exporter for POV-Ray.
#[derive(Debug)]
pub struct PovExporter {
    folder: Folder,
    textures: Arc<Textures>,
    options: PovOptions,
    scene: Option<Arc<Scene>>,
    written: Vec<u32>,
    /// First frame that was asked for.
    first: Option<u32>,
    instances: usize,
    coats: coat::CoatWriter,
    warnings: Vec<Warning>,
}

impl PovExporter {
    /// Writes into `folder`; `textures`: the scene's pictures.
    pub fn new(folder: Folder, textures: Arc<Textures>, options: PovOptions) -> Self {
        let (written, warnings, coats) = (Vec::new(), Vec::new(), coat::CoatWriter::new());
        Self { folder, textures, options, scene: None, written, first: None, instances: 0, coats, warnings }
    }

    /// Path of one of our files below the output folder.
    fn path(&self, name: &str) -> String {
        match &self.options.target {
            FileTarget::Bake => format!("pov/{name}"),
            FileTarget::Single(stem) => format!("{stem}_files/{name}"),
        }
    }

    /// Folder of our files as POV-Ray finds it from the main file.
    fn includes(&self) -> String {
        match &self.options.target {
            FileTarget::Bake => String::new(),
            FileTarget::Single(stem) => format!("{stem}_files/"),
        }
    }

    /// Folder of the pictures below the output folder, which is also where POV-Ray looks for them.
    fn pictures(&self) -> String {
        match &self.options.target {
            FileTarget::Bake => "textures/".into(),
            FileTarget::Single(stem) => format!("{stem}_files/"),
        }
    }

    /// Folder of the pictures that frames bring.
    fn maps(&self) -> String {
        match &self.options.target {
            FileTarget::Bake => "maps/".into(),
            FileTarget::Single(stem) => format!("{stem}_files/maps/"),
        }
    }

    fn space(&self) -> Space {
        Space { scale: self.options.units_per_m }
    }

    fn parts<'a>(&self, scene: &'a Scene) -> Vec<Part<'a>> {
        let part = |(index, asset)| Part {
            index,
            asset,
            space: self.space(),
            materials: &scene.materials,
            view: View {
                open: self.options.shutter / osier_base::math::narrow(scene.clip.fps()),
                eye: scene.camera.eye,
                near: scene.camera.eye.distance(scene.camera.target) * NEAR,
            },
            photons: self.options.photons,
        };
        scene.assets.iter().enumerate().map(part).collect()
    }

    fn save(&self, path: &str, kind: &'static str, text: &Text) -> Result<()> {
        if !text.is_finite() {
            return Err(not_finite(path));
        }
        self.folder.write(path, kind, text.bytes())
    }

    fn write_frame(&mut self, scene: &Scene, number: u32, frame: Option<&Frame>) -> Result<()> {
        self.written.push(number);
        let path = self.path(&format!("frames/frame.{}.inc", scene.clip.tag(number)));
        let mut text = Text::default();
        text.put(&format!("// {}, frame {number}\n", super::GENERATOR));
        let maps = self.maps();
        // Its pictures belong to the bake even where its own file is kept from a run that was broken off.
        self.coats.frame(&mut text, &self.folder, &maps, scene, number, frame)?;
        let file = self.folder.create(&path, "inc", Some(number))?;
        let rest = AssetFrame::default();
        let parts = self.parts(scene);
        let moving = parts.iter().filter(|p| p.asset.moves());
        let now = moving.map(|p| (p, frame.and_then(|f| f.assets.get(p.index)).unwrap_or(&rest)));
        // What has to be said of a frame is said of a kept one, too.
        if file.is_none() && !is_heavy(now.clone()) {
            return Ok(());
        }
        let count = now.map(|(part, state)| part.frame(&mut text, state, &mut self.warnings)).sum();
        self.instances = self.instances.max(count);
        if !text.is_finite() {
            return Err(not_finite(&path));
        }
        let Some(mut out) = file else { return Ok(()) };
        out.put(text.bytes())?;
        out.commit()
    }
}

/// True if parts of a frame may be more than POV-Ray takes well.
fn is_heavy<'p>(now: impl Iterator<Item = (&'p Part<'p>, &'p AssetFrame)>) -> bool {
    let (mut instances, mut thinned) = (0, false);
    for (part, state) in now {
        instances += part.asset.instancers.iter().map(Instancer::len).sum::<usize>();
        let mut clouds = part.asset.points.iter().enumerate();
        thinned |= clouds.any(|(i, p)| p.at(state.points(i)).positions.len() > objects::SPHERES);
    }
    thinned || instances > HEAVY
}

/// True if frames change anything.
fn moves(scene: &Scene) -> bool {
    !scene.map_sequences.is_empty() || scene.assets.iter().any(Asset::moves)
}

fn not_finite(path: &str) -> Error {
    Error::export("X001", format!("\"{path}\" would hold a number that is not finite"))
}

impl Exporter for PovExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        check_scene(scene)?;
        look::check(scene)?;
        if !(self.options.units_per_m.is_finite() && self.options.units_per_m > 0.0) {
            return Err(Error::Range {
                name: "pov.units_per_m".into(),
                value: f64::from(self.options.units_per_m),
                min: f64::from(f32::MIN_POSITIVE),
                max: f64::from(f32::MAX),
                unit: "",
            });
        }
        let parts = self.parts(scene);
        let mut common = Text::default();
        let target = parts.iter().any(Part::has_target);
        common.put(&format!("// {}: settings and surfaces\n", super::GENERATOR));
        look::settings(&mut common, self.options.photons.filter(|_| target).map(|r| r * self.options.units_per_m));
        material::declare(&mut common, scene, &self.pictures())?;
        self.textures.write(scene, &self.folder, &self.pictures())?;
        self.save(&self.path("common.inc"), "inc", &common)?;

        let mut prototypes = Text::default();
        prototypes.put(&format!("// {}: what instances show\n", super::GENERATOR));
        parts.iter().for_each(|p| p.prototypes(&mut prototypes));
        self.save(&self.path("prototypes.inc"), "inc", &prototypes)?;

        let mut still = Text::default();
        still.put(&format!("// {}: what never changes\n", super::GENERATOR));
        let mut warnings = Vec::new();
        let count: usize = parts.iter().map(|p| p.still(&mut still, &mut warnings)).sum();
        self.save(&self.path("static.inc"), "inc", &still)?;
        self.instances = count;
        self.warnings = warnings;
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        // Steps are counted from the first frame that is asked for, so a single one is always written.
        let first = *self.first.get_or_insert(frame.number);
        let skipped = !frame.number.saturating_sub(first).is_multiple_of(self.options.step.max(1));
        if skipped || !moves(&scene) {
            return Ok(());
        }
        check_frame(&scene, frame)?;
        self.write_frame(&scene, frame.number, Some(frame))
    }

    fn finish(&mut self) -> Result<Summary> {
        let Some(scene) = self.scene.take() else { return Ok(Summary::default()) };
        if self.written.is_empty() && moves(&scene) {
            self.write_frame(&scene, scene.clip.start, None)?;
        }
        if self.instances > HEAVY {
            let message = format!("POV-Ray reads {} instances again for every frame", self.instances);
            self.warnings.push(Warning { code: "X013", message });
        }
        self.warnings.extend(self.coats.warning(&scene));
        let main = main_file::main_file(&scene, self.space(), &self.includes(), &self.written);
        let (path, name) = match &self.options.target {
            FileTarget::Bake => ("pov/main.pov".to_owned(), "main.pov".to_owned()),
            FileTarget::Single(stem) => (format!("{stem}.pov"), format!("{stem}.pov")),
        };
        self.save(&path, "pov", &main)?;
        let ini = main_file::render_ini(&scene, &self.options, &name, &self.written);
        self.save(&self.path("render.ini"), "ini", &ini)?;
        Ok(Summary { warnings: std::mem::take(&mut self.warnings) })
    }
}
