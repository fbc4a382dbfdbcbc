use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;

fn tetrahedron(offset: DVec3) -> TriMesh {
    TriMesh {
        positions: [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]
            .map(|p| p + offset)
            .to_vec(),
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
    }
}

/// Concatenates two meshes, with the vertices of the second after those of the first
fn concatenate(a: &TriMesh, b: &TriMesh) -> TriMesh {
    let mut both = a.clone();
    let shift = a.positions.len() as u32;
    both.positions.extend(&b.positions);
    both.triangles
        .extend(b.triangles.iter().map(|t| t.map(|v| v + shift)));
    both
}

#[test]
fn the_center_of_mass_of_a_tetrahedron_is_the_mean_of_its_corners() {
    let offset = DVec3::new(5.0, -2.0, 7.0);
    let found = tetrahedron(offset).center_of_mass().unwrap();
    assert!(found.distance(offset + 0.25) < 1e-9, "{found}");
    assert_eq!(TriMesh::default().center_of_mass(), None);
}

proptest! {
    #[test]
    fn clusters_are_the_means_of_their_cells_and_edges_stay_balanced(
        points in prop::collection::vec(prop::array::uniform3(-3.0..3.0_f64), 4..40),
        corners in prop::collection::vec(prop::array::uniform4(any::<prop::sample::Index>()), 1..20),
    ) {
        // The surfaces of tetrahedra: closed, even if they touch
        let corners = corners.iter().map(|t| t.map(|i| i.index(points.len()) as u32));
        let mesh = TriMesh {
            positions: points.iter().map(|&p| DVec3::from_array(p)).collect(),
            triangles: corners.flat_map(|[a, b, c, d]| [[b, c, d], [a, d, c], [a, b, d], [a, c, b]]).collect(),
        };
        let coarse = mesh.clustered(1.0);
        let mut cells: BTreeMap<[i64; 3], Vec<DVec3>> = BTreeMap::new();
        for &p in &mesh.positions {
            cells.entry(p.floor().to_array().map(|v| v as i64)).or_default().push(p);
        }
        prop_assert_eq!(coarse.positions.len(), cells.len());
        for members in cells.values() {
            let mean = members.iter().sum::<DVec3>() / members.len() as f64;
            prop_assert!(coarse.positions.iter().any(|p| p.distance(mean) < 1e-9));
        }
        let mut balance: BTreeMap<[u32; 2], i32> = BTreeMap::new();
        for (from, to) in coarse.triangles.iter().flat_map(sides) {
            prop_assert!(from != to);
            *balance.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
        }
        prop_assert!(balance.values().all(|&sum| sum == 0));
    }
}

#[test]
fn a_tetrahedron_is_valid() {
    let mesh = tetrahedron(DVec3::new(3.0, -2.0, 5.0));
    assert_eq!(mesh.check(), Ok(()));
    assert!((mesh.volume() - 1.0 / 6.0).abs() < 1e-12);
    assert!((mesh.area() - (1.5 + 3f64.sqrt() / 2.0)).abs() < 1e-12);
    assert_eq!(mesh.edges().len(), 6);
}

#[test]
fn neighbors_lie_across_the_sides() {
    let mesh = tetrahedron(DVec3::ZERO);
    for (t, across) in mesh.neighbors().iter().enumerate() {
        for (k, neighbor) in across.iter().enumerate() {
            let neighbor = neighbor.expect("the mesh is closed") as usize;
            let (from, to) = (mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]);
            assert!(sides(&mesh.triangles[neighbor]).any(|side| side == (to, from)));
        }
    }
}

#[test]
fn every_defect_is_reported() {
    let sound = tetrahedron(DVec3::ZERO);
    assert_eq!(TriMesh::default().check(), Err(MeshDefect::Empty));

    let mut mesh = sound.clone();
    mesh.positions[2].y = f64::NAN;
    assert_eq!(mesh.check(), Err(MeshDefect::NotFinite { vertex: 2 }));

    let mut mesh = sound.clone();
    mesh.triangles[1][2] = 9;
    assert!(matches!(
        mesh.check(),
        Err(MeshDefect::MissingVertex { vertex: 9, .. })
    ));

    let mut mesh = sound.clone();
    mesh.triangles[1] = [0, 1, 1];
    assert!(matches!(
        mesh.check(),
        Err(MeshDefect::RepeatedVertex { .. })
    ));

    let mut mesh = sound.clone();
    mesh.positions.push(DVec3::ONE);
    assert_eq!(mesh.check(), Err(MeshDefect::UnusedVertex { vertex: 4 }));

    let mut mesh = sound.clone();
    mesh.triangles.pop();
    assert!(matches!(mesh.check(), Err(MeshDefect::OpenEdge { .. })));

    let mut mesh = sound.clone();
    mesh.triangles[0].swap(0, 1);
    assert!(matches!(mesh.check(), Err(MeshDefect::CrowdedEdge { .. })));

    let mut mesh = sound.clone();
    for triangle in &mut mesh.triangles {
        triangle.swap(0, 1);
    }
    assert!(matches!(mesh.check(), Err(MeshDefect::InsideOut { .. })));
}

#[test]
fn two_tetrahedra_that_touch_in_one_vertex_are_not_manifold() {
    let mut mesh = concatenate(&tetrahedron(DVec3::ZERO), &tetrahedron(DVec3::X * 5.0));
    for triangle in &mut mesh.triangles {
        *triangle = triangle.map(|v| if v == 4 { 0 } else { v });
    }
    mesh.positions.remove(4);
    for triangle in &mut mesh.triangles {
        *triangle = triangle.map(|v| if v > 4 { v - 1 } else { v });
    }
    assert_eq!(mesh.check(), Err(MeshDefect::TouchingVertex { vertex: 0 }));
}

proptest! {
    #[test]
    fn the_largest_component_is_the_first_one(sizes in prop::collection::vec(0.1..3.0_f64, 1..6), at in any::<prop::sample::Index>()) {
        let mut all = TriMesh::default();
        for (i, size) in sizes.iter().enumerate() {
            let mut one = tetrahedron(DVec3::X * 9.0 * i as f64);
            for p in &mut one.positions {
                *p *= *size;
            }
            all = concatenate(&all, &one);
        }
        // An unused vertex
        all.positions.push(DVec3::ONE);
        let turn = at.index(all.triangles.len());
        all.triangles.rotate_left(turn);
        let first = all.components().into_iter().next().unwrap_or_default();
        prop_assert_eq!(all.largest_component(), first);
    }
}

#[test]
fn the_largest_component_is_kept_completely() {
    let small = tetrahedron(DVec3::ZERO);
    let mut large = tetrahedron(DVec3::ONE);
    for p in &mut large.positions {
        *p *= 3.0;
    }
    let both = concatenate(&small, &large);
    assert_eq!(both.components().len(), 2);
    assert_eq!(both.largest_component(), large);
    assert_eq!(TriMesh::default().largest_component(), TriMesh::default());
}
