//! Surfaces and the pictures on them: bark, leaves, ground.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::billboards;
use crate::bake::assets::ifs_leaf;
use crate::bake::assets::material_set::{MaterialSet, index, maps};
use crate::recipe::scene::CatkinKeys;
use crate::recipe::scene::words;
use crate::recipe::scene::{BarkKeys, BarkKind, BladeDetail, BladeOutline, GroundKeys, ImportedMeshKeys, OrganKeys};
use crate::recipe::{CARD, Growth, KeyTable as _, OrganRecipe, PlantRecipe};
use osier_base::Result;
use osier_base::files::Names;
use osier_base::math::narrow;
use osier_base::progress::Cancel;
use osier_base::rng::{mix64, word};
use osier_import::Imported;
use osier_plants::grow::ifs::branchlets::NAME as BRANCHLET;
use osier_plants::grow::mesh;
use osier_plants::grow::turtle::{OrganSpec, STALK};
use osier_plants::surface::bark::{BarkSpec, bark};
use osier_plants::surface::catkin;
use osier_plants::surface::ground::{Ground, GroundColors, ground_material};
use osier_plants::surface::leaf::{self, BladeSpec, LeafColors, LeafForm, Teeth};
use osier_scene::{Image, Material, MaterialClass, Mesh};

/// Light let through by imported leaves.
const LEAF_LIGHT: f32 = 0.3;

/// The look of one plant.
/// # Errors
/// What the makers of blades and maps refuse.
pub fn plant_materials(plant: &PlantRecipe, seed: u64, context: &BakeContext<'_>) -> Result<MaterialSet> {
    let mut look = MaterialSet::default();
    if let Growth::Mesh(import, keys) = &plant.growth {
        return mesh_plant_materials(plant, import, keys, seed, context.cancel);
    }
    let tuft = matches!(&plant.growth, Growth::Grammar(grammar) if grammar.is_tuft());
    let [bark_grain, shoot_grain] = &plant.grains;
    for (keys, table, part) in [(&plant.bark, bark_grain, "bark"), (&plant.shoot, shoot_grain, "shoot")] {
        let name = format!("{}_{part}", plant.id);
        if tuft && part == "shoot" {
            look.add(catkin::hair_material(&name), Vec::new());
            continue;
        }
        let grain = table.as_deref().map(|t| ifs_leaf::bark_grain(t, keys.side)).transpose()?;
        let surface = bark(&bark_spec(keys, mix64(&[seed, word(&name)])), grain.as_ref(), &name)?;
        look.add(surface.material, surface.images);
    }
    for (recipe, name) in plant.organs.iter().zip(organ_names(plant)).filter(|(o, _)| o.letter != CARD) {
        let organ = match (&recipe.mesh, &recipe.ifs) {
            (Some(mesh), _) => imported_organ(&mut look, mesh, recipe, &plant.id, &name),
            (None, Some(table)) => ifs_leaf::build_ifs_leaf(&mut look, recipe, table, &plant.id, &name, seed)?,
            (None, None) => build_leaf(&mut look, recipe, &plant.id, &name, seed, plant.rods.is_some())?,
        };
        look.organs.insert(recipe.letter, organ);
        look.names.push(name);
    }
    if tuft {
        add_stalk(&mut look, &plant.id);
    }
    if let (Growth::Ifs(stems, keys), Some(card)) = (&plant.growth, plant.organs.iter().position(|o| o.letter == CARD))
    {
        let name = organ_names(plant).swap_remove(card);
        look.cards = Some(billboards::build_billboards(&mut look, plant, &name, stems, keys, seed, context)?);
        look.names.push(name);
    }
    if matches!(&plant.growth, Growth::Ifs(_, keys) if keys.twigs) {
        look.names.push(BRANCHLET.into());
    }
    Ok(look)
}

/// Names of a plant's organs, parallel to them.
pub(crate) fn organ_names(plant: &PlantRecipe) -> Vec<String> {
    let mut names = Names::default();
    let name = |o: &OrganRecipe| match o.letter {
        'l' => "leaf".into(),
        CARD => "card".into(),
        letter => format!("organ_{letter}"),
    };
    plant.organs.iter().map(|o| names.unique(&name(o))).collect()
}

