//! Records of the format `tracks`, as a script reads them by the index.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(clippy::disallowed_methods, clippy::expect_used, reason = "tests look at the disk and fail by panicking")]

use std::fs;
use std::path::Path;

use serde_json::Value;

/// The number of a word of a code list of tracks.
pub fn word_number(out: &Path, list: &str, word: &str) -> f64 {
    let index: Value = serde_json::from_slice(&fs::read(out.join("tracks/index.json")).expect("index")).expect("json");
    index[list].as_array().expect("words").iter().position(|e| e == word).expect("the word") as f64
}

/// Numbers of all records of a file of tracks: frame, and the fields that are asked for.
pub fn records(out: &Path, name: &str, wanted: &[&str]) -> Vec<(u64, Vec<f64>)> {
    let index: Value = serde_json::from_slice(&fs::read(out.join("tracks/index.json")).expect("index")).expect("json");
    let file = index["files"].as_array().expect("files").iter().find(|f| f["file"] == name).expect("the file");
    let bytes = fs::read(out.join("tracks").join(name)).expect("records");
    let count = |v: &Value| usize::try_from(v.as_u64().expect("a number")).expect("small");
    let size = count(&file["record_bytes"]);
    let fields = file["fields"].as_array().expect("fields");
    let of = |record: &[u8], name: &str| {
        let field = fields.iter().find(|f| f["name"] == name).expect("a field");
        let at = count(&field["offset"]);
        let four = || <[u8; 4]>::try_from(&record[at..at + 4]).expect("four bytes");
        match field["type"].as_str().expect("a type") {
            "u4" => f64::from(u32::from_le_bytes(four())),
            "i4" => f64::from(i32::from_le_bytes(four())),
            "f4" => f64::from(f32::from_le_bytes(four())),
            _ => f64::from_le_bytes(record[at..at + 8].try_into().expect("eight bytes")),
        }
    };
    let mut all = Vec::new();
    for frame in file["frames"].as_array().expect("frames") {
        let (first, many) = (count(&frame[1]), count(&frame[2]));
        for record in bytes[first * size..(first + many) * size].chunks(size) {
            all.push((frame[0].as_u64().expect("a frame"), wanted.iter().map(|n| of(record, n)).collect()));
        }
    }
    all
}
