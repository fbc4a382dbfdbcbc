//! Results of the skeleton fit for scans with known truth, and invariants.

mod scene;
mod turns;

use glam::{DVec2, DVec3};
use proptest::prelude::*;

use super::model::OFFSET_SIGMA_MM;
use super::*;
use pirouette_body::Keypoint;
use scene::{
    Noise, STATURE_MM, Setting, Solved, Truth, body, joint_error_mm, scales, scan, setup, solved,
};

#[test]
fn exact_keypoints_of_the_reference_pose_give_distance_and_lengths() {
    let truth = scan(&Setting {
        sway: 0.0,
        ..Setting::default()
    });
    let found = solved(&truth);
    let distance = found.skeleton.camera.distance_mm;
    assert!((distance / 2400.0 - 1.0).abs() < 3e-3, "{distance}");
    for (scale, solved_factor) in BoneScale::ALL
        .iter()
        .map(|s| (s, found.skeleton.scales.factor(*s)))
    {
        let expected = scales().factor(*scale);
        assert!(
            (solved_factor / expected - 1.0).abs() < 0.02,
            "{scale:?} {solved_factor} {expected}"
        );
    }
    assert!(joint_error_mm(&truth, &found) < 8.0);
    assert!(found.skeleton.rms_px < 0.5, "{}", found.skeleton.rms_px);
    assert!(found.skeleton.swaps.is_empty() && found.skeleton.outliers.is_empty());
    assert_eq!(found.skeleton.warnings, []);
}

#[test]
fn sway_and_noise_stay_within_bounds() {
    for seed in 1..4 {
        let truth = scan(&Setting {
            noise_px: 3.0,
            seed,
            ..Setting::default()
        });
        let found = solved(&truth);
        let distance = found.skeleton.camera.distance_mm;
        assert!((distance / 2400.0 - 1.0).abs() < 0.015, "{distance}");
        let error = joint_error_mm(&truth, &found);
        assert!(error < 20.0, "{error}");
        assert!(
            (2.0..5.0).contains(&found.skeleton.rms_px),
            "{}",
            found.skeleton.rms_px
        );
        assert!(found.skeleton.swaps.is_empty());
    }
}

#[test]
fn a_pitched_camera_is_seen_from_the_keypoints() {
    let truth = scan(&Setting {
        pitch_radians: 5.0_f64.to_radians(),
        ..Setting::default()
    });
    let found = solved(&truth);
    let pitch = found.skeleton.camera.pitch_radians.to_degrees();
    assert!((pitch - 5.0).abs() < 0.5, "{pitch}");
    assert!(joint_error_mm(&truth, &found) < 20.0);
}

#[test]
fn an_unknown_camera_is_estimated_and_said_so() {
    let truth = scan(&Setting::default());
    let (skeleton, views) = fit_skeleton(
        &body(),
        &truth.views,
        &CameraSetup::default(),
        None,
        &SkeletonFitOptions::default(),
    )
    .unwrap();
    let found = Solved { skeleton, views };
    let has_warning = |f: fn(&SkeletonFitWarning) -> bool| found.skeleton.warnings.iter().any(f);
    assert!(has_warning(
        |w| matches!(w, SkeletonFitWarning::StatureUnknown { assumed_mm } if (*assumed_mm - 1700.0).abs() < 1e-9)
    ));
    assert!(has_warning(|w| matches!(
        w,
        SkeletonFitWarning::FieldOfViewUnknown { .. }
    )));
    assert!(has_warning(|w| matches!(
        w,
        SkeletonFitWarning::CameraHeightUnknown { .. }
    )));
    let camera = found.skeleton.camera;
    assert!((camera.height_mm - 900.0).abs() < 120.0, "{camera:?}");
    assert!(
        (camera.distance_mm / 2400.0 - 1.0).abs() < 0.1,
        "{camera:?}"
    );
    assert!(found.skeleton.rms_px < 2.0);
}

