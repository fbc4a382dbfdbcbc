//! The background plate: what a static camera sees behind the person.

use pirouette_geom::{Grid, Mask};
use rayon::prelude::*;

/// Color and spread of the background, per pixel, from all views that see it
#[derive(Debug, Clone)]
pub struct BackgroundPlate {
    colors: Grid<[u8; 3]>,
    /// In levels
    sigmas: Grid<f32>,
    /// Views that see the background here, at most 255
    counts: Grid<u8>,
    unrest: f32,
}

/// How a [`BackgroundPlate`] is made
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateOptions {
    /// Least standard deviation, in levels; below, noise of the camera counts as person
    pub min_sigma: f32,
    /// How much wider than the spread between the views the background is taken; shadows of the person
    /// differ from view to view
    pub spread_factor: f32,
}

impl Default for PlateOptions {
    fn default() -> Self {
        Self {
            min_sigma: 4.0,
            spread_factor: 1.25,
        }
    }
}

/// Fewer views than this give a median but no spread
const MIN_VIEWS_FOR_SPREAD: usize = 4;

/// Without a spread, the least standard deviation times this
const UNKNOWN_SPREAD: f32 = 1.6;

/// Standard deviation of a Gaussian over its median absolute deviation
const SIGMA_PER_MAD: f32 = 1.4826;

/// Blur of the standard deviations, in px; the median of few views is itself noisy
const SIGMA_BLUR_PX: f32 = 2.0;

/// Share of the pixels that may move without the photos being called unsteady
const UNREST_QUANTILE: f64 = 0.9;

impl BackgroundPlate {
    /// The median over the views in which a pixel is surely background
    ///
    /// `backgrounds` holds one mask per photo, `true` where it is surely background. All have one size;
    /// views of another size than the first are left out. `None` for no view.
    pub fn estimate(views: &[(&Grid<[u8; 3]>, &Mask)], options: &PlateOptions) -> Option<Self> {
        let (first, _) = views.first()?;
        let (width, height) = (first.width(), first.height());
        let views: Vec<_> = views
            .iter()
            .filter(|(photo, mask)| photo.same_size(first) && mask.same_size(first))
            .take(255)
            .collect();
        let mut colors = Grid::filled(width, height, [0_u8; 3]);
        let mut sigmas = Grid::filled(width, height, 0.0_f32);
        let mut counts = Grid::filled(width, height, 0_u8);
        if width == 0 || height == 0 {
            return None;
        }
        // spreads in quarter levels, so that their quantile needs no sorting
        let histogram = colors
            .as_mut_slice()
            .par_chunks_mut(width)
            .zip(sigmas.as_mut_slice().par_chunks_mut(width))
            .zip(counts.as_mut_slice().par_chunks_mut(width))
            .enumerate()
            .map(|(y, ((colors, sigmas), counts))| {
                let mut histogram = vec![0_usize; 1024];
                let mut seen = Vec::with_capacity(views.len());
                let mut values = vec![0_u8; views.len()];
                let mut deviations = vec![0_u16; views.len()];
                let rows: Vec<_> = views.iter().map(|(p, m)| (p.row(y), m.row(y))).collect();
                for x in 0..width {
                    seen.clear();
                    seen.extend(rows.iter().filter(|(_, m)| m[x]).map(|(p, _)| p[x]));
                    counts[x] = seen.len() as u8;
                    sigmas[x] = options.min_sigma * UNKNOWN_SPREAD;
                    if seen.is_empty() {
                        continue;
                    }
                    for channel in 0..3 {
                        for (value, color) in values.iter_mut().zip(&seen) {
                            *value = color[channel];
                        }
                        colors[x][channel] = median_u8(&mut values[..seen.len()]);
                    }
                    if seen.len() < MIN_VIEWS_FOR_SPREAD {
                        continue;
                    }
                    for (deviation, color) in deviations.iter_mut().zip(&seen) {
                        *deviation = (0..3)
                            .map(|c| u16::from(color[c].abs_diff(colors[x][c])))
                            .sum();
                    }
                    let mad = f32::from(median_u16(&mut deviations[..seen.len()])) / 3.0;
                    histogram[((mad * 4.0) as usize).min(1023)] += 1;
                    let sigma = mad * SIGMA_PER_MAD * options.spread_factor;
                    sigmas[x] = sigma.max(options.min_sigma);
                }
                histogram
            })
            .reduce(
                || vec![0; 1024],
                |mut a, b| {
                    a.iter_mut().zip(&b).for_each(|(a, b)| *a += b);
                    a
                },
            );
        let total: usize = histogram.iter().sum();
        let mut below = 0;
        let unrest = histogram.iter().position(|&n| {
            below += n;
            total > 0 && below as f64 >= UNREST_QUANTILE * total as f64
        });
        blur(&mut sigmas, SIGMA_BLUR_PX);
        Some(Self {
            colors,
            sigmas,
            counts,
            unrest: unrest.unwrap_or(0) as f32 / 4.0,
        })
    }

