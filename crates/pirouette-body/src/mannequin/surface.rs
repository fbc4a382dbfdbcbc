//! Extracts a closed, exactly symmetric triangle mesh from the implicit body.
//!
//! A dual method on a grid whose planes lie closer together at hands, feet and face: one vertex per patch of surface in
//! a cell, one quad per grid edge that crosses the surface. The surface is followed from cell to cell, so only the
//! cells that it crosses are visited and the result is one piece. Afterwards the vertices are distributed evenly along
//! the surface.
//!
//! # Source
//! Nielson 2004, "Dual marching cubes": a vertex per patch instead of one per cell, which separates sheets that pass
//! through the same cell. An edge shared by four faces would remain where two cells meet in a face with two diagonally
//! opposite inside corners that belong to a single patch in both; there the face is resolved the other way, as in
//! Wenger 2013, *Isosurfaces*, section 3.3.

use glam::DVec3;
use pirouette_geom::TriMesh;
use pirouette_geom::parallel::prelude::*;

use super::field::{Field, Neighborhood, ramp};

/// Planes of the grid along x (symmetric about 0, none at 0), y and z, in mm, increasing, and their bending
#[derive(Debug, Clone)]
pub(super) struct Grid {
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    pub z: Vec<f64>,
    pub lenses: Lenses,
}

impl Grid {
    fn corner(&self, i: usize, j: usize, k: usize) -> DVec3 {
        self.lenses
            .bend(DVec3::new(self.x[i], self.y[j], self.z[k]))
    }
}

/// Bends a grid so that its cells are smaller at head, hands and feet
///
/// Grid lines contract towards the axis of the forearm and hand as they go outward, towards the head's axis as they go
/// up, and towards the middle of the feet as they go down. Every step preserves their order and the mirror plane.
#[derive(Debug, Clone)]
pub(super) struct Lenses {
    /// Forearm and hand of the left side: from the elbow, where the contraction begins, to the wrist, where it is
    /// complete
    pub forearm: [DVec3; 2],
    /// Ratio of distances from the axis of the hand to those of the grid
    pub hand_scale: f64,
    /// Heights between which the contraction at the head grows from none to full
    pub neck: [f64; 2],
    /// z of the head's axis
    pub head_z: f64,
    /// Ratio of distances from the axis of the head to those of the grid
    pub head_scale: f64,
    /// Range of x in which the contraction at the head fades out: raised arms are not contracted
    pub head_reach: [f64; 2],
    /// Heights between which the contraction at the feet fades from full to none
    pub ankle: [f64; 2],
    /// z of the middle of the feet
    pub foot_z: f64,
    /// Ratio of distances from the middle of the feet to those of the grid
    pub foot_scale: f64,
}

impl Lenses {
    fn bend(&self, p: DVec3) -> DVec3 {
        let x = p.x.abs();
        let [elbow, wrist] = self.forearm;
        let scale = 1.0 - (1.0 - self.hand_scale) * ramp(x, elbow.x, wrist.x);
        let axis = elbow + (wrist - elbow) * ((x - elbow.x) / (wrist.x - elbow.x));
        let y = axis.y + (p.y - axis.y) * scale;
        let z = axis.z + (p.z - axis.z) * scale;

        let here = 1.0 - ramp(x, self.head_reach[0], self.head_reach[1]);
        let head = 1.0 - (1.0 - self.head_scale) * here * ramp(y, self.neck[0], self.neck[1]);
        let foot =
            self.foot_scale + (1.0 - self.foot_scale) * ramp(y, self.ankle[0], self.ankle[1]);
        let z = self.head_z + (z - self.head_z) * head;
        let z = self.foot_z + (z - self.foot_z) * foot;
        DVec3::new(p.x * head * foot, y, z)
    }
}

/// Rounds of redistributing the vertices along the surface
const RELAX_ROUNDS: usize = 5;

/// Share of the way to the middle of its neighbors that a vertex moves per round
const RELAX_STEP: f64 = 0.55;

/// Parts farther than this from the initial position of a vertex do not shape the surface at its final position, in mm
const RELAX_REACH: f64 = 24.0;

/// Step of the numeric gradient, in mm
const GRADIENT_STEP: f64 = 0.5;

const NONE: u32 = u32::MAX;

