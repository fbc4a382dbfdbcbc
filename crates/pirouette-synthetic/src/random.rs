//! A small deterministic random generator: a seed gives the same person on every machine.

use std::f64::consts::TAU;

/// SplitMix64 (Steele, Lea, Flood 2014): one 64-bit state, good enough for noise
#[derive(Debug, Clone)]
pub struct Random {
    state: u64,
}

impl Random {
    /// Creates a generator; equal seeds give equal numbers
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// Returns a uniform 64-bit number
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.state)
    }

    /// Returns a uniform number in [0, 1)
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a uniform number between two bounds
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Returns a standard normal number (Box and Muller 1958)
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }
}

/// Hashes 64 bits: nearby inputs give unrelated outputs
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Returns a number uniform in [0, 1), determined by a lattice point
fn lattice(x: i64, y: i64, z: i64, seed: u64) -> f64 {
    let key = (x as u64)
        .wrapping_mul(0x8da6_b343)
        .wrapping_add((y as u64).wrapping_mul(0xd816_3841))
        .wrapping_add((z as u64).wrapping_mul(0xcb1a_b31f))
        .wrapping_add(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    (mix(key) >> 11) as f64 / (1u64 << 53) as f64
}

/// Returns smooth noise in [0, 1] over space, cell size 1 (value noise, trilinear with smooth steps)
pub(super) fn noise(point: glam::DVec3, seed: u64) -> f64 {
    let cell = point.floor();
    let f = point - cell;
    let f = f * f * (glam::DVec3::splat(3.0) - 2.0 * f);
    let (x, y, z) = (cell.x as i64, cell.y as i64, cell.z as i64);
    let mut value = 0.0;
    for corner in 0..8i64 {
        let (i, j, k) = (corner & 1, corner >> 1 & 1, corner >> 2);
        let weight = (if i == 1 { f.x } else { 1.0 - f.x })
            * (if j == 1 { f.y } else { 1.0 - f.y })
            * (if k == 1 { f.z } else { 1.0 - f.z });
        value += weight * lattice(x + i, y + j, z + k, seed);
    }
    value
}

/// Returns the sum of three octaves of [`noise`], in [0, 1]
pub(super) fn rough_noise(point: glam::DVec3, seed: u64) -> f64 {
    (noise(point, seed)
        + 0.5 * noise(point * 2.03, seed ^ 0x55)
        + 0.25 * noise(point * 4.1, seed ^ 0xaa))
        / 1.75
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_zero_and_standard_deviation_one() {
        let mut random = Random::new(7);
        let values: Vec<f64> = (0..20_000).map(|_| random.normal()).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05);
    }

    #[test]
    fn noise_is_smooth_and_repeatable() {
        let p = glam::DVec3::new(3.2, -1.7, 8.9);
        let step = glam::DVec3::new(1e-4, 0.0, 0.0);
        assert!((noise(p, 1) - noise(p + step, 1)).abs() < 1e-3);
        assert!((noise(p, 1) - noise(p, 1)).abs() < 1e-15);
        assert!((noise(p, 1) - noise(p, 2)).abs() > 1e-6);
    }
}
