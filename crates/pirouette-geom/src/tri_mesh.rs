//! Indexed triangle meshes in space: normals, volume, adjacency, validation.

use std::cmp::Reverse;
use std::collections::HashMap;

use foldhash::fast::FixedState;
use glam::DVec3;

use crate::triangle_sides::sides_by_edge;

/// An indexed triangle mesh; triangles are counter-clockwise seen from outside
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriMesh {
    /// One point per vertex
    pub positions: Vec<DVec3>,
    /// Three vertex indices per triangle
    pub triangles: Vec<[u32; 3]>,
}

/// Reason why a mesh is not the closed, manifold, outward oriented surface of a solid
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshDefect {
    /// The mesh has no triangles
    #[error("the mesh has no triangles")]
    Empty,
    /// A coordinate is NaN or infinite
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// The vertex
        vertex: u32,
    },
    /// A triangle refers to a vertex that does not exist
    #[error("triangle {triangle} refers to vertex {vertex}, but there are only {vertex_count}")]
    MissingVertex {
        /// The triangle
        triangle: usize,
        /// The vertex it refers to
        vertex: u32,
        /// Number of vertices of the mesh
        vertex_count: usize,
    },
    /// A triangle refers to one vertex twice
    #[error("triangle {triangle} refers to vertex {vertex} twice")]
    RepeatedVertex {
        /// The triangle
        triangle: usize,
        /// The vertex
        vertex: u32,
    },
    /// A vertex belongs to no triangle
    #[error("vertex {vertex} belongs to no triangle")]
    UnusedVertex {
        /// The vertex
        vertex: u32,
    },
    /// An edge has a triangle on one side only
    #[error("the edge from vertex {from} to {to} has a triangle on one side only")]
    OpenEdge {
        /// Start of the edge in its triangle
        from: u32,
        /// End of the edge in its triangle
        to: u32,
    },
    /// More than two triangles share an edge, or two of them use it in the same direction
    #[error("several triangles use the edge from vertex {from} to {to} in this direction")]
    CrowdedEdge {
        /// Start of the edge
        from: u32,
        /// End of the edge
        to: u32,
    },
    /// The triangles around a vertex form several fans, so that the surface touches itself there
    #[error("the surface touches itself at vertex {vertex}")]
    TouchingVertex {
        /// The vertex
        vertex: u32,
    },
    /// The triangles face inward
    #[error("the triangles face inward: the signed volume is {volume}")]
    InsideOut {
        /// Signed volume
        volume: f64,
    },
}