#[test]
fn a_posture_of_its_own_is_told_from_sway() {
    let truth = scan(&Setting {
        noise_px: 2.0,
        ..Setting::default()
    });
    assert_eq!(solved(&truth).skeleton.posture, Pose::default());

    let bent = scan(&Setting {
        noise_px: 2.0,
        forearms_degrees: -35.0,
        ..Setting::default()
    });
    let found = solved(&bent);
    for bone in [Bone::LeftForearm, Bone::RightForearm] {
        let degrees = found.skeleton.posture.rotations[bone].x.to_degrees();
        assert!((-45.0..-15.0).contains(&degrees), "{degrees}");
    }
    assert!(found.skeleton.swaps.is_empty());
    let error = joint_error_mm(&bent, &found);
    assert!(error < 20.0, "{error}");
}

#[test]
fn a_given_distance_is_kept() {
    let truth = scan(&Setting::default());
    let mut camera = setup(&truth.camera);
    camera.distance_mm = Some(2400.0);
    let options = SkeletonFitOptions::default();
    let found: Solved = fit_skeleton(&body(), &truth.views, &camera, Some(STATURE_MM), &options)
        .unwrap()
        .into();
    assert!((found.skeleton.camera.distance_mm - 2400.0).abs() < 10.0);
}

#[test]
fn swapped_limbs_are_found_and_mended() {
    let truth = scan(&Setting {
        noise_px: 2.0,
        ..Setting::default()
    });
    let honest = solved(&truth);
    let mut confused = Truth {
        views: truth.views.clone(),
        body: truth.body.clone(),
        poses: truth.poses.clone(),
        ..truth
    };
    let injected = [
        (0, SwapGroup::Arms),
        (3, SwapGroup::Legs),
        (4, SwapGroup::Body),
        (5, SwapGroup::Face),
    ];
    for (view, limb) in injected {
        limb.swap(&mut confused.views[view].keypoints);
    }
    let found = solved(&confused);
    let mut swaps = found.skeleton.swaps.clone();
    swaps.sort_unstable();
    assert_eq!(swaps, injected);
    for (view, keypoints) in found.views.iter().map(|v| &v.keypoints).enumerate() {
        assert_eq!(*keypoints, truth.views[view].keypoints);
    }
    assert!((found.skeleton.camera.distance_mm - honest.skeleton.camera.distance_mm).abs() < 5.0);

    let options = SkeletonFitOptions {
        fix_swaps: false,
        ..SkeletonFitOptions::default()
    };
    let camera = setup(&truth.camera);
    let left: Solved = fit_skeleton(
        &body(),
        &confused.views,
        &camera,
        Some(STATURE_MM),
        &options,
    )
    .unwrap()
    .into();
    assert!(left.skeleton.swaps.is_empty() && !left.skeleton.outliers.is_empty());
}

#[test]
fn turn_angles_of_the_wrong_sign_or_start_are_corrected() {
    let right = solved(&scan(&Setting::default()));
    assert_eq!(right.skeleton.turn_correction, TurnCorrection::default());
    let truth = scan(&Setting {
        noise_px: 2.0,
        ..Setting::default()
    });
    for (sign, offset_degrees) in [(-1.0, 0.0), (1.0, 180.0), (-1.0, 90.0), (1.0, 30.0)] {
        let mut stated = truth.clone();
        for view in &mut stated.views {
            // Angles stated by a user for a person who in truth turned by `sign * stated + offset`
            let degrees = sign * (view.turn.degrees() - offset_degrees);
            view.turn = TurnAngle::from_degrees(degrees);
        }
        let found = solved(&stated);
        assert_eq!(found.skeleton.turn_correction.reversed, sign < 0.0);
        let backward = found
            .skeleton
            .warnings
            .contains(&SkeletonFitWarning::TurnedBackward);
        assert_eq!(backward, sign < 0.0);
        let off = found.skeleton.turn_correction.offset.degrees() - offset_degrees;
        let off = (off + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off.abs() < 4.0, "{sign} {offset_degrees}: {off}");
        let shifted = |w: &SkeletonFitWarning| matches!(w, SkeletonFitWarning::TurnsShifted { .. });
        assert_eq!(
            found.skeleton.warnings.iter().any(shifted),
            offset_degrees != 0.0
        );
        let error = joint_error_mm(&truth, &found);
        assert!(error < 40.0, "{sign} {offset_degrees}: {error}");
    }
}

