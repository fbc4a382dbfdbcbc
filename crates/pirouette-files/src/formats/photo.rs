//! Photos and masks: reads JPEG, PNG and WebP; writes PNG and JPEG.
//!
//! The EXIF orientation is applied on reading, so that photos are upright in all other code. A truncated or oversized
//! file is an error; it is never decoded in part.

use std::io::Cursor;

use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use pirouette_geom::{Grid, Mask};
use thiserror::Error;

use pirouette::scan::{Background, Photo};

/// Photos with more pixels than this are rejected before decoding
///
/// Phones deliver 12 to 108 megapixels; a small file can claim any size.
pub const MAX_PHOTO_PIXELS: u64 = 110_000_000;

/// Limit of the memory for decoding one photo, in bytes: 4 bytes per pixel and working memory
const MAX_DECODE_BYTES: u64 = 6 * MAX_PHOTO_PIXELS;

/// Photos with a shorter side below this, in px, are rejected
pub const MIN_PHOTO_SIDE_PX: usize = 32;

/// Minimum range of gray levels, without the outer percent at both ends
///
/// A photo of a lens cap, or an overexposed one, contains only noise of a few levels.
const MIN_GRAY_RANGE: u8 = 8;

/// Diagonal of the 24 x 36 mm film frame that EXIF's equivalent focal length refers to (CIPA DCG-001)
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;

/// Plausible vertical fields of view of a photo of a person, in degrees; values outside mean wrong EXIF data
const PLAUSIBLE_FOV_DEGREES: std::ops::RangeInclusive<f64> = 5.0..=120.0;

/// A photo and the camera parameters in its file
#[derive(Debug, Clone)]
pub struct DecodedPhoto {
    /// The pixels, upright
    pub photo: Photo,
    /// Vertical field of view of the upright photo, from EXIF; `None` for cropped photos
    pub vertical_fov_radians: Option<f64>,
    /// Longer and shorter side of the photo as taken, by EXIF, if that differs in shape: the photo was cropped
    pub cropped_from_px: Option<(usize, usize)>,
}

/// Why a photo or mask cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum PhotoError {
    #[error("the file is empty; copy it again")]
    Empty,
    #[error("neither a JPEG, PNG nor WebP file; convert it to one of these")]
    UnknownFormat,
    #[error("HEIC files are not supported; export the photo as JPEG")]
    Heic,
    #[error("the JPEG file is truncated; copy it again")]
    Truncated,
    #[error("the file is damaged: {0}")]
    Damaged(ImageError),
    #[error("{width_px} x {height_px} px exceed the limit of {} megapixels", MAX_PHOTO_PIXELS / 1_000_000)]
    TooLarge { width_px: u32, height_px: u32 },
    #[error(
        "{width_px} x {height_px} px is too small; both sides need at least {MIN_PHOTO_SIDE_PX} px"
    )]
    TooSmall { width_px: usize, height_px: usize },
    #[error("the photo has no contrast (gray levels {darkest} to {brightest}); retake it")]
    Blank { darkest: u8, brightest: u8 },
}

/// Decodes a photo and applies its orientation
///
/// # Errors
/// When the bytes are not a complete JPEG, PNG or WebP file of an accepted size.
pub fn decode_photo(bytes: &[u8]) -> Result<DecodedPhoto, PhotoError> {
    let mut decoder = open(bytes)?;
    let exif = exif(&mut decoder);
    let photo = if decoder.color_type() == ColorType::Rgb8
        && orientation(&mut decoder) == Orientation::NoTransforms
    {
        // Decoded in place: photos use most of the memory of a scan.
        let (width_px, height_px) = decoder.dimensions();
        let mut photo = Photo::filled(width_px as usize, height_px as usize, [0; 3]);
        let pixels = photo.as_mut_slice().as_flattened_mut();
        decoder.read_image(pixels).map_err(PhotoError::Damaged)?;
        photo
    } else {
        let rgb = decode(decoder)?.into_rgb8();
        let (width, height) = (rgb.width() as usize, rgb.height() as usize);
        Photo::from_vec(width, height, rgb.into_raw().as_chunks().0.to_vec())
    };
    let (width, height) = (photo.width(), photo.height());
    if width.min(height) < MIN_PHOTO_SIDE_PX {
        return Err(PhotoError::TooSmall {
            width_px: width,
            height_px: height,
        });
    }
    let exif = exif.and_then(|exif| exif::Reader::new().read_raw(exif).ok());
    let cropped_from_px = exif
        .as_ref()
        .and_then(|exif| cropped_from(exif, width, height));
    let vertical_fov_radians = exif.filter(|_| cropped_from_px.is_none()).and_then(|exif| {
        let focal_mm = focal_length_in_35mm_film(&exif)?;
        vertical_fov(focal_mm, width, height)
    });
    Ok(DecodedPhoto {
        photo,
        vertical_fov_radians,
        cropped_from_px,
    })
}

