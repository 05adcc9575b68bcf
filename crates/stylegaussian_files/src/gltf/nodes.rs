//! The tree of nodes: which meshes are shown, and where.

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use serde_json::Value;

use super::{document::index, instances};
use crate::error::{Mismatch, mismatch};

/// A mesh that a node shows.
#[derive(Clone, Copy)]
pub(super) struct Shown<'a> {
    /// The index of the mesh.
    pub mesh: usize,
    /// The node's transform to the world.
    pub world_from_node: DAffine3,
    /// Attributes of its instances, or `None` if there is one.
    pub instances: Option<&'a Value>,
}

/// The meshes of the scene. Without a scene, all roots are shown; without a node, all meshes.
pub(super) fn meshes(json: &Value) -> Result<Vec<Shown<'_>>, Mismatch> {
    let nodes = json["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    if nodes.is_empty() {
        let n_meshes = json["meshes"].as_array().map_or(0, Vec::len);
        let shown = |mesh| Shown { mesh, world_from_node: DAffine3::IDENTITY, instances: None };
        return Ok((0..n_meshes).map(shown).collect());
    }
    let mut found = Vec::new();
    let mut is_visited = vec![false; nodes.len()];
    let mut open: Vec<(usize, DAffine3)> =
        roots(json, nodes)?.into_iter().map(|node| (node, DAffine3::IDENTITY)).collect();
    // The last one is taken first.
    open.reverse();
    while let Some((node, world_from_parent)) = open.pop() {
        let json =
            nodes.get(node).ok_or_else(|| mismatch(format_args!("node {node}"), "an index that exists"))?;
        if std::mem::replace(&mut is_visited[node], true) {
            return Err(mismatch(format_args!("node {node} in two places"), "a tree of nodes"));
        }
        let world_from_node = world_from_parent * local(json, node)?;
        if let Some(mesh) = json.get("mesh") {
            let mesh = index(mesh)
                .ok_or_else(|| mismatch(format_args!("mesh {mesh} of node {node}"), "an index"))?;
            let instances = json["extensions"].get(instances::EXTENSION).map(|of| &of["attributes"]);
            found.push(Shown { mesh, world_from_node, instances });
        }
        let children = indices(&json["children"])?;
        open.extend(children.into_iter().rev().map(|child| (child, world_from_node)));
    }
    Ok(found)
}

/// The roots of the default scene, or the nodes that are nobody's children if there is no scene.
fn roots(json: &Value, nodes: &[Value]) -> Result<Vec<usize>, Mismatch> {
    let scene = index(&json["scene"]).unwrap_or(0);
    if let Some(scene) = json["scenes"].get(scene) {
        return indices(&scene["nodes"]);
    }
    let mut is_child = vec![false; nodes.len()];
    for node in nodes {
        for child in indices(&node["children"])? {
            if let Some(is_child) = is_child.get_mut(child) {
                *is_child = true;
            }
        }
    }
    Ok((0..nodes.len()).filter(|&node| !is_child[node]).collect())
}

/// A node's transform to its parent: `matrix`, or translation, rotation and scale.
fn local(node: &Value, number: usize) -> Result<DAffine3, Mismatch> {
    let wrong =
        |what: &str| mismatch(format_args!("node {number} with a wrong {what}"), "a finite affine transform");
    let transform = match node.get("matrix") {
        Some(matrix) => {
            let matrix = DMat4::from_cols_array(&numbers::<16>(matrix).ok_or_else(|| wrong("matrix"))?);
            if matrix.row(3).abs_diff_eq(glam::DVec4::W, 1e-6) {
                DAffine3::from_mat4(matrix)
            } else {
                return Err(wrong("last row of its matrix"));
            }
        }
        None => {
            let part = |key: &str, default: [f64; 3]| match node.get(key) {
                Some(value) => numbers::<3>(value).ok_or_else(|| wrong(key)),
                None => Ok(default),
            };
            let rotation = match node.get("rotation") {
                Some(value) => DQuat::from_array(numbers::<4>(value).ok_or_else(|| wrong("rotation"))?),
                None => DQuat::IDENTITY,
            };
            if !(0.5..2.0).contains(&rotation.length()) {
                return Err(wrong("rotation"));
            }
            let rotation = DMat3::from_quat(rotation.normalize());
            let scale = DMat3::from_diagonal(DVec3::from_array(part("scale", [1.0; 3])?));
            DAffine3 {
                matrix3: rotation * scale,
                translation: DVec3::from_array(part("translation", [0.0; 3])?),
            }
        }
    };
    if transform.is_finite() { Ok(transform) } else { Err(wrong("number")) }
}

fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let values: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_f64).collect();
    values?.try_into().ok()
}

fn indices(value: &Value) -> Result<Vec<usize>, Mismatch> {
    let items = value.as_array().into_iter().flatten();
    let found =
        items.map(|item| index(item).ok_or_else(|| mismatch(format_args!("node {item}"), "an index")));
    found.collect()
}
