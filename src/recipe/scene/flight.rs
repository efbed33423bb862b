//! `[flight]`: catkins in flight.

use super::{SolidKeys, SolidShape};
use crate::recipe::resolve::{Resolver, span_of};
use crate::recipe::syntax::word_of;
use crate::recipe::syntax::{
    BooleanType, FileReference, NamedNumbers, NumberArray, OneOf, OptionalKey, Reference, StringType, TomlNode,
    TomlTable, TomlValue, integer, milligrams, number, wrong,
};
use crate::recipe::syntax::{choices, keys};
use crate::recipe::{FlightRecipe, PlantRecipe, SolidRecipe};
use osier_base::diagnostic::{Diagnostic, Span};
use osier_base::files::Names;
use osier_scene::MaterialClass;
use std::sync::Arc;

choices! {
    /// Positions and times at which catkins are released.
    FlightRelease {
        /// Uniformly over the box, at heights within `band`, all at the start.
        Sky = "sky",
        /// Uniformly over the box, at heights within `band`, one after another during `duration`.
        Rain = "rain",
        /// From the ends of plants' twigs, torn off by gusts.
        Canopy = "canopy",
        /// At positions read from a file.
        Points = "points",
    }
    /// Effect of a side of the flight's box on a catkin that crosses it.
    FlightBoundary {
        /// The catkin leaves the simulation.
        Exit = "exit",
        /// The catkin is released again on the side where the wind enters.
        Recycle = "recycle",
        /// The catkin enters again at the opposite side.
        Periodic = "periodic",
    }
    /// Source of the default values of a flight.
    FlightPreset {
        /// With masses, inertia, glide and rotating clusters.
        Full = "full",
        /// As in the paper by Wang and others: carried by the wind and falling.
        Paper = "paper",
    }
    /// Which catkins a map of deposits counts.
    DepositEvent {
        /// Catkins at rest in the frame of the map.
        Resting = "resting",
        /// All depositions up to the frame, also of catkins that were lifted off again.
        Landings = "landings",
    }
    /// Quantity of a map of deposits.
    DepositQuantity {
        /// Number of catkins per area.
        Count = "count",
        /// Mass of catkins per area, mg.
        Mass = "mass",
    }
}

