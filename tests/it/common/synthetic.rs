//! What several test files share: one small asymmetric scene that holds every kind of thing and every kind of motion.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(clippy::cast_possible_truncation, reason = "small test numbers")]

use std::sync::Arc;

use glam::{Quat, Vec2, Vec3};
use osier::scene::*;

/// First and last frame of the synthetic clip.
pub const START: u32 = 1;
pub const END: u32 = 9;
/// Texels of a side of the wet sheet.
pub const SIDE: usize = 32;
/// Frames by which the second copy of the rig is ahead of the first.
const PHASE: u32 = 3;

/// The synthetic scene at rest and all its frames.
pub fn scene() -> (Scene, Vec<Frame>) {
    let scene = Scene {
        name: "synthetic".into(),
        title: "Every kind of thing".into(),
        seed: 18_446_744_073_709_551_557,
        hash: "0123456789abcdef".repeat(4),
        clip: Clip { start: START, end: END, fps: (24, 1) },
        camera: Camera { eye: Vec3::new(3.0, 2.0, 6.0), target: Vec3::new(0.4, 0.8, -0.2), vfov: 0.6, roll: 0.1 },
        sun: Sun::default(),
        sky: Sky::default(),
        images: images(),
        materials: materials(),
        assets: vec![rig(), cache(), tracks(), misc(), ground()],
        placements: placements(),
        land: None,
        tables: vec![Table {
            name: "counts".into(),
            columns: vec![("number".into(), ""), ("way".into(), "m")],
            plots: vec![("both", vec![0, 1])],
            totals: vec![0],
            outcome: vec![0],
            parameters: serde_json::json!({ "count": 2 }),
            said: Vec::new(),
            watches: Vec::new(),
        }],
        fields: vec![Field {
            name: "floor".into(),
            what: "deposition",
            width: 3,
            height: 2,
            corner: Vec3::new(-1.5, 0.0, -1.0),
            along: Vec3::X * 3.0,
            down: Vec3::Z * 2.0,
            unit: "1/m^2",
            every: Some(4),
        }],
        enum_labels: Vec::new(),
        air: Vec::new(),
        volumes: Vec::new(),
        map_sequences: vec![MapSequence {
            name: "cache_l0".into(),
            side: SIDE,
            height_range: 0.004,
            layers: MAP_LAYERS.to_vec(),
            rest: Some(wet_maps(0).frame()),
        }],
    };
    let frames = (START..=END).map(|n| frame(&scene, n)).collect();
    (scene, frames)
}

fn images() -> Vec<Image> {
    let picture = |name: &str, kind, channels: u8, f: &dyn Fn(u32, u32, u8) -> u8| Image {
        name: name.into(),
        kind,
        width: 8,
        height: 4,
        channels,
        pixels: Pixels::U8(
            (0..4)
                .flat_map(|y| (0..8).flat_map(move |x| (0..channels).map(move |c| (x, y, c))))
                .map(|(x, y, c)| f(x, y, c))
                .collect(),
        ),
    };
    vec![
        picture("bark_color", ImageKind::Color, 3, &|x, y, c| (40 + x * 20 + y * 5 + u32::from(c) * 10) as u8),
        picture("bark_normal", ImageKind::Data, 3, &|_, _, c| if c == 2 { 255 } else { 128 }),
        picture("leaf_color", ImageKind::Color, 4, &|x, y, c| {
            if c == 3 { if x + y == 0 { 0 } else { 255 } } else { 60 + 40 * c }
        }),
    ]
}

fn materials() -> Vec<Material> {
    let plain = |name: &str, class| Material {
        name: name.into(),
        class,
        base_color: [0.3, 0.25, 0.2],
        roughness: 0.8,
        ior: 1.5,
        translucency: 0.0,
        double_sided: false,
        alpha_cutoff: None,
        height_range: 0.01,
        tile: 0.5,
        maps: Maps::default(),
        coat: None,
    };
    let bark = Material {
        maps: Maps { color: Some(0), normal: Some(1), ..Maps::default() },
        coat: None,
        ..plain("bark", MaterialClass::Bark)
    };
    let leaf = Material {
        maps: Maps { color: Some(2), ..Maps::default() },
        coat: None,
        translucency: 0.3,
        double_sided: true,
        alpha_cutoff: Some(0.5),
        roughness: 0.6,
        ..plain("leaf", MaterialClass::Leaf)
    };
    let water = Material { roughness: 0.0, ior: 1.333, base_color: [1.0; 3], ..plain("water", MaterialClass::Water) };
    let coat = Some(Coat { sequence: 0, weight: "wetness", darkening: 0.55 });
    let wet = Material { name: "cache_l0".into(), coat, ..leaf.clone() };
    vec![bark, leaf, water, plain("ground", MaterialClass::Ground), wet]
}

