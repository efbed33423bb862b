//! Data that the functions `func`, `curveX`, `curveY`, `curveZ` and `curveGAL` of a grammar read: functions of one variable and
//! space curves, both cubic B-splines.
//!
//! Fill a [`FunctionTables`] from the companion files of a grammar (`.func`, `.fset`, `.con`) and pass it in
//! [`crate::GrammarSource::functions`] before the grammar is parsed: names of functions become macros of the grammar. The
//! compiler stores the tables with the code that reads them, so that the derivation needs no further argument.

use std::collections::BTreeMap;

/// Chords per span that approximate a spline to measure its length; the error falls with the square of this number.
const CHORDS_PER_SPAN: usize = 256;
/// Bisections of the interval in which the parameter of a function is searched: 2^-40 of the domain lies below 1e-9.
const HALVINGS: usize = 40;

/// Where a spline begins and ends with respect to its first and last point.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum SplineEnds {
    /// Begins at the first point and ends at the last.
    #[default]
    Clamped,
    /// Uniform knots: stays inside the outer points unless they are repeated.
    Open,
    /// Uniform knots, closed: the last point is followed by the first.
    Closed,
}

/// A uniform cubic B-spline in space. Source: de Boor's recursion over the control points of the span.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Spline {
    /// Control points; one of multiplicity n occurs n times, and a closed spline repeats its first points at the end.
    points: Vec<[f64; 3]>,
    knots: Vec<f64>,
    degree: usize,
}

impl Spline {
    /// A spline over `points`, in which points of higher multiplicity are repeated. Fewer than four points give a lower
    /// degree; without points the spline is the origin.
    pub fn new(points: &[[f64; 3]], ends: SplineEnds) -> Self {
        let mut points = points.to_vec();
        if ends == SplineEnds::Closed {
            let n = points.len().max(1);
            let first: Vec<[f64; 3]> = (0..3).filter_map(|i| points.get(i % n).copied()).collect();
            points.extend(first);
        }
        let degree = points.len().saturating_sub(1).min(3);
        Self::of_degree(points, degree, ends)
    }

    /// The Bézier curve of its control points, whose degree is one less than their number.
    pub fn bezier(points: &[[f64; 3]]) -> Self {
        Self::of_degree(points.to_vec(), points.len().saturating_sub(1), SplineEnds::Clamped)
    }

    /// Straight lines from point to point, each over an equal share of the parameter.
    pub fn polyline(points: &[[f64; 3]]) -> Self {
        Self::of_degree(points.to_vec(), points.len().saturating_sub(1).min(1), SplineEnds::Clamped)
    }

    /// A spline with uniform knots, which are clamped at both ends or continue beyond them.
    fn of_degree(points: Vec<[f64; 3]>, degree: usize, ends: SplineEnds) -> Self {
        let count = points.len() + degree + 1;
        let last = points.len().saturating_sub(degree) as f64;
        // Uniform knots, whose domain begins at 0; clamped ones stop at the ends of the domain.
        let knot = |i: usize| {
            let k = i as f64 - degree as f64;
            if ends == SplineEnds::Clamped { k.clamp(0.0, last) } else { k }
        };
        Self { knots: (0..count).map(knot).collect(), points, degree }
    }

    /// Number of polynomial pieces, lines of a polyline.
    pub fn pieces(&self) -> usize {
        self.spans()
    }

    /// The curve with each control point replaced by its image under `of`.
    pub fn with_points(&self, of: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        Self { points: self.points.iter().map(|p| of(*p)).collect(), ..self.clone() }
    }

    /// Number of polynomial pieces.
    fn spans(&self) -> usize {
        self.points.len().saturating_sub(self.degree)
    }

