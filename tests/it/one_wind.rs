//! One wind for a scene: what branches, leaves, rods, catkins, rain and files sample of it in a whole bake.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::print_stdout,
    reason = "tests, with small and known numbers"
)]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

use glam::Vec3;
use osier::bake::wind::scene_wind::{SceneWind, WindObserver, WindUser};
use osier::bake::{BakeContext, scene, write_files};
use osier::files::Folder;
use osier::limits::Limits;
use osier::progress::{Cancel, Silent};
use osier::recipe::{Request, resolve};
use osier::wind::Wind;

use super::wind_files::vti;

/// Largest difference between what two parts of a scene see at one place and time, m/s.
const SAME: f32 = 1e-6;

/// A tree on the sway model, one on rods, a rod of its own, and files of the wind. `{land}`: a ground or a terrain. `{more}`: catkins,
/// and rain that falls on all of them.
const SCENE: &str = "seed = 5\n[frames]\nend = 9\n{land}\n[sway]\n{sway}\n\
    [plants.tree]\nifs = \"sympodial.ifs.toml\"\nmotion = \"cache\"\n[plants.tree.tree]\neps = 0.4\n[plants.tree.bark]\nside = 16\n\
    [plants.bush]\nifs = \"sympodial.ifs.toml\"\n[plants.bush.tree]\neps = 0.6\n[plants.bush.bark]\nside = 16\n\
    [plants.bush.rods]\n\
    [[place]]\nplant = \"tree\"\nat = [-1, 0, 0]\n[[place]]\nplant = \"bush\"\nat = [1, 0, 1]\n\
    [[rod]]\npoints = [[0, 0, -1], [0, 2, -1]]\nradius_mm = [10, 10]\nsections = 6\n\
    [output]\nformats = [\"obj\"]\n[output.wind]\nvti_every = 4\n{wind}\n{more}\n";

/// Level ground, and a slope with hills under the whole lattice: heights of the wind are measured above it.
const LANDS: [(&str, &str); 2] = [
    ("level", "[ground]\nshow = false"),
    (
        "terrain",
        "[terrain]\nsize = 16\nsubdivisions = 4\namplitude = 0.5\ncorners = [0.2, 1.2, 0.6, 1.6]\nfloor = 0.1\nside = 64",
    ),
];
const FLIGHT: &str =
    "[flight]\ncount = 40\nsize = [12, 6, 8]\nspin_up_s = 0.25\nband = [0.2, 0.9]\n[catkin]\nhairs = 4\nlod = 3\n";
const RAIN: &str = "[rain]\nrate_mm_per_h = 20\nspin_up_s = 0.25\n";

/// The six models. The last two: a lattice that is simulated, and the formula of its inflow.
const WINDS: [(&str, &str); 6] = [
    ("calm", "[wind]\nmodel = \"calm\""),
    ("uniform", "[wind]\nmodel = \"uniform\"\nspeed = 3\nscale = 1.5"),
    ("gust", "[wind]\nspeed = 5\nscale = 0.8\n[[wind.add]]\nmodel = \"perlin\"\nspeed = 1\ndirection_deg = 90"),
    ("perlin", "[wind]\nmodel = \"perlin\"\nspeed = 4"),
    ("lattice", LATTICE),
    ("inlet", LATTICE),
];
const LATTICE: &str = "[wind]\nmodel = \"lattice\"\nspeed = 3\nscale = 1.25\n[[wind.add]]\nspeed = 0.5\ndirection_deg = 45\n\
    [wind.lattice]\ncells = [24, 12, 16]\ndx = 0.5\nspin_up_s = 1\nsolver = \"{solver}\"\n\
    [[solid]]\nat = [-3, 0, 0]\nsize = [0.5, 1.5, 3]";

/// What each user of a wind sampled.
#[derive(Debug, Default)]
struct Log(Mutex<BTreeMap<WindUser, Vec<Sample>>>);

#[derive(Debug, Clone, Copy)]
struct Sample {
    place: Vec3,
    t: f64,
    velocity: Vec3,
}

impl WindObserver for Log {
    fn sampled(&self, user: WindUser, positions: &[Vec3], t: f64, velocities: &[Vec3]) {
        let samples = positions.iter().zip(velocities).map(|(place, u)| Sample { place: *place, t, velocity: *u });
        self.0.lock().expect("log").entry(user).or_default().extend(samples);
    }
}

/// A bake, with all that its parts sampled, and its wind.
struct Observed {
    samples: BTreeMap<WindUser, Vec<Sample>>,
    wind: Arc<SceneWind>,
    /// Time of the last frame, s.
    end: f64,
}

