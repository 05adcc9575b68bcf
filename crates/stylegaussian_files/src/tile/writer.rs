//! Writing a world node by node, in memory of a chunk for each level.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::{Mat3, Vec3};
use stylegaussian::Scene;

use crate::{
    atomic::write_atomically,
    check::check_scene,
    error::{FileError, mismatch},
    sog::{META, chunk_files},
    world::{FILE, Node, Run, World},
};

/// A node that is to be written: its Gaussians at each level.
#[derive(Clone, Debug)]
pub struct LeveledNode {
    /// The smallest and the largest corner of the box around all of them, with one standard deviation around
    /// each mean.
    pub bounds: [Vec3; 2],
    /// The Gaussians at each level, the finest first.
    pub levels: Vec<Scene>,
}

impl LeveledNode {
    /// The node with these levels and the box around them.
    pub fn new(levels: Vec<Scene>) -> Self {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for scene in &levels {
            for (i, &mean) in scene.means.iter().enumerate() {
                // The deviation along an axis of the scene is the length of a row of rotation times scales.
                let half = Mat3::from_quat(scene.rotations[i]) * Mat3::from_diagonal(scene.scales[i]);
                let rows = half.transpose();
                let deviations = Vec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
                (low, high) = (low.min(mean - deviations), high.max(mean + deviations));
            }
        }
        Self { bounds: [low, high], levels }
    }
}

/// Writes a world to a folder: chunks as they are filled, and `lod-meta.json` at the end, so that a folder
/// without it is not complete. Nodes that are near one another in space should follow one another.
///
/// A chunk has the highest degree of spherical harmonics of its nodes. Those above degree 0 are rounded to the
/// entries of a palette, 65,536 at most.
#[derive(Debug)]
pub struct WorldWriter {
    folder: PathBuf,
    /// Most Gaussians of a chunk that has several nodes.
    most: usize,
    keeps_chunks: bool,
    world: World,
    /// The chunk of each level that is not written yet.
    open: Vec<Chunk>,
}

#[derive(Debug, Default)]
struct Chunk {
    /// Its place in the files of the world, if it has a node.
    file: Option<usize>,
    /// Its number among those of its level.
    number: usize,
    scene: Scene,
}

impl WorldWriter {
    /// Begins a world of `n_levels` levels, whose chunks have `most` Gaussians at most, unless one node alone
    /// has more. If `keeps_chunks`, chunks that are complete in the folder are those of an earlier run with the
    /// same nodes, and are not written again.
    pub fn new(folder: &Path, n_levels: usize, most: usize, keeps_chunks: bool) -> Self {
        let open = (0..n_levels).map(|_| Chunk::default()).collect();
        let world = World { n_levels, files: Vec::new(), environment: None, nodes: Vec::new() };
        Self { folder: folder.into(), most, keeps_chunks, world, open }
    }

    /// Adds a node. Levels beyond those of the world, and empty ones, are left out.
    ///
    /// # Errors
    /// If the node has no Gaussian, a chunk that is full cannot be written, or its Gaussians contradict
    /// themselves.
    pub fn add(&mut self, node: &LeveledNode) -> Result<(), FileError> {
        if node.levels.iter().take(self.open.len()).all(Scene::is_empty) {
            return Err(mismatch("a node without Gaussians", "at least one").at(&self.folder));
        }
        let mut levels = vec![None; self.open.len()];
        for (level, scene) in node.levels.iter().enumerate().take(self.open.len()) {
            if scene.is_empty() {
                continue;
            }
            if self.open[level].scene.len() + scene.len() > self.most {
                self.close(level)?;
            }
            let chunk = &mut self.open[level];
            let file = *chunk.file.get_or_insert_with(|| {
                self.world.files.push(format!("{level}_{}/{META}", chunk.number));
                self.world.files.len() - 1
            });
            let begin = chunk.scene.len();
            chunk.scene.append(scene);
            levels[level] = Some(Run { file, range: begin..chunk.scene.len() });
        }
        self.world.nodes.push(Node { bounds: node.bounds, levels });
        Ok(())
    }

    /// Writes the open chunk of a level, if it has a node, and begins the next one.
    fn close(&mut self, level: usize) -> Result<(), FileError> {
        let number = self.open[level].number;
        let chunk =
            std::mem::replace(&mut self.open[level], Chunk { number: number + 1, ..Chunk::default() });
        if chunk.file.is_none() {
            self.open[level].number = number;
            return Ok(());
        }
        let folder = self.folder.join(format!("{level}_{number}"));
        if self.keeps_chunks && folder.join(META).is_file() {
            return Ok(());
        }
        check_scene(&chunk.scene).map_err(|mismatch| mismatch.at(&folder))?;
        let files = chunk_files(&chunk.scene).map_err(|mismatch| mismatch.at(&folder))?;
        fs::create_dir_all(&folder).map_err(|source| FileError::Io { path: folder.clone(), source })?;
        // The metadata is the first, and is written last: a folder that has it is complete.
        for (name, bytes) in files.iter().rev() {
            write_atomically(&folder.join(name), |out| out.write_all(bytes))?;
        }
        Ok(())
    }

    /// Writes the last chunks and `lod-meta.json`.
    ///
    /// # Errors
    /// If there is no node, or a file cannot be written.
    pub fn finish(mut self) -> Result<World, FileError> {
        let path = self.folder.join(FILE);
        if self.world.nodes.is_empty() {
            return Err(mismatch("a world without Gaussians", "a node at least").at(&path));
        }
        (0..self.open.len()).try_for_each(|level| self.close(level))?;
        let bytes = self.world.write();
        write_atomically(&path, |out| out.write_all(&bytes))?;
        Ok(self.world)
    }
}

/// Makes a folder for a new world.
///
/// # Errors
/// If it holds anything but `allowed`, or cannot be made.
pub(crate) fn expect_empty(folder: &Path, allowed: &str) -> Result<(), FileError> {
    let at = |source| FileError::Io { path: folder.into(), source };
    fs::create_dir_all(folder).map_err(at)?;
    for entry in fs::read_dir(folder).map_err(at)? {
        let name = entry.map_err(at)?.file_name();
        if name != allowed {
            let found = format_args!("`{}` in it", name.to_string_lossy().escape_debug()).to_string();
            return Err(mismatch(found, "an empty folder, or none, for a new world").at(folder));
        }
    }
    Ok(())
}
