//! `[plants.NAME.growth]` and `.shapes` files: parameters of particle-shapes.

use super::SolidKeys;
use crate::recipe::ReferencedFile;
use crate::recipe::resolve::{Resolver, span_of};
use crate::recipe::syntax::{
    BooleanType, NumberArray, NumbersByLevel, OneOf, OptionalKey, RisingPairs, StringType, TomlTable, TomlValue,
    degrees, integer, number, point, word_of,
};
use crate::recipe::syntax::{InlineTables, KeyTable as _, choices, keys};
use osier_base::diagnostic::{Diagnostic, Report, Severity, nearest};
use osier_plants::grow::radii::Taper;
use std::marker::PhantomData;

choices! {
    /// Equations of motion of particles.
    ShapeEquations {
        /// In SI units and independent of the step, with gravity, light and solids.
        Corrected = "corrected",
        /// As printed in the paper: the result depends on the step.
        Paper = "paper",
    }
    /// Length of branches along their parent, from its tip to its lowest branch.
    ShapeCrown {
        /// Longest below: a spire.
        Conical = "conical",
        /// Longest in the middle.
        Spherical = "spherical",
        /// Longest below, rounded above.
        Hemispherical = "hemispherical",
        /// All equally long.
        Cylindrical = "cylindrical",
        /// Half as long at the tip as below.
        Tapered = "tapered",
        /// Longest at the tip.
        Inverse = "inverse",
        /// Longest below the middle, short at both ends.
        Flame = "flame",
    }
    /// Rule for the radii of a plant of particle-shapes.
    ShapeRadii {
        /// Pipe model: the power sum of the radii above a fork equals that below it.
        Pipe = "pipe",
        /// Radius that tapers along each axis.
        Taper = "taper",
        /// Truncated cones between branches, with random ratios of their radii.
        Cone = "cone",
    }
    /// Shape of a region that confines a plant, or that it avoids.
    RegionShape {
        /// Ball with centre `at` and `radius`.
        Sphere = "sphere",
        /// Ellipsoid with centre `at` and diameters `size`.
        Ellipsoid = "ellipsoid",
        /// Box along the axes with centre `at` and edges `size`.
        Box = "box",
        /// Points within `radius` of the segment from `at` to `to`.
        Capsule = "capsule",
        /// Upright cone: `at` is the centre of its base, `radius` that of the base, `height` that of the tip above it.
        Cone = "cone",
        /// The half space behind the plane through `at` with `normal`.
        Plane = "plane",
        /// The `[[solid]]` of this `name`.
        Solid = "solid",
    }
}

