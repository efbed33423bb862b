//! Maps of water on a leaf: height, wetness and normals over its texture, with only the tiles done again that changed.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};

use super::cap::{Cap, Print};
use super::manner::Manner;
use super::sheet::{Sheet, Spot};
use crate::math::{self, narrow};
use crate::scene::WetMaps;

/// Texels of a tile's side.
const TILE: usize = 16;
/// Wetness that counts as none.
const DRY: f32 = 1.0 / 1024.0;
/// Halvings after which the store is scaled anew.
const EPOCH: f64 = 16.0;
/// How far water wets beyond its base, in base radii.
const SOAKS: f64 = 1.15;
/// Normals that turn farther than this from the drop's are on another side: cosine.
const OTHER: f64 = 0.0;

/// What a leaf's texture knows of its blade: made once, shared by all leaves of one form.
#[derive(Debug)]
pub struct Chart {
    side: usize,
    /// Per texel: place and normal, m of the blade's own space; none beyond it.
    spots: Vec<Option<Texel>>,
}

#[derive(Debug, Clone, Copy)]
struct Texel {
    p: Vec3,
    n: Vec3,
    ju: Vec3,
    jv: Vec3,
}

/// One cap on a leaf, as the maps see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blob {
    /// Where.
    pub uv: DVec2,
    /// Its shape.
    pub cap: Cap,
    /// Its footprint.
    pub print: Print,
    /// Long axis of the footprint, unit, of leaf space.
    pub axis: DVec3,
}

/// A place under water at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Soak {
    /// Where.
    pub uv: DVec2,
    /// Radius of the base, m.
    pub a: f64,
    /// s.
    pub t: f64,
}

/// A range of texels, ends excluded.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Window {
    lo: [usize; 2],
    hi: [usize; 2],
}

/// A cap as texels ask for it, in the precision of maps. Source: as [`Cap::height`] and [`Print::at`].
struct Dome {
    along: f32,
    across: f32,
    skew: f32,
    a2: f32,
    r2: f32,
    base: f32,
    omega: f32,
    overhangs: bool,
}

impl Dome {
    fn of(blob: &Blob) -> Self {
        let (cap, print) = (&blob.cap, &blob.print);
        Self {
            along: narrow(1.0 / (cap.a * print.q)),
            across: narrow(print.q / cap.a),
            skew: narrow(print.skew),
            a2: narrow(cap.a * cap.a),
            r2: narrow(cap.r * cap.r),
            base: narrow(cap.r * cap.c),
            omega: narrow(cap.omega),
            overhangs: cap.c < 0.0,
        }
    }

    /// Height over a place of the leaf, m; 0 outside.
    fn height(&self, along: f32, across: f32) -> f32 {
        let (x, y) = (along * self.along, across * self.across);
        let rho2 = x * x + y * y;
        let under = self.r2 - rho2 * self.a2;
        if under <= 0.0 || (!self.overhangs && rho2 >= 1.0) {
            return 0.0;
        }
        let h = self.omega * (math::sqrt_f32(under) - self.base).max(0.0);
        h * (1.0 + self.skew * x.clamp(-1.0, 1.0))
    }
}

impl Chart {
    /// Looks up each of `side` by `side` texels.
    pub fn new(sheet: &Sheet, side: usize) -> Self {
        let rows: Vec<usize> = (0..side).collect();
        let n = side as f64;
        let row = |y: &usize| -> Vec<Option<Texel>> {
            let v = 1.0 - (*y as f64 + 0.5) / n;
            let texel = |x: usize| {
                let s = sheet.at(DVec2::new((x as f64 + 0.5) / n, v), 1.0)?;
                Some(Texel { p: s.p.as_vec3(), n: s.n.as_vec3(), ju: s.ju.as_vec3(), jv: s.jv.as_vec3() })
            };
            (0..side).map(texel).collect()
        };
        Self { side, spots: crate::par::par_map(&rows, row).concat() }
    }

    /// Texels within a distance, m, of a place.
    fn window(&self, uv: DVec2, spot: &Spot, reach: f64) -> Window {
        let n = self.side as f64;
        let r = spot.fastest() * (1.25 * reach);
        let clamp = |x: f64| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let k = x.clamp(0.0, n) as usize;
            k
        };
        Window {
            lo: [clamp(((uv.x - r.x) * n).floor()), clamp(((1.0 - uv.y - r.y) * n).floor())],
            hi: [clamp(((uv.x + r.x) * n).ceil() + 1.0), clamp(((1.0 - uv.y + r.y) * n).ceil() + 1.0)],
        }
    }
}

