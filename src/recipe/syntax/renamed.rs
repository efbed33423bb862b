//! Keys renamed since earlier versions, for the help of S002 in `osier check` and `osier bake`.

/// A key of earlier versions and its present name.
#[derive(Debug, Clone, Copy)]
pub struct RenamedKey {
    /// Path of the table, as `plants.NAME.rods`.
    table: &'static str,
    old: &'static str,
    /// Name of the key that `osier check` suggests.
    pub new: &'static str,
    /// How the value must be changed, if its meaning has changed.
    pub change: Option<&'static str>,
}

const fn key(table: &'static str, old: &'static str, new: &'static str) -> RenamedKey {
    RenamedKey { table, old, new, change: None }
}

const RENAMED: &[RenamedKey] = &[
    key("rod", "E_GPa", "elasticity_gpa"),
    key("rod", "EI", "bending_stiffness"),
    key("rod", "GJ", "torsional_stiffness"),
    key("rod", "zeta", "damping_ratio"),
    key("rod", "gain", "compliance"),
    key("rod.clamp", "keys", "keyframes"),
    key("rod.clamp", "turn_keys", "turn_keyframes"),
    key("rod.load", "keys", "keyframes"),
    key("plants.NAME.rods", "petiole_E_GPa", "petiole_elasticity_gpa"),
    key("plants.NAME.rods", "gain", "compliance"),
    key("rain", "keys", "envelope_keyframes"),
    key("rain", "size", "size_distribution"),
    key("rain", "g", "gravity"),
    key("rain.impact", "gain", "impulse_factor"),
    key("rain.impact", "eps", "energy_loss"),
    key("rain.drop", "theta_deg", "contact_angle_deg"),
    key("rain.drop", "mu", "friction_coefficient"),
    key("rain.drop", "H_N", "paper_friction_n"),
    key("rain.drop", "k_f", "retention_factor"),
    key("rain.drop", "tau_v_s", "velocity_decay_s"),
    key("rain.drop", "k_H_N", "paper_attraction_n"),
    key("rain.drop", "phi_c", "paper_lever_max"),
    key("rain.drop", "tail_beta", "tail_ratio"),
    key("rain.drop", "tail_n", "tail_drops"),
    key("rain.wet", "zeta", "decay_fraction"),
    key("rain.wet", "half_life_s", "decay_time_s"),
    key("maps", "hero_max", "max_mapped_leaves"),
    key("wind.lattice", "reference", "reference_height"),
    key("flight", "preroll", "spin_up_s"),
    key("wind.lattice", "preroll", "spin_up_s"),
    key("rain", "before_s", "spin_up_s"),
    RenamedKey {
        table: "sun",
        old: "azimuth_deg",
        new: "direction_deg",
        change: Some("subtract 90: directions of sun, wind and lean are counted from +X towards -Z"),
    },
    key("terrain", "n", "subdivisions"),
];

/// The key that had this name in an earlier version. `table`: path of its declaration.
pub fn renamed_key(table: &str, key: &str) -> Option<&'static RenamedKey> {
    RENAMED.iter().find(|r| r.table == table && r.old == key)
}
