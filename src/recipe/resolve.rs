//! Resolves the text of a scene, with overrides and referenced files, into a [`Recipe`].

use super::scene::{
    FramesKeys, GltfKeys, GltfProfile, OutputKeys, PhotonKeys, PlantKeys, PovKeys, SceneKeys, SeasonSpan, WindModel,
    solid_names,
};
use super::syntax::{
    Digest, KeyTable, Registry, TomlEntry, TomlTable, TomlValue, apply_override, join, parse, path_element, wrong,
};
use super::{
    Growth, KeyPlaces, Library, OutputRecipe, PlantRecipe, Recipe, ReferencedFile, VdbRecipe, WindOutputRecipe,
};
use osier_base::diagnostic::{Diagnostic, Report, Span, nearest};
use osier_base::files::{Encoding, Names, ReadError, decode, safe_name};
use osier_base::limits::Limits;
use osier_base::{Error, Result};
use osier_scene::Clip;

/// Flags that give overrides, by which messages name them.
const SET: &str = "--set";
const SWEEP: &str = "--sweep";

/// The text of a scene with overrides, folders and limits, as [`resolve`] takes it.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// Scene name: the file's stem.
    pub name: String,
    /// Name of the text in messages, usually its path.
    pub shown: String,
    /// Text of the scene, TOML.
    pub text: String,
    /// Folders in which references are searched.
    pub library: Library,
    /// Overrides, `path=value`.
    pub set: Vec<String>,
    /// Overrides of one run of a sweep, `path=value`, applied after `set`; messages name their flag.
    pub sweep: Vec<String>,
    /// The plant or attractor to which overrides without a known table apply; `None` for a scene file.
    pub bare: Option<SingleSource>,
    /// Whether every system of a bare coefficient table is checked, and not only the one that is drawn.
    pub thorough: bool,
    /// Replaces the scene's seed.
    pub seed: Option<u64>,
    /// Replaces every plant's derivation length.
    pub steps: Option<f64>,
    /// Limits on sizes and counts that the scene is checked against.
    pub limits: Limits,
}

/// The only plant or attractor of a scene made from a bare file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SingleSource {
    /// Name of the only plant, in `[plants.NAME]`.
    Plant(String),
    /// Name of the only plant, a tree of a coefficient table.
    Tree(String),
    /// Name of the only attractor, in `[clouds.NAME]`.
    Cloud(String),
}

impl Request {
    /// A scene with a single plant grown by a grammar file. `name`: the plant; `reference`: the grammar.
    pub fn bare(name: &str, reference: &str) -> Self {
        Self::single_plant(name, "grammar", reference)
    }

    /// A scene with a single plant of particle-shapes. `name`: the plant; `reference`: the file.
    pub fn shapes(name: &str, reference: &str) -> Self {
        Self::single_plant(name, "shapes", reference)
    }

    /// A scene with a single tree that grows year by year. `name`: the plant; `reference`: the file of its species.
    pub fn species(name: &str, reference: &str) -> Self {
        Self::single_plant(name, "species", reference)
    }

    /// A scene with a single plant and no ground. `key`: the key of the plant that names its file.
    fn single_plant(name: &str, key: &str, reference: &str) -> Self {
        Self::single("plants", key, reference, SingleSource::Plant(name.into()))
    }

    /// A scene with a single attractor. `name`: the cloud; `reference`: the coefficient table.
    pub fn cloud(name: &str, reference: &str) -> Self {
        Self::single("clouds", "ifs", reference, SingleSource::Cloud(name.into()))
    }

    /// A scene with a single tree of a coefficient table. `name`: the plant; `reference`: the table.
    pub fn tree(name: &str, reference: &str) -> Self {
        Self::single("plants", "ifs", reference, SingleSource::Tree(name.into()))
    }

    /// A scene with the one table `table.NAME`, whose `key` is the file `reference`, and no ground.
    fn single(table: &str, key: &str, reference: &str, bare: SingleSource) -> Self {
        let (SingleSource::Plant(name) | SingleSource::Tree(name) | SingleSource::Cloud(name)) = &bare;
        // Names become quoted TOML strings: a file name may hold dots, spaces and quotes.
        let [own, file] = [name.as_str(), reference].map(|text| toml::Value::String(text.to_owned()).to_string());
        let text = format!("[{table}.{own}]\n{key} = {file}\n[ground]\nshow = false\n");
        Self { name: name.clone(), shown: reference.into(), text, bare: Some(bare), ..Self::default() }
    }
}

