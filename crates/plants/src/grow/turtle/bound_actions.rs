//! Actions of symbols that a grammar binds, as the dialects of papers do.

use super::frame::TurtleFrame;
use super::interpreter::{Turtle, color_index};
use super::options::STALK;
use osier_grammar::{Module, TurtleAction, TurtleAxis};

/// World axes by the number in `TurtleAction::RotateWorld`.
const WORLD_AXES: [glam::DVec3; 3] = [glam::DVec3::X, glam::DVec3::Y, glam::DVec3::Z];

impl Turtle<'_> {
    /// Performs the action that a module's symbol is bound to, with the module's first parameter or the binding's own number.
    pub(super) fn apply_bound_action(&mut self, m: Module<'_>) {
        let Some(action) = self.bindings.action(m.symbol) else { return };
        // A parameter of the module takes precedence over the number that the binding computes (by the module's lineage).
        let own = if m.params.is_empty() { self.bindings.value(m) } else { None };
        let number = match own {
            Some(v) if v.is_finite() => v,
            Some(_) => 0.0,
            None => self.param(m, 0, 1.0),
        };
        // Commands that draw or place end the segment before them, which then takes the current width.
        if matches!(
            action,
            TurtleAction::Forward
                | TurtleAction::Move
                | TurtleAction::Polygon
                | TurtleAction::Fill
                | TurtleAction::Organ(_)
                | TurtleAction::Sphere
        ) {
            self.close_segment();
        }
        match action {
            TurtleAction::Forward => self.step(number * self.growth.length, m, true, true),
            TurtleAction::Move => self.step(number * self.growth.length, m, false, true),
            TurtleAction::RotateWorld(axis) => {
                let (c, s) = self.angles.cos_sin(number * self.growth.turn);
                let axis = WORLD_AXES.get(*axis).copied().unwrap_or(glam::DVec3::Y);
                self.s.frame = self.s.frame.rotated(axis, c, s);
                self.count_turn();
            }
            TurtleAction::RotateTurtle(axis) => {
                let (c, s) = self.angles.cos_sin(number * self.growth.turn);
                let turn = match axis {
                    TurtleAxis::Heading => TurtleFrame::roll,
                    TurtleAxis::Left => TurtleFrame::pitch,
                    TurtleAxis::Up => TurtleFrame::yaw,
                };
                turn(&mut self.s.frame, c, s);
                self.count_turn();
            }
            TurtleAction::Width => self.set_width(number * self.s.scale),
            TurtleAction::Widen => self.set_width(self.s.width + number * self.s.scale),
            TurtleAction::Colour => self.set_color(color_index(number)),
            TurtleAction::Polygon => self.open_polygon(),
            TurtleAction::Vertex => self.vertex(),
            TurtleAction::Fill => self.fill_polygon(m),
            TurtleAction::Organ(name) => {
                let letter = if name == "stalk" { STALK } else { name.chars().next().unwrap_or(STALK) };
                self.organ(letter, number * self.growth.size, m);
            }
            TurtleAction::Sphere => self.place_disc_or_sphere('O', number, m),
            // `As` was resolved to the command of the other symbol when the turtle was set up.
            TurtleAction::SameAs(_) | TurtleAction::Nothing => {}
        }
    }
}
