//! Coalescence: drops that touch merge into one.

use glam::DVec3;

use crate::rain::drops::rain_leaf::{LeafStep, LeafStepResult, RainLeaf};
use crate::rain::drops::spherical_cap::CapLaw;
use crate::rain::drops::surface_drop::LeafDrop;
use crate::rain::event::{DropEventKind, RainEvent};
use crate::rain::params::{DropParams, MergeRule};
use crate::rain::tuning::{MAX_ATTRACTION, SWEEP_TOLERANCE};
use osier_base::math;
use osier_base::physics::WATER_DENSITY;

/// The circle by which a drop touches others, in leaf space.
#[derive(Debug, Clone, Copy)]
struct ContactCircle {
    /// Center in leaf space, m.
    p: DVec3,
    /// Base radius of the head, or radius of attachment of a pendant drop, m.
    radius: f64,
}

impl RainLeaf {
    /// Merges drops that touch, pair by pair, until no two drops touch: the heavier absorbs the lighter.
    /// Source: [yang-wu] eq. 13; eq. 12 with [`MergeRule::Paper`].
    pub(super) fn merge_drops(&self, drops: &mut Vec<LeafDrop>, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        let params = step.params;
        drops.sort_by_key(|d| d.id);
        // If no drop has moved since the last test, no new contact is possible.
        if drops.iter().all(|d| d.merge_tested) {
            return;
        }
        // A drop without a contact circle lies beyond the blade and touches no other drop.
        let law = &params.wetting.cap_law();
        let mut circles: Vec<Option<ContactCircle>> =
            drops.iter().map(|d| self.contact_circle(d, law, params)).collect();
        while let Some(DropPair { first: i, second: k }) = first_touching_pair(drops, &circles, params) {
            // The heavier drop keeps its identifier and its place in the list.
            let (heavy, light) = if drops[k].volume > drops[i].volume { (k, i) } else { (i, k) };
            let gone = drops[light].clone();
            result.counters.mergers += 1;
            let before = (drops[heavy].v * drops[heavy].volume + gone.v * gone.volume) * WATER_DENSITY;
            self.absorb(&mut drops[heavy], &gone);
            circles[heavy] = self.contact_circle(&drops[heavy], law, params);
            let p = circles[heavy].map_or(step.pose.position, |circle| step.world_point(circle.p));
            let kept = &drops[heavy];
            // The attachment of a pendant drop stops a drop that runs into it: the leaf takes up its momentum.
            if kept.pendant.is_some() {
                result.record_reaction(step, p, kept.v * (WATER_DENSITY * kept.volume) - before);
            }
            let event = RainEvent::new(DropEventKind::Merged, kept.id, step.t, p, kept.volume);
            result.events.push(RainEvent { other: Some(gone.id), ..event });
            drops.remove(light);
            circles.remove(light);
        }
        drops.iter_mut().for_each(|d| d.merge_tested = true);
    }

    /// Forces by which drops on the same side attract each other, in leaf space, N, parallel to `drops`; zero except with
    /// [`MergeRule::Paper`], by which drops overlap before they merge. Source: [yang-wu] eq. 12, k ln(d0 / d), where d0 is the
    /// distance at which they touch; limited to [`MAX_ATTRACTION`] k.
    pub(super) fn attractions(&self, drops: &[LeafDrop], params: &DropParams) -> Vec<DVec3> {
        let mut forces = vec![DVec3::ZERO; drops.len()];
        if params.merge != MergeRule::Paper {
            return forces;
        }
        let law = &params.wetting.cap_law();
        let circles: Vec<Option<ContactCircle>> = drops.iter().map(|d| self.contact_circle(d, law, params)).collect();
        for (i, a) in circles.iter().enumerate() {
            for (k, b) in circles.iter().enumerate().skip(i + 1) {
                let (Some(a), Some(b)) = (a, b) else { continue };
                let (apart, touching) = (b.p - a.p, a.radius + b.radius);
                let distance = apart.length();
                if distance >= touching || !on_one_side(&drops[i], &drops[k]) {
                    continue;
                }
                let strength = math::ln(touching / distance.max(f64::MIN_POSITIVE)).min(MAX_ATTRACTION);
                let force = apart.normalize_or_zero() * (params.attraction_force * strength);
                forces[i] += force;
                forces[k] -= force;
            }
        }
        forces
    }