/// Decodes a picture of the room without the person, and the mask of where it is opaque: elsewhere, the room is unknown
///
/// # Errors
/// As of [`decode_photo`].
pub fn decode_background(bytes: &[u8]) -> Result<(Photo, Mask), PhotoError> {
    let decoder = open(bytes)?;
    if !decoder.color_type().has_alpha() {
        let photo = decode_photo(bytes)?.photo;
        let known = Mask::filled(photo.width(), photo.height(), true);
        return Ok((photo, known));
    }
    let rgba = decode(decoder)?.into_rgba8();
    let (width, height) = (rgba.width() as usize, rgba.height() as usize);
    let pixels = rgba.into_raw();
    let pixels = pixels.as_chunks::<4>().0;
    let colors = pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    let known = pixels.iter().map(|&[.., alpha]| alpha == u8::MAX).collect();
    Ok((
        Photo::from_vec(width, height, colors),
        Mask::from_vec(width, height, known),
    ))
}

/// Encodes a picture of the room; where it is unknown, the picture is transparent
///
/// # Errors
/// When the picture has no pixels.
pub fn encode_background(background: &Background) -> Result<Vec<u8>, ImageError> {
    let photo = &background.photo;
    let pixels = photo.as_slice().iter().zip(background.known.as_slice());
    let rgba: Vec<u8> = pixels
        .flat_map(|(&[r, g, b], &known)| [r, g, b, if known { u8::MAX } else { 0 }])
        .collect();
    encode_png(
        &rgba,
        photo.width(),
        photo.height(),
        image::ColorType::Rgba8,
    )
}

/// Decodes a mask; pixels of at least half the brightness are foreground
///
/// # Errors
/// When the bytes are not a complete JPEG, PNG or WebP file of an accepted size.
pub fn decode_mask(bytes: &[u8]) -> Result<Mask, PhotoError> {
    let gray = decode(open(bytes)?)?.into_luma8();
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    let inside = gray.into_raw().into_iter().map(|v| v >= 128).collect();
    Ok(Mask::from_vec(width, height, inside))
}

/// Decodes an image of any kind and applies its orientation
///
/// # Errors
/// When the bytes are not a complete JPEG, PNG or WebP file of an accepted size.
pub(super) fn decode_image(bytes: &[u8]) -> Result<DynamicImage, PhotoError> {
    decode(open(bytes)?)
}

/// Checks that a photo has contrast
///
/// # Errors
/// When nearly all pixels have the same brightness, as with a lens cap or a failed export.
pub fn check_contrast(photo: &Photo) -> Result<(), PhotoError> {
    let mut histogram = [0usize; 256];
    for &[r, g, b] in photo.as_slice() {
        let gray = (299 * u32::from(r) + 587 * u32::from(g) + 114 * u32::from(b)) / 1000;
        histogram[gray as usize] += 1;
    }
    let outer = photo.as_slice().len() / 100;
    let darkest = first_level_beyond(&histogram, 0..=255, outer);
    let brightest = first_level_beyond(&histogram, (0..=255).rev(), outer);
    if brightest.saturating_sub(darkest) < MIN_GRAY_RANGE {
        return Err(PhotoError::Blank { darkest, brightest });
    }
    Ok(())
}

