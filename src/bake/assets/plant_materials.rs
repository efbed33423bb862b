//! Materials and organ meshes of a plant: bark, leaf blades, imported meshes.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::billboards;
use crate::bake::assets::ifs_leaf;
use crate::bake::assets::material_set::{MaterialSet, image_indices_mut};
use crate::bake::assets::skin_options::SHOOT;
use crate::recipe::scene::CatkinKeys;
use crate::recipe::scene::words;
use crate::recipe::scene::{BarkKeys, BarkKind, BladeDetail, BladeOutline, ImportedMeshKeys, OrganKeys};
use crate::recipe::{BarkPictures, CARD, Growth, KeyTable as _, OrganRecipe, PlantRecipe, SurfaceForm};
use osier_base::convert::{index, to_usize};
use osier_base::files::Names;
use osier_base::math::narrow;
use osier_base::progress::Cancel;
use osier_base::rng::{mix64, word};
use osier_base::{Error, Result};
use osier_import::Imported;
use osier_plants::grow::ifs::branchlets::NAME_PREFIX as BRANCHLET;
use osier_plants::grow::mesh;
use osier_plants::grow::turtle::{OrganSpec, STALK, patch_mesh, triangle_mesh};
use osier_plants::surface::SurfaceMaterial;
use osier_plants::surface::bark::{BarkSpec, bark};
use osier_plants::surface::catkin;
use osier_plants::surface::leaf::{self, BladeSpec, LeafColors, LeafForm, Teeth};
use osier_scene::{Image, Material, MaterialClass, Mesh};

/// Translucency, 0..1, of imported leaves whose file has none. Own: of the order of a broad leaf's transmittance in visible
/// light; 0 would show backlit crowns black.
const IMPORTED_TRANSLUCENCY: f32 = 0.3;

/// Length of a piece of a conifer's shoot, m, and the diameter of its needles as a share of that.
const NEEDLE_SHOOT: [f64; 2] = [0.12, 0.3];
/// Number of needles of such a piece and its twigs, angle of each needle to the shoot, rad, and width, m: a spruce's, with
/// fewer and wider needles of the same total area.
const NEEDLES: u32 = 180;
const NEEDLE_ANGLE: f64 = 0.95;
const NEEDLE_WIDTH: f32 = 0.003;
/// Linear colour and roughness of needles.
const NEEDLE_COLOR: [f32; 3] = [0.028, 0.075, 0.022];
const NEEDLE_ROUGHNESS: f32 = 0.5;
/// Translucency of needles, which are thick, as a share of that of a blade with the same key.
const NEEDLE_TRANSLUCENCY: f32 = 0.3;

/// Greatest coordinate of a surface, in the units of its file, beyond which it is not drawn.
const MAX_EXTENT: f32 = 1e9;
/// Linear colour of the bark of plants coloured by a colour file: none of their axes shows it.
const PLAIN_BARK: [f32; 3] = [0.2, 0.12, 0.06];

/// Roughness of a bark of pictures, which do not give it. Own: between the cracks and the ridges of furrowed bark.
const BARK_ROUGHNESS: f32 = 0.85;
/// Width of the picture of a bark without the key `tile`, m. Own: what a photograph from near shows of a stem.
const BARK_TILE: f32 = 0.5;

/// Roughness of surfaces with a texture of a view file, which does not give it. Own: as of leaves.
const SURFACE_ROUGHNESS: f32 = 0.5;

/// Linear colour of dead wood: silvery grey.
const DEAD_WOOD: [f32; 3] = [0.22, 0.20, 0.18];

/// Translucency of blades of grass. Own: as of broad leaves; blades are thinner, but with closer veins.
const GRASS_TRANSLUCENCY: f32 = 0.3;

