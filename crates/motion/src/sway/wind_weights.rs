//! Vertex attributes for shader-based wind: weights and phases.

use crate::sway::tuning::TIP_SWAY_SHARE;
use osier_base::rng;
use osier_scene::plant::{NONE, Organ, Plant};
use osier_scene::{Attribute, AttributeData, InstanceState, LEAF_COLOR, Mesh, Trs, attribute_number, bent_normal};

/// Sway of a vertex as shaders read it; all numbers but the axis from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
struct VertexSway {
    /// Sway with the whole plant, 0 at the root; phase of the limb; flutter of a leaf, 1 at its tip; light that reaches it.
    wind: [f32; 4],
    /// Sway with the branches, 0 on the trunk; a random number of the axis or leaf.
    branch: [f32; 2],
    /// Index of the axis that the vertex is on.
    axis: i32,
}

/// Sway weights along axes: w(s) = 1 - (1 - w(carrier)) (1 - (s / L)^2 / 2), 0 at the root, continuous at forks.
#[derive(Debug)]
pub struct WindWeights<'a> {
    plant: &'a Plant,
    /// Per axis, at its base: weight from the root on, and from the trunk on.
    bases: Vec<[f32; 2]>,
    /// Per axis: phase of the main branch that it grows on, 0 to 1.
    phases: Vec<f32>,
}

impl<'a> WindWeights<'a> {
    /// Computes base weights and phases of all axes, parents first.
    pub fn new(plant: &'a Plant) -> Self {
        let mut all = Self { plant, bases: Vec::new(), phases: Vec::new() };
        for axis in &plant.axes {
            let (base, phase) = if axis.parent == NONE {
                ([0.0; 2], phase_from_id(axis.id))
            } else {
                // Main branches get a phase; all that grows on one sways in its phase.
                let limb = plant.axes[axis.parent as usize].order == 0 && axis.order > 0;
                let phase = if limb { phase_from_id(axis.id) } else { all.phases[axis.parent as usize] };
                (all.at(axis.parent, axis.parent_s), phase)
            };
            all.bases.push(base);
            all.phases.push(phase);
        }
        all
    }

    /// Both weights, 0 to 1, at arc length `s`, m, of an axis: from the root on, and from the trunk on.
    fn at(&self, axis: u32, s: f32) -> [f32; 2] {
        let a = &self.plant.axes[axis as usize];
        let x = (s / a.length.max(1e-9)).clamp(0.0, 1.0);
        let [whole, branch] = self.bases[axis as usize];
        // The rest of the way to weight 1 shrinks along the axis by the factor 1 - x^2 / 2.
        let grown = |w: f32| 1.0 - (1.0 - w) * (1.0 - TIP_SWAY_SHARE * x * x);
        [grown(whole), if a.order == 0 { 0.0 } else { grown(branch) }]
    }

    /// Attributes of a point at arc length `s`, m, of an axis. `id`: identifier of the branch or leaf; `flutter`, `light`: 0 to 1.
    fn point(&self, axis: u32, s: f32, id: u64, flutter: f32, light: f32) -> VertexSway {
        let [whole, branch] = self.at(axis, s);
        let wind = [whole, self.phases[axis as usize], flutter, light];
        VertexSway { wind, branch: [branch, phase_from_id(id)], axis: attribute_number(axis) }
    }

    /// Attributes of bark points, in the order of `bindings`: axis and arc length, m, of each.
    pub fn bark(&self, bindings: &[(u32, f32)]) -> Vec<Attribute> {
        let point = |b: &(u32, f32)| self.point(b.0, b.1, self.plant.axes[b.0 as usize].id, 0.0, 1.0);
        attributes(&bindings.iter().map(point).collect::<Vec<_>>())
    }

    /// All leaves as one mesh with these attributes, and the number of points of each leaf; flutter grows from the foot of the
    /// stalk to the tip. Light and normals are those of the crown if the plant has attributes of them. `worn`: number that is
    /// added to the material indices of the leaves.
    pub fn leaves(&self, organs: &[&Organ], worn: u32) -> (Mesh, Vec<usize>) {
        let (mut all, mut sizes) = (Mesh::default(), vec![0; organs.len()]);
        let values = self.plant.organ_values(organs);
        let crown = InstanceState { attributes: values, ..InstanceState::default() };
        for (i, (organ, size)) in organs.iter().zip(&mut sizes).enumerate() {
            let Some(proto) = self.plant.protos.get(usize::from(organ.proto)) else { continue };
            let (t, r) = self.plant.organ_site(organ);
            let stand = Trs { t, r, s: glam::Vec3::splat(organ.scale) };
            let tip = proto.mesh.points.iter().fold(1e-9_f32, |m, p| m.max(p.y));
            let (light, toward) = (1.0 - crown.canopy_occlusion(i), crown.canopy_normal(i));
            let mut leaf = (*proto.mesh).clone();
            let flutter = |p: &glam::Vec3| (p.y / tip).clamp(0.0, 1.0);
            let sway = leaf.points.iter().map(|p| self.point(organ.axis, organ.s, organ.id, flutter(p), light));
            leaf.attributes = attributes(&sway.collect::<Vec<_>>());
            leaf.points.iter_mut().for_each(|p| *p = stand.apply(*p));
            leaf.normals.iter_mut().for_each(|n| *n = bent_normal(r * *n, toward));
            leaf.subsets.iter_mut().for_each(|s| s.material += worn);
            *size = leaf.points.len();
            all.append(&leaf);
        }
        (all, sizes)
    }

