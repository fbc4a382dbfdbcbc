//! Simplification of several contours without crossings.

use glam::DVec2;

use super::arrange::{GridPoint, meeting, overlapping_boxes, to_grid};
use crate::contour::{Contour, nearest_on_segment, simplified_indices};

/// Simplifies contours like [`crate::contour::simplify`], but with more points where lines would cross or touch
///
/// Two lines closer to each other than the tolerance (legs that nearly touch, a thin wrist) can swap sides when they
/// are simplified separately; a mesh of them would be connected there. Thin shapes keep their area. Segments longer
/// than `longest_px` are split at intermediate points, if any.
///
/// Thin crescents, whose sides would swap without a crossing, keep their orientation.
///
/// Returns the indices of the kept points per contour, ascending except for one wrap to the front. Lines that
/// already meet before simplification still meet.
pub fn simplify_apart(contours: &[Contour], tolerance_px: f64, longest_px: f64) -> Vec<Vec<usize>> {
    let mut kept_indices: Vec<Vec<usize>> = contours
        .iter()
        .map(|contour| {
            let kept_indices = simplified_indices(contour, tolerance_px);
            split_long(&contour.points, &kept_indices, longest_px)
        })
        .collect();
    // Each round adds points, so the loop ends; real contours need two or three rounds.
    while refine(contours, &mut kept_indices) {}
    kept_indices
}

/// Splits long segments at equal numbers of points, which are evenly spaced in traced contours
fn split_long(points: &[DVec2], kept_indices: &[usize], longest_px: f64) -> Vec<usize> {
    let mut split = Vec::with_capacity(kept_indices.len());
    for (k, &from) in kept_indices.iter().enumerate() {
        let to = kept_indices[(k + 1) % kept_indices.len()];
        let count = (to + points.len() - from) % points.len();
        let length = points[from].distance(points[to]);
        // a NaN ratio becomes one part
        let parts = ((length / longest_px).ceil() as usize).clamp(1, count.max(1));
        split.extend((0..parts).map(|i| (from + i * count / parts) % points.len()));
    }
    split
}

/// Returns whether the kept points run around the contour in the other direction
fn is_turned_over(contour: &Contour, kept_indices: &[usize]) -> bool {
    let kept = Contour {
        points: kept_indices.iter().map(|&i| contour.points[i]).collect(),
        hole: contour.hole,
    };
    let area = contour.signed_area();
    area != 0.0 && kept.signed_area() * area <= 0.0
}

/// Adds the farthest point to every segment that meets another, and to those of contours that are turned over; returns whether
/// any point was added
fn refine(contours: &[Contour], kept_indices: &mut [Vec<usize>]) -> bool {
    let mut owners: Vec<(usize, usize)> = Vec::new();
    let mut segments: Vec<[GridPoint; 2]> = Vec::new();
    for (c, (contour, indices)) in contours.iter().zip(kept_indices.iter()).enumerate() {
        let point = |k: usize| to_grid(contour.points[indices[k % indices.len()]]);
        for k in 0..indices.len() {
            owners.push((c, k));
            segments.push([point(k), point(k + 1)]);
        }
    }
    let mut meets = vec![false; segments.len()];
    for (i, j) in overlapping_boxes(&segments) {
        let [[a, b], [c, d]] = [segments[i], segments[j]];
        let coincide = (a, b) == (c, d) || (a, b) == (d, c);
        if coincide || meeting([a, b], [c, d]).is_some() {
            (meets[i], meets[j]) = (true, true);
        }
    }
    let turned_over = contours.iter().zip(kept_indices.iter());
    let turned_over: Vec<bool> = turned_over
        .map(|(contour, indices)| is_turned_over(contour, indices))
        .collect();
    for (meets, &(c, _)) in meets.iter_mut().zip(&owners) {
        *meets |= turned_over[c];
    }
    let mut added = false;
    // backward, so that insertions do not shift the remaining segments
    for (&(c, k), _) in owners.iter().zip(&meets).rev().filter(|(_, meets)| **meets) {
        let indices = &mut kept_indices[c];
        let (from, to) = (indices[k], indices[(k + 1) % indices.len()]);
        if let Some(middle) = farthest_between(&contours[c].points, from, to) {
            indices.insert(k + 1, middle);
            added = true;
        }
    }
    added
}

