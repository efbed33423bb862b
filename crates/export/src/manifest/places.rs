//! The placements of assets: lists in the manifest, or a table beside it.

use std::collections::BTreeMap;

use super::{PlaceEntry, PlacesEntry};
use osier_base::Result;
use osier_base::convert::narrow;
use osier_base::files::Folder;
use osier_scene::{Placement, Scene};

/// Path of the table of placements in the folder of a bake.
pub const PLACES_FILE: &str = "places.f4";
/// Placements of a scene up to which the manifest lists them; more are written as a table. Own: about 300 kB of JSON.
pub const MAX_LISTED_PLACES: usize = 1000;

/// Writes the table of placements if a scene has more than [`MAX_LISTED_PLACES`]: for each placement ten little-endian 32-bit
/// floats, in the axes of the scene: index of the asset in the manifest, offset in frames, position x y z in m, rotation as a
/// quaternion x y z w, scale.
/// # Errors
/// `TooMany` if an asset has an index above 65535; whatever the folder refuses.
pub fn write_places(folder: &Folder, scene: &Scene) -> Result<()> {
    if scene.placements.len() <= MAX_LISTED_PLACES {
        return Ok(());
    }
    let Some(mut out) = folder.create(PLACES_FILE, "f4.places", None)? else { return Ok(()) };
    for placement in &scene.placements {
        let row: Vec<u8> = table_row(placement)?.iter().flat_map(|v| v.to_le_bytes()).collect();
        out.put(&row)?;
    }
    out.commit()
}

/// The row of one placement, with the columns listed at [`write_places`].
fn table_row(placement: &Placement) -> Result<[f32; 10]> {
    // Whole numbers up to 2^24 are exact in a 32-bit float; 16 bits are enough for assets and 24 bits hold every frame number.
    let asset: u16 = narrow(placement.asset, "assets of a table of placements")?;
    let offset = osier_base::math::narrow(f64::from(placement.phase));
    let (t, r) = (placement.transform.t, placement.transform.r);
    Ok([f32::from(asset), offset, t.x, t.y, t.z, r.x, r.y, r.z, r.w, placement.transform.s.x])
}

/// The placements as the manifest holds them. `paths`: files of the bake.
pub(super) fn places_entry(scene: &Scene, paths: &[&str]) -> PlacesEntry {
    if paths.contains(&PLACES_FILE) {
        return PlacesEntry::Table(PLACES_FILE.to_owned());
    }
    let mut lists: BTreeMap<String, Vec<PlaceEntry>> = BTreeMap::new();
    // Without the table, the manifest still lists no more placements than the limit, which keeps it small.
    for placement in scene.placements.iter().take(MAX_LISTED_PLACES) {
        let Some(asset) = scene.assets.get(placement.asset) else { continue };
        // Columns of the column-vector form, one after the other, are the rows of the row-vector form. Adding 0 turns -0 into 0.
        let matrix = placement.transform.matrix().to_cols_array().map(|v| v + 0.0);
        lists.entry(asset.id.clone()).or_default().push(PlaceEntry { matrix, offset: placement.phase });
    }
    PlacesEntry::Lists(lists)
}
