//! The pictures of a result folder: an overlay per view, the contact sheet, and the residuals.

use std::borrow::Cow;

use glam::DVec3;
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Mask, TriMesh};

use crate::report::{
    ContactView, OverlayInput, ResidualView, SeenBody, contact_sheet, count_color, overlay,
    residual_sheet,
};
use crate::scan_folder::LoadedScan;
use pirouette::body_fit::FittedBody;
use pirouette::color::SurfaceColors;
use pirouette::normalize::shared_skeleton_joints;
use pirouette::pipeline::Report;
use pirouette::scan::{Photo, View};
use pirouette::view::SolvedView;
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{Pose, TurnAngle, render};

/// Scale of bodies in the contact sheet, relative to the photo: tiles are no larger
const BODY_SCALE: f64 = 0.4;

/// Scale of references, whose outlines are compared
const REFERENCE_SCALE: f64 = 0.6;

/// Scale of the bodies in the residual sheet
const SEEN_SCALE: f64 = 0.6;

/// Cell size for clustering the vertices of a carved body for pictures, in mm
///
/// Pixels of the contact sheet have about this size; a carved body has ten vertices in each cell.
const CARVED_DETAIL_MM: f64 = 6.0;

/// The body prepared for pictures
pub(crate) struct DrawnBody<'a> {
    pub(crate) surface: Cow<'a, TriMesh>,
    pub(crate) mesh: SilhouetteMesh,
}

impl<'a> DrawnBody<'a> {
    /// Prepares the body; `None` without a body
    pub(crate) fn new(report: &'a Report) -> Option<Self> {
        let body = report.body.as_ref()?;
        // The colors of a fitted body belong to its vertices.
        let surface = match report.fit {
            Some(_) => Cow::Borrowed(body),
            None => Cow::Owned(body.clustered(CARVED_DETAIL_MM)),
        };
        let mesh = SilhouetteMesh::new(&surface.triangles);
        Some(Self { surface, mesh })
    }
}

/// Draws the inputs and results of one view over its photo
pub(crate) fn draw_overlay(view: &View, report: &Report, found: &SolvedView) -> Photo {
    let target = found.skeleton.map(|seen| {
        let reference = report.normalization_reference();
        shared_skeleton_joints(reference, &seen.pose, seen.turn, &seen.camera).reference
    });
    overlay(&OverlayInput {
        photo: &view.photo,
        seeds: found.silhouette.seeds.as_ref(),
        silhouette: Some(&found.silhouette.soft),
        detected: &view.keypoints,
        target: target.as_ref(),
    })
}

/// Draws all views side by side: photo, mask, normalized over reference, body
///
/// A fitted body has the colors of the photos and the pose of the view, a carved one has the reference pose.
pub(crate) fn draw_contact_sheet(
    loaded: &LoadedScan,
    report: &Report,
    body: Option<&DrawnBody>,
) -> Photo {
    let dressed = report.dressed.as_ref().map(|dressed| {
        let mesh = SilhouetteMesh::new(&dressed.avatar.mesh.triangles);
        (&dressed.avatar, mesh)
    });
    let colors = match &report.dressed {
        Some(dressed) => dressed.colors.as_ref(),
        None => report.colors.as_ref(),
    };
    let colors = colors.map(SurfaceColors::to_linear);
    let skeleton = report.skeleton.as_ref();
    let reference = skeleton.map(|_| &report.normalization_reference().mesh);
    let of_reference = reference.map(|mesh| match body {
        Some(same) if same.mesh.triangles() == mesh.triangles => Cow::Borrowed(&same.mesh),
        _ => Cow::Owned(SilhouetteMesh::new(&mesh.triangles)),
    });
    let drawn: Vec<_> = report
        .views
        .par_iter()
        .map(|found| {
            let seen = found.skeleton.map(|seen| (seen.camera, seen.turn));
            let reference = reference.zip(of_reference.as_ref()).zip(seen);
            let reference = reference.map(|((mesh, edges), (camera, turn))| {
                let positions = turned(&mesh.positions, turn);
                let coverage = edges.silhouette(&positions, &camera.scaled(REFERENCE_SCALE));
                coverage.map(|&covered| (255.0 * covered + 0.5) as u8)
            });
            let camera = seen.map(|(camera, turn)| (camera.scaled(BODY_SCALE), turn));
            // A fitted body can be posed as in the photo, for comparison.
            let body = body.zip(camera);
            let body = body.and_then(|(DrawnBody { surface, mesh }, (camera, turn))| {
                Some(match (&dressed, &report.fit) {
                    (Some((avatar, mesh)), _) => {
                        let positions = avatar.posed(&found.fit?.pose, turn).positions;
                        render::shade(mesh, &positions, colors.as_deref(), &camera)
                    }
                    (None, Some(fit)) => {
                        let positions = posed(fit, &found.fit?.pose, turn);
                        render::shade(mesh, &positions, colors.as_deref(), &camera)
                    }
                    (None, None) => {
                        render::shade(mesh, &turned(&surface.positions, turn), None, &camera)
                    }
                })
            });
            (reference, body)
        })
        .collect();
    let views: Vec<ContactView> = report
        .views
        .iter()
        .zip(&drawn)
        .map(|(found, (reference, body))| {
            let view = &loaded.scan.views[found.id.0];
            ContactView {
                name: &view.name,
                turn: found.turn_in_use(view),
                photo: &view.photo,
                mask: Some(&found.silhouette.mask),
                normalized: found.normalized.as_ref().map(|n| &n.mask),
                reference: reference.as_ref(),
                body: body.as_ref(),
            }
        })
        .collect();
    contact_sheet(&views)
}

