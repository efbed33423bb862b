//! Accessors: typed numbers in buffers, sparse, strided and quantized.

use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;

use super::buffers::Buffers;
use super::document::GltfDocument;
use crate::{ImportContext, ImportResult};
use osier_base::math::narrow;

/// Most elements of an accessor without a buffer view (all zero until sparse values fill in): a short file must not
/// become a large mesh.
const MAX_ZERO_ELEMENTS: u64 = 1 << 20;

/// Reads accessors of a document from its buffers.
#[derive(Clone, Copy)]
pub(super) struct Accessors<'a> {
    pub(super) document: &'a GltfDocument,
    pub(super) buffers: &'a Buffers<'a>,
}

/// The layout of an accessor whose bytes are known to exist.
struct AccessorLayout<'a> {
    index: usize,
    accessor: &'a Accessor,
    count: usize,
    width: usize,
    component: ComponentType,
    normalized: bool,
}

impl Accessors<'_> {
    /// Numbers of an accessor, `width` per element, integers as they are or scaled to [0, 1] or [-1, 1] if normalized.
    /// `limit`: name of the limit on the number of elements.
    /// # Errors
    /// X010 naming the accessor.
    pub(super) fn floats(
        &self,
        context: &ImportContext<'_>,
        index: usize,
        types: &[Type],
        limit: &str,
    ) -> ImportResult<Vec<f32>> {
        let layout = self.layout(context, index, types)?;
        context.limit(limit, layout.count as u64)?;
        // Elements without bytes stay 0, as the specification requires.
        let mut values = vec![0.0; layout.count * layout.width];
        self.for_each_component(context, &layout, |i, k, bytes| {
            if let Some(v) = values.get_mut(i * layout.width + k) {
                *v = component(bytes, layout.component, layout.normalized);
            }
        })?;
        Ok(values)
    }

    /// Vertex numbers of a scalar accessor, three for a triangle.
    /// # Errors
    /// X010 naming the accessor.
    pub(super) fn vertex_indices(&self, context: &ImportContext<'_>, index: usize) -> ImportResult<Vec<u32>> {
        let layout = self.layout(context, index, &[Type::Scalar])?;
        context.limit("triangles", layout.count as u64 / 3)?;
        if !matches!(layout.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
            return Err(
                context.error_in_file("X010", format_args!("accessors[{index}]: indices must be unsigned integers"))
            );
        }
        let mut values = vec![0; layout.count];
        self.for_each_component(context, &layout, |i, _, bytes| {
            if let Some(v) = values.get_mut(i) {
                *v = unsigned(bytes);
            }
        })?;
        Ok(values)
    }

    /// Number of components that an accessor has per element.
    pub(super) fn width(&self, index: usize) -> usize {
        let accessor = self.document.root.accessors.get(index);
        accessor.map_or(0, |a| if let Checked::Valid(t) = a.type_ { t.multiplicity() } else { 0 })
    }

    /// The layout of an accessor, after a check that all of its elements exist; nothing is allocated before.
    fn layout(&self, context: &ImportContext<'_>, index: usize, types: &[Type]) -> ImportResult<AccessorLayout<'_>> {
        let fault = |what: &str| context.error_in_file("X010", format_args!("accessors[{index}] {what}"));
        let accessor = self.document.root.accessors.get(index).ok_or_else(|| fault("does not exist"))?;
        let (Checked::Valid(kind), Checked::Valid(component)) = (&accessor.type_, &accessor.component_type) else {
            return Err(fault("has no valid type"));
        };
        if !types.contains(kind) {
            return Err(fault("has the wrong type for its use"));
        }
        let count = accessor.count.0;
        if accessor.buffer_view.is_none() && count > MAX_ZERO_ELEMENTS {
            return Err(fault(&format!("declares {count} elements without bytes for them")));
        }
        let count = usize::try_from(count).map_err(|_| fault("is too large"))?;
        let (width, component) = (kind.multiplicity(), component.0);
        // Check all elements here, so that a damaged accessor is found before anything is allocated.
        if let Some(view) = accessor.buffer_view {
            let offset = accessor.byte_offset.map_or(0, |o| o.0);
            if self.elements(view.value(), offset, count, width * component.size()).is_none() {
                return Err(fault("passes the end of its bufferView"));
            }
        }
        Ok(AccessorLayout { index, accessor, count, width, component, normalized: accessor.normalized })
    }

    /// Calls `set(element, component, bytes)` for every component: first those of the buffer view, then the sparse
    /// ones.
    fn for_each_component(
        &self,
        context: &ImportContext<'_>,
        layout: &AccessorLayout<'_>,
        mut set: impl FnMut(usize, usize, &[u8]),
    ) -> ImportResult<()> {
        let (index, accessor) = (layout.index, layout.accessor);
        let size = layout.component.size();
        let fault = |what: &str| context.error_in_file("X010", format_args!("accessors[{index}] {what}"));
        let mut put = |i: usize, element: &[u8]| element.chunks_exact(size).enumerate().for_each(|(k, b)| set(i, k, b));
        if let Some(view) = accessor.buffer_view {
            let offset = accessor.byte_offset.map_or(0, |o| o.0);
            let elements = self.elements(view.value(), offset, layout.count, layout.width * size);
            let elements = elements.ok_or_else(|| fault("passes the end of its bufferView"))?;
            elements.enumerate().for_each(|(i, e)| put(i, e));
        }
        // Sparse values replace the elements of the view, or zeros where there is no view.
        let Some(sparse) = &accessor.sparse else { return Ok(()) };
        let count = usize::try_from(sparse.count.0).ok().filter(|n| *n <= layout.count);
        let count = count.ok_or_else(|| fault("has more sparse values than elements"))?;
        let width = match sparse.indices.component_type {
            Checked::Valid(c) => match c.0 {
                ComponentType::U8 => 1,
                ComponentType::U16 => 2,
                _ => 4,
            },
            Checked::Invalid => return Err(fault("has sparse indices of no valid type")),
        };
        let past = || fault("has sparse values past the end of their bufferView");
        let (at, values) = (&sparse.indices, &sparse.values);
        let places = self.elements(at.buffer_view.value(), at.byte_offset.0, count, width).ok_or_else(past)?;
        let elements = self.elements(values.buffer_view.value(), values.byte_offset.0, count, layout.width * size);
        for (place, element) in places.zip(elements.ok_or_else(past)?) {
            let i = unsigned(place) as usize;
            if i >= layout.count {
                return Err(fault("has a sparse index past its last element"));
            }
            put(i, element);
        }
        Ok(())
    }

    /// `count` elements of `size` bytes in a view, by its stride; `None` if they pass its end.
    fn elements(&self, view: usize, offset: u64, count: usize, size: usize) -> Option<impl Iterator<Item = &[u8]>> {
        let bytes = self.buffers.view(self.document, view)?;
        let view = self.document.root.buffer_views.get(view)?;
        let bytes = bytes.get(usize::try_from(offset).ok()?..)?;
        let stride = view.byte_stride.map_or(size, |s| s.0);
        // The last element need not be followed by the rest of its stride: stride (n - 1) + size bytes.
        let needed = count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(size))?;
        let bytes = bytes.get(..needed)?;
        (stride >= size && size > 0).then(|| bytes.chunks(stride).take(count).filter_map(move |c| c.get(..size)))
    }
}

