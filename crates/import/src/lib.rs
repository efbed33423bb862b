//! Artists' meshes from bytes: OBJ with MTL, glTF, and the pictures they name.
//!
//! No crate opens a path: references are read through [`osier_base::files::SearchPaths`] and handed on as slices. Whatever a file
//! declares is held against the limits before memory is spent.

mod assembly;
mod gltf;
mod obj;
mod pictures;

use std::path::{Path, PathBuf};

use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::files::{ReadError, ReferencedFile, SearchPaths};
use osier_base::limits::Limits;
use osier_base::{Error, Result};
use osier_scene::{Image, Material, MaterialClass, Mesh};

/// Which axis of the file points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Up {
    /// As osier has it.
    #[default]
    Y,
    /// As some modelling programs have it: (x, y, z) becomes (x, z, -y).
    Z,
}

/// How a mesh is read.
#[derive(Debug, Clone, Copy)]
pub struct Options<'a> {
    /// Where references may be read.
    pub roots: &'a SearchPaths,
    /// What the file may cost.
    pub limits: &'a Limits,
    /// Up axis of the file.
    pub up: Up,
    /// Metres per unit of the file, finite, > 0.
    pub scale: f32,
    /// What its materials stand for.
    pub class: MaterialClass,
}

/// A file that took part, for the scene's hash.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputFile {
    /// Where it was found.
    pub path: PathBuf,
    /// BLAKE3 of its bytes.
    pub blake3: [u8; 32],
}

/// Triangles of one object of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TriangleGroup {
    /// What the file calls it; empty if it has no name.
    pub name: String,
    /// Its run of the mesh's triangles.
    pub triangles: std::ops::Range<usize>,
}

/// An artist's mesh, +Y up, metres.
#[derive(Debug, Clone)]
pub struct Imported {
    /// One subset per material used; subsets index `materials`.
    pub mesh: Mesh,
    /// The objects that it is made of, in the order of its triangles; an object of several materials is several parts.
    pub parts: Vec<TriangleGroup>,
    /// Surfaces; their maps index `images`.
    pub materials: Vec<Material>,
    /// Pictures.
    pub images: Vec<Image>,
    /// The file and all that it refers to, in order of reference.
    pub files: Vec<InputFile>,
    /// Warnings.
    pub warnings: Report,
}

/// Reads a mesh file by its content or ending: `.obj`, `.gltf`, `.glb`. `path`: as typed; references in the file are
/// resolved from it.
/// # Errors
/// `Input` with X001, X009, X010 or X011; `Range` for a scale that is not finite and positive.
pub fn read(path: &Path, bytes: &[u8], options: &Options<'_>) -> Result<Imported> {
    if !(options.scale.is_finite() && options.scale > 0.0) {
        let (value, max) = (f64::from(options.scale), f64::from(f32::MAX));
        return Err(Error::Range { name: "scale of a mesh file".into(), value, min: 0.0, max, unit: "m per unit" });
    }
    let mut job = Job::new(path, bytes, options);
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let result = match ending.as_deref() {
        _ if bytes.starts_with(b"glTF") => gltf::read(&mut job, bytes),
        Some("gltf" | "glb") => gltf::read(&mut job, bytes),
        Some("obj") => obj::read(&mut job, bytes),
        _ => Err(job.fault("X010", "is neither OBJ nor glTF; export the mesh as .obj, .gltf or .glb")),
    };
    match result {
        Ok(_) if job.report.has_errors() => Err(Error::Input(Box::new(job.report))),
        Ok((mesh, materials, images)) => {
            Ok(Imported { mesh, parts: job.parts, materials, images, files: job.files, warnings: job.report })
        }
        Err(fault) => {
            job.report.push(*fault);
            Err(Error::Input(Box::new(job.report)))
        }
    }
}

/// What a reader makes.
type Made = (Mesh, Vec<Material>, Vec<Image>);

/// A result whose error is the complaint that ends the reading.
/// A picture as brightness, 0..1: pixels in a row, rows, samples from the top left.
pub type Grey = (usize, usize, Vec<f32>);

