//! Sway: deviations from the reference pose of people who try to stand still.
//!
//! Joints drift independently, but balance is kept: displacements of the center of mass are compensated at the ankles.

use glam::{DQuat, DVec2, DVec3};
use pirouette_geom::TriMesh;

use super::Random;
use pirouette_body::{Avatar, Bone, Pose, PosedAvatar, TurnAngle};

/// Standard deviation of each parameter of people who try to stand still, as a fraction of that of the prior
const SWAY_SHARE: f64 = 0.6;

/// Standard deviation of the center of mass from its position over the feet in the reference pose, along each axis, in
/// mm
///
/// Joints that drift without regard to balance move it by 20 mm, in one of 40 views to less than a tenth of the foot's
/// length from the end of the heel.
const BALANCE_MM: f64 = 10.0;

/// Truncation in standard deviations; beyond it a person no longer stands still
const MOST_DEVIATIONS: f64 = 2.0;

fn deviation(random: &mut Random) -> f64 {
    random.normal().clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS)
}

/// Draws a random pose near the reference pose, with an additional turn in radians
pub(super) fn sway(turned_more: f64, scale: f64, random: &mut Random) -> Pose {
    let sigmas = Pose::prior_sigmas();
    let parameters = std::array::from_fn(|i| deviation(random) * sigmas[i] * scale * SWAY_SHARE);
    let mut pose = Pose::from_parameters(&parameters);
    let root = &mut pose.rotations[Bone::Root];
    *root = (DQuat::from_scaled_axis(*root) * DQuat::from_rotation_y(turned_more)).to_scaled_axis();
    pose
}

/// Draws the displacement of the center of mass from its position over the feet, in mm along x and z of the room
pub(super) fn off_balance_mm(scale: f64, random: &mut Random) -> DVec2 {
    DVec2::new(deviation(random), deviation(random)) * BALANCE_MM * scale
}

/// Leans the complete body so that it stands on its feet with its center of mass at that displacement, and puts the
/// soles on the floor
pub(super) fn stand(avatar: &Avatar, turn: TurnAngle, off_mm: DVec2, pose: &mut Pose) {
    let wanted = above_feet(avatar, turn, &Pose::default()) + DVec3::new(off_mm.x, 0.0, off_mm.y);
    // The second step corrects the residual due to the curvature of the first one.
    for _ in 0..2 {
        let now = above_feet(avatar, turn, pose);
        let away = wanted - now;
        let lean = DVec3::new(away.z, 0.0, -away.x) / now.y.max(1.0);
        let root = &mut pose.rotations[Bone::Root];
        *root = (DQuat::from_scaled_axis(lean) * DQuat::from_scaled_axis(*root)).to_scaled_axis();
    }
    let positions = avatar.posed(pose, turn).positions;
    let lowest = positions.iter().fold(f64::INFINITY, |low, p| low.min(p.y));
    if lowest.is_finite() {
        pose.shift_mm.y -= lowest;
    }
}

/// Returns the center of mass, from the middle between the ankles, in mm along the axes of the room
fn above_feet(avatar: &Avatar, turn: TurnAngle, pose: &Pose) -> DVec3 {
    let PosedAvatar { bones, positions } = avatar.posed(pose, turn);
    let body = TriMesh {
        positions,
        triangles: avatar.mesh.triangles.clone(),
    };
    let [left, right] = [Bone::LeftFoot, Bone::RightFoot].map(|foot| bones.head(foot));
    body.center_of_mass().unwrap_or(left) - (left + right) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    #[test]
    fn sway_keeps_the_balance_and_the_soles_on_the_floor() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let mut fallen_mm = 0.0;
        for seed in 0..6 {
            let random = &mut Random::new(seed);
            let turn = TurnAngle::from_degrees(60.0 * seed as f64);
            let mut pose = sway(0.05, 1.0, random);
            let own = above_feet(&avatar, turn, &Pose::default());
            let off = above_feet(&avatar, turn, &pose) - own;
            fallen_mm += DVec2::new(off.x, off.z).length() / 6.0;
            let off_mm = off_balance_mm(1.0, random);
            stand(&avatar, turn, off_mm, &mut pose);
            let off = above_feet(&avatar, turn, &pose) - own;
            assert!((DVec2::new(off.x, off.z) - off_mm).length() < 0.5, "{off}");
            let heights = avatar.posed(&pose, turn).positions;
            let lowest = heights.iter().map(|p| p.y).reduce(f64::min).unwrap();
            assert!(lowest.abs() < 1e-6);
        }
        // Independent joints alone would not keep the balance.
        assert!(fallen_mm > 15.0, "{fallen_mm}");
    }

    #[test]
    fn without_sway_the_pose_is_the_reference_pose() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let random = &mut Random::new(3);
        let mut pose = sway(0.0, 0.0, random);
        let off_mm = off_balance_mm(0.0, random);
        stand(&avatar, TurnAngle::from_degrees(45.0), off_mm, &mut pose);
        let most = pose
            .to_parameters()
            .iter()
            .fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!(most < 1e-9, "{most}");
    }
}
