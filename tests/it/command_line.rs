//! The program on the command line: exit codes, what goes where, equal bytes in any surroundings, and answers to
//! whatever is wrong.
#![cfg(unix)]
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests fail by panicking and look at the disk")]

use crate::common::program;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::common::program::{OSIER, arg, assert_same, ends, osier, said, tree};
use serde_json::Value;
use tempfile::{TempDir, tempdir};

const SCENE: &str = "tests/scenes/sprig.toml";
const GRAMMAR: &str = "tests/scenes/sprig.l";

/// Small maps for a bare grammar, which are drawn quickly.
const SMALL: [&str; 6] = ["--set", "bark.side=16", "--set", "shoot.side=16", "--set", "leaf.side=32"];

fn folder() -> TempDir {
    tempdir().expect("dir")
}

/// Writes a file and gives its path.
fn file(dir: &TempDir, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
    let path = dir.path().join(name);
    fs::write(&path, text).expect("write");
    path
}

/// Such names come with archives of other systems; one of many arguments of a script is hard to find.
#[test]
fn an_argument_that_is_not_utf_8_is_named() {
    use std::os::unix::ffi::OsStrExt as _;
    let mut command = osier(&["check", SCENE]);
    command.arg(std::ffi::OsStr::from_bytes(b"pl\xe4nt.l"));
    let (code, _, err) = said(&command.output().expect("runs"));
    assert!(code == 2 && err.contains("help: \"pl\u{fffd}nt.l\": write names of files in UTF-8"), "{err}");
}

/// A grammar that is grown with one warning: its tropism is not defined.
const WARNS: &str = "Lsystem: w\nDerivation length: 1\nAxiom: @Ts(1,0.1) F ~l\nendlsystem\n";

#[test]
fn nothing_typed_gets_a_guide_of_ten_lines() {
    let (out, err) = ends(2, &[]);
    assert!(out.is_empty() && err.lines().count() == 10 && err.contains("osier new mytree"), "{err}");
}

#[test]
fn usage_ends_with_2_and_help_with_0() {
    let dir = folder();
    let glb = dir.path().join("x.glb");
    let grow = ["grow", SCENE, "-o", arg(&glb)];
    let wrong = [
        &["--nope"][..],
        &["-j0"],
        &["--max-modules", "many"],
        &["--max-wishes", "1"],
        // No code read this limit.
        &["--max-depth", "5"],
        &["--seed", "x"],
        &["--set", "wind.speed"],
    ];
    for more in wrong {
        let (out, err) = ends(2, &[&grow[..], more].concat());
        assert!(out.is_empty() && err.starts_with("error:"), "{err}");
    }
    for seed in ["x", "-1", "1.5", "18446744073709551616"] {
        let (_, err) = ends(2, &[&grow[..], &["--seed", seed]].concat());
        assert!(err.contains(&format!("'{seed}'")) && err.contains("from 0 to 18446744073709551615"), "{err}");
    }
    for list in ["x", "9-7", "1-9", "1-6:0"] {
        let (_, err) = ends(2, &["bake", SCENE, "-o", arg(dir.path()), "--frames", list]);
        assert!(err.starts_with("error: --frames"), "{err}");
    }
    for (list, told) in
        [("usdd", "did you mean \"usd\"?"), ("usd,picture", "one of usd, glb"), ("", "\"\" is no format")]
    {
        let (_, err) = ends(2, &["bake", SCENE, "-o", arg(dir.path()), "--formats", list]);
        assert!(err.starts_with("error: --formats") && err.contains(told), "{err}");
    }
    let (_, err) = ends(2, &["bake", "koch", "-o", arg(dir.path()), "--frames", "1-4"]);
    assert!(err.contains("which has the one frame 1; --set frames.end=2"), "{err}");
    let (_, err) = ends(2, &["bake", "koch", "-o", arg(dir.path()), "--frames", "0"]);
    assert!(err.contains("which has the one frame 1") && !err.contains("frames.end"), "{err}");
    // Statistics of a sweep are those of a flight; files of several individuals come from several runs.
    for (flag, value, single) in [("--seeds", "0-3", "--seed"), ("--sweep", "wind.speed=1,2", "--set")] {
        let (_, err) = ends(2, &["bake", SCENE, "-n", flag, value]);
        assert!(
            err.contains(&format!("error: {flag}: ")) && err.contains(&format!("with {single} and an -o")),
            "{err}"
        );
    }
    // Faults of a swept value name the flag that gave it.
    let (_, err) = ends(1, &["bake", "catkins-wall", "-n", "--sweep", "wind.sped=1,2"]);
    assert!(err.contains("--sweep:1:6") && !err.contains("--set"), "{err}");
    // Pictures of plants are those of another command.
    let (_, err) = ends(2, &["grow", SCENE, "-o", arg(&dir.path().join("x.png"))]);
    assert!(err.contains(&format!("`osier preview {SCENE}`")), "{err}");
    let (_, err) = ends(2, &["grow", SCENE, "-o", "x.docx"]);
    assert!(err.contains(".usdc"), "{err}");
    ends(2, &["frobnicate"]);
    let mut with_bad_environment = osier(&["list"]);
    let (code, _, err) = said(&with_bad_environment.env("OSIER_MAX", "modules=many").output().expect("runs"));
    assert!(code == 2 && err.contains("OSIER_MAX") && err.contains("\"many\" is not a whole number"), "{err}");
    for asked in ["--help", "-h", "--version"] {
        let (out, err) = ends(0, &[asked]);
        assert!(err.is_empty() && out.contains("osier"), "{out}{err}");
    }
    // A flag that is a key of scenes, one like a flag, and one like nothing.
    let (_, err) = ends(2, &["bake", "--wind", "8"]);
    assert!(err.contains("`osier list options wind`") && !err.contains("--max-"), "{err}");
    assert!(ends(2, &["bake", "--formatz", "usd"]).1.contains("'--formats'"));
    assert!(!ends(2, &["bake", "--xyzzy"]).1.contains("osier list options"));
    assert_eq!(ends(0, &["help"]), ends(0, &["--help"]));
    assert_eq!(ends(0, &["help", "bake"]), ends(0, &["bake", "--help"]));
    ends(2, &["help", "frobnicate"]);
    assert!(!glb.exists() && tree(dir.path()).is_empty());
}

