//! Scene files: what is understood, and what is said about the rest.
#![allow(clippy::float_cmp, reason = "values that are copied, not computed")]

use osier::Error;
use osier::recipe::{Recipe, Request, options, resolve};

fn request(text: &str, set: &[&str]) -> Request {
    Request {
        name: "Test Scene".into(),
        shown: "scenes/test.toml".into(),
        text: text.into(),
        set: set.iter().map(|s| (*s).to_owned()).collect(),
        ..Request::default()
    }
}

fn read(text: &str, set: &[&str]) -> Result<Recipe, String> {
    match resolve(&request(text, set)) {
        Ok((recipe, _)) => Ok(recipe),
        Err(Error::Input(report)) => Err(report.to_string()),
        Err(e) => panic!("{e}"),
    }
}

const GOOD: &str = r#"
title = "Three oaks"
seed = 7
[frames]
end = 48
fps = 23.976
[plants.oak]
grammar = "oak.l"
set = { HEIGHT = 7 }
[plants.oak.turtle]
angle_deg = 30
tropisms = [{ dir = [0, 1, 0], elasticity = 0.2 }]
[plants.oak.leaf]
blade = "lobed"
size = 0.1
[plants.oak.bark]
depth_mm = 14
[[place]]
plant = "oak"
at = [1, 0, -2]
count = 3
[wind]
beaufort = 4
[output]
formats = ["usd", "glb"]
"#;

#[test]
fn every_value_arrives_in_si_units_and_radians() {
    let r = read(GOOD, &[]).expect("good scene");
    assert_eq!((r.name.as_str(), r.general.title.as_str(), r.general.seed), ("test_scene", "Three oaks", 7));
    assert_eq!((r.clip.start, r.clip.end, r.clip.fps), (1, 48, (24_000, 1001)));
    let oak = &r.plants[0];
    assert_eq!(oak.keys.set, [("HEIGHT".to_owned(), 7.0)]);
    assert!((oak.turtle.angle.unwrap() - std::f64::consts::FRAC_PI_6).abs() < 1e-12);
    assert_eq!(oak.turtle.tropisms[0].elasticity, 0.2);
    assert_eq!((oak.organs[0].letter, oak.organs[0].keys.size), ('l', Some(0.1)));
    assert!((oak.bark.depth.unwrap() - 0.014).abs() < 1e-12);
    assert!((r.wind.speed - 6.688).abs() < 1e-9, "Beaufort 4 is 6.7 m/s");
    assert_eq!((r.places.len(), r.places[0].keys.at), (1, [1.0, 0.0, -2.0]));
    assert!(oak.source.starts_with("preset:"));
}

#[test]
fn overrides_win_and_change_the_hash() {
    let plain = read(GOOD, &[]).expect("good");
    let same = read(&GOOD.replace("seed = 7", "seed = 7 # lucky"), &[]).expect("good");
    assert_eq!(plain.hash, same.hash, "comments are no part of a scene");
    for set in ["seed=8", "place.0.scale=1.01", "plants.oak.set.HEIGHT=7.1", "sun.color=#ffffff", "title=Other"] {
        let other = read(GOOD, &[set]).expect("override");
        assert_ne!(plain.hash, other.hash, "{set}");
    }
    assert_eq!(read(GOOD, &["wind.beaufort=0"]).expect("calm").wind.speed, 0.0);
}

#[test]
fn a_bare_grammar_takes_overrides_for_its_defines_and_its_plant() {
    let mut request = Request::bare("koch", "koch.l");
    request.set = vec!["angle=85".into(), "turtle.unit_m=0.1".into(), "seed=3".into(), "leaf.size=0.2".into()];
    request.steps = Some(2.0);
    let (r, _) = resolve(&request).expect("bare grammar");
    assert_eq!(r.plants[0].keys.set, [("angle".to_owned(), 85.0)]);
    assert_eq!((r.plants[0].turtle.unit, r.plants[0].keys.steps), (0.1, Some(2.0)));
    assert_eq!((r.plants[0].organs[0].keys.size, r.general.seed), (Some(0.2), 3));
}

#[test]
fn a_picture_has_the_bits_of_a_png() {
    let text = "[[layer]]\ncolor = \"#fff\"\n";
    assert_eq!(read(text, &["picture.bits=16"]).expect("16 bits").picture.bits, 16);
    let said = read(text, &["picture.bits=12"]).expect_err("12 bits");
    assert!(said.contains("S004") && said.contains("must be 8 or 16"), "{said}");
}

#[test]
fn time_steps_that_do_not_fit_a_lattice_wind_are_told_with_their_line() {
    let scene = |keys: &str| {
        format!(
            "[frames]\nend = 4\n[plants.oak]\ngrammar = \"oak.l\"\n[wind]\nmodel = \"lattice\"\nspeed = 20\n\
             [wind.lattice]\ncells = [16, 16, 16]\n{keys}\n"
        )
    };
    for (keys, line, text) in [
        ("steps = 1", 10, "wind.lattice.steps is 1, but this wind needs 24 or more per frame"),
        ("smagorinsky = 0", 10, "wind.lattice.smagorinsky is 0, but the relaxation time is only 0.5005 steps"),
        ("smagorinsky = 0\ntau_floor = 0.503", 11, "the relaxation time is only 0.503 steps"),
    ] {
        let said = read(&scene(keys), &[]).expect_err("does not fit");
        assert!(said.contains("S004") && said.contains(text), "{said}");
        assert!(said.contains(&format!("scenes/test.toml:{line}:")), "{said}");
    }
    for keys in ["steps = 24", "smagorinsky = 0\ntau_floor = 0.505", "solver = \"analytic\"\nsteps = 1"] {
        assert!(read(&scene(keys), &[]).is_ok(), "{keys}");
    }
}

