//! Faults of the camera and of edited photos: pixels and keypoints change consistently, the statements remain.

use glam::{DMat2, DVec2, DVec3};
use pirouette::scan::Scan;

use super::change::{Edges, Warp, crop, pad_below, warp};
use super::{Fault, Group, Setting, Strength};

pub(super) const FAULTS: [Fault; 8] = [
    Fault::new(
        Group::Camera,
        "cropped at one side",
        ["5 %", "12 %", "20 %"],
        cropped_left,
    ),
    Fault::new(
        Group::Camera,
        "padded below",
        ["5 %", "12 %", "25 %"],
        padded,
    ),
    Fault::new(
        Group::Camera,
        "cropped above the head",
        ["0.3 of the margin", "0.6", "0.9"],
        cropped_above,
    ),
    Fault::new(Group::Camera, "rolled", ["2°", "4°", "8°"], rolled),
    Fault::new(
        Group::Camera,
        "barrel distortion",
        ["0.03", "0.08", "0.15"],
        barrel,
    ),
    Fault::new(
        Group::Camera,
        "panned after half of the views",
        ["20 px", "50 px", "100 px"],
        panned,
    ),
    Fault::new(
        Group::Camera,
        "zoomed out after half of the views",
        ["by 0.95", "by 0.88", "by 0.75"],
        zoomed,
    ),
    Fault::new(Group::Camera, "aimed aside", ["2°", "4°", "7°"], yawed),
];

fn cropped_left(scan: &mut Scan, _: &Setting, strength: Strength) {
    let share = strength.pick([0.05, 0.12, 0.2]);
    let left = scan
        .views
        .first()
        .map_or(0.0, |view| share * view.photo.width() as f64);
    crop(
        scan,
        Edges {
            left: left as usize,
            ..Edges::default()
        },
    );
}

fn padded(scan: &mut Scan, _: &Setting, strength: Strength) {
    let share = strength.pick([0.05, 0.12, 0.25]);
    let rows = scan
        .views
        .first()
        .map_or(0.0, |view| share * view.photo.height() as f64);
    pad_below(scan, rows as usize);
}

fn cropped_above(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let share = strength.pick([0.3, 0.6, 0.9]);
    let top = (share * setting.head_row() as f64) as usize;
    crop(
        scan,
        Edges {
            top,
            ..Edges::default()
        },
    );
}

fn rolled(scan: &mut Scan, _: &Setting, strength: Strength) {
    let roll = DMat2::from_angle(strength.pick([2_f64, 4.0, 8.0]).to_radians());
    let back = roll.transpose();
    let rolled = Warp {
        new_from_given: move |at| roll * at,
        given_from_new: move |at| back * at,
    };
    scan.views.iter_mut().for_each(|view| warp(view, &rolled));
}

/// Pulls the corners inward, as wide lenses do: a pixel at radius r, in half heights, comes from r (1 + k r²)
fn barrel(scan: &mut Scan, _: &Setting, strength: Strength) {
    let k = strength.pick([0.03, 0.08, 0.15]);
    for view in &mut scan.views {
        let half = view.photo.height() as f64 / 2.0;
        let barrel = Warp {
            new_from_given: move |at: DVec2| half * distorted(at / half, k),
            given_from_new: move |at: DVec2| at * (1.0 + k * (at / half).length_squared()),
        };
        warp(view, &barrel);
    }
}

/// Solves `given = new (1 + k new²)` for `new`
fn distorted(given: DVec2, k: f64) -> DVec2 {
    (0..40).fold(given, |new, _| given / (1.0 + k * new.length_squared()))
}

fn panned(scan: &mut Scan, _: &Setting, strength: Strength) {
    let shift = DVec2::X * strength.pick([20.0, 50.0, 100.0]);
    let panned = Warp {
        new_from_given: move |at| at + shift,
        given_from_new: move |at| at - shift,
    };
    let half = scan.views.len() / 2;
    let later = scan.views.iter_mut().skip(half);
    later.for_each(|view| warp(view, &panned));
}

fn zoomed(scan: &mut Scan, _: &Setting, strength: Strength) {
    let zoom = strength.pick([0.95, 0.88, 0.75]);
    let zoomed = Warp {
        new_from_given: move |at| at * zoom,
        given_from_new: move |at| at / zoom,
    };
    let half = scan.views.len() / 2;
    let later = scan.views.iter_mut().skip(half);
    later.for_each(|view| warp(view, &zoomed));
}

/// Rotates the camera about the vertical through its center
fn yawed(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let yaw = strength.pick([2_f64, 4.0, 7.0]).to_radians();
    let focal_px = setting.camera.focal_px();
    let turned = Warp {
        new_from_given: move |at| aimed(at, focal_px, yaw),
        given_from_new: move |at| aimed(at, focal_px, -yaw),
    };
    scan.views.iter_mut().for_each(|view| warp(view, &turned));
}

/// Returns where a camera that is turned to the right sees a point, relative to the middle of the photo
fn aimed(at: DVec2, focal_px: f64, yaw: f64) -> DVec2 {
    let ray = DVec3::new(at.x, at.y, focal_px);
    let (sin, cos) = yaw.sin_cos();
    let (x, z) = (ray.x * cos - ray.z * sin, ray.x * sin + ray.z * cos);
    DVec2::new(x, ray.y) * (focal_px / z)
}

#[cfg(test)]
mod tests {
    use super::super::tests::setting_of;
    use super::*;
    use pirouette_body::Joint;
    use pirouette_synthetic::people::turning_woman;

    #[test]
    fn a_camera_that_is_aimed_to_the_right_sees_the_middle_to_the_left() {
        let at = aimed(DVec2::ZERO, 1000.0, 4_f64.to_radians());
        assert!((at.x + 69.9).abs() < 0.1 && at.y == 0.0, "{at}");
        let back = aimed(at, 1000.0, -4_f64.to_radians());
        assert!(back.length() < 1e-9);
    }

    #[test]
    fn distortion_is_the_inverse_of_its_pixel_map() {
        let given = DVec2::new(0.6, -0.9);
        let new = distorted(given, 0.15);
        assert!(new.length() < given.length());
        assert!((new * (1.0 + 0.15 * new.length_squared()) - given).length() < 1e-9);
    }

    #[test]
    fn half_of_the_views_are_panned_with_their_keypoints() {
        let woman = turning_woman(4);
        let mut scan = woman.scan.clone();
        panned(&mut scan, &setting_of(&woman), Strength::Weak);
        let [same, moved] = [1, 3].map(|i| (&scan.views[i], &woman.scan.views[i]));
        assert_eq!(same.0.photo, same.1.photo);
        assert_eq!(moved.0.photo[(60, 30)], moved.1.photo[(40, 30)]);
        let at = |view: &pirouette::scan::View| view.keypoints.get(Joint::Nose).position;
        assert!((at(moved.0) - at(moved.1) - DVec2::new(20.0, 0.0)).length() < 1e-9);
    }

    #[test]
    fn a_crop_above_the_head_leaves_the_head() {
        let woman = turning_woman(3);
        let setting = setting_of(&woman);
        let mut scan = woman.scan.clone();
        cropped_above(&mut scan, &setting, Strength::Strong);
        let cut = woman.scan.views[0].photo.height() - scan.views[0].photo.height();
        assert!(cut > 0 && cut < setting.head_row());
    }
}
