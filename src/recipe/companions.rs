//! The companion files of a grammar: its view file, its colour file, and the files that the view names.
//!
//! Files are searched in the folder of the grammar, if that may be read; files outside of it are refused (L006). Missing and
//! damaged files are reported (L048) and left out.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::ReferencedFile;
use super::resolve::Resolver;
use super::scene::TurtleKeys;
use super::syntax::Reference;
use osier_base::diagnostic::{Diagnostic, Report, SourceId, Sources, Span};
use osier_base::files::{Encoding, ReadError, decode};
use osier_grammar::companion::{
    ColorTable, ContourFile, FileLine, FunctionFile, SurfaceFile, SurfaceLine, SurfaceTriangle, View, read_contours,
    read_functions, read_ray, read_surface, read_view,
};
use osier_grammar::{DataFunction, FunctionTables};
use osier_scene::{Image, MaterialClass};

/// Most bytes of one companion file, as for grammars.
const MAX_BYTES: u64 = 64 << 20;
/// Quads along and across a patch if the view does not give them.
const QUADS: [u32; 2] = [8, 8];

/// Geometry of a surface as its kind of file describes it.
#[derive(Debug, Clone)]
pub enum SurfaceForm {
    /// Bicubic Bezier patches with their control points.
    Patches(SurfaceFile),
    /// Triangles with normals and, in some files, texture coordinates.
    Triangles(Vec<SurfaceTriangle>),
}

/// A surface with scale, resolution and texture; those that no view file gives have defaults.
#[derive(Debug, Clone)]
pub struct OrganSurface {
    /// Geometry in the units of its file.
    pub form: SurfaceForm,
    /// Turtle units per unit of the surface.
    pub scale: f64,
    /// Quads along and across a patch.
    pub quads: [u32; 2],
    /// Number of its texture in the view, from 1; 0 for none.
    pub texture: u32,
}

/// Contents of the companion files of a grammar.
#[derive(Debug, Clone, Default)]
pub struct Companions {
    /// Settings of the drawing; `None` without a view file.
    pub view: Option<View>,
    /// Colours by index; `None` without a colour file.
    pub colors: Option<ColorTable>,
    /// Surfaces by the letter behind `~`.
    pub surfaces: BTreeMap<char, Arc<OrganSurface>>,
    /// Contours by the number that grammars and keys give them; those of the scene replace those of the view.
    pub contours: BTreeMap<u32, ContourFile>,
    /// Functions of the view, then of the scene, in order; the first has number 1.
    pub functions: Vec<FunctionFile>,
    /// Pictures by the number of their texture, from 1.
    pub textures: BTreeMap<u32, Image>,
    /// Notes on lines that have no effect, which only `check` prints, on request.
    pub notes: Report,
}

impl Companions {
    /// Functions and contours as tables that expressions of grammars evaluate.
    pub fn function_tables(&self) -> Arc<FunctionTables> {
        let mut tables = FunctionTables::default();
        for (id, function) in (1..).zip(&self.functions) {
            tables.add_function(id, &function.name, DataFunction::new(&function.points, function.samples));
        }
        self.contours.iter().for_each(|(id, contour)| tables.add_curve(*id, contour.spline()));
        Arc::new(tables)
    }
}

/// Finds and reads the companions of a grammar, and collects diagnostics about them.
struct Finder<'a, 'b> {
    resolver: &'a mut Resolver<'b>,
    grammar: &'a ReferencedFile,
    sources: Sources,
    diagnostics: Vec<Diagnostic>,
}

