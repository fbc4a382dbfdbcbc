//! Silhouettes, limb visibility and shaded pictures of posed bodies.
//!
//! All functions take positions in the room (millimeters) and the camera in the room. Silhouettes are exact: the area
//! of each pixel covered by the union of the projected triangles, regardless of how the triangles overlap. Depth and
//! pictures are sampled.
//!
//! Triangles that extend behind the camera or have a non-finite corner are skipped.

mod depth;
mod shade;

use glam::{DVec2, DVec3};
use pirouette_geom::Grid;
use pirouette_geom::coverage::fill_edges;
use pirouette_geom::triangle_sides::sides_by_edge;

use crate::Camera;

pub use depth::{
    MIN_VISIBLE_SHARE, NearestSurface, nearest_surface, visible_bones, visible_shares,
    visible_vertices,
};
pub use shade::{Layer, shade, shade_layer};
pub use shade::{linear_from_srgb, srgb_from_linear};

/// Points nearer to the camera than this, in mm along the optical axis, are not drawn
///
/// Only prevents a division by zero: no part of a person in a photo comes this near.
pub const MIN_DEPTH_MM: f64 = 10.0;

/// Computes the area of each pixel, 0 to 1, covered by the union of the projected triangles
///
/// To render many silhouettes of one mesh, prepare a [`SilhouetteMesh`].
///
/// # Panics
/// When a triangle refers to a vertex that does not exist.
pub fn silhouette(positions: &[DVec3], triangles: &[[u32; 3]], camera: &Camera) -> Grid<f32> {
    SilhouetteMesh::new(triangles).silhouette(positions, camera)
}

/// The edges of a mesh with the triangles on both sides, prepared once for many silhouettes
#[derive(Debug, Clone)]
pub struct SilhouetteMesh {
    triangles: Vec<[u32; 3]>,
    /// Every edge once, lower vertex first
    edges: Vec<[u32; 2]>,
    /// The triangles along `edges[e]` are `sides[first_side[e]..first_side[e + 1]]`
    first_side: Vec<u32>,
    sides: Vec<Side>,
    /// Whether every edge is traversed equally often in both directions
    closed: bool,
}

/// A triangle adjacent to an edge
#[derive(Debug, Clone, Copy)]
struct Side {
    triangle: u32,
    /// +1 when the triangle traverses the edge from the lower to the higher vertex, -1 for the reverse
    direction: i8,
}

impl SilhouetteMesh {
    /// Finds the edges of a mesh; accepts any triangles: closed or open, manifold or not
    pub fn new(triangles: &[[u32; 3]]) -> Self {
        let sides = sides_by_edge(triangles);
        let mut mesh = Self {
            triangles: triangles.to_vec(),
            edges: Vec::with_capacity(sides.len() / 2),
            first_side: Vec::with_capacity(sides.len() / 2 + 1),
            sides: Vec::with_capacity(sides.len()),
            closed: true,
        };
        for edge in sides.chunk_by(|a, b| a.edge() == b.edge()) {
            mesh.edges.push(edge[0].edge());
            mesh.first_side.push(mesh.sides.len() as u32);
            mesh.sides.extend(edge.iter().map(|side| Side {
                triangle: side.triangle,
                direction: if side.ascends() { 1 } else { -1 },
            }));
            let ascending = edge.iter().filter(|side| side.ascends()).count();
            mesh.closed &= 2 * ascending == edge.len();
        }
        mesh.first_side.push(mesh.sides.len() as u32);
        mesh
    }

    /// Returns every edge once, lower vertex first
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// Returns the triangles of the mesh
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Computes the area of each pixel, 0 to 1, covered by the union of the projected triangles
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist.
    pub fn silhouette(&self, positions: &[DVec3], camera: &Camera) -> Grid<f32> {
        let outline = self.outline(positions, camera);
        fill_edges(camera.width_px, camera.height_px, &outline)
    }