    /// The point at `t`, 0 to 1 over the whole spline; other values are clamped, NaN counts as 0.
    pub fn at(&self, t: f64) -> [f64; 3] {
        let t = if t > 0.0 { t.min(1.0) } else { 0.0 };
        let u = t * self.spans() as f64;
        // The last span whose start is not beyond u; the end of the domain belongs to the last span.
        let starts = self.knots.get(self.degree..self.degree + self.spans()).unwrap_or(&[]);
        let Some(k) = starts.partition_point(|start| *start <= u).checked_sub(1) else { return [0.0; 3] };
        let k = k + self.degree;
        let mut d: Vec<[f64; 3]> = self.points.get(k - self.degree..=k).map(<[_]>::to_vec).unwrap_or_default();
        for r in 1..=self.degree {
            for j in (r..=self.degree).rev() {
                let (from, to) = (self.knots[j + k - self.degree], self.knots[j + 1 + k - r]);
                let a = if to > from { (u - from) / (to - from) } else { 0.0 };
                let (before, here) = (d[j - 1], d[j]);
                d[j] = [0, 1, 2].map(|i| (1.0 - a) * before[i] + a * here[i]);
            }
        }
        d.get(self.degree).copied().unwrap_or([0.0; 3])
    }

    /// Length of the curve, approximated by chords.
    pub fn length(&self) -> f64 {
        let n = self.spans().saturating_mul(CHORDS_PER_SPAN);
        let point = |i: usize| self.at(i as f64 / n.max(1) as f64);
        let mut sum = 0.0;
        let mut last = point(0);
        for i in 1..=n {
            let next = point(i);
            let square = [0, 1, 2].map(|k| (next[k] - last[k]) * (next[k] - last[k]));
            sum += osier_base::math::sqrt(square[0] + square[1] + square[2]);
            last = next;
        }
        sum
    }
}

/// A function y = f(x) of a companion file, for x from 0 to 1.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DataFunction {
    spline: Spline,
    /// Values at equally spaced x, interpolated linearly; empty if the spline itself is solved for x.
    samples: Vec<f64>,
    /// True for a graph whose abscissas need not go from 0 to 1.
    is_graph: bool,
}

impl DataFunction {
    /// The function through a clamped spline of points (x, y). Two or more `samples` tabulate it with that number of values,
    /// as `function: FILE n` requests.
    pub fn new(points: &[[f64; 2]], samples: usize) -> Self {
        let points: Vec<[f64; 3]> = points.iter().map(|p| [p[0], p[1], 0.0]).collect();
        let mut function = Self { spline: Spline::new(&points, SplineEnds::Clamped), ..Self::default() };
        if samples >= 2 {
            let value = |i: usize| function.solve(i as f64 / (samples - 1) as f64);
            function.samples = (0..samples).map(value).collect();
        }
        function
    }

    /// The function whose graph is a curve with increasing abscissas; x is clamped to the abscissas of its ends.
    pub fn of_graph(spline: Spline) -> Self {
        Self { spline, is_graph: true, ..Self::default() }
    }

    /// y at the parameter where the spline's abscissa equals `x`, which is clamped to 0..1, or to the ends of a graph. NaN
    /// counts as 0.
    pub fn value(&self, x: f64) -> f64 {
        if self.is_graph {
            return self.solve(if x.is_nan() { 0.0 } else { x });
        }
        let x = if x > 0.0 { x.min(1.0) } else { 0.0 };
        let Some(last) = self.samples.len().checked_sub(1).filter(|n| *n > 0) else { return self.solve(x) };
        let at = x * last as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the number of samples")]
        let i = (at.floor() as usize).min(last - 1);
        let f = at - i as f64;
        self.samples[i] * (1.0 - f) + self.samples[i + 1] * f
    }

    fn solve(&self, x: f64) -> f64 {
        // At and beyond the ends of the domain return the end points: bisection only approximates them where the spline is
        // vertical.
        for end in [0.0, 1.0] {
            let p = self.spline.at(end);
            if (p[0] - x) * (1.0 - 2.0 * end) >= 0.0 {
                return p[1];
            }
        }
        let (mut low, mut high) = (0.0, 1.0);
        // The abscissa grows with the parameter, so that bisection finds the solution.
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.spline.at(middle)[0] < x {
                low = middle;
            } else {
                high = middle;
            }
        }
        self.spline.at(0.5 * (low + high))[1]
    }
}

#[derive(Debug, Clone, PartialEq)]
struct MeasuredCurve {
    spline: Spline,
    length: f64,
}

/// The functions and curves of a grammar by their numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FunctionTables {
    functions: BTreeMap<u32, DataFunction>,
    curves: BTreeMap<u32, MeasuredCurve>,
    /// Numbers of functions by the macro that names each: the name in upper case.
    names: BTreeMap<String, u32>,
    /// Numbers of functions by name as written in the file: once up to the first blank and once as a whole.
    written: BTreeMap<String, u32>,
}

