//! Map sequences as files store them: checked, scaled to 0..1, and encoded again only when they change.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::Warning;
use osier_base::{Error, Result};
use osier_scene::{MapEncoding, MapFrame, MapLayer, MapSequence};

struct StoredSample {
    /// Number that the file holds, 0 to 1, before it is quantized.
    value: f32,
    /// Whether the value was above the range.
    cut: bool,
}

/// The stored number of the value `v`; `None` if the encoding does not admit `v`. `range`: height that is stored as 1, m.
fn stored(encoding: MapEncoding, v: f32, range: f32) -> Option<StoredSample> {
    let cut = |x: f32| StoredSample { value: x.clamp(0.0, 1.0), cut: x > 1.0 };
    let whole = |value: f32| StoredSample { value, cut: false };
    match encoding {
        _ if !v.is_finite() => None,
        // Heights count from the surface upwards: negative ones become 0 without a warning.
        MapEncoding::Height => Some(cut(v / range)),
        MapEncoding::Thickness => (v >= 0.0).then(|| cut(v / range)),
        MapEncoding::Unit => (0.0..=1.0).contains(&v).then(|| whole(v)),
        // A hundredth covers the rounding of normals that are sums of single-precision numbers.
        MapEncoding::Normal => (v.abs() <= 1.01).then(|| whole((0.5 * v + 0.5).clamp(0.0, 1.0))),
    }
}

/// A map's numbers, all of 0..1, rows from the top.
#[derive(Debug, Clone, Default)]
pub struct Values {
    /// Texel after texel, the channels of a texel together.
    pub samples: Vec<f32>,
    /// Number of samples above the range, which were clamped to 1.
    pub cut: usize,
}

/// The stored numbers of a layer of a sequence. `number`: frame number, for messages.
/// # Errors
/// X012 for a wrong number of texels; X001 for a number that the layer's encoding does not admit, with its place.
pub fn values(sequence: &MapSequence, layer: usize, maps: &MapFrame, number: u32) -> Result<Values> {
    let MapLayer { name, encoding, .. } = sequence.layers[layer];
    let place = || format!("map sequence {}, {name}, frame {number}", sequence.name);
    let raw = maps.layers.get(layer).map_or(&[][..], |l| l.as_flat());
    // Texels of the square times channels: numbers lie texel after texel, the channels of a texel together.
    let wanted = sequence.texels().saturating_mul(encoding.channels());
    if raw.len() != wanted {
        return Err(Error::export("X012", format!("{}: {} values where {wanted} are due", place(), raw.len())));
    }
    let mut out = Values { samples: Vec::with_capacity(raw.len()), cut: 0 };
    for (i, v) in raw.iter().enumerate() {
        let Some(sample) = stored(encoding, *v, sequence.height_range) else {
            // Texel of the number, then its column and row from the top, for the message.
            let texel = i / encoding.channels();
            let (column, row) = (texel % sequence.side.max(1), texel / sequence.side.max(1));
            return Err(Error::export("X001", format!("{}: texel {column}, {row} is {v}", place())));
        };
        out.samples.push(sample.value);
        out.cut += usize::from(sample.cut);
    }
    Ok(out)
}

/// An encoded map, and the number of its values that were clamped.
#[derive(Debug)]
struct Made<T> {
    file: Arc<T>,
    cut: usize,
}

/// Files of the maps of all sequences, encoded anew only where their maps changed.
#[derive(Debug)]
pub struct MapEncoder<T> {
    /// Layers of a sequence that are written, in order.
    select: fn(&MapSequence) -> Vec<usize>,
    /// Maps of each sequence at the last frame; a map equal to its predecessor is not encoded again.
    last: Vec<Option<MapFrame>>,
    /// The latest file of each map, reused while the map stays the same.
    made: BTreeMap<LayerIndex, Made<T>>,
    /// Number of values that were clamped so far.
    cut: u64,
    /// Map sequence and frame of the first clamped value.
    first: Option<(String, u32)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct LayerIndex {
    sequence: usize,
    layer: usize,
}

/// The encoded file of one layer of a map sequence at a frame.
#[derive(Debug)]
pub struct EncodedMap<T> {
    /// Index in the list of sequences that [`MapEncoder::frame`] got.
    pub sequence: usize,
    /// Name, kind of file and encoding of the layer.
    pub layer: MapLayer,
    /// Result of the `encode` of [`MapEncoder::frame`], at this frame or at an earlier one.
    pub file: Arc<T>,
    /// True if the map was encoded at this frame; false if it has not changed since an earlier one.
    pub fresh: bool,
}

impl<T: Send + Sync> MapEncoder<T> {
    /// An encoder before the first frame; `select`: indices of the layers of a sequence that are wanted.
    pub fn new(select: fn(&MapSequence) -> Vec<usize>) -> Self {
        Self { select, last: Vec::new(), made: BTreeMap::new(), cut: 0, first: None }
    }

