//! `[clouds.NAME]`: attractors of coefficient tables, drawn as points.

use super::IfsTreeKeys;
use super::condensation::SystemFile;
use crate::recipe::resolve::{MorphTable, NamedTable, Resolver};
use crate::recipe::syntax::{
    ColorList, FileReference, OneOf, OptionalKey, Reference, StringType, TomlTable, TomlValue, degrees, integer,
    millimetres, number, point, wrong,
};
use crate::recipe::syntax::{choices, keys};
use crate::recipe::{AttractorRecipe, OrganRecipe, ReferencedFile};
use osier_base::Error;
use osier_base::diagnostic::{Diagnostic, Report, Span};
use osier_base::files::Names;
use osier_ifs::dynamics::{self, SystemAnalysis};
use osier_ifs::game::extent;
use osier_ifs::stems::{TreeSystem, is_tree, stems};
use osier_ifs::weights::WeightRule;
use osier_ifs::{Ifs, read};

choices! {
    /// Property of a point that selects its colour.
    ColorBy {
        /// Index of the map applied last.
        Map = "map",
        /// Indices of the maps applied last, as many as `prefix`.
        Word = "word",
        /// Colour coordinate of the fractal-flame method, along the palette.
        Palette = "palette",
        /// Number of steps since the start or the last jump.
        Depth = "depth",
        /// Number of branchings since the last stem, along the palette: trunk, branches, twigs.
        Order = "order",
        /// One colour for all points; pictures show their density.
        Density = "density",
    }
    /// Rule by which the probabilities of maps are computed.
    WeightsFrom {
        /// Column of the file; running sums are converted to differences.
        File = "file",
        /// Column of the file without conversion.
        FileRaw = "file-raw",
        /// Absolute determinants of the maps: their areas, or volumes in 3D.
        Det = "det",
        /// The maps' shares of the similarity dimension.
        Moran = "moran",
        /// The same probability for every map.
        Equal = "equal",
        /// Probabilities as Fractint computes them from its file.
        Fractint = "fractint",
    }
    /// Point of an attractor that `at` positions.
    AttractorOrigin {
        /// Centre of the underside of its bounding box.
        Box = "box",
        /// Origin of its table's coordinates.
        Origin = "origin",
    }
}

keys! {
    /// Points of an attractor; NAME is any name.
    AttractorKeys at "clouds.NAME" {
        /// Coefficient table that defines the maps.
        ifs: Option<Reference> = "ifs" FileReference(".ifs, .flame, .ifs.toml");
        /// System of the table; empty selects the first.
        system: String = "system" StringType("");
        /// Source of the probabilities of the maps.
        weights: Option<WeightsFrom> = "weights" OptionalKey(OneOf(WeightsFrom::File), "those of the file");
        /// Number of points that the chaos game draws.
        points: u32 = "points" integer(1_000_000, 1, 1_000_000_000), basic;
        /// What determines the colour of a point.
        color_by: ColorBy = "color_by" OneOf(ColorBy::Map), basic;
        /// With `color_by = "word"`: number of maps that determine the colour.
        prefix: u32 = "prefix" integer(2, 1, 4);
        /// Colours of the maps, or of the palette.
        colors: Vec<[f32; 3]> = "colors" ColorList;
        /// Height of the attractor; without it one table unit is one metre.
        height: Option<f64> = "height" OptionalKey(number(1.0, 1e-4, 1e5, "m"), "1 m per unit"), basic;
        /// Diameter of a point.
        point: Option<f64> = "point_mm" OptionalKey(millimetres(2.0, 1e-4, 1e5), "1/800 of the size");
        /// Keeps one point per cube of this size; 0 keeps all points.
        voxel: f64 = "voxel_mm" millimetres(0.0, 0.0, 1e6);
        /// Position of the foot (see `foot`).
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Point that is placed at `at`: bottom centre of the bounding box, or origin of the table.
        foot: AttractorOrigin = "foot" OneOf(AttractorOrigin::Box);
        /// Rotation about the vertical axis.
        turn: f64 = "turn_deg" degrees(0.0, -360.0, 360.0);
    }
}

/// Endings of files that are read as coefficient tables.
pub(super) const ENDINGS: &[&str] = &[".ifs", ".flame", ".toml", ".xml"];

