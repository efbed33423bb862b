//! `[wind]`, `[[wind.add]]`, `[sway]` and the files of the wind: resolution of keys that depend on each other.

use super::{
    LatticeGround, LatticeKeys, LatticePreset, LatticeProfile, LatticeSides, SliceAxis, SwayKeys, VdbKeys,
    WindOutputKeys, WindSliceKeys,
};
use crate::recipe::resolve::{Resolver, span_of};
use crate::recipe::syntax::{
    BooleanType, OneOf, OptionalKey, TomlNode, TomlTable, TomlValue, degrees, number, word_of, wrong,
};
use crate::recipe::syntax::{choices, keys};
use crate::recipe::{VdbRecipe, WindOutputRecipe};
use glam::DVec3;
use osier_base::diagnostic::Diagnostic;
use osier_base::files::Names;
use osier_scene::{AirGrid, Clip};
use osier_wind::{CALM_SPEED, beaufort_speed, fit_gust_length};

choices! {
    /// Formula or simulation from which the velocities of a wind come.
    WindModel {
        /// No wind: velocities are zero.
        Calm = "calm",
        /// Constant in space and time.
        Uniform = "uniform",
        /// Gusts that travel downwind, with eddies.
        Gust = "gust",
        /// A sine with noise, as in the paper by Zhao and Zhang.
        Perlin = "perlin",
        /// Flow around solids on a lattice, with the keys of `[wind.lattice]`.
        Lattice = "lattice",
    }
}

keys! {
    /// Wind. Speeds are those 10 m above the ground. Each `[[wind.add]]` table adds another wind with the same keys;
    /// velocities are summed.
    WindKeys at "wind" also "wind.add" {
        /// Model of the velocity field.
        model: WindModel = "model" OneOf(WindModel::Gust), basic;
        /// Mean speed 10 m above the ground.
        speed: f64 = "speed" number(4.5, 0.0, 60.0, "m/s"), basic;
        /// Mean speed as a Beaufort number, instead of `speed`.
        beaufort: Option<f64> = "beaufort" OptionalKey(number(3.0, 0.0, 12.0, "Bft"), "none");
        /// Factor on all velocities, but not on the speed at which gusts travel.
        scale: f64 = "scale" number(1.0, 0.0, 10.0, "");
        /// Direction in which the wind blows: 0 is +X, 90 is -Z.
        direction: f64 = "direction_deg" degrees(0.0, -360.0, 360.0), basic;
        /// Relative amplitude of gusts; 0.3 to 0.5 is natural.
        gust: f64 = "gust" number(0.4, 0.0, 1.0, ""), basic;
        /// Length of gusts along the wind.
        gust_length: f64 = "gust_length" number(40.0, 2.0, 200.0, "m"), basic;
        /// Turbulence intensity of eddies; 0.15 to 0.25 is natural.
        turbulence: f64 = "turbulence" number(0.2, 0.0, 1.0, ""), basic;
        /// Diameter of the largest eddies.
        eddy_size: f64 = "eddy_size" number(4.0, 0.5, 20.0, "m");
        /// Relative amplitude of random variation for each branch.
        flicker: f64 = "flicker" number(0.15, 0.0, 1.0, "");
        /// Amplitude of the variation of direction.
        wander: f64 = "wander_deg" degrees(15.0, 0.0, 90.0);
        /// Exponent of the power-law profile; 0 for a uniform profile.
        power: f64 = "height_power" number(0.2, 0.0, 1.0, "");
        /// With "perlin": the equation as printed, uniform in space, zero once per period.
        literal: bool = "literal" BooleanType(false);
    }
}

/// Shortest duration, s, of a clip that can repeat as a whole.
pub const SHORTEST_LOOP: f64 = 2.0;

