use super::*;
use glam::DVec2;
use pirouette_geom::Grid;
use pirouette_geom::coverage::fill_polygons;
use proptest::prelude::*;

/// An ellipsoid with its axes along the world's
#[derive(Debug, Clone, Copy)]
struct Ellipsoid {
    center: DVec3,
    radii: DVec3,
}

impl Ellipsoid {
    fn volume(&self) -> f64 {
        4.0 / 3.0 * PI * self.radii.element_product()
    }

    /// Outline in the photo: projection of the circle in which lines of sight touch the surface
    fn outline(&self, camera: &Camera, turn: TurnAngle) -> Vec<DVec2> {
        let room_from_world = turn.room_from_world();
        let eye = room_from_world.transpose() * camera.center() - self.center;
        // In the frame where the ellipsoid is the unit sphere
        let eye = eye / self.radii;
        let (a, b) = (eye / eye.length()).any_orthonormal_pair();
        let distance_squared = eye.length_squared();
        let radius = (1.0 - 1.0 / distance_squared).sqrt();
        (0..720)
            .map(|i| {
                let (sin, cos) = (f64::from(i) / 720.0 * std::f64::consts::TAU).sin_cos();
                let touch = eye / distance_squared + (a * cos + b * sin) * radius;
                camera.project(room_from_world * (self.center + touch * self.radii))
            })
            .collect()
    }

    fn surface_points(&self) -> impl Iterator<Item = DVec3> + '_ {
        (0..300).map(|i| {
            let height = (f64::from(i) + 0.5) / 150.0 - 1.0;
            let (sin, cos) = (f64::from(i) * 2.399_963).sin_cos();
            let ring = (1.0 - height * height).sqrt();
            self.center + self.radii * DVec3::new(ring * cos, height, ring * sin)
        })
    }
}

/// A trunk, a head slightly above it, and an arm
fn body() -> [Ellipsoid; 3] {
    let part = |center: [f64; 3], radii: [f64; 3]| Ellipsoid {
        center: DVec3::from_array(center),
        radii: DVec3::from_array(radii),
    };
    [
        part([0.0, 700.0, 10.0], [180.0, 650.0, 130.0]),
        part([0.0, 1400.0, 30.0], [80.0, 120.0, 100.0]),
        part([230.0, 900.0, 0.0], [120.0, 40.0, 45.0]),
    ]
}

fn camera() -> Camera {
    Camera {
        width_px: 300,
        height_px: 400,
        vertical_fov_radians: 0.75,
        height_mm: 900.0,
        distance_mm: 2400.0,
        pitch_radians: 0.06,
        yaw_radians: 0.0,
        distortion: 0.0,
    }
}

fn turns(count: usize) -> Vec<TurnAngle> {
    let turn = |i| TurnAngle::from_degrees(360.0 * i as f64 / count as f64);
    (0..count).map(turn).collect()
}

/// Silhouettes of ellipsoids, and the outlines they are filled from
fn render(parts: &[Ellipsoid], camera: &Camera, turns: &[TurnAngle]) -> Vec<Grid<f32>> {
    turns
        .iter()
        .map(|&turn| {
            let outlines: Vec<Vec<DVec2>> = parts
                .iter()
                .map(|part| part.outline(camera, turn))
                .collect();
            fill_polygons(camera.width_px, camera.height_px, &outlines)
        })
        .collect()
}

fn outline(silhouette: &Grid<f32>) -> OutlineMap {
    OutlineMap::new(silhouette, OutlineMap::FAR_PX)
}

fn outlines(silhouettes: &[Grid<f32>]) -> Vec<OutlineMap> {
    silhouettes.iter().map(outline).collect()
}

fn views<'a>(
    outlines: &'a [OutlineMap],
    camera: Camera,
    turns: &[TurnAngle],
) -> Vec<CarveView<'a>> {
    outlines
        .iter()
        .zip(turns)
        .map(|(outline, &turn)| CarveView {
            outline,
            camera,
            turn,
        })
        .collect()
}

fn coarse() -> CarveOptions {
    CarveOptions {
        voxel_size_mm: 12.0,
        ..CarveOptions::default()
    }
}

