//! What every plant must satisfy before anything consumes it, and the repairs that need no decision.

use super::{Axis, NONE, Nodes, Plant};
use osier_base::convert::saturating_index;
use osier_base::{Error, Result};

/// Most nodes, and most organs, that a plant may have.
pub const MAX_ITEMS: usize = 20_000_000;
/// Thickest child at its attachment, as a share of the parent's radius there.
const MAX_CHILD: f32 = 0.95;
/// Shortest segment, m; shorter ones are merged.
const MIN_SEGMENT: f32 = 1e-7;

/// One kind of fault of a plant that was repaired, with the number of its occurrences.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// Subject and fact, lower case, no full stop.
    pub message: &'static str,
    /// Number of places concerned, at least 1.
    pub count: usize,
    /// Index of the first axis concerned.
    pub axis: usize,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({} times, first on axis {})", self.message, self.count, self.axis)
    }
}

/// Checks a plant and repairs two faults: nodes of segments shorter than 1e-7 m are dropped (an axis of no length keeps two
/// nodes, 1 um apart, or 1e-6 of their largest coordinate), and children thicker than 0.95 of their parent at the site are
/// thinned to that. Returns one warning per kind of repair. Radii that grow along an axis, as at the nodes of a culm, are allowed.
/// # Errors
/// X001 for a value that is not finite; `Range` for r <= 0, a frame that is no unit quaternion, a parent that does not
/// precede its child, an arc length outside its axis, an unknown prototype or fewer than 2 nodes; `Limit` beyond 2e7
/// nodes or organs.
#[inline]
pub fn validate(plant: &mut Plant) -> Result<Vec<Warning>> {
    check_counts(plant)?;
    check_arrays(plant)?;
    for (i, axis) in plant.axes.iter().enumerate() {
        check_axis(plant, i, axis)?;
    }
    check_organs(plant)?;
    let mut warnings = Vec::new();
    drop_empty_segments(plant, &mut warnings);
    thin_children(plant, &mut warnings);
    Ok(warnings)
}

fn note(warnings: &mut Vec<Warning>, message: &'static str, axes: impl IntoIterator<Item = usize>) {
    let mut axes = axes.into_iter();
    if let Some(axis) = axes.next() {
        warnings.push(Warning { message, count: 1 + axes.count(), axis });
    }
}

fn check_counts(plant: &Plant) -> Result<()> {
    for (name, wanted) in [("nodes", plant.nodes.len()), ("organs", plant.organs.len())] {
        if wanted > MAX_ITEMS {
            return Err(Error::Limit {
                name: format!("{name} of the plant"),
                wanted: wanted.to_string(),
                limit: MAX_ITEMS.to_string(),
                flag: String::new(),
                help: "use fewer derivation steps or levels".into(),
            });
        }
    }
    Ok(())
}

fn range_error(name: String, value: f64, min: f64, max: f64) -> Error {
    Error::Range { name, value, min, max, unit: "" }
}

fn check_arrays(plant: &Plant) -> Result<()> {
    let n = &plant.nodes;
    let lengths = [n.q.len(), n.r.len(), n.s.len(), n.birth.len(), n.color.len()];
    if lengths.iter().any(|&l| l != n.p.len()) {
        return Err(Error::export("X001", "plant: node arrays of different lengths"));
    }
    // One pass over each column finds out whether anything is wrong; only then is the fault searched.
    let is_sound = all(&n.p, |p| p.x.is_finite() & p.y.is_finite() & p.z.is_finite())
        && all(&n.q, is_unit)
        && all(&n.r, |r| r.is_finite() & (r > 0.0))
        && all(&n.s, f32::is_finite)
        && all(&n.birth, f32::is_finite);
    if is_sound {
        return Ok(());
    }
    let finite = |i: usize| {
        n.p[i].is_finite() && n.q[i].is_finite() && n.r[i].is_finite() && n.s[i].is_finite() && n.birth[i].is_finite()
    };
    if let Some(i) = (0..n.len()).find(|&i| !finite(i)) {
        return Err(Error::export("X001", format!("plant: node {i} is not finite")));
    }
    if let Some(i) = n.r.iter().position(|r| *r <= 0.0) {
        return Err(range_error(format!("radius of node {i}"), f64::from(n.r[i]), 0.0, f64::INFINITY));
    }
    if let Some(i) = n.q.iter().position(|q| !is_unit(*q)) {
        return Err(range_error(format!("length of the frame of node {i}"), f64::from(n.q[i].length()), 1.0, 1.0));
    }
    Ok(())
}

/// Whether a test holds for all values of a column. Within a chunk there is no early exit, so that several values are tested at
/// a time.
fn all<T: Copy>(column: &[T], test: impl Fn(T) -> bool) -> bool {
    /// Number of values in a chunk: some microseconds of work.
    const CHUNK: usize = 1024;
    column.chunks(CHUNK).all(|chunk| chunk.iter().fold(true, |sound, value| sound & test(*value)))
}

