//! The outline of a silhouette as points with normals, and their nearest neighbors.

use glam::DVec2;
use pirouette_geom::Windowed;
use pirouette_geom::contour::trace_windowed;

/// Spacing of the points along the outline, in nominal px
///
/// A smaller spacing has no benefit: neighbors have the same noise.
pub(super) const SPACING: f64 = 1.5;

/// Minimum length of a loop, in nominal px; shorter ones are noise
const MIN_LOOP: f64 = 40.0;

/// Tangents are computed over this many points to either side
const TANGENT_REACH: usize = 2;

/// Cell size of the search grid, in nominal px
const CELL: f64 = 8.0;

/// A point with the outward normal of the person
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EdgePoint {
    pub(super) position: DVec2,
    /// Unit length
    pub(super) normal: DVec2,
}

/// Traces all loops of a soft silhouette, including holes; a nominal pixel is `unit_px` large
pub(super) fn trace(soft: &Windowed<f32>, unit_px: f64) -> Vec<EdgePoint> {
    let mut points = Vec::new();
    for contour in trace_windowed(soft, 0.5) {
        if contour.perimeter() < MIN_LOOP * unit_px {
            continue;
        }
        let along = contour.resample(SPACING * unit_px).points;
        let n = along.len();
        for (i, &position) in along.iter().enumerate() {
            let tangent = along[(i + TANGENT_REACH) % n] - along[(i + n - TANGENT_REACH) % n];
            // Clockwise on screen around the person, so that the outward direction is a quarter turn to the left.
            if let Some(tangent) = tangent.try_normalize() {
                points.push(EdgePoint {
                    position,
                    normal: DVec2::new(tangent.y, -tangent.x),
                });
            }
        }
    }
    points
}

/// Points in the cells of a grid
#[derive(Debug, Clone)]
pub(super) struct PointIndex {
    points: Vec<EdgePoint>,
    /// Index of each point in the original list
    origins: Vec<u32>,
    low: DVec2,
    cell_px: f64,
    columns: usize,
    rows: usize,
    /// Points of cell `c`: `first[c]..first[c + 1]`
    first: Vec<u32>,
}

impl PointIndex {
    /// Sorts points into cells; non-finite ones are ignored
    pub(super) fn new(points: &[EdgePoint], unit_px: f64) -> Self {
        let cell_px = CELL * unit_px;
        let usable = |p: &&EdgePoint| p.position.is_finite() && p.normal.is_finite();
        let mut low = DVec2::splat(f64::INFINITY);
        let mut high = DVec2::splat(f64::NEG_INFINITY);
        for point in points.iter().filter(usable) {
            low = low.min(point.position);
            high = high.max(point.position);
        }
        if !(low.is_finite() && high.is_finite()) {
            (low, high) = (DVec2::ZERO, DVec2::ZERO);
        }
        let columns = ((high.x - low.x) / cell_px) as usize + 1;
        let rows = ((high.y - low.y) / cell_px) as usize + 1;
        let cell = |p: &EdgePoint| {
            let at = (p.position - low) / cell_px;
            (at.y as usize).min(rows - 1) * columns + (at.x as usize).min(columns - 1)
        };
        let mut first = vec![0u32; columns * rows + 1];
        for point in points.iter().filter(usable) {
            first[cell(point) + 1] += 1;
        }
        for c in 1..first.len() {
            first[c] += first[c - 1];
        }
        let mut next = first.clone();
        let total = first[first.len() - 1] as usize;
        let mut origins = vec![0u32; total];
        for (i, point) in points.iter().enumerate().filter(|(_, p)| usable(p)) {
            let slot = &mut next[cell(point)];
            origins[*slot as usize] = i as u32;
            *slot += 1;
        }
        Self {
            points: origins.iter().map(|&i| points[i as usize]).collect(),
            origins,
            low,
            cell_px,
            columns,
            rows,
            first,
        }
    }

