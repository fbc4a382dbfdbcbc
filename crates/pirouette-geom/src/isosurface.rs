//! Surface extraction from a scalar field on an adaptive grid.
//!
//! The field is negative inside and positive outside. Coarse blocks of cells are refined only where the surface can
//! be, according to a bound on the slope of the field; the finest cells are cut by marching cubes with cases that
//! depend only on data shared by neighboring cells.
//!
//! For any field, the mesh is closed, manifold in edges and vertices, and oriented outward: the surface is followed
//! into every cell that it enters, even where the bound is wrong. A wrong bound can only lose separate pieces.
//! Features thinner than a cell, and separate pieces within two cells, can be lost; sharp edges are chamfered.
//!
//! # Source
//! Lorensen and Cline, "Marching Cubes: A High Resolution 3D Surface Construction Algorithm", SIGGRAPH 1987.

mod crossing;
mod cube_cases;
mod field;
mod lattice;

use std::collections::{BTreeMap, HashMap};

use crate::parallel::prelude::*;
use foldhash::fast::FixedState;
use glam::DVec3;

use crate::tri_mesh::TriMesh;
use crossing::{Crossing, refine};
use cube_cases::{CASES, CubeCase, EDGE_COUNT, lower_corner};
use lattice::{Lattice, place_key, place_of_key};

pub use field::Field;

/// Region and resolution of the surface extraction
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceOptions {
    /// Corner of the box with the smallest coordinates; origin of the grid
    pub lo: DVec3,
    /// Corner of the box with the largest coordinates; the grid ends there or up to one cell beyond
    ///
    /// A solid that reaches the border of the grid is closed there, within the outermost cells.
    pub hi: DVec3,
    /// Edge length of the finest cells; halving it takes four times the time and the triangles
    pub cell_size: f64,
    /// Upper bound of the field's change per length; 1 for a distance in the unit of the box
    ///
    /// Larger values search more blocks for separate pieces.
    pub lipschitz: f64,
    /// Field evaluations that refine each vertex along its grid edge, after linear interpolation
    pub secant_steps: usize,
    /// Whether to search for separate pieces that pass between the corners of blocks of eight cells along each axis;
    /// without, they are found only where there are no thicker pieces, in half the time
    pub thin_pieces: bool,
}

/// Error of a grid that cannot be created
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// The cell size is not a positive number
    #[error("the cell size must be positive and finite, not {cell_size}")]
    CellSize {
        /// The cell size given
        cell_size: f64,
    },
    /// The slope bound is not a positive number
    #[error("the bound of the field's slope must be positive and finite, not {lipschitz}")]
    Lipschitz {
        /// The bound given
        lipschitz: f64,
    },
    /// The box is empty, not finite, or needs too many cells
    #[error(
        "the box needs between 1 and {limit} cells along each axis, not {x:.0} x {y:.0} x {z:.0}"
    )]
    Cells {
        /// Cells along x
        x: f64,
        /// Cells along y
        y: f64,
        /// Cells along z
        z: f64,
        /// Most cells along an axis
        limit: u32,
    },
}

/// Maximum number of cells along an axis: three corner indices and an axis fit into a 64-bit key
const MAX_CELLS: u32 = 1 << 20;

/// Cells along a brick, the block in which values are stored
const BRICK: u32 = 8;
/// Cells along a node, the block that is activated as a unit
const NODE: u32 = 2;
/// Nodes along a brick; the nodes of a brick fit into the bits of one `u64`
const BRICK_NODES: u32 = BRICK / NODE;
/// Corners along a brick
const BRICK_CORNERS: usize = BRICK as usize + 1;

/// Corners of the cells of a node
const NODE_CORNERS: usize = (NODE as usize + 1).pow(3);

/// Bits of the node corners on each face, by axis and side
const NODE_FACES: [[u32; 2]; 3] = {
    let mut faces = [[0; 2]; 3];
    let mut corner = 0;
    while corner < NODE_CORNERS as u32 {
        let place = node_corner_place(corner);
        let mut axis = 0;
        while axis < 3 {
            if place[axis].is_multiple_of(NODE) {
                faces[axis][(place[axis] / NODE) as usize] |= 1 << corner;
            }
            axis += 1;
        }
        corner += 1;
    }
    faces
};

