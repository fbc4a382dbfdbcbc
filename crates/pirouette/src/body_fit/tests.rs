use pirouette_geom::section::{plane_section, tape_length};

use super::*;
use crate::measure::{Measure, measure_avatar};
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::render::silhouette;
use pirouette_body::{Keypoint, PosedAvatar, Sex};
use pirouette_geom::Grid;
use pirouette_synthetic::{Random, SyntheticOptions};

/// Views of an avatar, without photos
struct Seen {
    silhouettes: Vec<Windowed<f32>>,
    keypoints: Vec<Keypoints>,
    turns: Vec<TurnAngle>,
    camera: Camera,
    stature_mm: f64,
}

impl Seen {
    fn new(avatar: &Avatar, turns: &[TurnAngle], poses: &[Pose]) -> Self {
        let stature_mm = avatar.stature_mm();
        let camera = SyntheticOptions::camera_for(stature_mm, 320, 400);
        let seen = turns.iter().zip(poses).map(|(&turn, pose)| {
            let PosedAvatar {
                bones: posed,
                positions,
            } = avatar.posed(pose, turn);
            let mut keypoints = Keypoints::default();
            for joint in Joint::ALL {
                let point = match joint {
                    Joint::Neck | Joint::MidHip => continue,
                    _ => posed.carry(joint.bone(), avatar.keypoints[joint]),
                };
                let keypoint = Keypoint {
                    position: camera.project(point),
                    confidence: 0.9,
                };
                keypoints.set(joint, keypoint);
            }
            (
                Windowed::new(&silhouette(&positions, &avatar.mesh.triangles, &camera)),
                keypoints,
            )
        });
        let (silhouettes, keypoints) = seen.unzip();
        Self {
            silhouettes,
            keypoints,
            turns: turns.to_vec(),
            camera,
            stature_mm,
        }
    }

    fn still(avatar: &Avatar, view_count: usize) -> Self {
        let turns = SyntheticOptions::even_turns(view_count);
        Self::new(avatar, &turns, &vec![Pose::default(); view_count])
    }

    fn views(&self) -> Vec<BodyFitView<'_>> {
        (0..self.turns.len())
            .map(|i| BodyFitView {
                silhouette: &self.silhouettes[i],
                keypoints: &self.keypoints[i],
                camera: self.camera,
                turn: self.turns[i],
                stepped: false,
                tracked: None,
                pose: Pose::default(),
                stature_mm: self.stature_mm,
            })
            .collect()
    }

    fn prior(&self) -> BodyFitPrior {
        BodyFitPrior {
            stature_mm: Some(self.stature_mm),
            ..BodyFitPrior::default()
        }
    }

    fn fit(&self, start: &Avatar, options: &BodyFitOptions) -> Found {
        fit_body(start, &self.views(), &self.prior(), options, &|| false).into()
    }
}

/// A fitted body with its views
struct Found {
    avatar: Avatar,
    residual_px: f64,
    views: Vec<FittedView>,
}

impl From<(FittedBody, Vec<FittedView>)> for Found {
    fn from((body, views): (FittedBody, Vec<FittedView>)) -> Self {
        let FittedBody {
            avatar,
            residual_px,
        } = body;
        Self {
            avatar,
            residual_px,
            views,
        }
    }
}

impl Found {
    fn mean_iou(&self) -> Option<f64> {
        let ious = self.views.iter().map(|view| view.silhouette_iou);
        let sum: f64 = ious.sum::<Option<f64>>()?;
        Some(sum / self.views.len() as f64)
    }
}

fn avatar(sex: Sex, mass_kg: f64) -> Avatar {
    mannequin(&MannequinParameters {
        sex,
        stature_mm: Some(1700.0),
        mass_kg: Some(mass_kg),
        ..MannequinParameters::default()
    })
    .unwrap()
}

fn quick() -> BodyFitOptions {
    let mut options = BodyFitOptions::default();
    for round in &mut options.rounds {
        round.coarse_count = 1200;
    }
    options
}

/// Returns the mean distance between corresponding vertices, in mm
fn mean_distance(a: &Avatar, b: &Avatar) -> f64 {
    let pairs = a.mesh.positions.iter().zip(&b.mesh.positions);
    pairs.map(|(p, q)| p.distance(*q)).sum::<f64>() / a.mesh.positions.len() as f64
}

/// Returns the level of a trunk tape of the avatar, and the tape length there
fn true_tape(avatar: &Avatar, height: Measure) -> (f64, f64) {
    let measures = measure_avatar(avatar);
    let found = measures.iter().find(|(measure, _)| *measure == height);
    let (_, level_mm) = *found.expect("the mannequin has every measure");
    (level_mm, girth_at(avatar, level_mm))
}

