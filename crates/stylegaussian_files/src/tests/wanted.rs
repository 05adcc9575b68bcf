//! Readers tell how far they are, and stop if nobody wants the scene any more.

use std::sync::{Arc, Mutex, OnceLock};

use stylegaussian::work::Work;

use super::*;

#[test]
fn readers_stop_at_every_share() {
    let scene = full_scene();
    for name in ["a.ply", "a.compressed.ply", "a.splat", "a.spz", "a.sgs", "a.sog", "a.glb"] {
        let bytes = scene_to_bytes(name, &scene).unwrap();
        let reader = || SceneReader::new(bytes.clone(), name, ReadOptions::default());
        let told = Arc::new(Mutex::new(Vec::new()));
        let telling = {
            let told = Arc::clone(&told);
            Work::telling(move |share| told.lock().unwrap().push(share))
        };
        let Reading::Scene(loaded) = reader().read_if_wanted(&telling).unwrap() else {
            panic!("{name} needs another file")
        };
        assert_eq!(loaded.scene.len(), scene.len(), "{name}");
        let told = told.lock().unwrap().clone();
        assert!(!told.is_empty() && told.is_sorted(), "{name}: {told:?}");
        for stop in told {
            let own = Arc::new(OnceLock::<Work>::new());
            let known = Arc::clone(&own);
            let stopping = Work::telling(move |share| {
                if share >= stop {
                    known.get().unwrap().cancel();
                }
            });
            let work = own.get_or_init(|| stopping);
            let result = reader().read_if_wanted(work);
            assert!(matches!(result, Err(FileError::Canceled(_))), "{name} at {stop}");
            assert_eq!(work.done(), stop, "{name}");
        }
    }
}
