//! Commands of the turtles of other programs: Fractint, LParser and L-Py. A table of commands for each, and the state
//! that they change.

use glam::DVec3;

use super::frame::TurtleFrame;
use super::guides::Guide;
use super::options::TurtleOptions;
use osier_grammar::{Dialect, DialectSettings, SymbolId};

/// Initial colour indices of the programs: white, red and the first index.
const FRACTINT_COLOR: u8 = 15;
const LPARSER_COLOR: u8 = 2;
const LPY_COLOR: u8 = 1;
/// Unit of Fractint's turns in a file that states no angle, degrees.
const FRACTINT_UNIT_DEG: f64 = 45.0;
/// Factors of LParser's commands without a number. Source: the manual of LParser; commands that enlarge divide by them.
const LENGTH_FACTOR: f64 = 0.9;
const ANGLE_FACTOR: f64 = 0.9;
const THICKNESS_FACTOR: f64 = 0.7;
/// Angle of turns, and radius of segments, with which L-Py begins. Source: the manual of L-Py.
const LPY_ANGLE_DEG: f64 = 60.0;
pub(super) const LPY_RADIUS: f64 = 0.1;

/// A command of the turtle of another program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum DialectCommand {
    /// L-Py: asks for position, heading, left or up, by the letter after `?`.
    Query(char),
    /// Fractint: moves by the integer pointer (`F`, `G`); true draws.
    Units(bool),
    /// Fractint: moves by the pointer in degrees (`D`, `M`); true draws.
    Degrees(bool),
    /// Fractint: turns the integer pointer by one unit; true counter-clockwise.
    TurnUnit(bool),
    /// Fractint: turns the integer pointer clockwise by half of the units.
    TurnHalf,
    /// Fractint: turns the pointer in degrees; true counter-clockwise.
    TurnDegrees(bool),
    /// Fractint: exchanges the directions of all turns.
    Reverse,
    /// Fractint: multiplies the size.
    Size,
    /// Fractint: `None` sets the colour to the number, a sign adds sign times number to it.
    Color(Option<i32>),
    /// LParser and L-Py: turns about up, left or heading, by the sign times the angle.
    Yaw(f64),
    Pitch(f64),
    Roll(f64),
    /// Turns by 180 degrees about up.
    TurnAround,
    /// Rolls by 180 degrees.
    RollOver,
    /// Rolls until left is horizontal.
    Level,
    /// LParser: random turns about up, left and heading.
    Random,
    /// LParser: pitches down, by a larger angle the closer the heading is to horizontal.
    Gravity,
    /// LParser: moves by the share of the length.
    Step {
        share: f64,
        draws: bool,
        adds_vertex: bool,
    },
    /// LParser: multiplies length, angle, thickness.
    Length(f64),
    Angle(f64),
    Thickness(f64),
    /// Sets the given colour index, or adds the sign to the present one.
    ColorIndex(i32),
    OpenPolygon,
    Vertex,
    ClosePolygon,
    /// LParser: a character of numbers, which does nothing by itself.
    Digit,
    /// L-Py: moves ahead; true draws.
    Forward(bool),
    /// L-Py: a path of a length (`nF`): its steps make one segment.
    Path,
    /// L-Py: sets the radius, or changes it by the sign times its increment.
    Radius(f64),
    /// L-Py: sets, multiplies or divides the scale.
    Scale,
    ScaleUp,
    ScaleDown,
    /// L-Py: sets the position; true from the present one.
    MoveTo(bool),
    /// L-Py: a line to a point.
    LineTo {
        relative: bool,
        turns: bool,
    },
    /// L-Py: turns the heading to a point; true from the present position.
    PointAt(bool),
    /// L-Py: sets heading and up.
    SetHead,
    Sphere,
    Circle,
    /// L-Py: arrows along the axes of the turtle.
    Frame,
    /// L-Py: the surface of a letter.
    Surface(char),
    /// L-Py: elasticity and direction of the tropism.
    Elasticity,
    Tropism,
    /// L-Py: begins and ends a generalised cylinder.
    StartCylinder,
    EndCylinder,
    /// L-Py: curves as guide and as contour, and a surface along both.
    SetGuide,
    EndGuide,
    PositionOnGuide,
    SetContour,
    Sweep,
    /// A command that changes no geometry.
    Ignored,
    /// L-Py: a command that would change the drawing but has no effect here; L008 warns of it.
    Unsupported,
}