/// Makes all materials, images and organs of one plant, except the colours of its season and of the turtle, which follow its
/// growth.
/// # Errors
/// `Range` for blades and maps outside their ranges, `Input` for a table without attractor, `Cancelled`.
pub fn plant_materials(plant: &PlantRecipe, seed: u64, context: &BakeContext<'_>) -> Result<MaterialSet> {
    let mut set = MaterialSet::default();
    if let Growth::Mesh(import, keys) = &plant.growth {
        return mesh_plant_materials(plant, import, keys, seed, context.cancel);
    }
    // Two materials of every plant: bark, and the bark of thin shoots; a tuft of hairs has hair in place of the latter.
    let tuft = matches!(&plant.growth, Growth::Grammar(grammar) if grammar.is_tuft());
    let [bark_grain, shoot_grain] = &plant.grains;
    let [bark_pictures, shoot_pictures] = &plant.bark_pictures;
    let barks =
        [(&plant.bark, bark_grain, bark_pictures, "bark"), (&plant.shoot, shoot_grain, shoot_pictures, "shoot")];
    for (keys, table, pictures, part) in barks {
        let name = format!("{}_{part}", plant.id);
        if tuft && part == "shoot" {
            set.add(catkin::hair_material(&name), Vec::new())?;
            continue;
        }
        // Everything that such a grammar draws has a colour of its file: a bark without images keeps the material's index.
        if plant.companions.colors.is_some() {
            set.add(Material::plain(name, MaterialClass::Bark, PLAIN_BARK, SURFACE_ROUGHNESS), Vec::new())?;
            continue;
        }
        let grain = table.as_deref().map(|t| ifs_leaf::bark_grain(t, keys.side)).transpose()?;
        let mut surface = match pictures {
            Some(pictures) => bark_from_pictures(keys, pictures, name),
            None => bark(&bark_spec(keys, mix64(&[seed, word(&name)])), grain.as_ref(), &name)?,
        };
        if axes_are_blades(plant) {
            turn_into_grass_material(&mut surface.material);
        }
        set.add(surface.material, surface.images)?;
    }
    // Textures come before the organs, whose surfaces may refer to them.
    for (number, picture) in &plant.companions.textures {
        let name = format!("{}_texture_{number}", plant.id);
        let id = add_texture(&mut set, picture, &name)?;
        set.textures.insert(*number, id);
    }
    // Organs: a mesh from a file, a leaf drawn by a table, or a blade built from its parameters.
    for (recipe, name) in plant.organs.iter().zip(organ_names(plant)).filter(|(o, _)| o.letter != CARD) {
        let organ = match (&recipe.mesh, &recipe.ifs) {
            _ if recipe.surface.is_some() => add_surface_organ(&mut set, recipe, plant, &name)?,
            (Some(mesh), _) => add_imported_organ(&mut set, mesh, recipe, &plant.id, &name)?,
            (None, Some(table)) => ifs_leaf::build_ifs_leaf(&mut set, recipe, table, &plant.id, &name, seed)?,
            (None, None) if recipe.keys.blade == BladeOutline::Needles => {
                build_needle_shoots(&mut set, recipe, &plant.id, &name, seed)?
            }
            (None, None) => build_leaf_blades(&mut set, recipe, &plant.id, &name, seed, plant.rods.is_some())?,
        };
        set.organs.insert(recipe.letter, organ);
        set.names.push(name);
    }
    if matches!(plant.growth, Growth::Species(_)) {
        let dead = Material::plain(format!("{}_dead", plant.id), MaterialClass::Bark, DEAD_WOOD, 0.9);
        // Beyond the 65,536 materials that axes can number, dead wood keeps the bark.
        set.dead = u16::try_from(set.add(dead, Vec::new())?).ok();
    }
    if tuft {
        add_tuft_stalk(&mut set, &plant.id)?;
    }
    // Billboards picture subtrees with the bark and leaves above, so they come after these.
    if let (Growth::Ifs(stems, keys), Some(card)) = (&plant.growth, plant.organs.iter().position(|o| o.letter == CARD))
    {
        let name = organ_names(plant).swap_remove(card);
        set.cards = Some(billboards::build_billboards(&mut set, plant, &name, stems, keys, seed, context)?);
        set.names.push(name);
    }
    if matches!(&plant.growth, Growth::Ifs(_, keys) if keys.twigs) {
        set.names.push(BRANCHLET.into());
    }
    Ok(set)
}

/// Whether the axes of a plant are blades of grass.
fn axes_are_blades(plant: &PlantRecipe) -> bool {
    matches!(&plant.growth, Growth::Shapes(keys) if keys.blade_width.is_some())
}

/// Turns the bark of axes into the surface of blades: seen from both sides, with light shining through.
fn turn_into_grass_material(material: &mut Material) {
    material.class = MaterialClass::Leaf;
    material.double_sided = true;
    material.translucency = GRASS_TRANSLUCENCY;
}

