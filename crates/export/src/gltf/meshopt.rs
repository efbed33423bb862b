//! EXT_meshopt_compression: vertices, triangles and keys of a finished document as compressed streams.
//!
//! The document is built as it would be without compression. Then each buffer view whose bytes are a stream is encoded:
//! its compressed bytes go to buffer 0, and the view itself refers to buffer 1, which has a length but no bytes.

use meshoptimizer_rs::codec::{
    ExpMode, IndexEncoding, VertexEncoding, encode_filter_exp, encode_filter_quat, encode_index_buffer,
    encode_vertex_buffer,
};
use meshoptimizer_rs::{Limits, Workspace, optimize_vertex_cache, optimize_vertex_fetch_remap};

use super::buffer::BinaryBuffer;
use super::json::{Buffer, BufferExtensions, BufferView, CompressedView, FallbackBuffer, ViewExtensions};
use super::stream::Stream;
use osier_base::{Error, Result};

/// Largest rounding error of translations of keys and instances, m. Own: a fifth of a millimetre is not seen, and plants of a few
/// metres need no more than [`MIN_VECTOR_BITS`] for it. Smaller values make files larger.
const VECTOR_TOLERANCE: f32 = 2e-4;
/// Least number of bits of a component of a vector: a relative error of 3e-5, for scales.
const MIN_VECTOR_BITS: u32 = 15;
/// Largest number of bits of a component of a vector: those of a float.
const MAX_VECTOR_BITS: u32 = 24;
impl Stream {
    /// Encodes `count` elements with the codec and filter of this kind of stream.
    fn encode(self, bytes: &[u8], count: usize, workspace: &mut Workspace) -> Result<Vec<u8>> {
        let encoded = match self {
            Self::Attributes { stride } => encode_vertices(bytes, count, stride, workspace),
            Self::Triangles { stride } => {
                encode_index_buffer(&indices(bytes, stride), IndexEncoding::DEFAULT, workspace)
            }
            Self::Rotations { bits } => {
                let shorts = bytes.as_chunks::<2>().0.iter().map(|b| i16::from_le_bytes(*b));
                let floats: Vec<f32> = shorts.map(|c| f32::from(c) / 32_767.0).collect();
                encode_filter_quat(count, 8, bits, &floats, workspace)
                    // The filter rounds the quaternions to its bits and leaves bytes that the vertex codec packs well; readers
                    // undo both.
                    .and_then(|filtered| encode_vertices(&filtered, count, 8, workspace))
            }
            Self::Vectors => {
                let floats: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
                encode_filter_exp(count, 12, vector_bits(&floats), &floats, ExpMode::SharedVector, workspace)
                    .and_then(|filtered| encode_vertices(&filtered, count, 12, workspace))
            }
        };
        encoded.map_err(|e| refused(&e))
    }
}

/// Lossless encoding of elements in version 0 of the vertex codec, the only one that EXT_meshopt_compression decodes.
fn encode_vertices(
    bytes: &[u8],
    count: usize,
    stride: usize,
    workspace: &mut Workspace,
) -> std::result::Result<Vec<u8>, meshoptimizer_rs::Error> {
    // Version 0 has one level of effort.
    let encoding = VertexEncoding::new(0, 0)?;
    encode_vertex_buffer(bytes, count, stride, encoding, workspace)
}

/// Decodes little-endian indices of two or four bytes each.
fn indices(bytes: &[u8], stride: usize) -> Vec<u32> {
    match stride {
        2 => bytes.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b).into()).collect(),
        _ => bytes.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect(),
    }
}

/// Bits of a component that keep the largest of some numbers, m, within [`VECTOR_TOLERANCE`].
fn vector_bits(values: &[f32]) -> u32 {
    let largest = values.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    // With b bits, one of them the sign, a number below 2^e is rounded by at most 2^(e - b).
    let step = |bits: u32| largest * 2.0 / osier_base::math::narrow(f64::from(1_u32 << bits));
    (MIN_VECTOR_BITS..MAX_VECTOR_BITS).find(|b| step(*b) <= VECTOR_TOLERANCE).unwrap_or(MAX_VECTOR_BITS)
}

fn refused(e: &meshoptimizer_rs::Error) -> Error {
    Error::export("X005", format!("glTF with meshopt = true: {e}; write it with output.gltf.meshopt = false"))
}

/// Scratch memory without limits: osier limits the size of meshes before they are compressed.
fn workspace() -> Workspace {
    Workspace::new(Limits { max_bytes: usize::MAX, max_work: u64::MAX })
}

