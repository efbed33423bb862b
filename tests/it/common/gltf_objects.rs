//! What each mesh node of a glTF file must show, by node name.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(clippy::expect_used, reason = "a test may fail")]

use osier::scene::{Frame, Instancer, InstancerMotion, Mesh, Placement, Scene, Trs};
use serde_json::{Map, Value, json};

use super::expect;

/// Vertices in the order of the file: material after material, each with the vertices it uses.
pub fn written(mesh: &Mesh, points: &[Value]) -> Vec<Value> {
    let mut materials: Vec<u32> = Vec::new();
    mesh.subsets.iter().for_each(|s| {
        if !materials.contains(&s.material) {
            materials.push(s.material);
        }
    });
    let mut out = Vec::new();
    for m in materials {
        let mut used: Vec<u32> = mesh
            .subsets
            .iter()
            .filter(|s| s.material == m)
            .flat_map(|s| mesh.subset_triangles(s).iter().flatten().copied())
            .collect();
        used.sort_unstable();
        used.dedup();
        out.extend(used.iter().map(|&i| points[i as usize].clone()));
    }
    out
}

/// What each Blender object must show at the frames given, from the common expectations.
/// `prefix`: names of the scene file start with the placement, those of an asset's own file do not.
pub fn objects(scene: &Scene, frames: &[Frame], numbers: &[u32], prefix: bool) -> Value {
    let all = expect::expect(scene, frames, numbers);
    let mut out = Map::new();
    for (number, at) in all["frames"].as_object().expect("frames") {
        let mut list = Map::new();
        for p in &scene.placements {
            let asset = &scene.assets[p.asset];
            let named = |n: &str| if prefix { format!("{}_{n}", p.name) } else { n.to_owned() };
            let key = |n: &str| format!("{}/{n}", p.name);
            for o in asset.meshes.iter().filter(|o| !o.mesh.points.is_empty()) {
                let points = at["meshes"][key(&o.name)].as_array().expect("mesh");
                list.insert(named(&o.name), json!({"points": written(&o.mesh, points)}));
            }
            for instancer in &asset.instancers {
                let states = at["instancers"][key(&instancer.name)].as_array().expect("instancer");
                match &instancer.motion {
                    InstancerMotion::Joints(joints) => {
                        riding(&mut list, &named(&instancer.name), (instancer, joints), states);
                    }
                    _ => instanced(&mut list, &named(&instancer.name), states, asset.skeleton.is_some()),
                }
            }
            for c in &asset.curves {
                let points = &at["curves"][key(&c.name)];
                list.insert(named(&c.name), json!({"points": points, "pairs": true}));
            }
        }
        out.insert(number.clone(), list.into());
    }
    out.into()
}

pub fn instanced(list: &mut Map<String, Value>, name: &str, states: &[Value], rides: bool) {
    if !rides {
        for (i, s) in states.iter().enumerate() {
            let hidden = s["alive"] == false;
            list.insert(format!("{name}_{i}"), json!({"points": s["points"], "hidden": hidden}));
        }
        return;
    }
    for s in states {
        let proto = s["proto"].as_str().expect("name");
        let merged = list.entry(format!("{name}_{proto}")).or_insert_with(|| json!({"points": []}));
        let points = s["points"].as_array().expect("points").clone();
        merged["points"].as_array_mut().expect("list").extend(points);
    }
}

/// Instances that ride on joints: one mesh on each joint, material after material, prototype after prototype.
fn riding(list: &mut Map<String, Value>, name: &str, (instancer, joints): (&Instancer, &[u16]), states: &[Value]) {
    let material = |i: usize| {
        let mesh = &instancer.prototypes[instancer.protos[i] as usize].mesh;
        mesh.subsets.first().map_or(0, |s| s.material)
    };
    let mut order: Vec<usize> = (0..states.len()).collect();
    order.sort_by_key(|&i| (joints[i], material(i), instancer.protos[i], i));
    for i in order {
        let ridden = list.entry(format!("{name}_{}", joints[i])).or_insert_with(|| json!({"points": []}));
        let points = states[i]["points"].as_array().expect("points").clone();
        ridden["points"].as_array_mut().expect("list").extend(points);
    }
}

/// An asset alone at the origin.
pub fn alone(scene: &Scene, asset: usize) -> Scene {
    let name = scene.assets[asset].id.clone();
    Scene { placements: vec![Placement { name, asset, transform: Trs::IDENTITY, phase: 0 }], ..scene.clone() }
}

/// The same for profile `web`: riding instances stand under their joints, prototype by prototype.
pub fn web_objects(scene: &Scene, frames: &[Frame], numbers: &[u32]) -> Value {
    let mut at = objects(scene, frames, numbers, true);
    let all = expect::expect(scene, frames, numbers);
    for (number, list) in at.as_object_mut().expect("frames") {
        let list = list.as_object_mut().expect("objects");
        for p in &scene.placements {
            for instancer in &scene.assets[p.asset].instancers {
                let InstancerMotion::Joints(joints) = &instancer.motion else { continue };
                let states = &all["frames"][number]["instancers"][format!("{}/{}", p.name, instancer.name)];
                joints.iter().for_each(|joint| _ = list.remove(&format!("{}_{}_{joint}", p.name, instancer.name)));
                for (state, joint) in states.as_array().expect("states").iter().zip(joints) {
                    let proto = state["proto"].as_str().expect("name");
                    let merged = format!("{}_{}_{proto}", p.name, instancer.name);
                    let place = list.entry(format!("{merged}_{joint}")).or_insert_with(|| json!({"points": []}));
                    let points = state["points"].as_array().expect("points").clone();
                    place["points"].as_array_mut().expect("list").extend(points);
                }
            }
        }
    }
    at
}
