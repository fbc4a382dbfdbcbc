//! Correction of turn angles that are counted in the wrong direction or not from the front.

use super::model::{Problem, Shared, Unknowns};
use super::solve::{Solution, solve};
use super::swaps::SwapGroup;
use pirouette_body::{Bone, Pose, TurnAngle};

/// Fraction of outlier keypoints above which other turn angles are tried
///
/// Correct angles give at most 9 % (a detector with errors and swapped limbs), wrong ones at least 12 %.
const SUSPICIOUS_SHARE: f64 = 0.10;

/// Other angles are accepted if they leave at most this fraction of the outliers
const CONVINCING_PART: f64 = 0.5;

/// Minimum mean turn of all poses that is transferred to the angles, in radians: smaller ones are random
const MIN_OFFSET_RADIANS: f64 = 0.07;

/// Maximum number of transfers of the mean turn to the angles
const MAX_OFFSET_STEPS: usize = 4;

/// Correction of the given turn angles: `turn = given or -given or half of it, plus offset`
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TurnCorrection {
    /// Whether the person turned in the opposite direction
    pub reversed: bool,
    /// Offset added afterwards
    pub offset: TurnAngle,
    /// Whether the person turned by half of the given angles
    pub halved: bool,
    /// Whether left and right of all joints were swapped in all views
    pub swapped: bool,
}

impl TurnCorrection {
    fn apply(self, given: TurnAngle) -> TurnAngle {
        let factor = if self.halved { 0.5 } else { 1.0 };
        let turn = given.radians() * factor * if self.reversed { -1.0 } else { 1.0 };
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
        let quarters = (0..4).map(|quarter| TurnAngle::from_degrees(90.0 * f64::from(quarter)));
        for offset in quarters {
            for (reversed, swapped, halved) in [
                (false, false, false),
                (true, false, false),
                (false, true, false),
                (true, true, false),
                (false, false, true),
            ] {
                let candidate = TurnCorrection {
                    reversed,
                    offset,
                    halved,
                    swapped,
                };
                set_turns(problem, &given, candidate);
                set_swapped(problem, swapped);
                let solution = solve(problem, problem.start(), rounds);
                let left = unexplained_share(problem, &solution.unknowns);
                set_swapped(problem, swapped);
                if left < unexplained && left <= limit {
                    (best, unexplained, correction) = (solution, left, candidate);
                }
            }
        }
        set_turns(problem, &given, correction);
        set_swapped(problem, correction.swapped);
    }
    // The prior keeps the poses near the angles, so that one step transfers only part of a large offset.
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

/// Swaps left and right of all joints in all views, if `swapped`; twice gives the original
fn set_swapped(problem: &mut Problem, swapped: bool) {
    for view in problem.views.iter_mut().filter(|_| swapped) {
        SwapGroup::Body.swap_observed(view);
    }
}

/// Returns the mean turn of all poses beyond the turn angles, in radians
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

/// Returns the fraction of keypoints that are outliers
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
