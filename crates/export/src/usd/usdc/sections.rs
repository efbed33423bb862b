//! The structural sections of a crate file: TOKENS, STRINGS, FIELDS, FIELDSETS, PATHS and SPECS.
//!
//! A scene description is a list of specs (pseudo-root, prims, properties, variants). A spec is a path and a set of fields; a
//! field is a name and a `ValueRep`. The sections hold these as tables that refer to each other by row number, each column
//! delta coded and compressed (see [`super::integer_coding`]). Source: `pxr/usd/sdf/crateFile.h` of OpenUSD.

use std::collections::BTreeMap;

use super::integer_coding;
use crate::usd::layer_writer::{split_prim_path, split_property_path};
use osier_base::Result;
use osier_base::convert::{index, narrow};

/// Assigns each distinct string a row number, in order of first use.
#[derive(Debug, Default)]
pub(super) struct Interner {
    index: BTreeMap<String, u32>,
    list: Vec<String>,
    next: u32,
}

impl Interner {
    /// The row number of a string. Numbers stop at `u32::MAX`; [`Self::check_row_count`] refuses a table that long.
    pub(super) fn intern(&mut self, text: &str) -> u32 {
        if let Some(i) = self.index.get(text) {
            return *i;
        }
        let i = self.next;
        self.next = self.next.saturating_add(1);
        self.index.insert(text.to_owned(), i);
        self.list.push(text.to_owned());
        i
    }

    /// All strings; the position of each is its row number.
    pub(super) fn list(&self) -> &[String] {
        &self.list
    }

    /// An error if the table has more rows than a file can number. `what`: the rows in the plural.
    pub(super) fn check_row_count(&self, what: &'static str) -> Result<()> {
        index(self.list.len(), what).map(|_| ())
    }
}

/// A row of the SPECS section before its fields are numbered.
#[derive(Debug)]
pub(super) struct SpecEntry {
    /// Row of the path in the [`PathTable`].
    pub(super) path: u32,
    pub(super) spec_type: SpecType,
    /// Token of each field's name and `ValueRep` of its value.
    pub(super) fields: Vec<(u32, u64)>,
}

/// `SdfSpecType` values as crate files store them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SpecType {
    Attribute = 1,
    Prim = 6,
    PseudoRoot = 7,
    Relationship = 8,
    Variant = 10,
    VariantSet = 11,
}

fn u64_bytes_le(n: usize) -> [u8; 8] {
    (n as u64).to_le_bytes()
}

/// Appends a compressed block behind its length in bytes.
fn push_sized_block(data: &[u8], out: &mut Vec<u8>) {
    out.extend(u64_bytes_le(data.len()));
    out.extend_from_slice(data);
}

/// The TOKENS section: number of tokens, length of the text, then the NUL-terminated tokens as one compressed block.
pub(super) fn tokens_section(tokens: &[String]) -> Vec<u8> {
    let mut raw = Vec::new();
    for t in tokens {
        raw.extend_from_slice(t.as_bytes());
        raw.push(0);
    }
    let mut out = u64_bytes_le(tokens.len()).to_vec();
    out.extend(u64_bytes_le(raw.len()));
    push_sized_block(&integer_coding::fast_compress(&raw), &mut out);
    out
}

/// The STRINGS section: for each string the number of the token with its text, uncompressed.
pub(super) fn strings_section(strings: &[u32]) -> Vec<u8> {
    let mut out = u64_bytes_le(strings.len()).to_vec();
    out.extend(strings.iter().flat_map(|i| i.to_le_bytes()));
    out
}

/// The FIELDS, FIELDSETS and SPECS sections, in this order; SPECS has the order of `specs`.
/// # Errors
/// `TooMany` if a table exceeds the range of `i32`.
pub(super) fn spec_sections(specs: &[SpecEntry]) -> Result<[Vec<u8>; 3]> {
    let mut fields = DedupTable::default();
    let mut sets = DedupTable::default();
    let (mut set_list, mut set_starts) = (Vec::new(), Vec::new());
    let [mut paths, mut firsts, mut types] = [const { Vec::<i32>::new() }; 3];
    for spec in specs {
        // Equal fields share a row of FIELDS, and specs with equal field lists share a run of FIELDSETS. A run is the list of
        // field rows closed by -1; a spec refers to the position at which its run begins.
        let set = spec.fields.iter().map(|f| fields.intern(*f)).collect::<Result<Vec<i32>>>()?;
        let (number, is_new) = sets.find_or_insert(set.clone());
        if is_new {
            set_starts.push(narrow(set_list.len(), "field set entries of a crate file")?);
            set_list.extend(set);
            set_list.push(-1);
        }
        paths.push(spec.path.cast_signed());
        firsts.push(set_starts.get(number).copied().unwrap_or(0));
        types.push(spec.spec_type as i32);
    }
    // FIELDS: the column of name tokens is integer coded, the 64-bit `ValueRep` column is plain LZ4.
    let mut field_section = u64_bytes_le(fields.list.len()).to_vec();
    let names: Vec<i32> = fields.list.iter().map(|f| f.0.cast_signed()).collect();
    let values: Vec<u8> = fields.list.iter().flat_map(|f| f.1.to_le_bytes()).collect();
    push_sized_block(&integer_coding::compress_i32(&names), &mut field_section);
    push_sized_block(&integer_coding::fast_compress(&values), &mut field_section);
    let mut set_section = u64_bytes_le(set_list.len()).to_vec();
    push_sized_block(&integer_coding::compress_i32(&set_list), &mut set_section);
    // SPECS: columns of path indices, field set positions and spec types.
    let mut spec_section = u64_bytes_le(specs.len()).to_vec();
    for column in [&paths, &firsts, &types] {
        push_sized_block(&integer_coding::compress_i32(column), &mut spec_section);
    }
    Ok([field_section, set_section, spec_section])
}

