//! Maps of water on a leaf: height, wetness and normals over its texture, with only the tiles done again that changed.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use crate::rain::drops::rain_leaf::WetSpot;
use crate::rain::drops::shape::{Footprint, SphericalCap};
use crate::rain::leaf::surface::{LeafSurface, SurfacePoint};
use crate::rain::params::DropParams;
use osier_base::math::{self, narrow};
use osier_scene::WetMaps;

mod dirty;
mod rows;
mod uv_raster;

use dirty::{ColumnSpan, DirtySpans, DirtyTiles, RowSpans};
use rows::{CapKernel, DryingPass, KernelOrigin, MaxPass, NormalInputs, NormalPass, WetSpotKernel};
use uv_raster::TexelWindow;
pub use uv_raster::UvRaster;

/// Texels of a tile's side.
const TILE: usize = 16;
/// Wetness that counts as none.
const DRY: f32 = 1.0 / 1024.0;
/// How far water wets beyond its base, in base radii.
const SOAKS: f64 = 1.15;
/// Where there is no slope.
const FLAT: [f32; 3] = [0.0, 0.0, 1.0];

/// One cap on a leaf, as the maps see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapOnLeaf {
    /// Where.
    pub uv: DVec2,
    /// Its shape.
    pub cap: SphericalCap,
    /// Its footprint.
    pub print: Footprint,
    /// Long axis of the footprint, unit, of leaf space.
    pub axis: DVec3,
}

/// A cap on the texels that it covers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct CapStamp {
    /// Tells it from all others.
    key: [u64; 11],
    dome: CapKernel,
    window: TexelWindow,
}

/// Texels worked on, each as often as it was.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TexelCounters {
    /// By caps of water.
    pub poured: u64,
    /// By normals.
    pub turned: u64,
    /// By places that became wet.
    pub soaked: u64,
    /// By drying.
    pub dried: u64,
}

impl TexelCounters {
    /// All of it.
    pub fn sum(&self) -> u64 {
        self.poured + self.turned + self.soaked + self.dried
    }
}

/// The maps of one leaf through a clip.
#[derive(Debug, Clone)]
pub struct LeafWaterMaps {
    chart: Arc<UvRaster>,
    /// All of its texels.
    whole: RowSpans,
    scale: f32,
    /// Halvings of wetness up to the last time, and by what factor the maps are behind them: factors are rounded.
    age: f64,
    behind: f64,
    /// In the order of their keys.
    stamps: Vec<CapStamp>,
    maps: Arc<WetMaps>,
    /// Tiles whose wetness is above [`DRY`].
    damp: Vec<bool>,
    touched: TexelCounters,
}

impl LeafWaterMaps {
    /// A dry leaf, `scale` times as large as its blade.
    pub fn new(chart: Arc<UvRaster>, scale: f64) -> Self {
        let n = chart.side * chart.side;
        let tiles = chart.side.div_ceil(TILE);
        let maps = WetMaps { height: vec![0.0; n], water: Vec::new(), wetness: vec![0.0; n], normal: vec![FLAT; n] };
        Self {
            whole: RowSpans::all(chart.side),
            chart,
            scale: narrow(scale),
            age: 0.0,
            behind: 1.0,
            stamps: Vec::new(),
            maps: Arc::new(maps),
            damp: vec![false; tiles * tiles],
            touched: TexelCounters::default(),
        }
    }

    /// The maps as they are.
    pub fn maps(&self) -> &Arc<WetMaps> {
        &self.maps
    }

    /// Texels worked on so far.
    pub fn touched(&self) -> TexelCounters {
        self.touched
    }

    /// Goes on to time `t`, s: water as `blobs` say, wet where `soaks` were. Only texels under what changed are done again.
    pub fn advance(
        &mut self,
        sheet: &LeafSurface,
        blobs: &[CapOnLeaf],
        soaks: &[WetSpot],
        t: f64,
        params: &DropParams,
    ) {
        let stamps = self.stamps(sheet, blobs);
        let changed = self.changed(&stamps);
        self.stamps = stamps;
        let left = self.left(t, params);
        if soaks.is_empty() && !changed.any() && !self.damp.contains(&true) {
            return;
        }
        let patches = self.patches(sheet, soaks, t, params);
        self.work(&changed, &patches, left);
    }

