//! Water maps of a leaf: height of relief and water, height of water, wetness and normals over its chart. Each frame recomputes
//! only the texels under changes.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use crate::rain::drops::rain_leaf::WetSpot;
use crate::rain::drops::spherical_cap::{CapDeformation, SphericalCap};
use crate::rain::leaf::surface::{LeafSurface, SurfacePoint};
use crate::rain::params::DropParams;
use crate::rain::tuning::WET_RADIUS_FACTOR;
use osier_base::math::{self, narrow};

mod dirty_spans;
mod kernels;
mod texel_window;
mod uv_raster;

use dirty_spans::{DirtyBits, DirtySpans, RowSpans};
use kernels::{CapHeightKernel, CenterOnLeaf, DryingPass, MaxBlendPass, NormalInputs, NormalPass, WetPathKernel};
use texel_window::{ColumnSpan, TexelWindow};
pub use uv_raster::UvRaster;

/// Texels along the side of a tile, which is also the height of a band of rows and the length of a segment of a row.
const TILE: usize = 16;
/// Normal of a dry surface in tangent space.
const DRY_NORMAL: [f32; 3] = [0.0, 0.0, 1.0];

/// A cap of a drop on a leaf, as the maps draw it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapOnLeaf {
    /// Texture coordinates of its center.
    pub uv: DVec2,
    /// Shape without stretch and skew.
    pub cap: SphericalCap,
    /// Stretch and skew; [`CapDeformation::ROUND`] for the caps of a tail.
    pub deformation: CapDeformation,
    /// Unit tangent along which it is stretched and sheared, in leaf space.
    pub axis: DVec3,
}

/// A cap and the texels that it may cover.
#[derive(Debug, Clone, Copy, PartialEq)]
struct CapStamp {
    /// Bits of all values that its texels depend on: equal keys give equal texels.
    key: [u64; 12],
    kernel: CapHeightKernel,
    window: TexelWindow,
}

/// A wet spot and the texels that it may cover.
#[derive(Debug, Clone, Copy, PartialEq)]
struct WetSpotStamp {
    kernel: WetPathKernel,
    window: TexelWindow,
}

/// Number of texel updates by their cause; a texel counts as often as it is updated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TexelCounters {
    /// Updates of heights: one for each cap over a texel.
    pub heights: u64,
    /// Updates of normals: at most one per texel and frame.
    pub normals: u64,
    /// Updates of wetness by wet spots: one for each spot over a texel.
    pub wet_spots: u64,
    /// Updates of wetness by drying.
    pub drying: u64,
}

impl TexelCounters {
    /// Sum over all causes, a measure of the cost of the maps.
    pub fn total_updates(&self) -> u64 {
        self.heights + self.normals + self.wet_spots + self.drying
    }
}

/// Maps of one leaf: `side * side` texels, row 0 at v = 1. A clone shares the memory until the maps are updated.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LeafMaps {
    /// Height of the leaf's relief and the water on it, m; the memory of `water` for a leaf without relief.
    pub height: Arc<Vec<f32>>,
    /// Height of the water over the relief, m.
    pub water: Arc<Vec<f32>>,
    /// Share of the leaf that is wet, 0 to 1.
    pub wetness: Arc<Vec<f32>>,
    /// Unit normals in tangent space of the relief and the water on it: along u, along v, out.
    pub normal: Arc<Vec<[f32; 3]>>,
}

/// The maps of one leaf while a frame updates them.
struct LeafMapsMut<'a> {
    /// `None` for a leaf without relief, whose height map is its water map.
    height: Option<&'a mut Vec<f32>>,
    water: &'a mut Vec<f32>,
    wetness: &'a mut Vec<f32>,
    normal: &'a mut Vec<[f32; 3]>,
}

