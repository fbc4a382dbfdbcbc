//! Damped Gauss-Newton over all views: the pose of each view is eliminated, which leaves a small system.

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::{Llt, Solve};
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Accum, Mat, Par, Side};
use pirouette_geom::parallel::prelude::*;

use super::model::{Normal, POSE_COUNT, Problem, Shared, Unknowns, ViewData};
use super::scales::ScaledFrame;

/// Residuals beyond this many standard deviations lose weight
///
/// Detectors occasionally err by far more than usual; with a smaller value, correct keypoints of unusual poses would
/// lose their weight.
pub(super) const ROBUST_WIDTH: f64 = 3.0;

/// A round that lowers the cost by less than this ends the iteration
///
/// The cost is in half squares of standard deviations, so this is far below any visible change.
const SMALL_GAIN: f64 = 1e-2;

/// The same for one view alone, which only compares alternative explanations
const SMALL_TRIAL_GAIN: f64 = 0.3;

/// Damping after the first step that fails, and its limit; in units of the priors' curvature
const FIRST_DAMPING: f64 = 1.0;
const LAST_DAMPING: f64 = 1e8;

/// Result of the solver
#[derive(Debug)]
pub(super) struct Solution {
    pub(super) unknowns: Unknowns,
    /// Half the sum of all squared residuals, in standard deviations, with the robust loss
    pub(super) cost: f64,
    /// Whether the last round changed almost nothing
    pub(super) converged: bool,
}

/// Solves for all unknowns from a start, in at most `rounds` rounds
pub(super) fn solve(problem: &Problem, start: Unknowns, rounds: usize) -> Solution {
    let mut unknowns = start;
    let mut width = f64::INFINITY;
    let mut damping = 0.0;
    let mut converged = false;
    for _ in 0..rounds {
        let shared = problem.shared(&unknowns.shared);
        // Far from the solution every joint appears as an outlier: start with a wide loss, then narrow it.
        width = typical_residual(problem, &shared, &unknowns).clamp(ROBUST_WIDTH, width);
        let before = total_cost(problem, &shared, &unknowns, width);
        let rates = problem.body_rates(&shared);
        let mut gain = 0.0;
        loop {
            let candidate = step(problem, &shared, &rates, &unknowns, width, damping);
            if let Some(candidate) = candidate {
                let shared = problem.shared(&candidate.shared);
                gain = before - total_cost(problem, &shared, &candidate, width);
                if gain >= 0.0 {
                    unknowns = candidate;
                    damping *= 0.1;
                    if damping < FIRST_DAMPING * 1e-2 {
                        damping = 0.0;
                    }
                    break;
                }
            }
            damping = (damping * 10.0).max(FIRST_DAMPING);
            if damping > LAST_DAMPING {
                break;
            }
        }
        if damping > LAST_DAMPING || (gain < SMALL_GAIN && width <= ROBUST_WIDTH) {
            converged = true;
            break;
        }
    }
    let shared = problem.shared(&unknowns.shared);
    Solution {
        cost: total_cost(problem, &shared, &unknowns, ROBUST_WIDTH),
        unknowns,
        converged,
    }
}

/// Solves for the pose of one view with constant shared unknowns; returns it with its cost
pub(super) fn solve_view(
    problem: &Problem,
    view: &ViewData,
    shared: &Shared,
    start: &[f64; POSE_COUNT],
    rounds: usize,
) -> ([f64; POSE_COUNT], f64) {
    let mut pose = *start;
    let mut cost = problem.view_cost(view, shared, &pose, ROBUST_WIDTH);
    let mut damping = 0.0;
    for _ in 0..rounds {
        let normal = problem.normal(view, shared, None, &pose, ROBUST_WIDTH);
        let mut gain = 0.0;
        while damping <= LAST_DAMPING {
            let candidate = Eliminated::new(&normal, &pose, damping)
                .map(|eliminated| eliminated.pose_after(&pose, &[]));
            if let Some(candidate) = candidate {
                let lower = cost - problem.view_cost(view, shared, &candidate, ROBUST_WIDTH);
                if lower >= 0.0 {
                    gain = lower;
                    pose = candidate;
                    cost -= gain;
                    damping = 0.0;
                    break;
                }
            }
            damping = (damping * 10.0).max(FIRST_DAMPING);
        }
        if gain < SMALL_TRIAL_GAIN {
            break;
        }
    }
    (pose, cost)
}

