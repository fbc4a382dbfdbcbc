//! Maxima over windows

use super::window::Window;
use super::{Activation, Shape};

/// Maximum of each channel over a sliding window; padding does not contribute
#[derive(Debug)]
pub(crate) struct MaxPool {
    pub(crate) input: Shape,
    pub(crate) window: Window,
    pub(crate) activation: Activation,
}

impl MaxPool {
    /// Computes the result.
    pub(crate) fn run(&self, input: &[f32], out: &mut [f32]) {
        let (s, w) = (self.input, &self.window);
        for (i, out) in out.chunks_exact_mut(s.channels).enumerate() {
            let (y, x) = (i / w.columns.count, i % w.columns.count);
            out.fill(f32::NEG_INFINITY);
            for row in (0..w.rows.kernel).filter_map(|k| w.rows.index(y, k, s.height)) {
                for column in (0..w.columns.kernel).filter_map(|k| w.columns.index(x, k, s.width)) {
                    let pixel = &input[(row * s.width + column) * s.channels..][..s.channels];
                    for (max, &value) in out.iter_mut().zip(pixel) {
                        *max = if value > *max { value } else { *max };
                    }
                }
            }
            out.iter_mut().for_each(|v| *v = self.activation.apply(*v));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::MaxPool;
    use crate::kernels::window::{Padding, Span, Window};
    use crate::kernels::{Activation, Shape};

    #[test]
    fn pools_windows_that_extend_beyond_the_image() {
        let span = Span::new(3, 2, 2, Padding::Same).unwrap();
        let pool = MaxPool {
            input: Shape {
                height: 3,
                width: 3,
                channels: 1,
            },
            window: Window {
                rows: span,
                columns: span,
            },
            activation: Activation::NONE,
        };
        let mut out = [0.0; 4];
        pool.run(
            &[1.0, 2.0, -3.0, 4.0, 0.0, -6.0, -7.0, -8.0, -9.0],
            &mut out,
        );
        assert_eq!(out, [4.0, -3.0, -7.0, -9.0]);
    }
}
