//! The documents say what the program says. `OSIER_BLESS=1` rewrites the tables of codes and limits, and still fails.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests read the repository")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use osier::diagnostic::{Diagnostic, Severity, Sources, codes::CODES};
use osier::grammar::{self, DeriveOptions, Grammar};
use osier::limits::{LIMITS, Limits, grouped};
use osier::recipe::{Library, Request, resolve};

#[path = "it/common/synthetic.rs"]
mod synthetic;

/// Whether a document differs from what it must be; with `OSIER_BLESS` it is then written.
fn differs(name: &str, expected: &str) -> bool {
    let path = root().join("docs").join(name);
    let differs = std::fs::read_to_string(&path).unwrap_or_default() != expected;
    if differs && std::env::var("OSIER_BLESS").is_ok() {
        std::fs::write(&path, expected).expect("write");
    }
    differs
}

fn held(name: &str, expected: &str) {
    assert!(
        !differs(name, expected),
        "docs/{name} differs from the table in the source; OSIER_BLESS=1 cargo test --test docs"
    );
}

#[test]
fn codes() {
    let mut text = String::from(
        "# Diagnostic codes\n\nEvery error and warning has a code whose meaning never changes. L: grammars, I: coefficient tables, S: scenes, \
         P: pictures, X: files read and written.\nA command reports all errors of a file before it ends with exit code 1. With \
         `--strict`, warnings end it with exit code 3.\n\n| code | severity | meaning |\n|---|---|---|\n",
    );
    for c in CODES {
        let kind = if c.severity == Severity::Error { "error" } else { "warning" };
        text.push_str(&format!("| {} | {kind} | {} |\n", c.code, c.summary));
    }
    held("codes.md", &text);
}

#[test]
fn codes_are_sorted_and_unique() {
    assert!(CODES.windows(2).all(|w| w[0].code < w[1].code));
}

#[test]
fn limits() {
    let mut text = String::from(
        "# Limits\n\nLimits bound the memory, time and disk space of one command. `--max-NAME VALUE` sets a limit (the suffixes k, M and \
         G stand for 1e3, 1e6 and 1e9; `none` removes it),\nas does the environment variable `OSIER_MAX=NAME=VALUE,...`. \
         Scene files cannot set limits.\nA command that would exceed a limit ends with an error that names the flag, before the \
         memory is allocated.\n\n| name | default | what it limits |\n|---|---|---|\n",
    );
    for l in LIMITS {
        text.push_str(&format!("| {} | {} | {} |\n", l.name, grouped(l.default), l.counts));
    }
    held("limits.md", &text);
}

/// The table of docs/formats.md is that of the registry of formats.
#[test]
fn formats() {
    let mut table = String::from("| format | what a bake writes | single files |\n|---|---|---|\n");
    for f in osier::export::registry::FORMATS {
        let endings: Vec<String> = f.endings.iter().map(|(e, _)| format!("`.{e}`")).collect();
        let files = if endings.is_empty() { "-".to_owned() } else { endings.join(" ") };
        table.push_str(&format!("| `{}` | {} | {files} |\n", f.word, f.about));
    }
    let text = std::fs::read_to_string(root().join("docs/formats.md")).expect("formats.md");
    assert!(text.contains(&table), "docs/formats.md lacks the table of the registry:\n{table}");
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A section of `docs/gallery/species.md`.
struct SpeciesSection {
    /// Name of the species' file, as its picture has it.
    name: String,
    /// The line of the picture.
    picture: String,
    /// Preset of the scene, and the ages in a row.
    scene: String,
    ages: String,
    /// What the crown looks like.
    words: String,
}

/// The sections of `docs/gallery/species.md`: a picture, a line of figures that begins with the command, and a paragraph.
fn species_sections() -> Vec<SpeciesSection> {
    let text = std::fs::read_to_string(root().join("docs/gallery/species.md")).expect("species.md");
    let between = |text: &str, begin: &str, end: &str| {
        let (_, rest) = text.split_once(begin).unwrap_or_else(|| panic!("{begin} is missing: {text}"));
        rest.split(end).next().unwrap_or_default().trim().to_owned()
    };
    let section = |section: &str| {
        let paragraphs: Vec<&str> = section.split("\n\n").map(str::trim).collect();
        let [_, picture, figures, words] = paragraphs[..] else { panic!("not four paragraphs: {section}") };
        SpeciesSection {
            name: between(picture, "](species-", ".jpg)"),
            picture: picture.replace("](", "](../gallery/"),
            scene: between(figures, "`osier preview ", "`"),
            ages: between(figures, "· ages ", "·").replace(' ', ""),
            words: words.to_owned(),
        }
    };
    text.split("\n## ").skip(1).map(section).collect()
}

/// The keys of a species' file as `osier list options --json` has them: path below the plant, default, unit and help.
fn habit_keys() -> Vec<[String; 4]> {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_osier"))
        .args(["list", "options", "--json"])
        .output()
        .expect("osier runs");
    let keys: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).expect("JSON");
    let row = |key: &serde_json::Value| {
        let [path, default, unit, help] =
            ["path", "default_text", "unit", "help"].map(|name| key[name].as_str().unwrap_or_default());
        let path = path.strip_prefix("plants.NAME.")?;
        let own = path.starts_with("habit.") || path.starts_with("site.") || path.starts_with("stand.");
        own.then(|| {
            [path.to_owned(), default.to_owned(), unit.replace("m2", "m²").replace("m3", "m³"), help.to_owned()]
        })
    };
    keys.iter().filter_map(row).collect()
}

