//! A body mesh as a scan: silhouettes of it from all sides, as if it turned before a camera.
//!
//! Scans of booths, of phones with depth sensors and meshes of body models have no landmarks. The body fit finds them: the
//! mannequin is fitted to silhouettes of the mesh, then to its surface, and is measured like that of a person in photos.

mod orient;
#[cfg(test)]
mod tests;

use glam::DVec3;
use pirouette_body::render::{SilhouetteMesh, shade};
use pirouette_body::{Camera, Keypoints, ReferencePose, TurnAngle};
use pirouette_geom::TriMesh;
use pirouette_geom::parallel::prelude::*;
use thiserror::Error;

use crate::estimate::{EstimateError, estimate_keypoints};
use crate::scan::{CameraSetup, KeypointKind, KeypointSource, Scan, StatureFrom, Subject, View};

pub use orient::{AxisDirection, MeshUnit};

/// Why a mesh cannot be measured
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MeshScanError {
    /// No surface
    #[error("the mesh has no surface, or no height")]
    Empty,
    /// No axis is upright
    #[error("the up axis of the mesh cannot be determined; give it with --up, for example --up z")]
    UpUnknown,
    /// The feet do not show the front
    #[error(
        "the front of the mesh cannot be determined; give it with --front, for example --front -y"
    )]
    FrontUnknown,
    /// The given front is where the heels are
    #[error(
        "the feet of the mesh point away from --front; leave it out, or give the opposite axis"
    )]
    FrontContradicted,
    /// No person has this height in any unit
    #[error(
        "the mesh is {height:.3} units high, which is no person in mm, cm, m or inch; give the unit with --unit"
    )]
    UnitUnknown {
        /// Height in units of the file
        height: f64,
    },
    /// No person has this height
    #[error(
        "the mesh is {height_mm:.0} mm high, people have 500 to 2600 mm; check --unit and --up"
    )]
    Height {
        /// Height, in mm
        height_mm: f64,
    },
    /// No figure overlaps its silhouettes
    #[error("no figure of a person fits the mesh")]
    Figure(#[from] EstimateError),
}

/// Options of [`scan_of_mesh`]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeshScanOptions {
    /// Unit of the coordinates; found by the height if `None`
    pub unit: Option<MeshUnit>,
    /// Axis of the mesh that points up; found by the surface of trunk and legs if `None`
    pub up: Option<AxisDirection>,
    /// Axis of the mesh that points to the person's front; found by the feet if `None`
    pub front: Option<AxisDirection>,
    /// Data about the person
    pub subject: Subject,
}

/// Number of views, spread over one turn
const VIEW_COUNT: usize = 8;

/// Columns and rows of the views
const SIDE_PX: usize = 1000;

/// Distance of the camera, relative to the height of the mesh: a long one shows the silhouettes nearly in parallel
const DISTANCE: f64 = 4.0;

/// Part of the photo's rows that the mesh covers
const COVERED: f64 = 0.84;

/// Width from which the arms are stretched out level, relative to the height: 0.95 to 1.05 in T-pose
const T_POSE_WIDTH: f64 = 0.85;

/// Parts of the mesh with a smaller share of its surface are noise
const MIN_PART: f64 = 0.01;

/// Standard deviation of the turn of exact views, in degrees
const TURN_SD_DEGREES: f64 = 0.2;

/// Renders a mesh from all sides as the scan of a person who holds still
///
/// The mesh may have holes, several parts and noise. The scan contains shaded pictures, exact silhouettes, estimated
/// keypoints, and the mesh itself in the world frame.
///
/// # Errors
/// When unit, up axis or front cannot be determined, or no figure of a person fits.
pub fn scan_of_mesh(
    mesh: &TriMesh,
    options: &MeshScanOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<Scan, MeshScanError> {
    let mesh = without_scraps(mesh);
    let mesh = orient::upright(&mesh, options.unit, options.up, options.front)?;
    let (low, high) = mesh.bounds().ok_or(MeshScanError::Empty)?;
    let stature_mm = high.y;
    let camera = Camera {
        width_px: SIDE_PX,
        height_px: SIDE_PX,
        vertical_fov_radians: 2.0 * (0.5 / (COVERED * DISTANCE)).atan(),
        height_mm: stature_mm / 2.0,
        distance_mm: DISTANCE * stature_mm,
        pitch_radians: 0.0,
        yaw_radians: 0.0,
        distortion: 0.0,
    };
    let edges = SilhouetteMesh::new(&mesh.triangles);
    let views = (0..VIEW_COUNT).into_par_iter().map(|index| {
        let turn = TurnAngle::from_degrees(360.0 * index as f64 / VIEW_COUNT as f64);
        let room = turn.room_from_world();
        let positions: Vec<DVec3> = mesh.positions.iter().map(|&p| room * p).collect();
        View {
            name: format!("{index:03}"),
            photo: shade(&edges, &positions, None, &camera),
            input_size_px: (SIDE_PX, SIDE_PX),
            turn,
            turn_sd_radians: TURN_SD_DEGREES.to_radians(),
            time_s: None,
            keypoints: Keypoints::default(),
            keypoints_from: KeypointSource::Estimate,
            keypoint_kind: KeypointKind::default(),
            mask: Some(edges.silhouette(&positions, &camera).threshold(0.5)),
            person_odds: None,
        }
    });
    let mut scan = Scan {
        pose: match (high.x - low.x) > T_POSE_WIDTH * stature_mm {
            true => ReferencePose::T,
            false => ReferencePose::A,
        },
        stature_mm: Some(stature_mm),
        stature_from: StatureFrom::Mesh,
        mm_per_px: None,
        subject: options.subject,
        camera: CameraSetup {
            vertical_fov_radians: Some(camera.vertical_fov_radians),
            height_mm: Some(camera.height_mm),
            distance_mm: Some(camera.distance_mm),
            pitch_radians: Some(0.0),
            yaw_radians: Some(0.0),
            distortion: 0.0,
        },
        views: views.collect(),
        background: None,
        unusable_view_count: 0,
        surface: None,
    };
    let keypoints = estimate_keypoints(&scan, None, cancelled)?;
    for (view, keypoints) in scan.views.iter_mut().zip(keypoints) {
        view.keypoints = keypoints;
    }
    scan.surface = Some(mesh);
    Ok(scan)
}

/// Returns the mesh without small loose parts, facing outward
fn without_scraps(mesh: &TriMesh) -> TriMesh {
    let parts = mesh.components();
    let areas: Vec<f64> = parts.iter().map(TriMesh::area).collect();
    let total: f64 = areas.iter().sum();
    let kept = parts.into_iter().zip(areas);
    let kept = kept.filter(|(_, area)| *area >= MIN_PART * total);
    let mut all = TriMesh::default();
    for (mut part, _) in kept {
        if is_inside_out(&part) {
            part.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let first = all.positions.len() as u32;
        all.positions.extend(part.positions);
        let triangles = part.triangles.iter();
        all.triangles
            .extend(triangles.map(|t| t.map(|v| v + first)));
    }
    all
}

/// Returns whether most of the surface faces the middle of a part, which may have holes
fn is_inside_out(part: &TriMesh) -> bool {
    let middle = part.positions.iter().sum::<DVec3>() / part.positions.len().max(1) as f64;
    let volumes = (0..part.triangles.len()).map(|t| {
        let [a, b, c] = part.corners(t).map(|corner| corner - middle);
        a.dot(b.cross(c))
    });
    volumes.sum::<f64>() < 0.0
}
