//! Lists of the model that are arrays of the machine.

/// A list or dictionary of the model that productions change.
#[derive(Debug, Clone)]
pub(super) struct ChangedList {
    /// Index of its array among the arrays of the model.
    pub number: usize,
    /// Of a dictionary the array of its keys, in the order of its values; `None`: a list.
    pub keys: Option<usize>,
    /// What its items are where these are lists or vectors, whose numbers are elements one after the other.
    pub row: Option<Row>,
}

/// Lists or vectors as items of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Row {
    /// How many numbers each has.
    pub width: usize,
    pub is_vector: bool,
}
