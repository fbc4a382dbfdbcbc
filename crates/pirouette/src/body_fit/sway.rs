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

/// How turns that were tracked in a video are constrained
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TrackedTurns {
    /// Near the initial ones
    Held,
    /// Those from the side follow their neighbors, others are free
    Continuous,
}

/// Standard deviation of a turn that is held, in degrees
const HELD_DEGREES: f64 = 1.0;

/// Standard deviation of a turn by its neighbors, in degrees: exactly from the side, and how much larger from the front
///
/// The outline of a symmetric body is about the same 5 degrees before and after it is seen exactly from the side, and
/// keypoints have a bias there: both are less certain than their equations. Elsewhere, outlines are much more accurate than
/// the neighbors. Over 8 videos of 5 rendered people, the mean error is 0.7 instead of 0.9 degrees, the largest one 3.2
/// instead of 7.8.
const FROM_THE_SIDE_DEGREES: f64 = 0.5;
const MORE_DEGREES: f64 = 100.0;

/// True standard deviation of a turn by its neighbors, in degrees
const BY_NEIGHBORS_DEGREES: f64 = 1.5;

/// Neighbors of a frame in time, with the correlation of their deviations
type Neighbors = [(usize, f64)];

/// Returns the mean deviation of a frame given those of its neighbors, and the reciprocal of its variance relative to that
/// of all frames
fn given_neighbors(neighbors: &Neighbors, deviation: impl Fn(usize) -> f64) -> (f64, f64) {
    let (mut pull, mut factor) = (0.0, 1.0);
    for &(other, r) in neighbors {
        pull += r / (1.0 - r * r) * deviation(other);
        factor += r * r / (1.0 - r * r);
    }
    (pull / factor, factor)
}

/// Returns the prior of each pose, given the `posture` and the other poses
pub(super) fn pose_priors(
    views: &[BodyFitView],
    posture: &Pose,
    poses: &[Pose],
    tracked_turns: TrackedTurns,
) -> Vec<PosePrior> {
    let center = posture.to_parameters();
    let poses: Vec<[f64; POSE]> = poses.iter().map(Pose::to_parameters).collect();
    let neighbors = neighbors(views);
    let mut priors: Vec<PosePrior> = views
        .iter()
        .zip(&neighbors)
        .map(|(view, neighbors)| {
            let sigmas = match view.stepped {
                true => Pose::stepping_sigmas(),
                false => Pose::prior_sigmas(),
            };
            let mut prior = PosePrior {
                center,
                weights: sigmas.map(|sigma| sigma.powi(-2)),
            };
            // The turn is not sway: it goes on.
            for i in (0..POSE).filter(|&i| i != TURN) {
                let (mean, factor) = given_neighbors(neighbors, |j| poses[j][i] - center[i]);
                prior.center[i] += mean;
                prior.weights[i] *= factor;
            }
            prior
        })
        .collect();
    match tracked_turns {
        TrackedTurns::Held => {
            for (prior, view) in priors.iter_mut().zip(views) {
                if view.tracked.is_some() {
                    prior.weights[TURN] = HELD_DEGREES.to_radians().powi(-2);
                }
            }
        }
        TrackedTurns::Continuous => continue_turns(&mut priors, views, &poses, &neighbors),
    }
    priors
}

/// Sets the prior of tracked turns: the deviation from the track changes little from frame to frame
fn continue_turns(
    priors: &mut [PosePrior],
    views: &[BodyFitView],
    poses: &[[f64; POSE]],
    neighbors: &[Vec<(usize, f64)>],
) {
    let wrapped = |angle: f64| angle.sin().atan2(angle.cos());
    let deviations: Vec<Option<f64>> = views
        .iter()
        .zip(poses)
        .map(|(view, pose)| {
            let turn = view.turn.radians() + pose[TURN];
            Some(wrapped(turn - view.tracked?.turn.radians()))
        })
        .collect();
    let known = || deviations.iter().flatten();
    let mean = known().sum::<f64>() / known().count().max(1) as f64;
    for ((prior, view), neighbors) in priors.iter_mut().zip(views).zip(neighbors) {
        let Some(tracked) = view.tracked else {
            continue;
        };
        let of = |other: usize| deviations[other].map_or(0.0, |deviation| deviation - mean);
        let (more, _) = given_neighbors(neighbors, of);
        let expected = tracked.turn.radians() + mean + more;
        let sd_degrees = FROM_THE_SIDE_DEGREES + MORE_DEGREES * expected.cos().powi(2);
        prior.center[TURN] = wrapped(expected - view.turn.radians());
        prior.weights[TURN] = sd_degrees.to_radians().powi(-2);
    }
}

/// Returns the neighbors of each view: the frames before and after it
fn neighbors(views: &[BodyFitView]) -> Vec<Vec<(usize, f64)>> {
    let mut in_time: Vec<(f64, usize)> = views
        .iter()
        .enumerate()
        .filter_map(|(index, view)| Some((view.tracked?.time_s, index)))
        .collect();
    in_time.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut neighbors = vec![Vec::new(); views.len()];
    for pair in in_time.windows(2) {
        let [(before_s, before), (after_s, after)] = [pair[0], pair[1]];
        let correlation = (-(after_s - before_s).max(MIN_STEP_S) / MEMORY_S).exp();
        neighbors[before].push((after, correlation));
        neighbors[after].push((before, correlation));
    }
    neighbors
}

