//! A scene at one frame, ready for rays: a tree of boxes over all showings of all solids. Nothing is expanded.

use std::borrow::Cow;
use std::collections::BTreeSet;

use glam::{Affine3A, Mat3, Vec3, Vec3A};
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit};

use super::film::RenderRequest;
use super::grain::{Detail, Grain};
use super::looks::Looks;
use super::solid::{PrimitiveHit, Solid, sorted};
use super::wet::CoatMap;
use osier_base::geometry::Bounds;
use osier_base::par::par_map;
use osier_scene::{
    Asset, AssetFrame, CurvesFrame, Frame, Mesh, MeshFrame, MeshMotion, MeshObject, Placement, PointsFrame, Scene, Trs,
    instance_states, mesh_points, skinned_normals, world_from_joint,
};

/// One showing of a solid: small, as rays visit thousands of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct SolidInstance {
    solid: u32,
    /// Columns of the local-from-world matrix and its shift.
    turn: [Vec3; 3],
    shift: Vec3,
}

/// What a ray met.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    pub(super) showing: u32,
    pub(super) spot: PrimitiveHit,
}

/// Everything that can be met.
#[derive(Debug)]
pub struct World<'a> {
    pub(super) looks: &'a Looks,
    /// False for drafts, which are projected.
    pub(super) boxed: bool,
    solids: Vec<Solid<'a>>,
    showings: Vec<SolidInstance>,
    /// Water on each material.
    pub(super) sheets: Vec<Option<CoatMap>>,
    /// Empty where no rays are cast.
    tree: CwBvh,
    /// Box of everything, m.
    pub bounds: Bounds,
    /// How far a ray starts from the surface that it leaves, m.
    pub(super) gap: f32,
}

/// Something to be made into a solid.
enum SolidSource<'s> {
    Mesh(&'s Asset, &'s MeshObject, usize, &'s AssetFrame),
    Prototype(&'s Mesh),
    Points(&'s osier_scene::Points, &'s PointsFrame),
    Curves(&'s osier_scene::Curves, &'s CurvesFrame),
}

/// Time for which falling drops are seen, s: half a frame of film.
const SHUTTER: f32 = 0.5 / 24.0;
/// Primitives that a draft tells apart.
const COUNTED: u64 = u32::MAX as u64;

impl SolidSource<'_> {
    /// Primitives, about.
    fn len(&self) -> u64 {
        let len = match self {
            Self::Mesh(_, object, i, state) => match state.mesh(*i) {
                MeshFrame::Whole { mesh, .. } => mesh.triangles.len(),
                _ => object.mesh.triangles.len(),
            },
            Self::Prototype(mesh) => mesh.triangles.len(),
            Self::Points(cloud, state) => cloud.at(state).positions.len(),
            Self::Curves(curves, _) => curves.points.len(),
        };
        len as u64
    }
}

impl<'a> World<'a> {
    /// In full detail. `frame`: `None` for rest.
    pub fn new(scene: &'a Scene, frame: Option<&'a Frame>, looks: &'a Looks) -> Self {
        Self::seen_by(scene, frame, looks, &[])
    }

    /// As some pictures show it: leaves whose parts are less than a pixel apart have them merged. `frame`: `None` for rest.
    pub fn seen_by(scene: &'a Scene, frame: Option<&'a Frame>, looks: &'a Looks, requests: &[RenderRequest]) -> Self {
        let (jobs, places) = plan(scene, frame);
        let boxed =
            looks.casts_rays() || places.iter().map(|(job, _)| jobs[*job as usize].len()).sum::<u64>() > COUNTED;
        let details = details(&jobs, &places, &Grain::new(requests, looks.quality));
        let both: Vec<_> = jobs.iter().zip(details).collect();
        let solids = par_map(&both, |(job, detail)| solid(job, looks, boxed, *detail));
        let there = |job: u32| solids.get(job as usize).is_some_and(|s| s.bounds().is_some());
        let shown = places.iter().filter(|(job, _)| there(*job));
        let showings: Vec<SolidInstance> = shown.filter_map(|(job, m)| SolidInstance::new(*job, *m)).collect();
        let around = |s: &SolidInstance| solids.get(s.solid as usize).map_or([Vec3::ZERO; 2], |solid| s.bounds(solid));
        let (showings, tree, all) = sorted(showings, boxed, around);
        let bounds = all.map_or_else(Bounds::default, Bounds::of);
        let reach = bounds.corners().iter().fold(0.0_f32, |m, c| m.max(c.abs().max_element()));
        let (sheets, gap) = (CoatMap::of_materials(scene, frame), if bounds.is_empty() { 1e-6 } else { reach * 1e-5 });
        Self { looks, boxed, solids, showings, sheets, tree, bounds, gap }
    }

