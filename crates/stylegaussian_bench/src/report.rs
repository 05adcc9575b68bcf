//! Rows, ratios, and the table of them.

use anyhow::Result;
use serde::{Serialize, Serializer};

use crate::{gpu::Gpu, measure::Samples};

/// One measurement at one size.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Name of the row.
    pub name: String,
    /// Number of Gaussians, the side of a matrix, or the number of bytes copied.
    pub n: u64,
    /// Median of all runs.
    pub median_ms: f64,
    /// The fastest run.
    pub min_ms: f64,
    /// The slowest run.
    pub max_ms: f64,
    /// Processor time per run, over all threads.
    pub cpu_ms: Option<f64>,
    /// Memory on the GPU, or in the CPU's arrays.
    pub bytes: Option<u64>,
    /// Bytes that one run reads and writes, with each gathered row counted.
    pub moved: Option<u64>,
    /// Number of multiplications and additions of one run.
    pub flops: Option<u64>,
    /// Peak signal-to-noise ratio to the reference, in dB.
    pub psnr_db: Option<f64>,
}

/// A row that could not run, and the reason.
#[derive(Clone, Debug, Serialize)]
pub struct NotRun {
    /// Name of the row or rows.
    pub name: String,
    /// The reason.
    pub reason: String,
}

/// Numbers by name, in order, `None` if a row of one could not run.
type Named = Vec<(&'static str, Option<f64>)>;

/// Reading of a format. Smaller is better.
#[derive(Clone, Debug, Serialize)]
pub struct FileRatios {
    /// The format.
    pub name: String,
    /// Bytes of its file per Gaussian.
    pub bytes_per_gaussian: f64,
    /// The time of reading, relative to decompressing the file's bytes alone, or to copying them if the format
    /// has no compression.
    pub read_over_unpack: f64,
    /// The most memory while reading, the file included, relative to what the scene holds.
    pub peak_over_held: f64,
}

/// All results.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The GPU adapter and its driver.
    pub adapter: String,
    /// Processor and number of cores.
    pub machine: String,
    /// Rows in the order of measuring.
    pub rows: Vec<Row>,
    /// Rows that could not run.
    pub not_run: Vec<NotRun>,
    /// Ratios of reading, one for each format.
    pub files: Vec<FileRatios>,
    /// Ratios of rows: see [`Report::compare`].
    #[serde(serialize_with = "as_map")]
    pub ratios: Named,
    /// Growth of times, likewise.
    #[serde(serialize_with = "as_map")]
    pub exponents: Named,
}

/// The names of rows that are compared.
pub mod names {
    pub const PRODUCT: &str = "product, WGSL f32";
    pub const COPY: &str = "copy, WGSL";
    pub const CPU_PRODUCT: &str = "product, CPU f32";
    pub const CPU_DECODE: &str = "decode, CPU";
    pub const CPU_UNFOLDED: &str = "decode, CPU, literal";
    pub const STYLE_PASS: &str = "style pass";
    pub const LITERAL: &str = "style pass, literal f32";
    pub const PYTORCH: &str = "style pass, literal, PyTorch f32";
    pub const MEMORY: &str = "memory of the style pass";
    pub const FRAME: &str = "frame, structured, 512x512";
    pub const PEER: &str = "frame, structured, 512x512, peer";
    pub const PLAIN: &str = "light, none";
    pub const MSAA: &str = "light, MSAA 4";
    pub const TWO_EYES: &str = "light, two eyes";
    pub const HALF_SIZE: &str = "light, half size";
    pub const CASTING: &str = "light, casting";
    pub const CASTING_ANEW: &str = "light, casting anew";
    pub const ALL_LIGHT: &str = "light, tint, fog, shadows and depth";
}

/// Bytes per Gaussian of the literal method without stored gathers: features and the two largest activations in
/// f32, (256 + 256 + 128) * 4, and 8 neighbors of 4 bytes each.
pub const LITERAL_BYTES: f64 = 2592.0;