#[test]
fn strict_ends_with_3_after_writing_everything() {
    let dir = folder();
    let grammar = file(&dir, "w.l", WARNS);
    let (lax, strict) = (dir.path().join("lax/w.glb"), dir.path().join("strict/w.glb"));
    let (_, err) = ends(0, &[&["grow", arg(&grammar), "-o", arg(&lax)], &SMALL[..]].concat());
    assert!(err.contains("warning[L048]") && err.contains("w.l:3:8"), "{err}");
    ends(3, &[&["grow", arg(&grammar), "-o", arg(&strict), "--strict"], &SMALL[..]].concat());
    assert_eq!(fs::read(lax).expect("lax"), fs::read(strict).expect("strict"));
    ends(3, &[&["check", arg(&grammar), "--strict"], &SMALL[..]].concat());
    ends(0, &["check", SCENE, "--strict"]);
    ends(0, &["check", "meadow", "--strict"]);
    // A bake that is up to date says what the bake said that wrote the files, and counts it: growth warns of the tropism.
    let out = dir.path().join("out");
    for up_to_date in [false, true] {
        let call = [&["bake", arg(&grammar), "-o", arg(&out), "--strict", "--json"], &SMALL[..]].concat();
        let (json, err) = ends(3, &call);
        let result: Value = serde_json::from_str(&json).expect("json");
        assert!(
            result["up_to_date"] == up_to_date && result["warnings"] == 1 && err.contains("warning[L048]"),
            "{json}{err}"
        );
    }
    let manifest: Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("json");
    assert_eq!(
        (manifest["warnings"].as_array().map(Vec::len), &manifest["warnings"][0]["code"]),
        (Some(1), &"L048".into())
    );
    let unreached = "Lsystem: w\nDerivation length: 1\nAxiom: F\nB --> F\nendlsystem\n";
    let grammar = file(&dir, "unreached.l", unreached);
    let (_, err) = ends(3, &["list", "knobs", arg(&grammar), "--strict"]);
    assert!(err.contains("warning[L030]"), "{err}");
    ends(0, &["list", "knobs", "koch.l", "--strict"]);
    let mesh = file(&dir, "w.obj", "mtllib absent.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let (out, err) = ends(3, &["info", arg(&mesh), "--strict"]);
    assert!(out.contains("3 vertices") && err.contains("warning[X014]") && err.contains("w.obj:1:8"), "{out}{err}");
    ends(0, &["info", arg(&mesh)]);
}

#[test]
fn what_cannot_be_written_ends_with_74() {
    let dir = folder();
    let wall = file(&dir, "wall", "a file, no folder");
    for (command, name) in [("grow", "x.glb"), ("bake", "out"), ("preview", "x.png")] {
        let (out, err) = ends(74, &[command, SCENE, "-o", arg(&wall.join(name))]);
        assert!(out.is_empty() && err.contains("error: cannot create") && err.contains("wall"), "{err}");
        // A bake may take hours before it writes.
        assert!(!err.contains("growing") && err.contains("not a directory"), "{err}");
    }
    // So may a picture, for which there is no place either.
    let mine = file(&dir, "mine.png", "not of osier");
    for command in ["grow", "preview"] {
        let (_, err) = ends(1, &[command, "fern_leaf.ifs", "-o", arg(&mine)]);
        assert!(err.contains("does not name osier") && !err.contains("drawing"), "{err}");
    }
    assert_eq!(fs::read(&mine).expect("mine"), b"not of osier");
    for args in [&["list", "codes"][..], &["--help"], &["bake", "-h"], &["--version"]] {
        let Ok(full) = fs::File::options().write(true).open("/dev/full") else { continue };
        let (code, _, err) = said(&osier(args).stdout(full).output().expect("runs"));
        assert!(code == 74 && err.contains("standard output"), "{args:?}: {err}");
    }
}

#[test]
fn standard_output_holds_results_and_nothing_else() {
    let dir = folder();
    let (out, glb, new) = (dir.path().join("out"), dir.path().join("x.glb"), dir.path().join("mine"));
    let json = |args: &[&str]| -> Value {
        let (out, _) = ends(0, &[args, &["--json"]].concat());
        serde_json::from_str(&out).unwrap_or_else(|e| panic!("{args:?}: {e}: {out}"))
    };
    let planned = json(&["bake", SCENE, "-n", "-o", arg(&out)]);
    assert!(planned["would_make"]["frames"] == 6 && !out.exists());
    let (first, again) = (json(&["bake", SCENE, "-o", arg(&out)]), json(&["bake", SCENE, "-o", arg(&out)]));
    assert!(first["up_to_date"] == false && again["up_to_date"] == true && first["bake_hash"] == again["bake_hash"]);
    assert_eq!(json(&["info", arg(&out)])["complete"], true);
    // As the text does, JSON tells which single files a format can be.
    let formats = json(&["list", "formats"]);
    let endings = |word: &str| {
        formats.as_array().expect("list").iter().find(|f| f["name"] == word).expect(word)["endings"].clone()
    };
    let limits = json(&["list", "limits", "--max-steps", "none", "--max-nodes", "7"]);
    let limit =
        |name: &str| limits.as_array().expect("list").iter().find(|l| l["name"] == name).expect(name)["value"].clone();
    assert!(limit("steps").is_null() && limit("nodes") == 7, "{limits}");
    assert_eq!((endings("glb"), endings("tracks")), (serde_json::json!([".glb", ".gltf"]), serde_json::json!([])));
    assert_eq!(json(&["grow", SCENE, "-o", arg(&glb)])["files"][0]["path"], arg(&glb));
    // Each kind of file that grow writes has a dry run in JSON.
    let plan = |source: &str, name: &str| {
        let path = dir.path().join(name);
        let planned = json(&["grow", source, "-n", "-o", arg(&path)]);
        assert!(planned["target"] == arg(&path) && !path.exists(), "{planned}");
        planned["would_make"].clone()
    };
    let still = plan(SCENE, "n.glb");
    assert!(still["triangles"].as_u64().is_some_and(|n| n > 0) && still["frames"] == 1, "{still}");
    let string = plan(SCENE, "n.txt");
    assert!(["modules", "bytes"].iter().all(|key| string[*key].as_u64().is_some_and(|n| n > 0)), "{string}");
    assert_eq!(plan("fern_leaf.ifs", "n.png"), serde_json::json!({ "width": 1024, "height": 1024 }));
    assert_eq!(plan("fern_leaf.ifs", "n.ifs"), serde_json::json!({ "systems": 1 }));
    assert!(json(&["info", arg(&glb)])["triangles"].as_u64().is_some_and(|n| n > 0));
    assert_eq!(json(&["new", arg(&new), "--from", "koch"])["files"].as_array().map(Vec::len), Some(2));
    assert_eq!(json(&["check", SCENE, SCENE]).as_array().map(Vec::len), Some(2));
    let grammar = dir.path().join("sprig.l");
    let planned = json(&["convert", GRAMMAR, "-n", "-o", arg(&grammar)]);
    assert!(!grammar.exists() && planned["files"][0]["path"] == arg(&grammar), "{planned}");
    assert_eq!(json(&["convert", GRAMMAR, "-o", arg(&grammar)]), planned);
    let text = fs::read_to_string(&grammar).expect("grammar");
    assert_eq!(json(&["convert", GRAMMAR])["text"], text.as_str());
    for what in ["presets", "options", "formats", "codes", "limits"] {
        assert!(json(&["list", what]).as_array().is_some_and(|rows| rows.len() > 3), "{what}");
    }
    let (said, told) = ends(0, &["bake", SCENE, "-o", arg(&dir.path().join("loud"))]);
    assert!(
        said.contains("files") && !said.lines().any(|l| l.starts_with("skinning")) && told.contains("skinning"),
        "{said}{told}"
    );
    assert_eq!(ends(0, &["bake", SCENE, "-q", "-o", arg(&dir.path().join("hush"))]), (String::new(), String::new()));
    // Nor does a check print its estimate; its string is what was asked for.
    assert_eq!(ends(0, &["check", SCENE, "-q"]), (String::new(), String::new()));
}

#[test]
fn threads_time_zone_locale_and_environment_leave_the_bytes_alone() {
    let dir = folder();
    let plain = dir.path().join("plain");
    ends(0, &["bake", SCENE, "-o", arg(&plain)]);
    let wanted = tree(&plain);
    let still = dir.path().join("s.glb");
    ends(0, &["grow", SCENE, "-o", arg(&still)]);
    let (glb, path) = (fs::read(&still).expect("glb"), arg(&still).to_owned());
    let vars: [&[(&str, &str)]; 6] = [
        &[],
        &[],
        &[],
        &[("TZ", "Asia/Kathmandu"), ("LC_ALL", "tr_TR.UTF-8")],
        &[("TZ", "America/St_Johns"), ("LC_ALL", "de_DE.UTF-8"), ("LANG", "de_DE.UTF-8")],
        &[("LC_ALL", "C")],
    ];
    for (i, vars) in vars.iter().enumerate() {
        let jobs = ["-j1", "-j2", "-j8"][i % 3];
        let out = dir.path().join(format!("out{i}"));
        let calm = |mut command: Command| {
            if i == 5 {
                command.env_clear();
            }
            let (code, _, err) = said(&command.envs(vars.iter().copied()).output().expect("runs"));
            assert_eq!(code, 0, "{vars:?}: {err}");
        };
        calm(osier(&["bake", SCENE, jobs, "-o", arg(&out)]));
        assert_same(&tree(&out), &wanted, &format!("{jobs} {vars:?}"));
        calm(osier(&["grow", SCENE, jobs, "-o", &path]));
        assert_eq!(fs::read(&still).expect("glb"), glb, "{jobs} {vars:?}");
    }
}

#[test]
fn an_artefact_goes_through_a_pipe_and_readers_may_leave() {
    let dir = folder();
    let named = dir.path().join("stdout.glb");
    ends(0, &["grow", SCENE, "-o", arg(&named)]);
    // A folder cannot go through a pipe, and "-" is no name for one.
    assert!(ends(2, &["bake", SCENE, "-o", "-"]).1.contains("`osier grow SOURCE -o -`"));
    let piped = program::run(&["grow", SCENE, "-o", "-"]);
    assert_eq!((piped.status.code(), piped.stdout), (Some(0), fs::read(named).expect("glb")));
    // Pictures and clips have the same bytes as in files, and messages stay on standard error.
    for (name, more) in [("a.png", &["--size", "40"][..]), ("a.gif", &["--size", "32", "--turntable", "3"][..])] {
        let path = dir.path().join(name);
        let call = [&["preview", "koch.l", "--quality", "draft", "-o"][..], &[arg(&path)], more].concat();
        ends(0, &call);
        let piped = program::run(&call.iter().map(|a| if *a == arg(&path) { "-" } else { *a }).collect::<Vec<_>>());
        assert_eq!((piped.status.code(), piped.stdout), (Some(0), fs::read(&path).expect("picture")), "{name}");
        assert!(!Path::new(env!("CARGO_MANIFEST_DIR")).join("-").exists(), "no file has the name");
    }
    for call in [&["grow", SCENE, "-o", "-", "--json"][..], &["preview", "koch.l", "--size", "40", "-o", "-", "--json"]]
    {
        let run = program::run(call);
        let err = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.success() && err.contains("--json has no effect with -o -"), "{err}");
        assert!(!run.stdout.ends_with(b"}\n"), "{call:?}: the file alone");
    }
    let left = |args: &[&str]| {
        let mut child = osier(args).spawn().expect("starts");
        drop(child.stdout.take());
        said(&child.wait_with_output().expect("ends"))
    };
    for args in [&["list", "options"][..], &["completions", "bash"], &["man"]] {
        let (code, _, err) = left(args);
        assert_eq!((code, err.as_str()), (0, ""), "{args:?}");
    }
    let out = dir.path().join("out");
    let (code, _, err) = left(&["bake", SCENE, "-o", arg(&out)]);
    assert!(code == 0 && out.join("manifest.json").exists(), "{err}");
    let (code, _, err) = left(&["grow", SCENE, "-o", "-"]);
    assert!(code == 74 && err.contains("standard output"), "{err}");
}

