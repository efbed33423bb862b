use super::{RainCost, default_substeps, report_hidden_drops, steps_per_frame};
use crate::bake::BakeContext;
use crate::bake::motion::evaluate_frame;
use crate::bake::scene::assembly::{AssembledScene, SceneOptions, assemble_for_estimate, assemble_scene};
use crate::recipe::{Request, resolve};
use osier_base::diagnostic::Report;
use osier_base::limits::Limits;
use osier_base::progress::{Cancel, Silent};
use osier_scene::{
    ColumnValues, Frame, InstancerFrame, MaterialClass, MeshFrame, MeshMotion, PointsFrame, check_frame, check_scene,
};

const SCENE: &str = "
    [frames]\nend = 8
    [plants.twig]\ngrammar = \"rain-twig.l\"\nset = { LEAVES = 3 }
    [plants.twig.leaf]\nblade = \"elliptic\"\nside = 32\n
    [[place]]\nplant = \"twig\"\ncount = 2\nradius = 0.3
    [ground]\nshow = false
    [maps]\nresolution = 32
    [rain]\nrate_mm_per_h = 150\nspin_up_s = 1.5\n";

fn built(more: &str) -> AssembledScene {
    within(&Limits::default(), more).unwrap_or_else(|e| panic!("{e}"))
}

fn within(limits: &Limits, more: &str) -> osier_base::Result<AssembledScene> {
    assembled(limits, format!("{SCENE}{more}"))
}

fn assembled(limits: &Limits, text: String) -> osier_base::Result<AssembledScene> {
    let request = Request { name: "test".into(), text, ..Request::default() };
    let (recipe, _) = resolve(&request).unwrap_or_else(|e| panic!("{e}"));
    let cancel = Cancel::default();
    let context = BakeContext { limits, cancel: &cancel, progress: &Silent, cache: None };
    assemble_scene(&recipe, SceneOptions::default(), &context)
}

fn at(built: &AssembledScene, number: u32) -> Frame {
    evaluate_frame(&built.animated.scene, &built.animated.motions, number, false).expect("a frame")
}

#[test]
fn what_a_clip_of_drops_keeps_is_held_to_the_limit() {
    let mut drops = "falls = false\n".to_owned();
    for k in 0..18 {
        let (leaf, v) = (k % 6, 0.3 + 0.2 * f64::from(k / 6));
        drops += &format!("[[rain.lying]]\nleaf = {leaf}\nat = [0.5, {v}]\nvolume_mm3 = 1\n");
    }
    let refused = |keys: &str, more: &str| {
        let mut limits = Limits::default();
        limits.set("motion-keys", keys).expect("a limit");
        within(&limits, more).err().map(|e| e.to_string())
    };
    // Before the first step only leaves are counted; drops on leaves are counted as they arrive.
    assert_eq!(refused("300", "falls = false\n"), None);
    for (keys, more) in [("50", "falls = false\n"), ("300", drops.as_str())] {
        let said = refused(keys, more).expect("too much");
        assert!(said.contains("leaves and raindrops times frames") && said.contains("--max-motion-keys"), "{said}");
    }
}

/// Catkins are instances too, but no drop strikes them.
#[test]
fn memory_of_rain_is_predicted_for_the_leaves_that_drops_strike() {
    let record = |more: &str| {
        let request = Request { name: "test".into(), text: format!("{SCENE}{more}"), ..Request::default() };
        let (recipe, _) = resolve(&request).unwrap_or_else(|e| panic!("{e}"));
        let (limits, cancel) = (Limits::default(), Cancel::default());
        let context = BakeContext { limits: &limits, cancel: &cancel, progress: &Silent, cache: None };
        let built = assemble_for_estimate(&recipe, SceneOptions::default(), &context).expect("an estimate");
        let counts = built.estimate(&recipe, &[1, 2, 3, 4, 5, 6, 7, 8]);
        let bytes = counts.memory.iter().find(|part| part.0 == "record of rain").expect("a record of rain").1;
        (built.rained_leaves, counts.instances, bytes)
    };
    let (leaves, instances, bytes) = record("");
    let (with_catkins, more_instances, same) = record("[catkin]\nlod = 3\n[flight]\ncount = 500\nrelease = \"sky\"\n");
    assert_eq!((leaves, with_catkins), (6, 6));
    assert!(more_instances == instances + 500 && bytes == same, "{instances} {more_instances}: {bytes} {same}");
}