/// Maps of the wet leaf; water alone comes last, where tests ask for it.
pub const MAP_LAYERS: [MapLayer; 3] = [
    MapLayer { name: "height", file_kind: "exr.height", encoding: MapEncoding::Height },
    MapLayer { name: "wetness", file_kind: "exr.wetness", encoding: MapEncoding::Unit },
    MapLayer { name: "normal", file_kind: "exr.normal", encoding: MapEncoding::Normal },
];
pub const WATER_LAYER: MapLayer = MapLayer { name: "water", file_kind: "exr.water", encoding: MapEncoding::Thickness };

/// Maps of the wet leaf at a frame.
#[derive(Debug, Clone, Default)]
pub struct WetMaps {
    pub height: Vec<f32>,
    pub water: Vec<f32>,
    pub wetness: Vec<f32>,
    pub normal: Vec<[f32; 3]>,
}

impl WetMaps {
    /// With a layer for water alone, which a sequence without that layer passes over.
    pub fn frame(self) -> MapFrame {
        let scalar = |v| MapTexels::Scalar(Arc::new(v));
        let normal = MapTexels::Vector(Arc::new(self.normal));
        MapFrame { layers: vec![scalar(self.height), scalar(self.wetness), normal, scalar(self.water)] }
    }
}

/// A round drop that slides down a leaf of even relief, and leaves it wet where it was: `k` frames after the first.
pub fn wet_maps(k: usize) -> WetMaps {
    let mut maps = WetMaps::default();
    // The first two frames are the same.
    let head = 8.0 + k.saturating_sub(1) as f32 * 2.0;
    for (row, column) in (0..SIDE * SIDE).map(|i| ((i / SIDE) as f32 + 0.5, (i % SIDE) as f32 + 0.5)) {
        let (x, y) = ((column - 12.0) / 6.0, (row - head) / 6.0);
        let rise = (1.0 - x * x - y * y).max(0.0);
        let water = 0.002 * rise;
        let trail = if x.abs() < 1.0 && y < 0.0 { (1.0 + y / 6.0).max(0.0) } else { 0.0 };
        let slope = if rise > 0.0 { Vec3::new(x, -y, 0.0) * 0.5 } else { Vec3::ZERO };
        maps.height.push(0.0005 + 0.00001 * row + water);
        maps.water.push(water);
        maps.wetness.push(if rise > 0.0 { 1.0 } else { trail });
        maps.normal.push((Vec3::Z + slope).normalize().to_array());
    }
    maps
}

fn placements() -> Vec<Placement> {
    let at = |name: &str, asset, t, r| Placement {
        name: name.into(),
        asset,
        transform: Trs { t, r, s: Vec3::ONE },
        phase: 0,
    };
    let turn = Quat::from_xyzw(0.0, 0.258_819_04, 0.0, 0.965_925_8);
    vec![
        at("rig", 0, Vec3::new(1.0, 0.0, 0.5), turn),
        Placement {
            name: "rig_2".into(),
            asset: 0,
            transform: Trs { t: Vec3::new(-2.0, 0.1, -1.0), r: turn.conjugate(), s: Vec3::splat(0.75) },
            phase: PHASE,
        },
        at("cache", 1, Vec3::new(-0.5, 0.2, 1.0), Quat::IDENTITY),
        at("tracks", 2, Vec3::new(0.0, 1.0, 0.0), turn),
        at("misc", 3, Vec3::new(0.3, 0.0, -1.5), Quat::IDENTITY),
        at("ground", 4, Vec3::ZERO, Quat::IDENTITY),
    ]
}

