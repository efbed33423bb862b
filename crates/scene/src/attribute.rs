//! Named values on the elements of a geometry: USD primvars, Blender attributes, glTF custom attributes.
//!
//! Simulations name their attributes, exporters write whatever they find: a further simulation changes no exporter.
//!
//! ```
//! use osier_scene::{Attribute, AttributeData};
//!
//! let mut depth = Attribute::vertex("snow_depth", AttributeData::F32(vec![0.01, 0.0, 0.02]));
//! depth.data.retain(&[true, false, true]);
//! assert_eq!(depth.data, AttributeData::F32(vec![0.01, 0.02]));
//! ```

/// The kind of element that an attribute has one value for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttributeDomain {
    /// Each vertex of a mesh.
    Vertex,
    /// Each point of a cloud.
    Point,
    /// Each instance of an instancer.
    Instance,
    /// The mesh, cloud or instancer that it is on: one value.
    Mesh,
}

/// Values of an attribute. The `Unit` variants hold numbers from 0 to 1, which formats may store as normalised integers.
#[derive(Debug, Clone, PartialEq)]
pub enum AttributeData {
    /// Unsigned integers below 2^24, so that single precision holds them.
    U32(Vec<u32>),
    /// Signed integers, such as identifiers where -1 stands for none.
    I32(Vec<i32>),
    /// Any finite numbers; the attribute's name implies their SI unit.
    F32(Vec<f32>),
    /// Numbers from 0 to 1.
    Unit1(Vec<f32>),
    /// Pairs of numbers from 0 to 1.
    Unit2(Vec<[f32; 2]>),
    /// Vectors in the space of the element, in any finite length; formats turn them to their own axes.
    Vector(Vec<[f32; 3]>),
    /// Quadruples of numbers from 0 to 1, which formats with colour types take as RGBA.
    Unit4(Vec<[f32; 4]>),
}

/// Named values, one per element of a domain.
#[derive(Debug, Clone, PartialEq)]
pub struct Attribute {
    /// `[a-z0-9_]+`, unique among the attributes of an element; the name in files.
    pub name: &'static str,
    /// Kind of element that `data` is parallel to.
    pub domain: AttributeDomain,
    /// One value per element of the domain; a single value for [`AttributeDomain::Mesh`].
    pub data: AttributeData,
}

/// Linear colour of each leaf of a plant with a season, with an alpha of 1; white for other organs.
pub const LEAF_COLOR: &str = "leaf_color";
/// Share of the skylight that other leaves of the crown take from a leaf, 0 to 1.
pub const CANOPY_OCCLUSION: &str = "canopy_occlusion";
/// Direction out of the crown in which a leaf's normals are bent: n' = n (1 - |c|) + c, where the length |c|, 0 to 1, is how
/// much.
pub const CANOPY_NORMAL: &str = "canopy_normal";

/// The index of a branch, a cluster or a drop as a value of [`AttributeData::I32`]. Indices from 2^31 on, which the limits
/// exclude, become -1, which stands for none.
/// # Examples
/// ```
/// assert_eq!(osier_scene::attribute_number(7), 7);
/// ```
pub fn attribute_number(n: u32) -> i32 {
    i32::try_from(n).unwrap_or(-1)
}

/// Evaluates an expression with the values of any variant.
macro_rules! with_values {
    ($data:expr, $values:ident => $body:expr) => {
        match $data {
            AttributeData::U32($values) => $body,
            AttributeData::I32($values) => $body,
            AttributeData::F32($values) => $body,
            AttributeData::Unit1($values) => $body,
            AttributeData::Unit2($values) => $body,
            AttributeData::Vector($values) => $body,
            AttributeData::Unit4($values) => $body,
        }
    };
}

impl AttributeData {
    /// Number of values, whatever their width.
    pub fn len(&self) -> usize {
        with_values!(self, v => v.len())
    }

    /// True without values, as for a geometry without elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Cuts the list to `len` values or extends it with zeros.
    pub fn resize(&mut self, len: usize) {
        with_values!(self, v => v.resize(len, Default::default()));
    }

    /// Keeps the values whose entry in `keep` is true, and those beyond its end.
    pub fn retain(&mut self, keep: &[bool]) {
        let mut keep = keep.iter();
        with_values!(self, v => v.retain(|_| keep.next().copied().unwrap_or(true)));
    }

    /// The values at some indices; indices out of range are skipped.
    #[must_use]
    pub fn gather(&self, indices: &[u32]) -> Self {
        fn pick<T: Copy>(all: &[T], indices: &[u32]) -> Vec<T> {
            indices.iter().filter_map(|&i| all.get(i as usize)).copied().collect()
        }
        match self {
            Self::U32(v) => Self::U32(pick(v, indices)),
            Self::I32(v) => Self::I32(pick(v, indices)),
            Self::F32(v) => Self::F32(pick(v, indices)),
            Self::Unit1(v) => Self::Unit1(pick(v, indices)),
            Self::Unit2(v) => Self::Unit2(pick(v, indices)),
            Self::Vector(v) => Self::Vector(pick(v, indices)),
            Self::Unit4(v) => Self::Unit4(pick(v, indices)),
        }
    }

