//! `[rain]`: rainfall, impacts, drops on leaves, wetness.

use crate::recipe::resolve::{Resolver, span_of};
use crate::recipe::syntax::{
    BooleanType, NumberArray, OneOf, OptionalKey, TomlTable, TomlValue, cubic_millimetres, degrees, integer,
    millimetres, number, rain_rate, timed_rows, wrong,
};
use crate::recipe::syntax::{choices, keys, recipe};
use osier_base::diagnostic::Diagnostic;

choices! {
    /// Size distribution of raindrops.
    RainSize {
        /// Distribution of Marshall and Palmer for the rain rate.
        Natural = "natural",
        /// All drops have the diameter `size_mm`.
        Fixed = "fixed",
        /// Log-normal with median `size_mm` and spread `size_spread`.
        LogNormal = "log_normal",
    }
    /// Intensity of the rain over a clip, as a factor on its rate.
    RainEnvelope {
        /// The rate is constant.
        Constant = "constant",
        /// A bell curve around `middle_s`, as in the paper by Yang and Wu.
        Bell = "bell",
        /// Linear interpolation of `envelope_keyframes`.
        Keys = "keys",
    }
    /// Source of the default values of rain.
    RainPreset {
        /// Measurements of water on leaves.
        Measured = "measured",
        /// Values and equations printed in the paper by Yang and Wu.
        Paper = "paper",
    }
    /// Law of the impulse of a drop on a leaf.
    ImpactModel {
        /// Momentum of drop and leaf is conserved.
        Momentum = "momentum",
        /// A share of the drop's energy moves the leaf, as in the paper.
        PaperEnergy = "paper_energy",
    }
    /// Height of a drop on a leaf for its volume and contact angle.
    DropShape {
        /// Caps flattened by gravity, with their volume conserved.
        Flattened = "flattened",
        /// Heights of the paper, which do not conserve volume.
        Paper = "paper",
        /// Heights with the paper's factor lambda^kappa.
        PaperWedge = "paper_wedge",
    }
    /// Force that holds a drop on a leaf back.
    DropFriction {
        /// Retention by the difference of contact angles at its front and back.
        Retention = "retention",
        /// Friction coefficient mu and force H of the paper.
        Paper = "paper",
    }
    /// Condition under which drops on a leaf coalesce.
    DropMerge {
        /// Their contact circles touch.
        Touch = "touch",
        /// They are close enough for the attraction of the paper.
        Paper = "paper",
    }
    /// Lever arm of a drop's weight about the joint of its leaf.
    DropLever {
        /// Distance from the leaf joint to the drop.
        Physical = "physical",
        /// The paper's factor, which is smaller near the petiole.
        Paper = "paper",
    }
}

