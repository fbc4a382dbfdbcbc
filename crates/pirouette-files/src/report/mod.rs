//! Pictures of the results, for locating errors visually.
//!
//! [`keypoint_picture`] draws named joints over a photo, [`overlay()`] the results of one view over its photo,
//! [`contact_sheet`] puts all views side by side,
//! [`residual_sheet`] shows the differences between the fitted body and the photos, and [`tape_sheet`] shows the tapes
//! on the body. All are functions from data to pictures and write no files.

mod canvas;
mod contact;
mod font;
pub mod json;
mod keypoints;
mod labels;
mod overlay;
pub(crate) mod page;
pub(crate) mod pictures;
mod residuals;
mod tapes;
mod turn_curve;

pub use contact::{ContactView, contact_sheet};
pub use keypoints::keypoint_picture;
pub use overlay::{OverlayInput, SURE_CONFIDENCE, overlay};
pub use page::{data_uri, escape_html};
pub use residuals::{ResidualView, SeenBody, count_color, residual_sheet};
pub use tapes::tape_sheet;

use canvas::Color;
use pirouette_body::Joint;

const DETECTED_COLOR: Color = [240, 40, 130];
const TARGET_COLOR: Color = [20, 200, 235];
const CONTOUR_COLOR: Color = [250, 220, 20];

/// Lines between the joints of BODY_25
const SKELETON_LINES: [[Joint; 2]; 24] = [
    [Joint::Neck, Joint::MidHip],
    [Joint::Neck, Joint::RightShoulder],
    [Joint::RightShoulder, Joint::RightElbow],
    [Joint::RightElbow, Joint::RightWrist],
    [Joint::Neck, Joint::LeftShoulder],
    [Joint::LeftShoulder, Joint::LeftElbow],
    [Joint::LeftElbow, Joint::LeftWrist],
    [Joint::MidHip, Joint::RightHip],
    [Joint::RightHip, Joint::RightKnee],
    [Joint::RightKnee, Joint::RightAnkle],
    [Joint::MidHip, Joint::LeftHip],
    [Joint::LeftHip, Joint::LeftKnee],
    [Joint::LeftKnee, Joint::LeftAnkle],
    [Joint::Neck, Joint::Nose],
    [Joint::Nose, Joint::RightEye],
    [Joint::RightEye, Joint::RightEar],
    [Joint::Nose, Joint::LeftEye],
    [Joint::LeftEye, Joint::LeftEar],
    [Joint::LeftAnkle, Joint::LeftBigToe],
    [Joint::LeftBigToe, Joint::LeftSmallToe],
    [Joint::LeftAnkle, Joint::LeftHeel],
    [Joint::RightAnkle, Joint::RightBigToe],
    [Joint::RightBigToe, Joint::RightSmallToe],
    [Joint::RightAnkle, Joint::RightHeel],
];
