//! Given silhouettes in the forms that segmentation programs write.
//!
//! Expected is white on black in the size of the photo. Other forms are read if they have one meaning, judged by the
//! border of the image and the joints of the person: inverted masks, levels 0 and 1, one color or level per person,
//! cut-outs (transparent, or on exactly black or white), and other sizes of the same shape. All else is an error.

use std::collections::BTreeMap;

use image::DynamicImage;
use pirouette_body::Keypoints;
use pirouette_geom::Mask;
use pirouette_geom::morphology::{components, fill_holes_below};
use thiserror::Error;

use super::photo::{PhotoError, decode_image, resample_mask};

/// Keypoints below this confidence do not decide about a mask
const MIN_CONFIDENCE: f64 = 0.3;

/// Fewer keypoints do not decide about a mask
const MIN_KEYPOINTS: usize = 5;

/// Maximum relative difference of width over height between mask and photo; scaling rounds to integer pixels
const SHAPE_TOLERANCE: f64 = 0.01;

/// Distance from the mask up to which a keypoint counts as inside, as a share of the height; joints of hands and feet
/// lie near the outline
const KEYPOINT_SLACK: f64 = 0.01;

/// Maximum number of colors of an image of labels
const MAX_LABELS: usize = 32;

/// Minimum share of the pixels that have one of these colors; the others are smoothed borders
const MIN_LABEL_SHARE: f64 = 0.99;

/// Minimum share of the border of a cut-out that has exactly its background color
const MIN_PLAIN_BORDER: f64 = 0.99;

/// Holes of a cut-out below this share of the pixels are pixels of the person that have the background color
///
/// Small gaps between arm and trunk, and between the thighs, must stay: photos of 800 x 1000 px have some of 20 px.
const MAX_HOLE_SHARE: f64 = 0.000_01;

/// Maximum number of people in a mask; more parts of similar size are noise
const MAX_PEOPLE: usize = 8;

/// Pixels whose channels differ by more than this are colored; compression colors gray pixels slightly
const MIN_CHROMA: u8 = 40;

/// A given silhouette and how it was read
#[derive(Debug, Clone, PartialEq)]
pub struct GivenMask {
    /// The person, in the size of the photo
    pub mask: Mask,
    /// Differences of the file from the expected form
    pub fixes: Vec<MaskFix>,
}

/// A difference of a mask file from the expected form, white on black in the size of the photo
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum MaskFix {
    #[error("the person is black: inverted it")]
    Inverted,
    #[error("the person is a cut-out: used its transparency")]
    Alpha,
    #[error("the person is a cut-out on a plain background: used all other pixels")]
    CutOut,
    #[error("the highest level is {highest} instead of 255: used pixels above its half")]
    LowLevels { highest: u8 },
    #[error("{label_count} labels: used the one at the joints of the person")]
    Label { label_count: usize },
    #[error("several people: used the one at the joints of the person")]
    OtherPeople,
    #[error("{width} x {height} px: scaled it to the photo")]
    Scaled { width: usize, height: usize },
}

/// Why a mask cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum MaskError {
    #[error(transparent)]
    Photo(#[from] PhotoError),
    #[error("{width} x {height} px")]
    Size { width: usize, height: usize },
    #[error("no foreground pixels")]
    Empty,
    #[error(
        "neither a silhouette of two levels, nor a cut-out with transparency or on exactly black or white; save the person white on black"
    )]
    Unclear,
    #[error(
        "{label_count} labels, of which none is at most joints of the person; save the person white on black"
    )]
    NoLabel { label_count: usize },
    #[error(
        "only {inside} of {found} joints are in the silhouette; it may belong to another photo"
    )]
    Elsewhere { inside: usize, found: usize },
}

