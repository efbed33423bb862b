//! Rain: drops that fall, strike leaves and wood, rest, run, hang and drip, and the maps of water that they leave.
//!
//! A [`RainSimulation`] advances all drops and the plants they fall on, which implement [`RainTarget`]; a [`RainFrame`] is its state
//! at one frame. [`LeafWaterMaps`] turns frames into texture maps of a leaf, [`DropMesh`] into meshes of drops.
//! Source: [yang-wu], sections 3 and 4; docs/rain.md lists the differences.

mod collide;
mod drops;
mod emitter;
mod event;
mod frame;
mod impact;
mod leaf;
mod maps;
mod mesh;
mod params;
mod simulation;
mod source_region;
mod target;
mod tuning;

pub use collide::LeafCollider;
pub use drops::drop::DropCap;
pub use drops::pendant::PendantShapes;
pub use drops::rain_leaf::{DropCounters, RainLeaf, WetSpot};
pub use drops::shape::{CapShape, Footprint, SphericalCap, WettingParams};
pub use emitter::{DropSizes, IntensityEnvelope, RainEmitter, RainfallParams, sphere_diameter, sphere_volume};
pub use event::RainEvent;
pub use frame::{AirborneDrop, PendantDrop, RainFrame, SessileDrop};
pub use leaf::mask::AlphaMask;
pub use leaf::surface::LeafSurface;
pub use leaf::veins::VeinMap;
pub use maps::{CapOnLeaf, LeafWaterMaps, TexelCounters, UvRaster};
pub use mesh::DropMesh;
pub use params::{DropParams, FrictionModel, ImpactLaw, LeverArm, MergeRule, capillary};
pub use simulation::{GroundHeight, LeafAttachment, RainConfig, RainSimulation, WaterBudget};
pub use target::{LeafPose, RainTarget, StaticPlant, WoodSegment};
