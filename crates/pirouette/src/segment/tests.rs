use glam::DVec2;

use super::*;
use pirouette_body::{Joint, Keypoint};

const WIDTH: usize = 120;
const HEIGHT: usize = 160;

/// A stick figure at column `x`, about 110 px high
fn keypoints(x: f64) -> Keypoints {
    let mut keypoints = Keypoints::default();
    for (joint, dx, y) in [
        (Joint::Nose, 0.0, 30.0),
        (Joint::Neck, 0.0, 44.0),
        (Joint::MidHip, 0.0, 78.0),
        (Joint::RightShoulder, -10.0, 45.0),
        (Joint::LeftShoulder, 10.0, 45.0),
        (Joint::RightElbow, -16.0, 62.0),
        (Joint::LeftElbow, 16.0, 62.0),
        (Joint::RightWrist, -22.0, 77.0),
        (Joint::LeftWrist, 22.0, 77.0),
        (Joint::RightHip, -6.0, 78.0),
        (Joint::LeftHip, 6.0, 78.0),
        (Joint::RightKnee, -8.0, 104.0),
        (Joint::LeftKnee, 8.0, 104.0),
        (Joint::RightAnkle, -9.0, 130.0),
        (Joint::LeftAnkle, 9.0, 130.0),
    ] {
        let position = DVec2::new(x + dx, y);
        keypoints.set(
            joint,
            Keypoint {
                position,
                confidence: 0.9,
            },
        );
    }
    keypoints
}

/// The stick figure with body thickness around its bones, open between the legs and under the arms
fn truth(x: f64) -> Mask {
    let lines = SeedLines::new(&keypoints(x)).unwrap();
    let mut mask = Mask::filled(WIDTH, HEIGHT, false);
    for line in &lines.lines {
        line.for_each_pixel(WIDTH, HEIGHT, 4.5, |x, y, _| mask[(x, y)] = true);
    }
    mask
}

fn photo(truth: &Mask) -> Photo {
    Photo::from_fn(WIDTH, HEIGHT, |x, y| {
        let noise = ((x * 7919 + y * 104_729) % 17) as u8;
        if truth[(x, y)] {
            [170 + noise, 120, 90 + noise]
        } else if y > 134 {
            [80, 70 + noise, 60]
        } else {
            [120 + noise, 150, 160]
        }
    })
}

fn segment_all(views: &[SegmentView]) -> Vec<Result<Silhouette, SegmentError>> {
    segment(views, None, &SegmentOptions::default(), &|| false)
}

fn view<'a>(photo: &'a Photo, keypoints: &'a Keypoints) -> SegmentView<'a> {
    SegmentView {
        photo,
        keypoints,
        prior: None,
        mask: None,
        person_odds: None,
    }
}

#[test]
fn a_single_photo_is_cut_by_its_bones() {
    let truth = truth(60.0);
    let (photo, keypoints) = (photo(&truth), keypoints(60.0));
    let results = segment_all(&[view(&photo, &keypoints)]);
    let silhouette = results[0].as_ref().unwrap();
    let iou = silhouette.mask.iou(&truth);
    assert!(iou > 0.95, "{iou}\n{}", silhouette.mask.to_art());
    assert!(!silhouette.prior_used);
    let seeds = silhouette.seeds.as_ref().unwrap();
    assert_eq!(seeds[(60, 60)], Seed::Person);
    assert_eq!(seeds[(2, 2)], Seed::Background);
}

#[test]
fn a_scan_uses_the_avatar_unless_the_pose_differs() {
    let places = [40.0, 60.0, 80.0];
    let truths = places.map(truth);
    let photos = truths.each_ref().map(photo);
    let keypoints = places.map(keypoints);
    let priors = [&truths[0], &truths[1], &truths[0]];
    let views: Vec<_> = (0..3)
        .map(|i| SegmentView {
            prior: Some(priors[i]),
            ..view(&photos[i], &keypoints[i])
        })
        .collect();
    let results = segment_all(&views);
    let used: Vec<bool> = results
        .iter()
        .map(|r| r.as_ref().unwrap().prior_used)
        .collect();
    assert_eq!(used, [true, true, false]);
    for (result, truth) in results.iter().zip(&truths) {
        let iou = result.as_ref().unwrap().mask.iou(truth);
        assert!(iou > 0.93, "{iou}");
    }
}

#[test]
fn the_log_odds_of_a_detector_keep_other_people_out_of_a_single_photo() {
    let truth = truth(60.0);
    let others = |x: usize, y: usize| !(20..84).contains(&x) && (40..130).contains(&y);
    let people = Mask::from_fn(WIDTH, HEIGHT, |x, y| truth[(x, y)] || others(x, y));
    let (photo, mut keypoints) = (photo(&people), keypoints(60.0));
    // A wrist is placed on another person.
    let position = DVec2::new(98.0, 80.0);
    let keypoint = Keypoint {
        position,
        confidence: 0.9,
    };
    keypoints.set(Joint::LeftWrist, keypoint);
    let odds = truth.map(|&person| LogOdds::new(if person { 4.0 } else { -4.0 }));
    let pixels_of_others = |person_odds| {
        let view = SegmentView {
            person_odds,
            ..view(&photo, &keypoints)
        };
        let found = segment_all(&[view]).remove(0).unwrap().mask;
        let pixels = (0..WIDTH * HEIGHT).map(|i| (i % WIDTH, i / WIDTH));
        pixels
            .filter(|&(x, y)| found[(x, y)] && others(x, y))
            .count()
    };
    assert!(pixels_of_others(None) > 100);
    assert_eq!(pixels_of_others(Some(&odds)), 0);
}