/// A blob with what its stamp needs.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stamp {
    blob: Blob,
    p: Vec3,
    n: Vec3,
    along: Vec3,
    across: Vec3,
    window: Window,
}

/// The maps of one leaf through a clip.
#[derive(Debug, Clone)]
pub struct Wetness {
    chart: Arc<Chart>,
    scale: f32,
    /// Wetness times 2^age, by the age since [`Wetness::epoch`]: what dries as one needs one factor a frame.
    store: Vec<f32>,
    /// Halvings that the store leaves out.
    epoch: f64,
    stamps: Vec<Stamp>,
    maps: Arc<WetMaps>,
    /// Tiles whose wetness is above [`DRY`].
    damp: Vec<bool>,
    /// Texels worked on so far: by water, by wetness.
    touched: [u64; 2],
}

impl Wetness {
    /// A dry leaf, `scale` times as large as its blade.
    pub fn new(chart: Arc<Chart>, scale: f64) -> Self {
        let n = chart.side * chart.side;
        let tiles = chart.side.div_ceil(TILE);
        let maps = WetMaps {
            height: vec![0.0; n],
            water: vec![0.0; n],
            wetness: vec![0.0; n],
            normal: vec![[0.0, 0.0, 1.0]; n],
        };
        Self {
            chart,
            scale: narrow(scale),
            store: vec![0.0; n],
            epoch: 0.0,
            stamps: Vec::new(),
            maps: Arc::new(maps),
            damp: vec![false; tiles * tiles],
            touched: [0; 2],
        }
    }

    /// The maps as they are.
    pub fn maps(&self) -> &Arc<WetMaps> {
        &self.maps
    }

    /// Texels worked on so far: of water and normals, of wetness.
    pub fn touched(&self) -> [u64; 2] {
        self.touched
    }

    /// Goes on to time `t`, s: water as `blobs` say, wet where `soaks` were. Only tiles under what changed are done again.
    pub fn advance(&mut self, sheet: &Sheet, (blobs, soaks): (&[Blob], &[Soak]), t: f64, manner: &Manner) {
        let stamps: Vec<Stamp> = blobs.iter().filter_map(|b| self.stamp(sheet, b)).collect();
        let changed = self.changed(&stamps);
        self.stamps = stamps;
        let still = soaks.is_empty() && !changed.contains(&true) && !self.damp.contains(&true);
        if still {
            return;
        }
        let mut maps = std::mem::take(&mut self.maps);
        let own = Arc::make_mut(&mut maps);
        self.pour(own, &changed);
        self.age(t, manner);
        self.soak(sheet, soaks, manner);
        self.dry(own, t, manner);
        self.maps = maps;
    }

    /// The same from nothing: every texel, every blob. What [`Wetness::advance`] must equal, bit for bit.
    pub fn all_over(&mut self, sheet: &Sheet, (blobs, soaks): (&[Blob], &[Soak]), t: f64, manner: &Manner) {
        let n = self.chart.side;
        let whole = Window { lo: [0; 2], hi: [n; 2] };
        let stamps = blobs.iter().filter_map(|b| self.stamp(sheet, b));
        self.stamps = stamps.map(|s| Stamp { window: whole, ..s }).collect();
        let mut maps = std::mem::take(&mut self.maps);
        let own = Arc::make_mut(&mut maps);
        let tiles = n.div_ceil(TILE);
        self.pour(own, &vec![true; tiles * tiles]);
        self.age(t, manner);
        self.soak_within(sheet, soaks, manner, Some(whole));
        self.damp.fill(true);
        self.dry(own, t, manner);
        self.maps = maps;
    }

    fn stamp(&self, sheet: &Sheet, blob: &Blob) -> Option<Stamp> {
        let scale = f64::from(self.scale);
        let spot = sheet.at(blob.uv, scale)?;
        let reach = blob.cap.reach() * blob.print.q.max(1.0 / blob.print.q);
        let axis = (blob.axis - spot.n * blob.axis.dot(spot.n)).normalize_or(spot.n.any_orthonormal_vector());
        Some(Stamp {
            blob: *blob,
            p: spot.p.as_vec3(),
            n: spot.n.as_vec3(),
            along: axis.as_vec3(),
            across: spot.n.cross(axis).as_vec3(),
            window: self.chart.window(blob.uv, &spot, reach),
        })
    }

    /// Tiles under what was there before or is there now and is not the same.
    fn changed(&self, stamps: &[Stamp]) -> Vec<bool> {
        let tiles = self.chart.side.div_ceil(TILE);
        let mut changed = vec![false; tiles * tiles];
        let mut mark = |s: &Stamp| each_tile(s.window, tiles, |k| changed[k] = true);
        let kept = |s: &Stamp, list: &[Stamp]| list.contains(s);
        self.stamps.iter().filter(|s| !kept(s, stamps)).for_each(&mut mark);
        stamps.iter().filter(|s| !kept(s, &self.stamps)).for_each(&mut mark);
        changed
    }

