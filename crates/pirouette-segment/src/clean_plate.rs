//! The clean plate: the background behind the person, as seen by a static camera.

use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask};

use crate::log_domain::{ln_of_positive, log_sum_exp};
use crate::seeds::Window;

/// Color and standard deviation of the background per pixel, from all views that see it
#[derive(Debug, Clone)]
pub struct CleanPlate {
    colors: Grid<[u8; 3]>,
    /// In levels
    sigmas: Grid<f32>,
    /// Number of views that see the background at a pixel, or [`FILLED`]
    counts: Grid<u8>,
    noise_level: f32,
}

/// Options of [`CleanPlate::estimate`]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CleanPlateOptions {
    /// Minimum standard deviation, in levels; below, camera noise counts as person
    pub min_sigma: f32,
    /// Factor from the spread between the views to the standard deviation; above 1, since shadows of the person differ
    /// between views
    pub spread_factor: f32,
}

impl Default for CleanPlateOptions {
    fn default() -> Self {
        Self {
            min_sigma: 4.0,
            spread_factor: 1.25,
        }
    }
}

/// With fewer views than this, only the median is estimated
const MIN_VIEWS_FOR_SPREAD: usize = 4;

/// Standard deviation without a spread, relative to the minimum
const UNKNOWN_SPREAD: f32 = 1.6;

/// Count of a pixel that no view sees, filled in from a picture without the person
const FILLED: u8 = u8::MAX;

/// Standard deviation of a Gaussian, relative to its median absolute deviation
const SIGMA_PER_MAD: f32 = 1.4826;

/// Every so many pixels, a picture of the background is compared with the views, at this many pixels at least
const COMPARED_STEP: usize = 7;
const MIN_COMPARED: usize = 200;

/// Blur of the standard deviations, in px; the median of few views is noisy
const SIGMA_BLUR_PX: f32 = 2.0;

/// Quantile of the deviations that gives the noise level
const NOISE_QUANTILE: f64 = 0.9;

impl CleanPlate {
    /// Computes the median over the views in which a pixel is definitely background
    ///
    /// Each view is a photo and its mask, `true` where it definitely shows background. Views that differ in size from
    /// the first are ignored. `None` without views.
    pub fn estimate(views: &[BackgroundView], options: &CleanPlateOptions) -> Option<Self> {
        let (first, _) = views.first()?;
        let (width, height) = (first.width(), first.height());
        let views: Vec<BackgroundView> = views
            .iter()
            .copied()
            .filter(|(photo, mask)| photo.same_size(first) && mask.same_size(first))
            .take(usize::from(FILLED) - 1)
            .collect();
        let mut colors = Grid::filled(width, height, [0_u8; 3]);
        let mut sigmas = Grid::filled(width, height, 0.0_f32);
        let mut counts = Grid::filled(width, height, 0_u8);
        if width == 0 || height == 0 {
            return None;
        }
        let network = sorting_network(views.len());
        // deviations in quarter levels, so that their quantile needs no sorting
        let histogram = colors
            .as_mut_slice()
            .par_chunks_mut(width)
            .zip(sigmas.as_mut_slice().par_chunks_mut(width))
            .zip(counts.as_mut_slice().par_chunks_mut(width))
            .enumerate()
            .fold(
                || (vec![0_usize; 1024], RowSorter::new(views.len(), width)),
                |(mut histogram, mut sorter), (y, ((colors, sigmas), counts))| {
                    sorter.medians(&views, y, &network, colors, counts);
                    let deviations = sorter.median_deviations(&views, y, &network, colors, counts);
                    for ((sigma, &deviation), &count) in
                        sigmas.iter_mut().zip(deviations).zip(counts.iter())
                    {
                        if usize::from(count) < MIN_VIEWS_FOR_SPREAD {
                            *sigma = options.min_sigma * UNKNOWN_SPREAD;
                            continue;
                        }
                        let mad = f32::from(deviation) / 3.0;
                        histogram[((mad * 4.0) as usize).min(1023)] += 1;
                        let spread = mad * SIGMA_PER_MAD * options.spread_factor;
                        *sigma = spread.max(options.min_sigma);
                    }
                    (histogram, sorter)
                },
            )
            .map(|(histogram, _)| histogram)
            .reduce(
                || vec![0; 1024],
                |mut a, b| {
                    a.iter_mut().zip(&b).for_each(|(a, b)| *a += b);
                    a
                },
            );
        let total: usize = histogram.iter().sum();
        let mut below = 0;
        let noise_level = histogram.iter().position(|&n| {
            below += n;
            total > 0 && below as f64 >= NOISE_QUANTILE * total as f64
        });
        blur(&mut sigmas, SIGMA_BLUR_PX);
        Some(Self {
            colors,
            sigmas,
            counts,
            noise_level: noise_level.unwrap_or(0) as f32 / 4.0,
        })
    }