#[test]
fn a_given_mask_is_the_result() {
    let truth = truth(60.0);
    let (photo, keypoints) = (photo(&truth), Keypoints::default());
    let given = SegmentView {
        mask: Some(&truth),
        ..view(&photo, &keypoints)
    };
    let results = segment_all(&[given]);
    let silhouette = results[0].as_ref().unwrap();
    assert_eq!(silhouette.mask, truth);
    assert!(silhouette.seeds.is_none());
    let empty = Mask::filled(WIDTH, HEIGHT, false);
    let given = SegmentView {
        mask: Some(&empty),
        ..given
    };
    let error = segment_all(&[given]).remove(0).unwrap_err();
    assert_eq!(error, SegmentError::EmptyMask);
}

#[test]
fn photos_are_not_read_when_all_masks_are_given() {
    let truth = truth(60.0);
    let (blank, keypoints) = (Grid::filled(WIDTH, HEIGHT, [0; 3]), Keypoints::default());
    let given = SegmentView {
        mask: Some(&truth),
        ..view(&blank, &keypoints)
    };
    let results = segment_all(&[given, given]);
    for result in &results {
        assert_eq!(result.as_ref().unwrap().mask, truth);
    }
}

#[test]
fn every_invalid_view_has_its_error_and_the_others_succeed() {
    let truth = truth(60.0);
    let (good, figure) = (photo(&truth), keypoints(60.0));
    let (nobody, far_off) = (Keypoints::default(), keypoints(9e9));
    let mut broken = keypoints(60.0);
    for joint in Joint::ALL {
        let mut keypoint = broken.get(joint);
        keypoint.position.x = f64::NAN;
        broken.set(joint, keypoint);
    }
    let black = Photo::filled(WIDTH, HEIGHT, [0; 3]);
    let tiny = Photo::filled(1, 1, [9; 3]);
    let none = Photo::from_vec(0, 0, vec![]);
    let small_prior = Mask::filled(3, 3, true);
    let views = [
        view(&good, &figure),
        view(&good, &nobody),
        view(&good, &broken),
        view(&good, &far_off),
        view(&black, &figure),
        view(&tiny, &figure),
        view(&none, &figure),
        SegmentView {
            prior: Some(&small_prior),
            ..view(&good, &figure)
        },
    ];
    let mut results = segment_all(&views);
    assert!(results.remove(0).unwrap().mask.iou(&truth) > 0.95);
    let errors: Vec<SegmentError> = results.into_iter().map(|r| r.unwrap_err()).collect();
    let (width, height) = (WIDTH, HEIGHT);
    assert_eq!(errors[0], SegmentError::NoSkeleton { found: 0 });
    assert!(matches!(errors[1], SegmentError::NoSkeleton { .. }));
    assert_eq!(errors[2], SegmentError::Outside { width, height });
    assert_eq!(errors[3], SegmentError::Flat { width, height });
    let (width, height) = (1, 1);
    assert_eq!(errors[4], SegmentError::Flat { width, height });
    let (width, height) = (0, 0);
    assert_eq!(errors[5], SegmentError::Flat { width, height });
    assert!(matches!(
        errors[6],
        SegmentError::Size { what: "prior", .. }
    ));
}

#[test]
fn cancelling_ends_every_view() {
    let truth = truth(60.0);
    let (photo, keypoints) = (photo(&truth), keypoints(60.0));
    for count in [1, 2] {
        let views = vec![view(&photo, &keypoints); count];
        for result in segment(&views, None, &SegmentOptions::default(), &|| true) {
            assert_eq!(result.unwrap_err(), SegmentError::Cancelled);
        }
    }
    assert!(segment_all(&[]).is_empty());
}

#[test]
fn two_joints_suffice_for_seeds() {
    let mut keypoints = Keypoints::default();
    for (joint, y) in [(Joint::RightHip, 60.0), (Joint::RightKnee, 86.0)] {
        let position = DVec2::new(50.0, y);
        keypoints.set(
            joint,
            Keypoint {
                position,
                confidence: 0.8,
            },
        );
    }
    let lines = SeedLines::new(&keypoints).unwrap();
    assert_eq!(lines.lines.len(), 1);
    let seeds = lines.seeds(WIDTH, HEIGHT);
    assert_eq!(seeds[(50, 70)], Seed::Person);
    assert_eq!(seeds[(54, 70)], Seed::ProbablePerson);
    assert_eq!(seeds[(50, 5)], Seed::Background);
}
