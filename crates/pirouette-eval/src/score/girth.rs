//! Girths of the trunk at given heights.

use glam::{DVec2, DVec3};
use pirouette_geom::TriMesh;
use pirouette_geom::section::{convex_hull, perimeter, plane_section};

/// Minimum width of a section loop of the trunk, in mm; arms and thighs are narrower
const MIN_TRUNK_MM: f64 = 180.0;

/// Vertices within this distance of the height locate the trunk, in mm
const LEVEL_SLACK_MM: f64 = 15.0;

/// Returns the tape length around the trunk at a height above the soles, in mm; `None` if there is no trunk
///
/// Of several wide loops of the section, the one nearest to the middle of the surface at that height is used.
pub fn trunk_girth(body: &TriMesh, height_mm: f64) -> Option<f64> {
    let level = body.bounds()?.0.y + height_mm;
    let flat = |p: &DVec3| DVec2::new(p.x, p.z);
    let near: Vec<DVec2> = body
        .positions
        .iter()
        .filter(|p| (p.y - level).abs() < LEVEL_SLACK_MM)
        .map(flat)
        .collect();
    let middle = DVec2::new(median(&near, 0)?, median(&near, 1)?);
    let loops = plane_section(body, DVec3::Y * level, DVec3::Y);
    let trunk = loops
        .iter()
        .map(|points| points.iter().map(flat).collect::<Vec<DVec2>>())
        .filter(|points| {
            let (first, rest) = (points[0], &points[1..]);
            let low = rest.iter().fold(first, |low, p| low.min(*p));
            let high = rest.iter().fold(first, |high, p| high.max(*p));
            (high - low).max_element() > MIN_TRUNK_MM
        })
        .min_by(|a, b| {
            let off = |points: &[DVec2]| {
                (points.iter().sum::<DVec2>() / points.len() as f64).distance_squared(middle)
            };
            off(a).total_cmp(&off(b))
        })?;
    Some(perimeter(&convex_hull(&trunk)))
}

fn median(points: &[DVec2], axis: usize) -> Option<f64> {
    let values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
    crate::table::percentile(&values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Builds upright prisms with square bases, given as `(middle x, side, top)`
    fn towers(towers: &[(f64, f64, f64)]) -> TriMesh {
        let mut mesh = TriMesh::default();
        for &(x, side, top) in towers {
            let base = mesh.positions.len() as u32;
            let h = side / 2.0;
            for y in [5.0, 5.0 + top] {
                for (dx, dz) in [(-h, -h), (h, -h), (h, h), (-h, h)] {
                    mesh.positions.push(DVec3::new(x + dx, y, dz));
                }
            }
            let quads = [
                [0, 1, 2, 3],
                [4, 7, 6, 5],
                [0, 4, 5, 1],
                [1, 5, 6, 2],
                [2, 6, 7, 3],
                [3, 7, 4, 0],
            ];
            for [a, b, c, d] in quads.map(|q| q.map(|v| v + base)) {
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh
    }

    #[test]
    fn the_trunk_is_measured_without_the_arm_next_to_it() {
        // Vertices at the queried height are those of the low wide tower's top.
        let body = towers(&[(0.0, 250.0, 1000.0), (300.0, 100.0, 1000.0)]);
        let girth = trunk_girth(&body, 990.0);
        assert!((girth.unwrap() - 1000.0).abs() < 1e-9, "{girth:?}");
    }

    #[test]
    fn a_narrow_section_is_not_a_trunk() {
        let body = towers(&[(0.0, 100.0, 1000.0)]);
        assert_eq!(trunk_girth(&body, 995.0), None);
        assert_eq!(trunk_girth(&TriMesh::default(), 995.0), None);
    }
}
