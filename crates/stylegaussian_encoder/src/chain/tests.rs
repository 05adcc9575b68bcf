//! Chains against numbers worked out by hand, against finite differences, and as files.

use stylegaussian::random::Random;

use super::*;

/// The sum of a 3x3 neighborhood, less 45.
// 45 is the sum of 1 to 9, so the middle of that picture gives 0 and a shifted kernel shows.
fn box_sum(padding: Padding) -> Convolution {
    let kernel = Kernel { shape: [1, 1, 3, 3], weight: vec![1.0; 9], bias: vec![-45.0] };
    Convolution::new(&kernel, padding).unwrap()
}

/// The output on 1 2 3 / 4 5 6 / 7 8 9, and its size.
fn run(operations: Vec<Operation>) -> ([usize; 2], Vec<f32>) {
    let chain = Chain::new(1, operations).unwrap();
    let sizes = chain.sizes(Size { width: 3, height: 3 });
    let picture: Vec<f32> = (1..=9).map(|i| i as f32).collect();
    let output = chain.output(&sizes, picture.clone());
    assert_eq!(output, chain.forward(&sizes, &picture).rows(chain.last()), "both ways to run it");
    let size = sizes[chain.last()];
    ([size.width, size.height], output)
}

#[test]
fn reflection_does_not_repeat_the_border() {
    // Reflected, the rows and columns read 2 1 2 3 2: sums 33 36 39 / 42 45 48 / 51 54 57.
    let found = run(vec![Operation::Convolution(box_sum(Padding::Reflect([1, 1])))]);
    assert_eq!(found, ([3, 3], vec![-12.0, -9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0, 12.0]));
}

#[test]
fn zeros_lie_beyond_the_border() {
    // Corner 1 + 2 + 4 + 5 = 12, edge 1..6 = 21, and so on.
    let found = run(vec![Operation::Convolution(box_sum(Padding::Zeros(1)))]);
    assert_eq!(found, ([3, 3], vec![-33.0, -24.0, -29.0, -18.0, 0.0, -12.0, -21.0, -6.0, -17.0]));
}

#[test]
fn pooling_rounds_up_or_down() {
    // After the ReLU the rows read 0 0 0 / 0 0 3 / 6 9 12.
    let start = || Operation::Convolution(box_sum(Padding::Reflect([1, 1])).rectified());
    let pooled = |ceil| run(vec![start(), Operation::MaxPool { ceil }]);
    assert_eq!(pooled(true), ([2, 2], vec![0.0, 3.0, 9.0, 12.0]));
    assert_eq!(pooled(false), ([1, 1], vec![0.0]));
}

#[test]
fn doubling_repeats_pixels() {
    let found = run(vec![Operation::MaxPool { ceil: true }, Operation::Double]);
    #[rustfmt::skip]
    let expected = vec![
        5.0, 5.0, 6.0, 6.0,
        5.0, 5.0, 6.0, 6.0,
        8.0, 8.0, 9.0, 9.0,
        8.0, 8.0, 9.0, 9.0,
    ];
    assert_eq!(found, ([4, 4], expected));
}

#[test]
fn sums_are_of_values_that_are_kept() {
    // x + (x + x), where the first x is needed twice.
    let found = run(vec![Operation::Add(0), Operation::Add(0)]);
    assert_eq!(found.1, (1..=9).map(|i| 3.0 * i as f32).collect::<Vec<_>>());
}

#[test]
fn a_picture_smaller_than_a_kernel_is_not_taken() {
    let chain = Chain::new(1, vec![Operation::Convolution(box_sum(Padding::Zeros(0)))]).unwrap();
    let square = |side| Size { width: side, height: side };
    assert!(!chain.takes(square(2)) && chain.takes(square(3)));
    let halved = Chain::new(1, vec![Operation::MaxPool { ceil: false }; 3]).unwrap();
    assert!(!halved.takes(square(7)) && halved.takes(square(8)));
    // Sums of pictures of two sizes.
    let uneven = Chain::new(1, vec![Operation::MaxPool { ceil: true }, Operation::Add(0)]).unwrap();
    assert!(!uneven.takes(square(8)) && uneven.takes(square(1)));
    let enlarged = Chain::new(1, vec![Operation::Double; 200]).unwrap();
    assert!(enlarged.largest(square(64)) > 1e30);
}

fn random_values(n: usize, scale: f32, random: &mut Random) -> Vec<f32> {
    (0..n).map(|_| scale * random.normal()).collect()
}

/// A chain with every operation, on 3 channels.
fn every_operation() -> Chain {
    let mut random = Random::new(1);
    let mut convolution = |out: usize, inputs: usize, side: usize, padding, stride| {
        let kernel = Kernel {
            shape: [out, inputs, side, side],
            weight: random_values(out * inputs * side * side, 0.4, &mut random),
            bias: random_values(out, 0.1, &mut random),
        };
        Operation::Convolution(Convolution::strided(&kernel, padding, stride).unwrap().rectified())
    };
    let operations = vec![
        convolution(4, 3, 3, Padding::Reflect([1, 1]), 1),
        convolution(4, 4, 3, Padding::Zeros(1), 1),
        Operation::Add(1),
        Operation::MaxPool { ceil: true },
        Operation::Double,
        Operation::BothSigns,
        convolution(5, 8, 2, Padding::Reflect([0, 1]), 2),
    ];
    Chain::new(3, operations).unwrap()
}

#[test]
fn channels_follow_operations() {
    let chain = every_operation();
    let channels: Vec<usize> = (0..=chain.last()).map(|value| chain.channels(value)).collect();
    assert_eq!(channels, [3, 4, 4, 4, 4, 4, 8, 5]);
}

