//! Bevy's meshes, split and joined again.

use bevy::{
    mesh::{
        Indices, MeshAccessError, MeshVertexAttribute, VertexAttributeValues, morph::MorphAttributes,
        skinning::SkinnedMeshBounds,
    },
    prelude::*,
    render::render_resource::PrimitiveTopology,
};
use stylegaussian::mesh::Corners;

use super::material::{OWN, PAINTED, WORDS};

/// Vertices and triangles of a mesh.
///
/// # Errors
/// If it has none that can be painted: what was found, and what was expected.
pub(super) fn triangles(mesh: &Mesh) -> Result<(Vec<Vec3>, Vec<[u32; 3]>), String> {
    let topology = mesh.primitive_topology();
    if topology != PrimitiveTopology::TriangleList {
        return Err(format!("found the topology {topology:?}, expected a list of triangles"));
    }
    let positions = match mesh.try_attribute_option(Mesh::ATTRIBUTE_POSITION).map_err(not_here)? {
        Some(VertexAttributeValues::Float32x3(positions)) => positions,
        Some(_) => return Err("found positions of another format, expected three f32 each".into()),
        None => return Err("found no positions, expected some".into()),
    };
    let n = positions.len();
    let odd = mesh.try_attributes().map_err(not_here)?.find(|(_, values)| values.len() != n);
    if let Some((MeshVertexAttribute { name, .. }, values)) = odd {
        return Err(format!("found {} values of {name}, expected {n}, one for each position", values.len()));
    }
    let numbers: Vec<u32> = match mesh.try_indices_option().map_err(not_here)? {
        Some(Indices::U16(numbers)) => numbers.iter().map(|i| u32::from(*i)).collect(),
        Some(Indices::U32(numbers)) => numbers.clone(),
        None => (0..positions.len() as u32).collect(),
    };
    Ok((positions.iter().copied().map(Vec3::from).collect(), numbers.as_chunks().0.to_vec()))
}

fn not_here(error: MeshAccessError) -> String {
    format!("{error} (load it with RenderAssetUsages::MAIN_WORLD too)")
}

/// Unit normals of the vertices of a mesh, if it has some.
pub(super) fn normals(mesh: &Mesh) -> Option<Vec<Vec3>> {
    let Ok(Some(VertexAttributeValues::Float32x3(normals))) =
        mesh.try_attribute_option(Mesh::ATTRIBUTE_NORMAL)
    else {
        return None;
    };
    Some(normals.iter().copied().map(Vec3::from).collect())
}

/// The same mesh with further vertices, each in the middle of two that come before it, and without triangles.
pub(super) fn with_vertices(mut mesh: Mesh, parents: &[[u32; 2]]) -> Mesh {
    let n = mesh.count_vertices();
    if let Some(targets) = mesh.morph_targets().filter(|_| n > 0) {
        let targets: Vec<Vec<MorphAttributes>> =
            targets.chunks_exact(n).map(|target| extended(target, parents, middle_morph)).collect();
        mesh.set_morph_targets(targets.concat());
    }
    let weights = match mesh.attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT) {
        Some(VertexAttributeValues::Float32x4(weights)) => weights.clone(),
        _ => Vec::new(),
    };
    let joints = match mesh.attribute(Mesh::ATTRIBUTE_JOINT_INDEX) {
        Some(VertexAttributeValues::Uint16x4(joints)) => joints.clone(),
        _ => Vec::new(),
    };
    let middles: Vec<_> = mesh
        .attributes()
        .filter_map(|(attribute, values)| Some((*attribute, with_middles(attribute, values, parents)?)))
        .collect();
    // Of other formats there is no mean that would be right for all: the value of the first vertex.
    let rows: Vec<u32> = (0..mesh.count_vertices() as u32).collect();
    mesh.insert_indices(Indices::U32(extended(&rows, parents, |a, _| a)));
    mesh.duplicate_vertices();
    for (attribute, values) in middles {
        mesh.insert_attribute(attribute, values);
    }
    if !weights.is_empty() && weights.len() == joints.len() {
        let skin: Vec<Skin> = weights.into_iter().zip(joints).collect();
        let (weights, joints): (Vec<_>, Vec<_>) = extended(&skin, parents, middle_skin).into_iter().unzip();
        mesh.insert_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights);
        mesh.insert_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, VertexAttributeValues::Uint16x4(joints));
    }
    mesh
}

