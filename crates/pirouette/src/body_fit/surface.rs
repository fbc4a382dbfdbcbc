//! Parameters of the fitted surface: displacements of a coarse mesh on some of its vertices.

use glam::DVec3;
use pirouette_geom::coarsen::{CoarseMesh, coarsen_levels};

use pirouette_body::{Avatar, Bone};

/// Number of vertices to which the smoothness weights refer
///
/// The energies are sums over vertices; with more vertices, each has less weight.
const NOMINAL_COUNT: f64 = 3500.0;

/// Bending stiffness factors of hands, and of feet and head
///
/// Hands are a few pixels wide: their shape is that of the avatar.
const HAND_STIFFNESS: f64 = 5.0;
const END_STIFFNESS: f64 = 1.5;

/// Search radius for mirrored vertices, relative to the stature
const MIRROR_TOLERANCE: f64 = 0.001;

/// A coarse mesh on an avatar's vertices, with its bending properties
#[derive(Debug, Clone)]
pub(super) struct Surface {
    pub(super) coarse: CoarseMesh,
    /// Neighbors of each coarse vertex
    pub(super) neighbors: Vec<Vec<u32>>,
    /// Bending stiffness of each coarse vertex
    pub(super) stiffness: Vec<f64>,
    /// Mirrored coarse vertex of each one; itself on the mirror plane, `None` without one
    pub(super) mirror: Vec<Option<u32>>,
}

impl Surface {
    /// Creates surfaces with about these numbers of coarse vertices, in descending order, each a subset of the previous
    pub(super) fn levels(avatar: &Avatar, coarse_counts: &[usize]) -> Vec<Self> {
        let tolerance_mm = MIRROR_TOLERANCE * avatar.stature_mm();
        let mirror = mirror_vertices(&avatar.mesh.positions, tolerance_mm);
        let mirror = mirror.as_deref();
        coarsen_levels(&avatar.mesh, coarse_counts, mirror)
            .into_iter()
            .map(|coarse| Self::new(avatar, coarse, mirror))
            .collect()
    }

    fn new(avatar: &Avatar, coarse: CoarseMesh, mirror: Option<&[u32]>) -> Self {
        let mut neighbors = vec![Vec::new(); coarse.vertices.len()];
        for triangle in &coarse.triangles {
            for k in 0..3 {
                let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
                neighbors[a as usize].push(b);
                neighbors[b as usize].push(a);
            }
        }
        for around in &mut neighbors {
            around.sort_unstable();
            around.dedup();
        }
        let stiffness = coarse
            .vertices
            .iter()
            .map(|&v| {
                let weight = &avatar.weights[v as usize];
                let of = |bones: &[Bone]| bones.iter().map(|&b| weight.of(b)).sum::<f64>();
                1.0 + HAND_STIFFNESS * of(&[Bone::LeftHand, Bone::RightHand])
                    + END_STIFFNESS * of(&[Bone::LeftFoot, Bone::RightFoot, Bone::Head])
            })
            .collect();
        let mirror = coarse
            .vertices
            .iter()
            .map(|&v| {
                let image = mirror?[v as usize];
                let at = coarse.vertices.binary_search(&image).ok()?;
                Some(at as u32)
            })
            .collect();
        Self {
            coarse,
            neighbors,
            stiffness,
            mirror,
        }
    }

    /// Returns the number of unknown displacements
    pub(super) fn coarse_count(&self) -> usize {
        self.coarse.vertices.len()
    }

    /// Returns the factor of energies that are sums over coarse vertices
    pub(super) fn density(&self) -> f64 {
        NOMINAL_COUNT / self.coarse_count() as f64
    }
}

/// Returns the vertex at the mirror image (x to -x) of each vertex, if all have one
fn mirror_vertices(positions: &[DVec3], tolerance_mm: f64) -> Option<Vec<u32>> {
    // Sorted by height, there are few candidates.
    let mut by_height: Vec<u32> = (0..positions.len() as u32).collect();
    let height = |v: &u32| positions[*v as usize].y;
    by_height.sort_by(|a, b| height(a).total_cmp(&height(b)));
    positions
        .iter()
        .map(|p| {
            let image = DVec3::new(-p.x, p.y, p.z);
            let start = by_height.partition_point(|v| height(v) < p.y - tolerance_mm);
            by_height[start..]
                .iter()
                .take_while(|v| height(v) <= p.y + tolerance_mm)
                .map(|&v| (v, positions[v as usize].distance(image)))
                .filter(|(_, distance)| *distance < tolerance_mm)
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .map(|(v, _)| v)
        })
        .collect()
}
