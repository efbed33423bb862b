//! Limits on the memory, work and output that a hostile or mistaken file may cause, checked before memory is allocated.

use crate::{Error, Result};

/// A row of [`LIMITS`]: one bound on the memory, work or output of a command.
#[derive(Debug, Clone, Copy)]
pub struct Limit {
    /// NAME of the flag `--max-NAME` and of [`Limits::get`].
    pub name: &'static str,
    /// Value in force unless the user sets another.
    pub default: u64,
    /// The counted quantity, in the plural, as `osier list limits` prints it.
    pub counts: &'static str,
}

const fn row(name: &'static str, default: u64, counts: &'static str) -> Limit {
    Limit { name, default, counts }
}

/// All limits, sorted by name.
pub const LIMITS: &[Limit] = &[
    row("candidates", 100_000_000, "positions tried by one scatter"),
    row("catkins", 100_000_000, "catkins of a flight"),
    row("cells", 200_000_000, "cells of the lattice wind"),
    row("cloud-points", 20_000_000_000, "points of an animated attractor times frames"),
    row("drop-steps", 5_000_000_000, "raindrops in the air times time steps of a clip and its spin-up"),
    row("entries", 2000, "L-systems of one file that are checked in turn"),
    row("frames", 1_000_000, "frames of a clip"),
    row("image-bytes", 512 << 20, "bytes of one decoded image"),
    row("image-side", 16_384, "pixels along a side of an image"),
    row("includes", 256, "files included by one file"),
    row("instances", 10_000_000, "instances in a scene"),
    row("json-bytes", 64 << 20, "bytes of JSON in one file"),
    row("macro-tokens", 2_000_000, "tokens after macro expansion"),
    row("maps", 1000, "maps of an iterated function system"),
    row(
        "memory",
        16_000_000_000,
        "bytes of memory of a command; where the system reports its memory, three quarters of that",
    ),
    row("mesh-bytes", 512 << 20, "bytes of one mesh file or buffer"),
    row("modules", 20_000_000, "modules in any derivation step"),
    row("motion-keys", 100_000_000, "moving branches of a plant, or drops on leaves, times frames"),
    row("nodes", 20_000_000, "nodes of a plant"),
    row("organs", 20_000_000, "organs of a plant"),
    row("output-bytes", 200_000_000_000, "predicted bytes written by one command"),
    row("points", 1_000_000_000, "points of an attractor"),
    row("statements", 100_000_000, "statements executed in blocks and decompositions"),
    row("steps", 1_000_000, "derivation length"),
    row("string-bytes", 130_000_000, "bytes of the strings that a derivation holds at a time"),
    row("text-bytes", 64 << 20, "bytes of one text file"),
    row("triangles", 50_000_000, "triangles of a mesh"),
    row("turtle-stack", 100_000, "open brackets"),
    row("vertices", 50_000_000, "vertices of a mesh"),
    row("wind-bytes", 4_000_000_000, "bytes of the recorded wind of a clip"),
    row("work", 100_000_000, "modules rewritten by one derivation, over all of its steps"),
];

/// The limits in force: defaults, then the changes by the user and by the memory of the machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    values: Vec<u64>,
}

impl Default for Limits {
    fn default() -> Self {
        Self { values: LIMITS.iter().map(|l| l.default).collect() }
    }
}

impl Limits {
    /// The defaults, with `memory` set to three quarters of the memory of the machine or of the container, whichever is less,
    /// where the system reports it. Written bytes never depend on it. `machine`, `container`: texts of `/proc/meminfo` and of
    /// the files that [`control_group_files`] names, one per line; empty if there are none.
    pub fn of_machine(machine: &str, container: &str) -> Self {
        let mut limits = Self::default();
        let place = LIMITS.iter().position(|l| l.name == "memory");
        // A quarter is left to the system and to other programs. Dividing first cannot overflow.
        if let (Some(bytes), Some(i)) = (usable(machine, container), place) {
            limits.values[i] = bytes / 4 * 3;
        }
        limits
    }

