//! Gaussian mixtures of the colors of person and background.
//!
//! All densities are logarithms. Fitting is deterministic: the random start has a fixed seed.

use crate::log_domain::{exp_of_negative, ln_of_positive};

/// A mixture of Gaussians with full covariances over RGB colors, levels 0 to 255
#[derive(Debug, Clone)]
pub struct ColorModel {
    components: Vec<Gaussian>,
}

/// Options of [`ColorModel::fit`]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorModelOptions {
    /// Number of Gaussians; more represent patterned clothes better and need more samples
    pub components: usize,
    /// Rounds of assigning each sample to its likeliest Gaussian and refitting, after k-means
    pub assignments: usize,
    /// Added to every variance, in squared levels; bounds the density of flat colors
    pub added_variance: f64,
}

impl Default for ColorModelOptions {
    fn default() -> Self {
        Self {
            components: 6,
            assignments: 3,
            added_variance: 2.0,
        }
    }
}

/// Larger sample sets are subsampled; the fit does not improve with more
const MAX_SAMPLES: usize = 20_000;

/// Minimum samples of a cluster; smaller ones have no meaningful covariance and are dropped
const MIN_CLUSTER: usize = 8;

/// Maximum number of Gaussians; bounds the scratch space of an evaluation
const MAX_COMPONENTS: usize = 16;

/// Rounds of k-means before fitting Gaussians
const KMEANS_ROUNDS: usize = 10;

/// Random starts of k-means; the one with the smallest spread is used
const KMEANS_STARTS: u64 = 2;

/// Pixels evaluated together, for vectorization
const LANES: usize = 16;

/// One weighted Gaussian, ready for evaluation
#[derive(Debug, Clone, Copy)]
struct Gaussian {
    mean: [f32; 3],
    /// Upper triangular `R`, row by row, with density proportional to `exp(-|R (x - mean)|^2)`
    root: [f32; 6],
    /// Logarithm of weight times normalization
    log_weight: f32,
}

impl ColorModel {
    /// Fits a mixture to sampled colors; `None` for fewer than eight samples
    ///
    /// # Source
    /// Start: D. Arthur, S. Vassilvitskii, 2007, k-means++. Hard assignments as in C. Rother, V. Kolmogorov,
    /// A. Blake, 2004, GrabCut.
    pub fn fit(samples: &[[u8; 3]], options: &ColorModelOptions) -> Option<Self> {
        let mut random = SplitMix(1);
        let samples = subsample(samples, &mut random);
        if samples.len() < MIN_CLUSTER {
            return None;
        }
        let count = options.components.clamp(1, MAX_COMPONENTS);
        let mut labels = (0..KMEANS_STARTS)
            .map(|_| k_means(&samples, count, &mut random))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(labels, _)| labels)?;
        let mut model = Self::from_labels(&samples, &labels, count, options.added_variance);
        for _ in 1..options.assignments.max(1) {
            model.assign(&samples, &mut labels);
            model = Self::from_labels(&samples, &labels, count, options.added_variance);
        }
        (!model.components.is_empty()).then_some(model)
    }

    /// Returns the natural logarithm of the density at one color
    pub fn log_density(&self, color: [u8; 3]) -> f32 {
        let mut out = [0.0];
        self.log_densities(&[color], &mut out);
        out[0]
    }

    /// Computes the natural logarithm of the density at many colors
    ///
    /// # Panics
    /// When `colors` and `out` differ in length.
    pub fn log_densities<T: Copy + Into<f32>>(&self, colors: &[[T; 3]], out: &mut [f32]) {
        assert_eq!(colors.len(), out.len(), "one density per color");
        let mut parts = [[0.0_f32; LANES]; MAX_COMPONENTS];
        for (colors, out) in colors.chunks(LANES).zip(out.chunks_mut(LANES)) {
            let planes = to_planes(colors);
            let parts = &mut parts[..self.components.len()];
            let mut largest = [f32::NEG_INFINITY; LANES];
            for (component, part) in self.components.iter().zip(parts.iter_mut()) {
                component.evaluate(&planes, part);
                for lane in 0..LANES {
                    largest[lane] = largest[lane].max(part[lane]);
                }
            }
            let mut sum = [0.0_f32; LANES];
            for part in parts.iter() {
                for lane in 0..LANES {
                    sum[lane] += exp_of_negative(part[lane] - largest[lane]);
                }
            }
            for (lane, out) in out.iter_mut().enumerate() {
                *out = largest[lane] + ln_of_positive(sum[lane]);
            }
        }
    }

    /// Assigns each sample to the Gaussian with the largest weighted density
    fn assign(&self, samples: &[[u8; 3]], labels: &mut [u8]) {
        let mut part = [0.0_f32; LANES];
        for (colors, labels) in samples.chunks(LANES).zip(labels.chunks_mut(LANES)) {
            let planes = to_planes(colors);
            let mut largest = [f32::NEG_INFINITY; LANES];
            for (index, component) in self.components.iter().enumerate() {
                component.evaluate(&planes, &mut part);
                for (lane, label) in labels.iter_mut().enumerate() {
                    if part[lane] > largest[lane] {
                        largest[lane] = part[lane];
                        *label = index as u8;
                    }
                }
            }
        }
    }

    fn from_labels(samples: &[[u8; 3]], labels: &[u8], count: usize, added_variance: f64) -> Self {
        let mut moments = vec![Moments::default(); count];
        for (&color, &label) in samples.iter().zip(labels) {
            moments[usize::from(label)].add(color);
        }
        // if all clusters are too small, the largest is kept
        let limit = MIN_CLUSTER.min(moments.iter().map(|m| m.count).max().unwrap_or(0));
        let components = moments
            .iter()
            .filter(|m| m.count >= limit.max(1))
            .map(|m| m.gaussian(samples.len(), added_variance))
            .collect();
        Self { components }
    }
}

