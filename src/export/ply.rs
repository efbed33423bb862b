//! PLY, binary: point clouds, instances and meshes. Y up, metres; colours sRGB.
//!
//! A bake gets `cloud/<asset>[.####].ply` for an asset's points and `cloud/<asset>.<instancer>[.####].ply` for its
//! instances, numbered where they move freely. A single asset `<stem>.ply`: its merged mesh, or its points.

use std::sync::Arc;

use super::merge::merged;
use super::{Exporter, GENERATOR, Summary};
use crate::fence::Folder;
use crate::scene::{
    Asset, AssetFrame, Frame, InstancerMotion, Material, Mesh, Placement, Points, PointsFrame, PointsNow, Scene, Trs,
    check_frame, check_scene, instance_states,
};
use crate::units::{byte, srgb_from_linear};
use crate::{Error, Result};

/// Where the files go.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Layout {
    /// `cloud/..` in the folder of a bake.
    #[default]
    Bake,
    /// `<stem>.ply`.
    Single(String),
}

/// Exporter for PLY.
#[derive(Debug)]
pub struct Ply {
    folder: Folder,
    layout: Layout,
    scene: Option<Arc<Scene>>,
    frames: usize,
}

impl Ply {
    /// Writes into `folder`.
    pub fn new(folder: Folder, layout: Layout) -> Self {
        Self { folder, layout, scene: None, frames: 0 }
    }

    /// Writes a file of parts, one after the other.
    fn save(&self, path: &str, frame: Option<u32>, parts: &[Vec<u8>]) -> Result<()> {
        if let Some(mut out) = self.folder.create(path, "ply", frame)? {
            parts.iter().try_for_each(|part| out.put(part))?;
            out.commit()?;
        }
        Ok(())
    }

    /// Files of all assets whose parts move (`moving`) or stand still. `number`: frame number in the file names.
    fn clouds(&self, scene: &Scene, frame: Option<&Frame>, moving: bool, number: Option<u32>) -> Result<()> {
        let tag = number.map_or_else(String::new, |n| format!(".{}", scene.clip.tag(n)));
        let at = number.unwrap_or(scene.clip.start);
        let rest = AssetFrame::default();
        for (a, asset) in scene.assets.iter().enumerate() {
            let state = frame.and_then(|f| f.assets.get(a)).unwrap_or(&rest);
            if !asset.points.is_empty() && asset.points.iter().any(|p| p.moving) == moving {
                let path = format!("cloud/{}{tag}.ply", asset.id);
                let states = asset.points.iter().enumerate();
                let shown =
                    states.map(|(i, points)| Shown { points, now: points.at(state.points(i)), trs: Trs::IDENTITY });
                self.save(&path, number, &cloud(scene, shown, at))?;
            }
            for (i, instancer) in asset.instancers.iter().enumerate() {
                if (instancer.motion == InstancerMotion::Free) == moving {
                    let path = format!("cloud/{}.{}{tag}.ply", asset.id, instancer.name);
                    self.save(&path, number, &[instances(scene, asset, (i, state), at)])?;
                }
            }
        }
        Ok(())
    }

    fn single(&self, scene: &Scene, stem: &str) -> Result<()> {
        let mut all = Asset {
            id: scene.name.clone(),
            kind: crate::scene::AssetKind::Import,
            group: String::new(),
            skeleton: None,
            meshes: Vec::new(),
            instancers: Vec::new(),
            points: Vec::new(),
            curves: Vec::new(),
        };
        for placement in &scene.placements {
            let Some(asset) = scene.assets.get(placement.asset) else { continue };
            let mesh = merged(asset, &placement.transform);
            let name = placement.name.clone();
            all.meshes.push(crate::scene::MeshObject {
                name,
                mesh,
                motion: crate::scene::MeshMotion::Still,
                skin: None,
            });
        }
        let mesh = merged(&all, &Trs::IDENTITY);
        let at = scene.clip.start;
        let placed = |p: &Placement| Some((&scene.assets.get(p.asset)?.points, p.transform));
        let clouds: Vec<(&Points, Trs)> =
            scene.placements.iter().filter_map(placed).flat_map(|(c, t)| c.iter().map(move |c| (c, t))).collect();
        let parts = if mesh.triangles.is_empty() && !clouds.is_empty() {
            cloud(scene, clouds.into_iter().map(|(points, trs)| Shown::at_rest(points, trs)), at)
        } else {
            vec![mesh_file(scene, &mesh, at)?]
        };
        self.save(&format!("{stem}.ply"), None, &parts)
    }
}

