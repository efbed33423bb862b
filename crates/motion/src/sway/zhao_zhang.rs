//! Reference implementation of sway by the equations of [zhao-zhang] 3.2, each internode a separate cantilever.
//!
//! At 60 Hz: F = F_1 + F_2 + F_w, the drag of the wind, less a share of the last force, less a damping force quadratic
//! in the angular velocity; then deflection and angle of the internode. Angles add up along a branch and its carriers.
//! Misprints of the paper can be corrected one by one ([`PaperCorrections`]).

use glam::{DVec3, Vec3};

use super::elements::BeamElements;
use super::simulation::SwayParams;
use osier_base::math;
use osier_scene::plant::Plant;
use osier_wind::Wind;

/// Time steps of the equations per second, as in the paper; independent of the frame rate.
pub(crate) const STEPS_PER_SECOND: f64 = 60.0;
/// Coefficients of drag and lift, as printed.
const DRAG: f64 = 0.013;
const LIFT: f64 = 0.75;
/// Density of air as printed, 2.37e-3 g/m^3, in kg/m^3.
const PRINTED_AIR: f64 = 2.37e-6;

/// Which misprints of the equations are corrected; with all false they are evaluated as printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PaperCorrections {
    /// delta = 4 F L^3 / (3 pi E R^4) instead of R^3.
    pub radius: bool,
    /// 1.225 kg/m^3 instead of the printed density, which is half a million times too small.
    pub air: bool,
    /// Damping opposes the rotation instead of always acting in the same direction.
    pub damping: bool,
}

/// Corrections, and the constants that the paper does not give.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperParams {
    /// Misprints of the equations that are corrected.
    pub fixes: PaperCorrections,
    /// Share k of the last force in F_2 = -k F(t-1), 0 to below 1.
    pub recoil: f64,
    /// k in F_w = k w^2, N s^2.
    pub damping: f64,
}

#[derive(Debug)]
struct CantileverInternode {
    element: usize,
    middle: Vec3,
    along: DVec3,
    length: f64,
    radius: f64,
    /// Young's modulus, Pa.
    elasticity: f64,
    /// Force of the last step, N, and angles of the last two, rad.
    force: DVec3,
    angles: [f64; 2],
}

/// Simulation of a plant's sway by the equations of [zhao-zhang] as printed, apart from the requested corrections.
#[derive(Debug)]
pub struct PaperSimulation<'a> {
    elements: &'a BeamElements,
    wind: &'a dyn Wind,
    params: SwayParams,
    paper: PaperParams,
    internodes: Vec<CantileverInternode>,
    /// Number of angles whose sine exceeded 1: deflections beyond the internode's length.
    pub(crate) clamped: u64,
}

/// Deflection of the end of a cantilever under a tip force, m: eq. (3). `force`, N; `length` and `radius`, m; `elasticity`,
/// Pa; `fixed`: the fourth power of the radius, as the second moment of area has it, instead of the printed third.
fn tip_deflection(force: f64, length: f64, radius: f64, elasticity: f64, fixed: bool) -> f64 {
    let cube = radius * radius * radius;
    let power = if fixed { cube * radius } else { cube };
    4.0 * force * length * length * length / (3.0 * std::f64::consts::PI * elasticity * power)
}

impl<'a> PaperSimulation<'a> {
    /// All internodes of bending elements, at rest.
    pub fn new(
        plant: &Plant,
        elements: &'a BeamElements,
        wind: &'a dyn Wind,
        params: SwayParams,
        paper: PaperParams,
    ) -> Self {
        let mut internodes = Vec::new();
        for (index, axis) in (0_u32..).zip(&plant.axes) {
            // One cantilever per internode of a bending axis.
            let nodes: Vec<usize> = plant.nodes_of(axis).collect();
            for pair in nodes.windows(2) {
                let (i, j) = (pair[0], pair[1]);
                let spot = elements.locate(index, (plant.nodes.s[i] + plant.nodes.s[j]) * 0.5);
                let own = elements.list.get(spot.element as usize).is_some_and(|e| e.axis == index);
                let span = plant.nodes.p[j] - plant.nodes.p[i];
                if !own || span.length() <= 0.0 {
                    continue;
                }
                let radius = f64::from(plant.nodes.r[i] + plant.nodes.r[j]) * 0.5;
                internodes.push(CantileverInternode {
                    element: spot.element as usize,
                    middle: (plant.nodes.p[i] + plant.nodes.p[j]) * 0.5,
                    along: span.as_dvec3().normalize(),
                    length: f64::from(span.length()),
                    radius,
                    elasticity: params.wood.elasticity_at(radius),
                    force: DVec3::ZERO,
                    angles: [0.0; 2],
                });
            }
        }
        Self { elements, wind, params, paper, internodes, clamped: 0 }
    }

