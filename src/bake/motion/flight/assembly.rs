//! Adds the catkins of a recipe to its scene: flying, or one of each model side by side.

use std::sync::Arc;

use crate::bake::BakeContext;
use crate::bake::assets::catkin;
use crate::bake::assets::obstacles::{Obstacles, flight_domain};
use crate::bake::motion::AssetMotion;
use crate::bake::motion::flight::canopy::Canopy;
use crate::bake::motion::flight::{FlightPlayback, FlightSetup};
use crate::bake::scene::builder::SceneBuilder;
use crate::bake::wind::scene_wind::SceneWind;
use crate::recipe::scene::{CatkinKeys, FlightRelease};
use crate::recipe::{FlightRecipe, KeyTable as _, Recipe};
use osier_base::Result;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::geometry::Bounds;
use osier_scene::solid::{Form, Solid};
use osier_scene::{Asset, Field, Table, Trs, VolumeGrid};

/// Playback of a flight whose asset is in the scene, and the declarations of what it records in each frame.
pub(crate) struct AddedFlight {
    pub(crate) playback: Arc<FlightPlayback>,
    /// Declaration of the table of statistics, which gets one row per frame.
    pub(crate) table: Table,
    /// Declarations of the deposition maps, one for the ground and one or more for each solid.
    pub(crate) fields: Vec<Field>,
    /// Declarations of the voxel grids of catkins in flight and at rest.
    pub(crate) volumes: Vec<VolumeGrid>,
}

/// Adds the catkins of a recipe with `[catkin]` or `[flight]`: in flight with the latter, otherwise at rest in a row. `canopy`:
/// the twigs that release them.
/// # Errors
/// `Limit`, `Cancelled`; those of a lattice wind.
pub(crate) fn add_catkins(
    recipe: &Recipe,
    obstacles: &Obstacles<'_>,
    wind: &Arc<SceneWind>,
    canopy: Canopy,
    builder: &mut SceneBuilder,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<Option<AddedFlight>> {
    if recipe.catkin.is_none() && recipe.flight.is_none() {
        return Ok(None);
    }
    let defaults = CatkinKeys::defaults();
    let keys = recipe.catkin.as_ref().unwrap_or(&defaults);
    let models = catkin::catkin_models(keys, recipe.general.seed, context)?;
    let lods = catkin::CatkinLods::from_keys(keys);
    let first_material = builder.add_materials(catkin::catkin_materials(&models, &lods)?)?.first_material;
    let Some(flight) = &recipe.flight else {
        let asset = catkin::side_by_side_asset(&models, &lods, first_material)?;
        builder.add_placed(asset, Trs::IDENTITY, None);
        return Ok(None);
    };
    let (asset, added) =
        start_flight(recipe, flight, obstacles, wind, canopy, &models, &lods, first_material, context, report)?;
    let motion = Arc::clone(&added.playback) as Arc<dyn AssetMotion>;
    builder.add_placed(asset, Trs::IDENTITY, Some(motion));
    Ok(Some(added))
}

/// Prepares the playback of a flight, simulates its spin-up if the scene is still, and warns of catkins without a start.
fn start_flight(
    recipe: &Recipe,
    flight: &FlightRecipe,
    obstacles: &Obstacles<'_>,
    wind: &Arc<SceneWind>,
    canopy: Canopy,
    models: &[catkin::CatkinModel],
    lods: &catkin::CatkinLods,
    first_material: u32,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<(Asset, AddedFlight)> {
    let domain = flight_domain(recipe, flight.keys.size, obstacles);
    let points = f64::from(flight.keys.count) * (flight.keys.trails * recipe.clip.fps()).round();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "far below 2^53")]
    let drawn = context.limits.check("vertices", points as u64, "the number of points of flight.trails");
    drawn.map_err(|e| recipe.places_of_keys.limit_at("flight.trails", e))?;

    // Sample a wavy ground over a square around the origin that contains the box, wherever a lattice places it.
    let reach = domain.min.abs().max(domain.max.abs());
    let side = domain.size().max_element().max(2.0 * reach.x.max(reach.z));
    let solids = Arc::new(obstacles.solids_with_roofs_within(side));
    let (min_resolved_height, cell_size) = (wind.min_resolved_height(), wind.cell_size());
    let scene = FlightSetup { recipe, flight, domain, solids, min_resolved_height, cell_size };
    let playback = FlightPlayback::new(&scene, wind, canopy, models)?;
    if playback.enclosed_start_count() > 0 {
        let text = format!("{} catkins found no place to start outside of solids", playback.enclosed_start_count());
        let (key, help) = match flight.keys.release {
            FlightRelease::Sky | FlightRelease::Rain => ("band", "raise flight.band, or make room between the solids"),
            FlightRelease::Canopy => ("canopy", "keep solids and ground clear of the twigs' ends"),
            FlightRelease::Points => ("points", "move these positions of flight.points out of solids and ground"),
        };
        let d = Diagnostic::about("S026", text).help(help);
        report.extend(recipe.places_of_keys.report_at(&format!("flight.{key}"), d, "catkins start here"));
    }

    if flight.keys.release == FlightRelease::Canopy && playback.is_empty() {
        let text = "no plant that releases catkins has a twig: none flies";
        let help = "stems without branches release none: name plants with branches in flight.canopy, or take another \
             flight.release";
        let d = Diagnostic::about("S026", text).help(help);
        report.extend(recipe.places_of_keys.report_at("flight.canopy", d, "none of these has twigs"));
    }
    if playback.outside_start_count() > 0 {
        let count = playback.outside_start_count();
        let text = format!(
            "{count} catkins start outside of the domain of the flight: they leave at once, those above it are moved to its top"
        );
        let help = if scene.cell_size.is_some() {
            "place the lattice wind over them with wind.lattice.at, or enlarge it: wind.lattice.cells"
        } else {
            "enlarge flight.size, which lies around the origin, or place a lattice wind over them with wind.lattice.at"
        };
        let d = Diagnostic::about("S026", text).help(help);
        // A report keeps one warning of a code at a place. If the scene lacks the key, the place is its table, which may already
        // have the warning above.
        if recipe.places_of_keys.sets("flight.size") {
            report.extend(recipe.places_of_keys.report_at("flight.size", d, "the domain of the flight"));
        } else {
            report.push(d);
        }
    }

    warn_of_zones_and_solids_outside(flight, scene.solids.list(), domain, report);

    // With a lattice, its wind has already warned of open meshes.
    if scene.cell_size.is_none() {
        let warnings = scene.solids.list().iter().filter_map(|solid| solid.open_mesh_warning("catkins"));
        report.diagnostics.extend(warnings.map(|text| Diagnostic::about("S032", text)));
    }

    // The table repeats the warnings of the wind and of the start, so that readers of the file see them too.
    let is_of_flight = |d: &&Diagnostic| d.code.starts_with("S02") || d.code == "S034";
    let warnings = report.diagnostics.iter().filter(is_of_flight).map(|d| (d.code, d.message.clone())).collect();
    let (table, fields) = playback.table_and_fields(&flight.keys, warnings);
    let fields = fields.to_vec();
    let prototypes = models.iter().map(|m| m.prototype(lods, first_material)).collect();
    let asset = playback.asset(prototypes, first_material, recipe.clip.len() < 2)?;
    let volumes = playback.volumes.grids.clone();
    Ok((asset, AddedFlight { playback: Arc::new(playback), table, fields, volumes }))
}