/// Returns the first level at which the cumulative number of pixels exceeds `outer`
fn first_level_beyond(
    histogram: &[usize; 256],
    mut levels: impl Iterator<Item = u8>,
    outer: usize,
) -> u8 {
    let mut sum = 0;
    let beyond = levels.find(|&level| {
        sum += histogram[usize::from(level)];
        sum > outer
    });
    beyond.unwrap_or_default()
}

/// Reads the header up to the pixels
fn open(bytes: &[u8]) -> Result<impl ImageDecoder + use<'_>, PhotoError> {
    if bytes.is_empty() {
        return Err(PhotoError::Empty);
    }
    let mut reader = ImageReader::new(Cursor::new(bytes));
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::WebP)) => format,
        // ISO media files name their brand after `ftyp`.
        _ if bytes.get(4..8) == Some(b"ftyp") => return Err(PhotoError::Heic),
        _ => return Err(PhotoError::UnknownFormat),
    };
    if format == ImageFormat::Jpeg && !jpeg_is_complete(bytes) {
        return Err(PhotoError::Truncated);
    }
    reader.set_format(format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(PhotoError::Damaged)?;
    let (width_px, height_px) = decoder.dimensions();
    if u64::from(width_px) * u64::from(height_px) > MAX_PHOTO_PIXELS {
        return Err(PhotoError::TooLarge {
            width_px,
            height_px,
        });
    }
    Ok(decoder)
}

// Damaged EXIF data is ignored.
fn exif(decoder: &mut impl ImageDecoder) -> Option<Vec<u8>> {
    decoder.exif_metadata().ok().flatten()
}

fn orientation(decoder: &mut impl ImageDecoder) -> Orientation {
    decoder.orientation().unwrap_or(Orientation::NoTransforms)
}

/// Decodes an image and applies its orientation
fn decode(mut decoder: impl ImageDecoder) -> Result<DynamicImage, PhotoError> {
    let orientation = orientation(&mut decoder);
    let mut image = DynamicImage::from_decoder(decoder).map_err(PhotoError::Damaged)?;
    image.apply_orientation(orientation);
    Ok(image)
}

/// Returns whether a JPEG file contains its end-of-image marker
///
/// Decoders fill missing data with gray. Thumbnails inside segments have their own end marker, so the segments are
/// parsed; data after the end, which some phones append, is allowed.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let mut at = 2;
    loop {
        // In entropy-coded data FF is followed by 00 or a restart marker; fill bytes are FF too.
        let Some(skipped) = bytes.get(at..).and_then(|rest| {
            rest.windows(2)
                .position(|pair| pair[0] == 0xff && !matches!(pair[1], 0 | 0xd0..=0xd7 | 0xff))
        }) else {
            return false;
        };
        at += skipped + 2;
        match bytes[at - 1] {
            0xd9 => return true,
            0x01 | 0xd8 => {}
            _ => {
                let Some(length) = bytes.get(at..at + 2) else {
                    return false;
                };
                at += usize::from(u16::from_be_bytes([length[0], length[1]]));
            }
        }
    }
}

/// Relative difference in shape of a photo and its EXIF data above which it was cropped; scaling rounds to pixels
const SHAPE_TOLERANCE: f64 = 0.02;

/// Returns the longer and the shorter side by EXIF if they differ in shape from the photo
fn cropped_from(exif: &exif::Exif, width_px: usize, height_px: usize) -> Option<(usize, usize)> {
    let side = |tag| {
        let field = exif.get_field(tag, exif::In::PRIMARY)?;
        field.value.get_uint(0).filter(|&side| side > 0)
    };
    let sides = (
        side(exif::Tag::PixelXDimension)? as usize,
        side(exif::Tag::PixelYDimension)? as usize,
    );
    // Programs that rotate photos leave the sides as they were.
    let ordered = |(a, b): (usize, usize)| (a.max(b), a.min(b));
    let shape = |(long, short): (usize, usize)| long as f64 / short as f64;
    let (taken, given) = (ordered(sides), ordered((width_px, height_px)));
    ((shape(taken) / shape(given) - 1.0).abs() > SHAPE_TOLERANCE).then_some(taken)
}

