//! Turn angles that are unknown or wrong.

use super::*;

/// Uneven turns in any order
const UNEVEN: [f64; 8] = [200.0, 31.0, 255.0, 3.0, 118.0, 163.0, 296.0, 77.0];

fn at(turns: &[f64], seed: u64) -> Truth {
    let mut truth = scan(&Setting {
        turns: turns.to_vec(),
        noise_px: 3.0,
        seed,
        ..Setting::default()
    });
    for view in &mut truth.views {
        (view.turn, view.turn_sd_radians) = (TurnAngle::default(), f64::INFINITY);
    }
    truth
}

fn try_solve(truth: &Truth) -> Result<Solved, SkeletonFitError> {
    let options = SkeletonFitOptions::default();
    let setup = setup(&truth.camera);
    fit_skeleton(&body(), &truth.views, &setup, Some(STATURE_MM), &options).map(Solved::from)
}

/// Returns the errors of the turns of the bodies, in degrees
fn errors(truth: &Truth, turns: &[f64], found: &Solved) -> Vec<f64> {
    let pairs = found.views.iter().zip(turns).zip(&truth.poses);
    let error = |((found, turn), pose): ((&SkeletonView, &f64), &Pose)| {
        let found = found.turn.degrees() + found.pose.turned_more().degrees();
        let off = found - turn - pose.turned_more().degrees();
        (off + 180.0).rem_euclid(360.0) - 180.0
    };
    pairs.map(error).collect()
}

fn worst(errors: &[f64]) -> f64 {
    errors.iter().fold(0.0, |most, error| most.max(error.abs()))
}

#[test]
fn unknown_turns_are_found_in_any_order() {
    for seed in 1..4 {
        let truth = at(&UNEVEN, seed);
        let found = try_solve(&truth).unwrap();
        let errors = errors(&truth, &UNEVEN, &found);
        assert!(worst(&errors) < 5.0, "{errors:?}");
        assert!(
            found
                .views
                .iter()
                .all(|view| view.turn_from == TurnFrom::Found)
        );
        assert!(
            found
                .views
                .iter()
                .all(|view| (0.2..6.0).contains(&view.turn_sd_radians.to_degrees()))
        );
        assert!(found.skeleton.unclear_turns.is_empty());
    }
}

#[test]
fn unknown_turns_are_found_with_left_and_right_swapped_in_a_view() {
    let mut truth = at(&UNEVEN, 5);
    SwapGroup::Body.swap(&mut truth.views[1].keypoints);
    let found = try_solve(&truth).unwrap();
    assert!(worst(&errors(&truth, &UNEVEN, &found)) < 6.0);
    assert_eq!(found.skeleton.swaps, [(1, SwapGroup::Body)]);
}

#[test]
fn a_stated_angle_fixes_the_zero() {
    let mut truth = at(&UNEVEN, 2);
    let facing = try_solve(&truth).unwrap();
    // Two degrees more than the direction that the body faces
    let stated = facing.views[0].turn.degrees() + 2.0;
    truth.views[0].turn = TurnAngle::from_degrees(stated);
    truth.views[0].turn_sd_radians = STATED_TURN_SD_DEGREES.to_radians();
    let found = try_solve(&truth).unwrap();
    assert_eq!(found.views[0].turn_from, TurnFrom::Stated);
    assert!((found.views[0].turn.degrees() - stated).abs() < 1e-9);
    assert_eq!(found.skeleton.turn_correction, TurnCorrection::default());
    // All bodies face the angle of their view as far as that of the stated one does.
    let beside = found.views[0].pose.turned_more().radians();
    assert!(beside.abs() > 1e-3);
    for view in &found.views {
        assert!((view.pose.turned_more().radians() - beside).abs() < 1e-9);
    }
}

/// Eight views at steps of 45 degrees, which are stated, and these angles
fn stated() -> (Truth, Vec<f64>) {
    let turns: Vec<f64> = (0..8).map(|i| 45.0 * f64::from(i)).collect();
    let mut truth = at(&turns, 3);
    for (view, degrees) in truth.views.iter_mut().zip(&turns) {
        view.turn = TurnAngle::from_degrees(*degrees);
        view.turn_sd_radians = STATED_TURN_SD_DEGREES.to_radians();
    }
    (truth, turns)
}

