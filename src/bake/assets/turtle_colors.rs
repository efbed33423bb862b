//! Materials for the colour indices that turtles have given axes and shapes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::scene::plant_layout::PlantLayout;
use crate::recipe::{Growth, Recipe};
use osier_base::Result;
use osier_base::convert::to_usize;
use osier_grammar::companion::ColorTable;
use osier_plants::grow::turtle::Paint;
use osier_scene::plant::{PAINTED, Plant};
use osier_scene::{Material, MaterialClass, Mesh};

/// Least translucency of thin surfaces. Own: petals and leaves let some light through, half as much as a blade of a scene.
const THIN_TRANSLUCENCY: f32 = 0.15;

/// Adds one material for every colour index that the grown plants of a kind use, and assigns it to their shapes. `grown`:
/// parallel to the individuals of the layout.
/// # Errors
/// `TooMany` beyond 2^32 materials.
pub(crate) fn add_worn_colors(
    recipe: &Recipe,
    layout: &PlantLayout,
    sets: &mut [MaterialSet],
    grown: &mut [GrownPlant],
) -> Result<()> {
    for (kind, (plant, set)) in recipe.plants.iter().zip(sets).enumerate() {
        // A sorted set: materials are added in the order of the colour indices, whatever the order of the plants.
        let individuals = || layout.individuals.iter().enumerate().filter(|(_, n)| n.plant == kind).map(|(i, _)| i);
        let mut worn: BTreeSet<Paint> = BTreeSet::new();
        for grown in individuals().filter_map(|i| grown.get(i)) {
            worn.extend(color_indices_of(&grown.plant));
        }
        if worn.is_empty() {
            continue;
        }
        // A colour file comes before the colours that the grammar itself names.
        let own = match &plant.growth {
            Growth::Grammar(grammar) => ColorTable::of(grammar.notation()).with(grammar.palette()),
            _ => ColorTable::default(),
        };
        let colors = plant.companions.colors.as_ref().unwrap_or(&own);
        let mut materials: BTreeMap<Paint, u32> = BTreeMap::new();
        for paint in worn {
            let id = set.add(color_material(&plant.id, paint, colors), Vec::new())?;
            materials.insert(paint, id);
            // The colours of axes are looked up when their skin is lofted; thin shapes get their materials here.
            if !paint.thin {
                set.paints.extend(u16::try_from(id).ok().map(|id| (paint.index, id)));
            }
        }
        // Plants list the names of all materials of their kind, those just added included.
        let names: Vec<String> = set.materials.iter().map(|m| m.name.clone()).collect();
        for i in individuals() {
            let Some(grown) = grown.get_mut(i) else { continue };
            let first = grown.season.as_mut().map(|s| &mut s.first);
            for plant in std::iter::once(&mut grown.plant).chain(first) {
                plant.materials.clone_from(&names);
                plant.protos.iter_mut().for_each(|p| replace_paints(&mut p.mesh, &materials));
            }
        }
    }
    Ok(())
}

/// The colour indices of a plant's nodes and prototypes, with repetitions.
fn color_indices_of(plant: &Plant) -> impl Iterator<Item = Paint> {
    #[allow(clippy::cast_possible_truncation, reason = "the low byte is the index")]
    let axes = plant.nodes.color.iter().filter(|c| **c & PAINTED != 0).map(|c| Paint { index: *c as u8, thin: false });
    let subsets = plant.protos.iter().flat_map(|p| &p.mesh.subsets);
    let mut last = None;
    // Consecutive nodes mostly have one colour: skipping repetitions keeps the set of the caller from millions of look-ups.
    let axes = axes.filter(move |p| last.replace(*p) != Some(*p));
    axes.chain(subsets.filter_map(|s| Paint::of(s.material)))
}

/// Replaces colour indices that a mesh has as material indices by the materials made for them.
fn replace_paints(mesh: &mut Arc<Mesh>, materials: &BTreeMap<Paint, u32>) {
    if mesh.subsets.iter().all(|s| Paint::of(s.material).is_none()) {
        return;
    }
    for subset in &mut Arc::make_mut(mesh).subsets {
        if let Some(id) = Paint::of(subset.material).and_then(|p| materials.get(&p)) {
            subset.material = *id;
        }
    }
}

/// Material of a colour index, for stems or, if `paint.thin`, for thin surfaces.
fn color_material(plant: &str, paint: Paint, colors: &ColorTable) -> Material {
    let color = colors.get(paint.index);
    let thin = if paint.thin { "_thin" } else { "" };
    let class = if paint.thin { MaterialClass::Leaf } else { MaterialClass::Bark };
    let name = format!("{plant}_color_{}{thin}", paint.index);
    let mut material = Material::plain(name, class, color.base, color.roughness.clamp(0.05, 1.0));
    // Tubes of contours have no end caps, so that their inside can be seen.
    material.double_sided = true;
    material.translucency = if paint.thin { color.transparency.max(THIN_TRANSLUCENCY) } else { color.transparency };
    material
}

/// Sorts the triangles of a skin by the colours of the segments that they lie on. `bindings`: axis and arc length, m, of each point;
/// `paints`: the materials of colour indices.
pub(crate) fn paint_axes(mesh: &mut Mesh, bindings: &[(u32, f32)], plant: &Plant, paints: &BTreeMap<u8, u16>) {
    if paints.is_empty() {
        return;
    }
    let mut by_material: BTreeMap<u32, Vec<[u32; 3]>> = BTreeMap::new();
    for subset in &mesh.subsets {
        for t in mesh.subset_triangles(subset) {
            let material = triangle_color(*t, bindings, plant).and_then(|c| paints.get(&c));
            by_material.entry(material.map_or(subset.material, |m| u32::from(*m))).or_default().push(*t);
        }
    }
    (mesh.triangles, mesh.subsets) = (Vec::new(), Vec::new());
    for (material, triangles) in by_material {
        mesh.append_subset(material, triangles);
    }
}

/// The colour index of the segment under a triangle; `None` if the axis has the material of bark or shoot.
fn triangle_color(triangle: [u32; 3], bindings: &[(u32, f32)], plant: &Plant) -> Option<u8> {
    // Both triangles of a quad span the same arc lengths, and so have the same middle.
    let bound = triangle.map(|i| bindings.get(to_usize(i)).copied().unwrap_or_default());
    let axis = plant.axes.get(to_usize(bound[0].0))?;
    let (low, high) = bound.iter().fold((f32::INFINITY, 0.0_f32), |(l, h), b| (l.min(b.1), h.max(b.1)));
    let (start, _) = plant.segment(axis, 0.5 * (low + high));
    let color = plant.nodes.color.get(start + 1).copied().filter(|c| c & PAINTED != 0)?;
    #[allow(clippy::cast_possible_truncation, reason = "the low byte is the index")]
    Some(color as u8)
}
