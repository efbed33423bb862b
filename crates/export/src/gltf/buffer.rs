//! The binary buffer: the arrays of all accessors, one after the other, each in a separate buffer view.

use glam::{Quat, Vec2, Vec3};

use super::json::{Accessor, BufferView, Index, SparseElements, SparseIndices, SparseValues, component, target};
use super::options::VECTOR_BYTES;
use super::quantize::QuantizedCube;
use super::stream::Stream;
use crate::skin_remap::byte_weights;
use osier_base::math::normalize_or;
use osier_base::{Error, Result};

/// The buffer's bytes, and the buffer views and accessors over them.
#[derive(Debug, Default)]
pub(super) struct BinaryBuffer {
    pub bytes: Vec<u8>,
    pub views: Vec<BufferView>,
    pub accessors: Vec<Accessor>,
    /// Whether the views will be compressed once the document is complete.
    pub compressed: bool,
    /// Whether accessors of floats whose elements are mostly zeros have a view of zeros below their sparse elements. Importers that take
    /// a missing view for the first one of the file then read them, as Godot before 4.1 does.
    pub has_zero_views: bool,
    /// The last view of zeros, which accessors of at most its count of elements share.
    pub zeros: Option<ZeroView>,
}

/// A buffer view of vectors of zeros.
#[derive(Debug, Clone, Copy)]
pub(super) struct ZeroView {
    view: Index,
    /// Vectors that it holds.
    count: usize,
}

/// Most vertices that u16 indices address: the index 65535 is reserved for primitive restart (glTF 2.0, section 3.7.2.1).
const MAX_SHORT_VERTICES: usize = 65_535;

impl BinaryBuffer {
    /// Vertex positions, with `min` and `max`, which the format requires for them. `label`: names the element in errors.
    pub(super) fn add_positions(&mut self, values: &[Vec3], label: &str) -> Result<Index> {
        let accessor = self.add_vectors(values, Some(target::VERTICES), label)?;
        let low = values.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let high = values.iter().copied().reduce(Vec3::max).unwrap_or_default();
        if let Some(a) = self.accessors.last_mut() {
            // The stored numbers have -0 replaced by 0, so the bounds have it replaced too and equal the stored extremes exactly.
            a.min = (low + 0.0).to_array().to_vec();
            a.max = (high + 0.0).to_array().to_vec();
        }
        Ok(accessor)
    }

    /// Vertex positions as shares of a cube, u16 normalised with a stride of eight bytes: accurate to 1/131070 of its edge.
    /// Requires KHR_mesh_quantization.
    pub(super) fn add_quantized_positions(
        &mut self,
        values: &[Vec3],
        cube: QuantizedCube,
        label: &str,
    ) -> Result<Index> {
        check_finite(values.iter().map(|v| v.is_finite()), label)?;
        let stored = values.iter().map(|v| cube.shares(*v).to_array().map(to_unorm16));
        self.add_normalized_vectors(stored, component::U16, u16::to_le_bytes)
    }

    /// Differences of positions, m, between points of a cube as normalised i16 with a stride of eight bytes: accurate to 1/65534 of its
    /// edge. Requires KHR_mesh_quantization.
    pub(super) fn add_quantized_differences(
        &mut self,
        values: &[Vec3],
        cube: QuantizedCube,
        label: &str,
    ) -> Result<Index> {
        check_finite(values.iter().map(|v| v.is_finite()), label)?;
        let stored = values.iter().map(|v| cube.difference(*v).to_array().map(to_snorm16));
        self.add_normalized_vectors(stored, component::I16, i16::to_le_bytes)
    }

