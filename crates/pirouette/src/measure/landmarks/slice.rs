//! Sections of a part of a body for tapes: the points on a plane, their hull, the vertices nearby.

use glam::{DVec2, DVec3};
use pirouette_geom::TriMesh;
use pirouette_geom::section::{convex_hull, perimeter};

/// Edges of a surface or of a part of it, each once
pub(super) struct Slicer<'a> {
    positions: &'a [DVec3],
    edges: Vec<[u32; 2]>,
}

/// The intersection of a plane with an edge
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    pub(super) edge: [u32; 2],
    pub(super) point: DVec3,
}

/// A plane by a point on it and its unit normal
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::measure) struct Plane {
    /// A point on it, in mm
    pub(in crate::measure) origin: DVec3,
    /// Unit normal
    pub(in crate::measure) normal: DVec3,
}

impl Plane {
    pub(super) fn level(y: f64) -> Self {
        Self {
            origin: DVec3::Y * y,
            normal: DVec3::Y,
        }
    }

    /// Returns the parallel plane at a distance along the normal
    pub(super) fn moved(self, by_mm: f64) -> Self {
        Self {
            origin: self.origin + self.normal * by_mm,
            ..self
        }
    }

    fn distance(&self, p: DVec3) -> f64 {
        (p - self.origin).dot(self.normal)
    }

    /// Returns coordinates within the plane, counter-clockwise seen from the side that the normal points to
    fn flatten(&self, p: DVec3) -> DVec2 {
        let u = self.normal.any_orthonormal_vector();
        let v = self.normal.cross(u);
        DVec2::new((p - self.origin).dot(u), (p - self.origin).dot(v))
    }
}

impl<'a> Slicer<'a> {
    pub(super) fn new(mesh: &'a TriMesh) -> Self {
        let mut edges: Vec<[u32; 2]> = mesh
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        Self {
            positions: &mesh.positions,
            edges,
        }
    }

    /// Both ends of each edge
    pub(super) fn edges(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        self.edges.iter().copied()
    }

    /// Collects the edges between vertices of a part
    pub(super) fn part(&self, part: &[bool]) -> Self {
        self.filtered(|[a, b]| part[a as usize] && part[b as usize])
    }

    /// Selects the edges that overlap a range of heights
    pub(super) fn between(&self, low: f64, high: f64) -> Self {
        self.filtered(|edge| {
            let [p, q] = edge.map(|v| self.positions[v as usize].y);
            p.min(q) <= high && p.max(q) >= low
        })
    }

    fn filtered(&self, keep: impl Fn([u32; 2]) -> bool) -> Self {
        let edges = self.edges.iter().copied();
        Self {
            positions: self.positions,
            edges: edges.filter(|&edge| keep(edge)).collect(),
        }
    }

    /// Returns the intersections of a plane with the edges
    pub(super) fn cut(&self, plane: Plane) -> Vec<Crossing> {
        let edges = self.edges.iter();
        edges
            .filter_map(|&edge| {
                let [p, q] = edge.map(|v| self.positions[v as usize]);
                let (dp, dq) = (plane.distance(p), plane.distance(q));
                // A vertex on the plane counts as above it, so every edge has two sides.
                ((dp < 0.0) != (dq < 0.0)).then(|| Crossing {
                    edge,
                    point: p.lerp(q, dp / (dp - dq)),
                })
            })
            .collect()
    }

    /// Returns the length of a taut tape around the points on a plane, in mm; 0 without a section
    pub(super) fn girth(&self, plane: Plane) -> f64 {
        let crossings = self.cut(plane);
        let points: Vec<DVec2> = crossings.iter().map(|c| plane.flatten(c.point)).collect();
        perimeter(&convex_hull(&points))
    }

    /// Returns the points of a section, and the vertices next to it around its center
    ///
    /// Each cut edge contributes its nearer end; they are sorted by direction, which is the order along the tape for
    /// any section that is star-shaped around its center. `None` with fewer than three.
    pub(super) fn tape(&self, plane: Plane) -> Option<(Vec<DVec3>, Vec<u32>)> {
        let crossings = self.cut(plane);
        let count = crossings.len() as f64;
        let center = crossings.iter().map(|c| c.point).sum::<DVec3>() / count;
        let middle = plane.flatten(center);
        let mut around: Vec<(f64, u32)> = crossings
            .iter()
            .map(|crossing| {
                let [a, b] = crossing.edge;
                let distance = |v: u32| plane.distance(self.positions[v as usize]).abs();
                let nearer = if distance(a) <= distance(b) { a } else { b };
                let flat = plane.flatten(self.positions[nearer as usize]) - middle;
                (flat.y.atan2(flat.x), nearer)
            })
            .collect();
        around.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        around.dedup_by_key(|entry| entry.1);
        let vertices: Vec<u32> = around.into_iter().map(|(_, vertex)| vertex).collect();
        let points = crossings.iter().map(|c| c.point).collect();
        (vertices.len() >= 3).then_some((points, vertices))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tape_around_a_tube_is_its_hull_in_order() {
        // a tube of six columns with one dent, level edges at y = 0 and y = 10
        let ring: Vec<DVec2> = [
            (2.0, 0.0),
            (1.0, 2.0),
            (-1.0, 2.0),
            (-2.0, 0.0),
            (0.0, -0.5),
            (2.0, -2.0),
        ]
        .map(DVec2::from)
        .to_vec();
        let at = |y: f64| ring.iter().map(move |p| DVec3::new(p.x, y, -p.y));
        let mesh = TriMesh {
            positions: at(0.0).chain(at(10.0)).collect(),
            triangles: (0..6u32)
                .flat_map(|i| {
                    let j = (i + 1) % 6;
                    [[i, j, i + 6], [j, j + 6, i + 6]]
                })
                .collect(),
        };
        let slicer = Slicer::new(&mesh);
        let plane = Plane::level(3.0);
        let expected = {
            let taut: Vec<DVec2> = [0, 1, 2, 3, 5].map(|i: usize| ring[i]).to_vec();
            perimeter(&taut)
        };
        assert!((slicer.girth(plane) - expected).abs() < 1e-9);
        let (_, tape) = slicer.tape(plane).unwrap();
        let start = tape.iter().position(|&v| v == 0).unwrap();
        let around: Vec<u32> = (0..6).map(|i| tape[(start + i) % 6]).collect();
        assert_eq!(around, [0, 1, 2, 3, 4, 5]);

        let half = [true, true, true, true, false, false].repeat(2);
        assert!(slicer.part(&half).girth(plane) < expected);
        assert!(slicer.girth(Plane::level(20.0)).abs() < 1e-12);
        assert!(slicer.tape(Plane::level(20.0)).is_none());
    }
}
