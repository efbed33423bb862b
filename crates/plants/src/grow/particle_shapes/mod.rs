//! Particle-shapes: plants as the traces of particles that wander, twist and spread, and spawn others on their way.
//!
//! Source: R. Hoetzlein, Natural Structures through the Convergence of Particles and Shapes (Generative Art 2020), section 3. A
//! particle leaves a chain of nodes behind; an axis is such a chain. Particles spawn others at irregular intervals; these
//! have the next level. Length, age and level end growth.
//!
//! Own: units, a random walk and an approach to the target direction that do not depend on the step, tropisms, light, crown
//! guide, solids, radii. [`params::Variant::Paper`] has the printed equations.

mod axis;
mod fill;
mod growth;
mod guide;
mod leaves;
pub mod params;
mod particle;
mod plant;
pub mod region;
mod shade;
mod spawn;

use crate::grow::turtle::OrganSpec;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::grouped;
use osier_base::{Error, Result};
use osier_scene::plant::{MAX_ITEMS, Plant};
use params::{ByLevel, ShapeParams, Variant};

pub use fill::fill;

/// Materials of a plant by thickness of its axes, and the description of its origin.
#[derive(Debug, Clone, Default)]
pub struct ShapeMaterials {
    /// Names of all materials of the plant, in the order of their indices.
    pub names: Vec<String>,
    /// Index among `names` of the bark of thick axes.
    pub bark: u16,
    /// Index among `names` of the bark of axes whose base is thinner than `shoot_radius`.
    pub shoot: u16,
    /// Radius at its base below which an axis is thin, m.
    pub shoot_radius: f32,
    /// Description of the plant's origin, for manifests.
    pub source: String,
}

/// Grows a plant. `identity`: its id and seed. Returns it validated, with the warnings of its growth.
/// # Errors
/// `Range` for a parameter outside its range, `Limit` beyond [`MAX_ITEMS`] nodes, the errors of `plant::validate`.
pub fn grow(
    params: &ShapeParams,
    identity: (u32, u64),
    organ: Option<&OrganSpec>,
    materials: &ShapeMaterials,
) -> Result<(Plant, Vec<Diagnostic>)> {
    check(params)?;
    let grown = growth::grow_axes(params, spawn::roots(params, identity), identity);
    if grown.axes.is_empty() {
        return Err(nothing_grew(&grown, params, &materials.source));
    }
    let plant = plant::build_plant(&grown.axes, params, identity, organ, materials)?;
    Ok((plant, warnings(&grown, params, &materials.source)))
}

/// The error of a plant without axes: its first level was refused, or every axis ended before its first step. `source`: the file of
/// the plant.
fn nothing_grew(grown: &growth::GrownShapes, params: &ShapeParams, source: &str) -> Error {
    match grown.refused {
        Some(refused) => Error::Limit {
            name: format!("nodes of {source}"),
            wanted: grouped(refused.predicted),
            limit: grouped(params.limits.max_nodes),
            flag: String::new(),
            help: "set fewer roots, a shorter length or a larger max_nodes".into(),
        },
        None => {
            let text = format!("{source}: no axis had room to grow");
            let help = "move its roots out of solids, and give it a larger `max_age` or `max_shade` if it has one";
            Error::from(Diagnostic { help: Some(help.into()), ..Diagnostic::about("S004", text) })
        }
    }
}

/// Warnings (S035) of a level that was left out and of velocities that were cut, and (S007) of an envelope that the
/// plant does not enter.
fn warnings(grown: &growth::GrownShapes, params: &ShapeParams, source: &str) -> Vec<Diagnostic> {
    let mut out = Vec::new();
    // Axes are cut off where they leave the envelope; an envelope that no axis enters has no effect.
    let mut nodes = grown.axes.iter().flat_map(|axis| &axis.nodes);
    let envelope = params.limits.envelope.as_ref().filter(|_| !grown.axes.is_empty());
    if envelope.is_some_and(|envelope| nodes.all(|node| envelope.distance(node.p) > 0.0)) {
        let help = "move it to the plant, whose foot is the origin, or make it larger";
        let text = format!("{source}: envelope has no effect, because nothing grows into it");
        out.push(Diagnostic { help: Some(help.into()), ..Diagnostic::about("S007", text) });
    }
    if let Some(refused) = grown.refused {
        let text = format!(
            "{source}: level {} was not grown, because the plant would have at least {} nodes",
            refused.level, refused.predicted
        );
        let help = "raise `max_nodes`, or set a larger `spacing` or fewer `levels`";
        out.push(Diagnostic { help: Some(help.into()), ..Diagnostic::about("S035", text) });
    }
    if grown.cut_velocities > 0 {
        let text = format!(
            "{source}: the velocity of {} steps was cut to 4 times `speed`: the printed equations let it grow without bound",
            grown.cut_velocities
        );
        out.push(Diagnostic::about("S035", text));
    }
    out
}

/// Range of a parameter that has values by level.
struct LevelRange<'a> {
    name: &'static str,
    values: &'a ByLevel,
    min: f64,
    max: f64,
    unit: &'static str,
}

/// Checks ranges for callers whose parameters do not come from the checked keys of a scene.
fn check(params: &ShapeParams) -> Result<()> {
    let m = &params.motion;
    let (limits, spawning) = (&params.limits, &params.spawning);
    let row = |name, values, min, max, unit| LevelRange { name, values, min, max, unit };
    // Parameters with values by level first; each is tested at all eight levels.
    let ranges = [
        row("length", &limits.length, 0.005, 100.0, "m"),
        row("speed", &m.speed, 0.01, 10.0, "m/t"),
        row("spread", &m.spread, 0.0, 50.0, "1/t"),
        row("wander", &m.wander, 0.0, 3.0, "t^-1/2"),
        row("twist", &m.twist, -30.0, 30.0, "rad/t"),
        row("coil", &m.coil, -30.0, 30.0, "rad/t"),
        row("gravity", &m.gravity, -5.0, 5.0, "m/t^2"),
        row("up", &m.up, -5.0, 5.0, "1/t"),
        row("light", &m.light, -5.0, 5.0, "1/t"),
        row("attract", &m.attract, -5.0, 5.0, "1/t"),
        row("avoid", &m.avoid, -5.0, 5.0, "1/t"),
        row("climb", &m.climb, -5.0, 5.0, "1/t"),
        row("spacing", &spawning.spacing, 0.002, 10.0, "m"),
        row("base", &spawning.base, 0.0, 1.0, ""),
        row("angle", &spawning.angle, 0.0, 3.06, "rad"),
    ];
    for r in ranges {
        let found = (0..8).map(|level| r.values.at(level)).find(|v| !(r.min..=r.max).contains(v));
        if let Some(value) = found {
            return Err(Error::Range { name: r.name.into(), value, min: r.min, max: r.max, unit: r.unit });
        }
    }
    let paper = if params.variant == Variant::Paper { m.paper_spread } else { 0.0 };
    let single = [
        ("levels", f64::from(limits.levels), 1.0, 8.0, ""),
        ("roots", f64::from(params.roots.count), 1.0, 100_000.0, ""),
        ("step", params.step, 0.05, 8.0, ""),
        ("paper_spread", paper, 0.0, 1.0, ""),
        ("tip radius", params.thickness.tip, 1e-5, 1.0, "m"),
        ("max_nodes", limits.max_nodes as f64, 1.0, MAX_ITEMS as f64, ""),
    ];
    for (name, value, min, max, unit) in single {
        if !(min..=max).contains(&value) {
            return Err(Error::Range { name: name.into(), value, min, max, unit });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
