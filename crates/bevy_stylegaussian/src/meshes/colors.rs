//! The base colors of a mesh's vertices, before it is painted.

use std::sync::Arc;

use bevy::{
    image::TextureFormatPixelInfo,
    math::Affine2,
    mesh::{UvChannel, VertexAttributeValues},
    prelude::*,
};

/// Samples along a side of what a vertex stands for, at most: 64 texels tell the color of a larger patch.
const SAMPLES: i32 = 8;

/// The base color of a material.
#[derive(Clone)]
pub(super) struct BaseColor {
    color: LinearRgba,
    texture: Option<Texture>,
}

#[derive(Clone)]
struct Texture {
    image: Arc<Image>,
    channel: UvChannel,
    transform: Affine2,
}

impl BaseColor {
    /// The base color of a material, whose texture is `image`.
    ///
    /// # Errors
    /// If the texture cannot be read: what was found, and what was expected.
    pub(super) fn new(material: &StandardMaterial, image: Option<Arc<Image>>) -> Result<Self, String> {
        let texture = image.map(|image| Texture {
            image,
            channel: material.base_color_channel.clone(),
            transform: material.uv_transform,
        });
        if let Some(texture) = &texture {
            let format = texture.image.texture_descriptor.format;
            if format.pixel_size().is_err() || texture.image.get_color_at(0, 0).is_err() {
                return Err(format!(
                    "found a base color texture of {format:?} that cannot be read, expected pixels of 8, 16 or \
                     32 bits in main memory (load it with RenderAssetUsages::MAIN_WORLD too)"
                ));
            }
        }
        Ok(Self { color: material.base_color.to_linear(), texture })
    }

    /// The display-referred color of each vertex of a mesh, each a mean over a patch of `side` units.
    /// `triangles` are the mesh's, at `positions`.
    pub(super) fn of_vertices(
        &self,
        mesh: &Mesh,
        (positions, triangles): (&[Vec3], &[[u32; 3]]),
        side: f32,
    ) -> Vec<[f32; 3]> {
        let n = positions.len();
        let colors = match mesh.attribute(Mesh::ATTRIBUTE_COLOR) {
            Some(VertexAttributeValues::Float32x4(colors)) => Some(colors),
            _ => None,
        };
        let uvs = self.texture.as_ref().and_then(|texture| {
            let attribute = match texture.channel {
                UvChannel::Uv0 => Mesh::ATTRIBUTE_UV_0,
                UvChannel::Uv1 => Mesh::ATTRIBUTE_UV_1,
            };
            match mesh.attribute(attribute) {
                Some(VertexAttributeValues::Float32x2(uvs)) => Some((texture, uvs)),
                _ => None,
            }
        });
        let of_texture = uvs.map(|(texture, uvs)| {
            let at: Vec<Vec2> =
                uvs.iter().map(|uv| texture.transform.transform_point2(Vec2::from(*uv))).collect();
            let patch = side * texels_to_a_unit(&texture.image, &at, positions, triangles);
            (texture, at, patch)
        });
        let color = |i: usize| {
            let mut linear = self.color.to_vec4().truncate();
            if let Some([r, g, b, _]) = colors.map(|colors| colors[i]) {
                linear *= Vec3::new(r, g, b);
            }
            if let Some((texture, at, patch)) = &of_texture {
                linear *= mean_of(&texture.image, at[i], *patch);
            }
            let Srgba { red, green, blue, .. } = LinearRgba::rgb(linear.x, linear.y, linear.z).into();
            // Where a mesh has no number, it is mid-gray.
            [red, green, blue].map(|value| if value.is_nan() { 0.5 } else { value.clamp(0.0, 1.0) })
        };
        (0..n).map(color).collect()
    }
}

/// Texels along a unit of the mesh: the root of the ratio of areas. 0 if there is no area.
fn texels_to_a_unit(image: &Image, uvs: &[Vec2], positions: &[Vec3], triangles: &[[u32; 3]]) -> f32 {
    let size = image.size_f32();
    let (mut texels, mut area) = (0.0_f64, 0.0_f64);
    for corners in triangles {
        let [a, b, c] = corners.map(|i| uvs[i as usize] * size);
        texels += f64::from((b - a).perp_dot(c - a).abs());
        let [a, b, c] = corners.map(|i| positions[i as usize]);
        area += f64::from((b - a).cross(c - a).length());
    }
    let ratio = (texels / area).sqrt() as f32;
    if ratio.is_finite() { ratio } else { 0.0 }
}

/// The mean of an image's linear colors in a square of `patch` texels around a place, repeated beyond its
/// edges.
fn mean_of(image: &Image, at: Vec2, patch: f32) -> Vec3 {
    let size = image.size().as_ivec2();
    let n = (patch.ceil() as i32).clamp(1, SAMPLES);
    let first = at * size.as_vec2() - 0.5 * patch;
    let step = patch / n as f32;
    let mut sum = Vec3::ZERO;
    for i in 0..n * n {
        let within = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5);
        // Casts of what is no number give 0.
        let texel = (first + step * within).floor().as_ivec2();
        let [x, y] = [texel.x.rem_euclid(size.x), texel.y.rem_euclid(size.y)].map(|x| x as u32);
        // Every texel was checked to be readable.
        let color = image.get_color_at(x, y).unwrap_or(Color::WHITE).to_linear();
        sum += Vec3::new(color.red, color.green, color.blue);
    }
    sum / (n * n) as f32
}

