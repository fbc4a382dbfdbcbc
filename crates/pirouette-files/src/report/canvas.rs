//! Drawing on a photo: anti-aliased lines and discs, tints, and shrinking.
//!
//! Coordinates are photo coordinates: pixel centers at .5. Shapes are clipped to the photo; shapes whose coordinates
//! are not finite are skipped.

use std::ops::Range;

use glam::DVec2;
use pirouette_geom::{Grid, Mask};

use pirouette::scan::Photo;

/// An sRGB color, 8 bits per channel
pub(super) type Color = [u8; 3];

/// Mixes a color into a pixel
pub(super) fn mix(pixel: &mut Color, color: Color, alpha: f64) {
    let alpha = alpha.clamp(0.0, 1.0);
    for (p, c) in pixel.iter_mut().zip(color) {
        *p = (f64::from(*p) * (1.0 - alpha) + f64::from(c) * alpha + 0.5) as u8;
    }
}

/// Lookup table of [`mix`] for every level, for one color and strength
pub(super) struct Tint([[u8; 256]; 3]);

impl Tint {
    pub(super) fn new(color: Color, alpha: f64) -> Self {
        let mut levels = [[0; 256]; 3];
        for level in 0..=255 {
            let mut pixel = [level; 3];
            mix(&mut pixel, color, alpha);
            for (levels, mixed) in levels.iter_mut().zip(pixel) {
                levels[level as usize] = mixed;
            }
        }
        Self(levels)
    }

    pub(super) fn apply(&self, pixel: &mut Color) {
        for (p, levels) in pixel.iter_mut().zip(&self.0) {
            *p = levels[*p as usize];
        }
    }
}

/// Returns the columns or rows whose centers can lie within `reach` of the interval from `low` to `high`
fn span(low: f64, high: f64, reach: f64, size: usize) -> std::ops::Range<usize> {
    let end = (high + reach + 1.0).clamp(0.0, size as f64) as usize;
    let start = (low - reach - 1.0).clamp(0.0, size as f64) as usize;
    start..end
}

