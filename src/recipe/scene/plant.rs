//! `[plants.NAME]`: source, organs, materials and motion of a plant.

use super::{
    BarkKeys, BarkKind, BranchRadii, IfsTreeKeys, ImportedMeshKeys, OrganKeys, SeasonSpan, SeasonType, SkinForm,
    SkinKeys, TurtleKeys, UpAxis,
};
use crate::recipe::resolve::{Resolver, span_of};
use crate::recipe::syntax::{
    BooleanType, FileReference, NamedNumbers, NumberArray, OneOf, OptionalKey, Reference, SeedType, TomlTable,
    TomlValue, integer, join, number, word_of, wrong,
};
use crate::recipe::syntax::{Digest as _, KeyTable};
use crate::recipe::syntax::{choices, keys};
use crate::recipe::{BarkPictures, CARD, Companions, Growth, OrganRecipe, PlantRecipe, ReferencedFile};
use osier_base::Error;
use osier_base::diagnostic::{Diagnostic, Report, Severity, Sources, Span, nearest};
use osier_base::files::Names;
use osier_grammar::{FileKind, FunctionTables, Grammar, Notation, ReadAs};
use osier_ifs::stems::{TreeSystem, sheared};
use osier_ifs::{Ifs, leaf};
use osier_import::Imported;
use osier_plants::grow::years::Habit;
use osier_scene::{Image, ImageKind, MaterialClass};
use std::collections::BTreeMap;
use std::sync::Arc;

choices! {
    /// Representation of a plant's motion in files.
    BarkMotion {
        /// Joints and skin weights: small files, supported by most readers.
        Skin = "skin",
        /// Points of every frame: exact, but large files; formats without point caches get a skin.
        Cache = "cache",
        /// At most 64 joints, with leaves merged and bound to them; flutter and sway also as attributes for shaders.
        Game = "game",
        /// No motion in files, but attributes for shaders.
        Static = "static",
        /// No motion: the plant keeps its shape at rest.
        Still = "still",
    }
}

choices! {
    /// Notation of a grammar file, and within cpfg's the commands of its turtle.
    GrammarDialect {
        /// Notation and turtle commands of the program cpfg.
        Cpfg = "cpfg",
        /// Notation of cpfg, drawn as in "The Algorithmic Beauty of Plants".
        Abop = "abop",
        /// Notation of cpfg, with the turtle commands of the paper on catkins.
        Catkin = "catkin",
        /// Notation of Fractint's L-system files, drawn in a plane.
        Fractint = "fractint",
        /// Notation of the program LParser.
        LParser = "lparser",
        /// Notation of the Python package L-Py.
        LPy = "lpy",
    }
}

choices! {
    /// Random numbers of the productions and functions of a grammar.
    GrammarRandom {
        /// By address: a change of one branch leaves all others as they are.
        Osier = "osier",
        /// In sequence as in the program cpfg, whose strings result; seeds of scenes have no effect.
        Cpfg = "cpfg",
    }
}

choices! {
    /// Growth of a grammar's plant over a clip.
    ClipSteps {
        /// The plant develops as its grammar has it, by steps and parts of steps, without jumps.
        Smooth = "smooth",
        /// The plant develops step by step; each step appears at once.
        Whole = "whole",
        /// The grown plant appears from its base on, part by part, at its final place and in its final direction.
        Unveil = "unveil",
    }
}

impl GrammarDialect {
    /// The notation of the grammar reader for files of this dialect.
    pub fn notation(self) -> Notation {
        match self {
            Self::Cpfg => Notation::Cpfg,
            Self::Abop => Notation::Abop,
            Self::Catkin => Notation::Catkin,
            Self::Fractint => Notation::Fractint,
            Self::LParser => Notation::LParser,
            Self::LPy => Notation::LPy,
        }
    }
}

keys! {
    /// A plant; NAME is any name.
    PlantKeys at "plants.NAME" {
        /// Grammar (L-system) of the plant.
        grammar: Option<Reference> = "grammar" FileReference(".l, .ls, .lpy"), basic;
        /// Notation of the grammar, where its content does not tell.
        dialect: Option<GrammarDialect> = "dialect" OptionalKey(OneOf(GrammarDialect::Cpfg), "what the file's content says");
        /// How the grammar draws random numbers: by address ("osier"), or as the program cpfg ("cpfg"), whose strings come out then.
        rng: GrammarRandom = "rng" OneOf(GrammarRandom::Osier);
        /// Coefficient table of a tree, instead of a grammar.
        ifs: Option<Reference> = "ifs" FileReference(".ifs, .ifs.toml"), basic;
        /// Mesh of a whole plant, instead of a grammar; osier extracts its skeleton.
        mesh: Option<Reference> = "mesh" FileReference(".obj, .glb, .gltf");
        /// File of particle-shapes, instead of a grammar.
        shapes: Option<Reference> = "shapes" FileReference(".shapes"), basic;
        /// Species that grows year by year, instead of a grammar: a file, or the name of a preset.
        species: Option<Reference> = "species" FileReference(".species"), basic;
        /// With `species`: age; fractions grow part of a year.
        age: Option<f64> = "age" OptionalKey(number(60.0, 0.1, 500.0, "yr"), "that of the species"), basic;
        /// File of particle-shapes that adds twigs and leaves to the axes that bear none; of its level 0 only spacing, base and
        /// angle count.
        twigs: Option<Reference> = "twigs" FileReference(".shapes");
        /// Number of derivation steps; of a fraction the last step is drawn in part, so that the plant grows from step to step without
        /// jumps.
        steps: Option<f64> = "steps" OptionalKey(number(1.0, 0.0, 1e6, ""), "that of the grammar"), basic;
        /// Values that replace `#define`s of the grammar.
        set: Vec<(String, f64)> = "set" NamedNumbers;
        /// Added to the scene's seed for this plant.
        seed: u64 = "seed" SeedType(0);
        /// Whether productions are selected at random by their weights.
        stochastic: Option<bool> = "stochastic" OptionalKey(BooleanType(true), "true if the grammar has a `Seed:`");
        /// How motion is written: joints ("skin"), points of every frame ("cache"), few joints and shader attributes
        /// ("game"), shader attributes only ("static"), or no motion ("still").
        motion: BarkMotion = "motion" OneOf(BarkMotion::Skin), basic;
        /// Shares of its growth time, 0 to 1, at the first and the last frame: the plant grows over the clip and does not sway.
        growth_clip: Option<[f64; 2]> = "growth_clip" OptionalKey(NumberArray([0.0, 1.0], number(0.0, 0.0, 1.0, "")), "fully grown");
        /// With `growth_clip`: how the plant of a grammar grows: through its derivation ("smooth", or "whole" steps), or as the grown plant
        /// from its base on ("unveil").
        clip_steps: ClipSteps = "clip_steps" OneOf(ClipSteps::Smooth);
        /// Time of the growing year: 0 bud burst, 0.5 summer, 0.8 autumn colours, 1 bare; or a date "MM-DD". Two of them change the leaves
        /// over the clip, and the plant does not sway.
        season: Option<SeasonSpan> = "season" OptionalKey(SeasonType, "that of the scene");
        /// Geographic latitude, by which dates become seasons; negative in the south.
        latitude: Option<f64> = "latitude" OptionalKey(number(50.0, -90.0, 90.0, "deg"), "that of the scene");
        /// Whether leaves carry how much of the sky the crown takes from them.
        canopy_occlusion: bool = "canopy_occlusion" BooleanType(false);
        /// How much normals of leaves are bent outwards from the crown, so that it is shaded as one round body: 0 not at all, 1 wholly.
        canopy_normals: f64 = "canopy_normals" number(0.0, 0.0, 1.0, "");
        /// Largest number of joints of the skeleton.
        max_joints: u32 = "max_joints" integer(256, 1, 300);
        /// Largest number of branches that bend individually.
        max_branches: u32 = "max_branches" integer(2000, 1, 100_000);
    }
}