#[test]
fn a_converted_grammar_is_the_same_on_standard_output_and_in_a_file() {
    let dir = folder();
    let grammar = file(&dir, "t.l", "Lsystem: 1\nDerivation length: 1\nAxiom: A\nA -->\tF\n\t[ +F ] F\nendlsystem\n");
    let written = dir.path().join("out.l");
    ends(0, &["convert", arg(&grammar), "-o", arg(&written)]);
    let text = fs::read_to_string(&written).expect("grammar");
    assert!(text.contains("\n\t[ +F ] F"), "{text}");
    assert_eq!(ends(0, &["convert", arg(&grammar)]).0, text);
    assert_eq!(ends(0, &["convert", arg(&grammar), "-o", "-"]).0, text);
    for name in ["t.toml", "t.glb"] {
        let (_, err) = ends(2, &["convert", arg(&grammar), "-o", arg(&dir.path().join(name))]);
        assert!(err.contains("a grammar is written as .l"), "{err}");
    }
    // An undefined variable is a warning.
    let warns = file(&dir, "w.l", "Lsystem: 1\nDerivation length: 2\nAxiom: A\nA --> F B(u)\nendlsystem\n");
    ends(3, &["convert", arg(&warns), "--strict"]);
    // Of a scene the first grammar, and a note on those with another text.
    let scene = |others: [&str; 2]| {
        let plant = |name: &str, grammar: &str| format!("[plants.{name}]\ngrammar = \"{grammar}\"\n");
        file(&dir, "scene.toml", plant("a", "koch.l") + &plant("b", others[0]) + &plant("c", others[1]))
    };
    let (_, err) = ends(0, &["convert", arg(&scene(["koch.l", "oak.l"]))]);
    assert!(err.contains("only the grammar of plant \"a\"") && err.contains(": \"c\""), "{err}");
    let (_, err) = ends(3, &["convert", arg(&scene(["grass.l", "oak.l"])), "--strict"]);
    assert!(err.contains(": \"b\", \"c\""), "{err}");
    let (_, err) = ends(0, &["convert", arg(&scene(["koch.l", "koch.l"]))]);
    assert!(err.is_empty(), "{err}");
}

#[test]
fn a_dry_run_writes_nothing() {
    let dir = folder();
    let path = |name: &str| dir.path().join(name);
    let [glb, png, gif, text] = ["x.glb", "x.png", "x.gif", "x.l"].map(path);
    for args in [
        &["bake", SCENE, "-o", arg(&path("out"))][..],
        &["grow", SCENE, "-o", arg(&glb)],
        &["preview", SCENE, "--size", "16x16", "-o", arg(&png)],
        &["preview", SCENE, "--size", "16x16", "--frames", "1-2", "-o", arg(&gif)],
        &["convert", GRAMMAR, "-o", arg(&text)],
        &["new", arg(&path("mine"))],
        &["list", "presets", "--thumbnails", arg(&path("small"))],
    ] {
        ends(0, &[args, &["-n"]].concat());
        assert!(tree(dir.path()).is_empty() && !path("small").exists(), "{args:?}");
    }
}

#[test]
fn a_file_with_dots_in_its_name_takes_overrides() {
    let dir = folder();
    let text = "#define ANGLE 20\nLsystem: 1\nDerivation length: 1\nAxiom: F +(ANGLE) F ~l\nendlsystem\n";
    let (dotted, plain) = (file(&dir, "v1.2.l", text), file(&dir, "v.l", text));
    let string = |grammar: &Path, name: &str| {
        let out = dir.path().join(name);
        ends(
            0,
            &["grow", arg(grammar), "--set", "ANGLE=35", "--set", "leaf.size=0.2", "--rng", "osier", "-o", arg(&out)],
        );
        fs::read_to_string(out).expect("a string")
    };
    let wanted = string(&plain, "plain.txt");
    assert!(wanted.contains("+(35)"), "{wanted}");
    assert_eq!(string(&dotted, "dotted.txt"), wanted);
    // The listed key is one that an override takes, in quotes.
    let (json, _) = ends(0, &["list", "knobs", arg(&dotted), "--json"]);
    assert!(json.contains("plants.\\\"v1.2\\\".set.ANGLE"), "{json}");
}

/// Runs the program with a file as its standard input.
fn fed(input: &Path, args: &[&str]) -> (i32, String, String) {
    let input = fs::File::open(input).expect("input");
    said(&osier(args).stdin(input).output().expect("runs"))
}

#[test]
fn a_scene_is_read_from_standard_input_as_often_as_a_command_needs_it() {
    let dir = folder();
    let scene = file(&dir, "scene.toml", "title = \"seed --> tree\"\n[plants.koch]\ngrammar = \"koch.l\"\n");
    let (code, _, err) = fed(&scene, &["check", "-", "-"]);
    assert_eq!(code, 0, "{err}");
    ends(0, &["check", arg(&scene)]);
    let sheet = dir.path().join("sheet.png");
    let (code, _, err) = fed(&scene, &["preview", "-", "--seeds", "1,2", "--size", "16x16", "-o", arg(&sheet)]);
    assert!(code == 0 && sheet.is_file(), "{err}");
    let (code, _, err) = fed(Path::new(GRAMMAR), &["check", "-"]);
    assert!(code == 1 && err.matches("error[").count() == 1 && err.contains("only scenes"), "{err}");
}

