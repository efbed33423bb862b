//! What parameters of modules are: numbers, lists, vectors, objects, and the classes of objects.

use super::expression::PyExpr;

/// What a parameter of a module is; of a list or a vector with the number of its items.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ParamShape {
    Number,
    List(usize),
    Vector(usize),
    /// An object: the number of its kind, which has these attributes.
    Object {
        kind: usize,
        count: usize,
    },
}

impl ParamShape {
    /// How many numbers it has.
    pub fn count(self) -> usize {
        match self {
            Self::Number => 1,
            Self::List(n) | Self::Vector(n) | Self::Object { count: n, .. } => n,
        }
    }
}

/// A class whose objects hold values: what its `__init__` sets.
#[derive(Debug, Clone, Default)]
pub(super) struct Class {
    pub params: Vec<String>,
    pub defaults: Vec<Option<PyExpr>>,
    /// Attributes and their values, which may read the parameters and `self`.
    pub fields: Vec<(String, PyExpr)>,
    /// Name of the object within `__init__`.
    pub own: String,
    /// It takes any attributes by name, `**kwd`.
    pub takes_any: bool,
}