/// Water maps of one leaf, kept from frame to frame of a clip, so that a frame recomputes only texels that change.
#[derive(Debug, Clone)]
pub struct LeafWaterMaps {
    raster: Arc<UvRaster>,
    /// One span for each row over all of its texels.
    full: RowSpans,
    scale: f32,
    /// Number of half-lives of wetness that have passed up to the last frame.
    elapsed_half_lives: f64,
    /// Ratio of the exact decay up to the last frame to that of the maps, whose factors are rounded.
    decay_residual: f64,
    /// Caps of the last frame in the order of their keys.
    stamps: Vec<CapStamp>,
    maps: LeafMaps,
    /// Tiles, row by row, that may hold wetness above [`MIN_WETNESS`](crate::rain::tuning::MIN_WETNESS) and have to dry.
    damp: Vec<bool>,
    counters: TexelCounters,
}

struct FrameUpdate {
    dirty: DirtySpans,
    wet_spots: Vec<WetSpotStamp>,
    /// Fraction of the wetness of the last frame that is left.
    decay: f32,
}

impl LeafWaterMaps {
    /// Maps of a dry leaf. `scale`: factor on the size of its blade.
    pub fn new(raster: Arc<UvRaster>, scale: f64) -> Self {
        let n = raster.side * raster.side;
        let tiles = raster.side.div_ceil(TILE);
        let water = Arc::new(vec![0.0; n]);
        let maps = LeafMaps {
            height: if raster.relief.is_some() { Arc::new(vec![0.0; n]) } else { Arc::clone(&water) },
            water,
            wetness: Arc::new(vec![0.0; n]),
            normal: Arc::new(vec![DRY_NORMAL; n]),
        };
        let mut dry = Self {
            full: RowSpans::full(raster.side),
            raster,
            scale: narrow(scale),
            elapsed_half_lives: 0.0,
            decay_residual: 1.0,
            stamps: Vec::new(),
            maps,
            damp: vec![false; tiles * tiles],
            counters: TexelCounters::default(),
        };
        if dry.raster.relief.is_some() {
            // A leaf with relief has heights and normals also while it is dry: compute them once.
            dry.update(&FrameUpdate { dirty: DirtySpans::full(dry.raster.side), wet_spots: Vec::new(), decay: 1.0 });
            dry.counters = TexelCounters::default();
        }
        dry
    }

    /// The maps after the last update; before the first, the maps of a dry leaf.
    pub fn maps(&self) -> &LeafMaps {
        &self.maps
    }

    /// Number of texel updates since the maps were created, without those of the dry relief.
    pub fn texel_counters(&self) -> TexelCounters {
        self.counters
    }

    /// Advances the maps to time `t`, s, at which the leaf carries `caps`; `wet_spots` became wet since the last call. Recomputes
    /// only texels under changes.
    pub fn advance(
        &mut self,
        blade: &LeafSurface,
        caps: &[CapOnLeaf],
        wet_spots: &[WetSpot],
        t: f64,
        params: &DropParams,
    ) {
        // Decay is advanced in every case, so that the time of a dry leaf stays correct.
        let stamps = self.cap_stamps(blade, caps);
        let dirty = self.dirty_spans(&stamps);
        self.stamps = stamps;
        let decay = self.next_decay_factor(t, params);
        // A dry leaf whose drops rest costs no more than this comparison.
        if wet_spots.is_empty() && !dirty.is_dirty() && !self.damp.contains(&true) {
            return;
        }
        let wet_spots = self.wet_spot_stamps(blade, wet_spots, t, params);
        self.update(&FrameUpdate { dirty, wet_spots, decay });
    }

    /// As [`LeafWaterMaps::advance`], but recomputes every texel with every cap: the reference that `advance` must equal bit for
    /// bit.
    pub fn advance_full(
        &mut self,
        blade: &LeafSurface,
        caps: &[CapOnLeaf],
        wet_spots: &[WetSpot],
        t: f64,
        params: &DropParams,
    ) {
        let full = TexelWindow::full(self.raster.side);
        self.stamps = self.cap_stamps(blade, caps);
        self.stamps.iter_mut().for_each(|s| s.window = full);
        let decay = self.next_decay_factor(t, params);
        let mut wet_spots = self.wet_spot_stamps(blade, wet_spots, t, params);
        wet_spots.iter_mut().for_each(|s| s.window = full);
        self.damp.fill(true);
        self.update(&FrameUpdate { dirty: DirtySpans::full(self.raster.side), wet_spots, decay });
    }

