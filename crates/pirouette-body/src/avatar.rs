//! The avatar: a closed skinned surface in the reference pose, with named joints.
//!
//! World frame, millimeters: soles on y = 0, facing +z, the person's left at +x. The turning axis, x = z = 0, passes
//! behind the midpoint of the hip joints, by [`TURNING_AXIS_BEHIND_HIPS`]. The hips therefore lie at a small positive
//! z, and the ankles of the mannequin slightly farther in front.

use glam::DVec3;
use pirouette_geom::TriMesh;

use crate::{PerBone, PerJoint, ReferencePose, SkinWeight};

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
    /// Returns the same avatar scaled to another stature, in mm
    pub fn scaled_to(mut self, stature_mm: f64) -> Self {
        let scale = stature_mm / self.stature_mm();
        if scale.is_finite() && scale > 0.0 {
            for p in self
                .mesh
                .positions
                .iter_mut()
                .chain(&mut self.bone_heads)
                .chain(&mut self.keypoints)
            {
                *p *= scale;
            }
        }
        self
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

/// Largest distance of the soles from the floor, as a share of the stature
const FLOOR_SLACK: f64 = 0.003;

/// A defect of an avatar
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
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
