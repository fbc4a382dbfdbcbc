//! Minimization of a sum of distances in a few parameters, by Gauss-Newton steps.
//!
//! The objective consists of distances, not of their squares: outliers, such as an arm held differently or a belly that
//! the reference lacks, have no more influence than small residuals. Each distance is squared below a softness, which
//! lets the steps converge; the softness decreases during the descent.

/// Softness of the distances, in px, and the largest number of rounds with it
#[derive(Debug, Clone, Copy)]
pub(super) struct Softness {
    pub(super) px: f64,
    pub(super) rounds: usize,
}

/// Number of times a step without gain is halved before the descent rejects it
const HALVINGS: usize = 3;

/// A round that gains less than this share ends the descent at this softness
const LEAST_GAIN: f64 = 1e-5;

/// Residual sum and normal equations
#[derive(Debug, Clone, Copy)]
pub(super) struct Pull<const N: usize> {
    /// Distances below this are squared, in px
    softness_px: f64,
    total: f64,
    normal: [[f64; N]; N],
    right: [f64; N],
}

impl<const N: usize> Pull<N> {
    fn new(softness_px: f64) -> Self {
        Self {
            softness_px,
            total: 0.0,
            normal: [[0.0; N]; N],
            right: [0.0; N],
        }
    }

    /// Adds a (signed) distance, in px, with its derivative with respect to each parameter
    pub(super) fn add(&mut self, distance_px: f64, slope: [f64; N]) {
        let (size, soft) = (distance_px.abs(), self.softness_px);
        let weight = if size < soft {
            self.total += size * size / (2.0 * soft) + soft / 2.0;
            1.0 / soft
        } else {
            self.total += size;
            1.0 / size
        };
        for i in 0..N {
            let scaled = weight * slope[i];
            for (sum, other) in self.normal[i].iter_mut().zip(slope).take(i + 1) {
                *sum += scaled * other;
            }
            self.right[i] -= scaled * distance_px;
        }
    }

    /// Solves the normal equations for the step; `None` when they are singular
    fn step(&self) -> Option<[f64; N]> {
        // Cholesky; for so few unknowns no library is needed
        let mut lower = [[0.0; N]; N];
        for i in 0..N {
            for k in 0..=i {
                let known: f64 = (0..k).map(|m| lower[i][m] * lower[k][m]).sum();
                let rest = self.normal[i][k] - known;
                if i == k {
                    if !rest.is_finite() || rest <= 1e-12 * self.normal[i][i] {
                        return None;
                    }
                    lower[i][i] = rest.sqrt();
                } else {
                    lower[i][k] = rest / lower[k][k];
                }
            }
        }
        let mut step = self.right;
        for i in 0..N {
            let known: f64 = (0..i).map(|m| lower[i][m] * step[m]).sum();
            step[i] = (step[i] - known) / lower[i][i];
        }
        for i in (0..N).rev() {
            let known: f64 = (i + 1..N).map(|m| lower[m][i] * step[m]).sum();
            step[i] = (step[i] - known) / lower[i][i];
        }
        Some(step)
    }
}

/// Minimizes from `start`; `pull` adds all distances at the given parameters to the sum
///
/// Returns the last parameters with their total at the last softness.
pub(super) fn descend<const N: usize>(
    start: [f64; N],
    softness: &[Softness],
    pull: impl Fn(&[f64; N], &mut Pull<N>),
) -> ([f64; N], f64) {
    let mut at = start;
    let mut total = f64::INFINITY;
    for &Softness { px, rounds } in softness {
        let pulled = |at: &[f64; N]| {
            let mut sum = Pull::new(px);
            pull(at, &mut sum);
            sum
        };
        let mut here = pulled(&at);
        for _ in 0..rounds {
            let Some(mut step) = here.step() else { break };
            let mut next = None;
            for _ in 0..=HALVINGS {
                let place = std::array::from_fn(|i| at[i] + step[i]);
                let there = pulled(&place);
                if there.total < here.total {
                    next = Some((place, there));
                    break;
                }
                step = step.map(|s| s / 2.0);
            }
            let Some((place, there)) = next else { break };
            let gain = here.total - there.total;
            let enough = gain > LEAST_GAIN * here.total;
            (at, here) = (place, there);
            if !enough {
                break;
            }
        }
        total = here.total;
    }
    (at, total)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn soft(px: f64) -> Softness {
        Softness { px, rounds: 12 }
    }

    #[test]
    fn a_line_through_points_ignores_an_outlier() {
        // y = 2 + 3 x, except for one point
        let points: Vec<(f64, f64)> = (0..9)
            .map(|i| f64::from(i) / 4.0)
            .map(|x| (x, if x == 1.0 { 90.0 } else { 2.0 + 3.0 * x }))
            .collect();
        let (found, _) = descend(
            [0.0, 0.0],
            &[1.0, 0.1, 0.01, 1e-4].map(soft),
            |&[a, b], pull| {
                for &(x, y) in &points {
                    pull.add(a + b * x - y, [1.0, x]);
                }
            },
        );
        assert!((found[0] - 2.0).abs() < 1e-3, "{found:?}");
        assert!((found[1] - 3.0).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn singular_or_non_finite_parameters_are_unchanged() {
        let (found, _) = descend([1.0, 2.0], &[1.0].map(soft), |_, pull| {
            pull.add(5.0, [1.0, 1.0])
        });
        assert_eq!(found, [1.0, 2.0]);
        let (found, _) = descend([1.0, 2.0], &[1.0].map(soft), |_, pull| {
            pull.add(f64::NAN, [1.0, 0.0]);
            pull.add(f64::INFINITY, [0.0, 1.0]);
        });
        assert_eq!(found, [1.0, 2.0]);
        let (found, total) = descend([1.0], &[0.5].map(soft), |_, _| {});
        assert_eq!((found, total), ([1.0], 0.0));
    }
}
