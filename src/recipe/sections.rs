//! Every table and key of a scene file. What stands here is what `osier list options` prints and what is accepted.
//!
//! Values are in SI units and radians; keys that are not say so in their name.

use super::digest::Digest;
use super::key::{keys, words};
use super::kinds::{
    Color, File, Flag, Fps, Maybe, Numbers, OneOf, PowerOfTwo, Reference, Rows, Seed, SomeOf, Text, Tuple, Word, deg,
    mm, num, point, whole,
};
use osier_export::format::{FORMATS, FormatInfo};
use osier_export::{gltf, usd};

/// Where an organ's number comes from without its key.
const OWN: &str = "the blade's own";
/// Where a bark's number comes from without its key.
const KIND: &str = "the kind's own";

words! {
    /// How a plant's bark moves.
    Motion {
        /// Joints and weights: small files, plays everywhere.
        Skin = "skin",
        /// Points of every frame: exact, large files; a skin beside it for formats without caches.
        Cache = "cache",
        /// At most 64 joints, leaves merged with the wood's joints; their flutter and all sway also as attributes for shaders.
        Game = "game",
        /// Nothing but attributes for shaders.
        Static = "static",
        /// Not at all.
        Still = "still",
    }
    /// Outline of a leaf blade.
    Blade {
        /// Widest beyond the middle, with rounded lobes, as an oak's.
        Lobed = "lobed",
        /// Widest below the middle, doubly toothed, as a birch's.
        Toothed = "toothed",
        /// Triangular with a drawn-out tip and fine teeth, as a poplar's.
        Deltoid = "deltoid",
        /// Widest in the middle, without teeth, as a beech's.
        Elliptic = "elliptic",
    }
    /// How finely blades are cut.
    Detail {
        /// For plants seen whole: 40 to 90 points.
        Light = "light",
        /// For crowns of many thousand leaves: 20 to 50 points.
        Crown = "crown",
        /// For close-ups: every tooth, 100 to 250 points.
        Hero = "hero",
        /// For pictures of a few leaves: a smooth margin, thousands of points, a map of its relief.
        Close = "close",
    }
    /// Character of bark.
    BarkKind {
        /// Long ridges between deep cracks: oak, willow.
        Furrowed = "furrowed",
        /// Thick scales: pine.
        Plated = "plated",
        /// Nearly even: beech.
        Smooth = "smooth",
        /// Pale, with dark dashes round the girth: birch, cherry.
        Lenticel = "lenticel",
        /// Grey-green, with rows of dark diamonds: poplar, aspen.
        Diamond = "diamond",
        /// Fibrous strips: vine, cedar.
        Stringy = "stringy",
        /// Young green wood.
        Shoot = "shoot",
        /// Green and waxy with fine fibres: bamboo.
        Culm = "culm",
    }
    /// How bark maps follow a taper.
    Uv {
        /// Keeps proportions along the taper.
        Conformal = "conformal",
        /// The same number of metres per repeat everywhere.
        Metric = "metric",
    }
    /// Line style of turtle segments.
    Line {
        /// Drawn 0.02 units wide.
        Pixel = "pixel",
        /// Flat.
        Polygon = "polygon",
        /// Round.
        Cylinder = "cylinder",
    }
    /// An upward axis.
    Up {
        /// Y, as glTF.
        Y = "y",
        /// Z, as Blender.
        Z = "z",
    }
    /// How copies of a plant are shown in USD.
    CopyStyle {
        /// One point instancer for each plant: few objects, any number of copies.
        Instancer = "instancer",
        /// A prim for each copy: in Blender an object each.
        References = "references",
    }
    /// The readers a glb is made for.
    Profile {
        /// Any Blender: merged leaves, every key.
        Blender = "blender",
        /// Browsers and engines: instanced leaves, sparse keys.
        Web = "web",
    }
}

/// A format of the registry of osier-export.
#[derive(Debug, Clone, Copy)]
pub struct Format(pub &'static FormatInfo);

impl PartialEq for Format {
    fn eq(&self, other: &Self) -> bool {
        self.0.word == other.0.word
    }
}

impl Word for Format {
    const ALL: &'static [(&'static str, Self)] = &{
        let mut all = [("", Self(&usd::FORMAT)); FORMATS.len()];
        let mut i = 0;
        while i < all.len() {
            all[i] = (FORMATS[i].word, Self(FORMATS[i]));
            i += 1;
        }
        all
    };
}