/// Little-endian bytes as an unsigned integer.
fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |v, b| (v << 8) | u32::from(*b))
}

/// One component as a number.
/// Source: glTF 2.0 specification, section 3.11 (integers to normalized floats).
fn component(bytes: &[u8], kind: ComponentType, normalized: bool) -> f32 {
    let raw = unsigned(bytes);
    // Sign extension: the value is moved to the top of the word and back by an arithmetic shift.
    let signed = |bits: u32| f64::from((raw << (32 - bits)).cast_signed() >> (32 - bits));
    let (value, one) = match kind {
        ComponentType::F32 => return f32::from_bits(raw),
        ComponentType::I8 => (signed(8), 127.0),
        ComponentType::I16 => (signed(16), 32_767.0),
        ComponentType::U8 => (f64::from(raw), 255.0),
        ComponentType::U16 => (f64::from(raw), 65_535.0),
        ComponentType::U32 => (f64::from(raw), f64::from(u32::MAX)),
    };
    // Signed integers have one value more below 0: -128 / 127 is clamped to -1.
    narrow(if normalized { (value / one).max(-1.0) } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_become_numbers_as_the_specification_says() {
        assert_eq!(component(&[0x80], ComponentType::I8, true).to_bits(), (-1.0_f32).to_bits());
        assert_eq!(component(&[0x81], ComponentType::I8, true).to_bits(), (-1.0_f32).to_bits());
        assert_eq!(component(&[0xff, 0x7f], ComponentType::I16, true).to_bits(), 1.0_f32.to_bits());
        assert_eq!(component(&[0xfe, 0xff], ComponentType::I16, false).to_bits(), (-2.0_f32).to_bits());
        assert_eq!(component(&[0xff], ComponentType::U8, true).to_bits(), 1.0_f32.to_bits());
        assert_eq!(component(&1.5_f32.to_le_bytes(), ComponentType::F32, false).to_bits(), 1.5_f32.to_bits());
    }
}
