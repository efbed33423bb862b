//! The keys that a scene sets, with values and positions, for programs that edit scenes.

use serde_json::{Map, Value, json};

use super::Request;
use super::syntax::{TomlNode, TomlTable, TomlValue, join, parse, path_element};
use osier_base::diagnostic::{Report, Span};

/// A key that the text of a scene sets.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenKey {
    /// Its path, as in an override: `wind.speed`, `place.0.count`.
    pub path: String,
    /// Its value as written, in the scene's units; null for a date.
    pub value: Value,
    /// Name of the scene's text, as messages show it.
    pub file: String,
    /// Byte range of the value in the text: the first byte, and the byte after the last.
    pub span: [u32; 2],
}

/// The keys that a scene's text sets, in its order, without overrides. Tables are split into their keys, also inside lists; a
/// bare grammar or coefficient table has none. Of a text with errors, the keys that could be read are returned.
pub fn given_keys(request: &Request) -> Vec<GivenKey> {
    if request.bare.is_some() {
        return Vec::new();
    }
    let mut report = Report::default();
    let source = report.sources.add(request.shown.clone(), request.text.as_str());
    let root = parse(&request.text, source, &mut report);
    let mut keys = Vec::new();
    add_table(&root, "", &request.shown, &mut keys);
    keys
}

fn add_table(table: &TomlTable, path: &str, file: &str, keys: &mut Vec<GivenKey>) {
    table.entries.iter().for_each(|entry| add_node(&entry.node, &join(path, &path_element(&entry.key)), file, keys));
}

fn add_node(node: &TomlNode, path: &str, file: &str, keys: &mut Vec<GivenKey>) {
    match &node.value {
        TomlValue::Table(table) => add_table(table, path, file, keys),
        TomlValue::List(list) if list.iter().any(|n| matches!(n.value, TomlValue::Table(_))) => {
            list.iter().enumerate().for_each(|(i, n)| add_node(n, &join(path, &i.to_string()), file, keys));
        }
        _ => {
            let Span { start, end, .. } = node.span;
            keys.push(GivenKey {
                path: path.to_owned(),
                value: as_json(node),
                file: file.to_owned(),
                span: [start, end],
            });
        }
    }
}

/// A value of a scene as JSON, in the units of the scene; null for a date and for an unreadable value.
fn as_json(node: &TomlNode) -> Value {
    match &node.value {
        TomlValue::Text(text) => json!(text),
        TomlValue::Integer(number) => json!(number),
        TomlValue::Number(number) => json!(number),
        TomlValue::Flag(flag) => json!(flag),
        TomlValue::List(list) => list.iter().map(as_json).collect(),
        TomlValue::Table(table) => {
            Value::Object(table.entries.iter().map(|e| (e.key.clone(), as_json(&e.node))).collect::<Map<_, _>>())
        }
        TomlValue::Other => Value::Null,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_the_bytes_of_their_values() {
        let text = "seed = 7\n[plants.oak]\ngrammar = \"oak.l\"\nset = { CROOK = 12.5 }\n[[place]]\nplant = \"oak\"\nat = [1, 0, -2]\n";
        let request = Request { shown: "s.toml".into(), text: text.into(), ..Request::default() };
        let found: Vec<(String, String, String)> = given_keys(&request)
            .into_iter()
            .map(|k| (k.path, k.value.to_string(), text[k.span[0] as usize..k.span[1] as usize].to_owned()))
            .collect();
        let row = |path: &str, value: &str, text: &str| (path.to_owned(), value.to_owned(), text.to_owned());
        let wanted = [
            row("seed", "7", "7"),
            row("plants.oak.grammar", "\"oak.l\"", "\"oak.l\""),
            row("plants.oak.set.CROOK", "12.5", "12.5"),
            row("place.0.plant", "\"oak\"", "\"oak\""),
            row("place.0.at", "[1,0,-2]", "[1, 0, -2]"),
        ];
        assert_eq!(found, wanted);
        assert!(given_keys(&Request::bare("oak", "oak.l")).is_empty());
    }
}
