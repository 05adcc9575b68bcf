//! Every joined shader parses and validates, and every struct that both sides know has one layout.

use std::collections::HashMap;

use glam::{Vec2, Vec3, Vec4};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use stylegaussian::{
    splat::{MAX_ALPHA, MIN_ALPHA},
    strokes::{FINE_SIDE, PlainSeed},
};
use stylegaussian_shaders::{Source, layers, mesh, paint, splat, style};

use layouts::{Layout, layouts};

mod layouts;

fn sources() -> Vec<Source> {
    [layers::sources(), paint::sources(), style::sources(), splat::sources()].concat()
}

/// Capabilities of every WebGPU adapter that naga counts as optional, because OpenGL may lack them.
const CORE: Capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32
    .union(Capabilities::MULTISAMPLED_SHADING)
    .union(Capabilities::CUBE_ARRAY_TEXTURES);

/// Parses and validates without optional capabilities: a shader that passes runs on every adapter.
fn validated(source: &Source) -> Result<naga::Module, String> {
    let module =
        naga::front::wgsl::parse_str(&source.wgsl).map_err(|error| error.emit_to_string(&source.wgsl))?;
    Validator::new(ValidationFlags::all(), CORE)
        .validate(&module)
        .map_err(|error| error.emit_to_string(&source.wgsl))?;
    Ok(module)
}

/// Size, and name and offset of every member, of each struct of a module.
fn structs(module: &naga::Module) -> Vec<Layout> {
    let mut found = Vec::new();
    for (_, ty) in module.types.iter() {
        if let (Some(name), naga::TypeInner::Struct { members, span }) = (&ty.name, &ty.inner) {
            let members = members.iter().map(|member| {
                let name = member.name.clone().unwrap_or_default();
                (&*name.leak(), member.offset as usize)
            });
            found.push(Layout {
                name: name.clone().leak(),
                size: *span as usize,
                members: members.collect(),
            });
        }
    }
    found
}

#[test]
fn every_shader_is_valid() {
    let failures: Vec<String> = sources()
        .iter()
        .filter_map(|source| validated(source).err().map(|error| format!("{}:\n{error}", source.label)))
        .collect();
    assert!(failures.is_empty(), "{} invalid shaders\n{}", failures.len(), failures.join("\n"));
}

/// Those that an engine's shader is joined with have no entry point.
#[test]
fn the_strokes_of_meshes_are_valid() {
    let source = Source { label: "mesh_strokes", wgsl: mesh::strokes() };
    let module = validated(&source).unwrap_or_else(|error| panic!("{error}"));
    assert!(module.entry_points.is_empty() && module.global_variables.is_empty());
}

/// A seed's map from the texels that the functions read is that of its plain numbers.
#[test]
fn a_seed_is_whole_in_its_texels() {
    let seed = PlainSeed {
        at: Vec3::new(1.0, -2.0, 3.0),
        right: Vec3::Y,
        down: Vec3::NEG_Z,
        pitch: Vec2::new(60.0, 45.0),
        place: Vec2::new(100.0, 300.0),
        fine: 1.0,
        wide: 0.5,
        texture: 3,
    };
    let texels = mesh::seed_texels(&vec![seed.packed(); 300]);
    assert_eq!(texels.len(), 2 * mesh::TEXELS * mesh::SEEDS_TO_A_ROW);
    assert_eq!(mesh::seed_texels(&[]).len(), mesh::TEXELS * mesh::SEEDS_TO_A_ROW);
    let [a, b, c, d] = [0, 1, 2, 3].map(|i| Vec4::from(texels[4 * 299 + i]));
    let at = Vec3::new(1.1, -1.8, 2.7);
    let local = at - a.truncate();
    let found = Vec2::new(b.w, c.w) + Vec2::new(b.truncate().dot(local), c.truncate().dot(local));
    let along = Vec2::new(seed.right.dot(at - seed.at), seed.down.dot(at - seed.at));
    let expected = (seed.place + seed.pitch * along) / FINE_SIDE as f32;
    assert!(found.distance(expected) < 1e-3, "{found} {expected}");
    assert_eq!(a.w, 3.0);
    assert!((d.truncate().truncate() - Vec2::new(1.0, 0.5)).abs().max_element() < 0.01);
}

