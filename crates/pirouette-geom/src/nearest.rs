//! Nearest points of a triangle mesh.
//!
//! A tree of bounding boxes, split at the median of the triangle centers. Every query is exact.

use glam::DVec3;

use crate::tri_mesh::TriMesh;

/// Maximum triangles per leaf; fewer make the tree deeper, more make leaves slower
const LEAF_SIZE: usize = 4;

/// A mesh prepared for nearest point queries
///
/// # Examples
/// ```
/// use glam::DVec3;
/// use pirouette_geom::{TriMesh, nearest::NearestSurface};
/// let mesh = TriMesh {
///     positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
///     triangles: vec![[0, 1, 2]],
/// };
/// let found = NearestSurface::new(&mesh).nearest(DVec3::new(0.2, 0.2, 3.0)).unwrap();
/// assert_eq!((found.triangle, found.distance), (0, 3.0));
/// ```
#[derive(Debug, Clone)]
pub struct NearestSurface {
    /// In leaf order
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
}

/// A point of a surface
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Position
    pub position: DVec3,
    /// Index of its triangle in the mesh
    pub triangle: usize,
    /// Distance to the query point
    pub distance: f64,
}

#[derive(Debug, Clone, Copy)]
struct Triangle {
    corners: [DVec3; 3],
    index: u32,
}

impl Triangle {
    fn center(&self) -> DVec3 {
        self.corners.iter().sum::<DVec3>() / 3.0
    }
}

/// Bounding box of `triangles[first..end]`
#[derive(Debug, Clone, Copy)]
struct Node {
    low: DVec3,
    high: DVec3,
    first: u32,
    end: u32,
    /// Index of the first half, followed by the second; `None` in a leaf
    children: Option<u32>,
}

impl Node {
    fn new(triangles: &[Triangle], first: usize, end: usize) -> Self {
        let mut low = DVec3::splat(f64::INFINITY);
        let mut high = DVec3::splat(f64::NEG_INFINITY);
        for corner in triangles[first..end].iter().flat_map(|t| t.corners) {
            low = low.min(corner);
            high = high.max(corner);
        }
        Self {
            low,
            high,
            first: first as u32,
            end: end as u32,
            children: None,
        }
    }

    fn distance_squared(&self, point: DVec3) -> f64 {
        point.distance_squared(point.clamp(self.low, self.high))
    }
}

impl NearestSurface {
    /// Builds the tree of a mesh; triangles with non-finite corners are ignored
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist.
    pub fn new(mesh: &TriMesh) -> Self {
        let mut triangles: Vec<Triangle> = (0..mesh.triangles.len())
            .map(|index| Triangle {
                corners: mesh.corners(index),
                index: index as u32,
            })
            .filter(|t| t.corners.iter().all(|corner| corner.is_finite()))
            .collect();
        let mut nodes = Vec::new();
        if !triangles.is_empty() {
            nodes.push(Node::new(&triangles, 0, triangles.len()));
        }
        let mut at = 0;
        while let Some(node) = nodes.get(at).copied() {
            let (first, end) = (node.first as usize, node.end as usize);
            if end - first > LEAF_SIZE {
                let axis = (node.high - node.low).max_position();
                let half = (end - first) / 2;
                triangles[first..end].select_nth_unstable_by(half, |a, b| {
                    a.center()[axis].total_cmp(&b.center()[axis])
                });
                nodes[at].children = Some(nodes.len() as u32);
                nodes.push(Node::new(&triangles, first, first + half));
                nodes.push(Node::new(&triangles, first + half, end));
            }
            at += 1;
        }
        Self { triangles, nodes }
    }

    /// Returns the point of the surface nearest to `point`; `None` without triangles or for a non-finite point
    pub fn nearest(&self, point: DVec3) -> Option<SurfacePoint> {
        if !point.is_finite() {
            return None;
        }
        let root = self.nodes.first()?;
        let mut best: Option<SurfacePoint> = None;
        let mut best_squared = f64::INFINITY;
        let mut open = vec![(root.distance_squared(point), 0usize)];
        while let Some((off, at)) = open.pop() {
            if off >= best_squared {
                continue;
            }
            let node = &self.nodes[at];
            if let Some(child) = node.children {
                let [a, b] = [child as usize, child as usize + 1]
                    .map(|child| (self.nodes[child].distance_squared(point), child));
                // The nearer half is searched first.
                open.extend(if a.0 < b.0 { [b, a] } else { [a, b] });
                continue;
            }
            for triangle in &self.triangles[node.first as usize..node.end as usize] {
                let position = nearest_in_triangle(point, triangle.corners);
                let squared = point.distance_squared(position);
                if squared < best_squared {
                    best_squared = squared;
                    best = Some(SurfacePoint {
                        position,
                        triangle: triangle.index as usize,
                        distance: squared.sqrt(),
                    });
                }
            }
        }
        best
    }
}

