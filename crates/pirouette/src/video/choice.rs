//! The choice of frames that become views.

use std::f64::consts::TAU;

use thiserror::Error;

use super::turn_track::angle_between;
use super::{FrameFacts, Survey, TurnTrack};

/// Options of [`choose_frames`]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChoiceOptions {
    /// Number of views of one turn, at least three
    pub views: usize,
}

impl Default for ChoiceOptions {
    fn default() -> Self {
        Self { views: 16 }
    }
}

/// A frame that becomes a view
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChosenFrame {
    /// Number of the frame in the video
    pub index: usize,
    /// Time since the start of the video, in s
    pub time_s: f64,
    /// Turn angle; 0 faces the camera
    pub angle_radians: f64,
}

/// The chosen frames
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// In order of time
    pub frames: Vec<ChosenFrame>,
    /// Angle that the person turns by in the video, in radians
    pub turned_radians: f64,
    /// Number of views for which no frame is usable
    pub missing: usize,
}

/// Why no frames are chosen
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum ChoiceError {
    /// The person hardly turns
    #[error(
        "the person turns by only {degrees:.0} degrees in the video; at least {} are needed, and a complete turn for all \
         measures; film one person alone",
        MIN_TURN.to_degrees()
    )]
    TooLittle {
        /// Angle between the extreme directions
        degrees: f64,
    },
}

/// Angle that a person must turn by
pub(super) const MIN_TURN: f64 = 150.0 * TAU / 360.0;

/// Angle that is a complete turn, with the accuracy of the track, in degrees
pub const COMPLETE_TURN_DEGREES: f64 = 340.0;

/// Distance of a frame from the intended angle, relative to the distance of views
const MAX_OFFSET: f64 = 0.25;

/// Sharpness relative to the sharpest frame nearby that suffices
const SHARP: f64 = 0.85;

/// Relative difference from the usual brightness that is another exposure
const OTHER_EXPOSURE: f64 = 0.04;

/// Selects sharp frames, spread evenly over the turn
///
/// The angles are multiples of one step from the front on. Of the frames within a quarter of the step, those of another
/// exposure are avoided; of the sharp ones, the nearest is chosen, in any turn. If the person turns by less than a
/// complete turn, the step is the same, and there are fewer views.
///
/// # Errors
/// When the person turns by less than 150 degrees.
pub fn choose_frames(
    survey: &Survey,
    track: &TurnTrack,
    options: &ChoiceOptions,
) -> Result<Choice, ChoiceError> {
    let (low, high) = track.range();
    let turned_radians = high - low;
    if turned_radians.is_nan() || turned_radians < MIN_TURN {
        let degrees = turned_radians.to_degrees();
        return Err(ChoiceError::TooLittle { degrees });
    }
    let step = TAU / options.views.max(3) as f64;
    let targets: Vec<f64> = if turned_radians.to_degrees() >= COMPLETE_TURN_DEGREES {
        (0..options.views.max(3)).map(|k| k as f64 * step).collect()
    } else {
        let first = (low / step).ceil() as i64;
        let last = (high / step).floor() as i64;
        (first..=last).map(|k| k as f64 * step).collect()
    };
    let usual = usual_brightness(survey);
    let placed: Vec<(&FrameFacts, f64)> = survey
        .frames
        .iter()
        .filter_map(|frame| Some((frame, track.angle_at(frame.time_s)?)))
        .collect();
    let mut frames: Vec<ChosenFrame> = targets
        .iter()
        .filter_map(|&target| nearest_sharp(&placed, target, MAX_OFFSET * step, usual))
        .collect();
    let missing = targets.len() - frames.len();
    frames.sort_by_key(|frame| frame.index);
    Ok(Choice {
        frames,
        turned_radians,
        missing,
    })
}

