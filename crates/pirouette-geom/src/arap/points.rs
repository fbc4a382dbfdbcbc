//! Deformation of a mesh by pairs of points.

use glam::{DVec2, DVec3};

use super::{ArapError, ArapOptions, ArapSolver, ArapWeights};
use crate::planar_mesh::PlanarMesh;
use crate::tri_mesh::TriMesh;

/// Deforms a mesh in the xy plane: the vertices nearest to `sources` move to `targets`
///
/// z is unchanged. Distances are measured in the xy plane, in the unit of the mesh. The weights are
/// [`ArapWeights::Cotangent`].
///
/// # Errors
/// When the numbers of points differ, the mesh is empty or in another plane, a coordinate is not finite, a source is
/// farther from its nearest vertex than the edges there are long, or two sources would move one vertex to different
/// targets.
pub fn deform_points(
    mesh: &TriMesh,
    sources: &[DVec2],
    targets: &[DVec2],
    options: &ArapOptions,
) -> Result<TriMesh, ArapError> {
    if sources.len() != targets.len() {
        return Err(ArapError::UnequalCounts {
            sources: sources.len(),
            targets: targets.len(),
        });
    }
    if !sources.iter().chain(targets).all(|p| p.is_finite()) {
        return Err(ArapError::NotFinite);
    }
    let rest = PlanarMesh {
        positions: mesh.positions.iter().map(|p| p.truncate()).collect(),
        triangles: mesh.triangles.clone(),
    };
    check_plane(mesh)?;
    let handles = nearest_vertices(&rest, sources)?;
    let mut order: Vec<usize> = (0..handles.len()).collect();
    order.sort_by_key(|&point| handles[point]);
    for pair in order.windows(2) {
        let (first, second) = (pair[0], pair[1]);
        if handles[first] == handles[second] && targets[first] != targets[second] {
            return Err(ArapError::SharedVertex {
                first: first + 1,
                second: second + 1,
                vertex: handles[first],
            });
        }
    }
    order.dedup_by_key(|point| handles[*point]);
    let (constrained, targets): (Vec<u32>, Vec<DVec2>) = order
        .into_iter()
        .map(|point| (handles[point], targets[point]))
        .unzip();
    let solver = ArapSolver::with_weights(&rest, &constrained, ArapWeights::Cotangent)?;
    let deformation = solver.deform(&targets, options);
    let positions = deformation
        .positions
        .iter()
        .zip(&mesh.positions)
        .map(|(p, rest)| DVec3::new(p.x, p.y, rest.z))
        .collect();
    Ok(TriMesh {
        positions,
        triangles: mesh.triangles.clone(),
    })
}

/// Rejects a mesh whose triangles are not parallel to the xy plane
fn check_plane(mesh: &TriMesh) -> Result<(), ArapError> {
    /// Minimum share of the area of a mesh with relief that its projection to the xy plane has
    const MIN_SHARE: f64 = 0.7;
    let heights = mesh.positions.iter().map(|p| p.z);
    let flat =
        heights.clone().fold(f64::NEG_INFINITY, f64::max) <= heights.fold(f64::INFINITY, f64::min);
    if flat {
        return Ok(());
    }
    let (mut normal, mut area) = (DVec3::ZERO, 0.0);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.positions.get(v as usize).copied());
        let (Some(a), Some(b), Some(c)) = (a, b, c) else {
            continue;
        };
        let cross = (b - a).cross(c - a);
        normal += cross;
        area += cross.length();
    }
    let share = normal.abs() / area;
    if area <= 0.0 || share.z >= MIN_SHARE {
        return Ok(());
    }
    let plane = if share.y >= MIN_SHARE {
        "in the xz plane"
    } else if share.x >= MIN_SHARE {
        "in the yz plane"
    } else {
        "inclined or curved"
    };
    Err(ArapError::NotInPlane { plane })
}

/// Returns the vertex nearest to each source
fn nearest_vertices(rest: &PlanarMesh, sources: &[DVec2]) -> Result<Vec<u32>, ArapError> {
    let mut longest_edges = vec![0.0_f64; rest.positions.len()];
    for triangle in &rest.triangles {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = (triangle[from] as usize, triangle[to] as usize);
            let (Some(a), Some(b)) = (rest.positions.get(from), rest.positions.get(to)) else {
                continue;
            };
            let length = a.distance(*b);
            longest_edges[from] = longest_edges[from].max(length);
            longest_edges[to] = longest_edges[to].max(length);
        }
    }
    let nearest = |(index, &source): (usize, &DVec2)| {
        let distances = rest.positions.iter().map(|p| p.distance(source));
        let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let (vertex, distance) = nearest.ok_or(ArapError::EmptyMesh)?;
        let longest_edge = longest_edges[vertex];
        if distance > longest_edge {
            return Err(ArapError::FarSource {
                point: index + 1,
                distance,
                longest_edge,
            });
        }
        Ok(vertex as u32)
    };
    sources.iter().enumerate().map(nearest).collect()
}
