//! Registration: the rigid motion that brings a silhouette onto the reference silhouette.
//!
//! One rotation and one shift for the whole contour; what the limbs need beyond that is the refinement's.
//! The search is local: it finds the best motion within reach of where the contour lies.

mod contour_map;

pub use contour_map::ReferenceContourMap;

use glam::DVec2;
use pirouette_geom::chain::RigidMotion;

/// How far and how finely registration searches
///
/// In each round, every combination of `2 * steps_each_way + 1` rotations, shifts in x and shifts in y
/// around the best motion so far is tried; then the steps shrink.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegisterOptions {
    /// Rounds of the search
    pub rounds: usize,
    /// Candidates on each side of the best so far, in each of the three directions
    pub steps_each_way: usize,
    /// Distance of rotations in the first round, in radians
    pub rotation_step_radians: f64,
    /// Distance of shifts in the first round, in px
    pub translation_step_px: f64,
    /// Factor on the steps after each round, below 1
    pub shrink: f64,
}

impl Default for RegisterOptions {
    /// Ten rounds of 11 x 11 x 11 candidates, shrinking by 0.9, as published
    ///
    /// The first steps are ours: 0.5 degrees and 1 px reach 2.5 degrees and 5 px in the first round, 16 degrees
    /// and 32 px in all; the last ones are 0.2 degrees and 0.4 px. Twice as much reaches farther than anybody
    /// sways at 800 px of stature, and misses by twice as much.
    fn default() -> Self {
        Self {
            rounds: 10,
            steps_each_way: 5,
            rotation_step_radians: 0.5f64.to_radians(),
            translation_step_px: 1.0,
            shrink: 0.9,
        }
    }
}

/// The motion found, and what it gained
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registration {
    /// Centroid of the contour points, which the rotation is about, in px
    pub center: DVec2,
    /// From x to y: clockwise on screen
    pub rotation_radians: f64,
    /// Shift after the rotation, in px
    pub translation_px: DVec2,
    /// Mean distance of the contour points to the reference contour before, in px; infinite without a
    /// reference contour, 0 without contour points
    pub mean_distance_before_px: f64,
    /// The same after the motion; never more than before
    pub mean_distance_after_px: f64,
}

impl Registration {
    /// The motion itself
    pub fn motion(&self) -> RigidMotion {
        RigidMotion::about(self.center, self.rotation_radians, self.translation_px)
    }

    /// Where a point of the silhouette goes
    pub fn apply(&self, point: DVec2) -> DVec2 {
        self.motion().apply(point)
    }
}

/// Finds the rotation and shift that bring contour points nearest to a reference contour
///
/// `contour` is in the pixels of the reference view, in any order; points that are not finite are left out.
/// Motions count as better only when the mean distance falls, so a contour that lies right stays where it is.
///
/// # Source
/// Zwettler et al. 2021, eq. 2 to 4, read as: the points are rotated about their centroid by phi (2) and
/// shifted by (tx, ty) (3); the fitness is the mean of the reference contour's distance map at the points
/// (4); the search is exhaustive in 10 rounds of 11 x 11 x 11 candidates, scaled by 0.9 from round to round.
/// The distance map is finer than a pixel, see [`ReferenceContourMap`].
pub fn register(
    contour: &[DVec2],
    reference: &ReferenceContourMap,
    options: &RegisterOptions,
) -> Registration {
    let points = scattered(contour);
    let count = points.len().max(1) as f64;
    let center = points.iter().sum::<DVec2>() / count;
    let spokes: Vec<DVec2> = points.iter().map(|&p| p - center).collect();
    let before = reference.total_distance(&spokes, center, f64::INFINITY);

    let mut best = (before, 0.0, DVec2::ZERO);
    let mut rotation_step = options.rotation_step_radians;
    let mut shift_step = options.translation_step_px;
    let mut turned = Vec::with_capacity(spokes.len());
    for _ in 0..options.rounds {
        let (_, start_rotation, start_shift) = best;
        for i in offsets(options.steps_each_way) {
            let rotation = start_rotation + i * rotation_step;
            let turn = DVec2::from_angle(rotation);
            turned.clear();
            turned.extend(spokes.iter().map(|&p| turn.rotate(p)));
            for j in offsets(options.steps_each_way) {
                for k in offsets(options.steps_each_way) {
                    let shift = start_shift + shift_step * DVec2::new(j, k);
                    let total = reference.total_distance(&turned, center + shift, best.0);
                    if total < best.0 {
                        best = (total, rotation, shift);
                    }
                }
            }
        }
        rotation_step *= options.shrink;
        shift_step *= options.shrink;
    }
    let (after, rotation_radians, translation_px) = best;
    Registration {
        center,
        rotation_radians,
        translation_px,
        mean_distance_before_px: before / count,
        mean_distance_after_px: after / count,
    }
}

/// Whole steps from `-each_way` to `each_way`
pub(super) fn offsets(each_way: usize) -> impl Iterator<Item = f64> {
    (0..=2 * each_way).map(move |i| i as f64 - each_way as f64)
}