#[test]
fn pictures_and_files_of_other_programs_are_told_to_be_no_scenes() {
    let dir = folder();
    let picture = file(&dir, "bark.png", [0x89, b'P', b'N', b'G', 0xff]);
    let stage = file(&dir, "tree.usda", "#usda 1.0\ndef Xform \"tree\"\n{\n}\n");
    for (path, told) in
        [(&picture, "is a picture, neither scene"), (&stage, "is a file of other programs, neither scene")]
    {
        for command in [&["bake"][..], &["check"], &["grow", "-o", "x.glb"]] {
            let (_, err) = ends(1, &[command, &[arg(path)]].concat());
            assert!(err.contains("S001") && err.contains(told) && !err.contains("UTF-8"), "{command:?}: {err}");
        }
    }
}

#[test]
fn flags_that_a_source_cannot_heed_are_told() {
    let dir = folder();
    for flag in [["--rng", "cpfg"], ["--dialect", "cpfg"]] {
        for scene in ["oak", SCENE] {
            let (_, err) = ends(1, &[&["check", scene][..], &flag].concat());
            assert!(err.contains(flag[0]) && err.contains("[plants.NAME]"), "{scene}: {err}");
        }
    }
    let (_, err) = ends(1, &["check", "koch.l", "--rng", "lcg"]);
    assert!(err.contains("S003") && err.contains("lcg"), "{err}");
    let (_, err) =
        ends(3, &["grow", "hazel.species", "--set", "age=1", "--steps", "3", "--strict", "-n", "-o", "x.glb"]);
    assert!(err.contains("warning[S007]") && err.contains("steps"), "{err}");
    // Finished files, tables of the program and the text of a grammar are the same whatever a scene has.
    let mesh = file(&dir, "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    for command in [&["info", arg(&mesh)][..], &["list", "codes"], &["list", "options"], &["convert", GRAMMAR]] {
        ends(0, command);
        for flag in [["--set", "angle=30"], ["--seed", "4"], ["--rng", "cpfg"]] {
            let (out, err) = ends(2, &[command, &flag].concat());
            assert!(out.is_empty() && err.contains(&format!("{} does not change", flag[0])), "{command:?}: {err}");
        }
    }
    ends(2, &["list", "presets", "--json", "--set", "wind.speed=4"]);
    for (name, told) in [("x.txt", true), ("x.glb", false)] {
        let (_, err) = ends(0, &["grow", "koch", "--profile", "web", "-n", "-o", name]);
        assert_eq!(err.contains("--profile has no effect"), told, "{name}: {err}");
    }
    let (_, err) = ends(2, &["grow", "koch", "--profile", "engine", "-n", "-o", "x.glb"]);
    assert!(err.contains("osier bake koch --formats glb --set 'output.gltf.profiles=[\"engine\"]'"), "{err}");
    // Pictures are PNG files; another ending would promise another format.
    for name in ["x.jpg", "x.gif"] {
        let picture = dir.path().join(name);
        let (_, err) = ends(2, &["preview", SCENE, "--size", "16x16", "-o", arg(&picture)]);
        assert!(err.contains("is written as .png") && !picture.exists(), "{err}");
    }
}

#[test]
fn closed_descriptors_stop_nothing() {
    let dir = folder();
    let (open, closed) = (dir.path().join("open"), dir.path().join("closed"));
    ends(0, &["bake", SCENE, "-o", arg(&open)]);
    let script = "exec \"$0\" bake \"$1\" -o \"$2\" <&- >&- 2>&-";
    let mut shell = Command::new("sh");
    shell.current_dir(env!("CARGO_MANIFEST_DIR")).args(["-c", script, OSIER, SCENE, arg(&closed)]);
    assert_eq!(shell.stdin(Stdio::null()).status().expect("sh").code(), Some(0));
    assert_same(&tree(&closed), &tree(&open), "closed descriptors");
}

#[test]
fn no_file_gets_another_name_than_the_one_given() {
    use std::os::unix::ffi::OsStrExt as _;

    let dir = folder();
    let cases: [(&[u8], &[&str]); 3] = [
        (b"\xff.glb", &["grow", SCENE, "-o"]),
        (b"\xff.png", &["preview", SCENE, "--size", "16x16", "-o"]),
        (b"\xff.l", &["convert", GRAMMAR, "-o"]),
    ];
    for (name, args) in cases {
        let path = dir.path().join(std::ffi::OsStr::from_bytes(name));
        let (code, _, err) = said(&osier(args).arg(&path).output().expect("runs"));
        assert!(code == 2 && err.contains("is not UTF-8") && tree(dir.path()).is_empty(), "{err}");
    }
}

#[test]
fn foreign_files_are_left_alone_without_force() {
    let dir = folder();
    let glb = file(&dir, "x.glb", "mine");
    let (out, err) = ends(1, &["grow", SCENE, "-o", arg(&glb)]);
    assert!(out.is_empty() && err.contains("--force") && fs::read(&glb).expect("mine") == b"mine", "{err}");
    ends(0, &["grow", SCENE, "-o", arg(&glb), "--force"]);
    ends(0, &["grow", SCENE, "-o", arg(&glb)]);
    let (out, plain) = (dir.path().join("out"), dir.path().join("plain"));
    ends(0, &["bake", SCENE, "-o", arg(&plain)]);
    for name in ["manifest.json", ".osier", "sprig.usda", "pov/main.pov", "textures/sprig_shoot_color.png"] {
        let path = out.join(name);
        fs::create_dir_all(path.parent().expect("folder")).expect("folder");
        fs::write(&path, "mine").expect("write");
        let (_, err) = ends(1, &["bake", SCENE, "-o", arg(&out)]);
        assert!(err.contains(name) && err.contains("--force"), "{err}");
        assert_eq!(fs::read(&path).expect("mine"), b"mine", "{name}");
        ends(0, &["bake", SCENE, "-o", arg(&out), "--force"]);
        assert_same(&tree(&out), &tree(&plain), name);
        fs::remove_dir_all(&out).expect("remove");
    }
}

/// Strings and grammars cannot name their maker.
#[test]
fn a_text_is_written_again_over_its_equal_alone() {
    let dir = folder();
    let (string, text) = (dir.path().join("x.txt"), dir.path().join("x.l"));
    for command in [&["grow", GRAMMAR, "-o", arg(&string)], &["convert", GRAMMAR, "-o", arg(&text)]] {
        let (first, _) = ends(0, command);
        let (again, _) = ends(0, command);
        assert_eq!(first, again);
        fs::write(command[3], "mine").expect("write");
        let (_, err) = ends(1, command);
        assert!(err.contains("--force") && fs::read(command[3]).expect("mine") == b"mine", "{err}");
        ends(0, &[&command[..], &["--force"]].concat());
    }
}

#[test]
fn a_foreign_file_is_found_before_anything_is_written() {
    for ending in ["gltf", "usda", "obj", "ply", "pov", "POV"] {
        let dir = folder();
        let path = file(&dir, &format!("x.{ending}"), "mine");
        let (_, err) = ends(1, &["grow", SCENE, "-o", arg(&path)]);
        assert!(err.contains("--force") && tree(dir.path()).len() == 1, "{ending}: {:?}", tree(dir.path()).keys());
    }
}

