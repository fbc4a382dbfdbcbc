//! Signed distance to a silhouette's outline, accurate to fractions of a pixel near it.

use crate::contour::{nearest_on_segment, trace_outline};
use crate::distance_map::signed_distance_within;
use crate::{Grid, Mask};
use glam::DVec2;

/// Signed distance to the outline of a soft silhouette, in px, negative inside
///
/// For carving and tapes; takes a third of the silhouette's memory.
#[derive(Debug, Clone)]
pub struct OutlineMap {
    /// Columns and rows of the silhouette
    size: (usize, usize),
    /// Distances at pixel centers around the person, in px
    distances: Grid<f32>,
    /// Photo coordinates of the first pixel center of the map
    first: DVec2,
    /// Largest coordinates between pixel centers: just before the last column and row
    last_cell: DVec2,
    /// Corners of the person's bounding box, in photo coordinates; `None` for an empty silhouette
    person: Option<[DVec2; 2]>,
    /// Whether the border of the photo cuts off the person
    cut: bool,
}

/// Within this distance, in px, values are computed from the outline; beyond, from pixels
///
/// A cell of 5 mm spans two to three pixels of typical photos: all corners of cells that the surface cuts lie
/// within this distance.
const EXACT_PX: f64 = 3.0;

/// Pixels kept around the silhouette; beyond, distances to the bounding box are used
///
/// Only the search for blocks to skip samples there.
const MARGIN_PX: usize = 24;

impl OutlineMap {
    /// Coverage at the outline
    pub const LEVEL: f32 = 0.5;

    /// Reach for carving, which skips blocks by their distance, in px
    pub const FAR_PX: f32 = 32.0;

    /// Reach for tapes, which sample only close to the outline: a fifth of the work
    pub const NEAR_PX: f32 = 4.0;

    /// Computes the map of a silhouette's coverage, 0 to 1
    ///
    /// Distances are clamped to `reach_px`, which is at least [`Self::NEAR_PX`]. NaN counts as outside.
    pub fn new(silhouette: &Grid<f32>, reach_px: f32) -> Self {
        let (width, height) = (silhouette.width(), silhouette.height());
        let Some((x0, y0, x1, y1)) = silhouette.bounding_box_where(|&v| v >= Self::LEVEL) else {
            return Self {
                size: (width, height),
                distances: Grid::filled(2, 2, reach_px),
                first: DVec2::ZERO,
                last_cell: DVec2::splat(1.0 - 1e-9),
                person: None,
                cut: false,
            };
        };
        let cut = x0 == 0 || y0 == 0 || x1 == width || y1 == height;
        let person = [(x0, y0), (x1, y1)].map(|(x, y)| DVec2::new(x as f64, y as f64));
        let (x0, y0) = (x0.saturating_sub(MARGIN_PX), y0.saturating_sub(MARGIN_PX));
        let (x1, y1) = ((x1 + MARGIN_PX).min(width), (y1 + MARGIN_PX).min(height));
        let soft = smooth(silhouette, (x0, y0), (x1 - x0, y1 - y0));
        let mask = soft.threshold(Self::LEVEL);
        let mut distances = distances_to_outline(&soft);
        blend_far(&mut distances, &mask, reach_px);
        let distances = at_least_two_wide(distances);
        let size = DVec2::new(distances.width() as f64, distances.height() as f64);
        Self {
            size: (width, height),
            distances,
            last_cell: size - (1.0 + 1e-9),
            first: DVec2::new(x0 as f64 + 0.5, y0 as f64 + 0.5),
            person: Some(person),
            cut,
        }
    }

    /// Columns and rows of the silhouette
    pub fn size_px(&self) -> (usize, usize) {
        self.size
    }

    /// Whether the silhouette has no pixels inside
    pub fn is_empty(&self) -> bool {
        self.person.is_none()
    }

    /// Whether the border of the photo cuts off the person
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// Returns the signed distance at a photo point, in px
    ///
    /// Beyond the map, on sides where the photo cuts off the silhouette, border values are extended; on other sides
    /// the value is positive and no larger than the distance.
    #[inline]
    pub fn at(&self, u: f64, v: f64) -> f64 {
        let (x, y) = (u - self.first.x, v - self.first.y);
        if x >= 0.0 && y >= 0.0 && x <= self.last_cell.x && y <= self.last_cell.y {
            return self.within(x, y);
        }
        self.beyond(u, v)
    }

