//! The turtle: a string of modules becomes a [`Plant`].
//!
//! Drawn steps of one bracket level are one axis, `[` opens a child at the current node, `~c` and filled shapes become
//! organs. World: metres, +Y up; the turtle starts at the origin heading up.

mod bound_actions;
mod builder;
mod commands;
mod cylinders;
mod development;
mod dialect_commands;
mod dialects;
mod extended;
mod frame;
mod guides;
mod interpreter;
mod options;
mod organs;
mod paint;
mod patches;
mod pixels;
mod prototypes;
mod queries;
mod step_part;
mod trace;
mod tropism;

pub(super) use builder::set_exposed_lengths;
use builder::{PlantBuilder, PlantSources};
pub use cylinders::Contour;
pub use development::{DevelopmentClip, DevelopmentOptions};
pub use options::{OrganSpec, RadiusModel, STALK, Tropism, TurtleOptions};
pub use paint::{Paint, TURTLE_COLOR};
pub use patches::{patch_mesh, triangle_mesh};
pub use queries::{derive, derive_text};

use super::radii;
use interpreter::Turtle;
use osier_base::Result;
use osier_base::convert::{saturating_index, to_usize};
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math;
use osier_grammar::{
    BindingEvaluator, DerivedString, Dialect, Grammar, Interpretation, LastStep, interpret, interpret_modules,
};
use osier_scene::plant::{NONE, Plant};
use step_part::{GrowingString, ModuleGrowth, ModuleLink, module_links};
use trace::{DrawingTrace, first_of_module};

/// A plant that a turtle drew, with the warnings and the output of its grammar.
#[derive(Debug)]
pub struct Drawing {
    /// The plant, validated.
    pub plant: Plant,
    /// Warnings of the interpretation and of the homomorphism.
    pub warnings: Vec<Diagnostic>,
    /// What `printf` in the homomorphism wrote.
    pub output: String,
}

/// Interprets a derived string, as [`draw`] does.
/// Returns the plant and the warnings.
/// # Errors
/// Those of [`draw`].
pub fn grow(
    grammar: &Grammar,
    derived: &DerivedString,
    options: &TurtleOptions,
    limits: &Limits,
) -> Result<(Plant, Vec<Diagnostic>)> {
    draw(grammar, derived, options, limits).map(|drawing| (drawing.plant, drawing.warnings))
}

/// Interprets a derived string.
/// # Errors
/// `Input` with L043 for a command that is not available, L051 beyond a limit; the errors of `plant::validate`.
/// Source: cpfg's turtle; frame, turns, taper and tropisms as in the lines of each command.
pub fn draw(grammar: &Grammar, derived: &DerivedString, options: &TurtleOptions, limits: &Limits) -> Result<Drawing> {
    let place = DrawPlace { grammar, options, limits };
    match derived.last_step() {
        None => Ok(place.draw(derived, Detail::Plant)?.drawing),
        Some(step) => place.draw_part(derived, step),
    }
}

/// What a string is drawn with.
#[derive(Clone, Copy)]
struct DrawPlace<'a> {
    grammar: &'a Grammar,
    options: &'a TurtleOptions,
    limits: &'a Limits,
}

/// What is wanted of a drawing beside the plant.
#[derive(Clone, Copy)]
enum Detail<'a> {
    Plant,
    /// What each module does.
    Trace,
    /// What each module does, if it has grown in part.
    Growing(&'a [ModuleGrowth]),
}

/// A drawing with what its nodes and organs were drawn as; both are empty for [`Detail::Plant`].
struct TracedDrawing {
    drawing: Drawing,
    trace: DrawingTrace,
    sources: PlantSources,
}

impl TracedDrawing {
    /// Radii at the beginning and the end of each traced step, m; 0 for a step that draws nothing. `None` if validation has dropped
    /// nodes, so that it is not known which are left.
    fn radii_of_steps(&self) -> Option<Vec<[f32; 2]>> {
        let plant = &self.drawing.plant;
        if plant.nodes.len() != self.sources.steps.len() {
            return None;
        }
        let mut radii = vec![[0.0; 2]; self.trace.steps.len()];
        for k in plant.axes.iter().flat_map(|axis| plant.nodes_of(axis).skip(1)) {
            if let Some(step) = radii.get_mut(to_usize(self.sources.steps[k])) {
                *step = [plant.nodes.r[k - 1], plant.nodes.r[k]];
            }
        }
        Some(radii)
    }
}

