//! From a video to its views.

use std::cell::Cell;
use std::ops::ControlFlow;

use pirouette_body::TurnAngle;
use pirouette_pose::PoseModel;
use thiserror::Error;

use super::background::{combine, frames_without};
use super::choice::MIN_TURN;
use super::{
    Choice, ChoiceError, ChoiceOptions, Frame, FrameSource, Survey, SurveyOptions, TrackError,
    TurnTrack, TwoPeople, choose_frames, survey,
};
use crate::scan::{Background, Photo};

/// Options of [`extract_views`]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExtractOptions {
    /// How frames are looked at
    pub survey: SurveyOptions,
    /// How frames are chosen
    pub choice: ChoiceOptions,
}

/// A frame that is a view of the person
#[derive(Debug, Clone)]
pub struct ExtractedView {
    /// Time stamp in the video, in s
    pub time_s: f64,
    /// Turn angle by the keypoints of this frame and its neighbors, accurate to some degrees
    pub turn: TurnAngle,
    /// The frame
    pub photo: Photo,
}

/// The views of a video
#[derive(Debug, Clone)]
pub struct Extracted {
    /// In order of time
    pub views: Vec<ExtractedView>,
    /// The turn over time
    pub track: TurnTrack,
    /// The choice that was made
    pub choice: Choice,
    /// The scene without the person, if the person comes or leaves in the video
    pub background: Option<Background>,
    /// Where the person is, and another one, if there is one
    pub two_people: Option<TwoPeople>,
    /// Columns and rows of the frames in which they are
    pub size_px: (usize, usize),
}

/// Why a video has no views
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ExtractError<E> {
    /// The video cannot be decoded
    #[error(transparent)]
    Decode(E),
    /// There is no turn
    #[error(transparent)]
    Track(TrackError),
    /// The turn is too small
    #[error(transparent)]
    Choice(ChoiceError),
    /// It was cancelled
    #[error("cancelled")]
    Cancelled,
}

/// Largest side of extracted frames, in px
///
/// Outlines are found to a fraction of a pixel, and more pixels contain little detail at the rates of phones. A scan of 16
/// frames of 1080 x 1920 px takes 460 MB, shrunk to this, 380 MB.
const MAX_SIDE_PX: usize = 1440;

/// Finds the turn in a video, and extracts sharp frames spread evenly over it
///
/// The video is decoded twice: once to look at all frames, once for the chosen ones. If the person who is found first does
/// not turn, but another one does, it is decoded once more for that one. `on_time` is called with the time of
/// each decoded frame, in s; the work is cancelled where it breaks.
///
/// # Errors
/// When the video cannot be decoded, shows no person who turns, or the work is cancelled.
pub fn extract_views<S: FrameSource>(
    source: &mut S,
    model: &PoseModel,
    options: &ExtractOptions,
    on_time: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<Extracted, ExtractError<S::Error>> {
    let cancelled = Cell::new(false);
    let mut watched = |time_s: f64| {
        let flow = on_time(time_s);
        cancelled.set(cancelled.get() || flow.is_break());
        flow
    };
    let mut follow = |options: &SurveyOptions| {
        let survey = survey(source, model, options, &mut watched);
        if cancelled.get() {
            return Err(ExtractError::Cancelled);
        }
        Ok(Followed::new(survey.map_err(ExtractError::Decode)?))
    };
    let mut found = follow(&options.survey)?;
    // If the person who was found does not turn, someone who is there, too, may.
    if let Some(people) = found.survey.two_people
        && found.turned_radians() < MIN_TURN
    {
        let mut of_other = follow(&SurveyOptions {
            region: Some(people.other),
            ..options.survey
        })?;
        if of_other.turned_radians() >= MIN_TURN {
            of_other.survey.two_people = Some(TwoPeople {
                followed: people.other,
                other: people.followed,
            });
            found = of_other;
        }
    }
    let Followed { survey, track } = found;
    let track = track.map_err(ExtractError::Track)?;
    let choice = choose_frames(&survey, &track, &options.choice).map_err(ExtractError::Choice)?;
    let without = frames_without(&survey);
    let mut indices: Vec<usize> = choice.frames.iter().map(|frame| frame.index).collect();
    indices.extend(&without);
    indices.sort_unstable();
    indices.dedup();
    let mut views = Vec::with_capacity(choice.frames.len());
    let mut scenes = Vec::with_capacity(without.len());
    let decoded = source.frames(MAX_SIDE_PX, Some(&indices), &mut |frame: Frame| {
        if without.contains(&frame.index) {
            scenes.push(frame.photo);
        // Time stamps of both passes are equal; those of the first one have an angle.
        } else if let Some(chosen) = choice.frames.iter().find(|c| c.index == frame.index) {
            views.push(ExtractedView {
                time_s: chosen.time_s,
                turn: TurnAngle::from_radians(chosen.angle_radians),
                photo: frame.photo,
            });
        }
        watched(frame.time_s)
    });
    if cancelled.get() {
        return Err(ExtractError::Cancelled);
    }
    decoded.map_err(ExtractError::Decode)?;
    Ok(Extracted {
        views,
        track,
        choice,
        background: combine(&scenes, model),
        two_people: survey.two_people,
        size_px: survey.size_px,
    })
}

/// A person who was followed through the video
struct Followed {
    survey: Survey,
    track: Result<TurnTrack, TrackError>,
}

impl Followed {
    fn new(survey: Survey) -> Self {
        let searched = survey.frames.iter().filter(|frame| frame.searched);
        let track = TurnTrack::find(searched.map(|f| (f.time_s, f.keypoints.as_ref())));
        Self {
            track: track.map(TurnTrack::without_detector_bias),
            survey,
        }
    }

    /// Returns the angle between the extreme directions of the person, 0 if there is no track
    fn turned_radians(&self) -> f64 {
        let range = self.track.as_ref().map_or((0.0, 0.0), TurnTrack::range);
        range.1 - range.0
    }
}