/// A four-sided tube along +Y with a bend, 1.2 m tall, tapering, off-centre so that mirroring shows.
fn tube() -> Mesh {
    let mut mesh = Mesh::default();
    for ring in 0..7_u32 {
        let y = ring as f32 * 0.2;
        let r = 0.12 - 0.012 * ring as f32;
        for k in 0..5_u32 {
            let (x, z) = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0)][k as usize];
            mesh.points.push(Vec3::new(x * r + 0.05 * y * y, y, z * r * 0.7));
            mesh.normals.push(Vec3::new(x, 0.0, z).normalize());
            mesh.uvs.push(Vec2::new(k as f32 / 4.0, y));
        }
    }
    for ring in 0..6_u32 {
        for k in 0..4_u32 {
            let (a, b) = (ring * 5 + k, ring * 5 + k + 1);
            mesh.triangles.push([a, a + 5, b]);
            mesh.triangles.push([b, a + 5, b + 5]);
        }
    }
    mesh.with_material(0)
}

fn blade(size: f32, material: u32) -> Mesh {
    let points = [(0.0, 0.0, 0.0), (0.3, 0.5, 0.1), (0.0, 1.0, 0.0), (-0.2, 0.4, 0.15)];
    Mesh {
        attributes: Vec::new(),
        points: points.map(|(x, y, z)| Vec3::new(x, y, z) * size).to_vec(),
        normals: vec![Vec3::Z; 4],
        uvs: points.map(|(x, y, _)| Vec2::new(0.5 + x, y)).to_vec(),
        colors: Vec::new(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        subsets: Vec::new(),
    }
    .with_material(material)
}

/// A skinned tube with leaves riding on its joints.
fn rig() -> Asset {
    let mut mesh = tube();
    let wind = mesh.points.iter().map(|p| [p.y * 0.4, 0.25, 0.0, 1.0]).collect();
    let n = mesh.points.len();
    mesh.attributes = vec![
        Attribute::vertex("wind", AttributeData::Unit4(wind)),
        Attribute::vertex("wind2", AttributeData::Unit2(vec![[0.0, 0.75]; n])),
        Attribute::vertex("wind_axis", AttributeData::I32(vec![0; n])),
    ];
    let joint =
        |name: &str, parent, t| Joint { name: name.into(), parent, rest: Trs { t, ..Trs::IDENTITY }, radius: 0.05 };
    let joints = vec![
        joint("root", None, Vec3::ZERO),
        Joint {
            name: "mid".into(),
            parent: Some(0),
            rest: Trs { t: Vec3::new(0.01, 0.4, 0.0), r: Quat::from_rotation_z(-0.1), s: Vec3::ONE },
            radius: 0.04,
        },
        joint("top", Some(1), Vec3::new(0.02, 0.4, 0.01)),
    ];
    let mut skin = SkinWeights::default();
    for p in &mesh.points {
        let t = p.y / 0.4;
        let (a, w) = if t < 1.0 { (0, t) } else { (1, (t - 1.0).min(1.0)) };
        let (first, second) = if w > 0.5 { (a + 1, a) } else { (a, a + 1) };
        let (big, small) = (w.max(1.0 - w), w.min(1.0 - w));
        skin.joints.push([first, if small > 0.0 { second } else { 0 }, 0, 0]);
        skin.weights.push([big, small, 0.0, 0.0]);
    }
    let leaves = Instancer {
        name: "leaves".into(),
        prototypes: vec![Prototype::new("small", blade(0.2, 1)), Prototype::new("large", blade(0.35, 1))],
        ids: vec![11, 12, 13, 14],
        protos: vec![0, 1, 0, 1],
        scales: vec![Vec3::ONE, Vec3::splat(0.8), Vec3::splat(1.1), Vec3::ONE],
        rest: InstanceState {
            positions: [(0.1, 0.3, 0.0), (-0.05, 0.6, 0.1), (0.1, 0.9, -0.05), (0.07, 1.2, 0.0)]
                .map(Vec3::from)
                .to_vec(),
            orientations: (0..4).map(|i| Quat::from_euler(glam::EulerRot::YXZ, i as f32 * 1.3, 0.4, -0.2)).collect(),
            ..InstanceState::default()
        },
        motion: InstancerMotion::Joints(vec![0, 1, 1, 2]),
        tracked: false,
    };
    let stem = MeshObject { name: "stem".into(), mesh, motion: MeshMotion::Skinned, skin: Some(skin) };
    Asset {
        id: "rig".into(),
        kind: AssetKind::Plant,
        group: String::new(),
        skeleton: Some(Skeleton { joints }),
        meshes: vec![stem],
        instancers: vec![leaves],
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    }
}

fn bare(id: &str, kind: AssetKind) -> Asset {
    Asset {
        id: id.into(),
        kind,
        group: String::new(),
        skeleton: None,
        meshes: Vec::new(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    }
}

/// A mesh of two materials whose points move freely.
fn cache() -> Asset {
    let mut mesh = blade(0.9, 4);
    let mut second = tube();
    second.points.iter_mut().for_each(|p| *p = *p * 0.5 + Vec3::new(0.6, 0.0, 0.2));
    mesh.append(&second);
    let object = MeshObject { name: "body".into(), mesh, motion: MeshMotion::Deforming, skin: None };
    Asset { meshes: vec![object], ..bare("cache", AssetKind::Plant) }
}

/// Free instances; 1 is born at frame 3, 2 dies after frame 6, 4 lives from 4 to 5.
fn tracks() -> Asset {
    let n = 5;
    let rest = InstanceState {
        positions: (0..n).map(|i| Vec3::new(i as f32 * 0.3, 0.0, -0.2 * i as f32)).collect(),
        orientations: vec![Quat::IDENTITY; n],
        attributes: vec![Attribute::instance("state", AttributeData::I32(vec![0; n]))],
        ..InstanceState::default()
    };
    let flying = Instancer {
        name: "flying".into(),
        prototypes: vec![Prototype::new("seed", blade(0.15, 1)), Prototype::new("drop", blade(0.1, 2))],
        ids: (0..n as u64).map(|i| 1000 + i).collect(),
        protos: vec![0, 1, 0, 1, 0],
        scales: (0..n).map(|i| Vec3::splat(1.0 + 0.2 * i as f32)).collect(),
        rest,
        motion: InstancerMotion::Free,
        tracked: true,
    };
    Asset { instancers: vec![flying], ..bare("tracks", AssetKind::Tracks) }
}

fn misc() -> Asset {
    let cloud = Points {
        name: "rain".into(),
        material: 2,
        positions: (0..6).map(|i| Vec3::new(i as f32 * 0.2, 2.0, 0.1 * i as f32)).collect(),
        widths: vec![0.03; 6],
        colors: (0..6).map(|i| [i as f32 / 6.0, 0.5, 0.2]).collect(),
        attributes: Vec::new(),
        moving: true,
        reach: osier::geometry::Bounds::default(),
    };
    let hairs = Curves {
        name: "hairs".into(),
        material: 0,
        counts: vec![3, 4],
        points: (0..7).map(|i| Vec3::new(0.1 * i as f32, 0.2 + 0.05 * (i * i) as f32, 0.3)).collect(),
        widths: vec![0.02; 7],
        moving: true,
    };
    let pool = MeshObject { name: "pool".into(), mesh: Mesh::default(), motion: MeshMotion::Varying, skin: None };
    Asset { meshes: vec![pool], points: vec![cloud], curves: vec![hairs], ..bare("misc", AssetKind::Cloud) }
}

fn ground() -> Asset {
    let mesh = Mesh {
        attributes: Vec::new(),
        points: [(-3.0, -3.0), (-3.0, 3.0), (3.0, 3.0), (3.0, -3.0)].map(|(x, z)| Vec3::new(x, 0.0, z)).to_vec(),
        normals: vec![Vec3::Y; 4],
        uvs: vec![Vec2::ZERO, Vec2::Y, Vec2::ONE, Vec2::X],
        colors: Vec::new(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        subsets: Vec::new(),
    };
    let object =
        MeshObject { name: "plane".into(), mesh: mesh.with_material(3), motion: MeshMotion::Still, skin: None };
    Asset { meshes: vec![object], ..bare("ground", AssetKind::Terrain) }
}

fn frame(scene: &Scene, number: u32) -> Frame {
    let t = scene.clip.seconds(number) as f32;
    let k = (number - START) as f32;
    let rig = rig_frame(scene, number);
    let later = START + (number - START + PHASE) % (END - START + 1);

    let rest = &scene.assets[1].meshes[0].mesh;
    let points: Vec<Vec3> = rest.points.iter().map(|p| *p + Vec3::new(0.3 * t, 0.5 * t * p.x, t * t * p.y)).collect();
    let velocities = rest.points.iter().map(|p| Vec3::new(0.3, 0.5 * p.x, 2.0 * t * p.y)).collect();
    let cache = AssetFrame {
        meshes: vec![MeshFrame::Points { points, normals: rest.normals.clone(), velocities }],
        ..AssetFrame::default()
    };
    Frame {
        number,
        assets: vec![rig, cache, tracks_frame(scene, number, t), misc_frame(scene, k, t), AssetFrame::default()],
        shifted: [((0, PHASE), rig_frame(scene, later))].into(),
        rows: vec![vec![f64::from(number), f64::from(t) * 0.5]],
        fields: vec![vec![k, 0.0, 1.0, 2.0 + k, 0.25, 0.0]],
        air: Vec::new(),
        volumes: Vec::new(),
        maps: vec![wet_at(number)],
        records: Vec::new(),
        point_tables: Vec::new(),
    }
}

/// The sheet's maps, those of the first two frames one value.
fn wet_at(number: u32) -> MapFrame {
    static FIRST: std::sync::LazyLock<MapFrame> = std::sync::LazyLock::new(|| wet_maps(0).frame());
    let k = (number - START) as usize;
    if k < 2 { FIRST.clone() } else { wet_maps(k).frame() }
}

fn rig_frame(scene: &Scene, number: u32) -> AssetFrame {
    let k = (number - START) as f32;
    let sway = |joint: &Joint, i: usize| Trs {
        r: joint.rest.r * Quat::from_euler(glam::EulerRot::XYZ, 0.06 * k, 0.02 * k, 0.04 * k * i as f32),
        ..joint.rest
    };
    let joints = scene.assets[0].skeleton.iter().flat_map(|s| s.joints.iter().enumerate());
    AssetFrame { pose: joints.map(|(i, j)| sway(j, i)).collect(), ..AssetFrame::default() }
}

fn tracks_frame(scene: &Scene, number: u32, t: f32) -> AssetFrame {
    let flying = &scene.assets[2].instancers[0];
    let alive: Vec<bool> = vec![true, number >= 3, number <= 6, true, (4..=5).contains(&number)];
    let life: [(u32, u32); 5] = [(START, END), (3, END), (START, 6), (START, END), (4, 5)];
    let clock = |i: usize| scene.clip.seconds(number.clamp(life[i].0, life[i].1)) as f32;
    let state = InstanceState {
        positions: (0..5)
            .map(|i| flying.rest.positions[i] + Vec3::new(0.4, 1.0 + 0.1 * i as f32, -0.7) * clock(i))
            .collect(),
        orientations: (0..5)
            .map(|i| Quat::from_axis_angle(Vec3::new(0.6, 0.8, 0.0), clock(i) * 3.0 + i as f32))
            .collect(),
        // One instance unfolds while it flies.
        sizes: (0..5).map(|i| if i == 3 { 0.4 + 1.5 * clock(i) } else { 1.0 }).collect(),
        velocities: (0..5)
            .map(|i| if alive[i] { Vec3::new(0.4, 1.0 + 0.1 * i as f32, -0.7) } else { Vec3::ZERO })
            .collect(),
        angular_velocities: (0..5).map(|i| if alive[i] { Vec3::new(1.8, 2.4, 0.0) } else { Vec3::ZERO }).collect(),
        attributes: vec![Attribute::instance(
            "state",
            AttributeData::I32(alive.iter().map(|a| i32::from(*a) * 2).collect()),
        )],
        alive,
    };
    let _ = t;
    AssetFrame { instancers: vec![InstancerFrame::State(state)], ..AssetFrame::default() }
}

fn misc_frame(scene: &Scene, k: f32, t: f32) -> AssetFrame {
    let cloud = &scene.assets[3].points[0];
    let fall = Vec3::new(0.1, -4.0, 0.0);
    let rain = PointsFrame::State {
        positions: cloud.positions.iter().map(|p| *p + fall * t).collect(),
        widths: cloud.widths.iter().enumerate().map(|(i, w)| if i == 2 && k > 4.0 { 0.0 } else { *w }).collect(),
        velocities: vec![fall; 6],
        colors: Vec::new(),
    };
    let hairs = &scene.assets[3].curves[0];
    let bend = |p: &Vec3| *p + Vec3::new(0.0, 0.0, t * p.y);
    let mut pool = blade(0.5 + 0.1 * k, 2);
    if k as u32 % 2 == 1 {
        pool.append(&tube());
        pool = pool.with_material(2);
    }
    if k as u32 == 2 {
        pool = Mesh::default();
    }
    let velocities = vec![Vec3::new(0.0, 0.1, 0.0); pool.points.len()];
    AssetFrame {
        meshes: vec![MeshFrame::Whole { mesh: pool, velocities }],
        points: vec![rain],
        curves: vec![CurvesFrame::Points(hairs.points.iter().map(bend).collect())],
        ..AssetFrame::default()
    }
}
