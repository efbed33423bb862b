//! Colour and occlusion of leaves as tables beside the USD files: Blender's importer drops the primvars of instancers.

use std::collections::BTreeMap;

use super::LeavesEntry;
use osier_base::Result;
use osier_base::files::Folder;
use osier_scene::{Asset, AttributeData, CANOPY_OCCLUSION, Instancer, LEAF_COLOR, Scene};

/// Path of the table of an asset in the folder of a bake.
fn leaves_file(asset: &Asset) -> String {
    format!("usd/{}.leaves.f4", asset.id)
}

/// The instancers of an asset whose leaves have a colour or an occlusion.
fn leafy(asset: &Asset) -> impl Iterator<Item = &Instancer> {
    let has = |i: &&Instancer| [LEAF_COLOR, CANOPY_OCCLUSION].iter().any(|name| i.rest.attribute(name).is_some());
    asset.instancers.iter().filter(has)
}

/// Writes for each asset whose leaves have a colour or an occlusion a table: for each instance, instancer after instancer, four
/// little-endian 32-bit floats: linear red, green, blue (1 without colours) and the occlusion by the crown (0 without).
/// # Errors
/// Whatever the folder refuses.
pub fn write_leaves(folder: &Folder, scene: &Scene) -> Result<()> {
    for asset in scene.assets.iter().filter(|a| leafy(a).next().is_some()) {
        let Some(mut out) = folder.create(&leaves_file(asset), "f4.leaves", None)? else { continue };
        for instancer in leafy(asset) {
            let colors = match instancer.rest.attribute(LEAF_COLOR) {
                Some(AttributeData::Unit4(colors)) => Some(colors),
                _ => None,
            };
            let row = |i: usize| {
                let [r, g, b, _] = colors.and_then(|c| c.get(i)).copied().unwrap_or([1.0; 4]);
                [r, g, b, instancer.rest.canopy_occlusion(i)]
            };
            let rows: Vec<u8> = (0..instancer.len()).flat_map(row).flat_map(f32::to_le_bytes).collect();
            out.put(&rows)?;
        }
        out.commit()?;
    }
    Ok(())
}

/// The manifest's entry of an asset's table of leaves; `None` without a table. `paths`: files of the bake.
pub(super) fn leaves_entry(asset: &Asset, paths: &[&str]) -> Option<LeavesEntry> {
    let file = leaves_file(asset);
    if !paths.contains(&file.as_str()) {
        return None;
    }
    let instancers: BTreeMap<String, usize> = leafy(asset).map(|i| (i.name.clone(), i.len())).collect();
    let has = |name: &str| leafy(asset).any(|i| i.rest.attribute(name).is_some());
    let order = leafy(asset).map(|i| i.name.clone()).collect();
    Some(LeavesEntry { file, order, instancers, color: has(LEAF_COLOR), occlusion: has(CANOPY_OCCLUSION) })
}
