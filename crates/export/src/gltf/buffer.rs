//! The binary part: every array that the document points into, appended at offsets that are multiples of four.

use glam::{Quat, Vec2, Vec3};

use super::json::{Accessor, BufferView, Index, component, target};
use osier_base::math::normalize_or;
use osier_base::{Error, Result};

/// Bytes and the views and accessors over them.
#[derive(Debug, Default)]
pub(super) struct Buffer {
    pub bytes: Vec<u8>,
    pub views: Vec<BufferView>,
    pub accessors: Vec<Accessor>,
}

/// Largest vertex count that u16 indices serve: 65535 itself would restart the primitive.
const SHORT: usize = 65_535;

impl Buffer {
    /// Positions of vertices, with their box. `what` names them in an error.
    pub(super) fn positions(&mut self, values: &[Vec3], what: &str) -> Result<Index> {
        let accessor = self.vectors(values, Some(target::VERTICES), what)?;
        let low = values.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let high = values.iter().copied().reduce(Vec3::max).unwrap_or_default();
        if let Some(a) = self.accessors.last_mut() {
            a.min = (low + 0.0).to_array().to_vec();
            a.max = (high + 0.0).to_array().to_vec();
        }
        Ok(accessor)
    }

    /// Normals of vertices; one that is not of length 1 is replaced by its direction, since readers refuse the file.
    pub(super) fn normals(&mut self, values: &[Vec3], what: &str) -> Result<Index> {
        let unit = |n: &Vec3| if (n.length_squared() - 1.0).abs() <= 1e-3 { *n } else { normalize_or(*n, Vec3::Y) };
        let values = values.iter().map(|n| if n.is_finite() { unit(n) } else { *n });
        self.floats(values.flat_map(|v| [v.x, v.y, v.z]), "VEC3", 3, Some(target::VERTICES), what)
    }

    /// Unit vectors of vertices as four normalised bytes each, of which `shape` uses three or all: directions within half a degree.
    /// Needs KHR_mesh_quantization.
    pub(super) fn directions(&mut self, values: &[[f32; 4]], shape: &'static str, what: &str) -> Result<Index> {
        if let Some(i) = values.iter().position(|v| v.iter().any(|c| !c.is_finite())) {
            return Err(Error::export("X001", format!("{what}: element {i} is not finite")));
        }
        let start = self.start();
        for v in values {
            // Rounded components are unit to a hundredth, which readers that check for it take.
            self.bytes.extend(v.map(signed_byte).map(i8::cast_unsigned));
        }
        let view = self.view(start, Some(target::VERTICES))?;
        if let Some(view) = self.views.last_mut() {
            view.byte_stride = Some(4);
        }
        self.accessor(Accessor { normalized: true, ..shaped(view, component::I8, values.len(), shape) })
    }

    /// Three floats each, outside vertex data unless a target is given.
    pub(super) fn vectors(&mut self, values: &[Vec3], target: Option<u32>, what: &str) -> Result<Index> {
        self.floats(values.iter().flat_map(|v| [v.x, v.y, v.z]), "VEC3", 3, target, what)
    }

    /// Texture coordinates; v is turned over since glTF counts it from the top.
    pub(super) fn uvs(&mut self, values: &[Vec2], what: &str) -> Result<Index> {
        self.floats(values.iter().flat_map(|v| [v.x, 1.0 - v.y]), "VEC2", 2, Some(target::VERTICES), what)
    }

    /// Four floats per vertex: joint weights or tangents.
    pub(super) fn quads(&mut self, values: &[[f32; 4]], what: &str) -> Result<Index> {
        self.floats(values.iter().flatten().copied(), "VEC4", 4, Some(target::VERTICES), what)
    }

    /// Quaternions, x y z w.
    pub(super) fn quaternions(&mut self, values: &[Quat], what: &str) -> Result<Index> {
        self.floats(values.iter().flat_map(|q| [q.x, q.y, q.z, q.w]), "VEC4", 4, None, what)
    }

