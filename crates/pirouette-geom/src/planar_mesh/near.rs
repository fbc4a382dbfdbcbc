//! Uniform grid of segments for proximity queries.

use glam::DVec2;

use crate::contour::nearest_on_segment;

/// Maximum cells per expected segment: more take longer to create than they save
const CELLS_PER_SEGMENT: f64 = 4.0;

/// Maximum number of cells
const MAX_CELLS: f64 = 250_000.0;

/// Segments in square cells
#[derive(Debug)]
pub(crate) struct SegmentIndex {
    low: DVec2,
    cell: f64,
    columns: usize,
    rows: usize,
    /// Last entry of each cell
    last: Vec<Option<u32>>,
    entries: Vec<Entry>,
    count: usize,
}

/// A segment in one of its cells
#[derive(Debug)]
struct Entry {
    ends: [DVec2; 2],
    /// Insertion index of the segment
    order: usize,
    /// Previous entry in the same cell
    before: Option<u32>,
}

impl SegmentIndex {
    /// Creates an empty index for about `count` segments between `low` and `high`, fast for radii up to `radius`
    pub(crate) fn new(low: DVec2, high: DVec2, radius: f64, count: usize) -> Self {
        let size = (high - low).max(DVec2::ZERO);
        let most = (CELLS_PER_SEGMENT * count as f64).clamp(1.0, MAX_CELLS);
        let cell = radius
            .max((size.x * size.y / most).sqrt())
            .max(size.max_element() / most)
            .max(f64::MIN_POSITIVE);
        let columns = (size.x / cell) as usize + 1;
        let rows = (size.y / cell) as usize + 1;
        Self {
            low,
            cell,
            columns,
            rows,
            last: vec![None; columns * rows],
            entries: Vec::with_capacity(2 * count),
            count: 0,
        }
    }

    /// Adds a segment; a point is a segment of length zero
    pub(crate) fn insert(&mut self, a: DVec2, b: DVec2) {
        let (x0, y0) = self.cell_of(a.min(b));
        let (x1, y1) = self.cell_of(a.max(b));
        for y in y0..=y1 {
            for x in x0..=x1 {
                let last = &mut self.last[y * self.columns + x];
                let before = last.replace(self.entries.len() as u32);
                self.entries.push(Entry {
                    ends: [a, b],
                    order: self.count,
                    before,
                });
            }
        }
        self.count += 1;
    }

    /// Whether any segment is closer to `p` than `radius`
    pub(crate) fn any_within(&self, p: DVec2, radius: f64) -> bool {
        self.within(p, radius).next().is_some()
    }

    /// Returns the lowest insertion index of the segments closer to `p` than `radius`
    pub(crate) fn first_within(&self, p: DVec2, radius: f64) -> Option<usize> {
        self.within(p, radius).min()
    }

    /// Returns the segments closer to `p` than `radius`, possibly with repeats
    fn within(&self, p: DVec2, radius: f64) -> impl Iterator<Item = usize> {
        let (x0, y0) = self.cell_of(p - radius);
        let (x1, y1) = self.cell_of(p + radius);
        let cells = (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| y * self.columns + x));
        let entry = |index: Option<u32>| index.map(|index| &self.entries[index as usize]);
        cells
            .flat_map(move |cell| {
                std::iter::successors(entry(self.last[cell]), move |e| entry(e.before))
            })
            .filter(move |e| p.distance(nearest_on_segment(p, e.ends[0], e.ends[1])) < radius)
            .map(|e| e.order)
    }

    fn cell_of(&self, p: DVec2) -> (usize, usize) {
        // casts from negative floats saturate at zero
        let at = (p - self.low) / self.cell;
        (
            (at.x as usize).min(self.columns - 1),
            (at.y as usize).min(self.rows - 1),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_index_agrees_with_brute_force(
            segments in prop::collection::vec(prop::array::uniform4(-5.0..25.0), 1..30),
            queries in prop::collection::vec((prop::array::uniform2(-9.0..30.0), 0.0..9.0), 1..20),
        ) {
            let low = DVec2::splat(-5.0);
            let high = DVec2::splat(25.0);
            let mut index = SegmentIndex::new(low, high, 2.0, segments.len());
            let segments: Vec<[DVec2; 2]> = segments
                .iter()
                .map(|s| [DVec2::new(s[0], s[1]), DVec2::new(s[2], s[3])])
                .collect();
            for &[a, b] in &segments {
                index.insert(a, b);
            }
            for (p, radius) in queries {
                let p = DVec2::from_array(p);
                let first = segments
                    .iter()
                    .position(|&[a, b]| p.distance(nearest_on_segment(p, a, b)) < radius);
                prop_assert_eq!(index.any_within(p, radius), first.is_some());
                prop_assert_eq!(index.first_within(p, radius), first);
            }
        }
    }
}