    /// Returns directed edges in photo coordinates whose nonzero winding is the silhouette
    ///
    /// Each selected triangle runs clockwise on screen, so no two can cancel where they overlap; edges between two of
    /// them cancel exactly and are dropped. The remaining edges wind at least once around every covered point.
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist.
    pub fn outline(&self, positions: &[DVec3], camera: &Camera) -> Vec<[DVec2; 2]> {
        let projected = project_all(positions, camera);
        let mut complete = true;
        // +1 runs clockwise on screen unchanged, -1 when reversed, 0 covers no area or is skipped
        let mut facing: Vec<i8> = Vec::with_capacity(self.triangles.len());
        for triangle in &self.triangles {
            let corners = triangle.map(|v| projected[v as usize]);
            let [Some(a), Some(b), Some(c)] = corners else {
                complete = false;
                facing.push(0);
                continue;
            };
            let area = (b - a).perp_dot(c - a);
            facing.push(if area > 0.0 {
                1
            } else if area < 0.0 {
                -1
            } else {
                0
            });
        }
        // The front of a closed mesh covers the same area as its back: one of them suffices.
        if self.closed && complete {
            for side in &mut facing {
                *side = (*side).max(0);
            }
        }
        let mut outline = Vec::new();
        for (e, &[low, high]) in self.edges.iter().enumerate() {
            let sides = &self.sides[self.first_side[e] as usize..self.first_side[e + 1] as usize];
            let winding: i32 = sides
                .iter()
                .map(|s| i32::from(s.direction) * i32::from(facing[s.triangle as usize]))
                .sum();
            if winding == 0 {
                continue;
            }
            let (Some(a), Some(b)) = (projected[low as usize], projected[high as usize]) else {
                continue;
            };
            let edge = if winding > 0 { [a, b] } else { [b, a] };
            outline.extend(std::iter::repeat_n(edge, winding.unsigned_abs() as usize));
        }
        outline
    }
}

