//! Obstacles: solids around which wind flows and on which catkins rest, and their meshes.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::terrain::shown_terrain_solid;
use crate::bake::scene::builder::SceneBuilder;
use crate::recipe::scene::{SolidShape, WindModel};
use crate::recipe::{Recipe, SolidRecipe};
use osier_base::files::Names;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::{Error, Result};
use osier_plants::surface::ground::Ground;
use osier_plants::surface::masonry;
use osier_plants::surface::terrain::Terrain;
use osier_scene::solid::{Form, LandForm, Prism, Shell, Solid, Solids};
use osier_scene::{Asset, AssetKind, MaterialId, Mesh, MeshMotion, MeshObject, Trs};

/// Heights along each side of the height field that a wavy ground is sampled into. Own: 0.5 m apart over a field of 256 m;
/// fewer smooth the waves that catkins land on.
const GROUND_SAMPLES: u16 = 513;
/// Default colours of walls and roofs, linear.
const WALL_COLOR: [f32; 3] = [0.48, 0.40, 0.29];
const ROOF_COLOR: [f32; 3] = [0.20, 0.058, 0.034];

/// The surface under a scene, above which wind blows and on which catkins land.
pub enum GroundSurface<'a> {
    /// The plane y = 0, without a ground mesh.
    Level,
    /// A wavy ground, and the world position of its centre.
    Waves(&'a Ground, Vec3),
    Terrain(&'a Terrain),
}

/// The solids of a scene and the surface under it, shared by wind and catkins.
pub struct Obstacles<'a> {
    solids: Vec<Solid>,
    surface: GroundSurface<'a>,
    terrain: Option<Arc<LandForm>>,
}

impl<'a> Obstacles<'a> {
    /// The obstacles of a recipe: without solids if neither a lattice wind nor a flight meets them, and empty if no wind blows
    /// either.
    /// # Errors
    /// X010 for a mesh without triangles.
    pub fn from_recipe(recipe: &Recipe, surface: GroundSurface<'a>) -> Result<Self> {
        let meets_solids = recipe.flight.is_some() || reads_lattice_wind(recipe);
        let blows = recipe.clip.len() >= 2 && recipe.blows();
        if !meets_solids && !blows {
            return Ok(Self { solids: Vec::new(), surface: GroundSurface::Level, terrain: None });
        }
        // Meshes become hierarchies of triangles only if a lattice wind or a flight meets them: an analytic wind passes through
        // solids.
        let solids =
            recipe.solids.iter().filter(|_| meets_solids).map(|solid| {
                Ok(Solid { name: solid.id.clone(), form: solid_form(solid)?, humidity: solid.keys.humidity })
            });
        let terrain = match &surface {
            GroundSurface::Terrain(terrain) => shown_terrain_solid(terrain).map(Arc::new),
            _ => None,
        };
        Ok(Self { solids: solids.collect::<Result<_>>()?, surface, terrain })
    }

    /// The land under the scene; `None` for a level ground. `side`: as for [`Obstacles::solids_and_land`].
    fn terrain_within(&self, side: f32) -> Option<Arc<LandForm>> {
        match self.surface {
            GroundSurface::Waves(ground, center) if ground.amplitude > 0.0 => {
                sample_ground(ground, center, side).map(Arc::new)
            }
            _ => self.terrain.clone(),
        }
    }

    /// Lowest height of the terrain under a box, m, at places a thirty-second of its width apart; `None` without terrain.
    pub fn lowest_terrain_under(&self, bounds: Bounds) -> Option<f32> {
        let land = self.terrain.as_ref()?;
        let place = |i: u8, k: u8| {
            let share = Vec3::new(f32::from(i), 0.0, f32::from(k)) / 32.0;
            let p = bounds.min + bounds.size() * share;
            land.height(Vec2::new(p.x, p.z))
        };
        Some((0..=32).flat_map(|i| (0..=32).map(move |k| place(i, k))).fold(f32::INFINITY, f32::min))
    }

    /// The land above which heights in the wind are measured; `None` if its heights differ by less than [`LEAST_HILL`] from each
    /// other and from y = 0.
    pub fn wind_height_datum(&self, recipe: &Recipe) -> Option<Arc<LandForm>> {
        // The sampled square is centred on the origin: it must hold the ground's square wherever that lies.
        let center = if let GroundSurface::Waves(_, center) = self.surface { center.abs().max_element() } else { 0.0 };
        let land = self.terrain_within(narrow(recipe.ground.size) + 2.0 * center)?;
        let [low, high] = land.height_range();
        ((high - low).max(high).max(-low) >= LEAST_HILL).then_some(land)
    }

