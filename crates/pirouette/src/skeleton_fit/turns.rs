//! Correction of turn angles that are counted in the wrong direction, not from the front, or wrong in some views.

use super::found_turns::{distance, solve_free};
use super::model::{Problem, Shared, Unknowns, ViewData};
use super::solve::{Solution, solve};
use super::swaps::SwapGroup;
use super::{KeypointView, SkeletonFitWarning, WrongTurn};
use pirouette_body::{Bone, Pose, TurnAngle};

/// Fraction of outlier keypoints above which other turn angles are tried
///
/// Correct angles give at most 9 % (a detector with errors and swapped limbs), wrong ones at least 12 %.
const SUSPICIOUS_SHARE: f64 = 0.10;

/// Other angles are accepted if they leave at most this fraction of the outliers
const CONVINCING_PART: f64 = 0.5;

/// Minimum mean turn of all poses that is transferred to the angles, in radians: smaller ones are random
pub(super) const MIN_OFFSET_RADIANS: f64 = 0.07;

/// Offsets below this one are part of wrong angles, in radians; others are those of another start of the turn
const MAX_SMALL_OFFSET_RADIANS: f64 = 0.5;

/// Deviation of a found from a stated angle above which the view is reported, in standard deviations
pub(crate) const REPORTED: f64 = 1.0;

/// Maximum number of transfers of the mean turn to the angles
const MAX_OFFSET_STEPS: usize = 4;

/// Turn of a pose beyond that of the others above which the angles are searched again, in standard deviations
const SUSPICIOUS_TURN: f64 = 0.8;

/// Deviation of found from stated angles, in standard deviations, above which the stated ones are wrong: root mean
/// square of all views, and that of one view
///
/// Sway gives 0.5 to 0.7, and up to 1.3 in one view.
const WRONG_MEAN: f64 = 1.0;
const WRONG_SINGLE: f64 = 2.0;

/// Standard deviation of a turn found from the keypoints of [`crate::detect`], in radians
///
/// The root mean square of 12 people is 6.2 degrees, but errors of neighboring views are alike, and up to 17 degrees occur.
const DETECTED_TURN_SD_RADIANS: f64 = 9.0_f64.to_radians();

/// Log-likelihood gain by which the keypoints alone must contradict the stated angles
const CLEAR_TURN_GAIN: f64 = 8.0;

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
    /// Returns the warning about an offset
    pub(super) fn shift_warning(self) -> Option<SkeletonFitWarning> {
        let degrees = self.offset.wrapped().degrees();
        let offset_degrees = if degrees > 180.0 {
            degrees - 360.0
        } else {
            degrees
        };
        let shifted = self != Self::default() && degrees > 0.0;
        shifted.then_some(SkeletonFitWarning::TurnsShifted { offset_degrees })
    }

    /// Returns whether the offset is that of persons who do not quite face the camera at turn 0
    fn is_small_offset(self) -> bool {
        let plain = Self {
            offset: TurnAngle::default(),
            ..self
        } == Self::default();
        plain && distance(self.offset, TurnAngle::default()) < MAX_SMALL_OFFSET_RADIANS
    }

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

/// Returns whether angles that deviate by so many standard deviations from those stated are wrong
pub(crate) fn are_wrong(deviations: impl Iterator<Item = f64>) -> bool {
    let (mut sum, mut count, mut most) = (0.0, 0.0, 0.0_f64);
    for off in deviations {
        sum += off * off;
        count += 1.0;
        most = most.max(off.abs());
    }
    count > 0.0 && (sum > WRONG_MEAN * WRONG_MEAN * count || most > WRONG_SINGLE)
}

/// Solves without the stated turn angles, if the poses of some views turn away from them; `None` if they are confirmed
///
/// Sway turns people, too: angles are wrong only where they differ by more than sway and the statement's own standard
/// deviation explain, and the detector if the keypoints are `detected` by it.
pub(super) fn solve_without_stated(
    problem: &Problem,
    solution: &Solution,
    detected: bool,
    rounds: usize,
) -> Option<(Problem, Solution)> {
    let sd = |view: &ViewData| match detected {
        true => view.turn_sigma_radians.hypot(DETECTED_TURN_SD_RADIANS),
        false => view.turn_sigma_radians,
    };
    let shared = problem.shared(&solution.unknowns.shared);
    let mean = mean_turn(problem, &shared, &solution.unknowns);
    let views = problem.views.iter().zip(&solution.unknowns.poses);
    let seen = views.filter(|(view, _)| view.observed_count() > 0);
    let away = seen.map(|(view, pose)| {
        let turned = shared.pose(view, pose).turned_more().radians() - mean;
        turned.abs() / sd(view)
    });
    if away.fold(0.0, f64::max) <= SUSPICIOUS_TURN {
        return None;
    }
    let mut freed = problem.clone();
    let mut unknowns = solution.unknowns.clone();
    for (view, pose) in freed.views.iter_mut().zip(&mut unknowns.poses) {
        view.free_turn(pose);
    }
    let free = vec![true; freed.views.len()];
    let found = solve_free(&mut freed, unknowns, &free, rounds);
    let pairs = freed.views.iter().zip(&problem.views);
    let off = pairs.map(|(found, stated)| distance(found.turn, stated.turn) / sd(stated));
    let clear = found.cost < solution.cost - CLEAR_TURN_GAIN;
    (clear && are_wrong(off)).then_some((freed, found))
}

/// Returns the views whose stated turn angles differ from those of `found`
///
/// A small offset of all angles is not a correction of its own then.
pub(super) fn wrong_turns(
    views: &[KeypointView],
    found: &Problem,
    correction: &mut TurnCorrection,
) -> Vec<WrongTurn> {
    if correction.is_small_offset() {
        *correction = TurnCorrection::default();
    }
    let pairs = views.iter().zip(&found.views).enumerate();
    let wrong = pairs.filter_map(|(view, (given, found))| {
        let stated = correction.apply(given.turn);
        let off = distance(stated, found.turn) / given.turn_sd_radians;
        (off > REPORTED && found.observed_count() > 0).then_some(WrongTurn {
            view,
            stated,
            found: found.turn,
        })
    });
    wrong.collect()
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
pub(super) fn mean_turn(problem: &Problem, shared: &Shared, unknowns: &Unknowns) -> f64 {
    let poses = problem.views.iter().zip(&unknowns.poses);
    let turns: Vec<f64> = poses
        .filter(|(view, _)| view.observed_count() > 0)
        .map(|(view, pose)| {
            let pose: Pose = shared.pose(view, pose);
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
