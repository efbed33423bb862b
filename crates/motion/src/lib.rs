//! Motion of plants, of catkins that leave them and of rain on them, over the frames of a clip.
//!
//! - [`sway`]: branches in the wind as tapered cantilever beams, one oscillator for each bend; applied to the joints of a
//!   skeleton or to every point.
//! - [`rods`]: poles, twigs and stalks as elastic rods of prism springs, solved implicitly; also whole plants on rods.
//! - [`growth`]: plants that lengthen, thicken and unfold their leaves over a clip.
//! - [`flight`]: catkins carried by the wind, which stick together, deposit and take off again.
//! - [`rain`]: drops that fall on leaves, run, hang and drip.
//! - [`sway_in_rain`]: plants of the sway model that raindrops strike, load and shake.

pub mod flight;
pub mod growth;
mod lanes;
pub mod posed_skin;
pub mod rain;
#[allow(clippy::needless_range_loop, reason = "indices over corners and columns, as in the formulas")]
pub mod rods;
pub mod sway;
pub mod sway_in_rain;
