//! Convolutions of all channels to a single one
//!
//! A product with a matrix would compute 8 output channels of which 7 are not used. Instead, each window is multiplied
//! with the weights row by row, where its values are contiguous.

use super::window::{MAX_KERNEL, Window};
use super::{Activation, Shape, multiply_add};

/// Numbers that are summed at once
const LANES: usize = 8;
/// Pixels of a tile, whose sums are independent of each other
const TILE: usize = 8;

/// Convolution to one channel with its weights
#[derive(Debug)]
pub(crate) struct SingleConvolution {
    input: Shape,
    window: Window,
    /// Blocks of the weights of each row, ordered by column and channel, zero behind the last
    weights: Vec<[f32; LANES]>,
    bias: f32,
    activation: Activation,
}

impl SingleConvolution {
    /// Packs weights ordered by row, column and channel; `None` if their number does not match.
    pub(crate) fn new(
        input: Shape,
        window: Window,
        weights: &[f32],
        bias: f32,
        activation: Activation,
    ) -> Option<Self> {
        let row_len = window.columns.kernel * input.channels;
        if row_len == 0 || weights.len() != window.rows.kernel * row_len {
            return None;
        }
        let pack = |block: &[f32]| std::array::from_fn(|i| block.get(i).copied().unwrap_or(0.0));
        let rows = weights.chunks_exact(row_len);
        Some(Self {
            input,
            window,
            weights: rows.flat_map(|row| row.chunks(LANES).map(pack)).collect(),
            bias,
            activation,
        })
    }

    /// Size of the result
    pub(crate) fn result(&self) -> Shape {
        self.window.result(1)
    }

    /// Number of multiplications
    pub(crate) fn work(&self) -> usize {
        let weights = self.weights.len() * LANES;
        self.result().len().saturating_mul(weights)
    }

    /// Length of the scratch memory
    pub(crate) fn scratch_len(&self) -> usize {
        self.window.rows.kernel.saturating_mul(self.ring_row_len())
    }

    /// Number of values of a padded row; the last window may be read beyond its end by less than a block.
    fn ring_row_len(&self) -> usize {
        let columns = self.window.columns.covered();
        columns.saturating_mul(self.input.channels) + LANES
    }

    /// Computes the result; the padded rows that windows read are copied to `scratch`, each once.
    pub(crate) fn run(&self, input: &[f32], out: &mut [f32], scratch: &mut [f32]) {
        let (row_len, ring_row_len) = (self.input.row_len(), self.ring_row_len());
        let columns = self.window.columns;
        let start = (columns.before * self.input.channels).min(ring_row_len);
        let len = row_len.min(ring_row_len - start);
        self.window.rows.slide(
            self.input.height,
            scratch,
            |row, slot| slot[start..start + len].copy_from_slice(&input[row * row_len..][..len]),
            |y, first, ring| {
                self.run_row(ring, first, &mut out[y * columns.count..][..columns.count])
            },
        );
    }

    /// Computes a row of the result from the rows of the ring that start with padded row `first`.
    fn run_row(&self, ring: &[f32], first: usize, out: &mut [f32]) {
        let kernel = self.window.rows.kernel;
        let step = self.window.columns.stride * self.input.channels;
        let mut rows: [&[f32]; MAX_KERNEL] = [&[]; MAX_KERNEL];
        let rows = &mut rows[..kernel];
        for (ky, row) in rows.iter_mut().enumerate() {
            *row = &ring[(first + ky) % kernel * self.ring_row_len()..][..self.ring_row_len()];
        }
        let finish = |sums| self.activation.apply(self.bias + sum_of(sums));
        let (tiles, last) = out.as_chunks_mut::<TILE>();
        let tiles_end = tiles.len() * TILE;
        for (i, out) in tiles.iter_mut().enumerate() {
            *out = sums(rows, &self.weights, i * TILE * step, step).map(finish);
        }
        for (i, out) in last.iter_mut().enumerate() {
            let [sums] = sums(rows, &self.weights, (tiles_end + i) * step, step);
            *out = finish(sums);
        }
    }
}

/// Multiplies windows of `rows`, the first at `start` and others every `step`, with the weights.
#[inline(never)]
fn sums<const P: usize>(
    rows: &[&[f32]],
    weights: &[[f32; LANES]],
    start: usize,
    step: usize,
) -> [[f32; LANES]; P] {
    let mut sums = [[0.0; LANES]; P];
    let blocks = weights.len() / rows.len();
    for (row, weights) in rows.iter().zip(weights.chunks_exact(blocks)) {
        let windows: [&[f32]; P] =
            std::array::from_fn(|p| &row[start + p * step..][..blocks * LANES]);
        let windows = windows.map(|window| window.as_chunks::<LANES>().0);
        for (k, weights) in weights.iter().enumerate() {
            for p in 0..P {
                for j in 0..LANES {
                    sums[p][j] = multiply_add(windows[p][k][j], weights[j], sums[p][j]);
                }
            }
        }
    }
    sums
}

/// Adds the lanes in pairs, as vectors are.
#[inline(always)]
fn sum_of(sums: [f32; LANES]) -> f32 {
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

#[cfg(test)]
mod tests {
    use super::SingleConvolution;
    use crate::kernels::convolution::Convolution;
    use crate::kernels::testing::{assert_close, noise};
    use crate::kernels::window::{Padding, Span, Window};
    use crate::kernels::{Activation, Shape};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn run_equals_the_convolution_by_a_matrix(
            (height, width, channels) in (1usize..9, 1usize..20, 1usize..20),
            (kernel_height, kernel_width, stride_y, stride_x) in (1usize..6, 1usize..6, 1usize..4, 1usize..4),
            (same, before, behind) in (any::<bool>(), 0usize..3, 0usize..3),
            seed: u64,
        ) {
            let padding = if same { Padding::Same } else { Padding::Explicit(before, behind) };
            let rows = Span::new(height, kernel_height, stride_y, padding);
            let columns = Span::new(width, kernel_width, stride_x, padding);
            let (Some(rows), Some(columns)) = (rows, columns) else { return Ok(()) };
            let (s, window) = (Shape { height, width, channels }, Window { rows, columns });
            let (x, weights) = (noise(s.len(), seed), noise(window.area() * channels, seed ^ 5));
            let expected = Convolution::new(s, window, &weights, &[0.25], Activation::RELU).unwrap();
            let kernel = SingleConvolution::new(s, window, &weights, 0.25, Activation::RELU).unwrap();
            let [mut out, mut reference] = [(); 2].map(|()| vec![f32::NAN; kernel.result().len()]);
            kernel.run(&x, &mut out, &mut vec![f32::NAN; kernel.scratch_len()]);
            expected.run(&x, &mut reference, &mut vec![f32::NAN; expected.scratch_len()]);
            assert_close(&out, &reference, 1e-5);
        }
    }
}
