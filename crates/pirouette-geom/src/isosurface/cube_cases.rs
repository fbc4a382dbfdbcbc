//! The 256 cases of a surface cutting a cube, triangulated so that neighboring cubes always match.
//!
//! Corner `c` of the unit cube has the coordinates `(c & 1, c >> 1 & 1, c >> 2)`. Edge `4 a + k` runs along axis
//! `a` from its lower corner, the `k`-th of the four that have bit `a` unset.

use std::sync::LazyLock;

/// Number of edges; polygon centers have indices from this on
pub(super) const EDGE_COUNT: u8 = 12;

/// Surface patch of a cube with a given set of corners inside
#[derive(Debug, Default)]
pub(super) struct CubeCase {
    /// Edges that the surface cuts
    pub(super) edges: Vec<u8>,
    /// Triangles of these edges, counter-clockwise seen from outside the solid; an index from [`EDGE_COUNT`] on is
    /// the center of a polygon
    pub(super) triangles: Vec<[u8; 3]>,
    /// Edges around each polygon that needs a center
    pub(super) centers: Vec<Vec<u8>>,
}

/// Cases by set of inside corners (bit `c` for corner `c`)
pub(super) static CASES: LazyLock<Vec<CubeCase>> =
    LazyLock::new(|| (0..=u8::MAX).map(CubeCase::new).collect());

/// Returns the lower corner of an edge
pub(super) fn lower_corner(edge: u8) -> u8 {
    let (axis, k) = (edge / 4, edge % 4);
    let low = k & ((1 << axis) - 1);
    ((k - low) << 1) | low
}

/// Returns the edge along `axis` at `corner`
fn edge_at(corner: u8, axis: u8) -> u8 {
    let low = corner & ((1 << axis) - 1);
    4 * axis + ((corner >> (axis + 1)) << axis) + low
}

/// Whether both edges lie on one face of the cube
fn on_one_face(a: u8, b: u8) -> bool {
    let faces = |edge: u8| {
        let (axis, corner) = (edge / 4, lower_corner(edge));
        [(axis + 1) % 3, (axis + 2) % 3].map(|other| (other, (corner >> other) & 1))
    };
    faces(a).iter().any(|face| faces(b).contains(face))
}

impl CubeCase {
    fn new(inside: u8) -> Self {
        // On every face, seen from outside the cube, the surface runs from where a walk around the face enters the
        // solid to where it leaves it. The rule depends only on the four corners of the face, so that both cubes at a
        // face agree; diagonal inside corners are not connected.
        let mut next = [None; EDGE_COUNT as usize];
        for axis in 0..3u8 {
            let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in 0..2u8 {
                let mut walk = [(0, 0), (1, 0), (1, 1), (0, 1)]
                    .map(|(u, v)| (side << axis) | (u << b) | (v << c));
                if side == 0 {
                    walk.reverse();
                }
                let is_inside = |i: usize| (inside >> walk[i % 4]) & 1 == 1;
                let edge_after = |i: usize| {
                    let (from, to) = (walk[i % 4], walk[(i + 1) % 4]);
                    edge_at(from.min(to), (from ^ to).trailing_zeros() as u8)
                };
                for start in (0..4).filter(|&i| !is_inside(i) && is_inside(i + 1)) {
                    let end = (start + 1..start + 4).find(|&i| !is_inside(i + 1));
                    let end = end.expect("a walk that enters the solid leaves it again");
                    next[edge_after(start) as usize] = Some(edge_after(end));
                }
            }
        }
        let cut = |edge: &u8| next[usize::from(*edge)].is_some();
        let mut case = Self {
            edges: (0..EDGE_COUNT).filter(cut).collect(),
            ..Self::default()
        };
        for first in 0..EDGE_COUNT {
            let mut polygon = Vec::new();
            let mut edge = first;
            while let Some(following) = next[edge as usize].take() {
                polygon.push(edge);
                edge = following;
            }
            if polygon.is_empty() {
                continue;
            }
            if !fill(&polygon, &mut case.triangles) {
                let center = EDGE_COUNT + case.centers.len() as u8;
                for i in 0..polygon.len() {
                    let following = polygon[(i + 1) % polygon.len()];
                    case.triangles.push([center, polygon[i], following]);
                }
                case.centers.push(polygon);
            }
        }
        case
    }
}

/// Triangulates a polygon without diagonals on a face of the cube, where the neighboring cube could have them too
///
/// Returns whether this is possible; otherwise `triangles` is unchanged.
fn fill(polygon: &[u8], triangles: &mut Vec<[u8; 3]>) -> bool {
    let n = polygon.len();
    if n < 3 {
        return true;
    }
    let (first, last) = (polygon[0], polygon[n - 1]);
    let before = triangles.len();
    for k in 1..n - 1 {
        let tip = polygon[k];
        let left_allowed = k == 1 || !on_one_face(first, tip);
        let right_allowed = k == n - 2 || !on_one_face(tip, last);
        if left_allowed && right_allowed {
            triangles.push([first, tip, last]);
            if fill(&polygon[..=k], triangles) && fill(&polygon[k..], triangles) {
                return true;
            }
            triangles.truncate(before);
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_have_the_right_corners() {
        for edge in 0..EDGE_COUNT {
            let corner = lower_corner(edge);
            assert_eq!((corner >> (edge / 4)) & 1, 0);
            assert_eq!(edge_at(corner, edge / 4), edge);
        }
    }

    #[test]
    fn one_corner_is_cut_off_by_one_triangle_that_faces_away() {
        assert_eq!(CASES[1].triangles.len(), 1);
        let mut triangle = CASES[1].triangles[0];
        let smallest = triangle
            .iter()
            .position(|&e| e == 0)
            .expect("the x edge is cut");
        triangle.rotate_left(smallest);
        assert_eq!(triangle, [0, 4, 8]);
    }

    #[test]
    fn exactly_the_cut_edges_are_used() {
        for (inside, case) in CASES.iter().enumerate() {
            for edge in 0..EDGE_COUNT {
                let corner = lower_corner(edge);
                let other = corner | 1 << (edge / 4);
                let cut = (inside >> corner) & 1 != (inside >> other) & 1;
                let used = case.triangles.iter().flatten().any(|&e| e == edge);
                assert_eq!(cut, used, "case {inside}, edge {edge}");
                assert_eq!(
                    cut,
                    case.edges.contains(&edge),
                    "case {inside}, edge {edge}"
                );
            }
        }
    }

    #[test]
    fn diagonals_stay_inside_the_cube() {
        for (inside, case) in CASES.iter().enumerate() {
            let mut directed: Vec<(u8, u8)> = Vec::new();
            for t in &case.triangles {
                directed.extend([(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]);
            }
            for &(a, b) in &directed {
                assert_eq!(directed.iter().filter(|&&e| e == (a, b)).count(), 1);
                let inner = directed.contains(&(b, a));
                if inner && a < EDGE_COUNT && b < EDGE_COUNT {
                    assert!(!on_one_face(a, b), "case {inside}: {a} to {b}");
                }
            }
        }
    }
}