#[test]
fn an_outlier_is_named_and_harmless() {
    let mut truth = scan(&Setting {
        noise_px: 1.0,
        ..Setting::default()
    });
    let mut knee = truth.views[2].keypoints.get(Joint::LeftKnee);
    knee.position += DVec2::new(180.0, -60.0);
    truth.views[2].keypoints.set(Joint::LeftKnee, knee);
    let found = solved(&truth);
    assert_eq!(found.skeleton.outliers.len(), 1);
    let outlier = found.skeleton.outliers[0];
    assert_eq!((outlier.view, outlier.joint), (2, Joint::LeftKnee));
    assert!((outlier.residual_px - 190.0).abs() < 25.0, "{outlier:?}");
    let error = joint_error_mm(&truth, &found);
    assert!(error < 20.0, "{error}");
}

#[test]
fn any_number_of_views_at_any_angle_works() {
    for turns in [vec![30.0], vec![0.0, 0.0], vec![-400.0, 123.4, 77.0]] {
        let count = turns.len();
        let truth = scan(&Setting {
            turns,
            noise_px: 2.0,
            ..Setting::default()
        });
        let found = solved(&truth);
        assert_eq!(found.views.len(), count);
        assert!(found.skeleton.rms_px < 6.0);
        assert!((found.skeleton.camera.distance_mm / 2400.0 - 1.0).abs() < 0.1);
    }
}

#[test]
fn a_view_without_keypoints_takes_the_mean_pose() {
    let mut truth = scan(&Setting::default());
    truth.views[3].keypoints = Keypoints::default();
    let found = solved(&truth);
    assert_eq!(
        found.skeleton.warnings,
        [SkeletonFitWarning::ViewWithoutKeypoints { view: 3 }]
    );
    let others = found
        .views
        .iter()
        .enumerate()
        .filter(|&(view, _)| view != 3);
    let bone = Bone::LeftForearm;
    let mean = others
        .map(|(_, view)| view.pose.rotations[bone])
        .sum::<DVec3>()
        / 7.0;
    assert!((found.views[3].pose.rotations[bone] - mean).length() < 1e-12);
    assert_eq!(found.views[3].pose.shift_mm, DVec3::ZERO);
}

#[test]
fn unusable_input_is_an_error() {
    let truth = scan(&Setting::default());
    let camera = setup(&truth.camera);
    let run = |views: &[KeypointView], stature_mm: f64| {
        let options = SkeletonFitOptions::default();
        fit_skeleton(&body(), views, &camera, Some(stature_mm), &options).unwrap_err()
    };
    assert_eq!(run(&[], STATURE_MM), SkeletonFitError::NoViews);
    let meters = run(&truth.views, 1.7);
    assert_eq!(
        meters,
        SkeletonFitError::StatureImplausible { stature_mm: 1.7 }
    );
    assert!(matches!(
        run(&truth.views, f64::NAN),
        SkeletonFitError::StatureImplausible { .. }
    ));

    let mut blind = truth.views.clone();
    for view in &mut blind {
        for joint in Joint::ALL {
            let mut keypoint = view.keypoints.get(joint);
            keypoint.position = DVec2::NAN;
            view.keypoints.set(joint, keypoint);
        }
    }
    assert_eq!(
        run(&blind, STATURE_MM),
        SkeletonFitError::NoKeypoints { views: 8 }
    );
    blind[0]
        .keypoints
        .set(Joint::Nose, truth.views[0].keypoints.get(Joint::Nose));
    assert_eq!(
        run(&blind, STATURE_MM),
        SkeletonFitError::TooFewJoints { found: 1 }
    );

    let mut level = truth.views.clone();
    for view in &mut level {
        for joint in Joint::ALL {
            let mut keypoint = view.keypoints.get(joint);
            keypoint.position.y = 400.0;
            view.keypoints.set(joint, keypoint);
        }
    }
    assert_eq!(run(&level, STATURE_MM), SkeletonFitError::NoScale);

    let mut empty = body();
    empty.mesh.positions.clear();
    empty.weights.clear();
    let options = SkeletonFitOptions::default();
    let error = fit_skeleton(&empty, &truth.views, &camera, None, &options).unwrap_err();
    assert_eq!(error, SkeletonFitError::AvatarUnusable);
}

