//! One glTF file under construction: lists that grow, names and arrays that are shared.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Quat, Vec3};

use super::super::{GENERATOR, VERSION, Warning};
use super::buffer::{Buffer, last};
use super::json::{
    Animation, AssetInfo, Channel, ChannelTarget, Extras, FileMark, FogMark, Index, Node, NodeMark, Root, Sampler,
    SceneList, SceneMark,
};
use super::keys::{Keys, unit};
use super::materials::Surface;
use super::tracks::Tracks;
use super::{Pictures, Profile};
use crate::textures::Textures;
use osier_base::{Error, Result};
use osier_scene::{Scene, Trs};

/// What a file is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source<'a> {
    pub scene: &'a Scene,
    pub tracks: &'a Tracks,
    pub textures: &'a Textures,
    pub profile: Profile,
    /// Most placements with a skin of their own.
    pub skins: usize,
}

/// A file under construction.
#[derive(Debug)]
pub(super) struct Document<'a> {
    pub from: Source<'a>,
    pub pictures: Pictures,
    pub root: Root,
    pub buffer: Buffer,
    pub animation: Animation,
    pub warnings: Vec<Warning>,
    /// Most joints of an animated plant.
    pub joints: usize,
    pub surfaces: BTreeMap<Surface, Index>,
    pub textures: BTreeMap<u32, Index>,
    names: BTreeSet<String>,
    extensions: BTreeSet<&'static str>,
    required: BTreeSet<&'static str>,
    times: BTreeMap<Vec<u32>, Index>,
}

/// A sampler and the node property it drives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drive {
    pub sampler: Index,
    pub path: &'static str,
}

/// A node's transform and what of it is animated.
#[derive(Debug, Clone, Default)]
pub(super) struct Motion {
    pub rest: Trs,
    pub drives: Vec<Drive>,
}

impl<'a> Document<'a> {
    pub(super) fn new(from: Source<'a>, pictures: Pictures) -> Self {
        let clip = from.scene.clip;
        let fog = from.scene.sky.fog.map(|f| FogMark { visibility: f.visibility, color: f.color, height: f.height });
        let mark = FileMark {
            fog,
            schema: 1,
            version: VERSION,
            seed: from.scene.seed.to_string(),
            scene: SceneMark { name: from.scene.name.clone(), hash: from.scene.hash.clone() },
            fps: clip.fps.into(),
            start: clip.start,
            end: clip.end,
        };
        let asset = AssetInfo { version: "2.0", generator: GENERATOR, extras: Extras { osier: mark } };
        Self {
            from,
            pictures,
            root: Root { asset, scenes: vec![SceneList::default()], ..Root::default() },
            buffer: Buffer::default(),
            animation: Animation::default(),
            warnings: Vec::new(),
            joints: super::rig::JOINTS,
            surfaces: BTreeMap::new(),
            textures: BTreeMap::new(),
            names: BTreeSet::new(),
            extensions: BTreeSet::new(),
            required: BTreeSet::new(),
            times: BTreeMap::new(),
        }
    }

    /// Adds a node under a name made unique by `_2`, `_3`, ...
    pub(super) fn node(&mut self, mut node: Node) -> Result<Index> {
        let mut name = node.name.clone();
        let mut n = 1_u32;
        while !self.names.insert(name.clone()) {
            n += 1;
            name = format!("{}_{n}", node.name);
        }
        node.name = name;
        self.root.nodes.push(node);
        last(self.root.nodes.len())
    }

    /// Makes a node a child of another, or of the scene.
    pub(super) fn attach(&mut self, parent: Option<Index>, child: Index) {
        match parent.and_then(|p| self.root.nodes.get_mut(p as usize)) {
            Some(node) => node.children.push(child),
            None => self.root.scenes.iter_mut().for_each(|s| s.nodes.push(child)),
        }
    }

    /// Notes an extension in use.
    pub(super) fn uses(&mut self, extension: &'static str, required: bool) {
        self.extensions.insert(extension);
        if required {
            self.required.insert(extension);
        }
    }

