//! Gives faces of walls, roofs, bark and ground that rain reaches a wet variant of their material; sheltered faces stay dry.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;

use super::wet_film::{WetDryFaces, add_wet_materials};
use crate::bake::BakeContext;
use crate::bake::scene::builder::SceneBuilder;
use osier_base::Result;
use osier_base::convert::to_usize;
use osier_base::geometry::Bounds;
use osier_motion::rain::{ExposedPoint, RainExposure};
use osier_scene::{Material, MaterialClass, MaterialId, Mesh, MeshMotion, MeshObject, Subset, Trs};

/// Catch ratio, relative to open level ground, above which a surface is wet. Own: rain that has lasted for minutes wets every
/// surface that it strikes; with larger values walls struck by slanting rain stay dry.
const WET_CATCH_RATIO: f32 = 0.1;
/// Longest edge, m, of a face near solids that is not divided if its corners agree. Own: half the overhang of a usual eave; with
/// longer edges the dry strip below it is missed.
const LONGEST_UNDIVIDED_EDGE: f32 = 1.0;
/// Edge length, m, below which faces are not divided further: the border between wet and dry is interpolated there.
const SHORTEST_DIVIDED_EDGE: f32 = 0.12;
/// Distance from the solids' bounds within which solids may shelter faces, m. Own: rain in a storm drifts by about its height of
/// fall.
const SHELTER_REACH: f32 = 12.0;

/// Gives the faces of the scene that rain reaches a wet material. `cover`: fraction of a wet face that the film covers, 0 to 1.
/// `solids`: world bounds of everything that shelters, m. Returns the materials of wet faces.
/// # Errors
/// `Limit` for a mesh that would get too many vertices, `Cancelled`, `TooMany` beyond 2^32 materials or images.
pub(super) fn wet_exposed_surfaces(
    cover: f32,
    exposure: &RainExposure,
    solids: Bounds,
    builder: &mut SceneBuilder,
    context: &BakeContext<'_>,
) -> Result<BTreeSet<MaterialId>> {
    let sheltered = solids.expanded(SHELTER_REACH);
    let mut uses = vec![WetDryFaces::default(); builder.materials.len()];
    let mut wet_faces: BTreeMap<[usize; 2], Vec<bool>> = BTreeMap::new();

    // Find the wet faces. All copies of an asset share the faces of the first.
    for (k, asset) in builder.assets.iter_mut().enumerate() {
        let Some(placement) = builder.placements.iter().find(|p| p.asset == k) else { continue };
        for (i, object) in asset.meshes.iter_mut().enumerate() {
            if object.motion == MeshMotion::Varying || !has_wettable_faces(&object.mesh, &builder.materials) {
                continue;
            }
            let surface = WorldSurface { exposure, transform: placement.transform };
            let wet = if can_be_cut(object) {
                divide_faces(&mut object.mesh, &surface, sheltered, context)?
            } else {
                rain_exposed_faces(&object.mesh, &surface)
            };
            count_uses(&object.mesh, &wet, &builder.materials, &mut uses);
            wet_faces.insert([k, i], wet);
        }
        // Instances, such as stalks and twigs, share one mesh and are wet everywhere.
        for mesh in asset.instancers.iter().flat_map(|set| &set.prototypes) {
            count_uses(&mesh.mesh, &[], &builder.materials, &mut uses);
        }
    }

    let wet_materials = add_wet_materials(cover, &uses, &mut builder.materials, &mut builder.images)?;
    for (k, asset) in builder.assets.iter_mut().enumerate() {
        for (i, object) in asset.meshes.iter_mut().enumerate() {
            if let Some(wet) = wet_faces.get(&[k, i]) {
                group_faces(&mut object.mesh, wet, &wet_materials);
            }
        }
        for prototype in asset.instancers.iter_mut().flat_map(|set| &mut set.prototypes) {
            for subset in &mut prototype.mesh.subsets {
                subset.material = wet_materials.get(&subset.material).copied().unwrap_or(subset.material);
            }
        }
    }
    Ok(wet_materials.into_values().collect())
}

/// Whether a material is bark, masonry or soil; leaves have got their film before, and water has none.
fn is_bark_or_ground(material: &Material) -> bool {
    matches!(material.class, MaterialClass::Bark | MaterialClass::Ground)
}