    /// The same from nothing: every texel, every blob. What [`LeafWaterMaps::advance`] must equal, bit for bit.
    pub fn all_over(
        &mut self,
        sheet: &LeafSurface,
        blobs: &[CapOnLeaf],
        soaks: &[WetSpot],
        t: f64,
        params: &DropParams,
    ) {
        let whole = TexelWindow::whole(self.chart.side);
        self.stamps = self.stamps(sheet, blobs);
        self.stamps.iter_mut().for_each(|s| s.window = whole);
        let left = self.left(t, params);
        let mut patches = self.patches(sheet, soaks, t, params);
        patches.iter_mut().for_each(|(_, window)| *window = whole);
        self.damp.fill(true);
        self.work(&DirtySpans::all(self.chart.side), &patches, left);
    }

    /// What changed, and patches, a band of tiles after the other: what a band needs stays in the processor's cache from its
    /// caps to its wet places. Normals wait for the caps of the band below.
    fn work(&mut self, changed: &DirtySpans, patches: &[(WetSpotKernel, TexelWindow)], left: f32) {
        let mut maps = std::mem::take(&mut self.maps);
        let own = Arc::make_mut(&mut maps);
        let tiles = self.chart.side.div_ceil(TILE);
        for band in 0..tiles {
            self.pour(own, changed, band);
            if let Some(above) = band.checked_sub(1) {
                self.turn(own, changed, above);
            }
            self.dry(own, left, band);
            self.soak(own, patches, band);
        }
        self.turn(own, changed, tiles - 1);
        for (_, window) in patches {
            each_tile(window, tiles, |k| self.damp[k] = true);
        }
        self.maps = maps;
    }

    /// Share of wetness that is left at time `t`, s, of that at the last time.
    fn left(&mut self, t: f64, params: &DropParams) -> f32 {
        let age = halvings(t, params);
        let meant = math::pow(2.0, self.age - age) * self.behind;
        let left = narrow(meant);
        self.behind = if left > 0.0 { meant / f64::from(left) } else { 1.0 };
        self.age = age;
        left
    }

    /// Caps in the order of their keys, so that two frames' are compared in one go.
    fn stamps(&self, sheet: &LeafSurface, blobs: &[CapOnLeaf]) -> Vec<CapStamp> {
        let mut stamps: Vec<CapStamp> = blobs.iter().filter_map(|b| self.stamp(sheet, b)).collect();
        stamps.sort_unstable_by_key(|s| s.key);
        stamps
    }

    fn stamp(&self, sheet: &LeafSurface, blob: &CapOnLeaf) -> Option<CapStamp> {
        let spot = sheet.at(blob.uv, f64::from(self.scale))?;
        let (SphericalCap { r, a, omega, c }, Footprint { q, skew }) = (blob.cap, blob.print);
        let axis = (blob.axis - spot.n * blob.axis.dot(spot.n)).normalize_or(spot.n.any_orthonormal_vector());
        let [x, y, z] = blob.axis.to_array();
        Some(CapStamp {
            key: [blob.uv.x, blob.uv.y, r, a, omega, c, q, skew, x, y, z].map(f64::to_bits),
            dome: CapKernel::new(&blob.cap, &blob.print, self.stand(&spot), axis.as_vec3()),
            window: self.chart.footprint(blob.uv, &spot, blob.cap.reach(), q, axis),
        })
    }

    fn stand(&self, spot: &SurfacePoint) -> KernelOrigin {
        KernelOrigin { p: spot.p.as_vec3().to_array(), n: spot.n.as_vec3().to_array(), scale: self.scale }
    }