#[test]
fn low_frame_rates_have_no_longer_time_steps() {
    for (fps, steps) in [(1000.0, 8), (60.0, 8), (24.0, 8), (24_000.0 / 1001.0, 8), (12.0, 16), (4.0, 48), (1.0, 192)] {
        assert_eq!(default_substeps(fps), steps, "{fps}");
    }
    let steps = |more: &str| {
        let text = format!("{SCENE}{more}").replace("end = 8", "end = 8\nfps = 12");
        let recipe = resolve(&Request { name: "test".into(), text, ..Request::default() }).expect("a scene").0;
        steps_per_frame(recipe.rain.as_ref().expect("rain"), &recipe, &[], None)
    };
    assert_eq!((steps(""), steps("substeps = 5\n")), (16, 5));
}

/// If a scene sets the number of meshes, hidden drops are intended.
#[test]
fn hidden_drops_are_a_warning_unless_the_scene_sets_their_number() {
    let said = |more: &str, most: usize| {
        let request = Request { name: "test".into(), text: format!("{SCENE}{more}"), ..Request::default() };
        let recipe = resolve(&request).expect("a scene").0;
        let mut report = Report::default();
        report_hidden_drops(most, 250, &recipe.places_of_keys, &mut report);
        (report.diagnostics.iter().map(|d| (d.code, d.labels.len())).collect::<Vec<_>>(), report.output)
    };
    assert_eq!(said("", 250), (vec![], String::new()));
    assert_eq!(said("", 300), (vec![("X024", 1)], String::new()));
    let (none, note) = said("max_drop_meshes = 250\n", 300);
    assert!(none.is_empty() && note.contains("up to 300 drops") && note.contains("= 300 shows all"), "{note}");
}

/// Predicted and simulated number of drops in the air, summed over the steps of a clip.
#[test]
fn the_work_of_drops_in_the_air_is_predicted() {
    // As in a bake: 192 steps per frame of a second, of which every eighth is recorded.
    let most = |text: &str| {
        let mut limits = Limits::default();
        limits.set("drop-steps", "1").expect("a limit");
        let told = within(&limits, text).err().map(|e| e.to_string()).expect("over the limit");
        let number = told.split("would be ").nth(1).and_then(|t| t.split(", the limit").next()).expect("a number");
        number.replace(',', "").parse::<f64>().expect("a number")
    };
    for more in ["", "size_distribution = \"fixed\"\nsize_mm = 4\n", "[wind]\nmodel = \"gust\"\nspeed = 4\n"] {
        let more = format!("substeps = 8\n{more}");
        let built = built(&more);
        let rain = built.animated.scene.assets.iter().position(|a| a.id == "rain").expect("rain");
        let in_air = |number: u32| {
            let PointsFrame::State { widths, .. } = at(&built, number).assets[rain].points(0).clone() else { return 0 };
            widths.iter().filter(|w| **w > 0.0).count()
        };
        // The mean of the frames, in which the rain is steady, over the steps of spin-up and clip.
        let mean = (1..=8).map(in_air).sum::<usize>() as f64 / 8.0;
        let (duration, fall) = (1.5 + 8.0 / 24.0, 0.3);
        let truth = mean * (duration - 0.5 * fall) * 192.0;
        let ratio = most(&more) / truth;
        assert!((0.8..1.6).contains(&ratio), "{more}: {ratio}");
    }
}

