//! Pictures of old programs: Silicon Graphics (`.rgb`, `.sgi`, `.bw`) and Targa (`.tga`), which textures of cpfg are stored in.
//! Sizes are checked before memory is spent.

use super::decode::{DecodedImage, spend};
use crate::{ImportContext, ImportResult};

/// First bytes of a Silicon Graphics picture: the number 474, big-endian.
const SGI_MAGIC: [u8; 2] = [0x01, 0xda];
/// Bytes of a Silicon Graphics header, before the pixels or the table of compressed rows.
const SGI_HEADER: usize = 512;
/// Bytes of a Targa header, before its identification text and colour map.
const TARGA_HEADER: usize = 18;

/// Size of a picture, and how many channels its decoding yields.
#[derive(Debug, Clone, Copy)]
struct Shape {
    width: usize,
    height: usize,
    /// Interleaved channels of the result: 1, 3 or 4.
    channels: usize,
}

/// Decodes a picture of an old format; `None` if bytes and name belong to neither. `name`: of the file, whose extension
/// identifies Targa.
/// # Errors
/// X010 if it is damaged or over a limit.
pub(crate) fn decode_old(
    context: &ImportContext<'_>,
    name: &str,
    bytes: &[u8],
    spent: &mut u64,
) -> Option<ImportResult<DecodedImage>> {
    if bytes.starts_with(&SGI_MAGIC) {
        return Some(picture(context, bytes, spent, sgi_shape, sgi_samples));
    }
    let is_targa = name.to_ascii_lowercase().ends_with(".tga") || name.to_ascii_lowercase().ends_with(".targa");
    is_targa.then(|| picture(context, bytes, spent, targa_shape, targa_samples))
}

/// Reads the shape, checks it against the limits, then reads the samples.
fn picture(
    context: &ImportContext<'_>,
    bytes: &[u8],
    spent: &mut u64,
    shape_of: fn(&[u8]) -> Option<Shape>,
    samples_of: fn(&[u8], Shape) -> Option<Vec<u8>>,
) -> ImportResult<DecodedImage> {
    let damaged = || context.error_in_file("X010", "picture: image is damaged, or of a kind that is not read");
    let shape = shape_of(bytes).ok_or_else(damaged)?;
    let side = context.options.limits.get("image-side");
    if shape.width.max(shape.height) as u64 > side {
        let message =
            format!("picture: image of {} x {} pixels, the limit is {side} a side", shape.width, shape.height);
        return Err(Box::new(context.error_in_file("X010", message).help("make it smaller, or use --max-image-side")));
    }
    // Check the size in the header against the limit before any sample is stored.
    spend(context, "picture", (shape.width * shape.height * shape.channels) as u64, spent)?;
    let samples = samples_of(bytes, shape).ok_or_else(damaged)?;
    let (Ok(width), Ok(height), Ok(channels)) =
        (u32::try_from(shape.width), u32::try_from(shape.height), u8::try_from(shape.channels))
    else {
        return Err(damaged());
    };
    Ok(DecodedImage { width, height, channels, samples })
}

fn big_u16(bytes: &[u8], at: usize) -> Option<usize> {
    Some(usize::from(*bytes.get(at)?) << 8 | usize::from(*bytes.get(at + 1)?))
}

fn little_u16(bytes: &[u8], at: usize) -> Option<usize> {
    Some(usize::from(*bytes.get(at + 1)?) << 8 | usize::from(*bytes.get(at)?))
}

/// Shape from the header; `None` for samples of more than one byte. Grey with alpha becomes RGBA.
fn sgi_shape(bytes: &[u8]) -> Option<Shape> {
    let (width, height, planes) = (big_u16(bytes, 6)?, big_u16(bytes, 8)?, big_u16(bytes, 10)?);
    let dimensions = big_u16(bytes, 4)?;
    let height = if dimensions == 1 { 1 } else { height };
    let planes = if dimensions < 3 { 1 } else { planes };
    let is_read = bytes.get(3) == Some(&1) && *bytes.get(2)? <= 1 && width > 0 && height > 0 && planes > 0;
    let channels = match planes {
        1 => 1,
        3 => 3,
        _ => 4,
    };
    is_read.then_some(Shape { width, height, channels })
}

