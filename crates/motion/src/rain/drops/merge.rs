//! Drops that touch become one.

use glam::DVec3;

use crate::rain::drops::drop::SurfaceDrop;
use crate::rain::drops::rain_leaf::{LeafStepResult, RainLeaf, StepLaw};
use crate::rain::drops::shape::WATER;
use crate::rain::event::RainEvent;
use crate::rain::params::{DropParams, MergeRule};
use osier_base::math;
use osier_scene::DropEventKind;

/// Where a drop is, m of leaf space, and the radius of its base, m; none beyond the blade.
type Place = Option<(DVec3, f64)>;

impl RainLeaf {
    /// Drops that touch become one, until none do. Source: [yang-wu] eq. 13; eq. 12 in its own mode.
    pub(super) fn merge(&self, drops: &mut Vec<SurfaceDrop>, (now, manner): StepLaw<'_>, told: &mut LeafStepResult) {
        drops.sort_by_key(|d| d.id);
        if drops.iter().all(|d| d.quiet) {
            return;
        }
        let mut places: Vec<Place> = drops.iter().map(|d| self.place(d, manner)).collect();
        while let Some((i, k)) = touching(drops, &places, manner) {
            let (heavy, light) = if drops[k].volume > drops[i].volume { (k, i) } else { (i, k) };
            let gone = drops[light].clone();
            told.tally.merged += 1;
            self.swallow(&mut drops[heavy], &gone);
            places[heavy] = self.place(&drops[heavy], manner);
            let p = places[heavy].map_or(now.blade.position, |(p, _)| now.blade.position + now.blade.orientation * p);
            let kept = &drops[heavy];
            let event = RainEvent::of(DropEventKind::Merged, kept.id, (now.t, p), kept.volume);
            told.events.push(RainEvent { other: Some(gone.id), ..event });
            drops.remove(light);
            places.remove(light);
        }
        drops.iter_mut().for_each(|d| d.quiet = true);
    }

    fn place(&self, drop: &SurfaceDrop, manner: &DropParams) -> Place {
        match drop.hang {
            Some(hang) => Some((hang.rim.p, hang.radius)),
            None => self.at(drop.uv).map(|s| (s.p, drop.head(manner, 1.0).a)),
        }
    }

    /// Volumes add, momentum is kept, the place is the middle of both.
    fn swallow(&self, heavy: &mut SurfaceDrop, light: &SurfaceDrop) {
        let whole = heavy.volume + light.volume;
        let share = light.volume / whole;
        if heavy.hang.is_none() {
            if light.hang.is_some() {
                heavy.loosen();
                heavy.hang = light.hang;
                heavy.v = DVec3::ZERO;
            } else {
                let middle = heavy.uv.lerp(light.uv, share);
                let way = self.at(heavy.uv).zip(self.at(light.uv)).map(|(a, b)| b.p - a.p);
                if self.at(middle).is_some() {
                    heavy.uv = middle;
                }
                heavy.v = heavy.v.lerp(light.v, share);
                heavy.merged = 0.0;
                heavy.axis = way.unwrap_or(heavy.axis).normalize_or(heavy.axis);
            }
        }
        heavy.volume = whole;
        heavy.quiet = false;
        heavy.wetted = None;
    }
}

/// The first two drops that touch, in the order of their numbers. Only those near ones that moved are compared: drops
/// stand in a row along the leaf, and the widest tells how far to look.
fn touching(drops: &[SurfaceDrop], places: &[Place], manner: &DropParams) -> Option<(usize, usize)> {
    let mut row: Vec<(f64, usize)> = (0..).zip(places).filter_map(|(i, p)| Some((p.as_ref()?.0.y, i))).collect();
    row.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let widest = places.iter().flatten().fold(0.0, |m: f64, p| m.max(p.1));
    let mut first: Option<(usize, usize)> = None;
    for (moved, place) in places.iter().enumerate().filter(|(i, _)| !drops[*i].quiet) {
        let Some((p, radius)) = place else { continue };
        let reach = (radius + widest) * (1.0 + 1e-9);
        let from = row.partition_point(|(y, _)| *y < p.y - reach);
        for (_, other) in row[from..].iter().take_while(|(y, _)| *y <= p.y + reach) {
            let pair = (moved.min(*other), moved.max(*other));
            if pair.0 != pair.1 && first.is_none_or(|f| pair < f) && touch(drops, places, pair, manner) {
                first = Some(pair);
            }
        }
    }
    first
}

