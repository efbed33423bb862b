//! Lists of the model that are arrays of the machine.

use std::collections::BTreeMap;

/// Prefix of the name of the call that stands for an element of such a list, by an index that is in its list or -1.
pub(super) const ELEMENT: &str = "(element) ";

/// A list or dictionary of the model that productions change.
#[derive(Debug, Clone)]
pub(super) struct ChangedList {
    /// Index of its array among the arrays of the model.
    pub number: usize,
    /// Of a dictionary the array of its keys, in the order of its values; `None`: a list.
    pub keys: Option<usize>,
    /// What its items are where these are lists or vectors, whose numbers are elements one after the other.
    pub row: Option<ListRow>,
}

/// Lists or vectors as items of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ListRow {
    /// How many numbers each has.
    pub width: usize,
    pub is_vector: bool,
}

/// The number of the array of which a call reads an element; `None` for any other call.
pub(super) fn array_of(call: &str, arrays: &BTreeMap<String, ChangedList>) -> Option<usize> {
    let name = call.strip_prefix(ELEMENT)?;
    arrays.get(name).map(|list| list.number)
}
