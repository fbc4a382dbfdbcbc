//! Turn angles that are unknown, or stated wrongly: found from the keypoints of all views.
//!
//! Each view starts at the best of many turns all around. Then angles, poses, skeleton and camera are solved together;
//! the angle of each view follows its pose, so that no prior holds it. Left and right are those of the detector unless
//! the opposite explains the keypoints clearly better; a visible face distinguishes front and back.

use pirouette_geom::parallel::prelude::*;

use super::model::{POSE_COUNT, Problem, Shared, TURN, Unknowns, ViewData};
use super::solve::{ROBUST_WIDTH, Solution, solve, solve_view};
use super::swaps::{CLEAR_GAIN, SwapGroup};
use super::turns::MIN_OFFSET_RADIANS;
use super::{SkeletonFitError, SkeletonFitWarning};
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use pirouette_body::TurnAngle;

/// Turns all around that each view is tried at
const TRIED_TURNS: usize = 16;

/// Rounds of the pose for each of them
const TRIAL_ROUNDS: usize = 5;

/// Maximum number of searches for better turns, each followed by a new solution
const SEARCHES: usize = 3;

/// Maximum number of solutions after each of which the angles follow the poses, and the step that ends them
const MAX_FOLLOWS: usize = 8;
const SMALL_STEP_RADIANS: f64 = 0.003;

/// Log-likelihood gain by which another turn replaces that of the solution
const BETTER: f64 = 3.0;

/// Log-likelihood loss of a turn at which a face that is seen would point away, or the opposite
const FACE_LOSS: f64 = 6.0;

/// Cosine of the turn from which a face certainly is seen, and the negative one from which it certainly is not
const FACE_COSINE: f64 = 0.3;

/// Turns of one view that differ by more are different explanations, in radians
const DIFFERENT_RADIANS: f64 = 0.6;

/// Log-likelihood by which the turn of a view must explain it better than any different one, to be certain
const CERTAIN: f64 = 4.0;

/// Minimum number of views with keypoints whose turns can be found
pub(super) const MIN_VIEWS: usize = 4;

/// Maximum fraction of uncertain turns
const MAX_UNCLEAR: f64 = 0.34;

/// Angle without a photo that is reported, in degrees, and that from which a body has no depth
const REPORTED_GAP_DEGREES: f64 = 130.0;
const MAX_GAP_DEGREES: f64 = 290.0;

/// Unknown turns that were found
pub(super) struct FoundTurns {
    pub(super) solution: Solution,
    /// Views in which left and right of all joints are swapped
    pub(super) swapped: Vec<usize>,
    /// Views that another turn explains nearly as well
    pub(super) unclear: Vec<usize>,
}

/// A turn of one view, with the pose that explains the view best
#[derive(Clone, Copy)]
struct Candidate {
    turn: TurnAngle,
    pose: [f64; POSE_COUNT],
    swapped: bool,
    cost: f64,
}

/// Finds the turns of the `free` views; `starts` are estimates of them
pub(super) fn find_turns(
    problem: &mut Problem,
    free: &[bool],
    starts: &[Option<TurnAngle>],
    rounds: usize,
) -> FoundTurns {
    let mut unknowns = problem.start();
    let mut swapped = vec![false; problem.views.len()];
    search(
        problem,
        free,
        starts,
        &mut unknowns,
        &mut swapped,
        f64::INFINITY,
    );
    let mut solution = solve_free(problem, unknowns, free, rounds);
    for _ in 1..SEARCHES {
        let mut unknowns = solution.unknowns.clone();
        if !search(problem, free, starts, &mut unknowns, &mut swapped, BETTER) {
            break;
        }
        solution = solve_free(problem, unknowns, free, rounds);
    }
    let shared = problem.shared(&solution.unknowns.shared);
    let (read, poses) = (&*problem, &solution.unknowns.poses);
    let is_unclear = |index: &usize| {
        let view = &read.views[*index];
        let cost = cost_of(read, view, &shared, &poses[*index], view.turn);
        let different = candidates(read, view, &shared, starts[*index])
            .into_iter()
            .filter(|other| distance(other.turn, view.turn) > DIFFERENT_RADIANS);
        let best = different
            .map(|other| other.cost)
            .fold(f64::INFINITY, f64::min);
        best < cost + CERTAIN
    };
    let indices = (0..read.views.len()).into_par_iter();
    FoundTurns {
        unclear: indices.filter(|&i| free[i]).filter(is_unclear).collect(),
        swapped: (0..swapped.len()).filter(|&i| swapped[i]).collect(),
        solution,
    }
}