    /// Unit quaternions as normalised 16-bit numbers, within 3e-5, for instances, of which there are many.
    pub(super) fn short_quaternions(&mut self, values: &[Quat], what: &str) -> Result<Index> {
        if let Some(i) = values.iter().position(|q| !q.is_finite()) {
            return Err(Error::export("X001", format!("{what}: element {i} is not finite")));
        }
        let start = self.start();
        for c in values.iter().flat_map(|q| q.to_array()) {
            self.bytes.extend_from_slice(&signed_short(c).to_le_bytes());
        }
        let view = self.view(start, None)?;
        self.accessor(Accessor { normalized: true, ..shaped(view, component::I16, values.len(), "VEC4") })
    }

    /// 4 x 4 matrices, column major.
    pub(super) fn matrices(&mut self, values: &[[f32; 16]], what: &str) -> Result<Index> {
        self.floats(values.iter().flatten().copied(), "MAT4", 16, None, what)
    }

    /// Single floats.
    pub(super) fn scalars(&mut self, values: &[f32], what: &str) -> Result<Index> {
        self.floats(values.iter().copied(), "SCALAR", 1, None, what)
    }

    /// A number per vertex.
    pub(super) fn numbers(&mut self, values: &[f32], what: &str) -> Result<Index> {
        self.floats(values.iter().copied(), "SCALAR", 1, Some(target::VERTICES), what)
    }

    /// Rising key times, s, with first and last.
    pub(super) fn times(&mut self, values: &[f32]) -> Result<Index> {
        let accessor = self.scalars(values, "key times")?;
        if let (Some(a), Some(first), Some(last)) = (self.accessors.last_mut(), values.first(), values.last()) {
            a.min = vec![first + 0.0];
            a.max = vec![last + 0.0];
        }
        Ok(accessor)
    }

    /// Linear colours as normalised u16 RGBA.
    pub(super) fn colors(&mut self, values: impl ExactSizeIterator<Item = [f32; 4]>) -> Result<Index> {
        let count = values.len();
        let start = self.start();
        for c in values.flatten() {
            self.bytes.extend_from_slice(&short(c).to_le_bytes());
        }
        let view = self.view(start, Some(target::VERTICES))?;
        self.accessor(Accessor { normalized: true, ..shaped(view, component::U16, count, "VEC4") })
    }

    /// Joint indices of a skin with `joints` joints: bytes while they suffice.
    pub(super) fn joints(&mut self, values: &[[u16; 4]], joints: usize) -> Result<Index> {
        let start = self.start();
        let bytes = joints <= 256;
        for j in values.iter().flatten() {
            match u8::try_from(*j) {
                Ok(j) if bytes => self.bytes.push(j),
                _ => self.bytes.extend_from_slice(&j.to_le_bytes()),
            }
        }
        let view = self.view(start, Some(target::VERTICES))?;
        let component = if bytes { component::U8 } else { component::U16 };
        self.accessor(shaped(view, component, values.len(), "VEC4"))
    }

    /// Triangles over `vertices` vertices.
    pub(super) fn indices(&mut self, triangles: &[[u32; 3]], vertices: usize) -> Result<Index> {
        let start = self.start();
        let short = vertices <= SHORT;
        self.bytes.reserve(triangles.len() * if short { 6 } else { 12 });
        for i in triangles.iter().flatten() {
            match u16::try_from(*i) {
                Ok(i) if short => self.bytes.extend_from_slice(&i.to_le_bytes()),
                _ => self.bytes.extend_from_slice(&i.to_le_bytes()),
            }
        }
        let view = self.view(start, Some(target::INDICES))?;
        let component = if short { component::U16 } else { component::U32 };
        self.accessor(shaped(view, component, triangles.len() * 3, "SCALAR"))
    }

    /// Bytes of an embedded file.
    pub(super) fn file(&mut self, bytes: &[u8]) -> Result<Index> {
        let start = self.start();
        self.bytes.extend_from_slice(bytes);
        self.view(start, None)
    }

