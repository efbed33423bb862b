//! A glTF document being built: the top-level lists, unique node names, shared materials, textures and key times.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Quat, Vec3};

use super::super::{GENERATOR, VERSION, Warning};
use super::buffer::{BinaryBuffer, last_index};
use super::json::{
    Animation, AssetInfo, Channel, ChannelTarget, Extras, FileExtras, FogExtras, Index, Node, NodeExtras, Root,
    Sampler, SceneExtras, SceneNodes,
};
use super::keys::{KeyedValues, renormalized};
use super::tracks::ClipTracks;
use super::{GltfOptions, ImageStorage};
use crate::textures::Textures;
use osier_base::{Error, Result};
use osier_scene::{MaterialId, Scene, Trs};

/// Input of every document of an export: the scene, its recorded motion, its textures, and the options.
#[derive(Debug, Clone, Copy)]
pub(super) struct GltfInput<'a> {
    pub scene: &'a Scene,
    pub tracks: &'a ClipTracks,
    pub textures: &'a Textures,
    pub options: &'a GltfOptions,
}

/// A material for one kind of geometry: each combination becomes a separate glTF material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct MaterialVariant {
    pub material: MaterialId,
    pub geometry: GeometryKind,
}

/// Kinds of geometry that need different glTF materials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum GeometryKind {
    Mesh,
    /// Level of a plant with fewer and larger leaves: leaves have no normal map, whose relief would be enlarged with
    /// them.
    ThinnedPlant,
    /// A flat strip instead of a curve: double-sided.
    Ribbon,
    /// Points with a colour each: no textures, base colour white.
    ColoredPoints,
    /// Points without colours: no textures.
    PlainPoints,
}

/// A document under construction: lists grow until [`Self::finish_root`] moves them into `root`.
#[derive(Debug)]
pub(super) struct GltfDocument<'a> {
    pub input: GltfInput<'a>,
    pub pictures: ImageStorage,
    pub root: Root,
    pub buffer: BinaryBuffer,
    pub animation: Animation,
    pub warnings: Vec<Warning>,
    /// Most joints of an animated skeleton; the others follow their nearest ancestors that are written (X002).
    pub max_joints: usize,
    pub material_indices: BTreeMap<MaterialVariant, Index>,
    pub texture_indices: BTreeMap<u32, Index>,
    node_names: BTreeSet<String>,
    extensions: BTreeSet<&'static str>,
    required: BTreeSet<&'static str>,
    time_accessors: BTreeMap<Vec<u32>, Index>,
}

/// An animation channel before its node is known: a sampler, and the property of a node that it animates.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeChannel {
    pub sampler: Index,
    pub path: &'static str,
}

/// A node's transform at rest, and the channels that animate it.
#[derive(Debug, Clone, Default)]
pub(super) struct NodeAnimation {
    pub rest: Trs,
    pub channels: Vec<NodeChannel>,
}

impl<'a> GltfDocument<'a> {
    pub(super) fn new(input: GltfInput<'a>, pictures: ImageStorage) -> Self {
        let clip = input.scene.clip;
        let fog = input.scene.sky.fog.map(|f| FogExtras { visibility: f.visibility, color: f.color, height: f.height });
        let extras = FileExtras {
            fog,
            schema: 1,
            version: VERSION,
            seed: input.scene.seed.to_string(),
            scene: SceneExtras { name: input.scene.name.clone(), hash: input.scene.hash.clone() },
            fps: clip.fps.into(),
            start: clip.start,
            end: clip.end,
        };
        let asset = AssetInfo { version: "2.0", generator: GENERATOR, extras: Extras { osier: extras } };
        Self {
            input,
            pictures,
            root: Root { asset, scenes: vec![SceneNodes::default()], ..Root::default() },
            buffer: BinaryBuffer { compressed: input.options.compresses(), ..BinaryBuffer::default() },
            animation: Animation::default(),
            warnings: Vec::new(),
            max_joints: input.options.most_joints(),
            material_indices: BTreeMap::new(),
            texture_indices: BTreeMap::new(),
            node_names: BTreeSet::new(),
            extensions: BTreeSet::new(),
            required: BTreeSet::new(),
            time_accessors: BTreeMap::new(),
        }
    }

    /// Adds a node; its name is made unique by `_2`, `_3`, ...
    pub(super) fn add_node(&mut self, mut node: Node) -> Result<Index> {
        let mut name = node.name.clone();
        let mut n = 1_u32;
        // glTF does not ask for unique names, but importers rename duplicates and tools find nodes by name.
        while !self.node_names.insert(name.clone()) {
            n += 1;
            name = format!("{}_{n}", node.name);
        }
        node.name = name;
        self.root.nodes.push(node);
        last_index(self.root.nodes.len())
    }

    /// Makes a node a child of another, or a root of the scene.
    pub(super) fn attach_node(&mut self, parent: Option<Index>, child: Index) {
        match parent.and_then(|p| self.root.nodes.get_mut(p as usize)) {
            Some(node) => node.children.push(child),
            None => self.root.scenes.iter_mut().for_each(|s| s.nodes.push(child)),
        }
    }

    /// Lists an extension as used, and as required if readers without it cannot show the file.
    pub(super) fn use_extension(&mut self, extension: &'static str, required: bool) {
        self.extensions.insert(extension);
        if required {
            self.required.insert(extension);
        }
    }

