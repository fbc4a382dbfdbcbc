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
    /// Reductions by 2, 4, 8, ...
    levels: Vec<Level>,
}

/// Photo averaged over squares
#[derive(Debug)]
struct Level {
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
        let step = region.size() / side as f64;
        let wanted = step.max(1.0).log2() as usize;
        let count = self.require_levels(wanted);
        let Some(level) = count.checked_sub(1).and_then(|i| self.levels.get(i)) else {
            let (width, height, pixels) =
                (self.photo.width(), self.photo.height(), self.photo.pixels());
            return sample(
                Raster {
                    width,
                    height,
                    pixels,
                },
                region,
                1.0,
                side,
                out,
            );
        };
        let raster = Raster {
            width: level.width,
            height: level.height,
            pixels: &level.pixels,
        };
        sample(raster, region, (1u64 << count) as f64, side, out);
    }

    /// Computes reductions up to `wanted`, or as many as the photo has; returns the number of the last.
    fn require_levels(&mut self, wanted: usize) -> usize {
        while self.levels.len() < wanted {
            let next = match self.levels.last() {
                Some(l) => halve(Raster {
                    width: l.width,
                    height: l.height,
                    pixels: &l.pixels,
                }),
                None => {
                    let (width, height, pixels) =
                        (self.photo.width(), self.photo.height(), self.photo.pixels());
                    halve(Raster {
                        width,
                        height,
                        pixels,
                    })
                }
            };
            let Some(next) = next else { break };
            self.levels.push(next);
        }
        wanted.min(self.levels.len())
    }
}

/// Pixels of a photo or of a reduction
#[derive(Clone, Copy)]
struct Raster<'a, T> {
    width: usize,
    height: usize,
    pixels: &'a [[T; 3]],
}

/// Averages squares of 2 x 2 pixels; an odd last row or column is dropped. `None` if a side has one pixel.
fn halve<T: Copy>(raster: Raster<T>) -> Option<Level>
where
    f32: From<T>,
{
    let (width, height) = (raster.width / 2, raster.height / 2);
    if width == 0 || height == 0 {
        return None;
    }
    let mut pixels = Vec::with_capacity(width * height);
    for rows in raster.pixels.chunks_exact(2 * raster.width).take(height) {
        let (top, bottom) = rows.split_at(raster.width);
        for (top, bottom) in top.as_chunks::<2>().0.iter().zip(bottom.as_chunks::<2>().0) {
            let sum = |c: usize| {
                f32::from(top[0][c])
                    + f32::from(top[1][c])
                    + f32::from(bottom[0][c])
                    + f32::from(bottom[1][c])
            };
            pixels.push([sum(0) / 4.0, sum(1) / 4.0, sum(2) / 4.0]);
        }
    }
    Some(Level {
        width,
        height,
        pixels,
    })
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
    use super::Pyramid;
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