    /// Normalised vectors of 16-bit integers with a stride of eight bytes, and their bounds.
    fn add_normalized_vectors<T: Copy + Ord + Default + Into<f32>>(
        &mut self,
        vectors: impl ExactSizeIterator<Item = [T; 3]>,
        component: u32,
        to_bytes: fn(T) -> [u8; 2],
    ) -> Result<Index> {
        let (start, count) = (self.align(), vectors.len());
        let mut bounds: Option<[[T; 3]; 2]> = None;
        for vector in vectors {
            vector.iter().for_each(|c| self.bytes.extend_from_slice(&to_bytes(*c)));
            // Pad to the stride, since attributes must begin at multiples of four bytes.
            self.bytes.extend_from_slice(&[0; 2]);
            let [low, high] = bounds.get_or_insert([vector; 2]);
            for (c, (low, high)) in vector.iter().zip(low.iter_mut().zip(high)) {
                (*low, *high) = ((*low).min(*c), (*high).max(*c));
            }
        }
        let view = self.add_stream(start, Some(target::VERTICES), Stream::Attributes { stride: 8 })?;
        if let Some(view) = self.views.last_mut() {
            view.byte_stride = Some(8);
        }
        // Bounds of a normalised accessor are the stored integers.
        let [min, max] = bounds.unwrap_or_default().map(|v| v.map(Into::into).to_vec());
        let accessor = accessor_of(view, component, count, "VEC3");
        self.add_accessor(Accessor { normalized: true, min, max, ..accessor })
    }

    /// Adds a sparse accessor of `count` VEC3 elements with bounds: `values` at the increasing `indices`, zero elsewhere.
    pub(super) fn add_sparse_vectors(
        &mut self,
        indices: &[u32],
        values: &[Vec3],
        count: usize,
        label: &str,
    ) -> Result<Index> {
        check_finite(values.iter().map(|v| v.is_finite()), label)?;
        // Adding 0 turns -0 into 0, as in `add_floats`.
        let stored = values.iter().map(|v| (*v + 0.0).to_array());
        self.add_sparse(indices, stored, count, component::F32, f32::to_le_bytes, |c| c)
    }

    /// Differences of positions, m, at the increasing `indices` of `count` elements, stored as in
    /// [`Self::add_quantized_differences`]; all other elements are zero. Requires KHR_mesh_quantization.
    pub(super) fn add_sparse_quantized_differences(
        &mut self,
        indices: &[u32],
        values: &[Vec3],
        count: usize,
        cube: QuantizedCube,
        label: &str,
    ) -> Result<Index> {
        check_finite(values.iter().map(|v| v.is_finite()), label)?;
        let stored = values.iter().map(|v| cube.difference(*v).to_array().map(to_snorm16));
        self.add_sparse(indices, stored, count, component::I16, i16::to_le_bytes, f32::from)
    }

    /// A view of at least `count` vectors of three zeros.
    fn zero_view(&mut self, count: usize) -> Result<Index> {
        if let Some(zeros) = self.zeros.filter(|z| z.count >= count) {
            return Ok(zeros.view);
        }
        let start = self.align();
        self.bytes.resize(start + count * VECTOR_BYTES, 0);
        let view = self.add_view(start, Some(target::VERTICES))?;
        if let Some(view) = self.views.last_mut() {
            // Views of several accessors must have a stride (glTF 2.0, section 3.6.2.4).
            view.byte_stride = Some(VECTOR_BYTES);
        }
        self.zeros = Some(ZeroView { view, count });
        Ok(view)
    }

    /// An accessor of type VEC3: all elements are zero except those at the increasing `indices`. It has no buffer view, or one of zeros for
    /// readers that need it. Integers are normalised, and never have one.
    fn add_sparse<T: Copy, const BYTES: usize>(
        &mut self,
        indices: &[u32],
        values: impl Iterator<Item = [T; 3]>,
        count: usize,
        component_type: u32,
        to_bytes: fn(T) -> [u8; BYTES],
        number: fn(T) -> f32,
    ) -> Result<Index> {
        // Omitted elements are zero and count for the bounds.
        let (mut low, mut high) =
            if indices.len() < count { (Vec3::ZERO, Vec3::ZERO) } else { (Vec3::INFINITY, Vec3::NEG_INFINITY) };
        let normalized = component_type != component::F32;
        let buffer_view = if self.has_zero_views && !normalized { Some(self.zero_view(count)?) } else { None };
        let start = self.align();
        for vector in values {
            vector.iter().for_each(|c| self.bytes.extend(to_bytes(*c)));
            let v = Vec3::from_array(vector.map(number));
            (low, high) = (low.min(v), high.max(v));
        }
        let bounds = |v: Vec3| if v.is_finite() { v.to_array().to_vec() } else { vec![0.0; 3] };
        let zeros = Accessor {
            buffer_view,
            component_type,
            normalized,
            count,
            shape: "VEC3",
            min: bounds(low),
            max: bounds(high),
            ..Accessor::default()
        };
        // The schema does not allow an empty list of elements.
        if indices.is_empty() {
            return self.add_accessor(zeros);
        }
        // Views of sparse elements have neither a target nor a stride (glTF 2.0, section 3.6.2.3).
        let values = SparseValues { buffer_view: self.add_view(start, None)? };
        let start = self.align();
        let short = count <= MAX_SHORT_VERTICES;
        for i in indices {
            match u16::try_from(*i) {
                Ok(i) if short => self.bytes.extend_from_slice(&i.to_le_bytes()),
                _ => self.bytes.extend_from_slice(&i.to_le_bytes()),
            }
        }
        let component_type = if short { component::U16 } else { component::U32 };
        let places = SparseIndices { buffer_view: self.add_view(start, None)?, component_type };
        let sparse = Some(SparseElements { count: indices.len(), indices: places, values });
        self.add_accessor(Accessor { sparse, ..zeros })
    }