#[test]
fn four_views_of_a_sphere_give_a_closed_manifold_hull() {
    let ball = Ellipsoid {
        center: DVec3::new(20.0, 900.0, -30.0),
        radii: DVec3::splat(200.0),
    };
    let turns = turns(4);
    let silhouettes = render(&[ball], &camera(), &turns);
    let hull = carve(&views(&outlines(&silhouettes), camera(), &turns), &coarse()).expect("a hull");
    assert_eq!(hull.check(), Ok(()));
    // Two crossed cylinders hold 16/3 r^3: 1.27 times the ball.
    let ratio = hull.volume() / ball.volume();
    assert!((1.15..1.30).contains(&ratio), "{ratio}");
}

#[test]
fn the_hull_lies_on_the_outlines_to_a_fraction_of_a_pixel() {
    let ball = Ellipsoid {
        center: DVec3::new(20.0, 900.0, -30.0),
        radii: DVec3::new(220.0, 300.0, 150.0),
    };
    let turns = turns(5);
    let silhouettes = render(&[ball], &camera(), &turns);
    let silhouettes = outlines(&silhouettes);
    let views = views(&silhouettes, camera(), &turns);
    let hull = carve(&views, &coarse()).expect("a hull");
    let outlines: Vec<Vec<DVec2>> = turns.iter().map(|&t| ball.outline(&camera(), t)).collect();
    let mut sum_squares = 0.0;
    for &p in &hull.positions {
        // The outline that the vertex lies on; a vertex at an edge of the hull lies on two.
        let mut nearest = f64::INFINITY;
        for (view, outline) in views.iter().zip(&outlines) {
            let q = camera().project(view.turn.room_from_world() * p);
            let distance = outline.iter().map(|o| (*o - q).length());
            nearest = nearest.min(distance.fold(f64::INFINITY, f64::min));
        }
        assert!(nearest < 0.6, "{nearest} px at {p}");
        sum_squares += nearest * nearest;
    }
    // Neighboring outline points are up to 0.7 px apart, which alone gives 0.2.
    let rms = (sum_squares / hull.positions.len() as f64).sqrt();
    assert!(rms < 0.25, "{rms} px");
}

#[test]
fn the_hull_contains_the_body() {
    let turns = turns(7);
    let silhouettes = render(&body(), &camera(), &turns);
    let seen = outlines(&silhouettes);
    let field = HullField::new(&views(&seen, camera(), &turns), 1).expect("a field");
    for part in body() {
        for p in part.surface_points().filter(|p| p.y > 0.0) {
            // A fifth of a pixel
            let value = field.value(p, ViewSet::ALL);
            assert!(value < 1.0, "{value} mm outside at {p}");
        }
    }
}

#[test]
fn one_more_view_never_grows_the_hull() {
    let turns = turns(7);
    let silhouettes = render(&body(), &camera(), &turns);
    let silhouettes = outlines(&silhouettes);
    let views = views(&silhouettes, camera(), &turns);
    let mut last: Option<(HullField, f64)> = None;
    for count in 2..=7 {
        let mesh = carve(&views[..count], &coarse()).expect("a hull");
        assert_eq!(mesh.check(), Ok(()));
        if let Some((before, volume)) = &last {
            assert!(mesh.volume() <= volume * (1.0 + 1e-9));
            for &p in &mesh.positions {
                assert!(before.value(p, ViewSet::ALL) < 1.0);
            }
        }
        let field = HullField::new(&views[..count], 1).expect("a field");
        last = Some((field, mesh.volume()));
    }
}

#[test]
fn tolerating_one_miss_keeps_the_parts_missing_in_a_bad_mask() {
    let turns = turns(7);
    let mut silhouettes = render(&body(), &camera(), &turns);
    let strict =
        carve(&views(&outlines(&silhouettes), camera(), &turns), &coarse()).expect("a hull");
    for y in 150..250 {
        silhouettes[3].row_mut(y).fill(0.0);
    }
    let silhouettes = outlines(&silhouettes);
    let bad = views(&silhouettes, camera(), &turns);
    let cut = carve(&bad, &coarse()).expect("a hull");
    let forgiving = CarveOptions {
        misses_to_remove: 2,
        ..coarse()
    };
    let corrected = carve(&bad, &forgiving).expect("a hull");
    assert!(cut.volume() < 0.7 * strict.volume());
    assert!(corrected.volume() > strict.volume());
    assert_eq!(corrected.check(), Ok(()));
}

