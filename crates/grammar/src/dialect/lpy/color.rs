//! Colours that L-Py saves after a model.

use std::collections::BTreeMap;

use super::Model;
use super::pieces::{assignment, split};
use crate::code::Expr;
use crate::dialect::text::Piece;
use crate::token::SourcePlace;

/// First colour index used for `SetColor(red,green,blue)`; the indices are assigned from the last one down.
const FIRST_OWN: u8 = 128;

/// Colours by index that a model sets, by `Color_1 = pgl.Material("Color_1", ambient = (65,45,15), diffuse = 3)` and
/// `context.turtle.setMaterial(1, Color_1)`, or by both on one line.
pub(super) fn palette(lines: &[Piece<'_>]) -> Vec<(u8, [u8; 3])> {
    let mut known: BTreeMap<&str, [u8; 3]> = BTreeMap::new();
    let mut out = Vec::new();
    for line in lines {
        if let Some((name, value)) = assignment(*line)
            && let Some(color) = material(value)
        {
            known.insert(name.text, color);
        }
        let call = line.text.find("setMaterial(").and_then(|at| arguments(line.from(at)));
        let parts = call.map(split).unwrap_or_default();
        if let [index, color, ..] = parts.as_slice()
            && let Ok(index) = index.text.parse::<u8>()
            && let Some(color) = material(*color).or_else(|| known.get(color.text).copied())
        {
            out.push((index, color));
        }
    }
    out
}

/// The text between the first parenthesis and the one that closes it.
fn arguments(piece: Piece<'_>) -> Option<Piece<'_>> {
    let open = piece.text.find('(')?;
    let mut depth = 0_usize;
    let close = piece.text.char_indices().skip_while(|(i, _)| *i < open).find_map(|(i, c)| {
        depth = (depth + usize::from(c == '(')).saturating_sub(usize::from(c == ')'));
        (c == ')' && depth == 0).then_some(i)
    })?;
    Some(piece.up_to(close).from(open + 1))
}

/// sRGB colour of `Material("name", ambient = (r,g,b), diffuse = d)`, which is `ambient` times `diffuse`. The name and both
/// keywords are optional.
fn material(piece: Piece<'_>) -> Option<[u8; 3]> {
    let at = piece.text.find("Material(")?;
    let mut places = ["ambient", "diffuse"].into_iter();
    let (mut ambient, mut diffuse) = (None, 1.0);
    for part in split(arguments(piece.from(at))?) {
        if part.text.is_empty() || part.text.starts_with(['"', '\'']) {
            continue;
        }
        let (word, value) = match assignment(part) {
            Some((word, value)) => (word.text, value),
            None => (places.next().unwrap_or(""), part),
        };
        match word {
            "ambient" => ambient = channels(value),
            "diffuse" => diffuse = value.text.parse::<f64>().ok()?,
            _ => {}
        }
    }
    // Without diffuse light the colour of a material is its ambient colour.
    let share = if diffuse > 0.0 { diffuse } else { 1.0 };
    ambient.map(|c| c.map(|v| byte(v * share)))
}

/// Reads the three numbers of `(r,g,b)` or `Color3(r,g,b)`.
fn channels(piece: Piece<'_>) -> Option<[f64; 3]> {
    let numbers: Vec<f64> = split(arguments(piece)?).iter().filter_map(|p| p.text.parse().ok()).collect();
    numbers.try_into().ok()
}

/// The nearest integer from 0 to 255.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn byte(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

impl Model<'_, '_> {
    /// The index for a colour of red, green and blue; L008 and `None` if they are not constant.
    pub(super) fn color_index(&mut self, args: &[Expr], place: SourcePlace) -> Option<u8> {
        let number = |arg: &Expr| match arg {
            Expr::Const(value) => Some(*value),
            Expr::Local(_) => None,
            Expr::Code(code) => crate::vm::constant_value(code),
        };
        let index = match args {
            [r, g, b, ..] => number(r).zip(number(g)).zip(number(b)).and_then(|((r, g), b)| {
                let (rgb, palette) = ([r, g, b].map(byte), &mut self.reader.palette);
                if let Some((index, _)) = palette.iter().find(|(i, c)| *i >= FIRST_OWN && *c == rgb) {
                    return Some(*index);
                }
                let index = (FIRST_OWN..=u8::MAX).rev().find(|i| palette.iter().all(|(used, _)| used != i))?;
                palette.push((index, rgb));
                Some(index)
            }),
            _ => None,
        };
        if index.is_none() {
            let message = "a colour of red, green and blue that is not constant".to_owned();
            let help = "the colour stays as it is; write SetColor with an index, or with numbers";
            self.reader.session.warning("L008", message, place, help);
        }
        index
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_read_in_each_form() {
        let lines = [
            "Color_1 = pgl.Material(\"Color_1\" , ambient = (65,45,15) , diffuse = 3 , )",
            "Color_1.name = \"Color_1\"",
            "context.turtle.setMaterial(1,Color_1)",
            "context.turtle.setMaterial(4,Material('Yellow',Color3(0,0,121),1.5,Color3(40,40,40),Color3(0,0,0),1,0))",
            "context().turtle.setMaterial(5, Material(ambient=(100, 200, 50), diffuse=2))",
            "context.turtle.setMaterial(6, Material((1,2,3)))",
            "Color_7 = pgl.Material(\"Color_7\", ambient = (9,8,7), diffuse = 0)",
            "context.turtle.setMaterial(7,Color_7)",
            "Color_8 = pgl.Texture2D(image = PGL_1 )",
            "context.turtle.setMaterial(8,Color_8)",
            "context.turtle.setMaterial(300,Color_1)",
            "context.turtle.setMaterial(9,Color_1",
        ];
        let pieces: Vec<Piece<'_>> = lines.iter().map(|l| Piece::new(0, l)).collect();
        // 65 45 15 times 3; 121 times 1.5 is 181.5; 200 times 2 is above 255.
        let wanted = [(1, [195, 135, 45]), (4, [0, 0, 182]), (5, [200, 255, 100]), (6, [1, 2, 3]), (7, [9, 8, 7])];
        assert_eq!(palette(&pieces), wanted);
    }
}