/// Cells of the grid with i at or beyond the middle; the others are their mirror images
struct Cells<'a> {
    field: &'a Field,
    grid: &'a Grid,
    /// Middle cell along x, which the mirror plane halves
    middle: usize,
    /// Values at the grid's corners, NaN where not evaluated yet
    values: Vec<f32>,
    /// Index into `patches` per cell
    index: Vec<u32>,
    cells: Vec<[usize; 3]>,
}

impl<'a> Cells<'a> {
    fn new(field: &'a Field, grid: &'a Grid) -> Self {
        let middle = (grid.x.len() - 2) / 2;
        let corners = (grid.x.len() - middle) * grid.y.len() * grid.z.len();
        Self {
            field,
            grid,
            middle,
            values: vec![f32::NAN; corners],
            index: vec![NONE; corners],
            cells: Vec::new(),
        }
    }

    /// Index of corner or cell (i, j, k) with i from the middle on
    fn slot(&self, i: usize, j: usize, k: usize) -> usize {
        ((i - self.middle) * self.grid.y.len() + j) * self.grid.z.len() + k
    }

    fn value(&mut self, i: usize, j: usize, k: usize) -> f64 {
        // The corners of the grid mirror into each other: the middle cell lies between grid planes `middle` and `middle
        // + 1`.
        let i = i.max(2 * self.middle + 1 - i);
        let slot = self.slot(i, j, k);
        if self.values[slot].is_nan() {
            self.values[slot] = self.field.value(self.grid.corner(i, j, k)) as f32;
        }
        f64::from(self.values[slot])
    }

    /// Returns the values at the eight corners; bit 0 of the corner is x, bit 1 y, bit 2 z
    fn corners(&mut self, [i, j, k]: [usize; 3]) -> [f64; 8] {
        std::array::from_fn(|c| self.value(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)))
    }

    /// Follows the surface from a cell that it crosses
    fn follow(&mut self, seed: [usize; 3]) {
        let last = [
            self.grid.x.len() - 2,
            self.grid.y.len() - 2,
            self.grid.z.len() - 2,
        ];
        let mut open = vec![seed];
        while let Some(cell) = open.pop() {
            let slot = self.slot(cell[0], cell[1], cell[2]);
            if self.index[slot] != NONE {
                continue;
            }
            let values = self.corners(cell);
            if !mixed(values.iter().copied()) {
                continue;
            }
            self.index[slot] = self.cells.len() as u32;
            self.cells.push(cell);
            for axis in 0..3 {
                for side in 0..2 {
                    let face = (0..8).filter(|c| c >> axis & 1 == side).map(|c| values[c]);
                    if !mixed(face) {
                        continue;
                    }
                    let mut next = cell;
                    if side == 1 {
                        if cell[axis] == last[axis] {
                            continue;
                        }
                        next[axis] += 1;
                    } else if axis == 0 && cell[0] == self.middle {
                        next[0] += 1;
                    } else if cell[axis] > 0 {
                        next[axis] -= 1;
                    } else {
                        continue;
                    }
                    open.push(next);
                }
            }
        }
    }
}

fn mixed(values: impl Iterator<Item = f64>) -> bool {
    let (mut inside, mut outside) = (false, false);
    for value in values {
        if value < 0.0 {
            inside = true;
        } else {
            outside = true;
        }
    }
    inside && outside
}

/// Returns the two corners of a cell's edge; edges `4 * axis + n` run along an axis
fn edge_corners(edge: usize) -> [usize; 2] {
    let (axis, n) = (edge / 4, edge % 4);
    let (first, second) = [(1, 2), (0, 2), (0, 1)][axis];
    let from = (n & 1) << first | (n >> 1) << second;
    [from, from | 1 << axis]
}

/// Returns the same edge in the cell's mirror image
fn mirror_edge(edge: usize) -> usize {
    if edge < 4 { edge } else { edge ^ 1 }
}

/// Returns the edge of a cell between two of its corners
fn edge_between(a: usize, b: usize) -> usize {
    let axis = (a ^ b).trailing_zeros() as usize;
    let (first, second) = [(1, 2), (0, 2), (0, 1)][axis];
    let from = a & b;
    4 * axis + (from >> first & 1) + 2 * (from >> second & 1)
}

/// Per edge of a cell, the smallest edge of the same patch; `None` where no surface crosses
type Patches = [Option<usize>; 12];

