//! Object file format: counts, then one line per vertex and per face.

use std::fmt::Write;

use glam::DVec3;
use pirouette_geom::TriMesh;

use super::text::{Lines, push_point, unexpected};
use super::{ReadMeshError, push_fan, vertex_index};

/// Returns the bytes of an OFF file
pub fn write_off(mesh: &TriMesh) -> Vec<u8> {
    let mut text = format!("OFF\n{} {} 0\n", mesh.positions.len(), mesh.triangles.len());
    for &point in &mesh.positions {
        push_point(&mut text, point);
        text.push('\n');
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(text, "3 {a} {b} {c}").expect("writing to a string cannot fail");
    }
    text.into_bytes()
}

/// Reads an OFF file, also with colors or normals after the coordinates (COFF, NOFF), without the keyword, or with the
/// counts directly behind it
///
/// # Errors
/// When the bytes are not an OFF file in text form; the error names the line.
pub fn read_off(bytes: &[u8]) -> Result<TriMesh, ReadMeshError> {
    const KEYWORD: &str = "the keyword OFF or the counts";
    let mut lines = Lines::new(bytes);
    let mut first = lines.expect(KEYWORD)?;
    let word = first.clone().expect(KEYWORD)?;
    let mut counts = match word.iter().position(u8::is_ascii_digit) {
        Some(0) => first,
        digit => {
            let (keyword, digits) = word.split_at(digit.unwrap_or(word.len()));
            let known = ["OFF", "COFF", "NOFF", "CNOFF", "STOFF"];
            if !known
                .iter()
                .any(|known| keyword.eq_ignore_ascii_case(known.as_bytes()))
            {
                return Err(unexpected(first.place, KEYWORD, word));
            }
            first.skip(keyword.len());
            match digits {
                // `OFF8 6 0`: files of ModelNet lack the end of the line.
                [_, ..] => first,
                [] if first.more() => first,
                [] => lines.expect("the counts")?,
            }
        }
    };
    let (vertex_count, face_count) = (counts.count()?, counts.count()?);
    let vertex_count = u32::try_from(vertex_count)
        .ok()
        .ok_or(ReadMeshError::TooManyVertices {
            place: counts.place,
            vertex_count,
        })?;
    let mut mesh = TriMesh::default();
    for _ in 0..vertex_count {
        let mut line = lines.expect("a vertex")?;
        let point = [line.number()?, line.number()?, line.number()?];
        mesh.positions.push(DVec3::from_array(point));
    }
    let mut polygon = Vec::new();
    for _ in 0..face_count {
        let mut line = lines.expect("a face")?;
        polygon.clear();
        for _ in 0..line.count()? {
            let number = line.integer()?;
            polygon.push(vertex_index(number, mesh.positions.len(), line.place)?);
        }
        push_fan(&mut mesh.triangles, &polygon);
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::super::tests::octahedron;
    use super::*;

    #[test]
    fn off_is_lossless() {
        assert_eq!(read_off(&write_off(&octahedron())), Ok(octahedron()));
    }

    #[test]
    fn numbers_are_short() {
        let text = String::from_utf8(write_off(&octahedron())).expect("OFF is text");
        assert!(text.starts_with("OFF\n6 8 0\n0.3333333333333333 0 0\n0 1234.5678901234 0\n"));
        assert!(text.contains("0 0 2.5e-7\n0 0 -1e21\n3 0 1 4\n"));
    }

    #[test]
    fn dialects_are_accepted() {
        let plain = read_off(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
        for dialect in [
            "OFF 3 1 0\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n",
            "3 1\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2",
            "OFF3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
            "\u{feff}off\r3 1 0\r0 0 0\r1 0 0\r0 1 0\r3 0 1 2\r",
            "noff\n3 1 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n",
            "# corner\nCOFF\n\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 1 1 1 1\n0 1 0 0 0 0 0\n3 0 1 2 9 9 9\n",
        ] {
            assert_eq!(read_off(dialect.as_bytes()), plain, "{dialect}");
        }
    }

    #[test]
    fn polygons_become_fans() {
        let mesh = read_off(b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n2 0 1\n");
        let mesh = mesh.expect("a square is valid");
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn invalid_files_are_reported_with_the_line() {
        for (bytes, message) in [
            (
                "",
                "line 0: the file ends where the keyword OFF or the counts should follow",
            ),
            (
                "PLY",
                "line 1: expected the keyword OFF or the counts, found \"PLY\"",
            ),
            ("2OFF\n3 1 0\n", "line 1: expected a count, found \"2OFF\""),
            ("OFF BINARY\n", "line 1: expected a count, found \"BINARY\""),
            (
                "OFF\r\n1 1 0\r1 2 3\n3 0 0 1",
                "line 4: there is no vertex 1 among 1",
            ),
            ("OFF\n-1 0 0", "line 2: expected a count, found \"-1\""),
            (
                "OFF\n2 0 0\n1 2 3\n",
                "line 3: the file ends where a vertex should follow",
            ),
            (
                "OFF\n1 1 0\n1 2 3\n3 0 0 1\n",
                "line 4: there is no vertex 1 among 1",
            ),
            (
                "OFF\n1 1 0\n1 2 3\n3 0 0\n",
                "line 4: expected an integer, found \"end of the line\"",
            ),
            (
                "OFF\n99999999999 0 0\n",
                "line 2: 99999999999 vertices are more than 32-bit indices support",
            ),
        ] {
            let error = read_off(bytes.as_bytes()).expect_err(bytes);
            assert_eq!(error.to_string(), message);
        }
    }
}
