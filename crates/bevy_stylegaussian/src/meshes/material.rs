//! The material of painted meshes: Bevy's standard one, whose base color is the paint.

use bevy::{
    asset::uuid_handle,
    mesh::{MeshVertexAttribute, MeshVertexBufferLayoutRef, VertexFormat},
    pbr::{ExtendedMaterial, MaterialExtension, MaterialExtensionKey, MaterialExtensionPipeline},
    prelude::*,
    reflect::TypePath,
    render::render_resource::{AsBindGroup, RenderPipelineDescriptor, SpecializedMeshPipelineError},
    shader::{Shader, ShaderRef},
};
use stylegaussian::strokes::StrokeKnobs;

/// Words of the corners of a vertex's triangle, and which of them it is: see
/// [`Corner`](stylegaussian::mesh::Corner).
pub(super) const WORDS: MeshVertexAttribute =
    MeshVertexAttribute::new("Vertex_PaintWords", 0x7374_796c_6564_0001, VertexFormat::Uint32x4);

/// Color of a vertex under strokes, display-referred RGB.
pub(super) const PAINTED: MeshVertexAttribute =
    MeshVertexAttribute::new("Vertex_PaintColor", 0x7374_796c_6564_0002, VertexFormat::Float32x3);

/// Its color before it was painted, likewise.
pub(super) const OWN: MeshVertexAttribute =
    MeshVertexAttribute::new("Vertex_PaintOwn", 0x7374_796c_6564_0003, VertexFormat::Float32x3);

/// Locations of these attributes in the shader. Bevy's end before.
const LOCATIONS: [(MeshVertexAttribute, u32); 3] = [(WORDS, 8), (PAINTED, 9), (OWN, 10)];

const SHADER: Handle<Shader> = uuid_handle!("5d7f0a52-3c31-4a8e-9a54-7c4c1f0e6b9d");

/// The material of a painted mesh.
pub(super) type PaintedMaterial = ExtendedMaterial<StandardMaterial, MeshStrokes>;

/// Strokes of a mesh.
#[derive(Asset, AsBindGroup, TypePath, Clone, Debug)]
pub(super) struct MeshStrokes {
    /// Factors of gains, of protection and of the size of strokes, and the share of finer strokes from near.
    #[uniform(100)]
    pub(super) strokes: Vec4,
    /// The share of the paint, and the factor of its thickness.
    #[uniform(100)]
    pub(super) shown: Vec4,
    /// Fine detail of the paintings, a layer for each.
    #[texture(101, dimension = "2d_array")]
    #[sampler(102)]
    pub(super) fine: Handle<Image>,
    /// Wide detail likewise.
    #[texture(103, dimension = "2d_array")]
    pub(super) wide: Handle<Image>,
    /// The seeds.
    #[texture(104, sample_type = "float", filterable = false, visibility(vertex))]
    pub(super) seeds: Handle<Image>,
}

/// How paint is shown, as the shader reads it: [`MeshStrokes::strokes`] and [`MeshStrokes::shown`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Factors {
    pub(super) strokes: Vec4,
    pub(super) shown: Vec4,
}

impl Factors {
    /// Those of a style at a strength of 0..1, in strokes that are so much larger.
    pub(super) fn new(knobs: &StrokeKnobs, strength: f32, stroke_scale: f32) -> Self {
        let stroke_scale = knobs.stroke_scale * stroke_scale;
        Self {
            strokes: Vec4::new(knobs.amount, knobs.protection, stroke_scale, knobs.near),
            shown: Vec4::new(strength, knobs.relief, 0.0, 0.0),
        }
    }
}

impl MaterialExtension for MeshStrokes {
    fn vertex_shader() -> ShaderRef {
        SHADER.into()
    }

    fn fragment_shader() -> ShaderRef {
        SHADER.into()
    }

    fn specialize(
        _: &MaterialExtensionPipeline,
        descriptor: &mut RenderPipelineDescriptor,
        layout: &MeshVertexBufferLayoutRef,
        _: MaterialExtensionKey<Self>,
    ) -> Result<(), SpecializedMeshPipelineError> {
        let paint = LOCATIONS.map(|(attribute, location)| attribute.at_shader_location(location));
        let paint = layout.0.get_layout(&paint)?;
        // They are in Bevy's vertex buffer. A prepass reads none of them.
        if let Some(buffer) = descriptor.vertex.buffers.first_mut() {
            buffer.attributes.extend(paint.attributes);
        }
        Ok(())
    }
}

/// Adds the shader.
pub(super) fn add_shader(app: &mut App) {
    let text = include_str!("painted_mesh.wgsl").to_owned() + &stylegaussian_shaders::mesh::strokes();
    let shader = Shader::from_wgsl(text, "bevy_stylegaussian/meshes/painted_mesh.wgsl");
    if let Some(mut shaders) = app.world_mut().get_resource_mut::<Assets<Shader>>() {
        // An asset of a fixed name has no generation that could be wrong.
        let _ = shaders.insert(&SHADER, shader);
    }
}
