//! Skeletons of artists' meshes: the axes of the wood are extracted, and the unchanged mesh is bound to them.
//!
//! `parts` separates blades from wood; `thickness` measures the wood, `refine` and `clusters` divide its surface into clusters.
//! Their centroids become a tree (`graph`), chains (`chains`) and axes (`axes`). `bind` binds every vertex to an axis, and
//! `leaves` turns the blades into organs.

mod axes;
mod bind;
mod chains;
mod clusters;
mod graph;
mod leaves;
mod parts;
mod refine;
mod thickness;
mod wood_search;

use std::sync::Arc;

use glam::Vec3;

use axes::{ClusterSite, ClusterSurface};
use bind::AxisPosition;
use clusters::Clusters;
use graph::SkeletonGraph;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::math::narrow;
use osier_base::par::par_map;
use osier_base::progress::Cancel;
use osier_base::rng::{Rng, mix64, word};
use osier_base::{Error, Result};
use osier_import::Imported;
use osier_scene::Mesh;
use osier_scene::plant::{self, NONE, Plant};
use parts::{MeshParts, WoodPiece};
use refine::{ClusterSizes, RefinedSurface};

/// Smallest cluster, where sizes follow the radius, as a share of the plant's diagonal. Smaller ones would follow every knot of
/// the bark.
const MIN_CLUSTER_DIAGONAL_SHARE: f32 = 1.0 / 1500.0;
/// Smallest cluster as a share of the total length of the wood: bounds the number of clusters, and so the time, for bushes of
/// thin twigs.
const MIN_CLUSTER_LENGTH_SHARE: f64 = 1.0 / 12_000.0;
/// A root that begins above this share of the plant's height counts as floating (X019): lower ones may be roots or suckers.
const FLOATING_HEIGHT: f32 = 0.1;

/// What counts as a blade, how close clusters lie and where the trunk begins when a mesh becomes a plant.
#[derive(Debug, Clone, Default)]
pub struct SkeletonOptions {
    /// Name of the file, for messages.
    pub name: String,
    /// Words in lower case: objects and materials whose names contain one of them are blades.
    pub leaf_words: Vec<String>,
    /// Distance of the clusters along the wood, m; `None`: three times the radius of the wood.
    pub spacing: Option<f32>,
    /// Where the trunk begins, m; `None`: at the lowest thick end.
    pub root: Option<Vec3>,
    /// Seed of the draws that place the first clusters; the skeleton depends on it.
    pub seed: u64,
}

/// A plant extracted from a mesh, with that mesh.
#[derive(Debug, Clone, Default)]
pub struct MeshPlant {
    /// Axes and organs, with ids of a plant of id 0.
    pub plant: Plant,
    /// The artist's mesh without the blades that became organs: points, normals and texture coordinates are unchanged.
    pub wood: Arc<Mesh>,
    /// For each point of `wood`, the index of its axis and the arc length on it, m.
    pub bindings: Vec<(u32, f32)>,
    /// Warnings: floating pieces, leaves that stay rigid.
    pub report: Report,
}

impl MeshPlant {
    /// Copy of the plant with the id, seed and source of an individual. Individuals of one mesh differ only in these and in the
    /// ids and tints that follow from them.
    pub fn individual(&self, id: u32, seed: u64, source: &str) -> Plant {
        let mut plant = self.plant.clone();
        (plant.id, plant.seed, plant.source) = (id, seed, source.into());
        assign_ids(&mut plant);
        plant
    }
}

