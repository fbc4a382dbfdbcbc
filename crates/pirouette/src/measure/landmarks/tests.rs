use std::sync::LazyLock;

use super::*;
use crate::measure::lengths::lifted_share;
use crate::measure::measure_avatar;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{PerBone, Sex};

static WOMAN: LazyLock<Avatar> = LazyLock::new(|| {
    let parameters = MannequinParameters {
        sex: Sex::Female,
        stature_mm: Some(1630.0),
        ..MannequinParameters::default()
    };
    mannequin(&parameters).expect("valid parameters")
});

type Found = (Vec<Section>, Vec<(Landmark, DVec3)>);

fn find_on(avatar: &Avatar) -> Found {
    find_sections(avatar)
}

fn loop_of(found: &Found, girth: Girth) -> &Section {
    let tape = found.0.iter().find(|t| t.girth == girth);
    tape.unwrap_or_else(|| panic!("a section for {girth:?}"))
}

fn center(avatar: &Avatar, tape: &Section) -> DVec3 {
    let points = tape
        .vertices
        .iter()
        .map(|&v| avatar.mesh.positions[v as usize]);
    points.sum::<DVec3>() / tape.vertices.len() as f64
}

fn landmark(found: &Found, landmark: Landmark) -> DVec3 {
    let entry = found.1.iter().find(|(l, _)| *l == landmark);
    let (_, point) = entry.unwrap_or_else(|| panic!("a point for {landmark:?}"));
    *point
}

#[test]
fn level_tapes_agree_with_surveys() {
    let found = find_on(&WOMAN);
    let share = |girth| center(&WOMAN, loop_of(&found, girth)).y / 1630.0;
    // means of women in the ANSUR II survey, and the spread of people around them
    for (girth, mean, spread) in [
        (Girth::Bust, 0.719, 0.014),
        (Girth::Waist, 0.61, 0.012),
        (Girth::Hip, 0.512, 0.010),
        (Girth::LeftThigh, 0.446, 0.012),
        (Girth::LeftKnee, 0.276, 0.012),
        (Girth::RightCalf, 0.21, 0.015),
        (Girth::RightAnkle, 0.07, 0.02),
        (Girth::Neck, 0.86, 0.015),
        (Girth::Head, 0.945, 0.015),
        (Girth::Underbust, 0.68, 0.02),
    ] {
        let found = share(girth);
        assert!((found - mean).abs() < spread, "{girth:?} at {found:.4}");
    }
}

#[test]
fn thighs_that_touch_do_not_move_the_crotch() {
    let crotch = |mass_kg: f64| {
        let parameters = MannequinParameters {
            mass_kg: Some(mass_kg),
            sex: Sex::Female,
            stature_mm: Some(1630.0),
            ..MannequinParameters::default()
        };
        let avatar = mannequin(&parameters).unwrap();
        let found = find_on(&avatar);
        let body = Body::new(&avatar.mesh, &avatar.weights, &avatar.bone_heads).unwrap();
        let hips = body.middle_of(Bone::LeftThigh, Bone::RightThigh);
        let end = levels::parting(&body, hips).unwrap().y;
        (landmark(&found, Landmark::Crotch).y, end)
    };
    let (slim, slim_end) = crotch(50.0);
    let (heavy, heavy_end) = crotch(95.0);
    assert!(slim_end - heavy_end > 60.0, "{slim_end} {heavy_end}");
    assert!((slim - heavy).abs() < 12.0, "{slim} {heavy}");
}

#[test]
fn arm_tapes_are_perpendicular_to_the_bones() {
    let found = find_on(&WOMAN);
    let head = |bone: Bone| WOMAN.bone_heads[bone];
    let sections = find_sections(&WOMAN).0;
    for (girth, from, to, zone) in [
        (
            Girth::LeftUpperArm,
            Bone::LeftUpperArm,
            Bone::LeftForearm,
            [UPPER_ARM_SHARE; 2],
        ),
        (
            Girth::RightWrist,
            Bone::RightForearm,
            Bone::RightHand,
            WRIST_ZONE,
        ),
    ] {
        let tape = loop_of(&found, girth);
        let axis = head(to) - head(from);
        let section = sections.iter().find(|s| s.girth == girth);
        let plane = section.expect("a section").plane;
        let share = (plane.origin - head(from)).dot(axis) / axis.length_squared();
        assert!((zone[0] - 1e-9..=zone[1] + 1e-9).contains(&share));
        assert!(plane.normal.cross(axis).length() < 1e-6 * axis.length());
        for &v in &tape.vertices {
            let p = WOMAN.mesh.positions[v as usize] - head(from);
            let along = p.dot(axis) / axis.length_squared();
            assert!((along - share).abs() < 0.06, "{girth:?} {along}");
        }
    }
}