/// Radii of the steps of a string that is drawn wholly.
#[derive(Debug)]
struct StepRadii {
    /// For each module the index of its first step.
    first: Vec<u32>,
    /// Radii at the beginning and the end of each step, m; 0 for a step that draws nothing.
    radii: Vec<[f32; 2]>,
}

impl StepRadii {
    /// Index of step number `item` of a module; `None` if it has fewer.
    fn index(&self, module: u32, item: u32) -> Option<usize> {
        let module = to_usize(module);
        let index = self.first.get(module)? + item;
        (index < *self.first.get(module + 1)?).then_some(to_usize(index))
    }

    /// Radii, m, between two shares of the length of step number `item` of a module; 0 without such a step.
    fn between(&self, module: u32, item: u32, shares: [f32; 2]) -> [f32; 2] {
        let found = self.index(module, item).and_then(|index| self.radii.get(index));
        found.map_or([0.0; 2], |[from, to]| shares.map(|share| math::lerp(*from, *to, share)))
    }
}

impl DrawPlace<'_> {
    /// Interprets every module of a string in order; limits and forbidden commands are reported after the last one.
    fn interpret(&self, string: &DerivedString, detail: Detail<'_>) -> Result<(Turtle<'_>, Interpretation)> {
        let Self { grammar, options, limits } = *self;
        let bindings = BindingEvaluator::new(grammar, string, limits);
        let mut turtle = Turtle::new(grammar, bindings, options, limits);
        turtle.builder = PlantBuilder::for_modules(string.module_count());
        let growth = match detail {
            Detail::Plant => {
                let interpreted = interpret(grammar, string, limits, |m| turtle.module(m))?;
                turtle.end();
                return Ok((turtle, interpreted));
            }
            Detail::Trace => &[],
            Detail::Growing(growth) => growth,
        };
        turtle.trace = Some(Box::default());
        turtle.builder.keep_sources();
        let interpreted =
            interpret_modules(grammar, string, limits, |m, index| turtle.growing_module(m, index, growth))?;
        turtle.end();
        let p = turtle.s.p;
        if let Some(trace) = &mut turtle.trace {
            trace.end(string.modules.len(), p);
        }
        Ok((turtle, interpreted))
    }

    /// Draws a string without its last step in part, as it is.
    fn draw(&self, string: &DerivedString, detail: Detail<'_>) -> Result<TracedDrawing> {
        let (turtle, interpreted) = self.interpret(string, detail)?;
        self.finish(turtle, interpreted, string)
    }

    /// What each module of a string does that has grown in part.
    fn trace(&self, growing: &GrowingString) -> Result<DrawingTrace> {
        let (mut turtle, _) = self.interpret(&growing.string, Detail::Growing(&growing.growth))?;
        turtle.diagnostics()?;
        Ok(turtle.trace.take().map(|trace| *trace).unwrap_or_default())
    }

    /// Draws a string of whose last step only a part is drawn. Radii lie between those before and after the step, in proportion.
    fn draw_part(&self, derived: &DerivedString, step: &LastStep) -> Result<Drawing> {
        let roles = queries::roles(self.grammar, derived, self.options, self.limits)?;
        let growing = GrowingString::new(self.grammar, derived, step, &roles);
        let mut drawn = self.draw(&growing.string, Detail::Growing(&growing.growth))?;
        let whole = derived.with_modules(derived.modules.clone());
        let wholes = [self.step_radii(&step.before)?, self.step_radii(&whole)?];
        if let ([Some(before), Some(after)], Some(_)) = (&wholes, drawn.radii_of_steps()) {
            let links = module_links(self.grammar, derived, step, &roles);
            set_radii(&mut drawn, [before, after], &growing, &links, step.part);
            osier_scene::plant::validate(&mut drawn.drawing.plant)?;
            set_exposed_lengths(&mut drawn.drawing.plant);
        }
        Ok(drawn.drawing)
    }

    /// The radii of all steps of a string, drawn wholly; `None` if validation has dropped nodes.
    fn step_radii(&self, string: &DerivedString) -> Result<Option<StepRadii>> {
        let drawn = self.draw(string, Detail::Trace)?;
        let first = first_of_module(drawn.trace.steps.iter().map(|step| step.module), string.modules.len());
        Ok(drawn.radii_of_steps().map(|radii| StepRadii { first, radii }))
    }

    /// The plant that a turtle has drawn, with its radii.
    fn finish(
        &self,
        mut turtle: Turtle<'_>,
        interpreted: Interpretation,
        derived: &DerivedString,
    ) -> Result<TracedDrawing> {
        let Self { grammar, options, limits } = *self;
        let Interpretation { mut warnings, output } = interpreted;
        warnings.extend(turtle.diagnostics()?);
        warnings.extend(turtle.bindings.warnings(grammar));
        // The plant in canonical order (axes depth first, organs by axis and arc length), then its radii: those that the
        // string sets, or a branching model (pipe model, taper) that overwrites them.
        let (sets_widths, symbol_place) = (turtle.sets_widths, grammar.place_of(None, 'F'));
        let dialect = turtle.dialect.kind;
        let draws_lines = dialect == Dialect::Fractint;
        if turtle.builder.is_empty() {
            warnings.push(nothing_drawn(grammar, derived, limits)?);
        }
        let trace = turtle.trace.take().map(|trace| *trace).unwrap_or_default();
        let (mut plant, sources) = turtle.builder.finish(derived.plant_id, derived.seed, derived.steps, options);
        match options.radii {
            RadiusModel::Pipe(p) => radii::pipe(&mut plant, &p),
            RadiusModel::Taper(t) => radii::taper(&mut plant, &t),
            RadiusModel::Pixels => {
                let pixel = pixels::pixel_size(&plant);
                pixels::scale_widths(&mut plant, pixel / options.unit_m);
                warnings.push(pixels::warning(pixel, symbol_place));
            }
            RadiusModel::Auto if draws_lines => {}
            // Lines that do not branch are no tree: they get one width.
            RadiusModel::Auto if !sets_widths && plant.axes.iter().all(|a| a.parent == NONE) => {
                let pixel = pixels::pixel_size(&plant);
                pixels::set_width(&mut plant, pixel);
            }
            RadiusModel::Auto if !sets_widths => {
                let tip = pixels::visible_tip(&plant, radii::Pipe::default().tip);
                radii::pipe(&mut plant, &radii::Pipe { tip, ..radii::Pipe::default() });
            }
            RadiusModel::Hairs(t) if !sets_widths => radii::taper(&mut plant, &t),
            RadiusModel::Auto | RadiusModel::Widths | RadiusModel::Hairs(_) => {}
        }
        // Validation may thin children; a grammar that halves its widths intends that, so its report is not a warning.
        osier_scene::plant::validate(&mut plant)?;
        // Lines of a drawing have one width, which the validation would thin from branch to branch.
        if draws_lines && matches!(options.radii, RadiusModel::Auto) {
            dialects::set_line_radius(&mut plant);
        }
        if dialect == Dialect::LParser && matches!(options.radii, RadiusModel::Auto) {
            dialects::set_least_radius(&mut plant);
        }
        set_exposed_lengths(&mut plant);
        // Only thickness distinguishes shoots from old wood, since strings name no materials for axes.
        for axis in &mut plant.axes {
            let base = plant.nodes.r.get(axis.first as usize).copied().unwrap_or(0.0);
            let thin = f64::from(base) < options.shoot_radius;
            axis.material = options.shoot_material.filter(|_| thin).unwrap_or(options.axis_material);
        }
        Ok(TracedDrawing { drawing: Drawing { plant, warnings, output }, trace, sources })
    }
}

