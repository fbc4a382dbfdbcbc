//! From the points of the people of one photo to the joints of the person: units, confidences, order, selection.

use glam::DVec2;
use pirouette::detect::to_keypoints;
use pirouette::scan::KeypointKind;
use pirouette_body::{Joint, Keypoint, Keypoints};
use pirouette_pose::{LANDMARK_COUNT, Landmark};

use super::anatomy::{contradictions, is_in_other_order, is_seen_from_behind};
use super::layout::Layout;
use super::photos::Photo;
use super::points::{Person, Point};
use super::{Detection, KeypointsError};

/// Confidences up to this value are clamped to 1
///
/// Peaks of a heat map slightly exceed 1 after smoothing; percentages far exceed it.
const MAX_CONFIDENCE: f64 = 1.2;

/// Scores up to this value are divided by the highest score of the photo; higher ones are rejected
///
/// Detectors with other outputs than heat maps (RTMPose, RTMW, Detectron2) write unnormalized scores, up to about 10.
const MAX_SCORE: f64 = 15.0;

/// Confidence of points without one, and of points that an annotation marks as visible
///
/// The skeleton fit assumes a standard deviation of about 1 % of the stature for it.
const FIXED_CONFIDENCE: f64 = 0.6;

/// Confidence of points that an annotation marks as hidden
const HIDDEN_CONFIDENCE: f64 = 0.3;

/// Coordinates up to this absolute value are in units of the photo's size instead of px
///
/// Joints inferred outside the photo exceed 1; no person is this small in px.
const MAX_NORMALIZED: f64 = 3.0;

/// Maximum coordinate of the range -1 to 1, and minimum below which it is that range
const MAX_SIGNED: f64 = 1.05;
const MIN_SIGNED: f64 = -0.1;

/// Found points from which the unit is determined; fewer are in px
const MIN_UNIT_POINTS: usize = 3;

/// Distance of the mid hip from the origin, in meters, below which landmarks are positions in the room
const MAX_WORLD_HIP: f64 = 0.02;

/// Maximum distance of coordinates from the photo, in photo sizes; farther ones are rejected
///
/// Models that infer hidden joints place them up to half a photo outside.
const MAX_OUTSIDE_SIZES: f64 = 10.0;

/// Maximum relative difference of the shapes of the photo and of the image of the coordinates
const SHAPE_TOLERANCE: f64 = 0.02;

/// Distance from the middle of the photo, in photo diagonals, at which a person's weight is one half
const HALF_WEIGHT_DISTANCE: f64 = 0.25;

/// Contradictions by which BODY_25 must exceed BODY_25B before a file is read as the latter
const MIN_25B_ADVANTAGE: usize = 2;

/// Selects the person and converts the joints to px of a photo
pub(super) fn detection(
    photo: &Photo,
    width_px: usize,
    height_px: usize,
) -> Result<Detection, KeypointsError> {
    let size = DVec2::new(width_px as f64, height_px as f64);
    let frame = Frame {
        size,
        unit: unit(photo, size)?,
        scores: scores(photo),
    };
    let order = twenty_five(photo, &frame);
    let mut best: Option<(f64, Keypoints, usize, &Person)> = None;
    for (person, entry) in photo.people.iter().enumerate() {
        let keypoints = frame.keypoints(person, entry, order)?;
        let score = prominence(&keypoints, size);
        if best.is_none_or(|(best_score, ..)| score > best_score) {
            best = Some((score, keypoints, person, entry));
        }
    }
    let people_count = photo.people.len();
    let Some((_, keypoints, person, entry)) = best else {
        return Ok(Detection {
            people_count,
            ..Detection::default()
        });
    };
    let kind = photo.kind.unwrap_or(entry.layout.kind());
    if entry.layout.kind() != KeypointKind::OpenPose && is_in_other_order(&keypoints) {
        let point_count = entry.points.len();
        return Err(KeypointsError::Order {
            person,
            point_count,
        });
    }
    Ok(Detection {
        keypoints,
        people_count,
        kind,
    })
}

/// How the numbers of a photo are read
struct Frame {
    size: DVec2,
    unit: Unit,
    scores: Scores,
}

/// Conversion of coordinates to px: factor after an offset
struct Unit {
    offset: f64,
    factor: DVec2,
}

/// Meaning of the confidences of a photo
enum Scores {
    /// 0 to 1
    Confidences,
    /// 0 not labeled, 1 with this confidence, 2 visible
    Flags { hidden: f64 },
    /// Unnormalized, with this maximum
    Unnormalized(f64),
    /// None
    Missing,
}

