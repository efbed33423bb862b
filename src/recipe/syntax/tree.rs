//! Scene text as a tree of keys and values with their spans, and overrides (`--set`) of it.

use std::path::Path;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use osier_base::diagnostic::{Diagnostic, Report, SourceId, Span};

/// A value with its span in the text.
#[derive(Debug, Clone, PartialEq)]
pub struct TomlNode {
    /// Bytes of the value in the text or in an override.
    pub span: Span,
    /// The value, in which nested values have spans too.
    pub value: TomlValue,
}

/// A TOML value, as far as scenes use its types.
#[derive(Debug, Clone, PartialEq)]
pub enum TomlValue {
    /// A string in quotes.
    Text(String),
    /// A whole number; those beyond 64 bits are refused while reading.
    Integer(i64),
    /// A number with a decimal point or an exponent; always finite.
    Number(f64),
    /// A boolean, `true` or `false`.
    Flag(bool),
    /// `[...]` or repeated `[[...]]`.
    List(Vec<TomlNode>),
    /// `{...}` or `[...]` header.
    Table(TomlTable),
    /// A date, or a damaged value, after whose error no key is read.
    Other,
}

impl TomlValue {
    /// Name of the value's type in messages, with its article.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Text(_) => "a text",
            Self::Integer(_) => "a whole number",
            Self::Number(_) => "a number",
            Self::Flag(_) => "true or false",
            Self::List(_) => "a list",
            Self::Table(_) => "a table",
            Self::Other => "a date",
        }
    }
}

/// A table with its entries in the order of the text.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TomlTable {
    /// Entries in the order of the text, then those that overrides have added.
    pub entries: Vec<TomlEntry>,
}

/// One entry of a table: key and value with their spans.
#[derive(Debug, Clone, PartialEq)]
pub struct TomlEntry {
    /// Name of the key, without quotes.
    pub key: String,
    /// Bytes of the key in the text.
    pub key_span: Span,
    /// The value with its span; a value that cannot be read is [`TomlValue::Other`].
    pub node: TomlNode,
}

impl TomlTable {
    /// The first entry with this key; nested tables are not searched.
    pub fn get(&self, key: &str) -> Option<&TomlEntry> {
        self.entries.iter().find(|e| e.key == key)
    }

    /// The table at a key; `None` where there is none, or another value.
    pub fn table(&self, key: &str) -> Option<&Self> {
        match &self.get(key)?.node.value {
            TomlValue::Table(table) => Some(table),
            _ => None,
        }
    }

    /// The tables of the list at a key; empty where there is none.
    pub fn tables(&self, key: &str) -> Vec<&Self> {
        let Some(TomlValue::List(list)) = self.get(key).map(|entry| &entry.node.value) else { return Vec::new() };
        list.iter()
            .filter_map(|node| if let TomlValue::Table(table) = &node.value { Some(table) } else { None })
            .collect()
    }

    /// Names of all keys, in the order of the entries.
    pub fn names(&self) -> Vec<&str> {
        self.entries.iter().map(|entry| entry.key.as_str()).collect()
    }

    /// Whether a key has a value that is not empty. If its reader gave an empty one, the value has a fault, which has been reported.
    pub fn holds(&self, key: &str) -> bool {
        match self.get(key).map(|e| &e.node.value) {
            None => false,
            Some(TomlValue::Text(text)) => !text.is_empty(),
            Some(TomlValue::List(list)) => !list.is_empty(),
            Some(TomlValue::Table(table)) => !table.entries.is_empty(),
            Some(_) => true,
        }
    }
}

/// Parses a scene file; every syntax error becomes an S001, and the readable part is returned.
pub fn parse(text: &str, source: SourceId, report: &mut Report) -> TomlTable {
    let (document, errors) = DeTable::parse_recoverable(text);
    for e in errors {
        if report.is_full() {
            break;
        }
        let at = e.span().unwrap_or(0..0);
        let message = e.message().lines().collect::<Vec<_>>().join(", ");
        let d = |at: std::ops::Range<usize>| {
            Diagnostic::error("S001", &message, Span::new(source, at.start, at.end), "here")
        };
        report.push(match misspelt_number(text, at.start) {
            Some((place, number)) => d(place.clone())
                .help("numbers have a decimal point with digits on both sides")
                .fix(Span::new(source, place.start, place.end), number),
            None => d(at).help(syntax_help(&message, report.sources.name(source))),
        });
    }
    table(document.get_ref(), source, report)
}

