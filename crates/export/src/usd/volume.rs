//! Volumes of the wrapper: prims that show the OpenVDB files beside it, frame by frame.

use super::context::UsdContext;
use super::layer::LayerBuilder;
use super::layer_writer::AttrSpec;
use super::value::UsdValue;
use crate::vdb::{volume_files, volume_path};
use osier_base::Result;

/// Defines a Volume below `root` for each file of the scene's volumes, with a field for each grid. `frames`: numbers of the
/// frames that were written, increasing.
pub(super) fn define_volumes(cx: &UsdContext, layer: &mut LayerBuilder, root: &str, frames: &[u32]) -> Result<()> {
    let scene = &cx.scene;
    for file in volume_files(scene) {
        // `plan_placements` leaves the name to the volume.
        let path = format!("{root}/{file}");
        layer.define_plain_prim(&path, "Volume")?;
        for grid in scene.volumes.iter().filter(|g| g.file == file) {
            let field = format!("{path}/{}", grid.name);
            layer.writer.create_relationship(&format!("{path}.field:{}", grid.name), std::slice::from_ref(&field))?;
            layer.define_plain_prim(&field, "OpenVDBAsset")?;
            layer.set_attr(&format!("{field}.fieldName"), "token", UsdValue::Token(grid.name))?;
            let files = layer.writer.create_attr(&format!("{field}.filePath"), &AttrSpec::new("asset"), None)?;
            for frame in frames.iter().filter(|n| grid.is_due(n.saturating_sub(scene.clip.start))) {
                let path = format!("./{}", volume_path(scene, file, *frame));
                layer.writer.set_time_sample(files, f64::from(*frame), UsdValue::Asset(&path))?;
            }
        }
    }
    Ok(())
}
