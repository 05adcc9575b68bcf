//! The sizes at which each row is measured.

/// The sizes of a run, chosen for its time on this machine.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Whether it is the quick run.
    pub quick: bool,
    /// Whether the adapter is a GPU and not a software adapter.
    pub on_gpu: bool,
}

impl Plan {
    /// The plan of a run.
    pub fn new(quick: bool, on_gpu: bool) -> Self {
        Self { quick, on_gpu }
    }

    /// Gaussians of the style pass on the adapter. A software adapter takes seconds for a few thousand.
    pub fn style_sizes(&self) -> &'static [usize] {
        match (self.on_gpu, self.quick) {
            (true, true) => &[20_000, 300_000],
            (true, false) => &[20_000, 100_000, 300_000, 1_000_000, 3_000_000],
            (false, true) => &[4096],
            (false, false) => &[4096, 20_000],
        }
    }

    /// Gaussians of the comparisons with the literal method, in WGSL and in PyTorch.
    pub fn literal_size(&self) -> usize {
        if self.on_gpu { 300_000 } else { 4096 }
    }

    /// Gaussians of the decoder on the CPU.
    pub fn cpu_sizes(&self) -> &'static [usize] {
        if self.quick { &[20_000] } else { &[20_000, 100_000, 300_000] }
    }

    /// Gaussians of scenes that are read.
    pub fn file_size(&self) -> usize {
        if self.quick { 100_000 } else { 1_000_000 }
    }

    /// Gaussians of frames.
    pub fn frame_sizes(&self) -> &'static [usize] {
        match (self.on_gpu, self.quick) {
            (true, true) => &[100_000, 300_000],
            (true, false) => &[50_000, 100_000, 300_000, 1_000_000, 3_000_000],
            (false, true) => &[100_000],
            (false, false) => &[50_000, 100_000, 300_000],
        }
    }

    /// Pictures of frames, in pixels.
    pub fn pictures(&self) -> &'static [[u32; 2]] {
        match (self.on_gpu, self.quick) {
            (_, true) => &[[512, 512]],
            (true, false) => &[[512, 512], [1280, 720], [1920, 1080]],
            (false, false) => &[[512, 512], [1280, 720]],
        }
    }

    /// Sizes of the table that this run leaves out, with the reason.
    pub fn left_out(&self) -> Vec<(&'static str, &'static str)> {
        let mut left_out = Vec::new();
        if !self.on_gpu {
            left_out.push(("style pass, 100k to 3M", "a software adapter takes seconds for each 20k"));
            left_out.push(("frames, 1M and 3M", "a software adapter takes seconds for each frame"));
        }
        if self.quick {
            left_out.push(("the other sizes", "--quick"));
        }
        left_out
    }
}
