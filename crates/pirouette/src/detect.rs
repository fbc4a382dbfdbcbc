//! Detection of the person's keypoints in photos, by the pose networks of [`pirouette_pose`].
//!
//! The camera is static, so the person is searched in one photo, and the region found there is used for all photos of the
//! same size. A helper or a mirror image that is found first is recognized: by standing still, or by another place in
//! single photos.
//! The 33 landmarks are converted to BODY_25: neck and mid hip are midpoints, small toes are missing, and nose
//! and eyes are omitted where the person is seen from behind, where the network invents them.
//!
//! # Source
//! V. Bazarevsky et al. 2020, "BlazePose: On-device Real-time Body Pose tracking".

use glam::{DVec2, DVec3};
use pirouette_body::{Avatar, Joint, Keypoint, Keypoints, PerJoint, ReferencePose};
use pirouette_geom::Grid;
use pirouette_geom::parallel::prelude::*;
use pirouette_pose::{Detection, LANDMARK_COUNT, Landmark, PersonMask, PoseModel, Region};
use pirouette_segment::seeds::LogOdds;

use crate::scan::Photo;

/// Passes of the network for each photo
const PASSES: usize = 2;

/// Presence of a person, 0 to 1, below which a region contains none
const MIN_PRESENCE: f64 = 0.9;

/// Confidence of all landmarks
///
/// The network's own visibility is no measure of accuracy: it is 1 for a face that is invented. Errors are about 1 % of
/// the stature, which is the standard deviation that the skeleton fit assumes for this confidence.
const CONFIDENCE: f64 = 0.6;

/// Landmarks of the network with the joints that they are
const LANDMARKS: [(Joint, usize); 21] = [
    (Joint::Nose, 0),
    (Joint::RightShoulder, 12),
    (Joint::RightElbow, 14),
    (Joint::RightWrist, 16),
    (Joint::LeftShoulder, 11),
    (Joint::LeftElbow, 13),
    (Joint::LeftWrist, 15),
    (Joint::RightHip, 24),
    (Joint::RightKnee, 26),
    (Joint::RightAnkle, 28),
    (Joint::LeftHip, 23),
    (Joint::LeftKnee, 25),
    (Joint::LeftAnkle, 27),
    (Joint::RightEye, 5),
    (Joint::LeftEye, 2),
    (Joint::RightEar, 8),
    (Joint::LeftEar, 7),
    (Joint::LeftBigToe, 31),
    (Joint::LeftHeel, 29),
    (Joint::RightBigToe, 32),
    (Joint::RightHeel, 30),
];

/// Landmarks that are invented where the person is seen from behind
const FACE: [Joint; 3] = [Joint::Nose, Joint::LeftEye, Joint::RightEye];

/// Position of the detector's points relative to the joints of the skeleton, in permille of the stature
///
/// Left joint or middle one; outward from the middle of the body, up, and forward, in the reference pose; for arms 48
/// degrees below the horizontal (A-pose), then for level arms (T-pose). Means of the networks `lite`, `full` and `heavy`,
/// from which each differs by at most 6 permille (toes: 9, elbows of level arms: 12), on renders of 24 people of the
/// MakeHuman base mesh in 8 photos each, per pose; after that, 4 to 13 permille remain. The built-in mannequin, whose face
/// and feet are simpler, gives values that differ by up to 10 permille (22 for the toes). See
/// `examples/detector_offsets.rs` of pirouette-eval.
const OFFSETS: [(Joint, [f64; 3], [f64; 3]); 11] = [
    (Joint::Nose, [0.0, 1.8, -10.6], [0.0, 1.6, -13.6]),
    (Joint::LeftShoulder, [-7.3, 12.5, 3.0], [-4.0, 7.0, 2.5]),
    (Joint::LeftElbow, [-4.1, 2.9, 13.3], [-5.0, 0.2, 35.7]),
    (Joint::LeftWrist, [0.3, -6.8, 11.9], [3.4, -1.7, 21.1]),
    (Joint::LeftHip, [-8.3, 6.2, 15.7], [-9.2, 4.9, 16.1]),
    (Joint::LeftKnee, [-0.7, 4.0, 0.7], [-1.0, 3.9, 0.6]),
    (Joint::LeftAnkle, [-1.0, 9.5, -2.5], [-1.1, 10.0, -1.8]),
    (Joint::LeftEye, [-2.5, -1.5, -7.3], [-2.9, -2.3, -8.7]),
    (Joint::LeftEar, [-22.9, -4.4, 24.8], [-22.1, -4.8, 23.8]),
    (Joint::LeftBigToe, [14.9, -5.0, 1.6], [14.8, -5.5, 0.7]),
    (Joint::LeftHeel, [-5.9, 3.5, 11.7], [-5.8, 4.2, 12.6]),
];

