//! Whole flights.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::*;
use osier_base::rng::Rng;
use osier_scene::solid::{Form, LandForm, Prism, Solid};
use osier_wind::{GustWind, GustWindOptions, InletWind, LatticeOptions, UniformWind, Wind};

fn wall_and_house() -> Arc<Solids> {
    let solid = |name: &str, prism| Solid { name: name.into(), form: Form::Prism(prism), humidity: 0.5 };
    let wall = Prism::block(Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.4, 4.0, 30.0), 0.0);
    let house = Prism::house(Vec3::new(-6.0, 0.0, 3.0), Vec3::new(8.0, 4.0, 6.0), 2.5, 0.5);
    Arc::new(Solids::new(vec![solid("wall", wall), solid("house", house)], true))
}

fn gusts(speed: f64) -> GustWind {
    GustWind::new(GustWindOptions { direction: Vec3::X, speed, seed: 4, ..GustWindOptions::default() })
}

fn flights(n: u32, options: FlightParams, solids: &Arc<Solids>) -> FlightSimulation {
    let band = [0.02, 0.5];
    let sky_box = SkyRelease { seed: options.seed, count: n, inside: options.inside, band, duration: 0.0 };
    let starts = sky_starts(&sky_box, solids);
    FlightSimulation::new(options, Arc::clone(solids), &starts)
}

/// At every frame no catkin penetrates a solid, and all catkins have a state; for several time steps.
#[test]
fn no_catkin_penetrates_solids_or_is_lost() {
    let solids = wall_and_house();
    let wind = gusts(3.0);
    for substeps in [1, 2, 5] {
        let humidity = GroundHumidity::Even(0.7);
        let mut all =
            flights(2000, FlightParams { substeps, humidity, stick_radius: 0.2, ..FlightParams::default() }, &solids);
        let frames = if substeps == 1 { 240 } else { 96 };
        for frame in 0..frames {
            all.advance_frame(&wind);
            let t = all.stats();
            assert_eq!(t.pending + t.airborne + t.deposited() + t.exited, 2000);
            assert_eq!(t.penetrations, 0, "frame {frame} at {substeps} substeps");
            let inside = |c: &&Catkin| c.state == CatkinState::Airborne && solids.contains(c.x.as_vec3());
            assert_eq!(all.by_id().filter(inside).count(), 0, "frame {frame} at {substeps} substeps");
        }
        let t = all.stats();
        assert!(t.deposited() > 100 && t.merges > 20 && t.grounded > 0, "{t:?}");
        assert!(all.by_id().any(|c| c.face == Some(0)) && all.by_id().any(|c| c.face == Some(1)));
    }
}

/// A house of 10 x 8 m whose roof of 3 in 4 projects from its walls by 0.35 m down the slope, with or without that.
fn house(eaves: bool) -> Arc<Solids> {
    let house = Prism::house(Vec3::ZERO, Vec3::new(10.0, 5.0, 8.0), 3.0, 0.0);
    let slabs = if eaves { house.roof_slabs(0.35, 0.16) } else { Vec::new() };
    let solid = |prism| Solid { name: "house".into(), form: Form::Prism(prism), humidity: 0.5 };
    let slabs = slabs.into_iter().map(solid).collect();
    Arc::new(Solids::new(vec![solid(house)], true).with_projections(vec![slabs]))
}

/// A catkin that falls straight in calm air.
fn plumb(at: DVec3, solids: &Arc<Solids>) -> FlightSimulation {
    let humidity = GroundHumidity::Even(1.0);
    let options = FlightParams {
        glide: 0.0,
        flutter: 0.0,
        scales: [1.0, 1.0],
        fall_spread: 0.0,
        humidity,
        ..FlightParams::default()
    };
    let start = CatkinStart { at, wait: ReleaseCondition::Until(0.0) };
    FlightSimulation::new(options, Arc::clone(solids), &[start])
}

#[test]
fn eaves_stop_what_falls_on_them() {
    let calm = UniformWind(Vec3::ZERO);
    for (eaves, height) in [(true, 4.8875), (false, 0.0)] {
        let mut all = plumb(DVec3::new(0.0, 5.5, 4.15), &house(eaves));
        (0..30 * 24).for_each(|_| all.advance(&calm));
        let c = all.catkin(0);
        assert_eq!(c.state(), CatkinState::Grounded);
        assert!((c.x.y - height).abs() < 0.05 && (c.x.z - 4.15).abs() < 0.03, "{} with eaves: {eaves}", c.x);
        assert!(c.face == eaves.then_some(0) && all.stats().penetrations == 0);
    }
}