/// A number at a byte of the text that TOML refuses, with its place and the number that is meant: `3,5` with a decimal comma, `.4`
/// and `4.` without a digit beside the point. `None` for anything else, such as the list `1, 2, 3` without brackets.
fn misspelt_number(text: &str, at: usize) -> Option<(std::ops::Range<usize>, String)> {
    let is_part = |c: char| c.is_ascii_digit() || matches!(c, '.' | ',' | '+' | '-');
    let before = text.get(..at)?;
    let start = before.trim_end_matches(is_part).len();
    let end = at + text[at..].find(|c| !is_part(c)).unwrap_or(text.len() - at);
    let is_number = |t: &str| !t.is_empty() && t.chars().all(|c| c.is_ascii_digit());
    let signed = |word: &str| word.len() - word.trim_start_matches(['+', '-']).len();
    // A decimal comma is corrected only in the single value of a key, since in a list a comma separates numbers.
    let word = &text[start..end];
    let (sign, digits) = word.split_at(signed(word));
    if let Some((whole, rest)) = digits.split_once(',').filter(|(whole, rest)| is_number(whole) && is_number(rest)) {
        let is_value = before[..start].trim_end_matches([' ', '\t']).ends_with('=');
        return is_value.then(|| (start..end, format!("{sign}{whole}.{rest}")));
    }
    // A point without digits before or after it; in a list, examine only the number at the place of the error.
    let start = text[start..at].rfind(',').map_or(start, |comma| start + comma + 1);
    let end = text[at..end].find(',').map_or(end, |comma| at + comma);
    let word = &text[start..end];
    let (sign, digits) = word.split_at(signed(word));
    let mended = match digits.split_once('.')? {
        ("", rest) if is_number(rest) => format!("0.{rest}"),
        (whole, "") if is_number(whole) => format!("{whole}.0"),
        _ => return None,
    };
    Some((start..end, format!("{sign}{mended}")))
}

/// Help for a syntax error of a scene, by the parser's message and the name of the file.
fn syntax_help(message: &str, name: &str) -> &'static str {
    if message.contains("escaped value") || message.contains("unicode") {
        return "in \"quotes\" a backslash begins an escape: write '/' between folders, or the text in 'single quotes'";
    }
    if message.starts_with("duplicate key") {
        return "a key stands once in a table, and a table once in a scene: leave out one of the two; of several plants each has a name of its own";
    }
    // `5cm`, `(1, 2, 3)`, `yes`.
    if message.starts_with("string values must be quoted") || message.starts_with("unexpected key or value") {
        return "write texts in \"quotes\", numbers as 0.5 and without a unit, lists as [1, 2, 3], and true or false";
    }
    let ending = Path::new(name).extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    match ending.as_deref() {
        None | Some("toml") => "a scene is TOML: [table] headers, key = value lines, texts in \"quotes\"",
        Some("species" | "shapes") => "such a file is TOML: key = value lines, texts in \"quotes\"",
        Some(_) => {
            "this file is read as a scene, which is TOML and ends with .toml; grammars end with .l (cpfg, Fractint), .ls \
             (LParser) or .lpy (L-Py)"
        }
    }
}

fn table(map: &DeTable<'_>, source: SourceId, report: &mut Report) -> TomlTable {
    let mut entries: Vec<TomlEntry> = map
        .iter()
        .map(|(key, value)| {
            let at = key.span();
            TomlEntry {
                key: key.get_ref().to_string(),
                key_span: Span::new(source, at.start, at.end),
                node: node(value, source, report),
            }
        })
        .collect();
    // The parser returns keys in the order of their names; diagnostics and plants follow the order of the file.
    entries.sort_by_key(|e| e.key_span.start);
    TomlTable { entries }
}

