//! Assigns points of a contour to bones.

use glam::DVec2;

use super::JointPositions;
use super::refine::Limb;
use pirouette_body::Joint;

/// Reach of the hand beyond the wrist, in lengths of the forearm
///
/// A stretched hand has about 0.75 of the length from elbow to wrist; relaxed fingers are slightly bent.
const HAND_LENGTH: f64 = 0.7;

/// A part of a limb
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Upper,
    Lower,
    /// Hand or foot, attached to the lower bone
    End,
}

/// A bone as a candidate for contour points
struct Segment {
    head: DVec2,
    tip: DVec2,
    owner: Option<(Limb, Part)>,
}

impl Segment {
    /// Returns the distance of a point, and the position of the nearest point along the segment, 0 to 1
    fn distance(&self, point: DVec2) -> (f64, f64) {
        let along = self.tip - self.head;
        let length_squared = along.length_squared().max(f64::MIN_POSITIVE);
        let t = ((point - self.head).dot(along) / length_squared).clamp(0.0, 1.0);
        (point.distance(self.head + t * along), t)
    }
}

/// The bone nearest to a point
#[derive(Debug, Clone, Copy)]
pub(super) struct NearestBone {
    /// Distance, in px
    pub(super) distance: f64,
    /// Position along the bone, 0 to 1
    pub(super) along: f64,
    /// The limb it belongs to and its part there, none for the trunk and the head
    pub(super) owner: Option<(Limb, Part)>,
}

/// All bones of a skeleton with known joints; the trunk also along its sides
pub(super) struct Bones {
    segments: Vec<Segment>,
}

impl Bones {
    pub(super) fn new(joints: &JointPositions) -> Self {
        use Joint::*;
        const TRUNK: [(Joint, Joint); 11] = [
            (Neck, MidHip),
            (Neck, LeftShoulder),
            (Neck, RightShoulder),
            (MidHip, LeftHip),
            (MidHip, RightHip),
            // The sides: without them, the flanks would be nearer to the arms than to the spine
            (LeftShoulder, LeftHip),
            (RightShoulder, RightHip),
            (Neck, Nose),
            (Nose, LeftEar),
            (Nose, RightEar),
            (LeftEar, RightEar),
        ];
        let at = |joint: Joint| joints[joint].filter(|p| p.is_finite());
        let mut segments: Vec<Segment> = TRUNK
            .iter()
            .filter_map(|&(head, tip)| {
                Some(Segment {
                    head: at(head)?,
                    tip: at(tip)?,
                    owner: None,
                })
            })
            .collect();
        for limb in Limb::ALL {
            let [root, middle, end] = limb.joints().map(at);
            let mut add = |head: Option<DVec2>, tip: Option<DVec2>, part: Part| {
                if let (Some(head), Some(tip)) = (head, tip) {
                    let owner = Some((limb, part));
                    segments.push(Segment { head, tip, owner });
                }
            };
            add(root, middle, Part::Upper);
            add(middle, end, Part::Lower);
            for &joint in limb.carried() {
                add(end, at(joint), Part::End);
            }
            if let (Limb::LeftArm | Limb::RightArm, Some(middle), Some(end)) = (limb, middle, end) {
                add(
                    Some(end),
                    Some(end + HAND_LENGTH * (end - middle)),
                    Part::End,
                );
            }
        }
        Self { segments }
    }

    /// `None` without any known bone, and for a point that is not finite
    pub(super) fn nearest(&self, point: DVec2) -> Option<NearestBone> {
        self.segments
            .iter()
            .map(|segment| {
                let (distance, along) = segment.distance(point);
                NearestBone {
                    distance,
                    along,
                    owner: segment.owner,
                }
            })
            .min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    /// Returns whether a point belongs to an arm or a hand
    pub(super) fn is_of_arm(&self, point: DVec2) -> bool {
        let owner = self.nearest(point).and_then(|bone| bone.owner);
        matches!(owner, Some((Limb::LeftArm | Limb::RightArm, _)))
    }
}
