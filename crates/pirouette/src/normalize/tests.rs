use super::*;
use align::tests::standing;
use deform::tests::capsule;
use pirouette_body::{Bone, Joint, Keypoint, PerBone, PerJoint};
use pirouette_geom::coverage::fill_polygons;

type Joints = PerJoint<DVec2>;

/// A figure of rounded bones around the joints
fn draw(joints: &Joints) -> Grid<f32> {
    use Joint::*;
    const PARTS: [(Joint, Joint, f64); 12] = [
        (Neck, MidHip, 38.0),
        (Neck, Nose, 20.0),
        (RightShoulder, RightElbow, 11.0),
        (RightElbow, RightWrist, 9.0),
        (LeftShoulder, LeftElbow, 11.0),
        (LeftElbow, LeftWrist, 9.0),
        (RightHip, RightKnee, 16.0),
        (RightKnee, RightAnkle, 11.0),
        (LeftHip, LeftKnee, 16.0),
        (LeftKnee, LeftAnkle, 11.0),
        (RightAnkle, RightBigToe, 9.0),
        (LeftAnkle, LeftBigToe, 9.0),
    ];
    let at = |joint: Joint| joints[joint];
    let parts: Vec<Vec<DVec2>> = PARTS
        .iter()
        .map(|&(a, b, radius)| capsule(at(a), at(b), radius))
        .collect();
    fill_polygons(400, 480, &parts)
}

fn keypoints(joints: &Joints) -> Keypoints {
    Keypoints::new(joints.map(|position| Keypoint {
        position,
        confidence: 0.9,
    }))
}

fn reference() -> ReferenceView {
    ReferenceView {
        coverage: draw(&standing()),
        joints: standing(),
        visible: Some(PerBone::splat(true)),
    }
}

/// Rotates the joints attached to a joint
fn bend(joints: &mut Joints, about: Joint, moved: &[Joint], degrees: f64) {
    let pivot = joints[about];
    let turn = DVec2::from_angle(degrees.to_radians());
    for &joint in moved {
        let p = &mut joints[joint];
        *p = pivot + turn.rotate(*p - pivot);
    }
}

fn swayed() -> Joints {
    use Joint::*;
    let mut joints = standing();
    bend(&mut joints, LeftShoulder, &[LeftElbow, LeftWrist], 14.0);
    bend(&mut joints, RightElbow, &[RightWrist], -16.0);
    let foot = [LeftAnkle, LeftBigToe, LeftSmallToe, LeftHeel];
    bend(&mut joints, LeftHip, &[LeftKnee], -4.0);
    bend(&mut joints, LeftHip, &foot, -4.0);
    let chest = DVec2::new(200.0, 175.0);
    joints.map(|p| chest + DVec2::from_angle(0.04).rotate(p - chest) + DVec2::new(5.0, 0.0))
}

fn normalized(joints: &Joints, options: &NormalizeOptions) -> NormalizedView {
    let soft = draw(joints);
    let mask = soft.threshold(0.5);
    let reference = reference();
    let view = NormalizeView {
        mask: &mask,
        soft: &Windowed::new(&soft),
        keypoints: &keypoints(joints),
        skeleton: Some(&SkeletonJoints {
            photo: *joints,
            reference: standing(),
        }),
        outline: None,
        reference: &reference,
    };
    normalize(&view, options).unwrap()
}

#[test]
fn both_methods_move_a_swayed_figure_to_the_reference_pose() {
    let before = draw(&swayed()).threshold(0.5);
    let raw = before.iou(&reference().coverage.threshold(0.5));
    assert!(raw < 0.85);
    let shared = normalized(&swayed(), &NormalizeOptions::shared_skeleton());
    assert!(shared.reference_iou > 0.97, "{}", shared.reference_iou);
    assert!(shared.warnings.is_empty() && shared.registration.is_none());
    assert_eq!(shared.joints.refined, shared.joints.aligned);
    let published = normalized(&swayed(), &NormalizeOptions::three_step());
    assert!(
        published.reference_iou > 0.97,
        "{}",
        published.reference_iou
    );
    assert!(published.registration.is_some() && !published.limbs.is_empty());
}