/// Returns the point of a triangle nearest to `point`; triangles without area count as their sides
pub fn nearest_in_triangle(point: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let normal = (b - a).cross(c - a);
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|&(from, to)| normal.dot((to - from).cross(point - from)) >= 0.0);
    let area = normal.length_squared();
    if inside && area > 0.0 {
        return point - normal * ((point - a).dot(normal) / area);
    }
    let on_sides = [(a, b), (b, c), (c, a)].map(|(from, to)| nearest_on_side(point, from, to));
    let mut best = on_sides[0];
    for other in &on_sides[1..] {
        if point.distance_squared(*other) < point.distance_squared(best) {
            best = *other;
        }
    }
    best
}

fn nearest_on_side(point: DVec3, from: DVec3, to: DVec3) -> DVec3 {
    let side = to - from;
    let along = (point - from).dot(side) / side.length_squared();
    // A side of zero length has no direction.
    if along.is_nan() {
        return from;
    }
    from + side * along.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Searches all triangles
    fn nearest_reference(mesh: &TriMesh, point: DVec3) -> Option<f64> {
        (0..mesh.triangles.len())
            .map(|t| point.distance(nearest_in_triangle(point, mesh.corners(t))))
            .min_by(f64::total_cmp)
    }

    fn flat() -> [DVec3; 3] {
        [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0]
    }

    #[test]
    fn nearest_points_lie_in_the_face_on_a_side_or_at_a_corner() {
        let near = |x, y, z| nearest_in_triangle(DVec3::new(x, y, z), flat());
        assert_eq!(near(1.0, 1.0, 5.0), DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(near(1.0, -2.0, 1.0), DVec3::new(1.0, 0.0, 0.0));
        assert_eq!(near(4.0, 4.0, 0.0), DVec3::new(2.0, 2.0, 0.0));
        assert_eq!(near(-1.0, -1.0, 0.0), DVec3::ZERO);
    }

    #[test]
    fn a_triangle_without_area_counts_as_its_sides() {
        let line = [DVec3::ZERO, DVec3::X * 2.0, DVec3::X];
        let near = nearest_in_triangle(DVec3::new(1.5, 1.0, 0.0), line);
        assert!(near.distance(DVec3::X * 1.5) < 1e-12);
        let dot = [DVec3::Y; 3];
        assert_eq!(nearest_in_triangle(DVec3::X, dot), DVec3::Y);
    }

    #[test]
    fn a_mesh_without_triangles_has_no_nearest_point() {
        let empty = NearestSurface::new(&TriMesh::default());
        assert_eq!(empty.nearest(DVec3::ZERO), None);
        let mesh = TriMesh {
            positions: flat().to_vec(),
            triangles: vec![[0, 1, 2]],
        };
        let surface = NearestSurface::new(&mesh);
        assert_eq!(surface.nearest(DVec3::splat(f64::NAN)), None);
    }

    #[test]
    fn non_finite_triangles_are_ignored() {
        let mut positions = flat().to_vec();
        positions.push(DVec3::splat(f64::NAN));
        let mesh = TriMesh {
            positions,
            triangles: vec![[0, 1, 3], [0, 1, 2]],
        };
        let found = NearestSurface::new(&mesh).nearest(DVec3::new(1.0, 1.0, 1.0));
        assert_eq!(found.map(|f| (f.triangle, f.distance)), Some((1, 1.0)));
    }

    fn points(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<DVec3>> {
        let point = prop::array::uniform3(-10.0..10.0).prop_map(DVec3::from_array);
        prop::collection::vec(point, count)
    }

    proptest! {
        #[test]
        fn the_tree_agrees_with_a_search_of_all_triangles(
            positions in points(3..40),
            corners in prop::collection::vec(prop::array::uniform3(0usize..1000), 1..60),
            asked in points(1..10),
        ) {
            let count = positions.len();
            let triangles = corners
                .into_iter()
                .map(|t| t.map(|v| (v % count) as u32))
                .collect();
            let mesh = TriMesh { positions, triangles };
            let surface = NearestSurface::new(&mesh);
            for point in asked {
                let found = surface.nearest(point).unwrap();
                let expected = nearest_reference(&mesh, point).unwrap();
                prop_assert!((found.distance - expected).abs() < 1e-9);
                prop_assert!((point.distance(found.position) - expected).abs() < 1e-9);
                let own = nearest_in_triangle(point, mesh.corners(found.triangle));
                prop_assert!(own.distance(found.position) < 1e-9);
            }
        }

        #[test]
        fn no_point_of_the_triangle_is_nearer(
            corners in points(3..4),
            point in points(1..2),
            (s, t) in (0.0..1.0, 0.0..1.0f64),
        ) {
            let corners: [DVec3; 3] = corners.try_into().unwrap();
            let near = nearest_in_triangle(point[0], corners);
            let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
            let [a, b, c] = corners;
            let other = a + (b - a) * s + (c - a) * t;
            prop_assert!(point[0].distance(near) <= point[0].distance(other) + 1e-9);
        }
    }
}