fn has_wettable_faces(mesh: &Mesh, materials: &[Material]) -> bool {
    mesh.subsets.iter().any(|s| materials.get(to_usize(s.material)).is_some_and(is_bark_or_ground))
}

/// Whether vertices may be added to the mesh of an object: it must be still and have no skin, attributes or vertex colours.
fn can_be_cut(object: &MeshObject) -> bool {
    let mesh = &object.mesh;
    object.motion == MeshMotion::Still && object.skin.is_none() && mesh.attributes.is_empty() && mesh.colors.is_empty()
}

/// Records which materials have wet and dry faces. `wet`: parallel to the triangles; those beyond its end are wet.
fn count_uses(mesh: &Mesh, wet: &[bool], materials: &[Material], uses: &mut [WetDryFaces]) {
    for subset in &mesh.subsets {
        let id = to_usize(subset.material);
        if !materials.get(id).is_some_and(is_bark_or_ground) {
            continue;
        }
        for face in to_usize(subset.first)..to_usize(subset.first + subset.count) {
            let wet = wet.get(face).copied().unwrap_or(true);
            uses[id].wet |= wet;
            uses[id].dry |= !wet;
        }
    }
}

/// Placement of a mesh in the world, with the rain that it is exposed to.
pub(super) struct WorldSurface<'a> {
    pub(super) exposure: &'a RainExposure,
    /// World from mesh space.
    pub(super) transform: Trs,
}

impl WorldSurface<'_> {
    /// Catch ratios (rain per area relative to open level ground) of a range of vertices; a vertex without a normal gets the +Y
    /// of its mesh.
    fn catch_ratios(&self, mesh: &Mesh, vertices: std::ops::Range<usize>) -> Vec<f32> {
        let points: Vec<ExposedPoint> = vertices
            .map(|i| ExposedPoint {
                position: self.transform.apply(mesh.points[i]),
                normal: (self.transform.r * mesh.normals.get(i).copied().unwrap_or(Vec3::Y)).normalize_or_zero(),
            })
            .collect();
        self.exposure.catch_ratios(&points)
    }
}

/// Whether each face of a mesh is wet, by the mean catch ratio of its corners; parallel to the triangles.
pub(super) fn rain_exposed_faces(mesh: &Mesh, surface: &WorldSurface<'_>) -> Vec<bool> {
    // No vertex is added here, so that skins and recorded frames still fit the mesh.
    let ratios = surface.catch_ratios(mesh, 0..mesh.points.len());
    let mean = |t: &[u32; 3]| t.iter().map(|i| ratios[to_usize(*i)]).sum::<f32>() / 3.0;
    mesh.triangles.iter().map(|t| mean(t) >= WET_CATCH_RATIO).collect()
}

/// A triangle with its material, taken out of its subset while faces are divided.
#[derive(Debug, Clone, Copy)]
struct Face {
    corners: [u32; 3],
    material: MaterialId,
}

/// A node of the quadtree of a face: the face, and its quarters if it was divided.
struct DividedFace {
    face: Face,
    /// Index of the first of its four consecutive quarters.
    quarters: Option<usize>,
    /// Whether the whole face is wet or dry; `None` if it is partly wet.
    wet: Option<bool>,
}