/// Returns where the detector places the joints of an avatar, in its reference pose, in mm
pub fn detected_positions(avatar: &Avatar) -> PerJoint<DVec3> {
    let unit = avatar.stature_mm() / 1000.0;
    let mut positions = avatar.keypoints;
    let level = levelness(avatar);
    for (left, lowered, raised) in OFFSETS {
        let [lowered, raised] = [lowered, raised].map(DVec3::from_array);
        let offset = lowered.lerp(raised, level) * unit;
        positions[left] += offset;
        if left.mirrored() != left {
            positions[left.mirrored()] += offset * DVec3::new(-1.0, 1.0, 1.0);
        }
    }
    positions.set_middles(|left, right| (left + right) / 2.0);
    positions
}

/// Returns 0 for arms as in the A-pose or lower, 1 for level arms
fn levelness(avatar: &Avatar) -> f64 {
    let arm = avatar.keypoints[Joint::LeftWrist] - avatar.keypoints[Joint::LeftShoulder];
    let below = (-arm.y).atan2(arm.x).to_degrees();
    (1.0 - below / ReferencePose::A.arm_angle_degrees()).clamp(0.0, 1.0)
}

/// Keypoints that were detected in photos
#[derive(Debug, Clone, PartialEq)]
pub struct DetectedKeypoints {
    /// Keypoints of each photo, in px of the photo; `None` where no person is found
    pub keypoints: Vec<Option<Keypoints>>,
    /// Log odds of each pixel of a photo to show the person, if requested; `None` where no person is found
    pub person_odds: Vec<Option<Grid<LogOdds>>>,
    /// Indices of photos in which another person was found first, in increasing order
    pub second_person: Vec<usize>,
}

/// Detects the keypoints of the person in each photo
///
/// `person` is where the person is, in px of the first photo, if known; otherwise the complete photos are searched. If the
/// person who is found first stands still in all photos, another one is searched who turns. `want_odds` requests
/// [`DetectedKeypoints::person_odds`], which takes a third of the time more. `on_photo_done` is called after each photo,
/// from any thread. After `cancelled` returns true, photos without a result have `None`.
pub fn detect_keypoints(
    model: &PoseModel,
    photos: &[&Photo],
    person: Option<Region>,
    want_odds: bool,
    on_photo_done: &(dyn Fn() + Sync),
    cancelled: &(dyn Fn() -> bool + Sync),
) -> DetectedKeypoints {
    let search = |index: usize| {
        let photo = (!cancelled()).then(|| as_input(photos[index])).flatten()?;
        Some((index, model.search(&photo)?))
    };
    let given = person.filter(|_| !photos.is_empty());
    let given = given.map(|region| (0, region));
    let first = given.or_else(|| (0..photos.len()).find_map(search));
    let in_all =
        |known: Option<(usize, Region)>, done: &(dyn Fn() + Sync)| -> Vec<Option<Detection>> {
            let detect = |(index, photo): (usize, &&Photo)| {
                let known = known.filter(|_| !cancelled());
                let found = known.and_then(|(first, region)| {
                    let region = photo.same_size(photos[first]).then_some(region);
                    // Photos before the first one were searched in vain.
                    let search = index > first;
                    detect_in(model, photo, region, search, want_odds)
                });
                done();
                found
            };
            photos.par_iter().enumerate().map(detect).collect()
        };
    let mut found = in_all(first, on_photo_done);
    let mut second_person = Vec::new();
    if let Some((index, region)) = first
        && photos.len() >= MIN_TURNING_PHOTOS
        && turning_px(&found) < STANDS_STILL * region.size()
        && let Some(other) = search_beside(model, photos[index], &region).filter(|_| !cancelled())
    {
        let others = in_all(Some((index, other)), &|| {});
        if turning_px(&others) > turning_px(&found) {
            found = others;
            second_person.push(index);
        }
    }
    let moved = follow_usual(&mut found, |index, region| {
        detect_in(model, photos[index], Some(region), false, want_odds)
    });
    second_person.extend(moved);
    second_person.sort_unstable();
    second_person.dedup();
    let to_keypoints = |found: &Detection| to_keypoints(&found.landmarks);
    DetectedKeypoints {
        keypoints: found.iter().map(|f| f.as_ref().map(to_keypoints)).collect(),
        person_odds: found
            .par_iter()
            .zip(photos)
            .map(|(found, photo)| Some(to_odds(found.as_ref()?.mask.as_ref()?, photo)))
            .collect(),
        second_person,
    }
}

