use proptest::prelude::*;

use super::*;
use crate::affine::Affine;

fn try_read(name: &str, text: &str) -> (Vec<Ifs>, Report) {
    match read(name, text.as_bytes(), &Limits::default()) {
        Ok(both) => both,
        Err(Error::Input(report)) => (Vec::new(), *report),
        Err(other) => panic!("{other}"),
    }
}

fn codes(text: &str) -> Vec<&'static str> {
    try_read("a.ifs", text).1.diagnostics.iter().map(|d| d.code).collect()
}

/// Maps of the first system.
fn maps(text: &str) -> Vec<Vec<f64>> {
    let (systems, report) = try_read("a.ifs", text);
    assert!(!report.has_errors(), "{report}");
    systems[0].maps.iter().map(|m| m.affine.coefficients(systems[0].dim)).collect()
}

const ROWS: &str = "  .5 0 0 .5 0 0 .5\n  .5 0 0 .5 1 0 .5\n";

#[test]
fn lexical_habits() {
    let plain = maps(&format!("a {{\n{ROWS}}}\n"));
    assert_eq!(plain, [[0.5, 0.0, 0.0, 0.5, 0.0, 0.0], [0.5, 0.0, 0.0, 0.5, 1.0, 0.0]]);
    let habits = [
        format!("; a comment\r\na {{; another\r\n{}}}\r\n", ROWS.replace('\n', "\r\n")),
        format!("\u{feff}a {{\n{ROWS}}}\n"),
        format!("a\t{{\n{}}}\n", ROWS.replace(' ', "\t")),
        format!("a {{\r{}}}\r", ROWS.replace('\n', "\r")),
        "a {\n+.5 0. -0 5e-1 0 0 .5 .5 0 0\n.5 1. 0 .5\n}".to_owned(),
        format!("comment {{ anything at all }}\na {{\n{ROWS}}}\n"),
        format!("a {{ ; {{ braces }} in comments\n{ROWS}}}\n\x1a garbage {{"),
        format!("IFS:a {{\n{ROWS}}}"),
    ];
    for text in &habits {
        assert_eq!(maps(text), plain, "{text:?}");
        assert_eq!(codes(text), [] as [&str; 0], "{text:?}");
    }
    let (systems, _) = try_read("a.ifs", &format!("Long_Name(3D) {{\n{} 1\n}}", "0.1 ".repeat(12)));
    assert_eq!((systems[0].name.as_str(), systems[0].dim), ("Long_Name", 3));
    assert_eq!(pick(&systems, Some("LONG_name"), "a.ifs").map(|s| s.dim).ok(), Some(3));
}

#[test]
fn without_a_header_the_columns_are_counted() {
    assert_eq!(maps(ROWS).len(), 2);
    let space = "1 0 0 0 1 0 0 0 1 0 0 0 1\n";
    assert_eq!(try_read("b.ifs", &space.repeat(2)).0[0].dim, 3);
    assert_eq!(try_read("b.ifs", &space.repeat(7)).0[0].dim, 3, "13 numbers on every line");
    assert_eq!(try_read("b.ifs", &"1 ".repeat(91)).0[0].dim, 2, "91 = 7 x 13");
    assert_eq!(try_read("folder/b.ifs", ROWS).0[0].name, "b");
}