    /// [`Obstacles::solids_and_land`] with the overhanging roofs of houses, which stop what flies, as they are shown.
    pub fn solids_with_roofs_within(&self, side: f32) -> Solids {
        self.solids_and_land(side).with_projections(self.solids.iter().map(masonry::roof_solids).collect())
    }

    /// All solids, the land last. `side`: side of the square around the origin within which a wavy ground is sampled, m.
    pub fn solids_and_land(&self, side: f32) -> Solids {
        let land = self.terrain_within(side);
        let level = land.is_none();
        // Each solid is a column of the flight's table: a solid of the scene may have this name already.
        let mut names = Names::default();
        self.solids.iter().for_each(|solid| drop(names.unique(&solid.name)));
        let land = land.map(|l| Solid { name: names.unique("land"), form: Form::Land(l), humidity: 0.0 });
        // Where a solid and the land are equally near, a catkin rests on the one that comes first: the solid.
        Solids::new(self.solids.iter().cloned().chain(land).collect(), level)
    }
}

/// The box of the flight, world, m: the domain of a lattice wind, or one of `size` (width, height, depth) around the origin that
/// stands on y = 0, on terrain on the lowest ground under it.
pub(crate) fn flight_domain(recipe: &Recipe, size: [f64; 3], obstacles: &Obstacles<'_>) -> Bounds {
    let lattice = recipe.wind.model == WindModel::Lattice;
    let [w, h, d] = if lattice { recipe.lattice.size() } else { size }.map(narrow);
    let base = if lattice { Vec3::from_array(recipe.lattice.at.map(narrow)) } else { Vec3::ZERO };
    let domain = Bounds { min: base - Vec3::new(w / 2.0, 0.0, d / 2.0), max: base + Vec3::new(w / 2.0, h, d / 2.0) };
    let lowest = if lattice { None } else { obstacles.lowest_terrain_under(domain) };
    lowest.map_or(domain, |y| Bounds { min: domain.min.with_y(y), max: domain.max.with_y(y + h) })
}

/// Smallest difference, m, between the highest and the lowest point of a ground, or between these and y = 0, from which on
/// heights in the wind count from the ground instead of from y = 0. Own: the height below which the wind profile is constant;
/// lower waves lie within its roughness.
const LEAST_HILL: f32 = 0.5;

/// Whether a recipe reads a lattice wind, the only one that flows around solids: a clip does, and the flight of a still scene
/// before its frame.
pub fn reads_lattice_wind(recipe: &Recipe) -> bool {
    recipe.has_lattice_wind() && (recipe.clip.len() >= 2 || recipe.flight.is_some())
}

fn sample_ground(ground: &Ground, center: Vec3, side: f32) -> Option<LandForm> {
    let place = |i: u16| (f32::from(i) / f32::from(GROUND_SAMPLES - 1) - 0.5) * side;
    let row = |z: u16| (0..GROUND_SAMPLES).map(move |x| ground.height(place(x) - center.x, place(z) - center.z));
    LandForm::new(usize::from(GROUND_SAMPLES), side, (0..GROUND_SAMPLES).flat_map(row).collect())
}

/// The form of a solid in world space.
/// # Errors
/// X010 for a mesh without triangles.
pub(crate) fn solid_form(solid: &SolidRecipe) -> Result<Form> {
    let Some(mesh) = &solid.mesh else { return Ok(Form::Prism(solid_prism(solid))) };
    let position = Vec3::from_array(solid.keys.at.map(narrow));
    let rotation = glam::Quat::from_rotation_y(narrow(solid.keys.turn));
    let points: Vec<Vec3> = mesh.mesh.points.iter().map(|p| position + rotation * *p).collect();
    let shell = Shell::new(&points, &mesh.mesh.triangles);
    let empty = || Error::export("X010", format!("solid \"{}\": its mesh has no triangles", solid.id));
    Ok(Form::Shell(Arc::new(shell.ok_or_else(empty)?)))
}

/// The prism of a house, or of a block for every other shape.
fn solid_prism(solid: &SolidRecipe) -> Prism {
    let keys = &solid.keys;
    let (base, size) = (Vec3::from_array(keys.at.map(narrow)), Vec3::from_array(keys.size.map(narrow)));
    let turn = narrow(keys.turn);
    match keys.shape {
        SolidShape::House => Prism::house(base, size, narrow(keys.roof), turn),
        _ => Prism::block(base, size, turn),
    }
}