/// Planes one after the other, rows from the bottom. Source: the SGI image file format, version 1.
fn sgi_samples(bytes: &[u8], shape: Shape) -> Option<Vec<u8>> {
    let Shape { width, height, channels } = shape;
    let stored = if big_u16(bytes, 4)? < 3 { 1 } else { big_u16(bytes, 10)? };
    let is_packed = *bytes.get(2)? == 1;
    // Alpha is opaque where the file has none.
    let mut out = vec![255_u8; width * height * channels];
    for plane in 0..stored.min(4) {
        // In grey with alpha, the second plane is alpha.
        let targets: &[usize] = match (stored, plane) {
            (2, 0) => &[0, 1, 2],
            (2, _) => &[3],
            (_, 0) => &[0],
            (_, 1) => &[1],
            (_, 2) => &[2],
            _ => &[3],
        };
        for row in 0..height {
            let samples = if is_packed {
                let entry = SGI_HEADER + 4 * (plane * height + row);
                let start = u32::from_be_bytes(bytes.get(entry..entry + 4)?.try_into().ok()?);
                unpacked_row(bytes.get(usize::try_from(start).ok()?..)?, width)?
            } else {
                let start = SGI_HEADER + (plane * height + row) * width;
                bytes.get(start..start + width)?.to_vec()
            };
            let first = (height - 1 - row) * width;
            for (i, sample) in samples.iter().enumerate() {
                for target in targets.iter().filter(|t| **t < channels) {
                    out[(first + i) * channels + target] = *sample;
                }
            }
        }
    }
    Some(out)
}

/// A row of runs: a count with its high bit set is followed by as many samples, one without by a sample to repeat; 0 ends it.
fn unpacked_row(packed: &[u8], width: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(width);
    let mut i = 0;
    while out.len() < width {
        let code = *packed.get(i)?;
        let count = usize::from(code & 0x7f);
        // The row ends here, before it is full.
        if count == 0 {
            return None;
        }
        if code & 0x80 != 0 {
            out.extend_from_slice(packed.get(i + 1..i + 1 + count)?);
            i += 1 + count;
        } else {
            out.extend(std::iter::repeat_n(*packed.get(i + 1)?, count));
            i += 2;
        }
    }
    // The last run may be longer than the row.
    out.truncate(width);
    Some(out)
}

/// Channels of a Targa pixel, or of an entry of its colour map, of so many bits.
fn targa_channels(bits: u8) -> Option<usize> {
    match bits {
        8 => Some(1),
        24 => Some(3),
        32 => Some(4),
        _ => None,
    }
}

fn targa_shape(bytes: &[u8]) -> Option<Shape> {
    let (width, height) = (little_u16(bytes, 12)?, little_u16(bytes, 14)?);
    let (kind, bits) = (*bytes.get(2)?, *bytes.get(16)?);
    let channels = match kind & 7 {
        1 if bits == 8 => targa_channels(*bytes.get(7)?)?,
        2 | 3 => targa_channels(bits)?,
        _ => return None,
    };
    (matches!(kind, 1..=3 | 9..=11) && width > 0 && height > 0).then_some(Shape { width, height, channels })
}

/// Pixels in rows, blue first. Source: the Truevision TGA specification 2.0.
fn targa_samples(bytes: &[u8], shape: Shape) -> Option<Vec<u8>> {
    let Shape { width, height, channels } = shape;
    let (kind, descriptor) = (*bytes.get(2)?, *bytes.get(17)?);
    // An identification text may lie between the header and the colour map.
    let map_start = TARGA_HEADER + usize::from(*bytes.first()?);
    let is_mapped = kind & 7 == 1;
    let (map_first, map_length) = (little_u16(bytes, 3)?, little_u16(bytes, 5)?);
    // Bytes of an entry of the colour map.
    let entry = if bytes.get(1) == Some(&1) { usize::from(*bytes.get(7)?).div_ceil(8) } else { 0 };
    let map = bytes.get(map_start..map_start + map_length * entry)?;
    let data = bytes.get(map_start + map.len()..)?;
    let stored = if is_mapped { 1 } else { channels };
    // Kinds from 9 on are the run-length encoded forms of kinds 1 to 3.
    let raw = if kind >= 9 {
        unpacked_pixels(data, width * height, stored)?
    } else {
        data.get(..width * height * stored)?.to_vec()
    };
    let mut out = vec![0_u8; width * height * channels];
    for (i, pixel) in raw.chunks_exact(stored).enumerate() {
        let source = if is_mapped {
            let at = usize::from(*pixel.first()?).checked_sub(map_first)? * entry;
            map.get(at..at + channels)?
        } else {
            pixel
        };
        // Rows run from the bottom and pixels from the left, unless the descriptor says otherwise.
        let (x, y) = (i % width, i / width);
        let x = if descriptor & 0x10 != 0 { width - 1 - x } else { x };
        let y = if descriptor & 0x20 != 0 { y } else { height - 1 - y };
        let target = &mut out[(y * width + x) * channels..][..channels];
        target.copy_from_slice(source);
        if let [blue, _, red, ..] = target {
            std::mem::swap(blue, red);
        }
    }
    Some(out)
}