/// Returns the photo coordinates of each position, `None` behind the camera or not finite
fn project_all(positions: &[DVec3], camera: &Camera) -> Vec<Option<DVec2>> {
    let projector = camera.projector();
    positions
        .iter()
        .map(|&p| {
            let view = projector.view_from_room(p);
            let photo = projector.photo_from_view(view);
            (view.z > MIN_DEPTH_MM && photo.is_finite()).then_some(photo)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;
    use crate::TurnAngle;

    pub(super) fn camera() -> Camera {
        Camera {
            width_px: 160,
            height_px: 200,
            vertical_fov_radians: 0.8,
            height_mm: 900.0,
            distance_mm: 2500.0,
            pitch_radians: 0.0,
            yaw_radians: 0.0,
            distortion: 0.0,
        }
    }

    /// A sphere of latitude and longitude lines, outward triangles
    pub(super) fn sphere(center: DVec3, radius: f64, rings: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let around = 2 * rings;
        let mut positions = vec![center + DVec3::Y * radius];
        for ring in 1..rings {
            let polar = PI * f64::from(ring) / f64::from(rings);
            for k in 0..around {
                let azimuth = TAU * f64::from(k) / f64::from(around);
                let direction = DVec3::new(
                    polar.sin() * azimuth.sin(),
                    polar.cos(),
                    polar.sin() * azimuth.cos(),
                );
                positions.push(center + direction * radius);
            }
        }
        positions.push(center - DVec3::Y * radius);
        let last = positions.len() as u32 - 1;
        let at = |ring: u32, k: u32| 1 + (ring - 1) * around + k % around;
        let mut triangles = Vec::new();
        for k in 0..around {
            triangles.push([0, at(1, k), at(1, k + 1)]);
            for ring in 1..rings - 1 {
                let [a, b] = [at(ring, k), at(ring, k + 1)];
                let [c, d] = [at(ring + 1, k), at(ring + 1, k + 1)];
                triangles.push([a, c, d]);
                triangles.push([a, d, b]);
            }
            triangles.push([at(rings - 1, k), last, at(rings - 1, k + 1)]);
        }
        (positions, triangles)
    }

    fn area(grid: &Grid<f32>) -> f64 {
        grid.as_slice().iter().map(|&v| f64::from(v)).sum()
    }

    #[test]
    fn a_sphere_covers_the_area_of_its_projected_ellipse() {
        let camera = camera();
        let center = DVec3::new(150.0, 1100.0, 60.0);
        let (positions, triangles) = sphere(center, 200.0, 60);
        // The tangent cone cuts the image plane in an ellipse of area
        // pi f^2 sin^2(alpha) cos(alpha) / (cos^2(tilt) - sin^2(alpha))^1.5, tilt from the optical axis.
        let to_center = camera.view_from_room(center);
        let sin2 = (200.0 / to_center.length()).powi(2);
        let cos_tilt = to_center.z / to_center.length();
        let expected = PI * camera.focal_px().powi(2) * sin2 * (1.0 - sin2).sqrt()
            / (cos_tilt * cos_tilt - sin2).powf(1.5);
        let found = area(&silhouette(&positions, &triangles, &camera));
        // 60 rings: the polyhedron is about 0.1 % smaller than the ball
        assert!((found / expected - 1.0).abs() < 0.002, "{found} {expected}");
    }

    #[test]
    fn an_open_mesh_or_a_mixed_orientation_covers_the_same() {
        let (positions, mut triangles) = sphere(DVec3::new(0.0, 900.0, 0.0), 300.0, 12);
        let whole = silhouette(&positions, &triangles, &camera());
        triangles.remove(30);
        for t in triangles.iter_mut().step_by(3) {
            t.swap(0, 1);
        }
        let patched = silhouette(&positions, &triangles, &camera());
        for (a, b) in whole.as_slice().iter().zip(patched.as_slice()) {
            assert!((a - b).abs() < 1e-5);
        }
    }

    #[test]
    fn the_silhouette_is_the_union_of_the_triangles() {
        let camera = camera();
        let (positions, triangles) = sphere(DVec3::new(-50.0, 700.0, 100.0), 250.0, 6);
        let whole = silhouette(&positions, &triangles, &camera);
        // slow reference: inside any triangle at an 8 x 8 lattice of each pixel
        let flat: Vec<[DVec2; 3]> = triangles
            .iter()
            .map(|t| t.map(|v| camera.project(positions[v as usize])))
            .collect();
        let inside = |p: DVec2| {
            flat.iter().any(|[a, b, c]| {
                let s = [
                    (*b - *a).perp_dot(p - *a),
                    (*c - *b).perp_dot(p - *b),
                    (*a - *c).perp_dot(p - *c),
                ];
                s.iter().all(|&v| v >= 0.0) || s.iter().all(|&v| v <= 0.0)
            })
        };
        for y in (0..200).step_by(7) {
            for x in (0..160).step_by(3) {
                let hits = (0..64)
                    .filter(|i| {
                        let (i, j) = (f64::from(i % 8), f64::from(i / 8));
                        inside(DVec2::new(
                            x as f64 + (i + 0.5) / 8.0,
                            y as f64 + (j + 0.5) / 8.0,
                        ))
                    })
                    .count();
                let share = hits as f32 / 64.0;
                assert!((whole[(x, y)] - share).abs() < 0.12, "({x}, {y})");
            }
        }
    }

    #[test]
    fn turning_the_person_is_turning_the_positions() {
        let (positions, triangles) = sphere(DVec3::new(200.0, 900.0, 0.0), 150.0, 20);
        let turned: Vec<DVec3> = {
            let rotation = TurnAngle::from_degrees(90.0).room_from_world();
            positions.iter().map(|&p| rotation * p).collect()
        };
        let (direct, _) = sphere(DVec3::new(0.0, 900.0, -200.0), 150.0, 20);
        let a = silhouette(&turned, &triangles, &camera());
        let b = silhouette(&direct, &triangles, &camera());
        // the lattice of the sphere turns by complete columns
        for (a, b) in a.as_slice().iter().zip(b.as_slice()) {
            assert!((a - b).abs() < 1e-4);
        }
    }

    #[test]
    fn triangles_behind_the_camera_and_non_finite_ones_are_skipped() {
        let camera = camera();
        let (behind, triangles) = sphere(DVec3::new(0.0, 900.0, 2600.0), 150.0, 8);
        let grid = silhouette(&behind, &triangles, &camera);
        assert_eq!(grid.width(), 160);
        let (mut positions, triangles) = sphere(DVec3::new(0.0, 900.0, 0.0), 150.0, 8);
        positions[5] = DVec3::NAN;
        let grid = silhouette(&positions, &triangles, &camera);
        assert!(grid.as_slice().iter().all(|v| v.is_finite()));
        assert!(area(&grid) > 100.0);
        assert!(area(&silhouette(&[], &[], &camera)).abs() < 1e-9);
    }
}
