//! A chunk of a cloud, as kernels of records and of strokes read it.

use bytemuck::{Pod, Zeroable};

/// One chunk of one cloud as one camera sees it. View space is x right, y up, z backward. Matrices are stored
/// as rows.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatChunk {
    /// View from scene, first row.
    pub view_from_scene_x: [f32; 4],
    /// View from scene, second row.
    pub view_from_scene_y: [f32; 4],
    /// View from scene, third row.
    pub view_from_scene_z: [f32; 4],
    /// Clip from view, first row; reverse z.
    pub clip_from_view_x: [f32; 4],
    /// Clip from view, second row.
    pub clip_from_view_y: [f32; 4],
    /// Clip from view, third row.
    pub clip_from_view_z: [f32; 4],
    /// Clip from view, fourth row.
    pub clip_from_view_w: [f32; 4],
    /// Left, top, width and height of the viewport, in pixels of the target.
    pub viewport: [f32; 4],
    /// Origin of the rays in the scene's space: (eye, 1), or (-direction, 0) if they are parallel.
    pub eye: [f32; 4],
    /// The point where the image axis (view -z) meets the picture, in normalized device coordinates.
    pub axis: [f32; 2],
    /// Gaussians at this view depth or nearer are culled, in world units.
    pub near: f32,
    /// The unit of [`PackedGaussian::scales`](super::PackedGaussian::scales), in scene units.
    pub scale_unit: f32,
    /// Gaussians in this chunk.
    pub n_gaussians: u32,
    /// Index of the chunk's first Gaussian in its scene.
    pub first_gaussian: u32,
    /// Index of the chunk's first record.
    pub first_record: u32,
    /// Degree of the spherical harmonics, or [`NO_SH`](super::NO_SH).
    pub sh_degree: u32,
    /// [`CAPTURED_COLORS`](super::CAPTURED_COLORS), [`BY_DISTANCE`](super::BY_DISTANCE),
    /// [`ANTIALIASED`](super::ANTIALIASED), [`CROPPED`](super::CROPPED), [`UNCLIPPED`](super::UNCLIPPED),
    /// [`HALF_SIZE`](super::HALF_SIZE).
    pub flags: u32,
    /// Position of the mask's channel in a word, in bits.
    pub mask_shift: u32,
    /// Splats with a smaller sum of their variances along x and y are culled, in px^2.
    pub least_variance: f32,
    /// Splats of less opacity are culled.
    pub least_opacity: f32,
    /// Half a picture from `axis`, splats are culled if their opacity times the root of the determinant of
    /// their covariance is less, in px^2. The bound grows with the square of that distance.
    pub least_at_edge: f32,
    /// Unused: a uniform is a multiple of 16 bytes.
    pub padding_0: u32,
    /// Unused, too.
    pub padding_1: u32,
    /// Unused, too.
    pub padding_2: u32,
}