/// Determines the unit of the coordinates of a photo
fn unit(photo: &Photo, size: DVec2) -> Result<Unit, KeypointsError> {
    let found = || {
        photo
            .people
            .iter()
            .flat_map(|p| &p.points)
            .filter(|p| p.found())
    };
    let min = found().map(|p| p.x.min(p.y)).fold(f64::INFINITY, f64::min);
    let max = found()
        .map(|p| p.x.abs().max(p.y.abs()))
        .fold(0.0, f64::max);
    if found().count() < MIN_UNIT_POINTS || max > MAX_NORMALIZED {
        return Ok(Unit {
            offset: 0.0,
            factor: resize(photo, size)?,
        });
    }
    let kind = photo.people.first().map(|person| person.layout.kind());
    if kind == Some(KeypointKind::OpenPose) && min < 0.0 {
        if min > MIN_SIGNED || max > MAX_SIGNED {
            return Err(KeypointsError::Unit);
        }
        return Ok(Unit {
            offset: 1.0,
            factor: size / 2.0,
        });
    }
    let in_room = |person: &Person| {
        let hips = [23, 24].map(|index| person.points.get(index));
        match hips {
            [Some(left), Some(right)] if person.layout == Layout::MediaPipe33 => {
                (left.x + right.x).abs() / 2.0 < MAX_WORLD_HIP
                    && (left.y + right.y).abs() / 2.0 < MAX_WORLD_HIP
            }
            _ => false,
        }
    };
    if photo.people.iter().any(in_room) {
        return Err(KeypointsError::World);
    }
    Ok(Unit {
        offset: 0.0,
        factor: size,
    })
}

/// Returns the size of the photo relative to the image of the coordinates
fn resize(photo: &Photo, size: DVec2) -> Result<DVec2, KeypointsError> {
    let Some((width, height)) = photo.size_px.filter(|&(w, h)| w > 0.0 && h > 0.0) else {
        return Ok(DVec2::ONE);
    };
    let factor = size / DVec2::new(width, height);
    if (factor.x / factor.y - 1.0).abs() > SHAPE_TOLERANCE {
        return Err(KeypointsError::OtherSize {
            file_width: width,
            file_height: height,
            width_px: size.x as usize,
            height_px: size.y as usize,
        });
    }
    Ok(factor)
}

/// Determines the meaning of the confidences of a photo
fn scores(photo: &Photo) -> Scores {
    let of_person = |person: &Person| -> Vec<f64> {
        let joints = person.layout.joints().iter();
        let points = joints.filter_map(|&(_, index)| person.points.get(index));
        points.filter_map(|point| point.confidence).collect()
    };
    let all: Vec<f64> = photo.people.iter().flat_map(of_person).collect();
    let max = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let openpose = |person: &Person| person.layout.kind() == KeypointKind::OpenPose;
    let whole = |score: &f64| {
        [0.0, 1.0, 2.0]
            .iter()
            .any(|flag| (score - flag).abs() <= 0.0)
    };
    if all.is_empty() {
        Scores::Missing
    } else if photo.people.iter().any(openpose) {
        Scores::Confidences
    } else if all.iter().all(whole) {
        // Without a 2, 1 does not mean hidden.
        let hidden = if max > 1.0 {
            HIDDEN_CONFIDENCE
        } else {
            FIXED_CONFIDENCE
        };
        Scores::Flags { hidden }
    } else if max > MAX_CONFIDENCE && max <= MAX_SCORE {
        Scores::Unnormalized(max)
    } else {
        Scores::Confidences
    }
}

/// Returns the order of lists of 25 points: BODY_25B only if its people are clearly more plausible
fn twenty_five(photo: &Photo, frame: &Frame) -> Layout {
    let count = |layout: Layout| -> usize {
        let people = photo.people.iter().filter(|p| p.layout == Layout::Body25);
        let keypoints = people.filter_map(|person| {
            let person = Person {
                layout,
                ..person.clone()
            };
            frame.keypoints(0, &person, layout).ok()
        });
        keypoints.map(|keypoints| contradictions(&keypoints)).sum()
    };
    if count(Layout::Body25) >= count(Layout::Body25B) + MIN_25B_ADVANTAGE {
        Layout::Body25B
    } else {
        Layout::Body25
    }
}

impl Frame {
    /// Converts one person; `order` is that of 25 points
    fn keypoints(
        &self,
        person: usize,
        entry: &Person,
        order: Layout,
    ) -> Result<Keypoints, KeypointsError> {
        let mut keypoints = match entry.layout {
            Layout::MediaPipe33 => self.landmarks(entry),
            Layout::Body25 => self.joints(person, entry, order)?,
            layout => self.joints(person, entry, layout)?,
        };
        for (joint, keypoint) in keypoints.iter() {
            self.check_position(person, joint, keypoint)?;
        }
        if entry.layout != Layout::Body25 || order == Layout::Body25B {
            add_middles(&mut keypoints);
        }
        if matches!(self.scores, Scores::Missing) && is_seen_from_behind(&keypoints) {
            for joint in [Joint::Nose, Joint::LeftEye, Joint::RightEye] {
                keypoints.set(joint, Keypoint::default());
            }
        }
        Ok(keypoints)
    }

