//! What does not change while a plant moves, laid out for lanes.

use glam::DVec3;

use super::Manner;
use crate::lanes::{Columns, padded};
use crate::sway::beam::{OVERTONE, Swing, overtone};
use crate::sway::elements::{Element, Elements, Station};
use crate::sway::wood::{AIR, Wood};

/// m/s^2.
const GRAVITY: f64 = 9.81;
/// Damping of a second mode over the first's.
const DAMPED: f64 = 1.5;

/// How an element hangs on its carrier.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hung {
    /// Its row.
    pub(crate) row: usize,
    /// Carrier's row; none for what stands on the ground.
    pub(crate) carrier: Option<usize>,
    /// Row of the carrier's station that it stands on.
    pub(crate) stand: usize,
    /// Slope of the carrier's tip for a unit force here, 1/N.
    pub(crate) lever: f64,
    /// Share of the carrier's bend here, and of its second mode's.
    pub(crate) shares: [f64; 2],
}

/// Elements and stations as rows: first those of more stations, station after station.
#[derive(Debug)]
pub(crate) struct Fixed {
    /// Row of each element, and of each station.
    pub(crate) rows: Vec<usize>,
    pub(crate) stations: Vec<usize>,
    /// Elements, carriers first.
    pub(crate) order: Vec<Hung>,
    /// Rows of the first, second, ... stations: where they begin, and how many.
    pub(crate) slots: Vec<(usize, usize)>,
    /// Both ways to bend.
    pub(crate) ways: Columns<6>,
    /// Both ways' next place and rate from place and rate: a, b, c, d.
    pub(crate) swing: Columns<8>,
    /// Place at rest from where the carrier's stretch begins.
    pub(crate) hold: Columns<3>,
    /// Slope for 1 m/s^2 on it and on all that it carries.
    pub(crate) weight: Columns<1>,
    /// Gravity in the plant's space, where its change counts.
    pub(crate) gravity: Option<[f64; 3]>,
    /// Second modes of the elements that have one, which stand first, if any do.
    pub(crate) overtones: Option<Overtones>,
    /// Per station: place from where the stretch begins, the stretch, share of the bend.
    pub(crate) shape: Columns<7>,
    /// Per station: place at rest from the element's base, direction of growth.
    pub(crate) rest: Columns<6>,
    /// Per station: drag of wood and of leaves at 1 m/s, N; slope for a unit of drag; slope for 1 m/s^2; rate at which
    /// air of 1 m/s stops it, 1/s.
    pub(crate) press: Columns<5>,
}

/// Second modes, as [`Fixed`] has the first.
#[derive(Debug)]
pub(crate) struct Overtones {
    pub(crate) swing: Columns<8>,
    /// Per station: share of the bend.
    pub(crate) shape: Columns<1>,
    /// Elements that have one.
    pub(crate) rows: Vec<usize>,
}

impl Fixed {
    pub(crate) fn new(elements: &Elements, manner: &Manner, step: f64) -> Self {
        let places = Places::new(elements);
        let (n, m) = (places.slots.first().map_or(0, |s| s.1), places.slots.iter().map(|s| s.1).sum());
        let mut fixed = Self {
            order: Vec::with_capacity(elements.list.len()),
            ways: Columns::new(n),
            swing: Columns::new(n),
            hold: Columns::new(n),
            weight: Columns::new(n),
            gravity: manner
                .gravity
                .then(|| (manner.stand.r.conjugate().as_dquat() * (DVec3::NEG_Y * GRAVITY)).to_array()),
            overtones: None,
            shape: Columns::new(m),
            rest: Columns::new(m),
            press: Columns::new(m),
            rows: places.rows,
            stations: places.stations,
            slots: places.slots,
        };
        for (e, element) in elements.list.iter().enumerate() {
            let row = fixed.rows[e];
            let [a, b] = element.ways;
            fixed.ways.set(row, [a.x, a.y, a.z, b.x, b.y, b.z]);
            let [a, b] = element.w.map(|w| swing(w, element.zeta, manner.fps, step).coefficients());
            fixed.swing.set(row, [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]);
            fixed.hang(elements, element, row);
            for i in element.stations.clone() {
                fixed.station(i, &elements.stations[i], element, &manner.wood);
            }
        }
        fixed.weigh(elements);
        fixed.overtones = Overtones::new(&fixed, elements, (manner.fps, step));
        fixed
    }

