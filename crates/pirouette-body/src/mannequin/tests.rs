use std::collections::{HashMap, HashSet};
use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::*;
use crate::Bone;

fn person(sex: Sex, stature_mm: f64, bmi: f64, pose: ReferencePose) -> Avatar {
    let parameters = MannequinParameters {
        sex,
        stature_mm: Some(stature_mm),
        mass_kg: Some(bmi * (stature_mm / 1000.0).powi(2)),
        pose,
        arm_angle_degrees: None,
    };
    mannequin(&parameters).unwrap()
}

/// Asserts that every directed edge occurs once, and its opposite once
fn assert_closed(mesh: &TriMesh) {
    let mut edges: HashSet<(u32, u32)> = HashSet::new();
    let directed = || {
        let triangles = mesh.triangles.iter();
        triangles.flat_map(|t| (0..3).map(|k| (t[k], t[(k + 1) % 3])))
    };
    for edge in directed() {
        assert!(edges.insert(edge), "edge {edge:?} twice");
    }
    for (a, b) in directed() {
        assert!(edges.contains(&(b, a)), "open edge {a} {b}");
    }
    assert!(mesh.positions.iter().all(|p| p.is_finite()));
    assert!(mesh.volume() > 0.0);
}

fn assert_valid(avatar: &Avatar, stature_mm: f64) {
    assert_closed(&avatar.mesh);
    let (lo, hi) = avatar.mesh.bounds().unwrap();
    assert!(lo.y.abs() < 1.0, "soles at {}", lo.y);
    assert!((hi.y - stature_mm).abs() < 1.0);
    assert!((lo.x + hi.x).abs() < 1e-9);
    assert_eq!(avatar.weights.len(), avatar.mesh.positions.len());
    for weight in &avatar.weights {
        let sum: f64 = weight.iter().map(|(_, w)| w).sum();
        assert!((sum - 1.0).abs() < 1e-9);
    }
}

#[test]
fn hips_are_in_front_of_the_turning_axis_as_in_imported_avatars() {
    for (sex, stature_mm) in [(Sex::Female, 1500.0), (Sex::Male, 1950.0)] {
        let avatar = person(sex, stature_mm, 24.0, ReferencePose::T);
        let head = |bone: Bone| avatar.bone_heads[bone];
        let hips = (head(Bone::LeftThigh) + head(Bone::RightThigh)) / 2.0;
        let expected = crate::TURNING_AXIS_BEHIND_HIPS * stature_mm;
        assert!((hips.z - expected).abs() < 0.1, "{hips}");
        assert!(hips.x.abs() < 1e-9, "{hips}");
        assert!(head(Bone::LeftFoot).z > hips.z);
    }
}

/// Perimeter of the hull of the points where a plane cuts triangles whose strongest bones are among those given
fn girth(avatar: &Avatar, origin: DVec3, normal: DVec3, bones: &[Bone]) -> f64 {
    let (u, v) = normal.any_orthonormal_pair();
    let mut cut: Vec<DVec2> = Vec::new();
    for triangle in &avatar.mesh.triangles {
        let strongest = avatar.weights[triangle[0] as usize].strongest();
        if !bones.contains(&strongest) {
            continue;
        }
        let corners = triangle.map(|v| avatar.mesh.positions[v as usize] - origin);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let (da, db) = (a.dot(normal), b.dot(normal));
            if (da < 0.0) != (db < 0.0) {
                let p = a.lerp(b, da / (da - db));
                cut.push(DVec2::new(p.dot(u), p.dot(v)));
            }
        }
    }
    assert!(cut.len() > 8);
    // Cauchy: the perimeter of a convex hull is the mean support over all directions, times the full turn.
    const DIRECTIONS: usize = 360;
    let support = |n: usize| {
        let d = DVec2::from_angle(n as f64 * TAU / DIRECTIONS as f64);
        cut.iter().map(|p| p.dot(d)).fold(f64::MIN, f64::max)
    };
    (0..DIRECTIONS).map(support).sum::<f64>() * TAU / DIRECTIONS as f64
}