    /// Texels under what was there before or is there now and is not the same.
    fn changed(&self, stamps: &[CapStamp]) -> DirtySpans {
        let mut marks = DirtyTiles::none(self.chart.side);
        let mut mark = |s: &CapStamp| marks.add(&s.window);
        let (mut old, mut new) = (self.stamps.iter().peekable(), stamps.iter().peekable());
        loop {
            match (old.peek(), new.peek()) {
                (Some(a), Some(b)) if a.key == b.key => {
                    old.next();
                    new.next();
                }
                (Some(a), b) if b.is_none_or(|b| a.key < b.key) => {
                    mark(a);
                    old.next();
                }
                (_, Some(b)) => {
                    mark(b);
                    new.next();
                }
                _ => break,
            }
        }
        DirtySpans::new(&marks)
    }

    /// Rows of a band of tiles.
    fn rows(&self, band: usize) -> std::ops::Range<usize> {
        band * TILE..((band + 1) * TILE).min(self.chart.side)
    }

    /// Clears and fills what changed in a band.
    fn pour(&mut self, maps: &mut WetMaps, changed: &DirtySpans, band: usize) {
        let arch = rows::arch();
        let (n, rows) = (self.chart.side, self.rows(band));
        let runs = &changed.poured;
        for (y, run) in rows.clone().flat_map(|y| runs.of(y).iter().map(move |r| (y, r))) {
            maps.height[y * n + run.0..y * n + run.1].fill(0.0);
        }
        for stamp in self.stamps.iter().filter(|s| s.window.meets(&rows)) {
            let (stamp, window, made) = (&stamp.dome, &stamp.window, maps.height.as_mut_slice());
            let pressed = MaxPass { stamp, window, chart: &self.chart, rows: &rows, runs, made };
            self.touched.poured += arch.dispatch(pressed);
        }
    }

    /// Makes normals of a band's texels that changed, and of those around them.
    fn turn(&mut self, maps: &mut WetMaps, changed: &DirtySpans, band: usize) {
        for y in self.rows(band) {
            changed.turned.of(y).iter().for_each(|run| self.bend(maps, y, *run));
        }
    }

    /// Makes the normals of a part of a row.
    fn bend(&mut self, maps: &mut WetMaps, y: usize, ColumnSpan(x0, x1): ColumnSpan) {
        let n = self.chart.side;
        self.touched.turned += (x1 - x0) as u64;
        let (up, down) = (y.saturating_sub(1), (y + 1).min(n - 1));
        let per = [n as f32 * 0.5, n as f32 / (down - up).max(1) as f32].map(|k| k / self.scale);
        let WetMaps { height, normal, .. } = maps;
        let (inner, outer) = (x0.max(1), x1.min(n - 1));
        let texels = y * n + inner..y * n + outer;
        let around = NormalInputs {
            own: &height[texels.start - 1..texels.end + 1],
            above: &height[up * n + inner..up * n + outer],
            below: &height[down * n + inner..down * n + outer],
            slopes: [0, 1, 2].map(|k| &self.chart.slopes[k][texels.clone()]),
            per,
        };
        rows::arch().dispatch(NormalPass(&around, &mut normal[texels]));
        // Ends of a row have a neighbour on one side only.
        for x in [0, n - 1].into_iter().filter(|x| (x0..x1).contains(x) && !(inner..outer).contains(x)) {
            let (left, right) = (x.saturating_sub(1), (x + 1).min(n - 1));
            let per_u = n as f32 / (right - left).max(1) as f32 / self.scale;
            let du = (height[y * n + right] - height[y * n + left]) * per_u;
            let dv = (height[up * n + x] - height[down * n + x]) * per[1];
            normal[y * n + x] = rows::normal([du, dv], [0, 1, 2].map(|k| self.chart.slopes[k][y * n + x]));
        }
    }