impl Resolver<'_> {
    /// Reads `[wind]` and every `[[wind.add]]`, with Beaufort numbers converted to speeds.
    pub(in crate::recipe) fn wind(&mut self, root: &TomlTable) -> (WindKeys, Vec<WindKeys>) {
        let keys = self.section(root, "wind");
        let table = root.table("wind");
        let keys = self.resolve_speed(keys, "wind", table);
        let Some(entry) = table.and_then(|t| t.get("add")) else { return (keys, Vec::new()) };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong("wind.add", &entry.node, "a list: write [[wind.add]]"));
            return (keys, Vec::new());
        };
        (keys, list.iter().enumerate().filter_map(|(i, node)| self.added_wind(i, node)).collect())
    }

    fn added_wind(&mut self, i: usize, node: &TomlNode) -> Option<WindKeys> {
        let path = format!("wind.add.{i}");
        let TomlValue::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        if let Some(entry) = table.get("add") {
            let text = format!("[{path}] has no key \"add\"");
            let d = Diagnostic::error("S002", text, entry.key_span, "an added wind cannot contain another");
            self.report.push(d.help("write one more [[wind.add]]"));
        }
        let keys = self.read_keys::<WindKeys>(table, &path);
        // Added winds are formulas; a lattice would have to be stepped through the clip.
        let own = table.get("lattice").map(|e| e.key_span);
        let model = table.get("model").filter(|_| keys.model == WindModel::Lattice).map(|e| e.node.span);
        if let Some(at) = own.or(model) {
            let d = Diagnostic::error("S004", format!("{path} uses a lattice"), at, "only [wind] can be");
            self.report.push(d.help("write it as the scene's [wind], and add the others to it"));
        }
        Some(self.resolve_speed(keys, &path, Some(table)))
    }

    /// Converts a Beaufort number to the speed; a given speed takes precedence, with a warning.
    fn resolve_speed(&mut self, mut keys: WindKeys, path: &str, table: Option<&TomlTable>) -> WindKeys {
        let span = |key: &str| table.and_then(|t| span_of(t, &[key]));
        // Only a written number counts, since the key has no default.
        if let Some((number, at)) = keys.beaufort.zip(span("beaufort")) {
            if span("speed").is_some() {
                let text = format!("{path}.beaufort is {number}, but {path}.speed is given, too");
                let d = Diagnostic::warning("S007", text, at, "has no effect");
                let speed = beaufort_speed(number);
                self.report
                    .push(d.help(format!("leave one of them out, or write {path}.speed = {speed:.1} for this wind")));
            } else {
                keys.speed = beaufort_speed(number);
            }
        }
        if keys.literal && keys.model != WindModel::Perlin {
            let at = span("literal").unwrap_or(self.whole);
            let d = Diagnostic::warning(
                "S007",
                format!("`{path}.literal` needs `model = \"perlin\"`"),
                at,
                "has no effect",
            );
            self.report.push(d.help("write model = \"perlin\""));
        }
        keys
    }

    /// Reads `[wind.lattice]`. Its curves and presets also set speed and direction of `wind`.
    pub(in crate::recipe) fn lattice(&mut self, root: &TomlTable, wind: &mut WindKeys) -> LatticeKeys {
        let empty = TomlTable::default();
        let parent = root.table("wind").unwrap_or(&empty);
        let mut keys: LatticeKeys = self.section_at(parent, "wind", "lattice");
        let table = parent.table("lattice").unwrap_or(&empty);
        // Without a lattice wind the table has no effect, but its keys are checked.
        if wind.model != WindModel::Lattice {
            if let Some(entry) = parent.get("lattice") {
                let text = "`[wind.lattice]` needs `model = \"lattice\"` in `[wind]`";
                let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
                self.report.push(d.help("write model = \"lattice\" in [wind]"));
            }
            return keys;
        }
        // Gusts and turbulence of a lattice are set at its inlet, not by the keys of the gust model.
        for key in ["gust", "gust_length", "turbulence", "eddy_size", "wander_deg", "height_power"] {
            if let Some(entry) = parent.get(key) {
                let text = format!("`wind.{key}` has no effect with `model = \"lattice\"`");
                let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
                self.report.push(d.help("set the gusts and turbulence of a lattice wind in [wind.lattice]"));
            }
        }
        let span = |key: &str| table.get(key).map(|e| e.node.span);
        if keys.cells.iter().any(|n| n.fract().abs() > 0.0) {
            let at = span("cells").unwrap_or(self.whole);
            self.report.push(Diagnostic::error(
                "S004",
                "wind.lattice.cells must be whole numbers",
                at,
                "whole numbers",
            ));
        }
        // A table that could not be read has been reported.
        let has_table = !keys.profile_table.is_empty() || table.holds("profile_table");
        if keys.profile == LatticeProfile::Table && !has_table {
            let at = span("profile").unwrap_or(self.whole);
            let d = Diagnostic::error("S006", "profile = \"table\" has no table", at, "heights and factors");
            self.report.push(d.help("add profile_table = [[0, 0], [10, 1]]"));
        }
        // Curves replace constant speed and direction; then the paper's preset sets the keys that the scene does not.
        self.apply_speed_curve(parent, table, &keys, wind);
        self.apply_direction_curve(parent, table, &keys, wind);
        apply_paper_defaults(&mut keys, table);
        if keys.preset == LatticePreset::Paper
            && parent.get("speed").is_none()
            && wind.beaufort.is_none()
            && keys.speed_curve.is_empty()
        {
            wind.speed = PAPER_SPEED;
        }
        keys
    }

    /// Sets the speed of the wind to the largest speed of `speed_curve`.
    fn apply_speed_curve(&mut self, parent: &TomlTable, table: &TomlTable, keys: &LatticeKeys, wind: &mut WindKeys) {
        let Some(entry) = table.get("speed_curve").filter(|_| !keys.speed_curve.is_empty()) else { return };
        // The largest speed of the curve becomes the speed of the lattice; relative to it, the curve is a factor of at most 1.
        let most = keys.speed_curve.iter().map(|row| row[1]).fold(0.0, f64::max);
        if !(FASTEST[0]..=FASTEST[1]).contains(&most) {
            let text = format!("the largest speed of wind.lattice.speed_curve is {most} m/s");
            let at = entry.node.span;
            let d = Diagnostic::error("S004", text, at, format!("must be {} to {}", FASTEST[0], FASTEST[1]));
            self.report.push(d.help("pairs are a time in seconds and a speed in m/s: [[0, 2], [5, 9]]"));
        }
        for key in ["speed", "beaufort"] {
            if let Some(entry) = parent.get(key) {
                let text = format!("wind.{key} is given, but wind.lattice.speed_curve, too");
                let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
                self.report.push(d.help("leave one of them out"));
            }
        }
        wind.speed = most;
    }

    /// Sets the direction of the wind to the first one of `direction_curve`.
    fn apply_direction_curve(
        &mut self,
        parent: &TomlTable,
        table: &TomlTable,
        keys: &LatticeKeys,
        wind: &mut WindKeys,
    ) {
        let Some(entry) = table.get("direction_curve") else { return };
        let Some([early, first]) = keys.direction_curve.first().copied() else { return };
        if early < 0.0 {
            let text = format!("wind.lattice.direction_curve begins at {early} s, before the clip");
            let d = Diagnostic::error("S004", text, entry.node.span, "must be 0 or more");
            self.report.push(d.help("during spin-up the wind blows in the direction of the first pair"));
        }
        if keys.sides == LatticeSides::Slip {
            let text = "wind.lattice.sides = \"slip\" blocks the sides, but the wind turns through them";
            let at = table.get("sides").map_or(self.whole, |e| e.node.span);
            let d = Diagnostic::error("S004", text, at, "not with a direction_curve");
            self.report.push(d.help("leave sides out: all four sides are open when the wind turns"));
        }
        if let Some(entry) = parent.get("direction_deg") {
            let text = "wind.direction_deg is given, but wind.lattice.direction_curve, too";
            let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
            self.report.push(d.help("leave one of them out"));
        }
        wind.direction = first.to_radians();
    }

    /// Disables the loop of a wind with a curve; S004 if keys request one. `curve`: name of the curve's key.
    pub(in crate::recipe) fn disable_loop(
        &mut self,
        root: &TomlTable,
        mut sway: SwayKeys,
        curve: Option<&str>,
    ) -> SwayKeys {
        let Some(curve) = curve else { return sway };
        for (key, asked) in [("repeat", sway.repeat == Some(true)), ("loop", sway.loop_duration.is_some())] {
            if asked {
                let at = self.place_of(root, &["sway", key]);
                let text = format!("sway.{key} requests a loop, but a wind with wind.lattice.{curve} does not repeat");
                let d = Diagnostic::error("S004", text, at, "not with a curve");
                self.report.push(d.help("leave one of them out"));
            }
        }
        sway.repeat = Some(false);
        sway.loop_duration = None;
        sway
    }

    /// Resolves `[output.wind]` into grids of sample points. `flight_size`: size of the domain of a flight, m.
    pub(in crate::recipe) fn wind_output(
        &mut self,
        root: &TomlTable,
        wind: &WindKeys,
        lattice: &LatticeKeys,
        flight_size: Option<[f64; 3]>,
        clip: Clip,
    ) -> WindOutputRecipe {
        let empty = TomlTable::default();
        let parent = root.table("output").unwrap_or(&empty);
        let keys: WindOutputKeys = self.section_at(parent, "output", "wind");
        let Some(table) = parent.table("wind") else {
            return WindOutputRecipe { keys, slices: Vec::new(), grids: Vec::new() };
        };
        // The domain is that of the lattice, else of the flight, else `size` around the origin.
        let on_lattice = wind.model == WindModel::Lattice;
        if let Some(entry) = table.get("size").filter(|_| on_lattice || flight_size.is_some()) {
            let owner = if on_lattice { "the lattice" } else { "[flight]" };
            let text = format!("output.wind.size is given, but {owner} has a size");
            self.report.push(Diagnostic::warning("S007", text, entry.key_span, "has no effect").help("leave it out"));
        }
        let mut domain = SampledDomain::new(on_lattice.then_some(lattice), flight_size, keys.size, keys.texel);
        domain.on_land = !on_lattice && flight_size.is_some() && root.get("terrain").is_some();
        // Each plane becomes a grid one cell thick, named by its axis and position; the volume comes last.
        let mut names = Names::default();
        let mut grids = Vec::new();
        let mut slices = Vec::new();
        for (i, node) in self.wind_slices(table).iter().enumerate() {
            if let Some(slice) = self.wind_slice(i, node, &domain) {
                grids.push(domain.plane_grid(&slice, &mut names));
                slices.push(slice);
            }
        }
        grids.extend(keys.vti_every.map(|every| domain.volume_grid(every, &mut names)));
        if clip.len() < 2 && !grids.is_empty() {
            let at = parent.get("wind").map_or(self.whole, |e| e.key_span);
            let d = Diagnostic::warning(
                "S007",
                "`[output.wind]` needs a clip, but the scene has one frame",
                at,
                "has no effect",
            );
            self.report.push(d.help("make it a clip: [frames] end = 48"));
        }
        WindOutputRecipe { keys, slices, grids }
    }

    /// Resolves `[output.vdb]`; its domain is chosen as that of `[output.wind]`, whose `size`, m, is given.
    pub(in crate::recipe) fn vdb_output(
        &mut self,
        root: &TomlTable,
        wind: &WindKeys,
        lattice: &LatticeKeys,
        flight_size: Option<[f64; 3]>,
        size: [f64; 3],
        clip: Clip,
    ) -> VdbRecipe {
        let empty = TomlTable::default();
        let parent = root.table("output").unwrap_or(&empty);
        let keys: VdbKeys = self.section_at(parent, "output", "vdb");
        let on_lattice = wind.model == WindModel::Lattice;
        let domain = SampledDomain::new(on_lattice.then_some(lattice), flight_size, size, keys.cell);
        let domain = (clip.len() > 1).then(|| domain.volume_grid(keys.every, &mut Names::default()));
        VdbRecipe { keys, domain }
    }

    fn wind_slices<'t>(&mut self, table: &'t TomlTable) -> &'t [TomlNode] {
        match table.get("slice").map(|e| &e.node) {
            Some(TomlNode { value: TomlValue::List(list), .. }) => list,
            Some(other) => {
                self.report.push(*wrong("output.wind.slice", other, "a list: write [[output.wind.slice]]"));
                &[]
            }
            None => &[],
        }
    }

    fn wind_slice(&mut self, i: usize, node: &TomlNode, domain: &SampledDomain) -> Option<WindSliceKeys> {
        let path = format!("output.wind.slice.{i}");
        let TomlValue::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        let keys = self.read_keys::<WindSliceKeys>(table, &path);
        // The plane must lie inside the sampled domain along its normal, where that is known.
        let axis = keys.across as usize;
        if keys.across == SliceAxis::Y && domain.on_land {
            return Some(keys);
        }
        let (low, high) = (domain.low[axis], domain.low[axis] + domain.size[axis]);
        if !(low..=high).contains(&keys.at) {
            let at = table.get("at").map_or(node.span, |e| e.node.span);
            let text = format!("{path}.at is {} m, outside the wind domain", keys.at);
            let d = Diagnostic::error("S004", text, at, format!("must be {low} to {high}"));
            self.report.push(d.help("move the plane, or enlarge the domain"));
            return None;
        }
        Some(keys)
    }

    /// Reads `[sway]`. `flies`: whether the scene has a flight, which never repeats, so that the wind loops only on request.
    pub(in crate::recipe) fn sway(&mut self, root: &TomlTable, clip: Clip, flies: bool) -> SwayKeys {
        let mut keys: SwayKeys = self.section(root, "sway");
        if flies && keys.loop_duration.is_none() {
            keys.repeat.get_or_insert(false);
        }
        let span = |key: &str| span_of(root, &["sway", key]);
        if keys.repeat == Some(true) && keys.loop_duration.is_none() && seconds(&clip) < SHORTEST_LOOP {
            let text = format!("a clip of {:.2} s is too short to repeat", seconds(&clip));
            let d = Diagnostic::error("S004", text, span("repeat").unwrap_or(self.whole), "not possible");
            self.report.push(d.help(format!("at least {SHORTEST_LOOP} s: raise frames.end")));
        }
        // A loop has a whole number of frames: the change of the requested duration is reported.
        let Some((wanted, at)) = keys.loop_duration.zip(span("loop")) else { return keys };
        if keys.repeat == Some(false) {
            let d = Diagnostic::warning("S007", "sway.loop is given, but sway.repeat is false", at, "has no effect");
            self.report.push(d.help("leave one of them out"));
        } else if let Some(frames) = keys.loop_frames(&clip) {
            // A loop of one frame would not move.
            if frames < 2 {
                let text = format!("sway.loop is {wanted} s, less than two frames at {} frames per second", clip.fps());
                let d = Diagnostic::error("S004", text, at, "too short");
                self.report.push(d.help(format!("at least {} s", 2.0 / clip.fps())));
                return keys;
            }
            let found = frames as f64 / clip.fps();
            if (found - wanted).abs() > 1e-6 {
                let text = format!("sway.loop is {wanted} s, which is {:.2} frames", wanted * clip.fps());
                let d = Diagnostic::warning("S008", text, at, format!("taken as {frames} frames"));
                self.report.push(d.help(format!("write loop = {}", (found * 1e4).round() / 1e4)));
            }
        }
        keys
    }

    /// Warns with S008 if gust length or eddy size of a wind change so that a loop contains a whole number of gusts. `winds`:
    /// `[wind]`, then every `[[wind.add]]`.
    pub(in crate::recipe) fn report_fitted_lengths(
        &mut self,
        root: &TomlTable,
        winds: &[&WindKeys],
        sway: &SwayKeys,
        clip: &Clip,
    ) {
        let Some(frames) = sway.loop_frames(clip) else { return };
        let Some(first) = root.table("wind") else { return };
        let added: &[TomlNode] = match first.get("add").map(|e| &e.node.value) {
            Some(TomlValue::List(list)) => list,
            _ => &[],
        };
        let added = (0..).zip(added).filter_map(|(i, node)| match &node.value {
            TomlValue::Table(table) => Some((format!("wind.add.{i}"), table)),
            _ => None,
        });
        // In a loop of period T the gusts travel a whole number of gust lengths: lambda = U T / n for an integer n.
        let period = frames as f64 / clip.fps();
        for ((path, table), wind) in [("wind".to_owned(), first)].into_iter().chain(added).zip(winds) {
            for (key, length) in [("gust_length", wind.gust_length), ("eddy_size", wind.eddy_size)] {
                let Some(at) = span_of(table, &[key]).filter(|_| wind.model == WindModel::Gust) else { continue };
                let fitted = fit_gust_length(length, wind.speed, period);
                if (fitted / length - 1.0).abs() > 0.02 {
                    let text =
                        format!("{path}.{key} is {length} m, but a loop of {period} s needs a whole number of gusts");
                    let d = Diagnostic::warning("S008", text, at, format!("taken as {fitted:.2} m"));
                    self.report.push(d.help("a longer clip, or sway.repeat = false, keeps it"));
                }
            }
        }
    }
}

