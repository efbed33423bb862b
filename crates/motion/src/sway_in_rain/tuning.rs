//! Numbers of plants that sway in the rain which were chosen by judgement, with the effect of changing them.

/// Natural frequency of a leaf that nods on its petiole, Hz: between 2 and 6 Hz for broad leaves in the wind. Higher: drops move
/// leaves less far and for a shorter time; lower: leaves sag under their water.
pub(super) const PETIOLE_HZ: f64 = 4.0;
/// Bending stiffness of a petiole divided by its torsional stiffness; grooved petioles twist more easily than they bend (S.
/// Vogel, "Twist-to-bend ratios and cross-sectional shapes of petioles and stems", Journal of Experimental Botany 43, 1992: 2 to
/// 8). Higher: drops beside the midrib roll leaves farther.
pub(super) const PETIOLE_TWIST_RATIO: f64 = 3.0;
/// Largest rotation of a leaf by drops and water, rad. Larger: blades swing through their twigs.
pub(super) const MAX_NOD: f64 = 1.2;
/// Largest bend of an element by drops and water, rad: up to it displacements are linear in the bends within a few percent.
pub(super) const MAX_RAIN_BEND: f64 = 0.4;
/// Angle below which an element or a leaf without load counts as at rest, rad: less than a tenth of a millimetre at the tip of a bough.
/// Larger: motion ends visibly; smaller: more elements and leaves are advanced whose motion is invisible.
pub(super) const REST_ANGLE: f64 = 1e-6;
/// Leaves per parallel task. Affects speed only.
pub(super) const LEAVES_PER_TASK: usize = 1024;
