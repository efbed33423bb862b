//! A scene at one frame, ready to be rendered: a two-level BVH over instances of solids. Instances are never expanded.

use std::borrow::Cow;
use std::collections::BTreeSet;

use glam::{Affine3A, Mat3, Vec3, Vec3A};
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit};

use super::coat::CoatMap;
use super::detail::{DetailLimit, MeshDetail};
use super::materials::PreviewMaterials;
use super::request::RenderRequest;
use super::solid::{Bvh, PrimitiveHit, Solid, build_bvh};
use osier_base::convert::saturating_index;
use osier_base::geometry::Bounds;
use osier_base::par::par_map;
use osier_scene::{
    Asset, AssetFrame, CurvesFrame, Frame, Mesh, MeshFrame, MeshMotion, MeshObject, Placement, PointsFrame, Scene, Trs,
    instance_states, mesh_points, skinned_normals, skinning_matrices,
};

/// Exposure time in which falling drops are motion-blurred, s: a shutter of 180 degrees at 24 frames per second.
const SHUTTER: f32 = 0.5 / 24.0;
/// Most primitives that the 32-bit indices of a rasterised draft can number.
const MAX_DRAFT_PRIMITIVES: u64 = u32::MAX as u64;

/// One instance of a solid. Small, as a ray visits thousands of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct SolidInstance {
    solid: u32,
    /// Columns of the linear part of the local-from-world transform.
    local_from_world: [Vec3; 3],
    /// Translation of the local-from-world transform, m.
    translation: Vec3,
}

/// Transform from the space of a solid to the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorldFromLocal {
    pub(super) linear: Mat3,
    pub(super) translation: Vec3,
}

/// Intersection of a ray with an instance.
#[derive(Debug, Clone, Copy)]
pub(super) struct SceneHit {
    pub(super) instance: u32,
    pub(super) primitive: PrimitiveHit,
}

/// All geometry of a scene at one frame, with the structures that rays and rasterisation need.
#[derive(Debug)]
pub struct RenderScene<'a> {
    pub(super) materials: &'a PreviewMaterials,
    /// False if a draft is rasterised: then the scene has no water and at most [`MAX_DRAFT_PRIMITIVES`] primitives.
    pub(super) has_bvh: bool,
    solids: Vec<Solid<'a>>,
    instances: Vec<SolidInstance>,
    /// Coat of each material at the frame, by index; `None` for a bare one.
    pub(super) coats: Vec<Option<CoatMap>>,
    /// Over the boxes of the instances in the world; empty for drafts.
    bvh: CwBvh,
    /// Box around all instances in the world, m; solids without primitives are left out, so it may be empty.
    pub bounds: Bounds,
    /// Offset of rays from the surface that they leave, m: 1e-5 of the largest coordinate, some hundred units of its
    /// last place.
    pub(super) gap: f32,
}

/// Scene data that one solid is made of.
enum SolidSource<'s> {
    Mesh { asset: &'s Asset, object: &'s MeshObject, index: usize, state: &'s AssetFrame },
    Prototype(&'s Mesh),
    Points { points: &'s osier_scene::Points, state: &'s PointsFrame },
    Curves { curves: &'s osier_scene::Curves, state: &'s CurvesFrame },
}

impl SolidSource<'_> {
    /// Number of primitives, before vertices are clustered.
    fn len(&self) -> u64 {
        let len = match self {
            Self::Mesh { object, index, state, .. } => match state.mesh(*index) {
                MeshFrame::Whole { mesh, .. } => mesh.triangles.len(),
                _ => object.mesh.triangles.len(),
            },
            Self::Prototype(mesh) => mesh.triangles.len(),
            Self::Points { points, state } => points.at(state).positions.len(),
            Self::Curves { curves, .. } => curves.points.len(),
        };
        len as u64
    }
}

