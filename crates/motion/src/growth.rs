//! Growth of a plant as a clip: its skeleton at any time, with constant topology.
//!
//! Every node of a [`Plant`] has a time of birth. Before it, the node lies at the tip that its axis has reached; after it, wood
//! thickens to the radius of the grown plant, and leaves unfold. Nodes never move once they are born, so that points and leaves
//! bound to the skeleton slide along it and swell about it. Own.

use glam::{Quat, Vec3};

use crate::posed_skin::{GrowthBinding, drawn_by};
use osier_base::math::{pow_f32, smoothstep};
use osier_scene::plant::{Axis, NONE, Organ, Plant};

/// Share of the whole growth time that a leaf takes to unfold; the clip ends when the youngest leaf has unfolded. Larger values
/// make growth look slower at the tips.
const UNFOLDING: f32 = 0.08;
/// Exponent e of the growth of wood in thickness: r = r_grown (age / final age)^e. With 1 wood would thicken at a constant rate;
/// with less than 1 it thickens faster when young, as in trees.
const THICKENING: f32 = 0.75;

/// Times of birth of a plant's nodes and organs, 0..1 of the growth time of its wood.
#[derive(Debug, Clone)]
pub struct GrowthClock {
    nodes: Vec<f32>,
    organs: Vec<f32>,
}

/// Pose and size of an organ at one time of its plant's growth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrowingOrgan {
    /// Pivot, plant space, m.
    pub position: Vec3,
    /// Rotation into plant space.
    pub orientation: Quat,
    /// Factor on its size: 0 before its birth, 1 once it has unfolded.
    pub size: f32,
}

impl GrowthClock {
    /// Uses the births that growth recorded, or path lengths from the ground for plants whose nodes were all born at once.
    pub fn new(plant: &Plant) -> Self {
        let timed = plant.nodes.birth.iter().any(|b| *b > 0.0);
        let nodes = if timed { plant.nodes.birth.clone() } else { births_by_path(plant) };
        let mut clock = Self { nodes, organs: Vec::new() };
        let birth =
            |o: &Organ| clock.birth(plant, &plant.axes[o.axis as usize], o.s).max(o.birth * f32::from(u8::from(timed)));
        clock.organs = plant.organs.iter().map(birth).collect();
        clock
    }

    /// Time of birth, 0..1, of the point of an axis at arc length `s`, m; linear between nodes.
    fn birth(&self, plant: &Plant, axis: &Axis, s: f32) -> f32 {
        let (i, t) = plant.segment(axis, s);
        self.nodes[i] + (self.nodes[i + 1] - self.nodes[i]) * t
    }
}

/// Path length from the ground to each node, divided by the longest of all.
fn births_by_path(plant: &Plant) -> Vec<f32> {
    let mut starts: Vec<f32> = Vec::with_capacity(plant.axes.len());
    let mut births = vec![0.0; plant.nodes.len()];
    let mut longest = 0.0_f32;
    // Parents come before their children, so that their start is known.
    for axis in &plant.axes {
        let start = if axis.parent == NONE { 0.0 } else { starts[axis.parent as usize] + axis.parent_s };
        starts.push(start);
        for k in plant.nodes_of(axis) {
            births[k] = start + plant.nodes.s[k];
            longest = longest.max(births[k]);
        }
    }
    births.iter_mut().for_each(|b| *b /= longest.max(f32::MIN_POSITIVE));
    births
}

/// A plant at one time of its growth: how far its axes have grown, and how thick they are.
#[derive(Debug)]
pub struct GrowingPlant<'a> {
    plant: &'a Plant,
    clock: &'a GrowthClock,
    /// Time on the scale of births: 0 to 1 + `UNFOLDING`.
    now: f32,
    /// Arc length that each axis has reached, m; negative before its birth.
    reached: Vec<f32>,
}

impl<'a> GrowingPlant<'a> {
    /// The plant at the fraction `share`, 0..1, of the whole growth time; values outside are clamped.
    pub fn new(plant: &'a Plant, clock: &'a GrowthClock, share: f32) -> Self {
        let now = share.clamp(0.0, 1.0) * (1.0 + UNFOLDING);
        let reached = plant.axes.iter().map(|axis| reached_length(plant, clock, axis, now)).collect();
        Self { plant, clock, now, reached }
    }

    /// Ratio of the present radius of an axis at arc length `s`, m, to that of the grown plant; 0 before its birth.
    fn thickness(&self, axis: &Axis, s: f32) -> f32 {
        let birth = self.clock.birth(self.plant, axis, s);
        // Age as a fraction of the age at the end of the clip.
        let age = (self.now - birth) / (1.0 + UNFOLDING - birth);
        if age >= 1.0 { 1.0 } else { pow_f32(age.max(0.0), THICKENING) }
    }