/// Finds the skeleton of a mesh and binds the mesh to it.
/// Source: [yang-wu] 3.1: k-means clusters of the vertices, joined to a tree.
/// Differs: the number of clusters comes from the thickness of the wood, pieces are joined where their ends meet bark, and
/// a branch's first node stands on its parent's bark, so that the mesh bends there without a tear.
/// # Errors
/// `Input` with X018 for a mesh without wood or without volume; the errors of `plant::validate`; `Cancelled`.
pub fn extract_skeleton(imported: &Imported, options: &SkeletonOptions, cancel: &Cancel) -> Result<MeshPlant> {
    let parts = parts::classify_triangles(imported, &options.leaf_words);
    let solid: Vec<&WoodPiece> = parts.wood.iter().filter(|p| parts.has_axes(p)).collect();
    if solid.is_empty() {
        return Err(no_skeleton_error(&parts, options));
    }
    let diagonal = imported.mesh.bounds().size().length();
    // Length of the tube of this area and volume: A = 2 pi r l and V = pi r^2 l give l = A^2 / (4 pi V).
    let length = |p: &&WoodPiece| p.area * p.area / (4.0 * std::f64::consts::PI * p.volume.abs());
    let least = narrow(solid.iter().map(length).sum::<f64>() * MIN_CLUSTER_LENGTH_SHARE)
        .max(diagonal * MIN_CLUSTER_DIAGONAL_SHARE);
    let sizes = ClusterSizes { fixed: options.spacing, least };
    // Cluster the pieces in parallel, each with a random stream of its own number.
    let numbered: Vec<(u64, &WoodPiece)> = (0..).zip(solid.iter().copied()).collect();
    let refined = par_map(&numbered, |(i, piece)| -> Result<(RefinedSurface, Clusters)> {
        cancel.check()?;
        let fine = RefinedSurface::new(piece, sizes);
        let clusters = clusters::find_clusters(&fine, &mut Rng::at(options.seed, &["kmeans".into(), (*i).into()]));
        Ok((fine, clusters))
    });
    let refined = refined.into_iter().collect::<Result<Vec<_>>>()?;
    // Clusters become one tree, the tree becomes chains, and chains become axes.
    let mut graph = SkeletonGraph::default();
    refined.iter().for_each(|(fine, clusters)| graph.add(fine, clusters));
    graph.join(diagonal);
    let cluster_surfaces = cluster_surfaces(&graph, &refined);
    let chains = chains::find_chains(&graph, options.root);
    let mut plant = Plant::default();
    let sites = axes::add_axes(&mut plant, &graph, &chains, &cluster_surfaces);
    plant::validate(&mut plant)?;
    let mut tree = MeshPlant { plant, ..MeshPlant::default() };
    warn_floating_pieces(&mut tree, options);
    // Ids come last: they hash the ranks of axes and organs, which are final only now.
    tree.bind_mesh(imported, &parts, &ClusterSites { graph: &graph, refined: &refined, sites: &sites }, options);
    assign_ids(&mut tree.plant);
    plant::validate(&mut tree.plant)?;
    Ok(tree)
}

/// X018 with its cause: all of the mesh is blades by name, or the wood encloses no volume.
fn no_skeleton_error(parts: &MeshParts, options: &SkeletonOptions) -> Error {
    let file = &options.name;
    let (message, help) = if parts.wood.is_empty() {
        (
            format!("\"{file}\" has no wood: all of it is leaves by name"),
            "name fewer words in leaf_pattern, or rename the objects and materials of the wood; a single leaf is the `mesh` of \
             [plants.NAME.leaf] of a plant that bears it",
        )
    } else {
        (
            format!("\"{file}\" encloses no volume, so its wood has no thickness and no axis"),
            "model trunk and branches as tubes: cards and single lines have no skeleton; a single leaf is the `mesh` of \
             [plants.NAME.leaf] of a plant that bears it",
        )
    };
    Diagnostic::about("X018", message).help(help).into()
}

/// Surface points by node of the graph; a node also gets those of the bumps that were merged into it.
fn cluster_surfaces(graph: &SkeletonGraph, refined: &[(RefinedSurface, Clusters)]) -> Vec<ClusterSurface> {
    let mut cluster_surfaces = vec![ClusterSurface::default(); graph.nodes.len()];
    for ((fine, clusters), of) in refined.iter().zip(&graph.nodes_of_clusters) {
        for (i, c) in clusters.cluster_of.iter().enumerate() {
            let Some(skin) = of.get(*c as usize).and_then(|n| cluster_surfaces.get_mut(*n as usize)) else { continue };
            skin.points.push((fine.points[i], fine.normals[i]));
            skin.areas.push(fine.areas[i]);
        }
    }
    cluster_surfaces
}

/// Warns (X019) of pieces of wood that are joined to no other and begin above `FLOATING_HEIGHT`.
fn warn_floating_pieces(tree: &mut MeshPlant, options: &SkeletonOptions) {
    let plant = &tree.plant;
    // The first root is the trunk; any other that begins well above the ground has nothing to grow from.
    let low = plant.nodes.p.iter().fold(f32::INFINITY, |m, p| m.min(p.y));
    let high = plant.nodes.p.iter().fold(f32::NEG_INFINITY, |m, p| m.max(p.y));
    let base = |a: &plant::Axis| plant.nodes.p[a.first as usize];
    let roots = plant.axes.iter().filter(|a| a.parent == NONE).skip(1);
    let high_up: Vec<Vec3> = roots.map(base).filter(|p| p.y > low + FLOATING_HEIGHT * (high - low)).collect();
    if let Some(p) = high_up.first() {
        let (file, n) = (&options.name, high_up.len());
        let message = format!(
            "\"{file}\": {n} pieces of wood float, the first at ({:.2}, {:.2}, {:.2}); their bases do not move",
            p.x, p.y, p.z
        );
        tree.report
            .push(Diagnostic::about("X019", message).help("let each branch begin inside the wood that it grows on"));
    }
}

/// Sites of the clusters of all pieces on the plant.
struct ClusterSites<'a> {
    graph: &'a SkeletonGraph,
    /// Surface and clusters of each solid piece.
    refined: &'a [(RefinedSurface, Clusters)],
    /// Site of each node of the graph.
    sites: &'a [ClusterSite],
}