/// Returns the frame nearest to an angle, of the sharp ones within a distance
fn nearest_sharp(
    placed: &[(&FrameFacts, f64)],
    target: f64,
    reach: f64,
    usual_brightness: f64,
) -> Option<ChosenFrame> {
    let offset = |angle: f64| angle_between(angle, target).abs();
    let near: Vec<_> = placed
        .iter()
        .filter(|(_, angle)| offset(*angle) <= reach)
        .collect();
    let exposed =
        |frame: &FrameFacts| (frame.brightness / usual_brightness - 1.0).abs() <= OTHER_EXPOSURE;
    let any_exposed = near.iter().any(|(frame, _)| exposed(frame));
    let usable = || {
        near.iter()
            .filter(|(frame, _)| exposed(frame) || !any_exposed)
    };
    let sharpest = usable()
        .map(|(frame, _)| frame.sharpness)
        .fold(0.0, f64::max);
    let sharp = usable().filter(|(frame, _)| frame.sharpness >= SHARP * sharpest);
    let (frame, angle_radians) = sharp.min_by(|a, b| offset(a.1).total_cmp(&offset(b.1)))?;
    Some(ChosenFrame {
        index: frame.index,
        time_s: frame.time_s,
        angle_radians: *angle_radians,
    })
}

fn usual_brightness(survey: &Survey) -> f64 {
    let mut all: Vec<f64> = survey.frames.iter().map(|frame| frame.brightness).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).map_or(1.0, |usual| usual.max(1.0))
}

#[cfg(test)]
mod tests {
    use super::super::TurnSample;
    use super::*;

    /// Returns the facts of a video of 30 frames a second, and a track of a turn in eight seconds
    fn turn(seconds: f64) -> (Survey, TurnTrack) {
        let frames = (0..(30.0 * seconds) as usize).map(|index| FrameFacts {
            index,
            time_s: index as f64 / 30.0,
            sharpness: 100.0,
            brightness: 120.0,
            searched: false,
            keypoints: None,
        });
        let samples = (0..=(10.0 * seconds) as usize).map(|i| TurnSample {
            time_s: i as f64 / 10.0,
            angle_radians: i as f64 / 80.0 * TAU,
        });
        let survey = Survey {
            frames: frames.collect(),
            size_px: (540, 960),
            two_people: None,
        };
        let samples = samples.collect();
        (survey, TurnTrack { samples })
    }

    fn degrees(choice: &Choice) -> Vec<i32> {
        let angles = choice
            .frames
            .iter()
            .map(|f| f.angle_radians.to_degrees().round() as i32);
        angles.collect()
    }

    #[test]
    fn views_are_spread_evenly_over_the_turn() {
        let (survey, track) = turn(8.0);
        let choice = choose_frames(&survey, &track, &ChoiceOptions { views: 8 }).unwrap();
        assert_eq!(degrees(&choice), [0, 45, 90, 135, 180, 225, 270, 315]);
        assert_eq!(choice.missing, 0);
        // One turn and a half: no direction twice
        let (survey, track) = turn(12.0);
        let choice = choose_frames(&survey, &track, &ChoiceOptions::default()).unwrap();
        assert_eq!(choice.frames.len(), 16);
    }

    #[test]
    fn half_a_turn_gives_half_of_the_views_and_less_is_an_error() {
        let (survey, track) = turn(4.1);
        let choice = choose_frames(&survey, &track, &ChoiceOptions { views: 8 }).unwrap();
        assert_eq!(degrees(&choice), [0, 45, 90, 135, 180]);
        let (survey, track) = turn(3.0);
        let found = choose_frames(&survey, &track, &ChoiceOptions::default());
        assert!(
            matches!(found, Err(ChoiceError::TooLittle { .. })),
            "{found:?}"
        );
    }

    #[test]
    fn blurred_frames_and_other_exposures_are_avoided() {
        let (mut survey, track) = turn(8.0);
        // 90 degrees at 2 s, frame 60
        for frame in &mut survey.frames[58..63] {
            frame.sharpness = 40.0;
        }
        survey.frames[63].brightness = 140.0;
        let choice = choose_frames(&survey, &track, &ChoiceOptions { views: 8 }).unwrap();
        assert_eq!(choice.frames[2].index, 57);
    }
}
