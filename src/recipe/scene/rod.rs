//! `[[rod]]`: elastic rods, their clamps and loads.

use crate::recipe::RodRecipe;
use crate::recipe::resolve::Resolver;
use crate::recipe::syntax::word_of;
use crate::recipe::syntax::{
    BooleanType, ColorType, NumberArray, OneOf, OptionalKey, PointList, StringType, TomlNode, TomlTable, TomlValue,
    gigapascals, integer, millimetres, number, timed_degrees, timed_rows, wrong,
};
use crate::recipe::syntax::{choices, keys};
use osier_base::diagnostic::{Diagnostic, Span, nearest};
use osier_base::files::Names;
use osier_base::math;

choices! {
    /// Time integration of rods.
    RodIntegrator {
        /// Extended position-based dynamics with all springs solved together, second order in time: stable and accurate at any
        /// stiffness.
        Xpbd = "xpbd",
        /// One Gauss-Seidel pass over the springs per step: for soft ropes; stiff rods sag.
        XpbdGs = "xpbd_gs",
        /// Symplectic Euler with spring forces and small steps: the reference, slow for stiff rods.
        EulerSymplectic = "euler_symplectic",
        /// Explicit Euler as in the paper by Yang and Wu: needs damping and tiny steps.
        EulerExplicit = "euler_explicit",
    }
    /// Role of gravity in the shape that `points` draws.
    RodGravity {
        /// `points` is the shape under gravity; the rest shape without gravity is computed first.
        Posed = "posed",
        /// The weight of the rod is left out.
        Compensated = "compensated",
        /// `points` is the shape without gravity, from which the rod droops.
        Droop = "droop",
    }
    /// Boundary condition at a point of a rod.
    RodHold {
        /// Position and rotation are fixed.
        Fixed = "fixed",
        /// The position is fixed, the rotation is free.
        Pinned = "pinned",
        /// The position may slide along a line, the rotation is free.
        Guided = "guided",
    }
    /// Quantity that a load applies at a point of a rod, which decides the numbers of its keyframes.
    RodLoadKind {
        /// A force: keyframes of [s, x, y, z], N.
        Force = "force",
        /// A force and a torque: keyframes of [s, x, y, z, x, y, z], N and N m.
        Wrench = "wrench",
        /// An attached mass: keyframes of [s, kg]; it is released where the mass becomes 0.
        Mass = "mass",
        /// Impulses, one per keyframe: [s, x, y, z], N s.
        Blow = "blow",
    }
}