/// Divides faces that are partly wet, and cuts the smallest along the border; returns whether each new face is wet.
/// # Errors
/// `Limit` before the mesh gets more vertices than the limit allows, `Cancelled`.
fn divide_faces(
    mesh: &mut Mesh,
    surface: &WorldSurface<'_>,
    sheltered: Bounds,
    context: &BakeContext<'_>,
) -> Result<Vec<bool>> {
    let mut nodes: Vec<DividedFace> = Vec::new();
    for s in &std::mem::take(&mut mesh.subsets) {
        let faces = mesh.subset_triangles(s).iter().map(|t| Face { corners: *t, material: s.material });
        nodes.extend(faces.map(|face| DividedFace { face, quarters: None, wet: None }));
    }
    let whole_faces = nodes.len();
    let mut ratios = surface.catch_ratios(mesh, 0..mesh.points.len());
    let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let is_wet = |ratio: f32| ratio >= WET_CATCH_RATIO;

    // One pass for each halving: add the middles of all edges, then divide the faces whose corners and middles are partly wet and
    // partly dry.
    let mut open = 0..nodes.len();
    while !open.is_empty() {
        context.cancel.check()?;
        let first_new = mesh.points.len();
        // A face adds at most the middles of its three edges.
        let most = (first_new + 3 * open.len()) as u64;
        context.limits.check("vertices", most, "the number of vertices of a mesh that rain.wet.film divides")?;
        let edges: Vec<[u32; 3]> = nodes[open.clone()]
            .iter()
            .map(|node| {
                let [a, b, c] = node.face.corners;
                [[a, b], [b, c], [c, a]].map(|[i, k]| {
                    let key = [i.min(k), i.max(k)];
                    *middles.entry(key).or_insert_with(|| add_edge_vertex(mesh, key, 0.5))
                })
            })
            .collect();
        ratios.extend(surface.catch_ratios(mesh, first_new..mesh.points.len()));
        let next = nodes.len();
        for (node, [ab, bc, ca]) in open.zip(edges) {
            let face = nodes[node].face;
            let [a, b, c] = face.corners;
            let at = |i: u32| surface.transform.apply(mesh.points[to_usize(i)]);
            let longest = at(a).distance(at(b)).max(at(b).distance(at(c))).max(at(c).distance(at(a)));
            let count = |of: &[u32]| of.iter().filter(|i| is_wet(ratios[to_usize(**i)])).count();
            let bounds = Bounds::of([a, b, c].map(at));
            let meets = bounds.min.cmple(sheltered.max).all() && bounds.max.cmpge(sheltered.min).all();
            // All six points agree if 0 or 6 of them are wet.
            let differs = count(&[a, b, c, ab, bc, ca]) % 6 != 0;
            // A face whose corners and middles agree may still be sheltered in between, but only near the solids.
            let is_divided = longest > SHORTEST_DIVIDED_EDGE && differs || longest > LONGEST_UNDIVIDED_EDGE && meets;
            if is_divided {
                nodes[node].quarters = Some(nodes.len());
                let quarters = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
                let quarter = |corners| DividedFace { face: Face { corners, ..face }, quarters: None, wet: None };
                nodes.extend(quarters.map(quarter));
            } else {
                let wet = count(&face.corners);
                // `None` if the corners differ: the border crosses this face, which is cut along it below.
                nodes[node].wet = (wet % 3 == 0).then_some(wet == 3);
            }
        }
        open = next..nodes.len();
    }

    // Four quarters that agree are merged into one face. Quarters come after the face that they divide.
    for i in (0..nodes.len()).rev() {
        if let Some(first) = nodes[i].quarters {
            let wet = nodes[first].wet.filter(|_| nodes[first..first + 4].iter().all(|q| q.wet == nodes[first].wet));
            nodes[i].wet = wet;
            nodes[i].quarters = Some(first).filter(|_| wet.is_none());
        }
    }
    // Collect the leaves of the quadtrees depth first, so that the parts of a face take its place in the order.
    let mut done: Vec<Face> = Vec::new();
    let mut pending: Vec<usize> = (0..whole_faces).rev().collect();
    while let Some(i) = pending.pop() {
        match nodes[i].quarters {
            Some(first) => pending.extend((first..first + 4).rev()),
            None => done.push(nodes[i].face),
        }
    }

    // Cut the faces on the border where the interpolated ratio equals the threshold.
    let mut faces: Vec<(Face, bool)> = Vec::new();
    let mut crossings: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for face in done {
        let wet = face.corners.map(|i| is_wet(ratios[to_usize(i)]));
        let Some(lone) = (0..3).find(|i| wet[*i] != wet[(i + 1) % 3] && wet[*i] != wet[(i + 2) % 3]) else {
            faces.push((face, wet[0]));
            continue;
        };
        // `a` is the corner that differs from the two others.
        let [a, b, c] = [0, 1, 2].map(|i| face.corners[(lone + i) % 3]);
        let mut crossing = |i: u32, k: u32| {
            let key = [i.min(k), i.max(k)];
            let [low, high] = key.map(|i| ratios[to_usize(i)]);
            // Linear interpolation gives the fraction of the edge at which the ratio equals the threshold.
            let fraction = ((WET_CATCH_RATIO - low) / (high - low)).clamp(0.0, 1.0);
            *crossings.entry(key).or_insert_with(|| add_edge_vertex(mesh, key, fraction))
        };
        let (ab, ca) = (crossing(a, b), crossing(c, a));
        let part = |corners| Face { corners, ..face };
        faces.extend([(part([a, ab, ca]), wet[lone]), (part([ab, b, c]), !wet[lone]), (part([ab, c, ca]), !wet[lone])]);
    }
    // Group the faces by material; the stable sort keeps their order within a material.
    faces.sort_by_key(|(face, _)| face.material);
    mesh.triangles.clear();
    for (face, _) in &faces {
        let first = mesh.next_triangle();
        mesh.triangles.push(face.corners);
        match mesh.subsets.last_mut() {
            Some(last) if last.material == face.material => last.count += 1,
            _ => mesh.subsets.push(Subset { material: face.material, first, count: 1 }),
        }
    }
    drop_unused_vertices(mesh);
    Ok(faces.into_iter().map(|(_, wet)| wet).collect())
}