/// Decodes a mask for a photo of the given size; `keypoints` are in px of the photo
///
/// # Errors
/// When the bytes are not an image, its shape is not that of the photo, its meaning is not certain, or most joints are
/// outside.
pub fn read_mask(
    bytes: &[u8],
    (photo_width, photo_height): (usize, usize),
    keypoints: &Keypoints,
) -> Result<GivenMask, MaskError> {
    let pixels = Pixels::new(decode_image(bytes)?);
    let (width, height) = (pixels.width, pixels.height);
    let scale = (
        width as f64 / photo_width as f64,
        height as f64 / photo_height as f64,
    );
    if (scale.0 / scale.1 - 1.0).abs() > SHAPE_TOLERANCE {
        return Err(MaskError::Size { width, height });
    }
    let joints: Vec<(f64, f64)> = keypoints
        .iter()
        .filter(|(_, keypoint)| keypoint.confidence >= MIN_CONFIDENCE)
        .map(|(_, keypoint)| (keypoint.position.x * scale.0, keypoint.position.y * scale.1))
        .collect();
    let mut fixes = Vec::new();
    let mut mask = pixels.person(&joints, &mut fixes)?;
    let area = mask.area();
    if area == 0 {
        return Err(MaskError::Empty);
    }
    if is_inverted(&mask, &joints) {
        mask = mask.map(|inside| !inside);
        fixes.push(MaskFix::Inverted);
    }
    if let Some(one) = one_of_several(&mask, &joints) {
        mask = one;
        fixes.push(MaskFix::OtherPeople);
    }
    let slack = (KEYPOINT_SLACK * height as f64).ceil().max(2.0) as isize;
    let inside = joints.iter().filter(|joint| is_near(&mask, joint, slack));
    let (inside, found) = (inside.count(), joints.len());
    if found >= MIN_KEYPOINTS && 2 * inside < found {
        return Err(MaskError::Elsewhere { inside, found });
    }
    if (width, height) != (photo_width, photo_height) {
        let soft = mask.map(|&inside| if inside { 1.0 } else { 0.0 });
        mask = resample_mask(&soft, photo_width, photo_height, 0.5);
        fixes.push(MaskFix::Scaled { width, height });
    }
    Ok(GivenMask { mask, fixes })
}

/// Returns the pixel at a joint, `None` outside the image
fn pixel_at((x, y): &(f64, f64), width: usize, height: usize) -> Option<(usize, usize)> {
    let inside = *x >= 0.0 && *y >= 0.0 && *x < width as f64 && *y < height as f64;
    inside.then_some((*x as usize, *y as usize))
}

fn is_inside(mask: &Mask, joint: &(f64, f64)) -> bool {
    pixel_at(joint, mask.width(), mask.height()).is_some_and(|at| mask[at])
}

/// Returns whether a mask has a pixel in the square around a joint
fn is_near(mask: &Mask, &(x, y): &(f64, f64), slack: isize) -> bool {
    let (x, y) = (x.floor() as isize, y.floor() as isize);
    let column = |y: isize| {
        let hit = |x: isize| mask.get(x, y) == Some(&true);
        (x.saturating_sub(slack)..=x.saturating_add(slack)).any(hit)
    };
    (y.saturating_sub(slack)..=y.saturating_add(slack)).any(column)
}

/// Returns the indices of the pixels at the border of an image
fn border(width: usize, height: usize) -> impl Iterator<Item = usize> {
    let last = width * height.saturating_sub(1);
    let rows = (0..width).chain((last..last + width).filter(move |_| height > 1));
    let columns =
        (1..height.saturating_sub(1)).flat_map(move |y| [y * width, y * width + width - 1]);
    rows.chain(columns)
}

/// Returns whether the background is the foreground: most of the border is in the mask, and the joints are not
///
/// Without joints, the complete border must be in the mask, and a part with the size of a person must not.
fn is_inverted(mask: &Mask, joints: &[(f64, f64)]) -> bool {
    let pixels = mask.as_slice();
    let (mut set, mut count) = (0, 0);
    for index in border(mask.width(), mask.height()) {
        set += usize::from(pixels.get(index) == Some(&true));
        count += 1;
    }
    let outside = joints
        .iter()
        .filter(|joint| !is_inside(mask, joint))
        .count();
    if joints.len() >= MIN_KEYPOINTS {
        2 * set > count && 2 * outside > joints.len()
    } else {
        let rest = (pixels.len() - mask.area()) as f64 / pixels.len() as f64;
        10 * set >= 9 * count && (0.02..0.5).contains(&rest)
    }
}

