use glam::DVec3;

use super::*;
use crate::tri_mesh::TriMesh;
use proptest::prelude::*;

/// A `columns` x `rows` board of squares, each split in two triangles, with randomly displaced corners
fn board(columns: u32, rows: u32, shake: f64) -> PlanarMesh {
    let positions = (0..=rows)
        .flat_map(|y| (0..=columns).map(move |x| (x, y)))
        .map(|(x, y)| {
            let seed = f64::from(x * 7 + y * 13);
            let shift = DVec2::new((seed * 1.7).sin(), (seed * 2.3).cos());
            DVec2::new(f64::from(x), f64::from(y)) * 10.0 + shift * shake
        })
        .collect();
    let mut triangles = Vec::new();
    for y in 0..rows {
        for x in 0..columns {
            let a = y * (columns + 1) + x;
            let c = a + columns + 1;
            triangles.push([a, a + 1, c + 1]);
            triangles.push([a, c + 1, c]);
        }
    }
    PlanarMesh {
        positions,
        triangles,
    }
}

fn farthest(a: &[DVec2], b: &[DVec2]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(p, q)| p.distance(*q))
        .fold(0.0, |m, d| if d > m || d.is_nan() { d } else { m })
}

/// Slow reference: full matrices, Gaussian elimination, rotations by a search over angles
fn deform_reference(
    mesh: &PlanarMesh,
    constrained: &[u32],
    targets: &[DVec2],
    rounds: usize,
    clamp: bool,
) -> Vec<DVec2> {
    let n = mesh.positions.len();
    let mut w = vec![vec![0.0; n]; n];
    for t in &mesh.triangles {
        for k in 0..3 {
            let [i, j, o] = [0, 1, 2].map(|m| t[(k + m) % 3] as usize);
            let (u, v) = (
                mesh.positions[i] - mesh.positions[o],
                mesh.positions[j] - mesh.positions[o],
            );
            let half_cot = 0.5 / u.angle_to(v).abs().tan();
            w[i][j] += half_cot;
            w[j][i] += half_cot;
        }
    }
    for w in w.iter_mut().flatten().filter(|w| clamp && **w < 0.0) {
        *w = 1e-6;
    }
    let mut p = mesh.positions.clone();
    let fixed = |v: usize| constrained.iter().position(|&c| c as usize == v);
    for (&c, &t) in constrained.iter().zip(targets) {
        p[c as usize] = t;
    }
    for _ in 0..rounds {
        let angles: Vec<f64> = (0..n)
            .map(|i| {
                let (mut sin, mut cos) = (0.0, 0.0);
                for j in 0..n {
                    let e = mesh.positions[i] - mesh.positions[j];
                    let d = p[i] - p[j];
                    cos += w[i][j] * e.dot(d);
                    sin += w[i][j] * (e.x * d.y - e.y * d.x);
                }
                f64::atan2(sin, cos)
            })
            .collect();
        // rows: weights, then right-hand side x and y
        let mut system = vec![vec![0.0; n + 2]; n];
        for i in 0..n {
            if let Some(k) = fixed(i) {
                system[i][i] = 1.0;
                (system[i][n], system[i][n + 1]) = (targets[k].x, targets[k].y);
                continue;
            }
            for j in 0..n {
                system[i][i] += w[i][j];
                system[i][j] -= w[i][j];
                let e = mesh.positions[i] - mesh.positions[j];
                for angle in [angles[i], angles[j]] {
                    let turned = DVec2::from_angle(angle).rotate(e) * (w[i][j] / 2.0);
                    system[i][n] += turned.x;
                    system[i][n + 1] += turned.y;
                }
            }
        }
        for k in 0..n {
            let pivot = (k..n)
                .max_by(|&a, &b| system[a][k].abs().total_cmp(&system[b][k].abs()))
                .unwrap();
            system.swap(k, pivot);
            let row = system[k].clone();
            for (i, other) in system.iter_mut().enumerate() {
                if i != k {
                    let factor = other[k] / row[k];
                    for (o, r) in other.iter_mut().zip(&row) {
                        *o -= factor * r;
                    }
                }
            }
        }
        p = (0..n)
            .map(|i| DVec2::new(system[i][n], system[i][n + 1]) / system[i][i])
            .collect();
    }
    p
}

#[test]
fn rest_targets_give_the_rest_mesh() {
    let mesh = board(5, 4, 2.0);
    let constrained = [0, 7, 20];
    let targets = constrained.map(|v| mesh.positions[v as usize]);
    let solver = ArapSolver::new(&mesh, &constrained).unwrap();
    for start in [ArapStart::Rest, ArapStart::Rigid] {
        let options = ArapOptions {
            start,
            ..Default::default()
        };
        let deformed = solver.deform(&targets, &options);
        assert!(farthest(&deformed.positions, &mesh.positions) < 1e-10);
        assert!(deformed.converged && deformed.energy < 1e-18);
    }
}

