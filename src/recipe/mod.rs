//! Scene files: notation, defaults, references. Text ends here.
//!
//! [`resolve`] turns a scene's text into a [`Recipe`]: every key typed, in SI units and radians, every default filled in,
//! every reference read. All faults are collected with their places. [`scene`] declares the keys.

mod library;
mod resolve;
pub mod scene;
mod syntax;

use std::sync::Arc;

pub use library::{Library, ReferencedFile};
use osier_grammar::Grammar;
use osier_ifs::Ifs;
use osier_ifs::dynamics::SystemAnalysis;
use osier_ifs::game::Extent;
use osier_ifs::leaf;
use osier_ifs::stems::TreeSystem;
use osier_ifs::weights::WeightRule;
use osier_import::{Grey, Imported};
use osier_scene::{AirGrid, Clip};
pub use resolve::{Request, resolve};
pub use syntax::{Choice, Digest, KeyInfo, KeyListing, KeyTable, Reference, ValueType, word_of};

/// Letter of the organ that cards of a tree's small branches are; it comes last.
pub const CARD: char = '\u{e000}';

/// A scene with every default filled in and every reference read.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// File name, `[a-z0-9_]+`.
    pub name: String,
    /// Title as the artist wrote it.
    pub title: String,
    /// Seed of all draws.
    pub seed: u64,
    /// Frames.
    pub clip: Clip,
    /// Kinds of plants, in the order of the file.
    pub plants: Vec<PlantRecipe>,
    /// Attractors as points.
    pub clouds: Vec<AttractorRecipe>,
    /// Catkins, if the scene has a `[catkin]`.
    pub catkin: Option<scene::CatkinKeys>,
    /// Layers of a composed picture, from the lowest.
    pub layers: Vec<LayerRecipe>,
    /// How an attractor becomes a picture.
    pub picture: scene::PictureKeys,
    /// Where the plants stand.
    pub places: Vec<PlaceRecipe>,
    /// Ground.
    pub ground: scene::GroundKeys,
    /// Land that takes the ground's place.
    pub terrain: Option<scene::TerrainKeys>,
    /// What is strewn over the land.
    pub scatters: Vec<ScatterRecipe>,
    /// Catkins that fly.
    pub flight: Option<FlightRecipe>,
    /// Rods, each after the one that it stands on.
    pub rods: Vec<RodRecipe>,
    /// What stands in the way of wind and catkins.
    pub solids: Vec<SolidRecipe>,
    /// Rain.
    pub rain: Option<scene::RainRecipe>,
    /// Maps of wet leaves.
    pub maps: scene::LeafMapKeys,
    /// Haze.
    pub fog: scene::FogKeys,
    /// View.
    pub camera: scene::CameraKeys,
    /// Sunlight.
    pub sun: scene::SunKeys,
    /// Sky.
    pub sky: scene::SkyKeys,
    /// Wind; its speed already accounts for Beaufort numbers.
    pub wind: scene::WindKeys,
    /// The lattice, if the wind is on one.
    pub lattice: scene::LatticeKeys,
    /// Winds whose velocities are added to it.
    pub added: Vec<scene::WindKeys>,
    /// True if the scene has a clip with wind in it, whichever frame is drawn.
    pub moves: bool,
    /// Answer to the wind.
    pub sway: scene::SwayKeys,
    /// What is written.
    pub output: OutputRecipe,
    /// Hash of everything above and of the bytes of all files read, 64 hex digits.
    pub hash: String,
}

/// Gravity where no rain has one, m/s^2.
const EARTH: f64 = osier_base::physics::GRAVITY;

impl Recipe {
    /// False in a calm.
    pub fn blows(&self) -> bool {
        self.wind.blows() || self.added.iter().any(scene::WindKeys::blows)
    }

    /// Gravity that rods hang in, m/s^2: that of the scene's rain.
    pub fn gravity(&self) -> f64 {
        self.rain.as_ref().map_or(EARTH, |rain| rain.keys.g)
    }
}

/// What grows a plant.
#[derive(Debug, Clone)]
pub enum Growth {
    /// A string of modules, drawn by the turtle.
    Grammar(Box<Grammar>),
    /// The words of an iterated function system.
    Ifs(Box<TreeSystem>, scene::IfsTreeKeys),
    /// An artist's mesh, in which a skeleton is found.
    Mesh(Box<Imported>, scene::ImportedMeshKeys),
}

