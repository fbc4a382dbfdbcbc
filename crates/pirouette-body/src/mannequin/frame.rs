//! Joint positions of a standing person.

use glam::{DMat3, DVec3};

use super::proportions::Proportions;
use crate::{Bone, PerBone};

/// Pose of the arms
#[derive(Debug, Clone, Copy)]
pub(super) struct ArmPose {
    /// Upper arms below the horizontal
    pub below_radians: f64,
    /// Forearms out of the frontal plane, to the front
    pub elbow_bend_radians: f64,
}

/// Joints and limb axes of the left side, world frame, mm
///
/// Lengths below that do not come from the survey are in thousandths of the stature ("per mille").
#[derive(Debug, Clone)]
pub(super) struct Frame {
    /// One thousandth of the stature, in mm
    pub permille_mm: f64,
    /// z of the ankles; the reference plane of the trunk's sections
    pub plumb_z: f64,
    pub hip: DVec3,
    pub knee: DVec3,
    pub ankle: DVec3,
    pub shoulder: DVec3,
    pub elbow: DVec3,
    pub wrist: DVec3,
    /// Tip of the radius, where the length of the hand begins
    pub stylion: DVec3,
    /// Level of the ear holes in the middle of the head
    pub tragion: DVec3,
    pub nape: DVec3,
    pub skull_base: DVec3,
    /// Axes of the leg: outward, down, to the front
    pub leg_axes: DMat3,
    /// Axes of the upper arm: upper side, along, to the front
    pub upper_arm_axes: DMat3,
    /// Axes of the forearm: upper side, along, thumb side
    pub forearm_axes: DMat3,
}

/// Distance of the ankles in front of the turning axis, in per mille
///
/// People who turn on the spot turn on their heels rather than about their ankles.
const ANKLE_BEFORE_AXIS: f64 = 14.0;

/// Half the distance between the ankles of women and men, in per mille: the stance with the legs about 5 degrees apart
const HALF_STANCE: [f64; 2] = [107.0, 112.0];

/// Half the distance between the hip joint centers, in per mille
const HALF_HIP: f64 = 57.0;

/// Distance of the shoulder joint center below the acromion with the arms at 48 degrees, in per mille
const SHOULDER_BELOW_ACROMION: f64 = 18.0;

/// Rise of the shoulder when the arm moves from 48 degrees below the horizontal to level, in per mille
const SHOULDER_RISE: f64 = 18.0;

/// Shoulder joint center to elbow joint center over acromion to radiale
///
/// # Source
/// de Leva 1996, "Joint center longitudinal positions computed from a selected subset of Chandler's data": 282 mm at a
/// stature of 1741 mm.
const UPPER_ARM_OVER_ACROMION_RADIALE: f64 = 0.845;

/// Elbow to wrist joint over the survey's length of the forearm, which ends at the tip of the radius
///
/// Pose detectors and the joints of imported avatars place the wrist above the crease where the hand's length begins.
const WRIST_OVER_STYLION: f64 = 0.96;

impl Frame {
    pub(super) fn new(d: &Proportions, maleness: f64, stature_mm: f64, arms: ArmPose) -> Self {
        let by_sex = |female: f64, male: f64| female + (male - female) * maleness;
        let permille_mm = stature_mm / 1000.0;
        let plumb_z = ANKLE_BEFORE_AXIS * permille_mm;
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, plumb_z + z * permille_mm);

        let hip = at(
            HALF_HIP * permille_mm,
            d.trochanter_height + 5.0 * permille_mm,
            -10.0,
        );
        let ankle = at(
            by_sex(HALF_STANCE[0], HALF_STANCE[1]) * permille_mm,
            d.malleolus_height,
            0.0,
        );
        let down = (ankle - hip).normalize_or(DVec3::NEG_Y);
        let front = (DVec3::Z - down * down.z).normalize_or(DVec3::Z);
        let leg_axes = DMat3::from_cols(front.cross(down), down, front);
        let knee_height = d.knee_height + 3.0 * permille_mm;
        let knee_on_line = hip + (ankle - hip) * ((hip.y - knee_height) / (hip.y - ankle.y));
        let knee = knee_on_line + front * (11.0 * permille_mm);

        let (sin, cos) = arms.below_radians.sin_cos();
        let along = DVec3::new(cos, -sin, 0.0);
        let upper = DVec3::new(sin, cos, 0.0);
        let upper_arm_axes = DMat3::from_cols(upper, along, DVec3::Z);
        let (bend_sin, bend_cos) = arms.elbow_bend_radians.sin_cos();
        let forearm = along * bend_cos + DVec3::Z * bend_sin;
        let thumb = DVec3::Z * bend_cos - along * bend_sin;
        let forearm_axes = DMat3::from_cols(upper, forearm, thumb);
        let raised = 1.0 - arms.below_radians / 48f64.to_radians();
        let shoulder = at(
            d.biacromial_breadth / 2.0 - 12.0 * permille_mm,
            d.acromion_height + (SHOULDER_RISE * raised - SHOULDER_BELOW_ACROMION) * permille_mm,
            -2.0,
        );
        let elbow = shoulder + along * (UPPER_ARM_OVER_ACROMION_RADIALE * d.upper_arm_length);
        let wrist = elbow + forearm * (WRIST_OVER_STYLION * d.forearm_length);
        let stylion = elbow + forearm * d.forearm_length;

        let tragion = at(0.0, stature_mm - d.crown_to_tragion, by_sex(3.0, 11.0));
        Self {
            permille_mm,
            plumb_z,
            hip,
            knee,
            ankle,
            shoulder,
            elbow,
            wrist,
            stylion,
            tragion,
            nape: at(0.0, d.nape_height - 5.0 * permille_mm, -10.0),
            skull_base: at(0.0, tragion.y - 10.0 * permille_mm, 4.0),
            leg_axes,
            upper_arm_axes,
            forearm_axes,
        }
    }

    /// Returns the heads of all bones
    pub(super) fn bone_heads(&self) -> PerBone<DVec3> {
        let m = self.permille_mm;
        let middle = |y: f64, z: f64| DVec3::new(0.0, y, self.plumb_z + z * m);
        let left = |bone: Bone| -> DVec3 {
            match bone {
                Bone::Root => middle(self.hip.y, -10.0),
                Bone::LowerSpine => middle(self.hip.y + 32.0 * m, -12.0),
                Bone::UpperSpine => middle(
                    self.hip.y + 0.5 * (self.nape.y - self.hip.y) - 4.0 * m,
                    -14.0,
                ),
                Bone::Neck => self.nape,
                Bone::Head => self.skull_base,
                Bone::LeftClavicle => {
                    let root = middle(self.shoulder.y + 10.0 * m, 2.0);
                    DVec3::new(14.0 * m, root.y, root.z)
                }
                Bone::LeftUpperArm => self.shoulder,
                Bone::LeftForearm => self.elbow,
                Bone::LeftHand => self.wrist,
                Bone::LeftThigh => self.hip,
                Bone::LeftShin => self.knee,
                _ => self.ankle,
            }
        };
        PerBone::from_fn(|bone| {
            let side = bone.min(bone.mirrored());
            let head = left(side);
            if side == bone {
                head
            } else {
                DVec3::new(-head.x, head.y, head.z)
            }
        })
    }
}