impl TriMesh {
    /// Returns the corners of a triangle
    ///
    /// # Panics
    /// When the triangle or one of its vertices does not exist.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// Returns the signed volume, positive for a closed mesh whose triangles face outward
    pub fn volume(&self) -> f64 {
        (0..self.triangles.len())
            .map(|t| {
                let [a, b, c] = self.corners(t);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    /// Returns the center of mass of the volume within a closed mesh, `None` without volume
    pub fn center_of_mass(&self) -> Option<DVec3> {
        let (mut volume, mut moment) = (0.0, DVec3::ZERO);
        for [a, b, c] in (0..self.triangles.len()).map(|t| self.corners(t)) {
            // the tetrahedron with the origin, times six
            let part = a.dot(b.cross(c));
            volume += part;
            moment += (a + b + c) / 4.0 * part;
        }
        (volume != 0.0).then(|| moment / volume)
    }

    /// Returns the total area of the triangles
    pub fn area(&self) -> f64 {
        (0..self.triangles.len())
            .map(|t| {
                let [a, b, c] = self.corners(t);
                (b - a).cross(c - a).length() / 2.0
            })
            .sum()
    }

    /// Computes area-weighted unit normals, one per vertex; zero where the surrounding area is zero
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

    /// Returns the smallest and largest coordinates, `None` without vertices
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let first = *self.positions.first()?;
        Some(
            self.positions
                .iter()
                .fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p))),
        )
    }

    /// Returns each edge once, with its smaller vertex first, in ascending order
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut edges: Vec<[u32; 2]> = self
            .triangles
            .iter()
            .flat_map(sides)
            .map(|(a, b)| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Returns the triangle across each side: side `k` runs from corner `k` to corner `k + 1`
    ///
    /// `None` unless exactly two triangles with opposite directions share the edge.
    pub fn neighbors(&self) -> Vec<[Option<u32>; 3]> {
        let sides = sides_by_edge(&self.triangles);
        let mut neighbors = vec![[None; 3]; self.triangles.len()];
        for group in sides.chunk_by(|a, b| a.edge() == b.edge()) {
            if let [a, b] = group
                && a.from != b.from
            {
                neighbors[a.triangle as usize][a.side as usize] = Some(b.triangle);
                neighbors[b.triangle as usize][b.side as usize] = Some(a.triangle);
            }
        }
        neighbors
    }

    /// Checks that the mesh is the closed, manifold, outward oriented surface of a solid
    ///
    /// Every vertex is finite, used, and surrounded by one fan of triangles; every edge belongs to two
    /// triangles that use it in opposite directions; the signed volume is positive. Self-intersections are
    /// not checked.
    ///
    /// # Errors
    /// The first [`MeshDefect`] found.
    pub fn check(&self) -> Result<(), MeshDefect> {
        if self.triangles.is_empty() {
            return Err(MeshDefect::Empty);
        }
        if let Some(vertex) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshDefect::NotFinite {
                vertex: vertex as u32,
            });
        }
        let mut triangle_counts = vec![0u32; self.positions.len()];
        for (triangle, vertices) in self.triangles.iter().enumerate() {
            for &vertex in vertices {
                let Some(count) = triangle_counts.get_mut(vertex as usize) else {
                    return Err(MeshDefect::MissingVertex {
                        triangle,
                        vertex,
                        vertex_count: self.positions.len(),
                    });
                };
                *count += 1;
            }
            if let Some((vertex, _)) = sides(vertices).find(|(a, b)| a == b) {
                return Err(MeshDefect::RepeatedVertex { triangle, vertex });
            }
        }
        if let Some(vertex) = triangle_counts.iter().position(|&count| count == 0) {
            return Err(MeshDefect::UnusedVertex {
                vertex: vertex as u32,
            });
        }
        for group in sides_by_edge(&self.triangles).chunk_by(|a, b| a.edge() == b.edge()) {
            let (from, to) = (group[0].from, group[0].to);
            match group {
                [_] => return Err(MeshDefect::OpenEdge { from, to }),
                [a, b] if a.from != b.from => {}
                _ => return Err(MeshDefect::CrowdedEdge { from, to }),
            }
        }
        self.check_fans(&triangle_counts)?;
        let volume = self.volume();
        if volume > 0.0 {
            Ok(())
        } else {
            Err(MeshDefect::InsideOut { volume })
        }
    }

    /// Checks the fan of every vertex of a mesh whose edges are valid
    fn check_fans(&self, triangle_counts: &[u32]) -> Result<(), MeshDefect> {
        let neighbors = self.neighbors();
        let mut visited = vec![false; self.positions.len()];
        for (start, vertices) in self.triangles.iter().enumerate() {
            for (corner, &vertex) in vertices.iter().enumerate() {
                if std::mem::replace(&mut visited[vertex as usize], true) {
                    continue;
                }
                let (mut triangle, mut side, mut fan) = (start, corner, 0u32);
                loop {
                    fan += 1;
                    // The next triangle of the fan lies across the side that starts at the vertex.
                    let Some(next) = neighbors[triangle][side] else {
                        break;
                    };
                    triangle = next as usize;
                    let Some(at) = self.triangles[triangle].iter().position(|&v| v == vertex)
                    else {
                        break;
                    };
                    side = at;
                    if triangle == start || fan > triangle_counts[vertex as usize] {
                        break;
                    }
                }
                if fan != triangle_counts[vertex as usize] {
                    return Err(MeshDefect::TouchingVertex { vertex });
                }
            }
        }
        Ok(())
    }

    /// Returns a coarser mesh for display: the vertices in each cell of a grid are merged at their mean
    ///
    /// Triangles that collapse to an edge or a point are removed. Every edge of a closed mesh is still used equally
    /// often in both directions; the mesh may touch itself where the original did not. Non-finite vertices are not
    /// merged.
    ///
    /// # Source
    /// J. Rossignac, P. Borrel, 1993, Multi-resolution 3D approximations for rendering complex scenes.
    ///
    /// # Panics
    /// When `cell_size` is not positive, or a triangle refers to a vertex that does not exist.
    pub fn clustered(&self, cell_size: f64) -> TriMesh {
        assert!(cell_size > 0.0, "cells of size {cell_size}");
        let mut cluster_of_cell: HashMap<[i64; 3], u32, FixedState> = HashMap::default();
        let mut sums: Vec<(DVec3, u32)> = Vec::new();
        let cluster_of_vertex: Vec<u32> = self
            .positions
            .iter()
            .map(|&position| {
                let next = sums.len() as u32;
                let cluster = if position.is_finite() {
                    let cell = (position / cell_size).floor().to_array().map(|v| v as i64);
                    *cluster_of_cell.entry(cell).or_insert(next)
                } else {
                    next
                };
                if cluster == next {
                    sums.push((DVec3::ZERO, 0));
                }
                let (sum, count) = &mut sums[cluster as usize];
                *sum += position;
                *count += 1;
                cluster
            })
            .collect();
        let triangles = self
            .triangles
            .iter()
            .map(|triangle| triangle.map(|v| cluster_of_vertex[v as usize]));
        TriMesh {
            positions: sums.iter().map(|&(sum, n)| sum / f64::from(n)).collect(),
            triangles: triangles
                .filter(|[a, b, c]| a != b && b != c && c != a)
                .collect(),
        }
    }

    /// Splits the mesh into its connected components, largest absolute volume first
    ///
    /// Triangles are connected by shared vertices. Vertices keep their order; unused ones are removed.
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist.
    pub fn components(&self) -> Vec<TriMesh> {
        let roots = self.roots();
        let mut component_of_root = vec![u32::MAX; self.positions.len()];
        let mut new_index = vec![u32::MAX; self.positions.len()];
        let mut components: Vec<TriMesh> = Vec::new();
        for triangle in &self.triangles {
            let component = &mut component_of_root[roots[triangle[0] as usize] as usize];
            if *component == u32::MAX {
                *component = components.len() as u32;
                components.push(TriMesh::default());
            }
        }
        for (v, &position) in self.positions.iter().enumerate() {
            let component = component_of_root[roots[v] as usize];
            if let Some(component) = components.get_mut(component as usize) {
                new_index[v] = component.positions.len() as u32;
                component.positions.push(position);
            }
        }
        for triangle in &self.triangles {
            let component = component_of_root[roots[triangle[0] as usize] as usize];
            components[component as usize]
                .triangles
                .push(triangle.map(|v| new_index[v as usize]));
        }
        components.sort_by_cached_key(|component| {
            // positive floats are ordered like their bits
            Reverse(component.volume().abs().to_bits())
        });
        components
    }

    /// Returns the first vertex of the connected component of each vertex
    fn roots(&self) -> Vec<u32> {
        let mut parents: Vec<u32> = (0..self.positions.len() as u32).collect();
        for &[a, b, c] in &self.triangles {
            for other in [b, c] {
                let (ra, rb) = (find_root(&mut parents, a), find_root(&mut parents, other));
                parents[ra.max(rb) as usize] = ra.min(rb);
            }
        }
        // Parents precede their children, so they are roots already.
        for v in 0..parents.len() {
            parents[v] = parents[parents[v] as usize];
        }
        parents
    }

    /// Returns the connected component with the largest absolute volume; empty for a mesh without triangles
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist.
    pub fn largest_component(mut self) -> TriMesh {
        let roots = self.roots();
        if !self.triangles.is_empty() && roots.iter().all(|&root| root == 0) {
            return self;
        }
        // Indexed by root; `None` for unused vertices
        let mut volumes = vec![None; self.positions.len()];
        for (t, triangle) in self.triangles.iter().enumerate() {
            let [a, b, c] = self.corners(t);
            let volume = volumes[roots[triangle[0] as usize] as usize].get_or_insert(0.0);
            *volume += a.dot(b.cross(c));
        }
        let sizes = (0u32..).zip(&volumes);
        let sizes =
            sizes.filter_map(|(root, volume): (u32, &Option<f64>)| Some((root, (*volume)?.abs())));
        let largest = sizes.reduce(|a, b| if b.1.total_cmp(&a.1).is_gt() { b } else { a });
        let Some((root, _)) = largest else {
            return TriMesh::default();
        };
        let mut new_index = Vec::with_capacity(roots.len());
        let mut count = 0;
        for &other in &roots {
            new_index.push(count);
            count += u32::from(other == root);
        }
        let mut vertex_roots = roots.iter();
        self.positions
            .retain(|_| vertex_roots.next() == Some(&root));
        self.triangles
            .retain(|triangle| roots[triangle[0] as usize] == root);
        for v in self.triangles.iter_mut().flatten() {
            *v = new_index[*v as usize];
        }
        self
    }
}

fn sides(triangle: &[u32; 3]) -> impl Iterator<Item = (u32, u32)> + use<> {
    let [a, b, c] = *triangle;
    [(a, b), (b, c), (c, a)].into_iter()
}

/// Returns the root of a union-find tree, with path halving
fn find_root(parents: &mut [u32], mut v: u32) -> u32 {
    while parents[v as usize] != v {
        let grandparent = parents[parents[v as usize] as usize];
        parents[v as usize] = grandparent;
        v = grandparent;
    }
    v
}

#[cfg(test)]
mod tests;
