//! The surface for a known mesh: vertices are attracted by the nearest points of it.

use glam::DVec3;
use pirouette_geom::TriMesh;
use pirouette_geom::nearest::NearestSurface;
use pirouette_geom::parallel::prelude::*;

use super::occluding_contour::ContourMesh;
use super::pose_step::{SurfaceMatch, step_to_surface};
use super::shape_step::{Row, ShapeSolver};
use super::surface::Surface;
use super::{Body, BodyFitOptions, FittedBody, Round};
use pirouette_body::{Avatar, NOMINAL_STATURE_PX, Pose, PosedBones, TurnAngle, pose_bones};

/// Number of vertices whose displacements are solved for
const COUNT: usize = 4000;

/// One round: the pose, then the surface
#[derive(Debug, Clone, Copy)]
struct MeshRound {
    /// Search radius, in mm
    radius_mm: f64,
    /// Residuals beyond this lose weight, in mm
    robust_mm: f64,
    /// Weight of the bending energy; `None` keeps the surface
    smoothness: Option<f64>,
}

const ROUNDS: [MeshRound; 12] = {
    const fn round(radius_mm: f64, robust_mm: f64, smoothness: Option<f64>) -> MeshRound {
        MeshRound {
            radius_mm,
            robust_mm,
            smoothness,
        }
    }
    [
        round(80.0, 40.0, None),
        round(80.0, 30.0, None),
        round(60.0, 30.0, Some(5.0)),
        round(60.0, 20.0, Some(2.0)),
        round(50.0, 20.0, Some(1.0)),
        round(50.0, 15.0, Some(0.5)),
        round(40.0, 12.0, Some(0.5)),
        round(30.0, 8.0, Some(0.2)),
        round(20.0, 6.0, Some(0.1)),
        round(15.0, 5.0, Some(0.05)),
        round(15.0, 5.0, Some(0.05)),
        round(15.0, 5.0, Some(0.05)),
    ]
};

/// Minimum cosine of the angle between matching normals: other limbs nearby face away
const MIN_COSINE: f64 = 0.5;

/// Fits pose and surface of a fitted body to a mesh of the same person, hollows included
///
/// `mesh` is in the world frame, in mm, faces outward, and may have holes, where the body keeps its shape. `start` is the
/// pose in which the body explains it, at the turn angle `turn`. Returns the pose after it.
pub fn fit_to_mesh(
    fit: &mut FittedBody,
    start: &Pose,
    turn: TurnAngle,
    mesh: &TriMesh,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Pose {
    let avatar = &fit.avatar;
    let nominal = NOMINAL_STATURE_PX / avatar.stature_mm();
    let target = Target::new(avatar, mesh, turn);
    let contour_mesh = ContourMesh::new(&avatar.mesh.triangles, avatar.mesh.positions.len());
    let mut body = Body::new(avatar, &contour_mesh);
    let options = BodyFitOptions {
        anchors: false,
        ..BodyFitOptions::default()
    };
    let mut pose = *start;
    let Some(surface) = Surface::levels(avatar, &[COUNT]).pop() else {
        return pose;
    };
    let Some(mut solver) = ShapeSolver::new(&surface, &body, None, &options) else {
        return pose;
    };
    for (index, round) in ROUNDS.iter().enumerate() {
        if cancelled() {
            break;
        }
        let bones = pose_bones(&body.bone_heads, &pose, turn);
        let matches = target.matches(&body, &bones, round.radius_mm);
        let matches: Vec<SurfaceMatch> = matches
            .iter()
            .map(|near| SurfaceMatch {
                weight: &body.weights[near.vertex as usize],
                point: near.point,
                normal: near.normal,
                off_mm: near.off_mm,
            })
            .collect();
        let moved = step_to_surface(&bones, &pose, start, &matches, round.robust_mm);
        pose = moved.unwrap_or(pose);
        let Some(smoothness) = round.smoothness else {
            continue;
        };
        let shape_round = Round {
            coarse_count: COUNT,
            radius: round.radius_mm * nominal,
            smoothness,
            robust: round.robust_mm * nominal,
        };
        let bones = pose_bones(&body.bone_heads, &pose, turn);
        let rows = target.matches(&body, &bones, round.radius_mm);
        let rows = rows.into_iter().map(|m| {
            let blend = bones.blend(&body.weights[m.vertex as usize]);
            let gradient = blend.matrix3.transpose() * m.normal * nominal;
            Row::new(
                m.vertex,
                gradient,
                m.off_mm * nominal,
                1.0,
                shape_round.robust,
            )
        });
        let rows: Vec<Vec<Row>> = vec![rows.collect()];
        // The mesh shows all asymmetry, only the first rounds need it.
        let options = BodyFitOptions {
            symmetry: index < SYMMETRIC_ROUNDS,
            ..options.clone()
        };
        if solver
            .step(&mut body, &rows, &shape_round, &options)
            .is_none()
        {
            break;
        }
    }
    fit.avatar.mesh.positions = body.positions;
    pose
}

/// First rounds in which the surface is symmetric where the mesh allows it
const SYMMETRIC_ROUNDS: usize = 6;

/// The known mesh in the room
struct Target<'a> {
    /// Triangles of the body
    triangles: &'a [[u32; 3]],
    mesh: TriMesh,
    surface: NearestSurface,
}

/// A vertex with the nearest point of the known mesh
struct Near {
    vertex: u32,
    point: DVec3,
    normal: DVec3,
    off_mm: f64,
}

impl<'a> Target<'a> {
    fn new(avatar: &'a Avatar, mesh: &TriMesh, turn: TurnAngle) -> Self {
        let room = turn.room_from_world();
        let mesh = TriMesh {
            positions: mesh.positions.iter().map(|&p| room * p).collect(),
            triangles: mesh.triangles.clone(),
        };
        Self {
            triangles: &avatar.mesh.triangles,
            surface: NearestSurface::new(&mesh),
            mesh,
        }
    }

    /// Matches each vertex of the posed body with the nearest point that faces the same side
    fn matches(&self, body: &Body, bones: &PosedBones, radius_mm: f64) -> Vec<Near> {
        let posed = TriMesh {
            positions: bones.skin(&body.positions, body.weights),
            triangles: self.triangles.to_vec(),
        };
        let normals = posed.vertex_normals();
        let near = |(v, (&point, &normal)): (usize, (&DVec3, &DVec3))| {
            let near = self.surface.nearest(point)?;
            let [a, b, c] = self.mesh.corners(near.triangle);
            let facing = (b - a).cross(c - a).try_normalize()?;
            (near.distance < radius_mm && facing.dot(normal) > MIN_COSINE).then(|| Near {
                vertex: v as u32,
                point,
                normal: facing,
                off_mm: (point - near.position).dot(facing),
            })
        };
        let vertices = posed.positions.par_iter().zip(&normals).enumerate();
        vertices.filter_map(near).collect()
    }
}
