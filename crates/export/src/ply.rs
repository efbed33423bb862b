//! PLY, binary little endian: point clouds, instances and meshes. Y up, metres; colours sRGB.
//!
//! A bake has `cloud/<asset>[.####].ply` with the points of an asset, and `cloud/<asset>.<instancer>[.####].ply` with its
//! instances; those that move freely in a file for each frame. A single file `<stem>.ply` has the merged mesh, or, without a
//! mesh, the points.
//!
//! ```
//! assert_eq!(osier_export::ply::FORMAT.folder, "cloud");
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::estimate::{AssetSize, EstimateInput, MergedSize};
use super::file_target::FileTarget;
use super::format::{FormatInfo, TextureUse};
use super::merge::{FlattenedAsset, PartRange, format_in_parallel, transform_normal};
use super::{Exporter, GENERATOR, Summary};
use osier_base::files::{Folder, Output};
use osier_base::units::{byte, linear_from_srgb, srgb_from_linear};
use osier_base::{Error, Result};
use osier_scene::{
    Asset, AssetFrame, AttributeData, Frame, Image, InstancerMotion, Material, Mesh, Pixels, Placement, Points,
    PointsFrame, PointsNow, Scene, Trs, check_frame, check_scene, instance_states, pixel_at,
};

/// Registry entry of PLY: points and instances in a bake, a merged mesh in a single file.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "ply",
    about: "point clouds, and instances as points",
    folder: "cloud",
    names_assets: true,
    notes_missing_files: true,
    endings: &[("ply", "points and leaves")],
    pictures_beside: false,
    textures: TextureUse::Unused,
    memory_percent: 0,
    estimate,
    open: |job| vec![Box::new(PlyExporter::new(job.folder.clone(), job.target()))],
};

/// Estimate from bytes per record.
fn estimate(input: &EstimateInput) -> u64 {
    if !input.single {
        // Points, and instances that move freely, have a file for each frame, or one in a still scene.
        let frames = input.frames.max(1);
        let of_asset = |(a, shown): (&AssetSize, Option<u64>)| {
            let still = (a.instances - a.free_instances) * 60 + (a.points - a.moving_points) * 22;
            a.weight * (still + frames * (shown.unwrap_or(a.free_instances) * 52 + a.moving_points * 22))
        };
        return input.assets.iter().zip(input.instances_of_growth()).map(of_asset).sum();
    }
    let size = MergedSize::of(input.scene);
    let points = if size.triangles == 0 { size.points * 22 } else { 0 };
    // A vertex with normal and colour, a face with its count.
    size.vertices * 28 + size.triangles * 13 + points
}

/// Writes points and instances of a bake, or the merged mesh of a single file, as PLY.
#[derive(Debug)]
pub struct PlyExporter {
    folder: Folder,
    target: FileTarget,
    scene: Option<Arc<Scene>>,
    frames: usize,
}

impl PlyExporter {
    /// An exporter that writes below `folder`; `target` decides between the files of a bake and a single one.
    pub fn new(folder: Folder, target: FileTarget) -> Self {
        Self { folder, target, scene: None, frames: 0 }
    }

    /// Creates a file and fills it, unless an interrupted bake has left it complete.
    fn write_file(&self, path: &str, frame: Option<u32>, fill: impl FnOnce(&mut Output) -> Result<()>) -> Result<()> {
        if let Some(mut out) = self.folder.create(path, "ply", frame)? {
            fill(&mut out)?;
            out.commit()?;
        }
        Ok(())
    }

