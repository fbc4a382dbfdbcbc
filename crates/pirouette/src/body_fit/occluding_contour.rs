//! The occluding contour of a posed surface: the vertices on its silhouette's outline.

use glam::{DVec2, DVec3};

use super::outline::EdgePoint;
use pirouette_body::{Camera, Projector};

/// A contour vertex is visible when the point this far outside of it, in nominal px, is not covered by the surface
///
/// An arm's contour in front of the trunk is not part of the outline. Larger values lose contours in narrow gaps;
/// smaller values let the zigzag of a contour along mesh edges hide its own vertices.
const CLEARANCE: f64 = 1.6;

/// Height of a strip of the photo with one list of edges, in nominal px
const STRIP: f64 = 4.0;

/// Precomputed mesh connectivity for occluding contours
#[derive(Debug, Clone)]
pub struct ContourMesh {
    triangles: Vec<[u32; 3]>,
    /// Each edge with its triangles: the first uses it as given, the second reversed
    edges: Vec<([u32; 2], [u32; 2])>,
    /// Triangles of vertex `v`: `star[first[v]..first[v + 1]]`
    first: Vec<u32>,
    star: Vec<u32>,
}

/// A vertex on the outline
#[derive(Debug, Clone, Copy)]
pub(super) struct ContourVertex {
    pub(super) vertex: u32,
    pub(super) edge: EdgePoint,
}

impl ContourMesh {
    /// Collects edges and stars of a closed manifold mesh; non-manifold edges are ignored
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist.
    pub fn new(triangles: &[[u32; 3]], vertex_count: usize) -> Self {
        let mut halves: Vec<([u32; 2], bool, u32)> = Vec::with_capacity(3 * triangles.len());
        let mut first = vec![0u32; vertex_count + 1];
        for (t, triangle) in triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
                halves.push(([a.min(b), a.max(b)], a > b, t as u32));
                first[a as usize + 1] += 1;
            }
        }
        halves.sort_unstable();
        let edges = halves
            .chunk_by(|a, b| a.0 == b.0)
            .filter_map(|group| match group {
                [(edge, false, forth), (_, true, back)] => Some((*edge, [*forth, *back])),
                _ => None,
            })
            .collect();
        for v in 0..vertex_count {
            first[v + 1] += first[v];
        }
        let mut next = first.clone();
        let mut star = vec![0u32; 3 * triangles.len()];
        for (t, triangle) in triangles.iter().enumerate() {
            for &v in triangle {
                star[next[v as usize] as usize] = t as u32;
                next[v as usize] += 1;
            }
        }
        Self {
            triangles: triangles.to_vec(),
            edges,
            first,
            star,
        }
    }

    /// Returns the contour vertices on the outline of the posed surface, in ascending order
    ///
    /// `posed` in the room, in mm; a nominal pixel is `unit_px` large; empty when a vertex is behind the camera.
    pub(super) fn contour(
        &self,
        posed: &[DVec3],
        camera: &Camera,
        unit_px: f64,
    ) -> Vec<ContourVertex> {
        let projector = camera.projector();
        let mut photo: Vec<DVec2> = Vec::with_capacity(posed.len());
        for &p in posed {
            let view = projector.view_from_room(p);
            if view.z <= 1.0 {
                return Vec::new();
            }
            photo.push(projector.photo_from_view(view));
        }
        let front: Vec<bool> = self
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| photo[v as usize]);
                // Outward triangles are counter-clockwise seen from outside; the photo's y points down.
                (b - a).perp_dot(c - a) < 0.0
            })
            .collect();
        let mut on_rim: Vec<u32> = Vec::with_capacity(4096);
        let mut outline: Vec<[DVec2; 2]> = Vec::with_capacity(4096);
        for &([a, b], [forth, back]) in &self.edges {
            let (f, g) = (front[forth as usize], front[back as usize]);
            if f != g {
                let edge = [photo[a as usize], photo[b as usize]];
                outline.push(if f { edge } else { [edge[1], edge[0]] });
                on_rim.extend([a, b]);
            }
        }
        on_rim.sort_unstable();
        on_rim.dedup();
        let strips = Strips::new(&outline, STRIP * unit_px);
        on_rim
            .into_iter()
            .filter_map(|vertex| {
                let edge = EdgePoint {
                    position: photo[vertex as usize],
                    normal: self.photo_normal(vertex, posed, &projector)?,
                };
                let outside = edge.position + edge.normal * (CLEARANCE * unit_px);
                (strips.winding(outside) == 0).then_some(ContourVertex { vertex, edge })
            })
            .collect()
    }

    /// Returns the outward normal of the surface in the photo at a contour vertex
    fn photo_normal(&self, vertex: u32, posed: &[DVec3], projector: &Projector) -> Option<DVec2> {
        let v = vertex as usize;
        let star = &self.star[self.first[v] as usize..self.first[v + 1] as usize];
        let normal: DVec3 = star
            .iter()
            .map(|&t| {
                let [a, b, c] = self.triangles[t as usize].map(|v| posed[v as usize]);
                (b - a).cross(c - a)
            })
            .sum();
        // A plane through the center of projection projects to a line perpendicular to x and y of its normal.
        let origin = projector.view_from_room(posed[v]);
        let tip = projector.view_from_room(posed[v] + normal);
        (tip - origin).truncate().try_normalize()
    }
}

/// Directed edges by the strips that they cross
struct Strips {
    low: f64,
    strip_px: f64,
    first: Vec<u32>,
    edges: Vec<[DVec2; 2]>,
}

impl Strips {
    fn new(outline: &[[DVec2; 2]], strip_px: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for p in outline.iter().flatten() {
            low = low.min(p.y);
            high = high.max(p.y);
        }
        if !(low.is_finite() && high.is_finite()) {
            (low, high) = (0.0, 0.0);
        }
        let count = ((high - low) / strip_px) as usize + 1;
        let strips = |[a, b]: &[DVec2; 2]| {
            let strip = |y: f64| (((y - low) / strip_px) as usize).min(count - 1);
            strip(a.y.min(b.y))..=strip(a.y.max(b.y))
        };
        let mut first = vec![0u32; count + 1];
        for edge in outline {
            for s in strips(edge) {
                first[s + 1] += 1;
            }
        }
        for s in 0..count {
            first[s + 1] += first[s];
        }
        let mut next = first.clone();
        let mut edges = vec![[DVec2::ZERO; 2]; first[count] as usize];
        for edge in outline {
            for s in strips(edge) {
                edges[next[s] as usize] = *edge;
                next[s] += 1;
            }
        }
        Self {
            low,
            strip_px,
            first,
            edges,
        }
    }

    /// Returns the winding number of the outline around a point
    fn winding(&self, p: DVec2) -> i32 {
        let strip = (p.y - self.low) / self.strip_px;
        if !(strip >= 0.0 && strip < (self.first.len() - 1) as f64) {
            return 0;
        }
        let s = strip as usize;
        let mut winding = 0;
        for [a, b] in &self.edges[self.first[s] as usize..self.first[s + 1] as usize] {
            let down = a.y <= p.y && b.y > p.y;
            let up = b.y <= p.y && a.y > p.y;
            if down || up {
                let side = (*b - *a).perp_dot(p - *a);
                if down && side < 0.0 {
                    winding += 1;
                } else if up && side > 0.0 {
                    winding -= 1;
                }
            }
        }
        winding
    }
}