/// Packets of a count and pixels: with the high bit one pixel to repeat, else as many pixels.
fn unpacked_pixels(data: &[u8], pixels: usize, size: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(pixels * size);
    let mut i = 0;
    while out.len() < pixels * size {
        let code = *data.get(i)?;
        let count = usize::from(code & 0x7f) + 1;
        i += 1;
        if code & 0x80 != 0 {
            let pixel = data.get(i..i + size)?;
            (0..count).for_each(|_| out.extend_from_slice(pixel));
            i += size;
        } else {
            out.extend_from_slice(data.get(i..i + count * size)?);
            i += count * size;
        }
    }
    // The last packet may be longer than the picture.
    out.truncate(pixels * size);
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two columns and two rows: red, green at the top; blue, white at the bottom.
    const RGB: [u8; 12] = [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255];

    fn sgi(packed: bool) -> Vec<u8> {
        let mut out = vec![0_u8; SGI_HEADER];
        out[..12].copy_from_slice(&[0x01, 0xda, u8::from(packed), 1, 0, 3, 0, 2, 0, 2, 0, 3]);
        // Planes red, green, blue; the bottom row first.
        let rows = [[0, 255], [255, 0], [0, 255], [0, 255], [255, 255], [0, 0]];
        if !packed {
            rows.iter().for_each(|r| out.extend_from_slice(r));
            return out;
        }
        let mut data = Vec::new();
        let base = SGI_HEADER + 2 * 4 * rows.len();
        for r in rows {
            out.extend(u32::try_from(base + data.len()).expect("small").to_be_bytes());
            if r[0] == r[1] { data.extend([2, r[0], 0]) } else { data.extend([0x82, r[0], r[1], 0]) }
        }
        out.extend(vec![0; 4 * rows.len()]);
        out.extend(data);
        out
    }

    #[test]
    fn pictures_of_silicon_graphics_are_read_plain_and_packed() {
        for packed in [false, true] {
            let bytes = sgi(packed);
            let shape = sgi_shape(&bytes).expect("a shape");
            assert_eq!(sgi_samples(&bytes, shape).as_deref(), Some(&RGB[..]), "packed: {packed}");
            // Every shorter file is damaged, not a panic.
            let whole = sgi_samples(&bytes[..bytes.len() - 2], shape);
            assert!(whole.is_none() || packed);
            (0..bytes.len()).for_each(|n| drop(sgi_samples(&bytes[..n], shape)));
        }
    }

    #[test]
    fn pictures_of_targa_are_read_plain_packed_and_mapped() {
        let header = |kind: u8, map: [u8; 5], bits: u8, descriptor: u8| {
            let mut out = vec![0, u8::from(kind & 7 == 1), kind];
            out.extend(map);
            out.extend([0, 0, 0, 0, 2, 0, 2, 0, bits, descriptor]);
            out
        };
        let read = |bytes: &[u8]| targa_shape(bytes).and_then(|s| targa_samples(bytes, s));
        let pixels = [[0, 0, 255], [0, 255, 0], [255, 0, 0], [255, 255, 255]];
        // From the top, and from the bottom.
        let top = [header(2, [0; 5], 24, 0x20), pixels.concat()].concat();
        let bottom = [header(2, [0; 5], 24, 0), [pixels[2], pixels[3], pixels[0], pixels[1]].concat()].concat();
        assert_eq!(read(&top).as_deref(), Some(&RGB[..]));
        assert_eq!(read(&bottom).as_deref(), Some(&RGB[..]));
        // One packet of three pixels, one that repeats the last.
        let packed = [header(10, [0; 5], 24, 0x20), vec![0x02], pixels[..3].concat(), vec![0x80], pixels[3].to_vec()];
        assert_eq!(read(&packed.concat()).as_deref(), Some(&RGB[..]));
        // A map of four colours.
        let mapped = [header(1, [0, 0, 4, 0, 24], 8, 0x20), pixels.concat(), vec![0, 1, 2, 3]].concat();
        assert_eq!(read(&mapped).as_deref(), Some(&RGB[..]));
        for bytes in [&top, &mapped] {
            (0..bytes.len()).for_each(|n| assert!(read(&bytes[..n]).is_none(), "{n} bytes"));
        }
    }
}
