//! The curves of a model: a number stands for each, and tables hold what they are.

use std::sync::Arc;

use osier_base::convert::saturating_index;

use super::expression::FIRST_CURVE;
use crate::functions::{DataFunction, FunctionTables, Spline, SplineEnds};
use crate::token::SourcePlace;

/// Most curves of a model; their numbers must be exact in single precision, 2^24.
pub(super) const MAX_CURVES: usize = 4_096;
/// Most points of all curves together: about a second for measuring them.
pub(super) const MAX_ALL_POINTS: usize = 65_536;

/// How a curve goes through or along its points.
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

/// The curves of a model by their numbers.
#[derive(Debug, Default)]
pub(super) struct Curves {
    list: Vec<Curve>,
    tables: Arc<FunctionTables>,
    /// Places of calls of functions that a variable holds.
    pub call_places: Vec<SourcePlace>,
}

impl Curves {
    /// The tables with all curves so far.
    pub fn tables(&self) -> Arc<FunctionTables> {
        Arc::clone(&self.tables)
    }

    /// The number that stands for a curve, which is added unless it is known; `None` beyond [`MAX_CURVES`] and [`MAX_ALL_POINTS`].
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

    /// True if the number stands for a curve in a plane, which may be called as a function.
    pub fn is_function(&self, id: f64) -> bool {
        self.tables.value(id, 0.0).is_some()
    }
}