    /// Texture coordinates within 0 to 1 as normalised u16, others as floats; v becomes 1 - v. Requires KHR_mesh_quantization.
    pub(super) fn add_quantized_uvs(&mut self, values: &[Vec2], label: &str) -> Result<Index> {
        let fits = |v: &Vec2| v.cmpge(Vec2::ZERO).all() && v.cmple(Vec2::ONE).all();
        if !values.iter().all(fits) {
            return self.add_uvs(values, label);
        }
        let start = self.align();
        for c in values.iter().flat_map(|v| [v.x, 1.0 - v.y]) {
            self.bytes.extend_from_slice(&to_unorm16(c).to_le_bytes());
        }
        let view = self.add_stream(start, Some(target::VERTICES), Stream::Attributes { stride: 4 })?;
        self.add_accessor(Accessor { normalized: true, ..accessor_of(view, component::U16, values.len(), "VEC2") })
    }

    /// Joint weights as normalised bytes that sum to 255 at each vertex.
    pub(super) fn add_byte_weights(&mut self, values: &[[f32; 4]], label: &str) -> Result<Index> {
        check_finite(values.iter().map(|w| w.iter().all(|c| c.is_finite())), label)?;
        let start = self.align();
        self.bytes.extend(values.iter().flat_map(byte_weights));
        let view = self.add_stream(start, Some(target::VERTICES), Stream::Attributes { stride: 4 })?;
        self.add_accessor(Accessor { normalized: true, ..accessor_of(view, component::U8, values.len(), "VEC4") })
    }

    /// Linear RGBA in [0, 1] as normalised bytes.
    pub(super) fn add_byte_colors(&mut self, values: impl ExactSizeIterator<Item = [f32; 4]>) -> Result<Index> {
        let count = values.len();
        let start = self.align();
        self.bytes.extend(values.flatten().map(to_unorm8));
        let view = self.add_stream(start, Some(target::VERTICES), Stream::Attributes { stride: 4 })?;
        self.add_accessor(Accessor { normalized: true, ..accessor_of(view, component::U8, count, "VEC4") })
    }

    /// Vertex normals; one that is not of unit length is normalised, as validators refuse others.
    pub(super) fn add_normals(&mut self, values: &[Vec3], label: &str) -> Result<Index> {
        // |n|^2 = 1 + 2 e for a length of 1 + e: lengths within 5e-4 of 1 pass unchanged, so that good normals keep their bits.
        let unit = |n: &Vec3| if (n.length_squared() - 1.0).abs() <= 1e-3 { *n } else { normalize_or(*n, Vec3::Y) };
        // A normal that is not finite goes through as it is, so that `add_floats` reports it instead of writing the fallback +Y.
        let values = values.iter().map(|n| if n.is_finite() { unit(n) } else { *n });
        self.add_floats(values.flat_map(|v| [v.x, v.y, v.z]), "VEC3", 3, Some(target::VERTICES), label)
    }