/// Corners of each cell of a node, as indices of the node's corners
const CELL_CORNERS: [[u32; 8]; 8] = {
    let mut corners = [[0; 8]; 8];
    let mut i = 0;
    while i < 64 {
        let (cell, corner) = (i / 8, i % 8);
        let (a, b) = (cube_corner(cell), cube_corner(corner));
        let side = NODE + 1;
        corners[cell as usize][corner as usize] =
            a[0] + b[0] + side * (a[1] + b[1] + side * (a[2] + b[2]));
        i += 1;
    }
    corners
};

/// Extracts the surface where `field` changes its sign; returns an empty mesh when it does not
///
/// A field value of zero or NaN counts as outside. Closures implement [`Field`].
///
/// # Errors
/// When the options do not describe a valid grid.
///
/// # Examples
/// ```
/// use glam::DVec3;
/// use pirouette_geom::isosurface::{SurfaceOptions, extract_surface};
/// let options = SurfaceOptions {
///     lo: DVec3::splat(-1.2),
///     hi: DVec3::splat(1.2),
///     cell_size: 0.1,
///     lipschitz: 1.0,
///     secant_steps: 0,
///     thin_pieces: true,
/// };
/// let ball = extract_surface(|p: DVec3| p.length() - 1.0, &options)?;
/// assert_eq!(ball.check(), Ok(()));
/// assert!((ball.volume() - 4.19).abs() < 0.04);
/// # Ok::<(), pirouette_geom::isosurface::SurfaceError>(())
/// ```
#[expect(
    clippy::needless_pass_by_value,
    reason = "closures are written where they are handed over"
)]
pub fn extract_surface(
    field: impl Field,
    options: &SurfaceOptions,
) -> Result<TriMesh, SurfaceError> {
    let grid = Lattice::new(&field, options)?;
    // Bricks by the keys of their origins
    let mut bricks = BTreeMap::new();
    let mut pending = BTreeMap::new();
    if !options.thin_pieces {
        pending = grid.find_crossings();
    }
    if pending.is_empty() {
        let found = grid.find_bricks().into_iter();
        pending = found.map(|origin| (place_key(origin), None)).collect();
    }
    while !pending.is_empty() {
        let mut work = Vec::with_capacity(pending.len());
        for (key, nodes) in pending {
            let mut brick = bricks
                .remove(&key)
                .unwrap_or_else(|| Brick::new(place_of_key(key)));
            brick.wanted = nodes.map_or(Wanted::Search, Wanted::Nodes);
            work.push(brick);
        }
        let requests: Vec<Vec<NodeRequest>> = work
            .par_iter_mut()
            .map(|brick| brick.sample(&grid))
            .collect();
        // Most searched bricks turn out empty: drop them immediately, or they would fill the memory.
        let found = work.into_iter().filter(|brick| brick.active != 0);
        bricks.extend(found.map(|brick| (place_key(brick.origin), brick)));
        pending = BTreeMap::new();
        for (key, node) in requests.into_iter().flatten() {
            let active = bricks.get(&key).map_or(0, |brick| brick.active);
            if active & node == 0 {
                *pending.entry(key).or_insert(Some(0)).get_or_insert(0) |= node;
            }
        }
    }
    let bricks: Vec<Brick<_>> = bricks.into_values().collect();
    let pieces: Vec<Piece> = bricks
        .par_iter()
        .map_init(Vec::new, |scratch, brick| brick.cut(&grid, scratch))
        .collect();
    Ok(weld(pieces))
}

/// Key of a brick's origin, and bits of its nodes
type NodeRequest = (u64, u64);

/// Next step for a brick
#[derive(Debug, Clone, Copy)]
enum Wanted {
    /// Find the nodes near the surface
    Search,
    /// Activate these nodes
    Nodes(u64),
}

/// A cube of cells with the field values at the corners that were evaluated
#[derive(Debug)]
struct Brick<P> {
    /// First cell
    origin: [u32; 3],
    /// Values at the corners, NaN where not evaluated; x runs fastest; empty before the first evaluation
    values: Vec<f32>,
    /// Active nodes, one bit each; x runs fastest
    active: u64,
    /// The active nodes, sorted by bit
    nodes: Vec<Node<P>>,
    wanted: Wanted,
}

/// A block of cells that the surface enters
#[derive(Debug)]
struct Node<P> {
    /// Its bit in the brick
    bit: u32,
    /// Corners inside, one bit each; x runs fastest
    inside: u32,
    /// Part of the field in the node
    part: P,
}