fn bake(text: &str, folder: &Path, limits: &Limits) -> Observed {
    let request = Request { name: "one".into(), text: text.into(), ..Request::default() };
    let (recipe, _) = resolve(&request).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let cancel = Cancel::default();
    let context = BakeContext { limits, cancel: &cancel, progress: &Silent, cache: None };
    let log = Arc::new(Log::default());
    let observer = Arc::clone(&log) as Arc<dyn WindObserver>;
    let built = scene::assemble_observed_scene(&recipe, scene::SceneOptions::default(), observer, &context);
    let mut built = built.unwrap_or_else(|e| panic!("{e}\n{text}"));
    let frames: Vec<u32> = (recipe.clip.start..=recipe.clip.end).collect();
    let out = Folder::open(folder).expect("folder");
    write_files(&recipe, &mut built, &frames, &out, &context).expect("files");
    let samples = std::mem::take(&mut *log.0.lock().expect("log"));
    let end = (recipe.clip.len() - 1) as f64 / recipe.clip.fps();
    Observed { samples, wind: built.wind, end }
}

fn ask(wind: &dyn Wind, places: &[Vec3], t: f64) -> Vec<Vec3> {
    let mut out = vec![Vec3::ZERO; places.len()];
    wind.sample(places, t, &mut out);
    out
}

/// Checks that all users sampled, within their times, and that what they saw is the scene's field; prints the largest difference.
fn check(name: &str, observed: &Observed, users: &[(WindUser, [f64; 2])], folder: &Path) {
    let field = observed.wind.wind_at_all_times(WindUser::Sway).expect("a wind");
    let mut worst = 0.0_f32;
    for (user, [first, last]) in users {
        let samples = observed.samples.get(user).map_or(&[][..], Vec::as_slice);
        assert!(!samples.is_empty(), "{name}: {user:?} read no wind");
        // Each reads on the clip's clock: from its spin-up on, to a frame after the last at most.
        let times = samples.iter().fold([f64::MAX, f64::MIN], |[a, b], s| [a.min(s.t), b.max(s.t)]);
        assert!((times[0] - first).abs() < 0.05, "{name}: {user:?} reads from {} s on, not {first}", times[0]);
        // Rain traces drops to where they will fall after the clip.
        let latest = if *user == WindUser::Rain { f64::INFINITY } else { last + 0.11 };
        assert!(times[1] >= last - 0.05 && times[1] < latest, "{name}: {user:?} reads to {} s, not {last}", times[1]);
        // Samples of one time are asked for together: a field prepares its gusts once for each question.
        let in_clip: Vec<Sample> = samples.iter().filter(|s| s.t <= observed.end).copied().collect();
        for together in in_clip.chunk_by(|a, b| a.t.to_bits() == b.t.to_bits()) {
            let places: Vec<Vec3> = together.iter().map(|s| s.place).collect();
            for (u, s) in ask(&*field, &places, together[0].t).iter().zip(together) {
                worst = worst.max((*u - s.velocity).length());
            }
        }
    }
    // The file of the last frame that has one.
    let file = vti(&folder.join("wind/box.0009.vti"));
    assert!((file.time - observed.end).abs() < 1e-12);
    let [nx, ny, _] = file.cells;
    let middle = |k: usize| {
        let at = [k % nx, k / nx % ny, k / (nx * ny)];
        Vec3::from_array(std::array::from_fn(|a| (file.corner[a] + (at[a] as f64 + 0.5) * file.side[a]) as f32))
    };
    let places: Vec<Vec3> = (0..file.values.len()).map(middle).collect();
    let moving = file.values.iter().filter(|u| Vec3::from_array(**u).length() > 0.1).count();
    assert!(2 * moving > file.values.len(), "{name}: the file holds no wind");
    for (u, v) in ask(&*field, &places, file.time).iter().zip(&file.values) {
        worst = worst.max((*u - Vec3::from_array(*v)).length());
    }
    println!("{name}: largest difference {worst:e} m/s");
    assert!(worst <= SAME, "{name}: {worst} m/s");
}

/// The scene in a wind, on a land, with more tables.
fn scene_text(name: &str, wind: &str, sway: &str, land: &str, more: &str) -> String {
    let solver = if name == "inlet" { "analytic" } else { "lbm" };
    let with_wind = SCENE.replace("{wind}", &wind.replace("{solver}", solver));
    with_wind.replace("{sway}", sway).replace("{land}", land).replace("{more}", more)
}

/// Loops over which the sway of the scene's tree spins up.
const SWAY_LOOPS: f64 = 1.0;

/// Times that each user reads, s, from its spin-up to the last frame. `period`: of a loop. `rains`: rain steps the plants on rods.
fn users(period: Option<f64>, rains: bool) -> Vec<(WindUser, [f64; 2])> {
    let end = 8.0 / 24.0;
    // The sway of a loop spins up over a whole number of loops, and is recorded over one.
    let sway = period.map_or([-5.0, end], |period| [-SWAY_LOOPS * period, period]);
    // The plant on rods spins up for two seconds before it rains.
    let rods_or_rain = if rains { (WindUser::Rain, [-2.25, end]) } else { (WindUser::RodPlants, [-2.0, end]) };
    vec![
        (WindUser::Sway, sway),
        rods_or_rain,
        (WindUser::Rods, [0.0, end]),
        (WindUser::Flight, [-0.25, end]),
        (WindUser::Output, [0.0, end]),
    ]
}

