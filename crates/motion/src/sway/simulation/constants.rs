//! Constants of a simulation, laid out for SIMD lanes.

use glam::DVec3;

use super::SwayParams;
use crate::lanes::{Columns, padded_row_count};
use crate::sway::beam::{OscillatorStep, SECOND_MODE_FREQUENCY_RATIO, second_mode_slope};
use crate::sway::elements::{BeamElement, BeamElements, LoadStation};
use crate::sway::tuning::{MAX_RESONANCE_GAIN, SECOND_MODE_DAMPING};
use crate::sway::wood::AIR_DENSITY;

/// Attachment of an element to its carrier, with the constants by which both act on each other.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CarrierLink {
    /// Row of the element.
    pub(crate) row: usize,
    /// Row of the carrier; `None` for elements on the ground.
    pub(crate) carrier: Option<usize>,
    /// Row of the carrier's station on whose stretch the element is attached.
    pub(crate) stand: usize,
    /// Tip slope of the carrier per unit force here, 1/N.
    pub(crate) carrier_compliance: f64,
    /// Relative slope of the carrier here, in its first and second mode.
    pub(crate) shares: [f64; 2],
}

/// Per-element and per-station constants in rows. Elements are sorted by descending number of stations; all first
/// stations come before all second ones.
#[derive(Debug)]
pub(crate) struct SimulationConstants {
    /// Row of each element, and of each station.
    pub(crate) rows: Vec<usize>,
    pub(crate) stations: Vec<usize>,
    /// Connections in the order of elements, carriers first.
    pub(crate) order: Vec<CarrierLink>,
    /// Entry k: first row and number of rows, padding included, that hold the k-th stations of all elements.
    pub(crate) station_slots: Vec<(usize, usize)>,
    /// Axes of both bending directions.
    pub(crate) bend_axes: Columns<6>,
    /// Coefficients a, b, c, d of [`OscillatorStep`] for both directions.
    pub(crate) oscillator: Columns<8>,
    /// Base at rest relative to the start of the carrier's stretch, m.
    pub(crate) base_offset: Columns<3>,
    /// Tip slope per 1 m/s^2 acting on it and on everything that it carries.
    pub(crate) weight: Columns<1>,
    /// Gravity in the plant's space times the plant's scale, m/s^2; `None` if it does not act on deviations from the grown pose.
    pub(crate) gravity: Option<[f64; 3]>,
    /// Second modes of the elements that have one; these have the first rows.
    pub(crate) second_modes: Option<SecondModes>,
    /// Per station: position from the start of its stretch, vector of the stretch, m, and relative slope.
    pub(crate) shape: Columns<7>,
    /// Per station: position at rest from the element's base, m, and direction of growth.
    pub(crate) rest: Columns<6>,
    /// Per station: drag of wood and of leaves at 1 m/s, N; tip slope per unit drag, 1/N; tip slope per 1 m/s^2; and
    /// aerodynamic damping rate per 1 m/s of wind, 1/m.
    pub(crate) load_terms: Columns<5>,
}

/// Constants of the second modes, in the layout of [`SimulationConstants`].
#[derive(Debug)]
pub(crate) struct SecondModes {
    pub(crate) oscillator: Columns<8>,
    /// Per station: relative slope.
    pub(crate) shape: Columns<1>,
    /// Rows of the elements that have a second mode.
    pub(crate) rows: Vec<usize>,
}