    /// Applies an update band by band of tile rows, so that a band stays in the processor's cache from its caps to its wet spots.
    fn update(&mut self, update: &FrameUpdate) {
        let mut maps = std::mem::take(&mut self.maps);
        let has_relief = self.raster.relief.is_some();
        if !has_relief {
            // Release the memory that it shares with the water map, which is written now.
            maps.height = Arc::default();
        }
        let own = &mut LeafMapsMut {
            height: has_relief.then(|| Arc::make_mut(&mut maps.height)),
            water: Arc::make_mut(&mut maps.water),
            wetness: Arc::make_mut(&mut maps.wetness),
            normal: Arc::make_mut(&mut maps.normal),
        };
        let tiles = self.raster.side.div_ceil(TILE);
        for band in 0..tiles {
            self.update_heights(own, &update.dirty, band);
            // Normals of a band need heights of the first row of the next one: they follow one band later.
            if let Some(above) = band.checked_sub(1) {
                self.update_normals(own, &update.dirty, above);
            }
            self.decay_wetness(own, update.decay, band);
            self.stamp_wet_spots(own, &update.wet_spots, band);
        }
        self.update_normals(own, &update.dirty, tiles - 1);
        // Spots are stamped after drying, with their present wetness: their tiles dry from the next frame on.
        for spot in &update.wet_spots {
            for_each_tile(&spot.window, tiles, |k| self.damp[k] = true);
        }
        if !has_relief {
            maps.height = Arc::clone(&maps.water);
        }
        self.maps = maps;
    }

    /// Advances the time of the wetness to `t`, s, and returns the fraction of the wetness of the last frame that remains.
    fn next_decay_factor(&mut self, t: f64, params: &DropParams) -> f32 {
        // The factor is rounded to single precision. Its relative error is kept and corrected by the next factor, so that rounding
        // does not accumulate over the clip.
        let elapsed_half_lives = elapsed_half_lives(t, params);
        let exact = math::pow(2.0, self.elapsed_half_lives - elapsed_half_lives) * self.decay_residual;
        let rounded = narrow(exact);
        self.decay_residual = if rounded > 0.0 { exact / f64::from(rounded) } else { 1.0 };
        self.elapsed_half_lives = elapsed_half_lives;
        rounded
    }

    /// Stamps of the caps, sorted by key, so that the caps of two frames can be compared in one pass.
    fn cap_stamps(&self, blade: &LeafSurface, caps: &[CapOnLeaf]) -> Vec<CapStamp> {
        let mut stamps: Vec<CapStamp> = caps.iter().filter_map(|b| self.cap_stamp(blade, b)).collect();
        stamps.sort_unstable_by_key(|s| s.key);
        stamps
    }

    fn cap_stamp(&self, blade: &LeafSurface, cap: &CapOnLeaf) -> Option<CapStamp> {
        let point = blade.point_at(cap.uv, f64::from(self.scale))?;
        let SphericalCap { r, a, height_factor, wedge, cos_angle } = cap.cap;
        let CapDeformation { stretch, skew } = cap.deformation;
        // The drop's axis was tangential to the surface where it last moved; project it onto the surface here.
        let axis = (cap.axis - point.n * cap.axis.dot(point.n)).normalize_or(point.n.any_orthonormal_vector());
        let [x, y, z] = cap.axis.to_array();
        Some(CapStamp {
            key: [cap.uv.x, cap.uv.y, r, a, height_factor, wedge, cos_angle, stretch, skew, x, y, z].map(f64::to_bits),
            kernel: CapHeightKernel::new(&cap.cap, &cap.deformation, self.kernel_center(&point), axis.as_vec3()),
            window: self.raster.footprint_window(cap.uv, &point, cap.cap.widest_radius(), stretch, axis),
        })
    }