/// Compresses the views of a finished document: its buffer then holds compressed streams and images. The returned buffer, to
/// which the views refer, has a length but no bytes; `None` if no view was compressed.
pub(super) fn compress(buffer: &mut BinaryBuffer, views: &mut [BufferView]) -> Result<Option<Buffer>> {
    let mut workspace = workspace();
    let mut out = Vec::new();
    let mut decoded_length = 0_usize;
    for view in views {
        let bytes = &buffer.bytes[view.byte_offset..view.byte_offset + view.byte_length];
        // Compressed streams begin at multiples of four bytes too, as the extension asks.
        out.resize(out.len().next_multiple_of(4), 0);
        // Images and empty views are copied as they are.
        let stream = view.stream.filter(|_| view.byte_length > 0);
        let Some(stream) = stream else {
            view.byte_offset = out.len();
            out.extend_from_slice(bytes);
            continue;
        };
        let stride = stream.stride();
        let count = bytes.len() / stride;
        let encoded = stream.encode(bytes, count, &mut workspace)?;
        let meshopt = CompressedView {
            buffer: 0,
            byte_offset: out.len(),
            byte_length: encoded.len(),
            byte_stride: stride,
            count,
            mode: stream.mode(),
            filter: stream.filter(),
        };
        view.extensions = Some(ViewExtensions { meshopt });
        view.buffer = 1;
        // Views are laid out in the fallback buffer as their decoded bytes would be.
        view.byte_offset = decoded_length;
        decoded_length = (decoded_length + view.byte_length).next_multiple_of(4);
        out.extend_from_slice(&encoded);
    }
    buffer.bytes = out;
    let fallback = BufferExtensions { meshopt: FallbackBuffer { fallback: true } };
    Ok((decoded_length > 0).then_some(Buffer { uri: None, byte_length: decoded_length, extensions: Some(fallback) }))
}

/// Reorders triangles so that vertices are reused soon, and vertices by first use: streams in these orders are shorter,
/// and drawing them is faster. The second list contains the old index of each new vertex.
pub(super) fn reorder(triangles: &[[u32; 3]], vertices: usize) -> Result<(Vec<[u32; 3]>, Vec<u32>)> {
    let mut workspace = workspace();
    let cached = optimize_vertex_cache(triangles.as_flattened(), vertices, &mut workspace).map_err(|e| refused(&e))?;
    let fetch = optimize_vertex_fetch_remap(&cached, vertices, &mut workspace).map_err(|e| refused(&e))?;
    let mut old = vec![0_u32; fetch.vertex_count];
    for (from, to) in (0_u32..).zip(&fetch.remap) {
        // A vertex that no triangle uses has no new index.
        if let Some(slot) = old.get_mut(*to as usize) {
            *slot = from;
        }
    }
    let new = |i: u32| fetch.remap.get(i as usize).copied().unwrap_or(0);
    Ok((cached.as_chunks::<3>().0.iter().map(|t| t.map(new)).collect(), old))
}

#[cfg(test)]
mod tests {
    use meshoptimizer_rs::codec::{decode_filter_exp, decode_vertex_buffer};

    use super::*;

    const SIX_VERTICES: &str = "a0013ff000005d5d5d5d5d020688880000000000013ff000003ebac94d2e010230000004020555550000000000000000\
        00000000000000000000000000000000000000000000000000000000409c0000";
    const TWELVE_TRIANGLES: &str = "e1f01000100010001000100010007687566778a9866589689801690000";
    const SIX_ROTATIONS_OF_12_BITS: &str = "a0011ff00000af5bd836013ff000000e03170608010ff00000b1d62245010ff000000a050906010ff00000b1a09e8b01\
        0f3000000a0d04011ca000000300000000000000000000000000000000000000000000000000000000000000ff07";
    const SIX_ROTATIONS_OF_16_BITS: &str = "a0011ff00000f9076b8f013ff00000fe497a6e64010fb00000fbb94b010ff00000b4719d5c010ff00000fb2917c1010f\
        f00000b4d51538011ca000000300000000000000000000000000000000000000000000000000000000000000ff7f";
    const SIX_VECTORS: &str = "a000013ff00000141414141401002000000000013ff00000141414141401080000000000013ff000001414b514140101\
        00000000000000000000000000000000000000000000000000cefff400f3fff4001800f4";