    /// Unit vectors of vertices (normals, or tangents with their sign) as normalised signed bytes, accurate to half a degree.
    /// A view has a stride of four bytes; an accessor of type VEC3 skips the fourth. Requires KHR_mesh_quantization.
    pub(super) fn add_quantized_directions(
        &mut self,
        values: &[[f32; 4]],
        shape: &'static str,
        label: &str,
    ) -> Result<Index> {
        check_finite(values.iter().map(|v| v.iter().all(|c| c.is_finite())), label)?;
        let start = self.align();
        for v in values {
            // A rounded vector is of unit length to a hundredth, which validators accept.
            self.bytes.extend(v.map(to_snorm8).map(i8::cast_unsigned));
        }
        let view = self.add_stream(start, Some(target::VERTICES), Stream::Attributes { stride: 4 })?;
        if let Some(view) = self.views.last_mut() {
            // Vertex attributes must begin at multiples of four bytes (glTF 2.0, section 3.6.2.4); three bytes would not.
            view.byte_stride = Some(4);
        }
        self.add_accessor(Accessor { normalized: true, ..accessor_of(view, component::I8, values.len(), shape) })
    }

    /// Vectors of three floats, without bounds. `target`: usage of the buffer view, given only for vertex attributes.
    pub(super) fn add_vectors(&mut self, values: &[Vec3], target: Option<u32>, label: &str) -> Result<Index> {
        self.add_floats(values.iter().flat_map(|v| [v.x, v.y, v.z]), "VEC3", 3, target, label)
    }

    /// Texture coordinates; v becomes 1 - v, as glTF counts it from the top of the image.
    pub(super) fn add_uvs(&mut self, values: &[Vec2], label: &str) -> Result<Index> {
        self.add_floats(values.iter().flat_map(|v| [v.x, 1.0 - v.y]), "VEC2", 2, Some(target::VERTICES), label)
    }

    /// Vertex attributes of two floats, such as a TEXCOORD_1 that holds wind.
    pub(super) fn add_vertex_vec2s(&mut self, values: &[[f32; 2]], label: &str) -> Result<Index> {
        self.add_floats(values.iter().flatten().copied(), "VEC2", 2, Some(target::VERTICES), label)
    }

    /// Four floats for each vertex: joint weights or tangents.
    pub(super) fn add_vertex_vec4s(&mut self, values: &[[f32; 4]], label: &str) -> Result<Index> {
        self.add_floats(values.iter().flatten().copied(), "VEC4", 4, Some(target::VERTICES), label)
    }

    /// Keys of rotation: quaternions x, y, z, w as normalised 16-bit integers if the buffer will be compressed, else as floats.
    pub(super) fn add_rotation_keys(&mut self, values: &[Quat], label: &str) -> Result<Index> {
        if self.compressed {
            return self.add_short_quaternions(values, Stream::KEY_ROTATIONS, label);
        }
        self.add_floats(values.iter().flat_map(|q| [q.x, q.y, q.z, q.w]), "VEC4", 4, None, label)
    }

    /// Rotations of instances: unit quaternions as normalised 16-bit numbers, within 3e-5. `stream`: how compression rounds them.
    pub(super) fn add_instance_rotations(&mut self, values: &[Quat], stream: Stream, label: &str) -> Result<Index> {
        self.add_short_quaternions(values, stream, label)
    }

    fn add_short_quaternions(&mut self, values: &[Quat], stream: Stream, label: &str) -> Result<Index> {
        check_finite(values.iter().map(|q| q.is_finite()), label)?;
        let start = self.align();
        // Order x, y, z, w. The error of a component is half a step of 1/32767, 1.5e-5; the angle is twice as sensitive.
        for c in values.iter().flat_map(|q| q.to_array()) {
            self.bytes.extend_from_slice(&to_snorm16(c).to_le_bytes());
        }
        let view = self.add_stream(start, None, stream)?;
        self.add_accessor(Accessor { normalized: true, ..accessor_of(view, component::I16, values.len(), "VEC4") })
    }

    /// Four numbers from 0 to 1 for each instance as normalised 16-bit integers.
    pub(super) fn add_instance_quads(&mut self, values: &[[f32; 4]]) -> Result<Index> {
        let start = self.align();
        for c in values.iter().flatten() {
            self.bytes.extend_from_slice(&to_unorm16(*c).to_le_bytes());
        }
        let view = self.add_stream(start, None, Stream::Attributes { stride: 8 })?;
        self.add_accessor(Accessor { normalized: true, ..accessor_of(view, component::U16, values.len(), "VEC4") })
    }

    /// 4 x 4 matrices, column-major.
    pub(super) fn add_matrices(&mut self, values: &[[f32; 16]], label: &str) -> Result<Index> {
        self.add_floats(values.iter().flatten().copied(), "MAT4", 16, None, label)
    }

