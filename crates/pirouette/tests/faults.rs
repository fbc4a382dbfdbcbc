//! Mistakes in the input: corrected with a warning, or refused; never a confident wrong number.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::sync::LazyLock;

use glam::DVec2;
use pirouette::check::{CheckError, CheckWarning, check_scan};
use pirouette::measure::Measure;
use pirouette::pipeline::{
    CancelToken, Config, Goal, Method, Refusal, Report, Suspect, Warning, run,
};
use pirouette::scan::{Photo, Scan};
use pirouette::skeleton_fit::{
    CameraParameter, KeypointView, Skeleton, SkeletonFitOptions, SkeletonFitWarning, SwapGroup,
    fit_skeleton,
};
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Camera, Joint, Keypoint, Keypoints, ReferencePose};
use pirouette_geom::Grid;
use pirouette_synthetic::people::turning_woman;
use pirouette_synthetic::{Clutter, SyntheticOptions, SyntheticScan, synthesize};

/// The person of most tests, rendered once
static WOMAN: LazyLock<SyntheticScan> = LazyLock::new(|| turning_woman(8));

/// The result of [`scan_of_masks`] without a mistake
static HEALTHY: LazyLock<Report> = LazyLock::new(|| scanned(&scan_of_masks()));

fn scan_of_photos() -> Scan {
    WOMAN.scan.clone()
}

/// A scan whose silhouettes are given, which spares the segmentation
fn scan_of_masks() -> Scan {
    let mut scan = scan_of_photos();
    for (view, silhouette) in scan.views.iter_mut().zip(&WOMAN.truth.silhouettes) {
        view.mask = Some(silhouette.clone());
    }
    scan
}

fn scanned(scan: &Scan) -> Report {
    let config = Config::new(Goal::Measure, Method::Fit);
    run(scan, &config, &CancelToken::default(), &mut |_| {})
        .expect("a rendered person can be scanned")
}

fn skeleton_of(scan: &Scan) -> Skeleton {
    let avatar = mannequin(&MannequinParameters::default()).unwrap();
    let views: Vec<KeypointView> = scan.views.iter().map(KeypointView::from).collect();
    let options = SkeletonFitOptions::default();
    let (skeleton, _) =
        fit_skeleton(&avatar, &views, &scan.camera, scan.stature_mm, &options).unwrap();
    skeleton
}

fn change_keypoints(scan: &mut Scan, mut change: impl FnMut(Joint, &mut Keypoint)) {
    for view in &mut scan.views {
        for joint in Joint::ALL {
            let mut keypoint = view.keypoints.get(joint);
            change(joint, &mut keypoint);
            view.keypoints.set(joint, keypoint);
        }
    }
}

/// Copies a raster into one of another size, shifted to the right; new pixels take the nearest one's value
fn padded<T: Copy>(grid: &Grid<T>, left: usize, width: usize, height: usize) -> Grid<T> {
    Grid::from_fn(width, height, |x, y| {
        let x = x.saturating_sub(left).min(grid.width() - 1);
        grid[(x, y.min(grid.height() - 1))]
    })
}

#[test]
fn one_photo_given_eight_times_is_refused() {
    let mut scan = scan_of_photos();
    let (photo, keypoints) = (scan.views[0].photo.clone(), scan.views[0].keypoints);
    for view in &mut scan.views {
        // Compressed again, so that no byte is the same.
        view.photo = photo.map(|color| color.map(|v| v.saturating_add(1)));
        view.keypoints = keypoints;
    }
    let error = check_scan(&mut scan).unwrap_err();
    let CheckError::SamePhotos {
        photo_count,
        different_count,
        ..
    } = error
    else {
        panic!("{error}");
    };
    assert_eq!((photo_count, different_count), (8, 1));
}

#[test]
fn a_repeated_photo_is_found_and_different_ones_are_not() {
    let mut scan = scan_of_photos();
    assert_eq!(check_scan(&mut scan).unwrap(), Default::default());
    scan.views[5].photo = scan.views[2].photo.clone();
    scan.views[5].keypoints = scan.views[2].keypoints;
    assert_eq!(check_scan(&mut scan).unwrap().repeats, [(5, 2)]);
    // The same photo twice at one angle is no contradiction.
    scan.views[5].turn = scan.views[2].turn;
    assert_eq!(check_scan(&mut scan).unwrap().repeats, []);
}

#[test]
fn a_pose_that_the_joints_contradict_is_corrected() {
    let mut scan = scan_of_photos();
    scan.pose = ReferencePose::T;
    let found = ReferencePose::A;
    let warnings = check_scan(&mut scan).unwrap().warnings;
    assert_eq!(warnings, [CheckWarning::OtherPose { found }]);
    assert_eq!(scan.pose, found);
}

#[test]
fn joints_at_the_corner_are_not_found() {
    let mut scan = scan_of_photos();
    let corner = Keypoint {
        position: DVec2::ZERO,
        confidence: 1.0,
    };
    scan.views[3].keypoints.set(Joint::LeftKnee, corner);
    check_scan(&mut scan).unwrap();
    assert_eq!(scan.views[3].keypoints.found(Joint::LeftKnee), None);
}

