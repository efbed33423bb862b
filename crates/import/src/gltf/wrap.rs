//! Textures that are mirrored or held beyond their edges. The meshes and images of a scene repeat, so such images are unfolded
//! over the texture coordinates that the mesh has.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec2;
use gltf::json::Root;
use gltf::json::texture::WrappingMode;
use gltf::json::validation::Checked;

use crate::assembly::MeshPart;
use crate::{ImportContext, table_index};
use osier_base::files::Names;
use osier_base::math;
use osier_scene::{Image, Maps, Material, Pixels};

/// Texture coordinates outside by no more than this count as inside: they show the texels at the edge. Own: a third of
/// a texel of a large texture.
const BESIDE_EDGE: f64 = 1e-4;
/// Farthest texture coordinates for which images are unfolded.
const FARTHEST: f64 = 1e6;

/// What a texture shows beyond its edges along one axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) enum Wrap {
    #[default]
    Repeat,
    Mirror,
    /// The texels of the edge.
    Clamp,
}

/// Wrap modes of the maps of a material, along u and v.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct MaterialWraps {
    pub(super) color: [Wrap; 2],
    pub(super) roughness: [Wrap; 2],
    pub(super) normal: [Wrap; 2],
}

/// The wrap modes of the sampler of a texture, along u and v; without a sampler it repeats.
pub(super) fn wraps_of_texture(root: &Root, texture: usize) -> [Wrap; 2] {
    let sampler = root.textures.get(texture).and_then(|t| root.samplers.get(t.sampler?.value()));
    let wrap = |mode: &Checked<WrappingMode>| match mode {
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    };
    sampler.map_or([Wrap::Repeat; 2], |s| [wrap(&s.wrap_s), wrap(&s.wrap_t)])
}

/// Part of an axis of texture coordinates that an unfolded image covers: from `start / grid`, `count / grid` long.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Span {
    start: i64,
    count: i64,
    /// Units per image; divides the number of texels of each map along the axis.
    grid: i64,
}

impl Span {
    /// One image, unchanged.
    const WHOLE: Self = Self { start: 0, count: 1, grid: 1 };

    /// The span in which maps with these wrap modes and lengths in texels show the same as from `least` to `most`;
    /// `None` beyond [`FARTHEST`].
    fn of(maps: &[(Wrap, u32)], [least, most]: [f64; 2]) -> Option<Self> {
        let has = |wrap: Wrap| maps.iter().any(|(w, _)| *w == wrap);
        let inside = least >= -BESIDE_EDGE && most <= 1.0 + BESIDE_EDGE;
        if inside || !(has(Wrap::Mirror) || has(Wrap::Clamp)) {
            return Some(Self::WHOLE);
        }
        if !has(Wrap::Clamp) {
            // An image and its mirror image together repeat.
            return Some(Self { start: 0, count: 2, grid: 1 });
        }
        if least < -FARTHEST || most > FARTHEST {
            return None;
        }
        let grid = maps.iter().fold(0, |g, (_, texels)| greatest_common_divisor(g, i64::from(*texels)));
        // One unit more on each side, so that no filter reaches the other edge.
        let start = whole(least * as_float(grid)) - 1;
        let end = whole(most * as_float(grid)) + 2;
        Some(Self { start, count: end - start, grid })
    }

    /// Length, texels, of the unfolded image of an image that is `texels` long.
    fn length(self, texels: u32) -> i64 {
        self.count * (i64::from(texels) / self.grid)
    }

    /// For each texel of the unfolded image, the texel that it shows of an image that is `texels` long, 0 to `texels -
    /// 1`.
    fn sources(self, texels: u32, wrap: Wrap) -> Vec<usize> {
        let side = i64::from(texels);
        let first = self.start * (side / self.grid);
        let source = |k: i64| match wrap {
            Wrap::Repeat => k.rem_euclid(side),
            Wrap::Clamp => k.clamp(0, side - 1),
            Wrap::Mirror => {
                let at = k.rem_euclid(2 * side);
                at.min(2 * side - 1 - at)
            }
        };
        (first..first + self.length(texels)).filter_map(|k| usize::try_from(source(k)).ok()).collect()
    }

    /// Converts a texture coordinate to one in the unfolded image.
    fn map(self, at: f64) -> f64 {
        (at * as_float(self.grid) - as_float(self.start)) / as_float(self.count)
    }
}

