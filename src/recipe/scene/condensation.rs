//! Mesh files that coefficient tables name as condensation sets.

use super::{OrganKeys, UpAxis};
use crate::recipe::resolve::Resolver;
use crate::recipe::syntax::KeyTable;
use crate::recipe::{OrganRecipe, ReferencedFile};
use osier_base::Error;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_ifs::faces::{MeshReference, WeightedTriangles};
use osier_ifs::{CondensationShape, Ifs};
use osier_import::Imported;
use osier_scene::MaterialClass;
use std::sync::Arc;

/// Letter of the organ of a tree table's first mesh; further meshes have the following letters.
const FIRST: u32 = 'A' as u32;

/// A system of a coefficient table, with the meshes that the table names.
pub(in crate::recipe) struct SystemFile {
    pub system: Ifs,
    /// Warnings of reading, with the source texts into which spans of `system` point.
    pub report: Report,
    /// Imported meshes, in the order in which the table names them.
    pub meshes: Vec<Arc<Imported>>,
}

impl Resolver<'_> {
    /// Reads the meshes that a system names, beside its file. `sources`: the texts into which its spans point. Diagnostics
    /// without a position point at the name in the table.
    pub(in crate::recipe) fn import_set_meshes(
        &mut self,
        system: &mut Ifs,
        file: &ReferencedFile,
        sources: &Report,
    ) -> Option<Vec<Arc<Imported>>> {
        let mut all = Vec::new();
        for set in &mut system.condensation {
            let CondensationShape::Mesh(model) = &mut set.shape else { continue };
            match self.import_set_mesh(model, file) {
                Ok(imported) => all.push(Arc::new(imported)),
                Err(faults) => {
                    // Errors inside the mesh file have positions there; all others get that of the name in the table.
                    let (inside, mut about): (Vec<_>, Vec<_>) =
                        faults.diagnostics.into_iter().partition(|d| !d.labels.is_empty());
                    about.iter_mut().for_each(|d| d.labels.push((model.span, "this mesh".into())));
                    self.report.extend(Report { sources: faults.sources, diagnostics: inside, ..Report::default() });
                    self.report.extend(Report {
                        sources: sources.sources.clone(),
                        diagnostics: about,
                        ..Report::default()
                    });
                    return None;
                }
            }
        }
        Some(all)
    }

    fn import_set_mesh(&mut self, model: &mut MeshReference, file: &ReferencedFile) -> Result<Imported, Box<Report>> {
        let limit = self.request.limits.get("mesh-bytes");
        // Without a position: the caller adds that of the table's line.
        let about = |d: Diagnostic| Box::new(Report { diagnostics: vec![d], ..Report::default() });
        let library = &self.request.library;
        let found = library
            .find_beside(&file.path, &model.file, limit)
            .map_err(|why| about(Diagnostic::about("S005", why.to_string()).help(why.help())))?;
        self.inputs.push(blake3::hash(&found.bytes));
        let up = if model.up_z { UpAxis::Z } else { UpAxis::Y };
        let imported = self
            .imported(&found, super::plant::MeshImport { up, scale: model.scale, class: MaterialClass::Leaf })
            .map_err(|e| match e {
                Error::Input(faults) => faults,
                other => about(Diagnostic::about("S005", other.to_string())),
            })?;
        // The chaos game samples points on the faces, each triangle with a probability proportional to its area.
        let points = &imported.mesh.points;
        let corner = |i: u32| points.get(i as usize).copied().unwrap_or_default();
        model.faces = Arc::new(WeightedTriangles::new(imported.mesh.triangles.iter().map(|t| t.map(corner))));
        Ok(imported)
    }
}

/// Letters of the organs for the meshes of a table, in its order.
pub fn set_letters(system: &Ifs) -> impl Iterator<Item = char> {
    let meshes = system.condensation.iter().filter(|c| matches!(c.shape, CondensationShape::Mesh(_))).count();
    (FIRST..).filter_map(char::from_u32).take(meshes)
}

/// The meshes of a tree's table as organs that do not flutter, in the order of the table.
pub(super) fn organs(read: &SystemFile) -> Vec<OrganRecipe> {
    // Meshes on the words of a table are as stiff as the tree.
    let keys = OrganKeys { flutter: 0.0, ..OrganKeys::defaults() };
    let organ = |(letter, mesh): (char, &Arc<Imported>)| OrganRecipe {
        letter,
        keys: keys.clone(),
        ifs: None,
        drawn: Arc::default(),
        surface: None,
        mesh: Some(Arc::clone(mesh)),
    };
    set_letters(&read.system).zip(&read.meshes).map(organ).collect()
}
