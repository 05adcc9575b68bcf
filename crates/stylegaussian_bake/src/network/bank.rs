//! Fixed oriented filters on luminance and opponent colors, both signs rectified: strokes of several sizes.

use stylegaussian_encoder::chain::{Chain, Convolution, Kernel, Operation, Padding};

use crate::luminance::LUMINANCE;

/// Opponent colors: red - green and yellow - blue.
const OPPONENT: [[f32; 3]; 2] = [[0.5, -0.5, 0.0], [0.25, 0.25, -0.5]];

/// Luminances, over 0..1, beyond which lights and darks are measured.
const THRESHOLDS: [f32; 3] = [0.25, 0.5, 0.75];

/// Binomial low-pass, the outer product of [1 2 1] / 4 with itself.
const LOW_PASS: [f32; 9] = [1., 2., 1., 2., 4., 2., 1., 2., 1.];
/// First derivatives (Sobel) along four directions 45 degrees apart.
const FIRST: [[f32; 9]; 4] = [
    [-1., 0., 1., -2., 0., 2., -1., 0., 1.],
    [0., 1., 2., -1., 0., 1., -2., -1., 0.],
    [1., 2., 1., 0., 0., 0., -1., -2., -1.],
    [2., 1., 0., 1., 0., -1., 0., -1., -2.],
];
/// Second derivatives along the same directions: lines.
const SECOND: [[f32; 9]; 4] = [
    [-1., 2., -1., -2., 4., -2., -1., 2., -1.],
    [-1., -1., 2., -1., 2., -1., 2., -1., -1.],
    [-1., -2., -1., 2., 4., 2., -1., -2., -1.],
    [2., -1., -1., -1., 2., -1., -1., -1., 2.],
];

/// Filters on the picture after `halvings`, each the mean of 2x2 pixels: 3x3 windows.
pub(super) fn filters_after(halvings: usize) -> Chain {
    let mut operations: Vec<Operation> = (0..halvings).map(|_| Operation::Convolution(halve())).collect();
    operations.extend(filters());
    Chain::new(3, operations).expect("each operation takes the channels of the one before it")
}

/// The mean of 2x2 pixels.
fn halve() -> Convolution {
    let mut halve = vec![0.0; 3 * 3 * 4];
    for channel in 0..3 {
        halve[(channel * 3 + channel) * 4..][..4].fill(0.25);
    }
    let kernel = Kernel { shape: [3, 3, 2, 2], weight: halve, bias: vec![0.0; 3] };
    Convolution::strided(&kernel, Padding::Zeros(0), 2).expect("the kernel has its shape")
}

/// The filters, and both signs of each.
fn filters() -> [Operation; 2] {
    let (mut oihw, mut bias): (Vec<f32>, Vec<f32>) = (Vec::new(), Vec::new());
    let mut add = |color: [f32; 3], kernel: &[f32; 9], gain: f32, threshold: f32| {
        // So that a step of 1 along the filter's direction gives `gain`.
        let positive: f32 = kernel.iter().map(|weight| weight.max(0.0)).sum();
        bias.push(-gain * threshold);
        for channel in color {
            oihw.extend(kernel.iter().map(|weight| gain * channel * weight / positive));
        }
    };
    // Means are compared too, and those of luminance are the palette's. Derivatives are some ten times smaller
    // than the colors themselves, on paintings; the gains make up for it.
    add(LUMINANCE, &LOW_PASS, 6.0, 0.0);
    // Lights and darks beyond each threshold: together they tell a drawing on paper from a painting of middle
    // tones, which may have the same mean and deviation.
    for threshold in THRESHOLDS {
        add(LUMINANCE, &LOW_PASS, 6.0, threshold);
    }
    for kernel in FIRST.iter().chain(&SECOND) {
        add(LUMINANCE, kernel, 8.0, 0.0);
    }
    for color in OPPONENT {
        add(color, &LOW_PASS, 8.0, 0.0);
        for kernel in [FIRST[0], FIRST[2]] {
            add(color, &kernel, 16.0, 0.0);
        }
    }
    let n = bias.len();
    let kernel = Kernel { shape: [n, 3, 3, 3], weight: oihw, bias };
    let filters = Convolution::new(&kernel, Padding::Reflect([1, 1])).expect("the kernel has its shape");
    [Operation::Convolution(filters), Operation::BothSigns]
}