/// State that the commands of dialects change; brackets save and restore it.
#[derive(Debug, Clone, Copy)]
pub(super) struct DialectState {
    /// Fractint: pointer in units, counter-clockwise from +X.
    pub units: i64,
    /// Fractint: pointer in degrees, counter-clockwise from +X.
    pub degrees: f64,
    pub reversed: bool,
    /// Fractint: size of a step; LParser: length of a segment.
    pub length: f64,
    /// LParser: factor of the angle of turns without a number.
    pub angle: f64,
    /// LParser: diameter of a segment as a share of its length.
    pub thickness: f64,
    /// LParser: true after `$` has recomputed left and up, which reverses the direction of turns about up.
    pub is_mirrored: bool,
    /// LParser: lengths of left and up after a `$`, if below 1; turns about such a vector are smaller than the angle.
    pub left_length: Option<f64>,
    pub up_length: Option<f64>,
    /// L-Py: elasticity and direction of the tropism.
    pub elasticity: f64,
    pub tropism: DVec3,
    /// L-Py: radius without the scale, by which it is multiplied when something is drawn.
    pub radius: f64,
    /// L-Py: the curve that steps follow.
    pub guide: Option<Guide>,
    /// L-Py: between `StartGC` and `EndGC`.
    pub is_in_cylinder: bool,
}

/// The program whose turtle draws, and the numbers that its file holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct DialectTurtle {
    pub kind: Dialect,
    pub settings: DialectSettings,
    /// Angle of turns without a number, degrees.
    pub angle_deg: f64,
    /// Derivation step that made the newest modules; LParser reduces these by the fraction of the recursion, if the
    /// file states one.
    pub last_step: u32,
}

impl DialectTurtle {
    /// `angle`: angle of turns without a number that the scene sets, rad; `None`: that of the file or of the program.
    pub fn new(kind: Dialect, settings: DialectSettings, angle: Option<f64>, last_step: u32) -> Self {
        let own = settings.angle_deg.unwrap_or(match kind {
            Dialect::LPy => LPY_ANGLE_DEG,
            _ => FRACTINT_UNIT_DEG,
        });
        let angle_deg = angle.map_or(own, |a| a * (180.0 / std::f64::consts::PI));
        Self { kind, settings, angle_deg, last_step }
    }

    /// State before the first command, with the thickness that the file sets.
    pub fn state(&self) -> DialectState {
        DialectState {
            units: 0,
            degrees: 0.0,
            reversed: false,
            length: 1.0,
            angle: 1.0,
            thickness: self.settings.thickness.unwrap_or(1.0),
            is_mirrored: false,
            left_length: None,
            up_length: None,
            elasticity: 0.0,
            tropism: DVec3::Y,
            radius: LPY_RADIUS,
            guide: None,
            is_in_cylinder: false,
        }
    }

    /// Colour index of the first segments. `color`: index in the options; an index that the scene sets is kept.
    pub fn first_color(&self, color: u8) -> u8 {
        if color != TurtleOptions::default().color {
            return color;
        }
        match self.kind {
            Dialect::Fractint => FRACTINT_COLOR,
            Dialect::LParser => LPARSER_COLOR,
            Dialect::LPy => LPY_COLOR,
            Dialect::Cpfg | Dialect::Abop | Dialect::None | Dialect::Catkin => color,
        }
    }

