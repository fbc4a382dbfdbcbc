//! Lists of points in the plane as CSV: rows of `x,y`.

use glam::DVec2;
use thiserror::Error;

/// Why bytes are not a list of points
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum PointsError {
    #[error("the file is not UTF-8 text")]
    NotText,
    #[error("line {line}: expected two numbers \"x,y\", found {found:?}")]
    Row { line: usize, found: String },
    #[error("line {line}: {number} is not a finite number")]
    NotFinite { line: usize, number: String },
    #[error("there are no points; each line contains one \"x,y\"")]
    Empty,
}

/// Maximum number of characters of an invalid line in an error message
const SHOWN: usize = 40;

/// Parses rows of `x,y`; a first line without numbers is a header, empty lines are skipped
///
/// Semicolons, tabs and spaces are accepted as separators, too. Commas in rows with a semicolon are decimal commas.
///
/// # Errors
/// When a line does not contain two finite numbers, or there are no points; the error names the line, from 1.
pub fn parse_points(bytes: &[u8]) -> Result<Vec<DVec2>, PointsError> {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return Err(PointsError::NotText);
    };
    let text = text.trim_start_matches('\u{feff}');
    let mut points = Vec::new();
    let mut header_allowed = true;
    // Old programs of the Mac end lines with CR.
    let text = text.replace("\r\n", "\n").replace('\r', "\n");
    for (index, row) in text.lines().enumerate() {
        let row = row.trim();
        if row.is_empty() {
            continue;
        }
        let line = index + 1;
        let decimal_commas = row.contains(';') && row.contains(',');
        let plain = if decimal_commas {
            row.replace(',', ".")
        } else {
            row.to_owned()
        };
        let fields: Vec<&str> = plain
            .split(|c: char| matches!(c, ',' | ';') || c.is_whitespace())
            .filter(|field| !field.is_empty())
            .collect();
        let numbers: Vec<Option<f64>> = fields.iter().map(|field| field.parse().ok()).collect();
        match numbers[..] {
            [Some(x), Some(y)] => {
                let point = DVec2::new(x, y);
                if !point.is_finite() {
                    let number = if x.is_finite() { fields[1] } else { fields[0] };
                    return Err(PointsError::NotFinite {
                        line,
                        number: number.to_owned(),
                    });
                }
                points.push(point);
            }
            [None, None] if header_allowed => {}
            _ => {
                return Err(PointsError::Row {
                    line,
                    found: row.chars().take(SHOWN).collect(),
                });
            }
        }
        header_allowed = false;
    }
    if points.is_empty() {
        return Err(PointsError::Empty);
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_header_and_other_separators_are_accepted() {
        let points = parse_points("\u{feff}x,y\n1,2\n\n 3.5; -4e1 \r\n5\t6".as_bytes()).unwrap();
        let expected = [(1.0, 2.0), (3.5, -40.0), (5.0, 6.0)].map(|(x, y)| DVec2::new(x, y));
        assert_eq!(points, expected);
    }

    #[test]
    fn decimal_commas_need_semicolons() {
        let points = parse_points(b"x;y\r1,5;2\r3;-4,25").unwrap();
        assert_eq!(points, [DVec2::new(1.5, 2.0), DVec2::new(3.0, -4.25)]);
        assert!(parse_points(b"1,5,2,5").is_err());
        assert!(parse_points(b"1,5 2,5").is_err());
    }

    #[test]
    fn errors_name_the_line() {
        let error = |text: &str| parse_points(text.as_bytes()).unwrap_err().to_string();
        assert!(error("1,2\n\n3\n").starts_with("line 3:"));
        assert!(error("1,2\nx,y\n").starts_with("line 2:"));
        assert!(error("x,y\n1,2,3\n").starts_with("line 2:"));
        assert!(error("1,2\n3,nan\n").contains("line 2: nan"));
        assert!(error("x,y\n").contains("no points"));
        assert_eq!(parse_points(&[0xff]), Err(PointsError::NotText));
    }

    proptest! {
        #[test]
        fn written_points_are_read(points in prop::collection::vec((-1e9f64..1e9, -1e9f64..1e9), 1..20)) {
            let text: Vec<String> = points.iter().map(|(x, y)| format!("{x},{y}")).collect();
            let read = parse_points(text.join("\n").as_bytes()).unwrap();
            let expected: Vec<DVec2> = points.iter().map(|&(x, y)| DVec2::new(x, y)).collect();
            prop_assert_eq!(read, expected);
        }

        #[test]
        fn no_bytes_panic(bytes: Vec<u8>) {
            let _ = parse_points(&bytes);
        }
    }
}
