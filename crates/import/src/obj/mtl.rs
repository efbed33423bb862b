//! Material libraries (MTL) and the images that they name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::Vec2;

use super::tokens::{ObjToken, lines, plain, rest, tokens};
use super::{CheckedText, SyntaxError, text};
use crate::images::{self, DecodedImage};
use crate::{ImportContext, ImportResult, table_index};
use osier_base::files::{Names, ReadError, ReferencedFile, number};
use osier_base::math;
use osier_scene::{Image, ImageKind, Material};

/// Statements whose maps are read: base colour, alpha, normals.
const MAP_STATEMENTS: [&str; 3] = ["map_Kd", "map_d", "norm"];

/// All libraries of a file, checked, with the images that they name.
#[derive(Default)]
pub(super) struct MaterialLibraries {
    /// Their texts, one after the other.
    pub(super) text: String,
    /// Names of the materials that they describe.
    described: BTreeSet<String>,
    /// Name and bytes of images by material and statement.
    images: BTreeMap<(String, &'static str), (String, Vec<u8>)>,
    /// Where the maps of a material lie, by its name; absent without maps.
    placements: BTreeMap<String, MapPlacement>,
    /// Bytes of `images` together, which the limit `mesh-bytes` bounds.
    image_bytes: u64,
}

impl MaterialLibraries {
    /// Reads the libraries named by `mtllib` lines of `checked`; errors and warnings go into the report.
    pub(super) fn read(
        context: &mut ImportContext<'_>,
        checked: &mut CheckedText<'_>,
        names: &[(String, usize)],
    ) -> Self {
        let mut library = Self::default();
        for (name, start) in names {
            let spent = library.text.len() as u64;
            let limit = context.options.limits.get("text-bytes").saturating_sub(spent);
            let read = |reference: &str| context.options.roots.read(context.path, reference, limit);
            let found = match read(name) {
                // One line may name several libraries.
                Err(ReadError::Missing { .. }) if name.contains(' ') => name.split_whitespace().map(read).collect(),
                one => vec![one],
            };
            for result in found {
                match result {
                    Ok(file) => {
                        context.add_referenced_file(&file);
                        library.add(context, &file.path, &file.bytes);
                    }
                    Err(error) => checked.report_unreadable(context, ObjToken { text: name, start: *start }, &error),
                }
            }
        }
        library
    }

    /// Adds an empty material for each of the names that no library describes, as happens when a library is missing:
    /// leaves are identified by the names of their materials.
    pub(super) fn add_undescribed(&mut self, names: &BTreeSet<String>) {
        for name in names.iter().filter(|name| !self.described.contains(*name)) {
            self.text.push_str("newmtl ");
            self.text.push_str(name);
            self.text.push('\n');
        }
    }

