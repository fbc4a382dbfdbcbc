//! The distance map of the reference contour, accurate to fractions of a pixel.

use glam::DVec2;
use pirouette_geom::contour::{Contour, trace_outline};
use pirouette_geom::coverage::mask_of_polygons;
use pirouette_geom::distance_map::signed_distance;
use pirouette_geom::{Grid, Mask};

/// The contour is at half coverage
const CONTOUR_LEVEL: f32 = 0.5;

/// Distance from the contour within which the map is exact to the line itself, in px
///
/// Below 1.5, lookups at the contour would mix in distances between pixel centers, which are off by up to half a pixel;
/// above, only farther points benefit, where half a pixel matters little.
const FINE_BAND_PX: f64 = 2.5;

/// Distance of any point from the contour of the reference silhouette, including holes
///
/// The map stores signed distances, and lookups take the magnitude after interpolation: interpolated magnitudes would
/// never reach zero between pixel centers. A reference cut off by the image border has its contour there.
#[derive(Debug, Clone)]
pub struct ReferenceContourMap {
    /// With one additional pixel on each side, so that every lookup finds four neighbors; `None` without contour
    signed: Option<Grid<f32>>,
}

impl ReferenceContourMap {
    /// Prepares the map for contours in an image of this size
    ///
    /// Holes have the opposite orientation of their surrounding contour.
    pub fn from_contours(width: usize, height: usize, contours: &[Contour]) -> Self {
        // Pixel (0, 0) of the image is pixel (1, 1) of the map
        let polygons: Vec<Vec<DVec2>> = contours
            .iter()
            .filter(|contour| contour.points.iter().all(|p| p.is_finite()))
            .map(|contour| contour.points.iter().map(|&p| p + 1.0).collect())
            .collect();
        let inside = mask_of_polygons(width + 2, height + 2, &polygons);
        if inside.area() == 0 {
            return Self { signed: None };
        }
        let mut signed = signed_distance(&inside);
        let near = distance_in_band(&polygons, signed.width(), signed.height());
        for (d, near) in signed.as_mut_slice().iter_mut().zip(near.into_vec()) {
            if near.is_finite() {
                *d = near.copysign(*d);
            }
        }
        // Contours far outside the image leave only inside pixels
        let bounded = signed.as_slice().iter().all(|d| d.is_finite());
        Self {
            signed: bounded.then_some(signed),
        }
    }

    /// Prepares the map for the contour at half coverage
    pub fn from_coverage(coverage: &Grid<f32>) -> Self {
        let outline = trace_outline(coverage, CONTOUR_LEVEL);
        Self::from_contours(coverage.width(), coverage.height(), &outline)
    }

    /// Prepares the map for the border of a mask, halfway between pixels
    pub fn from_mask(mask: &Mask) -> Self {
        Self::from_coverage(&mask.map(|&v| f32::from(u8::from(v))))
    }

    /// Returns the distance of a point to the contour, in px; infinite when there is no contour
    ///
    /// Outside the image: the distance at the nearest point inside plus the distance to it. NaN yields NaN.
    pub fn distance_px(&self, point: DVec2) -> f64 {
        let Some(map) = &self.signed else {
            return f64::INFINITY;
        };
        // Pixel (0, 0) of the image is pixel (1, 1) of the map; integers are pixel centers
        let last = DVec2::new((map.width() - 1) as f64, (map.height() - 1) as f64);
        let at = point + 0.5;
        let place = at.clamp(DVec2::ZERO, last);
        let x = (place.x as usize).min(map.width() - 2);
        let y = (place.y as usize).min(map.height() - 2);
        let t = place - DVec2::new(x as f64, y as f64);
        let start = y * map.width() + x;
        let upper = &map.as_slice()[start..start + 2];
        let lower = &map.as_slice()[start + map.width()..start + map.width() + 2];
        let mix = |pair: &[f32]| {
            let (left, right) = (f64::from(pair[0]), f64::from(pair[1]));
            left + (right - left) * t.x
        };
        let (upper, lower) = (mix(upper), mix(lower));
        let distance = (upper + (lower - upper) * t.y).abs();
        if place == at {
            distance
        } else {
            distance + place.distance(at)
        }
    }

    /// Returns the signed distance of a point to the contour, in px, negative inside, and the direction in which it
    /// increases
    ///
    /// Outside the image, distances are measured from its border, all of them positive. `None` without a contour, or
    /// for a point that is not finite.
    pub(in crate::normalize) fn signed_with_slope(&self, point: DVec2) -> Option<(f64, DVec2)> {
        let map = self.signed.as_ref()?;
        let last = DVec2::new((map.width() - 1) as f64, (map.height() - 1) as f64);
        let at = point + 0.5;
        let place = at.clamp(DVec2::ZERO, last);
        if place != at {
            let out = (at - place).try_normalize()?;
            return Some((self.distance_px(point), out));
        }
        let x = (place.x as usize).min(map.width() - 2);
        let y = (place.y as usize).min(map.height() - 2);
        let t = place - DVec2::new(x as f64, y as f64);
        let start = y * map.width() + x;
        let upper = &map.as_slice()[start..start + 2];
        let lower = &map.as_slice()[start + map.width()..start + map.width() + 2];
        let [a, b, c, d] = [upper[0], upper[1], lower[0], lower[1]].map(f64::from);
        let (top, bottom) = (a + (b - a) * t.x, c + (d - c) * t.x);
        let across = (b - a) + ((d - c) - (b - a)) * t.y;
        Some((top + (bottom - top) * t.y, DVec2::new(across, bottom - top)))
    }