    /// Fills in the pixels that no view sees from a picture of the background, if it agrees with the views elsewhere
    ///
    /// `known` is where the picture shows the background. Another exposure is compensated for; a picture from another place,
    /// that differs by more than `max_deviation` levels from the views, is not used. Returns whether it was used.
    pub fn complete(
        &mut self,
        (photo, known): BackgroundView,
        max_deviation: f32,
        options: &CleanPlateOptions,
    ) -> bool {
        if !(photo.same_size(&self.colors) && known.same_size(&self.colors)) {
            return false;
        }
        let seen = self.colors.as_slice().iter().zip(self.counts.as_slice());
        let pairs: Vec<([u8; 3], [u8; 3])> = seen
            .zip(photo.as_slice().iter().zip(known.as_slice()))
            .step_by(COMPARED_STEP)
            .filter(|((_, count), (_, known))| **count > 0 && **known)
            .map(|((seen, _), (given, _))| (*seen, *given))
            .collect();
        if pairs.len() < MIN_COMPARED {
            return false;
        }
        let difference = |channel: usize, (seen, given): &([u8; 3], [u8; 3])| {
            i32::from(seen[channel]) - i32::from(given[channel])
        };
        let shift: [i32; 3] = std::array::from_fn(|channel| {
            let mut all: Vec<i32> = pairs.iter().map(|pair| difference(channel, pair)).collect();
            let middle = all.len() / 2;
            *all.select_nth_unstable(middle).1
        });
        let mut deviations: Vec<i32> = pairs
            .iter()
            .map(|pair| {
                (0..3)
                    .map(|c| (difference(c, pair) - shift[c]).abs())
                    .sum::<i32>()
            })
            .collect();
        let at = ((deviations.len() - 1) as f64 * NOISE_QUANTILE) as usize;
        let deviation = *deviations.select_nth_unstable(at).1 as f32 / 3.0;
        if deviation > max_deviation {
            return false;
        }
        let own = self.colors.as_mut_slice().iter_mut();
        let own = own
            .zip(self.counts.as_mut_slice())
            .zip(self.sigmas.as_mut_slice());
        for (((color, count), sigma), (given, &known)) in
            own.zip(photo.as_slice().iter().zip(known.as_slice()))
        {
            if *count == 0 && known {
                *color =
                    std::array::from_fn(|c| (i32::from(given[c]) + shift[c]).clamp(0, 255) as u8);
                *count = FILLED;
                *sigma = options.min_sigma * UNKNOWN_SPREAD;
            }
        }
        true
    }

    /// Returns the 90 % quantile of the deviations between the views, in levels
    ///
    /// A few levels for a static camera; far more when the camera moved. 0 if no pixel is seen by four views.
    pub fn noise_level(&self) -> f32 {
        self.noise_level
    }

    /// Returns the color of the background at a pixel of the photo, `None` where no view sees it
    pub fn color(&self, x: usize, y: usize) -> Option<[u8; 3]> {
        (self.counts[(x, y)] > 0).then(|| self.colors[(x, y)])
    }

    /// Returns row `y` of a window: background colors, and the number of views that see them
    pub(crate) fn row(&self, window: Window, y: usize) -> (&[[u8; 3]], &[u8]) {
        (window.row(&self.colors, y), window.row(&self.counts, y))
    }

    /// Returns the standard deviation of the background's color at a pixel, in levels
    pub fn sigma(&self, x: usize, y: usize) -> f32 {
        self.sigmas[(x, y)]
    }

    /// Mixes the clean plate into the logarithms of another density, for a run of pixels from `x`, `y` on
    ///
    /// `share` is the weight of the clean plate; where no view sees the background, the density is unchanged.
    pub(crate) fn mix_into(
        &self,
        (x, y): (usize, usize),
        colors: &[[u8; 3]],
        share: f32,
        log_densities: &mut [f32],
    ) {
        // 1.5 ln(2 pi)
        const LOG_NORM: f32 = 2.756_815_6;
        let columns = x..x + colors.len();
        let [own, other] = [share.ln() - LOG_NORM, (1.0 - share).ln()];
        for ((((density, color), clean_plate), &sigma), &count) in log_densities
            .iter_mut()
            .zip(colors)
            .zip(&self.colors.row(y)[columns.clone()])
            .zip(&self.sigmas.row(y)[columns.clone()])
            .zip(&self.counts.row(y)[columns])
        {
            let distance = squared_distance(*color, *clean_plate) as f32;
            let clean_plate = own - 0.5 * distance / (sigma * sigma) - 3.0 * ln_of_positive(sigma);
            let mixed = log_sum_exp(clean_plate, other + *density);
            *density = match count {
                0 => *density,
                // The picture lacks the shadows of the person: another color is no evidence for the person.
                FILLED => mixed.max(*density),
                _ => mixed,
            };
        }
    }