    /// Appends the values of `other` if it is of the same variant; otherwise changes nothing and returns false.
    pub fn append(&mut self, other: &Self) -> bool {
        match (self, other) {
            (Self::U32(a), Self::U32(b)) => a.extend_from_slice(b),
            (Self::I32(a), Self::I32(b)) => a.extend_from_slice(b),
            (Self::F32(a), Self::F32(b)) | (Self::Unit1(a), Self::Unit1(b)) => a.extend_from_slice(b),
            (Self::Unit2(a), Self::Unit2(b)) => a.extend_from_slice(b),
            (Self::Vector(a), Self::Vector(b)) => a.extend_from_slice(b),
            (Self::Unit4(a), Self::Unit4(b)) => a.extend_from_slice(b),
            _ => return false,
        }
        true
    }

    /// Values of the variants [`Self::F32`] and [`Self::Unit1`]; none for others.
    pub fn scalars(&self) -> Option<&[f32]> {
        match self {
            Self::F32(v) | Self::Unit1(v) => Some(v),
            _ => None,
        }
    }

    /// The values of the variant [`Self::I32`]; none for others.
    pub fn integers(&self) -> Option<&[i32]> {
        if let Self::I32(v) = self { Some(v) } else { None }
    }

    /// The values of the variant [`Self::U32`]; none for others.
    pub fn counts(&self) -> Option<&[u32]> {
        if let Self::U32(v) = self { Some(v) } else { None }
    }

    /// The first value that the variant does not admit, with its index: one that is not finite, or outside of 0 to 1.
    pub fn first_invalid(&self) -> Option<(usize, f32)> {
        let unit = |v: &f32| (0.0..=1.0).contains(v);
        let find = |values: &[f32], width: usize, valid: &dyn Fn(&f32) -> bool| {
            values.iter().position(|v| !valid(v)).map(|i| (i / width, values[i]))
        };
        match self {
            Self::U32(_) | Self::I32(_) => None,
            Self::F32(v) => find(v, 1, &|v| v.is_finite()),
            Self::Unit1(v) => find(v, 1, &unit),
            Self::Unit2(v) => find(v.as_flattened(), 2, &unit),
            Self::Vector(v) => find(v.as_flattened(), 3, &|v| v.is_finite()),
            Self::Unit4(v) => find(v.as_flattened(), 4, &unit),
        }
    }
}

impl Attribute {
    /// True for the attributes of leaves that no motion changes: [`LEAF_COLOR`], [`CANOPY_OCCLUSION`] and [`CANOPY_NORMAL`].
    pub fn is_of_leaves(&self) -> bool {
        [LEAF_COLOR, CANOPY_OCCLUSION, CANOPY_NORMAL].contains(&self.name)
    }

    /// An attribute of a mesh; `data` holds one value for each of its points.
    pub fn vertex(name: &'static str, data: AttributeData) -> Self {
        Self { name, domain: AttributeDomain::Vertex, data }
    }

    /// An attribute of a cloud; `data` holds one value for each of its points, hidden ones included.
    pub fn point(name: &'static str, data: AttributeData) -> Self {
        Self { name, domain: AttributeDomain::Point, data }
    }

    /// An attribute of an instancer; `data` holds one value for each slot, dead instances included.
    pub fn instance(name: &'static str, data: AttributeData) -> Self {
        Self { name, domain: AttributeDomain::Instance, data }
    }

    /// Appends the attributes `other` of a geometry of `count` elements to the attributes `own` of one of `before` elements.
    /// Elements of a part without the attribute get zeros. An attribute of the whole geometry keeps the value of the first part.
    pub fn append_all(own: &mut Vec<Self>, before: usize, other: &[Self], count: usize) {
        for attribute in other {
            let same = |a: &Self| a.name == attribute.name && a.domain == attribute.domain;
            match own.iter_mut().find(|a| same(a)) {
                // A merged geometry has one value of this domain: the first part's.
                Some(known) if known.domain == AttributeDomain::Mesh => {}
                Some(known) => {
                    // The list is too short if the parts appended last lacked the attribute: zeros for their elements.
                    known.data.resize(before);
                    known.data.append(&attribute.data);
                }
                None if attribute.domain == AttributeDomain::Mesh => own.push(attribute.clone()),
                None => {
                    // Zeros of the attribute's type for the elements before, then its own values.
                    let mut data = attribute.data.gather(&[]);
                    data.resize(before);
                    data.append(&attribute.data);
                    own.push(Self { data, ..*attribute });
                }
            }
        }
        own.iter_mut().filter(|a| a.domain != AttributeDomain::Mesh).for_each(|a| a.data.resize(before + count));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_of_parts_without_an_attribute_get_zeros() {
        let ids = |v: Vec<i32>| Attribute::vertex("id", AttributeData::I32(v));
        let shade = Attribute::vertex("shade", AttributeData::Unit1(vec![0.5, 0.25]));
        let mut all = Vec::new();
        Attribute::append_all(&mut all, 0, &[ids(vec![7])], 1);
        Attribute::append_all(&mut all, 1, &[shade], 2);
        Attribute::append_all(&mut all, 3, &[ids(vec![8])], 1);
        let shade = Attribute::vertex("shade", AttributeData::Unit1(vec![0.0, 0.5, 0.25, 0.0]));
        assert_eq!(all, [ids(vec![7, 0, 0, 8]), shade]);
    }

    #[test]
    fn what_is_not_from_0_to_1_is_found_by_its_element() {
        let data = AttributeData::Unit2(vec![[0.0, 1.0], [0.5, 1.5]]);
        assert_eq!(data.first_invalid(), Some((1, 1.5)));
        assert_eq!(AttributeData::F32(vec![1.5, -2.0]).first_invalid(), None);
    }
}