    fn contact_circle(&self, drop: &LeafDrop, law: &CapLaw, params: &DropParams) -> Option<ContactCircle> {
        match drop.pendant {
            Some(anchor) => Some(ContactCircle { p: anchor.margin.p, radius: anchor.radius }),
            None => {
                let radius = drop.head_cap_by_law(law, params).a;
                self.surface_under(drop).map(|surface| ContactCircle { p: surface.p, radius })
            }
        }
    }

    /// Merges `light` into `heavy`: volumes add, momentum is conserved, the new center is the center of mass. If either drop is
    /// pendant, the result is pendant.
    fn absorb(&self, heavy: &mut LeafDrop, light: &LeafDrop) {
        let volume = heavy.volume + light.volume;
        // Density is constant, so that fractions of volume weight the center of mass and momentum.
        let share = light.volume / volume;
        if heavy.pendant.is_none() {
            if light.pendant.is_some() {
                // The attachment at the margin holds both.
                heavy.clear_history();
                heavy.pendant = light.pendant;
                heavy.v = DVec3::ZERO;
            } else {
                let center = heavy.uv.lerp(light.uv, share);
                let offset = self.point_at(heavy.uv).zip(self.point_at(light.uv)).map(|(a, b)| b.p - a.p);
                if self.point_at(center).is_some() {
                    heavy.uv = center;
                }
                heavy.v = heavy.v.lerp(light.v, share);
                // The merged drop begins stretched along the line between the two, then relaxes.
                heavy.since_merge = 0.0;
                heavy.axis = offset.unwrap_or(heavy.axis).normalize_or(heavy.axis);
            }
        }
        heavy.volume = volume;
        heavy.merge_tested = false;
        heavy.last_wet_uv = None;
        heavy.last_wet_p = None;
    }
}

/// Indices of two drops, the smaller first; pairs are ordered by the first, then by the second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct DropPair {
    first: usize,
    second: usize,
}

/// The first pair of drops that touch, in the order of their indices. Only pairs with a drop that has moved are tested.
fn first_touching_pair(drops: &[LeafDrop], circles: &[Option<ContactCircle>], params: &DropParams) -> Option<DropPair> {
    // Sweep and prune: sort the centers along the leaf; the largest radius bounds how far from a drop another can touch it.
    let mut sorted: Vec<(f64, usize)> =
        (0..).zip(circles).filter_map(|(i, circle)| Some((circle.as_ref()?.p.y, i))).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let max_radius = circles.iter().flatten().fold(0.0, |m: f64, circle| m.max(circle.radius));
    let mut first: Option<DropPair> = None;
    for (moved, circle) in circles.iter().enumerate().filter(|(i, _)| !drops[*i].merge_tested) {
        let Some(ContactCircle { p, radius }) = circle else { continue };
        let reach = (radius + max_radius) * (1.0 + SWEEP_TOLERANCE);
        let from = sorted.partition_point(|(y, _)| *y < p.y - reach);
        for &(_, other) in sorted[from..].iter().take_while(|(y, _)| *y <= p.y + reach) {
            let pair = DropPair { first: moved.min(other), second: moved.max(other) };
            if moved != other && first.is_none_or(|f| pair < f) && drops_touch(drops, circles, pair, params) {
                first = Some(pair);
            }
        }
    }
    first
}

/// Whether two drops are on the same side of the leaf. A pendant drop, at the margin, is on both.
fn on_one_side(a: &LeafDrop, b: &LeafDrop) -> bool {
    a.pendant.is_some() || b.pendant.is_some() || a.side * b.side > 0.0
}

