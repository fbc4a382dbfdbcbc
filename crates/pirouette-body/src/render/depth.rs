//! Depth buffer and occlusion.

use std::ops::Range;

use glam::{DVec2, DVec3};
use pirouette_geom::Grid;

use super::{MIN_DEPTH_MM, SilhouetteMesh};
use crate::{Avatar, Bone, Camera, PerBone, PosedBones};

/// Minimum share of a bone's surface not occluded by another part for the bone to count as visible
///
/// At one half a forearm whose elbow is behind the trunk still counts as visible, and the far arm of a profile, of
/// which a sliver shows in front of or behind the trunk, does not.
pub const MIN_VISIBLE_SHARE: f64 = 0.5;

/// Minimum distance, in mm, by which a nearer surface must precede a vertex to occlude it
///
/// Vertices lie on the drawn surface: below a few millimeters the slope within a pixel makes them occlude themselves,
/// and above the thickness of a hand, parts in contact no longer occlude each other.
const HIDING_MARGIN_MM: f64 = 8.0;

/// The surface nearest to the camera at each pixel center
#[derive(Debug, Clone)]
pub struct NearestSurface {
    /// Depth along the optical axis, in mm; infinite at empty pixels
    pub depth_mm: Grid<f32>,
    /// Index of the triangle; [`NearestSurface::NONE`] at empty pixels
    pub triangle: Grid<u32>,
}

impl NearestSurface {
    /// Marks the absence of a triangle
    pub const NONE: u32 = u32::MAX;
}

impl SilhouetteMesh {
    /// Renders the depth along the optical axis, in mm, of the nearest surface at each pixel center; infinite at empty
    /// pixels
    ///
    /// For a closed mesh whose triangles run counter-clockwise seen from outside, only front faces are drawn.
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist.
    pub fn depth_map(&self, positions: &[DVec3], camera: &Camera) -> Grid<f32> {
        let vertices = see_all(positions, camera);
        let size = (camera.width_px, camera.height_px);
        let faces = self.faces_to_draw(positions);
        let drawn = drawn_triangles(&vertices, &self.triangles, faces);
        DepthBuffer::draw(size.0, 0..size.1, drawn).depth_mm()
    }

    pub(super) fn faces_to_draw(&self, positions: &[DVec3]) -> Faces {
        if self.closed && volume(positions, &self.triangles) > 0.0 {
            Faces::Outside
        } else {
            Faces::Both
        }
    }
}

/// Computes six times the signed volume; positive when triangles run counter-clockwise seen from outside
fn volume(positions: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let corners = triangles.iter().map(|t| t.map(|v| positions[v as usize]));
    corners.map(|[a, b, c]| a.cross(b).dot(c)).sum()
}

/// Finds depth and triangle of the nearest surface at each pixel center
///
/// # Panics
/// When a triangle refers to a vertex that does not exist.
pub fn nearest_surface(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    camera: &Camera,
) -> NearestSurface {
    let vertices = see_all(positions, camera);
    let (width, height) = (camera.width_px, camera.height_px);
    let drawn = drawn_triangles(&vertices, triangles, Faces::Both);
    let buffer = DepthBuffer::draw(width, 0..height, drawn);
    NearestSurface {
        depth_mm: buffer.depth_mm(),
        triangle: buffer.triangle,
    }
}

/// A vertex projected into the camera
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub(super) photo: DVec2,
    /// One over the depth along the optical axis, per mm: linear on screen
    pub(super) nearness: f64,
}

/// Projects every vertex, `None` behind the camera or not finite
pub(super) fn see_all(positions: &[DVec3], camera: &Camera) -> Vec<Option<Seen>> {
    let projector = camera.projector();
    let see = |&p: &DVec3| {
        let view = projector.view_from_room(p);
        let (photo, depth) = (projector.photo_from_view(view), view.z);
        (depth > MIN_DEPTH_MM && depth.is_finite() && photo.is_finite()).then_some(Seen {
            photo,
            nearness: 1.0 / depth,
        })
    };
    positions.iter().map(see).collect()
}

/// The nearest surface at each pixel center, stored by inverse depth
pub(super) struct DepthBuffer {
    /// One over the depth, 0 at empty pixels
    pub(super) nearness: Grid<f32>,
    /// Index of the triangle; [`NearestSurface::NONE`] at empty pixels
    pub(super) triangle: Grid<u32>,
}

/// Selection of the triangles to draw
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Faces {
    /// All
    Both,
    /// Front faces only; sufficient for closed surfaces whose triangles run counter-clockwise seen from outside
    Outside,
}

