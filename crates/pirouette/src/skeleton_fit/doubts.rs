//! Given parameters of the camera that the keypoints contradict.

use std::fmt;

use super::model::Problem;
use super::solve::{Solution, solve};
use super::{SkeletonFitOptions, start};
use crate::scan::CameraSetup;

/// A parameter of the camera that can be given
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraParameter {
    /// Height above the floor, in mm
    Height,
    /// Distance from the turning axis, in mm
    Distance,
    /// Vertical field of view, in degrees
    FieldOfView,
    /// Pitch, in degrees
    Pitch,
}

impl CameraParameter {
    const ALL: [CameraParameter; 4] = [
        CameraParameter::Height,
        CameraParameter::Distance,
        CameraParameter::FieldOfView,
        CameraParameter::Pitch,
    ];

    /// Returns the key in the manifest
    pub fn key(self) -> &'static str {
        match self {
            CameraParameter::Height => "camera.height_mm",
            CameraParameter::Distance => "camera.distance_mm",
            CameraParameter::FieldOfView => "camera.vertical_fov_deg",
            CameraParameter::Pitch => "camera.pitch_deg",
        }
    }

    fn given(self, setup: &CameraSetup) -> Option<f64> {
        match self {
            CameraParameter::Height => setup.height_mm,
            CameraParameter::Distance => setup.distance_mm,
            CameraParameter::FieldOfView => setup.vertical_fov_radians.map(f64::to_degrees),
            CameraParameter::Pitch => setup.pitch_radians.map(f64::to_degrees),
        }
    }

    /// Smallest change that contradicts a given value; the offsets of joints between detectors explain smaller ones
    fn tolerance(self, given: f64) -> f64 {
        match self {
            CameraParameter::Height => 100.0,
            CameraParameter::Distance | CameraParameter::FieldOfView => 0.06 * given,
            CameraParameter::Pitch => 2.0,
        }
    }

    /// Returns the value in a solution
    fn solved(self, problem: &Problem, solution: &Solution) -> Option<f64> {
        let shared = problem.shared(&solution.unknowns.shared);
        let camera = shared.camera_of(problem.views.first()?);
        Some(match self {
            CameraParameter::Height => camera.height_mm,
            CameraParameter::Distance => camera.distance_mm,
            CameraParameter::FieldOfView => camera.vertical_fov_radians.to_degrees(),
            CameraParameter::Pitch => camera.pitch_radians.to_degrees(),
        })
    }

    /// Returns the problem without the given value
    fn freed(self, given: &Problem, options: &SkeletonFitOptions) -> Problem {
        let mut problem = given.clone();
        let camera = &mut problem.camera;
        match self {
            CameraParameter::Height => camera.height_mm = start::unknown_height(given.stature_mm),
            CameraParameter::Distance => {
                camera.distance_mm = (given.seen_distance_mm, start::DISTANCE_SIGMA_MM);
            }
            CameraParameter::FieldOfView => {
                // The distance that the person's size suggests changes with the focal length.
                let usual = start::USUAL_VERTICAL_FOV_DEGREES.to_radians();
                let ratio = (camera.vertical_fov_radians / 2.0).tan() / (usual / 2.0).tan();
                camera.vertical_fov_radians = usual;
                camera.log_focal_sigma = start::UNKNOWN_LOG_FOCAL_SIGMA;
                camera.distance_mm.0 *= ratio;
            }
            CameraParameter::Pitch => camera.pitch_radians = (0.0, options.pitch_sigma_radians),
        }
        problem
    }
}

impl fmt::Display for CameraParameter {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.key())
    }
}

/// Log-likelihood gain required to replace a given value
///
/// Freed values of correct scans gain at most 1.3, those of wrong ones 60 to 130.
const CLEAR_GAIN: f64 = 16.0;

/// A given parameter that the keypoints contradict, and the solution without it
pub(super) struct Contradicted {
    pub(super) parameter: CameraParameter,
    pub(super) given: f64,
    pub(super) found: f64,
    pub(super) problem: Problem,
    pub(super) solution: Solution,
}

/// Finds the given parameter of the camera that the keypoints contradict most, if there is one
///
/// A wrong value of one parameter is also explained by others, less well: only the best explanation counts.
pub(super) fn find_contradicted(
    problem: &Problem,
    solution: &Solution,
    setup: &CameraSetup,
    options: &SkeletonFitOptions,
) -> Option<Contradicted> {
    let free = |parameter: CameraParameter| {
        let given = parameter.given(setup)?;
        let freed = parameter.freed(problem, options);
        let solved = solve(&freed, freed.start(), options.rounds);
        let found = parameter.solved(&freed, &solved)?;
        let clear = solved.cost < solution.cost - CLEAR_GAIN;
        clear.then_some(Contradicted {
            parameter,
            given,
            found,
            problem: freed,
            solution: solved,
        })
    };
    let all = CameraParameter::ALL.into_iter().filter_map(free);
    let best = all.min_by(|a, b| a.solution.cost.total_cmp(&b.solution.cost))?;
    let change = (best.found - best.given).abs();
    (change > best.parameter.tolerance(best.given)).then_some(best)
}