/// One kind of plant.
#[derive(Debug, Clone)]
pub struct PlantRecipe {
    /// As written in the scene.
    pub name: String,
    /// `[a-z0-9_]+`, unique among the plants.
    pub id: String,
    /// Keys of its own table.
    pub keys: scene::PlantKeys,
    /// What grows it.
    pub growth: Growth,
    /// Name of the file that grows it, for people.
    pub source: String,
    /// How it is drawn.
    pub turtle: scene::TurtleKeys,
    /// Organs by letter.
    pub organs: Vec<OrganRecipe>,
    /// Bark of thick axes.
    pub bark: scene::BarkKeys,
    /// Bark of thin ones.
    pub shoot: scene::BarkKeys,
    /// Tables whose density tiles bark and shoot.
    pub grains: [Option<Arc<Ifs>>; 2],
    /// How bark becomes a mesh.
    pub skin: scene::SkinKeys,
    /// What it is made of.
    pub wood: scene::WoodKeys,
    /// How it moves as rods, if it does.
    pub rods: Option<scene::RodPlantKeys>,
}

/// What one organ looks like.
#[derive(Debug, Clone)]
pub struct OrganRecipe {
    /// The letter after `~` in the grammar.
    pub letter: char,
    /// Shape and colours.
    pub keys: scene::OrganKeys,
    /// The table that draws it, if one replaces the made blade.
    pub ifs: Option<Arc<Ifs>>,
    /// What that table draws, once it has been asked for; organs of the same table and keys share it.
    pub drawn: Arc<leaf::LazyLeaf>,
    /// The artist's mesh, if one replaces the made blade.
    pub mesh: Option<Arc<Imported>>,
}

/// An attractor.
#[derive(Debug, Clone)]
pub struct AttractorRecipe {
    /// As written in the scene.
    pub name: String,
    /// `[a-z0-9_]+`, unique among plants and clouds.
    pub id: String,
    /// Name of its file for people.
    pub source: String,
    /// The system.
    pub system: Ifs,
    /// Where its probabilities come from.
    pub rule: WeightRule,
    /// What is known about it.
    pub study: SystemAnalysis,
    /// Where it lies.
    pub extent: Extent,
    /// Keys of its table.
    pub keys: scene::AttractorKeys,
    /// How it changes; the system is then the first one.
    pub morph: Option<scene::MorphRecipe>,
}

/// One layer of a composed picture.
#[derive(Debug, Clone)]
pub struct LayerRecipe {
    /// What draws it; `None`: a plain box.
    pub cloud: Option<AttractorRecipe>,
    /// Where and how.
    pub keys: scene::LayerKeys,
}

/// A group of copies of one plant.
#[derive(Debug, Clone)]
pub struct PlaceRecipe {
    /// Index into [`Recipe::plants`].
    pub plant: usize,
    /// Where and how.
    pub keys: scene::PlaceKeys,
}

/// Plants strewn over the land.
#[derive(Debug, Clone)]
pub struct ScatterRecipe {
    /// Indices into [`Recipe::plants`], with their weights.
    pub plants: Vec<(usize, f64)>,
    /// Where they may stand.
    pub mask: Option<Grey>,
    /// How.
    pub keys: scene::ScatterKeys,
}

/// Catkins that fly.
#[derive(Debug, Clone)]
pub struct FlightRecipe {
    /// How.
    pub keys: scene::FlightKeys,
    /// With release from plants: indices into [`Recipe::plants`], with their weights.
    pub canopy: Vec<(usize, f64)>,
    /// How often each form is met.
    pub forms: Vec<f64>,
    /// With release from points: places, m.
    pub starts: Vec<[f64; 3]>,
    /// How wet the ground is, if a picture says so.
    pub wet: Option<Grey>,
}

/// Something in the way.
#[derive(Debug, Clone)]
pub struct SolidRecipe {
    /// `[a-z0-9_]+`, unique among the solids.
    pub id: String,
    /// Where and what.
    pub keys: scene::SolidKeys,
    /// The artist's mesh, if it is one.
    pub mesh: Option<Arc<Imported>>,
}