    fn position(&self, point: &Point) -> DVec2 {
        (DVec2::new(point.x, point.y) + self.unit.offset) * self.unit.factor
    }

    fn joints(
        &self,
        person: usize,
        entry: &Person,
        layout: Layout,
    ) -> Result<Keypoints, KeypointsError> {
        let mut keypoints = Keypoints::default();
        for &(joint, index) in layout.joints() {
            let Some(point) = entry.points.get(index) else {
                continue;
            };
            let invalid = |confidence| KeypointsError::Confidence {
                person,
                joint,
                confidence,
            };
            let confidence = self.confidence(point, layout).map_err(invalid)?;
            if point.found() && confidence > 0.0 {
                let position = self.position(point);
                keypoints.set(
                    joint,
                    Keypoint {
                        position,
                        confidence,
                    },
                );
            }
        }
        Ok(keypoints)
    }

    /// Returns the confidence from 0 to 1; the error is an invalid one
    fn confidence(&self, point: &Point, layout: Layout) -> Result<f64, f64> {
        let Some(confidence) = point.confidence else {
            return Ok(FIXED_CONFIDENCE);
        };
        match self.scores {
            Scores::Flags { .. } if confidence > 1.0 => Ok(FIXED_CONFIDENCE),
            Scores::Flags { hidden } if confidence > 0.0 => Ok(hidden),
            Scores::Flags { .. } | Scores::Missing => Ok(0.0),
            Scores::Unnormalized(max) if confidence >= -MAX_SCORE => {
                Ok((confidence / max).clamp(0.0, 1.0))
            }
            Scores::Confidences if (0.0..=MAX_CONFIDENCE).contains(&confidence) => {
                Ok(confidence.min(1.0))
            }
            // Outputs of other detectors than OpenPose may be negative where nothing is.
            Scores::Confidences
                if layout.kind() != KeypointKind::OpenPose
                    && (-MAX_SCORE..0.0).contains(&confidence) =>
            {
                Ok(0.0)
            }
            _ => Err(confidence),
        }
    }

    /// Converts landmarks as those detected here
    fn landmarks(&self, entry: &Person) -> Keypoints {
        let landmark = |index: usize| {
            let point = entry.points.get(index).filter(|point| {
                let position = Point {
                    confidence: None,
                    ..**point
                };
                position.found()
            });
            let position = point.map_or(DVec2::NAN, |point| self.position(point));
            Landmark {
                position: position.to_array(),
                depth: 0.0,
                visibility: 1.0,
                presence: 1.0,
            }
        };
        let landmarks: [Landmark; LANDMARK_COUNT] = std::array::from_fn(landmark);
        to_keypoints(&landmarks)
    }

    fn check_position(
        &self,
        person: usize,
        joint: Joint,
        keypoint: Keypoint,
    ) -> Result<(), KeypointsError> {
        let (position, reach) = (keypoint.position, self.size * MAX_OUTSIDE_SIZES);
        if position.cmpge(-reach).all() && position.cmple(self.size + reach).all() {
            return Ok(());
        }
        Err(KeypointsError::FarOutside {
            person,
            joint,
            x: position.x,
            y: position.y,
            width_px: self.size.x as usize,
            height_px: self.size.y as usize,
        })
    }
}

/// Sets neck and mid hip to the midpoints of shoulders and hips where they are missing
fn add_middles(keypoints: &mut Keypoints) {
    for joint in Joint::MIDDLES {
        let sides = joint
            .middle_of()
            .map(|sides| sides.map(|side| keypoints.found(side)));
        if let Some([Some(left), Some(right)]) = sides
            && keypoints.get(joint).confidence <= 0.0
        {
            let middle = Keypoint {
                position: left.position.midpoint(right.position),
                confidence: left.confidence.min(right.confidence),
            };
            keypoints.set(joint, middle);
        }
    }
}

/// Sum of confidences, reduced with the person's distance from the middle of the photo
fn prominence(keypoints: &Keypoints, size: DVec2) -> f64 {
    let (mut sum, mut center) = (0.0, DVec2::ZERO);
    for (_, keypoint) in keypoints.iter() {
        sum += keypoint.confidence;
        center += keypoint.position * keypoint.confidence;
    }
    if sum <= 0.0 {
        return 0.0;
    }
    let distance = (center / sum - size / 2.0).length() / size.length();
    sum / (1.0 + (distance / HALF_WEIGHT_DISTANCE).powi(2))
}
