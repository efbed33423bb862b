//! The habit of a species: the parameters of its yearly growth, by name, with unit, range, default and help.

use osier_base::math::narrow;
use osier_base::{Error, Result};

/// Orders of axes that tables distinguish: 0, the trunk, to 5; higher orders do not occur.
pub const ORDERS: usize = 6;

/// Keys whose values are counts.
const COUNTS: [&str; 4] = ["levels", "buds", "stems", "buttresses"];

/// Share of the years before `maturity` in which shoots bear all the leaves of a young tree.
const YOUNG_SHARE: f32 = 0.5;

/// A value for each order of axes, from 0, the trunk, to 5.
pub type PerOrder = [f32; ORDERS];

/// Number of values that a key takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    /// One number for the whole tree.
    One,
    /// Two numbers, such as the years of `maturity`.
    Two,
    /// One to [`ORDERS`] numbers, one for each order of axes; the last repeats.
    PerOrder,
}

/// A parameter that a table or a scene may set.
#[derive(Debug, Clone, Copy)]
pub struct HabitKey {
    /// Name as tables and scenes write it, in snake_case.
    pub name: &'static str,
    /// Unit of the value; empty for a pure number.
    pub unit: &'static str,
    /// Meaning, one sentence.
    pub help: &'static str,
    /// Smallest value allowed, in `unit`.
    pub min: f64,
    /// Largest value allowed, in `unit`.
    pub max: f64,
    /// Whether the key takes one number, two numbers, or a list by order of axes.
    pub arity: Arity,
    values: fn(&Habit) -> &[f32],
    values_mut: fn(&mut Habit) -> &mut [f32],
}

impl HabitKey {
    /// The values of a habit for this key: one, two or [`ORDERS`] of them, by [`Self::arity`].
    pub fn values<'a>(&self, habit: &'a Habit) -> &'a [f32] {
        (self.values)(habit)
    }

    /// Whether the value is a count, which has no fraction.
    pub fn is_count(&self) -> bool {
        COUNTS.contains(&self.name)
    }
}

/// Types in which a habit stores a parameter, read and set as slices so that one table covers all keys.
trait HabitValue {
    const ARITY: Arity;
    fn slice(&self) -> &[f32];
    fn slice_mut(&mut self) -> &mut [f32];
    fn of(values: &[f32]) -> Self;
}

/// Copies `values` to `to`; the last value fills the rest.
fn fill(to: &mut [f32], values: &[f32]) {
    let last = values.last().copied().unwrap_or(0.0);
    for (i, v) in to.iter_mut().enumerate() {
        *v = values.get(i).copied().unwrap_or(last);
    }
}

impl HabitValue for f32 {
    const ARITY: Arity = Arity::One;
    fn slice(&self) -> &[f32] {
        std::slice::from_ref(self)
    }
    fn slice_mut(&mut self) -> &mut [f32] {
        std::slice::from_mut(self)
    }
    fn of(values: &[f32]) -> Self {
        values.first().copied().unwrap_or(0.0)
    }
}

impl HabitValue for [f32; 2] {
    const ARITY: Arity = Arity::Two;
    fn slice(&self) -> &[f32] {
        self
    }
    fn slice_mut(&mut self) -> &mut [f32] {
        self
    }
    fn of(values: &[f32]) -> Self {
        let mut out = [0.0; 2];
        fill(&mut out, values);
        out
    }
}

impl HabitValue for PerOrder {
    const ARITY: Arity = Arity::PerOrder;
    fn slice(&self) -> &[f32] {
        self
    }
    fn slice_mut(&mut self) -> &mut [f32] {
        self
    }
    fn of(values: &[f32]) -> Self {
        let mut out = [0.0; ORDERS];
        fill(&mut out, values);
        out
    }
}

macro_rules! habit {
    ($($name:ident: $kind:ty = [$($default:expr),+], $unit:literal, $min:literal to $max:literal, $help:literal;)*) => {
        /// How a species grows. All lengths in m, times in years, angles in degrees. Arrays hold a value for each order of axes;
        /// a rule that makes a shoot uses the order of the new shoot.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Habit {
            $(#[doc = $help] pub $name: $kind,)*
        }

        impl Default for Habit {
            fn default() -> Self {
                Self { $($name: HabitValue::of(&[$($default),+]),)* }
            }
        }

        /// All parameters of a [`Habit`], in the order of the documents.
        pub const HABIT_KEYS: &[HabitKey] = &[$(HabitKey {
            name: stringify!($name),
            unit: $unit,
            help: $help,
            min: $min,
            max: $max,
            arity: <$kind as HabitValue>::ARITY,
            values: |habit| habit.$name.slice(),
            values_mut: |habit| habit.$name.slice_mut(),
        },)*];
    };
}