impl<P: Copy> Brick<P> {
    fn new(origin: [u32; 3]) -> Self {
        Self {
            origin,
            values: Vec::new(),
            active: 0,
            nodes: Vec::new(),
            wanted: Wanted::Search,
        }
    }

    #[inline]
    fn slot(local: [u32; 3]) -> usize {
        let [x, y, z] = local.map(|v| v as usize);
        x + BRICK_CORNERS * (y + BRICK_CORNERS * z)
    }

    fn value<F: Field<Part = P>>(&mut self, grid: &Lattice<F>, local: [u32; 3], part: P) -> f64 {
        match self.values.get(Self::slot(local)) {
            Some(&value) if !value.is_nan() => f64::from(value),
            _ => self.store_value(local, grid.value(offset(self.origin, local, 1), part)),
        }
    }

    /// Stores the value of a corner and returns the stored value
    fn store_value(&mut self, local: [u32; 3], value: f64) -> f64 {
        if self.values.is_empty() {
            self.values.resize(BRICK_CORNERS.pow(3), f32::NAN);
        }
        let value = rounded(value);
        self.values[Self::slot(local)] = value;
        f64::from(value)
    }

    /// Returns the part of the field in this brick
    fn part<F: Field<Part = P>>(&self, grid: &Lattice<F>) -> P {
        let middle = offset(self.origin, [1; 3], BRICK / 2);
        grid.middle(middle, BRICK, grid.field.whole()).1
    }

    /// Activates the wanted nodes and follows the surface through the brick
    ///
    /// Returns the nodes of other bricks into which the surface continues.
    fn sample<F: Field<Part = P>>(&mut self, grid: &Lattice<F>) -> Vec<NodeRequest> {
        let (mut queue, part) = match self.wanted {
            Wanted::Search => self.search_nodes(grid),
            Wanted::Nodes(nodes) => (nodes, self.part(grid)),
        };
        let mut requests = Vec::new();
        while queue != 0 {
            let bit = queue.trailing_zeros();
            queue &= queue - 1;
            if self.active & (1 << bit) != 0 {
                continue;
            }
            self.active |= 1 << bit;
            let first = node_corner(bit);
            // This value determines the part of the field for the other corners.
            let middle = offset(first, [1; 3], NODE / 2);
            let (value, part) = grid.middle(offset(self.origin, middle, 1), NODE, part);
            self.store_value(middle, value);
            let inside = self.evaluate(grid, part, first);
            self.nodes.push(Node { bit, inside, part });
            for (axis, faces) in NODE_FACES.iter().enumerate() {
                for (side, face) in faces.iter().enumerate() {
                    if inside & face == 0 || inside & face == *face {
                        continue;
                    }
                    let mut neighbor = offset(self.origin, first, 1);
                    if side == 1 {
                        neighbor[axis] += NODE;
                    } else if neighbor[axis] >= NODE {
                        neighbor[axis] -= NODE;
                    } else {
                        continue;
                    }
                    let origin = neighbor.map(|v| v / BRICK * BRICK);
                    let mask = node_mask(neighbor.map(|v| v % BRICK));
                    if origin == self.origin {
                        queue |= mask & !self.active;
                    } else {
                        requests.push((place_key(origin), mask));
                    }
                }
            }
        }
        // Makes meshes independent of where the surface was found first
        self.nodes.sort_unstable_by_key(|node| node.bit);
        requests
    }

    /// Evaluates the missing corners of all cells of a node; returns the bits of the corners inside
    fn evaluate<F: Field<Part = P>>(&mut self, grid: &Lattice<F>, part: P, first: [u32; 3]) -> u32 {
        let mut inside = 0;
        let mut corners = [(0, [0; 3]); NODE_CORNERS];
        let mut points = [DVec3::ZERO; NODE_CORNERS];
        let mut count = 0;
        for corner in 0..NODE_CORNERS as u32 {
            let local = offset(first, node_corner_place(corner), 1);
            let value = self.values[Self::slot(local)];
            if value.is_nan() {
                corners[count] = (corner, local);
                points[count] = grid.position(offset(self.origin, local, 1));
                count += 1;
            } else {
                inside |= u32::from(value < 0.0) << corner;
            }
        }
        let mut values = [0.0; NODE_CORNERS];
        grid.field
            .values(&points[..count], part, &mut values[..count]);
        for (&(corner, local), &value) in corners[..count].iter().zip(&values) {
            let value = grid.bounded(offset(self.origin, local, 1), value);
            inside |= u32::from(self.store_value(local, value) < 0.0) << corner;
        }
        inside
    }

