//! Sampling of regions as input of the network
//!
//! A photo much larger than the input is first averaged over squares of 2, 4, 8, ... pixels. Each input pixel is then
//! one bilinear sample; positions beyond the photo are black.
//!
//! # Source
//! MediaPipe, `image_to_tensor_utils.cc` and OpenCV's `warpPerspective`: one bilinear sample, without averaging; the
//! sample of input pixel i is at i / n of the region, relative to pixel centers.

use crate::{Photo, Region};

/// Photo and its reductions, computed when they are first needed
#[derive(Debug)]
pub(crate) struct Pyramid<'a> {
    photo: Photo<'a>,
    /// Reductions that have been computed
    levels: Vec<Level>,
}

/// Photo averaged over squares of `factor` px; columns and rows that do not fill a square are dropped
#[derive(Debug)]
struct Level {
    factor: usize,
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl<'a> Pyramid<'a> {
    pub(crate) fn new(photo: Photo<'a>) -> Self {
        Self {
            photo,
            levels: Vec::new(),
        }
    }

    pub(crate) fn photo(&self) -> &Photo<'a> {
        &self.photo
    }

    /// Samples a region to `out`, `side * side` pixels with values from 0 to 1.
    pub(crate) fn sample(&mut self, region: &Region, side: usize, out: &mut [f32]) {
        let factor = reduction(region.size() / side as f64, &self.photo);
        if factor == 1 {
            let (width, height) = (self.photo.width(), self.photo.height());
            let raster = Raster {
                width,
                height,
                pixels: self.photo.pixels(),
            };
            return sample(raster, region, 1.0, side, out);
        }
        let found = self.levels.iter().position(|level| level.factor == factor);
        let index = found.unwrap_or_else(|| {
            self.levels.push(reduce(&self.photo, factor));
            self.levels.len() - 1
        });
        let level = &self.levels[index];
        let raster = Raster {
            width: level.width,
            height: level.height,
            pixels: &level.pixels,
        };
        sample(raster, region, factor as f64, side, out);
    }
}

/// Returns the largest power of two that is at most `step` and at most the shorter side of the photo.
fn reduction(step: f64, photo: &Photo) -> usize {
    let limit = photo.width().min(photo.height());
    let mut factor = 1;
    while (2 * factor) as f64 <= step && 2 * factor <= limit {
        factor *= 2;
    }
    factor
}

/// Averages a photo over squares of `factor` px, at most the shorter side of the photo.
fn reduce(photo: &Photo, factor: usize) -> Level {
    let (width, height) = (photo.width() / factor, photo.height() / factor);
    let scale = 1.0 / (factor * factor) as f32;
    let mut column_sums = vec![0u32; 3 * photo.width()];
    let mut pixels = Vec::with_capacity(width * height);
    for rows in photo.pixels().chunks_exact(factor * photo.width()) {
        column_sums.fill(0);
        for row in rows.chunks_exact(photo.width()) {
            column_sums
                .iter_mut()
                .zip(row.as_flattened())
                .for_each(|(sum, &v)| *sum += u32::from(v));
        }
        for columns in column_sums.as_chunks::<3>().0.chunks_exact(factor) {
            let mut sum = [0u64; 3];
            for column in columns {
                sum.iter_mut()
                    .zip(column)
                    .for_each(|(sum, &v)| *sum += u64::from(v));
            }
            pixels.push(sum.map(|v| v as f32 * scale));
        }
    }
    Level {
        factor,
        width,
        height,
        pixels,
    }
}

/// Pixels of a photo or of a reduction
#[derive(Clone, Copy)]
struct Raster<'a, T> {
    width: usize,
    height: usize,
    pixels: &'a [[T; 3]],
}

/// Samples a raster whose pixels are averages over `factor` px of the photo.
fn sample<T: Copy>(raster: Raster<T>, region: &Region, factor: f64, side: usize, out: &mut [f32])
where
    f32: From<T>,
{
    let step = 1.0 / side as f64;
    // Pixel i of the raster is the average of pixels i * factor to i * factor + factor - 1.
    let raster_from_unit = |unit| {
        region
            .photo_from_unit(unit)
            .map(|v| (v - (factor - 1.0) / 2.0) / factor)
    };
    let origin = raster_from_unit([0.0, 0.0]);
    let [right, down] = [raster_from_unit([step, 0.0]), raster_from_unit([0.0, step])];
    let [right, down] = [right, down].map(|end| [end[0] - origin[0], end[1] - origin[1]]);
    for (j, row) in out.chunks_exact_mut(3 * side).enumerate() {
        for (i, out) in row.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let (i, j) = (i as f64, j as f64);
            let x = origin[0] + i * right[0] + j * down[0];
            let y = origin[1] + i * right[1] + j * down[1];
            let color = bilinear(raster, x, y);
            *out = [color[0] / 255.0, color[1] / 255.0, color[2] / 255.0];
        }
    }
}