#[test]
fn layouts_match() {
    let mut in_wgsl: HashMap<&str, Vec<(&str, Layout)>> = HashMap::new();
    for source in sources() {
        for layout in validated(&source).map(|module| structs(&module)).unwrap_or_default() {
            in_wgsl.entry(layout.name).or_default().push((source.label, layout));
        }
    }
    let mut failures = Vec::new();
    for expected in layouts() {
        let Some(found) = in_wgsl.get(expected.name) else {
            failures.push(format!("no shader has a struct `{}`", expected.name));
            continue;
        };
        for (label, found) in found {
            if (found.size, &found.members) != (expected.size, &expected.members) {
                failures.push(format!("{label}: found {found:?}, expected {expected:?}"));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// The value of a constant of a module.
fn constant(source: &Source, name: &str) -> Option<naga::Literal> {
    let module = validated(source).ok()?;
    let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name))?;
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(value) => Some(value),
        _ => None,
    }
}

#[test]
fn constants_match() {
    let integer = |source: &Source, name| match constant(source, name) {
        Some(naga::Literal::U32(value)) => value,
        other => panic!("{}: {name} is {other:?}", source.label),
    };
    for columns in style::COLUMNS_PER_WORKGROUP {
        let source = style::knn_conv(columns, style::NumberFormat::F16, style::NumberFormat::F16);
        assert_eq!(integer(&source, "COLUMNS_PER_WORKGROUP"), columns);
        assert_eq!(integer(&source, "ROWS_PER_WORKGROUP"), style::ROWS_PER_WORKGROUP);
        // Every adapter has 256 invocations in a workgroup.
        assert!(integer(&source, "WORKGROUP_SIZE") <= 256);
    }
    // Both rasterizers end a splat at the same alpha, to the last bit.
    for (name, expected) in [("MIN_ALPHA", MIN_ALPHA), ("MAX_ALPHA", MAX_ALPHA)] {
        assert_eq!(constant(&splat::draw(), name), Some(naga::Literal::F32(expected)), "{name}");
    }
}

/// A kernel's entry point has its file's name. Shaders that draw have a vertex and a fragment stage.
#[test]
fn entry_points_are_named_like_their_files() {
    for source in sources() {
        let module = validated(&source).unwrap_or_else(|error| panic!("{}:\n{error}", source.label));
        let names: Vec<_> = module.entry_points.iter().map(|entry| entry.name.clone()).collect();
        let label = source.label;
        let is_drawn = names == [format!("{label}_vertex"), format!("{label}_fragment")];
        assert!(names == [label] || is_drawn, "{label} has {names:?}");
    }
}

/// The kernel for clouds without a mask binds none, and differs from the other in a function that returns its
/// argument.
#[test]
fn clouds_without_a_mask_have_a_kernel_without_one() {
    let [plain, masked] = [false, true].map(|masked| validated(&splat::project(masked)).unwrap());
    let bindings = |module: &naga::Module| -> Vec<_> {
        let mut bindings: Vec<_> = module
            .global_variables
            .iter()
            .filter_map(|(_, global)| global.binding)
            .map(|binding| (binding.group, binding.binding))
            .collect();
        bindings.sort();
        bindings
    };
    let mut without = bindings(&masked);
    without.retain(|&binding| binding != (1, 3));
    assert_eq!(bindings(&plain), without);
    assert!(bindings(&masked).contains(&(1, 3)));
    let (_, shown) =
        plain.functions.iter().find(|(_, f)| f.name.as_deref() == Some("shown_opacity")).unwrap();
    let naga::Statement::Return { value: Some(value) } = shown.body[0] else { panic!("{:?}", shown.body) };
    assert_eq!(shown.expressions[value], naga::Expression::FunctionArgument(0));
}