    /// Single floats outside vertex data: animation keys.
    pub(super) fn add_scalars(&mut self, values: &[f32], label: &str) -> Result<Index> {
        self.add_floats(values.iter().copied(), "SCALAR", 1, None, label)
    }

    /// Vertex attributes of one float, such as counts of points.
    pub(super) fn add_vertex_scalars(&mut self, values: &[f32], label: &str) -> Result<Index> {
        self.add_floats(values.iter().copied(), "SCALAR", 1, Some(target::VERTICES), label)
    }

    /// Increasing key times, s, with `min` and `max`, which the format requires for them.
    pub(super) fn add_key_times(&mut self, values: &[f32]) -> Result<Index> {
        let accessor = self.add_scalars(values, "key times")?;
        // Key times increase, so the first and the last are the minimum and the maximum.
        if let (Some(a), Some(first), Some(last)) = (self.accessors.last_mut(), values.first(), values.last()) {
            a.min = vec![first + 0.0];
            a.max = vec![last + 0.0];
        }
        Ok(accessor)
    }

    /// Linear RGBA in [0, 1] as normalised u16.
    pub(super) fn add_colors(&mut self, values: impl ExactSizeIterator<Item = [f32; 4]>) -> Result<Index> {
        let count = values.len();
        let start = self.align();
        for c in values.flatten() {
            self.bytes.extend_from_slice(&to_unorm16(c).to_le_bytes());
        }
        let view = self.add_stream(start, Some(target::VERTICES), Stream::Attributes { stride: 8 })?;
        self.add_accessor(Accessor { normalized: true, ..accessor_of(view, component::U16, count, "VEC4") })
    }

    /// Joint indices of vertices, for a skin of `joints` joints: u8 if that suffices, else u16.
    pub(super) fn add_joint_indices(&mut self, values: &[[u16; 4]], joints: usize) -> Result<Index> {
        let start = self.align();
        // Joint indices are 0 to joints - 1: 256 joints are the most that a byte can number.
        let bytes = joints <= 256;
        for j in values.iter().flatten() {
            match u8::try_from(*j) {
                Ok(j) if bytes => self.bytes.push(j),
                _ => self.bytes.extend_from_slice(&j.to_le_bytes()),
            }
        }
        let stride = if bytes { 4 } else { 8 };
        let view = self.add_stream(start, Some(target::VERTICES), Stream::Attributes { stride })?;
        let component = if bytes { component::U8 } else { component::U16 };
        self.add_accessor(accessor_of(view, component, values.len(), "VEC4"))
    }

    /// Indices of triangles over `vertices` vertices: u16 if that suffices, else u32.
    pub(super) fn add_triangle_indices(&mut self, triangles: &[[u32; 3]], vertices: usize) -> Result<Index> {
        let start = self.align();
        // Half the size whenever the largest index, vertices - 1, is at most 65534.
        let short = vertices <= MAX_SHORT_VERTICES;
        self.bytes.reserve(triangles.len() * if short { 6 } else { 12 });
        for i in triangles.iter().flatten() {
            match u16::try_from(*i) {
                Ok(i) if short => self.bytes.extend_from_slice(&i.to_le_bytes()),
                _ => self.bytes.extend_from_slice(&i.to_le_bytes()),
            }
        }
        let stride = if short { 2 } else { 4 };
        let view = self.add_stream(start, Some(target::INDICES), Stream::Triangles { stride })?;
        let component = if short { component::U16 } else { component::U32 };
        self.add_accessor(accessor_of(view, component, triangles.len() * 3, "SCALAR"))
    }

    /// The bytes of an embedded image; returns the buffer view.
    pub(super) fn add_file(&mut self, bytes: &[u8]) -> Result<Index> {
        let start = self.align();
        self.bytes.extend_from_slice(bytes);
        self.add_view(start, None)
    }

