//! `[clouds.NAME.morph]`: attractors that change with time.

use super::AttractorKeys;
use crate::recipe::AttractorRecipe;
use crate::recipe::resolve::{MorphTable, NamedTable, Resolver};
use crate::recipe::syntax::{
    ColorList, FileReference, OneOf, Reference, StringType, TomlNode, TomlTable, TomlValue, TurnList, join, number,
    wrong,
};
use crate::recipe::syntax::{choices, keys, recipe};
use osier_base::diagnostic::{Diagnostic, Span};
use osier_ifs::dynamics;
use osier_ifs::game::Extent;
use osier_ifs::morph::{self, Morph, MorphOptions};
use std::sync::Arc;

choices! {
    /// Interpolation parameter between two tables as a function of time.
    MorphEase {
        /// The parameter is linear in time.
        Linear = "linear",
        /// Zero speed at the tables, fastest between.
        Smooth = "smooth",
    }
    /// Point of each map that moves on a straight line.
    MorphShift {
        /// The translation b of each map.
        Straight = "straight",
        /// The fixed point of each map.
        FixedPoint = "fixed-point",
    }
    /// Interpolation of the maps' weights.
    MorphWeights {
        /// Weights are interpolated between tables.
        Follow = "follow",
        /// Weights of the first table are kept, so that every point keeps its address.
        Hold = "hold",
    }
}

