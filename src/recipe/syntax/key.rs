//! One declaration per key: it feeds reading, `osier list options`, defaults and the scene hash.

use super::digest::Digest;
use super::form::ValueForm;
use super::renamed::{RenamedKey, renamed_key};
use super::tree::{TomlNode, TomlTable, TomlValue};
use osier_base::diagnostic::{Diagnostic, Report, nearest};

/// Diagnostic about one value, boxed since errors are rare and diagnostics large.
pub type Fault = Box<Diagnostic>;

/// Type of the values of a key: reading, default, listing and hash.
pub trait ValueType {
    /// Type of the resolved value, in SI units and radians.
    type Value;
    /// Value of a key that the scene does not set, in SI units.
    fn fallback(&self) -> Self::Value;
    /// Reads and checks a value; `name` is the full path of the key, for messages.
    /// # Errors
    /// S003 for another type, S004 for a value outside its range.
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault>;
    /// Accepted values, default and unit for `osier list options`.
    fn listing(&self) -> KeyListing;
    /// Feeds a resolved value to the scene hash.
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher);
    /// Appends the declarations of inline tables that values consist of, for listings.
    fn list_tables(&self, _tables: &mut Vec<TableInfo>) {}
}

/// Accepted values of a key, as text and as a form for programs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct KeyListing {
    /// "number", "text", "one of ...".
    pub accepts: String,
    /// Default value as text; empty if other keys or files decide it.
    pub default: String,
    /// Unit in which the value is written; empty without one.
    pub unit: &'static str,
    /// The same in a form from which programs build input fields.
    pub form: ValueForm,
}

/// One key of a table, for listings.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyInfo {
    /// Name within its table, without the table's path.
    pub name: &'static str,
    /// Meaning of the key, one sentence or two.
    pub help: String,
    /// Whether the key has the mark `basic`, for keys that are usually changed first.
    pub basic: bool,
    /// Accepted values, default and unit.
    pub listing: KeyListing,
}

/// One table of a scene file, for listings.
#[derive(Debug, Clone, PartialEq)]
pub struct TableInfo {
    /// Path of the table, with `NAME` for names that scenes choose; empty for the top level.
    pub path: &'static str,
    /// Paths of further tables with the same keys.
    pub also: &'static [&'static str],
    /// Whether a scene may have several of it, as `[[PATH]]`.
    pub is_list: bool,
    /// Purpose of the table, one sentence or two.
    pub about: String,
    /// Its keys, in the order of declaration.
    pub keys: Vec<KeyInfo>,
}

/// A part of a recipe: it feeds its values to the scene hash and lists the tables that they are read from.
pub trait RecipePart: Digest {
    /// Appends the tables of this part that are not yet in `tables`.
    fn list(tables: &mut Vec<TableInfo>);
}

/// A table of a scene file, declared by `keys!`.
pub trait KeyTable: Sized + RecipePart {
    /// Path in the scene, with `NAME` for names that scenes choose.
    const PATH: &'static str;
    /// Paths of further tables with the same keys.
    const ALSO: &'static [&'static str];
    /// Whether [`Self::PATH`] names a list of tables.
    const IS_LIST: bool = false;
    /// Purpose of the table, one sentence or two.
    fn about() -> String;
    /// Its keys, in the order of declaration.
    fn keys() -> Vec<KeyInfo>;
    /// Reads its keys; errors go into the reader's report, and the default is used.
    fn read_keys(reader: &mut TableReader<'_>) -> Self;

    /// Reads the keys of a table (`None`: all defaults) and ignores unknown ones.
    fn read(table: Option<&TomlTable>, path: &str, report: &mut Report) -> Self {
        Self::read_keys(&mut TableReader { table, path: path.to_owned(), report })
    }

    /// The table with the defaults of all keys.
    fn defaults() -> Self {
        Self::read(None, Self::PATH, &mut Report::default())
    }
}

/// Names that a table of `S` may hold: its keys, then `tables` below it, without repetition.
pub fn key_and_table_names<S: KeyTable>(tables: &[&'static str]) -> Vec<&'static str> {
    let mut names: Vec<&str> = S::keys().iter().map(|k| k.name).collect();
    let further: Vec<&str> = tables.iter().copied().filter(|t| !names.contains(t)).collect();
    names.extend(further);
    names
}

/// Reports S002 for each entry of a table that is not `known`. `path`: path in the scene; `declared`: path of the declaration.
pub fn refuse_unknown(table: &TomlTable, path: &str, declared: &str, known: &[&str], report: &mut Report) {
    for entry in table.entries.iter().filter(|e| !known.contains(&e.key.as_str())) {
        if report.is_full() {
            return;
        }
        report.push(match renamed_key(declared, &entry.key) {
            Some(key) => renamed(entry, path, key),
            None => unknown(entry, path, known),
        });
    }
}

/// The keys of one table while they are read, with the report for errors.
pub struct TableReader<'a> {
    table: Option<&'a TomlTable>,
    path: String,
    report: &'a mut Report,
}

impl TableReader<'_> {
    /// The value of a key, or its default if it is absent or faulty.
    pub fn key<K: ValueType>(&mut self, name: &str, kind: &K) -> K::Value {
        let Some(entry) = self.table.and_then(|t| t.get(name)) else { return kind.fallback() };
        let full = join(&self.path, name);
        kind.read(&full, &entry.node).unwrap_or_else(|fault| {
            self.report.push(*fault);
            kind.fallback()
        })
    }
}

