//! Stereolithography files: every triangle with its normal and three separate corners.

use std::collections::HashMap;

use glam::DVec3;
use pirouette_geom::TriMesh;

use super::text::{Lines, unexpected};
use super::{Place, ReadMeshError};

const HEADER_BYTES: usize = 80;
const TRIANGLE_BYTES: usize = 50;

/// Returns the bytes of a binary STL file
///
/// # Panics
/// When a triangle refers to a vertex that does not exist.
pub fn write_stl(mesh: &TriMesh) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER_BYTES + 4 + TRIANGLE_BYTES * mesh.triangles.len());
    // Readers interpret files that begin with "solid" as the text variant.
    bytes.extend(b"binary STL, lengths in millimeters");
    bytes.resize(HEADER_BYTES, b' ');
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in 0..mesh.triangles.len() {
        let corners @ [a, b, c] = mesh.corners(triangle);
        let normal = (b - a).cross(c - a).try_normalize().unwrap_or(DVec3::ZERO);
        for vector in [normal].iter().chain(&corners) {
            for value in vector.to_array() {
                bytes.extend((value as f32).to_le_bytes());
            }
        }
        bytes.extend([0; 2]);
    }
    bytes
}

/// Reads a binary or text STL file; equal corners become one vertex, normals are skipped
///
/// # Errors
/// When the file is truncated, or contains something else than the format requires; the error names the position.
pub fn read_stl(bytes: &[u8]) -> Result<TriMesh, ReadMeshError> {
    let mut welded = Welded::default();
    // Binary files may begin with "solid", too, but their size is that of their triangles.
    let count = bytes.get(HEADER_BYTES..HEADER_BYTES + 4);
    let count = count.map(|count| le_u32(count) as usize);
    let is_binary = count.is_some_and(|count| {
        bytes.len() as u64 == (HEADER_BYTES + 4) as u64 + TRIANGLE_BYTES as u64 * count as u64
    });
    if is_binary || !bytes.trim_ascii_start().starts_with(b"solid") {
        read_binary(bytes, count, &mut welded)?;
    } else {
        read_text(bytes, &mut welded)?;
    }
    Ok(welded.mesh)
}

fn le_u32(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

fn read_binary(
    bytes: &[u8],
    count: Option<usize>,
    welded: &mut Welded,
) -> Result<(), ReadMeshError> {
    const EXPECTED: &str = "a triangle of 50 bytes";
    let ended = |expected| ReadMeshError::Ended {
        place: Place::Byte(bytes.len()),
        expected,
    };
    let count = count.ok_or_else(|| ended("the number of triangles"))?;
    let mut triangles = bytes[HEADER_BYTES + 4..].chunks_exact(TRIANGLE_BYTES);
    for index in 0..count {
        let triangle = triangles.next().ok_or_else(|| ended(EXPECTED))?;
        for corner in triangle[12..48].chunks_exact(12) {
            let value = |k: usize| f64::from(f32::from_bits(le_u32(&corner[4 * k..])));
            let point = DVec3::new(value(0), value(1), value(2));
            if !point.is_finite() {
                return Err(ReadMeshError::Unexpected {
                    place: Place::Byte(HEADER_BYTES + 4 + TRIANGLE_BYTES * index),
                    expected: "finite coordinates",
                    found: point.to_string(),
                });
            }
            welded.push(point);
        }
    }
    Ok(())
}

fn read_text(bytes: &[u8], welded: &mut Welded) -> Result<(), ReadMeshError> {
    let mut lines = Lines::new(bytes);
    let mut corners = 0;
    while let Some(mut line) = lines.next() {
        match line.next() {
            Some(b"vertex") => {
                let point = [line.number()?, line.number()?, line.number()?];
                welded.push(DVec3::from_array(point));
                corners += 1;
            }
            Some(word @ b"endloop") if corners != 3 => {
                return Err(unexpected(line.place, "three vertices per loop", word));
            }
            Some(b"endloop") => corners = 0,
            _ => {}
        }
    }
    if corners > 0 {
        return Err(lines.ended("the end of a loop"));
    }
    Ok(())
}

/// A mesh whose equal corners are one vertex
#[derive(Debug, Default)]
struct Welded {
    mesh: TriMesh,
    vertex_at: HashMap<[u64; 3], u32>,
    /// The corners of an incomplete triangle
    open: Vec<u32>,
}

impl Welded {
    /// Adds a corner; every third one completes a triangle
    fn push(&mut self, point: DVec3) {
        // Zero and negative zero are the same place.
        let key = point.to_array().map(|x| (x + 0.0).to_bits());
        let positions = &mut self.mesh.positions;
        let vertex = *self.vertex_at.entry(key).or_insert_with(|| {
            positions.push(point);
            positions.len() as u32 - 1
        });
        self.open.push(vertex);
        if let [a, b, c] = self.open[..] {
            self.mesh.triangles.push([a, b, c]);
            self.open.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::octahedron;
    use super::*;

    #[test]
    fn stl_keeps_the_triangles_to_the_precision_of_its_numbers() {
        let read = read_stl(&write_stl(&octahedron())).expect("it was just written");
        assert_eq!(read.positions.len(), octahedron().positions.len());
        for t in 0..octahedron().triangles.len() {
            let corners = read.corners(t).into_iter().zip(octahedron().corners(t));
            assert!(
                corners
                    .into_iter()
                    .all(|(a, b)| a.distance(b) <= 1e-7 * b.length())
            );
        }
    }

    #[test]
    fn text_files_are_read_like_binary_ones() {
        let text = b"solid a b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n\
            endfacet\nfacet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 -0.0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
        let mesh = read_stl(text).expect("two triangles");
        assert_eq!(mesh.triangles, [[0, 1, 2], [1, 3, 2]]);
        assert_eq!(mesh.positions.len(), 4);
    }

    #[test]
    fn damaged_stl_files_are_reported_with_the_position() {
        let bytes = write_stl(&octahedron());
        for (bytes, message) in [
            (
                &bytes[..100],
                "byte 100: the file ends where a triangle of 50 bytes should follow",
            ),
            (
                &bytes[..20],
                "byte 20: the file ends where the number of triangles should follow",
            ),
            (
                b"solid\nouter loop\nvertex 0 0 0\nendloop\n",
                "line 4: expected three vertices per loop, found \"endloop\"",
            ),
            (
                b"solid\nouter loop\nvertex 0 0 0\n",
                "line 3: the file ends where the end of a loop should follow",
            ),
        ] {
            let error = read_stl(bytes).expect_err(message);
            assert_eq!(error.to_string(), message);
        }
    }

    #[test]
    fn triangles_take_fifty_bytes_after_the_count() {
        let mesh = octahedron();
        let bytes = write_stl(&mesh);
        assert_eq!(bytes.len(), 84 + 50 * mesh.triangles.len());
        assert_eq!(bytes[80..84], 8u32.to_le_bytes());
        let float = |at: usize| {
            let word: [u8; 4] = bytes[at..at + 4].try_into().expect("four bytes");
            f32::from_le_bytes(word)
        };
        // First corner of the first triangle, after the normal
        assert!((float(84 + 12) - 1.0 / 3.0).abs() < 1e-7);
        let normal = DVec3::new(float(84).into(), float(88).into(), float(92).into());
        assert!((normal.length() - 1.0).abs() < 1e-6);
    }
}
