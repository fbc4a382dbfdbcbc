//! Moves the arms of a body into the reference pose.

use glam::{DQuat, DVec3};

use crate::{Avatar, Bone, Pose, ReferencePose, TurnAngle};

/// Arms within this angle of the requested pose are left unchanged
///
/// Bending a shoulder by a few degrees with skinning distorts the shape more than such an angle matters.
const TOLERANCE_DEGREES: f64 = 8.0;

/// Share of an arm's lift that the clavicle contributes, so that the shoulder rises with the arm
///
/// Lifting arms by the shoulder joint alone leaves a notch above it.
const CLAVICLE_LIFT_SHARE: f64 = 0.2;

/// Lifts the upper arms to the pose's angle and bends the elbows to its bend, where the difference exceeds the
/// tolerance
///
/// Keypoints are not changed.
pub(crate) fn pose_arms(avatar: &mut Avatar, pose: ReferencePose) {
    lift_arms(avatar, pose.arm_angle_degrees());
    bend_elbows(avatar, pose.elbow_bend_degrees());
    if let Some((low, _)) = avatar.mesh.bounds() {
        let lift = DVec3::Y * -low.y;
        avatar.mesh.positions.iter_mut().for_each(|p| *p += lift);
        avatar.bone_heads.iter_mut().for_each(|p| *p += lift);
    }
}

fn lift_arms(avatar: &mut Avatar, angle_degrees: f64) {
    let mut pose = Pose::default();
    for (clavicle, upper_arm, forearm, outward) in [
        (
            Bone::LeftClavicle,
            Bone::LeftUpperArm,
            Bone::LeftForearm,
            1.0,
        ),
        (
            Bone::RightClavicle,
            Bone::RightUpperArm,
            Bone::RightForearm,
            -1.0,
        ),
    ] {
        let arm = head(avatar, forearm) - head(avatar, upper_arm);
        let angle = (-arm.y).atan2(arm.x * outward).to_degrees();
        let lift = angle - angle_degrees;
        if lift.abs() > TOLERANCE_DEGREES {
            let rotation = DVec3::Z * (lift.to_radians() * outward);
            pose.rotations[clavicle] = rotation * CLAVICLE_LIFT_SHARE;
            pose.rotations[upper_arm] = rotation * (1.0 - CLAVICLE_LIFT_SHARE);
        }
    }
    apply(avatar, &pose);
}

fn bend_elbows(avatar: &mut Avatar, bend_degrees: f64) {
    let mut pose = Pose::default();
    for (upper_arm, forearm, hand) in [
        (Bone::LeftUpperArm, Bone::LeftForearm, Bone::LeftHand),
        (Bone::RightUpperArm, Bone::RightForearm, Bone::RightHand),
    ] {
        let arm = head(avatar, forearm) - head(avatar, upper_arm);
        let frontal = DVec3::new(arm.x, arm.y, 0.0).try_normalize();
        let along = (head(avatar, hand) - head(avatar, forearm)).try_normalize();
        let (Some(frontal), Some(along)) = (frontal, along) else {
            continue;
        };
        let bend = along.z.clamp(-1.0, 1.0).asin().to_degrees();
        if (bend - bend_degrees).abs() > TOLERANCE_DEGREES {
            let (sin, cos) = bend_degrees.to_radians().sin_cos();
            let wanted = frontal * cos + DVec3::Z * sin;
            let turn = DQuat::from_rotation_arc(along, wanted);
            pose.rotations[forearm] = turn.to_scaled_axis();
        }
    }
    apply(avatar, &pose);
}

fn head(avatar: &Avatar, bone: Bone) -> DVec3 {
    avatar.bone_heads[bone]
}

fn apply(avatar: &mut Avatar, pose: &Pose) {
    if *pose == Pose::default() {
        return;
    }
    let posed = avatar.posed(pose, TurnAngle::default());
    avatar.mesh.positions = posed.positions;
    avatar.bone_heads = posed.bones.heads();
}
