//! Poses: one rotation per bone relative to the reference pose, forward kinematics and skinning.
//!
//! In the reference pose (A or T) all rotations are zero. A pose maps points of the reference pose (world frame) into
//! the room: every bone rotates about its head, children follow their parents, and the root rotates with the turn of
//! the person, leans about the origin and shifts.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::{Bone, PerBone, PerJoint, TurnAngle};

/// One pose of the body, relative to the reference pose
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation vector of each bone about its head, along the axes of the reference pose, in radians
    ///
    /// The root's is the lean of the complete body about the origin, along the axes of the room, after the turn.
    pub rotations: PerBone<DVec3>,
    /// Shift of the complete body in the room, in mm
    pub shift_mm: DVec3,
}

impl Default for Pose {
    fn default() -> Self {
        Self {
            rotations: PerBone::splat(DVec3::ZERO),
            shift_mm: DVec3::ZERO,
        }
    }
}

impl Pose {
    /// Number of parameters: three rotations per bone, bone by bone, then the shift
    pub const PARAMETER_COUNT: usize = 3 * Bone::COUNT + 3;

    /// Returns the index of the first of a bone's three rotations
    pub const fn first_parameter(bone: Bone) -> usize {
        3 * bone as usize
    }

    /// Returns all parameters: rotations in radians, bone by bone, then the shift in mm
    pub fn to_parameters(&self) -> [f64; Self::PARAMETER_COUNT] {
        let mut parameters = [0.0; Self::PARAMETER_COUNT];
        let vectors = self.rotations.iter().chain([&self.shift_mm]);
        for (slot, v) in parameters.chunks_exact_mut(3).zip(vectors) {
            slot.copy_from_slice(&v.to_array());
        }
        parameters
    }

    /// Builds a pose from parameters; the inverse of [`Pose::to_parameters`]
    pub fn from_parameters(parameters: &[f64; Self::PARAMETER_COUNT]) -> Self {
        let mut pose = Self::default();
        let vectors = pose.rotations.iter_mut().chain([&mut pose.shift_mm]);
        for (slot, v) in parameters.chunks_exact(3).zip(vectors) {
            *v = DVec3::new(slot[0], slot[1], slot[2]);
        }
        pose
    }

    /// Returns the turn that is part of the root's lean: its rotation about the vertical, without the lean to the sides
    pub fn turned_more(&self) -> TurnAngle {
        let root = DQuat::from_scaled_axis(self.rotations[Bone::Root]);
        let (sine, cosine) = if root.w < 0.0 {
            (-root.y, -root.w)
        } else {
            (root.y, root.w)
        };
        TurnAngle::from_radians(2.0 * sine.atan2(cosine))
    }

    /// Returns the pose at another turn angle in which the complete person is turned with the angle
    ///
    /// The room points are those of the pose, rotated about the vertical axis by the difference of the angles.
    pub fn turned(mut self, turn: TurnAngle, other: TurnAngle) -> Self {
        let by = other.room_from_world() * turn.room_from_world().transpose();
        self.rotations[Bone::Root] = by * self.rotations[Bone::Root];
        self.shift_mm = by * self.shift_mm;
        self
    }

    /// Returns the same pose relative to another turn angle: no point in the room moves
    pub fn about_turn(mut self, turn: TurnAngle, other: TurnAngle) -> Self {
        let root = &mut self.rotations[Bone::Root];
        let back = DQuat::from_rotation_y((turn.radians() - other.radians()).rem_euclid(TAU));
        let mut rotation = DQuat::from_scaled_axis(*root) * back;
        if rotation.w < 0.0 {
            rotation = -rotation;
        }
        *root = rotation.to_scaled_axis();
        self
    }

