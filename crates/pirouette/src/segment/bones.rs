//! Seeds from the skeleton: classifies pixels by their distance to the bones.

use glam::DVec2;
use pirouette_geom::Grid;
use pirouette_segment::seeds::Seed;

use super::SegmentError;
use pirouette_body::{Joint, Keypoints, NOMINAL_STATURE_PX};

/// A capsule of seeds between two joints; radii and margins in torso lengths (neck to mid hip)
struct SeedBone {
    from: Joint,
    to: Joint,
    /// Radius within which pixels are probably person
    person_radius: f64,
    /// Width of the probable background around it; pixels beyond are surely background
    background_margin: f64,
}

const fn bone(from: Joint, to: Joint, person_radius: f64, background_margin: f64) -> SeedBone {
    SeedBone {
        from,
        to,
        person_radius,
        background_margin,
    }
}

/// Extent of the body around each bone
///
/// Wide enough for loose clothes on most people; the margins cover the remainder.
const SEED_BONES: [SeedBone; 24] = [
    bone(Joint::Neck, Joint::MidHip, 0.30, 0.12),
    bone(Joint::Neck, Joint::RightShoulder, 0.16, 0.10),
    bone(Joint::Neck, Joint::LeftShoulder, 0.16, 0.10),
    bone(Joint::RightShoulder, Joint::RightElbow, 0.13, 0.10),
    bone(Joint::RightElbow, Joint::RightWrist, 0.11, 0.10),
    bone(Joint::LeftShoulder, Joint::LeftElbow, 0.13, 0.10),
    bone(Joint::LeftElbow, Joint::LeftWrist, 0.11, 0.10),
    bone(Joint::MidHip, Joint::RightHip, 0.20, 0.12),
    bone(Joint::MidHip, Joint::LeftHip, 0.20, 0.12),
    bone(Joint::RightHip, Joint::RightKnee, 0.19, 0.11),
    bone(Joint::RightKnee, Joint::RightAnkle, 0.14, 0.10),
    bone(Joint::LeftHip, Joint::LeftKnee, 0.19, 0.11),
    bone(Joint::LeftKnee, Joint::LeftAnkle, 0.14, 0.10),
    bone(Joint::Neck, Joint::Nose, 0.15, 0.12),
    bone(Joint::Nose, Joint::RightEye, 0.20, 0.12),
    bone(Joint::Nose, Joint::LeftEye, 0.20, 0.12),
    bone(Joint::RightEye, Joint::RightEar, 0.20, 0.12),
    bone(Joint::LeftEye, Joint::LeftEar, 0.20, 0.12),
    bone(Joint::Neck, Joint::RightEar, 0.16, 0.12),
    bone(Joint::Neck, Joint::LeftEar, 0.16, 0.12),
    bone(Joint::RightAnkle, Joint::RightBigToe, 0.08, 0.10),
    bone(Joint::RightAnkle, Joint::RightHeel, 0.08, 0.10),
    bone(Joint::LeftAnkle, Joint::LeftBigToe, 0.08, 0.10),
    bone(Joint::LeftAnkle, Joint::LeftHeel, 0.08, 0.10),
];

/// Thickness of the surely-person line along a bone, in torso lengths, when both joints have full confidence
const CORE_THICKNESS: f64 = 0.10;

/// Distance of the crown beyond the neck along the trunk, in torso lengths
const CROWN_REACH: f64 = 0.50;

/// Confidence, radius and margin of the line from neck to crown
const CROWN: (f64, f64, f64) = (0.8, 0.22, 0.14);

/// Reach of the hand beyond the wrist, in forearm lengths
const HAND_REACH: f64 = 0.42;

/// Confidence, radius and margin of the line from wrist to finger tips; fists and bags have other directions
const HAND: (f64, f64, f64) = (0.15, 0.13, 0.12);

/// Reach of a foot without toe keypoints below the ankle, in torso lengths
const FOOT_REACH: f64 = 0.12;

/// Confidence, radius and margin of such a foot
const FOOT: (f64, f64, f64) = (0.15, 0.12, 0.12);