/// A rod.
#[derive(Debug, Clone)]
pub struct RodRecipe {
    /// `[a-z0-9_]+`, unique among the rods.
    pub id: String,
    /// Rod that its base is fixed in: index into [`Recipe::rods`], below its own.
    pub on: Option<usize>,
    /// What it is.
    pub keys: scene::RodKeys,
    /// Where it is held.
    pub clamps: Vec<scene::RodClampKeys>,
    /// What acts on it.
    pub loads: Vec<scene::RodLoadKeys>,
}

/// What is written.
#[derive(Debug, Clone)]
pub struct OutputRecipe {
    /// Formats.
    pub formats: Vec<scene::OutputFormat>,
    /// POV-Ray.
    pub pov: scene::PovKeys,
    /// POV-Ray's photons, if they are wanted.
    pub photons: Option<scene::PhotonKeys>,
    /// USD.
    pub usd: scene::UsdKeys,
    /// glTF.
    pub gltf: scene::GltfKeys,
    /// Files of the wind itself.
    pub air: WindOutputRecipe,
}

impl OutputRecipe {
    /// True if a format is among those that are written.
    pub fn writes(&self, format: &osier_export::format::FormatInfo) -> bool {
        self.formats.iter().any(|f| f.0.word == format.word)
    }
}

/// Which files of the wind itself are written.
#[derive(Debug, Clone)]
pub struct WindOutputRecipe {
    /// Keys of its table.
    pub keys: scene::WindOutputKeys,
    /// Planes, as written.
    pub slices: Vec<scene::WindSliceKeys>,
    /// Where the wind is told: each plane, then the box.
    pub grids: Vec<AirGrid>,
}

/// One table of a scene file, for listings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TableInfo {
    /// Path, `NAME` standing for the artist's names; empty at the top.
    pub path: &'static str,
    /// What it is for.
    pub about: String,
    /// Its keys.
    pub keys: Vec<KeyInfo>,
}

/// Every table and key that a scene may hold.
pub fn options() -> Vec<TableInfo> {
    fn info<S: KeyTable>() -> TableInfo {
        TableInfo { path: S::PATH, about: S::about(), keys: S::keys() }
    }
    vec![
        info::<scene::SceneKeys>(),
        info::<scene::FramesKeys>(),
        info::<scene::PlantKeys>(),
        info::<scene::IfsTreeKeys>(),
        info::<scene::ImportedMeshKeys>(),
        info::<scene::TurtleKeys>(),
        info::<scene::TropismKeys>(),
        info::<scene::OrganKeys>(),
        info::<scene::BarkKeys>(),
        info::<scene::SkinKeys>(),
        info::<scene::WoodKeys>(),
        info::<scene::RodPlantKeys>(),
        info::<scene::AttractorKeys>(),
        info::<scene::MorphKeys>(),
        info::<scene::MorphKeyframe>(),
        info::<scene::CatkinKeys>(),
        info::<scene::PictureKeys>(),
        info::<scene::LayerKeys>(),
        info::<scene::PlaceKeys>(),
        info::<scene::GroundKeys>(),
        info::<scene::TerrainKeys>(),
        info::<scene::ScatterKeys>(),
        info::<scene::FlightKeys>(),
        info::<scene::SolidKeys>(),
        info::<scene::RodKeys>(),
        info::<scene::RodClampKeys>(),
        info::<scene::RodLoadKeys>(),
        info::<scene::RainKeys>(),
        info::<scene::ImpactKeys>(),
        info::<scene::DropKeys>(),
        info::<scene::WettingKeys>(),
        info::<scene::SessileDropKeys>(),
        info::<scene::LeafMapKeys>(),
        info::<scene::FogKeys>(),
        info::<scene::CameraKeys>(),
        info::<scene::SunKeys>(),
        info::<scene::SkyKeys>(),
        info::<scene::WindKeys>(),
        info::<scene::LatticeKeys>(),
        info::<scene::SwayKeys>(),
        info::<scene::OutputKeys>(),
        info::<scene::PovKeys>(),
        info::<scene::PhotonKeys>(),
        info::<scene::UsdKeys>(),
        info::<scene::GltfKeys>(),
        info::<scene::WindOutputKeys>(),
        info::<scene::WindSliceKeys>(),
    ]
}

/// Bytes that several plants may share.
pub type Bytes = Arc<[u8]>;
