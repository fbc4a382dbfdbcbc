//! The regular grid at whose corners a field is sampled.

use std::collections::BTreeMap;

use crate::parallel::prelude::*;
use glam::DVec3;

use super::{
    BRICK, BRICK_NODES, Field, MAX_CELLS, NODE, SurfaceError, SurfaceOptions, cube_corner,
    node_mask, offset,
};

/// The field on the corners of a regular grid
pub(super) struct Lattice<'a, F> {
    pub(super) field: &'a F,
    lo: DVec3,
    pub(super) cell_size: f64,
    lipschitz: f64,
    pub(super) secant_steps: usize,
    /// Cells along each axis
    pub(super) counts: [u32; 3],
}

impl<'a, F: Field> Lattice<'a, F> {
    pub(super) fn new(field: &'a F, options: &SurfaceOptions) -> Result<Self, SurfaceError> {
        let SurfaceOptions {
            lo,
            hi,
            cell_size,
            lipschitz,
            secant_steps,
            thin_pieces: _,
        } = *options;
        if !(cell_size.is_finite() && cell_size > 0.0) {
            return Err(SurfaceError::CellSize { cell_size });
        }
        if !(lipschitz.is_finite() && lipschitz > 0.0) {
            return Err(SurfaceError::Lipschitz { lipschitz });
        }
        let cells = ((hi - lo) / cell_size).map(f64::ceil);
        let countable = |n: f64| (1.0..=f64::from(MAX_CELLS)).contains(&n);
        if !(lo.is_finite() && cells.to_array().into_iter().all(countable)) {
            return Err(SurfaceError::Cells {
                x: cells.x,
                y: cells.y,
                z: cells.z,
                limit: MAX_CELLS,
            });
        }
        Ok(Self {
            field,
            lo,
            cell_size,
            lipschitz,
            secant_steps,
            counts: cells.to_array().map(|n| n as u32),
        })
    }

    pub(super) fn position(&self, corner: [u32; 3]) -> DVec3 {
        self.lo + DVec3::from_array(corner.map(f64::from)) * self.cell_size
    }

    /// Returns the field value at a corner, bounded as by [`Self::bounded`]
    pub(super) fn value(&self, corner: [u32; 3], part: F::Part) -> f64 {
        self.bounded(corner, self.field.value(self.position(corner), part))
    }

    /// Whether a corner is inside
    fn is_inside(&self, corner: [u32; 3], part: F::Part) -> bool {
        !self.on_border(corner) && self.field.is_inside(self.position(corner), part)
    }

    /// Whether a corner lies on the border of the grid, where all is outside
    fn on_border(&self, corner: [u32; 3]) -> bool {
        (0..3).any(|a| corner[a] == 0 || corner[a] >= self.counts[a])
    }

    /// Returns the value at the center corner of a cube of `size` cells, and the part of the field in the cube
    pub(super) fn middle(&self, corner: [u32; 3], size: u32, of: F::Part) -> (f64, F::Part) {
        let radius = f64::from(size) * self.cell_size * 3f64.sqrt() / 2.0;
        let (value, part) = self.field.near(self.position(corner), radius, of);
        (self.bounded(corner, value), part)
    }

    /// Returns the value of a corner, made positive where nothing may be inside
    pub(super) fn bounded(&self, corner: [u32; 3], value: f64) -> f64 {
        if value.is_nan() {
            self.cell_size
        } else if self.on_border(corner) {
            value.max(self.cell_size)
        } else {
            value
        }
    }

    /// Whether the surface may pass through the cube of `size` cells at `origin` whose center has this value
    pub(super) fn may_cut(&self, origin: [u32; 3], size: u32, center: f64) -> bool {
        let half_diagonal = f64::from(size) * self.cell_size * 3f64.sqrt() / 2.0;
        let near = center.abs() <= self.lipschitz * half_diagonal;
        let on_border =
            (0..3).any(|a| origin[a] == 0 || origin[a].saturating_add(size) >= self.counts[a]);
        near || (center < 0.0 && on_border)
    }

    /// Returns the origins of the bricks near the surface
    pub(super) fn find_bricks(&self) -> Vec<[u32; 3]> {
        let longest = self.counts.into_iter().max().unwrap_or(1);
        let mut size = longest.next_power_of_two().max(BRICK);
        let mut blocks = vec![[0; 3]];
        while size > BRICK {
            let half = size / 2;
            blocks = blocks
                .par_iter()
                .filter(|&&origin| {
                    let center = self.value(origin.map(|o| o + half), self.field.whole());
                    self.may_cut(origin, size, center)
                })
                .flat_map_iter(|&origin| {
                    (0..8).map(move |child| offset(origin, cube_corner(child), half))
                })
                .filter(|origin| (0..3).all(|a| origin[a] < self.counts[a]))
                .collect();
            size = half;
        }
        blocks
    }

    /// Maps each brick with an edge that the surface crosses to a node on that edge, by the key of the brick's origin
    pub(super) fn find_crossings(&self) -> BTreeMap<u64, Option<u64>> {
        let bricks = self.find_bricks();
        let corners = |origin: [u32; 3]| (0..8).map(move |c| offset(origin, cube_corner(c), BRICK));
        let mut all: Vec<u64> = bricks
            .iter()
            .flat_map(|&origin| corners(origin).map(place_key))
            .collect();
        all.par_sort_unstable();
        all.dedup();
        let whole = self.field.whole();
        let inside = |&key: &u64| self.is_inside(place_of_key(key), whole);
        let sides: Vec<bool> = all.par_iter().map(inside).collect();
        let side = |corner| {
            all.binary_search(&place_key(corner))
                .is_ok_and(|at| sides[at])
        };
        let crossed_node = |&origin: &[u32; 3]| {
            let sides = corners(origin).map(side);
            let inside = sides
                .enumerate()
                .fold(0u8, |all, (c, s)| all | u8::from(s) << c);
            // A corner, and the axis along which the next corner is on the other side
            let (corner, axis) = (0..8u32)
                .flat_map(|c| (0..3).map(move |axis| (c, axis)))
                .filter(|(c, axis)| c >> axis & 1 == 0)
                .find(|(c, axis)| (inside >> c ^ inside >> (c | 1 << axis)) & 1 != 0)?;
            let first = offset([0; 3], cube_corner(corner), BRICK);
            let along = |step: u32| {
                let mut local = first;
                local[axis] = step * NODE;
                local
            };
            let inside_at = |step| self.is_inside(offset(origin, along(step), 1), whole);
            let start = inside >> corner & 1 != 0;
            // The end is on the other side, as found above.
            let step = (1..BRICK_NODES).find(|&step| inside_at(step) != start);
            let cell = along(step.unwrap_or(BRICK_NODES) - 1).map(|v| v.min(BRICK - NODE));
            Some((place_key(origin), Some(node_mask(cell))))
        };
        bricks.par_iter().filter_map(crossed_node).collect()
    }
}

/// Returns the key of a grid place; keys are ordered by layers along y
///
/// Lookups for one layer from all directions, as by silhouettes of a person turning about the y axis, are close
/// together in memory.
pub(super) fn place_key(place: [u32; 3]) -> u64 {
    // 21 bits hold an index up to MAX_CELLS.
    let [x, y, z] = place.map(u64::from);
    (y << 21 | z) << 21 | x
}

/// Returns the place of a key
pub(super) fn place_of_key(key: u64) -> [u32; 3] {
    [key, key >> 42, key >> 21].map(|bits| (bits & ((1 << 21) - 1)) as u32)
}
