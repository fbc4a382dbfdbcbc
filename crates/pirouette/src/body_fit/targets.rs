//! Positions of a photo's outline points when the fitted body takes the reference pose.

use glam::DVec2;

use super::occluding_contour::ContourMesh;
use super::outline::{EdgePoint, PointIndex};
use pirouette_body::{
    Avatar, Camera, NOMINAL_STATURE_PX, Pose, PosedAvatar, TurnAngle, pose_bones,
};

/// Maximum distance of outline points from the occluding contour that moves them, in nominal px
const RADIUS: f64 = 12.0;

/// Minimum cosine between both normals
const MIN_COSINE: f64 = 0.5;

/// The occluding contour of the fitted body in one photo, with the position of its points in the reference pose
#[derive(Debug, Clone)]
pub struct OutlineTargets {
    index: PointIndex,
    radius_px: f64,
    /// Per contour point: position in the reference pose, and rotation of the surface in the photo's plane
    moved: Vec<(DVec2, DVec2)>,
}

impl OutlineTargets {
    /// Maps the occluding contour of a fitted body from its pose in a photo to the reference pose, turned as in it
    ///
    /// `contour_mesh` is created from the body's mesh.
    pub fn new(
        avatar: &Avatar,
        contour_mesh: &ContourMesh,
        pose: &Pose,
        turn: TurnAngle,
        camera: &Camera,
    ) -> Self {
        let mesh = &avatar.mesh;
        let PosedAvatar {
            bones: photo,
            positions: posed,
        } = avatar.posed(pose, turn);
        let reference = pose_bones(&avatar.bone_heads, &Pose::default(), turn);
        let stature_px = camera.focal_px() * avatar.stature_mm() / camera.distance_mm;
        let unit_px = stature_px / NOMINAL_STATURE_PX;
        let contour = contour_mesh.contour(&posed, camera, unit_px);
        let moved = contour
            .iter()
            .map(|r| {
                let v = r.vertex as usize;
                let (weight, position) = (&avatar.weights[v], mesh.positions[v]);
                let [to, from] = [&reference, &photo].map(|bones| bones.blend(weight));
                let turned = to.matrix3 * from.matrix3.transpose();
                // The room's x and y are the photo's x and minus y: the turn changes sign twice.
                let turned = DVec2::new(turned.x_axis.x, -turned.x_axis.y);
                let target = camera.project(to.transform_point3(position));
                (target, turned.try_normalize().unwrap_or(DVec2::X))
            })
            .collect();
        let edges: Vec<EdgePoint> = contour.iter().map(|r| r.edge).collect();
        Self {
            index: PointIndex::new(&edges, unit_px),
            radius_px: RADIUS * unit_px,
            moved,
        }
    }

    /// Returns the target of an outline point, in px; `None` if no contour is near
    ///
    /// `normal` points out of the person. The offset from the contour is kept, rotated with the surface.
    pub fn target(&self, position: DVec2, normal: DVec2) -> Option<DVec2> {
        let point = EdgePoint { position, normal };
        let (at, contour) = self.index.nearest(point, self.radius_px, MIN_COSINE)?;
        let (target, turned) = self.moved[at];
        Some(target + turned.rotate(position - contour.position))
    }
}