#[test]
fn catkins_detach_from_the_underside_of_eaves() {
    let solids = house(true);
    let radius = f64::from(FlightParams::default().kinds[0].radius);
    // 0.3 m out along the slope, touching from below.
    let at = DVec3::new(0.0, 5.0 - 0.6 * 0.3, 4.0 + 0.8 * 0.3) - DVec3::new(0.0, 0.8, 0.6) * (0.16 + radius);
    let mut all = plumb(at, &solids);
    let contact = super::collision::surface_contact(&solids, at, all.catkin(0).radius).expect("the underside");
    all.catkin_mut(0).rest_on(contact);
    assert!(all.catkin(0).state() == CatkinState::OnWall && all.catkin(0).normal.y < -0.7);
    (0..24).for_each(|_| all.advance(&UniformWind(Vec3::ZERO)));
    let c = all.catkin(0);
    assert!(c.state() == CatkinState::Airborne && all.stats().falls == 1, "{:?}", c.state());
    assert!(at.y - c.x.y > 0.15 && (c.x.z - at.z).abs() < 1e-3, "from {at} to {}", c.x);
}

/// Catkins in calm air in a box of 35 m with periodic sides.
fn across_sides(places: [DVec3; 2]) -> FlightSimulation {
    let options = FlightParams {
        edges: [SideBoundary::Periodic; 2],
        glide: 0.0,
        flutter: 0.0,
        scales: [1.0, 1.0],
        fall_spread: 0.0,
        humidity: GroundHumidity::Even(1.0),
        ..FlightParams::default()
    };
    let starts = places.map(|at| CatkinStart { at, wait: ReleaseCondition::Until(0.0) });
    FlightSimulation::new(options, Arc::new(Solids::new(Vec::new(), true)), &starts)
}

/// A catkin that falls on a deposit beyond a periodic side joins it there.
#[test]
fn contacts_with_deposits_reach_across_periodic_sides() {
    let radius = f64::from(FlightParams::default().kinds[0].radius);
    // The deposit has the higher index, then the lower one.
    for deposit in [1, 0] {
        let mut places = [DVec3::new(-17.498, 0.3, 2.0); 2];
        places[deposit] = DVec3::new(17.468, radius, 2.0);
        let mut all = across_sides(places);
        let [lies, falls] = [deposit, 1 - deposit].map(|id| u32::try_from(id).expect("small"));
        let contact = super::collision::surface_contact(&all.solids, all.catkin(lies).x, all.catkin(lies).radius);
        all.catkin_mut(lies).rest_on(contact.expect("the ground"));
        (0..48).for_each(|_| all.advance(&UniformWind(Vec3::ZERO)));
        let at = [lies, falls].map(|id| all.catkin(id).x.x);
        assert!(all.stats().merges == 1 && all.stats().grounded == 2, "{at:?}");
        assert!((at[0] - 17.468).abs() < 1e-6 && (at[1] - 17.5).abs() < 0.05, "{at:?}");
        assert!(all.by_id().all(|c| c.flight_distance() < 0.1));
    }
}

#[test]
fn pairs_that_meet_across_a_periodic_side_keep_their_distance_from_the_release() {
    let mut all = across_sides([17.49, -17.49].map(|x| DVec3::new(x, 9.0, 2.0)));
    (0..24).for_each(|_| all.advance(&UniformWind(Vec3::ZERO)));
    assert!(all.stats().merges == 1 && all.by_id().all(|c| c.flight_distance() < 0.1));
}

#[test]
fn merging_conserves_momentum() {
    let mut all =
        flights(10_001, FlightParams { cluster_rotation: false, ..FlightParams::default() }, &wall_and_house());
    let mut draw = Rng::at(1, &["merge".into()]);
    for c in &mut all.catkins {
        c.v = DVec3::new(draw.normal(), draw.normal(), draw.normal()) + DVec3::X * 2.0;
        c.state = CatkinState::Airborne;
    }
    let momentum = |all: &FlightSimulation| {
        let single = all.by_id().filter(|c| !c.clustered).map(|c| c.v * c.mass).sum::<DVec3>();
        single + all.clusters.values().map(|k| k.v * k.mass).sum::<DVec3>()
    };
    let before = momentum(&all);
    while all.counters.merges < 10_000 {
        let pick = |draw: &mut Rng| draw.below(10_001);
        // Most catkins are in one heap by then: search the indices for one that is not.
        let (i, j) = (pick(&mut draw), pick(&mut draw));
        let other = (0..10_001).map(|k| (j + k) % 10_001).find(|k| all.catkin(*k).root != all.catkin(i).root);
        all.join_catkins(i, other.expect("not yet all one"), 0.0);
    }
    assert!((momentum(&all) - before).length() < 1e-6 * before.length());
    assert_eq!((all.clusters.len(), all.stats().largest), (1, 10_001));
    assert!(all.by_id().all(|c| c.root == 0));
}