    fn kernel_center(&self, point: &SurfacePoint) -> CenterOnLeaf {
        CenterOnLeaf { p: point.p.as_vec3().to_array(), n: point.n.as_vec3().to_array(), scale: self.scale }
    }

    /// Texels under caps that exist in only one of the last frame and this one. Merges the two sorted lists.
    fn dirty_spans(&self, stamps: &[CapStamp]) -> DirtySpans {
        let mut segments = DirtyBits::none(self.raster.side);
        let mut mark = |s: &CapStamp| segments.mark(&s.window);
        let (mut old, mut new) = (self.stamps.iter().peekable(), stamps.iter().peekable());
        loop {
            match (old.peek(), new.peek()) {
                // In both: unchanged.
                (Some(a), Some(b)) if a.key == b.key => {
                    old.next();
                    new.next();
                }
                // Only in the last frame: the cap is gone.
                (Some(a), b) if b.is_none_or(|b| a.key < b.key) => {
                    mark(a);
                    old.next();
                }
                // Only in this frame: the cap is new.
                (_, Some(b)) => {
                    mark(b);
                    new.next();
                }
                _ => break,
            }
        }
        DirtySpans::new(&segments)
    }

    fn band_row_range(&self, band: usize) -> Range<usize> {
        band * TILE..((band + 1) * TILE).min(self.raster.side)
    }

    /// Recomputes a band's dirty texels: the water as the maximum over all caps, and the height as relief plus water.
    fn update_heights(&mut self, maps: &mut LeafMapsMut<'_>, dirty: &DirtySpans, band: usize) {
        let arch = kernels::arch();
        let (n, rows) = (self.raster.side, self.band_row_range(band));
        // Caps that have not changed are drawn again over dirty texels. The maximum does not depend on their order.
        let spans = &dirty.heights;
        for (y, span) in rows.clone().flat_map(|y| spans.row(y).iter().map(move |span| (y, span))) {
            maps.water[y * n + span.start..y * n + span.end].fill(0.0);
        }
        for stamp in self.stamps.iter().filter(|s| s.window.overlaps_rows(&rows)) {
            let (kernel, window, texels) = (&stamp.kernel, &stamp.window, maps.water.as_mut_slice());
            let pass = MaxBlendPass { kernel, window, raster: &self.raster, rows: &rows, spans, texels };
            self.counters.heights += arch.dispatch(pass);
        }
        let Some((relief, height)) = self.raster.relief.as_ref().zip(maps.height.as_mut()) else { return };
        for (y, span) in rows.clone().flat_map(|y| spans.row(y).iter().map(move |span| (y, span))) {
            let texels = y * n + span.start..y * n + span.end;
            let sources = relief[texels.clone()].iter().zip(&maps.water[texels.clone()]);
            for (height, (relief, water)) in height[texels].iter_mut().zip(sources) {
                *height = relief * self.scale + water;
            }
        }
    }

    /// Recomputes the normals of a band's texels for which their height or that of a neighbour is dirty.
    fn update_normals(&mut self, maps: &mut LeafMapsMut<'_>, dirty: &DirtySpans, band: usize) {
        for y in self.band_row_range(band) {
            dirty.normals.row(y).iter().for_each(|span| self.update_row_normals(maps, y, *span));
        }
    }

