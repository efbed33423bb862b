//! Packages (`.usdz`): zip archives whose members are stored uncompressed, each beginning at a multiple of 64 bytes, so that
//! readers can map them. The first member is the root layer.
//!
//! Sources: the usdz file format specification of OpenUSD; PKWARE's APPNOTE.TXT for zip, whose sections the comments name.

use std::sync::Arc;

use super::byte_sink::ByteSink;
use osier_base::convert::limit;
use osier_base::files::Output;
use osier_base::{Error, Result};

/// Alignment of members, bytes.
const ALIGN: u64 = 64;
/// Size of the fixed part of a local file header, bytes.
const LOCAL_HEADER: usize = 30;
/// 1980-01-01 in MS-DOS form, so that equal content gives equal bytes.
const DATE: u16 = 1 << 5 | 1;
/// Identifier of the extra field that holds the padding, the same as that of OpenUSD's writer.
const PADDING_ID: u16 = 0x1986;
/// Bytes at the front of the root layer that may be rewritten: more than the header of a crate file.
const REWRITABLE_BYTES: usize = 128;

/// A member that follows the root layer.
pub(super) struct UsdzMember {
    /// Path in the package, as layers refer to it.
    pub(super) name: String,
    pub(super) bytes: Arc<[u8]>,
}

/// Writes a package: the root layer streams through it as through any sink, then follow the other members.
pub(super) struct UsdzWriter {
    out: Output,
    /// Offset of the root layer in the file.
    start: u64,
    /// The first [`REWRITABLE_BYTES`] of the root layer. They may change after the rest has passed, so their checksum is
    /// computed last.
    head: Vec<u8>,
    /// Checksum of the root layer behind `head`.
    tail: Crc32,
    others: Vec<UsdzMember>,
    entries: Vec<ZipEntry>,
}

/// A member as the central directory lists it.
struct ZipEntry {
    name: String,
    /// Offset of its local file header in the package.
    offset: u64,
    bytes: u64,
    crc: u32,
}

impl UsdzWriter {
    /// Starts a package with a root layer of that name; `others` follow it.
    pub(super) fn new(mut out: Output, root: &str, others: Vec<UsdzMember>) -> Result<Self> {
        // Size and checksum of the root layer are not known yet; `commit` fills them in.
        let start = write_local_header(&mut out, root, 0, 0)?;
        let entries = vec![ZipEntry { name: root.to_owned(), offset: 0, bytes: 0, crc: 0 }];
        Ok(Self { out, start, head: Vec::new(), tail: Crc32::default(), others, entries })
    }

    fn write_central_directory(&mut self) -> Result<()> {
        let start = self.out.position();
        for e in &self.entries {
            // Central directory header, APPNOTE 4.3.12: signature; versions made by and needed (1.0), flags, method (0: stored),
            // time, date; checksum, compressed and uncompressed size, length of the name.
            let mut h = Vec::new();
            h.extend(0x0201_4b50_u32.to_le_bytes());
            h.extend([10_u16, 10, 0, 0, 0, DATE].iter().flat_map(|x| x.to_le_bytes()));
            h.extend(e.crc.to_le_bytes());
            h.extend(zip_u32(e.bytes)?.to_le_bytes());
            h.extend(zip_u32(e.bytes)?.to_le_bytes());
            h.extend(name_length(&e.name)?.to_le_bytes());
            // No extra field, no comment, disk 0, no attributes.
            h.extend([0; 12]);
            h.extend(zip_u32(e.offset)?.to_le_bytes());
            h.extend(e.name.as_bytes());
            self.out.put(&h)?;
        }
        // End of central directory record, APPNOTE 4.3.16: signature, numbers of this disk and the first one, entries on this
        // disk and in all, size and offset of the directory, length of the comment.
        let bytes = self.out.position() - start;
        let count = u16::try_from(self.entries.len()).map_err(|_| too_large())?;
        let mut h = 0x0605_4b50_u32.to_le_bytes().to_vec();
        h.extend([0, 0, count, count].iter().flat_map(|x: &u16| x.to_le_bytes()));
        h.extend(zip_u32(bytes)?.to_le_bytes());
        h.extend(zip_u32(start)?.to_le_bytes());
        h.extend([0; 2]);
        self.out.put(&h)
    }
}