    /// An accessor of type `shape` over floats, `width` to an element. X001 names the first element that is not finite.
    fn add_floats(
        &mut self,
        values: impl Iterator<Item = f32>,
        shape: &'static str,
        width: usize,
        target: Option<u32>,
        label: &str,
    ) -> Result<Index> {
        let start = self.align();
        self.bytes.reserve(values.size_hint().0 * 4);
        // Checked while writing, in one pass: on an error the document is discarded with the bytes.
        let mut bad = None;
        for (i, v) in values.enumerate() {
            if !v.is_finite() {
                bad = bad.or(Some(i / width));
            }
            // Adding 0 turns -0 into 0 and leaves every other number as it is.
            self.bytes.extend_from_slice(&(v + 0.0).to_le_bytes());
        }
        if let Some(i) = bad {
            return Err(Error::export("X001", format!("{label}: element {i} is not finite")));
        }
        // The iterator may not know its length: count the elements by the bytes that they took.
        let count = (self.bytes.len() - start) / (4 * width);
        // Vectors of three outside of vertex data are translations and scales of keys and instances.
        let stream = match (target, shape) {
            (None, "VEC3") => Stream::Vectors,
            _ => Stream::Attributes { stride: 4 * width },
        };
        let view = self.add_stream(start, target, stream)?;
        self.add_accessor(accessor_of(view, component::F32, count, shape))
    }

    /// Pads the buffer with zeros to a multiple of four; returns its length, where the next view begins.
    fn align(&mut self) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.bytes.len()
    }

    /// A buffer view from `byte_offset` to the end of the buffer.
    fn add_view(&mut self, byte_offset: usize, target: Option<u32>) -> Result<Index> {
        // A .glb counts its bytes in 32 bits, and a .gltf is held to the same limit. The check is made here, so that the export
        // stops before memory is exhausted.
        if u32::try_from(self.bytes.len()).is_err() {
            return Err(too_large(self.bytes.len()));
        }
        let byte_length = self.bytes.len() - byte_offset;
        self.views.push(BufferView { byte_offset, byte_length, target, ..BufferView::default() });
        last_index(self.views.len())
    }

    /// A buffer view from `byte_offset` to the end of the buffer, of a stream that may be compressed.
    fn add_stream(&mut self, byte_offset: usize, target: Option<u32>, stream: Stream) -> Result<Index> {
        let view = self.add_view(byte_offset, target)?;
        if let Some(view) = self.views.last_mut() {
            view.stream = Some(stream);
        }
        Ok(view)
    }

    fn add_accessor(&mut self, accessor: Accessor) -> Result<Index> {
        self.accessors.push(accessor);
        last_index(self.accessors.len())
    }
}

/// Index of the last of `len` items; X005 beyond 2^32.
pub(super) fn last_index(len: usize) -> Result<Index> {
    // A list without items wraps to usize::MAX, which no u32 holds, and is refused along with lists that are too long.
    Index::try_from(len.wrapping_sub(1)).map_err(|_| Error::export("X005", "glTF document: more than 2^32 entries"))
}

/// X005: the file exceeds the size that the format can hold.
pub(super) fn too_large(bytes: usize) -> Error {
    let reason = format!(
        "glTF file of at least {bytes} bytes, the format ends at {}; show fewer instances or write usd",
        u32::MAX
    );
    Error::export("X005", reason)
}

/// X001 names the first element that is not finite.
fn check_finite(mut finite: impl Iterator<Item = bool>, label: &str) -> Result<()> {
    match finite.position(|f| !f) {
        Some(i) => Err(Error::export("X001", format!("{label}: element {i} is not finite"))),
        None => Ok(()),
    }
}

fn accessor_of(buffer_view: Index, component_type: u32, count: usize, shape: &'static str) -> Accessor {
    Accessor { buffer_view: Some(buffer_view), component_type, count, shape, ..Accessor::default() }
}

/// A number in [-1, 1] as a normalised i8: round(127 c) (glTF 2.0, section 3.11).
#[allow(clippy::cast_possible_truncation, reason = "clamped to +-127 before the cast")]
fn to_snorm8(c: f32) -> i8 {
    (c.clamp(-1.0, 1.0) * 127.0).round() as i8
}

