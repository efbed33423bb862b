//! The scene hash: BLAKE3 over resolved fields in declaration order.

/// Feeds a hash: integers and float bits little endian, texts and lists with their length as u64 before them.
pub trait Digest {
    /// Feeds the bytes of the value into `hasher`, the same on every machine.
    fn digest(&self, hasher: &mut blake3::Hasher);
}

macro_rules! numbers {
    ($($t:ty),*) => {$(
        impl Digest for $t {
            fn digest(&self, hasher: &mut blake3::Hasher) {
                hasher.update(&self.to_le_bytes());
            }
        }
    )*};
}
numbers!(u8, u32, u64, i64, f32, f64);

impl Digest for bool {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        u8::from(*self).digest(hasher);
    }
}

impl Digest for str {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        (self.len() as u64).digest(hasher);
        hasher.update(self.as_bytes());
    }
}

impl Digest for String {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        self.as_str().digest(hasher);
    }
}

/// Hashed as its code point, a u32.
impl Digest for char {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        u32::from(*self).digest(hasher);
    }
}

/// Hashed as 64 bits, whatever the machine's word size.
impl Digest for usize {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        (*self as u64).digest(hasher);
    }
}

impl<T: Digest> Digest for Vec<T> {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        (self.len() as u64).digest(hasher);
        self.iter().for_each(|v| v.digest(hasher));
    }
}

impl<T: Digest, const N: usize> Digest for [T; N] {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        self.iter().for_each(|v| v.digest(hasher));
    }
}

/// Hashed like a list of zero or one element.
impl<T: Digest> Digest for Option<T> {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        u64::from(self.is_some()).digest(hasher);
        if let Some(v) = self {
            v.digest(hasher);
        }
    }
}

impl<A: Digest, B: Digest> Digest for (A, B) {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        self.0.digest(hasher);
        self.1.digest(hasher);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(value: &impl Digest) -> blake3::Hash {
        let mut h = blake3::Hasher::new();
        value.digest(&mut h);
        h.finalize()
    }

    #[test]
    fn lengths_keep_neighbours_apart() {
        assert_ne!(of(&vec!["ab".to_owned(), "c".into()]), of(&vec!["a".to_owned(), "bc".into()]));
        assert_ne!(of(&(Some(1_u32), None::<u32>)), of(&(None::<u32>, Some(1_u32))));
        assert_eq!(of(&"a".to_owned()), blake3::hash(&[1, 0, 0, 0, 0, 0, 0, 0, b'a']));
    }
}