/// Checks that enough turns were found
///
/// # Errors
/// When too few views have keypoints, or most turns are uncertain.
pub(super) fn check_found(
    problem: &Problem,
    found: &FoundTurns,
    free: &[bool],
) -> Result<(), SkeletonFitError> {
    let seen = problem
        .views
        .iter()
        .filter(|view| view.observed_count() > 0)
        .count();
    if seen < MIN_VIEWS {
        return Err(SkeletonFitError::TooFewTurns { found: seen });
    }
    let (unclear, unknown) = (
        found.unclear.len(),
        free.iter().filter(|free| **free).count(),
    );
    if unclear as f64 > MAX_UNCLEAR * unknown as f64 {
        return Err(SkeletonFitError::TurnsUnclear { unclear, unknown });
    }
    Ok(())
}

/// Checks that the turns show the person from all sides; returns the warning about a large gap
///
/// # Errors
/// When all views are from about the same side.
pub(super) fn check_spread(
    turns: &[TurnAngle],
) -> Result<Option<SkeletonFitWarning>, SkeletonFitError> {
    let mut degrees: Vec<f64> = turns.iter().map(|turn| turn.wrapped().degrees()).collect();
    degrees.sort_by(f64::total_cmp);
    let next = degrees
        .iter()
        .skip(1)
        .copied()
        .chain(degrees.first().map(|first| first + 360.0));
    let gaps = degrees
        .iter()
        .zip(next)
        .map(|(from, to)| (to - from, *from));
    let Some((gap_degrees, from)) = gaps.max_by(|a, b| a.0.total_cmp(&b.0)) else {
        return Ok(None);
    };
    if gap_degrees > MAX_GAP_DEGREES {
        return Err(SkeletonFitError::TurnsAlike {
            range_degrees: 360.0 - gap_degrees,
        });
    }
    let to = (from + gap_degrees).rem_euclid(360.0);
    let warning = SkeletonFitWarning::TurnsGap {
        from_degrees: from,
        to_degrees: to,
    };
    Ok((gap_degrees > REPORTED_GAP_DEGREES).then_some(warning))
}

/// Puts turn 0 where the stated angles have it, or, if they differ clearly from it, where the body faces the camera
///
/// Returns the offset that is added to the stated angles.
pub(super) fn fix_zero(problem: &mut Problem, unknowns: &mut Unknowns, free: &[bool]) -> TurnAngle {
    let shared = problem.shared(&unknowns.shared);
    let views = problem.views.iter().zip(&unknowns.poses).zip(free);
    let stated = views.filter(|((view, _), free)| !**free && view.observed_count() > 0);
    let turned = |((view, pose), _): ((&ViewData, &[f64; POSE_COUNT]), &bool)| {
        shared.pose(view, pose).turned_more().radians()
    };
    let turned: Vec<f64> = stated.map(turned).collect();
    let mean = turned.iter().sum::<f64>() / turned.len().max(1) as f64;
    let offset = if mean.abs() > MIN_OFFSET_RADIANS {
        mean
    } else {
        0.0
    };
    let views = problem.views.iter_mut().zip(&mut unknowns.poses).zip(free);
    for ((view, pose), &free) in views {
        let more = shared.pose(view, pose).turned_more().radians();
        let rest = if free { mean } else { more };
        view.center_turn(pose, rest - offset);
    }
    TurnAngle::from_radians(offset)
}

/// Puts each free view at the turn that explains it best, if it is better by `gain`; returns whether any changed
fn search(
    problem: &mut Problem,
    free: &[bool],
    starts: &[Option<TurnAngle>],
    unknowns: &mut Unknowns,
    swapped: &mut [bool],
    gain: f64,
) -> bool {
    let shared = problem.shared(&unknowns.shared);
    let read = &*problem;
    let best: Vec<Option<Candidate>> = (0..read.views.len())
        .into_par_iter()
        .map(|index| {
            let view = &read.views[index];
            if !free[index] || view.observed_count() == 0 {
                return None;
            }
            let now = cost_of(read, view, &shared, &unknowns.poses[index], view.turn);
            let all = candidates(read, view, &shared, starts[index]);
            let best = all.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
            (gain.is_infinite() || best.cost < now - gain).then_some(best)
        })
        .collect();
    let mut changed = false;
    for (index, best) in best.into_iter().enumerate() {
        let Some(best) = best else {
            continue;
        };
        let view = &mut problem.views[index];
        view.turn = best.turn;
        if best.swapped {
            SwapGroup::Body.swap_observed(view);
            swapped[index] = !swapped[index];
        }
        unknowns.poses[index] = best.pose;
        changed = true;
    }
    changed
}