#[test]
fn contraction_keeps_the_centre_of_mass() {
    let mut all = flights(2, FlightParams { cluster_rotation: false, ..FlightParams::default() }, &wall_and_house());
    let places = [DVec3::new(0.0, 20.0, 0.0), DVec3::new(0.3, 20.0, 0.1)];
    places.iter().zip(0..).for_each(|(p, i)| all.catkin_mut(i).x = *p);
    let centre = |all: &FlightSimulation| {
        let sum = all.by_id().map(|c| c.x * c.mass).sum::<DVec3>();
        sum / all.by_id().map(|c| c.mass).sum::<f64>()
    };
    let before = centre(&all);
    all.join_catkins(0, 1, 0.0);
    assert!(centre(&all).distance(before) < 1e-12);
    let still = UniformWind(Vec3::ZERO);
    for _ in 0..24 * 8 {
        all.advance(&still);
        let moved = centre(&all) - all.clusters[&0].x;
        assert!(moved.length() < 1e-9, "{moved}");
    }
    let (a, b) = (all.catkin(0), all.catkin(1));
    let close = 0.8 * f64::from(a.radius + b.radius);
    assert!((a.x.distance(b.x) - close).abs() < 1e-4, "{} {close}", a.x.distance(b.x));
}

/// Ten catkins that stick together move as one rigid body once their bonds have contracted.
#[test]
fn clusters_move_rigidly() {
    for (cluster_rotation, within) in [(false, 1e-6), (true, 1e-5)] {
        let inside =
            osier_base::geometry::Bounds { min: Vec3::new(-500.0, 0.0, -500.0), max: Vec3::new(500.0, 500.0, 500.0) };
        let options = FlightParams { cluster_rotation, inside, ..FlightParams::default() };
        let mut all = flights(10, options, &Arc::new(Solids::default()));
        let mut draw = Rng::at(2, &["ten".into()]);
        for id in 0..10 {
            all.catkin_mut(id).x = DVec3::new(draw.unit_f64(), 400.0 + draw.unit_f64(), draw.unit_f64());
        }
        (1..10).for_each(|id| all.join_catkins(id - 1, id, 0.0));
        let wind = gusts(2.0);
        (0..400).for_each(|_| all.advance(&wind));
        let shape = |all: &FlightSimulation| -> Vec<DVec3> {
            let first = all.catkin(0).x;
            all.by_id().map(|c| c.x - first).collect()
        };
        let before = shape(&all);
        (0..1000).for_each(|_| all.advance(&wind));
        for (a, b) in before.iter().zip(shape(&all)) {
            let error = if cluster_rotation { (a.length() - b.length()).abs() } else { a.distance(b) };
            assert!(error < within, "{error}");
        }
        assert!(all.stats().airborne == 10 && (!cluster_rotation || before[9].distance(shape(&all)[9]) > 1e-3));
    }
}

fn fingerprint(sample: &FlightFrame) -> u64 {
    let bits =
        sample.positions.iter().flat_map(|p| p.to_array()).chain(sample.orientations.iter().flat_map(|q| q.to_array()));
    let all = bits.map(|v| u64::from(v.to_bits())).chain(sample.clusters.iter().map(|c| u64::from(*c)));
    all.fold(0, osier_base::rng::child)
}

