//! Skinning weights from the geometry of the implicit body.

use glam::DVec3;

use super::field::{FAR, Field, Region, Sides, ramp};
use super::frame::Frame;
use crate::{Bone, PerBone, SkinWeight};

/// Membership of a point in a part rather than another, by its distances to both
///
/// The ramp extends `width` mm to either side of where both are equally far.
fn membership(distance: f64, other_distance: f64, width: f64) -> f64 {
    if distance >= FAR {
        return 0.0;
    }
    ramp(other_distance - distance, -width, width)
}

/// Computes the weight of a vertex; the right side mirrors the left
pub(super) fn skin_weight(
    field: &Field,
    frame: &Frame,
    heads: &PerBone<DVec3>,
    vertex: DVec3,
) -> SkinWeight {
    let p = DVec3::new(vertex.x.abs(), vertex.y, vertex.z);
    let left = left_weights(field, frame, heads, p);
    let mut all = PerBone::splat(0.0);
    for bone in Bone::ALL {
        let mirrored = bone.mirrored();
        let target = if vertex.x < 0.0 { mirrored } else { bone };
        all[target] += left[bone];
    }
    SkinWeight::from_all(&all)
}

fn left_weights(field: &Field, frame: &Frame, heads: &PerBone<DVec3>, p: DVec3) -> PerBone<f64> {
    let m = frame.permille_mm;
    let distance = |regions: &[Region]| field.value_of(p, |r| regions.contains(&r), Sides::Left);
    let trunk = distance(&[Region::Trunk]);
    // Body part: the nearer one, with a ramp about as wide as the limb is thick.
    let arm = membership(distance(&[Region::Arm, Region::Hand]), trunk, 22.0 * m);
    let leg = membership(distance(&[Region::Leg, Region::Foot]), trunk, 30.0 * m);
    let head_distance = distance(&[Region::Head]);
    let neck_distance = distance(&[Region::Neck]);
    let above = trunk.min(neck_distance);
    let head = membership(head_distance, above, 6.0 * m);
    let neck = ramp(
        p.y - 0.35 * (p.z - frame.plumb_z),
        frame.nape.y - 30.0 * m,
        frame.nape.y + 22.0 * m,
    );

    let mut w = PerBone::splat(0.0);
    let mut rest = 1.0;
    let mut give = |bone: Bone, share: f64, rest: &mut f64| {
        w[bone] += share * *rest;
        *rest -= share * *rest;
    };

    // Arm: hand, forearm, upper arm.
    let mut arm_rest = arm * rest;
    rest -= arm_rest;
    let along = |joint: DVec3, before: DVec3, after: DVec3| {
        (p - joint).dot((before + after).normalize_or(after))
    };
    let upper = frame.upper_arm_axes.y_axis;
    let fore = frame.forearm_axes.y_axis;
    give(
        Bone::LeftHand,
        ramp(along(frame.wrist, fore, fore), -14.0 * m, 14.0 * m),
        &mut arm_rest,
    );
    give(
        Bone::LeftForearm,
        ramp(along(frame.elbow, upper, fore), -20.0 * m, 20.0 * m),
        &mut arm_rest,
    );
    give(Bone::LeftUpperArm, 1.0, &mut arm_rest);

    // Leg: foot, shin, thigh; between the legs both sides contribute.
    let mut leg_rest = leg * rest;
    rest -= leg_rest;
    let own = 0.5 + 0.5 * ramp(p.x, 0.0, 22.0 * m);
    let ankle = frame.ankle.y - p.y + 0.4 * (p.z - frame.ankle.z);
    let down = frame.leg_axes.y_axis;
    let knee = (p - frame.knee).dot(down);
    for (bone, share) in [
        (Bone::LeftFoot, ramp(ankle, -22.0 * m, 14.0 * m)),
        (Bone::LeftShin, ramp(knee, -32.0 * m, 32.0 * m)),
        (Bone::LeftThigh, 1.0),
    ] {
        let mut given = leg_rest * share;
        leg_rest -= given;
        let other = given * (1.0 - own);
        given -= other;
        give(bone, 1.0, &mut given);
        let mut other = other;
        give(bone.mirrored(), 1.0, &mut other);
    }

    // Head, neck and shoulders, then the spine by height.
    give(Bone::Head, head, &mut rest);
    give(Bone::Neck, neck, &mut rest);
    let shoulder = frame.shoulder;
    let clavicle = ramp(p.x, 0.2 * shoulder.x, 0.85 * shoulder.x)
        * ramp(p.y, shoulder.y - 60.0 * m, shoulder.y + 5.0 * m);
    give(Bone::LeftClavicle, clavicle, &mut rest);
    let upper_spine = heads[Bone::UpperSpine].y;
    let lower_spine = heads[Bone::LowerSpine].y;
    give(
        Bone::UpperSpine,
        ramp(p.y, upper_spine - 50.0 * m, upper_spine + 50.0 * m),
        &mut rest,
    );
    give(
        Bone::LowerSpine,
        ramp(p.y, lower_spine - 35.0 * m, lower_spine + 35.0 * m),
        &mut rest,
    );
    give(Bone::Root, 1.0, &mut rest);
    w
}
