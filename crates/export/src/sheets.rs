//! Maps of wet sheets as files hold them: judged, brought to 0..1, made once for as long as they stay the same.

use std::sync::Arc;

use super::Warning;
use osier_base::{Error, Result};
use osier_scene::{Wet, WetMaps};

/// One map of a sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Map {
    /// Relief and water on it, over the sheet's range of heights.
    Height,
    /// Water alone, over the same range.
    Water,
    /// How wet.
    Wetness,
    /// Normals in tangent space, 0.5 n + 0.5.
    Normal,
}

impl Map {
    /// Its name in files: `maps/<sheet>/<word>.####.exr`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Height => "height",
            Self::Water => "water",
            Self::Wetness => "wetness",
            Self::Normal => "normal",
        }
    }

    /// Numbers of a texel.
    pub fn channels(self) -> usize {
        if self == Self::Normal { 3 } else { 1 }
    }

    fn raw(self, maps: &WetMaps) -> &[f32] {
        match self {
            Self::Height => &maps.height,
            Self::Water => maps.water(),
            Self::Wetness => &maps.wetness,
            Self::Normal => maps.normal.as_flattened(),
        }
    }

    /// A stored number of what is `v`, or none if it must not be; true if it had to be cut.
    fn stored(self, v: f32, range: f32) -> Option<(f32, bool)> {
        let cut = |x: f32| (x.clamp(0.0, 1.0), x > 1.0);
        match self {
            _ if !v.is_finite() => None,
            // Relief may lie below the sheet, which is cut without a word: heights count from the sheet upwards.
            Self::Height => Some(cut(v / range)),
            Self::Water => (v >= 0.0).then(|| cut(v / range)),
            Self::Wetness => (0.0..=1.0).contains(&v).then_some((v, false)),
            // A hundredth is what sums of single precision may be off.
            Self::Normal => (v.abs() <= 1.01).then(|| ((0.5 * v + 0.5).clamp(0.0, 1.0), false)),
        }
    }
}

/// A map's numbers, all of 0..1, rows from the top.
#[derive(Debug, Clone, Default)]
pub struct Values {
    /// Texel after texel.
    pub samples: Vec<f32>,
    /// Numbers above the range, which are cut.
    pub cut: usize,
}

/// The numbers of a map of a sheet. `number`: of the frame, for messages.
/// # Errors
/// X012 for a wrong number of texels; X001 for a number that is not finite, for water below nothing and for wetness outside
/// 0..1, with its place.
pub fn values(map: Map, sheet: &Wet, maps: &WetMaps, number: u32) -> Result<Values> {
    let raw = map.raw(maps);
    let place = || format!("sheet {}, {}, frame {number}", sheet.name, map.word());
    let wanted = sheet.side.saturating_mul(sheet.side).saturating_mul(map.channels());
    if raw.len() != wanted {
        return Err(Error::export("X012", format!("{}: {} values where {wanted} are due", place(), raw.len())));
    }
    let mut out = Values { samples: Vec::with_capacity(raw.len()), cut: 0 };
    for (i, v) in raw.iter().enumerate() {
        let Some((stored, cut)) = map.stored(*v, sheet.height_range) else {
            let texel = i / map.channels();
            let (column, row) = (texel % sheet.side.max(1), texel / sheet.side.max(1));
            return Err(Error::export("X001", format!("{}: texel {column}, {row} is {v}", place())));
        };
        out.samples.push(stored);
        out.cut += usize::from(cut);
    }
    Ok(out)
}

/// What was made of a map.
#[derive(Debug)]
struct Made<T> {
    file: Arc<T>,
    cut: usize,
}

/// What is made of the maps of all sheets, made anew only where they changed.
#[derive(Debug)]
pub struct Keeper<T> {
    maps: Vec<Map>,
    /// Maps of each sheet at the last frame.
    last: Vec<Option<Arc<WetMaps>>>,
    /// Of each sheet, what was made of each of its maps.
    made: Vec<Vec<Option<Made<T>>>>,
    /// Numbers cut so far, and where the first was.
    cut: u64,
    first: Option<(String, u32)>,
}

/// What was made of one map at a frame.
#[derive(Debug)]
pub struct Kept<T> {
    /// Index of the sheet.
    pub sheet: usize,
    /// Which map.
    pub map: Map,
    /// It.
    pub file: Arc<T>,
    /// False if it is the last frame's.
    pub fresh: bool,
}

impl<T: Send + Sync> Keeper<T> {
    /// Nothing made so far; `maps`: those that are wanted.
    pub fn new(maps: Vec<Map>) -> Self {
        Self { maps, last: Vec::new(), made: Vec::new(), cut: 0, first: None }
    }