/// Returns the median residual of all keypoints, in standard deviations
fn typical_residual(problem: &Problem, shared: &Shared, unknowns: &Unknowns) -> f64 {
    let mut lengths: Vec<f64> = problem
        .views
        .iter()
        .zip(&unknowns.poses)
        .filter_map(|(view, pose)| problem.residuals(view, shared, pose))
        .flatten()
        .flatten()
        .map(|r| r.length())
        .collect();
    if lengths.is_empty() {
        return ROBUST_WIDTH;
    }
    let middle = lengths.len() / 2;
    *lengths.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn total_cost(problem: &Problem, shared: &Shared, unknowns: &Unknowns, width: f64) -> f64 {
    let views: f64 = problem
        .views
        .iter()
        .zip(&unknowns.poses)
        .map(|(view, pose)| problem.view_cost(view, shared, pose, width))
        .sum();
    views + problem.shared_cost(&unknowns.shared, shared)
}

/// Computes one damped step, `None` when a factorization fails
fn step(
    problem: &Problem,
    shared: &Shared,
    rates: &[ScaledFrame],
    unknowns: &Unknowns,
    width: f64,
    damping: f64,
) -> Option<Unknowns> {
    let count = problem.shared_count();
    // Each view is linearized and eliminated immediately: to store the normal equations of 72 views takes more time
    // than to recompute them after one of the rare failed steps.
    let views: Vec<Eliminated> = problem
        .views
        .par_iter()
        .zip(&unknowns.poses)
        .map(|(view, pose)| {
            let normal = problem.normal(view, shared, Some(rates), pose, width);
            Eliminated::new(&normal, pose, damping)
        })
        .collect::<Option<_>>()?;

    let stature_residual = problem.stature_residual(shared);
    let stature_gradient = problem.stature_gradient(rates);
    let mut matrix = Mat::<f64>::from_fn(count, count, |i, j| {
        stature_gradient[i] * stature_gradient[j]
    });
    let mut gradient = Mat::<f64>::from_fn(count, 1, |i, _| {
        unknowns.shared[i] + stature_gradient[i] * stature_residual
    });
    for i in 0..count {
        matrix[(i, i)] += 1.0 + damping;
    }
    for view in &views {
        matrix += view.shared.submatrix(0, 0, count, count);
        gradient += view.shared.submatrix(0, count, count, 1);
    }
    let factor = Llt::new(matrix.as_ref(), Side::Lower).ok()?;
    factor.solve_in_place(gradient.as_mut());

    let shared_step: Vec<f64> = (0..count).map(|i| -gradient[(i, 0)]).collect();
    let mut moved = unknowns.clone();
    for (x, step) in moved.shared.iter_mut().zip(&shared_step) {
        *x += step;
    }
    for (pose, view) in moved.poses.iter_mut().zip(&views) {
        *pose = view.pose_after(pose, &shared_step);
    }
    Some(moved)
}

/// One view with its pose eliminated
struct Eliminated {
    factor: Llt<f64>,
    /// Solutions of the factor for the columns of the shared unknowns and, last, for the gradient
    solved: Mat<f64>,
    /// Contribution of the view to the matrix of the shared unknowns and, last column, to their gradient
    shared: Mat<f64>,
}

impl Eliminated {
    fn new(normal: &Normal, pose: &[f64; POSE_COUNT], damping: f64) -> Option<Self> {
        let rest = normal.matrix.ncols() - POSE_COUNT;
        let block = |row, column, rows, columns| {
            normal
                .matrix
                .submatrix(row, column, rows, columns)
                .to_owned()
        };
        let mut poses = block(0, 0, POSE_COUNT, POSE_COUNT);
        let mut solved = block(0, POSE_COUNT, POSE_COUNT, rest);
        for (i, x) in pose.iter().enumerate() {
            poses[(i, i)] += 1.0 + damping;
            solved[(i, rest - 1)] += x;
        }
        let factor = Llt::new(poses.as_ref(), Side::Lower).ok()?;
        solve_lower_triangular_in_place(factor.L(), solved.as_mut(), Par::Seq);
        let mut shared = block(POSE_COUNT, POSE_COUNT, rest, rest);
        matmul(
            &mut shared,
            Accum::Add,
            solved.transpose(),
            &solved,
            -1.0,
            Par::Seq,
        );
        Some(Self {
            factor,
            solved,
            shared,
        })
    }

    /// Returns the pose after a step, given the step of the shared unknowns
    fn pose_after(&self, pose: &[f64; POSE_COUNT], shared_step: &[f64]) -> [f64; POSE_COUNT] {
        let gradient = shared_step.len();
        let mut step = Mat::<f64>::from_fn(POSE_COUNT, 1, |i, _| {
            let shared = (0..gradient).map(|j| self.solved[(i, j)] * shared_step[j]);
            -self.solved[(i, gradient)] - shared.sum::<f64>()
        });
        solve_upper_triangular_in_place(self.factor.L().transpose(), step.as_mut(), Par::Seq);
        std::array::from_fn(|i| pose[i] + step[(i, 0)])
    }
}