habit! {
    vigour: f32 = [1.0], "", 0.05 to 20.0, "Growth that a tree makes of the light it receives.";
    vigour_exponent: f32 = [1.0], "", 0.5 to 1.5, "Exponent of the light that a whole tree receives.";
    apical_control: PerOrder = [0.5], "", 0.02 to 0.98, "Share of an axis' own tip against its side branches in a young tree.";
    apical_control_old: PerOrder = [0.5], "", 0.02 to 0.98, "Share of an axis' own tip against its side branches in an old tree.";
    maturity: [f32; 2] = [15.0, 40.0], "yr", 0.0 to 1000.0, "Years between which young values turn into old ones.";
    shoot_rate: PerOrder = [0.3], "m/yr", 0.001 to 5.0, "Length of a shoot with the vigour of one tip in full light.";
    shoot_max: PerOrder = [0.8], "m/yr", 0.001 to 5.0, "Longest shoot of a year.";
    short_shoot: f32 = [0.03], "m", 0.001 to 0.5, "Shoots shorter than this stay spurs, with leaves but without wood.";
    internode: PerOrder = [0.1], "m", 0.02 to 1.0, "Longest internode.";
    juvenile: f32 = [0.0], "yr", 0.0 to 50.0, "Years in which a seedling reaches its full rate of growth.";
    leader_old: f32 = [1.0], "", 0.0 to 2.0, "Growth of an old tree's leader as a share of a young one's.";
    path_max: f32 = [24.0], "m", 0.5 to 200.0, "Longest path of water from the root to a shoot.";
    path_power: f32 = [2.0], "", 0.5 to 8.0, "Exponent of the decline of growth with the path of water.";
    height_max: f32 = [1000.0], "m", 0.3 to 1000.0, "Height at which growth ends.";
    height_power: f32 = [4.0], "", 0.5 to 8.0, "Exponent of the decline of growth with height.";
    axis_max: PerOrder = [1000.0], "m", 0.05 to 1000.0, "Length at which an axis stops.";
    shade_point: f32 = [0.15], "", 0.0 to 0.9, "Share of the open sky's light below which a tip starves.";
    patience: f32 = [2.0], "yr", 0.0 to 20.0, "Years that a tip starves before it dies.";
    shed: f32 = [0.35], "1/m", 0.0 to 10.0, "Light per metre of living wood below which a branch is shed.";
    shed_age: f32 = [4.0], "yr", 0.0 to 50.0, "Age before which no branch is shed.";
    bare_max: f32 = [1.0], "m", 0.05 to 1000.0, "Longest wood without leaves and forks that the light of one tip keeps alive.";
    linger: f32 = [4.0], "yr", 0.0 to 100.0, "Years that a dead branch of 20 mm radius stands before it falls.";
    bud_life: f32 = [2.0], "yr", 0.0 to 20.0, "Years that a bud waits for light.";
    levels: f32 = [6.0], "", 1.0 to 6.0, "Number of orders of axes.";
    bud_share: PerOrder = [1.0], "", 0.0 to 4.0, "Weight of a bud's light against that of a tip.";
    divergence: f32 = [137.5], "deg", 0.0 to 180.0, "Angle between successive buds of a shoot; 180 is two-ranked.";
    buds: f32 = [1.0], "", 1.0 to 2.0, "Buds at a node; 2 is opposite, in crossed pairs.";
    whorl: PerOrder = [0.0], "", 0.0 to 12.0, "Branches of a year's whorl; 0: buds along the shoot.";
    internodal: f32 = [0.0], "", 0.0 to 1.0, "Share of the buds that live between whorls.";
    bud_break: PerOrder = [0.5], "", 0.0 to 1.0, "Probability that a bud lives.";
    acrotony: f32 = [1.0], "", 0.0 to 5.0, "Exponent of the preference for buds near the end of a shoot.";
    angle: PerOrder = [0.0, 60.0, 50.0, 45.0], "deg", 0.0 to 150.0, "Angle at which a branch leaves its parent in a young tree.";
    angle_old: PerOrder = [0.0, 60.0, 50.0, 45.0], "deg", 0.0 to 150.0, "Angle at which a branch leaves its parent in an old tree.";
    angle_var: f32 = [8.0], "deg", 0.0 to 40.0, "Standard deviation of that angle; the axis stays lower or higher by as much.";
    planar: PerOrder = [0.0], "", 0.0 to 1.0, "How far side branches lie in one plane with their parent.";
    elevation: PerOrder = [90.0, 35.0, 20.0, 10.0], "deg", -90.0 to 90.0, "Angle above the horizon that an axis turns to.";
    elevation_rate: PerOrder = [0.0], "1/m", 0.0 to 10.0, "How fast it turns to its elevation while it grows.";
    phototropism: PerOrder = [0.3], "1/m", -5.0 to 5.0, "How fast it turns to the light while it grows.";
    wander: PerOrder = [0.15], "m^-1/2", 0.0 to 3.0, "Random turns of growth.";
    apex_death: PerOrder = [0.0], "1/yr", 0.0 to 1.0, "Probability that a side bud takes over from the tip, with a kink.";
    kink: PerOrder = [0.45], "", 0.0 to 2.0, "Mean angle of that kink, as a share of the angle of branches.";
    upright: PerOrder = [1.5, 0.3, 0.1, 0.0], "1/m", 0.0 to 10.0, "How fast reaction wood turns an axis to its elevation.";
    sag: PerOrder = [1.0], "", 0.0 to 20.0, "Bending under the weight that is added, as a share of the elastic beam's.";
    pipe_exponent: f32 = [2.2], "", 1.8 to 3.0, "Exponent of radii whose powers add up at forks.";
    tip_radius: f32 = [0.0015], "m", 0.0003 to 0.01, "Radius of a tip.";
    pipe_memory: f32 = [0.3], "", 0.0 to 1.0, "Share of a dead branch's wood that its parent keeps.";
    stout: PerOrder = [0.007, 0.006], "", 0.0 to 0.05, "Radius at the base of a new shoot over its length.";
    buckling_safety: PerOrder = [2.0, 0.7, 0.0], "", 0.0 to 6.0, "Length of column that an axis would carry, as a multiple of its own.";
    density: f32 = [900.0], "kg/m3", 200.0 to 1300.0, "Density of green wood.";
    elasticity_gpa: f32 = [6.0], "GPa", 0.5 to 25.0, "Young's modulus of green wood.";
    leaf_mass: f32 = [0.25], "kg/m2", 0.0 to 3.0, "Mass of leaves per area.";
    leaf_area_tip: f32 = [0.02], "m2", 0.0 to 1.0, "Leaf area of a tip.";
    leaf_area_shoot: f32 = [0.0], "m2/m", 0.0 to 2.0, "Leaf area per length of shoot.";
    leaf_young: f32 = [1.0], "", 0.0 to 10.0, "Leaf area along the shoots of a young tree, as a multiple of an old one's.";
    leaf_years: f32 = [1.0], "yr", 0.1 to 12.0, "Years that leaves live, rounded up.";
    extinction: f32 = [0.5], "", 0.1 to 1.5, "Light that a leaf area intercepts, as a share of the area.";
    stems: f32 = [1.0], "", 1.0 to 60.0, "Number of stems.";
    stem_spread: f32 = [0.2], "m", 0.0 to 5.0, "Radius of the disc that stems stand in.";
    stem_years: f32 = [0.0], "yr", 0.0 to 200.0, "Years over which stems sprout: two in five at once, the others later.";
    tilt: f32 = [0.0], "deg", 0.0 to 80.0, "Tilt of the outer stems.";
    clear_stem: f32 = [0.0], "m", 0.0 to 50.0, "Height below which branches are taken away.";
    clear_rate: f32 = [0.15], "m/yr", 0.0 to 5.0, "How fast the clear stem rises.";
    epicormic: f32 = [1.0], "", 0.0 to 1.0, "Share of the failed buds that stay dormant.";
    epicormic_radius: f32 = [0.2], "m", 0.0 to 10.0, "Radius of wood beyond which no dormant bud wakes.";
    reiterate: f32 = [0.0], "", -0.5 to 0.5, "Additional share of the tip where light per metre of wood is poor.";
    flare: f32 = [0.6], "", 0.0 to 2.0, "Root flare: widening of the stem at the ground, as a share of its radius.";
    flare_height: f32 = [1.5], "", 0.2 to 10.0, "Height over which the root flare falls to 1/e, in radii of the stem's base.";
    buttresses: f32 = [5.0], "", 0.0 to 8.0, "Roots that show as ridges of the root flare; below 2 it is round.";
    age: f32 = [60.0], "yr", 0.1 to 500.0, "Age of a tree whose scene names none.";
}