    /// Checks a library and reads the images that it names.
    fn add(&mut self, context: &mut ImportContext<'_>, path: &Path, bytes: &[u8]) {
        // Messages name the library by its file name alone, which suffices next to the name of the mesh and does not reveal local
        // folders.
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some(text) = text(context, &name, bytes) else { return };
        let plain = plain(&text);
        let mut read = plain.clone();
        let mut checked = CheckedText::new(&name, &text);
        let mut material = String::new();
        for (start, line) in lines(&plain) {
            let mut tokens = tokens(start, line);
            let Some(key) = tokens.next() else { continue };
            let rest = rest(start, line);
            if let Some(warning) = unread_form(key, rest) {
                checked.report(context, warning);
                // Because of this line `tobj` would refuse the whole library: overwrite it with as many blanks.
                read.replace_range(start..start + line.len(), &" ".repeat(line.len()));
                continue;
            }
            if let Err(syntax_error) = check_line(key, tokens, rest) {
                checked.report(context, syntax_error);
                continue;
            }
            if let Some(warning) = unread_map(key) {
                checked.report(context, warning);
            }
            // The lines up to the next `newmtl` describe this material.
            if key.text == "newmtl" {
                rest.text.clone_into(&mut material);
                self.described.insert(material.clone());
            }
            let Some(map) = MAP_STATEMENTS.into_iter().find(|m| *m == key.text) else { continue };
            // A mesh has one set of texture coordinates, so the first map of a material determines them.
            let placement = MapPlacement::of(rest.text);
            if *self.placements.entry(material.clone()).or_insert(placement) != placement {
                let message =
                    format!("the options -s and -o of {:?} differ from those of the material's first map", key.text);
                let help = "the first map's are used for all; give all maps of a material the same";
                checked.report(context, SyntaxError { code: "X016", ..key.syntax_error(message, help) });
            }
            let token = map_file(rest);
            let limit = context.options.limits.get("mesh-bytes").saturating_sub(self.image_bytes);
            match read_picture(context, path, token, limit) {
                Ok((file, warning)) => {
                    if let Some(warning) = warning {
                        checked.report(context, warning);
                    }
                    context.add_referenced_file(&file);
                    self.image_bytes += file.bytes.len() as u64;
                    self.images.insert((material.clone(), map), (token.text.to_owned(), file.bytes));
                }
                Err(error @ ReadError::Spelling { .. }) => {
                    let help = "put the picture beside this file, or write its path relative to this file, with '/'";
                    let error = SyntaxError { code: error.code(), ..token.syntax_error(error.to_string(), help) };
                    checked.report(context, SyntaxError { label: "named here".into(), ..error });
                }
                Err(error) => checked.report_unreadable(context, token, &error),
            }
        }
        self.text.push_str(&read);
        self.text.push('\n');
    }
}

/// Reads the picture that a map names. Blender writes absolute paths to pictures in other folders. If such a path is
/// refused, a picture of the same name beside the library or in a search folder is read instead, with a warning.
/// # Errors
/// The error of the path as it is written.
fn read_picture(
    context: &ImportContext<'_>,
    library: &Path,
    token: ObjToken<'_>,
    limit: u64,
) -> Result<(ReferencedFile, Option<SyntaxError>), ReadError> {
    let error = match context.options.roots.read(library, token.text, limit) {
        Ok(file) => return Ok((file, None)),
        Err(error) => error,
    };
    let name = token.text.rsplit(['/', '\\']).next().unwrap_or_default();
    if !matches!(error, ReadError::Spelling { .. }) || name == token.text {
        return Err(error);
    }
    match context.options.roots.read(library, name, limit) {
        Ok(file) => {
            let message = format!("the folder of this picture is left out: {name:?} is read from beside this file");
            let help = "write its path relative to this file, with '/'";
            Ok((file, Some(SyntaxError { code: "X016", ..token.syntax_error(message, help) })))
        }
        Err(_) => Err(error),
    }
}

/// The warning about a line whose form is not supported: a colour as a spectral curve or in CIE XYZ, an opacity with a
/// halo.
fn unread_form(key: ObjToken<'_>, rest: ObjToken<'_>) -> Option<SyntaxError> {
    let form = rest.text.split_whitespace().next()?;
    let (is_unread, help) = match key.text {
        "Ka" | "Kd" | "Ks" | "Ke" => {
            (matches!(form, "spectral" | "xyz"), "write the colour as three numbers, red, green and blue")
        }
        "d" => (form == "-halo", "write the opacity as one number"),
        _ => return None,
    };
    let message = format!("\"{} {form}\" is not read; the line is left out", key.text);
    is_unread.then(|| SyntaxError { code: "X016", ..key.syntax_error(message, help) })
}

/// The warning about a map that is not read, although a material has the property that it describes.
fn unread_map(key: ObjToken<'_>) -> Option<SyntaxError> {
    let (message, help) = match key.text {
        "map_Bump" | "map_bump" | "bump" => {
            (format!("{:?} is not read", key.text), "write \"norm\" if the picture holds normals in tangent space")
        }
        "map_Pr" | "map_Ns" | "map_ns" | "map_NS" => (
            format!("{:?} is not read; the roughness is that of Ns or Pr", key.text),
            "export the mesh as glTF to keep the picture",
        ),
        _ => return None,
    };
    Some(SyntaxError { code: "X016", ..key.syntax_error(message, help) })
}

/// Where the maps of a material lie on a mesh: texture coordinates times `scale` plus `offset`, the options `-s` and `-o` of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MapPlacement {
    scale: Vec2,
    offset: Vec2,
}

impl MapPlacement {
    /// Maps that lie as the texture coordinates say, without scale and offset.
    const UNCHANGED: Self = Self { scale: Vec2::ONE, offset: Vec2::ZERO };

    /// Parses the options before the file name of a map line; up to three numbers follow each, the third for solid
    /// textures.
    fn of(options: &str) -> Self {
        let (mut scale, mut offset) = ([1.0, 1.0], [0.0, 0.0]);
        let (mut option, mut next) = ("", 0);
        for word in options.split_whitespace() {
            match (option, number(word)) {
                (_, Err(_)) => (option, next) = (word, 0),
                ("-s" | "-o", Ok(value)) => {
                    let numbers = if option == "-s" { &mut scale } else { &mut offset };
                    if let Some(slot) = numbers.get_mut(next) {
                        *slot = math::narrow(value);
                    }
                    next += 1;
                }
                _ => {}
            }
        }
        Self { scale: Vec2::from_array(scale), offset: Vec2::from_array(offset) }
    }