impl FunctionTables {
    /// Adds function number `id`. Its name in upper case becomes a macro of the grammar, which stands for the number; the
    /// name as written stands for the number unless a variable has that name.
    pub fn add_function(&mut self, id: u32, name: &str, function: DataFunction) {
        self.functions.insert(id, function);
        let word =
            |text: &str| -> String { text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect() };
        let is_name = |word: &str| word.chars().next().is_some_and(|c| !c.is_ascii_digit());
        let upper = word(&name.to_uppercase());
        if is_name(&upper) {
            self.names.insert(upper, id);
        }
        // cpfg reads a name up to its first blank. If several functions share a name, the last one counts.
        for written in [word(name), word(name.split_whitespace().next().unwrap_or(""))] {
            if is_name(&written) {
                self.written.insert(written, id);
            }
        }
    }

    /// Number of the function with this name, as written in its file.
    pub fn id_of(&self, name: &str) -> Option<u32> {
        self.written.get(name).copied()
    }

    /// Adds a contour as curve number `id`, and measures its length.
    pub fn add_curve(&mut self, id: u32, spline: Spline) {
        let length = spline.length();
        self.curves.insert(id, MeasuredCurve { spline, length });
    }

    /// Macros that name the functions, with their numbers.
    pub fn names(&self) -> impl Iterator<Item = (&str, u32)> {
        self.names.iter().map(|(name, id)| (name.as_str(), *id))
    }

    /// Number of functions, curves not counted.
    pub fn function_count(&self) -> usize {
        self.functions.len()
    }

    /// Value of function `id` at `x`, clamped to 0..1; `None` if there is no such function.
    pub fn value(&self, id: f64, x: f64) -> Option<f64> {
        Some(self.functions.get(&number(id)?)?.value(x))
    }

    /// Point of curve `id` at `t`, clamped to 0..1; `None` if there is no such curve.
    pub fn curve(&self, id: f64, t: f64) -> Option<[f64; 3]> {
        Some(self.curves.get(&number(id)?)?.spline.at(t))
    }

    /// Curve `id`; `None` if there is no such curve.
    pub fn spline(&self, id: f64) -> Option<&Spline> {
        Some(&self.curves.get(&number(id)?)?.spline)
    }

    /// Length of curve `id` in the units of its control points, computed once; `None` if there is no such curve.
    pub fn curve_length(&self, id: f64) -> Option<f64> {
        Some(self.curves.get(&number(id)?)?.length)
    }
}

