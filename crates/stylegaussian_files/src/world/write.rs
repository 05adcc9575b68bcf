//! Writing a world.

use std::collections::BTreeMap;

use glam::Vec3;
use serde::Serialize;

use super::{Node, World};

#[derive(Serialize)]
struct Levels<'a> {
    version: u32,
    asset: Asset,
    count: u64,
    counts: Vec<u64>,
    #[serde(rename = "lodLevels")]
    n_levels: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    environment: Option<&'a str>,
    filenames: &'a [String],
    tree: Tree,
}

#[derive(Serialize)]
struct Asset {
    generator: &'static str,
}

#[derive(Serialize)]
struct Tree {
    bound: Bound,
    #[serde(skip_serializing_if = "Option::is_none")]
    children: Option<[Box<Tree>; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lods: Option<BTreeMap<usize, Lod>>,
}

#[derive(Serialize)]
struct Bound {
    min: [f32; 3],
    max: [f32; 3],
}

#[derive(Serialize)]
struct Lod {
    file: usize,
    offset: usize,
    count: usize,
}

impl World {
    /// The world as a `lod-meta.json` of version 1. The same world gives the same bytes.
    ///
    /// The tree is binary: a branch has one half of its leaves on either side, in the order of
    /// [`nodes`](Self::nodes). So nodes that are near one another in space should follow one another there.
    pub fn write(&self) -> Vec<u8> {
        let counts: Vec<u64> = (0..self.n_levels).map(|level| self.count(level)).collect();
        let levels = Levels {
            version: 1,
            asset: Asset { generator: concat!("stylegaussian ", env!("CARGO_PKG_VERSION")) },
            count: counts.iter().sum(),
            counts,
            n_levels: self.n_levels,
            environment: self.environment.as_deref(),
            filenames: &self.files,
            tree: tree(&self.nodes),
        };
        serde_json::to_vec(&levels).expect("texts and numbers, which JSON holds")
    }
}

/// The tree above these leaves.
fn tree(nodes: &[Node]) -> Tree {
    match nodes {
        [node] => {
            let [low, high] = node.bounds;
            let lods = node.levels.iter().enumerate().filter_map(|(level, run)| {
                let run = run.as_ref()?;
                Some((level, Lod { file: run.file, offset: run.range.start, count: run.range.len() }))
            });
            Tree {
                bound: Bound { min: low.to_array(), max: high.to_array() },
                children: None,
                lods: Some(lods.collect()),
            }
        }
        // A world without nodes is no world to any reader.
        [] => Tree { bound: Bound { min: [0.0; 3], max: [0.0; 3] }, children: None, lods: None },
        _ => {
            let (first, second) = nodes.split_at(nodes.len() / 2);
            let [first, second] = [tree(first), tree(second)];
            let corner = |best: fn(Vec3, Vec3) -> Vec3, a: [f32; 3], b: [f32; 3]| {
                best(Vec3::from(a), Vec3::from(b)).to_array()
            };
            let bound = Bound {
                min: corner(Vec3::min, first.bound.min, second.bound.min),
                max: corner(Vec3::max, first.bound.max, second.bound.max),
            };
            Tree { bound, children: Some([first, second].map(Box::new)), lods: None }
        }
    }
}