    /// Texture coordinates of a mesh at which the maps lie as they should.
    pub(super) fn apply(self, uv: Vec2) -> Vec2 {
        if self == Self::UNCHANGED { uv } else { uv * self.scale + self.offset }
    }
}

/// Checks a line: numbers are finite and as many as the statement needs, names are present.
fn check_line<'a>(
    key: ObjToken<'a>,
    tokens: impl Iterator<Item = ObjToken<'a>>,
    rest: ObjToken<'_>,
) -> Result<(), SyntaxError> {
    let required_numbers = match key.text {
        "Ka" | "Kd" | "Ks" | "Ke" => 3,
        "Ns" | "Ni" | "d" | "Pr" => 1,
        // Names reach to the end of the line, as they may contain blanks.
        "newmtl" | "map_Kd" | "map_Ka" | "map_Ks" | "map_Ns" | "map_ns" | "map_NS" | "map_d" | "map_Bump"
        | "map_bump" | "bump" | "norm" | "illum"
            if rest.text.is_empty() =>
        {
            return Err(key.syntax_error("a name or value is missing", "add it, or remove the line"));
        }
        // `tobj` parses this number too, and its error would have no place.
        "illum" if rest.text.parse::<u8>().is_err() => {
            return Err(rest.syntax_error("expected a number from 0 to 10", "remove the line; it is not used"));
        }
        _ => return Ok(()),
    };
    let mut n = 0;
    for token in tokens.take(required_numbers) {
        token.number()?;
        n += 1;
    }
    if n == required_numbers {
        Ok(())
    } else {
        Err(key.syntax_error(
            format!("{:?} needs {required_numbers} numbers, {n} follow", key.text),
            "add the missing numbers",
        ))
    }
}

/// Materials and images in the order in which the mesh uses them.
pub(super) struct ObjMaterials<'l> {
    library: &'l MaterialLibraries,
    given: Vec<tobj::Material>,
    names: Names,
    spent: u64,
    materials: Vec<Material>,
    /// Index of a material by its number in the file.
    index_of: BTreeMap<Option<usize>, usize>,
    images: Vec<Image>,
    stem: String,
}

impl<'l> ObjMaterials<'l> {
    pub(super) fn new(context: &ImportContext<'_>, library: &'l MaterialLibraries, given: Vec<tobj::Material>) -> Self {
        let stem = context.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Self {
            library,
            given,
            names: Names::default(),
            spent: 0,
            materials: Vec::new(),
            index_of: BTreeMap::new(),
            images: Vec::new(),
            stem,
        }
    }

    /// Index of the material that `tobj` numbers `id` (none: a grey one named after the file). A material without a colour is
    /// white under `colored` vertices.
    pub(super) fn material_index(
        &mut self,
        context: &mut ImportContext<'_>,
        id: Option<usize>,
        colored: bool,
    ) -> ImportResult<u32> {
        // Materials are converted when the first mesh uses them, so that unused ones do not appear.
        let index = match self.index_of.get(&id).copied() {
            Some(index) => index,
            None => {
                let given = id.and_then(|i| self.given.get(i)).cloned();
                let name = self.names.unique(given.as_ref().map_or(&self.stem, |g| &g.name));
                let mut material = context.material(&name);
                if let Some(given) = given {
                    self.convert_material(context, &given, &mut material)?;
                }
                self.materials.push(material);
                self.index_of.insert(id, self.materials.len() - 1);
                self.materials.len() - 1
            }
        };
        // The grey of a material without a colour must not darken the colours of vertices.
        let given = id.and_then(|i| self.given.get(i)).is_some_and(|g| g.diffuse.is_some());
        if colored && !given {
            self.materials[index].base_color = [1.0; 3];
        }
        Ok(table_index(index))
    }

    /// Where the maps of the material that `tobj` numbers `id` lie.
    pub(super) fn placement(&self, id: Option<usize>) -> MapPlacement {
        let given = id.and_then(|i| self.given.get(i)).and_then(|g| self.library.placements.get(&g.name));
        given.copied().unwrap_or(MapPlacement::UNCHANGED)
    }