/// Iterates over the triangles to draw, by index, with their corners
pub(super) fn drawn_triangles(
    vertices: &[Option<Seen>],
    triangles: &[[u32; 3]],
    faces: Faces,
) -> impl Iterator<Item = (u32, [Seen; 3])> {
    triangles.iter().zip(0..).filter_map(move |(triangle, t)| {
        let [Some(a), Some(b), Some(c)] = triangle.map(|v| vertices[v as usize]) else {
            return None;
        };
        // y points down on screen
        let inside = (b.photo - a.photo).perp_dot(c.photo - a.photo) > 0.0;
        (faces == Faces::Both || !inside).then_some((t, [a, b, c]))
    })
}

impl DepthBuffer {
    /// Draws some rows of a picture: the first row of the buffer is the first of them
    pub(super) fn draw(
        width: usize,
        rows: Range<usize>,
        triangles: impl Iterator<Item = (u32, [Seen; 3])>,
    ) -> Self {
        let mut buffer = Self {
            nearness: Grid::filled(width, rows.len(), 0f32),
            triangle: Grid::filled(width, rows.len(), NearestSurface::NONE),
        };
        for (t, corners) in triangles {
            let [a, b, c] = corners.map(|corner| corner.nearness);
            let on_screen = corners.map(|corner| corner.photo);
            each_pixel(width, rows.clone(), on_screen, |x, y, [wa, wb, wc]| {
                let nearness = (wa * a + wb * b + wc * c) as f32;
                let at = (x, y - rows.start);
                let nearest = &mut buffer.nearness[at];
                if nearness > *nearest {
                    *nearest = nearness;
                    buffer.triangle[at] = t;
                }
            });
        }
        buffer
    }

    fn depth_mm(&self) -> Grid<f32> {
        // 1 / 0 is infinite
        self.nearness.map(|&nearness| 1.0 / nearness)
    }
}

/// Barycentric slack that prevents cracks between neighbors by rounding
const EDGE_SLACK: f64 = 1e-9;

/// Triangles of less area than this on screen, in square px, count as edge-on
const MIN_AREA_PX: f64 = 1e-12;

/// Calls `visit` with column, row and barycentric weights of every pixel center in a triangle, of some rows
fn each_pixel(
    width: usize,
    rows: Range<usize>,
    [a, b, c]: [DVec2; 3],
    mut visit: impl FnMut(usize, usize, [f64; 3]),
) {
    let area = (b - a).perp_dot(c - a);
    if area.abs() <= MIN_AREA_PX {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    // pixel centers within [low, high]; float to integer casts truncate and saturate
    let first = |v: f64| {
        let below = (v - 0.5) as usize;
        below + usize::from((below as f64) < v - 0.5)
    };
    let end = |v: f64, size: usize| match v - 0.5 {
        last if last >= 0.0 => (last as usize).saturating_add(1).min(size),
        _ => 0,
    };
    let (x0, x1) = (first(low.x), end(high.x, width));
    let (y0, y1) = (first(low.y).max(rows.start), end(high.y, rows.end));
    if x0 >= x1 {
        return;
    }
    // barycentric weights of b and c, and their increments per column
    let (for_b, for_c) = ((c - a) / area, (b - a) / area);
    let (step_b, step_c) = (for_b.y, -for_c.y);
    for y in y0..y1 {
        let start = DVec2::new(x0 as f64 + 0.5, y as f64 + 0.5) - a;
        let mut wb = start.perp_dot(for_b);
        let mut wc = for_c.perp_dot(start);
        let mut entered = false;
        for x in x0..x1 {
            let wa = 1.0 - wb - wc;
            if wa.min(wb).min(wc) >= -EDGE_SLACK {
                visit(x, y, [wa, wb, wc]);
                entered = true;
            } else if entered {
                break;
            }
            wb += step_b;
            wc += step_c;
        }
    }
}

/// Returns which vertices are not occluded; vertices outside the photo are not visible
///
/// # Panics
/// When a triangle refers to a vertex that does not exist.
pub fn visible_vertices(positions: &[DVec3], triangles: &[[u32; 3]], camera: &Camera) -> Vec<bool> {
    let surface = nearest_surface(positions, triangles, camera);
    see_all(positions, camera)
        .into_iter()
        .map(|vertex| {
            let Some(seen) = vertex else {
                return false;
            };
            let Some((x, y)) = pixel_of(seen.photo, camera) else {
                return false;
            };
            // The farthest neighbor decides: a vertex on the occluding contour is never at a pixel center.
            let farthest = (-1..=1)
                .flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)))
                .filter_map(|(dx, dy)| surface.depth_mm.get(x as isize + dx, y as isize + dy))
                .fold(0.0f32, |far, &d| far.max(d));
            1.0 / seen.nearness <= f64::from(farthest) + HIDING_MARGIN_MM
        })
        .collect()
}