/// Diagnostic S002 for a key of an earlier version, with its present name and the change of its meaning, if it has one.
fn renamed(entry: &super::tree::TomlEntry, path: &str, key: &RenamedKey) -> Diagnostic {
    let new = key.new;
    let text = format!("[{path}] has no key \"{}\"", entry.key);
    let d = Diagnostic::error("S002", text, entry.key_span, "renamed key");
    match key.change {
        // Renaming without the change of the value would alter the scene, so that no fix is offered.
        Some(change) => d.help(format!("`{}` is now `{new}`; {change}", entry.key)),
        None => d.help(format!("`{}` is now `{new}`", entry.key)).fix(entry.key_span, new),
    }
}

/// Names of other programs for keys, each with the keys of scenes that stand for it in some table.
const OTHER_NAMES: [(&str, &[&str]); 15] = [
    ("angle", &["angle_deg", "vfov_deg"]),
    ("kind", &["model", "shape"]),
    ("light", &["sun"]),
    ("lights", &["sun"]),
    ("location", &["eye", "at"]),
    ("look_at", &["target"]),
    ("lookat", &["target"]),
    ("origin", &["eye", "at"]),
    ("position", &["eye", "at"]),
    ("preset", &["grammar"]),
    ("resolution", &["size", "side"]),
    ("rotate", &["turn_deg"]),
    ("rotation", &["turn_deg"]),
    ("translate", &["at"]),
    ("type", &["kind", "model", "shape"]),
];

/// The known name that stands for a name of other programs.
fn name_for<'a>(key: &str, known: &[&'a str]) -> Option<&'a str> {
    let (_, names) = OTHER_NAMES.iter().find(|(other, _)| key.eq_ignore_ascii_case(other))?;
    names.iter().find_map(|name| known.iter().copied().find(|k| k == name))
}

/// The only known name that continues a key of three letters or more, as by its unit (`elevation_deg` for `elevation`), else the only
/// one that contains it.
fn only_continuation<'a>(key: &str, known: &[&'a str]) -> Option<&'a str> {
    if key.len() < 3 {
        return None;
    }
    let continues = |k: &&str| k.strip_prefix(key).is_some_and(|rest| rest.starts_with('_'));
    let contains = |k: &&str| k.contains(key);
    only(known.iter().copied().filter(continues)).or_else(|| only(known.iter().copied().filter(contains)))
}

/// The item of an iterator that has no other.
fn only<T>(mut items: impl Iterator<Item = T>) -> Option<T> {
    let first = items.next()?;
    items.next().is_none().then_some(first)
}

/// Diagnostic S002 for an unknown key, with the nearest known name or all of them.
pub fn unknown(entry: &super::tree::TomlEntry, path: &str, known: &[&str]) -> Diagnostic {
    let place = if path.is_empty() { "a scene".to_owned() } else { format!("[{path}]") };
    let d = Diagnostic::error("S002", format!("{place} has no key \"{}\"", entry.key), entry.key_span, "unknown key");
    let near = name_for(&entry.key, known)
        .or_else(|| nearest(&entry.key, known.iter().copied()))
        .or_else(|| only_continuation(&entry.key, known));
    match near {
        Some(near) => d.help(format!("did you mean \"{near}\"?")).fix(entry.key_span, near),
        None => d.help(format!("known here: {}", known.join(", "))),
    }
}

/// Path of a key for messages: `path.name`, or `name` in the top table, whose `path` is empty.
pub fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// Diagnostic S003 for a value of another type. `wanted`: a phrase for the types that the key accepts.
pub fn wrong(name: &str, node: &TomlNode, wanted: &str) -> Fault {
    let d = Diagnostic::error(
        "S003",
        format!("{name} is {}, but must be {wanted}", node.value.word()),
        node.span,
        format!("must be {wanted}"),
    );
    Box::new(match &node.value {
        TomlValue::Text(t) if t.trim().replace(',', ".").parse::<f64>().is_ok() && wanted.contains("number") => {
            d.help(format!("write it without quotes: {}", t.trim().replace(',', ".")))
        }
        TomlValue::Text(t) if wanted.contains("number") && is_number_with_unit(t) => {
            d.help(format!("write the number alone, in the unit of the key, which `osier list options {name}` tells"))
        }
        // An override of an element, such as solid.0.at, of a list that the scene does not have.
        TomlValue::Table(table) if wanted.starts_with("a list: ") && has_only_indices(table) => d.help(format!(
            "an override changes elements that the scene has; give the whole list: --set '{name}=[{{ KEY = VALUE }}]'"
        )),
        TomlValue::List(_) if wanted == "a table" && !name.contains('.') => {
            d.help(format!("write one pair of brackets: [{name}], or [{name}.NAME] for one of several"))
        }
        TomlValue::Table(_) if wanted.starts_with("a list: write ") => {
            d.help("two pairs of brackets begin one of several such tables, even if there is only one")
        }
        // Names of #defines are no keys of the listing.
        _ if name.contains(".set.") => d.help(format!("write {wanted} without quotes")),
        _ => d.help(format!("write {wanted}; `osier list options {name}` shows what the key takes, and its default")),
    })
}

