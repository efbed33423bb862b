//! Imports meshes of modelling programs: OBJ with MTL, glTF 2.0, and the images that they refer to; points of PLY.
//!
//! ```
//! use osier_base::files::SearchPaths;
//! use osier_base::limits::Limits;
//! use osier_import::{ImportOptions, UpAxis, read};
//! use osier_scene::MaterialClass;
//!
//! let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
//! let options = ImportOptions {
//!     roots: &SearchPaths::none(),
//!     limits: &Limits::default(),
//!     up: UpAxis::Y,
//!     scale: 0.01,
//!     class: MaterialClass::Leaf,
//! };
//! let leaf = read("leaf.obj".as_ref(), obj, &options)?;
//! assert_eq!(leaf.mesh.triangles.len(), 1);
//! # Ok::<(), osier_base::Error>(())
//! ```
//!
//! The readers open no paths: referenced files are read through [`osier_base::files::SearchPaths`] and passed on as
//! slices. All sizes that a file declares are checked against the limits before memory is allocated.

mod assembly;
mod gltf;
mod heights;
mod images;
mod obj;
mod ply_points;

use std::path::{Path, PathBuf};

use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::files::{ReadError, ReferencedFile, SearchPaths};
use osier_base::limits::Limits;
use osier_base::{Error, Result};
use osier_scene::{Image, Material, MaterialClass, Mesh};

pub use heights::{HeightMap, HeightUnit, read_heights};
pub use ply_points::ply_points;

/// Up axis of a mesh file, which becomes +Y of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// +Y is up, as in glTF and in osier.
    #[default]
    Y,
    /// +Z is up, as in Blender and most CAD programs: (x, y, z) becomes (x, z, -y).
    Z,
}

/// Search paths, limits, and conversion of the mesh to the scene.
#[derive(Debug, Clone, Copy)]
pub struct ImportOptions<'a> {
    /// Folders from which files that the file refers to may be read; a reference that leaves them is an error.
    pub roots: &'a SearchPaths,
    /// Limits on the file's bytes, elements and images, checked before memory is spent; beyond one: X010.
    pub limits: &'a Limits,
    /// The axis of the file that becomes +Y.
    pub up: UpAxis,
    /// Metres per unit of the file, finite, > 0.
    pub scale: f32,
    /// Class of all materials; for leaves and catkins, materials are double-sided and translucent unless the file says
    /// otherwise.
    pub class: MaterialClass,
}

/// A file that was read; part of the scene's hash.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputFile {
    /// Where it was found; for the imported file itself the path as it was given.
    pub path: PathBuf,
    /// BLAKE3 of its bytes.
    pub blake3: [u8; 32],
}

/// Triangles of one object of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TriangleGroup {
    /// Name in the file; empty if it has none.
    pub name: String,
    /// Range of the object's triangles in those of the mesh.
    pub triangles: std::ops::Range<usize>,
}

/// A mesh from a modelling program, converted to +Y up and metres.
#[derive(Debug, Clone)]
pub struct Imported {
    /// One subset per material used; subsets index `materials`.
    pub mesh: Mesh,
    /// Objects of the file, in the order of the mesh's triangles; an object of several materials is several parts.
    pub parts: Vec<TriangleGroup>,
    /// Materials; their maps index `images`.
    pub materials: Vec<Material>,
    /// The images that the maps of `materials` index.
    pub images: Vec<Image>,
    /// The file and all files that it refers to, in order of reference.
    pub files: Vec<InputFile>,
    /// Warnings of the reader; errors make [`read`] fail instead.
    pub warnings: Report,
}

