//! Surfaces that are not closed, and figures that are no people.

use super::*;

#[test]
fn a_closed_surface_is_unchanged() {
    let mut surface = Surface::default();
    add_box(&mut surface, DVec3::ZERO, DVec3::new(400.0, 1800.0, 300.0));
    assert_eq!(surface.mesh().check(), Ok(()));
    assert!(closed::close(&mut surface).unwrap().is_none());
    assert_eq!(surface.triangles.len(), 12);
}

#[test]
fn an_open_surface_is_replaced_by_its_hull() {
    let mut surface = Surface::default();
    add_box(&mut surface, DVec3::ZERO, DVec3::new(400.0, 1800.0, 300.0));
    let whole = surface.mesh();
    surface.triangles.pop();
    let hull = closed::close(&mut surface).unwrap().unwrap();
    assert_eq!((hull.part_count, hull.open_edge_count), (1, 3));
    let closed = surface.mesh();
    assert_eq!(closed.check(), Ok(()));
    // The surface across the hole is where half of all directions are surrounded.
    assert!((closed.volume() / whole.volume() - 1.0).abs() < 0.2);
    let open = TestBody {
        hole: 1,
        ..TestBody::default()
    };
    let (avatar, hull) = load_avatar_with_hull(&glb(&open), ReferencePose::A).unwrap();
    assert_eq!(avatar.mesh.check(), Ok(()));
    assert!(hull.unwrap().to_string().contains("3 open edges"));
}

#[test]
fn parts_that_do_not_connect_are_rejected() {
    let mut surface = Surface::default();
    let (legs, head) = (
        DVec3::new(400.0, 800.0, 300.0),
        DVec3::new(400.0, 1800.0, 300.0),
    );
    add_box(&mut surface, DVec3::ZERO, legs);
    add_box(&mut surface, DVec3::Y * 1400.0, head);
    let error = closed::close(&mut surface).unwrap_err().to_string();
    assert!(error.contains("2 parts that do not connect"), "{error}");
}

#[test]
fn surfaces_without_limbs_are_rejected() {
    let absent = TestBody {
        absent: Some(Bone::RightForearm),
        ..TestBody::default()
    };
    let wrapped = TestBody {
        wrapped: true,
        ..TestBody::default()
    };
    for (body, missing) in [(absent, "right_forearm"), (wrapped, "left_upper_arm")] {
        let error = load_avatar(&glb(&body), ReferencePose::A).unwrap_err();
        assert!(error.to_string().contains(missing), "{error}");
    }
}

#[test]
fn figures_with_other_proportions_are_rejected() {
    let mut avatar = load(&TestBody::default(), ReferencePose::A);
    avatar.bone_heads[Bone::Head].y = 0.6 * avatar.stature_mm();
    let error = closed::check_person(&avatar).unwrap_err().to_string();
    assert!(
        error.starts_with("height of the neck: 60 % of the height"),
        "{error}"
    );
}