    /// Recomputes the normals of a span of row `y` by central differences of the heights, one-sided at the edges of the map.
    fn update_row_normals(&mut self, maps: &mut LeafMapsMut<'_>, y: usize, span: ColumnSpan) {
        let ColumnSpan { start, end } = span;
        let n = self.raster.side;
        self.counters.normals += (end - start) as u64;
        // v grows upwards, rows count downwards. The inverse distances of neighbours in u and in v are divided by the scale of
        // the leaf, since the slope factors of the raster are those of scale 1.
        let (up, down) = (y.saturating_sub(1), (y + 1).min(n - 1));
        let inverse_distance = [n as f32 * 0.5, n as f32 / (down - up).max(1) as f32].map(|k| k / self.scale);
        let LeafMapsMut { height, water, normal, .. } = maps;
        let height: &[f32] = height.as_deref().map_or(water.as_slice(), Vec::as_slice);
        let (inner, outer) = (start.max(1), end.min(n - 1));
        // Texels with neighbours on both sides, by vectors.
        let texels = y * n + inner..y * n + outer;
        let inputs = NormalInputs {
            row: &height[texels.start - 1..texels.end + 1],
            above: &height[up * n + inner..up * n + outer],
            below: &height[down * n + inner..down * n + outer],
            slope_factors: [0, 1, 2].map(|k| &self.raster.slope_factors[k][texels.clone()]),
            inverse_distance,
        };
        kernels::arch().dispatch(NormalPass { inputs: &inputs, normals: &mut normal[texels] });
        // The first and last texel of a row have a neighbour on one side only.
        for x in [0, n - 1].into_iter().filter(|x| (start..end).contains(x) && !(inner..outer).contains(x)) {
            let (left, right) = (x.saturating_sub(1), (x + 1).min(n - 1));
            let per_u = n as f32 / (right - left).max(1) as f32 / self.scale;
            let du = (height[y * n + right] - height[y * n + left]) * per_u;
            let dv = (height[up * n + x] - height[down * n + x]) * inverse_distance[1];
            let slope_factors = [0, 1, 2].map(|k| self.raster.slope_factors[k][y * n + x]);
            normal[y * n + x] = kernels::normal([du, dv], slope_factors);
        }
    }

    /// Stamps of paths that were under water, with the wetness that is left of them at time `t`, s. Source: [yang-wu] eq. 11.
    fn wet_spot_stamps(
        &self,
        blade: &LeafSurface,
        wet_spots: &[WetSpot],
        t: f64,
        params: &DropParams,
    ) -> Vec<WetSpotStamp> {
        let n = self.raster.side as f64;
        // A spot that became wet between two frames has dried since. Successive spots mostly have the same time, so the last
        // wetness is reused while the time repeats.
        let now = elapsed_half_lives(t, params);
        let mut last: Option<(f64, f32)> = None;
        let mut peak = |t: f64| match last {
            Some((time, peak)) if time.to_bits() == t.to_bits() => peak,
            _ => last.insert((t, narrow(math::pow(2.0, (elapsed_half_lives(t, params) - now).min(0.0))))).1,
        };
        let stamp = |spot: &WetSpot| {
            let point = blade.point_at(spot.uv, f64::from(self.scale))?;
            // Without a point at the start, as across a notch of the margin, the path has no length.
            let start = blade.point_at(spot.from, f64::from(self.scale));
            let middle = if start.is_some() { 0.5 * (spot.uv + spot.from) } else { spot.uv };
            let path = start.map_or(DVec3::ZERO, |start| start.p - point.p);
            // The edge is one texel wide, so that the wet area does not depend on the resolution.
            let texel = point.dpdu.length().min(point.dpdv.length()) / n;
            let radius = WET_RADIUS_FACTOR * spot.a;
            let kernel = WetPathKernel {
                center: self.kernel_center(&point),
                path: path.as_vec3().to_array(),
                along: (path / path.length_squared().max(f64::MIN_POSITIVE)).as_vec3().to_array(),
                radius: narrow(radius),
                inverse_edge: narrow(1.0 / texel),
                exponent_rate: narrow(-1.0 / params.decay_length),
                peak: peak(spot.t),
            };
            // The swept disk lies in the ellipse around the middle of the path with half-axes A = radius + half and
            // B = sqrt(radius A), where half is half the length of the path.
            let (reach, half) = (radius + texel, 0.5 * path.length());
            let (along, across) = (reach + half, (reach * (reach + half)).sqrt());
            let axis = (path - point.n * path.dot(point.n)).normalize_or(point.n.any_orthonormal_vector());
            let (size, stretch) = ((along * across).sqrt(), (along / across).sqrt());
            Some(WetSpotStamp { kernel, window: self.raster.footprint_window(middle, &point, size, stretch, axis) })
        };
        wet_spots.iter().filter_map(stamp).collect()
    }

