//! Stanford polygon files: a text header that describes elements, then text or binary values.

use glam::DVec3;
use pirouette_geom::TriMesh;

use super::text::{Lines, Words, parse, unexpected};
use super::{Place, ReadMeshError, push_fan, vertex_index};

/// Returns the bytes of a binary little-endian PLY file, with one color per vertex if given
///
/// Coordinates are rounded to 32 bits: a tenth of a micrometer on a body in millimeters.
///
/// # Panics
/// When `colors` does not have one color per vertex.
pub fn write_ply(mesh: &TriMesh, colors: Option<&[[u8; 3]]>) -> Vec<u8> {
    if let Some(colors) = colors {
        assert_eq!(colors.len(), mesh.positions.len(), "one color per vertex");
    }
    let color_properties = match colors {
        Some(_) => "property uchar red\nproperty uchar green\nproperty uchar blue\n",
        None => "",
    };
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n{color_properties}\
         element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    )
    .into_bytes();
    bytes.reserve(15 * mesh.positions.len() + 13 * mesh.triangles.len());
    for (vertex, position) in mesh.positions.iter().enumerate() {
        for value in position.to_array() {
            bytes.extend((value as f32).to_le_bytes());
        }
        if let Some(colors) = colors {
            bytes.extend(colors[vertex]);
        }
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        for vertex in triangle {
            bytes.extend(vertex.to_le_bytes());
        }
    }
    bytes
}

/// Reads the vertices and faces of a PLY file in text or binary form; other elements and properties are skipped
///
/// # Errors
/// When the bytes are not a PLY file; the error names the line or the byte.
pub fn read_ply(bytes: &[u8]) -> Result<TriMesh, ReadMeshError> {
    let (header, body_start) = Header::read(bytes)?;
    let body = &bytes[body_start..];
    let header_lines = bytes[..body_start].iter().filter(|&&b| b == b'\n').count();
    match header.encoding {
        Encoding::Text => read_elements(
            &header.elements,
            &mut TextValues {
                lines: Lines::new(body),
                words: None,
                header_lines,
            },
        ),
        Encoding::LittleEndian | Encoding::BigEndian => read_elements(
            &header.elements,
            &mut BinaryValues {
                rest: body,
                offset: body_start,
                last: body_start,
                big_endian: header.encoding == Encoding::BigEndian,
            },
        ),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_name(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Scalar::I8,
            b"uchar" | b"uint8" => Scalar::U8,
            b"short" | b"int16" => Scalar::I16,
            b"ushort" | b"uint16" => Scalar::U16,
            b"int" | b"int32" => Scalar::I32,
            b"uint" | b"uint32" => Scalar::U32,
            b"float" | b"float32" => Scalar::F32,
            b"double" | b"float64" => Scalar::F64,
            _ => return None,
        })
    }

    fn is_integer(self) -> bool {
        !matches!(self, Scalar::F32 | Scalar::F64)
    }
}

#[derive(Debug)]
struct Property {
    name: Vec<u8>,
    /// Type of the length, for a list
    length: Option<Scalar>,
    value: Scalar,
}

#[derive(Debug)]
struct Element {
    name: Vec<u8>,
    count: u64,
    properties: Vec<Property>,
}

#[derive(Debug)]
struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
}

impl Header {
    /// Reads the header; also returns the offset of the body
    fn read(bytes: &[u8]) -> Result<(Self, usize), ReadMeshError> {
        const FORMAT: &str = "a format: ascii, binary_little_endian or binary_big_endian";
        const KEYWORD: &str = "format, element, property, comment or end_header";
        const TYPE: &str = "a number type such as float or uchar";
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut start = 0;
        let mut number = 0;
        loop {
            number += 1;
            let place = Place::Line(number);
            if start >= bytes.len() {
                return Err(ReadMeshError::Ended {
                    place,
                    expected: if number == 1 {
                        "the keyword ply"
                    } else {
                        KEYWORD
                    },
                });
            }
            let rest = &bytes[start..];
            let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
            start = (start + length + 1).min(bytes.len());
            let mut line = Words::new(&rest[..length], place);
            let keyword = line.next().unwrap_or_default();
            if number == 1 {
                if keyword != b"ply" {
                    return Err(unexpected(place, "the keyword ply", keyword));
                }
                continue;
            }
            match keyword {
                b"" | b"comment" | b"obj_info" => {}
                b"format" => {
                    encoding = Some(match line.expect(FORMAT)? {
                        b"ascii" => Encoding::Text,
                        b"binary_little_endian" => Encoding::LittleEndian,
                        b"binary_big_endian" => Encoding::BigEndian,
                        other => return Err(unexpected(place, FORMAT, other)),
                    });
                }
                b"element" => elements.push(Element {
                    name: line.expect("the name of an element")?.to_vec(),
                    count: line.count()?,
                    properties: Vec::new(),
                }),
                b"property" => {
                    let Some(element) = elements.last_mut() else {
                        return Err(unexpected(place, "an element before its property", keyword));
                    };
                    let scalar = |word: &[u8]| {
                        Scalar::from_name(word).ok_or_else(|| unexpected(place, TYPE, word))
                    };
                    let first = line.expect(TYPE)?;
                    let (length, value) = if first == b"list" {
                        let word = line.expect(TYPE)?;
                        let length = scalar(word)?;
                        if !length.is_integer() {
                            return Err(unexpected(place, "an integer type for a length", word));
                        }
                        (Some(length), scalar(line.expect(TYPE)?)?)
                    } else {
                        (None, scalar(first)?)
                    };
                    element.properties.push(Property {
                        name: line.expect("the name of a property")?.to_vec(),
                        length,
                        value,
                    });
                }
                b"end_header" => {
                    let encoding = encoding.ok_or(ReadMeshError::Unexpected {
                        place,
                        expected: FORMAT,
                        found: "end_header".to_owned(),
                    })?;
                    return Ok((Self { encoding, elements }, start));
                }
                other => return Err(unexpected(place, KEYWORD, other)),
            }
        }
    }
}