    /// Frame with which the turtle of the program begins. World axes of LParser and L-Py, whose +Z is up, become (x, z, -y).
    pub fn first_frame(&self) -> TurtleFrame {
        match self.kind {
            // Fractint's turtle starts along +X, in a plane that faces the viewer.
            Dialect::Fractint => TurtleFrame { h: DVec3::X, l: DVec3::Y, u: DVec3::Z },
            Dialect::LParser => TurtleFrame { h: DVec3::Y, l: DVec3::NEG_Z, u: DVec3::NEG_X },
            Dialect::LPy => TurtleFrame { h: DVec3::Y, l: DVec3::Z, u: DVec3::X },
            Dialect::Cpfg | Dialect::Abop | Dialect::None | Dialect::Catkin => TurtleFrame::START,
        }
    }

    /// Diameter of the first segments. `width`: diameter in the options.
    pub fn first_width(&self, width: f64) -> f64 {
        if self.kind == Dialect::LPy { 2.0 * LPY_RADIUS } else { width }
    }

    /// True for programs whose files set every width.
    pub fn sets_widths(&self) -> bool {
        matches!(self.kind, Dialect::LParser | Dialect::LPy)
    }

    /// The command of a symbol, or of its long name; `None` if the program has no such command.
    pub fn command(&self, c: char, long_name: Option<&str>) -> Option<DialectCommand> {
        match self.kind {
            Dialect::Fractint => fractint(c),
            Dialect::LParser => lparser(c),
            Dialect::LPy => match long_name {
                Some(name) => lpy_name(name),
                None => lpy(c),
            },
            Dialect::Cpfg | Dialect::Abop | Dialect::None | Dialect::Catkin => None,
        }
    }
}

/// Commands of Fractint, in either case. Source: the description of L-systems in Fractint's manual.
fn fractint(c: char) -> Option<DialectCommand> {
    use DialectCommand as C;
    Some(match c.to_ascii_uppercase() {
        'F' => C::Units(true),
        'G' => C::Units(false),
        'D' => C::Degrees(true),
        'M' => C::Degrees(false),
        '+' => C::TurnUnit(true),
        '-' => C::TurnUnit(false),
        '|' => C::TurnHalf,
        '\\' => C::TurnDegrees(true),
        '/' => C::TurnDegrees(false),
        '!' => C::Reverse,
        '@' => C::Size,
        'C' => C::Color(None),
        // In grammars with `turtle: fractint`, ';' and ',' stand for '<' and '>', which belong to the notation.
        '<' | ';' => C::Color(Some(1)),
        '>' | ',' => C::Color(Some(-1)),
        _ => return None,
    })
}

/// Commands of LParser. Source: its manual.
fn lparser(c: char) -> Option<DialectCommand> {
    use DialectCommand as C;
    let step = |share: f64, draws: bool, adds_vertex: bool| C::Step { share, draws, adds_vertex };
    Some(match c {
        '+' => C::Yaw(1.0),
        '-' => C::Yaw(-1.0),
        '&' => C::Pitch(1.0),
        '^' => C::Pitch(-1.0),
        // In grammars with `turtle: lparser`, '\\', '/', '=' and '`' stand for '<', '>', ':' and '"', which belong to the
        // notation of grammars.
        // The left side sinks: up turns to the left. In cpfg the roll to the left is the other one.
        '<' | '\\' => C::Roll(-1.0),
        '>' | '/' => C::Roll(1.0),
        '|' => C::TurnAround,
        '%' => C::RollOver,
        '$' => C::Level,
        '~' => C::Random,
        't' => C::Gravity,
        // Steps that draw add no corner to a polygon.
        'F' => step(1.0, true, false),
        'f' => step(1.0, false, true),
        'Z' => step(0.5, true, false),
        'z' => step(0.5, false, true),
        'g' => step(1.0, false, false),
        '\'' => C::Length(LENGTH_FACTOR),
        '"' | '`' => C::Length(1.0 / LENGTH_FACTOR),
        ':' | '=' => C::Angle(ANGLE_FACTOR),
        ';' => C::Angle(1.0 / ANGLE_FACTOR),
        '!' => C::Thickness(THICKNESS_FACTOR),
        '?' => C::Thickness(1.0 / THICKNESS_FACTOR),
        'c' => C::ColorIndex(1),
        '{' => C::OpenPolygon,
        '.' => C::Vertex,
        '}' => C::ClosePolygon,
        '(' | ')' | '0'..='9' => C::Digit,
        _ => return None,
    })
}

