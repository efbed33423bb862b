//! Grammars of other programs: what they draw is counted and measured against the descriptions of the curves and of the commands.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests fail loudly and read their files")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use osier::diagnostic::{Report, Sources, Style, render};
use osier::grammar::{
    ConvertTo, DeriveOptions, FileKind, Grammar, GrammarSource, Notation, ReadAs, convert, derive, detect, entries,
    parse_as,
};
use osier::grow::turtle::{TurtleOptions, grow};
use osier::limits::Limits;
use osier::plant::Plant;
use osier::{Error, Result};

use crate::common::program::{arg, ends};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/grammars")
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(folder().join(name)).expect("a test grammar")
}

fn read_bytes(name: &str, bytes: &[u8], read_as: ReadAs<'_>) -> Result<(Grammar, String)> {
    let mut sources = Sources::default();
    let defines = BTreeMap::new();
    let mut includes = |r: &str, _: &str| Err(Error::io("open", r, std::io::Error::from(std::io::ErrorKind::NotFound)));
    let source =
        GrammarSource { name, bytes, includes: &mut includes, defines: &defines, functions: Default::default() };
    let (grammar, diagnostics) = parse_as(&mut sources, source, read_as, &Limits::default())?;
    Ok((grammar, render(&Report { sources, diagnostics, ..Report::default() }, Style::Plain)))
}

/// A test grammar that must be read; `entry`: empty for files of one.
fn read(name: &str, entry: &str) -> Grammar {
    let read_as = ReadAs { notation: None, entry: Some(entry).filter(|e| !e.is_empty()) };
    read_bytes(name, &bytes(name), read_as).unwrap_or_else(|e| panic!("{name} {entry}: {e}")).0
}

/// A text that must be read, by the notation that its name and content tell.
fn read_text(name: &str, text: &[u8]) -> Grammar {
    let read = read_bytes(name, text, ReadAs::default());
    read.unwrap_or_else(|e| panic!("{name}: {}: {e}", String::from_utf8_lossy(text))).0
}

/// What a text is refused with.
fn refused(name: &str, text: &str) -> String {
    match read_bytes(name, text.as_bytes(), ReadAs::default()) {
        Err(Error::Input(report)) => render(&report, Style::Plain),
        other => panic!("{name} is read: {other:?}"),
    }
}

/// A derived and drawn grammar.
struct Drawn {
    string: String,
    plant: Plant,
}

fn draw_steps(g: &Grammar, steps: Option<u32>) -> Drawn {
    let options = DeriveOptions { seed: 5, steps, ..DeriveOptions::default() };
    let derived = derive(g, &options, &Limits::default()).unwrap_or_else(|e| panic!("{e}"));
    let (plant, _) = grow(g, &derived, &TurtleOptions::default(), &Limits::default()).unwrap_or_else(|e| panic!("{e}"));
    Drawn { string: g.print(&derived.modules), plant }
}

fn draw(name: &str, entry: &str) -> Drawn {
    draw_steps(&read(name, entry), None)
}

impl Drawn {
    /// Segments of all axes.
    fn segments(&self) -> usize {
        self.plant.nodes.p.len() - self.plant.axes.len()
    }

    fn first(&self) -> glam::Vec3 {
        self.plant.nodes.p[0]
    }

    /// Last node of the first axis.
    fn end(&self) -> glam::Vec3 {
        self.plant.nodes.p[self.plant.nodes_of(&self.plant.axes[0]).end - 1]
    }

    /// The last node of all that were drawn without branches.
    fn last(&self) -> glam::Vec3 {
        self.plant.nodes.p[self.plant.nodes.p.len() - 1]
    }

    fn size(&self) -> glam::Vec3 {
        let p = &self.plant.nodes.p;
        let low = p.iter().fold(glam::Vec3::INFINITY, |m, p| m.min(*p));
        p.iter().fold(glam::Vec3::NEG_INFINITY, |m, p| m.max(*p)) - low
    }
}

fn near(a: glam::Vec3, b: [f32; 3], about: &str) {
    assert!((a - glam::Vec3::from(b)).length() < 2e-4, "{about}: {a} is not {b:?}");
}

const CURVES: &str = "fractint/curves.l";

/// Segments of each L-system at the order 4, from its rules.
const SEGMENTS: [(&str, usize); 28] = [
    ("Koch1", 256),              // 4^4
    ("Snowflake", 768),          // 3 * 4^4
    ("QuadricIsland", 16_384),   // 4 * 8^4
    ("Dragon", 8),               // those of the last step alone, 2^3
    ("Heighway", 16),            // 2 * 2^3
    ("Hilbert", 255),            // 4^4 - 1
    ("Moore", 1023),             // 4^5 - 1
    ("Peano1", 6561),            // 9^4
    ("PeanoGosper", 2400),       // 7^4 - 1
    ("SierpinskiTriangle", 876), // f' = 2 f + 12 * 3^(n-1), from 6
    ("Arrowhead", 81),           // 3^4
    ("Terdragon", 81),
    ("Levy", 16),
    ("Cantor", 16),
    ("Penrose3", 1780), // 90, 110, 110, 90 symbols of 5, 4, 4, 5 sides
    ("Bush", 4096),     // 8^4
    ("Weed", 146),      // f' = 2 f + 2 * 3^(n-1), from 1
    ("SmallerBranches", 40),
    ("HalfTurns", 5),
    ("Degrees", 4),
    ("Mirror", 4),
    ("Roots", 4),
    ("TwoParts", 16),
    ("Colours", 5),
    ("Co'Dd & name (50%)", 1),
    ("Unclosed", 2),
    ("Last", 3),
    ("last", 3),
];

#[test]
fn curves_of_fractint_have_their_known_number_of_segments() {
    let names = entries(CURVES, &bytes(CURVES));
    assert_eq!(names.len(), SEGMENTS.len() - 1, "{names:?}");
    for (name, n) in SEGMENTS {
        assert_eq!(draw(CURVES, name).segments(), n, "{name}");
    }
}

#[test]
fn curves_of_fractint_end_where_they_should() {
    for (name, end) in [
        ("Koch1", [81.0, 0.0, 0.0]),
        ("Hilbert", [15.0, 0.0, 0.0]),
        ("Moore", [0.0, 1.0, 0.0]),
        ("Peano1", [81.0, 0.0, 0.0]),
        ("Terdragon", [-4.5, -7.794_229, 0.0]), // 3^(4/2), turned by 4 * -30 degrees
        ("Levy", [4.0, 0.0, 0.0]),              // 2^(4/2)
        ("Mirror", [2.0, 0.0, 0.0]),
        ("Roots", [3.914_214, 0.0, 0.0]), // 1 + sqrt(2) + 1 + 1/2
        ("TwoParts", [-4.0, 0.0, 0.0]),   // (1 + i)^4
        ("Unclosed", [2.0, 0.0, 0.0]),
    ] {
        near(draw(CURVES, name).last(), end, name);
    }
    near(draw(CURVES, "Cantor").size(), [81.0, 0.0, 0.0], "Cantor");
    for name in ["Snowflake", "QuadricIsland", "HalfTurns", "Degrees"] {
        let curve = draw(CURVES, name);
        near(curve.last() - curve.first(), [0.0; 3], name);
    }
    // Fractint draws in the plane x-y, beginning to the right.
    assert!(SEGMENTS.iter().all(|(name, _)| draw(CURVES, name).size().z < 1e-6));
    near(draw(CURVES, "Hilbert").size(), [15.0, 15.0, 0.0], "Hilbert");
    near(draw(CURVES, "Snowflake").size(), [81.0, 93.530_74, 0.0], "Snowflake");
}

#[test]
fn strings_of_fractint_are_lower_case_and_commands_take_their_numbers() {
    assert_eq!(draw_steps(&read(CURVES, "Koch1"), Some(1)).string, "f+f--f+f");
    assert_eq!(draw(CURVES, "Koch1").string.len(), 256 + 340);
    let roots = draw(CURVES, "Roots").string;
    assert_eq!(roots, "f@(1.41421)f@(0.707107)f@(0.5)f");
    assert_eq!(draw(CURVES, "TwoParts").string.len(), 16 + 15 + 15);
    let colours = draw(CURVES, "Colours").plant;
    // What a command has coloured wears the index: the bits above it say so.
    let mut found: Vec<u16> = colours.nodes.color.iter().map(|c| c & 0xff).collect();
    found.sort_unstable();
    found.dedup();
    // 5, 5 - 2, 3 + 1, 9.
    assert_eq!(found, [3, 4, 5, 9]);
    assert!(colours.nodes.color.iter().all(|c| c & osier::plant::PAINTED != 0));
    // A command without a number leaves the index, which begins with 15; 0 is passed over; ';' and ',' stand for '<' and '>'.
    let last = |text: &str| {
        let g = read_text("c.l", text.as_bytes());
        draw_steps(&g, Some(0)).plant.nodes.color.last().map(|c| c & 0xff)
    };
    for (commands, index) in [("<F", 15), (">F", 15), ("<3F", 18), (">3F", 12), (">15F", 255), ("C255F<1F", 1)] {
        assert_eq!(last(&format!("C {{\nAngle 4\nAxiom F{commands}\n}}\n")), Some(index), "{commands}");
    }
    let own = |axiom: &str| {
        format!("Lsystem: 1\nturtle: fractint angle = 90\nderivation length: 0\nAxiom: {axiom}\nendlsystem\n")
    };
    assert_eq!((last(&own("f;(3)f")), last(&own("f,(3)f"))), (Some(18), Some(12)));
}

#[test]
fn lines_of_fractint_suit_the_picture() {
    for (name, _) in SEGMENTS {
        let Drawn { plant, .. } = draw(CURVES, name);
        let side = Drawn { string: String::new(), plant: plant.clone() }.size().max_element();
        let share = 2.0 * plant.nodes.r[0] / side;
        assert!((0.0019..=0.0081).contains(&share), "{name}: {share}");
        assert!(plant.nodes.r.iter().all(|r| (r - plant.nodes.r[0]).abs() < 1e-6), "{name}");
    }
}

