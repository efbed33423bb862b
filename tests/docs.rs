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

fn held(name: &str, expected: &str) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name);
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    if found != expected && std::env::var("OSIER_BLESS").is_ok() {
        std::fs::write(&path, expected).expect("write");
    }
    assert!(
        found == expected,
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

/// Name and text of every document.
fn documents() -> Vec<(String, String)> {
    let mut paths: Vec<PathBuf> = Vec::new();
    for folder in [root().to_owned(), root().join("docs"), root().join("docs/gallery")] {
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