impl ByteSink for UsdzWriter {
    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        // The first bytes are kept for the checksum at the end; only the bytes after them are added to the checksum at once.
        let into_head = bytes.len().min(REWRITABLE_BYTES - self.head.len().min(REWRITABLE_BYTES));
        let (head, tail) = bytes.split_at(into_head);
        self.head.extend_from_slice(head);
        self.tail.update(tail);
        self.out.put(bytes)
    }

    fn put_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        // The bytes after the head are already in the checksum, so only the head can be rewritten.
        let first = limit(offset);
        let slot = first.checked_add(bytes.len()).and_then(|end| self.head.get_mut(first..end));
        slot.ok_or_else(too_large)?.copy_from_slice(bytes);
        self.out.put_at(self.start + offset, bytes)
    }

    fn position(&self) -> u64 {
        self.out.position() - self.start
    }

    fn commit(mut self: Box<Self>) -> Result<()> {
        let bytes = self.out.position() - self.start;
        let mut head = Crc32::default();
        head.update(&self.head);
        let crc = head.combine(&self.tail);
        // Checksum and both sizes stand at byte 14 of the local file header of the root layer, which begins the file.
        if let Some(root) = self.entries.first_mut() {
            root.bytes = bytes;
            root.crc = crc;
        }
        let mut fields = crc.to_le_bytes().to_vec();
        fields.extend(zip_u32(bytes)?.to_le_bytes());
        fields.extend(zip_u32(bytes)?.to_le_bytes());
        self.out.put_at(14, &fields)?;
        for member in std::mem::take(&mut self.others) {
            let mut crc = Crc32::default();
            crc.update(&member.bytes);
            let (offset, bytes) = (self.out.position(), member.bytes.len() as u64);
            write_local_header(&mut self.out, &member.name, crc.value(), bytes)?;
            self.out.put(&member.bytes)?;
            self.entries.push(ZipEntry { name: member.name, offset, bytes, crc: crc.value() });
        }
        self.write_central_directory()?;
        self.out.commit()
    }
}

/// Writes the local file header of a member, padded so that the member is aligned. Returns the offset of the member.
fn write_local_header(out: &mut Output, name: &str, crc: u32, bytes: u64) -> Result<u64> {
    // The 4 bytes are identifier and length of the extra field, which are there even if no padding is needed.
    let end = out.position() + (LOCAL_HEADER + name.len() + 4) as u64;
    // The outer remainder makes the padding 0, not 64, where the member is aligned already.
    let padding = (ALIGN - end % ALIGN) % ALIGN;
    // Local file header, APPNOTE 4.3.7: signature; version needed (1.0), flags, method (0: stored), time, date; checksum,
    // compressed and uncompressed size, lengths of name and extra field; the name; the extra field.
    let mut h = 0x0403_4b50_u32.to_le_bytes().to_vec();
    h.extend([10_u16, 0, 0, 0, DATE].iter().flat_map(|x| x.to_le_bytes()));
    h.extend(crc.to_le_bytes());
    h.extend(zip_u32(bytes)?.to_le_bytes());
    h.extend(zip_u32(bytes)?.to_le_bytes());
    h.extend(name_length(name)?.to_le_bytes());
    let padding = u16::try_from(padding).map_err(|_| too_large())?;
    h.extend((padding + 4).to_le_bytes());
    h.extend(name.as_bytes());
    h.extend(PADDING_ID.to_le_bytes());
    h.extend(padding.to_le_bytes());
    h.extend(std::iter::repeat_n(0_u8, usize::from(padding)));
    out.put(&h)?;
    Ok(out.position())
}

fn zip_u32(n: u64) -> Result<u32> {
    u32::try_from(n).map_err(|_| too_large())
}

fn name_length(name: &str) -> Result<u16> {
    u16::try_from(name.len()).map_err(|_| too_large())
}

fn too_large() -> Error {
    Error::Limit {
        name: "a usdz package".into(),
        wanted: "over 4 GiB".into(),
        limit: "4 GiB".into(),
        flag: String::new(),
        help: "choose another ending: .usdc".into(),
    }
}

