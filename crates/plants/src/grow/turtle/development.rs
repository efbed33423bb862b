//! The development of a plant by its grammar over the frames of a clip: at each time t = n + part the plant of n steps and a part of
//! the next one, with one topology. Own.
//!
//! The plant of a clip holds each segment and organ that is seen at some time. Those of the last string are the plant of that
//! string; what a step removes is added as axes of its own. A segment of a later string lies at an earlier time on the
//! segment that it came from, or at the point where it will grow.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec3, Quat, Vec3};

use super::builder::FrameSource;
use super::frame::{narrow, narrow_quat};
use super::queries::{refused, roles};
use super::step_part::{GrowingString, ModuleLink, SymbolRole, module_links};
use super::trace::{DrawingTrace, first_of_module};
use super::{Detail, DrawPlace, MIN_RADIUS, StepRadii, TracedDrawing, TurtleOptions};
use crate::grow::clip::{ClipTimes, PosedGrowth};
use crate::grow::years::{LeafNow, PoseNow};
use osier_base::Result;
use osier_base::convert::{saturating_index, to_usize};
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math;
use osier_base::rng::{mix64, word};
use osier_grammar::{DeriveOptions, DerivedString, Grammar, LastStep, Origin, derive_steps};
use osier_scene::Mesh;
use osier_scene::plant::{Axis, NONE, Organ, Plant, Proto};

/// Shortest segment that is added to the plant of a clip, m: validation drops segments that are not much longer.
const MIN_SEGMENT: f32 = 2e-7;
/// Shortest step, m, whose direction is that between its ends; shorter ones have the heading of the turtle.
const MIN_DIRECTION: f64 = 1e-9;

/// The part of a derivation that a clip shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DevelopmentOptions {
    /// Number of steps that count as the whole growth; at most the length of the derivation.
    pub steps: f64,
    /// Shares of the whole growth at the first and the last frame, 0..1.
    pub shares: [f64; 2],
    /// Whether the plant changes from step to step at once, without parts of steps.
    pub whole_steps: bool,
}

/// A step or an organ of the plant: number `item` of those that a module of a string makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Element {
    /// Index of the string in which it is found: the last one that has it.
    level: u32,
    /// Index of its module in that string.
    module: u32,
    item: u32,
}

/// Where an element is in a string.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// It is the part between two shares, 0 to 1, of the length of a step, or an organ.
    Live { module: u32, item: u32, shares: [f32; 2] },
    /// It does not exist: the point of the module where it will grow, or before which it was; 0 before the module, 1 after it.
    Point { module: u32, share: f32 },
}

/// A string of the development.
#[derive(Debug)]
struct Level {
    string: Arc<DerivedString>,
    radii: StepRadii,
    /// How its modules were made from the string before it; empty for the first one.
    origins: Arc<Vec<Origin>>,
    links: Vec<ModuleLink>,
}

/// A node of the plant: the elements that end and begin there, indices into [`DevelopmentClip::elements`]; [`NONE`] at the ends of
/// axes.
#[derive(Debug, Clone, Copy)]
struct NodeSource {
    ends: u32,
    begins: u32,
}

/// An organ of the plant, and its scale there.
#[derive(Debug, Clone, Copy)]
struct OrganSource {
    element: Element,
    scale: f64,
}

/// A plant that develops by its grammar, posed at any time of a clip.
#[derive(Debug)]
pub struct DevelopmentClip {
    /// Each axis and organ that is seen at some time: those of the last string as they are then, others as they were last seen.
    pub plant: Plant,
    /// Warnings of the derivation and of the drawing of its last string.
    pub warnings: Vec<Diagnostic>,
    /// What `printf` wrote.
    pub output: String,
    /// Modules of the last string.
    pub modules: u64,
    grammar: Grammar,
    options: TurtleOptions,
    limits: Limits,
    roles: Vec<SymbolRole>,
    /// Number of steps of the first string.
    first: u32,
    levels: Vec<Level>,
    elements: Vec<Element>,
    nodes: Vec<NodeSource>,
    organs: Vec<OrganSource>,
    times: ClipTimes,
    whole_steps: bool,
}

