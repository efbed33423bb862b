//! What does not change while a plant moves, laid out for lanes.

use super::super::bend::{Swing, profile};
use super::super::element::{Element, Elements, Station};
use super::super::lanes::{Columns, padded};
use super::super::wood::{AIR, Wood};
use super::Manner;

/// How an element hangs on its carrier.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hung {
    /// Its row.
    pub(super) row: usize,
    /// Carrier's row; none for what stands on the ground.
    pub(super) carrier: Option<usize>,
    /// Row of the carrier's station that it stands on.
    pub(super) stand: usize,
    /// Slope of the carrier's tip for a unit force here, 1/N.
    pub(super) lever: f64,
}

/// Elements and stations as rows: first those of more stations, station after station.
#[derive(Debug)]
pub(super) struct Fixed {
    /// Row of each element, and of each station.
    pub(super) rows: Vec<usize>,
    pub(super) stations: Vec<usize>,
    /// Elements, carriers first.
    pub(super) order: Vec<Hung>,
    /// Rows of the first, second, ... stations: where they begin, and how many.
    pub(super) slots: Vec<(usize, usize)>,
    /// Both ways to bend.
    pub(super) ways: Columns<6>,
    /// Both ways' next place and rate from place and rate: a, b, c, d.
    pub(super) swing: Columns<8>,
    /// Place at rest from where the carrier's stretch begins, and share of the carrier's bend there.
    pub(super) hold: Columns<4>,
    /// Per station: place from where the stretch begins, the stretch, share of the bend.
    pub(super) shape: Columns<7>,
    /// Per station: place at rest from the element's base, direction of growth.
    pub(super) rest: Columns<6>,
    /// Per station: drag of wood and of leaves at 1 m/s, N; slope for a unit of drag; slope for 1 m/s^2; rate at which
    /// air of 1 m/s stops it, 1/s.
    pub(super) press: Columns<5>,
}

impl Fixed {
    pub(super) fn new(elements: &Elements, manner: &Manner, step: f64) -> Self {
        let places = Places::new(elements);
        let (n, m) = (places.slots.first().map_or(0, |s| s.1), places.slots.iter().map(|s| s.1).sum());
        let mut fixed = Self {
            order: Vec::with_capacity(elements.list.len()),
            ways: Columns::new(n),
            swing: Columns::new(n),
            hold: Columns::new(n),
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
        fixed
    }

    fn hang(&mut self, elements: &Elements, element: &Element, row: usize) {
        let Some(carrier) = elements.list.get(element.parent as usize) else {
            self.hold.set(row, [element.base.x, element.base.y, element.base.z, 0.0]);
            self.order.push(Hung { row, carrier: None, stand: 0, lever: 0.0 });
            return;
        };
        let n = carrier.stations.len();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 3")]
        let i = carrier.stations.start + ((element.at * n as f64) as usize).min(n - 1);
        let arm = element.base - elements.stations[i].from;
        self.hold.set(row, [arm.x, arm.y, arm.z, profile(element.at)]);
        let (carrier, stand) = (Some(self.rows[element.parent as usize]), self.stations[i]);
        self.order.push(Hung { row, carrier, stand, lever: element.lever });
    }

    fn station(&mut self, i: usize, s: &Station, element: &Element, wood: &Wood) {
        let row = self.stations[i];
        let (arm, rest) = (s.p - s.from, s.p - element.base);
        self.shape.set(row, [arm.x, arm.y, arm.z, s.chord.x, s.chord.y, s.chord.z, profile(s.middle)]);
        self.rest.set(row, [rest.x, rest.y, rest.z, s.along.x, s.along.y, s.along.z]);
        let (bark, leaf) = (AIR * wood.drag * s.load.wood, AIR * wood.leaf_drag * s.load.leaf);
        let stops = (bark + leaf) / s.load.mass.max(1e-12);
        self.press.set(row, [0.5 * bark, 0.5 * leaf, s.levers[0], s.load.mass * s.levers[1], stops]);
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
