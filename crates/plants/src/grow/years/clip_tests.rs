//! Compares clips of growth with trees grown to the same ages, and tests that nothing jumps.

use glam::Vec3;

use super::tests::{habit, leaf, spec};
use super::*;
use osier_base::math;
use osier_base::par::on_threads;

fn foliage(needles: bool) -> Foliage {
    if needles { Foliage::Needles(leaf()) } else { Foliage::Blades(leaf()) }
}

fn options(needles: bool) -> PlantOptions {
    PlantOptions { foliage: Some(foliage(needles)), materials: vec!["bark".into(); 2], ..PlantOptions::default() }
}

/// A clip at 24 frames a year.
fn clip_of(spec: &TreeSpec, span: ClipSpan, leaves: ClipLeaves) -> GrowthClip {
    let grown = grow_recorded(std::slice::from_ref(spec), &[Some(span)], &Site::default(), &Limits::default());
    let record = grown.expect("grows").pop().and_then(|g| g.record).expect("a record");
    let clip = ClipOptions { leaves, frame_years: 1.0 / 24.0 };
    let needles = spec.habit.leaf_area_shoot > 0.0;
    record.clip(&options(needles), clip, &Limits::default()).expect("a clip")
}

fn whole(age: f64) -> ClipSpan {
    ClipSpan { from: 0.0, to: age }
}

/// Distance of each leaf of a grown tree from the nearest leaf of a clip, m, in ascending order.
fn leaf_distances(clip: &GrowthClip, spec: &TreeSpec) -> Vec<f32> {
    let grown = grow(std::slice::from_ref(spec), &Site::default(), &Limits::default()).expect("grows").pop();
    let needles = spec.habit.leaf_area_shoot > 0.0;
    let plant = grown.expect("one").plant(&options(needles), &Limits::default()).expect("a plant");
    let pose = clip.pose(math::narrow(spec.age));
    let there: Vec<Vec3> = pose.leaves.iter().filter(|l| l.size > 0.0).map(|l| l.position).collect();
    assert_eq!(there.len(), plant.organs.len(), "leaves at {} years", spec.age);
    let nearest = |p: Vec3| there.iter().map(|q| q.distance(p)).fold(f32::MAX, f32::min);
    let mut off: Vec<f32> = plant.organs.iter().map(|o| nearest(plant.organ_site(o).0)).collect();
    off.sort_by(f32::total_cmp);
    off
}

#[test]
fn a_clip_shows_the_leaves_of_the_tree_of_each_age() {
    let grown = spec(14.0);
    let clip = clip_of(&grown, whole(14.0), ClipLeaves::Summer);
    // Leaves of the plant sit on its skeleton, which leaves out nodes beside a straight line: up to a quarter of the radius.
    for age in [5.0, 9.0, 14.0] {
        let off = leaf_distances(&clip, &TreeSpec { age, ..grown.clone() });
        let off = off[off.len() - 1];
        assert!(off < 0.02, "{off} at {age}");
    }
    // Leaves that live longer than a year remain in winter; their years are rounded up.
    for years in [3.0, 1.2] {
        let mut needles = grown.clone();
        for (key, value) in [("leaf_area_tip", 0.0), ("leaf_area_shoot", 0.05), ("leaf_years", years)] {
            needles.habit.set(key, &[value]).expect("a key");
        }
        let clip = clip_of(&needles, whole(14.0), ClipLeaves::Seasons);
        for age in [6.0, 14.0] {
            let off = leaf_distances(&clip, &TreeSpec { age, ..needles.clone() });
            let off = off[off.len() - 1];
            assert!(off < 0.02, "needles of {years} years {off} at {age}");
        }
    }
}

#[test]
fn years_between_the_stored_ones_are_near_those_that_were_grown() {
    // Every second of 50 years is stored; year 21 lies between two stored years.
    let grown = spec(50.0);
    let clip = clip_of(&grown, whole(50.0), ClipLeaves::Summer);
    let off = leaf_distances(&clip, &TreeSpec { age: 21.0, ..grown });
    // Measured: .012, .11 and .33 m.
    let at = |share: usize| off[(off.len() - 1) * share / 100];
    assert!(at(50) < 0.03 && at(99) < 0.15 && at(100) < 0.5, "{} {} {}", at(50), at(99), at(100));
}