#[test]
fn the_hull_stands_on_the_floor() {
    let turns = turns(6);
    let silhouettes = render(&body(), &camera(), &turns);
    let hull = carve(&views(&outlines(&silhouettes), camera(), &turns), &coarse()).expect("a hull");
    let (lo, _) = hull.bounds().expect("there are vertices");
    // The trunk extends below the floor; its hull is cut off there.
    let sunk = Ellipsoid {
        center: DVec3::new(0.0, 400.0, 0.0),
        radii: DVec3::new(150.0, 600.0, 150.0),
    };
    let silhouettes = render(&[sunk], &camera(), &turns);
    let cut = carve(&views(&outlines(&silhouettes), camera(), &turns), &coarse()).expect("a hull");
    let (cut_lo, _) = cut.bounds().expect("there are vertices");
    assert!(lo.y > 20.0);
    assert!(cut_lo.y.abs() < 1e-9, "{}", cut_lo.y);
    assert_eq!(cut.check(), Ok(()));
}

#[test]
fn a_border_that_cuts_the_silhouette_does_not_carve() {
    let turns = turns(6);
    let whole = render(&body(), &camera(), &turns);
    let expected = carve(&views(&outlines(&whole), camera(), &turns), &coarse()).expect("a hull");
    // The same camera with a narrower sensor in one view: the arm leaves the photo.
    let narrow = Camera {
        width_px: 110,
        ..camera()
    };
    let cropped = outline(&whole[0].crop(95, 0, 110, 400));
    let whole = outlines(&whole);
    let mut all = views(&whole, camera(), &turns);
    all[0] = CarveView {
        outline: &cropped,
        camera: narrow,
        turn: turns[0],
    };
    let hull = carve(&all, &coarse()).expect("a hull");
    assert_eq!(hull.check(), Ok(()));
    let arm_reach = |mesh: &TriMesh| mesh.bounds().expect("there are vertices").1.x;
    assert!(arm_reach(&expected) > 330.0);
    assert!(arm_reach(&hull) > 0.98 * arm_reach(&expected));
}

#[test]
fn points_outside_all_photos_are_not_part_of_the_hull() {
    let turns = turns(6);
    let silhouettes = render(&body(), &camera(), &turns);
    let low = Camera {
        height_px: 250,
        vertical_fov_radians: 2.0 * (125.0 / camera().focal_px()).atan(),
        ..camera()
    };
    let cropped: Vec<Grid<f32>> = silhouettes
        .iter()
        .map(|s| s.crop(0, 75, 300, 250))
        .collect();
    let hull = carve(&views(&outlines(&cropped), low, &turns), &coarse()).expect("a hull");
    let (_, hi) = hull.bounds().expect("there are vertices");
    assert!((1100.0..1600.0).contains(&hi.y), "{}", hi.y);
    assert_eq!(hull.check(), Ok(()));
}

#[test]
fn invalid_input_is_rejected_with_its_cause() {
    let turns = turns(4);
    let silhouettes = render(&body(), &camera(), &turns);
    let silhouettes = outlines(&silhouettes);
    let sound = views(&silhouettes, camera(), &turns);
    let error = |views: &[CarveView], options: &CarveOptions| {
        carve(views, options).expect_err("the input is invalid")
    };

    assert!(matches!(
        error(&[], &coarse()),
        CarveError::TooFewViews { .. }
    ));
    let blank = outline(&Grid::filled(300, 400, f32::NAN));
    let mut views = sound[..2].to_vec();
    views[1].outline = &blank;
    let few = error(&views, &coarse());
    assert_eq!(
        few.to_string(),
        "1 of 2 silhouettes show a person; carving needs at least 2"
    );

    let mut views = sound.clone();
    views[2].turn = TurnAngle::from_degrees(f64::NAN);
    assert_eq!(error(&views, &coarse()), CarveError::TurnAngle { view: 2 });

    let mut views = sound.clone();
    views[3].camera.distance_mm = -1.0;
    assert!(matches!(
        error(&views, &coarse()),
        CarveError::Camera { view: 3, .. }
    ));

    let mut views = sound.clone();
    views[0].camera.width_px = 301;
    assert!(matches!(
        error(&views, &coarse()),
        CarveError::Size { view: 0, .. }
    ));

    let opposite = [sound[0], sound[2]];
    assert!(matches!(
        error(&opposite, &coarse()),
        CarveError::OneDirection { .. }
    ));

    for misses_to_remove in [0, 5] {
        let options = CarveOptions {
            misses_to_remove,
            ..coarse()
        };
        assert!(matches!(error(&sound, &options), CarveError::Misses { .. }));
    }
    for voxel_size_mm in [0.0, f64::NAN, 1e-9] {
        let options = CarveOptions {
            voxel_size_mm,
            ..coarse()
        };
        assert!(matches!(
            error(&sound, &options),
            CarveError::VoxelSize { .. }
        ));
    }

    // The same silhouette from all sides, but far off the axis: no common point
    let aside = Ellipsoid {
        center: DVec3::new(350.0, 900.0, 0.0),
        radii: DVec3::splat(60.0),
    };
    let one = outlines(&render(&[aside], &camera(), &turns[..1]));
    let mut views = sound;
    for view in &mut views {
        view.outline = &one[0];
    }
    assert_eq!(error(&views, &coarse()), CarveError::Empty);
}

