//! Actions of symbols that the grammar binds itself, as the dialects of papers do.

use super::frame::TurtleFrame;
use super::interpreter::{Turtle, color_index};
use super::options::STALK;
use osier_base::math;
use osier_base::units::radians;
use osier_grammar::{Action, Module, Own};

/// World axes by number.
const WORLD_AXES: [glam::DVec3; 3] = [glam::DVec3::X, glam::DVec3::Y, glam::DVec3::Z];

impl Turtle<'_> {
    /// Performs the action that a module's symbol is bound to, with the module's first parameter or the binding's own number.
    pub(super) fn apply_bound_action(&mut self, m: Module<'_>) {
        let Some(action) = self.drawing.action(m.symbol) else { return };
        // A parameter of the module takes precedence over the number that the binding computes (by the module's lineage).
        let own = if m.params.is_empty() { self.drawing.value(m) } else { None };
        let number = match own {
            Some(v) if v.is_finite() => v,
            Some(_) => 0.0,
            None => self.param(m, 0, 1.0),
        };
        // Whatever draws or places ends the segment before it, which then takes the current width.
        if matches!(
            action,
            Action::Forward | Action::Move | Action::Polygon | Action::Fill | Action::Organ(_) | Action::Sphere
        ) {
            self.close_segment();
        }
        match action {
            Action::Forward => self.step(number, m, true, true),
            Action::Move => self.step(number, m, false, true),
            Action::World(axis) => {
                let (s, c) = (math::sin(radians(number)), math::cos(radians(number)));
                let axis = WORLD_AXES.get(*axis).copied().unwrap_or(glam::DVec3::Y);
                self.s.frame = self.s.frame.rotated(axis, c, s);
                self.count_turn();
            }
            Action::Turtle(own) => {
                let (s, c) = (math::sin(radians(number)), math::cos(radians(number)));
                let turn = match own {
                    Own::Heading => TurtleFrame::roll,
                    Own::Left => TurtleFrame::pitch,
                    Own::Up => TurtleFrame::yaw,
                };
                turn(&mut self.s.frame, c, s);
                self.count_turn();
            }
            Action::Width => self.set_width(number * self.s.scale),
            Action::Widen => self.set_width(self.s.width + number * self.s.scale),
            Action::Colour => self.s.color = color_index(number),
            Action::Polygon => self.open_polygon(),
            Action::Vertex => self.vertex(),
            Action::Fill => self.fill_polygon(m),
            Action::Organ(name) => {
                let letter = if name == "stalk" { STALK } else { name.chars().next().unwrap_or(STALK) };
                self.organ(letter, number, m);
            }
            Action::Sphere => self.place_disc_or_sphere('O', number, m),
            // `As` was resolved to the command of the other symbol when the turtle was set up.
            Action::As(_) | Action::Nothing => {}
        }
    }
}