impl Row {
    /// A row with the times of `samples`.
    pub fn new(name: impl Into<String>, n: usize, samples: &Samples) -> Self {
        Self {
            name: name.into(),
            n: n as u64,
            median_ms: samples.median(),
            min_ms: samples.least(),
            max_ms: samples.most(),
            cpu_ms: samples.cpu_ms,
            bytes: None,
            moved: None,
            flops: None,
            psnr_db: None,
        }
    }

    /// A row with bytes alone.
    pub fn of_memory(name: impl Into<String>, n: usize, bytes: u64) -> Self {
        let nothing = Samples { ms: vec![0.0], cpu_ms: None };
        Self { bytes: Some(bytes), ..Self::new(name, n, &nothing) }
    }

    /// A row with a peak signal-to-noise ratio alone.
    pub fn of_picture(name: impl Into<String>, n: usize, psnr_db: f64) -> Self {
        Self { bytes: None, psnr_db: Some(psnr_db), ..Self::of_memory(name, n, 0) }
    }

    /// Operations per second.
    fn rate(&self) -> Option<f64> {
        Some(self.flops? as f64 / (self.median_ms * 1e-3))
    }
}

impl Report {
    /// An empty report.
    pub fn new(gpu: Option<&Gpu>) -> Self {
        Self {
            adapter: gpu.map_or_else(|| "no adapter".into(), Gpu::name),
            machine: machine(),
            rows: Vec::new(),
            not_run: Vec::new(),
            files: Vec::new(),
            ratios: Vec::new(),
            exponents: Vec::new(),
        }
    }

    /// Adds a row and prints it.
    pub fn add(&mut self, row: Row) {
        eprintln!("   {}", line(&row).trim_end());
        self.rows.push(row);
    }

    /// Notes why a row is missing.
    pub fn not_run(&mut self, name: &str, reason: &str) {
        eprintln!("   {name}: NOT RUN, {reason}");
        self.not_run.push(NotRun { name: name.into(), reason: reason.into() });
    }

    /// The row `name` at size `n`, or at its largest size if `n` is `None`.
    fn row(&self, name: &str, n: Option<u64>) -> Option<&Row> {
        let rows = self.rows.iter().filter(|row| row.name == name && n.is_none_or(|n| row.n == n));
        rows.max_by_key(|row| row.n)
    }

    /// Factor by which `x` is faster than `y`, at the size of `y`.
    fn faster(&self, x: &str, y: &str) -> Option<f64> {
        let y = self.row(y, None)?;
        Some(y.median_ms / self.row(x, Some(y.n))?.median_ms)
    }

    /// The exponent of a row's time between two sizes.
    fn exponent(&self, name: &str, [from, to]: [u64; 2]) -> Option<f64> {
        let times = self.row(name, Some(to))?.median_ms / self.row(name, Some(from))?.median_ms;
        // t2 / t1 = (n2 / n1)^e.
        Some(times.ln() / (to as f64 / from as f64).ln())
    }