/// Unique names of a plant's organs, parallel to them: `leaf`, `card` or `organ_` and the letter, with a number if taken.
pub(crate) fn organ_names(plant: &PlantRecipe) -> Vec<String> {
    let mut names = Names::default();
    let name = |o: &OrganRecipe| match o.letter {
        'l' => "leaf".into(),
        CARD => "card".into(),
        letter => format!("organ_{letter}"),
    };
    plant.organs.iter().map(|o| names.unique(&name(o))).collect()
}

/// Adds the stalk of a tuft as an organ of fixed size.
fn add_tuft_stalk(set: &mut MaterialSet, plant: &str) -> Result<()> {
    let id = set.add(catkin::stalk_material(&format!("{plant}_stalk")), Vec::new())?;
    let mesh = catkin::stalk(narrow(CatkinKeys::defaults().stalk_radius), (12, 8)).with_material(id);
    // Its mesh has no extent along +Y from the pivot, so that `size` cannot be its length: it is a scale factor.
    let spec = OrganSpec { name: "stalk".into(), meshes: vec![Arc::new(mesh)], size: 1.0, petiole: 0.0 };
    set.organs.insert(STALK, spec);
    set.names.push("stalk".into());
    Ok(())
}

/// Materials of an imported plant's file, and the skeleton extracted from its mesh as `tree` of the set.
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
    let mut set = MaterialSet { names: vec!["leaf".into()], ..MaterialSet::default() };
    add_imported_materials(&mut set, import, &plant.id)?;
    // A material that wood and leaves share is split, once: leaves are two-sided and translucent.
    let mut leaf_materials: BTreeMap<u32, u32> = BTreeMap::new();
    // Materials of the file were added first, so that its indices hold here.
    for proto in &mut tree.plant.protos {
        for s in &mut Arc::make_mut(&mut proto.mesh).subsets {
            let known = leaf_materials.get(&s.material).copied();
            let leaf = known.map_or_else(|| imported_leaf_material(&mut set, &tree.wood, s.material), Ok)?;
            leaf_materials.insert(s.material, leaf);
            s.material = leaf;
        }
    }
    set.tree = Some(Arc::new(tree));
    Ok(set)
}

/// Index of the material of leaves that have `material` in the file: two-sided, and translucent even if the file sets no
/// translucency.
/// It replaces `material`, or is added beside it if the wood uses that too.
fn imported_leaf_material(set: &mut MaterialSet, wood: &Mesh, material: u32) -> Result<u32> {
    let Some(own) = set.materials.get_mut(to_usize(material)) else { return Ok(material) };
    let mut leaf = Material { class: MaterialClass::Leaf, double_sided: true, ..own.clone() };
    // Few files store the translucency of leaves.
    if leaf.translucency <= 0.0 {
        leaf.translucency = IMPORTED_TRANSLUCENCY;
    }
    if wood.subsets.iter().all(|s| s.material != material) {
        *own = leaf;
        return Ok(material);
    }
    leaf.name = format!("{}_leaf", leaf.name);
    set.materials.push(leaf);
    index(set.materials.len() - 1, "materials of a plant")
}

/// Adds the materials and images of an imported file under `prefix`; returns the index of the first material.
fn add_imported_materials(set: &mut MaterialSet, import: &Imported, prefix: &str) -> Result<u32> {
    let first_material = index(set.materials.len(), "materials of a plant")?;
    // Indices of the file start at its first material and image.
    let first_image = index(set.images.len(), "images of a plant")?;
    let renamed = |own: &str| format!("{prefix}_{own}");
    set.images.extend(import.images.iter().map(|i| Image { name: renamed(&i.name), ..i.clone() }));
    set.materials.extend(import.materials.iter().map(|m| {
        let mut material = Material { name: renamed(&m.name), ..m.clone() };
        image_indices_mut(&mut material.maps).into_iter().for_each(|map| *map = map.map(|i| i + first_image));
        material
    }));
    Ok(first_material)
}

