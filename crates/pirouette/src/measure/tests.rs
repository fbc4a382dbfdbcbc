use glam::{DMat3, DVec3};
use pirouette_geom::Grid;
use std::f64::consts::TAU;

use super::*;
use crate::avatar::{ReferencePose, TapeLoop};
use crate::camera::Camera;
use crate::pose::SkinWeight;
use crate::skeleton::Joint;
use crate::units::TurnAngle;

/// Segments around a cylinder
const AROUND: u32 = 180;

/// An elliptic cylinder around an axis, with a ring of vertices at its middle
#[derive(Debug, Clone, Copy)]
struct Cylinder {
    middle: DVec3,
    /// Half the cylinder along its axis
    half_axis: DVec3,
    /// Half the extent across, along x and z before the axis is tilted
    radii: [f64; 2],
}

impl Cylinder {
    fn upright(x: f64, z: f64, radii: [f64; 2]) -> Self {
        Self {
            middle: DVec3::new(x, 800.0, z),
            half_axis: DVec3::Y * 800.0,
            radii,
        }
    }

    fn mesh(&self) -> TriMesh {
        let along = self.half_axis / self.half_axis.length();
        let across = along.any_orthonormal_vector();
        let (u, v) = if along.abs_diff_eq(DVec3::Y, 1e-9) {
            (DVec3::X, -DVec3::Z)
        } else {
            (across, along.cross(across))
        };
        let mut mesh = TriMesh::default();
        for level in [-1.0, 0.0, 1.0] {
            for i in 0..AROUND {
                let (sin, cos) = (TAU * f64::from(i) / f64::from(AROUND)).sin_cos();
                let ring = u * (self.radii[0] * cos) + v * (self.radii[1] * sin);
                mesh.positions
                    .push(self.middle + self.half_axis * level + ring);
            }
        }
        let ends = [mesh.positions.len() as u32, mesh.positions.len() as u32 + 1];
        mesh.positions
            .extend([self.middle - self.half_axis, self.middle + self.half_axis]);
        for i in 0..AROUND {
            let j = (i + 1) % AROUND;
            for base in [0, AROUND] {
                let (a, b, c, d) = (base + i, base + j, base + AROUND + i, base + AROUND + j);
                mesh.triangles.extend([[a, b, d], [a, d, c]]);
            }
            mesh.triangles.push([ends[0], j, i]);
            mesh.triangles
                .push([ends[1], 2 * AROUND + i, 2 * AROUND + j]);
        }
        mesh
    }

    /// Length around, by fine steps
    fn girth(&self) -> f64 {
        let point = |i: u32| {
            let (sin, cos) = (TAU * f64::from(i) / 3600.0).sin_cos();
            glam::DVec2::new(self.radii[0] * cos, self.radii[1] * sin)
        };
        (0..3600).map(|i| point(i).distance(point(i + 1))).sum()
    }
}

fn join(parts: &[Cylinder]) -> TriMesh {
    let mut all = TriMesh::default();
    for part in parts {
        let mesh = part.mesh();
        let first = all.positions.len() as u32;
        all.positions.extend(mesh.positions);
        all.triangles
            .extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    all
}

/// A figure of cylinders; the tape of `girth` goes around the first one's middle
fn figure(parts: &[Cylinder], girth: Girth) -> Avatar {
    let mesh = join(parts);
    let mut bone_heads = [DVec3::ZERO; Bone::COUNT];
    bone_heads[Bone::LeftUpperArm as usize] = parts[0].middle - parts[0].half_axis;
    bone_heads[Bone::LeftForearm as usize] = parts[0].middle + parts[0].half_axis;
    Avatar {
        weights: vec![SkinWeight::rigid(Bone::Root); mesh.positions.len()],
        mesh,
        bone_heads,
        keypoints: [DVec3::ZERO; Joint::COUNT],
        tape_loops: vec![TapeLoop {
            girth,
            vertices: (AROUND..2 * AROUND).collect(),
        }],
        landmarks: Vec::new(),
        pose: ReferencePose::A,
    }
}

fn camera() -> Camera {
    Camera {
        width_px: 600,
        height_px: 800,
        vertical_fov_radians: 0.75,
        height_mm: 900.0,
        distance_mm: 2400.0,
        pitch_radians: 0.03,
    }
}

fn render(parts: &[Cylinder], turns: &[f64]) -> Vec<Grid<f32>> {
    let mesh = join(parts);
    turns
        .iter()
        .map(|&degrees| {
            let room_from_world = TurnAngle::from_degrees(degrees).room_from_world();
            let positions: Vec<DVec3> = mesh
                .positions
                .iter()
                .map(|p| room_from_world * *p)
                .collect();
            render::silhouette(&positions, &mesh.triangles, &camera())
        })
        .collect()
}

fn views<'a>(silhouettes: &'a [Grid<f32>], turns: &[f64]) -> Vec<CarveView<'a>> {
    silhouettes
        .iter()
        .zip(turns)
        .map(|(silhouette, &degrees)| CarveView {
            silhouette,
            camera: camera(),
            turn: TurnAngle::from_degrees(degrees),
        })
        .collect()
}