impl MeshPlant {
    /// Turns blades into organs, and binds every vertex of the remaining mesh to an axis.
    fn bind_mesh(
        &mut self,
        imported: &Imported,
        parts: &MeshParts,
        cluster_sites: &ClusterSites<'_>,
        options: &SkeletonOptions,
    ) {
        // `left`: blades that cannot become organs; they stay in the mesh.
        let near = bind::wood_search(&self.plant);
        let left = leaves::place_leaves(&mut self.plant, &imported.mesh, &parts.blades, &near);
        self.warn_rigid_leaves(imported, parts, &left, options);
        // A vertex of solid wood is bound near the node of its own cluster.
        let mut sites: Vec<Option<AxisPosition>> = vec![None; parts.welded.points.len()];
        let mut loose: Vec<Vec<u32>> = Vec::new();
        let mut solid = cluster_sites.refined.iter().zip(&cluster_sites.graph.nodes_of_clusters);
        for piece in &parts.wood {
            if !parts.has_axes(piece) {
                loose.push(piece.welded.clone());
                continue;
            }
            let Some(((_, clusters), of)) = solid.next() else { continue };
            for ((w, p), c) in piece.welded.iter().zip(&piece.points).zip(&clusters.cluster_of) {
                let Some(site) = of.get(*c as usize).and_then(|n| cluster_sites.sites.get(*n as usize)) else {
                    continue;
                };
                sites[*w as usize] = Some(bind::vertex_site(&self.plant, *site, *p));
            }
        }
        // Loose parts and rigid leaves are bound as a whole, to the nearest wood.
        let stays = left.large.iter().chain(&left.unmatched);
        let welded = |t: &u32| imported.mesh.triangles[*t as usize].map(|i| parts.welded.welded_index[i as usize]);
        loose.extend(stays.clone().map(|i| parts.blades[*i].iter().flat_map(welded).collect()));
        let held = par_map(&loose, |part| {
            let points: Vec<Vec3> = part.iter().map(|i| parts.welded.points[*i as usize]).collect();
            bind::nearest_point_of_part(&near, &points).map(|h| h.2)
        });
        for (part, site) in loose.iter().zip(held) {
            part.iter().for_each(|i| sites[*i as usize] = sites[*i as usize].or(site));
        }
        // The organs' triangles are removed from the mesh; those of rigid leaves stay.
        let mut removed = vec![false; imported.mesh.triangles.len()];
        parts.blades.iter().flatten().for_each(|t| removed[*t as usize] = true);
        stays.flat_map(|i| &parts.blades[*i]).for_each(|t| removed[*t as usize] = false);
        let (wood, used) = leaves::remaining_mesh(&imported.mesh, &removed);
        let site = |i: &u32| {
            let place = parts.welded.welded_index[*i as usize] as usize;
            // Vertices of degenerate triangles belong to no piece: they are bound to the nearest wood.
            let near = || near.nearest(parts.welded.points[place]).map_or((0, 0.0), |n| n.1);
            sites[place].unwrap_or_else(near)
        };
        self.bindings = used.iter().map(site).collect();
        self.wood = Arc::new(wood);
    }

    /// Warns (X019) of blades that stay rigid because they did not become organs.
    fn warn_rigid_leaves(
        &mut self,
        imported: &Imported,
        parts: &MeshParts,
        left: &leaves::UnplacedLeaves,
        options: &SkeletonOptions,
    ) {
        let file = &options.name;
        if let Some(i) = left.large.first() {
            let size = leaves::bounds(&imported.mesh, &parts.blades[*i]).size().max_element();
            let n = left.large.len();
            let message = format!(
                "\"{file}\": {n} leaves are as large as a quarter of the plant, the first {size:.2} m; they do not flutter"
            );
            let help = "separate the leaves: those that share vertices are one";
            self.report.push(Diagnostic::about("X019", message).help(help));
        }
        if !left.unmatched.is_empty() {
            let n = left.unmatched.len();
            let message = format!(
                "\"{file}\": {n} leaves have shapes beyond the first 4096; they move with their twigs and do not flutter"
            );
            let help =
                "copy a few leaf shapes instead of modelling every leaf: at most 4096 different shapes become organs";
            self.report.push(Diagnostic::about("X019", message).help(help));
        }
    }
}

/// Sets the ids of axes and organs: hashes of the parent's id and the rank among its children.
fn assign_ids(plant: &mut Plant) {
    // Children are numbered in the order of the axes, which is their order along the parent.
    let mut roots = 0_u64;
    let mut ranks = vec![0_u64; plant.axes.len()];
    for i in 0..plant.axes.len() {
        let parent = plant.axes[i].parent as usize;
        plant.axes[i].id = match ranks.get_mut(parent) {
            Some(rank) => {
                *rank += 1;
                mix64(&[plant.axes[parent].id, word("axis"), *rank - 1])
            }
            None => {
                roots += 1;
                mix64(&[u64::from(plant.id), roots - 1])
            }
        };
    }
    leaves::assign_ids(plant);
}

#[cfg(test)]
mod tests;
