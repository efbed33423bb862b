//! Axes that have no tube, appended to a skin as subsets by material.

use super::{PlantSkin, SkinOptions};
use osier_base::limits::grouped;
use osier_base::{Error, Result};
use osier_scene::plant::{Axis, Plant};

/// Appends the points of the axis at an index to the skin, and its triangles to the list.
type AppendAxis = fn(&Plant, &SkinOptions, u32, &mut PlantSkin, &mut Vec<[u32; 3]>) -> Result<()>;

/// A surface that some axes have in place of a tube.
pub(super) struct AxisSurface {
    /// Whether an axis has this surface.
    pub is_of: fn(&Plant, &SkinOptions, &Axis) -> bool,
    pub append: AppendAxis,
    /// Advice in the error `Limit` on what makes the skin smaller.
    pub remedy: &'static str,
}

/// Appends all axes with a surface to the skin, as its last subsets, materials in rising order.
/// # Errors
/// `Limit` for more points than the options allow, and those of [`AxisSurface::append`].
pub(super) fn append_by_material(
    plant: &Plant,
    options: &SkinOptions,
    surface: &AxisSurface,
    skin: &mut PlantSkin,
) -> Result<()> {
    let axes = (0_u32..).zip(&plant.axes).filter(|(_, axis)| (surface.is_of)(plant, options, axis));
    let mut by_material: Vec<(u16, u32)> = axes.map(|(i, axis)| (material(plant, options, axis), i)).collect();
    by_material.sort_unstable();
    for run in by_material.chunk_by(|a, b| a.0 == b.0) {
        let mut triangles = Vec::new();
        for &(_, axis) in run {
            (surface.append)(plant, options, axis, skin, &mut triangles)?;
        }
        skin.mesh.append_subset(run[0].0.into(), triangles);
        if skin.mesh.points.len() as u64 > options.max_points {
            return Err(Error::Limit {
                name: "points of the skin".into(),
                wanted: "more".into(),
                limit: grouped(options.max_points),
                flag: "--max-vertices".into(),
                help: format!("use {}", surface.remedy),
            });
        }
    }
    Ok(())
}

/// Index of the material of an axis: that of shoots if its first node is thinner than [`SkinOptions::shoot`] says.
fn material(plant: &Plant, options: &SkinOptions, axis: &Axis) -> u16 {
    match options.shoot {
        Some((r, shoot)) if plant.nodes.r[axis.first as usize] < r => shoot,
        _ => axis.material,
    }
}
