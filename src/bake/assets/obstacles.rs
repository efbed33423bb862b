//! What stands in the way: as solids for wind and flights, and as meshes to be seen.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::assets::material_set::MaterialSet;
use crate::recipe::scene::SolidShape;
use crate::recipe::scene::WindModel;
use crate::recipe::{Recipe, SolidRecipe};
use osier_base::math::narrow;
use osier_base::{Error, Result};
use osier_plants::surface::ground::Ground;
use osier_plants::surface::masonry;
use osier_plants::surface::terrain::Terrain;
use osier_scene::solid::{Form, LandForm, Prism, Shell, Solid, Solids};
use osier_scene::{Asset, AssetKind, MaterialId, MeshMotion, MeshObject};

/// Heights along a side of the box that a waving ground is known by.
const GROUND_SAMPLES: u16 = 513;
/// Colours of walls and roofs.
const PLASTER: [f32; 3] = [0.48, 0.40, 0.29];
const TILES: [f32; 3] = [0.20, 0.058, 0.034];

/// The ground under a scene.
pub enum GroundSurface<'a> {
    /// y = 0.
    Level,
    /// Waves around a middle.
    Ground(&'a Ground, Vec3),
    /// Hills.
    Land(&'a Terrain),
}

/// All that is in the way of a scene's air and catkins, made once for both.
pub struct Obstacles<'a> {
    named: Vec<Solid>,
    footing: GroundSurface<'a>,
    hills: Option<Arc<LandForm>>,
}

impl<'a> Obstacles<'a> {
    /// Those of a recipe; none where neither a lattice nor catkins ask for them.
    /// # Errors
    /// X010 for a mesh that holds nothing solid.
    pub fn of(recipe: &Recipe, footing: GroundSurface<'a>) -> Result<Self> {
        if recipe.flight.is_none() && !flows_round(recipe) {
            return Ok(Self { named: Vec::new(), footing: GroundSurface::Level, hills: None });
        }
        let named = recipe
            .solids
            .iter()
            .map(|solid| Ok(Solid { name: solid.id.clone(), form: form(solid)?, humidity: solid.keys.humidity }));
        let hills = match &footing {
            GroundSurface::Land(land) => LandForm::new(land.side, land.size, land.heights.clone()).map(Arc::new),
            _ => None,
        };
        Ok(Self { named: named.collect::<Result<_>>()?, footing, hills })
    }

    /// All of them. `reach`: side of the square within which waving ground is known, m.
    pub fn within(&self, reach: f32) -> Solids {
        let land = match self.footing {
            GroundSurface::Ground(ground, middle) if ground.amplitude > 0.0 => {
                sampled(ground, middle, reach).map(Arc::new)
            }
            _ => self.hills.clone(),
        };
        let level = land.is_none();
        let land = land.map(|l| Solid { name: "land".into(), form: Form::Land(l), humidity: 0.0 });
        // After the others: the first of equals is what a catkin is said to lie on.
        Solids::new(self.named.iter().cloned().chain(land).collect(), level)
    }
}

/// Whether a recipe has a clip with a lattice wind, which flows round what is in its way.
pub fn flows_round(recipe: &Recipe) -> bool {
    recipe.wind.model == WindModel::Lattice && recipe.clip.len() >= 2
}

fn sampled(ground: &Ground, middle: Vec3, reach: f32) -> Option<LandForm> {
    let place = |i: u16| (f32::from(i) / f32::from(GROUND_SAMPLES - 1) - 0.5) * reach;
    let row = |z: u16| (0..GROUND_SAMPLES).map(move |x| ground.height(place(x) - middle.x, place(z) - middle.z));
    LandForm::new(usize::from(GROUND_SAMPLES), reach, (0..GROUND_SAMPLES).flat_map(row).collect())
}

fn form(solid: &SolidRecipe) -> Result<Form> {
    let Some(mesh) = &solid.mesh else { return Ok(Form::Prism(prism(solid))) };
    let (at, turn) =
        (Vec3::from_array(solid.keys.at.map(narrow)), glam::Quat::from_rotation_y(narrow(solid.keys.turn)));
    let points: Vec<Vec3> = mesh.mesh.points.iter().map(|p| at + turn * *p).collect();
    let shell = Shell::new(&points, &mesh.mesh.triangles);
    let empty = || Error::export("X010", format!("solid \"{}\": its mesh has no triangles", solid.id));
    Ok(Form::Shell(Arc::new(shell.ok_or_else(empty)?)))
}

/// A house, or else a block.
fn prism(solid: &SolidRecipe) -> Prism {
    let keys = &solid.keys;
    let (at, size) = (Vec3::from_array(keys.at.map(narrow)), Vec3::from_array(keys.size.map(narrow)));
    let turn = narrow(keys.turn);
    match keys.shape {
        SolidShape::House => Prism::house(at, size, narrow(keys.roof), turn),
        _ => Prism::block(at, size, turn),
    }
}

/// A solid to be seen: its look, and its asset once the look's first material is known.
pub fn build_obstacle(solid: &SolidRecipe) -> (MaterialSet, impl FnOnce(MaterialId) -> Result<Asset> + '_) {
    let mut look = MaterialSet::default();
    match &solid.mesh {
        Some(mesh) => {
            look.materials.clone_from(&mesh.materials);
            look.images.clone_from(&mesh.images);
            look.materials.iter_mut().for_each(|m| m.name = format!("{}_{}", solid.id, m.name));
        }
        None => {
            let keys = &solid.keys;
            let (wall, roof) = (keys.color.unwrap_or(PLASTER), keys.roof_color.unwrap_or(TILES));
            let count = if keys.shape == SolidShape::House { masonry::MATERIAL_COUNT as usize } else { 1 };
            look.materials.extend(masonry::materials(&solid.id, wall, roof).into_iter().take(count));
        }
    }
    (look, |first| {
        let mesh = match &solid.mesh {
            Some(imported) => {
                let turn = glam::Quat::from_rotation_y(narrow(solid.keys.turn));
                let at = Vec3::from_array(solid.keys.at.map(narrow));
                let mut mesh = imported.mesh.clone();
                mesh.points.iter_mut().for_each(|p| *p = at + turn * *p);
                mesh.normals.iter_mut().for_each(|n| *n = turn * *n);
                mesh.subsets.iter_mut().for_each(|s| s.material += first);
                mesh
            }
            None => masonry::masonry(&prism(solid), first),
        };
        Ok(Asset {
            id: solid.id.clone(),
            kind: AssetKind::Import,
            group: String::new(),
            skeleton: None,
            meshes: vec![MeshObject { name: solid.id.clone(), mesh, motion: MeshMotion::Still, skin: None }],
            instancers: Vec::new(),
            points: Vec::new(),
            curves: Vec::new(),
        })
    })
}