impl Habit {
    /// Whether low branches of the trunk are removed; false for a shrub, whose several stems keep theirs.
    pub fn clears_stem(&self) -> bool {
        self.stems < 1.5
    }

    /// Sets the parameter `name`. A list by order may be short: its last value holds for all higher orders.
    /// # Errors
    /// S002 for an unknown name, S003 for a wrong number of values or a count with a fraction, `Range` for a value outside the key's range.
    pub fn set(&mut self, name: &str, values: &[f64]) -> Result<()> {
        let Some(key) = HABIT_KEYS.iter().find(|k| k.name == name) else {
            return Err(Error::input("S002", format!("a habit has no key \"{name}\"")));
        };
        let fits = match key.arity {
            Arity::One => values.len() == 1,
            Arity::Two => values.len() == 2,
            Arity::PerOrder => (1..=ORDERS).contains(&values.len()),
        };
        if !fits {
            let wanted = match key.arity {
                Arity::One => "one number",
                Arity::Two => "two numbers",
                Arity::PerOrder => "one to six numbers",
            };
            return Err(Error::input("S003", format!("{name} takes {wanted}, not {}", values.len())));
        }
        if let Some(&value) = values.iter().find(|v| !(key.min..=key.max).contains(v)) {
            return Err(Error::Range { name: name.to_owned(), value, min: key.min, max: key.max, unit: key.unit });
        }
        if let Some(value) = values.iter().find(|v| key.is_count() && v.fract().abs() > 0.0) {
            return Err(Error::input("S003", format!("{name} takes a whole number, not {value}")));
        }
        let narrowed: Vec<f32> = values.iter().map(|v| narrow(*v)).collect();
        fill((key.values_mut)(self), &narrowed);
        Ok(())
    }