impl Gaussian {
    fn evaluate(&self, planes: &[[f32; LANES]; 3], out: &mut [f32; LANES]) {
        let [r00, r01, r02, r11, r12, r22] = self.root;
        for lane in 0..LANES {
            let x = planes[0][lane] - self.mean[0];
            let y = planes[1][lane] - self.mean[1];
            let z = planes[2][lane] - self.mean[2];
            let a = r00 * x + r01 * y + r02 * z;
            let b = r11 * y + r12 * z;
            let c = r22 * z;
            out[lane] = self.log_weight - (a * a + b * b + c * c);
        }
    }
}

/// Converts colors to three planes; unused lanes are black
fn to_planes<T: Copy + Into<f32>>(colors: &[[T; 3]]) -> [[f32; LANES]; 3] {
    let mut planes = [[0.0; LANES]; 3];
    for (lane, color) in colors.iter().enumerate() {
        for channel in 0..3 {
            planes[channel][lane] = color[channel].into();
        }
    }
    planes
}

/// Count, sum and sum of products of colors
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: usize,
    sum: [f64; 3],
    /// xx, xy, xz, yy, yz, zz
    products: [f64; 6],
}

impl Moments {
    fn add(&mut self, color: [u8; 3]) {
        let [x, y, z] = color.map(f64::from);
        self.count += 1;
        for (sum, value) in self.sum.iter_mut().zip([x, y, z]) {
            *sum += value;
        }
        let products = [x * x, x * y, x * z, y * y, y * z, z * z];
        for (sum, value) in self.products.iter_mut().zip(products) {
            *sum += value;
        }
    }