fn node(value: &Spanned<DeValue<'_>>, source: SourceId, report: &mut Report) -> TomlNode {
    let at = value.span();
    let span = Span::new(source, at.start, at.end);
    let bad = |report: &mut Report, message: &str, help: &str| {
        // A number that the parser has already refused is reported only once.
        let is_told = |d: &Diagnostic| {
            d.code == "S001"
                && d.labels.iter().any(|(s, _)| s.source == source && (span.start..=span.end).contains(&s.start))
        };
        if report.diagnostics.iter().any(is_told) {
            return TomlValue::Other;
        }
        report.push(Diagnostic::error("S003", message, span, "this value").help(help));
        TomlValue::Other
    };
    let value = match value.get_ref() {
        DeValue::String(s) => TomlValue::Text(s.to_string()),
        DeValue::Integer(i) => match i64::from_str_radix(&i.as_str().replace('_', ""), i.radix()) {
            Ok(v) => TomlValue::Integer(v),
            Err(_) => bad(report, "whole number beyond 64 bits", "seeds this large are written as \"text\""),
        },
        DeValue::Float(f) => match f.as_str().replace('_', "").parse::<f64>() {
            Ok(v) if v.is_finite() => TomlValue::Number(v),
            _ => bad(report, "number is not finite", "write a finite decimal such as 0.5 or 1e-3"),
        },
        DeValue::Boolean(b) => TomlValue::Flag(*b),
        DeValue::Datetime(_) => TomlValue::Other,
        DeValue::Array(list) => TomlValue::List(list.iter().map(|v| node(v, source, report)).collect()),
        DeValue::Table(t) => TomlValue::Table(table(t, source, report)),
    };
    TomlNode { span, value }
}

/// A key as an element of the path of an override: in quotes if it is empty or holds a dot or an equals sign.
pub fn path_element(key: &str) -> String {
    if key.is_empty() || key.contains(['.', '=']) { format!("\"{key}\"") } else { key.to_owned() }
}

/// Splits a text at the first `mark` outside quotes; `None` without one.
fn split_outside_quotes(text: &str, mark: char) -> Option<(&str, &str)> {
    let mut is_quoted = false;
    let at = text.char_indices().find(|(_, c)| {
        is_quoted ^= *c == '"';
        *c == mark && !is_quoted
    });
    at.map(|(i, _)| (&text[..i], &text[i + mark.len_utf8()..]))
}

/// The elements of the path of an override, without the quotes around them, each with its place in the override.
fn path_elements(path: &str, source: SourceId) -> Vec<(&str, Span)> {
    let mut elements = Vec::new();
    let (mut rest, mut start) = (Some(path), 0);
    while let Some(text) = rest {
        let (element, after) = split_outside_quotes(text, '.').map_or((text, None), |(a, b)| (a, Some(b)));
        let bare = element.trim();
        let first = start + element.len() - element.trim_start().len();
        let name = bare.strip_prefix('"').and_then(|b| b.strip_suffix('"')).unwrap_or(bare);
        elements.push((name, Span::new(source, first, first + bare.len())));
        start += element.len() + 1;
        rest = after;
    }
    elements
}

/// Applies `path = value` (one override) to a tree; `flag` names it in messages. Path elements are table keys, in quotes if they have dots, or, in lists,
/// indices from 0; missing tables are created.
pub fn apply_override(root: &mut TomlTable, flag: &str, assignment: &str, report: &mut Report) {
    let source = report.sources.add(flag, assignment);
    let whole = Span::new(source, 0, assignment.len());
    let Some((path, text)) = split_outside_quotes(assignment, '=') else {
        let d = Diagnostic::error("S001", "an override is written path=value", whole, "no '=' here");
        report.push(d.help("for example --set wind.speed=6"));
        return;
    };
    // The value of the override is parsed as TOML with spans that point into the assignment.
    let offset = path.len() + 1;
    let value = override_value(text.trim(), Span::new(source, offset, assignment.len()), report);
    let names = path_elements(path, source);
    let node = TomlNode { span: Span::new(source, offset, assignment.len()), value };
    if !put(root, &names, node) {
        let d = Diagnostic::error(
            "S002",
            format!("\"{}\" is not a key or a list element", path.trim()),
            whole,
            "this path",
        );
        report.push(d.help(path_help(root, &names)));
    }
}