#[test]
fn a_picture_has_whole_pixels() {
    let size = |size: &str| read(&format!("{GOOD}[output.pov]\nsize = {size}\n"), &[]);
    assert!(size("[960, 720]").is_ok());
    let said = size("[960.5, 720]").expect_err("half a pixel");
    assert!(said.contains("S004") && said.contains("output.pov.size is 960.5 by 720 pixels"), "{said}");
    assert!(said.contains("scenes/test.toml:27:8") && said.contains("write size = [961, 720]"), "{said}");
}

#[test]
fn an_empty_table_of_plants_is_no_plant() {
    let said = read("[plants]\n", &[]).expect_err("no plants");
    assert!(said.contains("S006") && said.contains("the scene has no plants"), "{said}");
    assert!(read("[plants]\n[terrain]\nsubdivisions = 3\n", &[]).is_ok());
}

#[test]
fn formats_that_write_nothing_are_named() {
    for (key, format) in [("gltf.profiles", "glb"), ("vdb.grids", "vdb"), ("points.tables", "points")] {
        let set = vec![format!("output.{key}=[]")];
        let request = Request { name: "t".into(), text: GOOD.into(), set, ..Request::default() };
        let others = request.set.iter().cloned().chain([format!("output.formats=[\"usd\", \"{format}\"]")]);
        let with_format = Request { set: others.collect(), ..request.clone() };
        let said = |request: &Request| resolve(request).expect("scene").1.to_string();
        let text = format!("output.{key} is empty: no file of \"{format}\" is written");
        assert!(said(&with_format).contains(&text), "{}", said(&with_format));
        assert_eq!(said(&request).contains(&text), format == "glb", "GOOD writes usd and glb");
    }
}

#[test]
fn each_code_names_its_place_and_the_mend() {
    let cases = [
        ("S001", "[plants.oak\ngrammar = \"oak.l\"\n"),
        ("S002", "sed = 3\n[plants.oak]\ngrammer = \"oak.l\"\n[plants.oak.leaf]\nsiez = 1\n[winds]\n"),
        (
            "S003",
            "[frames]\nend = \"48\"\n[plants.oak]\ngrammar = \"oak.l\"\n[plants.oak.leaf]\nblade = \"lobbed\"\ncolor = \"green\"\n[[place]]\nat = [1, 2]\n",
        ),
        ("S004", "[frames]\nstart = 5\nend = 2\n[plants.oak]\ngrammar = \"oak.l\"\n[camera]\nvfov_deg = 200\n"),
        (
            "S005",
            "[plants.oak]\ngrammar = \"../oak.l\"\n[plants.ash]\ngrammar = \"oka.l\"\n[plants.elm]\ngrammar = \"birch.l\"\n[[place]]\nplant = \"eln\"\n",
        ),
        ("S006", "[plants.oak]\nsteps = 3\n"),
        (
            "S004",
            "[terrain]\nsubdivisions = 8\nstride = 3\nexponent = 1.5\n[plants.oak]\ngrammar = \"oak.l\"\n[[scatter]]\nplants = { oak = -1 }\nscale = [2, 1]\n",
        ),
        (
            "S005",
            "[terrain]\n[plants.oak]\ngrammar = \"oak.l\"\n[[scatter]]\nplants = { oka = 1 }\nmask = \"no.png\"\n",
        ),
        ("S006", "[plants.oak]\ngrammar = \"oak.l\"\n[[scatter]]\nspacing = 2\n"),
    ];
    for (code, text) in cases {
        let said = read(text, &[]).expect_err(code);
        assert!(said.contains(code), "{code}:\n{said}");
        let land = if text.contains("[[scatter]]") { "_land" } else { "" };
        insta::assert_snapshot!(format!("{code}{land}"), said);
    }
}

#[test]
fn faults_of_an_override_quote_the_override() {
    let said = read(GOOD, &["wind.sped=3", "camera.vfov_deg=wide"]).expect_err("faults");
    insta::assert_snapshot!("override", said);
}

#[test]
fn a_key_of_another_table_is_told_with_its_place() {
    for (set, told) in [
        ("formats=[\"obj\"]", "did you mean output.formats? known here: "),
        ("plants.oak.angle_deg=30", "plants.NAME.turtle.angle_deg"),
        ("leaf.roughness=1", "did you mean [plants.NAME.leaf] or rain.lying.leaf? known here: "),
        ("plants.oak.bark.fog=1", "did you mean [fog]? known here: "),
        (
            "plants.oak.bark.image=\"b.png\"",
            "a picture of your own is `texture`, its normal map `normal_texture`; known here: ",
        ),
        (
            "plants.oak.leaf.image=\"l.png\"",
            "osier paints blades; pictures of your own come with the mesh of a leaf (`mesh`); ",
        ),
        ("ground.at=[0, 0, 0]", "`osier list options at` shows the tables that have it; known here: "),
    ] {
        let said = read(GOOD, &[set]).expect_err(set);
        assert!(said.contains("S002") && said.contains(told), "{set}: {said}");
    }
    let said = read(GOOD, &["xyzzy=1"]).expect_err("a key that no table has");
    assert!(said.contains("help: known here: "), "{said}");
}