keys! {
    /// Catkins in flight: release, motion, adhesion and deposition. `[catkin]` sets their shape, `[wind]` the wind.
    FlightKeys at "flight" {
        /// Number of catkins that are released.
        count: u32 = "count" integer(1000, 1, 100_000_000), basic;
        /// Source of the defaults: all additions ("full"), or the equations of the paper only.
        preset: FlightPreset = "preset" OneOf(FlightPreset::Full);
        /// Where catkins are released: in a layer of the sky at once ("sky") or over time ("rain"), from plants ("canopy"),
        /// at positions of a file ("points").
        release: FlightRelease = "release" OneOf(FlightRelease::Sky), basic;
        /// With "rain": period of release, counted from the start of the spin-up.
        duration: f64 = "duration" number(10.0, 0.0, 86_400.0, "s"), basic;
        /// With "sky" and "rain": layer of release, as fractions of the height of the domain.
        band: [f64; 2] = "band" NumberArray([0.3, 0.95], number(0.0, 0.0, 1.0, ""));
        /// With "canopy": period over which the catkins ripen, counted from the start of the spin-up, at a constant rate of
        /// count / ripening_s; ripe ones leave in wind above `release_speed`. 0: all are ripe at the start.
        ripening: f64 = "ripening_s" number(0.0, 0.0, 86_400.0, "s");
        /// With "canopy": plants with weights: { poplar = 1 }.
        canopy: Vec<(String, f64)> = "canopy" NamedNumbers;
        /// With "points": text file with x, y, z in metres on each line, or the vertices of a PLY file.
        points: Option<Reference> = "points" FileReference(".csv, .txt, .ply");
        /// Duration of flight before the first frame (spin-up).
        spin_up: f64 = "spin_up_s" number(0.0, 0.0, 3600.0, "s");
        /// Domain around the origin: width, height, depth. A lattice wind has its own domain.
        size: [f64; 3] = "size" NumberArray([35.0, 35.0, 35.0], number(35.0, 0.5, 1e4, "m"));
        /// What happens at the sides: catkins leave ("exit"), re-enter at the inflow ("recycle"), or at the opposite side
        /// ("periodic").
        sides: Option<FlightBoundary> = "sides" OptionalKey(OneOf(FlightBoundary::Recycle), "periodic where the lattice wind is; else recycle with release \"sky\", exit with others");
        /// What happens at the two sides across x, instead of `sides`.
        sides_x: Option<FlightBoundary> = "sides_x" OptionalKey(OneOf(FlightBoundary::Exit), "as sides");
        /// What happens at the two sides across z, instead of `sides`.
        sides_z: Option<FlightBoundary> = "sides_z" OptionalKey(OneOf(FlightBoundary::Periodic), "as sides");
        /// Smallest and largest scale of a catkin.
        scale: [f64; 2] = "scale" NumberArray([0.8, 1.2], number(1.0, 0.05, 20.0, ""));
        /// Weights of the variants v0 (sleek) to v4 (fluffy, bent).
        forms: Vec<(String, f64)> = "forms" NamedNumbers;
        /// Mass of a catkin with its seed at scale 1; it grows with the square of `scale`.
        mass: f64 = "mass_mg" milligrams(1.0, 0.001, 1000.0);
        /// Settling speed in still air, the mean over catkins.
        fall: f64 = "fall_speed" number(0.24, 0.02, 3.0, "m/s");
        /// Standard deviation of the settling speed divided by its mean.
        fall_spread: f64 = "fall_spread" number(0.125, 0.0, 0.4, "");
        /// Amount of gliding of tilted tufts.
        glide: f64 = "glide" number(0.5, 0.0, 1.0, "");
        /// Whether the velocity relaxes to that of the wind with a time constant, instead of at once.
        inertia: bool = "inertia" BooleanType(true);
        /// Factor on tumbling.
        flutter: f64 = "flutter" number(1.0, 0.0, 3.0, "");
        /// Reach of hairs and charge; catkins that come closer adhere. 0 uses their radius.
        stick_radius: f64 = "stick_radius" number(0.05, 0.0, 1.0, "m");
        /// Probability that an encounter ends in adhesion; two that stay within reach have another one each second.
        stick_probability: f64 = "stick_probability" number(1.0, 0.0, 1.0, "");
        /// Distance of adhering catkins, as a fraction of the sum of their radii.
        stick_close: f64 = "stick_close" number(0.8, 0.2, 1.0, "");
        /// Whether clusters rotate in the air.
        cluster_rotation: bool = "cluster_rotation" BooleanType(true);
        /// Exponent b: clusters of n catkins settle n^b times as fast.
        beta: f64 = "cluster_fall_power" number(0.0, 0.0, 0.5, "");
        /// Decay of the attraction of heaps with the squared distance; 4.605 reduces it to 1 % at 1 m.
        gamma: f64 = "gamma" number(4.605, 0.1, 1e4, "1/m^2");
        /// Time steps per frame.
        substeps: u32 = "substeps" integer(1, 1, 16);
        /// Humidity of the ground: at 0 deposits lift off easily, at 1 never.
        humidity: f64 = "humidity" number(0.3, 0.0, 1.0, "");
        /// Image of the humidity over the domain, top at -z, white is wet; instead of `humidity`.
        humidity_map: Option<Reference> = "humidity_map" FileReference(".png, .jpg");
        /// Wind speed at 0.1 m above the ground from which on a dry catkin lifts off.
        lift_speed: f64 = "lift_speed" number(0.25, 0.01, 20.0, "m/s");
        /// Factor k of humidity h in the lift-off threshold: 1 + k h / (1 - h).
        lift_wet: f64 = "lift_wet" number(3.0, 0.0, 100.0, "");
        /// Probability per second of lift-off in wind of twice the threshold; it grows in proportion to the excess.
        lift_rate: f64 = "lift_rate" number(1.0, 0.0, 100.0, "1/s");
        /// With "canopy": probability per second of release in wind of twice `release_speed`.
        release_rate: f64 = "release_rate" number(0.2, 0.0, 100.0, "1/s");
        /// With "canopy": wind speed below which no catkin is released.
        release_speed: f64 = "release_speed" number(0.6, 0.01, 60.0, "m/s");
        /// Duration of the trajectory drawn behind each catkin; 0 for none.
        trails: f64 = "trails" number(0.0, 0.0, 600.0, "s");
        /// Width of the trajectory at the catkin; it tapers to zero.
        trail_width: f64 = "trail_width" number(0.01, 1e-4, 1.0, "m");
        /// Whether catkins at rest are lowered until their lowest hair touches the surface.
        settle: bool = "settle" BooleanType(true);
        /// Texel size of deposition maps.
        map_texel: f64 = "map_texel" number(0.25, 0.01, 10.0, "m");
        /// Frames between two deposition maps.
        map_every: Option<u32> = "map_every" OptionalKey(integer(24, 1, 1_000_000), "the last frame only");
        /// Which catkins deposition maps count: those at rest at the frame, or every deposition since the start of the spin-up.
        map_counts: DepositEvent = "map_counts" OneOf(DepositEvent::Resting);
        /// Quantity of deposition maps: number or mass per area.
        map_of: DepositQuantity = "map_of" OneOf(DepositQuantity::Count);
        /// Radius of the filter of deposition maps, which conserves the sum.
        map_blur: f64 = "map_blur" number(0.0, 0.0, 10.0, "m");
    }
    /// A rectangle on the ground. The table of the flight counts the depositions in it, in a column `ground_<name>`.
    FlightZoneKeys at "flight.zone" as list {
        /// Name of its column.
        name: String = "name" StringType("zone");
        /// Its extent along x.
        x: [f64; 2] = "x" NumberArray([0.0, 1.0], number(0.0, -1e6, 1e6, "m"));
        /// Its extent along z.
        z: [f64; 2] = "z" NumberArray([0.0, 1.0], number(0.0, -1e6, 1e6, "m"));
    }
}

