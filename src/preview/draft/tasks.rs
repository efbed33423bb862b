//! What is to be drawn, dealt out in even lots.

use super::super::world::World;

/// Primitives of a lot.
const LOT: usize = 1 << 14;

/// Some primitives of one showing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Share {
    pub(super) showing: usize,
    pub(super) first: usize,
    pub(super) end: usize,
    /// Number of the first among all primitives of all showings.
    pub(super) number: u64,
}

/// Everything to be drawn.
#[derive(Debug)]
pub(super) struct Tasks {
    pub(super) lots: Vec<Vec<Share>>,
    /// Number of the first primitive of each showing among all primitives of all showings.
    pub(super) starts: Vec<u64>,
}

impl Tasks {
    pub(super) fn new(world: &World<'_>) -> Self {
        let mut own = Self { lots: Vec::new(), starts: Vec::new() };
        let (mut lot, mut held, mut number) = (Vec::new(), 0, 0);
        for (showing, len) in world.lengths().enumerate() {
            own.starts.push(number);
            let mut first = 0;
            while first < len {
                let end = len.min(first + LOT - held);
                lot.push(Share { showing, first, end, number });
                number += (end - first) as u64;
                (held, first) = (held + end - first, end);
                if held >= LOT {
                    own.lots.push(std::mem::take(&mut lot));
                    held = 0;
                }
            }
        }
        own.lots.push(lot);
        own
    }
}
