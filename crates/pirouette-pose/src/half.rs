//! Half-precision numbers

/// Converts the bits of an IEEE 754 binary16 number.
pub(crate) fn f32_from_half(half: u16) -> f32 {
    let sign = u32::from(half >> 15) << 31;
    let exponent = u32::from(half >> 10 & 31);
    let fraction = u32::from(half & 1023);
    let magnitude = match exponent {
        0 => (fraction as f32 * 2f32.powi(-24)).to_bits(),
        31 => 0x7f80_0000 | fraction << 13,
        _ => (exponent + 112) << 23 | fraction << 13,
    };
    f32::from_bits(magnitude | sign)
}

#[cfg(test)]
mod tests {
    use super::f32_from_half;

    #[test]
    fn converts_normal_subnormal_and_special_numbers() {
        for (half, expected) in [
            (0x0000, 0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0400, 6.103_515_6e-5),
            (0x0001, 5.960_464_5e-8),
            (0x03ff, 6.097_555e-5),
            (0x3555, 0.333_251_95),
            (0x7c00, f32::INFINITY),
            (0xfc00, f32::NEG_INFINITY),
        ] {
            assert_eq!(
                f32_from_half(half).to_bits(),
                f32::to_bits(expected),
                "{half:04x}"
            );
        }
        assert!(f32_from_half(0x7e00).is_nan());
        assert!(f32_from_half(0x8000).is_sign_negative());
    }
}
