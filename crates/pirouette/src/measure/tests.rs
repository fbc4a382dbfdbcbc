use std::f64::consts::TAU;

mod deviations;

use glam::{DMat3, DVec3};
use pirouette_geom::{Grid, TriMesh};
use proptest::prelude::*;

use super::support::{find_lines, fit_girth};
use super::tape::Tape;
use super::*;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Bone, PerBone, PerJoint, ReferencePose, Sex, SkinWeight, render};

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

    /// Length around, by small steps
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

/// An avatar of cylinders
fn avatar(parts: &[Cylinder]) -> Avatar {
    let mesh = join(parts);
    Avatar {
        weights: vec![SkinWeight::rigid(Bone::Root); mesh.positions.len()],
        mesh,
        bone_heads: PerBone::splat(DVec3::ZERO),
        keypoints: PerJoint::splat(DVec3::ZERO),
        pose: ReferencePose::A,
    }
}

/// The tape around the middle of the first cylinder of an avatar
fn tape(avatar: &Avatar, axis: DVec3) -> Tape {
    let ring = (AROUND..2 * AROUND).map(|v| avatar.mesh.positions[v as usize]);
    let points: Vec<DVec3> = ring.collect();
    let root = SkinWeight::rigid(Bone::Root);
    let carriers = points.iter().map(|&p| (p, root)).collect();
    Tape::new(&points, axis, carriers).expect("the ring has a nonzero area")
}

fn camera() -> Camera {
    Camera {
        width_px: 600,
        height_px: 800,
        vertical_fov_radians: 0.75,
        height_mm: 900.0,
        distance_mm: 2400.0,
        pitch_radians: 0.03,
        yaw_radians: 0.0,
        distortion: 0.0,
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

const EIGHT: [f64; 8] = [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0];

fn even(count: usize) -> Vec<f64> {
    (0..count)
        .map(|i| 360.0 * i as f64 / count as f64)
        .collect()
}

fn outline(silhouette: &Grid<f32>) -> OutlineMap {
    OutlineMap::new(silhouette, OutlineMap::NEAR_PX)
}

fn outlines(silhouettes: &[Grid<f32>]) -> Vec<OutlineMap> {
    silhouettes.iter().map(outline).collect()
}

/// Silhouettes seen by cameras of an avatar at these angles in these poses
fn seen<'a>(
    avatar: &Avatar,
    outlines: &'a [OutlineMap],
    camera: Camera,
    poses: impl IntoIterator<Item = (f64, Pose)>,
) -> Vec<SeenView<'a>> {
    let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
    let views = outlines.iter().zip(poses);
    views
        .map(|(outline, (degrees, pose))| MeasureView {
            outline,
            camera,
            turn: TurnAngle::from_degrees(degrees),
            pose,
        })
        .map(|view| see(avatar, &mesh, &view))
        .collect()
}

/// The same in the reference pose
fn still(turns: &[f64]) -> impl Iterator<Item = (f64, Pose)> {
    turns.iter().map(|&degrees| (degrees, Pose::default()))
}

/// Girth of the first part by lines alone
fn around(avatar: &Avatar, axis: DVec3, silhouettes: &[Grid<f32>], turns: &[f64]) -> f64 {
    let outlines = outlines(silhouettes);
    let views = seen(avatar, &outlines, camera(), still(turns));
    let tape = tape(avatar, axis);
    let fitted = fit_girth(&tape, &find_lines(&tape, &views), views.len());
    fitted.expect("the outlines are free").girth_mm
}

fn waist(avatar: &Avatar, silhouettes: &[Grid<f32>], turns: &[f64]) -> f64 {
    around(avatar, DVec3::Y, silhouettes, turns)
}