    /// How much the background differs between the views, in levels: nine pixels of ten deviate less
    ///
    /// A few levels for a static camera; far more when the camera moved. 0 when no pixel is seen by four
    /// views.
    pub fn unrest(&self) -> f32 {
        self.unrest
    }

    /// Color of the background at a pixel of the photo, `None` where no view sees it
    pub fn color(&self, x: usize, y: usize) -> Option<[u8; 3]> {
        (self.counts[(x, y)] > 0).then(|| self.colors[(x, y)])
    }

    /// Standard deviation of the background's color at a pixel, in levels
    pub fn sigma(&self, x: usize, y: usize) -> f32 {
        self.sigmas[(x, y)]
    }

    /// Natural logarithm of the density of a color at a pixel, `None` where no view sees the background
    pub fn log_density(&self, x: usize, y: usize, color: [u8; 3]) -> Option<f32> {
        let plate = self.color(x, y)?;
        let sigma = self.sigma(x, y);
        // 1.5 ln(2 pi)
        const LOG_NORM: f32 = 2.756_815_6;
        let distance = squared_distance(color, plate) as f32;
        Some(-0.5 * distance / (sigma * sigma) - 3.0 * sigma.ln() - LOG_NORM)
    }
}

/// Squared distance of two colors, in squared levels
pub(crate) fn squared_distance(a: [u8; 3], b: [u8; 3]) -> u32 {
    let mut sum = 0;
    for channel in 0..3 {
        let d = u32::from(a[channel].abs_diff(b[channel]));
        sum += d * d;
    }
    sum
}

/// Insertion sort; fastest for the handful of views
fn sort_few<T: Copy + PartialOrd>(values: &mut [T]) {
    for i in 1..values.len() {
        let value = values[i];
        let mut j = i;
        while j > 0 && values[j - 1] > value {
            values[j] = values[j - 1];
            j -= 1;
        }
        values[j] = value;
    }
}

fn median_u8(values: &mut [u8]) -> u8 {
    sort_few(values);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 {
        values[middle]
    } else {
        values[middle - 1].midpoint(values[middle])
    }
}

fn median_u16(values: &mut [u16]) -> u16 {
    sort_few(values);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 {
        values[middle]
    } else {
        values[middle - 1].midpoint(values[middle])
    }
}

/// Gaussian blur in place; values beyond the border repeat the outermost ones
pub(crate) fn blur(grid: &mut Grid<f32>, sigma: f32) {
    let (width, height) = (grid.width(), grid.height());
    let kernel = gaussian_kernel(sigma);
    let radius = kernel.len() - 1;
    if radius == 0 || width == 0 || height == 0 {
        return;
    }
    grid.as_mut_slice().par_chunks_mut(width).for_each(|row| {
        let mut padded = vec![0.0; width + 2 * radius];
        padded[..radius].fill(row[0]);
        padded[radius..radius + width].copy_from_slice(row);
        padded[radius + width..].fill(row[width - 1]);
        for (x, value) in row.iter_mut().enumerate() {
            let mut sum = kernel[0] * padded[x + radius];
            for (offset, weight) in kernel.iter().enumerate().skip(1) {
                sum += weight * (padded[x + radius - offset] + padded[x + radius + offset]);
            }
            *value = sum;
        }
    });
    // down the columns, keeping only the rows above that are still needed
    let clamp_row = |y: isize| y.clamp(0, height as isize - 1) as usize;
    let mut above: std::collections::VecDeque<Vec<f32>> =
        (0..radius).map(|_| grid.row(0).to_vec()).collect();
    let mut sums = vec![0.0_f32; width];
    for y in 0..height {
        for (sum, value) in sums.iter_mut().zip(grid.row(y)) {
            *sum = kernel[0] * value;
        }
        for (offset, &weight) in kernel.iter().enumerate().skip(1) {
            let below = grid.row(clamp_row(y as isize + offset as isize));
            let before = &above[radius - offset];
            for ((sum, a), b) in sums.iter_mut().zip(before).zip(below) {
                *sum += weight * (a + b);
            }
        }
        if let Some(mut oldest) = above.pop_front() {
            oldest.copy_from_slice(grid.row(y));
            above.push_back(oldest);
        }
        grid.row_mut(y).copy_from_slice(&sums);
    }
}