#[test]
fn a_chain_that_nobody_waits_for_goes_no_further() {
    let (chain, mut random) = (every_operation(), Random::new(2));
    let size = Size { width: 12, height: 10 };
    let sizes = chain.sizes(size);
    let picture = random_values(size.n_pixels() * 3, 1.0, &mut random);
    let n = chain.operations().len();
    // Stopped before the first operation, and after each other one but the last.
    for stop in 0..n {
        let own = std::sync::Arc::new(std::sync::OnceLock::<Work>::new());
        let known = std::sync::Arc::clone(&own);
        let telling = Work::telling(move |share| {
            if share * n as f32 > stop as f32 - 0.5 {
                known.get().unwrap().cancel();
            }
        });
        let work = own.get_or_init(|| telling);
        if stop == 0 {
            work.cancel();
        }
        assert_eq!(chain.output_if_wanted(&sizes, picture.clone(), work), Err(Canceled), "{stop}");
        assert!((work.done() * n as f32 - stop.max(1) as f32).abs() < 0.5, "{stop}: {}", work.done());
    }
    // Within an operation, no line is computed any more.
    let (canceled, convolution) = (Work::default(), box_sum(Padding::Zeros(1)));
    canceled.cancel();
    let nine = Size { width: 3, height: 3 };
    assert_eq!(convolution.forward(&[1.0; 9], nine, &canceled), [0.0; 9]);
    assert_ne!(convolution.forward(&[1.0; 9], nine, &Work::default()), [0.0; 9]);
}

#[test]
fn gradients_match_finite_differences() {
    let (chain, mut random) = (every_operation(), Random::new(3));
    let size = Size { width: 7, height: 5 };
    let sizes = chain.sizes(size);
    let rgb: Vec<f32> = (0..size.n_pixels() * 3).map(|_| random.uniform()).collect();
    let values = chain.forward(&sizes, &rgb);
    // Two values: the gradient flows through all operations, and sums where it meets itself.
    let watched = [1, chain.last()];
    let directions = watched.map(|value| random_values(values.rows(value).len(), 1.0, &mut random));
    let loss = |rgb: &[f32]| -> f64 {
        let values = chain.forward(&sizes, rgb);
        let dot = |(value, direction): (&usize, &Vec<f32>)| -> f64 {
            values.rows(*value).iter().zip(direction).map(|(a, b)| f64::from(a * b)).sum()
        };
        watched.iter().zip(&directions).map(dot).sum()
    };
    let mut grads = vec![None; chain.last() + 1];
    for (value, direction) in watched.iter().zip(&directions) {
        grads[*value] = Some(direction.clone());
    }
    let grad = chain.backward(&sizes, &values, grads).unwrap();
    // Small, so that few ReLUs and maxima switch in between; those that do may spoil a few.
    let step = 3e-4;
    let wrong = (0..rgb.len()).filter(|&i| {
        let moved = |by: f32| {
            let mut rgb = rgb.clone();
            rgb[i] += by;
            loss(&rgb)
        };
        let expected = (moved(step) - moved(-step)) / f64::from(2.0 * step);
        (expected - f64::from(grad[i])).abs() > 0.02 * (1.0 + expected.abs())
    });
    let wrong = wrong.count();
    assert!(wrong <= rgb.len() / 30, "{wrong} of {}", rgb.len());
}

#[test]
fn a_file_gives_the_chain_that_was_written() {
    let chain = every_operation();
    let id: stylegaussian::EncoderId = "small@0123456789abcdef".parse().unwrap();
    let notes = [("teacher", "vgg@0123".into()), ("date", "a day".into())];
    let bytes = chain.to_bytes(Some(&id), &notes);
    assert_eq!(bytes, chain.to_bytes(Some(&id), &notes), "the same chain, the same file");
    let read = Chain::from_bytes(&bytes).unwrap();
    assert_eq!(read.id, Some(id));
    let size = Size { width: 13, height: 11 };
    let mut random = Random::new(2);
    let rgb: Vec<f32> = (0..size.n_pixels() * 3).map(|_| random.uniform()).collect();
    let sizes = chain.sizes(size);
    assert_eq!(read.chain.output(&sizes, rgb.clone()), chain.output(&sizes, rgb));
}

#[test]
fn broken_files_are_refused() {
    let bytes = every_operation().to_bytes(None, &[]);
    for end in (0..bytes.len()).step_by(97) {
        assert!(Chain::from_bytes(&bytes[..end]).is_err(), "{end} of {} bytes", bytes.len());
    }
    let replaced = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let text = String::from_utf8_lossy(&bytes[..2000]);
        let at = text.find(from).unwrap_or_else(|| panic!("no {from} in {text}"));
        let mut bytes = bytes.clone();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        Chain::from_bytes(&bytes).err().unwrap_or_else(|| panic!("{to} was read"))
    };
    for (from, to, message) in [
        (r#""network":"#, r#""netware":"#, "no metadata `network`"),
        (r#"version\":1"#, r#"version\":2"#, "found version 2"),
        (r#"add\":1"#, r#"add\":9"#, "adds value 9"),
        (r#"stride\":2"#, r#"stride\":3"#, "a stride of 3"),
        ("both_signs", "both_sines", "both_sines"),
        ("0.weight", "9.weight", "no tensor `0.weight`"),
        (r#"channels\":3"#, r#"channels\":4"#, "expected the 4"),
        (r#"channels\":3"#, r#"channels\":0"#, "0 channels"),
    ] {
        let error = replaced(from, to);
        assert!(error.contains(message), "{to}: {error}");
    }
}
