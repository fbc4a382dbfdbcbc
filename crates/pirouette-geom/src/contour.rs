//! Contours: closed polylines around masks and level sets, and operations on them.
//!
//! [`trace_contours`] follows the border pixels of a mask, through their centers; [`trace_outline`] finds
//! the loops at a level of a smooth raster, between the pixels. Outer loops have positive signed area in
//! pixel coordinates (clockwise on screen, since y points down), holes negative. Outlines are simple loops
//! that never touch; border contours follow one-pixel bridges in both directions and can touch themselves.

mod border;
mod outline;
mod simplify;
mod widen;

pub use border::{Border, trace_borders, trace_contours};
pub use outline::{trace_outline, trace_windowed};
pub use simplify::{simplified_indices, simplify};
pub use widen::widen_border;

use glam::DVec2;

/// Returns the point of a segment nearest to a point
///
/// # Examples
/// ```
/// use glam::DVec2;
/// use pirouette_geom::contour::nearest_on_segment;
/// let (from, to) = (DVec2::new(1.0, 1.0), DVec2::new(5.0, 1.0));
/// assert_eq!(nearest_on_segment(DVec2::new(2.0, 9.0), from, to), DVec2::new(2.0, 1.0));
/// assert_eq!(nearest_on_segment(DVec2::new(8.0, 3.0), from, to), to);
/// assert_eq!(nearest_on_segment(DVec2::ZERO, from, from), from);
/// ```
pub fn nearest_on_segment(p: DVec2, from: DVec2, to: DVec2) -> DVec2 {
    let along = to - from;
    let length_squared = along.length_squared();
    if length_squared > 0.0 {
        from + along * ((p - from).dot(along) / length_squared).clamp(0.0, 1.0)
    } else {
        from
    }
}

/// A closed polyline in pixels; the last point joins the first
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Contour {
    /// The corners, each once
    pub points: Vec<DVec2>,
    /// Whether it bounds a hole
    pub hole: bool,
}

impl Contour {
    /// Returns the edges in order, the closing one last
    pub fn edges(&self) -> impl Iterator<Item = [DVec2; 2]> + '_ {
        let ends = self.points.iter().cycle().skip(1);
        self.points.iter().zip(ends).map(|(&a, &b)| [a, b])
    }

    /// Returns the enclosed area in px², positive when clockwise on screen
    pub fn signed_area(&self) -> f64 {
        // Relative to the first point, to preserve digits of distant contours
        let origin = self.points.first().copied().unwrap_or_default();
        self.edges()
            .map(|[a, b]| 0.5 * (a - origin).perp_dot(b - origin))
            .sum()
    }

    /// Returns the length of the closed line, in px
    pub fn perimeter(&self) -> f64 {
        self.edges().map(|[a, b]| a.distance(b)).sum()
    }

    /// Whether the line winds around a point; unspecified on the line itself
    pub fn contains(&self, point: DVec2) -> bool {
        let mut winding = 0;
        for [a, b] in self.edges() {
            let down = a.y <= point.y && b.y > point.y;
            let up = b.y <= point.y && a.y > point.y;
            if down || up {
                let side = (b - a).perp_dot(point - a);
                if down && side < 0.0 {
                    winding += 1;
                } else if up && side > 0.0 {
                    winding -= 1;
                }
            }
        }
        winding != 0
    }

    /// Places points at equal distances along the line, starting at the first point
    ///
    /// The distance is adjusted slightly from `spacing_px`, so that an integer number fits; at least three points.
    /// A contour without length, or a spacing that is not positive, gives an unchanged copy.
    #[must_use]
    pub fn resample(&self, spacing_px: f64) -> Contour {
        let perimeter = self.perimeter();
        if !(perimeter > 0.0 && perimeter.is_finite() && spacing_px > 0.0) {
            return self.clone();
        }
        let count = (perimeter / spacing_px).round().max(3.0) as usize;
        let mut points = Vec::with_capacity(count);
        let mut walked = 0.0;
        for [a, b] in self.edges() {
            let length = a.distance(b);
            while points.len() < count {
                let ahead = perimeter * points.len() as f64 / count as f64 - walked;
                if ahead >= length {
                    break;
                }
                points.push(a.lerp(b, ahead / length));
            }
            walked += length;
        }
        Contour {
            points,
            hole: self.hole,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn contour(points: &[(f64, f64)]) -> Contour {
        Contour {
            points: points.iter().map(|&(x, y)| DVec2::new(x, y)).collect(),
            hole: false,
        }
    }

    fn square() -> Contour {
        contour(&[(1.0, 1.0), (5.0, 1.0), (5.0, 5.0), (1.0, 5.0)])
    }

    #[test]
    fn clockwise_on_screen_is_positive() {
        assert_eq!(square().signed_area(), 16.0);
        assert_eq!(square().perimeter(), 16.0);
        let mut turned = square();
        turned.points.reverse();
        assert_eq!(turned.signed_area(), -16.0);
    }

    #[test]
    fn contains_separates_inside_from_outside_in_both_orientations() {
        let mut l_shape = contour(&[(0., 0.), (4., 0.), (4., 2.), (2., 2.), (2., 4.), (0., 4.)]);
        for _ in 0..2 {
            assert!(l_shape.contains(DVec2::new(1.0, 3.0)));
            assert!(l_shape.contains(DVec2::new(3.0, 1.0)));
            assert!(!l_shape.contains(DVec2::new(3.0, 3.0)));
            assert!(!l_shape.contains(DVec2::new(-1.0, 2.0)));
            assert!(!l_shape.contains(DVec2::NAN));
            l_shape.points.reverse();
        }
    }

    #[test]
    fn resample_gives_equal_steps() {
        let even = square().resample(2.0);
        assert_eq!(even.points.len(), 8);
        assert_eq!(even.points[1], DVec2::new(3.0, 1.0));
        assert_eq!(even.points[7], DVec2::new(1.0, 3.0));
        assert_eq!(square().resample(1e9).points.len(), 3);
    }

    #[test]
    fn degenerate_contours_are_handled() {
        for points in [vec![], vec![(2.0, 3.0)], vec![(f64::NAN, 0.0), (1.0, 1.0)]] {
            let odd = contour(&points);
            assert!(odd.signed_area() == 0.0 || odd.signed_area().is_nan());
            assert!(!odd.contains(DVec2::new(2.0, 3.0)));
            for spacing in [1.0, 0.0, -1.0, f64::NAN] {
                assert_eq!(odd.resample(spacing).points.len(), points.len());
            }
        }
    }

    proptest! {
        #[test]
        fn resampling_keeps_equal_arcs(count in 3usize..40, spacing in 0.3..9.0f64) {
            let circle: Vec<(f64, f64)> = (0..count)
                .map(|i| (i as f64 / count as f64 * std::f64::consts::TAU).sin_cos())
                .map(|(s, c)| (9.0 * c, 9.0 * s))
                .collect();
            let circle = contour(&circle);
            let even = circle.resample(spacing);
            let expected = (circle.perimeter() / spacing).round().max(3.0) as usize;
            prop_assert_eq!(even.points.len(), expected);
            let step = circle.perimeter() / expected as f64;
            for [a, b] in even.edges() {
                prop_assert!(a.distance(b) <= step + 1e-9);
            }
        }
    }
}
