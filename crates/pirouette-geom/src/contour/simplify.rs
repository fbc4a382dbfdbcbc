//! Simplification of closed polylines.

use glam::DVec2;

use super::{Contour, nearest_on_segment};

/// Removes points that lie within `tolerance_px` of the line through the remaining points
///
/// The closed line is split at two points that are farthest from each other, then each half is simplified separately.
/// The result is a subset of the points, in order; coinciding neighbors are merged. Thin shapes can be reduced to two
/// points, and lines that ran side by side within the tolerance can cross.
///
/// # Source
/// D. Douglas, T. Peucker 1973, "Algorithms for the reduction of the number of points required to
/// represent a digitized line or its caricature"; here with distances to the segment, not to its line.
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, contour::{simplify, trace_contours}};
/// let square = &trace_contours(&Mask::from_art("..... .###. .###. .###. ....."))[0];
/// assert_eq!(simplify(square, 0.1).points.len(), 4);
/// ```
pub fn simplify(contour: &Contour, tolerance_px: f64) -> Contour {
    let stays = simplified_indices(contour, tolerance_px);
    Contour {
        points: stays.into_iter().map(|i| contour.points[i]).collect(),
        hole: contour.hole,
    }
}

/// Returns the indices of the points that [`simplify`] keeps: ascending, except for one wrap to the front
pub fn simplified_indices(contour: &Contour, tolerance_px: f64) -> Vec<usize> {
    let at = |i: usize| contour.points[i];
    let mut indices: Vec<usize> = (0..contour.points.len()).collect();
    indices.dedup_by(|next, kept| at(*next) == at(*kept));
    while indices.len() > 1 && at(indices[0]) == at(indices[indices.len() - 1]) {
        indices.pop();
    }
    let mut points: Vec<DVec2> = indices.iter().map(|&i| at(i)).collect();
    let [first, second] = far_apart(&points);
    if first != second {
        // Start at one of the two, so that the halves are contiguous ranges; the start is repeated at the end
        points.rotate_left(first);
        indices.rotate_left(first);
        let middle = (second + points.len() - first) % points.len();
        points.push(points[0]);
        let mut stays = vec![false; points.len()];
        stays[0] = true;
        stays[middle] = true;
        let mut ranges = vec![(0, middle), (middle, points.len() - 1)];
        while let Some((start, end)) = ranges.pop() {
            if let Some(split) = farthest_between(&points, start, end, tolerance_px) {
                stays[split] = true;
                ranges.push((start, split));
                ranges.push((split, end));
            }
        }
        let mut stays = stays.into_iter();
        indices.retain(|_| stays.next().unwrap_or(false));
    }
    indices
}

/// Returns the indices of two points, each farthest from the other; equal when all points coincide
fn far_apart(points: &[DVec2]) -> [usize; 2] {
    let farthest_from = |from: usize| {
        let mut best = (from, 0.0);
        for (i, p) in points.iter().enumerate() {
            let distance = p.distance_squared(points[from]);
            if distance > best.1 {
                best = (i, distance);
            }
        }
        best
    };
    if points.is_empty() {
        return [0, 0];
    }
    let mut here = 0;
    let (mut there, mut distance) = farthest_from(here);
    loop {
        let (next, farther) = farthest_from(there);
        if farther <= distance {
            return [here, there];
        }
        (here, there, distance) = (there, next, farther);
    }
}

/// Returns the point strictly between two others that is farthest from their segment, if beyond the tolerance
fn farthest_between(
    points: &[DVec2],
    start: usize,
    end: usize,
    tolerance_px: f64,
) -> Option<usize> {
    let mut best = None;
    let mut farthest = tolerance_px * tolerance_px;
    for i in start + 1..end {
        let distance =
            points[i].distance_squared(nearest_on_segment(points[i], points[start], points[end]));
        if distance > farthest {
            farthest = distance;
            best = Some(i);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn contour(points: &[(f64, f64)]) -> Contour {
        Contour {
            points: points.iter().map(|&(x, y)| DVec2::new(x, y)).collect(),
            hole: true,
        }
    }

    #[test]
    fn straight_runs_lose_their_points_wherever_the_contour_starts() {
        let points = [
            (2.0, 0.0),
            (4.0, 0.0),
            (4.0, 2.0),
            (4.0, 3.0),
            (1.0, 3.0),
            (0.0, 3.0),
            (0.0, 1.0),
            (0.0, 0.0),
        ];
        for start in 0..points.len() {
            let mut turned = points;
            turned.rotate_left(start);
            let simple = simplify(&contour(&turned), 0.5);
            assert_eq!(simple.points.len(), 4);
            assert!((simple.signed_area() - 12.0).abs() < 1e-12);
            assert!(simple.hole);
        }
    }

    #[test]
    fn degenerate_contours_are_handled() {
        for (points, expected) in [
            (vec![], 0),
            (vec![(1.0, 1.0)], 1),
            (vec![(1.0, 1.0); 5], 1),
            (vec![(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (1.0, 0.0)], 2),
            (vec![(f64::NAN, 0.0), (f64::NAN, 0.0)], 2),
        ] {
            assert_eq!(simplify(&contour(&points), 0.1).points.len(), expected);
        }
    }

    proptest! {
        #[test]
        fn no_point_is_farther_than_the_tolerance(
            radii in prop::collection::vec(5.0..9.0f64, 3..60),
            tolerance in 0.0..3.0f64,
        ) {
            let count = radii.len() as f64;
            let blob: Vec<(f64, f64)> = radii
                .iter()
                .enumerate()
                .map(|(i, r)| (i as f64 / count * std::f64::consts::TAU, r))
                .map(|(t, r)| (r * t.cos(), r * t.sin()))
                .collect();
            let blob = contour(&blob);
            let simple = simplify(&blob, tolerance);
            prop_assert!(simple.points.len() <= blob.points.len());
            for p in &blob.points {
                let nearest = simple
                    .edges()
                    .map(|[a, b]| p.distance(nearest_on_segment(*p, a, b)))
                    .fold(f64::INFINITY, f64::min);
                prop_assert!(nearest <= tolerance + 1e-9);
            }
        }
    }
}