/// Draws the distance of the outlines in the photos from the fitted body's, and the number of views that see each part
/// of it
///
/// `None` when no body was fitted.
pub(crate) fn draw_residuals(
    loaded: &LoadedScan,
    report: &Report,
    body: Option<&DrawnBody>,
) -> Option<Photo> {
    let (skeleton, fit, mesh) = (report.skeleton.as_ref()?, report.fit.as_ref()?, &body?.mesh);
    let silhouettes: Vec<Mask> = report
        .views
        .par_iter()
        .map(|found| {
            let seen = found.skeleton();
            let pose = found.fit.map_or(seen.pose, |fit| fit.pose);
            let positions = posed(fit, &pose, seen.turn);
            mesh.silhouette(&positions, &seen.camera).threshold(0.5)
        })
        .collect();
    let views: Vec<ResidualView> = report
        .views
        .iter()
        .zip(&silhouettes)
        .map(|(found, body)| {
            let view = &loaded.scan.views[found.id.0];
            let camera = &found.skeleton().camera;
            ResidualView {
                name: &view.name,
                turn: found.turn_in_use(view),
                photo: &view.photo,
                silhouette: &found.silhouette.soft,
                mask: &found.silhouette.mask,
                body,
                mm_per_px: camera.distance_mm / camera.focal_px(),
            }
        })
        .collect();
    let mut seen = Vec::new();
    if let Some(colors) = &report.colors {
        let counts = colors.view_counts.iter();
        let counts: Vec<[f32; 3]> = counts
            .map(|&count| {
                let color = count_color(usize::from(count));
                color.map(|v| render::linear_from_srgb(f32::from(v) / 255.0))
            })
            .collect();
        for (label, degrees) in [("Front", 0.0), ("Back", 180.0)] {
            let turn = TurnAngle::from_degrees(degrees);
            let positions = turned(&fit.avatar.mesh.positions, turn);
            let camera = skeleton.camera.scaled(SEEN_SCALE);
            let picture = render::shade(mesh, &positions, Some(&counts), &camera);
            let silhouette = mesh.silhouette(&positions, &camera).threshold(0.5);
            seen.push((label, picture, silhouette));
        }
    }
    let seen: Vec<SeenBody> = seen
        .iter()
        .map(|(label, picture, silhouette)| SeenBody {
            label,
            picture,
            silhouette,
        })
        .collect();
    Some(residual_sheet(&views, &seen, views.len()))
}

fn posed(fit: &FittedBody, pose: &Pose, turn: TurnAngle) -> Vec<DVec3> {
    fit.avatar.posed(pose, turn).positions
}

fn turned(positions: &[DVec3], turn: TurnAngle) -> Vec<DVec3> {
    let room_from_world = turn.room_from_world();
    positions.iter().map(|&p| room_from_world * p).collect()
}
