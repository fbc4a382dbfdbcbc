//! Planar triangle meshes of silhouettes: constrained Delaunay triangulation of contours with holes.
//!
//! Any finite input gives a mesh of the enclosed area: contours may touch or cross themselves and each other, run
//! back and forth over one-pixel bridges, or repeat points. Inside is where the winding number is not zero, as in
//! [`crate::coverage::fill_edges`]. Only input that encloses no area is rejected.
//!
//! Coordinates are rounded to 1/1024 px, which makes all decisions about crossings exact. Triangle angles are not
//! bounded: short contour edges can cause thin triangles.

mod apart;
mod arrange;
mod near;

pub use apart::simplify_apart;

use glam::DVec2;
use spade::handles::{DirectedEdgeHandle, FixedFaceHandle};
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

use crate::contour::Contour;
use arrange::{Arrangement, Inside, from_grid, to_grid};
use near::SegmentIndex;

/// A triangle mesh in the plane
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlanarMesh {
    /// One point per vertex, in px
    pub positions: Vec<DVec2>,
    /// Three vertices per triangle; signed areas are positive, like those of outer contours
    pub triangles: Vec<[u32; 3]>,
}

/// Density of the vertices inside the contours
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangulateOptions {
    /// Adds evenly spaced points for triangles of at most about this area, in square px; smaller ones bend more
    /// smoothly and take more time; `None` adds no points
    ///
    /// Long contour edges are split to match. Single triangles may be up to twice as large.
    pub max_area: Option<f64>,
    /// Minimum distance of interior points in px: nearer to a contour they count as outside, nearer to each other they
    /// share a vertex
    pub clearance: f64,
}

impl Default for TriangulateOptions {
    /// 250 square px: finer and coarser meshes deform silhouettes 800 px high equally well
    fn default() -> Self {
        Self {
            max_area: Some(250.0),
            clearance: 1.0,
        }
    }
}

impl TriangulateOptions {
    /// Returns the spacing of the interior points, in px; longer contour edges are split
    pub fn spacing_px(&self) -> Option<f64> {
        // Half the area, because triangles between the even points and the contour come out larger.
        let equilateral = self.max_area.filter(|&area| area > 0.0)? / 2.0;
        Some((4.0 * equilateral / 3.0_f64.sqrt()).sqrt())
    }
}

/// A mesh, and the vertices of the points it was made from
#[derive(Debug, Clone)]
pub struct PlanarTriangulation {
    /// The mesh
    pub mesh: PlanarMesh,
    /// Vertex of each point of each contour; `None` where the contour encloses nothing (on bridges)
    pub contour_vertices: Vec<Vec<Option<u32>>>,
    /// Vertex of each interior point; `None` if it lies outside or on a contour
    pub interior_vertices: Vec<Option<u32>>,
}

/// Error of contours that cannot be triangulated
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TriangulateError {
    /// A coordinate is NaN, infinite or too large
    #[error(
        "coordinate ({x}, {y}) px is not finite or exceeds {} px",
        arrange::MAX_COORDINATE_PX
    )]
    BadCoordinate {
        /// x in px
        x: f64,
        /// y in px
        y: f64,
    },
    /// The contours enclose no area
    #[error("the contours enclose no area")]
    NoArea,
}

/// Maximum number of evenly spaced points; the spacing is widened beyond
///
/// Bounds memory for huge contours with small triangles; a silhouette takes about a thousand.
const MAX_FILL_POINTS: f64 = 500_000.0;