/// An element at one time.
#[derive(Debug, Clone, Copy)]
struct ElementNow {
    from: DVec3,
    to: DVec3,
    /// Direction and left vector; `None` if the element does not exist at this time.
    frame: Option<(DVec3, DVec3)>,
    /// Radii at both ends, m.
    radii: [f32; 2],
}

/// Where an element is in the drawing of a part of a step.
#[derive(Debug, Clone, Copy)]
struct Found {
    /// Index of its module in the string that is drawn.
    module: usize,
    /// Its place in the string after the step, or before the step if the step removes it.
    place: Place,
    is_removed: bool,
}

/// The drawing of a part of a step.
struct StepNow {
    /// Index of the string after the step.
    level: usize,
    part: f32,
    growing: GrowingString,
    trace: DrawingTrace,
    /// For each module the index of its first step and organ.
    first_step: Vec<u32>,
    first_organ: Vec<u32>,
}

/// Index of the last whole number at or below `time`, which is not negative.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "steps of a derivation, at least 0")]
fn whole_part(time: f64) -> usize {
    time.max(0.0).floor() as usize
}

impl DevelopmentClip {
    /// Derives a grammar and prepares its development over a clip.
    /// # Errors
    /// `Input` with L063 if the grammar cannot be drawn in parts of steps or with one topology; the errors of derivation and drawing.
    pub fn new(
        grammar: &Grammar,
        derivation: &DeriveOptions,
        options: TurtleOptions,
        clip: DevelopmentOptions,
        limits: &Limits,
    ) -> Result<Self> {
        let cannot = |message: &str| refused(grammar, message, "clip_steps = \"unveil\" uncovers the grown plant");
        if grammar.draws_by_context() {
            return Err(cannot("what its modules are drawn as depends on modules around them"));
        }
        // Strings after each step that the clip shows, from the one before its earliest time to the one after its latest.
        let mut strings = derive_steps(grammar, derivation, 0, limits)?;
        let last = strings.last().map_or(0, |string| string.steps);
        let steps = clip.steps.min(f64::from(last));
        let times = ClipTimes { from: clip.shares[0] * steps, to: clip.shares[1] * steps };
        let end = whole_part(times.from.max(times.to).ceil()).max(1);
        let first = whole_part(times.from.min(times.to)).min(end - 1);
        if strings.len() < 2 {
            return Err(cannot("its derivation has no steps"));
        }
        strings.truncate(end + 1);
        let strings: Vec<Arc<DerivedString>> = strings.split_off(first).into_iter().map(Arc::new).collect();
        let newest = strings.last().ok_or_else(|| cannot("its derivation has no steps"))?;
        let roles = roles(grammar, newest, &options, limits)?;
        let mut out = Self {
            plant: Plant::default(),
            warnings: newest.warnings.clone(),
            output: newest.output.clone(),
            modules: newest.module_count(),
            grammar: grammar.clone(),
            options,
            limits: limits.clone(),
            roles,
            first: saturating_index(first),
            levels: Vec::new(),
            elements: Vec::new(),
            nodes: Vec::new(),
            organs: Vec::new(),
            times,
            whole_steps: clip.whole_steps,
        };
        out.add_levels(&strings)?;
        out.collect_elements()?;
        if out.plant.axes.is_empty() {
            return Err(cannot("its last string draws no segment"));
        }
        // Validation must not drop nodes, because each belongs to elements.
        osier_scene::plant::validate(&mut out.plant)?;
        if out.plant.nodes.len() != out.nodes.len() {
            return Err(cannot("it has segments of nearly no length"));
        }
        Ok(out)
    }

    fn cannot(&self, message: &str) -> osier_base::Error {
        refused(&self.grammar, message, "clip_steps = \"unveil\" uncovers the grown plant")
    }