/// Commands of L-Py with one character. `/` rolls to the left there, to the right in cpfg.
fn lpy(c: char) -> Option<DialectCommand> {
    use DialectCommand as C;
    Some(match c {
        '+' => C::Yaw(1.0),
        '-' => C::Yaw(-1.0),
        '&' => C::Pitch(1.0),
        '^' => C::Pitch(-1.0),
        '/' => C::Roll(1.0),
        '\\' => C::Roll(-1.0),
        '|' => C::TurnAround,
        'F' => C::Forward(true),
        'f' => C::Forward(false),
        '_' => C::Radius(1.0),
        '!' => C::Radius(-1.0),
        ';' => C::ColorIndex(1),
        ',' => C::ColorIndex(-1),
        '{' => C::OpenPolygon,
        '.' => C::Vertex,
        '}' => C::ClosePolygon,
        _ => return None,
    })
}

/// Commands of L-Py with long names that no single character stands for. Source: its help card.
fn lpy_name(name: &str) -> Option<DialectCommand> {
    use DialectCommand as C;
    Some(match name {
        // Steps, turns and sizes.
        "nF" => C::Path,
        "@B" | "@b" => C::Forward(true),
        "iRollL" => C::Roll(1.0),
        "iRollR" => C::Roll(-1.0),
        "@v" => C::Level,
        "SetWidth" => C::Radius(1.0),
        "SetColor" => C::ColorIndex(1),
        "@D" => C::Scale,
        "@Di" => C::ScaleUp,
        "@Dd" => C::ScaleDown,
        // Positions and directions that are given as points.
        "@M" => C::MoveTo(false),
        "MoveRel" => C::MoveTo(true),
        "LineTo" => C::LineTo { relative: false, turns: false },
        "LineRel" => C::LineTo { relative: true, turns: false },
        "OLineTo" => C::LineTo { relative: false, turns: true },
        "OLineRel" => C::LineTo { relative: true, turns: true },
        "Pinpoint" => C::PointAt(false),
        "PinpointRel" => C::PointAt(true),
        "@R" => C::SetHead,
        "@O" => C::Sphere,
        "@o" => C::Circle,
        "@Ts" => C::Elasticity,
        "@Tp" => C::Tropism,
        "Frame" => C::Frame,
        // Generalised cylinders, and the curves that they follow.
        "@Gc" => C::StartCylinder,
        "@Ge" => C::EndCylinder,
        "SetGuide" => C::SetGuide,
        "EndGuide" => C::EndGuide,
        "PositionOnGuide" => C::PositionOnGuide,
        "SetContour" => C::SetContour,
        "Sweep" => C::Sweep,
        "InterpolateColors" | "SectionResolution" | "@2D" | "@3D" | "@L" => C::Ignored,
        "?P" | "?H" | "?L" | "?U" => C::Query(name.chars().nth(1)?),
        _ if name.starts_with("Texture") || name.starts_with('?') => C::Ignored,
        _ if name.starts_with('~') => C::Surface(name.chars().nth(1)?),
        "EulerAngles" | "LeftReflection" | "UpReflection" | "HeadingReflection" | "@g" | "surface" => C::Unsupported,
        _ => return None,
    })
}

/// A command of LParser that waits for its number, and the module that stands for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct WaitingCommand {
    pub command: DialectCommand,
    pub symbol: SymbolId,
    pub lineage: u64,
    /// Step in which the module was made.
    pub birth: u32,
}

/// A command of LParser whose number may follow it in the string.
#[derive(Debug, Clone, Default)]
pub(super) struct PendingNumber {
    pub waiting: Option<WaitingCommand>,
    /// The characters after `(` so far; `None`: no number has begun.
    pub text: Option<String>,
    /// Length, angle and thickness before the current run of modules made by the last step; only if the recursion has a
    /// fraction.
    pub outside: Option<[f64; 3]>,
}
