//! Erosion, dilation, connected components and holes of masks.
//!
//! Structuring elements are Euclidean discs of any radius, by thresholding exact distances. Beyond the
//! image nothing is known: its border neither erodes nor dilates a shape.

use crate::{Grid, Mask};

/// A radius that is meant to reach a pixel center does so in spite of rounding
const ROUNDING: f64 = 1.0 + 1e-6;

/// Pixels whose center is at most `radius` px from a pixel of the given value
///
/// Down the columns first: how far the nearest such pixel is, if it is near enough. In a row, a pixel at that height
/// covers a stretch whose length a table tells.
fn within(mask: &Mask, radius: f64, value: bool) -> Mask {
    let (width, height) = (mask.width(), mask.height());
    let radius = radius * ROUNDING;
    // No disc needs to be larger than the image.
    let reach = (radius.min((width + height) as f64) as usize).min(usize::from(u16::MAX) - 1);
    let far = reach as u16 + 1;
    let half_widths: Vec<usize> = (0..=reach)
        .map(|dy| {
            let limit = radius.min(2.0 * (width + height) as f64).powi(2) - (dy * dy) as f64;
            let mut dx = limit.max(0.0).sqrt() as usize;
            while ((dx + 1) * (dx + 1)) as f64 <= limit {
                dx += 1;
            }
            dx
        })
        .collect();
    // Rows from a pixel of the value at or above, row by row; then the nearer of that and one below.
    let mut above = vec![far; width * height];
    let mut nearest = vec![far; width];
    for (y, rows) in above.chunks_exact_mut(width.max(1)).enumerate() {
        for ((row, near), &v) in rows.iter_mut().zip(&mut nearest).zip(mask.row(y)) {
            *near = if v == value { 0 } else { far.min(*near + 1) };
            *row = *near;
        }
    }
    let mut out = Mask::filled(width, height, false);
    // Stretches that begin at a pixel, less those that have ended before it
    let mut starts = vec![0_i32; width + 1];
    nearest.fill(far);
    for y in (0..height).rev() {
        let rows = &above[y * width..(y + 1) * width];
        for (near, &v) in nearest.iter_mut().zip(mask.row(y)) {
            *near = if v == value { 0 } else { far.min(*near + 1) };
        }
        starts.fill(0);
        for (x, (&down, &up)) in nearest.iter().zip(rows).enumerate() {
            let dy = down.min(up);
            if dy < far {
                let half = half_widths[usize::from(dy)];
                starts[x.saturating_sub(half)] += 1;
                starts[(x + half + 1).min(width)] -= 1;
            }
        }
        let mut open = 0;
        for (covered, start) in out.row_mut(y).iter_mut().zip(&starts) {
            open += start;
            *covered = open > 0;
        }
    }
    out
}

/// Adds every pixel whose center is at most `radius` px from a pixel inside
///
/// A radius below one pixel, or one that is not a number, changes nothing.
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, morphology::dilate};
/// let mask = Mask::from_art("..... ..... ..#.. ..... .....");
/// assert_eq!(dilate(&mask, 2.0).to_art(), "..#..\n.###.\n#####\n.###.\n..#..\n");
/// ```
pub fn dilate(mask: &Mask, radius: f64) -> Mask {
    if radius.is_nan() || radius < 1.0 {
        return mask.clone();
    }
    let Some((x0, y0, x1, y1)) = mask.bounding_box() else {
        return mask.clone();
    };
    // nothing changes beyond the reach of the disc
    let (width, height) = (mask.width(), mask.height());
    let reach = radius.min((width + height) as f64) as usize + 1;
    let (x0, y0) = (x0.saturating_sub(reach), y0.saturating_sub(reach));
    let (x1, y1) = ((x1 + reach).min(width), (y1 + reach).min(height));
    if (x1 - x0, y1 - y0) == (width, height) {
        return within(mask, radius, true);
    }
    let part = within(&mask.crop(x0, y0, x1 - x0, y1 - y0), radius, true);
    let mut out = Mask::filled(width, height, false);
    for y in y0..y1 {
        out.row_mut(y)[x0..x1].copy_from_slice(part.row(y - y0));
    }
    out
}

/// Removes every pixel whose center is at most `radius` px from a pixel outside
///
/// The image border does not count as outside. A radius below one pixel, or one that is not a number,
/// changes nothing.
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, morphology::erode};
/// let mask = Mask::from_art("....... .#####. .#####. .#####. .......");
/// assert_eq!(erode(&mask, 1.0).to_art(), ".......\n.......\n..###..\n.......\n.......\n");
/// ```
pub fn erode(mask: &Mask, radius: f64) -> Mask {
    if radius.is_nan() || radius < 1.0 {
        return mask.clone();
    }
    let mut near_outside = within(mask, radius, false);
    for value in near_outside.as_mut_slice() {
        *value = !*value;
    }
    near_outside
}