/// One text for each code that reading can give.
fn faults() -> Vec<(&'static str, &'static str, String)> {
    let entry = |name: &str| format!("{name} {{\n{ROWS}}}\n");
    let many = |n: usize| format!("a {{\n{}}}\n", "  .5 0 0 .5 0 0 .01\n".repeat(n));
    vec![
        (
            "I002",
            "a.ifs",
            "<flame name=\"x\"><xform weight=\"1\" linear=\"1\" coefs=\".5 0 0 .5 0 0\"/></flame>".into(),
        ),
        ("I003", "a.ifs", format!("what is this\n{}", entry("a"))),
        ("I004", "a.ifs", entry("a (4D)")),
        ("I005", "a.ifs", format!("a {{\n{ROWS}  nan 0 0 .5 0 0 .5\n}}\n")),
        ("I006", "a.ifs", format!("a {{\n{ROWS}{}", entry("b"))),
        ("I007", "a.ifs", format!("a {{\n{ROWS}  .5 0 0 .5 0\n}}\n")),
        ("I008", "a.ifs", many(1001)),
        ("I009", "a.ifs", format!("a\n{{\n{ROWS}}}\n")),
        ("I010", "a.ifs", entry("a") + &entry("A")),
        ("I012", "a.ifs", "a {\n .5 0 0 .5 0 0 .3\n .5 0 0 .5 0 0 1\n}".into()),
        ("I013", "a.ifs", "a {\n .5 0 0 .5 0 0 -.3\n .5 0 0 .5 0 0 1\n}".into()),
        ("I014", "a.ifs", "a {\n .5 0 0 .5 0 0 .5\n .5 0 0 .5 0 0 .6\n}".into()),
        ("I015", "a.ifs", "a {\n .5 0 0 .5 0 0 0\n .5 0 0 .5 0 0 1\n}".into()),
        (
            "I030",
            "a.flame",
            "<flame name=\"x\"><xform weight=\"1\" spherical=\"1\" coefs=\".5 0 0 .5 0 0\"/></flame>".into(),
        ),
        (
            "I031",
            "a.flame",
            "<flame name=\"x\" mood=\"1\"><xform weight=\"1\" linear=\"1\" coefs=\".5 0 0 .5 0 0\"/></flame>".into(),
        ),
        ("I032", "a.ifs.toml", "[ifs]\nname = \"a\"\nmap = [{ abcdef = [0.5, 0, 0, 0.5, 0, 0], color2 = 1 }]\n".into()),
        ("I033", "a.ifs.toml", "[ifs]\nname = 3\nmap = [{ abcdef = [0.5, 0, 0, 0.5, 0, 0] }]\n".into()),
        ("I041", "a.ifs.toml", "[ifs]\nname = \"a\"\ndim = 3\nmap = [{ branch = { scale = 1.5 } }]\n".into()),
    ]
}

#[test]
fn every_code_has_its_words() {
    for (code, name, text) in faults() {
        let (_, report) = try_read(name, &text);
        assert!(report.diagnostics.iter().any(|d| d.code == code), "{code}: {report}");
        insta::assert_snapshot!(code, report.to_string());
    }
    let (systems, _) = try_read("a.ifs", &format!("fern {{\n{ROWS}}}"));
    let Err(Error::Input(report)) = pick(&systems, Some("ferm"), "a.ifs") else { panic!("found") };
    insta::assert_snapshot!("I001", report.to_string());
}

#[test]
fn codes_of_odd_tables_are_those_expected_and_no_more() {
    let cases: &[(&str, &[&str])] = &[
        ("a { .5 0 0 .5 0 0 1 }", &["I009", "I009"]),
        ("a {\n.5 0 0 .5 0 0 1}", &["I009"]),
        ("a {\n.5,0,0,.5,0,0,1\n}", &["I009"]),
        ("a {\n1,5 0 0 .5 0 0 1\n}", &["I009", "I007"]),
        ("a {\n}\n", &["I007"]),
        ("a {\n1e999 0 0 .5 0 0 1\n}", &["I005"]),
        ("a {\n1e13 0 0 .5 0 0 1\n}", &["I005"]),
        ("a {\n0x1 0 0 .5 0 0 1/2\n}", &["I005", "I005"]),
        ("a {\ninf -inf 0 .5 0 0 1\n}", &["I005", "I005"]),
        ("a_name_of_twenty_letters1 {\n.5 0 0 .5 0 0 1\n}\na_name_of_twenty_letters2 {\n.5 0 0 .5 0 0 1\n}", &["I009"]),
        ("a {\n.5 0 0 .5 0 0 1\n", &["I006"]),
        ("}", &["I003", "I007"]),
        ("", &["I007"]),
    ];
    for (text, want) in cases {
        assert_eq!(codes(text), *want, "{text}");
    }
    let report = try_read("a.ifs", &format!("a {{\n{} 1\n}}", "0.1 ".repeat(12))).1;
    assert!(report.diagnostics[0].help.as_deref().unwrap_or_default().contains("3D"), "{report}");
    // 13 numbers, of which one is missing in a row of the plane.
    let report = try_read("a.ifs", "a {\n0 0 0 .16 0 0 .01\n.85 .04 -.04 .85 0 1.6\n}\n").1;
    let help = report.diagnostics[0].help.as_deref().unwrap_or_default();
    assert!(help.contains("has 7 numbers") && !help.contains("3D"), "{report}");
}

#[test]
fn recovery_reads_what_follows_a_missing_brace() {
    let text = format!("a {{\n{ROWS}b {{\n{ROWS}c\n{{\n{ROWS}}}\n");
    let report = try_read("a.ifs", &text).1;
    let told: Vec<&str> = report.diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(told, ["I006", "I006", "I009"], "{report}");
}

