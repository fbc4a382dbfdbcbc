//! As-rigid-as-possible deformation of planar meshes.
//!
//! Some vertices are constrained: handles move to their targets, anchors are handles whose target is their rest
//! position. All others follow such that the star of each vertex moves as rigidly as possible. The matrix is
//! factorized once per set of constrained vertices; each deformation alternates rotations in closed form with one
//! solve.
//!
//! The energy never grows from round to round, but it may have several minima: handles that turn by more than
//! about half a turn against each other can fold the mesh.

mod points;

use glam::DVec2;

use crate::planar_mesh::PlanarMesh;
use crate::sparse::Cholesky;

pub use points::deform_points;

/// Triangles with area over squared longest edge below this count as equilateral
///
/// Cotangents of such angles reach a million; much larger ones would lose the rest of the mesh to rounding.
const FLATTEST: f64 = 1e-6;

/// Lower bound of edge weights that may not be negative
///
/// Not zero, so that every part stays connected; too small to affect the result.
const MIN_WEIGHT: f64 = 1e-6;

/// Cotangent of 60 degrees
const EQUILATERAL_COTANGENT: f64 = 0.577_350_269_189_625_8;

/// When to stop, and where to start
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArapOptions {
    /// Maximum number of rounds (rotations, then solve); more come closer to the minimum
    pub rounds: usize,
    /// Stops when no vertex moves farther than this in a round, in px; 0 runs all rounds
    pub tolerance: f64,
    /// Positions before the first round
    pub start: ArapStart,
}

impl Default for ArapOptions {
    /// 30 rounds, or until no vertex moves by a thousandth of a pixel
    fn default() -> Self {
        Self {
            rounds: 30,
            tolerance: 1e-3,
            start: ArapStart::Rigid,
        }
    }
}

impl ArapOptions {
    /// Converges to about a ten-thousandth of a pixel from the minimum, instead of to changes that are invisible
    pub fn precise() -> Self {
        Self {
            rounds: 5000,
            tolerance: 1e-7,
            start: ArapStart::Rigid,
        }
    }
}

/// Positions of the free vertices before the first round
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ArapStart {
    /// Each connected part moved by the rigid motion that best fits its handles
    ///
    /// Handles that move rigidly move their part along exactly.
    #[default]
    Rigid,
    /// The rest positions
    Rest,
}

/// Treatment of edges with negative cotangent weight, which are mostly boundary edges opposite an obtuse angle
///
/// A star of such edges gains energy by turning around, so that the rest mesh may not be its own optimal deformation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ArapWeights {
    /// Negative weights are raised to (almost) zero: robust with thin triangles
    #[default]
    NonNegative,
    /// Negative weights are kept, except in stars that would turn around at rest: the energy as published, on any
    /// mesh without extreme triangles
    Cotangent,
}

/// Why a mesh cannot be deformed
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ArapError {
    /// A triangle or constraint refers to a vertex that does not exist
    #[error("vertex {vertex} does not exist: the mesh has {vertex_count}")]
    MissingVertex {
        /// The vertex
        vertex: u32,
        /// Vertices of the mesh
        vertex_count: usize,
    },
    /// A vertex is constrained more than once
    #[error("vertex {vertex} is constrained more than once")]
    ConstrainedTwice {
        /// The vertex
        vertex: u32,
    },
    /// A coordinate is NaN or infinite
    #[error("a coordinate is not a finite number")]
    NotFinite,
    /// Source and target points differ in number
    #[error("{sources} source points but {targets} target points")]
    UnequalCounts {
        /// Number of source points
        sources: usize,
        /// Number of target points
        targets: usize,
    },
    /// The mesh is not parallel to the xy plane
    #[error("the mesh is not in the xy plane, but {plane}; rotate it, so that z is constant")]
    NotInPlane {
        /// Where the mesh is instead
        plane: &'static str,
    },
    /// A source point is far from the mesh
    #[error(
        "source point {point} is {distance:.6} from the nearest vertex, but the edges there are at most {longest_edge:.6} long; check its unit and origin"
    )]
    FarSource {
        /// Number of the point, from 1
        point: usize,
        /// Distance to the nearest vertex
        distance: f64,
        /// Length of the longest edge at this vertex
        longest_edge: f64,
    },
    /// Two source points have the same nearest vertex, but different targets
    #[error(
        "source points {first} and {second} have the same nearest vertex {vertex}, but different targets; remove one, or refine the mesh"
    )]
    SharedVertex {
        /// Number of the first point, from 1
        first: usize,
        /// Number of the second point
        second: usize,
        /// The vertex, from 0
        vertex: u32,
    },
    /// The mesh has no vertices to move
    #[error("the mesh has no vertices")]
    EmptyMesh,
    /// The system of equations could not be factorized: out of memory, or coordinates too large
    #[error("the system of {size} equations could not be factorized")]
    Factorization {
        /// Number of free vertices
        size: usize,
    },
}

