//! Antialiased coverage of polygons: the covered fraction of each pixel.
//!
//! Inside is where the winding number is not zero, so overlapping loops of one orientation merge and
//! loops of the other orientation cut holes. Each pixel row is split into slabs, at multiples of 1/16 px and at every
//! vertex; within a slab the spans between crossings are exact horizontally. The area of the coverage is
//! therefore the area of the polygon, except in slabs in which edges cross each other.

use glam::DVec2;

use crate::{Grid, Mask};

/// Equal slabs per pixel row
///
/// With fewer, nearly horizontal edges show stairs; more only cost time: at 16 the stairs are 1/16 of the gray
/// range, too small to affect an outline at half coverage.
const SLABS_PER_ROW: usize = 16;

/// Minimum height of slabs that are split at vertices, in px
///
/// Bounds the work where thousands of vertices share a row; the error in area is at most this times the length of
/// a horizontal edge.
const MIN_SLAB_PX: f64 = 1.0 / 512.0;

/// Coverage within this distance of 0 or 1 is rounded to 0 or 1
const ROUNDING: f64 = 1e-9;

/// A directed edge, stored from its upper to its lower end
struct Edge {
    top: f64,
    bottom: f64,
    x_at_top: f64,
    dx_dy: f64,
    /// +1 when the given edge points down, -1 when it points up
    winding: i32,
    /// x of its crossing with the current slab
    x: f64,
}

/// Fills the region enclosed by directed edges, as coverage from 0 to 1 per pixel
///
/// The edges are in pixels and in any order, but together they form closed loops; loops may leave the grid on any
/// side. Loops that are open to the right are not filled there. Edges with non-finite coordinates are ignored.
///
/// # Examples
/// ```
/// use glam::DVec2;
/// use pirouette_geom::coverage::fill_edges;
/// let p = [DVec2::new(0.5, 0.0), DVec2::new(2.0, 0.0), DVec2::new(2.0, 1.0), DVec2::new(0.5, 1.0)];
/// let grid = fill_edges(3, 1, &[[p[0], p[1]], [p[1], p[2]], [p[2], p[3]], [p[3], p[0]]]);
/// assert_eq!(grid.as_slice(), &[0.5, 1.0, 0.0]);
/// ```
pub fn fill_edges(width: usize, height: usize, edges: &[[DVec2; 2]]) -> Grid<f32> {
    let mut grid = Grid::filled(width, height, 0f32);
    if width == 0 || height == 0 {
        return grid;
    }
    let (edges, starts) = sort_edges(height, edges);

    let mut active: Vec<Edge> = Vec::new();
    let mut waiting = edges.into_iter();
    let mut cuts: Vec<f64> = Vec::new();
    let mut crossings: Vec<(f64, i32)> = Vec::new();
    // Differences of coverage between neighboring pixels; two entries more than the row, so that a step at the
    // right border needs no special case
    let mut steps = vec![0f64; width + 2];

    for (y, &start_count) in starts.iter().enumerate() {
        active.extend(waiting.by_ref().take(start_count));
        let mut in_order = start_count == 0;
        if active.is_empty() {
            continue;
        }
        let row_top = y as f64;
        let row_bottom = row_top + 1.0;
        cut_row(row_top, &active, &mut cuts);

        let (mut first, mut last) = (width, 0);
        for slab in cuts.windows(2) {
            let middle = 0.5 * (slab[0] + slab[1]);
            crossings.clear();
            for edge in &mut active {
                edge.x = edge.x_at_top + (middle - edge.top) * edge.dx_dy;
            }
            // The order of edges hardly changes between slabs, so insertion sort is nearly free; new edges are merged
            // in first.
            if in_order {
                insertion_sort(&mut active);
            } else {
                active.sort_by(|a, b| a.x.total_cmp(&b.x));
                in_order = true;
            }
            crossings.extend(
                active
                    .iter()
                    .filter(|edge| edge.top <= middle && middle < edge.bottom)
                    .map(|edge| (edge.x, edge.winding)),
            );
            let mut winding = 0;
            let mut span_start = 0.0;
            for &(x, turn) in &crossings {
                let before = winding;
                winding += turn;
                if before == 0 {
                    span_start = x;
                } else if winding == 0 {
                    let from = span_start.clamp(0.0, width as f64);
                    let to = x.clamp(0.0, width as f64);
                    if from < to {
                        add_step(&mut steps, from, slab[1] - slab[0]);
                        add_step(&mut steps, to, slab[0] - slab[1]);
                        first = first.min(from as usize);
                        last = last.max(to as usize + 1);
                    }
                }
            }
        }
        if first <= last {
            let mut coverage = 0.0;
            let row = grid.row_mut(y);
            for (x, step) in steps[first..=last].iter_mut().enumerate() {
                coverage += std::mem::take(step);
                if let Some(pixel) = row.get_mut(first + x) {
                    *pixel = if coverage < ROUNDING {
                        0.0
                    } else if coverage > 1.0 - ROUNDING {
                        1.0
                    } else {
                        coverage as f32
                    };
                }
            }
        }
        active.retain(|edge| edge.bottom > row_bottom);
    }
    grid
}