#[test]
fn sheared_handles_bend_the_board_as_the_reference_does() {
    let mesh = board(6, 3, 2.5);
    let constrained = [0, 7, 14, 21, 6, 13, 20, 27];
    let targets: Vec<DVec2> = constrained
        .iter()
        .map(|&v| mesh.positions[v as usize])
        .map(|p| {
            if p.x < 30.0 {
                p
            } else {
                DVec2::new(40.0, 25.0) + DVec2::from_angle(1.0).rotate(p - DVec2::new(60.0, 0.0))
            }
        })
        .collect();
    let options = ArapOptions {
        rounds: 12,
        tolerance: 0.0,
        start: ArapStart::Rest,
    };
    let mut results = Vec::new();
    for weights in [ArapWeights::NonNegative, ArapWeights::Cotangent] {
        let solver = ArapSolver::with_weights(&mesh, &constrained, weights).unwrap();
        let fast = solver.deform(&targets, &options);
        let clamp = weights == ArapWeights::NonNegative;
        let slow = deform_reference(&mesh, &constrained, &targets, 12, clamp);
        assert_eq!(fast.rounds, 12);
        assert!(farthest(&fast.positions, &slow) < 1e-9);
        results.push(fast.positions);
    }
    assert!(farthest(&results[0], &results[1]) > 1e-3);
}

#[test]
fn a_thin_boundary_triangle_does_not_turn_around() {
    // the angle opposite its long side is 150 degrees
    let mesh = PlanarMesh {
        positions: [(0., 0.), (10., 0.), (10., 10.), (0., 10.), (5., 11.34)]
            .map(|(x, y)| DVec2::new(x, y))
            .to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3], [3, 2, 4]],
    };
    for weights in [ArapWeights::NonNegative, ArapWeights::Cotangent] {
        let solver = ArapSolver::with_weights(&mesh, &[0, 1], weights).unwrap();
        let deformed = solver.deform(&mesh.positions[..2], &ArapOptions::default());
        assert!(farthest(&deformed.positions, &mesh.positions) < 1e-9);
        let upright = deformed.rotations.iter().all(|r| r.x > 0.999);
        assert!(upright && deformed.energy.abs() < 1e-12);
    }
}

#[test]
fn energy_never_increases() {
    let mesh = board(6, 3, 2.5);
    let solver = ArapSolver::new(&mesh, &[0, 3, 27]).unwrap();
    let targets = [
        DVec2::new(5.0, -20.0),
        DVec2::new(30.0, 30.0),
        DVec2::new(10.0, 60.0),
    ];
    let energies: Vec<f64> = (0..15)
        .map(|rounds| {
            let options = ArapOptions {
                rounds,
                tolerance: 0.0,
                start: ArapStart::Rest,
            };
            solver.deform(&targets, &options).energy
        })
        .collect();
    assert!(energies.windows(2).all(|e| e[1] <= e[0] + 1e-9));
}

#[test]
fn parts_without_handles_are_fixed_and_parts_with_one_are_translated() {
    let mut mesh = board(2, 2, 1.0);
    let first = mesh.positions.len();
    for _ in 0..2 {
        let other = board(2, 2, 1.0);
        let start = mesh.positions.len() as u32;
        mesh.positions.extend(other.positions);
        mesh.triangles
            .extend(other.triangles.iter().map(|t| t.map(|v| v + start)));
    }
    let shift = DVec2::new(30.0, -8.0);
    let target = mesh.positions[4] + shift;
    let solver = ArapSolver::new(&mesh, &[4]).unwrap();
    let deformed = solver.deform(&[target], &ArapOptions::default());
    let expected: Vec<DVec2> = mesh
        .positions
        .iter()
        .enumerate()
        .map(|(v, &p)| if v < first { p + shift } else { p })
        .collect();
    assert!(farthest(&deformed.positions, &expected) < 1e-9);
    assert!(deformed.positions[first..] == mesh.positions[first..]);
}

#[test]
fn degenerate_triangles_and_isolated_vertices_are_handled() {
    let mut mesh = board(3, 2, 0.0);
    let flat = mesh.positions.len() as u32;
    mesh.positions.push(DVec2::new(5.0, 0.0));
    mesh.positions.push(DVec2::new(90.0, 90.0));
    mesh.triangles.push([0, flat, 1]);
    mesh.triangles.push([2, 2, 3]);
    let solver = ArapSolver::new(&mesh, &[0, 11]).unwrap();
    let targets = [DVec2::new(0.0, 0.0), DVec2::new(31.0, 25.0)];
    let deformed = solver.deform(&targets, &ArapOptions::default());
    assert!(deformed.positions.iter().all(|p| p.is_finite()));
    assert!(deformed.positions[flat as usize].distance(DVec2::new(5.0, 0.0)) < 5.0);
}

