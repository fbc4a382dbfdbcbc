//! The parts of a glTF 2.0 file required for a posable body: nodes, skins, meshes, accessors.
//!
//! Input is untrusted: every index and range is checked where it is used, and every defect is an error that names the
//! accessor. Buffers are the binary chunk or data URIs; other files are not opened.

use serde::Deserialize;
use serde_json::Value;

use super::LoadAvatarError;

/// Largest number of elements per accessor; more than any body, and a bound on the memory that a corrupt file can make
/// us allocate
const MAX_ELEMENTS: usize = 20_000_000;

const GLB_MAGIC: &[u8] = b"glTF";
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BINARY: u32 = 0x004E_4942;

/// Extensions that store geometry in encodings that are not supported
const UNREADABLE: [&str; 2] = ["KHR_draco_mesh_compression", "EXT_meshopt_compression"];

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Root {
    #[serde(default)]
    pub(super) nodes: Vec<Node>,
    #[serde(default)]
    pub(super) meshes: Vec<Mesh>,
    #[serde(default)]
    pub(super) skins: Vec<Skin>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<BufferView>,
    #[serde(default)]
    buffers: Vec<Buffer>,
    #[serde(default)]
    extensions_required: Vec<String>,
    #[serde(default)]
    pub(super) extensions: Value,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Node {
    #[serde(default)]
    pub(super) name: String,
    #[serde(default)]
    pub(super) children: Vec<usize>,
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
    pub(super) mesh: Option<usize>,
    pub(super) skin: Option<usize>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Mesh {
    #[serde(default)]
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    #[serde(default)]
    pub(super) attributes: std::collections::BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    /// 4 is a list of triangles, 5 a strip, 6 a fan
    pub(super) mode: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Skin {
    #[serde(default)]
    pub(super) joints: Vec<usize>,
    pub(super) inverse_bind_matrices: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    #[serde(default)]
    normalized: bool,
    count: usize,
    #[serde(rename = "type")]
    shape: String,
    sparse: Option<Sparse>,
}

#[derive(Debug, Deserialize)]
struct Sparse {
    count: usize,
    indices: SparseIndices,
    values: SparseValues,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct SparseIndices {
    buffer_view: usize,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct SparseValues {
    buffer_view: usize,
    #[serde(default)]
    byte_offset: usize,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

#[derive(Debug, Deserialize)]
struct Buffer {
    uri: Option<String>,
}

/// A defect of an accessor
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum AccessorDefect {
    #[error("it does not exist")]
    Missing,
    #[error("it refers to a buffer view or buffer that does not exist")]
    MissingView,
    #[error("it extends beyond its buffer")]
    OutOfBounds,
    #[error("its component type is unknown")]
    ComponentType,
    #[error("it has the wrong shape for its use")]
    Shape,
    #[error("it has more elements than a body can have")]
    TooMany,
    #[error("a sparse index is out of range")]
    SparseIndex,
}

/// A parsed file with its buffers
#[derive(Debug)]
pub(super) struct Document {
    pub(super) root: Root,
    buffers: Vec<Option<Vec<u8>>>,
}

impl Document {
    /// Reads a GLB, VRM or glTF file
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, LoadAvatarError> {
        let (json, mut binary) = if bytes.starts_with(GLB_MAGIC) {
            split_glb(bytes)?
        } else {
            (bytes, None)
        };
        let root: Root = serde_json::from_slice(json).map_err(LoadAvatarError::Json)?;
        if let Some(name) = UNREADABLE
            .iter()
            .find(|name| root.extensions_required.iter().any(|r| r == *name))
        {
            return Err(LoadAvatarError::Compressed { extension: name });
        }
        let buffers = root
            .buffers
            .iter()
            .map(|buffer| match &buffer.uri {
                // the first buffer without an address is the binary chunk
                None => binary.take().map(<[u8]>::to_vec),
                Some(uri) => data_uri(uri),
            })
            .collect();
        Ok(Self { root, buffers })
    }

    /// All elements of an accessor as numbers, `N` per element; normalized integers become fractions
    pub(super) fn read<const N: usize>(
        &self,
        index: usize,
    ) -> Result<Vec<[f64; N]>, LoadAvatarError> {
        let fail = |defect| LoadAvatarError::Accessor {
            accessor: index,
            defect,
        };
        let accessor = self
            .root
            .accessors
            .get(index)
            .ok_or(fail(AccessorDefect::Missing))?;
        let component = Component::from_code(accessor.component_type)
            .ok_or(fail(AccessorDefect::ComponentType))?;
        let columns = match accessor.shape.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => return Err(fail(AccessorDefect::Shape)),
        };
        if columns != N {
            return Err(fail(AccessorDefect::Shape));
        }
        if accessor.count > MAX_ELEMENTS {
            return Err(fail(AccessorDefect::TooMany));
        }
        let decode = |bytes: &[u8]| -> [f64; N] {
            std::array::from_fn(|k| component.decode(bytes, k, accessor.normalized))
        };
        let size = N * component.size();
        let mut elements = match accessor.buffer_view {
            None => vec![[0.0; N]; accessor.count],
            Some(view) => self
                .elements(index, view, accessor.byte_offset, accessor.count, size)?
                .map(decode)
                .collect(),
        };
        if let Some(sparse) = &accessor.sparse {
            let codes = Component::from_code(sparse.indices.component_type)
                .ok_or(fail(AccessorDefect::ComponentType))?;
            let (places, values) = (&sparse.indices, &sparse.values);
            let at = self
                .elements(
                    index,
                    places.buffer_view,
                    places.byte_offset,
                    sparse.count,
                    codes.size(),
                )?
                .map(|bytes| codes.decode(bytes, 0, false));
            let new = self
                .elements(
                    index,
                    values.buffer_view,
                    values.byte_offset,
                    sparse.count,
                    size,
                )?
                .map(decode);
            for (place, value) in at.zip(new) {
                *elements
                    .get_mut(place as usize)
                    .ok_or(fail(AccessorDefect::SparseIndex))? = value;
            }
        }
        Ok(elements)
    }

    /// The bytes of each element in a buffer view
    fn elements(
        &self,
        accessor: usize,
        view: usize,
        offset: usize,
        count: usize,
        size: usize,
    ) -> Result<impl Iterator<Item = &[u8]>, LoadAvatarError> {
        let fail = |defect| LoadAvatarError::Accessor { accessor, defect };
        let view = self
            .root
            .buffer_views
            .get(view)
            .ok_or(fail(AccessorDefect::MissingView))?;
        let buffer = match self.buffers.get(view.buffer) {
            None => return Err(fail(AccessorDefect::MissingView)),
            Some(None) => {
                return Err(LoadAvatarError::ExternalBuffer {
                    buffer: view.buffer,
                });
            }
            Some(Some(bytes)) => bytes,
        };
        let bounds = |start: usize, length: usize| start.checked_add(length).map(|end| start..end);
        let bytes = bounds(view.byte_offset, view.byte_length)
            .and_then(|range| buffer.get(range))
            .and_then(|bytes| bytes.get(offset..))
            .ok_or(fail(AccessorDefect::OutOfBounds))?;
        let stride = view.byte_stride.unwrap_or(size).max(1);
        let needed = match count {
            0 => Some(0),
            _ => stride
                .checked_mul(count - 1)
                .and_then(|n| n.checked_add(size)),
        };
        if needed.is_none_or(|needed| needed > bytes.len()) {
            return Err(fail(AccessorDefect::OutOfBounds));
        }
        Ok((0..count).map(move |i| &bytes[i * stride..i * stride + size]))
    }
}

/// Storage of one number
#[derive(Debug, Clone, Copy)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    /// Number `k` of an element, whose bytes are known to be long enough
    fn decode(self, element: &[u8], k: usize, normalized: bool) -> f64 {
        let at = k * self.size();
        let byte = |i: usize| element[at + i];
        let (value, full) = match self {
            Component::I8 => (f64::from(byte(0) as i8), f64::from(i8::MAX)),
            Component::U8 => (f64::from(byte(0)), f64::from(u8::MAX)),
            Component::I16 => (
                f64::from(i16::from_le_bytes([byte(0), byte(1)])),
                f64::from(i16::MAX),
            ),
            Component::U16 => (
                f64::from(u16::from_le_bytes([byte(0), byte(1)])),
                f64::from(u16::MAX),
            ),
            Component::U32 => (
                f64::from(u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)])),
                f64::from(u32::MAX),
            ),
            Component::F32 => (
                f64::from(f32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)])),
                1.0,
            ),
        };
        if normalized {
            (value / full).max(-1.0)
        } else {
            value
        }
    }
}

