//! Bytes of an OpenVDB file, version 223, little-endian: header, metadata, then per grid a descriptor, metadata, transform,
//! topology and buffers.
//! Source: the file format of OpenVDB, as its library and that of Houdini read it.

use half::f16;

use super::VdbOptions;
use super::tree::{Leaf, leaves};
use crate::GENERATOR;
use crate::usd::UpAxis;
use osier_base::convert::saturating_index;
use osier_base::par::par_map;
use osier_base::{Error, Result};
use osier_scene::{Scene, VolumeFrame, VolumeGrid, VolumeValues};

/// First eight bytes of a file, by which readers recognise OpenVDB.
const MAGIC: i64 = 0x5644_4220;
/// Version of the file format; 224 is the version with points, of which older readers warn.
const FILE_VERSION: u32 = 223;
/// Version of the library whose format this is.
const LIBRARY_VERSION: [u32; 2] = [12, 0];
/// Children of a node of level 5 and of one of level 4.
const CHILDREN_5: usize = 1 << 15;
const CHILDREN_4: usize = 1 << 12;
/// Most active voxels of a file; more are refused (X010).
pub(super) const MAX_VOXELS: u64 = 64_000_000;
/// Level of zlib, 1 to 9; larger ones take longer and save little on half-precision numbers.
const ZLIB_LEVEL: u8 = 6;

/// Flag of a grid: its values are compressed.
const ZIP: u32 = 1;
/// Flag of a grid: inactive values are omitted.
const ACTIVE_ONLY: u32 = 2;
/// Code before values: only active values follow, inactive ones equal the background.
const INACTIVE_IS_BACKGROUND: u8 = 0;
/// Code before values: all values follow.
const ALL_VALUES: u8 = 6;

/// A grid with its values at the frame of the file.
pub(super) struct FilledGrid<'a> {
    pub grid: &'a VolumeGrid,
    pub values: &'a VolumeFrame,
}

