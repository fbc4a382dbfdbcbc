use super::*;
use pirouette_geom::contour::trace_outline;
use pirouette_geom::coverage::fill_polygons;
use proptest::prelude::*;

/// A round-ended bone as a polygon
pub(in crate::normalize) fn capsule(from: DVec2, to: DVec2, radius: f64) -> Vec<DVec2> {
    let out = (to - from).try_normalize().unwrap_or(DVec2::X);
    (0..48)
        .map(|i| std::f64::consts::TAU * (f64::from(i) + 0.5) / 48.0)
        .map(|t| {
            let end = if t.cos() > 0.0 { to } else { from };
            end + radius * DVec2::from_angle(t).rotate(out)
        })
        .collect()
}

fn soft_of(mask: &Mask) -> Windowed<f32> {
    Windowed::new(&mask.map(|&v| f32::from(u8::from(v))))
}

fn area(soft: &Grid<f32>) -> f64 {
    soft.as_slice().iter().map(|&v| f64::from(v)).sum()
}

/// A bent bar with a hole
fn bar() -> Grid<f32> {
    let mut hole = capsule(DVec2::new(110.0, 60.0), DVec2::new(120.0, 60.0), 6.0);
    hole.reverse();
    let parts = [
        capsule(DVec2::new(30.3, 60.2), DVec2::new(130.0, 60.7), 16.0),
        capsule(DVec2::new(30.3, 60.2), DVec2::new(22.0, 110.0), 9.0),
        hole,
    ];
    fill_polygons(160, 130, &parts)
}

#[test]
fn a_silhouette_with_fixed_handles_is_unchanged() {
    let soft = bar();
    let mask = soft.threshold(0.5);
    let handles = [DVec2::new(40.0, 60.0), DVec2::new(90.0, 61.0)];
    for source in [ContourSource::Outline, ContourSource::BorderPixels] {
        let contours = trace_silhouette(&mask, &Windowed::new(&soft), source);
        assert_eq!(contours.iter().filter(|c| c.hole).count(), 1);
        let prepared =
            DeformableSilhouette::new(&contours, &handles, &DeformOptions::default()).unwrap();
        prepared.mesh().check().unwrap();
        let same = prepared.deform(&handles).contours;
        for (before, after) in contours.iter().zip(&same) {
            for [a, _] in after.edges() {
                assert!(before.points.iter().any(|b| a.distance(*b) < 1e-6));
            }
        }
        let filled = fill_contours(160, 130, &same);
        let exact = match source {
            ContourSource::Outline => area(&soft),
            ContourSource::BorderPixels => mask.area() as f64,
        };
        assert!((area(&filled) / exact - 1.0).abs() < 0.002);
        assert!(filled.threshold(0.5).iou(&mask) > 0.997);
    }
}

#[test]
fn a_rigid_motion_of_the_handles_moves_the_silhouette_rigidly() {
    let contours = trace_outline(&bar(), 0.5);
    let handles = [DVec2::new(40.0, 60.0), DVec2::new(90.0, 61.0)];
    let prepared =
        DeformableSilhouette::new(&contours, &handles, &DeformOptions::default()).unwrap();
    let turn = DVec2::from_angle(2.5);
    let motion = |p: DVec2| turn.rotate(p) + DVec2::new(150.0, 90.0);
    let moved = prepared.deform(&handles.map(motion));
    // the only loss is rounding of the mesh to 1/1024 px
    for (before, after) in contours.iter().zip(&moved.contours) {
        assert_eq!(before.hole, after.hole);
        for (p, q) in before.points.iter().zip(&after.points) {
            let nearest = after.points.iter().map(|r| r.distance(motion(*p)));
            assert!(nearest.fold(f64::INFINITY, f64::min) < 2e-3, "{p} {q}");
        }
    }
}

#[test]
fn handles_outside_are_ignored_and_coincident_ones_share_a_vertex() {
    let contours = trace_outline(&bar(), 0.5);
    let inside = DVec2::new(40.0, 60.0);
    let sources = [inside, DVec2::new(2.0, 2.0), inside];
    let prepared =
        DeformableSilhouette::new(&contours, &sources, &DeformOptions::default()).unwrap();
    assert_eq!(prepared.handle_count(), 2);
    let shift = DVec2::new(4.0, 6.0);
    let moved = prepared.deform(&[inside, DVec2::new(90.0, 90.0), inside + 2.0 * shift]);
    let expected = trace_outline(&bar(), 0.5)[0].points[0] + shift;
    let mut points = moved.contours[0].points.iter();
    assert!(points.any(|p| p.distance(expected) < 2e-3));
}