    /// Clears and fills tiles, then makes their normals and those of the texels around them.
    fn pour(&mut self, maps: &mut WetMaps, changed: &[bool]) {
        let (n, tiles) = (self.chart.side, self.chart.side.div_ceil(TILE));
        let mut over: Vec<Vec<u32>> = vec![Vec::new(); tiles * tiles];
        for (i, s) in self.stamps.iter().enumerate() {
            each_tile(s.window, tiles, |k| over[k].push(u32::try_from(i).unwrap_or(u32::MAX)));
        }
        for k in (0..tiles * tiles).filter(|k| changed[*k]) {
            let area = tile(k, tiles, n);
            for y in area.lo[1]..area.hi[1] {
                maps.water[y * n + area.lo[0]..y * n + area.hi[0]].fill(0.0);
            }
            for i in &over[k] {
                self.fill(maps, &self.stamps[*i as usize], area);
            }
            self.touched[0] += area.len();
            for y in area.lo[1]..area.hi[1] {
                let row = y * n + area.lo[0]..y * n + area.hi[0];
                maps.height[row.clone()].copy_from_slice(&maps.water[row]);
            }
        }
        for k in (0..tiles * tiles).filter(|k| changed[*k]) {
            let area = tile(k, tiles, n);
            let grown = Window { lo: area.lo.map(|x| x.saturating_sub(1)), hi: area.hi.map(|x| (x + 1).min(n)) };
            for y in grown.lo[1]..grown.hi[1] {
                for x in grown.lo[0]..grown.hi[0] {
                    maps.normal[y * n + x] = self.normal(&maps.height, x, y);
                }
            }
        }
    }

    /// The highest water over each texel of a part of a tile.
    fn fill(&self, maps: &mut WetMaps, s: &Stamp, area: Window) {
        let n = self.chart.side;
        let Some(part) = s.window.and(&area) else { return };
        let shape = Dome::of(&s.blob);
        for y in part.lo[1]..part.hi[1] {
            for x in part.lo[0]..part.hi[0] {
                let Some(texel) = &self.chart.spots[y * n + x] else { continue };
                if f64::from(texel.n.dot(s.n)) <= OTHER {
                    continue;
                }
                let d = texel.p * self.scale - s.p;
                let h = shape.height(d.dot(s.along), d.dot(s.across));
                if h <= 0.0 {
                    continue;
                }
                let water = &mut maps.water[y * n + x];
                *water = water.max(h);
            }
        }
    }

    /// Normal of the water's surface in tangent space. Source: -G^-1 (H_u, H_v) along the surface.
    fn normal(&self, height: &[f32], x: usize, y: usize) -> [f32; 3] {
        let n = self.chart.side;
        let flat = [0.0, 0.0, 1.0];
        let Some(texel) = &self.chart.spots[y * n + x] else { return flat };
        let at = |x: usize, y: usize| height[y * n + x];
        let (left, right) = (x.saturating_sub(1), (x + 1).min(n - 1));
        let (up, down) = (y.saturating_sub(1), (y + 1).min(n - 1));
        let du = (at(right, y) - at(left, y)) / ((right - left) as f32 / n as f32);
        let dv = (at(x, up) - at(x, down)) / ((down - up) as f32 / n as f32);
        if du == 0.0 && dv == 0.0 {
            return flat;
        }
        let (ju, jv) = (texel.ju * self.scale, texel.jv * self.scale);
        let (a, b, c) = (ju.dot(ju), ju.dot(jv), jv.dot(jv));
        let det = a * c - b * b;
        let grad = (ju * (c * du - b * dv) + jv * (a * dv - b * du)) / det;
        let t = ju.normalize_or_zero();
        let side = texel.n.cross(t) * if jv.dot(texel.n.cross(t)) < 0.0 { -1.0 } else { 1.0 };
        let v = Vec3::new(-grad.dot(t), -grad.dot(side), 1.0);
        (v / math::sqrt_f32(v.length_squared())).to_array()
    }

    /// Moves the epoch on towards time `t`, s, by whole steps that floats hold exactly.
    fn age(&mut self, t: f64, manner: &Manner) {
        let age = halvings(t, manner);
        while age - self.epoch >= EPOCH {
            self.epoch += EPOCH;
            let less = narrow(math::pow(2.0, -EPOCH));
            self.store.iter_mut().for_each(|v| *v *= less);
        }
    }

