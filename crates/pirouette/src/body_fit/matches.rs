//! Matches between vertices of the posed surface and points of a photo's outline.

use glam::DVec3;
use pirouette_geom::Windowed;
use pirouette_geom::parallel::prelude::*;

use super::occluding_contour::ContourMesh;
use super::outline::{EdgePoint, PointIndex, SPACING, trace};
use super::{Body, BodyFitView};
use pirouette_body::{Camera, Pose, Projector, pose_bones};

/// Minimum cosine of the angle between matching normals
///
/// Otherwise the nearest point could jump from an arm to the trunk.
const MIN_COSINE: f64 = 0.6;

/// Sampling interval of the outline points that are matched to contour vertices
const OUTLINE_STRIDE: usize = 2;

/// Total weight of all contour vertices, as that of outline points at this spacing, in nominal px
///
/// Independent of the resolution of the mesh.
const CONTOUR_SPACING: f64 = 12.0;

/// The outline of one view, prepared for the search
#[derive(Debug, Clone)]
pub(super) struct Outline {
    pub(super) points: Vec<EdgePoint>,
    index: PointIndex,
    /// Size of a nominal pixel in this photo, in px: see [`pirouette_body::NOMINAL_STATURE_PX`]
    unit_px: f64,
}

impl Outline {
    /// Traces a soft silhouette in which a nominal pixel is `unit_px` large
    pub(super) fn new(soft: &Windowed<f32>, unit_px: f64) -> Self {
        let points = trace(soft, unit_px);
        Self {
            index: PointIndex::new(&points, unit_px),
            points,
            unit_px,
        }
    }
}

/// A vertex and the outline point at which it should be seen
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    pub(super) vertex: u32,
    pub(super) target: EdgePoint,
    pub(super) weight: f64,
}

impl Match {
    /// Returns the signed distance of a room point outside the outline, in nominal px, and its gradient by the point
    pub(super) fn residual(
        &self,
        camera: &Projector,
        point: DVec3,
        outline: &Outline,
    ) -> (f64, DVec3) {
        let off_px = camera.project(point) - self.target.position;
        let [gx, gy] = camera.project_gradients(point);
        let normal = self.target.normal / outline.unit_px;
        (normal.dot(off_px), gx * normal.x + gy * normal.y)
    }
}

/// Computes the matches of all views
///
/// `radius` in nominal px.
pub(super) fn match_views(
    body: &Body,
    views: &[BodyFitView],
    outlines: &[Outline],
    poses: &[Pose],
    radius: f64,
) -> Vec<Vec<Match>> {
    let views = views.par_iter().zip(outlines).zip(poses);
    views
        .map(|((view, outline), pose)| {
            let posed = pose_bones(&body.bone_heads, pose, view.turn);
            let positions = posed.skin(&body.positions, body.weights);
            find_matches(body.contour_mesh, &positions, &view.camera, outline, radius)
        })
        .collect()
}

/// Matches in both directions: each contour vertex to its outline point, and outline points to contour vertices
///
/// `posed` in the room, in mm; `radius` in nominal px.
fn find_matches(
    mesh: &ContourMesh,
    posed: &[DVec3],
    camera: &Camera,
    outline: &Outline,
    radius: f64,
) -> Vec<Match> {
    let unit_px = outline.unit_px;
    let radius_px = radius * unit_px;
    let contour = mesh.contour(posed, camera, unit_px);
    let edges: Vec<EdgePoint> = contour.iter().map(|r| r.edge).collect();
    let length = SPACING * outline.points.len() as f64;
    let contour_weight = length / CONTOUR_SPACING / contour.len().max(1) as f64;
    let mut matches: Vec<Match> = contour
        .iter()
        .filter_map(|r| {
            let (_, target) = outline.index.nearest(r.edge, radius_px, MIN_COSINE)?;
            Some(Match {
                vertex: r.vertex,
                target,
                weight: contour_weight,
            })
        })
        .collect();
    let index = PointIndex::new(&edges, unit_px);
    matches.extend(
        outline
            .points
            .iter()
            .step_by(OUTLINE_STRIDE)
            .filter_map(|&target| {
                let (at, _) = index.nearest(target, radius_px, MIN_COSINE)?;
                Some(Match {
                    vertex: contour[at].vertex,
                    target,
                    weight: 1.0,
                })
            }),
    );
    matches
}