#[test]
fn only_the_largest_part_is_kept_with_its_own_holes() {
    let mask = Mask::from_art(
        "#########.##\n#.......#.##\n#.#####.#...\n#.#...#.#...\n#.#.#.#.#...\n#.#...#.#...\n#.#####.#...\n#.......#...\n#########...",
    );
    for source in [ContourSource::Outline, ContourSource::BorderPixels] {
        let kept = trace_silhouette(&mask, &soft_of(&mask), source);
        let holes: Vec<bool> = kept.iter().map(|c| c.hole).collect();
        assert_eq!(holes, [false, true]);
        assert!((kept[1].signed_area() + 49.0).abs() < 1.0);
    }
}

#[test]
fn thin_shapes_and_bridges_are_meshed() {
    let line = Mask::from_fn(60, 9, |x, y| y == 4 && (3..57).contains(&x));
    let bells = Mask::from_fn(60, 20, |x, y| {
        (y == 9 && (3..57).contains(&x)) || ((3..18).contains(&x) && (2..17).contains(&y)) || x > 45
    });
    for mask in [line, bells] {
        for source in [ContourSource::Outline, ContourSource::BorderPixels] {
            let contours = trace_silhouette(&mask, &soft_of(&mask), source);
            let prepared =
                DeformableSilhouette::new(&contours, &[], &DeformOptions::default()).unwrap();
            prepared.mesh().check().unwrap();
            let same = prepared.deform(&[]).contours;
            let filled = fill_contours(mask.width(), mask.height(), &same);
            assert!(filled.threshold(0.499).iou(&mask) > 0.96, "{source:?}");
        }
    }
}

#[test]
fn empty_input_is_an_error_without_panic() {
    for (width, height) in [(0, 0), (1, 1), (5, 3)] {
        let mask = Mask::filled(width, height, false);
        let poison = mask.map(|_| f32::NAN);
        for source in [ContourSource::Outline, ContourSource::BorderPixels] {
            let contours = trace_silhouette(&mask, &Windowed::new(&poison), source);
            let made = DeformableSilhouette::new(&contours, &[], &DeformOptions::default());
            assert_eq!(made.err(), Some(DeformError::Empty));
        }
    }
    let pixel = Mask::filled(1, 1, true);
    for source in [ContourSource::Outline, ContourSource::BorderPixels] {
        let contours = trace_silhouette(&pixel, &soft_of(&pixel), source);
        let made = DeformableSilhouette::new(&contours, &[DVec2::ZERO], &DeformOptions::default());
        assert_eq!(made.unwrap().handle_count(), 0);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 5))]
    #[test]
    fn noise_with_joints_anywhere_deforms(
        bits in prop::collection::vec(prop::bool::weighted(0.62), 24 * 24),
        joints in prop::collection::vec(prop::array::uniform4(-4.0..28.0f64), 0..12),
        border in any::<bool>(),
    ) {
        let mask = Mask::from_vec(24, 24, bits);
        let source = if border { ContourSource::BorderPixels } else { ContourSource::Outline };
        let contours = trace_silhouette(&mask, &soft_of(&mask), source);
        let sources: Vec<DVec2> = joints.iter().map(|j| DVec2::new(j[0], j[1])).collect();
        let targets: Vec<DVec2> = joints.iter().map(|j| DVec2::new(j[2], j[3])).collect();
        let options = DeformOptions { max_triangle_area: 20.0, ..Default::default() };
        let made = DeformableSilhouette::new(&contours, &sources, &options);
        prop_assume!(made.is_ok() || contours.is_empty());
        if let Ok(prepared) = made {
            prop_assert_eq!(prepared.mesh().check(), Ok(()));
            let moved = prepared.deform(&targets);
            for contour in &moved.contours {
                prop_assert!(contour.points.iter().all(|p| p.is_finite()));
            }
            let rest = prepared.deform(&sources).contours;
            for (a, b) in rest.iter().zip(&contours) {
                prop_assert_eq!(a.points.len(), b.points.len());
                for p in &a.points {
                    let near = b.points.iter().map(|q| q.distance(*p));
                    let d = near.fold(f64::INFINITY, f64::min); prop_assert!(d < 1e-6, "{} {} {} {:?}", p, d, prepared.mesh().triangles.len(), rest.iter().map(|c| c.points.len()).collect::<Vec<_>>());
                }
            }
            let filled = fill_contours(24, 24, &rest);
            let before = fill_contours(24, 24, &contours);
            for (a, b) in filled.as_slice().iter().zip(before.as_slice()) {
                prop_assert!((a - b).abs() < 0.02);
            }
        }
    }
}
