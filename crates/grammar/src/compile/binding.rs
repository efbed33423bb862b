//! The items that bind symbols to what they draw: `turtle:`, `define-angle:`, `bind`.

use super::items::ItemParser;
use super::lines::{Keyword, LogicalLine};
use super::{NameScope, TokenCursor, expression, whole_expression};
use crate::binding::{AngleDefinition, Dialect, SymbolBinding, TurtleAction, TurtleAxis, TurtleBindings};
use crate::code::Bytecode;
use crate::token::{SourcePlace, Token, TokenKind};
use osier_base::diagnostic::{Diagnostic, nearest};
use osier_base::rng::word;

/// Words that may follow `turtle:`, and the notation whose commands they choose.
const DIALECTS: [(&str, Dialect); 7] = [
    ("cpfg", Dialect::Cpfg),
    ("abop", Dialect::Abop),
    ("lparser", Dialect::LParser),
    ("fractint", Dialect::Fractint),
    ("lpy", Dialect::LPy),
    ("catkin", Dialect::Catkin),
    ("none", Dialect::None),
];
/// Symbols that `bind` refuses because they belong to the notation.
const RESERVED_SYMBOLS: [char; 7] = ['<', '>', ':', '(', ')', '[', ']'];
/// Help for faults of `define-angle:`.
const ANGLES_HELP: &str = "write: define-angle: a = uniform(0,60)  b = normal(0,5)";
/// First words of actions, for suggestions.
const ACTIONS: [&str; 13] = [
    "forward", "move", "rotate", "width", "widen", "colour", "polygon", "vertex", "fill", "organ", "sphere", "as",
    "none",
];

