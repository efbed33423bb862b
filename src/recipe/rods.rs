//! Rods of a scene: how they hang together, where they are held, what acts on them.

use super::RodRecipe;
use super::key::{Section as _, wrong};
use super::resolve::Resolver;
use super::rod_keys::{RodClamp, RodHold, RodIntegrator, RodKeys, RodLoad, RodLoadKind};
use super::tree::{Node, Table, Value};
use osier_base::diagnostic::{Diagnostic, Span, nearest};
use osier_base::files::Names;
use osier_base::math;

impl Resolver<'_> {
    /// All rods of a scene, each after the one that it stands on.
    pub(super) fn rods(&mut self, root: &Table) -> Vec<RodRecipe> {
        let Some(entry) = root.get("rod") else { return Vec::new() };
        let Value::List(list) = &entry.node.value else {
            self.report.push(*wrong("rod", &entry.node, "a list: write [[rod]]"));
            return Vec::new();
        };
        let mut names = Names::default();
        let mut rods: Vec<RodRecipe> = Vec::new();
        for (i, node) in list.iter().enumerate() {
            if let Some(rod) = self.rod((i, node), &mut names, &rods) {
                rods.push(rod);
            }
        }
        let sections = rods.iter().map(|r| u64::from(r.keys.sections.unwrap_or(16))).sum::<u64>();
        let keys = sections.saturating_mul(self.frames);
        if let Err(e) = self.request.limits.check("motion-keys", keys, "the number of sections of rods times frames") {
            self.report.push(Diagnostic::error("S004", e.to_string(), entry.key_span, "over the limit"));
        }
        rods
    }

    fn rod(&mut self, (i, node): (usize, &Node), names: &mut Names, before: &[RodRecipe]) -> Option<RodRecipe> {
        let path = format!("rod.{i}");
        let Value::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        let keys = RodKeys::read(Some(table), &path, &mut self.report);
        let of = |name: &str| table.get(name).map_or(node.span, |e| e.node.span);
        let apart = |p: &[[f64; 3]]| (0..3).map(|k| (p[1][k] - p[0][k]) * (p[1][k] - p[0][k])).sum::<f64>();
        if keys.points.len() < 2 || keys.points.windows(2).any(|p| apart(p) < 1e-10) {
            let text = format!("[[rod]] {} needs two points or more, none twice in a row", i + 1);
            let d = Diagnostic::error("S006", text, of("points"), "no rod goes through these");
            self.report.push(d.help("write points = [[0, 0, 0], [0, 1, 0]], in metres from base to tip"));
            return None;
        }
        let on = if keys.on.is_empty() { None } else { Some(self.stands_on(&keys.on, of("on"), before)?) };
        self.check_rod(&keys, (table, node.span), on.is_some());
        let clamps = self.parts(table, &path, "clamp", |r, t, p| r.rod_clamp(t, p));
        let loads = self.parts(table, &path, "load", |r, t, p| r.rod_load(t, p));
        if let (Some(_), Some(entry)) = (on, table.get("clamp")) {
            let text = format!("[[rod]] {} is fixed in \"{}\" and held besides", i + 1, keys.on);
            let d = Diagnostic::warning("S007", text, entry.key_span, "both hold it");
            self.report.push(d.help("take one of both away unless that is meant"));
        }
        let wanted = if keys.name.is_empty() { "rod" } else { &keys.name };
        Some(RodRecipe { id: names.unique(wanted), on, clamps: clamps?, loads: loads?, keys })
    }

    /// Index of the rod of a name, among those before.
    fn stands_on(&mut self, name: &str, span: Span, before: &[RodRecipe]) -> Option<usize> {
        let found = before.iter().position(|r| r.keys.name == name);
        if found.is_none() {
            let d =
                Diagnostic::error("S005", format!("there is no rod \"{name}\" above this one"), span, "unknown rod");
            let names = before.iter().map(|r| r.keys.name.as_str()).filter(|n| !n.is_empty());
            self.report.push(match nearest(name, names) {
                Some(near) => d.help(format!("did you mean \"{near}\"?")).fix(span, format!("\"{near}\"")),
                None => d.help("a rod stands below the one that carries it, and that one has a name"),
            });
        }
        found
    }

    fn check_rod(&mut self, keys: &RodKeys, (table, span): (&Table, Span), carried: bool) {
        let of = |name: &str| table.get(name).map_or(span, |e| e.node.span);
        for name in ["integrator", "substeps", "gravity"].into_iter().filter(|_| carried) {
            if let Some(entry) = table.get(name) {
                let text = format!("{name} of a rod that another one carries has no effect");
                let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
                self.report.push(d.help("give it to the lowest rod"));
            }
        }
        if keys.bending.is_some() && table.get("E_GPa").is_some() {
            let d = Diagnostic::warning("S007", "EI takes the place of E_GPa", of("E_GPa"), "has no effect");
            self.report.push(d.help("leave one of both out"));
        }
        // Material: G/E of the given stiffnesses must be one.
        let r = keys.radius[0];
        let unit = std::f64::consts::PI * r * r * r * r;
        let young = keys.bending.map_or(keys.young * 1e9, |ei| 4.0 * ei / unit);
        if let Some(ratio) = keys.torsion.map(|gj| 2.0 * gj / unit / young).filter(|q| !(0.02..=0.5).contains(q)) {
            let text = format!("GJ makes the shear modulus {ratio:.3} of Young's, but it must be 0.02 to 0.5");
            let d = Diagnostic::error("S004", text, of("GJ"), "outside its range");
            self.report.push(d.help("for a round rod GJ is 2 EI times that ratio: about EI / 7 for wood"));
        }
        if matches!(keys.integrator, RodIntegrator::EulerExplicit) {
            let text =
                "euler_explicit is for comparison: it grows without bounds unless steps are tiny and damping is strong";
            let d = Diagnostic::warning("S041", text, of("integrator"), "as the paper has it");
            self.report.push(d.help("take integrator = \"xpbd\""));
        }
    }

    /// A list of tables below a rod.
    fn parts<T>(
        &mut self,
        table: &Table,
        path: &str,
        name: &str,
        read: impl Fn(&mut Self, &Table, &str) -> Option<T>,
    ) -> Option<Vec<T>> {
        let Some(entry) = table.get(name) else { return Some(Vec::new()) };
        let Value::List(list) = &entry.node.value else {
            self.report.push(*wrong(&format!("{path}.{name}"), &entry.node, &format!("a list: write [[rod.{name}]]")));
            return None;
        };
        let mut all = Some(Vec::new());
        for (i, node) in list.iter().enumerate() {
            let path = format!("{path}.{name}.{i}");
            let made = match &node.value {
                Value::Table(t) => read(self, t, &path),
                _ => {
                    self.report.push(*wrong(&path, node, "a table"));
                    None
                }
            };
            all = all.zip(made).map(|(mut all, made)| {
                all.push(made);
                all
            });
        }
        all
    }

    fn rod_clamp(&mut self, table: &Table, path: &str) -> Option<RodClamp> {
        let keys = RodClamp::read(Some(table), path, &mut self.report);
        let good = self.rod_times(table, (path, "keys"), &keys.keys, 4)
            & self.rod_times(table, (path, "turn_keys"), &keys.turns, 2);
        let only = [("turn_keys", RodHold::Fixed), ("axis", RodHold::Fixed), ("line", RodHold::Guided)];
        for (name, hold) in only {
            if let Some(entry) = table.get(name).filter(|_| keys.hold != hold) {
                let word = super::word_of(hold);
                let d = Diagnostic::warning(
                    "S007",
                    format!("{path}.{name} belongs to hold = \"{word}\""),
                    entry.node.span,
                    "has no effect",
                );
                self.report.push(d.help(format!("write hold = \"{word}\"")));
            }
        }
        let long = |v: [f64; 3]| math::sqrt(v.iter().fold(0.0, |s, x| s + x * x)) > 1e-9;
        for (name, v) in [("line", keys.line), ("axis", keys.axis)] {
            if let Some(entry) = table.get(name).filter(|_| !long(v)) {
                let d =
                    Diagnostic::error("S004", format!("{path}.{name} has no direction"), entry.node.span, "all zero");
                self.report.push(d.help("write [0, 1, 0] for upwards"));
            }
        }
        good.then_some(keys)
    }

    fn rod_load(&mut self, table: &Table, path: &str) -> Option<RodLoad> {
        let keys = RodLoad::read(Some(table), path, &mut self.report);
        let count = match keys.kind {
            RodLoadKind::Force | RodLoadKind::Blow => 4,
            RodLoadKind::Wrench => 7,
            RodLoadKind::Mass => 2,
        };
        if keys.keys.is_empty() {
            let text = format!("[[{path}]] has no keys");
            let span = table.get("kind").map_or(self.whole, |e| e.node.span);
            let d = Diagnostic::error("S006", text, span, "acts at no time");
            self.report.push(d.help("write keys = [[0, ...]]: seconds, then what acts"));
            return None;
        }
        let good = self.rod_times(table, (path, "keys"), &keys.keys, count);
        let light = keys.kind == RodLoadKind::Mass && keys.keys.iter().any(|k| k.get(1).is_some_and(|m| *m < 0.0));
        if let Some(entry) = table.get("keys").filter(|_| light) {
            let d = Diagnostic::error("S004", format!("{path}: a mass below 0"), entry.node.span, "at least 0 kg");
            self.report.push(d.help("a force that lifts is kind = \"force\""));
        }
        good.then_some(keys)
    }

    /// Whether keys have as many numbers as they need and rise in time; told if not.
    fn rod_times(&mut self, table: &Table, (path, name): (&str, &str), keys: &[Vec<f64>], count: usize) -> bool {
        let span = table.get(name).map_or(self.whole, |e| e.node.span);
        if let Some(key) = keys.iter().find(|k| k.len() != count) {
            let text = format!("a key of {path}.{name} has {} numbers, but must have {count}", key.len());
            let d = Diagnostic::error("S003", text, span, format!("keys of {count} numbers"));
            self.report.push(d.help("first seconds from the first frame, then what they hold"));
            return false;
        }
        let late = keys.windows(2).any(|k| k[1][0] <= k[0][0]);
        if late {
            let text = format!("times of {path}.{name} do not rise");
            let d = Diagnostic::error("S004", text, span, "each must be later than the one before");
            self.report.push(d.help("sort the keys by their first number"));
        }
        !late
    }
}
