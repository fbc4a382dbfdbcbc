//! Binary glTF 2.0: one node with one mesh, in meters, with normals.

use glam::DVec3;
use pirouette_geom::TriMesh;
use serde_json::json;

const METERS_PER_MM: f64 = 1e-3;

/// The bytes of a GLB file: y up, meters (`mesh` is in millimeters), vertex normals, one matte material
///
/// # Panics
/// When a triangle names a vertex that does not exist.
pub fn write_glb(mesh: &TriMesh) -> Vec<u8> {
    // glTF forbids empty accessors: without triangles the node stays empty.
    let (document, binary) = if mesh.triangles.is_empty() {
        (
            json!({
                "asset": asset(),
                "scene": 0,
                "scenes": [{ "nodes": [0] }],
                "nodes": [{ "name": "body" }]
            }),
            Vec::new(),
        )
    } else {
        with_mesh(mesh)
    };
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut chunks = Vec::with_capacity(text.len() + binary.len() + 28);
    push_chunk(&mut chunks, b"JSON", &text);
    if !binary.is_empty() {
        push_chunk(&mut chunks, b"BIN\0", &binary);
    }
    let mut bytes = Vec::with_capacity(chunks.len() + 12);
    bytes.extend(b"glTF");
    bytes.extend(2u32.to_le_bytes());
    bytes.extend((chunks.len() as u32 + 12).to_le_bytes());
    bytes.extend(chunks);
    bytes
}

fn asset() -> serde_json::Value {
    json!({ "version": "2.0", "generator": concat!("pirouette ", env!("CARGO_PKG_VERSION")) })
}

fn push_chunk(bytes: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(kind);
    bytes.extend(data);
}

/// The document and its buffer: positions, normals, indices
fn with_mesh(mesh: &TriMesh) -> (serde_json::Value, Vec<u8>) {
    const FLOAT: u32 = 5126;
    const UNSIGNED_INT: u32 = 5125;
    const ARRAY_BUFFER: u32 = 34962;
    const ELEMENT_ARRAY_BUFFER: u32 = 34963;

    let vertex_count = mesh.positions.len();
    let vertex_bytes = 12 * vertex_count;
    let index_bytes = 12 * mesh.triangles.len();
    let mut binary = Vec::with_capacity(2 * vertex_bytes + index_bytes);
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for &position in &mesh.positions {
        let meters = (position * METERS_PER_MM).to_array().map(|v| v as f32);
        for (axis, value) in meters.into_iter().enumerate() {
            lo[axis] = lo[axis].min(value);
            hi[axis] = hi[axis].max(value);
            binary.extend(value.to_le_bytes());
        }
    }
    for normal in mesh.vertex_normals() {
        // glTF asks for unit normals, also where the surface has no area.
        let normal = if normal == DVec3::ZERO {
            DVec3::Y
        } else {
            normal
        };
        for value in normal.to_array() {
            binary.extend((value as f32).to_le_bytes());
        }
    }
    for vertex in mesh.triangles.iter().flatten() {
        binary.extend(vertex.to_le_bytes());
    }
    let document = json!({
        "asset": asset(),
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "body", "mesh": 0 }],
        "meshes": [{
            "name": "body",
            "primitives": [{
                "attributes": { "POSITION": 0, "NORMAL": 1 },
                "indices": 2,
                "material": 0
            }]
        }],
        "materials": [{
            "name": "matte",
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.8, 0.8, 0.8, 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": 0.9
            }
        }],
        "accessors": [
            { "bufferView": 0, "componentType": FLOAT, "count": vertex_count, "type": "VEC3", "min": lo, "max": hi },
            { "bufferView": 1, "componentType": FLOAT, "count": vertex_count, "type": "VEC3" },
            { "bufferView": 2, "componentType": UNSIGNED_INT, "count": 3 * mesh.triangles.len(), "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": vertex_bytes, "target": ARRAY_BUFFER },
            { "buffer": 0, "byteOffset": vertex_bytes, "byteLength": vertex_bytes, "target": ARRAY_BUFFER },
            { "buffer": 0, "byteOffset": 2 * vertex_bytes, "byteLength": index_bytes, "target": ELEMENT_ARRAY_BUFFER }
        ],
        "buffers": [{ "byteLength": binary.len() }]
    });
    (document, binary)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gltf_reader_finds_the_mesh_in_meters() {
        let mesh = TriMesh {
            positions: vec![
                DVec3::ZERO,
                DVec3::X * 1500.0,
                DVec3::Y * 250.0,
                DVec3::Z * 10.0,
            ],
            triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
        };
        let bytes = write_glb(&mesh);
        assert_eq!(bytes.len() % 4, 0);
        let gltf = gltf::Gltf::from_slice(&bytes).expect("the document is valid");
        let blob = gltf.blob.clone().expect("there is a binary chunk");
        let primitive = gltf.meshes().flat_map(|m| m.primitives()).next();
        let primitive = primitive.expect("there is one primitive");
        let reader = primitive.reader(|_| Some(&blob));
        let positions: Vec<[f32; 3]> = reader.read_positions().expect("positions").collect();
        assert_eq!(positions[1], [1.5, 0.0, 0.0]);
        assert_eq!(positions.len(), 4);
        let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
        assert_eq!(indices, mesh.triangles.concat());
        for normal in reader.read_normals().expect("normals") {
            let length: f32 = normal.iter().map(|v| v * v).sum();
            assert!((length - 1.0).abs() < 1e-5);
        }
        let bounds = primitive.bounding_box();
        assert_eq!((bounds.min, bounds.max), ([0.0; 3], [1.5, 0.25, 0.01]));
    }

    #[test]
    fn an_empty_mesh_is_an_empty_node() {
        let bytes = write_glb(&TriMesh::default());
        let gltf = gltf::Gltf::from_slice(&bytes).expect("the document is valid");
        assert_eq!(gltf.meshes().count(), 0);
    }
}