    /// The elements whose bends are computed, each as the sum of the bends of its internodes.
    pub(crate) fn elements(&self) -> &'a BeamElements {
        self.elements
    }

    pub(crate) fn fps(&self) -> f64 {
        self.params.fps
    }

    /// Bends of the elements after a step that ends at `t`, s.
    pub(crate) fn advance(&mut self, t: f64) -> Vec<[f64; 2]> {
        let stand = self.params.stand;
        // Sample the wind once per internode, then evaluate the equations of each internode.
        let places: Vec<Vec3> = self.internodes.iter().map(|i| stand.apply(i.middle)).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        self.wind.sample(&places, t, &mut air);
        let mut bends = vec![[0.0; 2]; self.elements.list.len()];
        for (internode, air) in self.internodes.iter_mut().zip(&air) {
            let (bend, clamped) = internode.step((stand.r.conjugate() * *air).as_dvec3(), &self.paper);
            self.clamped += u64::from(clamped);
            for (sum, way) in bends[internode.element].iter_mut().zip(&self.elements.list[internode.element].bend_axes)
            {
                *sum += way.dot(bend);
            }
        }
        bends
    }
}

impl CantileverInternode {
    /// Rotation vector of this internode in wind `v`, m/s, and whether its arcsine was clamped.
    fn step(&mut self, v: DVec3, paper: &PaperParams) -> (DVec3, bool) {
        // Drag and lift act along the wind; F = F_1 - k F(t-1) - k w^2.
        let air = if paper.fixes.air { super::wood::AIR_DENSITY } else { PRINTED_AIR };
        let area = 2.0 * self.radius * self.length;
        let wind = v * (0.5 * (DRAG + LIFT) * air * area * v.length());
        let rate = (self.angles[0] - self.angles[1]) * STEPS_PER_SECOND;
        let against = if paper.fixes.damping { rate.signum() } else { 1.0 };
        let force =
            wind - self.force * paper.recoil - wind.normalize_or_zero() * (against * paper.damping * rate * rate);
        self.force = force;
        // Only the force across the internode bends it.
        let across = force - self.along * force.dot(self.along);
        // Eq. (3), then the angle by the arcsine as printed.
        let delta = tip_deflection(across.length(), self.length, self.radius, self.elasticity, paper.fixes.radius);
        let sine = delta / self.length;
        let angle = math::asin(sine.clamp(-1.0, 1.0));
        self.angles = [angle, self.angles[0]];
        (self.along.cross(across).normalize_or_zero() * angle, sine > 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn printed_deflection_lacks_one_power_of_the_radius() {
        for r in [0.035, 0.003] {
            let (printed, mended) = (tip_deflection(1.0, 0.3, r, 8e9, false), tip_deflection(1.0, 0.3, r, 8e9, true));
            assert!((mended / printed * r - 1.0).abs() < 1e-12);
        }
        // The corrected deflection is F L^3 / (3 E I).
        let inertia = std::f64::consts::FRAC_PI_4 * 1e-8;
        assert!(
            (tip_deflection(1.0, 1.2, 0.01, 8e9, true) * 3.0 * 8e9 * inertia / (1.2 * 1.2 * 1.2) - 1.0).abs() < 1e-12
        );
    }

    fn internode() -> CantileverInternode {
        CantileverInternode {
            element: 0,
            middle: Vec3::ZERO,
            along: DVec3::Y,
            length: 0.3,
            radius: 0.004,
            elasticity: 5e9,
            force: DVec3::ZERO,
            angles: [0.0; 2],
        }
    }

    #[test]
    fn recoil_subtracts_a_share_of_the_last_force() {
        let fixes = PaperCorrections { radius: true, air: true, damping: true };
        let mut one = internode();
        let paper = PaperParams { fixes, recoil: 0.3, damping: 0.0 };
        let first = one.step(DVec3::X * 10.0, &paper).0.length();
        let second = one.step(DVec3::X * 10.0, &paper).0.length();
        assert!((second / first - 0.7).abs() < 1e-3, "{first} {second}");
        let last = (0..60).fold(0.0, |_, _| one.step(DVec3::X * 10.0, &paper).0.length());
        assert!((last / first - 1.0 / 1.3).abs() < 1e-3, "the gain at rest is 1 / (1 + k): {last}");
    }

    #[test]
    fn angles_beyond_90_degrees_are_clamped_and_counted() {
        let fixes = PaperCorrections { radius: true, air: true, damping: true };
        let paper = PaperParams { fixes, recoil: 0.0, damping: 0.0 };
        let mut soft = CantileverInternode { elasticity: 1e3, ..internode() };
        let (bend, clamped) = soft.step(DVec3::X * 30.0, &paper);
        assert!(clamped && (bend.length() - std::f64::consts::FRAC_PI_2).abs() < 1e-12, "{bend}");
        assert!(!internode().step(DVec3::X * 30.0, &paper).1);
    }

    #[test]
    fn printed_equations_give_invisible_motion() {
        let fixes = PaperCorrections { radius: false, air: false, damping: false };
        let (bend, _) = internode().step(DVec3::X * 10.0, &PaperParams { fixes, recoil: 0.3, damping: 0.01 });
        assert!(bend.length() < 1e-6 && bend.length() > 0.0, "{bend}");
        let leaf = 0.5 * (DRAG + LIFT) * PRINTED_AIR * 0.0002 * 100.0;
        assert!(leaf < 1e-7, "a leaf of 2 cm^2 feels {leaf} N");
    }
}