    /// Computes ratios and growth.
    ///
    /// For speeds, `x_over_y` is the time of y divided by the time of x; larger is better. `*_product*` is our
    /// rate of operations divided by that of a plain matrix product. Growth is the exponent e of N^e between
    /// two numbers of Gaussians: 1 is linear, and smaller is better.
    pub fn compare(&mut self) {
        // Both at the size at which they were measured in turns.
        let of_product = |name: &str, size_of: &str, product: &str| {
            let ours = self.row(name, Some(self.row(size_of, None)?.n))?;
            Some(ours.rate()? / self.row(product, None)?.rate()?)
        };
        let memory = self.row(names::MEMORY, None);
        let memory = memory.and_then(|row| Some(row.bytes? as f64 / (LITERAL_BYTES * row.n as f64)));
        let frames = |name: &str, n: u64| self.row(name, Some(n))?.cpu_ms;
        let peer = self.row(names::PEER, None);
        let peer = peer.and_then(|row| Some(frames(names::FRAME, row.n)? / frames(names::PEER, row.n)?));
        let ms = |name: &str| self.row(name, None).map(|row| row.median_ms);
        let cost = |name: &str| Some(ms(name)? / ms(names::PLAIN)?);
        self.ratios = vec![
            // The CPU's decoder on folded, 32-wide features, relative to the same one on 256-wide features.
            ("folded_over_unfolded_cpu", self.faster(names::CPU_DECODE, names::CPU_UNFOLDED)),
            // Rate of the CPU's decoder, relative to a plain product.
            (
                "cpu_decode_over_product",
                of_product(names::CPU_DECODE, names::CPU_UNFOLDED, names::CPU_PRODUCT),
            ),
            // The style pass, relative to the literal method in WGSL: 256-wide, unfolded, f32.
            ("style_pass_over_literal_wgsl", self.faster(names::STYLE_PASS, names::LITERAL)),
            // The same in PyTorch, f32 without TF32.
            ("style_pass_over_pytorch", self.faster(names::STYLE_PASS, names::PYTORCH)),
            // Rate of the style pass, relative to a plain f32 product in WGSL.
            ("style_pass_over_product_rate", of_product(names::STYLE_PASS, names::LITERAL, names::PRODUCT)),
            // Our bytes for features, neighbors and scratch, relative to the literal method. Smaller is better.
            ("style_memory_over_literal", memory),
            // Processor time of our frame, relative to the peer's. Smaller is better, as in all that follow.
            ("frame_cpu_ms_over_peer", peer),
            // A frame with four samples per pixel, relative to one with one.
            ("msaa_cost", cost(names::MSAA)),
            // Two eyes, relative to one.
            ("two_eyes_cost", cost(names::TWO_EYES)),
            // A frame at half the size, relative to the whole one.
            ("half_size_cost", cost(names::HALF_SIZE)),
            // A frame with a shadow map of splats and a still light, relative to one without.
            ("casting_cost", cost(names::CASTING)),
            // The same with a light that turns.
            ("casting_anew_cost", cost(names::CASTING_ANEW)),
            // A frame with tint, fog, shadows on splats and depth, relative to one without.
            ("light_cost", cost(names::ALL_LIGHT)),
        ];
        self.exponents = vec![
            ("cpu_decode", self.exponent(names::CPU_DECODE, [20_000, 300_000])),
            ("style_pass", self.exponent(names::STYLE_PASS, [300_000, 3_000_000])),
            // Of the structured scene at 512x512.
            ("frame", self.exponent(names::FRAME, [300_000, 3_000_000])),
        ];
    }

    /// The report as JSON.
    pub fn json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// The report as a Markdown table.
    pub fn table(&self) -> String {
        let mut text = format!("\n{}\n\n{}\n\n", self.adapter, self.machine);
        text += "| row | n | median ms | min | max | CPU ms | GPU MB | GB/s | GFLOP/s | PSNR dB |\n";
        text += "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n";
        self.rows.iter().for_each(|row| text += &line(row));
        if !self.not_run.is_empty() {
            text += "\n| not run | why |\n| --- | --- |\n";
            self.not_run.iter().for_each(|it| text += &format!("| {} | {} |\n", it.name, it.reason));
        }
        if !self.files.is_empty() {
            text += "\n| format | bytes per Gaussian | read / unpack | peak / scene |\n\
                     | --- | ---: | ---: | ---: |\n";
        }
        for FileRatios { name, bytes_per_gaussian, read_over_unpack, peak_over_held } in &self.files {
            text += &format!(
                "| {name} | {bytes_per_gaussian:.1} | {read_over_unpack:.2} | {peak_over_held:.2} |\n"
            );
        }
        append_named(&mut text, "ratio", &self.ratios);
        append_named(&mut text, "exponent of N", &self.exponents);
        text
    }
}

