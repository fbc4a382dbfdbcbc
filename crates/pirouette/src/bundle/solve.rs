//! Damped Gauss-Newton over all views: each view's pose is eliminated, what is left is small.

use faer::linalg::solvers::{Llt, Solve};
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, Par, Side};
use rayon::prelude::*;

use super::model::{Normal, POSE_COUNT, Problem, SHARED_COUNT, Shared, Unknowns, ViewData};

/// Residuals beyond this many standard deviations lose weight
///
/// Detectors err by far more than their usual error every now and then; lower, and honest keypoints of an unusual
/// pose lose their say.
pub(super) const ROBUST_WIDTH: f64 = 3.0;

/// A round that lowers the cost by less than this ends the solution
///
/// The cost counts half squares of standard deviations, so this is far below what any unknown could feel.
const SMALL_GAIN: f64 = 1e-2;

/// The same for one view alone, which only compares the ways to explain it
const SMALL_TRIAL_GAIN: f64 = 0.3;

/// Damping after the first step that fails, and its limit; in units of the priors' curvature
const FIRST_DAMPING: f64 = 1.0;
const LAST_DAMPING: f64 = 1e8;

/// What the solver ended with
#[derive(Debug)]
pub(super) struct Solution {
    pub(super) unknowns: Unknowns,
    /// Half the squares of all standard deviations that it is off, outliers tamed
    pub(super) cost: f64,
    /// Whether the last round hardly changed anything
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
        // Far from the solution every joint looks like an outlier: start wide, then narrow down.
        width = typical_residual(problem, &shared, &unknowns).clamp(ROBUST_WIDTH, width);
        let before = total_cost(problem, &shared, &unknowns, width);
        let linear = Linearized::new(problem, &shared, &unknowns, width);
        let mut gain = 0.0;
        loop {
            if let Some(candidate) = linear.step(&unknowns, damping) {
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

/// Solves for the pose of one view while the shared unknowns are held; also gives its cost
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
            let candidate = Eliminated::new(&normal, &pose, 0, damping)
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

/// Median residual of all keypoints, in standard deviations
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

/// The normal equations of all views and of what is shared
struct Linearized {
    normals: Vec<Normal>,
    stature_residual: f64,
    stature_gradient: [f64; SHARED_COUNT],
}

impl Linearized {
    fn new(problem: &Problem, shared: &Shared, unknowns: &Unknowns, width: f64) -> Self {
        let rates = problem.body_rates(shared);
        let normals = problem
            .views
            .par_iter()
            .zip(&unknowns.poses)
            .map(|(view, pose)| problem.normal(view, shared, Some(&rates), pose, width))
            .collect();
        Self {
            normals,
            stature_residual: problem.stature_residual(shared),
            stature_gradient: problem.stature_gradient(&rates),
        }
    }

    /// One damped step, `None` when rounding broke the factorization
    fn step(&self, unknowns: &Unknowns, damping: f64) -> Option<Unknowns> {
        let eliminated: Vec<Eliminated> = self
            .normals
            .par_iter()
            .zip(&unknowns.poses)
            .map(|(normal, pose)| Eliminated::new(normal, pose, SHARED_COUNT, damping))
            .collect::<Option<_>>()?;

        let mut matrix = Mat::<f64>::zeros(SHARED_COUNT, SHARED_COUNT);
        let mut negative_gradient = Mat::<f64>::zeros(SHARED_COUNT, 1);
        for i in 0..SHARED_COUNT {
            for j in 0..SHARED_COUNT {
                matrix[(i, j)] = self.stature_gradient[i] * self.stature_gradient[j];
            }
            matrix[(i, i)] += 1.0 + damping;
            negative_gradient[(i, 0)] =
                -unknowns.shared[i] - self.stature_gradient[i] * self.stature_residual;
        }
        for (normal, view) in self.normals.iter().zip(&eliminated) {
            for i in 0..SHARED_COUNT {
                let row = POSE_COUNT + i;
                for j in 0..SHARED_COUNT {
                    matrix[(i, j)] += normal.matrix[(row, POSE_COUNT + j)] - view.coupling[(i, j)];
                }
                negative_gradient[(i, 0)] += view.coupling[(i, SHARED_COUNT)]
                    - normal.matrix[(row, POSE_COUNT + SHARED_COUNT)];
            }
        }
        let factor = Llt::new(matrix.as_ref(), Side::Lower).ok()?;
        factor.solve_in_place(negative_gradient.as_mut());
        let step: [f64; SHARED_COUNT] = std::array::from_fn(|i| negative_gradient[(i, 0)]);
        Some(Unknowns {
            shared: std::array::from_fn(|i| unknowns.shared[i] + step[i]),
            poses: eliminated
                .iter()
                .zip(&unknowns.poses)
                .map(|(view, pose)| view.pose_after(pose, &step))
                .collect(),
        })
    }
}

/// One view with its pose eliminated
struct Eliminated {
    factor: Llt<f64>,
    /// The factor's solutions for the columns of the shared unknowns and, last, for the gradient
    solved: Mat<f64>,
    /// Products of these columns: what the view takes from the shared equations
    coupling: Mat<f64>,
}

impl Eliminated {
    fn new(
        normal: &Normal,
        pose: &[f64; POSE_COUNT],
        shared_count: usize,
        damping: f64,
    ) -> Option<Self> {
        let mut block = normal
            .matrix
            .submatrix(0, 0, POSE_COUNT, POSE_COUNT)
            .to_owned();
        let mut solved = normal
            .matrix
            .submatrix(0, POSE_COUNT, POSE_COUNT, shared_count + 1)
            .to_owned();
        for (i, x) in pose.iter().enumerate() {
            block[(i, i)] += 1.0 + damping;
            solved[(i, shared_count)] += x;
        }
        let factor = Llt::new(block.as_ref(), Side::Lower).ok()?;
        solve_lower_triangular_in_place(factor.L(), solved.as_mut(), Par::Seq);
        let coupling = solved.transpose() * &solved;
        Some(Self {
            factor,
            solved,
            coupling,
        })
    }

    /// The pose after a step, given the step of the shared unknowns
    fn pose_after(&self, pose: &[f64; POSE_COUNT], shared_step: &[f64]) -> [f64; POSE_COUNT] {
        let gradient = shared_step.len();
        let mut step = Mat::<f64>::from_fn(POSE_COUNT, 1, |i, _| {
            let shared: f64 = shared_step
                .iter()
                .enumerate()
                .map(|(j, s)| self.solved[(i, j)] * s)
                .sum();
            -self.solved[(i, gradient)] - shared
        });
        solve_upper_triangular_in_place(self.factor.L().transpose(), step.as_mut(), Par::Seq);
        std::array::from_fn(|i| pose[i] + step[(i, 0)])
    }
}
