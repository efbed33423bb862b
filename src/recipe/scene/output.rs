//! `[output]` and the tables of its formats.

use super::UpAxis;
use crate::recipe::syntax::{
    BooleanType, Choice, Digest, ListOf, NumberArray, OneOf, OptionalKey, degrees, integer, millimetres, number,
};
use crate::recipe::syntax::{choices, keys};
use osier_export::format::FormatInfo;
use osier_export::registry::FORMATS;
use osier_export::{gltf, usd};

choices! {
    /// How copies of a plant are shown in USD.
    CopyStyle {
        /// One point instancer for each plant: few objects, any number of copies.
        Instancer = "instancer",
        /// A prim for each copy: in Blender an object each.
        References = "references",
    }
    /// The readers a glb is made for.
    GltfProfile {
        /// Any Blender: merged leaves, every key.
        Blender = "blender",
        /// Browsers and engines: instanced leaves, sparse keys.
        Web = "web",
    }
}

keys! {
    /// What is written.
    OutputKeys at "output" {
        /// File formats.
        formats: Vec<OutputFormat> = "formats" ListOf(&[OutputFormat(&usd::FORMAT), OutputFormat(&gltf::FORMAT)]);
    }
    /// POV-Ray files.
    PovKeys at "output.pov" {
        /// Frames between two written ones.
        step: u32 = "step" integer(1, 1, 1_000_000);
        /// Width and height of the picture.
        size: [f64; 2] = "size" NumberArray([800.0, 600.0], number(800.0, 8.0, 16384.0, "pixels"));
        /// Share of the time between two frames for which the shutter is open: how long the streaks of falling water are.
        shutter: f64 = "shutter" number(0.5, 0.0, 1.0, "");
        /// Scene units per metre.
        units: f64 = "units_per_m" number(100.0, 1.0, 1e5, "");
    }
    /// Light that drops gather: photons are shot through them, and a frame takes half as long again to twice as long. The table alone
    /// switches it on.
    PhotonKeys at "output.pov.photons" {
        /// Radius of the smallest drops that gather light; smaller ones are lit as everything else.
        smallest: f64 = "smallest_mm" millimetres(1.0, 0.2, 10.0);
    }
    /// USD files.
    UsdKeys at "output.usd" {
        /// Upward axis.
        up: UpAxis = "up" OneOf(UpAxis::Y);
        /// How several placements of a plant are shown: by one point instancer, or by a prim each, to edit single copies.
        copies: CopyStyle = "copies" OneOf(CopyStyle::Instancer);
        /// How far leaves that ride on branches may be from where they were simulated, between two frames that are kept; 0 keeps all.
        tolerance: f64 = "tolerance_mm" millimetres(1.0, 0.0, 100.0);
        /// The same of their rotations.
        turn_tolerance: f64 = "turn_tolerance_deg" degrees(0.5, 0.0, 45.0);
    }
    /// glTF files.
    GltfKeys at "output.gltf" {
        /// For which readers.
        profiles: Vec<GltfProfile> = "profiles" ListOf(&[GltfProfile::Web]);
        /// Only this frame, standing still: any number of things that fly, as instances in the web profile.
        frame: Option<u32> = "frame" OptionalKey(integer(1, 0, 999_999), "the whole clip, moving");
        /// Most things that fly that a moving file holds, a node and a track each.
        nodes: u32 = "nodes" integer(500, 1, 100_000);
        /// Most plants that sway by a skeleton of their own; those beyond, farthest from the camera, stand still and share meshes.
        skins: u32 = "skins" integer(64, 0, 100_000);
        /// Whether each asset has a file of its own, beside the one of the whole scene.
        assets: bool = "assets" BooleanType(false);
    }
}

/// A format of the registry of osier-export.
#[derive(Debug, Clone, Copy)]
pub struct OutputFormat(pub &'static FormatInfo);

impl PartialEq for OutputFormat {
    fn eq(&self, other: &Self) -> bool {
        self.0.word == other.0.word
    }
}

impl Choice for OutputFormat {
    const ALL: &'static [(&'static str, Self)] = &{
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
