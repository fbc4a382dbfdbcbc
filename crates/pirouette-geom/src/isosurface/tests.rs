use super::crossing::MIN_EDGE_PART;
use super::*;
use crate::tri_mesh::MeshDefect;
use proptest::prelude::*;

fn options(cell_size: f64, lipschitz: f64) -> SurfaceOptions {
    SurfaceOptions {
        lo: DVec3::splat(-1.0),
        hi: DVec3::splat(1.0),
        cell_size,
        lipschitz,
        secant_steps: 0,
        thin_pieces: true,
    }
}

/// Marching cubes over every cell of the grid, without shared vertices
fn extract_surface_reference(
    field: impl Fn(DVec3) -> f64 + Sync,
    options: &SurfaceOptions,
) -> Vec<[DVec3; 3]> {
    let grid = Lattice::new(&field, options).expect("the options are valid");
    let mut triangles = Vec::new();
    let [nx, ny, nz] = grid.counts;
    for cell in (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / nx / ny]) {
        let corner = |bits: u32| offset(cell, cube_corner(bits), 1);
        let inside = (0..8)
            .filter(|&bits| grid.value(corner(bits), ()) < 0.0)
            .fold(0, |set, bits| set | 1 << bits);
        let case: &cube_cases::CubeCase = &CASES[inside];
        let point = |edge: u8| {
            let low = u32::from(lower_corner(edge));
            let (p, q) = (corner(low), corner(low | 1 << (edge / 4)));
            let (a, b) = (grid.value(p, ()), grid.value(q, ()));
            let t = (a / (a - b)).clamp(MIN_EDGE_PART, 1.0 - MIN_EDGE_PART);
            grid.position(p).lerp(grid.position(q), t)
        };
        for triangle in &case.triangles {
            triangles.push(triangle.map(|edge| match edge.checked_sub(EDGE_COUNT) {
                Some(k) => {
                    let polygon = &case.centers[usize::from(k)];
                    polygon.iter().map(|&e| point(e)).sum::<DVec3>() / polygon.len() as f64
                }
                None => point(edge),
            }));
        }
    }
    triangles
}

/// Sums of triangle corners in a fixed order, to compare sets of triangles
fn fingerprint(triangles: impl Iterator<Item = [DVec3; 3]>) -> Vec<[i64; 3]> {
    let mut sums: Vec<[i64; 3]> = triangles
        .map(|t| {
            let sum: DVec3 = t.into_iter().sum();
            sum.to_array().map(|v| (v * 1e4).round() as i64)
        })
        .collect();
    sums.sort_unstable();
    sums
}

/// Whether each triple of `found` has one of its own in `expected` that differs by at most 2; both are sorted
///
/// Rounding changes the order of triples whose first numbers are nearly equal, so that pairs by order are not enough.
fn are_near(found: &[[i64; 3]], expected: &[[i64; 3]]) -> bool {
    const NEAR: i64 = 2;
    let mut taken = vec![false; expected.len()];
    found.iter().all(|a| {
        let start = expected.partition_point(|b| b[0] < a[0] - NEAR);
        let end = expected.partition_point(|b| b[0] <= a[0] + NEAR);
        let near = |&i: &usize| !taken[i] && (0..3).all(|k| (a[k] - expected[i][k]).abs() <= NEAR);
        let own = (start..end).find(near);
        own.inspect(|&i| taken[i] = true).is_some()
    })
}

#[test]
fn triples_are_near_in_any_order() {
    let found = [[1, 5, 9], [2, 50, 90], [7, 7, 7]];
    assert!(are_near(&found, &[[1, 51, 89], [3, 6, 8], [8, 7, 6]]));
    assert!(!are_near(&found, &[[1, 51, 89], [3, 8, 8], [8, 7, 6]]));
    assert!(!are_near(&[[1, 1, 1]; 2], &[[1, 1, 1], [4, 4, 4]]));
}

#[test]
fn a_ball_is_round_closed_and_faces_outward() {
    for cell in [0.31, 0.1, 0.043] {
        let ball = extract_surface(|p: DVec3| p.length() - 0.8, &options(cell, 1.0));
        let ball = ball.expect("the options are valid");
        assert_eq!(ball.check(), Ok(()));
        let worst = ball.positions.iter().map(|p| (p.length() - 0.8).abs());
        assert!(worst.fold(0.0, f64::max) < 0.3 * cell * cell);
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.8f64.powi(3);
        assert!((ball.volume() / exact - 1.0).abs() < 2.0 * cell * cell);
    }
}

#[test]
fn only_cells_near_the_surface_are_evaluated() {
    let count = std::sync::atomic::AtomicUsize::new(0);
    let field = |p: DVec3| {
        count.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        p.length() - 0.8
    };
    let mesh = extract_surface(field, &options(0.02, 1.0)).expect("the options are valid");
    let evaluated = count.into_inner();
    // The full grid has a million corners; the ball's surface passes about 20,000 cells.
    assert!(evaluated < 160_000, "{evaluated} evaluations");
    assert!(mesh.triangles.len() > 30_000);
}

#[test]
fn secant_steps_converge_on_a_curved_field() {
    let bent = |p: DVec3| (p.length() / 0.7).powi(4) - 1.0;
    let options = SurfaceOptions {
        secant_steps: 4,
        ..options(0.2, 8.0)
    };
    let mesh = extract_surface(bent, &options).expect("the options are valid");
    for p in &mesh.positions {
        assert!((p.length() - 0.7).abs() < 2e-4, "{}", p.length());
    }
}

