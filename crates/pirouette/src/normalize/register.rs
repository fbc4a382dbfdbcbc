//! Registration: the rigid motion that moves a silhouette onto the reference silhouette.
//!
//! One rotation and one shift for the complete contour; further corrections of the limbs are left to the refinement.
//! The search is local: it finds the best motion within a range around the initial position.

mod contour_map;

pub use contour_map::ReferenceContourMap;

use glam::DVec2;
use pirouette_geom::chain::RigidMotion;

use super::JointPositions;
use super::descent::{Pull, Softness, descend};
use super::parts::Bones;

/// Range of the registration
///
/// It starts from 3 rotations and 5 x 5 shifts and descends from each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegisterOptions {
    /// Rotations of the starting points, to either side, in radians
    pub reach_radians: f64,
    /// Shifts of the outermost starting points, in x and in y, in px
    pub reach_px: f64,
    /// Whether arms are included
    ///
    /// Their poses differ most between people, and the refinement bends them anyway. With them, the error against a
    /// reference of another build is 1.7 px instead of 0.4, against one of the other sex 3.0 instead of 2.4.
    pub arms: bool,
}

impl Default for RegisterOptions {
    /// 8 degrees and 24 px; the descent extends this by some degrees and pixels
    ///
    /// This exceeds the sway of people at 800 px of stature.
    fn default() -> Self {
        Self {
            reach_radians: 8f64.to_radians(),
            reach_px: 24.0,
            arms: false,
        }
    }
}

/// Number of points used by the descents from all starting points, and their schedule
const FIRST: (usize, [Softness; 1]) = (96, [Softness { px: 2.0, rounds: 5 }]);

/// The same for the few descents that are continued
const SECOND: (usize, [Softness; 2]) = (
    400,
    [
        Softness {
            px: 1.0,
            rounds: 10,
        },
        Softness { px: 0.3, rounds: 5 },
    ],
);

/// Number of descents that are continued
const KEPT: usize = 2;

/// Final schedule of the best one with all points; outlines are known to about the last softness
const LAST: [Softness; 2] = [
    Softness { px: 0.3, rounds: 4 },
    Softness { px: 0.1, rounds: 8 },
];

/// Arms are included anyway when less than this share of the contour remains without them
const LEAST_REST: f64 = 0.3;

/// Gains of the mean distance below this leave the silhouette unmoved, in px
const MIN_GAIN_PX: f64 = 0.003;

/// The motion found, and its gain
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registration {
    /// Centroid of the contour points, the center of the rotation, in px
    pub center: DVec2,
    /// Angle from x to y: clockwise on screen
    pub rotation_radians: f64,
    /// Shift after the rotation, in px
    pub translation_px: DVec2,
    /// Mean distance of the contour points to the reference contour before, in px; infinite without a
    /// reference contour, 0 without contour points
    pub mean_distance_before_px: f64,
    /// The same after the motion; never larger than before
    pub mean_distance_after_px: f64,
}

impl Registration {
    /// Returns the motion itself
    pub fn motion(&self) -> RigidMotion {
        RigidMotion::about(self.center, self.rotation_radians, self.translation_px)
    }

    /// Maps a point of the silhouette
    pub fn apply(&self, point: DVec2) -> DVec2 {
        self.motion().apply(point)
    }
}

/// Finds the rotation and shift that minimize the distance of contour points to a reference contour
///
/// `contour` is in the pixels of the reference view, in any order; non-finite points are ignored, as are those nearest
/// to arms, by `joints`, unless too few remain. A contour that already matches to a few thousandths of a pixel on
/// average is not moved.
///
/// # Source
/// Zwettler et al. 2021, eq. 2 to 4, interpreted as: the points are rotated about their centroid by phi (2) and shifted
/// by (tx, ty) (3); the fitness is the mean of the reference contour's distance map at the points (4). Published is an
/// exhaustive search in 10 rounds of 11 x 11 x 11 candidates, scaled by 0.9 from round to round. Ours descends on the
/// map from several starting points: a hundredth of the time, and a better optimum, since its steps are not limited to
/// fractions of a pixel. The distance map is finer than a pixel, see [`ReferenceContourMap`].
pub fn register(
    contour: &[DVec2],
    joints: &JointPositions,
    reference: &ReferenceContourMap,
    options: &RegisterOptions,
) -> Registration {
    let bones = Bones::new(joints);
    let mut points = scattered(contour);
    if !options.arms {
        let rest = points.iter().copied().filter(|&p| !bones.is_of_arm(p));
        let rest: Vec<DVec2> = rest.collect();
        if rest.len() as f64 >= LEAST_REST * points.len() as f64 {
            points = rest;
        }
    }
    let count = points.len().max(1) as f64;
    let center = points.iter().sum::<DVec2>() / count;
    let spokes: Vec<DVec2> = points.iter().map(|&p| p - center).collect();
    // Rotations are scaled to px at the far end of the contour, so that all parameters have similar magnitudes.
    let radius = spokes.iter().map(|p| p.length()).fold(1.0, f64::max);
    let pull_of = |spokes: &[DVec2], &[turn, x, y]: &[f64; 3], pull: &mut Pull<3>| {
        let (turn, shift) = (DVec2::from_angle(turn / radius), center + DVec2::new(x, y));
        for &spoke in spokes {
            let turned = turn.rotate(spoke);
            if let Some((distance, slope)) = reference.signed_with_slope(turned + shift) {
                let along = slope.dot(turned.perp()) / radius;
                pull.add(distance, [along, slope.x, slope.y]);
            }
        }
    };
    let walk = |count: usize, start: [f64; 3], softness: &[Softness]| {
        let some = &spokes[..spokes.len().min(count)];
        descend(start, softness, |at, pull| pull_of(some, at, pull))
    };
    let mut walks: Vec<([f64; 3], f64)> = Vec::new();
    for i in offsets(1) {
        for j in offsets(2) {
            for k in offsets(2) {
                let shift = options.reach_px / 2.0 * DVec2::new(j, k);
                let start = [i * options.reach_radians * radius, shift.x, shift.y];
                walks.push(walk(FIRST.0, start, &FIRST.1));
            }
        }
    }
    walks.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    walks.dedup_by(|(a, _), (b, _)| a.iter().zip(b).all(|(a, b)| (*a - *b).abs() < 1.0));
    let kept = walks.into_iter().take(KEPT);
    let start = kept
        .map(|(start, _)| walk(SECOND.0, start, &SECOND.1))
        .min_by(|(_, a), (_, b)| a.total_cmp(b))
        .map_or([0.0; 3], |(start, _)| start);
    let ([turn, x, y], _) = walk(usize::MAX, start, &LAST);

    let before = reference.total_distance(&spokes, center, f64::INFINITY);
    let (rotation, shift) = (turn / radius, DVec2::new(x, y));
    let turned = DVec2::from_angle(rotation);
    let turned: Vec<DVec2> = spokes.iter().map(|&p| turned.rotate(p)).collect();
    let found = reference.total_distance(&turned, center + shift, f64::INFINITY);
    let (after, rotation_radians, translation_px) = if found < before - MIN_GAIN_PX * count {
        (found, rotation, shift)
    } else {
        (before, 0.0, DVec2::ZERO)
    };
    Registration {
        center,
        rotation_radians,
        translation_px,
        mean_distance_before_px: before / count,
        mean_distance_after_px: after / count,
    }
}