/// Rows without duplicates, numbered in order of first use.
#[derive(Debug)]
struct DedupTable<T> {
    index: BTreeMap<T, usize>,
    list: Vec<T>,
}

impl<T> Default for DedupTable<T> {
    fn default() -> Self {
        Self { index: BTreeMap::new(), list: Vec::new() }
    }
}

impl<T: Ord + Clone> DedupTable<T> {
    /// The number of a row, and whether it was added by this call.
    fn find_or_insert(&mut self, row: T) -> (usize, bool) {
        if let Some(number) = self.index.get(&row) {
            return (*number, false);
        }
        let number = self.list.len();
        self.list.push(row.clone());
        self.index.insert(row, number);
        (number, true)
    }

    /// The number of a row as an `i32`, as files store it; `TooMany` beyond.
    fn intern(&mut self, row: T) -> Result<i32> {
        narrow(self.find_or_insert(row).0, "fields of a crate file")
    }
}

/// All paths of a file by row number: parents come before their children, row 0 is the pseudo-root `/`.
#[derive(Debug, Default)]
pub(super) struct PathTable {
    paths: Interner,
}

impl PathTable {
    /// The row of a prim, variant or property path; its ancestors get rows first.
    pub(super) fn intern(&mut self, path: &str) -> u32 {
        if path != "/" {
            let parent = if path.contains('.') { split_property_path(path).0 } else { split_prim_path(path).0 };
            self.intern(parent);
        }
        self.paths.intern(path)
    }

    /// The PATHS section. `intern_token`: number of the token of an element name.
    /// # Errors
    /// `TooMany` if there are more paths than `i32` can number.
    pub(super) fn paths_section(&self, intern_token: &mut dyn FnMut(&str) -> u32) -> Result<Vec<u8>> {
        self.paths.check_row_count("paths of a crate file")?;
        let mut tree = PathTree { children: BTreeMap::new(), index: &self.paths.index, rows: Vec::new() };
        for path in self.paths.list().iter().filter(|p| *p != "/") {
            let (parent, name, is_property) = if path.contains('.') {
                let (parent, name) = split_property_path(path);
                (parent, name, true)
            } else {
                let (parent, name) = split_prim_path(path);
                (parent, name, false)
            };
            // Siblings are sorted by name, whatever the order in which they were defined.
            tree.children.entry(parent).or_default().insert((name, is_property), path);
        }
        // The pseudo-root has the empty name. Readers skip it, but OpenUSD looks its token up when a user saves the file.
        let root = intern_token("").cast_signed();
        tree.append_subtree("/", root, false, intern_token)?;
        // The number of paths stands twice: size of the table, and number of rows that follow.
        let mut out = u64_bytes_le(tree.rows.len()).to_vec();
        out.extend(u64_bytes_le(tree.rows.len()));
        for column in 0..3 {
            let values: Vec<i32> = tree.rows.iter().map(|r| r[column]).collect();
            push_sized_block(&integer_coding::compress_i32(&values), &mut out);
        }
        Ok(out)
    }
}

/// The hierarchy of paths while it is flattened depth first into the three columns of the PATHS section.
struct PathTree<'a> {
    /// Children of each path, ordered by element name, prims before properties of the same name.
    children: BTreeMap<&'a str, BTreeMap<(&'a str, bool), &'a str>>,
    index: &'a BTreeMap<String, u32>,
    /// Path row, token of the last element (negative for a property), jump.
    rows: Vec<[i32; 3]>,
}

impl<'a> PathTree<'a> {
    /// Appends a path and its descendants, depth first. `has_sibling`: another child of the same parent follows.
    fn append_subtree(
        &mut self,
        path: &'a str,
        element: i32,
        has_sibling: bool,
        intern_token: &mut dyn FnMut(&str) -> u32,
    ) -> Result<()> {
        let row = self.rows.len();
        let number = self.index.get(path).map_or(0, |i| i.cast_signed());
        let children = self.children.remove(path).unwrap_or_default();
        // The jump depends on the number of descendants and is filled in after them.
        self.rows.push([number, element, 0]);
        let count = children.len();
        for (i, ((name, is_property), child)) in children.into_iter().enumerate() {
            let token = intern_token(name).cast_signed();
            // The sign of the token distinguishes properties from prims, as both are children of the same path.
            self.append_subtree(child, if is_property { -token } else { token }, i + 1 < count, intern_token)?;
        }
        // The jump determines where a reader continues: -2 leaf and last sibling, -1 the first child follows and no sibling does,
        // 0 the sibling is the next row, else the first child follows and the sibling is this many rows ahead.
        let distance = narrow(self.rows.len() - row, "paths of a crate file")?;
        let jump = match (count > 0, has_sibling) {
            (false, false) => -2,
            (true, false) => -1,
            (false, true) => 0,
            (true, true) => distance,
        };
        if let Some(r) = self.rows.get_mut(row) {
            r[2] = jump;
        }
        Ok(())
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
        tree.append_subtree("/", 0, false, &mut |t| tokens.intern(t)).expect("few paths");
        assert_eq!(tree.rows, [[0, 0, -1], [1, 1, -1], [2, 2, 2], [3, -3, -2], [4, 4, -2]]);
    }
}
