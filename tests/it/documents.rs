//! Every complete command that README and docs name is one that the program takes.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read the documents")]

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use osier::par::par_map;

/// No frame is allowed: a run reads its flags, its files and its scene, and stops with the error of that limit alone.
const NO_FRAMES: [&str; 2] = ["--max-frames", "0"];

/// The commands of a document: lines of its blocks and words in backticks that begin with `osier`.
fn commands(text: &str) -> Vec<String> {
    let mut fenced = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        fenced ^= line.starts_with("```");
        let bare = line.trim().trim_start_matches("$ ");
        if bare.starts_with("osier ") && (fenced || line.starts_with("    ")) {
            lines.push(bare);
        }
    }
    let quoted = text.split('`').filter(|w| w.starts_with("osier ") && !w.contains('\n'));
    // What follows `  #` is a remark.
    let command =
        |c: &str| c.split("  #").next().and_then(|c| c.split(" # ").next()).unwrap_or_default().trim().to_owned();
    lines.into_iter().chain(quoted).map(command).collect()
}

/// A word that stands for something of the reader's, such as `SCENE`, `FILE...` or `[-o DIR]`, or a file that is not there.
fn is_placeholder(word: &str, folder: &Path) -> bool {
    let bare = word.trim_matches(|c: char| !c.is_ascii_alphanumeric());
    let name = bare.split('.').next().unwrap_or_default();
    let capital = name.len() > 2 && name.chars().all(|c| c.is_ascii_uppercase() || c == '_');
    capital || word.starts_with('[') || word.contains("\\|") || (is_file(word) && !folder.join(word).exists())
}

fn is_file(word: &str) -> bool {
    [".l", ".ifs", ".toml", ".glb"].iter().any(|ending| word.ends_with(ending))
}

/// The words of a command that can be run as it stands; `None` for an abbreviated one.
fn complete(command: &str, folder: &Path) -> Option<Vec<String>> {
    let words: Vec<String> = command.split_whitespace().skip(1).map(|w| w.replace('\'', "")).collect();
    let verb = words.first()?.as_str();
    let source = words.get(1).filter(|w| !w.starts_with('-'));
    // An output file is made by the command; every other name must be there.
    let made = words.iter().position(|w| w == "-o").map(|i| i + 1);
    let open = words.iter().enumerate().any(|(i, w)| Some(i) != made && is_placeholder(w, folder));
    let needs_source = matches!(verb, "grow" | "preview" | "check" | "info" | "new" | "completions");
    let ends_open = words.last().is_some_and(|w| w == "-o");
    (!open && !ends_open && (source.is_some() || !needs_source)).then_some(words)
}

/// The texts of README and of the documents.
fn documents() -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = vec![root.join("README.md")];
    for folder in ["docs", "docs/gallery", "docs/species"] {
        let paths = std::fs::read_dir(root.join(folder)).expect(folder).map(|e| e.expect("entry").path());
        files.extend(paths.filter(|p| p.extension().is_some_and(|e| e == "md")));
    }
    files.iter().map(|path| std::fs::read_to_string(path).expect("document")).collect()
}

#[test]
fn the_documents_name_folders_as_bakes_do() {
    // The folder of a bake has the name of its scene in `[a-z0-9_]`.
    let stems = osier::presets::PRESETS.iter().filter_map(|p| p.name.strip_suffix(".toml"));
    let wrong: Vec<String> = stems.filter(|stem| stem.contains('-')).map(|stem| format!("out/{stem}")).collect();
    assert!(wrong.contains(&"out/rain-leaves".to_owned()), "{wrong:?}");
    for text in documents() {
        let named: Vec<&String> = wrong.iter().filter(|folder| text.contains(folder.as_str())).collect();
        assert!(named.is_empty(), "{named:?}");
    }
}

#[test]
fn the_commands_of_the_documents_are_taken() {
    let all: BTreeSet<String> = documents().iter().flat_map(|text| commands(text)).collect();

    let dir = tempfile::tempdir().expect("dir");
    let run = |words: &[String], more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
        command.args(words).args(more).current_dir(dir.path()).output().expect("osier runs")
    };
    // A folder of the reader's own, which later commands name.
    let (first, others): (Vec<&String>, Vec<&String>) = all.iter().partition(|c| c.starts_with("osier new "));
    for command in first {
        let Some(words) = complete(command, dir.path()) else { continue };
        assert!(run(&words, &[]).status.success(), "{command}");
    }
    // The beginning of a longer command names that command and is not one itself.
    let is_beginning = |command: &str| all.iter().any(|c| c.strip_prefix(command).is_some_and(|r| r.starts_with(' ')));
    let taken = par_map(&others, |command| {
        let words = complete(command, dir.path()).filter(|_| !is_beginning(command))?;
        let makes = matches!(words[0].as_str(), "bake" | "grow" | "preview");
        let out = run(&words, if makes { &NO_FRAMES } else { &[] });
        let said = String::from_utf8_lossy(&out.stderr);
        let errors: Vec<&str> = said.lines().filter(|line| line.starts_with("error")).collect();
        let limited = !errors.is_empty() && errors.iter().all(|line| line.ends_with("raise it with --max-frames"));
        let stopped = makes && matches!(out.status.code(), Some(1 | 2)) && limited;
        assert!(out.status.success() || stopped, "{command}: {:?}\n{said}", out.status.code());
        Some(())
    });
    let taken = taken.into_iter().flatten().count();
    assert!(taken >= 50, "{taken} commands of {} are complete", all.len());
}
