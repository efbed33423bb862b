//! glTF 2.0, text and binary. The `gltf` crate validates the document; buffers, accessors and images are read here, since
//! it would open any path and trust any number.

mod accessor;
mod buffers;
mod container;
mod document;
mod materials;
mod nodes;
mod primitives;
mod wrap;

use self::buffers::Buffers;
use self::document::GltfDocument;
use super::assembly::join;
use super::{ImportContext, ImportResult, ImportedMesh};
use osier_base::limits::grouped;

/// Most nodes of a file: bounds the time of the traversal.
const MAX_NODES: usize = 1_000_000;

/// Reads a `.gltf` or `.glb` file with what it refers to.
pub(super) fn read(context: &mut ImportContext<'_>, bytes: &[u8]) -> ImportResult<ImportedMesh> {
    let limit = context.options.limits.get("mesh-bytes");
    if bytes.len() as u64 > limit {
        let limit = grouped(limit);
        let message = format_args!("is longer than {} bytes", limit);
        return Err(Box::new(context.error_about_file("X010", message).help("raise the limit with --max-mesh-bytes")));
    }
    let chunks = container::split(context, bytes)?;
    let Some(document) = GltfDocument::read(context, chunks.json)? else { return Ok(ImportedMesh::default()) };
    // Counted before the walk, whose tables have one entry per node.
    let nodes = document.root.nodes.len();
    if nodes > MAX_NODES {
        let message = format_args!("has {} nodes, the limit is {}", grouped(nodes as u64), grouped(MAX_NODES as u64));
        return Err(context.error_about_file("X010", message));
    }
    let buffers = Buffers::load(context, &document, chunks.bin)?;
    let instances = nodes::flatten(context, &document, &buffers)?;
    let mut materials = materials::GltfMaterials::new(&document, &buffers);
    let mut parts = primitives::mesh_parts(context, &document, &buffers, &instances, &mut materials)?;
    let materials::FinishedMaterials { mut materials, mut images, wraps, spent } = materials.finish();
    wrap::unfold(context, &mut parts, &mut materials, &mut images, &wraps, spent);
    let mesh = join(context, parts)?;
    Ok(ImportedMesh { mesh, materials, images })
}