    /// Whether a color is within the noise of the background at a pixel
    pub(crate) fn is_background_color(&self, x: usize, y: usize, color: [u8; 3]) -> bool {
        /// In standard deviations
        const NOISE: f32 = 3.0;
        let reach = NOISE * self.sigma(x, y);
        self.color(x, y).is_some_and(|clean_plate| {
            (squared_distance(color, clean_plate) as f32) < reach * reach
        })
    }
}

/// Returns the squared distance of two colors, in squared levels
pub(crate) fn squared_distance(a: [u8; 3], b: [u8; 3]) -> u32 {
    let mut sum = 0;
    for channel in 0..3 {
        let d = u32::from(a[channel].abs_diff(b[channel]));
        sum += d * d;
    }
    sum
}

/// Returns the compare-exchange pairs, in order, that sort `count` values
///
/// # Source
/// K. Batcher 1968, "Sorting networks and their applications": merge exchange, for any count as in D. Knuth, The Art of
/// Computer Programming, volume 3, section 5.2.2, algorithm M.
fn sorting_network(count: usize) -> Vec<[usize; 2]> {
    let mut pairs = Vec::new();
    let top = count.next_power_of_two() / 2;
    let mut p = top;
    while p > 0 {
        let (mut q, mut r, mut step) = (top, 0, p);
        loop {
            let from = (0..count.saturating_sub(step)).filter(|i| i & p == r);
            pairs.extend(from.map(|i| [i, i + step]));
            if q == p {
                break;
            }
            step = q - p;
            q /= 2;
            r = p;
        }
        p /= 2;
    }
    pairs
}

/// Sorts the values of all rows at each position, vectorized over the positions
fn sort_across<T: Ord + Copy>(rows: &mut [Vec<T>], network: &[[usize; 2]]) {
    for &[low, high] in network {
        let (left, right) = rows.split_at_mut(high);
        for (a, b) in left[low].iter_mut().zip(&mut right[0]) {
            (*a, *b) = ((*a).min(*b), (*a).max(*b));
        }
    }
}

/// A photo, and where it definitely shows background
pub type BackgroundView<'a> = (&'a Grid<[u8; 3]>, &'a Mask);

/// Computes medians over the views, one row of the photos at a time; unseen values are sorted to the end
struct RowSorter {
    levels: Vec<Vec<u8>>,
    deviations: Vec<Vec<u16>>,
    medians: Vec<u16>,
}

impl RowSorter {
    fn new(views: usize, width: usize) -> Self {
        Self {
            levels: vec![vec![0; 3 * width]; views],
            deviations: vec![vec![0; width]; views],
            medians: vec![0; width],
        }
    }

    /// Computes the median color of each pixel over the views that see it, and counts these views
    fn medians(
        &mut self,
        views: &[BackgroundView],
        y: usize,
        network: &[[usize; 2]],
        colors: &mut [[u8; 3]],
        counts: &mut [u8],
    ) {
        counts.fill(0);
        for (levels, (photo, mask)) in self.levels.iter_mut().zip(views) {
            let (photo, mask) = (photo.row(y), mask.row(y));
            let pixels = levels.as_chunks_mut::<3>().0.iter_mut();
            for (((level, color), &seen), count) in pixels.zip(photo).zip(mask).zip(&mut *counts) {
                let unseen = u8::from(seen).wrapping_sub(1);
                *level = color.map(|c| c | unseen);
                *count += u8::from(seen);
            }
        }
        sort_across(&mut self.levels, network);
        for (x, (color, &count)) in colors.iter_mut().zip(&*counts).enumerate() {
            let (low, high) = middle_indices(count);
            for (channel, level) in color.iter_mut().enumerate() {
                let at = 3 * x + channel;
                *level = self.levels[low][at].midpoint(self.levels[high][at]);
            }
        }
    }