/// The page of a species: picture, what it measures, commands, the tables of its scene and the values of its habit.
fn species_page(species: &SpeciesSection, keys: &[[String; 4]]) -> String {
    let SpeciesSection { name, picture, scene, ages, words } = species;
    let preset = |name: String| {
        let found = osier::presets::find(&name);
        found.unwrap_or_else(|| panic!("no preset {name}")).text
    };
    let (habit, scene_text) = (preset(format!("{name}.species")), preset(format!("{scene}.toml")));
    let mut remarks = habit.lines().map_while(|line| line.strip_prefix("# "));
    let (title, about) = remarks.next().and_then(|line| line.split_once(": ")).expect("its first line");
    let measured = remarks.next().expect("its second line").replace("m2", "m²");
    let (start, end) = (scene_text.find("[plants.").expect("a plant"), scene_text.find("[[place]]").expect("a place"));
    let plant = scene_text[start..].strip_prefix("[plants.").and_then(|t| t.split(']').next()).expect("a name");
    let mut text = format!(
        "# {title}\n\nA species that grows year by year ([growth.md](../growth.md); [all nineteen](../gallery/species.md)): {about}\n\n\
         {picture}\n\n{words}\n\n{measured}\n\n    osier preview {scene}\n    \
         osier preview {scene} --sweep plants.{plant}.age={ages}\n    osier preview {scene} --seeds 0-3\n    \
         osier bake {scene}\n    osier grow {name}.species -o {name}.glb\n\n## In a scene\n\n\
         The plant of the preset `{scene}`:\n\n```toml\n{}\n```\n\n## Habit\n\n\
         What `{name}.species` sets. `[plants.{plant}.habit]` in a scene lays other values over them, \
         `[plants.{plant}.stand]` over those of `stand`;\n`osier list options habit` tells the ranges. Lists have one number for each order of axes, from the trunk on.\n\n\
         | key | value | default | unit | what it is |\n|---|---|---|---|---|\n",
        scene_text[start..end].trim_end()
    );
    let mut table = "habit".to_owned();
    for line in habit.lines().filter_map(|line| line.split('#').next()) {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.split(']').next()) {
            name.clone_into(&mut table);
        }
        let Some((key, value)) = line.split_once('=') else { continue };
        let path = format!("{table}.{}", key.trim());
        let found = keys.iter().find(|row| row[0] == path);
        let [_, default, unit, help] = found.unwrap_or_else(|| panic!("{name}.species: no key {path}"));
        let shown = path.trim_start_matches("habit.");
        text.push_str(&format!("| `{shown}` | {} | {default} | {unit} | {help} |\n", value.trim()));
    }
    text
}