fn as_map<S: Serializer>(values: &Named, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(values.iter().copied())
}

fn append_named(text: &mut String, title: &str, values: &[(&str, Option<f64>)]) {
    *text += &format!("\n| {title} | |\n| --- | ---: |\n");
    for (name, value) in values {
        let value = value.map_or_else(|| "not measured".into(), |value| format!("{value:.3}"));
        *text += &format!("| `{name}` | {value} |\n");
    }
}

fn line(row: &Row) -> String {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.1}"));
    let per_second = |amount: Option<u64>| number(amount.map(|n| n as f64 / (row.median_ms * 1e6)));
    // Rows of memory and of pictures have no time.
    let time = |ms: f64| if row.max_ms > 0.0 { format!("{ms:.2}") } else { String::new() };
    format!(
        "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n",
        row.name,
        row.n,
        time(row.median_ms),
        time(row.min_ms),
        time(row.max_ms),
        number(row.cpu_ms),
        number(row.bytes.map(|bytes| bytes as f64 / 1e6)),
        per_second(row.moved),
        per_second(row.flops),
        number(row.psnr_db),
    )
}

/// The processor's name, and the number of threads that it runs at once.
fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    let model = model.map_or("processor of unknown name", |(_, name)| name);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{model}, {threads} threads, {}", std::env::consts::OS)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, n: u64, median_ms: f64) -> Row {
        let samples = Samples { ms: vec![median_ms], cpu_ms: Some(2.0 * median_ms) };
        Row { flops: Some(1000), ..Row::new(name, n as usize, &samples) }
    }

    #[test]
    fn ratios_say_how_much_faster_or_smaller_ours_is() {
        let mut report = Report::new(None);
        for row in [
            row(names::PRODUCT, 512, 1.0),
            row(names::STYLE_PASS, 4096, 2.0),
            row(names::STYLE_PASS, 20_000, 2.5),
            row(names::LITERAL, 4096, 4.0),
            row(names::CPU_PRODUCT, 512, 1.0),
            row(names::CPU_DECODE, 100, 4.0),
            row(names::STYLE_PASS, 300_000, 10.0),
            row(names::STYLE_PASS, 3_000_000, 1000.0),
            row(names::CPU_UNFOLDED, 100, 6.0),
            row(names::FRAME, 100, 5.0),
            row(names::FRAME, 200, 7.0),
            row(names::PEER, 100, 20.0),
            Row::of_memory(names::MEMORY, 1000, 259_200),
            row(names::PLAIN, 100, 4.0),
            row(names::TWO_EYES, 100, 6.0),
        ] {
            report.rows.push(row);
        }
        report.compare();
        let of = |values: &Named, name: &str| values.iter().find(|(known, _)| *known == name).unwrap().1;
        let ratio = |name| of(&report.ratios, name);
        assert_eq!(ratio("style_pass_over_literal_wgsl"), Some(2.0));
        assert_eq!(ratio("style_pass_over_product_rate"), Some(0.5));
        assert_eq!(ratio("cpu_decode_over_product"), Some(0.25));
        assert_eq!(ratio("folded_over_unfolded_cpu"), Some(1.5));
        assert_eq!(ratio("frame_cpu_ms_over_peer"), Some(0.25));
        assert_eq!(ratio("style_memory_over_literal"), Some(0.1));
        assert_eq!(ratio("style_pass_over_pytorch"), None);
        assert_eq!((ratio("two_eyes_cost"), ratio("msaa_cost")), (Some(1.5), None));
        assert!((of(&report.exponents, "style_pass").unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(of(&report.exponents, "cpu_decode"), None);
        assert!(report.json().unwrap().contains("\"style_pass_over_pytorch\": null"));
        assert!(report.table().contains("| `style_pass_over_pytorch` | not measured |"));
    }
}