/// Leaf blades built from their parameters, `keys.variants` of them. `bare`: without petioles, which are then rods of the same
/// length.
fn build_leaf_blades(
    set: &mut MaterialSet,
    recipe: &OrganRecipe,
    plant: &str,
    name: &str,
    seed: u64,
    bare: bool,
) -> Result<OrganSpec> {
    let keys = &recipe.keys;
    let spec = leaf_blade_spec(keys, mix64(&[seed, word(plant), word(name)]));
    let colors = leaf_colors(keys);
    let material_name = format!("{plant}_{name}");
    let mut surface =
        leaf::leaf_material(&spec, &colors, &material_name, keys.side, keys.detail == BladeDetail::Close)?;
    surface.material.translucency = narrow(keys.translucency);
    let id = set.add(surface.material, surface.images)?;
    let detail = match keys.detail {
        BladeDetail::Close => leaf::BladeDetail::Close,
        BladeDetail::Hero => leaf::BladeDetail::Hero,
        BladeDetail::Light => leaf::BladeDetail::Light,
        BladeDetail::Crown => leaf::BladeDetail::Crown,
        BladeDetail::Distant => leaf::BladeDetail::Distant,
    };
    let shape = BladeSpec { petiole_length: if bare { 0.0 } else { spec.petiole_length }, ..spec.clone() };
    let compound = leaf::CompoundSpec { leaflets: keys.leaflets, leaflet_length: narrow(keys.leaflet_length) };
    let meshes = (0..u64::from(keys.variants))
        .map(|variant| Ok(Arc::new(leaf::compound_leaf(&shape, &compound, variant, detail)?.with_material(id))))
        .collect::<Result<Vec<_>>>()?;
    // The organ's size is the specified length of blade and petiole along +Y; a curled mesh is shorter. Without petiole, the
    // size is the blade's share of that length.
    let (whole, stalk) = (f64::from(spec.length + spec.petiole_length), f64::from(spec.petiole_length));
    let longest = meshes.iter().fold(0.0_f32, |m, mesh| m.max(mesh.bounds().max.y));
    let share = whole / (f64::from(longest) + stalk);
    let (size, petiole) = if bare { (f64::from(longest) * share, stalk * share) } else { (whole, 0.0) };
    Ok(OrganSpec { name: name.to_owned(), meshes, size, petiole })
}

/// Pieces of a conifer's shoot with their needles, `keys.variants` of them. Of the keys, `size` is the length of a piece,
/// `width` the diameter of its brush of needles as a part of that, `vein_angle` the angle of the needles, `petiole_radius` half
/// their width. The wood of the pieces has the material of thin shoots.
fn build_needle_shoots(
    set: &mut MaterialSet,
    recipe: &OrganRecipe,
    plant: &str,
    name: &str,
    seed: u64,
) -> Result<OrganSpec> {
    let keys = &recipe.keys;
    let mut material = Material::plain(
        format!("{plant}_{name}"),
        MaterialClass::Leaf,
        keys.color.unwrap_or(NEEDLE_COLOR),
        keys.roughness.map_or(NEEDLE_ROUGHNESS, narrow),
    );
    material.double_sided = true;
    material.translucency = narrow(keys.translucency) * NEEDLE_TRANSLUCENCY;
    let id = set.add(material, Vec::new())?;
    // The width of a piece is that of its brush: needles of this length at this angle span it.
    let length = keys.size.unwrap_or(NEEDLE_SHOOT[0]);
    let angle = keys.vein_angle.unwrap_or(NEEDLE_ANGLE).clamp(0.2, 1.5);
    let across = 0.5 * keys.width.unwrap_or(NEEDLE_SHOOT[1]) * length;
    let spec = leaf::NeedleSpec {
        length: narrow(length),
        count: keys.needles.unwrap_or(NEEDLES),
        needle: narrow(across / osier_base::math::sin(angle)),
        width: keys.petiole_radius.map_or(NEEDLE_WIDTH, |r| narrow(2.0 * r)),
        angle: narrow(angle),
        twigs: keys.twigs,
        twig: narrow(keys.twig_length * length),
        twig_angle: narrow(keys.twig_angle),
        coarse: matches!(keys.detail, BladeDetail::Crown | BladeDetail::Distant),
        seed: mix64(&[seed, word(plant), word(name)]),
    };
    // Each variant has different random needles; subset 0 is the needles, the other the wood of the shoot.
    let meshes = (0..u64::from(keys.variants))
        .map(|variant| {
            let mut mesh = leaf::needle_shoot(&spec, variant)?;
            for subset in &mut mesh.subsets {
                subset.material = if subset.material == 0 { id } else { u32::from(SHOOT) };
            }
            Ok(Arc::new(mesh))
        })
        .collect::<Result<Vec<_>>>()?;
    Ok(OrganSpec { name: name.to_owned(), meshes, size: length, petiole: 0.0 })
}