    /// Computes the median of each pixel's distance to `colors`, summed over the channels
    fn median_deviations(
        &mut self,
        views: &[BackgroundView],
        y: usize,
        network: &[[usize; 2]],
        colors: &[[u8; 3]],
        counts: &[u8],
    ) -> &[u16] {
        for (deviations, (photo, mask)) in self.deviations.iter_mut().zip(views) {
            let (photo, mask) = (photo.row(y), mask.row(y));
            for (((deviation, color), clean_plate), &seen) in
                deviations.iter_mut().zip(photo).zip(colors).zip(mask)
            {
                let distance = |c: usize| u16::from(color[c].abs_diff(clean_plate[c]));
                let unseen = u16::from(seen).wrapping_sub(1);
                *deviation = (distance(0) + distance(1) + distance(2)) | unseen;
            }
        }
        sort_across(&mut self.deviations, network);
        for (x, (median, &count)) in self.medians.iter_mut().zip(counts).enumerate() {
            let (low, high) = middle_indices(count);
            *median = self.deviations[low][x].midpoint(self.deviations[high][x]);
        }
        &self.medians
    }
}

/// Returns the two middle_indices indices of `count` sorted values
fn middle_indices(count: u8) -> (usize, usize) {
    let count = usize::from(count);
    (count.saturating_sub(1) / 2, count / 2)
}

/// Blurs in place with a Gaussian; values beyond the border repeat the outermost ones
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
    // along the columns, storing only the rows above that are still needed
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

