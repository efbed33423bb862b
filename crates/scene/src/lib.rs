//! What exists ([`Scene`]) and what changes ([`Frame`]).
//!
//! A scene knows no file format and does no I/O. Space: right-handed, +Y up, metres, seconds, radians; UV origin lower
//! left; front faces counter-clockwise; map row 0 is the top (v = 1). Frame f is shown at t = (f - start) / fps seconds.
//!
//! ```
//! use glam::Vec3;
//! use osier_scene::{Clip, Mesh};
//!
//! let clip = Clip { start: 1, end: 48, fps: (24, 1) };
//! assert_eq!((clip.len(), clip.tag(7)), (48, "0007".to_owned()));
//! assert!((clip.seconds(25) - 1.0).abs() < 1e-12);
//!
//! let points = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
//! let triangle = Mesh { points, normals: vec![Vec3::Z; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() };
//! assert_eq!(triangle.with_material(0).subsets[0].count, 1);
//! ```

use std::sync::Arc;

mod air;
mod attribute;
mod camera_light;
mod curve_mesh;
mod evaluate;
mod field;
mod frame;
mod freeze;
mod instancer;
mod maps;
mod material;
mod measure;
mod mesh;
mod pixel_footprint;
pub mod plant;
mod points;
mod records;
mod rigged_plant;
mod skeleton;
pub mod solid;
mod validate;
mod volume;

pub use air::AirGrid;
pub use attribute::{
    Attribute, AttributeData, AttributeDomain, CANOPY_NORMAL, CANOPY_OCCLUSION, LEAF_COLOR, attribute_number,
};
pub use camera_light::{Camera, Fog, Sky, Sun, ToneCurve};
pub use curve_mesh::{ribbons, tubes, turned_ribbons};
pub use evaluate::{
    asset_bounds, instance_states, joint_motions, mesh_points, scene_bounds, skinned_normals, skinned_points,
    skinning_matrices,
};
pub use field::HeightField;
pub use frame::{AssetFrame, CurvesFrame, Frame, InstancerFrame, MeshFrame};
pub use freeze::freeze;
pub use instancer::{Fine, InstanceState, Instancer, InstancerMotion, Prototype, bent_normal};
pub use maps::{MapEncoding, MapFrame, MapLayer, MapSequence, MapTexels};
pub use material::{Coat, Image, ImageKind, Maps, Material, MaterialClass, MaterialId, Pixels, pixel_at};
pub use measure::{Field, Table, Watch, largest};
pub use mesh::{Mesh, MeshMotion, MeshObject, SkinWeights, Subset};
pub use pixel_footprint::{PICTURE_ROWS, PixelFootprint};
pub use points::{Curves, Points, PointsFrame, PointsNow};
pub use records::{CodeList, ColumnValues, RecordColumn, RecordTable};
pub use rigged_plant::{ClipChange, JointBranch, RiggedPlant};
pub use skeleton::{Joint, Skeleton, Trs};
pub use validate::{check_frame, check_scene};
pub use volume::{VolumeCells, VolumeFrame, VolumeGrid, VolumeValues};

/// Frames of a clip. A still scene has `start == end`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Clip {
    /// First frame number, 0..=999999.
    pub start: u32,
    /// Last frame number, inclusive.
    pub end: u32,
    /// Frames per second as a fraction (numerator, denominator).
    pub fps: (u32, u32),
}

impl Clip {
    /// Number of frames, at least 1.
    pub fn len(&self) -> usize {
        (self.end.saturating_sub(self.start) as usize).saturating_add(1)
    }

    /// Always false: a clip holds at least one frame.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Frames per second as a quotient; a denominator of 0 counts as 1.
    pub fn fps(&self) -> f64 {
        f64::from(self.fps.0) / f64::from(self.fps.1.max(1))
    }

    /// Time of a frame, s: t = (frame - start) / fps.
    pub fn seconds(&self, frame: u32) -> f64 {
        (f64::from(frame) - f64::from(self.start)) / self.fps()
    }

    /// Digits of frame numbers in file names: at least four, one number per bake.
    pub fn digits(&self) -> usize {
        self.end.to_string().len().max(4)
    }

    /// A frame number padded with zeros, as it appears in file names.
    pub fn tag(&self, frame: u32) -> String {
        format!("{frame:0width$}", width = self.digits())
    }
}

impl Default for Clip {
    fn default() -> Self {
        Self { start: 1, end: 1, fps: (24, 1) }
    }
}