keys! {
    /// A region in plant space: an obstacle of growth, or an envelope that it is cut off at.
    RegionKeys at "plants.NAME.growth.obstacles" also "plants.NAME.growth.envelope" also "plants.NAME.fill.obstacles"
    also "plants.NAME.fill.envelope" as list {
        /// Form of the region.
        shape: RegionShape = "shape" OneOf(RegionShape::Sphere);
        /// Its middle; of a capsule one end, of a cone the middle of its base.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// The other end of a capsule.
        to: [f64; 3] = "to" point([0.0, 3.0, 0.0]);
        /// Whole extent of a box or an ellipsoid along x, y, z.
        size: [f64; 3] = "size" NumberArray([1.0; 3], number(1.0, 0.001, 1e4, "m"));
        /// Radius of a sphere, a capsule or the base of a cone.
        radius: f64 = "radius" number(0.5, 0.001, 1e4, "m");
        /// Height of a cone.
        height: f64 = "height" number(1.0, 0.001, 1e4, "m");
        /// Direction out of the half space of a plane.
        normal: [f64; 3] = "normal" NumberArray([0.0, 1.0, 0.0], number(0.0, -1e3, 1e3, ""));
        /// Name of a `[[solid]]`.
        name: String = "name" StringType("");
    }
    /// Growth by particle-shapes, over the values of the plant's `.shapes` file. `[plants.NAME.fill]` has the same keys for
    /// twigs and leaves that are added to a finished plant, over the values of the file `twigs`. Lists have one number for each level of
    /// branching, from the trunk on; the last one holds for all higher levels. Growth time t is an arbitrary unit.
    ShapeKeys at "plants.NAME.growth" also "plants.NAME.fill" {
        /// Number of levels of branching; the last one bears the leaves.
        levels: u32 = "levels" integer(4, 1, 8), basic;
        /// Length of axes; of branches that where `crown` is 1.
        length: Vec<f64> = "length" NumbersByLevel(&[8.0, 3.0, 1.0, 0.35], number(1.0, 0.005, 100.0, "m")), basic;
        /// Standard deviation of the logarithm of the length.
        length_var: f64 = "length_var" number(0.15, 0.0, 1.0, "");
        /// Number of root axes.
        roots: u32 = "roots" integer(1, 1, 100_000), basic;
        /// Radius of the disc that they start in.
        root_radius: f64 = "root_radius" number(0.0, 0.0, 1e3, "m");
        /// Least and greatest angle to the vertical at which they start.
        root_tilt: [f64; 2] = "root_tilt_deg" NumberArray([0.0, 0.0], degrees(0.0, 0.0, 175.0));
        /// How much they tilt away from the middle of the disc: 0 in any direction, 1 outwards.
        root_outward: f64 = "root_outward" number(0.0, 0.0, 1.0, "");
        /// Outline of the crown: length of branches along their parent.
        crown: ShapeCrown = "crown" OneOf(ShapeCrown::Spherical), basic;
        /// Speed of growth.
        speed: Vec<f64> = "speed" NumbersByLevel(&[1.0, 0.7, 0.5, 0.4], number(1.0, 0.01, 10.0, "m/t"));
        /// Rate at which the velocity follows the target direction: small values bend in wide arcs.
        spread: Vec<f64> = "spread" NumbersByLevel(&[4.0, 3.0, 3.0, 4.0], number(3.0, 0.0, 50.0, "1/t"));
        /// Random walk of the target direction: 0 is straight.
        wander: Vec<f64> = "wander" NumbersByLevel(&[0.05, 0.15, 0.25, 0.3], number(0.1, 0.0, 3.0, "t^-1/2")), basic;
        /// Twist: rotation of velocity and frame about the direction of growth.
        twist: Vec<f64> = "twist" NumbersByLevel(&[0.1, 0.2, 0.0], number(0.0, -30.0, 30.0, "rad/t"));
        /// Coiling: rotation of the target direction about the direction at the start.
        coil: Vec<f64> = "coil" NumbersByLevel(&[0.0], number(0.0, -30.0, 30.0, "rad/t"));
        /// Angle between both directions on a coiling axis.
        coil_angle: f64 = "coil_angle_deg" degrees(25.0, 0.0, 80.0);
        /// Downward acceleration, which increases with the length grown; negative values rise.
        gravity: Vec<f64> = "gravity" NumbersByLevel(&[0.02, 0.1, 0.2, 0.1], number(0.0, -5.0, 5.0, "m/t^2")), basic;
        /// Rate at which growth turns upwards; negative values turn downwards.
        up: Vec<f64> = "up" NumbersByLevel(&[0.1, 0.15, 0.1, 0.0], number(0.0, -5.0, 5.0, "1/t"));
        /// Rate at which growth turns out of the plant's own shade.
        light: Vec<f64> = "light" NumbersByLevel(&[0.0], number(0.0, -5.0, 5.0, "1/t"));
        /// Rate at which growth turns towards points spread in the envelope.
        attract: Vec<f64> = "attract" NumbersByLevel(&[0.0], number(0.0, -5.0, 5.0, "1/t"));
        /// Rate at which growth turns away from obstacles nearby.
        avoid: Vec<f64> = "avoid" NumbersByLevel(&[1.0], number(0.0, -5.0, 5.0, "1/t"));
        /// Rate at which growth turns towards obstacles nearby, to climb them.
        climb: Vec<f64> = "climb" NumbersByLevel(&[0.0], number(0.0, -5.0, 5.0, "1/t"));
        /// Median distance between branches.
        spacing: Vec<f64> = "spacing" NumbersByLevel(&[0.35, 0.18, 0.06], number(0.1, 0.002, 10.0, "m")), basic;
        /// Standard deviation of the logarithm of that distance.
        spacing_sigma: f64 = "spacing_sigma" number(0.3, 0.0, 1.0, "");
        /// Fraction of an axis that bears no branches at its base.
        base: Vec<f64> = "base" NumbersByLevel(&[0.25, 0.1, 0.05], number(0.0, 0.0, 1.0, ""));
        /// Fraction of buds that do not grow.
        dormancy: f64 = "dormancy" number(0.15, 0.0, 1.0, "");
        /// Buds at a site: 1 alternate, 2 opposite, 3 to 5 whorled.
        buds: u32 = "buds" integer(1, 1, 5);
        /// Angle between an axis and its branches.
        angle: Vec<f64> = "angle_deg" NumbersByLevel(&[55.0, 45.0, 45.0], degrees(45.0, 0.0, 175.0));
        /// Standard deviation of that angle.
        angle_var: f64 = "angle_var_deg" degrees(5.0, 0.0, 60.0);
        /// Standard deviation of the azimuth of a bud.
        jitter: f64 = "jitter_deg" degrees(8.0, 0.0, 60.0);
        /// Upward part added to the direction of a new branch.
        up_bias: f64 = "up_bias" number(0.0, -5.0, 5.0, "");
        /// Fraction of the parent's direction with which a branch leaves it, before it bends out.
        flow: f64 = "flow" number(0.35, 0.0, 1.0, "");
        /// Probability that an axis forks at its tip.
        split: Vec<f64> = "split" NumbersByLevel(&[0.0], number(0.0, 0.0, 1.0, ""));
        /// Angle of such forks.
        split_angle: f64 = "split_deg" degrees(50.0, 0.0, 150.0);
        /// Probability that an axis ends at its last branch, which goes on in its place.
        apex_death: Vec<f64> = "apex_death" NumbersByLevel(&[0.0], number(0.0, 0.0, 1.0, ""));
        /// Age at which axes end.
        max_age: Option<f64> = "max_age" OptionalKey(number(10.0, 0.0, 1e6, "t"), "none");
        /// Depth of shade in which axes end.
        max_shade: Option<f64> = "max_shade" OptionalKey(number(1.0, 0.0, 1e3, ""), "none");
        /// Most nodes of the plant: a level that would exceed them is not grown.
        max_nodes: u32 = "max_nodes" integer(2_000_000, 1, 20_000_000);
        /// Regions outside of which the plant is cut off.
        envelope: Vec<RegionKeys> = "envelope" InlineTables::<RegionKeys>(PhantomData);
        /// Regions that the plant grows round.
        obstacles: Vec<RegionKeys> = "obstacles" InlineTables::<RegionKeys>(PhantomData);
        /// Whether it also grows round every `[[solid]]` of the scene.
        solids: bool = "solids" BooleanType(false);
        /// Whether it stays above the ground, the plane of its roots.
        ground: bool = "ground" BooleanType(true);
        /// Source of the radii.
        radii: ShapeRadii = "radii" OneOf(ShapeRadii::Pipe);
        /// Radius of the root axes at their base.
        radius: Option<f64> = "radius" OptionalKey(number(0.18, 1e-4, 10.0, "m"), "by the pipe model; 0.02 with others"), basic;
        /// Radius at the tips.
        tip_radius: f64 = "tip_radius" number(0.0015, 1e-5, 1.0, "m");
        /// Exponent of the pipe model, or of the taper.
        exponent: Option<f64> = "exponent" OptionalKey(number(2.3, 0.3, 6.0, ""), "2.3; 1 for tapers");
        /// With radii = "cone": ratios of top to bottom radius of an internode, each with its weight.
        ratios: Vec<[f64; 2]> = "ratios" RisingPairs(number(0.0, 1e-3, 1e3, ""));
        /// Width of the blade that each axis is, instead of a round tube.
        blade_width: Option<f64> = "blade_width" OptionalKey(number(0.004, 1e-4, 1.0, "m"), "round tubes");
        /// Distance between leaves; 0 for none.
        leaf_spacing: f64 = "leaf_spacing" number(0.02, 0.0, 10.0, "m"), basic;
        /// Axes below the last level bear leaves where they are thinner than this.
        leaf_radius: f64 = "leaf_radius" number(0.006, 0.0, 1.0, "m");
        /// Angle between an axis and its leaves.
        leaf_angle: f64 = "leaf_angle_deg" degrees(50.0, 0.0, 175.0);
        /// Standard deviation of that angle.
        leaf_angle_var: f64 = "leaf_angle_var_deg" degrees(10.0, 0.0, 60.0);
        /// Standard deviation of the logarithm of the size of leaves.
        leaf_var: f64 = "leaf_var" number(0.12, 0.0, 1.0, "");
        /// How far leaves turn their upper side to the sky.
        face_up: f64 = "face_up" number(0.4, 0.0, 1.0, "");
        /// Equations of motion.
        equations: ShapeEquations = "equations" OneOf(ShapeEquations::Corrected);
        /// With equations = "paper": the factor `spread` of each step.
        paper_spread: f64 = "paper_spread" number(0.1, 0.0, 1.0, "");
        /// Factor on the length of steps: 1 is a sixteenth of an axis, at most 5 cm.
        step: f64 = "step" number(1.0, 0.05, 8.0, "");
    }
}