    /// Point of the centreline at arc length `s`, m, in plant space, or the present tip of the axis if it has not grown so far.
    pub fn center(&self, axis: u32, s: f32) -> Vec3 {
        let (mut axis, mut s) = (axis, s);
        loop {
            let shape = &self.plant.axes[axis as usize];
            let reached = self.reached[axis as usize];
            if reached >= 0.0 || shape.parent == NONE {
                return self.plant.frame(shape, s.min(reached.max(0.0))).p;
            }
            // An axis that is not born lies at its site on its parent, which may not have grown so far either.
            (axis, s) = (shape.parent, shape.parent_s);
        }
    }

    /// Arc length, m, to which `s` moves while the parent of a branch is thinner than in the grown plant. Near its base a branch
    /// moves inwards along its axis by the missing thickness of the parent.
    fn drawn_in(&self, axis: u32, s: f32) -> f32 {
        let shape = &self.plant.axes[axis as usize];
        if shape.parent == NONE {
            return s;
        }
        let parent = &self.plant.axes[shape.parent as usize];
        drawn_by(shape, self.thickness(parent, shape.parent_s), s)
    }

    /// Present positions, m, in plant space, of points that the grown plant has at `points`; at the end of growth they are equal.
    pub fn points(&self, points: &[Vec3], bindings: &[GrowthBinding]) -> Vec<Vec3> {
        points.iter().zip(bindings).map(|(p, b)| self.point(*p, *b)).collect()
    }

    fn point(&self, p: Vec3, bound: GrowthBinding) -> Vec3 {
        let axis = &self.plant.axes[bound.axis as usize];
        let thickness = self.thickness(axis, bound.s);
        let s = self.drawn_in(bound.axis, bound.s);
        let center = self.plant.frame(axis, bound.s).p;
        if thickness >= 1.0 {
            return p + (self.center(bound.axis, s) - center);
        }
        // The offset from the centreline shrinks with the wood that it lies on.
        self.center(bound.axis, s) + (p - center) * thickness
    }

    /// The organ of this index in [`Plant::organs`] at this time; of size 0 before its birth.
    pub fn organ(&self, i: usize) -> GrowingOrgan {
        let organ = &self.plant.organs[i];
        let axis = &self.plant.axes[organ.axis as usize];
        let (position, orientation) = self.plant.organ_site(organ);
        let birth = self.clock.organs[i];
        // The petiole begins at the surface, which is nearer to the centreline while the wood is thin.
        let lacking = self.plant.frame(axis, organ.s).r * (1.0 - self.thickness(axis, organ.s));
        let moved = self.center(organ.axis, organ.s) - self.plant.frame(axis, organ.s).p;
        GrowingOrgan {
            position: position + moved - orientation * Vec3::Y * lacking.min(organ.petiole),
            orientation,
            size: smoothstep(birth, birth + UNFOLDING, self.now),
        }
    }

    /// Factor on the size of a segment at an arc length: its thickness, 0 before its birth.
    pub fn segment_size(&self, axis: u32, s: f32) -> f32 {
        let shape = &self.plant.axes[axis as usize];
        if self.reached[axis as usize] < s { 0.0 } else { self.thickness(shape, s) }
    }
}

