//! Marching squares: the loops at a level of a smooth raster, between the pixels.

use glam::DVec2;

use super::Contour;
use crate::{Grid, Windowed};

/// Minimum distance of loop points from pixel centers, in px
///
/// A value exactly at the level would otherwise put several points on one pixel center, where loops would touch.
const MIN_OFFSET: f64 = 1.0 / 1024.0;

/// Value of the ring around the image: outside for every level
const BEYOND: f32 = f32::NEG_INFINITY;

/// Traces the loops between values of at least `level` (inside) and values below (outside)
///
/// Values belong to pixel centers and change linearly between neighbors. Shapes that reach the image border are
/// closed along it. Where two shapes meet corner to corner, they are joined if the mean of the four values is inside.
/// NaN is outside. Loops are simple and never touch each other; outer loops and holes alternate from the outside in.
/// Loops are in reading order of their first pixel. For the coverage of a polygon, the outline at 0.5 stays within
/// 0.1 px of smooth parts, without bias.
///
/// # Source
/// W. Lorensen, H. Cline 1987, "Marching cubes", in the plane; G. Nielson, B. Hamann 1991, "The asymptotic
/// decider", for the corner to corner case, with the mean instead of the saddle value.
///
/// # Examples
/// ```
/// use pirouette_geom::{Grid, contour::trace_outline};
/// let coverage = Grid::from_vec(3, 1, vec![1.0, 1.0, 0.25]);
/// let outline = trace_outline(&coverage, 0.5);
/// let right = outline[0].points.iter().map(|p| p.x).fold(0.0, f64::max);
/// assert!((right - (1.5 + 0.5 / 0.75)).abs() < 1e-6);
/// ```
pub fn trace_outline(values: &Grid<f32>, level: f32) -> Vec<Contour> {
    trace_part(values, (0, 0), level)
}

/// Like [`trace_outline`], for a raster stored as a window; the level must be above zero, as zeros are outside
pub fn trace_windowed(values: &Windowed<f32>, level: f32) -> Vec<Contour> {
    debug_assert!(level > 0.0, "values beyond the window are outside");
    trace_part(values.window(), values.corner(), level)
}

fn trace_part(values: &Grid<f32>, corner: (usize, usize), level: f32) -> Vec<Contour> {
    let field = Field::new(values, corner, level);
    let mut visited = vec![false; field.values.len()];
    let mut loops = Vec::new();
    for y in 1..=values.height() {
        let row = y * field.width;
        let mut left_inside = false;
        for at in row + 1..row + field.width {
            let inside = field.inside(at);
            // Every loop crosses somewhere from outside on the left to inside on the right
            if inside && !left_inside && !visited[at] {
                loops.push(field.follow(at, &mut visited));
            }
            left_inside = inside;
        }
    }
    loops
}

/// The raster with a ring of outside pixels
struct Field {
    values: Vec<f32>,
    width: usize,
    /// Column and row at which the raster starts
    corner: (usize, usize),
    level: f32,
    /// Offsets right, down, left, up: each a clockwise quarter turn on screen from the previous
    steps: [isize; 4],
}

const LEFT: usize = 2;

impl Field {
    fn new(grid: &Grid<f32>, corner: (usize, usize), level: f32) -> Self {
        let width = grid.width() + 2;
        let mut values = vec![BEYOND; width * (grid.height() + 2)];
        for y in 0..grid.height() {
            let start = (y + 1) * width + 1;
            values[start..start + grid.width()].copy_from_slice(grid.row(y));
        }
        let w = width as isize;
        Self {
            values,
            width,
            corner,
            level,
            steps: [1, w, -1, -w],
        }
    }

    fn inside(&self, at: usize) -> bool {
        // The ring is outside even at a level of minus infinity
        self.values[at] >= self.level && self.values[at] > BEYOND
    }

    /// Follows one loop with inside on its right, from the crossing left of `start`
    fn follow(&self, start: usize, visited: &mut [bool]) -> Contour {
        let mut points = Vec::new();
        // The crossing between the pixel `inner` and its neighbor in direction `out`
        let (mut inner, mut out) = (start, LEFT);
        loop {
            if out == LEFT {
                visited[inner] = true;
            }
            let outer = self.neighbor(inner, out);
            points.push(self.crossing(inner, outer));
            // Outside is on the left, so ahead is a clockwise turn from it
            let ahead = (out + 1) % 4;
            let inner_ahead = self.neighbor(inner, ahead);
            let outer_ahead = self.neighbor(outer, ahead);
            match (self.inside(inner_ahead), self.inside(outer_ahead)) {
                (true, false) => inner = inner_ahead,
                (true, true) => (inner, out) = (outer_ahead, (out + 3) % 4),
                (false, true) if self.joins([inner, outer, inner_ahead, outer_ahead]) => {
                    (inner, out) = (outer_ahead, (out + 3) % 4);
                }
                (false, _) => out = ahead,
            }
            if (inner, out) == (start, LEFT) {
                break;
            }
        }
        let mut contour = Contour {
            points,
            hole: false,
        };
        contour.hole = contour.signed_area() < 0.0;
        contour
    }

    fn neighbor(&self, at: usize, direction: usize) -> usize {
        at.wrapping_add_signed(self.steps[direction])
    }

    /// Whether the diagonally opposite inside pixels of four are connected
    fn joins(&self, four: [usize; 4]) -> bool {
        let sum: f64 = four.iter().map(|&at| f64::from(self.values[at])).sum();
        0.25 * sum >= f64::from(self.level)
    }