    /// Fits a Gaussian to these colors among `total` samples
    fn gaussian(&self, total: usize, added_variance: f64) -> Gaussian {
        let n = self.count as f64;
        let mean = self.sum.map(|s| s / n);
        let unbiased = (n - 1.0).max(1.0);
        let covariance = |index: usize, i: usize, j: usize| {
            (self.products[index] - n * mean[i] * mean[j]) / unbiased
        };
        let added = added_variance.max(f64::MIN_POSITIVE);
        let [xx, yy, zz] =
            [(0, 0), (3, 1), (5, 2)].map(|(index, i)| covariance(index, i, i).max(0.0) + added);
        let (xy, xz, yz) = (
            covariance(1, 0, 1),
            covariance(2, 0, 2),
            covariance(4, 1, 2),
        );
        // Factorize the covariance from the last channel up: C = U U^T with U upper triangular; then R = U^-1 is upper
        // triangular and |R d|^2 = d^T C^-1 d. Pivots below the added variance are rounding errors.
        let u22 = zz.sqrt();
        let u12 = yz / u22;
        let u02 = xz / u22;
        let u11 = (yy - u12 * u12).max(added).sqrt();
        let u01 = (xy - u02 * u12) / u11;
        let u00 = (xx - u01 * u01 - u02 * u02).max(added).sqrt();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let root = [
            1.0 / u00,
            -u01 / (u00 * u11),
            (u01 * u12 - u02 * u11) / (u00 * u11 * u22),
            1.0 / u11,
            -u12 / (u11 * u22),
            1.0 / u22,
        ]
        .map(|r| (r * half) as f32);
        let log_determinant = 2.0 * (u00.ln() + u11.ln() + u22.ln());
        let log_weight = (n / total as f64).ln()
            - 0.5 * log_determinant
            - 1.5 * (2.0 * std::f64::consts::PI).ln();
        Gaussian {
            mean: mean.map(|m| m as f32),
            root,
            log_weight: log_weight as f32,
        }
    }
}

/// Draws one random sample from each of `MAX_SAMPLES` equal intervals
fn subsample(samples: &[[u8; 3]], random: &mut SplitMix) -> Vec<[u8; 3]> {
    if samples.len() <= MAX_SAMPLES {
        return samples.to_vec();
    }
    let interval = samples.len() as f64 / MAX_SAMPLES as f64;
    (0..MAX_SAMPLES)
        .map(|i| {
            let at = (i as f64 + random.unit()) * interval;
            samples[(at as usize).min(samples.len() - 1)]
        })
        .collect()
}

/// Returns labels after Lloyd's iteration from a k-means++ start, and the sum of squared distances
fn k_means(samples: &[[u8; 3]], count: usize, random: &mut SplitMix) -> (Vec<u8>, f64) {
    let mut centers: Vec<[f32; 3]> = Vec::with_capacity(count);
    let mut nearest = vec![f32::INFINITY; samples.len()];
    while centers.len() < count {
        let next = if centers.is_empty() {
            random.below(samples.len())
        } else {
            let total: f64 = nearest.iter().map(|&d| f64::from(d)).sum();
            if total <= 0.0 {
                // fewer distinct colors than clusters
                break;
            }
            let mut left = random.unit() * total;
            nearest
                .iter()
                .position(|&d| {
                    left -= f64::from(d);
                    left < 0.0
                })
                .unwrap_or(samples.len() - 1)
        };
        let center = samples[next].map(f32::from);
        for (sample, nearest) in samples.iter().zip(&mut nearest) {
            *nearest = nearest.min(squared_distance(sample.map(f32::from), center));
        }
        centers.push(center);
    }
    let mut labels = vec![0_u8; samples.len()];
    let mut spread = 0.0;
    for _ in 0..KMEANS_ROUNDS {
        spread = 0.0;
        let mut moments = vec![Moments::default(); centers.len()];
        for (&sample, label) in samples.iter().zip(&mut labels) {
            let color = sample.map(f32::from);
            let mut least = f32::INFINITY;
            for (index, &center) in centers.iter().enumerate() {
                let distance = squared_distance(color, center);
                if distance < least {
                    least = distance;
                    *label = index as u8;
                }
            }
            spread += f64::from(least);
            moments[usize::from(*label)].add(sample);
        }
        for (center, moments) in centers.iter_mut().zip(&moments) {
            if moments.count > 0 {
                *center = moments.sum.map(|s| (s / moments.count as f64) as f32);
            }
        }
    }
    (labels, spread)
}

fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let (x, y, z) = (a[0] - b[0], a[1] - b[1], a[2] - b[2]);
    x * x + y * y + z * z
}