    fn hang(&mut self, elements: &Elements, element: &Element, row: usize) {
        let Some(carrier) = elements.list.get(element.parent as usize) else {
            self.hold.set(row, element.base.to_array());
            self.order.push(Hung { row, carrier: None, stand: 0, lever: 0.0, shares: [0.0; 2] });
            return;
        };
        let n = carrier.stations.len();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 3")]
        let i = carrier.stations.start + ((element.at * n as f64) as usize).min(n - 1);
        let arm = element.base - elements.stations[i].from;
        self.hold.set(row, arm.to_array());
        let second = if carrier.overtone.is_some() { overtone(element.at) } else { 0.0 };
        let shares = [carrier.shape.at(element.at), second];
        let (carrier, stand) = (Some(self.rows[element.parent as usize]), self.stations[i]);
        self.order.push(Hung { row, carrier, stand, lever: element.lever, shares });
    }

    /// What a change of gravity presses on: own stations, and whole children where they stand.
    fn weigh(&mut self, elements: &Elements) {
        let mut masses = vec![0.0; elements.list.len()];
        for (e, element) in elements.list.iter().enumerate().rev() {
            let own = elements.stations.get(element.stations.clone()).unwrap_or_default();
            masses[e] += own.iter().map(|s| s.load.mass).sum::<f64>();
            self.weight.add(self.rows[e], [own.iter().map(|s| s.load.mass * s.levers[1]).sum()]);
            if let Some(carrier) = self.rows.get(element.parent as usize) {
                self.weight.add(*carrier, [masses[e] * element.lever]);
                masses[element.parent as usize] += masses[e];
            }
        }
    }

    fn station(&mut self, i: usize, s: &Station, element: &Element, wood: &Wood) {
        let row = self.stations[i];
        let (arm, rest) = (s.p - s.from, s.p - element.base);
        self.shape.set(row, [arm.x, arm.y, arm.z, s.chord.x, s.chord.y, s.chord.z, element.shape.at(s.middle)]);
        self.rest.set(row, [rest.x, rest.y, rest.z, s.along.x, s.along.y, s.along.z]);
        let (bark, leaf) = (AIR * wood.drag * s.load.wood, AIR * wood.leaf_drag * s.load.leaf);
        let stops = (bark + leaf) / s.load.mass.max(1e-12);
        self.press.set(row, [0.5 * bark, 0.5 * leaf, s.levers[0], s.load.mass * s.levers[1], stops]);
    }
}

impl Overtones {
    fn new(fixed: &Fixed, elements: &Elements, (fps, step): (f64, f64)) -> Option<Self> {
        let with: Vec<usize> = (0..elements.list.len()).filter(|e| elements.list[*e].overtone.is_some()).collect();
        let last = with.iter().map(|e| fixed.rows[*e] + 1).max()?;
        let stations = fixed.slots.iter().map(|s| s.1).sum();
        let (mut swing_columns, mut shape) = (Columns::new(last), Columns::new(stations));
        for e in &with {
            let element = &elements.list[*e];
            let [a, b] = element.w.map(|w| swing(w * OVERTONE, element.zeta * DAMPED, fps, step).coefficients());
            swing_columns.set(fixed.rows[*e], [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]);
            for i in element.stations.clone() {
                shape.set(fixed.stations[i], [overtone(elements.stations[i].middle)]);
            }
        }
        Some(Self { swing: swing_columns, shape, rows: with.iter().map(|e| fixed.rows[*e]).collect() })
    }

    /// Rows up to the last that has one.
    pub(crate) fn count(&self) -> usize {
        self.swing.rows()
    }
}

/// How one way of an element swings in steps of `step` s.
fn swing(w: f64, zeta: f64, fps: f64, step: f64) -> Swing {
    let fast = w > std::f64::consts::PI * fps;
    if fast { Swing::follow(w, step) } else { Swing::new(w, zeta, step) }
}

/// Who gets which row.
struct Places {
    rows: Vec<usize>,
    stations: Vec<usize>,
    slots: Vec<(usize, usize)>,
}

impl Places {
    fn new(elements: &Elements) -> Self {
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
