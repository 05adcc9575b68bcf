// Strokes that are changed in a part of a scene: their numbers are those of seeds with something added. CPU
// twin: `stylegaussian::strokes::StrokeFactors`.

/// A point of a curve.
struct CurvePoint {
    at: vec3<f32>,
    padding_0: f32,
    /// Unit direction of the curve there; 0 if it turns back.
    toward: vec3<f32>,
    padding_1: f32,
}

/// A change of strokes.
struct StrokeChange {
    /// Their unit direction in scene space; 0 if they keep their own.
    direction: vec3<f32>,
    /// What is added to the numbers of changed seeds.
    first: u32,
    /// Factor of their gains.
    gain: f32,
    /// Factor of their size.
    stroke_scale: f32,
    /// Factor of the thickness of their paint.
    relief: f32,
    /// Index of their motion, `OWN_MOTION` if they keep their own, or `NO_MOTION`.
    motion: u32,
    /// Thickness of paint that is added to that below.
    added_relief: f32,
    /// Points of a curve, along which strokes run in place of the direction.
    n_points: u32,
    padding_0: u32,
    padding_1: u32,
    points: array<CurvePoint, MAX_CURVE_POINTS>,
}

/// A seed, and all changes of it.
struct ChangedSeed {
    /// The number of the seed.
    number: u32,
    /// As in `StrokeChange`.
    motion: u32,
    direction: vec3<f32>,
    gain: f32,
    stroke_scale: f32,
    relief: f32,
    added_relief: f32,
    /// The change whose curve strokes run along, or `MAX_CHANGES`.
    curve: u32,
}

/// The direction of a change's curve where it is nearest to a point. CPU twin:
/// `stylegaussian::strokes::StrokeCurve`.
fn along_curve(change: u32, point: vec3<f32>) -> vec3<f32> {
    var least = 3.4e38;
    var nearest = 0u;
    var part = 0.0;
    for (var i = 0u; i + 1u < uniforms.changes[change].n_points; i++) {
        let beyond = point - uniforms.changes[change].points[i].at;
        let whole = uniforms.changes[change].points[i + 1u].at - uniforms.changes[change].points[i].at;
        let along = clamp(dot(beyond, whole) / max(dot(whole, whole), 1.2e-38), 0.0, 1.0);
        let apart = beyond - along * whole;
        if dot(apart, apart) < least {
            least = dot(apart, apart);
            nearest = i;
            part = along;
        }
    }
    let here = uniforms.changes[change].points[nearest];
    let next = uniforms.changes[change].points[nearest + 1u];
    // It turns evenly from point to point.
    let toward = mix(here.toward, next.toward, part);
    let squared = dot(toward, toward);
    if squared > 0.0 {
        return toward * inverseSqrt(squared);
    }
    return normalize(next.at - here.at);
}

/// A seed turned so that strokes that have the direction `stroke` in the painting run along `toward`.
fn turned(seed: MovedSeed, stroke: vec2<f32>, toward: vec3<f32>) -> MovedSeed {
    let in_plane = vec2(dot(seed.right, toward), dot(seed.down, toward));
    if length(in_plane) <= IN_PLANE {
        return seed;
    }
    let to = normalize(in_plane);
    let cosine = dot(stroke, to);
    // Strokes have no head.
    let head = select(1.0, -1.0, cosine < 0.0);
    let c = head * cosine;
    let s = head * (stroke.x * to.y - stroke.y * to.x);
    return MovedSeed(
        seed.right * c + seed.down * s,
        seed.down * c - seed.right * s,
        seed.shift,
        seed.gain,
    );
}