    /// Sets a material's values and maps from those of `tobj`.
    fn convert_material(
        &mut self,
        context: &mut ImportContext<'_>,
        given: &tobj::Material,
        material: &mut Material,
    ) -> ImportResult<()> {
        if let Some(kd) = given.diffuse {
            material.base_color = kd.map(|c| c.clamp(0.0, 1.0));
        }
        // Ns = 1000 (1 - roughness)^2, as Blender and osier itself write it.
        if let Some(n) = given.shininess {
            material.roughness = (1.0 - (n.clamp(0.0, 1000.0) / 1000.0).sqrt()).clamp(0.05, 1.0);
        }
        // The roughness itself, which Blender and other programs write in place of Ns or beside it.
        if let Some(roughness) = given.unknown_param.get("Pr").and_then(|p| number(p.split_whitespace().next()?).ok()) {
            material.roughness = math::narrow(roughness.clamp(0.0, 1.0));
        }
        // Exporters also write values that are no index of refraction, such as 0.
        material.ior = given.optical_density.filter(|n| (1.0..=3.0).contains(n)).unwrap_or(material.ior);
        let mut color = self.decode_map(context, given, "map_Kd")?;
        if let Some(mask) = self.decode_map(context, given, "map_d")? {
            // The mask is the alpha of an image that has one, else its grey.
            let mask = if mask.has_transparency() { mask.channel(3, 255) } else { mask.channel(0, 255) };
            let joined = color.as_ref().and_then(|c| c.with_alpha(&mask));
            if joined.is_none() {
                let name = &given.name;
                context.warn(
                    "X016",
                    format_args!("material {name:?}: map_d needs a map_Kd of the same size; it is left out"),
                );
            }
            color = joined.or(color);
        }
        let normal = self.decode_map(context, given, "norm")?;
        if let Some(color) = color {
            material.alpha_cutoff = color.has_transparency().then_some(0.5);
            material.maps.color = Some(self.store_map(color, format!("{}_color", material.name), ImageKind::Color));
            // The picture replaces the colour of the material, which does not tint it.
            material.base_color = [1.0; 3];
        }
        // A grey image holds no normals.
        if let Some(normal) = normal.filter(|n| n.channels >= 3) {
            material.maps.normal = Some(self.store_map(normal, format!("{}_normal", material.name), ImageKind::Data));
        }
        Ok(())
    }

    fn store_map(&mut self, raw: DecodedImage, name: String, kind: ImageKind) -> u32 {
        self.images.push(raw.into_image(name, kind));
        table_index(self.images.len() - 1)
    }

    /// Decodes the image of one of a material's maps; `None` if the library has none for it.
    fn decode_map(
        &mut self,
        context: &ImportContext<'_>,
        material: &tobj::Material,
        map: &'static str,
    ) -> ImportResult<Option<DecodedImage>> {
        let Some((name, bytes)) = self.library.images.get(&(material.name.clone(), map)) else { return Ok(None) };
        images::decode(context, &format!("{name:?}"), bytes, &mut self.spent).map(Some)
    }

    pub(super) fn finish(self) -> (Vec<Material>, Vec<Image>) {
        (self.materials, self.images)
    }
}

/// The file name at the end of a map line: what follows the options.
fn map_file(line: ObjToken<'_>) -> ObjToken<'_> {
    let mut rest = line.text.trim();
    while rest.starts_with('-') {
        let (option, mut after) = rest.split_once(' ').unwrap_or((rest, ""));
        let (least, most) = match option {
            // u, and optionally v and w: a word that is not a number begins the file name.
            "-o" | "-s" | "-t" => (1, 3),
            // Base and gain of a colour map: always two numbers.
            "-mm" => (2, 2),
            _ => (1, 1),
        };
        for n in 0..most {
            let (token, tail) = after.trim_start().split_once(' ').unwrap_or((after, ""));
            if n >= least && number(token).is_err() {
                break;
            }
            after = tail;
        }
        rest = after.trim_start();
    }
    ObjToken { text: rest, start: line.start + line.text.trim_end().len() - rest.len() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_place_a_map() {
        let at = |options: &str| MapPlacement::of(options).apply(Vec2::new(0.5, 0.25));
        for (options, u, v) in [
            ("a.png", 0.5, 0.25),
            ("-s 4 2 1 a.png", 2.0, 0.5),
            ("-s 2 4.png", 1.0, 0.25),
            ("-clamp on -o 0.5 a 4.png", 1.0, 0.25),
            ("-bm 0.2 -s 2 2 2 -o 1 -1 0 4.png", 2.0, -0.5),
        ] {
            assert_eq!(at(options), Vec2::new(u, v), "{options}");
        }
    }

    #[test]
    fn options_before_a_file_name_are_skipped() {
        for line in ["a b.png", "-clamp on a b.png", "-s 1 1 1 -o 0.5 a b.png", "-mm 0 1 -bm 0.2 a b.png"] {
            let token = map_file(ObjToken { text: line, start: 10 });
            assert_eq!((token.text, token.start), ("a b.png", 10 + line.len() - 7), "{line}");
        }
        assert_eq!(map_file(ObjToken { text: "-s", start: 0 }).text, "");
    }
}
