//! Pictures of a file's materials: each decoded once, and kept once for each use.

use std::collections::BTreeMap;

use super::Raw;
use osier_scene::{Image, ImageKind, Pixels};

/// What a picture is used for, with the factors that it is multiplied by, as bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Use {
    /// Colour; no factors where they change nothing.
    Color(Option<[u32; 4]>),
    /// The green channel as roughness.
    Rough(u32),
    /// Normals.
    Normal,
}

impl Use {
    pub(crate) fn color(tint: [f32; 4]) -> Self {
        Self::Color(tint.iter().any(|v| *v < 1.0).then(|| tint.map(f32::to_bits)))
    }

    pub(crate) fn rough(factor: f32) -> Self {
        Self::Rough(factor.to_bits())
    }

    /// True if the picture is used as the file has it.
    fn is_plain(self) -> bool {
        matches!(self, Self::Color(None) | Self::Normal)
    }

    fn of(self, raw: Raw) -> Raw {
        match self {
            Self::Color(Some(tint)) => raw.tinted(tint.map(f32::from_bits)),
            Self::Rough(factor) => raw.channel(1, 255).scaled(f32::from_bits(factor)),
            Self::Color(None) | Self::Normal => raw,
        }
    }

    fn kind(self) -> ImageKind {
        if matches!(self, Self::Color(_)) { ImageKind::Color } else { ImageKind::Data }
    }

    fn ending(self) -> &'static str {
        match self {
            Self::Color(_) => "color",
            Self::Rough(_) => "rough",
            Self::Normal => "normal",
        }
    }
}

/// A decoded picture.
#[derive(Debug)]
enum Decoded {
    /// As the file has it, not kept yet.
    Fresh(Raw),
    /// Kept as the file has it: index into the pictures.
    Kept(u32),
}

/// Pictures by their number in the file.
#[derive(Debug, Default)]
pub(crate) struct Shelf {
    images: Vec<Image>,
    known: BTreeMap<(usize, Use), u32>,
    /// None where a file is absent.
    decoded: BTreeMap<usize, Option<Decoded>>,
}

impl Shelf {
    /// True once a picture was decoded or found absent.
    pub(crate) fn knows(&self, number: usize) -> bool {
        self.decoded.contains_key(&number)
    }

    /// Takes a decoded picture.
    pub(crate) fn add(&mut self, number: usize, raw: Option<Raw>) {
        self.decoded.insert(number, raw.map(Decoded::Fresh));
    }

    /// Channels of a decoded picture.
    pub(crate) fn channels(&self, number: usize) -> Option<u8> {
        match self.decoded.get(&number)?.as_ref()? {
            Decoded::Fresh(raw) => Some(raw.channels),
            Decoded::Kept(index) => self.images.get(*index as usize).map(|i| i.channels),
        }
    }

    /// The picture that is kept for a use.
    pub(crate) fn find(&self, number: usize, way: Use) -> Option<u32> {
        self.known.get(&(number, way)).copied()
    }

    /// Bytes that keeping a picture for a use takes beyond what it took to decode it.
    pub(crate) fn more(&self, number: usize, way: Use) -> u64 {
        let fresh = matches!(self.decoded.get(&number), Some(Some(Decoded::Fresh(_))));
        let grey = matches!(way, Use::Rough(_));
        if fresh && way.is_plain() {
            0
        } else {
            self.raw_bytes(number) / if grey { u64::from(self.channels(number).unwrap_or(1)) } else { 1 }
        }
    }

    fn raw_bytes(&self, number: usize) -> u64 {
        let samples = match self.decoded.get(&number) {
            Some(Some(Decoded::Fresh(raw))) => raw.samples.len(),
            Some(Some(Decoded::Kept(index))) => self.images.get(*index as usize).map_or(0, |i| bytes(i).len()),
            _ => 0,
        };
        samples as u64
    }

    /// Keeps a picture for a use; `None` if there is none.
    pub(crate) fn keep(&mut self, number: usize, way: Use, name: &str) -> Option<u32> {
        let index = u32::try_from(self.images.len()).unwrap_or(u32::MAX);
        let slot = self.decoded.get_mut(&number)?;
        let raw = match slot.take()? {
            Decoded::Fresh(raw) if way.is_plain() => {
                *slot = Some(Decoded::Kept(index));
                raw
            }
            Decoded::Fresh(raw) => {
                let copy = raw.clone();
                *slot = Some(Decoded::Fresh(raw));
                copy
            }
            Decoded::Kept(at) => {
                *slot = Some(Decoded::Kept(at));
                let image = self.images.get(at as usize)?;
                Raw {
                    width: image.width,
                    height: image.height,
                    channels: image.channels,
                    samples: bytes(image).to_vec(),
                }
            }
        };
        self.images.push(way.of(raw).into_image(format!("{name}_{}", way.ending()), way.kind()));
        self.known.insert((number, way), index);
        Some(index)
    }

    /// All that is kept.
    pub(crate) fn finish(self) -> Vec<Image> {
        self.images
    }
}

fn bytes(image: &Image) -> &[u8] {
    match &image.pixels {
        Pixels::U8(samples) => samples,
        Pixels::U16(_) => &[],
    }
}