#[test]
fn faults_of_fractint_are_told_with_their_places() {
    let of = |body: &str| refused("a.l", &format!("A {{\n Angle 4\n Axiom F\n{body}\n}}\n"));
    for (body, told) in [
        (" F=F F", "unexpected 'F' after the value"),
        (" +=F", "'+' is a command and cannot be replaced"),
        (" Angel 5", "unknown item 'Angel'"),
        (" F=F@F", "'@' without a factor"),
        (" Angle x", "the angle 'x' is not a number"),
    ] {
        let text = of(body);
        assert!(text.contains("error[L061]") && text.contains(told) && text.contains("a.l:4:"), "{text}");
        assert!(text.contains("help:"), "{text}");
    }
    let limits = format!("A {{\n Angle 60\n Axiom F\n F={}\n}}\n", "F+".repeat(90));
    let (_, warnings) = read_bytes("a.l", limits.as_bytes(), ReadAs::default()).expect("read");
    assert_eq!(warnings.matches("warning[L060]").count(), 2, "{warnings}");
    assert!(refused("a.l", "A {\n Axiom F\n}\n").contains("no angle"));
    let text = refused("a.l", "A {\n Angle x\n Axiom F\n}\n");
    assert!(text.contains("the angle 'x' is not a number") && !text.contains("no angle"), "{text}");
    // A brace behind an item is a fault of its line, and begins no entry.
    let text = of(" Angle 6 {");
    assert!(text.contains("unexpected '{'") && text.contains("a.l:"), "{text}");
    assert_eq!(entries("a.l", b"A {\n Angle 6 { ; six\n Axiom F\n}\nF {\n Angle 4\n Axiom F\n}\n"), ["A", "F"]);
    // Without its braces, its axiom or an own line for each item it is a file of Fractint all the same.
    for (file, told, at) in [
        ("Koch\n Angle 6\n Axiom F\n F=F+F\n", "stand in braces, which this one lacks", "a.l:2:2"),
        ("Koch (\n Angle 6\n Axiom F\n F=F+F\n)\n", "stand in braces, which this one lacks", "a.l:2:2"),
        ("Koch {\n Angle 6\n F=F+F\n}\n", "the L-system has no axiom", "a.l:1:1"),
        ("Koch { Angle 6 Axiom F F=F+F }\n", "unexpected 'Axiom F F=F+F' after the value", "a.l:1:16"),
        ("Koch { Angle 6, Axiom F, F=F+F }\n", "'Axiom F' stands behind a comma", "a.l:1:17"),
        ("Koch {\n Angle 6, Axiom F\n F=F+F\n}\n", "'Axiom F' stands behind a comma", "a.l:2:11"),
        ("Koch {\n F=F+F, Axiom F, Angle 6\n}\n", "'Axiom F' stands behind a comma", "a.l:2:9"),
    ] {
        let text = refused("a.l", file);
        assert!(text.contains("error[L061]") && text.contains(told) && text.contains(at), "{file}: {text}");
        assert!(!text.contains("Houdini") && !text.contains("L002"), "{file}: {text}");
        assert!(!file.contains(',') || text.matches("error[").count() == 1, "{file}: {text}");
    }
    // Cameras of POV-Ray have an angle, too.
    assert_eq!(detect("a.pov", b"camera {\n angle 45\n}\n"), FileKind::Other);
    let told = |file: &str| {
        let read_as = ReadAs { notation: None, entry: Some("Two") };
        let (g, warnings) = read_bytes("a.l", file.as_bytes(), read_as).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert_eq!(warnings.matches("warning[L008]").count(), 1, "{file}: {warnings}");
        (draw_steps(&g, Some(1)).string, warnings)
    };
    let two = "Two {\n Angle 4\n Axiom F\n F=F+F\n}\n";
    for (file, message) in [
        (format!("One\n Angle 6\n Axiom F\n F=F\n}}\n{two}"), "'Angle 6' stands outside of all braces"),
        (two.replace(" 4", " 4.5"), "4.5 is no whole number, 4 is taken"),
        (two.replace("Angle 4", "Angle 9\n angle = 4"), "a second angle replaces the first one"),
        (two.replace("Axiom F", "Axiom FF\n Axiom F"), "a second axiom replaces the first one"),
    ] {
        let (string, warnings) = told(&file);
        assert!(string == "f+f" && warnings.contains(message), "{file}: {string} {warnings}");
    }
    // An entry called `comment` is text.
    let named = b"comment {\n Axiom and angle are explained here.\n}\nOne {\n Angle 4\n Axiom F\n}\n";
    assert_eq!(entries("a.l", named), ["One"]);
    let several = refused("a.l", "Aa { Angle 4\nAxiom F\n}\nBb { Angle 4\nAxiom G\n}\n");
    assert!(several.contains("2 L-systems: Aa, Bb") && several.contains("a.l#Aa"), "{several}");
}

/// Segments and the end of the first axis, by hand. Axes: a step goes along +Y, left is -Z, up is -X.
const LPARSER: [(&str, usize, [f32; 3]); 21] = [
    ("axis.ls", 3, [0.0, 1.0, 0.0]),
    ("square.ls", 4, [0.0, 0.0, 0.0]),
    ("koch.ls", 64, [0.0, 27.0, 0.0]),
    ("tree.ls", 364, [0.0, 1.111_111, 0.0]), // (3^6 - 1) / 2 segments, the trunk 1/.9
    ("delay.ls", 3, [0.0, 3.0, 0.0]),
    ("numbers.ls", 1, [0.0, 0.0, -1.0]),
    ("halves.ls", 3, [0.0, 1.5, 0.0]),
    ("lengths.ls", 3, [0.0, 3.5, 0.0]), // 2.5 and 1; a gap and 1 follow
    ("leaf.ls", 1, [0.0, 1.0, 0.0]),
    ("fraction.ls", 3, [0.0, 2.5, 0.0]),
    ("keywords.ls", 8, [0.0, 4.0, 0.0]),    // F and the first F of each of 3 steps
    ("mixed.ls", 9, [-5.671_28, 1.0, 0.0]), // 9 sides of a polygon of 36, to its far point
    ("random.ls", 31, [0.0, 1.0, 0.0]),
    ("rolls.ls", 2, [0.984_808, 1.285_575, 1.173_648]),
    ("turnback.ls", 2, [0.0, 0.0, 0.0]),
    ("factors.ls", 6, [0.0, 5.35, 0.0]),
    ("first.ls", 1, [0.0, 1.0, 0.0]),
    ("long.ls", 5, [0.0, 5.0, 0.0]),
    ("crlf.ls", 2, [0.0, 1.0, -1.0]),
    ("nothing.ls", 1, [0.0, 1.0, 0.0]),
    ("settings.ls", 3, [0.0, 2.0, -1.0]),
];

#[test]
fn files_of_lparser_are_drawn_as_their_commands_say() {
    for (name, segments, end) in LPARSER {
        let file = format!("lparser/{name}");
        assert_eq!(detect(&file, &bytes(&file)), FileKind::Grammar(Notation::LParser), "{name}");
        // By its content too: the name tells nothing.
        assert_eq!(detect("x.txt", &bytes(&file)), FileKind::Grammar(Notation::LParser), "{name}");
        let drawn = draw(&file, "");
        assert_eq!(drawn.segments(), segments, "{name}: {}", drawn.string);
        if !["random.ls", "mixed.ls", "keywords.ls"].contains(&name) {
            near(drawn.end(), end, name);
        }
    }
    // The frame: step, left, up.
    let tips = draw("lparser/axis.ls", "").plant;
    let tips: Vec<glam::Vec3> = tips.axes.iter().map(|a| tips.nodes.p[tips.nodes_of(a).end - 1]).collect();
    for want in [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]] {
        assert!(tips.iter().any(|t| (*t - glam::Vec3::from(want)).length() < 1e-5), "{tips:?}");
    }
    near(draw("lparser/halves.ls", "").last(), [0.0, 5.0, 0.0], "halves");
    // To the left: left, -Z, sinks to where up, -X, was not, and up turns to -Z, where the pitch leads.
    let rolled = |axiom: &str| {
        let text = format!("1\n50\n1\n{axiom}\n@\n");
        draw_steps(&read_text("r.ls", text.as_bytes()), None).last()
    };
    near(rolled("<(90)^(90)F"), [0.0, 0.0, -1.0], "left");
    near(rolled(">(90)^(90)F"), [0.0, 0.0, 1.0], "right");
    // By the rotation matrices of LParser.
    near(rolled("<(90)^(90)F>(30)&(20)F+(10)F"), [0.4898, 0.5011, -2.8651], "turns");
    // Angles 50, 45 and 90: 50 degrees, factors .9 and 2.
    let (s50, c50, h) = (0.766_044_4, 0.642_787_6, std::f32::consts::FRAC_1_SQRT_2);
    near(draw("lparser/angles.ls", "").end(), [0.0, c50 + h, -s50 - h - 1.0], "angles");
    assert_eq!(draw("lparser/nothing.ls", "").string, "__A_F_");
    assert_eq!(draw("lparser/crlf.ls", "").string, "F+F+A");
    assert_eq!(draw("lparser/settings.ls", "").string, "FFa+F");
    assert_eq!(draw("lparser/leaf.ls", "").plant.organs.len(), 1);
    // Levelled, left is horizontal: a turn to it ends at the height of the turtle.
    assert!(draw("lparser/level.ls", "").end().y.abs() < 1e-6);
}

#[test]
fn a_levelled_turtle_of_lparser_turns_to_the_other_side() {
    let tip = |axiom: &str| {
        let text = format!("1\n50\n1\n{axiom}\n@\n");
        draw_steps(&read_text("l.ls", text.as_bytes()), None).last()
    };
    near(tip("&(60)+(90)F"), [0.0, 0.0, -1.0], "not levelled");
    // `$` makes left = heading x vertical and up = heading x left, of which up is not below: turns about up have the other sense.
    near(tip("&(60)$+(90)F"), [0.0, 0.0, 1.0], "levelled");
    near(tip("[&(60)$]+(90)F"), [0.0, 0.0, -1.0], "a branch");
    // Both have the length of the horizontal part, 1/2: the tangents of turns about them are halved. A turn about the one normalizes the other.
    near(tip("&(30)$+(45)F"), [0.447_214, 0.774_597, 0.447_214], "left");
    near(tip("&(30)$+(45)+(45)F"), [0.3, 0.519_615, 0.8], "left twice");
    near(tip("&(30)$&(45)F"), [0.834_512, 0.550_990, 0.0], "down");
    let h = std::f32::consts::FRAC_1_SQRT_2;
    near(tip("&(30)$&(45)+(45)F"), [0.590_089, 0.389_609, h], "down, then left");
    near(tip("&(30)$>(360)+(45)F"), [0.353_553, 0.612_372, h], "rolled, then left");
    near(tip("$+(90)F"), [0.0, 0.0, -1.0], "vertical");
}

#[test]
fn fractions_of_lparser_act_on_turns_numbers_and_thicknesses() {
    let of = |recursion: f32, rest: &str| {
        let text = format!("{recursion}\n90\n10\n{rest}\n@\n");
        read_bytes("f.ls", text.as_bytes(), ReadAs::default()).expect("read")
    };
    let drawn = |recursion: f32, rest: &str| draw_steps(&of(recursion, rest).0, None);
    // Turns of 90 and 45 degrees, steps of 1, 1 and 1/2.
    near(drawn(1.5, "FA\nA=+FA").end(), [0.0, 0.646_447, -1.353_553], "turn");
    // Numbers are reduced twice: 90 and 22.5 degrees, steps of 1, 1/2 and 1/8.
    near(drawn(1.5, "FA\nA=+(90)F(50)A").end(), [0.0, 0.952_165, -0.615_485], "numbers");
    // 1, .9 / 2 and again .9: the factor of the last step, .95, ends with what this step has made.
    near(drawn(1.5, "AF\nA=F'A").end(), [0.0, 2.35, 0.0], "factors");
    // A step of 1/2, half as thick for its length.
    let thin = drawn(0.5, "A\nA=F").plant.nodes.r[0];
    assert!((thin - 0.0125).abs() < 1e-6, "{thin}");
    // What rules of segments make is drawn in full, which is told where the fraction acts on other rules.
    near(drawn(1.5, "F\nF=FF").end(), [0.0, 4.0, 0.0], "segments");
    let told = |rest: &str| of(1.5, rest).1.contains("acts on what the rule of 'F' makes, too");
    assert!(told("FA\nF=FF\nA=+A") && !told("F\nF=FF") && !told("FA\nA=+A"));
}