/// Returns the best pose of a view from each of many turns, with left and right as given and swapped
fn candidates(
    problem: &Problem,
    view: &ViewData,
    shared: &Shared,
    start: Option<TurnAngle>,
) -> Vec<Candidate> {
    let around =
        (0..TRIED_TURNS).map(|i| TurnAngle::from_degrees(360.0 * i as f64 / TRIED_TURNS as f64));
    let mut found = Vec::new();
    for swapped in [false, true] {
        let mut tried = view.clone();
        if swapped {
            SwapGroup::Body.swap_observed(&mut tried);
        }
        for turn in around.clone().chain(start.filter(|_| !swapped)) {
            tried.turn = turn;
            let (mut pose, _) =
                solve_view(problem, &tried, shared, &[0.0; POSE_COUNT], TRIAL_ROUNDS);
            tried.center_turn(&mut pose, 0.0);
            let loss = if swapped { CLEAR_GAIN } else { 0.0 };
            found.push(Candidate {
                turn: tried.turn,
                pose,
                swapped,
                cost: cost_of(problem, &tried, shared, &pose, tried.turn) + loss,
            });
        }
    }
    found
}

/// Returns the cost of a view at a turn, with that of its face
fn cost_of(
    problem: &Problem,
    view: &ViewData,
    shared: &Shared,
    pose: &[f64; POSE_COUNT],
    turn: TurnAngle,
) -> f64 {
    let cosine = turn.radians().cos();
    let contradicted = match view.face_seen {
        Some(true) => cosine < -FACE_COSINE,
        Some(false) => cosine > FACE_COSINE,
        None => false,
    };
    let loss = if contradicted { FACE_LOSS } else { 0.0 };
    problem.view_cost(view, shared, pose, ROBUST_WIDTH) + loss
}

/// Solves with turns of the `free` views that follow their poses
pub(super) fn solve_free(
    problem: &mut Problem,
    start: Unknowns,
    free: &[bool],
    rounds: usize,
) -> Solution {
    let mut solution = solve(problem, start, rounds);
    for _ in 0..MAX_FOLLOWS {
        let mut most: f64 = 0.0;
        let views = problem.views.iter_mut().zip(&mut solution.unknowns.poses);
        for ((view, pose), _) in views.zip(free).filter(|(_, free)| **free) {
            let before = view.turn;
            view.center_turn(pose, 0.0);
            most = most.max(distance(before, view.turn));
        }
        if most < SMALL_STEP_RADIANS {
            break;
        }
        solution = solve(problem, solution.unknowns, rounds);
    }
    solution
}

/// Returns the smallest angle between two turns, in radians
pub(super) fn distance(a: TurnAngle, b: TurnAngle) -> f64 {
    let between = a.radians() - b.radians();
    between.sin().atan2(between.cos()).abs()
}

/// Returns the standard deviation of each view's turn by the normal equations of its pose, in radians
///
/// Skeleton and camera are assumed to be known. A free turn has no prior.
pub(super) fn turn_sds(problem: &Problem, unknowns: &Unknowns, free: &[bool]) -> Vec<f64> {
    let shared = problem.shared(&unknowns.shared);
    let views = problem.views.iter().zip(&unknowns.poses).zip(free);
    let sd = |((view, pose), &free): ((&ViewData, &[f64; POSE_COUNT]), &bool)| {
        let normal = problem.normal(view, &shared, None, pose, ROBUST_WIDTH);
        let mut matrix = normal
            .matrix
            .submatrix(0, 0, POSE_COUNT, POSE_COUNT)
            .to_owned();
        for i in 0..POSE_COUNT {
            matrix[(i, i)] += if free && i == TURN { 1e-9 } else { 1.0 };
        }
        let mut column = Mat::<f64>::zeros(POSE_COUNT, 1);
        column[(TURN, 0)] = 1.0;
        let sd = Llt::new(matrix.as_ref(), Side::Lower).ok().map(|factor| {
            factor.solve_in_place(column.as_mut());
            column[(TURN, 0)].sqrt() * view.turn_sigma_radians
        });
        sd.filter(|sd| sd.is_finite())
            .unwrap_or(std::f64::consts::PI)
            .min(std::f64::consts::PI)
    };
    views.map(sd).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_directions() {
        let of = |a: f64, b: f64| {
            distance(TurnAngle::from_degrees(a), TurnAngle::from_degrees(b)).to_degrees()
        };
        assert!((of(350.0, 10.0) - 20.0).abs() < 1e-9);
        assert!((of(-180.0, 180.0)).abs() < 1e-9);
        assert!((of(90.0, 300.0) - 150.0).abs() < 1e-9);
    }
}
