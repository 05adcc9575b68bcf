//! The brush, which turns surfaces into flat, oriented Gaussians.
//!
//! All arithmetic is scalar f32 in a fixed order (`Vec3`, no SIMD types), so the result is the same on every
//! machine.

use glam::{Quat, Vec3};

/// Standard deviation along the normal of a surface, in scene units: thin, yet thick enough to be seen at
/// grazing angles.
const SKIN: f32 = 0.004;

/// Standard deviation of a Gaussian for the spacing of its grid. Neighbors then leave no holes (the three
/// around the center of a hexagonal grid's triangle let less than a tenth through), and details of one spacing
/// stay visible.
pub const SIGMA_PER_SPACING: f32 = 0.56;

/// The linear color of `0xRRGGBB` in sRGB (by a power of 2.2).
pub fn paint(rgb: u32) -> Vec3 {
    let channel = |shift: u32| libm::powf(((rgb >> shift) & 255) as f32 / 255.0, 2.2);
    Vec3::new(channel(16), channel(8), channel(0))
}

/// A mix of two linear colors, `a` at 0 and `b` at 1.
pub fn mix(a: Vec3, b: Vec3, t: f32) -> Vec3 {
    a + (b - a) * t.clamp(0.0, 1.0)
}

/// A smooth step of `x`: 0 below `low`, 1 above `high`, cubic between. If `low` > `high`, it falls.
pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A right-handed coordinate frame in the world.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// The world position of the frame's (0, 0, 0).
    pub origin: Vec3,
    /// The world direction of the frame's x.
    pub x: Vec3,
    /// The world direction of the frame's y.
    pub y: Vec3,
    /// The world direction of the frame's z.
    pub z: Vec3,
}

impl Frame {
    /// A frame that stands upright. Its z is `front` made horizontal.
    pub fn upright(origin: Vec3, front: Vec3) -> Self {
        let z = Vec3::new(front.x, 0.0, front.z).normalize();
        Self { origin, x: Vec3::Y.cross(z), y: Vec3::Y, z }
    }

    /// A frame with `normal` as its z and an x as close to `along` as possible.
    pub fn facing(origin: Vec3, normal: Vec3, along: Vec3) -> Self {
        let z = normal.normalize();
        let x = (along - z * along.dot(z)).try_normalize().unwrap_or_else(|| any_tangent(z));
        Self { origin, x, y: z.cross(x), z }
    }

    /// The world position of a point of the frame.
    pub fn at(&self, x: f32, y: f32, z: f32) -> Vec3 {
        self.origin + self.vector(x, y, z)
    }

    /// The world vector of a vector of the frame.
    pub fn vector(&self, x: f32, y: f32, z: f32) -> Vec3 {
        self.x * x + self.y * y + self.z * z
    }

    /// The same axes at another point of the frame.
    pub fn moved(&self, x: f32, y: f32, z: f32) -> Self {
        Self { origin: self.at(x, y, z), ..*self }
    }

    /// The rotation that takes the unit axes to this frame's.
    ///
    /// Shepperd's method (1978): it starts from the trace if that is positive, otherwise from the largest
    /// diagonal element, and so never divides by a small number. Scalar, unlike glam's own.
    pub fn rotation(&self) -> Quat {
        let (x, y, z) = (self.x, self.y, self.z);
        let quaternion = if x.x + y.y + z.z > 0.0 {
            [y.z - z.y, z.x - x.z, x.y - y.x, 1.0 + x.x + y.y + z.z]
        } else if x.x >= y.y && x.x >= z.z {
            [1.0 + x.x - y.y - z.z, x.y + y.x, z.x + x.z, y.z - z.y]
        } else if y.y >= z.z {
            [x.y + y.x, 1.0 + y.y - x.x - z.z, y.z + z.y, z.x - x.z]
        } else {
            [z.x + x.z, y.z + z.y, 1.0 + z.z - x.x - y.y, x.y - y.x]
        };
        let squared = quaternion.iter().fold(0.0, |sum, q| sum + q * q);
        let [qx, qy, qz, qw] = quaternion.map(|q| q / squared.sqrt());
        Quat::from_xyzw(qx, qy, qz, qw)
    }
}

/// Some unit vector perpendicular to a unit vector.
pub fn any_tangent(normal: Vec3) -> Vec3 {
    let other = if normal.y.abs() < 0.9 { Vec3::Y } else { Vec3::X };
    other.cross(normal).normalize()
}

