//! `[rain]`: rainfall, impacts, drops on leaves, wetness.

use crate::recipe::resolve::{Resolver, span_of};
use crate::recipe::syntax::{
    BooleanType, NumberArray, OneOf, OptionalKey, TomlTable, TomlValue, cubic_millimetres, degrees, integer,
    millimetres, number, rain_rate, timed_rows, wrong,
};
use crate::recipe::syntax::{choices, keys, recipe};
use osier_base::diagnostic::Diagnostic;

choices! {
    /// How large raindrops are.
    RainSize {
        /// As in rain of its strength, by Marshall and Palmer.
        Natural = "natural",
        /// All of `size_mm`.
        Fixed = "fixed",
        /// Around `size_mm`, spread by `size_spread`.
        LogNormal = "log_normal",
    }
    /// How rain's strength changes over a clip.
    RainEnvelope {
        /// It does not.
        Constant = "constant",
        /// A bell around `middle_s`, as the paper by Yang and Wu has it.
        Bell = "bell",
        /// As `envelope_keyframes` say.
        Keys = "keys",
    }
    /// Sets of defaults.
    RainPreset {
        /// What is measured of water on leaves.
        Measured = "measured",
        /// What the paper by Yang and Wu prints.
        Paper = "paper",
    }
    /// What a drop's blow does.
    ImpactModel {
        /// Momentum is kept.
        Momentum = "momentum",
        /// A share of its energy moves the leaf, as the paper has it.
        PaperEnergy = "paper_energy",
    }
    /// How drops are shaped.
    DropShape {
        /// Flattened by their weight, their volume kept.
        Flattened = "flattened",
        /// With the paper's heights, which lose volume.
        Paper = "paper",
        /// With the paper's factor lambda^kappa.
        PaperWedge = "paper_wedge",
    }
    /// What holds a drop back.
    DropFriction {
        /// Its contact angles differ in front and behind.
        Retention = "retention",
        /// The paper's mu and H.
        Paper = "paper",
    }
    /// When drops become one.
    DropMerge {
        /// When they touch.
        Touch = "touch",
        /// Nearer than touching, as the paper's attraction has it.
        Paper = "paper",
    }
    /// With what arm a drop's weight turns its leaf.
    DropLever {
        /// Its own.
        Physical = "physical",
        /// Less near the stalk, as the paper has it.
        Paper = "paper",
    }
}

