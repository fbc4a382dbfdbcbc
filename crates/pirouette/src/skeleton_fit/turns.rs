//! Turn angles that cannot be right: counted in the wrong direction, or from another side than the front.

use super::model::{Problem, Shared, Unknowns};
use super::solve::{Solution, solve};
use pirouette_body::Bone;
use pirouette_body::Pose;
use pirouette_body::TurnAngle;

/// Share of keypoints that no likely pose explains, above which other turn angles are tried
///
/// Right angles leave at most 9 % (a detector that errs and mixes up limbs), wrong ones at least 12 %.
const SUSPICIOUS_SHARE: f64 = 0.10;

/// Other angles are believed when they leave at most this part of the unexplained keypoints
const CONVINCING_PART: f64 = 0.5;

/// Mean turn of all poses that is taken into the angles, in radians: less is chance
const MIN_OFFSET_RADIANS: f64 = 0.07;

/// Times that the mean turn is taken into the angles
const MAX_OFFSET_STEPS: usize = 4;

/// How the given turn angles were changed: `turn = given or -given, plus offset`
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TurnCorrection {
    /// Whether the person turned the other way round
    pub reversed: bool,
    /// What was added afterwards
    pub offset: TurnAngle,
}

impl TurnCorrection {
    fn apply(self, given: TurnAngle) -> TurnAngle {
        let turn = given.radians() * if self.reversed { -1.0 } else { 1.0 };
        TurnAngle::from_radians(turn + self.offset.radians())
    }
}

/// Solves with the given turn angles, or with those that explain far more keypoints
pub(super) fn solve_turns(problem: &mut Problem, rounds: usize) -> (Solution, TurnCorrection) {
    let given: Vec<TurnAngle> = problem.views.iter().map(|view| view.turn).collect();
    let mut correction = TurnCorrection::default();
    let mut best = solve(problem, problem.start(), rounds);
    let mut unexplained = unexplained_share(problem, &best.unknowns);
    if unexplained > SUSPICIOUS_SHARE {
        let limit = CONVINCING_PART * unexplained;
        for quarter in 0..4 {
            for reversed in [false, true] {
                let candidate = TurnCorrection {
                    reversed,
                    offset: TurnAngle::from_degrees(90.0 * f64::from(quarter)),
                };
                set_turns(problem, &given, candidate);
                let solution = solve(problem, problem.start(), rounds);
                let left = unexplained_share(problem, &solution.unknowns);
                if left < unexplained && left <= limit {
                    (best, unexplained, correction) = (solution, left, candidate);
                }
            }
        }
        set_turns(problem, &given, correction);
    }
    // The prior holds the poses near the angles, so that one step takes only part of a large offset.
    for _ in 0..MAX_OFFSET_STEPS {
        let shared = problem.shared(&best.unknowns.shared);
        let offset = mean_turn(problem, &shared, &best.unknowns);
        if offset.abs() <= MIN_OFFSET_RADIANS {
            break;
        }
        let radians = correction.offset.radians() + offset;
        correction.offset = TurnAngle::from_radians(radians);
        set_turns(problem, &given, correction);
        best = solve(problem, problem.start(), rounds);
    }
    (best, correction)
}

fn set_turns(problem: &mut Problem, given: &[TurnAngle], correction: TurnCorrection) {
    for (view, &given) in problem.views.iter_mut().zip(given) {
        view.turn = correction.apply(given);
    }
}

/// How far all poses are turned beyond the turn angles, on average, in radians
fn mean_turn(problem: &Problem, shared: &Shared, unknowns: &Unknowns) -> f64 {
    let poses = problem.views.iter().zip(&unknowns.poses);
    let turns: Vec<f64> = poses
        .filter(|(view, _)| view.observed_count() > 0)
        .map(|(_, pose)| {
            let pose: Pose = shared.pose(pose);
            pose.rotations[Bone::Root].y
        })
        .collect();
    turns.iter().sum::<f64>() / turns.len().max(1) as f64
}

/// Share of the keypoints that are outliers
fn unexplained_share(problem: &Problem, unknowns: &Unknowns) -> f64 {
    let shared = problem.shared(&unknowns.shared);
    let (mut all, mut outside) = (0.0, 0.0);
    for (view, pose) in problem.views.iter().zip(&unknowns.poses) {
        let Some(residuals) = problem.residuals(view, &shared, pose) else {
            return 1.0;
        };
        for residual in residuals.iter().flatten() {
            all += 1.0;
            if residual.length() > super::OUTLIER_SIGMAS {
                outside += 1.0;
            }
        }
    }
    outside / f64::max(all, 1.0)
}