/// Bakes the scene in one of [`WINDS`] with and without rain, as a loop and once, and checks what its parts sampled.
fn parts_agree(number: usize) {
    let dir = tempfile::tempdir().expect("dir");
    let (name, wind) = WINDS[number];
    let end = 8.0 / 24.0;
    for (land, of_land) in LANDS {
        for (label, sway, period) in [("once", "repeat = false", None), ("loop", "loop = 2", Some(2.0))] {
            for (weather, more) in [("dry", FLIGHT.to_owned()), ("rain", format!("{FLIGHT}{RAIN}"))] {
                let label = format!("{name}, {label}, {land}, {weather}");
                let folder = dir.path().join(label.replace(", ", "-"));
                let observed = bake(&scene_text(name, wind, sway, of_land, &more), &folder, &Limits::default());
                if name == "calm" {
                    assert!(observed.wind.wind_at_all_times(WindUser::Sway).is_none(), "{label}");
                    let still = observed.samples.values().flatten().all(|s| s.velocity == Vec3::ZERO);
                    assert!(still && observed.samples.contains_key(&WindUser::Flight), "{label}");
                    // Files hold still air.
                    assert!(
                        vti(&folder.join("wind/box.0009.vti")).values.iter().flatten().all(|u| u.abs() <= 0.0),
                        "{label}"
                    );
                    continue;
                }
                let field = observed.wind.wind_at_all_times(WindUser::Sway).expect("a wind");
                let steady = name == "uniform";
                assert_eq!(field.period(), if steady { Some(0.0) } else { period }, "{label}");
                check(&label, &observed, &users(period, weather == "rain"), &folder);
                assert!((observed.end - end).abs() < 1e-12, "{label}");
            }
        }
    }
}

#[test]
#[ignore = "eight bakes a model; `tests/full.sh` runs them"]
fn all_parts_of_a_scene_are_in_one_calm_or_uniform_wind() {
    parts_agree(0);
    parts_agree(1);
}

#[test]
fn all_parts_of_a_scene_are_in_one_gust_wind() {
    parts_agree(2);
}

#[test]
#[ignore = "eight bakes a model; `tests/full.sh` runs them"]
fn all_parts_of_a_scene_are_in_one_perlin_wind() {
    parts_agree(3);
}

#[test]
#[ignore = "takes half a minute; tests/full.sh runs it"]
fn all_parts_of_a_scene_are_in_one_lattice_wind() {
    parts_agree(4);
}

#[test]
#[ignore = "eight bakes a model; `tests/full.sh` runs them"]
fn all_parts_of_a_scene_are_in_one_wind_of_an_inlet() {
    parts_agree(5);
}

/// Where a recording of the whole box does not fit, plants read a recording of their region and catkins a lattice that is stepped
/// along: the same air.
#[test]
fn a_stepped_lattice_is_the_recorded_one() {
    let dir = tempfile::tempdir().expect("dir");
    let mut few = Limits::default();
    few.set("wind-bytes", "8M").expect("limit");
    let text = scene_text("lattice", LATTICE, "repeat = false", LANDS[0].1, &FLIGHT.replace("40", "600"));
    let observed = bake(&text, dir.path(), &few);
    assert!(observed.wind.recorded_bytes() < 8_000_000);
    let field = observed.wind.wind_at_all_times(WindUser::Sway).expect("a wind");
    // Catkins that fly among the plants.
    let near = |s: &&Sample| s.place.x.abs() < 1.5 && s.place.z.abs() < 1.0 && s.place.y < 2.5;
    let flown: Vec<Sample> = observed.samples[&WindUser::Flight].iter().filter(near).copied().collect();
    assert!(flown.len() > 50, "{}", flown.len());
    let worst = flown.iter().map(|s| (ask(&*field, &[s.place], s.t)[0] - s.velocity).length()).fold(0.0, f32::max);
    println!("stepped beside recorded: largest difference {worst:e} m/s");
    assert!(worst <= SAME, "{worst} m/s");
}

/// A lattice is recorded for plants that sway; those that grow, or whose leaves change, over the clip read none.
#[test]
fn no_lattice_is_recorded_for_plants_that_read_no_wind() {
    let recorded = |keys: &str| {
        let text = format!(
            "[frames]\nend = 9\n[ground]\nshow = false\n[plants.tree]\nspecies = \"birch\"\nage = 4\n{keys}\n\
             [plants.tree.bark]\nside = 16\n[output]\nformats = [\"obj\"]\n[wind]\nmodel = \"lattice\"\nspeed = 3\n\
             [wind.lattice]\ncells = [24, 12, 16]\ndx = 0.5\nspin_up_s = 0.5"
        );
        let dir = tempfile::tempdir().expect("dir");
        bake(&text, dir.path(), &Limits::default()).wind.recorded_bytes()
    };
    assert!(recorded("") > 0);
    for keys in ["growth_clip = [0, 1]", "site.from = 2", "season = [0.5, 0.9]", "motion = \"still\""] {
        assert_eq!(recorded(keys), 0, "{keys}");
    }
}
