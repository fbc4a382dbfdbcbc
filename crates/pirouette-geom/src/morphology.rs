//! Erosion, dilation, connected components and holes of masks.
//!
//! Structuring elements are Euclidean discs. A disc of radius `r` around a pixel center contains the pixel centers at a
//! distance of at most `r * (1 + 1e-6)`, so that a radius computed as the distance of two centers includes them despite
//! rounding. A radius below one pixel contains only the center. Pixels beyond the image are unknown: its border neither
//! erodes nor dilates a shape.

use crate::Mask;
use crate::raster::run_length;

/// Factor on each radius: a radius computed as the distance of two pixel centers includes them despite rounding
///
/// Lengthens a radius of 100 px by a ten-thousandth of a pixel.
const ROUNDING: f64 = 1.0 + 1e-6;

/// Returns the pixels whose center is at most `radius` px from a pixel of the given value
///
/// Works on rows of bits: each row is widened to the rows of the disc, from the narrowest to the widest, and each time
/// combined with the rows above and below.
fn within(mask: &Mask, radius: f64, value: bool) -> Mask {
    let (width, height) = (mask.width(), mask.height());
    let half_widths = half_widths(radius * ROUNDING, width, height);
    let words = width.div_ceil(WORD);
    let mut covered = vec![0_u64; words * height];
    // with an empty word at both ends
    let (mut wide, mut narrow) = (vec![0_u64; words], vec![0_u64; words + 2]);
    for y in 0..height {
        pack(mask.row(y), value, &mut wide);
        if wide.iter().all(|&word| word == 0) {
            continue;
        }
        let mut half = 0;
        for (dy, &wanted) in half_widths.iter().enumerate().rev() {
            while half < wanted {
                // The row consists of runs of at least `half + 1` pixels, even at the image border, so its shifted copies
                // leave no gaps.
                let step = (wanted - half).min(half + 1).min(WORD - 1);
                narrow[1..=words].copy_from_slice(&wide);
                add_shifted(&mut wide, &narrow, step);
                half += step;
            }
            let above = y.checked_sub(dy);
            let below = (dy > 0 && y + dy < height).then_some(y + dy);
            for row in above.into_iter().chain(below) {
                let row = &mut covered[words * row..words * (row + 1)];
                for (covered, wide) in row.iter_mut().zip(&wide) {
                    *covered |= wide;
                }
            }
        }
    }
    let mut out = Mask::filled(width, height, false);
    for (y, words) in covered.chunks_exact(words.max(1)).take(height).enumerate() {
        unpack(words, out.row_mut(y));
    }
    out
}

/// Pixels per word
const WORD: usize = u64::BITS as usize;

/// Returns half widths of a disc: in its middle row, then in those below, at most as many as the image has rows
fn half_widths(radius: f64, width: usize, height: usize) -> Vec<usize> {
    // Larger discs than the image have no effect.
    let radius = radius.min((width + height) as f64);
    let reach = (radius as usize).min(height.saturating_sub(1));
    let half_width = |dy: usize| largest_root(radius * radius - (dy * dy) as f64).min(width);
    (0..=reach).map(half_width).collect()
}

/// Returns the largest integer whose square is at most `limit`; 0 for a negative limit
fn largest_root(limit: f64) -> usize {
    // The square root may have been rounded up to an integer.
    let root = limit.max(0.0).sqrt() as usize;
    let too_large = root > 0 && (root * root) as f64 > limit;
    root - usize::from(too_large)
}

/// A one in each byte
const ONES: u64 = u64::MAX / 255;

/// Packs a row into bits, set where a pixel has the value
fn pack(row: &[bool], value: bool, words: &mut [u64]) {
    let flip = if value { 0 } else { ONES };
    for (word, pixels) in words.iter_mut().zip(row.chunks(WORD)) {
        *word = 0;
        for (i, pixels) in pixels.chunks(8).enumerate() {
            let mut bytes = [u8::from(!value); 8];
            for (byte, &pixel) in bytes.iter_mut().zip(pixels) {
                *byte = u8::from(pixel);
            }
            // The product moves bit 0 of byte k to bit 56 + k.
            let bits = (u64::from_le_bytes(bytes) ^ flip).wrapping_mul(0x0102_0408_1020_4080);
            *word |= bits >> 56 << (8 * i);
        }
    }
}