#[test]
fn widths_of_lparser_are_shares_of_the_length() {
    let plant = draw("lparser/factors.ls", "").plant;
    // Half of the length, times .7, times 2.
    assert!((plant.nodes.r[0] - 0.25).abs() < 1e-6);
    assert!((plant.nodes.r[6] - 0.35).abs() < 1e-6, "{:?}", plant.nodes.r);
    // A half step is half as thick, and no segment is thinner than the least.
    let radii = |text: &str| {
        let g = read_text("x.ls", text.as_bytes());
        draw_steps(&g, None).plant.nodes.r
    };
    let halved = radii("1\n45\n40\nZ\n@\n");
    assert!((halved[0] - 0.1).abs() < 1e-6, "{halved:?}");
    let least = radii("recursion 1\nangle 45\nthickness 40\nmin_thickness 30\naxiom F(.5)\n");
    assert!((least[0] - 0.15).abs() < 1e-6, "{least:?}");
    let thin = draw("lparser/keywords.ls", "").plant;
    assert!((thin.nodes.r[0] - 0.04).abs() < 1e-6);
    assert_eq!(read("lparser/keywords.ls", "").palette(), [(1, [90, 60, 30]), (2, [40, 160, 60])]);
    let saved = "Axiom: F\nproduction:\nendlsystem\ndef __initialiseContext__(context):\n\timport openalea.plantgl.all as pgl\n\
                 \tColor_2 = pgl.Material(\"Color_2\" , ambient = (20,30,4) , diffuse = 2 , )\n\
                 \tcontext.turtle.setMaterial(2,Color_2)\n";
    let model = read_text("m.lpy", saved.as_bytes());
    assert_eq!(model.palette(), [(2, [40, 60, 8])]);
    let bent = draw("lparser/gravity.ls", "").plant;
    let n = bent.nodes.p.len();
    let last = (bent.nodes.p[n - 1] - bent.nodes.p[n - 2]).normalize();
    assert!(last.y < -0.7, "{last}");
    let (grown, length) = (draw("lparser/spiral.ls", ""), |p: &Plant| p.axes[0].length);
    // 1/.9 to the power 0, 1, .. 19, summed: (q^20 - 1) / (q - 1).
    assert!((length(&grown.plant) - 65.026).abs() < 0.01, "{}", length(&grown.plant));
}

#[test]
fn lengths_of_lparser_are_percent_of_a_step_in_files_of_bare_lines() {
    // The same drawing in both forms; also where commands spell the arrow of cpfg.
    let old = "2\n30\n10\nA\nA=F[--->F(40)][z(150)F]A\n@\n";
    let new = "recursion 2\nangle 30\nthickness 10\naxiom A\nrule A = F[--->F(.4)][z(1.5)F]A\n";
    let nodes = |text: &str| {
        let g = read_text("x.ls", text.as_bytes());
        assert_eq!(g.notation(), Notation::LParser);
        for to in [ConvertTo::Osier, ConvertTo::Cpfg] {
            assert!(converts(&g, to, "lengths"));
        }
        draw_steps(&g, None).plant.nodes.p
    };
    let (a, b) = (nodes(old), nodes(new));
    assert_eq!(a.len(), 11);
    assert!(a.iter().zip(&b).all(|(p, q)| (*p - *q).length() < 1e-6), "{a:?} {b:?}");
    // A number may have an exponent.
    assert_eq!(nodes(&old.replace("(40)", "(4e1)")), a);
}

#[test]
fn faults_of_lparser_are_told_with_their_places() {
    for (file, told) in [
        ("2\nthirty\n20\nA\nA=F\n@\n", "a.ls:2:1: expected the angle, found 'thirty'"),
        ("30\n20\nA\nA=F\n@\n", "a.ls:3:1: expected the thickness, found 'A'"),
        ("1\n30\n-20\nA\nA=F\n@\n", "a.ls:3:1: a thickness below 0"),
        ("color 2 300 255 0 0\naxiom A\nrule A = F\n", "a.ls:1:7: a color is an index and three numbers 0 to 255"),
        ("-1\n30\n20\nA\nA=F\n@\n", "a.ls:1:1: a recursion of -1 does not lie in 0 to 1,000,000"),
    ] {
        let text = refused("a.ls", file);
        let (place, message) = told.split_once(": ").expect("a place");
        assert!(text.matches("error[").count() == 1 && text.contains("error[L061]"), "{file}: {text}");
        assert!(text.contains(place) && text.contains(message) && text.contains("help:"), "{file}: {text}");
    }
    let warned = |rules: &str| {
        let text = format!("1\n30\n20\nA\n{rules}\n@\n");
        read_bytes("a.ls", text.as_bytes(), ReadAs::default()).unwrap_or_else(|e| panic!("{rules}: {e}")).1
    };
    for (rules, told, place) in [
        ("A F[+A]", "goes on with the axiom before it", "a.ls:5:1"),
        ("AB=F", "goes on with the axiom before it", "a.ls:5:1"),
        ("A=F\nFF", "goes on with the rule before it", "a.ls:6:1"),
        ("A=F(a)", "'(a)' is no number", "a.ls:5:4"),
        ("A=F(30", "'(' without ')'", "a.ls:5:4"),
        ("A=F(inf)", "'(inf)' is no number", "a.ls:5:4"),
        ("A=|(20)F", "'(20)' stands behind no command that takes a number", "a.ls:5:4"),
        ("A=F(1)(2)", "'(2)' stands behind no command that takes a number", "a.ls:5:7"),
    ] {
        let text = warned(rules);
        assert!(text.matches("warning[L008]").count() == 1, "{rules}: {text}");
        assert!(text.contains(told) && text.contains(place), "{rules}: {text}");
    }
    // Items that stand twice; a bare line behind the axiom goes on with it.
    for (lines, told, string) in [
        ("recursion 5\nrecursion 1\nangle 30\naxiom F", "a second recursion replaces the first one", "F+F"),
        ("recursion 1\nangle 30\nangle 40\naxiom F", "a second angle replaces the first one", "F+F"),
        ("recursion 1\nthickness 9\nthickness 8\naxiom F", "a second thickness replaces the first one", "F+F"),
        ("recursion 1\nmin_thickness 1\nmin_thickness 2\naxiom F", "a second min_thickness replaces", "F+F"),
        ("recursion 1\naxiom FFF\naxiom F", "a second axiom replaces the first one", "F+F"),
        ("recursion 1\naxiom F\nF", "goes on with the axiom before it", "F+FF+F"),
    ] {
        let text = format!("{lines}\nrule F = F+F\n");
        let (g, warnings) = read_bytes("a.ls", text.as_bytes(), ReadAs::default()).expect("read");
        assert!(warnings.matches("warning[L008]").count() == 1 && warnings.contains(told), "{lines}: {warnings}");
        assert_eq!(draw_steps(&g, None).string, string, "{lines}");
    }
    // Rules may make a number of what stands in parentheses, and the command before it.
    for rules in ["A=F(B)\nB=30", "A=B(30)\nB=F", "A=F(-1.5e1)+(.5)"] {
        let text = warned(rules);
        assert!(!text.contains("L008"), "{rules}: {text}");
    }
}

#[test]
fn polygons_of_lparser_begin_at_the_turtle_and_take_corners_of_moves() {
    let corners = |g: &Grammar| {
        let plant = draw_steps(g, None).plant;
        plant.organs.iter().map(|o| plant.protos[usize::from(o.proto)].mesh.points.len()).collect::<Vec<_>>()
    };
    let cases: [(&str, &[usize]); 8] = [
        ("{f+f+f}", &[4]),   // a square, of which the moves set three corners
        ("{f+f}", &[3]),     // a triangle
        ("{F+f+f+f}", &[3]), // `F` sets no corner, and the last move returns to the first one
        ("{Z+f+f}", &[3]),   // nor does `Z`
        ("{g+f+f}", &[3]),   // nor does `g`
        ("{f.+.f+f}", &[4]), // corners at one place are one
        ("{f[{+f+f}]+f+f}", &[3, 4]),
        ("{f}", &[]),
    ];
    for (polygon, count) in cases {
        let text = format!("1\n90\n10\nF{polygon}\n@\n");
        let g = read_text("p.ls", text.as_bytes());
        let mut found = corners(&g);
        found.sort_unstable();
        assert_eq!(found.as_slice(), count, "{polygon}");
        for to in [ConvertTo::Osier, ConvertTo::Cpfg] {
            assert!(converts(&g, to, polygon), "{polygon}");
            let text = convert(&g, to).expect("converted").text;
            let again = read_text("again.l", text.as_bytes());
            let mut found = corners(&again);
            found.sort_unstable();
            assert_eq!(found.as_slice(), count, "{polygon} as {to:?}");
        }
    }
}

#[test]
fn random_turns_of_lparser_belong_to_their_modules() {
    let g = read("lparser/random.ls", "");
    let at = |steps: u32| draw_steps(&g, Some(steps)).plant;
    assert_eq!(at(5).nodes.p, at(5).nodes.p);
    // A further step leaves what was drawn before in place.
    let (few, many) = (at(4), at(5));
    let known = |p: &glam::Vec3| many.nodes.p.iter().any(|q| (*p - *q).length() < 1e-6);
    assert!(few.nodes.p.iter().all(known));
    let seeds = |seed: u64| {
        let d = derive(&g, &DeriveOptions { seed, ..Default::default() }, &Limits::default()).expect("derives");
        grow(&g, &d, &TurtleOptions::default(), &Limits::default()).expect("drawn").0.nodes.p
    };
    assert_ne!(seeds(1), seeds(2));
}

#[test]
fn random_turns_of_lparser_without_a_number_take_any_direction() {
    let heights = |command: &str| {
        let text = format!("1\n30\n20\n{}\n@\n", format!("[{command}F]").repeat(40));
        let g = read_text("r.ls", text.as_bytes());
        let p = draw_steps(&g, None).plant.nodes.p;
        assert!(p.len() > 40);
        p.iter().map(|p| p.y).collect::<Vec<f32>>()
    };
    assert!(heights("~").iter().any(|y| *y < -0.3) && heights("~").iter().any(|y| *y > 0.3), "{:?}", heights("~"));
    // Two turns of 6 degrees leave a height of 0.97 and more.
    assert!(heights("~(6)").iter().all(|y| *y > 0.97 || y.abs() < 1e-6), "{:?}", heights("~(6)"));
}

#[test]
fn bare_lines_of_lparser_end_at_their_first_blank() {
    let drawn = |text: &str| {
        let (g, told) = read_bytes("b.ls", text.as_bytes(), ReadAs::default()).expect("read");
        (draw_steps(&g, None).string, told.matches("L008").count())
    };
    let old = |axiom: &str, rule: &str| drawn(&format!("1\n45 # degrees\n10 percent\n{axiom}\n{rule}\nB=F\n@\n"));
    assert_eq!(old("A", "A=FF"), ("FF".to_owned(), 0));
    assert_eq!(old("A the form", "A=FF # a line"), ("FF".to_owned(), 1));
    assert_eq!(old("A", "A=FB F=FFF"), ("FB".to_owned(), 1));
    assert_eq!(old("A all", "A=FF\ttwo of them"), ("FF".to_owned(), 2));
    // A rule that LParser could not read is taken as a whole; keywords take all of the line.
    assert_eq!(old("A", "A = F F"), ("FF".to_owned(), 0));
    assert_eq!(old("A", "A= F F"), ("FF".to_owned(), 0));
    assert_eq!(drawn("recursion 1\naxiom A A\nrule A=F F\n"), ("FFFF".to_owned(), 0));
}