/// The file of a species has keys alone; `habit` and `leaf` are tables of scenes.
#[test]
#[allow(clippy::disallowed_methods, reason = "tests set up the disk themselves")]
fn a_table_in_the_file_of_a_species_is_told_to_stand_in_a_scene() {
    let dir = tempfile::tempdir().expect("dir");
    let file = dir.path().join("elm.species");
    for (text, place) in
        [("[habit]\nvigour = 2\n", "[plants.NAME.habit]"), ("leaf = \"a.obj\"\n", "[plants.NAME.leaf]")]
    {
        std::fs::write(&file, format!("# an elm\n{text}")).expect("file");
        let (_, err) = crate::common::program::ends(1, &["check", crate::common::program::arg(&file)]);
        assert!(
            err.contains(&format!("help: {place} stands in a scene, not in the file of a species; known here: ")),
            "{err}"
        );
    }
}

#[test]
fn a_misspelt_plant_of_an_override_is_told_with_the_plants_of_the_scene() {
    let said = read(GOOD, &["plants.oka.leaf.size=0.1"]).expect_err("no such plant");
    assert!(said.contains("S006") && said.contains("did you mean plants.oak?"), "{said}");
    let said = read(GOOD, &["plants.willow.leaf.size=0.1"]).expect_err("no such plant");
    assert!(said.contains("S006") && said.contains("plants of this scene: oak"), "{said}");
}

#[test]
fn keys_without_their_unit_and_of_other_programs_are_named() {
    for (text, told) in [
        ("[sun]\nelevation = 20\n", "did you mean \"elevation_deg\"?"),
        ("[camera]\nfov = 40\n", "did you mean \"vfov_deg\"?"),
        ("[camera]\nposition = [1, 2, 3]\n", "did you mean \"eye\"?"),
        ("[camera]\nlook_at = [1, 2, 3]\n", "did you mean \"target\"?"),
        ("[[solid]]\nlocation = [1, 2, 3]\n", "did you mean \"at\"?"),
        ("[light]\n", "did you mean \"sun\"?"),
        ("[wind]\nkind = \"lattice\"\n", "did you mean \"model\"?"),
        ("[[solid]]\ntype = \"wall\"\n", "did you mean \"shape\"?"),
        ("[plants.oak]\npreset = \"oak\"\n", "did you mean \"grammar\"?"),
    ] {
        let said = read(&format!("[plants.k]\ngrammar = \"koch.l\"\n{text}"), &[]).expect_err(text);
        assert!(said.contains("S002") && said.contains(told), "{text}: {said}");
    }
}

#[test]
fn values_that_miss_by_little_are_told_what_to_write() {
    for (text, told) in [
        ("[plants.k]\ngrammar = \"koch.l\"\n[ground]\nside = 500\n", "write 256 or 512"),
        ("[plants.k]\nspecies = \"baobab\"\n", "`osier list species`"),
        ("[plants.k]\ngrammar = \"koch.l\"\nbark.color = [255, 128, 0]\n", "are written \"#ff8000\""),
        ("[plants.k]\nshapes = \"vine\"\n", "did you mean the preset \"vine.shapes\"?"),
    ] {
        let said = read(text, &[]).expect_err(text);
        assert!(said.contains(told), "{text}: {said}");
    }
}

/// Each message has the place of the fault and says what to write.
#[test]
fn frequent_slips_are_told_with_place_and_mend() {
    let oak = "[plants.a]\nspecies = \"oak\"\n";
    for (more, place, told) in [
        ("[[plants.a.prune]]\nyear = 3\nsolid = \"wall\"\n", "5:9", "give a [[solid]] this name"),
        ("season = [\"11-01\"]\n", "3:10", "has 1 value, but must have 2"),
        ("twigs = \"oak.species\"\n", "3:9", "has another ending than .shapes"),
        ("[plants.b]\nspecies = \"\"\n", "4:11", "plants.b.species is empty"),
        ("[plants.a.organs.leafy]\nsize = 1\n", "3:18", "not one letter"),
        ("[place]\nplant = \"a\"\n", "3:1", "two pairs of brackets begin one of several"),
        ("[wind]\nspeed = \"fast\"\n", "4:9", "write a number; `osier list options wind.speed` shows"),
        ("species = \"ash\"\n", "3:1", "leave out one of the two"),
    ] {
        let said = read(&format!("{oak}{more}"), &[]).expect_err(more);
        assert!(said.contains(told) && said.contains(&format!("scenes/test.toml:{place}")), "{more}: {said}");
    }
    let said = read("[[plants]]\nspecies = \"oak\"\n", &[]).expect_err("a list");
    assert!(said.contains("write one pair of brackets: [plants], or [plants.NAME]"), "{said}");
    let said = read("[plants.a]\ngrammar = \"oak.l\"\nset = { CROOK = \"x\" }\n", &[]).expect_err("a text");
    assert!(said.contains("write a number without quotes") && said.contains(":3:17"), "{said}");
}

#[test]
fn numbers_with_units_are_told_to_stand_alone() {
    for value in ["10 km/h", "10km/h", "-1.5 m/s", "2,5m"] {
        let said = read(GOOD, &[&format!("wind.speed={value}")]).expect_err(value);
        assert!(said.contains("S003") && said.contains("`osier list options wind.speed`"), "{value}: {said}");
    }
    let said = read(GOOD, &["wind.speed=1e99"]).expect_err("a hurricane");
    assert!(said.contains("wind.speed is 1e99, but must be"), "{said}");
    let said = read(GOOD, &["wind.speed=fast"]).expect_err("a word");
    assert!(said.contains("S003") && !said.contains("write the number alone"), "{said}");
}