keys! {
    /// Rain on the plants of the scene, whose leaves and branches move under impacts and the weight of water.
    RainKeys at "rain" {
        /// Source of the defaults: measured properties of rain and leaves, or the rules of the paper.
        preset: RainPreset = "preset" OneOf(RainPreset::Measured);
        /// Whether rain falls; without it only drops of `[[rain.lying]]` exist.
        falls: bool = "falls" BooleanType(true);
        /// Mean rainfall rate, which the envelope and `jitter` vary.
        rate: f64 = "rate_mm_per_h" rain_rate(10.0, 0.1, 200.0), basic;
        /// Distribution of drop diameters: Marshall-Palmer ("natural"), one size, or log-normal.
        size: RainSize = "size_distribution" OneOf(RainSize::Natural), basic;
        /// Diameter of "fixed" drops, median diameter of "log_normal" drops.
        diameter: f64 = "size_mm" millimetres(2.0, 0.5, 6.0), basic;
        /// With "log_normal": standard deviation of the logarithm of the diameter.
        spread: f64 = "size_spread" number(0.3, 0.01, 1.5, "");
        /// Number of drops of the whole clip, instead of a rate.
        total: Option<u32> = "total" OptionalKey(integer(1000, 1, 100_000_000), "by rate_mm_per_h");
        /// Variation of the rate over time.
        envelope: RainEnvelope = "envelope" OneOf(RainEnvelope::Constant);
        /// With "bell": time of the maximum.
        middle: Option<f64> = "middle_s" OptionalKey(number(5.0, -1e4, 1e5, "s"), "half the clip");
        /// With "bell": standard deviation in time.
        width: Option<f64> = "width_s" OptionalKey(number(2.5, 0.01, 1e5, "s"), "a quarter of the clip");
        /// With "keys": keyframes [s, factor].
        envelope_keyframes: Vec<Vec<f64>> = "envelope_keyframes" timed_rows();
        /// Amplitude of random variation of the rate.
        jitter: f64 = "jitter" number(0.2, 0.0, 1.0, "");
        /// Duration of rain before the first frame (spin-up).
        spin_up: f64 = "spin_up_s" number(0.0, 0.0, 600.0, "s");
        /// Time steps per frame.
        substeps: Option<u32> = "substeps" OptionalKey(integer(8, 1, 256), "8, more below 24 frames per second, or as many as the rods need");
        /// Largest number of drops on leaves and at margins that a frame shows as meshes: those that the camera sees largest. All
        /// others wet their leaves and are in the tables.
        max_drop_meshes: u32 = "max_drop_meshes" integer(4000, 0, 1_000_000);
        /// Gravitational acceleration on all that moves: drops, rods, swaying branches, catkins.
        gravity: f64 = "gravity" number(9.81, 0.01, 30.0, "m/s^2");
    }
    /// Impacts of raindrops on leaves.
    ImpactKeys at "rain.impact" {
        /// Impact law: conservation of momentum, or the energy of the paper.
        model: ImpactModel = "model" OneOf(ImpactModel::Momentum);
        /// With "paper_energy": fraction of energy that is lost.
        energy_loss: f64 = "energy_loss" number(0.1, 0.0, 1.0, "");
        /// With "momentum": coefficient of restitution; fast drops bounce with this fraction of their speed along the normal.
        restitution: f64 = "restitution" number(0.0, 0.0, 0.9, "");
        /// Factor on impulses of impacts, for exaggerated motion.
        impulse_factor: f64 = "impulse_factor" number(1.0, 1.0, 10.0, "");
        /// Fraction of the volume that a fast drop ejects as droplets.
        splash: f64 = "splash" number(0.0, 0.0, 0.8, "");
        /// Fraction of the tangential velocity that a drop keeps.
        tangent_keep: f64 = "tangent_keep" number(0.3, 0.0, 1.0, "");
    }
    /// Drops on leaves: shape, friction, coalescence, tails.
    DropKeys at "rain.drop" {
        /// Contact angle at rest: 40 on wettable, 110 on waxy leaves, 150 on lotus.
        contact_angle: f64 = "contact_angle_deg" degrees(60.0, 1.0, 175.0);
        /// Receding contact angle.
        receding: f64 = "receding_deg" degrees(52.0, 0.0, 180.0);
        /// Advancing contact angle.
        advancing: f64 = "advancing_deg" degrees(68.0, 0.0, 180.0);
        /// Shape of drops: caps flattened by gravity, or the formulas of the paper.
        shape: DropShape = "shape" OneOf(DropShape::Flattened);
        /// Height of a drop divided by that of its spherical cap.
        omega: Option<f64> = "omega" OptionalKey(number(0.5, 0.01, 1.0, ""), "from its weight");
        /// With "paper_wedge": base of the factor on the height.
        lambda: f64 = "lambda" number(1.05, 1.0, 1.5, "");
        /// Law of friction: retention by contact-angle hysteresis, or the constant force of the paper.
        friction: DropFriction = "friction" OneOf(DropFriction::Retention);
        /// Coefficient of sliding friction between drop and leaf.
        friction_coefficient: f64 = "friction_coefficient" number(0.0, 0.0, 2.0, "");
        /// With friction "paper": the constant H of its resisting force.
        paper_friction: f64 = "paper_friction_n" number(2e-5, 0.0, 1e-2, "N");
        /// Factor on the retention force of contact-angle hysteresis.
        retention_factor: f64 = "retention_factor" number(1.0, 0.0, 2.0, "");
        /// Time constant of the viscous friction of running drops.
        velocity_decay: f64 = "velocity_decay_s" number(0.05, 0.005, 1.0, "s");
        /// Spatial variation of pinning over the leaf.
        pin_noise: f64 = "pin_noise" number(0.3, 0.0, 0.9, "");
        /// Condition for coalescence: contact, or the distance of the paper, within which drops attract each other.
        merge: DropMerge = "merge" OneOf(DropMerge::Touch);
        /// With merge "paper": constant k_H of the attraction of drops that overlap, and of the distance of coalescence.
        paper_attraction: f64 = "paper_attraction_n" number(1e-4, 1e-7, 1.0, "N");
        /// Lever arm of the weight of drops: physical, or with the additional factor of the paper.
        lever: DropLever = "lever" OneOf(DropLever::Physical);
        /// With lever "paper": largest lever factor.
        paper_lever_max: f64 = "paper_lever_max" number(0.8, 0.0, 1.0, "");
        /// Ratio of the radii of successive caps of a tail.
        tail_ratio: f64 = "tail_ratio" number(0.8, 0.3, 0.95, "");
        /// Largest number of caps of a tail.
        tail_drops: u32 = "tail_drops" integer(8, 1, 16);
        /// Length of tails: roughness of the leaf.
        rough: f64 = "rough" number(1.0, 0.0, 1.0, "");
        /// Probability that a cap of a tail is deposited as a bead.
        bead: f64 = "bead" number(0.25, 0.0, 1.0, "");
        /// Radius of the circle from which drops hang at a tip.
        tip_radius: f64 = "tip_radius_mm" millimetres(1.0, 0.3, 2.25);
    }
    /// Wetting and drying of leaves.
    WettingKeys at "rain.wet" {
        /// Fraction of the wetness that remains after `decay_time_s`; 0.5 makes that time a half-life.
        decay_fraction: f64 = "decay_fraction" number(0.5, 0.01, 0.99, "");
        /// Time after which the wetness has decayed to `decay_fraction`.
        decay_time: f64 = "decay_time_s" number(20.0, 0.05, 1e5, "s");
        /// Film of water from earlier rain on all leaves, and on bark, solids and ground where rain reaches them, which makes them darker and shiny: 0 dry, 1 closed. Appearance only.
        film: f64 = "film" number(0.0, 0.0, 1.0, ""), basic;
        /// Length over which wetness decreases from the centre of a drop.
        length: f64 = "length_mm" millimetres(3.0, 0.1, 100.0);
    }
    /// A sessile drop at the first frame.
    SessileDropKeys at "rain.lying" as list {
        /// Index of the leaf, from 0 over all plants in the order of placement.
        leaf: u32 = "leaf" integer(0, 0, 1_000_000);
        /// Position: u across the leaf, v from base to tip.
        at: [f64; 2] = "at" NumberArray([0.5, 0.5], number(0.5, 0.0, 1.0, ""));
        /// Volume of the drop.
        volume: f64 = "volume_mm3" cubic_millimetres(10.0, 0.01, 1000.0);
        /// Initial velocity along the leaf: towards its tip, and to its right.
        speed: [f64; 2] = "speed" NumberArray([0.0; 2], number(0.0, -5.0, 5.0, "m/s"));
    }
}

