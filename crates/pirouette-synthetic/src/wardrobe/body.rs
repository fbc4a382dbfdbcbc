//! Heights and places of the body by which clothes are cut.

use glam::{DVec2, DVec3};
use pirouette_body::{Avatar, Bone, Joint};

/// Heights and places, in mm, of the naked body in the reference pose
#[derive(Debug, Clone)]
pub(super) struct Marks {
    pub(super) stature_mm: f64,
    /// Lower end of the top, between crotch and hips
    pub(super) top_hem_mm: f64,
    pub(super) waist_mm: f64,
    pub(super) hip_mm: f64,
    pub(super) shoulder_mm: f64,
    pub(super) neck_mm: f64,
    pub(super) ankle_mm: f64,
    /// Lower end of the trousers
    pub(super) trouser_hem_mm: f64,
    knee_mm: f64,
    /// Middle between the eyes
    pub(super) eyes: DVec3,
    /// Least and greatest coordinates of the skull above the eyes
    pub(super) skull: [DVec3; 2],
    /// Position (x, z) of the axis of the trunk
    pub(super) trunk_axis: DVec2,
}

impl Marks {
    pub(super) fn new(avatar: &Avatar) -> Self {
        let at = |joint: Joint| avatar.keypoints[joint];
        let middle = |left: Joint, right: Joint| (at(left) + at(right)) / 2.0;
        let stature_mm = avatar.stature_mm();
        let eyes = middle(Joint::LeftEye, Joint::RightEye);
        let hip = middle(Joint::LeftHip, Joint::RightHip);
        let ankle_mm = middle(Joint::LeftAnkle, Joint::RightAnkle).y;
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut sum, mut count) = (DVec2::ZERO, 0.0);
        let waist_mm = hip.y + 0.1 * stature_mm;
        for (place, weight) in avatar.mesh.positions.iter().zip(&avatar.weights) {
            let bone = weight.strongest();
            if bone == Bone::Head && place.y > eyes.y {
                (low, high) = (low.min(*place), high.max(*place));
            }
            let trunk = matches!(bone, Bone::Root | Bone::LowerSpine | Bone::UpperSpine);
            if trunk && place.y > hip.y {
                (sum, count) = (sum + DVec2::new(place.x, place.z), count + 1.0);
            }
        }
        if !(low.is_finite() && high.is_finite()) {
            let reach = DVec3::splat(0.05 * stature_mm);
            (low, high) = (eyes - reach, eyes + reach);
        }
        Self {
            stature_mm,
            top_hem_mm: hip.y - 0.02 * stature_mm,
            waist_mm,
            hip_mm: hip.y,
            shoulder_mm: middle(Joint::LeftShoulder, Joint::RightShoulder).y,
            neck_mm: avatar.bone_heads[Bone::Neck].y,
            ankle_mm,
            trouser_hem_mm: ankle_mm + 0.022 * stature_mm,
            knee_mm: middle(Joint::LeftKnee, Joint::RightKnee).y,
            eyes,
            skull: [low, high],
            trunk_axis: if count > 0.0 {
                sum / count
            } else {
                DVec2::new(hip.x, hip.z)
            },
        }
    }

    /// Returns the end of the trousers: 1 at the knee, 2 at the ankle
    pub(super) fn trouser_end(&self) -> f64 {
        2.0 - (self.trouser_hem_mm - self.ankle_mm) / (self.knee_mm - self.ankle_mm).max(1.0)
    }

    /// Returns the share of the hair at a point of the head, 0 to 1: above the hairline, and behind the ears
    pub(super) fn hair_share(&self, place: DVec3) -> f64 {
        let up = (place.y - self.eyes.y) / self.stature_mm;
        let ahead = (place.z - self.eyes.z) / self.stature_mm;
        let above = super::smooth_step(0.032, 0.042, up);
        let behind = super::smooth_step(0.05, 0.06, -ahead) * super::smooth_step(-0.045, -0.03, up);
        above.max(behind)
    }

    /// Returns the middle of the skull
    pub(super) fn skull_center(&self) -> DVec3 {
        let [low, high] = self.skull;
        let middle = (low + high) / 2.0;
        DVec3::new(
            middle.x,
            self.eyes.y + 0.25 * (high.y - self.eyes.y),
            middle.z,
        )
    }

    /// Returns half the breadth and half the length of the skull
    pub(super) fn skull_halves(&self) -> DVec2 {
        let size = self.skull[1] - self.skull[0];
        DVec2::new(size.x, size.z) / 2.0
    }
}
