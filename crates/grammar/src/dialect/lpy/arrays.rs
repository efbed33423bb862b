//! Lists of the model that are stored as arrays of the stack machine.

use std::collections::BTreeMap;

/// Prefix of the name of the call that represents an element of such a list. Its argument is an index within the list, or -1 for
/// none.
pub(super) const ELEMENT: &str = "(element) ";

/// A list or dictionary of the model that productions change.
#[derive(Debug, Clone)]
pub(super) struct ChangedList {
    /// Index of its array among the arrays of the model.
    pub number: usize,
    /// For a dictionary, the index of the array of its keys, in the order of its values; `None` for a list.
    pub keys: Option<usize>,
    /// Kind of its items if these are lists or vectors, whose numbers are consecutive elements of the array; `None` for numbers.
    pub row: Option<ListRow>,
}

/// Kind of the items of a list of lists or vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ListRow {
    /// Number of elements of each item.
    pub width: usize,
    pub is_vector: bool,
}

/// The index of the array of which a call reads an element; `None` for any other call.
pub(super) fn array_of(call: &str, arrays: &BTreeMap<String, ChangedList>) -> Option<usize> {
    let name = call.strip_prefix(ELEMENT)?;
    arrays.get(name).map(|list| list.number)
}