/// Results have the same bits for any number of threads and any order in memory.
#[test]
fn results_are_independent_of_order_and_threads() {
    let solids = wall_and_house();
    let run = |threads: usize, sorted: bool| {
        osier_base::par::on_threads(threads, || {
            let humidity = GroundHumidity::Even(0.0);
            let options = FlightParams { stick_radius: 0.2, humidity, sorted, ..FlightParams::default() };
            let mut all = flights(6000, options, &solids);
            let wind = gusts(3.0);
            (0..72).for_each(|_| all.advance_frame(&wind));
            (fingerprint(&all.frame()), all.stats())
        })
    };
    let reference = run(1, true);
    assert!(reference.1.merges > 50 && reference.1.lift_offs > 20, "{:?}", reference.1);
    for (threads, sorted) in [(2, true), (16, true), (1, false), (5, false)] {
        assert_eq!(run(threads, sorted), reference, "{threads} threads, sorted: {sorted}");
    }
}

/// The wetter the ground, the more deposits it holds and the fewer lift off; ground of humidity 1 holds all.
#[test]
fn wet_ground_holds_more_catkins() {
    for seed in 0..8 {
        let runs = [0.0, 0.1, 0.2, 0.3, 1.0].map(|h| {
            let options = FlightParams { seed, humidity: GroundHumidity::Even(h), ..FlightParams::default() };
            let mut all = flights(300, options, &Arc::new(Solids::new(Vec::new(), true)));
            let wind = gusts(2.0);
            let mut held = 0;
            for _ in 0..360 {
                all.advance_frame(&wind);
                held += all.by_id().filter(|c| c.state.is_deposited()).count();
            }
            (held as f64 + 1.0, all.stats().lift_offs as f64)
        });
        let rates = runs.map(|(held, lifted)| lifted / held);
        assert!(runs.windows(2).all(|p| p[0].0 < p[1].0), "seed {seed}: {runs:?}");
        assert!(rates.windows(2).all(|p| p[0] > p[1]) && runs[4].1 < 0.5, "seed {seed}: {runs:?}");
    }
}

/// Counts of a flight in gusts, summed over `seeds` seeds, with `substeps`: lift-offs, mergers, deposited and clustered catkins,
/// the last two as means over the frames.
fn counted_in_gusts(seeds: u64, substeps: u32, humidity: f64) -> [f64; 4] {
    let inside = osier_base::geometry::Bounds { min: Vec3::new(-8.0, 0.0, -8.0), max: Vec3::new(8.0, 8.0, 8.0) };
    let mut sums = [0.0; 4];
    for seed in 0..seeds {
        let options = FlightParams {
            seed,
            substeps,
            inside,
            edges: [SideBoundary::Periodic; 2],
            humidity: GroundHumidity::Even(humidity),
            ..FlightParams::default()
        };
        let mut all = flights(400, options, &Arc::new(Solids::new(Vec::new(), true)));
        let wind = gusts(3.0);
        for _ in 0..240 {
            all.advance_frame(&wind);
            let t = all.stats();
            sums[2] += t.deposited() as f64 / 240.0;
            sums[3] += (400 - t.singles) as f64 / 240.0;
        }
        let t = all.stats();
        assert_eq!(t.deposits, t.lift_offs + t.falls + t.deposited());
        sums[0] += t.lift_offs as f64;
        sums[1] += t.merges as f64;
    }
    sums
}

/// Counts with the default step and with a quarter of it, summed over `seeds` seeds, differ by at most 5 %; those that follow from
/// mergers, of which there are few, by no more than 5 % and the standard deviation of their difference.
fn assert_independent_of_the_step(seeds: u64, humidity: f64) {
    let [whole, quarter] = [1, 4].map(|substeps| counted_in_gusts(seeds, substeps, humidity));
    // Two counts of mergers differ by chance by the root of their sum, and what is clustered by as large a share.
    let chance = osier_base::math::sqrt(1.0 / whole[1] + 1.0 / quarter[1]);
    for (k, (a, b)) in whole.iter().zip(&quarter).enumerate() {
        let most = if k == 1 || k == 3 { 0.05 + chance } else { 0.05 };
        assert!((a - b).abs() < most * b && *b > 50.0, "{whole:?} {quarter:?} at {humidity}");
    }
}

/// Lift-offs, mergers and deposits do not depend on the time step.
#[test]
fn counts_are_independent_of_the_step() {
    for humidity in [0.0, 0.3] {
        assert_independent_of_the_step(8, humidity);
    }
}

/// Over many seeds chance is a few percent, so that a trend of mergers with the step would show.
#[test]
#[ignore = "twenty seconds; tests/full.sh runs it"]
fn counts_of_many_seeds_are_independent_of_the_step() {
    assert_independent_of_the_step(64, 0.0);
}