impl<'a> RenderScene<'a> {
    /// Prepares a scene in full detail. `frame`: `None` for rest.
    pub fn new(scene: &'a Scene, frame: Option<&'a Frame>, materials: &'a PreviewMaterials) -> Self {
        Self::for_requests(scene, frame, materials, &[])
    }

    /// Prepares a scene with the detail that some pictures of it resolve: vertices of instanced leaves that are less
    /// than a pixel apart are clustered. `frame`: `None` for rest.
    pub fn for_requests(
        scene: &'a Scene,
        frame: Option<&'a Frame>,
        materials: &'a PreviewMaterials,
        requests: &[RenderRequest],
    ) -> Self {
        let sources = collect_sources(scene, frame);
        let primitives: u64 = sources.instances.iter().map(|i| sources.solids[i.solid as usize].len()).sum();
        let has_bvh = materials.needs_rays() || primitives > MAX_DRAFT_PRIMITIVES;
        // Bottom level: solids, each built once however many instances it has.
        let details = mesh_details(&sources, &DetailLimit::new(requests, materials.quality));
        let jobs: Vec<_> = sources.solids.iter().zip(details).collect();
        let solids = par_map(&jobs, |(source, detail)| build_solid(source, materials, has_bvh, *detail));
        // Top level: a BVH over the boxes of the instances. Empty solids and singular transforms
        // are left out.
        let is_visible = |solid: u32| solids.get(solid as usize).is_some_and(|s| s.bounds().is_some());
        let visible = sources.instances.iter().filter(|i| is_visible(i.solid));
        let instances = visible.filter_map(|i| SolidInstance::new(i.solid, i.world_from_local)).collect();
        let instance_bounds =
            |i: &SolidInstance| solids.get(i.solid as usize).map_or([Vec3::ZERO; 2], |solid| i.bounds(solid));
        let Bvh { primitives: instances, bvh, bounds } = build_bvh(instances, has_bvh, instance_bounds);
        // Rays start off the surface by some units of the last place of the largest coordinate.
        let bounds = bounds.map_or_else(Bounds::default, Bounds::of);
        let largest = bounds.corners().iter().fold(0.0_f32, |m, c| m.max(c.abs().max_element()));
        let gap = if bounds.is_empty() { 1e-6 } else { largest * 1e-5 };
        let coats = CoatMap::of_materials(scene, frame);
        Self { materials, has_bvh, solids, instances, coats, bvh, bounds, gap }
    }

    /// Number of primitives of each instance, in the order of the instances.
    pub(super) fn primitive_counts(&self) -> impl ExactSizeIterator<Item = usize> {
        self.instances.iter().map(|i| self.solids.get(i.solid as usize).map_or(0, Solid::len))
    }

    /// Number of triangles and other primitives, those of each instance counted.
    pub fn primitives(&self) -> u64 {
        self.instances.iter().filter_map(|i| self.solids.get(i.solid as usize)).map(|s| s.len() as u64).sum()
    }

    /// The closest intersection within the range of a ray, or `None`.
    pub(super) fn closest_hit(&self, ray: Ray) -> Option<SceneHit> {
        let mut best: Option<SceneHit> = None;
        let mut hit = RayHit::none();
        self.bvh.ray_traverse(ray, &mut hit, |ray, i| {
            let Some((solid, local)) = self.enter_instance(i, ray) else { return f32::INFINITY };
            // The range of the ray shrinks to the closest hit so far, so distant instances are
            // culled by their boxes.
            match solid.closest_hit(local, self.materials) {
                Some(primitive) if primitive.t < ray.tmax => {
                    best = u32::try_from(i).ok().map(|instance| SceneHit { instance, primitive });
                    primitive.t
                }
                _ => f32::INFINITY,
            }
        });
        best
    }

