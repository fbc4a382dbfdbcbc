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

    /// Computes the result.
    pub(crate) fn run(&self, input: &[f32], out: &mut [f32]) {
        let (channels, row_len) = (self.input.channels, self.input.row_len());
        for (row, out) in self
            .rows
            .iter()
            .zip(out.chunks_exact_mut(self.result().row_len()))
        {
            let top = &input[row.low * row_len..][..row_len];
            let bottom = &input[row.high * row_len..][..row_len];
            for (column, out) in self.columns.iter().zip(out.chunks_exact_mut(channels)) {
                let [left, right] =
                    [column.low, column.high].map(|x| x * channels..(x + 1) * channels);
                blend(
                    [
                        &top[left.clone()],
                        &top[right.clone()],
                        &bottom[left],
                        &bottom[right],
                    ],
                    column.fraction,
                    row.fraction,
                    out,
                );
            }
        }
    }
}

/// Interpolates each channel between the top left, top right, bottom left and bottom right pixel.
#[inline(always)]
fn blend(corners: [&[f32]; 4], to_right: f32, to_bottom: f32, out: &mut [f32]) {
    let [top_left, top_right, bottom_left, bottom_right] = corners.map(|pixel| &pixel[..out.len()]);
    for (c, out) in out.iter_mut().enumerate() {
        let above = top_left[c] + (top_right[c] - top_left[c]) * to_right;
        let below = bottom_left[c] + (bottom_right[c] - bottom_left[c]) * to_right;
        *out = above + (below - above) * to_bottom;
    }
}

#[cfg(test)]
mod tests {
    use super::{Alignment, Resize};
    use crate::kernels::Shape;

    fn resized(values: &[f32], width: usize, alignment: Alignment) -> Vec<f32> {
        let shape = Shape {
            height: 1,
            width: values.len(),
            channels: 1,
        };
        let mut out = vec![f32::NAN; width];
        Resize::new(shape, 1, width, alignment)
            .unwrap()
            .run(values, &mut out);
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
        Resize::new(shape, 3, 1, Alignment::Corners)
            .unwrap()
            .run(&[0.0, 10.0, 2.0, 30.0], &mut out);
        assert_eq!(out, [0.0, 10.0, 1.0, 20.0, 2.0, 30.0]);
    }
}