#[test]
fn an_override_of_an_element_that_is_not_there_names_the_list() {
    let text = "[plants.oak]\ngrammar = \"oak.l\"\n";
    let said = read(text, &["solid.0.at=[1, 0, 2]"]).expect_err("no solids");
    assert!(said.contains("give the whole list: --set 'solid=[{ KEY = VALUE }]'"), "{said}");
    assert_eq!(read(text, &["solid=[{ at = [1, 0, 2] }]"]).expect("one solid").solids.len(), 1);
    // In the text of a scene the header is at fault.
    let said = read(&format!("{text}[solid]\nat = [1, 0, 2]\n"), &[]).expect_err("a table");
    assert!(said.contains("write [[solid]]") && !said.contains("--set"), "{said}");
}

#[test]
fn hostile_references_are_refused() {
    for name in [
        "/etc/passwd",
        "../oak.l",
        "~/oak.l",
        "file:///oak.l",
        "C:/oak.l",
        "a/../../oak.l",
        "",
        "a//oak.l",
        "..\\oak.l",
        "oak.l\\u0000",
        "%2e%2e/oak.l",
    ] {
        let text = format!("[plants.oak]\ngrammar = \"{}\"\n", name.replace('\\', "\\\\"));
        let said = read(&text, &[]).expect_err(name);
        assert!(said.contains("S005"), "{name}: {said}");
    }
}

#[test]
fn every_default_is_listed_with_its_meaning() {
    for table in options() {
        for key in &table.keys {
            assert!(!key.help.is_empty() && !key.listing.accepts.is_empty(), "{}.{}", table.path, key.name);
        }
    }
}

#[test]
fn rain_is_read_and_its_faults_told() {
    let plant = "[plants.a]\ngrammar = \"rain-twig.l\"\n[[place]]\nplant = \"a\"\n";
    let good = format!("{plant}[rain]\nrate_mm_per_h = 30\n[rain.drop]\ncontact_angle_deg = 62\n");
    let r = read(&good, &[]).expect("rain");
    let rain = r.rain.expect("rain");
    assert!((rain.drop.contact_angle.to_degrees() - 62.0).abs() < 1e-9 && (rain.keys.rate * 3.6e6 - 30.0).abs() < 1e-9);
    let paper = read(&format!("{plant}[rain]\npreset = \"paper\"\n[rain.drop]\nfriction_coefficient = 0.1\n"), &[])
        .expect("paper");
    let paper = paper.rain.expect("rain");
    assert!(
        (paper.keys.gravity - 9.8).abs() < 1e-9
            && (paper.drop.friction_coefficient - 0.1).abs() < 1e-9
            && paper.drop.omega.is_some()
    );
    for (set, code, said) in [
        ("rain.drop.contact_angle_deg=20", "S004", "must rise from receding over contact_angle to advancing"),
        ("rain.drop.contact_angle_deg=nan", "S003", "contact_angle_deg"),
        ("rain.rate_mm_per_h=1e999", "S003", "not finite"),
        ("rain.envelope=keys", "S006", "rising times"),
        ("rain.lying=3", "S003", "[[rain.lying]]"),
        ("rain.splash=0.1", "S002", "has no key \"splash\""),
    ] {
        let Err(e) = read(&good, &[set]) else { panic!("{set} accepted") };
        let text = e.to_string();
        assert!(text.contains(code) && text.contains(said), "{set}: {text}");
    }
    for (rows, code, said) in [
        ("[[]]", "S003", "has 0 numbers, but must have 2"),
        ("[[], [1, 2]]", "S003", "has 0 numbers, but must have 2"),
        ("[[0, 1], [2]]", "S003", "has 1 numbers, but must have 2"),
        ("[[0, 1, 5]]", "S003", "has 3 numbers, but must have 2"),
        ("[[0, 1], [0, 2]]", "S006", "rising times"),
        ("[[0, -1], [1, 2]]", "S004", "is -1, but must be 0 or more"),
    ] {
        let keyframes = format!("rain.envelope_keyframes={rows}");
        let Err(e) = read(&good, &["rain.envelope=keys", keyframes.as_str()]) else { panic!("{rows} accepted") };
        let text = e.to_string();
        assert!(text.contains(code) && text.contains(said), "{rows}: {text}");
    }
    let bare = read("[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\n[rain]\n", &[]).expect_err("nothing to fall on");
    assert!(bare.to_string().contains("needs a plant to fall on"), "{bare}");
}

#[test]
fn rods_are_read_and_their_faults_told() {
    let good = "[[rod]]\nname = \"a\"\npoints = [[0, 0, 0], [0, 1, 0]]\n[[rod]]\non = \"a\"\npoints = [[0, 1, 0], [1, 1, 0]]\n";
    let r = read(good, &["rod.0.radius_mm=[18,12]"]).expect("rods alone are a scene");
    assert_eq!((r.rods.len(), r.rods[1].on), (2, Some(0)));
    assert!((r.rods[0].keys.radius[0] - 0.018).abs() < 1e-12 && (r.rods[0].keys.radius[1] - 0.012).abs() < 1e-12);
    let faults = [
        ("rod.0.points=[[0,0,0]]", "S006", "two points or more"),
        ("rod.1.on=b", "S005", "there is no rod \"b\" above this one"),
        ("rod.0.torsional_stiffness=1e6", "S004", "torsional_stiffness makes the shear modulus"),
        ("rod.0.radius=2", "S002", "has no key \"radius\""),
        ("rod.0.clamp=[{at=2}]", "S004", "must be 0 to 1"),
        ("rod.0.clamp=[{hold=\"guided\",line=[0,0,0]}]", "S004", "has no direction"),
        ("rod.0.load=[{kind=\"force\"}]", "S006", "has no keyframes"),
        ("rod.0.load=[{kind=\"force\",keyframes=[[0,1]]}]", "S003", "must have 4"),
        ("rod.0.load=[{kind=\"mass\",keyframes=[[0,1],[0,2]]}]", "S004", "do not rise"),
        ("rod.0.load=[{kind=\"mass\",keyframes=[[0,-1]]}]", "S004", "a mass below 0"),
    ];
    for (set, code, words) in faults {
        let told = read(good, &[set]).expect_err(set);
        assert!(told.contains(code) && told.contains(words), "{set}: {told}");
    }
    // A value that cannot be read is no missing one.
    for set in ["rod.0.points=abc", "rod.0.load=[{keyframes=\"abc\"}]"] {
        let told = read(good, &[set]).expect_err(set);
        assert!(told.contains("S003") && !told.contains("S006"), "{set}: {told}");
    }
}

