//! Faults of the capture: wrong or too few photos, people who are cut off, and bad photos.

use pirouette::scan::{Scan, View};
use pirouette_body::Joint;
use pirouette_files::formats::photo::shrink;
use pirouette_synthetic::Random;

use super::change::{Edges, blur, crop, move_keypoints};
use super::{Fault, Group, Setting, Strength};

pub(super) const FAULTS: [Fault; 10] = [
    Fault::new(
        Group::Captures,
        "photos repeated",
        ["1 photo", "2 photos", "half"],
        repeated,
    ),
    Fault::new(
        Group::Captures,
        "half a turn only",
        ["5 views", "4 views", "3 views"],
        half_turn,
    ),
    Fault::new(
        Group::Captures,
        "two people mixed",
        ["1 view", "2 views", "half"],
        two_people,
    ),
    Fault::new(
        Group::Captures,
        "feet cut off",
        ["toes", "ankles", "knees"],
        feet_cut,
    ),
    Fault::new(
        Group::Captures,
        "head cut off",
        ["crown", "eyes", "chin"],
        head_cut,
    ),
    Fault::new(
        Group::Captures,
        "hands cut off",
        ["fingers", "wrists", "half of the forearms"],
        hands_cut,
    ),
    Fault::new(
        Group::Captures,
        "blurred",
        ["2 px", "5 px", "10 px"],
        blurred,
    ),
    Fault::new(
        Group::Captures,
        "dark",
        ["0.3 of the levels", "0.15", "0.06"],
        dark,
    ),
    Fault::new(
        Group::Captures,
        "small photos",
        ["by 0.5", "by 0.3", "by 0.15"],
        small,
    ),
    Fault::new(
        Group::Captures,
        "noisy photos",
        ["15 levels", "30 levels", "60 levels"],
        noisy,
    ),
];

/// Standard deviation of the noise of dark photos, in gray levels
const DARK_NOISE: f64 = 3.0;

/// Shares of the height of the person that lie below the toes' tips and above the crown, the eyes and the chin
const TOES: f64 = 0.015;
const HEAD: [f64; 3] = [0.02, 0.07, 0.13];

fn repeated(scan: &mut Scan, _: &Setting, strength: Strength) {
    let count = scan.views.len();
    let repeats: Vec<usize> = match strength {
        Strength::Weak => vec![2],
        Strength::Medium => vec![2, 2 + count / 2],
        Strength::Strong => (1..count).step_by(2).collect(),
    };
    for index in repeats.into_iter().filter(|&index| index < count) {
        let first = scan.views[index - 1].clone();
        replace(&mut scan.views[index], first);
    }
}

/// Replaces what a view shows; its name and angle remain
fn replace(view: &mut View, by: View) {
    let (name, turn) = (std::mem::take(&mut view.name), view.turn);
    *view = View { name, turn, ..by };
}

fn half_turn(scan: &mut Scan, _: &Setting, strength: Strength) {
    let half = scan.views.len() / 2 + 1;
    let left = half.saturating_sub(strength.pick([0, 1, 2])).max(1);
    scan.views.truncate(left);
}

fn two_people(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let others = setting.other.iter();
    for (index, other) in others.take(strength.pick([1, 2, usize::MAX])) {
        if let Some(view) = scan.views.get_mut(*index) {
            replace(view, other.clone());
        }
    }
}

fn feet_cut(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let [_, sole] = setting.rows();
    let row = match strength {
        Strength::Weak => sole as f64 - TOES * setting.person_px(),
        Strength::Medium => mean_position(scan, [Joint::LeftAnkle, Joint::RightAnkle]).1,
        Strength::Strong => mean_position(scan, [Joint::LeftKnee, Joint::RightKnee]).1,
    };
    let height = scan.views.first().map_or(0, |view| view.photo.height());
    let edges = Edges {
        bottom: height.saturating_sub(row.max(0.0) as usize),
        ..Edges::default()
    };
    crop(scan, edges);
}

fn head_cut(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let row = setting.head_row() as f64 + strength.pick(HEAD) * setting.person_px();
    let edges = Edges {
        top: row as usize,
        ..Edges::default()
    };
    crop(scan, edges);
}

/// Cuts equal margins off both sides
fn hands_cut(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let Some(front) = scan.views.first() else {
        return;
    };
    let at = |joint| front.keypoints.get(joint).position.x;
    // The person's right hand is at the left edge of the photo.
    let (wrist, elbow) = (at(Joint::RightWrist), at(Joint::RightElbow));
    let silhouette = setting.silhouettes.first();
    let bounds = silhouette.and_then(|silhouette| silhouette.bounding_box());
    let tip = bounds.map_or(wrist, |(left, ..)| left as f64);
    let column = strength.pick([(tip + wrist) / 2.0, wrist, (wrist + elbow) / 2.0]);
    let margin = column.max(0.0) as usize;
    crop(
        scan,
        Edges {
            left: margin,
            right: margin,
            ..Edges::default()
        },
    );
}