    /// Returns the value at a photo point outside the map
    #[cold]
    fn beyond(&self, u: f64, v: f64) -> f64 {
        let (x, y) = (u - self.first.x, v - self.first.y);
        let at_border = self.within(
            x.clamp(0.0, self.last_cell.x),
            y.clamp(0.0, self.last_cell.y),
        );
        if self.cut {
            return at_border;
        }
        let Some([low, high]) = self.person else {
            return at_border;
        };
        let p = DVec2::new(u, v);
        at_border.max(p.distance(p.clamp(low, high)))
    }

    /// Returns the value at a point of the map, in px from its first pixel center
    #[inline]
    fn within(&self, x: f64, y: f64) -> f64 {
        let width = self.distances.width();
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        // The map has at least two columns and rows, so the cell to the right and below exists.
        let start = row * width + column;
        let cell = &self.distances.as_slice()[start..start + width + 2];
        let mix = |a: f32, b: f32| f64::from(a) + (f64::from(b) - f64::from(a)) * fx;
        let (upper, lower) = (mix(cell[0], cell[1]), mix(cell[width], cell[width + 1]));
        upper + (lower - upper) * fy
    }
}

/// Duplicates a single column or row, so that there is a cell to interpolate in
fn at_least_two_wide(map: Grid<f32>) -> Grid<f32> {
    let (width, height) = (map.width(), map.height());
    if width > 1 && height > 1 {
        return map;
    }
    Grid::from_fn(width.max(2), height.max(2), |x, y| {
        map[(x.min(width - 1), y.min(height - 1))]
    })
}

/// Smooths a part of a silhouette with the weights 1 2 1 along both axes; NaN counts as outside
///
/// Straight edges do not move. Interpolation between pixels of sharp coverage is off by up to 0.09 px, after
/// smoothing by up to 0.04; stairs of binary masks shrink likewise.
fn smooth(
    soft: &Grid<f32>,
    (x0, y0): (usize, usize),
    (width, height): (usize, usize),
) -> Grid<f32> {
    let mut out = Grid::filled(width, height, 0.0);
    // The row with its ends repeated, and the smoothed rows above, at and below the current one
    let mut clean = vec![0.0; width + 2];
    let mut rows = [(); 3].map(|()| vec![0.0; width]);
    let mut across = |y: usize, row: &mut [f32]| {
        let values = &soft.row(y0 + y)[x0..x0 + width];
        for (clean, &v) in clean[1..].iter_mut().zip(values) {
            *clean = if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) };
        }
        (clean[0], clean[width + 1]) = (clean[1], clean[width]);
        for (row, near) in row.iter_mut().zip(clean.windows(3)) {
            *row = (near[0] + 2.0 * near[1] + near[2]) / 4.0;
        }
    };
    across(0, &mut rows[1]);
    rows[0] = rows[1].clone();
    for y in 0..height {
        let [above, here, below] = &mut rows;
        across((y + 1).min(height - 1), below);
        let near = above.iter().zip(&*here).zip(&*below);
        for (value, ((above, here), below)) in out.row_mut(y).iter_mut().zip(near) {
            *value = (above + 2.0 * here + below) / 4.0;
        }
        rows.rotate_left(1);
    }
    out
}

/// Computes the distance from each pixel center to the outline, in px; infinite beyond [`EXACT_PX`]
fn distances_to_outline(soft: &Grid<f32>) -> Grid<f32> {
    let (width, height) = (soft.width(), soft.height());
    let mut distances = Grid::filled(width, height, f32::INFINITY);
    let within = |p: DVec2| {
        let size = DVec2::new(width as f64, height as f64);
        p.cmpge(DVec2::splat(0.5)).all() && p.cmple(size - 0.5).all()
    };
    for contour in trace_outline(soft, OutlineMap::LEVEL) {
        // Edges along the border of the photo do not belong to the person's outline.
        for [a, b] in contour.edges().filter(|&[a, b]| within(a) && within(b)) {
            let lo = (a.min(b) - 0.5 - EXACT_PX).ceil().max(DVec2::ZERO);
            let hi = (a.max(b) - 0.5 + EXACT_PX).floor();
            let (x_end, y_end) = (
                (hi.x as usize + 1).min(width),
                (hi.y as usize + 1).min(height),
            );
            for y in lo.y as usize..y_end {
                for x in lo.x as usize..x_end {
                    let center = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    let distance = center.distance(nearest_on_segment(center, a, b));
                    if distance <= EXACT_PX {
                        let slot = &mut distances[(x, y)];
                        *slot = slot.min(distance as f32);
                    }
                }
            }
        }
    }
    distances
}