/// Range of the largest speed of a curve, m/s.
const FASTEST: [f64; 2] = [CALM_SPEED, 60.0];

/// Domain of the files of the wind: lowest corner, size, and side of a cell, m.
struct SampledDomain {
    low: DVec3,
    size: DVec3,
    side: f64,
    /// Whether the box stands on a terrain, whose height is known only when the scene is assembled.
    on_land: bool,
}

impl SampledDomain {
    /// The box of a lattice, else of a flight, else of `size` about the origin. `side`: side of a cell; by default that of the
    /// lattice, else 0.5 m.
    fn new(lattice: Option<&LatticeKeys>, flight_size: Option<[f64; 3]>, size: [f64; 3], side: Option<f64>) -> Self {
        let size = lattice.map_or(flight_size.unwrap_or(size), LatticeKeys::size);
        let side = side.unwrap_or(lattice.map_or(0.5, |lattice| lattice.cell_size));
        let at = lattice.map_or(DVec3::ZERO, |lattice| DVec3::from_array(lattice.at));
        Self { low: at - DVec3::new(size[0], 0.0, size[2]) / 2.0, size: DVec3::from_array(size), side, on_land: false }
    }

    /// Number of cells along each axis; the last one may extend beyond the domain.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 10^8")]
    fn cells(&self) -> [usize; 3] {
        self.size.to_array().map(|length| ((length / self.side - 1e-9).ceil()).max(1.0) as usize)
    }