keys! {
    /// Rain on the plants of a scene: drops fall, strike, run, merge, hang and drip. Leaves give way where their plant has
    /// `[plants.NAME.rods]`.
    RainKeys at "rain" {
        /// Where defaults come from.
        preset: RainPreset = "preset" OneOf(RainPreset::Measured);
        /// Whether rain falls; without it only drops of `[[rain.lying]]` are there.
        falls: bool = "falls" BooleanType(true);
        /// How much.
        rate: f64 = "rate_mm_per_h" rain_rate(10.0, 0.1, 200.0);
        /// Distribution of drop sizes.
        size: RainSize = "size_distribution" OneOf(RainSize::Natural);
        /// Diameter of drops that are not natural.
        diameter: f64 = "size_mm" millimetres(2.0, 0.5, 6.0);
        /// How much they differ: deviation of the logarithm.
        spread: f64 = "size_spread" number(0.3, 0.01, 1.5, "");
        /// Drops of the whole clip, instead of a rate.
        total: Option<u32> = "total" OptionalKey(integer(1000, 1, 100_000_000), "by rate_mm_per_h");
        /// How its strength changes.
        envelope: RainEnvelope = "envelope" OneOf(RainEnvelope::Constant);
        /// With "bell": when it is strongest.
        middle: Option<f64> = "middle_s" OptionalKey(number(5.0, -1e4, 1e5, "s"), "half the clip");
        /// With "bell": its width.
        width: Option<f64> = "width_s" OptionalKey(number(2.5, 0.01, 1e5, "s"), "a quarter of the clip");
        /// With envelope "keys": [s, factor], times rising.
        envelope_keyframes: Vec<Vec<f64>> = "envelope_keyframes" timed_rows();
        /// How much its strength changes by chance.
        jitter: f64 = "jitter" number(0.2, 0.0, 1.0, "");
        /// Time for which it has rained before the first frame.
        before: f64 = "before_s" number(0.0, 0.0, 600.0, "s");
        /// Steps a frame.
        substeps: Option<u32> = "substeps" OptionalKey(integer(8, 1, 256), "8, or as many as the plants' rods need");
        /// Acceleration of gravity, of drops and of all rods of the scene.
        gravity: f64 = "gravity" number(9.81, 0.01, 30.0, "m/s^2");
    }
    /// What drops do when they strike.
    ImpactKeys at "rain.impact" {
        /// What a blow does.
        model: ImpactModel = "model" OneOf(ImpactModel::Momentum);
        /// With "paper_energy": share of energy that is lost.
        energy_loss: f64 = "energy_loss" number(0.1, 0.0, 1.0, "");
        /// With "momentum": share of the speed of approach that is given back.
        restitution: f64 = "restitution" number(0.0, 0.0, 0.9, "");
        /// Factor on impulses of impacts, for exaggerated motion.
        impulse_factor: f64 = "impulse_factor" number(1.0, 1.0, 10.0, "");
        /// Share of a hard-striking drop that leaves as droplets.
        splash: f64 = "splash" number(0.0, 0.0, 0.8, "");
        /// Share of its speed along the leaf that a drop keeps.
        tangent_keep: f64 = "tangent_keep" number(0.3, 0.0, 1.0, "");
    }
    /// Drops on leaves.
    DropKeys at "rain.drop" {
        /// Contact angle: 40 where leaves are wettable, 110 where they are waxy, 150 on lotus.
        contact_angle: f64 = "contact_angle_deg" degrees(60.0, 1.0, 175.0);
        /// Angle at which the rim behind gives way.
        receding: f64 = "receding_deg" degrees(52.0, 0.0, 180.0);
        /// Angle at which the rim in front moves on.
        advancing: f64 = "advancing_deg" degrees(68.0, 0.0, 180.0);
        /// How drops are shaped.
        shape: DropShape = "shape" OneOf(DropShape::Flattened);
        /// Height of a drop as a share of a cap's.
        omega: Option<f64> = "omega" OptionalKey(number(0.5, 0.01, 1.0, ""), "by its weight");
        /// With "paper_wedge": base of the factor.
        lambda: f64 = "lambda" number(1.05, 1.0, 1.5, "");
        /// What holds a drop back.
        friction: DropFriction = "friction" OneOf(DropFriction::Retention);
        /// Coefficient of sliding friction of a drop on the leaf.
        friction_coefficient: f64 = "friction_coefficient" number(0.0, 0.0, 2.0, "");
        /// With friction "paper": the constant H of its resisting force.
        paper_friction: f64 = "paper_friction_n" number(2e-5, 0.0, 1e-2, "N");
        /// Factor on the retention force of contact-angle hysteresis.
        retention_factor: f64 = "retention_factor" number(1.0, 0.0, 2.0, "");
        /// Time constant with which viscosity slows running water.
        velocity_decay: f64 = "velocity_decay_s" number(0.05, 0.005, 1.0, "s");
        /// How unevenly a leaf holds drops.
        pin_noise: f64 = "pin_noise" number(0.3, 0.0, 0.9, "");
        /// When drops become one.
        merge: DropMerge = "merge" OneOf(DropMerge::Touch);
        /// With merge "paper": strength of the attraction between drops.
        paper_attraction: f64 = "paper_attraction_n" number(1e-4, 1e-7, 1.0, "N");
        /// With what arm weight turns a leaf.
        lever: DropLever = "lever" OneOf(DropLever::Physical);
        /// With lever "paper": largest lever arm, as a share.
        paper_lever_max: f64 = "paper_lever_max" number(0.8, 0.0, 1.0, "");
        /// Ratio of the radii of successive drops of a tail.
        tail_ratio: f64 = "tail_ratio" number(0.8, 0.3, 0.95, "");
        /// Largest number of drops of a tail.
        tail_drops: u32 = "tail_drops" integer(8, 1, 16);
        /// How much of a tail there is: roughness of the leaf.
        rough: f64 = "rough" number(1.0, 0.0, 1.0, "");
        /// Chance that a drop of a tail stays behind.
        bead: f64 = "bead" number(0.25, 0.0, 1.0, "");
        /// Radius at which a drop hangs at a tip.
        tip_radius: f64 = "tip_radius_mm" millimetres(1.0, 0.3, 2.25);
    }
    /// How leaves become wet and dry again.
    WettingKeys at "rain.wet" {
        /// Share of its wetness that a leaf keeps after `decay_time_s`; 0.5 makes that time a half-life.
        decay_fraction: f64 = "decay_fraction" number(0.5, 0.01, 0.99, "");
        /// Time in which wetness falls to `decay_fraction` of itself.
        decay_time: f64 = "decay_time_s" number(20.0, 0.05, 1e5, "s");
        /// Length on which wetness falls from a drop's middle.
        length: f64 = "length_mm" millimetres(3.0, 0.1, 100.0);
    }
    /// A drop that lies on a leaf when the clip begins.
    SessileDropKeys at "rain.lying" {
        /// Leaf, counted from 0 over all plants in the order of their places.
        leaf: u32 = "leaf" integer(0, 0, 1_000_000);
        /// Where: u across the leaf, v from its base to its tip.
        at: [f64; 2] = "at" NumberArray([0.5, 0.5], number(0.5, 0.0, 1.0, ""));
        /// How much water.
        volume: f64 = "volume_mm3" cubic_millimetres(10.0, 0.01, 1000.0);
        /// Speed along the leaf, towards its tip and to its right.
        speed: [f64; 2] = "speed" NumberArray([0.0; 2], number(0.0, -5.0, 5.0, "m/s"));
    }
}