    /// Finds nodes near the surface, from coarse to fine, and the part of the field in this brick
    fn search_nodes<F: Field<Part = P>>(&mut self, grid: &Lattice<F>) -> (u64, P) {
        let middle = offset(self.origin, [1; 3], BRICK / 2);
        let (center, part) = grid.middle(middle, BRICK, grid.field.whole());
        if !grid.may_cut(self.origin, BRICK, center) {
            return (0, part);
        }
        let mut found = 0;
        let mut blocks = vec![([0; 3], BRICK)];
        while let Some((local, size)) = blocks.pop() {
            let half = size / 2;
            let center = self.value(grid, local.map(|v| v + half), part);
            if !grid.may_cut(offset(self.origin, local, 1), size, center) {
                continue;
            }
            if size > NODE {
                blocks.extend((0..8).map(|child| (offset(local, cube_corner(child), half), half)));
            } else if self.is_mixed(grid, part, local, center < 0.0) {
                found |= node_mask(local);
            }
        }
        (found, part)
    }

    /// Whether some corner of a node is on the other side of the surface than its center
    ///
    /// Other surfaces that enter the node are followed from its neighbors.
    fn is_mixed<F: Field<Part = P>>(
        &mut self,
        grid: &Lattice<F>,
        part: P,
        first: [u32; 3],
        inside: bool,
    ) -> bool {
        (0..8).any(|corner| {
            let local = offset(first, cube_corner(corner), NODE);
            (self.value(grid, local, part) < 0.0) != inside
        })
    }

    /// Cuts all cells of the active nodes
    fn cut<F: Field<Part = P>>(&self, grid: &Lattice<F>, vertex_of_edge: &mut Vec<u32>) -> Piece {
        let mut piece = Piece::default();
        vertex_of_edge.clear();
        vertex_of_edge.resize(3 * self.values.len(), u32::MAX);
        let mut crossings = Vec::new();
        for node in &self.nodes {
            let mut cells = [(&CASES[0], [0; EDGE_COUNT as usize]); 8];
            for (child, (case, vertices)) in cells.iter_mut().enumerate() {
                *case = &CASES[node.case(child)];
                let cell = offset(node_corner(node.bit), cube_corner(child as u32), 1);
                for &edge in &case.edges {
                    let from = offset(cell, cube_corner(u32::from(lower_corner(edge))), 1);
                    let axis = usize::from(edge / 4);
                    let slot = &mut vertex_of_edge[3 * Self::slot(from) + axis];
                    if *slot == u32::MAX {
                        *slot = (piece.positions.len() + crossings.len()) as u32;
                        piece.keys.push(self.edge_key(from, axis));
                        crossings.push(self.crossing(grid, from, axis));
                    }
                    vertices[usize::from(edge)] = *slot;
                }
            }
            refine(grid.field, node.part, grid.secant_steps, &mut crossings);
            let positions = crossings.drain(..).map(|crossing| crossing.position());
            piece.positions.extend(positions);
            for (case, vertices) in cells {
                piece.add(case, &vertices);
            }
        }
        piece
    }

    /// Returns the key of a grid edge that other bricks share, `None` for one inside this brick
    fn edge_key(&self, from: [u32; 3], axis: usize) -> Option<u64> {
        let shared = (0..3).any(|a| a != axis && (from[a] == 0 || from[a] == BRICK));
        shared.then(|| {
            // Keys of places exceed 2^62 only slightly.
            place_key(offset(self.origin, from, 1)) * 3 + axis as u64
        })
    }

    /// Returns a grid edge along which the field changes its sign
    fn crossing<F: Field<Part = P>>(
        &self,
        grid: &Lattice<F>,
        from: [u32; 3],
        axis: usize,
    ) -> Crossing {
        let mut to = from;
        to[axis] += 1;
        Crossing::new(
            grid.position(offset(self.origin, from, 1)),
            DVec3::AXES[axis] * grid.cell_size,
            [from, to].map(|corner| f64::from(self.values[Self::slot(corner)])),
        )
    }
}