/// Radius of an organ's petiole at size 1, m; `None` for imported and drawn leaves, whose petiole has no parameter.
pub(crate) fn petiole_radius(recipe: &OrganRecipe) -> Option<f64> {
    let own = recipe.mesh.is_none() && recipe.ifs.is_none();
    own.then(|| f64::from(leaf_blade_spec(&recipe.keys, 0).petiole_radius))
}

/// Parameters of a leaf blade: those of the species that the key `blade` names, overridden by the keys that are set.
pub(crate) fn leaf_blade_spec(keys: &OrganKeys, seed: u64) -> BladeSpec {
    let base = match keys.blade {
        BladeOutline::Lobed => BladeSpec::oak(),
        BladeOutline::Toothed => BladeSpec::birch(),
        BladeOutline::Deltoid => BladeSpec::poplar(),
        BladeOutline::Palmate => BladeSpec::maple(),
        BladeOutline::Petal => BladeSpec::petal(),
        BladeOutline::Elliptic | BladeOutline::Needles => BladeSpec::elliptic(),
    };
    let or = |key: Option<f64>, own: f32| key.map_or(own, narrow);
    let length = or(keys.size, base.length);
    // `lobes` and `depth` mean lobes where the outline has them, else teeth.
    let has_lobes = matches!(keys.blade, BladeOutline::Lobed | BladeOutline::Palmate | BladeOutline::Petal);
    let teeth = Teeth {
        count: keys.lobes.filter(|_| !has_lobes).unwrap_or(base.teeth.count),
        // A share of the half width in scenes, of the width in the blade.
        depth: keys.depth.filter(|_| !has_lobes).map_or(base.teeth.depth, |d| (narrow(d) * 0.5).min(0.3)),
        minor: keys.minor_teeth.unwrap_or(base.teeth.minor),
    };
    let form = match base.form {
        LeafForm::Lobed { lobes, depth } => {
            LeafForm::Lobed { lobes: keys.lobes.unwrap_or(lobes).clamp(1, 8), depth: or(keys.depth, depth) }
        }
        LeafForm::Palmate { lobes, depth } => {
            LeafForm::Palmate { lobes: keys.lobes.unwrap_or(lobes).clamp(1, 4), depth: or(keys.depth, depth) }
        }
        LeafForm::Petal { notch } => LeafForm::Petal { notch: or(keys.depth, notch) },
        other => other,
    };
    let mut spec = BladeSpec {
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
    };
    // More teeth than the species has are as deep as its own, unless they would fold.
    if keys.depth.is_none() && (keys.lobes.is_some() || keys.minor_teeth.is_some()) && !has_lobes {
        spec.teeth.depth = spec.teeth.depth.min(leaf::steepest_teeth(&spec));
    }
    spec
}

/// Colours of a leaf blade: those of the species that the key `blade` names, overridden by the keys that are set.
pub(crate) fn leaf_colors(keys: &OrganKeys) -> LeafColors {
    let own = match keys.blade {
        BladeOutline::Lobed => LeafColors::OAK,
        BladeOutline::Deltoid => LeafColors::POPLAR,
        BladeOutline::Petal => LeafColors::PETAL,
        _ => LeafColors::BIRCH,
    };
    let scaled = |c: [f32; 3], k: f32| c.map(|v| (v * k).min(1.0));
    LeafColors {
        // Petals are more even than leaves.
        blade: keys.color.map_or(own.blade, |c| match keys.blade {
            BladeOutline::Petal => [scaled(c, 0.92), scaled(c, 1.06)],
            _ => [scaled(c, 0.72), scaled(c, 1.28)],
        }),
        vein: keys.color2.unwrap_or(own.vein),
        edge: keys.color2.map_or(own.edge, |c| scaled(c, 0.6)),
        roughness: keys.roughness.map_or(own.roughness, narrow),
    }
}