    fn place_of_drawing(&self) -> DrawPlace<'_> {
        DrawPlace { grammar: &self.grammar, options: &self.options, limits: &self.limits }
    }

    /// Finds how the modules of each string were made from the string before it.
    fn add_levels(&mut self, strings: &[Arc<DerivedString>]) -> Result<()> {
        for (k, string) in strings.iter().enumerate() {
            let (mut origins, mut links) = (Arc::default(), Vec::new());
            if let Some(before) = k.checked_sub(1).and_then(|i| strings.get(i)) {
                let between = DerivedString::between(&self.grammar, before, (**string).clone(), 0.0);
                if let Some(step) = between.last_step() {
                    if step.is_incomplete() {
                        return Err(self.cannot("a step decomposes more modules than can be followed"));
                    }
                    links = module_links(&self.grammar, &between, step, &self.roles);
                    origins = Arc::clone(&step.origins);
                }
            }
            let radii = StepRadii { first: Vec::new(), radii: Vec::new() };
            self.levels.push(Level { string: Arc::clone(string), radii, origins, links });
        }
        Ok(())
    }

    /// Draws all strings, from the last to the first, and collects the segments and organs that are seen at some time.
    fn collect_elements(&mut self) -> Result<()> {
        // Of the string drawn before, which comes after this one: what it has made of steps and organs.
        let mut later: Option<Collected> = None;
        for level in (0..self.levels.len()).rev() {
            let string = Arc::clone(&self.levels[level].string);
            let mut drawn = self.place_of_drawing().draw(&string, Detail::Trace)?;
            let modules = string.modules.len();
            let first_step = first_of_module(drawn.trace.steps.iter().map(|step| step.module), modules);
            let first_organ = first_of_module(drawn.trace.organs.iter().map(|organ| organ.module), modules);
            let radii = drawn.radii_of_steps().ok_or_else(|| self.cannot("it has segments of nearly no length"))?;
            self.levels[level].radii = StepRadii { first: first_step, radii };
            if drawn.drawing.plant.protos.iter().any(|p| p.name.starts_with("cylinder") || p.name.starts_with("patch"))
            {
                return Err(self.cannot("it draws generalised cylinders or patches, whose shape changes"));
            }
            let collected = match later {
                None => self.take_last_plant(&mut drawn, level, first_organ),
                Some(later) => self.add_what_goes(&drawn, level, first_organ, &later)?,
            };
            later = Some(collected);
        }
        Ok(())
    }

    /// The plant of the last string, which the plant of the clip begins with.
    fn take_last_plant(&mut self, drawn: &mut TracedDrawing, level: usize, first_organ: Vec<u32>) -> Collected {
        self.warnings.append(&mut drawn.drawing.warnings);
        self.output.push_str(&drawn.drawing.output);
        self.plant = std::mem::take(&mut drawn.drawing.plant);
        let mut is_shown = vec![false; drawn.trace.steps.len()];
        let mut element_of = vec![NONE; drawn.trace.steps.len()];
        self.nodes = vec![NodeSource { ends: NONE, begins: NONE }; self.plant.nodes.len()];
        let segments: Vec<usize> = self.plant.axes.iter().flat_map(|axis| self.plant.nodes_of(axis).skip(1)).collect();
        for k in segments {
            let step = to_usize(drawn.sources.steps[k]);
            let Some(traced) = drawn.trace.steps.get(step) else { continue };
            let item = saturating_index(step) - self.levels[level].radii.first[to_usize(traced.module)];
            let element = Element { level: saturating_index(level), module: traced.module, item };
            element_of[step] = saturating_index(self.elements.len());
            self.elements.push(element);
            is_shown[step] = true;
            (self.nodes[k - 1].begins, self.nodes[k].ends) = (element_of[step], element_of[step]);
        }
        let organs = self.plant.organs.iter().zip(&drawn.sources.organs);
        let source = |(organ, number): (&Organ, &u32)| {
            let element = organ_element(drawn, level, *number, &first_organ)?;
            Some(OrganSource { element, scale: f64::from(organ.scale) })
        };
        self.organs = organs.filter_map(source).collect();
        Collected { is_shown, first_organ, modules_of_organs: modules_of_organs(&drawn.trace) }
    }

    /// Adds the segments and organs of a string that the next one does not have; `later`: what is known of the next one.
    fn add_what_goes(
        &mut self,
        drawn: &TracedDrawing,
        level: usize,
        first_organ: Vec<u32>,
        later: &Collected,
    ) -> Result<Collected> {
        let (now, next) = (&self.levels[level], &self.levels[level + 1]);
        let steps = drawn.trace.steps.len();
        let mut is_drawn = vec![false; steps];
        for (step, radii) in is_drawn.iter_mut().zip(&now.radii.radii) {
            *step = radii[1] > 0.0;
        }
        let (mut has_next, mut is_shown) = (vec![false; steps], vec![false; steps]);
        // Elements that are added, by the step of this string that they lie on, with the shares of its length.
        let mut added: BTreeMap<u32, Vec<(Element, [f32; 2])>> = BTreeMap::new();
        // Steps of the next string that are not drawn, or not for long, though this string draws them.
        for module in 0..saturating_index(next.string.modules.len()) {
            let range = next.radii.first[to_usize(module)]..next.radii.first[to_usize(module) + 1];
            for (item, later_step) in (0_u32..).zip(range) {
                let (of, shares) = match next.links[to_usize(module)] {
                    ModuleLink::Same(i) => (now.radii.index(i, item), [0.0, 1.0]),
                    ModuleLink::Part { of, shares } => (now.radii.index(of, 0), shares),
                    ModuleLink::Born { .. } => (None, [0.0, 1.0]),
                };
                let Some(of) = of else { continue };
                has_next[of] = true;
                if later.is_shown[to_usize(later_step)] {
                    is_shown[of] = true;
                } else if is_drawn[of] {
                    let element = Element { level: saturating_index(level + 1), module, item };
                    added.entry(saturating_index(of)).or_default().push((element, shares));
                    is_shown[of] = true;
                }
            }
        }
        // Steps of this string that the next one removes.
        for step in (0..steps).filter(|step| !has_next[*step] && is_drawn[*step]) {
            let module = drawn.trace.steps[step].module;
            let item = saturating_index(step) - now.radii.first[to_usize(module)];
            let element = Element { level: saturating_index(level), module, item };
            added.entry(saturating_index(step)).or_default().push((element, [0.0, 1.0]));
            is_shown[step] = true;
        }
        self.add_axes(drawn, &added);
        // Organs that the next string does not have.
        let mut has_organ = vec![false; drawn.trace.organs.len()];
        let next = &self.levels[level + 1];
        for (number, module) in (0_u32..).zip(&later.modules_of_organs) {
            if let ModuleLink::Same(i) = next.links[to_usize(*module)] {
                let item = number - later.first_organ[to_usize(*module)];
                let range = first_organ[to_usize(i)]..first_organ[to_usize(i) + 1];
                if let Some(organ) =
                    has_organ.get_mut(to_usize(range.start + item)).filter(|_| item < range.end - range.start)
                {
                    *organ = true;
                }
            }
        }
        for (organ, number) in drawn.drawing.plant.organs.iter().zip(&drawn.sources.organs) {
            if !has_organ.get(to_usize(*number)).copied().unwrap_or(true)
                && let Some(element) = organ_element(drawn, level, *number, &first_organ)
            {
                self.add_organ(&drawn.drawing.plant, organ, element)?;
            }
        }
        Ok(Collected { is_shown, first_organ, modules_of_organs: modules_of_organs(&drawn.trace) })
    }

    /// Adds axes of elements that lie on the steps of a plant: a chain of neighbours is an axis without a parent, of an order above 0.
    fn add_axes(&mut self, drawn: &TracedDrawing, added: &BTreeMap<u32, Vec<(Element, [f32; 2])>>) {
        let plant = &drawn.drawing.plant;
        for axis in plant.axes.iter().filter(|_| !added.is_empty()) {
            let mut chain = NewAxis::default();
            for k in plant.nodes_of(axis).skip(1) {
                for (element, shares) in added.get(&drawn.sources.steps[k]).into_iter().flatten() {
                    let ends = shares.map(|share| NewNode::between(plant, k, share));
                    if ends[0].p.distance(ends[1].p) < MIN_SEGMENT {
                        continue;
                    }
                    if chain.nodes.last().is_none_or(|last| last.p.distance(ends[0].p) > MIN_SEGMENT) {
                        self.add_axis(axis, std::mem::take(&mut chain));
                        chain.nodes.push(ends[0]);
                    }
                    chain.nodes.push(ends[1]);
                    chain.elements.push(*element);
                }
            }
            self.add_axis(axis, chain);
        }
    }

    /// Adds one axis made of a part of the axis `of`; nothing for an empty one.
    fn add_axis(&mut self, of: &Axis, chain: NewAxis) {
        let Some(element) = chain.elements.first() else { return };
        let nodes = &mut self.plant.nodes;
        let first = nodes.len();
        let mut s = 0.0;
        for (k, node) in chain.nodes.iter().enumerate() {
            s += if k > 0 { node.p.distance(chain.nodes[k - 1].p) } else { 0.0 };
            nodes.p.push(node.p);
            nodes.q.push(node.q);
            nodes.r.push(node.r.max(MIN_RADIUS));
            nodes.s.push(s);
            nodes.birth.push(node.birth);
            nodes.color.push(node.color);
        }
        let id = mix64(&[of.id, word("removed"), u64::from(element.level), u64::from(element.module)]);
        self.plant.axes.push(Axis {
            id,
            parent: NONE,
            parent_s: 0.0,
            order: of.order.max(1),
            first: saturating_index(first),
            count: saturating_index(chain.nodes.len()),
            length: s,
            s_exposed: 0.0,
            fork: NONE,
            ..of.clone()
        });
        let mut ends = NONE;
        for element in chain.elements {
            let begins = saturating_index(self.elements.len());
            self.elements.push(element);
            self.nodes.push(NodeSource { ends, begins });
            ends = begins;
        }
        self.nodes.push(NodeSource { ends, begins: NONE });
    }

    /// Adds an organ of the plant `of` as it is there. It is held by the first axis, since what carried it may have gone, too.
    fn add_organ(&mut self, of: &Plant, organ: &Organ, element: Element) -> Result<()> {
        let Some(axis) = self.plant.axes.first() else {
            return Err(self.cannot("its last string draws no segment"));
        };
        let proto = &of.protos[usize::from(organ.proto)];
        let known = self.plant.protos.iter().position(|p| is_same(p, proto));
        let index = match known {
            Some(index) => index,
            None => {
                let mut proto = proto.clone();
                let mut number = self.plant.protos.len();
                while self.plant.protos.iter().any(|p| p.name == proto.name) {
                    proto.name = format!("{}_{number}", of.protos[usize::from(organ.proto)].name);
                    number += 1;
                }
                self.plant.protos.push(proto);
                self.plant.protos.len() - 1
            }
        };
        let (pivot, orientation) = of.organ_site(organ);
        let site = self.plant.frame(axis, 0.0);
        let back = site.q.inverse();
        let proto = u16::try_from(index).map_err(|_| self.cannot("it has more than 65,535 different shapes"))?;
        let q = (back * orientation).normalize();
        let offset = back * (pivot - orientation * Vec3::Y * organ.petiole - site.p);
        self.plant.organs.push(Organ { axis: 0, s: 0.0, offset, q, proto, ..organ.clone() });
        self.organs.push(OrganSource { element, scale: f64::from(organ.scale) });
        Ok(())
    }

    /// Where an element is in the string of a level.
    fn place(&self, element: Element, level: usize) -> Place {
        let own = to_usize(element.level);
        let mut place = Place::Live { module: element.module, item: element.item, shares: [0.0, 1.0] };
        for k in (level + 1..=own).rev() {
            place = self.levels[k].place_before(place);
        }
        // The string no longer has it: the first module that was made of later modules than its own.
        for k in own + 1..=level {
            let (Place::Live { module, .. } | Place::Point { module, .. }) = place;
            let next = self.levels[k].links.partition_point(|link| link.index() < module);
            let index = saturating_index(next);
            place = match (place, self.levels[k].links.get(next)) {
                // A move in place of a segment is there, though it is not drawn.
                (Place::Live { item, shares, .. }, Some(ModuleLink::Same(i))) if *i == module => {
                    Place::Live { module: index, item, shares }
                }
                _ => Place::Point { module: index, share: 0.0 },
            };
        }
        place
    }

    /// Draws the part of a step that belongs to a time.
    fn step_at(&self, time: f32) -> Result<StepNow> {
        let since = f64::from(time) - f64::from(self.first);
        let since = if self.whole_steps { since.max(0.0).floor() } else { since.max(0.0) };
        let before = whole_part(since).min(self.levels.len() - 2);
        let part = (since - before as f64).clamp(0.0, 1.0);
        let (from, to) = (&self.levels[before], &self.levels[before + 1]);
        let step = LastStep { before: Arc::clone(&from.string), origins: Arc::clone(&to.origins), part };
        let growing = GrowingString::new(&self.grammar, &to.string, &step, &self.roles);
        let trace = self.place_of_drawing().trace(&growing)?;
        let modules = growing.growth.len();
        Ok(StepNow {
            level: before + 1,
            part: math::narrow(part),
            first_step: first_of_module(trace.steps.iter().map(|step| step.module), modules),
            first_organ: first_of_module(trace.organs.iter().map(|organ| organ.module), modules),
            growing,
            trace,
        })
    }

    /// An element in a part of a step.
    fn element_now(&self, element: Element, now: &StepNow) -> ElementNow {
        let found = now.found(self, element);
        let Found { module, place, .. } = found;
        let live = match place {
            Place::Live { item, shares, .. } => item_index(&now.first_step, module, item).map(|index| (index, shares)),
            Place::Point { .. } => None,
        };
        let Some((index, shares)) = live else {
            let p = now.point(module, place);
            return ElementNow { from: p, to: p, frame: None, radii: [0.0; 2] };
        };
        let step = &now.trace.steps[index];
        let [from, to] = shares.map(|share| step.from.lerp(step.to, f64::from(share)));
        let along = step.to - step.from;
        let direction = if along.length() > MIN_DIRECTION { along.normalize() } else { step.heading };
        let radii = self.radii_now(found, now);
        ElementNow { from, to, frame: Some((direction, step.left)), radii }
    }

    /// Radii at both ends of an element: between those before and after the step, in proportion to its part.
    fn radii_now(&self, found: Found, now: &StepNow) -> [f32; 2] {
        let [before, after] = [&self.levels[now.level - 1].radii, &self.levels[now.level].radii];
        let Place::Live { module, item, shares } = found.place else { return [0.0; 2] };
        if found.is_removed {
            return before.between(module, item, shares).map(|r| r * (1.0 - now.part));
        }
        let earlier = match self.levels[now.level].place_before(found.place) {
            Place::Live { module, item, shares } => before.between(module, item, shares),
            Place::Point { .. } => [0.0; 2],
        };
        let later = after.between(module, item, shares);
        [0, 1].map(|end| math::lerp(earlier[end], later[end], now.part))
    }

    /// All nodes in a part of a step, without leaves.
    fn nodes_now(&self, now: &StepNow) -> PoseNow {
        let elements: Vec<ElementNow> = self.elements.iter().map(|element| self.element_now(*element, now)).collect();
        let get = |index: u32| elements.get(to_usize(index));
        let mut pose = PoseNow { q: self.plant.nodes.q.clone(), ..PoseNow::default() };
        for source in &self.nodes {
            let (ends, begins) = (get(source.ends), get(source.begins));
            let p = ends.map(|e| e.to).or(begins.map(|e| e.from)).unwrap_or(DVec3::ZERO);
            pose.p.push(narrow(p));
            // At a node between two steps the thicker one counts.
            let radii = [ends.map_or(0.0, |e| e.radii[1]), begins.map_or(0.0, |e| e.radii[0])];
            pose.r.push(radii[0].max(radii[1]));
        }
        for axis in &self.plant.axes {
            self.set_frames(axis, &get, &mut pose.q);
        }
        pose
    }

    /// Sets the frames of the nodes of an axis: along the bisector of the nearest elements before and after the node that exist. An axis
    /// of which nothing exists keeps its frames.
    fn set_frames<'a>(&self, axis: &Axis, get: &impl Fn(u32) -> Option<&'a ElementNow>, q: &mut [Quat]) {
        let range = self.plant.nodes_of(axis);
        let frame = |index: u32| get(index).and_then(|element| element.frame);
        let mut outgoing = vec![None; range.len()];
        let mut next = None;
        for (k, slot) in range.clone().zip(outgoing.iter_mut()).rev() {
            next = frame(self.nodes[k].begins).or(next);
            *slot = next;
        }
        let mut last: Option<(DVec3, DVec3)> = None;
        for (k, after) in range.zip(outgoing) {
            last = frame(self.nodes[k].ends).or(last);
            if let Some((_, left)) = last.or(after) {
                let source = FrameSource { incoming: last.map(|f| f.0), outgoing: after.map(|f| f.0), left };
                q[k] = source.frame();
            }
        }
    }

    /// An organ in a part of a step; of size 0 where it does not exist.
    fn organ_now(&self, source: &OrganSource, organ: &Organ, now: &StepNow) -> LeafNow {
        let Found { module, place, .. } = now.found(self, source.element);
        let live = match place {
            Place::Live { item, .. } => item_index(&now.first_organ, module, item),
            Place::Point { .. } => None,
        };
        match live.map(|index| &now.trace.organs[index]) {
            Some(traced) => {
                let orientation = narrow_quat(traced.pose.q);
                LeafNow {
                    position: narrow(traced.pose.p) + orientation * Vec3::Y * math::narrow(traced.size.petiole),
                    orientation,
                    size: math::narrow(traced.size.scale / source.scale.max(f64::from(f32::MIN_POSITIVE))),
                }
            }
            None => {
                let orientation = self.plant.organ_site(organ).1;
                LeafNow { position: narrow(now.point(module, place)), orientation, size: 0.0 }
            }
        }
    }
}

