//! Uniform grid of segments for "is anything closer than this" questions.

use glam::DVec2;

/// Above this many cells the cells grow: a coarse grid is slow, a huge one does not fit
const MAX_CELLS: f64 = 250_000.0;

/// Segments in square cells
#[derive(Debug)]
pub(crate) struct SegmentIndex {
    low: DVec2,
    cell: f64,
    columns: usize,
    rows: usize,
    cells: Vec<Vec<[DVec2; 2]>>,
}

impl SegmentIndex {
    /// An empty index for segments between `low` and `high`, quick for radii up to `radius`
    pub(crate) fn new(low: DVec2, high: DVec2, radius: f64) -> Self {
        let size = (high - low).max(DVec2::ZERO);
        let cell = radius
            .max((size.x * size.y / MAX_CELLS).sqrt())
            .max(size.max_element() / MAX_CELLS)
            .max(f64::MIN_POSITIVE);
        let columns = (size.x / cell) as usize + 1;
        let rows = (size.y / cell) as usize + 1;
        Self {
            low,
            cell,
            columns,
            rows,
            cells: vec![Vec::new(); columns * rows],
        }
    }

    /// Adds a segment; a point is a segment of length zero
    pub(crate) fn insert(&mut self, a: DVec2, b: DVec2) {
        let (x0, y0) = self.cell_of(a.min(b));
        let (x1, y1) = self.cell_of(a.max(b));
        for y in y0..=y1 {
            for x in x0..=x1 {
                self.cells[y * self.columns + x].push([a, b]);
            }
        }
    }

    /// Whether any segment is closer to `p` than `radius`
    pub(crate) fn any_within(&self, p: DVec2, radius: f64) -> bool {
        let (x0, y0) = self.cell_of(p - radius);
        let (x1, y1) = self.cell_of(p + radius);
        (y0..=y1).any(|y| {
            (x0..=x1).any(|x| {
                self.cells[y * self.columns + x]
                    .iter()
                    .any(|&[a, b]| distance_to_segment(p, a, b) < radius)
            })
        })
    }

    fn cell_of(&self, p: DVec2) -> (usize, usize) {
        // a cast from a negative float saturates at zero
        let at = (p - self.low) / self.cell;
        (
            (at.x as usize).min(self.columns - 1),
            (at.y as usize).min(self.rows - 1),
        )
    }
}

/// Distance of a point from a segment
pub(crate) fn distance_to_segment(p: DVec2, a: DVec2, b: DVec2) -> f64 {
    let along = b - a;
    let length_squared = along.length_squared();
    if length_squared > 0.0 {
        let t = ((p - a).dot(along) / length_squared).clamp(0.0, 1.0);
        p.distance(a + along * t)
    } else {
        p.distance(a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_index_agrees_with_trying_all(
            segments in prop::collection::vec(prop::array::uniform4(-5.0..25.0), 1..30),
            queries in prop::collection::vec((prop::array::uniform2(-9.0..30.0), 0.0..9.0), 1..20),
        ) {
            let low = DVec2::splat(-5.0);
            let high = DVec2::splat(25.0);
            let mut index = SegmentIndex::new(low, high, 2.0);
            let segments: Vec<[DVec2; 2]> = segments
                .iter()
                .map(|s| [DVec2::new(s[0], s[1]), DVec2::new(s[2], s[3])])
                .collect();
            for &[a, b] in &segments {
                index.insert(a, b);
            }
            for (p, radius) in queries {
                let p = DVec2::from_array(p);
                let any = segments.iter().any(|&[a, b]| distance_to_segment(p, a, b) < radius);
                prop_assert_eq!(index.any_within(p, radius), any);
            }
        }
    }
}