    /// Lowers `memory` to three quarters of the address space of the process, if that is bounded. `text`: the content of
    /// `/proc/self/limits`, empty if there is none.
    pub fn within_process(mut self, text: &str) -> Self {
        let line = text.lines().find_map(|line| line.strip_prefix("Max address space"));
        let most = line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok());
        let place = LIMITS.iter().position(|l| l.name == "memory");
        if let (Some(bytes), Some(i)) = (most, place) {
            self.values[i] = self.values[i].min(bytes / 4 * 3);
        }
        self
    }

    /// Value in force; 0 for an unknown name, which refuses all work, so that tests find a misspelt name.
    pub fn get(&self, name: &str) -> u64 {
        LIMITS.iter().position(|l| l.name == name).map_or(0, |i| self.values[i])
    }

    /// Sets a limit from text: an integer with suffix k, M, G (1e3, 1e6, 1e9), or `none`.
    /// # Errors
    /// What is wrong with the name or the text.
    pub fn set(&mut self, name: &str, text: &str) -> std::result::Result<(), String> {
        let unknown = || format!("there is no limit \"{name}\"; `osier list limits` shows them");
        let bad = || format!("\"{text}\" is not a whole number with suffix k, M or G, nor \"none\"");
        let index = LIMITS.iter().position(|l| l.name == name).ok_or_else(unknown)?;
        self.values[index] = parse(text).ok_or_else(bad)?;
        Ok(())
    }

    /// Succeeds if `wanted` does not exceed the limit `name`. `what`: the subject of the message, such as "number of frames".
    /// # Errors
    /// `Limit` naming the flag that lifts it.
    pub fn check(&self, name: &str, wanted: u64, what: &str) -> Result<()> {
        self.check_with_help(name, wanted, what, "")
    }

    /// [`Limits::check`] with another remedy than the flag in the message, as a request without a full stop.
    /// # Errors
    /// `Limit` naming the flag that lifts it and the help.
    pub fn check_with_help(&self, name: &str, wanted: u64, what: &str, help: &str) -> Result<()> {
        let limit = self.get(name);
        if wanted <= limit {
            return Ok(());
        }
        let (flag, help) = (format!("--max-{name}"), help.to_owned());
        Err(Error::Limit { name: what.to_owned(), wanted: grouped(wanted), limit: grouped(limit), flag, help })
    }
}

/// `Limit` for `bytes` of memory in use where `limit` allows fewer.
pub fn memory_error(bytes: u64, limit: u64) -> Error {
    Error::Limit {
        name: "memory in use, in bytes,".into(),
        wanted: grouped(bytes),
        limit: grouped(limit),
        flag: "--max-memory".into(),
        help: String::new(),
    }
}

/// Paths of the files that hold the memory limits of a process's control groups in Linux, from the outermost group to the
/// process's own, for versions 1 and 2 of control groups. `text`: the content of `/proc/self/cgroup`.
/// # Examples
/// ```
/// use osier_base::limits::control_group_files;
///
/// let files = control_group_files("0::/batch/job_7\n");
/// assert_eq!(files.last().map(String::as_str), Some("/sys/fs/cgroup/batch/job_7/memory.max"));
/// ```
pub fn control_group_files(text: &str) -> Vec<String> {
    // A container sees its own group at the root, whatever the path of the group is outside.
    let mut files =
        vec!["/sys/fs/cgroup/memory.max".to_owned(), "/sys/fs/cgroup/memory/memory.limit_in_bytes".to_owned()];
    for line in text.lines() {
        // The form of a line is ID:CONTROLLERS:PATH; in version 2 the field of controllers is empty.
        let mut fields = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (fields.next(), fields.next()) else { continue };
        let (root, name) = if controllers.is_empty() {
            ("/sys/fs/cgroup", "memory.max")
        } else if controllers.split(',').any(|c| c == "memory") {
            ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
        } else {
            continue;
        };
        if path.contains("..") {
            continue;
        }
        // The limits of all groups that contain the process's own apply, too.
        let ends = path.match_indices('/').map(|(i, _)| i).skip(1).chain([path.len()]);
        files.extend(ends.map(|end| format!("{root}{}/{name}", path[..end].trim_end_matches('/'))));
    }
    files
}