/// Resolves a scene into a recipe with all defaults filled in and all files read. The report holds the warnings.
/// # Errors
/// `Input` with every fault found, each with its place.
pub fn resolve(request: &Request) -> Result<(Recipe, Report)> {
    let mut report = Report::default();
    let source = report.sources.add(request.shown.clone(), request.text.as_str());
    let mut root = parse(&request.text, source, &mut report);
    // Overrides change the tree before any key is read, so that they are checked like the text.
    let registry = Registry::of::<Recipe>();
    let set = request.set.iter().map(|assignment| (SET, assignment));
    for (flag, assignment) in set.chain(request.sweep.iter().map(|assignment| (SWEEP, assignment))) {
        let qualified = qualify_override(assignment, request.bare.as_ref(), &root, &registry);
        apply_override(&mut root, flag, &qualified, &mut report);
    }
    if report.has_errors() {
        return Err(Error::Input(Box::new(report)));
    }
    // Diagnostics about missing keys have no position in the text and point at its start.
    let whole = Span::new(source, 0, 0);
    let mut resolver = Resolver {
        request,
        registry,
        report,
        whole,
        inputs: Vec::new(),
        frames: 1,
        raining: root.get("rain").is_some(),
        drops_fall: drops_fall(&root),
        season: None,
        latitude: None,
        solid_names: solid_names(&root),
    };
    let recipe = resolver.recipe(&root);
    suggest_other_places(&mut resolver.report);
    suggest_define_keys(&recipe, &mut resolver.report);
    suggest_plants(&root, &mut resolver.report);
    resolver.report.into_result(recipe)
}

/// Whether the scene has rain that falls: `[rain]` without `falls = false`. A value that is no flag is reported where the keys of rain are
/// read.
fn drops_fall(root: &TomlTable) -> bool {
    let Some(rain) = root.table("rain") else { return false };
    !matches!(rain.get("falls").map(|entry| &entry.node.value), Some(TomlValue::Flag(false)))
}

/// Places of a key that a help names at most; of more it names the listing that shows them.
const MAX_PLACES: usize = 4;

/// Words in the names that other programs give to pictures of a surface.
const PICTURE_WORDS: [&str; 6] = ["texture", "image", "picture", "map", "albedo", "diffuse"];

/// What to do with a picture that a table of bark or of a leaf was given; `None` for other keys. `table`: its path.
fn picture_help(table: &str, name: &str) -> Option<&'static str> {
    let name = name.to_ascii_lowercase();
    if !PICTURE_WORDS.iter().any(|word| name.contains(word)) {
        return None;
    }
    match table.rsplit('.').next() {
        Some("bark" | "shoot") => Some("a picture of your own is `texture`, its normal map `normal_texture`"),
        Some("leaf") => Some("osier paints blades; pictures of your own come with the mesh of a leaf (`mesh`)"),
        _ if table.contains(".organs.") => {
            Some("osier paints blades; pictures of your own come with the mesh of an organ (`mesh`)")
        }
        _ => None,
    }
}

/// If an unknown key without a similar one beside it is a key or a table at other places, names these in the help.
fn suggest_other_places(report: &mut Report) {
    if report.diagnostics.iter().all(|d| d.code != "S002") {
        return;
    }
    let tables = super::options();
    for d in report.diagnostics.iter_mut().filter(|d| d.code == "S002") {
        // Only the message and the help, as `syntax::key::unknown` writes them, show that this is an unknown key.
        let Some(known) = d.help.as_ref().filter(|help| help.starts_with("known here: ")) else { continue };
        let Some((_, name)) = d.message.strip_suffix('"').and_then(|m| m.rsplit_once('"')) else { continue };
        let table_path = d.message.strip_prefix('[').and_then(|m| m.split(']').next());
        if let Some(help) = table_path.and_then(|path| picture_help(path, name)) {
            d.help = Some(format!("{help}; {known}"));
            continue;
        }
        let mut places: Vec<String> = Vec::new();
        for table in &tables {
            let has_key = table.keys.iter().any(|key| key.name == name);
            for path in std::iter::once(&table.path).chain(table.also) {
                places.extend(has_key.then(|| join(path, name)));
                places.extend((path.rsplit('.').next() == Some(name)).then(|| format!("[{path}]")));
            }
        }
        // Places in the same part of the scene are the likeliest.
        let part_of = |place: &str| place.trim_start_matches('[').split(['.', ']']).next().map(str::to_owned);
        let part = table_path.and_then(part_of);
        if places.iter().any(|place| part_of(place) == part) {
            places.retain(|place| part_of(place) == part);
        }
        let is_species = |span: &Span| report.sources.name(span.source).ends_with(".species");
        let help = match places.len() {
            0 => continue,
            // The keys of a species stand in its file without a table, and its file has no other table.
            1..=MAX_PLACES if d.labels.first().is_some_and(|label| is_species(&label.0)) => {
                format!("{} stands in a scene, not in the file of a species; {known}", places.join(" or "))
            }
            1..=MAX_PLACES => format!("did you mean {}? {known}", places.join(" or ")),
            _ => format!("`osier list options {name}` shows the tables that have it; {known}"),
        };
        d.help = Some(help);
    }
}

