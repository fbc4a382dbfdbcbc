//! Triangle mesh files: writes and reads PLY, OBJ, OFF, STL and GLB.
//!
//! All functions work on bytes. Coordinates are in the caller's unit and frame, except for GLB, which is written from
//! millimeters in the meters of its standard. Text formats store every number exactly, in the fewest digits that parse
//! to the same value. Readers accept any bytes: they return a mesh or an error with the position, and do not reserve
//! memory for counts claimed by the file. Polygons are split into fans; colors, normals and texture coordinates are
//! skipped.

mod glb;
mod obj;
mod off;
mod ply;
mod stl;
mod text;

use std::fmt;

use glam::DVec3;
use pirouette_geom::TriMesh;

use pirouette_body::gltf::load_surface;
use pirouette_body::{Avatar, PerBone, SkinWeight};

pub use glb::write_glb;
pub use obj::{read_obj, write_obj};
pub use off::{read_off, write_off};
pub use ply::{read_ply, write_ply};
pub use stl::{read_stl, write_stl};

/// A body to write, with attributes that some formats support
#[derive(Debug, Clone, Copy)]
pub struct BodyMesh<'a> {
    /// The surface; in millimeters, world frame, if the format has a unit and a frame
    pub mesh: &'a TriMesh,
    /// Color of each vertex (sRGB), same order as the mesh's positions; written to PLY and GLB
    pub colors: Option<&'a [[u8; 3]]>,
    /// Bones and skinning weights; written to GLB
    pub skin: Option<Skin<'a>>,
}

/// Bones and skinning weights of a surface
#[derive(Debug, Clone, Copy)]
pub struct Skin<'a> {
    /// One skinning weight per vertex, same order as the mesh's positions
    pub weights: &'a [SkinWeight],
    /// Joint position of each bone, in the frame of the mesh
    pub bone_heads: &'a PerBone<DVec3>,
}

impl<'a> From<&'a TriMesh> for BodyMesh<'a> {
    fn from(mesh: &'a TriMesh) -> Self {
        Self {
            mesh,
            colors: None,
            skin: None,
        }
    }
}

impl<'a> From<&'a Avatar> for BodyMesh<'a> {
    fn from(avatar: &'a Avatar) -> Self {
        Self {
            mesh: &avatar.mesh,
            colors: None,
            skin: Some(Skin {
                weights: &avatar.weights,
                bone_heads: &avatar.bone_heads,
            }),
        }
    }
}

/// A file format for triangle meshes
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MeshFormat {
    /// Stanford polygon file, binary, little endian
    Ply,
    /// Binary glTF 2.0: meters, y up, with normals and optional bones
    Glb,
    /// Wavefront OBJ, text
    Obj,
    /// Stereolithography, binary; no shared vertices
    Stl,
    /// Object file format, text
    Off,
}

impl MeshFormat {
    /// All formats, the default first
    pub const ALL: [MeshFormat; 5] = [
        MeshFormat::Ply,
        MeshFormat::Glb,
        MeshFormat::Obj,
        MeshFormat::Stl,
        MeshFormat::Off,
    ];

    /// Returns the file extension, without the dot
    pub fn extension(self) -> &'static str {
        match self {
            MeshFormat::Ply => "ply",
            MeshFormat::Glb => "glb",
            MeshFormat::Obj => "obj",
            MeshFormat::Stl => "stl",
            MeshFormat::Off => "off",
        }
    }

    /// Returns the format of a file extension, in any case; `None` if it is unknown
    pub fn from_extension(extension: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|format| format.extension().eq_ignore_ascii_case(extension))
    }

    /// Returns the bytes of a file with this mesh or avatar, in millimeters
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist, or colors or skinning weights do not match the vertices.
    pub fn write<'a>(self, body: impl Into<BodyMesh<'a>>) -> Vec<u8> {
        let body = body.into();
        let mesh = body.mesh;
        match self {
            MeshFormat::Ply => write_ply(mesh, body.colors),
            MeshFormat::Glb => write_glb(&body),
            MeshFormat::Obj => write_obj(mesh),
            MeshFormat::Stl => write_stl(mesh),
            MeshFormat::Off => write_off(mesh),
        }
    }

    /// Reads the surface of a file, in the frame and the unit of the file
    ///
    /// # Errors
    /// When the bytes are not a file of this format.
    pub fn read(self, bytes: &[u8]) -> Result<TriMesh, ReadMeshError> {
        match self {
            MeshFormat::Ply => read_ply(bytes),
            MeshFormat::Glb => {
                load_surface(bytes).map_err(|error| ReadMeshError::Gltf(error.to_string()))
            }
            MeshFormat::Obj => read_obj(bytes),
            MeshFormat::Stl => read_stl(bytes),
            MeshFormat::Off => read_off(bytes),
        }
    }
}

/// A position in a mesh file
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Line of a text file, from 1
    Line(usize),
    /// Offset into a binary file, from 0
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(offset) => write!(f, "byte {offset}"),
        }
    }
}

/// Why bytes are not a mesh
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReadMeshError {
    /// The file contains something else than the format requires
    #[error("{place}: expected {expected}, found {found:?}")]
    Unexpected {
        /// Position in the file
        place: Place,
        /// What the format requires
        expected: &'static str,
        /// What the file contains, shortened
        found: String,
    },
    /// The file is truncated
    #[error("{place}: the file ends where {expected} should follow")]
    Ended {
        /// Position of the end of the file
        place: Place,
        /// What is missing
        expected: &'static str,
    },
    /// A face refers to a vertex that does not exist
    #[error("{place}: there is no vertex {vertex} among {vertex_count}")]
    MissingVertex {
        /// Position in the file
        place: Place,
        /// The vertex as written in the file
        vertex: i64,
        /// Number of vertices
        vertex_count: usize,
    },
    /// More vertices than 32-bit indices support
    #[error("{place}: {vertex_count} vertices are more than 32-bit indices support")]
    TooManyVertices {
        /// Position in the file
        place: Place,
        /// Number of vertices claimed by the file
        vertex_count: u64,
    },
    /// The file is no glTF, or not readable
    #[error("{0}")]
    Gltf(String),
}