/// Shifts a silhouette by complete pixels
fn shifted(silhouette: &Grid<f32>, by: isize) -> Grid<f32> {
    Grid::from_fn(silhouette.width(), silhouette.height(), |x, y| {
        *silhouette.get(x as isize - by, y as isize).unwrap_or(&0.0)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 32))]

    #[test]
    fn an_elliptic_cylinder_has_its_girth(
        breadth in 110.0..190.0f64,
        flatness in 0.66..1.0f64,
        x in -20.0..20.0f64,
        z in -20.0..20.0f64,
    ) {
        // Outlines nearer than half of the avatar's are those of other parts.
        prop_assume!(breadth * flatness - z.abs() > 60.0);
        let avatar = avatar(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])]);
        let body = Cylinder::upright(x, z, [breadth, breadth * flatness]);
        for (count, limit) in [(8, 0.003), (9, 0.0015)] {
            let turns = even(count);
            let found = waist(&avatar, &render(&[body], &turns), &turns);
            let error = found / body.girth() - 1.0;
            println!("ERR {count} {:.6} {breadth:.1} {flatness:.3} {x:.1} {z:.1}", error);
            prop_assert!(error.abs() < limit * 300.0, "{} from {} views", error, count);
        }
    }

    #[test]
    fn a_silhouette_shifted_sideways_changes_no_girth(
        breadth in 120.0..180.0f64,
        flatness in 0.66..1.0f64,
        view in 0..8usize,
        by in prop::sample::select(vec![-10isize, 10]),
    ) {
        let avatar = avatar(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])]);
        let body = Cylinder::upright(0.0, 0.0, [breadth, breadth * flatness]);
        let mut silhouettes = render(&[body], &EIGHT);
        let before = waist(&avatar, &silhouettes, &EIGHT);
        silhouettes[view] = shifted(&silhouettes[view], by);
        let after = waist(&avatar, &silhouettes, &EIGHT);
        prop_assert!((after - before).abs() < 2.0, "{} became {}", before, after);
    }
}

#[test]
fn a_side_nearer_than_half_of_the_avatars_is_left_to_the_other_lines() {
    let avatar = avatar(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])]);
    let body = Cylinder::upright(0.0, 19.08, [110.0, 72.6]);
    let found = waist(&avatar, &render(&[body], &EIGHT), &EIGHT);
    let error = found / body.girth() - 1.0;
    assert!(error.abs() < 0.015, "{error}");
}

#[test]
fn unevenly_spread_turns_give_the_same_girth() {
    let avatar = avatar(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])]);
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
fn arms_in_front_of_the_trunk_do_not_count_as_trunk() {
    let arms = |reach: f64, radius: f64| {
        [
            Cylinder::upright(reach, 60.0, [radius; 2]),
            Cylinder::upright(-reach, 60.0, [radius; 2]),
        ]
    };
    let [left, right] = arms(290.0, 40.0);
    let trunk = Cylinder::upright(0.0, 0.0, [130.0, 110.0]);
    let avatar = avatar(&[trunk, left, right]);
    let [left, right] = arms(280.0, 45.0);
    let body = Cylinder::upright(0.0, 0.0, [160.0, 115.0]);
    let found = waist(&avatar, &render(&[body, left, right], &EIGHT), &EIGHT);
    let error = found / body.girth() - 1.0;
    assert!(error.abs() < 0.015, "{error}");
}

#[test]
fn an_outline_that_another_limb_hides_is_an_outlier() {
    let avatar = avatar(&[Cylinder::upright(0.0, 0.0, [140.0, 110.0])]);
    let body = Cylinder::upright(0.0, 0.0, [160.0, 115.0]);
    let clean = render(&[body], &EIGHT);
    let mut silhouettes = clean.clone();
    // An arm that the avatar lacks, merged with the trunk in one view
    let arm = Cylinder::upright(190.0, 0.0, [40.0, 40.0]);
    silhouettes[1] = render(&[body, arm], &EIGHT[1..2]).remove(0);
    let expected = waist(&avatar, &clean, &EIGHT);
    let found = waist(&avatar, &silhouettes, &EIGHT);
    assert!(
        (found / expected - 1.0).abs() < 0.01,
        "{found}, expected {expected}"
    );
}

#[test]
fn a_limb_is_measured_across_its_axis() {
    let arm = |radii| Cylinder {
        middle: DVec3::new(250.0, 1200.0, 0.0),
        half_axis: DVec3::new(120.0, -130.0, 20.0),
        radii,
    };
    let avatar = avatar(&[arm([45.0, 45.0])]);
    let body = arm([52.0, 52.0]);
    let found = around(&avatar, body.half_axis, &render(&[body], &EIGHT), &EIGHT);
    let error = found / body.girth() - 1.0;
    assert!(error.abs() < 0.01, "{error}");
}

