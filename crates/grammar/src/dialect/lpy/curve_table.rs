//! The curves of a model, each represented by a number, and the tables that hold them.

use std::sync::Arc;

use osier_base::convert::saturating_index;

use super::expression::FIRST_CURVE;
use crate::functions::{DataFunction, FunctionTables, Spline, SplineEnds};
use crate::token::SourcePlace;

/// Limit on the curves of a model: their numbers must be exact in single precision, up to 2^24.
pub(super) const MAX_CURVES: usize = 4_096;
/// Limit on the points of all curves together, whose lengths take about a second to measure.
pub(super) const MAX_ALL_POINTS: usize = 65_536;

/// How a curve interpolates or approximates its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CurveKind {
    BSpline,
    Bezier,
    Lines,
}

/// A curve of a model.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curve {
    pub kind: CurveKind,
    pub is_flat: bool,
    pub points: Vec<[f64; 3]>,
}

/// The curves of a model by number.
#[derive(Debug, Default)]
pub(super) struct Curves {
    list: Vec<Curve>,
    tables: Arc<FunctionTables>,
    /// Source places of calls of functions that are held by variables.
    pub call_places: Vec<SourcePlace>,
}

impl Curves {
    /// Tables of all curves so far.
    pub fn tables(&self) -> Arc<FunctionTables> {
        Arc::clone(&self.tables)
    }

    /// The number of a curve, which is added if it is new; `None` beyond [`MAX_CURVES`] or [`MAX_ALL_POINTS`].
    pub fn number(&mut self, curve: Curve) -> Option<f64> {
        let at = self.list.iter().position(|known| *known == curve).unwrap_or(self.list.len());
        let id = FIRST_CURVE + f64::from(saturating_index(at));
        if at < self.list.len() {
            return Some(id);
        }
        let points: usize = self.list.iter().map(|known| known.points.len()).sum();
        if at >= MAX_CURVES || points + curve.points.len() > MAX_ALL_POINTS {
            return None;
        }
        let spline = match curve.kind {
            CurveKind::BSpline => Spline::new(&curve.points, SplineEnds::Clamped),
            CurveKind::Bezier => Spline::bezier(&curve.points),
            CurveKind::Lines => Spline::polyline(&curve.points),
        };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below 2^24")]
        let key = id as u32;
        let tables = Arc::make_mut(&mut self.tables);
        if curve.is_flat {
            tables.add_function(key, "", DataFunction::of_graph(spline.clone()));
        }
        tables.add_curve(key, spline);
        self.list.push(curve);
        Some(id)
    }

    /// True if the number represents a plane curve, which may be called as a function.
    pub fn is_function(&self, id: f64) -> bool {
        self.tables.value(id, 0.0).is_some()
    }
}