#[test]
fn models_of_early_versions_of_l_py_are_read() {
    // `#` set the width; behind anything else it begins a comment.
    let model = |axiom: &str| format!("Axiom: {axiom}\nderivation length: 0\nproduction:\nendlsystem\n");
    let of = |axiom: &str| read_text("m.lpy", model(axiom).as_bytes());
    let plant = draw_steps(&of("#(0.05)F(1) #(0.2)F"), None).plant;
    assert_eq!((plant.nodes.p.len(), plant.nodes.r[0]), (2, 0.05));
    // The frame is three arrows: heading, left and up, which are +Y, +Z and +X of the world.
    let plant = draw_steps(&of("F(1)Frame(2)"), None).plant;
    let tips: Vec<glam::Vec3> = plant.axes.iter().map(|a| plant.nodes.p[plant.nodes_of(a).end - 1]).collect();
    for want in [[0.0, 3.0, 0.0], [0.0, 1.0, 2.0], [2.0, 1.0, 0.0]] {
        assert!(tips.iter().any(|t| (*t - glam::Vec3::from(want)).length() < 1e-5), "{tips:?}");
    }
    // A string without a drawing names its symbols as the file does.
    let g = of("UpReflexion SetWidth(2) SetWidth(3)");
    let derived = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let (_, warnings) = grow(&g, &derived, &TurtleOptions::default(), &Limits::default()).expect("grown");
    let told = warnings.iter().find(|d| d.code == "L037").expect("L037");
    assert!(told.message.contains("SetWidth (2 times), UpReflection (once)"), "{}", told.message);
}

#[test]
fn the_program_finds_out_what_a_file_is() {
    let out = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &[u8]| {
        let path = out.path().join(name);
        std::fs::write(&path, text).expect("written");
        path
    };
    let cpfg = b"/* a curve */\nLsystem: 1\nderivation length: 2\nAxiom: F(1)\nF(d) --> F(d)F(d)\nendlsystem\n";
    let tree = bytes("lparser/tree.ls");
    for (name, text) in
        [("koch.txt", &cpfg[..]), ("koch.lsys", &cpfg[..]), ("tree.txt", &tree[..]), ("noending", &cpfg[..])]
    {
        let glb = out.path().join(format!("{name}.glb"));
        let source = write(name, text);
        ends(0, &["grow", arg(&source), "-o", arg(&glb)]);
        assert!(glb.is_file(), "{name}");
    }
    // Shapes, species and tables too.
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (file, name) in
        [("shapes/tree.shapes", "a.txt"), ("species/oak.species", "b.txt"), ("ifs-tables/bamboo_leaf.ifs", "c.txt")]
    {
        let source = write(name, &std::fs::read(root.join(file)).expect("a preset"));
        ends(0, &["list", "knobs", arg(&source)]);
    }
    // A scene keeps its faults.
    let (_, err) = ends(1, &["check", arg(&write("scene.txt", b"[plants.a]\ngramar = \"oak.l\"\n"))]);
    assert!(err.contains("S002"), "{err}");
    let utf16: Vec<u8> = [0xff, 0xfe].into_iter().chain(cpfg.iter().flat_map(|b| [*b, 0])).collect();
    assert_eq!(detect("scene.toml", b"title = \"seed --> tree\"\n"), FileKind::Other);
    assert_eq!(detect("koch.txt", &utf16), FileKind::Grammar(Notation::Cpfg));
    let houdini = write("plant.txt", b"A=F[+A][-A]\n");
    let (_, err) = ends(1, &["check", arg(&houdini)]);
    assert!(err.contains("L007") && err.contains("Houdini") && err.contains("-->"), "{err}");
    let curves = write("curves.l", &bytes(CURVES));
    let of = |entry: &str| format!("{}{entry}", arg(&curves));
    let (said, _) = ends(0, &["check", &of("#Hilbert"), &of(":hilbert")]);
    assert_eq!(said.matches("curves.l").count(), 2, "{said}");
    let (_, err) = ends(1, &["check", &of("#Hilbrt")]);
    assert!(err.contains("did you mean \"Hilbert\"?"), "{err}");
    let (said, _) = ends(0, &["check", arg(&curves)]);
    assert_eq!(said.matches("curves.l#").count(), SEGMENTS.len() - 1, "{said}");
    let (said, _) = ends(0, &["info", arg(&curves)]);
    assert!(said.contains("notation of fractint") && said.contains("\n  Hilbert\n"), "{said}");
    // A scene names an entry, and the notation where the content does not tell.
    let scene = write(
        "s.toml",
        b"[plants.a]\ngrammar = \"curves.l#Hilbert\"\n[plants.b]\ngrammar = \"short.x\"\ndialect = \"lparser\"\n",
    );
    write("short.x", b"F\n");
    ends(0, &["check", arg(&scene)]);
    let short = write("short.y", b"axiom F\n");
    ends(0, &["check", "--dialect", "lparser", arg(&short)]);
    ends(1, &["check", "--dialect", "fractint", arg(&short)]);
    // Entries may lack a name.
    let unnamed = write("unnamed.l", b"{\n Angle 4\n Axiom F\n}\n{\n Angle 6\n Axiom F\n}\n");
    ends(0, &["check", "--dialect", "fractint", arg(&unnamed)]);
}

/// Strings that models of L-Py derive, by hand.
const LPY: [(&str, &str); 19] = [
    ("nested", "F(0)F(10)F(11)"),
    ("algae", "ABAABABA"),
    ("letters", "bFFd"),
    ("names", "F(1)[+(30)Leaf(2)]F(1)[+(30)Leaf(1)]Leaf(1)"),
    ("constants", "F(3)+(90)F(1.5)+(90)A(0.75)"),
    ("conditions", "B(10)C(9)A(-1)"),
    ("fallthrough", "C(1)B(7)"),
    ("loop", "F(1)[/(0)&(45)F(2)][/(90)&(45)F(2)][/(180)&(45)F(2)][/(270)&(45)F(2)]F(1)"),
    ("context", "AABA"),
    ("ignore", "B+F"),
    ("decomposition", "FFF"),
    ("slider", "FFFFA"),
    ("groups", "F"),
    ("expressions", "B(3,-4,2,512,-4,-2,1,1,2,3)"),
    ("block", "F[+(0)F][+(90)F][+(180)F]"),
    ("collect", "[/(90)L(9)][/(180)L(4)][/(270)L(5)]L(6)"),
    ("orders", "I(16)[I(81)]I(4)[I(9)]I(2)[I(3)]I(3)"),
    ("late", "I(12)I(3)A(3)"),
    ("seasons", "L(1)L(3)L(2)L(6)L(0)"),
];

#[test]
fn models_of_lpy_derive_the_strings_of_python() {
    for (name, string) in LPY {
        let file = format!("lpy/{name}.lpy");
        assert_eq!(detect("x.txt", &bytes(&file)), FileKind::Grammar(Notation::LPy), "{name}");
        assert_eq!(draw(&file, "").string, string, "{name}");
    }
    let interpretation = draw("lpy/interpretation.lpy", "");
    assert_eq!(interpretation.string, "Stem(1)Stem(2)Stem(2)Stem(4)");
    near(interpretation.end(), [0.0, 9.0, 0.0], "interpretation");
    // A production sees one random number, whichever way it takes.
    let random = draw("lpy/random.lpy", "").string;
    let values: Vec<(bool, f64)> = random
        .split_inclusive(')')
        .map(|m| (m.starts_with('B'), m[2..m.len() - 1].parse().expect("a number")))
        .collect();
    assert_eq!(values.len(), 40);
    assert!(values.iter().all(|(is_b, r)| *is_b == (*r < 0.5)), "{random}");
    assert!(values.iter().any(|v| v.0) && values.iter().any(|v| !v.0), "{random}");
}

#[test]
fn models_of_lpy_are_drawn_by_its_turtle() {
    let koch = draw("lpy/koch.lpy", "");
    assert_eq!(koch.segments(), 64);
    near(koch.end(), [0.0, 27.0, 0.0], "koch");
    // A step goes up, left is towards +Z; rolled to the left, left is where up was: +X.
    let frame = draw("lpy/frame.lpy", "").plant;
    let tips: Vec<glam::Vec3> = frame.axes.iter().map(|a| frame.nodes.p[frame.nodes_of(a).end - 1]).collect();
    for want in [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]] {
        assert!(tips.iter().any(|t| (*t - glam::Vec3::from(want)).length() < 1e-5), "{tips:?}");
    }
    // A node between segments of two radii has their mean; what sets a radius behind a segment does not change its end.
    let widths = draw("lpy/widths.lpy", "").plant;
    let near_all =
        |r: &[f32], want: &[f32]| r.len() == want.len() && r.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near_all(&widths.nodes.r, &[0.3, 0.35, 0.5]), "{:?}", widths.nodes.r);
    let model = |axiom: &str| format!("Axiom: {axiom}\nderivation length: 0\nproduction:\nendlsystem\n");
    for (axiom, want) in [
        ("SetWidth(0.4)F(1)SetWidth(0.2)F(1)_(0.1)", &[0.4, 0.3, 0.2][..]),
        ("_(0.3)F(1)_(0.1)[F(1)]", &[0.3, 0.3, 0.1, 0.1]),
        ("F(1,0.4)F(1,0.2)", &[0.1, 0.4, 0.2]),
        ("F(1)LineTo(0,0,3,0.4)", &[0.1, 0.1, 0.4]),
    ] {
        let g = read_text("m.lpy", model(axiom).as_bytes());
        let r = draw_steps(&g, None).plant.nodes.r;
        assert!(near_all(&r, want), "{axiom}: {r:?}");
    }
    let shapes = draw("lpy/shapes.lpy", "").plant;
    assert_eq!(shapes.organs.len(), 4);
    // 1, then half of 1; a line from (0, 1.5, 0) to x = 3, z = 1.5 of L-Py.
    let scale = draw("lpy/scale.lpy", "").plant;
    let reaches = |want: [f32; 3]| scale.nodes.p.iter().any(|p| (*p - glam::Vec3::from(want)).length() < 1e-5);
    assert!(reaches([0.0, 1.5, 0.0]) && reaches([0.0, 6.0, 0.0]) && reaches([3.0, 1.5, 0.0]), "{:?}", scale.nodes.p);
    let points = draw("lpy/points.lpy", "");
    assert_eq!(points.string, "F@M(1,0,2)LineTo(1,0,5)");
    near(points.last(), [1.0, 5.0, 0.0], "points");
    let tree = draw("lpy/tree.lpy", "");
    // 1 and 2^6 - 1 segments, 2^6 leaves.
    assert_eq!((tree.segments(), tree.plant.organs.len()), (64, 64));
}

