//! Scene files: notation, defaults, references. No later step reads the text of a scene.
//!
//! [`resolve`] turns a scene's text into a [`Recipe`]: every key typed, in SI units and radians, every default filled in,
//! every reference read. All errors are collected with their positions. [`scene`] declares the keys of each table; the structs
//! below declare which tables a scene has. Listings, the names that a table may hold and the scene hash follow from both.

mod companions;
mod given;
mod ignored;
mod key_places;
mod library;
mod resolve;
pub mod scene;
mod syntax;

use std::sync::Arc;

pub use companions::{Companions, OrganSurface, SurfaceForm};
pub use given::{GivenKey, given_keys};
pub use key_places::KeyPlaces;
pub use library::{Library, ReferencedFile};
use osier_export::format::TextureUse;
use osier_grammar::Grammar;
use osier_ifs::Ifs;
use osier_ifs::dynamics::SystemAnalysis;
use osier_ifs::game::Extent;
use osier_ifs::leaf;
use osier_ifs::stems::TreeSystem;
use osier_ifs::weights::WeightRule;
use osier_import::{GreyImage, HeightMap, Imported};
use osier_scene::{AirGrid, Clip, Image};
pub use resolve::{Request, SingleSource, resolve};
use syntax::recipe;
pub use syntax::{
    Choice, Digest, KeyInfo, KeyListing, KeyTable, RecipePart, Reference, Registry, TableInfo, ValueForm, ValueKind,
    ValueType, path_element, word_of,
};

/// Letter of the organ for billboards of a tree's small branches; it is last in the list of organs.
pub const CARD: char = '\u{e000}';

recipe! {
    /// A scene with every default filled in and every reference read.
    Recipe {
        /// Stem of the scene file reduced to `[a-z0-9_]+`, which names the files of a bake.
        name: String;
        /// Title (without the key, the file's name), seed of all random draws, and defaults of season and latitude.
        general: scene::SceneKeys;
        /// First and last frame, frames per second; a single frame is a still scene.
        clip: Clip;
        /// Kinds of plants, in the order of the file.
        plants: Vec<PlantRecipe>;
        /// Attractors whose points are drawn or exported, in the order of the scene.
        clouds: Vec<AttractorRecipe>;
        /// Keys of `[catkin]`; `None` without the table, where a flight uses the defaults.
        catkin: Option<scene::CatkinKeys>, hashed by element;
        /// Size, view, tone mapping and density estimation of an attractor's picture.
        picture: scene::PictureKeys;
        /// Layers of a composed picture, from the lowest.
        layers: Vec<LayerRecipe>, hashed by element;
        /// Groups of copies of plants; without `[[place]]` and `[[scatter]]`, one copy of each plant.
        places: Vec<PlaceRecipe>;
        /// Disc of ground around the plants, used without a terrain.
        ground: scene::GroundKeys;
        /// Terrain, which replaces the ground.
        terrain: Option<TerrainRecipe>, hashed by element;
        /// Tables `[[scatter]]`, in the order of the scene; empty without a terrain.
        scatters: Vec<ScatterRecipe>, hashed by element;
        /// Catkins in flight: release, motion, deposition.
        flight: Option<FlightRecipe>, hashed by element;
        /// Obstacles to wind, rain, catkins and growth.
        solids: Vec<SolidRecipe>, hashed by element;
        /// Elastic rods, each after the rod to which its base is fixed.
        rods: Vec<RodRecipe>, hashed by element;
        /// Rainfall and drops, if the scene has a `[rain]`.
        rain: Option<scene::RainRecipe>, hashed by element;
        /// Number, resolution and layers of the water maps of leaves.
        maps: scene::LeafMapKeys, hashed if asks_for_maps;
        /// Haze: visibility distance and scale height.
        fog: scene::FogKeys;
        /// Camera, fitted to the plants unless its eye is set.
        camera: scene::CameraKeys;
        /// Direction, colour and irradiance of the sun.
        sun: scene::SunKeys;
        /// Colours and brightness of the sky dome.
        sky: scene::SkyKeys;
        /// The wind; Beaufort numbers and curves have been converted to its speed and direction.
        wind: scene::WindKeys;
        /// Domain and inlet of a lattice wind, used with `model = "lattice"`.
        lattice: scene::LatticeKeys, hashed if has_lattice_wind;
        /// Further winds, whose velocities are added to that of `wind`.
        added: Vec<scene::WindKeys>, hashed by element;
        /// Model, loop and exaggeration of the plants' sway.
        sway: scene::SwayKeys;
        /// Formats and their options.
        output: OutputRecipe;
        derived {
            /// Whether the scene has a clip of several frames with wind in it.
            moves: bool;
            /// BLAKE3 of all fields that are not derived and of the bytes of all files read, 64 hex digits.
            hash: String;
            /// Places of the keys in the scene's text, for messages.
            places_of_keys: KeyPlaces;
        }
    }
}