impl PosePrior {
    /// Returns the standard deviation of a tracked turn, given that by the equations, which contain this prior
    pub(super) fn tracked_turn_sd(&self, sd_radians: f64) -> f64 {
        let share = self.weights[TURN] * sd_radians.powi(2);
        sd_radians.hypot(share * BY_NEIGHBORS_DEGREES.to_radians())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skeleton_fit::Tracked;
    use faer::linalg::solvers::{DenseSolveCore, Llt};
    use faer::{Mat, Side};
    use pirouette_body::{Camera, Keypoints, TurnAngle};
    use pirouette_geom::{Grid, Windowed};

    fn view<'a>(silhouette: &'a Windowed<f32>, keypoints: &'a Keypoints) -> BodyFitView<'a> {
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
        BodyFitView {
            silhouette,
            keypoints,
            camera,
            turn: TurnAngle::default(),
            stepped: false,
            tracked: None,
            pose: Pose::default(),
            stature_mm: 1700.0,
        }
    }

    /// Returns the priors of views at given times, of which all parameters deviate from the posture by given values
    fn priors(times: &[Option<f64>], deviations: &[f64], turns: TrackedTurns) -> Vec<PosePrior> {
        let silhouette = Windowed::new(&Grid::filled(4, 4, 0.0));
        let keypoints = Keypoints::default();
        let turn = TurnAngle::default();
        let views: Vec<BodyFitView> = times
            .iter()
            .map(|&time_s| BodyFitView {
                tracked: time_s.map(|time_s| Tracked { time_s, turn }),
                ..view(&silhouette, &keypoints)
            })
            .collect();
        let poses: Vec<Pose> = deviations
            .iter()
            .map(|&deviation| Pose::from_parameters(&[0.1 + deviation; POSE]))
            .collect();
        let posture = Pose::from_parameters(&[0.1; POSE]);
        pose_priors(&views, &posture, &poses, turns)
    }

    #[test]
    fn photos_have_the_prior_of_the_posture() {
        let weights = Pose::prior_sigmas().map(|sigma| sigma.powi(-2));
        for prior in priors(&[None; 3], &[0.5, -0.3, 0.2], TrackedTurns::Held) {
            assert_eq!(prior.center, [0.1; POSE]);
            assert_eq!(prior.weights, weights);
        }
    }

    #[test]
    fn frames_have_the_conditional_distribution_of_the_process() {
        let times = [0.4, 3.1, 1.7, 1.9, 8.0];
        let deviations = [0.04, -0.02, 0.05, -0.01, 0.03];
        let found = priors(&times.map(Some), &deviations, TrackedTurns::Continuous);
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
    fn tracked_turns_are_held_first() {
        let times = [Some(1.0), Some(1.0), Some(2.0)];
        for prior in priors(&times, &[0.5, -0.3, 0.2], TrackedTurns::Held) {
            assert_eq!(prior.center[TURN], 0.1);
            let sd = prior.weights[TURN].powf(-0.5).to_degrees();
            assert!((sd - HELD_DEGREES).abs() < 1e-9);
            assert!(prior.center.iter().all(|x| x.is_finite()));
        }
    }

    #[test]
    fn turns_from_the_side_follow_their_neighbors() {
        // The track is 3 degrees behind all frames, but the one from the side, which is 5 degrees before it.
        let track = [40.0, 64.0, 87.0, 109.0, 133.0];
        let more = [3.0, 3.0, -5.0, 3.0, 3.0];
        let silhouette = Windowed::new(&Grid::filled(4, 4, 0.0));
        let keypoints = Keypoints::default();
        let views: Vec<BodyFitView> = (0..5)
            .map(|i| BodyFitView {
                turn: TurnAngle::from_degrees(track[i] + 1.0),
                tracked: Some(Tracked {
                    time_s: i as f64,
                    turn: TurnAngle::from_degrees(track[i] + 360.0),
                }),
                ..view(&silhouette, &keypoints)
            })
            .collect();
        let poses: Vec<Pose> = more
            .iter()
            .map(|more| {
                let mut parameters = [0.0; POSE];
                parameters[TURN] = f64::to_radians(more - 1.0);
                Pose::from_parameters(&parameters)
            })
            .collect();
        let found = pose_priors(&views, &Pose::default(), &poses, TrackedTurns::Continuous);
        let turn = track[2] + 1.0 + found[2].center[TURN].to_degrees();
        assert!((turn - 90.0).abs() < 1.0, "{turn}");
        let sd = |i: usize| found[i].weights[TURN].powf(-0.5).to_degrees();
        assert!(
            sd(2) < 0.6 && sd(1) > 10.0 && sd(3) > 10.0,
            "{} {}",
            sd(1),
            sd(2)
        );
        // All of a certain angle is from the neighbors, nothing of one with a wide prior.
        let held = found[2].tracked_turn_sd(0.4_f64.to_radians()).to_degrees();
        let free = found[1].tracked_turn_sd(0.8_f64.to_radians()).to_degrees();
        assert!(held > 0.9 && held < 1.5, "{held}");
        assert!((free - 0.8).abs() < 0.01, "{free}");
    }
}
