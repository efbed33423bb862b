//! `osier completions` and `osier man`: shell completions and the manual page.

use clap::CommandFactory as _;

use super::Context;
use super::args::{Cli, Completions};
use osier_base::{Error, Result};

/// Prints the completion script of the shell that the arguments name; the exit code is 0.
/// # Errors
/// `Io` if standard output cannot be written.
pub fn completions(context: &Context, args: &Completions) -> Result<u8> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "osier", &mut text);
    context.console.document(&String::from_utf8_lossy(&text))?;
    Ok(0)
}

/// Prints the manual page of the program, with its commands, their flags and the exit codes.
/// # Errors
/// `Io` if standard output cannot be written.
pub fn man(context: &Context) -> Result<u8> {
    let page = |e| Error::io("write", "the manual page", e);
    let command = Cli::command();
    let mut bytes = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut bytes).map_err(page)?;
    let mut text = String::from_utf8_lossy(&bytes).into_owned();
    // The list of commands would refer to pages of theirs; instead their flags follow in sections of this page.
    for sub in command.get_subcommands() {
        let name = sub.get_name();
        text = text.replace(&format!("osier\\-{name}(1)"), &format!("osier {name}"));
        let mut options = Vec::new();
        clap_mangen::Man::new(sub.clone()).render_options_section(&mut options).map_err(page)?;
        text += &command_section(name, &String::from_utf8_lossy(&options));
    }
    context.console.document(&text)?;
    Ok(0)
}

/// The section of a command, made of the section of options of a page of its own.
fn command_section(name: &str, options: &str) -> String {
    // The preamble stands at the top of the page already.
    let lines: Vec<&str> = options.lines().filter(|l| !l.starts_with(".ie ") && !l.starts_with(".el ")).collect();
    let body = lines.join("\n").replacen(".SH OPTIONS\n", "", 1);
    format!(".SH \"OSIER {}\"\n{body}\n", name.to_uppercase())
}