/// What would come down beyond a side in the step in which it leaves has not landed: it is recycled, or counts as left, alone and in
/// a cluster. At periodic sides it lands on the other side of the box.
#[test]
fn nothing_lands_outside_of_the_box() {
    use SideBoundary::{Exit, Periodic, Recycle};
    for (edge, count) in [Exit, Recycle, Periodic].into_iter().flat_map(|edge| [(edge, 1), (edge, 2)]) {
        // So wet that what has landed stays.
        let humidity = GroundHumidity::Even(1.0);
        let options = FlightParams {
            edges: [edge; 2],
            humidity,
            fall_spread: 0.0,
            scales: [1.0, 1.0],
            ..FlightParams::default()
        };
        let places = [0.0, 0.03].map(|z| DVec3::new(17.3, 0.1, z));
        let starts = places.map(|at| CatkinStart { at, wait: ReleaseCondition::Until(0.0) });
        let mut all = FlightSimulation::new(options, Arc::new(Solids::new(Vec::new(), true)), &starts[..count]);
        for c in &mut all.catkins {
            c.v = DVec3::new(20.0, -6.0, 0.0);
        }
        if count == 2 {
            all.join_catkins(0, 1, 0.0);
        }
        let wind = UniformWind(Vec3::X * 30.0);
        all.advance(&wind);
        let (t, n) = (all.stats(), count as u64);
        if edge == Periodic {
            assert_eq!((t.deposits, t.deposited(), t.left), (n, n, 0), "{count}");
            assert!(all.by_id().all(|c| c.x.x < 0.0));
            continue;
        }
        assert_eq!((t.deposits, t.left, t.exited), (0, n, n), "{edge:?} {count}");
        (0..4).for_each(|_| all.advance(&wind));
        assert_eq!(all.stats().recycled, if edge == Recycle { n } else { 0 }, "{count}");
    }
}

/// A catkin that leaves the box is hidden until it reenters, and has then the next generation.
#[test]
fn recycled_catkins_are_hidden_while_they_move() {
    // Times of the last two frame rates are no whole multiples of a frame in floating point.
    for fps in [24.0, 25.0, 29.97] {
        let mut all = flights(300, FlightParams { fps, ..FlightParams::default() }, &wall_and_house());
        let wind = gusts(5.0);
        let mut before = all.frame();
        let mut hidden_for = vec![0_u32; 300];
        for _ in 0..240 {
            all.advance_frame(&wind);
            let now = all.frame();
            for (i, hidden) in hidden_for.iter_mut().enumerate() {
                let seen = now.states[i].is_seen();
                if seen && *hidden > 0 {
                    let next = now.generations[i] == before.generations[i] + 1;
                    assert!(*hidden == 2 && next, "{hidden} frames at {fps} a second");
                }
                // A catkin that is visible in two successive frames does not jump between them.
                if seen && before.states[i].is_seen() {
                    assert!(now.positions[i].distance(before.positions[i]) < 1.0);
                }
                *hidden = if seen { 0 } else { *hidden + 1 };
            }
            before = now;
        }
        assert!(all.stats().recycled > 30);
    }
}

/// Catkins of one size that fall straight and stick to each other within 0.2 m, in clusters that do not turn.
fn alike_and_sticky() -> FlightParams {
    FlightParams {
        scales: [1.0, 1.0],
        fall_spread: 0.0,
        glide: 0.0,
        cluster_rotation: false,
        stick_radius: 0.2,
        ..FlightParams::default()
    }
}

/// A pair leaves through a side where catkins are recycled, while one of the two is still inside; both come back, whatever the
/// condition of the other sides.
#[test]
fn all_members_of_a_cluster_are_recycled() {
    for other in [SideBoundary::Periodic, SideBoundary::Exit, SideBoundary::Recycle] {
        let options = FlightParams {
            // Steps of 8 mm, half as long as members are apart along the wind.
            substeps: 16,
            edges: [SideBoundary::Recycle, other],
            ..alike_and_sticky()
        };
        let starts = [16.9, 17.1].map(|x| DVec3::new(x, 20.0, 0.0));
        let starts = starts.map(|at| CatkinStart { at, wait: ReleaseCondition::Until(0.0) });
        let mut all = FlightSimulation::new(options, Arc::new(Solids::default()), &starts);
        let wind = UniformWind(Vec3::X * 3.0);
        (0..2).for_each(|_| all.advance_frame(&wind));
        assert_eq!(all.stats().clusters, 1);
        (0..22).for_each(|_| all.advance_frame(&wind));
        let t = all.stats();
        assert_eq!((t.left, t.recycled, t.airborne, t.exited), (2, 2, 2, 0), "{other:?}");
    }
}

