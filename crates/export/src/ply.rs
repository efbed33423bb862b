//! PLY, binary: point clouds, instances and meshes. Y up, metres; colours sRGB.
//!
//! A bake gets `cloud/<asset>[.####].ply` for an asset's points and `cloud/<asset>.<instancer>[.####].ply` for its
//! instances, numbered where they move freely. A single asset `<stem>.ply`: its merged mesh, or its points.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::Vec3;

use super::estimate::{EstimateInput, MergedSize};
use super::file_target::FileTarget;
use super::format::FormatInfo;
use super::merge::{Flat, Piece, normal, stream};
use super::{Exporter, GENERATOR, Summary};
use osier_base::files::{Folder, Output};
use osier_base::units::{byte, srgb_from_linear};
use osier_base::{Error, Result};
use osier_scene::{
    Asset, AssetFrame, AttributeData, Frame, InstancerMotion, Material, Mesh, Placement, Points, PointsFrame,
    PointsNow, Scene, Trs, check_frame, check_scene, instance_states,
};

/// PLY in the registry.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "ply",
    about: "point clouds, and instances as points",
    asset_folder: Some("cloud"),
    endings: &[("ply", "points and leaves")],
    pictures_beside: false,
    memory_percent: 0,
    estimate,
    open: |job| vec![Box::new(PlyExporter::new(job.folder.clone(), job.target()))],
};

/// Own: bytes as the binary records have them. A single file holds the merged mesh, points only without one.
fn estimate(input: &EstimateInput) -> u64 {
    if !input.single {
        return input
            .per_asset(|a| a.instances * 60 + (a.points - a.moving_points) * 22 + a.moving_points * input.frames * 22);
    }
    let size = MergedSize::of(input.scene);
    let points = if size.triangles == 0 { size.points * 22 } else { 0 };
    // A vertex with normal and colour, a face with its count.
    size.vertices * 28 + size.triangles * 13 + points
}

/// Exporter for PLY.
#[derive(Debug)]
pub struct PlyExporter {
    folder: Folder,
    target: FileTarget,
    scene: Option<Arc<Scene>>,
    frames: usize,
}

impl PlyExporter {
    /// Writes into `folder`.
    pub fn new(folder: Folder, target: FileTarget) -> Self {
        Self { folder, target, scene: None, frames: 0 }
    }

    /// Writes a file.
    fn save(&self, path: &str, frame: Option<u32>, fill: impl FnOnce(&mut Output) -> Result<()>) -> Result<()> {
        if let Some(mut out) = self.folder.create(path, "ply", frame)? {
            fill(&mut out)?;
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
                self.save(&path, number, |out| cloud(out, scene, shown, at))?;
            }
            for (i, instancer) in asset.instancers.iter().enumerate() {
                if (instancer.motion == InstancerMotion::Free) == moving {
                    let path = format!("cloud/{}.{}{tag}.ply", asset.id, instancer.name);
                    self.save(&path, number, |out| out.put(&instances(scene, asset, i, state, at)))?;
                }
            }
        }
        Ok(())
    }

    /// Everything as one mesh; the points of clouds where there is no mesh.
    fn single(&self, scene: &Scene, stem: &str) -> Result<()> {
        let path = format!("{stem}.ply");
        let flats: Vec<Flat<'_>> = scene.assets.iter().map(Flat::of).collect();
        let placed: Vec<(&Flat<'_>, Trs)> =
            scene.placements.iter().filter_map(|p| Some((flats.get(p.asset)?, p.transform))).collect();
        let at = scene.clip.start;
        let of = |p: &Placement| Some((&scene.assets.get(p.asset)?.points, p.transform));
        let mut clouds =
            scene.placements.iter().filter_map(of).flat_map(|(c, t)| c.iter().map(move |c| (c, t))).peekable();
        if placed.iter().all(|(flat, _)| flat.triangles == 0) && clouds.peek().is_some() {
            let shown = clouds.map(|(points, trs)| Shown::at_rest(points, trs));
            return self.save(&path, None, |out| cloud(out, scene, shown, at));
        }
        self.save(&path, None, |out| mesh(out, scene, &placed, at))
    }
}

impl Exporter for PlyExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        check_scene(scene)?;
        self.scene = Some(Arc::clone(scene));
        match &self.target {
            FileTarget::Bake => self.clouds(scene, None, false, None),
            FileTarget::Single(stem) => self.single(scene, stem),
        }
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        if self.target != FileTarget::Bake {
            return Ok(());
        }
        check_frame(&scene, frame)?;
        self.frames += 1;
        self.clouds(&scene, Some(frame), true, Some(frame.number))
    }

    fn finish(&mut self) -> Result<Summary> {
        if let Some(scene) = self.scene.take()
            && self.frames == 0
            && self.target == FileTarget::Bake
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

    /// Width of a point, m; 0 for one that is not seen.
    fn width(&self, k: usize) -> f32 {
        self.now.widths.get(k).copied().unwrap_or(0.0)
    }
}