/// One neighbor of a vertex
#[derive(Debug, Clone, Copy)]
struct Spoke {
    to: u32,
    weight: f64,
    /// Rest position of the vertex minus that of the neighbor
    rest: DVec2,
}

/// Role of a vertex in the system
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    /// Unknown, with its row of the system
    Free(u32),
    /// Fixed at its target
    Constrained,
    /// Fixed at rest: its part has no handles
    Idle,
}

/// A mesh prepared for deformation with a fixed set of handles and anchors
pub struct ArapSolver {
    rest: Vec<DVec2>,
    spokes: Vec<Spoke>,
    /// Spokes of vertex `v` are `spokes[first_spoke[v]..first_spoke[v + 1]]`
    first_spoke: Vec<usize>,
    roles: Vec<Role>,
    /// Connected part of each vertex
    parts: Vec<u32>,
    constrained: Vec<u32>,
    free: Vec<u32>,
    factor: Option<Cholesky>,
}

impl std::fmt::Debug for ArapSolver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ArapSolver")
            .field("vertex_count", &self.rest.len())
            .field("constrained", &self.constrained.len())
            .field("free", &self.free.len())
            .finish_non_exhaustive()
    }
}

/// A deformed mesh: same triangles as the rest mesh
#[derive(Debug, Clone, PartialEq)]
pub struct Deformation {
    /// One point per vertex, in px
    pub positions: Vec<DVec2>,
    /// Rotation of the star of each vertex: cosine and sine
    pub rotations: Vec<DVec2>,
    /// Rounds computed
    pub rounds: usize,
    /// Whether no vertex moved farther than the tolerance in the last round
    pub converged: bool,
    /// The energy of the result, in square px
    pub energy: f64,
}

impl ArapSolver {
    /// Prepares the mesh and factorizes the system; `constrained` lists the vertices whose targets are given later
    ///
    /// Connected parts without constrained vertices do not move. Degenerate triangles are treated as equilateral ones.
    ///
    /// # Errors
    /// When a vertex does not exist or is constrained twice, or a coordinate is not finite.
    ///
    /// # Source
    /// Sorkine & Alexa 2007, "As-rigid-as-possible surface modeling", in the plane: energy over the spokes of each
    /// vertex (eq. 3) with cotangent weights. Two differences: negative weights are raised to (almost) zero, and the
    /// local step needs no singular value decomposition, because a rotation in the plane is one angle.
    pub fn new(rest: &PlanarMesh, constrained: &[u32]) -> Result<Self, ArapError> {
        Self::with_weights(rest, constrained, ArapWeights::NonNegative)
    }

    /// Like [`ArapSolver::new`], with a choice of weights
    ///
    /// # Errors
    /// As [`ArapSolver::new`].
    pub fn with_weights(
        rest: &PlanarMesh,
        constrained: &[u32],
        weights: ArapWeights,
    ) -> Result<Self, ArapError> {
        let vertex_count = rest.positions.len();
        let named = rest.triangles.iter().flatten().chain(constrained);
        if let Some(&vertex) = named.into_iter().find(|&&v| v as usize >= vertex_count) {
            return Err(ArapError::MissingVertex {
                vertex,
                vertex_count,
            });
        }
        if !rest.positions.iter().all(|p| p.is_finite()) {
            return Err(ArapError::NotFinite);
        }
        let (mut spokes, first_spoke) = spokes(rest);
        raise_weights(&mut spokes, &first_spoke, weights);
        let parts = connected_parts(&spokes, &first_spoke);

        let mut roles = vec![Role::Idle; vertex_count];
        let mut held = vec![false; vertex_count];
        for &v in constrained {
            if roles[v as usize] == Role::Constrained {
                return Err(ArapError::ConstrainedTwice { vertex: v });
            }
            roles[v as usize] = Role::Constrained;
            held[parts[v as usize] as usize] = true;
        }
        let mut free = Vec::new();
        for (v, role) in roles.iter_mut().enumerate() {
            if *role == Role::Idle && held[parts[v] as usize] {
                *role = Role::Free(free.len() as u32);
                free.push(v as u32);
            }
        }

        let mut lower = Vec::with_capacity(free.len() * 5);
        for (row, &v) in free.iter().enumerate() {
            let star = &spokes[first_spoke[v as usize]..first_spoke[v as usize + 1]];
            lower.push((row, row, star.iter().map(|s| s.weight).sum()));
            for spoke in star {
                if let Role::Free(column) = roles[spoke.to as usize]
                    && (column as usize) < row
                {
                    lower.push((row, column as usize, -spoke.weight));
                }
            }
        }
        let factor = if free.is_empty() {
            None
        } else {
            let factor = Cholesky::factor(free.len(), &lower);
            Some(factor.ok_or(ArapError::Factorization { size: free.len() })?)
        };
        Ok(Self {
            rest: rest.positions.clone(),
            spokes,
            first_spoke,
            roles,
            parts,
            constrained: constrained.to_vec(),
            free,
            factor,
        })
    }

