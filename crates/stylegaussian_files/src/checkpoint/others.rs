//! Checkpoints of other trainers: not read, but known, so that the message can say what to export instead.
//!
//! They hold classes, optimizers and schedulers, which only their own code can load, and every trainer exports
//! a .ply.

use super::{Archive, Mismatch, Object, PytorchFile, mismatch};

/// A trainer, the words of which some stand in its checkpoints, and the way to a .ply.
struct Trainer {
    name: &'static str,
    /// Sets of words. All words of one set stand in the pickle.
    words: &'static [&'static [&'static str]],
    export: &'static str,
}

const INRIA: Trainer = Trainer {
    name: "3DGS",
    // The names of its optimizer's groups, and the class where it was saved as a whole.
    words: &[&["f_dc", "f_rest", "scaling"], &["gaussian_model"]],
    export: "a .ply: training saves `point_cloud/iteration_*/point_cloud.ply` beside it (`--save_iterations`)",
};

/// In this order: nerfstudio's models are gsplat's, and only some have Gaussians.
const TRAINERS: [Trainer; 4] = [
    Trainer {
        name: "nerfstudio",
        // Older versions had no name for the parameters together.
        words: &[&["gauss_params"], &["pipeline", "_model.quats"]],
        export: "a .ply: `ns-export gaussian-splat --load-config CONFIG.yml --output-dir DIR` writes one",
    },
    Trainer {
        name: "gsplat",
        words: &[&["splats", "means"], &["quats", "opacities", "scales"]],
        export: "a .ply: `simple_trainer.py` writes one with `--save_ply`, `gsplat.export_splats` from Python",
    },
    INRIA,
    Trainer {
        name: "nerfstudio that has no Gaussians",
        words: &[&["pipeline", "_model."]],
        export: "one of Gaussians, as its method `splatfacto` trains, and exported as a .ply",
    },
];

/// The message for a checkpoint of another trainer, or `None` if it is of none that is known.
pub(super) fn explained(bytes: &[u8]) -> Option<Mismatch> {
    let archive = Archive::open(bytes).ok()?;
    let name = archive.names().find(|name| name.ends_with("data.pkl"))?;
    let pickle = &bytes[archive.stored(name).ok()??];
    let has = |word: &&str| pickle.windows(word.len()).any(|window| window == word.as_bytes());
    let is_of = |trainer: &&Trainer| trainer.words.iter().any(|words| words.iter().all(has));
    let trainer = TRAINERS.iter().find(is_of).or_else(|| is_of_inria(bytes).then_some(&INRIA))?;
    Some(mismatch(format_args!("a checkpoint of {}", trainer.name), trainer.export))
}

/// Whether a file holds what `GaussianModel.capture` returns: the degree of the spherical harmonics and six
/// tensors, before what the optimizer needs. (An optimizer without a state has no names.)
fn is_of_inria(bytes: &[u8]) -> bool {
    let Ok(file) = PytorchFile::parse(bytes) else { return false };
    let pickle = &file.pickle;
    pickle.ids().any(|id| {
        let Object::Sequence(items) = pickle.object(id) else { return false };
        let Some((&degree, rest)) = items.split_first() else { return false };
        let is_tensor = |&id: &_| matches!(pickle.object(id), Object::Tensor(_));
        matches!(pickle.object(degree), Object::Integer(0..=4))
            && rest.len() >= 6
            && rest[..6].iter().all(is_tensor)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::archive::tests::{Packing, archive};

    /// Of 60 Gaussians, in the layout of gsplat's trainer: the step, and the tensors of `splats`.
    const GSPLAT: &[u8] = include_bytes!("../../tests/data/gsplat_ckpt.pt");

    fn line(bytes: &[u8]) -> String {
        let Mismatch { found, expected } = super::super::read(bytes).expect_err("an error");
        format!("found {found}, expected {expected}")
    }

    fn with_pickle(pickle: &[u8]) -> Vec<u8> {
        archive(&[("archive/data.pkl", pickle.to_vec()), ("archive/data/0", vec![0; 4])], Packing::Stored)
    }

    /// A dictionary, or a broken pickle, in which these words stand.
    fn of_words(words: &[&str]) -> Vec<u8> {
        let mut pickle = b"\x80\x02}(".to_vec();
        for word in words {
            pickle.push(b'X');
            pickle.extend((word.len() as u32).to_le_bytes());
            pickle.extend(word.as_bytes());
            pickle.extend(b"K\x01");
        }
        pickle.extend(b"u.");
        with_pickle(&pickle)
    }

    #[test]
    fn checkpoints_of_other_trainers_say_what_to_export() {
        let message = line(GSPLAT);
        assert!(
            message.contains("a checkpoint of gsplat, expected a .ply: `simple_trainer.py`"),
            "{message}"
        );
        let message = line(&of_words(&["step", "pipeline", "_model.gauss_params.means"]));
        assert!(message.contains("a checkpoint of nerfstudio, expected a .ply: `ns-export"), "{message}");
        let message = line(&of_words(&["step", "pipeline", "_model.means", "_model.quats"]));
        assert!(message.contains("a checkpoint of nerfstudio, expected a .ply: `ns-export"), "{message}");
        let message = line(&of_words(&["step", "pipeline", "_model.field.mlp.0.weight"]));
        assert!(
            message.contains("a checkpoint of nerfstudio that has no Gaussians, expected one of Gaussians"),
            "{message}"
        );
        let message = line(&of_words(&["xyz", "f_dc", "f_rest", "opacity", "scaling"]));
        assert!(message.contains("a checkpoint of 3DGS, expected a .ply: training saves"), "{message}");
        // A class of the trainer's own code, which no reader knows.
        let message = line(&with_pickle(b"\x80\x02cscene.gaussian_model\nGaussianModel\n)R."));
        assert!(message.contains("a checkpoint of 3DGS"), "{message}");
        let message = line(&of_words(&["weights"]));
        assert!(message.contains("other contents"), "{message}");
    }

    #[test]
    fn a_captured_model_is_known_by_its_tuple() {
        let mut tensor = b"ctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storage".to_vec();
        tensor.extend(b"ctorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpuK\x01tQK\x00))\x89NtR");
        let pickle =
            [&b"\x80\x02((K\x03"[..], &tensor.repeat(6), b"}G\x3f\xf0\0\0\0\0\0\0tM\x30\x75t."].concat();
        let message = line(&with_pickle(&pickle));
        assert!(message.contains("a checkpoint of 3DGS"), "{message}");
    }
}
