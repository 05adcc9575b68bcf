//! The steps from an image to the texture of its strokes, and the places of all pictures on the way.

use stylegaussian::{
    paint::redraw,
    strokes::{FINE_SIDE, WIDE_SIDE},
};
use stylegaussian_shaders::paint::{self as shaders, PaintPicture, PaintStage as Stage, PaintStep};

/// One dispatch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub stage: Stage,
    pub uniforms: PaintStep,
    pub workgroups: [u32; 2],
}

/// A level of a texture among the packed texels.
#[derive(Clone, Copy, Debug)]
pub(super) struct PackedLevel {
    pub is_wide: bool,
    pub level: u32,
    pub side: u32,
    /// Its first texel.
    pub first: u32,
    /// Texels from a row to the next.
    pub stride: u32,
}

/// The sizes that a plan is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PlanKey {
    /// Width and height of the painting, in pixels.
    pub original: [u32; 2],
    /// Width and height at which it is read, or `None` if only its pixels are.
    pub reading: Option<[u32; 2]>,
    /// Channels of the image.
    pub n_channels: u32,
    /// Whether its colors are linear.
    pub is_linear: bool,
}

/// All steps.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub steps: Vec<Step>,
    /// Pixels that all pictures take.
    pub n_pixels: u32,
    /// Levels of both textures.
    pub levels: Vec<PackedLevel>,
    /// Packed texels.
    pub n_packed: u32,
}

/// Packed texels of a row at least: copies to textures take rows of a multiple of 256 bytes.
const LEAST_STRIDE: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT / 4;

/// Hands out places in the buffer of pictures.
#[derive(Default)]
struct Places {
    end: u32,
}

impl Places {
    /// A picture of a size behind all others.
    fn picture(&mut self, [width, height]: [u32; 2], shrunk: f32) -> PaintPicture {
        let picture = PaintPicture { first: self.end, width, height, shrunk };
        self.end += width * height;
        picture
    }
}

/// The size of a picture.
fn size(picture: &PaintPicture) -> [u32; 2] {
    [picture.width, picture.height]
}

/// Half a size, rounded up.
fn half(picture: &PaintPicture) -> [u32; 2] {
    size(picture).map(|side| side.div_ceil(2))
}

impl Plan {
    pub fn new(key: PlanKey) -> Self {
        let levels = packed_levels();
        let last = levels[levels.len() - 1];
        let mut places = Places::default();
        let original = places.picture(key.original, 1.0);
        let mut plan =
            Self { steps: Vec::new(), n_pixels: 0, n_packed: last.first + last.side * last.stride, levels };
        let read = PaintStep {
            output: original,
            packed: key.n_channels,
            is_linear: u32::from(key.is_linear),
            ..PaintStep::default()
        };
        plan.on_pixels(Stage::Read, read);
        if let Some(reading) = key.reading {
            plan.redraw(&mut places, original, reading);
        }
        plan.n_pixels = places.end;
        plan
    }

