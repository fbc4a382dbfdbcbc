//! Prior of the sway: a pose deviates little from the posture and, in a video, little from the poses shortly before and
//! after it.
//!
//! The deviation of each parameter from the posture is an Ornstein-Uhlenbeck process over time: its correlation between
//! two frames decreases exponentially with the time between them. Given the poses of the neighbors, the prior of one
//! pose is a normal distribution again, so that poses are still solved view by view. Repeated in all rounds, this
//! converges to the poses that are most likely together.
//!
//! # Source
//! Uhlenbeck and Ornstein, "On the Theory of the Brownian Motion", Physical Review 36, 1930, equation 21b.

use super::BodyFitView;
use super::pose_step::{POSE, TURN};
use pirouette_body::Pose;

/// Time in which the correlation of the sway decreases to 1 / e, in s
const MEMORY_S: f64 = 1.5;

/// Time between frames below which they do not become more alike, in s
const MIN_STEP_S: f64 = 0.05;

/// Independent normal distributions of the parameters of a pose
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PosePrior {
    pub(super) center: [f64; POSE],
    /// Reciprocals of the variances
    pub(super) weights: [f64; POSE],
}

/// Standard deviation of a turn that is held, in degrees
const HELD_DEGREES: f64 = 1.0;

/// Returns the prior of each pose, given the `posture` and the other poses; turns found in a video are held or free
pub(super) fn pose_priors(
    views: &[BodyFitView],
    posture: &Pose,
    poses: &[Pose],
    turns_held: bool,
) -> Vec<PosePrior> {
    let center = posture.to_parameters();
    let mut priors: Vec<PosePrior> = views
        .iter()
        .map(|view| {
            let sigmas = match view.stepped {
                true => Pose::stepping_sigmas(),
                false => Pose::prior_sigmas(),
            };
            let mut weights = sigmas.map(|sigma| sigma.powi(-2));
            if turns_held && view.time_s.is_some() {
                weights[TURN] = HELD_DEGREES.to_radians().powi(-2);
            }
            PosePrior { center, weights }
        })
        .collect();
    let mut in_time: Vec<(f64, usize)> = views
        .iter()
        .enumerate()
        .filter_map(|(index, view)| Some((view.time_s?, index)))
        .collect();
    in_time.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut neighbors: Vec<Vec<(usize, f64)>> = vec![Vec::new(); views.len()];
    for pair in in_time.windows(2) {
        let [(before_s, before), (after_s, after)] = [pair[0], pair[1]];
        let correlation = (-(after_s - before_s).max(MIN_STEP_S) / MEMORY_S).exp();
        neighbors[before].push((after, correlation));
        neighbors[after].push((before, correlation));
    }
    for (prior, neighbors) in priors.iter_mut().zip(neighbors) {
        let (mut factor, mut shares) = (1.0, Vec::new());
        for (other, r) in neighbors {
            factor += r * r / (1.0 - r * r);
            shares.push((poses[other].to_parameters(), r / (1.0 - r * r)));
        }
        // The turn is not sway: it goes on.
        for i in (0..POSE).filter(|&i| i != TURN) {
            let pull: f64 = shares
                .iter()
                .map(|(other, share)| share * (other[i] - center[i]))
                .sum();
            prior.center[i] += pull / factor;
            prior.weights[i] *= factor;
        }
    }
    priors
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::linalg::solvers::{DenseSolveCore, Llt};
    use faer::{Mat, Side};
    use pirouette_body::{Camera, Keypoints, TurnAngle};
    use pirouette_geom::{Grid, Windowed};

    /// Returns the priors of views at given times, of which all parameters deviate from the posture by given values
    fn priors(times: &[Option<f64>], deviations: &[f64], turns_held: bool) -> Vec<PosePrior> {
        let silhouette = Windowed::new(&Grid::filled(4, 4, 0.0));
        let keypoints = Keypoints::default();
        let camera = Camera {
            width_px: 4,
            height_px: 4,
            vertical_fov_radians: 0.8,
            height_mm: 900.0,
            distance_mm: 3000.0,
            pitch_radians: 0.0,
            yaw_radians: 0.0,
            distortion: 0.0,
        };
        let views: Vec<BodyFitView> = times
            .iter()
            .map(|&time_s| BodyFitView {
                silhouette: &silhouette,
                keypoints: &keypoints,
                camera,
                turn: TurnAngle::default(),
                stepped: false,
                time_s,
                pose: Pose::default(),
                stature_mm: 1700.0,
            })
            .collect();
        let poses: Vec<Pose> = deviations
            .iter()
            .map(|&deviation| Pose::from_parameters(&[0.1 + deviation; POSE]))
            .collect();
        let posture = Pose::from_parameters(&[0.1; POSE]);
        pose_priors(&views, &posture, &poses, turns_held)
    }

    #[test]
    fn photos_have_the_prior_of_the_posture() {
        let weights = Pose::prior_sigmas().map(|sigma| sigma.powi(-2));
        for prior in priors(&[None, None, None], &[0.5, -0.3, 0.2], true) {
            assert_eq!(prior.center, [0.1; POSE]);
            assert_eq!(prior.weights, weights);
        }
    }

    #[test]
    fn frames_have_the_conditional_distribution_of_the_process() {
        let times = [0.4, 3.1, 1.7, 1.9, 8.0];
        let deviations = [0.04, -0.02, 0.05, -0.01, 0.03];
        let found = priors(&times.map(Some), &deviations, false);
        let sigmas = Pose::prior_sigmas();
        // The twin: mean and variance of one value given all others, by the covariances of all times
        let covariance = Mat::<f64>::from_fn(5, 5, |i, j| {
            f64::exp(-f64::abs(times[i] - times[j]) / MEMORY_S)
        });
        let inverse = Llt::new(covariance.as_ref(), Side::Lower)
            .unwrap()
            .inverse();
        for (i, prior) in found.iter().enumerate() {
            let others = (0..5).filter(|&j| j != i);
            let pull: f64 = others.map(|j| inverse[(i, j)] * deviations[j]).sum();
            let center = 0.1 - pull / inverse[(i, i)];
            for p in (0..POSE).filter(|&p| p != TURN) {
                assert!((prior.center[p] - center).abs() < 1e-12);
                let weight = inverse[(i, i)] / sigmas[p].powi(2);
                assert!((prior.weights[p] / weight - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn turns_go_on_and_are_only_held_in_place() {
        let sigma = Pose::prior_sigmas()[TURN];
        for (held, sigma) in [(false, sigma), (true, HELD_DEGREES.to_radians())] {
            for prior in priors(&[Some(1.0), Some(1.0), Some(2.0)], &[0.5, -0.3, 0.2], held) {
                assert_eq!(prior.center[TURN], 0.1);
                assert!((prior.weights[TURN] * sigma * sigma - 1.0).abs() < 1e-12);
                assert!(prior.center.iter().all(|x| x.is_finite()));
            }
        }
    }
}
