//! The pictures of a result folder: an overlay per view, and the contact sheet.

use glam::DVec3;
use rayon::prelude::*;

use crate::avatar::render;
use crate::bundle::Bundle;
use crate::camera::Camera;
use crate::io::scan_folder::LoadedScan;
use crate::normalize::shared_skeleton_joints;
use crate::picture::{ContactView, OverlayInput, contact_sheet, overlay};
use crate::pipeline::{Report, ViewReport};
use crate::scan::{Photo, View};

/// Bodies in the contact sheet are drawn at this part of the photo's size: tiles are no larger
const BODY_SCALE: f64 = 0.4;

/// Draws what was known and found over the photo of one view
pub(super) fn draw_overlay(view: &View, bundle: Option<&Bundle>, found: &ViewReport) -> Photo {
    let target = bundle.map(|bundle| {
        let (pose, turn) = (&bundle.poses[found.index], bundle.turns[found.index]);
        let camera = &bundle.cameras[found.index];
        shared_skeleton_joints(&bundle.avatar, pose, turn, camera).reference
    });
    overlay(&OverlayInput {
        photo: &view.photo,
        seeds: found.silhouette.seeds.as_ref(),
        silhouette: Some(&found.silhouette.soft),
        detected: &view.keypoints,
        target: target.as_ref(),
    })
}

/// Draws all views side by side: photo, mask, normalized over reference, body at that angle
pub(super) fn draw_contact_sheet(loaded: &LoadedScan, report: &Report) -> Photo {
    let drawn: Vec<_> = report
        .views
        .par_iter()
        .map(|found| {
            let bundle = report.bundle.as_ref();
            let seen = bundle.map(|b| (b.cameras[found.index], b.turns[found.index]));
            let reference = bundle.zip(seen).map(|(bundle, (camera, turn))| {
                let turned = turned(&bundle.avatar.mesh.positions, turn);
                render::silhouette(&turned, &bundle.avatar.mesh.triangles, &camera)
            });
            let body = report
                .body
                .as_ref()
                .zip(seen)
                .map(|(body, (camera, turn))| {
                    let turned = turned(&body.positions, turn);
                    render::shade(&turned, &body.triangles, None, &small(&camera))
                });
            (reference, body)
        })
        .collect();
    let views: Vec<ContactView> = report
        .views
        .iter()
        .zip(&drawn)
        .map(|(found, (reference, body))| {
            let view = &loaded.scan.views[found.index];
            ContactView {
                name: &view.name,
                turn: view.turn,
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

fn turned(positions: &[DVec3], turn: crate::units::TurnAngle) -> Vec<DVec3> {
    let room_from_world = turn.room_from_world();
    positions.iter().map(|&p| room_from_world * p).collect()
}

/// The same camera with fewer pixels
fn small(camera: &Camera) -> Camera {
    let scaled = |size: usize| ((size as f64 * BODY_SCALE).round() as usize).max(1);
    Camera {
        width_px: scaled(camera.width_px),
        height_px: scaled(camera.height_px),
        ..*camera
    }
}