/// Draws straight strokes with round ends; each pixel is blended at most once
pub(super) fn stroke(photo: &mut Photo, lines: &[[DVec2; 2]], width: f64, color: Color) {
    let radius = width / 2.0;
    let finite: Vec<_> = lines
        .iter()
        .filter(|[a, b]| a.is_finite() && b.is_finite())
        .collect();
    let Some(first) = finite.first() else {
        return;
    };
    let bounds = finite
        .iter()
        .flat_map(|line| line.iter())
        .fold((first[0], first[0]), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
    let columns = span(bounds.0.x, bounds.1.x, radius, photo.width());
    let rows = span(bounds.0.y, bounds.1.y, radius, photo.height());
    if columns.is_empty() || rows.is_empty() {
        return;
    }
    let mut ink = Grid::filled(columns.len(), rows.len(), 0f32);
    for &&[a, b] in &finite {
        let along = b - a;
        let length_squared = along.length_squared();
        for y in span(a.y.min(b.y), a.y.max(b.y), radius, photo.height()) {
            for x in span(a.x.min(b.x), a.x.max(b.x), radius, photo.width()) {
                let from = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - a;
                let t = if length_squared > 0.0 {
                    (from.dot(along) / length_squared).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                let coverage = radius + 0.5 - (from - along * t).length();
                let slot = &mut ink[(x - columns.start, y - rows.start)];
                *slot = slot.max(coverage.clamp(0.0, 1.0) as f32);
            }
        }
    }
    for y in rows.clone() {
        let covered = ink.row(y - rows.start);
        let pixels = &mut photo.row_mut(y)[columns.clone()];
        for (pixel, &coverage) in pixels.iter_mut().zip(covered) {
            if coverage > 0.0 {
                mix(pixel, color, f64::from(coverage));
            }
        }
    }
}

/// Draws a filled disc
pub(super) fn disc(photo: &mut Photo, center: DVec2, radius: f64, color: Color) {
    stroke(photo, &[[center, center]], 2.0 * radius, color);
}

/// Mixes a color into a rectangle of pixels
pub(super) fn tint_box(
    photo: &mut Photo,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
    color: Color,
    alpha: f64,
) {
    let right = (left + width).min(photo.width());
    for y in top..(top + height).min(photo.height()) {
        for pixel in &mut photo.row_mut(y)[left.min(right)..right] {
            mix(pixel, color, alpha);
        }
    }
}

/// Copies a picture into another, with its upper left corner at `(left, top)`
pub(super) fn paste(photo: &mut Photo, tile: &Photo, (left, top): (usize, usize)) {
    let right = (left + tile.width()).min(photo.width());
    for y in 0..tile.height() {
        if top + y < photo.height() && left < right {
            photo.row_mut(top + y)[left..right].copy_from_slice(&tile.row(y)[..right - left]);
        }
    }
}

/// A rectangle of a picture, as fractions of its width and height
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crop {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Crop {
    pub(super) const FULL: Crop = Crop {
        left: 0.0,
        top: 0.0,
        right: 1.0,
        bottom: 1.0,
    };

    /// Returns the union of the boxes with a margin, for pictures of any size; the full picture if there are no boxes
    pub(super) fn around(boxes: impl Iterator<Item = (PixelBox, (f64, f64))>) -> Self {
        let mut union: Option<Crop> = None;
        for ((x0, y0, x1, y1), (width, height)) in boxes {
            let fractions = Crop {
                left: x0 as f64 / width,
                top: y0 as f64 / height,
                right: x1 as f64 / width,
                bottom: y1 as f64 / height,
            };
            union = Some(union.map_or(fractions, |u| Crop {
                left: u.left.min(fractions.left),
                top: u.top.min(fractions.top),
                right: u.right.max(fractions.right),
                bottom: u.bottom.max(fractions.bottom),
            }));
        }
        let Some(u) = union else {
            return Crop::FULL;
        };
        let (wide, high) = (u.right - u.left, u.bottom - u.top);
        Crop {
            left: (u.left - MARGIN * wide).max(0.0),
            top: (u.top - MARGIN * high).max(0.0),
            right: (u.right + MARGIN * wide).min(1.0),
            bottom: (u.bottom + MARGIN * high).min(1.0),
        }
    }

    /// Returns the width of a tile of the given height that keeps the aspect ratio of this crop of the first non-empty
    /// picture
    pub(super) fn tile_width<'a>(
        self,
        mut pictures: impl Iterator<Item = &'a Photo>,
        height_px: usize,
    ) -> usize {
        let aspect = pictures
            .find(|photo| photo.width() > 0 && photo.height() > 0)
            .map_or(1.0, |photo| {
                let wide = photo.width() as f64 * (self.right - self.left);
                wide / (photo.height() as f64 * (self.bottom - self.top))
            });
        let aspect = aspect.clamp(1.0 / MAX_TILE_ASPECT.powi(2), MAX_TILE_ASPECT);
        (height_px as f64 * aspect).round() as usize
    }
}

/// Margin around the persons, as a fraction of their extent
const MARGIN: f64 = 0.06;

/// Largest ratio of width to height of a tile
const MAX_TILE_ASPECT: f64 = 1.6;

/// First column and row, then the column and row after the last
pub(super) type PixelBox = (usize, usize, usize, usize);

/// Returns the bounding box of a mask, and the size of the mask
pub(super) fn sized_box(mask: &Mask) -> Option<(PixelBox, (f64, f64))> {
    let size = (mask.width() as f64, mask.height() as f64);
    Some((mask.bounding_box()?, size))
}

/// Resamples a crop of a picture with a box filter: each new pixel is the mean of the pixels that it covers
///
/// The result for an empty picture is gray.
pub(super) fn shrink(photo: &Photo, crop: Crop, width: usize, height: usize) -> Photo {
    let size = (photo.width(), photo.height());
    shrink_rows(size, crop, width, height, |y, columns, row| {
        row.copy_from_slice(&photo.row(y)[columns]);
    })
}

/// [`shrink`] for a picture computed row by row: `fill` receives a row, columns, and the pixels to write
pub(super) fn shrink_rows(
    (columns, rows): (usize, usize),
    crop: Crop,
    width: usize,
    height: usize,
    mut fill: impl FnMut(usize, Range<usize>, &mut [Color]),
) -> Photo {
    if columns == 0 || rows == 0 {
        return Photo::filled(width, height, [128; 3]);
    }
    let across = box_weights(crop.left, crop.right, columns, width);
    let down = box_weights(crop.top, crop.bottom, rows, height);
    let (Some((left, _)), Some((last, weights))) = (across.first(), across.last()) else {
        return Photo::filled(width, height, [128; 3]);
    };
    let covered = *left..last + weights.len();
    let mut source = vec![[0; 3]; covered.len()];
    let mut flat = vec![0f32; 3 * covered.len()];
    let mut pixels = Vec::with_capacity(width * height);
    // The rows of one new row are summed first, over all columns: these loops vectorize.
    for (first, weights) in &down {
        flat.fill(0.0);
        for (row, &weight) in (*first..).zip(weights) {
            fill(row, covered.clone(), &mut source);
            for (sum, &level) in flat.iter_mut().zip(source.as_flattened()) {
                *sum += f32::from(level) * weight;
            }
        }
        let total: f32 = weights.iter().sum();
        let columns = flat.as_chunks::<3>().0;
        pixels.extend(across.iter().map(|(first, weights)| {
            let mut sum = [0f32; 3];
            for (column, &weight) in columns[first - covered.start..].iter().zip(weights) {
                for (s, v) in sum.iter_mut().zip(column) {
                    *s += v * weight;
                }
            }
            let total = total * weights.iter().sum::<f32>();
            sum.map(|s| (s / total.max(f32::MIN_POSITIVE) + 0.5) as u8)
        }));
    }
    Photo::from_vec(width, height, pixels)
}

/// Returns for each new pixel the old pixels that it covers: the first, and the covered length of each
fn box_weights(low: f64, high: f64, old: usize, new: usize) -> Vec<(usize, Vec<f32>)> {
    let step = (high - low) * old as f64 / new as f64;
    (0..new)
        .map(|i| {
            let start = low * old as f64 + i as f64 * step;
            // Enlarging repeats pixels: at least one is covered.
            let start = start.clamp(0.0, old as f64 - 1.0);
            let end = (start + step.max(1e-3)).min(old as f64);
            let first = start as usize;
            let last = (end.ceil() as usize).clamp(first + 1, old);
            let weights = (first..last)
                .map(|p| (end.min(p as f64 + 1.0) - start.max(p as f64)) as f32)
                .collect();
            (first, weights)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::font::Lettering;
    use super::*;

    fn black(width: usize, height: usize) -> Photo {
        Photo::filled(width, height, [0; 3])
    }

    #[test]
    fn a_stroke_of_one_pixel_through_centers_fills_only_these_pixels() {
        let mut photo = black(5, 3);
        let line = [DVec2::new(1.5, 1.5), DVec2::new(3.5, 1.5)];
        stroke(&mut photo, &[line], 1.0, [255; 3]);
        let reds: Vec<u8> = photo.as_slice().iter().map(|p| p[0]).collect();
        assert_eq!(reds, [0, 0, 0, 0, 0, 0, 255, 255, 255, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn drawing_outside_changes_nothing() {
        let mut photo = black(4, 4);
        for far in [
            DVec2::splat(1e9),
            DVec2::splat(-50.0),
            DVec2::NAN,
            DVec2::INFINITY,
        ] {
            disc(&mut photo, far, 3.0, [255; 3]);
        }
        tint_box(&mut photo, (9, 9), (4, 4), [255; 3], 1.0);
        Lettering::new(20.0).draw(&mut photo, (50, 2), "outside", [255; 3]);
        paste(&mut photo, &Photo::filled(2, 2, [9; 3]), (7, 0));
        assert_eq!(photo, black(4, 4));
    }

    #[test]
    fn shrinking_keeps_means_and_the_identity() {
        let photo = Photo::from_fn(6, 4, |x, y| [(x * 10) as u8, (y * 20) as u8, 7]);
        assert_eq!(shrink(&photo, Crop::FULL, 6, 4), photo);
        let half = shrink(&photo, Crop::FULL, 3, 2);
        assert_eq!(half.as_slice()[0], [5, 10, 7]);
        assert_eq!(half.as_slice()[5], [45, 50, 7]);
        let left = Crop {
            right: 1.0 / 3.0,
            ..Crop::FULL
        };
        assert_eq!(shrink(&photo, left, 1, 1).as_slice(), &[[5, 30, 7]]);
        let large = shrink(&photo, Crop::FULL, 12, 8);
        assert_eq!(large.as_slice()[0], [0, 0, 7]);
        assert_eq!(shrink(&black(0, 3), Crop::FULL, 2, 1).as_slice().len(), 2);
    }
}
