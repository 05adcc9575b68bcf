// Strokes that are changed in a part of a scene: their numbers are those of seeds with something added. CPU
// twin: `stylegaussian::strokes::StrokeFactors`.

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