/// Largest number of autumn colours of an organ, since each adds three materials.
const MAX_AUTUMN_COLORS: usize = 12;

/// A direction counts as the midrib of a leaf if the extents along +Y and in the opposite direction are both below this share of
/// the extent along it. Own: blades three times as wide as long pass, and leaves that lie on their side with some curl do not.
const SMALL_REACH: f32 = 0.25;

/// Reach along +Y, as a share of the largest extent, below which a mesh has no length to scale. Own: shallow flowers are deeper.
const FLAT_SHARE: f32 = 0.1;

/// Reach of a leaf behind its origin, as a share of that before it, above which its origin is not the base of the petiole. Own: the
/// lobes of heart-shaped blades reach back by a third.
const CENTRED_SHARE: f32 = 0.5;

/// Reach of a tree behind its foot, as a share of its height, up to which it rises from there. Own: roots and a leaning trunk.
const BURIED_SHARE: f32 = 0.1;

/// Largest extent of an imported tree, m, above which its unit is not the metre. Own: the tallest living tree has 116 m, a tree of
/// 3 m in centimetres 300.
const TALLEST_TREE: f32 = 200.0;

/// Keys and tables of growth and appearance, which have no effect on a plant from a mesh.
const GROWN: &[&str] = &[
    "grammar",
    "ifs",
    "shapes",
    "growth",
    "species",
    "age",
    "habit",
    "site",
    "stand",
    "prune",
    "twigs",
    "fill",
    "steps",
    "set",
    "season",
    "latitude",
    "stochastic",
    "turtle",
    "tree",
    "leaf",
    "organs",
    "bark",
    "shoot",
    "skin",
];

/// The words between `|` in a pattern, trimmed and in lower case, without empty ones.
pub fn words(pattern: &str) -> Vec<String> {
    pattern.split('|').map(|w| w.trim().to_lowercase()).filter(|w| !w.is_empty()).collect()
}

/// How a grammar's file is read.
struct GrammarChoice<'a> {
    /// Name of the L-system in a file that holds several.
    entry: Option<&'a str>,
    functions: Arc<FunctionTables>,
    /// Position at which the scene names the file.
    span: Span,
    /// The plant's table.
    plant: &'a TomlTable,
}

/// Sets root flare and burial to 0, unless the scene gives them: hairs have no roots.
fn tuft_defaults(plant: &TomlTable, skin: &mut SkinKeys) {
    // Keys that the scene gives are kept.
    for (key, value) in [("bury", &mut skin.bury), ("flare", &mut skin.flare)] {
        if !is_in_skin(plant, key) {
            *value = 0.0;
        }
    }
}

/// A species says how its trunk widens to the ground, unless the scene does.
fn species_flare(plant: &TomlTable, habit: &Habit, skin: &mut SkinKeys) {
    let given = |key: &str| is_in_skin(plant, key);
    if !given("flare") {
        skin.flare = habit.flare.into();
    }
    if !given("flare_height") {
        skin.flare_height = habit.flare_height.into();
    }
    if !given("buttresses") {
        skin.buttresses = habit.ridges();
    }
}

/// Whether the scene sets this key of a plant's skin.
fn is_in_skin(plant: &TomlTable, key: &str) -> bool {
    plant.table("skin").is_some_and(|skin| skin.get(key).is_some())
}

/// Diagnostic for a file that is not a grammar: L007 for Houdini's notation, S005 for others.
pub(crate) fn no_grammar(name: &str, kind: FileKind, span: Span) -> Diagnostic {
    match kind {
        FileKind::Houdini => {
            let message = format!("\"{name}\" has rules as Houdini writes them, which are not supported");
            let help = "write 'Lsystem: 1', 'derivation length: 4', 'Axiom: ..', productions 'F --> F[+F]F' and 'endlsystem'; \
                        '+' turns right in Houdini and left in osier";
            Diagnostic::error("L007", message, span, "this file").help(help)
        }
        FileKind::Grammar(_) | FileKind::Other => {
            let message = format!("\"{name}\" is no grammar");
            let help = "a grammar begins with 'Lsystem:', or is a file of Fractint, LParser or L-Py; `dialect` names its notation";
            Diagnostic::error("S005", message, span, "this file").help(help)
        }
    }
}

/// Lets organs with equal table and keys share the cell of their drawn leaf, so that it is drawn once for all plants.
fn share_leaves(plants: &mut [PlantRecipe]) {
    // The digest covers what the scene hash covers: organs that differ in any key may be drawn differently.
    let digest = |o: &OrganRecipe| {
        let mut hasher = blake3::Hasher::new();
        o.keys.digest(&mut hasher);
        hasher.finalize()
    };
    let mut known: Vec<(Arc<Ifs>, blake3::Hash, Arc<leaf::LazyLeaf>)> = Vec::new();
    for organ in plants.iter_mut().flat_map(|p| &mut p.organs) {
        let Some(table) = &organ.ifs else { continue };
        let keys = digest(organ);
        // Scenes have few organs: a linear search is enough.
        match known.iter().find(|(t, k, _)| *k == keys && t == table) {
            Some((.., drawn)) => organ.drawn = Arc::clone(drawn),
            None => known.push((Arc::clone(table), keys, Arc::clone(&organ.drawn))),
        }
    }
}

