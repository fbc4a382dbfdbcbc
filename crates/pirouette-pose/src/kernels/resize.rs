//! Bilinear enlargement and reduction

use super::Shape;

/// Bilinear interpolation between two indices
#[derive(Clone, Copy, Debug)]
struct Tap {
    low: usize,
    high: usize,
    /// Weight of `high`
    fraction: f32,
}

/// Which places of the two images coincide
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Alignment {
    /// The outer borders
    HalfPixel,
    /// The centers of the corner pixels
    Corners,
    /// The center of the first pixel and the border behind the last
    Origin,
}

/// Bilinear resampling of an image
#[derive(Debug)]
pub(crate) struct Resize {
    input: Shape,
    rows: Vec<Tap>,
    columns: Vec<Tap>,
}

/// Computes where `to` samples lie among `from` values; both at least 1.
fn taps(from: usize, to: usize, alignment: Alignment) -> Vec<Tap> {
    let scale = match alignment {
        Alignment::Corners if to > 1 => (from - 1) as f32 / (to - 1) as f32,
        _ => from as f32 / to as f32,
    };
    let tap = |i: usize| {
        let at = match alignment {
            Alignment::HalfPixel => ((i as f32 + 0.5) * scale - 0.5).max(0.0),
            Alignment::Corners | Alignment::Origin => i as f32 * scale,
        };
        let low = (at as usize).min(from - 1);
        Tap {
            low,
            high: (low + 1).min(from - 1),
            fraction: at - low as f32,
        }
    };
    (0..to).map(tap).collect()
}

impl Resize {
    /// Prepares resampling to `height` by `width` pixels; `None` if a size is zero.
    pub(crate) fn new(
        input: Shape,
        height: usize,
        width: usize,
        alignment: Alignment,
    ) -> Option<Self> {
        (input.len() > 0 && height > 0 && width > 0).then(|| Self {
            input,
            rows: taps(input.height, height, alignment),
            columns: taps(input.width, width, alignment),
        })
    }

    /// Size of the result
    pub(crate) fn result(&self) -> Shape {
        Shape {
            height: self.rows.len(),
            width: self.columns.len(),
            channels: self.input.channels,
        }
    }

    /// Length of the scratch memory
    pub(crate) fn scratch_len(&self) -> usize {
        self.result().row_len().saturating_mul(2)
    }

    /// Computes the result; each row of the input is resampled to `scratch` once, rows of the result are between two.
    pub(crate) fn run(&self, input: &[f32], out: &mut [f32], scratch: &mut [f32]) {
        let row_len = self.input.row_len();
        let out_row_len = self.result().row_len();
        // Row `i` of the input belongs to slot `i % 2`.
        let mut resampled = [None; 2];
        for (row, out) in self.rows.iter().zip(out.chunks_exact_mut(out_row_len)) {
            for i in [row.low, row.high] {
                if resampled[i % 2] != Some(i) {
                    let slot = &mut scratch[i % 2 * out_row_len..][..out_row_len];
                    self.resample_row(&input[i * row_len..][..row_len], slot);
                    resampled[i % 2] = Some(i);
                }
            }
            let [above, below] =
                [row.low, row.high].map(|i| &scratch[i % 2 * out_row_len..][..out_row_len]);
            blend(above, below, row.fraction, out);
        }
    }

    /// Interpolates the columns of one row.
    fn resample_row(&self, row: &[f32], out: &mut [f32]) {
        let channels = self.input.channels;
        for (column, out) in self.columns.iter().zip(out.chunks_exact_mut(channels)) {
            let [left, right] = [column.low, column.high].map(|x| &row[x * channels..][..channels]);
            blend(left, right, column.fraction, out);
        }
    }
}

/// Interpolates each value between those of `low` and `high`.
#[inline(always)]
fn blend(low: &[f32], high: &[f32], fraction: f32, out: &mut [f32]) {
    for ((out, &low), &high) in out.iter_mut().zip(low).zip(high) {
        *out = low + (high - low) * fraction;
    }
}

#[cfg(test)]
mod tests {
    use super::{Alignment, Resize};
    use crate::kernels::Shape;
    use crate::kernels::testing::{assert_close, noise};
    use proptest::prelude::*;

    fn run(resize: &Resize, values: &[f32], out: &mut [f32]) {
        resize.run(values, out, &mut vec![f32::NAN; resize.scratch_len()]);
    }

    fn resized(values: &[f32], width: usize, alignment: Alignment) -> Vec<f32> {
        let shape = Shape {
            height: 1,
            width: values.len(),
            channels: 1,
        };
        let mut out = vec![f32::NAN; width];
        run(
            &Resize::new(shape, 1, width, alignment).unwrap(),
            values,
            &mut out,
        );
        out
    }

    #[test]
    fn doubles_a_row_with_each_alignment() {
        assert_eq!(
            resized(&[0.0, 4.0], 4, Alignment::HalfPixel),
            [0.0, 1.0, 3.0, 4.0]
        );
        assert_eq!(
            resized(&[0.0, 4.0], 4, Alignment::Origin),
            [0.0, 2.0, 4.0, 4.0]
        );
        assert_eq!(
            resized(&[0.0, 6.0], 4, Alignment::Corners),
            [0.0, 2.0, 4.0, 6.0]
        );
    }

    #[test]
    fn interpolates_rows_and_channels() {
        let shape = Shape {
            height: 2,
            width: 1,
            channels: 2,
        };
        let mut out = [0.0; 6];
        run(
            &Resize::new(shape, 3, 1, Alignment::Corners).unwrap(),
            &[0.0, 10.0, 2.0, 30.0],
            &mut out,
        );
        assert_eq!(out, [0.0, 10.0, 1.0, 20.0, 2.0, 30.0]);
    }

    proptest! {
        #[test]
        fn run_equals_the_weighted_mean_of_four_pixels(
            (height, width, channels) in (1usize..9, 1usize..9, 1usize..12),
            (to_height, to_width) in (1usize..20, 1usize..20),
            alignment in prop_oneof![
                Just(Alignment::HalfPixel), Just(Alignment::Corners), Just(Alignment::Origin)
            ],
            seed: u64,
        ) {
            let shape = Shape { height, width, channels };
            let resize = Resize::new(shape, to_height, to_width, alignment).unwrap();
            let values = noise(shape.len(), seed);
            let mut expected = Vec::new();
            for row in &resize.rows {
                for column in &resize.columns {
                    for c in 0..channels {
                        let value = |y: usize, x: usize| values[(y * width + x) * channels + c];
                        expected.push(
                            (1.0 - row.fraction) * (1.0 - column.fraction) * value(row.low, column.low)
                                + (1.0 - row.fraction) * column.fraction * value(row.low, column.high)
                                + row.fraction * (1.0 - column.fraction) * value(row.high, column.low)
                                + row.fraction * column.fraction * value(row.high, column.high),
                        );
                    }
                }
            }
            let mut out = vec![f32::NAN; expected.len()];
            run(&resize, &values, &mut out);
            assert_close(&out, &expected, 1e-5);
        }
    }
}