/// The JSON and the binary chunk of a GLB
fn split_glb(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), LoadAvatarError> {
    let word = |at: usize| -> Option<u32> {
        let four = bytes.get(at..at.checked_add(4)?)?;
        Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
    };
    let version = word(4).ok_or(LoadAvatarError::Truncated)?;
    if version != 2 {
        return Err(LoadAvatarError::Version { version });
    }
    let (mut json, mut binary) = (None, None);
    let mut at = 12usize;
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let start = at + 8;
        let end = start
            .checked_add(length as usize)
            .ok_or(LoadAvatarError::Truncated)?;
        let chunk = bytes.get(start..end).ok_or(LoadAvatarError::Truncated)?;
        match kind {
            CHUNK_JSON => json = json.or(Some(chunk)),
            CHUNK_BINARY => binary = binary.or(Some(chunk)),
            _ => {}
        }
        at = end;
    }
    Ok((json.ok_or(LoadAvatarError::Truncated)?, binary))
}

/// The bytes of a base64 data URI; `None` for any other address
fn data_uri(uri: &str) -> Option<Vec<u8>> {
    let (_, encoded) = uri.strip_prefix("data:")?.split_once(";base64,")?;
    let (mut bytes, mut bits, mut held) = (Vec::new(), 0u32, 0u32);
    for c in encoded.bytes().filter(|&c| c != b'=') {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        };
        bits = (bits << 6 | u32::from(value)) & 0xFFFF;
        held += 6;
        if held >= 8 {
            held -= 8;
            bytes.push((bits >> held) as u8);
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_uris_decode() {
        let read = |uri| data_uri(uri);
        assert_eq!(read("data:;base64,aGVsbG8="), Some(b"hello".to_vec()));
        assert_eq!(
            read("data:application/octet-stream;base64,AP8Q"),
            Some(vec![0, 255, 16])
        );
        assert_eq!(read("body.bin"), None);
        assert_eq!(read("data:;base64,***"), None);
    }

    fn document(accessor: &str) -> Document {
        // nine bytes: three u8 triples
        let json = format!(
            r#"{{"buffers":[{{"uri":"data:;base64,AAECAwQFBgcI"}},{{"uri":"other.bin"}}],
                "bufferViews":[{{"buffer":0,"byteLength":9}},{{"buffer":1,"byteLength":9}},
                               {{"buffer":0,"byteOffset":4,"byteLength":99}}],
                "accessors":[{accessor}]}}"#
        );
        Document::parse(json.as_bytes()).expect("valid JSON")
    }

    fn defect(accessor: &str) -> LoadAvatarError {
        document(accessor)
            .read::<3>(0)
            .expect_err("a broken accessor")
    }

    #[test]
    fn dense_and_sparse_accessors_read() {
        let dense = r#"{"bufferView":0,"componentType":5121,"count":3,"type":"VEC3"}"#;
        let read = document(dense).read::<3>(0).unwrap();
        assert_eq!(read[2], [6.0, 7.0, 8.0]);
        let sparse = r#"{"componentType":5121,"count":3,"type":"VEC3","sparse":{"count":1,
            "indices":{"bufferView":0,"byteOffset":2,"componentType":5121},
            "values":{"bufferView":0,"byteOffset":6}}}"#;
        let read = document(sparse).read::<3>(0).unwrap();
        assert_eq!(read, vec![[0.0; 3], [0.0; 3], [6.0, 7.0, 8.0]]);
        let fraction =
            r#"{"bufferView":0,"componentType":5121,"normalized":true,"count":3,"type":"VEC3"}"#;
        let read = document(fraction).read::<3>(0).unwrap();
        assert!((read[1][0] - 3.0 / 255.0).abs() < 1e-12);
    }

    #[test]
    fn broken_accessors_are_named() {
        let of = |error: LoadAvatarError| match error {
            LoadAvatarError::Accessor {
                accessor: 0,
                defect,
            } => Some(defect),
            _ => None,
        };
        let cases = [
            (
                r#"{"bufferView":0,"componentType":5121,"count":4,"type":"VEC3"}"#,
                AccessorDefect::OutOfBounds,
            ),
            (
                r#"{"bufferView":0,"componentType":5126,"count":1,"type":"VEC3"}"#,
                AccessorDefect::OutOfBounds,
            ),
            (
                r#"{"bufferView":2,"componentType":5121,"count":1,"type":"VEC3"}"#,
                AccessorDefect::OutOfBounds,
            ),
            (
                r#"{"bufferView":7,"componentType":5121,"count":1,"type":"VEC3"}"#,
                AccessorDefect::MissingView,
            ),
            (
                r#"{"bufferView":0,"componentType":1,"count":1,"type":"VEC3"}"#,
                AccessorDefect::ComponentType,
            ),
            (
                r#"{"bufferView":0,"componentType":5121,"count":1,"type":"VEC2"}"#,
                AccessorDefect::Shape,
            ),
            (
                r#"{"componentType":5121,"count":99999999999,"type":"VEC3"}"#,
                AccessorDefect::TooMany,
            ),
            (
                r#"{"componentType":5121,"count":1,"type":"VEC3","sparse":{"count":1,
                "indices":{"bufferView":0,"byteOffset":2,"componentType":5121},
                "values":{"bufferView":0}}}"#,
                AccessorDefect::SparseIndex,
            ),
        ];
        for (accessor, expected) in cases {
            assert_eq!(of(defect(accessor)), Some(expected), "{accessor}");
        }
        assert!(matches!(
            defect(r#"{"bufferView":1,"componentType":5121,"count":1,"type":"VEC3"}"#),
            LoadAvatarError::ExternalBuffer { buffer: 1 }
        ));
        assert!(matches!(
            document("").read::<3>(0),
            Err(LoadAvatarError::Accessor { .. })
        ));
    }
}
