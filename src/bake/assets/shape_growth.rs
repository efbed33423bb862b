//! Growth by particle-shapes: from the keys of a scene to parameters, with the solids that a plant grows round.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::bake::assets::growth_site::GrowthSite;
use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::skin_options::{BARK, SHOOT, SHOOT_RADIUS};
use crate::bake::scene::plant_layout::Individual;
use crate::recipe::scene::{RegionKeys, RegionShape, ShapeCrown, ShapeEquations, ShapeKeys, ShapeRadii};
use crate::recipe::{Growth, PlantRecipe};
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_plants::grow::particle_shapes::params::{
    ByLevel, CrownShape, Leaves, Limits, Motion, Roots, ShapeParams, Spawning, Thickness, ThicknessRule, Variant,
    WeightedRatio,
};
use osier_plants::grow::particle_shapes::region::Region;
use osier_plants::grow::particle_shapes::{self, ShapeMaterials};
use osier_plants::grow::turtle::OrganSpec;
use osier_plants::surface::masonry::roof_solids;
use osier_scene::plant::Plant;
use osier_scene::solid::{Form, Solid};

/// Ratios of the radii at both ends of an internode, and their weights, without the key `ratios`: \[wang-hao\] draws them at
/// random, but prints no values.
const DEFAULT_RATIOS: [[f64; 2]; 3] = [[0.78, 0.25], [0.84, 0.5], [0.9, 0.25]];

/// Whether the particle-shapes that grow a plant or fill it have solids of the scene as obstacles or as envelope.
pub(crate) fn grows_round_solids(plant: &PlantRecipe) -> bool {
    let growth = if let Growth::Shapes(keys) = &plant.growth { Some(&**keys) } else { None };
    growth.into_iter().chain(&plant.fill).any(ShapeKeys::reads_solids)
}

/// Grows a plant of particle-shapes in plant space; returns it with the warnings of its growth.
/// # Errors
/// As [`particle_shapes::grow`].
pub(crate) fn grow_shapes(
    keys: &ShapeKeys,
    recipe: &PlantRecipe,
    individual: &Individual,
    set: &MaterialSet,
    site: GrowthSite<'_>,
) -> Result<(Plant, Vec<Diagnostic>)> {
    let params = shape_params(keys, site);
    let identity = (individual.id, individual.seed);
    particle_shapes::grow(&params, identity, leaf_organ(set), &shape_materials(recipe, set))
}

/// Adds twigs and leaves to a grown plant if its recipe has `[plants.NAME.fill]`; returns the warnings.
/// # Errors
/// As [`particle_shapes::fill`].
pub(crate) fn fill_with_twigs(
    plant: &mut Plant,
    recipe: &PlantRecipe,
    set: &MaterialSet,
    site: GrowthSite<'_>,
) -> Result<Vec<Diagnostic>> {
    let Some(keys) = &recipe.fill else { return Ok(Vec::new()) };
    particle_shapes::fill(plant, &shape_params(keys, site), leaf_organ(set), &shape_materials(recipe, set))
}

fn leaf_organ(set: &MaterialSet) -> Option<&OrganSpec> {
    set.organs.get(&'l')
}

fn shape_materials(recipe: &PlantRecipe, set: &MaterialSet) -> ShapeMaterials {
    ShapeMaterials {
        names: set.materials.iter().map(|m| m.name.clone()).collect(),
        bark: BARK,
        shoot: SHOOT,
        shoot_radius: SHOOT_RADIUS,
        source: recipe.source.clone(),
    }
}