/// The checksum of zip archives, and the number of bytes it covers.
/// Source: ISO 3309 CRC-32, polynomial 0xedb88320 reflected.
#[derive(Debug, Clone, Default)]
struct Crc32 {
    state: u32,
    length: u64,
}

/// Tables of the slicing-by-8 method (Kounavis and Berry 2005): `CRC_TABLES[k][x]` is the effect of byte x followed by k zero
/// bytes, so that eight bytes are folded with eight independent look-ups.
const CRC_TABLES: [[u32; 256]; 8] = crc_tables();

const fn crc_tables() -> [[u32; 256]; 8] {
    let mut t = [[0_u32; 256]; 8];
    // The first table: divide each byte by the polynomial bit by bit.
    let mut i = 0;
    let mut byte = 0_u32;
    while i < 256 {
        let mut c = byte;
        let mut k = 0;
        while k < 8 {
            c = if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 };
            k += 1;
        }
        t[0][i] = c;
        i += 1;
        byte += 1;
    }
    // Each further table: the one before, advanced by a zero byte.
    let mut row = 1;
    while row < 8 {
        let mut i = 0;
        while i < 256 {
            t[row][i] = (t[row - 1][i] >> 8) ^ t[0][(t[row - 1][i] & 255) as usize];
            i += 1;
        }
        row += 1;
    }
    t
}

impl Crc32 {
    fn update(&mut self, bytes: &[u8]) {
        let mut c = !self.state;
        let (eights, rest) = bytes.as_chunks::<8>();
        for b in eights {
            // The state folds into the first four bytes; the first byte is followed by seven others, so it takes the last table.
            let [a0, a1, a2, a3] = c.to_le_bytes();
            let mixed = [b[0] ^ a0, b[1] ^ a1, b[2] ^ a2, b[3] ^ a3, b[4], b[5], b[6], b[7]];
            c = mixed.iter().zip(CRC_TABLES.iter().rev()).fold(0, |c, (x, t)| c ^ t[usize::from(*x)]);
        }
        for b in rest {
            c = (c >> 8) ^ CRC_TABLES[0][usize::from(c.to_le_bytes()[0] ^ b)];
        }
        self.state = !c;
        self.length += bytes.len() as u64;
    }

    fn value(&self) -> u32 {
        self.state
    }

    /// Checksum of these bytes followed by those of `tail` (zlib's `crc32_combine`). The checksum is linear over GF(2): appending
    /// `tail.length` zero bytes to these multiplies the state by a power of a 32 x 32 bit matrix, found by repeated squaring.
    fn combine(&self, tail: &Self) -> u32 {
        // A matrix is its 32 columns as words: applying it adds (exclusive or) the columns of the bits that are set.
        let apply = |m: &[u32; 32], v: u32| (0..32).filter(|i| v >> i & 1 == 1).fold(0, |s, i| s ^ m[i]);
        let square = |m: &[u32; 32]| std::array::from_fn(|i| apply(m, m[i]));
        // The matrix of one zero bit shifts right and feeds the polynomial in; squared three times it is that of a zero byte.
        let mut power: [u32; 32] = std::array::from_fn(|i| if i == 0 { 0xedb8_8320 } else { 1 << (i - 1) });
        for _ in 0..3 {
            power = square(&power);
        }
        let (mut state, mut n) = (self.state, tail.length);
        while n > 0 {
            if n & 1 == 1 {
                state = apply(&power, state);
            }
            power = square(&power);
            n >>= 1;
        }
        state ^ tail.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crc(bytes: &[u8]) -> Crc32 {
        let mut c = Crc32::default();
        c.update(bytes);
        c
    }

    #[test]
    fn checksums_are_the_known_ones_and_join() {
        assert_eq!(crc(b"123456789").value(), 0xcbf4_3926);
        let bytes: Vec<u8> = (0..1000_u32).map(|i| (i * 7 % 251).to_le_bytes()[0]).collect();
        for cut in [0, 1, 88, 999, 1000] {
            assert_eq!(crc(&bytes[..cut]).combine(&crc(&bytes[cut..])), crc(&bytes).value());
        }
    }
}