/// Returns the part of a mask with the joints, if a part of similar size has none
fn one_of_several(mask: &Mask, joints: &[(f64, f64)]) -> Option<Mask> {
    if joints.len() < MIN_KEYPOINTS {
        return None;
    }
    let parts = components(mask);
    let largest = parts.areas.get(parts.largest()?)?;
    let similar = parts.areas.iter().enumerate();
    let similar = similar.filter(|(_, area)| 5 * *area >= *largest);
    let similar: Vec<usize> = similar.map(|(part, _)| part).take(MAX_PEOPLE + 1).collect();
    if !(2..=MAX_PEOPLE).contains(&similar.len()) {
        return None;
    }
    let mut with_joints = similar.into_iter().filter_map(|part| {
        let one = parts.mask(part);
        let count = joints.iter().filter(|joint| is_inside(&one, joint)).count();
        (count > 0).then_some((one, count))
    });
    match (with_joints.next(), with_joints.next()) {
        (Some((one, count)), None) if 10 * count >= 6 * joints.len() => Some(one),
        _ => None,
    }
}

/// A decoded mask file
struct Pixels {
    width: usize,
    height: usize,
    rgba: Vec<[u8; 4]>,
}

impl Pixels {
    fn new(image: DynamicImage) -> Self {
        // Labels of 16 bits are small numbers, which conversion to 8 bits would remove.
        let small = match &image {
            DynamicImage::ImageLuma16(gray) => gray.iter().all(|&level| level <= 255),
            _ => false,
        };
        let (width, height) = (image.width() as usize, image.height() as usize);
        let rgba = match image {
            DynamicImage::ImageLuma16(gray) if small => {
                let levels = gray.iter().map(|&level| level as u8);
                levels.map(|level| [level, level, level, 255]).collect()
            }
            image => image.into_rgba8().into_raw().as_chunks().0.to_vec(),
        };
        Self {
            width,
            height,
            rgba,
        }
    }

    fn mask(&self, inside: impl Fn(&[u8; 4]) -> bool) -> Mask {
        let inside = self.rgba.iter().map(inside).collect();
        Mask::from_vec(self.width, self.height, inside)
    }

    /// Returns the pixels of the person
    fn person(&self, joints: &[(f64, f64)], fixes: &mut Vec<MaskFix>) -> Result<Mask, MaskError> {
        if self.rgba.iter().any(|pixel| pixel[3] < 128) {
            fixes.push(MaskFix::Alpha);
            return Ok(self.mask(|pixel| pixel[3] >= 128));
        }
        if let Some(levels) = self.two_levels() {
            let [lowest, highest] = levels;
            if lowest == highest {
                return Ok(self.mask(|_| highest >= 128));
            }
            if highest < 128 {
                fixes.push(MaskFix::LowLevels { highest });
            }
            let half = (u16::from(lowest) + u16::from(highest)).div_ceil(2);
            return Ok(self.mask(|pixel| u16::from(luma(pixel)) >= half));
        }
        if let Some(labels) = self.labels() {
            let label_count = labels.len();
            let label = match labels[..] {
                [first, second] => {
                    let background = self.most_frequent(border(self.width, self.height));
                    background.map(|(color, _)| if color == first { second } else { first })
                }
                _ => self.label_at(joints).filter(|label| labels.contains(label)),
            };
            let label = label.ok_or(MaskError::NoLabel { label_count })?;
            fixes.push(MaskFix::Label { label_count });
            return Ok(self.mask(|pixel| *pixel == label));
        }
        let background = self.plain_background().ok_or(MaskError::Unclear)?;
        fixes.push(MaskFix::CutOut);
        let mask = self.mask(|pixel| *pixel != background);
        let hole = (MAX_HOLE_SHARE * self.rgba.len() as f64) as usize;
        Ok(fill_holes_below(&mask, hole))
    }