#[test]
fn tropisms_of_lpy_bend_before_each_step() {
    let drawn = |axiom: &str| {
        let text = format!("Axiom: {axiom}\nderivation length: 0\nproduction:\nendlsystem\n");
        draw_steps(&read_text("m.lpy", text.as_bytes()), None)
    };
    // Left is +Z. Upwards unless the model says otherwise: half of 90 degrees; all of 120.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    near(drawn("Elasticity(0.5)+(90)F(1)").last(), [0.0, half, half], "half");
    near(drawn("Elasticity(1)+(120)F(1)").last(), [0.0, 1.0, 0.0], "all");
    near(drawn("@Ts(0.5)+(90)f(1)F(1)").last(), [0.0, 1.630_986, 1.089_79], "a move bends, too");
    near(drawn("Tropism(1,0,0)Elasticity(0.5)F(2)").last(), [2.0 * half, 2.0 * half, 0.0], "along x");
    // Against the tropism, about up (+X): -Y becomes -Z.
    near(drawn("Elasticity(0.5)|F(1)").last(), [0.0, 0.0, -1.0], "against it");
    near(drawn("Elasticity(2)+(90)F(1)").last(), [0.0, 0.0, 1.0], "not within 0 and 1");
    // The steps of a path bend one after the other: 45 and 22.5 degrees; the radius follows the length.
    let path = drawn("Elasticity(0.5)+(90)nF(2,1,0.3)");
    near(path.last(), [0.0, 1.630_986, 1.089_79], "path");
    let near_all =
        |r: &[f32], want: &[f32]| r.len() == want.len() && r.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near_all(&path.plant.nodes.r, &[0.1, 0.2, 0.3]), "{:?}", path.plant.nodes.r);
    // A path of a million steps is told.
    let long = b"Axiom: Elasticity(0.5)+(90)nF(1,0.000001)\nderivation length: 0\nproduction:\nendlsystem\n";
    let g = read_text("m.lpy", long);
    let derived = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let (_, told) = grow(&g, &derived, &TurtleOptions::default(), &Limits::default()).expect("drawn");
    assert!(told.iter().any(|d| d.code == "L008" && d.message.contains("more than 100000 steps")), "{told:?}");
    let straight = drawn("nF(2,0.5,0.3)F(1)").plant.nodes.r;
    assert!(near_all(&straight, &[0.1, 0.3, 0.3]), "{straight:?}");
}

#[test]
fn scales_of_lpy_multiply_what_is_drawn_behind_them() {
    let model = |axiom: &str| {
        let text = format!("Axiom: {axiom}\nderivation length: 0\nproduction:\nendlsystem\n");
        read_text("m.lpy", text.as_bytes())
    };
    for (axiom, radii) in [
        ("_(0.2)@D(2)F(1)", &[0.4, 0.4][..]),
        ("@D(2)_(0.2)F(1)@D(1)F(1)", &[0.4, 0.3, 0.2]),
        ("_(0.2)@Di(3)F(1)[@D(1)F(1)]", &[0.6, 0.6, 0.2, 0.2]),
        ("_F(1)", &[1.1, 1.1]),
        // 0.1 less 1 is no radius: the turtle keeps its own.
        ("!F(1)", &[0.1, 0.1]),
        ("F(1,-1)F(1)", &[0.1, 0.1, 0.1]),
    ] {
        let r = draw_steps(&model(axiom), None).plant.nodes.r;
        assert!(r.len() == radii.len() && r.iter().zip(radii).all(|(a, b)| (a - b).abs() < 1e-6), "{axiom}: {r:?}");
    }
    // Without a number half and double; 1 + 0.5 + 1. A move by a vector is not scaled: 1 + 2.
    near(draw_steps(&model("F@DiF@DdF"), None).last(), [0.0, 2.5, 0.0], "half");
    near(draw_steps(&model("@D(2)MoveRel(0,0,1)F(1)"), None).last(), [0.0, 3.0, 0.0], "moved");
    let g = model("!F(1)");
    let derived = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let (_, told) = grow(&g, &derived, &TurtleOptions::default(), &Limits::default()).expect("drawn");
    assert!(told.iter().any(|d| d.code == "L041" && d.message.contains("-0.9")), "{told:?}");
    // The command without a number is told, not the first one with its sign.
    let g = model("!(0.5)!F(1)");
    let derived = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let (_, told) = grow(&g, &derived, &TurtleOptions::default(), &Limits::default()).expect("drawn");
    assert!(told.iter().any(|d| d.code == "L041" && d.labels.first().is_some_and(|l| l.0.start == 13)), "{told:?}");
    assert!(converts(&model("F@DiF@DdF@D(3)F@DF"), ConvertTo::Cpfg, "scales"));
}

#[test]
fn interpretations_of_lpy_leave_out_what_is_cut() {
    let model = |rules: &str| {
        let text = format!(
            "Axiom: S(1)[+(90)S(2)%S(4)[S(8)]S(16)]S(32)%S(64)\nderivation length: 0\nproduction:\n{rules}\nendlsystem\n"
        );
        read_text("m.lpy", text.as_bytes())
    };
    let length = |g: &Grammar| draw_steps(g, None).plant.axes.iter().map(|a| a.length).sum::<f32>();
    // 1 + 2 + 32 are left, also where a production looks at what stands before a module.
    for rules in ["interpretation:\nS(x) --> F(x)", "interpretation:\nS(y) < S(x) --> F(x)\nS(x) --> F(x)"] {
        let g = model(rules);
        assert!((length(&g) - 35.0).abs() < 1e-4, "{rules}: {}", length(&g));
        assert!(draw_steps(&g, None).string.contains("%S(4)[S(8)]"), "{rules}");
        let notes = convert(&g, ConvertTo::Cpfg).expect("converted").notes;
        assert!(notes.iter().any(|n| n.contains("interpretation past %: off")), "{notes:?}");
    }
    // Without an interpretation L-Py draws all of it: 1 + 2 + 4 + 8.
    let plain = "Axiom: F(1)[+(90)F(2)%F(4)]F(8)\nderivation length: 0\nproduction:\nendlsystem\n";
    let g = read_text("m.lpy", plain.as_bytes());
    assert!((length(&g) - 15.0).abs() < 1e-4, "{}", length(&g));
}

#[test]
fn python_that_is_more_than_rules_is_refused_by_name() {
    let of = |rules: &str| {
        refused("m.lpy", &format!("Axiom: A(1)\nderivation length: 1\nproduction:\n{rules}\nendlsystem\n"))
    };
    for (rules, construct) in [
        ("A(x):\n  try:\n    x += 1\n  produce F", "'try' without 'except'"),
        ("A(x):\n  produce F(x.length)", "an attribute 'length'"),
        ("A(x) --> F([1,2])", "a list or an index"),
        ("A(x) --> F(foo(x))", "the function 'foo'"),
        ("A(x) --> F(y)", "the unknown name 'y'"),
        ("A(x):\n  for m in lstring:\n    nproduce F\n", "'for' over something other than range"),
        ("?F(f) --> F", "the query '?F'"),
        ("A(**rest) --> F", "'**rest' as the name of a parameter"),
        ("A(x) --> F(**x)", "'**', arguments by name"),
        (
            "class P:\n  def __add__(self, q): return 1\nA(x) --> F(P())",
            "the function 'P' (line 5: the function '__add__' of a class)",
        ),
    ] {
        let text = of(rules);
        assert!(
            text.contains("error[L007]: this is L-Py with Python code, line ") && text.contains(construct),
            "{text}"
        );
        assert!(text.contains("line 4") || text.contains("line 5"), "{text}");
    }
    // A value that no rule uses may be anything.
    let unused = "table = {1: 2}\nAxiom: F\nderivation length: 0\nproduction:\nendlsystem\n";
    assert!(read_bytes("m.lpy", unused.as_bytes(), ReadAs::default()).is_ok());
    let used = refused("m.lpy", &unused.replace("Axiom: F", "Axiom: F(table)"));
    assert!(used.contains("line 1: a dictionary"), "{used}");
}

/// A model of L-Py after `steps` steps.
fn lpy_string(axiom: &str, steps: u32, rules: &str) -> String {
    let text = format!("module B\nAxiom: {axiom}\nderivation length: {steps}\nproduction:\n{rules}\nendlsystem\n");
    let g = read_text("m.lpy", text.as_bytes());
    let options = DeriveOptions { seed: 5, ..DeriveOptions::default() };
    let turtle = TurtleOptions::default();
    let derived = osier::grow::turtle::derive(&g, &options, &turtle, &Limits::default()).expect("derives");
    derived.into_text(&g, &Limits::default()).expect("text").trim_end().to_owned()
}

#[test]
fn operands_of_and_and_or_are_values_as_in_python() {
    // What Python 3 prints for each expression with n = 3 and z = 0.
    for (expression, value) in [
        ("n or 7", "3"),
        ("z or 7", "7"),
        ("n and 7", "7"),
        ("z and 7", "0"),
        ("z or n-3 or 5 or 9", "5"),
        ("n > 2 and n", "3"),
        ("n > 5 and n", "0"),
        ("n > 2 or n", "1"),
        ("n > 5 or n", "3"),
        ("n and z or 4", "4"),
        ("n > 2 and n < 4", "1"),
        ("bool(n) + (n and n > 2)", "2"),
        ("not (n or z)", "0"),
    ] {
        let rules = format!("A(n,z) --> F({expression})");
        assert_eq!(lpy_string("A(3,0)", 1, &rules), format!("F({value})"), "{expression}");
    }
    // A test draws its random number once.
    let drawn = lpy_string("A(3)", 1, "A(n) --> F(random() < 2 and n)");
    assert_eq!(drawn, "F(3)");
    let chain = (0..60).map(|i| format!("n-{i}")).collect::<Vec<_>>().join(" and ");
    assert_eq!(lpy_string("A(100)", 1, &format!("A(n) --> F({chain})")), "F(41)");
}