/// Axis, scale and material class with which a mesh file is imported.
#[derive(Debug, Clone, Copy)]
pub(in crate::recipe) struct MeshImport {
    /// Axis that points up in the file.
    pub up: UpAxis,
    /// Metres per unit of the file.
    pub scale: f64,
    /// Class that all materials of the file get.
    pub class: MaterialClass,
}

impl OrganRecipe {
    /// A parametric blade with default keys, for letters that the scene does not describe.
    pub fn blade(letter: char) -> Self {
        Self { letter, keys: OrganKeys::defaults(), ifs: None, drawn: Arc::default(), mesh: None, surface: None }
    }
}

impl Resolver<'_> {
    pub(in crate::recipe) fn plants(&mut self, root: &TomlTable, names: &mut Names) -> Vec<PlantRecipe> {
        let Some(table) = self.table(root, "", "plants").filter(|table| !table.entries.is_empty()) else {
            if !self.report.has_errors()
                && ["clouds", "terrain", "layer", "catkin", "flight", "rod"].iter().all(|t| root.get(t).is_none())
                // A scene without visible objects may still export the wind.
                && span_of(root, &["output", "wind"]).is_none()
            {
                let d = Diagnostic::error("S006", "the scene has no plants", self.whole, "no [plants.NAME] table");
                self.report.push(d.help("add [plants.tree] with grammar = \"oak.l\""));
            }
            return Vec::new();
        };
        let mut plants = Vec::new();
        for entry in &table.entries {
            let TomlValue::Table(plant) = &entry.node.value else {
                self.report.push(*wrong(&format!("plants.{}", entry.key), &entry.node, "a table"));
                continue;
            };
            // Plants with errors take a name too, so that the ids of later plants do not depend on them.
            let id = names.unique(&entry.key);
            plants.extend(self.plant(&entry.key, id, entry.key_span, plant));
        }
        share_leaves(&mut plants);
        plants
    }

    fn plant(&mut self, name: &str, id: String, span: Span, table: &TomlTable) -> Option<PlantRecipe> {
        let path = format!("plants.{name}");
        let reported = self.report.diagnostics.len();
        let mut keys = self.read_keys::<PlantKeys>(table, &path);
        // The key that names the source may have an error, so that its absence is not reported again.
        let misread = self.report.diagnostics.len() > reported;
        // The command line overrides the scene; keys of a plant override those of the scene.
        keys.steps = self.request.steps.or(keys.steps);
        keys.season = keys.season.or(self.season);
        keys.latitude = keys.latitude.or(self.latitude);
        let turtle: TurtleKeys = self.section_at(table, &path, "turtle");
        let mut organs = self.organs(table, &path);
        let bark: BarkKeys = self.section_at(table, &path, "bark");
        let mut shoot: BarkKeys = self.section_at(table, &path, "shoot");
        self.shoot_defaults(table, &mut shoot);
        let mut skin: SkinKeys = self.section_at(table, &path, "skin");
        let wood = self.section_at(table, &path, "wood");
        let rods = table.get("rods").map(|_| self.section_at(table, &path, "rods"));
        self.settle_forms(table, &path, &mut keys, &mut skin);
        // From here on `?` ends the plant after a diagnostic.
        let grains = [self.bark_grain_table(&bark)?, self.bark_grain_table(&shoot)?];
        let bark_pictures =
            [self.bark_pictures(table, &path, "bark", &bark)?, self.bark_pictures(table, &path, "shoot", &shoot)?];
        for (name, file, help) in [
            ("import", &keys.mesh, "it sets how a mesh is read: name one with mesh = \"FILE\""),
            ("growth", &keys.shapes, "it sets how particle-shapes grow: name a file with shapes = \"FILE.shapes\""),
            ("habit", &keys.species, "it sets how a species grows: name one with species = \"oak\""),
            ("site", &keys.species, "it sets where a species grows: name one with species = \"oak\""),
            ("stand", &keys.species, "it sets the neighbours of a species: name one with species = \"oak\""),
            ("prune", &keys.species, "it cuts a species that grows year by year: name one with species = \"oak\""),
            ("age", &keys.species, "only a species has an age: name one with species = \"oak\""),
            ("fill", &keys.twigs, "it sets which twigs are added: name a file with twigs = \"FILE.shapes\""),
        ] {
            if let Some(entry) = table.get(name).filter(|_| file.is_none()) {
                let text = format!("{path}.{name} has no effect");
                let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
                self.report.push(d.help(help));
            }
        }
        if self.has_two_sources(table, &path) {
            return None;
        }
        if keys.species.is_some() {
            for (key, why) in [
                ("steps", "a species grows for `age` years"),
                ("set", "only a grammar has #defines; the habit of a species is in [plants.NAME.habit]"),
                ("turtle", "only a grammar is drawn by a turtle"),
                ("tree", "only a coefficient table has it; the habit of a species is in [plants.NAME.habit]"),
                ("stochastic", "only a grammar has productions"),
            ] {
                // Surfaces of organs have the unit of the turtle.
                let is_read = key == "turtle" && organs.iter().any(|o| o.surface.is_some());
                if let Some(entry) = table.get(key).filter(|_| !is_read) {
                    let d = Diagnostic::warning(
                        "S007",
                        format!("{path}.{key} has no effect on a species"),
                        entry.key_span,
                        "has no effect",
                    );
                    self.report.push(d.help(why));
                }
            }
        }
        let others =
            [(&keys.ifs, "a coefficient table"), (&keys.shapes, "particle-shapes"), (&keys.mesh, "an imported mesh")];
        if let Some((_, what)) = others.iter().find(|(file, _)| file.is_some())
            && let Some(entry) = table.get("set")
        {
            let text = format!("{path}.set has no effect on {what}");
            let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
            self.report.push(d.help("only a grammar has #defines"));
        }
        let mut companions = Companions::default();
        // One of mesh, grammar, coefficient table and particle-shapes grows the plant. `letters` are the organs that it uses.
        let (growth, source, mut letters) = match (&keys.grammar, &keys.ifs) {
            _ if keys.mesh.is_some() => {
                let (mesh, import) = self.import_plant_mesh(&keys, &path, table)?;
                // All leaves of a mesh are one organ, which only holds their flutter.
                let flutter = OrganKeys { flutter: import.flutter, ..OrganKeys::defaults() };
                organs = vec![OrganRecipe { keys: flutter, ..OrganRecipe::blade('l') }];
                (Growth::Mesh(Box::new(mesh.1), import), mesh.0, Vec::new())
            }
            (Some(reference), _) => {
                let (name, entry) = self.grammar_reference(&reference.text);
                let file = self.read(name, reference.span, "text-bytes", &[""])?;
                companions = self.companions(&file, &turtle);
                let functions = companions.function_tables();
                let source = GrammarChoice { entry, functions, span: reference.span, plant: table };
                let grammar = self.grammar(&file, source, &keys)?;
                let mut letters = grammar.organ_symbols();
                let is_drawn = companions.view.is_some();
                // Files of other programs give the widths of stems. Drawings of a view have no ground, so that they get no root flare
                // either.
                if grammar.is_tuft() || is_drawn || grammar.is_foreign() {
                    tuft_defaults(table, &mut skin);
                }
                for (letter, surface) in &companions.surfaces {
                    if letters.contains(letter) && organs.iter().all(|o| o.letter != *letter) {
                        organs.push(OrganRecipe { surface: Some(Arc::clone(surface)), ..OrganRecipe::blade(*letter) });
                    }
                }
                // A view describes all of its surfaces, so that other letters get no default blade.
                letters.retain(|_| !is_drawn);
                (Growth::Grammar(Box::new(grammar)), file.shown, letters)
            }
            (None, Some(reference)) => {
                let mut tree: IfsTreeKeys = self.section_at(table, &path, "tree");
                let (stems, source, sets) = self.tree_system(reference, &tree)?;
                tree.twigs &= self.can_instance_twigs(table, &path, &stems, &tree, &keys, rods.is_some());
                // Condensation sets of the table replace the organs of their letters.
                organs.retain(|o| sets.iter().all(|s| s.letter != o.letter));
                organs.extend(sets);
                (Growth::Ifs(Box::new(stems), tree), source, vec!['l'])
            }
            (None, None) if keys.shapes.is_some() => {
                let reference = keys.shapes.as_ref()?;
                let file = self.read(&reference.text, reference.span, "text-bytes", &[".shapes"])?;
                let shapes = self.shape_keys(&file, table, &path, "growth")?;
                (Growth::Shapes(Box::new(shapes)), file.shown, vec!['l'])
            }
            (None, None) if keys.species.is_some() => {
                let reference = keys.species.as_ref()?;
                if reference.text.is_empty() {
                    let d = Diagnostic::error("S005", format!("{path}.species is empty"), reference.span, "no species");
                    self.report.push(d.help("name a preset, such as species = \"oak\", or a file; `osier list species` lists those in the program"));
                    return None;
                }
                // The ending may be left out: species = "oak".
                let is_named = self.request.bare.is_some() && reference.text.contains('.');
                let has_ending = is_named || reference.text.to_ascii_lowercase().ends_with(".species");
                let name = if has_ending { reference.text.clone() } else { format!("{}.species", reference.text) };
                let file = self.read(&name, reference.span, "text-bytes", &[".species"])?;
                let mut species = self.species_recipe(&file, table, &path, keys.age)?;
                species_flare(table, &species.habit.habit, &mut skin);
                let blocked = self.why_no_growth_clip(&keys);
                species.clip = self.species_clip(&species, table, &path, keys.growth_clip, blocked);
                // With `growth_clip` this has been reported.
                if species.clip.is_some() && keys.growth_clip.is_none() && rods.is_some() {
                    self.has_no_effect(table, &path, &["rods"], "the tree grows over the clip and does not sway");
                }
                (Growth::Species(Box::new(species)), file.shown, vec!['l'])
            }
            // An error in `grammar` has been reported.
            (None, None) if misread => return None,
            (None, None) => {
                let d = Diagnostic::error("S006", format!("[{path}] names no grammar"), span, "no grammar here");
                let help = "add grammar = \"NAME.l\", shapes = \"NAME.shapes\", species = \"oak\" or mesh = \"FILE\"; `osier list presets` shows those in the binary";
                self.report.push(d.help(help));
                return None;
            }
        };
        self.settle_season(table, &path, &growth, &mut keys);
        let fill = match &keys.twigs {
            // An imported mesh keeps its surface.
            _ if matches!(growth, Growth::Mesh(..)) => None,
            // The record of the years has no added twigs.
            Some(_) if matches!(&growth, Growth::Species(species) if species.clip.is_some()) => {
                self.has_no_effect(table, &path, &["twigs"], "the tree grows over the clip year by year");
                None
            }
            Some(reference) => {
                let file = self.read(&reference.text, reference.span, "text-bytes", &[".shapes"])?;
                letters.extend(Some('l').filter(|l| !letters.contains(l)));
                Some(self.shape_keys(&file, table, &path, "fill")?)
            }
            None => None,
        };
        // Letters that are used but not described get a blade with default keys.
        for letter in letters {
            if !organs.iter().any(|o| o.letter == letter) {
                organs.push(OrganRecipe::blade(letter));
            }
        }
        // Billboards are a separate organ, after all others.
        if matches!(&growth, Growth::Ifs(_, tree) if tree.lod > 0) {
            let keys = OrganKeys { flutter: 0.0, ..OrganKeys::defaults() };
            organs.push(OrganRecipe { keys, ..OrganRecipe::blade(CARD) });
        }
        self.check_segment_organ(table, &path, &skin, &organs);
        Some(PlantRecipe {
            name: name.into(),
            id,
            companions,
            growth,
            fill,
            source,
            turtle,
            organs,
            bark,
            shoot,
            grains,
            bark_pictures,
            skin,
            wood,
            rods,
            keys,
        })
    }

    /// Reports S003 for a plant with two source files. A mesh together with a source other than a species is a warning S007:
    /// the mesh is used.
    fn has_two_sources(&mut self, plant: &TomlTable, path: &str) -> bool {
        let mut given: Vec<_> = ["grammar", "ifs", "shapes", "species"].iter().filter_map(|k| plant.get(k)).collect();
        if plant.get("species").is_some() {
            given.extend(plant.get("mesh"));
        }
        let [first, second, ..] = given[..] else { return false };
        let text = format!("{path} has both {} and {}: a plant grows from one of them", first.key, second.key);
        let mut d = Diagnostic::error("S003", text, second.key_span, "the second");
        d.labels.push((first.key_span, "the first".into()));
        self.report.push(d.help("leave one of them out, or make it a plant of its own"));
        true
    }

    /// Reports S003 for `skin.segment` with the letter of an organ that the plant does not have.
    fn check_segment_organ(&mut self, plant: &TomlTable, path: &str, skin: &SkinKeys, organs: &[OrganRecipe]) {
        let mut letters = skin.segment.chars();
        // An empty text means prisms.
        let (Some(letter), rest) = (letters.next(), letters.next()) else { return };
        let known = organs.iter().any(|o| o.letter == letter && o.letter != CARD);
        if known && rest.is_none() {
            return;
        }
        let span = self.place_of(plant, &["skin", "segment"]);
        let text = format!("{path}.skin.segment names the organ \"{}\", which the plant does not have", skin.segment);
        let names: Vec<String> =
            organs.iter().filter(|o| o.letter != CARD).map(|o| format!("\"{}\"", o.letter)).collect();
        let d = Diagnostic::error("S003", text, span, "one letter of an organ");
        self.report.push(d.help(if names.is_empty() {
            format!("give it such an organ: [{path}.organs.{letter}]")
        } else {
            format!("its organs are {}; another one is described by [{path}.organs.{letter}]", names.join(", "))
        }));
    }

    /// Warns with S007 of keys that exclude each other, and drops one: growth over the clip in the rain or with shader
    /// attributes, segments in the rain or on rods. Also warns of leaves that are merged, through which rain falls.
    fn settle_forms(&mut self, plant: &TomlTable, path: &str, keys: &mut PlantKeys, skin: &mut SkinKeys) {
        if let Some(why) = self.why_no_growth_clip(keys).filter(|_| keys.growth_clip.is_some()) {
            self.has_no_effect(plant, path, &["growth_clip"], why);
            keys.growth_clip = None;
        }
        if keys.growth_clip.is_some() && plant.get("rods").is_some() {
            self.has_no_effect(plant, path, &["rods"], "the plant grows over the clip and does not sway");
        }
        if skin.form == SkinForm::Segments && (self.raining || plant.get("rods").is_some()) {
            let why = if self.raining { "rain needs a closed skin" } else { "rods need a closed skin" };
            self.has_no_effect(plant, path, &["skin", "form"], why);
            skin.form = SkinForm::Loft;
        }
        // Drops strike instances of leaves; plants on rods have these with any motion.
        let merges_leaves = matches!(keys.motion, BarkMotion::Game | BarkMotion::Static) && plant.get("rods").is_none();
        if self.drops_fall && merges_leaves {
            let word = word_of(keys.motion);
            let text =
                format!("rain falls through the leaves of {path}: motion = \"{word}\" merges them into one mesh");
            let span = self.place_of(plant, &["motion"]);
            let d = Diagnostic::warning("S007", text, span, "no single leaves");
            self.report.push(d.help("take motion = \"skin\" or \"cache\" for leaves that drops meet"));
        }
    }

    /// Warns with S007 of a season without effect: on billboards, on imported meshes, and on a tree that grows over the clip. A
    /// season that changes over the clip stays that of the first frame in the rain, for shaders, on rods, on growing
    /// plants, and without a clip.
    fn settle_season(&mut self, plant: &TomlTable, path: &str, growth: &Growth, keys: &mut PlantKeys) {
        let Some(span) = keys.season else { return };
        match growth {
            // Reported with the other keys of a mesh.
            Growth::Mesh(..) => keys.season = None,
            Growth::Ifs(_, tree) if tree.lod > 0 => {
                self.has_no_effect(plant, path, &["season"], "the leaves of this lod are pictures on billboards");
                keys.season = None;
            }
            Growth::Species(species) if species.clip.is_some() => {
                self.has_no_effect(
                    plant,
                    path,
                    &["season"],
                    "leaves of a tree that grows over the clip have `clip_leaves`",
                );
                keys.season = None;
            }
            _ => {}
        }
        let why = match keys.motion {
            BarkMotion::Game | BarkMotion::Static => "its motion is left to shaders",
            _ if self.raining => "rain meets leaves that stay",
            _ if keys.growth_clip.is_some() => "the plant grows over the clip",
            _ if plant.get("rods").is_some() => "leaves on rods stay",
            _ if self.frames <= 1 => "the scene has one frame: set frames.end",
            _ => return,
        };
        if span.changes() && keys.season.is_some() {
            let place = self.place_of(plant, &["season"]);
            let text = format!("{path}.season does not change over the clip");
            let d = Diagnostic::warning("S007", text, place, "the second season has no effect");
            self.report.push(d.help(format!("because {why}")));
            keys.season = Some(SeasonSpan { last: span.first, ..span });
        }
    }

    /// Reason why a plant cannot grow over the clip, for messages; `None` if it can.
    fn why_no_growth_clip(&self, keys: &PlantKeys) -> Option<&'static str> {
        if self.raining {
            Some("rain meets grown plants")
        } else if matches!(keys.motion, BarkMotion::Game | BarkMotion::Static) {
            Some("its motion is left to shaders")
        } else if self.frames <= 1 {
            Some("the scene has one frame: set frames.end")
        } else {
            None
        }
    }

    /// Warns with S007 that `key`, a path within the plant's table, has no effect. `path`: of that table in the scene; `why`:
    /// the reason, worded to follow "because".
    pub(super) fn has_no_effect(&mut self, plant: &TomlTable, path: &str, key: &[&str], why: &str) {
        let span = self.place_of(plant, key);
        let text = format!("{path}.{} has no effect", key.join("."));
        self.report.push(Diagnostic::warning("S007", text, span, "has no effect").help(format!("because {why}")));
    }

    /// Whether the ends of an IFS tree can be instances of a few branchlets; S007 if they are requested but cannot.
    fn can_instance_twigs(
        &mut self,
        plant: &TomlTable,
        path: &str,
        stems: &TreeSystem,
        tree: &IfsTreeKeys,
        keys: &PlantKeys,
        rods: bool,
    ) -> bool {
        // Branchlets can be instances only if each map is a rotation with uniform scale and no feature needs single leaves.
        let sheared = sheared(stems);
        let why = match sheared {
            // The first reason that applies is reported.
            _ if rods => "each branch bends on its own as a rod".to_owned(),
            _ if tree.lod > 0 => "this lod replaces them by billboards".to_owned(),
            _ if self.raining => "rain needs each leaf on its own".to_owned(),
            _ if keys.season.is_some() => "a season shows each leaf on its own".to_owned(),
            _ if tree.radii == BranchRadii::Pipe => "radii = \"pipe\" needs every branch tip".to_owned(),
            Some(i) => format!("map {} is not a rotation with uniform scale", i + 1),
            None => return true,
        };
        // No warning if branchlets were not requested.
        if tree.twigs {
            let span = self.place_of(plant, &["tree", "twigs"]);
            let d = Diagnostic::warning("S007", format!("{path}.tree.twigs has no effect"), span, "has no effect");
            self.report.push(d.help(format!("the tree has no instanced twigs, because {why}")));
        }
        false
    }

    /// Reads the mesh of a whole plant: the file's name for messages, its content, and the keys of `[plants.NAME.import]`.
    fn import_plant_mesh(
        &mut self,
        keys: &PlantKeys,
        path: &str,
        table: &TomlTable,
    ) -> Option<((String, Imported), ImportedMeshKeys)> {
        for entry in table.entries.iter().filter(|e| GROWN.contains(&e.key.as_str())) {
            let text = format!("{path}.{} has no effect on a mesh", entry.key);
            let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
            self.report.push(
                d.help("a mesh keeps its own shape, leaves and materials; set how it is read in [plants.NAME.import]"),
            );
        }
        let import: ImportedMeshKeys = self.section_at(table, path, "import");
        // Every name contains the empty word, so that all of the mesh would be leaves.
        if words(&import.leaf_pattern).is_empty() {
            let span = self.place_of(table, &["import", "leaf_pattern"]);
            let text = format!("{path}.import.leaf_pattern names no word");
            let d = Diagnostic::error("S003", text, span, "no word");
            self.report.push(d.help(
                "separate words by bars: \"leaf|needle\"; if no name contains any of them, leaves are found by shape",
            ));
            return None;
        }
        let reference = keys.mesh.as_ref()?;
        let file = self.read(&reference.text, reference.span, "mesh-bytes", &[".obj", ".glb", ".gltf"])?;
        let options = MeshImport { up: import.mesh_up, scale: import.mesh_scale, class: MaterialClass::Bark };
        let mesh = self.import(&file, options, reference.span)?;
        self.check_upright(&mesh, path, reference.span, import.mesh_up);
        self.check_size(&mesh, path, reference.span);
        Some(((file.shown, mesh), import))
    }

    /// Reports S044 for a tree that rises along Z from its origin and reaches as far below the ground as above it: the up axis of its
    /// file is the other one.
    fn check_upright(&mut self, tree: &Imported, path: &str, span: Span, up: UpAxis) {
        let b = tree.mesh.bounds();
        let (below, height) = (-b.min.y, b.max.y);
        // For both directions of Z: name, extent of the mesh along it, and extent in the opposite direction.
        let is_trunk = |(_, reach, behind): &(&str, f32, f32)| *reach > height && *behind < BURIED_SHARE * reach;
        let axes = [("+Z", b.max.z, -b.min.z), ("-Z", -b.min.z, b.max.z)];
        let Some((name, reach, _)) = axes.into_iter().find(is_trunk).filter(|_| below > 0.5 * height) else { return };
        let text = format!(
            "{path}.mesh reaches {reach:.2} m along {name}, {height:.2} m above the ground and {below:.2} m below it"
        );
        let d = Diagnostic::warning("S044", text, span, "this tree lies on its side");
        self.report.push(d.help(match up {
            UpAxis::Y => "the file has Z up: write mesh_up = \"z\" in [plants.NAME.import]",
            UpAxis::Z => "the file has Y up: leave `mesh_up` out of [plants.NAME.import]",
        }));
    }

    /// Reports S045 for a tree larger than [`TALLEST_TREE`]: its file is in a smaller unit than metres.
    fn check_size(&mut self, tree: &Imported, path: &str, span: Span) {
        let side = tree.mesh.bounds().size().max_element();
        if side <= TALLEST_TREE {
            return;
        }
        let text = format!("{path}.mesh is {side:.0} m large");
        let d = Diagnostic::warning("S045", text, span, "no tree is as large");
        self.report.push(d.help(
            "for a file in centimetres write mesh_scale = 0.01 in [plants.NAME.import], for one in millimetres 0.001",
        ));
    }

    /// Reads the IFS table of a bark's grain; the outer `None` after an error, the inner one without the key.
    #[allow(clippy::option_option, reason = "a table that fails is not the same as no table")]
    fn bark_grain_table(&mut self, bark: &BarkKeys) -> Option<Option<Arc<Ifs>>> {
        match &bark.ifs {
            Some(r) => Some(Some(Arc::new(self.plane_table(r, &bark.system, "bark is tiled")?))),
            None => Some(None),
        }
    }

    /// Reads the pictures of the bark in the table `name` of a plant, and warns of keys that have no effect with them or without; the
    /// outer `None` after an error, the inner one without the key.
    #[allow(clippy::option_option, reason = "a picture that fails is not the same as no picture")]
    fn bark_pictures(
        &mut self,
        plant: &TomlTable,
        path: &str,
        name: &str,
        keys: &BarkKeys,
    ) -> Option<Option<BarkPictures>> {
        let table = plant.table(name);
        let Some(texture) = &keys.texture else {
            if let Some(entry) = table.and_then(|table| table.get("normal_texture")) {
                let text = format!("{path}.{name}.normal_texture has no effect");
                let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
                self.report.push(d.help("it belongs to a picture: name that too, with texture = \"FILE\""));
            }
            return Some(None);
        };
        // One warning for all: a texture often replaces the bark of a scene that has many of them.
        let given = |key: &&str| table.is_some_and(|table| table.get(key).is_some());
        let ignored: Vec<&str> = ["kind", "ifs", "system", "color", "color2", "depth_mm", "patches", "side"]
            .into_iter()
            .filter(given)
            .collect();
        if !ignored.is_empty() {
            let text = format!(
                "{} of {path}.{name} have no effect: its texture replaces the painted bark",
                ignored.join(", ")
            );
            self.report.push(Diagnostic::warning("S007", text, texture.span, "this picture").help("leave them out"));
        }
        let color = self.picture(texture)?;
        let normal = match &keys.normal_texture {
            Some(reference) => {
                let picture = self.picture(reference)?;
                if picture.channels == 1 {
                    let text = format!("{path}.{name}.normal_texture is grey: \"{}\"", reference.text);
                    let d = Diagnostic::error("S003", text, reference.span, "no normal map");
                    self.report.push(d.help(
                        "a normal map has directions as red, green and blue; a height map has to be converted to one",
                    ));
                    return None;
                }
                Some(Image { kind: ImageKind::Data, ..picture })
            }
            None => None,
        };
        Some(Some(BarkPictures { color, normal }))
    }

    /// Sets kind and map size of the bark of thin axes, unless the scene gives them.
    fn shoot_defaults(&self, plant: &TomlTable, shoot: &mut BarkKeys) {
        let given = |key: &str| plant.table("shoot").is_some_and(|shoot| shoot.get(key).is_some());
        if !given("kind") {
            shoot.kind = BarkKind::Shoot;
        }
        if !given("side") {
            shoot.side = 256;
        }
    }

    fn organs(&mut self, plant: &TomlTable, path: &str) -> Vec<OrganRecipe> {
        let mut organs = Vec::new();
        if let Some(table) = self.table(plant, path, "leaf") {
            organs.extend(self.organ('l', &join(path, "leaf"), table));
        }
        if let Some(table) = self.table(plant, path, "organs") {
            for e in &table.entries {
                let full = format!("{path}.organs.{}", e.key);
                // Characters, not bytes: every letter of Unicode may name an organ.
                let mut letters = e.key.chars();
                match (&e.node.value, letters.next(), letters.next()) {
                    (TomlValue::Table(t), Some(letter), None) => organs.extend(self.organ(letter, &full, t)),
                    (TomlValue::Table(_), ..) => {
                        let d = Diagnostic::error(
                            "S003",
                            format!("organ \"{}\" is not a single letter", e.key),
                            e.key_span,
                            "not one letter",
                        );
                        self.report.push(d.help("organs are named by the one letter that follows '~' in the grammar"));
                    }
                    _ => self.report.push(*wrong(&full, &e.node, "a table")),
                }
            }
        }
        organs
    }

    fn organ(&mut self, letter: char, path: &str, table: &TomlTable) -> Option<OrganRecipe> {
        let keys = self.read_keys::<OrganKeys>(table, path);
        self.check_autumn(table, path, &keys);
        let mesh = match &keys.mesh {
            Some(r) => {
                let file = self.read(&r.text, r.span, "mesh-bytes", &[".obj", ".glb", ".gltf"])?;
                let options = MeshImport { up: keys.mesh_up, scale: keys.mesh_scale, class: MaterialClass::Leaf };
                let mesh = self.import(&file, options, r.span)?;
                self.check_midrib(&mesh, path, r.span, keys.size.is_some());
                Some(Arc::new(mesh))
            }
            None => None,
        };
        let ifs = match keys.ifs.clone() {
            Some(r) => Some(Arc::new(self.plane_table(&r, &keys.system, "a leaf is drawn")?)),
            None => None,
        };
        let surface = match keys.surface.clone() {
            Some(r) => Some(self.organ_surface(&r)?),
            None => None,
        };
        Some(OrganRecipe { keys, ifs, mesh, surface, ..OrganRecipe::blade(letter) })
    }

    /// Reports S044 for a leaf that reaches much farther to a side than along +Y, where its midrib belongs, or whose middle is at the
    /// origin instead of its base: `size` would be that of its curl, or of half of it. Flowers and fruits, which reach as far to the
    /// opposite side, may be flat unless they are `sized` by that key.
    fn check_midrib(&mut self, leaf: &Imported, path: &str, span: Span, sized: bool) {
        let b = leaf.mesh.bounds();
        let (up, behind, extent) = (b.max.y.max(0.0), -b.min.y, b.size().max_element());
        // For each direction except +Y: name, extent of the mesh along it, and extent in the opposite direction.
        let directions = [
            ("-X", -b.min.x, b.max.x),
            ("+X", b.max.x, -b.min.x),
            ("-Y", behind, b.max.y),
            ("-Z", -b.min.z, b.max.z),
            ("+Z", b.max.z, -b.min.z),
        ];
        let is_midrib = |(_, reach, behind): &(&str, f32, f32)| up.max(*behind) < SMALL_REACH * reach;
        let longest = directions.into_iter().filter(is_midrib).max_by(|a, b| a.1.total_cmp(&b.1));
        let turn = "turn it in its file: base of the petiole at the origin, tip towards +Y, upper side towards +Z; a leaf that \
                    lies along Y in Blender has these axes if it is exported without \"+Y Up\" (glTF), or with Y forward and Z up (OBJ)";
        let (text, label, help) = if let Some((name, reach, _)) = longest {
            let text = format!(
                "{path}.mesh reaches {reach:.3} m along {name}, and {up:.3} m along +Y, where its midrib belongs"
            );
            (text, "this leaf lies on its side", turn)
        } else if sized && up < FLAT_SHARE * extent {
            let text = format!("{path}.size is the reach of the mesh along +Y, which is {up:.3} m of {extent:.3} m");
            (text, "this mesh is flat along Y", turn)
        } else if behind > CENTRED_SHARE * up && 2.0 * (up + behind) > extent {
            let text = format!(
                "{path}.mesh reaches {behind:.3} m behind the origin, where the base of its petiole belongs, and {up:.3} m before it"
            );
            let help = "move it in its file until the base of the petiole is at the origin, which in Blender is that of the scene";
            (text, "this leaf is not held at its base", help)
        } else {
            return;
        };
        self.report.push(Diagnostic::warning("S044", text, span, label).help(help));
    }

    /// Reports S003 for too many autumn colours, and for weights that do not fit them.
    fn check_autumn(&mut self, table: &TomlTable, path: &str, keys: &OrganKeys) {
        let (colors, weights) = (keys.autumn.len(), keys.autumn_weights.len());
        let mut refuse = |key: &str, text: String, help: &str| {
            let span = span_of(table, &[key]).unwrap_or(self.whole);
            self.report.push(Diagnostic::error("S003", format!("{path}.{key} {text}"), span, "this list").help(help));
        };
        // Both lists are checked, so that two errors may be reported.
        if colors > MAX_AUTUMN_COLORS {
            let text = format!("has {colors} colors, but may have {MAX_AUTUMN_COLORS}");
            refuse("autumn", text, "each color is a material with pictures of its own: leave out similar ones");
        }
        if weights > colors {
            let text = format!("has {weights} numbers for {colors} colors of `autumn`");
            refuse("autumn_weights", text, "write one number for each color, in the order of `autumn`");
        } else if weights == colors && weights > 0 && keys.autumn_weights.iter().all(|w| *w <= 0.0) {
            refuse("autumn_weights", "leaves no color".into(), "write a number above 0 for at least one color");
        }
    }

    /// File and entry of the reference `FILE#ENTRY`; a file whose name contains `#` is found as a whole first.
    fn grammar_reference<'r>(&self, reference: &'r str) -> (&'r str, Option<&'r str>) {
        let limit = self.request.limits.get("text-bytes");
        match reference.rsplit_once('#') {
            Some((file, entry)) if self.request.library.find(reference, limit).is_err() => (file, Some(entry)),
            _ => (reference, None),
        }
    }

    /// Parses a grammar with its defines; the bytes of files that it includes enter the scene hash. `None` after an error.
    fn grammar(&mut self, file: &ReferencedFile, choice: GrammarChoice<'_>, keys: &PlantKeys) -> Option<Grammar> {
        let GrammarChoice { entry, functions, span, plant } = choice;
        let notation = keys.dialect.map(GrammarDialect::notation);
        let kind = osier_grammar::detect(&file.shown, &file.bytes);
        if notation.is_none() && !matches!(kind, FileKind::Grammar(_)) {
            self.report.push(no_grammar(&file.shown, kind, span));
            return None;
        }
        let library = &self.request.library;
        let limit = self.request.limits.get("text-bytes");
        // Includes are resolved beside the file that names them; their bytes enter the scene hash.
        // The grammar knows files by displayed names; this map holds their paths.
        let mut paths = BTreeMap::from([(file.shown.clone(), file.path.clone())]);
        let inputs = &mut self.inputs;
        let mut includes = |reference: &str, from: &str| {
            let beside = paths.get(from).cloned().unwrap_or_default();
            let found = library.find_beside(&beside, reference, limit).map_err(|why| {
                // The reader of grammars expects an I/O error: the reason becomes its text.
                let missing = std::io::Error::other(why.to_string());
                Error::io("open", reference, missing)
            })?;
            inputs.push(blake3::hash(&found.bytes));
            paths.insert(found.shown.clone(), found.path);
            Ok((found.shown, found.bytes.to_vec()))
        };
        let defines = keys.set.iter().map(|(name, value)| (name.clone(), value.to_string())).collect();
        let source = osier_grammar::GrammarSource {
            name: &file.shown,
            bytes: &file.bytes,
            includes: &mut includes,
            defines: &defines,
            functions,
        };
        let mut sources = Sources::default();
        let read_as = ReadAs { notation, entry };
        let parsed = osier_grammar::parse_as(&mut sources, source, read_as, &self.request.limits);
        let (grammar, diagnostics) = self.load_or_report(parsed, file)?;
        self.report.extend(Report { sources, diagnostics, ..Report::default() });
        self.check_set(&grammar, plant);
        Some(grammar)
    }

    /// L002 for each value in `set` without a `#define` of its name. Notations without `#define`s get S007.
    fn check_set(&mut self, grammar: &Grammar, plant: &TomlTable) {
        let Some(set) = plant.table("set") else { return };
        let has_defines = !matches!(grammar.notation(), Notation::Fractint | Notation::LParser | Notation::LPy);
        let known: Vec<&str> = grammar.defines().iter().map(|d| d.name.as_str()).collect();
        for entry in set.entries.iter().filter(|entry| !known.contains(&entry.key.as_str())) {
            let help = match nearest(&entry.key, known.iter().copied()) {
                Some(near) => format!("did you mean \"{near}\"?"),
                // A name for the angle of turns in many other programs.
                None if entry.key.eq_ignore_ascii_case("angle") => {
                    "the angle of turns without a number is `angle_deg` of [plants.NAME.turtle], for a bare grammar --set angle_deg=25"
                        .to_owned()
                }
                None if known.is_empty() => "the grammar has no #define to set".to_owned(),
                None => format!("its #defines: {}", known.join(", ")),
            };
            let text = format!("the grammar has no #define \"{}\"", entry.key);
            let label = "no macro takes this value";
            // An error where the notation has #defines: a misspelt name would otherwise be ignored.
            let d = match has_defines {
                true => Diagnostic::error("L002", text, entry.key_span, label),
                false => Diagnostic::warning("S007", text, entry.key_span, label),
            };
            self.report.push(d.help(help));
        }
    }

    /// Imports a mesh file; the bytes of files that it names enter the scene hash. `None` after a diagnostic at `span`.
    pub(in crate::recipe) fn import(
        &mut self,
        file: &ReferencedFile,
        options: MeshImport,
        span: Span,
    ) -> Option<Imported> {
        match self.imported(file, options) {
            Ok(imported) => Some(imported),
            Err(Error::Input(mut faults)) => {
                // An error about the whole file is reported at the reference to it.
                let is_whole = |d: &Diagnostic| d.labels.is_empty() && d.severity == Severity::Error;
                let all = std::mem::take(&mut faults.diagnostics);
                let (whole, placed): (Vec<_>, Vec<_>) = all.into_iter().partition(is_whole);
                faults.diagnostics = placed;
                self.report.extend(*faults);
                whole.into_iter().for_each(|d| self.report.push(d.label(span, "this reference")));
                None
            }
            Err(other) => {
                self.report.push(Diagnostic::error("S005", other.to_string(), span, "this reference"));
                None
            }
        }
    }

    /// As [`Resolver::import`], but returns errors to the caller.
    pub(in crate::recipe) fn imported(
        &mut self,
        file: &ReferencedFile,
        options: MeshImport,
    ) -> osier_base::Result<Imported> {
        let request = self.request;
        let MeshImport { up, scale, class } = options;
        let options = osier_import::ImportOptions {
            roots: request.library.roots(),
            limits: &request.limits,
            up: if up == UpAxis::Z { osier_import::UpAxis::Z } else { osier_import::UpAxis::Y },
            scale: osier_base::math::narrow(scale),
            class,
        };
        let mut imported = osier_import::read(&file.path, &file.bytes, &options)?;
        self.report.extend(std::mem::take(&mut imported.warnings));
        // The first file is the mesh, whose bytes `read` has hashed.
        self.inputs.extend(imported.files.iter().skip(1).map(|f| blake3::Hash::from_bytes(f.blake3)));
        Ok(imported)
    }
}
