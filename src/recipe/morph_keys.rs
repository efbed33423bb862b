//! Keys of attractors that change with time.

use super::key::{Fault, Kind, Shown, keys, number, outside, words, wrong};
use super::kinds::{Colors, File, OneOf, Reference, Text, num};
use super::tree::{Node, Value};

words! {
    /// How time passes between two tables.
    Ease {
        /// Evenly.
        Linear = "linear",
        /// Slow at the tables, fast between.
        Smooth = "smooth",
    }
    /// What of a map's place goes straight.
    Shift {
        /// Its shift b.
        Straight = "straight",
        /// Its fixed point.
        FixedPoint = "fixed-point",
    }
    /// What becomes of the maps' weights.
    MorphWeights {
        /// They change with the tables.
        Follow = "follow",
        /// Those of the first table stay, and every point keeps its word.
        Hold = "hold",
    }
}

/// Most full turns between two tables.
const TURNS: f64 = 100.0;

/// Full turns: one number for all maps, or one per map.
#[derive(Debug, Clone, Copy)]
pub struct Turns;

impl Turns {
    fn whole(name: &str, node: &Node) -> Result<f64, Fault> {
        let v = number(name, node)?;
        if v.abs() > TURNS || v.fract() != 0.0 {
            return Err(outside(name, node, &v.to_string(), "a whole number, -100 to 100"));
        }
        Ok(v)
    }
}

impl Kind for Turns {
    type Value = Vec<f64>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &Node) -> Result<Self::Value, Fault> {
        match &node.value {
            Value::List(list) => list.iter().map(|n| Self::whole(name, n)).collect(),
            Value::Integer(_) | Value::Number(_) => Ok(vec![Self::whole(name, node)?]),
            _ => Err(wrong(name, node, "a whole number, or a list of them, one per map")),
        }
    }
    fn shown(&self) -> Shown {
        let accepts = "whole number, -100 to 100, or a list of them, one per map".into();
        Shown { accepts, default: "0".into(), unit: "" }
    }
}

keys! {
    /// An attractor that changes with time, from table to table: turns go the shortest way, all else goes straight.
    MorphKeys at "clouds.NAME.morph" with ["key"] {
        /// How time passes between two tables.
        ease: Ease = "ease" OneOf(Ease::Linear);
        /// What of a map's place goes straight.
        shift: Shift = "shift" OneOf(Shift::Straight);
        /// What becomes of the maps' weights.
        weights: MorphWeights = "weights" OneOf(MorphWeights::Follow);
    }
    /// One table at one time, in the order of time; all tables have the same number of maps.
    MorphKey at "clouds.NAME.morph.key" {
        /// The coefficient table.
        ifs: Option<Reference> = "ifs" File(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" Text("");
        /// When, from the first frame.
        at: f64 = "at" num(0.0, 0.0, 1e6, "s");
        /// Full turns that maps make on their way here, besides the shortest turn.
        turns: Vec<f64> = "turns" Turns;
        /// Colours by map, or along the palette, at this time; without them the cloud's or the table's.
        colors: Vec<[f32; 3]> = "colors" Colors;
    }
}