/// The stalk of a tuft, in its own size.
fn add_stalk(look: &mut MaterialSet, plant: &str) {
    let id = look.add(catkin::stalk_material(&format!("{plant}_stalk")), Vec::new());
    let mesh = catkin::stalk(narrow(CatkinKeys::defaults().stalk_radius), (12, 8)).with_material(id);
    // Nothing of it lies above its pivot, so that its size is not set by its length along +Y but is a factor.
    let spec = OrganSpec { name: "stalk".into(), meshes: vec![Arc::new(mesh)], size: 1.0, petiole: 0.0 };
    look.organs.insert(STALK, spec);
    look.names.push("stalk".into());
}

/// An artist's plant with its own materials, and the skeleton that is found in it.
fn mesh_plant_materials(
    plant: &PlantRecipe,
    import: &Imported,
    keys: &ImportedMeshKeys,
    seed: u64,
    cancel: &Cancel,
) -> Result<MaterialSet> {
    let options = mesh::SkeletonOptions {
        name: plant.source.clone(),
        leaf_words: words(&keys.leaf_pattern),
        spacing: keys.spacing.map(narrow),
        root: keys.root.map(|p| Vec3::from_array(p.map(narrow))),
        seed: mix64(&[seed, plant.keys.seed, word(&plant.name)]),
    };
    let mut tree = mesh::extract_skeleton(import, &options, cancel)?;
    let mut look = MaterialSet { names: vec!["leaf".into()], ..MaterialSet::default() };
    add_imported(&mut look, import, &plant.id);
    let mut leafy: BTreeMap<u32, u32> = BTreeMap::new();
    for proto in &mut tree.plant.protos {
        for s in &mut Arc::make_mut(&mut proto.mesh).subsets {
            let own = leafy.entry(s.material).or_insert_with(|| leaf_material_of(&mut look, &tree.wood, s.material));
            s.material = *own;
        }
    }
    look.tree = Some(Arc::new(tree));
    Ok(look)
}

/// The material of blades that have `material` in the file: seen from both sides, and with some light let through where
/// the file says nothing of it. What the wood wears, too, stays as it is.
fn leaf_material_of(look: &mut MaterialSet, wood: &Mesh, material: u32) -> u32 {
    let Some(own) = look.materials.get_mut(material as usize) else { return material };
    let mut leaf = Material { class: MaterialClass::Leaf, double_sided: true, ..own.clone() };
    if leaf.translucency <= 0.0 {
        leaf.translucency = LEAF_LIGHT;
    }
    if wood.subsets.iter().all(|s| s.material != material) {
        *own = leaf;
        return material;
    }
    leaf.name = format!("{}_leaf", leaf.name);
    look.materials.push(leaf);
    index(look.materials.len() - 1)
}

/// Adds the materials and pictures of an artist's file; where the materials begin.
fn add_imported(look: &mut MaterialSet, import: &Imported, prefix: &str) -> u32 {
    let (first_material, first_image) = (index(look.materials.len()), index(look.images.len()));
    let renamed = |own: &str| format!("{prefix}_{own}");
    look.images.extend(import.images.iter().map(|i| Image { name: renamed(&i.name), ..i.clone() }));
    look.materials.extend(import.materials.iter().map(|m| {
        let mut material = Material { name: renamed(&m.name), ..m.clone() };
        maps(&mut material.maps).into_iter().for_each(|map| *map = map.map(|i| i + first_image));
        material
    }));
    first_material
}