/// Warns of zones and solids outside the box of a flight, which no catkin reaches, and of zones without an area.
fn warn_of_zones_and_solids_outside(flight: &FlightRecipe, solids: &[Solid], domain: Bounds, report: &mut Report) {
    let sides = |b: Bounds| [[b.min.x, b.max.x], [b.min.z, b.max.z]].map(|side| side.map(f64::from));
    // Length of the intersection of two intervals; negative if there is a gap between them.
    let overlap = |a: [f64; 2], b: [f64; 2]| a[1].min(b[1]) - a[0].max(b[0]);
    let [x, z] = sides(domain);
    let place = format!("x {:.1} to {:.1} m, z {:.1} to {:.1} m", x[0], x[1], z[0], z[1]);
    let help =
        "move it, or enlarge the domain: flight.size, or wind.lattice.cells and wind.lattice.at with a lattice wind";
    for zone in &flight.zones {
        if overlap(zone.x, x) <= 0.0 || overlap(zone.z, z) <= 0.0 {
            let name = &zone.name;
            let text = format!(
                "flight.zone \"{name}\" covers no ground of the domain of the flight ({place}): it counts nothing"
            );
            report.push(Diagnostic::about("S007", text).help(help));
        }
    }
    for solid in solids.iter().filter(|solid| !matches!(solid.form, Form::Land(_))) {
        let [along_x, along_z] = sides(solid.bounds());
        if overlap(along_x, x) < 0.0 || overlap(along_z, z) < 0.0 {
            let name = &solid.name;
            let text = format!("solid \"{name}\" is outside of the domain of the flight ({place}): no catkin meets it");
            report.push(Diagnostic::about("S007", text).help(help));
        } else if solid.bounds().max.y <= domain.min.y {
            let (name, base) = (&solid.name, domain.min.y);
            let text =
                format!("solid \"{name}\" is below the domain of the flight (y from {base:.1} m): no catkin meets it");
            report.push(
                Diagnostic::about("S007", text)
                    .help("raise it: `at` is the middle of its base, its y a height of the scene"),
            );
        }
    }
}
