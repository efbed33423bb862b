//! Keys of rods.

use super::key::{Fault, Kind, Shown, keys, words, wrong};
use super::kinds::{Color, Flag, Maybe, OneOf, Text, Tuple, mm, num, point, whole};
use super::tree::{Node, Value};

words! {
    /// How rods are stepped through time.
    RodIntegrator {
        /// All springs solved together, second order in time: stable and true at any stiffness.
        Xpbd = "xpbd",
        /// Springs one by one, once a step: for soft ropes; what is stiff hangs limp.
        XpbdGs = "xpbd_gs",
        /// Small steps, springs as forces: the reference, slow for stiff rods.
        EulerSymplectic = "euler_symplectic",
        /// As the paper by Yang and Wu has it: needs damping and tiny steps.
        EulerExplicit = "euler_explicit",
    }
    /// What weight does to the shape that the points draw.
    RodGravity {
        /// The rod is drawn as it hangs: its shape without weight is found first.
        Posed = "posed",
        /// The rod's own weight is left out.
        Compensated = "compensated",
        /// The rod is drawn as it would be without weight, and droops.
        Droop = "droop",
    }
    /// How a place of a rod is held.
    RodHold {
        /// It neither moves nor turns.
        Fixed = "fixed",
        /// It turns about where it is.
        Pinned = "pinned",
        /// It turns, and slides along a line.
        Guided = "guided",
    }
    /// What acts on a place of a rod.
    RodLoadKind {
        /// A force: keys of [s, x, y, z], N.
        Force = "force",
        /// A force and a torque: keys of [s, x, y, z, x, y, z], N and N m.
        Wrench = "wrench",
        /// A weight that rides on it: keys of [s, kg]; where it becomes 0 it is let go.
        Mass = "mass",
        /// Blows: each key is one, [s, x, y, z], N s.
        Blow = "blow",
    }
}

/// Points, m.
#[derive(Debug, Clone, Copy)]
pub struct Points;

impl Kind for Points {
    type Value = Vec<[f64; 3]>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &Node) -> Result<Self::Value, Fault> {
        let Value::List(list) = &node.value else { return Err(wrong(name, node, "a list of points [x, y, z]")) };
        list.iter().map(|n| point([0.0; 3]).read(name, n)).collect()
    }
    fn shown(&self) -> Shown {
        Shown { accepts: "list of [x, y, z]".into(), default: "[]".into(), unit: "m" }
    }
}

/// Keys over time: lists of numbers that begin with seconds.
#[derive(Debug, Clone, Copy)]
pub struct Times;

impl Kind for Times {
    type Value = Vec<Vec<f64>>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &Node) -> Result<Self::Value, Fault> {
        let wanted = "a list of keys [s, ...]";
        let Value::List(list) = &node.value else { return Err(wrong(name, node, wanted)) };
        let key = |n: &Node| match &n.value {
            Value::List(row) => row.iter().map(|n| num(0.0, -1e9, 1e9, "").read(name, n)).collect(),
            _ => Err(wrong(name, n, wanted)),
        };
        list.iter().map(key).collect()
    }
    fn shown(&self) -> Shown {
        Shown { accepts: "list of [s, ...], times rising".into(), default: "[]".into(), unit: "" }
    }
}