/// Reads a PNG or JPEG as brightness, the mean of its channels as they are stored.
/// # Errors
/// `Input` with X010 if it is damaged, of another format, or over a limit.
pub fn grey(path: &Path, bytes: &[u8], options: &Options<'_>) -> Result<Grey> {
    let job = Job::new(path, bytes, options);
    let raw = pictures::decode(&job, "mask", bytes, &mut 0).map_err(|d| {
        let mut report = Report::default();
        report.push(*d);
        Error::Input(Box::new(report))
    })?;
    let channels = usize::from(raw.channels);
    let colors = if channels == 1 { 1 } else { 3 };
    let mean = |p: &[u8]| p.iter().take(colors).map(|v| u16::from(*v)).sum::<u16>();
    let scale = 1.0 / (255.0 * f32::from(if colors == 1 { 1_u8 } else { 3 }));
    let values = raw.samples.chunks_exact(channels).map(|p| f32::from(mean(p)) * scale).collect();
    Ok((raw.width as usize, raw.height as usize, values))
}

type Outcome<T> = std::result::Result<T, Box<Diagnostic>>;

/// One file being read, with all that is said about it.
struct Job<'a> {
    path: &'a Path,
    options: &'a Options<'a>,
    report: Report,
    files: Vec<InputFile>,
    parts: Vec<TriangleGroup>,
}

impl<'a> Job<'a> {
    fn new(path: &'a Path, bytes: &[u8], options: &'a Options<'a>) -> Self {
        let own = InputFile { path: path.to_owned(), blake3: *blake3::hash(bytes).as_bytes() };
        Self { path, options, report: Report::default(), files: vec![own], parts: Vec::new() }
    }

    /// The file's name as shown to the user.
    fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// A complaint about something in the file, which the message names: `"a.glb": nodes[3] ...`.
    fn inside(&self, code: &'static str, message: impl std::fmt::Display) -> Box<Diagnostic> {
        Box::new(Diagnostic::about(code, format!("\"{}\": {message}", self.path.display())))
    }

    /// A complaint about the whole file, as a sentence with the file as its subject.
    fn fault(&self, code: &'static str, message: impl std::fmt::Display) -> Box<Diagnostic> {
        Box::new(Diagnostic::about(code, format!("\"{}\" {message}", self.path.display())))
    }

    /// A warning about the whole file.
    fn warn(&mut self, code: &'static str, message: impl std::fmt::Display) {
        let warning = self.fault(code, message);
        self.report.push(*warning);
    }

    /// Notes a referenced file.
    fn note(&mut self, referred: &ReferencedFile) {
        let file = InputFile { path: referred.path.clone(), blake3: *blake3::hash(&referred.bytes).as_bytes() };
        if !self.files.contains(&file) {
            self.files.push(file);
        }
    }

    /// Bytes of a picture; an absent one is a warning, one that leads out or cannot be read an error.
    fn picture(&mut self, result: std::result::Result<ReferencedFile, ReadError>) -> Outcome<Option<Vec<u8>>> {
        match result {
            Ok(referred) => {
                self.note(&referred);
                Ok(Some(referred.bytes))
            }
            Err(refusal @ ReadError::Missing { .. }) => {
                let warning = self.inside("X014", &refusal).help(refusal.help());
                self.report.push(warning);
                Ok(None)
            }
            Err(refusal) => Err(Box::new(self.inside(refusal.code(), &refusal).help(refusal.help()))),
        }
    }

    /// Refuses more of something than its limit.
    fn limit(&self, name: &str, wanted: u64) -> Outcome<()> {
        let limit = self.options.limits.get(name);
        if wanted <= limit {
            return Ok(());
        }
        let (wanted, limit) = (osier_base::limits::grouped(wanted), osier_base::limits::grouped(limit));
        Err(Box::new(
            self.fault("X010", format_args!("has {wanted} {name}, the limit is {limit}"))
                .help(format!("reduce the mesh, or raise the limit with --max-{name}")),
        ))
    }

    /// A material of the class asked for, grey until told otherwise.
    fn material(&self, name: &str) -> Material {
        let leafy = matches!(self.options.class, MaterialClass::Leaf | MaterialClass::Catkin);
        Material {
            translucency: if leafy { 0.3 } else { 0.0 },
            double_sided: leafy,
            ..Material::plain(name.to_owned(), self.options.class, [0.5; 3], if leafy { 0.6 } else { 0.8 })
        }
    }
}
