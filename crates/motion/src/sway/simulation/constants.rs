//! What does not change while a plant moves, laid out for lanes.

use glam::DVec3;

use super::SwayParams;
use crate::lanes::{Columns, padded};
use crate::sway::beam::{OscillatorStep, SECOND_MODE_FREQUENCY_RATIO, second_mode_slope};
use crate::sway::elements::{BeamElement, BeamElements, LoadStation};
use crate::sway::wood::{AIR_DENSITY, WoodParams};

/// m/s^2.
const GRAVITY: f64 = osier_base::physics::GRAVITY;
/// Damping of a second mode over the first's.
const SECOND_MODE_DAMPING: f64 = 1.5;

/// How an element hangs on its carrier.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CarrierLink {
    /// Its row.
    pub(crate) row: usize,
    /// Carrier's row; none for what stands on the ground.
    pub(crate) carrier: Option<usize>,
    /// Row of the carrier's station that it stands on.
    pub(crate) stand: usize,
    /// Slope of the carrier's tip for a unit force here, 1/N.
    pub(crate) carrier_compliance: f64,
    /// Share of the carrier's bend here, and of its second mode's.
    pub(crate) shares: [f64; 2],
}

/// Elements and stations as rows: first those of more stations, station after station.
#[derive(Debug)]
pub(crate) struct SimulationConstants {
    /// Row of each element, and of each station.
    pub(crate) rows: Vec<usize>,
    pub(crate) stations: Vec<usize>,
    /// Elements, carriers first.
    pub(crate) order: Vec<CarrierLink>,
    /// Rows of the first, second, ... stations: where they begin, and how many.
    pub(crate) slots: Vec<(usize, usize)>,
    /// Both ways to bend.
    pub(crate) bend_axes: Columns<6>,
    /// Both ways' next place and rate from place and rate: a, b, c, d.
    pub(crate) swing: Columns<8>,
    /// Place at rest from where the carrier's stretch begins.
    pub(crate) hold: Columns<3>,
    /// Slope for 1 m/s^2 on it and on all that it carries.
    pub(crate) weight: Columns<1>,
    /// Gravity in the plant's space, where its change counts.
    pub(crate) gravity: Option<[f64; 3]>,
    /// Second modes of the elements that have one, which stand first, if any do.
    pub(crate) second_modes: Option<SecondModes>,
    /// Per station: place from where the stretch begins, the stretch, share of the bend.
    pub(crate) shape: Columns<7>,
    /// Per station: place at rest from the element's base, direction of growth.
    pub(crate) rest: Columns<6>,
    /// Per station: drag of wood and of leaves at 1 m/s, N; slope for a unit of drag; slope for 1 m/s^2; rate at which
    /// air of 1 m/s stops it, 1/s.
    pub(crate) press: Columns<5>,
}

/// Second modes, as [`SimulationConstants`] has the first.
#[derive(Debug)]
pub(crate) struct SecondModes {
    pub(crate) swing: Columns<8>,
    /// Per station: share of the bend.
    pub(crate) shape: Columns<1>,
    /// Elements that have one.
    pub(crate) rows: Vec<usize>,
}

impl SimulationConstants {
    pub(crate) fn new(elements: &BeamElements, manner: &SwayParams, step: f64) -> Self {
        let places = RowLayout::new(elements);
        let (n, m) = (places.slots.first().map_or(0, |s| s.1), places.slots.iter().map(|s| s.1).sum());
        let mut constants = Self {
            order: Vec::with_capacity(elements.list.len()),
            bend_axes: Columns::new(n),
            swing: Columns::new(n),
            hold: Columns::new(n),
            weight: Columns::new(n),
            gravity: manner
                .gravity
                .then(|| (manner.stand.r.conjugate().as_dquat() * (DVec3::NEG_Y * GRAVITY)).to_array()),
            second_modes: None,
            shape: Columns::new(m),
            rest: Columns::new(m),
            press: Columns::new(m),
            rows: places.rows,
            stations: places.stations,
            slots: places.slots,
        };
        for (e, element) in elements.list.iter().enumerate() {
            let row = constants.rows[e];
            let [a, b] = element.bend_axes;
            constants.bend_axes.set(row, [a.x, a.y, a.z, b.x, b.y, b.z]);
            let [a, b] = element.w.map(|w| oscillator_step(w, element.damping_ratio, manner.fps, step).coefficients());
            constants.swing.set(row, [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]);
            constants.link_to_carrier(elements, element, row);
            for i in element.stations.clone() {
                constants.set_station(i, &elements.stations[i], element, &manner.wood);
            }
        }
        constants.set_gravity_levers(elements);
        constants.second_modes = SecondModes::new(&constants, elements, manner.fps, step);
        constants
    }