impl Resolver<'_> {
    /// Reads the companion files of a grammar: those that the keys name, else those beside it.
    pub(in crate::recipe) fn companions(&mut self, grammar: &ReferencedFile, keys: &TurtleKeys) -> Companions {
        let mut out = Companions::default();
        let mut finder = Finder { resolver: self, grammar, sources: Sources::default(), diagnostics: Vec::new() };
        if let Some(file) = finder.choose(keys.view.as_ref(), &[".v"], true) {
            finder.view(&file, &mut out);
        }
        // A single colour file with another stem belongs to a grammar that has a view.
        if let Some(file) = finder.choose(keys.colors.as_ref(), &[".mat", ".map"], out.view.is_some()) {
            out.colors = finder.colors(&file);
        }
        for contour in &keys.contours {
            let Some(file) = &contour.file else { continue };
            // A key gives one contour its number: of a file that holds several, only the first is taken.
            let read =
                finder.read_named(file, &[".con", ".cset"]).map(|file| finder.contours(&file)).unwrap_or_default();
            out.contours.extend(read.into_iter().next().map(|c| (contour.id, c)));
        }
        // Functions of the scene come after those of the view, which have the first numbers.
        for function in &keys.functions {
            let Some(file) = &function.file else { continue };
            let mut read =
                finder.read_named(file, &[".func", ".fset"]).map(|file| finder.functions(&file)).unwrap_or_default();
            if function.samples > 0 {
                read.iter_mut().for_each(|f| f.tabulate(function.samples));
            }
            out.functions.extend(read);
        }
        // L047 reports lines of a view that change nothing here; only `check` shows them, on request.
        let (notes, shown): (Vec<_>, Vec<_>) = finder.diagnostics.into_iter().partition(|d| d.code == "L047");
        out.notes = Report { sources: finder.sources.clone(), diagnostics: notes, ..Report::default() };
        let report = Report { sources: finder.sources, diagnostics: shown, ..Report::default() };
        self.report.extend(report);
        out
    }

    /// Reads the surface that an organ's key names; `None` if it cannot be used, with diagnostics.
    pub(in crate::recipe) fn organ_surface(&mut self, reference: &Reference) -> Option<Arc<OrganSurface>> {
        let file = self.read(&reference.text, reference.span, "mesh-bytes", &[".s", ".ray"])?;
        // The surface file takes the place of the grammar: nothing is searched beside it.
        let grammar = file.clone();
        let mut finder =
            Finder { resolver: self, grammar: &grammar, sources: Sources::default(), diagnostics: Vec::new() };
        let form = finder.surface(&file, reference.text.to_ascii_lowercase().ends_with(".ray"));
        let report = Report { sources: finder.sources, diagnostics: finder.diagnostics, ..Report::default() };
        self.report.extend(report);
        Some(Arc::new(OrganSurface { form: form?, scale: 1.0, quads: QUADS, texture: 0 }))
    }
}

impl Finder<'_, '_> {
    /// The file that a key names. Without a key, the file beside the grammar with its stem and one of the `endings`, else, if
    /// `lone` is set, the only file with such an ending, unless another grammar there has its name.
    fn choose(&mut self, key: Option<&Reference>, endings: &[&str], lone: bool) -> Option<ReferencedFile> {
        match key.map(|r| r.text.as_str()) {
            // "none" refuses even a file of the same stem; "auto" is the default.
            Some("none") => return None,
            Some("auto") | None => {}
            Some(_) => return self.read_named(key?, endings),
        }
        // Nothing lies beside a preset.
        if self.grammar.shown.starts_with("preset:") {
            return None;
        }
        let path = self.grammar.path.clone();
        let stem = path.file_stem()?.to_string_lossy().into_owned();
        let library = &self.resolver.request.library;
        let beside: Vec<String> = endings.iter().flat_map(|e| library.names_beside(&path, e)).collect();
        // A file with the stem of another grammar belongs to that grammar.
        let grammars = library.names_beside(&path, ".l");
        let is_free = |name: &str| {
            let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
            !grammars.contains(&format!("{stem}.l"))
        };
        // The order of endings decides: of "tree.mat" and "tree.map", the former is read.
        let own = |e: &str| beside.iter().find(|n| n.as_str() == format!("{stem}{e}"));
        let name = match (endings.iter().find_map(|e| own(e)), &beside[..]) {
            (Some(name), _) => name.clone(),
            (None, [only]) if lone && is_free(only) => only.clone(),
            _ => return None,
        };
        self.read_beside(&name, None)
    }

