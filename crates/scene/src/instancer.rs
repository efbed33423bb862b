//! Instancers: prototypes, and the copies of them with their positions, orientations and scales.

use glam::{Quat, Vec3};

use super::{Attribute, AttributeData, CANOPY_NORMAL, CANOPY_OCCLUSION, Curves, Mesh};
use crate::Trs;
use osier_base::geometry::Bounds;

/// Geometry that instances repeat, in prototype space.
#[derive(Debug, Clone)]
pub struct Prototype {
    /// `[a-z0-9_]+`, unique in the instancer.
    pub name: String,
    /// Triangles in prototype space, m, with the pivot of the instances at the origin.
    pub mesh: Mesh,
    /// The same object with hairs as curves, for formats that have curves; `None` if it has no hairs.
    pub fine: Option<Fine>,
    /// Name of its level of detail, `[a-z0-9]+`; empty if there is only one.
    pub level: String,
    /// The same object at other levels of detail, for formats whose readers choose a level.
    pub others: Vec<Self>,
}

/// A prototype in formats that draw curves.
#[derive(Debug, Clone)]
pub struct Fine {
    /// Triangles of the parts that are no hairs.
    pub mesh: Mesh,
    /// Hairs; they do not move within the prototype.
    pub curves: Curves,
}

impl Prototype {
    /// A prototype of one mesh, without curves and without levels of detail.
    #[inline]
    pub fn new(name: impl Into<String>, mesh: Mesh) -> Self {
        Self { name: name.into(), mesh, fine: None, level: String::new(), others: Vec::new() }
    }

    /// Box of the mesh and of the version with curves, in prototype space, m.
    #[inline]
    pub fn bounds(&self) -> Bounds {
        let fine = self.fine.as_ref().map(|f| f.mesh.bounds().union(f.curves.bounds()));
        fine.unwrap_or_default().union(self.mesh.bounds())
    }
}

/// How instances move: not at all, with joints, or by states in the frames.
#[derive(Debug, Clone, PartialEq)]
pub enum InstancerMotion {
    /// Instances keep their rest state over the clip.
    Still,
    /// Each instance rides rigidly on one joint of the asset's skeleton (one index per instance). Frames may carry
    /// finer states, which formats with instancers prefer.
    Joints(Vec<u16>),
    /// Frames carry states; instances may be born and die.
    Free,
}

/// Positions and rotations of all instances at one time; arrays of equal length N.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct InstanceState {
    /// Pivots in asset space, m.
    pub positions: Vec<Vec3>,
    /// Rotations from prototype to asset space, unit quaternions.
    pub orientations: Vec<Quat>,
    /// Alive or not; empty means all are.
    pub alive: Vec<bool>,
    /// Factors on the constant scales of the instances, or empty: all 1.
    pub sizes: Vec<f32>,
    /// Velocities of the pivots in asset space, m/s, or empty.
    pub velocities: Vec<Vec3>,
    /// Angular velocities in asset space, axis times rad/s, or empty.
    pub angular_velocities: Vec<Vec3>,
    /// Further values, one per instance. States of one instancer have the same attributes, or none.
    pub attributes: Vec<Attribute>,
}

impl InstanceState {
    /// Whether instance `i` exists at this time; true where `alive` has no entry for it.
    #[inline]
    pub fn is_alive(&self, i: usize) -> bool {
        self.alive.get(i).copied().unwrap_or(true)
    }

    /// Keeps the instances whose flag in `keep` is set, and those beyond its end.
    pub fn retain(&mut self, keep: &[bool]) {
        retain(&mut self.positions, keep);
        retain(&mut self.orientations, keep);
        retain(&mut self.alive, keep);
        retain(&mut self.sizes, keep);
        retain(&mut self.velocities, keep);
        retain(&mut self.angular_velocities, keep);
        self.attributes.iter_mut().for_each(|a| a.data.retain(keep));
    }

    /// Factor on the scale of instance `i`; 1 where `sizes` has no entry for it.
    #[inline]
    pub fn size(&self, i: usize) -> f32 {
        self.sizes.get(i).copied().unwrap_or(1.0)
    }

    /// The values of the attribute of this name; none if the state lacks it.
    pub fn attribute(&self, name: &str) -> Option<&AttributeData> {
        self.attributes.iter().find(|a| a.name == name).map(|a| &a.data)
    }