#[test]
fn without_thin_pieces_the_thick_ones_are_the_same() {
    // cells of 0.05: blocks of 0.4 have corners at -1, -0.6, -0.2, 0.2, ...
    let ball = |p: DVec3, center: f64, radius: f64| (p - DVec3::splat(center)).length() - radius;
    let large = |p: DVec3| ball(p, 0.2, 0.5);
    let small = |p: DVec3| ball(p, -0.8, 0.12);
    let both = |p: DVec3| large(p).min(small(p));
    let all = options(0.05, 1.0);
    let thick = SurfaceOptions {
        thin_pieces: false,
        ..all
    };
    let extract = |field: &(dyn Fn(DVec3) -> f64 + Sync), options: &SurfaceOptions| {
        extract_surface(field, options).expect("the options are valid")
    };
    let alone = extract(&large, &all);
    assert_eq!(extract(&both, &thick), alone);
    assert!(extract(&both, &all).triangles.len() > alone.triangles.len());
    let lone = extract(&small, &thick);
    assert!(!lone.triangles.is_empty());
    assert_eq!(lone, extract(&small, &all));
}

#[test]
fn a_solid_that_fills_the_box_is_closed_at_its_border() {
    let mesh = extract_surface(|_| -1.0, &options(0.1, 1.0)).expect("the options are valid");
    assert_eq!(mesh.check(), Ok(()));
    assert!((1.8f64.powi(3)..8.0).contains(&mesh.volume()));
}

#[test]
fn fields_of_any_kind_give_closed_meshes_or_none() {
    let fields: [fn(DVec3) -> f64; 5] = [
        |_| f64::NAN,
        |_| 0.0,
        |p| if p.x > 0.1 { f64::NAN } else { -1.0 },
        |p| {
            if p.y > 0.1 {
                f64::INFINITY
            } else {
                f64::NEG_INFINITY
            }
        },
        |p| p.x * 1e-300,
    ];
    for field in fields {
        let mesh = extract_surface(field, &options(0.13, 1.0)).expect("the options are valid");
        if !mesh.triangles.is_empty() {
            assert_eq!(mesh.check(), Ok(()));
        }
    }
}

#[test]
fn invalid_options_are_rejected() {
    let extract = |options| extract_surface(|p: DVec3| p.x, &options);
    assert!(matches!(
        extract(options(0.0, 1.0)),
        Err(SurfaceError::CellSize { .. })
    ));
    assert!(matches!(
        extract(options(0.1, f64::NAN)),
        Err(SurfaceError::Lipschitz { .. })
    ));
    assert!(matches!(
        extract(options(1e-9, 1.0)),
        Err(SurfaceError::Cells { .. })
    ));
    let empty = SurfaceOptions {
        hi: DVec3::splat(-2.0),
        ..options(0.1, 1.0)
    };
    assert!(matches!(extract(empty), Err(SurfaceError::Cells { .. })));
}

/// A random value per cell corner: covers every cube case and every combination of neighboring cubes
fn noise(seed: u64) -> impl Fn(DVec3) -> f64 + Sync {
    move |p: DVec3| {
        let mut state = seed;
        for v in p.to_array() {
            let corner = ((v + 1.0) / 0.125).round() as i64 as u64;
            state = (state ^ corner).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            state ^= state >> 29;
        }
        state as f64 / u64::MAX as f64 - 0.5
    }
}

#[test]
fn noise_of_a_former_failure_gives_closed_meshes() {
    let noise = noise(256_208_189_612_489_748);
    for (lipschitz, thin_pieces) in [(100.0, true), (100.0, false), (0.2, true), (0.2, false)] {
        let options = SurfaceOptions {
            thin_pieces,
            ..options(0.125, lipschitz)
        };
        let mesh = extract_surface(&noise, &options).expect("the options are valid");
        assert_eq!(mesh.check(), Ok(()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 8))]

    #[test]
    fn noise_gives_a_closed_manifold_mesh(seed: u64) {
        for thin_pieces in [true, false] {
            let options = SurfaceOptions { thin_pieces, ..options(0.125, 100.0) };
            let mesh = extract_surface(noise(seed), &options).expect("the options are valid");
            prop_assert_eq!(mesh.check(), Ok(()));
        }
    }

    #[test]
    fn a_wrong_slope_bound_still_gives_closed_meshes(seed: u64) {
        let mesh = extract_surface(noise(seed), &options(0.125, 0.2)).expect("the options are valid");
        // Pieces may be missing, including the outermost, so the sign of the volume is not checked.
        let check = mesh.check();
        let sound = matches!(check, Ok(()) | Err(MeshDefect::Empty | MeshDefect::InsideOut { .. }));
        prop_assert!(sound, "{:?}", check);
    }

    #[test]
    fn the_adaptive_grid_matches_the_full_grid(
        centers in prop::collection::vec(prop::array::uniform3(-0.7..0.7f64), 1..5),
        radius in 0.1..0.4f64,
    ) {
        let balls = |p: DVec3| {
            let distance = |c: &[f64; 3]| (p - DVec3::from_array(*c)).length() - radius;
            centers.iter().map(distance).fold(f64::INFINITY, f64::min)
        };
        let options = options(0.09, 1.0);
        let mesh = extract_surface(balls, &options).expect("the options are valid");
        prop_assert_eq!(mesh.check(), Ok(()));
        let found = fingerprint((0..mesh.triangles.len()).map(|t| mesh.corners(t)));
        let expected = fingerprint(extract_surface_reference(balls, &options).into_iter());
        prop_assert_eq!(found.len(), expected.len());
        prop_assert!(are_near(&found, &expected));
    }
}
