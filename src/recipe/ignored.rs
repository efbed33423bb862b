//! Warnings about keys that have no effect beside the values of other keys.

use std::f64::consts::PI;

use super::resolve::Resolver;
use super::scene::{
    BladeOutline, CatkinKeys, ColorBy, DropFriction, DropLever, DropMerge, DropShape, FlightRelease, ImpactModel,
    LatticeProfile, MAX_GROUND_TILE, OrganKeys, RainEnvelope, RainSize, RodLoadKind, SHOOT_RADIUS, SkinForm,
    SolidShape, SwayModel, SwayStart, WindKeys, WindModel, why_in_place,
};
use super::syntax::{KeyTable as _, TomlTable, join};
use super::{Growth, PlaceRecipe, PlantRecipe, Recipe};
use osier_base::diagnostic::Diagnostic;
use osier_grammar::Notation;

/// Keys of a table that have an effect only beside another value.
struct Needs<'a> {
    keys: &'a [&'a str],
    /// Whether the scene has that value.
    met: bool,
    /// That value, worded to follow "it needs".
    what: &'a str,
}

fn needs<'a>(keys: &'a [&'a str], met: bool, what: &'a str) -> Needs<'a> {
    Needs { keys, met, what }
}

/// Keys of organs that describe the outline of a parametric blade; `blade` itself also sets the season of other leaves, and
/// `width` stretches leaves of a coefficient table.
const OF_OUTLINES: &[&str] =
    &["lobes", "depth", "leaflets", "leaflet_length", "minor_teeth", "veins", "waviness", "petiole_flatness"];
/// Further keys of organs that meshes and surfaces of files replace.
const OF_DRAWN_LEAVES: &[&str] =
    &["width", "fold_deg", "curl_deg", "color", "color2", "variants", "detail", "side", "translucency", "roughness"];
/// Further keys of organs that needles do not have.
const OF_BLADES: &[&str] = &["fold_deg", "curl_deg", "petiole", "color2", "side"];
/// Keys and tables of plants that only grammars read, those of them that are about the notation, and those that only trees of
/// coefficient tables read.
const OF_GRAMMARS: &[&str] = &["steps", "set", "stochastic", "dialect", "rng"];
const OF_NOTATIONS: &[&str] = &["dialect", "rng"];
const OF_TREES: &[&str] = &["tree"];
const NONE: &[&str] = &[];
/// Keys of layers that rectangles do not have.
const OF_LAYER_TABLES: &[&str] = &["system", "weights", "points", "color_by", "prefix", "colors", "exposure", "gamma"];
/// Largest share of a plane that equal discs cover, pi / sqrt 12.
const DENSEST_DISCS: f64 = 0.906_9;
/// Requirement of keys of the sway model.
const SWAYING: &str = "a plant that sways: leave [plants.NAME.rods] out";
/// Requirement of latitudes of plants.
const DATED: &str = "a season that is a date: season = \"10-20\"";

