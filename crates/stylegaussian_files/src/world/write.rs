//! Writing a world.

use super::{Bound, Levels, Lod, Node, Tree, World, around};

impl World {
    /// The world as a `lod-meta.json` of version 1. The same world gives the same bytes.
    ///
    /// The tree is binary: a branch has one half of its leaves on either side, in the order of
    /// [`nodes`](Self::nodes). So nodes that are near one another in space should follow one another there.
    pub fn write(&self) -> Vec<u8> {
        let counts: Vec<u64> = (0..self.n_levels).map(|level| self.count(level)).collect();
        let levels = Levels {
            version: Some(1.into()),
            asset: [("generator", concat!("stylegaussian ", env!("CARGO_PKG_VERSION")))].into(),
            count: Some(counts.iter().sum()),
            counts: Some(counts),
            n_levels: self.n_levels,
            environment: self.environment.clone(),
            filenames: self.files.clone(),
            tree: tree(&self.nodes),
        };
        serde_json::to_vec(&levels).expect("texts and numbers, which JSON holds")
    }
}

/// The tree above these leaves.
fn tree(nodes: &[Node]) -> Tree {
    // A world without nodes is no world to any reader.
    let [min, max] = around(nodes).unwrap_or_default().map(|corner| Some(corner.to_array()));
    let (mut children, mut lods) = (None, None);
    match nodes {
        [] => {}
        [node] => {
            let levels = node.levels.iter().enumerate().filter_map(|(level, run)| {
                let run = run.as_ref()?;
                Some((level, Lod { file: run.file, offset: run.range.start, count: run.range.len() }))
            });
            lods = Some(levels.collect());
        }
        _ => {
            let (first, second) = nodes.split_at(nodes.len() / 2);
            children = Some(vec![tree(first), tree(second)]);
        }
    }
    Tree { bound: Some(Bound { min, max }), children, lods }
}