impl Exporter for Ply {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        check_scene(scene)?;
        self.scene = Some(Arc::clone(scene));
        match &self.layout {
            Layout::Bake => self.clouds(scene, None, false, None),
            Layout::Single(stem) => self.single(scene, stem),
        }
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        if self.layout != Layout::Bake {
            return Ok(());
        }
        check_frame(&scene, frame)?;
        self.frames += 1;
        self.clouds(&scene, Some(frame), true, Some(frame.number))
    }

    fn finish(&mut self) -> Result<Summary> {
        if let Some(scene) = self.scene.take()
            && self.frames == 0
            && self.layout == Layout::Bake
        {
            self.clouds(&scene, None, true, None)?;
        }
        Ok(Summary::default())
    }
}

/// Header up to the first element.
fn header(scene: &Scene, frame: u32) -> String {
    let seed = scene.seed;
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment {GENERATOR}\ncomment seed {seed}\ncomment frame {frame}\n\
         comment up Y\ncomment unit m\n"
    )
}

fn floats(names: &str) -> String {
    names.split(' ').map(|n| format!("property float {n}\n")).collect()
}

const COLOR: &str = "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n";

fn put(out: &mut Vec<u8>, values: &[f32]) {
    for v in values {
        out.extend_from_slice(&plain(*v));
    }
}

/// Bytes of a number; minus zero is written as zero.
fn plain(v: f32) -> [u8; 4] {
    (if v == 0.0 { 0.0 } else { v }).to_le_bytes()
}

fn rgba(c: [f32; 4]) -> [u8; 4] {
    [byte(srgb_from_linear(c[0])), byte(srgb_from_linear(c[1])), byte(srgb_from_linear(c[2])), byte(c[3])]
}

fn base_color(materials: &[Material], id: u32) -> [f32; 3] {
    materials.get(id as usize).map_or([1.0; 3], |m| m.base_color)
}

/// A cloud as it is shown.
struct Shown<'a> {
    points: &'a Points,
    now: PointsNow<'a>,
    trs: Trs,
}

impl<'a> Shown<'a> {
    fn at_rest(points: &'a Points, trs: Trs) -> Self {
        Self { points, now: points.at(&PointsFrame::Same), trs }
    }
}

/// All visible points with radius, colour and further numbers (0 where a cloud has none of that name): unsigned bytes
/// where all of a name fit, else 32 bits. Header first, then the rows in parts.
fn cloud<'a>(scene: &Scene, clouds: impl Iterator<Item = Shown<'a>>, frame: u32) -> Vec<Vec<u8>> {
    let clouds: Vec<Shown<'a>> = clouds.collect();
    let mut names: Vec<(&'static str, bool)> = Vec::new();
    for a in clouds.iter().flat_map(|c| &c.points.attributes) {
        let wide = a.values.iter().any(|v| *v > 255);
        match names.iter_mut().find(|n| n.0 == a.name) {
            Some(known) => known.1 |= wide,
            None => names.push((a.name, wide)),
        }
    }
    let parts: Vec<(Vec<u8>, usize)> = clouds.iter().flat_map(|c| rows(scene, c, &names)).collect();
    let count: usize = parts.iter().map(|p| p.1).sum();
    let mut out = header(scene, frame).into_bytes();
    let more: String =
        names.iter().map(|(n, w)| format!("property {} {n}\n", if *w { "uint" } else { "uchar" })).collect();
    out.extend(format!("element vertex {count}\n{}{COLOR}{more}end_header\n", floats("x y z radius")).bytes());
    std::iter::once(out).chain(parts.into_iter().map(|p| p.0)).collect()
}

/// Rows of one cloud and how many, in chunks.
fn rows(scene: &Scene, shown: &Shown<'_>, names: &[(&'static str, bool)]) -> Vec<(Vec<u8>, usize)> {
    let points = shown.points;
    let flat = base_color(&scene.materials, points.material);
    let columns: Vec<(Option<&Vec<u32>>, bool)> =
        names.iter().map(|(n, w)| (points.attributes.iter().find(|a| a.name == *n).map(|a| &a.values), *w)).collect();
    let size = 20 + names.iter().map(|n| if n.1 { 4 } else { 1 }).sum::<usize>();
    crate::par::par_chunks(shown.now.positions, 1 << 16, |first, positions| {
        let mut body = Vec::with_capacity(positions.len() * size);
        let mut colors = Colors::default();
        let mut count = 0;
        for (k, p) in (first..).zip(positions) {
            let width = shown.now.widths.get(k).copied().unwrap_or(0.0);
            if width <= 0.0 {
                continue;
            }
            let p = if shown.trs == Trs::IDENTITY { *p } else { shown.trs.apply(*p) };
            let mut fixed = [0; 20];
            let numbers = [p.x, p.y, p.z, width * shown.trs.s.x * 0.5].map(plain);
            fixed[..16].copy_from_slice(bytemuck::bytes_of(&numbers));
            fixed[16..].copy_from_slice(&colors.bytes(shown.now.colors.get(k).copied().unwrap_or(flat)));
            body.extend_from_slice(&fixed);
            for (values, wide) in &columns {
                let v = values.and_then(|v| v.get(k)).copied().unwrap_or(0).to_le_bytes();
                body.extend_from_slice(if *wide { &v } else { &v[..1] });
            }
            count += 1;
        }
        (body, count)
    })
}