/// Triangulates the area enclosed by closed contours, with additional vertices inside
///
/// Outer contours must have positive signed area and holes negative, otherwise holes count as filled.
///
/// # Errors
/// When a coordinate is not finite or beyond 131072 px, or the contours enclose no area.
///
/// # Source
/// Constrained Delaunay triangulation: Chew 1989; the triangulation itself is the crate `spade`.
pub fn triangulate(
    contours: &[Contour],
    interior: &[DVec2],
    options: &TriangulateOptions,
) -> Result<PlanarTriangulation, TriangulateError> {
    let all_points = contours.iter().flat_map(|c| &c.points).chain(interior);
    for &DVec2 { x, y } in all_points {
        // written so that NaN is rejected
        if !(x.abs() <= arrange::MAX_COORDINATE_PX && y.abs() <= arrange::MAX_COORDINATE_PX) {
            return Err(TriangulateError::BadCoordinate { x, y });
        }
    }
    let mut arrangement = arrange::arrange(contours.iter().map(|c| c.points.as_slice()));
    let (low, high) = bounds(&arrangement).ok_or(TriangulateError::NoArea)?;
    let spacing = options
        .spacing_px()
        .map(|spacing| bounded_spacing(spacing, high - low));
    if let Some(spacing) = spacing {
        arrangement.subdivide(spacing);
    }

    let mut vertices = Vertices::on_edges(&arrangement);
    let radius = spacing.unwrap_or(0.0).max(options.clearance);
    let mut obstacles = SegmentIndex::new(low, high, radius, arrangement.edges.len());
    for edge in &arrangement.edges {
        let (a, b) = arrangement.ends(edge);
        obstacles.insert(a, b);
    }
    let interior_of: Vec<Option<u32>> =
        place_interior(&arrangement, &obstacles, interior, options, &mut vertices);
    if let Some(spacing) = spacing {
        for &p in &vertices.positions[vertices.contour_count..] {
            obstacles.insert(p, p);
        }
        fill(&arrangement, &obstacles, low, high, spacing, &mut vertices);
    }

    let triangles = inner_triangles(&arrangement, &vertices);
    if triangles.is_empty() {
        return Err(TriangulateError::NoArea);
    }
    let contour_of = arrangement.loop_points.iter().map(|points| {
        points
            .iter()
            .map(|&p| vertices.of_point[p as usize])
            .collect()
    });
    Ok(compact(
        &vertices.positions,
        triangles,
        contour_of.collect(),
        &interior_of,
    ))
}

/// Vertices before triangulation: first those on contours, then interior ones
struct Vertices {
    positions: Vec<DVec2>,
    contour_count: usize,
    /// Vertex of each point of the arrangement, if it is on an edge
    of_point: Vec<Option<u32>>,
}

impl Vertices {
    fn on_edges(arrangement: &Arrangement) -> Self {
        let mut of_point = vec![None; arrangement.points.len()];
        let mut positions = Vec::new();
        for edge in &arrangement.edges {
            for p in [edge.from, edge.to] {
                of_point[p as usize].get_or_insert_with(|| {
                    positions.push(from_grid(arrangement.points[p as usize]));
                    positions.len() as u32 - 1
                });
            }
        }
        Self {
            contour_count: positions.len(),
            positions,
            of_point,
        }
    }
}

fn bounds(arrangement: &Arrangement) -> Option<(DVec2, DVec2)> {
    let mut points = arrangement.edges.iter().flat_map(|edge| {
        let (a, b) = arrangement.ends(edge);
        [a, b]
    });
    let first = points.next()?;
    Some(points.fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p))))
}

/// Widens the spacing where it would take too many points
fn bounded_spacing(spacing: f64, size: DVec2) -> f64 {
    spacing
        .max((size.x * size.y / MAX_FILL_POINTS).sqrt())
        .max(size.max_element() / MAX_FILL_POINTS)
        .max(4.0 * arrange::GRID_PX)
}

/// Adds the given interior points that lie inside; equal and close ones share a vertex
fn place_interior(
    arrangement: &Arrangement,
    obstacles: &SegmentIndex,
    interior: &[DVec2],
    options: &TriangulateOptions,
    vertices: &mut Vertices,
) -> Vec<Option<u32>> {
    // below one grid step, distinct points could round onto an edge
    let clearance = options.clearance.max(2.0 * arrange::GRID_PX);
    let inside = Inside::new(arrangement);
    let (low, high) = inside.bounds();
    let mut earlier = SegmentIndex::new(low, high, clearance, interior.len());
    let place = |&given: &DVec2| {
        let p = from_grid(to_grid(given));
        if !inside.contains(p) || obstacles.any_within(p, clearance) {
            return None;
        }
        let near = earlier.first_within(p, clearance);
        let place = near.unwrap_or(vertices.positions.len() - vertices.contour_count);
        if near.is_none() {
            vertices.positions.push(p);
            earlier.insert(p, p);
        }
        Some((vertices.contour_count + place) as u32)
    };
    interior.iter().map(place).collect()
}

