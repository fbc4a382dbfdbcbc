use std::io::Cursor;

use glam::DVec2;
use image::{GrayImage, ImageFormat, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use pirouette_body::{Joint, Keypoint};
use proptest::prelude::*;

use super::*;

const WIDTH: u32 = 80;
const HEIGHT: u32 = 120;

/// A person of 24 x 80 px in the left half, or at the right
fn is_person(x: u32, y: u32) -> bool {
    (14..38).contains(&x) && (20..100).contains(&y)
}

fn is_other(x: u32, y: u32) -> bool {
    (50..74).contains(&x) && (20..100).contains(&y)
}

fn keypoints() -> Keypoints {
    let keypoint = |(index, joint): (usize, Joint)| {
        let position = DVec2::new(18.0 + (index % 4) as f64 * 5.0, 24.0 + index as f64 * 3.0);
        (
            joint,
            Keypoint {
                position,
                confidence: 0.9,
            },
        )
    };
    Joint::ALL.into_iter().enumerate().map(keypoint).collect()
}

fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.into().write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn gray(level: impl Fn(u32, u32) -> u8) -> Vec<u8> {
    png(GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
        Luma([level(x, y)])
    }))
}

fn read(bytes: &[u8]) -> Result<GivenMask, MaskError> {
    read_mask(bytes, (WIDTH as usize, HEIGHT as usize), &keypoints())
}

#[track_caller]
fn reads_as_person(bytes: &[u8], fixes: &[MaskFix]) {
    let given = read(bytes).unwrap();
    let person = |x: usize, y: usize| is_person(x as u32, y as u32);
    let person = Mask::from_fn(WIDTH as usize, HEIGHT as usize, person);
    assert_eq!(given.fixes, fixes);
    assert!(given.mask.iou(&person) > 0.999, "{}", given.mask.to_art());
}

/// Color of a person who is nowhere exactly black or white
fn skin(x: u32, y: u32) -> [u8; 3] {
    [
        120 + (x % 90) as u8,
        60 + (y % 120) as u8,
        40 + ((x * y) % 150) as u8,
    ]
}

#[test]
fn white_on_black_is_unchanged() {
    let bytes = gray(|x, y| if is_person(x, y) { 255 } else { 0 });
    reads_as_person(&bytes, &[]);
}

#[test]
fn a_black_person_is_inverted() {
    let bytes = gray(|x, y| if is_person(x, y) { 0 } else { 255 });
    reads_as_person(&bytes, &[MaskFix::Inverted]);
    let without = read_mask(&bytes, (80, 120), &Keypoints::default()).unwrap();
    assert_eq!(without.fixes, [MaskFix::Inverted]);
    // Without joints, a white image with a small black spot may be anything.
    let spot = gray(|x, y| if (x, y) == (9, 9) { 0 } else { 255 });
    let spot = read_mask(&spot, (80, 120), &Keypoints::default()).unwrap();
    assert!(spot.fixes.is_empty());
}

#[test]
fn joints_outside_the_outline_do_not_hide_an_inversion() {
    let mut noisy = keypoints();
    for joint in Joint::ALL.into_iter().take(8) {
        let mut keypoint = noisy.get(joint);
        keypoint.position.x = 39.5;
        noisy.set(joint, keypoint);
    }
    let bytes = gray(|x, y| if is_person(x, y) { 0 } else { 255 });
    let given = read_mask(&bytes, (80, 120), &noisy).unwrap();
    assert_eq!(given.fixes, [MaskFix::Inverted]);
}

#[test]
fn levels_of_0_and_1_are_read() {
    let bytes = gray(|x, y| u8::from(is_person(x, y)));
    reads_as_person(&bytes, &[MaskFix::LowLevels { highest: 1 }]);
    let wide =
        image::ImageBuffer::from_fn(WIDTH, HEIGHT, |x, y| Luma([u16::from(is_person(x, y))]));
    let bytes = png(DynamicImage::ImageLuma16(wide));
    reads_as_person(&bytes, &[MaskFix::LowLevels { highest: 1 }]);
}

