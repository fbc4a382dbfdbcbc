//! Faults of the keypoints: the photos are unchanged.

use glam::DVec2;
use pirouette::scan::Scan;
use pirouette::skeleton_fit::SwapGroup;
use pirouette_body::{Joint, Keypoint};

use super::change::move_keypoints;
use super::{Fault, Group, Setting, Strength, some_views};

pub(super) const FAULTS: [Fault; 9] = [
    Fault::new(
        Group::Keypoints,
        "of resized photos",
        ["by 0.95", "by 0.8", "by 0.5"],
        scaled,
    ),
    Fault::new(
        Group::Keypoints,
        "shifted sideways",
        ["12 px", "30 px", "60 px"],
        shifted_sideways,
    ),
    Fault::new(
        Group::Keypoints,
        "shifted down",
        ["10 px", "25 px", "50 px"],
        shifted_down,
    ),
    Fault::new(
        Group::Keypoints,
        "of the next view",
        ["1 view", "half", "all"],
        of_next_view,
    ),
    Fault::new(
        Group::Keypoints,
        "in reversed order",
        ["3 views", "half", "all"],
        reversed,
    ),
    Fault::new(
        Group::Keypoints,
        "mirrored",
        ["1 view", "half", "all"],
        mirrored,
    ),
    Fault::new(
        Group::Keypoints,
        "left and right swapped",
        ["1 view", "half", "all"],
        swapped,
    ),
    Fault::new(
        Group::Keypoints,
        "additional noise",
        ["6 px", "12 px", "25 px"],
        noisy,
    ),
    Fault::new(
        Group::Keypoints,
        "(0, 0) at confidence 1",
        ["1 joint", "3 joints", "6 joints"],
        at_corner,
    ),
];

fn scaled(scan: &mut Scan, _: &Setting, strength: Strength) {
    let scale = strength.pick([0.95, 0.8, 0.5]);
    for view in &mut scan.views {
        move_keypoints(view, |at| at * scale);
    }
}

fn shifted_sideways(scan: &mut Scan, _: &Setting, strength: Strength) {
    let shift = DVec2::X * strength.pick([12.0, 30.0, 60.0]);
    for view in &mut scan.views {
        move_keypoints(view, |at| at + shift);
    }
}

fn shifted_down(scan: &mut Scan, _: &Setting, strength: Strength) {
    let shift = DVec2::Y * strength.pick([10.0, 25.0, 50.0]);
    for view in &mut scan.views {
        move_keypoints(view, |at| at + shift);
    }
}

fn of_next_view(scan: &mut Scan, _: &Setting, strength: Strength) {
    let given: Vec<_> = scan.views.iter().map(|view| view.keypoints).collect();
    for index in some_views(given.len(), strength) {
        scan.views[index].keypoints = given[(index + 1) % given.len()];
    }
}

/// Reverses the order from the second view on: the first view is the start of both directions
fn reversed(scan: &mut Scan, _: &Setting, strength: Strength) {
    let count = scan.views.len();
    let last = strength.pick([3, 1 + count / 2, count - 1]).min(count - 1);
    let given: Vec<_> = scan.views.iter().map(|view| view.keypoints).collect();
    for index in 1..=last {
        scan.views[index].keypoints = given[last + 1 - index];
    }
}

fn mirrored(scan: &mut Scan, _: &Setting, strength: Strength) {
    for index in some_views(scan.views.len(), strength) {
        let view = &mut scan.views[index];
        let width = view.photo.width() as f64;
        move_keypoints(view, |at| DVec2::new(width - at.x, at.y));
    }
}

fn swapped(scan: &mut Scan, _: &Setting, strength: Strength) {
    for index in some_views(scan.views.len(), strength) {
        SwapGroup::Body.swap(&mut scan.views[index].keypoints);
    }
}

fn noisy(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let sigma = strength.pick([6.0, 12.0, 25.0]);
    let random = &mut setting.random();
    for view in &mut scan.views {
        move_keypoints(view, |at| {
            at + DVec2::new(random.normal(), random.normal()) * sigma
        });
    }
}

fn at_corner(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let count = strength.pick([1, 3, 6]);
    let random = &mut setting.random();
    let corner = Keypoint {
        position: DVec2::ZERO,
        confidence: 1.0,
    };
    for view in &mut scan.views {
        let mut joints = Joint::ALL.to_vec();
        for _ in 0..count {
            let at = (random.uniform() * joints.len() as f64) as usize;
            view.keypoints.set(joints.swap_remove(at), corner);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::setting_of;
    use super::*;
    use pirouette_synthetic::people::turning_woman;

    #[test]
    fn a_shift_moves_keypoints_but_no_pixels() {
        let woman = turning_woman(4);
        let mut scan = woman.scan.clone();
        shifted_sideways(&mut scan, &setting_of(&woman), Strength::Medium);
        for (shifted, given) in scan.views.iter().zip(&woman.scan.views) {
            assert_eq!(shifted.photo, given.photo);
            let at = |view: &pirouette::scan::View| view.keypoints.get(Joint::Nose).position;
            assert_eq!(at(shifted), at(given) + DVec2::new(30.0, 0.0));
        }
    }

    #[test]
    fn swapped_twice_and_reversed_twice_are_the_identity() {
        let woman = turning_woman(8);
        for fault in [swapped, reversed, mirrored] {
            for strength in Strength::ALL {
                let mut scan = woman.scan.clone();
                let keypoints = |scan: &Scan| -> Vec<Vec<DVec2>> {
                    let of = |view: &pirouette::scan::View| {
                        view.keypoints
                            .iter()
                            .map(|(_, k)| k.position.round())
                            .collect()
                    };
                    scan.views.iter().map(of).collect()
                };
                let given = keypoints(&scan);
                fault(&mut scan, &setting_of(&woman), strength);
                assert_ne!(keypoints(&scan), given);
                fault(&mut scan, &setting_of(&woman), strength);
                assert_eq!(keypoints(&scan), given);
            }
        }
    }

    #[test]
    fn all_keypoints_of_the_next_view_are_those_of_its_photo() {
        let woman = turning_woman(4);
        let mut scan = woman.scan.clone();
        of_next_view(&mut scan, &setting_of(&woman), Strength::Strong);
        for (index, next) in [(0, 1), (1, 2), (2, 3), (3, 0)] {
            assert_eq!(
                scan.views[index].keypoints,
                woman.scan.views[next].keypoints
            );
        }
    }

    #[test]
    fn three_joints_of_each_view_are_at_the_corner() {
        let woman = turning_woman(3);
        let mut scan = woman.scan.clone();
        at_corner(&mut scan, &setting_of(&woman), Strength::Medium);
        for view in &scan.views {
            let corners = view
                .keypoints
                .iter()
                .filter(|(_, k)| k.position == DVec2::ZERO && k.confidence > 0.9);
            assert_eq!(corners.count(), 3);
        }
    }
}