/// Interpolates between pixel centers at integer coordinates; black beyond the border.
#[inline(always)]
fn bilinear<T: Copy>(raster: Raster<T>, x: f64, y: f64) -> [f32; 3]
where
    f32: From<T>,
{
    let (left, top) = (x.floor(), y.floor());
    let (fx, fy) = ((x - left) as f32, (y - top) as f32);
    // Regions are limited to 1e6 px.
    let (left, top) = (left as i64, top as i64);
    let mut sum = [0.0; 3];
    for (dx, dy, weight) in [
        (0, 0, (1.0 - fx) * (1.0 - fy)),
        (1, 0, fx * (1.0 - fy)),
        (0, 1, (1.0 - fx) * fy),
        (1, 1, fx * fy),
    ] {
        let (column, row) = ((left + dx) as usize, (top + dy) as usize);
        if column < raster.width && row < raster.height {
            let pixel = raster.pixels[row * raster.width + column];
            for c in 0..3 {
                sum[c] += weight * f32::from(pixel[c]);
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::{Pyramid, reduce, reduction};
    use crate::{Photo, Region};

    /// Samples the red channel.
    fn reds(photo: Photo, region: Region, side: usize) -> Vec<f32> {
        let mut out = vec![f32::NAN; side * side * 3];
        Pyramid::new(photo).sample(&region, side, &mut out);
        out.iter().step_by(3).map(|v| v * 255.0).collect()
    }

    fn assert_near(found: &[f32], expected: &[f32]) {
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-3),
            "{found:?}, expected {expected:?}"
        );
    }

    #[test]
    fn samples_pixels_of_a_region_of_equal_size() {
        let pixels = [1, 2, 3, 4].map(|v| [v; 3]);
        let photo = Photo::new(2, 2, &pixels).unwrap();
        assert_near(
            &reds(photo, Region::containing(&photo), 2),
            &[1.0, 2.0, 3.0, 4.0],
        );
    }

    #[test]
    fn positions_beyond_the_photo_are_black() {
        let photo = Photo::new(1, 1, &[[8; 3]]).unwrap();
        let region = Region::new([1.0, 1.0], 4.0, 0.0).unwrap();
        let mut expected = [0.0; 16];
        expected[5] = 8.0;
        assert_near(&reds(photo, region, 4), &expected);
    }

    #[test]
    fn rotated_regions_rotate_the_pixels() {
        let pixels = [1, 2, 3, 4].map(|v| [v; 3]);
        let photo = Photo::new(2, 2, &pixels).unwrap();
        // Turned by half a revolution about the corner shared by all pixels; sample (1, 1) is pixel (1, 1).
        let region = Region::new([1.0, 1.0], 2.0, std::f64::consts::PI).unwrap();
        assert_near(&reds(photo, region, 2)[3..], &[4.0]);
    }

    #[test]
    fn large_photos_are_averaged() {
        let pixels: Vec<[u8; 3]> = (0..64)
            .map(|i| [if (i + i / 8) % 2 == 0 { 200 } else { 100 }; 3])
            .collect();
        let photo = Photo::new(8, 8, &pixels).unwrap();
        let found = reds(photo, Region::new([5.0, 5.0], 4.0, 0.3).unwrap(), 1);
        assert_near(&found, &[150.0]);
    }

    #[test]
    fn reduce_averages_squares_and_drops_incomplete_ones() {
        let pixels: Vec<[u8; 3]> = (0..15).map(|i| [i, 2 * i, 255]).collect();
        let level = reduce(&Photo::new(5, 3, &pixels).unwrap(), 2);
        assert_eq!((level.width, level.height), (2, 1));
        assert_eq!(level.pixels, [[3.0, 6.0, 255.0], [5.0, 10.0, 255.0]]);
    }

    #[test]
    fn reductions_are_powers_of_two_up_to_the_step_and_the_photo() {
        let pixels = [[0; 3]; 50];
        let photo = Photo::new(10, 5, &pixels).unwrap();
        let found = [0.1, 1.9, 2.0, 3.9, 4.0, 1e6].map(|step| reduction(step, &photo));
        assert_eq!(found, [1, 1, 2, 2, 4, 4]);
    }

    #[test]
    fn large_and_far_regions_are_accepted() {
        let photo = Photo::new(3, 1, &[[9; 3]; 3]).unwrap();
        let region = Region::new([-Region::MAX_SIZE; 2], Region::MAX_SIZE, 1.0).unwrap();
        assert!(
            reds(photo, region, 2)
                .iter()
                .all(|v| (0.0..=9.0).contains(v))
        );
    }
}
