//! The tables of a crate file: tokens, strings, fields, field sets, paths, specs.

use std::collections::BTreeMap;

use super::integer_coding;
use crate::usd::layer_writer::{split_prim_path, split_property_path};

/// Strings by number, each once.
#[derive(Debug, Default)]
pub(super) struct Interner {
    index: BTreeMap<String, u32>,
    list: Vec<String>,
}

impl Interner {
    /// The number of a string.
    pub(super) fn intern(&mut self, text: &str) -> u32 {
        if let Some(i) = self.index.get(text) {
            return *i;
        }
        let i = u32::try_from(self.list.len()).unwrap_or(u32::MAX);
        self.index.insert(text.to_owned(), i);
        self.list.push(text.to_owned());
        i
    }

    pub(super) fn list(&self) -> &[String] {
        &self.list
    }
}

/// A spec: something with a path and fields.
#[derive(Debug)]
pub(super) struct SpecEntry {
    pub(super) path: u32,
    pub(super) kind: SpecKind,
    /// Token of the name and reference of the value.
    pub(super) fields: Vec<(u32, u64)>,
}

/// Numbers of spec types.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SpecKind {
    Attribute = 1,
    Prim = 6,
    Root = 7,
    Relationship = 8,
    Variant = 10,
    VariantSet = 11,
}

fn u64_bytes(n: usize) -> [u8; 8] {
    (n as u64).to_le_bytes()
}

fn push_block(data: &[u8], out: &mut Vec<u8>) {
    out.extend(u64_bytes(data.len()));
    out.extend_from_slice(data);
}

/// The TOKENS section.
pub(super) fn tokens_section(tokens: &[String]) -> Vec<u8> {
    let mut raw = Vec::new();
    for t in tokens {
        raw.extend_from_slice(t.as_bytes());
        raw.push(0);
    }
    let mut out = u64_bytes(tokens.len()).to_vec();
    out.extend(u64_bytes(raw.len()));
    push_block(&integer_coding::lz4_block(&raw), &mut out);
    out
}

/// The STRINGS section.
pub(super) fn strings_section(strings: &[u32]) -> Vec<u8> {
    let mut out = u64_bytes(strings.len()).to_vec();
    out.extend(strings.iter().flat_map(|i| i.to_le_bytes()));
    out
}

/// The FIELDS, FIELDSETS and SPECS sections.
pub(super) fn spec_sections(specs: &[SpecEntry]) -> [Vec<u8>; 3] {
    let mut fields = DedupTable::default();
    let mut sets = DedupTable::default();
    let (mut set_list, mut set_starts) = (Vec::new(), Vec::new());
    let [mut paths, mut firsts, mut kinds] = [const { Vec::<i32>::new() }; 3];
    for spec in specs {
        let set: Vec<i32> = spec.fields.iter().map(|f| fields.intern(*f)).collect();
        let which = sets.intern(set.clone());
        if usize::try_from(which).is_ok_and(|w| w == set_starts.len()) {
            set_starts.push(i32::try_from(set_list.len()).unwrap_or(i32::MAX));
            set_list.extend(set);
            set_list.push(-1);
        }
        paths.push(spec.path.cast_signed());
        firsts.push(usize::try_from(which).ok().and_then(|w| set_starts.get(w)).copied().unwrap_or(0));
        kinds.push(spec.kind as i32);
    }
    let mut field_section = u64_bytes(fields.list.len()).to_vec();
    let names: Vec<i32> = fields.list.iter().map(|f| f.0.cast_signed()).collect();
    let values: Vec<u8> = fields.list.iter().flat_map(|f| f.1.to_le_bytes()).collect();
    push_block(&integer_coding::compress_i32(&names), &mut field_section);
    push_block(&integer_coding::lz4_block(&values), &mut field_section);
    let mut set_section = u64_bytes(set_list.len()).to_vec();
    push_block(&integer_coding::compress_i32(&set_list), &mut set_section);
    let mut spec_section = u64_bytes(specs.len()).to_vec();
    for column in [&paths, &firsts, &kinds] {
        push_block(&integer_coding::compress_i32(column), &mut spec_section);
    }
    [field_section, set_section, spec_section]
}

/// Things by number, each once.
#[derive(Debug)]
struct DedupTable<T> {
    index: BTreeMap<T, i32>,
    list: Vec<T>,
}