/// Adds a vertex on the edge between two vertices, at `fraction` of the edge from the first to the second; returns its index.
fn add_edge_vertex(mesh: &mut Mesh, [i, k]: [u32; 2], fraction: f32) -> u32 {
    let new = mesh.next_point();
    let [i, k] = [i, k].map(to_usize);
    mesh.points.push(mesh.points[i].lerp(mesh.points[k], fraction));
    if mesh.normals.len() > i.max(k) {
        mesh.normals.push(mesh.normals[i].lerp(mesh.normals[k], fraction).normalize_or(mesh.normals[i]));
    }
    if mesh.uvs.len() > i.max(k) {
        mesh.uvs.push(mesh.uvs[i].lerp(mesh.uvs[k], fraction));
    }
    new
}

/// Removes the vertices that no triangle uses and renumbers the others in order.
fn drop_unused_vertices(mesh: &mut Mesh) {
    // Unused vertices are the middles of edges that were only tested, and corners of faces that were cut away.
    let mut is_used = vec![false; mesh.points.len()];
    mesh.triangles.iter().flatten().for_each(|i| is_used[to_usize(*i)] = true);
    // The new index of a vertex is the number of used ones before it.
    let mut count = 0;
    let new_index: Vec<u32> = is_used
        .iter()
        .map(|used| {
            count += u32::from(*used);
            count.saturating_sub(1)
        })
        .collect();
    mesh.triangles.iter_mut().flatten().for_each(|i| *i = new_index[to_usize(*i)]);
    fn retain<T>(values: &mut Vec<T>, is_used: &[bool]) {
        let mut used = is_used.iter();
        values.retain(|_| used.next().copied().unwrap_or(true));
    }
    retain(&mut mesh.points, &is_used);
    retain(&mut mesh.normals, &is_used);
    retain(&mut mesh.uvs, &is_used);
}

/// Splits each subset into its dry faces and its wet ones, which follow them with the wet material.
pub(super) fn group_faces(mesh: &mut Mesh, wet: &[bool], wet_materials: &BTreeMap<MaterialId, MaterialId>) {
    let subsets = std::mem::take(&mut mesh.subsets);
    let triangles = std::mem::take(&mut mesh.triangles);
    for subset in &subsets {
        let wet_material = wet_materials.get(&subset.material).copied();
        for (pass, material) in [(false, Some(subset.material)), (true, wet_material)] {
            let first = mesh.next_triangle();
            let is_wet = |face: usize| wet_material.is_some() && wet.get(face).copied().unwrap_or(true);
            let faces = to_usize(subset.first)..to_usize(subset.first + subset.count);
            mesh.triangles.extend(faces.filter(|face| is_wet(*face) == pass).map(|face| triangles[face]));
            let count = mesh.next_triangle() - first;
            if let Some(material) = material.filter(|_| count > 0) {
                mesh.subsets.push(Subset { material, first, count });
            }
        }
    }
}