/// Whether two drops on the same side of the leaf touch.
fn drops_touch(drops: &[LeafDrop], circles: &[Option<ContactCircle>], pair: DropPair, params: &DropParams) -> bool {
    let DropPair { first: i, second: k } = pair;
    let (Some(a), Some(b)) = (circles[i], circles[k]) else { return false };
    let reach = match params.merge {
        MergeRule::Touch => a.radius + b.radius,
        // Eq. 12: the attraction k ln(d0 / d) exceeds the friction mu m g of the lighter drop below d = d0 exp(-mu m g / k).
        MergeRule::Paper => {
            let lighter = WATER_DENSITY * drops[i].volume.min(drops[k].volume) * params.g;
            (a.radius + b.radius) * math::exp(-params.friction_coefficient * lighter / params.attraction_force)
        }
    };
    a.p.distance(b.p) <= reach && on_one_side(&drops[i], &drops[k])
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
            let params = DropParams { merge, friction_coefficient: 0.3, ..DropParams::default() };
            for _ in 0..60 {
                let mut drops = Vec::new();
                let mut circles = Vec::new();
                for id in 0..40 {
                    let side = if draw.chance(0.8) { 1.0 } else { -1.0 };
                    let mut drop = LeafDrop::new(id, side, DVec2::ZERO, DVec3::ZERO, draw.range(1e-9, 3e-8));
                    drop.merge_tested = draw.chance(0.6);
                    drops.push(drop);
                    let p = DVec3::new(draw.range(-0.02, 0.02), draw.range(0.0, 0.08), draw.range(0.0, 0.001));
                    circles.push(draw.chance(0.95).then(|| ContactCircle { p, radius: draw.range(2e-4, 2e-3) }));
                }
                let pairs = (0..40).flat_map(|i| (i + 1..40).map(move |k| DropPair { first: i, second: k }));
                let mut moved =
                    pairs.filter(|pair| !(drops[pair.first].merge_tested && drops[pair.second].merge_tested));
                let meant = moved.find(|pair| drops_touch(&drops, &circles, *pair, &params));
                assert_eq!(first_touching_pair(&drops, &circles, &params), meant);
                found += usize::from(meant.is_some());
            }
        }
        assert!((20..120).contains(&found), "{found} of 120 have a pair");
    }

    #[test]
    fn one_drop_has_all_the_water_and_momentum_of_both() {
        let blade = LeafSurface::new(&flat(0.08, 0.04, 4)).expect("a blade");
        let leaf = RainLeaf::new(Arc::new(blade), 1.0, 0);
        let mut draw = Rng::at(8, &["merge".into()]);
        for id in 0..500 {
            let mut one = |most: f64| {
                let uv = DVec2::new(draw.range(0.1, 0.9), draw.range(0.1, 0.9));
                let v = DVec3::new(draw.range(-0.5, 0.5), draw.range(-0.5, 0.5), 0.0);
                LeafDrop::new(id, 1.0, uv, v, draw.range(1e-11, most))
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

    #[test]
    fn overlapping_drops_attract_each_other_by_the_papers_law() {
        let leaf = RainLeaf::new(Arc::new(LeafSurface::new(&flat(0.08, 0.04, 4)).expect("a blade")), 1.0, 0);
        let paper = DropParams { merge: MergeRule::Paper, ..DropParams::default() };
        let pair = |apart: f64, side: f64| {
            let at = |v: f64, side: f64, volume: f64| LeafDrop::new(1, side, DVec2::new(0.5, v), DVec3::ZERO, volume);
            [at(0.5, 1.0, 9e-9), at(0.5 + apart / 0.08, side, 3e-9)]
        };
        let touching: f64 = pair(0.0, 1.0).iter().map(|d| d.head_cap(&paper).a).sum();
        for (share, strength) in [(0.9, math::ln(1.0 / 0.9)), (0.5, math::ln(2.0)), (1e-3, MAX_ATTRACTION), (1.01, 0.0)]
        {
            let forces = leaf.attractions(&pair(share * touching, 1.0), &paper);
            let wanted = DVec3::Y * (strength * paper.attraction_force);
            assert!((forces[0] - wanted).length() < 1e-6 * paper.attraction_force, "{share}: {forces:?}");
            assert!(forces[0] == -forces[1]);
        }
        // No attraction through the leaf, and none by the other rule.
        assert!(leaf.attractions(&pair(0.5 * touching, -1.0), &paper).iter().all(|f| *f == DVec3::ZERO));
        let touch = DropParams::default();
        assert!(leaf.attractions(&pair(0.5 * touching, 1.0), &touch).iter().all(|f| *f == DVec3::ZERO));
    }
}