/// Adds one asset per obstacle with the key `show`; obstacles are in world space already, so that they are placed by the
/// identity.
/// # Errors
/// `TooMany` beyond 2^32 materials or images.
pub(crate) fn add_obstacles(recipe: &Recipe, builder: &mut SceneBuilder) -> Result<()> {
    for solid in recipe.solids.iter().filter(|s| s.keys.show) {
        let first_material = builder.add_materials(obstacle_materials(solid))?.first_material;
        let mut asset = obstacle_asset(solid, first_material);
        builder.make_id_unique(&mut asset.id, "_solid");
        builder.add_placed(asset, Trs::IDENTITY, None);
    }
    Ok(())
}

/// Materials of an imported mesh, or of walls and roof.
fn obstacle_materials(solid: &SolidRecipe) -> MaterialSet {
    let mut set = MaterialSet::default();
    match &solid.mesh {
        Some(mesh) => {
            set.materials.clone_from(&mesh.materials);
            set.images.clone_from(&mesh.images);
            set.materials.iter_mut().for_each(|m| m.name = format!("{}_{}", solid.id, m.name));
        }
        None => {
            let keys = &solid.keys;
            let (wall, roof) = (keys.color.unwrap_or(WALL_COLOR), keys.roof_color.unwrap_or(ROOF_COLOR));
            let count = if keys.shape == SolidShape::House { masonry::MATERIAL_COUNT as usize } else { 1 };
            set.materials.extend(masonry::materials(&solid.id, wall, roof).into_iter().take(count));
        }
    }
    set
}

/// The faces of all obstacles, visible or not, in world space, at which rain ends; their material indices are not those of the
/// scene.
pub(crate) fn rain_faces(recipe: &Recipe) -> Vec<Mesh> {
    // The slabs of a roof leave a slit at the ridge; the prism under them is closed.
    let prisms = recipe.solids.iter().filter(|solid| solid.mesh.is_none()).map(|solid| prism_mesh(&solid_prism(solid)));
    recipe.solids.iter().map(|solid| obstacle_mesh(solid, 0)).chain(prisms).collect()
}

/// The closed surface of a prism, without normals and materials.
fn prism_mesh(prism: &Prism) -> Mesh {
    let [near, far] = prism.ends();
    let mut mesh = Mesh::default();
    let mut push = |outline: &[Vec3]| {
        let corners = mesh.points.len()..;
        mesh.points.extend_from_slice(outline);
        let first: Vec<u32> = corners.take(outline.len()).filter_map(|i| u32::try_from(i).ok()).collect();
        // A fan about the first corner: the outlines of prisms are convex.
        mesh.triangles.extend(first.windows(2).skip(1).map(|k| [first[0], k[0], k[1]]));
    };
    for i in 0..near.len() {
        let k = (i + 1) % near.len();
        push(&[near[i], near[k], far[k], far[i]]);
    }
    push(&near);
    push(&far);
    mesh
}

/// The mesh of an obstacle in world space; `first_material`: index in the scene of the first of [`obstacle_materials`].
fn obstacle_mesh(solid: &SolidRecipe, first_material: MaterialId) -> Mesh {
    match &solid.mesh {
        Some(imported) => {
            let rotation = glam::Quat::from_rotation_y(narrow(solid.keys.turn));
            let position = Vec3::from_array(solid.keys.at.map(narrow));
            let mut mesh = imported.mesh.clone();
            mesh.points.iter_mut().for_each(|p| *p = position + rotation * *p);
            mesh.normals.iter_mut().for_each(|n| *n = rotation * *n);
            mesh.subsets.iter_mut().for_each(|s| s.material += first_material);
            mesh
        }
        None => masonry::masonry(&solid_prism(solid), first_material),
    }
}

/// The asset of an obstacle; `first_material`: as for [`obstacle_mesh`].
fn obstacle_asset(solid: &SolidRecipe, first_material: MaterialId) -> Asset {
    let mesh = obstacle_mesh(solid, first_material);
    Asset {
        id: solid.id.clone(),
        kind: AssetKind::Import,
        group: String::new(),
        skeleton: None,
        meshes: vec![MeshObject { name: solid.id.clone(), mesh, motion: MeshMotion::Still, skin: None }],
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    }
}
