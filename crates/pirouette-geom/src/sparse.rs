//! Sparse Cholesky factorization for repeated solves; wraps `faer`.
//!
//! [`BlockSolver`] solves systems of points in space: it analyzes the sparsity pattern once, and factorizes again
//! whenever the values change.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, amd};
use faer::sparse::{SparseColMat, SparseColMatRef, SymbolicSparseColMat, Triplet};
use faer::{Conj, Mat, Par, Side};
use glam::{DMat3, DVec2, DVec3};

/// Pivots below this fraction of the largest diagonal entry are rounding noise
///
/// The matrices here are positive definite by construction; such a small pivot comes from triangles that are
/// degenerate beyond double precision.
const SMALLEST_PIVOT: f64 = 1e-14;

/// The factor of one symmetric positive definite matrix
pub(crate) struct Cholesky {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
}

impl Cholesky {
    /// Factorizes the `size` x `size` matrix with these entries `(row, column, value)` on and below the diagonal
    ///
    /// Entries at the same position are summed. `None` when memory runs out or a value is NaN.
    pub(crate) fn factor(size: usize, lower: &[(usize, usize, f64)]) -> Option<Self> {
        let triplets: Vec<Triplet<usize, usize, f64>> = lower
            .iter()
            .map(|&(row, column, value)| Triplet::new(row, column, value))
            .collect();
        let matrix = SparseColMat::try_new_from_triplets(size, size, &triplets).ok()?;
        // Simplicial: on meshes of this size the supernodal variant solves two to five times slower.
        let parameters = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
            ..Default::default()
        };
        let symbolic = factorize_symbolic_cholesky(
            matrix.symbolic(),
            Side::Lower,
            SymmetricOrdering::Amd,
            parameters,
        )
        .ok()?;
        let largest = lower.iter().fold(0.0, |m: f64, e| m.max(e.2.abs()));
        let regularization = LltRegularization {
            dynamic_regularization_delta: largest,
            dynamic_regularization_epsilon: largest * SMALLEST_PIVOT,
        };
        let mut values = vec![0.0; symbolic.len_val()];
        let mut memory = MemBuffer::try_new(
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default()),
        )
        .ok()?;
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                regularization,
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .ok()?;
        Some(Self { symbolic, values })
    }

    /// Allocates the memory for [`Cholesky::solve_in_place`], reusable for many solves
    pub(crate) fn workspace(&self) -> Workspace {
        Workspace {
            memory: MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(2, Par::Seq)),
            columns: Mat::zeros(self.symbolic.nrows(), 2),
        }
    }

    /// Replaces the right-hand sides, one x and one y per row, by the solution
    pub(crate) fn solve_in_place(&self, right: &mut [DVec2], workspace: &mut Workspace) {
        let Workspace { memory, columns } = workspace;
        for (i, p) in right.iter().enumerate() {
            columns[(i, 0)] = p.x;
            columns[(i, 1)] = p.y;
        }
        LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            columns.as_mut(),
            Par::Seq,
            MemStack::new(memory),
        );
        for (i, p) in right.iter_mut().enumerate() {
            *p = DVec2::new(columns[(i, 0)], columns[(i, 1)]);
        }
    }
}

/// Buffers for the solves with one factor
pub(crate) struct Workspace {
    memory: MemBuffer,
    columns: Mat<f64>,
}

/// A symmetric positive definite matrix of 3x3 blocks with a fixed pattern, and its factor
///
/// Each block row and column belongs to one point; the unknowns of a point are its x, y and z.
pub struct BlockSolver {
    /// Position of each point in the elimination order, which is the order of all fields below
    turns: Vec<u32>,
    /// Columns of points: blocks on and below the diagonal are `rows[first[c]..first[c + 1]]`, the diagonal's first
    first: Vec<usize>,
    rows: Vec<u32>,
    blocks: Vec<DMat3>,
    matrix: SymbolicSparseColMat<usize>,
    entries: Vec<f64>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
    memory: MemBuffer,
    right: Mat<f64>,
}

/// Position of the block of two points in a [`BlockSolver`]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    at: u32,
    /// Whether the point with the higher index is eliminated first, so that its block is stored transposed
    transposed: bool,
}

impl std::fmt::Debug for BlockSolver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BlockSolver")
            .field("points", &(self.first.len() - 1))
            .field("blocks", &self.rows.len())
            .field("factor_entries", &self.factor.len())
            .finish()
    }
}

/// Returns the lower triangle of a symmetric pattern by columns: column starts, and rows in ascending order
fn columns_below(size: usize, mut pairs: Vec<[u32; 2]>) -> (Vec<usize>, Vec<u32>) {
    pairs.sort_unstable();
    pairs.dedup();
    let mut first = vec![0; size + 1];
    for pair in &pairs {
        first[pair[0] as usize + 1] += 1;
    }
    for c in 0..size {
        first[c + 1] += first[c];
    }
    (first, pairs.iter().map(|pair| pair[1]).collect())
}

