//! Material libraries and the pictures they name.

use std::collections::BTreeMap;
use std::path::Path;

use super::lines::{Word, lines, plain, rest, words};
use super::{Checked, Complaint, text};
use crate::pictures::{self, Raw};
use crate::{Job, Outcome};
use osier_base::files::{Names, ReadError, number};
use osier_scene::{Image, ImageKind, Material};

/// Maps that are read.
const MAPS: [&str; 3] = ["map_Kd", "map_d", "norm"];

/// All libraries of a file, checked, with the pictures that they name.
#[derive(Default)]
pub(super) struct Library {
    /// Their texts, one after the other.
    pub(super) text: String,
    /// Name and bytes of pictures by material and map.
    pictures: BTreeMap<(String, &'static str), (String, Vec<u8>)>,
    /// Bytes of pictures held.
    held: u64,
}

impl Library {
    /// Reads the libraries named by `mtllib` lines of `checked`; complaints go into the report.
    pub(super) fn read(job: &mut Job<'_>, checked: &mut Checked<'_>, names: &[(String, usize)]) -> Self {
        let mut library = Self::default();
        for (name, start) in names {
            let spent = library.text.len() as u64;
            let limit = job.options.limits.get("text-bytes").saturating_sub(spent);
            let read = |reference: &str| job.options.roots.read(job.path, reference, limit);
            let found = match read(name) {
                // One line may name several libraries.
                Err(ReadError::Missing { .. }) if name.contains(' ') => name.split_whitespace().map(read).collect(),
                one => vec![one],
            };
            for result in found {
                match result {
                    Ok(file) => {
                        job.note(&file);
                        library.add(job, &file.path, &file.bytes);
                    }
                    Err(refusal) => checked.refuse(job, Word { text: name, start: *start }, &refusal),
                }
            }
        }
        library
    }

    fn add(&mut self, job: &mut Job<'_>, path: &Path, bytes: &[u8]) {
        // The file's own name suffices beside the name of the mesh, and keeps folders of the machine out of reports.
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some(text) = text(job, &name, bytes) else { return };
        let plain = plain(&text);
        let mut checked = Checked::new(&name, &text);
        let mut material = String::new();
        for (start, line) in lines(&plain) {
            let mut words = words(start, line);
            let Some(key) = words.next() else { continue };
            let rest = rest(start, line);
            if let Err(complaint) = check(key, words, rest) {
                checked.complain(job, complaint);
                continue;
            }
            if key.text == "newmtl" {
                rest.text.clone_into(&mut material);
            }
            let Some(map) = MAPS.into_iter().find(|m| *m == key.text) else { continue };
            let word = file_of(rest);
            let limit = job.options.limits.get("mesh-bytes").saturating_sub(self.held);
            match job.options.roots.read(path, word.text, limit) {
                Ok(file) => {
                    job.note(&file);
                    self.held += file.bytes.len() as u64;
                    self.pictures.insert((material.clone(), map), (word.text.to_owned(), file.bytes));
                }
                Err(refusal) => checked.refuse(job, word, &refusal),
            }
        }
        self.text.push_str(&plain);
        self.text.push('\n');
    }
}

/// Checks one line.
fn check<'a>(key: Word<'a>, words: impl Iterator<Item = Word<'a>>, rest: Word<'_>) -> Result<(), Complaint> {
    let due = match key.text {
        "Ka" | "Kd" | "Ks" | "Ke" => 3,
        "Ns" | "Ni" | "d" => 1,
        "newmtl" | "map_Kd" | "map_Ka" | "map_Ks" | "map_Ns" | "map_ns" | "map_NS" | "map_d" | "map_Bump"
        | "map_bump" | "bump" | "norm" | "illum"
            if rest.text.is_empty() =>
        {
            return Err(key.complaint("a name or value is missing", "add it, or remove the line"));
        }
        "illum" if rest.text.parse::<u8>().is_err() => {
            return Err(rest.complaint("expected a number from 0 to 10", "remove the line; it is not used"));
        }
        _ => return Ok(()),
    };
    let mut n = 0;
    for word in words.take(due) {
        word.number()?;
        n += 1;
    }
    if n == due {
        Ok(())
    } else {
        Err(key.complaint(format!("{:?} needs {due} numbers, {n} follow", key.text), "add the missing numbers"))
    }
}

/// Materials and pictures in the order in which the mesh uses them.
pub(super) struct Surfaces<'l> {
    library: &'l Library,
    given: Vec<tobj::Material>,
    names: Names,
    spent: u64,
    made: Vec<Material>,
    /// Index of a material by its number in the file.
    known: BTreeMap<Option<usize>, usize>,
    images: Vec<Image>,
    stem: String,
}

impl<'l> Surfaces<'l> {
    pub(super) fn new(job: &Job<'_>, library: &'l Library, given: Vec<tobj::Material>) -> Self {
        let stem = job.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Self {
            library,
            given,
            names: Names::default(),
            spent: 0,
            made: Vec::new(),
            known: BTreeMap::new(),
            images: Vec::new(),
            stem,
        }
    }

