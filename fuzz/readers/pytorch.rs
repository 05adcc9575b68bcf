//! State dicts of PyTorch, in both containers.

use stylegaussian_files::pytorch::state_dict_from_bytes;

/// Reads the file and its first tensors.
pub fn read(data: &[u8]) {
    if let Ok(state) = state_dict_from_bytes(data.to_vec(), "fuzz.pth") {
        // A file may name one storage often; each reading of it is bounded by the file's size.
        for name in state.names().take(64) {
            if let Ok(Some(tensor)) = state.tensor(name) {
                assert_eq!(tensor.values.len(), tensor.shape.iter().product::<usize>());
            }
        }
    }
}