keys! {
    /// An elastic rod: a pole, a twig, a petiole. Its base is fixed unless a `[[rod.clamp]]` says otherwise.
    RodKeys at "rod" as list {
        /// Name, to which other rods refer by `on`.
        name: String = "name" StringType("");
        /// Points of the axis from base to tip, interpolated by a smooth curve.
        points: Vec<[f64; 3]> = "points" PointList;
        /// Radius at the base and at the tip.
        radius: [f64; 2] = "radius_mm" NumberArray([3.0, 2.0], millimetres(3.0, 0.05, 2000.0));
        /// Name of the rod to which the base is clamped.
        on: String = "on" StringType("");
        /// Position on that rod: 0 is its base, 1 its tip.
        on_at: f64 = "on_at" number(1.0, 0.0, 1.0, "");
        /// Young's modulus along the rod.
        elasticity: f64 = "elasticity_gpa" gigapascals(5.0, 1e-5, 1000.0);
        /// Bending stiffness EI at the base, instead of Young's modulus.
        bending_stiffness: Option<f64> = "bending_stiffness" OptionalKey(number(1.0, 1e-9, 1e9, "N m^2"), "from elasticity_gpa and radius_mm");
        /// Shear modulus divided by Young's modulus.
        shear_ratio: f64 = "shear_ratio" number(1.0 / 15.0, 0.02, 0.5, "");
        /// Torsional stiffness GJ at the base, instead of the shear modulus.
        torsional_stiffness: Option<f64> = "torsional_stiffness" OptionalKey(number(1.0, 1e-9, 1e9, "N m^2"), "from shear_ratio");
        /// Density of the material.
        density: f64 = "density" number(900.0, 1.0, 20_000.0, "kg/m^3");
        /// Damping ratio of the lowest mode; 1 is critical.
        damping_ratio: f64 = "damping_ratio" number(0.2, 0.0, 1.0, "");
        /// Stiffness of the springs that restore the drawn pose, as a fraction of the bending stiffness.
        recovery: f64 = "recovery" number(0.25, 0.0, 4.0, "");
        /// Divides the stiffness, for exaggerated bending.
        compliance: f64 = "compliance" number(1.0, 1.0, 20.0, "");
        /// Drag coefficient; 0 disables wind.
        drag: f64 = "drag" number(1.1, 0.0, 3.0, "");
        /// Number of cross-sections.
        sections: Option<u32> = "sections" OptionalKey(integer(9, 2, 64), "an interval of 3 radii, 5 to 16");
        /// Time integrator; connected rods use that of the lowest rod.
        integrator: RodIntegrator = "integrator" OneOf(RodIntegrator::Xpbd);
        /// Time steps per frame; connected rods use those of the lowest rod.
        substeps: Option<u32> = "substeps" OptionalKey(integer(8, 1, 200_000), "8, more below 24 frames per second, or as many as the lowest natural frequency needs");
        /// Effect of gravity: the drawn pose is in equilibrium ("posed"), no self-weight ("compensated"), or the drawn pose
        /// is the rest shape ("droop"). Connected rods use that of the lowest rod.
        gravity: RodGravity = "gravity" OneOf(RodGravity::Posed);
        /// Initial velocity of the tip, decreasing to zero at the base.
        launch: [f64; 3] = "launch" NumberArray([0.0; 3], number(0.0, -1000.0, 1000.0, "m/s"));
        /// Colour of the whole rod.
        color: [f32; 3] = "color" ColorType("#8a6f4d");
    }
    /// A boundary condition of a rod.
    RodClampKeys at "rod.clamp" as list {
        /// Position along the rod: 0 is the base, 1 the tip.
        at: f64 = "at" number(0.0, 0.0, 1.0, "");
        /// Type: position and direction fixed ("fixed"), position fixed ("pinned"), or guided along a line ("guided").
        hold: RodHold = "hold" OneOf(RodHold::Fixed);
        /// With "guided": direction of the line.
        line: [f64; 3] = "line" NumberArray([0.0, 1.0, 0.0], number(0.0, -1e6, 1e6, ""));
        /// Displacement of the clamp: keyframes [s, x, y, z], in metres from the drawn position.
        keyframes: Vec<Vec<f64>> = "keyframes" timed_rows();
        /// With "fixed": axis of rotation.
        axis: [f64; 3] = "axis" NumberArray([0.0, 1.0, 0.0], number(0.0, -1e6, 1e6, ""));
        /// With "fixed": rotation about `axis`: keyframes [s, degrees].
        turn_keyframes: Vec<Vec<f64>> = "turn_keyframes" timed_degrees();
    }
    /// A load at a point of a rod.
    RodLoadKeys at "rod.load" as list {
        /// Position along the rod: 0 is the base, 1 the tip.
        at: f64 = "at" number(1.0, 0.0, 1.0, "");
        /// Type: force (N), wrench (force and moment), mass (kg), or impulse ("blow", N s).
        kind: RodLoadKind = "kind" OneOf(RodLoadKind::Force);
        /// Time and value; linear between keyframes, constant before the first and after the last.
        keyframes: Vec<Vec<f64>> = "keyframes" timed_rows();
        /// With "mass": whether it is shown, as a sphere of water of this mass.
        show: bool = "show" BooleanType(true);
        /// With "mass": colour.
        color: [f32; 3] = "color" ColorType("#a83a2c");
    }
}