    /// Writes the points and instances of all assets that move freely (`moving`), or all others. `number`: frame
    /// number in the names of the files.
    fn write_clouds(&self, scene: &Scene, frame: Option<&Frame>, moving: bool, number: Option<u32>) -> Result<()> {
        let tag = number.map_or_else(String::new, |n| format!(".{}", scene.clip.tag(n)));
        let at = number.unwrap_or(scene.clip.start);
        let rest = AssetFrame::default();
        for (a, asset) in scene.assets.iter().enumerate() {
            let state = frame.and_then(|f| f.assets.get(a)).unwrap_or(&rest);
            if !asset.points.is_empty() && asset.points.iter().any(|p| p.moving) == moving {
                let path = format!("cloud/{}{tag}.ply", asset.id);
                let states = asset.points.iter().enumerate();
                let cloud = states.map(|(i, points)| PlacedCloud {
                    points,
                    now: points.at(state.points(i)),
                    trs: Trs::IDENTITY,
                });
                self.write_file(&path, number, |out| write_points(out, scene, cloud, at))?;
            }
            for (i, instancer) in asset.instancers.iter().enumerate() {
                if (instancer.motion == InstancerMotion::Free) == moving {
                    let path = format!("cloud/{}.{}{tag}.ply", asset.id, instancer.name);
                    self.write_file(&path, number, |out| out.put(&instance_file(scene, asset, i, state, at)))?;
                }
            }
        }
        Ok(())
    }

    /// Writes all placements as one mesh, or the points of clouds if there is no mesh.
    fn write_single(&self, scene: &Scene, path: &str) -> Result<()> {
        let assets: Vec<FlattenedAsset<'_>> = scene.assets.iter().map(FlattenedAsset::of).collect();
        let placed: Vec<(&FlattenedAsset<'_>, Trs)> =
            scene.placements.iter().filter_map(|p| Some((assets.get(p.asset)?, p.transform))).collect();
        let at = scene.clip.start;
        let of = |p: &Placement| Some((&scene.assets.get(p.asset)?.points, p.transform));
        let mut clouds =
            scene.placements.iter().filter_map(of).flat_map(|(c, t)| c.iter().map(move |c| (c, t))).peekable();
        if placed.iter().all(|(flat, _)| flat.triangles == 0) && clouds.peek().is_some() {
            let cloud = clouds.map(|(points, trs)| PlacedCloud::at_rest(points, trs));
            return self.write_file(path, None, |out| write_points(out, scene, cloud, at));
        }
        self.write_file(path, None, |out| write_mesh(out, scene, &placed, at))
    }
}

impl Exporter for PlyExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        check_scene(scene)?;
        self.scene = Some(Arc::clone(scene));
        match &self.target {
            FileTarget::Bake => self.write_clouds(scene, None, false, None),
            FileTarget::Single(file) => self.write_single(scene, file),
        }
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        if self.target != FileTarget::Bake {
            return Ok(());
        }
        check_frame(&scene, frame)?;
        self.frames += 1;
        self.write_clouds(&scene, Some(frame), true, Some(frame.number))
    }

    fn finish(&mut self) -> Result<Summary> {
        if let Some(scene) = self.scene.take()
            && self.frames == 0
            && self.target == FileTarget::Bake
        {
            self.write_clouds(&scene, None, true, None)?;
        }
        Ok(Summary::default())
    }
}

/// Header up to the first element, with seed, frame, up axis and unit as comments.
fn header(scene: &Scene, frame: u32) -> String {
    let seed = scene.seed;
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment {GENERATOR}\ncomment seed {seed}\ncomment frame {frame}\n\
         comment up Y\ncomment unit m\n"
    )
}

fn float_properties(names: &str) -> String {
    names.split(' ').map(|n| format!("property float {n}\n")).collect()
}

const COLOR: &str = "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n";

fn put_floats(out: &mut Vec<u8>, values: &[f32]) {
    for v in values {
        out.extend_from_slice(&le_bytes(*v));
    }
}

/// Bytes of a number; minus zero is written as zero.
fn le_bytes(v: f32) -> [u8; 4] {
    (if v == 0.0 { 0.0 } else { v }).to_le_bytes()
}

fn rgba(c: [f32; 4]) -> [u8; 4] {
    [byte(srgb_from_linear(c[0])), byte(srgb_from_linear(c[1])), byte(srgb_from_linear(c[2])), byte(c[3])]
}

fn base_color(materials: &[Material], id: u32) -> [f32; 3] {
    materials.get(id as usize).map_or([1.0; 3], |m| m.base_color)
}

/// A point cloud in its state at a frame, and the transform of its placement.
struct PlacedCloud<'a> {
    points: &'a Points,
    now: PointsNow<'a>,
    trs: Trs,
}