    /// The steps from the painting to its texture.
    fn redraw(&mut self, places: &mut Places, original: PaintPicture, reading: [u32; 2]) {
        let fine: Vec<_> = sides(FINE_SIDE).map(|side| places.picture([side; 2], 1.0)).collect();
        let wide: Vec<_> = sides(WIDE_SIDE).map(|side| places.picture([side; 2], 1.0)).collect();
        let n_largest = (original.width * original.height).max(reading[0] * reading[1]);
        // What is read right after it is written. A painting has no more pixels than fine detail, which is
        // written at last.
        let rows = places.picture([n_largest, 1], 1.0).first;
        let scratch = |[width, height]: [u32; 2]| PaintPicture { width, height, ..fine[0] };
        let soft = redraw::softening(size(&original), reading).map(|sigma| {
            let soft = scratch(size(&original));
            self.blur(original, soft, sigma, rows);
            soft
        });
        let mut copies = vec![places.picture(reading, redraw::SHRUNK[0])];
        let resize = PaintStep { input: soft.unwrap_or(original), output: copies[0], ..PaintStep::default() };
        self.on_pixels(Stage::Resize, resize);
        for ((is_halved, sigma), shrunk) in redraw::copy_steps().into_iter().zip(&redraw::SHRUNK[1..]) {
            let last = copies[copies.len() - 1];
            let input = if is_halved { self.halve(last, scratch(half(&last)).first) } else { last };
            let copy = places.picture(size(&input), *shrunk);
            self.blur(input, copy, sigma, rows);
            copies.push(copy);
        }
        let copies = [copies[0], copies[1], copies[3], copies[5]];
        let squares = PaintPicture { first: rows, ..copies[0] };
        self.on_pixels(Stage::Squares, PaintStep { output: squares, copies, ..PaintStep::default() });
        let halved = self.halve(squares, fine[0].first);
        let quarter = self.halve(halved, fine[0].first + halved.width * halved.height);
        let around = places.picture(size(&quarter), 0.25);
        self.blur(quarter, around, redraw::AROUND, rows);
        let sums = places.picture([2, 1], 1.0).first;
        self.sum(places, original, sums);
        self.sum(places, around, sums + 1);
        let detail = PaintStep { original, around, copies, sums, ..PaintStep::default() };
        for (which, levels) in [(0, &fine), (1, &wide)] {
            self.on_pixels(Stage::Detail, PaintStep { output: levels[0], which, ..detail });
        }
        let pictures = fine.iter().map(|picture| (false, picture));
        let pictures: Vec<_> = pictures.chain(wide.iter().map(|picture| (true, picture))).collect();
        for (i, (is_wide, input)) in pictures.iter().enumerate() {
            // The last level has none behind it, and the kernel writes none.
            let next = pictures.get(i + 1).filter(|(of, _)| of == is_wide).map_or(*input, |(_, next)| *next);
            let PackedLevel { first, stride, .. } = self.levels[i];
            let level =
                PaintStep { input: **input, output: *next, packed: first, stride, ..PaintStep::default() };
            self.push(Stage::Level, level, size(input));
        }
    }

    /// A step with an invocation for each pixel that is written.
    fn on_pixels(&mut self, stage: Stage, uniforms: PaintStep) {
        self.push(stage, uniforms, size(&uniforms.output));
    }

    fn push(&mut self, stage: Stage, uniforms: PaintStep, invocations: [u32; 2]) {
        let workgroups = invocations.map(|n| n.div_ceil(shaders::PAINT_SIDE));
        self.steps.push(Step { stage, uniforms, workgroups });
    }

    /// Blurs `input` into `output`, by way of the pictures' pixels from `rows` on.
    fn blur(&mut self, input: PaintPicture, output: PaintPicture, sigma: f32, rows: u32) {
        let between = PaintPicture { first: rows, ..input };
        let blur = PaintStep { sigma, reach: redraw::reach(sigma), ..PaintStep::default() };
        let [width, height] = size(&input);
        let [columns, rows] = [width, height].map(|side| side.div_ceil(shaders::PAINT_BLURRED));
        self.push(Stage::Blur, PaintStep { input, output: between, ..blur }, [columns, height]);
        self.push(Stage::Blur, PaintStep { input: between, output, which: 1, ..blur }, [width, rows]);
    }

    /// Halves a picture, into the pixels from `first` on.
    fn halve(&mut self, input: PaintPicture, first: u32) -> PaintPicture {
        let [width, height] = half(&input);
        let output = PaintPicture { first, width, height, shrunk: 1.0 };
        self.on_pixels(Stage::Halve, PaintStep { input, output, ..PaintStep::default() });
        output
    }

    /// Sums up a picture, into the pixel `into`.
    fn sum(&mut self, places: &mut Places, mut input: PaintPicture, into: u32) {
        loop {
            let n = (input.width * input.height).div_ceil(shaders::PAINT_SUMMED);
            let output = match n {
                0 | 1 => PaintPicture { first: into, width: 1, height: 1, shrunk: 1.0 },
                _ => places.picture([n, 1], 1.0),
            };
            let uniforms = PaintStep { input, output, ..PaintStep::default() };
            self.steps.push(Step { stage: Stage::Sum, uniforms, workgroups: [n.max(1), 1] });
            if n <= 1 {
                return;
            }
            input = output;
        }
    }
}

/// The sides of the levels of a texture.
fn sides(side: usize) -> impl Iterator<Item = u32> {
    (0..=side.ilog2()).map(move |level| side as u32 >> level)
}

/// The levels of both textures, one behind the other.
fn packed_levels() -> Vec<PackedLevel> {
    let mut first = 0;
    let mut levels = Vec::new();
    for (is_wide, side) in [(false, FINE_SIDE), (true, WIDE_SIDE)] {
        for (level, side) in (0..).zip(sides(side)) {
            let stride = side.max(LEAST_STRIDE);
            levels.push(PackedLevel { is_wide, level, side, first, stride });
            first += side * stride;
        }
    }
    levels
}
