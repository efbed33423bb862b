//! Keys of catkins in flight and of what stands in their way.

use super::key::{keys, words};
use super::kinds::{Color, File, Flag, Maybe, Numbers, OneOf, Reference, Text, Tuple, deg, num, point, whole};

words! {
    /// Where catkins start.
    Release {
        /// All over the sky, all at once.
        Sky = "sky",
        /// All over the sky, one after another.
        Rain = "rain",
        /// From the twigs of plants, torn off by gusts.
        Canopy = "canopy",
        /// At places of a file.
        Points = "points",
    }
    /// What becomes of one that leaves the box of air.
    Sides {
        /// It is gone.
        Exit = "exit",
        /// It comes back where the wind enters.
        Recycle = "recycle",
        /// It comes in at the other side.
        Periodic = "periodic",
    }
    /// Sets of defaults.
    FlightPreset {
        /// With masses, lag, glide and turning clusters.
        Full = "full",
        /// As the paper by Wang and others has it: carried by the wind and falling.
        Paper = "paper",
    }
    /// What a map of deposits counts.
    MapOf {
        /// Catkins.
        Count = "count",
        /// Their mass, mg.
        Mass = "mass",
    }
    /// Forms of solids.
    Shape {
        /// A box: a wall, a block.
        Block = "block",
        /// A house with a gable roof.
        House = "house",
        /// A closed mesh of a file.
        Mesh = "mesh",
    }
}