    /// Moves the constrained vertices to `targets` (in px, same order) and solves for the others
    ///
    /// # Panics
    /// When the number of targets differs from that of constrained vertices.
    pub fn deform(&self, targets: &[DVec2], options: &ArapOptions) -> Deformation {
        assert_eq!(
            targets.len(),
            self.constrained.len(),
            "one target per constrained vertex"
        );
        let mut positions = match options.start {
            ArapStart::Rest => self.rest.clone(),
            ArapStart::Rigid => self.start_rigid(targets),
        };
        for (&v, &target) in self.constrained.iter().zip(targets) {
            positions[v as usize] = target;
        }
        let mut rotations = vec![DVec2::X; self.rest.len()];
        let mut rounds = 0;
        let mut converged = self.factor.is_none();
        if let Some(factor) = &self.factor {
            let mut workspace = factor.workspace();
            let mut right = vec![DVec2::ZERO; self.free.len()];
            while rounds < options.rounds && !converged {
                self.fit_rotations(&positions, &mut rotations);
                self.right_sides(&positions, &rotations, &mut right);
                factor.solve_in_place(&mut right, &mut workspace);
                let mut moved: f64 = 0.0;
                for (&v, &p) in self.free.iter().zip(&right) {
                    moved = moved.max(positions[v as usize].distance(p));
                    positions[v as usize] = p;
                }
                rounds += 1;
                converged = moved <= options.tolerance;
            }
        }
        self.fit_rotations(&positions, &mut rotations);
        Deformation {
            energy: self.energy(&positions, &rotations),
            positions,
            rotations,
            rounds,
            converged,
        }
    }

    fn star(&self, vertex: usize) -> &[Spoke] {
        &self.spokes[self.first_spoke[vertex]..self.first_spoke[vertex + 1]]
    }

    /// Fits a rotation to each star; keeps the previous one where all fit equally well
    fn fit_rotations(&self, positions: &[DVec2], rotations: &mut [DVec2]) {
        for (v, rotation) in rotations.iter_mut().enumerate() {
            let mut sum = DVec2::ZERO;
            for spoke in self.star(v) {
                let now = positions[v] - positions[spoke.to as usize];
                sum += spoke.weight * DVec2::new(spoke.rest.dot(now), spoke.rest.perp_dot(now));
            }
            if let Some(unit) = sum.try_normalize() {
                *rotation = unit;
            }
        }
    }

    fn right_sides(&self, positions: &[DVec2], rotations: &[DVec2], right: &mut [DVec2]) {
        for (&v, right) in self.free.iter().zip(right) {
            let v = v as usize;
            *right = DVec2::ZERO;
            for spoke in self.star(v) {
                let to = spoke.to as usize;
                let mean = (rotations[v] + rotations[to]) / 2.0;
                *right += spoke.weight * mean.rotate(spoke.rest);
                if self.roles[to] == Role::Constrained {
                    *right += spoke.weight * positions[to];
                }
            }
        }
    }

    fn energy(&self, positions: &[DVec2], rotations: &[DVec2]) -> f64 {
        (0..self.rest.len())
            .flat_map(|v| self.star(v).iter().map(move |spoke| (v, spoke)))
            .map(|(v, spoke)| {
                let now = positions[v] - positions[spoke.to as usize];
                spoke.weight * (now - rotations[v].rotate(spoke.rest)).length_squared()
            })
            .sum()
    }

    /// Moves each part by the rigid motion that brings its constrained vertices closest to their targets
    fn start_rigid(&self, targets: &[DVec2]) -> Vec<DVec2> {
        #[derive(Clone, Copy, Default)]
        struct Fit {
            count: f64,
            rest: DVec2,
            target: DVec2,
            turn: DVec2,
        }
        let part_count = self.parts.iter().max().map_or(0, |&p| p as usize + 1);
        let mut fits = vec![Fit::default(); part_count];
        let handles = || {
            self.constrained
                .iter()
                .zip(targets)
                .map(|(&v, &target)| (self.parts[v as usize], self.rest[v as usize], target))
        };
        for (part, rest, target) in handles() {
            let fit = &mut fits[part as usize];
            fit.count += 1.0;
            fit.rest += rest;
            fit.target += target;
        }
        for fit in &mut fits {
            let count = fit.count.max(1.0);
            fit.rest /= count;
            fit.target /= count;
        }
        for (part, rest, target) in handles() {
            let fit = &mut fits[part as usize];
            let (a, b) = (rest - fit.rest, target - fit.target);
            fit.turn += DVec2::new(a.dot(b), a.perp_dot(b));
        }
        self.rest
            .iter()
            .zip(&self.parts)
            .map(|(&p, &part)| {
                let fit = fits[part as usize];
                let turn = fit.turn.try_normalize().unwrap_or(DVec2::X);
                fit.target + turn.rotate(p - fit.rest)
            })
            .collect()
    }
}