    /// Any intersection of a ray, not always the closest: enough to know that the sky is occluded, and roughly by what.
    pub(super) fn any_hit(&self, ray: Ray) -> Option<SceneHit> {
        let mut found: Option<SceneHit> = None;
        let mut hit = RayHit::none();
        self.bvh.ray_traverse(ray, &mut hit, |ray, i| {
            let (None, Some((solid, local))) = (&found, self.enter_instance(i, ray)) else { return f32::INFINITY };
            match solid.any_hit(local, self.materials) {
                Some(primitive) => {
                    found = u32::try_from(i).ok().map(|instance| SceneHit { instance, primitive });
                    // A hit at the lower end of the range ends the traversal.
                    ray.tmin
                }
                None => f32::INFINITY,
            }
        });
        found
    }

    /// True if nothing opaque lies within the range of a shadow ray.
    pub(super) fn is_unoccluded(&self, ray: Ray) -> bool {
        self.bvh.ray_traverse_miss(ray, |ray, i| match self.enter_instance(i, ray) {
            Some((solid, local)) if !solid.is_unoccluded(local, self.materials) => ray.tmin,
            _ => f32::INFINITY,
        })
    }

    /// The solid of an instance and the ray in its space, unless the ray misses its box.
    #[inline]
    fn enter_instance(&self, i: usize, ray: &Ray) -> Option<(&Solid<'a>, Ray)> {
        let (instance, solid) = self.instance(i)?;
        let local = instance.local_ray(ray);
        solid.hits_bounds(&local).then_some((solid, local))
    }

    /// Instance `i` with its solid; `None` beyond the last instance.
    #[inline]
    pub(super) fn instance(&self, i: usize) -> Option<(&SolidInstance, &Solid<'a>)> {
        let instance = self.instances.get(i)?;
        Some((instance, self.solids.get(instance.solid as usize)?))
    }

    /// The instance that was hit and its solid; `None` if `hit` is of a scene with more instances.
    pub(super) fn hit_instance(&self, hit: &SceneHit) -> Option<(&SolidInstance, &Solid<'a>)> {
        self.instance(hit.instance as usize)
    }
}

impl SolidInstance {
    /// `None` for a singular transform, which flattens the solid to nothing.
    fn new(solid: u32, world_from_local: Affine3A) -> Option<Self> {
        let det = world_from_local.matrix3.determinant();
        (det.is_finite() && det.abs() > 1e-30).then(|| {
            // The inverse is stored: rays are transformed far more often than points back into the
            // world.
            let m = world_from_local.inverse();
            let local_from_world = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis].map(Vec3::from);
            Self { solid, local_from_world, translation: m.translation.into() }
        })
    }

    /// The ray in the space of the solid. The direction is not normalised, so that distances along the ray stay the
    /// same.
    #[inline]
    pub(super) fn local_ray(&self, ray: &Ray) -> Ray {
        let (o, d) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
        let [x, y, z] = self.local_from_world;
        let d = x * d.x + y * d.y + z * d.z;
        Ray::new(Vec3A::from(self.to_local(o)), Vec3A::from(d), ray.tmin, ray.tmax)
    }

    /// The transform of the solid, inverted anew: it is needed once per visible point, not per ray and box.
    pub(super) fn world_from_local(&self) -> WorldFromLocal {
        let linear = self.matrix().inverse();
        WorldFromLocal { linear, translation: linear * -self.translation }
    }

    fn matrix(&self) -> Mat3 {
        let [x, y, z] = self.local_from_world;
        Mat3::from_cols(x, y, z)
    }

    /// Lower and upper corner of the box in the world, around the corners of the triangles if the solid keeps them.
    fn bounds(&self, solid: &Solid<'_>) -> [Vec3; 2] {
        let box_corners = solid.bounds().map(|[min, max]| Bounds { min, max }.corners()).unwrap_or_default();
        let points = if solid.corners.is_empty() { &box_corners[..] } else { &solid.corners };
        let world_from_local = self.matrix().inverse();
        let b = Bounds::of(points.iter().map(|c| world_from_local * (*c - self.translation)));
        [b.min, b.max]
    }

    /// A point of the world in the space of the solid.
    #[inline]
    pub(super) fn to_local(self, p: Vec3) -> Vec3 {
        let [x, y, z] = self.local_from_world;
        x * p.x + y * p.y + z * p.z + self.translation
    }

    /// A normal of the solid in the world, of unit length. Normals transform by the transpose of the inverse, which
    /// is at hand.
    pub(super) fn world_normal(&self, n: Vec3) -> Vec3 {
        osier_base::math::normalize_or(self.matrix().transpose() * n, Vec3::Y)
    }
}