#[test]
fn loops_run_around_once_without_arms() {
    let found = find_on(&WOMAN);
    assert_eq!(found.0.len(), 29);
    for tape in &found.0 {
        let middle = center(&WOMAN, tape);
        let points: Vec<DVec3> = tape
            .vertices
            .iter()
            .map(|&v| WOMAN.mesh.positions[v as usize] - middle)
            .collect();
        let spokes = points.iter().zip(points.iter().cycle().skip(1));
        let area: DVec3 = spokes.clone().map(|(&a, &b)| a.cross(b)).sum();
        let normal = area / area.length();
        let swept: f64 = spokes
            .map(|(&a, &b)| {
                let (a, b) = (a - normal * a.dot(normal), b - normal * b.dot(normal));
                normal.dot(a.cross(b)).atan2(a.dot(b))
            })
            .sum();
        let turns = swept / std::f64::consts::TAU;
        assert!((turns - 1.0).abs() < 1e-6, "{:?} {turns}", tape.girth);
        let reach = points.iter().map(|p| p.length()).fold(0.0, f64::max);
        assert!(reach < 260.0, "{:?} reaches {reach:.0} mm", tape.girth);
    }
}

#[test]
fn landmarks_lie_on_their_sides() {
    let found = find_on(&WOMAN);
    let at = |name| landmark(&found, name);
    assert_eq!(found.1.len(), 16);
    assert!((at(Landmark::Crown).y - 1630.0).abs() < 1e-6);
    assert!(at(Landmark::Nape).z < 0.0 && at(Landmark::Nape).x.abs() < 15.0);
    assert!((at(Landmark::Nape).y / 1630.0 - 0.857).abs() < 0.012);
    assert!(at(Landmark::Seat).z < at(Landmark::WaistBack).z);
    assert!(at(Landmark::WaistFront).z > 0.0 && at(Landmark::WaistBack).z < 0.0);
    assert!((at(Landmark::Crotch).y / 1630.0 - 0.48).abs() < 0.015);
    assert!((at(Landmark::LeftAcromion).y / 1630.0 - 0.82).abs() < 0.015);
    for (left, right) in [
        (Landmark::LeftBustPoint, Landmark::RightBustPoint),
        (Landmark::LeftAcromion, Landmark::RightAcromion),
        (Landmark::LeftWrist, Landmark::RightWrist),
        (Landmark::LeftSideNeck, Landmark::RightSideNeck),
        (Landmark::LeftWaistFront, Landmark::RightWaistFront),
    ] {
        let (left, right) = (at(left), at(right));
        assert!(left.x > 40.0 && right.x < -40.0);
        let mirrored = DVec3::new(-right.x, right.y, right.z);
        assert!(left.distance(mirrored) < 8.0, "{left} {right}");
    }
}

#[test]
fn a_larger_copy_has_the_same_loops() {
    let larger = WOMAN.clone().scaled_to(2000.0);
    let (found, expected) = (find_on(&larger), find_on(&WOMAN));
    for tape in &found.0 {
        let same = loop_of(&expected, tape.girth);
        let (y, expected_y) = (center(&larger, tape).y, center(&WOMAN, same).y);
        assert!(
            (y / 2000.0 - expected_y / 1630.0).abs() < 0.002,
            "{:?}",
            tape.girth
        );
    }
}