/// The torso as a share of the stature
const TORSO_PER_STATURE: f64 = 0.30;

/// Lengths of bones in torso lengths, to estimate a torso that was not found; foreshortening makes a bone appear
/// shorter, never longer
const LENGTHS: [(Joint, Joint, f64); 10] = [
    (Joint::RightHip, Joint::RightKnee, 0.80),
    (Joint::LeftHip, Joint::LeftKnee, 0.80),
    (Joint::RightKnee, Joint::RightAnkle, 0.80),
    (Joint::LeftKnee, Joint::LeftAnkle, 0.80),
    (Joint::RightShoulder, Joint::RightElbow, 0.57),
    (Joint::LeftShoulder, Joint::LeftElbow, 0.57),
    (Joint::RightElbow, Joint::RightWrist, 0.50),
    (Joint::LeftElbow, Joint::LeftWrist, 0.50),
    (Joint::RightShoulder, Joint::RightHip, 1.0),
    (Joint::LeftShoulder, Joint::LeftHip, 1.0),
];

/// A line of seeds, in px
#[derive(Debug, Clone, Copy)]
pub(super) struct SeedLine {
    pub(super) from: DVec2,
    pub(super) to: DVec2,
    /// Radius of sure person
    pub(super) core_radius: f64,
    /// Radius of probable person
    pub(super) person_radius: f64,
    /// Radius of probable background
    pub(super) reach: f64,
}

/// The skeleton of one view as lines of seeds
#[derive(Debug)]
pub(super) struct SeedLines {
    pub(super) lines: Vec<SeedLine>,
    /// Neck to mid hip, in px
    pub(super) torso_px: f64,
}

impl SeedLines {
    /// Creates the lines of the bones whose two joints were found, with hands, crown and feet extrapolated
    ///
    /// # Errors
    /// When too few joints were found to locate the person.
    pub(super) fn new(keypoints: &Keypoints) -> Result<Self, SegmentError> {
        let found = with_middles(keypoints);
        let torso = torso_length(&found).ok_or(SegmentError::NoSkeleton {
            found: keypoints.found_count(),
        })?;
        let joint = |joint: Joint| found.found(joint);
        let mut lines = Vec::with_capacity(SEED_BONES.len() + 5);
        let mut push = |from: DVec2, to: DVec2, (confidence, radius, margin): (f64, f64, f64)| {
            lines.push(SeedLine {
                from,
                to,
                core_radius: 0.5 * CORE_THICKNESS * torso * confidence.min(1.0),
                person_radius: radius * torso,
                reach: (radius + margin) * torso,
            });
        };
        for bone in &SEED_BONES {
            if let (Some(from), Some(to)) = (joint(bone.from), joint(bone.to)) {
                let confidence = from.confidence * to.confidence;
                let widths = (confidence, bone.person_radius, bone.background_margin);
                push(from.position, to.position, widths);
            }
        }
        if let Some(neck) = joint(Joint::Neck) {
            let up = match joint(Joint::MidHip) {
                Some(hip) => (neck.position - hip.position).try_normalize(),
                None => None,
            };
            let crown = neck.position + up.unwrap_or(-DVec2::Y) * CROWN_REACH * torso;
            push(neck.position, crown, CROWN);
        }
        for (elbow, wrist) in [
            (Joint::RightElbow, Joint::RightWrist),
            (Joint::LeftElbow, Joint::LeftWrist),
        ] {
            if let (Some(elbow), Some(wrist)) = (joint(elbow), joint(wrist)) {
                let tips = wrist.position + HAND_REACH * (wrist.position - elbow.position);
                push(wrist.position, tips, HAND);
            }
        }
        for (knee, ankle, toe) in [
            (Joint::RightKnee, Joint::RightAnkle, Joint::RightBigToe),
            (Joint::LeftKnee, Joint::LeftAnkle, Joint::LeftBigToe),
        ] {
            if let (Some(ankle), None) = (joint(ankle), joint(toe)) {
                let down = joint(knee)
                    .and_then(|knee| (ankle.position - knee.position).try_normalize())
                    .unwrap_or(DVec2::Y);
                let sole = ankle.position + down * FOOT_REACH * torso;
                push(ankle.position, sole, FOOT);
            }
        }
        if lines.is_empty() {
            return Err(SegmentError::NoSkeleton {
                found: keypoints.found_count(),
            });
        }
        Ok(Self {
            lines,
            torso_px: torso,
        })
    }