impl SimulationConstants {
    pub(crate) fn new(elements: &BeamElements, params: &SwayParams, step: f64) -> Self {
        // n rows of elements, m rows of stations, padding included.
        let places = RowLayout::new(elements);
        let (n, m) = (places.station_slots.first().map_or(0, |s| s.1), places.station_slots.iter().map(|s| s.1).sum());
        let scale = f64::from(params.stand.s.x);
        let mut constants = Self {
            order: Vec::with_capacity(elements.list.len()),
            bend_axes: Columns::new(n),
            oscillator: Columns::new(n),
            base_offset: Columns::new(n),
            weight: Columns::new(n),
            // Masses grow with the cube of the size, and the slope per force falls with its square: bends by weight grow in
            // proportion to the size.
            gravity: params
                .gravity
                .map(|g| (params.stand.r.conjugate().as_dquat() * (DVec3::NEG_Y * g * scale)).to_array()),
            second_modes: None,
            shape: Columns::new(m),
            rest: Columns::new(m),
            load_terms: Columns::new(m),
            rows: places.rows,
            stations: places.stations,
            station_slots: places.station_slots,
        };
        // Row by row: bend axes, oscillator coefficients, link to the carrier, stations.
        for (e, element) in elements.list.iter().enumerate() {
            let row = constants.rows[e];
            let [a, b] = element.bend_axes;
            constants.bend_axes.set(row, [a.x, a.y, a.z, b.x, b.y, b.z]);
            let [a, b] = element.w.map(|w| oscillator_step(w, element.damping_ratio, params.fps, step).coefficients());
            constants.oscillator.set(row, [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]);
            constants.link_to_carrier(elements, element, row);
            for i in element.stations.clone() {
                constants.set_station(i, &elements.stations[i], element, params);
            }
        }
        constants.set_gravity_levers(elements);
        constants.second_modes = SecondModes::new(&constants, elements, params.fps, step);
        constants
    }

    fn link_to_carrier(&mut self, elements: &BeamElements, element: &BeamElement, row: usize) {
        let Some(carrier) = elements.list.get(element.parent as usize) else {
            self.base_offset.set(row, element.base.to_array());
            self.order.push(CarrierLink { row, carrier: None, stand: 0, carrier_compliance: 0.0, shares: [0.0; 2] });
            return;
        };
        let n = carrier.stations.len();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 3")]
        // The station of the carrier whose stretch contains the base.
        let i = carrier.stations.start + ((element.at * n as f64) as usize).min(n - 1);
        let arm = element.base - elements.stations[i].from;
        self.base_offset.set(row, arm.to_array());
        let second = if carrier.second_mode.is_some() { second_mode_slope(element.at) } else { 0.0 };
        let shares = [carrier.shape.at(element.at), second];
        let (carrier, stand) = (Some(self.rows[element.parent as usize]), self.stations[i]);
        self.order.push(CarrierLink { row, carrier, stand, carrier_compliance: element.carrier_compliance, shares });
    }

    /// Levers of gravity: tip slope per 1 m/s^2 by the masses of an element's stations and, at their bases, of all that its
    /// children carry.
    fn set_gravity_levers(&mut self, elements: &BeamElements) {
        let mut masses = vec![0.0; elements.list.len()];
        for (e, element) in elements.list.iter().enumerate().rev() {
            // Children come after their carriers: accumulate masses from the tips inwards.
            let own = elements.stations.get(element.stations.clone()).unwrap_or_default();
            masses[e] += own.iter().map(|s| s.load.mass).sum::<f64>();
            self.weight.add(self.rows[e], [own.iter().map(|s| s.load.mass * s.tip_compliances[1]).sum()]);
            if let Some(carrier) = self.rows.get(element.parent as usize) {
                self.weight.add(*carrier, [masses[e] * element.carrier_compliance]);
                masses[element.parent as usize] += masses[e];
            }
        }
    }

    fn set_station(&mut self, i: usize, s: &LoadStation, element: &BeamElement, params: &SwayParams) {
        let row = self.stations[i];
        let (wood, scale) = (&params.wood, f64::from(params.stand.s.x));
        let (arm, rest) = (s.p - s.from, s.p - element.base);
        self.shape.set(row, [arm.x, arm.y, arm.z, s.chord.x, s.chord.y, s.chord.z, element.shape.at(s.middle)]);
        self.rest.set(row, [rest.x, rest.y, rest.z, s.along.x, s.along.y, s.along.z]);
        // rho C A of bark and leaves is twice the drag per squared wind speed. Divided by the mass it is the rate, per unit of
        // wind speed, at which drag stops the stretch (the derivative of the drag).
        let (bark, leaf) = (AIR_DENSITY * wood.drag * s.load.wood, AIR_DENSITY * wood.leaf_drag * s.load.leaf);
        // If a plant is scaled up, its areas grow with the square of the scale, its masses with the cube, and the slope per force
        // falls with the square: bends by drag stay the same, drag stops motion more slowly, and inertia bends more.
        let stops = (bark + leaf) / (s.load.mass.max(1e-12) * scale);
        // At its natural frequency an oscillator has 1 / (2 zeta) times the amplitude of the motion that shakes it.
        let gain = (2.0 * element.damping_ratio * MAX_RESONANCE_GAIN).min(1.0);
        let inertia = s.load.mass * s.tip_compliances[1] * gain * scale;
        self.load_terms.set(row, [0.5 * bark, 0.5 * leaf, s.tip_compliances[0], inertia, stops]);
    }
}