impl PosedGrowth for DevelopmentClip {
    fn plant(&self) -> &Plant {
        &self.plant
    }

    fn times(&self) -> ClipTimes {
        self.times
    }

    fn pose(&self, time: f32) -> Result<PoseNow> {
        let now = self.step_at(time)?;
        let mut pose = self.nodes_now(&now);
        let organs = self.organs.iter().zip(&self.plant.organs);
        pose.leaves = organs.map(|(source, organ)| self.organ_now(source, organ, &now)).collect();
        Ok(pose)
    }

    fn node_positions(&self, time: f32) -> Result<Vec<Vec3>> {
        let now = self.step_at(time)?;
        Ok(self.nodes_now(&now).p)
    }

    fn plant_at_end(&self, limits: &Limits) -> Result<Plant> {
        let place = DrawPlace { limits, ..self.place_of_drawing() };
        let last = self.times.from.max(self.times.to) - f64::from(self.first);
        let whole = whole_part(last).min(self.levels.len() - 1);
        let part = if self.whole_steps { 0.0 } else { last - whole as f64 };
        match self.levels.get(whole + 1).filter(|_| part > 0.0) {
            Some(to) => {
                let before = Arc::clone(&self.levels[whole].string);
                let step = LastStep { before, origins: Arc::clone(&to.origins), part };
                Ok(place.draw_part(&to.string, &step)?.plant)
            }
            None => Ok(place.draw(&self.levels[whole].string, Detail::Plant)?.drawing.plant),
        }
    }
}