#[test]
fn left_and_right_swapped_in_all_views_are_corrected() {
    let mut scan = scan_of_photos();
    let right = skeleton_of(&scan);
    for view in &mut scan.views {
        let mut keypoints: Keypoints = view.keypoints;
        SwapGroup::Body.swap(&mut keypoints);
        view.keypoints = keypoints;
    }
    let corrected = skeleton_of(&scan);
    assert!(corrected.turn_correction.swapped);
    assert!(!corrected.turn_correction.reversed);
    assert_eq!(corrected.swaps.len(), 8);
    let off_mm = corrected.camera.distance_mm - right.camera.distance_mm;
    assert!(off_mm.abs() < 1.0, "{off_mm}");
}

#[test]
fn an_impossible_camera_height_is_replaced() {
    let mut scan = scan_of_photos();
    let given_mm = scan.camera.height_mm.unwrap();
    let true_pitch = skeleton_of(&scan).camera.pitch_radians;
    scan.camera.height_mm = Some(given_mm + 700.0);
    let skeleton = skeleton_of(&scan);
    let contradicted = |w: &SkeletonFitWarning| {
        matches!(
            w,
            SkeletonFitWarning::CameraContradicted {
                parameter: CameraParameter::Height,
                ..
            }
        )
    };
    assert!(
        skeleton.warnings.iter().any(contradicted),
        "{:?}",
        skeleton.warnings
    );
    let tilt = (skeleton.camera.pitch_radians - true_pitch).to_degrees();
    assert!(tilt.abs() < 3.0, "{tilt}");
}

#[test]
fn keypoints_of_resized_photos_give_no_measurements() {
    let mut scan = scan_of_masks();
    change_keypoints(&mut scan, |_, keypoint| keypoint.position *= 0.8);
    let report = scanned(&scan);
    assert!(report.measurements.is_none());
    let refusal = report.refusal.expect("the body cannot match");
    assert!(
        matches!(
            refusal,
            Refusal::NoMatch {
                suspect: Suspect::Masks,
                ..
            }
        ),
        "{refusal}"
    );
}

#[test]
fn people_without_feet_are_not_measured() {
    let mut scan = scan_of_masks();
    for view in &mut scan.views {
        let height = view.photo.height() * 17 / 20;
        view.photo = padded(&view.photo, 0, view.photo.width(), height);
        view.mask = view
            .mask
            .take()
            .map(|mask| padded(&mask, 0, mask.width(), height));
    }
    let report = scanned(&scan);
    let refusal = report.refusal.expect("the feet are missing");
    assert_eq!(refusal, Refusal::FeetCutOff { view_count: 8 });
}

#[test]
fn a_person_beside_the_middle_is_measured_as_in_the_middle() {
    let mut scan = scan_of_masks();
    let girth = |report: &Report, measure| {
        let measured = report
            .measurements
            .as_ref()
            .expect("no refusal")
            .get(measure);
        (measured.value_mm.unwrap(), measured.sd_mm.unwrap())
    };
    for view in &mut scan.views {
        let (width, height) = (view.photo.width(), view.photo.height());
        let left = width / 3;
        let pad = |mask: Grid<bool>| {
            Grid::from_fn(width + left, height, |x, y| {
                x >= left && mask[(x - left, y)]
            })
        };
        view.photo = padded(&view.photo, left, width + left, height);
        view.mask = view.mask.take().map(pad);
        for joint in Joint::ALL {
            let mut keypoint = view.keypoints.get(joint);
            keypoint.position.x += left as f64;
            view.keypoints.set(joint, keypoint);
        }
    }
    let beside = scanned(&scan);
    let said = |w: &Warning| {
        matches!(
            w,
            Warning::Skeleton(SkeletonFitWarning::BesideMiddle { .. })
        )
    };
    assert!(beside.warnings.iter().any(said));
    for measure in [Measure::BustGirth, Measure::WaistGirth, Measure::HipGirth] {
        let ((value, _), (other, sd)) = (girth(&HEALTHY, measure), girth(&beside, measure));
        assert!(
            (value - other).abs() < 2.5 * sd,
            "{measure:?}: {value} {other} {sd}"
        );
    }
}

#[test]
fn a_mass_that_contradicts_the_volume_widens_the_deviations() {
    let mut scan = scan_of_masks();
    let mass = HEALTHY
        .measurements
        .as_ref()
        .and_then(|m| m.mass)
        .unwrap()
        .mass_kg;
    scan.subject.mass_kg = Some(1.25 * mass);
    let doubted = scanned(&scan);
    let sd = |report: &Report| {
        let all = report.measurements.as_ref().unwrap();
        all.get(Measure::HipGirth).sd_mm.unwrap()
    };
    assert!(
        sd(&doubted) > 3.0 * sd(&HEALTHY),
        "{} {}",
        sd(&doubted),
        sd(&HEALTHY)
    );
    let said = |w: &Warning| matches!(w, Warning::MassContradicted { .. });
    assert!(doubted.warnings.iter().any(said));
}

