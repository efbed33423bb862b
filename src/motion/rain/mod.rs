//! Rain: drops that fall, strike leaves and wood, lie, run, hang and drip, and the maps of water that they leave.
//!
//! What leaves hang on is behind [`Bearer`], so that stiff plants and springy ones are rained on alike.
//! Source: [yang-wu], sections 3 and 4; docs/rain.md says what is ours.

mod bearer;
mod body;
mod cap;
mod collide;
mod dew;
mod drop;
mod impact;
mod leaf;
mod manner;
mod maps;
mod moment;
mod pendant;
mod sheet;
mod storm;
mod shower;

pub use bearer::{Bearer, Blade, Bough, Stiff};