#[test]
fn tiny_photos_are_accepted() {
    let full = outline(&Grid::filled(1, 1, 1.0));
    let tiny = Camera {
        width_px: 1,
        height_px: 1,
        ..camera()
    };
    let turns = turns(3);
    let views: Vec<CarveView> = turns
        .iter()
        .map(|&turn| CarveView {
            outline: &full,
            camera: tiny,
            turn,
        })
        .collect();
    let options = CarveOptions {
        voxel_size_mm: 50.0,
        ..coarse()
    };
    if let Ok(mesh) = carve(&views, &options) {
        assert_eq!(mesh.check(), Ok(()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 32))]

    #[test]
    fn turning_all_angles_turns_the_hull(by in -3.0..3.0f64, x in -200.0..200.0f64, z in -200.0..200.0f64) {
        let turns: Vec<TurnAngle> = turns(5);
        let silhouettes = render(&body(), &camera(), &turns);
        let seen = outlines(&silhouettes);
        let turned: Vec<TurnAngle> = turns
            .iter()
            .map(|t| TurnAngle::from_radians(t.radians() + by))
            .collect();
        let field = HullField::new(&views(&seen, camera(), &turns), 1).expect("a field");
        let other = HullField::new(&views(&seen, camera(), &turned), 1).expect("a field");
        let p = DVec3::new(x, 800.0, z);
        let carried = TurnAngle::from_radians(-by).room_from_world() * p;
        prop_assert!((field.value(p, ViewSet::ALL) - other.value(carried, ViewSet::ALL)).abs() < 1e-6);
    }

    #[test]
    fn near_a_point_a_subset_of_views_gives_the_same_values(
        center in prop::array::uniform3(-1.0..1.0f64),
        offsets in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 20),
        radius in 1.0..150.0f64,
        height_px in prop::sample::select(vec![400_usize, 250]),
    ) {
        // the lower photo cuts the body off
        let camera = Camera {
            height_px,
            vertical_fov_radians: 2.0 * (height_px as f64 / 2.0 / camera().focal_px()).atan(),
            ..camera()
        };
        let turns = turns(7);
        let silhouettes = render(&body(), &camera, &turns);
        let seen = outlines(&silhouettes);
        let field = HullField::new(&views(&seen, camera, &turns), 1).expect("a field");
        let center = DVec3::new(0.0, 900.0, 0.0) + DVec3::from_array(center) * DVec3::new(400.0, 2000.0, 400.0);
        let (value, wide) = (&field).near(center, 2.0 * radius, ViewSet::ALL);
        prop_assert_eq!(value, field.value(center, ViewSet::ALL));
        let (value, part) = (&field).near(center, radius, wide);
        prop_assert_eq!(value, field.value(center, ViewSet::ALL));
        let place = |offset| center + DVec3::from_array(offset).clamp_length_max(1.0) * radius;
        let points: Vec<DVec3> = offsets.into_iter().map(place).collect();
        let mut together = vec![0.0; points.len()];
        (&field).values(&points, part, &mut together);
        for (p, together) in points.into_iter().zip(together) {
            let (few, all) = (field.value(p, part), field.value(p, ViewSet::ALL));
            prop_assert_eq!(few, all, "{:?} at {} near {}", part, p, center);
            prop_assert_eq!(together, all, "{:?} at {} near {}", part, p, center);
            for views in [part, ViewSet::ALL] {
                prop_assert_eq!((&field).is_inside(p, views), all < 0.0, "{:?} at {}", views, p);
            }
        }
    }
}
