//! The avatar: a closed skinned surface in the reference pose, with named joints.
//!
//! World frame, millimeters: soles on y = 0, facing +z, the person's left at +x. The turning axis, x = z = 0, passes
//! behind the midpoint of the hip joints, by [`TURNING_AXIS_BEHIND_HIPS`]. The hips therefore lie at a small positive
//! z, and the ankles of the mannequin slightly farther in front.

use glam::DVec3;
use pirouette_geom::TriMesh;

use crate::{
    PerBone, PerJoint, Pose, PosedBones, ReferencePose, SkinWeight, TurnAngle, pose_bones,
};

/// Distance of the turning axis behind the midpoint of the hip joints, as a share of the stature
///
/// People who turn on the spot turn on their heels: ankles and hips remain slightly in front of the axis. Imported
/// avatars are shifted accordingly; the mannequin is built this way.
pub const TURNING_AXIS_BEHIND_HIPS: f64 = 0.004;

/// A skinned body in its reference pose
#[derive(Debug, Clone)]
pub struct Avatar {
    /// Closed surface, mm
    pub mesh: TriMesh,
    /// One skinning weight per vertex, same order as `mesh.positions`
    pub weights: Vec<SkinWeight>,
    /// Head (upper end, turning point) of each bone, mm
    pub bone_heads: PerBone<DVec3>,
    /// Position at which a keypoint detector would place each joint, mm; each is attached to `Joint::bone`
    ///
    /// The neck is the middle of the shoulders and the mid hip the middle of the hips.
    pub keypoints: PerJoint<DVec3>,
    /// Reference pose of the surface
    pub pose: ReferencePose,
}

impl Avatar {
    /// Returns the bones and the surface in a pose, in the room
    pub fn posed(&self, pose: &Pose, turn: TurnAngle) -> PosedAvatar {
        let bones = pose_bones(&self.bone_heads, pose, turn);
        let positions = bones.skin(&self.mesh.positions, &self.weights);
        PosedAvatar { bones, positions }
    }

    /// Returns the avatar with `pose` as its reference pose: vertices, bone heads and keypoints are moved
    ///
    /// [`Avatar::pose`] is unchanged; the soles may leave the floor.
    pub fn reposed(&self, pose: &Pose) -> Self {
        let PosedAvatar { bones, positions } = self.posed(pose, TurnAngle::default());
        Self {
            mesh: TriMesh {
                positions,
                triangles: self.mesh.triangles.clone(),
            },
            weights: self.weights.clone(),
            bone_heads: bones.heads(),
            keypoints: bones.keypoints(&self.keypoints),
            pose: self.pose,
        }
    }

    /// Returns the avatar scaled to another stature, in mm; unchanged if the ratio of statures is not positive and finite
    pub fn scaled_to(self, stature_mm: f64) -> Self {
        let factor = stature_mm / self.stature_mm();
        if factor.is_finite() && factor > 0.0 {
            self.scaled(factor)
        } else {
            self
        }
    }

    /// Multiplies all coordinates by a factor
    pub fn scaled(mut self, factor: f64) -> Self {
        self.points_mut().for_each(|p| *p *= factor);
        self
    }

    /// Moves vertices, bone heads and keypoints, in mm
    pub fn shifted(mut self, shift_mm: DVec3) -> Self {
        self.points_mut().for_each(|p| *p += shift_mm);
        self
    }

    fn points_mut(&mut self) -> impl Iterator<Item = &mut DVec3> {
        let vertices = self.mesh.positions.iter_mut();
        vertices
            .chain(&mut self.bone_heads)
            .chain(&mut self.keypoints)
    }

    /// Checks the invariants that every stage relies on
    ///
    /// # Errors
    /// Returns the first defect found.
    pub fn check(&self) -> Result<(), AvatarDefect> {
        let count = self.mesh.positions.len();
        if self.weights.len() != count {
            return Err(AvatarDefect::Weights {
                weights: self.weights.len(),
                vertices: count,
            });
        }
        let points = self.mesh.positions.iter().chain(&self.bone_heads);
        if !points.chain(&self.keypoints).all(|p| p.is_finite()) {
            return Err(AvatarDefect::NotFinite);
        }
        let mut triangles = self.mesh.triangles.iter().flatten();
        if let Some(&vertex) = triangles.find(|&&v| v as usize >= count) {
            return Err(AvatarDefect::Vertex { vertex });
        }
        let floor_mm = self.mesh.bounds().map_or(0.0, |(low, _)| low.y);
        let slack = FLOOR_SLACK * self.stature_mm();
        if floor_mm.abs() > slack {
            return Err(AvatarDefect::NotOnTheFloor { floor_mm });
        }
        Ok(())
    }

