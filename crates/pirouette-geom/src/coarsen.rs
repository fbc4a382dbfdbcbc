//! Coarse meshes on a subset of the vertices of a closed surface, and the surface as a blend of them.
//!
//! Edges are collapsed shortest first, so that the remaining vertices are spaced evenly, and only where the surface
//! stays manifold and does not fold. Mirror symmetry is preserved, except for a few vertices at the mirror plane.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::parallel::prelude::*;
use glam::DVec3;

use crate::tri_mesh::TriMesh;

/// Upper bound of the number of neighbors of a vertex
///
/// Fans of long thin triangles represent bending badly.
const MAX_VALENCE: usize = 9;

/// Cosine of the largest angle by which one collapse may turn a triangle
const MIN_TURN_COSINE: f64 = 0.3;

/// A coarse mesh on a subset of the vertices of a fine one
#[derive(Debug, Clone)]
pub struct CoarseMesh {
    /// Fine vertex of each coarse one, ascending
    pub vertices: Vec<u32>,
    /// Coarse triangles, oriented like the fine ones
    pub triangles: Vec<[u32; 3]>,
    /// For each fine vertex, the coarse triangle nearest to it, as a blend of its three vertices
    pub blends: Vec<Blend>,
}

/// Weights of three coarse vertices, nonnegative, with sum 1
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blend {
    /// Coarse vertices
    pub vertices: [u32; 3],
    /// Their weights
    pub weights: [f64; 3],
}

impl Blend {
    /// Returns the blend of values given per coarse vertex
    ///
    /// # Panics
    /// When the value of one of its vertices is missing.
    pub fn of(&self, values: &[DVec3]) -> DVec3 {
        (0..3)
            .map(|k| values[self.vertices[k] as usize] * self.weights[k])
            .sum()
    }
}

/// Collapses edges until about `target` vertices are left or no edge can be collapsed
///
/// `mirror` gives the mirrored vertex of each vertex (itself on the mirror plane) if the mesh is symmetric.
/// The mesh must be closed and manifold; edges that are not are kept.
///
/// # Panics
/// When a triangle or `mirror` refers to a vertex that does not exist.
pub fn coarsen(mesh: &TriMesh, target: usize, mirror: Option<&[u32]>) -> CoarseMesh {
    let mut levels = coarsen_levels(mesh, &[target], mirror);
    levels.pop().expect("one level for one target")
}

/// Like [`coarsen`], for several targets in descending order: each mesh uses a subset of the previous one's vertices
pub fn coarsen_levels(
    mesh: &TriMesh,
    targets: &[usize],
    mirror: Option<&[u32]>,
) -> Vec<CoarseMesh> {
    let mut collapse = Collapse::new(mesh);
    let mut queue: BinaryHeap<Reverse<(u64, [u32; 2])>> = mesh
        .edges()
        .into_iter()
        .map(|edge| Reverse((collapse.length_key(edge), edge)))
        .collect();
    let mut around = Vec::new();
    let mut to_target = |target: &usize| {
        collapse.collapse_to(*target, mirror, &mut queue, &mut around);
        collapse.finish()
    };
    targets.iter().map(&mut to_target).collect()
}

/// Queues the edges of a vertex again: rejected ones may have become possible
fn queue_around(
    collapse: &mut Collapse,
    vertex: u32,
    around: &mut Vec<u32>,
    queue: &mut BinaryHeap<Reverse<(u64, [u32; 2])>>,
) {
    collapse.neighbors(vertex, around);
    for &neighbor in &*around {
        let edge = [vertex.min(neighbor), vertex.max(neighbor)];
        queue.push(Reverse((collapse.length_key(edge), edge)));
    }
}

/// A mesh during edge collapse
struct Collapse<'a> {
    positions: &'a [DVec3],
    triangles: Vec<[u32; 3]>,
    /// Remaining triangles of each remaining vertex
    stars: Vec<Vec<u32>>,
    alive: Vec<bool>,
    alive_count: usize,
    /// The vertex that each vertex was merged into
    merged_into: Vec<u32>,
    /// Time of the last visit of each vertex, so that each is counted once
    met: Vec<u32>,
    time: u32,
}