/// Returns whether a face of a cell has two diagonally opposite inside corners that lie on one patch of the cell
fn pinched(values: &[f64; 8], patches: &Patches, axis: usize, side: usize) -> bool {
    let (u, v) = [(2, 4), (1, 4), (1, 2)][axis];
    let base = side << axis;
    let ring = [base, base | u, base | u | v, base | v];
    let edge = |i: usize| patches[edge_between(ring[i], ring[(i + 1) % 4])];
    (0..4).all(|i| (values[ring[i]] < 0.0) != (values[ring[(i + 1) % 4]] < 0.0))
        && (1..4).all(|i| edge(i) == edge(0))
}

/// Labels the crossed edges of all cells so that no two cells pinch the surface at the face between them
fn all_patches(cells: &mut Cells) -> Vec<Patches> {
    let values: Vec<[f64; 8]> = (0..cells.cells.len())
        .map(|n| cells.corners(cells.cells[n]))
        .collect();
    let mut labels: Vec<Patches> = values.iter().map(|v| patches(v, 0)).collect();
    let mut joined = vec![0u8; labels.len()];
    for (n, &cell) in cells.cells.iter().enumerate() {
        for axis in 0..3 {
            if !pinched(&values[n], &labels[n], axis, 1) {
                continue;
            }
            let mut next = cell;
            next[axis] += 1;
            let slot = cells.slot(next[0], next[1], next[2]);
            let Some(&other) = cells.index.get(slot).filter(|&&other| other != NONE) else {
                continue;
            };
            let other = other as usize;
            if pinched(&values[other], &labels[other], axis, 0) {
                joined[n] |= 2 << (2 * axis);
                joined[other] |= 1 << (2 * axis);
                if axis == 0 && cell[0] == cells.middle {
                    joined[n] |= 1;
                }
            }
        }
    }
    for (n, &faces) in joined.iter().enumerate().filter(|(_, faces)| **faces != 0) {
        labels[n] = patches(&values[n], faces);
    }
    labels
}

/// Labels the crossed edges of a cell by the patch of surface that crosses them; `None` where no surface crosses
///
/// On a face with two diagonally opposite inside corners, these are separated, or joined where bit `2 * axis + side` of
/// `joined` is set. Neighboring cells share the face and decide alike.
fn patches(values: &[f64; 8], joined: u8) -> Patches {
    let inside = |c: usize| values[c] < 0.0;
    let mut label: [Option<usize>; 12] = std::array::from_fn(|e| {
        let [a, b] = edge_corners(e);
        (inside(a) != inside(b)).then_some(e)
    });
    let mut join = |a: usize, b: usize| {
        if let (Some(x), Some(y)) = (label[a], label[b])
            && x != y
        {
            let (keep, drop) = (x.min(y), x.max(y));
            for l in &mut label {
                if *l == Some(drop) {
                    *l = Some(keep);
                }
            }
        }
    };
    for axis in 0..3 {
        let (u, v) = [(2, 4), (1, 4), (1, 2)][axis];
        for side in 0..2 {
            let base = side << axis;
            let ring = [base, base | u, base | u | v, base | v];
            let edge = |i: usize| edge_between(ring[i % 4], ring[(i + 1) % 4]);
            let mut crossed = (0..4).filter(|&i| inside(ring[i]) != inside(ring[(i + 1) % 4]));
            let (Some(a), Some(b)) = (crossed.next(), crossed.next()) else {
                continue;
            };
            if crossed.next().is_none() {
                join(edge(a), edge(b));
                continue;
            }
            let apart = joined >> (2 * axis + side) & 1 == 0;
            for i in (0..4).filter(|&i| inside(ring[i]) == apart) {
                join(edge(i + 3), edge(i));
            }
        }
    }
    label
}

