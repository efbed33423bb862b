//! Scene files: notation, defaults, references. No later step reads the text of a scene.
//!
//! [`resolve`] turns a scene's text into a [`Recipe`]: every key typed, in SI units and radians, every default filled in,
//! every reference read. All faults are collected with their places. [`scene`] declares the keys of each table; the structs
//! below declare which tables a scene has. Listings, the names that a table may hold and the scene hash follow from both.

mod companions;
mod given;
mod library;
mod resolve;
pub mod scene;
mod syntax;

use std::sync::Arc;

pub use companions::{Companions, OrganSurface, SurfaceForm};
pub use given::{GivenKey, given_keys};
pub use library::{Library, ReferencedFile};
use osier_grammar::Grammar;
use osier_ifs::Ifs;
use osier_ifs::dynamics::SystemAnalysis;
use osier_ifs::game::Extent;
use osier_ifs::leaf;
use osier_ifs::stems::TreeSystem;
use osier_ifs::weights::WeightRule;
use osier_import::{GreyImage, HeightMap, Imported};
use osier_scene::{AirGrid, Clip, Image};
pub use resolve::{Request, resolve};
use syntax::recipe;
pub use syntax::{
    Choice, Digest, KeyInfo, KeyListing, KeyTable, RecipePart, Reference, Registry, TableInfo, ValueForm, ValueKind,
    ValueType, word_of,
};

/// Letter of the organ for billboards of a tree's small branches; it is last in the list of organs.
pub const CARD: char = '\u{e000}';

recipe! {
    /// A scene with every default filled in and every reference read.
    Recipe {
        /// File name, `[a-z0-9_]+`.
        name: String;
        /// Title, as the artist wrote it or the file's name, and the seed of all draws.
        general: scene::SceneKeys;
        /// First and last frame, frames per second.
        clip: Clip;
        /// Kinds of plants, in the order of the file.
        plants: Vec<PlantRecipe>;
        /// Attractors whose points are drawn or exported, in the order of the scene.
        clouds: Vec<AttractorRecipe>;
        /// Keys of `[catkin]`; `None` without the table, where a flight uses the defaults.
        catkin: Option<scene::CatkinKeys>, hashed by element;
        /// How an attractor becomes a picture.
        picture: scene::PictureKeys;
        /// Layers of a composed picture, from the lowest.
        layers: Vec<LayerRecipe>, hashed by element;
        /// Groups of copies of plants.
        places: Vec<PlaceRecipe>;
        /// Disc of ground around the plants, used without a terrain.
        ground: scene::GroundKeys;
        /// Terrain, which replaces the ground.
        terrain: Option<TerrainRecipe>, hashed by element;
        /// Plants scattered over the terrain.
        scatters: Vec<ScatterRecipe>, hashed by element;
        /// Catkins in flight: release, motion, deposition.
        flight: Option<FlightRecipe>, hashed by element;
        /// Obstacles to wind and catkins.
        solids: Vec<SolidRecipe>, hashed by element;
        /// Rods, each after the one that its base is fixed to.
        rods: Vec<RodRecipe>, hashed by element;
        /// Rainfall and drops, if the scene has a `[rain]`.
        rain: Option<scene::RainRecipe>, hashed by element;
        /// Maps of wet leaves.
        maps: scene::LeafMapKeys, hashed if asks_for_maps;
        /// Haze: visibility distance and scale height.
        fog: scene::FogKeys;
        /// Camera, fitted to the plants unless its eye is set.
        camera: scene::CameraKeys;
        /// Direction, colour and irradiance of the sun.
        sun: scene::SunKeys;
        /// Colours and brightness of the sky dome.
        sky: scene::SkyKeys;
        /// Wind; its speed already accounts for Beaufort numbers.
        wind: scene::WindKeys;
        /// The lattice, used with `model = "lattice"`.
        lattice: scene::LatticeKeys, hashed if has_lattice_wind;
        /// Further winds, whose velocities are added to that of `wind`.
        added: Vec<scene::WindKeys>, hashed by element;
        /// How plants answer the wind.
        sway: scene::SwayKeys;
        /// Formats and their options.
        output: OutputRecipe;
        derived {
            /// True if the scene has a clip with wind in it, whichever frame is drawn.
            moves: bool;
            /// Hash of all that is not derived and of the bytes of all files read, 64 hex digits.
            hash: String;
        }
    }
}

/// Gravity where no rain has one, m/s^2.
const EARTH: f64 = osier_base::physics::GRAVITY;

impl Recipe {
    /// True if some wind of the scene reaches [`osier_wind::CALM_SPEED`].
    pub fn blows(&self) -> bool {
        self.wind.blows() || self.added.iter().any(scene::WindKeys::blows)
    }

    /// True if the scene is a picture composed of layers, without anything in space.
    pub fn is_layered_picture(&self) -> bool {
        !self.layers.is_empty() && self.plants.is_empty() && self.clouds.is_empty() && self.terrain.is_none()
    }

    /// True if the wind has `model = "lattice"`, whatever its solver.
    pub fn has_lattice_wind(&self) -> bool {
        self.wind.model == scene::WindModel::Lattice
    }

