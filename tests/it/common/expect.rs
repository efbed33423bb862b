//! What a client must show: world-space positions of everything placed, at chosen frames, as JSON.
//!
//! ```json
//! {"clip": {"start": 1, "end": 9, "fps": 24.0},
//!  "frames": {"1": {
//!    "meshes":     {"<placement>/<mesh>": [[x,y,z], ...]},
//!    "instancers": {"<placement>/<instancer>": [{"proto": "small", "alive": true, "points": [[x,y,z], ...]}, ...]},
//!    "points":     {"<placement>/<cloud>": {"positions": [...], "widths": [...]}},
//!    "curves":     {"<placement>/<curves>": [[x,y,z], ...]}}}}
//! ```
//! Space is ours: right-handed, +Y up, metres. Mesh vertices stand in the order of the scene's mesh.
#![allow(dead_code, reason = "each test file uses its own share")]

use glam::Vec3;
use osier::scene::{
    Asset, AssetFrame, CurvesFrame, Frame, Placement, PointsFrame, Scene, instance_states, mesh_points,
};
use serde_json::{Map, Value, json};

/// First, middle and last frame number.
pub fn three(scene: &Scene) -> [u32; 3] {
    let (a, b) = (scene.clip.start, scene.clip.end);
    [a, a + (b - a) / 2, b]
}

/// Expectations at the frames of the given numbers. `frames` holds the whole clip in order.
pub fn expect(scene: &Scene, frames: &[Frame], numbers: &[u32]) -> Value {
    let mut at = Map::new();
    for frame in frames.iter().filter(|f| numbers.contains(&f.number)) {
        at.insert(frame.number.to_string(), of_frame(scene, frame));
    }
    json!({"clip": {"start": scene.clip.start, "end": scene.clip.end, "fps": scene.clip.fps()}, "frames": at})
}

fn of_frame(scene: &Scene, frame: &Frame) -> Value {
    let (mut meshes, mut instancers, mut points, mut curves) = (Map::new(), Map::new(), Map::new(), Map::new());
    for placement in &scene.placements {
        let asset = &scene.assets[placement.asset];
        let Some(state) = frame.shown(placement) else { continue };
        let key = |name: &str| format!("{}/{name}", placement.name);
        let world = |p: &Vec3| vec3(placement.transform.apply(*p));
        for (i, object) in asset.meshes.iter().enumerate() {
            let list: Vec<Value> = mesh_points(asset, object, i, state).iter().map(world).collect();
            meshes.insert(key(&object.name), list.into());
        }
        for i in 0..asset.instancers.len() {
            instancers.insert(key(&asset.instancers[i].name), of_instancer(placement, asset, state, i));
        }
        for (i, cloud) in asset.points.iter().enumerate() {
            let (positions, widths) = match state.points(i) {
                PointsFrame::State { positions, widths, .. } => (positions, widths),
                PointsFrame::Same => (&cloud.positions, &cloud.widths),
            };
            let positions: Vec<Value> = positions.iter().map(world).collect();
            points.insert(key(&cloud.name), json!({"positions": positions, "widths": widths}));
        }
        for (i, c) in asset.curves.iter().enumerate() {
            let list = match state.curves(i) {
                CurvesFrame::Points(p) => p,
                CurvesFrame::Same => &c.points,
            };
            curves.insert(key(&c.name), list.iter().map(world).collect::<Vec<_>>().into());
        }
    }
    json!({"meshes": meshes, "instancers": instancers, "points": points, "curves": curves})
}

fn of_instancer(placement: &Placement, asset: &Asset, state: &AssetFrame, i: usize) -> Value {
    let instancer = &asset.instancers[i];
    let s = instance_states(asset, instancer, i, state);
    let one = |k: usize| {
        let proto = &instancer.prototypes[instancer.protos[k] as usize];
        let trs = instancer.transform(&s, k);
        let points: Vec<Value> =
            proto.mesh.points.iter().map(|p| vec3(placement.transform.apply(trs.apply(*p)))).collect();
        json!({"proto": proto.name, "alive": s.is_alive(k), "points": points})
    };
    (0..instancer.len()).map(one).collect::<Vec<_>>().into()
}

fn vec3(p: Vec3) -> Value {
    json!([p.x, p.y, p.z])
}