/// Blades made from numbers. `bare`: without their stalks, which are then rods of the same length.
fn build_leaf(
    look: &mut MaterialSet,
    recipe: &OrganRecipe,
    plant: &str,
    name: &str,
    seed: u64,
    bare: bool,
) -> Result<OrganSpec> {
    let keys = &recipe.keys;
    let spec = blade_spec(keys, mix64(&[seed, word(plant), word(name)]));
    let colors = leaf_colors(keys);
    let material_name = format!("{plant}_{name}");
    let mut surface =
        leaf::leaf_material(&spec, &colors, &material_name, keys.side, keys.detail == BladeDetail::Close)?;
    surface.material.translucency = narrow(keys.translucency);
    let id = look.add(surface.material, surface.images);
    let detail = match keys.detail {
        BladeDetail::Close => leaf::BladeDetail::Close,
        BladeDetail::Hero => leaf::BladeDetail::Hero,
        BladeDetail::Light => leaf::BladeDetail::Light,
        BladeDetail::Crown => leaf::BladeDetail::Crown,
    };
    let shape = BladeSpec { petiole_length: if bare { 0.0 } else { spec.petiole_length }, ..spec.clone() };
    let meshes = (0..u64::from(keys.variants))
        .map(|variant| Ok(Arc::new(leaf::blade(&shape, variant, detail)?.with_material(id))))
        .collect::<Result<Vec<_>>>()?;
    // With its stalk the mesh's length along +Y is what parameter 1 stands for.
    let (whole, stalk) = (f64::from(spec.length + spec.petiole_length), f64::from(spec.petiole_length));
    let longest = meshes.iter().fold(0.0_f32, |m, mesh| m.max(mesh.bounds().max.y));
    let share = whole / (f64::from(longest) + stalk);
    let (size, petiole) = if bare { (f64::from(longest) * share, stalk * share) } else { (whole, 0.0) };
    Ok(OrganSpec { name: name.to_owned(), meshes, size, petiole })
}

/// Radius of the stalk of an organ in size 1, m; none where the recipe does not know it.
pub fn stalk_radius(recipe: &OrganRecipe) -> Option<f64> {
    let own = recipe.mesh.is_none() && recipe.ifs.is_none();
    own.then(|| f64::from(blade_spec(&recipe.keys, 0).petiole_radius))
}

/// The blade's own numbers, changed by the keys that were given.
fn blade_spec(keys: &OrganKeys, seed: u64) -> BladeSpec {
    let base = match keys.blade {
        BladeOutline::Lobed => BladeSpec::oak(),
        BladeOutline::Toothed => BladeSpec::birch(),
        BladeOutline::Deltoid => BladeSpec::poplar(),
        BladeOutline::Elliptic => BladeSpec::elliptic(),
    };
    let or = |key: Option<f64>, own: f32| key.map_or(own, narrow);
    let length = or(keys.size, base.length);
    let teeth = Teeth {
        count: keys.lobes.filter(|_| keys.blade != BladeOutline::Lobed).unwrap_or(base.teeth.count),
        // A share of the half width in scenes, of the width in the blade.
        depth: keys
            .depth
            .filter(|_| keys.blade != BladeOutline::Lobed)
            .map_or(base.teeth.depth, |d| (narrow(d) * 0.5).min(0.3)),
        minor: keys.minor_teeth.unwrap_or(base.teeth.minor),
    };
    let form = match base.form {
        LeafForm::Lobed { lobes, depth } => {
            LeafForm::Lobed { lobes: keys.lobes.unwrap_or(lobes).clamp(1, 8), depth: or(keys.depth, depth) }
        }
        other => other,
    };
    BladeSpec {
        form,
        teeth,
        length,
        width: length * or(keys.width, base.width / base.length),
        veins: keys.veins.unwrap_or(base.veins),
        vein_angle: or(keys.vein_angle, base.vein_angle),
        fold: or(keys.fold, base.fold),
        curl: or(keys.curl, base.curl),
        waviness: or(keys.waviness, base.waviness),
        petiole_length: or(keys.petiole, base.petiole_length),
        petiole_radius: or(keys.petiole_radius, base.petiole_radius),
        petiole_flatness: or(keys.petiole_flatness, base.petiole_flatness),
        seed,
    }
}

/// The blade's own colours, changed by the keys that were given.
fn leaf_colors(keys: &OrganKeys) -> LeafColors {
    let own = match keys.blade {
        BladeOutline::Lobed => LeafColors::OAK,
        BladeOutline::Deltoid => LeafColors::POPLAR,
        _ => LeafColors::BIRCH,
    };
    let scaled = |c: [f32; 3], k: f32| c.map(|v| (v * k).min(1.0));
    LeafColors {
        blade: keys.color.map_or(own.blade, |c| [scaled(c, 0.72), scaled(c, 1.28)]),
        vein: keys.color2.unwrap_or(own.vein),
        edge: keys.color2.map_or(own.edge, |c| scaled(c, 0.6)),
        roughness: keys.roughness.map_or(own.roughness, narrow),
    }
}