    /// Vector by which [`bent_normal`] bends the normals of instance `i`, in asset space; zero without the attribute.
    #[inline]
    pub fn canopy_normal(&self, i: usize) -> Vec3 {
        match self.attribute(CANOPY_NORMAL) {
            Some(AttributeData::Vector(list)) => list.get(i).map_or(Vec3::ZERO, |v| Vec3::from_array(*v)),
            _ => Vec3::ZERO,
        }
    }

    /// Share of the skylight that its crown takes from instance `i`, 0 to 1; 0 without the attribute.
    #[inline]
    pub fn canopy_occlusion(&self, i: usize) -> f32 {
        match self.attribute(CANOPY_OCCLUSION) {
            Some(AttributeData::Unit1(list)) => list.get(i).copied().unwrap_or(0.0),
            _ => 0.0,
        }
    }

    /// An attribute of numbers from 0 to 1, one per instance; added with zeros where the state has none of that name.
    pub fn unit_attribute_mut(&mut self, name: &'static str) -> &mut [f32] {
        let is_same = |a: &Attribute| a.name == name && matches!(a.data, AttributeData::Unit1(_));
        if !self.attributes.iter().any(is_same) {
            let zeros = AttributeData::Unit1(vec![0.0; self.positions.len()]);
            self.attributes.push(Attribute::instance(name, zeros));
        }
        match self.attributes.iter_mut().find(|a| is_same(a)).map(|a| &mut a.data) {
            Some(AttributeData::Unit1(values)) => values,
            _ => &mut [],
        }
    }
}

/// A unit normal bent by a vector of [`CANOPY_NORMAL`], in the same space: n (1 - |c|) + c, of unit length.
/// # Examples
/// ```
/// use glam::Vec3;
/// use osier_scene::bent_normal;
///
/// assert_eq!(bent_normal(Vec3::X, Vec3::ZERO), Vec3::X);
/// assert!(bent_normal(Vec3::X, Vec3::Y * 0.5).distance(Vec3::new(0.5, 0.5, 0.0).normalize()) < 1e-6);
/// assert!(bent_normal(Vec3::X, Vec3::Y).distance(Vec3::Y) < 1e-6);
/// ```
#[inline]
pub fn bent_normal(normal: Vec3, toward: Vec3) -> Vec3 {
    let weight = toward.length().min(1.0);
    if weight > 0.0 { osier_base::math::normalize_or(normal * (1.0 - weight) + toward, normal) } else { normal }
}

/// Keeps the items whose flag in `keep` is set, and those beyond its end.
fn retain<T>(list: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    list.retain(|_| keep.next().copied().unwrap_or(true));
}

/// N instances of some prototypes. N counts every instance that is ever alive; each has its own slot in all lists and frames.
#[derive(Debug, Clone)]
pub struct Instancer {
    /// Prim and node name, `[a-z0-9_]+`, unique in the asset.
    pub name: String,
    /// Meshes that instances can show; an instance names one by its index.
    pub prototypes: Vec<Prototype>,
    /// Stable id of each instance (written as 0..N-1 where a format wants small numbers).
    pub ids: Vec<u64>,
    /// Index into `prototypes` per instance.
    pub protos: Vec<u32>,
    /// Scale of each instance along its prototype's axes, constant over the clip; the `sizes` of a state multiply it.
    pub scales: Vec<Vec3>,
    /// State of all instances at rest, which formats without animation show.
    pub rest: InstanceState,
    /// Kind of motion, which decides whether frames hold states of the instances.
    pub motion: InstancerMotion,
    /// Whether exporters also write the instances as points with orientation and scale, for things that users track one by
    /// one, such as catkins and drops.
    pub tracked: bool,
}

impl Instancer {
    /// Number of slots, one for each instance that is ever alive.
    #[inline]
    pub fn len(&self) -> usize {
        self.protos.len()
    }

    /// True without slots, so that no instance is ever alive.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.protos.is_empty()
    }

    /// Keeps the instances whose flag in `keep` is set, and those beyond its end; its prototypes stay.
    pub fn retain(&mut self, keep: &[bool]) {
        retain(&mut self.ids, keep);
        retain(&mut self.protos, keep);
        retain(&mut self.scales, keep);
        self.rest.retain(keep);
        if let InstancerMotion::Joints(joints) = &mut self.motion {
            retain(joints, keep);
        }
    }

    /// Asset from prototype space for instance `i` in a state, alive or not.
    #[inline]
    pub fn transform(&self, state: &InstanceState, i: usize) -> Trs {
        Trs { t: state.positions[i], r: state.orientations[i], s: self.scales[i] * state.size(i) }
    }
}