keys! {
    /// A rod that bends, twists and swings: a pole, a twig, a stalk. Its base is fixed if no `[[rod.clamp]]` says otherwise.
    RodKeys at "rod" with ["clamp", "load"] {
        /// Its name; others stand on it by it.
        name: String = "name" Text("");
        /// From base to tip; a smooth curve goes through them.
        points: Vec<[f64; 3]> = "points" Points;
        /// Radius at its base and at its tip.
        radius: [f64; 2] = "radius_mm" Tuple([3.0, 2.0], mm(3.0, 0.05, 2000.0));
        /// Rod in which its base is fixed.
        on: String = "on" Text("");
        /// Where on that, 0 at its base to 1 at its tip.
        on_at: f64 = "on_at" num(1.0, 0.0, 1.0, "");
        /// Young's modulus.
        young: f64 = "E_GPa" num(5.0, 1e-5, 1000.0, "GPa");
        /// Stiffness against bending at its base, instead of the modulus.
        bending: Option<f64> = "EI" Maybe(num(1.0, 1e-9, 1e9, "N m^2"), "from E_GPa and radius");
        /// Shear modulus over Young's.
        shear: f64 = "shear_ratio" num(1.0 / 15.0, 0.02, 0.5, "");
        /// Stiffness against twisting at its base, instead of the shear modulus.
        torsion: Option<f64> = "GJ" Maybe(num(1.0, 1e-9, 1e9, "N m^2"), "from shear_ratio");
        /// Density.
        density: f64 = "density" num(900.0, 1.0, 20_000.0, "kg/m^3");
        /// Damping of its slowest swing, as a share of critical.
        zeta: f64 = "zeta" num(0.2, 0.0, 1.0, "");
        /// Strength of the springs back to where it was drawn.
        recovery: f64 = "recovery" num(0.25, 0.0, 4.0, "");
        /// Divides its stiffness, for looks.
        gain: f64 = "gain" num(1.0, 1.0, 20.0, "");
        /// Drag of the wind on it; 0 for none.
        drag: f64 = "drag" num(1.1, 0.0, 3.0, "");
        /// Cross-sections that it is made of.
        sections: Option<u32> = "sections" Maybe(whole(9, 2, 64), "an interval of 3 radii, 5 to 16");
        /// How it is stepped through time; that of the lowest rod counts.
        integrator: RodIntegrator = "integrator" OneOf(RodIntegrator::Xpbd);
        /// Steps a frame; those of the lowest rod count.
        substeps: Option<u32> = "substeps" Maybe(whole(8, 1, 200_000), "8 to 64, by its slowest swing");
        /// What weight does to its shape; that of the lowest rod counts.
        gravity: RodGravity = "gravity" OneOf(RodGravity::Posed);
        /// Velocity of its tip at the start, falling to none at its base.
        launch: [f64; 3] = "launch" Tuple([0.0; 3], num(0.0, -1000.0, 1000.0, "m/s"));
        /// Its colour.
        color: [f32; 3] = "color" Color("#8a6f4d");
    }
    /// Moves a plant as rods: twigs bend, leaves hang on stalks. With this table wind moves it so, instead of by `sway`;
    /// stiffness, weight, drag and damping stand in `[plants.NAME.wood]`.
    TwigKeys at "plants.NAME.rods" {
        /// Wood thicker than this, in radius, stands still.
        thickest: f64 = "thickest_mm" mm(15.0, 0.1, 1000.0);
        /// Young's modulus of stalks.
        stalk_young: f64 = "petiole_E_GPa" num(0.3, 0.001, 30.0, "GPa");
        /// Radius of stalks.
        stalk_radius: Option<f64> = "petiole_radius_mm" Maybe(mm(0.8, 0.1, 10.0), "the leaf's own, or 0.8");
        /// Shear modulus over Young's.
        shear: f64 = "shear_ratio" num(1.0 / 15.0, 0.02, 0.5, "");
        /// Strength of the springs back to how it grew.
        recovery: f64 = "recovery" num(0.25, 0.0, 4.0, "");
        /// Divides all stiffness, for looks.
        gain: f64 = "gain" num(1.0, 1.0, 20.0, "");
        /// Cross-sections of a twig.
        sections: Option<u32> = "sections" Maybe(whole(9, 3, 64), "an interval of 3 radii, 5 to 16");
        /// Cross-sections of a stalk.
        stalk_sections: u32 = "petiole_sections" whole(5, 3, 16);
        /// Steps a frame.
        substeps: Option<u32> = "substeps" Maybe(whole(16, 1, 10_000), "8 to 64, by its slowest swings");
        /// Leaves on stalks of their own; further ones are rigid with their twigs.
        max_leaves: u32 = "max_leaves" whole(400, 0, 100_000);
        /// Cross-sections of the whole plant; twigs without room are rigid with what they stand on.
        max_sections: u32 = "max_sections" whole(4000, 3, 1_000_000);
    }
    /// Where a rod is held.
    RodClamp at "rod.clamp" {
        /// Where, 0 at its base to 1 at its tip.
        at: f64 = "at" num(0.0, 0.0, 1.0, "");
        /// How.
        hold: RodHold = "hold" OneOf(RodHold::Fixed);
        /// With "guided": the line's direction.
        line: [f64; 3] = "line" Tuple([0.0, 1.0, 0.0], num(0.0, -1e6, 1e6, ""));
        /// How the held place is moved: keys of [s, x, y, z], m from where it is drawn.
        keys: Vec<Vec<f64>> = "keys" Times;
        /// With "fixed": axis about which it is turned.
        axis: [f64; 3] = "axis" Tuple([0.0, 1.0, 0.0], num(0.0, -1e6, 1e6, ""));
        /// With "fixed": how far it is turned: keys of [s, degrees].
        turns: Vec<Vec<f64>> = "turn_keys" Times;
    }
    /// What acts on a rod.
    RodLoad at "rod.load" {
        /// Where, 0 at its base to 1 at its tip.
        at: f64 = "at" num(1.0, 0.0, 1.0, "");
        /// What.
        kind: RodLoadKind = "kind" OneOf(RodLoadKind::Force);
        /// When and how much, linear between keys, as the first before them and as the last after them.
        keys: Vec<Vec<f64>> = "keys" Times;
        /// With "mass": whether it is seen, as a ball as heavy as water.
        show: bool = "show" Flag(true);
        /// With "mass": its colour.
        color: [f32; 3] = "color" Color("#a83a2c");
    }
}