/// Returns the index of the point between two others, forward around the contour, farthest from their segment
fn farthest_between(points: &[DVec2], from: usize, to: usize) -> Option<usize> {
    let count = (to + points.len() - from) % points.len();
    let between = (1..count).map(|step| (from + step) % points.len());
    let distance =
        |i: usize| points[i].distance(nearest_on_segment(points[i], points[from], points[to]));
    between.max_by(|&i, &j| distance(i).total_cmp(&distance(j)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mask;
    use crate::contour::{simplify, trace_outline};
    use proptest::prelude::*;

    fn crossings(contours: &[Contour]) -> usize {
        let segments: Vec<[GridPoint; 2]> = contours
            .iter()
            .flat_map(|c| c.edges())
            .map(|edge| edge.map(to_grid))
            .collect();
        overlapping_boxes(&segments)
            .iter()
            .filter(|&&(i, j)| meeting(segments[i], segments[j]).is_some())
            .count()
    }

    fn picked(contours: &[Contour], kept_indices: &[Vec<usize>]) -> Vec<Contour> {
        let pick = |(c, s): (&Contour, &Vec<usize>)| Contour {
            points: s.iter().map(|&i| c.points[i]).collect(),
            hole: c.hole,
        };
        contours.iter().zip(kept_indices).map(pick).collect()
    }

    #[test]
    fn contours_far_apart_are_simplified_independently() {
        let art = "......... .#######. .#######. .#######. .........";
        let mask = Mask::from_art(art).map(|&v| f32::from(u8::from(v)));
        let outline = trace_outline(&mask, 0.5);
        let kept_indices = simplify_apart(&outline, 1.0, f64::INFINITY);
        assert_eq!(
            picked(&outline, &kept_indices),
            [simplify(&outline[0], 1.0)]
        );
    }

    #[test]
    fn a_thin_crescent_is_not_turned_over() {
        let mut values = crate::Grid::filled(16, 16, 0.0_f32);
        for (x, y, value) in [
            (0, 0, 0.905),
            (1, 0, 0.607),
            (2, 0, 0.783),
            (3, 0, 0.765),
            (3, 1, 0.524),
            (4, 1, 0.240),
            (5, 1, 0.853),
            (3, 2, 0.502),
            (4, 2, 0.955),
            (5, 2, 0.169),
            (4, 3, 0.330),
            (5, 3, 0.650),
            (7, 3, 0.397),
            (8, 3, 1.000),
            (5, 4, 0.524),
            (7, 4, 0.648),
            (8, 4, 0.123),
            (9, 4, 0.885),
            (5, 5, 0.860),
            (6, 5, 0.635),
            (7, 5, 0.697),
            (7, 6, 0.818),
            (8, 6, 0.839),
        ] {
            values[(x, y)] = value;
        }
        let outline = trace_outline(&values, 0.5);
        let kept_indices = simplify_apart(&outline, 3.984306, 9.361454);
        for contour in picked(&outline, &kept_indices) {
            assert_eq!(contour.signed_area() < 0.0, contour.hole);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]
        #[test]
        fn outlines_of_noise_never_cross(
            values in prop::collection::vec(0f32..1.0, 16 * 16),
            tolerance in 0.0..4.0f64,
            longest in 0.5..20.0f64,
        ) {
            let outline = trace_outline(&crate::Grid::from_vec(16, 16, values), 0.5);
            let kept_indices = simplify_apart(&outline, tolerance, longest);
            for (contour, indices) in outline.iter().zip(&kept_indices) {
                prop_assert!(indices.iter().all(|&i| i < contour.points.len()));
                let descents = indices.windows(2).filter(|w| w[1] <= w[0]).count();
                prop_assert!(descents <= 1);
            }
            let simple = picked(&outline, &kept_indices);
            prop_assert_eq!(crossings(&simple), 0);
            for contour in &simple {
                prop_assert!(contour.signed_area() != 0.0);
                prop_assert_eq!(contour.signed_area() < 0.0, contour.hole);
            }
        }
    }
}
