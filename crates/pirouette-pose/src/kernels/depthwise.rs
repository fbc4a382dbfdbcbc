//! Convolutions of each channel with its own weights
//!
//! Rows of the input are copied to a ring of padded rows in blocks of 16 channels, so that windows are contiguous and
//! need no tests at the borders. Tiles of up to 6 output pixels by 16 channels are summed in registers:
//! 12 vectors of sums and 2 of weights, of the 16 registers of AVX2. Tiles have 6, 5 or 1 pixels, since LLVM 22
//! vectorizes loops over 2, 3 or 4 pixels across pixels, several times slower.

use super::window::{MAX_KERNEL, Window};
use super::{Activation, Shape, multiply_add};

/// Channels of a block
pub(crate) const LANES: usize = 16;

/// Depthwise convolution with its weights
#[derive(Debug)]
pub(crate) struct Depthwise {
    input: Shape,
    window: Window,
    /// Ordered by block of channels, row and column
    weights: Vec<[f32; LANES]>,
    bias: Vec<[f32; LANES]>,
    activation: Activation,
}

impl Depthwise {
    /// Packs weights; `None` if their number does not match or the horizontal stride is above 2.
    ///
    /// `weights` are ordered by row, column and channel; one bias per channel.
    pub(crate) fn new(
        input: Shape,
        window: Window,
        weights: &[f32],
        bias: &[f32],
        activation: Activation,
    ) -> Option<Self> {
        let channels = input.channels;
        if channels == 0
            || bias.len() != channels
            || weights.len() != window.area() * channels
            || window.columns.stride > 2
        {
            return None;
        }
        let blocks = channels.div_ceil(LANES);
        let mut packed = vec![[0.0; LANES]; blocks * window.area()];
        for (position, weights) in weights.chunks_exact(channels).enumerate() {
            for (block, weights) in weights.chunks(LANES).enumerate() {
                packed[block * window.area() + position][..weights.len()].copy_from_slice(weights);
            }
        }
        let mut packed_bias = vec![[0.0; LANES]; blocks];
        for (packed, bias) in packed_bias.iter_mut().zip(bias.chunks(LANES)) {
            packed[..bias.len()].copy_from_slice(bias);
        }
        Some(Self {
            input,
            window,
            weights: packed,
            bias: packed_bias,
            activation,
        })
    }

    /// Size of the result
    pub(crate) fn result(&self) -> Shape {
        self.window.result(self.input.channels)
    }

    /// Number of multiplications
    pub(crate) fn work(&self) -> usize {
        self.result().len().saturating_mul(self.window.area())
    }

    /// Length of the scratch memory
    pub(crate) fn scratch_len(&self) -> usize {
        (self.window.rows.kernel * LANES).saturating_mul(self.ring_row_len())
    }

    /// Blocks of values in one row of the ring
    fn ring_row_len(&self) -> usize {
        self.bias.len() * self.window.columns.covered()
    }

    /// Computes the result.
    pub(crate) fn run(&self, input: &[f32], out: &mut [f32], scratch: &mut [f32]) {
        let row_len = self.input.row_len();
        self.run_with(out, scratch, |row, slot| {
            self.load_row(&input[row * row_len..][..row_len], slot)
        });
    }

    /// Computes the result from rows of the input that `load` writes to the ring.
    ///
    /// `load` is called with the number of a row and its place in the ring: blocks of [`LANES`] channels, each of
    /// [`Self::ring_columns`] pixels. Columns of padding are zero and must not be written.
    pub(crate) fn run_with(
        &self,
        out: &mut [f32],
        scratch: &mut [f32],
        load: impl Fn(usize, &mut [[f32; LANES]]),
    ) {
        let (ring, _) = scratch.as_chunks_mut::<LANES>();
        let row_len = self.result().row_len();
        self.window
            .rows
            .slide(self.input.height, ring, load, |y, first, ring| {
                self.run_row(ring, first, &mut out[y * row_len..][..row_len]);
            });
    }

    /// Size of the input
    pub(crate) fn input(&self) -> Shape {
        self.input
    }

    /// Numbers of pixels of a row of the ring, of the padding before the image, and of the image
    pub(crate) fn ring_columns(&self) -> [usize; 3] {
        let (covered, before) = (self.window.columns.covered(), self.window.columns.before);
        [
            covered,
            before,
            self.input.width.min(covered.saturating_sub(before)),
        ]
    }

    /// Copies a row of the input to a row of the ring.
    fn load_row(&self, row: &[f32], slot: &mut [[f32; LANES]]) {
        let (channels, before) = (self.input.channels, self.window.columns.before);
        let covered = self.window.columns.covered();
        for (block, slot) in slot.chunks_exact_mut(covered).enumerate() {
            let first = block * LANES;
            for (pixel, to) in row.chunks_exact(channels).zip(slot.iter_mut().skip(before)) {
                let from = &pixel[first..];
                match from.first_chunk::<LANES>() {
                    Some(whole) => *to = *whole,
                    None => to[..from.len()].copy_from_slice(from),
                }
            }
        }
    }

