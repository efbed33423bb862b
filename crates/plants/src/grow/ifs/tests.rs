use super::*;
use osier_base::limits::Limits;
use osier_ifs::read;
use osier_scene::plant::NONE;

fn stems_of(name: &str) -> TreeSystem {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../ifs-tables").join(name);
    #[allow(clippy::disallowed_methods, reason = "tests read the tables")]
    let text = std::fs::read_to_string(path).expect("a table");
    let (systems, _) = read::read(name, text.as_bytes(), &Limits::default()).expect("reads");
    osier_ifs::stems::stems(&systems[0]).expect("a tree")
}

fn options(eps: f64, variation: f64) -> TreeOptions {
    let mesh = std::sync::Arc::new(osier_scene::Mesh {
        points: vec![Vec3::ZERO, Vec3::new(0.02, 0.05, 0.0), Vec3::new(0.0, 0.1, 0.0)],
        normals: vec![Vec3::Z; 3],
        triangles: vec![[0, 1, 2]],
        ..osier_scene::Mesh::default()
    });
    TreeOptions {
        height: 6.0,
        eps,
        max_depth: u16::MAX,
        max_order: u16::MAX,
        variation,
        radius: None,
        pipe: false,
        leaf_density: 1.0,
        leaves_per_site: 1,
        leaf: Some(OrganSpec { name: "leaf".into(), meshes: vec![mesh], size: 0.06, petiole: 0.0 }),
        sets: Vec::new(),
        cards: None,
        materials: vec!["bark".into(), "shoot".into()],
        bark: (0, 1, 0.008),
        source: "test".into(),
        up: Vec3::Y,
    }
}

const MODES: [&str; 3] = ["monopodial.ifs.toml", "sympodial.ifs.toml", "pseudodichotomous.ifs.toml"];

#[test]
fn plants_are_sound_and_the_seed_changes_no_id() {
    for name in MODES {
        let stems = stems_of(name);
        let one = grow(&stems, (7, 1), &options(0.1, 1.0), &Limits::default()).expect("grows");
        let two = grow(&stems, (7, 2), &options(0.1, 1.0), &Limits::default()).expect("grows");
        let mut again = one.clone();
        assert_eq!(osier_scene::plant::validate(&mut again).expect("sound"), [], "{name}");
        let ids = |p: &Plant| (p.axes.iter().map(|a| a.id).collect::<Vec<_>>(), p.organs.len());
        assert_eq!(ids(&one), ids(&two), "{name}: topology and ids hold no seed");
        assert_ne!(one.nodes.p, two.nodes.p, "{name}");
        let leaves = |p: &Plant| p.organs.iter().map(|o| o.id).collect::<std::collections::BTreeSet<_>>();
        assert_eq!(leaves(&one), leaves(&two), "{name}");
        assert_eq!(leaves(&one).len(), one.organs.len(), "{name}: ids are unique");
    }
}

#[test]
fn radii_never_grow_outwards_and_children_start_on_their_parent() {
    for name in MODES {
        let plant = grow(&stems_of(name), (7, 1), &options(0.1, 1.0), &Limits::default()).expect("grows");
        for axis in &plant.axes {
            let r = &plant.nodes.r[plant.nodes_of(axis)];
            assert!(r.windows(2).all(|w| w[1] <= w[0] * 1.000_001), "{name}");
            if let Some(parent) = plant.axes.get(axis.parent as usize) {
                let site = plant.frame(parent, axis.parent_s);
                let foot = plant.nodes.p[axis.first as usize];
                assert!(site.p.distance(foot) < 2e-6 * 6.0, "{name}: {}", site.p.distance(foot));
                assert!(r[0] <= site.r * 1.001, "{name}: no thicker than its parent");
                assert!(axis.order >= parent.order);
            }
        }
        let top = plant.nodes.p.iter().fold(0.0_f32, |h, p| h.max(p.y));
        assert!((4.2..7.2).contains(&top), "{name}: {top}");
    }
}

