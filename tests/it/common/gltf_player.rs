//! A small glTF player, written from the format alone: world positions of every mesh node at a time.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::panic,
    clippy::expect_used,
    reason = "test code"
)]

use glam::{Mat4, Quat, Vec3, Vec4};
use serde_json::Value;

/// A .glb in memory.
pub struct Player {
    pub json: Value,
    bin: Vec<u8>,
}

/// Number at a pointer, or a default.
fn number(v: &Value, pointer: &str, default: u64) -> usize {
    v.pointer(pointer).and_then(Value::as_u64).unwrap_or(default) as usize
}

impl Player {
    pub fn new(glb: &[u8]) -> Self {
        let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().expect("word")) as usize;
        assert_eq!((&glb[..4], word(4), word(8)), (&b"glTF"[..], 2, glb.len()));
        assert_eq!((word(12) % 4, &glb[16..20]), (0, &b"JSON"[..]));
        let end = 20 + word(12);
        let json = serde_json::from_slice(&glb[20..end]).expect("json");
        if end == glb.len() {
            return Self { json, bin: Vec::new() };
        }
        assert_eq!((word(end) % 4, &glb[end + 4..end + 8]), (0, &b"BIN\0"[..]));
        Self { json, bin: glb[end + 8..end + 8 + word(end)].to_vec() }
    }

    /// Rows of numbers of an accessor.
    pub fn rows(&self, accessor: usize) -> Vec<Vec<f32>> {
        let a = &self.json["accessors"][accessor];
        let width = match a["type"].as_str().expect("type") {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            other => panic!("{other}"),
        };
        let count = number(a, "/count", 0);
        // Without a view all elements are zeros but those of `sparse`.
        let mut rows = match a["bufferView"].as_u64() {
            Some(view) => self.viewed_rows(a, view as usize, width),
            None => vec![vec![0.0; width]; count],
        };
        // A view of zeros, which accessors share, may be longer than one of them.
        assert!(
            rows.len() == count || rows.len() > count && rows.iter().flatten().all(|c| *c == 0.0),
            "{count} elements"
        );
        rows.truncate(count);
        let sparse = &a["sparse"];
        if sparse.is_null() {
            return rows;
        }
        let listed = number(sparse, "/count", 0);
        let indices =
            self.numbers(number(sparse, "/indices/bufferView", 0), number(sparse, "/indices/componentType", 0), false);
        let values = self.numbers(
            number(sparse, "/values/bufferView", 0),
            number(a, "/componentType", 0),
            a["normalized"] == true,
        );
        assert_eq!((indices.len(), values.len()), (listed, listed * width));
        assert!(indices.windows(2).all(|pair| pair[0] < pair[1]), "indices rise");
        for (i, row) in indices.iter().zip(values.chunks(width)) {
            rows[*i as usize] = row.to_vec();
        }
        rows
    }

    /// The elements of a buffer view of an accessor, each of `width` numbers.
    fn viewed_rows(&self, accessor: &Value, view: usize, width: usize) -> Vec<Vec<f32>> {
        let values = self.numbers(view, number(accessor, "/componentType", 0), accessor["normalized"] == true);
        // Elements may be padded to a stride: what is beyond their width is not theirs.
        let view = &self.json["bufferViews"][view];
        let bytes = number(view, "/byteLength", 0);
        let stride = number(view, "/byteStride", 0) * values.len() / bytes.max(1);
        let stride = if stride == 0 { width } else { stride };
        values.chunks(stride).map(|row| row[..width].to_vec()).collect()
    }

    /// All numbers of a buffer view.
    fn numbers(&self, view: usize, component: usize, normalized: bool) -> Vec<f32> {
        let view = &self.json["bufferViews"][view];
        let start = number(view, "/byteOffset", 0);
        assert_eq!(start % 4, 0, "offsets are multiples of 4");
        let bytes = &self.bin[start..start + number(view, "/byteLength", 0)];
        let unit = |v: f32, one: f32| if normalized { v / one } else { v };
        match component {
            5120 => bytes.iter().map(|b| f32::from(b.cast_signed()) / 127.0).collect(),
            5122 => bytes.chunks_exact(2).map(|b| f32::from(i16::from_le_bytes([b[0], b[1]])) / 32_767.0).collect(),
            5121 => bytes.iter().map(|b| unit(f32::from(*b), 255.0)).collect(),
            5123 => {
                let words = bytes.chunks_exact(2).map(|b| f32::from(u16::from_le_bytes([b[0], b[1]])));
                words.map(|w| unit(w, 65_535.0)).collect()
            }
            5125 => bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32).collect(),
            _ => bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
        }
    }

    /// Index of the node of a name.
    pub fn node(&self, name: &str) -> Option<usize> {
        self.json["nodes"].as_array()?.iter().position(|n| n["name"] == name)
    }

    /// World positions of a mesh node at a time, instance after instance.
    pub fn positions(&self, node: usize, time: f32) -> Vec<Vec3> {
        let source = &self.json["nodes"][node];
        let local = self.shape(node, time);
        if let Some(skin) = source["skin"].as_u64() {
            return self.skinned(skin as usize, node, &local, time);
        }
        let world = self.world(node, time);
        let each = self.instances(node);
        each.iter().flat_map(|m| local.iter().map(move |p| (world * *m).transform_point3(*p))).collect()
    }

    /// Points of all primitives, morphed.
    fn shape(&self, node: usize, time: f32) -> Vec<Vec3> {
        let mesh = &self.json["meshes"][number(&self.json["nodes"][node], "/mesh", 0)];
        let weights = self.sample(node, "weights", time);
        let mut out = Vec::new();
        for primitive in mesh["primitives"].as_array().expect("primitives") {
            let mut points = self.vectors(number(primitive, "/attributes/POSITION", 0));
            for (k, target) in primitive["targets"].as_array().into_iter().flatten().enumerate() {
                let weight = weights.as_ref().map_or(0.0, |w| w[k]);
                if weight.abs() < 1e-9 {
                    continue;
                }
                for (p, d) in points.iter_mut().zip(self.vectors(number(target, "/POSITION", 0))) {
                    *p += d * weight;
                }
            }
            out.extend(points);
        }
        out
    }

    pub fn vectors(&self, accessor: usize) -> Vec<Vec3> {
        self.rows(accessor).iter().map(|r| Vec3::from_slice(r)).collect()
    }

    fn skinned(&self, skin: usize, node: usize, local: &[Vec3], time: f32) -> Vec<Vec3> {
        let skin = &self.json["skins"][skin];
        let joints: Vec<usize> =
            skin["joints"].as_array().expect("joints").iter().map(|j| j.as_u64().expect("index") as usize).collect();
        let inverse = self.rows(number(skin, "/inverseBindMatrices", 0));
        let matrices: Vec<Mat4> =
            joints.iter().zip(&inverse).map(|(j, m)| self.world(*j, time) * Mat4::from_cols_slice(m)).collect();
        let mesh = &self.json["meshes"][number(&self.json["nodes"][node], "/mesh", 0)];
        let (mut joints, mut weights) = (Vec::new(), Vec::new());
        for primitive in mesh["primitives"].as_array().expect("primitives") {
            joints.extend(self.rows(number(primitive, "/attributes/JOINTS_0", 0)));
            weights.extend(self.rows(number(primitive, "/attributes/WEIGHTS_0", 0)));
        }
        let blend = |(p, (j, w)): (&Vec3, (&Vec<f32>, &Vec<f32>))| {
            (0..4).map(|k| matrices[j[k] as usize].transform_point3(*p) * w[k]).fold(Vec3::ZERO, |s, v| s + v)
        };
        local.iter().zip(joints.iter().zip(&weights)).map(blend).collect()
    }

    fn instances(&self, node: usize) -> Vec<Mat4> {
        let Some(attributes) = self.json["nodes"][node].pointer("/extensions/EXT_mesh_gpu_instancing/attributes")
        else {
            return vec![Mat4::IDENTITY];
        };
        let t = self.vectors(number(attributes, "/TRANSLATION", 0));
        let r = self.rows(number(attributes, "/ROTATION", 0));
        let s = attributes["SCALE"].as_u64().map(|s| self.vectors(s as usize));
        (0..t.len())
            .map(|i| {
                let scale = s.as_ref().map_or(Vec3::ONE, |s| s[i]);
                Mat4::from_scale_rotation_translation(scale, Quat::from_slice(&r[i]).normalize(), t[i])
            })
            .collect()
    }

    /// World from node.
    pub fn world(&self, node: usize, time: f32) -> Mat4 {
        let source = &self.json["nodes"][node];
        let of = |key: &str, default: &[f32]| -> Vec<f32> {
            self.sample(node, key, time).unwrap_or_else(|| match source[key].as_array() {
                Some(list) => list.iter().map(|v| v.as_f64().expect("number") as f32).collect(),
                None => default.to_vec(),
            })
        };
        let t = Vec3::from_slice(&of("translation", &[0.0; 3]));
        let r = Quat::from_slice(&of("rotation", &[0.0, 0.0, 0.0, 1.0]));
        let s = Vec3::from_slice(&of("scale", &[1.0; 3]));
        let local = Mat4::from_scale_rotation_translation(s, r, t);
        let nodes = self.json["nodes"].as_array().expect("nodes");
        let holds = |n: &Value| n["children"].as_array().is_some_and(|c| c.contains(&node.into()));
        match nodes.iter().position(holds) {
            Some(parent) => self.world(parent, time) * local,
            None => local,
        }
    }

    /// Times of the keys of an animated property of a node, s.
    pub fn key_times(&self, node: usize, path: &str) -> Vec<f32> {
        let animation = &self.json["animations"][0];
        let drives = |c: &&Value| c["target"]["node"] == node && c["target"]["path"] == path;
        let channel = animation["channels"].as_array().and_then(|channels| channels.iter().find(drives));
        let input = |c: &Value| number(&animation["samplers"][number(c, "/sampler", 0)], "/input", 0);
        channel.map_or_else(Vec::new, |c| self.rows(input(c)).concat())
    }

    /// Value of an animated property at a time; `None` if nothing drives it.
    fn sample(&self, node: usize, path: &str, time: f32) -> Option<Vec<f32>> {
        let animation = self.json["animations"].get(0)?;
        let channels = animation["channels"].as_array()?;
        let drives = |c: &&Value| c["target"]["node"] == node && c["target"]["path"] == path;
        let channel = channels.iter().find(drives)?;
        let sampler = &animation["samplers"][number(channel, "/sampler", 0)];
        let times: Vec<f32> = self.rows(number(sampler, "/input", 0)).concat();
        let flat: Vec<f32> = self.rows(number(sampler, "/output", 0)).concat();
        let values: Vec<&[f32]> = flat.chunks_exact(flat.len() / times.len()).collect();
        let next = times.iter().position(|t| *t > time + 1e-6).unwrap_or(times.len());
        if next == 0 {
            return Some(values[0].to_vec());
        }
        let a = next - 1;
        if next == times.len() || sampler["interpolation"] == "STEP" {
            return Some(values[a].to_vec());
        }
        let t = (time - times[a]) / (times[next] - times[a]);
        if path == "rotation" {
            let q = Quat::from_slice(values[a]).slerp(Quat::from_slice(values[next]), t);
            return Some(Vec4::from(q).to_array().to_vec());
        }
        Some(values[a].iter().zip(values[next]).map(|(a, b)| a + (b - a) * t).collect())
    }
}
