//! `osier convert`: a grammar of another program in the notation of cpfg.

use std::path::Path;

use serde_json::{Value, json};

use super::args::{Convert, ConvertArg};
use super::{Context, unreadable_name};
use crate::recipe::{Growth, resolve};
use crate::single_file::endings;
use crate::source::find_scene;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::files::{FileRecord, Folder, WriteOptions, folder_of, name_of};
use osier_grammar::{ConvertTo, Grammar, convert};

/// Runs `osier convert` on the first grammar of the source; the result is the exit code.
pub fn run(context: &Context, args: &Convert) -> Result<u8> {
    if let Some(why) = args.output.as_deref().and_then(unreadable_name) {
        context.console.complain(&why);
        return Ok(2);
    }
    if let Some(ending) = args.output.as_deref().and_then(foreign_ending) {
        let why = format!("a grammar is written as .l, not as .{ending}; `osier grow` writes plants");
        context.console.complain(&why);
        return Ok(2);
    }
    // The text has the parameters of the file, and draws its random numbers where it is grown.
    if let Some(flag) = context.scene_flag(&["--set", "--seed", "--rng"]) {
        let why = format!("{flag} does not change the text of a grammar; give it to `osier grow` or set it in a scene");
        context.console.complain(&why);
        return Ok(2);
    }
    // Read the source, and convert its first grammar.
    let (recipe, warnings) = resolve(&find_scene(&args.file, &context.sources)?)?;
    context.console.report(&warnings);
    let mut grammars =
        recipe.plants.iter().filter_map(|p| if let Growth::Grammar(g) = &p.growth { Some((&p.name, g)) } else { None });
    let Some((plant, grammar)) = grammars.next() else {
        let message = format!("\"{}\" holds no grammar", args.file);
        return Err(Diagnostic::about("S001", message).help("name a grammar: osier convert curves.l#Koch1").into());
    };
    let to = if args.to == ConvertArg::Cpfg { ConvertTo::Cpfg } else { ConvertTo::Osier };
    let mut converted = convert(grammar, to)?;
    // Plants may share a grammar: those with another text are left out.
    let is_other = |g: &Grammar| !convert(g, to).is_ok_and(|other| other.text == converted.text);
    let others: Vec<String> = grammars.filter(|(_, g)| is_other(g)).map(|(name, _)| format!("\"{name}\"")).collect();
    if !others.is_empty() {
        let others = others.join(", ");
        let note = format!("only the grammar of plant \"{plant}\" is converted; name the file of another: {others}");
        converted.notes.push(note);
    }
    for note in &converted.notes {
        context.console.note(note);
    }
    let warned = !warnings.diagnostics.is_empty() || !converted.notes.is_empty();
    // Without a file the text goes to standard output.
    let Some(output) = args.output.as_deref().filter(|path| *path != Path::new("-")) else {
        if context.console.json {
            let value = json!({ "text": converted.text, "notes": converted.notes });
            context.console.result(&format!("{value:#}\n"))?;
        } else {
            context.console.document(&converted.text)?;
        }
        return Ok(context.strict(warned));
    };
    let path = output.display().to_string();
    // A dry run names the file that would be written.
    let files = if context.common.dry_run {
        let blake3 = blake3::hash(converted.text.as_bytes()).to_hex().to_string();
        vec![FileRecord {
            path: path.clone(),
            kind: "grammar",
            frame: None,
            bytes: converted.text.len() as u64,
            blake3,
        }]
    } else {
        write(context, args, output, &converted.text)?
    };
    if context.console.json {
        let row = |f: &FileRecord| json!({ "path": path, "kind": f.kind, "bytes": f.bytes, "blake3": f.blake3 });
        let files: Vec<Value> = files.iter().map(row).collect();
        let value = json!({ "files": files, "notes": converted.notes });
        context.console.result(&format!("{value:#}\n"))?;
    } else if !context.console.quiet {
        context.console.result(&format!("{path}\n"))?;
    }
    Ok(context.strict(warned))
}

/// The ending of a scene or of a file that `osier grow` writes, by which a grammar would be taken for one.
fn foreign_ending(output: &Path) -> Option<String> {
    let ending = output.extension()?.to_string_lossy().to_ascii_lowercase();
    let is_foreign = ending == "toml" || endings().any(|(other, _)| other == ending && other != "txt");
    is_foreign.then_some(ending)
}

/// Writes the text of a grammar into a file, whose folder is made if it is missing; returns the record of the file.
fn write(context: &Context, args: &Convert, output: &Path, text: &str) -> Result<Vec<FileRecord>> {
    let options = WriteOptions { force: args.force, cancel: context.cancel.clone(), ..WriteOptions::default() };
    let folder = Folder::plain(folder_of(output), options)?;
    folder.write(&name_of(output), "grammar", text.as_bytes())?;
    folder.finish()?;
    Ok(folder.files())
}