#[test]
fn invalid_input_is_reported() {
    let mesh = board(1, 1, 0.0);
    let missing = ArapError::MissingVertex {
        vertex: 4,
        vertex_count: 4,
    };
    assert_eq!(ArapSolver::new(&mesh, &[4]).err(), Some(missing));
    let twice = ArapError::ConstrainedTwice { vertex: 1 };
    assert_eq!(ArapSolver::new(&mesh, &[1, 0, 1]).err(), Some(twice));
    let mut poisoned = mesh.clone();
    poisoned.positions[2].x = f64::NAN;
    let poisoned = ArapSolver::new(&poisoned, &[0]);
    assert_eq!(poisoned.err(), Some(ArapError::NotFinite));
    let empty = ArapSolver::new(&PlanarMesh::default(), &[]).unwrap();
    let nothing = empty.deform(&[], &ArapOptions::default());
    assert!(nothing.positions.is_empty());
}

#[test]
fn points_snap_to_the_nearest_vertex_and_keep_z() {
    let flat = board(2, 2, 0.0);
    let mesh = TriMesh {
        positions: flat.positions.iter().map(|p| p.extend(p.x / 2.0)).collect(),
        triangles: flat.triangles,
    };
    let sources = [DVec2::new(1.0, -1.0), DVec2::new(-1.0, 1.0)];
    let targets = [DVec2::new(6.0, 6.0); 2];
    let deformed = deform_points(&mesh, &sources, &targets, &ArapOptions::default()).unwrap();
    for (p, q) in mesh.positions.iter().zip(&deformed.positions) {
        assert!((*p + DVec3::new(6.0, 6.0, 0.0) - *q).length() < 1e-9);
    }
    let options = ArapOptions::default();
    let none = deform_points(&TriMesh::default(), &sources, &targets, &options);
    assert_eq!(none.err(), Some(ArapError::EmptyMesh));
    let uneven = deform_points(&mesh, &sources, &targets[..1], &options);
    assert!(matches!(uneven, Err(ArapError::UnequalCounts { .. })));
    let untouched = deform_points(&mesh, &[], &[], &options).unwrap();
    assert_eq!(untouched, mesh);
    let apart = [targets[0], DVec2::new(9.0, 6.0)];
    let shared = deform_points(&mesh, &sources, &apart, &options);
    let expected = ArapError::SharedVertex {
        first: 1,
        second: 2,
        vertex: 0,
    };
    assert_eq!(shared.err(), Some(expected));
}

#[test]
fn points_far_from_the_mesh_are_rejected() {
    let flat = board(2, 2, 0.0);
    let mesh = TriMesh {
        positions: flat.positions.iter().map(|p| p.extend(3.0)).collect(),
        triangles: flat.triangles,
    };
    let corner = flat.positions[0];
    let sources = [corner, corner - DVec2::new(500.0, 0.0)];
    let far = deform_points(&mesh, &sources, &sources, &ArapOptions::default());
    assert!(
        matches!(far, Err(ArapError::FarSource { point: 2, distance, .. }) if distance == 500.0),
        "{far:?}"
    );
}

#[test]
fn meshes_in_other_planes_are_rejected() {
    let flat = board(2, 2, 0.0);
    let mesh = |place: fn(DVec2) -> DVec3| TriMesh {
        positions: flat.positions.iter().map(|&p| place(p)).collect(),
        triangles: flat.triangles.clone(),
    };
    let deform = |mesh: &TriMesh| deform_points(mesh, &[], &[], &ArapOptions::default());
    assert!(deform(&mesh(|p| p.extend(-7.0))).is_ok());
    for (placed, name) in [
        (mesh(|p| DVec3::new(p.x, 0.0, p.y)), "in the xz plane"),
        (mesh(|p| DVec3::new(0.0, p.x, p.y)), "in the yz plane"),
        (
            mesh(|p| DVec3::new(p.x, p.y, 3.0 * p.x + 3.0 * p.y)),
            "inclined or curved",
        ),
    ] {
        let expected = ArapError::NotInPlane { plane: name };
        assert_eq!(deform(&placed).err(), Some(expected));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]
    #[test]
    fn a_rigid_motion_of_the_handles_moves_the_mesh_rigidly(
        turn in -3.1..3.1f64,
        shift in prop::array::uniform2(-300.0..300.0f64),
        handles in prop::collection::btree_set(0u32..20, 2..8),
    ) {
        let mesh = board(4, 3, 2.0);
        let motion = |p: DVec2| DVec2::from_angle(turn).rotate(p) + DVec2::from_array(shift);
        let constrained: Vec<u32> = handles.into_iter().collect();
        let targets: Vec<DVec2> =
            constrained.iter().map(|&v| motion(mesh.positions[v as usize])).collect();
        let solver = ArapSolver::new(&mesh, &constrained).unwrap();
        let deformed = solver.deform(&targets, &ArapOptions::default());
        let expected: Vec<DVec2> = mesh.positions.iter().map(|&p| motion(p)).collect();
        prop_assert!(farthest(&deformed.positions, &expected) < 1e-8);
        prop_assert!(deformed.rotations.iter().all(|r| r.distance(DVec2::from_angle(turn)) < 1e-9));
    }
}