recipe! {
    /// Rain of a scene.
    RainRecipe {
        /// Rainfall.
        keys: RainKeys;
        /// Impacts on leaves.
        impact: ImpactKeys;
        /// Drops on leaves.
        drop: DropKeys;
        /// Wetting and drying of leaves.
        wet: WettingKeys;
        /// Drops that lie on leaves when the clip begins.
        lying: Vec<SessileDropKeys>, hashed by element;
    }
}

impl Resolver<'_> {
    /// `[rain]`, if there is one.
    pub(in crate::recipe) fn rain(&mut self, root: &TomlTable) -> Option<RainRecipe> {
        let entry = root.get("rain")?;
        let table = self.table(root, "", "rain")?;
        if root.get("plants").is_none() {
            let d = Diagnostic::error("S006", "[rain] needs a plant to fall on", entry.key_span, "no plant here");
            self.report.push(d.help("add [plants.NAME] with a grammar or a mesh"));
        }
        let keys = self.read_keys::<RainKeys>(table, "rain");
        let mut rain = RainRecipe {
            impact: self.section_at(table, "rain", "impact"),
            drop: self.section_at(table, "rain", "drop"),
            wet: self.section_at(table, "rain", "wet"),
            lying: self.lying(table),
            keys,
        };
        as_printed(&mut rain, table);
        self.angles(&rain.drop, table);
        if rain.keys.envelope == RainEnvelope::Keys
            && (rain.keys.envelope_keyframes.is_empty()
                || rain.keys.envelope_keyframes.windows(2).any(|k| k[1][0] <= k[0][0]))
        {
            let span = table.get("envelope_keyframes").map_or(entry.key_span, |e| e.node.span);
            let d = Diagnostic::error(
                "S006",
                "`envelope = \"keys\"` needs rising times with factors",
                span,
                "these do not",
            );
            self.report.push(d.help("write envelope_keyframes = [[0, 0], [2, 1], [5, 0]]"));
        }
        Some(rain)
    }

    fn lying(&mut self, table: &TomlTable) -> Vec<SessileDropKeys> {
        let Some(entry) = table.get("lying") else { return Vec::new() };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong("rain.lying", &entry.node, "a list: write [[rain.lying]]"));
            return Vec::new();
        };
        let mut all = Vec::new();
        for (i, node) in list.iter().enumerate() {
            let path = format!("rain.lying.{i}");
            match &node.value {
                TomlValue::Table(t) => all.push(self.read_keys::<SessileDropKeys>(t, &path)),
                _ => self.report.push(*wrong(&path, node, "a table")),
            }
        }
        all
    }

    /// The angle at rest lies between those at which rims move.
    fn angles(&mut self, drop: &DropKeys, table: &TomlTable) {
        if drop.receding <= drop.contact_angle && drop.contact_angle <= drop.advancing {
            return;
        }
        let span =
            span_of(table, &["drop", "contact_angle_deg"]).or_else(|| span_of(table, &["drop"])).unwrap_or(self.whole);
        let deg = f64::to_degrees;
        let text = format!(
            "contact angles must rise from receding over theta to advancing, but are {:.0}, {:.0}, {:.0} degrees",
            deg(drop.receding),
            deg(drop.contact_angle),
            deg(drop.advancing)
        );
        let d = Diagnostic::error("S004", text, span, "out of order");
        self.report.push(d.help("waxy leaves: contact_angle_deg = 110, receding_deg = 100, advancing_deg = 118"));
    }
}

/// What the paper prints, where the scene says nothing else.
fn as_printed(rain: &mut RainRecipe, table: &TomlTable) {
    if rain.keys.preset != RainPreset::Paper {
        return;
    }
    let said = |section: &str, key: &str| {
        let at = if section.is_empty() { Some(table) } else { below(table, section) };
        at.is_some_and(|t| t.get(key).is_some())
    };
    macro_rules! unless {
        ($($section:literal $key:literal: $place:expr => $value:expr;)*) => {
            $(if !said($section, $key) { $place = $value; })*
        };
    }
    unless! {
        "" "gravity": rain.keys.gravity => 9.8;
        "" "envelope": rain.keys.envelope => RainEnvelope::Bell;
        "impact" "model": rain.impact.model => ImpactModel::PaperEnergy;
        "drop" "shape": rain.drop.shape => DropShape::Paper;
        "drop" "omega": rain.drop.omega => Some(0.5);
        "drop" "friction": rain.drop.friction => DropFriction::Paper;
        "drop" "friction_coefficient": rain.drop.friction_coefficient => 0.3;
        "drop" "merge": rain.drop.merge => DropMerge::Paper;
        "drop" "lever": rain.drop.lever => DropLever::Paper;
    }
}

fn below<'t>(table: &'t TomlTable, name: &str) -> Option<&'t TomlTable> {
    match &table.get(name)?.node.value {
        TomlValue::Table(t) => Some(t),
        _ => None,
    }
}