keys! {
    /// Catkins that fly: how many, where from, how they move, stick, and come to rest. What they look like stands in
    /// `[catkin]`, the wind in `[wind]`.
    FlightKeys at "flight" {
        /// How many.
        count: u32 = "count" whole(1000, 1, 100_000_000);
        /// Where defaults come from.
        preset: FlightPreset = "preset" OneOf(FlightPreset::Full);
        /// Where they start.
        release: Release = "release" OneOf(Release::Sky);
        /// With "rain": they start within so much time.
        duration: f64 = "duration" num(10.0, 0.0, 86_400.0, "s");
        /// With "sky" and "rain": part of the height that they start in.
        band: [f64; 2] = "band" Tuple([0.3, 0.95], num(0.0, 0.0, 1.0, ""));
        /// With "canopy": plants with their weights, as in { poplar = 1 }; without it all plants.
        canopy: Vec<(String, f64)> = "canopy" Numbers;
        /// With "points": a text file with x, y, z in metres on each line.
        points: Option<Reference> = "points" File(".csv, .txt");
        /// They have been flying for so long at the first frame.
        preroll: f64 = "preroll" num(0.0, 0.0, 3600.0, "s");
        /// Box of air around the origin: width, height, depth. A lattice wind brings its own.
        size: [f64; 3] = "size" Tuple([35.0, 35.0, 35.0], num(35.0, 0.5, 1e4, "m"));
        /// What becomes of those that leave it.
        sides: Option<Sides> = "sides" Maybe(OneOf(Sides::Recycle), "recycle from the sky, exit else");
        /// Smallest and largest factor on a catkin's size.
        scale: [f64; 2] = "scale" Tuple([0.8, 1.2], num(1.0, 0.05, 20.0, ""));
        /// Weights of the catkins' forms (v0 sleek to v4 fluffy and bent); without it all alike.
        forms: Vec<(String, f64)> = "forms" Numbers;
        /// Mass of one.
        mass: f64 = "mass_mg" num(1.0, 0.001, 1000.0, "mg");
        /// Settling speed.
        fall: f64 = "fall_speed" num(0.24, 0.02, 3.0, "m/s");
        /// Its spread: standard deviation over the mean.
        fall_spread: f64 = "fall_spread" num(0.125, 0.0, 0.4, "");
        /// How far tilted ones glide.
        glide: f64 = "glide" num(0.5, 0.0, 1.0, "");
        /// Whether they lag behind changes of the wind.
        inertia: bool = "inertia" Flag(true);
        /// How much they tumble.
        flutter: f64 = "flutter" num(1.0, 0.0, 3.0, "");
        /// Reach of hairs and charge: those that come so near stick together; 0 for their own radius.
        stick_radius: f64 = "stick_radius" num(0.2, 0.0, 1.0, "m");
        /// Chance that they do.
        stick_probability: f64 = "stick_probability" num(1.0, 0.0, 1.0, "");
        /// How close they draw then, as a share of both radii.
        stick_close: f64 = "stick_close" num(0.8, 0.2, 1.0, "");
        /// Steps between two looks for contacts.
        check_every: u32 = "check_every" whole(4, 1, 64);
        /// Whether clusters turn in the air.
        cluster_rotation: bool = "cluster_rotation" Flag(true);
        /// Clusters of n sink n^beta times as fast.
        beta: f64 = "cluster_fall_power" num(0.0, 0.0, 0.5, "");
        /// How fast the attraction of heaps fades with distance; 4.605 ends it at 1 m.
        gamma: f64 = "gamma" num(4.605, 0.1, 1e4, "1/m^2");
        /// Steps a frame.
        substeps: u32 = "substeps" whole(1, 1, 16);
        /// How wet the ground is: 0 lets go at once, 1 never.
        humidity: f64 = "humidity" num(0.3, 0.0, 1.0, "");
        /// A picture of it over the box of air, its top at -z, white wet; instead of `humidity`.
        humidity_map: Option<Reference> = "humidity_map" File(".png, .jpg");
        /// Wind at 0.1 m that takes a dry one up again.
        lift_speed: f64 = "lift_speed" num(0.25, 0.01, 20.0, "m/s");
        /// How much wet ground adds to it.
        lift_wet: f64 = "lift_wet" num(3.0, 0.0, 100.0, "");
        /// With "canopy": chance a second that one lets go where the air is twice as fast as `release_speed`.
        release_rate: f64 = "release_rate" num(0.2, 0.0, 100.0, "1/s");
        /// With "canopy": no slower air tears any off.
        release_speed: f64 = "release_speed" num(0.6, 0.01, 60.0, "m/s");
        /// Each draws a line behind it, of the places it was in for so long: curves in USD; 0 for none.
        trails: f64 = "trails" num(0.0, 0.0, 600.0, "s");
        /// How thick that line is at the catkin; it tapers to nothing.
        trail_width: f64 = "trail_width" num(0.01, 1e-4, 1.0, "m");
        /// Resting ones are shown lowered until their lowest hair touches.
        settle: bool = "settle" Flag(true);
        /// Side of a texel of the maps of what came to rest.
        map_texel: f64 = "map_texel" num(0.25, 0.01, 10.0, "m");
        /// Frames between two maps; without it only the last frame's are written.
        map_every: Option<u32> = "map_every" Maybe(whole(24, 1, 1_000_000), "the last frame only");
        /// What the maps count.
        map_of: MapOf = "map_of" OneOf(MapOf::Count);
        /// Radius over which each catkin is spread in the maps; the sum stays.
        map_blur: f64 = "map_blur" num(0.0, 0.0, 10.0, "m");
    }
    /// Something in the way of wind and catkins.
    SolidKeys at "solid" {
        /// Its name; names its maps.
        name: String = "name" Text("");
        /// Form.
        shape: Shape = "shape" OneOf(Shape::Block);
        /// Middle of its foot.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Width (along X before it is turned), height (of the eaves), depth.
        size: [f64; 3] = "size" Tuple([0.3, 3.0, 10.0], num(1.0, 0.01, 1e4, "m"));
        /// Turned about the vertical, counter-clockwise seen from above.
        turn: f64 = "turn_deg" deg(0.0, -360.0, 360.0);
        /// With "house": height of the ridge over the eaves.
        roof: f64 = "roof" num(2.5, 0.1, 1e3, "m");
        /// With "mesh": the file.
        mesh: Option<Reference> = "mesh" File(".obj, .glb, .gltf");
        /// With "mesh": metres per unit of the file.
        mesh_scale: f64 = "mesh_scale" num(1.0, 1e-6, 1e6, "m");
        /// How wet its steep faces are: 0 lets slide down at once, 1 holds for ever.
        humidity: f64 = "humidity" num(0.5, 0.0, 1.0, "");
        /// Its walls.
        color: Option<[f32; 3]> = "color" Maybe(Color("#b9aa93"), "plaster");
        /// With "house": its roof.
        roof_color: Option<[f32; 3]> = "roof_color" Maybe(Color("#7d4433"), "tiles");
        /// Whether it is seen.
        show: bool = "show" Flag(true);
    }
}
