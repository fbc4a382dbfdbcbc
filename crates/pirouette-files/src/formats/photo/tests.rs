use super::*;
use proptest::prelude::*;

fn gradient(width: usize, height: usize) -> Photo {
    Photo::from_fn(width, height, |x, y| [(x * 3) as u8, (y * 5) as u8, 90])
}

/// Builds a JPEG file with the given EXIF entries of the primary image, each a tag and a short number
fn jpeg_with_exif(photo: &Photo, entries: &[(u16, u16)]) -> Vec<u8> {
    let mut tiff = b"MM\0\x2a\0\0\0\x08".to_vec();
    // The equivalent focal length is in the EXIF directory, which the first entry points to.
    let (main, sub): (Vec<_>, Vec<_>) = entries.iter().partition(|(tag, _)| *tag == 0x0112);
    let main_size = 2 + 12 * (main.len() + 1) + 4;
    tiff.extend(((main.len() + 1) as u16).to_be_bytes());
    let short = |tiff: &mut Vec<u8>, (tag, value): (u16, u16)| {
        tiff.extend(tag.to_be_bytes());
        tiff.extend([0, 3, 0, 0, 0, 1]);
        tiff.extend(value.to_be_bytes());
        tiff.extend([0, 0]);
    };
    for entry in main {
        short(&mut tiff, entry);
    }
    tiff.extend(0x8769_u16.to_be_bytes());
    tiff.extend([0, 4, 0, 0, 0, 1]);
    tiff.extend((8 + main_size as u32).to_be_bytes());
    tiff.extend([0; 4]);
    tiff.extend((sub.len() as u16).to_be_bytes());
    for entry in sub {
        short(&mut tiff, entry);
    }
    tiff.extend([0; 4]);
    let mut bytes = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, 95);
    encoder.add_exif_metadata(&tiff).unwrap();
    encoder
        .encode(
            photo.as_slice().as_flattened(),
            photo.width() as u16,
            photo.height() as u16,
            jpeg_encoder::ColorType::Rgb,
        )
        .unwrap();
    bytes
}

#[test]
fn png_round_trips() {
    let photo = gradient(40, 50);
    let decoded = decode_photo(&encode_photo_png(&photo).unwrap()).unwrap();
    assert_eq!(decoded.photo.as_slice(), photo.as_slice());
    assert_eq!(decoded.vertical_fov_radians, None);
    let mask = Mask::from_art(".## #.#");
    assert_eq!(decode_mask(&encode_mask(&mask).unwrap()).unwrap(), mask);
}

#[test]
fn exif_provides_the_orientation_and_the_field_of_view() {
    // 6: the camera was rotated, the photo needs a quarter turn clockwise
    let bytes = jpeg_with_exif(&gradient(60, 40), &[(0x0112, 6), (0xa405, 28)]);
    let decoded = decode_photo(&bytes).unwrap();
    assert_eq!((decoded.photo.width(), decoded.photo.height()), (40, 60));
    // x increases to the right in the file, so downward when upright
    assert!(decoded.photo[(20, 55)][0] > decoded.photo[(20, 5)][0] + 100);
    // 28 mm covers 65.47 degrees of a 3:2 photo along its longer side
    let degrees = decoded.vertical_fov_radians.unwrap().to_degrees();
    assert!((degrees - 65.470).abs() < 0.01, "{degrees}");
}

#[test]
fn unknown_or_implausible_focal_lengths_are_ignored() {
    for focal in [0, 1, 9000] {
        let bytes = jpeg_with_exif(&gradient(60, 40), &[(0xa405, focal)]);
        assert_eq!(decode_photo(&bytes).unwrap().vertical_fov_radians, None);
    }
}

#[test]
fn a_truncated_jpeg_is_an_error() {
    let bytes = jpeg_with_exif(&gradient(80, 90), &[]);
    assert!(decode_photo(&bytes).is_ok());
    let mut appended = bytes.clone();
    appended.extend(b"what phones append");
    assert!(decode_photo(&appended).is_ok());
    for share in [3, 10, 50, 90, 99] {
        let cut = &bytes[..bytes.len() * share / 100];
        assert!(decode_photo(cut).is_err(), "{share} %");
    }
    assert!(matches!(
        decode_photo(&bytes[..bytes.len() - 20]),
        Err(PhotoError::Truncated)
    ));
}

