//! Shapes of module parameters: numbers, lists, vectors and objects; and the classes of objects.

use super::expression::PyExpr;

/// Shape of a module parameter; for a list or vector with its number of items.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ParamShape {
    Number,
    List(usize),
    Vector(usize),
    /// An object: the number of its kind, which determines its attributes.
    Object {
        kind: usize,
        count: usize,
    },
}

impl ParamShape {
    /// The number of numeric parameters that represent it.
    pub fn count(self) -> usize {
        match self {
            Self::Number => 1,
            Self::List(n) | Self::Vector(n) | Self::Object { count: n, .. } => n,
        }
    }
}

/// A class whose objects hold values, as set by its `__init__`.
#[derive(Debug, Clone, Default)]
pub(super) struct Class {
    pub params: Vec<String>,
    pub defaults: Vec<Option<PyExpr>>,
    /// Attributes and their values, which may depend on the parameters and `self`.
    pub fields: Vec<(String, PyExpr)>,
    /// Name of the object within `__init__`, usually `self`.
    pub own: String,
    /// True if it accepts any attributes by keyword, `**kwd`.
    pub takes_any: bool,
}