#[test]
fn child_areas_equal_the_parents() {
    for (name, want) in MODES.iter().zip([1.046, 1.013, 1.037]) {
        let stems = stems_of(name);
        let sum: f64 = stems.system.maps.iter().filter_map(|m| m.radius).map(|r| r * r).sum();
        assert!((sum - want).abs() < 5e-4, "{name}: {sum}");
    }
}

#[test]
fn forks_share_a_number() {
    let plant = grow(&stems_of(MODES[2]), (7, 1), &options(0.2, 0.0), &Limits::default()).expect("grows");
    let mut by_fork: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for a in plant.axes.iter().filter(|a| a.parent != NONE) {
        by_fork.entry(a.fork).or_default().push(a.parent);
    }
    assert!(by_fork.values().all(|p| p.len() == 2 && p[0] == p[1]) && by_fork.len() == 63);
}

#[test]
fn leaves_stand_at_the_ends_of_their_petioles() {
    let stems = stems_of(MODES[0]);
    let tree = |petiole: f64| {
        let mut options = options(0.2, 1.0);
        if let Some(leaf) = &mut options.leaf {
            leaf.petiole = petiole;
        }
        grow(&stems, (7, 5), &options, &Limits::default()).expect("grows")
    };
    let (without, with) = (tree(0.0), tree(0.03));
    assert!(without.organs.len() > 20 && without.organs.len() == with.organs.len());
    for (a, b) in without.organs.iter().zip(&with.organs) {
        // The leaf of 0.06 m has a mesh of 0.1 m: a leaf of mean size has the scale 0.6 and the petiole of 0.03 m.
        let petiole = 0.03 * a.scale / 0.6;
        assert!((b.petiole - a.petiole - petiole).abs() < 1e-6 && a.id == b.id, "{} {}", a.petiole, b.petiole);
        assert!(with.organ_site(b).0.distance(without.organ_site(a).0) > 0.9 * petiole);
    }
}

#[test]
fn a_finer_cut_moves_nothing() {
    let stems = stems_of(MODES[0]);
    let coarse = grow(&stems, (7, 3), &options(0.2, 1.0), &Limits::default()).expect("grows");
    let fine = grow(&stems, (7, 3), &options(0.1, 1.0), &Limits::default()).expect("grows");
    for a in &coarse.axes {
        let b = fine.axes.iter().find(|b| b.id == a.id).expect("still there");
        let (p, q) = (&coarse.nodes.p[coarse.nodes_of(a)], &fine.nodes.p[fine.nodes_of(b)]);
        assert!(p.iter().zip(q).all(|(x, y)| x == y));
    }
}

#[test]
fn matrices_are_read_as_the_branches_they_came_from() {
    let (text, table) = (stems_of("monopodial.ifs"), stems_of("monopodial.ifs.toml"));
    let axis = |s: &TreeSystem| s.system.maps.iter().filter(|m| !m.stem).position(|m| m.axis);
    assert_eq!((axis(&text), axis(&table)), (Some(0), Some(0)));
    assert!((text.radius / table.radius - 1.0).abs() < 0.2, "{} {}", text.radius, table.radius);
    let sum: f64 = text.system.maps.iter().filter_map(|m| m.radius).map(|r| r * r).sum();
    assert!((sum - 1.0).abs() < 1e-6, "a fork keeps its cross-section: {sum}");
    assert!(stems_of("pseudodichotomous.ifs").system.maps.iter().all(|m| !m.axis), "equal halves: none leads");
}

