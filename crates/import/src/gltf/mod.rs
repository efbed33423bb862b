//! glTF 2.0, text and binary. The `gltf` crate validates the document; buffers, accessors and pictures are read here, since
//! it would open any path and trust any number.

mod accessor;
mod buffers;
mod container;
mod document;
mod materials;
mod nodes;
mod primitives;

use self::buffers::Buffers;
use self::document::Document;
use super::assembly::join;
use super::{Job, Made, Outcome};
use osier_base::limits::grouped;

/// Most nodes of a file.
const NODES: usize = 1_000_000;

/// Reads a `.gltf` or `.glb` file with what it refers to.
pub(super) fn read(job: &mut Job<'_>, bytes: &[u8]) -> Outcome<Made> {
    let limit = job.options.limits.get("mesh-bytes");
    if bytes.len() as u64 > limit {
        let limit = grouped(limit);
        let message = format_args!("is longer than {} bytes", limit);
        return Err(Box::new(job.fault("X010", message).help("raise the limit with --max-mesh-bytes")));
    }
    let parts = container::split(job, bytes)?;
    let Some(document) = Document::read(job, parts.json)? else { return Ok(Made::default()) };
    let nodes = document.root.nodes.len();
    if nodes > NODES {
        let message = format_args!("has {} nodes, the limit is {}", grouped(nodes as u64), grouped(NODES as u64));
        return Err(job.fault("X010", message));
    }
    let buffers = Buffers::load(job, &document.root, parts.bin)?;
    let placed = nodes::walk(job, &document, &buffers)?;
    let mut surfaces = materials::Surfaces::new(&document, &buffers);
    let pieces = primitives::pieces(job, &document, &buffers, &placed, &mut surfaces)?;
    let mesh = join(job, pieces)?;
    let (materials, images) = surfaces.finish();
    Ok((mesh, materials, images))
}