fn affine(trs: &Trs) -> Affine3A {
    Affine3A::from_scale_rotation_translation(trs.s, trs.r, trs.t)
}

/// Solid and transform of an instance before it is inverted.
struct InstanceTransform {
    solid: u32,
    world_from_local: Affine3A,
}

/// Solids to be built, with their instances.
#[derive(Default)]
struct SceneSources<'s> {
    solids: Vec<SolidSource<'s>>,
    instances: Vec<InstanceTransform>,
}

impl<'s> SceneSources<'s> {
    fn add_solid(&mut self, source: SolidSource<'s>) -> u32 {
        // More than 2^32 meshes do not fit into memory; the last index would then be used for all.
        let index = saturating_index(self.solids.len());
        self.solids.push(source);
        index
    }

    fn place(&mut self, solid: u32, transforms: &[Affine3A]) {
        self.instances.extend(transforms.iter().map(|m| InstanceTransform { solid, world_from_local: *m }));
    }

    /// Adds the solids of one asset in one state, and the transforms of their instances. `placements`: of the asset.
    fn add_asset(&mut self, asset: &'s Asset, state: &'s AssetFrame, placements: &[Affine3A]) {
        for (index, object) in asset.meshes.iter().enumerate() {
            let solid = self.add_solid(SolidSource::Mesh { asset, object, index, state });
            self.place(solid, placements);
        }
        for (k, instancer) in asset.instancers.iter().enumerate() {
            // A prototype with a fine level is up to two solids with the same transforms: its mesh
            // and its curves.
            let prototypes: Vec<Vec<u32>> = instancer
                .prototypes
                .iter()
                .map(|p| match &p.fine {
                    Some(fine) => {
                        let has_mesh = !fine.mesh.triangles.is_empty();
                        let mesh = has_mesh.then(|| self.add_solid(SolidSource::Prototype(&fine.mesh)));
                        let curves = SolidSource::Curves { curves: &fine.curves, state: &CurvesFrame::Same };
                        mesh.into_iter().chain([self.add_solid(curves)]).collect()
                    }
                    None => vec![self.add_solid(SolidSource::Prototype(&p.mesh))],
                })
                .collect();
            // Shed leaves and drops that have not been born are not instanced.
            let states = instance_states(asset, instancer, k, state);
            for placement in placements {
                for n in (0..instancer.len()).filter(|n| states.is_alive(*n)) {
                    let solids = prototypes.get(instancer.protos[n] as usize).map_or(&[][..], Vec::as_slice);
                    let world_from_local = *placement * affine(&instancer.transform(&states, n));
                    self.instances
                        .extend(solids.iter().map(|solid| InstanceTransform { solid: *solid, world_from_local }));
                }
            }
        }
        for (k, points) in asset.points.iter().enumerate() {
            let solid = self.add_solid(SolidSource::Points { points, state: state.points(k) });
            self.place(solid, placements);
        }
        for (k, curves) in asset.curves.iter().enumerate() {
            let solid = self.add_solid(SolidSource::Curves { curves, state: state.curves(k) });
            self.place(solid, placements);
        }
    }
}