/// Fills closed polygons, as coverage from 0 to 1 per pixel
///
/// The last point of each polygon joins the first. Nonzero winding over all polygons together: holes need the
/// opposite orientation. Polygons with a non-finite coordinate are ignored.
pub fn fill_polygons(width: usize, height: usize, polygons: &[Vec<DVec2>]) -> Grid<f32> {
    let mut edges = Vec::with_capacity(polygons.iter().map(Vec::len).sum());
    for polygon in polygons {
        if polygon.iter().all(|p| p.is_finite()) {
            let ends = polygon.iter().cycle().skip(1);
            edges.extend(polygon.iter().zip(ends).map(|(&a, &b)| [a, b]));
        }
    }
    fill_edges(width, height, &edges)
}

/// Returns the mask of pixels whose centers lie inside closed polygons
///
/// Winding and ignored polygons as in [`fill_polygons`].
///
/// # Examples
/// ```
/// use glam::DVec2;
/// use pirouette_geom::coverage::mask_of_polygons;
/// let triangle = vec![DVec2::ZERO, DVec2::new(4.0, 0.0), DVec2::new(0.0, 4.0)];
/// assert_eq!(mask_of_polygons(4, 3, &[triangle]).to_art(), "###.\n##..\n#...\n");
/// ```
pub fn mask_of_polygons(width: usize, height: usize, polygons: &[Vec<DVec2>]) -> Mask {
    let mut crossings: Vec<Vec<(f64, i32)>> = vec![Vec::new(); height];
    for polygon in polygons {
        if !polygon.iter().all(|p| p.is_finite()) {
            continue;
        }
        for (&a, &b) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
            let (top, bottom, winding) = if a.y < b.y { (a, b, 1) } else { (b, a, -1) };
            // Rows whose centers lie between the upper end, inclusive, and the lower end
            let first = (top.y - 0.5).ceil().clamp(0.0, height as f64) as usize;
            let end = (bottom.y - 0.5).ceil().clamp(0.0, height as f64) as usize;
            for (y, row) in crossings.iter_mut().enumerate().take(end).skip(first) {
                let t = (y as f64 + 0.5 - top.y) / (bottom.y - top.y);
                row.push((top.x + t * (bottom.x - top.x), winding));
            }
        }
    }
    let mut mask = Mask::filled(width, height, false);
    for (y, row) in crossings.iter_mut().enumerate() {
        row.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut winding = 0;
        for ends in row.windows(2) {
            winding += ends[0].1;
            if winding != 0 {
                let column = |x: f64| (x - 0.5).ceil().clamp(0.0, width as f64) as usize;
                let (first, end) = (column(ends[0].0), column(ends[1].0));
                mask.row_mut(y)[first..end.max(first)].fill(true);
            }
        }
    }
    mask
}

/// Returns the edges that touch the rows of the grid, sorted by their first row, and how many start in each row
fn sort_edges(height: usize, edges: &[[DVec2; 2]]) -> (Vec<Edge>, Vec<usize>) {
    let mut starts = vec![0; height];
    let mut sorted: Vec<Edge> = Vec::with_capacity(edges.len());
    for &[a, b] in edges {
        if !(a.is_finite() && b.is_finite()) {
            continue;
        }
        let (top, bottom, winding) = if a.y < b.y { (a, b, 1) } else { (b, a, -1) };
        let dx_dy = (bottom.x - top.x) / (bottom.y - top.y);
        // Rejects non-finite and horizontal edges, and those too flat for a defined crossing
        if bottom.y <= 0.0 || top.y >= height as f64 || !dx_dy.is_finite() {
            continue;
        }
        starts[first_row(top.y)] += 1;
        sorted.push(Edge {
            top: top.y,
            bottom: bottom.y,
            x_at_top: top.x,
            dx_dy,
            winding,
            x: top.x,
        });
    }
    sorted.sort_by_key(|edge| first_row(edge.top));
    (sorted, starts)
}