    /// Returns the files of frame `number` in the order of sequences and layers; changed maps are encoded in parallel. `now`: the
    /// maps of each sequence, `None` for one without maps at this frame; `encode`: makes the file of a layer.
    /// # Errors
    /// As [`values`] and `encode`.
    pub fn frame(
        &mut self,
        sequences: &[MapSequence],
        number: u32,
        now: Vec<Option<MapFrame>>,
        encode: impl Fn(&MapSequence, MapLayer, &Values) -> Result<T> + Sync + Send,
    ) -> Result<Vec<EncodedMap<T>>> {
        // A new sequence has no last map, so its maps are encoded in any case.
        self.last.resize(sequences.len(), None);
        let layers = |(i, s): (usize, &MapSequence)| {
            (self.select)(s).into_iter().map(move |layer| LayerIndex { sequence: i, layer }).collect::<Vec<_>>()
        };
        // Jobs are in the order of sequences and layers; the results are in the same order whatever thread made them.
        let jobs: Vec<LayerIndex> = sequences.iter().enumerate().flat_map(layers).collect();
        let done = osier_base::par::par_map(&jobs, |&at| -> Result<Option<Made<T>>> {
            // Skip maps that are absent at this frame or equal to those of the last frame.
            let Some(maps) = now[at.sequence].as_ref().filter(|maps| !self.is_kept(at, maps)) else { return Ok(None) };
            let sequence = &sequences[at.sequence];
            let values = values(sequence, at.layer, maps, number)?;
            let file = Arc::new(encode(sequence, sequence.layers[at.layer], &values)?);
            Ok(Some(Made { file, cut: values.cut }))
        });
        // Layers that changed were encoded in parallel; the others keep the file of an earlier frame.
        let mut out = Vec::with_capacity(jobs.len());
        for (at, made) in jobs.into_iter().zip(done) {
            let made = made?;
            let fresh = made.is_some();
            if let Some(made) = made {
                self.made.insert(at, made);
            }
            let Some(kept) = self.made.get(&at) else { continue };
            let sequence = &sequences[at.sequence];
            if kept.cut > 0 {
                // Count at every frame that uses the map, even if its file is from an earlier frame.
                self.cut += kept.cut as u64;
                self.first.get_or_insert_with(|| (sequence.name.clone(), number));
            }
            let layer = sequence.layers[at.layer];
            out.push(EncodedMap { sequence: at.sequence, layer, file: Arc::clone(&kept.file), fresh });
        }
        self.last = now;
        Ok(out)
    }

    /// Whether the latest file of a layer still holds its map.
    fn is_kept(&self, at: LayerIndex, now: &MapFrame) -> bool {
        let Some(last) = self.last[at.sequence].as_ref().filter(|_| self.made.contains_key(&at)) else { return false };
        let both = last.layers.get(at.layer).zip(now.layers.get(at.layer));
        // The shared pointer decides in constant time; only maps in different memory are compared number by number.
        both.is_some_and(|(a, b)| a.is_shared_with(b) || a == b)
    }

