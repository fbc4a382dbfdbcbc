//! Border following: every outer border and every hole border of a mask, with what contains what.

use glam::DVec2;

use super::Contour;
use crate::Mask;

/// A followed border and the border around it
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    /// Its pixels, through their centers; a hole's border runs on the pixels around the hole
    pub contour: Contour,
    /// Index of the border right around this one: of a hole its outer border, of an outer border the hole
    /// that it lies in, if any
    pub parent: Option<usize>,
}

/// Follows all outer and hole borders of a mask, through the centers of the border pixels
///
/// Pixels that share an edge or a corner are connected. Every border pixel is a point; a one-pixel bridge
/// is walked along both of its sides, so its pixels come twice, and a lone pixel is a contour of one point.
/// Shapes that touch the image border are closed along it. In the order in which rows from the top first
/// meet them.
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

/// Follows all borders as [`trace_contours`] does, and tells which border contains which
///
/// # Source
/// S. Suzuki, K. Abe 1985, "Topological structural analysis of digitized binary images by border
/// following", algorithm 1; walked the other way round, so that outer borders have positive area.
pub fn trace_borders(mask: &Mask) -> Vec<Border> {
    let mut field = Field::new(mask);
    let mut borders: Vec<Border> = Vec::new();
    for y in 1..=mask.height() {
        // The border met last in this row: its number, 1 is the frame of the image
        let mut last_border = FRAME;
        let row = y * field.width;
        let mut left = 0;
        for at in row + 1..row + field.width {
            let here = field.labels[at];
            if here == left {
                continue;
            }
            let start = if left == 0 && here == UNVISITED {
                Some((at, at - 1, false))
            } else if here == 0 && left >= UNVISITED {
                if left > UNVISITED {
                    last_border = left;
                }
                Some((at - 1, at, true))
            } else {
                None
            };
            if let Some((from, outside, hole)) = start {
                let parent = parent_of(&borders, last_border, hole);
                let number = borders.len() as i32 + FIRST_BORDER;
                let points = field.follow(from, outside, number);
                borders.push(Border {
                    contour: Contour { points, hole },
                    parent,
                });
            }
            // A new hole border may have marked the pixel on the left, a new outer border this one
            let here = field.labels[at];
            if here != 0 && here != UNVISITED {
                last_border = here.abs();
            } else if here == 0 && at > row + 1 {
                let marked = field.labels[at - 1];
                if marked != 0 && marked != UNVISITED {
                    last_border = marked.abs();
                }
            }
            left = here;
        }
    }
    borders
}

const UNVISITED: i32 = 1;
const FRAME: i32 = 1;
const FIRST_BORDER: i32 = 2;

/// Parent of a new border, given the number of the border met last (table 1 of the paper)
fn parent_of(borders: &[Border], last_border: i32, hole: bool) -> Option<usize> {
    let last = usize::try_from(last_border - FIRST_BORDER).ok()?;
    let border = borders.get(last)?;
    if border.contour.hole == hole {
        border.parent
    } else {
        Some(last)
    }
}

/// The mask with a frame of one pixel, and on its border pixels the number of the border that passed
struct Field {
    labels: Vec<i32>,
    width: usize,
    /// Offsets to the eight neighbors, clockwise on screen, starting to the right
    around: [isize; 8],
}

impl Field {
    fn new(mask: &Mask) -> Self {
        let width = mask.width() + 2;
        let mut labels = vec![0; width * (mask.height() + 2)];
        for y in 0..mask.height() {
            let start = (y + 1) * width + 1;
            let row = &mut labels[start..start + mask.width()];
            for (label, &inside) in row.iter_mut().zip(mask.row(y)) {
                *label = i32::from(inside);
            }
        }
        let w = width as isize;
        Self {
            labels,
            width,
            around: [1, w + 1, w, w - 1, -1, -w - 1, -w, -w + 1],
        }
    }

    /// Follows the border that passes between the pixels `start` and `outside`, and marks it
    fn follow(&mut self, start: usize, outside: usize, number: i32) -> Vec<DVec2> {
        let mut points = Vec::new();
        let neighbor = |at: usize, direction: usize| at.wrapping_add_signed(self.around[direction]);
        let out_direction = if outside > start { RIGHT } else { LEFT };
        // The last pixel of the walk: the first one met turning clockwise from outside
        let last_direction = (1..8)
            .map(|turn| (out_direction + turn) % 8)
            .find(|&d| self.labels[neighbor(start, d)] != 0);
        let Some(last_direction) = last_direction else {
            self.labels[start] = -number;
            return vec![self.center(start)];
        };
        let last = neighbor(start, last_direction);
        let mut at = start;
        let mut back = last_direction;
        loop {
            // Turn counterclockwise from where we came to the next pixel inside
            let mut direction = back;
            let mut passed_right = false;
            let next = loop {
                direction = (direction + 7) % 8;
                let next = at.wrapping_add_signed(self.around[direction]);
                if self.labels[next] != 0 {
                    break next;
                }
                passed_right |= direction == RIGHT;
            };
            // The scan must not start on this border again: negative where outside is on its right
            if passed_right {
                self.labels[at] = -number;
            } else if self.labels[at] == UNVISITED {
                self.labels[at] = number;
            }
            points.push(self.center(at));
            if next == start && at == last {
                break;
            }
            back = (direction + 4) % 8;
            at = next;
        }
        // The walk keeps outside on its right; contours have inside on theirs
        points[1..].reverse();
        points
    }

    fn center(&self, at: usize) -> DVec2 {
        let (x, y) = (at % self.width, at / self.width);
        DVec2::new(x as f64 - 0.5, y as f64 - 0.5)
    }
}

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
    fn a_lone_pixel_is_a_point() {
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
    fn bridges_are_walked_on_both_sides() {
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

            // One hole border per part of the outside that does not reach the image border: seen with one
            // more ring of outside, all parts but one
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

            // Every pixel inside with an outside neighbor along an edge is on a border, no other is
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