    /// A contradiction between keys whose values are each in range: `maturity` does not increase, or whorls are combined with
    /// opposite buds.
    pub fn contradiction(&self) -> Option<&'static str> {
        if self.maturity[0] >= self.maturity[1] {
            return Some("maturity must be two increasing years");
        }
        let whorled = self.whorl.iter().any(|w| *w > 0.0);
        (self.buds > 1.5 && whorled).then_some("whorl and buds = 2 exclude each other")
    }

    /// Refuses a habit whose keys contradict each other.
    /// # Errors
    /// S003 with its [`contradiction`](Self::contradiction).
    pub fn check(&self) -> Result<()> {
        self.contradiction().map_or(Ok(()), |why| Err(Error::input("S003", why)))
    }

    /// Leaf area per length of a shoot that grew in a year of the tree's life, m2/m. Own: young trees bear large leaves on all of their
    /// shoots; it declines over the years before `maturity` ends.
    pub(super) fn leaf_area_of_shoot(&self, birth: f32) -> f32 {
        if (self.leaf_young - 1.0).abs() < 1e-6 {
            return self.leaf_area_shoot;
        }
        let old = osier_base::math::smoothstep(YOUNG_SHARE * self.maturity[0], self.maturity[1], birth);
        self.leaf_area_shoot * (self.leaf_young + (1.0 - self.leaf_young) * old)
    }

    /// Number of ridges of the root flare.
    pub fn ridges(&self) -> u32 {
        whole(self.buttresses).into()
    }

    /// Number of orders of axes that the species forms, 1 to [`ORDERS`].
    pub(super) fn orders(&self) -> usize {
        usize::from(whole(self.levels)).clamp(1, ORDERS)
    }
}

/// The nearest whole number; values are bounded by the ranges of their keys.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ranges of keys lie within 16 bits")]
pub(super) fn whole(value: f32) -> u16 {
    value.round().clamp(0.0, 65535.0) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_lie_in_their_ranges_and_names_are_unique() {
        let habit = Habit::default();
        habit.check().expect("sound");
        for (i, key) in HABIT_KEYS.iter().enumerate() {
            assert!(
                key.values(&habit).iter().all(|v| (key.min..=key.max).contains(&f64::from(*v)) || {
                    // Values such as 0.0003 are rounded to single precision.
                    (f64::from(*v) - key.min).abs() < 1e-9
                }),
                "{}",
                key.name
            );
            assert!(HABIT_KEYS[..i].iter().all(|k| k.name != key.name));
            let values: Vec<f64> = key.values(&habit).iter().map(|v| f64::from(*v)).collect();
            let mut again = habit.clone();
            again.set(key.name, &values).expect("its own default");
            assert_eq!(again, habit);
        }
    }

    #[test]
    fn wrong_values_are_refused() {
        let mut habit = Habit::default();
        habit.set("shoot_rate", &[0.5, 0.25]).expect("sets");
        assert!(habit.shoot_rate[2..].iter().all(|v| (v - 0.25).abs() < 1e-6));
        for (name, values, code) in [
            ("shoot_rate", [0.5; 7].as_slice(), "S003"),
            ("shoot_rate", &[], "S003"),
            ("vigor", &[1.0], "S002"),
            ("maturity", &[1.0], "S003"),
            ("stems", &[2.5], "S003"),
        ] {
            let error = habit.set(name, values).expect_err("refused").to_string();
            assert!(error.contains(code), "{name}: {error}");
        }
        assert!(matches!(habit.set("shed", &[11.0]), Err(Error::Range { .. })));
        assert!(matches!(habit.set("shed", &[f64::NAN]), Err(Error::Range { .. })));
        habit.set("maturity", &[20.0, 10.0]).expect("in range");
        assert!(habit.check().is_err());
    }
}