/// Computes the position of each point in a fill-reducing elimination order; `None` when memory runs out
///
/// Ordering points takes a ninth of the entries that ordering their unknowns does.
fn elimination_order(first: &[usize], rows: &[u32]) -> Option<Vec<u32>> {
    let points = first.len() - 1;
    let rows: Vec<usize> = rows.iter().map(|&row| row as usize).collect();
    let scratch = amd::order_scratch::<usize>(points, rows.len());
    let pattern = SymbolicSparseColMat::new_checked(points, points, first.to_vec(), None, rows);
    let (mut order, mut turns) = (vec![0; points], vec![0; points]);
    let mut memory = MemBuffer::try_new(scratch).ok()?;
    amd::order(
        &mut order,
        &mut turns,
        pattern.as_ref(),
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .ok()?;
    Some(turns.into_iter().map(|turn| turn as u32).collect())
}

/// Expands the blocks on and below the diagonal of a column pattern to scalar entries
fn entry_pattern(first: &[usize], rows: &[u32]) -> SymbolicSparseColMat<usize> {
    let points = first.len() - 1;
    let mut column_starts = vec![0usize];
    let mut row_indices = Vec::with_capacity(9 * rows.len());
    for c in 0..points {
        for k in 0..3 {
            for &row in &rows[first[c]..first[c + 1]] {
                let from = if row as usize == c { k } else { 0 };
                row_indices.extend((from..3).map(|j| 3 * row as usize + j));
            }
            column_starts.push(row_indices.len());
        }
    }
    let size = 3 * points;
    SymbolicSparseColMat::new_checked(size, size, column_starts, None, row_indices)
}

impl BlockSolver {
    /// Analyzes the pattern: `pairs` lists the points that share a block, in any order, repeats allowed
    ///
    /// `None` when memory runs out.
    ///
    /// # Panics
    /// When a pair refers to a point that does not exist.
    pub fn new(points: usize, pairs: &[[u32; 2]]) -> Option<Self> {
        assert!(
            pairs.iter().flatten().all(|&p| (p as usize) < points),
            "pairs refer to existing points"
        );
        let below = |number: &dyn Fn(u32) -> u32| {
            let own = (0..points as u32).map(|p| [p, p]);
            let pairs = own.chain(pairs.iter().copied());
            let numbers = pairs.map(|pair| pair.map(number));
            columns_below(points, numbers.map(|[a, b]| [a.min(b), a.max(b)]).collect())
        };
        let (first, rows) = below(&|p| p);
        let turns = elimination_order(&first, &rows)?;
        let (first, rows) = below(&|p| turns[p as usize]);
        let matrix = entry_pattern(&first, &rows);
        // With the points in order, the analysis needs the upper triangle, the factorization the lower one.
        let above = matrix.as_ref().transpose().to_col_major().ok()?;
        let symbolic = factorize_symbolic_cholesky(
            above.as_ref(),
            Side::Upper,
            SymmetricOrdering::Identity,
            CholeskySymbolicParams::default(),
        )
        .ok()?;
        let factoring = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let solving = symbolic.solve_in_place_scratch::<f64>(1, Par::Seq);
        Some(Self {
            turns,
            blocks: vec![DMat3::ZERO; rows.len()],
            entries: vec![0.0; matrix.row_idx().len()],
            first,
            rows,
            matrix,
            factor: vec![0.0; symbolic.len_val()],
            memory: MemBuffer::try_new(factoring.or(solving)).ok()?,
            symbolic,
            right: Mat::zeros(3 * points, 1),
        })
    }

    /// Sets all blocks to zero
    pub fn clear(&mut self) {
        self.blocks.fill(DMat3::ZERO);
    }

    /// Returns the place of the block of two points, for [`BlockSolver::add_at`]; `None` if it is not in the pattern
    ///
    /// # Panics
    /// When a point does not exist.
    pub fn place(&self, a: u32, b: u32) -> Option<Place> {
        let (low, high) = (self.turns[a.min(b) as usize], self.turns[a.max(b) as usize]);
        let (column, row) = (low.min(high) as usize, low.max(high));
        let start = self.first[column];
        let at = self.rows[start..self.first[column + 1]]
            .binary_search(&row)
            .ok()?;
        Some(Place {
            at: (start + at) as u32,
            transposed: high < low,
        })
    }

    /// Adds to the block at a [`BlockSolver::place`]
    ///
    /// The block's row belongs to the point with the higher index; a block on the diagonal must be symmetric.
    ///
    /// # Panics
    /// When the place does not exist.
    pub fn add_at(&mut self, place: Place, block: DMat3) {
        self.blocks[place.at as usize] += if place.transposed {
            block.transpose()
        } else {
            block
        };
    }

    /// Factorizes the matrix and replaces the right-hand side by the solution
    ///
    /// Returns `false` when the matrix is not positive definite or a value is NaN, and then leaves the right-hand
    /// side unchanged.
    ///
    /// # Panics
    /// When `right` does not hold one vector per point.
    pub fn solve(&mut self, right: &mut [DVec3]) -> bool {
        assert_eq!(right.len() + 1, self.first.len(), "one vector per point");
        self.fill_entries();
        let stack = MemStack::new(&mut self.memory);
        let matrix = SparseColMatRef::new(self.matrix.as_ref(), &self.entries[..]);
        let factored = self.symbolic.factorize_numeric_llt(
            &mut self.factor,
            matrix,
            Side::Lower,
            LltRegularization::default(),
            Par::Seq,
            stack,
            Default::default(),
        );
        if factored.is_err() {
            return false;
        }
        let row = |i: usize, k: usize| 3 * self.turns[i] as usize + k;
        for (i, p) in right.iter().enumerate() {
            for (k, v) in p.to_array().into_iter().enumerate() {
                self.right[(row(i, k), 0)] = v;
            }
        }
        LltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            self.right.as_mut(),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
        let solved = |i: usize, k: usize| self.right[(row(i, k), 0)];
        if !(0..right.len()).all(|i| (0..3).all(|k| solved(i, k).is_finite())) {
            return false;
        }
        for (i, p) in right.iter_mut().enumerate() {
            *p = DVec3::new(solved(i, 0), solved(i, 1), solved(i, 2));
        }
        true
    }

    /// Writes the blocks as columns of scalar entries
    fn fill_entries(&mut self) {
        let mut slots = self.entries.iter_mut();
        for c in 0..self.first.len() - 1 {
            for k in 0..3 {
                for at in self.first[c]..self.first[c + 1] {
                    let from = if self.rows[at] as usize == c { k } else { 0 };
                    let column = self.blocks[at].col(k).to_array();
                    for (value, slot) in column[from..].iter().zip(&mut slots) {
                        *slot = *value;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_system_is_solved() {
        // 4 1 0 / 1 3 1 / 0 1 2
        let lower = [
            (0, 0, 4.0),
            (1, 0, 1.0),
            (1, 1, 1.0),
            (1, 1, 2.0),
            (2, 1, 1.0),
            (2, 2, 2.0),
        ];
        let factor = Cholesky::factor(3, &lower).unwrap();
        let mut right = [
            DVec2::new(6.0, 4.0),
            DVec2::new(10.0, 1.0),
            DVec2::new(8.0, 0.0),
        ];
        factor.solve_in_place(&mut right, &mut factor.workspace());
        let expected = [
            DVec2::new(1.0, 1.0),
            DVec2::new(2.0, 0.0),
            DVec2::new(3.0, 0.0),
        ];
        for (x, e) in right.iter().zip(expected) {
            assert!((*x - e).length() < 1e-12);
        }
    }

    #[test]
    fn blocks_solve_like_the_dense_matrix() {
        // A chain of five points, each anchored; neighbors are coupled by a block that is not symmetric
        let coupling = DMat3::from_cols(
            DVec3::new(1.0, 0.5, 0.0),
            DVec3::new(-0.25, 1.0, 0.5),
            DVec3::new(0.0, 0.75, 1.0),
        );
        let pairs: Vec<[u32; 2]> = (0..4).map(|i| [i + 1, i]).collect();
        let mut solver = BlockSolver::new(5, &pairs).unwrap();
        let expected: Vec<DVec3> = (0..5)
            .map(|i| DVec3::new(1.0, -2.0, f64::from(i)))
            .collect();
        for scale in [1.0, 3.0] {
            solver.clear();
            let mut right = vec![DVec3::ZERO; 5];
            for i in 0..5u32 {
                let place = solver.place(i, i).unwrap();
                solver.add_at(place, DMat3::IDENTITY * (6.0 * scale));
                right[i as usize] += expected[i as usize] * 6.0 * scale;
            }
            for i in 0..4u32 {
                let place = solver.place(i, i + 1).unwrap();
                solver.add_at(place, coupling * scale);
                right[i as usize + 1] += coupling * expected[i as usize] * scale;
                right[i as usize] += coupling.transpose() * expected[i as usize + 1] * scale;
            }
            assert!(solver.solve(&mut right));
            for (x, e) in right.iter().zip(&expected) {
                assert!((*x - *e).length() < 1e-12);
            }
        }
        assert_eq!(solver.place(0, 3), None);
        solver.clear();
        assert!(!solver.solve(&mut [DVec3::ONE; 5]));
    }
}