/// Parameters of particle-shapes from the keys of a scene; `site` turns its solids into obstacles and envelopes.
pub(crate) fn shape_params(keys: &ShapeKeys, site: GrowthSite<'_>) -> ShapeParams {
    let by_level = |values: &Vec<f64>| ByLevel::new(values.clone());
    let regions = |list: &[RegionKeys]| -> Vec<Region> { list.iter().filter_map(|r| region(r, site)).collect() };
    let mut obstacles = regions(&keys.obstacles);
    let named = keys.obstacles.iter().filter(|region| region.shape == RegionShape::Solid);
    let named = named.filter_map(|region| site.solids.iter().find(|s| s.name == region.name));
    obstacles.extend(named.flat_map(|solid| roof_obstacles(solid, site)));
    if keys.solids {
        // Plants start from the land, which is therefore no obstacle.
        let standing = site.solids.iter().filter(|s| !matches!(s.form, Form::Land(_)));
        for solid in standing {
            obstacles.push(solid_region(solid, site));
            obstacles.extend(roof_obstacles(solid, site));
        }
    }
    let envelope = regions(&keys.envelope);
    // Keys are in SI units already; a list by level repeats its last number.
    ShapeParams {
        variant: if keys.equations == ShapeEquations::Paper { Variant::Paper } else { Variant::Corrected },
        step: keys.step,
        roots: Roots { count: keys.roots, radius: keys.root_radius, tilt: keys.root_tilt, outward: keys.root_outward },
        motion: Motion {
            speed: by_level(&keys.speed),
            spread: by_level(&keys.spread),
            wander: by_level(&keys.wander),
            twist: by_level(&keys.twist),
            coil: by_level(&keys.coil),
            coil_angle: keys.coil_angle.min(TAU / 4.0),
            gravity: by_level(&keys.gravity),
            up: by_level(&keys.up),
            light: by_level(&keys.light),
            attract: by_level(&keys.attract),
            avoid: by_level(&keys.avoid),
            climb: by_level(&keys.climb),
            paper_spread: keys.paper_spread,
        },
        spawning: Spawning {
            spacing: by_level(&keys.spacing),
            spacing_sigma: keys.spacing_sigma,
            base: by_level(&keys.base),
            dormancy: keys.dormancy,
            buds: keys.buds,
            angle: by_level(&keys.angle),
            angle_deviation: keys.angle_var,
            azimuth_deviation: keys.jitter,
            up_bias: keys.up_bias,
            flow: keys.flow,
            crown: crown_shape(keys.crown),
            split: by_level(&keys.split),
            split_angle: keys.split_angle,
            apex_death: by_level(&keys.apex_death),
        },
        limits: Limits {
            levels: osier_base::convert::saturating_byte(keys.levels),
            length: by_level(&keys.length),
            length_deviation: keys.length_var,
            max_age: keys.max_age,
            max_shade: keys.max_shade,
            max_nodes: keys.max_nodes.into(),
            envelope: (!envelope.is_empty()).then_some(Region::Union(envelope)),
            obstacles,
            ground: keys.ground,
        },
        thickness: Thickness {
            rule: thickness_rule(keys),
            base: keys.radius,
            tip: keys.tip_radius,
            // The pipe model's exponent of all plants without a key; 1 makes a straight taper.
            exponent: keys.exponent.unwrap_or(if keys.radii == ShapeRadii::Pipe { 2.3 } else { 1.0 }),
        },
        leaves: Leaves {
            spacing: keys.leaf_spacing,
            max_radius: keys.leaf_radius,
            angle: keys.leaf_angle,
            angle_deviation: keys.leaf_angle_var,
            size_deviation: keys.leaf_var,
            face_up: keys.face_up,
        },
        blade_width: keys.blade_width,
    }
}

fn crown_shape(crown: ShapeCrown) -> CrownShape {
    match crown {
        ShapeCrown::Conical => CrownShape::Conical,
        ShapeCrown::Spherical => CrownShape::Spherical,
        ShapeCrown::Hemispherical => CrownShape::Hemispherical,
        ShapeCrown::Cylindrical => CrownShape::Cylindrical,
        ShapeCrown::Tapered => CrownShape::Tapered,
        ShapeCrown::Inverse => CrownShape::Inverse,
        ShapeCrown::Flame => CrownShape::Flame,
    }
}

fn thickness_rule(keys: &ShapeKeys) -> ThicknessRule {
    match keys.radii {
        ShapeRadii::Pipe => ThicknessRule::Pipe,
        ShapeRadii::Taper => ThicknessRule::Taper,
        ShapeRadii::Cone => {
            let ratios = if keys.ratios.is_empty() { &DEFAULT_RATIOS[..] } else { &keys.ratios };
            ThicknessRule::Cone(ratios.iter().map(|r| WeightedRatio { ratio: r[0], weight: r[1] }).collect())
        }
    }
}

/// The region that the keys describe, in plant space; `None` for a solid that the scene lacks, which resolving has reported.
fn region(keys: &RegionKeys, site: GrowthSite<'_>) -> Option<Region> {
    let (at, size) = (DVec3::from_array(keys.at), DVec3::from_array(keys.size));
    Some(match keys.shape {
        RegionShape::Sphere => Region::Sphere { center: at, radius: keys.radius },
        RegionShape::Ellipsoid => Region::Ellipsoid { center: at, radii: size * 0.5 },
        RegionShape::Box => Region::Box { center: at, half: size * 0.5 },
        RegionShape::Capsule => Region::Capsule { from: at, to: DVec3::from_array(keys.to), radius: keys.radius },
        RegionShape::Cone => Region::Cone { base: at, radius: keys.radius, height: keys.height },
        RegionShape::Plane => {
            let normal = DVec3::from_array(keys.normal).try_normalize().unwrap_or(DVec3::Y);
            Region::HalfSpace { point: at, normal }
        }
        RegionShape::Solid => solid_region(site.solids.iter().find(|s| s.name == keys.name)?, site),
    })
}

/// The slabs of a roof as obstacles of particle-shapes.
fn roof_obstacles(solid: &Solid, site: GrowthSite<'_>) -> Vec<Region> {
    roof_solids(solid).iter().map(|slab| solid_region(slab, site)).collect()
}

fn solid_region(solid: &Solid, site: GrowthSite<'_>) -> Region {
    Region::Solid { solid: Box::new(solid.clone()), world_from_plant: site.transform }
}
