//! Wavefront OBJ: `v` and `f` lines.

use std::fmt::Write;

use glam::DVec3;
use pirouette_geom::TriMesh;

use super::text::{Lines, parse, push_point, unexpected};
use super::{Place, ReadMeshError, push_fan};

/// Returns the bytes of an OBJ file
pub fn write_obj(mesh: &TriMesh) -> Vec<u8> {
    let mut text = String::from("o body\n");
    for &point in &mesh.positions {
        text.push_str("v ");
        push_point(&mut text, point);
        text.push('\n');
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| u64::from(v) + 1);
        writeln!(text, "f {a} {b} {c}").expect("writing to a string cannot fail");
    }
    text.into_bytes()
}

/// Reads the vertices and faces of an OBJ file; other statements are skipped
///
/// # Errors
/// When a vertex or face line is invalid or refers to a vertex that does not exist; the error names the line.
pub fn read_obj(bytes: &[u8]) -> Result<TriMesh, ReadMeshError> {
    const VERTEX: &str = "a vertex number";
    let mut lines = Lines::new(bytes);
    let mut mesh = TriMesh::default();
    let mut polygon = Vec::new();
    // Faces may precede their vertices: the largest index is checked at the end.
    let mut largest: Option<(u32, Place)> = None;
    while let Some(mut line) = lines.next() {
        match line.next() {
            Some(b"v") => {
                let point = [line.number()?, line.number()?, line.number()?];
                mesh.positions.push(DVec3::from_array(point));
            }
            Some(b"f") => {
                polygon.clear();
                while let Some(word) = line.next() {
                    let number = word.split(|&b| b == b'/').next().unwrap_or(word);
                    let number: i64 =
                        parse(number).ok_or_else(|| unexpected(line.place, VERTEX, word))?;
                    let index = if number < 0 {
                        (mesh.positions.len() as i64).checked_add(number)
                    } else {
                        number.checked_sub(1)
                    };
                    let index = index.and_then(|index| u32::try_from(index).ok()).ok_or(
                        ReadMeshError::MissingVertex {
                            place: line.place,
                            vertex: number,
                            vertex_count: mesh.positions.len(),
                        },
                    )?;
                    if largest.is_none_or(|(seen, _)| index > seen) {
                        largest = Some((index, line.place));
                    }
                    polygon.push(index);
                }
                push_fan(&mut mesh.triangles, &polygon);
            }
            _ => {}
        }
    }
    match largest {
        Some((index, place)) if index as usize >= mesh.positions.len() => {
            Err(ReadMeshError::MissingVertex {
                place,
                vertex: i64::from(index) + 1,
                vertex_count: mesh.positions.len(),
            })
        }
        _ => Ok(mesh),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::octahedron;
    use super::*;

    #[test]
    fn obj_is_lossless() {
        assert_eq!(read_obj(&write_obj(&octahedron())), Ok(octahedron()));
    }

    #[test]
    fn vertices_are_numbered_from_one_or_from_the_end() {
        let text = "mtllib a.mtl\no square\nv 0 0 0 1.0\nv 1 0 0\nv 1 1 0\nvt 0 0\nf 1/1/1 2//1 3/1\nv 0 1 0\nf -4 -2 -1 # back\n";
        let mesh = read_obj(text.as_bytes()).expect("all vertices are there");
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn invalid_files_are_reported_with_the_line() {
        for (text, message) in [
            (
                "v 1 2\n",
                "line 1: expected a finite number, found \"end of the line\"",
            ),
            ("v 0 0 0\nf 1 1 0\n", "line 2: there is no vertex 0 among 1"),
            (
                "v 0 0 0\nf 1 1 -2\n",
                "line 2: there is no vertex -2 among 1",
            ),
            ("f 1 2 3\nv 0 0 0\n", "line 1: there is no vertex 3 among 1"),
            (
                "v 0 0 0\nf a b c\n",
                "line 2: expected a vertex number, found \"a\"",
            ),
        ] {
            let error = read_obj(text.as_bytes()).expect_err(text);
            assert_eq!(error.to_string(), message);
        }
    }
}
