//! Sparse Cholesky factorization, kept for many solves; hides `faer`.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, Mat, Par, Side};
use glam::DVec2;

/// Pivots below this share of the largest diagonal entry are rounding noise
///
/// The matrices here are positive definite by construction; a pivot that small comes from triangles that are
/// degenerate beyond double precision.
const SMALLEST_PIVOT: f64 = 1e-14;

/// The factor of one symmetric positive definite matrix
pub(crate) struct Cholesky {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
}

impl Cholesky {
    /// Factors the `size` x `size` matrix with these entries `(row, column, value)` on and below the diagonal
    ///
    /// Entries at the same place add up. `None` when memory runs out or a value is not a number.
    pub(crate) fn factor(size: usize, lower: &[(usize, usize, f64)]) -> Option<Self> {
        let triplets: Vec<Triplet<usize, usize, f64>> = lower
            .iter()
            .map(|&(row, column, value)| Triplet::new(row, column, value))
            .collect();
        let matrix = SparseColMat::try_new_from_triplets(size, size, &triplets).ok()?;
        // Simplicial: on meshes of this size the supernodal kind solves two to five times slower.
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

    /// Memory for [`Cholesky::solve_in_place`], to be used for many solves
    pub(crate) fn workspace(&self) -> Workspace {
        Workspace {
            memory: MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(2, Par::Seq)),
            columns: Mat::zeros(self.symbolic.nrows(), 2),
        }
    }

    /// Replaces the right sides, one x and one y per row, by the solution
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

/// Buffers of the solves with one factor
pub(crate) struct Workspace {
    memory: MemBuffer,
    columns: Mat<f64>,
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
}
