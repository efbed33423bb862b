//! OBJ with MTL. Every line is checked here, with its place, before `tobj` assembles the mesh: `tobj` names no places and
//! takes `nan` for a number.

mod faces;
mod lines;
mod mtl;
mod scan;

use std::cell::Cell;
use std::path::Path;

use glam::{Vec2, Vec3};

use self::lines::Word;
use self::mtl::Library;
use super::assembly::{MeshPart, join};
use super::{Job, Made, Outcome};
use osier_base::diagnostic::{Diagnostic, SourceId, Span};
use osier_base::files::{Encoding, ReadError, decode};
use osier_base::limits::grouped;

/// Reads an OBJ file and its material libraries.
pub(super) fn read(job: &mut Job<'_>, bytes: &[u8]) -> Outcome<Made> {
    let limit = job.options.limits.get("mesh-bytes");
    if bytes.len() as u64 > limit {
        let limit = grouped(limit);
        let message = format_args!("is longer than {} bytes", limit);
        return Err(Box::new(job.fault("X010", message).help("raise the limit with --max-mesh-bytes")));
    }
    let Some(text) = text(job, &job.name(), bytes) else { return Ok(Made::default()) };
    let name = job.name();
    let mut checked = Checked::new(&name, &text);
    let Some(scan) = scan::scan(job, &mut checked)? else { return Ok(Made::default()) };
    let library = Library::read(job, &mut checked, &scan.libraries);
    if job.report.has_errors() {
        return Ok(Made::default());
    }
    let plain = lines::plain(&text);
    let options = tobj::LoadOptions { single_index: true, triangulate: false, ..tobj::LoadOptions::default() };
    // All libraries are handed over at the first `mtllib`, none again at the others; nothing is opened.
    let mtl = Cell::new(library.text.as_str());
    let loaded =
        tobj::load_obj_buf(&mut plain.as_bytes(), &options, |_: &Path| tobj::load_mtl_buf(&mut mtl.take().as_bytes()));
    let damaged = |job: &Job<'_>, e: tobj::LoadError| job.fault("X010", format_args!("is damaged: {e}"));
    let (models, materials) = loaded.map_err(|e| damaged(job, e))?;
    let materials = materials.map_err(|e| damaged(job, e))?;
    let mut surfaces = mtl::Surfaces::new(job, &library, materials);
    let mut pieces = Vec::with_capacity(models.len());
    for model in models {
        let material = surfaces.of(job, model.mesh.material_id, !model.mesh.vertex_color.is_empty())?;
        pieces.push(piece(&model, material));
    }
    let (materials, images) = surfaces.finish();
    Ok((join(job, pieces)?, materials, images))
}

fn piece(model: &tobj::Model, material: u32) -> MeshPart {
    let mesh = &model.mesh;
    let vec3 = |v: &[f32]| match v {
        [x, y, z] => Vec3::new(*x, *y, *z),
        _ => Vec3::ZERO,
    };
    let points: Vec<Vec3> = mesh.positions.chunks_exact(3).map(vec3).collect();
    let triangles = faces::triangulate(&points, &mesh.indices, &mesh.face_arities);
    MeshPart {
        place: format!("object {:?}", model.name),
        name: model.name.clone(),
        material,
        normals: mesh.normals.chunks_exact(3).map(vec3).collect(),
        uvs: mesh.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
        colors: mesh.vertex_color.chunks_exact(3).map(|c| vec3(c).extend(1.0).to_array()).collect(),
        points,
        triangles,
    }
}

/// A text file, or a complaint in the report; warns if it had to be read as Latin-1.
fn text(job: &mut Job<'_>, name: &str, bytes: &[u8]) -> Option<String> {
    match decode(bytes, Encoding::OrLatin1) {
        Ok(decoded) => {
            if let Some((line, offset)) = decoded.latin1 {
                let message = format!("\"{name}\" is not UTF-8 (line {line}, byte {offset}); it is read as Latin-1");
                job.report.push(Diagnostic::about("X015", message).help("save it as UTF-8"));
            }
            Some(decoded.text)
        }
        Err(bad) => {
            bad.report("X010", name, bytes, &mut job.report);
            None
        }
    }
}

/// The text being checked; it becomes a source of the report at the first complaint.
struct Checked<'a> {
    name: &'a str,
    text: &'a str,
    source: Option<SourceId>,
}

impl<'a> Checked<'a> {
    fn new(name: &'a str, text: &'a str) -> Self {
        Self { name, text, source: None }
    }

    fn complain(&mut self, job: &mut Job<'_>, complaint: Complaint) {
        let source = *self.source.get_or_insert_with(|| job.report.sources.add(self.name, self.text));
        let span = Span::new(source, complaint.start, complaint.end);
        let diagnostic = Diagnostic::about(complaint.code, complaint.message).label(span, complaint.label);
        job.report.push(diagnostic.help(complaint.help));
    }

    /// Complains about a reference at byte `start`; one that is absent is a warning.
    fn refuse(&mut self, job: &mut Job<'_>, word: Word<'_>, refusal: &ReadError) {
        let code = if matches!(refusal, ReadError::Missing { .. }) { "X014" } else { refusal.code() };
        let complaint = word.complaint(refusal.to_string(), refusal.help());
        self.complain(job, Complaint { code, label: "named here".into(), ..complaint });
    }
}

/// Something wrong at bytes `start..end`.
struct Complaint {
    code: &'static str,
    start: usize,
    end: usize,
    message: String,
    label: String,
    help: &'static str,
}
