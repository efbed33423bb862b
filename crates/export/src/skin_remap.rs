//! Influences of a skin of which only some joints are written.

use osier_scene::SkinWeights;

/// Influences over the written joints: largest first, no joint twice, unused slots joint 0 with weight 0, sum 1. `carrier`: for each
/// joint of the skeleton the written joint that moves its vertices.
pub(super) fn remap_influences(skin: &SkinWeights, carrier: &[u16]) -> SkinWeights {
    let (joints, weights) =
        skin.joints.iter().zip(&skin.weights).map(|(j, w)| merge_influences(carrier, *j, *w)).unzip();
    SkinWeights { joints, weights }
}

/// The influences of one vertex as [`remap_influences`] has them, those of one carrier summed.
pub(super) fn merge_influences(carrier: &[u16], joints: [u16; 4], weights: [f32; 4]) -> ([u16; 4], [f32; 4]) {
    let mut list: Vec<(u16, f32)> = Vec::with_capacity(4);
    for (j, w) in joints.iter().zip(weights).filter(|(_, w)| *w > 0.0) {
        let carrier = carrier.get(usize::from(*j)).copied().unwrap_or(0);
        // At most four influences: a linear search is the fastest, and the order of summation is that of the slots.
        match list.iter_mut().find(|(k, _)| *k == carrier) {
            Some((_, sum)) => *sum += w,
            None => list.push((carrier, w)),
        }
    }
    // Joints that follow the same carrier have been summed; the sums are normalised again if they are not 1 already.
    list.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let total = list.iter().fold(0.0, |s, (_, w)| s + w);
    let (mut j, mut w) = ([0; 4], [0.0; 4]);
    for (k, (joint, weight)) in list.iter().enumerate() {
        j[k] = *joint;
        w[k] = if (total - 1.0).abs() > 1e-6 { weight / total } else { *weight };
    }
    if list.is_empty() {
        // A vertex without influences would collapse to the origin; joint 0, the root, holds it instead.
        w[0] = 1.0;
    }
    (j, w)
}
