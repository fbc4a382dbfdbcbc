//! The published exhaustive search of a registration: slow reference implementation for comparison with ours.

use glam::DVec2;
use pirouette_geom::chain::RigidMotion;

/// Number of rounds, each around the best candidate
const ROUNDS: usize = 10;

/// Candidates in each direction, for each of rotation, x and y: 11 x 11 x 11 in total
const EACH_WAY: i32 = 5;

/// Factor on the steps between rounds
const SHRINK: f64 = 0.9;

/// Steps of the first round; the paper does not state them
///
/// They reach 2.5 degrees and 5 px in the first round, 16 degrees and 32 px in total, and end at 0.2 degrees and 0.4
/// px.
const FIRST_STEP: (f64, f64) = (0.5 * std::f64::consts::PI / 180.0, 1.0);

/// Result of the search
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    /// The best motion
    pub(super) motion: RigidMotion,
    /// Mean distance of the moved points, in px
    pub(super) mean_distance_px: f64,
}

/// Evaluates every candidate with every point
///
/// `distance` returns the distance of a position from the reference contour, in px.
///
/// # Source
/// Zwettler et al. 2021, eq. 2 to 4: rotation about the centroid and shift, 10 rounds of 11 x 11 x 11 candidates whose
/// steps shrink by 0.9.
pub(super) fn search(points: &[DVec2], distance: impl Fn(DVec2) -> f64) -> Found {
    let count = points.len().max(1) as f64;
    let center = points.iter().sum::<DVec2>() / count;
    let fitness = |motion: &RigidMotion| {
        let turn = DVec2::from_angle(motion.rotation_radians);
        let moved = points.iter().map(|p| turn.rotate(*p) + motion.translation);
        moved.map(&distance).sum::<f64>() / count
    };
    let mut best = (fitness(&RigidMotion::IDENTITY), 0.0, DVec2::ZERO);
    let (mut turn_step, mut shift_step) = FIRST_STEP;
    for _ in 0..ROUNDS {
        let (_, from_turn, from_shift) = best;
        for i in -EACH_WAY..=EACH_WAY {
            for j in -EACH_WAY..=EACH_WAY {
                for k in -EACH_WAY..=EACH_WAY {
                    let turn = from_turn + turn_step * f64::from(i);
                    let shift = from_shift + shift_step * DVec2::new(f64::from(j), f64::from(k));
                    let found = fitness(&RigidMotion::about(center, turn, shift));
                    if found < best.0 {
                        best = (found, turn, shift);
                    }
                }
            }
        }
        turn_step *= SHRINK;
        shift_step *= SHRINK;
    }
    Found {
        motion: RigidMotion::about(center, best.1, best.2),
        mean_distance_px: best.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moved_square_is_registered() {
        let square: Vec<DVec2> = (0..40)
            .map(|i| {
                let t = f64::from(i % 10) / 10.0;
                let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
                let corner = |i: i32| DVec2::from(corners[i as usize % 4]);
                100.0 * corner(i / 10).lerp(corner(i / 10 + 1), t)
            })
            .collect();
        let distance = |p: DVec2| {
            let out = (p - 50.0).abs() - 50.0;
            let outside = out.max(DVec2::ZERO).length();
            (outside + out.max_element().min(0.0)).abs()
        };
        let away = RigidMotion::about(DVec2::splat(50.0), 0.05, DVec2::new(7.0, -4.0));
        let moved: Vec<DVec2> = square.iter().map(|p| away.apply(*p)).collect();
        let found = search(&moved, distance);
        assert!(found.mean_distance_px < 0.3, "{found:?}");
        for (p, q) in square.iter().zip(&moved) {
            assert!(found.motion.apply(*q).distance(*p) < 0.5);
        }
    }
}