/// A value that cannot be read is told once, not as a missing one, too.
#[test]
fn a_value_with_a_fault_is_no_missing_one() {
    let plants = "[frames]\nend = 4\n[plants.oak]\ngrammar = \"oak.l\"\n[plants.ash]\ngrammar = \"oak.l\"\n";
    for (lines, code, words) in [
        ("[[place]]\nplant = 3\n", "S003", "place.0.plant is a whole number, but must be a text"),
        (
            "[rain]\nenvelope = \"keys\"\nenvelope_keyframes = [[0, \"a\"]]\n",
            "S003",
            "rain.envelope_keyframes is a text",
        ),
        (
            "[wind]\nmodel = \"lattice\"\n[wind.lattice]\nprofile = \"table\"\nprofile_table = [[0, 0], [0, 1]]\n",
            "S004",
            "wind.lattice.profile_table: the first number of a pair is not above that of the pair before",
        ),
    ] {
        let said = read(&format!("{plants}{lines}"), &[]).expect_err(lines);
        assert!(said.contains(code) && said.contains(words), "{said}");
        assert!(said.matches("error[").count() == 1, "{said}");
    }
    let rod = "[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\n[[rod.load]]\nkind = 3\nkeyframes = [[0, 0.001]]\n";
    let morph = "[clouds.f]\n[clouds.f.morph]\nkey = [{ ifs = 3, at = 0 }, { ifs = \"fern_bud.ifs.toml\", at = 1 }]\n";
    for text in [rod, morph] {
        let said = read(&format!("[frames]\nend = 48\n{text}"), &[]).expect_err(text);
        assert!(said.contains("S003") && said.matches("error[").count() == 1, "{said}");
    }
    let missing = read(&format!("{plants}[[place]]\n"), &[]).expect_err("no plant");
    assert!(missing.contains("this place names no plant"), "{missing}");
}

#[test]
fn a_key_of_an_earlier_version_is_named_by_its_present_name() {
    let rod = "[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\n";
    for (lines, help) in [
        ("zeta = 0.1\n", "`zeta` is now `damping_ratio`"),
        ("E_GPa = 3\n", "`E_GPa` is now `elasticity_gpa`"),
        ("[maps]\nhero_max = 2\n", "`hero_max` is now `max_mapped_leaves`"),
        ("[sun]\nazimuth_deg = 75\n", "`azimuth_deg` is now `direction_deg`; subtract 90"),
    ] {
        let Err(said) = read(&format!("{rod}{lines}"), &[]) else { panic!("{lines} is accepted") };
        assert!(said.contains("error[S002]") && said.contains(help), "{said}");
    }
}

#[test]
fn a_value_without_a_define_of_its_name_is_an_error_where_the_scene_has_it() {
    let plant = "[plants.a]\ngrammar = \"rain-twig.l\"\n";
    let Err(said) = read(&format!("{plant}set = {{ NOPE = 3 }}\n"), &[]) else { panic!("NOPE is accepted") };
    assert!(said.contains("no #define \"NOPE\"") && said.contains("scenes/test.toml:3:9"), "{said}");
    // The angle of turns is no #define.
    let Err(said) = read(plant, &["plants.a.set.angle=30"]) else { panic!("--set angle is accepted") };
    assert!(said.contains("error[L002]") && said.contains("--set angle_deg=25"), "{said}");
    let Err(said) = read(plant, &["plants.a.set.NOPE=3"]) else { panic!("--set NOPE is accepted") };
    assert!(said.contains("error[L002]") && said.contains("plants.a.set.NOPE=3"), "{said}");
}

/// Messages of the warnings S007 about a scene.
fn without_effect(text: &str) -> Vec<String> {
    match resolve(&request(text, &[])) {
        Ok((_, report)) => report.diagnostics.into_iter().filter(|d| d.code == "S007").map(|d| d.message).collect(),
        Err(e) => panic!("{text}: {e}"),
    }
}