#[test]
fn rescaling_stretches_bones_and_keeps_soles_and_axis() {
    let mut only_shins = BoneScales::default();
    only_shins.logs[BoneScale::Shin as usize] = 1.1_f64.ln();
    let rest = body();
    let long = rescale_avatar(&rest, &only_shins);
    let length =
        |avatar: &Avatar, a: Bone, b: Bone| (avatar.bone_heads[a] - avatar.bone_heads[b]).length();
    for bone in Bone::ALL {
        let Some(parent) = bone.parent() else {
            continue;
        };
        let shin = matches!(bone, Bone::LeftFoot | Bone::RightFoot);
        let expected = length(&rest, bone, parent) * if shin { 1.1 } else { 1.0 };
        assert!((length(&long, bone, parent) - expected).abs() < 1e-9);
    }
    let (low, _) = long.mesh.bounds().unwrap();
    assert!(low.y.abs() < 1e-9);
    let feet = [Bone::LeftFoot, Bone::RightFoot].map(|b| long.bone_heads[b]);
    assert!((feet[0] + feet[1]).x.abs() < 1e-9);
    let hips = |avatar: &Avatar| avatar.bone_heads[Bone::Root];
    assert!((hips(&long).z - hips(&rest).z).abs() < 1e-9);
}

#[test]
fn derivatives_match_differences() {
    let truth = scan(&Setting {
        noise_px: 4.0,
        turns: vec![70.0],
        ..Setting::default()
    });
    let mut warnings = Vec::new();
    let camera = CameraSetup::default();
    let options = SkeletonFitOptions::default();
    let start = start::prepare(&body(), &truth.views, &camera, &options, &mut warnings).unwrap();
    let problem = Problem {
        frame: Frame::new(&body()).unwrap(),
        stature_mm: STATURE_MM,
        camera: start.camera,
        offset_sigma_mm: OFFSET_SIGMA_MM,
        seen_distance_mm: start.seen_distance_mm,
        free_posture: true,
        views: start.views,
    };
    let mut noise = Noise(7);
    let mut unknowns = problem.start();
    unknowns.shared = unknowns.shared.map(|_| 0.5 * noise.normal());
    unknowns.poses[0] = unknowns.poses[0].map(|_| 0.5 * noise.normal());
    let width = 3.0;
    let cost = |unknowns: &Unknowns| {
        let shared = problem.shared(&unknowns.shared);
        let view = problem.view_cost(&problem.views[0], &shared, &unknowns.poses[0], width);
        view + problem.shared_cost(&unknowns.shared, &shared)
    };
    let shared = problem.shared(&unknowns.shared);
    let rates = problem.body_rates(&shared);
    let (view, pose) = (&problem.views[0], &unknowns.poses[0]);
    let normal = problem.normal(view, &shared, Some(&rates), pose, width);
    let stature = problem.stature_residual(&shared);
    let stature_gradient = problem.stature_gradient(&rates);
    let last = model::POSE_COUNT + model::SHARED_COUNT;
    for i in 0..last {
        let at = |step: f64| {
            let mut moved = unknowns.clone();
            match i.checked_sub(model::POSE_COUNT) {
                None => moved.poses[0][i] += step,
                Some(i) => moved.shared[i] += step,
            }
            cost(&moved)
        };
        let difference = (at(1e-4) - at(-1e-4)) / 2e-4;
        let expected = normal.matrix[(i, last)]
            + match i.checked_sub(model::POSE_COUNT) {
                None => unknowns.poses[0][i],
                Some(i) => unknowns.shared[i] + stature_gradient[i] * stature,
            };
        let tolerance = 1e-4 * (1.0 + expected.abs());
        assert!(
            (difference - expected).abs() < tolerance,
            "{i}: {difference} {expected}"
        );
    }
}

