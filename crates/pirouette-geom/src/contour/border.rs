//! Border following: every outer border and every hole border of a mask, with their nesting.

use glam::DVec2;

use super::Contour;
use crate::Mask;

/// A followed border and the border around it
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    /// Its pixels, through their centers; the border of a hole consists of the pixels around the hole
    pub contour: Contour,
    /// Index of the directly enclosing border: the outer border of a hole, or the hole that an outer border lies in,
    /// if any
    pub parent: Option<usize>,
}

/// Traces all outer and hole borders of a mask, through the centers of the border pixels
///
/// Pixels that share an edge or a corner are connected. Every border pixel is a point; a one-pixel bridge is followed
/// along both of its sides, so its pixels occur twice, and a single pixel is a contour of one point. Shapes that touch
/// the image border are closed along it. Contours are in reading order of their first pixel.
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, contour::trace_contours};
/// let contours = trace_contours(&Mask::from_art("### #.# ###"));
/// assert_eq!(contours.len(), 2);
/// assert_eq!((contours[0].points.len(), contours[0].signed_area()), (8, 4.0));
/// assert_eq!((contours[1].points.len(), contours[1].signed_area()), (4, -2.0));
/// ```
pub fn trace_contours(mask: &Mask) -> Vec<Contour> {
    trace_borders(mask).into_iter().map(|b| b.contour).collect()
}

/// Traces all borders like [`trace_contours`], with the border that contains each
///
/// # Source
/// S. Suzuki, K. Abe 1985, "Topological structural analysis of digitized binary images by border
/// following", algorithm 1; in the opposite direction, so that outer borders have positive area.
pub fn trace_borders(mask: &Mask) -> Vec<Border> {
    let mut field = Field::new(mask);
    let mut borders: Vec<Border> = Vec::new();
    for y in 0..mask.height() {
        let row = (y + 1) * field.stride;
        let mut carried = 0;
        for block in (row..row + field.stride).step_by(BLOCK) {
            // Most blocks are all inside or all outside.
            if field.uniform(block, carried) {
                continue;
            }
            for word in (block..block + BLOCK).step_by(WORD) {
                let inside = field.inside_bits(word);
                let mut changes = inside ^ (inside << 8 | carried);
                carried = inside >> 56;
                while changes != 0 {
                    let at = word + changes.trailing_zeros() as usize / 8;
                    changes &= changes - 1;
                    // The first pixel of a run, or the first one behind it
                    let hole = field.labels[at] == 0;
                    let from = if hole { at - 1 } else { at };
                    let starts = if hole {
                        field.labels[from] & CLOSED == 0
                    } else {
                        field.labels[from] == UNVISITED
                    };
                    if !starts {
                        continue;
                    }
                    let parent = parent_of(&borders, field.border_before(from, row, y), hole);
                    let outside = if hole { at } else { at - 1 };
                    let points = field.follow(from, outside, borders.len() as u32);
                    borders.push(Border {
                        contour: Contour { points, hole },
                        parent,
                    });
                }
            }
        }
    }
    borders
}

/// Pixels of one word
const WORD: usize = 8;

/// Pixels of a block, which is tested as a unit
const BLOCK: usize = 4 * WORD;

/// Labels: outside is 0, and all pixels inside have this bit set
const UNVISITED: u8 = 1;
/// Passed by a border with inside on its right
const OPEN: u8 = 3;
/// Passed by a border with outside on its right: no hole border starts there
const CLOSED: u8 = 4;

/// Returns the parent of a new border, given the last border in its row (table 1 of the paper)
fn parent_of(borders: &[Border], last: Option<u32>, hole: bool) -> Option<usize> {
    let last = last? as usize;
    if borders[last].contour.hole == hole {
        borders[last].parent
    } else {
        Some(last)
    }
}

/// A border that passed a pixel
struct Mark {
    at: usize,
    border: u32,
    /// Index of the previous mark in the same row
    before: Option<u32>,
}

/// The mask with a frame of outside pixels, and labels of the borders that passed its pixels
///
/// One byte per pixel, for fast row scans. The index of a border is needed only for new borders and is stored in lists
/// per row.
struct Field {
    labels: Vec<u8>,
    /// Bytes per row: full blocks
    stride: usize,
    marks: Vec<Mark>,
    /// Last mark of each row
    last_mark: Vec<Option<u32>>,
    /// Offsets to the eight neighbors, clockwise on screen, starting at the right
    around: [isize; 8],
}