#[test]
fn a_foreign_file_is_found_before_anything_grows() {
    let dir = folder();
    let (glb, png) = (file(&dir, "x.glb", "mine"), file(&dir, "x.png", "mine"));
    let (manifest, journal) = (dir.path().join("a"), dir.path().join("b"));
    for (path, name) in [(&manifest, "manifest.json"), (&journal, ".osier")] {
        fs::create_dir(path).expect("folder");
        fs::write(path.join(name), "mine").expect("write");
    }
    let free = dir.path().join("free.glb");
    let (_, err) = ends(0, &["grow", SCENE, "-o", arg(&free)]);
    assert!(err.contains("growing"), "the stage that the others must not reach: {err}");
    for (command, path) in [("grow", &glb), ("preview", &png), ("bake", &manifest), ("bake", &journal)] {
        let (_, err) = ends(1, &[command, SCENE, "-o", arg(path)]);
        assert!(err.contains("--force") && !err.contains("growing"), "{command} {}: {err}", path.display());
    }
    // Of numbered pictures the first ones are not written before the file in the way of a later one is found.
    let turned = dir.path().join("turn_##.png");
    file(&dir, "turn_02.png", "mine");
    let (_, err) = ends(1, &["preview", SCENE, "--turntable", "2", "-o", arg(&turned)]);
    assert!(
        err.contains("turn_02.png") && !err.contains("growing") && !dir.path().join("turn_01.png").exists(),
        "{err}"
    );
}

#[test]
fn a_single_file_has_the_name_that_it_was_given() {
    let cases: [(&str, &[&str]); 4] = [
        ("x.OBJ", &["x.OBJ", "x.mtl"]),
        ("x.PLY", &["x.PLY"]),
        ("x.POV", &["x.POV"]),
        ("x.GLTF", &["x.GLTF", "x.bin"]),
    ];
    for (name, wanted) in cases {
        let dir = folder();
        ends(0, &["grow", SCENE, "-o", arg(&dir.path().join(name))]);
        let files: Vec<String> = tree(dir.path()).into_keys().filter(|f| !f.starts_with("x_files")).collect();
        assert_eq!(files, wanted);
    }
}

#[test]
fn a_plant_is_grown_again_over_its_own_files() {
    let dir = folder();
    for ending in ["glb", "gltf", "usda", "usdc", "usdz", "obj", "ply", "pov"] {
        let path = dir.path().join(format!("x.{ending}"));
        // Another seed gives other bytes, so that every file is replaced.
        for seed in ["1", "2"] {
            ends(0, &["grow", SCENE, "--seed", seed, "-o", arg(&path)]);
        }
    }
}

/// A scene whose one plant has a mesh of its own as its leaf.
fn with_leaf(mesh: &str) -> String {
    let grammar = "[plants.a]\ngrammar = \"sprig.l\"\n[plants.a.bark]\nside = 16\n[plants.a.shoot]\nside = 16\n";
    format!("{grammar}[plants.a.leaf]\nmesh = \"{mesh}\"\n[ground]\nshow = false\n")
}

#[test]
fn a_bake_of_meshes_names_the_plants_too() {
    let dir = folder();
    let out = dir.path().join("out");
    let bake = ["bake", SCENE, "--formats", "obj", "-o", arg(&out)];
    let (said, _) = ends(0, &bake);
    let files = fs::read_dir(out.join("obj")).expect("folder").flatten();
    let meshes = files.filter(|f| f.path().extension().is_some_and(|e| e == "obj")).count();
    assert!(meshes > 1 && said.contains(&format!("meshes at rest: {meshes} files in ")), "{said}");
    let one = dir.path().join("one");
    let (said, _) =
        ends(0, &["bake", "struck-twig", "--formats", "obj", "-o", arg(&one), "--set", "ground.show=false"]);
    assert!(said.contains("twig.obj"), "{said}");
}

#[test]
fn leaves_of_the_least_and_the_greatest_size_are_grown() {
    for blade in ["lobed", "toothed", "deltoid", "elliptic", "palmate", "petal", "needles"] {
        for size in ["0.001", "2"] {
            let sets = [format!("leaf.blade={blade}"), format!("leaf.size={size}")];
            let mut args = vec!["check", GRAMMAR];
            args.extend(SMALL);
            args.extend(sets.iter().flat_map(|set| ["--set", set.as_str()]));
            ends(0, &args);
        }
    }
}

#[test]
fn a_leaf_that_lies_on_its_side_or_beside_its_base_is_told() {
    let dir = folder();
    file(&dir, "sprig.l", fs::read(GRAMMAR).expect("grammar"));
    let cases = [
        // As Blender exports a leaf that lies along its Y axis.
        ("lying", ["-0.02 0 0", "0.02 0 0", "0.02 0.01 -0.08", "-0.02 0.01 -0.08"], "0.080 m along -Z"),
        ("hanging", ["-0.02 0 0", "0.02 0 0", "0.02 -0.08 0", "-0.02 -0.08 0"], "0.080 m along -Y"),
        ("centred", ["-0.02 -0.04 0", "0.02 -0.04 0", "0.02 0.04 0", "-0.02 0.04 0"], "0.040 m behind the origin"),
        // A plane of Blender.
        ("plane", ["-0.04 0 0.04", "0.04 0 0.04", "0.04 0 -0.04", "-0.04 0 -0.04"], "0.000 m of 0.080 m"),
        ("upright", ["-0.02 0 0", "0.02 0 0", "0.02 0.08 0", "-0.02 0.08 0"], ""),
        ("wide", ["-0.04 0 0", "0.04 0 0", "0.04 0.02 0", "-0.04 0.02 0"], ""),
        ("flower", ["-0.04 0.01 0.04", "0.04 0.01 0.04", "0.04 0.01 -0.04", "-0.04 0.01 -0.04"], ""),
    ];
    for (name, corners, wanted) in cases {
        let points: String = corners.iter().map(|c| format!("v {c}\n")).collect();
        let mesh = format!("{name}.obj");
        file(&dir, &mesh, points + "f 1 2 3 4\n");
        let scene = file(&dir, &format!("{name}.toml"), with_leaf(&mesh));
        let size = if name == "flower" { "seed=1" } else { "plants.a.leaf.size=0.06" };
        let (_, err) = ends(0, &["check", arg(&scene), "--set", size]);
        assert_eq!(err.contains("warning[S044]"), !wanted.is_empty(), "{name}: {err}");
        assert!(err.contains(wanted) && (wanted.is_empty() || err.contains(".toml:8:8")), "{name}: {err}");
    }
}

#[test]
fn every_broken_input_is_named_with_its_place_and_a_way_out() {
    let dir = folder();
    let grammar = |body: &str| format!("Lsystem: x\nDerivation length: 2\n{body}\nendlsystem\n");
    let gltf = r#"{"asset":{"version":"2.0"},"meshes":[{"primitives":[{"attributes":{"POSITION":9}}]}],
        "nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}],"scene":0}"#;
    file(&dir, "sprig.l", fs::read(GRAMMAR).expect("grammar"));
    file(&dir, "bad.obj", "v 0 0 0\nv 1 0\nf 1 1 1\n");
    file(&dir, "bad.gltf", gltf);
    file(&dir, "bad.glb", b"glTF\x02\0\0\0\xff\0\0\0");
    file(&dir, "bad.l", grammar("Axiom: A\nA --> F(sine(3))"));
    let cases: [(&str, String, &[&str]); 9] = [
        ("a.l", grammar("Axiom: A\nA --> F(1 A"), &["L001", "a.l:4:11"]),
        ("b.l", grammar("Axiom: A\nA --> F(sin(3,4))"), &["L022", "b.l:4:9"]),
        ("c.l", grammar("Axiom: A\nA --> F(sine(3))"), &["L021", "c.l:4:9", "help:"]),
        ("d.toml", "[plants.a\n".into(), &["S001", "d.toml:1:10", "help:"]),
        ("e.toml", "[plants.a]\ngramar = \"sprig.l\"\n".into(), &["S002", "e.toml:2:1", "help:", "grammar"]),
        ("f.toml", with_leaf("bad.obj"), &["X010", "bad.obj:2:1", "help:"]),
        ("g.toml", with_leaf("bad.gltf"), &["X010", "bad.gltf", "meshes[0].primitives[0].attributes.POSITION"]),
        ("h.toml", with_leaf("bad.glb"), &["X010", "bad.glb", "help:"]),
        ("i.toml", "[plants.a]\ngrammar = \"bad.l\"\n[[place]]\nplant = \"a\"\n".into(), &["L021", "bad.l:4:9"]),
    ];
    let (_, err) = ends(1, &["check", arg(&dir.path().join("bad.obj"))]);
    assert!(
        err.contains("is a mesh (.obj), neither scene nor grammar") && err.contains("of [plants.NAME] (a tree)"),
        "{err}"
    );
    for (name, text, wanted) in cases {
        let path = file(&dir, name, text);
        let glb = dir.path().join("x.glb");
        for args in [&["check", arg(&path)][..], &["grow", arg(&path), "-o", arg(&glb)]] {
            let (out, err) = ends(1, args);
            assert!(out.is_empty() && wanted.iter().all(|w| err.contains(w)), "{name}: {err}");
            // One fault is told once, without faults that only follow from it.
            assert_eq!(err.matches("error[").count(), 1, "{name}: {err}");
            assert!(!glb.exists(), "{name}");
        }
    }
}