impl StepNow {
    /// The place of an element in the string that is drawn, and the index of its module there. That of an element that the step removes
    /// is its place before the step.
    fn found(&self, clip: &DevelopmentClip, element: Element) -> Found {
        // What the step removes is drawn, too; what went before it lies at its beginning.
        if to_usize(element.level) < self.level {
            let place = clip.place(element, self.level - 1);
            let (Place::Live { module, .. } | Place::Point { module, .. }) = place;
            let index = self.growing.of_before.get(to_usize(module)).copied().unwrap_or(NONE);
            if index != NONE {
                return Found { module: to_usize(index), place, is_removed: true };
            }
        }
        let place = clip.place(element, self.level);
        let (Place::Live { module, .. } | Place::Point { module, .. }) = place;
        let index = self.growing.of_after.get(to_usize(module)).copied();
        Found { module: index.map_or(self.growing.growth.len(), to_usize), place, is_removed: false }
    }

    /// Position of what does not exist, by its place and the index of its module in the string that is drawn.
    fn point(&self, module: usize, place: Place) -> DVec3 {
        let share = match place {
            Place::Point { share, .. } => share,
            Place::Live { .. } => 1.0,
        };
        let [from, to] = [self.trace.position_before(module), self.trace.position_after(module)];
        if share > 0.0 { from.lerp(to, f64::from(share)) } else { from }
    }
}