/// A reader of the values of the elements
trait Values {
    /// Returns the position of the last value read
    fn place(&self) -> Place;

    /// Reads the next value
    fn next(&mut self, kind: Scalar) -> Result<f64, ReadMeshError>;
}

struct TextValues<'a> {
    lines: Lines<'a>,
    words: Option<Words<'a>>,
    header_lines: usize,
}

impl Values for TextValues<'_> {
    fn place(&self) -> Place {
        match self.words.as_ref().map(|words| words.place) {
            Some(Place::Line(line)) => Place::Line(line + self.header_lines),
            _ => Place::Line(self.header_lines),
        }
    }

    fn next(&mut self, kind: Scalar) -> Result<f64, ReadMeshError> {
        const EXPECTED: &str = "a number";
        let word = loop {
            if let Some(word) = self.words.as_mut().and_then(Words::next) {
                break word;
            }
            let place = self.place();
            self.words = Some(self.lines.next().ok_or(ReadMeshError::Ended {
                place,
                expected: EXPECTED,
            })?);
        };
        let value = if kind.is_integer() {
            // All integer types fit an f64.
            parse::<i64>(word).map(|v| v as f64)
        } else {
            parse::<f64>(word)
        };
        value.ok_or_else(|| unexpected(self.place(), EXPECTED, word))
    }
}

struct BinaryValues<'a> {
    rest: &'a [u8],
    offset: usize,
    /// Offset of the value read last
    last: usize,
    big_endian: bool,
}

impl BinaryValues<'_> {
    /// Reads the next bytes, least significant first
    fn take<const N: usize>(&mut self) -> Result<[u8; N], ReadMeshError> {
        let (head, rest) = self
            .rest
            .split_first_chunk::<N>()
            .ok_or(ReadMeshError::Ended {
                place: self.place(),
                expected: "a number",
            })?;
        let mut bytes = *head;
        if self.big_endian {
            bytes.reverse();
        }
        self.rest = rest;
        self.last = self.offset;
        self.offset += N;
        Ok(bytes)
    }
}

impl Values for BinaryValues<'_> {
    fn place(&self) -> Place {
        Place::Byte(self.last)
    }

    fn next(&mut self, kind: Scalar) -> Result<f64, ReadMeshError> {
        Ok(match kind {
            Scalar::I8 => i8::from_le_bytes(self.take()?).into(),
            Scalar::U8 => u8::from_le_bytes(self.take()?).into(),
            Scalar::I16 => i16::from_le_bytes(self.take()?).into(),
            Scalar::U16 => u16::from_le_bytes(self.take()?).into(),
            Scalar::I32 => i32::from_le_bytes(self.take()?).into(),
            Scalar::U32 => u32::from_le_bytes(self.take()?).into(),
            Scalar::F32 => f32::from_le_bytes(self.take()?).into(),
            Scalar::F64 => f64::from_le_bytes(self.take()?),
        })
    }
}