fn focal_length_in_35mm_film(exif: &exif::Exif) -> Option<f64> {
    let field = exif.get_field(exif::Tag::FocalLengthIn35mmFilm, exif::In::PRIMARY)?;
    let focal_mm = field.value.get_uint(0)?;
    // 0 means "unknown" in the standard.
    (focal_mm > 0).then_some(f64::from(focal_mm))
}

/// Computes the vertical field of view of a photo from the equivalent focal length, by equal diagonals
fn vertical_fov(focal_mm: f64, width_px: usize, height_px: usize) -> Option<f64> {
    let diagonal_px = (width_px as f64).hypot(height_px as f64);
    let focal_px = focal_mm / FILM_DIAGONAL_MM * diagonal_px;
    let fov = 2.0 * (height_px as f64 / 2.0 / focal_px).atan();
    PLAUSIBLE_FOV_DEGREES
        .contains(&fov.to_degrees())
        .then_some(fov)
}

/// Shrinks a photo so that its longer side has at most `max_side_px`; each pixel becomes the mean of the area that it
/// covers
///
/// A smaller photo is returned unchanged.
pub fn shrink(photo: Photo, max_side_px: usize) -> Photo {
    let (width, height) = (photo.width(), photo.height());
    let longer = width.max(height);
    if longer <= max_side_px {
        return photo;
    }
    let shrunk = |side: usize| (side * max_side_px).div_ceil(longer).max(1);
    let (new_width, new_height) = (shrunk(width), shrunk(height));
    let columns = area_weights(width, new_width);
    let rows = area_weights(height, new_height);
    let mut data = Vec::with_capacity(new_width * new_height);
    let mut line = vec![[0f32; 3]; width];
    for (first_row, row_weights) in &rows {
        line.fill([0.0; 3]);
        for (y, &weight) in (*first_row..).zip(row_weights) {
            for (sum, pixel) in line.iter_mut().zip(photo.row(y)) {
                for (s, &channel) in sum.iter_mut().zip(pixel) {
                    *s += weight * f32::from(channel);
                }
            }
        }
        for (first, weights) in &columns {
            let mut sum = [0f32; 3];
            for (pixel, &weight) in line[*first..].iter().zip(weights) {
                for (s, &channel) in sum.iter_mut().zip(pixel) {
                    *s += weight * channel;
                }
            }
            data.push(sum.map(|v| v.round() as u8));
        }
    }
    Photo::from_vec(new_width, new_height, data)
}

/// For each of `to` equal parts of a line of `from` pixels: the first pixel it covers and the shares of it and the
/// following pixels
fn area_weights(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let step = from as f64 / to as f64;
    let part = |i: usize| {
        let (start, end) = (i as f64 * step, ((i + 1) as f64 * step).min(from as f64));
        let first = start as usize;
        let last = (end.ceil() as usize).clamp(first + 1, from);
        let weights = (first..last)
            .map(|x| {
                let covered = end.min(x as f64 + 1.0) - start.max(x as f64);
                (covered.max(0.0) / (end - start)) as f32
            })
            .collect();
        (first, weights)
    };
    (0..to).map(part).collect()
}

/// Scales a raster by bilinear interpolation between pixel centers
pub fn resample(grid: &Grid<f32>, width: usize, height: usize) -> Grid<f32> {
    if grid.width() == width && grid.height() == height {
        return grid.clone();
    }
    if grid.width() == 0 || grid.height() == 0 {
        return Grid::filled(width, height, 0.0);
    }
    let columns = bilinear_weights(grid.width(), width);
    let rows = bilinear_weights(grid.height(), height);
    Grid::from_fn(width, height, |x, y| {
        let ((x0, x1, u), (y0, y1, v)) = (columns[x], rows[y]);
        let top = grid[(x0, y0)] * (1.0 - u) + grid[(x1, y0)] * u;
        let bottom = grid[(x0, y1)] * (1.0 - u) + grid[(x1, y1)] * u;
        top * (1.0 - v) + bottom * v
    })
}

