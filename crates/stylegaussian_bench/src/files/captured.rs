//! A real SOG scene of the test data, as often as it takes.

use std::{env, fs, path::PathBuf};

use anyhow::{Context, Result};
use serde_json::json;

use super::{Files, Packing};

/// The folder of a chunk of a streamed scene, with the most Gaussians.
const CHUNK: &str = "zoo/ssog/playbot/0_0";

/// A streamed scene of at least `n` Gaussians, or `None` without the test data.
pub fn sog(n: usize) -> Result<Option<Files>> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = env::var_os("STYLEGAUSSIAN_DATA").map_or_else(beside, PathBuf::from).join(CHUNK);
    let Ok(entries) = fs::read_dir(&folder) else { return Ok(None) };
    let mut chunk = Vec::new();
    for entry in entries {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        chunk.push((name, fs::read(&path)?));
    }
    let meta = chunk.iter().find(|(name, _)| name == "meta.json").context("no meta.json")?;
    let meta: serde_json::Value = serde_json::from_slice(&meta.1)?;
    let count = meta["count"].as_u64().context("no count")?;
    let copies = n.div_ceil(count as usize);
    let filenames: Vec<String> = (0..copies).map(|i| format!("{i}/meta.json")).collect();
    let children: Vec<_> =
        (0..copies).map(|i| json!({ "lods": { "0": { "file": i, "offset": 0, "count": count } } })).collect();
    let levels = json!({ "lodLevels": 1, "filenames": filenames, "tree": { "children": children } });
    let others = (0..copies)
        .flat_map(|i| chunk.iter().map(move |(name, bytes)| (format!("{i}/{name}"), bytes.clone())));
    Ok(Some(Files {
        name: "SOG",
        file_name: "lod-meta.json",
        main: levels.to_string().into_bytes(),
        others: others.collect(),
        packing: Packing::WebP,
    }))
}