/// Erodes, then dilates: removes what a disc of `radius` px does not fit into
pub fn open(mask: &Mask, radius: f64) -> Mask {
    dilate(&erode(mask, radius), radius)
}

/// Dilates, then erodes: closes gaps that a disc of `radius` px does not fit into
pub fn close(mask: &Mask, radius: f64) -> Mask {
    erode(&dilate(mask, radius), radius)
}

/// Connected parts of a mask; pixels that share an edge are connected
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Components {
    /// 0 outside the mask, else 1 + the index of the component in `areas`
    pub labels: Grid<u32>,
    /// Pixels of each component, in the order in which rows from the top first meet them
    pub areas: Vec<usize>,
}

impl Components {
    /// Label of the largest component, the first of equals; `None` for an empty mask
    pub fn largest(&self) -> Option<u32> {
        let mut best: Option<usize> = None;
        for (i, &area) in self.areas.iter().enumerate() {
            if best.is_none_or(|b| area > self.areas[b]) {
                best = Some(i);
            }
        }
        best.map(|i| i as u32 + 1)
    }

    /// The mask of one component
    pub fn mask(&self, label: u32) -> Mask {
        self.labels.map(|&l| l == label && l != 0)
    }
}

/// A stretch of pixels inside, in one row
struct Run {
    start: usize,
    end: usize,
    /// Another run of the same component, or itself
    parent: usize,
}

/// Finds the connected parts of a mask; pixels that share an edge are connected
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, morphology::components};
/// let parts = components(&Mask::from_art("##.# #..# ..##"));
/// assert_eq!(parts.areas, [3, 4]);
/// ```
pub fn components(mask: &Mask) -> Components {
    let (runs, row_starts) = connected_runs(mask);
    let mut labels = Grid::filled(mask.width(), mask.height(), 0);
    let mut areas: Vec<usize> = Vec::new();
    let mut label_of_root = vec![0u32; runs.len()];
    for y in 0..mask.height() {
        let row = labels.row_mut(y);
        for i in row_starts[y]..row_starts[y + 1] {
            let root = find(&runs, i);
            if label_of_root[root] == 0 {
                areas.push(0);
                label_of_root[root] = areas.len() as u32;
            }
            let label = label_of_root[root];
            let run = &runs[i];
            areas[label as usize - 1] += run.end - run.start;
            row[run.start..run.end].fill(label);
        }
    }
    Components { labels, areas }
}

/// Keeps the largest component only, the first of equals
pub fn largest_component(mask: &Mask) -> Mask {
    let parts = components(mask);
    match parts.largest() {
        Some(label) if parts.areas.len() > 1 => parts.mask(label),
        _ => mask.clone(),
    }
}

/// Fills holes of fewer than `area_px` pixels
///
/// A hole is a part of the outside that is connected along pixel edges and does not reach the image border.
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, morphology::fill_holes_below};
/// let mask = Mask::from_art("##### #.#.# ###.# #####");
/// assert_eq!(fill_holes_below(&mask, 2).to_art(), "#####\n###.#\n###.#\n#####\n");
/// ```
pub fn fill_holes_below(mask: &Mask, area_px: usize) -> Mask {
    let (width, height) = (mask.width(), mask.height());
    let outside = components(&mask.map(|&v| !v));
    let mut keep: Vec<bool> = outside.areas.iter().map(|&area| area >= area_px).collect();
    for y in 0..height {
        let row = outside.labels.row(y);
        let border = if width == 0 || y == 0 || y + 1 == height {
            row
        } else {
            &[row[0], row[width - 1]]
        };
        for &label in border {
            if label != 0 {
                keep[label as usize - 1] = true;
            }
        }
    }
    outside
        .labels
        .map(|&label| label == 0 || !keep[label as usize - 1])
}

/// All runs, joined to components, and the index of the first run of each row (one more than rows)
fn connected_runs(mask: &Mask) -> (Vec<Run>, Vec<usize>) {
    let mut runs: Vec<Run> = Vec::new();
    let mut row_starts = vec![0];
    let mut above = 0..0;
    for y in 0..mask.height() {
        let row = mask.row(y);
        let first = runs.len();
        let mut x = 0;
        while let Some(skip) = row[x..].iter().position(|&v| v) {
            let start = x + skip;
            let length = row[start..].iter().position(|&v| !v);
            let end = length.map_or(row.len(), |length| start + length);
            runs.push(Run {
                start,
                end,
                parent: runs.len(),
            });
            x = end;
        }
        let mut upper = above.start;
        for lower in first..runs.len() {
            while upper < above.end && runs[upper].end <= runs[lower].start {
                upper += 1;
            }
            let mut touching = upper;
            while touching < above.end && runs[touching].start < runs[lower].end {
                unite(&mut runs, touching, lower);
                touching += 1;
            }
        }
        above = first..runs.len();
        row_starts.push(runs.len());
    }
    (runs, row_starts)
}