/// Returns the first row of the grid that an edge reaches, given its upper end
fn first_row(top: f64) -> usize {
    top.max(0.0) as usize
}

/// Computes the borders of the slabs of one row, from top to bottom
fn cut_row(row_top: f64, active: &[Edge], cuts: &mut Vec<f64>) {
    let inside = |y: f64| y > row_top && y < row_top + 1.0;
    cuts.clear();
    cuts.extend((0..=SLABS_PER_ROW).map(|i| row_top + i as f64 / SLABS_PER_ROW as f64));
    let even = cuts.len();
    for edge in active {
        cuts.extend([edge.top, edge.bottom].into_iter().filter(|&y| inside(y)));
    }
    if cuts.len() > even {
        let row_bottom = row_top + 1.0;
        cuts.sort_unstable_by(f64::total_cmp);
        cuts.dedup_by(|next, kept| *next - *kept < MIN_SLAB_PX);
        // The bottom of the row is always a border
        if let Some(end) = cuts.last_mut() {
            *end = row_bottom;
        }
    }
}

fn insertion_sort(edges: &mut [Edge]) {
    for i in 1..edges.len() {
        let mut j = i;
        while j > 0 && edges[j - 1].x > edges[j].x {
            edges.swap(j - 1, j);
            j -= 1;
        }
    }
}

