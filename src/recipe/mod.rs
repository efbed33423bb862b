//! Scene files: notation, defaults, references. Text ends here.
//!
//! [`resolve`] turns a scene's text into a [`Recipe`]: every key typed, in SI units and radians, every default filled in,
//! every reference read. All faults are collected with their places. [`sections`] declares the keys.

pub mod air;
pub mod catkin_keys;
pub mod cloud_keys;
mod clouds;
mod condensed;
mod digest;
pub mod flight_keys;
mod flights;
mod key;
mod kinds;
mod land;
pub mod land_keys;
pub mod layer_keys;
mod layers;
mod library;
pub mod map_keys;
pub mod morph_keys;
mod morphs;
mod plants;
pub mod rain_keys;
mod resolve;
pub mod rod_keys;
mod rods;
pub mod sections;
mod tree;
pub mod wind_keys;

use std::sync::Arc;

pub use condensed::set_letters;
pub use digest::Digest;
pub use flights::FORMS;
pub use key::{KeyInfo, Section, Shown};
pub use kinds::{Word, word_of};
pub use library::{Found, Library};
pub use morphs::MorphRecipe;
use osier_grammar::Grammar;
use osier_ifs::Ifs;
use osier_ifs::dynamics::Study;
use osier_ifs::game::Extent;
use osier_ifs::leaf;
use osier_ifs::stems::Stems;
use osier_ifs::weights::Rule;
use osier_import::{Grey, Imported};
use osier_scene::{AirGrid, Clip};
pub use plants::words;
pub use resolve::{Request, resolve};

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
    pub clouds: Vec<CloudRecipe>,
    /// Catkins, if the scene has a `[catkin]`.
    pub catkin: Option<catkin_keys::CatkinKeys>,
    /// Layers of a composed picture, from the lowest.
    pub layers: Vec<LayerRecipe>,
    /// How an attractor becomes a picture.
    pub picture: cloud_keys::PictureKeys,
    /// Where the plants stand.
    pub places: Vec<PlaceRecipe>,
    /// Ground.
    pub ground: sections::GroundKeys,
    /// Land that takes the ground's place.
    pub terrain: Option<land_keys::TerrainKeys>,
    /// What is strewn over the land.
    pub scatters: Vec<ScatterRecipe>,
    /// Catkins that fly.
    pub flight: Option<FlightRecipe>,
    /// Rods, each after the one that it stands on.
    pub rods: Vec<RodRecipe>,
    /// What stands in the way of wind and catkins.
    pub solids: Vec<SolidRecipe>,
    /// Rain.
    pub rain: Option<rain_keys::RainRecipe>,
    /// Maps of wet leaves.
    pub maps: map_keys::MapKeys,
    /// Haze.
    pub fog: land_keys::FogKeys,
    /// View.
    pub camera: sections::CameraKeys,
    /// Sunlight.
    pub sun: sections::SunKeys,
    /// Sky.
    pub sky: sections::SkyKeys,
    /// Wind; its speed already accounts for Beaufort numbers.
    pub wind: wind_keys::WindKeys,
    /// The lattice, if the wind is on one.
    pub lattice: wind_keys::LatticeKeys,
    /// Winds whose velocities are added to it.
    pub added: Vec<wind_keys::WindKeys>,
    /// True if the scene has a clip with wind in it, whichever frame is drawn.
    pub moves: bool,
    /// Answer to the wind.
    pub sway: wind_keys::SwayKeys,
    /// What is written.
    pub output: OutputRecipe,
    /// Hash of everything above and of the bytes of all files read, 64 hex digits.
    pub hash: String,
}

/// Gravity where no rain has one, m/s^2.
const EARTH: f64 = 9.81;

