//! `[plants.NAME.tree]`: how a coefficient table grows a tree.

use crate::recipe::syntax::{BooleanType, OneOf, OptionalKey, StringType, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Where the radii of a tree come from.
    BranchRadii {
        /// The maps' own factors.
        Maps = "maps",
        /// What goes into a fork comes out of it.
        Pipe = "pipe",
    }
}

keys! {
    /// How a coefficient table grows a tree (`ifs` of its plant).
    IfsTreeKeys at "plants.NAME.tree" {
        /// Which system of the table; the first without a name.
        system: String = "system" StringType("");
        /// Height.
        height: f64 = "height" number(6.0, 0.01, 1000.0, "m");
        /// Branches shorter than this share of the trunk become leaf sites.
        eps: f64 = "eps" number(0.09, 1e-4, 1.0, "");
        /// Most branchings between the ground and a tip.
        max_depth: u32 = "max_depth" integer(65_535, 0, 65_535);
        /// Highest order of branches.
        max_order: u32 = "max_order" integer(65_535, 0, 65_535);
        /// How much individuals differ: 0 not at all.
        variation: f64 = "variation" number(1.0, 0.0, 2.0, "");
        /// Radius of the trunk at its foot.
        radius: Option<f64> = "radius" OptionalKey(number(0.05, 1e-4, 100.0, "m"), "the table's");
        /// Where radii come from.
        radii: BranchRadii = "radii" OneOf(BranchRadii::Maps);
        /// Share of the leaf sites that bear leaves.
        leaf_density: f64 = "leaf_density" number(1.0, 0.0, 1.0, "");
        /// Leaves at a site.
        leaves: u32 = "leaves" integer(3, 1, 100);
        /// Level of detail: branches shorter than 2^lod eps are pictures on crossed quads. 0: all of them grow.
        lod: u32 = "lod" integer(0, 0, 6);
        /// Ends of branches, below four times `eps`, are copies of a few twigs: large trees in small files.
        twigs: bool = "twigs" BooleanType(false);
    }
}
