use super::*;
use crate::contour::nearest_on_segment;
use proptest::prelude::*;

fn contour(points: &[[f64; 2]]) -> Contour {
    Contour {
        points: points.iter().map(|&p| DVec2::from_array(p)).collect(),
        hole: false,
    }
}

fn rectangle(x0: f64, y0: f64, x1: f64, y1: f64) -> Contour {
    contour(&[[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
}

fn hole(mut outer: Contour) -> Contour {
    outer.points.reverse();
    outer.hole = true;
    outer
}

const COARSE: TriangulateOptions = TriangulateOptions {
    max_area: None,
    clearance: 0.1,
};

fn meshed(contours: &[Contour], interior: &[DVec2]) -> PlanarTriangulation {
    let made = triangulate(contours, interior, &COARSE).unwrap();
    made.mesh.check().unwrap();
    made
}

/// Slow reference: follows all loops and sums turns around the point
fn winding_reference(contours: &[Contour], p: DVec2) -> i32 {
    let mut angle = 0.0;
    for contour in contours {
        for (i, &a) in contour.points.iter().enumerate() {
            let b = contour.points[(i + 1) % contour.points.len()];
            let (a, b) = (a - p, b - p);
            angle += a.perp_dot(b).atan2(a.dot(b));
        }
    }
    (angle / std::f64::consts::TAU).round() as i32
}

fn covers(mesh: &PlanarMesh, p: DVec2) -> bool {
    mesh.triangles.iter().any(|t| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        (b - a).perp_dot(p - a) >= 0.0
            && (c - b).perp_dot(p - b) >= 0.0
            && (a - c).perp_dot(p - c) >= 0.0
    })
}

#[test]
fn a_square_gives_two_triangles() {
    let made = meshed(&[rectangle(0.0, 0.0, 2.0, 3.0)], &[]);
    assert_eq!(made.mesh.triangles.len(), 2);
    assert!((made.mesh.area() - 6.0).abs() < 1e-12);
    assert_eq!(made.mesh.boundary_edges().len(), 4);
    let corners = made.contour_vertices[0].iter().map(|v| v.unwrap() as usize);
    let corners: Vec<DVec2> = corners.map(|v| made.mesh.positions[v]).collect();
    assert_eq!(corners, rectangle(0.0, 0.0, 2.0, 3.0).points);
}

#[test]
fn holes_stay_open_and_their_boundary_runs_backward() {
    let ring = [
        rectangle(0.0, 0.0, 6.0, 6.0),
        hole(rectangle(2.0, 2.0, 4.0, 4.0)),
    ];
    let mesh = meshed(&ring, &[]).mesh;
    assert!((mesh.area() - 32.0).abs() < 1e-12);
    let enclosed: f64 = mesh
        .boundary_edges()
        .iter()
        .map(|e| e.map(|v| mesh.positions[v as usize]))
        .map(|[a, b]| a.perp_dot(b) / 2.0)
        .sum();
    assert!((enclosed - 32.0).abs() < 1e-12);
}

#[test]
fn interior_points_become_vertices_unless_outside() {
    let points = [
        DVec2::new(1.0, 1.0),
        DVec2::new(1.0, 1.0),
        DVec2::new(1.02, 1.0),
        DVec2::new(3.0, 0.0),
        DVec2::new(0.0, 0.0),
        DVec2::new(-1.0, 2.0),
        DVec2::new(3.0, 3.05),
        DVec2::new(5.0, 5.0),
    ];
    let ring = [
        rectangle(0.0, 0.0, 6.0, 6.0),
        hole(rectangle(2.0, 3.0, 4.0, 4.0)),
    ];
    let made = meshed(&ring, &points);
    let placed = &made.interior_vertices;
    assert!(placed[0].is_some());
    assert_eq!((placed[1], placed[2]), (placed[0], placed[0]));
    assert_eq!(placed[3..7], [None; 4]);
    let last = made.mesh.positions[placed[7].unwrap() as usize];
    assert!((last - points[7]).length() < 1e-12);
}

#[test]
fn squares_touching_in_a_corner_or_along_a_bridge_are_both_meshed() {
    let corner = contour(&[
        [0.0, 0.0],
        [2.0, 0.0],
        [2.0, 2.0],
        [4.0, 2.0],
        [4.0, 4.0],
        [2.0, 4.0],
        [2.0, 2.0],
        [0.0, 2.0],
    ]);
    assert!((meshed(&[corner], &[]).mesh.area() - 8.0).abs() < 1e-12);
    let bridge = contour(&[
        [0.0, 0.0],
        [2.0, 0.0],
        [2.0, 1.0],
        [5.0, 1.0],
        [5.0, 0.0],
        [7.0, 0.0],
        [7.0, 2.0],
        [5.0, 2.0],
        [5.0, 1.0],
        [2.0, 1.0],
        [2.0, 2.0],
        [0.0, 2.0],
    ]);
    let made = meshed(&[bridge], &[DVec2::new(3.0, 1.0)]);
    assert!((made.mesh.area() - 8.0).abs() < 1e-12);
    assert_eq!(made.interior_vertices, [None]);
}

#[test]
fn contours_without_area_or_with_nan_are_rejected() {
    let lines = [
        contour(&[]),
        contour(&[[1.0, 1.0]]),
        contour(&[[1.0, 1.0], [5.0, 2.0]]),
        contour(&[[1.0, 1.0], [5.0, 2.0], [3.0, 1.5]]),
    ];
    for line in lines {
        let made = triangulate(&[line], &[], &TriangulateOptions::default());
        assert_eq!(made.err(), Some(TriangulateError::NoArea));
    }
    let none = triangulate(&[], &[DVec2::ONE], &COARSE);
    assert_eq!(none.err(), Some(TriangulateError::NoArea));
    for bad in [f64::NAN, f64::INFINITY, 1e9] {
        let square = rectangle(0.0, 0.0, 2.0, bad);
        let made = triangulate(&[square], &[], &COARSE);
        assert!(matches!(made, Err(TriangulateError::BadCoordinate { .. })));
        let square = rectangle(0.0, 0.0, 2.0, 2.0);
        let made = triangulate(&[square], &[DVec2::new(bad, 0.0)], &COARSE);
        assert!(matches!(made, Err(TriangulateError::BadCoordinate { .. })));
    }
}

#[test]
fn filling_gives_well_shaped_triangles_near_the_requested_area() {
    let disc = contour(
        &(0..40)
            .map(|i| DVec2::from_angle(f64::from(i) * std::f64::consts::TAU / 40.0) * 100.0)
            .map(|p| p.to_array())
            .collect::<Vec<_>>(),
    );
    let exact: f64 = 40.0 / 2.0 * 1e4 * (std::f64::consts::TAU / 40.0).sin();
    let made = triangulate(&[disc], &[DVec2::ZERO], &TriangulateOptions::default()).unwrap();
    let mesh = &made.mesh;
    mesh.check().unwrap();
    assert!((mesh.area() / exact - 1.0).abs() < 1e-5);
    let areas: Vec<f64> = (0..mesh.triangles.len())
        .map(|t| mesh.triangle_area(t))
        .collect();
    assert!(areas.iter().all(|&a| a < 400.0));
    assert!(areas.len() > 150);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
        for (p, q, r) in [(a, b, c), (b, c, a), (c, a, b)] {
            assert!((q - p).angle_to(r - p).to_degrees() > 20.0);
        }
    }
}

fn loops(size: i32) -> impl Strategy<Value = Vec<Contour>> {
    // integer coordinates on a small board touch, overlap and cross frequently
    let point = (0..size, 0..size).prop_map(|(x, y)| DVec2::new(f64::from(x), f64::from(y)));
    let one = prop::collection::vec(point, 0..14).prop_map(|points| Contour {
        points,
        hole: false,
    });
    prop::collection::vec(one, 1..4)
}

proptest! {
    #[test]
    fn any_loops_are_meshed_exactly_where_their_winding_is_nonzero(
        contours in loops(9),
        interior in prop::collection::vec(prop::array::uniform2(-1.0..10.0), 0..12),
        filled in any::<bool>(),
    ) {
        let options = TriangulateOptions { max_area: filled.then_some(2.0), ..COARSE };
        let interior: Vec<DVec2> = interior.into_iter().map(DVec2::from_array).collect();
        let made = triangulate(&contours, &interior, &options);
        let empty = PlanarMesh::default();
        let mesh = made.as_ref().map_or(&empty, |m| &m.mesh);
        if let Err(error) = &made {
            prop_assert_eq!(*error, TriangulateError::NoArea);
        }
        prop_assert_eq!(mesh.check(), Ok(()));
        for i in 0..600 {
            let p = DVec2::new(f64::from(i % 25) * 0.4 - 0.517, f64::from(i / 25) * 0.4 - 0.53);
            let at_edge = contours.iter().any(|c| {
                let next = c.points.iter().cycle().skip(1);
                c.points.iter().zip(next).any(|(&a, &b)| p.distance(nearest_on_segment(p, a, b)) < 0.02)
            });
            if !at_edge {
                prop_assert_eq!(covers(mesh, p), winding_reference(&contours, p) != 0, "{}", p);
            }
        }
        if let Ok(made) = &made {
            for (p, v) in interior.iter().zip(&made.interior_vertices) {
                if let Some(v) = v {
                    prop_assert!(mesh.positions[*v as usize].distance(*p) < 0.11);
                }
            }
        }
    }

    #[test]
    fn extreme_coordinates_never_panic(
        points in prop::collection::vec(prop::array::uniform2(-131_072.0..131_072.0f64), 0..9),
    ) {
        let contour = contour(&points);
        if let Ok(made) = triangulate(&[contour], &[DVec2::ZERO], &COARSE) {
            prop_assert_eq!(made.mesh.check(), Ok(()));
        }
    }
}