    /// Points the drives of a motion at a node.
    pub(super) fn animate(&mut self, node: Index, drives: &[Drive]) {
        let channel = |d: &Drive| Channel { sampler: d.sampler, target: ChannelTarget { node, path: d.path } };
        self.animation.channels.extend(drives.iter().map(channel));
    }

    /// Takes keys of positions or scales: a constant goes to `rest`, else a sampler is added and `rest` stays.
    pub(super) fn drive_vector(
        &mut self,
        keys: Keys<Vec3>,
        path: &'static str,
        step: bool,
        rest: &mut Vec3,
        drives: &mut Vec<Drive>,
    ) -> Result<()> {
        match keys {
            Keys::Constant(v) => *rest = v,
            Keys::At(kept, values) => {
                let output = self.buffer.vectors(&values, None, path)?;
                drives.push(Drive { sampler: self.sampler(&kept, output, step)?, path });
            }
        }
        Ok(())
    }

    /// Takes keys of rotations likewise.
    pub(super) fn drive_rotation(&mut self, keys: Keys<Quat>, rest: &mut Quat, drives: &mut Vec<Drive>) -> Result<()> {
        match keys {
            Keys::Constant(q) => *rest = q,
            Keys::At(kept, values) => {
                let output = self.buffer.quaternions(&values, "rotation")?;
                drives.push(Drive { sampler: self.sampler(&kept, output, false)?, path: "rotation" });
            }
        }
        Ok(())
    }

    /// A sampler over some of the clip's frames.
    pub(super) fn sampler(&mut self, kept: &[usize], output: Index, step: bool) -> Result<Index> {
        let times: Vec<f32> = kept.iter().filter_map(|&i| self.from.tracks.times.get(i)).copied().collect();
        let bits: Vec<u32> = times.iter().map(|t| t.to_bits()).collect();
        let input = match self.times.get(&bits) {
            Some(input) => *input,
            None => {
                let input = self.buffer.times(&times)?;
                self.times.insert(bits, input);
                input
            }
        };
        let interpolation = step.then_some("STEP");
        self.animation.samplers.push(Sampler { input, interpolation, output });
        last(self.animation.samplers.len())
    }

    /// Completes the lists. `name`: of the scene and the animation.
    pub(super) fn close(&mut self, name: &str) {
        self.root.extensions_used = self.extensions.iter().copied().collect();
        self.root.extensions_required = self.required.iter().copied().collect();
        self.root.scenes.iter_mut().for_each(|s| s.name = name.to_owned());
        let mut animation = std::mem::take(&mut self.animation);
        if !animation.channels.is_empty() {
            name.clone_into(&mut animation.name);
            self.root.animations.push(animation);
        }
        self.root.accessors = std::mem::take(&mut self.buffer.accessors);
        self.root.buffer_views = std::mem::take(&mut self.buffer.views);
    }
}

/// Refuses a transform that is not finite.
pub(super) fn finite(trs: &Trs, what: impl FnOnce() -> String) -> Result<()> {
    if trs.t.is_finite() && trs.r.is_finite() && trs.s.is_finite() {
        return Ok(());
    }
    Err(Error::export("X001", format!("{}: its transform is not finite", what())))
}

/// A node with a transform and our mark.
pub(super) fn marked(name: String, rest: &Trs, id: String, kind: &'static str) -> Node {
    Node { extras: Some(Extras { osier: NodeMark { id, kind } }), ..placed(name, rest) }
}

/// A node with a transform; what is identity is left out.
pub(super) fn placed(name: String, rest: &Trs) -> Node {
    let unless = |v: Vec3, default: Vec3| (v != default).then(|| (v + 0.0).to_array());
    let q = unit(rest.r);
    let q = if q.w < 0.0 { -q } else { q };
    Node {
        name,
        translation: unless(rest.t, Vec3::ZERO),
        rotation: (q != Quat::IDENTITY).then_some([q.x, q.y, q.z, q.w]),
        scale: unless(rest.s, Vec3::ONE),
        ..Node::default()
    }
}