/// Help for the path of an override that leads nowhere.
fn path_help(root: &TomlTable, names: &[(&str, Span)]) -> String {
    let Some((at, elements)) = list_on_path(root, names) else {
        return "separate path elements by '.'; list elements are numbered from 0".to_owned();
    };
    let join = |range: std::ops::Range<usize>| {
        names.get(range).unwrap_or_default().iter().map(|(name, _)| *name).collect::<Vec<_>>().join(".")
    };
    let list = join(0..at);
    match names.get(at) {
        Some((name, _)) if name.parse::<usize>().is_err() => {
            // An element that has this name, such as a wall of [[solid]], can also be addressed by its number.
            match elements.iter().position(|element| has_name(element, name)) {
                Some(i) if names.len() > at + 1 => {
                    let key = join(at + 1..names.len());
                    format!("{list} is a list, whose elements are numbered from 0: \"{name}\" is {list}.{i}.{key}")
                }
                _ => format!("{list} is a list: name one of its elements, which are numbered from 0: {list}.0.{name}"),
            }
        }
        _ => {
            let length = elements.len();
            format!("{list} has {length} element{}, numbered from 0", if length == 1 { "" } else { "s" })
        }
    }
}

/// Whether a list element is a table with this value of the key `name`.
fn has_name(element: &TomlNode, name: &str) -> bool {
    let TomlValue::Table(table) = &element.value else { return false };
    table.get("name").is_some_and(|entry| matches!(&entry.node.value, TomlValue::Text(text) if text == name))
}

/// The list of which a path names no element: number of path elements that lead to it, and its elements. `None` for other paths.
fn list_on_path<'a>(root: &'a TomlTable, names: &[(&str, Span)]) -> Option<(usize, &'a [TomlNode])> {
    let ((first, _), rest) = names.split_first()?;
    let mut value = &root.get(first)?.node.value;
    for (i, (name, _)) in rest.iter().enumerate() {
        value = match value {
            TomlValue::Table(table) => &table.get(name)?.node.value,
            TomlValue::List(list) => match name.parse::<usize>().ok().and_then(|n| list.get(n)) {
                Some(node) => &node.value,
                None => return Some((i + 1, list.as_slice())),
            },
            _ => return None,
        };
    }
    None
}

/// The value of an override: parsed as TOML, or the text itself if it is not TOML.
fn override_value(text: &str, span: Span, report: &mut Report) -> TomlValue {
    let line = format!("v = {text}");
    let (document, errors) = DeTable::parse_recoverable(&line);
    match document.get_ref().iter().next() {
        Some((_, value)) if errors.is_empty() && document.get_ref().len() == 1 => {
            let mut faults = Report::default();
            let mut node = node(value, span.source, &mut faults);
            move_to(&mut node, span);
            // Their places are those of the line above, not of the override.
            for mut fault in faults.diagnostics {
                fault.labels.iter_mut().for_each(|label| label.0 = span);
                report.push(fault);
            }
            node.value
        }
        _ => TomlValue::Text(text.to_owned()),
    }
}

/// Sets the span of a node and of all nodes in it.
fn move_to(node: &mut TomlNode, span: Span) {
    node.span = span;
    match &mut node.value {
        TomlValue::List(list) => list.iter_mut().for_each(|n| move_to(n, span)),
        TomlValue::Table(t) => {
            for e in &mut t.entries {
                e.key_span = span;
                move_to(&mut e.node, span);
            }
        }
        _ => {}
    }
}

fn put(table: &mut TomlTable, names: &[(&str, Span)], node: TomlNode) -> bool {
    let Some((&(name, span), rest)) = names.split_first() else { return false };
    // An empty element; the quotes of an empty key have a place.
    if span.start == span.end {
        return false;
    }
    let index = table.entries.iter().position(|e| e.key == name).unwrap_or_else(|| {
        let value = TomlValue::Table(TomlTable::default());
        table.entries.push(TomlEntry { key: name.to_owned(), key_span: span, node: TomlNode { span, value } });
        table.entries.len() - 1
    });
    let Some(entry) = table.entries.get_mut(index) else { return false };
    put_in(&mut entry.node, rest, node)
}