#[test]
fn meshes_stand_on_every_word_as_its_map_has_them() {
    let stems = stems_of(MODES[0]);
    let corner = Vec3::new(0.3, 0.7, -0.2);
    let mesh = osier_scene::Mesh { points: vec![corner, Vec3::X, Vec3::Z], ..osier_scene::Mesh::default() };
    let set = OrganSpec { name: "set".into(), meshes: vec![std::sync::Arc::new(mesh)], size: 1.0, petiole: 0.0 };
    let cut =
        words::ExpansionLimits { eps: 0.2, max_depth: u16::MAX, max_order: u16::MAX, max_words: 1000, raised_by: None };
    for variation in [0.0, 1.0] {
        let options = TreeOptions { sets: vec![set.clone()], ..options(0.2, variation) };
        let plant = grow(&stems, (7, 5), &options, &Limits::default()).expect("grows");
        let vary = (variation > 0.0).then_some(Variation::new(5, 7, variation));
        let words = words::expand(&stems.system, &stems.letters, &cut, vary).expect("expands").words;
        let scale = 6.0 / words::height(&stems.system, &stems.letters, stems.trunk);
        let sets: Vec<&Organ> =
            plant.organs.iter().filter(|o| plant.protos[usize::from(o.proto)].name == "set").collect();
        assert_eq!((sets.len(), words.len()), (108, 108));
        // Every image of the corner is there.
        for word in &words {
            let want = Vec3::from_array((word.map.apply(corner.as_dvec3()) * scale).to_array().map(narrow));
            let there = |o: &&Organ| {
                let (at, map_rotation) = plant.organ_site(o);
                (at + map_rotation * (corner * o.scale)).distance(want) < 2e-4
            };
            assert!(sets.iter().any(there), "{want}");
        }
        let leaves = plant.organs.len() - sets.len();
        assert!(leaves > 100, "{leaves}: leaves are there as well");
    }
}

#[test]
fn cards_stand_where_the_fine_tree_grows_on() {
    for (name, variation) in MODES.iter().flat_map(|m| [(m, 0.0), (m, 1.0)]) {
        let stems = stems_of(name);
        let fine = grow(&stems, (7, 4), &options(0.08, variation), &Limits::default()).expect("grows");
        let classes = subtree_classes(&stems, &word_limits(&options(0.08, variation), &Limits::default()), 0.32, 3)
            .expect("classes");
        let sizes: Vec<f64> = classes.iter().map(|c| c.size).collect();
        assert!(sizes.iter().all(|s| (0.08..0.32).contains(s)) && sizes.is_sorted(), "{name}: {sizes:?}");
        let meshes = (0..2 * sizes.len()).map(|_| std::sync::Arc::default()).collect();
        let spec = OrganSpec { name: "card".into(), meshes, size: 1.0, petiole: 0.0 };
        let cards = SubtreeBillboards { spec, sizes, variants: 2, eps: 0.32 };
        let seen = TreeOptions { cards: Some(cards.clone()), ..options(0.08, variation) };
        let coarse = grow(&stems, (7, 4), &seen, &Limits::default()).expect("grows");
        let is_card = |o: &&Organ| coarse.protos[usize::from(o.proto)].name.starts_with("card");
        let stand: Vec<&Organ> = coarse.organs.iter().filter(is_card).collect();
        let plain = words::ExpansionLimits { eps: 0.32, ..word_limits(&seen, &Limits::default()) };
        let cuts = words::expand(&stems.system, &stems.letters, &plain, None).expect("expands").cuts;
        let grows = cuts.iter().filter(|c| c.size >= 0.08).count();
        assert_eq!((stand.len(), coarse.organs.len() - stand.len()), (grows, cuts.len() - grows), "{name}");
        for card in &stand {
            let at = coarse.organ_site(card).0;
            assert!(fine.nodes.p.iter().any(|p| p.distance(at) < 1e-3), "{name}: {at}");
            let class = (usize::from(card.proto) - 1) / 2;
            let size = f64::from(card.scale) * cards.sizes[class];
            // Variation adds up over the letters of a word.
            assert!(variation > 0.0 || (0.079_99..0.320_01).contains(&size), "{name}: {size}");
        }
        assert!(coarse.axes.iter().all(|a| fine.axes.iter().any(|b| b.id == a.id)), "{name}: the same ids");
    }
}