/// The painted mesh: its vertices and triangles, and the paint of its vertices. `painted` and `own` are the
/// colors of the vertices that `corners` number.
pub(super) fn painted(
    mut mesh: Mesh,
    corners: &Corners,
    painted: impl Fn(u32) -> [f32; 3],
    own: impl Fn(u32) -> [f32; 3],
) -> Mesh {
    let n = mesh.count_vertices();
    let rows: Vec<u32> = corners.corners.iter().map(|corner| corner.vertex).collect();
    if let Some(targets) = mesh.morph_targets().filter(|_| n > 0) {
        let target =
            |target: &[MorphAttributes]| rows.iter().map(|&i| target[i as usize]).collect::<Vec<_>>();
        let targets: Vec<_> = targets.chunks_exact(n).flat_map(target).collect();
        mesh.set_morph_targets(targets);
    }
    mesh.insert_indices(Indices::U32(rows));
    mesh.duplicate_vertices();
    let of = |color: &dyn Fn(u32) -> [f32; 3]| -> Vec<[f32; 3]> {
        corners.corners.iter().map(|corner| color(corner.vertex)).collect()
    };
    let words = corners.corners.iter().map(|corner| {
        let [a, b, c] = corner.words;
        [a, b, c, corner.corner]
    });
    mesh.insert_attribute(WORDS, VertexAttributeValues::Uint32x4(words.collect()));
    mesh.insert_attribute(PAINTED, of(&painted));
    mesh.insert_attribute(OWN, of(&own));
    mesh.insert_indices(Indices::U32(corners.triangles.as_flattened().to_vec()));
    // A vertex between those of two joints is moved by both, and may lie outside of the boxes of either.
    if mesh.skinned_mesh_bounds().is_some()
        && let Ok(bounds) = SkinnedMeshBounds::from_mesh(&mesh)
    {
        mesh.set_skinned_mesh_bounds(Some(bounds));
    }
    mesh
}

/// Weights of four joints, and the joints.
type Skin = ([f32; 4], [u16; 4]);

/// `values`, and those of further vertices.
fn extended<T: Copy>(values: &[T], parents: &[[u32; 2]], middle: impl Fn(T, T) -> T) -> Vec<T> {
    let mut all = values.to_vec();
    for [a, b] in parents {
        all.push(middle(all[*a as usize], all[*b as usize]));
    }
    all
}

/// The four strongest joints of two vertices.
fn middle_skin((weights_a, joints_a): Skin, (weights_b, joints_b): Skin) -> Skin {
    let mut all: Vec<(f32, u16)> = Vec::with_capacity(8);
    for (weight, joint) in weights_a.into_iter().zip(joints_a).chain(weights_b.into_iter().zip(joints_b)) {
        match all.iter_mut().find(|(_, known)| *known == joint) {
            Some((sum, _)) => *sum += weight,
            None => all.push((weight, joint)),
        }
    }
    // By number where they are equal, so that both sides of a seam are.
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    all.truncate(4);
    all.resize(4, (0.0, 0));
    let total: f32 = all.iter().map(|(weight, _)| weight).sum();
    let total = if total > 0.0 { total } else { 1.0 };
    (std::array::from_fn(|i| all[i].0 / total), std::array::from_fn(|i| all[i].1))
}

fn middle_morph(a: MorphAttributes, b: MorphAttributes) -> MorphAttributes {
    MorphAttributes {
        position: a.position.midpoint(b.position),
        normal: a.normal.midpoint(b.normal),
        tangent: a.tangent.midpoint(b.tangent),
        ..a
    }
}

fn middle<const N: usize>(a: [f32; N], b: [f32; N]) -> [f32; N] {
    std::array::from_fn(|i| 0.5 * a[i] + 0.5 * b[i])
}

/// A unit vector between two.
fn unit(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    Vec3::from(middle(a, b)).try_normalize().unwrap_or(Vec3::from(a)).to_array()
}