/// Recycled catkins reenter with the speed that a speed curve has at that time, in a lull through the side where the wind blew in.
#[test]
fn recycled_catkins_reenter_with_the_speed_of_the_moment() {
    let lattice = LatticeOptions::default();
    let mut inlet = lattice.inlet;
    (inlet.direction, inlet.speed, inlet.gust_strength, inlet.turbulence) = (DVec3::NEG_Z, 8.0, 0.0, 0.0);
    // The speed falls to 0 within a tenth of a second, while catkins that left the box wait for their reentry.
    inlet.speed_curve = vec![[3.0, 8.0], [3.1, 0.0]];
    let origin = DVec3::new(-17.5, 0.0, -17.5);
    let wind = InletWind::new(inlet, origin, lattice.spacing, lattice.cells, [false; 3]);
    assert!((wind.mean().length() - 8.0).abs() < 0.1 && wind.prescribed_mean_at_time(9.0).length() < 1e-6);
    let mut all = flights(2000, FlightParams::default(), &Arc::new(Solids::new(Vec::new(), true)));
    let (mut fast, mut slow) = (0, 0);
    let mut before = all.frame();
    while all.seconds() < 4.0 {
        all.advance_frame(&wind);
        let (now, t) = (all.frame(), all.seconds());
        for i in (0..2000).filter(|i| now.generations[*i] > before.generations[*i]) {
            let (place, velocity) = (now.positions[i], now.velocities[i]);
            assert!((place.z - 17.5).abs() < 0.1, "{place} at {t}");
            let speed = velocity.with_y(0.0).length();
            if t <= 3.0 {
                assert!((speed - wind.mean().length()).abs() < 1e-3, "{speed} at {t}");
                fast += 1;
            } else if t > 3.1 + 1.0 / 24.0 {
                assert!(speed < 1e-3, "{speed} at {t}");
                slow += 1;
            }
        }
        before = now;
    }
    assert!(fast > 100 && slow > 0, "{fast} {slow}");
}

#[test]
fn upper_member_at_a_wall_sinks_to_its_foot() {
    let solids = wall_and_house();
    let mut all = flights(1, FlightParams { humidity: GroundHumidity::Even(1.0), ..FlightParams::default() }, &solids);
    let c = all.catkin_mut(0);
    (c.x, c.from) = (DVec3::new(3.0, 2.0, 0.0), DVec3::new(3.0, 2.0, 0.0));
    let wind = UniformWind(Vec3::X);
    let mut seen = Vec::new();
    for _ in 0..24 * 60 {
        all.advance(&wind);
        let state = all.catkin(0).state;
        if seen.last() != Some(&state) {
            seen.push(state);
        }
    }
    assert_eq!(seen, [CatkinState::Airborne, CatkinState::OnWall, CatkinState::Corner]);
    let (c, r) = (all.catkin(0), f64::from(all.catkin(0).radius));
    assert!((c.x.x - (3.8 - r)).abs() < 1e-4 && (c.x.y - r).abs() < 2e-3, "{} {r}", c.x);
    let of_deposits = [all.stats().flight_time, all.stats().flight_distance];
    assert!(of_deposits.iter().all(|v| v.is_some_and(|v| v > 0.5)), "{of_deposits:?}");
}

/// A pair slides down a wall that ends a metre above the ground, and falls off: its flight lasts until it lies on the ground.
#[test]
fn a_cluster_that_falls_off_a_wall_has_not_ended_its_flight() {
    let prism = Prism::block(Vec3::new(4.0, 1.0, 0.0), Vec3::new(0.4, 3.0, 30.0), 0.0);
    let wall = Solid { name: "wall".into(), form: Form::Prism(prism), humidity: 0.0 };
    let options = FlightParams { humidity: GroundHumidity::Even(1.0), ..alike_and_sticky() };
    let starts = [2.0, 2.1].map(|y| DVec3::new(3.0, y, 0.0));
    let starts = starts.map(|at| CatkinStart { at, wait: ReleaseCondition::Until(0.0) });
    let mut all = FlightSimulation::new(options, Arc::new(Solids::new(vec![wall], true)), &starts);
    let wind = UniformWind(Vec3::X);
    let mut was_on_wall = false;
    // No catkin has been deposited, so that there is no mean.
    let start = all.stats();
    assert_eq!([start.flight_time, start.flight_distance, start.ground_wind], [None; 3]);
    assert_eq!(start.distance_quantiles, None);
    while all.stats().grounded < 2 && all.seconds() < 30.0 {
        all.advance_frame(&wind);
        was_on_wall |= all.stats().on_wall == 2;
    }
    let t = all.stats();
    assert!(was_on_wall && t.falls == 2 && t.grounded == 2 && t.clusters == 1, "{t:?}");
    let time = t.flight_time.expect("deposits");
    assert!((time - all.seconds()).abs() < 1e-9, "{time} of {} s", all.seconds());
}

