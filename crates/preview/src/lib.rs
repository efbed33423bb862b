//! A small renderer that draws a [`Scene`](osier_scene::Scene) at any frame.
//!
//! ```text
//! Scene ─► PreviewMaterials ─┐
//! Scene, Frame ──────────────┴─► RenderScene ─┬─ render (ray tracing, anti-aliased) ─┬─► Picture ─► PNG, ClipWriter,
//!                                RenderRequest ┴─ draft  (rasterised, one sample)   ─┘              contact_sheet
//! ```
//!
//! Light comes from a sun with an angular radius, which softens its shadows, and from the sky. Surfaces in the way of
//! the sky send back their mean colour; leaves transmit light; water refracts it.
//!
//! ```
//! use osier_base::progress::{Cancel, Silent};
//! use osier_preview::{Backdrop, Light, PreviewMaterials, Quality, RenderRequest, RenderScene, render};
//! use osier_scene::{
//!     Asset, AssetKind, Camera, Clip, Material, MaterialClass, Placement, Points, Scene, Sky, Sun, Trs,
//! };
//! use glam::Vec3;
//!
//! # fn main() -> osier_base::Result<()> {
//! // One red ball of 0.3 m, 1 m in front of the camera.
//! let ball = Points {
//!     name: "ball".into(),
//!     material: 0,
//!     positions: vec![Vec3::ZERO],
//!     widths: vec![0.3],
//!     colors: Vec::new(),
//!     attributes: Vec::new(),
//!     moving: false,
//!     reach: Default::default(),
//! };
//! let asset = Asset {
//!     id: "ball".into(),
//!     kind: AssetKind::Plant,
//!     group: String::new(),
//!     skeleton: None,
//!     meshes: Vec::new(),
//!     instancers: Vec::new(),
//!     points: vec![ball],
//!     curves: Vec::new(),
//!     rigged: None,
//! };
//! let scene = Scene {
//!     name: "ball".into(),
//!     title: String::new(),
//!     seed: 0,
//!     hash: String::new(),
//!     clip: Clip::default(),
//!     camera: Camera { eye: Vec3::Z, target: Vec3::ZERO, vfov: 0.6, roll: 0.0 },
//!     sun: Sun::default(),
//!     sky: Sky::default(),
//!     images: Vec::new(),
//!     materials: vec![Material::plain("red".into(), MaterialClass::Leaf, [0.6, 0.05, 0.05], 0.5)],
//!     assets: vec![asset],
//!     placements: vec![Placement { name: "ball".into(), asset: 0, transform: Trs::IDENTITY, phase: 0 }],
//!     land: None,
//!     tables: Vec::new(),
//!     enum_labels: Vec::new(),
//!     fields: Vec::new(),
//!     air: Vec::new(),
//!     volumes: Vec::new(),
//!     map_sequences: Vec::new(),
//! };
//! let materials = PreviewMaterials::new(&scene, Quality::Normal);
//! let render_scene = RenderScene::new(&scene, None, &materials);
//! let request = RenderRequest {
//!     camera: scene.camera,
//!     size: [32, 32],
//!     light: Light::new(&scene.sun, &scene.sky),
//!     backdrop: Backdrop::Clear { floor: None },
//!     seed: 0,
//! };
//! let picture = render(&render_scene, &request, &Cancel::default(), &Silent)?;
//! let alpha = |x, y| picture.at(x, y)[3];
//! assert_eq!([alpha(16, 16), alpha(0, 0)], [255, 0], "the ball in the centre, nothing in the corner");
//! # Ok(())
//! # }
//! ```

mod backdrop;
mod clip;
mod coat;
mod contact_sheet;
mod detail;
mod draft;
mod font;
mod framing;
mod light;
mod light_transport;
mod materials;
mod perspective;
mod picture;
mod pixel;
mod quality;
mod render;
mod render_scene;
mod request;
mod round_cone;
mod sampler;
mod solid;
mod surface;
#[cfg(test)]
mod testing;
mod texture;
mod tone;

pub use backdrop::Backdrop;
pub use clip::{ClipFormat, ClipTiming, ClipWriter};
pub use contact_sheet::{ContactSheetCell, contact_sheet, contact_sheet_columns, contact_sheet_size};
pub use framing::{CameraView, Subject};
pub use light::Light;
pub use materials::PreviewMaterials;
pub use picture::Picture;
pub use pixel::tile_count;
pub use quality::Quality;
pub use render::render;
pub use render_scene::RenderScene;
pub use request::RenderRequest;
