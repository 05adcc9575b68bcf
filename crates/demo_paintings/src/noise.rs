//! Randomness that is the same on every machine: a small generator and gradient noise.
//!
//! This crate uses IEEE basic operations, square roots and `libm` only. The platform's transcendental functions
//! differ in their last bits, and paintings are to be identical bit for bit.

use glam::Vec2;

/// SplitMix64 (Steele, Lea, Flood 2014): 64 bits of state, full period, no bad seeds.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// A generator. Equal seeds give equal sequences.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 32 random bits.
    pub fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (mix(self.0) >> 32) as u32
    }

    /// Uniform in `[0, 1)`, with 24 bits, all of which an `f32` holds exactly.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / (1 << 24) as f32
    }

    /// Uniform in `[low, high)`.
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f32) -> bool {
        self.unit() < probability
    }

    /// Bell-shaped in `(-1, 1)` with standard deviation 1/3: the sum of three uniform numbers.
    pub fn bell(&mut self) -> f32 {
        (self.unit() + self.unit() + self.unit()) * (2.0 / 3.0) - 1.0
    }

    /// One of `choices`, each with the same probability.
    ///
    /// # Panics
    /// If there are none.
    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        // The remainder favors the first choices by the length over 2^32, which no picture shows.
        choices[self.bits() as usize % choices.len()]
    }

    /// Uniform in the square `[-1, 1)^2`.
    pub fn offset(&mut self) -> Vec2 {
        Vec2::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0))
    }

    /// Shuffles `items` (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.bits() as usize % (i + 1));
        }
    }

    /// The points of a jittered grid over the square `[-margin, size + margin)^2`, in random order. They cover
    /// it evenly without visible rows.
    pub fn scatter(&mut self, size: f32, margin: f32, spacing: f32) -> Vec<Vec2> {
        let n = ((size + 2.0 * margin) / spacing) as usize + 1;
        let mut points = Vec::with_capacity(n * n);
        for row in 0..n {
            for column in 0..n {
                let stagger = if row % 2 == 0 { 0.0 } else { 0.5 };
                let cell = Vec2::new(column as f32 + stagger, row as f32) + self.offset() * 0.4;
                points.push(cell * spacing - Vec2::splat(margin));
            }
        }
        self.shuffle(&mut points);
        points
    }
}

/// SplitMix64's finalizer.
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A uniform number in `[0, 1)`, a hash of a lattice point.
pub fn hash(seed: u64, x: i32, y: i32) -> f32 {
    let key = ((x as u32 as u64) << 32) | y as u32 as u64;
    (mix(key ^ mix(seed.wrapping_add(0x9e37_79b9_7f4a_7c15))) >> 40) as f32 / (1 << 24) as f32
}

/// Perlin's gradient noise over the integer lattice, by its seed.
#[derive(Clone, Copy, Debug)]
pub struct Noise(pub u64);

impl Noise {
    /// Smooth noise at `p`, about in `[-1, 1]`, with features of size one.
    pub fn at(self, p: Vec2) -> f32 {
        let cell = p.floor();
        let (x, y) = (cell.x as i32, cell.y as i32);
        let f = p - cell;
        // Perlin's quintic of 2002: its second derivative is 0 on the lattice, so that no creases show there.
        let fade = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
        let corner = |dx: i32, dy: i32| {
            let angle = hash(self.0, x + dx, y + dy) * std::f32::consts::TAU;
            direction(angle).dot(f - Vec2::new(dx as f32, dy as f32))
        };
        let top = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * fade.x;
        let bottom = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * fade.x;
        // The dot products reach sqrt(1/2) at most in the middle of a cell.
        (top + (bottom - top) * fade.y) * std::f32::consts::SQRT_2
    }

    /// Fractal noise: `octaves` layers, each half as strong and twice as fine as the one before.
    pub fn fractal(self, p: Vec2, octaves: u32) -> f32 {
        let (mut sum, mut strength, mut q) = (0.0, 1.0, p);
        for octave in 0..octaves {
            sum += strength * Noise(self.0 + octave as u64 * 101).at(q);
            strength *= 0.5;
            q *= 2.0;
        }
        sum
    }

    /// A vector of two independent fractal noises, by which shapes are bent.
    pub fn warp(self, p: Vec2, octaves: u32) -> Vec2 {
        Vec2::new(self.fractal(p, octaves), Noise(self.0 ^ 0x5eed).fractal(p, octaves))
    }

    /// Smooth noise along a line, about in `[-1, 1]`.
    pub fn line(self, x: f32) -> f32 {
        let cell = x.floor();
        let value = |i: i32| hash(self.0, i, 0) * 2.0 - 1.0;
        let f = x - cell;
        let (a, b) = (value(cell as i32), value(cell as i32 + 1));
        a + (b - a) * f * f * (3.0 - 2.0 * f)
    }
}

/// The unit vector at `angle` radians (clockwise from +x, as y points down).
pub fn direction(angle: f32) -> Vec2 {
    Vec2::new(libm::cosf(angle), libm::sinf(angle))
}