/// Gravity of a scene without `[rain]`, m/s^2.
const EARTH: f64 = osier_base::physics::GRAVITY;

impl Recipe {
    /// Whether some wind of the scene reaches [`osier_wind::CALM_SPEED`].
    pub fn blows(&self) -> bool {
        self.wind.blows() || self.added.iter().any(scene::WindKeys::blows)
    }

    /// Whether the scene is a picture composed of layers, with no objects in space.
    pub fn is_layered_picture(&self) -> bool {
        !self.layers.is_empty() && self.plants.is_empty() && self.clouds.is_empty() && self.terrain.is_none()
    }

    /// Whether `[wind]` has `model = "lattice"`, with any solver.
    pub fn has_lattice_wind(&self) -> bool {
        self.wind.model == scene::WindModel::Lattice
    }

    /// Hash of a bake of `frames`, by which the manifest tells whether a folder is up to date: that of the scene, for a part of the clip
    /// also of the list of its frames. Files hold that of the scene, so that those of a frame do not depend on which others are written.
    pub fn hash_of_frames(&self, frames: &[u32]) -> String {
        if frames.is_empty() || frames.len() == self.clip.len() {
            return self.hash.clone();
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.hash.as_bytes());
        // Four bytes per frame number make the encoding of a list unique.
        for frame in frames {
            hasher.update(&frame.to_le_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// Gravity on all that moves, m/s^2: that of the scene's rain if it has one.
    pub fn gravity(&self) -> f64 {
        self.rain.as_ref().map_or(EARTH, |rain| rain.keys.gravity)
    }
}

/// Source from which a plant grows, with its keys.
#[derive(Debug, Clone)]
pub enum Growth {
    /// An L-system, whose string of modules the turtle interprets.
    Grammar(Box<Grammar>),
    /// The words of an iterated function system, each of which is a stem.
    Ifs(Box<TreeSystem>, scene::IfsTreeKeys),
    /// A mesh of a whole plant, from which a skeleton is extracted.
    Mesh(Box<Imported>, scene::ImportedMeshKeys),
    /// Particle-shapes: particles whose paths become axes, and which spawn others.
    Shapes(Box<scene::ShapeKeys>),
    /// A species that grows year by year in a field of light.
    Species(Box<SpeciesRecipe>),
}

impl Digest for Growth {
    /// The bytes of a grammar are hashed with all files.
    fn digest(&self, hasher: &mut blake3::Hasher) {
        match self {
            // Its defines may be overridden, but those overrides are keys of the plant and hashed there.
            Self::Grammar(_) => {}
            Self::Ifs(_, tree) => tree.digest(hasher),
            Self::Mesh(_, import) => import.digest(hasher),
            Self::Shapes(keys) => keys.digest(hasher),
            Self::Species(species) => species.digest(hasher),
        }
    }
}

impl RecipePart for Growth {
    fn list(tables: &mut Vec<TableInfo>) {
        scene::IfsTreeKeys::list(tables);
        scene::ImportedMeshKeys::list(tables);
        scene::ShapeKeys::list(tables);
        SpeciesRecipe::list(tables);
    }
}

impl Digest for Clip {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        self.start.digest(hasher);
        self.end.digest(hasher);
        self.fps.digest(hasher);
    }
}

impl RecipePart for Clip {
    fn list(tables: &mut Vec<TableInfo>) {
        scene::FramesKeys::list(tables);
    }
}

/// Pictures that cover a bark instead of a painted pattern.
#[derive(Debug, Clone)]
pub struct BarkPictures {
    /// Colour, sRGB.
    pub color: Image,
    /// Tangent-space normals, green up the stem; `None` for an even surface.
    pub normal: Option<Image>,
}

recipe! {
    /// A plant of `[plants.NAME]`, of which places and scatters have copies.
    PlantRecipe {
        /// As written in the scene.
        name: String;
        /// Keys of the table itself, without those of the tables below it.
        keys: scene::PlantKeys;
        /// Grammar, coefficient table, mesh or particle-shapes that it is grown from.
        growth: Growth;
        /// Particle-shapes that add twigs and leaves to the grown plant; `None` without the key `twigs`.
        fill: Option<scene::ShapeKeys>, hashed by element;
        /// Options of the turtle that draws its string; only used by grammars.
        turtle: scene::TurtleKeys;
        /// Organs, one for each letter that the source uses; for a grammar, the letters after `~`.
        organs: Vec<OrganRecipe>;
        /// Bark of thick axes.
        bark: scene::BarkKeys;
        /// Bark of axes with a radius below 8 mm at their base.
        shoot: scene::BarkKeys;
        /// Form, resolution and texture coordinates of the bark's mesh.
        skin: scene::SkinKeys;
        /// Mechanical properties of wood and leaves, for sway and rods.
        wood: scene::WoodKeys;
        /// Parameters of its rods; `None` for a plant that moves by the sway model.
        rods: Option<scene::RodPlantKeys>, hashed by element;
        derived {
            /// `[a-z0-9_]+`, unique among the plants.
            id: String;
            /// Contents of the companion files of its grammar; empty for other sources.
            companions: Companions;
            /// Name of the file from which it grows, for messages and manifests.
            source: String;
            /// IFS tables whose density is the grain of bark and of shoot; `None` without the key `ifs`.
            grains: [Option<Arc<Ifs>>; 2];
            /// Pictures that cover bark and shoot; `None` without the key `texture`.
            bark_pictures: [Option<BarkPictures>; 2];
        }
    }
}

recipe! {
    /// A tree that grows year by year.
    SpeciesRecipe {
        /// Parameters of its growth, in the units of the `.species` file.
        habit: scene::HabitKeys;
        /// Sky and solids around the tree, and the ages that a clip shows.
        site: scene::SiteKeys;
        /// A ring of simulated but invisible neighbours that shade the tree; `None` for a tree in the open.
        stand: Option<scene::StandKeys>, hashed by element;
        /// Prunings, in the order of the scene.
        prunes: Vec<scene::PruneKeys>, hashed by element;
        derived {
            /// Age of the tree, years; the key or habit from which it comes is hashed.
            age: f64;
            /// Ages at the first and the last frame of a clip of its growth, years; the keys from which they come are hashed.
            clip: Option<[f64; 2]>;
        }
    }
}

recipe! {
    /// Appearance of one organ: a parametric blade, or what replaces it.
    OrganRecipe {
        /// The letter after `~` in the grammar.
        letter: char;
        /// Outline, size, colours and maps.
        keys: scene::OrganKeys;
        derived {
            /// The IFS table from which it is drawn, if one replaces the parametric blade.
            ifs: Option<Arc<Ifs>>;
            /// The leaf drawn from that table, filled when it is first needed; organs of the same table and keys share it.
            drawn: Arc<leaf::LazyLeaf>;
            /// The imported mesh, if one replaces the parametric blade.
            mesh: Option<Arc<Imported>>;
            /// The surface of a companion file, if one replaces the parametric blade.
            surface: Option<Arc<OrganSurface>>;
        }
    }
}

recipe! {
    /// An attractor whose points are drawn or exported.
    AttractorRecipe {
        /// As written in the scene.
        name: String;
        /// Keys of its table in the scene, defaults filled in.
        keys: scene::AttractorKeys;
        /// Keyframes of its change over time; `system` is then that of the first keyframe.
        morph: Option<scene::MorphRecipe>, hashed by element;
        derived {
            /// `[a-z0-9_]+`, unique among plants and clouds.
            id: String;
            /// Name of its table file, for messages and manifests.
            source: String;
            /// The maps of the attractor as read from its table.
            system: Ifs;
            /// Rule by which the probabilities of its maps are computed.
            rule: WeightRule;
            /// Contraction, dimensions and probabilities of the system.
            study: SystemAnalysis;
            /// Bounds and quantile box of the attractor, table units; of a morph, their union over all keyframes.
            extent: Extent;
        }
    }
}

recipe! {
    /// One `[[layer]]` of a composed picture: an attractor or a gradient.
    LayerRecipe {
        /// Position, size, colours and opacity of the layer.
        keys: scene::LayerKeys;
        derived {
            /// The attractor that the layer shows; `None` for a box with a colour gradient.
            cloud: Option<AttractorRecipe>;
        }
    }
}

recipe! {
    /// A group of copies of one plant around a point, along a line or over an area.
    PlaceRecipe {
        /// Index into [`Recipe::plants`].
        plant: usize;
        /// Position, spread and number of copies.
        keys: scene::PlaceKeys;
        derived {
            /// Positions of the copies along a line, m, relative to the place's `at`; empty for a group.
            line: Vec<[f64; 3]>;
            /// Density of copies over the place's area; `None` for an even one.
            mask: Option<GreyImage>;
        }
    }
}

/// Content of the file that a terrain is read from.
#[derive(Debug, Clone)]
pub enum TerrainFile {
    /// Heights on a regular grid, from a picture or a raster.
    Map(Arc<HeightMap>),
    /// An imported mesh, whose highest surface is the ground.
    Mesh(Arc<Imported>),
}

recipe! {
    /// Terrain of `[terrain]`, generated or read from a file.
    TerrainRecipe {
        /// Parameters of its generation or reading, and its colours.
        keys: scene::TerrainKeys;
        derived {
            /// Content of the file from which it is made; `None` for a generated terrain.
            file: Option<TerrainFile>;
            /// Colour picture over the whole terrain; `None`: it is painted by slope, or has the materials of its mesh.
            texture: Option<Image>;
        }
    }
}

recipe! {
    /// A set of plants scattered at random over the terrain.
    ScatterRecipe {
        /// Density, extent and limits of the scatter.
        keys: scene::ScatterKeys;
        derived {
            /// Indices into [`Recipe::plants`], with their weights.
            plants: Vec<(usize, f64)>;
            /// Relative density over the terrain; `None` for an even one.
            mask: Option<GreyImage>;
        }
    }
}

recipe! {
    /// Catkins in flight: release, motion, deposition.
    FlightRecipe {
        /// Keys of `[flight]`, with the defaults of its preset.
        keys: scene::FlightKeys;
        /// Rectangles on the ground in which depositions are counted.
        zones: Vec<scene::FlightZoneKeys>, hashed by element;
        derived {
            /// Plants that release catkins, as indices into [`Recipe::plants`], with their weights; empty for other releases.
            canopy: Vec<(usize, f64)>;
            /// Relative frequency of each form of catkins, in the order of their names; 0 for a form that does not occur.
            forms: Vec<f64>;
            /// Start positions, m, read from a file of points; empty for other releases.
            starts: Vec<[f64; 3]>;
            /// Wetness of the ground, 0..1; `None` for the same everywhere.
            wet: Option<GreyImage>;
        }
    }
}

recipe! {
    /// An obstacle of `[[solid]]`.
    SolidRecipe {
        /// Shape, size, position and humidity of the solid.
        keys: scene::SolidKeys;
        derived {
            /// `[a-z0-9_]+`, unique among the solids.
            id: String;
            /// The imported mesh of a solid with `shape = "mesh"`.
            mesh: Option<Arc<Imported>>;
        }
    }
}

recipe! {
    /// An elastic rod of `[[rod]]`, with its clamps and loads.
    RodRecipe {
        /// Axis, radii, material and integrator of the rod.
        keys: scene::RodKeys;
        /// Fixed, pinned and guided points of the rod.
        clamps: Vec<scene::RodClampKeys>;
        /// Forces, torques, attached masses and impulses on the rod.
        loads: Vec<scene::RodLoadKeys>, hashed by element;
        derived {
            /// `[a-z0-9_]+`, unique among the rods.
            id: String;
            /// Rod to which its base is fixed, as an index into [`Recipe::rods`] below its own; `None` for a rod clamped in the
            /// world.
            on: Option<usize>;
        }
    }
}

recipe! {
    /// Formats and their options.
    OutputRecipe {
        /// Formats to write, and the resolution of textures.
        keys: scene::OutputKeys;
        /// `[output.pov]`: size, shutter, units and frame step of the POV-Ray files.
        pov: scene::PovKeys;
        /// Options of POV-Ray's photon mapping; `None` without it.
        photons: Option<scene::PhotonKeys>, hashed by element;
        /// `[output.usd]`: up axis, representation of copies, and tolerances of keyframes.
        usd: scene::UsdKeys;
        /// `[output.gltf]`: profiles, compression, limits of nodes and skins, and vertex channels.
        gltf: scene::GltfKeys;
        /// `[output.points]`: tables and up axis of the points in CSV files.
        points: scene::PointsKeys, hashed if writes_points;
        /// `[output.unreal]`: number of joints of plants for Unreal Engine.
        unreal: scene::UnrealKeys, hashed if writes_unreal;
        /// `[output.vdb]`: quantities, box and precision of the voxel grids.
        vdb: VdbRecipe, hashed if writes_vdb;
        /// `[output.wind]`: planes and box in which the wind is exported.
        wind: WindOutputRecipe, hashed if writes_wind;
    }
}

impl OutputRecipe {
    /// Whether the recipe exports planes or boxes of the wind.
    pub fn writes_wind(&self) -> bool {
        !self.wind.grids.is_empty()
    }

    /// Whether OpenVDB is among the formats.
    pub fn writes_vdb(&self) -> bool {
        self.writes(&osier_export::vdb::FORMAT)
    }

    /// Cells of the voxel grid of the wind's velocity, if it is written.
    pub fn velocity_volume(&self) -> Option<&AirGrid> {
        let wanted = self.writes_vdb() && self.vdb.keys.grids.contains(&scene::VdbGrid::Velocity);
        self.vdb.domain.as_ref().filter(|_| wanted)
    }

    /// Whether point tables in CSV are among the formats.
    pub fn writes_points(&self) -> bool {
        self.writes(&osier_export::points::FORMAT)
    }

    /// Whether files for Unreal Engine are among the formats.
    pub fn writes_unreal(&self) -> bool {
        self.writes(&osier_export::unreal::FORMAT)
    }

    /// What the formats of a bake need of the textures of the scene.
    pub fn texture_use(&self) -> TextureUse {
        self.keys.formats.iter().map(|f| f.0.textures).max().unwrap_or(TextureUse::Unused)
    }

    /// Whether a format is among those of the key `formats`.
    pub fn writes(&self, format: &osier_export::format::FormatInfo) -> bool {
        self.keys.formats.iter().any(|f| f.0.word == format.word)
    }
}

recipe! {
    /// Selection and domain of the OpenVDB grids.
    VdbRecipe {
        /// Keys of `[output.vdb]`.
        keys: scene::VdbKeys;
        derived {
            /// Cells of the box in which the wind is sampled; grids of catkins use the same lattice of cells. `None` without a
            /// clip.
            domain: Option<AirGrid>;
        }
    }
}

recipe! {
    /// Selection and domain of the files of the wind.
    WindOutputRecipe {
        /// Keys of `[output.wind]`.
        keys: scene::WindOutputKeys;
        /// Planes of `[[output.wind.slice]]`, in the order of the scene.
        slices: Vec<scene::WindSliceKeys>, hashed by element;
        derived {
            /// Cells in which the wind is sampled: one grid per plane, then the box, if it is written.
            grids: Vec<AirGrid>;
        }
    }
}

/// Every table and key that a scene may hold, in the order of [`Recipe`].
pub fn options() -> Vec<TableInfo> {
    Registry::of::<Recipe>().into_tables()
}

/// Content of a file, which plants with the same reference share.
pub type Bytes = Arc<[u8]>;
