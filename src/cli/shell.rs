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
    let mut text = Vec::new();
    let page = |e| Error::io("write", "the manual page", e);
    clap_mangen::Man::new(Cli::command()).render(&mut text).map_err(page)?;
    context.console.document(&String::from_utf8_lossy(&text))?;
    Ok(0)
}