#[test]
fn a_tape_follows_the_pose_of_each_view() {
    let avatar = avatar(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])]);
    let body = Cylinder::upright(0.0, 0.0, [160.0, 120.0]);
    let mesh = body.mesh();
    let poses: Vec<Pose> = (0..8)
        .map(|i| {
            let mut pose = Pose::default();
            let lean = [0.03, -0.05, 0.02, 0.04][i % 4];
            pose.rotations[Bone::Root] = DVec3::new(lean, 0.1 * lean, -lean);
            pose.shift_mm = DVec3::new(400.0 * lean, 0.0, -300.0 * lean);
            pose
        })
        .collect();
    let outlines: Vec<OutlineMap> = poses
        .iter()
        .zip(EIGHT)
        .map(|(pose, degrees)| {
            let posed = pirouette_body::pose_bones(
                &avatar.bone_heads,
                pose,
                TurnAngle::from_degrees(degrees),
            );
            let weights = vec![SkinWeight::rigid(Bone::Root); mesh.positions.len()];
            let positions = posed.skin(&mesh.positions, &weights);
            outline(&render::silhouette(&positions, &mesh.triangles, &camera()))
        })
        .collect();
    let views = seen(&avatar, &outlines, camera(), EIGHT.into_iter().zip(poses));
    let tape = tape(&avatar, DVec3::Y);
    let found = fit_girth(&tape, &find_lines(&tape, &views), views.len()).unwrap();
    let error = found.girth_mm / body.girth() - 1.0;
    assert!(error.abs() < 0.003, "{error}");
}

#[test]
fn a_turn_of_all_views_with_body_and_avatar_changes_nothing() {
    let parts = [Cylinder::upright(20.0, 0.0, [150.0, 110.0])];
    let silhouettes = render(&parts, &EIGHT);
    let avatar = avatar(&[Cylinder::upright(0.0, 0.0, [130.0, 110.0])]);
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

fn woman(stature_mm: f64) -> Avatar {
    let parameters = MannequinParameters {
        sex: Sex::Female,
        stature_mm: Some(stature_mm),
        ..MannequinParameters::default()
    };
    mannequin(&parameters).expect("the parameters are valid")
}

fn input_of<'a>(
    avatar: &'a Avatar,
    views: &'a [MeasureView<'a>],
    source: BodySource,
) -> MeasureInput<'a> {
    MeasureInput {
        source,
        views,
        ..MeasureInput::of_avatar(avatar)
    }
}

fn measured(avatar: &Avatar, views: &[MeasureView], source: BodySource) -> Measurements {
    measure(&input_of(avatar, views, source))
}

#[test]
fn without_views_the_body_alone_is_measured() {
    let avatar = woman(1640.0);
    let all = measured(&avatar, &[], BodySource::Fitted);
    for (measure, true_mm) in measure_avatar(&avatar) {
        let found = all.get(measure);
        let value_mm = found.value_mm.expect("the body has it");
        assert!((value_mm - true_mm).abs() < 1e-6, "{measure:?}");
        assert!(found.sd_mm.is_some_and(|sd| sd > 0.0), "{measure:?}");
        assert!(found.lines.is_none());
    }
    assert_eq!(all.get(Measure::WaistGirth).method, Method::BodyTape);
    // An avatar that is not the person: the section of the hull, here of the avatar itself, less the excess of carving
    // from the minimum that can be carved from, two directions.
    let waist = measured(&avatar, &[], BodySource::Hull);
    let waist = waist.get(Measure::WaistGirth);
    assert_eq!(waist.method, Method::HullSection);
    let expected = all.value_mm(Measure::WaistGirth).unwrap() * std::f64::consts::PI / 4.0;
    let found = waist.value_mm.unwrap();
    assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
}

