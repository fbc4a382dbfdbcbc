//! Facts about all frames of a video.

use std::ops::ControlFlow;

use pirouette_body::Keypoints;
use pirouette_geom::parallel::prelude::*;
use pirouette_pose::{Detection, PoseModel, Region};

use super::{Frame, FrameSource};
use crate::detect::{detect_in, search_beside, to_keypoints};
use crate::scan::Photo;

/// Options of [`survey`]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurveyOptions {
    /// Longer side of the shrunk frames, in px
    pub max_side_px: usize,
    /// Time between frames in which the person is detected, in s
    pub interval_s: f64,
    /// Where the person is at first, in px of the shrunk frames; if unknown, anyone is searched
    pub region: Option<Region>,
}

impl Default for SurveyOptions {
    fn default() -> Self {
        Self {
            max_side_px: 960,
            interval_s: 0.1,
            region: None,
        }
    }
}

/// What is known about a frame
#[derive(Debug, Clone, PartialEq)]
pub struct FrameFacts {
    /// Number of the frame in the video
    pub index: usize,
    /// Time since the start of the video, in s
    pub time_s: f64,
    /// Mean squared difference of each pixel from the mean of its neighbors, in squared levels, where the person is
    pub sharpness: f64,
    /// Mean gray level
    pub brightness: f64,
    /// Whether the person was searched in this frame
    pub searched: bool,
    /// The person's keypoints, in px of the shrunk frame; `None` if not searched or not found
    pub keypoints: Option<Keypoints>,
}

/// Facts about all frames
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Survey {
    /// The frames, in order of time
    pub frames: Vec<FrameFacts>,
    /// Columns and rows of the shrunk frames
    pub size_px: (usize, usize),
    /// The person whose keypoints are in the frames, and another one, if there is one
    pub two_people: Option<TwoPeople>,
}

/// Where two people are in a frame, in px of the shrunk frame
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoPeople {
    /// The person who is followed
    pub followed: Region,
    /// The other one
    pub other: Region,
}

impl TwoPeople {
    /// Returns whether the other person is to the right of the one who is followed
    pub fn is_other_right(&self) -> bool {
        self.other.center()[0] > self.followed.center()[0]
    }
}

/// Number of frames in which the person is detected at the same time
const BATCH: usize = 16;

/// Size of another person relative to the one who is followed: others are pictures, or far away
const MIN_OTHER_SIZE: f64 = 0.5;

/// Looks at all frames of a video
///
/// Another person is searched a few times, most often at the beginning.
///
/// `on_frame` is called with the time of each frame, in s; the survey ends where it breaks.
///
/// # Errors
/// Those of the decoder.
pub fn survey<S: FrameSource>(
    source: &mut S,
    model: &PoseModel,
    options: &SurveyOptions,
    on_frame: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<Survey, S::Error> {
    let mut surveyor = Surveyor {
        model,
        survey: Survey::default(),
        batch: Vec::new(),
        region: options.region,
        followed_batches: 0,
        next_s: f64::NEG_INFINITY,
        interval_s: options.interval_s,
    };
    source.frames(options.max_side_px, None, &mut |frame| {
        let time_s = frame.time_s;
        surveyor.add(frame);
        on_frame(time_s)
    })?;
    surveyor.detect_batch();
    Ok(surveyor.survey)
}

struct Surveyor<'a> {
    model: &'a PoseModel,
    survey: Survey,
    /// Frames in which the person is not yet searched, with their positions in the survey
    batch: Vec<(usize, Photo)>,
    /// Where the person was found last
    region: Option<Region>,
    /// Number of batches with the person
    followed_batches: u32,
    /// Time from which on the next frame is searched, in s
    next_s: f64,
    interval_s: f64,
}