/// Each species has a page, made from its file, its scene and its section of the gallery.
#[test]
fn species_pages() {
    let (sections, keys) = (species_sections(), habit_keys());
    let files = osier::presets::PRESETS.iter().filter_map(|p| p.name.strip_suffix(".species"));
    let mut named: Vec<&str> = sections.iter().map(|s| s.name.as_str()).collect();
    named.sort_unstable();
    assert_eq!(files.collect::<Vec<_>>(), named, "docs/gallery/species.md has a section for each species");
    let page = |name: &str| format!("species/{name}.md");
    let stale = sections.iter().filter(|species| differs(&page(&species.name), &species_page(species, &keys)));
    let stale: Vec<&String> = stale.map(|species| &species.name).collect();
    assert!(
        stale.is_empty(),
        "docs/species: {stale:?} differ from their sources; OSIER_BLESS=1 cargo test --test docs"
    );
}

/// Name and text of every document.
fn documents() -> Vec<(String, String)> {
    let mut paths: Vec<PathBuf> = Vec::new();
    for folder in ["", "docs", "docs/gallery", "docs/species"].map(|folder| root().join(folder)) {
        let entries = std::fs::read_dir(folder).expect("folder").map(|e| e.expect("entry").path());
        paths.extend(entries.filter(|p| p.extension().is_some_and(|e| e == "md")));
    }
    paths.sort();
    let name = |p: &Path| p.strip_prefix(root()).expect("inside").to_string_lossy().into_owned();
    paths.iter().map(|p| (name(p), std::fs::read_to_string(p).expect("text"))).collect()
}

/// A fenced block.
struct Block {
    /// Document and line.
    place: String,
    /// The word behind the fence.
    tag: String,
    body: String,
}

fn blocks() -> Vec<Block> {
    let mut out: Vec<Block> = Vec::new();
    for (name, text) in documents() {
        let mut open = false;
        for (i, line) in text.lines().enumerate() {
            match line.strip_prefix("```") {
                Some(tag) if !open => {
                    let place = format!("{name}:{}", i + 1);
                    out.push(Block { place, tag: tag.to_owned(), body: String::new() });
                    open = true;
                }
                Some(_) => open = false,
                None if open => {
                    let block = out.last_mut().expect("open");
                    block.body.push_str(line);
                    block.body.push('\n');
                }
                None => {}
            }
        }
        assert!(!open, "{name}: a fence is never closed");
    }
    out
}

