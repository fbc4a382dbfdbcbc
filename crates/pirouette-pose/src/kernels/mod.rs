//! Operators of the network on images
//!
//! Images are stored row by row, channels last. Each operator is checked when it is constructed; running it on slices
//! of the lengths that it states cannot fail. Sums are computed with fused multiply-add where the target has it, so
//! results differ between machines in the last bits.

pub(crate) mod convolution;
pub(crate) mod depthwise;
pub(crate) mod elementwise;
pub(crate) mod expanded;
pub(crate) mod matrix;
pub(crate) mod pool;
pub(crate) mod resize;
pub(crate) mod single;
pub(crate) mod window;

/// Size of an image
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    pub(crate) height: usize,
    pub(crate) width: usize,
    pub(crate) channels: usize,
}

impl Shape {
    /// Number of values
    pub(crate) fn len(self) -> usize {
        self.height * self.width * self.channels
    }

    /// Number of values of one row of pixels
    pub(crate) fn row_len(self) -> usize {
        self.width * self.channels
    }

    /// Sizes of the dimensions, as in the file
    pub(crate) fn sizes(self) -> [usize; 4] {
        [1, self.height, self.width, self.channels]
    }
}

/// Limits to which results are clamped
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Activation {
    low: f32,
    high: f32,
}

impl Activation {
    pub(crate) const NONE: Self = Self {
        low: f32::NEG_INFINITY,
        high: f32::INFINITY,
    };
    pub(crate) const RELU: Self = Self {
        low: 0.0,
        high: f32::INFINITY,
    };
    pub(crate) const RELU6: Self = Self {
        low: 0.0,
        high: 6.0,
    };

    /// Clamps a value; comparisons and not `f32::clamp`, since they compile to two instructions.
    #[inline(always)]
    pub(crate) fn apply(self, value: f32) -> f32 {
        let value = if value > self.low { value } else { self.low };
        if value < self.high { value } else { self.high }
    }

    /// Clamps values.
    #[inline(always)]
    fn apply_all(self, values: &mut [f32]) {
        for value in values {
            *value = self.apply(*value);
        }
    }
}

/// Computes `a * b + c`.
#[inline(always)]
fn multiply_add(a: f32, b: f32, c: f32) -> f32 {
    // Without an instruction for it, `mul_add` calls a slow function.
    if cfg!(any(target_feature = "fma", target_arch = "aarch64")) {
        a.mul_add(b, c)
    } else {
        a * b + c
    }
}

#[cfg(test)]
pub(crate) mod testing {
    //! Values and comparisons for tests of operators

    use super::Shape;

    /// Returns `len` numbers between -1 and 1 that depend on `seed`.
    pub(crate) fn noise(len: usize, seed: u64) -> Vec<f32> {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 40) as f32 / (1u64 << 23) as f32 - 1.0
        };
        (0..len).map(|_| next()).collect()
    }

    /// Asserts that two slices are equal to `tolerance`.
    pub(crate) fn assert_close(found: &[f32], expected: &[f32], tolerance: f32) {
        assert_eq!(found.len(), expected.len());
        for (i, (a, b)) in found.iter().zip(expected).enumerate() {
            assert!(
                (a - b).abs() <= tolerance * (1.0 + b.abs()),
                "value {i} is {a}, expected {b}"
            );
        }
    }

    /// Value of an image, `outside` beyond its border.
    pub(crate) fn value_at(
        x: &[f32],
        shape: Shape,
        row: isize,
        column: isize,
        channel: usize,
        outside: f32,
    ) -> f32 {
        match (usize::try_from(row), usize::try_from(column)) {
            (Ok(r), Ok(c)) if r < shape.height && c < shape.width => {
                x[(r * shape.width + c) * shape.channels + channel]
            }
            _ => outside,
        }
    }
}