/// Whether a text is a number with something behind it, as `5cm` and `10 km/h`.
fn is_number_with_unit(text: &str) -> bool {
    let text = text.trim();
    let end = text.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | ',' | '-' | '+'))).unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    !unit.is_empty() && number.replace(',', ".").parse::<f64>().is_ok()
}

/// Whether a table has keys, and all of them are whole numbers.
fn has_only_indices(table: &TomlTable) -> bool {
    !table.entries.is_empty() && table.entries.iter().all(|e| e.key.bytes().all(|b| b.is_ascii_digit()))
}

/// Diagnostic S004 for a value outside its range. `value`: as messages quote it; `range`: the accepted values in words.
pub fn outside(name: &str, node: &TomlNode, value: &str, range: &str) -> Fault {
    let d = Diagnostic::error("S004", format!("{name} is {value}, but must be {range}"), node.span, range);
    Box::new(d.help(format!("give {name} a value of {range}")))
}

/// A number written with or without a decimal point; S003 for other types.
pub fn finite_number(name: &str, node: &TomlNode) -> Result<f64, Fault> {
    match &node.value {
        #[allow(clippy::cast_precision_loss, reason = "whole numbers of scenes are small")]
        TomlValue::Integer(i) => Ok(*i as f64),
        TomlValue::Number(v) => Ok(*v),
        _ => Err(wrong(name, node, "a number")),
    }
}

/// Whether a table of `keys!` is declared `as list`.
macro_rules! is_list {
    () => {
        false
    };
    (list) => {
        true
    };
}

/// Whether a key of `keys!` has the mark `basic`.
macro_rules! is_basic {
    () => {
        false
    };
    (basic) => {
        true
    };
}

/// Declares the struct of a table together with its keys: a line of help, the field, the key and its value type, and `basic`
/// after keys that are usually changed first.
macro_rules! keys {
    ($($(#[doc = $about:literal])+ $name:ident at $path:literal $(also $also:literal)* $(as $form:ident)? {
        $($(#[doc = $help:literal])+ $field:ident : $type:ty = $key:literal $kind:expr $(, $mark:ident)?;)*
    })+) => {$(
        $(#[doc = $about])+
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name {
            $($(#[doc = $help])+ pub $field: $type,)*
        }

        impl $crate::recipe::syntax::KeyTable for $name {
            const PATH: &'static str = $path;
            const ALSO: &'static [&'static str] = &[$($also),*];
            const IS_LIST: bool = $crate::recipe::syntax::is_list!($($form)?);
            fn about() -> String {
                concat!($($about),+).trim().to_owned()
            }
            fn keys() -> Vec<$crate::recipe::syntax::KeyInfo> {
                vec![$($crate::recipe::syntax::KeyInfo {
                    name: $key,
                    help: concat!($($help),+).trim().to_owned(),
                    basic: $crate::recipe::syntax::is_basic!($($mark)?),
                    listing: $crate::recipe::syntax::ValueType::listing(&$kind),
                }),*]
            }
            fn read_keys(reader: &mut $crate::recipe::syntax::TableReader<'_>) -> Self {
                Self { $($field: reader.key($key, &$kind)),* }
            }
        }

        impl $crate::recipe::syntax::Digest for $name {
            fn digest(&self, hasher: &mut blake3::Hasher) {
                $($crate::recipe::syntax::ValueType::digest(&$kind, &self.$field, hasher);)*
            }
        }

        impl $crate::recipe::syntax::RecipePart for $name {
            fn list(tables: &mut Vec<$crate::recipe::syntax::TableInfo>) {
                $crate::recipe::syntax::list_table::<Self>(tables);
                $($crate::recipe::syntax::ValueType::list_tables(&$kind, tables);)*
            }
        }
    )+};
}

/// Declares an enum whose members are words in scenes, and implements `Choice` and `Digest` for it.
macro_rules! choices {
    ($($(#[doc = $about:literal])+ $name:ident { $($(#[doc = $help:literal])+ $member:ident = $word:literal,)* })+) => {$(
        $(#[doc = $about])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum $name { $($(#[doc = $help])+ $member),* }

        impl $crate::recipe::syntax::Choice for $name {
            const ALL: &'static [(&'static str, Self)] = &[$(($word, Self::$member)),*];
        }

        impl $crate::recipe::syntax::Digest for $name {
            fn digest(&self, hasher: &mut blake3::Hasher) {
                let word = match self { $(Self::$member => $word),* };
                word.digest(hasher);
            }
        }
    )+};
}

pub(in crate::recipe) use {choices, is_basic, is_list, keys};
