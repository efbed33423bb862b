//! An asset as one mesh, for formats without instances.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};

use crate::scene::{Asset, InstanceState, Instancer, Mesh, Subset, Trs, WindPoint};

/// All meshes and live instances of an asset at rest, moved by `world`, as one mesh with one subset per material in
/// order of first use. Texture coordinates are zero where a part has none, attributes for wind likewise; vertex colours are dropped.
pub(super) fn merged(asset: &Asset, world: &Trs) -> Mesh {
    let mut all = Merge::default();
    for object in &asset.meshes {
        all.add(&object.mesh, world);
    }
    for instancer in &asset.instancers {
        for (mesh, trs) in shown(instancer, &instancer.rest) {
            all.add(mesh, &world.then_inner(&trs));
        }
    }
    all.finish()
}

/// Live instances with their prototypes' meshes.
fn shown<'a>(instancer: &'a Instancer, state: &'a InstanceState) -> impl Iterator<Item = (&'a Mesh, Trs)> {
    (0..instancer.len()).filter(|i| state.is_alive(*i)).filter_map(|i| {
        let proto = instancer.protos.get(i).and_then(|p| instancer.prototypes.get(*p as usize))?;
        Some((&proto.mesh, instancer.transform(state, i)))
    })
}

#[derive(Default)]
struct Merge {
    mesh: Mesh,
    has_uvs: bool,
    order: Vec<u32>,
    triangles: BTreeMap<u32, Vec<[u32; 3]>>,
}

impl Merge {
    fn add(&mut self, part: &Mesh, trs: &Trs) {
        let base = u32::try_from(self.mesh.points.len()).unwrap_or(u32::MAX);
        let turned = trs.s.x * trs.s.y * trs.s.z < 0.0;
        self.mesh.points.extend(part.points.iter().map(|p| trs.apply(*p)));
        self.mesh.normals.extend(part.normals.iter().map(|n| normal(trs, *n)));
        if part.uvs.is_empty() {
            self.mesh.uvs.resize(self.mesh.points.len(), Vec2::ZERO);
        } else {
            self.has_uvs = true;
            self.mesh.uvs.extend_from_slice(&part.uvs);
        }
        if !part.wind.is_empty() {
            self.mesh.wind.resize(base as usize, WindPoint::default());
            self.mesh.wind.extend_from_slice(&part.wind);
        }
        for subset in &part.subsets {
            let list = self.triangles.entry(subset.material).or_insert_with(|| {
                self.order.push(subset.material);
                Vec::new()
            });
            let corners = part.subset_triangles(subset).iter().map(|t| t.map(|v| v.saturating_add(base)));
            list.extend(corners.map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }));
        }
    }

    fn finish(mut self) -> Mesh {
        for material in &self.order {
            let list = self.triangles.get(material).map_or(&[][..], Vec::as_slice);
            let first = u32::try_from(self.mesh.triangles.len()).unwrap_or(u32::MAX);
            let count = u32::try_from(list.len()).unwrap_or(u32::MAX);
            self.mesh.triangles.extend_from_slice(list);
            self.mesh.subsets.push(Subset { material: *material, first, count });
        }
        if !self.has_uvs {
            self.mesh.uvs.clear();
        }
        if !self.mesh.wind.is_empty() {
            self.mesh.wind.resize(self.mesh.points.len(), WindPoint::default());
        }
        self.mesh
    }
}

/// A normal under a transform: inverse scale, then rotation.
fn normal(trs: &Trs, n: Vec3) -> Vec3 {
    let safe = |s: f32| if s == 0.0 { 1.0 } else { s };
    let scaled = Vec3::new(n.x / safe(trs.s.x), n.y / safe(trs.s.y), n.z / safe(trs.s.z));
    crate::math::normalize_or(trs.r * scaled, n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirrored_part_keeps_its_outside() {
        let mesh = Mesh {
            points: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        }
        .with_material(0);
        let mut all = Merge::default();
        all.add(&mesh, &Trs { s: Vec3::new(1.0, 1.0, -2.0), ..Trs::IDENTITY });
        let out = all.finish();
        let [a, b, c] = out.triangles[0].map(|i| out.points[i as usize]);
        assert!((b - a).cross(c - a).dot(out.normals[0]) > 0.0);
        assert!((out.normals[0] + Vec3::Z).length() < 1e-6 && out.uvs.is_empty());
    }
}
