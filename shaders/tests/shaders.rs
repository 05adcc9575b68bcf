//! Every joined shader parses and validates, and every struct that both sides know has one layout.

use std::collections::HashMap;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use stylegaussian_shaders::{Layout, Source, splat, style};

fn sources() -> Vec<Source> {
    [style::sources(), splat::sources()].concat()
}

fn layouts() -> Vec<Layout> {
    [style::layouts(), splat::layouts()].concat()
}

/// What every adapter offers that WebGPU's core demands; naga counts them as optional for OpenGL's sake.
const CORE: Capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32.union(Capabilities::MULTISAMPLED_SHADING);

/// Parses and validates with no optional capability: what passes runs on every adapter.
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

/// The value of a `const NAME: u32` of a module.
fn constant(source: &Source, name: &str) -> Option<u32> {
    let module = validated(source).ok()?;
    let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name))?;
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(naga::Literal::U32(value)) => Some(value),
        _ => None,
    }
}

#[test]
fn constants_match() {
    for columns in style::TILE_COLUMNS {
        let source = style::knn_conv(columns, style::Storage::F16, style::Storage::F16);
        assert_eq!(constant(&source, "TILE_ROWS"), Some(style::TILE_ROWS));
        assert_eq!(constant(&source, "TILE_COLUMNS"), Some(columns));
        assert!(constant(&source, "WORKGROUP_SIZE").is_some_and(|size| size <= 256));
    }
    for source in [style::color(style::Storage::F16), style::smoothing_pass()] {
        assert_eq!(constant(&source, "COLOR_WORKGROUP_SIZE"), Some(style::COLOR_WORKGROUP_SIZE));
    }
}