/// Extracts the piece of surface that a ray from `inside` straight up meets first
///
/// `None` when the ray meets no surface within the grid.
pub(super) fn extract(field: &Field, grid: &Grid, inside: DVec3) -> Option<TriMesh> {
    let mut cells = Cells::new(field, grid);
    let seed = seed_cell(&mut cells, inside)?;
    cells.follow(seed);

    // Vertices: one per patch, next to its mirror image.
    let middle = cells.middle;
    let mut positions: Vec<DVec3> = Vec::new();
    let mut mirror: Vec<u32> = Vec::new();
    let mut vertex_of_edge: Vec<[u32; 12]> = Vec::with_capacity(cells.cells.len());
    let labels = all_patches(&mut cells);
    for (n, label) in labels.iter().enumerate() {
        let cell = cells.cells[n];
        let values = cells.corners(cell);
        let mut vertices = [NONE; 12];
        for first in 0..12 {
            if label[first] != Some(first) || vertices[first] != NONE {
                continue;
            }
            let mut sum = DVec3::ZERO;
            let mut count = 0.0;
            let vertex = positions.len() as u32;
            for e in (0..12).filter(|&e| label[e] == Some(first)) {
                sum += crossing(grid, cell, e, &values);
                count += 1.0;
                vertices[e] = vertex;
            }
            let p = sum / count;
            if cell[0] == middle && vertices[mirror_edge(first)] == vertex {
                positions.push(DVec3::new(0.0, p.y, p.z));
                mirror.push(vertex);
                continue;
            }
            positions.push(p);
            positions.push(DVec3::new(-p.x, p.y, p.z));
            mirror.extend([vertex + 1, vertex]);
            if cell[0] == middle {
                for e in (0..12).filter(|&e| label[e] == Some(first)) {
                    vertices[mirror_edge(e)] = vertex + 1;
                }
            }
        }
        vertex_of_edge.push(vertices);
    }

    let vertex_at = |cell: [usize; 3], edge: usize| -> Option<u32> {
        let mirrored = cell[0] < middle;
        let i = if mirrored {
            2 * middle - cell[0]
        } else {
            cell[0]
        };
        let slot = ((i - middle) * grid.y.len() + cell[1]) * grid.z.len() + cell[2];
        let n = cells.index[slot];
        if n == NONE {
            return None;
        }
        let vertices = &vertex_of_edge[n as usize];
        if mirrored {
            Some(mirror[vertices[mirror_edge(edge)] as usize])
        } else {
            Some(vertices[edge])
        }
    };
    // Quads: around each crossed edge, each emitted from the cell whose lowest corner starts the edge.
    let mut quads: Vec<[u32; 4]> = Vec::new();
    let values = &cells.values;
    let value_at =
        |i: usize, j: usize, k: usize| values[((i - middle) * grid.y.len() + j) * grid.z.len() + k];
    for &[i, j, k] in &cells.cells {
        if i == middle || j == 0 || k == 0 {
            continue;
        }
        let from = value_at(i, j, k) < 0.0;
        for axis in 0..3 {
            let mut end = [i, j, k];
            end[axis] += 1;
            let to = value_at(end[0], end[1], end[2]) < 0.0;
            if from == to {
                continue;
            }
            // The four cells around the edge, counter-clockwise seen from the positive end of the axis.
            let (u, v) = [(1, 2), (2, 0), (0, 1)][axis];
            let around = [(1, 1), (0, 1), (0, 0), (1, 0)];
            let mut quad = [NONE; 4];
            for (slot, (back_u, back_v)) in quad.iter_mut().zip(around) {
                let mut cell = [i, j, k];
                cell[u] -= back_u;
                cell[v] -= back_v;
                let mut low = [0, 0, 0];
                low[u] = back_u;
                low[v] = back_v;
                let corner = low[0] | low[1] << 1 | low[2] << 2;
                *slot = vertex_at(cell, edge_between(corner, corner | 1 << axis))?;
            }
            if !from {
                quad.reverse();
            }
            quads.push(quad);
        }
    }
    relax(field, &mut positions, &mirror, &quads);

    let mut triangles = Vec::with_capacity(4 * quads.len());
    for [a, b, c, d] in quads {
        let length = |p: u32, q: u32| positions[p as usize].distance_squared(positions[q as usize]);
        let pair = if length(a, c) <= length(b, d) {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, b, d], [b, c, d]]
        };
        for [p, q, r] in pair {
            let [mp, mq, mr] = [p, q, r].map(|v| mirror[v as usize]);
            triangles.extend([[p, q, r], [mp, mr, mq]]);
        }
    }
    Some(TriMesh {
        positions,
        triangles,
    })
}

fn seed_cell(cells: &mut Cells, inside: DVec3) -> Option<[usize; 3]> {
    let below = |grid: &[f64], x: f64| grid.partition_point(|&p| p <= x).checked_sub(1);
    let k = below(&cells.grid.z, inside.z)?;
    let start = below(&cells.grid.y, inside.y)?;
    let i = cells.middle;
    (start..cells.grid.y.len() - 1)
        .find(|&j| cells.value(i, j, k) < 0.0 && cells.value(i, j + 1, k) >= 0.0)
        .map(|j| [i, j, k])
}