impl<'a> Collapse<'a> {
    fn new(mesh: &'a TriMesh) -> Self {
        let count = mesh.positions.len();
        let mut stars = vec![Vec::with_capacity(8); count];
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            for &v in triangle {
                stars[v as usize].push(t as u32);
            }
        }
        Self {
            positions: &mesh.positions,
            triangles: mesh.triangles.clone(),
            stars,
            alive: vec![true; count],
            alive_count: count,
            merged_into: (0..count as u32).collect(),
            met: vec![0; count],
            time: 0,
        }
    }

    /// Collapses queued edges until `target` vertices are left
    fn collapse_to(
        &mut self,
        target: usize,
        mirror: Option<&[u32]>,
        queue: &mut BinaryHeap<Reverse<(u64, [u32; 2])>>,
        around: &mut Vec<u32>,
    ) {
        let image = |v: u32| mirror.map_or(v, |mirror| mirror[v as usize]);
        while self.alive_count > target
            && let Some(Reverse((_, edge))) = queue.pop()
        {
            if edge.iter().any(|&v| !self.alive[v as usize]) {
                continue;
            }
            let Some([gone, kept]) = self.choose_collapse(edge, mirror) else {
                continue;
            };
            self.merge(gone, kept);
            queue_around(self, kept, around, queue);
            let (gone_image, kept_image) = (image(gone), image(kept));
            if mirror.is_some()
                && gone_image != gone
                && self.alive[gone_image as usize]
                && self.can_merge(gone_image, kept_image)
            {
                self.merge(gone_image, kept_image);
                queue_around(self, kept_image, around, queue);
            }
        }
    }

    fn position(&self, v: u32) -> DVec3 {
        self.positions[v as usize]
    }

    /// Orders edges by length; positive floats order like their bits
    fn length_key(&self, [a, b]: [u32; 2]) -> u64 {
        self.position(a)
            .distance_squared(self.position(b))
            .to_bits()
    }

    /// Collects the neighbors of a vertex, each once
    fn neighbors(&mut self, v: u32, around: &mut Vec<u32>) {
        around.clear();
        self.time += 1;
        for &t in &self.stars[v as usize] {
            for other in self.triangles[t as usize] {
                let met = &mut self.met[other as usize];
                if other != v && *met != self.time {
                    *met = self.time;
                    around.push(other);
                }
            }
        }
    }

    /// Counts the neighbors of the first vertex, of the second, and of both
    fn count_neighbors(&mut self, [a, b]: [u32; 2]) -> [usize; 3] {
        // neighbors of the first, then those shared with the second
        self.time += 3;
        let (first, second) = (self.time - 2, self.time - 1);
        let mut counts = [0; 3];
        for &t in &self.stars[a as usize] {
            for other in self.triangles[t as usize] {
                let met = &mut self.met[other as usize];
                if other != a && *met != first {
                    *met = first;
                    counts[0] += 1;
                }
            }
        }
        for &t in &self.stars[b as usize] {
            for other in self.triangles[t as usize] {
                let met = &mut self.met[other as usize];
                if other != b && *met != second {
                    counts[1] += 1;
                    counts[2] += usize::from(*met == first);
                    *met = second;
                }
            }
        }
        counts
    }

    /// Chooses the end of an edge to merge into the other: the one that leaves the shorter edges
    fn choose_collapse(&mut self, [a, b]: [u32; 2], mirror: Option<&[u32]>) -> Option<[u32; 2]> {
        let image = |v: u32| mirror.map_or(v, |mirror| mirror[v as usize]);
        let longest = |gone: u32, kept: u32| {
            let star = self.stars[gone as usize].iter();
            star.flat_map(|&t| self.triangles[t as usize])
                .filter(|&v| v != gone)
                .map(|v| self.position(v).distance_squared(self.position(kept)))
                .fold(0.0, f64::max)
        };
        let (forth, back) = (longest(a, b), longest(b, a));
        let order = if forth <= back {
            [[a, b], [b, a]]
        } else {
            [[b, a], [a, b]]
        };
        order.into_iter().find(|&[gone, kept]| {
            // Vertices on the mirror plane stay on it, and no edge crosses it.
            let stays = mirror.is_none() || image(gone) != gone || image(kept) == kept;
            stays && (mirror.is_none() || image(gone) != kept) && self.can_merge(gone, kept)
        })
    }

    /// Whether the surface stays manifold and unfolded when a vertex is merged into its neighbor
    fn can_merge(&mut self, gone: u32, kept: u32) -> bool {
        if gone == kept || !self.alive[gone as usize] || !self.alive[kept as usize] {
            return false;
        }
        let touches = |&t: &u32| self.triangles[t as usize].contains(&kept);
        if !self.stars[gone as usize].iter().any(touches) {
            return false;
        }
        let [around_gone, around_kept, common] = self.count_neighbors([gone, kept]);
        // The link condition (Dey, Edelsbrunner, Guha, Nekhayev 1999) for closed surfaces
        if common != 2 || around_gone + around_kept - 4 > MAX_VALENCE {
            return false;
        }
        self.stars[gone as usize].iter().all(|&t| {
            let triangle = self.triangles[t as usize];
            if triangle.contains(&kept) {
                return true;
            }
            let moved = triangle.map(|v| if v == gone { kept } else { v });
            let (before, after) = (self.normal(triangle), self.normal(moved));
            before.dot(after) > MIN_TURN_COSINE * before.length() * after.length()
        })
    }

    fn normal(&self, triangle: [u32; 3]) -> DVec3 {
        let [a, b, c] = triangle.map(|v| self.position(v));
        (b - a).cross(c - a)
    }

    fn merge(&mut self, gone: u32, kept: u32) {
        let star = std::mem::take(&mut self.stars[gone as usize]);
        for t in star {
            let triangle = self.triangles[t as usize];
            if triangle.contains(&kept) {
                for v in triangle {
                    self.stars[v as usize].retain(|&other| other != t);
                }
                self.triangles[t as usize] = [u32::MAX; 3];
            } else {
                self.triangles[t as usize] = triangle.map(|v| if v == gone { kept } else { v });
                self.stars[kept as usize].push(t);
            }
        }
        self.alive[gone as usize] = false;
        self.alive_count -= 1;
        self.merged_into[gone as usize] = kept;
    }

    /// Extracts the current mesh
    fn finish(&mut self) -> CoarseMesh {
        let vertices: Vec<u32> = (0..self.alive.len() as u32)
            .filter(|&v| self.alive[v as usize])
            .collect();
        let mut coarse = vec![u32::MAX; self.alive.len()];
        for (c, &v) in vertices.iter().enumerate() {
            coarse[v as usize] = c as u32;
        }
        for v in 0..self.alive.len() {
            let mut root = v as u32;
            while !self.alive[root as usize] {
                root = self.merged_into[root as usize];
            }
            self.merged_into[v] = root;
        }
        // For each remaining vertex, the triangles around it and around its neighbors
        let mut around = Vec::new();
        let mut wide: Vec<Vec<u32>> = Vec::with_capacity(vertices.len());
        for &v in &vertices {
            self.neighbors(v, &mut around);
            around.push(v);
            let stars = around.iter().flat_map(|&near| &self.stars[near as usize]);
            let mut star: Vec<u32> = stars.copied().collect();
            star.sort_unstable();
            star.dedup();
            wide.push(star);
        }
        let blends = (0..self.alive.len() as u32)
            .into_par_iter()
            .map(|v| {
                let root = self.merged_into[v as usize];
                let blend = self.blend(v, root, &wide[coarse[root as usize] as usize]);
                Blend {
                    vertices: blend.vertices.map(|v| coarse[v as usize]),
                    ..blend
                }
            })
            .collect();
        let triangles = self
            .triangles
            .iter()
            .filter(|triangle| triangle[0] != u32::MAX)
            .map(|triangle| triangle.map(|v| coarse[v as usize]))
            .collect();
        CoarseMesh {
            vertices,
            triangles,
            blends,
        }
    }

    /// Blends `v` in the nearest of some triangles around the vertex that it was merged into, in fine vertices
    fn blend(&self, v: u32, root: u32, triangles: &[u32]) -> Blend {
        let itself = Blend {
            vertices: [root; 3],
            weights: [1.0, 0.0, 0.0],
        };
        if v == root {
            return itself;
        }
        let p = self.position(v);
        let mut best = (f64::INFINITY, itself);
        for &t in triangles {
            let triangle = self.triangles[t as usize];
            let (weights, distance) =
                closest_point(p, triangle.map(|corner| self.position(corner)));
            if distance < best.0 {
                let blend = Blend {
                    vertices: triangle,
                    weights,
                };
                best = (distance, blend);
            }
        }
        best.1
    }
}