#[test]
fn bones_of_unusual_length_widen_the_deviations() {
    let mut scan = scan_of_masks();
    for view in &mut scan.views {
        let arms = [
            (Joint::LeftShoulder, [Joint::LeftElbow, Joint::LeftWrist]),
            (Joint::RightShoulder, [Joint::RightElbow, Joint::RightWrist]),
        ];
        for (shoulder, others) in arms {
            let shoulder = view.keypoints.get(shoulder).position;
            for joint in others {
                let mut keypoint = view.keypoints.get(joint);
                keypoint.position = shoulder.lerp(keypoint.position, 0.6);
                view.keypoints.set(joint, keypoint);
            }
        }
    }
    let short = scanned(&scan);
    let said = |w: &Warning| {
        matches!(
            w,
            Warning::Skeleton(SkeletonFitWarning::UnusualLength { .. })
        )
    };
    assert!(short.warnings.iter().any(said));
    let sd = |report: &Report| {
        let hip = report.measurements.as_ref().unwrap().get(Measure::HipGirth);
        hip.sd_mm.unwrap() / hip.value_mm.unwrap()
    };
    assert!(sd(&short) > sd(&HEALTHY).max(0.029), "{}", sd(&short));
}

#[test]
fn photos_of_another_height_widen_the_deviations_or_give_no_measurements() {
    let of_child = |views: &[usize]| {
        let mut scan = scan_of_masks();
        for &view in views {
            let view = &mut scan.views[view];
            let (width, height) = (view.photo.width(), view.photo.height());
            let floor = 0.9 * height as f64;
            let mask = view.mask.take().unwrap();
            view.mask = Some(Grid::from_fn(width, height, |x, y| {
                let y = floor - (floor - y as f64) / 0.95;
                y >= 0.0 && mask[(x, (y as usize).min(height - 1))]
            }));
        }
        scanned(&scan)
    };
    let said = |w: &Warning| *w == Warning::OtherHeights { view_count: 1 };
    assert!(!HEALTHY.warnings.iter().any(said));
    let one = of_child(&[3]);
    assert!(one.warnings.iter().any(said), "{:?}", one.warnings);
    let several = of_child(&[1, 4, 6]);
    assert!(
        matches!(
            several.refusal,
            Some(Refusal::OtherHeights { view_count: 2.. })
        ),
        "{:?}",
        several.refusal
    );
}

#[test]
fn a_person_before_a_wide_lens_is_measured_as_before_a_straight_one() {
    let girths = |scan: &Scan| {
        let all = scanned(scan).measurements.expect("no refusal");
        [Measure::BustGirth, Measure::WaistGirth, Measure::HipGirth]
            .map(|measure| all.value_mm(measure).unwrap())
    };
    let photographed = |distortion: f64| {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let straight = SyntheticOptions::camera_for(avatar.stature_mm(), 200, 250);
        let options = SyntheticOptions {
            seed: 3,
            turns: SyntheticOptions::even_turns(8),
            camera: Camera {
                distortion,
                ..straight
            },
            sway: 1.0,
            keypoint_noise_px: 2.0,
            turn_noise_radians: 0.0,
            sensor_noise: 2.0,
            clutter: Clutter::Plain,
            photos: true,
        };
        let person = synthesize(&avatar, &options);
        let mut scan = person.scan;
        for (view, silhouette) in scan.views.iter_mut().zip(person.truth.silhouettes) {
            view.mask = Some(silhouette);
        }
        scan
    };
    let mut wide = photographed(0.1);
    let uncorrected = girths(&wide);
    wide.camera.distortion = 0.1;
    let corrected = girths(&wide);
    let expected = girths(&photographed(0.0));
    for i in 0..3 {
        let off = |girths: [f64; 3]| girths[i] / expected[i] - 1.0;
        let (corrected, uncorrected) = (off(corrected), off(uncorrected));
        assert!(corrected.abs() < 0.012, "{i}: {corrected}");
        assert!(uncorrected > 0.025, "{i}: {uncorrected}");
    }
}

#[test]
fn blurred_photos_widen_the_deviations() {
    let mut scan = scan_of_photos();
    let sharp = scanned(&scan);
    for view in &mut scan.views {
        for _ in 0..3 {
            view.photo = box_blurred(&view.photo, 4);
        }
    }
    let blurred = scanned(&scan);
    let said = |w: &Warning| matches!(w, Warning::Blurred { .. });
    assert!(!sharp.warnings.iter().any(said));
    assert!(blurred.warnings.iter().any(said) || blurred.refusal.is_some());
}

/// Means over squares of `2 radius + 1` px
fn box_blurred(photo: &Photo, radius: isize) -> Photo {
    let pass = |photo: &Photo, along: (isize, isize)| {
        Photo::from_fn(photo.width(), photo.height(), |x, y| {
            let at = |k: isize| photo.get(x as isize + k * along.0, y as isize + k * along.1);
            let seen: Vec<&[u8; 3]> = (-radius..=radius).filter_map(at).collect();
            std::array::from_fn(|c| {
                let sum: usize = seen.iter().map(|color| usize::from(color[c])).sum();
                (sum / seen.len()) as u8
            })
        })
    };
    pass(&pass(photo, (1, 0)), (0, 1))
}