/// Adds points on an equilateral triangle grid, at a distance from existing points and edges
fn fill(
    arrangement: &Arrangement,
    obstacles: &SegmentIndex,
    low: DVec2,
    high: DVec2,
    spacing: f64,
    vertices: &mut Vertices,
) {
    // A smaller distance to contours gives thin triangles, a larger one gives large triangles.
    let clearance = 0.6 * spacing;
    let row_height = spacing * 3.0_f64.sqrt() / 2.0;
    let rows = ((high.y - low.y) / row_height) as usize;
    for row in 0..=rows {
        let y = low.y + (row as f64 + 0.5) * row_height;
        let offset = low.x + spacing * if row % 2 == 0 { 0.25 } else { 0.75 };
        for (x0, x1) in arrangement.inside_spans(y) {
            let first = ((x0 - offset) / spacing).ceil() as i64;
            let last = ((x1 - offset) / spacing).floor() as i64;
            for i in first..=last {
                let p = from_grid(to_grid(DVec2::new(offset + i as f64 * spacing, y)));
                if !obstacles.any_within(p, clearance) {
                    vertices.positions.push(p);
                }
            }
        }
    }
}

/// Triangulates and keeps the triangles where the winding number is not zero
fn inner_triangles(arrangement: &Arrangement, vertices: &Vertices) -> Vec<[u32; 3]> {
    let points = vertices.positions.iter().map(|p| Point2::new(p.x, p.y));
    let mut constraints = Vec::with_capacity(arrangement.edges.len());
    let mut windings = Vec::with_capacity(arrangement.edges.len());
    for edge in &arrangement.edges {
        let [Some(a), Some(b)] =
            [edge.from, edge.to].map(|p| vertices.of_point[p as usize].map(|v| v as usize))
        else {
            continue;
        };
        constraints.push([a, b]);
        // In both directions, because lookups come from either side
        windings.push(((a, b), -edge.winding));
        windings.push(((b, a), edge.winding));
    }
    windings.sort_unstable_by_key(|&(ends, _)| ends);
    // The arrangement has no conflicts left and the coordinates are bounded, so neither the callback nor the error
    // occurs; an empty mesh is a safe fallback.
    let triangulation = ConstrainedDelaunayTriangulation::<Point2<f64>>::try_bulk_load_cdt(
        points.collect(),
        constraints,
        |_| {},
    );
    let Ok(triangulation) = triangulation else {
        return Vec::new();
    };
    debug_assert_eq!(triangulation.num_vertices(), vertices.positions.len());

    // Flood fill over the faces from outside; crossing a contour edge changes the winding number.
    let outside = triangulation.outer_face().fix();
    let mut winding_of: Vec<Option<i32>> = vec![None; triangulation.num_all_faces()];
    winding_of[outside.index()] = Some(0);
    let mut open: Vec<(FixedFaceHandle<_>, i32)> = vec![(outside, 0)];
    let mut cross = |edge: DirectedEdgeHandle<_, _, _, _>, winding, open: &mut Vec<_>| {
        let neighbor = edge.rev().face().fix();
        let slot = &mut winding_of[neighbor.index()];
        if slot.is_none() {
            let ends = (edge.from().fix().index(), edge.to().fix().index());
            let step = if edge.is_constraint_edge() {
                let found = windings.binary_search_by_key(&ends, |&(ends, _)| ends);
                found.map_or(0, |place| windings[place].1)
            } else {
                0
            };
            *slot = Some(winding + step);
            open.push((neighbor, winding + step));
        }
    };
    while let Some((face, winding)) = open.pop() {
        match triangulation.face(face).as_inner() {
            Some(inner) => {
                for edge in inner.adjacent_edges() {
                    cross(edge, winding, &mut open);
                }
            }
            None => {
                for edge in triangulation.convex_hull() {
                    // The direction of the hull edges is unknown; start from the outer face.
                    let from_outside = edge.face().fix() == face;
                    let edge = if from_outside { edge } else { edge.rev() };
                    cross(edge, winding, &mut open);
                }
            }
        }
    }
    triangulation
        .inner_faces()
        .filter(|face| winding_of[face.fix().index()].is_some_and(|w| w != 0))
        .map(|face| face.vertices().map(|v| v.fix().index() as u32))
        .collect()
}

