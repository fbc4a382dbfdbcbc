//! Binary stereolithography files: every triangle with its normal and three separate corners.

use glam::DVec3;
use pirouette_geom::TriMesh;

/// Returns the bytes of a binary STL file
///
/// # Panics
/// When a triangle refers to a vertex that does not exist.
pub fn write_stl(mesh: &TriMesh) -> Vec<u8> {
    const HEADER_BYTES: usize = 80;
    const TRIANGLE_BYTES: usize = 50;
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

#[cfg(test)]
mod tests {
    use super::super::tests::octahedron;
    use super::*;

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