#[test]
fn truncated_png_is_damaged() {
    let bytes = encode_photo_png(&gradient(80, 90)).unwrap();
    let cut = &bytes[..bytes.len() / 2];
    assert!(matches!(decode_photo(cut), Err(PhotoError::Damaged(_))));
}

#[test]
fn other_file_types_are_reported_by_name() {
    assert!(matches!(decode_photo(b""), Err(PhotoError::Empty)));
    assert!(matches!(
        decode_photo(b"text"),
        Err(PhotoError::UnknownFormat)
    ));
    assert!(matches!(
        decode_photo(b"GIF89a\x01\0\x01\0\0"),
        Err(PhotoError::UnknownFormat)
    ));
    assert!(matches!(
        decode_photo(b"\0\0\0\x18ftypheic\0\0\0\0"),
        Err(PhotoError::Heic)
    ));
}

#[test]
fn a_small_file_that_claims_a_huge_photo_is_rejected() {
    let mut bytes = encode_photo_png(&gradient(40, 40)).unwrap();
    // width and height of the header, whose checksum becomes invalid
    bytes[16..24].copy_from_slice(&[0, 0, 0xf0, 0, 0, 0, 0xf0, 0]);
    assert!(decode_photo(&bytes).is_err());
}

#[test]
fn one_pixel_is_too_small_and_one_color_is_blank() {
    let bytes = encode_photo_png(&gradient(1, 1)).unwrap();
    assert!(matches!(
        decode_photo(&bytes),
        Err(PhotoError::TooSmall { .. })
    ));
    let black = Photo::filled(64, 64, [0; 3]);
    assert!(matches!(
        check_contrast(&black),
        Err(PhotoError::Blank { .. })
    ));
    assert!(check_contrast(&gradient(64, 64)).is_ok());
}

#[test]
fn shrinking_averages_areas() {
    let photo = Photo::from_vec(4, 2, [0, 8, 16, 24, 4, 12, 20, 28].map(|v| [v; 3]).into());
    let small = shrink(photo, 2);
    assert_eq!((small.width(), small.height()), (2, 1));
    assert_eq!(small.as_slice(), [[6; 3], [22; 3]]);
}

#[test]
fn resampling_keeps_a_ramp() {
    let ramp = Grid::from_fn(8, 4, |x, _| x as f32);
    let large = resample(&ramp, 16, 8);
    for x in 1..15 {
        let expected = (x as f32 + 0.5) / 2.0 - 0.5;
        assert!((large[(x, 3)] - expected).abs() < 1e-5);
    }
}

proptest! {
    #[test]
    fn resample_mask_agrees_with_resample(
        (from, values) in (1usize..7, 1usize..7).prop_flat_map(|(w, h)| {
            (Just((w, h)), prop::collection::vec(0.0..1.0f32, w * h))
        }),
        width in 0usize..30,
        height in 0usize..30,
    ) {
        let grid = Grid::from_vec(from.0, from.1, values);
        let mask = resample_mask(&grid, width, height, 0.5);
        let scaled = resample(&grid, width, height);
        for (&inside, &value) in mask.as_slice().iter().zip(scaled.as_slice()) {
            prop_assert!(inside == (value >= 0.5) || (value - 0.5).abs() < 1e-6);
        }
    }

    #[test]
    fn shrinking_keeps_one_color(width in 1usize..90, height in 1usize..90, side in 1usize..40) {
        let small = shrink(Photo::filled(width, height, [10, 200, 31]), side);
        prop_assert!(small.width().max(small.height()) <= side.max(1).min(width.max(height)));
        prop_assert!(small.as_slice().iter().all(|&p| p == [10, 200, 31]));
    }

    #[test]
    fn damaged_files_never_panic(at in 0usize..3000, value: u8) {
        let mut bytes = jpeg_with_exif(&gradient(40, 33), &[(0x0112, 3), (0xa405, 28)]);
        let at = at % bytes.len();
        bytes[at] = value;
        let _ = decode_photo(&bytes);
    }
}