#[test]
fn a_key_that_needs_another_value_is_told_without_it() {
    let plant = "[frames]\nend = 48\n[plants.a]\ngrammar = \"rain-twig.l\"\n";
    // Lines without the value that the key needs, the key, and lines with it.
    let cases = [
        ("[fog]\nheight = 30\n", "fog.height", "[fog]\nheight = 30\nvisibility = 400\n"),
        ("[sway]\npaper_recoil = 0.5\n", "sway.paper_recoil", "[sway]\nmodel = \"paper\"\npaper_recoil = 0.5\n"),
        ("[wind]\nmodel = \"uniform\"\ngust = 0.9\n", "wind.gust", "[wind]\nmodel = \"perlin\"\ngust = 0.9\n"),
        ("[sway]\nmodel = \"paper\"\nlean = 2\n", "sway.lean", "[sway]\nlean = 2\n"),
        ("[rain]\n[sway]\nmodel = \"paper\"\nwhip = 2\n", "sway.whip", "[rain]\n[sway]\nwhip = 2\n"),
        ("[sway]\nstart = \"rest\"\n", "sway.start", "[sway]\nrepeat = false\nstart = \"rest\"\n"),
        (
            "[[wind.add]]\nmodel = \"perlin\"\neddy_size = 2\n",
            "wind.add.0.eddy_size",
            "[[wind.add]]\nmodel = \"gust\"\neddy_size = 2\n",
        ),
        ("[rain]\nsize_mm = 3\n", "rain.size_mm", "[rain]\nsize_distribution = \"fixed\"\nsize_mm = 3\n"),
        ("[rain]\nmiddle_s = 3\n", "rain.middle_s", "[rain]\npreset = \"paper\"\nmiddle_s = 3\n"),
        (
            "[rain]\npreset = \"paper\"\n[rain.impact]\nrestitution = 0.5\n",
            "rain.impact.restitution",
            "[rain.impact]\nrestitution = 0.5\n",
        ),
        ("[rain.drop]\nlambda = 1.2\n", "rain.drop.lambda", "[rain.drop]\nshape = \"paper_wedge\"\nlambda = 1.2\n"),
        ("[flight]\nduration = 3\n", "flight.duration", "[flight]\nrelease = \"rain\"\nduration = 3\n"),
        (
            "[plants.a.leaf]\nneedles = 30\n",
            "plants.a.leaf.needles",
            "[plants.a.leaf]\nblade = \"needles\"\nneedles = 30\n",
        ),
        (
            "[plants.a.leaf]\nifs = \"fern_leaf.ifs\"\nlobes = 3\n",
            "plants.a.leaf.lobes",
            "[plants.a.leaf]\nblade = \"lobed\"\nlobes = 3\n",
        ),
        (
            "[plants.a.leaf]\nblade = \"needles\"\nlobes = 3\n",
            "plants.a.leaf.lobes",
            "[plants.a.leaf]\nblade = \"lobed\"\nlobes = 3\n",
        ),
        (
            "[plants.a.leaf]\nifs = \"fern_leaf.ifs\"\nvein_angle_deg = 40\n",
            "plants.a.leaf.vein_angle_deg",
            "[plants.a.leaf]\nblade = \"needles\"\nvein_angle_deg = 40\n",
        ),
        (
            "[plants.a.leaf]\nblade = \"needles\"\ncolor2 = \"#406030\"\n",
            "plants.a.leaf.color2",
            "[plants.a.leaf]\ncolor2 = \"#406030\"\n",
        ),
        (
            "[plants.a.leaf]\nblade = \"lobed\"\nminor_teeth = 2\n",
            "plants.a.leaf.minor_teeth",
            "[plants.a.leaf]\nblade = \"toothed\"\nminor_teeth = 2\n",
        ),
        ("[plants.a.organs.Q]\nsize = 2\n", "plants.a.organs.Q", "[plants.a.organs.l]\nsize = 2\n"),
        ("[plants.a.leaf]\ndepth = 0.3\n", "plants.a.leaf.depth", "[plants.a.leaf]\nlobes = 9\ndepth = 0.3\n"),
        (
            "[plants.a.rods]\n[plants.a.wood]\nhz_scale = 2\n",
            "plants.a.wood.hz_scale",
            "[plants.a.wood]\nhz_scale = 2\n",
        ),
        ("[plants.a.rods]\n[plants.a.leaf]\nflutter = 2\n", "plants.a.leaf.flutter", "[plants.a.leaf]\nflutter = 2\n"),
        (
            "[plants.a.wood]\ntimber = \"willow\"\nelasticity_gpa = 5\n",
            "plants.a.wood.timber",
            "[plants.a.wood]\ntimber = \"willow\"\n",
        ),
        ("[rain]\n[plants.a.rods]\nsubsteps = 9\n", "plants.a.rods.substeps", "[plants.a.rods]\nsubsteps = 9\n"),
        ("[plants.a.tree]\nheight = 3\n", "plants.a.tree", ""),
        (
            "[plants.a.skin]\nsegment = \"l\"\n",
            "plants.a.skin.segment",
            "[plants.a.skin]\nform = \"segments\"\nsegment = \"l\"\n",
        ),
        ("[[place]]\nradius = 3\n", "place.0.radius", "[[place]]\nradius = 3\ncount = 2\n"),
        ("[[place]]\ntogether = true\n", "place.0.together", "[[place]]\ntogether = false\n"),
        (
            "[rain]\n[[place]]\ncount = 3\nindividuals = 2\n",
            "place.0.individuals",
            "[[place]]\ncount = 3\nindividuals = 2\n",
        ),
        ("[[place]]\ncount = 3\nindividuals = 5\n", "place.0.individuals", "[[place]]\ncount = 3\nindividuals = 3\n"),
        (
            "[plants.m]\nmesh = \"young-tree.obj\"\n[[place]]\nplant = \"m\"\nseed = 5\n",
            "place.0.seed",
            "[plants.m]\nmesh = \"young-tree.obj\"\n[[place]]\nplant = \"a\"\nseed = 5\n",
        ),
        (
            "[[place]]\nring = 9\ncount = 3\nclear = 2\n",
            "place.0.clear",
            "[[place]]\nring = 9\ncount = 3\nclear = 2\njitter = 1\n",
        ),
        ("[terrain]\nsubdivisions = 3\n[ground]\nrelief = 2\n", "ground", "[ground]\nrelief = 2\n"),
        ("[ground]\nhaze = 0.3\n", "ground.haze", "[ground]\nhaze = 0.3\nsize = 30\ntile = 30\n"),
        (
            "[terrain]\n[[scatter]]\nplants = { a = 1 }\ninner = 9\n",
            "scatter.0.inner",
            "[terrain]\n[[scatter]]\nplants = { a = 1 }\ninner = 9\nradius = 50\n",
        ),
        (
            "[[solid]]\nshape = \"mesh\"\nmesh = \"young-tree.obj\"\ncolor = \"#406030\"\n",
            "solid.0.color",
            "[[solid]]\ncolor = \"#406030\"\n",
        ),
        (
            "[[layer]]\ncolor = \"#ffffff\"\npoints = 900\n",
            "layer.0.points",
            "[[layer]]\nifs = \"fern_leaf.ifs\"\npoints = 900\n",
        ),
        (
            "[[layer]]\ncolor = \"#ffffff\"\ncolor_by = \"word\"\n",
            "layer.0.color_by",
            "[[layer]]\nifs = \"fern_leaf.ifs\"\ncolor_by = \"word\"\nprefix = 3\n",
        ),
        (
            "[[layer]]\nifs = \"fern_leaf.ifs\"\ncolor2 = \"#ffffff\"\n",
            "layer.0.color2",
            "[[layer]]\ncolor = \"#406030\"\ncolor2 = \"#ffffff\"\n",
        ),
        (
            "[[layer]]\nifs = \"fern_leaf.ifs\"\ncolor = \"#406030\"\nprefix = 3\n",
            "layer.0.prefix",
            "[[layer]]\nifs = \"fern_leaf.ifs\"\ncolor = \"#406030\"\n",
        ),
        (
            "[picture]\nspan = 2\n[[layer]]\nifs = \"fern_leaf.ifs\"\n",
            "picture.span",
            "[picture]\ngamma = 2\n[[layer]]\nifs = \"fern_leaf.ifs\"\n",
        ),
        ("[picture]\nspread_min_px = 2\n", "picture.spread_min_px", "[picture]\nspread_px = 4\nspread_min_px = 2\n"),
        (
            "[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\non_at = 0.5\n",
            "rod.0.on_at",
            "[[rod]]\nname = \"b\"\npoints = [[0, 0, 0], [0, 1, 0]]\n[[rod]]\non = \"b\"\non_at = 0.5\npoints = [[0, 0.5, 0], [1, 1, 0]]\n",
        ),
        (
            "[terrain]\nsubdivisions = 3\n[[scatter]]\nplants = { a = 1 }\nclear = 3\n",
            "scatter.0.clear",
            "[terrain]\nsubdivisions = 3\n[[place]]\nplant = \"a\"\n[[scatter]]\nplants = { a = 1 }\nclear = 3\n",
        ),
        ("[maps]\nresolution = 64\n", "maps", "[rain]\n[maps]\nresolution = 64\n"),
        ("[camera]\neye = [1, 2, 3]\ndistance = 2\n", "camera.distance", "[camera]\ndistance = 2\n"),
    ];
    for (without, key, with) in cases {
        assert_eq!(without_effect(&format!("{plant}{without}")), [format!("{key} has no effect")], "{without}");
        assert_eq!(without_effect(&format!("{plant}{with}")), Vec::<String>::new(), "{with}");
    }
    let stiff = "[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\ntorsional_stiffness = 0.06\n";
    assert!(without_effect(stiff).is_empty());
    assert_eq!(without_effect(&format!("{stiff}shear_ratio = 0.1\n")), ["torsional_stiffness replaces shear_ratio"]);
    let counted = format!("{plant}[output]\nformats = [\"usd\", \"csv\"]\n");
    let told = without_effect(&counted);
    assert!(matches!(&told[..], [one] if one.contains("neither rain nor catkins to count")), "{told:?}");
    assert!(without_effect(&format!("{counted}[rain]\n")).is_empty());
    // Of 50 discs of 1 m 44 at most lie in a circle of 3.5 m.
    let crowd =
        |spacing: f64| without_effect(&format!("{plant}[[place]]\ncount = 50\nradius = 3\nspacing = {spacing}\n"));
    let told = crowd(1.0);
    assert!(matches!(&told[..], [one] if one.contains("50 copies cannot keep a spacing of 1 m")), "{told:?}");
    assert!(crowd(0.5).is_empty());
    let still = "[plants.a]\ngrammar = \"rain-twig.l\"\n[wind]\nspeed = 3\n";
    assert_eq!(without_effect(still), ["wind has no effect"]);
    assert!(without_effect(&format!("{still}[frames]\nend = 2\n")).is_empty());
    // Leaves of a grammar that draws none; twigs added to it bear them.
    let bare = "[plants.a]\ngrammar = \"koch.l\"\n[plants.a.leaf]\nlobes = 3\nneedles = 9\n";
    assert_eq!(without_effect(bare), ["plants.a.leaf has no effect"]);
    let twigs = "[plants.a]\ngrammar = \"koch.l\"\ntwigs = \"twigs.shapes\"\n[plants.a.leaf]\nsize = 0.1\n";
    assert!(without_effect(twigs).is_empty());
    let site = "[plants.a]\nspecies = \"hazel\"\nage = 2\n[plants.a.site]\nlatitude = 20\n";
    assert_eq!(without_effect(site), ["plants.a.site.latitude has no effect"]);
    assert!(without_effect(&format!("{site}direct = 0.4\n")).is_empty());
    let solid = "[[solid]]\nsize = [1, 1, 1]\n";
    let bush = "[plants.a]\nshapes = \"bush.shapes\"\n[plants.a.growth]\nsolids = true\n";
    for (text, table) in [(site.replace("latitude = 20", "solids = true").as_str(), "site"), (bush, "growth")] {
        assert_eq!(without_effect(text), [format!("plants.a.{table}.solids has no effect")]);
        assert!(without_effect(&format!("{text}{solid}")).is_empty(), "{table}");
    }
    // Latitudes without a date, in the scene, in a plant and beside another one.
    let hazel = "[plants.a]\nspecies = \"hazel\"\nage = 2\n";
    assert_eq!(without_effect(&format!("season = 0.8\nlatitude = 20\n{hazel}")), ["latitude has no effect"]);
    assert_eq!(without_effect(&format!("{hazel}season = 0.8\nlatitude = 20\n")), ["plants.a.latitude has no effect"]);
    let at = |season: &str| site.replace("[plants.a.site]", &format!("season = {season}\n[plants.a.site]"));
    assert_eq!(without_effect(&at("0.8")), ["plants.a.site.latitude has no effect"]);
    assert!(without_effect(&format!("latitude = 20\n{hazel}season = \"10-20\"\n")).is_empty());
    assert!(without_effect(&at("\"10-20\"")).is_empty());
    // Cuts that are never made, and repetitions that never come.
    let hedge = |age: f64, cut: &str| {
        let box_of = "keep = [[-1, 0, -1], [1, 1, 1]]";
        without_effect(&format!("[plants.a]\nspecies = \"hazel\"\nage = {age}\n[[plants.a.prune]]\n{box_of}\n{cut}\n"))
    };
    assert_eq!(hedge(3.0, "year = 4"), ["plants.a.prune.0.keep has no effect"]);
    assert_eq!(hedge(3.5, "year = 4"), [""; 0]);
    assert_eq!(hedge(9.0, ""), ["plants.a.prune.0.keep has no effect"], "the first cut is made in year 10");
    assert_eq!(hedge(9.0, "year = 4\nuntil = 8"), ["plants.a.prune.0.until has no effect"]);
    assert_eq!(hedge(9.0, "year = 4\nevery = 3\nuntil = 6"), ["plants.a.prune.0.every has no effect"]);
    assert_eq!(hedge(9.0, "year = 4\nevery = 3\nuntil = 7"), [""; 0]);
    let empty = "[plants.a]\ngrammar = \"rain-twig.l\"\n[output]\nformats = []\n";
    assert_eq!(without_effect(empty), ["output.formats is empty: a bake writes nothing of the scene"]);
    let nowhere = "place = []\n[plants.a]\ngrammar = \"rain-twig.l\"\n";
    assert_eq!(without_effect(nowhere), ["`place` is empty: the scene shows none of its plants"]);
    let scattered = "[terrain]\n[[scatter]]\nplants = { a = 1 }\n";
    assert!(without_effect(&format!("{nowhere}{scattered}")).is_empty());
    // A tree that grows for its place is neither turned nor inclined, which is told once.
    let together = "[plants.a]\nspecies = \"hazel\"\nage = 2\n[[place]]\ntogether = true\n";
    assert_eq!(without_effect(&format!("{together}lean_to_deg = 30\n")), ["place.0.lean_to_deg has no effect"]);
    assert!(without_effect(together).is_empty());
    let shapes = "[plants.a]\nshapes = \"bush.shapes\"\nsteps = 3\n[plants.a.turtle]\nunit_m = 2\n";
    assert_eq!(without_effect(shapes), ["plants.a.steps has no effect", "plants.a.turtle has no effect"]);
}