    /// Number of primitives of each showing.
    pub(super) fn lengths(&self) -> impl ExactSizeIterator<Item = usize> {
        self.showings.iter().map(|s| self.solids.get(s.solid as usize).map_or(0, Solid::len))
    }

    /// Triangles and other primitives that can be met, each showing counted.
    pub fn primitives(&self) -> u64 {
        self.showings.iter().filter_map(|s| self.solids.get(s.solid as usize)).map(|s| s.len() as u64).sum()
    }

    /// Where a showing of a solid is met first.
    pub(super) fn nearest(&self, ray: Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let mut hit = RayHit::none();
        self.tree.ray_traverse(ray, &mut hit, |ray, i| {
            let Some((solid, local)) = self.entered(i, ray) else { return f32::INFINITY };
            match solid.nearest(local, self.looks) {
                Some(spot) if spot.t < ray.tmax => {
                    best = u32::try_from(i).ok().map(|showing| Hit { showing, spot });
                    spot.t
                }
                _ => f32::INFINITY,
            }
        });
        best
    }

    /// Something that a ray meets, not always the first thing: enough to know that the sky is hidden, and by what.
    pub(super) fn any(&self, ray: Ray) -> Option<Hit> {
        let mut found: Option<Hit> = None;
        let mut hit = RayHit::none();
        self.tree.ray_traverse(ray, &mut hit, |ray, i| {
            let (None, Some((solid, local))) = (&found, self.entered(i, ray)) else { return f32::INFINITY };
            match solid.any(local, self.looks) {
                Some(spot) => {
                    found = u32::try_from(i).ok().map(|showing| Hit { showing, spot });
                    ray.tmin
                }
                None => f32::INFINITY,
            }
        });
        found
    }

    /// True if nothing lies within the ray's range.
    pub(super) fn lets_by(&self, ray: Ray) -> bool {
        self.tree.ray_traverse_miss(ray, |ray, i| match self.entered(i, ray) {
            Some((solid, local)) if !solid.lets_by(local, self.looks) => ray.tmin,
            _ => f32::INFINITY,
        })
    }

    /// The solid of a showing and the ray in its space, unless the ray passes by.
    #[inline]
    fn entered(&self, i: usize, ray: &Ray) -> Option<(&Solid<'a>, Ray)> {
        let (showing, solid) = self.of(i)?;
        let local = showing.local(ray);
        solid.is_near(&local).then_some((solid, local))
    }

    #[inline]
    pub(super) fn of(&self, i: usize) -> Option<(&SolidInstance, &Solid<'a>)> {
        let showing = self.showings.get(i)?;
        Some((showing, self.solids.get(showing.solid as usize)?))
    }

    pub(super) fn met(&self, hit: &Hit) -> Option<(&SolidInstance, &Solid<'a>)> {
        self.of(hit.showing as usize)
    }
}