/// If a plant that nothing grows is one of overrides alone, its name is misspelt: names the plants of the scene in the help.
fn suggest_plants(root: &TomlTable, report: &mut Report) {
    let Some(plants) = root.table("plants") else { return };
    let is_override = |e: &TomlEntry| [SET, SWEEP].contains(&report.sources.name(e.key_span.source));
    let own: Vec<&str> = plants.entries.iter().filter(|e| !is_override(e)).map(|e| e.key.as_str()).collect();
    let added: Vec<&TomlEntry> = plants.entries.iter().filter(|e| is_override(e)).collect();
    if own.is_empty() {
        return;
    }
    for d in report.diagnostics.iter_mut().filter(|d| d.code == "S006") {
        let at = d.labels.first().map(|label| label.0);
        let Some(plant) = added.iter().find(|e| at == Some(e.key_span)) else { continue };
        d.help = Some(match nearest(&plant.key, own.iter().copied()) {
            Some(near) => format!("did you mean plants.{}?", path_element(near)),
            None => format!("plants of this scene: {}", own.join(", ")),
        });
    }
}

/// If an unknown key of the scene is a #define of one of its grammars, names the key that sets it in the help.
fn suggest_define_keys(recipe: &Recipe, report: &mut Report) {
    for d in report.diagnostics.iter_mut().filter(|d| d.code == "S002") {
        // Only the message holds the name, in the words of `syntax::key::unknown`.
        let Some(name) = d.message.strip_prefix("a scene has no key \"").and_then(|m| m.strip_suffix('"')) else {
            continue;
        };
        let has = |p: &&PlantRecipe| match &p.growth {
            Growth::Grammar(grammar) => grammar.defines().iter().any(|define| define.name == name),
            _ => false,
        };
        // Also find a misspelt name, ignoring case: `hight` for HEIGHT.
        let wanted = name.to_lowercase();
        let similar = recipe.plants.iter().find_map(|p| {
            let Growth::Grammar(grammar) = &p.growth else { return None };
            let defines = grammar.defines();
            let lower: Vec<String> = defines.iter().map(|define| define.name.to_lowercase()).collect();
            let near = nearest(&wanted, lower.iter().map(String::as_str))?;
            let define = defines.iter().find(|define| define.name.to_lowercase() == near)?;
            Some(format!("plants.{}.set.{}", path_element(&p.name), define.name))
        });
        let keys: Vec<String> =
            recipe.plants.iter().filter(has).map(|p| format!("plants.{}.set.{name}", path_element(&p.name))).collect();
        if !keys.is_empty() {
            d.help = Some(format!("it is a #define of a grammar: its key is {}", keys.join(" or ")));
            // The fix was a guess at a similar key, which the help now contradicts.
            d.fix = None;
        } else if let Some(key) = similar {
            let other = d.help.take().map(|help| format!(" Otherwise: {help}")).unwrap_or_default();
            d.help = Some(format!("did you mean {key}, a #define of a grammar?{other}"));
            d.fix = None;
        }
    }
}

