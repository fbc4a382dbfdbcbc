//! The turn angle over time in a video, as a drawing of the page.

use std::fmt::Write;

/// A view at a time
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TimedTurn {
    pub time_s: f64,
    pub turn_degrees: f64,
}

/// Columns and rows of the drawing, and the margin for labels
const SIZE: (f64, f64) = (720.0, 260.0);
const MARGIN: f64 = 46.0;

/// Draws the turn over time as a line, and the views as points; `None` without a line
///
/// `track` are times, in s, and angles, in degrees, continued beyond full turns. A view's point lies at its own angle, in
/// the turn in which the line is at its time.
pub(crate) fn turn_curve(track: &[(f64, f64)], views: &[TimedTurn]) -> Option<String> {
    let (&(start_s, _), &(end_s, _)) = (track.first()?, track.last()?);
    let angles = || track.iter().map(|(_, angle)| *angle);
    let low = angles().fold(f64::INFINITY, f64::min);
    let high = angles().fold(f64::NEG_INFINITY, f64::max);
    if !(end_s > start_s && low.is_finite() && high.is_finite()) {
        return None;
    }
    let low = 90.0 * (low / 90.0 - 0.05).floor();
    let high = 90.0 * (high / 90.0 + 0.05).ceil();
    let (width, height) = SIZE;
    let x = |time_s: f64| MARGIN + (width - 2.0 * MARGIN) * (time_s - start_s) / (end_s - start_s);
    let y = |angle: f64| height - MARGIN + (2.0 * MARGIN - height) * (angle - low) / (high - low);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"turn angle over time\" style=\"max-width: 60rem\" \
         fill=\"currentColor\" font-size=\"13\">\n"
    );
    // Writing to a string cannot fail.
    let mut add = |text: std::fmt::Arguments| {
        let _ = svg.write_fmt(text);
    };
    let mut level = low;
    while level <= high {
        let at = y(level);
        add(format_args!(
            "<path d=\"M{MARGIN} {at:.1}H{:.1}\" stroke=\"currentColor\" opacity=\".2\"/><text x=\"4\" y=\"{:.1}\">{level:.0}°</text>\n",
            width - MARGIN,
            at + 4.0
        ));
        level += 90.0;
    }
    let points: Vec<String> = track
        .iter()
        .map(|(time_s, angle)| format!("{:.1},{:.1}", x(*time_s), y(*angle)))
        .collect();
    add(format_args!(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"currentColor\"/>\n",
        points.join(" ")
    ));
    for view in views {
        let after = track.partition_point(|(time_s, _)| *time_s < view.time_s);
        let near = track[after.min(track.len() - 1)].1;
        let turns = ((near - view.turn_degrees) / 360.0).round();
        add(format_args!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"#d3722e\"/>\n",
            x(view.time_s),
            y(view.turn_degrees + 360.0 * turns)
        ));
    }
    let bottom = height - 12.0;
    add(format_args!(
        "<text x=\"{MARGIN}\" y=\"{bottom}\">{start_s:.1} s</text><text x=\"{:.1}\" y=\"{bottom}\" text-anchor=\"end\">{end_s:.1} s</text>\n</svg>\n",
        width - MARGIN
    ));
    Some(svg)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_lie_on_the_line_in_its_turn() {
        let track = [(1.0, 0.0), (2.0, 180.0), (3.0, 360.0), (4.0, 540.0)];
        let view = TimedTurn {
            time_s: 4.0,
            turn_degrees: 180.0,
        };
        let svg = turn_curve(&track, &[view]).unwrap();
        let last = svg
            .split("points=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap();
        let (x, y) = last.rsplit(' ').next().unwrap().split_once(',').unwrap();
        assert!(svg.contains(&format!("cx=\"{x}\" cy=\"{y}\"")), "{svg}");
        assert!(svg.contains(">540°<") && svg.contains(">1.0 s<"), "{svg}");
    }

    #[test]
    fn there_is_no_drawing_without_a_line() {
        assert_eq!(turn_curve(&[], &[]), None);
        assert_eq!(turn_curve(&[(1.0, 5.0)], &[]), None);
        assert_eq!(turn_curve(&[(2.0, 5.0), (2.0, 6.0)], &[]), None);
    }
}