/// One stroke: a Gaussian with a material, which light turns into a color.
#[derive(Clone, Copy, Debug)]
pub struct Dab {
    /// Center, and the directions of the three standard deviations.
    pub frame: Frame,
    /// Standard deviations along the frame's axes.
    pub sigma: Vec3,
    /// Linear albedo.
    pub color: Vec3,
    /// Opacity, 0..1.
    pub opacity: f32,
    /// The normal for lighting. Leaves and grass take that of their crown or ground, which looks softer than a
    /// leaf's.
    pub shade: Vec3,
    /// Share of light that reaches around the form: 0 for stone, more for leaves and clouds.
    pub wrap: f32,
    /// Emitted light, linear.
    pub glow: Vec3,
    /// Share of its area that blocks light, 0..1.
    pub blocks: f32,
}

impl Dab {
    /// A flat ellipse on a surface. `along` is the direction of the first standard deviation.
    pub fn flat(center: Vec3, normal: Vec3, along: Vec3, sigma: (f32, f32), color: Vec3) -> Self {
        let frame = Frame::facing(center, normal, along);
        Self {
            frame,
            sigma: Vec3::new(sigma.0, sigma.1, SKIN),
            color,
            opacity: 0.96,
            shade: frame.z,
            wrap: 0.0,
            glow: Vec3::ZERO,
            blocks: 1.0,
        }
    }

    /// A round, soft ball.
    pub fn ball(center: Vec3, sigma: f32, color: Vec3, shade: Vec3) -> Self {
        Self { sigma: Vec3::splat(sigma), ..Self::flat(center, shade, Vec3::X, (sigma, sigma), color) }
    }

    /// The same with another opacity.
    pub fn opacity(self, opacity: f32) -> Self {
        Self { opacity, ..self }
    }

    /// The same, lit as foliage: with the normal of the whole crown, and with light that wraps around.
    pub fn lit_as(self, shade: Vec3, wrap: f32) -> Self {
        Self { shade: shade.normalize(), wrap, ..self }
    }

    /// The same with emitted light.
    pub fn glowing(self, glow: Vec3) -> Self {
        Self { glow, ..self }
    }

    /// The same, blocking only a share of the light.
    pub fn blocking(self, blocks: f32) -> Self {
        Self { blocks, ..self }
    }
}

/// Everything painted so far.
#[derive(Clone, Debug, Default)]
pub struct Canvas {
    /// The dabs, in the order they were painted.
    pub dabs: Vec<Dab>,
}

impl Canvas {
    /// Adds one dab.
    pub fn add(&mut self, dab: Dab) {
        self.dabs.push(dab);
    }

    /// Covers a rectangle of the frame's x-y plane, from (0, 0) to `size`, with a hexagonal grid. `color` gives
    /// the color at a point of the rectangle, or `None` if it stays open.
    pub fn sheet(
        &mut self,
        frame: Frame,
        size: (f32, f32),
        spacing: f32,
        mut color: impl FnMut(f32, f32) -> Option<Vec3>,
    ) {
        // Rows of a hexagonal grid are sin 60 degrees = 0.866 spacings apart.
        let rows = (size.1 / (spacing * 0.866)).ceil().max(1.0);
        let columns = (size.0 / spacing).ceil().max(1.0);
        let sigma = (size.0 / columns * SIGMA_PER_SPACING, size.1 / rows / 0.866 * SIGMA_PER_SPACING);
        for row in 0..rows as u32 {
            // Odd rows are moved by half a column, which makes the grid hexagonal.
            let shift = if row % 2 == 0 { 0.25 } else { 0.75 };
            for column in 0..columns as u32 {
                let x = size.0 * (column as f32 + shift) / columns;
                let y = size.1 * (row as f32 + 0.5) / rows;
                if let Some(color) = color(x, y) {
                    self.add(Dab::flat(frame.at(x, y, 0.0), frame.z, frame.x, sigma, color));
                }
            }
        }
    }