impl ItemParser<'_> {
    /// Reads all lines about the turtle, which must precede the axiom and the productions.
    pub(super) fn turtle_items(&mut self, lines: &[LogicalLine]) {
        let mut past_header = false;
        for line in lines {
            let key = line.keyword.map(|(k, _)| k);
            past_header |= line.arrow.is_some() || key == Some(Keyword::Axiom);
            // The other lines are compiled later, when the bindings of all symbols are known.
            let (Some((k @ (Keyword::Turtle | Keyword::Angles | Keyword::Bind), n)), Some(place)) =
                (line.keyword, line.place())
            else {
                continue;
            };
            let head = line.tokens.first().map_or(place, |t| t.place);
            if past_header {
                let help = "move this line above the axiom and the productions";
                self.session.error_help(
                    "L001",
                    "'turtle:', 'define-angle:' and 'bind' must precede the axiom and the productions".into(),
                    head,
                    help,
                );
                continue;
            }
            if k != Keyword::Turtle && self.program.turtle.is_none() {
                let help = "add 'turtle: none', or 'turtle: cpfg' to keep its commands";
                self.session.error_help(
                    "L001",
                    "'define-angle:' and 'bind' need a 'turtle:' line before them".into(),
                    head,
                    help,
                );
                continue;
            }
            // After `bind` a colon is itself a symbol, not the end of the keyword.
            let colon = usize::from(k != Keyword::Bind && line.tokens.get(n).is_some_and(|t| t.is(':')));
            let value = line.tokens.get(n + colon..).unwrap_or(&[]);
            match k {
                Keyword::Turtle => self.select_dialect(value, head),
                Keyword::Angles => self.angle_definitions(value, head),
                _ => self.bind(value, head),
            }
        }
    }

    fn select_dialect(&mut self, value: &[Token], head: SourcePlace) {
        // The first word names the turtle dialect; numeric settings may follow for those of other programs.
        let (name, numbers) = value.split_at(value.len().min(1));
        let spelled = self.spelling(name);
        let place = value.first().map_or(head, |t| t.place);
        if self.program.turtle.is_some() {
            return self.session.error_help("L001", "a second 'turtle:'".into(), place, "remove one of them");
        }
        if let Some((_, dialect)) = DIALECTS.iter().find(|(w, _)| *w == spelled) {
            let bindings = TurtleBindings::new(*dialect, &mut self.program.symbols, &mut self.session.names);
            self.program.turtle = Some(bindings);
            return self.turtle_numbers(numbers, place);
        }
        // Continue as if a turtle had been chosen, so that the following lines cause no further errors.
        self.program.turtle = Some(TurtleBindings { dialect: Dialect::None, ..TurtleBindings::default() });
        let known = DIALECTS.map(|d| d.0);
        let help = match nearest(&spelled, known) {
            Some(n) => format!("did you mean '{n}'?"),
            None => format!("turtles: {}", known.join(", ")),
        };
        self.session.error_help("L001", format!("unknown turtle '{spelled}'"), place, help);
    }

    /// Reads the numeric settings of a turtle dialect: `angle = 20 thickness = 30`.
    fn turtle_numbers(&mut self, tokens: &[Token], at: SourcePlace) {
        let mut cursor = TokenCursor::new(tokens, at);
        while let Some(t) = cursor.peek() {
            let name = self.word(&mut cursor);
            let known = ["angle", "thickness", "min_thickness", "unit", "fraction"].contains(&name.as_str());
            if !known || !cursor.eat('=') {
                let help = "write: turtle: lparser angle = 20 thickness = 30 (percent) min_thickness = 1 unit = 100 fraction = 0.5";
                let message = "unexpected token after the turtle, expected 'angle = ..' or another of its numbers";
                return self.session.error_help("L001", message.into(), t.place, help);
            }
            let mut compiler = self.compiler(NameScope::Angle);
            let Some(code) = expression::compile_expression(&mut compiler, &mut cursor) else { return };
            // The settings must be constant: angles and variables have no value here.
            let Some(value) = crate::vm::constant_value(&code).filter(|v| v.is_finite()) else {
                let help = "write a number, or a calculation with numbers";
                return self.session.error_help("L001", format!("'{name}' is not constant"), t.place, help);
            };
            let range = match name.as_str() {
                "thickness" | "min_thickness" if value < 0.0 => "0 or more",
                "unit" if value <= 0.0 => "above 0",
                "fraction" if !(0.0..1.0).contains(&value) => "from 0 to below 1",
                _ => "",
            };
            if !range.is_empty() {
                let help = format!("write a number {range}, or leave '{name}' out");
                return self.session.error_help("L001", format!("'{name}' must be {range}"), t.place, help);
            }
            let Some(turtle) = &mut self.program.turtle else { return };
            let settings = &mut turtle.settings;
            match name.as_str() {
                "angle" => settings.angle_deg = Some(value),
                // The file gives a percentage.
                "thickness" => settings.thickness = Some(0.01 * value),
                "min_thickness" => settings.min_thickness = 0.01 * value,
                "unit" => settings.unit = Some(value),
                // A fraction of 0 counts as absent.
                _ => settings.fraction = Some(value).filter(|f| *f > 0.0),
            }
        }
    }

    /// Names of the angles defined so far, which an expression may use; the position is the slot.
    fn angle_names(&self) -> Vec<u32> {
        self.program.turtle.iter().flat_map(|t| &t.angles).map(|a| a.name).collect()
    }

    /// Reads definitions of angles: `name = expression`, repeated.
    fn angle_definitions(&mut self, value: &[Token], head: SourcePlace) {
        let mut cursor = TokenCursor::new(value, head);
        if cursor.peek().is_none() {
            self.session.fault("unexpected end of line, expected 'name = value'", head, "after this", ANGLES_HELP);
        }
        while let Some(t) = cursor.peek() {
            let TokenKind::Ident(name) = t.kind else {
                let found = super::describe(&self.session.names, t);
                let message = format!("unexpected {found}, expected the name of an angle");
                return self.session.error_help("L001", message, t.place, ANGLES_HELP);
            };
            cursor.bump();
            // An expression ends where the next `name =` begins, so that no separator is needed.
            if !cursor.eat('=') {
                let message = "expected '=' after the name of an angle".into();
                return self.session.error_help("L001", message, cursor.place(), ANGLES_HELP);
            }
            let names = self.angle_names();
            let mut compiler = self.compiler(NameScope::Angle);
            compiler.locals = names;
            let Some(code) = expression::compile_expression(&mut compiler, &mut cursor) else { return };
            self.define_angle(name, code, t.place);
        }
    }

    fn define_angle(&mut self, name: u32, code: Bytecode, place: SourcePlace) {
        let spelled = self.session.names.get(name).to_owned();
        let Some(turtle) = &mut self.program.turtle else { return };
        let angle = AngleDefinition { name, draw_key: word(&spelled), code, place: Some(place) };
        match turtle.angles.iter_mut().find(|a| a.name == name) {
            Some(AngleDefinition { place: Some(first), .. }) => {
                let message = format!("angle '{spelled}' is defined twice");
                let d = Diagnostic::error("L024", message, place.span, "the second one");
                let d = d.label(first.span, "the first one").help("give the second one another name");
                self.session.push(d, place);
            }
            // An angle that the dialect defines is replaced.
            Some(own) => *own = angle,
            None => turtle.angles.push(angle),
        }
    }

    /// Reads bindings: `SYMBOL : ACTION ; SYMBOL : ACTION ..`
    fn bind(&mut self, value: &[Token], head: SourcePlace) {
        let mut rest = value;
        while let Some(symbol) = rest.first() {
            // The first token is skipped, as the symbol may itself be a semicolon.
            let mut depth = 0_usize;
            // Bindings are separated by semicolons outside parentheses.
            let end = rest.iter().enumerate().skip(1).find(|(_, t)| {
                depth = (depth + usize::from(t.is('('))).saturating_sub(usize::from(t.is(')')));
                depth == 0 && t.is(';')
            });
            let end = end.map_or(rest.len(), |(i, _)| i);
            self.binding(*symbol, &rest[1..end], head);
            rest = rest.get(end + 1..).unwrap_or(&[]);
        }
    }

    fn binding(&mut self, symbol: Token, tokens: &[Token], head: SourcePlace) {
        let Some(c) = self.one_symbol(symbol) else { return };
        let Some((_, tokens)) = tokens.split_first().filter(|(t, _)| t.is(':')) else {
            let at = tokens.first().map_or(symbol.place, |t| t.place);
            let help = "write: bind SYMBOL : ACTION ; SYMBOL : ACTION";
            return self.session.error_help("L001", "expected ':' after the symbol".into(), at, help);
        };
        let Some((action, value)) = self.action(tokens, symbol.place) else { return };
        let Some(id) = self.program.symbols.intern(c) else { return };
        let Some(turtle) = &mut self.program.turtle else { return };
        let binding = SymbolBinding { action, value, place: Some(symbol.place) };
        // A `bind` item may replace a binding of the dialect, but not one of the file.
        if let Some(Some(first)) = turtle.symbols.get(&id).map(|b| b.place) {
            let d = Diagnostic::error("L038", format!("'{c}' is bound twice"), symbol.place.span, "the second one");
            let d = d.label(first.span, "the first one").help("remove one of them");
            return self.session.push(d, head);
        }
        turtle.symbols.insert(id, binding);
    }

    /// The single character of a token; L038 for several characters, or for one that cannot be bound.
    fn one_symbol(&mut self, t: Token) -> Option<char> {
        let text = match t.kind {
            TokenKind::Ident(n) | TokenKind::Number(n) => self.session.names.get(n).to_owned(),
            TokenKind::Char(c) => c.to_string(),
            TokenKind::Text(_) | TokenKind::Newline { .. } => String::new(),
        };
        let mut chars = text.chars();
        let (first, second) = (chars.next(), chars.next());
        let fault = match (first, second) {
            (Some(c), None) if !RESERVED_SYMBOLS.contains(&c) => return Some(c),
            (Some(c), None) => format!("'{c}' cannot be bound: it belongs to the notation"),
            _ => "only one symbol can be bound at a time".to_owned(),
        };
        let help = "bind one character other than < > : ( ) [ ] to each action";
        self.session.error_help("L038", fault, t.place, help);
        None
    }

    /// Parses the action of a binding, with the code of its number if it takes one; `None` after an error.
    fn action(&mut self, tokens: &[Token], at: SourcePlace) -> Option<(TurtleAction, Option<Bytecode>)> {
        let mut cursor = TokenCursor::new(tokens, at);
        let place = cursor.place();
        // `rotate` is followed by space and axis, `organ` by a letter or `stalk`, `as` by a symbol; a number may come last.
        let first = self.word(&mut cursor);
        let action = match first.as_str() {
            "forward" => TurtleAction::Forward,
            "move" => TurtleAction::Move,
            "rotate" => self.rotation(&mut cursor)?,
            "width" => TurtleAction::Width,
            "widen" => TurtleAction::Widen,
            "colour" => TurtleAction::Colour,
            "polygon" => TurtleAction::Polygon,
            "vertex" => TurtleAction::Vertex,
            "fill" => TurtleAction::Fill,
            "organ" => TurtleAction::Organ(self.organ(&mut cursor)?),
            "sphere" => TurtleAction::Sphere,
            "as" => {
                let Some(t) = cursor.peek() else { return self.missing("a symbol", cursor.place()) };
                cursor.bump();
                TurtleAction::SameAs(self.one_symbol(*t)?)
            }
            "none" => TurtleAction::Nothing,
            _ => {
                let help = match nearest(&first, ACTIONS) {
                    Some(n) => format!("did you mean '{n}'?"),
                    None => format!("actions: {}", ACTIONS.join(", ")),
                };
                self.session.error_help("L001", format!("unknown action '{first}'"), place, help);
                return None;
            }
        };
        // Actions that take no number. Organs may have one, which is their size.
        let plain = matches!(
            action,
            TurtleAction::Polygon
                | TurtleAction::Vertex
                | TurtleAction::Fill
                | TurtleAction::SameAs(_)
                | TurtleAction::Nothing
                | TurtleAction::Organ(_)
        );
        // The remaining tokens are the number of the action, an expression that may use the angles defined so far.
        let rest = tokens.get(cursor.pos..).unwrap_or(&[]);
        if rest.is_empty() {
            return if plain { Some((action, None)) } else { self.missing("a number", cursor.place()) };
        }
        if plain && !matches!(action, TurtleAction::Organ(_)) {
            let t = rest.first().map_or(place, |t| t.place);
            self.session.error_help("L001", format!("'{first}' takes no number"), t, "remove it");
            return None;
        }
        let names = self.angle_names();
        let mut compiler = self.compiler(NameScope::Angle);
        compiler.locals = names;
        Some((action, Some(whole_expression(&mut compiler, rest, place)?)))
    }

    fn missing<T>(&mut self, what: &str, place: SourcePlace) -> Option<T> {
        let message = format!("expected {what} after this");
        let help = "give the action all that it takes: forward 1, rotate world x 30, as F";
        self.session.fault(message, place, "after this", help);
        None
    }

    /// Consumes the next token and returns its text; an empty string if it is not a word.
    fn word(&mut self, cursor: &mut TokenCursor<'_>) -> String {
        let Some(TokenKind::Ident(n)) = cursor.peek().map(|t| t.kind) else { return String::new() };
        cursor.bump();
        self.session.names.get(n).to_owned()
    }

    /// Parses the axis of a rotation: `world x|y|z` or `turtle h|l|u`.
    fn rotation(&mut self, cursor: &mut TokenCursor<'_>) -> Option<TurtleAction> {
        let place = cursor.place();
        let (space, axis) = (self.word(cursor), self.word(cursor));
        let action = match (space.as_str(), axis.as_str()) {
            ("world", "x") => TurtleAction::RotateWorld(0),
            ("world", "y") => TurtleAction::RotateWorld(1),
            ("world", "z") => TurtleAction::RotateWorld(2),
            ("turtle", "h") => TurtleAction::RotateTurtle(TurtleAxis::Heading),
            ("turtle", "l") => TurtleAction::RotateTurtle(TurtleAxis::Left),
            ("turtle", "u") => TurtleAction::RotateTurtle(TurtleAxis::Up),
            _ => {
                let message = format!("unknown axis '{space} {axis}'");
                let help = "write: rotate world x (or y, z), or rotate turtle h (or l, u), then the angle";
                self.session.error_help("L001", message, place, help);
                return None;
            }
        };
        Some(action)
    }

    /// Parses a letter of the scene's organs, or `stalk`.
    fn organ(&mut self, cursor: &mut TokenCursor<'_>) -> Option<String> {
        let place = cursor.place();
        let name = self.word(cursor);
        if name.chars().count() == 1 || name == "stalk" {
            return Some(name);
        }
        let help = "give the letter of an organ that the scene describes, or 'stalk', that of a catkin";
        self.session.error_help("L001", format!("unknown organ '{name}'"), place, help);
        None
    }
}