/// Adds signs to distances, and fills in those beyond the exact range from the pixel distance map
fn blend_far(distances: &mut Grid<f32>, mask: &Mask, reach_px: f32) {
    /// Error bound of pixel distances: half a pixel and its diagonal
    const SLACK_PX: f32 = 0.75;
    let whole = signed_distance_within(mask, reach_px);
    for (distance, &whole) in distances.as_mut_slice().iter_mut().zip(whole.as_slice()) {
        let magnitude = if distance.is_finite() {
            *distance
        } else {
            (whole.abs() - SLACK_PX).clamp(EXACT_PX as f32, reach_px)
        };
        *distance = magnitude.copysign(whole);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::fill_polygons;

    fn disc(center: DVec2, radius: f64, size: usize) -> Grid<f32> {
        let circle = (0..500)
            .map(|i| {
                let angle = f64::from(i) / 500.0 * std::f64::consts::TAU;
                center + radius * DVec2::from_angle(angle)
            })
            .collect();
        fill_polygons(size, size, &[circle])
    }

    #[test]
    fn distances_to_a_disc_are_exact_to_a_twentieth_of_a_pixel() {
        let center = DVec2::new(40.3, 37.8);
        let map = OutlineMap::new(&disc(center, 20.0, 80), OutlineMap::FAR_PX);
        assert!(!map.cut);
        for i in 0..1000 {
            let t = f64::from(i);
            let distance = (t * 0.37) % 5.0 - 2.5;
            let p = center + (20.0 + distance) * DVec2::from_angle(t * 0.71);
            let error = map.at(p.x, p.y) - distance;
            assert!(error.abs() < 0.08, "{error} px at a distance of {distance}");
        }
    }

    #[test]
    fn far_distances_have_the_right_sign_and_are_lower_bounds() {
        let center = DVec2::new(40.0, 40.0);
        let map = OutlineMap::new(&disc(center, 20.0, 200), OutlineMap::FAR_PX);
        for (p, distance) in [
            (DVec2::new(40.0, 40.0), -20.0),
            (DVec2::new(70.0, 40.0), 10.0),
            (DVec2::new(190.0, 40.0), 130.0),
            (DVec2::new(-500.0, 40.0), 520.0),
        ] {
            let found = map.at(p.x, p.y);
            assert!(found * distance > 0.0 && found.abs() <= f64::abs(distance) + 0.1);
        }
    }

    #[test]
    fn a_cut_silhouette_is_extended_beyond_the_border() {
        let map = OutlineMap::new(&disc(DVec2::new(5.0, 40.0), 20.0, 80), OutlineMap::FAR_PX);
        assert!(map.cut);
        assert!(map.at(0.5, 40.0) < -10.0);
        assert!(map.at(-300.0, 40.0) < -10.0);
        assert!(map.at(-300.0, 75.0) > 3.0);
    }

    #[test]
    fn degenerate_silhouettes() {
        for (width, height) in [(0, 0), (3, 2)] {
            let blank = Grid::filled(width, height, f32::NAN);
            let empty = OutlineMap::new(&blank, OutlineMap::FAR_PX);
            assert!(empty.is_empty() && empty.size_px() == (width, height));
            assert!(empty.at(0.5, 0.5) > 0.0 && empty.at(-9.0, 9.0) > 0.0);
        }
        let full = OutlineMap::new(&Grid::filled(1, 1, 1.0), OutlineMap::FAR_PX);
        assert!(!full.is_empty() && full.is_cut());
        assert!(full.at(0.5, 0.5) < 0.0 && full.at(10.0, -10.0) < 0.0);
        // A single pixel vanishes in the smoothing, but its map is valid.
        let mut lone = Grid::filled(9, 9, 0.0);
        lone[(4, 4)] = 1.0;
        let lone = OutlineMap::new(&lone, OutlineMap::FAR_PX);
        assert!(lone.at(4.5, 4.5).is_finite());
    }
}