/// What an asset is, for folder names, statistics and materials' defaults.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AssetKind {
    /// A plant grown by a grammar, an IFS or particle-shapes.
    Plant,
    /// Level ground or a height field.
    Terrain,
    /// A cloud of points, such as an attractor.
    Cloud,
    /// Flying or lying things tracked one by one.
    Tracks,
    /// A mesh read from a file.
    Import,
}

impl AssetKind {
    /// Name of the kind in the manifest, in lower case.
    pub fn word(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Terrain => "terrain",
            Self::Cloud => "cloud",
            Self::Tracks => "tracks",
            Self::Import => "import",
        }
    }
}

impl Scene {
    /// Linear colour of a material for formats without colours at vertices: its base colour times the mean vertex colour of all
    /// points with the material; white for an unknown id.
    pub fn flat_color(&self, id: MaterialId) -> [f32; 3] {
        let Some(material) = self.materials.get(id as usize) else { return [1.0; 3] };
        let (mut sum, mut count) = ([0.0_f64; 3], 0_u64);
        for mesh in self.meshes().filter(|m| !m.colors.is_empty()) {
            let mut worn = vec![false; mesh.points.len()];
            for s in mesh.subsets.iter().filter(|s| s.material == id) {
                mesh.subset_triangles(s).iter().flatten().for_each(|i| worn[*i as usize] = true);
            }
            for (c, _) in mesh.colors.iter().zip(&worn).filter(|(_, worn)| **worn) {
                (0..3).for_each(|k| sum[k] += f64::from(c[k]));
                count += 1;
            }
        }
        let mean = sum.map(|s| if count > 0 { s / count as f64 } else { 1.0 });
        [0, 1, 2].map(|k| osier_base::math::narrow(f64::from(material.base_color[k]) * mean[k]))
    }

    /// Whether each material is on some surface, point or curve of an asset at any frame, parallel to [`Scene::materials`]. Some
    /// are not: every plant has a material of bark, even without thick axes, and one of dead wood, even if it lives.
    pub fn used_materials(&self) -> Vec<bool> {
        let mut used = vec![false; self.materials.len()];
        let mut mark = |id: MaterialId| {
            if let Some(flag) = used.get_mut(id as usize) {
                *flag = true;
            }
        };
        let mark_mesh = |mesh: &Mesh, mark: &mut dyn FnMut(MaterialId)| {
            mesh.subsets.iter().for_each(|subset| mark(subset.material));
        };
        // The rigged version of a plant has meshes and instancers of its own, and prototypes have other levels of detail.
        let rigged = || self.assets.iter().filter_map(|a| a.rigged.as_deref());
        let objects = self.assets.iter().flat_map(|a| &a.meshes).chain(rigged().flat_map(|r| &r.meshes));
        objects.for_each(|object| mark_mesh(&object.mesh, &mut mark));
        let instancers = self.assets.iter().flat_map(|a| &a.instancers).chain(rigged().flat_map(|r| &r.instancers));
        for prototype in instancers.flat_map(|i| &i.prototypes).flat_map(|p| std::iter::once(p).chain(&p.others)) {
            mark_mesh(&prototype.mesh, &mut mark);
            if let Some(fine) = &prototype.fine {
                mark_mesh(&fine.mesh, &mut mark);
                mark(fine.curves.material);
            }
        }
        for asset in &self.assets {
            asset.points.iter().for_each(|points| mark(points.material));
            asset.curves.iter().for_each(|curves| mark(curves.material));
        }
        // A mesh that frames replace as a whole is one of water, and may be empty at rest: count water as used.
        let is_replaced = self.assets.iter().flat_map(|a| &a.meshes).any(|m| m.motion == MeshMotion::Varying);
        for (flag, material) in used.iter_mut().zip(&self.materials) {
            *flag |= is_replaced && material.class == MaterialClass::Water;
        }
        used
    }

    /// Whether the texture coordinates of a face with the material are farther than 0.01 outside of the square from 0 to 1, so that
    /// the face shows a repeat of its textures.
    pub fn repeats_textures(&self, id: MaterialId) -> bool {
        let is_outside = |uv: &glam::Vec2| uv.min_element() < -0.01 || uv.max_element() > 1.01;
        self.meshes().filter(|mesh| !mesh.uvs.is_empty()).any(|mesh| {
            let subsets = mesh.subsets.iter().filter(|s| s.material == id);
            let mut corners = subsets.flat_map(|s| mesh.subset_triangles(s)).flatten();
            corners.any(|i| mesh.uvs.get(*i as usize).is_some_and(is_outside))
        })
    }