impl ShapeKeys {
    /// Whether solids of the scene are its obstacles or its envelope.
    pub fn reads_solids(&self) -> bool {
        self.solids || self.envelope.iter().chain(&self.obstacles).any(|r| r.shape == RegionShape::Solid)
    }
}

/// Keys without a meaning for twigs that fill a plant: such twigs have no roots, no rule for radii, and are not blades.
const OF_WHOLE_PLANTS: [&str; 8] =
    ["roots", "root_radius", "root_tilt_deg", "root_outward", "radii", "exponent", "ratios", "blade_width"];

impl Resolver<'_> {
    /// Reads the keys of a `.shapes` file, overridden by those of the table `name` of a plant; `None` if some have errors.
    pub(in crate::recipe) fn shape_keys(
        &mut self,
        file: &ReferencedFile,
        plant: &TomlTable,
        path: &str,
        name: &str,
    ) -> Option<ShapeKeys> {
        // Errors reported from here on make the keys invalid; warnings, and errors of other tables, do not.
        let before = self.report.diagnostics.len();
        let parsed = self.parse_file(file)?;
        let merged = self.laid_over(parsed, plant, path, name);
        let keys: ShapeKeys = self.read_keys(&merged, &format!("{path}.{name}"));
        self.check_shape_keys(&keys, &merged, &format!("{path}.{name}"));
        self.check_region_keys(&keys, &merged, &format!("{path}.{name}"));
        self.check_region_solids(&keys, &merged, &format!("{path}.{name}"));
        // Check only the plant's own keys: a file of twigs may be written for a whole plant.
        for key in OF_WHOLE_PLANTS.into_iter().filter(|_| name == "fill") {
            let is_told = key == "ratios" && keys.radii != ShapeRadii::Cone;
            if span_of(plant, &[name, key]).is_some() && !is_told {
                self.has_no_effect(
                    plant,
                    path,
                    &[name, key],
                    "twigs begin on axes of the plant and taper to their tips",
                );
            }
        }
        let faulty = self.report.diagnostics.iter().skip(before).any(|d| d.severity == Severity::Error);
        (!faulty).then_some(keys)
    }

    /// Reports errors that involve several keys: reversed ranges, ratios above 1, keys without effect.
    fn check_shape_keys(&mut self, keys: &ShapeKeys, table: &TomlTable, path: &str) {
        self.in_order(table, path, "root_tilt_deg", keys.root_tilt);
        let span = |key: &str| span_of(table, &[key]);
        if keys.radii == ShapeRadii::Cone && keys.ratios.iter().any(|r| r[0] > 1.0) {
            let d = Diagnostic::error(
                "S004",
                format!("{path}.ratios has a ratio above 1: an internode would widen upwards"),
                span("ratios").unwrap_or(self.whole),
                "at most 1",
            );
            self.report
                .push(d.help("write [ratio, weight] with ratios up to 1: [[0.78, 0.25], [0.84, 0.5], [0.9, 0.25]]"));
        }
        // Blades have no radii, cones never widen, and the pipe model without `radius` makes root axes as thick as their tips add up to.
        // Twigs that fill a plant limit `tip_radius` to the thickness of what bears them.
        let tapered = keys.radii == ShapeRadii::Taper;
        let base = keys.radius.or_else(|| tapered.then(|| Taper::default().base));
        let widens = path.ends_with(".growth") && keys.blade_width.is_none() && keys.radii != ShapeRadii::Cone;
        if let Some(base) = base.filter(|base| widens && *base < keys.tip_radius) {
            let at = span("tip_radius").or_else(|| span("radius")).unwrap_or(self.whole);
            let text =
                format!("{path}: axes of {base} m at their base would widen to tip_radius = {} m", keys.tip_radius);
            let d = Diagnostic::error("S003", text, at, "thicker than the base");
            self.report.push(d.help("give radius a larger value than tip_radius"));
        }
        // Areas below an exponent of 1 would grow faster than the number of tips; a taper may have any.
        if let Some(exponent) = keys.exponent.filter(|n| *n < 1.0 && keys.radii == ShapeRadii::Pipe) {
            let text = format!("{path}.exponent is {exponent}; that of the pipe model is at least 1");
            let at = span("exponent").unwrap_or(self.whole);
            let d = Diagnostic::error("S003", text, at, "out of range");
            self.report.push(d.help("write 1 to 6, or take radii = \"taper\""));
        }
        // Attraction of 0 at every level is the same as none.
        let guided = keys.attract.iter().any(|a| *a != 0.0);
        // The half space of a plane has no bounds in which points could be spread.
        let is_bounded = !keys.envelope.is_empty() && keys.envelope.iter().all(|r| r.shape != RegionShape::Plane);
        for (key, useless, needs) in [
            ("attract", guided && !is_bounded, "an `envelope` without planes, in which the points lie"),
            ("ratios", keys.radii != ShapeRadii::Cone, "radii = \"cone\""),
            ("paper_spread", keys.equations != ShapeEquations::Paper, "equations = \"paper\""),
        ] {
            if let Some(at) = span(key).filter(|_| useless) {
                let d = Diagnostic::warning("S007", format!("{path}.{key} has no effect"), at, "has no effect");
                self.report.push(d.help(format!("it needs {needs}")));
            }
        }
        self.check_idle_keys(keys, table, path);
        if keys.equations == ShapeEquations::Paper {
            self.check_paper_keys(keys, table, path);
        }
    }

    /// Reports S007 for keys that describe what the plant does not have, unless another text takes it away: a scene may switch off what
    /// its file describes.
    fn check_idle_keys(&mut self, keys: &ShapeKeys, table: &TomlTable, path: &str) {
        let any = |values: &[f64]| values.iter().any(|v| *v != 0.0);
        let has_solids = keys.solids || !keys.obstacles.is_empty();
        let has_leaves = keys.leaf_spacing > 0.0;
        // Twigs that fill a plant begin on its axes and not in a disc.
        let has_disc = keys.roots > 1 || path.ends_with(".fill");
        let is_round = keys.blade_width.is_none() || path.ends_with(".fill");
        let (leaves, solids) = ("leaves: leaf_spacing = 0.02", "`obstacles`, or solids = true");
        let tube = "a round tube: leave `blade_width` out";
        let all = [
            ("root_radius", has_disc, "roots", "several root axes: roots = 5"),
            ("coil_angle_deg", any(&keys.coil), "coil", "a helix: coil = 4"),
            ("split_deg", any(&keys.split), "split", "forks at tips: split = 0.3"),
            ("avoid", has_solids || !any(&keys.avoid), "obstacles", solids),
            ("climb", has_solids || !any(&keys.climb), "obstacles", solids),
            ("leaf_radius", has_leaves, "leaf_spacing", leaves),
            ("leaf_angle_deg", has_leaves, "leaf_spacing", leaves),
            ("leaf_angle_var_deg", has_leaves, "leaf_spacing", leaves),
            ("leaf_var", has_leaves, "leaf_spacing", leaves),
            ("face_up", has_leaves, "leaf_spacing", leaves),
            ("radii", is_round, "blade_width", tube),
            ("exponent", is_round, "blade_width", tube),
        ];
        for (key, _, other, what) in all.into_iter().filter(|(_, met, ..)| !met) {
            let switch = span_of(table, &[other]);
            let idle = span_of(table, &[key]).filter(|at| switch.is_none_or(|switch| switch.source == at.source));
            if let Some(at) = idle {
                let d = Diagnostic::warning("S007", format!("{path}.{key} has no effect"), at, "has no effect");
                self.report.push(d.help(format!("it needs {what}")));
            }
        }
    }

    /// Reports S007 for keys of the motion that the printed equations do not have, where they stand in the same text as the choice of
    /// these equations: a scene may choose them for a file that was written for the others.
    fn check_paper_keys(&mut self, keys: &ShapeKeys, table: &TomlTable, path: &str) {
        let Some(chosen) = span_of(table, &["equations"]) else { return };
        let rates = [
            ("spread", &keys.spread),
            ("coil", &keys.coil),
            ("gravity", &keys.gravity),
            ("up", &keys.up),
            ("light", &keys.light),
            ("attract", &keys.attract),
            ("avoid", &keys.avoid),
            ("climb", &keys.climb),
        ];
        for (key, _) in rates.iter().filter(|(_, values)| values.iter().any(|v| *v != 0.0)) {
            let written = span_of(table, &[*key]).filter(|at| at.source == chosen.source);
            // A guide without an envelope has been reported.
            if let Some(at) =
                written.filter(|at| !self.report.diagnostics.iter().any(|d| d.labels.iter().any(|l| l.0 == *at)))
            {
                let d = Diagnostic::warning("S007", format!("{path}.{key} has no effect"), at, "has no effect");
                self.report.push(d.help("it needs the equations of osier: leave `equations` out"));
            }
        }
    }

    /// Reports S003 for planes without a direction, and S007 for keys of regions that their shape does not read, as `size` of a sphere.
    fn check_region_keys(&mut self, keys: &ShapeKeys, table: &TomlTable, path: &str) {
        for (key, regions) in [("envelope", &keys.envelope), ("obstacles", &keys.obstacles)] {
            let Some(TomlValue::List(nodes)) = table.get(key).map(|e| &e.node.value) else { continue };
            for (i, (node, region)) in nodes.iter().zip(regions).enumerate() {
                let TomlValue::Table(written) = &node.value else { continue };
                // Without a direction the plane would have no side.
                if region.shape == RegionShape::Plane && region.normal.iter().all(|v| v.abs() < 1e-9) {
                    let at = written.get("normal").map_or(node.span, |e| e.node.span);
                    let text = format!("{path}.{key}.{i}.normal has no direction");
                    let d = Diagnostic::error("S003", text, at, "of length 0");
                    self.report.push(d.help("write a vector out of the region: normal = [0, 1, 0]"));
                }
                let read = keys_of_shape(region.shape);
                for name in ["at", "to", "size", "radius", "height", "normal", "name"] {
                    let Some(entry) = written.get(name).filter(|_| !read.contains(&name)) else { continue };
                    let text = format!("{path}.{key}.{i}.{name} has no effect");
                    let d = Diagnostic::warning("S007", text, entry.node.span, "has no effect");
                    let help = format!("shape = \"{}\" reads {}", word_of(region.shape), read.join(", "));
                    self.report.push(d.help(help));
                }
            }
        }
    }

    /// Reports S005 for regions with the name of a solid that the scene does not have.
    fn check_region_solids(&mut self, keys: &ShapeKeys, table: &TomlTable, path: &str) {
        for (key, regions) in [("envelope", &keys.envelope), ("obstacles", &keys.obstacles)] {
            let named = regions.iter().filter(|r| r.shape == RegionShape::Solid);
            for region in named.filter(|r| !self.solid_names.contains(&r.name)) {
                let text = format!("{path}.{key} names the solid \"{}\", which the scene does not have", region.name);
                let span = self.place_of(table, &[key]);
                let d = Diagnostic::error("S005", text, span, "unknown solid");
                self.report.push(match nearest(&region.name, self.solid_names.iter().map(String::as_str)) {
                    Some(near) => d.help(format!("did you mean \"{near}\"?")),
                    None => d.help("give a [[solid]] this name"),
                });
            }
        }
    }
}

/// The keys that say where a region of a shape lies and how large it is.
fn keys_of_shape(shape: RegionShape) -> &'static [&'static str] {
    match shape {
        RegionShape::Sphere => &["at", "radius"],
        RegionShape::Ellipsoid | RegionShape::Box => &["at", "size"],
        RegionShape::Capsule => &["at", "to", "radius"],
        RegionShape::Cone => &["at", "radius", "height"],
        RegionShape::Plane => &["at", "normal"],
        RegionShape::Solid => &["name"],
    }
}

/// The key `name` of every `[[solid]]`, read before the solids are resolved; reports nothing.
pub(in crate::recipe) fn solid_names(root: &TomlTable) -> Vec<String> {
    let tables = root.tables("solid").into_iter();
    // Errors of solids are reported when these are resolved.
    tables.map(|t| SolidKeys::read(Some(t), "solid", &mut Report::default()).name).collect()
}