impl Digest for Format {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        self.0.word.digest(hasher);
    }
}

keys! {
    /// The scene itself (keys above the first table).
    SceneKeys at "" with ["frames", "plants", "clouds", "catkin", "picture", "layer", "place", "ground", "terrain", "scatter", "flight", "solid", "rod", "rain", "maps", "fog", "camera", "sun", "sky", "wind", "sway", "output"] {
        /// Shown in files and listings.
        title: String = "title" Text("");
        /// Start of every random draw; each whole number is another individual.
        seed: u64 = "seed" Seed(1);
    }
    /// Which frames there are.
    FramesKeys at "frames" {
        /// First frame.
        start: u32 = "start" whole(1, 0, 999_999);
        /// Last frame; without it the scene stands still.
        end: Option<u32> = "end" Maybe(whole(1, 0, 999_999), "start");
        /// Frames per second.
        fps: (u32, u32) = "fps" Fps;
    }
    /// One kind of plant; NAME is yours.
    PlantKeys at "plants.NAME" with ["turtle", "tree", "leaf", "import", "organs", "bark", "shoot", "skin", "wood", "rods"] {
        /// The grammar that grows it.
        grammar: Option<Reference> = "grammar" File(".l");
        /// The coefficient table of a tree, instead of a grammar.
        ifs: Option<Reference> = "ifs" File(".ifs, .ifs.toml");
        /// A mesh of a whole plant, instead of a grammar: it gets a skeleton and sways as it is.
        mesh: Option<Reference> = "mesh" File(".obj, .glb, .gltf");
        /// Derivation length.
        steps: Option<u32> = "steps" Maybe(whole(1, 0, 1_000_000), "the grammar's");
        /// Values for the grammar's #defines.
        set: Vec<(String, f64)> = "set" Numbers;
        /// Added to the scene's seed for this plant.
        seed: u64 = "seed" Seed(0);
        /// Whether weights of productions count.
        stochastic: Option<bool> = "stochastic" Maybe(Flag(true), "true if the grammar has a Seed");
        /// How the bark moves.
        motion: Motion = "motion" OneOf(Motion::Skin);
        /// Most joints of its skeleton.
        max_joints: u32 = "max_joints" whole(256, 1, 300);
        /// Most branches that bend by themselves with `motion = "cache"`.
        max_branches: u32 = "max_branches" whole(2000, 1, 100_000);
    }
    /// How the mesh of a whole plant gets its skeleton.
    ImportKeys at "plants.NAME.import" {
        /// Objects and materials whose name holds one of these words are leaves. If none is, small flat parts are.
        leaf_pattern: String = "leaf_pattern" Text("leaf|leaves|blade|needle|frond");
        /// Distance of the points of the skeleton along the wood.
        spacing: Option<f64> = "spacing" Maybe(num(0.1, 1e-4, 100.0, "m"), "three radii of the wood");
        /// Where the trunk begins, in the mesh's place.
        root: Option<[f64; 3]> = "root" Maybe(point([0.0; 3]), "its lowest thick end");
        /// Metres per unit of the mesh.
        mesh_scale: f64 = "mesh_scale" num(1.0, 1e-6, 1e6, "m");
        /// Upward axis of the mesh.
        mesh_up: Up = "mesh_up" OneOf(Up::Y);
        /// Flutter of the leaves: 1 for round stalks, 2 to 3 for the flat ones of poplars.
        flutter: f64 = "flutter" num(1.0, 0.0, 10.0, "");
    }
    /// How the turtle draws a plant's string. Precedence: `--set`, here, then the default.
    TurtleKeys at "plants.NAME.turtle" {
        /// Angle of a turn without parameter.
        angle: Option<f64> = "angle_deg" Maybe(deg(45.0, -360.0, 360.0), "45");
        /// Size of one turtle unit.
        unit: f64 = "unit_m" num(1.0, 1e-6, 1e6, "m");
        /// Diameter at the start, in turtle units.
        width: Option<f64> = "width" Maybe(num(1.0, 1e-7, 1e6, "turtle units"), "1");
        /// What '#' and '!' without parameter add and take.
        width_increment: Option<f64> = "width_increment" Maybe(num(0.0, -1e6, 1e6, "turtle units"), "0");
        /// Line style.
        line: Option<Line> = "line" Maybe(OneOf(Line::Cylinder), "\"pixel\"");
        /// Whether a segment takes the next width at its end.
        tapered: Option<bool> = "tapered" Maybe(Flag(true), "true");
        /// Colour index at the start.
        color: Option<u32> = "color" Maybe(whole(128, 0, 255), "128");
        /// What ';' and ',' without parameter add and take.
        color_increment: Option<u32> = "color_increment" Maybe(whole(1, 0, 255), "1");
        /// Scale at the start.
        scale: Option<f64> = "scale" Maybe(num(1.0, 1e-6, 1e6, ""), "1");
        /// Factor of '@D' without parameter.
        scale_multiplier: Option<f64> = "scale_multiplier" Maybe(num(1.0, 1e-6, 1e6, ""), "1");
        /// Whether a roll made since the last segment survives a tropism.
        tropism_keep_roll: bool = "tropism_keep_roll" Flag(false);
        /// Pulls on the heading, numbered from 1 for '@T'.
        tropisms: Vec<TropismKeys> = "tropisms" Rows::<TropismKeys>(std::marker::PhantomData);
    }
    /// One tropism.
    TropismKeys at "plants.NAME.turtle.tropisms" {
        /// Where it pulls; made a unit vector.
        dir: [f64; 3] = "dir" Tuple([0.0, 1.0, 0.0], num(0.0, -1e6, 1e6, ""));
        /// Angle to the direction that it seeks.
        angle: f64 = "angle_deg" deg(0.0, -360.0, 360.0);
        /// Sign and strength.
        intensity: f64 = "intensity" num(1.0, -1.0, 1.0, "");
        /// Elasticity at the start.
        elasticity: f64 = "elasticity" num(0.0, -100.0, 100.0, "");
        /// What '@Ti' without parameter adds.
        step: f64 = "step" num(0.0, -100.0, 100.0, "");
    }
    /// What an organ looks like: NAME is the letter that follows '~' in the grammar. `[plants.NAME.leaf]` is short for the
    /// organ "l".
    OrganKeys at "plants.NAME.organs.LETTER" {
        /// Outline of a made blade.
        blade: Blade = "blade" OneOf(Blade::Elliptic);
        /// A mesh of your own instead of a made blade: petiole base at the origin, +Y along the midrib, +Z the upper side.
        mesh: Option<Reference> = "mesh" File(".obj, .glb");
        /// A coefficient table that draws the leaf, instead of a made blade.
        ifs: Option<Reference> = "ifs" File(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" Text("");
        /// Where the stalk meets the leaf of a table, in its units.
        anchor: Option<[f64; 2]> = "anchor" Maybe(Tuple([0.0, 0.0], num(0.0, -1e12, 1e12, "")), "found");
        /// Gaps in the leaf of a table that are closed, in pixels of a map of 1024.
        close: f64 = "close_px" num(2.0, 0.0, 8.0, "pixels");
        /// Largest hole in the leaf of a table that is filled, share of the map.
        fill: f64 = "fill" num(0.005, 0.0, 1.0, "");
        /// Whether holes in the leaf of a table are cut into its mesh.
        holes: bool = "holes" Flag(false);
        /// Length of the blade; the turtle's size factor multiplies it.
        size: Option<f64> = "size" Maybe(num(0.08, 1e-3, 2.0, "m"), OWN);
        /// Width over length.
        width: Option<f64> = "width" Maybe(num(0.6, 0.02, 3.0, ""), OWN);
        /// Lobes or teeth along one side.
        lobes: Option<u32> = "lobes" Maybe(whole(5, 0, 60), OWN);
        /// Depth of lobes or teeth.
        depth: Option<f64> = "depth" Maybe(num(0.35, 0.0, 0.9, "of the half width"), OWN);
        /// Smaller teeth after each large one.
        minor_teeth: Option<u32> = "minor_teeth" Maybe(whole(0, 0, 4), OWN);
        /// Side veins on each side; lobed blades have one for each lobe.
        veins: Option<u32> = "veins" Maybe(whole(6, 1, 16), OWN);
        /// Angle between midrib and side veins.
        vein_angle: Option<f64> = "vein_angle_deg" Maybe(deg(48.0, 18.0, 80.0), OWN);
        /// Fold along the midrib.
        fold: Option<f64> = "fold_deg" Maybe(deg(10.0, -68.0, 68.0), OWN);
        /// Droop from base to tip.
        curl: Option<f64> = "curl_deg" Maybe(deg(20.0, -170.0, 170.0), OWN);
        /// Height of the waves of the margin.
        waviness: Option<f64> = "waviness" Maybe(num(0.04, 0.0, 0.3, "of the width"), OWN);
        /// Length of the stalk.
        petiole: Option<f64> = "petiole" Maybe(num(0.02, 0.0, 1.0, "m"), OWN);
        /// Radius of the stalk.
        petiole_radius: Option<f64> = "petiole_radius_mm" Maybe(mm(0.8, 0.1, 10.0), OWN);
        /// Thickness of the stalk over its width: 1 round, 2 flattened as a poplar's.
        petiole_flatness: Option<f64> = "petiole_flatness" Maybe(num(1.0, 0.3, 3.0, ""), OWN);
        /// Blade.
        color: Option<[f32; 3]> = "color" Maybe(Color("#4f7a33"), OWN);
        /// Veins and margin.
        color2: Option<[f32; 3]> = "color2" Maybe(Color("#86a05a"), OWN);
        /// So many blades are made, different in fold, curl and proportions.
        variants: u32 = "variants" whole(4, 1, 32);
        /// How finely a blade is cut.
        detail: Detail = "detail" OneOf(Detail::Light);
        /// Pixels along a side of the maps.
        side: u32 = "side" whole(512, 16, 4096);
        /// Metres per unit of a mesh of your own.
        mesh_scale: f64 = "mesh_scale" num(1.0, 1e-6, 1e6, "m");
        /// Upward axis of a mesh of your own.
        mesh_up: Up = "mesh_up" OneOf(Up::Y);
        /// Light let through.
        translucency: f64 = "translucency" num(0.35, 0.0, 1.0, "");
        /// 0 mirror to 1 matt.
        roughness: Option<f64> = "roughness" Maybe(num(0.45, 0.0, 1.0, ""), OWN);
        /// Flutter in the wind: 1 for round stalks, 2 to 3 for the flat ones of poplars.
        flutter: f64 = "flutter" num(1.0, 0.0, 10.0, "");
    }
    /// Bark of the thick axes; `[plants.NAME.shoot]` has the same keys for axes below 8 mm radius, and is of kind "shoot".
    BarkKeys at "plants.NAME.bark" {
        /// Character.
        kind: BarkKind = "kind" OneOf(BarkKind::Furrowed);
        /// A coefficient table of the plane whose density tiles the bark, in relief and tint.
        ifs: Option<Reference> = "ifs" File(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" Text("");
        /// Ridges, or the ground colour.
        color: Option<[f32; 3]> = "color" Maybe(Color("#8a7a66"), KIND);
        /// Cracks, or the marks.
        color2: Option<[f32; 3]> = "color2" Maybe(Color("#3a2f26"), KIND);
        /// Size of one repeat of the maps.
        tile: Option<f64> = "tile" Maybe(num(0.5, 0.001, 100.0, "m"), KIND);
        /// From crack to ridge.
        depth: Option<f64> = "depth_mm" Maybe(mm(12.0, 0.0, 100.0), KIND);
        /// Weathered patches, lichen: none to much.
        patches: Option<f64> = "patches" Maybe(num(0.3, 0.0, 1.0, ""), KIND);
        /// Pixels along a side of the maps.
        side: u32 = "side" PowerOfTwo(1024);
    }
    /// How bark becomes a mesh.
    SkinKeys at "plants.NAME.skin" {
        /// Length of edges around an axis.
        edge: f64 = "edge" num(0.04, 1e-5, 10.0, "m");
        /// A new ring after so much bend.
        turn: f64 = "turn_deg" deg(12.0, 0.6, 85.0);
        /// How the maps follow the taper.
        uv: Uv = "uv" OneOf(Uv::Conformal);
        /// Widening at the foot.
        flare: f64 = "flare" num(0.6, 0.0, 2.0, "of the radius");
        /// How far the foot goes on below the ground.
        bury: f64 = "bury" num(0.15, 0.0, 10.0, "m");
    }
    /// Puts plants into the scene.
    PlaceKeys at "place" {
        /// Which plant.
        plant: String = "plant" Text("");
        /// Where; with `count` the middle of the group.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Turn about the vertical; drawn for each copy of a group.
        turn: Option<f64> = "turn_deg" Maybe(deg(0.0, -360.0, 360.0), "0, random in groups");
        /// Size.
        scale: f64 = "scale" num(1.0, 1e-3, 1e3, "");
        /// Random share added to or taken from the size.
        vary: f64 = "vary" num(0.0, 0.0, 0.9, "");
        /// Lean from the vertical.
        lean: f64 = "lean_deg" deg(0.0, 0.0, 90.0);
        /// Where it leans: 0 towards +X, 90 towards -Z.
        lean_to: f64 = "lean_to_deg" deg(0.0, -360.0, 360.0);
        /// Another individual for the same place.
        seed: u64 = "seed" Seed(0);
        /// Number of copies, spread over `radius`.
        count: u32 = "count" whole(1, 1, 100_000);
        /// Copies stand within this distance.
        radius: f64 = "radius" num(10.0, 0.0, 1e5, "m");
        /// Copies keep this distance where they can.
        spacing: f64 = "spacing" num(0.0, 0.0, 1e5, "m");
        /// Copies keep this distance from what the places before this one put up.
        clear: f64 = "clear" num(0.0, 0.0, 1e5, "m");
        /// Copies share so many individuals.
        individuals: Option<u32> = "individuals" Maybe(whole(1, 1, 10_000), "count: each grows its own");
    }
    /// The ground: a disc around the plants.
    GroundKeys at "ground" {
        /// Whether there is one.
        show: bool = "show" Flag(true);
        /// Its diameter.
        size: f64 = "size" num(40.0, 0.2, 2e4, "m");
        /// Height of its waves.
        relief: f64 = "relief" num(0.15, 0.0, 100.0, "m");
        /// Length of its waves.
        wavelength: f64 = "wavelength" num(9.0, 0.01, 1e5, "m");
        /// Soil.
        color: Option<[f32; 3]> = "color" Maybe(Color("#5c4f40"), "brown");
        /// Grass and moss.
        color2: Option<[f32; 3]> = "color2" Maybe(Color("#576a31"), "green");
        /// Share of grass and moss.
        cover: f64 = "cover" num(0.62, 0.0, 1.0, "");
        /// Size of one repeat of the maps; at `size` or more one map covers the whole ground.
        tile: f64 = "tile" num(12.0, 0.01, 1000.0, "m");
        /// Share of the sky's colour in the ground's at the rim, where one map covers it all; softens the horizon.
        haze: f64 = "haze" num(0.8, 0.0, 1.0, "");
        /// Pixels along a side of the maps.
        side: u32 = "side" PowerOfTwo(1024);
    }
    /// The view; fitted to the plants unless `eye` is given.
    CameraKeys at "camera" {
        /// Where it stands.
        eye: Option<[f64; 3]> = "eye" Maybe(point([0.0; 3]), "fitted");
        /// What it looks at.
        target: Option<[f64; 3]> = "target" Maybe(point([0.0; 3]), "middle of the plants");
        /// Vertical field of view.
        vfov: f64 = "vfov_deg" deg(35.0, 1.0, 170.0);
        /// Lean to its right.
        roll: f64 = "roll_deg" deg(0.0, -360.0, 360.0);
        /// Factor on the fitted distance.
        distance: f64 = "distance" num(1.0, 0.01, 100.0, "");
    }
    /// Sunlight.
    SunKeys at "sun" {
        /// Height over the horizon.
        elevation: f64 = "elevation_deg" deg(40.0, -90.0, 90.0);
        /// Turn from +Z towards +X.
        azimuth: f64 = "azimuth_deg" deg(75.0, -360.0, 360.0);
        /// Colour.
        color: [f32; 3] = "color" Color("#fff9ee");
        /// Brightness.
        strength: f64 = "strength" num(3.0, 0.0, 1000.0, "W/m^2");
        /// Angular diameter; softens shadows.
        angle: f64 = "angle_deg" deg(0.53, 0.0, 90.0);
    }
    /// Light from the sky.
    SkyKeys at "sky" {
        /// At the horizon.
        horizon: [f32; 3] = "horizon" Color("#edf3f9");
        /// Overhead.
        zenith: [f32; 3] = "zenith" Color("#89b3e6");
        /// What stands below the horizon, dark as far trees; drops show it upside down. POV-Ray and previews.
        below: Option<[f32; 3]> = "below" Maybe(Color("#1a2417"), "the sky goes on");
        /// How uneven it is all around: masses of shade and gaps of light, as of leaves far out of focus. POV-Ray.
        dapple: f64 = "dapple" num(0.0, 0.0, 1.0, "");
        /// Brightness of the air around the sun, over that of its colour. POV-Ray and previews.
        glow: f64 = "glow" num(0.0, 0.0, 100.0, "");
        /// Factor on both.
        strength: f64 = "strength" num(1.0, 0.0, 1000.0, "");
    }
    /// What is written.
    OutputKeys at "output" with ["pov", "usd", "gltf", "wind"] {
        /// File formats.
        formats: Vec<Format> = "formats" SomeOf(&[Format(&usd::FORMAT), Format(&gltf::FORMAT)]);
    }
    /// POV-Ray files.
    PovKeys at "output.pov" with ["photons"] {
        /// Frames between two written ones.
        step: u32 = "step" whole(1, 1, 1_000_000);
        /// Width and height of the picture.
        size: [f64; 2] = "size" Tuple([800.0, 600.0], num(800.0, 8.0, 16384.0, "pixels"));
        /// Share of the time between two frames for which the shutter is open: how long the streaks of falling water are.
        shutter: f64 = "shutter" num(0.5, 0.0, 1.0, "");
        /// Scene units per metre.
        units: f64 = "units_per_m" num(100.0, 1.0, 1e5, "");
    }
    /// Light that drops gather: photons are shot through them, and a frame takes half as long again to twice as long. The table alone
    /// switches it on.
    PhotonKeys at "output.pov.photons" {
        /// Radius of the smallest drops that gather light; smaller ones are lit as everything else.
        smallest: f64 = "smallest_mm" mm(1.0, 0.2, 10.0);
    }
    /// USD files.
    UsdKeys at "output.usd" {
        /// Upward axis.
        up: Up = "up" OneOf(Up::Y);
        /// How several placements of a plant are shown: by one point instancer, or by a prim each, to edit single copies.
        copies: CopyStyle = "copies" OneOf(CopyStyle::Instancer);
        /// How far leaves that ride on branches may be from where they were simulated, between two frames that are kept; 0 keeps all.
        tolerance: f64 = "tolerance_mm" mm(1.0, 0.0, 100.0);
        /// The same of their rotations.
        turn_tolerance: f64 = "turn_tolerance_deg" deg(0.5, 0.0, 45.0);
    }
    /// glTF files.
    GltfKeys at "output.gltf" {
        /// For which readers.
        profiles: Vec<Profile> = "profiles" SomeOf(&[Profile::Web]);
        /// Only this frame, standing still: any number of things that fly, as instances in the web profile.
        frame: Option<u32> = "frame" Maybe(whole(1, 0, 999_999), "the whole clip, moving");
        /// Most things that fly that a moving file holds, a node and a track each.
        nodes: u32 = "nodes" whole(500, 1, 100_000);
        /// Most plants that sway by a skeleton of their own; those beyond, farthest from the camera, stand still and share meshes.
        skins: u32 = "skins" whole(64, 0, 100_000);
        /// Whether each asset has a file of its own, beside the one of the whole scene.
        assets: bool = "assets" Flag(false);
    }
}