    /// Returns the nearest point within `radius_px` with a matching normal, and its index in the list
    ///
    /// Normals match when the cosine between them is above `min_cosine`.
    pub(super) fn nearest(
        &self,
        to: EdgePoint,
        radius_px: f64,
        min_cosine: f64,
    ) -> Option<(usize, EdgePoint)> {
        let at = (to.position - self.low) / self.cell_px;
        if !at.is_finite() {
            return None;
        }
        let (column, row) = (at.x.floor() as isize, at.y.floor() as isize);
        let mut best = None;
        let mut best_squared = radius_px * radius_px;
        // Rings below `nearest` and beyond `farthest` do not meet the grid.
        let beyond = |at: isize, count: usize| (-at).max(at - count as isize + 1).max(0);
        let across = |at: isize, count: usize| at.max(count as isize - 1 - at);
        let nearest = beyond(column, self.columns).max(beyond(row, self.rows));
        let farthest = across(column, self.columns).max(across(row, self.rows));
        for ring in nearest..=farthest {
            // All cells of the ring are at least this far away.
            let gap = (ring - 1).max(0) as f64 * self.cell_px;
            if gap * gap > best_squared {
                break;
            }
            let mut visit = |x: isize, y: isize| {
                if x < 0 || y < 0 || x >= self.columns as isize || y >= self.rows as isize {
                    return;
                }
                let c = y as usize * self.columns + x as usize;
                for i in self.first[c] as usize..self.first[c + 1] as usize {
                    let point = &self.points[i];
                    let squared = point.position.distance_squared(to.position);
                    if squared < best_squared && point.normal.dot(to.normal) > min_cosine {
                        best_squared = squared;
                        best = Some((self.origins[i] as usize, *point));
                    }
                }
            };
            if ring == 0 {
                visit(column, row);
                continue;
            }
            for x in column - ring..=column + ring {
                visit(x, row - ring);
                visit(x, row + ring);
            }
            for y in row - ring + 1..row + ring {
                visit(column - ring, y);
                visit(column + ring, y);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use pirouette_geom::coverage::fill_polygons;

    fn nearest_reference(
        points: &[EdgePoint],
        to: EdgePoint,
        radius_px: f64,
        min_cosine: f64,
    ) -> Option<f64> {
        points
            .iter()
            .filter(|p| p.normal.dot(to.normal) > min_cosine)
            .map(|p| p.position.distance(to.position))
            .filter(|d| *d < radius_px)
            .min_by(f64::total_cmp)
    }

    fn edge_point() -> impl Strategy<Value = EdgePoint> {
        (0.0..200.0f64, 0.0..150.0f64, 0.0..6.2f64).prop_map(|(x, y, turn)| EdgePoint {
            position: DVec2::new(x, y),
            normal: DVec2::from_angle(turn),
        })
    }

    proptest! {
        #[test]
        fn the_nearest_is_that_of_a_search_through_all(
            points in prop::collection::vec(edge_point(), 0..80),
            to in edge_point(),
            radius in 1.0..90.0f64,
        ) {
            let index = PointIndex::new(&points, 1.0);
            let found = index.nearest(to, radius, 0.5);
            let expected = nearest_reference(&points, to, radius, 0.5);
            prop_assert_eq!(found.is_some(), expected.is_some());
            if let (Some((i, point)), Some(distance)) = (found, expected) {
                prop_assert_eq!(points[i], point);
                prop_assert!((point.position.distance(to.position) - distance).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn normals_lead_out_of_the_person_and_into_holes() {
        let square = |low: f64, high: f64| {
            vec![
                DVec2::new(low, low),
                DVec2::new(high, low),
                DVec2::new(high, high),
                DVec2::new(low, high),
            ]
        };
        let mut hole = square(40.0, 60.0);
        hole.reverse();
        let soft = fill_polygons(100, 100, &[square(10.0, 90.0), hole]);
        let points = trace(&Windowed::new(&soft), 1.0);
        assert!(points.len() > 200);
        let center = DVec2::splat(50.0);
        for point in &points {
            let from_center = point.position - center;
            let out = from_center.abs().max_element() > 25.0;
            let sign = if out { 1.0 } else { -1.0 };
            assert!(point.normal.dot(from_center) * sign > 0.0);
        }
    }

    #[test]
    fn nothing_is_near_in_an_empty_index() {
        let index = PointIndex::new(&[], 1.0);
        let to = EdgePoint {
            position: DVec2::ZERO,
            normal: DVec2::X,
        };
        assert!(index.nearest(to, 1e6, -1.0).is_none());
    }
}
