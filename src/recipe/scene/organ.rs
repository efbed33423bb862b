//! `[plants.NAME.leaf]` and `[plants.NAME.organs.LETTER]`: leaves and other organs.

use super::UpAxis;
use crate::recipe::syntax::{
    BooleanType, ColorList, ColorType, FileReference, NumberArray, NumberList, OneOf, OptionalKey, Reference,
    StringType, degrees, integer, millimetres, number,
};
use crate::recipe::syntax::{choices, keys};
use osier_plants::season::FallOrder;

/// Words that listings show in place of a default that the key `blade` decides.
const OWN: &str = "by outline";

choices! {
    /// Outline of a parametric leaf blade, which also sets the defaults of the blade's other keys.
    BladeOutline {
        /// Widest beyond the middle, with rounded lobes, as an oak's.
        Lobed = "lobed",
        /// Widest below the middle, doubly toothed, as a birch's.
        Toothed = "toothed",
        /// Triangular with a drawn-out tip and fine teeth, as a poplar's.
        Deltoid = "deltoid",
        /// Widest in the middle, without teeth, as a beech's.
        Elliptic = "elliptic",
        /// Lobes from the base like fingers, as a maple's.
        Palmate = "palmate",
        /// Widest near its rounded tip, as the petals of a flower; `depth` notches the tip.
        Petal = "petal",
        /// A piece of a conifer's shoot with its needles all round.
        Needles = "needles",
    }
    /// Resolution of blade meshes.
    BladeDetail {
        /// For plants seen whole: 40 to 90 points.
        Light = "light",
        /// For crowns of many thousand leaves: 20 to 50 points.
        Crown = "crown",
        /// For trees in the distance: 9 points, without veins and petiole.
        Distant = "distant",
        /// For plants near the camera: every tooth, 100 to 250 points.
        Hero = "hero",
        /// For pictures of a few leaves: a smooth margin, thousands of points, a map of its relief.
        Close = "close",
    }
}

