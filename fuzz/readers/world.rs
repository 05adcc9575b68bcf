//! Levels of detail of worlds, `lod-meta.json`.

use stylegaussian_files::world::World;

/// Reads the world. One that is accepted is the same once it was written, and names files that it has.
pub fn read(data: &[u8]) {
    if let Ok(world) = World::read(data) {
        let runs = world.nodes.iter().flat_map(|node| node.levels.iter().flatten());
        assert!(runs.clone().all(|run| run.file < world.files.len()));
        let total: u64 = (0..world.n_levels).map(|level| world.count(level)).sum();
        assert_eq!(total, runs.map(|run| run.range.len() as u64).sum::<u64>());
        assert_eq!(World::read(&world.write()).unwrap(), world);
    }
}