/// The number of a table, from a value of the language truncated to an integer.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is checked")]
fn number(id: f64) -> Option<u32> {
    (id >= 0.0 && id < f64::from(u32::MAX)).then_some(id as u32)
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "exact values at simple parameters")]
mod tests {
    use super::*;

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-9, "{a} is not {b}");
    }

    #[test]
    fn a_clamped_spline_of_four_points_is_their_bezier_curve() {
        let s = Spline::new(&[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 2.0], [1.0, 0.0, 4.0]], SplineEnds::Clamped);
        // (1-t)^3, 3t(1-t)^2, 3t^2(1-t), t^3 at t = 1/2 are 1/8, 3/8, 3/8, 1/8.
        assert_eq!(s.at(0.5), [0.5, 0.75, 1.25]);
        assert_eq!((s.at(0.0), s.at(1.0), s.at(7.0)), ([0.0, 0.0, 0.0], [1.0, 0.0, 4.0], [1.0, 0.0, 4.0]));
        assert_eq!(s.at(f64::NAN), [0.0; 3]);
    }

    #[test]
    fn a_uniform_spline_weighs_three_points_at_its_knots() {
        // At a knot the weights are 1/6, 4/6, 1/6.
        let s = Spline::new(&[[0.0; 3], [6.0, 0.0, 0.0], [12.0, 6.0, 0.0], [0.0; 3], [0.0; 3]], SplineEnds::Open);
        let p = s.at(0.0);
        near(p[0], (0.0 + 24.0 + 12.0) / 6.0);
        near(p[1], 1.0);
        let p = s.at(0.5);
        near(p[0], (6.0 + 48.0) / 6.0);
        let square = [[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]];
        let closed = Spline::new(&square, SplineEnds::Closed);
        let (first, last) = (closed.at(0.0), closed.at(1.0));
        near(first[0], last[0]);
        near(first[1], last[1]);
        // (1 - 4 - 1)/6 and (1 + 4 - 1)/6.
        near(first[0], -4.0 / 6.0);
        near(first[1], 4.0 / 6.0);
    }

    #[test]
    fn curves_of_other_degrees_are_those_of_their_definitions() {
        // Binomials 1 4 6 4 1 over 16 at t = 1/2: y = (4 + 4) / 16 of the second and fourth point.
        let bezier = Spline::bezier(&[[0.0; 3], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0], [3.0, 1.0, 0.0], [4.0, 0.0, 0.0]]);
        near(bezier.at(0.5)[0], 2.0);
        near(bezier.at(0.5)[1], 0.5);
        // Two lines of lengths 1 and 3, each over half of the parameter.
        let line = Spline::polyline(&[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 3.0, 0.0]]);
        assert_eq!((line.at(0.25), line.at(0.75)), ([0.5, 0.0, 0.0], [1.0, 1.5, 0.0]));
        near(line.length(), 4.0);
        // A graph is clamped to its own ends.
        let graph = DataFunction::of_graph(Spline::polyline(&[[-1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]));
        near(graph.value(1.0), 3.0);
        near(graph.value(-9.0), 2.0);
        near(graph.value(9.0), 4.0);
    }

    #[test]
    fn few_points_lower_the_degree() {
        assert_eq!(Spline::new(&[], SplineEnds::Clamped).at(0.3), [0.0; 3]);
        assert_eq!(Spline::new(&[[2.0, 3.0, 4.0]], SplineEnds::Clamped).at(0.3), [2.0, 3.0, 4.0]);
        let line = Spline::new(&[[0.0; 3], [3.0, 4.0, 0.0]], SplineEnds::Clamped);
        near(line.length(), 5.0);
        near(line.at(0.25)[0], 0.75);
    }

    #[test]
    fn a_function_is_solved_for_its_abscissa() {
        // Equal control ordinates give a constant; equal points on a line give the line.
        let line = DataFunction::new(&[[0.0, 1.0], [0.2, 1.4], [0.7, 2.4], [1.0, 3.0]], 0);
        for x in [0.0, 0.123, 0.5, 0.9, 1.0] {
            near(line.value(x), 1.0 + 2.0 * x);
        }
        near(line.value(-3.0), 1.0);
        near(line.value(9.0), 3.0);
        // x = 3t - 3t^2 + t^3 = 1 - (1 - t)^3 and y = t^3: at x = 7/8 t is 1/2.
        let bent = DataFunction::new(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]], 0);
        near(bent.value(0.875), 0.125);
        // Three samples at x = 0, 1/2, 1 and straight lines between.
        let table = DataFunction::new(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]], 3);
        near(table.value(0.75), 0.5 * (bent.value(0.5) + 1.0));
    }

    #[test]
    fn tables_are_found_by_number_and_named_in_upper_case() {
        let mut tables = FunctionTables::default();
        tables.add_function(1, "leaf size", DataFunction::new(&[[0.0, 2.0], [1.0, 4.0]], 0));
        tables.add_curve(3, Spline::new(&[[0.0; 3], [0.0, 0.0, 2.0]], SplineEnds::Clamped));
        assert_eq!(tables.names().collect::<Vec<_>>(), [("LEAF_SIZE", 1)]);
        let found = ["leaf_size", "leaf", "LEAF", "leaf size"].map(|n| tables.id_of(n));
        assert_eq!(found, [Some(1), Some(1), None, None]);
        near(tables.value(1.0, 0.5).unwrap_or(f64::NAN), 3.0);
        assert_eq!((tables.value(2.0, 0.5), tables.curve(1.0, 0.5), tables.value(f64::NAN, 0.0)), (None, None, None));
        assert_eq!(tables.curve(3.9, 0.5), Some([0.0, 0.0, 1.0]));
        near(tables.curve_length(3.0).unwrap_or(f64::NAN), 2.0);
    }
}