impl<T> Default for DedupTable<T> {
    fn default() -> Self {
        Self { index: BTreeMap::new(), list: Vec::new() }
    }
}

impl<T: Ord + Clone> DedupTable<T> {
    fn intern(&mut self, item: T) -> i32 {
        let next = i32::try_from(self.list.len()).unwrap_or(i32::MAX);
        let list = &mut self.list;
        *self.index.entry(item).or_insert_with_key(|item| {
            list.push(item.clone());
            next
        })
    }
}

/// PathTable by number; parents come before their children, number 0 is the root.
#[derive(Debug, Default)]
pub(super) struct PathTable {
    paths: Interner,
}

impl PathTable {
    /// The number of a prim or property path.
    pub(super) fn intern(&mut self, path: &str) -> u32 {
        if path != "/" {
            let parent = if path.contains('.') { split_property_path(path).0 } else { split_prim_path(path).0 };
            self.intern(parent);
        }
        self.paths.intern(path)
    }

    /// The PATHS section. `token`: number of an element's name.
    pub(super) fn section(&self, token: &mut dyn FnMut(&str) -> u32) -> Vec<u8> {
        let mut tree = PathTree { children: BTreeMap::new(), index: &self.paths.index, rows: Vec::new() };
        for path in self.paths.list().iter().filter(|p| *p != "/") {
            let (parent, name, property) = if path.contains('.') {
                let (parent, name) = split_property_path(path);
                (parent, name, true)
            } else {
                let (parent, name) = split_prim_path(path);
                (parent, name, false)
            };
            tree.children.entry(parent).or_default().insert((name, property), path);
        }
        tree.visit("/", 0, false, token);
        let mut out = u64_bytes(tree.rows.len()).to_vec();
        out.extend(u64_bytes(tree.rows.len()));
        for column in 0..3 {
            let values: Vec<i32> = tree.rows.iter().map(|r| r[column]).collect();
            push_block(&integer_coding::compress_i32(&values), &mut out);
        }
        out
    }
}

/// The tree of paths, and its rows: path, element token, jump.
struct PathTree<'a> {
    children: BTreeMap<&'a str, BTreeMap<(&'a str, bool), &'a str>>,
    index: &'a BTreeMap<String, u32>,
    rows: Vec<[i32; 3]>,
}

impl<'a> PathTree<'a> {
    /// Appends a path and all beneath it, depth first.
    fn visit(&mut self, path: &'a str, element: i32, sibling: bool, token: &mut dyn FnMut(&str) -> u32) {
        let row = self.rows.len();
        let number = self.index.get(path).map_or(0, |i| i.cast_signed());
        let children = self.children.remove(path).unwrap_or_default();
        self.rows.push([number, element, 0]);
        let count = children.len();
        for (i, ((name, property), child)) in children.into_iter().enumerate() {
            let element = token(name).cast_signed();
            self.visit(child, if property { -element } else { element }, i + 1 < count, token);
        }
        let distance = i32::try_from(self.rows.len() - row).unwrap_or(i32::MAX);
        let jump = match (count > 0, sibling) {
            (false, false) => -2,
            (true, false) => -1,
            (false, true) => 0,
            (true, true) => distance,
        };
        if let Some(r) = self.rows.get_mut(row) {
            r[2] = jump;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jumps_lead_to_the_next_sibling() {
        let mut paths = PathTable::default();
        for p in ["/", "/a/b.x", "/a/c", "/a/b"] {
            paths.intern(p);
        }
        assert_eq!(paths.paths.list(), ["/", "/a", "/a/b", "/a/b.x", "/a/c"]);
        let mut tokens = Interner::default();
        tokens.intern("");
        let mut tree = PathTree { children: BTreeMap::new(), index: &paths.paths.index, rows: Vec::new() };
        tree.children.entry("/").or_default().insert(("a", false), "/a");
        tree.children.entry("/a").or_default().insert(("b", false), "/a/b");
        tree.children.entry("/a").or_default().insert(("c", false), "/a/c");
        tree.children.entry("/a/b").or_default().insert(("x", true), "/a/b.x");
        tree.visit("/", 0, false, &mut |t| tokens.intern(t));
        assert_eq!(tree.rows, [[0, 0, -1], [1, 1, -1], [2, 2, 2], [3, -3, -2], [4, 4, -2]]);
    }
}
