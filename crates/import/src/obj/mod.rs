//! OBJ with MTL. Every line is checked here, with its place, before `tobj` assembles the mesh: `tobj` names no places and
//! takes `nan` for a number.

mod faces;
mod mtl;
mod scan;
mod tokens;

use std::cell::Cell;
use std::io::Read as _;
use std::path::Path;

use glam::{Vec2, Vec3};

use self::mtl::{MapPlacement, MaterialLibraries};
use self::tokens::ObjToken;
use super::assembly::{MeshPart, join};
use super::{ImportContext, ImportResult, ImportedMesh};
use osier_base::diagnostic::{Diagnostic, SourceId, Span};
use osier_base::files::{Encoding, ReadError, decode};
use osier_base::limits::grouped;
use osier_base::units;

/// Reads an OBJ file and its material libraries. Every line is checked before the mesh is built.
pub(super) fn read(context: &mut ImportContext<'_>, bytes: &[u8]) -> ImportResult<ImportedMesh> {
    let limit = context.options.limits.get("mesh-bytes");
    if bytes.len() as u64 > limit {
        let limit = grouped(limit);
        let message = format_args!("is longer than {} bytes", limit);
        return Err(Box::new(context.error_about_file("X010", message).help("raise the limit with --max-mesh-bytes")));
    }
    let Some(text) = text(context, &context.name(), bytes) else { return Ok(ImportedMesh::default()) };
    let name = context.name();
    let mut checked = CheckedText::new(&name, &text);
    // First pass: every line is checked, so that all faults come with their place. The second pass, by `tobj`, builds the
    // mesh.
    let Some(scan) = scan::scan(context, &mut checked)? else { return Ok(ImportedMesh::default()) };
    let mut library = MaterialLibraries::read(context, &mut checked, &scan.libraries);
    if context.report.has_errors() {
        return Ok(ImportedMesh::default());
    }
    library.add_undescribed(&scan.materials);
    // Put an `mtllib` line first: all materials are then known from the first line on, whether or not the text names a
    // library.
    let plain = tokens::plain(&text);
    let plain = if scan.needs_rewrite { tokens::for_tobj(&plain, scan.lacks_colors) } else { plain };
    let mut with_library = "mtllib all\n".as_bytes().chain(plain.as_bytes());
    let options = tobj::LoadOptions { single_index: true, triangulate: false, ..tobj::LoadOptions::default() };
    // `tobj` asks for a library at each `mtllib`: give it the text of all at the first one, which is ours, and an empty
    // text at the others. No file is opened.
    let mtl = Cell::new(library.text.as_str());
    let loaded =
        tobj::load_obj_buf(&mut with_library, &options, |_: &Path| tobj::load_mtl_buf(&mut mtl.take().as_bytes()));
    let damaged = |context: &ImportContext<'_>, e: tobj::LoadError| {
        context.error_about_file("X010", format_args!("is damaged: {e}"))
    };
    let (models, materials) = loaded.map_err(|e| damaged(context, e))?;
    let materials = materials.map_err(|e| damaged(context, e))?;
    let mut materials = mtl::ObjMaterials::new(context, &library, materials);
    let mut parts = Vec::with_capacity(models.len());
    for model in models {
        let material =
            materials.material_index(context, model.mesh.material_id, !model.mesh.vertex_color.is_empty())?;
        parts.push(mesh_part(&model, material, materials.placement(model.mesh.material_id)));
    }
    let (materials, images) = materials.finish();
    Ok(ImportedMesh { mesh: join(context, parts)?, materials, images })
}

/// Converts a model of `tobj` to a part of a mesh, with texture coordinates at which the maps of its material lie
/// correctly.
fn mesh_part(model: &tobj::Model, material: u32, placement: MapPlacement) -> MeshPart {
    let mesh = &model.mesh;
    let vec3 = |v: &[f32]| match v {
        [x, y, z] => Vec3::new(*x, *y, *z),
        _ => Vec3::ZERO,
    };
    let linear = |c: Vec3| Vec3::from_array(c.to_array().map(units::linear_from_srgb));
    let points: Vec<Vec3> = mesh.positions.chunks_exact(3).map(vec3).collect();
    let triangles = faces::triangulate(&points, &mesh.indices, &mesh.face_arities);
    MeshPart {
        place: format!("object {:?}", model.name),
        name: model.name.clone(),
        material,
        normals: mesh.normals.chunks_exact(3).map(vec3).collect(),
        uvs: mesh.texcoords.chunks_exact(2).map(|uv| placement.apply(Vec2::from_slice(uv))).collect(),
        // OBJ has no alpha of vertices. Its vertex colours are sRGB, as Blender, MeshLab and ZBrush write them; those
        // of the scene's meshes are linear.
        colors: mesh.vertex_color.chunks_exact(3).map(|c| linear(vec3(c)).extend(1.0).to_array()).collect(),
        points,
        triangles,
    }
}

/// Decodes a text file; `None` if it is not text, with an error in the report. Warns if it had to be read as Latin-1.
fn text(context: &mut ImportContext<'_>, name: &str, bytes: &[u8]) -> Option<String> {
    match decode(bytes, Encoding::OrLatin1) {
        Ok(decoded) => {
            if let Some((line, offset)) = decoded.latin1 {
                let message = format!("\"{name}\" is not UTF-8 (line {line}, byte {offset}); it is read as Latin-1");
                context.report.push(Diagnostic::about("X015", message).help("save it as UTF-8"));
            }
            Some(decoded.text)
        }
        Err(bad) => {
            bad.report("X010", name, bytes, &mut context.report);
            None
        }
    }
}

/// The text being checked; it becomes a source of the report with the first error.
struct CheckedText<'a> {
    name: &'a str,
    text: &'a str,
    source: Option<SourceId>,
}

impl<'a> CheckedText<'a> {
    fn new(name: &'a str, text: &'a str) -> Self {
        Self { name, text, source: None }
    }

    /// Adds an error to the report, with its position in this text.
    fn report(&mut self, context: &mut ImportContext<'_>, syntax_error: SyntaxError) {
        let source = *self.source.get_or_insert_with(|| context.report.sources.add(self.name, self.text));
        let span = Span::new(source, syntax_error.start, syntax_error.end);
        let diagnostic = Diagnostic::about(syntax_error.code, syntax_error.message).label(span, syntax_error.label);
        context.report.push(diagnostic.help(syntax_error.help));
    }

    /// Reports a reference that cannot be read; a missing file is a warning.
    fn report_unreadable(&mut self, context: &mut ImportContext<'_>, token: ObjToken<'_>, error: &ReadError) {
        let code = if matches!(error, ReadError::Missing { .. }) { "X014" } else { error.code() };
        let syntax_error = token.syntax_error(error.to_string(), error.help());
        self.report(context, SyntaxError { code, label: "named here".into(), ..syntax_error });
    }
}

/// A syntax error at bytes `start..end`.
struct SyntaxError {
    code: &'static str,
    start: usize,
    end: usize,
    message: String,
    label: String,
    help: &'static str,
}
