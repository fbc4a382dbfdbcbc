//! Faults of the statements in the manifest: photos and keypoints are unchanged.

use pirouette::scan::Scan;
use pirouette_body::{ReferencePose, TurnAngle};

use super::{Fault, Group, Held, Setting, Strength};

/// Kilograms of a pound, inverted
const POUNDS_PER_KG: f64 = 2.204_622_6;

pub(super) const FAULTS: [Fault; 10] = [
    Fault::new(
        Group::Statements,
        "stature too small",
        ["30 mm", "60 mm", "100 mm"],
        stature,
    ),
    Fault::new(
        Group::Statements,
        "field of view, 50° is true",
        ["40°", "78°", "28°"],
        field_of_view,
    ),
    Fault::new(
        Group::Statements,
        "distance",
        ["by 0.9", "by 0.75", "by 0.5"],
        distance,
    ),
    Fault::new(
        Group::Statements,
        "camera height too large",
        ["200 mm", "400 mm", "700 mm"],
        camera_height,
    ),
    Fault::new(
        Group::Statements,
        "pitch of a level camera",
        ["3°", "6°", "12°"],
        pitch,
    ),
    Fault::new(
        Group::Statements,
        "mass",
        ["by 0.8", "by 1.3", "pounds"],
        mass,
    ),
    Fault::of_poses(
        Group::Statements,
        "pose",
        [
            "A stated, T held",
            "T stated, A held",
            "T stated, arms at 20°",
        ],
        [Held::T, Held::A, Held::Between],
        pose,
    ),
    Fault::new(
        Group::Statements,
        "angle step",
        ["0.9 of the step", "2/3", "twice the step"],
        angle_step,
    ),
    Fault::new(
        Group::Statements,
        "angles of neighbors exchanged",
        ["1 pair", "2 pairs", "all pairs"],
        exchanged,
    ),
    Fault::new(
        Group::Statements,
        "random errors of the angles",
        ["5°", "10°", "20°"],
        angle_errors,
    ),
];

fn stature(scan: &mut Scan, _: &Setting, strength: Strength) {
    let less_mm = strength.pick([30.0, 60.0, 100.0]);
    scan.stature_mm = scan.stature_mm.map(|stature_mm| stature_mm - less_mm);
}

fn field_of_view(scan: &mut Scan, _: &Setting, strength: Strength) {
    let degrees = strength.pick([40_f64, 78.0, 28.0]);
    scan.camera.vertical_fov_radians = Some(degrees.to_radians());
}

fn distance(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let factor = strength.pick([0.9, 0.75, 0.5]);
    scan.camera.distance_mm = Some(factor * setting.camera.distance_mm);
}

fn camera_height(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let more_mm = strength.pick([200.0, 400.0, 700.0]);
    scan.camera.height_mm = Some(setting.camera.height_mm + more_mm);
}

fn pitch(scan: &mut Scan, _: &Setting, strength: Strength) {
    scan.camera.pitch_radians = Some(strength.pick([3_f64, 6.0, 12.0]).to_radians());
}

fn mass(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let factor = strength.pick([0.8, 1.3, POUNDS_PER_KG]);
    scan.subject.mass_kg = Some(factor * setting.mass_kg);
}

fn pose(scan: &mut Scan, _: &Setting, strength: Strength) {
    scan.pose = strength.pick([ReferencePose::A, ReferencePose::T, ReferencePose::T]);
}

fn angle_step(scan: &mut Scan, _: &Setting, strength: Strength) {
    // 40, 30 and 90 degrees instead of 45
    let factor = strength.pick([8.0 / 9.0, 2.0 / 3.0, 2.0]);
    for view in &mut scan.views {
        view.turn = TurnAngle::from_degrees(view.turn.degrees() * factor);
    }
}

fn exchanged(scan: &mut Scan, _: &Setting, strength: Strength) {
    let count = scan.views.len();
    let pairs: Vec<usize> = match strength {
        Strength::Weak => vec![1],
        Strength::Medium => vec![1, 1 + count / 2],
        Strength::Strong => (0..count).step_by(2).collect(),
    };
    for first in pairs {
        if first + 1 < count {
            let turn = scan.views[first].turn;
            scan.views[first].turn = scan.views[first + 1].turn;
            scan.views[first + 1].turn = turn;
        }
    }
}

fn angle_errors(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let sigma = strength.pick([5.0, 10.0, 20.0]);
    let random = &mut setting.random();
    for view in &mut scan.views {
        view.turn = TurnAngle::from_degrees(view.turn.degrees() + sigma * random.normal());
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::setting_of;
    use super::*;
    use pirouette_synthetic::people::turning_woman;

    fn angles(scan: &Scan) -> Vec<i32> {
        let degrees = scan.views.iter().map(|view| view.turn.degrees());
        degrees.map(|degrees| degrees.round() as i32).collect()
    }

    #[test]
    fn a_step_of_40_degrees_leaves_80_degrees_without_views() {
        let woman = turning_woman(8);
        let mut scan = woman.scan.clone();
        angle_step(&mut scan, &setting_of(&woman), Strength::Weak);
        assert_eq!(angles(&scan), [0, 40, 80, 120, 160, 200, 240, 280]);
    }

    #[test]
    fn pairs_of_angles_are_exchanged() {
        let woman = turning_woman(8);
        let exchange = |strength| {
            let mut scan = woman.scan.clone();
            exchanged(&mut scan, &setting_of(&woman), strength);
            angles(&scan)
        };
        let one = exchange(Strength::Weak);
        assert_eq!(one, [0, 90, 45, 135, 180, 225, 270, 315]);
        let two = exchange(Strength::Medium);
        assert_eq!(two, [0, 90, 45, 135, 180, 270, 225, 315]);
        let all = exchange(Strength::Strong);
        assert_eq!(all, [45, 0, 135, 90, 225, 180, 315, 270]);
    }

    #[test]
    fn statements_change_no_photo_and_no_keypoint() {
        let woman = turning_woman(4);
        for fault in FAULTS {
            let mut scan = woman.scan.clone();
            (fault.apply)(&mut scan, &setting_of(&woman), Strength::Strong);
            for (changed, given) in scan.views.iter().zip(&woman.scan.views) {
                assert_eq!(changed.photo, given.photo);
                assert_eq!(changed.keypoints, given.keypoints);
            }
        }
    }

    #[test]
    fn a_mass_in_pounds_is_2_2_times_too_large() {
        let woman = turning_woman(3);
        let mut scan = woman.scan.clone();
        let setting = Setting {
            mass_kg: 70.0,
            ..setting_of(&woman)
        };
        mass(&mut scan, &setting, Strength::Strong);
        assert_eq!(scan.subject.mass_kg.map(f64::round), Some(154.0));
    }
}
