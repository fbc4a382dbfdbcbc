//! Plane sections of triangle meshes, their convex hulls, and the length of a tape around them.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use crate::tri_mesh::TriMesh;

/// Cuts a mesh by a plane and returns closed loops of points, in order
///
/// The plane passes through `origin`, perpendicular to `normal` (of any length). Seen from the tip of the normal,
/// loops run counter-clockwise around the solid and clockwise around its hollows. A vertex on the plane counts as
/// above it. Loops that do not close, because the mesh is open, are dropped. Returns no loops for a zero normal.
/// # Panics
/// When a triangle refers to a vertex that does not exist.
///
/// # Examples
/// ```
/// use glam::DVec3;
/// use pirouette_geom::{TriMesh, section::{plane_section, tape_length}};
/// let mesh = TriMesh {
///     positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
///     triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
/// };
/// let loops = plane_section(&mesh, DVec3::Z * 0.5, DVec3::Z);
/// assert_eq!(loops.len(), 1);
/// assert!((tape_length(&loops[0]) - (1.0 + 0.5f64.sqrt())).abs() < 1e-12);
/// ```
pub fn plane_section(mesh: &TriMesh, origin: DVec3, normal: DVec3) -> Vec<Vec<DVec3>> {
    let Some(normal) = normal.try_normalize() else {
        return Vec::new();
    };
    let heights: Vec<f64> = mesh
        .positions
        .iter()
        .map(|p| (*p - origin).dot(normal))
        .collect();
    let above = |v: u32| heights[v as usize] >= 0.0;
    // In every cut triangle, the section runs from the side that descends through the plane to the side that
    // ascends; the next triangle descends where this one ascends.
    let mut next: HashMap<[u32; 2], [u32; 2]> = HashMap::new();
    let mut starts = Vec::new();
    for &[a, b, c] in &mesh.triangles {
        let sides = [(a, b), (b, c), (c, a)];
        let down = sides.iter().find(|&&(from, to)| above(from) && !above(to));
        let up = sides.iter().find(|&&(from, to)| !above(from) && above(to));
        if let (Some(&down), Some(&up)) = (down, up) {
            let (down, up) = (edge(down), edge(up));
            next.insert(down, up);
            starts.push(down);
        }
    }
    let crossing = |[a, b]: [u32; 2]| {
        let (ha, hb) = (heights[a as usize], heights[b as usize]);
        let t = ha / (ha - hb);
        mesh.positions[a as usize].lerp(mesh.positions[b as usize], t)
    };
    let mut loops = Vec::new();
    for start in starts {
        let mut points: Vec<DVec3> = Vec::new();
        let mut at = start;
        while let Some(following) = next.remove(&at) {
            let point = crossing(at);
            if points.last() != Some(&point) {
                points.push(point);
            }
            at = following;
        }
        if points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        if at == start && points.len() >= 3 {
            loops.push(points);
        }
    }
    loops
}

fn edge((a, b): (u32, u32)) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Returns the convex hull of points, counter-clockwise (x right, y up), without points on its sides
///
/// Points with a non-finite coordinate are ignored. Inputs without area give one or two points.
///
/// # Source
/// A. Andrew 1979, "Another efficient algorithm for convex hulls in two dimensions".
///
/// # Examples
/// ```
/// use glam::DVec2;
/// use pirouette_geom::section::convex_hull;
/// let points = [(0.0, 0.0), (2.0, 0.0), (1.0, 0.5), (1.0, 0.0), (0.0, 2.0)].map(DVec2::from);
/// assert_eq!(convex_hull(&points), [points[0], points[1], points[4]]);
/// ```
pub fn convex_hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted: Vec<DVec2> = points.iter().copied().filter(|p| p.is_finite()).collect();
    sorted.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let chain = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(p - b) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        // Its last point begins the other chain.
        chain.pop();
        chain
    };
    let mut hull = chain(&mut sorted.iter().copied());
    hull.extend(chain(&mut sorted.iter().rev().copied()));
    hull
}