/// Splits a polygon into a fan of triangles; fewer than three corners give none
fn push_fan(triangles: &mut Vec<[u32; 3]>, polygon: &[u32]) {
    if let Some((&first, rest)) = polygon.split_first() {
        triangles.extend(rest.windows(2).map(|pair| [first, pair[0], pair[1]]));
    }
}

/// Returns the vertex index of a number in a file that counts from 0
fn vertex_index(number: i64, vertex_count: usize, place: Place) -> Result<u32, ReadMeshError> {
    usize::try_from(number)
        .ok()
        .filter(|&index| index < vertex_count)
        .and_then(|index| u32::try_from(index).ok())
        .ok_or(ReadMeshError::MissingVertex {
            place,
            vertex: number,
            vertex_count,
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// An octahedron with coordinates that need all digits
    pub(super) fn octahedron() -> TriMesh {
        let (a, b) = (1.0 / 3.0, 1_234.567_890_123_4);
        TriMesh {
            positions: vec![
                DVec3::new(a, 0.0, 0.0),
                DVec3::new(0.0, b, 0.0),
                DVec3::new(-a, 0.0, -0.0),
                DVec3::new(0.0, -b, 0.0),
                DVec3::new(0.0, 0.0, 2.5e-7),
                DVec3::new(0.0, 0.0, -1e21),
            ],
            triangles: vec![
                [0, 1, 4],
                [1, 2, 4],
                [2, 3, 4],
                [3, 0, 4],
                [1, 0, 5],
                [2, 1, 5],
                [3, 2, 5],
                [0, 3, 5],
            ],
        }
    }

    #[test]
    fn extensions_identify_their_formats() {
        for format in MeshFormat::ALL {
            assert_eq!(MeshFormat::from_extension(format.extension()), Some(format));
            assert!(!format.write(&octahedron()).is_empty());
        }
        assert_eq!(MeshFormat::from_extension("PLY"), Some(MeshFormat::Ply));
        assert_eq!(MeshFormat::from_extension("fbx"), None);
    }

    #[test]
    fn an_empty_mesh_can_be_written_in_every_format() {
        for format in MeshFormat::ALL {
            assert!(!format.write(&TriMesh::default()).is_empty());
        }
        let read = read_off(&write_off(&TriMesh::default())).expect("it was just written");
        assert_eq!(read, TriMesh::default());
    }

    #[test]
    fn errors_name_the_place() {
        let error = read_off(b"OFF\n3 1 0\n0 0 0\n1 0 zero\n").expect_err("zero is no number");
        assert_eq!(
            error.to_string(),
            "line 4: expected a finite number, found \"zero\""
        );
    }

    /// Bytes similar enough to a mesh file to pass the header
    fn mesh_like() -> impl Strategy<Value = Vec<u8>> {
        let word = prop_oneof![
            "[ \n\r]{1,2}",
            "(OFF|ply|v|f|solid|facet|outer loop|vertex|endloop|end_header|element vertex|element face|property list|property float x)[ \n]",
            "(uchar|int|float|double|ascii|binary_little_endian|format|1\\.0)[ \n]",
            "-?[0-9]{1,3}[ \n/]",
            "(99999999999|18446744073709551616|1e999|nan|#)[ \n]",
            any::<char>().prop_map(String::from),
        ];
        prop_oneof![
            prop::collection::vec(any::<u8>(), 0..200),
            prop::collection::vec(word, 0..40).prop_map(|words| words.concat().into_bytes()),
        ]
    }

    proptest! {
        #[test]
        fn any_bytes_give_a_mesh_or_an_error(bytes in mesh_like()) {
            for read in [read_off, read_ply, read_obj, read_stl] {
                if let Ok(mesh) = read(&bytes) {
                    let count = mesh.positions.len() as u32;
                    prop_assert!(mesh.triangles.iter().flatten().all(|&v| v < count));
                    prop_assert!(mesh.positions.iter().all(|p| p.is_finite()));
                }
            }
        }

        #[test]
        fn damaged_files_give_a_mesh_or_an_error(
            at in 0usize..400,
            byte: u8,
            cut in 0usize..400,
        ) {
            let mesh = octahedron();
            for (mut bytes, read) in [
                (write_off(&mesh), read_off as fn(&[u8]) -> _),
                (write_ply(&mesh, None), read_ply),
                (write_obj(&mesh), read_obj),
                (write_stl(&mesh), read_stl),
            ] {
                if let Some(slot) = bytes.get_mut(at) {
                    *slot = byte;
                }
                let _: Result<TriMesh, ReadMeshError> = read(&bytes);
                let _ = read(&bytes[..cut.min(bytes.len())]);
            }
        }

        #[test]
        fn text_formats_are_lossless(
            coordinates in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL, 9),
        ) {
            let mesh = TriMesh {
                positions: coordinates.chunks(3).map(DVec3::from_slice).collect(),
                triangles: vec![[0, 1, 2]],
            };
            prop_assert_eq!(&read_off(&write_off(&mesh)), &Ok(mesh.clone()));
            prop_assert_eq!(&read_obj(&write_obj(&mesh)), &Ok(mesh));
        }
    }
}