/// An artist's mesh with its own materials.
fn imported_organ(
    look: &mut MaterialSet,
    import: &Imported,
    recipe: &OrganRecipe,
    plant: &str,
    name: &str,
) -> OrganSpec {
    let mut mesh = import.mesh.clone();
    let first_material = add_imported(look, import, &format!("{plant}_{name}"));
    for s in &mut mesh.subsets {
        s.material += first_material;
    }
    let own = f64::from(mesh.bounds().max.y.max(1e-3));
    let size = recipe.keys.size.unwrap_or(own);
    OrganSpec { name: name.to_owned(), meshes: vec![Arc::new(mesh)], size, petiole: recipe.keys.petiole.unwrap_or(0.0) }
}

/// The kind's own numbers, changed by the keys that were given.
fn bark_spec(keys: &BarkKeys, seed: u64) -> BarkSpec {
    let own = match keys.kind {
        BarkKind::Furrowed => BarkSpec::furrowed(),
        BarkKind::Plated => BarkSpec::plated(),
        BarkKind::Smooth => BarkSpec::smooth(),
        BarkKind::Lenticel => BarkSpec::birch(),
        BarkKind::Diamond => BarkSpec::poplar(),
        BarkKind::Stringy => BarkSpec::stringy(),
        BarkKind::Shoot => BarkSpec::shoot(),
        BarkKind::Culm => BarkSpec::culm(),
    };
    let marked = matches!(keys.kind, BarkKind::Lenticel | BarkKind::Diamond);
    let scaled = |c: [f32; 3], k: f32| c.map(|v| v * k);
    let crack = match (keys.color, keys.color2) {
        (Some(ground), _) if marked => scaled(ground, 0.74),
        (_, Some(crack)) if !marked => crack,
        _ => own.crack,
    };
    BarkSpec {
        ridge: keys.color.unwrap_or(own.ridge),
        crack,
        mark: keys.color2.filter(|_| marked).unwrap_or(own.mark),
        patch: (own.patch.0, keys.patches.map_or(own.patch.1, narrow)),
        depth: keys.depth.map_or(own.depth, narrow),
        tile: keys.tile.map_or(own.tile, narrow),
        side: keys.side,
        seed,
        ..own
    }
}

/// Shape of the ground that the keys describe, around the origin of its own space.
pub fn ground_shape(keys: &GroundKeys, seed: u64) -> Ground {
    Ground {
        radius: narrow(keys.size * 0.5),
        amplitude: narrow(keys.relief),
        wavelength: narrow(keys.wavelength),
        tile: narrow(keys.tile),
        seed: mix64(&[seed, word("ground")]),
        ..Ground::default()
    }
}

/// Material and pictures of that ground. `air`: linear colour of the sky at the horizon.
/// # Errors
/// What the makers of ground refuse.
pub fn ground_materials(shape: &Ground, keys: &GroundKeys, air: [f32; 3]) -> Result<MaterialSet> {
    let own = GroundColors::default();
    let scaled = |c: [f32; 3], k: f32| c.map(|v| v * k);
    // Haze is lit as ground is, and would outshine the sky if it were as bright.
    let haze = (scaled(air, 0.7), if shape.is_one_repeat() { narrow(keys.haze) } else { 0.0 });
    let colors = GroundColors {
        haze,
        soil: keys.color.map_or(own.soil, |c| [scaled(c, 0.3), c]),
        green: keys.color2.map_or(own.green, |c| [scaled(c, 0.3), c]),
        cover: narrow(keys.cover),
        ..own
    };
    let mut look = MaterialSet::default();
    let surface = ground_material(&colors, "ground", keys.side, shape.tile, shape.seed)?;
    look.add(surface.material, surface.images);
    Ok(look)
}
