//! Scale of rendered people whose stature is not stated.

use pirouette::scale::{ScaleError, scale_by_card, scale_by_pixels};
use pirouette::scan::StatureFrom;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_synthetic::{Clutter, SyntheticOptions, synthesize};

#[test]
fn the_size_of_a_pixel_gives_the_stature() {
    let person = mannequin(&MannequinParameters {
        stature_mm: Some(1580.0),
        ..MannequinParameters::default()
    })
    .unwrap();
    let camera = SyntheticOptions::camera_for(1580.0, 320, 400);
    let mut scan = synthesize(
        &person,
        &SyntheticOptions {
            seed: 4,
            turns: SyntheticOptions::even_turns(8),
            camera,
            sway: 0.5,
            keypoint_noise_px: 1.0,
            turn_noise_radians: 0.0,
            sensor_noise: 0.0,
            clutter: Clutter::Plain,
            photos: false,
        },
    )
    .scan;
    scan.stature_mm = None;
    let mm_per_px = camera.distance_mm / camera.focal_px();
    scale_by_pixels(&mut scan, mm_per_px, StatureFrom::PixelSize).unwrap();
    let error = scan.stature_mm.unwrap() / 1580.0 - 1.0;
    assert!(error.abs() < 0.02, "{error}");
    assert_eq!(scan.stature_from, StatureFrom::PixelSize);
    let wrong = scale_by_pixels(&mut scan, 5.0 * mm_per_px, StatureFrom::PixelSize);
    assert!(matches!(wrong, Err(ScaleError::Implausible { .. })));
    assert!(matches!(scale_by_card(&mut scan), Err(ScaleError::NoCard)));
}
