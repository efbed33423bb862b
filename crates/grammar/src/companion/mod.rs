//! Companion files of a grammar: colours, views, functions, contours, surfaces.
//!
//! Nothing here opens files: functions take bytes or text and return structs and diagnostics. Damage in a file is reported
//! as L048, and the readable part is used.
//!
//! ```
//! use osier_grammar::companion::ColorTable;
//!
//! let bytes: Vec<u8> = (0..=255).flat_map(|i| [i, 0, 0]).collect();
//! let colors = ColorTable::from_map(&bytes).expect("256 colours");
//! assert_eq!(colors.get(255).base, [1.0, 0.0, 0.0]);
//! assert!(ColorTable::from_map(&[1, 2]).is_err());
//! ```

mod colors;
mod condition;
mod contour;
mod function;
mod surface;
mod view;
mod words;

pub use colors::{ColorTable, SurfaceColor};
pub use contour::{ContourFile, read_contours};
pub use function::{FunctionFile, read_functions};
pub use surface::{SurfaceFile, SurfacePatch, SurfaceTriangle, read_ray, read_surface};
pub use view::{FileLine, LineStyle, SurfaceLine, View, ViewInclude, ViewTropism, read_view};