/// Bytes of memory available to the process: the smallest number that the files of [`Limits::of_machine`] give; `None` if they
/// give none.
fn usable(machine: &str, container: &str) -> Option<u64> {
    let total = machine.lines().find_map(|line| line.strip_prefix("MemTotal:")?.trim().strip_suffix("kB"));
    let total = total.and_then(|kib| kib.trim().parse::<u64>().ok()?.checked_mul(1024));
    // An unlimited control group holds the word `max`, which does not parse, or a number beyond every memory.
    let most = container.lines().filter_map(|line| line.trim().parse::<u64>().ok());
    total.into_iter().chain(most).min()
}

fn parse(text: &str) -> Option<u64> {
    if text == "none" {
        return Some(u64::MAX);
    }
    let (digits, factor) = match text.chars().last()? {
        'k' => (&text[..text.len() - 1], 1_000),
        'M' => (&text[..text.len() - 1], 1_000_000),
        'G' => (&text[..text.len() - 1], 1_000_000_000),
        _ => (text, 1),
    };
    digits.parse::<u64>().ok()?.checked_mul(factor)
}

/// Decimal digits with a comma before every group of three: 1234567 as `1,234,567`.
pub fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_what_the_machine_or_the_container_has() {
        let machine = "MemFree:  7 kB\nMemTotal:       32768 kB\n";
        assert_eq!(usable(machine, "max\n"), Some(32 << 20));
        assert_eq!(usable(machine, "1048576\n"), Some(1 << 20));
        assert_eq!(usable(machine, "max\n\n4096\n9223372036854771712\n"), Some(4096));
        assert_eq!((usable("", "1024"), usable("MemTotal: many kB", "")), (Some(1024), None));
        let here = Limits::of_machine(machine, "");
        assert_eq!((here.get("memory"), here.get("cells")), (24 << 20, Limits::default().get("cells")));
        assert_eq!(Limits::of_machine("", ""), Limits::default());
        let bounded = "Max file size  unlimited\nMax address space         8192  unlimited  bytes\n";
        assert_eq!(here.clone().within_process(bounded).get("memory"), 6144);
        assert_eq!(here.clone().within_process("Max address space  unlimited  unlimited  bytes"), here);
    }

    #[test]
    fn groups_of_both_versions_have_their_files() {
        let own = |text: &str| control_group_files(text).split_off(2);
        let nested = ["/sys/fs/cgroup/a/memory.max", "/sys/fs/cgroup/a/b.slice/memory.max"];
        assert_eq!(own("0::/a/b.slice\n"), nested);
        assert_eq!(
            own("9:cpu:/x\n4:pids,memory:/a\n0::/\n"),
            ["/sys/fs/cgroup/memory/a/memory.limit_in_bytes", "/sys/fs/cgroup/memory.max"]
        );
        assert!(own("0::/../a\nnonsense\n").is_empty());
    }

    #[test]
    fn limits_are_sorted_set_and_checked() {
        assert!(LIMITS.windows(2).all(|w| w[0].name < w[1].name));
        let mut l = Limits::default();
        l.set("modules", "3k").expect("suffix");
        assert!(l.check("modules", 3000, "modules").is_ok());
        let e = l.check("modules", 3_051_757_811, "step 13").expect_err("over");
        assert_eq!(e.to_string(), "step 13 would be 3,051,757,811, the limit is 3,000; raise it with --max-modules");
        let bad = l.set("modules", "many").expect_err("no number");
        assert_eq!(bad, "\"many\" is not a whole number with suffix k, M or G, nor \"none\"");
        assert!(l.set("wishes", "3").is_err());
    }
}