/// Bytes of colours met before: clouds have millions of points and few colours.
struct Colors {
    known: Vec<([f32; 3], [u8; 4])>,
}

impl Default for Colors {
    fn default() -> Self {
        Self { known: vec![([0.0; 3], rgba([0.0, 0.0, 0.0, 1.0])); 256] }
    }
}

impl Colors {
    fn bytes(&mut self, c: [f32; 3]) -> [u8; 4] {
        let bits = c.map(f32::to_bits);
        let hash = bits.iter().fold(0_u32, |h, b| (h ^ b).wrapping_mul(0x9E37_79B1)) >> 24;
        let slot = &mut self.known[hash as usize];
        if slot.0.map(f32::to_bits) != bits {
            *slot = (c, rgba([c[0], c[1], c[2], 1.0]));
        }
        slot.1
    }
}

/// All live instances of an instancer: position, quaternion (w first), scale, wetness, prototype and number.
fn instances(scene: &Scene, asset: &Asset, (i, state): (usize, &AssetFrame), frame: u32) -> Vec<u8> {
    let instancer = &asset.instancers[i];
    let states = instance_states(asset, instancer, i, state);
    let wet = |k: usize| states.wetness.get(k).copied().unwrap_or(0.0);
    let mut body = Vec::new();
    let mut count = 0;
    for k in (0..instancer.len()).filter(|k| states.is_alive(*k)) {
        let t = instancer.transform(&states, k);
        put(&mut body, &[t.t.x, t.t.y, t.t.z, t.r.w, t.r.x, t.r.y, t.r.z, t.s.x, t.s.y, t.s.z, wet(k)]);
        for n in [instancer.protos[k], u32::try_from(k).unwrap_or(u32::MAX)] {
            body.extend_from_slice(&n.to_le_bytes());
        }
        count += 1;
    }
    let names = floats("x y z qw qx qy qz sx sy sz wetness");
    let mut out = header(scene, frame).into_bytes();
    for (p, proto) in instancer.prototypes.iter().enumerate() {
        out.extend(format!("comment proto {p} {}\n", proto.name).bytes());
    }
    out.extend(format!("element vertex {count}\n{names}property int proto\nproperty int id\nend_header\n").bytes());
    out.extend(body);
    out
}

/// A mesh with normals, and its vertex colours or else its materials' flat ones.
fn mesh_file(scene: &Scene, mesh: &Mesh, frame: u32) -> Result<Vec<u8>> {
    let mut colors = vec![[255_u8; 4]; mesh.points.len()];
    for subset in &mesh.subsets {
        let [r, g, b] = base_color(&scene.materials, subset.material);
        let flat = rgba([r, g, b, 1.0]);
        for v in mesh.subset_triangles(subset).iter().flatten() {
            if let Some(c) = colors.get_mut(*v as usize) {
                *c = flat;
            }
        }
    }
    let mut out = header(scene, frame).into_bytes();
    let (n, faces) = (mesh.points.len(), mesh.triangles.len());
    out.extend(format!("element vertex {n}\n{}{COLOR}", floats("x y z nx ny nz")).bytes());
    out.extend(format!("element face {faces}\nproperty list uchar int vertex_indices\nend_header\n").bytes());
    for ((p, normal), c) in mesh.points.iter().zip(&mesh.normals).zip(&colors) {
        put(&mut out, &p.to_array());
        put(&mut out, &normal.to_array());
        out.extend_from_slice(c);
    }
    for t in &mesh.triangles {
        out.push(3);
        for v in t {
            let v = i32::try_from(*v).map_err(|_| Error::export("X010", "more vertices than PLY can number"))?;
            out.extend_from_slice(&v.to_le_bytes());
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minus_zero_is_written_as_zero() {
        let mut out = Vec::new();
        put(&mut out, &[-0.0, 1.0]);
        assert_eq!(out, [0, 0, 0, 0, 0, 0, 0x80, 0x3f]);
    }
}
