//! The judge beside hand-worked numbers and a reference in Python.

#[expect(dead_code, reason = "written for the tests of the library, of which these use a part")]
#[path = "../../../tests/support/mod.rs"]
mod support;

use glam::UVec2;

use super::*;

#[test]
fn paintings_are_ranked_by_their_error() {
    // Three layers of one channel: mean and deviation.
    let statistics = |mean: f32| vec![vec![mean, 1.0]; 3];
    let targets = [0.0, 2.0, 1.0, 2.0].map(statistics);
    let rank_of = |own| rank(&statistics(1.2), targets.iter(), own);
    assert_eq!([0, 1, 2, 3].map(rank_of), [4, 2, 1, 3]);
    let broken = vec![vec![f32::NAN, 1.0]; 3];
    assert_eq!(rank(&broken, targets.iter(), 2), 1, "nothing is nearer than what cannot be compared");
}

/// A picture of 64 x 64 pixels from a formula that Python can repeat.
fn picture(k: usize) -> Vec<[f32; 3]> {
    let color = |i: usize| {
        let (x, y) = (i % 64, i / 64);
        let steps = [(x * 7 + y * 3 * k) % 31, (x * y * k + 5) % 17, (x + 2 * y + k) % 23];
        [steps[0] as f32 / 30.0, steps[1] as f32 / 16.0, steps[2] as f32 / 22.0]
    };
    (0..64 * 64).map(color).collect()
}

/// The numbers are from a program in numpy that computes luminance, VGG-19 and statistics in another way
/// (im2col, f32). Picture 1 counts in rows 20 and on and in columns up to 49; picture 2 is the painting.
#[test]
fn texture_agrees_with_a_reference() {
    let Some(vgg) = support::data("vgg") else { return };
    let judge = Judge::open(&vgg.join("vgg19_normalised_relu3_1.safetensors"), None, false).unwrap();
    let is_seen = |i: usize| i / 64 >= 20 && i % 64 < 50;
    let color = |(i, color)| if is_seen(i) { color } else { [0.0; 3] };
    let view = RenderedImage {
        size: UVec2::splat(64),
        color: picture(1).into_iter().enumerate().map(color).collect(),
        alpha: (0..64 * 64).map(|i| f32::from(u8::from(is_seen(i)))).collect(),
        depth: vec![1.0; 64 * 64],
    };
    let look = judge.look(&view).unwrap();
    let painting = Image { width: 64, height: 64, rgb: picture(2).into_flattened(), alpha: None };
    let target = judge.painting(&painting).unwrap();
    let errors = style_errors(&look.texture, &target.texture);
    for (found, expected) in errors.into_iter().zip([0.021_739_64, 0.107_380_26, 1.507_503]) {
        assert!((found / expected - 1.0).abs() < 1e-3, "{errors:?}");
    }
    assert!((look.grain - 4.509_348).abs() < 1e-4, "{}", look.grain);
    assert!((target.grain - 4.497_631).abs() < 1e-4, "{}", target.grain);
}