/// Returns the mean position of two joints over all views
fn mean_position(scan: &Scan, joints: [Joint; 2]) -> (f64, f64) {
    let count = (2 * scan.views.len()).max(1) as f64;
    let positions = scan
        .views
        .iter()
        .flat_map(|view| joints.map(|joint| view.keypoints.get(joint).position));
    let sum: glam::DVec2 = positions.sum();
    (sum.x / count, sum.y / count)
}

fn blurred(scan: &mut Scan, _: &Setting, strength: Strength) {
    let sigma_px = strength.pick([2.0, 5.0, 10.0]);
    for view in &mut scan.views {
        view.photo = blur(&view.photo, sigma_px);
    }
}

fn dark(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let share = strength.pick([0.3, 0.15, 0.06]);
    with_noise(scan, share, DARK_NOISE, &mut setting.random());
}

fn noisy(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let sigma = strength.pick([15.0, 30.0, 60.0]);
    with_noise(scan, 1.0, sigma, &mut setting.random());
}

fn with_noise(scan: &mut Scan, share: f64, sigma: f64, random: &mut Random) {
    for view in &mut scan.views {
        view.photo = view.photo.map(|color| {
            color.map(|level| {
                let level = share * f64::from(level) + sigma * random.normal();
                level.round().clamp(0.0, 255.0) as u8
            })
        });
    }
}

fn small(scan: &mut Scan, _: &Setting, strength: Strength) {
    let scale = strength.pick([0.5, 0.3, 0.15]);
    for view in &mut scan.views {
        let (width, height) = (view.photo.width(), view.photo.height());
        let side = (width.max(height) as f64 * scale).round() as usize;
        view.photo = shrink(view.photo.clone(), side);
        view.input_size_px = (view.photo.width(), view.photo.height());
        let shrunk = glam::DVec2::new(
            view.photo.width() as f64 / width as f64,
            view.photo.height() as f64 / height as f64,
        );
        move_keypoints(view, |at| at * shrunk);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::setting_of;
    use super::*;
    use pirouette_synthetic::people::turning_woman;

    fn faulty(fault: fn(&mut Scan, &Setting, Strength), strength: Strength) -> Scan {
        let woman = turning_woman(8);
        let mut scan = woman.scan.clone();
        fault(&mut scan, &setting_of(&woman), strength);
        scan
    }

    #[test]
    fn repeated_photos_keep_their_angles() {
        let scan = faulty(repeated, Strength::Strong);
        for pair in scan.views.chunks(2) {
            assert_eq!(pair[0].photo, pair[1].photo);
            assert_eq!(pair[0].keypoints, pair[1].keypoints);
            assert_ne!(pair[0].turn, pair[1].turn);
            assert_ne!(pair[0].name, pair[1].name);
        }
    }

    #[test]
    fn half_a_turn_has_five_four_or_three_of_eight_views() {
        let counts = Strength::ALL.map(|strength| faulty(half_turn, strength).views.len());
        assert_eq!(counts, [5, 4, 3]);
    }

    #[test]
    fn more_of_the_legs_is_cut_off_by_strength() {
        let joints = [Joint::LeftBigToe, Joint::LeftAnkle, Joint::LeftKnee];
        let found = Strength::ALL.map(|strength| {
            let scan = faulty(feet_cut, strength);
            joints.map(|joint| scan.views[0].keypoints.found(joint).is_some())
        });
        assert!(found[0][1] && found[0][2] && found[1][2]);
        assert!(!found[1][0] && !found[2][0] && !found[2][1]);
    }

    #[test]
    fn a_head_cut_off_at_the_chin_has_no_eyes_but_shoulders() {
        let keypoints = faulty(head_cut, Strength::Strong).views[0].keypoints;
        assert_eq!(keypoints.found(Joint::LeftEye), None);
        assert!(keypoints.found(Joint::LeftShoulder).is_some());
    }

    #[test]
    fn hands_cut_off_at_the_forearms_leave_elbows() {
        let keypoints = faulty(hands_cut, Strength::Strong).views[0].keypoints;
        assert_eq!(keypoints.found(Joint::LeftWrist), None);
        assert!(keypoints.found(Joint::LeftElbow).is_some());
    }

    #[test]
    fn small_photos_move_their_keypoints() {
        let woman = turning_woman(8);
        let scan = faulty(small, Strength::Weak);
        let (small, given) = (&scan.views[3], &woman.scan.views[3]);
        assert_eq!((small.photo.width(), small.photo.height()), (100, 125));
        let at = |view: &View| view.keypoints.get(Joint::Nose).position;
        assert_eq!(at(small), at(given) / 2.0);
    }

    #[test]
    fn dark_photos_have_small_levels() {
        let scan = faulty(dark, Strength::Strong);
        let brightest = scan.views[0].photo.as_slice().iter().flatten().max();
        assert!(brightest.is_some_and(|&level| level < 40), "{brightest:?}");
    }
}
