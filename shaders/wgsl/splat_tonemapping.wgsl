// Inverses of Bevy's tone mapping curves (bevy_core_pipeline 0.19, tonemapping_shared.wgsl): the linear color that a camera
// will show as a given linear, display-referred one. Each is exact but where said, up to `BRIGHTEST`: no curve reaches 1.

/// What the curves with an asymptote are asked for at most. It is shown as 255 of 255.
const BRIGHTEST: f32 = 0.998;

/// c = x / (1 + x).
fn inverse_reinhard(c: vec3<f32>) -> vec3<f32> {
    let limited = min(c, vec3(BRIGHTEST));
    return limited / (1.0 - limited);
}

/// The same for the luminance, with Rec. 709 weights; hue and saturation stay.
fn inverse_reinhard_luminance(c: vec3<f32>) -> vec3<f32> {
    let luminance = min(dot(c, vec3(0.2126, 0.7152, 0.0722)), BRIGHTEST);
    return c / (1.0 - luminance);
}

/// Stephen Hill's fit of ACES: input matrix, c = (v (v + a) - b) / (v (c v + d) + e), output matrix, clamp. The quotient is
/// undone by the positive root of v^2 (1 - c f) + v (a - d f) - (b + e f) = 0. Colors whose inverse has a negative channel
/// are outside of what ACES can show: they lose it.
fn inverse_aces_fitted(c: vec3<f32>) -> vec3<f32> {
    // Inverses of Bevy's matrices, as rows.
    let f = vec3(
        dot(c, vec3(0.64303825, 0.31118675, 0.045775457)),
        dot(c, vec3(0.05926869, 0.93143649, 0.0092949157)),
        dot(c, vec3(0.0059619013, 0.063929016, 0.93011838)),
    );
    let p = 1.0 - 0.983729 * f;
    let q = 0.0245786 - 0.4329510 * f;
    let r = 0.000090537 + 0.238081 * f;
    let v = (sqrt(q * q + 4.0 * p * r) - q) / (2.0 * p);
    return max(vec3(0.0), vec3(
        dot(v, vec3(1.764741, -0.67577768, -0.088963294)),
        dot(v, vec3(-0.14702785, 1.1602515, -0.01322366)),
        dot(v, vec3(-0.03633683, -0.16243644, 1.1987733)),
    ));
}

/// Khronos' PBR Neutral: a toe, then compression of the brightest channel towards 1 and desaturation. Colors with a channel
/// at 0 stay what they are; the toe reaches no darker.
fn inverse_pbr_neutral(c: vec3<f32>) -> vec3<f32> {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    var color = c;
    let peak = min(max(c.r, max(c.g, c.b)), BRIGHTEST);
    if peak >= START {
        let d = 1.0 - START;
        let old_peak = d * d / (1.0 - peak) - d + START;
        let gray = 1.0 - 1.0 / (DESATURATION * (old_peak - peak) + 1.0);
        color = (min(c, vec3(peak)) - peak * gray) / (1.0 - gray) * (old_peak / peak);
    }
    let lowest = max(min(color.r, min(color.g, color.b)), 0.0);
    let toe = select(0.04, sqrt(lowest / 6.25) - lowest, lowest < 0.04);
    return max(color + toe, vec3(0.0));
}