#[test]
fn nothing_jumps_at_a_year_a_second() {
    for leaves in [ClipLeaves::Summer, ClipLeaves::Seasons] {
        let mut pruned = spec(16.0);
        pruned.prunes = vec![Prune {
            year: 12,
            every: 0,
            until: 12,
            keep: Keep::Box { min: Vec3::splat(-1.5), max: Vec3::new(1.5, 3.0, 1.5) },
        }];
        let clip = clip_of(&pruned, whole(16.0), leaves);
        let mut before = clip.pose(2.0);
        for frame in 1..=14 * 24_u16 {
            let now = clip.pose(2.0 + f32::from(frame) / 24.0);
            let seen = |r: f32| r > 1e-6;
            for i in (0..now.p.len()).filter(|i| seen(before.r[*i]) && seen(now.r[*i])) {
                // A shoot grows by at most 0.9 m a year; beyond that, 0.1 m a frame.
                let moved = now.p[i].distance(before.p[i]);
                assert!(moved < 0.1 + 0.9 / 24.0, "node {i} moved {moved} in frame {frame}");
            }
            for (i, (a, b)) in before.leaves.iter().zip(&now.leaves).enumerate() {
                // Leaves of a slot differ in size by up to 1.24 / 0.76.
                assert!((a.size - b.size).abs() < 0.3 * 1.63, "leaf {i}: {} to {} in frame {frame}", a.size, b.size);
                if a.size > 0.0 && b.size > 0.0 {
                    let moved = a.position.distance(b.position);
                    assert!(moved < 0.1 + 0.9 / 24.0, "leaf {i} moved {moved} in frame {frame}");
                }
            }
            before = now;
        }
    }
}

/// A hedge has thousands of cuts, and each frame looks up those of every node. The second box is smaller, so that its cuts go
/// through older wood than those of the first.
#[test]
fn cuts_of_a_recorded_tree_are_sorted_by_node_and_year() {
    let prune = |year: u32, half: f32, height: f32| Prune {
        year,
        every: 0,
        until: year,
        keep: Keep::Box { min: Vec3::splat(-half), max: Vec3::new(half, height, half) },
    };
    let mut hedge = spec(13.0);
    hedge.prunes = vec![prune(8, 1.5, 2.0), prune(11, 0.7, 1.0)];
    let grown = grow_recorded(&[hedge], &[Some(whole(13.0))], &Site::default(), &Limits::default());
    let record = grown.expect("grows").pop().and_then(|g| g.record).expect("a record");
    let mut tree = record.tree.clone();
    assert!([8, 11].iter().all(|year| tree.cuts.iter().any(|cut| cut.year == *year)), "{:?}", tree.cuts);
    assert!(tree.cuts.is_sorted_by_key(|cut| (cut.node, cut.year)), "{:?}", tree.cuts);
    // The lookup finds all cuts of a node, and no others.
    tree.cuts = [(3, 5), (3, 7), (9, 6)].map(|(node, year)| super::tree::CutThrough { node, year, length: 0.1 }).into();
    let years = [2, 3, 4, 9].map(|i| tree.cuts_through(i).map(|cut| cut.year).collect::<Vec<_>>());
    assert_eq!(years, [vec![], vec![5, 7], vec![], vec![6]]);
}

#[test]
fn crowns_are_bare_in_winter_and_full_in_summer() {
    let clip = clip_of(&spec(10.0), whole(10.0), ClipLeaves::Seasons);
    let shown = |age: f32| clip.pose(age).leaves.iter().filter(|l| l.size > 0.0).count();
    let grown = grow(&[spec(10.0)], &Site::default(), &Limits::default()).expect("grows").pop().expect("one");
    let all = grown.plant(&options(false), &Limits::default()).expect("a plant").organs.len();
    assert_eq!(shown(9.5), all);
    assert_eq!([shown(9.0), shown(10.0)], [0, 0]);
    assert!(shown(8.5) > 0 && shown(8.5) < all);
}

/// Leaves of dead tips must not fall before the leaves of new tips have unfolded: crowns would thin out for a frame or two of
/// each year.
#[test]
fn crowns_without_seasons_do_not_thin_out_within_a_year() {
    let clip = clip_of(&spec(14.0), whole(14.0), ClipLeaves::Summer);
    let area = |age: f32| {
        let leaves = clip.pose(age).leaves.into_iter().zip(&clip.plant.organs).map(|(l, organ)| l.size * organ.scale);
        leaves.map(|size| size * size).sum::<f32>()
    };
    for year in 8..14_u8 {
        let least = area(f32::from(year)).min(area(f32::from(year + 1)));
        for part in 1..24_u8 {
            let now = area(f32::from(year) + f32::from(part) / 24.0);
            assert!(now > 0.97 * least, "{now} of {least} in part {part} of year {year}");
        }
    }
}

#[test]
fn leaves_share_places_in_succession() {
    for leaves in [ClipLeaves::Seasons, ClipLeaves::Summer] {
        let clip = clip_of(&spec(20.0), whole(20.0), leaves);
        let most = (0..=400_u16).map(|k| {
            let pose = clip.pose(f32::from(k) / 20.0);
            pose.leaves.iter().filter(|l| l.size > 0.0).count()
        });
        let most = most.max().expect("some");
        let places = clip.plant.organs.len();
        assert!(places >= most && places < most * 6 / 5, "{places} places for {most} leaves");
    }
}