keys! {
    /// Interpolates an attractor between tables over time. Rotations take the shortest path; all other parts are
    /// interpolated linearly.
    MorphKeys at "clouds.NAME.morph" {
        /// Interpolation in time between two tables.
        ease: MorphEase = "ease" OneOf(MorphEase::Linear);
        /// What is interpolated linearly: the translations of the maps ("straight") or their fixed points ("fixed-point").
        shift: MorphShift = "shift" OneOf(MorphShift::Straight);
        /// Whether weights are interpolated ("follow") or stay those of the first table ("hold").
        weights: MorphWeights = "weights" OneOf(MorphWeights::Follow);
    }
    /// A table at a time. Keys are in order of time; all tables have the same number of maps.
    MorphKeyframe at "clouds.NAME.morph.key" as list {
        /// The coefficient table.
        ifs: Option<Reference> = "ifs" FileReference(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" StringType("");
        /// Time from the first frame.
        at: f64 = "at" number(0.0, 0.0, 1e6, "s");
        /// Additional full rotations of the maps before this key.
        turns: Vec<f64> = "turns" TurnList;
        /// Colours at this time.
        colors: Vec<[f32; 3]> = "colors" ColorList;
    }
}

/// Number of intervals between two tables at whose ends contraction is checked. More would find shorter times without
/// attractor; each costs one analysis of the system.
const CONTRACTION_CHECKS: u32 = 8;

recipe! {
    /// Change of an attractor over time, from table to table.
    MorphRecipe {
        /// Modes of interpolation between tables.
        keys: MorphKeys;
        /// Keyframes in rising order of time, as in the scene.
        rows: Vec<MorphKeyframe>;
        derived {
            /// Interpolated system and probabilities at any time.
            morph: Arc<Morph>;
        }
    }
}

/// A keyframe whose table has been read, with spans for diagnostics.
struct Row {
    key: MorphKeyframe,
    cloud: AttractorRecipe,
    span: Span,
    /// Spans of its time, its table and its turns.
    at: Span,
    ifs: Span,
    turns: Span,
}

impl Resolver<'_> {
    /// Resolves an attractor with `morph`; `None` after an error. `of`, `cloud`, `keys`: name, table and keys of the attractor.
    pub(super) fn morph(
        &mut self,
        of: NamedTable<'_>,
        cloud: &TomlTable,
        table: MorphTable<'_>,
        keys: AttractorKeys,
    ) -> Option<AttractorRecipe> {
        let NamedTable { name, path, id } = of;
        let MorphTable { table, span } = table;
        let path = join(path, "morph");
        self.check_limit("cloud-points", u64::from(keys.points).saturating_mul(self.frames), Some(span));
        self.check_memory(
            &format!("clouds.{name}.points"),
            u64::from(keys.points),
            super::attractor::POINT,
            Some(span),
        );
        // Only errors from here on concern the morph; those of other tables must not end its checks.
        let reported = self.report.diagnostics.len();
        let morph = self.read_keys::<MorphKeys>(table, &path);
        self.report_unused_keys(cloud, &path);
        // Read every table, then check times and turns, then interpolate and check contraction in between.
        let rows = self.read_keyframes(name, &path, MorphTable { table, span }, &keys)?;
        self.check_keyframes_of_morph(&rows);
        if self.report.diagnostics.iter().skip(reported).any(|d| d.severity == osier_base::diagnostic::Severity::Error)
        {
            return None;
        }
        let made = self.interpolate_tables(&rows, &morph)?;
        self.check_contraction_between(&rows, &made)?;
        if let Some(k) = made.reweighted().filter(|_| morph.weights == MorphWeights::Follow)
            && let Some(row) = rows.get(k)
        {
            let text = "the weights change towards this table, so some points jump";
            let d = Diagnostic::warning("I072", text, row.ifs, "other weights than before");
            self.report.push(d.help("weights = \"hold\" keeps the first table's: then every point keeps its word"));
        }
        // One extent for the whole clip: the union over all keyframes. Between keyframes the attractor may exceed it.
        let mut all = rows.iter();
        let first = all.next()?.cloud.clone();
        let extent = all.fold(first.extent, |e, r| union(e, r.cloud.extent));
        let rows = rows.into_iter().map(|r| r.key).collect();
        let recipe = MorphRecipe { keys: morph, rows, morph: Arc::new(made) };
        Some(AttractorRecipe { name: name.into(), id, extent, keys, morph: Some(recipe), ..first })
    }

    /// Warns with S007 of keys of the attractor that a morph ignores.
    fn report_unused_keys(&mut self, cloud: &TomlTable, path: &str) {
        let others = [("ifs", "name it in the first key instead"), ("system", "name it in the first key instead")];
        for (name, help) in
            others.into_iter().chain([("voxel_mm", "voxels that contain a point would change with time")])
        {
            if let Some(entry) = cloud.get(name) {
                let text = format!("{name} has no effect with [{path}]");
                self.report.push(Diagnostic::warning("S007", text, entry.key_span, "has no effect").help(help));
            }
        }
    }

    fn read_keyframes(
        &mut self,
        name: &str,
        path: &str,
        morph: MorphTable<'_>,
        keys: &AttractorKeys,
    ) -> Option<Vec<Row>> {
        let MorphTable { table, span } = morph;
        let path = join(path, "key");
        let list = match table.get("key").map(|e| &e.node) {
            Some(TomlNode { value: TomlValue::List(list), .. }) => list.as_slice(),
            Some(node) => {
                self.report.push(*wrong(&path, node, &format!("a list: write [[{path}]]")));
                return None;
            }
            None => &[],
        };
        if list.len() < 2 {
            let d = Diagnostic::error("S006", format!("a morph of {} tables", list.len()), span, "two at least");
            let example = "key = [{ ifs = \"A.ifs\", at = 0 }, { ifs = \"B.ifs\", at = 2 }]";
            self.report.push(d.help(format!("write {example}; times are seconds")));
            return None;
        }
        let mut rows: Vec<Row> = Vec::new();
        // An error in a keyframe does not end the list, so that the errors of all are reported in one run.
        let mut whole = true;
        for (i, node) in list.iter().enumerate() {
            match self.read_keyframe(name, &format!("{path}.{i}"), node, keys, &rows) {
                Some(row) => rows.push(row),
                None => whole = false,
            }
        }
        whole.then_some(rows)
    }

    fn read_keyframe(
        &mut self,
        name: &str,
        path: &str,
        node: &TomlNode,
        keys: &AttractorKeys,
        known: &[Row],
    ) -> Option<Row> {
        let TomlValue::Table(table) = &node.value else {
            self.report.push(*wrong(path, node, "a table"));
            return None;
        };
        let key = self.read_keys::<MorphKeyframe>(table, path);
        // A value that is no file name has been reported.
        if key.ifs.is_none() && table.get("ifs").is_some() {
            return None;
        }
        let of = |name: &str| table.get(name).map_or(node.span, |e| e.node.span);
        let (at, ifs, turns) = (of("at"), of("ifs"), of("turns"));
        // A keyframe with the file and system of an earlier one does not read them again.
        let same = |r: &&Row| r.key.ifs.as_ref().map(|r| &r.text) == key.ifs.as_ref().map(|r| &r.text);
        let again = known.iter().find(|r| same(r) && r.key.system == key.system);
        let cloud = match again {
            Some(row) => row.cloud.clone(),
            None => {
                // All tables share the points and colours of the cloud; only table and system differ.
                let keys = AttractorKeys { ifs: key.ifs.clone(), system: key.system.clone(), ..keys.clone() };
                self.attractor(NamedTable { name, path, id: String::new() }, node.span, keys)?
            }
        };
        Some(Row { key, cloud, span: node.span, at, ifs, turns })
    }

    fn check_keyframes_of_morph(&mut self, rows: &[Row]) {
        for pair in rows.windows(2) {
            let [a, b] = [pair[0].key.at, pair[1].key.at];
            if b <= a {
                let text = format!("this table's time is {b} s, the one before it has {a} s");
                let d = Diagnostic::error("S004", text, pair[1].at, "must be later");
                self.report.push(d.help("times rise from table to table"));
            }
        }
        for row in rows {
            // An empty list means no turns, one number applies to every map.
            let (n, m) = (row.key.turns.len(), row.cloud.system.maps.len());
            if n > 1 && n != m {
                let text = format!("{n} numbers of turns for {m} maps");
                let d = Diagnostic::error("I070", text, row.turns, format!("{m} are due"));
                self.report.push(d.help("give one number for all maps, or one per map"));
            }
        }
    }

    fn interpolate_tables(&mut self, rows: &[Row], keys: &MorphKeys) -> Option<Morph> {
        let options = MorphOptions {
            smooth: keys.ease == MorphEase::Smooth,
            fixed_points: keys.shift == MorphShift::FixedPoint,
            hold_weights: keys.weights == MorphWeights::Hold,
        };
        let key = |r: &Row| {
            let (system, study) = (r.cloud.system.clone(), r.cloud.study.clone());
            let turns = match r.key.turns.as_slice() {
                [all] => vec![*all; system.maps.len()],
                each => each.to_vec(),
            };
            morph::MorphKey { at: r.key.at, system, study, turns }
        };
        match Morph::new(rows.iter().map(key).collect(), options) {
            Ok(morph) => Some(morph),
            Err(fault) => {
                let span = rows.get(fault.key).map_or(rows[0].span, |r| r.ifs);
                self.report.push(Diagnostic::error(fault.code, fault.message, span, "this table").help(fault.help));
                None
            }
        }
    }

    /// Reports I021 if the system does not contract between two keyframes. Only intervals with a map of norm 1 or more at an
    /// end are checked.
    fn check_contraction_between(&mut self, rows: &[Row], morph: &Morph) -> Option<()> {
        let stretches = |r: &Row| r.cloud.system.maps.iter().any(|m| m.affine.norm() >= 1.0);
        for pair in rows.windows(2).filter(|p| p.iter().any(stretches)) {
            let [a, b] = [pair[0].key.at, pair[1].key.at];
            // Maps with norms below 1 at both tables stay below 1 under linear interpolation; others are checked in between.
            for i in 1..CONTRACTION_CHECKS {
                let at = a + (b - a) * f64::from(i) / f64::from(CONTRACTION_CHECKS);
                let shares = morph.study(at).probabilities;
                let mut system = morph.system(at);
                // The analysis takes weights as they are; the interpolated ones are already probabilities.
                for (map, p) in system.maps.iter_mut().zip(shares) {
                    map.weight = Some(p);
                }
                let study = dynamics::study(&system, osier_ifs::weights::WeightRule::Raw);
                if study.diagnostics.iter().any(|d| d.code == "I021") {
                    let text = format!("at {at:.2} s the system does not contract: there is no attractor between");
                    let d = Diagnostic::error("I021", text, pair[1].ifs, "on the way to this table");
                    self.report.push(d.help("keep the norms of all maps below 1, or put a table between"));
                    return None;
                }
            }
        }
        Some(())
    }
}

fn union(a: Extent, b: Extent) -> Extent {
    let both = |a: (glam::DVec3, glam::DVec3), b: (glam::DVec3, glam::DVec3)| (a.0.min(b.0), a.1.max(b.1));
    Extent { bounds: both(a.bounds, b.bounds), quantile: both(a.quantile, b.quantile) }
}
