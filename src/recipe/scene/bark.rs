//! `[plants.NAME.bark]`, `.shoot` and `.skin`: bark and its mesh.

use crate::recipe::syntax::{
    ColorType, FileReference, OneOf, OptionalKey, PowerOfTwo, Reference, StringType, degrees, integer, millimetres,
    number,
};
use crate::recipe::syntax::{choices, keys};

/// Words that listings show in place of a default that the key `kind` decides.
const KIND: &str = "by kind";

/// Radius at the base, m, below which axes have the bark of `[plants.NAME.shoot]`. Own: about the width of a pencil.
pub const SHOOT_RADIUS: f32 = 0.008;

choices! {
    /// Pattern of the procedural bark.
    BarkKind {
        /// Long plates between deep cracks: willow, linden.
        Furrowed = "furrowed",
        /// Ridges that part and join again between deep furrows: oak.
        Ridged = "ridged",
        /// Thick scales: pine.
        Plated = "plated",
        /// Nearly even: beech.
        Smooth = "smooth",
        /// Pale, with dark dashes round the girth: cherry, hazel.
        Lenticel = "lenticel",
        /// White, with fine lenticels and black, diamond-shaped scars: silver birch.
        Scarred = "scarred",
        /// Grey-green, with rows of dark diamonds: poplar, aspen.
        Diamond = "diamond",
        /// Fibrous strips: vine, cedar.
        Stringy = "stringy",
        /// Young green wood, nearly smooth.
        Shoot = "shoot",
        /// Green and waxy with fine fibres: bamboo.
        Culm = "culm",
    }
    /// Geometry that displays the axes of a plant.
    SkinForm {
        /// Tubes with joined branches.
        Loft = "loft",
        /// An instance of a prism or an organ between each two nodes.
        Segments = "segments",
    }
    /// Texture coordinates of bark on tapering axes.
    BarkUv {
        /// Keeps the proportions of the texture: repeats become shorter as the axis becomes thinner.
        Conformal = "conformal",
        /// The same number of metres per repeat everywhere.
        Metric = "metric",
    }
}

keys! {
    /// Bark of thick axes. `[plants.NAME.shoot]` has the same keys for axes below 8 mm radius; its default kind is "shoot".
    BarkKeys at "plants.NAME.bark" also "plants.NAME.shoot" {
        /// Pattern of the bark, which sets the defaults below.
        kind: BarkKind = "kind" OneOf(BarkKind::Furrowed), basic;
        /// Picture that covers the bark instead of a painted pattern; it should repeat without seams. It is `tile` wide, and as high
        /// as its sides demand.
        texture: Option<Reference> = "texture" FileReference(".png, .jpg, .jpeg");
        /// With `texture`: normal map of the same bark, green up the stem (OpenGL).
        normal_texture: Option<Reference> = "normal_texture" FileReference(".png, .jpg, .jpeg");
        /// Coefficient table (2D) whose density is tiled as relief and tint.
        ifs: Option<Reference> = "ifs" FileReference(".ifs, .flame, .ifs.toml");
        /// System of the table; empty selects the first.
        system: String = "system" StringType("");
        /// Colour of ridges, or base colour.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#8a7a66"), KIND), basic;
        /// Colour of cracks or marks.
        color2: Option<[f32; 3]> = "color2" OptionalKey(ColorType("#3a2f26"), KIND);
        /// Size of one repeat of the textures.
        tile: Option<f64> = "tile" OptionalKey(number(0.5, 0.001, 100.0, "m"), KIND);
        /// Height from crack to ridge.
        depth: Option<f64> = "depth_mm" OptionalKey(millimetres(12.0, 0.0, 100.0), KIND), basic;
        /// Amount of weathered patches and lichen.
        patches: Option<f64> = "patches" OptionalKey(number(0.3, 0.0, 1.0, ""), KIND);
        /// Side length of the textures in pixels.
        side: u32 = "side" PowerOfTwo(1024);
    }
    /// Meshing of axes (loft).
    SkinKeys at "plants.NAME.skin" {
        /// How axes are shown: a closed skin ("loft"), or one prism or organ per segment ("segments").
        form: SkinForm = "form" OneOf(SkinForm::Loft);
        /// With form = "segments": letter of the organ that replaces the prisms.
        segment: String = "segment" StringType("");
        /// Edge length around an axis.
        edge: f64 = "edge" number(0.04, 1e-5, 10.0, "m");
        /// Fewest sides of a tube, which twigs have: 3 makes files of growth clips and of trees with many twigs smaller.
        sides: u32 = "sides" integer(5, 3, 32);
        /// Axes thinner at their base than this radius are cones of three sides, so that files of growth clips are smaller.
        cones: Option<f64> = "cones_below_mm" OptionalKey(millimetres(0.0, 0.0, 1000.0), "12 where a species grows over the clip, else 0");
        /// Bending angle after which a new ring is inserted.
        turn: f64 = "turn_deg" degrees(12.0, 0.6, 85.0);
        /// Texture coordinates: scaled with the circumference ("conformal") or of constant size ("metric").
        uv: BarkUv = "uv" OneOf(BarkUv::Conformal);
        /// Root flare: widening of the trunk at its base; a species has its own.
        flare: f64 = "flare" number(0.6, 0.0, 2.0, "of the radius");
        /// Height over which the root flare falls to 1/e; a species has its own.
        flare_height: f64 = "flare_height" number(3.0, 0.2, 10.0, "radii of the base");
        /// Roots that show as ridges of the flare; below 2 it is round. A species has its own.
        buttresses: u32 = "buttresses" integer(0, 0, 8);
        /// Depth to which the trunk continues below the ground.
        bury: f64 = "bury" number(0.15, 0.0, 10.0, "m");
    }
}