    #[test]
    fn streams_begin_with_the_versions_of_the_extension() {
        let mut workspace = Workspace::default();
        let vertices = Stream::Attributes { stride: 4 }.encode(&[7; 64], 16, &mut workspace).expect("vertices");
        let indices: Vec<u8> = [0_u16, 1, 2, 2, 1, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
        let triangles = Stream::Triangles { stride: 2 }.encode(&indices, 6, &mut workspace).expect("triangles");
        // Vertices of version 0, indices of version 1.
        assert_eq!((vertices[0], triangles[0]), (0xa0, 0xe1));
    }

    #[test]
    fn vectors_come_back_within_the_tolerance() {
        for size in [0.1_f32, 4.0, 60.0, 900.0] {
            let values: Vec<f32> = (0..300_u16).map(|i| size * osier_base::math::sin_f32(f32::from(i) * 0.7)).collect();
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            let mut workspace = Workspace::default();
            let encoded = Stream::Vectors.encode(&bytes, 100, &mut workspace).expect("encodes");
            let mut decoded = decode_vertex_buffer(100, 12, &encoded, &mut workspace).expect("decodes");
            decode_filter_exp(&mut decoded, 100, 12, &mut workspace).expect("filter");
            let back = decoded.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b));
            let worst = values.iter().zip(back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst <= VECTOR_TOLERANCE, "{size} m: {worst}");
        }
    }

    #[test]
    fn reordered_triangles_are_the_same_triangles() {
        let triangles: Vec<[u32; 3]> = (0..40_u32).map(|i| [i * 7 % 41, i * 11 % 43, i * 13 % 47]).collect();
        let (ordered, old) = reorder(&triangles, 50).expect("order");
        let turned = |t: [u32; 3]| {
            let first = (0..3).min_by_key(|k| t[*k]).unwrap_or(0);
            [t[first], t[(first + 1) % 3], t[(first + 2) % 3]]
        };
        let mut back: Vec<[u32; 3]> = ordered.iter().map(|t| turned(t.map(|i| old[i as usize]))).collect();
        let mut want: Vec<[u32; 3]> = triangles.into_iter().map(turned).collect();
        back.sort_unstable();
        want.sort_unstable();
        assert_eq!(back, want);
    }

    /// Quantised positions of `count` vertices: four integers of two bytes.
    fn sample_vertices(count: u32) -> Vec<u8> {
        let vertex = |i: u32| [i * 977 % 65_536, i * i * 31 % 65_536, 40_000 - i % 7 * 3, 0];
        (0..count).flat_map(vertex).flat_map(|c| u16::try_from(c).expect("two bytes").to_le_bytes()).collect()
    }

    /// Two triangles on every other vertex of a strip, as indices of two bytes.
    fn sample_triangles(count: u16) -> Vec<u8> {
        let pair = |i: u16| [2 * i, 2 * i + 1, 2 * i + 2, 2 * i + 2, 2 * i + 1, 2 * i + 3];
        (0..count).flat_map(pair).flat_map(u16::to_le_bytes).collect()
    }

    /// Rotations whose largest component, and its sign, change from one to the next.
    fn sample_rotations(count: usize) -> Vec<u8> {
        const TURNS: [[i16; 4]; 5] = [
            [0, 0, 0, 32_767],
            [23_170, 0, 0, 23_170],
            [16_384, 16_384, 16_384, 16_384],
            [-18_918, 6_000, -3_000, 26_000],
            [5_000, -30_000, 9_000, 8_300],
        ];
        let turn = |i: usize| (0..4).map(move |c| TURNS[i % 5][(c + i) % 4]);
        (0..count).flat_map(turn).flat_map(i16::to_le_bytes).collect()
    }

    /// Vectors of up to 3 m, m.
    fn sample_vectors(count: u32) -> Vec<u8> {
        let component = |i: u32| (f32::from(u16::try_from(i * 37 % 101).expect("small")) - 50.0) / 16.0;
        (0..3 * count).map(component).flat_map(f32::to_le_bytes).collect()
    }

    /// FNV-1a of 64 bits.
    fn fnv(bytes: &[u8]) -> u64 {
        bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x100_0000_01b3))
    }

    /// The bytes are those of the encoder that readers' decoders are tested with: `MeshoptEncoder` of the npm package meshoptimizer
    /// 1.3.0, in C++, with `encodeVertexBufferLevel(.., 0, 0)`, `encodeIndexBuffer`, `encodeFilterQuat` and `encodeFilterExp`
    /// ("SharedVector").
    #[test]
    fn streams_are_those_of_the_reference_encoder() {
        let vertices = Stream::Attributes { stride: 8 };
        let triangles = Stream::Triangles { stride: 2 };
        let mut workspace = workspace();
        let mut encode = |stream: Stream, bytes: &[u8]| {
            let count = bytes.len() / stream.stride();
            stream.encode(bytes, count, &mut workspace).expect("encodes")
        };
        let short = [
            (vertices, sample_vertices(6), SIX_VERTICES),
            (triangles, sample_triangles(6), TWELVE_TRIANGLES),
            (Stream::INSTANCE_ROTATIONS, sample_rotations(6), SIX_ROTATIONS_OF_12_BITS),
            (Stream::KEY_ROTATIONS, sample_rotations(6), SIX_ROTATIONS_OF_16_BITS),
            (Stream::Vectors, sample_vectors(6), SIX_VECTORS),
        ];
        for (stream, bytes, wanted) in short {
            let text: String = encode(stream, &bytes).iter().map(|b| format!("{b:02x}")).collect();
            assert_eq!(text, wanted, "{stream:?}");
        }
        // Streams of several blocks: length and hash.
        let long = [
            (vertices, sample_vertices(3000), (12_786, 0x5a42_5d20_105a_73ee)),
            (triangles, sample_triangles(3000), (6_017, 0x2df7_f84d_65f0_7267)),
            (Stream::INSTANCE_ROTATIONS, sample_rotations(3000), (15_957, 0x1559_97e0_67c4_10cb)),
            (Stream::KEY_ROTATIONS, sample_rotations(3000), (19_403, 0xaf64_b9f2_798a_ee23)),
            (Stream::Vectors, sample_vectors(3000), (11_865, 0xe974_4661_8d9c_646a)),
        ];
        for (stream, bytes, wanted) in long {
            let encoded = encode(stream, &bytes);
            assert_eq!((encoded.len(), fnv(&encoded)), wanted, "{stream:?}");
        }
    }
}