#[test]
fn cut_and_flipped_inputs_get_an_answer_too() {
    let dir = folder();
    let (grammar, scene) = (fs::read(GRAMMAR).expect("grammar"), fs::read(SCENE).expect("scene"));
    file(&dir, "sprig.l", &grammar);
    let mut rng = osier::rng::Rng::at(3, &["damage".into()]);
    for turn in 0..24 {
        let (name, whole) = if turn % 2 == 0 { ("x.l", &grammar) } else { ("x.toml", &scene) };
        let mut bytes = whole.clone();
        let at = rng.below(u32::try_from(bytes.len()).expect("small")) as usize;
        if turn % 4 < 2 {
            bytes.truncate(at);
        } else {
            bytes[at] ^= 1 << rng.below(8);
        }
        let path = file(&dir, name, &bytes);
        let small = if turn % 2 == 0 { &SMALL[..] } else { &[] };
        let (code, _, err) = said(&program::run(&[&["check", arg(&path)], small].concat()));
        assert!(code == 0 || (code == 1 && err.contains("error")), "{code} after byte {at} of {name}: {err}");
    }
}

#[test]
fn a_misspelt_preset_is_told_the_nearest() {
    let dir = folder();
    let glb = dir.path().join("x.glb");
    let calls: [&[&str]; 4] =
        [&["grow", "okk", "-o", arg(&glb)], &["bake", "oaks"], &["check", "oakk"], &["new", "x", "--from", "ok"]];
    for args in calls {
        let (_, err) = ends(1, args);
        assert!(err.contains("did you mean \"oak\"?"), "{err}");
    }
    // A table is a preset, but no scene to copy: naming it as the nearest preset of itself helps nobody.
    for name in ["fern_leaf", "fern_leaf.ifs"] {
        let (_, err) = ends(1, &["new", "x", "--from", name]);
        assert!(err.contains("osier grow fern_leaf.ifs -o fern_leaf.ifs") && !err.contains("did you mean"), "{err}");
    }
    ends(0, &["grow", "fern_leaf.ifs", "-o", arg(&dir.path().join("fern_leaf.ifs"))]);
    let (_, err) = ends(1, &["new", "x", "--from", "fern_bud"]);
    assert!(err.contains("did you mean \"fern_bud.ifs.toml\"?"), "{err}");
    let (_, err) = ends(1, &["new", "x", "--grammar", "daisi"]);
    assert!(err.contains("no grammar of the library fits \"daisi\"; did you mean \"daisy\"?"), "{err}");
    for command in [&["bake"][..], &["list", "entries"]] {
        let (out, err) = ends(1, &[command, &["nowhere/to/be/found.toml"]].concat());
        assert!(out.is_empty() && err.contains("cannot open \"nowhere/to/be/found.toml\""), "{err}");
    }
    let (_, err) = ends(1, &["list", "entries", "okk"]);
    assert!(err.contains("did you mean \"oak\"?"), "{err}");
    assert_eq!(ends(0, &["list", "entries", "oak"]).0, "oak\n");
}

#[test]
fn a_new_folder_bakes_and_is_never_overwritten() {
    let dir = folder();
    for name in ["mine.toml", "mine.l"] {
        let (_, err) = ends(2, &["new", arg(&dir.path().join(name))]);
        assert!(err.contains("is the name of a file") && tree(dir.path()).is_empty(), "{err}");
    }
    for (preset, plant) in [("poplar-twig", "poplar_twig"), ("koch.l", "koch")] {
        let mine = dir.path().join(format!("My {plant}"));
        let (out, _) = ends(0, &["new", arg(&mine), "--from", preset]);
        let scene = out.lines().find(|l| l.ends_with(".toml")).expect("a scene");
        let small = [format!("plants.{plant}.bark.side=16"), format!("plants.{plant}.shoot.side=16")];
        let bark = ["--set", &small[0], "--set", &small[1], "--set", "ground.side=16"];
        let leaf = format!("plants.{plant}.leaf.side=32");
        let baked = dir.path().join(plant);
        let flags = ["--set", &leaf, "--formats", "ply", "-o", arg(&baked)];
        ends(0, &[&["bake", scene][..], &bark, &flags].concat());
        assert!(baked.join("manifest.json").is_file());
        let before = tree(&mine);
        let (_, err) = ends(1, &["new", arg(&mine), "--from", preset]);
        assert!(err.contains("already exists") && err.contains("choose another name"), "{err}");
        assert_same(&tree(&mine), &before, "new, twice");
    }
}

#[test]
fn presets_grow_by_the_names_that_their_list_shows() {
    let dir = folder();
    for name in ["koch.l", "young-tree.obj"] {
        let file = dir.path().join(format!("{name}.ply"));
        ends(0, &["grow", name, "-o", arg(&file)]);
        let picture = dir.path().join(format!("{name}.png"));
        ends(0, &["preview", name, "--size", "16x16", "--quality", "draft", "-o", arg(&picture)]);
        assert!(file.is_file() && picture.is_file(), "{name}");
    }
}

#[test]
fn a_new_folder_starts_from_the_grammar_that_words_describe() {
    let dir = folder();
    let mine = dir.path().join("mine");
    let (_, err) = ends(0, &["new", arg(&mine), "--grammar", "golden florets"]);
    assert!(err.contains("daisy: Oxeye daisy"), "{err}");
    assert!(mine.join("daisy.l").is_file() && mine.join("mine.toml").is_file());
    ends(0, &["check", arg(&mine.join("mine.toml"))]);
    let (_, err) = ends(2, &["new", arg(&dir.path().join("other")), "--grammar", "daisy", "--from", "oak"]);
    assert!(err.contains("cannot be used with"), "{err}");
    // With -q errors only, as of the other commands that write files.
    let quiet = dir.path().join("quiet");
    let (out, err) = ends(0, &["new", arg(&quiet), "--from", "koch.l", "-q"]);
    assert!(out.is_empty() && err.is_empty() && quiet.join("quiet.toml").is_file(), "{out}{err}");
    for flag in [["--set", "wind.speed=12"], ["--seed", "4"], ["--rng", "cpfg"]] {
        let other = dir.path().join("other");
        let (_, err) = ends(2, &["new", arg(&other), flag[0], flag[1]]);
        assert!(err.contains(&format!("{} does not change what `new` copies", flag[0])), "{err}");
        assert!(!other.exists(), "{}", flag[0]);
    }
}