recipe! {
    /// Rain of a scene, from `[rain]` and the tables below it.
    RainRecipe {
        /// Rate, drop sizes and envelope.
        keys: RainKeys;
        /// Impact law of drops on leaves.
        impact: ImpactKeys;
        /// Drops on leaves: shape, friction, coalescence, tails.
        drop: DropKeys;
        /// Wetting and drying of leaves.
        wet: WettingKeys;
        /// Drops that lie on leaves when the clip begins.
        lying: Vec<SessileDropKeys>, hashed by element;
    }
}

impl Resolver<'_> {
    /// Reads `[rain]` and the tables below it; `None` without the table. S006 for rain in a scene without plants.
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
            lying: self.sessile_drops(table),
            keys,
        };
        // The preset replaces defaults, but no keys that the scene gives.
        apply_paper_defaults(&mut rain, table);
        self.check_contact_angles(&rain.drop, table);
        // Rows that could not be read have been reported.
        let rows = &rain.keys.envelope_keyframes;
        let is_read = !rows.is_empty() || !table.holds("envelope_keyframes");
        if rain.keys.envelope == RainEnvelope::Keys && is_read {
            let span = table.get("envelope_keyframes").map_or(entry.key_span, |e| e.node.span);
            // Times must rise strictly: two factors at one time would have no interpolation.
            let fault = if let Some(row) = rows.iter().find(|row| row.len() != 2) {
                let text = format!("a keyframe of rain.envelope_keyframes has {} numbers, but must have 2", row.len());
                Some(Diagnostic::error("S003", text, span, "keys of 2 numbers"))
            } else if rows.is_empty() || rows.windows(2).any(|k| k[1][0] <= k[0][0]) {
                let text = "`envelope = \"keys\"` needs rising times with factors";
                Some(Diagnostic::error("S006", text, span, "these do not"))
            } else {
                rows.iter().find(|row| row[1] < 0.0).map(|row| {
                    let text = format!("a factor of rain.envelope_keyframes is {}, but must be 0 or more", row[1]);
                    Diagnostic::error("S004", text, span, "at least 0")
                })
            };
            let help =
                "write envelope_keyframes = [[0, 0], [2, 1], [5, 0]]: seconds from the first frame, then a factor";
            fault.into_iter().for_each(|d| self.report.push(d.help(help)));
        }
        Some(rain)
    }

    fn sessile_drops(&mut self, table: &TomlTable) -> Vec<SessileDropKeys> {
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

    /// Reports S004 unless the receding, static and advancing contact angles rise in this order.
    fn check_contact_angles(&mut self, drop: &DropKeys, table: &TomlTable) {
        if drop.receding <= drop.contact_angle && drop.contact_angle <= drop.advancing {
            return;
        }
        let span =
            span_of(table, &["drop", "contact_angle_deg"]).or_else(|| span_of(table, &["drop"])).unwrap_or(self.whole);
        let deg = f64::to_degrees;
        let text = format!(
            "contact angles must rise from receding over contact_angle to advancing, but are {:.0}, {:.0}, {:.0} degrees",
            deg(drop.receding),
            deg(drop.contact_angle),
            deg(drop.advancing)
        );
        let d = Diagnostic::error("S004", text, span, "out of order");
        self.report.push(d.help("waxy leaves: contact_angle_deg = 110, receding_deg = 100, advancing_deg = 118"));
    }
}

/// Applies `preset = "paper"` to the keys that the scene does not give.
fn apply_paper_defaults(rain: &mut RainRecipe, table: &TomlTable) {
    if rain.keys.preset != RainPreset::Paper {
        return;
    }
    let said = |section: &str, key: &str| {
        // A key with the default as its value counts as given.
        let at = if section.is_empty() { Some(table) } else { table.table(section) };
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