    /// Returns the prior standard deviation of each parameter, in radians and mm
    ///
    /// The drift of people who try to stand still: determined on rendered sway and kept tight where silhouettes and
    /// keypoints constrain the parameter weakly (twist of the shins, rise of the root).
    pub fn prior_sigmas() -> [f64; Self::PARAMETER_COUNT] {
        let mut sigmas = Self::default();
        for bone in Bone::ALL {
            let degrees = match bone {
                Bone::Root => [2.0, 5.0, 2.0],
                Bone::LowerSpine => [3.0, 2.0, 3.0],
                Bone::UpperSpine => [1.5, 1.5, 1.5],
                Bone::Neck => [4.0, 5.0, 4.0],
                Bone::Head => [4.0, 5.0, 3.0],
                Bone::LeftClavicle | Bone::RightClavicle => [1.0, 1.0, 2.0],
                Bone::LeftUpperArm | Bone::RightUpperArm => [6.0, 4.0, 7.0],
                Bone::LeftForearm | Bone::RightForearm => [9.0, 4.0, 6.0],
                Bone::LeftHand | Bone::RightHand => [4.0, 3.0, 4.0],
                Bone::LeftThigh | Bone::RightThigh => [2.5, 2.5, 2.5],
                Bone::LeftShin | Bone::RightShin => [3.0, 1.0, 1.0],
                Bone::LeftFoot | Bone::RightFoot => [2.0, 2.0, 2.0],
            };
            sigmas.rotations[bone] = DVec3::from_array(degrees.map(f64::to_radians));
        }
        sigmas.shift_mm = DVec3::new(40.0, 8.0, 45.0);
        sigmas.to_parameters()
    }

    /// Returns the prior standard deviation of each parameter for people who step between photos
    ///
    /// The angle between their photos is then arbitrary, and so are the directions of the feet, which otherwise would
    /// determine the turn of the body.
    pub fn stepping_sigmas() -> [f64; Self::PARAMETER_COUNT] {
        let mut sigmas = Self::prior_sigmas();
        for foot in [Bone::LeftFoot, Bone::RightFoot] {
            let first = Self::first_parameter(foot);
            sigmas[first..first + 3].fill(STEPPING_FOOT_DEGREES.to_radians());
        }
        sigmas
    }
}

/// Standard deviation of the rotations of the feet of people who step between photos, in degrees
///
/// On photos of a real person in shoes who turned freely, the mean error of the turn is 3.5 degrees with the 2 degrees
/// of standing feet, 2.9 degrees with these.
const STEPPING_FOOT_DEGREES: f64 = 10.0;

/// A body in one pose: the transform of each bone from the reference pose
#[derive(Debug, Clone)]
pub struct PosedBones {
    /// `room_from_reference`, one per bone
    pub transforms: PerBone<DAffine3>,
    heads: PerBone<DVec3>,
    pose: Pose,
}

/// The axis and the pivot in the room of one rotation parameter, or the direction of a shift
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// `d point = axis x (point - pivot)`, for points attached to the bone
    Rotation {
        /// Axis in the room; its length is the rate
        axis: DVec3,
        /// Fixed point of the rotation, in mm
        pivot: DVec3,
    },
    /// `d point = direction`, for all points
    Shift {
        /// Direction in the room
        direction: DVec3,
    },
}

impl Motion {
    /// Returns the velocity in the room of a point that moves fully with the bone
    pub fn velocity(&self, point: DVec3) -> DVec3 {
        match *self {
            Motion::Rotation { axis, pivot } => axis.cross(point - pivot),
            Motion::Shift { direction } => direction,
        }
    }
}

/// Poses the bones: `heads` are the bone heads in the reference pose (world frame, mm)
pub fn pose_bones(heads: &PerBone<DVec3>, pose: &Pose, turn: TurnAngle) -> PosedBones {
    let mut transforms = PerBone::splat(DAffine3::IDENTITY);
    for bone in Bone::ALL {
        let rotation = DMat3::from_quat(DQuat::from_scaled_axis(pose.rotations[bone]));
        transforms[bone] = match bone.parent() {
            None => DAffine3 {
                matrix3: rotation * turn.room_from_world(),
                translation: pose.shift_mm,
            },
            Some(parent) => {
                let head = heads[bone];
                let local = DAffine3 {
                    matrix3: rotation,
                    translation: head - rotation * head,
                };
                transforms[parent] * local
            }
        };
    }
    PosedBones {
        transforms,
        heads: *heads,
        pose: *pose,
    }
}

impl PosedBones {
    /// Maps a point of the reference pose that belongs to one bone into the room
    pub fn carry(&self, bone: Bone, point: DVec3) -> DVec3 {
        self.transforms[bone].transform_point3(point)
    }

    /// Returns the bone's head in the room
    pub fn head(&self, bone: Bone) -> DVec3 {
        self.carry(bone, self.heads[bone])
    }

    /// Returns all bone heads in the room
    pub fn heads(&self) -> PerBone<DVec3> {
        PerBone::from_fn(|bone| self.head(bone))
    }

    /// Maps keypoints of the reference pose into the room, each with the bone of its joint
    pub fn keypoints(&self, reference: &PerJoint<DVec3>) -> PerJoint<DVec3> {
        PerJoint::from_fn(|joint| self.carry(joint.bone(), reference[joint]))
    }