/// A catkin bonded to one that comes to rest moves down to the ground, however far apart they were at contact.
#[test]
fn no_deposit_hangs_above_its_support() {
    let options = FlightParams { humidity: GroundHumidity::Even(1.0), stick_radius: 0.2, ..FlightParams::default() };
    let places = [0.08, 0.38, 0.68].map(|y| DVec3::new(0.1 * y, y, 0.0));
    let starts = places.map(|at| CatkinStart { at, wait: ReleaseCondition::Until(0.0) });
    let mut all = FlightSimulation::new(options, Arc::new(Solids::new(Vec::new(), true)), &starts);
    let still = UniformWind(Vec3::ZERO);
    (0..5).for_each(|_| all.advance(&still));
    assert_eq!(all.clusters.len(), 1);
    while all.stats().airborne > 0 {
        all.advance(&still);
    }
    let height = |all: &FlightSimulation| all.by_id().map(|c| c.x.y).fold(0.0, f64::max);
    let landed = height(&all);
    (0..24 * 6).for_each(|_| all.advance(&still));
    assert!(landed > 0.12 && height(&all) < 0.09, "{landed} {}", height(&all));
    assert_eq!(all.stats().penetrations, 0);
}

/// A column of ten catkins collapses to a heap, at the foot of a wall or from its top; no member stays suspended.
#[test]
fn column_at_a_wall_collapses_to_a_heap() {
    let (foot, top) = (DVec3::new(3.78, 0.02, 0.0), DVec3::new(4.0, 4.02, 0.0));
    for (first, up) in [(foot, 0.034), (top, 0.034), (DVec3::new(3.78, 4.02, 0.0), -0.034)] {
        let options =
            FlightParams { humidity: GroundHumidity::Even(1.0), scales: [1.0, 1.0], ..FlightParams::default() };
        let place = |i: u32| {
            // The member that carries the others rests on the top.
            let x = if up < 0.0 && i == 0 { 0.03 } else { 0.0 };
            first + DVec3::new(x, up * f64::from(i), 0.002 * f64::from(i % 3))
        };
        let starts: Vec<CatkinStart> =
            (0..10).map(|i| CatkinStart { at: place(i), wait: ReleaseCondition::Until(0.0) }).collect();
        let mut all = FlightSimulation::new(FlightParams { stick_radius: 0.0, ..options }, wall_and_house(), &starts);
        for c in &mut all.catkins {
            (c.x, c.wait) = (place(c.id), ReleaseCondition::Until(0.0));
            (c.state, c.face, c.normal) = (CatkinState::Corner, Some(0), Vec3::NEG_X);
        }
        (1..10).for_each(|id| all.join_catkins(id - 1, id, 0.0));
        let still = UniformWind(Vec3::ZERO);
        (0..24 * 40).for_each(|_| all.advance(&still));
        let tops: Vec<f64> = all.by_id().map(|c| c.x.y).collect();
        // On the top of the wall or on the ground, at no height between.
        assert!(tops.iter().all(|y| *y < 0.1 || (*y > 4.0 && *y < 4.1)), "{tops:?}");
        assert_eq!((all.stats().deposited(), all.stats().penetrations), (10, 0));
        assert!(all.clusters.values().all(|c| !c.loose));
    }
}

