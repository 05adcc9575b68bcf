//! `lod-meta.json`: a scene at several levels of detail, cut into the nodes of a tree.
//!
//! Each node names a run of Gaussians in some chunk for every level at which it has any. Level 0 is the finest.

use std::{cmp::Reverse, collections::BTreeMap, ops::Range};

use serde::Deserialize;

use crate::{
    error::{Mismatch, mismatch},
    names::check_downward,
};

use super::meta::parse;

/// The levels of detail of a scene.
#[derive(Deserialize)]
pub(super) struct Levels {
    version: Option<serde_json::Number>,
    #[serde(rename = "lodLevels")]
    n_levels: u32,
    /// Metadata of a chunk that surrounds the scene at every level, by its path.
    pub environment: Option<String>,
    /// Metadata of the chunks, by their paths.
    pub filenames: Vec<String>,
    tree: Node,
}

#[derive(Deserialize)]
struct Node {
    children: Option<Vec<Node>>,
    lods: Option<BTreeMap<u32, Run>>,
}

/// A run of Gaussians.
#[derive(Clone, Copy, Deserialize)]
struct Run {
    file: u32,
    offset: u32,
    count: u32,
}

/// The runs that were chosen of each chunk, ascending and without overlap, by the chunk's position in
/// [`Levels::filenames`].
pub(super) type Chosen = BTreeMap<usize, Vec<Range<usize>>>;

impl Levels {
    /// Reads the tree.
    pub fn parse(json: &[u8]) -> Result<Self, Mismatch> {
        let levels: Self = parse(json, "levels of detail of a streamed SOG")?;
        if let Some(version) = levels.version.as_ref().filter(|version| version.as_u64() != Some(1)) {
            return Err(mismatch(format_args!("streamed SOG version {version}"), "version 1 or none"));
        }
        levels.filenames.iter().chain(&levels.environment).try_for_each(|path| check_downward(path))?;
        Ok(levels)
    }

    /// The finest runs of all nodes that hold at most `budget` Gaussians together. Levels of nodes differ by
    /// one at most, the first nodes in the tree being finer. Without a budget, the finest level. The coarsest
    /// level is chosen even if it is too large, with a warning.
    pub fn choose(&self, budget: Option<usize>, warnings: &mut Vec<String>) -> Result<Chosen, Mismatch> {
        let mut nodes = Vec::new();
        self.tree.collect(&mut nodes);
        let chosen = match budget {
            None => nodes.iter().filter_map(|lods| lods.values().next().copied()).collect(),
            Some(budget) => within(&nodes, budget, warnings),
        };
        if let Some(level) =
            nodes.iter().filter_map(|lods| lods.keys().next_back()).find(|&&l| l >= self.n_levels)
        {
            return Err(mismatch(
                format_args!("level {level}"),
                format_args!("levels below {}", self.n_levels),
            ));
        }
        self.by_file(chosen)
    }

    /// The runs by their chunks.
    fn by_file(&self, runs: Vec<Run>) -> Result<Chosen, Mismatch> {
        let mut chosen = Chosen::new();
        for Run { file, offset, count } in runs {
            if file as usize >= self.filenames.len() {
                let expected = format_args!("files below {}", self.filenames.len()).to_string();
                return Err(mismatch(format_args!("file {file} in the tree"), expected));
            }
            if count > 0 {
                let (start, end) = (offset as usize, offset as usize + count as usize);
                chosen.entry(file as usize).or_default().push(start..end);
            }
        }
        for (&file, runs) in &mut chosen {
            runs.sort_unstable_by_key(|run| run.start);
            // Overlapping runs would let a small file ask for a large scene.
            if runs.windows(2).any(|pair| pair[0].end > pair[1].start) {
                let found =
                    format_args!("nodes that share Gaussians of `{}`", self.filenames[file]).to_string();
                return Err(mismatch(found, "nodes with Gaussians of their own"));
            }
        }
        Ok(chosen)
    }
}

impl Node {
    /// The nodes with Gaussians, in the order of the tree. The depth is bounded by the JSON parser.
    fn collect<'a>(&'a self, nodes: &mut Vec<&'a BTreeMap<u32, Run>>) {
        nodes.extend(self.lods.as_ref().filter(|lods| !lods.is_empty()));
        self.children.iter().flatten().for_each(|child| child.collect(nodes));
    }
}

