//! Drops that touch become one.

use glam::DVec3;

use crate::rain::drops::drop::SurfaceDrop;
use crate::rain::drops::rain_leaf::{LeafStep, LeafStepResult, RainLeaf};
use crate::rain::drops::shape::WATER;
use crate::rain::event::RainEvent;
use crate::rain::params::{DropParams, MergeRule};
use osier_base::math;
use osier_scene::DropEventKind;

/// Center of a drop, m of leaf space, and its base radius, m; none beyond the blade.
type DropExtent = Option<(DVec3, f64)>;

impl RainLeaf {
    /// Merges drops that touch, pair by pair, until none do: the lighter is absorbed by the heavier.
    /// Source: [yang-wu] eq. 13; eq. 12 in its own mode.
    pub(super) fn merge_drops(&self, drops: &mut Vec<SurfaceDrop>, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        let params = step.params;
        drops.sort_by_key(|d| d.id);
        if drops.iter().all(|d| d.merge_tested) {
            return;
        }
        let mut places: Vec<DropExtent> = drops.iter().map(|d| self.extent_of(d, params)).collect();
        while let Some((i, k)) = first_touching_pair(drops, &places, params) {
            let (heavy, light) = if drops[k].volume > drops[i].volume { (k, i) } else { (i, k) };
            let gone = drops[light].clone();
            result.counters.merged += 1;
            self.absorb(&mut drops[heavy], &gone);
            places[heavy] = self.extent_of(&drops[heavy], params);
            let p = places[heavy].map_or(step.pose.position, |(p, _)| step.world_point(p));
            let kept = &drops[heavy];
            let event = RainEvent::new(DropEventKind::Merged, kept.id, step.t, p, kept.volume);
            result.events.push(RainEvent { other: Some(gone.id), ..event });
            drops.remove(light);
            places.remove(light);
        }
        drops.iter_mut().for_each(|d| d.merge_tested = true);
    }

    fn extent_of(&self, drop: &SurfaceDrop, params: &DropParams) -> DropExtent {
        match drop.pendant {
            Some(hang) => Some((hang.margin.p, hang.radius)),
            None => self.at(drop.uv).map(|s| (s.p, drop.head_cap(params, 1.0).a)),
        }
    }

    /// Merges `light` into `heavy`: volumes add, momentum is conserved, the new center is the center of mass. Of two drops of
    /// which one is pendant, the result is pendant.
    fn absorb(&self, heavy: &mut SurfaceDrop, light: &SurfaceDrop) {
        let whole = heavy.volume + light.volume;
        let share = light.volume / whole;
        if heavy.pendant.is_none() {
            if light.pendant.is_some() {
                heavy.detach();
                heavy.pendant = light.pendant;
                heavy.v = DVec3::ZERO;
            } else {
                let middle = heavy.uv.lerp(light.uv, share);
                let way = self.at(heavy.uv).zip(self.at(light.uv)).map(|(a, b)| b.p - a.p);
                if self.at(middle).is_some() {
                    heavy.uv = middle;
                }
                heavy.v = heavy.v.lerp(light.v, share);
                heavy.since_merge = 0.0;
                heavy.axis = way.unwrap_or(heavy.axis).normalize_or(heavy.axis);
            }
        }
        heavy.volume = whole;
        heavy.merge_tested = false;
        heavy.last_wet_uv = None;
    }
}

/// The first two drops that touch, in the order of their indices. Only pairs with a drop that has moved are tested: centers are
/// sorted along the leaf (sweep and prune), and the largest radius bounds how far to look.
fn first_touching_pair(drops: &[SurfaceDrop], places: &[DropExtent], params: &DropParams) -> Option<(usize, usize)> {
    let mut row: Vec<(f64, usize)> = (0..).zip(places).filter_map(|(i, p)| Some((p.as_ref()?.0.y, i))).collect();
    row.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let widest = places.iter().flatten().fold(0.0, |m: f64, p| m.max(p.1));
    let mut first: Option<(usize, usize)> = None;
    for (moved, place) in places.iter().enumerate().filter(|(i, _)| !drops[*i].merge_tested) {
        let Some((p, radius)) = place else { continue };
        let reach = (radius + widest) * (1.0 + 1e-9);
        let from = row.partition_point(|(y, _)| *y < p.y - reach);
        for (_, other) in row[from..].iter().take_while(|(y, _)| *y <= p.y + reach) {
            let pair = (moved.min(*other), moved.max(*other));
            if pair.0 != pair.1 && first.is_none_or(|f| pair < f) && drops_touch(drops, places, pair, params) {
                first = Some(pair);
            }
        }
    }
    first
}

fn drops_touch(drops: &[SurfaceDrop], places: &[DropExtent], pair: (usize, usize), params: &DropParams) -> bool {
    let (i, k) = pair;
    let (Some(a), Some(b)) = (places[i], places[k]) else { return false };
    let hangs = drops[i].pendant.is_some() || drops[k].pendant.is_some();
    let reach = match params.merge {
        MergeRule::Touch => a.1 + b.1,
        MergeRule::Paper => {
            let lighter = WATER * drops[i].volume.min(drops[k].volume) * params.g;
            (a.1 + b.1) * math::exp(-params.mu * lighter / params.k_h)
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
            let params = DropParams { merge, mu: 0.3, ..DropParams::default() };
            for _ in 0..60 {
                let mut drops = Vec::new();
                let mut places = Vec::new();
                for id in 0..40 {
                    let side = if draw.chance(0.8) { 1.0 } else { -1.0 };
                    let mut drop = SurfaceDrop::new(id, side, DVec2::ZERO, DVec3::ZERO, draw.range(1e-9, 3e-8));
                    drop.merge_tested = draw.chance(0.6);
                    drops.push(drop);
                    let p = DVec3::new(draw.range(-0.02, 0.02), draw.range(0.0, 0.08), draw.range(0.0, 0.001));
                    places.push(draw.chance(0.95).then(|| (p, draw.range(2e-4, 2e-3))));
                }
                let pairs = (0..40).flat_map(|i| (i + 1..40).map(move |k| (i, k)));
                let mut moved = pairs.filter(|(i, k)| !(drops[*i].merge_tested && drops[*k].merge_tested));
                let meant = moved.find(|pair| drops_touch(&drops, &places, *pair, &params));
                assert_eq!(first_touching_pair(&drops, &places, &params), meant);
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
            leaf.absorb(&mut kept, &gone);
            assert!((kept.volume / water - 1.0).abs() < 1e-12);
            assert!((kept.v * kept.volume - push).length() < 1e-12 * push.length());
            assert!(kept.uv.distance(middle) < 1e-12);
        }
    }
}