    /// Returns the height of the person in px over the nominal one, from the torso
    pub(super) fn scale(&self) -> f64 {
        self.torso_px / TORSO_PER_STATURE / NOMINAL_STATURE_PX
    }

    /// Computes the seeds of a photo: the surest class of any line
    pub(super) fn seeds(&self, width: usize, height: usize) -> Grid<Seed> {
        let mut seeds = Grid::filled(width, height, Seed::Background);
        for line in &self.lines {
            line.draw(&mut seeds);
        }
        seeds
    }
}

impl SeedLine {
    fn draw(&self, seeds: &mut Grid<Seed>) {
        self.for_each_pixel(
            seeds.width(),
            seeds.height(),
            self.reach.max(self.core_radius),
            |x, y, distance| {
                // a certain bone is never thinner than a pixel
                let seed = if distance <= self.core_radius.max(0.5) {
                    Seed::Person
                } else if distance <= self.person_radius {
                    Seed::ProbablePerson
                } else {
                    Seed::ProbableBackground
                };
                let old = &mut seeds[(x, y)];
                if seed as u8 > *old as u8 {
                    *old = seed;
                }
            },
        );
    }

    /// Calls `visit` with column, row and distance from the line for every pixel within `reach`
    pub(super) fn for_each_pixel(
        &self,
        width: usize,
        height: usize,
        reach: f64,
        mut visit: impl FnMut(usize, usize, f64),
    ) {
        let low = self.from.min(self.to) - reach;
        let high = self.from.max(self.to) + reach;
        // casts of floats saturate, so far-off joints give empty ranges
        let columns =
            (low.x.floor().max(0.0) as usize)..((high.x.ceil().max(0.0)) as usize).min(width);
        let rows =
            (low.y.floor().max(0.0) as usize)..((high.y.ceil().max(0.0)) as usize).min(height);
        let along = self.to - self.from;
        let length_squared = along.length_squared();
        for y in rows {
            for x in columns.clone() {
                let offset = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - self.from;
                let share = if length_squared > 0.0 {
                    (offset.dot(along) / length_squared).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                let distance = (offset - share * along).length();
                if distance <= reach {
                    visit(x, y, distance);
                }
            }
        }
    }
}

/// Interpolates a missing neck or mid hip between shoulders or hips, and drops non-finite coordinates
fn with_middles(keypoints: &Keypoints) -> Keypoints {
    let mut found = *keypoints;
    for joint in Joint::ALL {
        let keypoint = found.get(joint);
        if !keypoint.position.is_finite() || !keypoint.confidence.is_finite() {
            found.set(joint, Default::default());
        }
    }
    for joint in Joint::MIDDLES {
        let sides = joint.middle_of().map(|sides| sides.map(|j| found.found(j)));
        if let (None, Some([Some(left), Some(right)])) = (found.found(joint), sides) {
            let keypoint = pirouette_body::Keypoint {
                position: 0.5 * (left.position + right.position),
                confidence: left.confidence.min(right.confidence),
            };
            found.set(joint, keypoint);
        }
    }
    found
}

/// Returns the length from neck to mid hip in px, or the estimate from the longest-looking other bone
fn torso_length(found: &Keypoints) -> Option<f64> {
    let length = |a: Joint, b: Joint| {
        let (a, b) = (found.found(a)?, found.found(b)?);
        Some((a.position - b.position).length())
    };
    let torso = length(Joint::Neck, Joint::MidHip);
    let others = LENGTHS
        .iter()
        .filter_map(|&(a, b, share)| Some(length(a, b)? / share))
        .fold(0.0, f64::max);
    // less than 1 px is a point, not a person
    torso
        .filter(|&torso| torso > 0.4 * others)
        .or(Some(others))
        .filter(|&torso| torso >= 1.0)
}