/// Points that are made at once, and those of a task.
const SLICE: usize = 1 << 20;
const CHUNK: usize = 1 << 16;

/// All visible points with radius, colour and further numbers (0 where a cloud has none of that name): unsigned bytes
/// where all of a name fit, else 32 bits.
fn cloud<'a>(out: &mut Output, scene: &Scene, clouds: impl Iterator<Item = Shown<'a>>, frame: u32) -> Result<()> {
    let clouds: Vec<Shown<'a>> = clouds.collect();
    let mut names: Vec<(&'static str, bool)> = Vec::new();
    let attributes = clouds.iter().flat_map(|c| &c.points.attributes);
    for (name, values) in attributes.filter_map(|a| Some((a.name, a.data.counts()?))) {
        let wide = values.iter().any(|v| *v > 255);
        match names.iter_mut().find(|n| n.0 == name) {
            Some(known) => known.1 |= wide,
            None => names.push((name, wide)),
        }
    }
    let seen = |c: &Shown<'_>| (0..c.now.positions.len()).filter(|k| c.width(*k) > 0.0).count();
    let count: usize = clouds.iter().map(seen).sum();
    let more: String =
        names.iter().map(|(n, w)| format!("property {} {n}\n", if *w { "uint" } else { "uchar" })).collect();
    let head = format!("element vertex {count}\n{}{COLOR}{more}end_header\n", floats("x y z radius"));
    out.put((header(scene, frame) + &head).as_bytes())?;
    for shown in &clouds {
        for (i, positions) in shown.now.positions.chunks(SLICE).enumerate() {
            let rows = osier_base::par::par_chunks(positions, CHUNK, |first, positions| {
                rows(scene, shown, &names, i * SLICE + first, positions)
            });
            rows.iter().try_for_each(|body| out.put(body))?;
        }
    }
    Ok(())
}

/// Rows of some points of a cloud, the first of which has number `first`.
fn rows(scene: &Scene, shown: &Shown<'_>, names: &[(&'static str, bool)], first: usize, positions: &[Vec3]) -> Vec<u8> {
    let points = shown.points;
    let flat = base_color(&scene.materials, points.material);
    let values = |name: &str| points.attributes.iter().find(|a| a.name == name).and_then(|a| a.data.counts());
    let columns: Vec<(Option<&[u32]>, bool)> = names.iter().map(|(name, wide)| (values(name), *wide)).collect();
    let size = 20 + names.iter().map(|n| if n.1 { 4 } else { 1 }).sum::<usize>();
    let mut body = Vec::with_capacity(positions.len() * size);
    let mut colors = Colors::default();
    for (k, p) in (first..).zip(positions) {
        let width = shown.width(k);
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
    }
    body
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

/// Column that every file of instances has, zero where an instancer has no such attribute, so that readers need not ask for it.
const FIXED_COLUMN: &str = "wetness";

/// All live instances of an instancer: position, quaternion (w first), scale, its attributes of single numbers, prototype and
/// number.
fn instances(scene: &Scene, asset: &Asset, i: usize, state: &AssetFrame, frame: u32) -> Vec<u8> {
    let instancer = &asset.instancers[i];
    let states = instance_states(asset, instancer, i, state);
    let others = states.attributes.iter().filter(|a| a.name != FIXED_COLUMN && a.data.scalars().is_some());
    let columns: Vec<&str> = std::iter::once(FIXED_COLUMN).chain(others.map(|a| a.name)).collect();
    let values: Vec<&[f32]> = columns
        .iter()
        .map(|name| states.attribute(name).and_then(AttributeData::scalars).unwrap_or_default())
        .collect();
    let mut body = Vec::new();
    let mut count = 0;
    for k in (0..instancer.len()).filter(|k| states.is_alive(*k)) {
        let t = instancer.transform(&states, k);
        put(&mut body, &[t.t.x, t.t.y, t.t.z, t.r.w, t.r.x, t.r.y, t.r.z, t.s.x, t.s.y, t.s.z]);
        values.iter().for_each(|v| put(&mut body, &[v.get(k).copied().unwrap_or(0.0)]));
        for n in [instancer.protos[k], u32::try_from(k).unwrap_or(u32::MAX)] {
            body.extend_from_slice(&n.to_le_bytes());
        }
        count += 1;
    }
    let names = floats(&format!("x y z qw qx qy qz sx sy sz {}", columns.join(" ")));
    let mut out = header(scene, frame).into_bytes();
    for (p, proto) in instancer.prototypes.iter().enumerate() {
        out.extend(format!("comment proto {p} {}\n", proto.name).bytes());
    }
    out.extend(format!("element vertex {count}\n{names}property int proto\nproperty int id\nend_header\n").bytes());
    out.extend(body);
    out
}

/// A mesh with normals, and its materials' flat colours: part by part, once for points and once for each material.
fn mesh(out: &mut Output, scene: &Scene, placed: &[(&Flat<'_>, Trs)], frame: u32) -> Result<()> {
    let vertices: u64 = placed.iter().map(|p| p.0.vertices).sum();
    let faces: u64 = placed.iter().map(|p| p.0.triangles).sum();
    if i32::try_from(vertices).is_err() {
        return Err(Error::export("X010", "more vertices than PLY can number; write .usdc or .glb"));
    }
    let mut order: Vec<u32> = Vec::new();
    let mut known = BTreeSet::new();
    let first = placed.iter().flat_map(|p| &p.0.materials).filter(|m| known.insert(**m));
    order.extend(first);
    let rank: BTreeMap<u32, usize> = order.iter().enumerate().map(|(i, m)| (*m, i)).collect();
    let mut head = header(scene, frame);
    head += &format!("element vertex {vertices}\n{}{COLOR}", floats("x y z nx ny nz"));
    head += &format!("element face {faces}\nproperty list uchar int vertex_indices\nend_header\n");
    out.put(head.as_bytes())?;
    let paint = Paint::new(scene, placed, rank);
    let rows = |pieces: &[Piece<'_>]| {
        let mut body = Vec::new();
        pieces.iter().for_each(|p| vertex_rows(&mut body, p, &paint));
        body
    };
    for (flat, world) in placed {
        stream(flat.points(*world), rows, |body| out.put(&body))?;
    }
    for material in order {
        let mut base = 0;
        for (flat, world) in placed {
            stream(flat.triangles(*world, material, base), face_rows, |body| out.put(&body))?;
            base += flat.vertices;
        }
    }
    Ok(())
}

fn vertex_rows(body: &mut Vec<u8>, piece: &Piece<'_>, paint: &Paint<'_>) {
    let own;
    let colors = match paint.large.get(&address(piece.mesh)) {
        Some(colors) => colors,
        None => {
            own = paint.colors(piece.mesh);
            &own
        }
    };
    for ((p, n), c) in piece.points().zip(piece.normals()).zip(&colors[piece.range.clone()]) {
        put(body, &p.to_array());
        // Once more, as if the placed asset were merged with others.
        put(body, &normal(&Trs::IDENTITY, n).to_array());
        body.extend_from_slice(c);
    }
}

/// Colours of points.
struct Paint<'a> {
    scene: &'a Scene,
    /// Places of materials in the file's order.
    rank: BTreeMap<u32, usize>,
    /// Of meshes that are written in several runs, by their addresses.
    large: BTreeMap<usize, Vec<[u8; 4]>>,
}

impl<'a> Paint<'a> {
    fn new(scene: &'a Scene, placed: &[(&Flat<'_>, Trs)], rank: BTreeMap<u32, usize>) -> Self {
        let mut paint = Self { scene, rank, large: BTreeMap::new() };
        for mesh in placed.iter().flat_map(|p| p.0.large()) {
            let colors = paint.colors(mesh);
            paint.large.insert(address(mesh), colors);
        }
        paint
    }

    /// That of the last material in the file's order whose triangles have the point.
    fn colors(&self, mesh: &Mesh) -> Vec<[u8; 4]> {
        let mut colors = vec![[255_u8; 4]; mesh.points.len()];
        let mut subsets: Vec<&osier_scene::Subset> = mesh.subsets.iter().collect();
        subsets.sort_by_key(|s| self.rank.get(&s.material).copied().unwrap_or(usize::MAX));
        for subset in subsets {
            let [r, g, b] = base_color(&self.scene.materials, subset.material);
            let flat = rgba([r, g, b, 1.0]);
            for v in mesh.subset_triangles(subset).iter().flatten() {
                if let Some(c) = colors.get_mut(*v as usize) {
                    *c = flat;
                }
            }
        }
        colors
    }
}

fn address(mesh: &Mesh) -> usize {
    std::ptr::from_ref(mesh).addr()
}

fn face_rows(pieces: &[Piece<'_>]) -> Vec<u8> {
    let mut body = Vec::new();
    for piece in pieces {
        for corners in piece.corners() {
            body.push(3);
            for v in corners {
                let v = i32::try_from(u64::from(v) + piece.base).unwrap_or(i32::MAX);
                body.extend_from_slice(&v.to_le_bytes());
            }
        }
    }
    body
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