/// Whether a frame is a unit quaternion within the rounding errors of single precision.
fn is_unit(q: glam::Quat) -> bool {
    (q.length() - 1.0).abs() <= 1e-5
}

fn check_axis(plant: &Plant, i: usize, axis: &Axis) -> Result<()> {
    let name = |what: &str| format!("axis {i}: {what}");
    if !(axis.parent_s.is_finite() && axis.length.is_finite() && axis.s_exposed.is_finite() && axis.birth.is_finite()) {
        return Err(Error::export("X001", name("value is not finite")));
    }
    let end = u64::from(axis.first) + u64::from(axis.count);
    if axis.count < 2 || end > plant.nodes.len() as u64 {
        return Err(range_error(name("number of nodes"), f64::from(axis.count), 2.0, plant.nodes.len() as f64));
    }
    if axis.parent == NONE {
        return Ok(());
    }
    let Some(parent) = plant.axes.get(axis.parent as usize).filter(|_| (axis.parent as usize) < i) else {
        return Err(range_error(name("parent"), f64::from(axis.parent), 0.0, i as f64 - 1.0));
    };
    // Arc lengths are sums of rounded segments: a site at the tip may lie a little beyond it.
    let slack = 1e-4 * (1.0 + parent.length);
    if axis.parent_s < -slack || axis.parent_s > parent.length + slack {
        let (at, length) = (f64::from(axis.parent_s), f64::from(parent.length));
        return Err(range_error(name("place on the parent"), at, 0.0, length));
    }
    Ok(())
}

fn check_organs(plant: &Plant) -> Result<()> {
    for (i, organ) in plant.organs.iter().enumerate() {
        let numbers = [organ.s, organ.scale, organ.petiole, organ.tint, organ.birth];
        if !(numbers.iter().all(|v| v.is_finite()) && organ.offset.is_finite() && organ.q.is_finite()) {
            return Err(Error::export("X001", format!("plant: organ {i} is not finite")));
        }
        let Some(axis) = plant.axes.get(organ.axis as usize) else {
            let last = plant.axes.len() as f64 - 1.0;
            return Err(range_error(format!("axis of organ {i}"), f64::from(organ.axis), 0.0, last));
        };
        if organ.s < -1e-4 || organ.s > axis.length * 1.0001 + 1e-4 {
            let at = f64::from(organ.s);
            return Err(range_error(format!("place of organ {i} on its axis"), at, 0.0, f64::from(axis.length)));
        }
        if usize::from(organ.proto) >= plant.protos.len() {
            let last = plant.protos.len() as f64 - 1.0;
            return Err(range_error(format!("prototype of organ {i}"), f64::from(organ.proto), 0.0, last));
        }
    }
    Ok(())
}

/// True if node `i` is more than [`MIN_SEGMENT`] farther along the axis than node `j`, and as far from it in space.
fn apart(n: &Nodes, i: usize, j: usize) -> bool {
    n.s[i] - n.s[j] > MIN_SEGMENT && n.p[i].distance(n.p[j]) > MIN_SEGMENT
}

/// Indices of the nodes of an axis that are kept: each is [`apart`] from the one kept before.
fn kept(plant: &Plant, axis: &Axis) -> Vec<usize> {
    let mut keep: Vec<usize> = Vec::with_capacity(axis.count as usize);
    for i in plant.nodes_of(axis) {
        if keep.last().is_none_or(|&j| apart(&plant.nodes, i, j)) {
            keep.push(i);
        }
    }
    keep
}

/// Index or number of nodes as axes store it. It fits, since nodes are only removed from a plant whose axes indexed all of them with u32.
fn stored_index(n: usize) -> u32 {
    saturating_index(n)
}

fn drop_empty_segments(plant: &mut Plant, warnings: &mut Vec<Warning>) {
    let shorter = |i: &usize| plant.nodes_of(&plant.axes[*i]).skip(1).any(|k| !apart(&plant.nodes, k, k - 1));
    let changed: Vec<usize> = (0..plant.axes.len()).filter(shorter).collect();
    if changed.is_empty() {
        return;
    }
    let keep: Vec<Vec<usize>> = plant.axes.iter().map(|a| kept(plant, a)).collect();
    let old = std::mem::take(&mut plant.nodes);
    for (axis, keep) in plant.axes.iter_mut().zip(&keep) {
        axis.first = stored_index(plant.nodes.len());
        for &i in keep {
            copy_node(&mut plant.nodes, &old, i);
        }
        // An axis needs two nodes: the only one is doubled and moved along its frame.
        if let &[only] = keep.as_slice() {
            copy_node(&mut plant.nodes, &old, only);
            stretch(&mut plant.nodes, only, &old);
        }
        axis.count = stored_index(keep.len().max(2));
        // The nodes of this axis were appended last.
        axis.length = plant.nodes.s.last().copied().unwrap_or(0.0);
    }
    note(warnings, "segments of no length were dropped", changed);
}

fn copy_node(to: &mut Nodes, from: &Nodes, i: usize) {
    to.p.push(from.p[i]);
    to.q.push(from.q[i]);
    to.r.push(from.r[i]);
    to.s.push(from.s[i]);
    to.birth.push(from.birth[i]);
    to.color.push(from.color[i]);
}

