//! Keypoints that are estimated without a detector, against those of rendered people.

use pirouette::estimate::{EstimateError, estimate_keypoints};
use pirouette::scan::{Photo, Scan};
use pirouette_body::{Joint, Keypoints};
use pirouette_synthetic::people::turning_woman;

fn without_keypoints(mut scan: Scan) -> Scan {
    for view in &mut scan.views {
        view.keypoints = Keypoints::default();
    }
    scan
}

/// Returns the mean distance of all joints in all views, relative to the height of the person
fn mean_error(person: &Scan, found: &[Keypoints]) -> f64 {
    let mut sum = 0.0;
    let mut count = 0;
    for (view, found) in person.views.iter().zip(found) {
        let height = 0.75 * view.photo.height() as f64;
        for joint in Joint::ALL {
            let truth = view.keypoints.get(joint).position;
            let found = found
                .found(joint)
                .expect("every joint is estimated")
                .position;
            sum += truth.distance(found) / height;
            count += 1;
        }
    }
    assert_eq!(count, 25 * person.views.len());
    sum / f64::from(u32::try_from(count).expect("few joints"))
}

/// Returns the room, where any photo shows it; elsewhere a uniform color, and all darker
fn empty_room(scan: &Scan, silhouettes: &[pirouette_geom::Mask]) -> Photo {
    let first = &scan.views[0].photo;
    Photo::from_fn(first.width(), first.height(), |x, y| {
        let mut views = scan.views.iter().zip(silhouettes);
        let free = views.find(|(_, silhouette)| !silhouette[(x, y)]);
        let color = free.map_or([140; 3], |(view, _)| view.photo[(x, y)]);
        color.map(|channel| channel.saturating_sub(12))
    })
}

#[test]
fn joints_are_estimated_from_photos_alone() {
    let person = turning_woman(8);
    let found = estimate_keypoints(&without_keypoints(person.scan.clone()), None, &|| false);
    let error = mean_error(&person.scan, &found.expect("a static room"));
    assert!(error < 0.03, "{error}");
}

#[test]
fn a_photo_of_the_empty_room_shows_the_person_in_few_photos() {
    let person = turning_woman(8);
    let room = empty_room(&person.scan, &person.truth.silhouettes);
    let mut scan = without_keypoints(person.scan.clone());
    scan.views.truncate(3);
    let error = estimate_keypoints(&scan, None, &|| false).expect_err("three photos");
    assert_eq!(error, EstimateError::TooFewViews { count: 3 });
    let mut three = person.scan;
    three.views.truncate(3);
    let found = estimate_keypoints(&scan, Some(&room), &|| false).expect("a photo of the room");
    let error = mean_error(&three, &found);
    assert!(error < 0.04, "{error}");
}

#[test]
fn given_masks_replace_rough_silhouettes() {
    let person = turning_woman(8);
    let mut scan = without_keypoints(person.scan.clone());
    for (view, silhouette) in scan.views.iter_mut().zip(person.truth.silhouettes) {
        view.mask = Some(silhouette);
        // The photos show nothing.
        view.photo = view.photo.map(|_| [90; 3]);
    }
    let found = estimate_keypoints(&scan, None, &|| false).expect("masks");
    let error = mean_error(&person.scan, &found);
    assert!(error < 0.03, "{error}");
}

#[test]
fn photos_without_a_person_are_refused() {
    let mut scan = without_keypoints(turning_woman(8).scan);
    for view in &mut scan.views {
        view.photo = view.photo.map(|_| [90; 3]);
    }
    let error = estimate_keypoints(&scan, None, &|| false).expect_err("nothing in the photos");
    let first = "000".to_owned();
    let expected = EstimateError::NoPerson {
        count: 8,
        total: 8,
        first,
    };
    assert_eq!(error, expected);
}

#[test]
fn photos_that_have_nothing_in_common_are_refused() {
    let mut scan = without_keypoints(turning_woman(8).scan);
    for (shade, view) in scan.views.iter_mut().enumerate() {
        let shade = 30 * u8::try_from(shade).expect("few views");
        view.photo = view.photo.map(|_| [shade; 3]);
    }
    let error = estimate_keypoints(&scan, None, &|| false).expect_err("no background");
    assert!(matches!(error, EstimateError::NoPerson { .. }), "{error}");
}

#[test]
fn a_background_of_another_size_is_refused() {
    let scan = without_keypoints(turning_woman(4).scan);
    let room = Photo::filled(20, 30, [90; 3]);
    let error = estimate_keypoints(&scan, Some(&room), &|| false).expect_err("another size");
    let text = error.to_string();
    assert!(text.contains("20x30") && text.contains("200x250"), "{text}");
}

#[test]
fn photos_of_several_sizes_are_refused() {
    let mut scan = without_keypoints(turning_woman(8).scan);
    let photo = &scan.views[2].photo;
    scan.views[2].photo = photo.crop(0, 0, photo.width() - 8, photo.height());
    let error = estimate_keypoints(&scan, None, &|| false).expect_err("two sizes");
    assert!(matches!(error, EstimateError::Size { .. }), "{error}");
}