/// Unpacks bits into the pixels of a row
fn unpack(words: &[u64], row: &mut [bool]) {
    for (pixels, word) in row.chunks_mut(WORD).zip(words) {
        for (pixels, byte) in pixels.chunks_mut(8).zip(word.to_le_bytes()) {
            // Byte k keeps bit k; adding 127 carries it to bit 7, and it is shifted to bit 0.
            let own = (u64::from(byte) * ONES) & 0x8040_2010_0804_0201;
            let set = (own + 127 * ONES) >> 7 & ONES;
            for (pixel, set) in pixels.iter_mut().zip(set.to_le_bytes()) {
                *pixel = set != 0;
            }
        }
    }
}

/// Adds a row of bits, padded by one word at both ends, shifted by 1 to 63 pixels to the left and to the right
fn add_shifted(row: &mut [u64], by: &[u64], pixels: usize) {
    let back = WORD - pixels;
    for (word, near) in row.iter_mut().zip(by.windows(3)) {
        *word |= near[1] << pixels | near[0] >> back | near[1] >> pixels | near[2] << back;
    }
}

/// Adds every pixel whose center is at most `radius` px from a pixel inside
///
/// A radius below one pixel, or NaN, changes nothing.
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
    // nothing changes beyond the radius of the disc
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
/// The image border does not count as outside. A radius below one pixel, or NaN, changes nothing.
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

/// Erodes, then dilates: removes parts that do not contain a disc of `radius` px
pub fn open(mask: &Mask, radius: f64) -> Mask {
    dilate(&erode(mask, radius), radius)
}

/// Dilates, then erodes: closes gaps that do not contain a disc of `radius` px
pub fn close(mask: &Mask, radius: f64) -> Mask {
    erode(&dilate(mask, radius), radius)
}

/// Connected components of a mask in run-length form; pixels that share an edge are connected
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Components {
    width: usize,
    height: usize,
    /// In reading order, from the top left
    runs: Vec<Run>,
    /// Area of each component in pixels; components are numbered in reading order of their first pixel
    pub areas: Vec<usize>,
}

/// A run of pixels of one component in one row
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run {
    row: usize,
    start: usize,
    end: usize,
    /// Index of the component
    component: usize,
}

impl Components {
    /// Returns the index of the largest component, the first of equals; `None` for an empty mask
    pub fn largest(&self) -> Option<usize> {
        let mut best: Option<usize> = None;
        for (i, &area) in self.areas.iter().enumerate() {
            if best.is_none_or(|b| area > self.areas[b]) {
                best = Some(i);
            }
        }
        best
    }

    /// Returns the mask of one component
    pub fn mask(&self, component: usize) -> Mask {
        let mut mask = Mask::filled(self.width, self.height, false);
        self.paint(&mut mask, true, |of| of == component);
        mask
    }

    /// Sets the pixels of the selected components to a value
    fn paint(&self, mask: &mut Mask, value: bool, which: impl Fn(usize) -> bool) {
        for run in self.runs.iter().filter(|run| which(run.component)) {
            mask.row_mut(run.row)[run.start..run.end].fill(value);
        }
    }

    /// Returns which components touch the border of the image
    fn reach_border(&self) -> Vec<bool> {
        let mut reach = vec![false; self.areas.len()];
        for run in &self.runs {
            let at_border = run.row == 0
                || run.row + 1 == self.height
                || run.start == 0
                || run.end == self.width;
            reach[run.component] |= at_border;
        }
        reach
    }
}

/// Finds the connected components of a mask; pixels that share an edge are connected
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, morphology::components};
/// let parts = components(&Mask::from_art("##.# #..# ..##"));
/// assert_eq!(parts.areas, [3, 4]);
/// assert_eq!(parts.mask(0).to_art(), "##..\n#...\n....\n");
/// ```
pub fn components(mask: &Mask) -> Components {
    components_of(mask, true)
}