keys! {
    /// Appearance of an organ; LETTER is the letter after '~' in the grammar. `[plants.NAME.leaf]` is a short form of the
    /// organ "l".
    OrganKeys at "plants.NAME.organs.LETTER" also "plants.NAME.leaf" {
        /// Outline of a parametric blade.
        blade: BladeOutline = "blade" OneOf(BladeOutline::Elliptic), basic;
        /// Mesh file instead of a parametric blade: base of the petiole at the origin, midrib along +Y, upper side towards
        /// +Z.
        mesh: Option<Reference> = "mesh" FileReference(".obj, .glb, .gltf");
        /// Surface of Bezier patches or triangles, as of cpfg, instead of a parametric blade.
        surface: Option<Reference> = "surface" FileReference(".s, .ray");
        /// Coefficient table whose attractor is the leaf, instead of a parametric blade.
        ifs: Option<Reference> = "ifs" FileReference(".ifs, .flame, .ifs.toml");
        /// System of the table; empty selects the first.
        system: String = "system" StringType("");
        /// With `ifs`: point where the petiole meets the blade, in table units.
        anchor: Option<[f64; 2]> = "anchor" OptionalKey(NumberArray([0.0, 0.0], number(0.0, -1e12, 1e12, "")), "computed");
        /// With `ifs`: width of gaps that are closed, in pixels of a mask of 1024 pixels.
        close: f64 = "close_px" number(2.0, 0.0, 8.0, "pixels");
        /// With `ifs`: largest hole that is filled, as a fraction of the mask.
        fill: f64 = "fill" number(0.005, 0.0, 1.0, "");
        /// With `ifs`: whether holes are cut into the mesh.
        holes: bool = "holes" BooleanType(false);
        /// Length of the blade; multiplied by the size factor of the turtle.
        size: Option<f64> = "size" OptionalKey(number(0.08, 1e-3, 2.0, "m"), OWN), basic;
        /// Width divided by length.
        width: Option<f64> = "width" OptionalKey(number(0.6, 0.02, 3.0, ""), OWN);
        /// Number of lobes or teeth on each side.
        lobes: Option<u32> = "lobes" OptionalKey(integer(5, 0, 60), OWN);
        /// Depth of lobes or teeth.
        depth: Option<f64> = "depth" OptionalKey(number(0.35, 0.0, 0.9, "of the half width"), OWN);
        /// Leaflets of a compound leaf along its stalk, each with the outline of the blade; 1 is a simple leaf.
        leaflets: u32 = "leaflets" integer(1, 1, 41);
        /// Length of a leaflet as a share of the whole leaf's.
        leaflet_length: f64 = "leaflet_length" number(0.35, 0.02, 1.0, "of the leaf");
        /// With blade "needles": number of needles of a piece of shoot and its twigs.
        needles: Option<u32> = "needles" OptionalKey(integer(180, 2, 4000), OWN);
        /// With blade "needles": side twigs of a piece of shoot, to the left and right.
        twigs: u32 = "twigs" integer(0, 0, 24);
        /// With blade "needles": length of the longest side twig.
        twig_length: f64 = "twig_length" number(0.6, 0.05, 2.0, "of the piece");
        /// With blade "needles": angle between the shoot and its side twigs.
        twig_angle: f64 = "twig_angle_deg" degrees(50.0, 5.0, 120.0);
        /// Number of smaller teeth after each large one.
        minor_teeth: Option<u32> = "minor_teeth" OptionalKey(integer(0, 0, 4), OWN);
        /// Number of secondary veins on each side; lobed blades have one per lobe.
        veins: Option<u32> = "veins" OptionalKey(integer(6, 1, 16), OWN);
        /// Angle between midrib and secondary veins; of needles, between shoot and needle.
        vein_angle: Option<f64> = "vein_angle_deg" OptionalKey(degrees(48.0, 18.0, 80.0), OWN);
        /// Fold angle along the midrib.
        fold: Option<f64> = "fold_deg" OptionalKey(degrees(10.0, -68.0, 68.0), OWN);
        /// Downward curl from base to tip.
        curl: Option<f64> = "curl_deg" OptionalKey(degrees(20.0, -170.0, 170.0), OWN);
        /// Amplitude of the waves of the margin.
        waviness: Option<f64> = "waviness" OptionalKey(number(0.04, 0.0, 0.3, "of the width"), OWN);
        /// Length of the petiole.
        petiole: Option<f64> = "petiole" OptionalKey(number(0.02, 0.0, 1.0, "m"), OWN);
        /// Radius of the petiole.
        petiole_radius: Option<f64> = "petiole_radius_mm" OptionalKey(millimetres(0.8, 0.1, 10.0), OWN);
        /// Thickness of the petiole normal to the blade, divided by its width: 1 is round, 2 is flattened laterally as in
        /// poplars.
        petiole_flatness: Option<f64> = "petiole_flatness" OptionalKey(number(1.0, 0.3, 3.0, ""), OWN);
        /// Colour of the blade.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#4f7a33"), OWN), basic;
        /// Colour of veins and margin.
        color2: Option<[f32; 3]> = "color2" OptionalKey(ColorType("#86a05a"), OWN), basic;
        /// Number of different meshes, which vary in fold, curl and proportions.
        variants: u32 = "variants" integer(4, 1, 32);
        /// Resolution of the mesh: "crown" for trees with many thousand leaves, "distant" for trees in the distance, "light",
        /// "hero" for close-ups, "close" with a relief map.
        detail: BladeDetail = "detail" OneOf(BladeDetail::Light);
        /// Side length of the textures in pixels.
        side: u32 = "side" integer(512, 16, 4096);
        /// With `mesh`: metres per unit of the file.
        mesh_scale: f64 = "mesh_scale" number(1.0, 1e-6, 1e6, "m");
        /// With `mesh`: up axis of the file.
        mesh_up: UpAxis = "mesh_up" OneOf(UpAxis::Y);
        /// Fraction of light that is transmitted.
        translucency: f64 = "translucency" number(0.35, 0.0, 1.0, ""), basic;
        /// Roughness: 0 is a mirror, 1 is matt.
        roughness: Option<f64> = "roughness" OptionalKey(number(0.45, 0.0, 1.0, ""), OWN);
        /// With `season`: whether the leaves stay on the plant and green.
        evergreen: Option<bool> = "evergreen" OptionalKey(BooleanType(false), "true for needles");
        /// With `season`: colours of autumn, from those of leaves in the sun to those of leaves in the shade; at most 12.
        autumn: Vec<[f32; 3]> = "autumn" ColorList;
        /// How frequent each colour of `autumn` is beside the others; those without a number have 1.
        autumn_weights: Vec<f64> = "autumn_weights" NumberList(number(1.0, 0.0, 1000.0, ""));
        /// With `season`: colour of the first leaves of spring.
        spring: Option<[f32; 3]> = "spring" OptionalKey(ColorType("#9fb04c"), "lighter than `color`");
        /// With `season`: which leaves of a shoot fall first.
        falls: Option<FallOrder> = "falls" OptionalKey(OneOf(FallOrder::Tips), OWN);
        /// With `season`: fraction of the leaves that stay on the plant, dry, through the winter.
        keeps: f64 = "keeps" number(0.0, 0.0, 1.0, "");
        /// With `season`: length of the buds where leaves are missing; 0 shows none.
        bud: Option<f64> = "bud_mm" OptionalKey(millimetres(6.0, 0.0, 50.0), OWN);
        /// Factor on leaf flutter: 1 for round petioles, 2 to 3 for the flat petioles of poplars.
        flutter: f64 = "flutter" number(1.0, 0.0, 10.0, ""), basic;
    }
}