fn pixel_of(photo: DVec2, camera: &Camera) -> Option<(usize, usize)> {
    let inside = photo.x >= 0.0
        && photo.y >= 0.0
        && photo.x < camera.width_px as f64
        && photo.y < camera.height_px as f64;
    inside.then_some((photo.x as usize, photo.y as usize))
}

/// Computes the share of each bone's surface, 0 to 1, that no other part occludes; 0 for bones outside the photo
///
/// The far side of a limb does not count as occluded by the limb itself, by the bones adjacent to it, or by bones
/// separated from it only by the spine: relevant is whether a photo shows the position of the limb.
pub fn visible_shares(avatar: &Avatar, posed: &PosedBones, camera: &Camera) -> PerBone<f64> {
    let positions = posed.skin(&avatar.mesh.positions, &avatar.weights);
    let surface = nearest_surface(&positions, &avatar.mesh.triangles, camera);
    let bones: Vec<Bone> = avatar.weights.iter().map(|w| w.strongest()).collect();
    let mut shown = PerBone::splat(0usize);
    let mut total = PerBone::splat(0usize);
    for (vertex, &bone) in see_all(&positions, camera).iter().zip(&bones) {
        total[bone] += 1;
        let Some(seen) = *vertex else {
            continue;
        };
        let Some((x, y)) = pixel_of(seen.photo, camera) else {
            continue;
        };
        let triangle = surface.triangle[(x, y)];
        let hidden = triangle != NearestSurface::NONE
            && f64::from(surface.depth_mm[(x, y)]) + HIDING_MARGIN_MM < 1.0 / seen.nearness
            && {
                let corner = avatar.mesh.triangles[triangle as usize][0];
                !joined(bone, bones[corner as usize])
            };
        shown[bone] += usize::from(!hidden);
    }
    PerBone::from_fn(|bone| {
        if total[bone] == 0 {
            0.0
        } else {
            shown[bone] as f64 / total[bone] as f64
        }
    })
}

/// Returns whether two bones are equal or adjacent, or both belong to the trunk
fn joined(a: Bone, b: Bone) -> bool {
    let trunk = |bone: Bone| matches!(bone, Bone::Root | Bone::LowerSpine | Bone::UpperSpine);
    a == b || a.parent() == Some(b) || b.parent() == Some(a) || (trunk(a) && trunk(b))
}

