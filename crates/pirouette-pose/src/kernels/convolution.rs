//! Convolutions over all channels

use super::matrix::Matrix;
use super::window::{Span, Window};
use super::{Activation, Shape};

/// Convolution with its weights
#[derive(Debug)]
pub(crate) struct Convolution {
    input: Shape,
    window: Window,
    matrix: Matrix,
}

impl Convolution {
    /// Packs weights; `None` if their number does not match.
    ///
    /// `weights` are ordered by output channel, row, column and input channel; one bias per output channel.
    pub(crate) fn new(
        input: Shape,
        window: Window,
        weights: &[f32],
        bias: &[f32],
        activation: Activation,
    ) -> Option<Self> {
        let depth = window.area() * input.channels;
        let matches =
            depth > 0 && !bias.is_empty() && depth.checked_mul(bias.len()) == Some(weights.len());
        matches.then(|| Self {
            input,
            window,
            matrix: Matrix::new(weights, bias, activation),
        })
    }

    /// Size of the result
    pub(crate) fn result(&self) -> Shape {
        self.window.result(self.matrix.outputs())
    }

    /// Number of multiplications
    pub(crate) fn work(&self) -> usize {
        self.result().len().saturating_mul(self.matrix.depth())
    }

    /// Length of the scratch memory
    pub(crate) fn scratch_len(&self) -> usize {
        if self.is_pointwise() {
            0
        } else {
            self.window
                .columns
                .count
                .saturating_mul(self.matrix.depth())
        }
    }

    /// Tests whether each output pixel depends on the input pixel at the same place only.
    pub(crate) fn is_pointwise(&self) -> bool {
        let single = |span: Span, size| {
            span == Span {
                kernel: 1,
                stride: 1,
                before: 0,
                count: size,
            }
        };
        single(self.window.rows, self.input.height) && single(self.window.columns, self.input.width)
    }

    /// Returns the weights of a pointwise convolution.
    pub(crate) fn into_matrix(self) -> Matrix {
        self.matrix
    }

    /// Computes the result; one row of windows at a time is copied to `scratch`.
    pub(crate) fn run(&self, input: &[f32], out: &mut [f32], scratch: &mut [f32]) {
        if self.is_pointwise() {
            return self.matrix.multiply(input, out);
        }
        for (y, out) in out.chunks_exact_mut(self.result().row_len()).enumerate() {
            for (x, patch) in scratch.chunks_exact_mut(self.matrix.depth()).enumerate() {
                self.copy_patch(input, y, x, patch);
            }
            self.matrix.multiply(scratch, out);
        }
    }

    /// Copies the values of the window at row `y` and column `x`, zero in the padding.
    fn copy_patch(&self, input: &[f32], y: usize, x: usize, patch: &mut [f32]) {
        let (channels, columns) = (self.input.channels, self.window.columns);
        let inside = columns.inside(x, self.input.width);
        let first = (x * columns.stride + inside.start).saturating_sub(columns.before) * channels;
        let inside = inside.start * channels..inside.end * channels;
        for (ky, patch) in patch
            .chunks_exact_mut(columns.kernel * channels)
            .enumerate()
        {
            let Some(row) = self.window.rows.index(y, ky, self.input.height) else {
                patch.fill(0.0);
                continue;
            };
            let row = &input[row * self.input.row_len()..][..self.input.row_len()];
            patch[..inside.start].fill(0.0);
            if !inside.is_empty() {
                patch[inside.clone()].copy_from_slice(&row[first..][..inside.len()]);
            }
            patch[inside.end..].fill(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Convolution;
    use crate::kernels::testing::{assert_close, noise, value_at};
    use crate::kernels::window::{Padding, Span, Window};
    use crate::kernels::{Activation, Shape};
    use proptest::prelude::*;

    fn convolve_reference(
        s: Shape,
        x: &[f32],
        w: &Window,
        weights: &[f32],
        bias: &[f32],
    ) -> Vec<f32> {
        let mut out = Vec::new();
        for y in 0..w.rows.count {
            for column in 0..w.columns.count {
                for (o, &b) in bias.iter().enumerate() {
                    let (mut sum, mut at) = (f64::from(b), o * w.area() * s.channels);
                    for ky in 0..w.rows.kernel {
                        for kx in 0..w.columns.kernel {
                            let row = (y * w.rows.stride + ky) as isize - w.rows.before as isize;
                            let col = (column * w.columns.stride + kx) as isize
                                - w.columns.before as isize;
                            for c in 0..s.channels {
                                sum += f64::from(value_at(x, s, row, col, c, 0.0) * weights[at]);
                                at += 1;
                            }
                        }
                    }
                    out.push(sum as f32);
                }
            }
        }
        out
    }

    proptest! {
        #[test]
        fn run_equals_the_reference(
            (height, width, channels) in (1usize..9, 1usize..9, 1usize..7),
            (kernel_height, kernel_width, stride, outputs) in (1usize..5, 1usize..5, 1usize..4, 1usize..20),
            (same, before, behind) in (any::<bool>(), 0usize..3, 0usize..3),
            seed: u64,
        ) {
            let padding = if same { Padding::Same } else { Padding::Explicit(before, behind) };
            let rows = Span::new(height, kernel_height, stride, padding);
            let columns = Span::new(width, kernel_width, stride, padding);
            let (Some(rows), Some(columns)) = (rows, columns) else { return Ok(()) };
            let (s, window) = (Shape { height, width, channels }, Window { rows, columns });
            let (x, bias) = (noise(s.len(), seed), noise(outputs, !seed));
            let weights = noise(outputs * window.area() * channels, seed ^ 5);
            let kernel = Convolution::new(s, window, &weights, &bias, Activation::NONE).unwrap();
            let mut out = vec![f32::NAN; kernel.result().len()];
            kernel.run(&x, &mut out, &mut vec![f32::NAN; kernel.scratch_len()]);
            assert_close(&out, &convolve_reference(s, &x, &window, &weights, &bias), 1e-5);
        }
    }

    #[test]
    fn new_rejects_weights_of_another_number() {
        let span = Span::new(4, 3, 1, Padding::Same).unwrap();
        let (shape, window) = (
            Shape {
                height: 4,
                width: 4,
                channels: 2,
            },
            Window {
                rows: span,
                columns: span,
            },
        );
        assert!(Convolution::new(shape, window, &[0.0; 35], &[0.0; 2], Activation::NONE).is_none());
        assert!(Convolution::new(shape, window, &[], &[], Activation::NONE).is_none());
    }
}