fn crossing(grid: &Grid, cell: [usize; 3], edge: usize, values: &[f64; 8]) -> DVec3 {
    let at = |c: usize| {
        grid.corner(
            cell[0] + (c & 1),
            cell[1] + (c >> 1 & 1),
            cell[2] + (c >> 2),
        )
    };
    let [a, b] = edge_corners(edge);
    let t = values[a] / (values[a] - values[b]);
    at(a).lerp(at(b), t)
}

/// Distributes the vertices along the surface and projects them onto it
fn relax(field: &Field, positions: &mut [DVec3], mirror: &[u32], quads: &[[u32; 4]]) {
    let count = positions.len();
    let mut neighbors: Vec<Vec<u32>> = vec![Vec::with_capacity(6); count];
    for quad in quads {
        for n in 0..4 {
            let (a, b) = (quad[n] as usize, quad[(n + 1) % 4] as usize);
            for (from, to) in [(a, b), (b, a)] {
                let to_own = to as u32;
                if !neighbors[from].contains(&to_own) {
                    neighbors[from].push(to_own);
                }
                let (from, to) = (mirror[from] as usize, mirror[to]);
                if !neighbors[from].contains(&to) {
                    neighbors[from].push(to);
                }
            }
        }
    }
    let owners: Vec<usize> = (0..count).filter(|&v| v <= mirror[v] as usize).collect();
    let around: Vec<Neighborhood> = owners
        .par_iter()
        .map(|&v| {
            let p = positions[v];
            field.around(DVec3::new(p.x.abs(), p.y, p.z), RELAX_REACH)
        })
        .collect();
    // Zero of the field to first order, with the gradient there or one of a previous round.
    let project =
        |field: &Neighborhood, p: DVec3, middle: bool, known: Option<DVec3>| -> (DVec3, DVec3) {
            let gradient = known.unwrap_or_else(|| {
                let mut gradient = field.gradient(p, GRADIENT_STEP);
                if middle {
                    gradient.x = 0.0;
                }
                gradient
            });
            let squared = gradient.length_squared();
            if squared < 1e-6 {
                return (p, DVec3::ZERO);
            }
            let value = field.value(p);
            // Steps are bounded so that the far side of a crease cannot move a vertex far away.
            let step = (gradient * (value / squared)).clamp_length_max(MAX_STEP);
            (p - step, gradient)
        };
    let mut gradients = vec![DVec3::ZERO; count];
    for round in 0..=RELAX_ROUNDS + 1 {
        let moved: Vec<(DVec3, DVec3)> = owners
            .par_iter()
            .zip(&around)
            .map(|(&v, around)| {
                let middle = mirror[v] as usize == v;
                let (mut p, gradient) = (positions[v], gradients[v]);
                let normal = gradient.normalize_or_zero();
                if round == 0 {
                    return project(around, p, middle, None);
                }
                let ring = &neighbors[v];
                let mean = ring.iter().map(|&n| positions[n as usize]).sum::<DVec3>()
                    / ring.len().max(1) as f64;
                let pull = mean - p;
                let sunk = pull.dot(normal);
                if round > RELAX_ROUNDS {
                    return (p - normal * (sunk * FACET_SHARE), gradient);
                }
                p += RELAX_STEP * (pull - normal * sunk);
                if middle {
                    p.x = 0.0;
                }
                let fresh = round % 2 == 0 || round == RELAX_ROUNDS;
                project(around, p, middle, (!fresh).then_some(gradient))
            })
            .collect();
        for (&v, (mut p, gradient)) in owners.iter().zip(moved) {
            p.y = p.y.max(0.0);
            let m = mirror[v] as usize;
            positions[v] = p;
            gradients[v] = gradient;
            if m != v {
                positions[m] = DVec3::new(-p.x, p.y, p.z);
                gradients[m] = DVec3::new(-gradient.x, gradient.y, gradient.z);
            }
        }
    }
}

/// Distance by which the vertices finally protrude from the surface, as a share of the sag of the middle of their
/// neighbors
///
/// Flat facets between vertices on a curved surface run below it: the mesh would be too thin, a wrist by 1.4 %. With
/// neighbors at distance c and curvatures a and b the middle of four neighbors sags by c^2/4 (a + b), and the facets
/// run c^2/12 (a + b) below the surface on average.
const FACET_SHARE: f64 = 1.0 / 3.0;

/// Longest step of one projection, in mm
const MAX_STEP: f64 = 4.0;
