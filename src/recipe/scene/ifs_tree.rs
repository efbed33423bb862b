//! `[plants.NAME.tree]`: how a coefficient table grows a tree.

use crate::recipe::syntax::{BooleanType, OneOf, OptionalKey, StringType, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Rule for the radii of a tree's stems.
    BranchRadii {
        /// Factor of each map, as the table gives it.
        Maps = "maps",
        /// Pipe model: the power sum of the radii above a fork equals that below it.
        Pipe = "pipe",
    }
}

keys! {
    /// Growth of a tree from a coefficient table (`ifs` of the plant).
    IfsTreeKeys at "plants.NAME.tree" {
        /// System of the table; empty selects the first.
        system: String = "system" StringType("");
        /// Height of the tree.
        height: f64 = "height" number(6.0, 0.01, 1000.0, "m"), basic;
        /// Branches shorter than this fraction of the trunk become leaf sites.
        eps: f64 = "eps" number(0.09, 1e-4, 1.0, "");
        /// Largest number of branchings between ground and tip.
        max_depth: u32 = "max_depth" integer(65_535, 0, 65_535);
        /// Highest branching order.
        max_order: u32 = "max_order" integer(65_535, 0, 65_535);
        /// Variation between individuals; 0 makes them equal.
        variation: f64 = "variation" number(1.0, 0.0, 2.0, "");
        /// Radius of the trunk at its base.
        radius: Option<f64> = "radius" OptionalKey(number(0.05, 1e-4, 100.0, "m"), "that of the table");
        /// Source of the radii: the maps of the table ("maps") or the pipe model ("pipe").
        radii: BranchRadii = "radii" OneOf(BranchRadii::Maps);
        /// Fraction of leaf sites with leaves.
        leaf_density: f64 = "leaf_density" number(1.0, 0.0, 1.0, ""), basic;
        /// Number of leaves per site.
        leaves: u32 = "leaves" integer(3, 1, 100);
        /// Level of detail: branches shorter than 2^lod eps become billboards; 0 grows all branches.
        lod: u32 = "lod" integer(0, 0, 6);
        /// Whether branch ends below four times `eps` are instances of a few twigs, which reduces file size.
        twigs: bool = "twigs" BooleanType(false);
    }
}