/// The values of an attribute, and those of further vertices; `None` for formats without a mean.
fn with_middles(
    attribute: &MeshVertexAttribute,
    values: &VertexAttributeValues,
    parents: &[[u32; 2]],
) -> Option<VertexAttributeValues> {
    use VertexAttributeValues as V;
    let bytes = |a: [u8; 4], b: [u8; 4]| {
        std::array::from_fn(|i| (u16::from(a[i]) + u16::from(b[i])).div_ceil(2) as u8)
    };
    Some(match values {
        V::Float32x3(values) if attribute.id == Mesh::ATTRIBUTE_NORMAL.id => {
            V::Float32x3(extended(values, parents, unit))
        }
        V::Float32x4(values) if attribute.id == Mesh::ATTRIBUTE_TANGENT.id => {
            let tangent = |[x, y, z, hand]: [f32; 4], b: [f32; 4]| {
                let [x, y, z] = unit([x, y, z], [b[0], b[1], b[2]]);
                [x, y, z, hand]
            };
            V::Float32x4(extended(values, parents, tangent))
        }
        V::Float32(values) => V::Float32(extended(values, parents, |a, b| 0.5 * a + 0.5 * b)),
        V::Float32x2(values) => V::Float32x2(extended(values, parents, middle)),
        V::Float32x3(values) => V::Float32x3(extended(values, parents, middle)),
        V::Float32x4(values) => V::Float32x4(extended(values, parents, middle)),
        V::Unorm8x4(values) => V::Unorm8x4(extended(values, parents, bytes)),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use bevy::asset::RenderAssetUsages;
    use stylegaussian::{
        mesh::{Corner, Split},
        work::Work,
    };

    use super::*;

    fn triangle() -> Mesh {
        Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
            .with_inserted_attribute(
                Mesh::ATTRIBUTE_POSITION,
                vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            )
            .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, vec![[0.0, 0.0], [1.0, 0.5], [0.0, 1.0]])
            .with_inserted_attribute(
                Mesh::ATTRIBUTE_JOINT_WEIGHT,
                vec![[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]],
            )
            .with_inserted_attribute(
                Mesh::ATTRIBUTE_JOINT_INDEX,
                VertexAttributeValues::Uint16x4(vec![[3, 0, 0, 0], [3, 7, 0, 0], [9, 0, 0, 0]]),
            )
            .with_inserted_indices(Indices::U16(vec![0, 1, 2]))
    }

    #[test]
    fn middles_have_means_and_the_joints_of_both() {
        let (positions, triangles) = triangles(&triangle()).unwrap();
        let split = Split::new(positions, triangles, 3.0, &Work::default()).unwrap();
        let mesh = with_vertices(triangle(), &split.parents);
        assert_eq!(mesh.count_vertices(), split.positions.len());
        let i = 3 + split.parents.iter().position(|parents| *parents == [0, 1]).unwrap();
        let Some(VertexAttributeValues::Float32x2(uvs)) = mesh.attribute(Mesh::ATTRIBUTE_UV_0) else {
            panic!()
        };
        assert_eq!(uvs[i], [0.5, 0.25]);
        let Some(VertexAttributeValues::Float32x4(weights)) = mesh.attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT)
        else {
            panic!()
        };
        let Some(VertexAttributeValues::Uint16x4(joints)) = mesh.attribute(Mesh::ATTRIBUTE_JOINT_INDEX)
        else {
            panic!()
        };
        assert_eq!((weights[i], joints[i][..2].to_vec()), ([0.75, 0.25, 0.0, 0.0], vec![3, 7]));
    }

    #[test]
    fn corners_become_vertices() {
        let corner = |vertex: u32, corner: u32| Corner { vertex, words: [5, 6, 7], corner };
        let corners =
            Corners { corners: vec![corner(2, 0), corner(0, 1), corner(1, 2)], triangles: vec![[0, 1, 2]] };
        let mesh = painted(with_vertices(triangle(), &[]), &corners, |i| [i as f32; 3], |_| [0.5; 3]);
        assert_eq!(mesh.count_vertices(), 3);
        let Some(VertexAttributeValues::Float32x3(at)) = mesh.attribute(Mesh::ATTRIBUTE_POSITION) else {
            panic!()
        };
        assert_eq!(at[0], [0.0, 1.0, 0.0]);
        let Some(VertexAttributeValues::Uint32x4(words)) = mesh.attribute(WORDS) else { panic!() };
        assert_eq!(words[2], [5, 6, 7, 2]);
        let Some(VertexAttributeValues::Float32x3(colors)) = mesh.attribute(PAINTED) else { panic!() };
        assert_eq!(colors[0], [2.0; 3]);
        assert_eq!(mesh.indices().unwrap().len(), 3);
    }

    /// Of three vertices, joint 7 moves the second one alone. It also moves those between that and the others.
    #[test]
    fn boxes_of_joints_hold_the_vertices_in_between() {
        let mesh = triangle().with_generated_skinned_mesh_bounds().unwrap();
        let (positions, given) = triangles(&mesh).unwrap();
        let split = Split::new(positions, given, 3.0, &Work::default()).unwrap();
        let corner = |vertex: &u32| Corner { vertex: *vertex, words: [0; 3], corner: 0 };
        let corners: Vec<Corner> = split.triangles.as_flattened().iter().map(corner).collect();
        let numbers: Vec<u32> = (0..corners.len() as u32).collect();
        let corners = Corners { corners, triangles: numbers.as_chunks().0.to_vec() };
        let size = |mesh: &Mesh| {
            let bounds = mesh.skinned_mesh_bounds().unwrap();
            bounds.iter().find(|(joint, _)| joint.0 == 7).map(|(_, aabb)| aabb.half_size.x)
        };
        assert_eq!(size(&mesh), Some(0.0));
        let mesh = painted(with_vertices(mesh, &split.parents), &corners, |_| [0.5; 3], |_| [0.5; 3]);
        assert!(size(&mesh).unwrap() >= 0.5);
        // A game that asks for no boxes gets none.
        let plain = painted(with_vertices(triangle(), &split.parents), &corners, |_| [0.5; 3], |_| [0.5; 3]);
        assert!(plain.skinned_mesh_bounds().is_none());
    }

    #[test]
    fn what_cannot_be_painted_says_so() {
        let lines = Mesh::new(PrimitiveTopology::LineList, RenderAssetUsages::default());
        assert!(triangles(&lines).unwrap_err().contains("LineList"));
        let empty = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default());
        assert!(triangles(&empty).unwrap_err().contains("positions"));
        let short = triangle().with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, vec![[0.5; 2]; 2]);
        assert!(triangles(&short).unwrap_err().contains("2 values of Vertex_Uv, expected 3"));
        let plain = triangle().with_removed_attribute(Mesh::ATTRIBUTE_JOINT_INDEX);
        assert_eq!(triangles(&plain).unwrap().1, [[0, 1, 2]]);
        assert_eq!(normals(&plain), None);
    }
}