    /// X007 if any value was clamped. `ending`: of the files.
    pub fn warning(&self, sequences: &[MapSequence], ending: &str) -> Option<Warning> {
        let (name, number) = self.first.as_ref()?;
        let range = sequences.iter().find(|s| s.name == *name).map_or(0.0, |s| s.height_range);
        let message = format!(
            "{} texels of height maps ({ending}) lie above {} mm and are cut there, first in map sequence {name}, frame {number}; \
             raise maps.height_range_m",
            self.cut,
            range * 1000.0
        );
        Some(Warning { code: "X007", message })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::MapTexels;

    /// Maps of two by two texels: height, water alone, a weight and normals.
    struct Texels {
        height: Vec<f32>,
        water: Vec<f32>,
        wetness: Vec<f32>,
        normal: Vec<[f32; 3]>,
    }

    impl Texels {
        fn frame(self) -> MapFrame {
            let scalar = |v| MapTexels::Scalar(Arc::new(v));
            let normal = MapTexels::Vector(Arc::new(self.normal));
            MapFrame { layers: vec![scalar(self.height), scalar(self.water), scalar(self.wetness), normal] }
        }
    }

    /// Indices of the layers.
    const HEIGHT: usize = 0;
    const WATER: usize = 1;
    const WETNESS: usize = 2;
    const NORMAL: usize = 3;

    fn sequence() -> MapSequence {
        let layer = |name, encoding| MapLayer { name, file_kind: "exr", encoding };
        let layers = vec![
            layer("height", MapEncoding::Height),
            layer("water", MapEncoding::Thickness),
            layer("wetness", MapEncoding::Unit),
            layer("normal", MapEncoding::Normal),
        ];
        MapSequence { name: "a".into(), side: 2, height_range: 0.002, layers, rest: None }
    }

    fn maps(height: f32) -> Texels {
        Texels {
            height: vec![0.0, height, 0.001, -1e-4],
            water: vec![0.0, 0.0005, 0.002, 0.0],
            wetness: vec![0.0, 0.25, 1.0, 0.5],
            normal: vec![[0.0, 0.6, 0.8]; 4],
        }
    }

    #[test]
    fn numbers_are_brought_to_0_to_1_and_what_is_cut_is_counted() {
        let at = |layer, maps: Texels| values(&sequence(), layer, &maps.frame(), 3).expect("good");
        let height = at(HEIGHT, maps(0.003));
        assert_eq!((height.samples, height.cut), (vec![0.0, 1.0, 0.5, 0.0], 1));
        assert_eq!(at(WATER, maps(0.0)).samples, [0.0, 0.25, 1.0, 0.0]);
        assert_eq!(at(NORMAL, maps(0.0)).samples[..3], [0.5, 0.8, 0.9]);
    }

    #[test]
    fn invalid_maps_are_errors() {
        let bad = |f: &dyn Fn(&mut Texels), layer| {
            let mut m = maps(0.0);
            f(&mut m);
            values(&sequence(), layer, &m.frame(), 3).expect_err("refused").to_string()
        };
        assert_eq!(bad(&|m| m.wetness[3] = 1.1, WETNESS), "X001: map sequence a, wetness, frame 3: texel 1, 1 is 1.1");
        assert!(bad(&|m| m.wetness[0] = -1e-6, WETNESS).starts_with("X001"));
        assert!(bad(&|m| m.water[2] = -1e-6, WATER).contains("texel 0, 1"));
        assert!(bad(&|m| m.height[2] = f32::NAN, HEIGHT).starts_with("X001"));
        assert!(bad(&|m| m.normal[1][2] = f32::INFINITY, NORMAL).contains("texel 1, 0"));
        assert!(bad(&|m| m.height.truncate(3), HEIGHT).starts_with("X012"));
    }

    #[test]
    fn only_what_changed_is_made_anew() {
        let mut wetter = maps(0.003);
        wetter.wetness[0] = 0.5;
        let frames = [(1, maps(0.003).frame()), (2, maps(0.003).frame()), (3, wetter.frame())];
        let mut encoder = MapEncoder::new(|_| vec![HEIGHT, WETNESS]);
        let mut fresh = |(number, maps): &(u32, MapFrame)| -> Vec<bool> {
            let now = vec![Some(maps.clone())];
            let kept = encoder.frame(&[sequence()], *number, now, |_, layer, v| Ok((layer, v.samples.clone())));
            kept.expect("good").iter().map(|k| k.fresh).collect()
        };
        assert_eq!(frames.each_ref().map(&mut fresh), [vec![true; 2], vec![false; 2], vec![false, true]]);
        let warning = encoder.warning(&[sequence()], "exr").expect("cut in every frame");
        assert!(warning.message.starts_with("3 texels") && warning.message.contains("frame 1"), "{}", warning.message);
    }
}