    /// Raises the wetness of a band's texels to that of the spots that cover them.
    fn stamp_wet_spots(&mut self, maps: &mut LeafMapsMut<'_>, stamps: &[WetSpotStamp], band: usize) {
        let arch = kernels::arch();
        let rows = self.band_row_range(band);
        let spans = &self.full;
        for stamp in stamps.iter().filter(|s| s.window.overlaps_rows(&rows)) {
            let (kernel, window, texels) = (&stamp.kernel, &stamp.window, maps.wetness.as_mut_slice());
            let pass = MaxBlendPass { kernel, window, raster: &self.raster, rows: &rows, spans, texels };
            self.counters.wet_spots += arch.dispatch(pass);
        }
    }

    /// Multiplies the wetness of a band's damp tiles by `decay`; runs of tiles that have dried are skipped in later frames.
    fn decay_wetness(&mut self, maps: &mut LeafMapsMut<'_>, decay: f32, band: usize) {
        let arch = kernels::arch();
        let (n, rows) = (self.raster.side, self.band_row_range(band));
        let tiles = n.div_ceil(TILE);
        let damp = &mut self.damp[band * tiles..(band + 1) * tiles];
        let runs: Vec<ColumnSpan> = damp_runs(damp, n).collect();
        for ColumnSpan { start, end } in runs {
            let mut any = false;
            for y in rows.clone() {
                let wetness = &mut maps.wetness[y * n + start..y * n + end];
                any |= arch.dispatch(DryingPass { decay, wetness });
                self.counters.drying += (end - start) as u64;
            }
            // A run of tiles stays damp as a whole while any texel of it is damp.
            if !any {
                damp[start / TILE..end.div_ceil(TILE)].fill(false);
            }
        }
    }
}

/// Number of half-lives of wetness up to time `t`, s: decay_fraction^(t / decay_time) = 2^-elapsed_half_lives.
fn elapsed_half_lives(t: f64, params: &DropParams) -> f64 {
    -t / params.decay_time * (math::ln(params.decay_fraction) / std::f64::consts::LN_2)
}

/// Runs of damp tiles in a row of tiles, as columns of texels of a map of `n` columns.
fn damp_runs(damp: &[bool], n: usize) -> impl Iterator<Item = ColumnSpan> + '_ {
    let mut k = 0;
    std::iter::from_fn(move || {
        let from = k + damp[k..].iter().position(|m| *m)?;
        k = damp[from..].iter().position(|m| !*m).map_or(damp.len(), |l| from + l);
        Some(ColumnSpan { start: from * TILE, end: (k * TILE).min(n) })
    })
}

/// Calls `f` with the index of each tile, of `tiles` each way, that a window overlaps.
fn for_each_tile(w: &TexelWindow, tiles: usize, mut f: impl FnMut(usize)) {
    if w.lo[0] >= w.hi[0] || w.lo[1] >= w.hi[1] {
        return;
    }
    for y in w.lo[1] / TILE..=(w.hi[1] - 1) / TILE {
        // Only tiles of this row of tiles that the ellipse meets, not all tiles of its bounding box.
        let columns = w.columns_of_rows(y * TILE..(y + 1) * TILE);
        if columns.start < columns.end {
            (columns.start / TILE..=(columns.end - 1) / TILE).for_each(|x| f(y * tiles + x));
        }
    }
}

#[cfg(test)]
mod tests;