    /// Adds channels that animate `node` to the document's animation.
    pub(super) fn add_channels(&mut self, node: Index, channels: &[NodeChannel]) {
        let channel = |d: &NodeChannel| Channel { sampler: d.sampler, target: ChannelTarget { node, path: d.path } };
        self.animation.channels.extend(channels.iter().map(channel));
    }

    /// Adds a sampler for keys of translation or scale, and its channel to `channels`. A constant needs no sampler: it becomes
    /// the node's value at `rest`. `step`: interpolation STEP instead of LINEAR.
    pub(super) fn add_vector_keys(
        &mut self,
        keys: KeyedValues<Vec3>,
        path: &'static str,
        step: bool,
        rest: &mut Vec3,
        channels: &mut Vec<NodeChannel>,
    ) -> Result<()> {
        match keys {
            KeyedValues::Constant(v) => *rest = v,
            KeyedValues::Keys(frames, values) => {
                let output = self.buffer.add_vectors(&values, None, path)?;
                channels.push(NodeChannel { sampler: self.add_sampler(&frames, output, step)?, path });
            }
        }
        Ok(())
    }

    /// As [`Self::add_vector_keys`], for keys of rotation.
    pub(super) fn add_rotation_keys(
        &mut self,
        keys: KeyedValues<Quat>,
        rest: &mut Quat,
        channels: &mut Vec<NodeChannel>,
    ) -> Result<()> {
        match keys {
            KeyedValues::Constant(q) => *rest = q,
            KeyedValues::Keys(frames, values) => {
                let output = self.buffer.add_rotation_keys(&values, "rotation")?;
                channels.push(NodeChannel { sampler: self.add_sampler(&frames, output, false)?, path: "rotation" });
            }
        }
        Ok(())
    }

    /// Adds a sampler whose keys are at these frames of the clip.
    pub(super) fn add_sampler(&mut self, frames: &[usize], output: Index, step: bool) -> Result<Index> {
        let times: Vec<f32> = frames.iter().filter_map(|&i| self.input.tracks.times.get(i)).copied().collect();
        self.add_timed_sampler(&times, output, step)
    }

    /// Adds a sampler with keys at these times, s, increasing. Samplers with equal key times share an accessor.
    pub(super) fn add_timed_sampler(&mut self, times: &[f32], output: Index, step: bool) -> Result<Index> {
        // Keyed by the bits of the times, since floats have no total order; equal bits are equal times.
        let bits: Vec<u32> = times.iter().map(|t| t.to_bits()).collect();
        let input = match self.time_accessors.get(&bits) {
            Some(input) => *input,
            None => {
                let input = self.buffer.add_key_times(times)?;
                self.time_accessors.insert(bits, input);
                input
            }
        };
        // LINEAR is the default of the format and is not written.
        let interpolation = step.then_some("STEP");
        self.animation.samplers.push(Sampler { input, interpolation, output });
        last_index(self.animation.samplers.len())
    }

    /// Moves extensions, animation, accessors and buffer views into the root. `name`: name of the scene and the animation.
    pub(super) fn finish_root(&mut self, name: &str) {
        if self.buffer.compressed && self.buffer.views.iter().any(|v| v.stream.is_some()) {
            self.use_extension("EXT_meshopt_compression", true);
        }
        self.root.extensions_used = self.extensions.iter().copied().collect();
        self.root.extensions_required = self.required.iter().copied().collect();
        self.root.scenes.iter_mut().for_each(|s| s.name = name.to_owned());
        let mut animation = std::mem::take(&mut self.animation);
        // An animation without channels is invalid, so a document without motion has none.
        if !animation.channels.is_empty() {
            name.clone_into(&mut animation.name);
            self.root.animations.push(animation);
        }
        self.root.accessors = std::mem::take(&mut self.buffer.accessors);
        self.root.buffer_views = std::mem::take(&mut self.buffer.views);
    }
}

/// X001 if a transform is not finite.
pub(super) fn check_finite(trs: &Trs, label: impl FnOnce() -> String) -> Result<()> {
    if trs.t.is_finite() && trs.r.is_finite() && trs.s.is_finite() {
        return Ok(());
    }
    Err(Error::export("X001", format!("{}: its transform is not finite", label())))
}

/// A node with a transform and osier's id and kind in its extras.
pub(super) fn node_with_extras(name: String, rest: &Trs, id: String, kind: &'static str) -> Node {
    Node { extras: Some(Extras { osier: NodeExtras { id, kind } }), ..node_with_transform(name, rest) }
}

/// A node with a transform; components that are the identity are omitted.
pub(super) fn node_with_transform(name: String, rest: &Trs) -> Node {
    let unless = |v: Vec3, default: Vec3| (v != default).then(|| (v + 0.0).to_array());
    let q = renormalized(rest.r);
    // One of the two quaternions of the rotation, chosen so that equal poses are written alike.
    let q = if q.w < 0.0 { -q } else { q };
    Node {
        name,
        translation: unless(rest.t, Vec3::ZERO),
        rotation: (q != Quat::IDENTITY).then_some([q.x, q.y, q.z, q.w]),
        scale: unless(rest.s, Vec3::ONE),
        ..Node::default()
    }
}