#[test]
fn the_work_of_drops_in_the_air_is_held_to_a_limit() {
    let cost = RainCost { drop_rate: 100.0, fall_time: 2.0, duration: 10.0, step: 0.01, frames: 24, leaves: 3 };
    // 200 drops are in the air at once, after two seconds in which their number rises; none lands within one second.
    assert!((cost.drop_steps() - 200.0 * 9.0 * 100.0).abs() < 1e-6, "{}", cost.drop_steps());
    let short = RainCost { duration: 1.0, ..cost };
    assert!((short.drop_steps() - 50.0 * 100.0).abs() < 1e-6, "{}", short.drop_steps());
    // Where drops fall slowly, the wind carries them from far away: more are in the air than a bake could simulate.
    let storm = "gravity = 0.01\n[wind]\nmodel = \"gust\"\nspeed = 6\n";
    let mut limits = Limits::default();
    limits.set("drop-steps", "100M").expect("a limit");
    limits.set("motion-keys", "none").expect("a limit");
    let said = within(&limits, storm).err().map(|e| e.to_string()).expect("too much");
    assert!(said.contains("raindrops in the air times time steps") && said.contains("--max-drop-steps"), "{said}");
    assert!(said.contains("lower rain.rate_mm_per_h, wind.speed or rain.spin_up_s, or raise rain.gravity"), "{said}");
    let said = within(&limits, &format!("total = 90_000_000\n{storm}")).err().map(|e| e.to_string()).expect("too much");
    // The error has the place of the key.
    assert!(said.contains("lower rain.total") && said.contains("S004") && said.contains(":22:9"), "{said}");
}

#[test]
fn leaves_get_maps_and_drops_show() {
    let built = built("[rain.impact]\ntangent_keep = 0.05\n");
    let scene = &built.animated.scene;
    check_scene(scene).expect("sound");
    // The maps of bark follow those of leaves.
    assert!(scene.map_sequences.iter().take(6).all(|s| s.layers.len() == 3));
    assert!(scene.map_sequences.iter().skip(6).all(|s| s.name.ends_with("_struck")));
    let worn = scene.materials.iter().filter(|m| m.coat.is_some() && m.class == MaterialClass::Leaf).count();
    assert_eq!(worn, 6);
    let rain = scene.assets.iter().position(|a| a.id == "rain").expect("rain");
    for number in [1, 5, 8] {
        let frame = at(&built, number);
        check_frame(scene, &frame).expect("sound");
        assert_eq!(frame.maps.len(), scene.map_sequences.len());
        assert!(frame.maps.iter().any(|m| m.layers[0].as_flat().iter().any(|h| *h > 0.0)));
        let MeshFrame::Whole { mesh, velocities } = frame.assets[rain].mesh(0) else { panic!("no drops") };
        assert!(!mesh.triangles.is_empty() && velocities.len() == mesh.points.len());
        let PointsFrame::State { widths, .. } = frame.assets[rain].points(0) else { panic!("nothing falls") };
        assert!(widths.iter().any(|w| *w > 0.0));
    }
}

/// Mean wetness of the maps of bark at a frame.
fn bark_wetness(built: &AssembledScene, number: u32) -> f64 {
    let scene = &built.animated.scene;
    let maps = at(built, number).maps;
    let barks = scene.map_sequences.iter().zip(&maps).filter(|(s, _)| s.name.ends_with("_struck"));
    let texels: Vec<f32> = barks.flat_map(|(_, m)| m.layers[0].as_flat().to_vec()).collect();
    texels.iter().map(|w| f64::from(*w)).sum::<f64>() / texels.len().max(1) as f64
}

