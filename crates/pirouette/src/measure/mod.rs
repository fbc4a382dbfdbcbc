//! Tape measurements of a body.
//!
//! Each girth is estimated twice: from the outlines of the photos, by support lines (see `support`), and along a
//! section of the fitted body. Both are reported, with their variance-weighted mean. The fitted body determines the
//! positions of the tapes, by definition on its own shape (`landmarks`), and the assignment of outlines to limbs.
//! Heights and lengths are measured on it. Values that cannot be determined are omitted with the reason.
//!
//! # Source
//! ISO 8559-1:2017. The definition of each measure is given by [`Measure::definition`]; some differ from the standard.

mod clothes;
mod girths;
mod landmarks;
mod lengths;
mod marked_avatar;
mod mass;
mod names;
mod prior;
mod support;
mod tape;
mod value;

use pirouette_geom::TriMesh;
use pirouette_geom::parallel::prelude::*;

use crate::scan::{StatureFrom, Subject};
pub use clothes::{Clothes, Covering, Part, Surface};
use marked_avatar::MarkedAvatar;
pub use marked_avatar::measure_avatar;
pub use mass::BodyMass;
pub use names::{Basis, Girth, Landmark, Measure};
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{Avatar, Camera, Pose, PosedAvatar, TurnAngle};
use pirouette_geom::outline_map::OutlineMap;
use support::SeenView;
pub use value::{Estimate, LengthUnit, Measured, Measurements, Method, Unavailable};

/// A silhouette of the person
#[derive(Debug, Clone, Copy)]
pub struct MeasureView<'a> {
    /// Signed distances to the outline of its soft coverage, of any reach
    pub outline: &'a OutlineMap,
    /// The camera of the view
    pub camera: Camera,
    /// Turn angle of the person
    pub turn: TurnAngle,
    /// The pose in which the avatar explains it; the default for silhouettes in the reference pose
    pub pose: Pose,
}

/// Source of a measured body
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodySource {
    /// The fitted body, which is the avatar, too
    Fitted,
    /// The visual hull of the silhouettes, beside an avatar with the person's bone lengths
    Hull,
}

/// The input of a measurement, all in the world frame, mm
#[derive(Debug, Clone, Copy)]
pub struct MeasureInput<'a> {
    /// The body
    pub body: &'a TriMesh,
    /// The fitted body, or an avatar with the person's bone lengths, in the reference pose
    pub avatar: &'a Avatar,
    /// Source of the body
    pub source: BodySource,
    /// Silhouettes of the person
    pub views: &'a [MeasureView<'a>],
    /// Height of the person with the soles of their shoes, if known; without it, results are in units of the stature
    pub stature_mm: Option<f64>,
    /// Source of the stature
    pub stature_from: StatureFrom,
    /// Additional data given by the person
    pub subject: Subject,
    /// Share of the views whose silhouettes were given instead of found in photos
    pub given_masks: f64,
    /// Share of the views, 0 to 1, whose keypoints are those of MediaPipe: see [`crate::detect`]
    pub detected_keypoints: f64,
    /// Share of the views, 0 to 1, whose keypoints were estimated without a detector
    pub estimated_keypoints: f64,
    /// Additional standard deviation of this scan
    pub extra_sd: ExtraSd,
    /// The surface whose measures are wanted
    pub surface: Surface,
    /// Whether the person wears a skirt or a dress
    pub skirt: bool,
}

/// Standard deviation in addition to that of a usual scan
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExtraSd {
    /// Of every value but the stature, as a share of it
    pub share: f64,
    /// Of heights and lengths, as a share of them
    pub length_share: f64,
    /// Of the position of an outline, in mm
    pub outline_mm: f64,
}

impl ExtraSd {
    /// Returns the standard deviation of a value, in mm
    ///
    /// An outline that is off widens a girth by a circle's share; a length has two ends.
    fn of(&self, measure: Measure, value_mm: f64) -> f64 {
        let (turns, share) = if measure.girths().is_empty() {
            (2.0, self.share.hypot(self.length_share))
        } else {
            (std::f64::consts::TAU, self.share)
        };
        match measure {
            Measure::Stature => 0.0,
            _ => (share * value_mm).hypot(turns * self.outline_mm),
        }
    }
}

impl<'a> MeasureInput<'a> {
    /// Creates the input to measure an avatar on its own surface, without silhouettes, at its stature
    pub fn of_avatar(avatar: &'a Avatar) -> Self {
        Self {
            body: &avatar.mesh,
            avatar,
            source: BodySource::Fitted,
            views: &[],
            stature_mm: Some(avatar.stature_mm()),
            stature_from: StatureFrom::Stated,
            subject: Subject::default(),
            given_masks: 1.0,
            detected_keypoints: 0.0,
            estimated_keypoints: 0.0,
            extra_sd: ExtraSd::default(),
            surface: Surface::Clothed,
            skirt: false,
        }
    }

    /// Returns the stated thickness of the soles, in mm; 0 if it is unknown
    fn sole_mm(&self) -> f64 {
        self.subject.sole_mm.unwrap_or(0.0)
    }

    /// Returns the height of the person without shoes, in mm
    fn barefoot_mm(&self) -> Option<f64> {
        self.stature_mm
            .map(|stature_mm| stature_mm - self.sole_mm())
    }

    /// Returns whether the body was fitted to a mesh: then only what joints determine is as uncertain as they are
    fn surface_is_known(&self) -> bool {
        self.stature_from == StatureFrom::Mesh
    }