impl Level {
    /// The place in the string before this one of what has a place in this one.
    fn place_before(&self, place: Place) -> Place {
        let (Place::Live { module, .. } | Place::Point { module, .. }) = place;
        let Some(link) = self.links.get(to_usize(module)) else { return place };
        let within = |[a, b]: [f32; 2], share: f32| a + (b - a) * share;
        match (place, *link) {
            (Place::Live { item, shares, .. }, ModuleLink::Same(module)) => Place::Live { module, item, shares },
            (Place::Live { shares, .. }, ModuleLink::Part { of, shares: of_step }) => {
                Place::Live { module: of, item: 0, shares: shares.map(|share| within(of_step, share)) }
            }
            (Place::Point { share, .. }, ModuleLink::Same(module)) => Place::Point { module, share },
            (Place::Point { share, .. }, ModuleLink::Part { of, shares }) => {
                Place::Point { module: of, share: within(shares, share) }
            }
            (_, ModuleLink::Born { at, share }) => Place::Point { module: at, share },
        }
    }
}

/// What is known of a string when the one before it is drawn.
struct Collected {
    /// For each step whether the plant of the clip has an element of it or of what it becomes.
    is_shown: Vec<bool>,
    /// For each module the index of its first organ.
    first_organ: Vec<u32>,
    modules_of_organs: Vec<u32>,
}

