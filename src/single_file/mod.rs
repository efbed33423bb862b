//! One still plant or scene as one file; the ending of its name chooses the format.
//!
//! ```text
//!                    ┌─ .glb .usda .obj …  StillScene: assemble, estimate, write
//! Recipe ── ending ──┼─ .png .exr          picture of an attractor, or of layers
//!                    ├─ .ifs .flame        coefficient tables
//!                    └─ .txt               strings that grammars derive
//! ```
//!
//! [`grow`] does all of it in one call. A program that shows an estimate, or asks before it writes a large file, calls the
//! steps of [`StillScene`] itself.

mod coefficients;
mod derived_text;
mod picture;
mod still_scene;

use osier_base::diagnostic::Report;
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_export::format::FormatInfo;
use osier_export::gltf::Profile;
use osier_export::{Warning, registry};
use osier_scene::Clip;

use crate::bake::BakeContext;
use crate::recipe::Recipe;

pub use coefficients::{CoefficientTables, TableFormat};
pub use derived_text::DerivedText;
pub use picture::{PictureEncoding, canvas_image, write_picture};
pub use still_scene::StillScene;

/// Endings of files that are no format of a bake, with their descriptions.
const OTHER_ENDINGS: [(&str, &str); 5] = [
    ("png", "picture of an attractor (a coefficient table)"),
    ("ifs", "coefficients of tables and trees, Fractint's columns"),
    ("flame", "coefficients of tables of the plane, for flam3 and Apophysis"),
    ("exr", "density of an attractor, 32-bit floats, linear"),
    ("txt", "string that a grammar derives, as cpfg prints it"),
];

/// Content and format of a file, as the ending of its name chooses them.
#[derive(Debug, Clone, Copy)]
pub enum SingleFileFormat {
    /// The geometry of a scene in one of the registered formats.
    Scene(&'static FormatInfo),
    /// A picture of an attractor or of layers.
    Picture(PictureEncoding),
    /// The coefficient tables of attractors and of trees grown by tables.
    Coefficients(TableFormat),
    /// The strings that the grammars of a scene derive.
    DerivedText,
}

impl SingleFileFormat {
    /// The format of a file name by its ending, in capitals or not; `None` for an ending that nothing writes.
    /// # Examples
    /// ```
    /// use osier::single_file::SingleFileFormat;
    ///
    /// assert!(matches!(SingleFileFormat::of_file("oak.GLB"), Some(SingleFileFormat::Scene(f)) if f.word == "glb"));
    /// assert!(SingleFileFormat::of_file("oak.doc").is_none());
    /// ```
    pub fn of_file(name: &str) -> Option<Self> {
        let ending = name.rsplit_once('.')?.1.to_ascii_lowercase();
        match ending.as_str() {
            "png" => Some(Self::Picture(PictureEncoding::Png)),
            "exr" => Some(Self::Picture(PictureEncoding::Exr)),
            "ifs" => Some(Self::Coefficients(TableFormat::Fractint)),
            "txt" => Some(Self::DerivedText),
            "flame" => Some(Self::Coefficients(TableFormat::Flame)),
            _ => registry::by_ending(&ending).map(Self::Scene),
        }
    }
}

/// Endings that [`grow`] writes, without the dot, with their descriptions; in the order of `osier list formats`.
pub fn endings() -> impl Iterator<Item = (&'static str, &'static str)> {
    registry::endings().chain(OTHER_ENDINGS)
}

/// Warnings of a file that [`grow`] has written.
#[derive(Debug, Default)]
pub struct GrownFile {
    /// Warnings of the scene: grammars, growth, coefficient tables.
    pub report: Report,
    /// Warnings of the exporter, by code.
    pub warnings: Vec<Warning>,
}

/// Writes the first frame of a recipe as one file of a folder, without the ground. `name`: file name whose ending
/// chooses the format. `profile`: which readers a glb is made for; other formats ignore it.
/// # Errors
/// `Input` with the faults of grammars; X030 if the file would hold nothing or nothing writes its ending; `Limit` if
/// the predicted bytes or the predicted memory exceed the limits in force; `Export` and `Io` of what cannot be
/// written; `Foreign` for a file of another origin; `Cancelled`.
/// # Examples
/// ```
/// use osier::bake::BakeContext;
/// use osier::export::gltf::Profile;
/// use osier::files::Folder;
/// use osier::limits::Limits;
/// use osier::progress::Cancel;
/// use osier::source::{SourceOptions, find_scene};
///
/// # fn main() -> osier::Result<()> {
/// let (recipe, _warnings) = osier::recipe::resolve(&find_scene("koch.l", &SourceOptions::default())?)?;
/// let folder = Folder::memory();
/// osier::grow(&recipe, "koch.ply", &folder, Profile::Blender, &BakeContext::quiet(&Limits::default(), &Cancel::default()))?;
/// let bytes = folder.take("koch.ply").unwrap_or_default();
/// assert!(bytes.starts_with(b"ply\n"));
/// # Ok(())
/// # }
/// ```
pub fn grow(
    recipe: &Recipe,
    name: &str,
    folder: &Folder,
    profile: Profile,
    context: &BakeContext<'_>,
) -> Result<GrownFile> {
    let Some(format) = SingleFileFormat::of_file(name) else {
        let known: Vec<String> = endings().map(|(e, _)| format!(".{e}")).collect();
        return Err(Error::export("X030", format!("\"{name}\" has no known ending; one of {}", known.join(" "))));
    };
    let grown = match format {
        SingleFileFormat::Scene(format) => {
            // With a clip of one frame, no motion is simulated beyond it.
            let clip = Clip { end: recipe.clip.start, ..recipe.clip };
            let still = Recipe { clip, ..recipe.clone() };
            let scene = StillScene::assemble(&still, context)?;
            // The limits are checked before anything is written into the folder.
            scene.estimate(format, profile)?.check_limits(context.limits)?;
            let warnings = scene.write(name, folder, profile, context)?;
            GrownFile { report: scene.into_report(), warnings }
        }
        SingleFileFormat::Picture(encoding) => {
            write_picture(recipe, encoding, name, folder, context)?;
            GrownFile::default()
        }
        SingleFileFormat::DerivedText => {
            let derived = DerivedText::derive(recipe, context)?;
            folder.write(name, "string", derived.text.as_bytes())?;
            GrownFile { report: derived.report, warnings: Vec::new() }
        }
        SingleFileFormat::Coefficients(format) => {
            let tables = CoefficientTables::encode(recipe, format)?;
            folder.write(name, "ifs", tables.text.as_bytes())?;
            GrownFile { report: tables.report, warnings: Vec::new() }
        }
    };
    folder.finish()?;
    Ok(grown)
}