/// Returns the neighbors of all vertices with their cotangent weights
fn spokes(mesh: &PlanarMesh) -> (Vec<Spoke>, Vec<usize>) {
    let mut edges: Vec<(u32, u32, f64)> = Vec::with_capacity(mesh.triangles.len() * 6);
    for &triangle in &mesh.triangles {
        let cotangents = cotangents(triangle.map(|v| mesh.positions[v as usize]));
        for k in 0..3 {
            let (a, b) = (triangle[(k + 1) % 3], triangle[(k + 2) % 3]);
            edges.push((a, b, cotangents[k] / 2.0));
            edges.push((b, a, cotangents[k] / 2.0));
        }
    }
    // stable, so that sums do not depend on the sorting algorithm
    edges.sort_by_key(|&(a, b, _)| (a, b));
    let mut spokes: Vec<Spoke> = Vec::with_capacity(edges.len() / 2 + 1);
    let mut first_spoke = vec![0; mesh.positions.len() + 1];
    for same in edges.chunk_by(|e, f| (e.0, e.1) == (f.0, f.1)) {
        let (a, b, _) = same[0];
        if a == b {
            continue;
        }
        spokes.push(Spoke {
            to: b,
            weight: same.iter().map(|e| e.2).sum(),
            rest: mesh.positions[a as usize] - mesh.positions[b as usize],
        });
        first_spoke[a as usize + 1] = spokes.len();
    }
    for v in 1..first_spoke.len() {
        first_spoke[v] = first_spoke[v].max(first_spoke[v - 1]);
    }
    (spokes, first_spoke)
}

/// Raises negative weights according to `weights`
fn raise_weights(spokes: &mut [Spoke], first_spoke: &[usize], weights: ArapWeights) {
    let vertex_count = first_spoke.len() - 1;
    let stars: Vec<std::ops::Range<usize>> = (0..vertex_count)
        .map(|v| first_spoke[v]..first_spoke[v + 1])
        .collect();
    let turns_around: Vec<bool> = stars
        .iter()
        .map(|star| {
            let upright: f64 = spokes[star.clone()]
                .iter()
                .map(|s| s.weight * s.rest.length_squared())
                .sum();
            weights == ArapWeights::NonNegative || upright <= 0.0
        })
        .collect();
    for (v, star) in stars.into_iter().enumerate() {
        for spoke in &mut spokes[star] {
            // both directions of an edge alike; otherwise the system would not be symmetric
            if turns_around[v] || turns_around[spoke.to as usize] {
                spoke.weight = spoke.weight.max(MIN_WEIGHT);
            }
        }
    }
}

/// Returns the cotangents of the three angles, for either orientation of the triangle
fn cotangents(corners: [DVec2; 3]) -> [f64; 3] {
    let [a, b, c] = corners;
    let doubled_area = (b - a).perp_dot(c - a).abs();
    let longest = (b - a)
        .length_squared()
        .max((c - b).length_squared())
        .max((a - c).length_squared());
    if doubled_area > FLATTEST * longest {
        [
            (b - a).dot(c - a) / doubled_area,
            (c - b).dot(a - b) / doubled_area,
            (a - c).dot(b - c) / doubled_area,
        ]
    } else {
        [EQUILATERAL_COTANGENT; 3]
    }
}

/// Returns the index of each vertex's connected part
fn connected_parts(spokes: &[Spoke], first_spoke: &[usize]) -> Vec<u32> {
    let vertex_count = first_spoke.len() - 1;
    let mut parts: Vec<Option<u32>> = vec![None; vertex_count];
    let mut next = 0;
    for seed in 0..vertex_count {
        if parts[seed].is_some() {
            continue;
        }
        let mut open = vec![seed];
        parts[seed] = Some(next);
        while let Some(v) = open.pop() {
            for spoke in &spokes[first_spoke[v]..first_spoke[v + 1]] {
                let to = spoke.to as usize;
                if parts[to].is_none() {
                    parts[to] = Some(next);
                    open.push(to);
                }
            }
        }
        next += 1;
    }
    parts.into_iter().map(|p| p.unwrap_or(0)).collect()
}

#[cfg(test)]
mod tests;
