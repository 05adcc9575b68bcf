//! Random numbers that are equal on every machine and in every version.

/// SplitMix64 (Steele, Lea and Flood 2014).
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

impl Random {
    /// Starts the sequence of `seed`.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        hash(self.state)
    }

    /// Uniform in 0..=1 without 0: the middle of one of 2^24 steps.
    pub fn uniform(&mut self) -> f32 {
        // Above 2^23 an f32 has no bit for the half, so the last step rounds to 1.
        ((self.next() >> 40) as f32 + 0.5) / (1_u32 << 24) as f32
    }

    /// Uniform in 0..n, or 0 if n is 0.
    pub fn below(&mut self, n: usize) -> usize {
        // The remainder favors small numbers by at most n / 2^64.
        (self.next() % (n.max(1) as u64)) as usize
    }

    /// Standard normal (Box and Muller).
    pub fn normal(&mut self) -> f32 {
        // `uniform` is never 0, so the logarithm is finite.
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f32::consts::TAU * self.uniform()).cos()
    }

    /// The numbers 0..n in random order (Fisher and Yates).
    pub fn permutation(&mut self, n: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..n).collect();
        for i in (1..n).rev() {
            order.swap(i, (self.next() % (i as u64 + 1)) as usize);
        }
        order
    }
}

/// A hash of 64 bits: SplitMix64's output function, in which every bit of `z` changes half of the bits of the
/// result.
pub(crate) fn hash(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}