#[test]
fn hostile_tables_are_refused_in_little_time() {
    let five_mb = format!("a {{ {} }}", "0.5 ".repeat(1_250_000));
    let (_, report) = try_read("a.ifs", &five_mb);
    assert!(report.diagnostics.iter().any(|d| d.code == "I008" || d.code == "I007"), "{report}");
    let junk = "x".repeat(5_000_000);
    assert!(try_read("a.ifs", &junk).1.has_errors());
    assert!(try_read("a.ifs", &"{".repeat(100_000)).1.has_errors());
    let big = format!("a {{\n{}}}", "  .5 0 0 .5 0 0 .01\n".repeat(10_000));
    assert!(try_read("a.ifs", &big).1.diagnostics.iter().any(|d| d.code == "I008"));
    let long = vec![b' '; (16 << 20) + 1];
    assert!(read("a.ifs", &long, &Limits::default()).is_err());
    assert!(try_read("a.flame", &format!("<flame>{}", "<a>".repeat(100_000))).1.has_errors());
    assert!(try_read("a.ifs.toml", &format!("[ifs]\nmap = {}", "[".repeat(100_000))).1.has_errors());
}

#[test]
fn a_flame_with_y_down_is_the_fern() {
    let rows = crate::tests::system("fern_leaf");
    let mut text = String::from("<flame name=\"fern\">");
    for m in &rows.maps {
        let c = m.affine.coefficients(2);
        let (a, b, d, e) = (c[0], -c[1], -c[2], c[3]);
        text += &format!(
            "<xform weight=\"{}\" linear=\"1\" coefs=\"{a} {d} {b} {e} {} {}\"/>",
            m.weight.unwrap_or(0.0),
            c[4],
            -c[5]
        );
    }
    let (systems, report) = try_read("fern.flame", &(text + "</flame>"));
    assert!(report.diagnostics.is_empty(), "{report}");
    for (a, b) in systems[0].maps.iter().zip(&rows.maps) {
        let difference = a
            .affine
            .coefficients(2)
            .iter()
            .zip(b.affine.coefficients(2))
            .fold(0.0_f64, |m, (x, y)| m.max((x - y).abs()));
        assert!(difference < 1e-12);
    }
}

#[test]
fn flames_keep_chaos_post_and_palette() {
    let text = "<flame name=\"x\" size=\"100 50\" scale=\"10\" center=\"1 2\" background=\"0 0 0\">\
        <xform weight=\".5\" linear=\".5\" coefs=\"1 0 0 1 2 4\" post=\"2 0 0 2 1 0\" chaos=\"0\" symmetry=\"1\"/>\
        <xform weight=\".5\" linear=\"1\" coefs=\".5 0 0 .5 0 0\" opacity=\"0\"/>\
        <finalxform linear=\"1\" coefs=\"1 0 0 1 1 0\"/>\
        <palette count=\"2\" format=\"RGB\">000000FFFFFF</palette></flame>";
    let (systems, report) = try_read("x.flame", text);
    assert!(report.diagnostics.is_empty(), "{report}");
    let s = &systems[0];
    assert_eq!(s.chaos, Some(vec![vec![0.0, 1.0], vec![1.0, 1.0]]));
    // 0.5 (x + (2, 4)) doubled and shifted by 1, with y turned up.
    assert_eq!(s.maps[0].affine, Affine::plane([1.0, 0.0, 0.0, 1.0, 3.0, -4.0]));
    assert_eq!((s.maps[0].speed, s.maps[1].opacity, s.palette.len()), (0.0, 0.0, 2));
    assert!(s.last.is_some() && s.view.is_some_and(|v| (v.width - 10.0).abs() < 1e-12 && v.center[1] < 0.0));
}

#[test]
fn every_encoding_of_a_flames_palette_is_read() {
    let palette = |element: &str| {
        let text =
            format!("<flame name=\"x\"><xform weight=\"1\" linear=\"1\" coefs=\".5 0 0 .5 0 0\"/>{element}</flame>");
        let (systems, report) = try_read("x.flame", &text);
        assert!(report.diagnostics.is_empty(), "{report}");
        systems[0].palette.clone()
    };
    // Red, then blue; 255 of sRGB is 1 in linear light.
    let want = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    for element in [
        "<palette count=\"2\" format=\"RGB\">FF0000 0000FF</palette>",
        "<palette count=\"2\" format=\"RGBA\">FF0000FF\n0000FF80</palette>",
        "<colors count=\"2\" data=\"00FF0000000000FF\"/>",
        "<color index=\"1\" rgb=\"0 0 255\"/><color index=\"0\" rgb=\"255 0 0\"/>",
    ] {
        let found = palette(element);
        let near = |(a, b): (&[f32; 3], &[f32; 3])| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-6);
        assert!(found.len() == 2 && found.iter().zip(&want).all(near), "{element}: {found:?}");
    }
}

