//! Rain: drops that fall, strike leaves and wood, lie, run, hang and drip, and the maps of water that they leave.
//!
//! A [`Storm`] lets it rain on [`Leaf`]s that hang on [`Bearer`]s, so that stiff plants and springy ones are rained on
//! alike; a [`Moment`] is what a frame shows of it, [`Wetness`] makes maps of that and [`Water`] meshes.
//! Source: [yang-wu], sections 3 and 4; docs/rain.md says what is ours.

mod bearer;
mod body;
mod cap;
mod collide;
mod cover;
mod dew;
mod drop;
mod event;
mod grooves;
mod impact;
mod leaf;
mod line;
mod manner;
mod maps;
mod merge;
mod moment;
mod pendant;
mod reach;
mod sheet;
mod shower;
mod storm;

pub use bearer::{Bearer, Blade, Bough, Stiff};
pub use body::Water;
pub use cap::{Cap, Print, Shape, Wetting};
pub use collide::Target;
pub use cover::Cover;
pub use drop::Bead;
pub use event::Event;
pub use grooves::Grooves;
pub use leaf::{Leaf, Stamp, Tally};
pub use manner::{Friction, Impact, Lever, Manner, Merge, capillary};
pub use maps::{Blob, Chart, Soak, Touched, Wetness};
pub use moment::{Hanging, InAir, Lying, Moment};
pub use pendant::Shapes;
pub use sheet::Sheet;
pub use shower::{Envelope, Rainfall, Shower, Size, across, ball};
pub use storm::{Floor, Hung, Ledger, Parts, Storm};