/// The file of `grids` at a frame: header and metadata, then the grids in the order of their names.
/// # Errors
/// X001 for a value that is not finite, X010 for too many voxels.
pub(super) fn vdb_bytes(
    scene: &Scene,
    file: &str,
    frame: u32,
    grids: &[FilledGrid<'_>],
    options: VdbOptions,
) -> Result<Vec<u8>> {
    let mut out = VdbBytes::default();
    out.put(&MAGIC.to_le_bytes());
    out.put_u32(FILE_VERSION);
    LIBRARY_VERSION.iter().for_each(|v| out.put_u32(*v));
    // Flag: the descriptors of the grids contain offsets.
    out.put(&[1]);
    out.put(uuid(&scene.hash, file, frame).as_bytes());
    let seed = scene.seed.to_string();
    out.put_metadata(&[("creator", Meta::String(GENERATOR)), ("osier_seed", Meta::String(&seed))]);
    // Readers list grids in the order of the file: by name, whatever the order in the scene.
    let mut sorted: Vec<&FilledGrid<'_>> = grids.iter().collect();
    sorted.sort_by_key(|g| g.grid.name);
    out.put_count(sorted.len());
    let mut voxels = 0;
    for filled in sorted {
        let encoder = GridEncoder::new(filled, frame, options)?;
        voxels += encoder.active_voxels();
        if voxels > MAX_VOXELS {
            return Err(too_many_voxels(file, frame, voxels));
        }
        encoder.append_to(&mut out, frame);
    }
    Ok(out.0)
}

/// X010 for a file with more than [`MAX_VOXELS`].
pub(super) fn too_many_voxels(file: &str, frame: u32, voxels: u64) -> Error {
    let message = format!(
        "vdb/{file}, frame {frame}: {voxels} active voxels, more than {MAX_VOXELS}; raise output.vdb.cell or leave out grids"
    );
    Error::export("X010", message)
}

/// An identifier in the form 8-4-4-4-12, which depends only on the hash of the scene, the name of the file and the frame.
fn uuid(hash: &str, file: &str, frame: u32) -> String {
    let hex = blake3::hash(format!("{hash} {file} {frame}").as_bytes()).to_hex();
    let part = |from: usize, to: usize| &hex.as_str()[from..to];
    [part(0, 8), part(8, 12), part(12, 16), part(16, 20), part(20, 32)].join("-")
}

/// A metadata value of one of the types that osier writes.
enum Meta<'a> {
    Bool(bool),
    Int32(i32),
    String(&'a str),
}

/// The bytes of a file so far; numbers are little-endian.
#[derive(Default)]
struct VdbBytes(Vec<u8>);

impl VdbBytes {
    fn put(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    fn put_u32(&mut self, value: u32) {
        self.put(&value.to_le_bytes());
    }

    /// A count, or a length in bytes: of grids, children, names and numbers, far below 2^31.
    fn put_count(&mut self, n: usize) {
        self.put_u32(saturating_index(n));
    }

    /// A text after its length.
    fn put_str(&mut self, text: &str) {
        self.put_count(text.len());
        self.put(text.as_bytes());
    }

    fn put_metadata(&mut self, entries: &[(&str, Meta<'_>)]) {
        self.put_count(entries.len());
        for (name, value) in entries {
            self.put_str(name);
            let (kind, bytes): (&str, Vec<u8>) = match value {
                Meta::Bool(v) => ("bool", vec![u8::from(*v)]),
                Meta::Int32(v) => ("int32", v.to_le_bytes().to_vec()),
                Meta::String(v) => ("string", v.as_bytes().to_vec()),
            };
            self.put_str(kind);
            self.put_count(bytes.len());
            self.put(&bytes);
        }
    }

    /// Overwrites the 8 bytes at `at` with the current length, the position of the next part.
    fn patch_position(&mut self, at: usize) {
        let position = (self.0.len() as u64).to_le_bytes();
        self.0[at..at + 8].copy_from_slice(&position);
    }
}

/// Writes the descriptor, topology and values of one grid.
struct GridEncoder<'a> {
    grid: &'a VolumeGrid,
    leaves: Vec<Leaf>,
    /// Numbers per voxel: 1, or 3 of a vector.
    components: usize,
    half: bool,
    zip: bool,
    up: UpAxis,
}

impl<'a> GridEncoder<'a> {
    fn new(filled: &FilledGrid<'a>, frame: u32, options: VdbOptions) -> Result<Self> {
        let grid = filled.grid;
        let mut leaves = leaves(filled.values);
        let components = if matches!(filled.values.values, VolumeValues::Vector(_)) { 3 } else { 1 };
        if let Some(bad) = leaves.iter().flat_map(|l| &l.values).find(|v| !v.is_finite()) {
            let message = format!("vdb/{}, grid {}, frame {frame}: {bad} is not finite", grid.file, grid.name);
            return Err(Error::export("X001", message));
        }
        // Rotate vectors to the axes of the stage.
        if components == 3 {
            for vector in leaves.iter_mut().flat_map(|l| l.values.chunks_exact_mut(3)) {
                vector.copy_from_slice(&options.up.stage_vec(glam::Vec3::from_slice(vector)).to_array());
            }
        }
        // Half precision ends at 65504, which a number density of very small cells may exceed.
        let largest = leaves.iter().flat_map(|l| &l.values).fold(0.0, |most: f32, v| most.max(v.abs()));
        let half = options.half && largest <= f16::MAX.to_f32();
        Ok(Self { grid, leaves, components, half, zip: options.zip, up: options.up })
    }

    fn active_voxels(&self) -> u64 {
        self.leaves.iter().map(|l| (l.values.len() / self.components) as u64).sum()
    }

    /// Zipped halves are written without [`ACTIVE_ONLY`]: readers disagree about the length of blocks without values.
    fn flags(&self) -> u32 {
        match (self.zip, self.half) {
            (true, true) => ZIP,
            (true, false) => ZIP | ACTIVE_ONLY,
            (false, _) => ACTIVE_ONLY,
        }
    }

    fn append_to(&self, out: &mut VdbBytes, frame: u32) {
        // Descriptor: three positions are patched when they are known.
        out.put_str(self.grid.name);
        // The name of the tree holds its branching, 2^5, 2^4 and 2^3 along an axis, by which readers choose their types.
        let tree = if self.components == 3 { "Tree_vec3s_5_4_3" } else { "Tree_float_5_4_3" };
        out.put_str(&format!("{tree}{}", if self.half { "_HalfFloat" } else { "" }));
        out.put_str("");
        let positions = out.0.len();
        out.put(&[0; 24]);
        out.patch_position(positions);

        // The grid up to its topology.
        out.put_u32(self.flags());
        self.put_grid_metadata(out, frame);
        self.put_transform(out);
        self.put_topology(out);

        // Buffers: each leaf's mask once more, then its values.
        out.patch_position(positions + 8);
        let buffers = par_map(&self.leaves, |leaf| self.leaf_values(leaf));
        for (leaf, values) in self.leaves.iter().zip(buffers) {
            out.put(&leaf.mask);
            out.put(&values);
        }
        out.patch_position(positions + 16);
    }

    fn put_grid_metadata(&self, out: &mut VdbBytes, frame: u32) {
        // Blender and Houdini shade fog volumes, and offer other classes to nodes only.
        let class = if self.components == 3 { "unknown" } else { "fog volume" };
        let mut entries = vec![
            ("class", Meta::String(class)),
            ("frame", Meta::Int32(frame.cast_signed())),
            ("is_saved_as_half_float", Meta::Bool(self.half)),
            ("name", Meta::String(self.grid.name)),
            ("unit", Meta::String(self.grid.unit)),
        ];
        if self.components == 3 {
            entries.push(("vector_type", Meta::String("contravariant relative")));
        }
        out.put_metadata(&entries);
    }

    /// World from cells: with the scene's axes scale and translation, else a matrix for row vectors.
    fn put_transform(&self, out: &mut VdbBytes) {
        let (h, [x, y, z]) = (self.grid.cell, self.grid.origin.to_array());
        let numbers: Vec<f64> = match self.up {
            UpAxis::Y => {
                out.put_str("UniformScaleTranslateMap");
                let derived = [h, h.abs(), 1.0 / h, 1.0 / (h * h), 1.0 / (2.0 * h)];
                [x, y, z].into_iter().chain(derived.into_iter().flat_map(|v| [v; 3])).collect()
            }
            UpAxis::Z => {
                // (x, y, z) becomes (x, -z, y).
                out.put_str("AffineMap");
                vec![h, 0.0, 0.0, 0.0, 0.0, 0.0, h, 0.0, 0.0, -h, 0.0, 0.0, x, -z, y, 1.0]
            }
        };
        // Adding 0 turns -0 into 0: equal values have equal bytes.
        numbers.iter().for_each(|v| out.put(&(v + 0.0).to_le_bytes()));
    }

    fn put_topology(&self, out: &mut VdbBytes) {
        out.put_u32(1);
        // The background, 0; in half files it is still a 32-bit number.
        (0..self.components).for_each(|_| out.put(&0.0_f32.to_le_bytes()));
        let roots: Vec<&[Leaf]> = self.leaves.chunk_by(|a, b| a.key.root == b.key.root).collect();
        out.put_u32(0);
        out.put_count(roots.len());
        // Inner nodes hold no values, but their empty blocks are written; all nodes of a level have equal blocks.
        let (values_5, values_4) = (self.inner_values(CHILDREN_5), self.inner_values(CHILDREN_4));
        for root in roots {
            root[0].key.root.iter().for_each(|c| out.put(&c.to_le_bytes()));
            put_child_mask(out, CHILDREN_5, root.iter().map(|l| l.key.child5));
            out.put(&values_5);
            for node in root.chunk_by(|a, b| a.key.child5 == b.key.child5) {
                put_child_mask(out, CHILDREN_4, node.iter().map(|l| l.key.child4));
                out.put(&values_4);
                node.iter().for_each(|leaf| out.put(&leaf.mask));
            }
        }
    }

    /// Values of an inner node, which has no tiles: an empty list, or zeros.
    fn inner_values(&self, slots: usize) -> Vec<u8> {
        let count = if self.flags() & ACTIVE_ONLY == 0 { slots * self.components } else { 0 };
        self.value_block(&vec![0.0; count])
    }

    fn leaf_values(&self, leaf: &Leaf) -> Vec<u8> {
        if self.flags() & ACTIVE_ONLY == 0 {
            self.value_block(&leaf.all_values(self.components))
        } else {
            self.value_block(&leaf.values)
        }
    }

    /// A code, then the numbers. With zlib: the length of the compressed stream and the stream, or, if the plain bytes
    /// are shorter, their negated length and the plain bytes.
    fn value_block(&self, values: &[f32]) -> Vec<u8> {
        let plain: Vec<u8> = if self.half {
            values.iter().flat_map(|v| f16::from_f32(v + 0.0).to_le_bytes()).collect()
        } else {
            values.iter().flat_map(|v| (v + 0.0).to_le_bytes()).collect()
        };
        let mut out = vec![if self.flags() & ACTIVE_ONLY == 0 { ALL_VALUES } else { INACTIVE_IS_BACKGROUND }];
        if !self.zip {
            out.extend(plain);
            return out;
        }
        let zipped =
            if plain.is_empty() { Vec::new() } else { miniz_oxide::deflate::compress_to_vec_zlib(&plain, ZLIB_LEVEL) };
        let (length, bytes) = if zipped.len() < plain.len() {
            ((zipped.len() as u64).cast_signed(), zipped)
        } else {
            (-(plain.len() as u64).cast_signed(), plain)
        };
        out.extend(length.to_le_bytes());
        out.extend(bytes);
        out
    }
}

/// Masks of a node: the bits of its children, then those of its values, all 0.
fn put_child_mask(out: &mut VdbBytes, slots: usize, children: impl Iterator<Item = u32>) {
    let mut mask = vec![0_u8; slots / 8];
    children.for_each(|n| mask[n as usize / 8] |= 1 << (n % 8));
    out.put(&mask);
    out.put(&vec![0; slots / 8]);
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use osier_scene::{Camera, Clip, Sky, Sun};

    use super::*;

    fn scene(grid: VolumeGrid) -> Scene {
        Scene {
            name: "two".into(),
            title: String::new(),
            seed: 7,
            hash: "00".repeat(32),
            clip: Clip { start: 1, end: 2, fps: (24, 1) },
            camera: Camera { eye: glam::Vec3::Z, target: glam::Vec3::ZERO, vfov: 0.6, roll: 0.0 },
            sun: Sun::default(),
            sky: Sky::default(),
            images: Vec::new(),
            materials: Vec::new(),
            assets: Vec::new(),
            placements: Vec::new(),
            land: None,
            tables: Vec::new(),
            enum_labels: Vec::new(),
            fields: Vec::new(),
            air: Vec::new(),
            volumes: vec![grid],
            map_sequences: Vec::new(),
        }
    }

    fn density(cell: f64) -> VolumeGrid {
        VolumeGrid {
            file: "flock",
            name: "density",
            unit: "1/m^3",
            is_vector: false,
            origin: DVec3::new(0.25, -0.5, 1.0),
            cell,
            every: 1,
            max_cells: 2,
        }
    }

    fn file(values: &VolumeFrame, options: VdbOptions) -> Vec<u8> {
        let scene = scene(density(0.5));
        let filled = FilledGrid { grid: &scene.volumes[0], values };
        vdb_bytes(&scene, "flock", 1, &[filled], options).expect("bytes")
    }

    /// Two voxels of one leaf, (0, 0, 1) and (1, 0, 0), with the values 2 and 3.
    fn two_voxels() -> VolumeFrame {
        VolumeFrame::scalars([([1, 0, 0], 3.0), ([0, 0, 1], 2.0)])
    }

    #[test]
    fn two_voxels_have_the_bytes_of_the_format() {
        let mut expected: Vec<u8> = Vec::new();
        let word = |v: u32| v.to_le_bytes();
        let length = |n: usize| word(u32::try_from(n).expect("short"));
        let text = |s: &str| [&length(s.len()), s.as_bytes()].concat();
        let entry =
            |name: &str, kind: &str, value: &[u8]| [&text(name)[..], &text(kind), &length(value.len()), value].concat();
        // Header and metadata of the file.
        expected.extend([0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0, 223, 0, 0, 0, 12, 0, 0, 0, 0, 0, 0, 0, 1]);
        expected.extend(uuid(&"00".repeat(32), "flock", 1).bytes());
        expected.extend(word(2));
        expected.extend(entry("creator", "string", GENERATOR.as_bytes()));
        expected.extend(entry("osier_seed", "string", b"7"));
        // One grid: its descriptor, with the positions of what follows.
        expected.extend(word(1));
        expected.extend(text("density"));
        expected.extend(text("Tree_float_5_4_3"));
        expected.extend(word(0));
        let start = expected.len() + 24;
        let mut grid: Vec<u8> = word(2).to_vec();
        grid.extend(word(5));
        grid.extend(entry("class", "string", b"fog volume"));
        grid.extend(entry("frame", "int32", &[1, 0, 0, 0]));
        grid.extend(entry("is_saved_as_half_float", "bool", &[0]));
        grid.extend(entry("name", "string", b"density"));
        grid.extend(entry("unit", "string", b"1/m^3"));
        grid.extend(text("UniformScaleTranslateMap"));
        for v in [0.25, -0.5, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0, 1.0, 1.0, 1.0_f64] {
            grid.extend(v.to_le_bytes());
        }
        // Topology: background 0, no tiles, one root; child 0 of both inner nodes; the leaf's mask with bits 1 and 64.
        grid.extend([word(1), word(0), word(0), word(1), word(0), word(0), word(0)].concat());
        for slots in [32_768, 4096] {
            grid.push(1);
            grid.extend(vec![0; slots / 4 - 1]);
            grid.push(0);
        }
        let mut mask = [0_u8; 64];
        (mask[0], mask[8]) = (2, 1);
        grid.extend(mask);
        // Buffers: the mask, the code of values that are the background where inactive, the values in the order of bits.
        let buffers = grid.len();
        grid.extend(mask);
        grid.push(0);
        grid.extend([2.0_f32, 3.0].map(f32::to_le_bytes).concat());
        for position in [start, start + buffers, start + grid.len()] {
            expected.extend((position as u64).to_le_bytes());
        }
        expected.extend(grid);
        let options = VdbOptions { half: false, zip: false, up: UpAxis::Y };
        assert!(file(&two_voxels(), options) == expected);
    }

    #[test]
    fn halves_give_way_to_floats_beyond_their_range() {
        let name = |value: f32| {
            let bytes = file(&VolumeFrame::scalars([([0; 3], value)]), VdbOptions::default());
            bytes.windows(10).any(|w| w == b"_HalfFloat")
        };
        assert!(name(65_504.0) && !name(65_600.0));
    }

    #[test]
    fn a_value_that_is_not_finite_ends_the_bake() {
        let scene = scene(density(0.5));
        let values = VolumeFrame::scalars([([0; 3], f32::NAN)]);
        let filled = FilledGrid { grid: &scene.volumes[0], values: &values };
        let result = vdb_bytes(&scene, "flock", 1, &[filled], VdbOptions::default());
        assert!(result.is_err_and(|e| e.to_string().contains("finite")));
    }

    #[test]
    fn stages_with_z_up_have_turned_grids() {
        let mut out = VdbBytes::default();
        let grid = density(0.5);
        let values = VolumeFrame {
            cells: osier_scene::VolumeCells::List(vec![[0; 3]]),
            values: VolumeValues::Vector(vec![glam::Vec3::new(1.0, 2.0, 3.0)]),
        };
        let options = VdbOptions { half: false, zip: false, up: UpAxis::Z };
        let encoder = GridEncoder::new(&FilledGrid { grid: &grid, values: &values }, 1, options).expect("finite");
        assert_eq!(encoder.leaves[0].values, [1.0, -3.0, 2.0]);
        encoder.put_transform(&mut out);
        let number = |k: usize| f64::from_le_bytes(out.0[13 + 8 * k..21 + 8 * k].try_into().expect("eight bytes"));
        let rows: Vec<f64> = (0..16).map(number).collect();
        assert_eq!(rows, [0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, -0.5, 0.0, 0.0, 0.25, -1.0, -0.5, 1.0]);
    }
}