#[test]
fn flames_without_names_are_numbered() {
    let flame = "<flame time=\"0\"><xform weight=\"1\" linear=\"1\" coefs=\".5 0 0 .5 0 0\"/></flame>";
    let (systems, report) = try_read("walk.flame", &format!("<flames>{flame}{flame}{flame}</flames>"));
    assert!(report.diagnostics.is_empty(), "{report}");
    let names: Vec<&str> = systems.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["walk", "walk_2", "walk_3"]);
}

#[test]
fn what_a_flame_switches_off_stays_off() {
    let text = "<flame name=\"x\"><xform weight=\"1\" linear=\"1\" coefs=\".5 0 0 .5 0 0\" color_speed=\"3\" opacity=\"2\"/>\
        <finalxform enabled=\"0\" linear=\"1\" coefs=\"1 0 0 1 9 0\"/></flame>";
    let (systems, report) = try_read("x.flame", text);
    assert!(report.diagnostics.is_empty(), "{report}");
    let s = &systems[0];
    assert_eq!((s.last, s.maps[0].speed, s.maps[0].opacity), (None, 1.0, 1.0));
    let (on, _) = try_read("x.flame", &text.replace("enabled=\"0\"", "enabled=\"1\""));
    assert!(on[0].last.is_some());
}

#[test]
fn tables_hold_every_form_of_map() {
    let text = "[ifs]\nname = \"t\"\nweights = \"equal\"\nchaos = [[1, 1], [0, 1]]\nmap = [\n\
        { rq = [0.6, 0.5, 40, 40], shift = [0, 0.48], p = 0.2, colour = \"#4f7a2b\" },\n\
        { abcdef = [0.5, 0, 0, 0.5, 1, 2], coord = 0.5, speed = 1, opacity = 0.5, leaf = false, stem = true },\n]\n\
        condensation = [{ disc = { center = [0, 0], radius = 2 }, weight = 0.1 }]\n";
    let (systems, report) = try_read("t.ifs.toml", text);
    assert!(report.diagnostics.is_empty(), "{report}");
    let s = &systems[0];
    assert_eq!((s.maps.len(), s.weights, s.condensation.len()), (2, Some(crate::weights::WeightRule::Equal), 1));
    let [r, q, alpha, _] = s.maps[0].affine.to_polar();
    assert!((r - 0.6).abs() < 1e-12 && (q - 0.5).abs() < 1e-12 && (alpha.to_degrees() - 40.0).abs() < 1e-9);
    assert!(s.maps[1].stem && !s.maps[1].leaf && s.maps[0].color.is_some());
    let both = "[[ifs]]\nname = \"a\"\nmap = [{ abcdef = [0.5, 0, 0, 0.5, 0, 0] }]\n\
        [[ifs]]\nname = \"b\"\nmap = [{ abcdef = [0.5, 0, 0, 0.5, 0, 0] }]\n";
    assert_eq!(try_read("t.ifs.toml", both).0.len(), 2);
}

#[test]
fn polygons_that_points_would_leave_and_other_dimensions_are_refused() {
    let codes = |dim: &str, polygon: &str| {
        let text = format!(
            "[ifs]\nname = \"t\"\ndim = {dim}\nmap = [{{ abcdef = [0.5, 0, 0, 0.5, 0, 0] }}]\n\
             condensation = [{{ polygon = {polygon}, weight = 0.1 }}]\n"
        );
        let (systems, report) = try_read("t.ifs.toml", &text);
        let codes: Vec<&str> = report.diagnostics.iter().map(|d| d.code).collect();
        assert_eq!(systems.is_empty(), !codes.is_empty(), "{report}");
        codes
    };
    // A square with a notch from above: the bottom of the notch sees every corner, the corner (0, 0) does not see (1, 1).
    assert_eq!(codes("2", "[[0.5, 0.1], [0, 1], [0, 0], [1, 0], [1, 1]]"), [] as [&str; 0]);
    assert_eq!(codes("2", "[[0, 0], [1, 0], [1, 1], [0.5, 0.1], [0, 1]]"), ["I033"]);
    // A pentagram crosses itself; a triangle with a corner on an edge, clockwise, is sound.
    assert_eq!(codes("2", "[[0, 1], [-0.6, -0.8], [0.95, 0.3], [-0.95, 0.3], [0.6, -0.8]]"), ["I033"]);
    assert_eq!(codes("2", "[[0, 0], [0, 0.3], [0, 0.9], [1, 0]]"), [] as [&str; 0]);
    assert_eq!(codes("4", "[[0, 0], [1, 0], [1, 1]]"), ["I033"]);
    assert_eq!(codes("2.0", "[[0, 0], [1, 0], [1, 1]]"), [] as [&str; 0]);
}