/// Unfolds the images of materials whose texture coordinates leave the square from 0 to 1 where their sampler does not
/// repeat, and converts these coordinates. `spent`: bytes of the images so far. Images that would exceed a limit are
/// not unfolded and repeat instead (X016).
pub(super) fn unfold(
    context: &mut ImportContext<'_>,
    parts: &mut [MeshPart],
    materials: &mut [Material],
    images: &mut Vec<Image>,
    wraps: &[MaterialWraps],
    mut spent: u64,
) {
    let side = context.options.limits.get("image-side");
    let budget = context.options.limits.get("image-bytes");
    let mut names = Names::default();
    images.iter().for_each(|image| drop(names.unique(&image.name)));
    let mut unfolded: BTreeMap<(u32, [Span; 2], [Wrap; 2]), u32> = BTreeMap::new();
    let mut too_large = Vec::new();
    for (number, (material, wraps)) in materials.iter_mut().zip(wraps).enumerate() {
        let number = table_index(number);
        // Find the span that the texture coordinates cover, in whole images; spans of one image need no unfolding.
        let Maps { color, roughness, normal, .. } = material.maps;
        let given = [(color, wraps.color), (roughness, wraps.roughness), (normal, wraps.normal)];
        let maps: Vec<(u32, [Wrap; 2])> = given.iter().filter_map(|(map, wrap)| Some(((*map)?, *wrap))).collect();
        let Some(bounds) = coordinate_bounds(parts, number) else { continue };
        let sizes = |i: u32| images.get(i as usize).map_or([1, 1], |image| [image.width, image.height]);
        let span = |axis: usize| {
            let along: Vec<(Wrap, u32)> = maps.iter().map(|(i, wrap)| (wrap[axis], sizes(*i)[axis])).collect();
            Span::of(&along, bounds[axis])
        };
        let (Some(across), Some(down)) = (span(0), span(1)) else {
            too_large.push(material.name.clone());
            continue;
        };
        let spans = [across, down];
        if spans == [Span::WHOLE; 2] {
            continue;
        }
        // All maps of a material share its texture coordinates: either all are unfolded or none.
        let lengths = |i: u32| {
            let [width, height] = sizes(i);
            [across.length(width), down.length(height)].map(i64::unsigned_abs)
        };
        let bytes = |i: u32| {
            let channels = images.get(i as usize).map_or(1, |image| u64::from(image.channels));
            lengths(i).into_iter().fold(channels, u64::saturating_mul)
        };
        let total = maps.iter().map(|(i, _)| bytes(*i)).fold(spent, u64::saturating_add);
        if total > budget || maps.iter().any(|(i, _)| lengths(*i).into_iter().any(|n| n > side)) {
            too_large.push(material.name.clone());
            continue;
        }
        spent = total;
        // Replace each map by its unfolded image; materials with the same image, spans and wraps share it.
        for (slot, wrap) in [
            (&mut material.maps.color, wraps.color),
            (&mut material.maps.roughness, wraps.roughness),
            (&mut material.maps.normal, wraps.normal),
        ] {
            let Some(old) = *slot else { continue };
            let key = (old, spans, wrap);
            let index = match unfolded.get(&key) {
                Some(index) => *index,
                None => {
                    let Some(image) = images.get(old as usize) else { continue };
                    let name = names.unique(&format!("{}_unfolded", image.name));
                    let image = unfolded_image(image, name, spans, wrap);
                    images.push(image);
                    table_index(images.len() - 1)
                }
            };
            unfolded.insert(key, index);
            *slot = Some(index);
        }
        // Map the coordinates of the material's parts to the unfolded images.
        for uv in parts.iter_mut().filter(|part| part.material == number).flat_map(|part| &mut part.uvs) {
            // Spans count v downwards, as glTF does.
            let [u, v] = [across.map(f64::from(uv.x)), 1.0 - down.map(1.0 - f64::from(uv.y))];
            *uv = Vec2::new(math::narrow(u), math::narrow(v));
        }
    }
    // The images that were replaced may have no user left.
    if !unfolded.is_empty() {
        remove_unused(materials, images);
    }
    if let Some(first) = too_large.first() {
        let n = too_large.len();
        let what = format_args!(
            "holds {n} materials, the first is {first:?}, whose textures are mirrored or held beyond their edges over more \
             texels than --max-image-side and --max-image-bytes allow; they repeat"
        );
        context.warn("X016", what);
    }
}

