//! `[output]` and the tables of its formats.

use super::UpAxis;
use crate::recipe::syntax::{
    BooleanType, Choice, Digest, ListOf, NumberArray, OneOf, OptionalKey, SequenceOf, degrees, integer, millimetres,
    number,
};
use crate::recipe::syntax::{choices, keys};
use osier_export::format::FormatInfo;
use osier_export::registry::FORMATS;
use osier_export::{gltf, usd};

choices! {
    /// Representation of the copies of a plant in USD.
    CopyStyle {
        /// One point instancer for each plant: few objects, any number of copies.
        Instancer = "instancer",
        /// A prim for each copy: in Blender an object each.
        References = "references",
    }
    /// Quantity of a voxel grid in OpenVDB files.
    VdbGrid {
        /// Catkins in flight per cubic metre.
        Density = "density",
        /// Velocity of the wind, m/s; the only grid of vectors.
        Velocity = "vel",
        /// Catkins at rest per square metre.
        Deposition = "deposition",
    }
    /// Simulated elements written as points with attributes.
    PointTable {
        /// Raindrops, falling and on leaves.
        Drops = "drops",
        /// Catkins, hanging, in flight and at rest.
        Catkins = "catkins",
        /// Joints of all moving plants.
        Joints = "joints",
    }
    /// Target program of a glb file, which decides its features.
    GltfProfile {
        /// Every version of Blender: merged leaves, all keyframes.
        Blender = "blender",
        /// Browsers and viewers: instanced leaves, reduced keyframes.
        Web = "web",
        /// Game engines: no required extension, levels of detail, a table of placements.
        Engine = "engine",
    }
    /// A value that wind shaders read from vertex colours, or a preset of four values.
    WindWord {
        /// Sway with the whole plant, 0 at the root.
        Sway = "sway",
        /// 1 minus sway.
        NotSway = "-sway",
        /// Sway with the branches, 0 on the trunk.
        Branch = "branch",
        /// 1 minus branch.
        NotBranch = "-branch",
        /// Flutter, 1 at the tip of a leaf.
        Flutter = "flutter",
        /// 1 minus flutter.
        NotFlutter = "-flutter",
        /// Phase of the main branch.
        Phase = "phase",
        /// 1 minus phase.
        NotPhase = "-phase",
        /// Share of the light of the sky.
        Light = "light",
        /// 1 minus light.
        NotLight = "-light",
        /// A random number of the branch or leaf.
        Id = "id",
        /// 1 minus id.
        NotId = "-id",
        /// The number 0 everywhere.
        Zero = "zero",
        /// The number 1 everywhere.
        One = "one",
        /// Preset of the shader of Crysis: flutter, phase, branch, light.
        Crysis = "crysis",
        /// Preset of O3DE: as crysis.
        O3de = "o3de",
        /// Preset of Unity: phase, flutter, zero, light; sway and branch in TEXCOORD_1.
        Unity = "unity",
        /// Preset of Godot: -sway, sway, zero, one.
        Godot = "godot",
        /// Preset of Unreal: flutter, phase, branch, zero.
        Unreal = "unreal",
    }
}