/// Adds `amount` to the coverage right of `x`
fn add_step(steps: &mut [f64], x: f64, amount: f64) {
    let pixel = x as usize;
    let fraction = x - pixel as f64;
    steps[pixel] += amount * (1.0 - fraction);
    steps[pixel + 1] += amount * fraction;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rectangle(x0: f64, y0: f64, x1: f64, y1: f64) -> Vec<DVec2> {
        vec![
            DVec2::new(x0, y0),
            DVec2::new(x1, y0),
            DVec2::new(x1, y1),
            DVec2::new(x0, y1),
        ]
    }

    fn total(grid: &Grid<f32>) -> f64 {
        grid.as_slice().iter().map(|&v| f64::from(v)).sum()
    }

    fn area(polygon: &[DVec2]) -> f64 {
        let next = polygon.iter().cycle().skip(1);
        0.5 * polygon
            .iter()
            .zip(next)
            .map(|(a, b)| a.perp_dot(*b))
            .sum::<f64>()
    }

    /// Points in angular order on an ellipse, hence convex
    fn convex_polygon() -> impl Strategy<Value = Vec<DVec2>> {
        (
            prop::collection::vec(0.0..std::f64::consts::TAU, 3..12),
            8.0..18.0f64,
            8.0..18.0f64,
            0.0..3.0f64,
        )
            .prop_map(|(mut angles, a, b, turn)| {
                angles.sort_by(f64::total_cmp);
                let turn = DVec2::from_angle(turn);
                angles
                    .iter()
                    .map(|&t| {
                        DVec2::new(20.3, 19.8) + turn.rotate(DVec2::new(a * t.cos(), b * t.sin()))
                    })
                    .collect()
            })
    }

    /// Samples of the reference along each side of a pixel
    const SAMPLES: usize = 32;

    /// Largest error of the reference at a pixel: each edge may have one line of samples on the wrong side
    fn sampling_error(x: usize, y: usize, polygons: &[Vec<DVec2>]) -> f32 {
        let (low, high) = (
            DVec2::new(x as f64, y as f64),
            DVec2::new(x as f64 + 1.0, y as f64 + 1.0),
        );
        let edges = polygons.iter().flat_map(|polygon| {
            let next = polygon.iter().cycle().skip(1);
            polygon.iter().zip(next)
        });
        let near =
            edges.filter(|(a, b)| a.min(**b).cmple(high).all() && a.max(**b).cmpge(low).all());
        0.03 + near.count() as f32 / SAMPLES as f32
    }

    /// Coverage from 32 x 32 samples of the winding number per pixel
    fn fill_reference(width: usize, height: usize, polygons: &[Vec<DVec2>]) -> Grid<f32> {
        let winding = |p: DVec2| -> i32 {
            let mut winding = 0;
            for polygon in polygons {
                for (i, &a) in polygon.iter().enumerate() {
                    let b = polygon[(i + 1) % polygon.len()];
                    if (a.y <= p.y) != (b.y <= p.y) {
                        let x = a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x);
                        if x < p.x {
                            winding += if a.y < b.y { 1 } else { -1 };
                        }
                    }
                }
            }
            winding
        };
        Grid::from_fn(width, height, |x, y| {
            let mut inside = 0;
            for j in 0..SAMPLES {
                for i in 0..SAMPLES {
                    let at = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
                    let p = DVec2::new(x as f64 + at(i), y as f64 + at(j));
                    inside += usize::from(winding(p) != 0);
                }
            }
            inside as f32 / (SAMPLES * SAMPLES) as f32
        })
    }

    #[test]
    fn half_covered_pixels_are_exact() {
        let grid = fill_polygons(4, 4, &[rectangle(0.5, 1.0, 3.0, 2.5)]);
        let expected = [
            0.0, 0.0, 0.0, 0.0, //
            0.5, 1.0, 1.0, 0.0, //
            0.25, 0.5, 0.5, 0.0, //
            0.0, 0.0, 0.0, 0.0,
        ];
        assert_eq!(grid.as_slice(), &expected);
    }

    #[test]
    fn a_diagonal_halves_its_pixels() {
        let triangle = vec![DVec2::ZERO, DVec2::new(3.0, 3.0), DVec2::new(0.0, 3.0)];
        let grid = fill_polygons(3, 3, &[triangle]);
        for i in 0..3 {
            assert!((grid[(i, i)] - 0.5).abs() < 1e-6);
        }
        assert_eq!(grid[(0, 2)], 1.0);
        assert_eq!(grid[(2, 0)], 0.0);
    }

    #[test]
    fn loops_beyond_the_grid_are_counted() {
        for outside in [
            rectangle(-50.0, -50.0, 60.0, 60.0),
            rectangle(-1e9, -1e9, 1e9, 1e9),
        ] {
            let grid = fill_polygons(5, 4, &[outside]);
            assert!(grid.as_slice().iter().all(|&v| v == 1.0));
        }
        let left = fill_polygons(5, 4, &[rectangle(-8.0, 0.0, 2.5, 2.0)]);
        assert!((total(&left) - 5.0).abs() < 1e-6);
        let beside = fill_polygons(5, 4, &[rectangle(-8.0, 0.0, -2.5, 2.0)]);
        assert_eq!(total(&beside), 0.0);
        let right = fill_polygons(5, 4, &[rectangle(4.25, -3.0, 9.0, 12.0)]);
        assert!((total(&right) - 3.0).abs() < 1e-6);
    }

    #[test]
    fn overlaps_count_once_and_holes_are_cut() {
        let twice = [rectangle(1.0, 1.0, 3.5, 3.0), rectangle(2.0, 2.0, 4.5, 3.5)];
        assert!((total(&fill_polygons(6, 6, &twice)) - (5.0 + 3.75 - 1.5)).abs() < 1e-5);
        let mut hole = rectangle(1.5, 1.5, 3.25, 3.0);
        hole.reverse();
        let ring = [rectangle(0.0, 0.0, 5.0, 5.0), hole];
        assert!((total(&fill_polygons(6, 6, &ring)) - (25.0 - 2.625)).abs() < 1e-5);
    }

    #[test]
    fn non_finite_input_fills_nothing_and_never_panics() {
        let nan = vec![
            DVec2::NAN,
            DVec2::new(3.0, 0.0),
            DVec2::new(3.0, f64::INFINITY),
        ];
        assert_eq!(total(&fill_polygons(3, 3, std::slice::from_ref(&nan))), 0.0);
        assert_eq!(mask_of_polygons(3, 3, &[nan, vec![DVec2::ONE]]).area(), 0);
        assert_eq!(
            mask_of_polygons(0, 0, &[rectangle(0.0, 0.0, 1.0, 1.0)]).area(),
            0
        );
        assert_eq!(
            total(&fill_polygons(3, 3, &[vec![], vec![DVec2::ONE]])),
            0.0
        );
        assert_eq!(
            fill_polygons(0, 3, &[rectangle(0.0, 0.0, 1.0, 1.0)]).width(),
            0
        );
        let open = [[DVec2::new(1.0, 0.0), DVec2::new(1.0, 3.0)]];
        assert_eq!(total(&fill_edges(3, 3, &open)), 0.0);
        let huge = vec![
            DVec2::new(-f64::MAX, -f64::MAX),
            DVec2::new(f64::MAX, 1.0),
            DVec2::new(0.0, f64::MAX),
        ];
        let grid = fill_polygons(3, 3, &[huge]);
        assert!(grid.as_slice().iter().all(|v| (0.0..=1.0).contains(v)));
    }

    /// Bound on the area that slabs of minimum height add or omit
    fn unsplit_area(polygon: &[DVec2]) -> f64 {
        let xs = polygon.iter().map(|p| p.x);
        let (low, high) = xs.fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x), h.max(x)));
        MIN_SLAB_PX * (high - low).max(0.0)
    }

    #[test]
    fn a_long_edge_within_one_slab_changes_the_area_by_at_most_the_slab() {
        let polygon = [
            DVec2::new(29.847_065_766_439_908, 28.169_890_242_805_57),
            DVec2::new(28.021_407_226_948_71, 29.107_596_707_007_847),
            DVec2::new(12.944_021_300_676_587, 29.108_781_949_335_15),
        ];
        let filled = total(&fill_polygons(40, 40, &[polygon.to_vec()]));
        let error = (filled - area(&polygon)).abs();
        assert!(error > 1e-3 * area(&polygon), "{error}");
        assert!(error <= unsplit_area(&polygon), "{error}");
    }

    #[test]
    fn a_sliver_between_two_lines_of_samples_agrees_within_both() {
        let sliver = [(10.5, 1.3455), (-0.4939, 1.4447), (-2.3361, 1.2322)];
        let sliver = vec![sliver.map(|(x, y)| DVec2::new(x, y)).to_vec()];
        let (fast, slow) = (fill_polygons(8, 8, &sliver), fill_reference(8, 8, &sliver));
        for (x, y) in (0..8).flat_map(|y| (0..8).map(move |x| (x, y))) {
            let error = (fast[(x, y)] - slow[(x, y)]).abs();
            assert!(error < sampling_error(x, y, &sliver), "{error} at {x}, {y}");
        }
    }

    proptest! {
        #[test]
        fn area_of_the_coverage_equals_the_area_of_the_polygon(polygon in convex_polygon()) {
            let exact = area(&polygon);
            let filled = total(&fill_polygons(40, 40, std::slice::from_ref(&polygon)));
            let bound = 1e-3 * exact + unsplit_area(&polygon) + 1e-4;
            prop_assert!((filled - exact).abs() <= bound, "{filled} for {exact}");
        }

        #[test]
        fn the_mask_contains_the_pixels_with_centers_in_the_polygon(
            points in prop::collection::vec((-3.0..11.0f64, -3.0..11.0f64), 0..9),
        ) {
            let points: Vec<DVec2> = points.iter().map(|&(x, y)| DVec2::new(x, y)).collect();
            let mask = mask_of_polygons(8, 7, std::slice::from_ref(&points));
            let contour = crate::contour::Contour { points, hole: false };
            let slow = Mask::from_fn(8, 7, |x, y| {
                contour.contains(DVec2::new(x as f64 + 0.5, y as f64 + 0.5))
            });
            prop_assert_eq!(mask.to_art(), slow.to_art());
        }

        #[test]
        fn agrees_with_sampling(
            points in prop::collection::vec((-3.0..11.0f64, -3.0..11.0f64), 3..9),
            more in prop::collection::vec((-3.0..11.0f64, -3.0..11.0f64), 3..5),
        ) {
            let polygons: Vec<Vec<DVec2>> = [points, more]
                .iter()
                .map(|p| p.iter().map(|&(x, y)| DVec2::new(x, y)).collect())
                .collect();
            let fast = fill_polygons(8, 8, &polygons);
            let slow = fill_reference(8, 8, &polygons);
            for (x, y) in (0..8).flat_map(|y| (0..8).map(move |x| (x, y))) {
                let (a, b) = (fast[(x, y)], slow[(x, y)]);
                prop_assert!((a - b).abs() < sampling_error(x, y, &polygons), "{a} for {b}");
            }
        }
    }
}
