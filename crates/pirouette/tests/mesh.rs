//! Meshes of people are measured like the people.

use glam::{DMat3, DVec3};
use pirouette::measure::{Basis, measure_avatar};
use pirouette::mesh_scan::{MeshScanOptions, scan_of_mesh};
use pirouette::pipeline::{CancelToken, Config, Goal, Method, Refusal, Report, Suspect, run};
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Avatar, Bone, Pose, Sex, TurnAngle};
use pirouette_geom::TriMesh;

fn measure_mesh(mesh: &TriMesh) -> Report {
    let options = MeshScanOptions::default();
    let scan = scan_of_mesh(mesh, &options, &|| false).expect("axes and unit are found");
    let config = Config::new(Goal::Measure, Method::Fit);
    run(&scan, &config, &CancelToken::default(), &mut |_| {}).expect("a body is found")
}

/// A woman with hanging arms
fn woman() -> (Avatar, TriMesh) {
    let avatar = mannequin(&MannequinParameters {
        sex: Sex::Female,
        stature_mm: Some(1650.0),
        mass_kg: Some(72.0),
        ..MannequinParameters::default()
    })
    .expect("a usual woman");
    let mut pose = Pose::default();
    pose.rotations[Bone::LeftUpperArm] = DVec3::new(0.05, 0.0, -0.35);
    pose.rotations[Bone::RightUpperArm] = DVec3::new(-0.05, 0.0, 0.3);
    let positions = avatar.posed(&pose, TurnAngle::default()).positions;
    let mesh = TriMesh {
        positions,
        triangles: avatar.mesh.triangles.clone(),
    };
    (avatar, mesh)
}

#[test]
fn a_mesh_with_a_hole_in_other_axes_and_units_has_the_measures_of_the_person() {
    let (avatar, mut mesh) = woman();
    let hole = DVec3::new(60.0, 1000.0, 120.0);
    let corner = |t: &[u32; 3]| mesh.positions[t[0] as usize];
    let kept = mesh
        .triangles
        .iter()
        .filter(|t| corner(t).distance(hole) > 40.0);
    let kept: Vec<[u32; 3]> = kept.copied().collect();
    assert!(kept.len() < mesh.triangles.len());
    mesh.triangles = kept;
    // z up, facing -y, in meters
    let file_from_world = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
    for p in &mut mesh.positions {
        *p = file_from_world * *p / 1000.0;
    }
    let report = measure_mesh(&mesh);
    let measurements = report.measurements.expect("it is a person");
    for (measure, truth_mm) in measure_avatar(&avatar) {
        let found = measurements.get(measure);
        let (found_mm, sd_mm) = (found.value_mm.unwrap(), found.sd_mm.unwrap());
        let off_mm = (found_mm - truth_mm).abs();
        assert!(
            off_mm <= 3.0 * sd_mm.max(1.0),
            "{measure:?}: {found_mm} ± {sd_mm} instead of {truth_mm}"
        );
        if measure.basis() == Basis::Skin {
            assert!(
                off_mm < 12.0,
                "{measure:?}: {found_mm} instead of {truth_mm}"
            );
        }
    }
}

#[test]
fn what_is_no_person_is_refused() {
    let (_, mesh) = woman();
    // Of a person's height, but as wide as a barrel
    let barrel = TriMesh {
        positions: mesh
            .positions
            .iter()
            .map(|p| *p * DVec3::new(2.4, 1.0, 2.4))
            .collect(),
        triangles: mesh.triangles,
    };
    let refusal = measure_mesh(&barrel).refusal;
    let expected = |refusal: &Refusal| {
        matches!(
            refusal,
            Refusal::NoMatch {
                suspect: Suspect::Mesh,
                ..
            }
        )
    };
    assert!(refusal.as_ref().is_some_and(expected), "{refusal:?}");
}