/// Minimum number of photos in which a person who does not turn is someone else
const MIN_TURNING_PHOTOS: usize = 3;

/// Variation over the photos of the distance of the left side from the right one, below which a person does not turn, relative
/// to the size of the region
///
/// Half a turn changes it by twice the widths of shoulders and hips, about half of the size.
const STANDS_STILL: f64 = 0.15;

/// Searches for another person than the one in a region
pub(crate) fn search_beside(model: &PoseModel, photo: &Photo, region: &Region) -> Option<Region> {
    model.search_beside(&as_input(photo)?, region)
}

/// Returns how much the distance of the left side from the right side varies over the photos, in px
fn turning_px(found: &[Option<Detection>]) -> f64 {
    let across = |found: &Detection| left_of_right(&to_keypoints(&found.landmarks));
    let across = found.iter().flatten().map(across);
    let (least, most) = across.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), x| {
        (least.min(x), most.max(x))
    });
    most - least
}

/// Detects again, in the usual region, where a person was found elsewhere; returns the photos in which another one is there
fn follow_usual(
    found: &mut [Option<Detection>],
    detect: impl Fn(usize, Region) -> Option<Detection>,
) -> Vec<usize> {
    let regions = found.iter().flatten().map(|found| found.next_region);
    let regions: Vec<Region> = regions.collect();
    let Some(usual) = usual_region(&regions) else {
        return Vec::new();
    };
    let mut moved = Vec::new();
    for (index, found) in found.iter_mut().enumerate() {
        let elsewhere = |found: &Detection| found.next_region.is_elsewhere(&usual);
        if !found.as_ref().is_some_and(elsewhere) {
            continue;
        }
        // If no person is in the usual region, the camera moved.
        if let Some(there) = detect(index, usual).filter(|there| !elsewhere(there)) {
            *found = Some(there);
            moved.push(index);
        }
    }
    moved
}

/// Returns the region that is nearest to all others
fn usual_region(regions: &[Region]) -> Option<Region> {
    let distance = |a: &Region, b: &Region| {
        let [a, b] = [a, b].map(|region| DVec2::from_array(region.center()));
        a.distance(b)
    };
    let sum =
        |region: &Region| -> f64 { regions.iter().map(|other| distance(region, other)).sum() };
    regions
        .iter()
        .min_by(|a, b| sum(a).total_cmp(&sum(b)))
        .copied()
}

/// Detects the person in one photo, in a region if one is known and shows the person, otherwise by a search if permitted
pub(crate) fn detect_in(
    model: &PoseModel,
    photo: &Photo,
    region: Option<Region>,
    search: bool,
    want_mask: bool,
) -> Option<Detection> {
    let photo = as_input(photo)?;
    let detect = |region: Region| {
        let detection = model.detect(&photo, &region, PASSES, want_mask);
        (detection.presence >= MIN_PRESENCE).then_some(detection)
    };
    let found = region.and_then(detect);
    let searched = || search.then(|| model.search(&photo)).flatten();
    found.or_else(|| searched().and_then(detect))
}

/// Converts the mask of the network to log odds per pixel of the photo
fn to_odds(mask: &PersonMask, photo: &Photo) -> Grid<LogOdds> {
    Grid::from_fn(photo.width(), photo.height(), |x, y| {
        let probability = mask.at([x as f64 + 0.5, y as f64 + 0.5]);
        LogOdds::new((probability / (1.0 - probability)).ln() as f32)
    })
}

/// Borrows a photo for the network; `None` if it is empty or too large
fn as_input(photo: &Photo) -> Option<pirouette_pose::Photo<'_>> {
    pirouette_pose::Photo::new(photo.width(), photo.height(), photo.as_slice()).ok()
}

