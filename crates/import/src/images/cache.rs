//! Maps of a file's materials: each image is decoded once, and stored once for each use.

use std::collections::BTreeMap;

use super::decode::DecodedImage;
use crate::table_index;
use osier_scene::{Image, ImageKind, Pixels};

/// The map that an image becomes, with the factors that it is multiplied by, as bits (so that equal uses compare equal).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum MapUse {
    /// The image as a colour map.
    Color {
        /// Factors on red, green, blue and alpha, as bits; none if they are all 1.
        tint: Option<[u32; 4]>,
        /// Whether the alpha of the image is dropped.
        opaque: bool,
    },
    /// The green channel as roughness, with its factor as bits.
    Roughness(u32),
    /// Tangent-space normals, as in the file.
    Normal,
}

impl MapUse {
    /// `opaque`: without the alpha that the image has.
    pub(crate) fn color(tint: [f32; 4], opaque: bool) -> Self {
        // Factors of 1 change nothing: the picture is then shared with uses that have none.
        Self::Color { tint: tint.iter().any(|v| *v < 1.0).then(|| tint.map(f32::to_bits)), opaque }
    }

    pub(crate) fn roughness(factor: f32) -> Self {
        Self::Roughness(factor.to_bits())
    }

    /// True if the image is used unchanged.
    fn is_plain(self) -> bool {
        matches!(self, Self::Color { tint: None, opaque: false } | Self::Normal)
    }

    fn apply(self, raw: DecodedImage) -> DecodedImage {
        match self {
            Self::Color { tint, opaque } => {
                let raw = if opaque { raw.without_alpha() } else { raw };
                match tint {
                    Some(tint) => raw.tinted(tint.map(f32::from_bits)),
                    None => raw,
                }
            }
            // glTF packs roughness into green; a grey picture is taken as it is.
            Self::Roughness(factor) => raw.channel(1, 255).scaled(f32::from_bits(factor)),
            Self::Normal => raw,
        }
    }

    fn image_kind(self) -> ImageKind {
        if matches!(self, Self::Color { .. }) { ImageKind::Color } else { ImageKind::Data }
    }

    fn suffix(self) -> &'static str {
        match self {
            Self::Color { .. } => "color",
            Self::Roughness(_) => "rough",
            Self::Normal => "normal",
        }
    }
}

/// A decoded image, before or after it is stored unchanged.
#[derive(Debug)]
enum CachedImage {
    /// Decoded, not stored in the result yet.
    Decoded(DecodedImage),
    /// Stored unchanged: index into the resulting images.
    Stored(u32),
}

/// The images of a file by their number in it, and the maps made from them.
#[derive(Debug, Default)]
pub(crate) struct MapCache {
    images: Vec<Image>,
    stored: BTreeMap<(usize, MapUse), u32>,
    /// By number; `None` where a file is absent.
    decoded: BTreeMap<usize, Option<CachedImage>>,
}

impl MapCache {
    /// True once an image was decoded or found absent.
    pub(crate) fn contains(&self, number: usize) -> bool {
        self.decoded.contains_key(&number)
    }

    /// Adds a decoded image; `None` if its file is absent.
    pub(crate) fn add(&mut self, number: usize, raw: Option<DecodedImage>) {
        self.decoded.insert(number, raw.map(CachedImage::Decoded));
    }

    /// Channels of an image, 1, 3 or 4; `None` if it was not decoded or its file is absent.
    pub(crate) fn channels(&self, number: usize) -> Option<u8> {
        match self.decoded.get(&number)?.as_ref()? {
            CachedImage::Decoded(raw) => Some(raw.channels),
            CachedImage::Stored(index) => self.images.get(*index as usize).map(|i| i.channels),
        }
    }

    /// Index of the map stored for a use; `None` if it was not stored yet.
    pub(crate) fn find(&self, number: usize, map_use: MapUse) -> Option<u32> {
        self.stored.get(&(number, map_use)).copied()
    }

    /// Bytes that storing a map takes in addition to its decoded image: none for the first use without a change.
    pub(crate) fn additional_bytes(&self, number: usize, map_use: MapUse) -> u64 {
        // The first plain use takes the decoded samples themselves; every other one makes a copy.
        let fresh = matches!(self.decoded.get(&number), Some(Some(CachedImage::Decoded(_))));
        let grey = matches!(map_use, MapUse::Roughness(_));
        if fresh && map_use.is_plain() {
            0
        } else {
            self.sample_bytes(number) / if grey { u64::from(self.channels(number).unwrap_or(1)) } else { 1 }
        }
    }

    fn sample_bytes(&self, number: usize) -> u64 {
        let samples = match self.decoded.get(&number) {
            Some(Some(CachedImage::Decoded(raw))) => raw.samples.len(),
            Some(Some(CachedImage::Stored(index))) => self.images.get(*index as usize).map_or(0, |i| bytes(i).len()),
            _ => 0,
        };
        samples as u64
    }

    /// Stores the map of a use; returns its index, `None` for an absent image.
    pub(crate) fn store(&mut self, number: usize, map_use: MapUse, name: &str) -> Option<u32> {
        let index = table_index(self.images.len());
        let slot = self.decoded.get_mut(&number)?;
        // The slot is emptied here; each case fills it again.
        let raw = match slot.take()? {
            CachedImage::Decoded(raw) if map_use.is_plain() => {
                *slot = Some(CachedImage::Stored(index));
                raw
            }
            CachedImage::Decoded(raw) => {
                let copy = raw.clone();
                *slot = Some(CachedImage::Decoded(raw));
                copy
            }
            CachedImage::Stored(at) => {
                *slot = Some(CachedImage::Stored(at));
                let image = self.images.get(at as usize)?;
                DecodedImage {
                    width: image.width,
                    height: image.height,
                    channels: image.channels,
                    samples: bytes(image).to_vec(),
                }
            }
        };
        self.images.push(map_use.apply(raw).into_image(format!("{name}_{}", map_use.suffix()), map_use.image_kind()));
        self.stored.insert((number, map_use), index);
        Some(index)
    }

    /// The stored maps, in the order of their indices.
    pub(crate) fn finish(self) -> Vec<Image> {
        self.images
    }
}

/// Samples of an 8-bit image; empty for a 16-bit image.
fn bytes(image: &Image) -> &[u8] {
    match &image.pixels {
        Pixels::U8(samples) => samples,
        Pixels::U16(_) => &[],
    }
}