    /// Blends the bones' transforms for one skinned vertex (linear blend skinning)
    pub fn blend(&self, weight: &SkinWeight) -> DAffine3 {
        let mut matrix3 = DMat3::ZERO;
        let mut translation = DVec3::ZERO;
        for (bone, w) in weight.iter() {
            let transform = &self.transforms[bone];
            matrix3 += transform.matrix3 * w;
            translation += transform.translation * w;
        }
        DAffine3 {
            matrix3,
            translation,
        }
    }

    /// Maps all vertices of a skinned surface into the room
    pub fn skin(&self, positions: &[DVec3], weights: &[SkinWeight]) -> Vec<DVec3> {
        positions
            .iter()
            .zip(weights)
            .map(|(&p, w)| self.blend(w).transform_point3(p))
            .collect()
    }

    /// Returns the motion of one parameter (in the order of [`Pose::to_parameters`]): the exact derivative of the posed
    /// points
    ///
    /// A point with skinning weights moves by the sum of its weights over the bone and its descendants times the
    /// velocity (for blended points this is the usual approximation: it uses the blended point instead of each bone's
    /// copy of it).
    ///
    /// # Panics
    /// When `parameter` is not below [`Pose::PARAMETER_COUNT`].
    pub fn motion(&self, parameter: usize) -> Motion {
        let k = parameter % 3;
        if parameter >= 3 * Bone::COUNT {
            return Motion::Shift {
                direction: DVec3::AXES[k],
            };
        }
        let bone = Bone::ALL[parameter / 3];
        let local = rotation_rate(self.pose.rotations[bone], k);
        match bone.parent() {
            None => Motion::Rotation {
                axis: local,
                pivot: self.pose.shift_mm,
            },
            Some(parent) => Motion::Rotation {
                axis: self.transforms[parent].matrix3 * local,
                pivot: self.head(bone),
            },
        }
    }
}

/// Computes column `k` of the left Jacobian of the rotation group at rotation vector `r`
fn rotation_rate(r: DVec3, k: usize) -> DVec3 {
    let e = DVec3::AXES[k];
    let angle = r.length();
    // Below this the second-order series is exact to rounding.
    if angle < 1e-4 {
        return e + r.cross(e) / 2.0 + r.cross(r.cross(e)) / 6.0;
    }
    let (sin, cos) = angle.sin_cos();
    e + r.cross(e) * ((1.0 - cos) / (angle * angle))
        + r.cross(r.cross(e)) * ((angle - sin) / (angle * angle * angle))
}

/// The bones that move a vertex with their weights: at most four, weights sum to 1
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkinWeight {
    bones: [Bone; 4],
    weights: [f64; 4],
}

impl SkinWeight {
    /// Attaches a vertex to one bone only
    pub fn rigid(bone: Bone) -> Self {
        Self {
            bones: [bone; 4],
            weights: [1.0, 0.0, 0.0, 0.0],
        }
    }

    /// Keeps the four largest weights and normalizes their sum to 1; rigid to the root when none is positive
    pub fn from_all(all: &PerBone<f64>) -> Self {
        let mut order = Bone::ALL;
        order.sort_by(|&a, &b| all[b].total_cmp(&all[a]));
        let sum: f64 = order[..4].iter().map(|&b| all[b].max(0.0)).sum();
        if !(sum.is_finite() && sum > 0.0) {
            return Self::rigid(Bone::Root);
        }
        Self {
            bones: std::array::from_fn(|i| order[i]),
            weights: std::array::from_fn(|i| all[order[i]].max(0.0) / sum),
        }
    }