/// Completes the path of an override of a bare file: `angle=30` sets a #define of the grammar, `coil=2` a key of particle-shapes,
/// `path_max=9` one of a species, `eps=0.1` a key of the growth of a tree, `leaf.size=0.1` a key of the plant. `root`: the scene of
/// the file.
fn qualify_override(set: &str, bare: Option<&SingleSource>, root: &TomlTable, registry: &Registry) -> String {
    let Some(bare) = bare else { return set.to_owned() };
    let path = set.split('=').next().unwrap_or_default().trim();
    // A key of the scene has precedence over a key of the plant, and that over a #define of its grammar.
    let first = path.split('.').next().unwrap_or_default();
    let top = registry.names::<SceneKeys>().contains(&first);
    // The table that all other keys belong to; a coefficient table has no #defines.
    let (plant, others) = match bare {
        SingleSource::Plant(name) => {
            let plant = root.table("plants").and_then(|plants| plants.table(name));
            let has = |key: &str| plant.is_some_and(|table| table.get(key).is_some());
            let others = if has("shapes") {
                "growth"
            } else if has("species") {
                "habit"
            } else {
                "set"
            };
            (path_element(name), others)
        }
        SingleSource::Tree(name) => (path_element(name), "tree"),
        SingleSource::Cloud(_) if top => return set.to_owned(),
        SingleSource::Cloud(name) => return format!("clouds.{}.{set}", path_element(name)),
    };
    // A key with a dot in it, such as `leaf.size`, belongs to the plant if its first word names a table of plants.
    let own = registry.names::<PlantKeys>().contains(&first);
    // `angle_deg` and `unit_m` are overridden most often, and no #define is likely to have these names.
    if matches!(path, "angle_deg" | "unit_m") {
        return format!("plants.{plant}.turtle.{set}");
    }
    if top {
        set.to_owned()
    } else if own || first == "set" {
        format!("plants.{plant}.{set}")
    } else {
        format!("plants.{plant}.{others}.{set}")
    }
}

/// A table whose name the scene chooses, such as `[plants.NAME]`.
pub(super) struct NamedTable<'a> {
    /// Name as written in the scene.
    pub(in crate::recipe) name: &'a str,
    /// Path in the scene, for messages.
    pub(in crate::recipe) path: &'a str,
    /// Its name in files, unique in the scene.
    pub(in crate::recipe) id: String,
}

/// The table `morph` of an attractor, in `[clouds.NAME]`.
pub(super) struct MorphTable<'a> {
    pub(in crate::recipe) table: &'a TomlTable,
    /// Position of its name in the scene, for messages.
    pub(in crate::recipe) span: Span,
}

pub(super) struct Resolver<'a> {
    pub(in crate::recipe) request: &'a Request,
    pub(in crate::recipe) registry: Registry,
    pub(in crate::recipe) report: Report,
    pub(in crate::recipe) whole: Span,
    pub(in crate::recipe) inputs: Vec<blake3::Hash>,
    /// Number of frames of the clip; 1 until the clip is read.
    pub(in crate::recipe) frames: u64,
    /// Whether the scene has `[rain]`, known before the plants are read.
    pub(in crate::recipe) raining: bool,
    /// Whether drops fall in that rain, known before the plants are read.
    pub(in crate::recipe) drops_fall: bool,
    /// Season of the scene, for plants without the key `season`.
    pub(in crate::recipe) season: Option<SeasonSpan>,
    /// Latitude of the scene, degrees, for plants without the key `latitude`.
    pub(in crate::recipe) latitude: Option<f64>,
    /// Names of the scene's solids, known before plants and solids are read.
    pub(in crate::recipe) solid_names: Vec<String>,
}