impl Recipe {
    /// False in a calm.
    pub fn blows(&self) -> bool {
        self.wind.blows() || self.added.iter().any(wind_keys::WindKeys::blows)
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
    Ifs(Box<Stems>, cloud_keys::TreeKeys),
    /// An artist's mesh, in which a skeleton is found.
    Mesh(Box<Imported>, sections::ImportKeys),
}

/// One kind of plant.
#[derive(Debug, Clone)]
pub struct PlantRecipe {
    /// As written in the scene.
    pub name: String,
    /// `[a-z0-9_]+`, unique among the plants.
    pub id: String,
    /// Keys of its own table.
    pub keys: sections::PlantKeys,
    /// What grows it.
    pub growth: Growth,
    /// Name of the file that grows it, for people.
    pub source: String,
    /// How it is drawn.
    pub turtle: sections::TurtleKeys,
    /// Organs by letter.
    pub organs: Vec<OrganRecipe>,
    /// Bark of thick axes.
    pub bark: sections::BarkKeys,
    /// Bark of thin ones.
    pub shoot: sections::BarkKeys,
    /// Tables whose density tiles bark and shoot.
    pub grains: [Option<Arc<Ifs>>; 2],
    /// How bark becomes a mesh.
    pub skin: sections::SkinKeys,
    /// What it is made of.
    pub wood: wind_keys::WoodKeys,
    /// How it moves as rods, if it does.
    pub rods: Option<rod_keys::TwigKeys>,
}

/// What one organ looks like.
#[derive(Debug, Clone)]
pub struct OrganRecipe {
    /// The letter after `~` in the grammar.
    pub letter: char,
    /// Shape and colours.
    pub keys: sections::OrganKeys,
    /// The table that draws it, if one replaces the made blade.
    pub ifs: Option<Arc<Ifs>>,
    /// What that table draws, once it has been asked for; organs of the same table and keys share it.
    pub drawn: Arc<leaf::Once>,
    /// The artist's mesh, if one replaces the made blade.
    pub mesh: Option<Arc<Imported>>,
}

/// An attractor.
#[derive(Debug, Clone)]
pub struct CloudRecipe {
    /// As written in the scene.
    pub name: String,
    /// `[a-z0-9_]+`, unique among plants and clouds.
    pub id: String,
    /// Name of its file for people.
    pub source: String,
    /// The system.
    pub system: Ifs,
    /// Where its probabilities come from.
    pub rule: Rule,
    /// What is known about it.
    pub study: Study,
    /// Where it lies.
    pub extent: Extent,
    /// Keys of its table.
    pub keys: cloud_keys::CloudKeys,
    /// How it changes; the system is then the first one.
    pub morph: Option<MorphRecipe>,
}

/// One layer of a composed picture.
#[derive(Debug, Clone)]
pub struct LayerRecipe {
    /// What draws it; `None`: a plain box.
    pub cloud: Option<CloudRecipe>,
    /// Where and how.
    pub keys: layer_keys::LayerKeys,
}

/// A group of copies of one plant.
#[derive(Debug, Clone)]
pub struct PlaceRecipe {
    /// Index into [`Recipe::plants`].
    pub plant: usize,
    /// Where and how.
    pub keys: sections::PlaceKeys,
}

/// Plants strewn over the land.
#[derive(Debug, Clone)]
pub struct ScatterRecipe {
    /// Indices into [`Recipe::plants`], with their weights.
    pub plants: Vec<(usize, f64)>,
    /// Where they may stand.
    pub mask: Option<Grey>,
    /// How.
    pub keys: land_keys::ScatterKeys,
}

/// Catkins that fly.
#[derive(Debug, Clone)]
pub struct FlightRecipe {
    /// How.
    pub keys: flight_keys::FlightKeys,
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
    pub keys: flight_keys::SolidKeys,
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
    pub keys: rod_keys::RodKeys,
    /// Where it is held.
    pub clamps: Vec<rod_keys::RodClamp>,
    /// What acts on it.
    pub loads: Vec<rod_keys::RodLoad>,
}

/// What is written.
#[derive(Debug, Clone)]
pub struct OutputRecipe {
    /// Formats.
    pub formats: Vec<sections::Format>,
    /// POV-Ray.
    pub pov: sections::PovKeys,
    /// POV-Ray's photons, if they are wanted.
    pub photons: Option<sections::PhotonKeys>,
    /// USD.
    pub usd: sections::UsdKeys,
    /// glTF.
    pub gltf: sections::GltfKeys,
    /// Files of the wind itself.
    pub air: AirRecipe,
}

impl OutputRecipe {
    /// True if a format is among those that are written.
    pub fn writes(&self, format: &osier_export::format::FormatInfo) -> bool {
        self.formats.iter().any(|f| f.0.word == format.word)
    }
}

/// Which files of the wind itself are written.
#[derive(Debug, Clone)]
pub struct AirRecipe {
    /// Keys of its table.
    pub keys: wind_keys::AirKeys,
    /// Planes, as written.
    pub slices: Vec<wind_keys::SliceKeys>,
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
    fn info<S: Section>() -> TableInfo {
        TableInfo { path: S::PATH, about: S::about(), keys: S::keys() }
    }
    use sections as s;
    vec![
        info::<s::SceneKeys>(),
        info::<s::FramesKeys>(),
        info::<s::PlantKeys>(),
        info::<cloud_keys::TreeKeys>(),
        info::<s::ImportKeys>(),
        info::<s::TurtleKeys>(),
        info::<s::TropismKeys>(),
        info::<s::OrganKeys>(),
        info::<s::BarkKeys>(),
        info::<s::SkinKeys>(),
        info::<wind_keys::WoodKeys>(),
        info::<rod_keys::TwigKeys>(),
        info::<cloud_keys::CloudKeys>(),
        info::<morph_keys::MorphKeys>(),
        info::<morph_keys::MorphKey>(),
        info::<catkin_keys::CatkinKeys>(),
        info::<cloud_keys::PictureKeys>(),
        info::<layer_keys::LayerKeys>(),
        info::<s::PlaceKeys>(),
        info::<s::GroundKeys>(),
        info::<land_keys::TerrainKeys>(),
        info::<land_keys::ScatterKeys>(),
        info::<flight_keys::FlightKeys>(),
        info::<flight_keys::SolidKeys>(),
        info::<rod_keys::RodKeys>(),
        info::<rod_keys::RodClamp>(),
        info::<rod_keys::RodLoad>(),
        info::<rain_keys::RainKeys>(),
        info::<rain_keys::ImpactKeys>(),
        info::<rain_keys::DropKeys>(),
        info::<rain_keys::WetKeys>(),
        info::<rain_keys::LyingKeys>(),
        info::<map_keys::MapKeys>(),
        info::<land_keys::FogKeys>(),
        info::<s::CameraKeys>(),
        info::<s::SunKeys>(),
        info::<s::SkyKeys>(),
        info::<wind_keys::WindKeys>(),
        info::<wind_keys::LatticeKeys>(),
        info::<wind_keys::SwayKeys>(),
        info::<s::OutputKeys>(),
        info::<s::PovKeys>(),
        info::<s::PhotonKeys>(),
        info::<s::UsdKeys>(),
        info::<s::GltfKeys>(),
        info::<wind_keys::AirKeys>(),
        info::<wind_keys::SliceKeys>(),
    ]
}

/// Bytes that several plants may share.
pub type Bytes = Arc<[u8]>;
