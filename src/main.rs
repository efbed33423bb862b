//! The `osier` program: arguments in, exit code out.

fn main() -> std::process::ExitCode {
    osier::cli::main()
}