/// Sets the radii of a plant of which the last step is drawn in part: those before the step, and in proportion to the part those after
/// it. `wholes`: the radii of both strings; `links`: of the modules after the step.
fn set_radii(
    drawn: &mut TracedDrawing,
    wholes: [&StepRadii; 2],
    growing: &GrowingString,
    links: &[ModuleLink],
    part: f64,
) {
    let first = first_of_module(drawn.trace.steps.iter().map(|step| step.module), growing.growth.len());
    let mut is_of_before = vec![false; growing.growth.len()];
    let mut origin = vec![NONE; growing.growth.len()];
    for (indices, of_before) in [(&growing.of_after, false), (&growing.of_before, true)] {
        for (i, k) in (0_u32..).zip(indices).filter(|(_, k)| **k != NONE) {
            (origin[to_usize(*k)], is_of_before[to_usize(*k)]) = (i, of_before);
        }
    }
    let radii_now = |index: usize| -> [f32; 2] {
        let Some(step) = drawn.trace.steps.get(index) else { return [0.0; 2] };
        let module = to_usize(step.module);
        let item = saturating_index(index) - first[module];
        let i = origin[module];
        if is_of_before[module] {
            return wholes[0].between(i, item, [0.0, 1.0]).map(|r| r * math::narrow(1.0 - part));
        }
        let before = match links.get(to_usize(i)) {
            Some(ModuleLink::Same(j)) => wholes[0].between(*j, item, [0.0, 1.0]),
            Some(ModuleLink::Part { of, shares }) => wholes[0].between(*of, 0, *shares),
            _ => [0.0; 2],
        };
        let after = wholes[1].between(i, item, [0.0, 1.0]);
        [0, 1].map(|end| math::lerp(before[end], after[end], math::narrow(part)))
    };
    let plant = &drawn.drawing.plant;
    let mut radii = vec![0.0_f32; plant.nodes.len()];
    // At a node between two steps the thicker one counts.
    for k in plant.axes.iter().flat_map(|axis| plant.nodes_of(axis).skip(1)) {
        let [from, to] = radii_now(to_usize(drawn.sources.steps[k]));
        (radii[k - 1], radii[k]) = (radii[k - 1].max(from), to);
    }
    drawn.drawing.plant.nodes.r = radii.into_iter().map(|r| r.max(MIN_RADIUS)).collect();
}