    /// Sums the distances of shifted points; stops as soon as the sum reaches `limit`
    pub(in crate::normalize) fn total_distance(
        &self,
        points: &[DVec2],
        shift: DVec2,
        limit: f64,
    ) -> f64 {
        const BETWEEN_CHECKS: usize = 16;
        let mut total = 0.0;
        for some in points.chunks(BETWEEN_CHECKS) {
            total += some
                .iter()
                .map(|&p| self.distance_px(p + shift))
                .sum::<f64>();
            if total >= limit {
                break;
            }
        }
        total
    }
}

/// Computes the distance of the pixels near closed polygons to their lines, infinite at all others
fn distance_in_band(polygons: &[Vec<DVec2>], width: usize, height: usize) -> Grid<f32> {
    let mut near = Grid::filled(width, height, f32::INFINITY);
    for (&a, &b) in polygons
        .iter()
        .flat_map(|polygon| polygon.iter().zip(polygon.iter().cycle().skip(1)))
    {
        // Pixel indices, whose centers are integers
        let (a, b) = (a - 0.5, b - 0.5);
        let from = (a.min(b) - FINE_BAND_PX).ceil().max(DVec2::ZERO);
        let to = (a.max(b) + FINE_BAND_PX).floor().max(DVec2::ZERO);
        let along = b - a;
        let per_length = 1.0 / along.length_squared().max(f64::MIN_POSITIVE);
        let end_of = |last: f64, size: usize| (last as usize).saturating_add(1).min(size);
        let (start, end) = (from.x as usize, end_of(to.x, width));
        for y in from.y as usize..end_of(to.y, height) {
            let row = near.row_mut(y).iter_mut().enumerate();
            for (x, nearest) in row.take(end).skip(start) {
                let p = DVec2::new(x as f64, y as f64);
                let t = ((p - a).dot(along) * per_length).clamp(0.0, 1.0);
                let distance = p.distance(a + t * along);
                if distance <= FINE_BAND_PX {
                    *nearest = nearest.min(distance as f32);
                }
            }
        }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_geom::coverage::fill_polygons;

    fn rectangle() -> Vec<DVec2> {
        [(20.0, 10.0), (50.3, 10.0), (50.3, 40.7), (20.0, 40.7)]
            .map(|(x, y)| DVec2::new(x, y))
            .to_vec()
    }

    #[test]
    fn distances_are_measured_to_the_line() {
        let contour = Contour {
            points: rectangle(),
            hole: false,
        };
        let map = ReferenceContourMap::from_contours(80, 60, &[contour]);
        for (x, y, expected) in [
            (20.0, 25.0, 0.0),
            (50.3, 25.0, 0.0),
            (35.2, 40.7, 0.0),
            (49.9, 25.1, 0.4),
            (51.6, 22.7, 1.3),
            (30.0, 25.0, 10.0),
            (70.3, 25.0, 20.0),
        ] {
            let found = map.distance_px(DVec2::new(x, y));
            assert!((found - expected).abs() < 0.35, "{found} at {x}, {y}");
            if expected < 1.0 {
                assert!((found - expected).abs() < 0.01, "{found} at {x}, {y}");
            }
        }
    }

    #[test]
    fn outside_the_image_the_distance_to_it_is_added() {
        let map = ReferenceContourMap::from_coverage(&fill_polygons(80, 60, &[rectangle()]));
        let at = |x, y| map.distance_px(DVec2::new(x, y));
        assert!((at(150.3, 25.0) - 100.0).abs() < 0.5);
        assert!((at(-80.0, 25.0) - 100.0).abs() < 0.5);
        assert!(at(f64::NAN, 2.0).is_nan());
    }

    #[test]
    fn a_full_reference_has_its_contour_at_the_image_border() {
        let map = ReferenceContourMap::from_mask(&Mask::filled(20, 10, true));
        assert!((map.distance_px(DVec2::new(10.0, 0.0))).abs() < 1e-6);
        assert!((map.distance_px(DVec2::new(10.0, 5.0)) - 5.0).abs() < 0.6);
        assert!((map.distance_px(DVec2::new(23.0, 5.0)) - 3.0).abs() < 0.5);
    }

    #[test]
    fn without_a_contour_all_distances_are_infinite() {
        for mask in [Mask::filled(0, 0, true), Mask::filled(4, 3, false)] {
            let map = ReferenceContourMap::from_mask(&mask);
            assert_eq!(map.distance_px(DVec2::ONE), f64::INFINITY);
        }
    }
}