/// Returns which bones are visible: at least [`MIN_VISIBLE_SHARE`] of their surface is not occluded by another part
pub fn visible_bones(avatar: &Avatar, posed: &PosedBones, camera: &Camera) -> PerBone<bool> {
    visible_shares(avatar, posed, camera).map(|share| share >= MIN_VISIBLE_SHARE)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{camera, sphere};
    use super::*;
    use crate::{PerJoint, Pose, ReferencePose, SkinWeight, TurnAngle, pose_bones};
    use pirouette_geom::TriMesh;

    #[test]
    fn depth_of_a_facing_triangle_is_its_distance() {
        let z = 100.0;
        let positions = [
            DVec3::new(-300.0, 600.0, z),
            DVec3::new(300.0, 600.0, z),
            DVec3::new(0.0, 1300.0, z),
        ];
        let map = SilhouetteMesh::new(&[[0, 1, 2]]).depth_map(&positions, &camera());
        assert!((map[(80, 100)] - 2400.0).abs() < 1e-2);
        assert!(map[(0, 0)].is_infinite());
    }

    #[test]
    fn slanted_depth_is_perspective_correct() {
        let camera = camera();
        let positions = [
            DVec3::new(-400.0, 500.0, 500.0),
            DVec3::new(400.0, 500.0, -500.0),
            DVec3::new(0.0, 1500.0, 0.0),
        ];
        let normal = (positions[1] - positions[0]).cross(positions[2] - positions[0]);
        let map = SilhouetteMesh::new(&[[0, 1, 2]]).depth_map(&positions, &camera);
        let ray = camera.ray(DVec2::new(70.5, 110.5));
        let t = normal.dot(positions[0] - camera.center()) / normal.dot(ray);
        let expected = camera.depth(camera.center() + ray * t);
        assert!((f64::from(map[(70, 110)]) - expected).abs() < 1e-2);
    }

    #[test]
    fn the_far_side_of_a_closed_surface_changes_no_depth() {
        let (positions, mut triangles) = sphere(DVec3::new(30.0, 900.0, 0.0), 300.0, 12);
        let near = SilhouetteMesh::new(&triangles).depth_map(&positions, &camera());
        let both = nearest_surface(&positions, &triangles, &camera());
        assert_eq!(near, both.depth_mm);
        // inside out: every triangle must be drawn
        for triangle in &mut triangles {
            triangle.reverse();
        }
        let reversed = SilhouetteMesh::new(&triangles).depth_map(&positions, &camera());
        let differing = reversed.as_slice().iter().zip(near.as_slice());
        assert!(
            differing
                .filter(|(a, b)| a.is_finite() && (*a - *b).abs() < 1e-2)
                .count()
                > 1000
        );
    }

    #[test]
    fn bands_of_rows_equal_the_same_rows_of_the_full_picture() {
        let (positions, triangles) = sphere(DVec3::new(30.0, 900.0, 0.0), 300.0, 12);
        let vertices = see_all(&positions, &camera());
        let draw = |rows| {
            let drawn = drawn_triangles(&vertices, &triangles, Faces::Both);
            DepthBuffer::draw(160, rows, drawn)
        };
        let whole = draw(0..200);
        for rows in [0..1, 60..75, 99..200, 150..150] {
            let band = draw(rows.clone());
            for (y, row) in rows.enumerate() {
                assert_eq!(band.nearness.row(y), whole.nearness.row(row));
                assert_eq!(band.triangle.row(y), whole.triangle.row(row));
            }
        }
    }

    #[test]
    fn neighbors_share_every_pixel_between_them() {
        let quad = [(10.3, 5.1), (90.7, 20.2), (70.1, 80.9), (20.4, 60.5)];
        let [a, b, c, d] = quad.map(|(x, y)| DVec2::new(x, y));
        let mut hits = Grid::filled(100, 100, 0u32);
        each_pixel(100, 0..100, [a, b, c], |x, y, _| hits[(x, y)] += 1);
        each_pixel(100, 0..100, [a, c, d], |x, y, [wa, wb, wc]| {
            hits[(x, y)] += 1;
            let p = a * wa + c * wb + d * wc;
            let center = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            assert!((p - center).length() < 1e-9);
        });
        let area = ((b - a).perp_dot(c - a) + (c - a).perp_dot(d - a)) / 2.0;
        let count: u32 = hits.as_slice().iter().sum();
        assert!((f64::from(count) - area).abs() < 30.0, "{count} {area}");
        for y in 30..50 {
            assert!((30..60).all(|x| hits[(x, y)] >= 1));
        }
    }

    /// Two balls of one mesh: the forearm's in front, the thigh's behind
    fn two_balls(front: DVec3, back: DVec3) -> Avatar {
        let (mut positions, mut triangles) = sphere(front, 100.0, 12);
        let count = positions.len();
        let (more, more_triangles) = sphere(back, 60.0, 12);
        positions.extend(more);
        triangles.extend(more_triangles.iter().map(|t| t.map(|v| v + count as u32)));
        let weights = (0..positions.len())
            .map(|v| {
                SkinWeight::rigid(if v < count {
                    Bone::LeftForearm
                } else {
                    Bone::RightThigh
                })
            })
            .collect();
        Avatar {
            mesh: TriMesh {
                positions,
                triangles,
            },
            weights,
            bone_heads: PerBone::splat(DVec3::ZERO),
            keypoints: PerJoint::splat(DVec3::ZERO),
            pose: ReferencePose::A,
        }
    }

    #[test]
    fn a_ball_in_front_of_another_occludes_it_until_the_person_turns() {
        let avatar = two_balls(
            DVec3::new(0.0, 900.0, 300.0),
            DVec3::new(0.0, 900.0, -200.0),
        );
        let seen = |degrees: f64| {
            let turn = TurnAngle::from_degrees(degrees);
            let posed = pose_bones(&avatar.bone_heads, &Pose::default(), turn);
            visible_bones(&avatar, &posed, &camera())
        };
        let front = seen(0.0);
        assert!(front[Bone::LeftForearm] && !front[Bone::RightThigh]);
        let side = seen(90.0);
        assert!(side[Bone::LeftForearm] && side[Bone::RightThigh]);
        assert!(!side[Bone::Head], "no surface, not visible");

        let sharp = Camera {
            width_px: 800,
            height_px: 1000,
            ..camera()
        };
        let mesh = &avatar.mesh;
        let vertices = visible_vertices(&mesh.positions, &mesh.triangles, &sharp);
        let half = vertices.len() / 2;
        let share = vertices[..half].iter().filter(|&&v| v).count() as f64 / half as f64;
        assert!((0.35..0.65).contains(&share), "{share}");
        assert!(vertices[half..].iter().all(|&v| !v));
    }
}