/// Thinnest radius of what grows or shrinks, m: a plant has no radius of 0.
const MIN_RADIUS: f32 = 1e-6;

/// Number of symbols that L037 names, the most frequent first.
const NAMED_SYMBOLS: usize = 8;

/// L037 for a string that draws nothing, with the symbols that it consists of.
fn nothing_drawn(grammar: &Grammar, derived: &DerivedString, limits: &Limits) -> Result<Diagnostic> {
    let mut counts: std::collections::BTreeMap<char, u64> = std::collections::BTreeMap::new();
    for symbol in derived.string(grammar, limits)?.symbols() {
        *counts.entry(grammar.symbols().get(*symbol)).or_insert(0) += 1;
    }
    let mut list: Vec<(char, u64)> = counts.into_iter().filter(|(c, _)| !matches!(c, '[' | ']')).collect();
    list.sort_by_key(|(c, n)| (std::cmp::Reverse(*n), *c));
    let times = |n: u64| if n == 1 { "once".to_owned() } else { format!("{n} times") };
    let shown = |c: char| grammar.symbols().long_name(c).map_or_else(|| c.to_string(), str::to_owned);
    let named: Vec<String> =
        list.iter().take(NAMED_SYMBOLS).map(|(c, n)| format!("{} ({})", shown(*c), times(*n))).collect();
    let more = if list.len() > NAMED_SYMBOLS { ", .." } else { "" };
    let first = list.first().map_or('F', |(c, _)| *c);
    let message = if list.is_empty() {
        "the derived string is empty: nothing is drawn".to_owned()
    } else {
        format!("the derived string draws nothing; it consists of {}{more}", named.join(", "))
    };
    let place = grammar.place_of(None, first);
    let help = "draw with F(1), or give the symbols a homomorphism: Homomorphism, then A --> F(1)";
    Ok(Diagnostic::warning("L037", message, place, "made here").help(help))
}

#[cfg(test)]
mod development_tests;
#[cfg(test)]
mod step_part_tests;
#[cfg(test)]
mod tests;