/// Leaves that are merged into one mesh are no targets of drops, which is told; plants on rods keep their leaves apart.
#[test]
fn rain_that_falls_through_merged_leaves_is_told() {
    let rain = "[frames]\nend = 48\n[rain]\n[plants.a]\ngrammar = \"rain-twig.l\"\n";
    for motion in ["game", "static"] {
        let told =
            format!("rain falls through the leaves of plants.a: motion = \"{motion}\" merges them into one mesh");
        assert_eq!(without_effect(&format!("{rain}motion = \"{motion}\"\n")), [told]);
        let dry = "[frames]\nend = 48\n[plants.a]\ngrammar = \"rain-twig.l\"\n";
        assert!(without_effect(&format!("{dry}motion = \"{motion}\"\n")).is_empty());
        assert!(without_effect(&format!("{rain}motion = \"{motion}\"\n[plants.a.rods]\n")).is_empty());
        // No drop falls in a scene that is only wet.
        let wet = rain.replace("[rain]\n", "[rain]\nfalls = false\n[rain.wet]\nfilm = 0.5\n");
        assert!(without_effect(&format!("{wet}motion = \"{motion}\"\n")).is_empty());
    }
    for motion in ["skin", "cache", "still"] {
        assert!(without_effect(&format!("{rain}motion = \"{motion}\"\n")).is_empty(), "{motion}");
    }
}

#[test]
fn weights_that_draw_nothing_and_a_camera_without_a_direction_are_refused() {
    let plant = "[plants.a]\ngrammar = \"rain-twig.l\"\n";
    for (lines, told) in [
        ("[flight]\nforms = { v0 = 0 }\n", "every weight of flight.forms is 0"),
        ("[flight]\nrelease = \"canopy\"\ncanopy = { a = 0 }\n", "every weight of flight.canopy is 0"),
        ("[terrain]\n[[scatter]]\nplants = { a = 0 }\n", "is 0"),
        ("[camera]\neye = [1, 2, 3]\ntarget = [1, 2, 3]\n", "camera.target is the position of the camera"),
    ] {
        let Err(said) = read(&format!("{plant}{lines}"), &[]) else { panic!("{lines} is accepted") };
        assert!(said.contains("error[S004]") && said.contains(told), "{said}");
    }
    read(&format!("{plant}[flight]\nforms = {{ v0 = 0, v3 = 1 }}\n"), &[]).expect("one form is drawn");
}
