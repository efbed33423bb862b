//! Which states occur at all: a step skips searches for states that do not occur.

use super::particles::{Catkin, CatkinState};

/// States that occur, or occurred at the beginning of this step; a step skips searches for the others.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PresentStates {
    pub pending: bool,
    pub exited: bool,
    pub on_wall: bool,
    pub deposited: bool,
}

impl PresentStates {
    /// Before the first step: all states may occur.
    pub const UNKNOWN: Self = Self { pending: true, exited: true, on_wall: true, deposited: true };

    pub fn of_catkins(catkins: &[Catkin]) -> Self {
        catkins.iter().fold(Self::default(), |present, c| present.with_state(c.state))
    }

    pub fn with_state(self, state: CatkinState) -> Self {
        self.union(Self {
            pending: state == CatkinState::Pending,
            exited: state == CatkinState::Exited,
            on_wall: state == CatkinState::OnWall,
            deposited: state.is_deposited(),
        })
    }

    pub fn union(self, other: Self) -> Self {
        Self {
            pending: self.pending || other.pending,
            exited: self.exited || other.exited,
            on_wall: self.on_wall || other.on_wall,
            deposited: self.deposited || other.deposited,
        }
    }
}