#[test]
fn drops_wet_the_bark_that_they_strike_over_the_clip() {
    // On still plants, on rods and on plants that sway.
    for more in ["", "[plants.twig.rods]\n", "[plants.twig.wood]\ntimber = \"white_oak\"\n[wind]\nspeed = 3\n"] {
        // Four seconds, since the twig is so small that few drops strike it in one.
        let text = SCENE.replace("end = 8", "end = 96") + more;
        let built = assembled(&Limits::default(), text).unwrap_or_else(|e| panic!("{e}"));
        let scene = &built.animated.scene;
        check_scene(scene).expect("sound");
        check_frame(scene, &at(&built, 96)).expect("sound");
        let wetness = [1, 96].map(|number| bark_wetness(&built, number));
        assert!(wetness[0] > 0.005, "{more}: the spin-up has wetted bark: {wetness:?}");
        assert!(wetness[0] < wetness[1] && wetness[1] < 1.0, "{more}: {wetness:?}");
        // Rain reaches the upper side: bark that faces down has no coat.
        let coated = |id: u32| scene.materials[id as usize].coat.is_some();
        let (mut up, mut down, mut dry) = (0, 0, 0);
        for mesh in scene.assets.iter().flat_map(|a| &a.meshes).map(|m| &m.mesh) {
            let barks =
                mesh.subsets.iter().filter(|s| scene.materials[s.material as usize].class == MaterialClass::Bark);
            for subset in barks {
                for [a, b, c] in mesh.subset_triangles(subset) {
                    let [a, b, c] = [a, b, c].map(|i| mesh.points[*i as usize]);
                    let normal = (b - a).cross(c - a).normalize_or_zero();
                    match (coated(subset.material), normal.y) {
                        (true, y) if y > -0.5 => up += 1,
                        (true, _) => down += 1,
                        (false, _) => dry += 1,
                    }
                }
            }
        }
        assert!(up > 50 && dry > 20 && 10 * down < up, "{more}: {up} {down} {dry}");
    }
    // Without drops that fall bark has no maps; under a film of earlier rain drops darken it to the same albedo.
    let none = built("falls = false\n");
    assert!(none.animated.scene.map_sequences.iter().all(|s| !s.name.ends_with("_struck")));
    let film = built("[rain.wet]\nfilm = 1\n");
    let of_bark = |m: &&osier_scene::Material| m.class == MaterialClass::Bark && m.coat.is_some();
    let coat = film.animated.scene.materials.iter().find(of_bark).and_then(|m| m.coat).expect("a coat");
    assert!((coat.darkening - 1.0).abs() < 1e-6, "{}", coat.darkening);
    assert!(bark_wetness(&film, 8) > 0.005);
}

#[test]
fn the_table_tells_where_all_water_is() {
    let built = built("");
    let [table] = &built.animated.scene.tables[..] else { panic!("one table") };
    let mut struck = 0.0;
    for number in 1..=8 {
        let frame = at(&built, number);
        let of = |name: &str| frame.rows[0][table.columns.iter().position(|c| c.0 == name).expect("a column")];
        assert_eq!(frame.rows[0].len(), table.columns.len());
        let parts = ["water_air", "water_leaves", "water_hanging", "water_ground", "water_wood", "water_solids"];
        let sum: f64 = parts.iter().map(|name| of(name)).sum();
        assert!((sum / of("rained") - 1.0).abs() < 1e-9 && sum > 0.0, "{sum}");
        assert!(of("struck") >= struck && of("hardest_blow") > 0.0 && of("in_air") > 0.0);
        struck = of("struck");
    }
    assert!(struck > 5.0, "{struck}");
}

#[test]
fn drops_leaves_and_splashes_have_the_momentum_of_before() {
    // On still leaves, on rods, and on leaves of the sway model in the wind; drops adhere, splash and bounce.
    let plants = ["", "[plants.twig.rods]\n", "[wind]\nmodel = \"gust\"\nspeed = 6\n"];
    let impacts = ["", "[rain.impact]\nsplash = 0.3\n", "[rain.impact]\nrestitution = 0.4\nsplash = 0.1\n"];
    for more in plants.iter().flat_map(|plant| impacts.map(|impact| format!("{impact}{plant}"))) {
        let built = built(&more);
        let [table] = &built.animated.scene.tables[..] else { panic!("one table") };
        let frame = at(&built, 8);
        let of = |name: &str| frame.rows[0][table.columns.iter().position(|c| c.0 == name).expect("a column")];
        assert!(of("impact_momentum") > 1.0 && of("struck") > 5.0, "{more}");
        assert!(of("momentum_error") < 1e-9, "{more}: {}", of("momentum_error"));
    }
}

#[test]
fn events_of_the_spin_up_are_not_those_of_the_clip() {
    let built = built("[[rain.lying]]\nleaf = 0\nat = [0.5, 0.5]\nvolume_mm3 = 3\n");
    let count = |number: u32| {
        let records = at(&built, number).records;
        let events = records.iter().find(|table| table.name == "events").expect("events");
        let times = events.columns.iter().find(|column| column.name == "t").expect("times");
        let ColumnValues::F64(t) = &times.values else { panic!("times in single precision") };
        assert!(t.iter().all(|t| *t > -1e-9), "frame {number}: {t:?}");
        t.len()
    };
    // The first frame contains only the drop that is deposited on a leaf.
    assert_eq!(count(1), 1);
    assert!((2..=8).map(count).sum::<usize>() > 10);
}