/// Returns one half of a Gaussian kernel with sum one over both halves, cut off at three sigma
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
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_median_removes_the_person() {
        let wall = Grid::filled(4, 4, [100, 120, 140]);
        let mut person = wall.clone();
        person[(1, 1)] = [10, 10, 10];
        let all = Mask::filled(4, 4, true);
        let views = [(&wall, &all), (&person, &all), (&wall, &all), (&wall, &all)];
        let clean_plate = CleanPlate::estimate(&views, &CleanPlateOptions::default()).unwrap();
        assert_eq!(clean_plate.color(1, 1), Some([100, 120, 140]));
        assert!((clean_plate.sigma(1, 1) - 4.0).abs() < 1e-5);
        assert_eq!(clean_plate.noise_level(), 0.0);
    }

    proptest! {
        #[test]
        fn medians_match_those_of_sorted_values(
            pixels in prop::collection::vec(
                prop::collection::vec((prop::array::uniform3(any::<u8>()), any::<bool>()), 5),
                1..12,
            ),
        ) {
            let views: Vec<(Grid<[u8; 3]>, Mask)> = pixels
                .iter()
                .map(|row| {
                    let (colors, seen) = row.iter().copied().unzip();
                    (Grid::from_vec(5, 1, colors), Mask::from_vec(5, 1, seen))
                })
                .collect();
            let views: Vec<_> = views.iter().map(|(photo, mask)| (photo, mask)).collect();
            let options = CleanPlateOptions { min_sigma: 0.0, spread_factor: 1.0 };
            let clean_plate = CleanPlate::estimate(&views, &options).unwrap();
            for x in 0..5 {
                let seen: Vec<[u8; 3]> =
                    pixels.iter().filter(|row| row[x].1).map(|row| row[x].0).collect();
                let expected = (!seen.is_empty()).then(|| {
                    [0, 1, 2].map(|c| {
                        let mut levels: Vec<u8> = seen.iter().map(|color| color[c]).collect();
                        levels.sort_unstable();
                        levels[(levels.len() - 1) / 2].midpoint(levels[levels.len() / 2])
                    })
                });
                prop_assert_eq!(clean_plate.color(x, 0), expected);
            }
        }
    }

    #[test]
    fn a_sorting_network_sorts_any_number_of_rows() {
        for count in 0..40_u32 {
            let mut rows: Vec<Vec<u32>> = (0..count)
                .map(|i| (0..9).map(|x| (i + 1) * (37 + x) % 41).collect())
                .collect();
            let mut expected = rows.clone();
            for x in 0..9 {
                let mut column: Vec<u32> = rows.iter().map(|row| row[x]).collect();
                column.sort_unstable();
                for (row, value) in expected.iter_mut().zip(column) {
                    row[x] = value;
                }
            }
            sort_across(&mut rows, &sorting_network(count as usize));
            assert_eq!(rows, expected);
        }
    }

    #[test]
    fn a_picture_of_the_room_completes_the_plate_in_its_exposure_unless_it_is_of_another_place() {
        let room = Grid::from_fn(60, 40, |x, y| [60 + x as u8, 80 + y as u8, 90]);
        let beside = Mask::from_fn(60, 40, |x, _| x.abs_diff(30) > 8);
        let options = CleanPlateOptions::default();
        let views = [(&room, &beside); 4];
        let plate = CleanPlate::estimate(&views, &options).unwrap();
        assert_eq!(plate.color(30, 20), None);
        let brighter = room.map(|color| color.map(|level| level + 10));
        let known = Mask::from_fn(60, 40, |_, y| y > 5);
        let mut completed = plate.clone();
        assert!(completed.complete((&brighter, &known), 12.0, &options));
        assert_eq!(completed.color(30, 20), Some(room[(30, 20)]));
        assert_eq!(completed.color(30, 3), None);
        assert_eq!(completed.color(2, 20), Some(room[(2, 20)]));
        let elsewhere = Grid::from_fn(60, 40, |x, y| [(4 * x) as u8, (200 - 4 * y) as u8, 30]);
        let all = Mask::filled(60, 40, true);
        let mut unchanged = plate.clone();
        assert!(!unchanged.complete((&elsewhere, &all), 12.0, &options));
        assert_eq!(unchanged.color(30, 20), None);
        assert!(!unchanged.complete((&room, &Mask::filled(60, 40, false)), 12.0, &options));
        assert!(!unchanged.complete(
            (&Grid::filled(3, 3, [0; 3]), &Mask::filled(3, 3, true)),
            12.0,
            &options
        ));
    }

    #[test]
    fn pixels_that_no_view_sees_have_no_color() {
        let photo = Grid::filled(2, 1, [9, 9, 9]);
        let seen = Mask::from_art("#.");
        let clean_plate =
            CleanPlate::estimate(&[(&photo, &seen)], &CleanPlateOptions::default()).unwrap();
        assert_eq!(clean_plate.color(0, 0), Some([9, 9, 9]));
        assert_eq!(clean_plate.color(1, 0), None);
        let mut densities = [-20.0, -20.0];
        clean_plate.mix_into((0, 0), &[[9, 9, 9]; 2], 0.5, &mut densities);
        let seen = -1.5 * (2.0 * std::f32::consts::PI * 6.4 * 6.4).ln() + 0.5_f32.ln();
        assert!((densities[0] - seen).abs() < 1e-3, "{densities:?}");
        assert_eq!(densities[1], -20.0);
        assert!(clean_plate.is_background_color(0, 0, [15, 15, 9]));
        assert!(
            !clean_plate.is_background_color(0, 0, [29, 9, 9])
                && !clean_plate.is_background_color(1, 0, [9, 9, 9])
        );
        assert!((clean_plate.sigma(0, 0) - 6.4).abs() < 1e-5);
    }

    #[test]
    fn a_moving_camera_has_a_high_noise_level() {
        let photos: Vec<_> = (0..6_usize)
            .map(|shift| {
                Grid::from_fn(40, 30, |x, y| {
                    [((x + 3 * shift) * 37 % 200) as u8, (y * 53 % 170) as u8, 90]
                })
            })
            .collect();
        let all = Mask::filled(40, 30, true);
        let views: Vec<_> = photos.iter().map(|p| (p, &all)).collect();
        let moving = CleanPlate::estimate(&views, &CleanPlateOptions::default()).unwrap();
        let views: Vec<_> = photos.iter().map(|_| (&photos[0], &all)).collect();
        let still = CleanPlate::estimate(&views, &CleanPlateOptions::default()).unwrap();
        assert!(moving.noise_level() > 12.0 && still.noise_level() < 1.0);
    }

    #[test]
    fn views_of_another_size_are_ignored() {
        let (large, small) = (Grid::filled(3, 3, [7; 3]), Grid::filled(2, 2, [200; 3]));
        let (all, few) = (Mask::filled(3, 3, true), Mask::filled(2, 2, true));
        let views = [(&large, &all), (&small, &few)];
        let clean_plate = CleanPlate::estimate(&views, &CleanPlateOptions::default()).unwrap();
        assert_eq!(clean_plate.color(0, 0), Some([7; 3]));
        assert!(CleanPlate::estimate(&[], &CleanPlateOptions::default()).is_none());
        let none = (&Grid::from_vec(0, 0, vec![]), &Mask::filled(0, 0, true));
        assert!(CleanPlate::estimate(&[none], &CleanPlateOptions::default()).is_none());
    }

    #[test]
    fn blurring_preserves_the_sum_and_flat_grids() {
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