    /// Returns where the values cross the level between two neighbors; half way if they are not finite
    fn crossing(&self, inner: usize, outer: usize) -> DVec2 {
        let inside = f64::from(self.values[inner]);
        let outside = f64::from(self.values[outer]);
        let t = (inside - f64::from(self.level)) / (inside - outside);
        let finite = inside.is_finite() && outside.is_finite();
        let t = if finite {
            t.clamp(MIN_OFFSET, 1.0 - MIN_OFFSET)
        } else {
            0.5
        };
        self.center(inner).lerp(self.center(outer), t)
    }

    fn center(&self, at: usize) -> DVec2 {
        let (x, y) = (at % self.width, at / self.width);
        let (x0, y0) = self.corner;
        DVec2::new((x0 + x) as f64 - 0.5, (y0 + y) as f64 - 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mask;
    use crate::coverage::fill_polygons;
    use proptest::prelude::*;

    fn outline_of(art: &str) -> Vec<Contour> {
        trace_outline(&Mask::from_art(art).map(|&v| f32::from(u8::from(v))), 0.5)
    }

    #[test]
    fn a_full_image_is_closed_along_its_border() {
        let outline = outline_of("### ###");
        assert_eq!(outline.len(), 1);
        // The full image except its four corners
        assert!((outline[0].signed_area() - (6.0 - 4.0 / 8.0)).abs() < 1e-9);
        for p in &outline[0].points {
            assert!(p.x == 0.0 || p.x == 3.0 || p.y == 0.0 || p.y == 2.0);
        }
    }

    #[test]
    fn a_single_pixel_is_a_diamond() {
        let outline = outline_of("#");
        assert_eq!(outline[0].points.len(), 4);
        assert_eq!(outline[0].signed_area(), 0.5);
    }

    #[test]
    fn holes_are_negative() {
        let outline = outline_of("..... .###. .#.#. .###. .....");
        assert_eq!(outline.len(), 2);
        assert!(outline[0].signed_area() > 0.0 && !outline[0].hole);
        assert!(outline[1].signed_area() < 0.0 && outline[1].hole);
    }

    #[test]
    fn corners_are_joined_according_to_the_mean() {
        let at = |v: f32| Grid::from_vec(2, 2, vec![1.0, v, v, 1.0]);
        assert_eq!(trace_outline(&at(0.1), 0.5).len(), 1);
        assert_eq!(trace_outline(&at(-0.1), 0.5).len(), 2);
    }

    #[test]
    fn the_outline_of_a_filled_polygon_is_that_polygon() {
        let disc: Vec<DVec2> = (0..90)
            .map(|i| DVec2::from_angle(i as f64 * std::f64::consts::TAU / 90.0))
            .map(|d| DVec2::new(20.3, 19.6) + 14.0 * d)
            .collect();
        let outline = trace_outline(&fill_polygons(40, 40, &[disc]), 0.5);
        assert_eq!(outline.len(), 1);
        for p in &outline[0].points {
            let radius = p.distance(DVec2::new(20.3, 19.6));
            assert!((radius - 14.0).abs() < 0.12, "{radius}");
        }
        let radius = (outline[0].signed_area() / std::f64::consts::PI).sqrt();
        assert!((radius - 14.0).abs() < 0.03, "{radius}");
    }

    #[test]
    fn non_finite_values_give_closed_loops_or_none() {
        let odd = Grid::from_vec(
            3,
            2,
            vec![
                f32::NAN,
                1.0,
                f32::INFINITY,
                f32::NEG_INFINITY,
                0.5,
                f32::NAN,
            ],
        );
        for level in [0.5, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for found in trace_outline(&odd, level) {
                assert!(found.points.iter().all(|p| p.is_finite()));
            }
        }
        assert!(trace_outline(&Grid::filled(0, 0, 1.0), 0.5).is_empty());
        assert!(trace_outline(&Grid::filled(3, 3, 0.0), 0.5).is_empty());
    }

    /// Number of loops that enclose a point, minus holes
    fn winding(loops: &[Contour], point: DVec2) -> i32 {
        loops
            .iter()
            .filter(|c| c.contains(point))
            .map(|c| if c.hole { -1 } else { 1 })
            .sum()
    }

    proptest! {
        #[test]
        fn loops_enclose_exactly_the_inside_and_are_simple(
            width in 1usize..9,
            height in 1usize..9,
            values in prop::collection::vec(prop_oneof![Just(0.5f32), Just(0.0), Just(1.0), 0.0..1.0f32], 81),
        ) {
            let grid = Grid::from_fn(width, height, |x, y| values[y * 9 + x]);
            let loops = trace_outline(&grid, 0.5);
            prop_assert_eq!(&trace_windowed(&Windowed::new(&grid), 0.5), &loops);
            // The same, shifted into a larger image
            let around = |left: usize, up: usize| Grid::from_fn(width + 7, height + 7, |x, y| {
                let at = (x.wrapping_sub(left) as isize, y.wrapping_sub(up) as isize);
                grid.get(at.0, at.1).copied().unwrap_or(0.0)
            });
            for larger in [around(0, 4), around(5, 3)] {
                prop_assert_eq!(trace_windowed(&Windowed::new(&larger), 0.5), trace_outline(&larger, 0.5));
            }
            for y in 0..height {
                for x in 0..width {
                    let center = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    prop_assert_eq!(winding(&loops, center), i32::from(grid[(x, y)] >= 0.5));
                }
            }
            // No point occurs twice: loops touch neither themselves nor each other
            let mut points: Vec<(u64, u64)> = loops
                .iter()
                .flat_map(|c| c.points.iter().map(|p| (p.x.to_bits(), p.y.to_bits())))
                .collect();
            points.sort_unstable();
            let count = points.len();
            points.dedup();
            prop_assert_eq!(points.len(), count);
            for c in &loops {
                prop_assert!(c.points.len() >= 4);
                prop_assert!(c.signed_area() != 0.0);
            }
        }
    }
}