fn assert_girths_follow_the_survey(sex: Sex, bmi: f64) {
    let stature_mm = sex.mean_stature_mm();
    let mass_kg = bmi * (stature_mm / 1000.0).powi(2);
    let avatar = person(sex, stature_mm, bmi, ReferencePose::A);
    let d = Proportions::regressed(sex, stature_mm, mass_kg);
    let head = |bone: Bone| avatar.bone_heads[bone];
    let trunk = [Bone::Root, Bone::LowerSpine, Bone::UpperSpine];
    let hips = [
        Bone::Root,
        Bone::LowerSpine,
        Bone::LeftThigh,
        Bone::RightThigh,
    ];
    let leg = [Bone::LeftThigh, Bone::LeftShin];
    let level = |y: f64| DVec3::new(0.0, y, 0.0);
    let permille_mm = stature_mm / 1000.0;
    let arm = head(Bone::LeftForearm) - head(Bone::LeftUpperArm);
    let forearm = head(Bone::LeftHand) - head(Bone::LeftForearm);
    let middle = |a: Bone, b: Bone, t: f64| head(a).lerp(head(b), t);
    for (name, expected, measured) in [
        (
            "waist",
            d.waist_girth,
            girth(&avatar, level(d.waist_height), DVec3::Y, &trunk),
        ),
        (
            "hip",
            d.hip_girth,
            girth(&avatar, level(d.buttock_height), DVec3::Y, &hips),
        ),
        (
            "calf",
            d.calf_girth,
            girth(&avatar, level(0.77 * d.knee_height), DVec3::Y, &leg),
        ),
        (
            "knee",
            d.lower_thigh_girth,
            girth(
                &avatar,
                level(d.knee_height + 22.0 * permille_mm),
                DVec3::Y,
                &leg,
            ),
        ),
        (
            "ankle",
            d.ankle_girth,
            girth(&avatar, level(78.0 * permille_mm), DVec3::Y, &leg),
        ),
        (
            "upper arm",
            d.upper_arm_girth(),
            girth(
                &avatar,
                middle(Bone::LeftUpperArm, Bone::LeftForearm, 0.5),
                arm.normalize_or(DVec3::X),
                &[Bone::LeftUpperArm],
            ),
        ),
        (
            "wrist",
            d.wrist_girth,
            girth(
                &avatar,
                middle(Bone::LeftForearm, Bone::LeftHand, 0.97),
                forearm.normalize_or(DVec3::X),
                &[Bone::LeftForearm, Bone::LeftHand],
            ),
        ),
    ] {
        let error = measured / expected - 1.0;
        assert!(
            error.abs() < 0.012,
            "{sex:?} {bmi}: {name} {measured:.0}, expected {expected:.0}"
        );
    }
    let volume = avatar.mesh.volume() / 1e6;
    assert!(
        (volume / mass_kg - 1.0).abs() < 0.06,
        "{sex:?} {bmi}: {volume:.1} l at {mass_kg:.1} kg"
    );
}