impl<'a> PlacedCloud<'a> {
    fn at_rest(points: &'a Points, trs: Trs) -> Self {
        Self { points, now: points.at(&PointsFrame::Same), trs }
    }

    /// Width of a point, m; 0 if it is hidden.
    fn width(&self, k: usize) -> f32 {
        self.now.widths.get(k).copied().unwrap_or(0.0)
    }
}

/// Number of points that are formatted before they are written.
const POINTS_PER_WRITE: usize = 1 << 20;
/// Number of points that one parallel task formats.
const POINTS_PER_TASK: usize = 1 << 16;

/// Writes all visible points with position, radius, colour and integer attributes (0 where a cloud lacks one). An attribute has
/// unsigned bytes if its values in all clouds fit, else 32 bits.
fn write_points<'a>(
    out: &mut Output,
    scene: &Scene,
    clouds: impl Iterator<Item = PlacedCloud<'a>>,
    frame: u32,
) -> Result<()> {
    let clouds: Vec<PlacedCloud<'a>> = clouds.collect();
    // Names of all attributes in order of first use, each with whether any value needs more than a byte.
    let mut names: Vec<(&'static str, bool)> = Vec::new();
    let attributes = clouds.iter().flat_map(|c| &c.points.attributes);
    for (name, values) in attributes.filter_map(|a| Some((a.name, a.data.counts()?))) {
        // The width belongs to the name, not to the cloud: all records of the file have the same size.
        let wide = values.iter().any(|v| *v > 255);
        match names.iter_mut().find(|n| n.0 == name) {
            Some(known) => known.1 |= wide,
            None => names.push((name, wide)),
        }
    }
    // Count first: the header with the number of records is written before the rows.
    let seen = |c: &PlacedCloud<'_>| (0..c.now.positions.len()).filter(|k| c.width(*k) > 0.0).count();
    let count: usize = clouds.iter().map(seen).sum();
    let more: String =
        names.iter().map(|(n, w)| format!("property {} {n}\n", if *w { "uint" } else { "uchar" })).collect();
    let head = format!("element vertex {count}\n{}{COLOR}{more}end_header\n", float_properties("x y z radius"));
    out.put((header(scene, frame) + &head).as_bytes())?;
    for cloud in &clouds {
        for (i, positions) in cloud.now.positions.chunks(POINTS_PER_WRITE).enumerate() {
            let rows = osier_base::par::par_chunks(positions, POINTS_PER_TASK, |first, positions| {
                point_rows(scene, cloud, &names, i * POINTS_PER_WRITE + first, positions)
            });
            rows.iter().try_for_each(|body| out.put(body))?;
        }
    }
    Ok(())
}

/// Binary records of the visible points among `positions`. `first`: index of the first position in the cloud.
fn point_rows(
    scene: &Scene,
    cloud: &PlacedCloud<'_>,
    names: &[(&'static str, bool)],
    first: usize,
    positions: &[Vec3],
) -> Vec<u8> {
    let points = cloud.points;
    let flat = base_color(&scene.materials, points.material);
    let values = |name: &str| points.attributes.iter().find(|a| a.name == name).and_then(|a| a.data.counts());
    let columns: Vec<(Option<&[u32]>, bool)> = names.iter().map(|(name, wide)| (values(name), *wide)).collect();
    let size = 20 + names.iter().map(|n| if n.1 { 4 } else { 1 }).sum::<usize>();
    let mut body = Vec::with_capacity(positions.len() * size);
    let mut colors = ColorCache::default();
    for (k, p) in (first..).zip(positions) {
        let width = cloud.width(k);
        if width <= 0.0 {
            continue;
        }
        let p = if cloud.trs == Trs::IDENTITY { *p } else { cloud.trs.apply(*p) };
        // x, y, z and radius as floats, then four bytes of colour.
        let mut fixed = [0; 20];
        // The radius is half the width, scaled by the factor of the x axis only, as a sphere has one radius.
        let numbers = [p.x, p.y, p.z, width * cloud.trs.s.x * 0.5].map(le_bytes);
        fixed[..16].copy_from_slice(bytemuck::bytes_of(&numbers));
        fixed[16..].copy_from_slice(&colors.bytes(cloud.now.colors.get(k).copied().unwrap_or(flat)));
        body.extend_from_slice(&fixed);
        for (values, wide) in &columns {
            let v = values.and_then(|v| v.get(k)).copied().unwrap_or(0).to_le_bytes();
            body.extend_from_slice(if *wide { &v } else { &v[..1] });
        }
    }
    body
}

/// A direct-mapped cache from linear to sRGB colours: clouds have millions of points and few colours, and each conversion takes
/// three powers.
struct ColorCache {
    known: Vec<([f32; 3], [u8; 4])>,
}

impl Default for ColorCache {
    fn default() -> Self {
        Self { known: vec![([0.0; 3], rgba([0.0, 0.0, 0.0, 1.0])); 256] }
    }
}

impl ColorCache {
    fn bytes(&mut self, c: [f32; 3]) -> [u8; 4] {
        // Multiplicative hash of the bits; its upper 8 bits choose one of 256 slots, which holds the colour last converted.
        let bits = c.map(f32::to_bits);
        let hash = bits.iter().fold(0_u32, |h, b| (h ^ b).wrapping_mul(0x9E37_79B1)) >> 24;
        let slot = &mut self.known[hash as usize];
        if slot.0.map(f32::to_bits) != bits {
            *slot = (c, rgba([c[0], c[1], c[2], 1.0]));
        }
        slot.1
    }
}

/// Column of every file of instances, with zeros if an instancer has no such attribute, so that readers can rely on it.
const FIXED_COLUMN: &str = "wetness";

/// The file of the live instances of an instancer: position, quaternion (w first), scale, scalar attributes, prototype and index.
fn instance_file(scene: &Scene, asset: &Asset, i: usize, state: &AssetFrame, frame: u32) -> Vec<u8> {
    let instancer = &asset.instancers[i];
    let states = instance_states(asset, instancer, i, state);
    // The fixed column comes first in every file; the others follow in the order of the instancer.
    let others = states.attributes.iter().filter(|a| a.name != FIXED_COLUMN && a.data.scalars().is_some());
    let columns: Vec<&str> = std::iter::once(FIXED_COLUMN).chain(others.map(|a| a.name)).collect();
    let values: Vec<&[f32]> = columns
        .iter()
        .map(|name| states.attribute(name).and_then(AttributeData::scalars).unwrap_or_default())
        .collect();
    let mut body = Vec::new();
    let mut count = 0;
    for (id, k) in (0_u32..).zip(0..instancer.len()).filter(|(_, k)| states.is_alive(*k)) {
        let t = instancer.transform(&states, k);
        put_floats(&mut body, &[t.t.x, t.t.y, t.t.z, t.r.w, t.r.x, t.r.y, t.r.z, t.s.x, t.s.y, t.s.z]);
        values.iter().for_each(|v| put_floats(&mut body, &[v.get(k).copied().unwrap_or(0.0)]));
        for n in [instancer.protos[k], id] {
            body.extend_from_slice(&n.to_le_bytes());
        }
        count += 1;
    }
    let names = float_properties(&format!("x y z qw qx qy qz sx sy sz {}", columns.join(" ")));
    let mut out = header(scene, frame).into_bytes();
    for (p, proto) in instancer.prototypes.iter().enumerate() {
        out.extend(format!("comment proto {p} {}\n", proto.name).bytes());
    }
    out.extend(format!("element vertex {count}\n{names}property int proto\nproperty int id\nend_header\n").bytes());
    out.extend(body);
    out
}

/// Writes a mesh with normals and colours, streamed: all points, then the faces of each material.
fn write_mesh(out: &mut Output, scene: &Scene, placed: &[(&FlattenedAsset<'_>, Trs)], frame: u32) -> Result<()> {
    let vertices: u64 = placed.iter().map(|p| p.0.vertices).sum();
    let faces: u64 = placed.iter().map(|p| p.0.triangles).sum();
    if i32::try_from(vertices).is_err() {
        return Err(Error::export("X010", "more vertices than PLY can number; write .usdc or .glb"));
    }
    let mut order: Vec<u32> = Vec::new();
    // Materials in the order of first use over all placements, each once; faces follow in that order.
    let mut known = BTreeSet::new();
    let first = placed.iter().flat_map(|p| &p.0.materials).filter(|m| known.insert(**m));
    order.extend(first);
    let rank: BTreeMap<u32, usize> = order.iter().enumerate().map(|(i, m)| (*m, i)).collect();
    let mut head = header(scene, frame);
    head += &format!("element vertex {vertices}\n{}{COLOR}", float_properties("x y z nx ny nz"));
    head += &format!("element face {faces}\nproperty list uchar int vertex_indices\nend_header\n");
    out.put(head.as_bytes())?;
    let vertex_colors = VertexColors::new(scene, placed, rank);
    let rows = |ranges: &[PartRange<'_>]| {
        let mut body = Vec::new();
        ranges.iter().for_each(|p| vertex_rows(&mut body, p, &vertex_colors));
        body
    };
    for (flat, world) in placed {
        format_in_parallel(flat.points(*world), rows, |body| out.put(&body))?;
    }
    for material in order {
        // Faces are grouped by material, so each material needs a pass over all placements. `base`:
        // number of a placement's first point.
        let mut base = 0;
        for (flat, world) in placed {
            format_in_parallel(flat.triangles(*world, material, base), face_rows, |body| out.put(&body))?;
            base += flat.vertices;
        }
    }
    Ok(())
}

fn vertex_rows(body: &mut Vec<u8>, range: &PartRange<'_>, vertex_colors: &VertexColors<'_>) {
    // Colours of small meshes are computed anew in each range; only meshes split into several ranges are cached.
    let own;
    let colors = match vertex_colors.large_colors.get(&address(range.mesh)) {
        Some(colors) => colors,
        None => {
            own = vertex_colors.colors(range.mesh);
            &own
        }
    };
    for ((p, n), c) in range.points().zip(range.normals()).zip(&colors[range.range.clone()]) {
        put_floats(body, &p.to_array());
        // Normalised a second time, so that the bytes equal those of a mesh that was merged before it was written.
        put_floats(body, &transform_normal(&Trs::IDENTITY, n).to_array());
        body.extend_from_slice(c);
    }
}

/// Colours of the vertices of meshes, from the materials of their faces.
struct VertexColors<'a> {
    scene: &'a Scene,
    /// Position of each material in the order of the file.
    rank: BTreeMap<u32, usize>,
    /// Colours of meshes that are split into several ranges, by the address of the mesh.
    large_colors: BTreeMap<usize, Vec<[u8; 4]>>,
}

impl<'a> VertexColors<'a> {
    fn new(scene: &'a Scene, placed: &[(&FlattenedAsset<'_>, Trs)], rank: BTreeMap<u32, usize>) -> Self {
        let mut vertex_colors = Self { scene, rank, large_colors: BTreeMap::new() };
        for mesh in placed.iter().flat_map(|p| p.0.large_meshes()) {
            let colors = vertex_colors.colors(mesh);
            vertex_colors.large_colors.insert(address(mesh), colors);
        }
        vertex_colors
    }

    fn colors(&self, mesh: &Mesh) -> Vec<[u8; 4]> {
        mesh_colors(mesh, &self.scene.materials, &self.scene.images, &self.rank)
    }
}

/// The colour of each vertex: that of the last material, in the order of the file, whose faces use it, times the vertex's own
/// colour. A material has its flat colour, or the texel at the vertex where its texture alone has the colour.
fn mesh_colors(mesh: &Mesh, materials: &[Material], images: &[Image], rank: &BTreeMap<u32, usize>) -> Vec<[u8; 4]> {
    // Vertices that no face uses are white.
    let mut colors = vec![[255_u8; 4]; mesh.points.len()];
    let mut subsets: Vec<&osier_scene::Subset> = mesh.subsets.iter().collect();
    subsets.sort_by_key(|s| rank.get(&s.material).copied().unwrap_or(usize::MAX));
    for subset in subsets {
        let [r, g, b] = base_color(materials, subset.material);
        let flat = rgba([r, g, b, 1.0]);
        let texture = sole_texture(materials, images, subset.material);
        for v in mesh.subset_triangles(subset).iter().flatten().map(|v| *v as usize) {
            let texel = texture.zip(mesh.uvs.get(v)).and_then(|(image, uv)| linear_texel(image, *uv));
            let own = mesh.colors.get(v);
            let Some(color) = colors.get_mut(v) else { continue };
            *color = match (texel, own) {
                (None, None) => flat,
                (texel, own) => {
                    let [r, g, b] = texel.unwrap_or([r, g, b]);
                    let [x, y, z, _] = own.copied().unwrap_or([1.0; 4]);
                    rgba([r * x, g * y, b * z, 1.0])
                }
            };
        }
    }
    colors
}

/// The colour texture of a material whose flat colour is white, such as that of an imported mesh. The flat colour of a
/// drawn material is the mean of its texture, which represents a fine pattern better than single texels.
fn sole_texture<'a>(materials: &[Material], images: &'a [Image], id: u32) -> Option<&'a Image> {
    let material = materials.get(id as usize).filter(|m| m.base_color.iter().all(|c| *c >= 1.0))?;
    images.get(material.maps.color? as usize)
}