const EIGHT: [f64; 8] = [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0];

fn measured(avatar: &Avatar, silhouettes: &[Grid<f32>], turns: &[f64], of: Measure) -> Measured {
    let views = views(silhouettes, turns);
    let body = TriMesh::default();
    let all = measure(&MeasureInput {
        body: &body,
        avatar,
        fitted: false,
        views: &views,
        stature_mm: None,
    });
    *all.get(of)
}

fn waist(avatar: &Avatar, silhouettes: &[Grid<f32>], turns: &[f64]) -> f64 {
    let waist = measured(avatar, silhouettes, turns, Measure::WaistGirth);
    assert_eq!(waist.method, Method::SupportLines);
    waist.value_mm.expect("the outlines are free")
}

#[test]
fn eight_views_of_an_elliptic_cylinder_give_its_girth() {
    let avatar = figure(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])], Girth::Waist);
    for radii in [[170.0, 120.0], [120.0, 120.0], [190.0, 150.0]] {
        let body = Cylinder::upright(15.0, -20.0, radii);
        let found = waist(&avatar, &render(&[body], &EIGHT), &EIGHT);
        let error = found / body.girth() - 1.0;
        assert!(error.abs() < 0.003, "{error} for {radii:?}");
    }
}

#[test]
fn uneven_turns_give_the_girth_too() {
    let avatar = figure(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])], Girth::Waist);
    let body = Cylinder::upright(10.0, 5.0, [160.0, 115.0]);
    for turns in [
        &[3.0, 41.0, 97.0, 128.0, 186.0, 240.0, 262.0, 325.0][..],
        &[0.0, 72.0, 144.0, 216.0, 288.0],
        &[0.0, 45.0, 90.0, 135.0],
    ] {
        let found = waist(&avatar, &render(&[body], turns), turns);
        let error = found / body.girth() - 1.0;
        assert!(error.abs() < 0.008, "{error} for {turns:?}");
    }
}

#[test]
fn a_silhouette_shifted_sideways_changes_no_girth() {
    let avatar = figure(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])], Girth::Waist);
    let body = Cylinder::upright(0.0, 0.0, [165.0, 120.0]);
    let mut silhouettes = render(&[body], &EIGHT);
    let before = waist(&avatar, &silhouettes, &EIGHT);
    for view in [0, 3, 6] {
        let still = silhouettes[view].clone();
        silhouettes[view] = Grid::from_fn(still.width(), still.height(), |x, y| {
            *still.get(x as isize - 10, y as isize).unwrap_or(&0.0)
        });
        let after = waist(&avatar, &silhouettes, &EIGHT);
        assert!((after - before).abs() < 2.0, "{before} became {after}");
        silhouettes[view] = still;
    }
}

#[test]
fn arms_before_the_trunk_do_not_count_as_trunk() {
    let arms = |reach: f64, radius: f64| {
        [
            Cylinder::upright(reach, 60.0, [radius; 2]),
            Cylinder::upright(-reach, 60.0, [radius; 2]),
        ]
    };
    let [left, right] = arms(290.0, 40.0);
    let trunk = Cylinder::upright(0.0, 0.0, [130.0, 110.0]);
    let avatar = figure(&[trunk, left, right], Girth::Waist);
    let [left, right] = arms(280.0, 45.0);
    let body = Cylinder::upright(0.0, 0.0, [160.0, 115.0]);
    let found = waist(&avatar, &render(&[body, left, right], &EIGHT), &EIGHT);
    let error = found / body.girth() - 1.0;
    assert!(error.abs() < 0.015, "{error}");
}