#[test]
fn loops_of_lpy_run_as_those_of_python() {
    let counts = "A(n):\n  i = 0\n  while i < n:\n    nproduce F(i)\n    i += 1\n  produce +A(n+1)";
    assert_eq!(lpy_string("A(0)", 4, counts), "+F(0)+F(0)F(1)+F(0)F(1)F(2)+A(4)");
    // 1 + 3: two is passed over, and four ends the loop.
    let jumps = "A(n):\n  s = 0\n  i = 0\n  while True:\n    i += 1\n    if i == 2: continue\n    if i > n: break\n    s += i\n  \
                 produce F(s)";
    assert_eq!(lpy_string("A(3)", 1, jumps), "F(4)");
    // Loops over a parameter that only compute run as often as it says: 200 times 0 + 1 + 2.
    let nested = "A(n):\n  s = 0\n  for i in range(n):\n    for j in range(3):\n      s += j\n  produce F(s)";
    assert_eq!(lpy_string("A(200)", 1, nested), "F(600)");
    // A loop over constants ends early, or leaves a turn out.
    let early =
        "A:\n  for i in range(9):\n    if i == 1: continue\n    if i == 4: break\n    nproduce F(i)\n  produce G";
    assert_eq!(lpy_string("A", 1, early), "F(0)F(2)F(3)G");
    // What holds of a parameter is known in the turns: one way for each number of turns and each outcome.
    let last =
        "A(n):\n  for i in range(int(n)):\n    if i < n-1: nproduce [+(i)]\n    else: nproduce F(i)\n  produce G";
    assert_eq!(lpy_string("A(3)A(1)A(0)", 1, last), "[+(0)][+(1)]F(2)GF(0)GG");
    // Texts are compared; functions that L-Py runs see values that stand behind them, and a text describes a function.
    let texts = "A(n, kind):\n  if kind == 'main': produce F(n)A(n+1,\"side\")A(n+1,'main')\n  else: produce G";
    assert_eq!(lpy_string("A(0,'side')A(0,'main')", 1, texts).split("A(1").collect::<Vec<_>>().len(), 3);
    let later = "def StartEach():\n  global k\n  'counts'\n  k += 1\nk = 4\nAxiom: A\nderivation length: 2\nproduction:\n\
                 A --> F(k)A\nendlsystem\n";
    let g = read_text("m.lpy", later.as_bytes());
    assert_eq!(draw_steps(&g, None).string, "F(5)F(6)A");
    let endless = "Axiom: A\nderivation length: 1\nproduction:\nA:\n  i = 0\n  while i < 1:\n    x = 2\n  produce F\nendlsystem\n";
    let g = read_text("m.lpy", endless.as_bytes());
    let why = derive(&g, &DeriveOptions::default(), &Limits::default()).expect_err("endless").to_string();
    assert!(why.contains("L044") && why.contains("m.lpy:6:3"), "{why}");
}

#[test]
fn round_of_lpy_takes_the_even_neighbour_of_a_half() {
    let rule = "A(x): produce F(round(x))";
    let string = lpy_string("A(0.5)A(1.5)A(2.5)A(2.6)A(3.4)A(-0.5)A(-1.5)A(-2.5)", 1, rule);
    assert_eq!(string.replace("F(-0)", "F(0)"), "F(0)F(2)F(2)F(3)F(3)F(0)F(-2)F(-2)");
    assert_eq!(lpy_string("A", 1, "A: produce F(round(2.5))F(round(3.5))"), "F(2)F(4)");
}

#[test]
fn a_fraction_as_the_length_of_lpy_is_told() {
    let text = "Axiom: A\nderivation length: 2.7\nproduction:\nA: produce F(1)A\nendlsystem\n";
    let (g, report) = read_bytes("m.lpy", text.as_bytes(), ReadAs::default()).expect("read");
    assert!(report.contains("warning[L008]: 2.7 is no whole number, 2 is taken"), "{report}");
    assert_eq!(draw_steps(&g, None).string, "F(1)F(1)A");
}

#[test]
fn texts_of_lpy_are_no_numbers() {
    for value in ["int('3')", "'3'+1", "2*\"3\"", "max(1,'3')", "float('3')", "-'3'", "1 if x < '3' else 2"] {
        let text = format!("Axiom: A(1)\nderivation length: 1\nproduction:\nA(x): produce F({value})\nendlsystem\n");
        let said = refused("m.lpy", &text);
        assert!(
            said.contains("a text where a number is expected") && said.contains("without quotes"),
            "{value}: {said}"
        );
        assert!(said.contains("m.lpy:4:"), "{said}");
    }
    assert_eq!(lpy_string("A('x')", 1, "A(k): produce F(1 if k == 'x' else 2)"), "F(1)");
    // Under a name of the model, too.
    let model = |value: &str| {
        format!(
            "side = 'left'\nAxiom: A(side)\nderivation length: 1\nproduction:\nA(k): produce F({value})\nendlsystem\n"
        )
    };
    for value in ["side+1", "2*side", "-side", "max(1,side)", "int(side)", "1 if k < side else 2"] {
        let said = refused("m.lpy", &model(value));
        assert!(said.contains("a text where a number is expected") && said.contains("m.lpy:5:"), "{value}: {said}");
    }
    let g = read_text("m.lpy", model("1 if k == side and side != 'right' else 2").as_bytes());
    assert_eq!(draw_steps(&g, None).string, "F(1)");
}

#[test]
fn rows_of_parameters_of_lpy_stand_for_any_number() {
    let rules = "B(x, *rest): produce B(x+1, *rest)F(len(rest))\nA(*all):\n  produce A(*all)F(all[0])";
    assert_eq!(lpy_string("A(7)B(1,2)B(1,2,3)", 1, rules), "A(7)F(7)B(2,2)F(1)B(2,2,3)F(2)");
}

#[test]
fn new_contexts_of_lpy_see_what_the_step_made() {
    // The signal passes through the whole string in one step; the context of the string before it moves it by one.
    assert_eq!(lpy_string("CAAA", 1, "C << A --> C"), "CCCC");
    assert_eq!(lpy_string("CAAA", 1, "C < A --> C"), "CCAA");
    // Branches are passed over, and see the axis that carries them. Parameters are those of the new module.
    assert_eq!(lpy_string("C(1)[A]XA", 1, "C(n) << A --> C(n+1)\nX --> *"), "C(1)[C(2)]C(2)");
    assert_eq!(lpy_string("DCA", 1, "D << C < A --> E\nC --> *"), "DE");
    // The order of L-Py: the context of the string before the step stands outside.
    assert_eq!(lpy_string("ABC", 1, "A --> D\nA < D << B > C --> E"), "DEC");
}

#[test]
fn groups_of_lpy_are_active_in_their_steps() {
    let model = |each: &str| {
        format!(
            "def StartEach():\n{each}Axiom: AB\nderivation length: 3\nproduction:\nB --> BB\ngroup 1:\nA --> CA\ngroup 2:\n\
             A --> DA\nendgroup\nendlsystem\n"
        )
    };
    let string = |each: &str| {
        let g = read_text("m.lpy", model(each).as_bytes());
        draw_steps(&g, None).string
    };
    // The productions outside of groups apply in every step.
    let turns = "  if getIterationNb() < 2:\n    useGroup(1)\n  else:\n    useGroup(2)\n";
    assert_eq!(string(turns), "CCDABBBBBBBB");
    assert_eq!(string("  useGroup(2)\n"), "DDDABBBBBBBB");
    assert_eq!(string("  useGroup(3)\n"), "ABBBBBBBB");
    let wrong = model("  pass\n").replace("A --> CA", "A:\n  useGroup(2)\n  produce CA");
    let told = refused("m.lpy", &wrong);
    assert!(told.contains("useGroup") && told.contains("StartEach()"), "{told}");
}

#[test]
fn choices_of_lpy_take_each_item_as_often() {
    let text = "from random import *\nAxiom: A\nderivation length: 1\nproduction:\nA:\n  for i in range(900):\n    nproduce \
                B(choice([10,20,30]))\n  produce\nendlsystem\n";
    let g = read_text("m.lpy", text.as_bytes());
    let string = draw_steps(&g, None).string;
    // 300 of each, with a standard deviation of 14.
    for value in ["B(10)", "B(20)", "B(30)"] {
        let n = string.matches(value).count();
        assert!((240..=360).contains(&n), "{value}: {n}");
    }
    assert_eq!(string.matches('B').count(), 900);
}

#[test]
fn contexts_of_the_new_string_are_told_in_grammars_of_cpfg() {
    for (rule, sign, column) in
        [("A >> B --> C", "'>>'", 3), ("C << A --> C", "'<<'", 3), ("B(x) < A >> B(y) --> C", "'>>'", 10)]
    {
        let told = refused("m.l", &format!("Lsystem: 1\nderivation length: 1\nAxiom: AB\n{rule}\nendlsystem\n"));
        let place = format!("m.l:4:{column}");
        assert!(
            told.contains("L010") && told.contains(sign) && told.contains(&place) && told.contains("L-Py"),
            "{told}"
        );
    }
}

/// String of a model that L-Py rewrites from its end, after one step.
fn backward_string(axiom: &str, rules: &str) -> String {
    let head = "def Start(): backward()";
    let text = format!("{head}\nAxiom: {axiom}\nderivation length: 1\nproduction:\n{rules}\nendlsystem\n");
    let g = read_text("m.lpy", text.as_bytes());
    draw_steps(&g, None).string
}

#[test]
fn models_of_lpy_are_rewritten_from_their_end() {
    // The signal passes to the left through the whole string in one step; forward it would move by one module.
    assert_eq!(backward_string("AAAC", "A >> C --> C"), "CCCC");
    assert_eq!(backward_string("AAAC", "A > C --> C"), "AACC");
    assert_eq!(backward_string("ABC", "C --> D\nA < B >> D > C --> E"), "AED");
    // What a module becomes stands in its order, and its parameters are seen.
    assert_eq!(backward_string("AB", "B --> X(3)Y\nA >> X(n)Y --> Z(n)"), "Z(3)X(3)Y");
    // Branches to the right are passed over; in a branch nothing follows its end.
    assert_eq!(backward_string("A[F[G]A]A[F]C(1)", "A >> C(n) --> C(n+1)"), "C(3)[F[G]A]C(2)[F]C(1)");
    assert_eq!(backward_string("A[C]B", "A >> [C]B --> D"), "D[C]B");
    // The result does not depend on the number of threads or on where the direction is set.
    let text = "def StartEach():\n  backward()\nAxiom: AAC\nderivation length: 2\nproduction:\nC --> BC\nA >> B --> B\nendlsystem\n";
    let g = read_text("m.lpy", text.as_bytes());
    assert_eq!(draw_steps(&g, None).string, "BBBBC");
    // A production for the other direction is passed over, and told.
    let (_, told) = read_bytes(
        "m.lpy",
        b"Axiom: AB\nderivation length: 1\nproduction:\nA >> B --> B\nendlsystem\n",
        ReadAs::default(),
    )
    .expect("read");
    assert!(told.contains("L008") && told.contains("'>>'") && told.contains("m.lpy:4:1"), "{told}");
    assert_eq!(lpy_string("AB", 1, "A >> B --> B"), "AB");
}

#[test]
fn queries_of_lpy_are_answered_in_its_axes() {
    // +Z is up in L-Py.
    let limit = "A > ?P(x,y,z):\n  if z < 3: produce F(1)A";
    assert_eq!(lpy_string("A?P(0,0,0)", 5, limit), "F(1)F(1)F(1)A?P(0,0,3)");
    // Up by 1, then 2 along the left vector of the beginning, -y; up stays +x, left is down.
    let vectors = "?P(v):\n  produce P(v.x,v.y,v[2])\n?H(h): produce H(h.x,h.y,h.z)\n?U(u): produce U(u.x,u.y,u.z)\n\
                   ?L(l): produce L(l.x,l.y,l.z)";
    let text = lpy_string("F(1)+(90)F(2)?P(v)?H?U?L", 1, vectors);
    let wanted = [("P", [0.0, -2.0, 1.0]), ("H", [0.0, -1.0, 0.0]), ("U", [1.0, 0.0, 0.0]), ("L", [0.0, 0.0, -1.0])];
    for (letter, wanted) in wanted {
        let values = text.split(&format!("{letter}(")).nth(1).and_then(|t| t.split(')').next()).expect("a module");
        let values: Vec<f32> = values.split(',').map(|v| v.parse().expect("a number")).collect();
        assert!(values.len() == 3 && values.iter().zip(wanted).all(|(v, w)| (v - w).abs() < 1e-6), "{letter}: {text}");
    }
}

