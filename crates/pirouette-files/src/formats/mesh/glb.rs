//! Binary glTF 2.0: one mesh with normals in meters, with optional colors and bones.

use glam::{DMat4, DVec3};
use pirouette_geom::TriMesh;
use serde_json::{Value, json};

use super::{BodyMesh, Skin};
use pirouette_body::Bone;
use pirouette_body::render::linear_from_srgb;

const METERS_PER_MM: f64 = 1e-3;

/// Returns the bytes of a GLB file: y up, meters (`body` is in millimeters), vertex normals, one matte material
///
/// A skinned body has one node per bone, all without rotation and named so that Blender recognizes the sides
/// (`forearm.L`); other programs pose it by rotating them.
///
/// # Panics
/// When a triangle refers to a vertex that does not exist, or colors or skinning weights do not match the vertices.
pub fn write_glb(body: &BodyMesh) -> Vec<u8> {
    // glTF forbids empty accessors: without triangles the node has no mesh.
    let (document, binary) = if body.mesh.triangles.is_empty() {
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
        with_mesh(body)
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

fn asset() -> Value {
    json!({ "version": "2.0", "generator": concat!("pirouette ", env!("CARGO_PKG_VERSION")) })
}

fn push_chunk(bytes: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(kind);
    bytes.extend(data);
}

const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The buffer of a document, with its views and accessors
#[derive(Default)]
struct Buffer {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Appends values, whose elements are multiples of four bytes, and returns their accessor
    fn push(&mut self, bytes: &[u8], target: Option<u32>, mut accessor: Value) -> usize {
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        accessor["bufferView"] = json!(self.views.len());
        self.views.push(view);
        self.accessors.push(accessor);
        self.binary.extend(bytes);
        self.accessors.len() - 1
    }
}

fn float_bytes(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    let floats = values.into_iter().map(|value| value as f32);
    floats.flat_map(f32::to_le_bytes).collect()
}

/// Returns the document and its buffer
fn with_mesh(body: &BodyMesh) -> (Value, Vec<u8>) {
    let mut buffer = Buffer::default();
    let (mut attributes, indices) = push_surface(&mut buffer, body.mesh);
    if let Some(colors) = body.colors {
        assert_eq!(
            colors.len(),
            body.mesh.positions.len(),
            "one color per vertex"
        );
        push_colors(&mut buffer, colors, &mut attributes);
    }
    // Vertex colors are multiplied by the color of the material.
    let base = if body.colors.is_some() { 1.0 } else { 0.8 };
    let mut scene = vec![0];
    let mut nodes = vec![json!({ "name": "body", "mesh": 0 })];
    let mut skins = Vec::new();
    if let Some(skin) = &body.skin {
        assert_eq!(
            skin.weights.len(),
            body.mesh.positions.len(),
            "one skinning weight per vertex"
        );
        push_weights(&mut buffer, skin, &mut attributes);
        let inverse_binds = push_inverse_binds(&mut buffer, skin);
        let first_bone = nodes.len();
        nodes[0]["skin"] = json!(0);
        nodes.extend(bone_nodes(skin, first_bone));
        scene.push(first_bone);
        skins.push(json!({
            "name": "skeleton",
            "joints": Bone::ALL.map(|bone| first_bone + bone as usize),
            "skeleton": first_bone,
            "inverseBindMatrices": inverse_binds
        }));
    }
    let mut document = json!({
        "asset": asset(),
        "scene": 0,
        "scenes": [{ "nodes": scene }],
        "nodes": nodes,
        "meshes": [{
            "name": "body",
            "primitives": [{ "attributes": attributes, "indices": indices, "material": 0 }]
        }],
        "materials": [{
            "name": "matte",
            "pbrMetallicRoughness": {
                "baseColorFactor": [base, base, base, 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": 0.9
            }
        }],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.binary.len() }]
    });
    // glTF forbids empty lists, too.
    if !skins.is_empty() {
        document["skins"] = json!(skins);
    }
    (document, buffer.binary)
}

/// Writes positions, normals and indices; returns the attributes and the accessor of the indices
fn push_surface(buffer: &mut Buffer, mesh: &TriMesh) -> (Value, usize) {
    let vertex_count = mesh.positions.len();
    let meters = |p: &DVec3| (*p * METERS_PER_MM).to_array().map(|v| v as f32);
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for position in mesh.positions.iter().map(meters) {
        for (axis, value) in position.into_iter().enumerate() {
            lo[axis] = lo[axis].min(value);
            hi[axis] = hi[axis].max(value);
        }
    }
    let positions: Vec<u8> = mesh
        .positions
        .iter()
        .flat_map(meters)
        .flat_map(f32::to_le_bytes)
        .collect();
    let position = buffer.push(
        &positions,
        Some(ARRAY_BUFFER),
        json!({ "componentType": FLOAT, "count": vertex_count, "type": "VEC3", "min": lo, "max": hi }),
    );
    // glTF requires unit normals, also at vertices without area.
    let normals = mesh.vertex_normals().into_iter().flat_map(|normal| {
        let normal = if normal == DVec3::ZERO {
            DVec3::Y
        } else {
            normal
        };
        normal.to_array()
    });
    let normal = buffer.push(
        &float_bytes(normals),
        Some(ARRAY_BUFFER),
        json!({ "componentType": FLOAT, "count": vertex_count, "type": "VEC3" }),
    );
    let corners = mesh.triangles.iter().flatten();
    let corners: Vec<u8> = corners.flat_map(|v| v.to_le_bytes()).collect();
    let indices = buffer.push(
        &corners,
        Some(ELEMENT_ARRAY_BUFFER),
        json!({ "componentType": UNSIGNED_INT, "count": 3 * mesh.triangles.len(), "type": "SCALAR" }),
    );
    let attributes = json!({ "POSITION": position, "NORMAL": normal });
    (attributes, indices)
}

/// Writes linear colors in 16 bits, since 8 bits would cause visible steps in dark colors
fn push_colors(buffer: &mut Buffer, colors: &[[u8; 3]], attributes: &mut Value) {
    let level = |v: u8| (65535.0 * linear_from_srgb(f32::from(v) / 255.0)).round() as u16;
    // The fourth channel, opaque, pads the elements to words.
    let levels = colors
        .iter()
        .flat_map(|c| [level(c[0]), level(c[1]), level(c[2]), u16::MAX]);
    let bytes: Vec<u8> = levels.flat_map(u16::to_le_bytes).collect();
    attributes["COLOR_0"] = json!(buffer.push(
        &bytes,
        Some(ARRAY_BUFFER),
        json!({
            "componentType": UNSIGNED_SHORT, "normalized": true, "count": colors.len(), "type": "VEC4"
        }),
    ));
}

/// Writes four bones per vertex and their weights
fn push_weights(buffer: &mut Buffer, skin: &Skin, attributes: &mut Value) {
    let (mut joints, mut weights) = (Vec::new(), Vec::new());
    for weight in skin.weights {
        let mut slots = [(0u8, 0.0); 4];
        for (slot, (bone, share)) in slots.iter_mut().zip(weight.iter()) {
            *slot = (bone as u8, share);
        }
        joints.extend(slots.map(|(joint, _)| joint));
        weights.extend(slots.map(|(_, share)| share));
    }
    let count = skin.weights.len();
    attributes["JOINTS_0"] = json!(buffer.push(
        &joints,
        Some(ARRAY_BUFFER),
        json!({ "componentType": UNSIGNED_BYTE, "count": count, "type": "VEC4" }),
    ));
    attributes["WEIGHTS_0"] = json!(buffer.push(
        &float_bytes(weights),
        Some(ARRAY_BUFFER),
        json!({ "componentType": FLOAT, "count": count, "type": "VEC4" }),
    ));
}

fn push_inverse_binds(buffer: &mut Buffer, skin: &Skin) -> usize {
    let matrices = skin.bone_heads.iter().flat_map(|head| {
        let bone_from_mesh = DMat4::from_translation(-*head * METERS_PER_MM);
        bone_from_mesh.to_cols_array()
    });
    buffer.push(
        &float_bytes(matrices),
        None,
        json!({ "componentType": FLOAT, "count": Bone::COUNT, "type": "MAT4" }),
    )
}

/// One node per bone, parents first; the first one has index `first`
fn bone_nodes(skin: &Skin, first: usize) -> impl Iterator<Item = Value> {
    let head = |bone: Bone| skin.bone_heads[bone];
    Bone::ALL.into_iter().map(move |bone| {
        let offset = head(bone) - bone.parent().map_or(DVec3::ZERO, head);
        let mut node = json!({
            "name": node_name(bone),
            "translation": (offset * METERS_PER_MM).to_array()
        });
        let children: Vec<usize> = Bone::ALL
            .into_iter()
            .filter(|child| child.parent() == Some(bone))
            .map(|child| first + child as usize)
            .collect();
        if !children.is_empty() {
            node["children"] = json!(children);
        }
        node
    })
}

/// Returns the name of a bone's node, with the side as a suffix, as Blender and Rigify expect
///
/// The root is named `hips`, because in many rigs `root` lies on the floor.
fn node_name(bone: Bone) -> String {
    let name = bone.name();
    if bone == Bone::Root {
        "hips".to_owned()
    } else if let Some(part) = name.strip_prefix("left_") {
        format!("{part}.L")
    } else if let Some(part) = name.strip_prefix("right_") {
        format!("{part}.R")
    } else {
        name.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::gltf::load_avatar;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};
    use pirouette_body::{Avatar, Pose, ReferencePose, Sex, TurnAngle};

    #[test]
    fn a_gltf_reader_reads_the_mesh_in_meters() {
        let mesh = TriMesh {
            positions: vec![
                DVec3::ZERO,
                DVec3::X * 1500.0,
                DVec3::Y * 250.0,
                DVec3::Z * 10.0,
            ],
            triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
        };
        let bytes = write_glb(&BodyMesh::from(&mesh));
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
    fn colors_are_stored_as_linear_values() {
        let mesh = TriMesh {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]],
        };
        let colors = [[255, 0, 188], [1, 2, 3], [255; 3]];
        let body = BodyMesh {
            colors: Some(&colors),
            ..BodyMesh::from(&mesh)
        };
        let gltf = gltf::Gltf::from_slice(&write_glb(&body)).expect("the document is valid");
        let blob = gltf.blob.clone();
        let primitive = gltf.meshes().flat_map(|m| m.primitives()).next();
        let primitive = primitive.expect("there is one primitive");
        let reader = primitive.reader(|_| blob.as_deref());
        let read: Vec<[f32; 4]> = reader
            .read_colors(0)
            .expect("colors")
            .into_rgba_f32()
            .collect();
        assert_eq!(read[0][..2], [1.0, 0.0]);
        assert!((read[0][2] - 0.5029).abs() < 1e-3, "{:?}", read[0]);
        assert!(read[1][0] > 0.0 && read[1][0] < read[1][1] && read[1][1] < read[1][2]);
        assert_eq!(read[2], [1.0; 4]);
    }

    #[test]
    fn an_empty_mesh_is_an_empty_node() {
        let bytes = write_glb(&BodyMesh::from(&TriMesh::default()));
        let gltf = gltf::Gltf::from_slice(&bytes).expect("the document is valid");
        assert_eq!(gltf.meshes().count(), 0);
    }

    fn woman(pose: ReferencePose) -> Avatar {
        let parameters = MannequinParameters {
            sex: Sex::Female,
            stature_mm: Some(1600.0),
            mass_kg: Some(70.0),
            pose,
            ..MannequinParameters::default()
        };
        mannequin(&parameters).expect("valid parameters")
    }

    #[test]
    fn a_skinned_body_reads_back_as_the_same_avatar() {
        for pose in [ReferencePose::A, ReferencePose::T] {
            let avatar = woman(pose);
            let bytes = write_glb(&BodyMesh::from(&avatar));
            let read = load_avatar(&bytes, pose).expect("it was just written");
            read.check().expect("a sound avatar");
            // The order of vertices differs, that of triangles does not.
            assert_eq!(read.mesh.triangles.len(), avatar.mesh.triangles.len());
            for bone in Bone::ALL {
                let (a, b) = (read.bone_heads, avatar.bone_heads);
                let off = a[bone] - b[bone];
                assert!(off.length() < 0.01, "{bone:?} {off}");
            }
            let rotations = std::array::from_fn(|i| 0.4 * (1.7 * i as f64).sin());
            let bent = Pose::from_parameters(&rotations);
            let corners = |avatar: &Avatar| -> Vec<DVec3> {
                let positions = avatar.posed(&bent, TurnAngle::default()).positions;
                let vertices = avatar.mesh.triangles.iter().flatten();
                vertices.map(|&v| positions[v as usize]).collect()
            };
            let off = corners(&read)
                .iter()
                .zip(&corners(&avatar))
                .map(|(a, b)| (*a - *b).length())
                .fold(0.0, f64::max);
            assert!(off < 0.02, "posed vertices differ by {off} mm");
        }
    }

    #[test]
    fn every_bone_is_a_joint_attached_to_its_parent() {
        let avatar = woman(ReferencePose::A);
        let bytes = write_glb(&BodyMesh::from(&avatar));
        let gltf = gltf::Gltf::from_slice(&bytes).expect("the document is valid");
        let skin = gltf.skins().next().expect("there is a skin");
        assert_eq!(skin.joints().count(), Bone::COUNT);
        let children = |name: &str| -> Vec<String> {
            let node = gltf.nodes().find(|n| n.name() == Some(name));
            let children = node.expect(name).children();
            children
                .filter_map(|c| c.name().map(str::to_owned))
                .collect()
        };
        assert_eq!(children("hips"), ["lower_spine", "thigh.L", "thigh.R"]);
        assert_eq!(children("forearm.R"), ["hand.R"]);
        assert!(children("head").is_empty());
        let primitive = gltf.meshes().flat_map(|m| m.primitives()).next();
        let blob = gltf.blob.clone();
        let primitive = primitive.expect("there is one primitive");
        let reader = primitive.reader(|_| blob.as_deref());
        let weights = reader.read_weights(0).expect("weights").into_f32();
        for weights in weights {
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        }
    }
}
