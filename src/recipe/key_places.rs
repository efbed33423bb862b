//! Places of a scene's keys, for what is found after the scene was read: while it is assembled and simulated.

use super::syntax::{TomlTable, TomlValue};
use osier_base::Error;
use osier_base::diagnostic::{Diagnostic, Report, Sources, Span};

/// The text of a scene and of its overrides, with the place of each key that they set.
#[derive(Debug, Clone, Default)]
pub struct KeyPlaces {
    sources: Sources,
    root: TomlTable,
}

/// Place of a key, or of the innermost table around it that the scene has.
struct NearestPlace {
    span: Span,
    is_key: bool,
}

impl KeyPlaces {
    /// Looks up places of keys below the root table `root`. `sources`: the texts into which its spans point.
    pub(in crate::recipe) fn new(sources: &Sources, root: &TomlTable) -> Self {
        Self { sources: sources.clone(), root: root.clone() }
    }

    /// Whether the scene or an override sets the key of this path, such as `rain.max_drop_meshes`.
    pub fn sets(&self, path: &str) -> bool {
        self.nearest(path).is_some_and(|place| place.is_key)
    }

    /// A report of one diagnostic with the place of a key; `label` stands under the key. Without the key it is the place of the table
    /// around it, and without that the diagnostic has no place. `path`: of the key, entries of lists by their numbers:
    /// `rain.lying.0.leaf`.
    pub fn report_at(&self, path: &str, diagnostic: Diagnostic, label: &str) -> Report {
        let mut report = Report::default();
        match self.nearest(path) {
            Some(place) => {
                report.sources = self.sources.clone();
                report.push(diagnostic.label(place.span, label));
            }
            None => report.push(diagnostic),
        }
        report
    }

    /// The error for a limit that the value of a key exceeds, with its place (S004); any other error as it is.
    pub fn limit_at(&self, path: &str, error: Error) -> Error {
        match error {
            Error::Limit { .. } if self.nearest(path).is_some() => {
                let d = Diagnostic::about("S004", error.to_string());
                Error::Input(Box::new(self.report_at(path, d, "over the limit")))
            }
            other => other,
        }
    }

    fn nearest(&self, path: &str) -> Option<NearestPlace> {
        let mut table = &self.root;
        let mut found = None;
        let mut names = path.split('.').peekable();
        while let Some(name) = names.next() {
            let Some(entry) = table.get(name) else { break };
            let mut node = &entry.node;
            found = Some(NearestPlace { span: entry.key_span, is_key: names.peek().is_none() });
            // The number of an entry follows the name of its list.
            if let TomlValue::List(list) = &node.value
                && let Some(item) = names.peek().and_then(|number| list.get(number.parse::<usize>().ok()?))
            {
                names.next();
                node = item;
                found = Some(NearestPlace { span: item.span, is_key: names.peek().is_none() });
            }
            match &node.value {
                TomlValue::Table(inner) => table = inner,
                _ => {
                    // The value of the key itself, and not its name.
                    found = Some(NearestPlace { span: node.span, is_key: names.peek().is_none() });
                    break;
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::syntax::parse;

    const TEXT: &str = "[rain]\ntotal = 500\n[[rain.lying]]\nleaf = 1\n[[rain.lying]]\nleaf = 9\n";

    fn places() -> KeyPlaces {
        let mut report = Report::default();
        let source = report.sources.add("s.toml", TEXT);
        let root = parse(TEXT, source, &mut report);
        KeyPlaces::new(&report.sources, &root)
    }

    /// What a message about a key points at.
    fn shown(path: &str) -> Option<&'static str> {
        let report = places().report_at(path, Diagnostic::about("S004", "too many"), "here");
        let span = report.diagnostics[0].labels.first()?.0;
        Some(&TEXT[span.start as usize..span.end as usize])
    }

    #[test]
    fn keys_and_else_their_tables_have_places() {
        assert_eq!((shown("rain.total"), shown("rain.lying.1.leaf")), (Some("500"), Some("9")));
        assert_eq!((shown("rain.gravity"), shown("wind.speed")), (Some("rain"), None));
        assert!(places().sets("rain.lying.0.leaf") && !places().sets("rain.gravity") && !places().sets("rain.total.x"));
    }

    #[test]
    fn limits_have_the_place_of_the_key_that_exceeds_them() {
        let limits = osier_base::limits::Limits::default();
        let error = |wanted: u64| limits.check("frames", wanted, "the number of frames").expect_err("too many");
        let at = |path: &str| places().limit_at(path, error(u64::MAX));
        let (told, bare) = (at("rain.total").to_string(), at("wind.speed").to_string());
        assert!(told.contains("S004") && told.contains("s.toml:2:9") && told.contains("--max-frames"), "{told}");
        assert!(!bare.contains("S004") && bare.contains("--max-frames"), "{bare}");
    }
}