/// Keeps only the largest component, the first of equals
pub fn largest_component(mask: &Mask) -> Mask {
    let parts = components(mask);
    match parts.largest() {
        Some(largest) if parts.areas.len() > 1 => parts.mask(largest),
        _ => mask.clone(),
    }
}

/// Fills holes of fewer than `area_px` pixels
///
/// A hole is a component of the outside, connected along pixel edges, that does not touch the image border.
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, morphology::fill_holes_below};
/// let mask = Mask::from_art("##### #.#.# ###.# #####");
/// assert_eq!(fill_holes_below(&mask, 2).to_art(), "#####\n###.#\n###.#\n#####\n");
/// ```
pub fn fill_holes_below(mask: &Mask, area_px: usize) -> Mask {
    let outside = components_of(mask, false);
    let reach_border = outside.reach_border();
    let mut filled = mask.clone();
    outside.paint(&mut filled, true, |hole| {
        outside.areas[hole] < area_px && !reach_border[hole]
    });
    filled
}

/// Returns the connected components of the pixels with a value
fn components_of(mask: &Mask, value: bool) -> Components {
    let (mut runs, parents) = connected_runs(mask, value);
    let mut areas: Vec<usize> = Vec::new();
    for i in 0..runs.len() {
        // A root precedes all other runs of its component.
        runs[i].component = if parents[i] == i {
            areas.push(0);
            areas.len() - 1
        } else {
            runs[parents[i]].component
        };
        areas[runs[i].component] += runs[i].end - runs[i].start;
    }
    Components {
        width: mask.width(),
        height: mask.height(),
        runs,
        areas,
    }
}

/// Returns all runs of a value, and for each the index of an earlier run of its component, or its own
fn connected_runs(mask: &Mask, value: bool) -> (Vec<Run>, Vec<usize>) {
    let (mut runs, mut parents): (Vec<Run>, Vec<usize>) = (Vec::new(), Vec::new());
    let mut above = 0..0;
    for y in 0..mask.height() {
        let row = mask.row(y);
        let first = runs.len();
        let mut end = 0;
        while end < row.len() {
            let start = end + run_length(&row[end..], !value);
            end = start + run_length(&row[start..], value);
            if start < end {
                parents.push(runs.len());
                runs.push(Run {
                    row: y,
                    start,
                    end,
                    component: 0,
                });
            }
        }
        let mut upper = above.start;
        for lower in first..runs.len() {
            while upper < above.end && runs[upper].end <= runs[lower].start {
                upper += 1;
            }
            let mut touching = upper;
            while touching < above.end && runs[touching].start < runs[lower].end {
                unite(&mut parents, touching, lower);
                touching += 1;
            }
        }
        above = first..runs.len();
    }
    (runs, parents)
}

fn unite(parents: &mut [usize], a: usize, b: usize) {
    let (a, b) = (find_and_shorten(parents, a), find_and_shorten(parents, b));
    // The earlier run is the root, so chains stay short and components follow the order of rows.
    parents[a.max(b)] = a.min(b);
}