    fn soak(&mut self, sheet: &Sheet, soaks: &[Soak], manner: &Manner) {
        self.soak_within(sheet, soaks, manner, None);
    }

    /// Places that were under water become wet. Source: [yang-wu] eq. 11.
    fn soak_within(&mut self, sheet: &Sheet, soaks: &[Soak], manner: &Manner, all: Option<Window>) {
        let chart = Arc::clone(&self.chart);
        let (n, tiles) = (chart.side, chart.side.div_ceil(TILE));
        let scale = f64::from(self.scale);
        for soak in soaks {
            let Some(spot) = sheet.at(soak.uv, scale) else { continue };
            let texel = spot.ju.length().min(spot.jv.length()) / n as f64;
            let reach = SOAKS * soak.a;
            let own = chart.window(soak.uv, &spot, reach + texel);
            let window = all.unwrap_or(own);
            let (p, normal) = (spot.p.as_vec3(), spot.n.as_vec3());
            // Drops of the past may be told late: before the epoch they count for less.
            let age = halvings(soak.t, manner) - self.epoch;
            let (grown, length) = (narrow(math::pow(2.0, age)), narrow(-1.0 / manner.wet_length));
            let (reach, per_texel) = (narrow(reach), narrow(1.0 / texel));
            for y in window.lo[1]..window.hi[1] {
                for x in window.lo[0]..window.hi[0] {
                    let Some(there) = &chart.spots[y * n + x] else { continue };
                    if f64::from(there.n.dot(normal)) <= OTHER {
                        continue;
                    }
                    let d = math::sqrt_f32((there.p * self.scale - p).length_squared());
                    let edge = ((reach - d) * per_texel + 0.5).clamp(0.0, 1.0);
                    if edge <= 0.0 {
                        continue;
                    }
                    let wet = edge * math::exp_f32(d * length) * grown;
                    let kept = &mut self.store[y * n + x];
                    *kept = kept.max(wet);
                }
            }
            each_tile(own, tiles, |k| self.damp[k] = true);
        }
    }

    /// Wetness as it is at time `t`; tiles that have dried are left alone from then on.
    fn dry(&mut self, maps: &mut WetMaps, t: f64, manner: &Manner) {
        let (n, tiles) = (self.chart.side, self.chart.side.div_ceil(TILE));
        let left = narrow(math::pow(2.0, -(halvings(t, manner) - self.epoch)));
        for k in 0..tiles * tiles {
            if !self.damp[k] {
                continue;
            }
            let area = tile(k, tiles, n);
            let mut most = 0.0_f32;
            for y in area.lo[1]..area.hi[1] {
                let row = y * n + area.lo[0]..y * n + area.hi[0];
                for (wet, kept) in maps.wetness[row.clone()].iter_mut().zip(&self.store[row]) {
                    let now = (kept * left).min(1.0);
                    *wet = if now < DRY { 0.0 } else { now };
                    most = most.max(*wet);
                }
            }
            self.touched[1] += area.len();
            self.damp[k] = most > 0.0;
        }
    }
}

/// How often wetness has halved at time `t`, s. Source: zeta^(t / half life) = 2^-halvings.
fn halvings(t: f64, manner: &Manner) -> f64 {
    -t / manner.half_life * (math::ln(manner.zeta) / std::f64::consts::LN_2)
}

fn each_tile(w: Window, tiles: usize, mut f: impl FnMut(usize)) {
    if w.lo[0] >= w.hi[0] || w.lo[1] >= w.hi[1] {
        return;
    }
    for y in w.lo[1] / TILE..=(w.hi[1] - 1) / TILE {
        for x in w.lo[0] / TILE..=(w.hi[0] - 1) / TILE {
            f(y * tiles + x);
        }
    }
}

fn tile(k: usize, tiles: usize, n: usize) -> Window {
    let (x, y) = (k % tiles * TILE, k / tiles * TILE);
    Window { lo: [x, y], hi: [(x + TILE).min(n), (y + TILE).min(n)] }
}

impl Window {
    fn and(&self, other: &Self) -> Option<Self> {
        let lo = [0, 1].map(|k| self.lo[k].max(other.lo[k]));
        let hi = [0, 1].map(|k| self.hi[k].min(other.hi[k]));
        (lo[0] < hi[0] && lo[1] < hi[1]).then_some(Self { lo, hi })
    }

    fn len(&self) -> u64 {
        ((self.hi[0] - self.lo[0]) * (self.hi[1] - self.lo[1])) as u64
    }
}

#[cfg(test)]
mod tests;