/// Returns integer steps from `-each_way` to `each_way`
pub(super) fn offsets(each_way: usize) -> impl Iterator<Item = f64> {
    (0..=2 * each_way).map(move |i| i as f64 - each_way as f64)
}

/// Returns the finite points in an order that jumps around the contour: halves, then quarters, and so on
///
/// Sums over the first few points then reject hopeless candidates early.
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

    /// An asymmetric figure with one arm out, 200 px high
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

    const NO_JOINTS: JointPositions = pirouette_body::PerJoint::splat(None);

    fn filled(polygon: Vec<DVec2>) -> Grid<f32> {
        fill_polygons(260, 250, &[polygon])
    }

    fn contour_of(coverage: &Grid<f32>) -> Vec<DVec2> {
        let outline = trace_outline(coverage, 0.5);
        outline.into_iter().flat_map(|c| c.points).collect()
    }

    #[test]
    fn a_registered_contour_is_not_moved() {
        let coverage = filled(figure());
        let reference = ReferenceContourMap::from_coverage(&coverage);
        let found = register(
            &contour_of(&coverage),
            &NO_JOINTS,
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
            let found = register(
                &contour_of(&moved),
                &NO_JOINTS,
                &reference,
                &RegisterOptions::default(),
            );
            assert!(
                (found.rotation_radians.to_degrees() + degrees).abs() < 0.02,
                "{found:?}"
            );
            for p in figure() {
                let error = found.apply(sway.apply(p)).distance(p);
                assert!(error < 0.1, "{error} px: {found:?}");
            }
            assert!(found.mean_distance_after_px < 0.1, "{found:?}");
            assert!(found.mean_distance_after_px < found.mean_distance_before_px);
        }
    }

    #[test]
    fn an_arm_in_another_pose_has_no_influence() {
        use pirouette_body::Joint::*;
        let shift = DVec2::new(7.0, -4.0);
        let mut raised = figure();
        for (index, y) in [(3, 45.0), (4, 62.0)] {
            raised[index].y = y;
        }
        for p in &mut raised {
            *p += shift;
        }
        let mut joints = NO_JOINTS;
        for (joint, x, y) in [
            (Neck, 110.0, 70.0),
            (MidHip, 110.0, 150.0),
            (LeftShoulder, 132.0, 80.0),
            (LeftElbow, 152.0, 68.0),
            (LeftWrist, 172.0, 57.0),
        ] {
            joints[joint] = Some(DVec2::new(x, y) + shift);
        }
        let reference = ReferenceContourMap::from_coverage(&filled(figure()));
        let contour = contour_of(&filled(raised));
        let off = |arms: bool| {
            let options = RegisterOptions {
                arms,
                ..RegisterOptions::default()
            };
            let found = register(&contour, &joints, &reference, &options);
            let trunk = DVec2::new(110.0, 120.0);
            found.apply(trunk + shift).distance(trunk)
        };
        assert!(off(false) < 0.1, "{}", off(false));
        assert!(off(true) > 2.0 * off(false), "{}", off(true));
    }

    #[test]
    fn non_finite_input_causes_no_motion() {
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
                &NO_JOINTS,
                &reference,
                &options,
            );
            assert_eq!(far.motion(), RigidMotion::IDENTITY);
            let found = register(&figure(), &NO_JOINTS, &reference, &options);
            assert!(found.motion().translation.is_finite());
            assert!(!found.mean_distance_after_px.is_nan());
        }
        let nothing = register(&[], &NO_JOINTS, &figure_map, &options);
        assert_eq!(nothing.apply(DVec2::ONE), DVec2::ONE);
        assert_eq!(nothing.mean_distance_after_px, 0.0);
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