#[test]
fn frames_do_not_depend_on_the_order_in_which_they_are_asked_for() {
    let built = built("");
    let first: Vec<_> = (1..=8).map(|n| at(&built, n).maps).collect();
    for number in [8_u32, 2, 5] {
        assert!(at(&built, number).maps == first[number as usize - 1], "frame {number}");
    }
}

#[test]
fn plants_on_rods_in_the_rain_do_not_depend_on_threads() {
    let poses = |threads: usize| {
        osier_base::par::on_threads(threads, || {
            let built = built("[plants.twig.rods]\n");
            at(&built, 8).assets.into_iter().map(|asset| asset.pose).collect::<Vec<_>>()
        })
    };
    let one = poses(1);
    assert!(one.iter().filter(|pose| !pose.is_empty()).count() > 1, "two plants move");
    assert!(one == poses(3));
}

#[test]
fn leaves_on_rods_give_way() {
    let built = built("[plants.twig.rods]\n");
    let scene = &built.animated.scene;
    check_scene(scene).expect("sound");
    let leaf = scene.assets[0].meshes.iter().find(|m| m.name.starts_with("leaf_l")).expect("a leaf with maps");
    assert_eq!(leaf.motion, MeshMotion::Skinned);
    let [a, b] = [1, 8].map(|n| at(&built, n));
    check_frame(scene, &b).expect("sound");
    let moved = a.assets[0].pose.iter().zip(&b.assets[0].pose).any(|(a, b)| a.t.distance(b.t) > 1e-6);
    assert!(moved);
}

/// Rain is emitted above the positions of the plants in the wind. The bounds of the plants limit the extent of falling drops.
#[test]
fn rain_falls_where_the_wind_bends_plants_on_rods() {
    let reach = |more: &str| {
        let built = built(&format!("[plants.twig.rods]\ncompliance = 10\n{more}"));
        let rain = built.animated.scene.assets.iter().find(|asset| asset.id == "rain").expect("rain");
        rain.points.first().expect("falling drops").reach
    };
    let wind = "[wind]\nmodel = \"uniform\"\nspeed = 25\n";
    let calm = reach("[wind]\nmodel = \"calm\"\n");
    for more in [wind.to_owned(), format!("{wind}[sway]\nstart = \"rest\"\n")] {
        let bent = reach(&more);
        let beyond = (bent.max - calm.max).max(calm.min - bent.min);
        assert!(beyond.max_element() > 0.02, "{more}: {beyond}");
    }
}