    fn plane_grid(&self, keys: &WindSliceKeys, names: &mut Names) -> AirGrid {
        let axis = keys.across as usize;
        let (mut cells, mut corner) = (self.cells(), self.low);
        cells[axis] = 1;
        corner[axis] = keys.at;
        let value = keys.at.to_string().replace('-', "m");
        let name = names.unique(&format!("{}{value}", word_of(keys.across)));
        AirGrid { name, cells, corner, side: self.side, across: Some(axis), every: keys.every }
    }

    fn volume_grid(&self, every: u32, names: &mut Names) -> AirGrid {
        let name = names.unique("box");
        AirGrid { name, cells: self.cells(), corner: self.low, side: self.side, across: None, every }
    }
}

/// Speed of \[catkin\] Table 2, m/s. It also states Beaufort 3, which is 3.4 to 5.4 m/s.
const PAPER_SPEED: f64 = 2.0;

/// Applies the values of \[catkin\] Table 2 and its figures to the keys that the scene does not give.
fn apply_paper_defaults(keys: &mut LatticeKeys, table: &TomlTable) {
    if keys.preset != LatticePreset::Paper {
        return;
    }
    let free = |name: &str| table.get(name).is_none();
    if free("gust") {
        keys.gust = 0.0;
    }
    if free("sponge") {
        keys.sponge = Some(0);
    }
    if free("ground") {
        keys.ground = LatticeGround::Smooth;
    }
    if free("reference_height") {
        keys.reference_height = Some(keys.cells[1] * keys.cell_size);
    }
}

