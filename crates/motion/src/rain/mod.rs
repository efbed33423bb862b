//! Rain: drops that fall, strike leaves and wood, rest, run, hang and drip, and the water maps that they leave.
//!
//! A [`RainSimulation`] advances all drops and the plants they fall on, which implement [`RainPlant`]; a [`RainFrame`] is its state
//! at one frame. [`LeafWaterMaps`] turns frames into texture maps of a leaf, [`DropMesh`] into meshes of drops.
//! Source: [yang-wu], sections 3 and 4; docs/rain.md lists the differences.
//!
//! # Examples
//! A drop on a leaf that hangs steeply runs down to the margin:
//! ```
//! use std::sync::Arc;
//!
//! use glam::{DQuat, DVec2, DVec3, Vec2, Vec3};
//! use osier_motion::rain::{
//!     DropMesh, DropParams, LeafOnPlant, LeafCollider, LeafSurface, RainConfig, RainFrame, RainLeaf, RainSimulation,
//!     RainSolids, StillRainPlant,
//! };
//! use osier_scene::Mesh;
//!
//! // A rectangular blade of 40 x 80 mm along +Y with its texture coordinates.
//! let mesh = Mesh {
//!     points: vec![Vec3::ZERO, Vec3::new(0.04, 0.0, 0.0), Vec3::new(0.04, 0.08, 0.0), Vec3::new(0.0, 0.08, 0.0)],
//!     normals: vec![Vec3::Z; 4],
//!     uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
//!     triangles: vec![[0, 1, 2], [0, 2, 3]],
//!     ..Mesh::default()
//! };
//! let blade = Arc::new(LeafSurface::new(&mesh).expect("a blade"));
//! let collider = Arc::new(LeafCollider::new(&blade));
//! // Its tip points down by 60 degrees from the horizontal.
//! let pose = (DVec3::Y, DQuat::from_rotation_x(-150_f64.to_radians()));
//! let mut simulation = RainSimulation::new(RainConfig {
//!     params: DropParams::default(),
//!     emitter: None,
//!     plants: vec![Box::new(StillRainPlant::new(&[pose], Vec::new()))],
//!     leaves: vec![(RainLeaf::new(blade, 1.0, 0), LeafOnPlant { plant: 0, leaf: 0, collider })],
//!     wind: None,
//!     ground: Arc::new(0.0),
//!     solids: RainSolids::default(),
//! });
//! simulation.deposit_drop(0, DVec2::new(0.5, 0.3), DVec3::ZERO, 40e-9);
//! for _ in 0..20 {
//!     simulation.step(0.005)?;
//!     simulation.check_water_budget(1)?;
//! }
//! let frame = RainFrame::capture(&mut simulation);
//! let drop = &frame.sessile[0];
//! assert!(drop.v.y > 0.0 && drop.caps[0].uv.y > 0.3);
//! let mut water = DropMesh::default();
//! water.add_sessile(&simulation.leaves()[0], &frame.leaf_poses[0], drop);
//! assert!(!water.mesh.triangles.is_empty());
//! # Ok::<(), osier_base::Error>(())
//! ```

mod bark_wetness;
mod collide;
mod drops;
mod emitter;
mod event;
mod exposure;
mod fall;
mod frame;
mod ground;
mod impact;
mod leaf;
mod maps;
mod mesh;
mod params;
mod shelter;
mod simulation;
mod solids;
mod source_region;
mod target;
mod triangle_hierarchy;
mod tuning;

pub use bark_wetness::{BarkPatch, BarkPatchParams, WoodStrike};
pub use collide::LeafCollider;
pub use drops::pendant_profile::PendantFamily;
pub use drops::rain_leaf::{DropCounters, RainLeaf, WetSpot};
pub use drops::spherical_cap::{CapDeformation, CapHeightRule, SphericalCap, UndeformedPoint, WettingParams};
pub use drops::surface_drop::DropCap;
pub use emitter::{DropSizes, IntensityEnvelope, RainEmitter, RainfallParams};
pub use event::{DropEventKind, RainEvent};
pub use exposure::{ExposedPoint, RainExposure};
pub use fall::{EmittedDrop, sphere_diameter, sphere_volume};
pub use frame::{AirborneDrop, LeafMapInput, PendantDrop, RainFrame, SessileDrop};
pub use ground::GroundHeight;
pub use leaf::alpha_mask::AlphaMask;
pub use leaf::chart::{LeafChart, UvFault};
pub use leaf::relief::MaterialHeightMap;
pub use leaf::surface::LeafSurface;
pub use leaf::veins::VeinMap;
pub use maps::{CapOnLeaf, LeafMaps, LeafWaterMaps, TexelCounters, UvRaster};
pub use mesh::{DropDetail, DropMesh, DropMeshSize};
pub use params::{DropParams, DropWeightTorque, FrictionModel, ImpactImpulseLaw, MergeRule, capillary_length};
pub use simulation::{ImpactMomentum, LeafOnPlant, LeafWetSpot, RainConfig, RainSimulation, WaterBudget};
pub use solids::RainSolids;
pub use target::{LeafPose, RainPlant, StillRainPlant, WoodSegment};