/// One half of a Gaussian that sums to one over both halves, cut off at three sigma
fn gaussian_kernel(sigma: f32) -> Vec<f32> {
    let radius = (3.0 * sigma).ceil().max(0.0) as usize;
    let mut kernel: Vec<f32> = (0..=radius)
        .map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp())
        .collect();
    let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
    kernel.iter_mut().for_each(|w| *w /= sum);
    kernel
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_forgets_the_person() {
        let wall = Grid::filled(4, 4, [100, 120, 140]);
        let mut person = wall.clone();
        person[(1, 1)] = [10, 10, 10];
        let all = Mask::filled(4, 4, true);
        let views = [(&wall, &all), (&person, &all), (&wall, &all), (&wall, &all)];
        let plate = BackgroundPlate::estimate(&views, &PlateOptions::default()).unwrap();
        assert_eq!(plate.color(1, 1), Some([100, 120, 140]));
        assert!((plate.sigma(1, 1) - 4.0).abs() < 1e-5);
        assert_eq!(plate.unrest(), 0.0);
    }

    #[test]
    fn pixels_that_no_view_sees_have_no_color() {
        let photo = Grid::filled(2, 1, [9, 9, 9]);
        let seen = Mask::from_art("#.");
        let plate =
            BackgroundPlate::estimate(&[(&photo, &seen)], &PlateOptions::default()).unwrap();
        assert_eq!(plate.color(0, 0), Some([9, 9, 9]));
        assert_eq!(plate.color(1, 0), None);
        assert_eq!(plate.log_density(1, 0, [9, 9, 9]), None);
        assert!((plate.sigma(0, 0) - 6.4).abs() < 1e-5);
    }

    #[test]
    fn a_moving_camera_is_restless() {
        let photos: Vec<_> = (0..6_usize)
            .map(|shift| {
                Grid::from_fn(40, 30, |x, y| {
                    [((x + 3 * shift) * 37 % 200) as u8, (y * 53 % 170) as u8, 90]
                })
            })
            .collect();
        let all = Mask::filled(40, 30, true);
        let views: Vec<_> = photos.iter().map(|p| (p, &all)).collect();
        let moving = BackgroundPlate::estimate(&views, &PlateOptions::default()).unwrap();
        let views: Vec<_> = photos.iter().map(|_| (&photos[0], &all)).collect();
        let still = BackgroundPlate::estimate(&views, &PlateOptions::default()).unwrap();
        assert!(moving.unrest() > 12.0 && still.unrest() < 1.0);
    }

    #[test]
    fn views_of_another_size_are_left_out() {
        let (large, small) = (Grid::filled(3, 3, [7; 3]), Grid::filled(2, 2, [200; 3]));
        let (all, few) = (Mask::filled(3, 3, true), Mask::filled(2, 2, true));
        let views = [(&large, &all), (&small, &few)];
        let plate = BackgroundPlate::estimate(&views, &PlateOptions::default()).unwrap();
        assert_eq!(plate.color(0, 0), Some([7; 3]));
        assert!(BackgroundPlate::estimate(&[], &PlateOptions::default()).is_none());
        let none = (&Grid::from_vec(0, 0, vec![]), &Mask::filled(0, 0, true));
        assert!(BackgroundPlate::estimate(&[none], &PlateOptions::default()).is_none());
    }

    #[test]
    fn blurring_keeps_the_sum_and_flat_grids() {
        let mut flat = Grid::filled(5, 7, 3.0);
        blur(&mut flat, 2.0);
        assert!(flat.as_slice().iter().all(|v| (v - 3.0).abs() < 1e-5));
        let mut point = Grid::filled(31, 31, 0.0);
        point[(15, 15)] = 1.0;
        blur(&mut point, 2.0);
        let sum: f32 = point.as_slice().iter().sum();
        assert!((sum - 1.0).abs() < 1e-5);
        assert!((point[(13, 15)] - point[(15, 17)]).abs() < 1e-7);
        assert!((point[(15, 15)] - 1.0 / (8.0 * std::f32::consts::PI)).abs() < 1e-3);
    }
}