impl Resolver<'_> {
    /// Warns with S007 of keys that have no effect beside the values that the scene gives. A scene with errors gets no such
    /// warning, since its recipe lacks what could not be read.
    pub(super) fn report_ignored_keys(&mut self, root: &TomlTable, recipe: &Recipe) {
        if self.report.has_errors() {
            return;
        }
        self.ignored_in_view(root, recipe);
        self.ignored_in_output(root, recipe);
        self.ignored_in_wind(root, recipe);
        self.ignored_in_rain(root, recipe);
        self.ignored_in_flight(root, recipe);
        self.ignored_in_objects(root, recipe);
        for (i, (table, place)) in root.tables("place").into_iter().zip(&recipe.places).enumerate() {
            self.ignored_in_place(table, &format!("place.{i}"), place, recipe.plants.get(place.plant));
        }
        let has_grammar = recipe.plants.iter().any(|plant| matches!(plant.growth, Growth::Grammar(_)));
        if self.request.steps.is_some() && !has_grammar {
            let d = Diagnostic::about("S007", "the number of steps has no effect");
            self.report.push(d.help("it needs a grammar, whose derivation it ends"));
        }
        let latitude = needs(&["latitude"], recipe.plants.iter().any(is_dated), DATED);
        self.report_unmet(Some(root), "", &[latitude]);
        for plant in &recipe.plants {
            if let Some(table) = table_at(root, &["plants", plant.name.as_str()]) {
                let path = format!("plants.{}", plant.name);
                self.ignored_in_plant(table, &path, plant);
                self.report_missing_solids(table, &path, plant, recipe);
            }
        }
    }

    /// Warns of those of the keys that a table has and whose needs are not met. `path`: of the table in the scene.
    fn report_unmet(&mut self, table: Option<&TomlTable>, path: &str, all: &[Needs<'_>]) {
        let Some(table) = table else { return };
        for unmet in all.iter().filter(|n| !n.met) {
            for entry in unmet.keys.iter().filter_map(|key| table.get(key)) {
                let text = format!("{} has no effect", join(path, &entry.key));
                let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
                self.report.push(d.help(format!("it needs {}", unmet.what)));
            }
        }
    }

    fn ignored_in_view(&mut self, root: &TomlTable, recipe: &Recipe) {
        let haze = needs(&["color", "height"], recipe.fog.visibility.is_some(), "haze: add visibility = 400");
        self.report_unmet(table_at(root, &["fog"]), "fog", &[haze]);
        let fitted = needs(&["distance"], recipe.camera.eye.is_none(), "a fitted camera: leave `eye` out");
        self.report_unmet(table_at(root, &["camera"]), "camera", &[fitted]);
        // The scene made for a bare file turns the ground off itself, which needs no warning.
        let has_ground = recipe.terrain.is_none() || self.request.bare.is_some();
        let whole = [
            needs(&["ground"], has_ground, "a scene without [terrain], which replaces the ground"),
            needs(&["maps"], recipe.rain.is_some(), "[rain]: these are maps of the water on leaves"),
        ];
        self.report_unmet(Some(root), "", &whole);
        let ground = &recipe.ground;
        // Beside a terrain the whole table has been reported; one that is not shown keeps its keys.
        let has_edge = ground.tile >= ground.size || !ground.show || !has_ground;
        let side = ground.size.min(MAX_GROUND_TILE);
        let one_texture = format!("one texture over the whole ground: size = {side} and tile = {side}");
        self.report_unmet(table_at(root, &["ground"]), "ground", &[needs(&["haze"], has_edge, &one_texture)]);
    }

    /// Warns of statistics of a scene that counts nothing.
    fn ignored_in_output(&mut self, root: &TomlTable, recipe: &Recipe) {
        let is_counted = recipe.rain.is_some() || recipe.flight.is_some();
        if is_counted || !recipe.output.writes(&osier_export::stats::FORMAT) {
            return;
        }
        if let Some(formats) = table_at(root, &["output"]).and_then(|table| table.get("formats")) {
            let text = "output.formats has csv, but the scene has neither rain nor catkins to count";
            let d = Diagnostic::warning("S007", text, formats.key_span, "csv has no effect");
            self.report.push(d.help("add [rain] or [flight], or leave csv out"));
        }
    }

    fn ignored_in_wind(&mut self, root: &TomlTable, recipe: &Recipe) {
        // Catkins fly in their spin-up, before the first frame; rain in a still scene has no wind.
        let is_met = recipe.clip.len() > 1 || recipe.flight.is_some();
        let clip = needs(&["wind", "sway"], is_met || !recipe.blows(), "a clip: [frames] end = 48");
        self.report_unmet(Some(root), "", &[clip]);
        let wind = table_at(root, &["wind"]);
        self.ignored_in_model(wind, "wind", &recipe.wind);
        let added = wind.map(|table| table.tables("add")).unwrap_or_default();
        for (i, (table, keys)) in added.into_iter().zip(&recipe.added).enumerate() {
            self.ignored_in_model(Some(table), &format!("wind.add.{i}"), keys);
        }
        // Without a lattice its whole table has been reported.
        if recipe.has_lattice_wind() {
            let profile = recipe.lattice.profile;
            let of_profiles = [
                needs(&["exponent"], profile == LatticeProfile::Power, "profile = \"power\""),
                needs(&["profile_table"], profile == LatticeProfile::Table, "profile = \"table\""),
            ];
            self.report_unmet(table_at(root, &["wind", "lattice"]), "wind.lattice", &of_profiles);
        }
        let (sway, is_paper) = (&recipe.sway, recipe.sway.model == SwayModel::Paper);
        let of_paper = &["paper_fixes", "paper_recoil", "paper_damping"];
        let of_beams = &["lean", "whip", "modes", "gravity_change"];
        // Plants on rods do not loop, so that they start at rest in any clip.
        let on_rods = recipe.plants.iter().any(|plant| plant.rods.is_some());
        let starts = sway.start == SwayStart::Moving || sway.loop_frames(&recipe.clip).is_none() || on_rods;
        let all = [
            needs(of_paper, is_paper, "model = \"paper\""),
            // In the rain, too, the wind bends plants by this model; only what drops add is that of beams.
            needs(of_beams, !is_paper, "model = \"beam\""),
            needs(&["start"], starts, "repeat = false: a clip that loops has no start"),
        ];
        self.report_unmet(table_at(root, &["sway"]), "sway", &all);
    }

    /// Keys of gusts beside a model without them. Calm air keeps the keys of the wind that a scene may have again, and those of a
    /// lattice have been reported.
    fn ignored_in_model(&mut self, table: Option<&TomlTable>, path: &str, keys: &WindKeys) {
        let model = keys.model;
        let printed = model == WindModel::Perlin && keys.literal;
        let gusts = !matches!(model, WindModel::Uniform | WindModel::Perlin);
        let of_gusts = &["gust_length", "turbulence", "eddy_size", "wander_deg"];
        let of_both = &["gust", "height_power", "flicker"];
        let of_fields = &["gust", "height_power"];
        let all = [
            needs(of_gusts, gusts, "model = \"gust\""),
            needs(of_both, model != WindModel::Uniform, "model = \"gust\" or \"perlin\""),
            needs(of_fields, !printed, "a wind that is not the paper's: leave `literal` out"),
        ];
        self.report_unmet(table, path, &all);
    }

    fn ignored_in_rain(&mut self, root: &TomlTable, recipe: &Recipe) {
        let Some(rain) = &recipe.rain else { return };
        let (size, envelope) = (rain.keys.size, rain.keys.envelope);
        let of_rain = [
            needs(&["size_mm"], size != RainSize::Natural, "size_distribution = \"fixed\" or \"log_normal\""),
            needs(&["size_spread"], size == RainSize::LogNormal, "size_distribution = \"log_normal\""),
            needs(&["middle_s", "width_s"], envelope == RainEnvelope::Bell, "envelope = \"bell\""),
            needs(&["envelope_keyframes"], envelope == RainEnvelope::Keys, "envelope = \"keys\""),
        ];
        self.report_unmet(table_at(root, &["rain"]), "rain", &of_rain);
        let model = rain.impact.model;
        let of_impact = [
            needs(&["energy_loss"], model == ImpactModel::PaperEnergy, "model = \"paper_energy\""),
            needs(&["restitution"], model == ImpactModel::Momentum, "model = \"momentum\""),
        ];
        self.report_unmet(table_at(root, &["rain", "impact"]), "rain.impact", &of_impact);
        let drop = &rain.drop;
        let of_drop = [
            needs(&["lambda"], drop.shape == DropShape::PaperWedge, "shape = \"paper_wedge\""),
            needs(&["paper_friction_n"], drop.friction == DropFriction::Paper, "friction = \"paper\""),
            needs(&["paper_attraction_n"], drop.merge == DropMerge::Paper, "merge = \"paper\""),
            needs(&["paper_lever_max"], drop.lever == DropLever::Paper, "lever = \"paper\""),
        ];
        self.report_unmet(table_at(root, &["rain", "drop"]), "rain.drop", &of_drop);
    }

    fn ignored_in_flight(&mut self, root: &TomlTable, recipe: &Recipe) {
        let Some(flight) = &recipe.flight else { return };
        let release = flight.keys.release;
        let of_sky = matches!(release, FlightRelease::Sky | FlightRelease::Rain);
        let of_canopy = &["ripening_s", "canopy", "release_rate", "release_speed"];
        let all = [
            needs(&["duration"], release == FlightRelease::Rain, "release = \"rain\""),
            needs(&["band"], of_sky, "release = \"sky\" or \"rain\""),
            needs(of_canopy, release == FlightRelease::Canopy, "release = \"canopy\""),
            needs(&["points"], release == FlightRelease::Points, "release = \"points\""),
            needs(
                &["count"],
                release != FlightRelease::Points,
                "another release: the file of points has its own number",
            ),
            needs(&["size"], !recipe.has_lattice_wind(), "a wind without a lattice, which has a domain of its own"),
            needs(&["humidity"], flight.keys.humidity_map.is_none(), "a flight without `humidity_map`"),
            needs(&["trail_width"], flight.keys.trails > 0.0, "trajectories: trails = 2"),
        ];
        self.report_unmet(table_at(root, &["flight"]), "flight", &all);
    }

    /// Solids, loads of rods, scatters, the picture, attractors and layers.
    fn ignored_in_objects(&mut self, root: &TomlTable, recipe: &Recipe) {
        // A mesh brings its own size and materials; a block or house is described by keys.
        for (i, (table, solid)) in root.tables("solid").into_iter().zip(&recipe.solids).enumerate() {
            let is_mesh = solid.keys.shape == SolidShape::Mesh;
            let all = [
                needs(&["mesh_scale", "mesh_up"], is_mesh, "shape = \"mesh\""),
                needs(&["size"], !is_mesh, "shape = \"block\" or \"house\"; mesh_scale sets the size of a mesh"),
                needs(&["color"], !is_mesh, "shape = \"block\" or \"house\"; a mesh has the materials of its file"),
            ];
            self.report_unmet(Some(table), &format!("solid.{i}"), &all);
        }
        for (i, (rod, keys)) in root.tables("rod").into_iter().zip(&recipe.rods).enumerate() {
            let carried = needs(&["on_at"], keys.on.is_some(), "a rod that carries it: on = \"NAME\"");
            self.report_unmet(Some(rod), &format!("rod.{i}"), &[carried]);
            for (k, (table, load)) in rod.tables("load").into_iter().zip(&keys.loads).enumerate() {
                let mass = needs(&["show", "color"], load.kind == RodLoadKind::Mass, "kind = \"mass\"");
                self.report_unmet(Some(table), &format!("rod.{i}.load.{k}"), &[mass]);
            }
        }
        for (i, (table, scatter)) in root.tables("scatter").into_iter().zip(&recipe.scatters).enumerate() {
            let disc = needs(&["at", "inner", "fade"], scatter.keys.radius.is_some(), "a disc: add radius = 50");
            let is_later = i > 0 || !recipe.places.is_empty();
            let earlier =
                needs(&["clear"], is_later, "earlier plants: a [[place]], or another [[scatter]] before this one");
            self.report_unmet(Some(table), &format!("scatter.{i}"), &[disc, earlier]);
        }
        // The limits of the density estimation have an effect only if the estimation is enabled.
        let is_spread = recipe.picture.spread > 0.0;
        let spread = needs(&["spread_min_px", "spread_curve"], is_spread, "a density estimation: spread_px = 4");
        let alone = needs(
            &["points", "fit", "center", "span", "oversample", "spread_px"],
            recipe.layers.is_empty(),
            "the picture of a table alone: every [[layer]] has points and a place of its own",
        );
        self.report_unmet(table_at(root, &["picture"]), "picture", &[spread, alone]);
        let word = |color_by: ColorBy| [needs(&["prefix"], color_by == ColorBy::Word, "color_by = \"word\"")];
        for cloud in &recipe.clouds {
            let table = table_at(root, &["clouds", cloud.name.as_str()]);
            self.report_unmet(table, &format!("clouds.{}", cloud.name), &word(cloud.keys.color_by));
        }
        for (i, (table, layer)) in root.tables("layer").into_iter().zip(&recipe.layers).enumerate() {
            let (has_table, keys) = (layer.cloud.is_some(), &layer.keys);
            // A layer is a rectangle with a gradient, or an attractor, whose one colour replaces those by position or word.
            let is_by_word = keys.color.is_some() || keys.color_by == ColorBy::Word;
            let all = [
                needs(OF_LAYER_TABLES, has_table, "a coefficient table: ifs = \"FILE.ifs\""),
                needs(&["color2"], !has_table, "a rectangle: leave `ifs` out"),
                needs(
                    &["color_by", "prefix", "colors"],
                    !has_table || keys.color.is_none(),
                    "a layer without `color`, which replaces it",
                ),
                needs(&["prefix"], !has_table || is_by_word, "color_by = \"word\""),
            ];
            self.report_unmet(Some(table), &format!("layer.{i}"), &all);
        }
    }

    fn ignored_in_place(&mut self, table: &TomlTable, path: &str, place: &PlaceRecipe, plant: Option<&PlantRecipe>) {
        let keys = &place.keys;
        let of_species = plant.is_some_and(|p| matches!(p.growth, Growth::Species(_)));
        let is_mesh = plant.is_some_and(|p| matches!(p.growth, Growth::Mesh(..)));
        // Turns of a plant that grows for its place have been reported.
        let is_turned = plant.is_none_or(|p| why_in_place(keys, p).is_none());
        let is_group = keys.count > 1 || !place.line.is_empty();
        // A single copy has a random position only in an area.
        let is_random = is_group || keys.area.is_some();
        let all = [
            needs(&["radius"], is_group, "a group of copies: count = 10"),
            needs(&["spacing", "clear"], is_random, "a group of copies: count = 10"),
            needs(&["clear"], place.line.is_empty() || keys.jitter > 0.0, "copies that leave their line: jitter = 0.5"),
            needs(&["individuals"], is_group, "copies that share them: count = 10"),
            needs(
                &["individuals"],
                !is_group || !self.raining || keys.individuals.is_none_or(|n| n >= keys.count),
                "a scene without [rain]: each copy has drops of its own",
            ),
            // Without the key each copy is an individual, but those of a mesh share one.
            needs(
                &["individuals"],
                !is_group || is_mesh || keys.individuals.is_none_or(|n| n <= keys.count),
                "as many copies to show them: each of these is an individual already",
            ),
            needs(&["seed"], !is_mesh, "a plant that grows: all copies of a mesh are alike"),
            needs(&["lean_to_deg"], keys.lean.abs() > 0.0 || !is_turned, "an inclination: lean_deg = 5"),
            needs(&["together"], of_species || !keys.together, "a plant with `species`, which grows in light"),
        ];
        self.report_unmet(Some(table), path, &all);
        self.report_crowd(table, path, place);
    }

    /// Warns of a spacing that the region of a group cannot hold, however its copies stand.
    fn report_crowd(&mut self, table: &TomlTable, path: &str, place: &PlaceRecipe) {
        let (keys, spacing) = (&place.keys, place.keys.spacing);
        let Some(entry) = table.get("spacing").filter(|_| place.line.is_empty() && keys.count > 1 && spacing > 0.0)
        else {
            return;
        };
        // Discs around the copies, as wide as the spacing, lie within the region widened by half of it and do not overlap.
        let widened = match keys.area {
            Some([width, depth]) => (width + spacing) * (depth + spacing),
            None => PI * (keys.radius + 0.5 * spacing) * (keys.radius + 0.5 * spacing),
        };
        let most = (DENSEST_DISCS * widened / (0.25 * PI * spacing * spacing)).floor().max(1.0);
        if f64::from(keys.count) > most {
            let text = format!("{path}: {} copies cannot keep a spacing of {spacing} m in their region", keys.count);
            let d = Diagnostic::warning("S007", text, entry.key_span, format!("has room for {most} at most"));
            self.report.push(d.help("they stand nearer to each other: lower count or spacing, or enlarge the region"));
        }
    }

    /// Warns of `solids = true` in a scene without any.
    fn report_missing_solids(&mut self, table: &TomlTable, path: &str, plant: &PlantRecipe, recipe: &Recipe) {
        let has_solids = !recipe.solids.is_empty();
        // A tree that grows in light is shaded by the land, too.
        let of_species = match &plant.growth {
            Growth::Species(species) => species.site.solids && recipe.terrain.is_none(),
            _ => false,
        };
        let of_shapes = matches!(&plant.growth, Growth::Shapes(keys) if keys.solids);
        let of_twigs = plant.fill.as_ref().is_some_and(|keys| keys.solids);
        for (name, asks) in [("site", of_species), ("growth", of_shapes), ("fill", of_twigs)] {
            // Only the scene's own key is reported: files of shapes are for scenes with and without solids.
            let solids = needs(&["solids"], has_solids || !asks, "obstacles: add a [[solid]]");
            self.report_unmet(table_at(table, &[name]), &join(path, name), &[solids]);
        }
    }

    fn ignored_in_plant(&mut self, table: &TomlTable, path: &str, plant: &PlantRecipe) {
        // Keys of other sources have been reported of a mesh, most of those of grammars of a species.
        let (of_grammars, of_trees) = match &plant.growth {
            Growth::Mesh(..) | Growth::Species(_) => (OF_NOTATIONS, NONE),
            Growth::Grammar(_) => (NONE, OF_TREES),
            Growth::Ifs(..) => (OF_GRAMMARS, NONE),
            Growth::Shapes(_) => (OF_GRAMMARS, OF_TREES),
        };
        // Surfaces have the unit of the turtle on every plant.
        let is_drawn = !matches!(plant.growth, Growth::Ifs(..) | Growth::Shapes(_));
        let reads_turtle = is_drawn || plant.organs.iter().any(|organ| organ.surface.is_some());
        // A season that the plant cannot have has been reported, and so has all that a mesh does not read.
        let has_told =
            matches!(plant.growth, Growth::Mesh(..)) || plant.keys.season.is_none() && table.get("season").is_some();
        let develops = matches!(plant.growth, Growth::Grammar(_)) && plant.keys.growth_clip.is_some();
        let sources = [
            needs(of_grammars, false, "a grammar: grammar = \"FILE.l\""),
            needs(of_trees, false, "a coefficient table: ifs = \"FILE.ifs\""),
            needs(&["latitude"], is_dated(plant) || has_told, DATED),
            needs(&["clip_steps"], develops, "a grammar that grows over the clip: growth_clip = [0, 1]"),
            needs(&["turtle"], reads_turtle, "a grammar: grammar = \"FILE.l\""),
        ];
        self.report_unmet(Some(table), path, &sources);
        let own_modulus = plant.wood.elasticity.is_none();
        let wood = [
            needs(&["timber"], own_modulus, "wood without `elasticity_gpa`, which replaces it"),
            needs(&["trunk_hz", "hz_scale"], plant.rods.is_none(), SWAYING),
        ];
        self.report_unmet(table_at(table, &["wood"]), &join(path, "wood"), &wood);
        if let Growth::Species(species) = &plant.growth {
            // Dates of seasons follow the latitude of the site, too, where plant and scene give none.
            let has_sun = species.site.direct > 0.0 || is_dated(plant) && plant.keys.latitude.is_none();
            let site = [
                needs(&["latitude"], has_sun, "direct sunlight: direct = 0.4"),
                needs(&["clip_leaves"], species.clip.is_some(), "a tree that grows over the clip: from = 5"),
            ];
            self.report_unmet(table_at(table, &["site"]), &join(path, "site"), &site);
            for (i, (table, cut)) in table.tables("prune").into_iter().zip(&species.prunes).enumerate() {
                // An age with a fraction shows a part of the year that follows the full ones.
                let lives_to_see =
                    format!("a tree that reaches year {}: a greater `age`, or an earlier `year`", cut.year);
                let is_made = f64::from(cut.year) <= species.age.ceil();
                let repeats = cut.every == 0 || cut.until >= cut.year.saturating_add(cut.every);
                let of_cut = [
                    needs(&["keep", "solid"], is_made, &lives_to_see),
                    needs(&["until"], cut.every > 0 || !is_made, "a cut that repeats: every = 1"),
                    needs(&["every"], repeats || !is_made, "a later `until`: the second cut comes after it"),
                ];
                self.report_unmet(Some(table), &format!("{path}.prune.{i}"), &of_cut);
            }
        }
        // Rods in the rain move in its time steps.
        let steps = needs(&["substeps"], !self.raining, "a scene without [rain], where rain.substeps counts");
        self.report_unmet(table_at(table, &["rods"]), &join(path, "rods"), &[steps]);
        if matches!(plant.growth, Growth::Mesh(..)) {
            return;
        }
        self.report_hidden_bark(table, path, plant);
        // A form that does not fit the scene has been reported.
        let skin = table_at(table, &["skin"]);
        let has_form = skin.is_some_and(|t| t.get("form").is_some());
        let segments = needs(&["segment"], has_form || plant.skin.form == SkinForm::Segments, "form = \"segments\"");
        self.report_unmet(skin, &join(path, "skin"), &[segments]);
        if table.get("leaf").is_some() {
            self.ignored_in_organ(table, "leaf", 'l', path, plant);
        }
        if let Some(organs) = table_at(table, &["organs"]) {
            for entry in &organs.entries {
                // Their names are single letters.
                let letter = entry.key.chars().next().unwrap_or_default();
                self.ignored_in_organ(organs, &entry.key, letter, &join(path, "organs"), plant);
            }
        }
    }

    /// Warns of the keys of bark that a plant does not show: hairs of a tuft have a material of their own, and a colour file colours all
    /// that its grammar draws. There is one warning for each of the two tables, with a place for every key.
    fn report_hidden_bark(&mut self, table: &TomlTable, path: &str, plant: &PlantRecipe) {
        let Growth::Grammar(grammar) = &plant.growth else { return };
        let (is_colored, is_tuft) = (plant.companions.colors.is_some(), grammar.is_tuft());
        // Hairs of a larger radius have the material of thick axes, which is the bark.
        let hair_radius =
            plant.turtle.width.map_or(CatkinKeys::defaults().hair_radius, |width| 0.5 * width * plant.turtle.unit);
        let is_thin = is_tuft && hair_radius < f64::from(SHOOT_RADIUS);
        for (name, is_hidden) in [("bark", is_colored || is_thin), ("shoot", is_colored || is_tuft)] {
            let Some(bark) = table_at(table, &[name]).filter(|bark| is_hidden && !bark.entries.is_empty()) else {
                continue;
            };
            let verb = if bark.entries.len() == 1 { "has" } else { "have" };
            let text = format!("{} of {path}.{name} {verb} no effect", bark.names().join(", "));
            let mut d = Diagnostic::warning("S007", text, bark.entries[0].key_span, "has no effect");
            for entry in &bark.entries[1..] {
                d = d.label(entry.key_span, "has no effect");
            }
            self.report.push(d.help(if is_colored {
                "the colour file of the grammar colours all axes: leave these keys out, or change that file"
            } else {
                "the plant is a tuft, whose hairs are white: leave these keys out"
            }));
        }
    }

    /// Warns of the table `key` of an organ, which `above` at `above_path` holds, and of its keys.
    fn ignored_in_organ(&mut self, above: &TomlTable, key: &str, letter: char, above_path: &str, plant: &PlantRecipe) {
        let Some(table) = table_at(above, &[key]) else { return };
        if !draws_organ(plant, letter) {
            let drawing = format!("a grammar that draws it: ~{letter}");
            return self.report_unmet(Some(above), above_path, &[needs(&[key], false, &drawing)]);
        }
        let path = &join(above_path, key);
        // The table was read without errors, so that this reading has none either.
        let keys = OrganKeys::read(Some(table), path, &mut self.report);
        let is_file = keys.mesh.is_some() || keys.surface.is_some();
        let is_blade = !is_file && keys.ifs.is_none();
        let needles = is_blade && keys.blade == BladeOutline::Needles;
        // Teeth of an elliptic blade begin with their number; all other outlines have some, lobes or a notch.
        let is_cut = keys.blade != BladeOutline::Elliptic || keys.lobes.is_some_and(|n| n > 0);
        let is_lobed = matches!(keys.blade, BladeOutline::Lobed | BladeOutline::Palmate | BladeOutline::Petal);
        let has_no_outline = needles || !is_blade;
        let table_file = "a coefficient table: ifs = \"FILE.ifs\"";
        let drawn = "a leaf that osier draws, without mesh and surface";
        let parametric = "a parametric blade, without ifs, mesh and surface";
        let blade = "a blade: needles have none";
        let all = [
            needs(&["system", "anchor", "close_px", "fill", "holes"], keys.ifs.is_some(), table_file),
            needs(&["mesh_scale", "mesh_up"], keys.mesh.is_some(), "a mesh: mesh = \"FILE.obj\""),
            needs(&["needles", "twigs", "twig_length", "twig_angle_deg"], needles, "blade = \"needles\""),
            needs(OF_OUTLINES, is_blade && !needles, if needles { blade } else { parametric }),
            // Of needles it is the angle to their shoot.
            needs(&["vein_angle_deg"], is_blade, parametric),
            needs(OF_DRAWN_LEAVES, !is_file, drawn),
            needs(&["petiole_radius_mm"], keys.mesh.is_none(), "a leaf that osier draws, without mesh"),
            needs(OF_BLADES, !needles, blade),
            needs(&["depth"], has_no_outline || is_cut, "lobes or teeth: another `blade`, or their number in `lobes`"),
            needs(&["minor_teeth"], has_no_outline || is_cut && !is_lobed, "teeth: blade = \"toothed\""),
            needs(&["leaflet_length"], has_no_outline || keys.leaflets > 1, "a compound leaf: leaflets = 7"),
            needs(&["flutter"], plant.rods.is_none(), SWAYING),
        ];
        self.report_unmet(Some(table), path, &all);
    }
}

/// Whether an organ of a letter may be part of a plant.
fn draws_organ(plant: &PlantRecipe, letter: char) -> bool {
    let grows = match &plant.growth {
        // Grammars of other programs name organs in ways of their own.
        Growth::Grammar(grammar) => {
            matches!(grammar.notation(), Notation::Fractint | Notation::LParser | Notation::LPy)
                || grammar.organ_symbols().contains(&letter)
        }
        Growth::Mesh(..) | Growth::Ifs(..) | Growth::Shapes(_) | Growth::Species(_) => letter == 'l',
    };
    grows || plant.fill.is_some() && letter == 'l' || plant.skin.segment.starts_with(letter)
}

/// Whether the season of a plant is a date, or begins or ends at one.
fn is_dated(plant: &PlantRecipe) -> bool {
    plant.keys.season.is_some_and(|season| season.has_date())
}

/// The table at `path` below another one; `None` where there is none.
fn table_at<'t>(root: &'t TomlTable, path: &[&str]) -> Option<&'t TomlTable> {
    path.iter().try_fold(root, |table, name| table.table(name))
}