/// Returns the length of the closed polyline through points
pub fn perimeter(points: &[DVec2]) -> f64 {
    let following = points.iter().cycle().skip(1);
    points
        .iter()
        .zip(following)
        .map(|(a, b)| a.distance(*b))
        .sum()
}

/// Returns the unit normal of a closed loop, counter-clockwise around its tip; `None` for a loop without area
pub fn loop_normal(points: &[DVec3]) -> Option<DVec3> {
    let center = *points.first()?;
    let following = points.iter().skip(1).zip(points.iter().skip(2));
    following
        .map(|(a, b)| (*a - center).cross(*b - center))
        .sum::<DVec3>()
        .try_normalize()
}

/// Computes the length of a taut tape around a closed loop: the perimeter of its convex hull
///
/// A loop that is not planar is measured in the plane in which its area is largest. Zero without area.
///
/// # Examples
/// ```
/// use glam::DVec3;
/// use pirouette_geom::section::tape_length;
/// let dented = [(0.0, 0.0), (2.0, 0.0), (1.0, 0.5), (2.0, 2.0), (0.0, 2.0)]
///     .map(|(x, y)| DVec3::new(x, 7.0, y));
/// assert!((tape_length(&dented) - 8.0).abs() < 1e-12);
/// ```
pub fn tape_length(points: &[DVec3]) -> f64 {
    let Some(normal) = loop_normal(points) else {
        return 0.0;
    };
    let (u, v) = normal.any_orthonormal_pair();
    let flat: Vec<DVec2> = points
        .iter()
        .map(|p| DVec2::new(p.dot(u), p.dot(v)))
        .collect();
    perimeter(&convex_hull(&flat))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isosurface::{SurfaceOptions, extract_surface};
    use glam::DQuat;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn torus() -> TriMesh {
        let options = SurfaceOptions {
            lo: DVec3::splat(-1.6),
            hi: DVec3::splat(1.6),
            cell_size: 0.08,
            lipschitz: 1.0,
            secant_steps: 1,
            thin_pieces: true,
        };
        let field = |p: DVec3| DVec2::new(p.x.hypot(p.z) - 1.0, p.y).length() - 0.4;
        extract_surface(field, &options).expect("the options are sound")
    }

    fn signed_area(points: &[DVec3]) -> f64 {
        let following = points.iter().cycle().skip(1);
        // Counter-clockwise seen from +y: z to x
        let cross = |(a, b): (&DVec3, &DVec3)| a.z * b.x - a.x * b.z;
        points.iter().zip(following).map(cross).sum::<f64>() / 2.0
    }

    #[test]
    fn a_torus_has_an_outer_and_an_inner_loop() {
        let mut areas: Vec<f64> = plane_section(&torus(), DVec3::Y * 0.013, DVec3::Y)
            .iter()
            .map(|points| signed_area(points))
            .collect();
        areas.sort_by(f64::total_cmp);
        assert_eq!(areas.len(), 2);
        assert!((areas[0] + PI * 0.36).abs() < 0.02, "{areas:?}");
        assert!((areas[1] - PI * 1.96).abs() < 0.03, "{areas:?}");
        let across = plane_section(&torus(), DVec3::ZERO, DVec3::X);
        assert_eq!(across.len(), 2);
        for points in across {
            assert!((tape_length(&points) - PI * 0.8).abs() < 0.02);
            let normal = loop_normal(&points).expect("the loop has an area");
            assert!((normal - DVec3::X).length() < 1e-9);
        }
    }

    #[test]
    fn planes_through_vertices_and_edges_are_handled() {
        let octahedron = TriMesh {
            positions: vec![
                DVec3::X,
                DVec3::Z,
                -DVec3::X,
                -DVec3::Z,
                DVec3::Y,
                -DVec3::Y,
            ],
            triangles: vec![
                [1, 0, 4],
                [2, 1, 4],
                [3, 2, 4],
                [0, 3, 4],
                [0, 1, 5],
                [1, 2, 5],
                [2, 3, 5],
                [3, 0, 5],
            ],
        };
        assert_eq!(octahedron.check(), Ok(()));
        let loops = plane_section(&octahedron, DVec3::ZERO, DVec3::Y * 3.0);
        assert_eq!(loops.len(), 1);
        assert_eq!(loops[0].len(), 4);
        assert!((tape_length(&loops[0]) - 4.0 * 2f64.sqrt()).abs() < 1e-12);
        assert!((signed_area(&loops[0]) - 2.0).abs() < 1e-12);
        for (origin, normal) in [
            (DVec3::Y, DVec3::Y),
            (DVec3::Y * 5.0, DVec3::Y),
            (DVec3::ZERO, DVec3::ZERO),
            (DVec3::NAN, DVec3::Y),
        ] {
            assert!(plane_section(&octahedron, origin, normal).is_empty());
        }
    }

    #[test]
    fn loops_of_open_meshes_are_dropped() {
        let mut open = torus();
        let all = plane_section(&open, DVec3::ZERO, DVec3::X).len();
        open.triangles.retain(|t| {
            let center: DVec3 = t.iter().map(|&v| open.positions[v as usize]).sum();
            center.y < 3.0 * 0.38 || center.z < 0.0
        });
        assert_eq!(plane_section(&open, DVec3::ZERO, DVec3::X).len(), all - 1);
    }

    #[test]
    fn hulls_of_degenerate_inputs() {
        assert!(convex_hull(&[]).is_empty());
        assert!(convex_hull(&[DVec2::NAN]).is_empty());
        assert_eq!(convex_hull(&[DVec2::X; 3]), [DVec2::X]);
        let line = [0.0, 2.0, 1.0].map(|x| DVec2::new(x, x));
        assert_eq!(convex_hull(&line), [line[0], line[1]]);
        assert!(tape_length(&[DVec3::X; 5]).abs() < 1e-12);
        assert!(tape_length(&[]).abs() < 1e-12);
    }

    /// Sums the sides of the hull: pairs of points whose line has all other points on one side
    fn convex_hull_reference(points: &[DVec2]) -> f64 {
        let mut length = 0.0;
        for a in points {
            for b in points {
                let on_left = |p: &DVec2| (*b - *a).perp_dot(*p - *a) >= 0.0;
                if a != b && points.iter().all(on_left) {
                    length += a.distance(*b);
                }
            }
        }
        length
    }

    proptest! {
        #[test]
        fn the_hull_is_as_long_as_its_supporting_sides(
            points in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 3..30),
        ) {
            let points: Vec<DVec2> = points.into_iter().map(DVec2::from).collect();
            let hull = convex_hull(&points);
            prop_assert!((perimeter(&hull) - convex_hull_reference(&points)).abs() < 1e-9);
            prop_assert!(hull.iter().all(|p| points.contains(p)));
        }

        #[test]
        fn a_rigid_motion_moves_the_section(
            axis in prop::array::uniform3(-1.0..1.0f64),
            angle in -3.0..3.0f64,
            shift in prop::array::uniform3(-5.0..5.0f64),
        ) {
            let Some(axis) = DVec3::from_array(axis).try_normalize() else {
                return Ok(());
            };
            let (turn, shift) = (DQuat::from_axis_angle(axis, angle), DVec3::from_array(shift));
            let ball = |p: DVec3| turn.inverse() * (p - shift);
            // A section of the torus whose plane stays away from vertices
            let rest = torus();
            let (origin, normal) = (DVec3::new(0.0111, 0.0713, 0.0), DVec3::new(0.2, 1.0, 0.1));
            let mut moved = rest.clone();
            for p in &mut moved.positions {
                *p = turn * *p + shift;
            }
            let before = plane_section(&rest, origin, normal);
            let after = plane_section(&moved, turn * origin + shift, turn * normal);
            prop_assert_eq!(before.len(), after.len());
            for (a, b) in before.iter().zip(&after) {
                prop_assert!((tape_length(a) - tape_length(b)).abs() < 1e-9);
                for (p, q) in a.iter().zip(b) {
                    prop_assert!((*p - ball(*q)).length() < 1e-9);
                }
            }
        }
    }
}
