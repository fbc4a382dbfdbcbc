//! Indexed triangle meshes in space: normals, volume, adjacency, checks.

use glam::DVec3;

/// An indexed triangle mesh; counter-clockwise triangles seen from outside
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriMesh {
    /// One point per vertex
    pub positions: Vec<DVec3>,
    /// Three vertex indices per triangle
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// The corners of a triangle
    ///
    /// # Panics
    /// When the triangle or one of its vertices does not exist.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// Signed volume, positive for a closed mesh whose triangles face outward
    pub fn volume(&self) -> f64 {
        (0..self.triangles.len())
            .map(|t| {
                let [a, b, c] = self.corners(t);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    /// Area-weighted unit normals, one per vertex; zero where a vertex has no area around it
    pub fn vertex_normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.positions.len()];
        for (t, triangle) in self.triangles.iter().enumerate() {
            let [a, b, c] = self.corners(t);
            let normal = (b - a).cross(c - a);
            for &v in triangle {
                normals[v as usize] += normal;
            }
        }
        for normal in &mut normals {
            *normal = normal.try_normalize().unwrap_or(DVec3::ZERO);
        }
        normals
    }

    /// Smallest and largest coordinates, `None` without vertices
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let first = *self.positions.first()?;
        Some(
            self.positions
                .iter()
                .fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p))),
        )
    }
}
