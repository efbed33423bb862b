//! Writing a clip takes no more memory than writing one frame.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests panic and look at the disk themselves")]
#![cfg(target_os = "linux")]

use std::path::Path;
use std::sync::Arc;

use osier::export::Exporter as _;
use osier::export::textures::Textures;
use osier::export::usd::{UsdExporter, UsdOptions};
use osier::files::Folder;

#[path = "it/common/bare.rs"]
mod bare;

const POINTS: u32 = 100_000;
const FRAMES: u32 = 120;

/// Most memory this process ever had, bytes.
fn high_water() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("status");
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).expect("VmHWM");
    line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("number") * 1024
}

#[test]
fn memory_does_not_grow_with_the_clip() {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("usd_memory");
    let _ = std::fs::remove_dir_all(&dir);
    let scene = Arc::new(bare::scene(bare::cloth(POINTS), FRAMES));
    let before = high_water();
    let folder = Folder::open(&dir).expect("folder");
    let mut usd =
        UsdExporter::new(folder.clone(), Arc::new(Textures::encode(&scene).expect("pictures")), UsdOptions::default());
    usd.begin(&scene).expect("begin");
    for f in 1..=FRAMES {
        usd.frame(&bare::cloth_frame(POINTS, f)).expect("frame");
    }
    usd.finish().expect("finish");
    let grown = high_water() - before;
    let one = u64::from(POINTS) * 24;
    let bytes = folder.files().iter().find(|f| f.kind == "usdc").expect("usdc").bytes;
    let _ = std::fs::remove_dir_all(&dir);
    assert!(bytes > u64::from(FRAMES) * one, "{bytes} bytes");
    assert!(grown <= one + (64 << 20), "{grown} bytes more than before");
}
