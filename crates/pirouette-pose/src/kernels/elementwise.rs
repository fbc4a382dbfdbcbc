//! Operators without sums over windows

use super::{Activation, Shape};

/// Computes the sum of two images.
pub(crate) fn add(a: &[f32], b: &[f32], activation: Activation, out: &mut [f32]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = activation.apply(a + b);
    }
}

/// Computes `1 / (1 + exp(-x))`.
pub(crate) fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// Zeros around an image
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pad {
    pub(crate) input: Shape,
    /// Rows before and behind
    pub(crate) rows: [usize; 2],
    /// Columns before and behind
    pub(crate) columns: [usize; 2],
    /// Channels before and behind
    pub(crate) channels: [usize; 2],
}

impl Pad {
    /// Size of the result
    pub(crate) fn result(&self) -> Shape {
        Shape {
            height: self.input.height + self.rows[0] + self.rows[1],
            width: self.input.width + self.columns[0] + self.columns[1],
            channels: self.input.channels + self.channels[0] + self.channels[1],
        }
    }

    /// Computes the result.
    pub(crate) fn run(&self, input: &[f32], out: &mut [f32]) {
        let (from, to) = (self.input, self.result());
        out.fill(0.0);
        let rows = out.chunks_exact_mut(to.row_len()).skip(self.rows[0]);
        for (out, input) in rows.zip(input.chunks_exact(from.row_len())) {
            let pixels = out.chunks_exact_mut(to.channels).skip(self.columns[0]);
            for (out, input) in pixels.zip(input.chunks_exact(from.channels)) {
                out[self.channels[0]..][..from.channels].copy_from_slice(input);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Pad, add, logistic};
    use crate::kernels::{Activation, Shape};

    #[test]
    fn pads_rows_columns_and_channels() {
        let input = Shape {
            height: 1,
            width: 2,
            channels: 1,
        };
        let pad = Pad {
            input,
            rows: [1, 0],
            columns: [0, 1],
            channels: [1, 0],
        };
        let mut out = [f32::NAN; 12];
        pad.run(&[5.0, 6.0], &mut out);
        assert_eq!(
            pad.result(),
            Shape {
                height: 2,
                width: 3,
                channels: 2
            }
        );
        assert_eq!(
            out,
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 6.0, 0.0, 0.0]
        );
    }

    #[test]
    fn adds_and_clamps() {
        let mut out = [0.0; 3];
        add(
            &[1.0, -2.0, 5.0],
            &[1.0, 1.0, 5.0],
            Activation::RELU6,
            &mut out,
        );
        assert_eq!(out, [2.0, 0.0, 6.0]);
    }

    #[test]
    fn logistic_is_between_zero_and_one() {
        assert_eq!(logistic(0.0), 0.5);
        assert_eq!((logistic(-1e9), logistic(1e9)), (0.0, 1.0));
    }
}