#[test]
fn interpretations_that_refer_to_themselves_are_converted_level_by_level() {
    let model = |depth: u32, axiom: &str, rules: &str| {
        let text = format!(
            "Axiom: {axiom}\nderivation length: 0\nproduction:\ninterpretation:\nmaximum depth: {depth}\n{rules}\nendlsystem\n"
        );
        read_text("m.lpy", text.as_bytes())
    };
    let halves = "F(x) --> F(x/2)+(30)F(x/2)";
    for (depth, segments) in [(1, 2), (2, 4), (3, 8), (10, 1024)] {
        let g = model(depth, "F(8)_(0.2)F(8)", halves);
        assert_eq!(positions(&g).0.len(), 2 * segments, "depth {depth}");
        assert!(converts(&g, ConvertTo::Cpfg, "self"), "depth {depth}");
    }
    // Deeper than any number of letters, and a branch that ends on a level of its own: 12 and 5 segments.
    let g = model(12, "_(0.2)A(20)", "A(n) --> F(1)+(20)A(n+1)");
    assert_eq!(positions(&g).0.len(), 12);
    assert!(converts(&g, ConvertTo::Cpfg, "deep"));
    let g = model(12, "_(0.2)F(5)", "F(x):\n  if x > 1: produce F(1)+(20)F(x-1)");
    assert_eq!(positions(&g).0.len(), 5);
    assert!(converts(&g, ConvertTo::Cpfg, "until it ends"));
}

#[test]
fn parameters_without_words_in_cpfg_are_refused_by_name() {
    for (name, text, told, place) in [
        ("m.ls", "3\n30\n20\nF(ab)G\nG=FF\n@\n", "parameter 1 of 'F'", "m.ls:4:1"),
        // The number belongs to what the rule makes of A.
        ("m.ls", "2\n45\n10\nFA(90)F\nA=+\n@\n", "parameter 1 of 'A'", "m.ls:4:2"),
        (
            "m.lpy",
            "Axiom: F(1)F(1e400)\nderivation length: 1\nproduction:\nF --> F\nendlsystem\n",
            "parameter 1 of 'F'",
            "m.lpy:1:12",
        ),
    ] {
        let g = read_text(name, text.as_bytes());
        for to in [ConvertTo::Cpfg, ConvertTo::Osier] {
            let Err(Error::Input(report)) = convert(&g, to) else { panic!("{text} is converted") };
            let said = render(&report, Style::Plain);
            assert!(said.contains("L061") && said.contains(told) && said.contains(place), "{said}");
        }
    }
}

#[test]
fn namesakes_and_faulty_entries_of_fractint_are_told() {
    let dir = tempfile::tempdir().expect("folder");
    let file = dir.path().join("s.l");
    let entry = |name: &str, rule: &str| format!("{name} {{\n Angle 6\n Axiom F\n {rule}\n}}\n");
    let text = entry("Koch", "F=F+F--F+F") + &entry("Bad", "+=F") + &entry("koch", "F=F-F++F-F");
    std::fs::write(&file, text).expect("written");
    let (names, _) = ends(0, &["list", arg(&file)]);
    assert!(names.contains("s.l#Koch\n") && names.contains("s.l#koch(2)"), "{names}");
    let (_, told) = ends(1, &["check", arg(&file)]);
    assert!(
        told.contains("warning[L062]") && told.contains("used again in line 11") && told.contains("s.l:1:1"),
        "{told}"
    );
    assert!(told.contains("s.l#koch(2)"), "{told}");
    // Entries without a name have the places of their braces; a name belongs to one brace.
    let unnamed = dir.path().join("u.l");
    let text = format!("Title\n{}{}{}", entry("", "F=FF"), entry("", "F=F+F"), entry("", "F=F-F"));
    std::fs::write(&unnamed, text).expect("written");
    let (names, told) = ends(0, &["list", arg(&unnamed)]);
    assert!(names.contains("u.l#Title\n") && names.contains("u.l#(2)"), "{names}{told}");
    let (_, told) = ends(0, &["check", arg(&unnamed)]);
    assert!(told.contains("this L-system has no name, nor has that in line 12") && told.contains("u.l:7:2"), "{told}");
    assert!(told.contains("write a name before each '{'") && !told.contains("\"\""), "{told}");
    // Each has its own drawing: the second one turns to the other side.
    let string = dir.path().join("s.txt");
    let drawn = |entry: &str| {
        ends(0, &["grow", &format!("{}#{entry}", arg(&file)), "--steps", "1", "-o", arg(&string), "--force"]);
        std::fs::read_to_string(&string).expect("string")
    };
    assert!(drawn("Koch").contains("f+f--f+f") && drawn("koch(2)").contains("f-f++f-f"));
    // A sheet leaves the faulty one out, and tells of it.
    let picture = dir.path().join("s.png");
    let (_, told) = ends(0, &["preview", arg(&file), "-o", arg(&picture), "--quality", "draft"]);
    assert!(told.contains("L061") && told.contains("s.l:9:2") && picture.exists(), "{told}");
    // It is one picture: a clip or a comparison takes one L-system.
    let clip = dir.path().join("s.gif");
    for flag in [["--turntable", "4"], ["--frames", "1-3"], ["--compare", "oak"]] {
        let output = if flag[0] == "--compare" { dir.path().join("t.png") } else { clip.clone() };
        let (_, told) = ends(2, &["preview", arg(&file), flag[0], flag[1], "-o", arg(&output), "--quality", "draft"]);
        assert!(told.contains(flag[0]) && told.contains("s.l#Koch") && !output.exists(), "{told}");
    }
}

/// Midpoints of all segments and number of organs of a grammar.
fn positions(g: &Grammar) -> (Vec<glam::Vec3>, usize) {
    let plant = draw_steps(g, None).plant;
    let of_axis = |a: &osier::plant::Axis| {
        let p = &plant.nodes.p[plant.nodes_of(a)];
        p.windows(2).map(|w| 0.5 * (w[0] + w[1])).collect::<Vec<_>>()
    };
    (plant.axes.iter().flat_map(of_axis).collect(), plant.organs.len())
}

/// Converts a grammar, reads the text again, and compares what both draw; false if the notation has no words for it.
fn converts(g: &Grammar, to: ConvertTo, about: &str) -> bool {
    let text = match convert(g, to) {
        Ok(converted) => converted.text,
        Err(Error::Input(report)) => {
            assert!(report.diagnostics.iter().all(|d| d.code == "L061" && d.help.is_some()), "{about}");
            return false;
        }
        Err(e) => panic!("{about}: {e}"),
    };
    let (again, _) = read_bytes("again.l", text.as_bytes(), ReadAs::default())
        .unwrap_or_else(|e| panic!("{about} as {to:?}: {e}\n{text}"));
    assert_eq!(again.notation(), Notation::Cpfg, "{about}");
    let (a, b) = (positions(g), positions(&again));
    assert_eq!((a.0.len(), a.1), (b.0.len(), b.1), "{about} as {to:?}\n{text}");
    // Siblings are in the order of their lineages, which hold the names of symbols: the points are compared as a set, by their order
    // along three directions.
    for direction in [[0.531, 0.713, 0.459], [-0.829, 0.331, 0.451], [0.171, -0.937, 0.305]] {
        let along = |points: &[glam::Vec3]| {
            let mut list: Vec<f32> = points.iter().map(|p| p.dot(glam::Vec3::from(direction))).collect();
            list.sort_unstable_by(f32::total_cmp);
            list
        };
        for (p, q) in along(&a.0).iter().zip(&along(&b.0)) {
            // Single precision of the largest curve, 81 units.
            assert!((p - q).abs() < 1e-5 * (1.0 + p.abs()), "{about} as {to:?}: {p} is not {q}\n{text}");
        }
    }
    true
}