/// Drops vertices without triangles
fn compact(
    positions: &[DVec2],
    mut triangles: Vec<[u32; 3]>,
    contour_of: Vec<Vec<Option<u32>>>,
    interior_of: &[Option<u32>],
) -> PlanarTriangulation {
    let mut renumbered: Vec<Option<u32>> = vec![None; positions.len()];
    for &v in triangles.iter().flatten() {
        renumbered[v as usize] = Some(0);
    }
    let mut kept = Vec::new();
    for (slot, &p) in renumbered.iter_mut().zip(positions) {
        if slot.is_some() {
            *slot = Some(kept.len() as u32);
            kept.push(p);
        }
    }
    let new = |v: Option<u32>| v.and_then(|v| renumbered[v as usize]);
    for v in triangles.iter_mut().flatten() {
        *v = renumbered[*v as usize].unwrap_or(0);
    }
    PlanarTriangulation {
        mesh: PlanarMesh {
            positions: kept,
            triangles,
        },
        contour_vertices: contour_of
            .into_iter()
            .map(|vertices| vertices.into_iter().map(new).collect())
            .collect(),
        interior_vertices: interior_of.iter().map(|&v| new(v)).collect(),
    }
}

/// Defect of a planar mesh
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PlanarMeshFault {
    /// A triangle refers to a vertex that does not exist
    #[error("triangle {triangle} refers to a missing vertex")]
    MissingVertex {
        /// The triangle
        triangle: usize,
    },
    /// A triangle has zero or negative area
    #[error("triangle {triangle} has no positive area")]
    NotPositive {
        /// The triangle
        triangle: usize,
    },
    /// Two triangles use an edge in the same direction
    #[error("the edge from vertex {from} to {to} is used twice in this direction")]
    EdgeUsedTwice {
        /// Where the edge starts
        from: u32,
        /// Where it ends
        to: u32,
    },
    /// A vertex belongs to no triangle
    #[error("vertex {vertex} belongs to no triangle")]
    LooseVertex {
        /// The vertex
        vertex: usize,
    },
}

impl PlanarMesh {
    /// Returns the signed area of one triangle, in square px
    ///
    /// # Panics
    /// When the triangle or one of its vertices does not exist.
    pub fn triangle_area(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.triangles[triangle].map(|v| self.positions[v as usize]);
        (b - a).perp_dot(c - a) / 2.0
    }

    /// Returns the sum of the signed areas of all triangles, in square px
    pub fn area(&self) -> f64 {
        (0..self.triangles.len())
            .map(|t| self.triangle_area(t))
            .sum()
    }

    /// Returns edges with a triangle on one side only, directed as in that triangle: around outer contours with
    /// positive signed area, around holes with negative
    pub fn boundary_edges(&self) -> Vec<[u32; 2]> {
        let mut edges = self.directed_edges();
        edges.sort_unstable_by_key(|&[a, b]| (a.min(b), a.max(b)));
        edges
            .chunk_by(|[a, b], [c, d]| (a.min(b), a.max(b)) == (c.min(d), c.max(d)))
            .filter(|users| users.len() == 1)
            .map(|users| users[0])
            .collect()
    }

    /// Checks that all triangles have positive area, edges are manifold and all vertices are used
    ///
    /// Contours that touch in a point make a vertex where several fans of triangles meet, which is accepted.
    ///
    /// # Errors
    /// The first fault found.
    pub fn check(&self) -> Result<(), PlanarMeshFault> {
        let mut used = vec![false; self.positions.len()];
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for &v in corners {
                let Some(slot) = used.get_mut(v as usize) else {
                    return Err(PlanarMeshFault::MissingVertex { triangle });
                };
                *slot = true;
            }
            if self.triangle_area(triangle) <= 0.0 || self.triangle_area(triangle).is_nan() {
                return Err(PlanarMeshFault::NotPositive { triangle });
            }
        }
        let mut edges = self.directed_edges();
        edges.sort_unstable();
        if let Some(pair) = edges.windows(2).find(|pair| pair[0] == pair[1]) {
            let [from, to] = pair[0];
            return Err(PlanarMeshFault::EdgeUsedTwice { from, to });
        }
        match used.iter().position(|&u| !u) {
            Some(vertex) => Err(PlanarMeshFault::LooseVertex { vertex }),
            None => Ok(()),
        }
    }

    fn directed_edges(&self) -> Vec<[u32; 2]> {
        self.triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .collect()
    }
}

#[cfg(test)]
mod tests;