#[test]
fn keys_that_would_be_ignored_are_faults() {
    let codes = |map: &str, condensation: &str| {
        let text =
            format!("[ifs]\nname = \"t\"\nmap = [{{ {map} }}]\ncondensation = [{{ {condensation}, weight = 0.1 }}]\n");
        try_read("t.ifs.toml", &text).1.diagnostics.iter().map(|d| d.code).collect::<Vec<&str>>()
    };
    let (map, disc) = ("abcdef = [0.5, 0, 0, 0.5, 0, 0]", "disc = { center = [0, 0], radius = 0 }");
    assert_eq!(codes(map, disc), [] as [&str; 0]);
    assert_eq!(codes("abcdef = [0.5, 0, 0, 0.5, 0, 0], rq = [0.5, 0.5, 0, 0]", disc), ["I033"]);
    assert_eq!(codes("abcdef = [0.5, 0, 0, 0.5, 0, 0], shift = [1, 0]", disc), ["I033"]);
    assert_eq!(codes("rq = [0.5, 0.5, 0, 0], shift = [1, 0]", disc), [] as [&str; 0]);
    assert_eq!(codes(map, "disc = { center = [0, 0], breadth = 2 }"), ["I032"]);
    assert_eq!(codes(map, "disc = { center = [0, 0], radius = -1 }"), ["I041"]);
    assert_eq!(codes(map, "segment = { from = [0, 0], to = [0, 1], width = 1 }"), ["I032"]);
    assert_eq!(codes(map, "segment = { from = [0, 0], to = [0, 1], radius = -0.1 }"), ["I041"]);
    assert_eq!(codes(map, &format!("{disc}, polygon = [[0, 0], [1, 0], [0, 1]]")), ["I033"]);
    assert_eq!(codes(map, "disc = { radius = 1 }"), ["I033"]);
}

proptest! {
    #[test]
    fn any_bytes_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        for (name, start) in [("a.ifs", ""), ("a.flame", "<flame "), ("a.ifs.toml", "[ifs]\nname = \"a\"\nmap = [")] {
            let _ = read(name, &bytes, &Limits::default());
            let _ = read(name, &[start.as_bytes(), &bytes].concat(), &Limits::default());
        }
    }

    #[test]
    fn what_is_read_can_be_written(text in "[a-z]{1,9}( \\(3D\\))? \\{\n([ \n]*[-+]?[0-9]{0,3}\\.?[0-9]{1,9}(e-?[0-9])?[ \n]+){14,26}\\}") {
        use crate::weights::{WeightRule, probabilities};
        use crate::write::{TableItem, entries};
        let item = |s: &Ifs| TableItem { system: s.clone(), weights: probabilities(s, WeightRule::File).0, view: None };
        let Ok((systems, _)) = read("a.ifs", text.as_bytes(), &Limits::default()) else { return Ok(()) };
        let (first, _) = entries(&systems.iter().map(item).collect::<Vec<_>>());
        let (again, _) = read("b.ifs", first.as_bytes(), &Limits::default()).expect("reads its own");
        prop_assert_eq!(&entries(&again.iter().map(item).collect::<Vec<_>>()).0, &first);
        for (a, b) in systems.iter().zip(&again) {
            for (x, y) in a.maps.iter().zip(&b.maps) {
                prop_assert_eq!(x.affine.coefficients(a.dim), y.affine.coefficients(b.dim));
            }
        }
    }

    #[test]
    fn any_table_like_text_is_answered(text in "[-{}();.0-9e \n\"<>=a-z\\[\\]]{0,300}") {
        for name in ["a.ifs", "a.flame", "a.ifs.toml"] {
            let _ = read(name, text.as_bytes(), &Limits::default());
            let _ = read(name, format!("[ifs]\n{text}").as_bytes(), &Limits::default());
            let _ = read(name, format!("<flame>{text}").as_bytes(), &Limits::default());
        }
    }
}