#[test]
fn the_neutral_body_is_closed_symmetric_and_has_the_requested_stature() {
    let avatar = person(Sex::Neutral, 1700.0, 22.0, ReferencePose::A);
    assert_valid(&avatar, 1700.0);
    let key = |p: DVec3| p.to_array().map(f64::to_bits);
    let points: HashMap<_, _> = avatar
        .mesh
        .positions
        .iter()
        .zip(&avatar.weights)
        .map(|(&p, w)| (key(p), w))
        .collect();
    for (p, weight) in avatar.mesh.positions.iter().zip(&avatar.weights) {
        if p.x != 0.0 {
            let mirrored = points[&key(DVec3::new(-p.x, p.y, p.z))];
            for bone in Bone::ALL {
                assert!((weight.of(bone) - mirrored.of(bone.mirrored())).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn girths_and_volume_follow_the_survey_for_women() {
    assert_girths_follow_the_survey(Sex::Female, 18.5);
    assert_girths_follow_the_survey(Sex::Female, 32.0);
}

#[test]
fn girths_and_volume_follow_the_survey_for_men() {
    assert_girths_follow_the_survey(Sex::Male, 22.0);
    assert_girths_follow_the_survey(Sex::Male, 40.0);
}

#[test]
fn the_arms_of_the_t_pose_are_level() {
    let avatar = person(Sex::Neutral, 1700.0, 22.0, ReferencePose::T);
    assert_valid(&avatar, 1700.0);
    let [shoulder, elbow, wrist] =
        [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist].map(|j| avatar.keypoints[j]);
    assert!((shoulder.y - elbow.y).abs() < 1e-6 && (wrist.y - elbow.y).abs() < 1e-6);
    let (lo, hi) = avatar.mesh.bounds().unwrap();
    assert!(hi.x - lo.x > 1300.0);
}

#[test]
fn extreme_bodies_are_valid() {
    for (sex, stature_mm, bmi) in [
        (Sex::Male, 1300.0, 15.0),
        (Sex::Female, 2150.0, 45.0),
        (Sex::Neutral, 700.0, 16.0),
    ] {
        assert_valid(&person(sex, stature_mm, bmi, ReferencePose::A), stature_mm);
    }
}

#[test]
fn impossible_parameters_are_rejected() {
    let with = |stature_mm: f64, mass_kg: Option<f64>, arm_angle_degrees: Option<f64>| {
        mannequin(&MannequinParameters {
            stature_mm: Some(stature_mm),
            mass_kg,
            arm_angle_degrees,
            ..Default::default()
        })
    };
    for stature_mm in [0.0, f64::NAN, -1700.0, f64::INFINITY] {
        assert!(matches!(
            with(stature_mm, None, None),
            Err(MannequinError::Stature { .. })
        ));
    }
    for mass_kg in [0.0, f64::NAN, 1e6] {
        assert!(matches!(
            with(1700.0, Some(mass_kg), None),
            Err(MannequinError::Mass { .. })
        ));
    }
    assert!(matches!(
        with(1700.0, None, Some(f64::NAN)),
        Err(MannequinError::ArmAngle { .. })
    ));
}

#[test]
fn joints_are_at_anatomical_positions() {
    let avatar = person(Sex::Neutral, 1700.0, 22.0, ReferencePose::A);
    let at = |joint: Joint| avatar.keypoints[joint];
    assert!((at(Joint::MidHip) - at(Joint::LeftHip).midpoint(at(Joint::RightHip))).length() < 1e-9);
    assert!(
        (at(Joint::Neck) - at(Joint::LeftShoulder).midpoint(at(Joint::RightShoulder))).length()
            < 1e-9
    );
    assert!(at(Joint::LeftShoulder).x > 0.0 && at(Joint::RightShoulder).x < 0.0);
    // Nose in front of the eyes in front of the ears; toes in front of the heels.
    assert!(
        at(Joint::Nose).z > at(Joint::LeftEye).z && at(Joint::LeftEye).z > at(Joint::LeftEar).z
    );
    assert!(at(Joint::LeftBigToe).z > at(Joint::LeftHeel).z + 180.0);
    assert!(at(Joint::LeftBigToe).x < at(Joint::LeftSmallToe).x);
}

#[test]
fn a_coarse_mannequin_is_the_same_body_with_fewer_vertices() {
    for (sex, mass_kg) in [(Sex::Female, 50.0), (Sex::Male, 110.0)] {
        let parameters = MannequinParameters {
            sex,
            mass_kg: Some(mass_kg),
            ..MannequinParameters::default()
        };
        let (full, coarse_mannequin) = (
            mannequin(&parameters).unwrap(),
            coarse_mannequin(&parameters).unwrap(),
        );
        coarse_mannequin.mesh.check().unwrap();
        assert!(2 * coarse_mannequin.mesh.positions.len() < full.mesh.positions.len());
        let volumes = [full.mesh.volume(), coarse_mannequin.mesh.volume()];
        assert!((volumes[1] / volumes[0] - 1.0).abs() < 0.01, "{volumes:?}");
        for (a, b) in full.bone_heads.iter().zip(coarse_mannequin.bone_heads) {
            assert!(a.distance(b) < 3.0);
        }
    }
}