impl SecondModes {
    /// Oscillators of all second modes; `None` if no element has one. `fps`: frames per second; `step`: s.
    fn new(constants: &SimulationConstants, elements: &BeamElements, fps: f64, step: f64) -> Option<Self> {
        // Elements with a second mode are trunks and limbs, which have most stations and therefore the first rows.
        let with: Vec<usize> = (0..elements.list.len()).filter(|e| elements.list[*e].second_mode.is_some()).collect();
        let last = with.iter().map(|e| constants.rows[*e] + 1).max()?;
        let stations = constants.station_slots.iter().map(|s| s.1).sum();
        let (mut oscillator_columns, mut shape) = (Columns::new(last), Columns::new(stations));
        for e in &with {
            let element = &elements.list[*e];
            let [a, b] = element.w.map(|w| {
                oscillator_step(w * SECOND_MODE_FREQUENCY_RATIO, element.damping_ratio * SECOND_MODE_DAMPING, fps, step)
                    .coefficients()
            });
            oscillator_columns.set(constants.rows[*e], [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]);
            for i in element.stations.clone() {
                shape.set(constants.stations[i], [second_mode_slope(elements.stations[i].middle)]);
            }
        }
        Some(Self { oscillator: oscillator_columns, shape, rows: with.iter().map(|e| constants.rows[*e]).collect() })
    }

    /// Number of rows up to the last element with a second mode, padding included.
    pub(crate) fn count(&self) -> usize {
        self.oscillator.rows()
    }
}

/// Step coefficients of one mode; modes above the Nyquist frequency of the frames are quasi-static.
fn oscillator_step(w: f64, zeta: f64, fps: f64, step: f64) -> OscillatorStep {
    // The angular Nyquist frequency is pi times the frame rate; a faster mode would alias to a slower one.
    let fast = w > std::f64::consts::PI * fps;
    if fast { OscillatorStep::first_order_lag(w, step) } else { OscillatorStep::new(w, zeta, step) }
}

/// Assignment of elements and stations to rows.
struct RowLayout {
    rows: Vec<usize>,
    stations: Vec<usize>,
    station_slots: Vec<(usize, usize)>,
}

impl RowLayout {
    fn new(elements: &BeamElements) -> Self {
        let list = &elements.list;
        let most = list.iter().map(|e| e.stations.len()).max().unwrap_or(0);
        let (mut rows, mut next) = (vec![0; list.len()], 0);
        let mut slots = vec![(0, 0); most];
        // Each group of equal station count starts at a full SIMD register, so that lanes of a register have equal
        // counts.
        for count in (1..=most).rev() {
            for (e, _) in list.iter().enumerate().filter(|(_, e)| e.stations.len() == count) {
                rows[e] = next;
                next += 1;
            }
            next = padded_row_count(next);
            slots[count - 1].1 = next;
        }
        // The k-th stations of all elements follow each other, so that a register loads the k-th stations of its elements
        // at once.
        let mut begin = 0;
        for slot in &mut slots {
            slot.0 = begin;
            begin += slot.1;
        }
        let mut stations = vec![0; elements.stations.len()];
        for (e, element) in list.iter().enumerate() {
            for (slot, i) in slots.iter().zip(element.stations.clone()) {
                stations[i] = slot.0 + rows[e];
            }
        }
        Self { rows, stations, station_slots: slots }
    }
}