    /// The colours of leaves of a season at each of their points; `None` without a season. `sizes`: number of points of each leaf.
    pub fn leaf_colors(&self, organs: &[&Organ], sizes: &[usize]) -> Option<Attribute> {
        let values = self.plant.organ_values(organs).into_iter().find(|a| a.name == LEAF_COLOR)?;
        let AttributeData::Unit4(colors) = values.data else { return None };
        let at_points = colors.iter().zip(sizes).flat_map(|(c, n)| std::iter::repeat_n(*c, *n)).collect();
        Some(Attribute::vertex(LEAF_COLOR, AttributeData::Unit4(at_points)))
    }
}

/// The attributes `wind`, `wind2` and `wind_axis` of points.
fn attributes(points: &[VertexSway]) -> Vec<Attribute> {
    vec![
        Attribute::vertex("wind", AttributeData::Unit4(points.iter().map(|p| p.wind).collect())),
        Attribute::vertex("wind2", AttributeData::Unit2(points.iter().map(|p| p.branch).collect())),
        Attribute::vertex("wind_axis", AttributeData::I32(points.iter().map(|p| p.axis).collect())),
    ]
}

fn phase_from_id(id: u64) -> f32 {
    osier_base::math::narrow(rng::Rng::from_key(rng::child(id, rng::word("wind phase"))).range(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sway::testing::leafy;

    fn near<const N: usize>(a: [f32; N], b: [f32; N]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6)
    }

    #[test]
    fn weights_start_at_zero_and_are_continuous_at_forks() {
        let plant = leafy(6);
        let weights = WindWeights::new(&plant);
        assert!(near(weights.at(0, 0.0), [0.0, 0.0]));
        assert!(near(weights.at(0, 4.0), [0.5, 0.0]), "half at the tip of the trunk, which is no branch");
        for (i, axis) in (0_u32..).zip(&plant.axes).skip(1) {
            assert!(near(weights.at(i, 0.0), weights.at(axis.parent, axis.parent_s)));
            let [base, tip] = [0.0, axis.length].map(|s| weights.at(i, s));
            assert!(base[0] < tip[0] && base[1] < tip[1] && tip[0] < 1.0 && tip[1] <= tip[0]);
            let limb = if axis.order == 1 { i } else { axis.parent };
            assert!(
                (weights.phases[i as usize] - phase_from_id(plant.axes[limb as usize].id)).abs() < 1e-9,
                "one per limb"
            );
        }
    }

    #[test]
    fn leaf_weights_flutter_at_tips_and_sway_with_twigs() {
        let plant = leafy(2);
        let weights = WindWeights::new(&plant);
        let organs: Vec<&Organ> = plant.organs.iter().collect();
        let (mesh, sizes) = weights.leaves(&organs, 3);
        assert!(sizes.iter().all(|n| *n == 4));
        let wind = |attributes: &[Attribute]| match &attributes[0].data {
            AttributeData::Unit4(wind) => wind.clone(),
            other => panic!("{other:?}"),
        };
        let all = wind(&mesh.attributes);
        assert_eq!((mesh.points.len(), all.len()), (organs.len() * 4, organs.len() * 4));
        assert!(mesh.attributes.iter().all(|a| a.data.len() == mesh.points.len() && a.data.first_invalid().is_none()));
        assert!(mesh.subsets.iter().all(|s| s.material == 3));
        for (organ, leaf) in organs.iter().zip(all.chunks(4)) {
            let whole = weights.at(organ.axis, organ.s)[0];
            assert!(leaf.iter().all(|p| (p[0] - whole).abs() < 1e-9));
            assert!(near([0, 1, 2, 3].map(|k| leaf[k][2]), [0.0, 0.0, 1.0, 1.0]));
        }
        assert!(wind(&weights.bark(&[(0, 2.0)]))[0][2] <= 0.0);
    }
}