    fn floats(
        &mut self,
        values: impl Iterator<Item = f32>,
        shape: &'static str,
        width: usize,
        target: Option<u32>,
        what: &str,
    ) -> Result<Index> {
        let start = self.start();
        self.bytes.reserve(values.size_hint().0 * 4);
        let mut bad = None;
        for (i, v) in values.enumerate() {
            if !v.is_finite() {
                bad = bad.or(Some(i / width));
            }
            // Adding 0 turns -0 into 0 and leaves every other number as it is.
            self.bytes.extend_from_slice(&(v + 0.0).to_le_bytes());
        }
        if let Some(i) = bad {
            return Err(Error::export("X001", format!("{what}: element {i} is not finite")));
        }
        let count = (self.bytes.len() - start) / (4 * width);
        let view = self.view(start, target)?;
        self.accessor(shaped(view, component::F32, count, shape))
    }

    fn start(&mut self) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.bytes.len()
    }

    fn view(&mut self, byte_offset: usize, target: Option<u32>) -> Result<Index> {
        // Ends the work before memory does: no container holds more.
        if u32::try_from(self.bytes.len()).is_err() {
            return Err(too_large(self.bytes.len()));
        }
        let byte_length = self.bytes.len() - byte_offset;
        self.views.push(BufferView { buffer: 0, byte_offset, byte_length, byte_stride: None, target });
        last(self.views.len())
    }

    fn accessor(&mut self, accessor: Accessor) -> Result<Index> {
        self.accessors.push(accessor);
        last(self.accessors.len())
    }
}

/// Index of the last of `len` items.
pub(super) fn last(len: usize) -> Result<Index> {
    Index::try_from(len.wrapping_sub(1)).map_err(|_| Error::export("X005", "glTF document: more than 2^32 entries"))
}

/// The error of a file that passes the end of the format.
pub(super) fn too_large(bytes: usize) -> Error {
    let reason = format!(
        "glTF file of at least {bytes} bytes, the format ends at {}; show fewer instances or write usd",
        u32::MAX
    );
    Error::export("X005", reason)
}

fn shaped(buffer_view: Index, component_type: u32, count: usize, shape: &'static str) -> Accessor {
    Accessor { buffer_view, component_type, count, shape, ..Accessor::default() }
}

/// A number in [-1, 1] as a normalised i8, rounded to nearest.
#[allow(clippy::cast_possible_truncation, reason = "clamped to +-127 before the cast")]
fn signed_byte(c: f32) -> i8 {
    (c.clamp(-1.0, 1.0) * 127.0).round() as i8
}

/// A number in [-1, 1] as a normalised i16, rounded to nearest.
#[allow(clippy::cast_possible_truncation, reason = "clamped to +-32767 before the cast")]
fn signed_short(c: f32) -> i16 {
    (c.clamp(-1.0, 1.0) * 32_767.0).round() as i16
}

/// A number in [0, 1] as a normalised u16, rounded to nearest.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65535 before the cast")]
fn short(c: f32) -> u16 {
    (c.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_start_at_multiples_of_four_and_negative_zero_is_gone() {
        let mut b = Buffer::default();
        b.indices(&[[0, 1, 2]], 3).expect("indices");
        b.positions(&[Vec3::new(-0.0, 1.0, 2.0), Vec3::new(-3.0, 0.5, 2.0)], "p").expect("positions");
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
        let mut b = Buffer::default();
        b.indices(&[[0, 1, 65_534]], 65_535).expect("short");
        b.indices(&[[0, 1, 65_535]], 65_536).expect("long");
        assert_eq!(b.accessors.iter().map(|a| a.component_type).collect::<Vec<_>>(), [component::U16, component::U32]);
        b.joints(&[[0, 1, 255, 0]], 256).expect("bytes");
        b.joints(&[[0, 1, 256, 0]], 257).expect("words");
        assert_eq!(b.accessors[2].component_type, component::U8);
        assert_eq!(b.accessors[3].component_type, component::U16);
    }

    #[test]
    fn a_position_that_is_not_finite_is_named() {
        let e = Buffer::default().positions(&[Vec3::ZERO, Vec3::NAN], "asset a, mesh m").expect_err("NaN");
        assert_eq!(e.to_string(), "X001: asset a, mesh m: element 1 is not finite");
    }
}