#[test]
fn outlines_and_body_are_combined_and_inconsistency_is_reported() {
    let avatar = woman(1640.0);
    let seen = |avatar: &Avatar| -> Vec<OutlineMap> {
        EIGHT
            .iter()
            .map(|&degrees| {
                let turn = TurnAngle::from_degrees(degrees).room_from_world();
                let positions: Vec<DVec3> =
                    avatar.mesh.positions.iter().map(|&p| turn * p).collect();
                outline(&render::silhouette(
                    &positions,
                    &avatar.mesh.triangles,
                    &camera(),
                ))
            })
            .collect()
    };
    let views = |outlines: &[OutlineMap]| {
        let views = outlines.iter().zip(EIGHT);
        let all: Vec<Measured> = {
            let views: Vec<MeasureView> = views
                .map(|(outline, degrees)| MeasureView {
                    outline,
                    camera: camera(),
                    turn: TurnAngle::from_degrees(degrees),
                    pose: Pose::default(),
                })
                .collect();
            let all = measured(&avatar, &views, BodySource::Fitted);
            [Measure::WaistGirth, Measure::HipGirth]
                .map(|m| *all.get(m))
                .to_vec()
        };
        all
    };
    let own = seen(&avatar);
    for same in views(&own) {
        assert_eq!(same.method, Method::Combined);
        assert!(!same.contradicted);
        let (lines, body) = (same.lines.unwrap(), same.body.unwrap());
        let error = lines.value_mm / body.value_mm - 1.0;
        assert!(error.abs() < 0.01, "{error}");
        let (low, high) = (
            lines.value_mm.min(body.value_mm),
            lines.value_mm.max(body.value_mm),
        );
        assert!((low..=high).contains(&same.value_mm.unwrap()));
        assert!(same.sd_mm.unwrap() < lines.sd_mm.max(body.sd_mm) + 5.0);
    }
    let mut stouter = avatar.clone();
    for p in &mut stouter.mesh.positions {
        (p.x, p.z) = (1.15 * p.x, 1.15 * p.z);
    }
    let other = views(&seen(&stouter));
    assert!(other.iter().all(|m| m.contradicted), "{other:?}");
}

#[test]
fn a_larger_scene_has_larger_measures() {
    let (small, large) = (measure_avatar(&woman(1500.0)), {
        measure_avatar(&woman(1500.0).scaled_to(1800.0))
    });
    for ((measure, a), (_, b)) in small.iter().zip(&large) {
        // Levels are searched in steps.
        assert!((b / a / 1.2 - 1.0).abs() < 2e-3, "{measure:?} {a} {b}");
    }
    // Camera and body of twice the size give the same photos, and tapes of twice the length.
    let body = Cylinder::upright(10.0, 5.0, [150.0, 110.0]);
    let silhouettes = render(&[body], &EIGHT);
    let avatar = avatar(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])]);
    let single = waist(&avatar, &silhouettes, &EIGHT);
    let mut double = avatar.clone();
    for p in &mut double.mesh.positions {
        *p *= 2.0;
    }
    let far = Camera {
        height_mm: 2.0 * camera().height_mm,
        distance_mm: 2.0 * camera().distance_mm,
        ..camera()
    };
    let outlines = outlines(&silhouettes);
    let views = seen(&double, &outlines, far, still(&EIGHT));
    let tape = tape(&double, DVec3::Y);
    let found = fit_girth(&tape, &find_lines(&tape, &views), views.len()).unwrap();
    let ratio = found.girth_mm / single;
    assert!((ratio - 2.0).abs() < 0.004, "{ratio}");
}

#[test]
fn unavailable_measures_carry_the_reason() {
    let mut avatar = avatar(&[Cylinder::upright(0.0, 0.0, [130.0, 115.0])]);
    avatar.mesh.positions[0] = DVec3::NAN;
    let blank = outline(&Grid::filled(600, 800, 0.0));
    let view = MeasureView {
        outline: &blank,
        camera: camera(),
        turn: TurnAngle::default(),
        pose: Pose::default(),
    };
    let all = measure(&MeasureInput {
        body: &TriMesh::default(),
        source: BodySource::Hull,
        views: &[view],
        stature_mm: None,
        ..MeasureInput::of_avatar(&avatar)
    });
    let order: Vec<Measure> = all.iter().map(|(measure, _)| measure).collect();
    assert_eq!(order, Measure::ALL);
    let reason = |measure| all.get(measure).value_mm.err();
    assert_eq!(reason(Measure::Stature), Some(Unavailable::NoBody));
    assert!(reason(Measure::NeckGirth).is_some() && reason(Measure::WaistGirth).is_some());
}

#[test]
fn without_a_scale_lengths_are_in_units_of_the_stature() {
    let avatar = woman(1640.0);
    let input = MeasureInput {
        stature_mm: None,
        ..input_of(&avatar, &[], BodySource::Fitted)
    };
    let (bare, scaled) = (measure(&input), measured(&avatar, &[], BodySource::Fitted));
    let share = bare
        .value_mm(Measure::HipGirth)
        .map(|v| bare.unit().convert(v));
    let expected = scaled.value_mm(Measure::HipGirth).unwrap() / 1640.0;
    assert!((share.unwrap() - expected).abs() < 1e-4);
    assert!(!bare.in_mm());
    assert!(bare.mass.is_none());
}