fn read_elements(elements: &[Element], values: &mut impl Values) -> Result<TriMesh, ReadMeshError> {
    let mut mesh = TriMesh::default();
    let mut polygons: Vec<(Vec<u32>, Place)> = Vec::new();
    // Faces may precede the vertices: their indices are checked at the end.
    for element in elements.iter().filter(|e| !e.properties.is_empty()) {
        if element.name == b"vertex" && u32::try_from(element.count).is_err() {
            return Err(ReadMeshError::TooManyVertices {
                place: values.place(),
                vertex_count: element.count,
            });
        }
        // Every item has at least one value: the loop ends at the end of the file, regardless of the count.
        for _ in 0..element.count {
            let mut point = [0.0; 3];
            for property in &element.properties {
                let axis = match (element.name.as_slice(), property.name.as_slice()) {
                    (b"vertex", b"x") => Some(0),
                    (b"vertex", b"y") => Some(1),
                    (b"vertex", b"z") => Some(2),
                    _ => None,
                };
                let is_polygon = element.name == b"face"
                    && matches!(
                        property.name.as_slice(),
                        b"vertex_indices" | b"vertex_index"
                    );
                match property.length {
                    None => {
                        let value = values.next(property.value)?;
                        if let Some(axis) = axis {
                            if !value.is_finite() {
                                let (place, found) = (values.place(), value.to_string());
                                return Err(unexpected(place, "a finite number", found.as_bytes()));
                            }
                            point[axis] = value;
                        }
                    }
                    Some(length) => {
                        let count = values.next(length)?;
                        let place = values.place();
                        if count < 0.0 {
                            let found = count.to_string();
                            return Err(unexpected(place, "a list length", found.as_bytes()));
                        }
                        let mut polygon = Vec::new();
                        for _ in 0..count as u64 {
                            let value = values.next(property.value)?;
                            if is_polygon {
                                polygon.push(vertex_number(value, place)?);
                            }
                        }
                        if is_polygon {
                            polygons.push((polygon, place));
                        }
                    }
                }
            }
            if element.name == b"vertex" {
                mesh.positions.push(DVec3::from_array(point));
            }
        }
    }
    for (polygon, place) in polygons {
        for &vertex in &polygon {
            vertex_index(i64::from(vertex), mesh.positions.len(), place)?;
        }
        push_fan(&mut mesh.triangles, &polygon);
    }
    Ok(mesh)
}

/// Converts a vertex number; whether the vertex exists is checked later
fn vertex_number(value: f64, place: Place) -> Result<u32, ReadMeshError> {
    let number = value as u32;
    if f64::from(number) == value {
        Ok(number)
    } else {
        Err(unexpected(
            place,
            "a vertex number",
            value.to_string().as_bytes(),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::octahedron;
    use super::*;

    /// The octahedron with coordinates representable in 32 bits
    fn rounded() -> TriMesh {
        let mut mesh = octahedron();
        for p in &mut mesh.positions {
            *p = p.as_vec3().as_dvec3();
        }
        mesh
    }

    #[test]
    fn binary_ply_round_trips() {
        assert_eq!(read_ply(&write_ply(&octahedron(), None)), Ok(rounded()));
        let colors = [[1, 2, 3]; 6];
        let colored = write_ply(&octahedron(), Some(&colors));
        assert_eq!(read_ply(&colored), Ok(rounded()));
    }

    #[test]
    fn text_and_big_endian_are_read_too() {
        let text = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 3\n\
            property double x\nproperty double y\nproperty double z\nproperty list uchar int tags\n\
            element edge 1\nproperty int a\n\
            element face 1\nproperty uchar flags\nproperty list uchar int vertex_index\nend_header\n\
            0 0 0 0\n1.5 0 0 2 7 8\n0 1 0 1 9\n5\n0 3 0 1 2\n";
        let mesh = read_ply(text.as_bytes()).expect("the file is sound");
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        assert_eq!(mesh.positions[1], DVec3::new(1.5, 0.0, 0.0));

        let mut bytes = b"ply\r\nformat binary_big_endian 1.0\r\nelement face 1\r\nproperty list int short vertex_indices\r\nelement vertex 3\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\nend_header\r\n".to_vec();
        bytes.extend([0, 0, 0, 3, 0, 0, 0, 1, 0, 2]);
        for value in [0.0f32, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 1.0, 0.0] {
            bytes.extend(value.to_be_bytes());
        }
        assert_eq!(read_ply(&bytes), Ok(mesh));
    }

    #[test]
    fn invalid_files_are_reported_with_the_position() {
        let head = "ply\nformat ascii 1.0\n";
        for (text, message) in [
            (
                String::new(),
                "line 1: the file ends where the keyword ply should follow",
            ),
            (
                "OFF\n".to_owned(),
                "line 1: expected the keyword ply, found \"OFF\"",
            ),
            (
                "ply\nend_header\n".to_owned(),
                "line 2: expected a format: ascii, binary_little_endian or binary_big_endian, found \"end_header\"",
            ),
            (
                format!("{head}property float x\n"),
                "line 3: expected an element before its property, found \"property\"",
            ),
            (
                format!("{head}element vertex 1\nproperty real x\n"),
                "line 4: expected a number type such as float or uchar, found \"real\"",
            ),
            (
                format!("{head}element vertex 1\nproperty float x\nend_header\nnan\n"),
                "line 6: expected a finite number, found \"NaN\"",
            ),
            (
                format!("{head}element vertex 9000000000\nproperty float x\nend_header\n"),
                "line 5: 9000000000 vertices are more than 32-bit indices support",
            ),
            (
                format!(
                    "{head}element face 1\nproperty list uchar int vertex_indices\nend_header\n3 0 1 2\n"
                ),
                "line 6: there is no vertex 0 among 0",
            ),
        ] {
            let error = read_ply(text.as_bytes()).expect_err(&text);
            assert_eq!(error.to_string(), message);
        }
        let mut bytes = write_ply(&octahedron(), None);
        bytes.pop();
        let error = read_ply(&bytes).expect_err("the last byte is missing");
        assert!(
            error
                .to_string()
                .ends_with("the file ends where a number should follow")
        );
    }
}