/// Rounds a value for storage
fn rounded(value: f64) -> f32 {
    // Bounded so that interpolation between two corners stays finite
    let bound = f64::from(f32::MAX) / 4.0;
    let rounded = value.clamp(-bound, bound) as f32;
    // Rounding to f32 must not turn a tiny negative value into zero, which is outside.
    if value < 0.0 {
        rounded.min(-f32::MIN_POSITIVE)
    } else {
        rounded
    }
}

impl<P> Node<P> {
    /// Returns the index of the cube case of a cell: the bits of its corners inside
    #[inline]
    fn case(&self, cell: usize) -> usize {
        CELL_CORNERS[cell]
            .iter()
            .enumerate()
            .fold(0, |case, (bit, &corner)| {
                case | ((self.inside >> corner & 1) as usize) << bit
            })
    }
}

/// Part of the surface within one brick
#[derive(Debug, Default)]
struct Piece {
    positions: Vec<DVec3>,
    /// Key of each vertex that other bricks share
    keys: Vec<Option<u64>>,
    triangles: Vec<[u32; 3]>,
}

impl Piece {
    /// Adds the triangles of a cell, given the vertices on its edges
    fn add(&mut self, case: &CubeCase, vertices: &[u32; EDGE_COUNT as usize]) {
        let first_center = self.positions.len() as u32;
        for polygon in &case.centers {
            let corners = polygon.iter().map(|&edge| vertices[usize::from(edge)]);
            let sum: DVec3 = corners.map(|v| self.positions[v as usize]).sum();
            self.keys.push(None);
            self.positions.push(sum / polygon.len() as f64);
        }
        let vertex = |corner: u8| match corner.checked_sub(EDGE_COUNT) {
            Some(center) => first_center + u32::from(center),
            None => vertices[usize::from(corner)],
        };
        for &[a, b, c] in &case.triangles {
            self.triangles.push([vertex(a), vertex(b), vertex(c)]);
        }
    }
}

/// Joins the pieces at shared vertices
fn weld(pieces: Vec<Piece>) -> TriMesh {
    let vertex_count = pieces.iter().map(|piece| piece.positions.len()).sum();
    let triangle_count = pieces.iter().map(|piece| piece.triangles.len()).sum();
    let mut mesh = TriMesh {
        positions: Vec::with_capacity(vertex_count),
        triangles: Vec::with_capacity(triangle_count),
    };
    let mut vertex_of_key: HashMap<u64, u32, FixedState> = HashMap::default();
    for piece in pieces {
        let vertices: Vec<u32> = piece
            .positions
            .iter()
            .zip(&piece.keys)
            .map(|(&position, key)| {
                let next = mesh.positions.len() as u32;
                let vertex = match key {
                    Some(key) => *vertex_of_key.entry(*key).or_insert(next),
                    None => next,
                };
                if vertex == next {
                    mesh.positions.push(position);
                }
                vertex
            })
            .collect();
        mesh.triangles.extend(
            piece
                .triangles
                .iter()
                .map(|t| t.map(|v| vertices[v as usize])),
        );
    }
    mesh
}

/// Returns the first cell, within its brick, of the node with this bit
fn node_corner(bit: u32) -> [u32; 3] {
    let node = [bit, bit / BRICK_NODES, bit / BRICK_NODES / BRICK_NODES];
    node.map(|n| n % BRICK_NODES * NODE)
}

/// Returns the position of a corner within its node; x runs fastest
const fn node_corner_place(corner: u32) -> [u32; 3] {
    const SIDE: u32 = NODE + 1;
    [corner % SIDE, corner / SIDE % SIDE, corner / SIDE / SIDE]
}

/// Returns the bit of the node that contains a cell of its brick
fn node_mask(cell: [u32; 3]) -> u64 {
    let [x, y, z] = cell.map(|v| v / NODE);
    1 << (x + BRICK_NODES * (y + BRICK_NODES * z))
}

/// Returns the corner of the unit cube with these bits
#[inline]
const fn cube_corner(bits: u32) -> [u32; 3] {
    [bits & 1, bits >> 1 & 1, bits >> 2 & 1]
}

#[inline]
fn offset(origin: [u32; 3], by: [u32; 3], step: u32) -> [u32; 3] {
    std::array::from_fn(|a| origin[a] + by[a] * step)
}

#[cfg(test)]
mod tests;