impl SolidInstance {
    /// None if it is flattened to nothing.
    fn new(solid: u32, world_from_local: Affine3A) -> Option<Self> {
        let det = world_from_local.matrix3.determinant();
        (det.is_finite() && det.abs() > 1e-30).then(|| {
            let m = world_from_local.inverse();
            let turn = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis].map(Vec3::from);
            Self { solid, turn, shift: m.translation.into() }
        })
    }

    /// The ray in the solid's own space; lengths along it stay equal.
    #[inline]
    pub(super) fn local(&self, ray: &Ray) -> Ray {
        let (o, d) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
        let d = self.turn[0] * d.x + self.turn[1] * d.y + self.turn[2] * d.z;
        Ray::new(Vec3A::from(self.to_local(o)), Vec3A::from(d), ray.tmin, ray.tmax)
    }

    /// World from local: matrix and shift.
    pub(super) fn world(&self) -> (Mat3, Vec3) {
        let turn = self.matrix().inverse();
        (turn, turn * -self.shift)
    }

    fn matrix(&self) -> Mat3 {
        Mat3::from_cols(self.turn[0], self.turn[1], self.turn[2])
    }

    /// Box in the world.
    fn bounds(&self, solid: &Solid<'_>) -> [Vec3; 2] {
        let corners = solid.bounds().map(|[min, max]| Bounds { min, max }.corners()).unwrap_or_default();
        let points = if solid.hull.is_empty() { &corners[..] } else { &solid.hull };
        let back = self.matrix().inverse();
        let b = Bounds::of(points.iter().map(|c| back * (*c - self.shift)));
        [b.min, b.max]
    }

    /// A point of the world in the solid.
    #[inline]
    pub(super) fn to_local(self, p: Vec3) -> Vec3 {
        self.turn[0] * p.x + self.turn[1] * p.y + self.turn[2] * p.z + self.shift
    }

    /// A normal of the solid in the world, unit length.
    pub(super) fn normal(&self, n: Vec3) -> Vec3 {
        osier_base::math::normalize_or(self.matrix().transpose() * n, Vec3::Y)
    }
}

fn affine(trs: &Trs) -> Affine3A {
    Affine3A::from_scale_rotation_translation(trs.s, trs.r, trs.t)
}

/// Solids to make, and where each is shown.
fn plan<'s>(scene: &'s Scene, frame: Option<&'s Frame>) -> (Vec<SolidSource<'s>>, Vec<(u32, Affine3A)>) {
    static REST: AssetFrame = AssetFrame {
        pose: Vec::new(),
        meshes: Vec::new(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    };
    let (mut jobs, mut places) = (Vec::new(), Vec::new());
    for (i, asset) in scene.assets.iter().enumerate() {
        let here: Vec<&Placement> = scene.placements.iter().filter(|p| p.asset == i).collect();
        let phases: BTreeSet<u32> = here.iter().map(|p| p.phase).collect();
        for phase in phases {
            let same = here.iter().filter(|p| p.phase == phase);
            let stands: Vec<Affine3A> = same.clone().map(|p| affine(&p.transform)).collect();
            let state = same.take(1).find_map(|p| frame.and_then(|f| f.shown(p))).unwrap_or(&REST);
            add_solids(asset, state, &stands, &mut jobs, &mut places);
        }
    }
    (jobs, places)
}

/// Adds the solids of one asset in one state, and the places of their instances.
fn add_solids<'s>(
    asset: &'s Asset,
    state: &'s AssetFrame,
    stands: &[Affine3A],
    jobs: &mut Vec<SolidSource<'s>>,
    places: &mut Vec<(u32, Affine3A)>,
) {
    let add = |jobs: &mut Vec<SolidSource<'s>>, job| {
        let index = u32::try_from(jobs.len()).unwrap_or(u32::MAX);
        jobs.push(job);
        index
    };
    for (k, object) in asset.meshes.iter().enumerate() {
        let index = add(jobs, SolidSource::Mesh(asset, object, k, state));
        places.extend(stands.iter().map(|m| (index, *m)));
    }
    for (k, instancer) in asset.instancers.iter().enumerate() {
        // A prototype with curves is two solids, that stand in the same places.
        let firsts: Vec<Vec<u32>> = instancer
            .prototypes
            .iter()
            .map(|p| match &p.fine {
                Some(fine) => {
                    let body = (!fine.mesh.triangles.is_empty()).then(|| add(jobs, SolidSource::Prototype(&fine.mesh)));
                    body.into_iter().chain([add(jobs, SolidSource::Curves(&fine.curves, &CurvesFrame::Same))]).collect()
                }
                None => vec![add(jobs, SolidSource::Prototype(&p.mesh))],
            })
            .collect();
        let now = instance_states(asset, instancer, k, state);
        for stand in stands {
            let alive = (0..instancer.len()).filter(|n| now.is_alive(*n));
            places.extend(alive.flat_map(|n| {
                let solids = firsts.get(instancer.protos[n] as usize).map_or(&[][..], Vec::as_slice);
                let transform = *stand * affine(&instancer.transform(&now, n));
                solids.iter().map(move |s| (*s, transform))
            }));
        }
    }
    for (k, cloud) in asset.points.iter().enumerate() {
        let index = add(jobs, SolidSource::Points(cloud, state.points(k)));
        places.extend(stands.iter().map(|m| (index, *m)));
    }
    for (k, curves) in asset.curves.iter().enumerate() {
        let index = add(jobs, SolidSource::Curves(curves, state.curves(k)));
        places.extend(stands.iter().map(|m| (index, *m)));
    }
}