/// Converts landmarks to BODY_25
pub fn to_keypoints(landmarks: &[Landmark; LANDMARK_COUNT]) -> Keypoints {
    let mut keypoints = Keypoints::default();
    for (joint, index) in LANDMARKS {
        let position = DVec2::from_array(landmarks[index].position);
        let keypoint = Keypoint {
            position,
            confidence: CONFIDENCE,
        };
        if position.is_finite() {
            keypoints.set(joint, keypoint);
        }
    }
    for joint in Joint::MIDDLES {
        let sides = joint
            .middle_of()
            .map(|sides| sides.map(|side| keypoints.found(side)));
        if let Some([Some(left), Some(right)]) = sides {
            let position = left.position.midpoint(right.position);
            keypoints.set(joint, Keypoint { position, ..left });
        }
    }
    if is_seen_from_behind(&keypoints) {
        for joint in FACE {
            keypoints.set(joint, Keypoint::default());
        }
    }
    keypoints
}

/// Returns whether the left shoulder and hip are on the left side of the photo
fn is_seen_from_behind(keypoints: &Keypoints) -> bool {
    left_of_right(keypoints) < 0.0
}

/// Returns how far left shoulder and hip lie to the right of the right ones, summed, in px
fn left_of_right(keypoints: &Keypoints) -> f64 {
    let across = |left: Joint, right: Joint| {
        let x = |joint: Joint| keypoints.get(joint).position.x;
        x(left) - x(right)
    };
    across(Joint::LeftShoulder, Joint::RightShoulder) + across(Joint::LeftHip, Joint::RightHip)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Landmarks at their index as x and twice the index as y, mirrored if seen from behind
    fn landmarks(from_behind: bool) -> [Landmark; LANDMARK_COUNT] {
        let landmark = |i: usize| {
            let x = if from_behind { i as f64 } else { -(i as f64) };
            Landmark {
                position: [x, 2.0 * i as f64],
                depth: 0.0,
                visibility: 1.0,
                presence: 1.0,
            }
        };
        std::array::from_fn(landmark)
    }

    #[test]
    fn landmarks_become_joints_of_body_25() {
        let keypoints = to_keypoints(&landmarks(false));
        let y = |joint: Joint| keypoints.found(joint).map(|k| k.position.y);
        assert_eq!(y(Joint::Nose), Some(0.0));
        assert_eq!(y(Joint::LeftShoulder), Some(22.0));
        assert_eq!(y(Joint::RightBigToe), Some(64.0));
        assert_eq!(y(Joint::Neck), Some(23.0));
        assert_eq!(y(Joint::MidHip), Some(47.0));
        assert_eq!(y(Joint::LeftSmallToe), None);
        assert_eq!(keypoints.found_count(), 23);
    }

    #[test]
    fn offsets_are_mirrored_and_grow_with_the_stature() {
        let parameters = pirouette_body::mannequin::MannequinParameters::default();
        let avatar = pirouette_body::mannequin::mannequin(&parameters).unwrap();
        let moved = |avatar: &Avatar| {
            let detected = detected_positions(avatar);
            PerJoint::from_fn(|joint| detected[joint] - avatar.keypoints[joint])
        };
        let (once, twice) = (moved(&avatar), moved(&avatar.clone().scaled(2.0)));
        for joint in Joint::ALL {
            let mirror = DVec3::new(-1.0, 1.0, 1.0);
            assert!((once[joint] - once[joint.mirrored()] * mirror).length() < 1e-9);
            assert!((twice[joint] - once[joint] * 2.0).length() < 1e-9);
        }
        assert!(once[Joint::LeftShoulder].y > 10.0);
    }

    #[test]
    fn an_invented_face_is_omitted() {
        let keypoints = to_keypoints(&landmarks(true));
        assert!(FACE.iter().all(|&joint| keypoints.found(joint).is_none()));
        assert!(keypoints.found(Joint::LeftEar).is_some());
        assert_eq!(keypoints.found_count(), 20);
    }

    #[test]
    fn values_that_are_not_finite_are_no_keypoints() {
        let mut poisoned = landmarks(false);
        poisoned[11].position[0] = f64::NAN;
        let keypoints = to_keypoints(&poisoned);
        assert_eq!(keypoints.found(Joint::LeftShoulder), None);
        assert_eq!(keypoints.found(Joint::Neck), None);
        assert_eq!(keypoints.found_count(), 21);
    }
}