#[cfg(test)]
mod tests {
    use bevy::{
        asset::RenderAssetUsages,
        render::render_resource::{Extent3d, PrimitiveTopology, TextureDimension, TextureFormat},
    };

    use super::*;

    fn quad() -> Mesh {
        Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
            .with_inserted_attribute(
                Mesh::ATTRIBUTE_POSITION,
                vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]],
            )
            .with_inserted_attribute(
                Mesh::ATTRIBUTE_UV_0,
                vec![[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]],
            )
    }

    fn colors(material: &StandardMaterial, image: Option<Image>, mesh: &Mesh, side: f32) -> Vec<[f32; 3]> {
        let base = BaseColor::new(material, image.map(Arc::new)).unwrap();
        let positions = [Vec3::ZERO, 2.0 * Vec3::X, Vec3::new(2.0, 2.0, 0.0), 2.0 * Vec3::Y];
        base.of_vertices(mesh, (&positions, &[[0, 1, 2], [0, 2, 3]]), side)
    }

    fn near(a: [f32; 3], b: [f32; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.02)
    }

    #[test]
    fn colors_multiply_and_are_displayed() {
        let red = StandardMaterial::from(Color::srgb(0.8, 0.4, 0.2));
        assert!(near(colors(&red, None, &quad(), 0.1)[0], [0.8, 0.4, 0.2]));
        let half = Color::srgb(0.5, 0.5, 0.5).to_linear().red;
        let tinted = quad().with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, vec![[half, 1.0, 0.0, 1.0]; 4]);
        let white = StandardMaterial::from(Color::WHITE);
        assert!(near(colors(&white, None, &tinted, 0.1)[3], [0.5, 1.0, 0.0]));
        // A texture of four squares, of which the vertices are in the middle.
        let size = Extent3d { width: 2, height: 2, depth_or_array_layers: 1 };
        let data = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [0, 0, 0, 255]].concat();
        let image = |format, data: Vec<u8>| {
            Image::new(size, TextureDimension::D2, data, format, RenderAssetUsages::default())
        };
        let squares = image(TextureFormat::Rgba8UnormSrgb, data);
        let found = colors(&white, Some(squares.clone()), &quad(), 1e-3);
        assert!(near(found[0], [1.0, 0.0, 0.0]) && near(found[1], [0.0, 1.0, 0.0]), "{found:?}");
        // All of the texture: a quarter of the light of each.
        let quarter = Srgba::from(LinearRgba::rgb(0.25, 0.25, 0.25)).red;
        assert!(near(colors(&white, Some(squares), &quad(), 8.0)[2], [quarter; 3]));
        let depth = image(TextureFormat::Depth32Float, vec![0; 16]);
        assert!(BaseColor::new(&white, Some(Arc::new(depth))).is_err());
        // Without texture coordinates there is no texture, as in Bevy's shader. What is no number is gray.
        let squares = image(TextureFormat::Rgba8UnormSrgb, [[255, 0, 0, 255]; 4].concat());
        let bare = quad().with_removed_attribute(Mesh::ATTRIBUTE_UV_0);
        assert!(near(colors(&white, Some(squares), &bare, 0.1)[1], [1.0; 3]));
        let odd = quad().with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, vec![[f32::NAN, 0.0, 1.0, 1.0]; 4]);
        assert!(near(colors(&white, None, &odd, 0.1)[0], [0.5, 0.0, 1.0]));
    }

    /// A gradient of 4096 texels: however many a vertex stands for, 64 of them are read, and tell its mean.
    #[test]
    fn large_textures_take_no_longer() {
        const SIDE: u32 = 4096;
        let size = Extent3d { width: SIDE, height: SIDE, depth_or_array_layers: 1 };
        let data = (0..SIDE * SIDE).map(|i| (i % SIDE / 16) as u8).collect();
        let (format, usages) = (TextureFormat::R8Unorm, RenderAssetUsages::default());
        let image = Arc::new(Image::new(size, TextureDimension::D2, data, format, usages));
        let side = 150;
        let at = |i: usize| [(i % side) as f32 / side as f32, (i / side) as f32 / side as f32];
        let positions: Vec<Vec3> =
            (0..side * side).map(at).map(|[x, y]| 10.0 * Vec3::new(x, y, 0.0)).collect();
        let mesh = quad()
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions.clone())
            .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, (0..side * side).map(at).collect::<Vec<_>>());
        let base = BaseColor::new(&StandardMaterial::from(Color::WHITE), Some(image)).unwrap();
        let start = std::time::Instant::now();
        let corners = [[0, side as u32 - 1, (side * side) as u32 - 1]];
        let found = base.of_vertices(&mesh, (&positions, &corners), 0.5);
        // A million texels and a half. All of the patches would be a billion.
        assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
        for i in [side * 20 + 40, side * 75 + 75, side * 130 + 120] {
            let red = Srgba::from(LinearRgba::rgb(at(i)[0], 0.0, 0.0)).red;
            assert!((found[i][0] - red).abs() < 0.02, "{:?} for {red}", found[i]);
        }
    }
}
