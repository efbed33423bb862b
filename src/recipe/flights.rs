//! Catkins that a scene lets fly, and solids in their way.

use std::sync::Arc;

use super::flight_keys::{FlightKeys, FlightPreset, Release, Shape, SolidKeys};
use super::key::{Section as _, wrong};
use super::kinds::Reference;
use super::resolve::{Resolver, span_of};
use super::sections::Up;
use super::tree::{Node, Table, Value};
use super::{FlightRecipe, PlantRecipe, SolidRecipe};
use osier_base::diagnostic::{Diagnostic, Span};
use osier_base::files::Names;
use osier_scene::MaterialClass;

/// Bytes of memory of a catkin that flies, as measured.
const CATKIN: u64 = 1000;

/// Names of the forms that catkins have.
pub const FORMS: [&str; 5] = ["v0", "v1", "v2", "v3", "v4"];

impl Resolver<'_> {
    /// The flight of a scene, if it has one.
    pub(super) fn flight(&mut self, root: &Table, plants: &[PlantRecipe]) -> Option<FlightRecipe> {
        let entry = root.get("flight")?;
        let table = self.table(root, "", "flight")?;
        let mut keys = FlightKeys::read(Some(table), "flight", &mut self.report);
        as_printed(&mut keys, table);
        self.limit("catkins", u64::from(keys.count), span_of(root, &["flight", "count"]));
        self.memory("flight.count", u64::from(keys.count), CATKIN, span_of(root, &["flight", "count"]));
        for (name, pair) in [("band", keys.band), ("scale", keys.scale)] {
            self.in_order(table, ("flight", name), pair);
        }
        let span = |key: &str| table.get(key).map_or(entry.key_span, |e| e.node.span);
        let canopy = self.canopy(&keys, span("canopy"), root, plants);
        let forms = self.forms(&keys, span("forms"));
        let starts = match (keys.release, &keys.points) {
            (Release::Points, Some(reference)) => self.starts(reference).unwrap_or_default(),
            (Release::Points, None) => {
                let d = Diagnostic::error("S006", "[flight] names no points", span("release"), "points of a file");
                self.report.push(d.help("add points = \"FILE.csv\", or take another release"));
                Vec::new()
            }
            _ => Vec::new(),
        };
        let wet = keys.humidity_map.as_ref().and_then(|reference| {
            let file = self.read(&reference.text, reference.span, "mesh-bytes", &[".png", ".jpg", ".jpeg"])?;
            self.grey(&file)
        });
        Some(FlightRecipe { keys, canopy, forms, starts, wet })
    }

    /// Plants (indices into the recipe's) that let catkins go, with their weights.
    fn canopy(&mut self, keys: &FlightKeys, span: Span, root: &Table, plants: &[PlantRecipe]) -> Vec<(usize, f64)> {
        if keys.release != Release::Canopy {
            return Vec::new();
        }
        if root.get("plants").is_none() {
            let d = Diagnostic::error("S006", "release = \"canopy\" needs a plant", span, "no plant in this scene");
            self.report.push(d.help("add [plants.NAME], or take another release"));
        }
        if keys.canopy.is_empty() {
            return (0..plants.len()).map(|i| (i, 1.0)).collect();
        }
        self.weights(("flight.canopy", span), &keys.canopy, root, plants).unwrap_or_default()
    }

    /// Weights of the forms, by their order.
    fn forms(&mut self, keys: &FlightKeys, span: Span) -> Vec<f64> {
        if keys.forms.is_empty() {
            return vec![1.0; FORMS.len()];
        }
        let mut weights = vec![0.0; FORMS.len()];
        for (name, weight) in &keys.forms {
            self.weight(("flight.forms", name), *weight, span);
            match FORMS.iter().position(|f| f == name) {
                Some(i) => weights[i] = *weight,
                None => {
                    let d = Diagnostic::error("S005", format!("there is no form \"{name}\""), span, "unknown form");
                    self.report.push(d.help(format!("forms: {}", FORMS.join(", "))));
                }
            }
        }
        weights
    }

    /// Places of a text file, x, y, z on each line; empty lines and those after # are left out.
    fn starts(&mut self, reference: &Reference) -> Option<Vec<[f64; 3]>> {
        let file = self.read(&reference.text, reference.span, "text-bytes", &[".csv", ".txt"])?;
        let text = String::from_utf8_lossy(&file.bytes).into_owned();
        let source = self.report.sources.add(file.shown.clone(), text.as_str());
        let (mut starts, mut at) = (Vec::new(), 0_usize);
        for line in text.split_inclusive('\n') {
            let own = line.split('#').next().unwrap_or_default();
            let parts = own.split([',', ';', ' ', '\t']).map(str::trim).filter(|p| !p.is_empty());
            let numbers: Vec<Option<f64>> = parts.map(|p| p.parse().ok().filter(|v: &f64| v.is_finite())).collect();
            match numbers[..] {
                [] => {}
                [Some(x), Some(y), Some(z)] => starts.push([x, y, z]),
                // A first line of names is usual.
                _ if starts.is_empty() && numbers.iter().all(Option::is_none) => {}
                _ => {
                    let end = at + own.trim_end().len();
                    let span = Span::new(source, at, end);
                    let d = Diagnostic::error("S003", "this line holds no place", span, "not three numbers");
                    self.report.push(d.help("write x, y, z in metres"));
                    return None;
                }
            }
            at += line.len();
        }
        self.limit("catkins", starts.len() as u64, Some(reference.span));
        Some(starts)
    }

    /// All solids of a scene.
    pub(super) fn solids(&mut self, root: &Table) -> Vec<SolidRecipe> {
        let Some(entry) = root.get("solid") else { return Vec::new() };
        let Value::List(list) = &entry.node.value else {
            self.report.push(*wrong("solid", &entry.node, "a list: write [[solid]]"));
            return Vec::new();
        };
        let mut names = Names::default();
        list.iter().enumerate().filter_map(|(i, node)| self.solid(i, node, &mut names)).collect()
    }

    fn solid(&mut self, i: usize, node: &Node, names: &mut Names) -> Option<SolidRecipe> {
        let path = format!("solid.{i}");
        let Value::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        let keys = SolidKeys::read(Some(table), &path, &mut self.report);
        for (key, shape) in [("roof", Shape::House), ("roof_color", Shape::House), ("mesh", Shape::Mesh)] {
            if let Some(entry) = table.get(key).filter(|_| keys.shape != shape) {
                let word = super::word_of(shape);
                let text = format!("{path}.{key} belongs to shape = \"{word}\"");
                let d = Diagnostic::warning("S007", text, entry.node.span, "has no effect");
                self.report.push(d.help(format!("write shape = \"{word}\"")));
            }
        }
        let mesh = match (keys.shape, &keys.mesh) {
            (Shape::Mesh, Some(reference)) => {
                let file = self.read(&reference.text, reference.span, "mesh-bytes", &[".obj", ".glb", ".gltf"])?;
                let wanted = (Up::Y, keys.mesh_scale, MaterialClass::Ground);
                Some(Arc::new(self.import(&file, wanted, reference.span)?))
            }
            (Shape::Mesh, None) => {
                let d = Diagnostic::error("S006", format!("[{path}] names no mesh"), node.span, "no mesh here");
                self.report.push(d.help("add mesh = \"FILE.obj\""));
                return None;
            }
            _ => None,
        };
        let wanted = if keys.name.is_empty() { super::word_of(keys.shape) } else { &keys.name };
        Some(SolidRecipe { id: names.unique(wanted), keys, mesh })
    }
}

/// With preset = "paper" what the scene does not say is as the paper has it.
fn as_printed(keys: &mut FlightKeys, table: &Table) {
    if keys.preset != FlightPreset::Paper {
        return;
    }
    let free = |name: &str| table.get(name).is_none();
    if free("inertia") {
        keys.inertia = false;
    }
    if free("glide") {
        keys.glide = 0.0;
    }
    if free("fall_spread") {
        keys.fall_spread = 0.0;
    }
    if free("cluster_rotation") {
        keys.cluster_rotation = false;
    }
}
