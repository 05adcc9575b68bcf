//! Choosing the levels of detail at which a [`World`] is read as one scene.

use std::{cmp::Reverse, collections::BTreeMap, ops::Range};

use crate::world::{Node, Run, World, by_file};

/// The runs that were chosen of each chunk, ascending and without overlap, by the chunk's position in
/// [`World::files`].
pub(super) type Chosen = BTreeMap<usize, Vec<Range<usize>>>;

/// The finest runs of all nodes that hold at most `budget` Gaussians together. Levels of nodes differ by one at
/// most, the first nodes in the tree being finer. Without a budget, the finest level. The coarsest level is
/// chosen even if it is too large, with a warning.
pub(super) fn choose(world: &World, budget: Option<usize>, warnings: &mut Vec<String>) -> Chosen {
    let runs = match budget {
        None => world.nodes.iter().filter_map(|node| runs(node).next()).map(|(_, run)| run).collect(),
        Some(budget) => within(&world.nodes, budget, warnings),
    };
    by_file(runs.into_iter().filter(|run| !run.range.is_empty()))
}

/// The runs of a node with their levels, the finest first.
fn runs(node: &Node) -> impl DoubleEndedIterator<Item = (usize, &Run)> {
    node.levels.iter().enumerate().filter_map(|(level, run)| Some((level, run.as_ref()?)))
}

/// A run of each node: from the coarsest level on, one level after the other is entered until one does not fit.
fn within<'a>(nodes: &'a [Node], budget: usize, warnings: &mut Vec<String>) -> Vec<&'a Run> {
    let size = |run: &Run| run.range.len() as u64;
    // Each node has a level.
    let coarsest = nodes.iter().filter_map(|node| runs(node).next_back());
    let mut chosen: Vec<&Run> = coarsest.map(|(_, run)| run).collect();
    let mut total: u64 = chosen.iter().copied().map(size).sum();
    let budget = budget as u64;
    if total > budget {
        warnings.push(format!("the coarsest level has {total} Gaussians, more than the budget of {budget}"));
        return chosen;
    }
    let mut steps: Vec<(usize, usize, &Run)> = Vec::new();
    for (i, node) in nodes.iter().enumerate() {
        // The last level is chosen already.
        steps.extend(runs(node).rev().skip(1).map(|(level, run)| (level, i, run)));
    }
    steps.sort_by_key(|&(level, node, _)| (Reverse(level), node));
    for of_level in steps.chunk_by(|a, b| a.0 == b.0) {
        let mut all_fit = true;
        for &(_, node, run) in of_level {
            let next = total - size(chosen[node]) + size(run);
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
    use crate::error::Mismatch;

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
        Ok((choose(&World::read_runs(json.as_bytes())?, budget, &mut warnings), warnings))
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