/// The smallest detail of each job: of instances only something is left out.
fn details(jobs: &[SolidSource<'_>], places: &[(u32, Affine3A)], grain: &Grain) -> Vec<Detail> {
    let own = |(number, job): (u32, &SolidSource<'_>)| match job {
        SolidSource::Prototype(mesh) => grain.of(mesh, places.iter().filter(|p| p.0 == number).map(|p| p.1)),
        _ => Detail::default(),
    };
    (0..).zip(jobs).map(own).collect()
}

fn solid<'s>(job: &SolidSource<'s>, looks: &Looks, boxed: bool, detail: Detail) -> Solid<'s> {
    match job {
        SolidSource::Mesh(asset, object, i, state) => {
            let mesh = match state.mesh(*i) {
                MeshFrame::Whole { mesh, .. } => mesh,
                _ => &object.mesh,
            };
            let points = mesh_points(asset, object, *i, state);
            Solid::of_mesh(mesh, &points, normals(asset, object, mesh, *i, state), looks, boxed, Detail::default())
        }
        SolidSource::Prototype(mesh) => {
            Solid::of_mesh(mesh, &mesh.points, Cow::Borrowed(&mesh.normals), looks, boxed, detail)
        }
        SolidSource::Points(cloud, state) => {
            let now = cloud.at(state);
            if looks.is_water(cloud.material) && !now.velocities.is_empty() {
                Solid::of_drops(cloud.material, now, SHUTTER, boxed)
            } else {
                Solid::of_points(cloud.material, now, boxed)
            }
        }
        SolidSource::Curves(curves, CurvesFrame::Same) => Solid::of_curves(curves, &curves.points, boxed),
        SolidSource::Curves(curves, CurvesFrame::Points(points)) => {
            let drawn = curves.drawn(points);
            Solid::of_curves(&drawn, &drawn.points, boxed)
        }
    }
}

fn normals<'s>(asset: &Asset, object: &MeshObject, mesh: &'s Mesh, i: usize, state: &'s AssetFrame) -> Cow<'s, [Vec3]> {
    match (state.mesh(i), &asset.skeleton, &object.skin) {
        (MeshFrame::Points { normals, .. }, _, _) => Cow::Borrowed(normals),
        (MeshFrame::Same, Some(skeleton), Some(skin)) if object.motion == MeshMotion::Skinned => {
            Cow::Owned(skinned_normals(&mesh.normals, skin, &world_from_joint(skeleton, &state.pose)))
        }
        _ => Cow::Borrowed(&mesh.normals),
    }
}

/// A ray of the world. `range`: nearest and farthest, in lengths of the direction.
pub(super) fn ray(origin: Vec3, direction: Vec3, range: [f32; 2]) -> Ray {
    Ray::new(Vec3A::from(origin), Vec3A::from(direction), range[0], range[1])
}
