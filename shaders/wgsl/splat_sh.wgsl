// Spherical harmonics of degrees 0 to 3: the captured color of a Gaussian. Order and signs are those of the CPU
// twin, `stylegaussian::sh`.

/// Y_00 = 1 / (2 sqrt(pi)).
const SH_0: f32 = 0.28209479;
/// sqrt(3 / (4 pi)).
const SH_1: f32 = 0.48860251;
/// sqrt(15 / (4 pi)), sqrt(5 / (16 pi)), sqrt(15 / (16 pi)).
const SH_2A: f32 = 1.0925484;
const SH_2B: f32 = 0.31539157;
const SH_2C: f32 = 0.5462742;
/// sqrt(35 / (32 pi)), sqrt(105 / (4 pi)), sqrt(21 / (32 pi)), sqrt(7 / (16 pi)), sqrt(105 / (16 pi)).
const SH_3A: f32 = 0.5900436;
const SH_3B: f32 = 2.8906114;
const SH_3C: f32 = 0.4570458;
const SH_3D: f32 = 0.37317634;
const SH_3E: f32 = 1.4453057;

/// Coefficients as f16. Three words hold two of them: r0 g0 | b0 r1 | g1 b1. Words are planes
/// `[word, Gaussian]`, so that neighboring invocations read neighboring words.
@group(1) @binding(1) var<storage, read> sh_words: array<u32>;

/// Coefficients 2 pair and 2 pair + 1 times the values of their basis functions.
fn sh_pair(gaussian: u32, n_gaussians: u32, pair: u32, basis: vec2<f32>) -> vec3<f32> {
    let first = 3u * pair * n_gaussians + gaussian;
    let r0_g0 = unpack2x16float(sh_words[first]);
    let b0_r1 = unpack2x16float(sh_words[first + n_gaussians]);
    let g1_b1 = unpack2x16float(sh_words[first + 2u * n_gaussians]);
    return basis.x * vec3(r0_g0, b0_r1.x) + basis.y * vec3(b0_r1.y, g1_b1);
}

/// The color of Gaussian `gaussian` of a chunk of `n_gaussians`, seen along the unit vector `d`:
/// display-referred, with 0.5 added, clamped at 0 from below.
fn sh_color(gaussian: u32, n_gaussians: u32, degree: u32, d: vec3<f32>) -> vec3<f32> {
    let n = n_gaussians;
    // A pair may end with a coefficient of the next degree. Its words exist even if the scene lacks that
    // degree, as padding of zeros; a factor of 0 makes sure.
    let linear = select(0.0, SH_1, degree >= 1u);
    var sum = sh_pair(gaussian, n, 0u, vec2(SH_0, -linear * d.y));
    if degree >= 1u {
        sum += sh_pair(gaussian, n, 1u, vec2(SH_1 * d.z, -SH_1 * d.x));
    }
    let s = d * d;
    let cubic = select(0.0, SH_3A, degree >= 3u);
    if degree >= 2u {
        sum += sh_pair(gaussian, n, 2u, vec2(SH_2A * d.x * d.y, -SH_2A * d.y * d.z));
        sum += sh_pair(gaussian, n, 3u, vec2(SH_2B * (2.0 * s.z - s.x - s.y), -SH_2A * d.x * d.z));
        sum += sh_pair(gaussian, n, 4u, vec2(SH_2C * (s.x - s.y), -cubic * d.y * (3.0 * s.x - s.y)));
    }
    if degree >= 3u {
        let edge = 4.0 * s.z - s.x - s.y;
        sum += sh_pair(gaussian, n, 5u, vec2(SH_3B * d.x * d.y * d.z, -SH_3C * d.y * edge));
        let along = 2.0 * s.z - 3.0 * (s.x + s.y);
        sum += sh_pair(gaussian, n, 6u, vec2(SH_3D * d.z * along, -SH_3C * d.x * edge));
        sum += sh_pair(gaussian, n, 7u, vec2(SH_3E * d.z * (s.x - s.y), -SH_3A * d.x * (s.x - 3.0 * s.y)));
    }
    return max(sum + 0.5, vec3(0.0));
}