    /// Everything that belongs to frame `number`, sheet after sheet, in parallel. `now`: the sheets' maps; `make`: a file of
    /// a sheet's map.
    /// # Errors
    /// As [`values`] and `make`.
    pub fn frame(
        &mut self,
        sheets: &[Wet],
        number: u32,
        now: Vec<Option<Arc<WetMaps>>>,
        make: impl Fn(&Wet, Map, &Values) -> Result<T> + Sync + Send,
    ) -> Result<Vec<Kept<T>>> {
        self.last.resize(sheets.len(), None);
        self.made.resize_with(sheets.len(), Vec::new);
        self.made.iter_mut().for_each(|m| m.resize_with(self.maps.len(), || None));
        let jobs: Vec<(usize, usize)> =
            (0..sheets.len()).flat_map(|s| (0..self.maps.len()).map(move |m| (s, m))).collect();
        let done = osier_base::par::par_map(&jobs, |&(s, m)| -> Result<Option<Made<T>>> {
            let Some(maps) = now[s].as_ref().filter(|maps| !self.is_kept(s, m, maps)) else { return Ok(None) };
            let values = values(self.maps[m], &sheets[s], maps, number)?;
            Ok(Some(Made { file: Arc::new(make(&sheets[s], self.maps[m], &values)?), cut: values.cut }))
        });
        let mut out = Vec::with_capacity(jobs.len());
        for (&(s, m), made) in jobs.iter().zip(done) {
            let made = made?;
            let fresh = made.is_some();
            if fresh {
                self.made[s][m] = made;
            }
            let Some(kept) = &self.made[s][m] else { continue };
            if kept.cut > 0 {
                self.cut += kept.cut as u64;
                self.first.get_or_insert_with(|| (sheets[s].name.clone(), number));
            }
            out.push(Kept { sheet: s, map: self.maps[m], file: Arc::clone(&kept.file), fresh });
        }
        self.last = now;
        Ok(out)
    }

    /// True if what was made of a map is still right.
    fn is_kept(&self, sheet: usize, map: usize, now: &Arc<WetMaps>) -> bool {
        let Some(last) = self.last[sheet].as_ref().filter(|_| self.made[sheet][map].is_some()) else { return false };
        Arc::ptr_eq(last, now) || self.maps[map].raw(last) == self.maps[map].raw(now)
    }

    /// X007 if anything was cut. `ending`: of the files.
    pub fn warning(&self, sheets: &[Wet], ending: &str) -> Option<Warning> {
        let (name, number) = self.first.as_ref()?;
        let range = sheets.iter().find(|w| w.name == *name).map_or(0.0, |w| w.height_range);
        let message = format!(
            "{} texels of height maps ({ending}) lie above {} mm and are cut there, first in sheet {name}, frame {number}; \
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

    fn sheet() -> Wet {
        Wet { name: "a".into(), side: 2, height_range: 0.002, rest: None }
    }

    fn maps(height: f32) -> WetMaps {
        WetMaps {
            height: vec![0.0, height, 0.001, -1e-4],
            water: vec![0.0, 0.0005, 0.002, 0.0],
            wetness: vec![0.0, 0.25, 1.0, 0.5],
            normal: vec![[0.0, 0.6, 0.8]; 4],
        }
    }

    #[test]
    fn numbers_are_brought_to_0_to_1_and_what_is_cut_is_counted() {
        let at = |map, maps: &WetMaps| values(map, &sheet(), maps, 3).expect("good");
        let height = at(Map::Height, &maps(0.003));
        assert_eq!((height.samples, height.cut), (vec![0.0, 1.0, 0.5, 0.0], 1));
        assert_eq!(at(Map::Water, &maps(0.0)).samples, [0.0, 0.25, 1.0, 0.0]);
        assert_eq!(at(Map::Normal, &maps(0.0)).samples[..3], [0.5, 0.8, 0.9]);
    }

    #[test]
    fn what_no_map_may_hold_is_an_error_with_its_place() {
        let bad = |f: &dyn Fn(&mut WetMaps), map| {
            let mut m = maps(0.0);
            f(&mut m);
            values(map, &sheet(), &m, 3).expect_err("refused").to_string()
        };
        assert_eq!(bad(&|m| m.wetness[3] = 1.1, Map::Wetness), "X001: sheet a, wetness, frame 3: texel 1, 1 is 1.1");
        assert!(bad(&|m| m.wetness[0] = -1e-6, Map::Wetness).starts_with("X001"));
        assert!(bad(&|m| m.water[2] = -1e-6, Map::Water).contains("texel 0, 1"));
        assert!(bad(&|m| m.height[2] = f32::NAN, Map::Height).starts_with("X001"));
        assert!(bad(&|m| m.normal[1][2] = f32::INFINITY, Map::Normal).contains("texel 1, 0"));
        assert!(bad(&|m| m.height.truncate(3), Map::Height).starts_with("X012"));
    }

    #[test]
    fn only_what_changed_is_made_anew() {
        let mut wetter = maps(0.003);
        wetter.wetness[0] = 0.5;
        let frames = [(1, maps(0.003)), (2, maps(0.003)), (3, wetter)];
        let mut keeper = Keeper::new(vec![Map::Height, Map::Wetness]);
        let mut fresh = |(number, maps): &(u32, WetMaps)| -> Vec<bool> {
            let now = vec![Some(Arc::new(maps.clone()))];
            let kept = keeper.frame(&[sheet()], *number, now, |_, map, v| Ok((map, v.samples.clone())));
            kept.expect("good").iter().map(|k| k.fresh).collect()
        };
        assert_eq!(frames.each_ref().map(&mut fresh), [vec![true; 2], vec![false; 2], vec![false, true]]);
        let warning = keeper.warning(&[sheet()], "exr").expect("cut in every frame");
        assert!(warning.message.starts_with("3 texels") && warning.message.contains("frame 1"), "{}", warning.message);
    }
}