/// Thresholds a raster scaled as by [`resample`] at `level`
///
/// Runs of pixels between two raster columns on the same side of the level are filled without interpolation.
pub fn resample_mask(grid: &Grid<f32>, width: usize, height: usize, level: f32) -> Mask {
    let mut mask = Mask::filled(width, height, false);
    if grid.width() == 0 || grid.height() == 0 {
        return mask;
    }
    let columns = bilinear_weights(grid.width(), width);
    let rows = bilinear_weights(grid.height(), height);
    let mut mixed = vec![0.0; grid.width()];
    for (y, &(y0, y1, v)) in rows.iter().enumerate() {
        let (top, bottom) = (grid.row(y0), grid.row(y1));
        for (mixed, (top, bottom)) in mixed.iter_mut().zip(top.iter().zip(bottom)) {
            *mixed = top * (1.0 - v) + bottom * v;
        }
        let mut row = mask.row_mut(y);
        for between in columns.chunk_by(|a, b| a.0 == b.0) {
            let (left, right) = (mixed[between[0].0], mixed[between[0].1]);
            let (part, rest) = row.split_at_mut(between.len());
            if left >= level && right >= level {
                part.fill(true);
            } else if left >= level || right >= level {
                for (inside, &(_, _, u)) in part.iter_mut().zip(between) {
                    *inside = left * (1.0 - u) + right * u >= level;
                }
            }
            row = rest;
        }
    }
    mask
}

/// For each of `to` pixel centers: the two nearest pixels of a line of `from`, and the weight of the second
fn bilinear_weights(from: usize, to: usize) -> Vec<(usize, usize, f32)> {
    let last = from - 1;
    let weight = |i: usize| {
        let at = ((i as f64 + 0.5) * from as f64 / to as f64 - 0.5).clamp(0.0, last as f64);
        let first = at as usize;
        (first, (first + 1).min(last), (at - first as f64) as f32)
    };
    (0..to).map(weight).collect()
}

/// Encodes a mask as a PNG file of gray levels 0 and 255
///
/// # Errors
/// When the mask has no pixels.
pub fn encode_mask(mask: &Mask) -> Result<Vec<u8>, ImageError> {
    let gray = mask.as_slice().iter().map(|&v| if v { 255 } else { 0 });
    let gray: Vec<u8> = gray.collect();
    encode_png(&gray, mask.width(), mask.height(), image::ColorType::L8)
}

/// Encodes a photo as a PNG file
///
/// # Errors
/// When the photo has no pixels.
pub fn encode_photo_png(photo: &Photo) -> Result<Vec<u8>, ImageError> {
    encode_png(
        photo.as_slice().as_flattened(),
        photo.width(),
        photo.height(),
        image::ColorType::Rgb8,
    )
}

fn encode_png(
    pixels: &[u8],
    width: usize,
    height: usize,
    color: image::ColorType,
) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    let (width, height) = (width as u32, height as u32);
    image::write_buffer_with_format(&mut bytes, pixels, width, height, color, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// Encodes a photo as a JPEG file; `quality` ranges from 1 to 100
///
/// # Errors
/// When a side has 0 or more than 65535 pixels.
pub fn encode_jpeg(photo: &Photo, quality: u8) -> Result<Vec<u8>, jpeg_encoder::EncodingError> {
    let side = |length: usize| u16::try_from(length).unwrap_or(0);
    let mut bytes = Vec::new();
    jpeg_encoder::Encoder::new(&mut bytes, quality).encode(
        photo.as_slice().as_flattened(),
        side(photo.width()),
        side(photo.height()),
        jpeg_encoder::ColorType::Rgb,
    )?;
    Ok(bytes)
}

#[cfg(test)]
mod tests;