    /// Interpolates a standard deviation between those from photos and by given silhouettes
    fn between(&self, photos: f64, given: f64) -> f64 {
        photos + (given - photos) * self.given_masks.clamp(0.0, 1.0)
    }
}

/// Returns the additional standard deviation of measurements with detected keypoints, as a share of the value
///
/// Detected shoulders, hips and elbows are less accurate than those that the other standard deviations assume. Measured on
/// ten rendered people in eight photos each, with detected and with exact, noisy keypoints; scans of other rendered
/// people agree.
fn detected_keypoints_sd(measure: Measure) -> f64 {
    match measure {
        Measure::Stature => 0.0,
        Measure::ShoulderWidth
        | Measure::ShoulderLength
        | Measure::AcrossBack
        | Measure::AcrossFront => 0.030,
        Measure::BackLength | Measure::NapeToWaist => 0.025,
        Measure::BustGirth | Measure::CrotchHeight | Measure::FootLength => 0.015,
        Measure::WaistGirth | Measure::ThighGirth => 0.010,
        _ => 0.007,
    }
}

/// Returns the additional standard deviation of measurements with estimated keypoints, as a share of the value
///
/// Root mean square errors of 19 rendered people in eight photos each; arm lengths and bust girths are worse on people of
/// another body model (2 to 5 %, and 1 to 2 %).
fn estimated_keypoints_sd(measure: Measure) -> f64 {
    match measure {
        Measure::Stature => 0.0,
        Measure::ShoulderWidth
        | Measure::ShoulderLength
        | Measure::AcrossBack
        | Measure::AcrossFront => 0.035,
        Measure::ArmLength
        | Measure::ShoulderToWrist
        | Measure::UpperArmLength
        | Measure::NapeToWrist => 0.030,
        Measure::BustGirth
        | Measure::BackLength
        | Measure::NapeToWaist
        | Measure::ThighGirth
        | Measure::CrotchHeight
        | Measure::FootLength => 0.020,
        _ => 0.010,
    }
}

/// Measures a body
///
/// Never fails entirely: a value that cannot be determined is missing with its reason.
pub fn measure(input: &MeasureInput) -> Measurements {
    let avatar = input.avatar;
    let see_views = || -> Vec<SeenView> {
        let edges = SilhouetteMesh::new(&avatar.mesh.triangles);
        let views = input.views.par_iter().filter(|v| !v.outline.is_empty());
        views.map(|view| see(avatar, &edges, view)).collect()
    };
    let (views, marked) = pirouette_geom::parallel::join(see_views, || MarkedAvatar::new(avatar));
    let scale_sd = lengths::scale_sd(input);
    let hidden_crotch = lengths::hidden_crotch(&marked);
    let mut mass = mass::estimate_mass(input, scale_sd);
    let contradiction = mass.as_ref().map_or(0.0, BodyMass::contradiction);
    let values = Measure::ALL.into_par_iter().map(|measure| {
        let measured = match measure {
            Measure::Stature => lengths::stature(input),
            _ if !measure.girths().is_empty() => {
                girths::measure_girth(input, &marked, &views, measure)
            }
            _ => lengths::measure_length(input, &marked, measure),
        };
        let detected_sd = input.detected_keypoints * detected_keypoints_sd(measure);
        let estimated_sd = match measure.basis() {
            Basis::Skin if input.surface_is_known() => 0.0,
            _ => input.estimated_keypoints * estimated_keypoints_sd(measure),
        };
        let keypoint_sd = detected_sd.hypot(estimated_sd);
        let extra_sd = ExtraSd {
            share: input.extra_sd.share.hypot(keypoint_sd).hypot(contradiction),
            length_share: input.extra_sd.length_share
                * (1.0 + hidden_crotch * lengths::change_by_crotch(measure)),
            ..input.extra_sd
        };
        let measured = measured
            .with_more_sd(|value_mm| extra_sd.of(measure, value_mm))
            .with_scale_sd(scale_sd);
        let measured = match lengths::is_above_floor(measure) {
            true => measured.lowered_by(input.sole_mm()),
            false => measured,
        };
        // Statistics of a mass that the body contradicts would only hide the contradiction.
        if contradiction > 0.0 {
            (measure, measured)
        } else {
            (measure, prior::support(input, measure, measured))
        }
    });
    let mut values: Vec<(Measure, Measured)> = values.collect();
    let clothes = clothes::look_below(input, &mut values, &mut mass);
    let height = values.iter().find(|(m, _)| *m == Measure::Stature);
    let height_mm = height.and_then(|(_, found)| found.value_mm.ok());
    Measurements {
        stature: input.stature_mm.map(|_| input.stature_from),
        height_mm: height_mm.unwrap_or(avatar.stature_mm()),
        values,
        subject: input.subject,
        mass,
        clothes,
        tapes: marked.tape_curves(),
    }
}

/// A view with the expected coverage of the avatar
fn see<'a>(avatar: &Avatar, edges: &SilhouetteMesh, view: &MeasureView<'a>) -> SeenView<'a> {
    let PosedAvatar {
        bones: posed,
        positions,
    } = avatar.posed(&view.pose, view.turn);
    let expected = edges.silhouette(&positions, &view.camera);
    SeenView::new(view.outline, view.camera, posed, &expected)
}

#[cfg(test)]
mod tests;
