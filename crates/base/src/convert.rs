//! Conversions between integer widths: an error where a count can exceed the target type, infallible where it cannot.
//!
//! Files and meshes store indices as `u32`, `u16` or `i32`; memory is counted in `usize`. The error of a failed conversion names
//! the counted things, their number and the largest number allowed. No count is ever replaced by another number.

use crate::{Error, Result};

const _: () = assert!(usize::BITS >= 32, "supported targets have addresses of 32 or 64 bits");

/// Integer types that [`narrow`] converts to, each with the limit that its error message names.
pub trait IndexType {
    /// Largest value of the type, for the `limit` of [`Error::TooMany`].
    const LARGEST: u64;
}

macro_rules! index_type {
    ($($t:ty)*) => {$(
        impl IndexType for $t {
            const LARGEST: u64 = <$t>::MAX as u64;
        }
    )*};
}

index_type!(u8 u16 u32 usize i32 i64);

/// `n` as an index of type `T`. `what`: the things that `n` counts, in the plural, for the message.
/// # Errors
/// [`Error::TooMany`] if `T` cannot hold `n`.
/// # Examples
/// ```
/// use osier_base::convert::narrow;
///
/// let joint: u16 = narrow(7_usize, "joints")?;
/// assert_eq!(joint, 7);
/// let error = narrow::<u16, _>(70_000_usize, "joints").expect_err("beyond 16 bits");
/// assert_eq!(error.to_string(), "70000 joints are too many; at most 65535 can be indexed");
/// # Ok::<(), osier_base::Error>(())
/// ```
#[inline]
pub fn narrow<T, N>(n: N, what: &'static str) -> Result<T>
where
    T: IndexType + TryFrom<N>,
    N: Copy + std::fmt::Display,
{
    match T::try_from(n) {
        Ok(index) => Ok(index),
        Err(_) => Err(too_many(n, what, T::LARGEST)),
    }
}

/// [`narrow`] from `usize` to `u32`, the type of most indices.
/// # Errors
/// [`Error::TooMany`] if `n` exceeds `u32::MAX`.
/// # Examples
/// ```
/// use osier_base::convert::index;
///
/// let points = [[0.0_f32; 3]; 4];
/// assert_eq!(index(points.len(), "points of a mesh")?, 4);
/// # Ok::<(), osier_base::Error>(())
/// ```
#[inline]
pub fn index(n: usize, what: &'static str) -> Result<u32> {
    narrow(n, what)
}

/// An index or a count as `usize`; exact on the supported targets of 32 and 64 bits.
/// # Examples
/// ```
/// use osier_base::convert::to_usize;
///
/// assert_eq!(["a", "b"][to_usize(1)], "b");
/// ```
#[inline(always)]
pub const fn to_usize(n: u32) -> usize {
    n as usize
}

/// A limit or a budget as `usize`. Beyond the address space of a 32-bit target it is the largest `usize`, which no
/// collection there reaches.
/// # Examples
/// ```
/// use osier_base::{convert::limit, limits::Limits};
///
/// let modules = limit(Limits::default().get("modules"));
/// assert_eq!(modules, 20_000_000);
/// ```
#[inline]
pub fn limit(n: u64) -> usize {
    usize::try_from(n).unwrap_or(usize::MAX)
}

/// A count as a 32-bit index, for collections whose size a limit or the memory bounds below 2^32; the largest index for counts
/// beyond.
/// # Examples
/// ```
/// use osier_base::convert::saturating_index;
///
/// assert_eq!(saturating_index(7), 7);
/// ```
#[inline]
pub fn saturating_index(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// `n` as a byte, 255 for larger values: for colours and weights that rounding may have raised to 256.
/// # Examples
/// ```
/// assert_eq!(osier_base::convert::saturating_byte(256), 255);
/// ```
#[inline(always)]
pub fn saturating_byte(n: u32) -> u8 {
    n.min(255) as u8
}

#[cold]
fn too_many(n: impl std::fmt::Display, what: &'static str, limit: u64) -> Error {
    Error::TooMany { what, count: n.to_string(), limit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_an_error() {
        assert_eq!(narrow::<i32, u32>(5, "frames").expect("fits"), 5);
        assert!(narrow::<i32, u32>(u32::MAX, "frames").is_err());
        assert!(narrow::<u8, i64>(-1, "layers").is_err());
        assert_eq!(index(to_usize(u32::MAX), "points").expect("fits"), u32::MAX);
        #[cfg(target_pointer_width = "64")]
        assert!(matches!(index(1 << 32, "points"), Err(Error::TooMany { limit: 0xffff_ffff, .. })));
    }
}