#[test]
fn converted_grammars_draw_the_same() {
    let mut as_cpfg = 0;
    for (name, _) in SEGMENTS {
        let g = read(CURVES, name);
        assert!(converts(&g, ConvertTo::Osier, name), "{name}");
        let refused = name == "Mirror";
        assert_eq!(converts(&g, ConvertTo::Cpfg, name), !refused, "{name}");
        as_cpfg += usize::from(!refused);
    }
    assert_eq!(as_cpfg, SEGMENTS.len() - 1);
    // Random turns belong to modules, whose symbols have other names; a number behind a symbol that a rule makes is none of cpfg's.
    let files = std::fs::read_dir(folder().join("lparser")).expect("files");
    let mut names: Vec<String> = files.map(|f| f.expect("entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let not_as_osier = ["numbers.ls", "random.ls"];
    let not_as_cpfg = ["angles.ls", "gravity.ls", "numbers.ls", "random.ls", "fraction.ls", "level.ls"];
    for name in &names {
        let g = read(&format!("lparser/{name}"), "");
        if !not_as_osier.contains(&name.as_str()) {
            assert!(converts(&g, ConvertTo::Osier, name), "{name}");
        }
        if !not_as_cpfg.contains(&name.as_str()) {
            assert!(converts(&g, ConvertTo::Cpfg, name), "{name}");
        }
    }
    for name in ["angles.ls", "gravity.ls", "numbers.ls", "fraction.ls", "level.ls"] {
        assert!(!converts(&read(&format!("lparser/{name}"), ""), ConvertTo::Cpfg, name), "{name}");
    }
    for (name, _) in LPY {
        if name != "letters" {
            assert!(converts(&read(&format!("lpy/{name}.lpy"), ""), ConvertTo::Cpfg, name), "{name}");
        }
    }
    for name in ["koch", "frame", "widths", "interpretation", "tree"] {
        let g = read(&format!("lpy/{name}.lpy"), "");
        if name == "tree" {
            // Its leaves are those of L-Py, which a grammar of cpfg takes from the scene.
            assert!(convert(&g, ConvertTo::Cpfg).is_ok());
        } else {
            assert!(converts(&g, ConvertTo::Cpfg, name), "{name}");
        }
    }
    // Each pointer of Fractint turns by its own commands; cpfg has one.
    for (axiom, is_written) in [("F\\30+F/45F", true), ("D+\\30D|D", true), ("M\\30D-D", true), ("F+D\\30F", false)] {
        let text = format!("Turns {{\nAngle 12\nAxiom {axiom}\n}}\n");
        let g = read_text("t.l", text.as_bytes());
        assert_eq!(converts(&g, ConvertTo::Cpfg, axiom), is_written, "{axiom}");
    }
    // Numbers of LParser whose command stands in another rule have no place in a module.
    for rules in ["+AF\nA=(80)", "+(AF\nA=80)", "F(30"] {
        let text = format!("1\n45\n10\n{rules}\n@\n");
        let g = read_text("n.ls", text.as_bytes());
        for to in [ConvertTo::Osier, ConvertTo::Cpfg] {
            assert!(!converts(&g, to, rules), "{rules}");
        }
    }
    let notes = convert(&read("lparser/keywords.ls", ""), ConvertTo::Cpfg).expect("converted").notes;
    assert!(notes.iter().any(|n| n.contains("colours that the file sets")), "{notes:?}");
    assert!(notes.iter().any(|n| n.contains("least thickness")), "{notes:?}");
    // A drawing that branches becomes a tree, which stands in the ground.
    for (rule, count) in [("F=F[+F]F", 1), ("F=F+F", 0)] {
        let text = format!("Twig {{\nAngle 12\nAxiom F\n{rule}\n}}\n");
        let g = read_text("b.l", text.as_bytes());
        let notes = convert(&g, ConvertTo::Cpfg).expect("converted").notes;
        assert_eq!(notes.iter().filter(|n| n.contains("skin.bury")).count(), count, "{rule}: {notes:?}");
        assert!(convert(&g, ConvertTo::Osier).expect("converted").notes.is_empty());
    }
    // A roll at the end of a rule, which is a backslash in cpfg, joins no lines.
    let rolls = "Axiom: FA/\nderivation length: 2\nproduction:\nA --> B//\nB --> F^F/\nendlsystem\n";
    let g = read_text("m.lpy", rolls.as_bytes());
    assert!(converts(&g, ConvertTo::Cpfg, "rolls"));
    assert!(!converts(&read("lpy/scale.lpy", ""), ConvertTo::Cpfg, "scale"));
    assert!(!converts(&read("lpy/random.lpy", ""), ConvertTo::Cpfg, "random"));
}

/// A plant that was converted for osier stands as the file of the other program does, without root flare and foot; what is converted
/// to commands of cpfg gets both, with a note.
#[test]
fn converted_plants_have_no_root_flare_of_their_own() {
    let out = tempfile::tempdir().expect("a folder");
    let file = |name: &str| out.path().join(name);
    std::fs::write(file("pole.ls"), "2\n30\n20\nA\nA=FFFFA\n@\n").expect("a file");
    ends(0, &["convert", arg(&file("pole.ls")), "-o", arg(&file("pole.l"))]);
    let lowest_and_widest = |name: &str| {
        let mesh = file(&format!("{name}.obj"));
        ends(0, &["-q", "grow", arg(&file(name)), "-o", arg(&mesh)]);
        let text = std::fs::read_to_string(&mesh).expect("a mesh");
        let points = text.lines().filter_map(|line| line.strip_prefix("v "));
        let points: Vec<Vec<f64>> =
            points.map(|p| p.split(' ').map(|v| v.parse().expect("a number")).collect()).collect();
        let lowest = points.iter().map(|p| p[1]).fold(f64::MAX, f64::min);
        (lowest, points.iter().map(|p| p[0].hypot(p[2])).fold(0.0, f64::max))
    };
    let [own, converted] = ["pole.ls", "pole.l"].map(lowest_and_widest);
    assert!((own.0 - converted.0).abs() < 1e-6 && (own.1 - converted.1).abs() < 1e-6, "{own:?} {converted:?}");
    assert!(own.0 > -1e-6, "{own:?}");
    for name in ["lparser/keywords.ls", "lpy/tree.lpy"] {
        let notes = convert(&read(name, ""), ConvertTo::Cpfg).expect("converted").notes;
        assert!(notes.iter().any(|n| n.contains("skin.flare = 0")), "{name}: {notes:?}");
    }
}

#[test]
fn open_brackets_of_fractint_and_lparser_are_told() {
    let told = |name: &str, text: &str| read_bytes(name, text.as_bytes(), ReadAs::default()).expect("read").1;
    let fractint = |rules: &str| told("a.l", &format!("A {{\n Angle 6\n Axiom F\n{rules}}}\n"));
    let said = fractint(" F=F[+F]F[-F\n");
    assert!(said.contains("warning[L011]: this successor has 1 '[' without ']'"), "{said}");
    // Rules of one symbol are one successor.
    assert_eq!(fractint(" F=F[+F\n F=-F]F\n"), "");
    let lparser = |axiom: &str| told("a.ls", &format!("3\n20\n10\n{axiom}\nA=F[+A][-A]\n@\n"));
    let said = lparser("[[A");
    assert!(said.contains("warning[L011]: this axiom has 2 '[' without ']'"), "{said}");
    assert_eq!(lparser("[A]"), "");
}

#[test]
fn the_program_converts_grammars() {
    let source = format!("{}#Koch1", arg(&folder().join(CURVES)));
    let (text, _) = ends(0, &["convert", &source]);
    assert!(text.contains("turtle: fractint angle = 60") && text.contains("f --> f + f - - f + f"), "{text}");
    let out = tempfile::tempdir().expect("a folder");
    let file = out.path().join("koch.l");
    ends(0, &["convert", &source, "--to", "cpfg", "-o", arg(&file)]);
    ends(0, &["check", arg(&file)]);
    let (_, err) = ends(1, &["convert", &source.replace("Koch1", "Mirror"), "--to", "cpfg"]);
    assert!(err.contains("L061") && err.contains("'!'") && err.contains("--to osier"), "{err}");
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(96))]

    /// Any text is read as any notation without panic, and what is read is drawn and converted.
    #[test]
    fn any_soup_of_the_notations_is_read_without_panic(
        head in 0_usize..5,
        soup in "[-A-Za-z0-9 +&^/\\\\|\\[\\](){}<>@!?:;,.~%$'\"=#*_\n\u{e9}]{0,160}",
    ) {
        let heads = [
            "",
            "A {\nAngle 6\nAxiom F\n",
            "3\n20\n10\nA\n",
            "Axiom: A(1)\nderivation length: 2\nproduction:\n",
            "Axiom: A(1)\nproduction:\nA(x):\n  if x > 0:\n    produce ",
        ];
        let text = format!("{}{soup}\n", heads[head]);
        for notation in [Notation::Fractint, Notation::LParser, Notation::LPy] {
            let read_as = ReadAs { notation: Some(notation), entry: None };
            let Ok((g, _)) = read_bytes("soup.l", text.as_bytes(), read_as) else { continue };
            let _ = convert(&g, ConvertTo::Cpfg);
            let _ = convert(&g, ConvertTo::Osier);
            let options = DeriveOptions { steps: Some(2), ..DeriveOptions::default() };
            if let Ok(derived) = derive(&g, &options, &Limits::default()) {
                let _ = grow(&g, &derived, &TurtleOptions::default(), &Limits::default());
            }
        }
        let _ = (detect("soup.txt", text.as_bytes()), entries("soup.l", text.as_bytes()));
    }
}

#[test]
fn colours_of_other_programs_reach_the_files() {
    let dir = tempfile::tempdir().expect("dir");
    let draws = |name: &str, text: &str| {
        let (file, out) = (dir.path().join(name), dir.path().join("out.obj"));
        std::fs::write(&file, text).expect("written");
        ends(0, &["grow", arg(&file), "-o", arg(&out), "--force"]);
        let obj = std::fs::read_to_string(&out).expect("an OBJ");
        (obj, std::fs::read_to_string(dir.path().join("out.mtl")).expect("materials"))
    };
    // LParser: the file gives indices their colours; sRGB 255 is 1 in any encoding.
    let rules = "recursion 1\nangle 30\nthickness 20\ncolor 2 0 255 0\ncolor 5 255 0 0\naxiom FFF+c(5)FFF\n";
    let (obj, mtl) = draws("stems.ls", rules);
    let used: Vec<&str> = obj.lines().filter_map(|l| l.strip_prefix("usemtl ")).collect();
    assert!(used.iter().any(|m| m.ends_with("color_2")) && used.iter().any(|m| m.ends_with("color_5")), "{used:?}");
    assert!(mtl.contains("Kd 0 1 0") && mtl.contains("Kd 1 0 0"), "{mtl}");
    // Fractint: a colour index is worn from its command on.
    let (obj, _) = draws("two.l", "Two {\n Angle 4\n Axiom FFF+C4FFF\n F=F\n}\n");
    assert!(obj.contains("color_4"), "{}", obj.lines().filter(|l| l.starts_with("usemtl")).collect::<String>());
}

#[test]
fn listing_a_file_names_its_l_systems() {
    let dir = tempfile::tempdir().expect("dir");
    let file = dir.path().join("two.l");
    std::fs::write(&file, "One {\nAngle 4\nAxiom F\n}\nTwo {\nAngle 6\nAxiom F--F\n}\n").expect("written");
    let (listed, _) = ends(0, &["list", arg(&file)]);
    let names: Vec<&str> = listed.lines().filter_map(|l| l.split_once('#').map(|(_, n)| n)).collect();
    assert_eq!(names, ["One", "Two"]);
    // A word is still a word.
    assert!(ends(0, &["list", "limits"]).0.contains("modules"));
}

#[test]
fn the_program_draws_the_numbers_of_cpfg_and_prints_what_a_grammar_prints() {
    let dir = tempfile::tempdir().expect("dir");
    let (file, out) = (dir.path().join("draw.l"), dir.path().join("draw.txt"));
    let text = "Lsystem: 1\nSeed: 1\nEndEach: { printf(\"one step\\n\"); }\nderivation length: 1\nAxiom: AAAAAV\n\
                A --> B : 1\nA --> C : 3\nV --> V(ran(1))\nendlsystem\n";
    std::fs::write(&file, text).expect("written");
    let (_, err) = ends(0, &["grow", arg(&file), "--rng", "cpfg", "--seed", "9", "-o", arg(&out)]);
    // The choices of cpfg 6.6 for weights 1 and 3, and drand48 after srand48(0).
    assert_eq!(std::fs::read_to_string(&out).expect("a string").trim(), "BBBBCV(0.170828)");
    assert!(err.lines().any(|l| l == "one step"), "{err}");
    // A homomorphism prints while the plant is drawn.
    std::fs::write(
        &file,
        "Lsystem: 1\nderivation length: 0\nAxiom: A\nhomomorphism\nA : {printf(\"drawn\\n\");} 1 --> F(1)\nendlsystem\n",
    )
    .expect("written");
    let (_, err) = ends(0, &["grow", arg(&file), "-o", arg(&dir.path().join("draw.obj"))]);
    assert!(err.lines().any(|l| l == "drawn"), "{err}");
    // Another name is refused with the names that there are.
    let (_, err) = ends(1, &["check", arg(&file), "--rng", "lcg"]);
    assert!(err.contains("cpfg"), "{err}");
}

#[test]
fn a_comma_means_nothing_in_fractint() {
    // Old files end rules with quotes and commas.
    let text = "Curve { Angle 6\nAxiom F\nF=F+F\",\n,=F\n}\n";
    let grammar = read_text("curve.l", text.as_bytes());
    let d =
        derive(&grammar, &DeriveOptions { steps: Some(1), ..Default::default() }, &Limits::default()).expect("derives");
    let (plant, _) = grow(&grammar, &d, &TurtleOptions::default(), &Limits::default()).expect("draws");
    assert!(plant.nodes.color.iter().all(|c| *c == plant.nodes.color[0]), "{:?}", plant.nodes.color);
    // It is a symbol like any other: the second step replaces it.
    let d =
        derive(&grammar, &DeriveOptions { steps: Some(2), ..Default::default() }, &Limits::default()).expect("derives");
    let (plant, _) = grow(&grammar, &d, &TurtleOptions::default(), &Limits::default()).expect("draws");
    assert_eq!(plant.nodes.p.len() - plant.axes.len(), 5);
}