fn read(text: &str) -> osier::Result<(Grammar, Vec<Diagnostic>)> {
    let mut sources = Sources::default();
    let mut includes = |r: &str, _: &str| Err(osier::Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let defines = BTreeMap::new();
    let source = grammar::GrammarSource {
        name: "mine.l",
        bytes: text.as_bytes(),
        includes: &mut includes,
        defines: &defines,
        functions: Default::default(),
    };
    grammar::parse(&mut sources, source, &Limits::default())
}

/// Bare productions as a grammar of their own.
fn whole(body: &str) -> String {
    if body.contains("endlsystem") {
        return body.to_owned();
    }
    format!("Lsystem: snippet\nSeed: 1\nDerivation length: 1\nAxiom: A\n{body}endlsystem\n")
}

fn final_string(grammar: &Grammar) -> String {
    let options = DeriveOptions { seed: 1, ..DeriveOptions::default() };
    // The turtle answers the queries of a grammar.
    let turtle = osier::grow::turtle::TurtleOptions::default();
    let limits = Limits::default();
    let derived = osier::grow::turtle::derive_text(grammar, &options, &turtle, &limits).expect("derives");
    derived.into_text(grammar, &limits).expect("a text")
}

#[test]
fn grammar_snippets_are_read_and_derive_to_what_is_said() {
    let mut last: Option<Grammar> = None;
    let mut seen = 0;
    for block in blocks() {
        match block.tag.as_str() {
            "lsystem" => {
                let (grammar, warnings) = read(&whole(&block.body)).unwrap_or_else(|e| panic!("{}\n{e}", block.place));
                let codes: Vec<&str> = warnings.iter().map(|d| d.code).collect();
                let complete = block.body.contains("endlsystem");
                assert!(!complete || codes.is_empty(), "{}: {codes:?}", block.place);
                last = Some(grammar);
                seen += 1;
            }
            "string" => {
                let grammar = last.as_ref().expect("a grammar stands before its string");
                assert_eq!(final_string(grammar), block.body.trim(), "{}", block.place);
            }
            "lsystem wrong" => last = None,
            _ => {}
        }
    }
    assert!(seen > 4);
}

#[test]
fn complaints_read_as_shown() {
    let all = blocks();
    let mut seen = 0;
    for pair in all.windows(2).filter(|p| p[0].tag == "lsystem wrong") {
        let report = read(&pair[0].body).expect_err(&pair[0].place).to_string();
        assert_eq!(report.trim(), pair[1].body.trim(), "{}", pair[1].place);
        seen += 1;
    }
    assert!(seen > 0);
}

#[test]
fn listed_functions_exist() {
    let text = std::fs::read_to_string(root().join("docs/grammars.md")).expect("text");
    let rows = text.lines().skip_while(|l| !l.starts_with("| function |")).skip(2);
    let mut seen = 0;
    for row in rows.take_while(|l| l.starts_with('|')) {
        let cell = row.split('|').nth(1).expect("first cell");
        for call in cell.split('`').skip(1).step_by(2) {
            let expression = call.replace(['x', 'y', 'm', 's', 'b', 'n', 'p'], "1");
            // Names must keep their letters.
            let expression =
                format!("{}{}", &call[..call.find('(').expect("call")], &expression[call.find('(').expect("call")..]);
            let production = whole(&format!("A --> F({})\n", expression.replace("(a,", "(1,")));
            read(&production).unwrap_or_else(|e| panic!("{call}\n{e}"));
            seen += 1;
        }
    }
    assert!(seen > 20, "{seen}");
}

#[test]
fn listed_turtle_commands_are_obeyed() {
    use osier::grow::turtle::{TurtleOptions, grow};
    let text = std::fs::read_to_string(root().join("docs/grammars.md")).expect("text");
    let rows = text.lines().skip_while(|l| !l.starts_with("| command |")).skip(2);
    let mut seen = 0;
    for row in rows.take_while(|l| l.starts_with('|')) {
        let cell = row.split('|').nth(1).expect("first cell");
        for command in cell.split('`').skip(1).step_by(2) {
            let (name, arguments) = command.split_once('(').unwrap_or((command, ""));
            let arguments = arguments.replace(|c: char| c.is_ascii_lowercase(), "1");
            let open = if arguments.is_empty() { "" } else { "(" };
            let axiom = match command {
                "]" => "F[F]".to_owned(),
                "{" | "." | "}" => "F{.F+F.}".to_owned(),
                spline if spline.starts_with("{(") => format!("F{spline}.ff}}F"),
                _ => format!("F{name}{open}{arguments}F"),
            };
            let text = format!("Lsystem: 1\nDerivation length: 0\nAxiom: {axiom}\nendlsystem\n");
            let (grammar, _) = read(&text).unwrap_or_else(|e| panic!("{command}\n{e}"));
            let derived = grammar::derive(&grammar, &DeriveOptions::default(), &Limits::default()).expect("derives");
            let options = TurtleOptions { tropisms: vec![Default::default()], ..TurtleOptions::default() };
            let (_, warnings) =
                grow(&grammar, &derived, &options, &Limits::default()).unwrap_or_else(|e| panic!("{command}\n{e}"));
            // Patches, textures and organs need what stands before them or beside the grammar.
            let lacks = matches!(name, "~c" | "@PC" | "@PD" | "@Tx");
            assert!(warnings.iter().all(|d| d.code == "L045" || lacks && d.code == "L048"), "{command}: {warnings:?}");
            seen += 1;
        }
    }
    assert!(seen > 35, "{seen}");
}

#[test]
fn scene_snippets_resolve() {
    let folder = std::env::temp_dir().join(format!("osier-docs-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("folder");
    std::fs::write(folder.join("mine.obj"), "v 0 0 0\nv 0 1 0\nv 1 0 0\nf 1 2 3\n").expect("write");
    std::fs::copy(root().join("grammars/koch.l"), folder.join("mine.l")).expect("copy");
    let map = image::ImageBuffer::<image::Luma<u16>, _>::from_vec(2, 2, vec![9_u16, 0, 500, 60_000]).expect("fits");
    map.save(folder.join("mine.png")).expect("picture");
    for name in ["bark.png", "bark-normal.png"] {
        image::RgbImage::from_pixel(2, 2, image::Rgb([128, 128, 255])).save(folder.join(name)).expect("picture");
    }
    let mut seen = 0;
    for block in blocks().iter().filter(|b| b.tag == "toml") {
        let oak = "\n[plants.oak]\ngrammar = \"oak.l\"\n";
        let grows = ["grammar =", "species ="].iter().any(|key| block.body.contains(key));
        let text = if grows { block.body.clone() } else { format!("{}{oak}", block.body) };
        let library = Library::new(&folder.join("scene.toml"), &[]).expect("folder");
        let request = Request { name: "docs".into(), shown: block.place.clone(), text, library, ..Request::default() };
        let (_, report) = resolve(&request).unwrap_or_else(|e| panic!("{e}"));
        assert!(report.diagnostics.is_empty(), "{report}");
        seen += 1;
    }
    std::fs::remove_dir_all(&folder).expect("removed");
    assert!(seen > 4, "{seen}");
}

/// Code in backquotes that names a place in the sources: `crates/base/src/math.rs: transport`.
fn names(text: &str) -> Vec<(String, String)> {
    let mut out = Vec::new();
    for code in text.split('`').skip(1).step_by(2) {
        if let Some((file, name)) = code.split_once(".rs: ") {
            out.push((format!("{file}.rs"), name.to_owned()));
        }
    }
    out
}

#[test]
fn functions_and_tests_that_documents_name_exist() {
    let all: Vec<(String, String)> = documents().iter().flat_map(|(_, text)| names(text)).collect();
    assert!(all.len() > 200, "{}", all.len());
    let missing: Vec<String> = all
        .iter()
        .filter(|(file, name)| {
            let source = std::fs::read_to_string(root().join(file)).unwrap_or_default();
            let found = |word: &str, ends: &[char]| {
                source.match_indices(&format!("{word} {name}")).any(|(i, m)| source[i + m.len()..].starts_with(ends))
            };
            !(found("fn", &['(', '<']) || found("const", &[':']) || found("struct", &[' ', '(', '<']))
        })
        .map(|(file, name)| format!("{file}: {name}"))
        .collect();
    assert!(missing.is_empty(), "documents name what is not there: {missing:#?}");
}

#[test]
fn every_key_of_the_manifest_is_explained() {
    use osier::export::manifest::{Settings, build};
    let text = std::fs::read_to_string(root().join("docs/formats.md")).expect("text");
    let (scene, _) = synthetic::scene();
    let json = build(&scene, &[], &[], &Settings::default()).text().expect("finite");
    let keys = json.split('"').skip(1).step_by(2).zip(json.split('"').skip(2).step_by(2));
    // The lists of `places` are named after the assets.
    let is_asset = |key: &str| scene.assets.iter().any(|asset| asset.id == key);
    let missing: std::collections::BTreeSet<&str> = keys
        .filter(|(_, after)| after.starts_with(':'))
        .map(|(key, _)| key)
        .filter(|key| !is_asset(key))
        .filter(|key| !text.contains(&format!("`{key}`")))
        .collect();
    assert!(missing.is_empty(), "docs/formats.md does not explain {missing:?}");
}

#[test]
fn links_lead_to_files() {
    let mut dead = Vec::new();
    for (name, text) in documents() {
        let folder = root().join(&name).parent().expect("folder").to_owned();
        for part in text.split("](").skip(1) {
            let target = part.split([')', '#']).next().unwrap_or_default();
            if !target.is_empty() && !target.contains("://") && !folder.join(target).exists() {
                dead.push(format!("{name}: {target}"));
            }
        }
    }
    assert!(dead.is_empty(), "{dead:#?}");
}