impl Field {
    fn new(mask: &Mask) -> Self {
        let stride = (mask.width() + 2).next_multiple_of(BLOCK);
        let mut labels = vec![0; stride * (mask.height() + 2)];
        for y in 0..mask.height() {
            let start = (y + 1) * stride + 1;
            let row = &mut labels[start..start + mask.width()];
            for (label, &inside) in row.iter_mut().zip(mask.row(y)) {
                *label = u8::from(inside);
            }
        }
        let w = stride as isize;
        Self {
            labels,
            stride,
            marks: Vec::new(),
            last_mark: vec![None; mask.height()],
            around: [1, w + 1, w, w - 1, -1, -w - 1, -w, -w + 1],
        }
    }

    /// Returns the lowest bit of the byte of each inside pixel of a word
    fn inside_bits(&self, word: usize) -> u64 {
        const LOWEST: u64 = u64::from_le_bytes([UNVISITED; WORD]);
        let mut bytes = [0; WORD];
        bytes.copy_from_slice(&self.labels[word..word + WORD]);
        u64::from_le_bytes(bytes) & LOWEST
    }

    /// Whether a block is all inside or all outside, like the pixel before it
    fn uniform(&self, block: usize, carried: u64) -> bool {
        let before = carried as u8;
        let labels = &self.labels[block..block + BLOCK];
        labels
            .iter()
            .fold(0, |odd, label| odd | (label & UNVISITED ^ before))
            == 0
    }

    /// Returns the border of the last marked pixel of a row, up to and including `at`
    fn border_before(&self, at: usize, row: usize, y: usize) -> Option<u32> {
        let labels = &self.labels[row..=at];
        let nearest = row + labels.iter().rposition(|&label| label > UNVISITED)?;
        let mut next = self.last_mark[y];
        loop {
            let mark = &self.marks[next? as usize];
            if mark.at == nearest {
                return Some(mark.border);
            }
            next = mark.before;
        }
    }

    fn mark(&mut self, at: usize, y: usize, label: u8, border: u32) {
        self.labels[at] = label;
        let last = &mut self.last_mark[y];
        let before = last.replace(self.marks.len() as u32);
        self.marks.push(Mark { at, border, before });
    }

    /// Follows the border between the pixels `start` and `outside`, and marks it
    fn follow(&mut self, start: usize, outside: usize, border: u32) -> Vec<DVec2> {
        let around = self.around;
        let neighbor = |at: usize, direction: usize| at.wrapping_add_signed(around[direction]);
        let (mut x, mut y) = (start % self.stride - 1, start / self.stride - 1);
        let center = |x: usize, y: usize| DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        let out_direction = if outside > start { RIGHT } else { LEFT };
        // Last pixel of the border: the first one inside when turning clockwise from outside
        let last_direction = (1..8)
            .map(|turn| (out_direction + turn) % 8)
            .find(|&d| self.labels[neighbor(start, d)] != 0);
        let Some(last_direction) = last_direction else {
            self.mark(start, y, OPEN | CLOSED, border);
            return vec![center(x, y)];
        };
        let mut points = Vec::new();
        let last = neighbor(start, last_direction);
        let mut at = start;
        let mut back = last_direction;
        loop {
            // Turn counterclockwise from the previous pixel to the next pixel inside
            let mut direction = back;
            let mut passed_right = false;
            let next = loop {
                direction = (direction + 7) % 8;
                let next = neighbor(at, direction);
                if self.labels[next] != 0 {
                    break next;
                }
                passed_right |= direction == RIGHT;
            };
            // Prevents the scan from starting on this border again
            if passed_right {
                self.mark(at, y, OPEN | CLOSED, border);
            } else if self.labels[at] == UNVISITED {
                self.mark(at, y, OPEN, border);
            }
            points.push(center(x, y));
            if next == start && at == last {
                break;
            }
            back = (direction + 4) % 8;
            at = next;
            x = x.wrapping_add_signed(STEPS[direction].0);
            y = y.wrapping_add_signed(STEPS[direction].1);
        }
        // The border was followed with outside on its right; contours have inside on theirs
        points[1..].reverse();
        points
    }
}