/// Bytes of memory per catkin in flight, measured.
const CATKIN: u64 = 1000;

/// Names of the forms of catkins, as keys of `forms` and in their order.
pub const FORMS: [&str; 5] = ["v0", "v1", "v2", "v3", "v4"];

impl Resolver<'_> {
    /// Reads `[flight]` and its zones; `None` without the table.
    pub(in crate::recipe) fn flight(&mut self, root: &TomlTable, plants: &[PlantRecipe]) -> Option<FlightRecipe> {
        let entry = root.get("flight")?;
        let table = self.table(root, "", "flight")?;
        let mut keys = self.read_keys::<FlightKeys>(table, "flight");
        apply_paper_defaults(&mut keys, table);
        self.check_limit("catkins", u64::from(keys.count), span_of(root, &["flight", "count"]));
        self.check_memory("flight.count", u64::from(keys.count), CATKIN, span_of(root, &["flight", "count"]));
        for (name, pair) in [("band", keys.band), ("scale", keys.scale)] {
            self.in_order(table, "flight", name, pair);
        }
        let span = |key: &str| table.get(key).map_or(entry.key_span, |e| e.node.span);
        // Errors below do not end the reading, so that all are reported; the report then refuses the scene.
        let canopy = self.canopy(&keys, span("canopy"), root, plants);
        let forms = self.forms(&keys, span("forms"));
        let starts = match (keys.release, &keys.points) {
            (FlightRelease::Points, Some(reference)) => self.starts(reference).unwrap_or_default(),
            (FlightRelease::Points, None) => {
                let d = Diagnostic::error("S006", "[flight] names no points", span("release"), "points of a file");
                self.report.push(d.help("add points = \"FILE.csv\", or choose another release"));
                Vec::new()
            }
            _ => Vec::new(),
        };
        let wet = keys.humidity_map.as_ref().and_then(|reference| {
            let file = self.read(&reference.text, reference.span, "mesh-bytes", &[".png", ".jpg", ".jpeg"])?;
            self.grey(&file)
        });
        Some(FlightRecipe { zones: self.flight_zones(table), keys, canopy, forms, starts, wet })
    }

    /// Reads every `[[flight.zone]]`; repeated names get numbers, since each zone is a column, and so does "wind".
    fn flight_zones(&mut self, table: &TomlTable) -> Vec<FlightZoneKeys> {
        let Some(entry) = table.get("zone") else { return Vec::new() };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong("flight.zone", &entry.node, "a list: write [[flight.zone]]"));
            return Vec::new();
        };
        let (mut zones, mut names) = (Vec::new(), Names::default());
        // The table has a column `ground_wind` already.
        drop(names.unique("wind"));
        for (i, node) in list.iter().enumerate() {
            let path = format!("flight.zone.{i}");
            let TomlValue::Table(t) = &node.value else {
                self.report.push(*wrong(&path, node, "a table"));
                continue;
            };
            let mut keys = self.read_keys::<FlightZoneKeys>(t, &path);
            self.in_order(t, &path, "x", keys.x);
            self.in_order(t, &path, "z", keys.z);
            // Each zone is a column of the table, so that equal names get numbers.
            keys.name = names.unique(&keys.name);
            zones.push(keys);
        }
        zones
    }

    /// Plants that release catkins, as indices into `plants`, with their weights; empty for other releases.
    fn canopy(&mut self, keys: &FlightKeys, span: Span, root: &TomlTable, plants: &[PlantRecipe]) -> Vec<(usize, f64)> {
        if keys.release != FlightRelease::Canopy {
            return Vec::new();
        }
        if root.get("plants").is_none() {
            let d = Diagnostic::error("S006", "release = \"canopy\" needs a plant", span, "no plant in this scene");
            self.report.push(d.help("add [plants.NAME], or choose another release"));
        }
        if keys.canopy.is_empty() {
            // Without names all plants of the scene take part alike.
            return (0..plants.len()).map(|i| (i, 1.0)).collect();
        }
        self.weights("flight.canopy", span, &keys.canopy, root, plants).unwrap_or_default()
    }

    /// Weights of the forms in the order of [`FORMS`]; all 1 without the key.
    fn forms(&mut self, keys: &FlightKeys, span: Span) -> Vec<f64> {
        if keys.forms.is_empty() {
            // Without weights the forms are equally frequent.
            return vec![1.0; FORMS.len()];
        }
        let mut weights = vec![0.0; FORMS.len()];
        for (name, weight) in &keys.forms {
            self.weight("flight.forms", name, *weight, span);
            match FORMS.iter().position(|f| f == name) {
                // Forms that are not named have weight 0.
                Some(i) => weights[i] = *weight,
                None => {
                    let d = Diagnostic::error("S005", format!("there is no form \"{name}\""), span, "unknown form");
                    self.report.push(d.help(format!("forms: {}", FORMS.join(", "))));
                }
            }
        }
        self.check_some_weight("flight.forms", &keys.forms, span);
        weights
    }

    /// Positions in a text file, x, y, z in metres on each line, where empty lines and text after # are skipped, or the vertices of a
    /// PLY file. `None` after an error.
    fn starts(&mut self, reference: &Reference) -> Option<Vec<[f64; 3]>> {
        let is_ply = reference.text.to_ascii_lowercase().ends_with(".ply");
        let limit = if is_ply { "mesh-bytes" } else { "text-bytes" };
        let file = self.read(&reference.text, reference.span, limit, &[".csv", ".txt", ".ply"])?;
        if is_ply {
            return self.ply_starts(reference, &file.bytes);
        }
        // Spreadsheets begin a CSV with the mark of its encoding.
        let text = String::from_utf8_lossy(&file.bytes);
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text).to_owned();
        let source = self.report.sources.add(file.shown.clone(), text.as_str());
        let (mut starts, mut at) = (Vec::new(), 0_usize);
        for line in text.split_inclusive('\n') {
            let own = line.split('#').next().unwrap_or_default();
            let parts = own.split([',', ';', ' ', '\t']).map(str::trim).filter(|p| !p.is_empty());
            let numbers: Vec<Option<f64>> = parts.map(|p| p.parse().ok().filter(|v: &f64| v.is_finite())).collect();
            match numbers[..] {
                [] => {}
                [Some(x), Some(y), Some(z)] => starts.push([x, y, z]),
                // The first line may be a header of names.
                _ if starts.is_empty() && numbers.iter().all(Option::is_none) => {}
                _ => {
                    let end = at + own.trim_end().len();
                    let span = Span::new(source, at, end);
                    let d = Diagnostic::error("S003", "this line is not a position", span, "not three numbers");
                    self.report.push(d.help("write x, y, z in metres"));
                    return None;
                }
            }
            // Spans of diagnostics count whole lines, with comments and line ends.
            at += line.len();
        }
        self.some_starts(reference, starts, "write x, y, z in metres on each of its lines")
    }

    /// Vertices of a PLY file, in metres; `None` after an error.
    fn ply_starts(&mut self, reference: &Reference, bytes: &[u8]) -> Option<Vec<[f64; 3]>> {
        let starts = match osier_import::ply_points(bytes) {
            Ok(starts) => starts,
            Err(fault) => {
                let text = format!("\"{}\" cannot be read as PLY: {fault}", reference.text);
                let d = Diagnostic::error("S003", text, reference.span, "this file");
                self.report.push(d.help("write it again as PLY 1.0 with x, y and z of its vertices, in metres"));
                return None;
            }
        };
        self.some_starts(reference, starts, "write a PLY file with vertices, in metres")
    }

    /// Starts read from a file, checked against the limit on catkins; `None` with a diagnostic if there are none. `help`: what to do then.
    fn some_starts(&mut self, reference: &Reference, starts: Vec<[f64; 3]>, help: &str) -> Option<Vec<[f64; 3]>> {
        if starts.is_empty() {
            let text = format!("\"{}\" holds no position, so that no catkin would fly", reference.text);
            let d = Diagnostic::error("S003", text, reference.span, "this file");
            self.report.push(d.help(help));
            return None;
        }
        self.check_limit("catkins", starts.len() as u64, Some(reference.span));
        Some(starts)
    }

    /// Reads every `[[solid]]` in the order of the scene; leaves out those that cannot be read.
    pub(in crate::recipe) fn solids(&mut self, root: &TomlTable) -> Vec<SolidRecipe> {
        let Some(entry) = root.get("solid") else { return Vec::new() };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong("solid", &entry.node, "a list: write [[solid]]"));
            return Vec::new();
        };
        let mut names = Names::default();
        list.iter().enumerate().filter_map(|(i, node)| self.solid(i, node, &mut names)).collect()
    }

    fn solid(&mut self, i: usize, node: &TomlNode, names: &mut Names) -> Option<SolidRecipe> {
        let path = format!("solid.{i}");
        let TomlValue::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        let keys = self.read_keys::<SolidKeys>(table, &path);
        for (key, shape) in [("roof", SolidShape::House), ("roof_color", SolidShape::House), ("mesh", SolidShape::Mesh)]
        {
            if let Some(entry) = table.get(key).filter(|_| keys.shape != shape) {
                let word = word_of(shape);
                let text = format!("{path}.{key} needs shape = \"{word}\"");
                let d = Diagnostic::warning("S007", text, entry.node.span, "has no effect");
                self.report.push(d.help(format!("write shape = \"{word}\"")));
            }
        }
        let mesh = match (keys.shape, &keys.mesh) {
            (SolidShape::Mesh, Some(reference)) => {
                let file = self.read(&reference.text, reference.span, "mesh-bytes", &[".obj", ".glb", ".gltf"])?;
                let options =
                    super::plant::MeshImport { up: keys.mesh_up, scale: keys.mesh_scale, class: MaterialClass::Ground };
                Some(Arc::new(self.import(&file, options, reference.span)?))
            }
            (SolidShape::Mesh, None) => {
                let d = Diagnostic::error("S006", format!("[{path}] names no mesh"), node.span, "no mesh here");
                self.report.push(d.help("add mesh = \"FILE.obj\""));
                return None;
            }
            _ => None,
        };
        let wanted = if keys.name.is_empty() { word_of(keys.shape) } else { &keys.name };
        Some(SolidRecipe { id: names.unique(wanted), keys, mesh })
    }
}

/// Applies `preset = "paper"` to the keys that the scene does not set.
fn apply_paper_defaults(keys: &mut FlightKeys, table: &TomlTable) {
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