/// Reads a mesh file by its content or ending: `.obj`, `.gltf`, `.glb`. `path`: as typed; references in the file are
/// resolved from it.
/// # Errors
/// `Input` with X001, X009, X010 or X011; `Range` for a scale that is not finite and positive.
pub fn read(path: &Path, bytes: &[u8], options: &ImportOptions<'_>) -> Result<Imported> {
    if !(options.scale.is_finite() && options.scale > 0.0) {
        let (value, max) = (f64::from(options.scale), f64::from(f32::MAX));
        return Err(Error::Range { name: "scale of a mesh file".into(), value, min: 0.0, max, unit: "m per unit" });
    }
    let mut context = ImportContext::new(path, bytes, options);
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let result = match ending.as_deref() {
        // The magic number of a binary file takes precedence over its extension.
        _ if bytes.starts_with(b"glTF") => gltf::read(&mut context, bytes),
        Some("gltf" | "glb") => gltf::read(&mut context, bytes),
        Some("obj") => obj::read(&mut context, bytes),
        _ => Err(context.error_about_file("X010", "is neither OBJ nor glTF; export the mesh as .obj, .gltf or .glb")),
    };
    match result {
        Ok(_) if context.report.has_errors() => Err(Error::Input(Box::new(context.report))),
        Ok(ImportedMesh { mesh, materials, images }) => Ok(Imported {
            mesh,
            parts: context.parts,
            materials,
            images,
            files: context.files,
            warnings: context.report,
        }),
        Err(diagnostic) => {
            context.report.push(*diagnostic);
            Err(Error::Input(Box::new(context.report)))
        }
    }
}

/// Result of a reader. Subsets of the mesh index `materials`, whose maps index `images`.
#[derive(Debug, Default)]
struct ImportedMesh {
    mesh: Mesh,
    materials: Vec<Material>,
    images: Vec<Image>,
}

/// An image reduced to its brightness, as [`read_grey`] reads it.
#[derive(Debug, Clone, PartialEq)]
pub struct GreyImage {
    /// Pixels per row of `values`.
    pub width: usize,
    /// Number of rows of `values`.
    pub height: usize,
    /// Brightness, 0..1, row by row from the top left.
    pub values: Vec<f32>,
}

/// Reads a PNG or JPEG as brightness, the mean of its channels as they are stored; an EXR as its values, clamped to 0..1.
/// # Errors
/// `Input` with X001 or X010 if it is damaged, of another format, or over a limit.
pub fn read_grey(path: &Path, bytes: &[u8], options: &ImportOptions<'_>) -> Result<GreyImage> {
    if heights::is_exr(bytes) {
        let map = read_heights(path, bytes, options)?;
        let values = map.values.iter().map(|v| v.clamp(0.0, 1.0)).collect();
        return Ok(GreyImage { width: map.width, height: map.height, values });
    }
    let context = ImportContext::new(path, bytes, options);
    let raw = images::decode(&context, "mask", bytes, &mut 0).map_err(|d| Error::from(*d))?;
    let channels = usize::from(raw.channels);
    // Alpha is left out of the mean.
    let colors = if channels == 1 { 1 } else { 3 };
    let mean = |p: &[u8]| p.iter().take(colors).map(|v| u16::from(*v)).sum::<u16>();
    let scale = 1.0 / (255.0 * f32::from(if colors == 1 { 1_u8 } else { 3 }));
    let values = raw.samples.chunks_exact(channels).map(|p| f32::from(mean(p)) * scale).collect();
    Ok(GreyImage { width: raw.width as usize, height: raw.height as usize, values })
}

/// Reads a PNG or JPEG as a colour picture of 8 bits a channel, named `color`.
/// # Errors
/// `Input` with X010 if it is damaged, of another format, or over a limit.
pub fn read_picture(path: &Path, bytes: &[u8], options: &ImportOptions<'_>) -> Result<Image> {
    let context = ImportContext::new(path, bytes, options);
    let raw = match images::decode_old(&context, &path.to_string_lossy(), bytes, &mut 0) {
        Some(old) => old,
        None => images::decode(&context, "picture", bytes, &mut 0),
    };
    let raw = raw.map_err(|d| Error::from(*d))?;
    Ok(raw.into_image("color".into(), osier_scene::ImageKind::Color))
}

