//! Kinds of content of a buffer view, which decide how its bytes are compressed.

/// Kind of the elements of a buffer view, which determines how EXT_meshopt_compression encodes them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stream {
    /// Elements of `stride` bytes that keep every bit.
    Attributes { stride: usize },
    /// Indices of triangles, of `stride` bytes each; the corners of a triangle may rotate.
    Triangles { stride: usize },
    /// Unit quaternions as four normalised 16-bit integers, kept with `bits` bits to a component.
    Rotations { bits: u32 },
    /// Vectors of three floats with a common exponent; the encoder chooses how many bits each keeps.
    Vectors,
}

impl Stream {
    /// Rotations of joints, moving instances and copies of whole plants: 5e-5 rad, a millimetre at the top of a tree of 20 m.
    pub(super) const KEY_ROTATIONS: Self = Self::Rotations { bits: 16 };
    /// Rotations of leaves: 7e-4 rad, less than 0.1 mm at the tip of a leaf.
    pub(super) const INSTANCE_ROTATIONS: Self = Self::Rotations { bits: 12 };

    /// Bytes from the beginning of an element to that of the next.
    pub(super) fn stride(self) -> usize {
        match self {
            Self::Attributes { stride } | Self::Triangles { stride } => stride,
            Self::Rotations { .. } => 8,
            Self::Vectors => 12,
        }
    }

    /// Value of `mode` in EXT_meshopt_compression.
    pub(super) fn mode(self) -> &'static str {
        match self {
            Self::Triangles { .. } => "TRIANGLES",
            _ => "ATTRIBUTES",
        }
    }

    /// Value of `filter` in EXT_meshopt_compression; `None` for lossless encoding.
    pub(super) fn filter(self) -> Option<&'static str> {
        match self {
            Self::Rotations { .. } => Some("QUATERNION"),
            Self::Vectors => Some("EXPONENTIAL"),
            Self::Attributes { .. } | Self::Triangles { .. } => None,
        }
    }
}