impl WindKeys {
    /// Whether the scaled speed reaches [`CALM_SPEED`] and the model is not `calm`.
    pub fn blows(&self) -> bool {
        self.model != WindModel::Calm && self.speed * self.scale >= CALM_SPEED
    }
}

impl LatticeKeys {
    /// Width, height and depth of the domain, m.
    pub fn size(&self) -> [f64; 3] {
        self.cells.map(|n| n * self.cell_size)
    }

    /// Times, s, and the change of direction since the first, rad.
    pub fn direction_changes(&self) -> Vec<[f64; 2]> {
        let first = self.direction_curve.first().map_or(0.0, |row| row[1]);
        self.direction_curve.iter().map(|row| [row[0], (row[1] - first).to_radians()]).collect()
    }

    /// Name of the first key with a curve, which changes the wind over time; `None` without one.
    pub(in crate::recipe) fn curve(&self) -> Option<&'static str> {
        let all = [("speed_curve", &self.speed_curve), ("direction_curve", &self.direction_curve)];
        all.into_iter().find_map(|(key, rows)| (!rows.is_empty()).then_some(key))
    }
}

impl SwayKeys {
    /// Number of frames after which the motion of a clip repeats: `loop`, else the whole clip; `None` without a loop.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an hour of frames at most")]
    pub fn loop_frames(&self, clip: &Clip) -> Option<usize> {
        if self.repeat == Some(false) || clip.len() < 2 {
            return None;
        }
        let whole = (self.repeat == Some(true) || seconds(clip) >= SHORTEST_LOOP).then_some(clip.len());
        self.loop_duration.map(|t| (t * clip.fps()).round() as usize).or(whole)
    }
}

/// Duration of a clip as a loop, s: the frame after the last one equals the first.
pub fn seconds(clip: &Clip) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "at most a million frames")]
    let frames = clip.len() as f64;
    frames / clip.fps()
}