    /// Index of the material that `tobj` numbers `id` (none: a grey one named after the file). Without a colour of its own it
    /// is white under `colored` vertices.
    pub(super) fn of(&mut self, job: &mut Job<'_>, id: Option<usize>, colored: bool) -> Outcome<u32> {
        let index = match self.known.get(&id).copied() {
            Some(index) => index,
            None => {
                let given = id.and_then(|i| self.given.get(i)).cloned();
                let name = self.names.unique(given.as_ref().map_or(&self.stem, |g| &g.name));
                let mut material = job.material(&name);
                if let Some(given) = given {
                    self.fill(job, &given, &mut material)?;
                }
                self.made.push(material);
                self.known.insert(id, self.made.len() - 1);
                self.made.len() - 1
            }
        };
        let given = id.and_then(|i| self.given.get(i)).is_some_and(|g| g.diffuse.is_some());
        if colored && !given {
            self.made[index].base_color = [1.0; 3];
        }
        Ok(u32::try_from(index).unwrap_or(u32::MAX))
    }

    fn fill(&mut self, job: &mut Job<'_>, given: &tobj::Material, material: &mut Material) -> Outcome<()> {
        if let Some(kd) = given.diffuse {
            material.base_color = kd.map(|c| c.clamp(0.0, 1.0));
        }
        // Blinn-Phong exponent to GGX roughness: alpha^2 = 2 / (n + 2), alpha = roughness^2.
        if let Some(n) = given.shininess {
            let alpha = (2.0 / (n.max(0.0) + 2.0)).sqrt();
            material.roughness = alpha.sqrt().clamp(0.05, 1.0);
        }
        material.ior = given.optical_density.filter(|n| (1.0..=3.0).contains(n)).unwrap_or(material.ior);
        let mut color = self.picture(job, given, "map_Kd")?;
        if let Some(mask) = self.picture(job, given, "map_d")? {
            let mask = if mask.has_holes() { mask.channel(3, 255) } else { mask.channel(0, 255) };
            let joined = color.as_ref().and_then(|c| c.with_alpha(&mask));
            if joined.is_none() {
                let name = &given.name;
                job.warn(
                    "X016",
                    format_args!("material {name:?}: map_d needs a map_Kd of the same size; it is left out"),
                );
            }
            color = joined.or(color);
        }
        let normal = self.picture(job, given, "norm")?;
        if let Some(color) = color {
            material.alpha_cutoff = color.has_holes().then_some(0.5);
            material.maps.color = Some(self.keep(color, format!("{}_color", material.name), ImageKind::Color));
        }
        if let Some(normal) = normal.filter(|n| n.channels >= 3) {
            material.maps.normal = Some(self.keep(normal, format!("{}_normal", material.name), ImageKind::Data));
        }
        Ok(())
    }

    fn keep(&mut self, raw: Raw, name: String, kind: ImageKind) -> u32 {
        self.images.push(raw.into_image(name, kind));
        u32::try_from(self.images.len() - 1).unwrap_or(u32::MAX)
    }

    /// The picture of one of a material's maps.
    fn picture(&mut self, job: &Job<'_>, of: &tobj::Material, map: &'static str) -> Outcome<Option<Raw>> {
        let Some((name, bytes)) = self.library.pictures.get(&(of.name.clone(), map)) else { return Ok(None) };
        pictures::decode(job, &format!("{name:?}"), bytes, &mut self.spent).map(Some)
    }

    pub(super) fn finish(self) -> (Vec<Material>, Vec<Image>) {
        (self.made, self.images)
    }
}

/// The file name at the end of a map line: what follows the options.
fn file_of(line: Word<'_>) -> Word<'_> {
    let mut rest = line.text.trim();
    while rest.starts_with('-') {
        let (option, mut after) = rest.split_once(' ').unwrap_or((rest, ""));
        let (least, most) = match option {
            "-o" | "-s" | "-t" => (1, 3),
            "-mm" => (2, 2),
            _ => (1, 1),
        };
        for n in 0..most {
            let (word, tail) = after.trim_start().split_once(' ').unwrap_or((after, ""));
            if n >= least && number(word).is_err() {
                break;
            }
            after = tail;
        }
        rest = after.trim_start();
    }
    Word { text: rest, start: line.start + line.text.trim_end().len() - rest.len() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_before_a_file_name_are_skipped() {
        for line in ["a b.png", "-clamp on a b.png", "-s 1 1 1 -o 0.5 a b.png", "-mm 0 1 -bm 0.2 a b.png"] {
            let word = file_of(Word { text: line, start: 10 });
            assert_eq!((word.text, word.start), ("a b.png", 10 + line.len() - 7), "{line}");
        }
        assert_eq!(file_of(Word { text: "-s", start: 0 }).text, "");
    }
}
