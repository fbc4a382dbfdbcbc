use glam::{DMat3, DVec3};
use pirouette_body::ReferencePose;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_geom::TriMesh;

use super::orient::upright;
use super::{AxisDirection, MeshScanError, MeshUnit, is_inside_out, without_scraps};

fn person(pose: ReferencePose) -> TriMesh {
    let parameters = MannequinParameters {
        pose,
        ..MannequinParameters::default()
    };
    mannequin(&parameters).unwrap().mesh
}

fn mapped(mesh: &TriMesh, map: impl Fn(DVec3) -> DVec3) -> TriMesh {
    TriMesh {
        positions: mesh.positions.iter().map(|&p| map(p)).collect(),
        triangles: mesh.triangles.clone(),
    }
}

fn largest_difference(a: &TriMesh, b: &TriMesh) -> f64 {
    let pairs = a.positions.iter().zip(&b.positions);
    pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

#[test]
fn any_unit_and_axes_give_the_same_body() {
    for pose in [ReferencePose::A, ReferencePose::T] {
        let mesh = person(pose);
        let expected = upright(&mesh, None, None, None).unwrap();
        let off_mm = largest_difference(&expected, &mesh);
        assert!(
            off_mm < 80.0,
            "{off_mm} mm, mostly the position of the axis"
        );
        let z_up = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
        let x_up_facing_y = DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y);
        let aside = DMat3::from_rotation_y(0.7);
        for rotation in [
            z_up,
            x_up_facing_y,
            aside,
            aside * DMat3::from_rotation_y(2.4),
        ] {
            for unit in [MeshUnit::Inch, MeshUnit::Centimeter, MeshUnit::Meter] {
                let file = mapped(&mesh, |p| {
                    rotation * (p + DVec3::new(300.0, -70.0, 0.0)) / unit.mm()
                });
                let found = upright(&file, None, None, None);
                let found = found.unwrap_or_else(|e| panic!("{pose:?} {unit:?} {rotation}: {e}"));
                let off_mm = largest_difference(&found, &expected);
                assert!(off_mm < 1e-6, "{pose:?} {unit:?} {rotation}: {off_mm} mm");
            }
        }
    }
}

#[test]
fn given_axes_and_units_replace_those_found() {
    let mesh = mapped(&person(ReferencePose::A), |p| p / 1000.0);
    let (up, front) = (Some(AxisDirection::Y), Some(AxisDirection::X));
    let found = upright(&mesh, Some(MeshUnit::Meter), up, front).unwrap();
    let (low, high) = found.bounds().unwrap();
    // The person faced +z, so the arms now stretch from back to front.
    assert!(high.z - low.z > 2.0 * (high.x - low.x), "{low} {high}");
    let wrong = upright(&mesh, Some(MeshUnit::Inch), up, front);
    assert!(matches!(wrong, Err(MeshScanError::Height { height_mm }) if height_mm < 50.0));
    let behind = upright(&mesh, None, up, Some(AxisDirection::NegZ));
    assert_eq!(behind, Err(MeshScanError::FrontContradicted));
    let aside = upright(&mesh, None, up, Some(AxisDirection::NegY));
    assert_eq!(aside, Err(MeshScanError::FrontUnknown));
}

#[test]
fn what_is_no_person_has_no_unit_or_front() {
    let person = person(ReferencePose::A);
    let error = |mesh: &TriMesh| upright(mesh, None, None, None).unwrap_err();
    let hut = mapped(&person, |p| p * 3.0);
    assert!(matches!(error(&hut), MeshScanError::UnitUnknown { .. }));
    let symmetric = mapped(&person, |p| DVec3::new(p.x, p.y, 0.02 * p.z));
    assert_eq!(error(&symmetric), MeshScanError::FrontUnknown);
    assert_eq!(error(&TriMesh::default()), MeshScanError::Empty);
    let flat = mapped(&person, |p| DVec3::new(p.x, 0.0, p.z));
    assert!(upright(&flat, None, None, None).is_err());
    let broken = mapped(&person, |_| DVec3::NAN);
    assert_eq!(error(&broken), MeshScanError::Empty);
}

#[test]
fn scraps_are_left_out_and_parts_face_outward() {
    let mut mesh = person(ReferencePose::A);
    let vertex_count = mesh.positions.len();
    mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let first = mesh.positions.len() as u32;
    let scrap = [DVec3::ZERO, DVec3::X * 90.0, DVec3::Z * 90.0];
    mesh.positions.extend(scrap.map(|p| p - DVec3::Y * 400.0));
    mesh.triangles.push([first, first + 1, first + 2]);
    assert!(is_inside_out(&mesh));
    let cleaned = without_scraps(&mesh);
    assert_eq!(cleaned.positions.len(), vertex_count);
    assert!(!is_inside_out(&cleaned));
}
