//! The levels of detail at which a world is rendered.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use clap::Args;
use stylegaussian::{
    Camera, Scene,
    cut::{CutNode, CutView, cut},
};
use stylegaussian_files::{
    Loaded, ReadOptions, read_world_at,
    world::{FILE, Node, World, manifest_at},
};

use crate::{
    scenes::ReadArgs,
    terminal::{note, warn},
};

/// Options of the levels of detail.
#[derive(Args, Clone, Copy, Debug)]
pub struct LevelArgs {
    /// Of a world (lod-meta.json), render this level of detail alone; 0 is the finest.
    #[arg(long, value_name = "L", conflicts_with = "budget", conflicts_with = "cut")]
    level: Option<usize>,
    /// Of a world, render each part at the level that the plugin would show to the cameras under the budget,
    /// which is one for all of them.
    #[arg(long, requires = "budget", requires = "cameras", conflicts_with = "axes")]
    cut: bool,
}

impl LevelArgs {
    /// Reads a scene, or a world at the levels that are asked for. `cameras` reads the cameras that see it.
    ///
    /// # Errors
    /// If it cannot be read, or if levels are asked for of something that has none.
    pub fn read(
        self,
        path: &Path,
        reading: ReadArgs,
        cameras: impl FnOnce() -> Result<Vec<Camera>>,
    ) -> Result<Scene> {
        if self.level.is_none() && !self.cut {
            return Ok(reading.read(path)?.scene);
        }
        let Some(manifest) = manifest_at(path) else {
            bail!("{}: found no world, expected a {FILE} or a folder with one", path.display());
        };
        let world = World::open(&manifest)?;
        let ReadOptions { axes, budget } = reading.options();
        let options = ReadOptions { axes, budget: None };
        let loaded = match self.level {
            Some(level) => {
                let (path, n) = (manifest.display(), world.n_levels);
                ensure!(level < n, "{path}: found {n} levels, expected more than {level}; 0 is the finest");
                read_world_at(&manifest, &world, &vec![Some(level); world.nodes.len()], options)?
            }
            None => read_cut(&manifest, world, &cameras()?, (budget.unwrap_or(usize::MAX), options))?,
        };
        warn(&loaded.warnings);
        note(format_args!("{} Gaussians of these levels", loaded.scene.len()));
        Ok(loaded.scene)
    }
}

/// Reads each node of a world at the level that the cameras see, and the surroundings, which count.
fn read_cut(
    manifest: &Path,
    mut world: World,
    cameras: &[Camera],
    (budget, options): (usize, ReadOptions),
) -> Result<Loaded> {
    let around = world.environment.is_some().then(|| read_world_at(manifest, &world, &[], options));
    let around = around.transpose()?;
    world.environment = None;
    let n_around = around.as_ref().map_or(0, |around| around.scene.len());
    let levels = levels_for(cameras, &world, budget.saturating_sub(n_around));
    let Some(around) = around else { return Ok(read_world_at(manifest, &world, &levels, options)?) };
    if levels.iter().all(Option::is_none) {
        return Ok(around);
    }
    let mut loaded = read_world_at(manifest, &world, &levels, options)?;
    // Last, as in all worlds that are read as one scene.
    loaded.scene.append(&around.scene);
    let others = around.warnings.into_iter().filter(|warning| !loaded.warnings.contains(warning));
    let others: Vec<String> = others.collect();
    loaded.warnings.extend(others);
    Ok(loaded)
}

/// The level of each node that all of the cameras see under one budget.
fn levels_for(cameras: &[Camera], world: &World, budget: usize) -> Vec<Option<usize>> {
    let views: Vec<CutView> = cameras.iter().map(CutView::of_camera).collect();
    let counts = |node: &Node| -> Vec<usize> {
        node.levels.iter().map(|run| run.as_ref().map_or(0, |run| run.range.len())).collect()
    };
    let counts: Vec<Vec<usize>> = world.nodes.iter().map(counts).collect();
    let nodes: Vec<CutNode> = (world.nodes.iter().zip(&counts))
        .map(|(node, counts)| CutNode { bounds: node.bounds, counts, views: &views, least_pixels: 0.0 })
        .collect();
    cut(&nodes, budget, &[]).levels
}