impl Surveyor<'_> {
    fn add(&mut self, frame: Frame) {
        let Frame {
            index,
            time_s,
            photo,
        } = frame;
        self.survey.size_px = (photo.width(), photo.height());
        let (sharpness, brightness) = picture_facts(
            &photo,
            self.region.map(|region| (region.center(), region.size())),
        );
        let searched = time_s >= self.next_s;
        self.survey.frames.push(FrameFacts {
            index,
            time_s,
            sharpness,
            brightness,
            searched,
            keypoints: None,
        });
        if searched {
            self.next_s = time_s + self.interval_s;
            self.batch.push((self.survey.frames.len() - 1, photo));
        }
        if self.batch.len() == BATCH {
            self.detect_batch();
        }
    }

    fn detect_batch(&mut self) {
        let batch = std::mem::take(&mut self.batch);
        // The camera is static: the region of the batch before, if the person is still there.
        if self.region.is_none() {
            // A search without success takes as long as the detection in all frames of the batch.
            let middle = batch.get(batch.len() / 2);
            let found =
                middle.and_then(|(_, photo)| detect_in(self.model, photo, None, true, false));
            self.region = found.map(|found| found.next_region);
        }
        let Some(region) = self.region else {
            return;
        };
        let found: Vec<Option<Detection>> = batch
            .par_iter()
            .map(|(_, photo)| detect_in(self.model, photo, Some(region), false, false))
            .collect();
        self.region = last_found(&batch, &found).map(|(region, _)| region);
        self.followed_batches += u32::from(self.region.is_some());
        // Rarely, since it takes as long as the detection in some batches: someone may come in later.
        if self.survey.two_people.is_none()
            && [1, 4, 16, 64].contains(&self.followed_batches)
            && let Some((followed, photo)) = last_found(&batch, &found)
        {
            let is_alike = |other: &Region| other.size() > MIN_OTHER_SIZE * followed.size();
            let other = search_beside(self.model, photo, &followed).filter(is_alike);
            self.survey.two_people = other.map(|other| TwoPeople { followed, other });
        }
        for ((position, _), found) in batch.iter().zip(found) {
            let keypoints = found.map(|found| to_keypoints(&found.landmarks));
            self.survey.frames[*position].keypoints = keypoints;
        }
    }
}

/// Returns the last frame in which the person was found, and where
fn last_found<'a>(
    batch: &'a [(usize, Photo)],
    found: &[Option<Detection>],
) -> Option<(Region, &'a Photo)> {
    let mut frames = batch.iter().zip(found).rev();
    frames.find_map(|((_, photo), found)| Some((found.as_ref()?.next_region, photo)))
}

/// Returns sharpness in a square, given by center and side, or in the complete picture; and brightness
///
/// Every second row is used.
fn picture_facts(photo: &Photo, square: Option<([f64; 2], f64)>) -> (f64, f64) {
    let (width, height) = (photo.width(), photo.height());
    let window = |axis: usize, end: usize| {
        let [low, high] = square.map_or([0.0, end as f64], |(center, side)| {
            [-0.5, 0.5].map(|share| center[axis] + share * side)
        });
        (
            low.max(1.0) as usize,
            (high.max(0.0) as usize).min(end.saturating_sub(1)),
        )
    };
    let ((left, right), (top, bottom)) = (window(0, width), window(1, height));
    let gray = |pixel: &[u8; 3]| pixel.iter().map(|&v| i32::from(v)).sum::<i32>();
    let (mut squares, mut count) = (0_u64, 0_u64);
    for y in (top..bottom).step_by(2) {
        let [above, row, below] = [photo.row(y - 1), photo.row(y), photo.row(y + 1)];
        for x in left..right {
            let around = gray(&row[x - 1]) + gray(&row[x + 1]) + gray(&above[x]) + gray(&below[x]);
            let difference = 4 * gray(&row[x]) - around;
            squares += u64::from(difference.unsigned_abs()).pow(2);
            count += 1;
        }
    }
    let sharpness = squares as f64 / (144.0 * count.max(1) as f64);
    let rows = (0..height).step_by(2);
    let pixels = rows.clone().flat_map(|y| photo.row(y));
    let sum: u64 = pixels
        .map(|pixel| u64::from(gray(pixel).unsigned_abs()))
        .sum();
    let brightness = sum as f64 / (3 * rows.len().max(1) * width.max(1)) as f64;
    (sharpness, brightness)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stripes_are_sharp_and_a_gray_picture_is_not() {
        let stripes = Photo::from_fn(40, 30, |x, _| [if x % 2 == 0 { 200 } else { 100 }; 3]);
        let (sharpness, brightness) = picture_facts(&stripes, None);
        // Two of four neighbors differ by 100 levels.
        assert!((sharpness - 2500.0).abs() < 1.0, "{sharpness}");
        assert!((brightness - 150.0).abs() < 1e-9);
        let gray = Photo::filled(40, 30, [90; 3]);
        assert_eq!(picture_facts(&gray, None), (0.0, 90.0));
        assert_eq!(
            picture_facts(&Photo::filled(1, 1, [7; 3]), None),
            (0.0, 7.0)
        );
    }

    #[test]
    fn only_the_region_of_the_person_counts_for_sharpness() {
        let half = Photo::from_fn(200, 100, |x, _| {
            [if x > 100 && x % 2 == 0 { 200 } else { 100 }; 3]
        });
        let of = |x: f64| picture_facts(&half, Some(([x, 50.0], 60.0))).0;
        assert_eq!(of(50.0), 0.0);
        assert!(of(150.0) > 1000.0);
    }
}
