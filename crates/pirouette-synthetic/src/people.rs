//! Ready-made people for tests.

use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{ReferencePose, Sex};

use crate::{Clutter, SyntheticOptions, SyntheticScan, synthesize};

/// Columns and rows of rendered photos: small, so that tests are quick
pub const PHOTO_SIZE_PX: (usize, usize) = (200, 250);

/// Renders a woman who turns with the usual sway in front of a plain wall, in evenly spaced views
///
/// # Panics
/// When the built-in mannequin cannot be built.
pub fn turning_woman(view_count: usize) -> SyntheticScan {
    let stature_mm = 1650.0;
    let avatar = mannequin(&MannequinParameters {
        sex: Sex::Female,
        stature_mm: Some(stature_mm),
        pose: ReferencePose::A,
        ..MannequinParameters::default()
    })
    .expect("an average mannequin can be built");
    let (width_px, height_px) = PHOTO_SIZE_PX;
    synthesize(
        &avatar,
        &SyntheticOptions {
            seed: 5,
            turns: SyntheticOptions::even_turns(view_count),
            camera: SyntheticOptions::camera_for(stature_mm, width_px, height_px),
            sway: 1.0,
            keypoint_noise_px: 2.0,
            turn_noise_radians: 0.0,
            sensor_noise: 2.0,
            clutter: Clutter::Plain,
            photos: true,
        },
    )
}