/// The finite points in an order that jumps around the contour: halves, then quarters, and so on
///
/// Sums over the first few points then tell early that a candidate cannot win.
pub(super) fn scattered(points: &[DVec2]) -> Vec<DVec2> {
    let finite: Vec<DVec2> = points.iter().copied().filter(|p| p.is_finite()).collect();
    let bits = finite.len().next_power_of_two().trailing_zeros();
    (0..1usize << bits)
        .map(|i| {
            i.reverse_bits()
                .checked_shr(usize::BITS - bits)
                .unwrap_or(0)
        })
        .filter_map(|i| finite.get(i).copied())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_geom::Grid;
    use pirouette_geom::contour::trace_outline;
    use pirouette_geom::coverage::fill_polygons;
    use proptest::prelude::*;

    /// A lopsided figure with one arm out, 200 px high
    fn figure() -> Vec<DVec2> {
        [
            (95., 20.),
            (120., 18.),
            (128., 60.),
            (180., 75.),
            (182., 92.),
            (130., 95.),
            (133., 140.),
            (150., 218.),
            (128., 220.),
            (112., 150.),
            (104., 219.),
            (84., 217.),
            (92., 130.),
            (88., 62.),
        ]
        .iter()
        .map(|&(x, y)| DVec2::new(x, y))
        .collect()
    }

    fn filled(polygon: Vec<DVec2>) -> Grid<f32> {
        fill_polygons(260, 250, &[polygon])
    }

    fn contour_of(coverage: &Grid<f32>) -> Vec<DVec2> {
        let outline = trace_outline(coverage, 0.5);
        outline.into_iter().flat_map(|c| c.points).collect()
    }

    #[test]
    fn a_contour_that_lies_right_stays() {
        let coverage = filled(figure());
        let reference = ReferenceContourMap::from_coverage(&coverage);
        let found = register(
            &contour_of(&coverage),
            &reference,
            &RegisterOptions::default(),
        );
        assert_eq!(found.rotation_radians, 0.0);
        assert_eq!(found.translation_px, DVec2::ZERO);
        assert!(found.mean_distance_before_px < 0.02, "{found:?}");
        assert_eq!(found.mean_distance_before_px, found.mean_distance_after_px);
    }

    #[test]
    fn a_known_motion_is_undone() {
        let reference = ReferenceContourMap::from_coverage(&filled(figure()));
        for (degrees, shift) in [
            (6.3, DVec2::new(9.4, -5.2)),
            (-4.0, DVec2::new(-13.1, 3.7)),
            (1.2, DVec2::new(0.6, 0.9)),
        ] {
            let sway =
                RigidMotion::about(DVec2::new(110.0, 120.0), f64::to_radians(degrees), shift);
            let moved = filled(figure().iter().map(|&p| sway.apply(p)).collect());
            let found = register(&contour_of(&moved), &reference, &RegisterOptions::default());
            assert!(
                (found.rotation_radians.to_degrees() + degrees).abs() < 0.25,
                "{found:?}"
            );
            for p in figure() {
                let error = found.apply(sway.apply(p)).distance(p);
                assert!(error < 0.7, "{error} px: {found:?}");
            }
            assert!(found.mean_distance_after_px < 0.35, "{found:?}");
            assert!(found.mean_distance_after_px < found.mean_distance_before_px);
        }
    }

    #[test]
    fn poison_moves_nothing() {
        let options = RegisterOptions::default();
        let figure_map = ReferenceContourMap::from_coverage(&filled(figure()));
        for coverage in [
            Grid::filled(0, 0, 1.0),
            Grid::filled(1, 1, 0.0),
            Grid::filled(1, 1, 1.0),
            Grid::filled(3, 2, f32::NAN),
        ] {
            let reference = ReferenceContourMap::from_coverage(&coverage);
            let far = register(
                &[DVec2::splat(f64::INFINITY), DVec2::NAN],
                &reference,
                &options,
            );
            assert_eq!(far.motion(), RigidMotion::IDENTITY);
            let found = register(&figure(), &reference, &options);
            assert!(found.motion().translation.is_finite());
            assert!(!found.mean_distance_after_px.is_nan());
        }
        let nothing = register(&[], &figure_map, &options);
        assert_eq!(nothing.apply(DVec2::ONE), DVec2::ONE);
        assert_eq!(nothing.mean_distance_after_px, 0.0);
        let still = RegisterOptions {
            rounds: 0,
            ..options
        };
        assert_eq!(
            register(&figure(), &figure_map, &still).motion(),
            RigidMotion::IDENTITY
        );
    }

    proptest! {
        #[test]
        fn scattering_keeps_every_point(count in 0usize..100) {
            let points: Vec<DVec2> = (0..count).map(|i| DVec2::splat(i as f64)).collect();
            let mut back: Vec<usize> = scattered(&points).iter().map(|p| p.x as usize).collect();
            back.sort_unstable();
            prop_assert_eq!(back, (0..count).collect::<Vec<_>>());
        }
    }
}