/// A number in [0, 1] as a normalised u8: round(255 c).
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=255 before the cast")]
fn to_unorm8(c: f32) -> u8 {
    (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// A number in [-1, 1] as a normalised i16: round(32767 c).
#[allow(clippy::cast_possible_truncation, reason = "clamped to +-32767 before the cast")]
fn to_snorm16(c: f32) -> i16 {
    (c.clamp(-1.0, 1.0) * 32_767.0).round() as i16
}

/// A number in [0, 1] as a normalised u16: round(65535 c).
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65535 before the cast")]
fn to_unorm16(c: f32) -> u16 {
    // The cast truncates, so adding one half rounds to nearest; the product is never negative.
    (c.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_start_at_multiples_of_four_and_negative_zero_is_gone() {
        let mut b = BinaryBuffer::default();
        b.add_triangle_indices(&[[0, 1, 2]], 3).expect("indices");
        b.add_positions(&[Vec3::new(-0.0, 1.0, 2.0), Vec3::new(-3.0, 0.5, 2.0)], "p").expect("positions");
        assert_eq!(b.views[0].byte_length, 6);
        assert_eq!(b.views[1].byte_offset, 8);
        assert_eq!(&b.bytes[8..12], &0.0_f32.to_le_bytes());
        assert_eq!(
            (b.accessors[1].min.clone(), b.accessors[1].max.clone()),
            (vec![-3.0, 0.5, 2.0], vec![0.0, 1.0, 2.0])
        );
    }

    #[test]
    fn indices_widen_where_the_restart_value_would_appear() {
        let mut b = BinaryBuffer::default();
        b.add_triangle_indices(&[[0, 1, 65_534]], 65_535).expect("short");
        b.add_triangle_indices(&[[0, 1, 65_535]], 65_536).expect("long");
        assert_eq!(b.accessors.iter().map(|a| a.component_type).collect::<Vec<_>>(), [component::U16, component::U32]);
        b.add_joint_indices(&[[0, 1, 255, 0]], 256).expect("bytes");
        b.add_joint_indices(&[[0, 1, 256, 0]], 257).expect("words");
        assert_eq!(b.accessors[2].component_type, component::U8);
        assert_eq!(b.accessors[3].component_type, component::U16);
    }

    #[test]
    fn elements_that_are_zeros_take_no_bytes() {
        let mut b = BinaryBuffer::default();
        b.add_sparse_vectors(&[2, 70_000], &[Vec3::new(1.0, -2.0, 3.0), Vec3::new(4.0, -5.0, 6.0)], 70_001, "p")
            .expect("some");
        b.add_sparse_vectors(&[], &[], 5, "p").expect("none");
        let [some, none] = &b.accessors[..] else { unreachable!("two accessors") };
        assert_eq!((some.buffer_view, none.buffer_view, none.sparse.is_none()), (None, None, true));
        // The zeros are within the bounds.
        assert_eq!((some.min.clone(), some.max.clone()), (vec![0.0, -5.0, 0.0], vec![4.0, 0.0, 6.0]));
        let sparse = some.sparse.as_ref().expect("sparse");
        assert_eq!((sparse.count, sparse.indices.component_type, b.bytes.len()), (2, component::U32, 24 + 8));
        assert_eq!(b.bytes[24..], [2_u32, 70_000].map(u32::to_le_bytes).concat()[..]);
        assert!(b.views.iter().all(|v| v.target.is_none() && v.byte_stride.is_none()));
    }

    #[test]
    fn sparse_accessors_may_share_a_view_of_zeros() {
        let mut b = BinaryBuffer { has_zero_views: true, ..BinaryBuffer::default() };
        b.add_sparse_vectors(&[1], &[Vec3::X], 4, "p").expect("some");
        b.add_sparse_vectors(&[], &[], 3, "p").expect("none");
        b.add_sparse_vectors(&[6], &[Vec3::Y], 7, "p").expect("more");
        let views: Vec<Option<Index>> = b.accessors.iter().map(|a| a.buffer_view).collect();
        assert_eq!(views[0], views[1]);
        assert!(views[0].is_some() && views[2].is_some() && views[2] != views[0]);
        let zeros: Vec<&BufferView> = b.views.iter().filter(|v| v.byte_stride.is_some()).collect();
        assert_eq!(zeros.iter().map(|v| v.byte_length).collect::<Vec<_>>(), [48, 84]);
        for view in zeros {
            assert!(b.bytes[view.byte_offset..][..view.byte_length].iter().all(|byte| *byte == 0));
        }
    }

    #[test]
    fn a_position_that_is_not_finite_is_named() {
        let e = BinaryBuffer::default().add_positions(&[Vec3::ZERO, Vec3::NAN], "asset a, mesh m").expect_err("NaN");
        assert_eq!(e.to_string(), "X001: asset a, mesh m: element 1 is not finite");
    }
}