impl Resolver<'_> {
    /// Reads every `[[rod]]`, each after the rod that carries it; leaves out those with errors.
    pub(in crate::recipe) fn rods(&mut self, root: &TomlTable) -> Vec<RodRecipe> {
        let Some(entry) = root.get("rod") else { return Vec::new() };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong("rod", &entry.node, "a list: write [[rod]]"));
            return Vec::new();
        };
        let mut names = Names::default();
        let mut rods: Vec<RodRecipe> = Vec::new();
        for (i, node) in list.iter().enumerate() {
            if let Some(rod) = self.rod(i, node, &mut names, &rods) {
                rods.push(rod);
            }
        }
        // A clip stores a position and a rotation of every section for every frame.
        // Rods that choose their number of sections take at most 16.
        let sections = rods.iter().map(|r| u64::from(r.keys.sections.unwrap_or(16))).sum::<u64>();
        let keys = sections.saturating_mul(self.frames);
        if let Err(e) = self.request.limits.check("motion-keys", keys, "the number of sections of rods times frames") {
            self.report.push(Diagnostic::error("S004", e.to_string(), entry.key_span, "over the limit"));
        }
        rods
    }

    fn rod(&mut self, i: usize, node: &TomlNode, names: &mut Names, before: &[RodRecipe]) -> Option<RodRecipe> {
        let path = format!("rod.{i}");
        let TomlValue::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        let keys = self.read_keys::<RodKeys>(table, &path);
        let of = |name: &str| table.get(name).map_or(node.span, |e| e.node.span);
        if keys.points.is_empty() && table.holds("points") {
            return None;
        }
        // Points closer than 0.01 mm are taken for the same one: the axis has no direction between them.
        let apart = |p: &[[f64; 3]]| (0..3).map(|k| (p[1][k] - p[0][k]) * (p[1][k] - p[0][k])).sum::<f64>();
        if keys.points.len() < 2 || keys.points.windows(2).any(|p| apart(p) < 1e-10) {
            let text = format!("[[rod]] {} needs two points or more, none twice in a row", i + 1);
            let d = Diagnostic::error("S006", text, of("points"), "needs two distinct points");
            self.report.push(d.help("write points = [[0, 0, 0], [0, 1, 0]], in metres from base to tip"));
            return None;
        }
        // A rod without `on` is clamped in the world; any other is fixed to a rod that precedes it in the scene.
        let on = if keys.on.is_empty() { None } else { Some(self.carrier_rod(&keys.on, of("on"), before)?) };
        self.check_rod(&keys, table, node.span, on.is_some());
        let clamps = self.read_subtables(table, &path, "clamp", |r, t, p| r.rod_clamp(t, p));
        let loads = self.read_subtables(table, &path, "load", |r, t, p| r.rod_load(t, p));
        if let (Some(_), Some(entry)) = (on, table.get("clamp")) {
            let text = format!("[[rod]] {} is fixed to \"{}\" and has clamps of its own", i + 1, keys.on);
            let d = Diagnostic::warning("S007", text, entry.key_span, "both constrain the rod");
            self.report.push(d.help("remove one of them unless both are intended"));
        }
        let wanted = if keys.name.is_empty() { "rod" } else { &keys.name };
        Some(RodRecipe { id: names.unique(wanted), on, clamps: clamps?, loads: loads?, keys })
    }

    /// Index of the rod with a name among the preceding rods; `None` and S005 if there is none.
    fn carrier_rod(&mut self, name: &str, span: Span, before: &[RodRecipe]) -> Option<usize> {
        // Only rods above this one are searched, so that no rod can carry itself through others.
        let found = before.iter().position(|r| r.keys.name == name);
        if found.is_none() {
            let d =
                Diagnostic::error("S005", format!("there is no rod \"{name}\" above this one"), span, "unknown rod");
            let names = before.iter().map(|r| r.keys.name.as_str()).filter(|n| !n.is_empty());
            self.report.push(match nearest(name, names) {
                Some(near) => d.help(format!("did you mean \"{near}\"?")).fix(span, format!("\"{near}\"")),
                None => d.help("list a rod after the rod that carries it, and give that one a name"),
            });
        }
        found
    }

    fn check_rod(&mut self, keys: &RodKeys, table: &TomlTable, span: Span, carried: bool) {
        let of = |name: &str| table.get(name).map_or(span, |e| e.node.span);
        for name in ["integrator", "substeps", "gravity"].into_iter().filter(|_| carried) {
            if let Some(entry) = table.get(name) {
                let text = format!("{name} has no effect on a rod fixed to another rod");
                let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
                self.report.push(d.help("set it on the rod at the base"));
            }
        }
        for (stiffness, modulus) in [("bending_stiffness", "elasticity_gpa"), ("torsional_stiffness", "shear_ratio")] {
            if table.get(stiffness).is_some() && table.get(modulus).is_some() {
                let text = format!("{stiffness} replaces {modulus}");
                let d = Diagnostic::warning("S007", text, of(modulus), "has no effect");
                self.report.push(d.help("leave one of both out"));
            }
        }
        // G/E that follows from the given stiffnesses must be within its range.
        // For a round cross-section EI = E pi r^4 / 4 and GJ = G pi r^4 / 2, hence E = 4 EI / (pi r^4) and G/E = 2 GJ / (pi r^4 E).
        let r = keys.radius[0];
        let unit = std::f64::consts::PI * r * r * r * r;
        let young = keys.bending_stiffness.map_or(keys.elasticity, |ei| 4.0 * ei / unit);
        // Isotropic materials have a ratio of 1/3 to 1/2, wood about 1/15; outside of the range one stiffness is a slip.
        if let Some(ratio) =
            keys.torsional_stiffness.map(|gj| 2.0 * gj / unit / young).filter(|q| !(0.02..=0.5).contains(q))
        {
            let text = format!(
                "torsional_stiffness makes the shear modulus {ratio:.3} of Young's, but it must be 0.02 to 0.5"
            );
            let d = Diagnostic::error("S004", text, of("torsional_stiffness"), "outside its range");
            self.report.push(d.help(
                "for a round rod torsional_stiffness is 2 bending_stiffness times that ratio: about 1/7 of it for wood",
            ));
        }
        if matches!(keys.integrator, RodIntegrator::EulerExplicit) {
            let text =
                "euler_explicit is for comparison: it grows without bounds unless steps are tiny and damping is strong";
            let d = Diagnostic::warning("S041", text, of("integrator"), "as the paper has it");
            self.report.push(d.help("take integrator = \"xpbd\""));
        }
    }

    /// Reads a list of tables below a rod; empty without the key, `None` if some table has an error.
    fn read_subtables<T>(
        &mut self,
        table: &TomlTable,
        path: &str,
        name: &str,
        read: impl Fn(&mut Self, &TomlTable, &str) -> Option<T>,
    ) -> Option<Vec<T>> {
        let Some(entry) = table.get(name) else { return Some(Vec::new()) };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong(&format!("{path}.{name}"), &entry.node, &format!("a list: write [[rod.{name}]]")));
            return None;
        };
        let mut all = Some(Vec::new());
        for (i, node) in list.iter().enumerate() {
            let path = format!("{path}.{name}.{i}");
            let made = match &node.value {
                TomlValue::Table(t) => read(self, t, &path),
                _ => {
                    self.report.push(*wrong(&path, node, "a table"));
                    None
                }
            };
            // A table with an error makes the result `None`, but the others are still read to report their errors.
            all = all.zip(made).map(|(mut all, made)| {
                all.push(made);
                all
            });
        }
        all
    }

    fn rod_clamp(&mut self, table: &TomlTable, path: &str) -> Option<RodClampKeys> {
        let keys = self.read_keys::<RodClampKeys>(table, path);
        // Displacements have three components after the time, rotations one angle.
        let good = self.check_rod_keyframes(table, path, "keyframes", &keys.keyframes, 4)
            & self.check_rod_keyframes(table, path, "turn_keyframes", &keys.turn_keyframes, 2);
        let only = [("turn_keyframes", RodHold::Fixed), ("axis", RodHold::Fixed), ("line", RodHold::Guided)];
        for (name, hold) in only {
            if let Some(entry) = table.get(name).filter(|_| keys.hold != hold) {
                let word = word_of(hold);
                let d = Diagnostic::warning(
                    "S007",
                    format!("{path}.{name} needs hold = \"{word}\""),
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

    fn rod_load(&mut self, table: &TomlTable, path: &str) -> Option<RodLoadKeys> {
        let before = self.report.diagnostics.len();
        let keys = self.read_keys::<RodLoadKeys>(table, path);
        // If `kind` could not be read, the expected count of numbers per keyframe is unknown.
        if self.report.diagnostics.iter().skip(before).any(|d| d.code != "S002") {
            return None;
        }
        // Numbers of a keyframe: the time and a vector; the time, a force and a torque; or the time and a mass.
        let count = match keys.kind {
            RodLoadKind::Force | RodLoadKind::Blow => 4,
            RodLoadKind::Wrench => 7,
            RodLoadKind::Mass => 2,
        };
        if keys.keyframes.is_empty() && table.holds("keyframes") {
            return None;
        }
        if keys.keyframes.is_empty() {
            let text = format!("[[{path}]] has no keyframes");
            let span = table.get("kind").map_or(self.whole, |e| e.node.span);
            let d = Diagnostic::error("S006", text, span, "acts at no time");
            self.report.push(d.help("write keyframes = [[0, ...]]: seconds, then what acts"));
            return None;
        }
        let good = self.check_rod_keyframes(table, path, "keyframes", &keys.keyframes, count);
        let light = keys.kind == RodLoadKind::Mass && keys.keyframes.iter().any(|k| k.get(1).is_some_and(|m| *m < 0.0));
        if let Some(entry) = table.get("keyframes").filter(|_| light) {
            let d = Diagnostic::error("S004", format!("{path}: a mass below 0"), entry.node.span, "at least 0 kg");
            self.report.push(d.help("a force that lifts is kind = \"force\""));
        }
        good.then_some(keys)
    }

    /// Whether keyframes have `count` numbers and rise in time; S003 or S004 if not. `path`, `name`: of the table and its key.
    fn check_rod_keyframes(
        &mut self,
        table: &TomlTable,
        path: &str,
        name: &str,
        keys: &[Vec<f64>],
        count: usize,
    ) -> bool {
        let span = table.get(name).map_or(self.whole, |e| e.node.span);
        if let Some(key) = keys.iter().find(|k| k.len() != count) {
            let text = format!("a keyframe of {path}.{name} has {} numbers, but must have {count}", key.len());
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