fn find_and_shorten(parents: &mut [usize], mut i: usize) -> usize {
    while parents[i] != i {
        let grandparent = parents[parents[i]];
        parents[i] = grandparent;
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

    fn sparse_wide_masks() -> impl Strategy<Value = Mask> {
        (1usize..300, 1usize..5).prop_flat_map(|(width, height)| {
            prop::collection::vec(prop::bool::weighted(0.01), width * height)
                .prop_map(move |data| Mask::from_vec(width, height, data))
        })
    }

    fn dilate_reference(mask: &Mask, radius: f64) -> Mask {
        let radius = if radius < 1.0 { 0.0 } else { radius * ROUNDING };
        Mask::from_fn(mask.width(), mask.height(), |x, y| {
            (0..mask.height()).any(|v| {
                (0..mask.width()).any(|u| {
                    let squared = x.abs_diff(u).pow(2) + y.abs_diff(v).pow(2);
                    mask[(u, v)] && squared as f64 <= radius * radius
                })
            })
        })
    }

    /// Floods from every pixel without a component
    fn flooded(mask: &Mask) -> Vec<Mask> {
        let (width, height) = (mask.width(), mask.height());
        let mut left = mask.clone();
        let mut found = Vec::new();
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            if !left[(x, y)] {
                continue;
            }
            let mut component = Mask::filled(width, height, false);
            let mut stack = vec![(x as isize, y as isize)];
            while let Some((x, y)) = stack.pop() {
                if left.get(x, y) == Some(&true) {
                    let at = (x as usize, y as usize);
                    (left[at], component[at]) = (false, true);
                    stack.extend([(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)]);
                }
            }
            found.push(component);
        }
        found
    }

    fn fill_holes_reference(mask: &Mask, area_px: usize) -> Mask {
        let (width, height) = (mask.width(), mask.height());
        let mut filled = mask.clone();
        for hole in flooded(&mask.map(|&v| !v)) {
            let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
            let pixels: Vec<_> = pixels.filter(|&at| hole[at]).collect();
            let inner = |&(x, y): &(usize, usize)| {
                (1..width - 1).contains(&x) && (1..height - 1).contains(&y)
            };
            if pixels.len() < area_px && pixels.iter().all(inner) {
                pixels.into_iter().for_each(|at| filled[at] = true);
            }
        }
        filled
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
    fn empty_full_and_unusual_inputs_are_handled() {
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

    #[test]
    fn a_disc_contains_a_pixel_center_on_its_border_despite_rounding() {
        let mut mask = Mask::filled(40, 3, false);
        mask[(0, 0)] = true;
        for (radius, width) in [(27.999994, 29), (27.9999, 28), (28.0, 29), (0.9999999, 1)] {
            assert_eq!(dilate(&mask, radius), dilate_reference(&mask, radius));
            assert_eq!(
                dilate(&mask, radius).bounding_box().map(|b| b.2),
                Some(width)
            );
        }
    }

    #[test]
    fn the_largest_root_is_exact_where_the_square_root_rounds_up() {
        assert_eq!(25.0_f64.next_down().sqrt(), 5.0);
        assert_eq!(largest_root(25.0_f64.next_down()), 4);
        assert_eq!([-1.0, 0.0, 3.9, 25.0].map(largest_root), [0, 0, 1, 5]);
    }

    #[test]
    fn a_disc_larger_than_the_image_fills_it() {
        let mask = Mask::from_art("..#....");
        assert_eq!(dilate(&mask, 40.512523461695295), mask.map(|_| true));
    }

    proptest! {
        #[test]
        fn components_agree_with_flooding(mask in masks()) {
            let (found, expected) = (components(&mask), flooded(&mask));
            let areas: Vec<usize> = expected.iter().map(Mask::area).collect();
            prop_assert_eq!(&found.areas, &areas);
            for (i, component) in expected.into_iter().enumerate() {
                prop_assert_eq!(found.mask(i), component);
            }
        }

        #[test]
        fn holes_agree_with_flooding(mask in masks(), area_px in 0usize..9) {
            prop_assert_eq!(fill_holes_below(&mask, area_px), fill_holes_reference(&mask, area_px));
        }

        #[test]
        fn dilation_agrees_with_the_reference(mask in masks(), radius in 0.0..6.0f64, whole: bool) {
            let radius = if whole { radius.round() } else { radius };
            prop_assert_eq!(dilate(&mask, radius), dilate_reference(&mask, radius));
        }

        #[test]
        fn dilation_crosses_words(mask in sparse_wide_masks(), radius in 0.0..150.0f64) {
            prop_assert_eq!(dilate(&mask, radius), dilate_reference(&mask, radius));
        }

        #[test]
        fn erosion_is_dilation_of_the_outside(mask in masks(), radius in 0.0..6.0f64) {
            let outside = mask.map(|&v| !v);
            prop_assert_eq!(erode(&mask, radius), dilate(&outside, radius).map(|&v| !v));
        }
    }
}