/// Bytes of memory per point while a cloud is made, measured.
pub(super) const POINT: u64 = 40;

impl Resolver<'_> {
    /// Reads all tables `[clouds.NAME]`; leaves out those with errors. `names`: ids already taken by plants.
    pub(in crate::recipe) fn clouds(&mut self, root: &TomlTable, names: &mut Names) -> Vec<AttractorRecipe> {
        let Some(table) = self.table(root, "", "clouds") else { return Vec::new() };
        let mut clouds = Vec::new();
        for entry in &table.entries {
            let TomlValue::Table(cloud) = &entry.node.value else {
                self.report.push(*wrong(&format!("clouds.{}", entry.key), &entry.node, "a table"));
                continue;
            };
            let id = names.unique(&entry.key);
            clouds.extend(self.cloud(&entry.key, id, entry.key_span, cloud));
        }
        clouds
    }

    fn cloud(&mut self, name: &str, id: String, span: Span, table: &TomlTable) -> Option<AttractorRecipe> {
        let path = format!("clouds.{name}");
        let reported = self.report.diagnostics.len();
        let keys = self.read_keys::<AttractorKeys>(table, &path);
        // The key `ifs` may be the one with the error; reporting it as missing too would mislead.
        if keys.ifs.is_none() && self.report.diagnostics.len() > reported {
            return None;
        }
        let named = NamedTable { name, path: &path, id };
        if let Some(entry) = table.get("morph")
            && let Some(morph) = self.table(table, &path, "morph")
        {
            return self.morph(named, table, MorphTable { table: morph, span: entry.key_span }, keys);
        }
        self.attractor(named, span, keys)
    }

    /// Reads and analyses the table that keys name; `None` after a diagnostic. `of`: the cloud or layer.
    pub(in crate::recipe) fn attractor(
        &mut self,
        of: NamedTable<'_>,
        span: Span,
        keys: AttractorKeys,
    ) -> Option<AttractorRecipe> {
        let NamedTable { name, path, id } = of;
        self.check_limit("points", u64::from(keys.points), Some(span));
        self.check_memory(&format!("{path}.points"), u64::from(keys.points), POINT, Some(span));
        let Some(reference) = &keys.ifs else {
            let d = Diagnostic::error("S006", format!("[{path}] names no table"), span, "no ifs here");
            self.report.push(d.help("add ifs = \"NAME.ifs\"; `osier list presets` shows those in the binary"));
            return None;
        };
        let file = self.read(&reference.text, reference.span, "text-bytes", ENDINGS)?;
        let SystemFile { system, report, .. } = self.system(&file, &keys.system, reference.span)?;
        if self.request.thorough && self.request.bare.is_some() && keys.system.is_empty() {
            self.study_other_systems(&file, &system);
        }
        // Probabilities come from the key, else from the table, else from the column of the file.
        let rule = keys.weights.map_or(system.weights.unwrap_or(WeightRule::File), weight_rule);
        let study = self.study(&system, rule, &report)?;
        // A system whose orbits diverge has no bounds: the diagnostic names the map.
        match extent(&system, &study) {
            Ok(extent) => {
                let source = file.shown;
                Some(AttractorRecipe { name: name.into(), id, source, system, rule, study, extent, keys, morph: None })
            }
            Err(escaped) => {
                self.report.extend(Report {
                    sources: report.sources,
                    diagnostics: vec![*escaped],
                    ..Report::default()
                });
                None
            }
        }
    }

    /// Reads a 2D table for a leaf or a bark; `None` after a diagnostic. `what`: phrase for its purpose in messages.
    pub(in crate::recipe) fn plane_table(&mut self, reference: &Reference, name: &str, what: &str) -> Option<Ifs> {
        let file = self.read(&reference.text, reference.span, "text-bytes", ENDINGS)?;
        let SystemFile { system, report: sources, .. } = self.system(&file, name, reference.span)?;
        if system.dim != 2 {
            let text = format!("\"{}\" is a 3D table; {what} from a 2D one", system.name);
            self.report
                .push(Diagnostic::error("S005", text, reference.span, "this table").help("take one with 7 columns"));
            return None;
        }
        // By default probabilities are areas, which cover a leaf or a bark evenly, whatever the file's column contains.
        self.study(&system, system.weights.unwrap_or(WeightRule::Det), &sources)?;
        Some(system)
    }

    /// Reports the warnings and errors of all systems of a file except `drawn`.
    fn study_other_systems(&mut self, file: &ReferencedFile, drawn: &Ifs) {
        let Ok((mut systems, sources)) = read::read(&file.shown, &file.bytes, &self.request.limits) else { return };
        for system in systems.iter_mut().filter(|s| s.name != drawn.name) {
            // A system is studied with its condensation meshes, whose points are part of its attractor.
            if self.import_set_meshes(system, file, &sources).is_some()
                && let Some(study) = self.study(system, system.weights.unwrap_or(WeightRule::File), &sources)
                && let Err(escaped) = extent(system, &study)
            {
                self.report.extend(Report {
                    sources: sources.sources.clone(),
                    diagnostics: vec![*escaped],
                    ..Report::default()
                });
            }
        }
    }

    /// Reads the table of a tree: its stems, the file's name for messages, and the meshes on its words as organs.
    pub(in crate::recipe) fn tree_system(
        &mut self,
        reference: &Reference,
        keys: &IfsTreeKeys,
    ) -> Option<(TreeSystem, String, Vec<OrganRecipe>)> {
        let file = self.read(&reference.text, reference.span, "text-bytes", ENDINGS)?;
        let read = self.system(&file, &keys.system, reference.span)?;
        let system = &read.system;
        if !is_tree(system) {
            let text = format!("\"{}\" is not a tree: it has no trunk in 3D", system.name);
            let d = Diagnostic::error("S005", text, reference.span, "this table");
            self.report
                .push(d.help("a tree has dim = 3 and branch maps, or a map that flattens the attractor into a stem"));
            return None;
        }
        match stems(system) {
            Ok(stems) => Some((stems, file.shown, super::condensation::organs(&read))),
            Err(fault) => {
                self.report.extend(Report {
                    sources: read.report.sources,
                    diagnostics: vec![*fault],
                    ..Report::default()
                });
                None
            }
        }
    }

    /// Reads a table file with the meshes that it names, and selects a system by name (the first for an empty one). `span`: the reference
    /// to the file, at which a system that it lacks is reported.
    pub(in crate::recipe) fn system(&mut self, file: &ReferencedFile, name: &str, span: Span) -> Option<SystemFile> {
        let wanted = Some(name).filter(|n| !n.is_empty());
        let read = read::read(&file.shown, &file.bytes, &self.request.limits);
        let (systems, report) = self.load_or_report(read, file)?;
        let mut system = match read::pick(&systems, wanted, &file.shown) {
            Ok(system) => system.clone(),
            Err(Error::Input(faults)) => {
                // The text of a bare file's scene is not the user's.
                let place = Some(span).filter(|_| self.request.bare.is_none());
                for mut fault in faults.diagnostics {
                    fault.labels.extend(place.map(|span| (span, "this table".to_owned())));
                    self.report.push(fault);
                }
                return None;
            }
            // The choice reads no files: other errors cannot occur.
            Err(_) => return None,
        };
        self.report.extend(report.clone());
        let meshes = self.import_set_meshes(&mut system, file, &report)?;
        Some(SystemFile { system, report, meshes })
    }

    /// Analyses a system and reports warnings; `None` if it has no attractor.
    pub(in crate::recipe) fn study(
        &mut self,
        system: &Ifs,
        rule: WeightRule,
        sources: &Report,
    ) -> Option<SystemAnalysis> {
        match dynamics::study(system, rule).into_result(sources) {
            Ok((study, reported)) => {
                self.report.extend(reported);
                Some(study)
            }
            Err(Error::Input(faults)) => {
                self.report.extend(*faults);
                None
            }
            // The analysis reads no files: other errors cannot occur.
            Err(_) => None,
        }
    }
}

fn weight_rule(from: WeightsFrom) -> WeightRule {
    match from {
        WeightsFrom::File => WeightRule::File,
        WeightsFrom::FileRaw => WeightRule::Raw,
        WeightsFrom::Det => WeightRule::Det,
        WeightsFrom::Moran => WeightRule::Moran,
        WeightsFrom::Equal => WeightRule::Equal,
        WeightsFrom::Fractint => WeightRule::Fractint,
    }
}