/// Arc length that an axis has reached at time `now`, m, linear between the births of its nodes; -1 before its birth.
fn reached_length(plant: &Plant, clock: &GrowthClock, axis: &Axis, now: f32) -> f32 {
    let range = plant.nodes_of(axis);
    let births = &clock.nodes[range.clone()];
    if now < births[0] {
        return -1.0;
    }
    let i = range.start + births.partition_point(|b| *b <= now).clamp(1, births.len() - 1) - 1;
    // The axis grows from the node that was born last towards the next one.
    let (from, to) = (clock.nodes[i], clock.nodes[i + 1]);
    let t = if to > from { ((now - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 };
    plant.nodes.s[i] + (plant.nodes.s[i + 1] - plant.nodes.s[i]) * t
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::plant::{AxisEnd, AxisKind, Nodes, Proto};

    /// A trunk of 2 m that grows until 0.5, a branch from its middle that grows from 0.25 to 1, one leaf at the branch's tip.
    fn plant() -> Plant {
        let axis = |id, parent, parent_s, first, order, s_exposed| Axis {
            id,
            parent,
            parent_s,
            order,
            kind: AxisKind::Stem,
            first,
            count: 3,
            length: 2.0 - f32::from(order),
            s_exposed,
            material: 0,
            fork: NONE,
            end: AxisEnd::Tip,
            birth: 0.0,
        };
        let leaf = Organ {
            id: 9,
            axis: 1,
            s: 1.0,
            offset: Vec3::ZERO,
            q: Quat::IDENTITY,
            scale: 1.0,
            proto: 0,
            petiole: 0.02,
            tint: 0.5,
            birth: 1.0,
        };
        Plant {
            axes: vec![axis(1, NONE, 0.0, 0, 0, 0.0), axis(2, 0, 1.0, 3, 1, 0.1)],
            nodes: Nodes {
                p: [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [0.0, 1.0], [0.5, 1.0], [1.0, 1.0]]
                    .map(|[x, y]| Vec3::new(x, y, 0.0))
                    .to_vec(),
                q: vec![Quat::IDENTITY; 6],
                r: vec![0.1, 0.1, 0.05, 0.04, 0.03, 0.02],
                s: vec![0.0, 1.0, 2.0, 0.0, 0.5, 1.0],
                birth: vec![0.0, 0.25, 0.5, 0.25, 0.6, 1.0],
                color: vec![0; 6],
            },
            organs: vec![leaf],
            protos: vec![Proto { name: "leaf".into(), mesh: std::sync::Arc::default() }],
            materials: vec!["bark".into()],
            ..Plant::default()
        }
    }

    #[test]
    fn a_grown_plant_is_the_plant() {
        let plant = plant();
        let clock = GrowthClock::new(&plant);
        let grown = GrowingPlant::new(&plant, &clock, 1.0);
        let points = [Vec3::new(0.1, 0.5, 0.0), Vec3::new(0.12, 1.04, 0.0), Vec3::new(1.0, 1.0, 0.02)];
        let bindings = [(0, 0.5), (1, 0.1), (1, 1.0)].map(|(axis, s)| GrowthBinding { axis, s });
        for (a, b) in grown.points(&points, &bindings).iter().zip(&points) {
            assert!(a.distance(*b) < 1e-6, "{a} {b}");
        }
        let organ = grown.organ(0);
        let (p, q) = plant.organ_site(&plant.organs[0]);
        assert!((organ.size - 1.0).abs() < 1e-6 && organ.position.distance(p) < 1e-6 && organ.orientation == q);
    }

    #[test]
    fn what_is_not_born_lies_at_the_tip_of_what_is() {
        let plant = plant();
        let clock = GrowthClock::new(&plant);
        // Time 0.108: the trunk has grown to 0.432 m, where all of the branch lies.
        let young = GrowingPlant::new(&plant, &clock, 0.1);
        let tip = Vec3::new(0.0, 0.1 * (1.0 + UNFOLDING) / 0.25, 0.0);
        for (axis, s) in [(0, 2.0), (1, 0.0), (1, 1.0)] {
            let p = young.point(Vec3::new(5.0, 5.0, 5.0), GrowthBinding { axis, s });
            assert!(p.distance(tip) < 1e-5, "axis {axis} at {s}: {p}");
        }
        assert!(young.organ(0).size <= 0.0);
    }

    #[test]
    fn radii_only_grow_and_points_never_jump() {
        let plant = plant();
        let clock = GrowthClock::new(&plant);
        let at = |share: f32| {
            let young = GrowingPlant::new(&plant, &clock, share);
            let points = [Vec3::new(0.1, 0.5, 0.0), Vec3::new(0.1, 1.04, 0.0), Vec3::new(1.0, 1.0, 0.02)];
            let bindings = [(0, 0.5), (1, 0.1), (1, 1.0)].map(|(axis, s)| GrowthBinding { axis, s });
            (young.points(&points, &bindings), young.thickness(&plant.axes[0], 0.5), young.organ(0).size)
        };
        let mut before = at(0.0);
        for k in 1..=480_u16 {
            let now = at(f32::from(k) / 480.0);
            assert!(now.1 >= before.1 && now.2 >= before.2 && now.2 - before.2 < 0.3);
            // The fastest tip grows 2 m in half of the time: 9 mm in this step, and thickening adds to that.
            let moved = now.0.iter().zip(&before.0).map(|(a, b)| a.distance(*b)).fold(0.0_f32, f32::max);
            assert!(moved < 0.02, "{moved} at {k}");
            before = now;
        }
    }

    #[test]
    fn a_branch_stays_on_its_parents_surface_while_that_thickens() {
        let plant = plant();
        let clock = GrowthClock::new(&plant);
        for share in [0.4, 0.6, 0.8] {
            let young = GrowingPlant::new(&plant, &clock, share);
            // The ring where the branch leaves the grown trunk, 0.1 m from its axis.
            let p = young.point(Vec3::new(0.1, 1.0, 0.0), GrowthBinding { axis: 1, s: 0.1 });
            let surface = 0.1 * young.thickness(&plant.axes[0], 1.0);
            assert!((p.x - surface).abs() < 0.1 * surface, "{} {surface}", p.x);
        }
    }

    #[test]
    fn a_plant_without_times_grows_along_its_paths() {
        let mut plant = plant();
        plant.nodes.birth = vec![0.0; 6];
        let clock = GrowthClock::new(&plant);
        assert_eq!(clock.nodes, [0.0, 0.5, 1.0, 0.5, 0.75, 1.0]);
    }
}