/// Smallest and largest texture coordinates of a material's parts along u and v, with v downwards; `None` if there are
/// none, or if one is not finite.
fn coordinate_bounds(parts: &[MeshPart], material: u32) -> Option<[[f64; 2]; 2]> {
    let mine = parts.iter().filter(|part| part.material == material).flat_map(|part| &part.uvs);
    let empty = [Vec2::INFINITY, Vec2::NEG_INFINITY];
    let [least, most] = mine.clone().fold(empty, |[least, most], uv| [least.min(*uv), most.max(*uv)]);
    let is_finite = mine.clone().all(|uv| uv.is_finite()) && least.is_finite();
    let [left, right] = [least.x, most.x].map(f64::from);
    let [top, bottom] = [most.y, least.y].map(|v| 1.0 - f64::from(v));
    is_finite.then_some([[left, right], [top, bottom]])
}

/// What an image with these wraps shows over the spans.
fn unfolded_image(image: &Image, name: String, [across, down]: [Span; 2], wrap: [Wrap; 2]) -> Image {
    let columns = across.sources(image.width, wrap[0]);
    let rows = down.sources(image.height, wrap[1]);
    let channels = usize::from(image.channels);
    let row_length = image.width as usize * channels;
    let pick = |samples: &[u8]| -> Vec<u8> {
        let mut out = Vec::with_capacity(rows.len() * columns.len() * channels);
        for row in &rows {
            let row = samples.get(row * row_length..(row + 1) * row_length).unwrap_or_default();
            for column in &columns {
                out.extend_from_slice(row.get(column * channels..(column + 1) * channels).unwrap_or_default());
            }
        }
        out
    };
    let pixels = match &image.pixels {
        Pixels::U8(samples) => Pixels::U8(pick(samples)),
        // Images of files have 8 bits.
        Pixels::U16(samples) => Pixels::U16(samples.clone()),
    };
    Image { name, width: table_index(columns.len()), height: table_index(rows.len()), pixels, ..image.clone() }
}

/// Removes images that no material uses any more.
fn remove_unused(materials: &mut [Material], images: &mut Vec<Image>) {
    let maps = |m: &Material| [m.maps.color, m.maps.normal, m.maps.roughness, m.maps.height];
    let used: BTreeSet<u32> = materials.iter().flat_map(maps).flatten().collect();
    if used.len() == images.len() {
        return;
    }
    let place: BTreeMap<u32, u32> = used.iter().enumerate().map(|(to, from)| (*from, table_index(to))).collect();
    let mut number = 0_u32;
    images.retain(|_| {
        number += 1;
        used.contains(&(number - 1))
    });
    for material in materials {
        let Maps { color, normal, roughness, height } = &mut material.maps;
        for slot in [color, normal, roughness, height] {
            *slot = slot.and_then(|old| place.get(&old).copied());
        }
    }
}

fn greatest_common_divisor(a: i64, b: i64) -> i64 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[allow(clippy::cast_possible_truncation, reason = "at most FARTHEST times the side of an image")]
fn whole(x: f64) -> i64 {
    x.floor() as i64
}

#[allow(clippy::cast_precision_loss, reason = "texels, far below 2^53")]
fn as_float(n: i64) -> f64 {
    n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_show_what_the_wrap_modes_show() {
        // Mirrored: the image and its mirror image.
        let mirrored = Span::of(&[(Wrap::Mirror, 3)], [-0.5, 2.5]).expect("near");
        assert_eq!(mirrored.sources(3, Wrap::Mirror), [0, 1, 2, 2, 1, 0]);
        // Held: from -0.5 to 1.2 of four texels are those from -2 to 4, and one more on each side.
        let held = Span::of(&[(Wrap::Clamp, 4)], [-0.5, 1.2]).expect("near");
        assert_eq!(held.sources(4, Wrap::Clamp), [0, 0, 0, 0, 1, 2, 3, 3, 3]);
        // The middle of texel 2 of 4 is the middle of texel 5 of 9.
        assert!((held.map(2.5 / 4.0) - 5.5 / 9.0).abs() < 1e-12);
        // A map that repeats beside one that is held covers the same span.
        let both = Span::of(&[(Wrap::Clamp, 4), (Wrap::Repeat, 2)], [0.0, 2.0]).expect("near");
        assert_eq!(both, Span { start: -1, count: 7, grid: 2 });
        assert_eq!(both.sources(2, Wrap::Repeat), [1, 0, 1, 0, 1, 0, 1]);
        assert_eq!(Span::of(&[(Wrap::Clamp, 4)], [0.0, 1.0]), Some(Span::WHOLE));
        assert_eq!(Span::of(&[(Wrap::Repeat, 4)], [-7.0, 9.0]), Some(Span::WHOLE));
        assert_eq!(Span::of(&[(Wrap::Clamp, 4)], [0.0, 1e9]), None);
    }
}