/// Positions of all leaves of a tree; leaves of twigs once for each copy of the twig.
fn leaves_of(tree: &Plant, twigs: &[branchlets::Branchlet]) -> Vec<Vec3> {
    let first = tree.protos.len() - twigs.len();
    let mut all = Vec::new();
    for o in &tree.organs {
        let (p, q) = tree.organ_site(o);
        match usize::from(o.proto).checked_sub(first).map(|i| &twigs[i]) {
            None => all.push(p),
            Some(twig) => {
                let flip = if twig.mirrored { Vec3::new(1.0, 1.0, -1.0) } else { Vec3::ONE };
                let places = twig.plant.organs.iter().map(|l| twig.plant.organ_site(l).0);
                all.extend(places.map(|at| p + q * (at * flip * o.scale)));
            }
        }
    }
    all
}

#[test]
fn without_variation_copies_of_twigs_are_the_tree_itself() {
    // All branches as thick as they are long, so that a class of size is the only one; the second mirrors.
    let text = "[ifs]\nname = \"t\"\ndim = 3\nmap = [\n\
        { branch = { h = 1, roll = 80, pitch = 35, scale = 0.5 } },\n\
        { abcdefghijkl = [-0.5, 0, 0, 0, 0.5, 0, 0, 0, 0.5, 0.1, 1, 0], radius = 0.5 },\n]\n";
    let (systems, _) = read::read("t.ifs.toml", text.as_bytes(), &Limits::default()).expect("reads");
    let stems = osier_ifs::stems::stems(&systems[0]).expect("a tree");
    let options = options(0.01, 0.0);
    let whole = grow(&stems, (7, 1), &options, &Limits::default()).expect("grows");
    let (tree, twigs) = branchlets::grow(&stems, (7, 1), &options, &Limits::default()).expect("grows");
    let images = twigs.iter().filter(|t| t.mirrored).count();
    assert!(
        images > 0 && images < twigs.len() && twigs.len() <= 12,
        "{images} of {}: by the side that lies up",
        twigs.len()
    );
    let (own, copied) = (leaves_of(&whole, &[]), leaves_of(&tree, &twigs));
    assert_eq!(own.len(), copied.len());
    for q in own.iter().step_by(7) {
        let near = copied.iter().fold(f32::INFINITY, |d, p| d.min(p.distance(*q)));
        assert!(near < 1e-4, "{q}: {near}");
    }
    assert!(tree.nodes.len() * 4 < whole.nodes.len());
}

#[test]
fn copies_have_the_leaves_of_the_whole_tree() {
    for name in MODES {
        let stems = stems_of(name);
        let whole = grow(&stems, (7, 1), &options(0.04, 1.0), &Limits::default()).expect("grows");
        let (tree, twigs) = branchlets::grow(&stems, (7, 1), &options(0.04, 1.0), &Limits::default()).expect("grows");
        let (own, copied) = (leaves_of(&whole, &[]), leaves_of(&tree, &twigs));
        let ratio = copied.len() as f64 / own.len() as f64;
        assert!((0.9..1.1).contains(&ratio), "{name}: {ratio} of {}", own.len());
        let middle = |l: &[Vec3]| l.iter().sum::<Vec3>() / l.len() as f32;
        assert!(middle(&own).distance(middle(&copied)) < 0.1, "{name}: {} {}", middle(&own), middle(&copied));
        let spread = |l: &[Vec3]| l.iter().map(|p| p.distance(middle(l))).sum::<f32>() / l.len() as f32;
        assert!((spread(&own) / spread(&copied) - 1.0).abs() < 0.05, "{name}");
        let used: std::collections::BTreeSet<usize> = tree.organs.iter().map(|o| o.proto.into()).collect();
        let first = tree.protos.len() - twigs.len();
        assert!((first..tree.protos.len()).all(|p| used.contains(&p)), "{name}: every twig is shown");
        let mut scales = tree.organs.iter().filter(|o| usize::from(o.proto) >= first).map(|o| o.scale);
        assert!(scales.all(|s| (0.4..2.1).contains(&s)), "{name}");
    }
}