    /// Reads a file that a key of the scene names, with one of these endings; `None` after a diagnostic.
    fn read_named(&mut self, key: &Reference, endings: &[&str]) -> Option<ReferencedFile> {
        self.resolver.read(&key.text, key.span, "text-bytes", endings)
    }

    /// Reads a file beside the grammar; `None` after a diagnostic. `span`: position at which a companion names it.
    fn read_beside(&mut self, name: &str, span: Option<Span>) -> Option<ReferencedFile> {
        let found = self.resolver.request.library.find_beside(&self.grammar.path, name, MAX_BYTES);
        match found {
            Ok(file) => {
                self.resolver.inputs.push(blake3::hash(&file.bytes));
                Some(file)
            }
            Err(why) => {
                // Missing files are left out; files that must not be read are errors.
                let code = if matches!(why, ReadError::Missing { .. }) { "L048" } else { "L006" };
                let message = format!("companion of \"{}\": {why}", self.grammar.shown);
                let mut d = Diagnostic { help: Some(why.help().into()), ..Diagnostic::about(code, message) };
                d.labels.extend(span.map(|s| (s, "named here".to_owned())));
                self.diagnostics.push(d);
                None
            }
        }
    }

    /// Reports L048 about a file as a whole, without a position in it.
    fn damaged(&mut self, file: &ReferencedFile, message: &str) {
        let d = Diagnostic::about("L048", format!("\"{}\": {message}", file.shown));
        self.diagnostics.push(d.help("it is not used"));
    }

    /// The text of a file and the source for spans of its diagnostics; `None` after a diagnostic if it cannot be decoded.
    fn text(&mut self, file: &ReferencedFile) -> Option<(String, SourceId)> {
        match decode(&file.bytes, Encoding::OrLatin1) {
            Ok(decoded) => {
                let source = self.sources.add(file.shown.clone(), decoded.text.as_str());
                Some((decoded.text, source))
            }
            Err(bad) => {
                self.damaged(file, &bad.to_string());
                None
            }
        }
    }

    fn colors(&mut self, file: &ReferencedFile) -> Option<ColorTable> {
        // Both formats are raw bytes without a signature; only the ending distinguishes them.
        let is_mat = file.shown.to_ascii_lowercase().ends_with(".mat");
        let read = if is_mat { ColorTable::from_mat(&file.bytes) } else { ColorTable::from_map(&file.bytes) };
        match read {
            Ok(colors) => Some(colors),
            Err(why) => {
                self.damaged(file, &why);
                None
            }
        }
    }

    fn contours(&mut self, file: &ReferencedFile) -> Vec<ContourFile> {
        let Some((text, source)) = self.text(file) else { return Vec::new() };
        let (contours, report) = read_contours(&text, source);
        self.diagnostics.extend(report);
        contours
    }

    fn functions(&mut self, file: &ReferencedFile) -> Vec<FunctionFile> {
        let Some((text, source)) = self.text(file) else { return Vec::new() };
        let (functions, report) = read_functions(&text, source);
        self.diagnostics.extend(report);
        functions
    }

    fn surface(&mut self, file: &ReferencedFile, triangles: bool) -> Option<SurfaceForm> {
        let (text, source) = self.text(file)?;
        if triangles {
            let (triangles, report) = read_ray(&text, source);
            self.diagnostics.extend(report);
            return (!triangles.is_empty()).then_some(SurfaceForm::Triangles(triangles));
        }
        let (surface, report) = read_surface(&text, source);
        self.diagnostics.extend(report);
        surface.map(SurfaceForm::Patches)
    }