#[test]
fn height_maps_hold_relief_and_water_and_water_maps_the_water() {
    let more = "falls = false\n[[rain.lying]]\nleaf = 0\nat = [0.5, 0.5]\nvolume_mm3 = 3\n";
    let text = format!("{SCENE}{more}")
        .replace("side = 32", "side = 64\ndetail = \"close\"")
        .replace("resolution = 32", "resolution = 64\nwater = true");
    let request = Request { name: "test".into(), text, ..Request::default() };
    let (recipe, _) = resolve(&request).unwrap_or_else(|e| panic!("{e}"));
    let (limits, cancel) = (Limits::default(), Cancel::default());
    let context = BakeContext { limits: &limits, cancel: &cancel, progress: &Silent, cache: None };
    let built = assemble_scene(&recipe, SceneOptions::default(), &context).expect("a scene");
    let scene = &built.animated.scene;
    let sequence = &scene.map_sequences[0];
    let worn = scene.materials.iter().find(|m| m.coat.is_some_and(|c| c.sequence == 0)).expect("a wet leaf");
    let image = &scene.images[worn.maps.height.expect("a relief") as usize];
    let osier_scene::Pixels::U16(relief) = &image.pixels else { panic!("16 bits") };
    assert_eq!((image.width, sequence.side), (64, 64));
    let maps = &at(&built, 1).maps[0];
    let scalar = |name: &str| maps.scalars(sequence.layer(name).expect("a layer")).expect("numbers");
    let (height, water) = (scalar("height"), scalar("water"));
    let normal = maps.vectors(sequence.layer("normal").expect("a layer")).expect("vectors");
    // The height minus the water thickness is the relief of the material, in a band along the middle of the blade.
    let (mut dry, mut wet, mut sloped) = (0, 0, 0);
    for k in (8..56).flat_map(|y| (28..36).map(move |x| y * 64 + x)) {
        let own = f32::from(relief[k]) / 65535.0 * worn.height_range;
        // The leaf is scaled together with its relief.
        let scale = (height[k] - water[k]) / own.max(1e-9);
        assert!(own < 1e-6 || (0.3..3.0).contains(&scale), "{k}: {scale}");
        if water[k] > 0.0 {
            wet += 1;
        } else {
            dry += 1;
            sloped += usize::from(normal[k][2] < 0.9999);
        }
    }
    let band = (8..56).flat_map(|y| (28..36).map(move |x| y * 64 + x)).filter(|k| relief[*k] > 6000);
    let scales: Vec<f32> =
        band.map(|k| (height[k] - water[k]) / (f32::from(relief[k]) / 65535.0 * worn.height_range)).collect();
    let (least, most) = scales.iter().fold((f32::MAX, 0.0_f32), |(a, b), s| (a.min(*s), b.max(*s)));
    assert!(scales.len() > 200 && least / most > 0.999, "{} of {least} to {most}", scales.len());
    assert!(wet > 5 && dry > 200 && sloped > dry / 4, "{wet} {dry} {sloped}");
}

#[test]
fn maps_are_as_large_as_the_camera_sees_their_leaves() {
    // Sides of the maps if the camera is at a distance in front of the twig, m.
    let sides = |distance: f64| {
        let text = format!("{SCENE}[camera]\neye = [0, 0.3, {distance}]\ntarget = [0, 0.3, 0]\n");
        let request = Request { name: "test".into(), text: text.replace("resolution = 32", ""), ..Request::default() };
        let (recipe, _) = resolve(&request).unwrap_or_else(|e| panic!("{e}"));
        let (limits, cancel) = (Limits::default(), Cancel::default());
        let context = BakeContext { limits: &limits, cancel: &cancel, progress: &Silent, cache: None };
        let built = assemble_scene(&recipe, SceneOptions::default(), &context).expect("a scene");
        let frame = at(&built, 2);
        check_frame(&built.animated.scene, &frame).expect("sound");
        let of_leaves = built.animated.scene.map_sequences.iter().filter(|s| s.layers.len() == 3);
        of_leaves.map(|s| s.side).collect::<Vec<_>>()
    };
    assert!(sides(0.3).contains(&512), "{:?}", sides(0.3));
    assert_eq!(sides(30.0), [32; 6]);
    let [near, far] = [1.5, 6.0].map(|d| sides(d)[0]);
    assert!(near == 4 * far && far >= 32, "a quarter of the size at four times the distance: {near} {far}");
}

#[test]
fn leaves_with_maps_on_a_swaying_plant_are_instances() {
    let built = built("[plants.twig.wood]\ntimber = \"white_oak\"\n[wind]\nspeed = 5\n");
    let scene = &built.animated.scene;
    check_scene(scene).expect("sound");
    let asset = &scene.assets[0];
    assert!(asset.meshes.iter().all(|m| !m.name.starts_with("leaf_l")));
    let (i, wet) =
        asset.instancers.iter().enumerate().find(|(_, i)| i.name.ends_with("_with_maps")).expect("an instancer");
    assert!(wet.len() == 3 && wet.prototypes.len() == 3);
    let [a, b] = [1, 8].map(|n| at(&built, n));
    check_frame(scene, &b).expect("sound");
    let positions = |frame: &Frame| match frame.assets[0].instancer(i) {
        InstancerFrame::State(state) => state.positions.clone(),
        InstancerFrame::Same => panic!("no state"),
    };
    assert!(positions(&a).iter().zip(&positions(&b)).any(|(a, b)| a.distance(*b) > 1e-5), "the wind moves them");
}