/// Returns the barycentric weights of the point of a triangle nearest to `p`, and the squared distance
///
/// # Source
/// C. Ericson 2005, "Real-Time Collision Detection", section 5.1.5: the regions of the triangle's features.
pub fn closest_point(p: DVec3, [a, b, c]: [DVec3; 3]) -> ([f64; 3], f64) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    let va = d3 * d6 - d5 * d4;
    let vb = d5 * d2 - d1 * d6;
    let vc = d1 * d4 - d3 * d2;
    let weights = if d1 <= 0.0 && d2 <= 0.0 {
        [1.0, 0.0, 0.0]
    } else if d3 >= 0.0 && d4 <= d3 {
        [0.0, 1.0, 0.0]
    } else if d6 >= 0.0 && d5 <= d6 {
        [0.0, 0.0, 1.0]
    } else if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        [1.0 - t, t, 0.0]
    } else if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        [1.0 - t, 0.0, t]
    } else if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        [0.0, 1.0 - t, t]
    } else {
        let sum = va + vb + vc;
        [va / sum, vb / sum, vc / sum]
    };
    let nearest = a * weights[0] + b * weights[1] + c * weights[2];
    (weights, p.distance_squared(nearest))
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use proptest::prelude::*;

    use super::*;
    use crate::isosurface::{SurfaceOptions, extract_surface};

    /// Two overlapping balls, mirrored at x = 0
    fn peanut() -> TriMesh {
        let options = SurfaceOptions {
            lo: DVec3::splat(-2.45),
            hi: DVec3::splat(2.45),
            cell_size: 0.1,
            lipschitz: 1.0,
            secant_steps: 2,
            thin_pieces: true,
        };
        let field = |p: DVec3| {
            let ball = |center: DVec3| p.distance(center) - 1.3;
            ball(DVec3::X).min(ball(-DVec3::X))
        };
        extract_surface(field, &options).unwrap()
    }

    /// An octahedron, subdivided `rounds` times and projected to a sphere
    fn ball(rounds: usize) -> TriMesh {
        let tips = [
            DVec3::X,
            DVec3::NEG_X,
            DVec3::Y,
            DVec3::NEG_Y,
            DVec3::Z,
            DVec3::NEG_Z,
        ];
        let mut mesh = TriMesh {
            positions: tips.to_vec(),
            triangles: Vec::new(),
        };
        for x in [0u32, 1] {
            for y in [2, 3] {
                for z in [4, 5] {
                    let flipped = (x + y + z) % 2 == 1;
                    mesh.triangles
                        .push(if flipped { [x, z, y] } else { [x, y, z] });
                }
            }
        }
        for _ in 0..rounds {
            let edges = mesh.edges();
            let first = mesh.positions.len() as u32;
            for [a, b] in &edges {
                let middle = mesh.positions[*a as usize] + mesh.positions[*b as usize];
                mesh.positions.push(middle / middle.length());
            }
            let middle = |a: u32, b: u32| {
                let at = edges.binary_search(&[a.min(b), a.max(b)]).unwrap();
                first + at as u32
            };
            mesh.triangles = mesh
                .triangles
                .iter()
                .flat_map(|&[a, b, c]| {
                    let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
                })
                .collect();
        }
        mesh.check().unwrap();
        mesh
    }

    fn mirror_of(mesh: &TriMesh) -> Vec<u32> {
        let nearest = |p: DVec3| {
            let distance = |v: &u32| mesh.positions[*v as usize].distance_squared(p);
            (0..mesh.positions.len() as u32)
                .min_by(|a, b| distance(a).total_cmp(&distance(b)))
                .unwrap()
        };
        mesh.positions
            .iter()
            .map(|p| nearest(DVec3::new(-p.x, p.y, p.z)))
            .collect()
    }

    #[test]
    fn the_coarse_mesh_is_closed_even_and_close_to_the_surface() {
        let mesh = peanut();
        let coarse = coarsen(&mesh, 200, None);
        assert_eq!(coarse.vertices.len(), 200);
        let positions: Vec<DVec3> = coarse
            .vertices
            .iter()
            .map(|&v| mesh.positions[v as usize])
            .collect();
        let small = TriMesh {
            positions: positions.clone(),
            triangles: coarse.triangles.clone(),
        };
        small.check().unwrap();
        assert!((small.volume() / mesh.volume() - 1.0).abs() < 0.05);
        for (blend, p) in coarse.blends.iter().zip(&mesh.positions) {
            assert!((blend.weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            assert!(blend.of(&positions).distance(*p) < 0.2);
        }
        for (c, &v) in coarse.vertices.iter().enumerate() {
            let own = coarse.blends[v as usize].of(&positions);
            assert!(own.distance(positions[c]) < 1e-12);
        }
    }

    #[test]
    fn levels_are_nested_and_the_first_equals_a_single_coarsening() {
        let mesh = peanut();
        let levels = coarsen_levels(&mesh, &[300, 100], None);
        let alone = coarsen(&mesh, 300, None);
        assert_eq!(levels[0].vertices, alone.vertices);
        assert_eq!(levels[0].triangles, alone.triangles);
        assert_eq!(levels[1].vertices.len(), 100);
        let finer = &levels[0].vertices;
        assert!(levels[1].vertices.iter().all(|v| finer.contains(v)));
    }

    #[test]
    fn mirror_symmetry_is_preserved() {
        let mesh = ball(4);
        let mirror = mirror_of(&mesh);
        let coarse = coarsen(&mesh, 200, Some(&mirror));
        let kept: HashSet<u32> = coarse.vertices.iter().copied().collect();
        let paired = kept
            .iter()
            .filter(|&&v| kept.contains(&mirror[v as usize]))
            .count();
        assert!(
            paired * 100 >= 95 * kept.len(),
            "{paired} of {}",
            kept.len()
        );
    }

    proptest! {
        #[test]
        fn no_sampled_point_is_nearer(
            p in prop::array::uniform3(-2.0..2.0f64),
            corners in prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64)),
        ) {
            let p = DVec3::from_array(p);
            let [a, b, c] = corners.map(DVec3::from_array);
            prop_assume!((b - a).cross(c - a).length() > 1e-3);
            let (weights, squared) = closest_point(p, [a, b, c]);
            prop_assert!(weights.iter().all(|w| (-1e-9..=1.0 + 1e-9).contains(w)));
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let (u, v) = (f64::from(i) / 20.0, f64::from(j) / 20.0);
                    let q = a + (b - a) * u + (c - a) * v;
                    prop_assert!(squared <= p.distance_squared(q) + 1e-9);
                }
            }
        }
    }
}