/// A run of each node: from the coarsest level on, one level after the other is entered until one does not fit.
fn within(nodes: &[&BTreeMap<u32, Run>], budget: usize, warnings: &mut Vec<String>) -> Vec<Run> {
    let mut chosen: Vec<Run> = nodes.iter().filter_map(|lods| lods.values().next_back().copied()).collect();
    let mut total: u64 = chosen.iter().map(|run| u64::from(run.count)).sum();
    let budget = budget as u64;
    if total > budget {
        warnings.push(format!("the coarsest level has {total} Gaussians, more than the budget of {budget}"));
        return chosen;
    }
    let mut steps: Vec<(u32, usize, Run)> = Vec::new();
    for (node, lods) in nodes.iter().enumerate() {
        // The last level is chosen already.
        steps.extend(lods.iter().rev().skip(1).map(|(&level, &run)| (level, node, run)));
    }
    steps.sort_by_key(|&(level, node, _)| (Reverse(level), node));
    for of_level in steps.chunk_by(|a, b| a.0 == b.0) {
        let mut all_fit = true;
        for &(_, node, run) in of_level {
            let next = total - u64::from(chosen[node].count) + u64::from(run.count);
            if next <= budget {
                (chosen[node], total) = (run, next);
            } else {
                all_fit = false;
            }
        }
        if !all_fit {
            break;
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two nodes of three levels: 100 + 200, 40 + 60, and 10 in the first alone. Chunk per level.
    const TREE: &str = r#"{"lodLevels": 3, "environment": null,
        "filenames": ["0/meta.json", "1/meta.json", "2/meta.json"],
        "tree": {"bound": {}, "children": [
            {"lods": {"0": {"file": 0, "offset": 0, "count": 100}, "1": {"file": 1, "offset": 60, "count": 40},
                      "2": {"file": 2, "offset": 0, "count": 10}}},
            {"lods": {"0": {"file": 0, "offset": 100, "count": 200},
                      "1": {"file": 1, "offset": 0, "count": 60}}}]}}"#;

    fn chosen(json: &str, budget: Option<usize>) -> Result<(Chosen, Vec<String>), Mismatch> {
        let mut warnings = Vec::new();
        Ok((Levels::parse(json.as_bytes())?.choose(budget, &mut warnings)?, warnings))
    }

    #[test]
    fn the_finest_nodes_that_fit_are_chosen() {
        let of = |budget| {
            let (chosen, warnings) = chosen(TREE, budget).unwrap();
            assert!(warnings.is_empty());
            chosen
                .into_iter()
                .flat_map(|(file, runs)| runs.into_iter().map(move |run| (file, run)))
                .collect::<Vec<_>>()
        };
        assert_eq!(of(None), [(0, 0..100), (0, 100..300)]);
        assert_eq!(of(Some(300)), of(None));
        // 100 + 60: the second node would need 140 more.
        assert_eq!(of(Some(299)), [(0, 0..100), (1, 0..60)]);
        assert_eq!(of(Some(159)), [(1, 0..60), (1, 60..100)]);
        assert_eq!(of(Some(99)), [(1, 0..60), (2, 0..10)]);
    }

    #[test]
    fn the_coarsest_level_is_there_at_any_budget() {
        let (coarsest, warnings) = chosen(TREE, Some(5)).unwrap();
        let coarsest: Vec<_> = coarsest.into_iter().map(|(file, runs)| (file, runs[0].clone())).collect();
        assert_eq!(coarsest, [(1, 0..60), (2, 0..10)]);
        assert!(warnings[0].contains("70 Gaussians"), "{warnings:?}");
    }

    #[test]
    fn contradictions_are_refused() {
        let refused = |from: &str, to: &str, expected: &str| {
            let Err(Mismatch { found, .. }) = chosen(&TREE.replacen(from, to, 1), None) else {
                panic!("{to}")
            };
            assert!(found.contains(expected), "{found}");
        };
        refused("\"offset\": 100", "\"offset\": 99", "share Gaussians of `0/meta.json`");
        refused("\"file\": 0", "\"file\": 3", "file 3");
        refused("\"lodLevels\": 3", "\"lodLevels\": 2", "level 2");
        refused("\"lodLevels\": 3", "\"lodLevels\": 3, \"version\": 2", "version 2");
        refused("\"count\": 100", "\"count\": 1e300", "JSON");
        refused("0/meta.json", "../meta.json", "../meta.json");
        refused("\"environment\": null", "\"environment\": \"/etc/meta.json\"", "file path");
        let nested = "{\"children\":[".repeat(100_000);
        refused("{\"bound\"", &format!("{nested}{{\"bound\""), "recursion");
    }
}