#[test]
fn a_stem_that_sprouts_late_bears_no_leaves_before() {
    let mut bush = spec(8.0);
    for (key, value) in [("stems", 3.0), ("stem_spread", 5.0), ("stem_years", 10.0)] {
        bush.habit.set(key, &[value]).expect("a key");
    }
    // The second of three stems sprouts at the end of year 4: ceil(10 (0.618 - 0.4) / 0.6). It is 5 sqrt(1.5 / 3) m from the
    // middle and more than 4 m from both others.
    let azimuth = math::GOLDEN_ANGLE_F32;
    let foot = Vec3::new(math::cos_f32(azimuth), 0.0, math::sin_f32(azimuth)) * (5.0 * 0.5_f32.sqrt());
    for leaves in [ClipLeaves::Summer, ClipLeaves::Seasons] {
        let clip = clip_of(&bush, whole(8.0), leaves);
        let near = |age: f32| {
            let pose = clip.pose(age);
            pose.leaves.iter().filter(|l| l.size > 0.0 && l.position.distance(foot) < 1.0).count()
        };
        assert_eq!((near(3.3), near(3.7)), (0, 0), "{leaves:?}");
        assert!(near(4.6) > 0, "{leaves:?}");
    }
    // A clip may end while a stem emerges from the ground.
    let clip = clip_of(&TreeSpec { age: 4.0, ..bush }, whole(3.95), ClipLeaves::Summer);
    assert_eq!(clip.plant.organs.len(), clip.pose(3.95).leaves.len());
}

#[test]
fn a_branch_that_falls_leaves_nothing_behind() {
    let mut dense = spec(20.0);
    dense.habit.set("clear_stem", &[2.5]).expect("a key");
    let clip = clip_of(&dense, whole(20.0), ClipLeaves::Summer);
    let fallen = clip.plant.axes.iter().filter(|a| a.parent == osier_scene::plant::NONE && a.order > 0).count();
    assert!(fallen > 3, "{fallen} axes fell");
    let end = clip.pose(20.0);
    let grown = grow(&[dense], &Site::default(), &Limits::default()).expect("grows").pop().expect("one");
    let plant = grown.plant(&options(false), &Limits::default()).expect("a plant");
    let low = |p: &[Vec3], r: &[f32]| {
        (0..p.len()).filter(|i| r[*i] > 0.0 && p[*i].y < 1.8 && p[*i].x.hypot(p[*i].z) > 0.6).count()
    };
    assert_eq!(low(&end.p, &end.r), low(&plant.nodes.p, &plant.nodes.r));
}

#[test]
fn a_clip_may_begin_late_end_early_and_run_backwards() {
    let tree = spec(16.5);
    let late = clip_of(&tree, ClipSpan { from: 12.0, to: 16.0 }, ClipLeaves::Summer);
    let whole = clip_of(&tree, whole(16.0), ClipLeaves::Summer);
    // The clip contains no axes that fell before it begins.
    assert!(late.plant.axes.len() < whole.plant.axes.len());
    assert_eq!(late.span().to.to_bits(), 16.0_f64.to_bits());
    let backwards = clip_of(&tree, ClipSpan { from: 16.0, to: 12.0 }, ClipLeaves::Summer);
    assert_eq!(backwards.plant.axes.len(), late.plant.axes.len());
    // Before the seed no wood exists.
    let pose = whole.pose(-1.0);
    assert!(pose.r.iter().all(|r| *r <= 0.0) && pose.leaves.iter().all(|l| l.size <= 0.0));
}

#[test]
fn a_clip_is_the_same_on_any_number_of_threads_and_beside_unrecorded_trees() {
    let bits = |pose: &PoseNow| -> Vec<u32> {
        let leaves = pose.leaves.iter().flat_map(|l| l.position.to_array());
        pose.p.iter().flat_map(|p| p.to_array()).chain(leaves).map(f32::to_bits).collect()
    };
    let on =
        |threads: usize| on_threads(threads, || bits(&clip_of(&spec(12.0), whole(12.0), ClipLeaves::Summer).pose(7.3)));
    assert_eq!(on(1), on(5));
    // Two trees in one field: recording one of them changes neither.
    let pair = [spec(12.0), TreeSpec { base: Vec3::X * 3.0, id: 9, habit: habit(), ..spec(8.0) }];
    let grown = |spans: &[Option<ClipSpan>]| {
        let trees = grow_recorded(&pair, spans, &Site::default(), &Limits::default()).expect("grows");
        trees.iter().map(|t| t.tree.measures()).collect::<Vec<_>>()
    };
    assert_eq!(grown(&[]), grown(&[Some(ClipSpan { from: 0.0, to: 12.0 }), None]));
}
