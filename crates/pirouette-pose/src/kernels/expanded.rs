//! Pointwise convolutions followed by depthwise ones
//!
//! The result of the first has the most channels of the network. It is written to the ring of the second, row by row,
//! and never as a whole.

use super::Shape;
use super::depthwise::{Depthwise, LANES};
use super::matrix::{Matrix, Sink};

/// Pointwise convolution whose only reader is a depthwise one
#[derive(Debug)]
pub(crate) struct Expanded {
    expansion: Matrix,
    depthwise: Depthwise,
}

impl Expanded {
    /// Joins two convolutions; `expansion` must have as many outputs as `depthwise` has channels.
    pub(crate) fn new(expansion: Matrix, depthwise: Depthwise) -> Self {
        Self {
            expansion,
            depthwise,
        }
    }

    /// Size of the result
    pub(crate) fn result(&self) -> Shape {
        self.depthwise.result()
    }

    /// Number of multiplications
    pub(crate) fn work(&self) -> usize {
        let expansion = self
            .depthwise
            .input()
            .len()
            .saturating_mul(self.expansion.depth());
        self.depthwise.work().saturating_add(expansion)
    }

    /// Length of the scratch memory
    pub(crate) fn scratch_len(&self) -> usize {
        self.depthwise.scratch_len()
    }

    /// Computes the result.
    pub(crate) fn run(&self, input: &[f32], out: &mut [f32], scratch: &mut [f32]) {
        let depth = self.expansion.depth();
        let [columns, before, width] = self.depthwise.ring_columns();
        let row_len = self.depthwise.input().width * depth;
        self.depthwise.run_with(out, scratch, |row, ring| {
            let input = &input[row * row_len..][..width * depth];
            self.expansion.multiply_to(
                input,
                &mut RingRow {
                    ring,
                    columns,
                    before,
                },
            );
        });
    }
}

/// Row of the ring of a depthwise convolution
struct RingRow<'a> {
    ring: &'a mut [[f32; LANES]],
    columns: usize,
    before: usize,
}

impl Sink for RingRow<'_> {
    #[inline(always)]
    fn put<const L: usize>(&mut self, row: usize, channel: usize, sums: &[[f32; L]]) {
        let start = channel / LANES * self.columns + self.before + row;
        for (block, sums) in self.ring[start..].iter_mut().zip(sums) {
            // A narrow block is the last, and the rest of its lanes is not read.
            if let Some(lanes) = block.first_chunk_mut::<L>() {
                *lanes = *sums;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Expanded;
    use crate::kernels::convolution::Convolution;
    use crate::kernels::depthwise::Depthwise;
    use crate::kernels::testing::{assert_close, noise};
    use crate::kernels::window::{Padding, Span, Window};
    use crate::kernels::{Activation, Shape};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn run_equals_the_convolutions_one_after_the_other(
            (height, width, depth, channels) in (1usize..9, 1usize..20, 1usize..6, 1usize..40),
            (kernel, stride) in (1usize..6, 1usize..3),
            (before, behind) in (0usize..3, 0usize..3),
            seed: u64,
        ) {
            let span = |size| Span::new(size, kernel, stride, Padding::Explicit(before, behind));
            let (Some(rows), Some(columns)) = (span(height), span(width)) else { return Ok(()) };
            let one = |size| Span::new(size, 1, 1, Padding::Same).unwrap();
            let single = Window { rows: one(height), columns: one(width) };
            let input = Shape { height, width, channels: depth };
            let (x, bias) = (noise(input.len(), seed), noise(channels, !seed));
            let weights = noise(channels * depth, seed ^ 3);
            let expansion = Convolution::new(input, single, &weights, &bias, Activation::RELU).unwrap();
            let between = expansion.result();
            let weights = noise(kernel * kernel * channels, seed ^ 5);
            let depthwise = Depthwise::new(between, Window { rows, columns }, &weights, &bias, Activation::NONE).unwrap();

            let (mut expanded, mut expected) = (vec![f32::NAN; between.len()], vec![f32::NAN; depthwise.result().len()]);
            let mut scratch = vec![f32::NAN; depthwise.scratch_len()];
            expansion.run(&x, &mut expanded, &mut []);
            depthwise.run(&expanded, &mut expected, &mut scratch);
            let mut found = vec![f32::NAN; expected.len()];
            scratch.fill(f32::NAN);
            Expanded::new(expansion.into_matrix(), depthwise).run(&x, &mut found, &mut scratch);
            assert_close(&found, &expected, 1e-5);
        }
    }
}