    /// The meshes of all assets, and the prototypes of their instancers.
    fn meshes(&self) -> impl Iterator<Item = &Mesh> {
        let prototypes = self.assets.iter().flat_map(|a| &a.instancers).flat_map(|i| &i.prototypes).map(|p| &p.mesh);
        self.assets.iter().flat_map(|a| &a.meshes).map(|m| &m.mesh).chain(prototypes)
    }
}

/// One thing with its own files: a grown individual, the ground, a cloud. Everything in it is in the asset's own space.
#[derive(Debug, Clone)]
pub struct Asset {
    /// File and prim name, `[a-z0-9_]+`, unique in the scene.
    pub id: String,
    /// What it is; the manifest names it by [`AssetKind::word`].
    pub kind: AssetKind,
    /// Name of the plant that it is an individual of, `[a-z0-9_]+`; empty for everything that has no copies. Formats
    /// with instancers write all placements of a group as one instancer.
    pub group: String,
    /// Joints that skinned meshes and joint-bound instancers follow.
    pub skeleton: Option<Skeleton>,
    /// Meshes that occur once in the asset, such as bark.
    pub meshes: Vec<MeshObject>,
    /// Meshes that are repeated in the asset, such as leaves.
    pub instancers: Vec<Instancer>,
    /// Clouds of points, each with widths, colours and attributes.
    pub points: Vec<Points>,
    /// Sets of polylines such as trails, each with one material.
    pub curves: Vec<Curves>,
    /// The same plant at rest, with joints for formats whose readers simulate the wind; made only if such a format is written.
    pub rigged: Option<Arc<RiggedPlant>>,
}

impl Asset {
    /// True if a frame can change any of its meshes, instancers, points or curves.
    pub fn moves(&self) -> bool {
        self.meshes.iter().any(|m| m.motion != MeshMotion::Still)
            || self.instancers.iter().any(|i| i.motion != InstancerMotion::Still)
            || self.points.iter().any(|p| p.moving)
            || self.curves.iter().any(|c| c.moving)
    }
}

/// A copy of an asset at a place in the scene.
#[derive(Debug, Clone)]
pub struct Placement {
    /// Node and prim name, `[a-z0-9_]+`, unique in the scene.
    pub name: String,
    /// Index into [`Scene::assets`].
    pub asset: usize,
    /// World from asset space. Scale is uniform.
    pub transform: Trs,
    /// Number of frames, below that of the clip, by which its asset's motion is shifted; frame f has the state of frame
    /// f + phase, and the clip repeats. Copies with one motion then do not move in unison.
    pub phase: u32,
}

/// Everything that exists, resolved, in SI units.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Stem of the names of output files, `[a-z0-9_]+`.
    pub name: String,
    /// Title as the artist wrote it.
    pub title: String,
    /// Seed of all random draws; exporters write it into their headers.
    pub seed: u64,
    /// Hash of the resolved scene and its input files, 64 hex digits.
    pub hash: String,
    /// First and last frame number, and frames per second.
    pub clip: Clip,
    /// Camera of all frames; it does not move.
    pub camera: Camera,
    /// Sunlight, the same in all frames.
    pub sun: Sun,
    /// Background, light from all directions, and haze; the same in all frames.
    pub sky: Sky,
    /// Pictures, which the [`Maps`] of materials name by index.
    pub images: Vec<Image>,
    /// Materials; meshes name them by their index.
    pub materials: Vec<Material>,
    /// Plants, ground, clouds and other things that get separate files; placements name them by index.
    pub assets: Vec<Asset>,
    /// Copies of assets in the scene. An asset without a placement is written, but is not part of the picture.
    pub placements: Vec<Placement>,
    /// Heights of the terrain on their original grid; `None` for a scene without a height field.
    pub land: Option<HeightField>,
    /// Tables that grow by a row with every frame.
    pub tables: Vec<Table>,
    /// Words that codes in the frames' record tables stand for.
    pub enum_labels: Vec<CodeList>,
    /// Maps of measured numbers that frames fill, in the order of [`Frame::fields`].
    pub fields: Vec<Field>,
    /// Grids on which frames sample the wind's velocity.
    pub air: Vec<AirGrid>,
    /// Voxel grids that frames fill, in the order of [`Frame::volumes`].
    pub volumes: Vec<VolumeGrid>,
    /// Maps over texture coordinates that frames fill, in the order of [`Frame::maps`].
    pub map_sequences: Vec<MapSequence>,
}
