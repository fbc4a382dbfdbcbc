//! The reference figure: a closed skinned surface in the reference pose, with named joints, tape loops
//! and landmarks.
//!
//! World frame, millimeters: soles on y = 0, facing +z, the person's left at +x, the turning axis through
//! the middle between the ankles.

pub mod gltf;
pub mod landmarks;
pub mod mannequin;
pub mod render;

use glam::DVec3;
use pirouette_geom::TriMesh;

use crate::measure::{Girth, Landmark};
use crate::pose::SkinWeight;
use crate::skeleton::{Bone, Joint};

/// The pose in which people stand, and to which their silhouettes are normalized
///
/// A relaxed stance: elbows bent forward, legs a little apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ReferencePose {
    /// Arms stretched down and out
    #[default]
    A,
    /// Arms stretched out level
    T,
}

impl ReferencePose {
    /// Angle of the upper arms below the horizontal, in degrees
    pub fn arm_angle_degrees(self) -> f64 {
        match self {
            ReferencePose::A => 48.0,
            ReferencePose::T => 0.0,
        }
    }

    /// Angle by which the forearms point forward out of the frontal plane, in degrees
    pub fn elbow_bend_degrees(self) -> f64 {
        43.0
    }
}

/// A skinned reference figure in its reference pose
#[derive(Debug, Clone)]
pub struct Avatar {
    /// Closed surface, mm
    pub mesh: TriMesh,
    /// One skinning weight per vertex, same order as `mesh.positions`
    pub weights: Vec<SkinWeight>,
    /// Head (upper end, turning point) of each bone, mm
    pub bone_heads: [DVec3; Bone::COUNT],
    /// Where a keypoint detector would place each joint, mm; each hangs on `Joint::bone`
    ///
    /// The neck is the middle of the shoulders and the mid hip the middle of the hips.
    pub keypoints: [DVec3; Joint::COUNT],
    /// Closed loops of vertices that a tape would follow, in order along the tape
    pub tape_loops: Vec<TapeLoop>,
    /// Named points of the surface
    pub landmarks: Vec<(Landmark, u32)>,
    /// The pose it stands in
    pub pose: ReferencePose,
}

/// Where a tape goes: a closed loop of vertices
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TapeLoop {
    /// What it measures
    pub girth: Girth,
    /// Vertices along the loop
    pub vertices: Vec<u32>,
}

impl Avatar {
    /// Height of the surface, in mm
    pub fn stature_mm(&self) -> f64 {
        self.mesh.bounds().map_or(0.0, |(lo, hi)| hi.y - lo.y)
    }

    /// Position of a landmark, `None` when this avatar has none of that name
    pub fn landmark(&self, landmark: Landmark) -> Option<DVec3> {
        let (_, vertex) = self.landmarks.iter().find(|(l, _)| *l == landmark)?;
        Some(self.mesh.positions[*vertex as usize])
    }

    /// The loop of a girth, `None` when this avatar has none
    pub fn tape_loop(&self, girth: Girth) -> Option<&TapeLoop> {
        self.tape_loops.iter().find(|t| t.girth == girth)
    }
}