#[test]
fn cut_outs_are_read() {
    let clear = RgbaImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let [r, g, b] = skin(x, y);
        Rgba([r, g, b, if is_person(x, y) { 255 } else { 0 }])
    });
    reads_as_person(&png(clear), &[MaskFix::Alpha]);
    for background in [0, 255] {
        let plain = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
            Rgb(if is_person(x, y) {
                skin(x, y)
            } else {
                [background; 3]
            })
        });
        reads_as_person(&png(plain), &[MaskFix::CutOut]);
    }
}

#[test]
fn a_photo_is_no_mask() {
    let photo = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| Rgb(skin(x, y)));
    assert!(matches!(read(&png(photo)), Err(MaskError::Unclear)));
}

#[test]
fn the_label_at_the_joints_is_the_person() {
    let colored = |person: [u8; 3], other: [u8; 3]| {
        png(RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
            Rgb(match (is_person(x, y), is_other(x, y)) {
                (true, _) => person,
                (_, true) => other,
                _ => [0, 0, 0],
            })
        }))
    };
    let bytes = colored([128, 0, 0], [0, 128, 0]);
    reads_as_person(&bytes, &[MaskFix::Label { label_count: 3 }]);
    let bytes = gray(|x, y| u8::from(is_person(x, y)) + 2 * u8::from(is_other(x, y)));
    reads_as_person(&bytes, &[MaskFix::Label { label_count: 3 }]);
    let none = read_mask(&bytes, (80, 120), &Keypoints::default());
    assert!(matches!(none, Err(MaskError::NoLabel { label_count: 3 })));
}

#[test]
fn of_several_people_the_one_with_joints_is_used() {
    let both = gray(|x, y| {
        if is_person(x, y) || is_other(x, y) {
            255
        } else {
            0
        }
    });
    reads_as_person(&both, &[MaskFix::OtherPeople]);
}

#[test]
fn a_mask_of_another_photo_is_rejected() {
    let other = gray(|x, y| if is_other(x, y) { 255 } else { 0 });
    let error = read(&other).unwrap_err();
    assert!(matches!(
        error,
        MaskError::Elsewhere {
            inside: 0,
            found: 25
        }
    ));
}

#[test]
fn masks_of_the_same_shape_are_scaled() {
    let half = GrayImage::from_fn(WIDTH / 2, HEIGHT / 2, |x, y| {
        Luma([if is_person(2 * x, 2 * y) { 255 } else { 0 }])
    });
    let (width, height) = (40, 60);
    reads_as_person(&png(half), &[MaskFix::Scaled { width, height }]);
    let cropped = GrayImage::from_pixel(WIDTH, HEIGHT - 10, Luma([255]));
    let error = read(&png(cropped)).unwrap_err();
    assert!(matches!(
        error,
        MaskError::Size {
            width: 80,
            height: 110
        }
    ));
}

#[test]
fn black_is_empty() {
    assert!(matches!(read(&gray(|_, _| 0)), Err(MaskError::Empty)));
}

proptest! {
    #[test]
    fn any_pixels_are_a_mask_or_an_error(
        width in 1_u32..9,
        height in 1_u32..9,
        seed in prop::collection::vec(prop::sample::select(vec![0_u8, 1, 2, 127, 254, 255]), 1..40),
        channels in 1_usize..4,
    ) {
        let at = |x: u32, y: u32, c: usize| seed[(x as usize * 7 + y as usize * 3 + c % channels) % seed.len()];
        let image = RgbaImage::from_fn(width, height, |x, y| {
            Rgba([at(x, y, 0), at(x, y, 1), at(x, y, 2), at(y, x, 3)])
        });
        if let Ok(given) = read_mask(&png(image), (2 * width as usize, 2 * height as usize), &keypoints()) {
            prop_assert_eq!((given.mask.width(), given.mask.height()), (2 * width as usize, 2 * height as usize));
        }
    }
}