    /// Gravity that rods hang in, m/s^2: that of the scene's rain.
    pub fn gravity(&self) -> f64 {
        self.rain.as_ref().map_or(EARTH, |rain| rain.keys.gravity)
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
    /// Particles that leave axes behind and spawn others.
    Shapes(Box<scene::ShapeKeys>),
    /// Growth year by year.
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

recipe! {
    /// A plant of `[plants.NAME]`, of which places and scatters put up copies.
    PlantRecipe {
        /// As written in the scene.
        name: String;
        /// Keys of its own table.
        keys: scene::PlantKeys;
        /// Grammar, coefficient table, mesh or particle-shapes that it is grown from.
        growth: Growth;
        /// Twigs and leaves that are added to what has grown, if any are.
        fill: Option<scene::ShapeKeys>, hashed by element;
        /// How its string is drawn.
        turtle: scene::TurtleKeys;
        /// Organs: one for each letter after `~` of the grammar.
        organs: Vec<OrganRecipe>;
        /// Bark of thick axes.
        bark: scene::BarkKeys;
        /// Bark of axes below 8 mm radius.
        shoot: scene::BarkKeys;
        /// How bark becomes a mesh.
        skin: scene::SkinKeys;
        /// Mechanical properties.
        wood: scene::WoodKeys;
        /// How it moves as rods, if it does.
        rods: Option<scene::RodPlantKeys>, hashed by element;
        derived {
            /// `[a-z0-9_]+`, unique among the plants.
            id: String;
            /// What the companion files of its grammar hold.
            companions: Companions;
            /// Name of the file that grows it, for people.
            source: String;
            /// Tables whose density tiles bark and shoot.
            grains: [Option<Arc<Ifs>>; 2];
        }
    }
}

recipe! {
    /// A tree that grows year by year.
    SpeciesRecipe {
        /// Parameters of its growth, in the units of the habit's file.
        habit: scene::HabitKeys;
        /// Sky and solids around it.
        site: scene::SiteKeys;
        /// Its unseen neighbours, if it has any.
        stand: Option<scene::StandKeys>, hashed by element;
        /// Cuts, in the order of the scene.
        prunes: Vec<scene::PruneKeys>, hashed by element;
        derived {
            /// Years; hashed with the key or the habit that it comes from.
            age: f64;
            /// Ages at the first and the last frame of a clip of its growth, years; hashed with the keys that they come from.
            clip: Option<[f64; 2]>;
        }
    }
}

recipe! {
    /// What one organ looks like.
    OrganRecipe {
        /// The letter after `~` in the grammar.
        letter: char;
        /// Outline, size, colours and maps.
        keys: scene::OrganKeys;
        derived {
            /// The table that draws it, if one replaces the procedural blade.
            ifs: Option<Arc<Ifs>>;
            /// What that table draws, once it has been asked for; organs of the same table and keys share it.
            drawn: Arc<leaf::LazyLeaf>;
            /// The artist's mesh, if one replaces the procedural blade.
            mesh: Option<Arc<Imported>>;
            /// The surface of a companion file, if one replaces the procedural blade.
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
        /// How it changes; the system is then the first one.
        morph: Option<scene::MorphRecipe>, hashed by element;
        derived {
            /// `[a-z0-9_]+`, unique among plants and clouds.
            id: String;
            /// Name of its file for people.
            source: String;
            /// The iterated function system.
            system: Ifs;
            /// Where its probabilities come from.
            rule: WeightRule;
            /// Contraction, dimensions and probabilities of the system.
            study: SystemAnalysis;
            /// Bounds of the attractor.
            extent: Extent;
        }
    }
}

recipe! {
    /// One layer of a composed picture.
    LayerRecipe {
        /// Where and how it is drawn.
        keys: scene::LayerKeys;
        derived {
            /// The attractor that is drawn; `None`: a plain box.
            cloud: Option<AttractorRecipe>;
        }
    }
}

recipe! {
    /// A group of copies of one plant.
    PlaceRecipe {
        /// Index into [`Recipe::plants`].
        plant: usize;
        /// Position, spread and number of copies.
        keys: scene::PlaceKeys;
        derived {
            /// Positions of the copies along a line, m, from the place's own; empty for a group.
            line: Vec<[f64; 3]>;
            /// Density over the place's area, if a picture gives it.
            mask: Option<GreyImage>;
        }
    }
}

/// Content of the file that a terrain is read from.
#[derive(Debug, Clone)]
pub enum TerrainFile {
    /// Heights on a regular grid, from a picture or a raster.
    Map(Arc<HeightMap>),
    /// An artist's mesh, whose highest surface is the ground.
    Mesh(Arc<Imported>),
}

recipe! {
    /// Land with hills.
    TerrainRecipe {
        /// How it is generated or read, and its colours.
        keys: scene::TerrainKeys;
        derived {
            /// The file that it is made of; `None`: it is generated.
            file: Option<TerrainFile>;
            /// Colour picture over all of it.
            texture: Option<Image>;
        }
    }
}

recipe! {
    /// Plants strewn over the land.
    ScatterRecipe {
        /// Density, extent and limits of the scatter.
        keys: scene::ScatterKeys;
        derived {
            /// Indices into [`Recipe::plants`], with their weights.
            plants: Vec<(usize, f64)>;
            /// Density over the terrain, if a picture gives it.
            mask: Option<GreyImage>;
        }
    }
}

recipe! {
    /// Catkins in flight: release, motion, deposition.
    FlightRecipe {
        /// Emission, motion and deposition.
        keys: scene::FlightKeys;
        /// Rectangles on the ground in which depositions are counted.
        zones: Vec<scene::FlightZoneKeys>, hashed by element;
        derived {
            /// With release from plants: indices into [`Recipe::plants`], with their weights.
            canopy: Vec<(usize, f64)>;
            /// Weight of each form of catkins, by their order; 0 for a form that is not drawn.
            forms: Vec<f64>;
            /// With release from points: places, m.
            starts: Vec<[f64; 3]>;
            /// How wet the ground is, if a picture gives it.
            wet: Option<GreyImage>;
        }
    }
}

recipe! {
    /// Something in the way.
    SolidRecipe {
        /// Form, size and position.
        keys: scene::SolidKeys;
        derived {
            /// `[a-z0-9_]+`, unique among the solids.
            id: String;
            /// The artist's mesh, if it is one.
            mesh: Option<Arc<Imported>>;
        }
    }
}

recipe! {
    /// An elastic rod of `[[rod]]`, with what clamps and loads it.
    RodRecipe {
        /// Shape and material.
        keys: scene::RodKeys;
        /// Boundary conditions along the rod.
        clamps: Vec<scene::RodClampKeys>;
        /// Forces, moments, masses and impulses on it.
        loads: Vec<scene::RodLoadKeys>, hashed by element;
        derived {
            /// `[a-z0-9_]+`, unique among the rods.
            id: String;
            /// Rod that its base is fixed to: index into [`Recipe::rods`], below its own.
            on: Option<usize>;
        }
    }
}

recipe! {
    /// Formats and their options.
    OutputRecipe {
        /// The list of formats.
        keys: scene::OutputKeys;
        /// Options of the POV-Ray files.
        pov: scene::PovKeys;
        /// POV-Ray's photons, if they are wanted.
        photons: Option<scene::PhotonKeys>, hashed by element;
        /// Options of the USD files.
        usd: scene::UsdKeys;
        /// Options of the glTF files.
        gltf: scene::GltfKeys;
        /// Options of points as CSV.
        points: scene::PointsKeys, hashed if writes_points;
        /// Options of files for Unreal Engine.
        unreal: scene::UnrealKeys, hashed if writes_unreal;
        /// Options of OpenVDB files.
        vdb: VdbRecipe, hashed if writes_vdb;
        /// Files of the wind itself.
        wind: WindOutputRecipe, hashed if writes_wind;
    }
}

impl OutputRecipe {
    /// True if files of the wind itself are written.
    pub fn writes_wind(&self) -> bool {
        !self.wind.grids.is_empty()
    }

    /// True if voxel grids are written.
    pub fn writes_vdb(&self) -> bool {
        self.writes(&osier_export::vdb::FORMAT)
    }

    /// The grid of the wind's velocity among the voxel grids, if it is written.
    pub fn velocity_volume(&self) -> Option<&AirGrid> {
        let wanted = self.writes_vdb() && self.vdb.keys.grids.contains(&scene::VdbGrid::Velocity);
        self.vdb.domain.as_ref().filter(|_| wanted)
    }

    /// True if points are written as CSV.
    pub fn writes_points(&self) -> bool {
        self.writes(&osier_export::points::FORMAT)
    }

    /// True if files for Unreal Engine are written.
    pub fn writes_unreal(&self) -> bool {
        self.writes(&osier_export::unreal::FORMAT)
    }

    /// True if a format is among those that are written.
    pub fn writes(&self, format: &osier_export::format::FormatInfo) -> bool {
        self.keys.formats.iter().any(|f| f.0.word == format.word)
    }
}

recipe! {
    /// Which voxel grids are written.
    VdbRecipe {
        /// Keys of `[output.vdb]`.
        keys: scene::VdbKeys;
        derived {
            /// Cells of the box in which the wind is sampled, which other grids continue; `None` without a clip.
            domain: Option<AirGrid>;
        }
    }
}

recipe! {
    /// Which files of the wind itself are written.
    WindOutputRecipe {
        /// Keys of `[output.wind]`.
        keys: scene::WindOutputKeys;
        /// Planes, as written.
        slices: Vec<scene::WindSliceKeys>, hashed by element;
        derived {
            /// Where the wind is sampled: each plane, then the box.
            grids: Vec<AirGrid>;
        }
    }
}

/// Every table and key that a scene may hold, in the order of [`Recipe`].
pub fn options() -> Vec<TableInfo> {
    Registry::of::<Recipe>().into_tables()
}

/// Bytes that several plants may share.
pub type Bytes = Arc<[u8]>;