    /// A flat board from `from` to `to` that faces `normal`, made of strands of wood along its length.
    pub fn board(
        &mut self,
        (from, to): (Vec3, Vec3),
        normal: Vec3,
        (width, strands): (f32, u32),
        mut color: impl FnMut(f32) -> Vec3,
    ) {
        let length = (to - from).length();
        let frame = Frame::facing(from, normal, to - from);
        let strand = width / strands as f32;
        // Gaussians along a strand are about three times as long as wide, like fibers of wood.
        let count = (length / (strand * 2.8)).ceil().max(1.0);
        let step = length / count;
        for index in 0..strands {
            let y = (index as f32 + 0.5) * strand - 0.5 * width;
            for piece in 0..count as u32 {
                let x = (piece as f32 + 0.5) * step;
                let sigma = (step * 0.5, strand * 0.5);
                self.add(Dab::flat(frame.at(x, y, 0.0), frame.z, frame.x, sigma, color(x)).opacity(0.98));
            }
        }
    }

    /// A round tube with a radius from `radii.0` to `radii.1`. `color` takes the position along it (0..1) and
    /// the outward normal.
    pub fn tube(
        &mut self,
        (from, to): (Vec3, Vec3),
        radii: (f32, f32),
        spacing: f32,
        mut color: impl FnMut(f32, Vec3) -> Vec3,
    ) {
        let length = (to - from).length();
        let axis = Frame::facing(from, to - from, Vec3::X);
        let rings = (length / (spacing * 1.3)).ceil().max(1.0);
        for ring in 0..rings as u32 {
            let along = (ring as f32 + 0.5) / rings;
            let radius = radii.0 + (radii.1 - radii.0) * along;
            // At least three Gaussians, the fewest that close a ring.
            let around = (std::f32::consts::TAU * radius / spacing).ceil().max(3.0);
            for index in 0..around as u32 {
                let angle = std::f32::consts::TAU * (index as f32 + 0.5 * (ring % 2) as f32) / around;
                let normal = axis.vector(libm::cosf(angle), libm::sinf(angle), 0.0);
                let center = axis.at(0.0, 0.0, along * length) + normal * radius;
                let sigma = (length / rings * 0.55, std::f32::consts::TAU * radius / around * 0.5);
                self.add(Dab::flat(center, normal, axis.z, sigma, color(along, normal)));
            }
        }
    }
}

/// `count` nearly even directions on the sphere (the golden-angle spiral). The first points down, the last up.
pub fn sphere(count: u32) -> impl Iterator<Item = Vec3> {
    // pi (3 - sqrt 5).
    const GOLDEN_ANGLE: f32 = 2.399_963_2;
    (0..count).map(move |index| {
        let y = (2.0 * index as f32 + 1.0) / count as f32 - 1.0;
        let radius = (1.0 - y * y).sqrt();
        let angle = index as f32 * GOLDEN_ANGLE;
        Vec3::new(radius * libm::cosf(angle), y, radius * libm::sinf(angle))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_takes_the_unit_axes_to_the_frame() {
        // One normal for each of the four branches.
        for normal in
            [Vec3::Z, Vec3::NEG_Z, Vec3::new(0.1, -0.9, -0.2), Vec3::new(-0.8, 0.1, -0.5), Vec3::NEG_X]
        {
            for along in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::new(-0.3, 0.2, 0.9)] {
                let frame = Frame::facing(Vec3::ZERO, normal, along);
                let rotation = frame.rotation();
                assert!((rotation.length() - 1.0).abs() < 1e-5);
                assert!((rotation * Vec3::X - frame.x).length() < 1e-5, "{normal} {along}");
                assert!((rotation * Vec3::Y - frame.y).length() < 1e-5, "{normal} {along}");
                assert!((rotation * Vec3::Z - frame.z).length() < 1e-5, "{normal} {along}");
            }
        }
    }

    #[test]
    fn a_sheet_covers_its_rectangle() {
        let mut canvas = Canvas::default();
        let frame = Frame::facing(Vec3::ZERO, Vec3::Z, Vec3::X);
        canvas.sheet(frame, (1.0, 0.5), 0.1, |_, _| Some(Vec3::ONE));
        assert_eq!(canvas.dabs.len(), 10 * 6);
        for x in 0..20 {
            let point = Vec3::new(x as f32 / 20.0 + 0.025, 0.25, 0.0);
            let through: f32 = canvas
                .dabs
                .iter()
                .map(|dab| {
                    let q = (point - dab.frame.origin) / dab.sigma;
                    1.0 - dab.opacity * libm::expf(-0.5 * q.length_squared())
                })
                .product();
            assert!(through < 0.15, "{through} passes at {point}");
        }
    }
}