impl Resolver<'_> {
    fn recipe(&mut self, root: &TomlTable) -> Recipe {
        let mut general = self.read_keys::<SceneKeys>(root, "");
        general.seed = self.request.seed.unwrap_or(general.seed);
        if general.title.is_empty() {
            general.title.clone_from(&self.request.name);
        }
        // These two are defaults of the plants, which are resolved below.
        (self.season, self.latitude) = (general.season, general.latitude);
        let clip = self.clip(root);
        self.frames = clip.len() as u64;
        // Plants and clouds share one set of file names: both become assets of the scene.
        let mut names = Names::default();
        let plants = self.plants(root, &mut names);
        let clouds = self.clouds(root, &mut names);
        let layers = self.layers(root);
        // Places, scatters and flights refer to plants by index, so plants are resolved first.
        let places = self.places(root, &plants);
        self.check_sites_together(root, &plants, &places);
        let scatters = self.scatters(root, &plants);
        let flight = self.flight(root, &plants);
        let solids = self.solids(root);
        let rods = self.rods(root);
        // A lattice and its curves may set the speed and direction of the wind; a wind that changes with time cannot loop.
        let (mut wind, added) = self.wind(root);
        let lattice = self.lattice(root, &mut wind);
        let sway = self.sway(root, clip, flight.is_some());
        let sway = self.disable_loop(root, sway, lattice.curve().filter(|_| wind.model == WindModel::Lattice));
        let winds: Vec<_> = [&wind].into_iter().chain(&added).collect();
        self.report_fitted_lengths(root, &winds, &sway, &clip);
        // Files of the wind sample the domain of the lattice, else of the flight, else that of `[output.wind]`.
        let flight_size = flight.as_ref().map(|f| f.keys.size);
        let wind_output = self.wind_output(root, &wind, &lattice, flight_size, clip);
        let vdb = self.vdb_output(root, &wind, &lattice, flight_size, wind_output.keys.size, clip);
        let mut recipe = Recipe {
            name: safe_name(&self.request.name),
            general,
            clip,
            plants,
            clouds,
            catkin: root.get("catkin").map(|_| self.section(root, "catkin")),
            layers,
            picture: self.section(root, "picture"),
            places,
            ground: self.section(root, "ground"),
            terrain: self.terrain(root),
            scatters,
            flight,
            solids,
            rods,
            rain: self.rain(root),
            maps: self.maps(root),
            fog: self.section(root, "fog"),
            camera: self.camera(root),
            sun: self.section(root, "sun"),
            sky: self.section(root, "sky"),
            moves: false,
            wind,
            lattice,
            added,
            sway,
            output: self.output(root, clip, vdb, wind_output),
            hash: String::new(),
            places_of_keys: KeyPlaces::new(&self.report.sources, root),
        };
        // The hash covers all fields above and must be computed last.
        recipe.moves = clip.len() > 1 && recipe.blows();
        recipe.hash = hash(&recipe, &self.inputs);
        self.check_lattice(root, &recipe);
        self.report_ignored_keys(root, &recipe);
        recipe
    }

    /// Place of a value in a table of the scene, for messages; the beginning of the scene where no text gives it.
    pub(in crate::recipe) fn place_of(&self, table: &TomlTable, path: &[&str]) -> Span {
        span_of(table, path).unwrap_or(self.whole)
    }

    /// Reads the table `name` below the top level; all defaults without it.
    pub(in crate::recipe) fn section<S: KeyTable>(&mut self, parent: &TomlTable, name: &str) -> S {
        self.section_at(parent, "", name)
    }

    pub(in crate::recipe) fn section_at<S: KeyTable>(&mut self, parent: &TomlTable, path: &str, name: &str) -> S {
        let full = join(path, name);
        let table = self.table(parent, path, name);
        match table {
            Some(table) => self.read_keys(table, &full),
            None => S::defaults(),
        }
    }

    /// Reads the keys of a table and reports unknown ones (S002). `path`: path of the table in the scene.
    pub(in crate::recipe) fn read_keys<S: KeyTable>(&mut self, table: &TomlTable, path: &str) -> S {
        let keys = S::read(Some(table), path, &mut self.report);
        self.registry.refuse_unknown::<S>(table, path, &mut self.report);
        keys
    }

    /// The table `name` below another one; S003 and `None` if the key holds another type.
    pub(in crate::recipe) fn table<'t>(
        &mut self,
        parent: &'t TomlTable,
        path: &str,
        name: &str,
    ) -> Option<&'t TomlTable> {
        let entry = parent.get(name)?;
        if let TomlValue::Table(t) = &entry.node.value {
            return Some(t);
        }
        self.report.push(*wrong(&join(path, name), &entry.node, "a table"));
        None
    }

    /// Parses a referenced file of keys; `None` and S001 if it is not UTF-8 text.
    pub(in crate::recipe) fn parse_file(&mut self, file: &ReferencedFile) -> Option<TomlTable> {
        match decode(&file.bytes, Encoding::Utf8) {
            Ok(decoded) => {
                let source = self.report.sources.add(file.shown.clone(), decoded.text.as_str());
                Some(parse(&decoded.text, source, &mut self.report))
            }
            Err(bad) => {
                let mut report = Report::default();
                bad.report("S001", &file.shown, &file.bytes, &mut report);
                self.report.extend(report);
                None
            }
        }
    }

    /// The entries of `table`, of which those that the table `name` of `parent` has are replaced by its.
    pub(in crate::recipe) fn laid_over(
        &mut self,
        mut table: TomlTable,
        parent: &TomlTable,
        path: &str,
        name: &str,
    ) -> TomlTable {
        if let Some(own) = self.table(parent, path, name) {
            // Whole entries are replaced: a table of the scene is not merged into one of the same name.
            table.entries.retain(|e| own.get(&e.key).is_none());
            table.entries.extend(own.entries.iter().cloned());
        }
        table
    }

    fn clip(&mut self, root: &TomlTable) -> Clip {
        let keys: FramesKeys = self.section(root, "frames");
        // A scene without an end is one still frame.
        let end = keys.end.unwrap_or(keys.start);
        if end < keys.start {
            let span = self.place_of(root, &["frames", "end"]);
            let d = Diagnostic::error("S004", format!("frames.end is {end}, before frames.start"), span, "too small");
            self.report.push(d.help(format!("at least {}", keys.start)));
        }
        // After this error the clip is one frame long, so that the rest of the scene can be checked.
        let clip = Clip { start: keys.start, end: end.max(keys.start), fps: keys.fps };
        self.check_limit("frames", clip.len() as u64, span_of(root, &["frames", "end"]));
        clip
    }

    pub(in crate::recipe) fn check_limit(&mut self, name: &str, wanted: u64, span: Option<Span>) {
        if let Err(e) = self.request.limits.check(name, wanted, &format!("the number of {name}")) {
            self.report.push(Diagnostic::error("S004", e.to_string(), span.unwrap_or(self.whole), "over the limit"));
        }
    }

    /// Reports S004 if `count` items of `each` bytes would take more memory than the limit `memory`.
    pub(in crate::recipe) fn check_memory(&mut self, key: &str, count: u64, each: u64, span: Option<Span>) {
        let what = format!("memory of {key} = {count}, in bytes,");
        // A product beyond 64 bits saturates, which only an unlimited setting allows.
        if let Err(e) = self.request.limits.check("memory", count.saturating_mul(each), &what) {
            let d = Diagnostic::error("S004", e.to_string(), span.unwrap_or(self.whole), "over the limit");
            self.report.push(d.help(format!("each takes {each} bytes; give fewer")));
        }
    }

    /// The content of a file, or `None` after its errors have been reported.
    pub(in crate::recipe) fn load_or_report<T>(&mut self, read: Result<T>, file: &ReferencedFile) -> Option<T> {
        match read {
            Ok(held) => Some(held),
            // Errors in the text of the file have positions in it.
            Err(Error::Input(faults)) => {
                self.report.extend(*faults);
                None
            }
            Err(other) => {
                self.report.push(Diagnostic::about("S005", format!("\"{}\": {other}", file.shown)));
                None
            }
        }
    }

    pub(in crate::recipe) fn read(
        &mut self,
        reference: &str,
        span: Span,
        limit: &str,
        endings: &[&str],
    ) -> Option<ReferencedFile> {
        let mut fail = |message: String, help: String| {
            self.report.push(Diagnostic::error("S005", message, span, "this reference").help(help));
        };
        // A file named on the command line is judged by its content, whatever its ending.
        let is_named = self.request.bare.is_some();
        if !is_named && !endings.iter().any(|e| reference.to_ascii_lowercase().ends_with(e)) {
            // The name of a preset without its ending, as `osier bake` takes it.
            let mut names = endings.iter().map(|ending| format!("{reference}{ending}"));
            let wanted = endings.join(", ");
            let has_ending = |name: &str| endings.iter().any(|e| name.to_ascii_lowercase().ends_with(e));
            let help = match (names.find(|name| crate::presets::find(name).is_some()), reference.rsplit_once('#')) {
                (Some(name), _) => format!("did you mean the preset \"{name}\"?"),
                // The command line takes `FILE#SYSTEM`; a scene has a key for the system.
                (None, Some((file, system))) if has_ending(file) && endings.contains(&".ifs") => {
                    format!("write \"{file}\", and beside it the key system = \"{system}\"")
                }
                (None, _) => format!("expected a file {wanted}"),
            };
            fail(format!("\"{reference}\" has another ending than {wanted}"), help);
            return None;
        }
        match self.request.library.find(reference, self.request.limits.get(limit)) {
            Ok(found) => {
                // The scene hash covers the bytes, not the name: an edited file makes a different scene, a moved one does not.
                self.inputs.push(blake3::hash(&found.bytes));
                Some(found)
            }
            Err(why) => {
                // Most references without a file are misspelt presets.
                let names = crate::presets::PRESETS.iter().map(|p| p.name);
                let is_missing = matches!(why, ReadError::Missing { .. });
                let near = if is_missing { nearest(reference, names) } else { None };
                let other =
                    reference.strip_suffix(".species").filter(|_| is_missing).and_then(crate::presets::other_name);
                let help = match (other, near) {
                    (Some(species), _) => {
                        format!("did you mean \"{species}\", another name of that tree? If not, {}", why.help())
                    }
                    // A file of the user may be near the name of a preset by chance.
                    (None, Some(near)) => format!("did you mean the preset \"{near}\"? If not, {}", why.help()),
                    (None, None) if matches!(why, ReadError::TooLong { .. }) => {
                        format!("make the file smaller, or raise the limit with --max-{limit}")
                    }
                    (None, None) if endings == [".species"] && is_missing => {
                        format!("`osier list species` lists those in the program; for one of your own, {}", why.help())
                    }
                    (None, None) => why.help().into(),
                };
                fail(why.to_string(), help);
                None
            }
        }
    }

    fn output(&mut self, root: &TomlTable, clip: Clip, vdb: VdbRecipe, wind: WindOutputRecipe) -> OutputRecipe {
        let keys: OutputKeys = self.section(root, "output");
        let empty = TomlTable::default();
        let table = self.table(root, "", "output").unwrap_or(&empty);
        // Files of these formats have contents only in clips: frames are counted and written there alone.
        let clips_only = [&osier_export::points::FORMAT, &osier_export::vdb::FORMAT, &osier_export::stats::FORMAT];
        let words: Vec<&str> = keys.formats.iter().map(|f| f.0.word).collect();
        let useless: Vec<&str> =
            words.into_iter().filter(|word| clip.len() < 2 && clips_only.iter().any(|f| f.word == *word)).collect();
        if !useless.is_empty() {
            let span = self.place_of(root, &["output", "formats"]);
            let text = format!("output.formats needs a clip for {}, but the scene has one frame", useless.join(", "));
            let d = Diagnostic::warning("S007", text, span, "has no effect");
            self.report.push(d.help("make it a clip: [frames] end = 48"));
        }
        // Grids of the wind are written without a format.
        if keys.formats.is_empty() && wind.grids.is_empty() {
            let span = self.place_of(root, &["output", "formats"]);
            let text = "output.formats is empty: a bake writes nothing of the scene";
            let d = Diagnostic::warning("S007", text, span, "no format");
            self.report.push(d.help("name formats, such as [\"usd\", \"glb\"], or leave the key out"));
        }
        let output = OutputRecipe {
            keys,
            pov: {
                let keys: PovKeys = self.section_at(table, "output", "pov");
                self.check_pov_size(root, &keys);
                keys
            },
            photons: self.photons(table),
            usd: self.section_at(table, "output", "usd"),
            gltf: {
                let keys = self.section_at(table, "output", "gltf");
                self.check_gltf_frame(root, &keys, clip);
                self.check_gltf_profiles(root, &keys);
                keys
            },
            points: self.section_at(table, "output", "points"),
            unreal: self.section_at(table, "output", "unreal"),
            vdb,
            wind,
        };
        self.report_empty_lists(root, &output);
        output
    }

    /// Warns with S007 of formats without a file, since the list of what they write is empty.
    fn report_empty_lists(&mut self, root: &TomlTable, output: &OutputRecipe) {
        let lists = [
            (&osier_export::gltf::FORMAT, "gltf", "profiles", output.gltf.profiles.is_empty()),
            (&osier_export::vdb::FORMAT, "vdb", "grids", output.vdb.keys.grids.is_empty()),
            (&osier_export::points::FORMAT, "points", "tables", output.points.tables.is_empty()),
        ];
        for (format, table, key, is_empty) in lists {
            if is_empty && output.writes(format) {
                let span = self.place_of(root, &["output", table, key]);
                let text = format!("output.{table}.{key} is empty: no file of \"{}\" is written", format.word);
                let d = Diagnostic::warning("S007", text, span, "nothing to write");
                self.report.push(d.help("leave the key out, or the format"));
            }
        }
        // `size` and `texel` alone choose no file; format vdb takes its box from them.
        let wind = root.table("output").and_then(|t| t.table("wind"));
        if wind.is_some_and(|t| t.get("slice").is_none() && t.get("vti_every").is_none()) && !output.writes_vdb() {
            let span = self.place_of(root, &["output", "wind"]);
            let text = "`[output.wind]` names neither planes nor boxes, so that no file of the wind is written";
            let d = Diagnostic::warning("S007", text, span, "nothing to write");
            self.report.push(d.help("add [[output.wind.slice]], or vti_every = 1 for the whole box"));
        }
    }

    /// Reads `[output.pov.photons]`; `None` without the table.
    fn photons(&mut self, output: &TomlTable) -> Option<PhotonKeys> {
        let pov = output.table("pov")?;
        pov.get("photons").map(|_| self.section_at(pov, "output.pov", "photons"))
    }

    /// Reports S004 for a fraction of a pixel.
    fn check_pov_size(&mut self, root: &TomlTable, keys: &PovKeys) {
        if keys.size.iter().any(|side| side.fract().abs() > 0.0) {
            let [width, height] = keys.size;
            let text = format!("output.pov.size is {width} by {height} pixels, but must be whole numbers");
            let at = self.place_of(root, &["output", "pov", "size"]);
            let d = Diagnostic::error("S004", text, at, "whole numbers");
            self.report.push(d.help(format!("write size = [{}, {}]", width.round(), height.round())));
        }
    }

    /// Reports S004 if the frame that a still glTF shows is not one of the clip.
    fn check_gltf_frame(&mut self, root: &TomlTable, keys: &GltfKeys, clip: Clip) {
        // Without the key the glTF has the first frame, which is always one of the clip.
        if let Some(frame) = keys.frame.filter(|f| !(clip.start..=clip.end).contains(f)) {
            let span = self.place_of(root, &["output", "gltf", "frame"]);
            let text = format!("output.gltf.frame is {frame}, but must be {} to {}", clip.start, clip.end);
            let d = Diagnostic::error("S004", text, span, "not in the clip");
            self.report.push(d.help("name a frame of the clip, or make it longer: [frames] end"));
        }
    }

    /// Warns of keys whose profile is not written, and checks that `channels` has four words or one preset.
    fn check_gltf_profiles(&mut self, root: &TomlTable, keys: &GltfKeys) {
        for (key, profile) in [
            ("quantize", GltfProfile::Web),
            ("meshopt", GltfProfile::Web),
            ("triangles", GltfProfile::Engine),
            ("joints", GltfProfile::Engine),
            ("leaves_mb", GltfProfile::Blender),
        ] {
            if let Some(span) = span_of(root, &["output", "gltf", key]).filter(|_| !keys.profiles.contains(&profile)) {
                let word = match profile {
                    GltfProfile::Blender => "blender",
                    GltfProfile::Web => "web",
                    GltfProfile::Engine => "engine",
                };
                let text = format!("output.gltf.{key} is for the profile \"{word}\", which is not written");
                let d = Diagnostic::warning("S007", text, span, "has no effect");
                self.report.push(d.help(format!("add the profile: [output.gltf] profiles = [\"{word}\"]")));
            }
        }
        // These keys are about the file of a whole scene, which profile "engine" does not write.
        let is_engine_alone = !keys.profiles.is_empty() && keys.profiles.iter().all(|p| *p == GltfProfile::Engine);
        for key in ["assets", "skins"] {
            if let Some(span) = span_of(root, &["output", "gltf", key]).filter(|_| is_engine_alone) {
                let text = format!(
                    "output.gltf.{key} does not change the profile \"engine\", which has a file with a skin for each asset"
                );
                let d = Diagnostic::warning("S007", text, span, "has no effect");
                self.report.push(
                    d.help("leave it out, or add a profile with a file of the whole scene: \"web\", \"blender\""),
                );
            }
        }
        if keys.channels.is_empty() {
            return;
        }
        let span = self.place_of(root, &["output", "gltf", "channels"]);
        let presets = keys.channels.iter().filter(|w| w.is_preset()).count();
        // Either four channels without a preset among them, or a single preset.
        if (keys.channels.len(), presets) != (4, 0) && (keys.channels.len(), presets) != (1, 1) {
            let text = "output.gltf.channels must be four words, or one preset";
            let d = Diagnostic::error("S003", text, span, "neither");
            let help = "write channels = [\"flutter\", \"phase\", \"branch\", \"light\"] or channels = [\"crysis\"]";
            self.report.push(d.help(help));
        } else if !keys.profiles.contains(&GltfProfile::Engine) {
            let text = "output.gltf.channels needs the profile \"engine\": other readers multiply the plant's colour by vertex colours";
            let d = Diagnostic::warning("S007", text, span, "has no effect");
            self.report.push(d.help("add the profile: [output.gltf] profiles = [\"engine\"]"));
        }
    }
}

pub(super) fn span_of(root: &TomlTable, path: &[&str]) -> Option<Span> {
    let (name, rest) = path.split_first()?;
    let entry = root.get(name)?;
    match &entry.node.value {
        // If the path leads beyond a plain value, the span of that value is the nearest one.
        TomlValue::Table(t) if !rest.is_empty() => span_of(t, rest),
        _ => Some(entry.node.span),
    }
}

/// BLAKE3 over the fields of the recipe in the order of declaration, then over the hashes of the files read.
fn hash(recipe: &Recipe, inputs: &[blake3::Hash]) -> String {
    let mut hasher = blake3::Hasher::new();
    recipe.digest(&mut hasher);
    for input in inputs {
        hasher.update(input.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}
