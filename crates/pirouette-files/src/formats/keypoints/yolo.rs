//! YOLO pose models: label lines `class x y width height x1 y1 v1 ...`, and columns of the JSON export.
//!
//! # Source
//! Ultralytics' documentation of pose datasets and of `Results.save_txt` and `Results.to_json`.

use super::KeypointsError;
use super::layout::Layout;
use super::points::{Person, Point};
use super::tree::Node;

/// Numbers before the points: class, center and size of the box
const BOX_NUMBERS: usize = 5;

/// Numbers that may follow the points: confidence of the person and number of its track
const MAX_EXTRA: usize = 2;

/// Maximum number of characters of an invalid line in an error message
const SHOWN: usize = 40;

/// Reads one person per line of text
pub(super) fn text_people(text: &str) -> Result<Vec<Person>, KeypointsError> {
    let lines = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty());
    lines
        .map(|(index, line)| {
            line_person(line).ok_or_else(|| KeypointsError::Line {
                line: index + 1,
                number_count: line.split_whitespace().count(),
                found: line.trim().chars().take(SHOWN).collect(),
            })
        })
        .collect()
}

fn line_person(line: &str) -> Option<Person> {
    let numbers: Option<Vec<f64>> = line.split_whitespace().map(|n| n.parse().ok()).collect();
    let numbers = numbers.filter(|numbers| numbers.iter().all(|n| n.is_finite()))?;
    let rest = numbers.get(BOX_NUMBERS..)?;
    if numbers[0].fract().abs() > 0.0 || numbers[0] < 0.0 {
        return None;
    }
    let layout = |extra: usize| Layout::of_flat(rest.len().checked_sub(extra)?);
    let coco = (0..=MAX_EXTRA).find_map(|extra| layout(extra).filter(|l| l.0 == Layout::Coco17));
    let (layout, columns) = coco.or_else(|| (0..=MAX_EXTRA).find_map(layout))?;
    let point_count = layout.point_count();
    let points = rest.chunks_exact(columns).take(point_count).map(Point::of);
    Some(Person {
        layout,
        points: points.collect(),
    })
}

/// Reads points from `{ "x": [...], "y": [...], "visible": [...] }`
pub(super) fn columns(node: &Node) -> Option<Vec<Point>> {
    let (Some(Node::Numbers(x)), Some(Node::Numbers(y))) = (node.get(&["x"]), node.get(&["y"]))
    else {
        return None;
    };
    let visible = match node.get(&["visible", "conf", "confidence", "score"]) {
        Some(Node::Numbers(visible)) => Some(visible),
        _ => None,
    };
    let complete = x.len() == y.len() && visible.is_none_or(|v| v.len() == x.len());
    let point = |(index, (&x, &y)): (usize, (&f64, &f64))| Point {
        x,
        y,
        confidence: visible.and_then(|v| v.get(index).copied()),
    };
    complete.then(|| x.iter().zip(y).enumerate().map(point).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(points: usize, columns: usize, extra: &str) -> String {
        let numbers: Vec<String> = (0..points * columns).map(|i| format!("0.{i:03}")).collect();
        format!("0 0.5 0.5 0.2 0.9 {}{extra}", numbers.join(" "))
    }

    #[test]
    fn lines_have_17_points_and_optionally_a_confidence_and_a_track() {
        for extra in ["", " 0.87", " 0.87 3"] {
            let with = line_person(&line(17, 3, extra)).unwrap();
            assert_eq!((with.layout, with.points.len()), (Layout::Coco17, 17));
            assert_eq!(with.points[16].confidence, Some(0.05));
            let without = line_person(&line(17, 2, extra)).unwrap();
            assert_eq!((without.layout, without.points.len()), (Layout::Coco17, 17));
            assert_eq!(without.points[0].confidence, None);
        }
        assert_eq!(
            line_person(&line(26, 3, "")).unwrap().layout,
            Layout::Halpe26
        );
    }

    #[test]
    fn other_lines_are_reported_with_their_number() {
        for bad in [
            "0 0.5 0.5 0.2 0.9",
            "0.5 1",
            "",
            "x",
            &line(17, 3, " nan"),
            &line(9, 3, ""),
        ] {
            assert_eq!(line_person(bad), None, "{bad}");
        }
        let error = text_people("\n0 1 2\n").unwrap_err().to_string();
        assert!(error.contains("line 2"), "{error}");
    }
}