/// Moves the last node, a copy of node `twin` of `old`, along the growth direction of its frame.
fn stretch(nodes: &mut Nodes, twin: usize, old: &Nodes) {
    // The distance is proportional to the coordinates, so that adding it changes them in single precision.
    let far = old.p[twin].abs().max_element().max(1.0) * 1e-6;
    if let (Some(p), Some(s)) = (nodes.p.last_mut(), nodes.s.last_mut()) {
        *p += old.q[twin] * (glam::Vec3::Y * far);
        *s += far;
    }
}

fn thin_children(plant: &mut Plant, warnings: &mut Vec<Warning>) {
    let mut thinned = Vec::new();
    for i in 0..plant.axes.len() {
        let axis = &plant.axes[i];
        let Some(parent) = plant.axes.get(axis.parent as usize) else { continue };
        // Parents come before their children, so that the parent's radius is the thinned one.
        let most = plant.radius(parent, axis.parent_s) * MAX_CHILD;
        let range = plant.nodes_of(axis);
        if plant.nodes.r[range.start] <= most * 1.0001 {
            continue;
        }
        thinned.push(i);
        for r in &mut plant.nodes.r[range] {
            *r = r.min(most);
        }
    }
    note(warnings, "axes thicker than 0.95 of their parent were thinned to it", thinned);
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;
    use crate::plant::{AxisEnd, AxisKind};

    fn push_axis(plant: &mut Plant, parent: u32, parent_s: f32, points: &[(Vec3, f32)]) {
        let first = plant.nodes.len();
        let mut s = 0.0;
        for (i, &(p, r)) in points.iter().enumerate() {
            if i > 0 {
                s += p.distance(points[i - 1].0);
            }
            plant.nodes.p.push(p);
            plant.nodes.q.push(Quat::IDENTITY);
            plant.nodes.r.push(r);
            plant.nodes.s.push(s);
            plant.nodes.birth.push(0.0);
            plant.nodes.color.push(0);
        }
        plant.axes.push(Axis {
            id: plant.axes.len() as u64,
            parent,
            parent_s,
            order: u8::from(parent != NONE),
            kind: AxisKind::Stem,
            first: u32::try_from(first).expect("small"),
            count: u32::try_from(points.len()).expect("small"),
            length: s,
            s_exposed: 0.0,
            material: 0,
            fork: NONE,
            end: AxisEnd::Tip,
            birth: 0.0,
        });
    }

    fn sample() -> Plant {
        let mut plant = Plant::default();
        let y = |v: f32| Vec3::Y * v;
        push_axis(&mut plant, NONE, 0.0, &[(y(0.0), 0.1), (y(0.5), 0.1), (y(0.5), 0.09), (y(1.0), 0.05)]);
        push_axis(&mut plant, 0, 0.5, &[(y(0.5), 0.2), (Vec3::new(1.0, 0.5, 0.0), 0.02)]);
        push_axis(&mut plant, 0, 0.5, &[(y(0.5), 0.01), (y(0.5), 0.01)]);
        plant
    }

    #[test]
    fn repairs_are_made_and_counted() {
        let mut plant = sample();
        let warnings = validate(&mut plant).expect("only repairs");
        assert_eq!(warnings.len(), 2, "{warnings:?}");
        assert_eq!(warnings[0].count, 2);
        assert_eq!((warnings[1].count, warnings[1].axis), (1, 1));
        assert_eq!(plant.axes.iter().map(|a| a.count).collect::<Vec<_>>(), [3, 2, 2]);
        assert!((plant.nodes.r[3] - 0.095).abs() < 1e-6);
        assert!(plant.axes[2].length > 0.0);
        let before = plant.nodes.clone();
        assert_eq!(validate(&mut plant).expect("sound"), [], "a repaired plant needs no repair");
        assert_eq!(before.r, plant.nodes.r);
    }

    #[test]
    fn wood_that_widens_towards_its_tip_needs_no_repair() {
        let mut plant = Plant::default();
        push_axis(&mut plant, NONE, 0.0, &[(Vec3::ZERO, 0.1), (Vec3::Y, 0.3)]);
        assert_eq!(validate(&mut plant).expect("sound"), []);
    }

    #[test]
    fn errors_are_refused() {
        let broken: [fn(&mut Plant); 7] = [
            |p| p.nodes.p[1].x = f32::NAN,
            |p| p.nodes.r[2] = 0.0,
            |p| p.nodes.q[0] = Quat::from_xyzw(0.0, 0.0, 0.0, 1.1),
            |p| p.axes[1].parent = 1,
            |p| p.axes[1].parent_s = 2.0,
            |p| p.axes[0].count = 1,
            |p| p.axes[2].count = 9,
        ];
        for (i, spoil) in broken.iter().enumerate() {
            let mut plant = sample();
            spoil(&mut plant);
            assert!(validate(&mut plant).is_err(), "case {i}");
        }
    }
}