    fn link_to_carrier(&mut self, elements: &BeamElements, element: &BeamElement, row: usize) {
        let Some(carrier) = elements.list.get(element.parent as usize) else {
            self.hold.set(row, element.base.to_array());
            self.order.push(CarrierLink { row, carrier: None, stand: 0, carrier_compliance: 0.0, shares: [0.0; 2] });
            return;
        };
        let n = carrier.stations.len();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 3")]
        let i = carrier.stations.start + ((element.at * n as f64) as usize).min(n - 1);
        let arm = element.base - elements.stations[i].from;
        self.hold.set(row, arm.to_array());
        let second = if carrier.second_mode.is_some() { second_mode_slope(element.at) } else { 0.0 };
        let shares = [carrier.shape.at(element.at), second];
        let (carrier, stand) = (Some(self.rows[element.parent as usize]), self.stations[i]);
        self.order.push(CarrierLink { row, carrier, stand, carrier_compliance: element.carrier_compliance, shares });
    }

    /// What a change of gravity presses on: own stations, and whole children where they stand.
    fn set_gravity_levers(&mut self, elements: &BeamElements) {
        let mut masses = vec![0.0; elements.list.len()];
        for (e, element) in elements.list.iter().enumerate().rev() {
            let own = elements.stations.get(element.stations.clone()).unwrap_or_default();
            masses[e] += own.iter().map(|s| s.load.mass).sum::<f64>();
            self.weight.add(self.rows[e], [own.iter().map(|s| s.load.mass * s.tip_compliances[1]).sum()]);
            if let Some(carrier) = self.rows.get(element.parent as usize) {
                self.weight.add(*carrier, [masses[e] * element.carrier_compliance]);
                masses[element.parent as usize] += masses[e];
            }
        }
    }

    fn set_station(&mut self, i: usize, s: &LoadStation, element: &BeamElement, wood: &WoodParams) {
        let row = self.stations[i];
        let (arm, rest) = (s.p - s.from, s.p - element.base);
        self.shape.set(row, [arm.x, arm.y, arm.z, s.chord.x, s.chord.y, s.chord.z, element.shape.at(s.middle)]);
        self.rest.set(row, [rest.x, rest.y, rest.z, s.along.x, s.along.y, s.along.z]);
        let (bark, leaf) = (AIR_DENSITY * wood.drag * s.load.wood, AIR_DENSITY * wood.leaf_drag * s.load.leaf);
        let stops = (bark + leaf) / s.load.mass.max(1e-12);
        self.press.set(row, [0.5 * bark, 0.5 * leaf, s.tip_compliances[0], s.load.mass * s.tip_compliances[1], stops]);
    }
}

impl SecondModes {
    /// Oscillators of the elements that have a second mode; none without any. `fps`: frames per second; `step`: s.
    fn new(constants: &SimulationConstants, elements: &BeamElements, fps: f64, step: f64) -> Option<Self> {
        let with: Vec<usize> = (0..elements.list.len()).filter(|e| elements.list[*e].second_mode.is_some()).collect();
        let last = with.iter().map(|e| constants.rows[*e] + 1).max()?;
        let stations = constants.slots.iter().map(|s| s.1).sum();
        let (mut swing_columns, mut shape) = (Columns::new(last), Columns::new(stations));
        for e in &with {
            let element = &elements.list[*e];
            let [a, b] = element.w.map(|w| {
                oscillator_step(w * SECOND_MODE_FREQUENCY_RATIO, element.damping_ratio * SECOND_MODE_DAMPING, fps, step)
                    .coefficients()
            });
            swing_columns.set(constants.rows[*e], [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]);
            for i in element.stations.clone() {
                shape.set(constants.stations[i], [second_mode_slope(elements.stations[i].middle)]);
            }
        }
        Some(Self { swing: swing_columns, shape, rows: with.iter().map(|e| constants.rows[*e]).collect() })
    }

    /// Rows up to the last that has one.
    pub(crate) fn count(&self) -> usize {
        self.swing.rows()
    }
}

/// How one way of an element swings in steps of `step` s.
fn oscillator_step(w: f64, zeta: f64, fps: f64, step: f64) -> OscillatorStep {
    let fast = w > std::f64::consts::PI * fps;
    if fast { OscillatorStep::follow(w, step) } else { OscillatorStep::new(w, zeta, step) }
}

/// Who gets which row.
struct RowLayout {
    rows: Vec<usize>,
    stations: Vec<usize>,
    slots: Vec<(usize, usize)>,
}

impl RowLayout {
    fn new(elements: &BeamElements) -> Self {
        let list = &elements.list;
        let most = list.iter().map(|e| e.stations.len()).max().unwrap_or(0);
        let (mut rows, mut next) = (vec![0; list.len()], 0);
        let mut slots = vec![(0, 0); most];
        // Groups of equal numbers of stations begin at a full group of lanes.
        for count in (1..=most).rev() {
            for (e, _) in list.iter().enumerate().filter(|(_, e)| e.stations.len() == count) {
                rows[e] = next;
                next += 1;
            }
            next = padded(next);
            slots[count - 1].1 = next;
        }
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
        Self { rows, stations, slots }
    }
}
