//! Products of pixels with a matrix of weights
//!
//! Weights are packed in panels of 16 (or 8) output channels. Blocks of 6 rows by 16 channels are summed in registers:
//! 12 vectors of 8 numbers, of the 16 registers of AVX2.

use super::{Activation, multiply_add};

/// Output channels of a wide panel
const WIDE: usize = 16;
/// Output channels of a narrow panel, for the last up to 8 channels
const NARROW: usize = 8;
/// Rows of a block
const ROWS: usize = 6;

/// Weights and biases of a matrix product
#[derive(Debug)]
pub(crate) struct Matrix {
    wide: Vec<[f32; WIDE]>,
    narrow: Vec<[f32; NARROW]>,
    bias: Vec<f32>,
    depth: usize,
    outputs: usize,
    activation: Activation,
}

/// Copies the weights of output channels `first..` to a panel: one row per input value.
fn pack<const L: usize>(weights: &[f32], depth: usize, first: usize, panel: &mut [[f32; L]]) {
    for (lane, row) in weights.chunks_exact(depth).skip(first).take(L).enumerate() {
        for (packed, &weight) in panel.iter_mut().zip(row) {
            packed[lane] = weight;
        }
    }
}

impl Matrix {
    /// Packs `weights`, one row of `weights.len() / bias.len()` input values per output channel.
    pub(crate) fn new(weights: &[f32], bias: &[f32], activation: Activation) -> Self {
        let outputs = bias.len();
        let depth = weights.len() / outputs;
        let narrow_panels = usize::from((1..=NARROW).contains(&(outputs % WIDE)));
        let wide_panels = outputs.div_ceil(WIDE) - narrow_panels;
        let mut wide = vec![[0.0; WIDE]; wide_panels * depth];
        for (i, panel) in wide.chunks_exact_mut(depth).enumerate() {
            pack(weights, depth, i * WIDE, panel);
        }
        let mut narrow = vec![[0.0; NARROW]; narrow_panels * depth];
        pack(weights, depth, wide_panels * WIDE, &mut narrow);
        let mut padded = bias.to_vec();
        padded.resize(wide_panels * WIDE + narrow_panels * NARROW, 0.0);
        Self {
            wide,
            narrow,
            bias: padded,
            depth,
            outputs,
            activation,
        }
    }

    /// Number of input values of a row
    pub(crate) fn depth(&self) -> usize {
        self.depth
    }

    /// Number of output channels
    pub(crate) fn outputs(&self) -> usize {
        self.outputs
    }

    /// Computes one row of `out` per row of `input`.
    pub(crate) fn multiply(&self, input: &[f32], out: &mut [f32]) {
        self.multiply_to(
            input,
            &mut Rows {
                out,
                outputs: self.outputs,
            },
        );
    }

    /// Computes one row per row of `input` and passes blocks of results to `sink`.
    pub(crate) fn multiply_to(&self, input: &[f32], sink: &mut impl Sink) {
        let rows = input.len() / self.depth;
        let mut row = 0;
        while row < rows {
            let input = &input[row * self.depth..];
            row += match rows - row {
                // 8 rows are 4 and 4, since single rows take longest.
                4 | 5 | 8 => self.multiply_rows::<4>(input, row, sink),
                6.. => self.multiply_rows::<ROWS>(input, row, sink),
                _ => self.multiply_rows::<1>(input, row, sink),
            };
        }
    }

    /// Computes `R` rows, one panel after the other, and returns `R`.
    fn multiply_rows<const R: usize>(
        &self,
        input: &[f32],
        row: usize,
        sink: &mut impl Sink,
    ) -> usize {
        let rows: [&[f32]; R] = std::array::from_fn(|i| &input[i * self.depth..][..self.depth]);
        let (wide_bias, narrow_bias) = self.bias.as_chunks::<WIDE>();
        let mut channel = 0;
        for (panel, bias) in self.wide.chunks_exact(self.depth).zip(wide_bias) {
            sink.put(row, channel, &product(rows, panel, bias, self.activation));
            channel += WIDE;
        }
        if let Some(bias) = narrow_bias.first_chunk::<NARROW>() {
            sink.put(
                row,
                channel,
                &product(rows, &self.narrow, bias, self.activation),
            );
        }
        R
    }
}