/// Of intervals of half a metre in front of a wall, the one at its foot holds the most deposits.
#[test]
fn most_catkins_deposit_at_the_foot_of_a_wall() {
    let options = FlightParams { humidity: GroundHumidity::Even(1.0), stick_radius: 0.0, ..FlightParams::default() };
    let mut all = flights(1500, options, &wall_and_house());
    let wind = gusts(2.0);
    (0..600).for_each(|_| all.advance_frame(&wind));
    let mut bins = [0_u32; 12];
    for c in all.by_id().filter(|c| c.state.is_deposited() && c.x.y < 0.2 && c.x.z.abs() < 14.0) {
        let away = (3.8 - c.x.x) * 2.0;
        (0..12).filter(|i| away >= f64::from(*i) && away < f64::from(*i + 1)).for_each(|i| bins[i as usize] += 1);
    }
    assert!(bins[1..].iter().all(|n| 2 * n < bins[0]) && bins[0] > 20, "{bins:?}");
}

/// On land as steep as a wall the humidity of the ground decides whether a catkin slides.
#[test]
fn steep_ground_is_as_wet_as_the_rest() {
    // Four metres up for each metre along x, through 8 m at the origin: 76 degrees.
    let heights = (0..25).map(|i| (i % 5) as f32 * 4.0).collect();
    let land = LandForm::new(5, 4.0, heights).expect("fits");
    let land = Solid { name: "land".into(), form: Form::Land(Arc::new(land)), humidity: 0.0 };
    let solids = Arc::new(Solids::new(vec![land], false));
    let start = CatkinStart { at: DVec3::Y * 8.15, wait: ReleaseCondition::Until(0.0) };
    let slid = |humidity: f64| {
        let options = FlightParams { humidity: GroundHumidity::Even(humidity), ..FlightParams::default() };
        let mut flights = FlightSimulation::new(options, Arc::clone(&solids), &[start]);
        (0..48).for_each(|_| flights.advance_frame(&UniformWind(Vec3::ZERO)));
        assert_eq!(flights.frame().states, [CatkinState::OnWall]);
        let before = flights.frame().positions[0].y;
        (0..48).for_each(|_| flights.advance_frame(&UniformWind(Vec3::ZERO)));
        before - flights.frame().positions[0].y
    };
    // Dry ground lets it slide at its settling speed, 0.24 m/s; soaked ground holds it.
    assert!(slid(0.0) > 0.2 && slid(1.0).abs() < 1e-6, "{} {}", slid(0.0), slid(1.0));
}

/// Root mean squares of the swing across the tuft's axis, rad/s, and of the tilt of the tuft from upright, rad, of singles in
/// gusts of `speed`, m/s, over seeds.
fn swing_and_tilt(fps: f64, speed: f64, seeds: u64) -> [f64; 2] {
    let (mut squares, mut samples) = ([0.0; 2], 0_u32);
    for seed in 0..seeds {
        let options = FlightParams {
            seed,
            fps,
            edges: [SideBoundary::Periodic; 2],
            stick_probability: 0.0,
            ..FlightParams::default()
        };
        let band = [0.5, 0.9];
        let sky_box = SkyRelease { seed, count: 200, inside: options.inside, band, duration: 0.0 };
        let solids = Arc::new(Solids::new(Vec::new(), true));
        let mut all = FlightSimulation::new(options, Arc::clone(&solids), &sky_starts(&sky_box, &solids));
        let wind = gusts(speed);
        // Two seconds to forget the start, then four samples a second at the same times for all frame rates.
        for sample in 1..=40 {
            while all.seconds() < f64::from(sample) / 4.0 - 1e-9 {
                all.advance_frame(&wind);
            }
            for c in all.by_id().filter(|c| sample >= 8 && c.state == CatkinState::Airborne) {
                let tuft = c.tuft();
                let across = f64::from((c.omega - tuft * c.omega.dot(tuft)).length());
                let tilt = f64::from(tuft.angle_between(Vec3::Y));
                squares = [squares[0] + across * across, squares[1] + tilt * tilt];
                samples += 1;
            }
        }
    }
    squares.map(|sum| osier_base::math::sqrt(sum / f64::from(samples)))
}

/// The swing of catkins at coarse frame rates is within a tenth of that at 96 frames a second.
#[test]
fn swing_is_independent_of_the_frame_rate() {
    for speed in [3.0, 8.0] {
        let found = [8.0, 12.0, 24.0, 48.0, 96.0].map(|fps| swing_and_tilt(fps, speed, 8));
        let fine = found[4];
        for coarse in &found[..4] {
            assert!((0..2).all(|k| (coarse[k] / fine[k] - 1.0).abs() < 0.1), "{speed} m/s: {found:.3?}");
        }
    }
}