/// A result whose error is the diagnostic that ends the reading.
type ImportResult<T> = std::result::Result<T, Box<Diagnostic>>;

/// State of an import: the file, the options, and what is collected besides the mesh.
struct ImportContext<'a> {
    path: &'a Path,
    options: &'a ImportOptions<'a>,
    report: Report,
    files: Vec<InputFile>,
    parts: Vec<TriangleGroup>,
}

impl<'a> ImportContext<'a> {
    fn new(path: &'a Path, bytes: &[u8], options: &'a ImportOptions<'a>) -> Self {
        let own = InputFile { path: path.to_owned(), blake3: *blake3::hash(bytes).as_bytes() };
        Self { path, options, report: Report::default(), files: vec![own], parts: Vec::new() }
    }

    /// Name of the file in messages.
    fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// A diagnostic about a part of the file, which the message names: `"a.glb": nodes[3] ...`.
    fn error_in_file(&self, code: &'static str, message: impl std::fmt::Display) -> Box<Diagnostic> {
        Box::new(Diagnostic::about(code, format!("\"{}\": {message}", self.path.display())))
    }

    /// A diagnostic about the whole file, a sentence with the file as its subject.
    fn error_about_file(&self, code: &'static str, message: impl std::fmt::Display) -> Box<Diagnostic> {
        Box::new(Diagnostic::about(code, format!("\"{}\" {message}", self.path.display())))
    }

    /// A warning about the whole file.
    fn warn(&mut self, code: &'static str, message: impl std::fmt::Display) {
        let warning = self.error_about_file(code, message);
        self.report.push(*warning);
    }

    /// Adds a referenced file to the list of inputs, once.
    fn add_referenced_file(&mut self, referred: &ReferencedFile) {
        let file = InputFile { path: referred.path.clone(), blake3: *blake3::hash(&referred.bytes).as_bytes() };
        if !self.files.contains(&file) {
            self.files.push(file);
        }
    }

    /// Bytes of an image file. A missing one is a warning (X014); one outside the search paths or unreadable is an error.
    fn image_bytes(&mut self, result: std::result::Result<ReferencedFile, ReadError>) -> ImportResult<Option<Vec<u8>>> {
        match result {
            Ok(referred) => {
                self.add_referenced_file(&referred);
                Ok(Some(referred.bytes))
            }
            Err(error @ ReadError::Missing { .. }) => {
                let warning = self.error_in_file("X014", &error).help(error.help());
                self.report.push(warning);
                Ok(None)
            }
            Err(error) => Err(Box::new(self.error_in_file(error.code(), &error).help(error.help()))),
        }
    }

    /// Fails with X010 if `wanted` exceeds the limit of this name.
    fn limit(&self, name: &str, wanted: u64) -> ImportResult<()> {
        let limit = self.options.limits.get(name);
        if wanted <= limit {
            return Ok(());
        }
        let (wanted, limit) = (osier_base::limits::grouped(wanted), osier_base::limits::grouped(limit));
        Err(Box::new(
            self.error_about_file("X010", format_args!("has {wanted} {name}, the limit is {limit}"))
                .help(format!("reduce the mesh, or raise the limit with --max-{name}")),
        ))
    }

    /// A grey material of the class in the options, before the file's values are set.
    fn material(&self, name: &str) -> Material {
        let leafy = matches!(self.options.class, MaterialClass::Leaf | MaterialClass::Catkin);
        Material {
            translucency: if leafy { 0.3 } else { 0.0 },
            double_sided: leafy,
            ..Material::plain(name.to_owned(), self.options.class, [0.5; 3], if leafy { 0.6 } else { 0.8 })
        }
    }
}

/// Index of an entry of the list of materials, images or subsets. A file names each in some bytes of text, and the limit on the
/// bytes of a file keeps their number far below 2^32.
#[allow(clippy::cast_possible_truncation, reason = "limited by the size of the file")]
fn table_index(n: usize) -> u32 {
    n as u32
}