/// The solids of a scene at a frame. Placements of one asset at one phase share its solids.
fn collect_sources<'s>(scene: &'s Scene, frame: Option<&'s Frame>) -> SceneSources<'s> {
    static REST: AssetFrame = AssetFrame {
        pose: Vec::new(),
        meshes: Vec::new(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    };
    let mut sources = SceneSources::default();
    for (i, asset) in scene.assets.iter().enumerate() {
        let placements: Vec<&Placement> = scene.placements.iter().filter(|p| p.asset == i).collect();
        let phases: BTreeSet<u32> = placements.iter().map(|p| p.phase).collect();
        for phase in phases {
            let same_phase = placements.iter().filter(|p| p.phase == phase);
            // All placements of one phase show the same state, that of the first.
            let transforms: Vec<Affine3A> = same_phase.clone().map(|p| affine(&p.transform)).collect();
            let state = same_phase.take(1).find_map(|p| frame.and_then(|f| f.shown(p))).unwrap_or(&REST);
            sources.add_asset(asset, state, &transforms);
        }
    }
    sources
}

/// The smallest detail of each solid. Only prototypes of instancers are simplified: leaves that recur a thousand times.
fn mesh_details(sources: &SceneSources<'_>, limit: &DetailLimit) -> Vec<MeshDetail> {
    let detail = |(index, source): (u32, &SolidSource<'_>)| match source {
        SolidSource::Prototype(mesh) => {
            let instances = sources.instances.iter().filter(|i| i.solid == index);
            limit.for_mesh(mesh, instances.map(|i| i.world_from_local))
        }
        _ => MeshDetail::default(),
    };
    (0..).zip(&sources.solids).map(detail).collect()
}

fn build_solid<'s>(
    source: &SolidSource<'s>,
    materials: &PreviewMaterials,
    with_bvh: bool,
    detail: MeshDetail,
) -> Solid<'s> {
    match source {
        SolidSource::Mesh { asset, object, index, state } => {
            let mesh = match state.mesh(*index) {
                MeshFrame::Whole { mesh, .. } => mesh,
                _ => &object.mesh,
            };
            let points = mesh_points(asset, object, *index, state);
            let normals = mesh_normals(asset, object, mesh, *index, state);
            Solid::of_mesh(mesh, &points, normals, materials, with_bvh, MeshDetail::default())
        }
        SolidSource::Prototype(mesh) => {
            Solid::of_mesh(mesh, &mesh.points, Cow::Borrowed(&mesh.normals), materials, with_bvh, detail)
        }
        SolidSource::Points { points, state } => {
            let now = points.at(state);
            if materials.is_water(points.material) && !now.velocities.is_empty() {
                // Moving water is rain; drops at rest have no velocities.
                Solid::of_drops(points.material, now, SHUTTER, with_bvh)
            } else {
                Solid::of_points(points.material, now, with_bvh)
            }
        }
        SolidSource::Curves { curves, state: CurvesFrame::Same } => Solid::of_curves(curves, &curves.points, with_bvh),
        SolidSource::Curves { curves, state: CurvesFrame::Points(points) } => {
            let drawn = curves.drawn(points);
            Solid::of_curves(&drawn, &drawn.points, with_bvh)
        }
    }
}

/// Normals of a mesh at the frame: recorded, skinned, or those at rest.
fn mesh_normals<'s>(
    asset: &Asset,
    object: &MeshObject,
    mesh: &'s Mesh,
    index: usize,
    state: &'s AssetFrame,
) -> Cow<'s, [Vec3]> {
    match (state.mesh(index), &asset.skeleton, &object.skin) {
        (MeshFrame::Points { normals, .. }, _, _) => Cow::Borrowed(normals),
        (MeshFrame::Same, Some(skeleton), Some(skin)) if object.motion == MeshMotion::Skinned => {
            Cow::Owned(skinned_normals(&mesh.normals, skin, &skinning_matrices(skeleton, &state.pose)))
        }
        _ => Cow::Borrowed(&mesh.normals),
    }
}

/// A ray in the world. `range`: its nearest and farthest point, in lengths of the direction.
pub(super) fn ray(origin: Vec3, direction: Vec3, range: [f32; 2]) -> Ray {
    Ray::new(Vec3A::from(origin), Vec3A::from(direction), range[0], range[1])
}