#[test]
fn a_growing_second_crest_moves_the_bust_without_a_jump() {
    let man = mannequin(&MannequinParameters {
        sex: Sex::Male,
        stature_mm: Some(1750.0),
        ..MannequinParameters::default()
    });
    let man = man.unwrap();
    let bust = |avatar: &Avatar| {
        let (sections, _) = find_sections(avatar);
        let bust = sections.iter().find(|s| s.girth == Girth::Bust);
        bust.expect("a bust").plane.origin.y
    };
    let plain = bust(&man);
    // a level ridge across the chest, 30 mm below the plain bust
    let levels: Vec<f64> = (0..20)
        .map(|step| {
            let mut ridged = man.clone();
            for p in &mut ridged.mesh.positions {
                let beside = (p.y - (plain - 30.0)) / 15.0;
                if p.z > 0.0 {
                    p.z += f64::from(step) * (-beside * beside).exp();
                }
            }
            bust(&ridged)
        })
        .collect();
    for pair in levels.windows(2) {
        assert!((pair[1] - pair[0]).abs() < 8.0, "{levels:?}");
    }
    let moved = plain - levels[19];
    assert!((15.0..35.0).contains(&moved), "{levels:?}");
}

#[test]
fn arms_lowered_from_a_t_pose_have_nearly_the_measures_of_an_a_pose() {
    let parameters = |pose| MannequinParameters {
        sex: Sex::Female,
        stature_mm: Some(1700.0),
        pose,
        ..MannequinParameters::default()
    };
    let measures = |pose| measure_avatar(&mannequin(&parameters(pose)).unwrap());
    let (a, t) = (measures(ReferencePose::A), measures(ReferencePose::T));
    for ((measure, a), (_, t)) in a.iter().zip(&t) {
        let tolerance = 0.035 + lifted_share(*measure);
        assert!(
            (t / a - 1.0).abs() < tolerance,
            "{measure:?}: {a:.1} {t:.1}"
        );
    }
}

#[test]
fn wrists_are_measured_where_they_are_thinnest() {
    let (sections, _) = find_sections(&WOMAN);
    let wrist = sections.iter().find(|s| s.girth == Girth::LeftWrist);
    let wrist = wrist.expect("a wrist");
    let body = Body::new(&WOMAN.mesh, &WOMAN.weights, &WOMAN.bone_heads).unwrap();
    let girth = |by: f64| body.left.arm.girth(wrist.plane.moved(by));
    assert!(girth(0.0) < girth(12.0) && girth(0.0) < girth(-25.0));
}

#[test]
fn the_girth_slope_predicts_the_girth_of_a_misplaced_tape() {
    let (sections, _) = find_sections(&WOMAN);
    let of = |girth| {
        let section = sections.iter().find(|s| s.girth == girth);
        section.expect("a section")
    };
    let thigh = of(Girth::LeftThigh);
    let body = Body::new(&WOMAN.mesh, &WOMAN.weights, &WOMAN.bone_heads).unwrap();
    let girth = |by: f64| body.left.leg.girth(thigh.plane.moved(by));
    let expected = (girth(4.0) - girth(-4.0)).abs() / 8.0;
    assert!((thigh.girth_slope - expected).abs() < 0.2 * expected);
    assert!(of(Girth::LeftCalf).girth_slope < 0.2 * thigh.girth_slope);
}

#[test]
fn level_arms_do_not_reach_the_bust() {
    let parameters = MannequinParameters {
        sex: Sex::Male,
        pose: ReferencePose::T,
        ..MannequinParameters::default()
    };
    let man = mannequin(&parameters).unwrap();
    let found = find_on(&man);
    let bust = loop_of(&found, Girth::Bust);
    let widest = bust
        .vertices
        .iter()
        .map(|&v| man.mesh.positions[v as usize].x.abs());
    assert!(widest.fold(0.0, f64::max) < 240.0);
}

#[test]
fn missing_parts_give_no_loop() {
    let with = |mesh: TriMesh, weights: Vec<SkinWeight>, bone_heads: PerBone<DVec3>| {
        find_sections(&Avatar {
            mesh,
            weights,
            bone_heads,
            ..WOMAN.clone()
        })
    };
    let (tapes, landmarks) = with(TriMesh::default(), Vec::new(), WOMAN.bone_heads);
    assert!(tapes.is_empty() && landmarks.is_empty());
    let lost = PerBone::splat(DVec3::NAN);
    let (tapes, _) = with(WOMAN.mesh.clone(), WOMAN.weights.clone(), lost);
    assert!(tapes.iter().all(|t| t.vertices.len() >= 3));
    let flat = TriMesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        triangles: vec![[0, 1, 2]],
    };
    let weights = vec![SkinWeight::rigid(Bone::Root); 3];
    let (tapes, _) = with(flat, weights, WOMAN.bone_heads);
    assert!(tapes.is_empty());
}