#[test]
fn whole_turns_and_photo_size_change_nothing() {
    let truth = scan(&Setting {
        noise_px: 2.0,
        ..Setting::default()
    });
    let reference = solved(&truth);
    let mut views = truth.views.clone();
    for (index, view) in views.iter_mut().enumerate() {
        view.turn = TurnAngle::from_degrees(view.turn.degrees() - 360.0);
        if index % 2 == 0 {
            // a larger photo of the same view
            view.width_px *= 3;
            view.height_px *= 3;
            for joint in Joint::ALL {
                let mut keypoint = view.keypoints.get(joint);
                keypoint.position *= 3.0;
                view.keypoints.set(joint, keypoint);
            }
        }
    }
    let found = solved(&Truth { views, ..truth });
    let pairs = reference.views.iter().zip(&found.views);
    for (a, b) in pairs.map(|(a, b)| (&a.pose, &b.pose)) {
        let pairs = a.to_parameters().into_iter().zip(b.to_parameters());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
    }
    let (a, b) = (reference.skeleton.camera, found.skeleton.camera);
    assert!((a.distance_mm - b.distance_mm).abs() < 1e-6);
    assert!((a.focal_px() * 3.0 - b.focal_px()).abs() < 1e-6);
}

/// Mirrored photos with mirrored turns give the mirrored person
#[test]
fn mirrored_photos_give_mirrored_poses() {
    let truth = scan(&Setting {
        noise_px: 2.0,
        ..Setting::default()
    });
    let reference = solved(&truth);
    let mut views = truth.views.clone();
    for (mirror, view) in views.iter_mut().zip(&truth.views) {
        mirror.turn = TurnAngle::from_radians(-view.turn.radians());
        for joint in Joint::ALL {
            let mut keypoint = view.keypoints.get(joint.mirrored());
            keypoint.position.x = view.width_px as f64 - keypoint.position.x;
            mirror.keypoints.set(joint, keypoint);
        }
    }
    let found = solved(&Truth { views, ..truth });
    for (view, pose) in reference.views.iter().map(|v| &v.pose).enumerate() {
        for bone in Bone::ALL {
            let a = pose.rotations[bone];
            let b = found.views[view].pose.rotations[bone.mirrored()];
            // rotation vectors are axial: x is unchanged, y and z change sign
            assert!((DVec3::new(a.x, -a.y, -a.z) - b).length() < 1e-6);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn wild_keypoints_never_panic_and_never_give_nan(
        seed in any::<u64>(),
        count in 1usize..6,
        spread in prop_oneof![Just(1.0), Just(300.0), Just(1e6), Just(1e300)],
        width_px in prop_oneof![Just(0usize), Just(1), Just(800)],
        height_px in prop_oneof![Just(0usize), Just(1), Just(1000)],
        fov in prop_oneof![Just(None), Just(Some(f64::NAN)), Just(Some(0.0)), Just(Some(3.0))],
    ) {
        let mut noise = Noise(seed);
        let views: Vec<KeypointView> = (0..count)
            .map(|_| {
                let mut keypoints = Keypoints::default();
                for joint in Joint::ALL {
                    let position = DVec2::new(noise.normal(), noise.normal()) * spread;
                    let position = if noise.uniform() < 0.1 { DVec2::NAN } else { position };
                    keypoints.set(joint, Keypoint { position, confidence: noise.uniform() });
                }
                let turn = TurnAngle::from_degrees(1000.0 * noise.normal());
                let turn_sd_radians = if noise.uniform() < 0.5 { 0.1 } else { f64::INFINITY };
                KeypointView { turn, turn_sd_radians, time_s: None, keypoints, keypoint_kind: KeypointKind::default(), width_px, height_px }
            })
            .collect();
        let camera = CameraSetup { vertical_fov_radians: fov, ..CameraSetup::default() };
        let options = SkeletonFitOptions::default();
        if let Ok(found) = fit_skeleton(&body(), &views, &camera, Some(STATURE_MM), &options) {
            let found = Solved::from(found);
            prop_assert!(found.skeleton.rms_px.is_finite());
            prop_assert!(found.views.iter().all(|v| v.camera.distance_mm.is_finite()));
            prop_assert!(found.views.iter().flat_map(|v| v.pose.to_parameters()).all(f64::is_finite));
            prop_assert!(found.skeleton.avatar.mesh.positions.iter().all(|p| p.is_finite()));
        }
    }
}
