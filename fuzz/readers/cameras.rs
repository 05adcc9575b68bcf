//! Cameras: transforms.json, 3DGS cameras.json, and COLMAP models as text and as binary.

use std::{env, fs, process};

use stylegaussian_train::cameras::read_cameras;

/// The files of each kind. COLMAP's have two, which share the bytes.
const KINDS: [&[&str]; 4] =
    [&["transforms.json"], &["cameras.json"], &["cameras.txt", "images.txt"], &["cameras.bin", "images.bin"]];

/// Reads the cameras. The first byte chooses the kind, the second the share of the first file of two, in
/// 256ths.
pub fn read(data: &[u8]) {
    let [kind, share, data @ ..] = data else { return };
    let folder = env::temp_dir().join(format!("stylegaussian-fuzz-{}", process::id()));
    // A folder of its own for each run, as files of another kind would be read instead.
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder for temporary files");
    let names = KINDS[usize::from(*kind) % KINDS.len()];
    let cut = if names.len() == 1 { data.len() } else { data.len() * usize::from(*share) / 256 };
    for (name, part) in names.iter().zip([&data[..cut], &data[cut..]]) {
        fs::write(folder.join(name), part).expect("a temporary file");
    }
    if let Ok(set) = read_cameras(&folder) {
        assert!(!set.cameras.is_empty() && set.cameras.iter().all(|posed| posed.camera.is_usable()));
    }
    let _ = fs::remove_dir_all(&folder);
}