/// Receives the results of a product
pub(crate) trait Sink {
    /// Stores `L` channels from `channel` of rows from `row`; channels beyond the last are to be ignored.
    fn put<const L: usize>(&mut self, row: usize, channel: usize, sums: &[[f32; L]]);
}

/// Results row by row
struct Rows<'a> {
    out: &'a mut [f32],
    outputs: usize,
}

impl Sink for Rows<'_> {
    #[inline(always)]
    fn put<const L: usize>(&mut self, row: usize, channel: usize, sums: &[[f32; L]]) {
        let rows = self.out[row * self.outputs..].chunks_exact_mut(self.outputs);
        for (sums, row) in sums.iter().zip(rows) {
            let row = &mut row[channel..];
            if let Some(whole) = row.first_chunk_mut::<L>() {
                *whole = *sums;
            } else {
                row.copy_from_slice(&sums[..row.len()]);
            }
        }
    }
}

/// Computes `activation(bias + rows * panel)` with all sums in registers.
#[inline(never)]
fn product<const R: usize, const L: usize>(
    mut rows: [&[f32]; R],
    panel: &[[f32; L]],
    bias: &[f32; L],
    activation: Activation,
) -> [[f32; L]; R] {
    let depth = panel.len();
    for row in &mut rows {
        *row = &row[..depth];
    }
    let mut sums = [*bias; R];
    for k in 0..depth {
        let weights = &panel[k];
        for i in 0..R {
            let value = rows[i][k];
            for j in 0..L {
                sums[i][j] = multiply_add(value, weights[j], sums[i][j]);
            }
        }
    }
    activation.apply_all(sums.as_flattened_mut());
    sums
}

#[cfg(test)]
mod tests {
    use super::Matrix;
    use crate::kernels::Activation;
    use crate::kernels::testing::{assert_close, noise};
    use proptest::prelude::*;

    fn multiply_reference(
        input: &[f32],
        weights: &[f32],
        bias: &[f32],
        activation: Activation,
    ) -> Vec<f32> {
        let depth = weights.len() / bias.len();
        let mut out = Vec::new();
        for row in input.chunks_exact(depth) {
            for (weights, &bias) in weights.chunks_exact(depth).zip(bias) {
                let sum = row
                    .iter()
                    .zip(weights)
                    .map(|(a, b)| f64::from(*a) * f64::from(*b))
                    .sum::<f64>();
                out.push(activation.apply((sum + f64::from(bias)) as f32));
            }
        }
        out
    }

    #[test]
    fn multiplies_two_rows_by_one_column() {
        let matrix = Matrix::new(&[1.0, 2.0], &[10.0], Activation::NONE);
        let mut out = [0.0; 2];
        matrix.multiply(&[3.0, 4.0, 5.0, 6.0], &mut out);
        assert_eq!(out, [21.0, 27.0]);
    }

    proptest! {
        #[test]
        fn multiply_equals_the_reference(rows in 1usize..20, depth in 1usize..40, outputs in 1usize..60, seed: u64) {
            let (weights, bias) = (noise(depth * outputs, seed), noise(outputs, !seed));
            let input = noise(rows * depth, seed ^ 7);
            for activation in [Activation::NONE, Activation::RELU, Activation::RELU6] {
                let mut out = vec![f32::NAN; rows * outputs];
                Matrix::new(&weights, &bias, activation).multiply(&input, &mut out);
                assert_close(&out, &multiply_reference(&input, &weights, &bias, activation), 1e-5);
            }
        }
    }
}