/// Random numbers that are equal on every machine
///
/// # Source
/// G. Steele, D. Lea, C. Flood, 2014, Fast splittable pseudorandom number generators.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1)
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, limit: usize) -> usize {
        ((self.unit() * limit as f64) as usize).min(limit.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Density of one Gaussian fitted to all samples, by the textbook formulas
    fn log_density_reference(samples: &[[u8; 3]], added: f64, color: [u8; 3]) -> f64 {
        let n = samples.len() as f64;
        let mean = [0, 1, 2].map(|c| samples.iter().map(|s| f64::from(s[c])).sum::<f64>() / n);
        let mut m = [[0.0; 3]; 3];
        for (i, row) in m.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                *value = samples
                    .iter()
                    .map(|s| (f64::from(s[i]) - mean[i]) * (f64::from(s[j]) - mean[j]))
                    .sum::<f64>()
                    / (n - 1.0)
                    + if i == j { added } else { 0.0 };
            }
        }
        let minor = |i: usize, j: usize| {
            let (a, b) = ((i + 1) % 3, (i + 2) % 3);
            let (c, d) = ((j + 1) % 3, (j + 2) % 3);
            m[a][c] * m[b][d] - m[a][d] * m[b][c]
        };
        let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
        let d = [0, 1, 2].map(|c| f64::from(color[c]) - mean[c]);
        let mut quadratic = 0.0;
        for i in 0..3 {
            for j in 0..3 {
                quadratic += d[i] * d[j] * minor(i, j) / determinant;
            }
        }
        -0.5 * (quadratic + determinant.ln()) - 1.5 * (2.0 * std::f64::consts::PI).ln()
    }

    #[test]
    fn two_colors_are_separated() {
        let mut samples = vec![[200, 30, 40]; 50];
        samples.extend([[20, 120, 220]; 50]);
        let model = ColorModel::fit(&samples, &ColorModelOptions::default()).unwrap();
        let seen = model.log_density([200, 30, 40]);
        assert!(seen > model.log_density([110, 75, 130]) + 50.0);
        assert!((seen - model.log_density([20, 120, 220])).abs() < 1e-3);
    }

    #[test]
    fn one_flat_color_has_the_added_variance() {
        let model = ColorModel::fit(&[[255; 3]; 100], &ColorModelOptions::default()).unwrap();
        let expected = -1.5 * (2.0 * std::f32::consts::PI * 2.0).ln();
        assert!((model.log_density([255; 3]) - expected).abs() < 1e-4);
        assert!((model.log_density([255, 255, 251]) - (expected - 4.0)).abs() < 1e-3);
    }

    #[test]
    fn too_few_samples_give_no_model() {
        assert!(ColorModel::fit(&[], &ColorModelOptions::default()).is_none());
        assert!(ColorModel::fit(&[[1, 2, 3]; 7], &ColorModelOptions::default()).is_none());
    }

    #[test]
    fn fitting_twice_gives_the_same_model() {
        let samples: Vec<[u8; 3]> = (0..40_000_u32)
            .map(|i| [(i % 251) as u8, (i % 13 * 9) as u8, (i % 97) as u8])
            .collect();
        let fit = || ColorModel::fit(&samples, &ColorModelOptions::default()).unwrap();
        let (a, b) = (fit(), fit());
        for color in [[0, 0, 0], [100, 50, 50], [250, 100, 90]] {
            assert_eq!(
                a.log_density(color).to_bits(),
                b.log_density(color).to_bits()
            );
        }
    }

    proptest! {
        #[test]
        fn one_gaussian_equals_the_reference(
            samples in prop::collection::vec(prop::array::uniform3(any::<u8>()), 8..60),
            color in prop::array::uniform3(any::<u8>()),
        ) {
            let options = ColorModelOptions { components: 1, ..Default::default() };
            let model = ColorModel::fit(&samples, &options).unwrap();
            let expected = log_density_reference(&samples, options.added_variance, color);
            let found = f64::from(model.log_density(color));
            prop_assert!((found - expected).abs() < 1e-3 * expected.abs().max(1.0));
        }

        #[test]
        fn densities_of_all_colors_are_finite(
            samples in prop::collection::vec(prop::array::uniform3(any::<u8>()), 8..200),
            color in prop::array::uniform3(any::<u8>()),
        ) {
            let model = ColorModel::fit(&samples, &ColorModelOptions::default()).unwrap();
            prop_assert!(model.log_density(color).is_finite());
        }
    }
}