    /// Reads the view and the files that it names.
    fn view(&mut self, file: &ReferencedFile, out: &mut Companions) {
        let library = self.resolver.request.library.clone();
        let path = file.path.clone();
        let mut hashes = Vec::new();
        let mut include = |name: &str| match library.find_beside(&path, name, MAX_BYTES) {
            Ok(found) => {
                hashes.push(blake3::hash(&found.bytes));
                Ok((found.shown, found.bytes.to_vec()))
            }
            Err(why) => Err(why.to_string()),
        };
        // Read the view with the files that it includes, then the files that its lines name, kind by kind.
        let (view, report) = read_view(&file.shown, &file.bytes, &mut self.sources, &mut include);
        self.resolver.inputs.extend(hashes);
        self.diagnostics.extend(report);
        // Lines of both kinds share the letters: a triangle file given for a letter replaces its patches.
        for (surfaces, triangles) in [(&view.surfaces, false), (&view.triangles, true)] {
            for line in surfaces {
                let surface = self.surface_line(line, triangles);
                out.surfaces.extend(surface.map(|s| (line.letter, Arc::new(s))));
            }
        }
        for line in &view.contours {
            let contours = self.line(line, Self::contours);
            // A contour without a number is contour 0, with which lines are drawn by default.
            let id = line.number.unwrap_or(0);
            out.contours.extend(contours.into_iter().next().map(|c| (id, c)));
        }
        for line in &view.contour_sets {
            let contours = self.line(line, Self::contours);
            // Contours of a set are numbered in the order of the file, from 1.
            out.contours.extend((1..).zip(contours));
        }
        for line in &view.functions {
            let mut functions = self.line(line, Self::functions);
            // The number behind a function is the number of samples of its table.
            if let Some(n) = line.number {
                functions.iter_mut().for_each(|f| f.tabulate(n));
            }
            out.functions.extend(functions);
        }
        for (number, line) in (1..).zip(&view.textures) {
            let picture = self.texture(line);
            out.textures.extend(picture.map(|p| (number, p)));
        }
        out.view = Some(view);
    }

    /// Applies `read` to the file that a line of the view names; empty after a diagnostic about the file.
    fn line<T>(&mut self, line: &FileLine, read: fn(&mut Self, &ReferencedFile) -> Vec<T>) -> Vec<T> {
        match self.read_beside(&line.file, Some(line.span)) {
            Some(file) => read(self, &file),
            None => Vec::new(),
        }
    }

    fn surface_line(&mut self, line: &SurfaceLine, triangles: bool) -> Option<OrganSurface> {
        let file = self.read_beside(&line.file.file, Some(line.file.span))?;
        // Some views name triangle files in lines for patches: the ending decides.
        let form = self.surface(&file, triangles || line.file.file.to_ascii_lowercase().ends_with(".ray"))?;
        let quads = line.quads.unwrap_or(QUADS).map(|n| n.clamp(1, 64));
        Some(OrganSurface { form, scale: line.scale, quads, texture: line.texture.unwrap_or(0) })
    }

    /// Reads the image of a texture; `None` and L048 for formats that are not supported.
    fn texture(&mut self, line: &FileLine) -> Option<Image> {
        let file = self.read_beside(&line.file, Some(line.span))?;
        let request = self.resolver.request;
        // A picture has no axes and no scale; only the roots and limits of the options count.
        let options = osier_import::ImportOptions {
            roots: request.library.roots(),
            limits: &request.limits,
            up: osier_import::UpAxis::Y,
            scale: 1.0,
            class: MaterialClass::Leaf,
        };
        match osier_import::read_picture(Path::new(&file.shown), &file.bytes, &options) {
            Ok(picture) => Some(picture),
            // Many old views name textures in formats that are not supported: the surface is drawn without its texture.
            Err(_) => {
                let message =
                    format!("texture \"{}\" is no picture of PNG, JPEG, Silicon Graphics or Targa", file.shown);
                let d = Diagnostic::warning("L048", message, line.span, "named here");
                self.diagnostics.push(d.help("convert it to PNG; surfaces with it wear their colour"));
                None
            }
        }
    }
}