/// Returns the tape length of the longest level section
fn girth_at(avatar: &Avatar, level_mm: f64) -> f64 {
    plane_section(&avatar.mesh, DVec3::Y * level_mm, DVec3::Y)
        .iter()
        .map(|points| tape_length(points))
        .fold(0.0, f64::max)
}

#[test]
fn a_still_mannequin_comes_back_within_millimeters_and_stands_on_the_floor() {
    let truth = avatar(Sex::Female, 70.0);
    let fit = Seen::still(&truth, 8).fit(&truth, &quick());
    let off = mean_distance(&fit.avatar, &truth);
    // A millimeter of it is the lowest point of the soles, which comes to lie on the floor.
    assert!(off < 1.3, "{off}");
    let (low, _) = fit.avatar.mesh.bounds().unwrap();
    assert!(low.y.abs() < 1e-9, "{low}");
    assert!(fit.mean_iou().unwrap() > 0.985);
    fit.avatar.mesh.check().unwrap();
}

#[test]
fn a_heavier_body_is_found_from_a_lighter_start() {
    let truth = avatar(Sex::Neutral, 84.0);
    let start = avatar(Sex::Neutral, 63.0);
    let fit = Seen::still(&truth, 8).fit(&start, &quick());
    for tape in [
        Measure::BustHeight,
        Measure::WaistHeight,
        Measure::HipHeight,
    ] {
        let (level_mm, girth_mm) = true_tape(&truth, tape);
        let before = girth_at(&start, level_mm) / girth_mm - 1.0;
        let after = girth_at(&fit.avatar, level_mm) / girth_mm - 1.0;
        assert!(before < -0.05, "{tape:?} {before}");
        assert!(after.abs() < 0.02, "{tape:?} {after}");
    }
}

#[test]
fn sway_goes_into_the_poses_and_not_into_the_body() {
    let truth = avatar(Sex::Male, 75.0);
    let turns = SyntheticOptions::even_turns(8);
    let sigmas = Pose::prior_sigmas();
    let mut random = Random::new(7);
    let poses: Vec<Pose> = turns
        .iter()
        .map(|_| Pose::from_parameters(&sigmas.map(|sigma| 0.5 * sigma * random.normal())))
        .collect();
    let fit = Seen::new(&truth, &turns, &poses).fit(&truth, &quick());
    // The position of the person is known only up to the mean of the sway, so girths are compared.
    for tape in [
        Measure::BustHeight,
        Measure::WaistHeight,
        Measure::HipHeight,
    ] {
        let (level_mm, girth_mm) = true_tape(&truth, tape);
        let error = girth_at(&fit.avatar, level_mm) / girth_mm - 1.0;
        assert!(error.abs() < 0.01, "{tape:?} {error}");
    }
    assert!(fit.mean_iou().unwrap() > 0.97);
}

#[test]
fn other_turn_angles_of_the_same_body_give_the_same_body() {
    let truth = avatar(Sex::Female, 62.0);
    let even = SyntheticOptions::even_turns(8);
    let turned: Vec<TurnAngle> = even
        .iter()
        .map(|turn| TurnAngle::from_degrees(turn.degrees() + 22.5))
        .collect();
    let start = avatar(Sex::Female, 57.0);
    let still = vec![Pose::default(); 8];
    let [a, b] =
        [even, turned].map(|turns| Seen::new(&truth, &turns, &still).fit(&start, &quick()));
    let off = mean_distance(&a.avatar, &b.avatar);
    assert!(off < 3.0, "{off}");
}

#[test]
fn two_views_and_empty_silhouettes_still_give_a_closed_body() {
    let truth = avatar(Sex::Female, 62.0);
    let turns = [0.0, 90.0].map(TurnAngle::from_degrees);
    let mut seen = Seen::new(&truth, &turns, &[Pose::default(); 2]);
    let fit = seen.fit(&truth, &quick());
    fit.avatar.mesh.check().unwrap();
    assert!(mean_distance(&fit.avatar, &truth) < 2.0);
    seen.silhouettes[1] = Windowed::new(&Grid::filled(320, 400, 0.0));
    seen.silhouettes[0] = Windowed::new(&Grid::filled(320, 400, f32::NAN));
    let fit = seen.fit(&truth, &quick());
    fit.avatar.check().unwrap();
    assert_eq!(
        seen.fit(
            &truth,
            &BodyFitOptions {
                rounds: Vec::new(),
                ..quick()
            }
        )
        .residual_px,
        f64::INFINITY
    );
}