    /// Iterates over the bones with a positive weight
    pub fn iter(&self) -> impl Iterator<Item = (Bone, f64)> + '_ {
        self.bones
            .iter()
            .copied()
            .zip(self.weights)
            .filter(|&(_, w)| w > 0.0)
    }

    /// Returns the weight of one bone
    pub fn of(&self, bone: Bone) -> f64 {
        self.iter()
            .filter(|&(b, _)| b == bone)
            .map(|(_, w)| w)
            .sum()
    }

    /// Sums the weights over a bone and its descendants
    pub fn below(&self, ancestor: Bone) -> f64 {
        self.iter()
            .filter(|(b, _)| b.descends_from(ancestor))
            .map(|(_, w)| w)
            .sum()
    }

    /// Returns the bone with the largest weight
    pub fn strongest(&self) -> Bone {
        let mut best = (self.bones[0], self.weights[0]);
        for (bone, weight) in self.iter() {
            if weight > best.1 {
                best = (bone, weight);
            }
        }
        best.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heads() -> PerBone<DVec3> {
        PerBone::from_fn(|bone| {
            let t = f64::from(bone as u8);
            DVec3::new((t * 37.0) % 300.0 - 150.0, 100.0 * t, (t * 13.0) % 70.0)
        })
    }

    fn some_pose() -> Pose {
        let parameters = std::array::from_fn(|i| 0.3 * (i as f64 * 1.7).sin());
        Pose::from_parameters(&parameters)
    }

    #[test]
    fn parameters_survive_a_round_trip() {
        let pose = some_pose();
        assert_eq!(Pose::from_parameters(&pose.to_parameters()), pose);
    }

    #[test]
    fn a_pose_about_another_turn_moves_no_point() {
        let (pose, turn) = (some_pose(), TurnAngle::from_degrees(350.0));
        for degrees in [350.0, 10.0, 170.0, -190.0] {
            let other = TurnAngle::from_degrees(degrees);
            let moved = pose.about_turn(turn, other);
            let points = [(&pose, turn), (&moved, other)]
                .map(|(pose, turn)| pose_bones(&heads(), pose, turn).heads());
            for bone in Bone::ALL {
                assert!((points[0][bone] - points[1][bone]).length() < 1e-6);
            }
        }
    }

    #[test]
    fn the_turn_of_a_pose_excludes_its_lean() {
        let mut pose = Pose::default();
        let lean = DQuat::from_scaled_axis(DVec3::new(0.1, 0.0, -0.2));
        let root = lean * DQuat::from_rotation_y(-0.3);
        pose.rotations[Bone::Root] = root.to_scaled_axis();
        assert!((pose.turned_more().radians() + 0.3).abs() < 1e-9);
        let turn = TurnAngle::from_degrees(20.0);
        let all = TurnAngle::from_radians(turn.radians() - 0.3);
        assert!(pose.about_turn(turn, all).turned_more().radians().abs() < 1e-9);
    }

    #[test]
    fn the_zero_pose_only_turns() {
        let turn = TurnAngle::from_degrees(90.0);
        let posed = pose_bones(&heads(), &Pose::default(), turn);
        let p = DVec3::new(10.0, 20.0, 30.0);
        for bone in Bone::ALL {
            let expected = DVec3::new(30.0, 20.0, -10.0);
            assert!((posed.carry(bone, p) - expected).length() < 1e-9);
        }
    }

    #[test]
    fn motions_match_finite_differences() {
        let (heads, pose, turn) = (heads(), some_pose(), TurnAngle::from_degrees(70.0));
        let posed = pose_bones(&heads, &pose, turn);
        let p = DVec3::new(120.0, 950.0, -40.0);
        for parameter in 0..Pose::PARAMETER_COUNT {
            for bone in [Bone::LeftHand, Bone::Head, Bone::RightFoot] {
                let at = |step: f64| {
                    let mut q = pose.to_parameters();
                    q[parameter] += step;
                    pose_bones(&heads, &Pose::from_parameters(&q), turn).carry(bone, p)
                };
                let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
                let moved =
                    parameter >= 3 * Bone::COUNT || bone.descends_from(Bone::ALL[parameter / 3]);
                let expected = if moved {
                    posed.motion(parameter).velocity(posed.carry(bone, p))
                } else {
                    DVec3::ZERO
                };
                assert!(
                    (difference - expected).length() < 1e-4,
                    "{parameter} {bone:?}"
                );
            }
        }
    }

    #[test]
    fn weights_keep_the_four_largest_and_sum_to_one() {
        let mut all = PerBone::splat(0.0);
        all[Bone::Neck] = 2.0;
        all[Bone::LeftForearm] = 1.0;
        all[Bone::LeftThigh] = 1.0;
        all[Bone::LeftShin] = 3.0;
        all[Bone::LeftFoot] = 0.5;
        let weight = SkinWeight::from_all(&all);
        assert!((weight.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(weight.of(Bone::LeftFoot).abs() < 1e-12);
        assert_eq!(weight.strongest(), Bone::LeftShin);
        let nan = SkinWeight::from_all(&PerBone::splat(f64::NAN));
        assert_eq!(nan, SkinWeight::rigid(Bone::Root));
    }
}
