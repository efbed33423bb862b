//! Keys that had another name in an earlier version: `osier check` and `osier bake` name the new one.

/// Path of the table, old key, new key.
const RENAMED: &[(&str, &str, &str)] = &[
    ("rod", "E_GPa", "elasticity_gpa"),
    ("rod", "EI", "bending_stiffness"),
    ("rod", "GJ", "torsional_stiffness"),
    ("rod", "zeta", "damping_ratio"),
    ("rod", "gain", "compliance"),
    ("rod.clamp", "keys", "keyframes"),
    ("rod.clamp", "turn_keys", "turn_keyframes"),
    ("rod.load", "keys", "keyframes"),
    ("plants.NAME.rods", "petiole_E_GPa", "petiole_elasticity_gpa"),
    ("plants.NAME.rods", "gain", "compliance"),
    ("rain", "keys", "envelope_keyframes"),
    ("rain", "size", "size_distribution"),
    ("rain", "g", "gravity"),
    ("rain.impact", "gain", "impulse_factor"),
    ("rain.impact", "eps", "energy_loss"),
    ("rain.drop", "theta_deg", "contact_angle_deg"),
    ("rain.drop", "mu", "friction_coefficient"),
    ("rain.drop", "H_N", "paper_friction_n"),
    ("rain.drop", "k_f", "retention_factor"),
    ("rain.drop", "tau_v_s", "velocity_decay_s"),
    ("rain.drop", "k_H_N", "paper_attraction_n"),
    ("rain.drop", "phi_c", "paper_lever_max"),
    ("rain.drop", "tail_beta", "tail_ratio"),
    ("rain.drop", "tail_n", "tail_drops"),
    ("rain.wet", "zeta", "decay_fraction"),
    ("rain.wet", "half_life_s", "decay_time_s"),
    ("maps", "hero_max", "max_mapped_leaves"),
    ("wind.lattice", "reference", "reference_height"),
    ("flight", "preroll", "spin_up_s"),
    ("wind.lattice", "preroll", "spin_up_s"),
    ("rain", "before_s", "spin_up_s"),
    ("sun", "azimuth_deg", "direction_deg"),
    ("terrain", "n", "subdivisions"),
];

/// The present name of a key that an earlier version knew. `table`: path of its declaration, as `plants.NAME.rods`.
pub fn present_name(table: &str, key: &str) -> Option<&'static str> {
    RENAMED.iter().find(|(t, old, _)| *t == table && *old == key).map(|(.., new)| *new)
}

/// What a value must be changed by where the key was renamed together with its meaning.
pub fn changed_meaning(table: &str, key: &str) -> Option<&'static str> {
    (table == "sun" && key == "azimuth_deg")
        .then_some("subtract 90: directions of sun, wind and lean are counted from +X towards -Z")
}
