//! Sums of densities given by their logarithms, branch-free for vectorization.

/// Returns `exp(x)` for `x <= 0`, with a relative error of 4e-6 from -20 on
pub(crate) fn exp_of_negative(x: f32) -> f32 {
    // adding 1.5 * 2^23 leaves the rounded value in the low bits
    const ROUNDING: f32 = 12_582_912.0;
    let exponent = (x * std::f32::consts::LOG2_E).max(-126.0);
    let shifted = exponent + ROUNDING;
    let rest = (exponent - (shifted - ROUNDING)) * std::f32::consts::LN_2;
    // Taylor series of exp on [-ln2 / 2, ln2 / 2]
    let series =
        1.0 + rest * (1.0 + rest * (0.5 + rest * (1.0 / 6.0 + rest * (1.0 / 24.0 + rest / 120.0))));
    f32::from_bits(series.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// Returns the natural logarithm of a positive, normal number, with a relative or absolute error of 3e-7
pub(crate) fn ln_of_positive(x: f32) -> f32 {
    /// Bits of the root of one half: mantissas are mapped to the range from there to the root of two
    const ROOT_OF_HALF: u32 = 0x3f35_04f3;
    const MANTISSA: u32 = 0x007f_ffff;
    let above = x.to_bits().wrapping_sub(ROOT_OF_HALF);
    let exponent = (above as i32 >> 23) as f32;
    let mantissa = f32::from_bits((above & MANTISSA).wrapping_add(ROOT_OF_HALF));
    // series of the inverse hyperbolic tangent
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let q = s * s;
    let series = 2.0 * s * (1.0 + q * (1.0 / 3.0 + q * (0.2 + q * (1.0 / 7.0 + q / 9.0))));
    exponent * std::f32::consts::LN_2 + series
}

/// Returns the logarithm of the sum of two numbers given by their logarithms, at least one of them nonzero
pub(crate) fn log_sum_exp(a: f32, b: f32) -> f32 {
    a.max(b) + ln_of_positive(1.0 + exp_of_negative(-(a - b).abs()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn functions_agree_with_the_standard_library(x in -20.0_f32..0.0, y in 1e-30_f32..1e30, z in -90.0_f32..90.0) {
            prop_assert!((exp_of_negative(x) - x.exp()).abs() <= 4e-6 * x.exp());
            prop_assert!((ln_of_positive(y) - y.ln()).abs() <= 3e-7 * y.ln().abs().max(1.0));
            let sum = f64::from(x).exp() + f64::from(z).exp();
            prop_assert!((f64::from(log_sum_exp(x, z)) - sum.ln()).abs() < 2e-5);
        }
    }

    #[test]
    fn adding_zero_changes_nothing() {
        assert_eq!(log_sum_exp(-3.0, f32::NEG_INFINITY), -3.0);
        assert_eq!(log_sum_exp(f32::NEG_INFINITY, 2.0), 2.0);
        assert_eq!(ln_of_positive(1.0), 0.0);
        assert!(exp_of_negative(-1e9) < 1e-30);
        assert!(exp_of_negative(f32::NEG_INFINITY) < 1e-30);
    }
}