    /// Computes a row of the result from the rows of the ring that start with padded row `first`.
    fn run_row(&self, ring: &[[f32; LANES]], first: usize, out: &mut [f32]) {
        let (area, covered) = (self.window.area(), self.window.columns.covered());
        let mut offsets = [0; MAX_KERNEL * MAX_KERNEL];
        let offsets = &mut offsets[..area];
        for (block, bias) in self.bias.iter().enumerate() {
            for (ky, offsets) in offsets
                .chunks_exact_mut(self.window.columns.kernel)
                .enumerate()
            {
                let slot = (first + ky) % self.window.rows.kernel;
                let start = slot * self.ring_row_len() + block * covered;
                offsets
                    .iter_mut()
                    .zip(start..)
                    .for_each(|(to, offset)| *to = offset);
            }
            let weights = &self.weights[block * area..][..area];
            let tiles = Tiles {
                ring,
                offsets,
                weights,
                bias,
                activation: self.activation,
            };
            if self.window.columns.stride == 1 {
                tiles.run::<1>(self.input.channels, block * LANES, out);
            } else {
                tiles.run::<2>(self.input.channels, block * LANES, out);
            }
        }
    }
}

/// One block of channels of one row of the result
struct Tiles<'a> {
    ring: &'a [[f32; LANES]],
    /// Places in the ring of the positions of the first window
    offsets: &'a [usize],
    /// Weights of these positions
    weights: &'a [[f32; LANES]],
    bias: &'a [f32; LANES],
    activation: Activation,
}

impl Tiles<'_> {
    /// Computes all pixels with stride `S` and stores channels `from..` of each.
    #[inline(always)]
    fn run<const S: usize>(&self, channels: usize, from: usize, out: &mut [f32]) {
        let (mut x, width) = (0, out.len() / channels);
        while x < width {
            // The last tile overlaps the one before instead of having fewer pixels.
            if (1..5).contains(&(width - x)) && width >= 5 {
                x = width - 5;
            }
            let out = &mut out[x * channels..];
            x += match width - x {
                5 | 8 | 10 | 15 | 20 => self.store(&self.tile::<S, 5>(x), channels, from, out),
                6.. => self.store(&self.tile::<S, 6>(x), channels, from, out),
                _ => self.store(&self.tile::<S, 1>(x), channels, from, out),
            };
        }
    }

    /// Computes `P` pixels from column `x`, all sums in registers.
    ///
    /// One loop over all positions, and one over all results: compilers vectorize other forms only in part.
    #[inline(never)]
    fn tile<const S: usize, const P: usize>(&self, x: usize) -> [[f32; LANES]; P] {
        let mut sums = [*self.bias; P];
        for (&offset, weights) in self.offsets.iter().zip(self.weights) {
            let values = &self.ring[offset + x * S..][..(P - 1) * S + 1];
            for p in 0..P {
                for j in 0..LANES {
                    sums[p][j] = multiply_add(values[p * S][j], weights[j], sums[p][j]);
                }
            }
        }
        self.activation.apply_all(sums.as_flattened_mut());
        sums
    }

    /// Writes channels `from..` of the pixels of a tile, and returns the number of pixels.
    #[inline(always)]
    fn store(&self, tile: &[[f32; LANES]], channels: usize, from: usize, out: &mut [f32]) -> usize {
        for (sums, pixel) in tile.iter().zip(out.chunks_exact_mut(channels)) {
            let pixel = &mut pixel[from..];
            match pixel.first_chunk_mut::<LANES>() {
                Some(whole) => *whole = *sums,
                None => pixel.copy_from_slice(&sums[..pixel.len()]),
            }
        }
        tile.len()
    }
}

#[cfg(test)]
mod tests {
    use super::Depthwise;
    use crate::kernels::testing::{assert_close, noise, value_at};
    use crate::kernels::window::{Padding, Span, Window};
    use crate::kernels::{Activation, Shape};
    use proptest::prelude::*;

    fn depthwise_reference(
        s: Shape,
        x: &[f32],
        w: &Window,
        weights: &[f32],
        bias: &[f32],
    ) -> Vec<f32> {
        let mut out = Vec::new();
        for y in 0..w.rows.count {
            for column in 0..w.columns.count {
                for c in 0..s.channels {
                    let mut sum = f64::from(bias[c]);
                    for k in 0..w.area() {
                        let (ky, kx) = (k / w.columns.kernel, k % w.columns.kernel);
                        let row = (y * w.rows.stride + ky) as isize - w.rows.before as isize;
                        let col =
                            (column * w.columns.stride + kx) as isize - w.columns.before as isize;
                        sum += f64::from(
                            value_at(x, s, row, col, c, 0.0) * weights[k * s.channels + c],
                        );
                    }
                    out.push((sum as f32).clamp(0.0, 6.0));
                }
            }
        }
        out
    }

    proptest! {
        #[test]
        fn run_equals_the_reference(
            (height, width, channels) in (1usize..9, 1usize..20, 1usize..20),
            (kernel_height, kernel_width, stride_y, stride_x) in (1usize..6, 1usize..6, 1usize..4, 1usize..3),
            (same, before, behind) in (any::<bool>(), 0usize..3, 0usize..3),
            seed: u64,
        ) {
            let padding = if same { Padding::Same } else { Padding::Explicit(before, behind) };
            let rows = Span::new(height, kernel_height, stride_y, padding);
            let columns = Span::new(width, kernel_width, stride_x, padding);
            let (Some(rows), Some(columns)) = (rows, columns) else { return Ok(()) };
            let (s, window) = (Shape { height, width, channels }, Window { rows, columns });
            let (x, bias) = (noise(s.len(), seed), noise(channels, !seed));
            let weights = noise(window.area() * channels, seed ^ 5);
            let kernel = Depthwise::new(s, window, &weights, &bias, Activation::RELU6).unwrap();
            let mut out = vec![f32::NAN; kernel.result().len()];
            kernel.run(&x, &mut out, &mut vec![f32::NAN; kernel.scratch_len()]);
            assert_close(&out, &depthwise_reference(s, &x, &window, &weights, &bias), 1e-5);
        }
    }
}