/// A node to be added.
#[derive(Debug, Clone, Copy)]
struct NewNode {
    p: Vec3,
    q: Quat,
    r: f32,
    birth: f32,
    color: u16,
}

impl NewNode {
    /// The point of a plant at a share, 0 to 1, of the segment that ends at node `k`.
    fn between(plant: &Plant, k: usize, share: f32) -> Self {
        let nodes = &plant.nodes;
        Self {
            p: nodes.p[k - 1].lerp(nodes.p[k], share),
            q: math::nlerp(nodes.q[k - 1], nodes.q[k], share),
            r: math::lerp(nodes.r[k - 1], nodes.r[k], share),
            birth: nodes.birth[k],
            color: nodes.color[k],
        }
    }
}

/// An axis to be added: its nodes, and the elements between them.
#[derive(Debug, Default)]
struct NewAxis {
    nodes: Vec<NewNode>,
    elements: Vec<Element>,
}

/// Index of item number `item` of a module in a list of items; `None` if the module has fewer. `first`: of each module.
fn item_index(first: &[u32], module: usize, item: u32) -> Option<usize> {
    let index = first.get(module)? + item;
    (index < *first.get(module + 1)?).then_some(to_usize(index))
}

/// Whether two prototypes have one name, form and material.
fn is_same(a: &Proto, b: &Proto) -> bool {
    let (x, y) = (&*a.mesh, &*b.mesh);
    let materials = |mesh: &Mesh| mesh.subsets.iter().map(|subset| subset.material).collect::<Vec<_>>();
    a.name == b.name && x.points == y.points && x.triangles == y.triangles && materials(x) == materials(y)
}

/// The element of organ `number` of a drawing.
fn organ_element(drawn: &TracedDrawing, level: usize, number: u32, first_organ: &[u32]) -> Option<Element> {
    let module = drawn.trace.organs.get(to_usize(number))?.module;
    let item = number - first_organ.get(to_usize(module))?;
    Some(Element { level: saturating_index(level), module, item })
}

fn modules_of_organs(trace: &DrawingTrace) -> Vec<u32> {
    trace.organs.iter().map(|organ| organ.module).collect()
}