#[test]
fn a_wrong_angle_is_replaced_and_named() {
    let (mut truth, turns) = stated();
    let right = try_solve(&truth).unwrap();
    assert_eq!(right.skeleton.wrong_turns, []);
    assert!(
        right
            .views
            .iter()
            .all(|view| view.turn_from == TurnFrom::Stated)
    );
    truth.views[2].turn = TurnAngle::from_degrees(turns[2] + 25.0);
    let found = try_solve(&truth).unwrap();
    let wrong: Vec<usize> = found
        .skeleton
        .wrong_turns
        .iter()
        .map(|wrong| wrong.view)
        .collect();
    assert!(wrong.contains(&2) && wrong.len() <= 3, "{wrong:?}");
    assert!(worst(&errors(&truth, &turns, &found)) < 5.0);
    assert!(
        found
            .views
            .iter()
            .all(|view| view.turn_from == TurnFrom::Corrected)
    );
}

#[test]
fn an_angle_that_differs_by_less_than_the_detector_errs_is_kept() {
    let (mut truth, turns) = stated();
    truth.views[5].turn = TurnAngle::from_degrees(turns[5] + 13.0);
    assert_ne!(try_solve(&truth).unwrap().skeleton.wrong_turns, []);
    for view in &mut truth.views {
        view.keypoint_kind = KeypointKind::MediaPipe;
    }
    assert_eq!(try_solve(&truth).unwrap().skeleton.wrong_turns, []);
}

#[test]
fn turns_that_cannot_give_a_body_are_an_error() {
    let few = try_solve(&at(&[0.0, 120.0, 240.0], 1));
    assert_eq!(few.unwrap_err(), SkeletonFitError::TooFewTurns { found: 3 });
    let front = try_solve(&at(&[0.0, 5.0, -4.0, 8.0, -7.0, 2.0], 1));
    assert!(
        matches!(front, Err(SkeletonFitError::TurnsAlike { range_degrees }) if range_degrees < 40.0)
    );
}

#[test]
fn a_gap_of_half_a_turn_is_reported() {
    let half: Vec<f64> = (0..6).map(|i| 36.0 * f64::from(i)).collect();
    let found = try_solve(&at(&half, 1)).unwrap();
    let gaps = found
        .skeleton
        .warnings
        .iter()
        .filter_map(|warning| match warning {
            SkeletonFitWarning::TurnsGap {
                from_degrees,
                to_degrees,
            } => Some((*from_degrees, *to_degrees)),
            _ => None,
        });
    let gaps: Vec<(f64, f64)> = gaps.collect();
    assert!(
        gaps.len() == 1 && (gaps[0].0 - 180.0).abs() < 10.0,
        "{gaps:?}"
    );
}

#[test]
fn without_face_and_feet_no_wrong_turn_is_certain() {
    let mut truth = at(&UNEVEN, 4);
    let hidden = [
        Joint::Nose,
        Joint::LeftEye,
        Joint::LeftEar,
        Joint::LeftBigToe,
        Joint::LeftSmallToe,
        Joint::LeftHeel,
    ];
    for view in &mut truth.views {
        for joint in hidden {
            view.keypoints.set(joint, Keypoint::default());
            view.keypoints.set(joint.mirrored(), Keypoint::default());
        }
    }
    match try_solve(&truth) {
        Err(error) => assert!(
            matches!(error, SkeletonFitError::TurnsUnclear { .. }),
            "{error}"
        ),
        Ok(found) => {
            let errors = errors(&truth, &UNEVEN, &found);
            let unclear = |view: &usize| found.skeleton.unclear_turns.contains(view);
            let certain = (0..UNEVEN.len()).filter(|view| !unclear(view));
            assert!(
                certain
                    .map(|view| errors[view].abs())
                    .all(|error| error < 20.0),
                "{errors:?}"
            );
        }
    }
}