/// Adds an imported mesh as an organ with the materials of its file. Without the key `size` it keeps its height above the
/// pivot, m.
fn add_imported_organ(
    set: &mut MaterialSet,
    import: &Imported,
    recipe: &OrganRecipe,
    plant: &str,
    name: &str,
) -> Result<OrganSpec> {
    let mut mesh = import.mesh.clone();
    let first_material = add_imported_materials(set, import, &format!("{plant}_{name}"))?;
    for s in &mut mesh.subsets {
        s.material += first_material;
    }
    // Without the key `size` a mesh keeps the size of its file; one that lies in the plane y = 0 counts as 1 mm long.
    let own = f64::from(mesh.bounds().max.y.max(1e-3));
    let size = recipe.keys.size.unwrap_or(own);
    let petiole = recipe.keys.petiole.unwrap_or(0.0);
    Ok(OrganSpec { name: name.to_owned(), meshes: vec![Arc::new(mesh)], size, petiole })
}

/// Adds a surface of a companion file as an organ, in the turtle's colours, or with a texture of the view file.
fn add_surface_organ(
    set: &mut MaterialSet,
    recipe: &OrganRecipe,
    plant: &PlantRecipe,
    name: &str,
) -> Result<OrganSpec> {
    let Some(surface) = &recipe.surface else { return Err(Error::input("S005", "an organ without its surface")) };
    let texture = set.textures.get(&surface.texture).copied();
    let mesh = match &surface.form {
        SurfaceForm::Patches(file) => patch_mesh(file, surface.quads, texture),
        SurfaceForm::Triangles(triangles) => triangle_mesh(triangles, texture),
    };
    // A surface beyond all bounds gets no mesh: the turtle then warns that its letter draws nothing.
    let bounds = mesh.bounds();
    let drawable = bounds.max.is_finite()
        && bounds.min.is_finite()
        && bounds.max.abs().max(bounds.min.abs()).max_element() < MAX_EXTENT;
    let longest = f64::from(bounds.max.y);
    let meshes = if drawable { vec![Arc::new(mesh)] } else { Vec::new() };
    // Without a size of the scene, a unit of the surface is a turtle unit times the scale of its line.
    let unit = surface.scale * plant.turtle.unit;
    let own = if longest > 1e-9 { longest * unit } else { unit };
    let size = recipe.keys.size.unwrap_or(own);
    let petiole = recipe.keys.petiole.unwrap_or(0.0);
    Ok(OrganSpec { name: name.to_owned(), meshes, size, petiole })
}

/// Adds the two-sided material of a thin surface with a picture as its colour map; returns its index.
fn add_texture(set: &mut MaterialSet, picture: &Image, name: &str) -> Result<u32> {
    let mut material = Material::plain(name.to_owned(), MaterialClass::Leaf, [0.5; 3], SURFACE_ROUGHNESS);
    material.double_sided = true;
    material.maps.color = Some(0);
    set.add(material, vec![Image { name: format!("{name}_color"), ..picture.clone() }])
}

/// A bark of pictures.
fn bark_from_pictures(keys: &BarkKeys, pictures: &BarkPictures, name: String) -> SurfaceMaterial {
    let mut images = vec![Image { name: format!("{name}_color"), ..pictures.color.clone() }];
    images.extend(pictures.normal.clone().map(|normal| Image { name: format!("{name}_normal"), ..normal }));
    // White, as of imported meshes: PLY then takes the colours of vertices from the picture.
    let mut material = Material::plain(name, MaterialClass::Bark, [1.0; 3], BARK_ROUGHNESS);
    material.tile = keys.tile.map_or(BARK_TILE, narrow);
    (material.maps.color, material.maps.normal) = (Some(0), pictures.normal.as_ref().map(|_| 1));
    SurfaceMaterial { material, images }
}

/// Parameters of a bark: those of its kind, overridden by the keys that are set.
fn bark_spec(keys: &BarkKeys, seed: u64) -> BarkSpec {
    let own = match keys.kind {
        BarkKind::Furrowed => BarkSpec::furrowed(),
        BarkKind::Ridged => BarkSpec::ridged(),
        BarkKind::Plated => BarkSpec::plated(),
        BarkKind::Smooth => BarkSpec::smooth(),
        BarkKind::Lenticel => BarkSpec::birch(),
        BarkKind::Scarred => BarkSpec::scarred(),
        BarkKind::Diamond => BarkSpec::poplar(),
        BarkKind::Stringy => BarkSpec::stringy(),
        BarkKind::Shoot => BarkSpec::shoot(),
        BarkKind::Culm => BarkSpec::culm(),
    };
    // The second colour is that of the marks where a bark has some, else that of its cracks.
    let marked = matches!(keys.kind, BarkKind::Lenticel | BarkKind::Scarred | BarkKind::Diamond);
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