    /// Places that were under water, on the texels that they reach. Source: [yang-wu] eq. 11.
    fn patches(
        &self,
        sheet: &LeafSurface,
        soaks: &[WetSpot],
        t: f64,
        params: &DropParams,
    ) -> Vec<(WetSpotKernel, TexelWindow)> {
        let n = self.chart.side as f64;
        // Drops of the past may be told late, and count for less. Most are told at the same few times.
        let now = halvings(t, params);
        let mut known: Option<(f64, f32)> = None;
        let mut peak = |t: f64| match known {
            Some((told, peak)) if told.to_bits() == t.to_bits() => peak,
            _ => known.insert((t, narrow(math::pow(2.0, (halvings(t, params) - now).min(0.0))))).1,
        };
        let patch = |soak: &WetSpot| {
            let spot = sheet.at(soak.uv, f64::from(self.scale))?;
            let texel = spot.ju.length().min(spot.jv.length()) / n;
            let reach = SOAKS * soak.a;
            let patch = WetSpotKernel {
                stand: self.stand(&spot),
                reach: narrow(reach),
                edge: narrow(1.0 / texel),
                fall: narrow(-1.0 / params.wet_length),
                peak: peak(soak.t),
            };
            Some((patch, self.chart.window(soak.uv, &spot, reach + texel)))
        };
        soaks.iter().filter_map(patch).collect()
    }

    /// Makes places of a band wet.
    fn soak(&mut self, maps: &mut WetMaps, patches: &[(WetSpotKernel, TexelWindow)], band: usize) {
        let arch = rows::arch();
        let rows = self.rows(band);
        let runs = &self.whole;
        for (stamp, window) in patches.iter().filter(|(_, w)| w.meets(&rows)) {
            let made = maps.wetness.as_mut_slice();
            let pressed = MaxPass { stamp, window, chart: &self.chart, rows: &rows, runs, made };
            self.touched.soaked += arch.dispatch(pressed);
        }
    }

    /// Dries a band; tiles that have dried up are left alone from then on. `left`: share of what was.
    fn dry(&mut self, maps: &mut WetMaps, left: f32, band: usize) {
        let arch = rows::arch();
        let (n, rows) = (self.chart.side, self.rows(band));
        let tiles = n.div_ceil(TILE);
        let damp = &mut self.damp[band * tiles..(band + 1) * tiles];
        let runs: Vec<ColumnSpan> = runs(damp, n).collect();
        for ColumnSpan(from, to) in runs {
            let mut any = false;
            for y in rows.clone() {
                let wetness = &mut maps.wetness[y * n + from..y * n + to];
                any |= arch.dispatch(DryingPass { left, wetness });
                self.touched.dried += (to - from) as u64;
            }
            if !any {
                damp[from / TILE..to.div_ceil(TILE)].fill(false);
            }
        }
    }
}

/// How often wetness has halved at time `t`, s. Source: zeta^(t / half life) = 2^-halvings.
fn halvings(t: f64, params: &DropParams) -> f64 {
    -t / params.half_life * (math::ln(params.zeta) / std::f64::consts::LN_2)
}

/// Runs of tiles that are damp, as columns of texels.
fn runs(marked: &[bool], n: usize) -> impl Iterator<Item = ColumnSpan> + '_ {
    let mut k = 0;
    std::iter::from_fn(move || {
        let from = k + marked[k..].iter().position(|m| *m)?;
        k = marked[from..].iter().position(|m| !*m).map_or(marked.len(), |l| from + l);
        Some(ColumnSpan(from * TILE, (k * TILE).min(n)))
    })
}

fn each_tile(w: &TexelWindow, tiles: usize, mut f: impl FnMut(usize)) {
    if w.lo[0] >= w.hi[0] || w.lo[1] >= w.hi[1] {
        return;
    }
    for y in w.lo[1] / TILE..=(w.hi[1] - 1) / TILE {
        let (from, to) = w.span(y * TILE..(y + 1) * TILE);
        if from < to {
            (from / TILE..=(to - 1) / TILE).for_each(|x| f(y * tiles + x));
        }
    }
}

#[cfg(test)]
mod tests;