/// Linear colour of an image at texture coordinates; `None` for 16-bit images. An image of one or two channels is grey.
fn linear_texel(image: &Image, uv: Vec2) -> Option<[f32; 3]> {
    let Pixels::U8(samples) = &image.pixels else { return None };
    let channels = usize::from(image.channels);
    let first = pixel_at(uv, [image.width, image.height]) * channels;
    let texel: [u8; 3] = match channels {
        1 | 2 => [*samples.get(first)?; 3],
        _ => samples.get(first..first + 3)?.try_into().ok()?,
    };
    Some(texel.map(|c| linear_from_srgb(f32::from(c) / 255.0)))
}

fn address(mesh: &Mesh) -> usize {
    std::ptr::from_ref(mesh).addr()
}

fn face_rows(ranges: &[PartRange<'_>]) -> Vec<u8> {
    let mut body = Vec::new();
    for range in ranges {
        for corners in range.corners() {
            body.push(3);
            for v in corners {
                // `write_mesh` has checked that all vertices have numbers below 2^31: the low four bytes hold the whole
                // number.
                let v = u64::from(v) + range.base;
                body.extend_from_slice(&v.to_le_bytes()[..4]);
            }
        }
    }
    body
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::{ImageKind, MaterialClass};

    /// A triangle of an imported mesh: its texture alone has its colours. A flat colour beside a texture is the mean of it.
    #[test]
    fn vertices_have_the_colour_of_an_imported_texture() {
        let pixels = Pixels::U8(vec![255, 0, 0, 0, 0, 255, 0, 128, 0, 255, 255, 255]);
        let image = Image { name: "a".into(), kind: ImageKind::Color, width: 2, height: 2, channels: 3, pixels };
        let material = |base_color| {
            let mut material = Material::plain("a".into(), MaterialClass::Leaf, base_color, 1.0);
            material.maps.color = Some(0);
            material
        };
        let mut mesh = Mesh {
            points: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            uvs: vec![Vec2::new(0.1, 0.9), Vec2::new(0.9, 0.9), Vec2::new(1.1, 0.1)],
            ..Mesh::default()
        };
        mesh.append_subset(0, vec![[0, 1, 2]]);
        let colors = |base| mesh_colors(&mesh, &[material(base)], std::slice::from_ref(&image), &BTreeMap::new());
        assert_eq!(colors([1.0; 3]), [[255, 0, 0, 255], [0, 0, 255, 255], [0, 128, 0, 255]]);
        assert_eq!(colors([0.0, 1.0, 0.0]), [[0, 255, 0, 255]; 3]);
        let grey = Image { channels: 1, pixels: Pixels::U8(vec![10, 20, 30, 40]), ..image.clone() };
        let greys = mesh_colors(&mesh, &[material([1.0; 3])], &[grey], &BTreeMap::new());
        assert_eq!(greys, [[10, 10, 10, 255], [20, 20, 20, 255], [30, 30, 30, 255]]);
    }

    #[test]
    fn minus_zero_is_written_as_zero() {
        let mut out = Vec::new();
        put_floats(&mut out, &[-0.0, 1.0]);
        assert_eq!(out, [0, 0, 0, 0, 0, 0, 0x80, 0x3f]);
    }
}