fn find(runs: &[Run], mut i: usize) -> usize {
    while runs[i].parent != i {
        i = runs[i].parent;
    }
    i
}

fn unite(runs: &mut [Run], a: usize, b: usize) {
    let (a, b) = (find_and_shorten(runs, a), find_and_shorten(runs, b));
    // The earlier run is the root, so chains stay short and labels follow the rows
    runs[a.max(b)].parent = a.min(b);
}

fn find_and_shorten(runs: &mut [Run], mut i: usize) -> usize {
    while runs[i].parent != i {
        let grandparent = runs[runs[i].parent].parent;
        runs[i].parent = grandparent;
        i = grandparent;
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn masks() -> impl Strategy<Value = Mask> {
        (1usize..16, 1usize..16, 0.2..0.9f64).prop_flat_map(|(width, height, density)| {
            prop::collection::vec(prop::bool::weighted(density), width * height)
                .prop_map(move |data| Mask::from_vec(width, height, data))
        })
    }

    fn dilate_reference(mask: &Mask, radius: f64) -> Mask {
        Mask::from_fn(mask.width(), mask.height(), |x, y| {
            (0..mask.height()).any(|v| {
                (0..mask.width()).any(|u| {
                    let d = (u as f64 - x as f64).hypot(v as f64 - y as f64);
                    mask[(u, v)] && d <= radius
                })
            })
        })
    }

    /// Floods from every pixel that has no label yet
    fn components_reference(mask: &Mask) -> Components {
        let mut labels = Grid::filled(mask.width(), mask.height(), 0u32);
        let mut areas = Vec::new();
        for y in 0..mask.height() {
            for x in 0..mask.width() {
                if !mask[(x, y)] || labels[(x, y)] != 0 {
                    continue;
                }
                areas.push(0);
                let label = areas.len() as u32;
                let mut stack = vec![(x as isize, y as isize)];
                while let Some((x, y)) = stack.pop() {
                    if mask.get(x, y) != Some(&true) || labels.get(x, y) != Some(&0) {
                        continue;
                    }
                    labels[(x as usize, y as usize)] = label;
                    areas[label as usize - 1] += 1;
                    stack.extend([(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)]);
                }
            }
        }
        Components { labels, areas }
    }

    #[test]
    fn diagonal_pixels_are_two_components() {
        let mask = Mask::from_art("#. .#");
        assert_eq!(components(&mask).areas, [1, 1]);
        assert_eq!(largest_component(&mask).to_art(), "#.\n..\n");
    }

    #[test]
    fn a_spiral_is_one_component() {
        let mask = Mask::from_art("##### ....# ###.# #.#.# #...# #####");
        assert_eq!(components(&mask).areas, [mask.area()]);
    }

    #[test]
    fn fill_holes_leaves_the_gap_that_opens_to_the_border() {
        let legs = Mask::from_art("##### #.#.# ###.# ###.#");
        let filled = Mask::from_art("##### ###.# ###.# ###.#");
        assert_eq!(fill_holes_below(&legs, 100), filled);
    }

    #[test]
    fn open_removes_a_thread_and_keeps_the_block() {
        let mask = Mask::from_art("......... .####.... .######## .####.... .####.... .........");
        let opened = open(&mask, 1.0);
        assert!(!opened[(7, 2)] && opened[(2, 2)] && opened[(3, 3)]);
    }

    #[test]
    fn empty_full_and_odd_inputs_are_fine() {
        for mask in [
            Mask::filled(0, 0, true),
            Mask::filled(0, 3, true),
            Mask::filled(3, 0, true),
            Mask::filled(1, 1, true),
            Mask::filled(4, 3, true),
            Mask::filled(4, 3, false),
        ] {
            for radius in [f64::NAN, -1.0, 0.0, 2.0, f64::INFINITY] {
                assert_eq!(dilate(&mask, radius), mask);
                assert_eq!(erode(&mask, radius), mask);
            }
            assert_eq!(largest_component(&mask), mask);
            assert_eq!(fill_holes_below(&mask, usize::MAX), mask);
        }
    }

    proptest! {
        #[test]
        fn components_agree_with_flooding(mask in masks()) {
            prop_assert_eq!(components(&mask), components_reference(&mask));
        }

        #[test]
        fn dilation_agrees_with_looking_at_every_pixel(mask in masks(), radius in 0.0..6.0f64, whole: bool) {
            let radius = if whole { radius.round() } else { radius };
            prop_assert_eq!(dilate(&mask, radius), dilate_reference(&mask, radius));
        }

        #[test]
        fn erosion_is_dilation_of_the_outside(mask in masks(), radius in 0.0..6.0f64) {
            let outside = mask.map(|&v| !v);
            prop_assert_eq!(erode(&mask, radius), dilate(&outside, radius).map(|&v| !v));
        }
    }
}