keys! {
    /// Files that a bake writes.
    OutputKeys at "output" {
        /// File formats that a bake writes.
        formats: Vec<OutputFormat> = "formats" ListOf(&[OutputFormat(&usd::FORMAT), OutputFormat(&gltf::FORMAT)]), basic;
        /// Textures of a bake are halved while they keep so many texels per pixel of a picture of 1080 rows, 256 texels a side and texels of 2 mm; 0: never.
        texels_per_pixel: f64 = "texels_per_pixel" number(4.0, 0.0, 1024.0, "");
    }
    /// Options of POV-Ray files.
    PovKeys at "output.pov" {
        /// Frames between two written frames.
        step: u32 = "step" integer(1, 1, 1_000_000);
        /// Width and height of the picture in pixels.
        size: [f64; 2] = "size" NumberArray([800.0, 600.0], number(800.0, 8.0, 16384.0, "pixels")), basic;
        /// Fraction of the frame interval for which the shutter is open, which sets the length of streaks of falling water.
        shutter: f64 = "shutter" number(0.5, 0.0, 1.0, "");
        /// Scene units per metre.
        units: f64 = "units_per_m" number(100.0, 1.0, 1e5, "");
    }
    /// Photon mapping of drops (caustics); the table alone enables it. A frame takes 1.5 to 2 times as long.
    PhotonKeys at "output.pov.photons" {
        /// Radius of the smallest drops that receive photons.
        smallest: f64 = "smallest_mm" millimetres(1.0, 0.2, 10.0);
    }
    /// Options of USD files.
    UsdKeys at "output.usd" {
        /// Axis that points up in the files.
        up: UpAxis = "up" OneOf(UpAxis::Y);
        /// How copies of a plant are written: one point instancer, or a prim for each copy, which can be edited.
        copies: CopyStyle = "copies" OneOf(CopyStyle::Instancer);
        /// Largest position error of leaves on branches between kept samples; 0 keeps every frame.
        tolerance: f64 = "tolerance_mm" millimetres(1.0, 0.0, 100.0);
        /// Largest rotation error of leaves on branches between kept samples.
        turn_tolerance: f64 = "turn_tolerance_deg" degrees(0.5, 0.0, 45.0);
        /// Beyond these errors, samples are also left out where 99 of 100 leaves stay within this distance, and all within four times of it, in a picture of 1080 rows; 0: no.
        picture_tolerance: f64 = "picture_tolerance_px" number(1.25, 0.0, 100.0, "pixels");
    }
    /// Options of OpenVDB files; clips only.
    VdbKeys at "output.vdb" {
        /// Grids that are written, where the scene has them.
        grids: Vec<VdbGrid> = "grids" ListOf(&[VdbGrid::Density, VdbGrid::Velocity, VdbGrid::Deposition]);
        /// Edge length of a cell.
        cell: Option<f64> = "cell" OptionalKey(number(0.5, 0.01, 100.0, "m"), "dx of a lattice, else 0.5 m");
        /// Whether values have half precision.
        half: bool = "half" BooleanType(true);
        /// Whether values are compressed.
        zip: bool = "zip" BooleanType(true);
        /// Frames between two files.
        every: u32 = "every" integer(1, 1, 1_000_000);
    }
    /// Options of points as CSV.
    PointsKeys at "output.points" {
        /// Tables that are written, where the scene has them.
        tables: Vec<PointTable> = "tables" ListOf(&[PointTable::Drops, PointTable::Catkins, PointTable::Joints]);
        /// Axis that points up in the files.
        up: UpAxis = "up" OneOf(UpAxis::Z);
    }
    /// Options of files for Unreal Engine.
    UnrealKeys at "output.unreal" {
        /// Largest number of joints of a plant; further branches are rigid with the branch that carries them.
        joints: u32 = "joints" integer(1800, 1, 32_767);
    }
    /// Options of glTF files.
    GltfKeys at "output.gltf" {
        /// Readers that the files are made for.
        profiles: Vec<GltfProfile> = "profiles" ListOf(&[GltfProfile::Web]);
        /// Writes only this frame, static: any number of flying objects, as instances in profile "web".
        frame: Option<u32> = "frame" OptionalKey(integer(1, 0, 999_999), "the whole clip, animated");
        /// Largest number of animated nodes of flying objects.
        nodes: u32 = "nodes" integer(500, 1, 100_000);
        /// Largest number of plants with an animated skin; others, farthest from the camera, are static and share meshes.
        skins: u32 = "skins" integer(64, 0, 100_000);
        /// Whether each asset is also written to a file of its own.
        assets: bool = "assets" BooleanType(false);
        /// Profile "web": whether vertices are stored as integers of 8 and 16 bits, half as large, accurate to 1/131070 of a mesh.
        quantize: bool = "quantize" BooleanType(true);
        /// Profile "web": whether the files are compressed with EXT_meshopt_compression, which three.js and Babylon.js read and Blender does not.
        meshopt: bool = "meshopt" BooleanType(false);
        /// Profile "blender": about the most MB of the leaves of a plant; with more, leaves have fewer triangles, of one that grows fewer shapes.
        leaves_mb: u32 = "leaves_mb" integer(160, 1, 100_000);
        /// Profile "engine": about the most triangles of a plant at its finest level of detail; the next levels have 1/4, 1/12 and 1/60 of it.
        triangles: u32 = "triangles" integer(32_000, 100, 10_000_000);
        /// Profile "engine": most joints of a plant.
        joints: u32 = "joints" integer(64, 1, 256);
        /// Profile "engine": what red, green, blue and alpha of plants hold for a shader of wind: four words, or a preset.
        channels: Vec<WindWord> = "channels" SequenceOf(WindWord::Zero);
    }
}

impl WindWord {
    /// Whether the word names a preset, which sets all four channels.
    pub fn is_preset(self) -> bool {
        matches!(self, Self::Crysis | Self::O3de | Self::Unity | Self::Godot | Self::Unreal)
    }
}

/// An export format as a value of the key `formats`.
#[derive(Debug, Clone, Copy)]
pub struct OutputFormat(pub &'static FormatInfo);

impl PartialEq for OutputFormat {
    fn eq(&self, other: &Self) -> bool {
        self.0.word == other.0.word
    }
}

impl Choice for OutputFormat {
    const ALL: &'static [(&'static str, Self)] = &{
        // Constants cannot collect iterators: the array is filled by a loop.
        let mut all = [("", Self(&usd::FORMAT)); FORMATS.len()];
        let mut i = 0;
        while i < all.len() {
            all[i] = (FORMATS[i].word, Self(FORMATS[i]));
            i += 1;
        }
        all
    };
}

impl Digest for OutputFormat {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        self.0.word.digest(hasher);
    }
}
