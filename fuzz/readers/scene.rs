//! Scenes of every format. The first byte chooses the extension, since some formats have no other mark.

use stylegaussian_files::scene_from_bytes;

/// Extensions of scenes, those of formats to come included.
const EXTENSIONS: [&str; 10] = ["ply", "sgs", "pth", "spz", "sog", "splat", "ksplat", "glb", "gltf", "json"];

/// Reads the scene. One that is accepted is consistent and can be asked about everything.
pub fn read(data: &[u8]) {
    let Some((&first, data)) = data.split_first() else { return };
    let name = format!("fuzz.{}", EXTENSIONS[usize::from(first) % EXTENSIONS.len()]);
    if let Ok(loaded) = scene_from_bytes(data, &name) {
        let scene = loaded.scene;
        scene.validate().expect("readers give consistent scenes");
        assert!(!scene.is_empty() && scene.means.iter().all(|mean| mean.is_finite()));
        assert_eq!(scene.base_colors().len(), scene.len());
        assert!(scene.bounds().is_some());
    }
}