#[test]
fn bake_and_info_count_the_same_files() {
    let dir = folder();
    let out = dir.path().join("out");
    let (text, _) = ends(0, &["bake", SCENE, "-o", arg(&out)]);
    let (result, _) = ends(0, &["bake", SCENE, "-o", arg(&out), "--json"]);
    let result: Value = serde_json::from_str(&result).expect("json");
    // Those of the manifest, whose sizes are added up.
    let count = format!("{} files, ", result["files"]);
    let (info, _) = ends(0, &["info", arg(&out)]);
    assert!(text.contains(&format!("  {count}")) && info.contains(&format!(" {count}")), "{count}: {text}{info}");
}

#[test]
fn info_names_what_was_deleted_or_changed_and_a_bake_mends_it() {
    let dir = folder();
    let out = dir.path().join("out");
    let bake = || ends(0, &["bake", SCENE, "-o", arg(&out)]);
    bake();
    let wanted = tree(&out);
    let (_, err) = ends(0, &["info", arg(&out)]);
    assert!(err.contains("complete"), "{err}");
    fs::remove_file(out.join("pov/frames/frame.0002.inc")).expect("remove");
    fs::write(out.join("obj/cached.obj"), "# nothing\n").expect("change");
    fs::write(out.join("notes.txt"), "mine").expect("add");
    let (_, err) = ends(1, &["info", arg(&out)]);
    for line in ["missing: pov/frames/frame.0002.inc", "changed: obj/cached.obj", "not part of the bake: notes.txt"] {
        assert!(err.contains(line), "{err}");
    }
    fs::remove_file(out.join("notes.txt")).expect("remove");
    bake();
    assert_same(&tree(&out), &wanted, "mended");
    ends(1, &["info", arg(dir.path())]);
    let (text, _) = ends(0, &["info", arg(&out.join("gltf/sprig.web.glb"))]);
    assert!(text.contains("gltf/sprig.web.glb") && text.contains("\nbake "), "{text}");
    // A file of the whole scene has the rows of all assets, that of one asset its own, a picture none and no head of a table.
    let assets = ["sprig_1 ", "cached "];
    for (name, rows) in [
        ("gltf/sprig.web.glb", [true, true]),
        ("gltf/sprig.blender.glb", [true, true]),
        ("sprig.usda", [true, true]),
        ("usd/assets.usda", [true, true]),
        ("pov/main.pov", [true, true]),
        ("usd/cached.usdc", [false, true]),
        ("maps/sky.exr", [false, false]),
    ] {
        let (text, _) = ends(0, &["info", arg(&out.join(name))]);
        assert_eq!(assets.map(|asset| text.lines().any(|line| line.starts_with(asset))), rows, "{name}: {text}");
        assert_eq!(text.contains("triangles"), rows[0] || rows[1], "{name}: {text}");
        assert!(text.contains(&format!("\n\n{name}  ")) && !text.contains("\n\n\n"), "{name}: {text}");
    }
    // A file beside a bake, or beside the manifest of another program, is described by itself.
    fs::copy(out.join("gltf/sprig.web.glb"), out.join("copy.glb")).expect("copy");
    let site = dir.path().join("site/models");
    fs::create_dir_all(&site).expect("folder");
    file(&dir, "site/manifest.json", "{ \"name\": \"a web application\" }");
    fs::copy(out.join("gltf/sprig.web.glb"), site.join("tree.glb")).expect("copy");
    for path in [out.join("copy.glb"), site.join("tree.glb")] {
        let (text, _) = ends(0, &["info", arg(&path)]);
        assert!(text.contains(" triangles") && !text.contains("\nbake "), "{text}");
    }
}

/// A name without a file is that of a preset, as in the commands that take a scene.
#[test]
fn info_describes_presets() {
    let dir = folder();
    let in_folder = |code: i32, args: &[&str]| {
        let output = osier(args).current_dir(dir.path()).output().expect("osier runs");
        let (got, out, err) = said(&output);
        assert_eq!(got, code, "{args:?}\n{out}\n{err}");
        (out, err)
    };
    for (name, kind) in [("oak", "oak.toml  preset (scene)"), ("oak.l", "oak.l  preset (grammar)")] {
        let (out, err) = in_folder(0, &["info", name]);
        assert!(out.starts_with(kind) && out.contains("\nblake3 ") && out.lines().count() == 3, "{out}");
        assert!(err.contains(&format!("\"{name}\" is a preset")) && err.contains("osier preview oak"), "{err}");
    }
    let (out, _) = in_folder(0, &["info", "oak", "--json"]);
    let told: serde_json::Value = serde_json::from_str(&out).expect("json");
    assert_eq!((&told["preset"], &told["kind"]), (&"oak.toml".into(), &"species".into()), "{out}");
    let (_, err) = in_folder(1, &["info", "oakk"]);
    assert!(err.contains("no such file or preset; did you mean \"oak\"?"), "{err}");
    // A name with an ending is that of a file, near another file or the file of a preset, not of a picture of this name.
    fs::write(dir.path().join("wall.obj"), "v 0 0 0").expect("file");
    for (name, told) in [
        ("dragn.png", "\"dragn.png\": no such file\n"),
        ("wal.obj", "no such file; did you mean \"wall.obj\"?"),
        ("dragn.l", "no such file; did you mean the preset \"dragon.l\"?"),
    ] {
        let (_, err) = in_folder(1, &["info", name]);
        assert!(err.contains(told), "{err}");
    }
    // A file of the name has precedence.
    fs::write(dir.path().join("oak"), "notes").expect("file");
    let (out, _) = in_folder(0, &["info", "oak"]);
    assert!(out.starts_with("oak  5 bytes"), "{out}");
}

#[test]
fn limits_refuse_before_anything_is_written() {
    let dir = folder();
    let glb = dir.path().join("x.glb");
    let grow = ["grow", SCENE, "-o", arg(&glb)];
    let (_, err) = ends(1, &[&grow[..], &["--max-steps", "1"]].concat());
    assert!(err.contains("L050") && err.contains("sprig.l:5:1") && err.contains("--max-steps"), "{err}");
    ends(0, &[&grow[..], &["-n", "--max-steps", "6"]].concat());
    let (_, err) = ends(1, &[&grow[..], &["--max-vertices", "10"]].concat());
    assert!(err.contains("the limit is 10; raise it with --max-vertices, or use a larger edge"), "{err}");
    let (_, err) = ends(1, &["bake", SCENE, "-o", arg(&dir.path().join("out")), "--max-frames", "5"]);
    assert!(err.contains("--max-frames"), "{err}");
    let (_, err) = ends(1, &["bake", SCENE, "-o", arg(&dir.path().join("out")), "--max-output-bytes", "1k"]);
    assert!(err.contains("--max-output-bytes"), "{err}");
    // A check tells what would stop the bake; as JSON with the estimate.
    let (_, err) = ends(1, &["check", SCENE, "--max-output-bytes", "1k"]);
    assert!(err.contains("--max-output-bytes"), "{err}");
    let (json, _) = ends(1, &["check", SCENE, "--max-output-bytes", "1k", "--json"]);
    assert!(json.contains("raise it with --max-output-bytes") && json.contains("\"would_make\": {"), "{json}");
    assert!(tree(dir.path()).is_empty());
}