fn put_in(target: &mut TomlNode, rest: &[(&str, Span)], node: TomlNode) -> bool {
    let Some(((name, _), after)) = rest.split_first() else {
        *target = node;
        return true;
    };
    match &mut target.value {
        TomlValue::Table(inner) => put(inner, rest, node),
        TomlValue::List(list) => {
            let item = name.parse::<usize>().ok().and_then(|i| list.get_mut(i));
            item.is_some_and(|item| put_in(item, after, node))
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, sets: &[&str]) -> (TomlTable, Report) {
        let mut report = Report::default();
        let source = report.sources.add("a.toml", text);
        let mut t = parse(text, source, &mut report);
        for s in sets {
            apply_override(&mut t, "--set", s, &mut report);
        }
        (t, report)
    }

    fn value<'a>(t: &'a TomlTable, path: &str) -> Option<&'a TomlValue> {
        let mut names = path.split('.');
        let mut v = &t.get(names.next()?)?.node.value;
        for n in names {
            v = match v {
                TomlValue::Table(t) => &t.get(n)?.node.value,
                TomlValue::List(l) => &l.get(n.parse::<usize>().ok()?)?.value,
                _ => return None,
            };
        }
        Some(v)
    }

    #[test]
    fn keys_keep_file_order_and_places() {
        let (t, r) = read("b = 1_000\na = 0x1F\n[c]\nd = [1.5, \"x\"]\n", &[]);
        assert!(!r.has_errors(), "{r}");
        assert_eq!(t.entries.iter().map(|e| e.key.as_str()).collect::<Vec<_>>(), ["b", "a", "c"]);
        assert_eq!(value(&t, "b"), Some(&TomlValue::Integer(1000)));
        assert_eq!(value(&t, "a"), Some(&TomlValue::Integer(31)));
        assert_eq!(value(&t, "c.d.0"), Some(&TomlValue::Number(1.5)));
        assert_eq!(r.sources.position(t.entries[1].key_span).line, 2);
    }

    #[test]
    fn overrides_replace_and_make_keys() {
        let (t, r) = read(
            "[[place]]\nat = [0, 0, 0]\n",
            &["wind.speed=6", "place.0.at=[1,2,3]", "title=Two words", "sun.color=#fff"],
        );
        assert!(!r.has_errors(), "{r}");
        assert_eq!(value(&t, "wind.speed"), Some(&TomlValue::Integer(6)));
        assert_eq!(value(&t, "place.0.at.2"), Some(&TomlValue::Integer(3)));
        assert_eq!(value(&t, "title"), Some(&TomlValue::Text("Two words".into())));
        assert_eq!(value(&t, "sun.color"), Some(&TomlValue::Text("#fff".into())));
        let (t, r) = read("", &["plants.\"a.b=c\".set.X = 3", &format!("{}=4", path_element("v1.2"))]);
        assert!(!r.has_errors(), "{r}");
        let names: Vec<&str> = t.entries.iter().map(|e| e.key.as_str()).collect();
        assert_eq!((names, value(&t, "v1")), (vec!["plants", "v1.2"], None));
        let Some(TomlValue::Table(plants)) = value(&t, "plants") else { panic!("{t:?}") };
        assert_eq!(plants.entries[0].key, "a.b=c");
        // A key may be empty, an element of a path may not.
        let (t, r) = read("[plants.\"\"]\n", &[&format!("plants.{}.steps=2", path_element(""))]);
        assert!(!r.has_errors() && value(&t, "plants..steps") == Some(&TomlValue::Integer(2)), "{r}");
        let (_, r) = read("", &["plants..steps=2"]);
        assert!(r.has_errors(), "{r}");
    }

    #[test]
    fn the_fault_of_a_value_is_at_the_value_of_the_override() {
        for (set, at) in [("wind.speed=nan", [11, 14]), ("place.0.at=[1, 1e999, 0]", [11, 24])] {
            let (_, r) = read("[[place]]\n", &[set]);
            let span = r.diagnostics[0].labels[0].0;
            assert_eq!((r.diagnostics[0].code, [span.start, span.end]), ("S003", at), "{set}");
        }
    }

    #[test]
    fn the_help_of_a_syntax_error_fits_its_cause() {
        let help = |name: &str, text: &str| {
            let mut report = Report::default();
            let source = report.sources.add(name, text);
            parse(text, source, &mut report);
            report.diagnostics[0].help.clone().unwrap_or_default()
        };
        for path in ["C:\\docs\\a.obj", "C:\\Users\\a.obj", "a\\xray.png", "maps\\oak.png"] {
            let told = help("a.toml", &format!("mesh = \"{path}\"\n"));
            assert!(told.contains("write '/' between folders"), "{path}: {told}");
        }
        for value in ["5cm", "(1,2,3)", "yes"] {
            let told = help("a.toml", &format!("size = {value}\n"));
            assert!(told.contains("without a unit"), "{value}: {told}");
        }
        assert!(help("fern.txt", "axiom : X\n").contains("grammars end with .l"));
        assert!(help("a.toml", "axiom : X\n").starts_with("a scene is TOML"));
        assert!(help("a.species", "age : 3\n").starts_with("such a file is TOML"));
    }

    #[test]
    fn an_override_that_names_no_element_of_a_list_is_told_what_the_list_has() {
        let help = |set: &str| {
            let (_, r) = read("[[place]]\nat = [0, 0, 0]\n", &[set]);
            r.diagnostics[0].help.clone().unwrap_or_default()
        };
        assert_eq!(help("place.1.at=3"), "place has 1 element, numbered from 0");
        assert_eq!(help("place.0.at.3=3"), "place.0.at has 3 elements, numbered from 0");
        assert!(help("place.count=3").ends_with("numbered from 0: place.0.count"), "{}", help("place.count=3"));
        assert!(help("place.0.at.0.x=3").starts_with("separate path elements"));
        // A path needs a number instead of a name; the help gives the number of the element with that name.
        let walls = "[[solid]]\nname = \"wall\"\n[[solid]]\nname = \"house\"\nsize = [1, 2, 3]\n";
        let help = |set: &str| read(walls, &[set]).1.diagnostics[0].help.clone().unwrap_or_default();
        assert!(
            help("solid.house.size.1=3").ends_with("\"house\" is solid.1.size.1"),
            "{}",
            help("solid.house.size.1=3")
        );
        assert!(help("solid.shed.size=3").ends_with("numbered from 0: solid.0.shed"), "{}", help("solid.shed.size=3"));
    }

    #[test]
    fn each_key_of_an_override_has_a_place_of_its_own() {
        let (t, _) = read("", &["wind. sped =3"]);
        let Some(TomlValue::Table(wind)) = value(&t, "wind") else { panic!("{t:?}") };
        let place = |span: Span| [span.start, span.end];
        assert_eq!((place(t.entries[0].key_span), place(wind.entries[0].key_span)), ([0, 4], [6, 10]));
        let (t, _) = read("", &["plants.\"a.b\".x=3"]);
        let Some(TomlValue::Table(plants)) = value(&t, "plants") else { panic!("{t:?}") };
        assert_eq!(place(plants.entries[0].key_span), [7, 12]);
    }

    /// `3,5`, `.4` and `4.` are told once, with the number that TOML takes; a list without brackets is no number.
    #[test]
    fn numbers_without_a_point_between_digits_are_mended() {
        for (text, mended) in [
            ("[wind]\nspeed = 3,5\n", "3.5"),
            ("a = -0,25", "-0.25"),
            ("spacing = .4\n", "0.4"),
            ("a = [1, -.5]\n", "-0.5"),
            ("a = 4.\n", "4.0"),
            ("a = [4., 2]\n", "4.0"),
            ("a = [1,.5,2]\n", "0.5"),
        ] {
            let (_, r) = read(text, &[]);
            let fixes: Vec<&str> =
                r.diagnostics.iter().filter_map(|d| d.fix.as_ref()).map(|f| f.replacement.as_str()).collect();
            assert_eq!((r.diagnostics.len(), &fixes[..]), (1, &[mended][..]), "{text}: {r}");
        }
        for text in ["a = 1, 2\n", "a = 1,2,3\n", "a = 3.5 m\n", "a = 1.2.3\n"] {
            let (_, r) = read(text, &[]);
            assert!(r.diagnostics.iter().all(|d| d.fix.is_none()), "{text}: {r}");
        }
    }

    #[test]
    fn faults_are_collected() {
        let (_, r) = read("a = nan\nb = [1,\nc = 2\nb = 3\n", &["nothing", ".=1"]);
        let codes: Vec<&str> = r.diagnostics.iter().map(|d| d.code).collect();
        assert!(codes.contains(&"S001") && codes.contains(&"S002") && r.diagnostics.len() >= 3, "{r}");
    }
}
