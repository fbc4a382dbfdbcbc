//! A video of a person who turns on the spot: the turn is found, and sharp frames spread evenly over it become views.
//!
//! A [`FrameSource`] decodes the video as often as needed, and passes frames one by one, so that memory does not grow
//! with the length. [`survey()`] looks at all frames, shrunk: sharpness, brightness, and the keypoints of some of them.
//! [`TurnTrack`] is the turn angle over time, by these keypoints. [`choose_frames`] selects the frames. [`extract_views`]
//! does all of it, and takes the scene without the person from frames in which the person comes or leaves.

mod background;
mod choice;
mod extract;
mod survey;
mod turn_track;

use std::ops::ControlFlow;

use crate::scan::Photo;

pub use choice::{
    COMPLETE_TURN_DEGREES, Choice, ChoiceError, ChoiceOptions, ChosenFrame, choose_frames,
};
pub use extract::{ExtractError, ExtractOptions, Extracted, ExtractedView, extract_views};
pub use survey::{FrameFacts, Survey, SurveyOptions, TwoPeople, survey};
pub use turn_track::{TrackError, TurnSample, TurnTrack, tracked_turn_sd_radians};

/// A decoded frame
#[derive(Debug, Clone)]
pub struct Frame {
    /// Number of the frame in the video, from 0
    pub index: usize,
    /// Time stamp in the video, in s
    pub time_s: f64,
    /// The picture, upright and with square pixels
    pub photo: Photo,
}

/// A decoder of one video
pub trait FrameSource {
    /// Why frames cannot be decoded
    type Error;

    /// Decodes frames in order of time, until `on_frame` breaks
    ///
    /// Pictures whose longer side exceeds `max_side_px` are shrunk to it. With `indices`, in increasing order, only these
    /// frames are passed.
    ///
    /// # Errors
    /// When the video cannot be decoded, or contains no picture.
    fn frames(
        &mut self,
        max_side_px: usize,
        indices: Option<&[usize]>,
        on_frame: &mut dyn FnMut(Frame) -> ControlFlow<()>,
    ) -> Result<(), Self::Error>;
}