#[test]
fn a_file_that_is_too_long_names_the_flag_of_its_limit() {
    let dir = folder();
    let told = |args: &[&str], flag: &str| {
        let (_, err) = ends(1, &[args, &[flag, "60"]].concat());
        let mut others =
            ["--max-text-bytes", "--max-mesh-bytes", "--max-json-bytes"].into_iter().filter(|f| *f != flag);
        assert!(err.contains(flag) && !others.any(|f| err.contains(f)), "{args:?}: {err}");
    };
    let long = "Lsystem: 1\nDerivation length: 1\nAxiom: F F F F F F F F F F F F\nendlsystem\n";
    let grammar = file(&dir, "long.l", long);
    told(&["check", arg(&grammar)], "--max-text-bytes");
    let scene = file(&dir, "scene.toml", "[plants.a]\ngrammar = \"long.l\"\n");
    told(&["check", arg(&scene)], "--max-text-bytes");
    let mesh = file(&dir, "long.obj", "v 0 0 0\n".repeat(20));
    told(&["info", arg(&mesh)], "--max-mesh-bytes");
    file(&dir, "manifest.json", format!("{{{}}}", " ".repeat(80)));
    told(&["info", arg(dir.path())], "--max-json-bytes");
}

#[test]
fn a_file_that_is_too_long_names_the_limit_of_its_kind() {
    let dir = folder();
    file(&dir, "long.l", fs::read(GRAMMAR).expect("grammar"));
    file(&dir, "long.obj", "v 0 0 0\n".repeat(20));
    for (key, flag) in [("grammar = \"long.l\"", "--max-text-bytes"), ("mesh = \"long.obj\"", "--max-mesh-bytes")] {
        let path = file(&dir, "a.toml", format!("[plants.a]\n{key}\n"));
        let (_, err) = ends(1, &["check", arg(&path), flag, "60"]);
        assert!(err.contains("S005") && err.contains("longer than 60 bytes") && err.contains(flag), "{err}");
        assert_eq!(err.matches("--max-").count(), 1, "{err}");
    }
}

#[test]
fn a_format_without_files_is_told() {
    let dir = folder();
    let out = dir.path().join("out");
    let bake = ["bake", "koch", "--formats", "obj,ply,csv,points", "-o", arg(&out)];
    let (_, err) = ends(0, &[&bake[..], &SMALL].concat());
    let told: Vec<&str> = err.lines().filter(|line| line.contains("has no file")).collect();
    assert!(
        told.len() == 3 && ["ply", "csv", "points"].iter().all(|word| err.contains(&format!("format {word} has"))),
        "{err}"
    );
    assert!(tree(&out).contains_key("obj/koch_1.obj"), "{err}");
}

#[test]
fn a_selection_of_frames_is_written_and_told() {
    let dir = folder();
    let out = dir.path().join("out");
    ends(0, &["bake", SCENE, "--formats", "pov", "--frames", "1-6:2", "-o", arg(&out)]);
    let frames = |out: &Path| tree(out).keys().filter(|p| p.starts_with("pov/frames/")).cloned().collect::<Vec<_>>();
    assert_eq!(frames(&out), [1, 3, 5].map(|f| format!("pov/frames/frame.000{f}.inc")));
    let text = fs::read_to_string(out.join("manifest.json")).expect("manifest");
    let manifest: Value = serde_json::from_str(&text).expect("json");
    assert_eq!((&manifest["time"]["step"], &manifest["time"]["end"]), (&2.into(), &6.into()));
}

#[test]
fn help_and_tables_read_as_they_did() {
    for command in ["", "bake", "grow", "preview", "check", "convert", "list", "new", "info"] {
        let args: Vec<&str> = [command, "--help"].into_iter().filter(|a| !a.is_empty()).collect();
        let name = if command.is_empty() { "help".into() } else { format!("help_{command}") };
        insta::assert_snapshot!(name, ends(0, &args).0);
    }
    for what in ["formats", "codes", "limits", "options", "presets"] {
        // By itself it is a part of this machine's.
        insta::assert_snapshot!(format!("list_{what}"), ends(0, &["list", what, "--max-memory", "16G"]).0);
    }
}

#[test]
fn words_find_options_by_the_beginnings_of_words() {
    let rain = ends(0, &["list", "options", "rain"]).0;
    assert!(rain.contains("\n[rain]") && rain.contains("raindrops") && !rain.contains("\n[terrain]"), "{rain}");
    let lattice = ends(0, &["list", "options", "wind.lattice"]).0;
    assert!(lattice.contains("\n[wind.lattice]") && !lattice.contains("\n[wind]"), "{lattice}");
}

#[test]
fn shells_and_man_learn_every_command() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let (text, _) = ends(0, &["completions", shell]);
        assert!(["bake", "preview", "max-memory"].iter().all(|word| text.contains(word)), "{shell}: {text}");
    }
    let (page, _) = ends(0, &["man"]);
    assert!(page.contains(".TH osier 1") && page.contains("Exit codes") && page.contains("bake"), "{page}");
    // Flags of the commands, in one page without references to others.
    let flags = ["\\-\\-sweep", "\\-\\-turntable", "\\-\\-thumbnails", "\\-\\-profile"];
    assert!(flags.iter().all(|flag| page.contains(flag)) && page.contains(".SH \"OSIER PREVIEW\""), "{page}");
    assert!(!page.contains("(1)") && page.matches(".ie ").count() == 1, "{page}");
}

#[test]
fn progress_json_makes_every_line_of_standard_error_an_object() {
    let dir = folder();
    let events = |code: i32, args: &[&str]| -> Vec<Value> {
        let (_, err) = ends(code, args);
        err.lines().map(|l| serde_json::from_str(l).unwrap_or_else(|e| panic!("{l}: {e}"))).collect()
    };
    let out = dir.path().join("out");
    let baked = events(0, &["bake", SCENE, "-o", arg(&out), "--progress", "json"]);
    let stages: Vec<&Value> = baked.iter().filter(|e| e["event"] == "progress").collect();
    assert!(stages.iter().any(|e| e["stage"] == "writing") && stages.len() > 5, "{baked:?}");
    for pair in stages.windows(2).filter(|pair| pair[0]["stage"] == pair[1]["stage"] && pair[1]["done"] != 0) {
        assert!(pair[0]["done"].as_u64() < pair[1]["done"].as_u64(), "{pair:?}");
    }
    assert!(stages.iter().all(|e| e["done"].as_u64() <= e["total"].as_u64().map(|n| n.max(1))), "{stages:?}");
    // Quiet suppresses no line of a program that asked for them, and a bake that is up to date says so.
    let again = events(0, &["bake", SCENE, "-o", arg(&out), "--progress", "json", "-q"]);
    assert!(again.iter().any(|e| e["event"] == "note"), "{again:?}");

    let text = "[plants.oak]\ngrammar = \"oak.l\"\nstepz = 3\n";
    let scene = file(&dir, "bad.toml", text);
    let wrong = events(1, &["bake", arg(&scene), "--progress", "json"]);
    assert_eq!((wrong.len(), &wrong[0]["event"], &wrong[0]["code"]), (1, &"error".into(), &"S002".into()));
    let [from, to] = [0, 1].map(|i| usize::try_from(wrong[0]["span"][i].as_u64().expect("a byte")).expect("a byte"));
    assert_eq!((&text[from..to], &wrong[0]["line"]), ("stepz", &3.into()));
    assert!(wrong[0]["help"].as_str().is_some_and(|h| h.contains("steps")) && wrong[0]["file"] == arg(&scene));
    let absent = events(1, &["bake", "nosuch", "--progress", "json"]);
    assert!(
        absent[0]["event"] == "error" && absent[0]["file"] == "nosuch" && absent[0]["span"].is_null(),
        "{absent:?}"
    );
    // Memory is watched beside the work, whose growth here takes longer than the first look.
    let large = events(1, &["bake", "landscape", "-o", arg(&out), "--max-memory", "2M", "--progress", "json"]);
    let is_told =
        |e: &Value| e["event"] == "error" && e["message"].as_str().is_some_and(|m| m.contains("--max-memory"));
    assert!(large.iter().any(is_told), "{large:?}");
    let refused = events(2, &["bake", SCENE, "--frames", "x", "--progress", "json"]);
    assert!(refused[0]["message"].as_str().is_some_and(|m| m.starts_with("--frames")), "{refused:?}");
}