    /// Returns the height of the surface, in mm
    pub fn stature_mm(&self) -> f64 {
        self.mesh.bounds().map_or(0.0, |(lo, hi)| hi.y - lo.y)
    }
}

/// An avatar in one pose
#[derive(Debug, Clone)]
pub struct PosedAvatar {
    /// Transforms of the bones
    pub bones: PosedBones,
    /// Vertices in the room, in mm, same order as those of the avatar
    pub positions: Vec<DVec3>,
}

/// Largest distance of the soles from the floor, as a share of the stature
const FLOOR_SLACK: f64 = 0.003;

/// A defect of an avatar
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum AvatarDefect {
    #[error("{weights} skinning weights for {vertices} vertices")]
    Weights { weights: usize, vertices: usize },
    #[error("a position is not finite")]
    NotFinite,
    #[error("vertex {vertex} does not exist")]
    Vertex { vertex: u32 },
    #[error("the lowest point is at {floor_mm:.1} mm instead of the floor")]
    NotOnTheFloor { floor_mm: f64 },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mannequin::{MannequinParameters, mannequin};
    use crate::{Bone, Joint};

    fn person() -> Avatar {
        mannequin(&MannequinParameters::default()).unwrap()
    }

    /// Vertices, bone heads and keypoints
    fn points(avatar: &Avatar) -> Vec<DVec3> {
        let vertices = avatar.mesh.positions.iter();
        let all = vertices.chain(&avatar.bone_heads).chain(&avatar.keypoints);
        all.copied().collect()
    }

    fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
        assert_eq!(a.len(), b.len());
        let distances = a.iter().zip(b).map(|(a, b)| a.distance(*b));
        distances.fold(0.0, f64::max)
    }

    #[test]
    fn scaling_and_shifting_move_vertices_heads_and_keypoints() {
        let avatar = person();
        let doubled: Vec<DVec3> = points(&avatar).iter().map(|p| *p * 2.0).collect();
        assert_eq!(points(&avatar.clone().scaled(2.0)), doubled);
        let shift = DVec3::new(1.0, -2.0, 3.0);
        let shifted: Vec<DVec3> = points(&avatar).iter().map(|p| *p + shift).collect();
        assert_eq!(points(&avatar.clone().shifted(shift)), shifted);
        assert_eq!(points(&avatar.clone().scaled_to(f64::NAN)), points(&avatar));
        assert_eq!(points(&avatar.clone().scaled_to(-1.0)), points(&avatar));
    }

    #[test]
    fn the_rest_pose_moves_nothing() {
        let avatar = person();
        let reposed = avatar.reposed(&Pose::default());
        assert!(farthest(&points(&reposed), &points(&avatar)) < 1e-9);
    }

    #[test]
    fn a_lifted_arm_takes_its_hand_and_wrist_along() {
        let avatar = person();
        let mut pose = Pose::default();
        pose.rotations[Bone::LeftUpperArm] = DVec3::Z * 0.5;
        let reposed = avatar.reposed(&pose);
        let rise = |of: fn(&Avatar) -> DVec3| of(&reposed).y - of(&avatar).y;
        assert!(rise(|a| a.bone_heads[Bone::LeftHand]) > 100.0);
        assert!(rise(|a| a.keypoints[Joint::LeftWrist]) > 100.0);
        assert!(rise(|a| a.keypoints[Joint::RightWrist]).abs() < 1e-9);
        let posed = avatar.posed(&pose, TurnAngle::default());
        assert_eq!(posed.positions, reposed.mesh.positions);
        assert_eq!(
            posed.bones.head(Bone::LeftHand),
            reposed.bone_heads[Bone::LeftHand]
        );
    }
}