#[test]
fn a_camera_that_was_taken_for_another_is_found() {
    let truth = avatar(Sex::Female, 62.0);
    let seen = Seen::still(&truth, 8);
    let mut views = seen.views();
    for view in &mut views {
        view.camera.distance_mm += 25.0;
        view.camera.pitch_radians += 0.4_f64.to_radians();
    }
    let fit = |camera: CameraSpread| {
        let prior = BodyFitPrior {
            camera,
            ..seen.prior()
        };
        Found::from(fit_body(&truth, &views, &prior, &quick(), &|| false))
    };
    let held = fit(CameraSpread::default());
    assert_eq!(held.views[0].camera, views[0].camera);
    let found = fit(CameraSpread {
        distance_mm: 100.0,
        height_mm: 0.0,
        pitch_radians: 1.0_f64.to_radians(),
    });
    let (camera, expected) = (found.views[0].camera, seen.camera);
    let off_mm = camera.distance_mm - expected.distance_mm;
    let off_degrees = (camera.pitch_radians - expected.pitch_radians).to_degrees();
    assert!(off_mm.abs() < 8.0, "{off_mm}");
    assert!(off_degrees.abs() < 0.1, "{off_degrees}");
    assert!(found.views.iter().all(|view| view.camera == camera));
    assert!((camera.height_mm - expected.height_mm).abs() < 1e-12);
    let (held, found) = (
        mean_distance(&held.avatar, &truth),
        mean_distance(&found.avatar, &truth),
    );
    assert!(found < 1.5 && found < 0.8 * held, "{found} {held}");
}

#[test]
fn a_cancelled_fit_comes_back_at_once_as_it_started() {
    let truth = avatar(Sex::Female, 62.0);
    let seen = Seen::still(&truth, 3);
    let (fit, _) = fit_body(&truth, &seen.views(), &seen.prior(), &quick(), &|| true);
    assert!(mean_distance(&fit.avatar, &truth) < 1e-9);
}

#[test]
fn the_contour_of_an_avatar_lies_on_its_silhouettes_outline() {
    let truth = avatar(Sex::Female, 62.0);
    let seen = Seen::still(&truth, 3);
    for (view, turn) in seen.turns.iter().enumerate() {
        let positions = truth.posed(&Pose::default(), *turn).positions;
        let mesh = occluding_contour::ContourMesh::new(&truth.mesh.triangles, positions.len());
        let contour = mesh.contour(&positions, &seen.camera, 1.0);
        let outline = outline::PointIndex::new(&outline::trace(&seen.silhouettes[view], 0.5), 1.0);
        assert!(contour.len() > 300);
        let near = contour
            .iter()
            .filter(|r| outline.nearest(r.edge, 1.0, 0.3).is_some())
            .count();
        assert!(
            near * 100 > 95 * contour.len(),
            "{near} of {}",
            contour.len()
        );
    }
}

#[test]
fn outline_targets_lead_from_the_photo_to_the_reference_pose() {
    let truth = avatar(Sex::Female, 62.0);
    let mut pose = Pose::default();
    pose.rotations[Bone::LeftUpperArm] = DVec3::new(0.0, 0.0, 0.15);
    pose.shift_mm = DVec3::new(20.0, 0.0, 0.0);
    let turn = TurnAngle::from_degrees(0.0);
    let seen = Seen::new(&truth, &[turn], &[pose]);
    let contour_mesh = ContourMesh::new(&truth.mesh.triangles, truth.mesh.positions.len());
    let targets = OutlineTargets::new(&truth, &contour_mesh, &pose, turn, &seen.camera);
    let reference = Seen::new(&truth, &[turn], &[Pose::default()]);
    let outline = outline::trace(&seen.silhouettes[0], 0.5);
    let expected = outline::PointIndex::new(&outline::trace(&reference.silhouettes[0], 0.5), 1.0);
    let (mut known, mut right) = (0, 0);
    for point in &outline {
        let Some(target) = targets.target(point.position, point.normal) else {
            continue;
        };
        known += 1;
        let moved = outline::EdgePoint {
            position: target,
            normal: point.normal,
        };
        right += usize::from(expected.nearest(moved, 1.5, 0.3).is_some());
    }
    assert!(
        known * 100 > 95 * outline.len(),
        "{known} of {}",
        outline.len()
    );
    assert!(right * 100 > 95 * known, "{right} of {known}");
    assert!(targets.target(DVec2::splat(-500.0), DVec2::X).is_none());
}