fn touch(drops: &[SurfaceDrop], places: &[Place], (i, k): (usize, usize), manner: &DropParams) -> bool {
    let (Some(a), Some(b)) = (places[i], places[k]) else { return false };
    let hangs = drops[i].hang.is_some() || drops[k].hang.is_some();
    let reach = match manner.merge {
        MergeRule::Touch => a.1 + b.1,
        MergeRule::Paper => {
            let lighter = WATER * drops[i].volume.min(drops[k].volume) * manner.g;
            (a.1 + b.1) * math::exp(-manner.mu * lighter / manner.k_h)
        }
    };
    a.0.distance(b.0) <= reach && (hangs || drops[i].side * drops[k].side > 0.0)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec2;

    use super::*;
    use crate::rain::leaf::surface::{LeafSurface, tests::flat};
    use osier_base::rng::Rng;

    #[test]
    fn the_row_finds_the_pair_that_all_pairs_have_first() {
        let mut draw = Rng::at(3, &["row".into()]);
        let mut found = 0;
        for merge in [MergeRule::Touch, MergeRule::Paper] {
            let manner = DropParams { merge, mu: 0.3, ..DropParams::default() };
            for _ in 0..60 {
                let mut drops = Vec::new();
                let mut places = Vec::new();
                for id in 0..40 {
                    let side = if draw.chance(0.8) { 1.0 } else { -1.0 };
                    let mut drop = SurfaceDrop::new(id, side, DVec2::ZERO, DVec3::ZERO, draw.range(1e-9, 3e-8));
                    drop.quiet = draw.chance(0.6);
                    drops.push(drop);
                    let p = DVec3::new(draw.range(-0.02, 0.02), draw.range(0.0, 0.08), draw.range(0.0, 0.001));
                    places.push(draw.chance(0.95).then(|| (p, draw.range(2e-4, 2e-3))));
                }
                let pairs = (0..40).flat_map(|i| (i + 1..40).map(move |k| (i, k)));
                let mut moved = pairs.filter(|(i, k)| !(drops[*i].quiet && drops[*k].quiet));
                let meant = moved.find(|pair| touch(&drops, &places, *pair, &manner));
                assert_eq!(touching(&drops, &places, &manner), meant);
                found += usize::from(meant.is_some());
            }
        }
        assert!((20..120).contains(&found), "{found} of 120 have a pair");
    }

    #[test]
    fn one_drop_has_all_the_water_and_momentum_of_both() {
        let sheet = LeafSurface::new(&flat(0.08, 0.04, 4)).expect("a blade");
        let leaf = RainLeaf::new(Arc::new(sheet), 1.0, 0);
        let mut draw = Rng::at(8, &["merge".into()]);
        for id in 0..500 {
            let mut one = |most: f64| {
                let uv = DVec2::new(draw.range(0.1, 0.9), draw.range(0.1, 0.9));
                let v = DVec3::new(draw.range(-0.5, 0.5), draw.range(-0.5, 0.5), 0.0);
                SurfaceDrop::new(id, 1.0, uv, v, draw.range(1e-11, most))
            };
            let (mut kept, gone) = (one(1e-7), one(1e-8));
            let (water, push) = (kept.volume + gone.volume, kept.v * kept.volume + gone.v * gone.volume);
            let middle = (kept.uv * kept.volume + gone.uv * gone.volume) / water;
            leaf.swallow(&mut kept, &gone);
            assert!((kept.volume / water - 1.0).abs() < 1e-12);
            assert!((kept.v * kept.volume - push).length() < 1e-12 * push.length());
            assert!(kept.uv.distance(middle) < 1e-12);
        }
    }
}