#[test]
fn an_outline_that_another_limb_hides_is_an_outlier() {
    let avatar = figure(&[Cylinder::upright(0.0, 0.0, [140.0, 110.0])], Girth::Waist);
    let body = Cylinder::upright(0.0, 0.0, [160.0, 115.0]);
    let clean = render(&[body], &EIGHT);
    let mut silhouettes = clean.clone();
    // An arm that the avatar does not have, merged with the trunk in one view
    let arm = Cylinder::upright(190.0, 0.0, [40.0, 40.0]);
    silhouettes[1] = render(&[body, arm], &EIGHT[1..2]).remove(0);
    let expected = waist(&avatar, &clean, &EIGHT);
    let found = waist(&avatar, &silhouettes, &EIGHT);
    assert!(
        (found / expected - 1.0).abs() < 0.01,
        "{found} for {expected}"
    );
}

#[test]
fn a_limb_is_measured_across_its_axis() {
    let arm = |radii| Cylinder {
        middle: DVec3::new(250.0, 1200.0, 0.0),
        half_axis: DVec3::new(120.0, -130.0, 20.0),
        radii,
    };
    let avatar = figure(&[arm([45.0, 45.0])], Girth::LeftUpperArm);
    let body = arm([52.0, 52.0]);
    let found = measured(
        &avatar,
        &render(&[body], &EIGHT),
        &EIGHT,
        Measure::UpperArmGirth,
    );
    let error = found.value_mm.expect("the arm is free") / body.girth() - 1.0;
    assert!(error.abs() < 0.01, "{error}");
    assert_eq!(found.left_mm, found.value_mm.ok());
    assert_eq!(found.right_mm, None);
}

#[test]
fn a_turn_of_all_views_with_body_and_avatar_changes_nothing() {
    let parts = [Cylinder::upright(20.0, 0.0, [150.0, 110.0])];
    let silhouettes = render(&parts, &EIGHT);
    let avatar = figure(&[Cylinder::upright(0.0, 0.0, [130.0, 110.0])], Girth::Waist);
    let before = waist(&avatar, &silhouettes, &EIGHT);
    let by = 25.0;
    let mut turned = avatar.clone();
    let back = DMat3::from_rotation_y(-f64::to_radians(by));
    for p in &mut turned.mesh.positions {
        *p = back * *p;
    }
    let after = waist(&turned, &silhouettes, &EIGHT.map(|t| t + by));
    assert!((after - before).abs() < 0.01, "{before} became {after}");
}

#[test]
fn few_outlines_leave_the_section_of_the_hull() {
    let avatar = figure(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])], Girth::Waist);
    let body = Cylinder::upright(0.0, 0.0, [150.0, 150.0]);
    let all = measure(&MeasureInput {
        body: &body.mesh(),
        avatar: &avatar,
        fitted: false,
        views: &[],
        stature_mm: Some(1723.0),
    });
    let waist = all.get(Measure::WaistGirth);
    assert_eq!(waist.method, Method::HullSection);
    // Without views, the least that can be carved from is assumed: two directions, a square.
    let expected = body.girth() * std::f64::consts::PI / 4.0;
    let found = waist.value_mm.expect("the body has a section");
    assert!(
        (found / expected - 1.0).abs() < 1e-3,
        "{found} for {expected}"
    );
    assert_eq!(all.value_mm(Measure::Stature), Some(1723.0));
}

#[test]
fn what_cannot_be_had_is_null_with_the_reason() {
    let mut avatar = figure(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])], Girth::Waist);
    avatar.mesh.positions[0] = DVec3::NAN;
    let blank = [Grid::filled(600, 800, 0.0)];
    let all = measure(&MeasureInput {
        body: &TriMesh::default(),
        avatar: &avatar,
        fitted: false,
        views: &views(&blank, &[0.0]),
        stature_mm: None,
    });
    let text = serde_json::to_value(&all).expect("measurements are plain data");
    let values = text["measurements_mm"].as_object().expect("an object");
    let keys: Vec<&str> = values.keys().map(String::as_str).collect();
    assert_eq!(keys, Measure::ALL.map(Measure::name));
    assert!(values["waist_girth"].is_null() && values["neck_girth"].is_null());
    let why = |key: &str| text["details"][key]["missing"].as_str().map(str::to_owned);
    assert_eq!(why("stature").as_deref(), Some("the carved body is empty"));
    assert_eq!(
        why("neck_girth").as_deref(),
        Some("the avatar has no tape loop or landmark for it")
    );
    assert!(why("waist_girth").is_some());
}
