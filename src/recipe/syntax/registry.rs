//! The registry of scene tables: every part of a recipe is declared once, and listings, the names that a table may hold and the
//! scene hash follow from the declaration.
//!
//! `keys!` declares a table with its keys; `recipe!` declares a struct of the recipe, whose fields are tables, values or other
//! such structs. A field outside its `derived` block is hashed and listed, so that no key can miss the hash or the listing.

use super::key::{KeyTable, RecipePart, TableInfo, key_and_table_names, refuse_unknown};
use super::tree::TomlTable;
use osier_base::diagnostic::Report;

impl<T: RecipePart> RecipePart for Option<T> {
    fn list(tables: &mut Vec<TableInfo>) {
        T::list(tables);
    }
}

impl<T: RecipePart> RecipePart for Vec<T> {
    fn list(tables: &mut Vec<TableInfo>) {
        T::list(tables);
    }
}

/// Values without a table, which list nothing.
macro_rules! plain_parts {
    ($($t:ty),*) => {$(
        impl RecipePart for $t {
            fn list(_: &mut Vec<TableInfo>) {}
        }
    )*};
}
plain_parts!(String, char, usize);

/// Appends the table of `S`, unless `tables` has one of its path.
pub fn list_table<S: KeyTable>(tables: &mut Vec<TableInfo>) {
    if tables.iter().all(|t| t.path != S::PATH) {
        tables.push(TableInfo {
            path: S::PATH,
            also: S::ALSO,
            is_list: S::IS_LIST,
            about: S::about(),
            keys: S::keys(),
        });
    }
}

/// Declarations of all tables of a part of a recipe.
#[derive(Debug, Clone)]
pub struct Registry {
    tables: Vec<TableInfo>,
}

impl Registry {
    /// The tables of `R`, in the order of its declaration.
    pub fn of<R: RecipePart>() -> Self {
        let mut tables = Vec::new();
        R::list(&mut tables);
        Self { tables }
    }

    /// The tables, in the order of listings.
    pub fn into_tables(self) -> Vec<TableInfo> {
        self.tables
    }

    /// Names of the tables directly below `path`, in the order of listings: `pov` and `usd` below `output`.
    pub fn tables_below(&self, path: &str) -> Vec<&'static str> {
        let mut names = Vec::new();
        for full in self.tables.iter().flat_map(|t| std::iter::once(&t.path).chain(t.also)) {
            let below = match path {
                "" => Some(*full),
                _ => full.strip_prefix(path).and_then(|rest| rest.strip_prefix('.')),
            };
            let Some(name) = below.and_then(|rest| rest.split('.').next()).filter(|name| !name.is_empty()) else {
                continue;
            };
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// Names that a table of `S` may hold: its keys, then the tables below it.
    pub fn names<S: KeyTable>(&self) -> Vec<&'static str> {
        key_and_table_names::<S>(&self.tables_below(S::PATH))
    }

    /// Reports S002 for each entry of a table that is neither a key of `S` nor a table below it. `path`: path of the table in
    /// the scene.
    pub fn refuse_unknown<S: KeyTable>(&self, table: &TomlTable, path: &str, report: &mut Report) {
        refuse_unknown(table, path, S::PATH, &self.names::<S>(), report);
    }
}

/// Declares structs of the recipe. Each field feeds the scene hash in the order of declaration and lists its tables, but for those
/// of the `derived` block: they follow from the other fields and from files, whose bytes are hashed.
///
/// After a field may stand how it is hashed, where that is not by its [`Digest`]: `by element` leaves out the number of elements
/// of a list and the presence of an option, `if METHOD` leaves out the field where the method of the struct is false.
macro_rules! recipe {
    ($($(#[doc = $about:literal])+ $name:ident {
        $($(#[doc = $help:literal])+ $field:ident : $type:ty $(, hashed $($mode:ident)+)?;)*
        $(derived { $($(#[doc = $derived_help:literal])+ $derived:ident : $derived_type:ty;)* })?
    })+) => {$(
        $(#[doc = $about])+
        #[derive(Debug, Clone)]
        pub struct $name {
            $($(#[doc = $help])+ pub $field: $type,)*
            $($($(#[doc = $derived_help])+ pub $derived: $derived_type,)*)?
        }

        impl $crate::recipe::syntax::Digest for $name {
            fn digest(&self, hasher: &mut blake3::Hasher) {
                $($crate::recipe::syntax::digest_field!(self, hasher, $field $($($mode)+)?);)*
            }
        }

        impl $crate::recipe::syntax::RecipePart for $name {
            fn list(tables: &mut Vec<$crate::recipe::syntax::TableInfo>) {
                $(<$type as $crate::recipe::syntax::RecipePart>::list(tables);)*
            }
        }
    )+};
}

/// Code by which `recipe!` hashes one field, for each mode of `hashed`.
macro_rules! digest_field {
    ($self:ident, $hasher:ident, $field:ident) => {
        $crate::recipe::syntax::Digest::digest(&$self.$field, $hasher)
    };
    ($self:ident, $hasher:ident, $field:ident by element) => {
        $self.$field.iter().for_each(|element| $crate::recipe::syntax::Digest::digest(element, $hasher))
    };
    ($self:ident, $hasher:ident, $field:ident if $method:ident) => {
        if $self.$method() {
            $crate::recipe::syntax::Digest::digest(&$self.$field, $hasher);
        }
    };
}

pub(in crate::recipe) use {digest_field, recipe};