    /// Returns the lowest and the highest gray level if nearly all pixels have one of them
    fn two_levels(&self) -> Option<[u8; 2]> {
        let chroma = |p: &[u8; 4]| p[0].max(p[1]).max(p[2]) - p[0].min(p[1]).min(p[2]);
        let colored = self.rgba.iter().filter(|p| chroma(p) > MIN_CHROMA).count();
        if 1000 * colored > self.rgba.len() {
            return None;
        }
        let levels = || self.rgba.iter().map(luma);
        let (lowest, highest) = (levels().min()?, levels().max()?);
        let range = f64::from(highest - lowest);
        let (mut low, mut middle, mut high) = (0_usize, 0_usize, 0_usize);
        for level in levels() {
            match f64::from(level - lowest) {
                above if above <= 0.15 * range => low += 1,
                above if above >= 0.85 * range => high += 1,
                _ => middle += 1,
            }
        }
        let smooth = range <= 0.0 || 4 * middle <= low.min(high);
        smooth.then_some([lowest, highest])
    }

    /// Returns the colors that nearly all pixels have, if these are few
    fn labels(&self) -> Option<Vec<[u8; 4]>> {
        let mut counts: BTreeMap<[u8; 4], usize> = BTreeMap::new();
        for pixel in &self.rgba {
            *counts.entry(*pixel).or_default() += 1;
        }
        // Labels have areas; a smoothed border has many colors of few pixels.
        let smallest = (self.rgba.len() / 5000).max(1);
        let labels = counts.into_iter().filter(|(_, count)| *count >= smallest);
        let labels: Vec<_> = labels.collect();
        let covered: usize = labels.iter().map(|(_, count)| count).sum();
        let few = labels.len() <= MAX_LABELS
            && covered as f64 >= MIN_LABEL_SHARE * self.rgba.len() as f64;
        few.then(|| labels.into_iter().map(|(label, _)| label).collect())
    }

    /// Returns the label at most joints, unless it is that of the background
    fn label_at(&self, joints: &[(f64, f64)]) -> Option<[u8; 4]> {
        let background = self.most_frequent(border(self.width, self.height))?.0;
        let at = |joint| {
            let (x, y) = pixel_at(joint, self.width, self.height)?;
            Some(y * self.width + x)
        };
        let (label, count) = self.most_frequent(joints.iter().filter_map(at))?;
        let most = joints.len() >= MIN_KEYPOINTS && 10 * count >= 6 * joints.len();
        (most && label != background).then_some(label)
    }

    /// Returns the most frequent color of some pixels, and how many of them have it
    fn most_frequent(&self, indices: impl Iterator<Item = usize>) -> Option<([u8; 4], usize)> {
        let mut counts: BTreeMap<[u8; 4], usize> = BTreeMap::new();
        for index in indices {
            *counts.entry(*self.rgba.get(index)?).or_default() += 1;
        }
        counts.into_iter().max_by_key(|(_, count)| *count)
    }

    /// Returns the color of the border if nearly all of it is exactly black or white
    fn plain_background(&self) -> Option<[u8; 4]> {
        let count = border(self.width, self.height).count() as f64;
        let (color, same) = self.most_frequent(border(self.width, self.height))?;
        let plain = matches!(color, [0, 0, 0, 255] | [255, 255, 255, 255]);
        (plain && same as f64 >= MIN_PLAIN_BORDER * count).then_some(color)
    }
}

fn luma(&[r, g, b, _]: &[u8; 4]) -> u8 {
    let sum = 299 * u32::from(r) + 587 * u32::from(g) + 114 * u32::from(b);
    ((sum + 500) / 1000) as u8
}

#[cfg(test)]
mod tests;
