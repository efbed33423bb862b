//! Influences of a skin of which only some joints are written, and weights as bytes.

use osier_scene::SkinWeights;

/// Influences over the written joints: largest first, no joint twice, unused slots joint 0 with weight 0, sum 1. `carrier`: for
/// each joint of the skeleton the written joint that moves its vertices.
pub(super) fn remap_influences(skin: &SkinWeights, carrier: &[u16]) -> SkinWeights {
    let (joints, weights) =
        skin.joints.iter().zip(&skin.weights).map(|(j, w)| merge_influences(carrier, *j, *w)).unzip();
    SkinWeights { joints, weights }
}

/// The influences of one vertex as in [`remap_influences`]; those with the same carrier are summed.
pub(super) fn merge_influences(carrier: &[u16], joints: [u16; 4], weights: [f32; 4]) -> ([u16; 4], [f32; 4]) {
    let mut list: Vec<(u16, f32)> = Vec::with_capacity(4);
    for (j, w) in joints.iter().zip(weights).filter(|(_, w)| *w > 0.0) {
        let carrier = carrier.get(usize::from(*j)).copied().unwrap_or(0);
        // There are at most four influences: a linear search is the fastest, and they are summed in the order of the
        // slots.
        match list.iter_mut().find(|(k, _)| *k == carrier) {
            Some((_, sum)) => *sum += w,
            None => list.push((carrier, w)),
        }
    }
    // Influences of joints with the same carrier are summed; normalise the sums again if they do not add up to 1.
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

/// Weights of four joints as bytes that sum to 255.
pub(super) fn byte_weights(weights: &[f32; 4]) -> [u8; 4] {
    integer_weights(weights, 255).map(|w| u8::try_from(w).unwrap_or(u8::MAX))
}

/// Weights of four joints as integers that sum to `total`, at most 2^15: each is rounded down, then those with the
/// largest remainders are raised by 1.
pub(super) fn integer_weights(weights: &[f32; 4], total: u16) -> [u16; 4] {
    let sum: f32 = weights.iter().sum();
    let most = f32::from(total);
    let scaled = weights.map(|w| if sum > 0.0 { w / sum * most } else { 0.0 });
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the total")]
    let mut whole = scaled.map(|w| w.clamp(0.0, most) as u16);
    // The largest remainder method: the numbers that lost most by rounding get the missing units; ties go to the lower index.
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a: &usize, &b: &usize| scaled[b].fract().total_cmp(&scaled[a].fract()).then(a.cmp(&b)));
    let missing = total - whole.iter().sum::<u16>().min(total);
    for k in order.into_iter().cycle().take(usize::from(missing.min(4))) {
        whole[k] += 1;
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_of_bytes_sum_to_255() {
        for weights in [[1.0, 0.0, 0.0, 0.0], [0.25; 4], [0.333, 0.333, 0.334, 0.0], [0.9, 0.05, 0.03, 0.02]] {
            let bytes = byte_weights(&weights);
            assert_eq!(bytes.iter().map(|b| u32::from(*b)).sum::<u32>(), 255, "{weights:?}");
            let worst = weights.iter().zip(bytes).map(|(w, b)| (w * 255.0 - f32::from(b)).abs()).fold(0.0, f32::max);
            assert!(worst < 1.0, "{weights:?} {bytes:?}");
            assert_eq!(integer_weights(&weights, 1023).iter().sum::<u16>(), 1023, "{weights:?}");
        }
    }
}
