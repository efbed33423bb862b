//! Which states occur at all, so that a step need not look for what nobody does.

use super::particles::{Catkin, CatkinState};

/// States of which there is at least one, or was at the beginning of this step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PresentStates {
    pub pending: bool,
    pub exited: bool,
    pub on_wall: bool,
    pub deposited: bool,
}

impl PresentStates {
    /// Before anybody has been looked at: anything may be.
    pub const UNKNOWN: Self = Self { pending: true, exited: true, on_wall: true, deposited: true };

    /// Those of `catkins`.
    pub fn of(catkins: &[Catkin]) -> Self {
        catkins.iter().fold(Self::default(), |present, c| present.with(c.state))
    }

    /// And one of these.
    pub fn with(self, state: CatkinState) -> Self {
        self.and(Self {
            pending: state == CatkinState::Pending,
            exited: state == CatkinState::Exited,
            on_wall: state == CatkinState::OnWall,
            deposited: state.is_deposited(),
        })
    }

    /// Both together.
    pub fn and(self, other: Self) -> Self {
        Self {
            pending: self.pending || other.pending,
            exited: self.exited || other.exited,
            on_wall: self.on_wall || other.on_wall,
            deposited: self.deposited || other.deposited,
        }
    }
}