#[test]
fn registration_and_refinement_can_be_switched_independently() {
    let all = NormalizeOptions::three_step();
    let aligned = NormalizeOptions {
        register: None,
        refine: None,
        ..all
    };
    let registered = NormalizeOptions {
        refine: None,
        ..all
    };
    let refined = NormalizeOptions {
        register: None,
        ..all
    };
    let [aligned, registered, refined] =
        [aligned, registered, refined].map(|options| normalized(&swayed(), &options));
    assert_eq!(aligned.joints.registered, aligned.joints.aligned);
    assert!(registered.reference_iou > aligned.reference_iou);
    assert_eq!(registered.joints.refined, registered.joints.registered);
    assert_eq!(refined.joints.registered, refined.joints.aligned);
    assert!(refined.registration.is_none() && !refined.limbs.is_empty());
}

#[test]
fn a_figure_in_the_reference_pose_is_unchanged() {
    for options in [
        NormalizeOptions::shared_skeleton(),
        NormalizeOptions::three_step(),
    ] {
        let view = normalized(&standing(), &options);
        assert!(view.reference_iou > 0.995, "{}", view.reference_iou);
    }
}

#[test]
fn hidden_bones_carry_no_handles_in_the_published_method() {
    let soft = draw(&swayed());
    let mask = soft.threshold(0.5);
    let mut reference = reference();
    let mut visible = PerBone::splat(true);
    for bone in [Bone::LeftUpperArm, Bone::LeftForearm] {
        visible[bone] = false;
    }
    reference.visible = Some(visible);
    let view = NormalizeView {
        mask: &mask,
        soft: &Windowed::new(&soft),
        keypoints: &keypoints(&swayed()),
        skeleton: None,
        outline: None,
        reference: &reference,
    };
    let options = NormalizeOptions {
        register: None,
        refine: None,
        ..NormalizeOptions::three_step()
    };
    let hidden = normalize(&view, &options).unwrap();
    let seen = normalized(&swayed(), &options);
    assert!(hidden.reference_iou < seen.reference_iou - 0.005);
    let missing = normalize(&view, &NormalizeOptions::shared_skeleton());
    assert_eq!(missing.err(), Some(NormalizeError::NoSkeleton));
}

#[test]
fn a_view_without_keypoints_keeps_its_pose_with_a_warning() {
    let soft = draw(&standing());
    let mask = soft.threshold(0.5);
    let reference = reference();
    let view = NormalizeView {
        mask: &mask,
        soft: &Windowed::new(&soft),
        keypoints: &Keypoints::default(),
        skeleton: None,
        outline: None,
        reference: &reference,
    };
    let kept = normalize(&view, &NormalizeOptions::three_step()).unwrap();
    assert_eq!(kept.warnings, [NormalizeWarning::NoHandles]);
    assert!(kept.mask.iou(&mask) > 0.99);
}

#[test]
fn non_finite_input_is_rejected() {
    let reference = reference();
    let empty = Mask::filled(400, 480, false);
    let soft = empty.map(|_| f32::NAN);
    let poisoned = Keypoints::new(PerJoint::splat(Keypoint {
        position: DVec2::NAN,
        confidence: 1.0,
    }));
    let view = NormalizeView {
        mask: &empty,
        soft: &Windowed::new(&soft),
        keypoints: &poisoned,
        skeleton: None,
        outline: None,
        reference: &reference,
    };
    let made = normalize(&view, &NormalizeOptions::three_step());
    assert_eq!(made.err(), Some(NormalizeError::Deform(DeformError::Empty)));
    let small = Mask::filled(3, 2, true);
    let made = normalize(
        &NormalizeView {
            mask: &small,
            ..view
        },
        &NormalizeOptions::three_step(),
    );
    assert!(matches!(made, Err(NormalizeError::SizeMismatch { .. })));
    let soft = draw(&standing());
    let kept = normalize(
        &NormalizeView {
            mask: &soft.threshold(0.5),
            soft: &Windowed::new(&soft),
            ..view
        },
        &NormalizeOptions::three_step(),
    );
    assert_eq!(kept.unwrap().warnings, [NormalizeWarning::NoHandles]);
}
