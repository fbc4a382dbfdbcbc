//! Poses in which the body is written.

use glam::{DQuat, DVec3};
use pirouette::body::{Avatar, Bone, Pose, ReferencePose};
use pirouette::pipeline::Report;

/// Pose of the body in `body.*`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum BodyPose {
    /// Arms as those of the reference avatar, elbows bent forward; trunk and legs as in the photos, on average
    #[default]
    Reference,
    /// As in the photo that is nearest to the front view
    Photographed,
    /// Arms straight, 48 degrees below the horizontal
    A,
    /// Arms straight and level
    T,
}

impl BodyPose {
    /// Returns a body in this pose, standing on the floor; `None` if that is the pose it has
    ///
    /// [`BodyPose::Photographed`] requires the fitted poses of the `report`.
    pub(super) fn of(self, body: &Avatar, report: &Report) -> Option<Avatar> {
        let pose = match self {
            BodyPose::Reference => return None,
            BodyPose::Photographed => {
                let fitted = report.views.iter().filter_map(|view| {
                    let turn = view.skeleton?.turn;
                    Some((turn.wrapped().radians().cos(), view.fit?.pose))
                });
                fitted.max_by(|(a, _), (b, _)| a.total_cmp(b))?.1
            }
            BodyPose::A => straight_arms(body, ReferencePose::A),
            BodyPose::T => straight_arms(body, ReferencePose::T),
        };
        let posed = body.reposed(&pose);
        let low = posed.mesh.bounds()?.0.y;
        Some(posed.shifted(DVec3::new(0.0, -low, 0.0)))
    }
}

/// Returns the pose that stretches the arms in the frontal plane, at the angle of a reference pose
fn straight_arms(body: &Avatar, pose: ReferencePose) -> Pose {
    let down = pose.arm_angle_degrees().to_radians();
    let mut straight = Pose::default();
    for (upper, lower, hand, side) in [
        (Bone::LeftUpperArm, Bone::LeftForearm, Bone::LeftHand, 1.0),
        (
            Bone::RightUpperArm,
            Bone::RightForearm,
            Bone::RightHand,
            -1.0,
        ),
    ] {
        let heads = &body.bone_heads;
        let direction = |from: Bone, to: Bone| (heads[to] - heads[from]).try_normalize();
        let wanted = DVec3::new(side * down.cos(), -down.sin(), 0.0);
        if let (Some(arm), Some(forearm)) = (direction(upper, lower), direction(lower, hand)) {
            let turn = |from: DVec3, to: DVec3| DQuat::from_rotation_arc(from, to).to_scaled_axis();
            straight.rotations[lower] = turn(forearm, arm);
            straight.rotations[upper] = turn(arm, wanted);
        }
    }
    straight
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette::body::mannequin::{MannequinParameters, mannequin};

    #[test]
    fn arms_are_straight_at_the_angle_of_the_pose() {
        let body = mannequin(&MannequinParameters::default()).expect("an average mannequin");
        for pose in [ReferencePose::A, ReferencePose::T] {
            let heads = body.reposed(&straight_arms(&body, pose)).bone_heads;
            let down = pose.arm_angle_degrees().to_radians();
            let expected = DVec3::new(down.cos(), -down.sin(), 0.0);
            let upper = heads[Bone::LeftForearm] - heads[Bone::LeftUpperArm];
            let lower = heads[Bone::LeftHand] - heads[Bone::LeftForearm];
            for direction in [upper, lower] {
                assert!((direction.normalize_or_zero() - expected).length() < 1e-9);
            }
            let right = heads[Bone::RightHand] - heads[Bone::RightUpperArm];
            let mirrored = DVec3::new(-expected.x, expected.y, 0.0);
            assert!((right.normalize_or_zero() - mirrored).length() < 1e-9);
        }
    }
}