/// Steps to the eight neighbors, clockwise on screen, starting at the right
const STEPS: [(isize, isize); 8] = [
    (1, 0),
    (1, 1),
    (0, 1),
    (-1, 1),
    (-1, 0),
    (-1, -1),
    (0, -1),
    (1, -1),
];

const RIGHT: usize = 0;
const LEFT: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::morphology::components;
    use proptest::prelude::*;

    fn traced(art: &str) -> Vec<Border> {
        trace_borders(&Mask::from_art(art))
    }

    fn counts(art: &str) -> Vec<(usize, bool, Option<usize>)> {
        traced(art)
            .iter()
            .map(|b| (b.contour.points.len(), b.contour.hole, b.parent))
            .collect()
    }

    #[test]
    fn a_single_pixel_is_a_point() {
        let borders = traced("#");
        assert_eq!(borders[0].contour.points, [DVec2::new(0.5, 0.5)]);
        assert!(!borders[0].contour.hole);
    }

    #[test]
    fn full_masks_follow_the_image_border() {
        assert_eq!(counts("#### #### ####"), [(10, false, None)]);
        assert_eq!(counts("##"), [(2, false, None)]);
        assert_eq!(counts("...."), []);
        assert_eq!(trace_contours(&Mask::filled(0, 0, true)), []);
    }

    #[test]
    fn bridges_are_followed_on_both_sides() {
        assert_eq!(counts("##...## ####### ##...##"), [(16, false, None)]);
    }

    #[test]
    fn diagonal_touches_connect() {
        assert_eq!(counts("##.. ##.. ..## ..##"), [(10, false, None)]);
        assert_eq!(counts("#.# .#. #.#"), [(8, false, None)]);
    }

    #[test]
    fn shapes_nest() {
        let art = "####### #.....# #.###.# #.#.#.# #.###.# #.....# #######";
        let found = counts(art);
        assert_eq!(
            found,
            [
                (24, false, None),
                (20, true, Some(0)),
                (8, false, Some(1)),
                (4, true, Some(2)),
            ]
        );
    }

    #[test]
    fn two_holes_share_their_parent() {
        assert_eq!(
            counts("##### #.#.# #####"),
            [(12, false, None), (4, true, Some(0)), (4, true, Some(0))]
        );
    }

    proptest! {
        #[test]
        fn borders_bound_the_components(
            width in 1usize..12,
            height in 1usize..12,
            bits in prop::collection::vec(prop::bool::weighted(0.6), 144),
        ) {
            let mask = Mask::from_fn(width, height, |x, y| bits[y * 12 + x]);
            let borders = trace_borders(&mask);

            // One hole border per component of the outside, except the one outside of the image border: counted
            // with an additional ring of outside
            let ring = Mask::from_fn(width + 2, height + 2, |x, y| {
                mask.get(x as isize - 1, y as isize - 1) != Some(&true)
            });
            let holes = borders.iter().filter(|b| b.contour.hole).count();
            prop_assert_eq!(holes, components(&ring).areas.len() - 1);

            for (i, border) in borders.iter().enumerate() {
                let points = &border.contour.points;
                if border.contour.hole {
                    prop_assert!(border.contour.signed_area() < 0.0);
                    prop_assert!(!borders[border.parent.unwrap()].contour.hole);
                } else {
                    prop_assert!(border.contour.signed_area() >= 0.0);
                }
                prop_assert!(border.parent.is_none_or(|p| p < i && borders[p].contour.hole != border.contour.hole));
                for [a, b] in border.contour.edges() {
                    prop_assert!((a - b).abs().max_element() <= 1.0);
                }
                for p in points {
                    prop_assert!(mask[(p.x as usize, p.y as usize)]);
                }
            }

            // Exactly the inside pixels with an outside neighbor along an edge are on a border
            for y in 0..height {
                for x in 0..width {
                    let (i, j) = (x as isize, y as isize);
                    let inner = [(i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)]
                        .iter()
                        .all(|&(u, v)| mask.get(u, v) == Some(&true));
                    let center = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    let on_border = borders.iter().any(|b| b.contour.points.contains(&center));
                    prop_assert_eq!(on_border, mask[(x, y)] && !inner);
                }
            }
        }
    }
}
